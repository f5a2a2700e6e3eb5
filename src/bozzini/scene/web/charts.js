/** Charts on a canvas: values over the steps, and clearance along the body, both for clicking. */
import { assign, clamp } from "./math.js";
import { smallest } from "./scene_data.js";

const LEFT = 38, RIGHT = 8, TOP = 8, BOTTOM = 18;

/** Numbers with a true minus sign. */
export const show = (value, digits = 1) => (Number.isFinite(value) ? value.toFixed(digits).replace("-", "\u2212") : "\u2013");

/** Where the i-th value of a chart stands on a canvas, in pixels from the left. */
function placeOf(canvas, { over, bars }, i) {
	const n = over.length, f = bars ? i / n : (over[i] - over[0]) / (over[n - 1] - over[0] || 1);
	return LEFT + (canvas.clientWidth - LEFT - RIGHT) * f;
}

/**
 * Draw a chart; beside the bar `marked` the others are pale.
 * @param {{values, over, overUnit, bars, color, high}} chart values over their places, up to `high`
 * @returns where the i-th value stands, in pixels from the left
 */
export function drawChart(canvas, chart, marked = -1) {
	const { values, over, bars, color = () => "#5b9bd5" } = chart, ratio = devicePixelRatio;
	const width = canvas.clientWidth, height = canvas.clientHeight, n = values.length, x = (i) => placeOf(canvas, chart, i);
	[canvas.width, canvas.height] = [width * ratio, height * ratio];
	const ink = canvas.getContext("2d"), style = getComputedStyle(canvas), [line, soft] = ["--line", "--soft"].map((name) => style.getPropertyValue(name));
	const low = Math.min(0, smallest(values) || 0), high = chart.high || Math.max(low + 0.1, -1.08 * smallest(values.map((v) => -v)) || 1);
	const y = (v) => height - BOTTOM - ((height - TOP - BOTTOM) * (clamp(v, low, high) - low)) / (high - low);
	const write = (words, u, v, align) => {
		assign(ink, { fillStyle: soft, textAlign: align });
		ink.fillText(words, u, v);
	};
	ink.scale(ratio, ratio);
	assign(ink, { font: "11px system-ui, sans-serif", textBaseline: "middle", lineWidth: 1.8, lineJoin: "round" });
	for (const tick of new Set([low, 0, high / 2, high])) {
		write(show(tick, high - low < 10 ? 1 : 0), LEFT - 6, y(tick), "right");
		ink.fillStyle = tick ? line : soft;
		ink.fillRect(LEFT, Math.round(y(tick)), width - LEFT - RIGHT, 1);
	}
	write(show(over[0], 0), LEFT, height - 7, "left");
	write(`${show(over[n - 1], 0)} ${chart.overUnit}`, width - RIGHT, height - 7, "right");
	for (let i = 0; i < n; i++) {
		const value = bars ? values[i] : Math.min(values[i], values[i + 1]);
		if (!Number.isFinite(value)) continue;
		ink.strokeStyle = ink.fillStyle = color(value);
		ink.globalAlpha = marked < 0 || i === marked ? 1 : 0.3;
		if (bars) ink.fillRect(x(i), y(value), Math.max(1, x(1) - x(0) - 0.5), y(0) - y(value));
		else {
			ink.beginPath();
			ink.moveTo(x(i), y(values[i]));
			ink.lineTo(x(i + 1), y(values[i + 1]));
			ink.stroke();
		}
	}
	return x;
}

/** The index of the value that is nearest to a pointer. */
export function indexUnder(canvas, chart, event) {
	const gaps = chart.over.map((_, i) => Math.abs(placeOf(canvas, chart, chart.bars ? i + 0.5 : i) - event.offsetX));
	return gaps.indexOf(Math.min(...gaps));
}

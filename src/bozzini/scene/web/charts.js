/** Charts on a canvas: values over the steps, and clearance along the body, both for clicking. */
import { clamp } from "./math.js";
import { clearanceColor, smallest } from "./scene_data.js";

const EDGE = { left: 38, right: 8, top: 8, bottom: 18 };

/** Numbers with a true minus sign. */
export const show = (value, digits = 1) => (Number.isFinite(value) ? value.toFixed(digits).replace("-", "\u2212") : "\u2013");

const largest = (values) => values.reduce((a, b) => (Number.isFinite(b) && !(b <= a) ? b : a), NaN);

/** Round numbers for about three ticks between two values. */
function chooseTicks(low, high) {
  const raw = (high - low) / 3 || 1, ten = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * ten).find((k) => k >= raw), ticks = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9; k++) ticks.push(k * step);
  return ticks;
}

/**
 * @param {HTMLCanvasElement} canvas
 * @param {{values, over, unit, overUnit, bars, color}} chart `over` are the places of the values;
 *   `color(value)` gives css; `bars` draws a bar for each value, that of `marked` framed
 * @returns where the i-th value stands, in pixels from the left
 */
export function drawChart(canvas, chart, marked = -1) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (!width || !height) return () => 0;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const ink = canvas.getContext("2d"), style = getComputedStyle(canvas);
  ink.scale(ratio, ratio);
  ink.font = "11px system-ui, sans-serif";
  const { values, over } = chart, n = values.length;
  const low = Math.min(0, smallest(values)) || 0, top = chart.high || 1.08 * largest(values) || 1;
  const high = Math.max(top, low + 1e-6), first = over[0] ?? 0, last = over[n - 1] ?? 1;
  const x = (i) => EDGE.left + ((width - EDGE.left - EDGE.right) * (chart.bars ? i / n : (over[i] - first) / (last - first || 1)));
  const y = (v) => height - EDGE.bottom - ((height - EDGE.top - EDGE.bottom) * (clamp(v, low, high) - low)) / (high - low);
  const grid = style.getPropertyValue("--line"), text = style.getPropertyValue("--soft");
  ink.textBaseline = "middle";
  ink.textAlign = "right";
  for (const tick of chooseTicks(low, high)) {
    ink.fillStyle = text;
    ink.fillText(show(tick, Math.abs(high - low) < 4 ? 1 : 0), EDGE.left - 6, y(tick));
    ink.fillStyle = tick === 0 ? text : grid;
    ink.fillRect(EDGE.left, Math.round(y(tick)), width - EDGE.left - EDGE.right, 1);
  }
  ink.fillStyle = text;
  ink.textAlign = "left";
  ink.fillText(show(first, 0), EDGE.left, height - 7);
  ink.textAlign = "right";
  ink.fillText(`${show(last, 0)} ${chart.overUnit}`, width - EDGE.right, height - 7);
  if (chart.bars) {
    for (let i = 0; i < n; i++) {
      if (!Number.isFinite(values[i])) continue;
      const wide = Math.max(1, x(1) - x(0) - 0.5), base = y(0), to = y(values[i]);
      ink.fillStyle = chart.color(values[i]);
      ink.fillRect(x(i), Math.min(base, to), wide, Math.max(1.5, Math.abs(to - base)));
      if (i === marked) {
        ink.strokeStyle = style.getPropertyValue("--ink");
        ink.strokeRect(x(i) - 1, EDGE.top - 2, wide + 2, height - EDGE.top - EDGE.bottom + 3);
      }
    }
    return x;
  }
  ink.lineWidth = 1.8;
  ink.lineJoin = "round";
  for (let i = 0; i + 1 < n; i++) {
    if (!Number.isFinite(values[i]) || !Number.isFinite(values[i + 1])) continue;
    ink.strokeStyle = chart.color(Math.min(values[i], values[i + 1]));
    ink.beginPath();
    ink.moveTo(x(i), y(values[i]));
    ink.lineTo(x(i + 1), y(values[i + 1]));
    ink.stroke();
  }
  return x;
}

/** The index of the value under a pointer. */
export function indexUnder(canvas, chart, event) {
  const box = canvas.getBoundingClientRect(), n = chart.values.length;
  const f = clamp((event.clientX - box.left - EDGE.left) / (box.width - EDGE.left - EDGE.right || 1), 0, 1);
  if (chart.bars) return Math.min(n - 1, Math.floor(f * n));
  const want = chart.over[0] + f * (chart.over[n - 1] - chart.over[0]);
  let best = 0;
  chart.over.forEach((value, i) => {
    if (Math.abs(value - want) < Math.abs(chart.over[best] - want)) best = i;
  });
  return best;
}

/** Css colours for the values of a chart. */
export const chartColor = (data, kind) =>
  kind === "clearance" ? (value) => clearanceColor(data.scale, value) : () => "#5b9bd5";

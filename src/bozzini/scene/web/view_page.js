/** The page round the pictures: controls, charts, measuring, keyboard and words for screen readers. */
import { assign, dot, gap, lookAlong, multiply, perspective, place, scaled } from "./math.js";
import { clearanceAt, clearanceColor, decodeView, jointsAt, recordedSource, smallest, tipCamera } from "./scene_data.js";
import { createRenderer } from "./renderer.js";
import { createCamera, steerCamera } from "./camera.js";
import { drawChart, indexUnder, show } from "./charts.js";
import { arcLengthAt, largestBall, pickLink, pickSurface } from "./measure.js";

const NAMES = { R: "right", L: "left", A: "front", P: "back", S: "head", I: "feet" };
/** Make an element, such as "div" or "div.row": properties or attributes, then children. */
export function make(tag, props = {}, ...children) {
	const [name, kind = ""] = tag.split("."), made = assign(document.createElement(name), props);
	if (kind) made.classList.add(kind);
	made.append(...children);
	return made;
}

const button = (text, title, onclick, kind = "") => make(`button.${kind}`, { type: "button", title, onclick }, text);

/**
 * Make a viewer of `data` (see `decodeView`) in `root`, which holds the parts of view.html, played by
 * `source` ({seek(step), play(on, speed)}, and `onframe` if it is recorded).
 */
export function createViewer(root, data, source) {
	let frame = { step: 0, joints: null, clearance: null }, inside = false, measuring = false, playing = false, planned = false, taker = null;
	let clip = null, picks = [], lit = -1, series = [], along = null;

	const parts = {};
	for (const item of root.querySelectorAll("[class]")) parts[item.classList[0]] = item;
	const { picture: canvas, overlay, said, trouble, title, readout, legend, low, high, sides, fit, theme, inset, slider, play: playButton, pace, tightest, timeline } = parts;
	const { panel, charts, places, measure, hint, measured, planes, depth, shown, opacity, notes } = parts;
	root.classList.add("bozzini");

	const renderer = createRenderer(canvas), camera = createCamera(data, () => paint());
	const night = matchMedia("(prefers-color-scheme: dark)"), isDark = () => (root.dataset.theme || (night.matches && "dark")) === "dark";
	/** How much of the stage, from the left, the picture from the tip takes beside that from outside. */
	const beside = () => (root.classList.contains("twin") ? 0.5 : 0);
	const say = (text) => (said.textContent = text);

	function paint() {
		if (!planned) requestAnimationFrame(draw);
		planned = true;
	}

	function tipView(box) {
		const { joints } = frame, radius = data.scope?.radius;
		const eye = frame.camera || (joints?.length > 3 && tipCamera(joints, radius, data.axes[2].way));
		return eye && {
			box, eye: eye.place, inside: true, hand: camera.hand, reach: 6 * radius, ground: [0.02, 0.01, 0.01, 1],
			camera: lookAlong(eye.place, eye.way, eye.up, camera.hand),
			projection: perspective(eye.fov || 1.75, box[2] / box[3], 0.05 * radius, 2 * camera.box.size),
		};
	}

	function outsideView(box, ground) {
		return { ...camera.look(box[2] / box[3]), box, clip, lit, ground, dark: ground || isDark() };
	}

	function draw() {
		planned = false;
		viewer.paints++;
		canvas.classList.toggle("picking", Boolean(measuring || taker));
		const ratio = Math.min(devicePixelRatio, 2), pixels = (...all) => all.map((v) => Math.round(v * ratio));
		const all = canvas.getBoundingClientRect(), box = inset.getBoundingClientRect(), [w, h] = pixels(all.width, all.height);
		if (!w || !h) return;
		if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
		const left = Math.round(beside() * w), full = [left, 0, w - left, h], small = pixels(box.left - all.left, all.bottom - box.bottom, box.width, box.height);
		if (renderer) {
			renderer.draw((inside && tipView(full)) || outsideView(full));
			const view = !inset.hidden && (inside ? outsideView(small, [0.04, 0.07, 0.1, 1]) : tipView(small));
			if (view) renderer.draw(view);
		}
		overlay.replaceChildren(...(inside ? [] : drawOverlay(outsideView(full), all.width * (1 - beside()), all.height)));
	}

	/** Make an element of the overlay: attributes only, as its properties cannot be written. */
	function draft(tag, attributes, words = "") {
		const made = document.createElementNS(overlay.namespaceURI, tag);
		for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
		made.textContent = words;
		return made;
	}

	/** Labels, measured places and the patient's axes, over the picture. */
	function drawOverlay({ projection, camera: m }, w, h) {
		const items = [], used = [], matrix = multiply(projection, m);
		const spot = (p) => (([x, y]) => [x * w, y * h])(place(matrix, p) || [-9, -9]);
		const label = (p, words, kind) => {
			const [x, y] = spot(p), left = used.some(([u, v]) => Math.abs(y - v) < 14 && Math.abs(x - u) < 120);
			used.push([x, y]);
			items.push(draft("circle", { cx: x, cy: y, r: 4.5, class: kind }), draft("text", { x: left ? x - 9 : x + 9, y: y + 4, class: left ? "left" : "" }, words));
		};
		for (const mark of data.marks) label(mark.place, mark.text, mark.kind);
		const ends = picks.map((pick) => spot(pick.place));
		if (ends[1]) items.push(draft("path", { d: `M${ends.join("L")}`, class: "ruler" }));
		picks.forEach((pick, i) => label(pick.place, "AB"[i], "pick"));
		return items.concat(data.axes
			.map(({ letter, way }) => [letter, ...[0, 1, 2].map((i) => dot([m[i], m[4 + i], m[8 + i]], way))])
			.sort((one, other) => one[3] - other[3])
			.flatMap(([letter, x, y, z]) => {
				const kind = z < -0.05 ? "axis faint" : "axis", [u, v] = [46, h - 46];
				return [draft("path", { d: `M${u} ${v}l${26 * x} ${-26 * y}`, class: kind }), draft("text", { x: u + 37 * x, y: v - 37 * y + 4, class: kind }, letter)];
			}));
	}

	// What is shown at a step.
	function setFrame(next) {
		viewer.frames++;
		frame = { ...frame, ...next };
		if (next.playing !== undefined) setPlaying(next.playing);
		const { step, joints, clearance } = frame, { scope, steps } = data;
		data.bodies.forEach((body, i) => {
			if (body === scope) joints && renderer?.setPose(i, joints, clearance, data.scale);
			else if (body.live) renderer?.setPose(i, body.joints);
			else if (body.steps > 1) renderer?.setPose(i, jointsAt(body, step));
		});
		data.clouds.forEach((item, i) => item.live && renderer?.setPose(data.bodies.length + i, item.points));
		const inserted = scope?.insertion?.[step], least = smallest(clearance), words = [];
		if (inserted !== undefined) words.push(`${show(inserted)} mm in`);
		if (clearance) words.push(Number.isFinite(least) ? `clearance ${show(least, 2)} mm` : "all in the introducer");
		if (steps > 1) words.push(`step ${step + 1} of ${steps}`);
		readout.replaceChildren(...words.map((word) => make("span", {}, word)));
		readout.classList.toggle("through", least < 0);
		slider.value = step;
		slider.setAttribute("aria-valuetext", words.join(", "));
		for (const { cursor, value, x, chart } of series) {
			cursor.style.left = `${x(step)}px`;
			value.textContent = show(chart.values[step] ?? NaN, 2);
		}
		drawAlong();
		paint();
	}

	function play(on) {
		setPlaying(on);
		source.play(on, Number(pace.value));
	}

	function setPlaying(on) {
		playing = on;
		const word = on ? "Pause" : "Play";
		assign(playButton, { textContent: on ? "\u275a\u275a" : "\u25b6", ariaLabel: word, title: `${word} (Space)` });
	}

	function seek(step) {
		if (playing) play(false);
		source.seek(step);
	}

	function goTightest() {
		if (data.tightest === null) return;
		seek(data.tightest);
		say(`Tightest: ${slider.getAttribute("aria-valuetext")}`);
	}

	function setInside(on) {
		if (inset.hidden) return;
		inside = on;
		root.classList.toggle("inside", on);
		say(on ? "From the tip." : "From outside.");
		paint();
	}

	/** Cut what is beyond the chosen plane, if one is. */
	function cut(index = planes.value) {
		planes.value = index;
		const way = data.axes[index]?.way, share = Number(depth.value);
		depth.disabled = !way;
		const [from, to] = [camera.box.low, camera.box.high].map((p) => way && dot(p, way)).sort((a, b) => a - b);
		clip = way && [...way, from + share * (to - from)];
		paint();
	}

	// Measuring.
	function setMeasuring(on) {
		measuring = on;
		picks = [];
		measure.ariaPressed = on;
		showMeasured();
		paint();
	}

	function click(x, y) {
		if (inside) return;
		const ray = camera.ray((x - beside()) / (1 - beside()), y), walls = data.walls.filter((item) => !item.hidden);
		const [wall] = walls.map((item) => ({ item, ...pickSurface(item, ray, clip) })).filter((hit) => hit.place).sort((a, b) => a.far - b.far);
		if (!wall && (taker || measuring)) say("There is no wall.");
		else if (taker) taker(wall);
		else if (!measuring) {
			const hit = frame.joints && pickLink(frame.joints, data.scope.radius, ray);
			lightLink(hit ? hit.link : -1);
		} else {
			wall.radius = largestBall(wall.item, wall.place, scaled(wall.normal, -1));
			wall.arc = data.way ? arcLengthAt(data.way.joints, wall.place) : NaN;
			picks = [...picks, wall].slice(picks.length === 2 ? 2 : 0);
			showMeasured();
			paint();
		}
	}

	function showMeasured() {
		const [a, b] = picks, rows = picks.flatMap((pick, i) => [[`Radius at ${"AB"[i]}`, pick.radius], [`Arc length of ${"AB"[i]}`, pick.arc]]);
		if (b) rows.push(["Distance A to B", gap(a.place, b.place)], ["Arc length A to B", Math.abs(b.arc - a.arc)]);
		const cells = rows.filter((row) => Number.isFinite(row[1])).flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, `${show(value, 2)} mm`)]);
		hint.hidden = !measuring || cells.length > 0;
		measured.replaceChildren(...cells);
		if (cells.length) say(cells.map((cell) => cell.textContent).join(" "));
	}

	function lightLink(link) {
		lit = link;
		const value = frame.clearance?.[link], known = Number.isFinite(value);
		if (along) along.value.textContent = known ? `link ${link + 1}: ${show(value, 2)}` : "";
		if (link >= 0) say(`Link ${link + 1} from the head${known ? `: clearance ${show(value, 2)} mm` : ", in the introducer"}.`);
		drawAlong();
		paint();
	}

	// The panel.
	function figure(name, unit, pick, chart) {
		const area = make("canvas", { role: "img", ariaLabel: name }), cursor = make("i.cursor"), value = make("b");
		const item = { area, cursor, value, chart, box: make("figure", {}, make("figcaption", {}, `${name} [${unit}]`, value), make("div", {}, area, cursor)) };
		const choose = (event) => event.buttons && pick(indexUnder(area, item.chart, event));
		assign(area, { onpointermove: choose, onpointerdown: (event) => (area.setPointerCapture(event.pointerId), choose(event)) });
		return item;
	}

	function fillPanel() {
		const { scope, scale, axes } = data, over = scope?.insertion || [...Array(data.steps).keys()];
		const side = (i) => NAMES[axes[i].letter] || axes[i].letter;
		series = (data.steps > 1 ? data.charts : []).map((chart) => figure(chart.name, chart.unit, seek, {
			...chart, over, overUnit: scope?.insertion ? "mm in" : "steps", ...(chart.kind === "clearance" && clearanceChart()),
		}));
		along = scope?.clearance ? figure("clearance along the body", "mm", lightLink) : null;
		charts.replaceChildren(...[...series, along].filter(Boolean).map((item) => item.box));
		places.replaceChildren(...data.marks.map((mark) => button(mark.text, "Go there", () => {
			if (mark.step !== null) seek(mark.step);
			setInside(false);
			camera.visit(mark.place);
		}, mark.kind)));
		places.parentElement.hidden = !data.marks.length;
		planes.replaceChildren(make("option", { value: "" }, "none"), ...axes.map((_, i) => make("option", { value: i }, `without ${side(i)}`)));
		sides.replaceChildren(...axes.map(({ letter }, i) => button(letter, `From ${side(i)} (${i + 1})`, () => (setInside(false), camera.standard(i)))));
		shown.replaceChildren(...[...data.surfaces, ...data.bodies, ...data.clouds].map((item) => make("label", {}, make("input", { type: "checkbox", checked: !item.hidden, onchange: (event) => ((item.hidden = !event.target.checked), paint()) }), item.name)));
		const wall = data.walls.findLast((item) => item.opacity < 1);
		opacity.parentElement.hidden = !wall;
		if (wall) assign(opacity, { value: wall.opacity, oninput: () => ((wall.opacity = Number(opacity.value)), paint()) });
		notes.replaceChildren(...data.notes.map((text) => make("p", {}, text)));
		legend.children[1].style.background = `linear-gradient(to right, ${scale.colors})`;
		low.textContent = show(scale.low, 0);
		high.textContent = `${show(scale.high, 0)} mm clearance`;
		legend.hidden = !along;
		timeline.hidden = data.steps < 2;
		tightest.hidden = data.tightest === null;
		inset.hidden = !scope || !data.surfaces.length;
		slider.max = data.steps - 1;
		title.textContent = data.title;
		resize();
	}

	const clearanceChart = () => ({ color: (value) => clearanceColor(data.scale, value), high: 1.6 * data.scale.high });

	function drawAlong() {
		if (!along || !frame.clearance) return;
		const values = Array.from(frame.clearance);
		along.chart = { ...clearanceChart(), values, over: values.map((_, i) => i + 1), overUnit: "links from the head", bars: true };
		drawChart(along.area, along.chart, lit);
	}

	function resize() {
		for (const item of series) item.x = drawChart(item.area, item.chart);
		setFrame({});
	}

	function turnTheme() {
		root.dataset.theme = isDark() ? "light" : "dark";
		resize();
	}

	steerCamera(canvas, camera, click);
	const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
	canvas.addEventListener("keydown", (event) => {
		const { key } = event, [x, y] = arrows[key] || [];
		if (arrows[key]) camera[event.shiftKey ? "pan" : "turn"](0.1 * x, 0.1 * y);
		else if ("+=-".includes(key)) camera.zoom(key === "-" ? 1.18 : 0.85);
		else if (key === "Enter") click(0.5 + beside() / 2, 0.5);
		else return;
		event.preventDefault();
	});
	const moving = { " ": () => play(!playing), ",": () => seek(frame.step - 1), ".": () => seek(frame.step + 1), Home: () => seek(0), End: () => seek(data.steps - 1), n: goTightest };
	const keys = {
		f: () => camera.fit(), t: () => setInside(!inside), m: () => setMeasuring(!measuring), b: turnTheme,
		x: () => cut(clip ? "" : 2), Escape: () => (setMeasuring(false), cut(""), taker?.(null)),
	};
	// Where the viewer is the page, keys work wherever the focus is.
	(root.matches("main") ? document : root).addEventListener("keydown", (event) => {
		const { target } = event, key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
		if (event.ctrlKey || event.metaKey || event.altKey || target.matches("select, textarea, input:not([type=range], [type=checkbox])")) return;
		if (key === " " && target.matches("button, summary, [type=checkbox]")) return;
		const act = keys[key] || (data.steps > 1 && moving[key]) || (data.axes[key - 1] && (() => camera.standard(key - 1)));
		if (!act) return;
		act();
		event.preventDefault();
	});
	playButton.onclick = () => play(!playing);
	tightest.onclick = goTightest;
	fit.onclick = () => camera.fit();
	theme.onclick = turnTheme;
	inset.onclick = () => setInside(!inside);
	measure.onclick = () => setMeasuring(!measuring);
	slider.oninput = () => seek(Number(slider.value));
	pace.onchange = () => playing && play(true);
	planes.onchange = depth.oninput = () => cut();
	night.addEventListener("change", resize);
	new ResizeObserver(resize).observe(root);
	canvas.addEventListener("webglcontextlost", (event) => {
		event.preventDefault();
		assign(trouble, { textContent: "The browser took the graphics away; the picture comes back with them.", hidden: false });
	});
	canvas.addEventListener("webglcontextrestored", () => {
		trouble.hidden = true;
		viewer.setData(data);
	});

	const viewer = {
		/** `frames` came and `paints` were drawn. */
		frames: 0, paints: 0, panel, setFrame, seek, say,
		get data() { return data; },
		get frame() { return frame; },
		/** Let `take` have the place {place, normal} of the wall that is clicked, null on Escape; or nobody. */
		pick(take) {
			taker = take;
			if (take) setInside(false), canvas.focus();
			paint();
		},
		/** Show other data, a new plan for example; the camera stays. */
		setData(next) {
			const plane = planes.value;
			data = next;
			picks = [];
			camera.setData(data);
			renderer?.setData(data);
			fillPanel();
			showMeasured();
			lightLink(-1);
			const step = Math.min(frame.step, data.steps - 1), { scope } = data;
			data.bodies.forEach((body, i) => renderer?.setPose(i, jointsAt(body, step), clearanceAt(body, step), data.scale));
			setFrame({ step, joints: scope && jointsAt(scope, step), clearance: scope && clearanceAt(scope, step) });
			cut(plane);
		},
		/** Move the vertices of a surface: tissue that moves. */
		setSurfaceVertices(index, vertices) {
			data.surfaces[index].vertices = vertices;
			renderer?.setVertices(index);
			paint();
		},
	};
	trouble.hidden = Boolean(renderer);
	setPlaying(false);
	setMeasuring(false);
	viewer.setData(data);
	if ("onframe" in source) source.onframe = setFrame;
	if (data.tightest !== null) source.seek(data.tightest);
	return viewer;
}

/** Start the viewer of a page that holds its data: base64 of the gzipped container, in #view. */
export async function startPage() {
	const bytes = Uint8Array.from(atob(document.getElementById("view").textContent), (letter) => letter.charCodeAt(0));
	const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
	const data = decodeView(await new Response(stream).arrayBuffer());
	window.viewer = createViewer(document.getElementById("viewer"), data, recordedSource(data));
}

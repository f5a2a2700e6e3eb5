/** The camera outside: it turns about a target, upright in the patient. */
import { add, clamp, cross, dot, gap, lookAlong, perspective, scaled, unit } from "./math.js";

const FOV = 0.6;
const STEEPEST = Math.PI / 2 - 0.01;

/** Lowest and highest corner of what a view shows, its middle and its size. */
function findBox({ surfaces, clouds, bodies }) {
	const low = [Infinity, Infinity, Infinity], high = low.map((x) => -x);
	const around = [...surfaces.map((item) => item.vertices), ...clouds.map((item) => item.points)];
	for (const flat of surfaces.length ? around : [...around, ...bodies.map((item) => item.joints)])
		flat.forEach((x, i) => {
			if (x < low[i % 3]) low[i % 3] = x;
			if (x > high[i % 3]) high[i % 3] = x;
		});
	return { low, high, middle: scaled(add(low, high), 0.5), size: gap(low, high) || 1 };
}

/** @param {() => void} changed called when the camera has moved */
export function createCamera(data, changed) {
	let front, right, top, target = [0, 0, 0], distance = 1, turn = 0, tilt = 0, aspect = 1;
	const tan = Math.tan(FOV / 2);
	function look() {
		const out = add(scaled(add(scaled(front, Math.cos(turn)), right, Math.sin(turn)), Math.cos(tilt)), top, Math.sin(tilt));
		const way = scaled(out, -1), side = scaled(unit(cross(way, top)), camera.hand);
		return { eye: add(target, out, distance), way, side, up: scaled(cross(side, way), camera.hand) };
	}
	const camera = {
		setData(next) {
			data = next;
			camera.box = findBox(data);
			[right, front, top] = (data.patient ? [0, 2, 4] : [1, 3, 4]).map((i) => data.axes[i].way);
			camera.hand = Math.sign(dot(cross(right, front), top)) || 1;
		},
		/** What the renderer needs, for a picture of this width over height. */
		look(shape) {
			const { eye, way } = look(), { size } = camera.box;
			aspect = shape;
			return {
				eye, size, hand: camera.hand, camera: lookAlong(eye, way, top, camera.hand),
				projection: perspective(FOV, aspect, Math.max(0.01 * size, distance - size), distance + 1.5 * size),
			};
		},
		/** The ray through a place of the picture (0 to 1, down): where it starts and where it goes. */
		ray(x, y) {
			const { eye, way, side, up } = look(), wide = tan / Math.min(aspect, 1);
			return { from: eye, way: unit(add(add(way, side, (2 * x - 1) * wide * aspect), up, (1 - 2 * y) * wide)) };
		},
		turn(x, y) {
			turn += camera.hand * x;
			tilt = clamp(tilt + y, -STEEPEST, STEEPEST);
			changed();
		},
		/** Move the target across the picture, in shares of its smaller side. */
		pan(x, y) {
			const { side, up } = look(), s = 2 * distance * tan;
			target = add(add(target, side, -x * s), up, y * s);
			changed();
		},
		zoom(factor) {
			distance = clamp(distance * factor, 0.01 * camera.box.size, 20 * camera.box.size);
			changed();
		},
		/** See everything from where the camera is. */
		fit() {
			target = camera.box.middle;
			distance = (0.5 * camera.box.size) / tan;
			changed();
		},
		/** See everything from one of the six sides, by the index of its letter. */
		standard(index) {
			const { way } = data.axes[index], up = dot(way, top);
			turn = Math.abs(up) > 0.9 ? 0 : Math.atan2(dot(way, right), dot(way, front));
			tilt = clamp(Math.asin(clamp(up, -1, 1)), -STEEPEST, STEEPEST);
			camera.fit();
		},
		/** Look at a place from nearby. */
		visit(place) {
			target = place;
			distance = Math.min(distance, 0.7 * camera.box.size);
			changed();
		},
	};
	camera.setData(data);
	camera.standard(data.patient ? 2 : 3);
	return camera;
}

/** Turn, move and zoom by pointer, wheel and fingers; `clicked` gets a click without a drag. */
export function steerCamera(canvas, camera, clicked) {
	const fingers = new Map();
	let moved = 0;
	function centre() {
		const [[x, y], [u, v] = [x, y]] = fingers.values();
		return [(x + u) / 2, (y + v) / 2, Math.hypot(u - x, v - y)];
	}
	canvas.onpointerdown = (event) => {
		canvas.setPointerCapture(event.pointerId);
		if (!fingers.size) moved = 0;
		fingers.set(event.pointerId, [event.clientX, event.clientY]);
	};
	canvas.onpointermove = (event) => {
		if (!fingers.has(event.pointerId)) return;
		const before = centre();
		fingers.set(event.pointerId, [event.clientX, event.clientY]);
		const now = centre(), x = now[0] - before[0], y = now[1] - before[1], side = Math.min(canvas.clientWidth, canvas.clientHeight);
		moved += Math.abs(x) + Math.abs(y);
		if (fingers.size > 1 || event.shiftKey || event.buttons & 4) camera.pan(x / side, y / side);
		else camera.turn(x * 0.008, y * 0.008);
		if (before[2] && now[2]) camera.zoom(before[2] / now[2]);
	};
	canvas.onpointerup = canvas.onpointercancel = (event) => {
		if (!fingers.delete(event.pointerId) || event.type !== "pointerup" || moved > 4 || fingers.size) return;
		clicked(event.offsetX / canvas.clientWidth, event.offsetY / canvas.clientHeight);
	};
	canvas.onwheel = (event) => {
		event.preventDefault();
		camera.zoom(Math.exp(clamp(event.deltaY, -120, 120) * 0.0015));
	};
}

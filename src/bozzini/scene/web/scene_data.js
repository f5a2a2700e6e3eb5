/** Reads the container that `bozzini.scene.view` writes, and plays a recorded motion. */
import { add, clamp, dot, pointAt, unit } from "./math.js";

const MAGIC = 0x31565a42;

/** Undo the coding of one array: byte planes, folded signs, differences, steps. */
function unpack(bytes, item, Type) {
	const count = item.shape.reduce((a, b) => a * b, 1), row = count / (item.shape[0] || 1);
	const whole = new Int32Array(count);
	for (let plane = 0; plane < item.bytes; plane++) {
		const from = item.at + plane * count;
		for (let i = 0; i < count; i++) whole[i] |= bytes[from + i] << (8 * plane);
	}
	for (let i = 0; i < count; i++) whole[i] = (whole[i] >>> 1) ^ -(whole[i] & 1);
	for (let k = 0; k < item.order; k++) for (let i = row; i < count; i++) whole[i] += whole[i - row];
	const values = new Type(count), low = item.low, width = low ? low.length : 1;
	for (let i = 0; i < count; i++)
		values[i] = whole[i] === item.none ? NaN : whole[i] * item.step + (low ? low[i % width] : 0);
	return values;
}

/** @param {ArrayBuffer} buffer @returns the header with its arrays in place of their descriptions */
export function decodeView(buffer) {
	const [magic, length] = new Uint32Array(buffer, 0, 2);
	if (magic !== MAGIC) throw new Error("this is no view of Bozzini");
	const data = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, length)));
	const bytes = new Uint8Array(buffer, 8 + length);
	for (const item of data.surfaces) {
		item.vertices = unpack(bytes, item.vertices, Float32Array);
		item.faces = unpack(bytes, item.faces, Uint32Array);
	}
	for (const item of data.bodies) {
		item.steps = item.joints.shape[0];
		item.links = item.joints.shape[1] - 1;
		item.joints = unpack(bytes, item.joints, Float32Array);
		item.clearance = item.clearance && unpack(bytes, item.clearance, Float32Array);
	}
	for (const item of data.clouds) item.points = unpack(bytes, item.points, Float32Array);
	for (const item of data.charts) item.values = item.values.map((value) => value ?? NaN);
	data.walls = data.surfaces.filter((item) => item.name !== "introducer");
	data.scope = data.bodies.find((item) => item.role === "scope");
	data.way = data.bodies.find((item) => item.role === "line");
	data.steps = data.scope?.insertion?.length || data.scope?.steps || 1;
	data.tightest = data.marks.find((mark) => mark.kind === "tight")?.step ?? null;
	return data;
}

/** One row of an array that has so many in a row. */
const rowOf = (values, k, width) => values?.subarray(k * width, (k + 1) * width);

/** The joints of a body at a step, as a view of its array. */
export const jointsAt = (body, step) => rowOf(body.joints, Math.min(step, body.steps - 1), 3 * (body.links + 1));

/** The clearances of a body at a step, if it has any. */
export const clearanceAt = (body, step) => rowOf(body.clearance, Math.min(step, body.steps - 1), body.links);

/**
 * The camera at the head. Its upright is carried along the body from the tail: it does not roll.
 */
export function tipCamera(joints, radius, up) {
	let way;
	for (let i = joints.length / 3 - 2; i >= 0; i--) {
		way = unit(add(pointAt(joints, i), pointAt(joints, i + 1), -1));
		if (Math.abs(dot(up, way)) > 0.99) up = [way[1], way[2], way[0]];
		up = unit(add(up, way, -dot(up, way)));
	}
	return { place: add(pointAt(joints, 0), way, radius), way, up };
}

/** The smallest number of an array that may lack some; NaN if there is none. */
export const smallest = (values) =>
	Array.from(values || []).reduce((a, b) => (Number.isFinite(b) && !(b >= a) ? b : a), NaN);

/** Colour of a clearance [mm]; grey where there is none. */
export const clearanceColor = ({ low, high, colors }, value) => Number.isFinite(value)
	? colors[clamp(Math.floor(((value - low) / (high - low)) * colors.length), 0, colors.length - 1)]
	: "#8a96a3";

/** "#rrggbb" as three numbers up to 255. */
export const parseColor = (text) => [1, 3, 5].map((i) => parseInt(text.slice(i, i + 2), 16));

/** A source of frames that plays what is in the file: 12 s for the whole at speed 1. */
export function recordedSource({ scope, steps }) {
	let at = 0, playing = false, speed = 1, then = 0;
	const source = {
		onframe() {},
		seek(step) {
			at = clamp(step, 0, steps - 1);
			const now = Math.round(at);
			source.onframe({ step: now, playing, joints: scope && jointsAt(scope, now), clearance: scope && clearanceAt(scope, now) });
		},
		play(on, factor = 1) {
			speed = factor;
			if (on && !playing) {
				if (at >= steps - 1) at = 0;
				then = performance.now();
				requestAnimationFrame(tick);
			}
			playing = on;
			source.seek(at);
		},
	};
	function tick(now) {
		if (!playing) return;
		const next = at + (Math.max(0, now - then) * speed * steps) / 12000;
		then = now;
		playing = next < steps - 1;
		source.seek(next);
		if (playing) requestAnimationFrame(tick);
	}
	return source;
}

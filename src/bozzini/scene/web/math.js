/** Vectors are arrays of three numbers; matrices are 16 numbers by columns, as WebGL takes them. */
export const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
export const scaled = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const size = (a) => Math.hypot(a[0], a[1], a[2]);
export const gap = (a, b) => size(add(a, b, -1));
export const unit = (a) => scaled(a, 1 / (size(a) || 1));
export const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
export const cross = (a, b) => [
	a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
];

/** Give an object properties, or attributes where it has no such property. */
export function assign(made, props) {
	for (const [key, value] of Object.entries(props)) key in made ? (made[key] = value) : made.setAttribute(key, value);
	return made;
}

/** The i-th point of a flat array. */
export const pointAt = (flat, i) => [flat[3 * i], flat[3 * i + 1], flat[3 * i + 2]];

export function multiply(a, b) {
	const c = new Float32Array(16);
	for (let i = 0; i < 16; i++)
		for (let k = 0; k < 4; k++) c[i] += a[(i % 4) + 4 * k] * b[(i & 12) + k];
	return c;
}

/** Perspective: `fov` is the angle [rad] over the smaller side, so that narrow pages see all. */
export function perspective(fov, aspect, near, far) {
	const y = Math.min(aspect, 1) / Math.tan(fov / 2), depth = 1 / (near - far);
	return [y / aspect, 0, 0, 0, 0, y, 0, 0, 0, 0, (far + near) * depth, -1, 0, 0, 2 * far * near * depth, 0];
}

/** The matrix of a camera at `eye` that looks along `way`; `hand` -1 mirrors, for left-handed worlds. */
export function lookAlong(eye, way, up, hand = 1) {
	const side = scaled(unit(cross(way, up)), hand), top = scaled(cross(side, way), hand);
	const rows = [side, top, scaled(way, -1)], m = new Float32Array(16);
	rows.forEach((row, i) => {
		for (let k = 0; k < 3; k++) m[4 * k + i] = row[k];
		m[12 + i] = -dot(row, eye);
	});
	m[15] = 1;
	return m;
}

/** Where a point is in the picture: x and y from 0 to 1, down; null if it is behind the camera. */
export function place(matrix, p) {
	const c = [0, 1, 3].map((i) => matrix[i] * p[0] + matrix[4 + i] * p[1] + matrix[8 + i] * p[2] + matrix[12 + i]);
	return c[2] > 1e-6 ? [0.5 + (0.5 * c[0]) / c[2], 0.5 - (0.5 * c[1]) / c[2]] : null;
}

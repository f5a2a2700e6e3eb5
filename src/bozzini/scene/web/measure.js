/** Where a ray meets what is shown, and what can be measured there. */
import { add, clamp, cross, dot, gap, pointAt, scaled, unit } from "./math.js";

/** The nearest triangle of a surface on a ray: {far, place, normal outwards}, or null. */
export function pickSurface({ vertices, faces, normals }, { from, way }, clip) {
	let best = null;
	for (let f = 0; f < faces.length; f += 3) {
		const [i, j, k] = faces.subarray(f, f + 3), a = pointAt(vertices, i), u = add(pointAt(vertices, j), a, -1), v = add(pointAt(vertices, k), a, -1);
		const across = cross(way, v), det = dot(u, across), o = add(from, a, -1), s = dot(o, across) / det;
		if (!(s >= 0 && s <= 1)) continue;
		const q = cross(o, u), t = dot(way, q) / det, far = dot(v, q) / det, place = add(from, way, far);
		if (!(t >= 0 && s + t <= 1 && far > 0) || far >= best?.far || (clip && dot(place, clip) > clip[3])) continue;
		// The shading's normal, between those of the corners: a triangle's own is rougher.
		const own = (corner, share) => scaled(pointAt(normals, corner), share);
		best = { far, place, normal: unit(normals ? add(add(own(i, 1 - s - t), own(j, s)), own(k, t)) : cross(u, v)) };
	}
	return best;
}

/** The nearest link of a chain on a ray: {far, link, place on its axis}, or null. */
export function pickLink(joints, radius, ray) {
	let best = null;
	for (let i = 0; i + 1 < joints.length / 3; i++) {
		const a = pointAt(joints, i), u = add(pointAt(joints, i + 1), a, -1), w = add(a, ray.from, -1);
		const uu = dot(u, u), uw = dot(u, ray.way), ua = dot(u, w), wa = dot(ray.way, w);
		const s = clamp((uw * wa - ua) / (uu - uw * uw || 1e-9), 0, 1);
		const place = add(a, u, s), far = dot(add(place, ray.from, -1), ray.way);
		if (far > 0 && gap(add(ray.from, ray.way, far), place) < 1.3 * radius && (!best || far < best.far))
			best = { far, link: i, place };
	}
	return best;
}

/**
 * Radius of the largest ball inside that touches the wall at a place: the least over the vertices q
 * of |q - p|^2 / (2 n (q - p)), n inwards. Within 30 degrees of the tangent plane the roughness of the
 * triangles would count and not the lumen.
 */
export function largestBall({ vertices }, p, inwards) {
	let least = Infinity;
	for (let i = 0; i < vertices.length; i += 3) {
		const way = [vertices[i] - p[0], vertices[i + 1] - p[1], vertices[i + 2] - p[2]], depth = dot(way, inwards), square = dot(way, way);
		if (depth > 0.5 * Math.sqrt(square)) least = Math.min(least, square / (2 * depth));
	}
	return least;
}

/** Arc length along a curve of the place on it that is nearest to a point. */
export function arcLengthAt(curve, point) {
	let along = 0, best = Infinity, found = 0;
	for (let i = 0; i + 1 < curve.length / 3; i++) {
		const a = pointAt(curve, i), u = add(pointAt(curve, i + 1), a, -1), length = Math.sqrt(dot(u, u));
		const s = clamp(dot(add(point, a, -1), u) / (length * length || 1), 0, 1);
		const off = gap(point, add(a, u, s));
		if (off < best) [best, found] = [off, along + s * length];
		along += length;
	}
	return found;
}

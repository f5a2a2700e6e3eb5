/** Where a ray meets what is shown, and what can be measured there. */
import { add, clamp, cross, dot, gap, pointAt, scaled, unit } from "./math.js";

/** The nearest triangle of a surface on a ray: {far, place, normal against the ray}, or null. */
export function pickSurface(surface, ray, clip) {
	const { vertices: v, faces } = surface, [fx, fy, fz] = ray.from, [wx, wy, wz] = ray.way;
	let best = null;
	for (let f = 0; f < faces.length; f += 3) {
		const a = 3 * faces[f], b = 3 * faces[f + 1], c = 3 * faces[f + 2];
		const ux = v[b] - v[a], uy = v[b + 1] - v[a + 1], uz = v[b + 2] - v[a + 2];
		const tx = v[c] - v[a], ty = v[c + 1] - v[a + 1], tz = v[c + 2] - v[a + 2];
		const px = wy * tz - wz * ty, py = wz * tx - wx * tz, pz = wx * ty - wy * tx;
		const det = ux * px + uy * py + uz * pz;
		if (Math.abs(det) < 1e-12) continue;
		const ox = fx - v[a], oy = fy - v[a + 1], oz = fz - v[a + 2];
		const s = (ox * px + oy * py + oz * pz) / det;
		if (s < 0 || s > 1) continue;
		const qx = oy * uz - oz * uy, qy = oz * ux - ox * uz, qz = ox * uy - oy * ux;
		const t = (wx * qx + wy * qy + wz * qz) / det;
		if (t < 0 || s + t > 1) continue;
		const far = (tx * qx + ty * qy + tz * qz) / det;
		if (far <= 0 || (best && far >= best.far)) continue;
		const place = add(ray.from, ray.way, far);
		if (clip && dot(place, clip) > clip[3]) continue;
		// The shading's normal, between those of the corners: a triangle's own is rougher.
		const own = (i) => pointAt(surface.normals, i / 3);
		const normal = surface.normals ? add(add(scaled(own(a), 1 - s - t), own(b), s), own(c), t) : cross([ux, uy, uz], [tx, ty, tz]);
		best = { far, place, normal: unit(normal) };
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
 * of |q - p|^2 / (2 n (q - p)), with n the normal inwards. Vertices less than 30 degrees above the
 * tangent plane are left out: there the roughness of the triangles would count, not the lumen.
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

/** Draws surfaces, chains of capsules and points by WebGL 2: from outside and from the tip. */
import { add, cross, multiply, pointAt, unit } from "./math.js";
import { clearanceColor, parseColor } from "./scene_data.js";

const HEAD = `#version 300 es
precision highp float;
uniform mat4 matrix; uniform vec3 eye, tint; uniform vec4 clip; uniform float radius, opacity;
uniform int mode, lit;
`;
const SURFACE_VERTEX = `${HEAD}layout(location=0) in vec3 place; layout(location=1) in vec3 normal;
out vec3 at, n;
void main() { at = place; n = normal; gl_Position = matrix * vec4(place, 1); }`;
// Modes: 0 glass, denser where it is seen edge-on (lit for a dark ground); 1 solid, for what a section
// opens; 2 wet tissue by a lamp at the tip.
const SURFACE_FRAGMENT = `${HEAD}in vec3 at, n;
out vec4 color;
void main() {
	if (dot(at, clip.xyz) > clip.w) discard;
	float far = distance(eye, at), facing = abs(dot(normalize(n), eye - at)) / far, edge = pow(1.0 - facing, 2.2);
	if (mode == 2) {
		float light = 1.0 / (1.0 + pow(far / radius, 2.0));
		vec3 c = tint * (0.12 + 1.9 * facing) + vec3(0.5, 0.47, 0.45) * pow(facing, 24.0);
		color = vec4(pow(1.0 - exp(-1.5 * light * c), vec3(0.85)), 1);
	} else if (mode == 1 || opacity > 0.99) color = vec4(tint * (0.4 + 0.55 * facing), 1);
	else {
		float alpha = min(opacity * ((lit > 0 ? 0.16 : 0.24) + 1.5 * edge), 0.95);
		color = vec4(mix(tint * (0.55 + 0.45 * facing), lit > 0 ? mix(tint, vec3(1), 0.35) : tint * 0.62, edge) * alpha, alpha);
	}
}`;
const BODY_VERTEX = `${HEAD}layout(location=0) in vec4 ball; layout(location=1) in vec3 a; layout(location=2) in vec3 b;
layout(location=3) in vec4 paint; out vec3 at, n, c;
void main() {
	vec3 z = b - a; float l = length(z); z = l > 0.0 ? z / l : vec3(0, 0, 1);
	vec3 x = normalize(cross(z, abs(z.x) < 0.7 ? vec3(1, 0, 0) : vec3(0, 1, 0)));
	n = ball.x * x + ball.y * cross(z, x) + ball.z * z;
	at = mix(a, b, ball.w) + radius * n;
	c = gl_InstanceID == lit ? mix(paint.rgb, vec3(1), 0.65) : paint.rgb;
	gl_Position = matrix * vec4(at, 1);
}`;
const BODY_FRAGMENT = `${HEAD}in vec3 at, n, c; out vec4 color;
void main() {
	float facing = max(dot(normalize(n), normalize(eye - at)), 0.0);
	color = vec4(c * (0.4 + 0.75 * facing) + 0.25 * pow(facing, 30.0), 1);
}`;

/** A capsule of radius 1: for each vertex its place on the ball, and at which end (0 or 1). */
function makeCapsule(sides = 18, rings = 4) {
	const ball = [], faces = [];
	for (let j = 0; j < 2 * rings + 2; j++) {
		const end = j > rings ? 1 : 0, h = ((j - rings - end) / rings) * (Math.PI / 2);
		for (let k = 0; k <= sides; k++) {
			const t = (2 * Math.PI * k) / sides, i = j * (sides + 1) + k, below = i - sides - 1;
			ball.push(Math.cos(h) * Math.cos(t), Math.cos(h) * Math.sin(t), Math.sin(h), end);
			if (j && k) faces.push(i, below - 1, below, i, i - 1, below - 1);
		}
	}
	return [new Float32Array(ball), new Uint32Array(faces)];
}

/** Normals of vertices by the area of their faces, smoothed over neighbours: for shading. */
function findNormals(vertices, faces) {
	let normals;
	for (let pass = 0; pass < 5; pass++) {
		const next = new Float32Array(vertices.length), from = pass ? normals : vertices;
		for (let f = 0; f < faces.length; f += 3) {
			const corners = faces.subarray(f, f + 3), a = pointAt(from, corners[0]), b = pointAt(from, corners[1]), c = pointAt(from, corners[2]);
			const n = pass ? add(add(a, b), c) : cross(add(b, a, -1), add(c, a, -1));
			for (const i of corners) for (let k = 0; k < 3; k++) next[3 * i + k] += n[k];
		}
		for (let i = 0; i < next.length / 3; i++) next.set(unit(pointAt(next, i)), 3 * i);
		normals = next;
	}
	return normals;
}

/** @returns a renderer on a canvas, or null where the browser has no WebGL 2 */
export function createRenderer(canvas) {
	const gl = canvas.getContext("webgl2");
	if (!gl) return null;
	let programs, surfaces = [], bodies = [];

	function build(vertex, fragment) {
		const program = gl.createProgram();
		for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
			const shader = gl.createShader(kind);
			gl.shaderSource(shader, text);
			gl.compileShader(shader);
			gl.attachShader(program, shader);
		}
		gl.linkProgram(program);
		if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(program));
		for (const name of ["matrix", "eye", "tint", "clip", "radius", "opacity", "mode", "lit"]) program[name] = gl.getUniformLocation(program, name);
		return program;
	}

	function fill(target, values, kind = gl.ARRAY_BUFFER) {
		gl.bindBuffer(kind, target);
		gl.bufferData(kind, values, gl.DYNAMIC_DRAW);
		return target;
	}

	/** Let the bound buffer feed an attribute; `each` 1 is one value an instance. */
	function feed(slot, width, each = 0, from = 0) {
		gl.enableVertexAttribArray(slot);
		gl.vertexAttribPointer(slot, width, slot === 3 ? gl.UNSIGNED_BYTE : gl.FLOAT, slot === 3, 0, from);
		gl.vertexAttribDivisor(slot, each);
	}

	/** Buffers of an item, in a vertex array of their own. */
	function start(item, faces) {
		const array = gl.createVertexArray();
		gl.bindVertexArray(array);
		fill(gl.createBuffer(), faces, gl.ELEMENT_ARRAY_BUFFER);
		return { item, array, count: faces.length, first: gl.createBuffer(), second: gl.createBuffer() };
	}

	function addSurface(item) {
		const made = start(item, item.faces);
		fillSurface(made);
		feed(1, 3);
		gl.bindBuffer(gl.ARRAY_BUFFER, made.first);
		feed(0, 3);
		return made;
	}

	function fillSurface({ item, first, second }) {
		fill(first, item.vertices);
		fill(second, (item.normals = findNormals(item.vertices, item.faces)));
	}

	/** A chain, each link from a joint to the next; or points, each a ball. */
	function addBody(item) {
		const [ball, faces] = makeCapsule(), made = start(item, faces);
		fill(gl.createBuffer(), ball);
		feed(0, 4);
		gl.bindBuffer(gl.ARRAY_BUFFER, made.first);
		feed(1, 3, 1);
		feed(2, 3, 1, item.points ? 0 : 12);
		gl.bindBuffer(gl.ARRAY_BUFFER, made.second);
		feed(3, 4, 1);
		return made;
	}

	function use(program, view, radius, mode) {
		gl.useProgram(program);
		gl.uniformMatrix4fv(program.matrix, false, view.matrix);
		gl.uniform3fv(program.eye, view.eye);
		gl.uniform4fv(program.clip, view.clip || [0, 0, 0, 1]);
		gl.uniform1f(program.radius, radius);
		gl.uniform1i(program.mode, mode);
		return program;
	}

	function drawSurfaces(view, mode, wanted = () => true) {
		const program = use(programs.surface, view, view.reach, mode);
		gl.uniform1i(program.lit, view.dark ? 1 : 0);
		for (const { item, array, count } of surfaces) {
			if (item.hidden || !wanted(item)) continue;
			gl.uniform3fv(program.tint, parseColor(item.color).map((x, i) => (x * (mode === 2 ? [1, 0.78, 0.74][i] : 1)) / 255));
			gl.uniform1f(program.opacity, item.opacity);
			gl.bindVertexArray(array);
			gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 0);
		}
	}

	const renderer = {
		/** Take a view; bodies get their poses by `setPose`. */
		setData(data) {
			programs = { surface: build(SURFACE_VERTEX, SURFACE_FRAGMENT), body: build(BODY_VERTEX, BODY_FRAGMENT) };
			for (const { array } of [...surfaces, ...bodies]) gl.deleteVertexArray(array);
			surfaces = data.surfaces.map(addSurface);
			bodies = [...data.bodies, ...data.clouds].map(addBody);
			data.clouds.forEach((item, i) => renderer.setPose(data.bodies.length + i, item.points));
		},
		/** Put a body where its joints are; `clearance` colours its links, else its own colour does. */
		setPose(index, joints, clearance, scale) {
			const body = bodies[index], paint = [];
			body.links = joints.length / 3 - (body.item.points ? 0 : 1);
			for (let i = 0; i < body.links; i++) paint.push(...parseColor(clearance ? clearanceColor(scale, clearance[i]) : body.item.color), 255);
			fill(body.first, joints);
			fill(body.second, new Uint8Array(paint));
		},
		/** Take the vertices of a surface again. */
		setVertices: (index) => fillSurface(surfaces[index]),
		/** Draw into `box`, [x, y, width, height] in pixels from below; the lamp carries `reach` mm; link `lit` of the first body is brighter. */
		draw(view) {
			view.matrix = multiply(view.projection, view.camera);
			gl.viewport(...view.box);
			gl.scissor(...view.box);
			for (const what of [gl.SCISSOR_TEST, gl.DEPTH_TEST]) gl.enable(what);
			for (const what of [gl.BLEND, gl.CULL_FACE]) gl.disable(what);
			gl.frontFace(view.hand < 0 ? gl.CW : gl.CCW);
			gl.depthMask(true);
			gl.clearColor(...(view.ground || [0, 0, 0, 0]));
			gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
			const glass = (item) => item.opacity <= 0.99;
			drawSurfaces(view, view.inside ? 2 : 0, (item) => view.inside || !glass(item));
			gl.enable(gl.CULL_FACE);
			gl.cullFace(gl.BACK);
			for (const { item, array, count, links } of bodies) {
				if (!(links > 0) || item.hidden || (view.inside && !item.seen)) continue;
				const program = use(programs.body, view, item.radius || 0.003 * view.size, 0);
				gl.uniform1i(program.lit, item === bodies[0].item ? view.lit : -1);
				gl.bindVertexArray(array);
				gl.drawElementsInstanced(gl.TRIANGLES, count, gl.UNSIGNED_INT, 0, links);
			}
			if (view.inside) return;
			gl.cullFace(gl.FRONT);
			if (view.clip) drawSurfaces(view, 1, glass);
			gl.enable(gl.BLEND);
			gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
			gl.depthMask(false);
			if (!view.clip) drawSurfaces(view, 0, glass);
			gl.cullFace(gl.BACK);
			drawSurfaces(view, 0, glass);
		},
	};
	return renderer;
}

/** Draws surfaces, chains of capsules and points by WebGL 2: from outside and from the tip. */
import { cross, multiply } from "./math.js";
import { clearanceColor, parseColor } from "./scene_data.js";

const HEAD = `#version 300 es
precision highp float;
uniform mat4 matrix; uniform vec3 eye; uniform vec4 clip; uniform float radius;
`;
const SURFACE_VERTEX = `${HEAD}
layout(location=0) in vec3 place; layout(location=1) in vec3 normal;
out vec3 at, n;
void main() { at = place; n = normal; gl_Position = matrix * vec4(place, 1.0); }`;
// From outside: glass that is denser where it is seen edge-on. From the tip: wet tissue by a lamp.
const SURFACE_FRAGMENT = `${HEAD}
in vec3 at, n; out vec4 color;
uniform vec3 tint; uniform float opacity, glow; uniform int mode;
void main() {
  if (dot(at, clip.xyz) > clip.w) discard;
  vec3 view = eye - at; float far = length(view); view /= far;
  float facing = abs(dot(normalize(n), view));
  if (mode == 2) {
    float light = 1.0 / (1.0 + pow(far / radius, 2.0));
    vec3 c = tint * (0.12 + 1.9 * facing) * light + vec3(1.0, 0.95, 0.9) * pow(facing, 24.0) * 0.5 * light;
    color = vec4(pow(1.0 - exp(-1.5 * c), vec3(0.85)), 1.0);
    return;
  }
  float edge = pow(1.0 - facing, 2.2);
  if (mode == 1 || opacity > 0.99) { color = vec4(tint * (mode == 1 ? 0.45 + 0.5 * facing : 0.35 + 0.65 * facing), 1.0); return; }
  float alpha = clamp(opacity * (glow > 0.5 ? 0.16 : 0.24) + opacity * 1.5 * edge, 0.0, 0.95);
  vec3 c = mix(tint * (0.55 + 0.45 * facing), glow > 0.5 ? mix(tint, vec3(1.0), 0.35) : tint * 0.62, edge);
  color = vec4(c * alpha, alpha);
}`;
const BODY_VERTEX = `${HEAD}
layout(location=0) in vec4 ball; layout(location=1) in vec3 a; layout(location=2) in vec3 b;
layout(location=3) in vec4 paint;
uniform int lit; out vec3 at, n, c;
void main() {
  vec3 z = b - a; float l = length(z); z = l > 0.0 ? z / l : vec3(0, 0, 1);
  vec3 x = normalize(cross(z, abs(z.x) < 0.7 ? vec3(1, 0, 0) : vec3(0, 1, 0))), y = cross(z, x);
  n = ball.x * x + ball.y * y + ball.z * z;
  at = mix(a, b, ball.w) + radius * n;
  c = gl_InstanceID == lit ? mix(paint.rgb, vec3(1), 0.65) : paint.rgb;
  gl_Position = matrix * vec4(at, 1.0);
}`;
const BODY_FRAGMENT = `${HEAD}
in vec3 at, n, c; out vec4 color;
void main() {
  vec3 view = normalize(eye - at), m = normalize(n);
  float facing = max(dot(m, view), 0.0);
  color = vec4(c * (0.4 + 0.75 * facing) + 0.25 * pow(facing, 30.0), 1.0);
}`;
const CLOUD_VERTEX = `${HEAD}
layout(location=0) in vec3 place; out vec3 at;
void main() { at = place; gl_Position = matrix * vec4(place, 1.0); gl_PointSize = clamp(radius / gl_Position.w, 1.5, 9.0); }`;
const CLOUD_FRAGMENT = `${HEAD}
in vec3 at; uniform vec3 tint; out vec4 color;
void main() { if (length(gl_PointCoord - 0.5) > 0.5) discard; color = vec4(tint, 1.0); }`;

/** A capsule of radius 1: for each vertex its place on the ball, and at which end (0 or 1). */
function makeCapsule(sides = 20, rings = 5) {
  const rows = [];
  for (let end = 0; end < 2; end++)
    for (let i = 0; i <= rings; i++) {
      const h = (Math.PI / 2) * (end ? i / rings : i / rings - 1);
      rows.push([Math.cos(h), Math.sin(h), end]);
    }
  const ball = [], faces = [];
  rows.forEach(([r, z, end], j) => {
    for (let k = 0; k <= sides; k++) {
      const t = (2 * Math.PI * k) / sides, i = j * (sides + 1) + k;
      ball.push(r * Math.cos(t), r * Math.sin(t), z, end);
      if (j && k) faces.push(i, i - sides - 2, i - sides - 1, i, i - 1, i - sides - 2);
    }
  });
  return [new Float32Array(ball), new Uint16Array(faces)];
}

/** Normals of vertices, weighted by the area of their faces and smoothed over neighbours: for shading. */
export function findNormals(v, faces) {
  let normals = new Float32Array(v.length);
  for (let pass = 0; pass < 4; pass++) {
    const next = new Float32Array(v.length);
    for (let f = 0; f < faces.length; f += 3) {
      const corners = [3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]], [a, b, c] = corners;
      let n;
      if (pass) n = [0, 1, 2].map((k) => normals[a + k] + normals[b + k] + normals[c + k]);
      else {
        const edge = (i) => [v[i] - v[a], v[i + 1] - v[a + 1], v[i + 2] - v[a + 2]];
        n = cross(edge(b), edge(c));
      }
      for (const i of corners) for (let k = 0; k < 3; k++) next[i + k] += n[k];
    }
    for (let i = 0; i < next.length; i += 3) {
      const s = 1 / (Math.hypot(next[i], next[i + 1], next[i + 2]) || 1);
      for (let k = 0; k < 3; k++) next[i + k] *= s;
    }
    normals = next;
  }
  return normals;
}

/**
 * @param {HTMLCanvasElement} canvas
 * @returns a renderer, or null where the browser has no WebGL 2
 */
export function createRenderer(canvas) {
  const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: true });
  if (!gl) return null;
  let programs, capsule, surfaces = [], bodies = [], clouds = [];

  function build(vertex, fragment) {
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
      throw new Error(gl.getProgramInfoLog(program) || "the shaders of the page do not link");
    const find = {};
    for (const name of ["matrix", "eye", "clip", "radius", "tint", "opacity", "glow", "mode", "lit"])
      find[name] = gl.getUniformLocation(program, name);
    return { program, find };
  }

  /** A buffer; with `slot` it feeds that attribute of the bound vertex array. */
  function buffer(values, slot, width, stride = 0, offset = 0, each = 0) {
    const made = values instanceof WebGLBuffer ? values : gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, made);
    if (made !== values) gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(slot);
    gl.vertexAttribPointer(slot, width, slot === 3 ? gl.UNSIGNED_BYTE : gl.FLOAT, slot === 3, stride, offset);
    gl.vertexAttribDivisor(slot, each);
    return made;
  }

  function indices(values) {
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, values, gl.STATIC_DRAW);
    return values.length;
  }

  function array() {
    const made = gl.createVertexArray();
    gl.bindVertexArray(made);
    return made;
  }

  function start() {
    programs = {
      surface: build(SURFACE_VERTEX, SURFACE_FRAGMENT),
      body: build(BODY_VERTEX, BODY_FRAGMENT),
      cloud: build(CLOUD_VERTEX, CLOUD_FRAGMENT),
    };
    capsule = makeCapsule();
  }

  function addBody(item) {
    const body = { item, array: array(), links: 0, lit: -1, shown: true };
    buffer(capsule[0], 0, 4);
    body.joints = buffer(new Float32Array(6), 1, 3, 12, 0, 1);
    buffer(body.joints, 2, 3, 12, 12, 1);
    body.paint = buffer(new Uint8Array(4), 3, 4, 0, 0, 1);
    body.count = indices(capsule[1]);
    return body;
  }

  function use(name, view, radius) {
    const { program, find } = programs[name];
    gl.useProgram(program);
    gl.uniformMatrix4fv(find.matrix, false, view.matrix);
    gl.uniform3fv(find.eye, view.eye);
    gl.uniform4fv(find.clip, view.clip || [0, 0, 0, 1]);
    gl.uniform1f(find.radius, radius);
    return find;
  }

  function drawSurfaces(view, mode, which) {
    const find = use("surface", view, view.reach);
    gl.uniform1i(find.mode, mode);
    gl.uniform1f(find.glow, view.dark ? 1 : 0);
    for (const { item, array, count } of surfaces) {
      const solid = item.opacity > 0.99;
      if (item.hidden || (which && (which === "solid") !== solid)) continue;
      const tint = parseColor(item.color).map((x) => x / 255);
      gl.uniform3fv(find.tint, mode === 2 && !solid ? tint.map((x, i) => x * [1, 0.78, 0.74][i]) : tint);
      gl.uniform1f(find.opacity, item.opacity);
      gl.bindVertexArray(array);
      gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 0);
    }
  }

  const renderer = {
    gl,
    /** Take the surfaces, bodies and points of a view; poses come by `setPose`. */
    setData(data) {
      for (const item of [...surfaces, ...bodies, ...clouds]) gl.deleteVertexArray(item.array);
      surfaces = data.surfaces.map((item) => {
        const made = { item, array: array() };
        made.vertices = buffer(item.vertices, 0, 3);
        made.normals = buffer((item.normals = findNormals(item.vertices, item.faces)), 1, 3);
        made.count = indices(item.faces);
        return made;
      });
      // One more than the data have: a backbone that arrives with the frames.
      bodies = [...data.bodies, { color: "#f2b84b", radius: data.scope?.radius || 1 }].map(addBody);
      clouds = data.clouds.map((item) => {
        const made = { item, array: array() };
        buffer(item.points, 0, 3);
        return made;
      });
    },
    /** Put a body where its joints are; `clearance` colours its links, else its own colour does. */
    setPose(index, joints, clearance, scale) {
      const body = bodies[index], plain = body.item.color;
      body.links = joints.length / 3 - 1;
      const paint = new Uint8Array(4 * body.links);
      for (let i = 0; i < body.links; i++) paint.set([...parseColor(clearance ? clearanceColor(scale, clearance[i]) : plain), 255], 4 * i);
      for (const [target, values] of [[body.joints, joints], [body.paint, paint]]) {
        gl.bindBuffer(gl.ARRAY_BUFFER, target);
        gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
      }
    },
    setVertices(index, vertices) {
      const { item, vertices: target, normals } = surfaces[index];
      item.vertices = vertices;
      item.normals = findNormals(vertices, item.faces);
      for (const [to, values] of [[target, vertices], [normals, item.normals]]) {
        gl.bindBuffer(gl.ARRAY_BUFFER, to);
        gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
      }
    },
    /** Show a link of a body brighter; -1 none. */
    light(index, link) {
      if (bodies[index]) bodies[index].lit = link;
    },
    /**
     * Draw one picture.
     * @param view {box: [x, y, width, height] in pixels from below, projection, camera, eye, clip,
     *   inside: from the tip, reach: how far its lamp carries [mm], ground: a colour, hand, dark}
     */
    draw(view) {
      view.matrix = multiply(view.projection, view.camera);
      gl.viewport(...view.box);
      gl.scissor(...view.box);
      gl.enable(gl.SCISSOR_TEST);
      gl.enable(gl.DEPTH_TEST);
      gl.frontFace(view.hand < 0 ? gl.CW : gl.CCW);
      gl.disable(gl.BLEND);
      gl.disable(gl.CULL_FACE);
      gl.depthMask(true);
      gl.clearColor(...(view.ground || [0, 0, 0, 0]));
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      if (view.inside) return drawSurfaces(view, 2);
      drawSurfaces(view, 0, "solid");
      gl.enable(gl.CULL_FACE);
      gl.cullFace(gl.BACK);
      for (const body of bodies) {
        if (!body.links || body.item.hidden) continue;
        const find = use("body", view, body.item.radius);
        gl.uniform1i(find.lit, body.lit);
        gl.bindVertexArray(body.array);
        gl.drawElementsInstanced(gl.TRIANGLES, body.count, gl.UNSIGNED_SHORT, 0, body.links);
      }
      for (const { item, array } of clouds) {
        if (item.hidden) continue;
        const find = use("cloud", view, 0.006 * view.size * view.box[3]);
        gl.uniform3fv(find.tint, parseColor(item.color).map((x) => x / 255));
        gl.bindVertexArray(array);
        gl.drawArrays(gl.POINTS, 0, item.points.length / 3);
      }
      gl.cullFace(gl.FRONT);
      if (view.clip) drawSurfaces(view, 1, "glass");
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      gl.depthMask(false);
      if (!view.clip) drawSurfaces(view, 0, "glass");
      gl.cullFace(gl.BACK);
      drawSurfaces(view, 0, "glass");
      gl.depthMask(true);
    },
    restart: start,
  };
  start();
  return renderer;
}

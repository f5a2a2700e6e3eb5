/** The camera outside: it turns about a target, stays upright in the patient, and glides. */
import { add, clamp, cross, dot, lookAlong, mix, perspective, scaled, unit } from "./math.js";

const FOV = 0.6;
const NEVER_UPRIGHT = Math.PI / 2 - 0.01;

/** Lowest and highest corner of everything in a view. */
export function findBox(data) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  const take = (flat) => {
    for (let i = 0; i < flat.length; i++) {
      low[i % 3] = Math.min(low[i % 3], flat[i]);
      high[i % 3] = Math.max(high[i % 3], flat[i]);
    }
  };
  for (const item of data.surfaces) take(item.vertices);
  for (const item of data.clouds) take(item.points);
  if (!data.surfaces.length) for (const item of data.bodies) take(item.joints);
  return { low, high, middle: mix(low, high, 0.5), size: Math.hypot(...add(high, low, -1)) || 1 };
}

/** @param {() => void} changed called when the camera has moved */
export function createCamera(data, changed) {
  let box, front, right, top, hand, glide = null, aspect = 1;
  const at = { target: [0, 0, 0], distance: 1, turn: 0, tilt: 0 };
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const eyeWay = () => {
    const flat = add(scaled(front, Math.cos(at.turn)), right, Math.sin(at.turn));
    return add(scaled(flat, Math.cos(at.tilt)), top, Math.sin(at.tilt));
  };

  const whole = () => ({ target: box.middle, distance: (0.5 * box.size) / Math.tan(FOV / 2) });

  /** Go to other values, at once or in a third of a second. */
  function go(to, slow = true) {
    if (to.turn !== undefined) {
      const round = 2 * Math.PI;
      to.turn -= round * Math.round((to.turn - at.turn) / round);
    }
    if (!slow || still.matches) {
      glide = null;
      Object.assign(at, to);
      changed();
      return;
    }
    const from = { ...at }, begin = performance.now(), mine = (glide = {});
    const tick = (now) => {
      if (glide !== mine) return;
      const f = clamp((now - begin) / 350, 0, 1), s = f * f * (3 - 2 * f);
      for (const key of Object.keys(to))
        at[key] = key === "target" ? mix(from.target, to.target, s) : from[key] + s * (to[key] - from[key]);
      changed();
      if (f < 1) requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  const camera = {
    at,
    /** The six directions of the view: the first two letters of an axis belong together. */
    setData(next) {
      data = next;
      box = findBox(data);
      [right, front, top] = (data.patient ? [0, 2, 4] : [1, 3, 4]).map((i) => data.axes[i].way);
      hand = Math.sign(dot(cross(right, front), top)) || 1;
    },
    setAspect(value) {
      aspect = value;
    },
    get box() {
      return box;
    },
    get hand() {
      return hand;
    },
    get eye() {
      return add(at.target, eyeWay(), at.distance);
    },
    /** What the renderer needs of the camera. */
    look() {
      const eye = camera.eye, way = scaled(eyeWay(), -1), near = Math.max(0.01 * box.size, at.distance - box.size);
      return {
        eye, hand, size: box.size,
        camera: lookAlong(eye, way, top, hand),
        projection: perspective(FOV, aspect, near, at.distance + 1.5 * box.size),
      };
    },
    /** The ray through a place of the picture (0 to 1, down): where it starts and where it goes. */
    ray(x, y) {
      const way = scaled(eyeWay(), -1), side = scaled(unit(cross(way, top)), hand), up = scaled(cross(side, way), hand);
      const tan = Math.tan(FOV / 2) / Math.min(aspect, 1);
      return { from: camera.eye, way: unit(add(add(way, side, (2 * x - 1) * tan * aspect), up, (1 - 2 * y) * tan)) };
    },
    turn(x, y) {
      go({ turn: at.turn + hand * x, tilt: clamp(at.tilt + y, -NEVER_UPRIGHT, NEVER_UPRIGHT) }, false);
    },
    /** Move the target across the picture, in shares of its smaller side. */
    pan(x, y) {
      const way = scaled(eyeWay(), -1), side = scaled(unit(cross(way, top)), hand), s = 2 * at.distance * Math.tan(FOV / 2);
      go({ target: add(add(at.target, side, -x * s), scaled(cross(side, way), hand), y * s) }, false);
    },
    zoom(factor) {
      go({ distance: clamp(at.distance * factor, 0.01 * box.size, 20 * box.size) }, false);
    },
    /** See everything from where the camera is. */
    fit(slow = true) {
      go(whole(), slow);
    },
    /** See everything from one of the six sides, by the index of its letter. */
    standard(index, slow = true) {
      const way = data.axes[index].way, tilt = Math.asin(clamp(dot(way, top), -1, 1));
      const turn = Math.abs(tilt) > 1.5 ? 0 : Math.atan2(dot(way, right), dot(way, front));
      go({ turn, tilt: clamp(tilt, -NEVER_UPRIGHT, NEVER_UPRIGHT), ...whole() }, slow);
    },
    /** Look at a place from nearby. */
    visit(place) {
      go({ target: place, distance: Math.min(at.distance, 0.35 * box.size) });
    },
  };
  camera.setData(data);
  camera.standard(data.patient ? 2 : 3, false);
  return camera;
}

/** Turn, move and zoom by pointer, wheel and fingers; `clicked` gets a click without a drag. */
export function steerCamera(canvas, camera, clicked) {
  const fingers = new Map();
  let moved = 0;
  const centre = () => {
    const all = [...fingers.values()], n = all.length;
    const x = all.reduce((s, p) => s + p[0], 0) / n, y = all.reduce((s, p) => s + p[1], 0) / n;
    return [x, y, n > 1 ? Math.hypot(all[0][0] - all[1][0], all[0][1] - all[1][1]) : 0];
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (fingers.size === 1) moved = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    const before = centre();
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    const now = centre(), x = now[0] - before[0], y = now[1] - before[1];
    const side = Math.min(canvas.clientWidth, canvas.clientHeight) || 1;
    moved += Math.abs(x) + Math.abs(y);
    if (fingers.size > 1) {
      camera.pan(x / side, y / side);
      if (before[2] && now[2]) camera.zoom(before[2] / now[2]);
    } else if (event.shiftKey || event.buttons & 6) camera.pan(x / side, y / side);
    else camera.turn(x * 0.008, y * 0.008);
  });
  const release = (event) => {
    if (!fingers.delete(event.pointerId) || event.type !== "pointerup" || moved > 4 || fingers.size) return;
    const box = canvas.getBoundingClientRect();
    clicked((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    camera.zoom(Math.exp(clamp(event.deltaY, -120, 120) * 0.0015));
  }, { passive: false });
}

/** The page round the pictures: controls, charts, measuring, keyboard and words for screen readers. */
import { add, dot, gap, lookAlong, multiply, perspective, place, pointAt, scaled } from "./math.js";
import { clearanceAt, decodeView, jointsAt, recordedSource, smallest, tipCamera } from "./scene_data.js";
import { createRenderer } from "./renderer.js";
import { createCamera, steerCamera } from "./camera.js";
import { chartColor, drawChart, indexUnder, show } from "./charts.js";
import { arcLengthAt, largestBall, pickLink, pickSurface } from "./measure.js";

const SPEEDS = [0.25, 0.5, 1, 2, 4];
const NAMES = { R: "right", L: "left", A: "front", P: "back", S: "head", I: "feet" };
const KEYS = [
  ["Space", "play or pause"], [", .", "a step back, a step on"], ["Home End", "first and last step"],
  ["N", "the tightest place"], ["1 to 6", "standard views"], ["F", "see everything"], ["T", "from the tip"],
  ["M", "measure; Enter takes the place under the cross"], ["X", "section through the organ"],
  ["B", "light or dark"], ["Arrows", "turn the picture, with Shift move it"], ["+ \u2212", "nearer, farther"],
];

/** Make an element: properties, then children. */
export function make(tag, props = {}, ...children) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(props))
    if (key in made && key !== "list") made[key] = value;
    else made.setAttribute(key, value);
  made.append(...children);
  return made;
}

// The name space comes from a parser, so that no address stands in a page that loads nothing.
const SVG = new DOMParser().parseFromString("<svg>", "text/html").querySelector("svg").namespaceURI;
const svg = (tag, props) => {
  const made = document.createElementNS(SVG, tag);
  for (const [key, value] of Object.entries(props)) made.setAttribute(key, value);
  return made;
};

const button = (text, title, onclick, more = {}) => make("button", { type: "button", title, onclick, ...more }, text);

/**
 * Fill `root` with a viewer of `data` (see `decodeView`), played by `source`
 * ({kind, seek(step), play(on, speed)}, and `onframe` if it is recorded).
 */
export function createViewer(root, data, source) {
  let frame = { step: 0, joints: null, clearance: null }, inside = false, measuring = false, playing = false;
  let speed = 1, section = null, picks = [], lit = -1, planned = false, series = [], cursors = [], along = null;
  let cross = false, renderer = null, clip = null, viewer = null;

  // The page.
  const canvas = make("canvas", { tabIndex: 0, role: "application" });
  const overlay = svg("svg", { "aria-hidden": "true" });
  const said = make("div", { className: "said", role: "status", "aria-live": "polite" });
  const trouble = make("div", { className: "trouble", hidden: true, "aria-live": "assertive" });
  const title = make("h2"), readout = make("p", { className: "readout" });
  const tipBox = button("", "See from the tip (T)", () => setInside(!inside), { className: "inset" });
  const tools = make("div", { className: "tools", role: "toolbar", "aria-label": "Views" });
  const legend = make("div", { className: "legend" });
  const stage = make("div", { className: "stage" }, canvas, overlay, make("div", { className: "head" }, title, readout), tools, legend, tipBox, trouble);
  const slider = make("input", { type: "range", min: 0, value: 0, step: 1, "aria-label": "Step of the insertion" });
  const playButton = button("\u25b6", "Play (Space)", () => play(!playing), { className: "play" });
  const pace = make("select", { title: "Speed", "aria-label": "Speed" }, ...SPEEDS.map((k) => make("option", { value: k, selected: k === 1 }, `${k}\u00d7`.replace("0.", "."))));
  const tightButton = button("Tightest", "Go to the tightest place (N)", () => goTightest());
  const timeline = make("div", { className: "timeline" }, playButton, slider, pace, tightButton);
  const charts = make("section", { "aria-label": "Charts" }), places = make("section", { "aria-label": "Places" });
  const measureButton = button("Measure", "Measure on the wall (M)", () => setMeasuring(!measuring), { ariaPressed: "false" });
  const measured = make("div", { className: "measured" });
  const planes = make("select", { "aria-label": "Section" }), depth = make("input", { type: "range", min: 0, max: 1, step: 0.005, value: 0.5, "aria-label": "Place of the section" });
  const shown = make("div", { className: "shown" }), notes = make("section", { "aria-label": "Notes" });
  const panel = make("aside", { className: "panel", "aria-label": "Values and tools" }, charts, places,
    make("section", {}, make("h3", {}, "Measure"), measureButton, measured),
    make("section", {}, make("h3", {}, "Section"), make("div", { className: "row" }, planes, depth)),
    make("section", {}, make("h3", {}, "Shown"), shown), notes,
    make("details", {}, make("summary", {}, "Keys"), make("dl", {}, ...KEYS.flatMap(([key, what]) => [make("dt", {}, key), make("dd", {}, what)]))));
  root.classList.add("bozzini");
  root.replaceChildren(stage, panel, timeline, said);

  try {
    renderer = createRenderer(canvas);
    if (!renderer) fail("This browser has no WebGL 2, so there is no picture. Slider, charts and values work.");
  } catch (error) {
    fail(`The picture cannot be drawn: ${error.message}`);
  }

  function fail(text) {
    trouble.textContent = text;
    trouble.hidden = !text;
    if (text) viewer?.say(text);
  }

  const camera = createCamera(data, () => paint());
  steerCamera(canvas, camera, (x, y) => click(x, y));

  // Pictures.
  const night = matchMedia("(prefers-color-scheme: dark)");
  const isDark = () => (root.dataset.theme || (night.matches ? "dark" : "light")) === "dark";

  function paint() {
    if (!planned) requestAnimationFrame(draw);
    planned = true;
  }

  function tipView(box) {
    const { joints } = frame, radius = data.scope?.radius;
    const eye = frame.camera || (joints && joints.length > 3 && tipCamera(joints, radius, data.axes[4].way));
    return eye && {
      box, eye: eye.place, inside: true, hand: camera.hand, reach: 6 * radius, ground: [0.02, 0.01, 0.01, 1],
      camera: lookAlong(eye.place, eye.way, eye.up, camera.hand),
      projection: perspective(1.75, box[2] / box[3], 0.05 * radius, 2 * camera.box.size),
    };
  }

  function outsideView(box) {
    camera.setAspect(box[2] / box[3]);
    return { ...camera.look(), box, clip, dark: isDark() };
  }

  function draw() {
    planned = false;
    viewer.paints++;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const w = Math.round(canvas.clientWidth * ratio), h = Math.round(canvas.clientHeight * ratio);
    if (!w || !h) return;
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    const full = [0, 0, w, h], outside = outsideView(full);
    if (renderer && !renderer.gl.isContextLost()) {
      renderer.draw((inside && tipView(full)) || outside);
      if (!tipBox.hidden) {
        const box = tipBox.getBoundingClientRect(), all = canvas.getBoundingClientRect();
        const small = [box.left - all.left, all.bottom - box.bottom, box.width, box.height].map((v) => Math.round(v * ratio));
        const view = inside ? { ...outsideView(small), ground: isDark() ? [0.06, 0.09, 0.13, 1] : [0.97, 0.98, 0.99, 1] } : tipView(small);
        if (view) renderer.draw(view);
        camera.setAspect(w / h);
      }
    }
    drawOverlay(outside);
  }

  /** Labels, measured places and the patient's axes, over the picture. */
  function drawOverlay(view) {
    const w = canvas.clientWidth, h = canvas.clientHeight, items = [], m = view.camera;
    const matrix = multiply(view.projection, m);
    const spot = (p) => (([x, y]) => [x * w, y * h])(place(matrix, p) || [-9, -9]);
    const text = (words, x, y, kind) => {
      const made = svg("text", { x, y, class: kind });
      made.textContent = words;
      items.push(made);
    };
    const used = [];
    const label = (p, words, kind) => {
      const [x, y] = spot(p), left = used.some(([u, v]) => Math.abs(y - v) < 14 && Math.abs(x - u) < 120);
      used.push([x, y]);
      items.push(svg("circle", { cx: x, cy: y, r: 4.5, class: kind }));
      text(words, left ? x - 9 : x + 9, y + 4, left ? "left" : "");
    };
    overlay.setAttribute("viewBox", `0 0 ${w} ${h}`);
    if (!inside) {
      data.marks.forEach((mark) => label(mark.place, mark.text, mark.kind));
      const [a, b] = picks.map((pick) => spot(pick.place));
      if (b) items.push(svg("path", { d: `M${a}L${b}`, class: "ruler" }));
      picks.forEach((pick, i) => label(pick.place, "AB"[i], "pick"));
      if (cross) items.push(svg("path", { d: `M${w / 2 - 12} ${h / 2}h24m-12 -12v24`, class: "cross" }));
      data.axes
        .map(({ letter, way }) => ({ letter, at: [0, 1, 2].map((i) => dot([m[i], m[4 + i], m[8 + i]], way)) }))
        .sort((one, other) => one.at[2] - other.at[2])
        .forEach(({ letter, at: [x, y, z] }) => {
          const kind = z < -0.05 ? "axis faint" : "axis", [u, v] = [46, h - 46];
          items.push(svg("path", { d: `M${u} ${v}l${26 * x} ${-26 * y}`, class: kind }));
          text(letter, u + 37 * x, v - 37 * y + 4, kind);
        });
    }
    overlay.replaceChildren(...items);
  }

  // What is shown at a step.
  function setFrame(next) {
    viewer.frames++;
    frame = { ...frame, ...next };
    if (next.playing !== undefined) setPlaying(next.playing);
    const { step, joints, clearance } = frame;
    data.bodies.forEach((body, i) => {
      if (body === data.scope) joints && renderer?.setPose(i, joints, clearance, data.scale);
      else if (body.steps > 1) renderer?.setPose(i, jointsAt(body, step), clearanceAt(body, step), data.scale);
    });
    if (next.backbone?.length > 3) renderer?.setPose(data.bodies.length, next.backbone);
    slider.value = step;
    const depth = data.scope?.insertion?.[step], least = smallest(clearance);
    const words = [depth === undefined ? "" : `${show(depth)} mm in`, Number.isFinite(least) ? `clearance ${show(least, 2)} mm` : clearance ? "all in the introducer" : "", data.steps > 1 ? `step ${step + 1} of ${data.steps}` : ""].filter(Boolean);
    readout.replaceChildren(...words.map((word) => make("span", {}, word)));
    readout.classList.toggle("through", least < 0);
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
    source.play(on, speed);
  }

  function setPlaying(on) {
    playing = on;
    playButton.textContent = on ? "\u275a\u275a" : "\u25b6";
    playButton.title = on ? "Pause (Space)" : "Play (Space)";
    playButton.setAttribute("aria-label", on ? "Pause" : "Play");
  }

  function seek(step) {
    if (playing) play(false);
    source.seek(Math.min(Math.max(step, 0), data.steps - 1));
  }

  function goTightest() {
    const step = data.tightest;
    if (step === null) return;
    seek(step);
    viewer.say(`Tightest: ${slider.getAttribute("aria-valuetext")}`);
  }

  function setInside(on) {
    if (tipBox.hidden) return;
    inside = on;
    root.classList.toggle("inside", on);
    tipBox.title = on ? "See from outside (T)" : "See from the tip (T)";
    tipBox.setAttribute("aria-label", tipBox.title);
    viewer.say(on ? "From the tip, by its lamp." : "From outside.");
    paint();
  }

  function setSection(index) {
    section = index;
    planes.value = index ?? "";
    depth.disabled = index === null;
    const { low, high } = camera.box, way = index !== null && data.axes[index].way;
    if (way) {
      const ends = [dot(low, way), dot(high, way)].sort((a, b) => a - b);
      clip = [...way, ends[0] + Number(depth.value) * (ends[1] - ends[0])];
    } else clip = null;
    paint();
  }

  // Measuring.
  function setMeasuring(on) {
    measuring = on;
    cross = false;
    picks = [];
    measureButton.setAttribute("aria-pressed", on);
    canvas.classList.toggle("measuring", on);
    showMeasured();
    if (on) viewer.say("Click the wall, or turn it under the cross and press Enter.");
    paint();
  }

  function pickWall(ray) {
    const found = data.surfaces.flatMap((surface, index) => {
      const hit = surface.hidden ? null : pickSurface(surface, ray, clip);
      return hit ? [{ ...hit, surface: index }] : [];
    });
    return found.sort((a, b) => a.far - b.far)[0] || null;
  }

  function click(x, y) {
    if (inside) return;
    const ray = camera.ray(x, y), wall = pickWall(ray);
    if (measuring && wall) {
      const surface = data.surfaces[wall.surface];
      wall.radius = largestBall(surface, wall.place, scaled(wall.normal, -1));
      wall.arc = data.way ? arcLengthAt(data.way.joints, wall.place) : NaN;
      picks = picks.length === 2 ? [wall] : [...picks, wall];
      showMeasured();
      paint();
      return;
    }
    const hit = frame.joints && pickLink(frame.joints, data.scope.radius, ray);
    if (hit) lightLink(hit.link);
    else if (wall && viewer.onpick) viewer.onpick(wall);
    else lightLink(-1);
  }

  function showMeasured() {
    const [a, b] = picks, rows = [];
    const row = (name, value, digits = 1) => Number.isFinite(value) && rows.push(make("dt", {}, name), make("dd", {}, `${show(value, digits)} mm`));
    picks.forEach((pick, i) => {
      row(`Radius at ${"AB"[i]}`, pick.radius);
      row(`Arc length of ${"AB"[i]}`, pick.arc);
    });
    if (b) {
      row("Distance A to B", gap(a.place, b.place), 2);
      row("Arc length A to B", Math.abs(b.arc - a.arc));
    }
    const hint = measuring ? "Click two places of the wall. The radius is that of the largest ball inside that touches there." : "";
    measured.replaceChildren(rows.length ? make("dl", {}, ...rows) : hint);
    if (rows.length) viewer.say(rows.map((item) => item.textContent).join(" "));
  }

  function lightLink(link) {
    lit = link;
    renderer?.light(data.bodies.indexOf(data.scope), link);
    const value = frame.clearance?.[link];
    if (along) along.value.textContent = link < 0 ? "" : `link ${link + 1}: ${show(value ?? NaN, 2)}`;
    if (link >= 0) viewer.say(`Link ${link + 1} from the head${Number.isFinite(value) ? `: clearance ${show(value, 2)} mm` : ", in the introducer"}.`);
    drawAlong();
    paint();
  }

  // The panel.
  function figure(name, unit, onpick) {
    const area = make("canvas", { role: "img", "aria-label": name }), cursor = make("i", { className: "cursor" }), value = make("b");
    const box = make("figure", {}, make("figcaption", {}, `${name} [${unit}]`, value), make("div", {}, area, cursor));
    area.addEventListener("pointerdown", (event) => {
      area.setPointerCapture(event.pointerId);
      onpick(event);
    });
    area.addEventListener("pointermove", (event) => event.buttons && onpick(event));
    return { box, area, cursor, value };
  }

  function fillPanel() {
    const { scope } = data, over = scope?.insertion || Array.from({ length: data.steps }, (_, i) => i);
    series = data.steps < 2 ? [] : data.charts.map((chart) => {
      const item = { chart: { ...chart, over, overUnit: scope?.insertion ? "mm in" : "steps", color: chartColor(data, chart.kind) }, x: () => 0 };
      if (chart.kind === "clearance") item.chart.high = 1.6 * data.scale.high;
      return Object.assign(item, figure(chart.name, chart.unit, (event) => seek(indexUnder(item.area, item.chart, event))));
    });
    along = scope?.clearance ? figure("clearance along the body", "mm", (event) => lightLink(indexUnder(along.area, along.chart, event))) : null;
    charts.replaceChildren(...[...series, ...(along ? [along] : [])].map((item) => item.box));
    const go = (mark) => () => {
      if (mark.step !== null) seek(mark.step);
      setInside(false);
      camera.visit(mark.place);
    };
    places.replaceChildren(...(data.marks.length ? [make("h3", {}, "Places"), make("div", { className: "row" }, ...data.marks.map((mark) => button(mark.text, "Go there", go(mark), { className: mark.kind })))] : []));
    const side = (i) => data.patient ? NAMES[data.axes[i].letter] : data.axes[i].letter;
    planes.replaceChildren(make("option", { value: "" }, "none"), ...data.axes.map((_, i) => make("option", { value: i }, `without ${side(i)}`)));
    tools.replaceChildren(
      ...data.axes.map(({ letter }, i) => button(letter, `From ${data.patient ? "the " : ""}${side(i)} (${i + 1})`, () => (setInside(false), camera.standard(i)))),
      button("Fit", "See everything (F)", () => camera.fit()),
      button("\u25d0", "Light or dark (B)", () => turnTheme(), { ariaLabel: "Light or dark" }),
    );
    shown.replaceChildren(...[...data.surfaces, ...data.bodies, ...data.clouds].map((item) => make("label", {}, make("input", { type: "checkbox", checked: !item.hidden, onchange: (event) => ((item.hidden = !event.target.checked), paint()) }), item.name)));
    const wall = data.surfaces.find((item) => item.opacity < 1);
    if (wall) shown.append(make("label", { className: "wide" }, "opacity ", make("input", { type: "range", min: 0.05, max: 0.99, step: 0.01, value: wall.opacity, oninput: (event) => ((wall.opacity = Number(event.target.value)), paint()) })));
    notes.replaceChildren(...data.notes.map((text) => make("p", {}, text)));
    const { low, high, colors } = data.scale;
    const bar = make("i");
    bar.style.background = `linear-gradient(to right, ${colors})`;
    legend.replaceChildren(`${show(low, 0)}`, bar, `${show(high, 0)} mm clearance; red: through the wall, grey: outside`);
    legend.hidden = !along;
    timeline.hidden = data.steps < 2;
    tightButton.hidden = data.tightest === null;
    tipBox.hidden = !scope || !data.surfaces.length;
    slider.max = data.steps - 1;
    title.textContent = data.title;
    canvas.setAttribute("aria-label", `3-D picture: ${data.title}. Arrow keys turn it, plus and minus zoom, 1 to 6 are standard views.`);
    resize();
  }

  function drawAlong() {
    if (!along || !frame.clearance) return;
    along.chart = { values: Array.from(frame.clearance), over: Array.from(frame.clearance, (_, i) => i + 1), overUnit: "links from the head", bars: true, high: 1.6 * data.scale.high, color: chartColor(data, "clearance") };
    drawChart(along.area, along.chart, lit);
  }

  function resize() {
    for (const item of series) {
      item.x = drawChart(item.area, item.chart);
      item.cursor.style.left = `${item.x(frame.step)}px`;
    }
    drawAlong();
    paint();
  }

  function turnTheme() {
    root.dataset.theme = isDark() ? "light" : "dark";
    resize();
  }

  const turning = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  canvas.addEventListener("keydown", (event) => {
    const way = turning[event.key];
    if (way) event.shiftKey ? camera.pan(0.05 * way[0], 0.05 * way[1]) : camera.turn(0.12 * way[0], 0.12 * way[1]);
    else if (event.key === "+" || event.key === "=") camera.zoom(0.85);
    else if (event.key === "-") camera.zoom(1.18);
    else if (event.key === "Enter" && measuring) click(0.5, 0.5);
    else return;
    cross = measuring;
    paint();
    event.preventDefault();
  });
  const keys = {
    " ": () => play(!playing), ",": () => seek(frame.step - 1), ".": () => seek(frame.step + 1), Home: () => seek(0), End: () => seek(data.steps - 1),
    n: goTightest, f: () => camera.fit(), t: () => setInside(!inside), m: () => setMeasuring(!measuring), b: turnTheme,
    x: () => setSection(section === null ? (data.patient ? 2 : 3) : null), Escape: () => (setMeasuring(false), setSection(null)),
  };
  root.addEventListener("keydown", (event) => {
    const { target, key } = event, typing = target.matches("input:not([type=range]):not([type=checkbox]), select, textarea");
    if (typing || event.ctrlKey || event.metaKey || event.altKey || (key === " " && target.matches("button, summary, [type=checkbox]"))) return;
    const act = keys[key.length === 1 ? key.toLowerCase() : key] || (data.axes[key - 1] && (() => camera.standard(key - 1)));
    if (!act || (data.steps < 2 && " ,.HomeEndn".includes(key))) return;
    act();
    event.preventDefault();
  });
  slider.addEventListener("input", () => seek(Number(slider.value)));
  pace.addEventListener("change", () => {
    speed = Number(pace.value);
    if (playing) source.play(true, speed);
  });
  planes.addEventListener("change", () => setSection(planes.value === "" ? null : Number(planes.value)));
  depth.addEventListener("input", () => setSection(section));
  night.addEventListener("change", resize);
  new ResizeObserver(resize).observe(root);
  canvas.addEventListener("webglcontextlost", (event) => {
    event.preventDefault();
    fail("The browser took the graphics away; the picture comes back when it gives them again.");
  });
  canvas.addEventListener("webglcontextrestored", () => {
    renderer.restart();
    fail("");
    viewer.setData(data);
  });

  viewer = {
    frames: 0, paints: 0, panel, onpick: null, camera, setFrame,
    /** Show other data, a new plan for example; the camera stays. */
    setData(next) {
      data = next;
      camera.setData(data);
      renderer?.setData(data);
      lit = -1;
      picks = [];
      fillPanel();
      showMeasured();
      data.bodies.forEach((body, i) => renderer?.setPose(i, jointsAt(body, frame.step), clearanceAt(body, frame.step), data.scale));
      setFrame({ step: Math.min(frame.step, data.steps - 1), joints: data.scope && jointsAt(data.scope, frame.step), clearance: data.scope && clearanceAt(data.scope, frame.step) });
      setSection(section);
    },
    /** Move the vertices of a surface: tissue that moves. */
    setSurfaceVertices(index, vertices) {
      data.surfaces[index].vertices = vertices;
      renderer?.setVertices(index, vertices);
      paint();
    },
    /** Show a step on a stage without controls, for a picture of it. */
    film(step) {
      root.classList.add("film");
      source.seek(step);
    },
    /** Tell the users of screen readers. */
    say(text) {
      said.textContent = text;
    },
  };
  setPlaying(false);
  viewer.setData(data);
  if ("onframe" in source) source.onframe = setFrame;
  if (data.tightest !== null) source.seek(data.tightest);
  return viewer;
}

/** Start the viewer of a page that holds its data: base64 of the gzipped container, in #view. */
export async function startPage() {
  const text = document.getElementById("view").textContent.trim();
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const data = decodeView(await new Response(stream).arrayBuffer());
  window.viewer = createViewer(document.getElementById("viewer"), data, recordedSource(data));
}

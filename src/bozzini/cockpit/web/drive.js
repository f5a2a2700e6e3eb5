/** The drive: pad, keyboard and gamepad, pressures, and the state of the rig. */
import { make } from "./view_page.js";

const REST = 0.12; // of a gamepad's travel, in which it is at rest
const KEEP_ALIVE = 120; // ms
const RATE = 1.6; // of the full travel that a held key moves the stick in a second
const WAYS = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1], d: [1, 0], a: [-1, 0], w: [0, 1], s: [0, -1] };
const STATES = { MODEL: "No rig: the model alone", BOOT: "The board starts", DISARMED: "Disarmed, vented", ARMED: "Armed", FAULT: "Fault, vented", LOST: "No board" };

const rests = ([x, y]) => !x && !y;
const kPa = (pressure) => Math.round(1000 * pressure);
const name = ({ key }) => (key.length === 1 ? key.toLowerCase() : key);

/** Keep a stick within the circle of its travel. */
function within([x, y]) {
  const size = Math.max(1, Math.hypot(x, y));
  return [x / size, y / size];
}

/** The first gamepad that is moved, as a stick with y up; null if none is. */
function readGamepad() {
  for (const pad of navigator.getGamepads?.() || []) {
    const [x, y] = pad?.connected ? pad.axes : [0, 0], size = Math.hypot(x, y);
    if (size > REST) return [x, -y].map((v) => (v / size) * Math.min((size - REST) / (1 - REST), 1));
  }
  return null;
}

/** Make the section; `send` gives the server a message. */
export function createDrive(info, send, viewer) {
  const full = info.full_stick_mm, command = (what) => () => send({ kind: "rig", what });
  const button = (text, what, title = "") => make("button", { type: "button", onclick: command(what), title }, text);
  const [arm, disarm, clear] = [button("Arm", "arm"), button("Disarm", "disarm", "Vent the muscles (Esc)"), button("Clear fault", "clear")];
  const pad = make("div", { className: "pad", tabIndex: 0, role: "application", ariaLabel: "Stick: hold the arrow keys to bend the tip, let go to straighten it" });
  // As the tip's camera sees it: x of the end-effector's frame goes left, y goes up.
  pad.innerHTML = `<svg viewBox="-1.12 -1.12 2.24 2.24" aria-hidden="true"><circle r="1"/><path class="axes" d="M-1 0H1M0-1V1"/>
    <polygon points="${info.workspace_mm.map(([x, y]) => `${-x / full},${-y / full}`)}"/><path class="miss"/><circle class="want" r=".075"/><circle class="given" r=".035"/><circle class="tip" r=".05"/></svg>`;
  const [miss, want, given, tip] = [".miss", ".want", ".given", ".tip"].map((each) => pad.querySelector(each));
  const state = make("b"), note = make("span"), why = make("p", { className: "why" }), gap = make("p", { className: "gap" });
  const rows = info.muscles.map((muscle) => {
    const bar = make("i"), mark = make("u"), value = make("td");
    return { bar, mark, value, row: make("tr", {}, make("th", { scope: "row" }, muscle), make("td", { className: "bar" }, make("div", {}, bar, mark)), value) };
  });
  const caption = info.has_rig ? "Measured / set-point [kPa]" : "Set-points [kPa]";
  const element = make("section", { className: "drive", ariaLabel: "Drive" }, make("h3", {}, "Drive"), make("p", { className: "state" }, state, note),
    ...(info.has_rig ? [make("div", { className: "buttons" }, arm, disarm, clear)] : []), pad, why,
    make("table", {}, make("caption", {}, caption), make("tbody", {}, ...rows.map(({ row }) => row))), gap,
    make("p", {}, "Drag the pad, hold arrow keys or W A S D on it, or use a gamepad."));
  tip.toggleAttribute("hidden", !info.has_rig);

  const keys = new Set();
  let pressed = null, held = [0, 0], sent = [0, 0], sentAt = 0, then = 0, frame = null, told = "";

  /** Read pad, keys and gamepad, and tell the server where the stick is. */
  function tick() {
    const now = performance.now(), far = RATE * Math.min((now - then) / 1000, 0.1);
    then = now;
    held = keys.size ? within([0, 1].map((i) => held[i] + far * Math.sign([...keys].reduce((sum, key) => sum + WAYS[key][i], 0)))) : [0, 0];
    const isHere = document.hasFocus() && !document.hidden;
    const next = pressed || (keys.size && held) || (isHere && readGamepad()) || [0, 0];
    if (next.every((v, i) => v === sent[i]) && (rests(next) || now - sentAt < KEEP_ALIVE)) return;
    [sent, sentAt] = [next, now];
    send({ kind: "stick", x: next[0], y: next[1] });
  }

  function letGo() {
    pressed = null;
    keys.clear();
    tick();
  }

  function press(event) {
    const box = pad.getBoundingClientRect(), half = box.width / 2;
    pressed = within([event.clientX - box.left - half, half + box.top - event.clientY].map((v) => (1.12 * v) / half));
    tick();
  }

  pad.addEventListener("pointerdown", (event) => {
    pad.setPointerCapture(event.pointerId);
    press(event);
  });
  pad.addEventListener("pointermove", (event) => pressed && press(event));
  for (const each of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) pad.addEventListener(each, letGo);
  for (const each of ["blur", "pagehide"]) window.addEventListener(each, letGo);
  document.addEventListener("visibilitychange", letGo);
  pad.addEventListener("keydown", (event) => {
    if (!WAYS[name(event)] || event.ctrlKey || event.metaKey || event.altKey) return;
    keys.add(name(event));
    event.preventDefault();
    event.stopPropagation();
  });
  pad.addEventListener("keyup", (event) => keys.delete(name(event)));
  document.addEventListener("keydown", ({ key }) => key === "Escape" && frame?.armed && send({ kind: "rig", what: "disarm" }));
  setInterval(tick, 16);

  const share = (pressure) => `${Math.min(100, Math.max(0, (100 * pressure) / info.pressure_limit_MPa))}%`;
  const put = (circle, [x, y]) => {
    circle.setAttribute("cx", -x / full);
    circle.setAttribute("cy", -y / full);
    return [-x / full, -y / full];
  };
  return {
    element, letGo,
    /** Show a frame. */
    update(next) {
      frame = next;
      miss.setAttribute("d", `M${put(want, next.target)}L${put(given, next.delivered)}`);
      put(tip, next.tip);
      element.classList.toggle("saturated", !next.reached);
      rows.forEach(({ bar, mark, value }, i) => {
        const [set, now] = [next.setpoints[i], next.measured[i]];
        bar.style.width = share(now);
        mark.style.left = share(set);
        value.textContent = info.has_rig ? `${kPa(now)} / ${kPa(set)}` : kPa(set);
      });
    },
    /** Show the status. */
    tell({ rig, note: words, reason, tip_clearance_mm: clearance, reservoir_MPa: supply }) {
      const here = STATES[rig] || rig;
      element.dataset.state = rig;
      state.textContent = here;
      note.textContent = [words, supply === null ? "" : `supply ${kPa(supply)} kPa`].filter(Boolean).join("; ");
      [[arm, "DISARMED"], [disarm, "ARMED"], [clear, "FAULT"]].forEach(([each, legal]) => (each.disabled = rig !== legal));
      why.textContent = reason ? `Saturated: ${reason}.` : frame?.pressed && rests(sent) ? "Another window holds the stick." : "";
      gap.textContent = clearance === null ? "The tip is not in the tract." : `Tip clearance: ${clearance.toFixed(2)} mm${clearance < 0 ? ", through the wall" : ""}`;
      gap.classList.toggle("through", clearance < 0);
      const now = reason ? `${here}, saturated` : here;
      if (now !== told) viewer.say((told = now));
    },
  };
}

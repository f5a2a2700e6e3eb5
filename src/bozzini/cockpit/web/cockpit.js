/** The cockpit: one socket to the server, a viewer, and the sections that drive and plan. */
import { createViewer, make } from "./view_page.js";
import { decodeView } from "./scene_data.js";
import { createDrive } from "./drive.js";
import { createPlanning } from "./planning.js";

const MAGIC = 0x315a4342, TISSUE = 0x545a4342, HEAD = 56;
const TIMED = ["stick", "seek"];
const FLAGS = ["playing", "reached", "rig", "armed", "fault", "inside", "planning", "pressed"];

/** Take a frame of the server apart; `bozzini.cockpit.wire` says what is in it. */
export function readFrame(buffer) {
  const head = new DataView(buffer), u32 = (i) => head.getUint32(4 * i, true), f64 = (at) => head.getFloat64(at, true);
  const links = u32(3), points = u32(4), muscles = u32(5), frame = { number: u32(1), step: u32(2), links, muscles, windows: u32(7), echo: f64(40) };
  FLAGS.forEach((name, bit) => (frame[name] = Boolean(u32(6) & (1 << bit))));
  let at = HEAD;
  const take = (count) => new Float32Array(buffer, (at += 4 * count) - 4 * count, count);
  frame.joints = links ? take(3 * (links + 1)) : null;
  frame.clearance = links ? take(links) : null;
  [frame.setpoints, frame.measured] = [take(muscles), take(muscles)];
  [frame.stick, frame.target, frame.delivered, frame.tip] = [take(2), take(2), take(2), take(2)];
  frame.backbone = take(3 * points);
  const [place, way, up] = [take(3), take(3), take(3)].map((v) => Array.from(v));
  frame.camera = links ? { place, way, up } : null;
  return frame;
}

const root = document.getElementById("viewer");
const waiting = make("p", { className: "waiting", role: "status" }, "Connecting\u2026");
const banner = make("p", { className: "banner", role: "alert", hidden: true }, "The server does not answer: the stick is let go. Trying again\u2026");
root.append(waiting);
document.body.append(banner);

/** What tests read: the viewer, the last frame and status, and the times from input to frame [ms]. */
const cockpit = (window.cockpit = { viewer: null, frame: null, status: null, delays: [], connections: 0 });
let socket = null, data = null, shown = 0, fetching = false, drive = null, planning = null, echo = 0, drawn = "", isReady = false;

function send(message) {
  if (TIMED.includes(message.kind)) message.time = performance.now();
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

const source = {
  kind: "live",
  seek: (step) => isReady && send({ kind: "seek", step }),
  play(on, factor = 1) {
    const way = data.scope?.insertion || [0, 240];
    send({ kind: "play", on, speed: Math.min(1000, (factor * Math.max(...way)) / 12) });
  },
};

/** Fetch what the server draws now, and let the viewer show it. */
async function refresh() {
  if (fetching) return;
  fetching = true;
  try {
    while (shown !== cockpit.status.view) {
      const version = cockpit.status.view;
      const answer = await fetch(`/view.bin?${version}`);
      if (!answer.ok) throw new Error(answer.statusText);
      data = decodeView(await answer.arrayBuffer());
      shown = version;
      if (cockpit.viewer) cockpit.viewer.setData(data);
      else {
        cockpit.viewer = createViewer(root, data, source);
        planning = createPlanning(cockpit.viewer, send);
        cockpit.viewer.panel.prepend(planning.element);
        isReady = true;
      }
      drawn = "";
      if (cockpit.frame) show(cockpit.frame);
      planning.update(cockpit.status);
    }
    if (!drive && cockpit.viewer && cockpit.status.rig) {
      const info = await (await fetch("/info.json")).json();
      drive = createDrive(info.drive, send, cockpit.viewer);
      cockpit.viewer.panel.prepend(drive.element);
      if (cockpit.frame) drive.update(cockpit.frame);
      drive.tell(cockpit.status);
    }
  } catch (error) {
    console.warn(error);
    shown = 0;
    setTimeout(refresh, 1000);
  }
  fetching = false;
}

function show(frame) {
  cockpit.frame = frame;
  if (frame.echo && frame.echo !== echo) cockpit.delays.push(performance.now() - (echo = frame.echo));
  drive?.update(frame);
  const { step, joints, clearance, camera, playing } = frame, { viewer } = cockpit;
  // A frame of another plan waits for that plan's data; one in which only pressures change draws nothing.
  if (!viewer || (data.scope?.links || 0) !== frame.links) return;
  const pose = [step, playing, joints, Object.values(camera || {})].join();
  if (pose !== drawn) viewer.setFrame({ step, joints, clearance, camera, playing });
  drawn = pose;
}

function hear(status) {
  cockpit.status = status;
  const { stage } = status.planning;
  if (!cockpit.viewer) waiting.textContent = `Reading the tract${stage ? `: ${stage}` : ""}\u2026`;
  drive?.tell(status);
  planning?.update(status);
  refresh();
}

function connect() {
  socket = new WebSocket(`ws://${location.host}/ws`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    banner.hidden = true;
    cockpit.connections++;
    shown = cockpit.connections > 1 ? 0 : shown; // another server may count anew
  };
  socket.onmessage = ({ data: message }) => {
    if (typeof message === "string") return hear(JSON.parse(message));
    const [kind, count] = new Uint32Array(message, 0, 2);
    if (kind === MAGIC) show(readFrame(message));
    else if (kind === TISSUE && data?.surfaces[data.surfaces.length - 1]?.vertices.length === 3 * count)
      cockpit.viewer.setSurfaceVertices(data.surfaces.length - 1, new Float32Array(message, 8));
  };
  socket.onclose = () => {
    banner.hidden = false;
    drive?.letGo();
    setTimeout(connect, 700);
  };
}

connect();

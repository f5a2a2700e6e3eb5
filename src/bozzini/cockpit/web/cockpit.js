/** The cockpit: one socket to the server, a viewer, and the sections that drive and plan. */
import { createViewer } from "./view_page.js";
import { decodeView } from "./scene_data.js";
import { createDrive } from "./drive.js";
import { createPlanning } from "./planning.js";
import { createTasks } from "./tasks.js";
import { createHead } from "./head.js";

const MAGIC = 0x315a4342, TISSUE = 0x545a4342, HEAD = 56;
const FLAGS = { playing: 1, reached: 2, armed: 8, pressed: 128 };

/** Take a frame of the server apart; `bozzini.cockpit.wire` says what is in it. */
function readFrame(buffer) {
	const [, , step, links, points, muscles, flags] = new Uint32Array(buffer, 0, 8);
	const frame = { step, links, echo: new Float64Array(buffer, 32, 3)[1] };
	for (const name in FLAGS) frame[name] = Boolean(flags & FLAGS[name]);
	let at = HEAD;
	const take = (count) => new Float32Array(buffer, (at += 4 * count) - 4 * count, count);
	frame.joints = links ? take(3 * links + 3) : null;
	frame.clearance = links ? take(links) : null;
	for (const name of ["setpoints", "measured"]) frame[name] = take(muscles);
	for (const name of ["stick", "target", "delivered", "tip"]) frame[name] = take(2);
	frame.parts = take(3 * points); // a head's; another bend is in the joints, too
	const [place, way, up] = [take(3), take(3), take(3)].map((v) => [...v]);
	frame.camera = links ? { place, way, up } : null;
	return frame;
}

const root = document.getElementById("viewer"), waiting = document.querySelector(".waiting"), banner = document.querySelector(".banner");
/** What tests read; delays are from input to frame [ms]. */
const cockpit = (window.cockpit = { viewer: null, frame: null, status: null, delays: [], connections: 0 });
let socket = null, data = null, shown = 0, fetching = false, drive = null, planning = null, head = null, echo = 0, pose = "", busy = false;

function send(message) {
	if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

const source = {
	seek: (step) => planning && send({ kind: "seek", step, time: performance.now() }),
	/** At speed 1 the whole way takes 12 s. */
	play: (on, factor = 1) => send({ kind: "play", on, speed: Math.min(1000, (factor * Math.max(...(data.scope?.insertion || [240]))) / 12) }),
};

/** Fetch what the server draws now, and let the viewer show it. */
async function refresh() {
	if (fetching) return;
	fetching = true;
	try {
		while (shown !== cockpit.status.view) {
			const version = cockpit.status.view, answer = await fetch(`/view.bin?${version}`);
			if (!answer.ok) throw new Error(answer.statusText);
			data = decodeView(await answer.arrayBuffer());
			head?.add(data);
			if (cockpit.viewer) cockpit.viewer.setData(data);
			else {
				cockpit.viewer = createViewer(root, data, source);
				planning = createPlanning(root.querySelector(".planning"), send, cockpit.viewer);
				createTasks(root.querySelector(".tasks"));
				waiting.hidden = true;
			}
			[shown, pose] = [version, ""];
			planning.tell(cockpit.status);
		}
		if (!drive && cockpit.viewer && cockpit.status.rig) {
			const info = await (await fetch("/info.json")).json();
			drive = createDrive(root.querySelector(".drive"), info.drive, { send, say: cockpit.viewer.say });
			if (info.drive.head) {
				head = cockpit.head = createHead(root, info.drive.head, send, drive);
				head.add(data);
				cockpit.viewer.setData(data);
				Object.assign(drive, { slide: head.slide, choose: head.choose });
				head.tell(cockpit.status);
			}
			drive.tell(cockpit.status);
		}
		if (cockpit.frame) update();
	} catch (error) {
		console.warn(error);
		shown = 0;
		setTimeout(refresh, 1000);
	}
	fetching = false;
}

/** Show the newest frame; where drawing takes long, the stick gets as much time. */
function update() {
	const { frame, viewer } = cockpit, { step, playing, joints, clearance, camera, parts } = frame;
	drive?.update(frame);
	// A frame of another plan waits for its data; where only pressures change nothing is drawn.
	const now = [step, playing, joints, Object.values(camera || {}), head && [parts, head.told]].join();
	if (busy || !viewer || now === pose || (data.scope?.links || 0) !== frame.links) return;
	[busy, pose] = [true, now];
	const begin = performance.now();
	head?.move(frame);
	viewer.setFrame({ step, playing, joints, clearance, camera });
	requestAnimationFrame(() => requestAnimationFrame(() => {
		const took = performance.now() - begin;
		setTimeout(() => {
			busy = false;
			update();
		}, took > 60 ? took : 0);
	}));
}

function hear(message) {
	if (typeof message === "string") {
		const status = JSON.parse(message), { session = status.session } = cockpit.status || {};
		if (status.session !== session) return location.reload(); // another server, begun at the same address
		cockpit.status = status;
		waiting.textContent = status.waiting;
		const readings = root.querySelector(".readings");
		readings.hidden = !(readings.lastChild.textContent = status.readings);
		for (const part of [drive, planning, head]) part?.tell(status);
		return refresh();
	}
	const [kind, count] = new Uint32Array(message, 0, 2), wall = data?.surfaces.findIndex((item) => item.vertices.length === 3 * count);
	if (kind === MAGIC) {
		const frame = (cockpit.frame = readFrame(message));
		if (frame.echo !== echo) cockpit.delays.push(performance.now() - (echo = frame.echo));
		update();
	} else if (kind === TISSUE && wall >= 0) cockpit.viewer?.setSurfaceVertices(wall, new Float32Array(message, 8));
}

function connect() {
	socket = new WebSocket(`ws://${location.host}/ws`);
	socket.binaryType = "arraybuffer";
	socket.onopen = () => {
		banner.hidden = true;
		cockpit.connections++;
	};
	socket.onmessage = (event) => hear(event.data);
	socket.onclose = () => {
		banner.hidden = false;
		drive?.letGo();
		setTimeout(connect, 700);
	};
}

connect();

/** A distal head: its bodies in the pictures, slide, camera, targets and the trace of the tip. */
const LONGEST = 600, STEP = 0.5; // places of the trace, and mm between them

/** Fill the section by what `info.json` says of the head. */
export function createHead(root, info, send, drive) {
	const find = (selector) => root.querySelector(`.drive ${selector}`), out = find(".out"), eye = find(".eye"), which = find(".which"), aim = find(".aim");
	const cloud = (name, color, radius) => ({ name, color, radius, points: new Float32Array(), live: true, seen: true });
	const trace = cloud("trace", "#ffd166", 0.35), targets = cloud("targets", "#37c8ff", 1.2), goal = cloud("next target", "#3ddc84", 1.6);
	const parts = info.parts.map(({ points, ...part }) => ({ ...part, role: "part", links: points - 1, steps: 1, live: true, joints: new Float32Array(3 * points) }));
	const slideTo = (share) => send({ kind: "slide", effector: number, out: Math.min(1, Math.max(0, share)), time: performance.now() });
	let step = -1, moved = 0, number = 0; // of the end-effector that is steered

	root.classList.add("twin");
	find(".scope").hidden = find(".more").hidden = false;
	which.replaceChildren(...info.effectors.map((_, k) => new Option(k + 1)));
	which.closest("div").hidden = !which[1];
	which.onchange = () => head.choose(which.value);
	out.oninput = () => slideTo(Number(out.value));
	eye.onchange = aim.onclick = ({ target }) => send({ kind: "head", what: target.value });
	const head = {
		told: "",
		/** Let data of a view have the head's bodies. */
		add(data) {
			data.bodies.push(...parts);
			data.clouds.push(trace, targets, goal);
		},
		/** Steer another end-effector, if there is one of this number. */
		choose(next) {
			if (which[next - 1] && next != number) send({ kind: "head", what: String(next) });
		},
		/** Slide the instrument by a share of its reach. */
		slide(share) {
			out.value = Number(out.value) + share;
			slideTo(Number(out.value));
			moved = performance.now();
		},
		/** Put bodies and trace where a frame has them. */
		move(frame) {
			let at = 0;
			for (const part of parts) part.joints = frame.parts.slice(3 * at, 3 * (at += part.links + 1));
			const tip = parts[1 + 2 * number].joints.slice(-3), last = trace.points.slice(-3);
			if (frame.step !== step) trace.points = tip;
			else if (!(Math.hypot(...tip.map((v, i) => v - last[i])) < STEP)) trace.points = new Float32Array([...trace.points.slice(-3 * LONGEST), ...tip]);
			step = frame.step;
			if (frame.camera) frame.camera.fov = info.view;
		},
		tell({ head: now }) {
			const { camera, hidden, effector, targets: places, touches, words } = now, done = touches.length;
			eye.value = root.dataset.camera = camera;
			const isNew = number !== effector;
			which.value = number = effector;
			if (isNew) drive.take(info.effectors[number - 1]);
			if (isNew || (document.activeElement !== out && performance.now() - moved > 500)) out.value = now.out;
			for (const part of parts) part.seen = !hidden.includes(part.name);
			targets.points = new Float32Array(places.slice(done + 1).flat());
			goal.points = new Float32Array((places[done] || []).flat());
			find(".touches").textContent = words;
			head.told = `${camera} ${done} ${places}`;
		},
	};
	return head;
}

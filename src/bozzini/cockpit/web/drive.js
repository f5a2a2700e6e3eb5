/** The drive: pad, keyboard and gamepad, pressures, and the state of the rig. */

const REST = 0.12; // of a gamepad's travel, in which it is at rest
const KEEP_ALIVE = 120; // ms
const RATE = 1.6; // full travels a second, by a held key
/** Keys of the pad: stick to the right and up, a head's instrument out, the scope in. */
const WAYS = { arrowright: [1], arrowleft: [-1], arrowup: [0, 1], arrowdown: [0, -1], d: [1], a: [-1], w: [0, 1], s: [0, -1], e: [0, 0, 1], q: [0, 0, -1], r: [0, 0, 0, 1], f: [0, 0, 0, -1] };
const LEGAL = { arm: "DISARMED", disarm: "ARMED", clear: "FAULT" };

const rests = ([x, y]) => !x && !y;
const kPa = (pressure) => Math.round(1000 * pressure);
const name = ({ key }) => key.toLowerCase();

/** Keep a stick within its circle. */
const within = (stick) => stick.map((v) => v / Math.max(1, Math.hypot(...stick)));

/** The gamepad that is moved, with y up. */
function readGamepad() {
	for (const pad of navigator.getGamepads?.() || []) {
		const [x, y] = pad?.connected ? pad.axes : [0, 0], size = Math.hypot(x, y);
		if (size > REST) return [x, -y].map((v) => (v / size) * Math.min((size - REST) / (1 - REST), 1));
	}
	return null;
}

/** Fill the section by what `info.json` says of the drive. */
export function createDrive(section, info, { send, say }) {
	const find = (selector) => section.querySelector(selector);
	const pad = find(".pad"), chosen = find(".buttons select"), buttons = [...section.querySelectorAll("button:not(.aim)")];
	// As the tip's camera sees it: x of the end-effector's frame goes left, y goes up.
	const seen = (place) => place.map((v) => -v / own.full_stick_mm);
	find("caption").textContent = info.has_rig ? "Measured / set-point [kPa]" : "Set-points [kPa]";
	find(".buttons").hidden = !info.has_rig;
	find(".tip").toggleAttribute("hidden", !info.has_rig);
	section.hidden = false;

	const keys = new Set();
	let pressed = null, held = [0, 0], sent = [0, 0], sentAt = 0, then = 0, frame = null, told = "", own, rows;

	/** Where the keys that are held go along one of their ways. */
	const sum = (way) => Math.sign([...keys].reduce((all, key) => all + (WAYS[key][way] || 0), 0));

	/** Tell the server where pad, keys or gamepad want the stick, and keys the scope. */
	function tick() {
		const now = performance.now(), far = RATE * Math.min((now - then) / 1000, 0.1);
		then = now;
		const steers = [...keys].some((key) => WAYS[key].length < 3);
		held = steers ? within([0, 1].map((i) => held[i] + far * sum(i))) : [0, 0];
		const isHere = document.hasFocus() && !document.hidden;
		if (isHere) slide(far);
		if (frame && sum(3)) send({ kind: "seek", step: frame.step + sum(3), time: now });
		const next = pressed || (steers && held) || (isHere && readGamepad()) || [0, 0];
		if (next.every((v, i) => v === sent[i]) && (rests(next) || now - sentAt < KEEP_ALIVE)) return;
		[sent, sentAt] = [next, now];
		send({ kind: "stick", x: next[0], y: next[1], time: now });
	}

	/** Slide the instrument of a head, by keys or the gamepad's other stick. */
	function slide(far) {
		const pads = [...(navigator.getGamepads?.() || [])].filter(Boolean);
		for (const pad of pads) drive.choose(1 + pad.buttons.findIndex((button) => button.pressed));
		const rate = sum(2) - (pads.map((pad) => pad.axes[3]).find((rate) => Math.abs(rate) > REST) || 0);
		if (rate) drive.slide(0.3 * far * rate);
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

	const on = (target, names, act) => names.split(" ").forEach((each) => target.addEventListener(each, act));
	on(pad, "pointerdown", (event) => {
		pad.setPointerCapture(event.pointerId);
		press(event);
	});
	on(pad, "pointermove", (event) => pressed && press(event));
	on(pad, "pointerup pointercancel lostpointercapture blur", letGo);
	on(window, "blur pagehide visibilitychange", letGo);
	on(pad, "keydown", (event) => {
		drive.choose(event.key);
		if (!WAYS[name(event)] || event.ctrlKey || event.metaKey || event.altKey) return;
		keys.add(name(event));
		event.preventDefault();
		event.stopPropagation();
	});
	on(pad, "keyup", (event) => keys.delete(name(event)));
	on(document, "keydown", ({ key }) => key === "Escape" && frame?.armed && send({ kind: "rig", what: "disarm" }));
	for (const each of buttons) each.onclick = () => send({ kind: "rig", what: each.value });
	chosen.onchange = () => send({ kind: "rig", what: chosen.value });

	const share = (pressure) => `${Math.min(100, Math.max(0, (100 * pressure) / own.pressure_limit_MPa))}%`;
	const put = (selector, place) => {
		const at = seen(place);
		["cx", "cy"].forEach((name, i) => find(selector).setAttribute(name, at[i]));
		return at;
	};
	const drive = {
		letGo,
		slide() {},
		choose() {},
		/** Show muscles and workspace of an end-effector. */
		take(next) {
			own = next;
			find("polygon").setAttribute("points", own.workspace_mm.map(seen).join(" "));
			rows = own.muscles.map((muscle) => {
				const row = find("template").content.firstElementChild.cloneNode(true);
				row.cells[0].textContent = muscle;
				return row;
			});
			find("tbody").replaceChildren(...rows);
		},
		/** Show a frame. */
		update(next) {
			frame = next;
			find(".miss").setAttribute("d", `M${put(".want", next.target)}L${put(".given", next.delivered)}`);
			put(".tip", next.tip);
			section.classList.toggle("saturated", !next.reached);
			rows.forEach((row, i) => {
				const [set, now] = [next.setpoints[i], next.measured[i]];
				row.querySelector("i").style.width = share(now);
				row.querySelector("u").style.left = share(set);
				row.cells[2].textContent = info.has_rig ? `${kPa(now)} / ${kPa(set)}` : kPa(set);
			});
		},
		/** Show the status. */
		tell({ rig, state: here, controller, note, reason, tip, tip_clearance_mm: gap, reservoir_MPa: supply }) {
			const why = reason ? `Saturated: ${reason}.` : "";
			section.dataset.state = rig;
			find(".state b").textContent = here;
			find(".state span").textContent = [note, supply === null ? "" : `supply ${kPa(supply)} kPa`].filter(Boolean).join("; ");
			[chosen.value, chosen.disabled] = [controller, rig === "ARMED"];
			buttons.forEach((each) => (each.disabled = rig !== LEGAL[each.value]));
			find(".why").textContent = why || (frame?.pressed && rests(sent) ? "Another window steers." : "");
			find(".gap").textContent = tip;
			find(".gap").classList.toggle("through", gap < 0);
			const now = why ? `${here}, saturated` : here;
			if (now !== told) say((told = now));
		},
	};
	drive.take(info);
	setInterval(tick, 16);
	return drive;
}

/** Live planning: sizes and ends of the way, the verdict, and a robot's tendons. */
import { make } from "./view_page.js";

const STAGES = { plan: "planning", certify: "proving", advice: "looking for what would fit" };
const FITS = { diameter_max: ["Diameter", Math.floor], link_max: ["Link", Math.floor], inflate: ["Inflation", Math.ceil] };

/** Fill the section; a click on the wall moves the end chosen before. */
export function createPlanning(section, send, viewer) {
	const find = (selector) => section.querySelector(selector), change = (values) => send({ kind: "change", ...values });
	const inputs = [...section.querySelectorAll("input")], ends = [...section.querySelectorAll(".ends button")];
	const robot = find(".robot"), busy = find(".busy"), verdict = find(".verdict");
	let told = "", named = "", now = null, asked = 0, edited = null, waits = false;

	/** Show the sizes in force, but not where one is typed or asked for. */
	function showSizes() {
		if (!waits && section.ariaBusy === "false") for (const input of inputs) if (input !== edited) input.value = Number(now[`${input.name}_mm`].toFixed(3));
	}

	for (const input of inputs) {
		input.oninput = () => (edited = input);
		input.onblur = () => showSizes((edited = null));
		input.onchange = () => {
			if (!input.value || !input.reportValidity()) return;
			[edited, waits] = [null, true];
			change({ [input.name]: Number(input.value) });
		};
	}

	function choose(end) {
		ends.forEach((each) => (each.ariaPressed = each.value === end));
		viewer.pick(end && ((wall) => {
			if (wall) change({ [end]: wall.place });
			choose(null);
		}));
		if (end) viewer.say(`Click the wall where the ${end} shall be, or press Enter with the cross there.`);
	}
	for (const each of ends) each.onclick = () => choose(each.ariaPressed === "true" ? null : each.value);

	function showRobot({ name, fits, reason, tendons }, moves) {
		if (name !== named) find(".robot tbody").replaceChildren(...tendons.map((each) => make("tr", {}, make("th", { scope: "row" }, each), make("td"))));
		robot.hidden = false;
		find(".robot h3").textContent = named = name;
		find(".robot p").textContent = fits ? "It follows the plan, proved." : `It does not get there: ${reason}.`;
		robot.querySelectorAll("td").forEach((cell, i) => (cell.textContent = moves?.[i]?.toFixed(2) ?? ""));
	}

	return {
		/** Show the status. */
		tell({ plan, moving, planning: { asked: count, busy: isBusy, message, stage }, tendons_mm: moves }) {
			section.hidden = false;
			busy.textContent = message || (isBusy ? `At work: ${STAGES[stage] || stage}\u2026` : "");
			busy.classList.toggle("refused", !isBusy);
			section.ariaBusy = isBusy;
			if (!plan) return;
			waits &&= count === asked;
			[now, asked] = [plan, count];
			showSizes();
			if (plan.words !== told) {
				section.dataset.verdict = plan.tone;
				viewer.say((told = verdict.textContent = plan.words));
				find("[name=inflate]").max = plan.inflate_most_mm;
				find(".fits").replaceChildren(...Object.entries(plan.would_fit_mm).map(([key, value]) => {
					const [label, round] = FITS[key], size = round(100 * value) / 100;
					return make("button", { type: "button", onclick: () => change({ [key.replace("_max", "")]: size }) }, `${label} ${size} mm fits`);
				}));
			}
			find(".moving").hidden = !moving;
			if (moving) find(".moving").textContent = moving.words;
			if (plan.robot) showRobot(plan.robot, moves);
			else robot.hidden = true;
		},
	};
}

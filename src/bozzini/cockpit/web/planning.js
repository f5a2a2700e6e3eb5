/** Live planning: sizes and ends of the way, the verdict, and a robot's tendons. */
import { make } from "./view_page.js";

const STAGES = { plan: "planning", certify: "proving", advice: "looking for what would fit" };
const MOVED = { held: "certified up to the next frame", now: "certified now", lost: "not certified", refused: "not followed" };
const FITS = { diameter_max: ["Diameter", Math.floor], link_max: ["Link", Math.floor], inflate: ["Inflation", Math.ceil] };

/** Fill the section; a click on the wall moves the end chosen before. */
export function createPlanning(section, send, viewer) {
	const find = (selector) => section.querySelector(selector), change = (values) => send({ kind: "change", ...values });
	const inputs = [...section.querySelectorAll("input")], ends = [...section.querySelectorAll(".ends button")];
	const robot = find(".robot"), busy = find(".busy"), verdict = find(".verdict");
	let told = "", named = "";

	for (const input of inputs) input.onchange = () => input.value && input.reportValidity() && change({ [input.name]: Number(input.value) });

	function choose(end) {
		ends.forEach((each) => (each.ariaPressed = each.value === end));
		viewer.onpick = end && (({ place }) => {
			change({ [end]: [...place] });
			choose(null);
		});
		if (end) viewer.say(`Click the wall where the ${end} shall be.`);
	}
	for (const each of ends) each.onclick = () => choose(each.ariaPressed === "true" ? null : each.value);

	function judge({ status, certified, reason, proved_mm: proved, inserted_mm: inserted, seconds }) {
		section.dataset.verdict = status === "stopped" ? status : certified ? "fits" : "open";
		if (status === "stopped") return `${reason[0].toUpperCase()}${reason.slice(1)}.`;
		if (!certified) return "Reaches the goal; no clearance is proved.";
		return `Fits: ${(Math.floor(100 * proved) / 100).toFixed(2)} mm of clearance proved over ${inserted} mm, planned in ${seconds} s.`;
	}

	function showRobot({ name, fits, reason, tendons }, moves) {
		if (name !== named) find(".robot tbody").replaceChildren(...tendons.map((each) => make("tr", {}, make("th", { scope: "row" }, each), make("td"))));
		robot.hidden = false;
		find(".robot h3").textContent = named = name;
		find(".robot p").textContent = fits ? "It follows the plan, proved." : `It does not get there: ${reason}.`;
		robot.querySelectorAll("td").forEach((cell, i) => (cell.textContent = moves?.[i]?.toFixed(2) ?? ""));
	}

	return {
		/** Show the status. */
		tell({ plan, moving, planning: { busy: isBusy, message, stage }, tendons_mm: moves, note, rig }) {
			section.hidden = false;
			busy.textContent = message || (isBusy ? `At work: ${STAGES[stage] || stage}\u2026` : rig ? "" : note);
			busy.classList.toggle("refused", !isBusy);
			section.ariaBusy = isBusy;
			if (!plan) return;
			const words = judge(plan);
			if (words !== told) {
				viewer.say((told = verdict.textContent = words));
				for (const input of inputs) if (input !== document.activeElement || !isBusy) input.value = Number(plan[`${input.name}_mm`].toFixed(3));
				find("[name=inflate]").max = plan.inflate_most_mm;
				find(".fits").replaceChildren(...Object.entries(plan.would_fit_mm).map(([key, value]) => {
					const [label, round] = FITS[key], size = round(100 * value) / 100;
					return make("button", { type: "button", onclick: () => change({ [key.replace("_max", "")]: size }) }, `${label} ${size} mm fits`);
				}));
			}
			find(".moving").hidden = !moving;
			if (moving) find(".moving").textContent = `The tract moves: ${MOVED[moving.status]}${moving.proved_mm === null ? "" : `, ${moving.proved_mm.toFixed(2)} mm proved`}.`;
			if (plan.robot) showRobot(plan.robot, moves);
			else robot.hidden = true;
		},
	};
}

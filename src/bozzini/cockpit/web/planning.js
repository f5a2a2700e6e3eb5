/** Live planning: sizes and ends of the way, the verdict, and a robot's tendons. */
import { make } from "./view_page.js";

const SIZES = [["diameter", "Diameter", 0.1, 500], ["link", "Link", 0.1, 10000], ["inflate", "Inflation", 0, 30]];
const STAGES = { plan: "planning", certify: "proving", advice: "looking for what would fit" };
const FITS = { diameter_max: ["diameter", "Diameter", Math.floor], link_max: ["link", "Link", Math.floor], inflate: ["inflate", "Inflation", Math.ceil] };

/** Make the section; a click on the wall moves the end that was chosen before. */
export function createPlanning(viewer, send) {
  const change = (values) => send({ kind: "change", ...values });
  const inputs = SIZES.map(([name, label, min, max]) => {
    const input = make("input", { type: "number", step: "any", min, max, inputMode: "decimal", onchange: () => input.value !== "" && input.reportValidity() && change({ [name]: Number(input.value) }) });
    return { name, input, label: make("label", {}, label, make("span", {}, input, " mm")) };
  });
  const ends = ["start", "end"].map((name) => make("button", { type: "button", ariaPressed: "false", onclick: () => choose(name) }, `Move the ${name}`));
  const verdict = make("p", { className: "verdict" }), busy = make("p", { className: "busy" }), fits = make("div", { className: "buttons" });
  const robot = make("div", { className: "robot" });
  const element = make("section", { className: "planning", ariaLabel: "Live planning" }, make("h3", {}, "Plan"), verdict, busy, fits,
    make("div", { className: "sizes" }, ...inputs.map(({ label }) => label)), make("div", { className: "buttons" }, ...ends), robot);
  let chosen = null, told = "", names = "";

  function choose(name) {
    chosen = chosen === name ? null : name;
    ends.forEach((item, i) => item.setAttribute("aria-pressed", chosen === ["start", "end"][i]));
    viewer.onpick = chosen && (({ place }) => {
      change({ [chosen]: Array.from(place) });
      choose(chosen);
    });
    if (chosen) viewer.say(`Click the wall where the ${name} shall be.`);
  }

  function showRobot(moved, values) {
    if (!moved) return robot.replaceChildren();
    if (moved.name !== names) robot.replaceChildren(make("h3", {}, (names = moved.name)), make("p"), make("table", {}, make("caption", {}, "Tendon displacements [mm]"), make("tbody", {}, ...moved.tendons.map((name) => make("tr", {}, make("th", { scope: "row" }, name), make("td"))))));
    robot.querySelector("p").textContent = moved.fits ? "It follows the plan, proved." : `It does not get there: ${moved.reason}.`;
    robot.querySelectorAll("td").forEach((cell, i) => (cell.textContent = values?.[i]?.toFixed(2) ?? ""));
  }

  return {
    element,
    /** Show the status. */
    update({ plan, planning, tendons_mm: moves, note, rig }) {
      const words = planning.busy ? planning.message || `At work: ${STAGES[planning.stage] || planning.stage}\u2026` : planning.message || (rig ? "" : note);
      busy.textContent = words;
      busy.classList.toggle("refused", !planning.busy && Boolean(words));
      element.setAttribute("aria-busy", planning.busy);
      if (!plan) return;
      const whole = plan.status === "complete";
      element.dataset.verdict = whole && plan.certified ? "fits" : whole ? "open" : "stopped";
      verdict.textContent = !whole ? `${plan.reason[0].toUpperCase()}${plan.reason.slice(1)}.`
        : plan.certified ? `Fits: ${(Math.floor(100 * plan.proved_mm) / 100).toFixed(2)} mm of clearance proved over ${plan.inserted_mm} mm, planned in ${plan.seconds} s.`
        : "Reaches the goal, but its clearance is not proved.";
      if (verdict.textContent !== told) {
        viewer.say((told = verdict.textContent));
        for (const { name, input } of inputs) if (document.activeElement !== input || !planning.busy) input.value = Number(plan[`${name}_mm`].toFixed(3));
        inputs[2].input.max = plan.inflate_most_mm;
        fits.replaceChildren(...Object.entries(plan.would_fit_mm).map(([key, value]) => {
          const [name, label, round] = FITS[key], size = round(100 * value) / 100;
          return make("button", { type: "button", onclick: () => change({ [name]: size }) }, `${label} ${size} mm fits`);
        }));
      }
      showRobot(plan.robot, moves);
    },
  };
}

/** Forms of tasks: their fields, the command that a filled one stands for, and what it answers. */
import { make } from "./view_page.js";

const isShown = ([key, value]) => value !== null && value !== "" && typeof value !== "object" && key !== "file";

function makeField({ name, about, words, flag, needed, shown }) {
	const first = needed || words.includes(shown) ? [] : [make("option", { value: "" }, "")];
	const input = words.length
		? make("select", { name }, ...first, ...words.map((word) => make("option", { value: word, selected: word === shown }, word)))
		: make("input", { name, required: needed, ...(flag ? { type: "checkbox", value: "yes" } : { placeholder: shown }) });
	return make("label", { title: about }, name.replaceAll("_", " "), input);
}

/** Fill the section, which stays hidden if there are no tasks. */
export async function createTasks(section) {
	const tasks = await (await fetch("/tasks.json")).json(), find = (selector) => section.querySelector(selector);
	const choice = find("select"), [about, command, words] = section.querySelectorAll("p"), form = find("form"), fields = find("form div");

	function choose() {
		const task = tasks.find(({ name }) => name === choice.value);
		about.textContent = task.about;
		fields.replaceChildren(...task.fields.map(makeField));
		show({ command: "", answer: {} });
	}

	function show({ command: line, answer: { error, reason, ...answer } }) {
		command.textContent = line;
		words.textContent = error?.message || reason || "";
		const cells = Object.entries(answer).filter(isShown);
		find("tbody").replaceChildren(...cells.map(([key, value]) => make("tr", {}, make("th", { scope: "row" }, key), make("td", {}, Number.isFinite(value) ? Number(value.toPrecision(6)) : value))));
	}

	form.onsubmit = async (event) => {
		event.preventDefault();
		const given = new URLSearchParams([...new FormData(form)].filter(([, value]) => value));
		section.ariaBusy = find("button").disabled = true;
		try {
			show(await (await fetch(`/tasks/${encodeURIComponent(choice.value)}?${given}`)).json());
		} finally {
			section.ariaBusy = find("button").disabled = false;
		}
	};
	choice.replaceChildren(...tasks.map(({ name }) => make("option", { value: name }, name)));
	choice.onchange = choose;
	if (tasks.length) choose();
	section.hidden = !tasks.length;
}

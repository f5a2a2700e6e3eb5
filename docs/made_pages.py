"""Hook of mkdocs: what is made of code or of measured data takes the place of marks in pages.

A page keeps ``<!-- made: NAME -->`` where one of `MAKERS` writes; nothing that is made is kept.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import click

from bozzini.cli.common import OLD_OPTIONS, Description, FieldOption

DOCS = Path(__file__).resolve().parent
MARK = re.compile(r"<!-- made: (\w+) -->")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Return a page with what is made in the places of its marks; mkdocs calls this for each."""
    return MARK.sub(_make, markdown)


def _make(mark: re.Match[str]) -> str:
    # For the scripts beside this one and for `benchmarks`; mkdocs takes back what a hook adds
    # while it is loaded.
    sys.path += [str(path) for path in (DOCS, DOCS.parent) if str(path) not in sys.path]
    return MAKERS[mark[1]]()


def format_commands() -> str:
    """Return the reference of all commands, as Markdown."""
    from bozzini.cli.main import root

    return "\n".join(_describe(root, click.Context(root, info_name="bozzini")))


def format_overview() -> str:
    """Return a table of the commands, each with its line of ``bozzini --help``."""
    from bozzini.cli.main import COMMANDS

    rows = [f"| `bozzini {name}` | {_escape(line)} |" for name, line in COMMANDS.items()]
    return "\n".join(["| command | what it does |", "|---|---|", *rows])


CALLS = {
    "demo": "anatomy.make_phantom",
    "plan": "motion.plan_insertion",
    "certify": "motion.verify_plan",
    "reach": "motion.reach_tree",
    "live": "motion.follow_tissue",
    "cockpit": "cockpit.run.Cockpit",
    "execute": "physics.Execution",
    "export": "physics.format_mjcf",
    "show": "scene.show",
    "segment": "anatomy.segment_gas",
    "phantom": "anatomy.make_phantom",
    "data fetch": "anatomy.fetch_data",
    "duct chain": "motion.move_free_chain",
    "duct fit": "duct.fit",
    "duct limits": "motion.find_diameter_limits",
    "duct show": "duct.load",
    "tree": "duct.find_tree",
    "continuum compare": "continuum.ContinuumRobot",
    "continuum contact": "continuum.ContactModel",
    "continuum design": "continuum.solve_curve",
    "continuum estimate": "continuum.ShapeEstimator",
    "continuum fabricate": "fabricate.write_body",
    "continuum fit": "continuum.fit_robot",
    "continuum insert": "continuum.insert_robot",
    "continuum jacobian": "continuum.jacobian",
    "continuum pose": "continuum.ContinuumRobot",
    "continuum predict": "continuum.predict_points",
    "continuum rank": "continuum.compare_tendons",
    "continuum reach": "continuum.ContinuumRobot",
    "continuum sensors": "continuum.plan_sensors",
    "continuum simulate": "continuum.simulate",
    "continuum tip-error": "study.robot_tip_error",
    "continuum track": "continuum.run_tendons",
    "continuum workspace": "continuum.sample_workspace",
    "effector curve": "effector.Effector",
    "effector fabricate": "fabricate.write_holders",
    "effector fit": "effector.fit_effector",
    "effector pose": "effector.Effector",
    "effector reach": "effector.solve_inverse",
    "effector simulate": "effector.simulate_effector",
    "effector stick": "effector.steer",
    "effector least-pressure": "effector.optimise_design",
    "effector sweep": "effector.sweep",
    "effector tip-error": "study.effector_tip_error",
    "effector trace": "effector.trace_line",
    "effector track": "effector.compare_controllers",
    "effector workspace": "effector.Effector",
    "head check": "head.check_head",
    "head compare": "head.compare_cameras",
    "head reach": "head.find_reached",
    "head show": "head.lay_out",
    "head view": "head.view_head",
    "muscle compare": "muscle.compare_models",
    "muscle curve": "muscle.MuscleModel",
    "muscle export": "muscle.export_muscle",
    "muscle fit": "muscle.calibrate",
    "muscle predict": "muscle.predict",
    "muscle presets": "muscle.preset",
    "muscle solve": "muscle.MuscleModel",
    "hysteresis fit": "hysteresis.compare_laws",
    "hysteresis predict": "hysteresis.predict_loops",
    "rig characterise": "rig.characterise_muscle",
    "rig demo": "rig.run_steps",
    "rig emulate": "rig.emulate_rig",
    "rig identify": "rig.identify_fill",
    "rig replay": "rig.replay_log",
    "rig run": "rig.Host",
    "rig selftest": "rig.check_board",
    "vision board": "vision.Board",
    "vision length": "vision.measure_series",
    "vision plan-setup": "vision.plan_setup",
    "vision shape": "vision.measure_shapes",
    "vision track": "vision.triangulate",
    "study resume": "study.run_study",
    "study run": "study.run_study",
    "study show": "study.read_rows",
    "uncertainty": "study.study_contact",
}
"""What to begin with in Python where a command does a job, below ``bozzini``."""


def format_jobs() -> str:
    """Return tables of jobs: what each command is for, its call in Python, and its guide."""
    from bozzini.cli.main import JOBS, root

    places = [place for folder in ("guide", "rig") for place in sorted(DOCS.glob(f"{folder}/*.md"))]
    sections = list(_list_sections([*places, *(DOCS / f"{n}.md" for n in ("files", "install"))]))
    lines = []
    for job, commands in JOBS.items():
        lines += [f"## {job}", "", "| I want to | command | Python | read |", "|---|---|---|---|"]
        for first in commands:
            found = root.get_command(click.Context(root), first)
            for leaf, command in _list_leaves(first, found):
                text = (command.help or "").partition("\n")[0].replace(" in INPUT", "").rstrip(".:")
                for item in command.params:
                    if isinstance(item, click.Argument):
                        name = item.human_readable_name
                        text = re.sub(rf"\b{name}\b", name.lower(), text)
                link = f"reference/cli.md#bozzini-{leaf.replace(' ', '-')}"
                row = [
                    _escape(text[:1].lower() + text[1:]),
                    f"[`bozzini {leaf}`]({link})",
                    _link_call(CALLS[leaf]) if leaf in CALLS else "",
                    _link_guide(leaf, sections),
                ]
                lines.append(f"| {' | '.join(row)} |")
        lines.append("")
    return "\n".join(lines)


def _list_leaves(name: str, command: click.Command | None) -> Iterator[tuple[str, click.Command]]:
    if isinstance(command, click.Group):
        context = click.Context(command)
        for word in command.list_commands(context):
            yield from _list_leaves(f"{name} {word}", command.get_command(context, word))
    elif command is not None:
        yield name, command


def _link_call(call: str) -> str:
    return f"[`{call}`](api/{call.partition('.')[0]}.md#bozzini.{call})"


def _list_sections(places: list[Path]) -> Iterator[tuple[Path, str, str, str]]:
    """Yield the place of each section of pages, its page's title, its own, and its text."""
    for place in places:
        text = place.read_text("utf-8")
        title = text.partition("\n")[0].removeprefix("# ").partition(":")[0]
        for part in re.split(r"^## ", text, flags=re.M):
            head, _, body = part.partition("\n")
            yield place, title, "" if head.startswith("#") else head, head + body


def _link_guide(leaf: str, sections: list[tuple[Path, str, str, str]]) -> str:
    """Return a link to the section that has a command most often, on the page of its group."""

    def count(name: str, text: str) -> int:
        return len(re.findall(rf"bozzini {name}(?![\w-])", text))

    pages: dict[Path, int] = {}
    for place, *_, text in sections:
        pages[place] = pages.get(place, 0) + count(leaf.split()[0], text)

    def judge(one: tuple[Path, str, str, str]) -> tuple[bool, bool, int, int]:
        own = count(leaf, one[3])
        return own > 0, one[0].parent != DOCS, pages[one[0]], own

    place, title, head, text = max(sections, key=judge)
    link = place.relative_to(DOCS).as_posix()
    if not head or not count(leaf, text):
        return f"[{title}]({link})"
    anchor = re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", head).strip().lower())
    return f"[{title}: {head}]({link}#{anchor})"


def format_spellings() -> str:
    """Return a table of names that commands and options had, each with that of today."""
    from bozzini.cli.main import OTHER_NAMES

    rows = {f"`{old}`": f"`{name}`" for old, name in {**OTHER_NAMES, **OLD_OPTIONS}.items()}
    rows |= {
        "`muscle … --preset NAME`, `--muscle FILE`": "`muscle … NAME` or `FILE`, before the table",
        "`effector … --preset`, `rig … --preset`": "`effector … EFFECTOR`, `rig … EFFECTOR`",
        "`head … --head FILE`": "`head … FILE`, before plan and tract",
        "`new KIND --out FILE`": "`new KIND FILE`",
        "an option that `--help` has no more, `--braid-angle 36deg`": "`--set braid_angle=36deg`",
    }
    lines = [f"| {old} | {name} |" for old, name in rows.items()]
    return "\n".join(["| before | today |", "|---|---|", *lines])


def format_models() -> str:
    """Return the catalogue of muscle models, from their cards."""
    from make_catalogue import format_catalogue

    return format_catalogue()


def format_gallery() -> str:
    """Return all pictures of the gallery with the lines that make them."""
    from make_gallery import format_page

    return "\n\n".join(format_page())


def format_pictures() -> str:
    """Return the table of pictures on the front page."""
    from make_gallery import format_front

    return "\n".join(format_front())


def format_figures() -> str:
    """Return all figures of the thesis, with the values that were kept when they were drawn."""
    from make_thesis import VALUES, format_page

    return "\n\n".join(format_page(json.loads(VALUES.read_text("utf-8"))))


def format_benchmarks() -> str:
    """Return the table of all benchmarks that are kept."""
    from benchmarks.report import MEASURED, list_table

    return "\n".join(list_table(json.loads(MEASURED.read_text("utf-8"))["rows"]))


def format_headlines() -> str:
    """Return the short table of benchmarks."""
    from benchmarks.report import MEASURED, list_headlines

    return "\n".join(list_headlines(json.loads(MEASURED.read_text("utf-8"))["rows"]))


def format_peers() -> str:
    """Return the table of other packages on the same cases."""
    from benchmarks.report import MEASURED, list_peers

    return "\n".join(list_peers(json.loads(MEASURED.read_text("utf-8"))["peers"]))


def format_plant() -> str:
    """Return the table of the constants of the rig's plant, each with its source."""
    from bozzini.rig import PlantDesign

    return PlantDesign().format_provenance()


def format_shapes() -> str:
    """Return a table of the kinds of shapes that a file may hold, each with its fields."""
    from bozzini.duct import DUCT_SHAPES
    from bozzini.duct.shape_files import make_shapes_schema

    rows = []
    for part in make_shapes_schema()["allOf"]:
        name = part["if"]["properties"]["kind"]["const"]
        fields = part["then"]["properties"]["shapes"]["items"]["properties"]
        line = (DUCT_SHAPES[name].__doc__ or "").partition("\n")[0].replace("`", "")
        rows.append(
            f"| `{name}` | {_escape(line)} | {', '.join(f'`{field}`' for field in fields)} |"
        )
    return "\n".join(["| `kind` | what | fields of each shape |", "|---|---|---|", *rows])


def format_control(table: str) -> str:
    """Return a table of what `benchmarks/rig_control.py` measured and kept."""
    kept = json.loads((DOCS.parent / "benchmarks" / "rig_control.json").read_text("utf-8"))
    head, *rows = (f"| {' | '.join(cells)} |" for cells in kept[table])
    return "\n".join([head, "|---" * len(kept[table][0]) + "|", *rows])


CONTROL = (
    "steps", "plants_fast", "plants_slow", "slews", "runaway", "circle", "stick", "controllers",
)  # fmt: skip

MAKERS: dict[str, Callable[[], str]] = {
    "commands": format_commands,
    "jobs": format_jobs,
    "overview": format_overview,
    "spellings": format_spellings,
    "models": format_models,
    "gallery": format_gallery,
    "pictures": format_pictures,
    "figures": format_figures,
    "benchmarks": format_benchmarks,
    "headlines": format_headlines,
    "peers": format_peers,
    "plant": format_plant,
    "shapes": format_shapes,
    **{table: partial(format_control, table) for table in CONTROL},
}
"""What writes in the place of a mark, by the mark's name."""


def _describe(command: click.Command, context: click.Context) -> Iterator[str]:
    level = context.command_path.count(" ") + 1
    if context.parent is not None:
        yield f"{'#' * level} {context.command_path}\n"
        yield "\n\n".join(map(_escape, re.split(r"\n\s*\n", (command.help or "").strip()))) + "\n"
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            if found is not None:
                yield from _describe(found, click.Context(found, context, name))
        return
    usage = " ".join(command.collect_usage_pieces(context))
    yield f"    {context.command_path} {usage}\n"
    options = [item for item in command.params if isinstance(item, click.Option)]
    records = [item.get_help_record(context) for item in options]
    first = [item for item in command.params if isinstance(item, Description)]
    records = [*((item.metavar or "", item.about) for item in first), *records]
    fields = [item for item in options if isinstance(item, FieldOption)]
    records += [(f"--set {item.name}=", item.known.describe()) for item in fields]
    yield "\n".join(f"- `{names}`: {_escape(text)}" for names, text in filter(None, records))
    yield ""


def _escape(text: str) -> str:
    """Return text in which nothing is markup, on one line."""
    return re.sub(r"([\\`*_<>\[\]#|])", r"\\\1", " ".join(text.split()))

"""``bozzini effector``: pressures to a pose and back, stick, workspace, curves, studies."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import click

from ..checks import check_integer, check_number, list_quantities
from ..effector.design import DEFAULT_PRESET, PRESET_MODELS, EffectorDesign
from ..effector.runs import EffectorSimulation
from ..effector.tracking import EffectorTracking
from ..errors import InputError
from ..fabricate import HolderOptions
from ..results import Json, format_rows
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    PICTURES,
    Answer,
    CheckedGroup,
    NameType,
    VectorType,
    answer_options,
    description,
    format_csv,
    format_parts,
    gather,
    gather_once,
    make_option,
    option,
    options_of,
    parse_pairs,
    progress_bar,
    quiet_option,
    refuse_options,
    run_exit,
    split_setting,
    step_option,
)
from .effector_fit import make_fit
from .muscle_options import (
    list_kinds,
    make_class,
    model_options,
    take_muscle,
)
from .task import make_command
from .tip import InputSpread, draw_options, give_tip_error, parse_deviations, tip_answer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..effector import Balance, CubicFit, Effector, EffectorInverse, EffectorPose, Trace
    from ..effector.files import EffectorFile
    from ..effector.pose import PoseMethod
    from ..results import Result
    from ..study.tip import DrawOptions

_Value = TypeVar("_Value")

FIELDS = list_quantities(EffectorDesign)
MOST_DESIGNS = 10_000
SHOWN_ROWS = 15
"""Rows of an iteration table that are shown to people; the files and --json have all."""
ON_AXIS_MM = 5e-4
"""Deflection that is shown as none [mm]: it has no direction to speak of."""
MUSCLE_COLUMNS = {
    "pressure_MPa": ("pressure [kPa]", 1e3, ".2f"),
    "displacement_mm": ("displacement [mm]", 1.0, ".3f"),
    "contraction_mm": ("contraction [mm]", 1.0, ".3f"),
    "force_N": ("force [N]", 1.0, ".3f"),
    "iterations": ("iterations", 1, "d"),
}
"""How people are shown what a muscle has: heading, scale and format."""


def _field_option(name: str, flag: str = "") -> Any:
    """Return the option of a field of a design."""
    item = EffectorDesign.__dataclass_fields__[name]
    return make_option(item, flag=flag, default=None, show_default=False, multiple=False)


class EffectorRequest:
    """An end-effector and the model of its muscles, as the options ask for them."""

    def __init__(self, **given: Any) -> None:
        self.given = given

    @cached_property
    def effector(self) -> Effector:
        """The effector."""
        from ..effector import Effector

        design, file = self.make_design(), self._file
        if file is not None and file.pulls:
            return replace(file.build(), design=design)
        named = self._choose()
        made = Effector(
            design, make_class(self.model_name, ends=named["ends"], load_path=named["load_path"])
        )
        return made if file is None else replace(made, motion=file.motion)

    @cached_property
    def _file(self) -> EffectorFile | None:
        """The file of a fitted end-effector, if that is what the preset names."""
        from ..effector.files import read_effector

        name = str(self.given["effector"])
        return read_effector(name) if name.endswith((".yaml", ".yml", ".json")) else None

    @property
    def model_name(self) -> str:
        """The model of the muscles: that given, else that of the preset."""
        name: str | None = self.given["model_name"]
        return name or self._of_preset[0]

    @property
    def _of_preset(self) -> tuple[str, Mapping[str, str]]:
        """Model and choices that the preset is made for."""
        if self._file is not None:
            return self._file.model, self._file.choices
        return PRESET_MODELS.get(self.given["effector"], ("energy", {}))

    def _choose(self) -> dict[str, str | None]:
        choices = {name: self.given[name] for name in ("ends", "load_path")}
        if self.given["model_name"] is None:
            choices = {name: choices[name] or self._of_preset[1].get(name) for name in choices}
        return choices

    @property
    def choices(self) -> dict[str, str]:
        """Choices of the model that are not left to it."""
        return {name: word for name, word in self._choose().items() if word is not None}

    def make_design(self) -> EffectorDesign:
        """Return the design."""
        from ..effector import PlacedMuscle, effector_preset, rigidity_from_test
        from ..units import parse_quantity

        given, file = self.given, self._file
        design = effector_preset(given["effector"]) if file is None else file.build().design
        placed = list(design.muscles)
        if given["angles"]:
            angles = parse_pairs("--angles", given["angles"], "angle", example="A=0deg,B=120deg")
            muscle = placed[0].muscle
            placed = [PlacedMuscle(name=name, muscle=muscle, angle=angles[name]) for name in angles]
        if given["muscle_preset"] is not None:
            muscle = take_muscle(given["muscle_preset"])
            placed = [replace(item, muscle=muscle) for item in placed]
        changes = {name: given[name] for name in FIELDS if given.get(name) is not None}
        length = changes.setdefault("backbone_length", placed[0].muscle.length)
        if given["rigidity_test"] is not None:
            parts = given["rigidity_test"].split(",")
            if "flexural_rigidity" in changes:
                raise InputError("--rigidity and --rigidity-test both give the stiffness: give one")
            if len(parts) != 2:
                raise InputError(
                    f"--rigidity-test is '{given['rigidity_test']}': it must be FORCE,DEFLECTION, "
                    "such as 0.1N,15mm"
                )
            load, moved = parse_quantity(parts[0], "force"), parse_quantity(parts[1], "length")
            changes["flexural_rigidity"] = rigidity_from_test(load, moved, length=length)
        muscles = tuple(replace(one, muscle=one.muscle.replace(length=length)) for one in placed)
        return design.replace(muscles=muscles, **changes)

    def describe(self, effector: Effector | None = None) -> dict[str, object]:
        """Return model and design as plain values."""
        from ..effector import find_conflicts

        design = (effector or self.effector).design
        described = {**design.to_dict(), "conflicts": find_conflicts(design)}
        return {"model": self.model_name, "design": described}


effector_argument = description(
    "effector",
    "--preset",
    about="measured (the default), prototype, or thesis, which has the thesis's own model too; or "
    "a file of 'bozzini effector fit --out', ending in .yaml or .json.",
    default=DEFAULT_PRESET,
)
effector_options = gather(
    "asked",
    EffectorRequest,
    effector_argument,
    option(
        "--muscle muscle_preset NAME|FILE",
        "The muscles, by a name of 'bozzini muscle presets' or a muscle file ending in .yaml or "
        ".json (measured: measured-45).",
    ),
    option(
        "--angles NAME=ANGLE,...",
        "The muscles, such as A=0deg,B=120deg,C=240deg (measured: R=307.5deg,G=219deg,B=75deg); "
        "can be repeated.",
        multiple=True,
    ),
    *map(_field_option, ("offset", "backbone_length", "holder_length", "segments")),
    *map(_field_option, ("holder_diameter", "bore_diameter", "hole_diameter", "coil_diameter")),
    _field_option("flexural_rigidity", "--rigidity"),
    option("--rigidity-test FORCE,DEFLECTION", "The same, from a load across the tip."),
    _field_option("catheter_rigidity", "--catheter"),
    _field_option("pressure_limit"),
    _field_option("beam_factor"),
    option(
        "--model model_name",
        "The model: energy, thesis, or one that 'bozzini muscle models' lists (default: energy; "
        "of the effector thesis, thesis with --load-path bulk).",
        NameType("model", lambda: list_kinds()),
    ),
    model_options,
)
table_options = answer_options(".csv", *PICTURES, help="A table (.csv) or a picture.", quiet=False)
cubic_option = option(
    "--cubic-from",
    "Fit the thesis's cubic from this pressure on, as in its controller.",
    "pressure",
)
_PLACE = VectorType("length", size=2)


def _give(
    result: Mapping[str, Any],
    *,
    answer: Answer,
    text: str,
    notes: Sequence[str] = (),
    done: bool = True,
) -> None:
    """Write a result on stdout, notes and the design's conflicts on stderr, and end if not done.

    With ``--json`` all is in the object: ``notes``, and the design's ``conflicts``.
    """
    answer.give({**result, "notes": list(notes)}, text)
    if not answer.as_json:
        for line in (*notes, *_describe_conflicts(result["design"]["conflicts"])):
            click.echo(f"note: {line}", err=True)
    if not done:
        run_exit(EXIT_NEGATIVE)


def _describe_conflicts(conflicts: Sequence[str]) -> list[str]:
    """Return the conflicts of a design as one line or none; muscles with the same one together."""
    groups: dict[str, list[str]] = {}
    for line in conflicts:
        head, found, rest = line.partition(" touches ")
        name = head.removeprefix("muscle ") if found else ""
        groups.setdefault(rest if found else line, []).append(name)
    lines = []
    for text, names in groups.items():
        several = f"muscles {', '.join(names)} touch {text}"
        one = f"muscle {names[0]} touches {text}" if names[0] else text
        lines.append(several if len(names) > 1 else one)
    return ["; ".join(lines)] if lines else []


def _pick(found: Result, names: str) -> Json:
    """Return some of the plain values of a result, in this order."""
    plain = found.to_dict()
    return {name: plain[name] for name in names.split()}


def _format_muscles(muscles: Mapping[str, Mapping[str, float]]) -> str:
    shown = [MUSCLE_COLUMNS[key] for key in next(iter(muscles.values()))]
    rows = [
        [name, *(format(s * v, f) for (_, s, f), v in zip(shown, row.values(), strict=True))]
        for name, row in muscles.items()
    ]
    return format_rows(["muscle", *(heading for heading, _, _ in shown)], rows)


def _parse_number(option: str, name: str, text: str) -> float:
    """Return a value of a parameter of a study."""
    from ..effector.study import find_quantity
    from ..muscle import Muscle
    from ..units import parse_quantity

    studied = ["offset", "length", "flexural_rigidity", "catheter_rigidity", "pressure_limit"]
    studied += [f"muscle.{field}" for field in list_quantities(Muscle) if field != "length"]
    known = find_quantity(name)
    if known is None or name not in studied:
        legal = ", ".join([*studied, *(["segments", "angles"] if option == "--vary" else [])])
        raise InputError(f"{option} names '{name}': choose one of {legal}")
    return parse_quantity(text, known.kind)


def _parse_values(item: str) -> tuple[str, Sequence[object]]:
    """Return the name and the values of one ``--vary``."""
    import numpy as np

    from ..units import parse_quantity

    name, values = split_setting("--vary", item, "NAME=LOW:HIGH:COUNT or NAME=VALUE,VALUE")
    if name == "segments":
        return name, _parse_segments(values)
    if name == "angles":
        sets = [part.split("/") for part in values.split(",")]
        return name, [tuple(parse_quantity(angle, "angle") for angle in one) for one in sets]
    if ":" not in values:
        return name, [_parse_number("--vary", name, part) for part in values.split(",")]
    *ends, count = values.split(":")
    if len(ends) != 2 or not count.strip().isdigit() or not 2 <= int(count) <= MOST_DESIGNS:
        raise InputError(
            f"--vary is '{item}': it must be NAME=LOW:HIGH:COUNT with a whole COUNT in "
            f"[2, {MOST_DESIGNS}]"
        )
    low, high = (_parse_number("--vary", name, part) for part in ends)
    steps = np.linspace(low, high, int(count)).tolist()
    if name == "muscle.strands" and not all(step == round(step) for step in steps):
        raise InputError(
            f"--vary is '{item}': this gives {steps[1]:g} strands, where only whole numbers are "
            "legal"
        )
    return name, steps


def _parse_segments(text: str) -> list[int]:
    """Return numbers of segments, separated by commas."""
    most = int(FIELDS["segments"].high)  # type: ignore[arg-type]
    parts = [part.strip() for part in text.split(",")]
    if not all(p.isascii() and p.isdigit() and len(p) < 9 and 1 <= int(p) <= most for p in parts):
        raise InputError(f"segments is '{text}': it must be whole numbers in [1, {most}], as 12,15")
    return [int(part) for part in parts]


@click.group("effector", cls=CheckedGroup)
def command() -> None:
    """Bend a catheter tip by pneumatic muscles: pose, reach, stick, workspace, traces, studies."""


@command.command("pose")
@option(
    "--pressure NAME=PRESSURE,...",
    "Gauge pressures, such as R=689.4kPa,G=413.6kPa; muscles left out have none. Can be repeated.",
    required=True,
    multiple=True,
)
@option(
    "--method", "How several muscles add up.", ("superposition", "thesis"), default="superposition"
)
@option(
    "--order NAME,NAME",
    "With --method thesis: which muscle is pressed first; by default as in the design.",
)
@option("--table with_table", "The thesis's iteration of each muscle alone.", is_flag=True)
@effector_options
@answer_options(
    ".csv",
    *PICTURES,
    help="A picture, or the backbone as a table (.csv). With --table the picture or table of that.",
    quiet=False,
)
def pose_command(
    pressure: tuple[str, ...],
    method: PoseMethod,
    order: str | None,
    with_table: bool,
    asked: EffectorRequest,
    answer: Answer,
) -> None:
    """Find where the tip goes under given pressures.

    Exit code 0: solved; 1: not solved, or the muscles demand more than the backbone can bend;
    2: bad input.
    """
    effector = asked.effector
    names = effector.design.names
    pressures = parse_pairs(
        "--pressure",
        pressure,
        "pressure",
        example="R=689.4kPa,G=413.6kPa",
        names=names,
        owner="the muscles of this design",
    )
    names_in_order = None if order is None else [word.strip() for word in order.split(",")]
    found = effector.forward(pressures, method=method, order=names_in_order)
    tables, notes = _iterate(effector, pressures) if with_table else ({}, {})
    if with_table and answer.out is not None and not tables:
        reasons = "; ".join(notes.values())
        raise InputError(f"--table has nothing to write into {answer.out}: {reasons}")
    _write_pose(effector, found, tables, answer)
    keys = (
        "tip_mm holder_tip_mm direction lateral_mm lateral_vector_mm azimuth_rad "
        "demanded_lateral_mm saturated reason length_error_mm muscles"
    )
    picked = _pick(found, keys)
    described = asked.describe()
    result = {
        "method": method,
        "model": described["model"],
        **picked,
        "converged": bool(found.settled),
        "design": described["design"],
        "file": answer.out,
    }
    if with_table:
        result["tables"] = {name: table.list_steps() for name, table in tables.items()}
        result["tables_converged"] = {
            name: name in tables and bool(tables[name].converged)
            for name, value in pressures.items()
            if value > 0.0
        }
    parts = ["\n".join([*_describe_pose(found), _format_muscles(picked["muscles"])])]
    parts += [_format_table(name, pressures[name], table) for name, table in tables.items()]
    done = bool(found.converged)
    _give(result, answer=answer, text="\n\n".join(parts), notes=list(notes.values()), done=done)


@command.command("tip-error")
@option(
    "--pressure NAME=PRESSURE,...",
    "Gauge pressures, as of pose. Can be repeated.",
    required=True,
    multiple=True,
)
@gather(
    "spread",
    InputSpread,
    option(
        "--pressure-sd command_sd",
        "Standard deviation of each pressure that is given, such as 5kPa.",
        "pressure",
        default="0kPa",
    ),
    option(
        "--sd deviations NAME=VALUE",
        "Standard deviation of a parameter, as 'sweep' names them: muscle.modulus=28kPa, "
        "offset=0.05mm. Can be repeated.",
        multiple=True,
    ),
    option(
        "--fit FIT.yaml",
        "A fit of the muscles by 'bozzini muscle fit --out': they have its model, and the "
        "covariance of what was fitted.",
        INPUT,
    ),
)
@draw_options
@effector_options
@tip_answer
def tip_error_command(
    pressure: tuple[str, ...],
    spread: InputSpread,
    asked: EffectorRequest,
    options: DrawOptions,
    answer: Answer,
) -> None:
    """Tell how far errors move the tip from where the model puts it, seen along the axis.

    Errors of pressures and parameters are propagated to first order, as an ellipse, and drawn and
    computed exactly beside it. Measured tips are off by the error of the model as well, which is
    not in it. Places are in the frame of the base.

    Exit code 0: done; 1: the two differ by more than 10 %, take the draws; 2: bad input.
    """
    from ..effector.study import find_quantity
    from ..muscle.files import read_muscle
    from ..study.tip import effector_tip_error

    effector = asked.effector
    pressures = parse_pairs(
        "--pressure",
        pressure,
        "pressure",
        example="R=689.4kPa,G=413.6kPa",
        names=effector.design.names,
        owner="the muscles of this design",
    )

    def find_kind(name: str) -> str:
        known = find_quantity(name)
        if known is None or known.whole:
            raise InputError(f"--sd names '{name}': give one such as offset or muscle.modulus")
        return known.kind

    found = effector_tip_error(
        effector,
        pressures,
        pressure_sd=spread.command_sd,
        parameter_sd=parse_deviations(spread.deviations, find_kind, example="muscle.modulus=28kPa"),
        fit=None if spread.fit is None else read_muscle(spread.fit),
        options=options,
    )
    give_tip_error(found, {"pressures_MPa": pressures, **asked.describe()}, answer)


@command.command("reach")
@option(
    "--to target X,Y",
    "Where the tip shall be, seen along the axis, such as 12mm,-5mm.",
    _PLACE,
    required=True,
)
@effector_options
@answer_options(*PICTURES, quiet=False)
def reach_command(target: tuple[float, ...], asked: EffectorRequest, answer: Answer) -> None:
    """Find the pressures that bring the tip to a place seen along the axis.

    A target out of reach is answered by the farthest place in its direction.

    Exit code 0: reached; 1: out of reach, what is delivered instead is given; 2: bad input.
    """
    effector = asked.effector
    _give_inverse(effector, effector.inverse(target), {"target_mm": target}, asked, answer)


@command.command("stick")
@option(
    "--axes X,Y",
    "Readings of the two axes, 0 to 1024 with 512 at rest, x from left to right and y from top to "
    "bottom, such as 700,400.",
    VectorType("dimensionless", size=2),
    required=True,
)
@option("--dead-zone", "Distance from rest, in readings, within which it is at rest.", default=0.0)
@effector_options
@answer_options(*PICTURES, quiet=False)
def stick_command(
    axes: tuple[float, ...], dead_zone: float, asked: EffectorRequest, answer: Answer
) -> None:
    """Turn the readings of a thumb-stick into pressures.

    A full stick is the largest deflection of the workspace. What is out of reach is answered by the
    farthest place in its direction, as the thesis's controller does (4.6).

    Exit code 0: reached; 1: out of reach, what is delivered instead is given; 2: bad input.
    """
    from ..effector import Stick, find_stick_scale, steer

    effector = asked.effector
    scale = find_stick_scale(effector)
    found = steer(effector, axes, stick=Stick(dead_zone=dead_zone), scale=scale)
    target = tuple(float(value) for value in found.target)
    result = {"axes": axes, "full_stick_mm": scale, "target_mm": target}
    _give_inverse(effector, found, result, asked, answer)


def _give_inverse(
    effector: Effector,
    found: EffectorInverse,
    asked_for: Json,
    asked: EffectorRequest,
    answer: Answer,
) -> None:
    """Give the pressures for a target, and where they lead."""
    target = asked_for["target_mm"]
    posed = effector.forward(found.pressures)

    def draw() -> Figure:
        from ..plot.effector import draw_pose

        return draw_pose(effector, posed, workspace=effector.workspace(), target=target)

    answer.write({}, draw)
    result: Json = {
        **asked_for,
        "reachable": bool(found.reachable),
        "converged": bool(found.settled),
        **_pick(found, "delivered_mm reason iterations muscles"),
        "residual_mm": float(found.displacement_error),
        **_pick(posed, "tip_mm holder_tip_mm"),
        **asked.describe(),
        "file": answer.out,
    }
    x, y = (float(value) for value in found.delivered)
    line = f"reached: tip at {x:.3f}, {y:.3f} mm"
    if not bool(found.settled):
        line = f"not solved: {found.reason}"
    elif not bool(found.reachable):
        wanted = f"{target[0]:g}, {target[1]:g} mm"
        line = f"out of reach: {wanted}; delivered {x:.3f}, {y:.3f} mm: {found.reason}"
    done = bool(found.converged)
    text = f"{line}\n{_format_muscles(result['muscles'])}"
    _give(result, answer=answer, text=text, done=done)


def _iterate(
    effector: Effector, pressures: Mapping[str, float]
) -> tuple[dict[str, Balance], dict[str, str]]:
    """Return the thesis's iteration of every muscle under pressure, or why there is none."""
    from ..effector import balance

    tables: dict[str, Balance] = {}
    notes: dict[str, str] = {}
    for name, value in pressures.items():
        if value > 0.0:
            try:
                tables[name] = balance(effector, name, pressure=value, method="fixed-point")
            except InputError as error:  # the pose has its own root, which this does not touch
                notes[name] = f"no table, {error}"
    if not (tables or notes):
        notes[""] = "no table, no muscle is under pressure"
    return tables, notes


def _write_pose(
    effector: Effector, found: EffectorPose, tables: Mapping[str, Balance], answer: Answer
) -> None:
    def draw() -> Figure:
        from ..plot.effector import draw_iteration, draw_pose

        if tables:
            return draw_iteration(tables)
        return draw_pose(effector, found, workspace=effector.workspace())

    columns: dict[str, object] = {
        f"{axis}_mm": found.backbone[:, k] for k, axis in enumerate("xyz")
    }
    if tables:
        rows = [{"muscle": name, **row} for name in tables for row in tables[name].list_steps()]
        columns = {key: [row[key] for row in rows] for key in rows[0]}
    answer.write(columns, draw)


def _describe_pose(found: EffectorPose) -> list[str]:
    import numpy as np

    x, y, z = (float(value) for value in found.tip)
    lateral, longer = float(found.lateral), float(found.length_error)
    azimuth = math.degrees(float(found.azimuth)) % 360.0
    where = f"{lateral:.3f} mm from the axis, towards {azimuth:.2f} deg"
    if lateral < ON_AXIS_MM:
        x, y, where = 0.0, 0.0, "on the axis"
    lines = [f"tip at {x:.3f}, {y:.3f}, {z:.3f} mm: {where}"]
    holder = ", ".join(f"{float(value) + 0.0:.3f}" for value in np.round(found.holder_tip, 3))
    lines.append(f"end of the holder at {holder} mm")
    if abs(longer) > 1e-6:
        word = "longer" if longer > 0.0 else "shorter"
        lines.append(f"the eight steps make the backbone {abs(longer):.3g} mm {word}")
    return [*lines, *([str(found.reason)] if str(found.reason) else [])]


def _show_cell(cell: object) -> str:
    """Return a cell of a table of designs."""
    if isinstance(cell, float):
        return f"{cell:.5g}"
    return "-" if cell is None else str(cell)


def _format_table(name: str, pressure: float, found: Balance) -> str:
    rows = [[f"{value:.4f}" for value in row.values()] for row in found.list_steps()]
    if len(rows) > SHOWN_ROWS:
        rows = [*rows[: SHOWN_ROWS - 2], ["..."] * 4, rows[-1]]
    head = ["F [N]", "contraction [mm]", "deflection [mm]", "F* [N]"]
    lines = [f"muscle {name} alone at {1e3 * pressure:.1f} kPa, {len(found.table)} rows"]
    lines.append(format_rows(head, rows))
    return "\n".join([*lines, *([f"note: {found.reason}"] if str(found.reason) else [])])


@command.command("workspace")
@option(
    "--of kind",
    "Where the tip can go, or how hard it can press in each direction.",
    ("place", "force"),
    default="place",
)
@option("--at X,Y", "With --of force: where something holds the tip (default: 0,0).", _PLACE)
@effector_options
@table_options
def workspace_command(
    kind: str, at: tuple[float, ...] | None, asked: EffectorRequest, answer: Answer
) -> None:
    """Find where the tip can go, and what it can press with.

    The table has the boundary, seen along the axis and in space, or the force over the direction.

    Exit code 0: done; 1: the tip cannot be at --at; 2: bad input.
    """
    if at is not None and kind != "force":
        raise InputError("--at has no effect without --of force: leave it out")
    effector = asked.effector
    if kind == "force":
        result, text = _find_force(effector, at or (0.0, 0.0), answer)
    else:
        result, text = _find_places(effector, answer)
    found = bool(result.get("reachable", True))
    result |= {**asked.describe(), "of": kind, "file": answer.out if found else None}
    _give(result, answer=answer, text=text, done=found)


def _find_places(effector: Effector, answer: Answer) -> tuple[dict[str, object], str]:
    found = effector.workspace()
    reach, names = found.reach, effector.design.names

    def draw() -> Figure:
        from ..plot.effector import draw_workspace

        return draw_workspace(effector, found)

    answer.write(found.list_columns(), draw)
    result = _pick(
        found,
        "amplitudes_mm saturated largest_deflection_mm inner_radius_mm outer_radius_mm area_mm2 "
        "tip_area_mm2 gaps boundary_mm boundary_tip_mm boundary_holder_tip_mm",
    )
    towards = zip(effector.design.muscles, reach.amplitudes, strict=True)
    lines = [
        f"in every direction {found.inner_radius:.2f} mm, at most {found.outer_radius:.2f} mm; "
        f"{found.area:.1f} mm^2 seen along the axis, {found.tip_area:.1f} mm^2 in space",
        format_rows(
            ["muscle", "alone [mm]", "towards [deg]"],
            [[one.name, f"{far:.2f}", f"{math.degrees(one.angle):.1f}"] for one, far in towards],
        ),
    ]
    full = [name for name, lost in zip(names, reach.saturated, strict=True) if lost]
    if full:
        lines.append(
            f"saturated: {', '.join(full)} could go on, but the backbone is at "
            f"{reach.peak:.4g} mm, {reach.peak_reason}"
        )
    lines += [f"not reached: {found.reason}"] if found.reason else []
    return result, "\n".join(lines)


def _find_force(
    effector: Effector, at: tuple[float, ...], answer: Answer
) -> tuple[dict[str, object], str]:
    import numpy as np

    from ..effector import passive_stiffness, tip_force, tip_stiffness

    held = effector.inverse(at)
    if not bool(held.reachable):
        text = f"the tip cannot be at {at[0]:g}, {at[1]:g} mm: {held.reason}"
        return {"at_mm": at, "reachable": False, "reason": str(held.reason)}, text
    angle = np.radians(np.arange(360.0))
    found = tip_force(effector, np.stack([np.cos(angle), np.sin(angle)], axis=1), lateral=at)
    passive = passive_stiffness(effector.design)

    def draw() -> Figure:
        from ..plot.effector import draw_force

        return draw_force(effector, lateral=at)

    answer.write(found.list_columns(), draw)
    result = {
        "at_mm": at,
        "reachable": True,
        **found.list_columns(),
        "pulls_N": dict(zip(effector.design.names, found.pulls.tolist(), strict=True)),
        "stiffness_N_per_mm": tip_stiffness(effector, held.pressures),
        "passive_stiffness_N_per_mm": passive,
    }
    low, high = int(np.argmin(found.force)), int(np.argmax(found.force))
    text = (
        f"held at {at[0]:g}, {at[1]:g} mm the tip presses with {found.force[low]:.3f} N "
        f"(towards {low} deg) to {found.force[high]:.3f} N (towards {high} deg); "
        f"stiffness without pressure {passive:.4g} N/mm"
    )
    return result, text


@command.command("curve")
@option("--points", "Rows of the table.", default=84)
@cubic_option
@effector_options
@table_options
def curve_command(
    points: int, cubic_from: float | None, asked: EffectorRequest, answer: Answer
) -> None:
    """Compute the deflection by each muscle alone over its pressure.

    The table goes to stdout, unless --out names a file. Where the backbone is at its largest
    deflection the curve is flat: the column saturated is 1 there, and a note gives from where on.

    Exit code 0: done; 1: an equilibrium was not found; 2: bad input.
    """
    import numpy as np

    from ..effector import balance

    check_integer("points", points, low=2, high=100_000)
    effector = asked.effector
    over = np.linspace(0.0, effector.design.pressure_limit, points)
    found = {name: balance(effector, name, pressure=over) for name in effector.design.names}
    columns: dict[str, object] = {"pressure_MPa": over}
    for name, curve in found.items():
        columns[f"deflection_{name}_mm"] = curve.lateral
        columns[f"contraction_{name}_mm"] = curve.contraction
        columns[f"force_{name}_N"] = curve.force
        columns[f"saturated_{name}"] = curve.saturated
    cubics = _fit_cubics(effector, cubic_from) or {}
    lines = [
        f"cubic of {name} from {1e3 * fit.start:g} kPa: {fit.rms_error:.3f} mm rms, "
        f"{fit.largest_error:.3f} mm at most"
        + (f"; fitted up to {1e3 * fit.limit:.4g} kPa, flat beyond" if fit.saturated else "")
        + ("" if fit.monotone else "; falls in places")
        for name, fit in cubics.items()
    ]

    def draw() -> Figure:
        from ..plot.effector import draw_deflection

        return draw_deflection(effector, cubics=cubics)

    answer.write(columns, draw)
    if answer.out is None:
        lines = [format_csv(columns).rstrip("\n"), *(f"# {line}" for line in lines)]
    else:
        lines.insert(0, f"{answer.out}: deflection over pressure, {points} points")
    described = asked.describe()
    result = {
        "model": described["model"],
        "columns": columns,
        "cubics": {name: fit.to_dict() for name, fit in cubics.items()},
        "design": described["design"],
        "file": answer.out,
    }
    notes = [
        f"muscle {name} from {1e3 * curve.pressure[first]:.4g} kPa on: {curve.reason[first]}"
        for name, curve in found.items()
        for which in (curve.saturated, ~curve.converged & ~curve.saturated)
        for first in np.flatnonzero(which)[:1]
    ]
    done = all(bool((curve.converged | curve.saturated).all()) for curve in found.values())
    _give(result, answer=answer, text="\n".join(lines), notes=notes, done=done)


def _fit_cubics(effector: Effector, cubic_from: float | None) -> dict[str, CubicFit] | None:
    from ..effector import fit_cubic

    if cubic_from is None:
        return None
    return {name: fit_cubic(effector, name, start=cubic_from) for name in effector.design.names}


@command.command("trace")
@gather(
    "curve",
    dict,
    option("--from start X,Y", "Where a line begins.", _PLACE),
    option("--to end X,Y", "Last point of the line.", _PLACE),
    option("--radius", "Radius of a circle.", "length"),
    option("--centre X,Y", "Centre of the circle (default: 0,0).", _PLACE),
)
@option(
    "--points",
    "Targets: of a line both ends included (default: 51), of a circle with the first once more to "
    "close it (default: 72).",
    int,
)
@cubic_option
@effector_options
@table_options
def trace_command(
    curve: Json,
    points: int | None,
    cubic_from: float | None,
    asked: EffectorRequest,
    answer: Answer,
) -> None:
    """Follow a line (--from, --to) or a circle (--radius) with the tip, seen along the axis.

    A circle goes from +x counter-clockwise.

    Exit code 0: all of it; 1: parts are out of reach or not solved; 2: bad input.
    """
    from ..effector import trace_circle, trace_line

    start, end, radius, centre = (curve[name] for name in ("start", "end", "radius", "centre"))
    least = 2 if radius is None else 3
    if radius is not None:
        refuse_options(("start", "end"), "with --radius")
    elif start is None or end is None:
        raise InputError("trace needs --from and --to of a line, or --radius of a circle")
    else:
        refuse_options(("centre",), "on a line")
    count = {2: 51, 3: 72}[least] if points is None else points
    check_integer("points", count, low=least, high=100_000)
    effector, cubics = asked.effector, _fit_cubics(asked.effector, cubic_from)
    if radius is not None:
        at = centre or (0.0, 0.0)
        found = trace_circle(effector, radius, centre=at, steps=count, cubics=cubics)
    else:
        found = trace_line(effector, start, end=end, steps=count, cubics=cubics)
    _show_trace(found, asked, answer)


def _show_trace(found: Trace, asked: EffectorRequest, answer: Answer) -> None:
    def draw() -> Figure:
        from ..plot.effector import draw_trace

        return draw_trace(found, found.names, outline=asked.effector.workspace().boundary)

    columns = found.list_columns()
    answer.write(columns, draw)
    count, reached = len(found.targets), int(found.reachable.sum())
    text = format_csv(columns).rstrip("\n")
    if answer.out is not None:
        text = (
            f"{answer.out}: {reached} of {count} targets in reach, largest error there "
            f"{found.reachable_error:.3g} mm"
        )
    described, settled = asked.describe(), bool(found.settled.all())
    result = {
        **_pick(found, "kind pressure_map targets reachable complete"),
        "model": described["model"],
        "converged": settled,
        **_pick(found, "largest_error_mm largest_distance_mm columns"),
        "design": described["design"],
        "file": answer.out,
    }
    notes = []
    if not found.complete:
        notes.append(
            f"{count - reached} of {count} targets are out of reach, the farthest by "
            f"{found.largest_error:.3g} mm"
        )
    if not settled:
        notes.append(f"not converged at {int((~found.settled).sum())} of {count} targets")
    _give(result, answer=answer, text=text, notes=notes, done=found.complete and settled)


command.add_command(make_fit(effector_options))
command.add_command(make_command(EffectorSimulation))
command.add_command(make_command(EffectorTracking))


@command.command("sweep")
@option(
    "--vary varied NAME=VALUES",
    "What to vary: LOW:HIGH:COUNT or values with commas, as offset=3mm:5mm:5, segments=12,15; "
    "for angles, sets of them: angles=0deg/120deg/240deg. Can be repeated.",
    multiple=True,
    required=True,
)
@option("--deflection", "Deflection that every muscle alone must reach.", "length")
@effector_options
@quiet_option
@table_options
def sweep_command(
    varied: tuple[str, ...],
    deflection: float | None,
    asked: EffectorRequest,
    quiet: bool,
    answer: Answer,
) -> None:
    """Try every combination of some values; designs that do not work are listed with the reason.

    Exit code 0: at least one design works; 1: none does; 2: bad input.
    """
    from ..effector import sweep

    effector = asked.effector
    parameters = gather_once("--vary", map(_parse_values, varied))
    total = math.prod(map(len, parameters.values()))
    if total > MOST_DESIGNS:
        raise InputError(f"--vary asks for {total} designs: at most {MOST_DESIGNS} at once")
    wanted = 0.0
    if deflection is not None:
        wanted = check_number("deflection", deflection, low=0.0, low_open=True, unit="mm")
    with progress_bar(quiet=quiet) as progress:
        found = sweep(effector, parameters, deflection=wanted, progress=progress)

    def draw() -> Figure:
        from ..plot.effector import draw_sweep

        return draw_sweep(found)

    answer.write(found.list_columns(), draw)
    result = {
        **_pick(found, "parameters deflection_mm designs feasible columns"),
        **asked.describe(),
        "file": answer.out,
    }
    text = f"{answer.out}: {len(found.feasible)} of {len(found.rows)} designs work"
    if answer.out is None:
        columns = found.list_columns()
        rows = [list(map(_show_cell, row)) for row in zip(*columns.values(), strict=True)]
        text = format_rows(list(columns), rows)
    _give(result, answer=answer, text=text, done=bool(found.feasible))


@command.command("least-pressure")
@option(
    "--between ranges NAME=LOW:HIGH",
    "What may be changed, as offset=3mm:4.5mm; up to 4 times.",
    multiple=True,
    required=True,
)
@option("--choose-segments N,N,...", "Numbers of segments to choose from, as 12,15,18.")
@option("--deflection", "Deflection that every muscle alone must reach.", "length", required=True)
@effector_options
@quiet_option
@answer_options(quiet=False)
def least_command(
    ranges: tuple[str, ...],
    choose_segments: str | None,
    deflection: float,
    asked: EffectorRequest,
    quiet: bool,
    answer: Answer,
) -> None:
    """Find the design that reaches a deflection with the least pressure.

    Exit code 0: found; 1: no design within the ranges reaches it; 2: bad input.
    """
    from ..effector import optimise_design

    effector = asked.effector
    bounds = gather_once("--between", map(_parse_range, ranges))
    numbers = None if choose_segments is None else _parse_segments(choose_segments)
    with progress_bar(quiet=quiet) as progress:
        found = optimise_design(
            effector, deflection, bounds=bounds, segments=numbers, progress=progress
        )
    result = {
        "success": found.converged,
        **_pick(found, "reason deflection_mm changes pressure_MPa pressure_before_MPa"),
        **_pick(found, "evaluations infeasible"),
        **asked.describe(found.effector),
    }
    listed = ", ".join(_describe_change(*change) for change in result["changes"].items())
    text = f"{1e3 * found.pressure:.2f} kPa with {listed}"
    if found.pressure_before > 0.0:
        text += f"; before {1e3 * found.pressure_before:.2f} kPa"
    text += f"\nnote: {found.reason}" if found.reason else ""
    if not found.converged:
        text = f"no design: {found.reason}"
    _give(result, answer=answer, text=text, done=found.converged)


def _describe_change(name: str, value: float) -> str:
    """Return a field and its value as text, an angle in degrees."""
    if name.endswith("_rad"):
        return f"{name.removesuffix('_rad')} {math.degrees(value):.6g} deg"
    return f"{name} {value:.6g}"


def _parse_range(item: str) -> tuple[str, tuple[float, float]]:
    """Return the name and the two ends of one ``--between``."""
    name, values = split_setting("--between", item, "NAME=LOW:HIGH")
    parts = values.split(":")
    if len(parts) != 2:
        raise InputError(f"--between is '{item}': it must be NAME=LOW:HIGH")
    low, high = (_parse_number("--between", name, part) for part in parts)
    return name, (low, high)


@command.command("fabricate")
@effector_options
@options_of(HolderOptions, "options")
@step_option
@answer_options(
    required=True,
    metavar="DIRECTORY",
    help="Directory for the parts and the template.",
    quiet=False,
)
def fabricate_command(
    asked: EffectorRequest, options: HolderOptions, step: bool, answer: Answer
) -> None:
    """Write holders and muscle fittings as STL, and a drilling template.

    The template is an SVG at true scale with a line to check the print. The thesis's offset of 4 mm
    needs a wider holder than its 9 mm, 10.6 mm at least: --holder-diameter 11mm, for example. As
    printed, without that offset, --offset 3.1mm --seat-depth 0mm fits in 9 mm.
    """
    from ..fabricate import write_holders

    summary = write_holders(
        asked.effector.design, answer.target, options=options, step=step, force=answer.force
    )
    result = {"output": answer.target, **summary, **asked.describe()}
    _give(result, answer=answer, text=format_parts(summary, answer.target))

"""``bozzini effector``: pressures to a pose and back, workspace, curves, traces, studies."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..checks import check_number
from ..errors import InputError
from ._muscle_options import (
    FIELDS,
    Answer,
    answer_options,
    describe_muscle,
    make_class,
    model_option,
    model_options,
)
from .common import (
    EXIT_NEGATIVE,
    PICTURES,
    QuantityType,
    VectorType,
    format_csv,
    format_rows,
    progress_bar,
    quiet_option,
    run_exit,
)

if TYPE_CHECKING:
    from ..effector import (
        Balance,
        CubicFit,
        Effector,
        EffectorDesign,
        EffectorPose,
        Sweep,
        SweepRow,
        Trace,
        Workspace,
    )
    from ..effector.pose import PoseMethod

# What the commands of ``bozzini effector`` share: options of a design, named values.

# What the commands of ``bozzini effector`` share: options of a design, named values, tables.


LENGTHS = {
    "offset": "Distance of the muscles from the axis (prototype: 4 mm).",
    "backbone_length": "Length of the backbone and of the muscles (prototype: 45 mm).",
    "holder_length": "Length of the straight holder beyond the backbone (prototype: 10 mm).",
}

_Function = Callable[..., Any]
Given = Mapping[str, Any]
"""The options of a design, by their names."""


_OPTIONS = {
    "preset": click.option(
        "--preset",
        default="prototype",
        show_default=True,
        metavar="NAME",
        help="Where the design begins: prototype.",
    ),
    "muscle_preset": click.option(
        "--muscle-preset",
        metavar="NAME",
        help="The muscles, by a name of bozzini muscle (prototype: fitted-45).",
    ),
    "angles": click.option(
        "--angles",
        metavar="NAME=ANGLE,...",
        help="The muscles, such as A=0deg,B=120deg,C=240deg "
        "(prototype: R=307.5deg,G=219deg,B=75deg).",
    ),
    **{
        name: click.option(
            "--" + name.replace("_", "-"), name, type=QuantityType("length"), help=text
        )
        for name, text in LENGTHS.items()
    },
    "segments": click.option(
        "--segments",
        type=int,
        help="Turns of the outer spring: part of the design, no mesh (prototype: 15).",
    ),
    "rigidity": click.option(
        "--rigidity",
        type=QuantityType("rigidity"),
        help="Flexural rigidity without a catheter (prototype: 200 N mm^2).",
    ),
    "rigidity_test": click.option(
        "--rigidity-test", metavar="FORCE,DEFLECTION", help="The same, from a load across the tip."
    ),
    "catheter": click.option(
        "--catheter",
        type=QuantityType("rigidity"),
        help="Flexural rigidity of the catheter; adds (prototype: 0).",
    ),
    "pressure_limit": click.option(
        "--pressure-limit",
        type=QuantityType("pressure"),
        help="Largest pressure of a muscle (prototype: 0.827 MPa).",
    ),
    "beam": click.option(
        "--beam",
        type=click.Choice(["2", "3"]),
        help="Beam formula M L^2 / (BEAM E I): 3 as printed, 2 as derived (prototype: 3).",
    ),
}
_MODEL = ("model_name", "ends", "load_path")


def effector_options(function: _Function) -> _Function:
    """Add the options of a design and of the muscle model; they arrive as one mapping, `given`."""

    @wraps(function)
    def run(**values: Any) -> Any:
        given = {name: values.pop(name) for name in (*_OPTIONS, *_MODEL)}
        return function(given=given, **values)

    model_option(model_options(run))
    for option in reversed(_OPTIONS.values()):
        option(run)
    return run


def make_design(given: Given) -> EffectorDesign:
    """Return the design that the options ask for."""
    from ..effector import PlacedMuscle, effector_preset, rigidity_from_test
    from ..muscle.design import preset as muscle_preset
    from ..units import parse_quantity

    design = effector_preset(given["preset"])
    placed = list(design.muscles)
    if given["angles"] is not None:
        angles = parse_pairs("--angles", given["angles"], "angle", example="A=0deg,B=120deg")
        muscle = placed[0].muscle
        placed = [PlacedMuscle(name=name, muscle=muscle, angle=angles[name]) for name in angles]
    if given["muscle_preset"] is not None:
        muscle = muscle_preset(given["muscle_preset"])
        placed = [replace(item, muscle=muscle) for item in placed]
    length = given["backbone_length"]
    length = placed[0].muscle.length if length is None else length
    placed = [replace(item, muscle=item.muscle.replace(length=length)) for item in placed]
    names = ("offset", "holder_length", "segments", "pressure_limit")
    changes = {name: given[name] for name in names if given[name] is not None}
    changes["backbone_length"] = length
    for option, name in (("rigidity", "flexural_rigidity"), ("catheter", "catheter_rigidity")):
        if given[option] is not None:
            changes[name] = given[option]
    if given["beam"] is not None:
        changes["beam_factor"] = float(given["beam"])
    if given["rigidity_test"] is not None:
        parts = given["rigidity_test"].split(",")
        if given["rigidity"] is not None:
            raise InputError("--rigidity and --rigidity-test both give the stiffness: give one")
        if len(parts) != 2:
            raise InputError(
                f"--rigidity-test is '{given['rigidity_test']}': it must be FORCE,DEFLECTION, "
                "such as 0.1N,15mm"
            )
        changes["flexural_rigidity"] = rigidity_from_test(
            parse_quantity(parts[0], "force"), parse_quantity(parts[1], "length"), length=length
        )
    return design.replace(muscles=tuple(placed), **changes)


def make_effector(given: Given) -> Effector:
    """Return the effector that the options ask for, with its muscle model."""
    from ..effector import Effector

    model = make_class(given["model_name"], ends=given["ends"], load_path=given["load_path"])
    return Effector(make_design(given), model)


def parse_pairs(
    option: str, text: str, kind: str, *, names: Sequence[str] | None = None, example: str
) -> dict[str, float]:
    """Return ``NAME=QUANTITY,NAME=QUANTITY`` as a mapping.

    Raises
    ------
    InputError
        If a part has no ``=``, a name comes twice, or is not among `names`.
    """
    from ..units import parse_quantity

    found: dict[str, float] = {}
    for part in text.split(","):
        name, mark, value = (word.strip() for word in part.partition("="))
        if not (name and mark and value):
            raise InputError(
                f"{option} has the part '{part.strip()}': it must be NAME={kind.upper()}, such as "
                f"{example}"
            )
        if names is not None and name not in names:
            raise InputError(
                f"{option} names '{name}': the muscles of this design are {', '.join(names)}"
            )
        if name in found:
            raise InputError(f"{option} names '{name}' more than once: give each muscle once")
        found[name] = parse_quantity(value, kind)
    return found


def describe_design(design: EffectorDesign) -> dict[str, Any]:
    """Return a design as plain values, with units in the names."""
    from ..effector import find_conflicts

    return {
        "muscles": {
            placed.name: {"angle_rad": placed.angle, **describe_muscle(placed.muscle)}
            for placed in design.muscles
        },
        "offset_mm": design.offset,
        "backbone_length_mm": design.backbone_length,
        "segments": design.segments,
        "flexural_rigidity_Nmm2": design.flexural_rigidity,
        "catheter_rigidity_Nmm2": design.catheter_rigidity,
        "holder_length_mm": design.holder_length,
        "pressure_limit_MPa": design.pressure_limit,
        "beam_factor": design.beam_factor,
        "compliance_mm_per_N": design.compliance,
        "conflicts": find_conflicts(design),
    }


def report(
    result: Mapping[str, Any], *, answer: Answer, text: str, notes: Sequence[str] = ()
) -> None:
    """Write a result on stdout, and what is to be known of it and of its design on stderr.

    With ``--json`` it is all in the object: ``notes``, and the design's ``conflicts``.
    """
    answer.give({**result, "notes": list(notes)}, text)
    if not answer.as_json:
        for line in (*notes, *result["design"]["conflicts"]):
            click.echo(f"note: {line}", err=True)


# Ranges and lists of values that ``bozzini effector study`` reads.


KINDS = {
    "offset": "length",
    "length": "length",
    "flexural_rigidity": "rigidity",
    "catheter_rigidity": "rigidity",
    "pressure_limit": "pressure",
    **{f"muscle.{name}": item.kind for name, item in FIELDS.items() if name != "length"},
}
"""What has a range of numbers, and the kind of quantity."""
UNITS = {"length": "mm", "rigidity": "Nmm2", "pressure": "MPa", "angle": "rad"}
MOST = 10_000
MOST_SEGMENTS = 1000
_WHOLE = "muscle.strands"


def _split(option: str, item: str, form: str) -> tuple[str, str]:
    name, mark, values = (part.strip() for part in item.partition("="))
    name = name.replace("-", "_")
    if not (name and mark and values):
        raise InputError(f"{option} is '{item}': it must be {form}")
    return name, values


def _parse_number(option: str, name: str, text: str) -> float:
    from ..units import parse_quantity

    if name not in KINDS:
        raise InputError(f"{option} names '{name}': choose one of {', '.join(KINDS)}")
    return parse_quantity(text, KINDS[name])


def parse_values(item: str) -> tuple[str, list[Any]]:
    """Return the name and the values of one ``--vary``."""
    import numpy as np

    from ..units import parse_quantity

    name, values = _split("--vary", item, "NAME=LOW:HIGH:COUNT or NAME=VALUE,VALUE")
    if name == "segments":
        return name, parse_segments(values)
    if name == "angles":
        return name, [
            tuple(parse_quantity(angle, "angle") for angle in part.split("/"))
            for part in values.split(",")
        ]
    if name not in KINDS:
        known = ", ".join([*KINDS, "segments", "angles"])
        raise InputError(f"--vary names '{name}': choose one of {known}")
    if ":" not in values:
        return name, [_parse_number("--vary", name, part) for part in values.split(",")]
    parts = values.split(":")
    if len(parts) != 3 or not parts[2].strip().isdigit() or not 2 <= int(parts[2]) <= MOST:
        raise InputError(
            f"--vary is '{item}': it must be NAME=LOW:HIGH:COUNT with a whole COUNT in [2, {MOST}]"
        )
    low, high = (_parse_number("--vary", name, part) for part in parts[:2])
    steps = np.linspace(low, high, int(parts[2])).tolist()
    if name == _WHOLE and not all(step == round(step) for step in steps):
        raise InputError(
            f"--vary is '{item}': this gives {steps[1]:g} {name.removeprefix('muscle.')}, where "
            "only whole numbers are legal"
        )
    return name, steps


def parse_range(item: str) -> tuple[str, float, float]:
    """Return the name and the two ends of one ``--between``."""
    name, values = _split("--between", item, "NAME=LOW:HIGH")
    parts = values.split(":")
    if len(parts) != 2:
        raise InputError(f"--between is '{item}': it must be NAME=LOW:HIGH")
    low, high = (_parse_number("--between", name, part) for part in parts)
    return name, low, high


def parse_segments(text: str) -> list[int]:
    """Read numbers of segments, separated by commas."""
    parts = [part.strip() for part in text.split(",")]
    if not all(
        part.isascii() and part.isdigit() and len(part) < 9 and 1 <= int(part) <= MOST_SEGMENTS
        for part in parts
    ):
        raise InputError(
            f"segments is '{text}': it must be whole numbers in [1, {MOST_SEGMENTS}], as 12,15"
        )
    return [int(part) for part in parts]


def add_unit(name: str) -> str:
    """Return a column's name with its unit."""
    unit = UNITS.get(KINDS.get(name, ""), "")
    return f"{name}_{unit}" if unit else name


# ``bozzini effector workspace`` and ``curve``: what the tip can reach, and each muscle's curve.


@click.command("workspace")
@click.option(
    "--of",
    "kind",
    type=click.Choice(["place", "force"]),
    default="place",
    show_default=True,
    help="Where the tip can go, or how hard it can press in each direction.",
)
@click.option(
    "--at",
    type=VectorType("length", size=2),
    metavar="X,Y",
    help="With --of force: where something holds the tip (default: 0,0).",
)
@effector_options
@answer_options(".csv", *PICTURES, text="A table (.csv) or a picture.")
def workspace_command(
    kind: str,
    at: tuple[float, ...] | None,
    given: Given,
    answer: Answer,
) -> None:
    """Find where the tip can go, and what it can press with.

    The table has the boundary, seen along the axis and in space, or the force over the direction.

    Exit code 0: done; 1: the tip cannot be at --at; 2: bad input.
    """
    if at is not None and kind != "force":
        raise InputError("--at has no effect without --of force: leave it out")
    out = answer.out
    effector = make_effector(given)
    if kind == "force":
        result, text = _find_force(effector, at or (0.0, 0.0), out)
    else:
        result, text = _find_places(effector, out)
    result |= {"model": given["model_name"], "design": describe_design(effector.design)}
    found = bool(result.get("reachable", True))
    report(result | {"of": kind, "file": out if found else None}, answer=answer, text=text)
    if not found:
        run_exit(EXIT_NEGATIVE)


@click.command("curve")
@click.option("--points", default=84, show_default=True, help="Rows of the table.")
@click.option(
    "--cubic-from",
    type=QuantityType("pressure"),
    help="Fit the thesis's cubic from this pressure on, and show how far it is off.",
)
@effector_options
@answer_options(".csv", *PICTURES, text="A table (.csv) or a picture.")
def curve_command(
    points: int,
    cubic_from: float | None,
    given: Given,
    answer: Answer,
) -> None:
    """Compute the deflection by each muscle alone over its pressure.

    The table goes to stdout, unless --out names a file. Where the backbone is at its largest
    deflection the curve is flat: the column saturated is 1 there, and a note gives from where on.

    Exit code 0: done; 1: an equilibrium was not found; 2: bad input.
    """
    import numpy as np

    from ..checks import check_integer
    from ..effector import balance, fit_cubic
    from ..io.files import write_text

    out = answer.out
    check_integer("points", points, low=2, high=100_000)
    effector = make_effector(given)
    names = effector.design.names
    over = np.linspace(0.0, effector.design.pressure_limit, points)
    found = {name: balance(effector, name, over) for name in names}
    columns: dict[str, Any] = {"pressure_MPa": over}
    for name in names:
        columns[f"deflection_{name}_mm"] = found[name].lateral
        columns[f"contraction_{name}_mm"] = found[name].contraction
        columns[f"force_{name}_N"] = found[name].force
        columns[f"saturated_{name}"] = found[name].saturated
    notes, solved = _judge_curves(found)
    cubics = {}
    if cubic_from is not None:
        cubics = {name: fit_cubic(effector, name, start=cubic_from) for name in names}
    table = format_csv(columns)
    lines = [
        f"cubic of {name} from {1e3 * fit.start:g} kPa: {fit.rms_error:.3f} mm rms, "
        f"{fit.largest_error:.3f} mm at most"
        + (f"; fitted up to {1e3 * fit.limit:.4g} kPa, flat beyond" if fit.saturated else "")
        + ("" if fit.monotone else "; falls in places")
        for name, fit in cubics.items()
    ]
    if out is None:
        lines = [table.rstrip("\n"), *(f"# {line}" for line in lines)]
    elif out.suffix.lower() == ".csv":
        write_text(out, table)
    else:
        from ..plot import write_figure
        from ..plot.effector import draw_deflection

        write_figure(draw_deflection(effector, cubics=cubics), out)
    if out is not None:
        lines.insert(0, f"{out}: deflection over pressure, {points} points")
    result = {
        "model": given["model_name"],
        "columns": columns,
        "cubics": {
            name: {
                "coefficients": fit.coefficients,
                "from_MPa": fit.start,
                "to_MPa": fit.limit,
                "saturated": fit.saturated,
                "rms_error_mm": fit.rms_error,
                "largest_error_mm": fit.largest_error,
                "monotone": fit.monotone,
            }
            for name, fit in cubics.items()
        },
        "design": describe_design(effector.design),
        "file": out,
    }
    report(result, answer=answer, text="\n".join(lines), notes=notes)
    if not solved:
        run_exit(EXIT_NEGATIVE)


def _judge_curves(found: Mapping[str, Balance]) -> tuple[list[str], bool]:
    """Return the notes on curves, and whether every equilibrium was found."""
    notes, solved = [], True
    for name, curve in found.items():
        lost = curve.saturated | ~curve.converged
        for which in (curve.saturated, lost & ~curve.saturated):
            if which.any():
                first = int(which.argmax())
                over = 1e3 * float(curve.pressure[first])
                notes.append(f"muscle {name} from {over:.4g} kPa on: {curve.reason[first]}")
        solved &= not bool((lost & ~curve.saturated).any())
    return notes, solved


def _find_places(effector: Effector, out: Path | None) -> tuple[dict[str, Any], str]:
    from ..effector import workspace

    found = workspace(effector)
    if out is not None:
        _write_places(effector, found, out)
    names, amplitudes = effector.design.names, found.reach.amplitudes
    result = {
        "amplitudes_mm": dict(zip(names, amplitudes.tolist(), strict=True)),
        "saturated": dict(zip(names, found.reach.saturated.tolist(), strict=True)),
        "largest_deflection_mm": found.reach.peak,
        "inner_radius_mm": found.inner_radius,
        "outer_radius_mm": found.outer_radius,
        "area_mm2": found.area,
        "tip_area_mm2": found.tip_area,
        "gaps": found.reach.sectors.describe_gaps(effector.design.names),
        "boundary_mm": found.boundary,
        "boundary_tip_mm": found.boundary_tip,
        "boundary_holder_tip_mm": found.boundary_holder_tip,
    }
    lines = [
        f"in every direction {found.inner_radius:.2f} mm, at most {found.outer_radius:.2f} mm; "
        f"{found.area:.1f} mm^2 seen along the axis, {found.tip_area:.1f} mm^2 in space",
        format_rows(
            ["muscle", "alone [mm]", "towards [deg]"],
            [
                [name, f"{amplitudes[k]:.2f}", f"{math.degrees(placed.angle):.1f}"]
                for k, (name, placed) in enumerate(zip(names, effector.design.muscles, strict=True))
            ],
        ),
    ]
    full = [name for k, name in enumerate(names) if found.reach.saturated[k]]
    if full:
        lines.append(
            f"saturated: {', '.join(full)} could go on, but the backbone is at "
            f"{found.reach.peak:.4g} mm, {found.reach.peak_reason}"
        )
    if result["gaps"]:
        lines.append(f"not reached: {result['gaps']}")
    return result, "\n".join(lines)


def _write_places(effector: Effector, found: Workspace, out: Path) -> None:
    from ..io.files import write_text

    if out.suffix.lower() != ".csv":
        from ..plot import write_figure
        from ..plot.effector import draw_workspace

        write_figure(draw_workspace(effector, found), out)
        return
    columns = {"x_mm": found.boundary[:, 0], "y_mm": found.boundary[:, 1]}
    for name, points in (("tip", found.boundary_tip), ("holder_tip", found.boundary_holder_tip)):
        columns |= {f"{name}_{axis}_mm": points[:, k] for k, axis in enumerate("xyz")}
    write_text(out, format_csv(columns))


def _find_force(
    effector: Effector, at: tuple[float, ...], out: Path | None
) -> tuple[dict[str, Any], str]:
    import numpy as np

    from ..effector import passive_stiffness, solve_inverse, tip_force, tip_stiffness
    from ..io.files import write_text

    held = solve_inverse(effector, at)
    if not bool(held.reachable):
        text = f"the tip cannot be at {at[0]:g}, {at[1]:g} mm: {held.reason}"
        return {"at_mm": at, "reachable": False, "reason": str(held.reason)}, text
    angle = np.radians(np.arange(360.0))
    toward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = tip_force(effector, toward, lateral=at)
    stiffness = tip_stiffness(effector, held.pressures)
    passive = passive_stiffness(effector.design)
    if out is not None and out.suffix.lower() == ".csv":
        write_text(out, format_csv({"direction_rad": angle, "force_N": found.force}))
    elif out is not None:
        from ..plot import write_figure
        from ..plot.effector import draw_force

        write_figure(draw_force(effector, lateral=at), out)
    names = effector.design.names
    result = {
        "at_mm": at,
        "reachable": True,
        "direction_rad": angle,
        "force_N": found.force,
        "pulls_N": dict(zip(names, found.pulls.tolist(), strict=True)),
        "stiffness_N_per_mm": stiffness,
        "passive_stiffness_N_per_mm": passive,
    }
    low, high = int(np.argmin(found.force)), int(np.argmax(found.force))
    text = (
        f"held at {at[0]:g}, {at[1]:g} mm the tip presses with {found.force[low]:.3f} N "
        f"(towards {low} deg) to {found.force[high]:.3f} N (towards {high} deg); "
        f"stiffness without pressure {passive:.4g} N/mm"
    )
    return result, text


# ``bozzini effector trace``: the tip along a line or round a circle.


_PLACE = VectorType("length", size=2)

cubic_option = click.option(
    "--cubic-from",
    type=QuantityType("pressure"),
    help="Pressures from a cubic fitted from this pressure on, as in the thesis's controller.",
)


@click.group("trace")
def trace_command() -> None:
    """Follow a line or a circle with the tip, seen along the axis.

    Exit code 0: all of it; 1: parts are out of reach or not solved; 2: bad input.
    """


@trace_command.command("line")
@click.option("--from", "start", type=_PLACE, metavar="X,Y", required=True, help="Where it begins.")
@click.option("--to", "end", type=_PLACE, metavar="X,Y", required=True, help="Where it ends.")
@click.option("--points", default=51, show_default=True, help="Targets, both ends included.")
@cubic_option
@effector_options
@answer_options(".csv", *PICTURES, text="A table (.csv) or a picture.")
def line_command(
    start: tuple[float, ...],
    end: tuple[float, ...],
    points: int,
    cubic_from: float | None,
    given: Given,
    answer: Answer,
) -> None:
    """Follow a straight line."""
    from ..effector import trace_line

    _check_points(points, low=2)
    effector = make_effector(given)
    found = trace_line(effector, start, end, steps=points, cubics=_fit(effector, cubic_from))
    _show(effector, found, given, answer)


@trace_command.command("circle")
@click.option("--radius", type=QuantityType("length"), required=True, help="Radius.")
@click.option(
    "--centre", type=_PLACE, metavar="X,Y", default="0,0", show_default=True, help="Centre."
)
@click.option(
    "--points",
    default=72,
    show_default=True,
    help="Targets round the circle; the first comes again at the end, to close it.",
)
@cubic_option
@effector_options
@answer_options(".csv", *PICTURES, text="A table (.csv) or a picture.")
def circle_command(
    radius: float,
    centre: tuple[float, ...],
    points: int,
    cubic_from: float | None,
    given: Given,
    answer: Answer,
) -> None:
    """Follow a circle, from +x counter-clockwise."""
    from ..effector import trace_circle

    _check_points(points, low=3)
    effector = make_effector(given)
    found = trace_circle(
        effector, radius, centre=centre, steps=points, cubics=_fit(effector, cubic_from)
    )
    _show(effector, found, given, answer)


def _check_points(points: int, *, low: int) -> None:
    from ..checks import check_integer

    check_integer("points", points, low=low, high=100_000)


def _fit(effector: Effector, cubic_from: float | None) -> dict[str, CubicFit] | None:
    from ..effector import fit_cubic

    if cubic_from is None:
        return None
    return {name: fit_cubic(effector, name, start=cubic_from) for name in effector.design.names}


def _show(effector: Effector, found: Trace, given: Given, answer: Answer) -> None:
    from ..io.files import write_text

    out = answer.out
    names = effector.design.names
    columns = {
        "target_x_mm": found.targets[:, 0],
        "target_y_mm": found.targets[:, 1],
        **{f"pressure_{name}_MPa": found.pressures[:, k] for k, name in enumerate(names)},
        "achieved_x_mm": found.achieved[:, 0],
        "achieved_y_mm": found.achieved[:, 1],
        "error_mm": found.error,
        "reachable": found.reachable,
    }
    table = format_csv(columns)
    count, reached = len(found.targets), int(found.reachable.sum())
    text = table.rstrip("\n")
    if out is not None:
        text = (
            f"{out}: {reached} of {count} targets in reach, largest error there "
            f"{found.reachable_error:.3g} mm"
        )
        if out.suffix.lower() == ".csv":
            write_text(out, table)
        else:
            from ..effector import workspace
            from ..plot import write_figure
            from ..plot.effector import draw_trace

            outline = workspace(effector).boundary
            write_figure(draw_trace(found, names, outline=outline), out)
    result = {
        "kind": found.kind,
        "pressure_map": found.pressure_map,
        "model": given["model_name"],
        "targets": count,
        "reachable": reached,
        "complete": found.complete,
        "converged": bool(found.converged.all()),
        "largest_error_mm": found.reachable_error,
        "largest_distance_mm": found.largest_error,
        "columns": columns,
        "design": describe_design(effector.design),
        "file": out,
    }
    notes = []
    if not found.complete:
        notes.append(
            f"{count - reached} of {count} targets are out of reach, the farthest by "
            f"{found.largest_error:.3g} mm"
        )
    if not found.converged.all():
        notes.append(f"not converged at {int((~found.converged).sum())} of {count} targets")
    report(result, answer=answer, text=text, notes=notes)
    if not (found.complete and found.converged.all()):
        run_exit(EXIT_NEGATIVE)


# ``bozzini effector study``: many designs side by side, and the one of least pressure.


deflection_option = click.option(
    "--deflection",
    type=QuantityType("length"),
    help="Deflection that every muscle alone must reach.",
)


@click.group("study")
def study_command() -> None:
    """Try many designs: sweep, least-pressure."""


@study_command.command("sweep")
@click.option(
    "--vary",
    "varied",
    multiple=True,
    required=True,
    metavar="NAME=VALUES",
    help="What to vary: LOW:HIGH:COUNT or values with commas, as offset=3mm:5mm:5, segments=12,15; "
    "for angles, sets of them: angles=0deg/120deg/240deg. Can be repeated.",
)
@deflection_option
@effector_options
@quiet_option
@answer_options(".csv", *PICTURES, text="A table (.csv) or a picture.")
def sweep_command(
    varied: tuple[str, ...],
    deflection: float | None,
    given: Given,
    quiet: bool,
    answer: Answer,
) -> None:
    """Try every combination of some values; designs that do not work are listed with the reason.

    Exit code 0: at least one design works; 1: none does; 2: bad input.
    """
    from ..effector import sweep

    out = answer.out
    effector = make_effector(given)
    parameters: dict[str, Sequence[Any]] = {}
    for item in varied:
        name, values = parse_values(item)
        if name in parameters:
            raise InputError(f"--vary names '{name}' more than once: give it once, with all values")
        parameters[name] = values
    total = 1
    for choices in parameters.values():
        total *= len(choices)
    if total > MOST:
        raise InputError(f"--vary asks for {total} designs: at most {MOST} are tried at once")
    wanted = 0.0
    if deflection is not None:
        wanted = check_number("deflection", deflection, low=0.0, low_open=True, unit="mm")
    with progress_bar(quiet=quiet) as progress:
        found = sweep(effector, parameters, deflection=wanted, progress=progress)
    columns = _list_columns(found)
    if out is not None:
        _write_sweep(found, columns, out)
    result = {
        "parameters": found.parameters,
        "deflection_mm": found.deflection,
        "designs": len(found.rows),
        "feasible": len(found.feasible),
        "columns": columns,
        "model": given["model_name"],
        "design": describe_design(effector.design),
        "file": out,
    }
    text = f"{out}: {len(found.feasible)} of {len(found.rows)} designs work"
    if out is None:
        *others, reason = columns
        rows = zip(*(map(_format_value, columns[name]) for name in others), strict=True)
        lines = format_rows(others, [list(row) for row in rows]).splitlines()
        ends = [reason, *columns[reason]]
        text = "\n".join(f"{a}  {b}".rstrip() for a, b in zip(lines, ends, strict=True))
    report(result, answer=answer, text=text)
    if not found.feasible:
        run_exit(EXIT_NEGATIVE)


@study_command.command("least-pressure")
@click.option(
    "--between",
    "ranges",
    multiple=True,
    required=True,
    metavar="NAME=LOW:HIGH",
    help="What may be changed, as offset=3mm:4.5mm; up to 4 times.",
)
@click.option(
    "--choose-segments", metavar="N,N,...", help="Numbers of segments to choose from, as 12,15,18."
)
@click.option(
    "--deflection",
    type=QuantityType("length"),
    required=True,
    help="Deflection that every muscle alone must reach.",
)
@effector_options
@quiet_option
@answer_options()
def least_command(
    ranges: tuple[str, ...],
    choose_segments: str | None,
    deflection: float,
    given: Given,
    quiet: bool,
    answer: Answer,
) -> None:
    """Find the design that reaches a deflection with the least pressure.

    Exit code 0: found; 1: no design within the ranges reaches it; 2: bad input.
    """
    from ..effector import optimise_design

    effector = make_effector(given)
    bounds: dict[str, tuple[float, float]] = {}
    for item in ranges:
        name, low, high = parse_range(item)
        if name in bounds:
            raise InputError(f"--between names '{name}' more than once: give each once")
        bounds[name] = (low, high)
    numbers = None if choose_segments is None else parse_segments(choose_segments)
    with progress_bar(quiet=quiet) as progress:
        found = optimise_design(
            effector, deflection, bounds=bounds, segments=numbers, progress=progress
        )
    result = {
        "success": found.success,
        "reason": found.reason,
        "deflection_mm": found.deflection,
        "changes": {add_unit(name): value for name, value in found.changes.items()},
        "pressure_MPa": found.pressure,
        "pressure_before_MPa": found.pressure_before,
        "evaluations": found.evaluations,
        "infeasible": found.infeasible,
        "model": given["model_name"],
        "design": describe_design(found.effector.design),
    }
    listed = ", ".join(f"{add_unit(name)} {value:.6g}" for name, value in found.changes.items())
    text = f"{1e3 * found.pressure:.2f} kPa with {listed}"
    if found.pressure_before > 0.0:
        text += f"; before {1e3 * found.pressure_before:.2f} kPa"
    text += f"\nnote: {found.reason}" if found.reason else ""
    if not found.success:
        text = f"no design: {found.reason}"
    report(result, answer=answer, text=text)
    if not found.success:
        run_exit(EXIT_NEGATIVE)


def _list_columns(found: Sweep) -> dict[str, list[Any]]:
    columns: dict[str, list[Any]] = {
        "angles_deg" if name == "angles" else add_unit(name): [
            _tell_angles(row.changes[name]) if name == "angles" else row.changes[name]
            for row in found.rows
        ]
        for name in found.parameters
    }
    columns |= {
        "feasible": [row.feasible for row in found.rows],
        "least_amplitude_mm": [_blank(row, row.least_amplitude) for row in found.rows],
        "largest_amplitude_mm": [_blank(row, row.largest_amplitude) for row in found.rows],
        "inner_radius_mm": [_blank(row, row.inner_radius) for row in found.rows],
        "area_mm2": [_blank(row, row.area) for row in found.rows],
    }
    if found.deflection > 0.0:
        # 0 is no pressure that anything needs: none reaches it.
        columns["needed_pressure_MPa"] = [row.needed_pressure or None for row in found.rows]
    columns["reason"] = [row.reason for row in found.rows]
    return columns


def _blank(row: SweepRow, value: float) -> float | None:
    """Return a number of a design, None if it cannot be built."""
    return value if row.built else None


def _tell_angles(angles: Sequence[float]) -> str:
    import math

    return "/".join(f"{math.degrees(angle):g}" for angle in angles)


def _format_value(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None:
        return "-"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _write_sweep(found: Sweep, columns: Mapping[str, Sequence[Any]], out: Path) -> None:
    from ..io.files import write_text
    from ..plot import write_figure
    from ..plot.effector import draw_sweep

    if out.suffix.lower() == ".csv":
        write_text(out, format_csv(columns))
    else:
        write_figure(draw_sweep(found), out)


# ``bozzini effector``: pressures to pose and back; traces, workspace and studies are beside.


SHOWN_ROWS = 15
"""Rows of an iteration table that are shown to people; the files and --json have all."""
ON_AXIS_MM = 5e-4
"""Deflection that is shown as none [mm]: it has no direction to speak of."""


@click.group("effector")
def command() -> None:
    """Bend a catheter tip by pneumatic muscles: pose, reach, workspace, traces, studies."""


@command.command("pose")
@click.option(
    "--pressure",
    required=True,
    metavar="NAME=PRESSURE,...",
    help="Gauge pressures, such as R=689.4kPa,G=413.6kPa; muscles left out have none.",
)
@click.option(
    "--method",
    type=click.Choice(["superposition", "thesis"]),
    default="superposition",
    show_default=True,
    help="How several muscles add up.",
)
@click.option(
    "--order",
    metavar="NAME,NAME",
    help="With --method thesis: which muscle is pressed first; by default as in the design.",
)
@click.option(
    "--table", "with_table", is_flag=True, help="The thesis's iteration of each muscle alone."
)
@effector_options
@answer_options(
    ".csv",
    *PICTURES,
    text="A picture, or the backbone as a table (.csv). With --table the picture or table of that.",
)
def pose_command(
    pressure: str,
    method: PoseMethod,
    order: str | None,
    with_table: bool,
    given: Given,
    answer: Answer,
) -> None:
    """Find where the tip goes under given pressures.

    Exit code 0: solved; 1: not solved, or the muscles demand more than the backbone can bend;
    2: bad input.
    """
    from ..effector import pose

    out = answer.out
    effector = make_effector(given)
    names = effector.design.names
    pressures = parse_pairs(
        "--pressure", pressure, "pressure", names=names, example="R=689.4kPa,G=413.6kPa"
    )
    names_in_order = None if order is None else [word.strip() for word in order.split(",")]
    found = pose(effector, pressures, method=method, order=names_in_order)
    tables, notes = _iterate(effector, pressures) if with_table else ({}, {})
    if with_table and out is not None and not tables:
        raise InputError(f"--table has nothing to write into {out}: {'; '.join(notes.values())}")
    if out is not None:
        _write_pose(effector, found, tables, out)
    result = {
        "method": method,
        "model": given["model_name"],
        "tip_mm": found.tip,
        "holder_tip_mm": found.holder_tip,
        "direction": found.direction,
        "lateral_mm": found.lateral,
        "lateral_vector_mm": found.lateral_vector,
        "azimuth_rad": found.azimuth,
        "demanded_lateral_mm": found.demanded_lateral,
        "saturated": bool(found.saturated),
        "converged": bool(found.converged),
        "reason": str(found.reason),
        "length_error_mm": found.length_error,
        "muscles": {
            name: {
                "pressure_MPa": found.pressures[k],
                "contraction_mm": found.contraction[k],
                "force_N": found.force[k],
                "iterations": found.iterations[k],
            }
            for k, name in enumerate(names)
        },
        "design": describe_design(effector.design),
        "file": out,
    }
    if with_table:
        result["tables"] = {name: _list_rows(table) for name, table in tables.items()}
        result["tables_converged"] = {
            name: name in tables and bool(tables[name].converged)
            for name, value in pressures.items()
            if value > 0.0
        }
    text = _format_pose(effector, found)
    for name, table in tables.items():
        text += f"\n\n{_format_table(name, pressures[name], table)}"
    report(result, answer=answer, text=text, notes=list(notes.values()))
    if bool(found.saturated) or not bool(found.converged):
        run_exit(EXIT_NEGATIVE)


@command.command("reach")
@click.option(
    "--to",
    "target",
    type=VectorType("length", size=2),
    required=True,
    metavar="X,Y",
    help="Where the tip shall be, seen along the axis, such as 12mm,-5mm.",
)
@effector_options
@answer_options(*PICTURES)
def reach_command(
    target: tuple[float, ...],
    given: Given,
    answer: Answer,
) -> None:
    """Find the pressures that bring the tip to a place seen along the axis.

    A target out of reach is answered by the farthest place in its direction.

    Exit code 0: reached; 1: out of reach, what is delivered instead is given; 2: bad input.
    """
    from ..effector import pose, solve_inverse

    out = answer.out
    effector = make_effector(given)
    names = effector.design.names
    found = solve_inverse(effector, target)
    posed = pose(effector, found.pressures)
    if out is not None:
        from ..effector import workspace
        from ..plot import write_figure
        from ..plot.effector import draw_pose

        write_figure(draw_pose(effector, posed, workspace=workspace(effector), target=target), out)
    result = {
        "target_mm": target,
        "reachable": bool(found.reachable),
        "delivered_mm": found.delivered,
        "reason": str(found.reason),
        "converged": bool(found.converged),
        "residual_mm": found.residual,
        "iterations": found.iterations,
        "tip_mm": posed.tip,
        "holder_tip_mm": posed.holder_tip,
        "muscles": {
            name: {
                "pressure_MPa": found.pressures[k],
                "displacement_mm": found.displacements[k],
                "contraction_mm": found.contraction[k],
                "force_N": found.force[k],
            }
            for k, name in enumerate(names)
        },
        "model": given["model_name"],
        "design": describe_design(effector.design),
        "file": out,
    }
    rows = [
        [
            name,
            f"{1e3 * float(found.pressures[k]):.2f}",
            f"{float(found.displacements[k]):.3f}",
            f"{float(found.contraction[k]):.3f}",
            f"{float(found.force[k]):.3f}",
        ]
        for k, name in enumerate(names)
    ]
    head = ["muscle", "pressure [kPa]", "displacement [mm]", "contraction [mm]", "force [N]"]
    text = format_rows(head, rows)
    x, y = (float(value) for value in found.delivered)
    if not bool(found.converged):
        text = f"not solved: {found.reason}\n{text}"
    elif bool(found.reachable):
        text = f"reached: tip at {x:.3f}, {y:.3f} mm\n{text}"
    else:
        wanted = f"{target[0]:g}, {target[1]:g} mm"
        text = f"out of reach: {wanted}; delivered {x:.3f}, {y:.3f} mm: {found.reason}\n{text}"
    report(result, answer=answer, text=text)
    if not (bool(found.reachable) and bool(found.converged)):
        run_exit(EXIT_NEGATIVE)


for _command in (workspace_command, curve_command, trace_command, study_command):
    command.add_command(_command)


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
                tables[name] = balance(effector, name, value, method="fixed-point")
            except InputError as error:  # the pose has its own root, which this does not touch
                notes[name] = f"no table, {error}"
    if not (tables or notes):
        notes[""] = "no table, no muscle is under pressure"
    return tables, notes


def _write_pose(
    effector: Effector, found: EffectorPose, tables: Mapping[str, Balance], out: Path
) -> None:
    from ..io.files import write_text

    if out.suffix.lower() == ".csv":
        if tables:
            rows = [
                (name, *row.values()) for name, table in tables.items() for row in _list_rows(table)
            ]
            head = ("muscle", "force_N", "contraction_mm", "lateral_mm", "next_force_N")
            write_text(out, format_csv(dict(zip(head, zip(*rows, strict=True), strict=True))))
            return
        line = found.backbone
        write_text(out, format_csv({"x_mm": line[:, 0], "y_mm": line[:, 1], "z_mm": line[:, 2]}))
        return
    from ..plot import effector as figures
    from ..plot import write_figure

    if tables:
        write_figure(figures.draw_iteration(tables), out)
    else:
        from ..effector import workspace

        write_figure(figures.draw_pose(effector, found, workspace=workspace(effector)), out)


def _list_rows(found: Balance) -> list[dict[str, float]]:
    names = ("force_N", "contraction_mm", "lateral_mm", "next_force_N")
    return [dict(zip(names, map(float, row), strict=False)) for row in found.table]


def _format_pose(effector: Effector, found: EffectorPose) -> str:
    x, y, z = (float(value) for value in found.tip)
    lateral, longer = float(found.lateral), float(found.length_error)
    azimuth = math.degrees(float(found.azimuth)) % 360.0
    where = f"{lateral:.3f} mm from the axis, towards {azimuth:.2f} deg"
    if lateral < ON_AXIS_MM:
        x, y, where = 0.0, 0.0, "on the axis"
    lines = [f"tip at {x:.3f}, {y:.3f}, {z:.3f} mm: {where}"]
    if abs(longer) > 1e-6:
        word = "longer" if longer > 0.0 else "shorter"
        lines.append(f"the eight steps make the backbone {abs(longer):.3g} mm {word}")
    if str(found.reason):
        lines.append(str(found.reason))
    rows = [
        [
            name,
            f"{1e3 * float(found.pressures[k]):.1f}",
            f"{float(found.contraction[k]):.3f}",
            f"{float(found.force[k]):.3f}",
            f"{int(found.iterations[k])}",
        ]
        for k, name in enumerate(effector.design.names)
    ]
    head = ["muscle", "pressure [kPa]", "contraction [mm]", "force [N]", "iterations"]
    return "\n".join([*lines, format_rows(head, rows)])


def _format_table(name: str, pressure: float, found: Balance) -> str:
    rows = [[f"{value:.4f}" for value in row.values()] for row in _list_rows(found)]
    if len(rows) > SHOWN_ROWS:
        rows = [*rows[: SHOWN_ROWS - 2], ["..."] * 4, rows[-1]]
    head = ["F [N]", "contraction [mm]", "deflection [mm]", "F* [N]"]
    lines = [f"muscle {name} alone at {1e3 * pressure:.1f} kPa, {len(found.table)} rows"]
    lines.append(format_rows(head, rows))
    if str(found.reason):
        lines.append(f"note: {found.reason}")
    return "\n".join(lines)

"""``bozzini continuum fit``: fit a robot to measured points of its body."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..continuum import DynamicsOptions
from ..errors import InputError
from ..io.sheets import parse_columns
from ..units import parse_quantity
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    OUTPUT,
    PICTURES,
    Answer,
    CheckedCommand,
    NameType,
    answer_options,
    check_target,
    gather,
    gather_once,
    option,
    options_of,
    run_exit,
    split_setting,
)

if TYPE_CHECKING:
    from ..checks import Quantity
    from ..continuum import ContinuumModel, ContinuumRobot
    from ..continuum.calibration import Marker
    from ..continuum.fit_search import RobotFitOptions
    from ..continuum.measured import RobotMeasurements
    from ..registry import Registry


def _list_models() -> Registry[ContinuumModel]:
    from ..continuum import CONTINUUM_MODELS

    return CONTINUUM_MODELS


@dataclasses.dataclass(frozen=True)
class FitTable:
    """How tables of measurements are read, as the options ask for it."""

    marker_texts: tuple[str, ...]
    column_texts: tuple[str, ...]
    blocks: str

    def list_markers(self) -> tuple[Marker, ...]:
        """Return the markers of ``--marker``."""
        markers = map(parse_marker, self.marker_texts)
        return tuple(gather_once("--marker", ((item.name, item) for item in markers)).values())

    def read(self, path: Path, robot: ContinuumRobot, *, timed: bool) -> RobotMeasurements:
        """Return the measurements in a file; markers of the robot hold unless they are typed."""
        from ..continuum.measured import read_robot_measurements

        return read_robot_measurements(
            path,
            robot=robot,
            markers=self.list_markers(),
            columns=parse_columns(self.column_texts),
            blocks=self.blocks,
            timed=timed,
        )


def _split(option_name: str, text: str, form: str) -> tuple[str, str]:
    """Return both parts of ``A=B``, names of the user's own as they are."""
    name, mark, value = (part.strip() for part in text.partition("="))
    if not (name and mark and value):
        raise InputError(f"{option_name} is '{text}': it must be {form}")
    return name, value


def parse_marker(text: str) -> Marker:
    """Return the marker of ``NAME=ARC,X,Y,Z``."""
    from ..continuum.calibration import Marker

    form = "NAME=ARC or NAME=ARC,X,Y,Z"
    name, value = _split("--marker", text, form)
    parts = [part.strip() for part in value.split(",")]
    if len(parts) not in (1, 4):
        raise InputError(f"--marker is '{text}': it must be {form}, such as m1=129.1mm,0mm,0mm,5mm")
    numbers = [parse_quantity(part, "length") for part in parts]
    x, y, z = numbers[1:] or (0.0, 0.0, 0.0)
    return Marker(name=name, arc_length=numbers[0], offset=(x, y, z))


table_options = gather(
    "table",
    FitTable,
    option(
        "--marker marker_texts NAME=ARC,X,Y,Z",
        "A point of the table: arc length of its cross-section, and where it is in that, such as "
        "m1=129.1mm,0mm,0mm,25mm; can be repeated. The column tip is the tip; markers of the robot "
        "file hold where the table has them.",
        multiple=True,
    ),
    option(
        "--column column_texts TITLE=OLD",
        "A title to read in place of one in the file, such as 'T1 tension [N]=load cell 1'; can be "
        "repeated.",
        multiple=True,
    ),
    option("--blocks", "Column with labels of rows that are left out together.", default=""),
)


def _make_options(**values: Any) -> RobotFitOptions:
    from ..continuum.fit_search import RobotFitOptions

    values["model"] = values["model"] or ""
    chosen, texts = values["model"], values.pop("settings")
    kinds = [_list_models()[chosen]] if chosen else list(_list_models().own.values())
    values["smaller"] = not values.pop("only")
    return RobotFitOptions(model_options=parse_settings(kinds, texts), **values)


def parse_settings(
    kinds: Sequence[type[ContinuumModel]], texts: Sequence[str], *, taken: Collection[str] = ()
) -> dict[str, object]:
    """Return options of models from ``NAME=VALUE``; those `taken` have options of their own."""
    known: dict[str, Quantity | None] = {}
    for item in (item for kind in kinds for item in dataclasses.fields(kind)):
        quantity = item.metadata.get("quantity")
        if item.name not in taken and (quantity or isinstance(item.default, bool)):
            known[item.name] = quantity
    found: dict[str, object] = {}
    for text in texts:
        name, value = split_setting("--set", text, "NAME=VALUE")
        if name not in known:
            raise InputError(f"--set names '{name}': the options are {', '.join(known) or 'none'}")
        if name in found:
            raise InputError(f"--set names '{name}' more than once: give it once")
        quantity = known[name]
        if quantity is None:
            if value not in ("true", "false"):
                raise InputError(f"--set {name} is '{value}': it must be true or false")
            found[name] = value == "true"
        elif quantity.words:
            found[name] = value
        else:
            number = parse_quantity(value, quantity.kind)
            found[name] = int(number) if quantity.whole and number.is_integer() else number
    return found


fit_options = gather(
    "options",
    _make_options,
    click.option(
        "--model",
        type=NameType("model", _list_models, show=True),
        help="By default energy for displacements, rod for tensions and under weight.",
    ),
    option(
        "--set settings NAME=VALUE",
        "An option of the model, such as between=3; can be repeated.",
        multiple=True,
    ),
    option(
        "--loss",
        "What of a misfit is summed; the first two count outliers less.",
        ("soft_l1", "huber", "linear"),
        default="soft_l1",
    ),
    option("--folds", "Blocks of rows left out of a fit in turn; 0 for none.", int, default=4),
    option(
        "--split",
        "What a block is: rows that follow each other, rows drawn at random, kinds of motion, by "
        "the sections that bend together, or how far sections bend, so that the last block is an "
        "extrapolation.",
        ("blocks", "random", "kinds", "amplitude"),
        default="blocks",
    ),
    click.option(
        "--residual",
        is_flag=True,
        help="Learn what the fit leaves over, on top of the model; it is not in the file.",
    ),
    click.option("--only", is_flag=True, help="Do not try fewer constants."),
    option("--jobs", "Processes at the same time.", int, default=1),
)


@click.command("fit", cls=CheckedCommand)
@click.argument("robot_file", metavar="ROBOT.yaml", type=INPUT)
@click.argument("data_file", metavar="DATA.csv", type=INPUT)
@option(
    "--free names NAME,...",
    "What is fitted, such as base,sections.each.bending_stiffness,tendons.*.stiffness.",
    default="",
)
@option(
    "--start",
    "auto frees base, stiffness, zeros, offsets, clocking and backlash in stages, as long as rows "
    "left out are predicted better, and says what each buys.",
    ("given", "auto"),
    default="given",
)
@table_options
@fit_options
@click.option("--in-time", is_flag=True, help="The rows are of a motion from rest, at 'time [s]'.")
@options_of(DynamicsOptions, "dynamics")
@option("--check others FILE", "Measurements to predict, not to fit; can be repeated.",
        INPUT, multiple=True)  # fmt: skip
@option("--figure FILE", "A picture of the distances over the rows.", OUTPUT)
@answer_options(".yaml", ".yml", ".json", help="The fitted robot (.yaml, .json).")
def command(
    robot_file: Path,
    data_file: Path,
    names: str,
    start: str,
    table: FitTable,
    options: RobotFitOptions,
    in_time: bool,
    dynamics: DynamicsOptions,
    others: tuple[Path, ...],
    figure: Path | None,
    answer: Answer,
) -> None:
    """Fit numbers of a robot to measured points of its body.

    DATA is a .csv or .parquet file with a column for each tendon, such as 'T1 displacement [mm]' or
    'T1 tension [N]', and three for each point, such as 'tip x [mm]'. An empty place was not seen.

    --free has paths as in the robot file: sections.2.bending_stiffness, tendons.T1.stiffness,
    base.position, base.rotation.x, markers.m1.arc_length, commands.scale, commands.backlash. In
    place of a name * is all with one number and each all with one each; sections.each.tendons.zero
    is one zero offset of displacements for the tendons of each section. Without --free the robot is
    compared as it is.

    With --in-time the table is of a motion that begins at rest under its first command, and
    motion.damping_time, motion.drag and motion.tip_weight can be free, from where the options of
    these names begin.

    The file of --out has all that was fitted, zeros, scale, backlash and markers too, and the
    model: pose, jacobian and reach heed them, and fit begins with them.

    Blocks of rows are left out in turn and predicted, by commands alone as well, and from them
    comes the band that holds 95 % of predictions. Whether fewer constants predict them better is
    reported, and what the data do not determine.

    Exit code 0: fitted; 1: not converged, not determined, or poor: off by more than 5 % of the
    robot's length or the span of the points, or by more than 1.2 times what commands alone are,
    beyond the scatter of the blocks; 2: bad input.
    """
    from ..continuum import ContinuumRobot
    from ..continuum.robot_fit import fit_robot
    from ..continuum.staged_fit import fit_in_stages
    from ..continuum.unknowns import RobotSetup

    if start == "auto" and names.strip():
        raise InputError(f"--free is '{names}': --start auto chooses what is free")
    check_target(figure, PICTURES, force=answer.force)
    robot = ContinuumRobot.from_yaml(robot_file)
    setup = RobotSetup.of(robot)
    if in_time:
        options = dataclasses.replace(options, dynamics=dynamics)
    elif dynamics != DynamicsOptions():
        raise InputError("how the robot moves is given without --in-time")
    data = table.read(data_file, robot, timed=in_time)
    checked = {path: table.read(path, robot, timed=in_time) for path in others}
    free = tuple(name for name in names.split(",") if name.strip())
    staged = None
    with answer.show_progress() as progress:
        if start == "auto":
            staged = fit_in_stages(setup, data, options=options, progress=progress)
            found = staged.fit
        else:
            found = fit_robot(setup, data, free=free, options=options, progress=progress)
    result, lines = found.to_dict(), [found.format_table()]
    if staged is not None:
        result |= staged.to_dict()
        lines = [staged.format_table(), *lines]
    lines += [f"note: {note}" for note in data.notes]
    result |= {"checks": {}, "notes": data.notes}
    for path, other in checked.items():
        there = found.check(other)
        result["checks"][str(path)] = there.to_dict()
        lines += there.format_lines(path.name)
    if answer.out is not None:
        found.robot.to_yaml(answer.out)
    if figure is not None:
        from ..plot import write_figure

        write_figure(found.plot(), figure)
    result |= {"robot": found.robot.to_dict(), "file": answer.out, "figure": figure}
    answer.give(result, "\n".join(lines))
    if not found.converged or found.undetermined or found.is_poor:
        run_exit(EXIT_NEGATIVE)

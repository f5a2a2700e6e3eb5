"""``bozzini muscle``: solve a muscle, compute its curves, list, fit and compare models."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..checks import check_integer, check_number, describe_fields, list_quantities, show_apart
from ..errors import BozziniError, InputError
from ..results import Json
from ..units import INTERNAL_UNITS
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    OUTPUT,
    PICTURES,
    Answer,
    CheckedGroup,
    NameType,
    answer_options,
    check_target,
    emit,
    format_csv,
    gather,
    json_option,
    option,
    progress_bar,
    refuse_options,
    run_exit,
    split_setting,
)
from .muscle_hysteresis import fit_command as fit_loop_command
from .muscle_hysteresis import invert_command, trace_command
from .muscle_options import (
    FIELDS,
    DataRequest,
    Request,
    check_friction,
    column_option,
    data_options,
    describe_model,
    directed_options,
    list_kinds,
    make_class,
    note_data,
    one_model_options,
    parse_constant,
    parse_settings,
    refuse_unused_fields,
    request_options,
    select_choices,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..muscle.model import MuscleModel
    from ..muscle.models import Card, Parameter
    from ..muscle.muscle_fit import Calibration, FitOptions
    from ..muscle.problem import Response
    from ..muscle.ranking import Criterion, LeaveOut, RankOptions

VERDICT = ("converged", "reason", "residual")
"""Keys that results have and an answer with models in it has not."""

_WARNED = 3  # so many models, the first, have the warnings of their fits shown


def format_quantity(kind: str, name: str, value: float) -> str:
    """Return a field of a muscle as text, an angle in degrees."""
    unit = INTERNAL_UNITS[kind]
    shown = f"{math.degrees(value):.4g} deg" if kind == "angle" else f"{value:.5g} {unit}".rstrip()
    return f"{name.replace('_', ' ')} {shown}"


def drop(values: Json, *names: str) -> Json:
    """Return values without some of them."""
    return {name: value for name, value in values.items() if name not in names}


@click.group("muscle", cls=CheckedGroup)
def command() -> None:
    """Solve a pneumatic muscle, list its models, and fit them to measurements."""


for _each in (fit_loop_command, trace_command, invert_command):
    command.add_command(_each)


@command.command("models")
@click.argument("name", required=False)
@json_option
def models_command(name: str | None, as_json: bool) -> None:
    """List the models of a muscle, or show all that is known of one.

    The status is how much of a model the survey holds: self-contained; corrected, with errata
    mended; fitted, with constants to fit; partial, with a law missing that the paper named has.
    """
    from ..muscle import MODELS
    from ..muscle.models import count_statuses, describe_card, describe_parameter

    if name is None:
        cards = list(MODELS.cards.values())
        own = [key for key in MODELS.own if key not in MODELS.cards]
        counts = count_statuses(cards)
        plugins = {key: point.value for key, point in MODELS.plugins.items()}
        broken = MODELS.broken
        listed = ", ".join(f"{count} {status}" for status, count in counts.items())
        lines = [
            *_format_cards(cards),
            f"{len(cards)} models of the literature: {listed}; and {' and '.join(own)}, this "
            "package's own",
            *(f"{key}: of the package {place}" for key, place in plugins.items()),
            *(f"broken: {reason}" for reason in broken.values()),
        ]
        result = {"own": own, "counts": counts, "models": [dataclasses.asdict(c) for c in cards]}
        result |= {"plugins": plugins} if plugins else {}
        result |= {"broken": broken} if broken else {}
        emit(result, as_json=as_json, text="\n".join(lines))
        return
    kind = MODELS.choose(name)
    card, parameters = kind.card, kind.list_parameters()
    if card is None and parameters:
        about = next(iter((kind.__doc__ or "").strip().splitlines()), "")
        plain = {
            "name": name,
            "title": about,
            "parameters": list(map(dataclasses.asdict, parameters)),
        }
        lines = [f"{name}: {about}", *map(describe_parameter, parameters)]
        emit(plain, as_json=as_json, text="\n".join(lines))
        return
    if card is None:
        whose = "of another package" if name in MODELS.plugins else "this package's own"
        raise InputError(f"the model {name} is {whose} and has no card: see its documentation")
    emit(dataclasses.asdict(card), as_json=as_json, text=describe_card(card))


def _format_cards(cards: list[Card]) -> list[str]:
    rows = [("model", "equation", "status", "")]
    rows += [(card.name, card.equation, card.status, card.title) for card in cards]
    wide = [max(len(row[i]) for row in rows) for i in range(3)]
    form = "{:<{}}  {:<{}}  {:<{}}  {}"
    return [
        form.format(a, wide[0], b, wide[1], c, wide[2], title).rstrip() for a, b, c, title in rows
    ]


@command.command("presets")
@json_option
def presets_command(as_json: bool) -> None:
    """List the muscles that --preset takes: what is known of each, and from where."""
    from ..muscle import PRESETS
    from ..muscle.design import Muscle

    lines, result = [], {}
    for name, item in PRESETS.items():
        muscle = item.muscle
        result[name] = {**describe_fields(muscle), "unset": muscle.unset, "source": item.source}
        neutral = Muscle(length=muscle.length, outer_radius=muscle.outer_radius).given
        known = [
            format_quantity(FIELDS[field].kind, field, value)
            for field, value in muscle.given.items()
            if field in ("length", "outer_radius") or value != neutral.get(field)
        ]
        unset = ", ".join(muscle.unset).replace("_", " ")
        lines += [f"{name}: {', '.join(known)}" + (f"; unset: {unset}" if unset else "")]
        lines += [f"    {item.source}"]
    emit({"presets": result}, as_json=as_json, text="\n".join(lines))


@command.command("solve")
@option("--pressure", "Gauge pressure.", "pressure", required=True)
@option("--load", "Tension held.", "force", default="0N")
@directed_options
@answer_options(quiet=False)
def solve_command(pressure: float, load: float, asked: Request, answer: Answer) -> None:
    """Find the contraction of a muscle at a pressure and a load.

    Exit code 0: solved; 1: no solution was found; 2: bad input.
    """
    model = asked.build(pressure=pressure)
    state = model.solve(pressure, load, direction=asked.direction).to_dict()
    band = float(model.dead_band())
    shape = ("contraction_mm", "length_mm", "braid_angle_rad", "contact_pressure_MPa")
    left = ("converged", "residual_N", "iterations", "reason")
    result = {
        "model": asked.model_name,
        "preset": asked.preset,
        "pressure_MPa": pressure,
        "load_N": load,
        "direction": asked.direction,
        **describe_model(model),
        **{name: state[name] for name in shape},
        "dead_band_MPa": band,
        **{name: state[name] for name in left},
        "muscle": describe_fields(asked.muscle),
    }
    text = (
        f"contraction {state['contraction_mm']:.4g} mm, length {state['length_mm']:.5g} mm, "
        f"braid angle {math.degrees(state['braid_angle_rad']):.2f} deg, "
        f"dead band {1e3 * band:.1f} kPa"
    )
    solved = state["converged"]
    answer.give(result, text if solved else f"no solution: {state['reason']}")
    if not solved:
        run_exit(EXIT_NEGATIVE)


@command.command("curve")
@option(
    "--of kind",
    "What over what: contraction or angle over pressure, force over contraction.",
    ("contraction", "force", "angle", "phases"),
    default="contraction",
)
@option(
    "--pressure", "Largest pressure; with --of force, the pressure.", "pressure", default="0.8MPa"
)
@option("--load", "Tension held; not with --of force (default: 0N).", "force")
@option("--points", "Rows of the table (default: 41).", int)
@directed_options
@answer_options(".csv", *PICTURES, help="A table (.csv) or a picture.", quiet=False)
def curve_command(
    kind: str,
    pressure: float,
    load: float | None,
    points: int | None,
    asked: Request,
    answer: Answer,
) -> None:
    """Compute a curve, as a table or a picture.

    The table goes to stdout, unless --out names a file. It begins without pressure, or at the
    lowest one at which the model holds the load.
    """
    is_picture = answer.out is not None and not answer.is_table
    if is_picture and points is not None:
        raise InputError("--points has no effect on a picture: leave it out, or write a .csv")
    if kind == "force" and load is not None:
        raise InputError("--load has no effect with --of force, which is over all loads")
    rows = check_integer("points", 41 if points is None else points, low=2, high=100_000)
    check_number("pressure", pressure, low=0.0, low_open=True, unit="MPa")
    model = asked.build(pressure=pressure)
    held = 0.0 if load is None else load
    line: Json = {"direction": asked.direction}
    if kind != "force":
        model.solve(pressure, held, direction=asked.direction)  # the error names the value given
        line |= {"load": held, "lowest": _find_lowest(model, pressure, held, asked.direction)}
    columns = _compute_curve(model, kind, pressure, rows, line)
    answer.write(columns, lambda: _draw_curve(model, kind, pressure, **line))
    text = format_csv(columns).rstrip("\n")
    if answer.out is not None:
        text = f"{answer.out}: {kind}" + ("" if is_picture else f", {rows} points")
    result = {
        "model": asked.model_name,
        "preset": asked.preset,
        "of": kind,
        "pressure_MPa": pressure,
        "load_N": None if kind == "force" else held,
        "direction": asked.direction,
        **describe_model(model),
        "dead_band_MPa": float(model.dead_band()),
        "file": answer.out,
        "columns": columns,
        "muscle": describe_fields(asked.muscle),
    }
    answer.give(result, text)


def _compute_curve(
    model: MuscleModel, kind: str, pressure: float, points: int, line: Mapping[str, Any]
) -> dict[str, object]:
    import numpy as np

    from ..muscle.design import LOCKING_ANGLE

    if kind == "force":
        free = float(model.contraction(pressure, 0.0, **line))
        lengthens = model.muscle.given.get("braid_angle", 0.0) > LOCKING_ANGLE
        if not (free > 0.0 or (lengthens and free < 0.0)):
            shown = show_apart(pressure, model.dead_band())
            raise InputError(
                f"pressure is {shown[0]} MPa: with --of force it must be more, so that the "
                f"muscle contracts (its dead band ends at {shown[1]} MPa)"
            )
        over = np.linspace(0.0, free, points)
        return {
            "contraction_mm": over,
            "force_N": model.force(pressure, over, **line),
            "stiffness_N_per_mm": model.stiffness(pressure, over, **line),
        }
    over = np.linspace(line["lowest"], pressure, points)
    found = model.solve(over, line["load"], direction=line["direction"]).list_columns()
    names = ["contraction_mm", "braid_angle_rad"]
    names += ["contact_pressure_MPa"] if kind == "phases" else []
    return {"pressure_MPa": over, **{name: found[name] for name in names}}


def _find_lowest(model: MuscleModel, pressure: float, load: float, direction: str | None) -> float:
    """Return the lowest pressure from which on, up to one, a model has an answer [MPa].

    Found by bisection: a gap in between is not found. It has to have one at the highest.
    """
    from ..muscle.compose import Bundle
    from ..muscle.models.base import ExplicitModel

    if isinstance(model, Bundle):
        return _find_lowest(model.models[0], pressure, load / len(model.models), direction)
    if not isinstance(model, ExplicitModel):
        return 0.0
    model.solve(pressure, load, direction=direction)

    def answers(at: float) -> bool:
        try:
            return bool(model.try_contraction(at, load, direction=direction)[1])
        except InputError:
            return False

    low, high = model.pressure_limits[0], pressure
    if answers(low):
        return low
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if answers(middle) else (middle, high)
    return high


def _draw_curve(model: MuscleModel, kind: str, pressure: float, **line: Any) -> Figure | Axes:
    from ..plot import muscle as figures

    if kind == "force":
        return figures.draw_force(model, [pressure], **line)
    if kind == "phases":
        return figures.draw_phases(model, pressure=pressure, **line)
    draw = figures.draw_braid_angle if kind == "angle" else figures.draw_contraction
    return draw({model.name: model}, pressure=pressure, **line)


@command.command("export")
@option("--pressure", "Largest pressure of a table (default: 0.8MPa).", "pressure")
@option("--points", "Pressures and contractions of a table, each (default: 41).", int)
@directed_options
@answer_options(
    ".c",
    ".py",
    ".csv",
    ".parquet",
    required=True,
    quiet=False,
    help="C, Python that needs NumPy alone, or a table of forces (.csv, .parquet).",
)
def export_command(
    pressure: float | None, points: int | None, asked: Request, answer: Answer
) -> None:
    """Write a model as C, as Python that needs NumPy alone, or as a lookup table.

    C and Python have muscle_force(pressure, contraction), muscle_contraction(pressure, load) and
    muscle_pressure(force, length), in MPa, mm and N; NaN where the model has no answer. A model
    without an explicit force law, as energy and thesis, gives a table only.
    """
    from ..muscle.export import export_muscle

    is_code = answer.target.suffix.lower() in (".c", ".py")
    for flag, value in (("--pressure", pressure), ("--points", points)):
        if is_code and value is not None:
            raise InputError(f"{flag} has no effect on code: leave it out")
    highest = 0.8 if pressure is None else pressure
    model = asked.build(pressure=highest)
    out = export_muscle(
        model,
        answer.target,
        direction=asked.direction,
        pressure=highest,
        points=41 if points is None else points,
    )
    result = {
        "model": asked.model_name,
        "preset": asked.preset,
        "direction": asked.direction,
        **describe_model(model),
        "file": out,
        "muscle": describe_fields(asked.muscle),
    }
    answer.give(result, f"{out}: the model {asked.model_name}")


@dataclass(frozen=True)
class SetupRequest:
    """What is fitted to what, beside the parameters, as the options ask for it."""

    response: Response | None
    each: str | None
    offset: float | None
    compliance: float | None
    slack_force: float | None
    anchored: bool

    @property
    def each_names(self) -> tuple[str, ...]:
        """The parameters that every specimen has its own value of."""
        return () if self.each is None else _name_fields(self.each)

    def make(self, asked: Request, **more: Any) -> FitOptions:
        """Return the options of a fit; end effects begin as in the muscle file, if there is one."""
        from ..muscle import EndEffects, FitOptions

        if self.anchored and self.offset is not None:
            raise InputError("--offset has no effect with --offset-from-length: give one of them")
        given = {name: getattr(self, name) for name in ("offset", "compliance", "slack_force")}
        is_own = asked.file is not None and asked.file.model in ("", asked.model_name)
        ends = (asked.file.ends if asked.file and is_own else None) or EndEffects()
        ends = ends.replace(**{name: value for name, value in given.items() if value is not None})
        return FitOptions(
            response=self.response, ends=ends, anchored=self.anchored, each=self.each_names, **more
        )

    def join(self, free: str | None) -> tuple[str, ...] | None:
        """Return all that is free: what is shared, and what each specimen has of its own."""
        if free is None:
            if self.each is not None:
                raise InputError("--each needs --shared: name what all specimens share as well")
            return None
        return (*_name_fields(free), *self.each_names)

    def describe(self) -> Json:
        """Return what was asked for, as plain values."""
        return {"each": self.each_names, "offset_from_length": self.anchored}


setup_options = gather(
    "setup",
    SetupRequest,
    option(
        "--response",
        "What the model is compared in: the force at pressure and length, the contraction at "
        "pressure and load, or the pressure at force and length (default: that of the data).",
        ("force", "contraction", "pressure"),
    ),
    option("--each NAME,...", "Free parameters that every specimen has a value of its own of."),
    option("--offset", "Measured contraction less the muscle's own at zero force.", "length"),
    option("--compliance", "By how much fittings and rig give, e.g. 0.01mm/N.", "compliance"),
    option("--slack-force", "Force that a slack muscle reads, the least one.", "force"),
    option(
        "--offset-from-length anchored",
        "Take each specimen's offset from its column of lengths without load, such as "
        "'length at 620 kPa [mm]'.",
        is_flag=True,
    ),
)


@command.command("fit")
@data_options
@click.option(
    "--free",
    "--shared",
    "free",
    metavar="NAME,...",
    help="Fields of the muscle, constants of the model and end effects (offset, compliance, "
    "slack-force) to fit, by commas, shared by all specimens; the options below are where "
    "they start (default: modulus,dead-length in energy, modulus,end-length in thesis, in others "
    "what is unknown of them).",
)
@option(
    "--bound bound_texts FIELD=LOW:HIGH",
    "Bounds of a field that is fitted, e.g. modulus=0.1MPa:2MPa; can be repeated.",
    multiple=True,
)
@option("--anyway", "Fit also what the data cannot distinguish.", is_flag=True)
@option(
    "--resamples",
    "Fits to rows drawn anew, for the errors of the parameters; 0 for linearised ones.",
    int,
    default=0,
)
@setup_options
@one_model_options
@option("--figure FILE", "A picture of the fit.", OUTPUT)
@answer_options(
    ".yaml", *PICTURES, quiet=False, help="The fit as a file for 'predict' (.yaml), or a picture."
)
def fit_command(
    table: DataRequest,
    free: str | None,
    bound_texts: tuple[str, ...],
    anyway: bool,
    resamples: int,
    setup: SetupRequest,
    asked: Request,
    figure: Path | None,
    answer: Answer,
) -> None:
    """Fit fields of a muscle, constants of a model and end effects to measurements.

    DATA is a .csv or .parquet file, see 'bozzini muscle compare --help'. Its columns may give
    geometry and errors of the specimens.

    Exit code 0: fitted; 1: fitted, but with warnings, a poor fit among them,
    or no minimum was found; 2: bad input.
    """
    from ..muscle import calibrate

    check_target(figure, PICTURES, force=answer.force)
    make, name = asked.make(), asked.model_name
    own = {item.name: item for item in list_kinds()[name].list_parameters()}
    bounds = _parse_bounds(bound_texts, own)
    names = setup.join(free)
    options = setup.make(asked, bounds=bounds, force=anyway, resamples=resamples)
    data = table.read(asked)
    check_friction(asked.fields, data, free=names or ())
    found = calibrate(make, asked.muscle, data=data, free=names, options=options)
    if answer.out is not None and answer.out.suffix.lower() == ".yaml":
        from ..muscle import write_muscle

        write_muscle(answer.out, found.to_file())
    else:
        answer.draw(lambda: _draw_fit(found))
    dataclasses.replace(answer, out=figure).draw(lambda: _draw_fit(found))
    choices = describe_model(getattr(found.fitted, "model", found.fitted))
    result = {
        "model": name,
        "preset": asked.preset,
        "ends": choices["ends"],
        "load_path": choices["load_path"],
        "set": asked.constants,
        "mean": table.take_mean,
        "anyway": anyway,
        "bounds": bounds,
        **setup.describe(),
        "rows": len(data),
        "ignored_columns": data.ignored,
        "notes": data.notes,
        **drop(found.to_dict(), "residual"),
        "file": answer.out,
        "figure": figure,
    }
    answer.give(result, note_data(data) + found.format_table())
    if not found.trusted:
        run_exit(EXIT_NEGATIVE)


def _draw_fit(found: Calibration) -> Figure | Axes:
    """Draw a fit: curves of contraction, or what was fitted over what was measured."""
    if found.response != "contraction" or len(found.models) > 1:
        return found.plot()
    from ..muscle import compare_models
    from ..plot.muscle import draw_models

    models, count = {found.model: found.fitted}, {found.model: len(found.free)}
    data = found.task.data
    return draw_models(compare_models(models, data, fitted=count, response="contraction"), models)


def _name_field(text: str) -> str:
    return text.strip().replace("-", "_")


def _name_fields(texts: str) -> tuple[str, ...]:
    return tuple(_name_field(part) for part in texts.split(","))


def _parse_bounds(
    texts: tuple[str, ...], own: Mapping[str, Parameter]
) -> dict[str, tuple[float, float]]:
    from ..muscle import EndEffects
    from ..units import parse_quantity

    kinds = {**FIELDS, **list_quantities(EndEffects)}
    bounds: dict[str, tuple[float, float]] = {}
    for text in texts:
        name, _, pair = text.partition("=")
        field, ends = _name_field(name), pair.split(":")
        if (field not in kinds and field not in own) or len(ends) != 2:
            raise InputError(
                f"--bound is '{text}': it must be FIELD=LOW:HIGH, such as modulus=0.1MPa:2MPa"
            )
        if field in bounds:
            raise InputError(f"--bound names {name.strip()} more than once: give it once")
        low, high = (
            parse_constant(own[field], end)
            if field in own
            else parse_quantity(end, kinds[field].kind)
            for end in ends
        )
        bounds[field] = low, high
    return bounds


@command.command("predict")
@click.argument("file", metavar="FIT.yaml", type=INPUT)
@click.argument("source", metavar="[TABLE]", type=INPUT, required=False)
@column_option
@option("--pressure", "Gauge pressure, without a table.", "pressure")
@option("--contraction", "Contraction, without a table.", "length")
@option("--load", "Tension held, without a table.", "force")
@option("--rest-length", "Rest length of the muscle (default: the file's).", "length")
@option(
    "--free-length free_text PRESSURE=LENGTH",
    "Length of this muscle without load at a pressure, for the zero offset, e.g. 620kPa=101mm.",
)
@option("--level", "Probability of the bands.", float, default=0.95)
@answer_options(".csv", *PICTURES, help="A table (.csv) or a picture.", quiet=False)
def predict_command(
    file: Path,
    source: Path | None,
    columns: tuple[str, ...],
    pressure: float | None,
    contraction: float | None,
    load: float | None,
    rest_length: float | None,
    free_text: str | None,
    level: float,
    answer: Answer,
) -> None:
    """Predict the response of a fitted muscle, also of one that was not measured.

    FIT.yaml is written by 'bozzini muscle fit --out'. The states are those of a TABLE, as 'bozzini
    muscle compare' takes them, or one that the options give. 'confidence' is half the width of the
    band of the mean, 'prediction' that of a single reading. Of a table that was measured, the error
    of the prediction is given as well, and that of each specimen.

    Exit code 0: predicted; 1: the model has no answer for some rows; 2: bad input.
    """
    import numpy as np

    from ..io.sheets import parse_columns
    from ..muscle import Measurements, predict, read_measurements, read_muscle

    fitted = read_muscle(file)
    muscle = fitted.muscle if rest_length is None else fitted.muscle.replace(length=rest_length)
    states = {"--pressure": pressure, "--contraction": contraction, "--load": load}
    given = [name for name, value in states.items() if value is not None]
    response = "" if fitted.fit is None else fitted.fit.response
    if source is not None:
        if given:
            raise InputError(f"{given[0]} has no effect with a table: leave it out")
        data = read_measurements(
            source,
            muscle=muscle,
            columns=parse_columns(columns),
            measured=response != "contraction",
        )
    else:
        refuse_options(("columns",), "without a table")
        own = {"force": "--load", "contraction": "--contraction", "pressure": "--pressure"}
        if own.get(response) in given:
            raise InputError(f"{own[response]} is what is predicted: leave it out")
        for name in states:
            if name not in given and name != own.get(response) and name != "--load":
                raise InputError(f"{name} is missing: give it, or a table of states")
        data = Measurements(
            pressure=np.array([pressure or 0.0]),
            contraction=np.array([contraction or 0.0]),
            load=np.array([load or 0.0]),
        )
    found = predict(
        fitted, data, length=rest_length, free_length=_parse_free_length(free_text), level=level
    )
    answer.write(found.list_columns(), found.plot)
    result = {
        "file": file,
        "model": fitted.model,
        "rest_length_mm": muscle.length,
        "rows": len(data),
        **found.to_dict(),
    }
    unit = found.task.unit
    lines = [] if answer.out else [format_csv(found.list_columns()).rstrip("\n")]
    if source is not None:
        result[f"rms_{unit}"], result["covered"] = found.residual, found.covered
        lines.append(
            f"rms {found.residual:.3g} {unit} against the table; {100.0 * found.covered:.0f} % of "
            f"its rows lie in the band of {100.0 * level:g} %"
        )
        apart = found.residual_by_specimen
        result[f"rms_by_specimen_{unit}"] = apart
        lines += [f"  {name}: {rms:.3g} {unit}" for name, rms in apart.items() if len(apart) > 1]
    lines += [found.reason] if found.reason else []
    answer.give({**result, "out": answer.out}, "\n".join(lines))
    if not found.converged:
        run_exit(EXIT_NEGATIVE)


def _parse_free_length(text: str | None) -> tuple[float, float] | None:
    from ..units import parse_quantity

    if text is None:
        return None
    name, value = split_setting("--free-length", text, "PRESSURE=LENGTH, such as 620kPa=101mm")
    return parse_quantity(name, "pressure"), parse_quantity(value, "length")


@dataclass(frozen=True)
class RankRequest:
    """Whether models are fitted and ranked, and how, as the options ask for it."""

    fit: bool
    free: str | None
    criterion: Criterion | None
    leave_out: LeaveOut | None
    folds: int | None
    seed: int | None
    jobs: int | None
    budget: float | None

    def choose(
        self, setup: SetupRequest, asked: Request, *, fit: bool, models: int
    ) -> RankOptions | None:
        """Return the options of a ranking; None without a fit, where none may be given."""
        from ..muscle import RankOptions

        if fit:
            jobs = (os.cpu_count() or 1) if self.jobs is None and models > _FEW_MODELS else 1
            names = setup.join(self.free)
            return RankOptions(
                fields=names,
                criterion=self.criterion or "aicc",
                leave_out=self.leave_out or "rows",
                folds=self.folds,
                jobs=min(self.jobs or jobs, 64),
                fit=setup.make(
                    asked, seed=self.seed or 0, budget=60.0 if self.budget is None else self.budget
                ),
            )
        given = (
            ("--free", self.free),
            ("--by", self.criterion),
            ("--leave-out", self.leave_out),
            ("--folds", self.folds),
            ("--seed", self.seed),
            ("--jobs", self.jobs),
            ("--budget", self.budget),
            ("--each", setup.each),
        )
        for flag, value in given:
            if value is not None:
                raise InputError(f"{flag} has no effect without --fit: leave it out")
        return None


_FEW_MODELS = 4  # so many are fitted in this process: another takes a second to start


rank_options = gather(
    "ranked",
    RankRequest,
    option(
        "--fit",
        "With --model, fit each model first, and rank: modulus, and dead length (energy) or "
        "end length (thesis); constants and modulus of the others.",
        is_flag=True,
    ),
    click.option(
        "--free",
        "--shared",
        "free",
        metavar="NAME,...",
        help="Of a fit, fields of the muscle to fit in each model that uses them, and end effects "
        "to fit in all (offset, compliance, slack-force), by commas; beside each model's own "
        "constants.",
    ),
    option(
        "--by criterion",
        "Of a fit, rank by an information criterion or by the rows left out (default: aicc).",
        ("aicc", "bic", "cv"),
    ),
    option(
        "--leave-out",
        "Of a fit, what is left out of it at a time, for validation: rows dealt at random, a "
        "specimen, or a level of pressure (default: rows).",
        ("rows", "specimen", "pressure"),
    ),
    option("--folds", "Of a fit, parts for cross-validation; 0 for none (default: 5).", int),
    option("--seed", "Of a fit, for folds and starts (default: 0).", int),
    option("--jobs", "Of a fit, models fitted at the same time (default: one per core).", int),
    option(
        "--budget",
        "Of a fit, processor time of a model, after which it is stopped (default: 60s).",
        "time",
    ),
)


@command.command("compare")
@data_options
@option(
    "--model model_names",
    "A model to compare; can be repeated (default: fit and rank all, see 'models').",
    NameType("model", list_kinds),
    multiple=True,
)
@rank_options
@setup_options
@request_options
@answer_options(*PICTURES, quiet=False)
def compare_command(
    table: DataRequest,
    model_names: tuple[str, ...],
    ranked: RankRequest,
    setup: SetupRequest,
    asked: Request,
    answer: Answer,
) -> None:
    """Compare models with measurements; without --model, fit and rank all that can be fitted.

    DATA is a .csv or .parquet file with the columns pressure, contraction or length and, if there,
    load, direction and specimen; their units stand in the header, as in 'pressure [kPa]'. More
    columns give geometry and errors. The standard error is also given as a percentage of the
    largest measured response. A row that a model has no answer for counts as the largest response.

    Models that are fitted are ranked: by AICc, which charges a model for its constants, unless --by
    asks otherwise. 'left out' is the error at rows left out of the fit.

    Exit code 0: compared; 1: no model has an answer, or the best one is poor: off by more than 5 %
    of the span of the measured response after the fit; 2: bad input. A picture is written only if a
    model has an answer.
    """
    from ..muscle import compare_models, rank

    broken = {} if model_names else list_kinds().broken
    names = list(dict.fromkeys(model_names or (n for n in list_kinds() if n not in broken)))
    options = ranked.choose(setup, asked, fit=ranked.fit or not model_names, models=len(names))
    choices = select_choices(names, ends=asked.ends, load_path=asked.load_path)
    refuse_unused_fields(names, asked.fields)
    constants = parse_settings(names, asked.settings)
    data = table.read(asked)
    check_friction(asked.fields, data, free=())
    makes = {name: make_class(name, **choices[name], constants=constants[name]) for name in names}
    result: dict[str, object] = {
        "rows": len(data),
        "preset": asked.preset,
        "mean": table.take_mean,
        "choices": choices,
        "set": constants,
        "ignored_columns": data.ignored,
        "notes": data.notes,
        "largest_contraction_mm": data.largest_contraction,
    }
    if options is None:
        models, refusals, ends = {}, broken, setup.make(asked).ends
        for name, make in makes.items():
            try:
                own = asked.list_file_constants(name)
                model = make(asked.muscle, **{**own, **constants[name]})
                models[name] = asked.mount(model, ends)
            except BozziniError as error:
                refusals[name] = str(error)
        found = compare_models(models, data, refusals=refusals, response=setup.response)

        def draw() -> Figure:
            from ..plot.muscle import draw_models

            return draw_models(found, models)

        answered, lines = found.converged, [found.format_table()]
        poor = False
        result |= {"response": found.response} | drop(found.to_dict(), *VERDICT)
    else:
        with progress_bar() as progress:
            ranking = rank(
                data,
                asked.muscle,
                models=makes,
                refusals=broken,
                options=options,
                progress=progress,
            )

        def draw() -> Figure:
            from ..plot.muscle import draw_ranking

            return draw_ranking(ranking)

        result |= drop(ranking.to_dict(), *VERDICT)
        answered, lines = ranking.converged, [ranking.format_table()]
        poor = ranking.is_poor
        for entry in ranking.models[:_WARNED]:
            fit = entry.calibration
            if fit is not None:
                words = [] if fit.converged else [f"not converged: {fit.reason}"]
                words += [f"warning: {text}" for text in fit.warnings]
                lines += [f"{entry.name}: {text}" for text in words]
    if answered:
        answer.write({}, draw)
    result |= {"file": answer.out if answered else None, "muscle": describe_fields(asked.muscle)}
    answer.give(result, note_data(data) + "\n".join(lines))
    if poor or not answered:
        run_exit(EXIT_NEGATIVE)

"""``bozzini muscle``: solve a muscle, compute its curves, list, fit and compare models."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ._muscle_options import (
    FIELDS,
    Answer,
    DataRequest,
    ModelType,
    Request,
    answer_options,
    check_fields,
    check_friction,
    data_options,
    describe_choices,
    describe_constants,
    describe_muscle,
    directed_options,
    find_card,
    gather,
    list_kinds,
    make_class,
    note_data,
    one_model_options,
    parse_constant,
    parse_settings,
    request_options,
    select_choices,
    unit_of,
)
from .common import (
    EXIT_NEGATIVE,
    PICTURES,
    QuantityType,
    emit,
    format_csv,
    json_option,
    progress_bar,
    run_exit,
)

if TYPE_CHECKING:
    from ..muscle.data import Measurements
    from ..muscle.design import Muscle
    from ..muscle.fit import Calibration
    from ..muscle.model import MuscleModel
    from ..muscle.models import Card, Parameter
    from ..muscle.ranking import Criterion, ModelScore, RankedModel, RankOptions

# ``bozzini muscle models``: what models there are, and the card of one.


@click.command("models")
@click.argument("name", required=False)
@json_option
def models_command(name: str | None, as_json: bool) -> None:
    """List the models of a muscle, or show all that is known of one.

    The status is how much of a model the survey holds: self-contained; corrected, with errata
    mended; fitted, with constants to fit; partial, with a law missing that the paper named has.
    """
    from ..errors import InputError
    from ..muscle import MODELS
    from ..muscle.models import count_statuses, describe_card

    if name is None:
        cards = list(MODELS.cards.values())
        own = [key for key in MODELS.own if key not in MODELS.cards]
        counts = count_statuses(cards)
        listed = ", ".join(f"{count} {status}" for status, count in counts.items())
        lines = [
            _format_table(cards),
            f"{len(cards)} models of the survey: {listed}; and {' and '.join(own)}, this package's "
            "own",
            *(f"{key}: of the package {point.value}" for key, point in MODELS.plugins.items()),
        ]
        result = {
            "own": own,
            "counts": counts,
            "models": [dataclasses.asdict(card) for card in cards],
        }
        if MODELS.plugins:
            result["plugins"] = {key: point.value for key, point in MODELS.plugins.items()}
        emit(result, as_json=as_json, text="\n".join(lines))
        return
    if name not in MODELS:
        raise InputError(f"there is no model '{name}': choose one of {', '.join(MODELS)}")
    card = MODELS[name].card
    if card is None:
        whose = "of another package" if name in MODELS.plugins else "this package's own"
        raise InputError(f"the model {name} is {whose} and has no card: see its documentation")
    emit(dataclasses.asdict(card), as_json=as_json, text=describe_card(card))


def _format_table(cards: list[Card]) -> str:
    rows = [("model", "equation", "status", "")]
    rows += [(card.name, card.equation, card.status, card.title) for card in cards]
    wide = [max(len(row[i]) for row in rows) for i in range(3)]
    return "\n".join(
        "  ".join(
            [*(cell.ljust(w) for cell, w in zip(row[:3], wide, strict=True)), row[3]]
        ).rstrip()
        for row in rows
    )


# ``bozzini muscle fit``: fields of a muscle from measurements.


@click.command("fit")
@data_options
@click.option(
    "--free",
    help="Fields of the muscle and constants of the model to fit, separated by commas; the options "
    "below are where fields start (default: modulus,dead-length in energy, modulus,end-length in "
    "thesis, in others what is unknown of them).",
)
@click.option(
    "--bound",
    "bound_texts",
    multiple=True,
    metavar="FIELD=LOW:HIGH",
    help="Bounds of a field that is fitted, e.g. modulus=0.1MPa:2MPa; can be repeated.",
)
@click.option("--anyway", is_flag=True, help="Fit also what the data cannot distinguish.")
@one_model_options
@answer_options(*PICTURES)
def fit_command(
    table: DataRequest,
    free: str | None,
    bound_texts: tuple[str, ...],
    anyway: bool,
    asked: Request,
    answer: Answer,
) -> None:
    """Fit fields of a muscle, and constants of a model, to measurements.

    DATA is a .csv or .parquet file, see 'bozzini muscle compare --help'.

    Exit code 0: fitted, and nothing speaks against the estimates; 1: fitted, but with warnings,
    or no minimum was found; 2: bad input.
    """
    from ..muscle import FitOptions, calibrate, compare_models

    muscle, model_name, make = asked.muscle, asked.model_name, asked.make()
    own = _list_constants(model_name)
    bounds = _parse_bounds(bound_texts, own)
    data = table.read(muscle)
    names = None if free is None else tuple(_name_field(part) for part in free.split(","))
    check_friction(asked.fields, data, free=names or ())
    found = calibrate(
        make, muscle, data, free=names, options=FitOptions(bounds=bounds, force=anyway)
    )
    if answer.out is not None:
        from ..plot import write_figure
        from ..plot.muscle import draw_models

        models = {model_name: found.fitted}
        comparison = compare_models(models, data, fitted={model_name: len(found.free)})
        write_figure(draw_models(comparison, models), answer.out)
    result = {
        "model": model_name,
        "preset": asked.preset,
        **describe_choices(found.fitted),
        "set": asked.constants,
        "held": found.held,
        "mean": table.take_mean,
        "anyway": anyway,
        "bounds": bounds,
        "rows": len(data),
        "ignored_columns": data.ignored,
        "notes": data.notes,
        "estimates": {
            name: {
                "value": found.estimates[name],
                "unit": _find_unit(name, own),
                "standard_error": found.standard_errors[name],
                "interval_95": found.intervals[name],
            }
            for name in found.free
        },
        "correlations": found.correlations,
        "condition": found.condition,
        "sigma_mm": found.sigma,
        "warnings": found.warnings,
        "converged": found.converged,
        "reason": found.reason,
        "muscle": describe_muscle(found.muscle),
        "file": answer.out,
    }
    answer.give(result, note_data(data) + _format_fit(found, own))
    if not found.trusted:
        run_exit(EXIT_NEGATIVE)


def _name_field(text: str) -> str:
    return text.strip().replace("-", "_")


def _list_constants(name: str) -> dict[str, Parameter]:
    card = find_card(name)
    return {} if card is None else {item.name: item for item in card.parameters}


def _find_unit(name: str, own: dict[str, Parameter]) -> str:
    return own[name].unit if name in own else unit_of(name)


def _parse_bounds(
    texts: tuple[str, ...], own: dict[str, Parameter]
) -> dict[str, tuple[float, float]]:
    from ..errors import InputError
    from ..units import parse_quantity

    bounds: dict[str, tuple[float, float]] = {}
    for text in texts:
        name, _, pair = text.partition("=")
        field = _name_field(name)
        ends = pair.split(":")
        if (field not in FIELDS and field not in own) or len(ends) != 2:
            raise InputError(
                f"--bound is '{text}': it must be FIELD=LOW:HIGH, such as modulus=0.1MPa:2MPa"
            )
        if field in bounds:
            raise InputError(f"--bound names {name.strip()} more than once: give it once")
        if field in own:
            bounds[field] = (
                parse_constant(own[field], ends[0]),
                parse_constant(own[field], ends[1]),
            )
            continue
        kind = FIELDS[field].kind
        bounds[field] = (parse_quantity(ends[0], kind), parse_quantity(ends[1], kind))
    return bounds


def _format_fit(found: Calibration, own: dict[str, Parameter]) -> str:
    lines = []
    wide = max(16, *(len(name) + 1 for name in found.free))
    for name in found.free:
        low, high = found.intervals[name]
        lines.append(
            f"{name:<{wide}}{found.estimates[name]:10.4g} {_find_unit(name, own):<4} "
            f"95 %: {low:.4g} to {high:.4g}"
        )
    lines.append(
        f"residuals {found.sigma:.3g} mm, condition {found.condition:.1f}; "
        f"{'converged' if found.converged else 'not converged'}: {found.reason}"
    )
    lines += [f"{name}: {reason}" for name, reason in found.held.items()]
    return "\n".join([*lines, *(f"warning: {text}" for text in found.warnings)])


# ``bozzini muscle compare``: models against measurements.


_WARNED = 3  # so many models, the first, have the warnings of their fits shown


@dataclass(frozen=True)
class RankRequest:
    """Whether models are fitted and ranked, and how, as the options ask for it."""

    fit: bool
    criterion: Criterion | None
    folds: int | None
    seed: int | None

    def choose(self, *, fit: bool) -> RankOptions | None:
        """Return the options of a ranking; None without a fit, where none may be given."""
        from ..errors import InputError
        from ..muscle import RankOptions

        if fit:
            return RankOptions(
                criterion=self.criterion or "aicc", folds=self.folds, seed=self.seed or 0
            )
        given = (("--by", self.criterion), ("--folds", self.folds), ("--seed", self.seed))
        for option, value in given:
            if value is not None:
                raise InputError(f"{option} has no effect without --fit: leave it out")
        return None


rank_options = gather(
    "ranked",
    RankRequest,
    click.option(
        "--fit",
        is_flag=True,
        help="With --model, fit each model first, and rank: modulus, and dead length (energy) or "
        "end length (thesis); constants and modulus of the others.",
    ),
    click.option(
        "--by",
        "criterion",
        type=click.Choice(["aicc", "bic", "cv"]),
        help="Of a fit, rank by an information criterion or by the rows left out (default: aicc).",
    ),
    click.option(
        "--folds", type=int, help="Of a fit, parts for cross-validation; 0 for none (default: 5)."
    ),
    click.option("--seed", type=int, help="Of a fit, for folds and starts (default: 0)."),
)


@click.command("compare")
@data_options
@click.option(
    "--model",
    "model_names",
    type=ModelType(),
    multiple=True,
    help="A model to compare; can be repeated (default: fit and rank all, see 'models').",
)
@rank_options
@request_options
@answer_options(*PICTURES)
def compare_command(
    table: DataRequest,
    model_names: tuple[str, ...],
    ranked: RankRequest,
    asked: Request,
    answer: Answer,
) -> None:
    """Compare models with measurements; without --model, fit and rank all that can be fitted.

    DATA is a .csv or .parquet file with the columns pressure, contraction or length and, if there,
    load, direction and specimen; their units stand in the header, as in 'pressure [kPa]'. The
    standard error is also given as a percentage of the largest contraction.

    Models that are fitted are ranked: by AICc, which charges a model for its constants, unless --by
    asks otherwise. 'left out' is the error at rows left out of the fit.

    Exit code 0: compared; 1: no model has an answer; 2: bad input. A picture is written only if a
    model has an answer.
    """
    options = ranked.choose(fit=ranked.fit or not model_names)
    names = list(dict.fromkeys(model_names) if model_names else list_kinds())
    choices = select_choices(names, ends=asked.ends, load_path=asked.load_path)
    check_fields(names, asked.fields)
    constants = parse_settings(names, asked.settings)
    muscle = asked.muscle
    data = table.read(muscle)
    check_friction(asked.fields, data, free=())
    makes = {
        name: make_class(
            name, **{"ends": None, "load_path": None, **choices[name]}, constants=constants[name]
        )
        for name in names
    }
    result = {
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
        more, text, found = _compare(makes, muscle, data, answer.out)
    else:
        more, text, found = _rank(makes, muscle, data, options, answer.out)
    result.update(more, muscle=describe_muscle(muscle))
    answer.give(result, note_data(data) + text)
    if not found:
        run_exit(EXIT_NEGATIVE)


_Answer = tuple[dict[str, Any], str, bool]


def _compare(
    makes: Mapping[str, Callable[[Muscle], MuscleModel]],
    muscle: Muscle,
    data: Measurements,
    out: Path | None,
) -> _Answer:
    """Compare the models as they are; return result, text, and whether there is an answer."""
    from ..errors import BozziniError
    from ..muscle import compare_models

    models: dict[str, MuscleModel] = {}
    refusals: dict[str, str] = {}
    for name, make in makes.items():
        try:
            models[name] = make(muscle)
        except BozziniError as error:
            refusals[name] = str(error)
    comparison = compare_models(models, data, refusals=refusals)
    written = out if comparison.scores else None
    if written is not None:
        from ..plot import write_figure
        from ..plot.muscle import draw_models

        write_figure(draw_models(comparison, models), written)
    result = {
        "models": [{**_describe_score(score), "fitted": {}} for score in comparison.scores],
        "refusals": comparison.refusals,
        "file": written,
    }
    return result, comparison.format_table(), bool(comparison.scores)


def _rank(
    makes: Mapping[str, Callable[[Muscle], MuscleModel]],
    muscle: Muscle,
    data: Measurements,
    options: RankOptions,
    out: Path | None,
) -> _Answer:
    """Fit the models and rank them; return result, text, and whether there is an answer."""
    from ..muscle import rank

    with progress_bar() as progress:
        ranking = rank(data, muscle, models=makes, options=options, progress=progress)
    written = out if ranking.models else None
    if written is not None:
        from ..plot import write_figure
        from ..plot.muscle import draw_ranking

        write_figure(draw_ranking(ranking), written)
    result = {
        "ranked_by": ranking.criterion,
        "folds": ranking.folds,
        "seed": ranking.seed,
        "models": [_describe_ranked(entry) for entry in ranking.models],
        "refusals": ranking.refusals,
        "notes": ranking.notes,
        "file": written,
    }
    lines = [ranking.format_table()]
    for entry in ranking.models[:_WARNED]:
        found = entry.calibration
        if found is None:
            continue
        if not found.converged:
            lines.append(f"{entry.name}: not converged: {found.reason}")
        lines += [f"{entry.name}: warning: {text}" for text in found.warnings]
    return result, "\n".join(lines), bool(ranking.models)


def _describe_score(score: ModelScore) -> dict[str, Any]:
    return {
        "model": score.name,
        "standard_error_mm": score.standard_error,
        "standard_error_percent": score.standard_error_percent,
        "rmse_mm": score.rmse,
        "bias_mm": score.bias,
        "largest_error_mm": score.largest,
    }


def _describe_ranked(entry: RankedModel) -> dict[str, Any]:
    left_out = entry.validation
    result = {
        **_describe_score(entry.score),
        "aicc": entry.aicc,
        "bic": entry.bic,
        "weight": entry.weight,
        "parameters": entry.parameters,
        "left_out_mm": entry.validation_error,
        "left_out_reason": "" if left_out is None else left_out.reason,
        "left_out_not_converged": 0 if left_out is None else left_out.unsettled,
        "same_as": entry.same_as,
        "held": entry.held,
        "fitted": {},
    }
    found = entry.calibration
    if found is not None:
        result |= {
            "fitted": found.estimates,
            "fit_warnings": found.warnings,
            "fit_converged": found.converged,
            "fit_reason": found.reason,
        }
    return result


# ``bozzini muscle``: solve a muscle, compute its curves; compare, fit and models are beside.


@click.group("muscle")
def command() -> None:
    """Solve a pneumatic muscle, list its models, and fit them to measurements."""


@command.command("solve")
@click.option("--pressure", type=QuantityType("pressure"), required=True, help="Gauge pressure.")
@click.option(
    "--load", type=QuantityType("force"), default="0N", show_default=True, help="Tension held."
)
@directed_options
@answer_options()
def solve_command(pressure: float, load: float, asked: Request, answer: Answer) -> None:
    """Find the contraction of a muscle at a pressure and a load.

    Exit code 0: solved; 1: no solution was found; 2: bad input.
    """
    model = asked.build(pressure=pressure)
    state = model.solve(pressure, load, direction=asked.direction)
    band = float(model.dead_band())
    result = {
        "model": asked.model_name,
        "preset": asked.preset,
        "pressure_MPa": pressure,
        "load_N": load,
        "direction": asked.direction,
        **describe_choices(model),
        "constants": describe_constants(model),
        "contraction_mm": _one(state.contraction),
        "length_mm": _one(state.length),
        "braid_angle_rad": _one(state.braid_angle),
        "contact_pressure_MPa": _one(state.contact_pressure),
        "dead_band_MPa": band,
        "converged": bool(_one(state.converged)),
        "residual_N": _one(state.residual),
        "iterations": int(_one(state.iterations)),
        "reason": str(_one(state.reason)),
        "muscle": describe_muscle(asked.muscle),
    }
    angle = math.degrees(result["braid_angle_rad"])
    text = (
        f"contraction {result['contraction_mm']:.4g} mm, length {result['length_mm']:.5g} mm, "
        f"braid angle {angle:.2f} deg, dead band {1e3 * band:.1f} kPa"
    )
    if not result["converged"]:
        text = f"no solution: {result['reason']}"
    answer.give(result, text)
    if not result["converged"]:
        run_exit(EXIT_NEGATIVE)


@command.command("curve")
@click.option(
    "--of",
    "kind",
    type=click.Choice(["contraction", "force", "angle", "phases"]),
    default="contraction",
    show_default=True,
    help="What over what: contraction or angle over pressure, force over contraction.",
)
@click.option(
    "--pressure",
    type=QuantityType("pressure"),
    default="0.8MPa",
    show_default=True,
    help="Largest pressure; with --of force, the pressure.",
)
@click.option(
    "--load", type=QuantityType("force"), help="Tension held; not with --of force (default: 0N)."
)
@click.option("--points", type=int, help="Rows of the table (default: 41).")
@directed_options
@answer_options(".csv", *PICTURES, text="A table (.csv) or a picture.")
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
    from ..checks import check_integer, check_number
    from ..errors import InputError
    from ..io.files import write_text

    out, direction = answer.out, asked.direction
    is_picture = out is not None and not answer.is_table
    if is_picture and points is not None:
        raise InputError("--points has no effect on a picture: leave it out, or write a .csv")
    if kind == "force" and load is not None:
        raise InputError("--load has no effect with --of force, which is over all loads")
    rows = check_integer("points", 41 if points is None else points, low=2, high=100_000)
    check_number("pressure", pressure, low=0.0, low_open=True, unit="MPa")
    model = asked.build(pressure=pressure)
    held = 0.0 if load is None else load
    columns = _compute_curve(model, kind, pressure, held, direction, rows)
    table = format_csv(columns)
    text = table.rstrip("\n")
    if out is not None:
        text = f"{out}: {kind}, {rows} points"
        if is_picture:
            text = f"{out}: {kind}"
            _draw_curve(model, kind, pressure, held, direction, out)
        else:
            write_text(out, table)
    result = {
        "model": asked.model_name,
        "preset": asked.preset,
        "of": kind,
        "pressure_MPa": pressure,
        "load_N": None if kind == "force" else held,
        "direction": direction,
        **describe_choices(model),
        "constants": describe_constants(model),
        "dead_band_MPa": float(model.dead_band()),
        "file": out,
        "columns": columns,
        "muscle": describe_muscle(asked.muscle),
    }
    answer.give(result, text)


command.add_command(compare_command)
command.add_command(fit_command)
command.add_command(models_command)


def _compute_curve(
    model: MuscleModel,
    kind: str,
    pressure: float,
    load: float,
    direction: str | None,
    points: int,
) -> dict[str, Any]:
    import numpy as np

    from ..errors import InputError

    if kind == "force":
        free = float(model.contraction(pressure, 0.0, direction=direction))
        if not free > 0.0:
            raise InputError(
                f"pressure is {pressure:g} MPa: with --of force it must be more, so that the "
                f"muscle contracts (its dead band ends at {model.dead_band():g} MPa)"
            )
        over = np.linspace(0.0, free, points)
        return {
            "contraction_mm": over,
            "force_N": model.force(pressure, over, direction=direction),
            "stiffness_N_per_mm": model.stiffness(pressure, over, direction=direction),
        }
    over = np.linspace(_find_lowest(model, pressure, load, direction), pressure, points)
    state = model.solve(over, load, direction=direction)
    columns = {
        "pressure_MPa": over,
        "contraction_mm": state.contraction,
        "braid_angle_rad": state.braid_angle,
    }
    if kind == "phases":
        columns["contact_pressure_MPa"] = state.contact_pressure
    return columns


def _find_lowest(model: MuscleModel, pressure: float, load: float, direction: str | None) -> float:
    """Return the lowest pressure from which on, up to one, a model has an answer [MPa].

    Found by bisection: a gap in between is not found.

    Raises
    ------
    InputError
        If it has none at the highest one.
    """
    from ..errors import InputError
    from ..muscle.models.base import ExplicitModel

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


def _draw_curve(
    model: MuscleModel, kind: str, pressure: float, load: float, direction: str | None, out: Path
) -> None:
    from ..plot import muscle as figures
    from ..plot import write_figure

    models = {model.name: model}
    if kind == "force":
        figure = figures.draw_force(model, [pressure], direction=direction)
        write_figure(figure, out)
        return
    options: dict[str, Any] = {"pressure": pressure, "load": load, "direction": direction}
    options["lowest"] = _find_lowest(model, pressure, load, direction)
    if kind == "angle":
        write_figure(figures.draw_braid_angle(models, **options), out)
    elif kind == "phases":
        write_figure(figures.draw_phases(model, **options), out)
    else:
        write_figure(figures.draw_contraction(models, **options), out)


def _one(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else value

"""``bozzini effector fit``: fit an end-effector to measurements, at rest or in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..errors import InputError
from ..units import parse_quantity
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    OUTPUT,
    PICTURES,
    Answer,
    CheckedCommand,
    Command,
    NameType,
    answer_options,
    check_target,
    gather,
    gather_once,
    option,
    run_exit,
)

if TYPE_CHECKING:
    from ..effector import EffectorFitOptions
    from ..effector.measured import EffectorMeasurements
    from ..effector.rest import Rest
    from ..effector.unknowns import EffectorSetup
    from ..numeric.least_squares import Loss
    from ..registry import Registry
    from .effector import EffectorRequest

OF_PULLS = (
    "muscles.each.area,muscles.each.area_slope,muscles.each.area_curve,muscles.each.stiffening,"
    "muscles.each.angle"
)
IN_TIME = "motion.fill_lag,motion.bleed_lag,motion.creep_share,motion.creep_time"
FIRST_WEIGHT = 0.1
"""Share of each play where the search begins."""
FIRST_LAG, FIRST_SHARE = 0.5, 0.1
"""Lags [s] and share of the creep there, of a recording."""


def _list_rests() -> Registry[Rest]:
    from ..effector.rest import RESTS

    return RESTS


@dataclass(frozen=True, kw_only=True)
class FitStart:
    """Where a fit begins, and what is free, as the options ask for it."""

    free: str
    pulls: bool
    plays: str
    settings: tuple[str, ...]
    markers: tuple[str, ...]

    def make_setup(self, asked: EffectorRequest, data: EffectorMeasurements) -> EffectorSetup:
        """Return what the search begins with."""
        from ..effector import Effector, EffectorMotion, MusclePull, TipView
        from ..effector.unknowns import EffectorSetup, find_kind, set_number

        radii = tuple(parse_quantity(text, "pressure") for text in _split(self.plays))
        motion = EffectorMotion(play_radii=radii, play_weights=(FIRST_WEIGHT,) * len(radii))
        if data.times is not None:
            motion = replace(
                motion, fill_lag=FIRST_LAG, bleed_lag=FIRST_LAG, creep_share=FIRST_SHARE
            )
        if self.pulls:
            design = asked.make_design()
            laws = (MusclePull(),) * len(design.muscles)
            effector = Effector(design, motion=motion, pulls=laws)
        else:
            effector = replace(asked.effector, motion=motion)
        view = TipView(markers=gather_once("--marker", map(_parse_marker, self.markers)))
        setup = EffectorSetup(effector, view)
        for text in self.settings:
            name, mark, value = (part.strip() for part in text.partition("="))
            if not (mark and value):
                raise InputError(f"--set is '{text}': it must be NAME=VALUE")
            setup = set_number(setup, name, parse_quantity(value, find_kind(setup, name)))
        return setup

    def list_free(self, data: EffectorMeasurements) -> list[str]:
        """Return the names of what is free."""
        if self.free:
            return _split(self.free)
        if not self.pulls:
            raise InputError("--free is needed where there are no --pulls: name what is fitted")
        names = _split(OF_PULLS)
        if any(channel.startswith("spot") for channel in data.channels):
            names += ["board.x", "board.y"]
        if data.times is not None:
            names += _split(IN_TIME)
            names += ["motion.play_weights"] if self.plays else []
        return names


def _split(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


def _parse_marker(text: str) -> tuple[str, float]:
    name, mark, value = (part.strip() for part in text.partition("="))
    if not (name and mark and value):
        raise InputError(f"--marker is '{text}': it must be NAME=ARC, such as m1=20mm")
    return name, parse_quantity(value, "length")


def _make_options(
    *, loss: Loss, starts: int, together: bool, rest: str | None
) -> EffectorFitOptions:
    from ..effector import EffectorFitOptions
    from ..numeric.estimate import EstimateOptions

    options = EstimateOptions(loss=loss, starts=starts)
    return EffectorFitOptions(leave_out=not together, rest=rest or "", estimate=options)


start_options = gather(
    "start",
    FitStart,
    option(
        "--free NAME,...",
        "What is fitted, such as offset,flexural_rigidity,muscles.*.modulus,muscles.each.angle.",
        default="",
    ),
    option(
        "--pulls",
        "A law of pull for each muscle, all in balance on an arc, in place of a model of them.",
        is_flag=True,
    ),
    option(
        "--plays PRESSURE,...",
        "Half widths of plays between the pressure and what muscles contract by.",
        default="",
    ),
    option(
        "--set settings NAME=VALUE",
        "A number to begin with, and to keep if it is not free, such as board.distance=340mm; can "
        "be repeated.",
        multiple=True,
    ),
    option("--marker markers NAME=ARC", "A point of the table on the body; can be repeated.",
           multiple=True),
)  # fmt: skip
fit_options = gather(
    "options",
    _make_options,
    option("--rest", "Learn what the fit leaves over, by this rule; reported apart.",
           NameType("rest", _list_rests), default=None),
    option("--together", "Do not leave runs out in turn.", is_flag=True),
    option("--loss", "What of a misfit is summed; the last two count outliers less.",
           ("linear", "soft_l1", "huber"), default="linear"),
    option("--starts", "Starts of the search.", int, default=1),
)  # fmt: skip


def make_fit(effector_options: Callable[[Command], Command]) -> click.Command:
    """Return the command, with the options of an end-effector."""

    @click.command("fit", cls=CheckedCommand)
    @click.argument("table", metavar="TABLE.csv", type=INPUT)
    @start_options
    @option("--per-volt", "Pressure of the regulators at one volt.", "pressure")
    @option(
        "--column columns TITLE=OLD",
        "A title to read in place of one in the file; can be repeated.",
        multiple=True,
    )
    @option("--hold NAME,...", "Runs that are predicted, not fitted.", default="")
    @option(
        "--check others FILE",
        "A table to predict, not to fit; can be repeated.",
        INPUT,
        multiple=True,
    )
    @fit_options
    @option("--figure FILE", "A picture: traces, errors over time, loops.", OUTPUT)
    @effector_options
    @answer_options(".yaml", ".yml", ".json", help="The fitted end-effector (.yaml, .json).")
    def command(
        table: Path,
        start: FitStart,
        per_volt: float | None,
        columns: tuple[str, ...],
        hold: str,
        others: tuple[Path, ...],
        options: EffectorFitOptions,
        figure: Path | None,
        asked: EffectorRequest,
        answer: Answer,
    ) -> None:
        """Fit numbers of an end-effector to measurements, at rest or in time.

        TABLE has the commands, such as 'R pressure [kPa]' or 'command R [V]' with --per-volt, and
        what was seen: 'tip x [mm]', 'spot x [cm]' of a pointer on a board, 'lateral [mm]', 'bend
        [deg]'. With 'time [s]' it is a recording, whose runs are named in 'run'. An empty place was
        not seen.

        --free has muscles.each.FIELD or muscles.*.FIELD (one for all), fields of the design such as
        offset, motion.fill_lag, motion.play_weights, base.turn_x, board.x, commands.scale. With
        --pulls and without --free all laws of pull, angles and lags are.

        Runs are left out in turn and predicted from their commands alone. Beside a fit in time
        stand a constant and polynomials of two past samples. The file of --out holds a rest too.

        Exit code 0: fitted; 1: not converged, not determined, or poor: off by more than 5 % of the
        range; 2: bad input.
        """
        from ..effector.files import EffectorFile, write_effector
        from ..effector.fit import check_measurements, fit_effector, format_errors
        from ..effector.measured import read_effector_measurements
        from ..effector.rest import is_storable
        from ..io.sheets import parse_columns

        check_target(figure, PICTURES, force=answer.force)
        if answer.out is not None and options.rest and not is_storable(options.rest):
            raise InputError(f"the rest '{options.rest}' cannot be written: leave --out or it out")
        titles = parse_columns(columns)
        whole = read_effector_measurements(table, per_volt=per_volt, columns=titles)
        data, checked = whole, {}
        if held := _split(hold):
            checked[f"{table.name}, held"] = whole.select(held)
            kept = [run for run in dict.fromkeys(whole.runs.tolist()) if run not in held]
            if not kept:
                raise InputError("--hold names all runs: leave one or more to fit")
            data = whole.select(kept)
        for path in others:
            checked[str(path)] = read_effector_measurements(path, per_volt=per_volt, columns=titles)
        setup = start.make_setup(asked, data)
        for other in checked.values():
            check_measurements(setup, other)
        with answer.show_progress() as progress:
            found = fit_effector(
                setup.effector,
                data,
                free=start.list_free(data),
                view=setup.view,
                options=options,
                progress=progress,
            )
        lines = [found.format_table(), *(f"note: {note}" for note in whole.notes)]
        checks = {}
        for name, other in checked.items():
            there = found.predict(other)
            checks[name] = there.to_dict()
            lines += [f"{name}: {there.rms:.3g} mm rms", format_errors(there)]
            if found.band is not None:
                share = there.measure_coverage(found.band)
                checks[name]["within_band"] = share
                lines.append(f"{100.0 * share:.1f} % lie within the band of runs left out")
        if answer.out is not None:
            of_model = not found.effector.pulls
            file = EffectorFile.of(
                found,
                model=asked.model_name if of_model else "energy",
                choices=asked.choices if of_model else {},
                per_volt=per_volt,
                rest=options.rest,
            )
            write_effector(answer.out, file)
        if figure is not None:
            from ..plot import write_figure
            from ..plot.effector_fit import draw_fit

            write_figure(draw_fit(found), figure)
        result = found.to_dict() | {"checks": checks, "notes": list(whole.notes)}
        answer.give(result | {"file": answer.out, "figure": figure}, "\n".join(lines))
        if not found.converged or found.undetermined or found.is_poor:
            run_exit(EXIT_NEGATIVE)

    return command

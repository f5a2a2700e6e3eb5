"""A fit that begins with the lengths of a robot alone, and frees in stages what rows ask for."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from ..errors import InputError
from ..progress import Progress, no_progress
from ..results import Json, Result, Shown, format_rows, rows_of, tabulated
from .fit_search import DEFAULT_OPTIONS, RobotFitOptions
from .kinematics import ContinuumRobot
from .measured import RobotMeasurements
from .robot_fit import RobotFit, fit_robot
from .unknowns import RobotSetup

GAIN = 0.02
"""Share by which rows left out must be missed less for a stage to stay."""


@dataclass(frozen=True)
class FitStage(Shown):
    """A stage of a fit.

    Parameters
    ----------
    what : str
        What it frees, in words.
    names : tuple of str
        The unknowns of it.
    error : float
        Root mean square distance of rows left out with it [mm].
    kept : bool
        Whether it stayed.
    reason : str
        Why it did not.
    """

    what: str = tabulated()
    names: tuple[str, ...] = tabulated()
    error: float = tabulated()
    kept: bool = tabulated()
    reason: str = tabulated()


@dataclass(frozen=True, kw_only=True, eq=False)
class StagedFit(Result):
    """What each stage of a fit buys, and the fit at the end.

    Parameters
    ----------
    stages : tuple of FitStage
    fit : RobotFit
        Of all that stayed.
    """

    stages: tuple[FitStage, ...] = rows_of(FitStage)
    fit: RobotFit

    @property
    def converged(self) -> bool:
        """Whether the last fit ended at a minimum."""
        return self.fit.converged

    @property
    def reason(self) -> str:
        """Why the last fit ended."""
        return self.fit.reason

    @property
    def residual(self) -> float:
        """Root mean square distance of rows left out of the last fit [mm]."""
        return self.fit.error

    def to_dict(self) -> Json:
        """Return the stages as plain values."""
        return {"stages": [dataclasses.asdict(stage) for stage in self.stages]}

    def format_table(self) -> str:
        """Return what each stage buys, as text."""
        rows = [
            [
                stage.what,
                "-" if math.isnan(stage.error) else f"{stage.error:.3g}",
                "kept" if stage.kept else stage.reason,
                ",".join(stage.names),
            ]
            for stage in self.stages
        ]
        return format_rows(["freed", "rows left out [mm]", "", "names"], rows)


def list_stages(robot: ContinuumRobot, command: str) -> list[tuple[str, tuple[str, ...]]]:
    """Return what is freed one after the other.

    Clocking and stiffness are those of sections after the first: the pose of the base turns the
    first, and under displacements only ratios of stiffness to that of the tendons count.
    """
    pulled = command == "tension"
    later = range(2, len(robot.sections) + 1)
    stages: list[tuple[str, tuple[str, ...]]] = [("place and tilt of the base", ("base",))]
    if pulled:
        stages.append(("one stiffness of the sections", ("sections.*.bending_stiffness",)))
    else:
        stages += [
            ("stiffness of the tendons", ("tendons.*.stiffness",)),
            ("zeros by section", ("sections.each.tendons.zero",)),
        ]
    stages.append(("distance of the tendons", ("tendons.*.offset",)))
    if len(later):
        stages += [
            ("clocking of sections", tuple(f"sections.{k}.tendons.angle" for k in later)),
            (
                "stiffness of each section",
                tuple(f"sections.{k}.bending_stiffness" for k in later),
            ),
        ]
    if not pulled:
        stages += [
            ("backlash", ("commands.backlash",)),
            ("zeros by tendon", ("tendons.each.zero",)),
        ]
    return stages


def fit_in_stages(
    robot: ContinuumRobot | RobotSetup,
    data: RobotMeasurements,
    *,
    options: RobotFitOptions = DEFAULT_OPTIONS,
    progress: Progress = no_progress,
) -> StagedFit:
    """Fit a robot from what is known of it, freeing more as long as rows left out ask for it.

    Base, stiffness, zeros, distance of the tendons, clocking, ratios of stiffness and backlash are
    freed one after the other. A stage stays if rows left out are missed by 2 % less, and the data
    determine all that is free then. One that was refused before another stayed is tried once more
    at the end.

    Parameters
    ----------
    robot : ContinuumRobot or RobotSetup
        Where the fit begins.
    data : RobotMeasurements
    options : RobotFitOptions
        Of all fits; only the last has a residual.
    progress : callable

    Raises
    ------
    InputError
        As `fit_robot` does, or if no rows are left out.
    """
    if not options.folds:
        raise InputError("folds is 0: stages are judged by rows left out, which must be 2 or more")
    setup = robot if isinstance(robot, RobotSetup) else RobotSetup.of(robot)
    trial = dataclasses.replace(options, residual=False, smaller=False)
    free: tuple[str, ...] = ()
    stages: list[FitStage] = []
    best = fit_robot(setup, data, free=(), options=trial)
    least = best.rms
    todo = list_stages(setup.robot, data.command)

    def attempt(what: str, names: tuple[str, ...]) -> FitStage:
        nonlocal best, least, free
        progress(f"trying {what}", len(stages) / (len(todo) + 1))
        try:
            found = fit_robot(setup, data, free=(*free, *names), options=trial)
        except InputError as error:  # such as tendons without a stiffness to begin from
            return FitStage(what, names, math.nan, False, str(error))
        reason = _refuse(found, least)
        if not reason:
            best, least, free = found, found.error, (*free, *names)
        return FitStage(what, names, found.error, not reason, reason)

    for what, names in todo:
        stages.append(attempt(what, names))
    last = max((k for k, stage in enumerate(stages) if stage.kept), default=0)
    for early in [stage for stage in stages[:last] if stage.reason and stage.error > 0.0]:
        late = attempt(early.what, early.names)
        if late.kept:
            stages.remove(early)
            stages.append(late)
    progress("fitting", len(todo) / (len(todo) + 1))
    if free or options.residual:
        best = fit_robot(setup, data, free=free, options=options)
    return StagedFit(stages=tuple(stages), fit=best)


def _refuse(found: RobotFit, least: float) -> str:
    """Return why a stage does not stay; empty if it does."""
    if found.undetermined:
        return "not determined"
    if not found.converged:
        return "not converged"
    if not found.error < (1.0 - GAIN) * least:
        return "no gain"
    return ""

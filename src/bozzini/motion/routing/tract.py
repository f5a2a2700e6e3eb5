"""A robot of sections for a tract: the widest that comes through, with the fewest sections.

No diameter is tried that the traversability bounds exclude (`find_diameter_limits`). For each
other one, from the widest down, a scope's plan is made, and robots of more and more sections are
fitted to its path, first of even lengths, then of those that the bends of the whole way ask for;
the first whose whole motion is certified is the answer. The bend limits are what that motion takes.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...checks import ceil_mm
from ...continuum import ContinuumRobot, Section, Tendon
from ...continuum.routing import fit_bend, split_rows
from ...duct.base import Duct
from ...duct.centreline import Centreline
from ...errors import GeometryError, InputError
from ...progress import Progress, no_progress
from ...results import Json, Result, rows_of, tabulated, take_axes, to_plain
from ..actuate import Actuation, actuate_plan
from ..plan import Plan
from ..planner import plan_insertion
from ..planners import PlannerOptions
from ..scope import Scope
from ..traverse import DiameterLimits, find_diameter_limits
from .design import take_curve
from .options import RobotSearch
from .rank import shift_curvature

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...numeric.arrays import Floats

DIAMETER_STEP_MM = 0.1
"""Diameters that are tried are multiples of this."""

BEND_SPARE = 1.1
"""Bend limits are what the motion takes, times this."""

LENGTH_SPARE = 1.02
"""Length of a robot against its plan's path, so that the base stays in the introducer."""

LENGTH_POWER = 2.0
"""Power of a section's length that squares of curvature weigh, where lengths follow the bends."""

POSE_MM = 8.0
"""The head moves by this from one pose to the next, where lengths follow the bends."""

LINK_SHARE = 0.5
"""Links of the scope whose plan a robot follows, against its shortest section."""

LINK_MM = 12.0
"""And at most this."""


@dataclass(frozen=True, kw_only=True)
class RobotTrial:
    """A robot that was tried: its diameter [mm], sections, and why it does not come through."""

    diameter: float = tabulated("mm")
    sections: int = tabulated()
    even: bool = tabulated(name="even_lengths")
    passed: bool = tabulated()
    clearance: float = tabulated("mm")
    head: float = tabulated("mm")
    reason: str = tabulated(name="why_not")


@dataclass(frozen=True, kw_only=True, eq=False)
class TractRobot(Result):
    """The robot that was found for a tract, or why there is none.

    Parameters
    ----------
    robot : ContinuumRobot, optional
        The widest that was certified all the way, with the fewest sections; None if none was.
    actuation : Actuation, optional
        Its motion, and the plan that it follows.
    plan : Plan, optional
    limits : DiameterLimits
        What the bounds say of diameters.
    trials : tuple of RobotTrial
        What was tried, in this order.
    reason : str
        Why there is none.
    """

    robot: ContinuumRobot | None
    actuation: Actuation | None = field(repr=False)
    plan: Plan | None = field(repr=False)
    limits: DiameterLimits
    trials: tuple[RobotTrial, ...] = rows_of(RobotTrial)
    reason: str = ""

    @property
    def converged(self) -> bool:
        """Whether there is a robot."""
        return self.robot is not None

    residual = 0.0

    def to_dict(self) -> Json:
        """Return the answer as plain values, units in the names."""
        found: Json = {"converged": self.converged, "reason": self.reason, "residual": 0.0}
        if self.robot is not None and self.actuation is not None:
            sections = self.robot.sections
            found |= {
                "diameter_mm": 2.0 * self.robot.radius,
                "length_mm": self.robot.length,
                "sections": len(sections),
                "section_lengths_mm": [section.length for section in sections],
                "bend_limits_rad": [section.max_bend for section in sections],
                "clearance_certified_mm": self.actuation.certificate.clearance,
                "off_path_max_mm": float(self.actuation.fit_max.max()),
                "robot": self.robot.to_dict(),
            }
        found |= {"bounds": self.limits.describe(), "trials": [vars(t) for t in self.trials]}
        return dict(to_plain(found))

    def to_yaml(self, path: str | os.PathLike[str]) -> Path:
        """Write the robot as a YAML file.

        Raises
        ------
        GeometryError
            If there is none.
        OutputError
            If the file cannot be written.
        """
        if self.robot is None:
            raise GeometryError(self.reason)
        return self.robot.to_yaml(path)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw how far each trial came, and return the axes."""
        axes = take_axes(ax, x="sections", y="certified way of the head [mm]")
        diameters = sorted({t.diameter for t in self.trials}, reverse=True)
        for row, diameter in enumerate(diameters):
            for even, style in ((True, "o-"), (False, "x--")):
                own = [t for t in self.trials if t.diameter == diameter and t.even == even]
                if own:
                    label = f"{diameter:g} mm{'' if even else ', uneven'}"
                    counts, heads = [t.sections for t in own], [t.head for t in own]
                    axes.plot(counts, heads, style, color=f"C{row}", label=label)
        if self.trials:
            axes.legend(title="diameter", fontsize="small")
        return axes


def design_robot(
    duct: Duct,
    line: Centreline,
    *,
    options: RobotSearch | None = None,
    progress: Progress = no_progress,
) -> TractRobot:
    """Return the widest robot of sections that comes through a tract, certified.

    Parameters
    ----------
    duct : Duct
        The lumen, in 3 dimensions.
    line : Centreline
        The way from the entry to the goal.
    options : RobotSearch, optional
    progress : Progress

    Returns
    -------
    TractRobot
        Also when none comes through: then `reason` states why the thinnest does not.

    Raises
    ------
    InputError
        If the duct is planar, or the thinnest body asked for is thicker than the thickest.
    """
    options = options or RobotSearch()
    if duct.dim != 3:
        raise InputError("the duct is planar: a robot moves in 3 dimensions")
    limits = find_diameter_limits(duct, line)
    trials: list[RobotTrial] = []
    diameters = list_diameters(options, limits)
    total = len(diameters) * (1 + len(options.sections))
    for row, diameter in enumerate(diameters):
        progress("robots", row / len(diameters))
        shortest = line.length / max(options.sections)
        scope = Scope(diameter=diameter, link_length=min(LINK_MM, LINK_SHARE * shortest))
        plan = plan_insertion(duct, line, scope=scope, options=PlannerOptions(advise=False))
        if plan.status != "complete" or not plan.certified:
            reason = plan.reason or "its plan's clearance is not proved"
            trials.append(_describe_trial(diameter, 0, plan.proved or 0.0, plan.inserted, reason))
            continue
        for column, count in enumerate(options.sections):
            progress("robots", (row * (1 + len(options.sections)) + column + 1) / total)
            for even in (True, False):
                shares = (
                    np.full(count, 1.0 / count) if even else share_lengths(plan, count, diameter)
                )
                if not even and (count == 1 or np.ptp(shares) == 0.0):
                    continue
                robot = make_robot(plan, diameter, shares, options)
                motion = actuate_plan(plan, robot, duct)
                head = float(motion.head_arc_length[-1])
                proof = motion.certificate.clearance
                trials.append(_describe_trial(diameter, count, proof, head, motion.reason, even))
                if motion.fits:
                    progress("robots", 1.0)
                    return TractRobot(
                        robot=limit_bends(robot, motion),
                        actuation=motion,
                        plan=plan,
                        limits=limits,
                        trials=tuple(trials),
                    )
    progress("robots", 1.0)
    return TractRobot(
        robot=None,
        actuation=None,
        plan=None,
        limits=limits,
        trials=tuple(trials),
        reason=_explain(options, limits, trials),
    )


def list_diameters(options: RobotSearch, limits: DiameterLimits) -> list[float]:
    """Return the diameters to try [mm], thickest first; none above what is proved not to pass."""
    most = options.diameter_max or math.inf
    most = min(most, limits.high)
    if math.isinf(most):
        most = max(limits.low, options.diameter_min)
    if most < options.diameter_min:
        return []
    tried = np.linspace(most, options.diameter_min, options.diameters)
    steps = np.floor(tried / DIAMETER_STEP_MM + 1e-9)
    return sorted({round(DIAMETER_STEP_MM * float(k), 6) for k in steps}, reverse=True)


def _list_shares(plan: Plan, count: int, diameter: float) -> Iterator[tuple[bool, Floats]]:
    """Give the shares of even sections, and of uneven ones if there are any."""
    even = np.full(count, 1.0 / count)
    yield True, even
    uneven = share_lengths(plan, count, diameter)
    if np.abs(uneven - even).max() > 0.0:
        yield False, uneven


def share_lengths(plan: Plan, count: int, diameter: float) -> Floats:
    """Return the shares (count,) of a robot's length that suit the bends of the whole way in.

    Where along the robot the curvature of all poses varies, sections are short: a base that stays
    in a straight part is one long section. Even shares, where a section would be too short.
    """
    target = fit_bend(take_curve(plan))
    steps = target.steps
    stride = max(1, round(POSE_MM * steps.count / steps.length))
    matrix = shift_curvature(target, np.arange(steps.count, 0, -stride))
    rows = np.concatenate(np.split(matrix, 2), axis=1)
    least = max(1, math.ceil(diameter / steps.length * len(rows)))
    if least * count > len(rows):
        return np.full(count, 1.0 / count)
    return np.diff(split_rows(rows, count, power=LENGTH_POWER, least=least)) / len(rows)


def make_robot(plan: Plan, diameter: float, shares: Floats, options: RobotSearch) -> ContinuumRobot:
    """Return a robot for a plan's path, of sections with these shares and three tendons each."""
    length = LENGTH_SPARE * float(plan.path_arc_length[-1])
    radius, count = 0.5 * diameter, len(shares)
    sections = []
    for index, share in enumerate(shares):
        tendons = tuple(
            Tendon(
                name=f"S{index + 1}T{k + 1}",
                offset=options.offset_share * radius,
                angle=2.0 * math.pi * (k / 3.0 + index / (3.0 * count)),
            )
            for k in range(3)
        )
        name = f"S{index + 1}"
        own = float(share * length)
        sections.append(Section(length=own, radius=radius, tendons=tendons, name=name))
    return ContinuumRobot(tuple(sections), name=f"{count} sections of {diameter:g} mm")


def limit_bends(robot: ContinuumRobot, motion: Actuation) -> ContinuumRobot:
    """Return a robot whose bend limits are what a motion takes, and some more."""
    taken = np.linalg.norm(motion.bends, axis=2).max(axis=0)
    sections = [
        dataclasses.replace(section, max_bend=max(BEND_SPARE * float(bend), math.radians(1.0)))
        for section, bend in zip(robot.sections, taken, strict=True)
    ]
    return ContinuumRobot(tuple(sections), name=robot.name)


def _describe_trial(
    diameter: float, sections: int, clearance: float, head: float, reason: str, even: bool = True
) -> RobotTrial:
    return RobotTrial(
        diameter=diameter,
        sections=sections,
        even=even,
        passed=not reason,
        clearance=clearance,
        head=head,
        reason=reason,
    )


def _explain(options: RobotSearch, limits: DiameterLimits, trials: list[RobotTrial]) -> str:
    """Return why no robot came through."""
    if not trials:
        return (
            f"no body thicker than {ceil_mm(limits.high)} mm passes at {limits.high_at:.0f} mm of "
            "the "
            f"centreline (proved): the thinnest that was asked for has {options.diameter_min:g} mm"
        )
    last = trials[-1]
    kind = "" if last.even else " uneven"
    tried = f"{last.sections}{kind} sections" if last.sections else "a scope"
    return f"{tried} of {last.diameter:g} mm, the thinnest tried: {last.reason}"

"""A robot whose tendons are routed so that under their tensions it takes a given shape.

Thesis 6.2: a routing that adheres to the profile of the tract, so that actuation is minimal. One
tendon that may cross the backbone, or two and more of constant offset, hold any one shape; what
they cost is tension, slope, and sensitivity to it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ...checks import check_integer, check_points, check_word, show_apart
from ...continuum import ContinuumRobot, EnergyModel, RobotDesign, RodModel, Section, Shape, Tendon
from ...continuum.robot import check_robot
from ...continuum.routing import (
    AngleFit,
    BendTarget,
    PathFit,
    RoutingLimits,
    fit_bend,
    fit_straight,
    make_splines,
)
from ...duct.base import Duct
from ...errors import GeometryError, InputError
from ...io.records import save_record
from ...numeric.polylines import interpolate_polyline, measure_arc_length
from ...results import Json, Result, measured, take_axes, to_plain
from ..certify import Certificate, certify_motion
from ..plan import Plan
from ..space import FreeSpace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...numeric.arrays import Floats

RoutingKind = Literal["curved", "straight"]

KNOT_MM = 1.0
"""Distance between the knots of a designed tendon, at most."""

DISC_MM = 4.0
"""Distance between the guide discs of a designed robot, at most."""

BETWEEN = 3
"""Stations between two discs at which shapes are compared."""

KNOT_DIGITS = 5
"""Digits of the knots after the point [mm]."""

SHORTEST_MM, LONGEST_MM = 5.0, 1500.0
"""Shortest and longest curve for a robot."""

LEAST_PULL_N = 0.01
"""A curve that asks for less tension is straight."""

MOST_CURVED, MOST_STRAIGHT = 4, 12
"""Tendons at most: curved ones and straight ones."""

SLOPE_ROUND_OFF, LENGTH_ROUND_OFF_MM = 1e-3, 1e-3
"""By how much a routing may pass its limits."""

TAIL_MM = 1.0
"""Part of the body in the introducer that a pose is certified with."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RoutingDesign(Result):
    """A robot whose tendons hold one shape, and how well.

    Parameters
    ----------
    robot : ContinuumRobot
        One section with its tendons; `to_yaml` saves it.
    routing : {"curved", "straight"}
        What kind of tendons.
    curve : (m, 3) ndarray
        The shape that was asked for, world frame [mm].
    frame : (4, 4) ndarray
        Of the robot's base, in the same frame [mm].
    tensions : (t,) ndarray
        That hold the shape [N].
    displacements : (t,) ndarray
        Of the tendons in it [mm].
    error_rms, error_max : float
        Distance of the rod model's backbone, under these tensions, from the curve at equal arc
        length [mm].
    energy_error_rms, energy_error_max : float
        The same of the energy model (channels) under these displacements [mm].
    slope, gap, offset_least, offset_most : float
        Largest slope of a tendon, least distance of two in a cross-section, and least and largest
        distance from the backbone [mm]; the gap of one tendon is infinite.
    by_tension : (t + 1,) ndarray
        How far the backbone moves at most where each tension, and last all of them, are 1 % larger
        [mm]; infinite where the rod has no shape then. There is no wall.
    by_displacement : (t + 1,) ndarray
        The same where each tendon, and last all of them, are pulled by 0.1 mm more [mm].
    certificate : Certificate, optional
        What is proved of the pose's clearance in the duct, if one was given.
    converged, reason
        Whether all limits are kept and the models have a shape; if not, what is wrong.
    """

    robot: ContinuumRobot
    routing: RoutingKind
    curve: Floats = field(repr=False)
    frame: Floats
    tensions: Floats = measured("N")
    displacements: Floats = measured("mm")
    error_rms: float = measured("mm")
    error_max: float = measured("mm")
    energy_error_rms: float = measured("mm")
    energy_error_max: float = measured("mm")
    slope: float
    gap: float = measured("mm")
    offset_least: float = measured("mm")
    offset_most: float = measured("mm")
    by_tension: Floats = measured("mm")
    by_displacement: Floats = measured("mm")
    certificate: Certificate | None = None
    converged: bool = True
    reason: str = ""

    @property
    def residual(self) -> float:
        """The largest distance from the curve [mm]."""
        return self.error_max

    @property
    def clearance(self) -> float | None:
        """What is certified of the pose's clearance [mm]; None without a duct."""
        return None if self.certificate is None else self.certificate.clearance

    @property
    def places(self) -> Floats:
        """Arc length of `points` [mm], shape (k,)."""
        return self._shape.arc_length

    @property
    def points(self) -> Floats:
        """The backbone by the rod model in the world frame, shape (k, 3) [mm]."""
        return _place(self._shape, self.frame)

    @cached_property
    def _shape(self) -> Shape:
        return _make_rod(self.robot).shape_under_tensions(self.tensions)

    def to_dict(self) -> Json:
        """Return the design as plain values, units in the names."""
        names = [*self.robot.tendon_names, "all"]
        values: Json = {
            "routing": self.routing,
            "length_mm": self.robot.length,
            "radius_mm": self.robot.radius,
            "tensions_N": dict(zip(names, self.tensions, strict=False)),
            "tension_sum_N": float(self.tensions.sum()),
            "displacements_mm": dict(zip(names, self.displacements, strict=False)),
            "base_frame": self.frame,
            "error_rms_mm": self.error_rms,
            "error_max_mm": self.error_max,
            "energy_error_rms_mm": self.energy_error_rms,
            "energy_error_max_mm": self.energy_error_max,
            "slope_max": self.slope,
            "gap_min_mm": self.gap,
            "offset_min_mm": self.offset_least,
            "offset_max_mm": self.offset_most,
            "moved_by_1_percent_tension_mm": dict(zip(names, self.by_tension, strict=True)),
            "moved_by_0.1_mm_displacement_mm": dict(zip(names, self.by_displacement, strict=True)),
            "clearance_certified_mm": self.clearance,
            "converged": self.converged,
            "reason": self.reason,
            "residual": self.residual,
            "robot": self.robot.to_dict(),
        }
        return dict(to_plain(values))

    def list_columns(self) -> dict[str, object]:
        """Return the columns of `to_frame`: the routing, station by station."""
        places = self.robot.stations(between=BETWEEN)
        columns: dict[str, object] = {"arc_length_mm": places}
        for tendon, end in zip(self.robot.tendons, self.robot.tendon_ends, strict=True):
            here = places <= end + LENGTH_ROUND_OFF_MM
            path = np.full((len(places), 2), np.nan)
            path[here] = tendon.place_at(np.minimum(places[here], end))
            columns |= {f"{tendon.name}_{axis}_mm": path[:, k] for k, axis in enumerate("xy")}
        return columns

    def to_yaml(self, path: str | os.PathLike[str]) -> Path:
        """Write the robot as a YAML file, with tensions and displacements as comments.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        pulls = [
            f"{name}: {tension:.4f} N, {displacement:.4f} mm"
            for name, tension, displacement in zip(
                self.robot.tendon_names, self.tensions, self.displacements, strict=True
            )
        ]
        place = ", ".join(f"{value:.4f}" for value in self.frame[:3, 3])
        axes = ", ".join(f"{value:.6f}" for value in self.frame[:3, :3].T.ravel())
        lines = (
            "Lengths in mm, angles in rad, stiffnesses in N mm^2.",
            f"The designed shape takes (tension, displacement): {'; '.join(pulls)}.",
            f"Base at {place} mm; its axes x, y, z: {axes}.",
        )
        return save_record(self.robot, path, note="\n# ".join(lines))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw x and y of the tendons over arc length, and return the axes."""
        axes = take_axes(ax, x="arc length [mm]", y="place in the cross-section [mm]")
        for row, (tendon, end) in enumerate(
            zip(self.robot.tendons, self.robot.tendon_ends, strict=True)
        ):
            places = np.linspace(0.0, end, 400)
            path = tendon.place_at(places)
            for k, (axis, style) in enumerate((("x", "-"), ("y", "--"))):
                label = f"{tendon.name} {axis}"
                axes.plot(places, path[:, k], style, color=f"C{row}", label=label)
        axes.legend(fontsize="small")
        return axes


def design_routing(
    curve: ArrayLike | Plan,
    *,
    tendons: int = 2,
    limits: RoutingLimits | None = None,
    robot: RobotDesign | None = None,
    duct: Duct | None = None,
    routing: RoutingKind = "curved",
) -> RoutingDesign:
    """Return a robot whose tendons, under constant tensions, hold a curve.

    Parameters
    ----------
    curve : (m, 3) array_like or Plan
        The backbone's shape from the base on, world frame [mm]; of a plan it is the head's path.
    tendons : int
        With ``"curved"`` 1 to 4: one tendon may cross the backbone (``core_radius=0``), two or more
        run at `offset_max` all along. With ``"straight"`` up to 12, parallel to the backbone, each
        with its own end.
    limits : RoutingLimits, optional
        What the routing keeps to.
    robot : RobotDesign, optional
        A robot of one section, whose radius and stiffnesses are taken; a radius of 2.5 mm (or
        `offset_max`, if that is more) and 200 N mm^2 unless given. Its length and tendons do not
        matter.
    duct : Duct, optional
        The lumen in which the pose is certified; the introducer is the plan's.
    routing : {"curved", "straight"}
        What kind of tendons.

    Returns
    -------
    RoutingDesign
        Also where a limit cannot be kept: then it has not converged, and `reason` states which.

    Raises
    ------
    InputError
        If an argument is outside its legal range, or the curve is no curve in space.
    GeometryError
        If the curve turns back at a point, or is straight.
    """
    limits = limits or RoutingLimits()
    check_word("routing", routing, get_args(RoutingKind))
    check_integer(
        "tendons", tendons, low=1, high=MOST_STRAIGHT if routing == "straight" else MOST_CURVED
    )
    section = _take_section(robot, limits)
    points = take_curve(curve)
    target = fit_bend(points)
    stiffness = section.mean_stiffness
    _check_bend(target, stiffness, limits, 1 if routing == "straight" else tendons)
    if routing == "straight":
        made, frame, tensions = _route_straight(target, stiffness, limits.offset_max, tendons)
    else:
        made, frame, tensions = _route_curved(target, stiffness, limits, tendons)
    design = ContinuumRobot((_cut_section(section, target.steps.length, made),), name="designed")
    return _judge(design, points, frame, tensions, (limits, routing), _find_space(curve, duct))


def _check_bend(target: BendTarget, stiffness: Floats, limits: RoutingLimits, beside: int) -> None:
    """Refuse a curve, or limits, for which there are no tendons; `beside` are on one circle."""
    offset = limits.offset_max
    if stiffness[0] * target.sharpest < LEAST_PULL_N * offset:
        raise GeometryError(
            f"the curve is straight: to bend to it takes less than {LEAST_PULL_N:g} N of a tendon "
            f"{offset:g} mm from the backbone"
        )
    if offset * target.sharpest >= 1.0:
        shown = show_apart(offset, 1.0 / target.sharpest)
        raise InputError(
            f"offset max is {shown[0]} mm: it must be less than {shown[1]} mm, "
            "the least radius of the curve"
        )
    apart = 2.0 * offset * math.sin(math.pi / beside) if beside > 1 else math.inf
    if limits.gap_min > apart:
        raise InputError(
            f"gap min is {limits.gap_min:g} mm: {beside} tendons {offset:g} mm from the backbone "
            f"are at most {apart:.3g} mm apart"
        )


def _take_section(robot: RobotDesign | None, limits: RoutingLimits) -> Section:
    """Return the section whose radius and stiffnesses a design takes."""
    if robot is None:
        return Section(length=1.0, radius=max(2.5, limits.offset_max))
    check_robot(robot)
    if len(robot.sections) != 1:
        raise InputError(
            f"robot '{robot.name}' has {len(robot.sections)} sections: give one of 1 section, "
            "whose radius and stiffnesses are taken"
        )
    section = robot.sections[0]
    if section.radius < limits.offset_max:
        shown = show_apart(limits.offset_max, section.radius)
        raise InputError(
            f"offset max is {shown[0]} mm: it must lie in (0, {shown[1]}] mm, "
            "inside the body's radius"
        )
    return section


def take_curve(curve: ArrayLike | Plan) -> Floats:
    """Return the points of a curve or of a plan's path, none twice in a row."""
    points = curve.path if isinstance(curve, Plan) else check_points("curve", curve)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
        raise InputError(f"curve has shape {points.shape}: it must be (m, 3) with m at least 2")
    apart = np.linalg.norm(np.diff(points, axis=0), axis=1) > LENGTH_ROUND_OFF_MM
    points = points[np.concatenate([[True], apart])]
    length = float(measure_arc_length(points)[-1])
    if not SHORTEST_MM <= length <= LONGEST_MM:
        shown = show_apart(length, SHORTEST_MM, LONGEST_MM)
        raise InputError(f"curve is {shown[0]} mm long: it must be {shown[1]} to {shown[2]} mm")
    return np.asarray(points)


def _find_space(curve: ArrayLike | Plan, duct: Duct | None) -> FreeSpace | None:
    if duct is None:
        return None
    if duct.dim != 3:
        raise InputError("the duct is planar: a robot's shape is certified in 3 dimensions")
    introducer = curve.introducer if isinstance(curve, Plan) else None
    return FreeSpace(duct, introducer=introducer)


def _route_curved(
    target: BendTarget, stiffness: Floats, limits: RoutingLimits, tendons: int
) -> tuple[tuple[Tendon, ...], Floats, Floats]:
    """Return tendons, the base's frame and tensions: from the closed form, by the exact law."""
    fit = (
        PathFit(target, stiffness, limits)
        if tendons == 1
        else AngleFit(target, stiffness, limits, tendons)
    )
    found = fit.settle(target)
    length = target.steps.length
    places = np.linspace(0.0, length, math.ceil(length / KNOT_MM) + 1)
    splines = make_splines(length, fit.count)
    guides, _ = fit.guide(found[:-3], splines(places), splines(places, 1))
    made = tuple(
        Tendon(
            name=f"T{k + 1}",
            path=np.column_stack([places, guides[:, k, :2].round(KNOT_DIGITS)]).tolist(),
            interpolation="cubic",
        )
        for k in range(tendons)
    )
    return made, fit.place_base(found[-3:]), np.asarray(found[:-3][-tendons:])


def _route_straight(
    target: BendTarget, stiffness: Floats, offset: float, tendons: int
) -> tuple[tuple[Tendon, ...], Floats, Floats]:
    found = fit_straight(target, stiffness, offset=offset, tendons=tendons)
    ends = np.minimum(found.ends, target.steps.length)
    made = tuple(
        Tendon(name=f"T{k + 1}", offset=offset, angle=float(angle), end=float(end))
        for k, (angle, end) in enumerate(zip(found.angles, ends, strict=True))
    )
    return made, found.frame, found.tensions


def _cut_section(section: Section, length: float, tendons: tuple[Tendon, ...]) -> Section:
    """Return a section of a length, with discs for it."""
    return Section(
        length=length,
        radius=section.radius,
        tendons=tendons,
        discs=max(1, math.ceil(length / DISC_MM)),
        bending_stiffness=float(section.mean_stiffness[0]),
        torsional_stiffness=float(section.mean_stiffness[2]),
        name=section.name,
    )


def _judge(
    robot: ContinuumRobot,
    points: Floats,
    frame: Floats,
    tensions: Floats,
    asked: tuple[RoutingLimits, RoutingKind],
    space: FreeSpace | None,
) -> RoutingDesign:
    """Return what both models, the limits and the wall say of a robot."""
    limits, routing = asked
    model = _make_rod(robot)
    shape = model.shape_under_tensions(tensions)
    found = _place(shape, frame)
    error = _measure_error(shape, found, points)
    energy = EnergyModel(robot, segment="channel", between=0).shape(shape.displacements)
    other = _measure_error(energy, _place(energy, frame), points)
    reasons = [
        f"{name} model: {each.reason}"
        for name, each in (("rod", shape), ("energy", energy))
        if not each.converged
    ]
    if error[1] > limits.error_max:
        reasons.append(
            f"the backbone is up to {error[1]:.3f} mm from the curve: allowed is "
            f"{limits.error_max:g} mm"
        )
    slope, gap, least, most = _measure_routing(robot)
    if routing == "curved":
        reasons += _list_passed(limits, slope, gap, (least, most))
    proof = None if space is None else _certify_pose(found, shape, space, robot.radius)
    if proof is not None and not proof.certified:
        reasons.append("it is not proved that the pose keeps clear of the wall")
    return RoutingDesign(
        robot=robot,
        routing=routing,
        curve=points,
        frame=frame,
        tensions=tensions,
        displacements=shape.displacements,
        error_rms=error[0],
        error_max=error[1],
        energy_error_rms=other[0],
        energy_error_max=other[1],
        slope=slope,
        gap=gap,
        offset_least=least,
        offset_most=most,
        by_tension=_vary(shape, 0.01 * tensions, tensions, model.shape_under_tensions),
        by_displacement=_vary(shape, np.full(len(tensions), 0.1), shape.displacements, model.shape),
        certificate=proof,
        converged=not reasons,
        reason="; ".join(reasons),
    )


def _make_rod(robot: ContinuumRobot) -> RodModel:
    return RodModel(robot, between=BETWEEN)


def _place(shape: Shape, frame: Floats) -> Floats:
    """Return the backbone in the world frame (k, 3) [mm]."""
    return np.asarray(shape.points @ frame[:3, :3].T + frame[:3, 3])


def _measure_error(shape: Shape, found: Floats, points: Floats) -> tuple[float, float]:
    """Return the rms and the largest distance from a curve, at equal arc length [mm]."""
    off = np.linalg.norm(
        found - interpolate_polyline(points, measure_arc_length(points), shape.arc_length), axis=1
    )
    return float(np.sqrt(np.mean(off**2))), float(off.max())


def _measure_routing(robot: ContinuumRobot) -> tuple[float, float, float, float]:
    """Return the largest slope, least gap, and least and largest offset of the tendons."""
    places = robot.stations(between=4 * BETWEEN)
    paths: list[Floats] = []
    slope, gap, least, most = 0.0, math.inf, math.inf, 0.0
    for tendon, end in zip(robot.tendons, robot.tendon_ends, strict=True):
        here = np.minimum(places[places <= end + LENGTH_ROUND_OFF_MM], end)
        path = tendon.place_at(here)
        offsets = np.hypot(*path.T)
        slope = max(slope, float(np.hypot(*tendon.slope_at(here).T).max()))
        least, most = min(least, float(offsets.min())), max(most, float(offsets.max()))
        for other in paths:
            both = min(len(other), len(path))
            gap = min(gap, float(np.hypot(*(other[:both] - path[:both]).T).min()))
        paths.append(path)
    return slope, gap, least, most


def _list_passed(
    limits: RoutingLimits, slope: float, gap: float, offsets: tuple[float, float]
) -> list[str]:
    """Return a sentence for each limit that a routing does not keep."""
    reasons = []
    least, most = offsets
    if slope > limits.slope_max + SLOPE_ROUND_OFF:
        shown = show_apart(slope, limits.slope_max, digits=3)
        reasons.append(f"the tendons' slope is up to {shown[0]}: allowed is {shown[1]}")
    if gap < limits.gap_min - LENGTH_ROUND_OFF_MM:
        shown = show_apart(gap, limits.gap_min, digits=3)
        reasons.append(
            f"two tendons come as near as {shown[0]} mm: the least distance is {shown[1]} mm"
        )
    if least < limits.core_radius - LENGTH_ROUND_OFF_MM:
        shown = show_apart(least, limits.core_radius, digits=3)
        reasons.append(
            f"a tendon comes within {shown[0]} mm of the backbone: the core's radius is "
            f"{shown[1]} mm; one tendon crosses it at inflections, two need not"
        )
    if most > limits.offset_max + LENGTH_ROUND_OFF_MM:
        shown = show_apart(most, limits.offset_max, digits=3)
        reasons.append(
            f"a tendon is {shown[0]} mm from the backbone: the largest offset is {shown[1]} mm"
        )
    return reasons


def _vary(shape: Shape, steps: Floats, command: Floats, solve: Callable[[Floats], Shape]) -> Floats:
    """Return how far the backbone moves by a step of each input, and of all of them [mm]."""
    commands = command + np.vstack([np.diag(steps), steps])
    moved = solve(commands)
    far = np.linalg.norm(moved.points - shape.points, axis=-1).max(axis=-1)
    return np.asarray(np.where(moved.converged, far, math.inf))


def _certify_pose(found: Floats, shape: Shape, space: FreeSpace, radius: float) -> Certificate:
    """Return what is proved of the clearance of a still backbone (k, 3)."""
    chain = found[::-1]
    if space.introducer is not None:
        chain = np.vstack([chain, found[0] + TAIL_MM * space.introducer.outward])
    tangents = shape.frames[:, :3, 2]
    turns = np.linalg.norm(np.diff(tangents, axis=0), axis=1)
    # How far an arc is off its chord.
    sagitta = float((turns * np.diff(shape.arc_length)).max()) / 8.0
    return certify_motion(chain[None], space, radius=radius + 1.01 * sagitta)

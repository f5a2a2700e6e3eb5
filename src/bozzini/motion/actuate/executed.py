r"""The certificate of an executed motion: bent arcs, also between the steps of the time table.

Between two steps the drives move evenly, so the displacements are linear in time; for parallel
tendons the bends are linear in the displacements, hence in time too. The body that is certified
is the one of constant curvature whose bends and base advance move so.

Proof. Let :math:`X(s, t)` be the backbone, with :math:`t` from 0 to 1 within a step, section
lengths :math:`l_i`, and bends :math:`b_i(t)`, linear. Sections turn by
:math:`R' = R [k]`, :math:`k = (-b_y, b_x, 0) / l_i` in section :math:`i`, and
:math:`X(s, t) = x_0(t) + \int_0^s R e_3`, with :math:`x_0` linear in time.

*Along the arc.* The backbone's curvature is :math:`\kappa = |b_i(t)| / l_i`, at most that at the
step's ends, since a norm is convex. A chord over an arc length :math:`h` therefore stays within
:math:`h^2 \kappa / 8` of it, point by point at equal arc length.

*In time.* :math:`R(s, t)` is a product of exponentials ordered by :math:`s`, and :math:`k` is
linear in time, so its second derivative is twice the integral over :math:`\sigma_1 < \sigma_2 < s`
of a product of rotations with :math:`[\dot k(\sigma_1)]` and :math:`[\dot k(\sigma_2)]` in their
places. As :math:`|[\dot k] v| \le |\dot k| |v|`,

.. math:: |\ddot R e_3| \le \left(\int_0^s |\dot k| \, d\sigma\right)^2 = A(s)^2, \qquad
          |\ddot X(s, t)| \le \int_0^s A^2 \, d\sigma \le M,

where :math:`A` grows evenly by :math:`|\dot b_i|` in section :math:`i`. With :math:`n` equal parts
of the step, a point that moves straight from one to the next stays within :math:`M / (8 n^2)` of
the point of equal arc length on the body.

*Together.* The chain whose joints stand on the arcs and move straight between the parts is
linear in arc length between joints and linear in time between parts, so each of its points is
within :math:`\varepsilon = \max h^2 \kappa / 8 + \max M / (8 n^2)` of the body's point of equal
arc length and time. A ball of radius :math:`r + \varepsilon` about the one holds that of radius
:math:`r` about the other: if the chain with its radius enlarged by :math:`\varepsilon` keeps off
the wall, so does the body. `bozzini.motion.certify_motion` proves the former, introducer
included. The body ends in a half ball beyond the tip; all of it has the robot's largest radius.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_array, check_integer, check_number, check_points, check_range, quantity
from ...continuum import ContinuumRobot
from ...errors import InputError
from ...numeric.arrays import Floats
from ..certify import TOLERANCE_MM, certify_motion
from ..plan import read_record, write_record
from ..scope import Introducer
from ..space import FreeSpace


@dataclass(frozen=True, kw_only=True, eq=False)
class ArcCertificate:
    """What is proved about an executed motion.

    Parameters
    ----------
    clearance : float
        No point of the body's surface ever comes nearer to the wall than this [mm], steps and
        all times between included; negative: nothing is proved but that it goes through by no
        more than this. Infinite if the robot never leaves the introducer.
    found : float
        The smallest lower bound met at a point of the body's surface [mm].
    step : float
        When that was, a fraction of a step.
    section : int
        On which section that was, 0 the first.
    arc_length : float
        Where on the robot, middle of the chord, from its base [mm].
    place : (3,) float
        Where, world frame [mm].
    deviation : float
        How far the chain that was certified is off the body at most [mm]; it is taken off.
    resolved : bool
        Whether the search ended within its tolerance.
    chords, instants : int
        Size of the chain: links, and times.
    evaluations : int
        How often the field was asked.
    wall : str
        The wall that the bound is for.

    Raises
    ------
    InputError
        If a value is no number or out of range, or the bound is larger than the value found.
    """

    clearance: float = quantity("length", default=math.inf)
    found: float = quantity("length", default=math.inf)
    step: float
    section: int
    arc_length: float
    place: Floats = field(metadata={"key": "place_mm"})
    deviation: float
    resolved: bool
    chords: int
    instants: int
    evaluations: int
    wall: str

    def __post_init__(self) -> None:
        for name in ("clearance", "found"):
            bound = check_array(f"certificate {name}", getattr(self, name))
            if bound.ndim or np.isnan(bound):
                raise InputError(f"certificate {name} is {bound}: it must be a number")
            object.__setattr__(self, name, float(bound))
        if self.clearance > self.found + ROUND_OFF_MM:
            raise InputError(
                f"certificate clearance is {self.clearance:g} mm: it cannot be more than the "
                f"smallest value found, {self.found:g} mm"
            )
        for name in ("step", "arc_length", "deviation"):
            value = check_number(f"certificate {name}", getattr(self, name), low=0.0)
            object.__setattr__(self, name, value)
        for name in ("section", "chords", "instants", "evaluations"):
            whole = check_integer(f"certificate {name}", getattr(self, name), low=0)
            object.__setattr__(self, name, whole)
        place = check_points("certificate place", check_array("certificate place", self.place))
        if place.shape != (3,):
            raise InputError(f"certificate place has shape {place.shape}: it must be (3,)")
        object.__setattr__(self, "place", place)
        if not isinstance(self.resolved, (bool, np.bool_)):
            raise InputError(f"certificate resolved is {self.resolved!r}: it must be true or false")
        object.__setattr__(self, "resolved", bool(self.resolved))
        if not isinstance(self.wall, str):
            raise InputError(f"certificate wall is {self.wall!r}: it must be a text")

    @property
    def certified(self) -> bool:
        """Whether it is proved that the body, as far as it leaves the introducer, is clear."""
        return 0.0 <= self.clearance < math.inf

    def describe(self) -> dict[str, object]:
        """Return the certificate as JSON-able values; infinite numbers are None."""
        return write_record(self)

    @classmethod
    def from_description(cls, description: Mapping[str, object]) -> ArcCertificate:
        """Read a certificate from what `describe` gives.

        Raises
        ------
        InputError
            If a value is missing or has the wrong form.
        """
        try:
            return read_record(cls, description, "certificate")
        except InputError as error:
            raise InputError(f"not a certificate of arcs: {error}") from None


DEVIATION_MM = 0.02
"""How far the chain may be off the arcs: along the arc, and again in time."""

ROUND_OFF_MM = 1e-9
"""Added to the deviation for round-off [mm]."""

BLOCK = 2_000_000
"""Joints certified at a time."""

JOINTS_MAX = 400_000_000
"""Joints at most."""


def find_base_frame(introducer: Introducer, *, roll: float = 0.0) -> Floats:
    """Return the frame (4, 4) of a robot's base at the introducer's inner end.

    z points into the tract; x is the world's axis most across it, turned by `roll` [rad] about
    z.
    """
    z = -introducer.outward
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - z * (x @ z)
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    frame = np.eye(4)
    cosine, sine = math.cos(roll), math.sin(roll)
    frame[:3, 0], frame[:3, 1] = cosine * x + sine * y, cosine * y - sine * x
    frame[:3, 2], frame[:3, 3] = z, introducer.entry
    return frame


def place_bodies(
    robot: ContinuumRobot,
    bends: ArrayLike,
    advances: ArrayLike,
    frame: ArrayLike,
    *,
    times: ArrayLike,
    chords: ArrayLike,
) -> Floats:
    """Return points of the backbone at any times, bends and advance moving evenly between steps.

    Parameters
    ----------
    robot : ContinuumRobot
        The robot.
    bends : (steps, m, 2) array_like
        Bends of the sections [rad].
    advances : (steps,) array_like
        How far the base has been moved in [mm]; at the robot's length it stands at `frame`.
    frame : (4, 4) array_like
        See `find_base_frame`.
    times : (n,) array_like
        In steps, from 0 to ``steps - 1``.
    chords : (m,) array_like of int
        Into how many equal parts each section is cut.

    Returns
    -------
    (n, sum of chords + 1, 3) ndarray
        World frame [mm], tip first.

    Raises
    ------
    InputError
        If `times` has another shape, or a time is outside the motion.
    """
    from ..kernels.actuate import fill_bodies

    bend, advance = np.ascontiguousarray(bends, float), np.ascontiguousarray(advances, float)
    base, parts = np.asarray(frame, dtype=np.float64), np.asarray(chords, dtype=np.int64)
    when = check_array("times", times)
    if when.ndim != 1:
        raise InputError(f"times has shape {when.shape}: it must be (n,)")
    check_range("times", when, 0.0, len(bend) - 1.0, "steps")
    steps = np.floor(when).astype(np.int64)
    lengths = np.array([section.length for section in robot.sections])
    joints = np.empty((len(when), int(parts.sum()) + 1, 3))
    fill_bodies(
        lengths,
        parts,
        np.ascontiguousarray(base),
        np.ascontiguousarray(-base[:3, 2]),
        robot.length,
        bend,
        advance,
        steps,
        when - steps,
        joints,
    )
    return joints


def certify_arcs(
    robot: ContinuumRobot,
    bends: ArrayLike,
    advances: ArrayLike,
    space: FreeSpace,
    *,
    roll: float = 0.0,
    deviation: float = DEVIATION_MM,
) -> ArcCertificate:
    """Prove a lower bound on the clearance of a robot of arcs that executes a motion.

    Parameters
    ----------
    robot : ContinuumRobot
        The robot; its base looks along the introducer's axis.
    bends : (steps, m, 2) array_like
        Bends of the sections at the steps [rad]; linear between them.
    advances : (steps,) array_like
        How far the base has been moved in [mm]; linear between steps. At 0 the straight robot's
        tip stands at the entry.
    space : FreeSpace
        The free space, three-dimensional, with an introducer.
    roll : float
        Turn of the base about the introducer's axis [rad].
    deviation : float
        How far the chain that stands for the arcs may be off them along the arc, and again in
        time [mm].

    Raises
    ------
    InputError
        If an argument has the wrong shape or is out of range, or the motion is too coarse: its
        steps would have to be cut into too many parts.
    """
    sections = len(robot.sections)
    bend = check_points("bends", bends, dim=2)
    if bend.ndim != 3 or bend.shape[0] < 1 or bend.shape[1] != sections:
        raise InputError(f"bends has shape {bend.shape}: it must be (steps, {sections}, 2)")
    advance = check_points("advances", np.asarray(advances, dtype=np.float64)[..., None], dim=1)
    advance = advance[..., 0]
    if advance.shape != bend.shape[:1]:
        raise InputError(f"advances has shape {advance.shape}: it must be ({len(bend)},)")
    if space.duct.dim != 3:
        raise InputError("the duct is planar: a robot moves in a duct of 3 dimensions")
    check_number("deviation", deviation, low=1e-5, high=1.0, unit="mm")
    check_number("roll", roll, unit="rad")

    lengths = np.array([section.length for section in robot.sections])
    chords, parts, off = choose_grid(lengths, bend, deviation=deviation)
    width = int(chords.sum()) + 1
    if width * (parts.sum() + 1.0) > JOINTS_MAX:
        worst = int(np.argmax(parts))
        raise InputError(
            f"the motion is too coarse to certify: {parts[worst]} parts of step {worst} would be "
            "needed; plan with smaller head steps"
        )
    times = _spread_times(parts)
    frame = find_base_frame(space.tube, roll=roll)
    best: ArcCertificate | None = None
    total, resolved = 0, True
    block = max(2, BLOCK // width)
    lowest = math.inf
    for begin in range(0, max(1, len(times) - 1), block):
        when = times[begin : begin + block + 1]
        joints = place_bodies(robot, bend, advance, frame, times=when, chords=chords)
        piece = certify_motion(joints, space, radius=robot.radius + off, tolerance=TOLERANCE_MM)
        total += piece.evaluations
        resolved &= piece.resolved
        # Far outside the lumen the field is no distance, and the bound may pass what was found.
        proved = min(piece.clearance, piece.found)
        lowest = min(lowest, proved)
        if best is None or piece.found < best.found:
            # Link 1 is the tip's; in the introducer nothing is found, and there is none.
            section, middle = _find_chord(chords, lengths, width - 1 - max(piece.link, 1))
            best = ArcCertificate(
                clearance=proved,
                found=piece.found,
                step=float(np.interp(piece.step, np.arange(len(when)), when)),
                section=section,
                arc_length=middle,
                place=piece.place,
                deviation=off,
                resolved=resolved,
                chords=width - 1,
                instants=len(times),
                evaluations=total,
                wall=piece.wall,
            )
    if best is None:
        raise InputError("the motion has no steps")
    return replace(best, clearance=lowest, resolved=resolved, evaluations=total)


def choose_grid(
    lengths: Floats, bends: Floats, *, deviation: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], float]:
    """Return how finely to cut sections and steps, for chords to stay near the arcs.

    Parameters
    ----------
    lengths : (m,) float
        Of the sections [mm].
    bends : (steps, m, 2) float
        At the steps [rad].
    deviation : float
        How far a chord may be off, along the arc, and again in time [mm].

    Returns
    -------
    chords : (m,) int
        Chords of each section.
    parts : (steps - 1,) int
        Parts of each step.
    off : float
        How far any point of the chain is off its point of the body at most [mm].
    """
    from ..kernels.actuate import bound_bending

    sag = 0.125 * lengths * np.linalg.norm(bends, axis=2).max(axis=0)
    chords = np.maximum(1, np.ceil(np.sqrt(sag / deviation))).astype(np.int64)
    swing = np.zeros(len(bends) - 1)
    bound_bending(lengths, bends, swing)
    swing *= 0.125
    parts = np.maximum(1, np.ceil(np.sqrt(swing / deviation))).astype(np.int64)
    off = float((sag / chords**2).max()) + float((swing / parts**2).max(initial=0.0))
    return chords, parts, off + ROUND_OFF_MM


def _spread_times(parts: NDArray[np.int64]) -> Floats:
    """Return the times, in steps, that cut step k into parts[k] equal parts."""
    if not len(parts):
        return np.zeros(1)
    pieces = [step + np.arange(count) / count for step, count in enumerate(parts)]
    return np.concatenate([*pieces, [float(len(parts))]])


def _find_chord(chords: NDArray[np.int64], lengths: Floats, index: int) -> tuple[int, float]:
    """Return the section of the chord `index` from the base, and its middle's arc length."""
    ends = np.cumsum(chords)
    section = int(np.searchsorted(ends, index, side="right"))
    section = min(section, len(chords) - 1)
    within = index - (ends[section] - chords[section]) + 0.5
    start = float(lengths[:section].sum())
    return section, start + float(within * lengths[section] / chords[section])

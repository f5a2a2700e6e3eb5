"""Inverse kinematics: from a lateral target of the tip to the pressures (thesis 4.5)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_axes, check_number, check_points, check_range
from ..errors import InputError
from ..muscle import MuscleModel
from ..numeric.arrays import Floats
from ..numeric.roots import polish
from ..results import Json, Result, Shown, list_coordinates, measured, take_axes, to_plain
from .design import EffectorDesign
from .equilibrium import list_muscles, settle_muscles
from .kernels import inverse as kernels
from .kernels.balance import SATURATED
from .linkage import describe_end, lateral_slope
from .model import EffectorModel, PackedEffector

if TYPE_CHECKING:
    from matplotlib.axes import Axes


UNCOVERED_GAP_RAD = math.pi - 1e-9
"""Gap from which two muscles no longer cover the directions between them [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sectors(Shown):
    """The sectors between neighbouring muscles, in the order of their angles.

    Attributes
    ----------
    order : (m,) int
        Indices of the muscles in the design, by angle in [0, 2 pi).
    angles : (m,) float
        Angles in that order [rad].
    gaps : (m,) float
        Angle from muscle ``order[k]`` to the next, the last to the first [rad]; they add up to
        2 pi.
    covered : (m,) bool
        Whether the two muscles reach the directions between them: the gap is less than half a turn.
    """

    order: NDArray[np.int64]
    angles: Floats
    gaps: Floats
    covered: NDArray[np.bool_]
    cosines: Floats
    sines: Floats

    @property
    def covers_all(self) -> bool:
        """Whether every direction lies between two muscles less than half a turn apart."""
        return bool(self.covered.all())

    def describe_gaps(self, names: tuple[str, ...]) -> str:
        """Return the gaps that are not covered as text, such as ``from G to B (200 deg)``."""
        count = self.order.size
        return ", ".join(
            f"from {names[self.order[k]]} to {names[self.order[(k + 1) % count]]} "
            f"({math.degrees(self.gaps[k]):g} deg)"
            for k in np.flatnonzero(~self.covered)
        )


def find_sectors(design: EffectorDesign) -> Sectors:
    """Return the sectors between the muscles of a design."""
    angles = np.mod(np.asarray(design.angles, dtype=np.float64), 2.0 * math.pi)
    order = np.argsort(angles, kind="stable")
    angles = angles[order]
    gaps = np.diff(angles, append=angles[0] + 2.0 * math.pi)
    return Sectors(
        order=order,
        angles=angles,
        gaps=gaps,
        covered=gaps < UNCOVERED_GAP_RAD,
        cosines=np.cos(angles),
        sines=np.sin(angles),
    )


INVERSE_OUTCOMES = ("reached", "muscle limit", "largest deflection", "gap")
"""What the codes 0 to 3 of an inverse mean."""

TARGET_LIMIT_MM = 1e9
"""Largest legal coordinate of a target [mm]: a limit of the arithmetic."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ProjectedInverse(Shown):
    """Displacements of the two muscles on either side of a target (thesis 4.10-4.16).

    Attributes
    ----------
    target : (..., 2) float
        Lateral position wanted [mm].
    displacements : (..., m) float
        Displacement by each muscle in its own direction, in the order of the design [mm]; at most
        two are not zero.
    pair : (..., 2) int
        The two muscles as indices in the design; -1 where there is none. The second is the next
        one by angle. A target along a muscle has that muscle and a neighbour, with 0 mm.
    share : (...) float
        Share of the target that is delivered, ``R / |v|``.
    delivered : (..., 2) float
        ``share * target``: where the displacements lead [mm].
    code : (...) int
        Index into `INVERSE_OUTCOMES`. 0: reached; 1: a muscle at its amplitude; 2: the largest
        deflection of the backbone; 3: a direction in a gap between muscles of half a turn or more.
    """

    target: Floats = measured("mm")
    displacements: Floats = measured("mm")
    pair: NDArray[np.int64]
    share: Floats
    delivered: Floats = measured("mm")
    code: NDArray[np.int64]

    @property
    def reachable(self) -> NDArray[np.bool_]:
        """Whether the whole target is delivered."""
        return np.asarray(self.code == kernels.REACHED)


def project_inverse(
    design: EffectorDesign,
    target: ArrayLike,
    *,
    amplitudes: ArrayLike,
    peak: float = math.inf,
) -> ProjectedInverse:
    """Split lateral targets between the two muscles of the sector they lie in.

    The sector is the one where neither displacement is negative, which is the thesis's angle test
    with the gap taken modulo 2 pi and without its exact equality. Beyond the amplitudes the
    direction is kept: ``t = min(1, A_i / a_i, A_j / a_j)`` is (4.15) and (4.16) in one. Only the
    two neighbours are used, as in the thesis; with four muscles or more, three at once could reach
    further.

    Parameters
    ----------
    design : EffectorDesign
    target : (..., 2) array_like
        Lateral positions [mm].
    amplitudes : () or (m,) array_like
        Largest displacement by each muscle, in the order of the design [mm].
    peak : float
        Largest deflection of the backbone, whatever the muscles [mm].

    Raises
    ------
    InputError
        If an argument has a wrong shape, or a value is not finite or negative.
    """
    targets = take_targets(target)
    sectors = find_sectors(design)
    limit = check_number("peak", 1e12 if peak == math.inf else peak, low=0.0, high=1e12, unit="mm")
    return split(sectors, targets, take_amplitudes(design, amplitudes), limit)


def take_targets(target: ArrayLike) -> Floats:
    """Return lateral targets as (..., 2) floats, or raise `InputError`."""
    return _take_places("target", target)


def take_place(name: str, place: ArrayLike) -> Floats:
    """Return one lateral place as (2,) floats, or raise `InputError`."""
    point = _take_places(name, place)
    if point.shape != (2,):
        raise InputError(f"{name} has shape {point.shape}: it must be (2,)")
    return point


def _take_places(name: str, places: ArrayLike) -> Floats:
    targets = check_points(name, check_array(name, places), dim=2)
    check_axes(name, targets, -TARGET_LIMIT_MM, TARGET_LIMIT_MM, "mm")
    return targets


def take_amplitudes(design: EffectorDesign, amplitudes: ArrayLike) -> Floats:
    """Return amplitudes as (m,) floats, or raise `InputError`."""
    count = len(design.muscles)
    values = check_array("amplitudes", amplitudes)
    if values.shape not in ((), (count,)):
        raise InputError(f"amplitudes has shape {values.shape}: it must be () or ({count},)")
    check_range("amplitude", values, 0.0, 1e12, "mm")
    return np.array(np.broadcast_to(values, (count,)))


def split(
    sectors: Sectors,
    targets: Floats,
    amplitudes: Floats,
    peak: float,
) -> ProjectedInverse:
    """Return the inverse of checked targets; `amplitudes` in the order of the design."""
    shape, count = targets.shape[:-1], sectors.order.size
    flat = np.ascontiguousarray(targets).reshape(-1, 2)
    rows = len(flat)
    displacements = np.empty((rows, count))
    pair = np.empty((rows, 2), dtype=np.int64)
    share = np.empty(rows)
    code = np.empty(rows, dtype=np.int64)
    kernels.split_targets(
        sectors.order,
        sectors.cosines,
        sectors.sines,
        sectors.covered,
        amplitudes[sectors.order],
        peak,
        flat,
        displacements,
        pair,
        share,
        code,
    )
    return ProjectedInverse(
        target=targets,
        displacements=displacements.reshape(*shape, count),
        pair=pair.reshape(*shape, 2),
        share=share.reshape(shape),
        delivered=share.reshape(*shape, 1) * targets,
        code=code.reshape(shape),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Reach(Shown):
    """What the muscles of an end-effector can do, each alone.

    Attributes
    ----------
    names : tuple of str
        The muscles, in the order of the design.
    amplitudes : (m,) float
        Lateral deflection by each at the pressure limit, ``A_i`` [mm].
    saturated : (m,) bool
        Whether the muscle could go on, but the backbone's largest deflection is reached.
    peak : float
        The backbone's largest deflection [mm].
    peak_reason : str
        What ends it there, in words.
    pressure_limit : float
        The pressure limit [MPa].
    sectors : Sectors
        The sectors between the muscles.
    """

    names: tuple[str, ...]
    amplitudes: Floats
    saturated: NDArray[np.bool_]
    peak: float
    peak_reason: str
    pressure_limit: float
    sectors: Sectors


# By identity: packing is what an effector does once, and its hash would cost more than an inverse.
_KNOWN: WeakKeyDictionary[PackedEffector, Reach] = WeakKeyDictionary()


def find_reach(effector: EffectorModel) -> Reach:
    """Return how far each muscle alone takes the tip; computed once for an effector.

    It is what it does at the pressure limit, which is the most as long as more pressure contracts
    the muscle more. (`ThesisMuscle` contracts less again above some 3 MPa.)

    Raises
    ------
    InputError
        If a muscle's model has no answer at the pressure limit.
    """
    known = _KNOWN.get(effector.packed)
    if known is not None:
        return known
    design = effector.design
    settled = settle_muscles(effector, np.full((1, len(design.muscles)), design.pressure_limit))
    amplitudes = np.minimum(settled.lateral[0], effector.packed.peak.lateral)
    saturated = settled.code[0] == SATURATED
    amplitudes.setflags(write=False)
    saturated.setflags(write=False)
    found = Reach(
        names=design.names,
        amplitudes=amplitudes,
        saturated=saturated,
        peak=effector.packed.peak.lateral,
        peak_reason=describe_end(design),
        pressure_limit=design.pressure_limit,
        sectors=find_sectors(design),
    )
    _KNOWN[effector.packed] = found
    return found


def find_model_pressures(
    model: MuscleModel, contraction: Floats, force: Floats, *, limit: float
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return pressures in [0, limit], what pull is left over, and iterations, all (n,).

    Where the muscle would not contract so far without load, its free contraction is what is looked
    at: some models have no pull beyond it. No contraction is 0 MPa.
    """
    pressure, left_over = np.zeros(contraction.size), np.zeros(contraction.size)
    iterations = np.zeros(contraction.size, dtype=np.int64)

    def miss(index: NDArray[np.intp], at: Floats) -> Floats:
        return _measure(model, at, contraction[index], force[index])

    active = np.flatnonzero(contraction > 0.0)
    if active.size:
        pressure[active] = limit
        left_over[active] = miss(active, pressure[active])
        active = active[left_over[active] > 0.0]
        ends = (np.zeros(active.size), -force[active]), (pressure[active], left_over[active])
        pressure[active], left_over[active], iterations[active] = polish(miss, active, *ends)
    return pressure, left_over, iterations


def _measure(model: MuscleModel, pressure: Floats, contraction: Floats, force: Floats) -> Floats:
    """Pull less force; where the free contraction is too short, how much so in its place."""
    short = model.free_contraction(pressure) - contraction
    miss = -force + force / contraction * np.minimum(short, 0.0)
    enough = short > 0.0
    if np.any(enough):
        miss[enough] = model.force(pressure[enough], contraction[enough]) - force[enough]
    return miss


MISS_TOLERANCE_MM = 1e-6
"""Miss up to which a pressure counts as converged [mm]; a linkage that ends is that steep."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectorInverse(ProjectedInverse, Result):
    """Pressures for lateral targets, and what they deliver.

    Of cubics, `delivered`, `contraction` and `force` are what their pressures do.

    Attributes
    ----------
    pressures : (..., m) float
        Pressures in the order of the design [MPa]; 0 for a muscle that is not needed.
    contraction, force : (..., m) float
        Contraction of each muscle [mm], and its pull [N].
    displacement_error : (...) float
        By how much a muscle's equations miss its displacement, the largest, to first order [mm].
        Of cubics: how far `delivered` is from what was asked of the muscles.
    settled : (...) bool
        Whether the equations were solved, for the target or for what is given in its place:
        `displacement_error` is at most 1e-6 mm; of cubics, that of the exact inverse is.
    iterations : (...) int
        Steps of all solvers together.
    reach : Reach
        The amplitudes it was limited by.
    pressure_map : {"exact", "cubic"}
        Where the pressures come from; "cubic" by `steer` only.
    """

    rows_have_verdict = True

    pressures: Floats = measured("MPa")
    contraction: Floats = measured("mm")
    force: Floats = measured("N")
    displacement_error: Floats = measured("mm")
    settled: NDArray[np.bool_]
    iterations: NDArray[np.int64]
    reach: Reach
    pressure_map: Literal["exact", "cubic"] = "exact"

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Whether the target is met: it is in reach, and missed by at most 1e-6 mm."""
        met = self.settled & (self.displacement_error <= MISS_TOLERANCE_MM)
        return np.asarray(self.reachable & met)

    @property
    def residual(self) -> Floats:
        """Distance from the target to `delivered`, shape (...) [mm]."""
        away = self.target - self.delivered
        return np.asarray(np.hypot(away[..., 0], away[..., 1]))

    @property
    def reason(self) -> NDArray[np.str_]:
        """Why a target is not met, and by how much, one sentence each; empty where `converged`."""
        lines = [self._explain(index) for index in range(self.code.size)]
        return np.array(lines, dtype=np.str_).reshape(self.code.shape)

    def _explain(self, index: int) -> str:
        code = int(self.code.flat[index])
        x, y = self.target.reshape(-1, 2)[index]
        missed = float(self.displacement_error.flat[index])
        if not self.settled.flat[index]:
            return f"not converged: a displacement is missed by {missed:.3g} mm"
        if code == kernels.REACHED:
            words = f"the cubics miss the target by {missed:.3g} mm"
            return words if missed > MISS_TOLERANCE_MM else ""
        known = self.reach
        size = math.hypot(x, y)
        goes = f"the target is {size:.4g} mm away, {self.share.flat[index] * size:.4g} mm are given"
        if code == kernels.PEAK:
            return f"the backbone deflects by {known.peak:.4g} mm, {known.peak_reason}: {goes}"
        if code == kernels.OUTSIDE:
            return (
                f"direction {math.degrees(math.atan2(y, x)):.4g} deg lies in a gap of half a turn "
                f"or more, {known.sectors.describe_gaps(known.names)}: {goes}"
            )
        row = self.displacements.reshape(-1, len(known.names))[index]
        full = [
            k
            for k in self.pair.reshape(-1, 2)[index]
            if k >= 0 and row[k] >= known.amplitudes[k] * (1.0 - 1e-12)
        ]
        who = " and ".join(f"{known.names[k]} ({known.amplitudes[k]:.4g} mm)" for k in full)
        most = f"its most for {known.pressure_limit:g} MPa"
        if all(known.saturated[k] for k in full):
            most = f"the backbone's largest deflection, {known.peak_reason}"
        return f"muscle {who} is at {most}: {goes}"

    def to_dict(self) -> Json:
        """Return the inverse as plain values, units in the names, ``muscles`` by theirs."""
        muscles = list_muscles(
            self.reach.names,
            pressure_MPa=self.pressures,
            displacement_mm=self.displacements,
            contraction_mm=self.contraction,
            force_N=self.force,
        )
        return super().to_dict() | {"residual_mm": to_plain(self.residual), "muscles": muscles}

    def list_columns(self) -> dict[str, Floats]:
        """Return the columns of `to_frame`, a row for each target."""
        columns = list_coordinates("target", self.target)
        for k, name in enumerate(self.reach.names):
            columns[f"pressure_{name}_MPa"] = self.pressures[..., k].ravel()
        columns |= list_coordinates("delivered", self.delivered)
        return {**columns, "residual_mm": np.ravel(self.residual)}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw targets and what is delivered, seen along the axis, and return the axes."""
        axes = take_axes(ax, x="x [mm]", y="y [mm]", equal=True)
        axes.plot(*self.target.reshape(-1, 2).T, "+", label="target")
        axes.plot(*self.delivered.reshape(-1, 2).T, "o", fillstyle="none", label="delivered")
        axes.legend()
        return axes


def solve_inverse(effector: EffectorModel, target: ArrayLike) -> EffectorInverse:
    """Return the pressures that bring the backbone's end to lateral targets.

    The inverse of `pose` by superposition, exact and by roots in one unknown each: (4.13) gives the
    displacement of each of two muscles, the linkage its contraction, the beam its pull
    ``F = displacement / c``, and the muscle's model the pressure at which it pulls so there.

    A target outside the workspace is answered in its own direction, as far out as can be; a
    direction that no two muscles cover gets no pressure. A muscle that has nothing to do gets 0
    MPa. As its displacement goes to 0 its pressure goes to that at which it begins to pull, above
    the dead band: there the pressure jumps, the tip does not.

    Parameters
    ----------
    effector : Effector
        Section and muscles.
    target : (..., 2) array_like
        Lateral position of the backbone's end [mm].

    Raises
    ------
    InputError
        If the target has a wrong shape or is not finite, or a model has no answer.
    """
    targets = take_targets(target)
    known = find_reach(effector)
    found = split(known.sectors, targets, known.amplitudes, known.peak)
    shape, count = targets.shape[:-1], len(known.names)
    moves = found.displacements.reshape(-1, count)
    contractions, pressures, residual, iterations = solve_displacements(
        effector, moves, limit=known.pressure_limit
    )
    residual = residual.reshape(shape)
    return EffectorInverse(
        **vars(found),
        pressures=pressures.reshape(*shape, count),
        contraction=contractions.reshape(*shape, count),
        force=found.displacements / effector.packed.compliance,
        displacement_error=residual,
        settled=np.asarray(residual <= MISS_TOLERANCE_MM),
        iterations=iterations.reshape(shape),
        reach=known,
    )


def solve_displacements(
    effector: EffectorModel, displacements: Floats, *, limit: float
) -> tuple[Floats, Floats, Floats, NDArray[np.int64]]:
    """Return contractions, pressures (n, m), residuals and iterations (n,) of displacements (n, m).

    Displacements must lie between 0 and the backbone's largest deflection; a pressure that would be
    above `limit` is given as that, and the residual shows it.
    """
    packed = effector.packed
    contractions, pressures = np.empty_like(displacements), np.empty_like(displacements)
    residual = np.empty(len(displacements))
    iterations = np.empty(len(displacements), dtype=np.int64)
    kernels.place_displacements(
        packed.linkage, packed.peak.contraction, displacements, contractions, residual, iterations
    )
    kernels.solve_pressures(
        packed.functions,
        packed.rows,
        packed.linkage,
        packed.compliance,
        limit,
        displacements,
        contractions,
        pressures,
        residual,
        iterations,
    )
    for k in packed.uncompiled:
        pulls = displacements[:, k] / packed.compliance
        pressures[:, k], left, steps = find_model_pressures(
            effector.models[k], contractions[:, k], pulls, limit=limit
        )
        residual = np.maximum(
            residual, _find_miss(effector, int(k), contractions[:, k], pressures[:, k], left)
        )
        iterations += steps
    return contractions, pressures, residual, iterations


def _find_miss(
    effector: EffectorModel, index: int, contractions: Floats, pressures: Floats, left_over: Floats
) -> Floats:
    """What `kernels.measure_left_over` is, of any model that leaves over a pull [N]."""
    packed = effector.packed
    miss = np.zeros(contractions.size)
    used = np.flatnonzero(contractions > 0.0)
    slopes = lateral_slope(effector.design, contractions[used])
    stiffness = np.zeros(used.size)
    if used.size:
        stiffness = effector.models[index].stiffness(pressures[used], contractions[used])
    whole = packed.compliance * np.abs(left_over[used])
    slopes = np.maximum(slopes, 0.0)
    give = slopes + packed.compliance * np.maximum(stiffness, 0.0)
    small = whole <= kernels.FIRST_ORDER_SHARE * give * contractions[used]
    share = np.where(small, slopes / np.where(give > 0.0, give, 1.0), 1.0)
    miss[used] = whole * share
    return miss

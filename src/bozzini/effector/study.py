"""Design studies: sweeps of a design, and the one of the least pressure."""

from __future__ import annotations

import difflib
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..checks import Quantity, check_integer, check_number, list_quantities, show_apart
from ..errors import BozziniError, InputError
from ..muscle import Muscle
from ..progress import Progress, no_progress
from ..results import Json, Result, Shown, measured, take_axes, to_plain
from ..units import add_unit
from .batch import HIGHEST_PRESSURE_MPA, can_batch, measure_designs
from .design import EffectorDesign, PlacedMuscle
from .effector import Effector
from .inverse import MISS_TOLERANCE_MM, find_reach, solve_displacements
from .workspace import workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Changes = dict[str, object]
"""Parameters of a design and their values, as in `change_design`."""


def check_parameter(name: str) -> None:
    """Raise `InputError` if a parameter is not one."""
    known = [*EffectorDesign.__dataclass_fields__, "length", "angles"]
    known += [f"muscle.{field}" for field in list_quantities(Muscle)]
    if name not in known:
        near = difflib.get_close_matches(str(name), known, n=1)
        hint = f"did you mean '{near[0]}'" if near else "give one such as 'offset'"
        raise InputError(
            f"there is no parameter '{name!s:.40}': {hint}; legal are a field of EffectorDesign, "
            "'length', 'angles', or 'muscle.' and a field of Muscle"
        )


def find_quantity(name: str) -> Quantity | None:
    """Return what is known of a parameter with a number as value; None of the others."""
    if name.startswith("muscle."):
        return list_quantities(Muscle).get(name.removeprefix("muscle."))
    return list_quantities(EffectorDesign).get("backbone_length" if name == "length" else name)


def check_value(design: EffectorDesign, name: str, value: object) -> Any:
    """Return a parameter's value as it is to be used, or raise `InputError` if it never is legal.

    Whether a design with it can be built may depend on the others, and is not looked at.
    """
    if name == "muscles":
        if not isinstance(value, (tuple, list)) or not all(
            isinstance(one, PlacedMuscle) for one in value
        ):
            raise InputError(f"muscles is {value!r:.60}: it must be 1 to 12 PlacedMuscle")
        return tuple(value)
    if name == "angles":
        return check_angles(design, value)
    if name == "beam_factor":
        return design.replace(beam_factor=value).beam_factor
    known = find_quantity(name) or Quantity()
    if callable(known.low) or callable(known.high):  # it depends on fields that may vary too
        known = replace(known, low=0.0, high=1e6)
    return known.check(name.replace("_", " "), value)


def check_angles(design: EffectorDesign, value: object) -> tuple[float, ...]:
    """Return the angles of all muscles [rad], or raise `InputError`."""
    names = design.names
    if isinstance(value, str) or not isinstance(value, (Sequence, np.ndarray)):
        raise InputError(f"angles is {value!r:.60}: give {len(names)} numbers in rad")
    angles = tuple(np.ravel(value)) if isinstance(value, np.ndarray) else tuple(value)
    if len(angles) != len(names):
        raise InputError(
            f"angles has {len(angles)} value(s): give {len(names)}, one for each of the muscles "
            f"{', '.join(names)}"
        )
    placed = tuple(
        PlacedMuscle(name=one.name, muscle=one.muscle, angle=angle)
        for one, angle in zip(design.muscles, angles, strict=True)
    )
    return tuple(float(angle) for angle in design.replace(muscles=placed).angles)


def list_values(design: EffectorDesign, name: str, values: object) -> tuple[object, ...]:
    """Return the values of a parameter to try, each one checked."""
    check_parameter(name)
    if isinstance(values, str) or not isinstance(values, (Sequence, np.ndarray)):
        raise InputError(f"values of {name} is {values!r:.60}: give a sequence of values")
    listed = tuple(values) if isinstance(values, Sequence) else tuple(np.atleast_1d(values))
    if not listed:
        raise InputError(f"values of {name} is empty, there is nothing to vary: give 1 or more")
    return tuple(check_value(design, name, value) for value in listed)


MOST_DESIGNS = 1_000_000


@dataclass(frozen=True, kw_only=True)
class SweepRow(Shown):
    """One design of a sweep; numbers are 0 where the design cannot be built.

    Attributes
    ----------
    changes : dict
        What was changed, as in `change_design`.
    feasible : bool
        Whether the design can be built and, if a deflection was asked for, reaches it.
    reason : str
        Why it is not feasible; empty if it is.
    least_amplitude, largest_amplitude : float
        Of the muscles' deflections at the pressure limit [mm].
    inner_radius : float
        Deflection that can be had in every direction [mm].
    area : float
        Of the projected workspace [mm^2].
    needed_pressure : float
        Pressure at which every muscle alone reaches the deflection asked for [MPa], the limit or
        not; 0 if none was, or if no pressure does.
    built : bool
        Whether the design can be built.
    """

    changes: Changes
    feasible: bool
    reason: str = ""
    least_amplitude: float = 0.0
    largest_amplitude: float = 0.0
    inner_radius: float = 0.0
    area: float = 0.0
    needed_pressure: float = 0.0
    built: bool = True


@dataclass(frozen=True, kw_only=True)
class Sweep(Result):
    """Designs side by side.

    Attributes
    ----------
    parameters : tuple of str
        What was varied.
    deflection : float
        Deflection asked for [mm]; 0 if none was.
    rows : tuple of SweepRow
        Every combination, the last parameter fastest; those that are not feasible are there too.
    """

    parameters: tuple[str, ...]
    deflection: float = measured("mm")
    rows: tuple[SweepRow, ...]

    @property
    def residual(self) -> float:
        """None is left over."""
        return 0.0

    @property
    def feasible(self) -> tuple[SweepRow, ...]:
        """The rows that are feasible."""
        return tuple(row for row in self.rows if row.feasible)

    @property
    def converged(self) -> bool:
        """Whether a design is feasible."""
        return bool(self.feasible)

    @property
    def reason(self) -> str:
        """Why no design is feasible, the first reason; empty if one is."""
        return "" if self.feasible or not self.rows else self.rows[0].reason

    def to_dict(self) -> Json:
        """Return the designs as plain values: `list_columns`, and how many are feasible."""
        return {
            "parameters": list(self.parameters),
            "deflection_mm": self.deflection,
            "designs": len(self.rows),
            "feasible": len(self.feasible),
            "converged": self.converged,
            "reason": self.reason,
            "residual": self.residual,
            "columns": to_plain(self.list_columns()),
        }

    def list_columns(self) -> dict[str, list[object]]:
        """Return the columns of `to_frame`, a row for each design."""
        columns: dict[str, list[object]] = {
            name_column(name): [_show_value(name, row.changes[name]) for row in self.rows]
            for name in self.parameters
        }
        columns["feasible"] = [row.feasible for row in self.rows]
        for name in ("least_amplitude_mm", "largest_amplitude_mm", "inner_radius_mm", "area_mm2"):
            field = name.rpartition("_")[0]
            columns[name] = [getattr(row, field) if row.built else None for row in self.rows]
        if self.deflection > 0.0:  # 0 is no pressure that anything needs: none reaches it
            columns["needed_pressure_MPa"] = [row.needed_pressure or None for row in self.rows]
        return {**columns, "reason": [row.reason for row in self.rows]}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the radius reached in every direction, design by design, and return the axes."""
        axes = take_axes(ax, x="design", y="radius in every direction [mm]")
        axes.plot([row.inner_radius for row in self.rows], "o")
        return axes


def name_column(name: str) -> str:
    """Return a parameter's name with its unit."""
    known = find_quantity(name)
    return "angles_deg" if name == "angles" else add_unit(name, known.unit if known else "")


def _show_value(name: str, value: Any) -> Any:
    if name == "angles":
        return "/".join(f"{math.degrees(angle):g}" for angle in value)
    return value


def change_design(design: EffectorDesign, changes: Mapping[str, object]) -> EffectorDesign:
    """Return a design with some things changed.

    Parameters
    ----------
    design : EffectorDesign
    changes : mapping of str to value
        A field of `EffectorDesign`; ``"length"`` for backbone and muscles together [mm];
        ``"angles"`` for the angles of all muscles, in order [rad]; or ``"muscle."`` and a field of
        `Muscle`, ``"muscle.braid_angle"`` for example, for all muscles.

    Raises
    ------
    InputError
        If a name is unknown or a value not legal.
    GeometryError
        If the design is not feasible.
    """
    if not isinstance(changes, Mapping):
        raise InputError(f"changes is {changes!r:.60}: it must be a mapping from names to values")
    for name in changes:
        check_parameter(name)
    rest: Changes = dict(changes)
    if "muscles" in rest:
        # Angles are given for these muscles; what else does not fit them is refused at the end.
        muscles = check_value(design, "muscles", rest.pop("muscles"))
        length = muscles[0].muscle.length if muscles else design.backbone_length
        target = rest.get("backbone_length", design.backbone_length)
        design = design.replace(muscles=muscles, backbone_length=length)
        rest["backbone_length"] = target
    muscle_changes = {
        name.removeprefix("muscle."): rest.pop(name)
        for name in changes
        if name.startswith("muscle.")
    }
    if "length" in rest:
        length = rest.pop("length")
        for name in ("backbone_length", "muscle.length"):
            if name in changes:
                raise InputError(f"'length' and '{name}' are both given: give one of them")
        muscle_changes["length"] = rest["backbone_length"] = length
    angles = design.angles
    if "angles" in rest:
        angles = np.array(check_value(design, "angles", rest.pop("angles")))
    placed = []
    for one, angle in zip(design.muscles, angles, strict=True):
        muscle = one.muscle.replace(**muscle_changes) if muscle_changes else one.muscle
        placed.append(PlacedMuscle(name=one.name, muscle=muscle, angle=float(angle)))
    return design.replace(muscles=tuple(placed), **rest)


def find_needed_pressure(effector: Effector, deflection: float) -> float:
    """Return the pressure at which every muscle alone deflects the tip so far [MPa].

    It may be above the design's pressure limit.

    Parameters
    ----------
    effector : Effector
    deflection : float
        Lateral deflection of the backbone's end [mm].

    Raises
    ------
    InputError
        If the deflection is not positive, more than the backbone's largest, or more than a muscle
        reaches at 10 MPa.
    """
    wanted = check_number("deflection", deflection, low=0.0, low_open=True, high=1e6, unit="mm")
    peak = effector.packed.peak.lateral
    if wanted > peak:
        shown = show_apart(wanted, peak)
        raise InputError(
            f"deflection is {shown[0]} mm: it must lie in (0, {shown[1]}] mm, the backbone's "
            "largest deflection"
        )
    names = effector.design.names
    moves = wanted * np.eye(len(names))
    # The thesis's muscle contracts less again at several MPa: below the limit first.
    for limit in (effector.design.pressure_limit, HIGHEST_PRESSURE_MPA):
        _, pressures, residual, _ = solve_displacements(effector, moves, limit=limit)
        needed = pressures.diagonal()
        failed = np.flatnonzero(~(residual <= MISS_TOLERANCE_MM) | ~(needed > 0.0))
        if not failed.size:
            break
    if failed.size:
        raise InputError(
            f"deflection is {wanted:g} mm: muscle {names[failed[0]]} does not reach it at any "
            f"pressure up to {HIGHEST_PRESSURE_MPA:g} MPa"
        )
    return float(needed.max())


def sweep(
    effector: Effector,
    parameters: Mapping[str, Sequence[object]],
    *,
    deflection: float = 0.0,
    progress: Progress = no_progress,
) -> Sweep:
    """Try every combination of some changes of the design.

    Parameters
    ----------
    effector : Effector
        Its design is what is changed; its muscle model is kept.
    parameters : mapping of str to sequence
        What to vary and over which values; names as in `change_design`.
    deflection : float
        Deflection that every muscle alone must reach [mm]; 0 for none.
    progress : callable
        Called after each design.

    Raises
    ------
    InputError
        If there is nothing to vary, a name is unknown, a value is legal in no design, or the
        deflection is negative.
    """
    wanted = check_number("deflection", deflection, low=0.0, high=1e6, unit="mm")
    if not isinstance(parameters, Mapping) or not parameters:
        raise InputError("there is nothing to vary: give a mapping of parameters to their values")
    names = tuple(parameters)
    choices = [list_values(effector.design, name, parameters[name]) for name in names]
    total = math.prod(len(values) for values in choices)
    if total > MOST_DESIGNS:
        raise InputError(f"there are {total} designs to try: at most {MOST_DESIGNS} at once")
    cases = [dict(zip(names, values, strict=True)) for values in itertools.product(*choices)]
    if can_batch(effector, names):
        made = _try_batch(effector, cases, wanted)
    else:
        made = (try_design(effector, changes, wanted) for changes in cases)
    rows = []
    for index, row in enumerate(made):
        rows.append(row)
        progress("designs", (index + 1) / total)
    return Sweep(parameters=names, deflection=wanted, rows=tuple(rows))


def _try_batch(effector: Effector, cases: list[Changes], deflection: float) -> Iterator[SweepRow]:
    """Yield what `try_design` gives of each case, by the compiled batch."""
    columns = {name: np.array([changes[name] for changes in cases]) for name in cases[0]}
    found = measure_designs(effector, columns, deflection=deflection)
    for i, changes in enumerate(cases):
        if not found.code[i]:
            reason = ""
        else:
            reason = explain_design(effector, changes, deflection=deflection)
        built = math.isfinite(found.area[i])
        needed = float(found.needed_pressure[i])
        yield SweepRow(
            changes=changes,
            feasible=not reason,
            reason=reason,
            least_amplitude=float(found.least_amplitude[i]) if built else 0.0,
            largest_amplitude=float(found.largest_amplitude[i]) if built else 0.0,
            inner_radius=float(found.inner_radius[i]) if built else 0.0,
            area=float(found.area[i]) if built else 0.0,
            needed_pressure=needed if math.isfinite(needed) else 0.0,
            built=built,
        )


def explain_design(
    effector: Effector, changes: Mapping[str, object], *, deflection: float = 0.0
) -> str:
    """Return why a design does not do, as `sweep` states it; empty if it does.

    Parameters
    ----------
    effector : Effector
        Its design is what is changed.
    changes : mapping
        As in `change_design`.
    deflection : float
        Deflection that every muscle alone must reach [mm]; 0 for none.
    """
    try:
        tried = Effector(change_design(effector.design, changes), effector.model)
        find_reach(tried)
    except BozziniError as error:
        return str(error)
    return _judge_pressure(tried, deflection)[1]


def _judge_pressure(tried: Effector, deflection: float) -> tuple[float, str]:
    """Return the pressure that a deflection needs [MPa], and why the design does not do."""
    if deflection <= 0.0:
        return 0.0, ""
    limit = tried.design.pressure_limit
    try:
        needed = find_needed_pressure(tried, deflection)
    except InputError as error:
        return 0.0, str(error)
    shown = show_apart(needed, limit, digits=4)
    over = f"it needs {shown[0]} MPa of at most {shown[1]} MPa"
    return needed, over if needed > limit else ""


def try_design(effector: Effector, changes: Changes, deflection: float) -> SweepRow:
    """Return a row of a sweep by the public functions, one design at a time, for any model."""
    try:
        tried = Effector(change_design(effector.design, changes), effector.model)
        known = find_reach(tried)
        found = workspace(tried, directions=12, samples=1)
    except BozziniError as error:
        return SweepRow(changes=changes, feasible=False, built=False, reason=str(error))
    needed, reason = _judge_pressure(tried, deflection)
    return SweepRow(
        changes=changes,
        feasible=not reason,
        reason=reason,
        least_amplitude=float(known.amplitudes.min()),
        largest_amplitude=float(known.amplitudes.max()),
        inner_radius=found.inner_radius,
        area=found.area,
        needed_pressure=needed,
    )


MOST_GRID_DESIGNS = 10_000
"""Designs that a grid may have."""

_INFEASIBLE_MPA = 1e3
"""What a design that does not reach the deflection counts as [MPa]: above all others."""
_ABOVE_LIMIT_MPA = 100.0
"""What is added to a pressure above the design's limit [MPa]."""


@dataclass(frozen=True, kw_only=True)
class Optimum(Result):
    """The best design that was found.

    Attributes
    ----------
    converged : bool
        Whether there is a design within the bounds that reaches the deflection at or below its
        pressure limit.
    reason : str
        Why not; or, where `converged`, which bounds it lies on; empty if none.
    effector : Effector
        With the best design, or the one given if none reaches the deflection.
    changes : dict
        Its parameters.
    pressure : float
        Pressure that every muscle alone needs [MPa]; unless `converged` the least that was found,
        above the limit, or 0 if no design reaches the deflection at any.
    pressure_before : float
        The same of the design given [MPa]; 0 if that does not reach the deflection.
    deflection : float
        What was asked for [mm].
    evaluations : int
        Designs that were tried.
    infeasible : int
        How many of these cannot be built, do not reach the deflection, or need more than their
        pressure limit.
    """

    converged: bool
    reason: str
    effector: Effector
    changes: Changes
    pressure: float = measured("MPa")
    pressure_before: float = measured("MPa")
    deflection: float = measured("mm")
    evaluations: int
    infeasible: int

    @property
    def residual(self) -> float:
        """Pressure above the limit [MPa]; 0 where `converged`."""
        return max(0.0, self.pressure - self.effector.design.pressure_limit)

    def to_dict(self) -> Json:
        """Return the design as plain values; units are in the names, those of the changes too."""
        changes = {name_column(name): to_plain(value) for name, value in self.changes.items()}
        return super().to_dict() | {"changes": changes, "effector": self.effector.design.to_dict()}


class _Search:
    """Needed pressure as a function of parameters, and the best so far."""

    def __init__(self, effector: Effector, deflection: float, names: tuple[str, ...]) -> None:
        self.effector = effector
        self.deflection = deflection
        self.names = names
        self.best = _INFEASIBLE_MPA
        self.best_changes: Changes = {}
        self.best_effector = effector
        self.evaluations = 0
        self.infeasible = 0
        self.last_reason = ""

    def measure(self, values: NDArray[np.float64], fixed: Mapping[str, object]) -> float:
        changes = {**dict(zip(self.names, map(float, values), strict=True)), **fixed}
        self.evaluations += 1
        try:
            tried = Effector(change_design(self.effector.design, changes), self.effector.model)
            needed = find_needed_pressure(tried, self.deflection)
        except BozziniError as error:
            self.infeasible += 1
            self.last_reason = str(error)
            return _INFEASIBLE_MPA
        limit = tried.design.pressure_limit
        if needed > limit:
            # Worse than any that is legal, and the less so the nearer it is.
            self.infeasible += 1
            needed += _ABOVE_LIMIT_MPA
        if needed < self.best:
            self.best, self.best_changes, self.best_effector = needed, changes, tried
        return needed


def optimise_design(
    effector: Effector,
    deflection: float,
    *,
    bounds: Mapping[str, tuple[float, float]],
    segments: Sequence[int] | None = None,
    grid: int = 7,
    progress: Progress = no_progress,
) -> Optimum:
    """Find the design whose muscles reach a deflection with the least pressure.

    Minimised is `find_needed_pressure`, on the exact model: a grid over the bounds first, for there
    may be several minima, then Nelder and Mead's method (SciPy) from the best of it. That gives a
    local minimum that no grid point betters; nothing proves it the global one.

    Parameters
    ----------
    effector : Effector
        The design to start from; what is not in `bounds` stays.
    deflection : float
        Lateral deflection of the backbone's end that every muscle alone must reach [mm].
    bounds : mapping of str to (low, high)
        Parameters with a number as value, as in `change_design`, and their ranges; 1 to 4.
    segments : sequence of int, optional
        Numbers of segments to choose from.
    grid : int
        Values of each parameter in the grid; 10,000 designs at most.
    progress : callable
        Called as the search goes on.

    Raises
    ------
    InputError
        If a parameter or bound is not legal.
    """
    from scipy.optimize import minimize

    wanted = check_number("deflection", deflection, low=0.0, low_open=True, high=1e6, unit="mm")
    grid = check_integer("grid", grid, low=2, high=50)
    if not isinstance(bounds, Mapping):
        raise InputError(f"bounds is {bounds!r:.60}: it must map names to (low, high)")
    names = tuple(bounds)
    if not 1 <= len(names) <= 4:
        raise InputError(f"there are {len(names)} parameters to optimise: give 1 to 4")
    if grid ** len(names) > MOST_GRID_DESIGNS:
        most = int(MOST_GRID_DESIGNS ** (1.0 / len(names)) + 1e-9)
        raise InputError(f"grid is {grid}: with {len(names)} parameters it must lie in [2, {most}]")
    box = np.array([_take_bounds(effector, name, bounds[name]) for name in names])
    cases: list[Changes] = [{}]
    if segments is not None:
        counts = list_values(effector.design, "segments", segments)
        cases = [{"segments": count} for count in counts]
    search = _Search(effector, wanted, names)
    try:
        before = find_needed_pressure(effector, wanted)
    except InputError:
        before = 0.0
    axes = [np.linspace(low, high, grid) for low, high in box]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(names))
    for number, fixed in enumerate(cases):
        values = []
        for index, point in enumerate(points):
            values.append(search.measure(point, fixed))
            progress("designs", (number + 0.8 * (index + 1) / len(points)) / len(cases))
        start = int(np.argmin(values))
        if values[start] < _INFEASIBLE_MPA:
            minimize(
                search.measure,
                points[start],
                args=(fixed,),
                method="Nelder-Mead",
                bounds=box,
                options={
                    "xatol": 1e-7 * float((box[:, 1] - box[:, 0]).max()),
                    "fatol": 1e-10,
                    "initial_simplex": _start_simplex(points[start], box, grid),
                    "maxfev": 400 * len(names),
                },
            )
        progress("designs", (number + 1) / len(cases))
    success, reason = _judge(search, box)
    found = search.best < _INFEASIBLE_MPA
    return Optimum(
        converged=success,
        reason=reason,
        effector=search.best_effector,
        changes=search.best_changes,
        pressure=(search.best - (0.0 if success else _ABOVE_LIMIT_MPA)) if found else 0.0,
        pressure_before=before,
        deflection=wanted,
        evaluations=search.evaluations,
        infeasible=search.infeasible,
    )


def _take_bounds(effector: Effector, name: str, pair: tuple[float, float]) -> tuple[float, float]:
    check_parameter(name)
    if name in ("angles", "muscles", "segments", "beam_factor", "muscle.strands"):
        raise InputError(f"parameter '{name}' has no range of numbers: it cannot be in bounds")
    if name == "pressure_limit":
        raise InputError(
            "parameter 'pressure_limit' does not change the pressure that is needed: it cannot be "
            "in bounds"
        )
    try:
        low, high = pair
    except (TypeError, ValueError):
        raise InputError(f"bounds of {name} is {pair!r}: give two numbers (low, high)") from None
    low = check_number(f"lower bound of {name}", low)
    high = check_number(f"upper bound of {name}", high, low=low, low_open=True)
    return check_value(effector.design, name, low), check_value(effector.design, name, high)


def _start_simplex(
    start: NDArray[np.float64], box: NDArray[np.float64], grid: int
) -> NDArray[np.float64]:
    """A simplex inside the bounds, of half a step of the grid."""
    simplex = np.tile(start, (start.size + 1, 1))
    for index in range(start.size):
        low, high = box[index]
        step = 0.5 * (high - low) / (grid - 1)
        simplex[index + 1, index] += step if start[index] + step <= high else -step
    return simplex


def _judge(search: _Search, box: NDArray[np.float64]) -> tuple[bool, str]:
    if search.best >= _INFEASIBLE_MPA:
        return False, f"no design within the bounds is feasible; the last: {search.last_reason}"
    if search.best >= _ABOVE_LIMIT_MPA:
        limit = search.best_effector.design.pressure_limit
        least = search.best - _ABOVE_LIMIT_MPA
        return False, f"the least pressure is {least:.4g} MPa, above the limit of {limit:g} MPa"
    on_bound = []
    for name, (low, high) in zip(search.names, box, strict=True):
        value, slack = search.best_changes[name], 1e-6 * (high - low)
        if value <= low + slack:
            on_bound.append(f"{name} is at its lower bound {low:g}")
        elif value >= high - slack:
            on_bound.append(f"{name} is at its upper bound {high:g}")
    return True, "; ".join(on_bound)

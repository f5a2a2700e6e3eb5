"""The design that reaches a deflection with the least pressure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer, check_number
from ..errors import BozziniError, InputError
from ..progress import Progress, no_progress
from ._study_values import check_parameter, check_value, list_values
from .effector import Effector
from .study import change_design, find_needed_pressure

__all__ = ["Optimum", "optimise_design"]

MOST_DESIGNS = 10_000
"""Designs that a grid may have."""

_WORST = 1e3
"""What a design that does not reach the deflection counts as [MPa]: above all others."""
_BEYOND = 100.0
"""What is added to a pressure above the design's limit [MPa]."""


@dataclass(frozen=True, kw_only=True)
class Optimum:
    """The best design that was found.

    Attributes
    ----------
    success : bool
        Whether there is a design within the bounds that reaches the deflection at or below its
        pressure limit.
    reason : str
        Why not; or, with success, which bounds it lies on; empty if none.
    effector : Effector
        With the best design, or the one given if none reaches the deflection.
    changes : dict
        Its parameters.
    pressure : float
        Pressure that every muscle alone needs [MPa]; without success the least that was found,
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

    success: bool
    reason: str
    effector: Effector
    changes: dict[str, Any]
    pressure: float
    pressure_before: float
    deflection: float
    evaluations: int
    infeasible: int


class _Search:
    """Needed pressure as a function of parameters, and the best so far."""

    def __init__(self, effector: Effector, deflection: float, names: tuple[str, ...]) -> None:
        self.effector = effector
        self.deflection = deflection
        self.names = names
        self.best = _WORST
        self.best_changes: dict[str, Any] = {}
        self.best_effector = effector
        self.evaluations = 0
        self.infeasible = 0
        self.last_reason = ""

    def measure(self, values: NDArray[np.float64], fixed: Mapping[str, Any]) -> float:
        changes = {**dict(zip(self.names, map(float, values), strict=True)), **fixed}
        self.evaluations += 1
        try:
            tried = Effector(change_design(self.effector.design, changes), self.effector.model)
            needed = find_needed_pressure(tried, self.deflection)
        except BozziniError as error:
            self.infeasible += 1
            self.last_reason = str(error)
            return _WORST
        limit = tried.design.pressure_limit
        if needed > limit:
            # Worse than any that is legal, and the less so the nearer it is.
            self.infeasible += 1
            needed += _BEYOND
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
        Told as the search goes on.

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
    if grid ** len(names) > MOST_DESIGNS:
        most = int(MOST_DESIGNS ** (1.0 / len(names)) + 1e-9)
        raise InputError(f"grid is {grid}: with {len(names)} parameters it must lie in [2, {most}]")
    box = np.array([_take_bounds(effector, name, bounds[name]) for name in names])
    cases: list[dict[str, Any]] = [{}]
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
        if values[start] < _WORST:
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
    found = search.best < _WORST
    return Optimum(
        success=success,
        reason=reason,
        effector=search.best_effector,
        changes=search.best_changes,
        pressure=(search.best - (0.0 if success else _BEYOND)) if found else 0.0,
        pressure_before=before,
        deflection=wanted,
        evaluations=search.evaluations,
        infeasible=search.infeasible,
    )


def _take_bounds(effector: Effector, name: str, pair: tuple[float, float]) -> tuple[float, float]:
    check_parameter(effector.design, name)
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
    if search.best >= _WORST:
        return False, f"no design within the bounds is feasible; the last: {search.last_reason}"
    if search.best >= _BEYOND:
        limit = search.best_effector.design.pressure_limit
        least = search.best - _BEYOND
        return False, f"the least pressure is {least:.4g} MPa, above the limit of {limit:g} MPa"
    on_bound = []
    for name, (low, high) in zip(search.names, box, strict=True):
        value, slack = search.best_changes[name], 1e-6 * (high - low)
        if value <= low + slack:
            on_bound.append(f"{name} is at its lower bound {low:g}")
        elif value >= high - slack:
            on_bound.append(f"{name} is at its upper bound {high:g}")
    return True, "; ".join(on_bound)

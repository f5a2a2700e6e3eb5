"""Design studies: what a change of the design does to the workspace, and the least pressure."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks import check_number
from ..errors import BozziniError, InputError
from ..progress import Progress, no_progress
from ._study_values import check_parameter, check_value, is_of_muscle, list_values
from .amplitudes import find_reach
from .design import EffectorDesign, PlacedMuscle
from .effector import Effector
from .inverse import TOLERANCE, solve_displacements
from .workspace import workspace

__all__ = [
    "Sweep",
    "SweepRow",
    "change_design",
    "find_needed_pressure",
    "sweep",
]

MOST_DESIGNS = 1_000_000


@dataclass(frozen=True, kw_only=True)
class SweepRow:
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

    changes: dict[str, Any]
    feasible: bool
    reason: str = ""
    least_amplitude: float = 0.0
    largest_amplitude: float = 0.0
    inner_radius: float = 0.0
    area: float = 0.0
    needed_pressure: float = 0.0
    built: bool = True


@dataclass(frozen=True, kw_only=True)
class Sweep:
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
    deflection: float
    rows: tuple[SweepRow, ...]

    @property
    def feasible(self) -> tuple[SweepRow, ...]:
        """The rows that are feasible."""
        return tuple(row for row in self.rows if row.feasible)


def change_design(design: EffectorDesign, changes: Mapping[str, Any]) -> EffectorDesign:
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
        check_parameter(design, name)
    rest: dict[str, Any] = dict(changes)
    if "muscles" in rest:
        # Angles are given for these muscles; what else does not fit them is told at the end.
        muscles = check_value(design, "muscles", rest.pop("muscles"))
        length = muscles[0].muscle.length if muscles else design.backbone_length
        target = rest.get("backbone_length", design.backbone_length)
        design = design.replace(muscles=muscles, backbone_length=length)
        rest["backbone_length"] = target
    muscle_changes = {
        name.removeprefix("muscle."): rest.pop(name) for name in changes if is_of_muscle(name)
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
        raise InputError(
            f"deflection is {wanted:g} mm: it must lie in (0, {peak:.6g}] mm, the backbone's "
            "largest deflection"
        )
    names = effector.design.names
    moves = wanted * np.eye(len(names))
    # The thesis's muscle contracts less again at several MPa: below the limit first.
    for limit in (effector.design.pressure_limit, _HIGHEST_PRESSURE):
        _, pressures, residual, _ = solve_displacements(effector, moves, limit=limit)
        needed = pressures.diagonal()
        failed = np.flatnonzero(~(residual <= TOLERANCE) | ~(needed > 0.0))
        if not failed.size:
            break
    if failed.size:
        raise InputError(
            f"deflection is {wanted:g} mm: muscle {names[failed[0]]} does not reach it at any "
            f"pressure up to {_HIGHEST_PRESSURE:g} MPa"
        )
    return float(needed.max())


_HIGHEST_PRESSURE = 10.0
"""Pressure up to which one is looked for [MPa]: the largest that a design may have as limit."""


def sweep(
    effector: Effector,
    parameters: Mapping[str, Sequence[Any]],
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
        Told after each design.

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
    rows = []
    for index, values in enumerate(itertools.product(*choices)):
        changes = dict(zip(names, values, strict=True))
        rows.append(_try_design(effector, changes, wanted))
        progress("designs", (index + 1) / total)
    return Sweep(parameters=names, deflection=wanted, rows=tuple(rows))


def _try_design(effector: Effector, changes: dict[str, Any], deflection: float) -> SweepRow:
    try:
        tried = Effector(change_design(effector.design, changes), effector.model)
        known = find_reach(tried)
        found = workspace(tried, directions=12, samples=1)
    except BozziniError as error:
        return SweepRow(changes=changes, feasible=False, built=False, reason=str(error))
    needed, reason = 0.0, ""
    if deflection > 0.0:
        limit = tried.design.pressure_limit
        try:
            needed = find_needed_pressure(tried, deflection)
        except InputError as error:
            reason = str(error)
        if needed > limit:
            reason = f"it needs {needed:.4g} MPa of at most {limit:g} MPa"
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

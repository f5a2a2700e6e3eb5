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
from .amplitudes import reach
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


@dataclass(frozen=True, kw_only=True)
class SweepRow:
    """One design of a sweep; numbers are 0 where the design cannot be built.

    Parameters
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
    """

    changes: dict[str, Any]
    feasible: bool
    reason: str = ""
    least_amplitude: float = 0.0
    largest_amplitude: float = 0.0
    inner_radius: float = 0.0
    area: float = 0.0
    needed_pressure: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Designs side by side.

    Parameters
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
    rest = dict(changes)
    muscle_changes = {
        name.removeprefix("muscle."): rest.pop(name) for name in changes if _is_of_muscle(name)
    }
    muscles = rest.pop("muscles", design.muscles)
    length, angles = rest.pop("length", None), rest.pop("angles", None)
    if length is not None:
        for name in ("backbone_length", "muscle.length"):
            if name in changes:
                raise InputError(f"'length' and '{name}' are both given: give one of them")
        muscle_changes["length"] = rest["backbone_length"] = length
    if angles is not None:
        try:
            count = len(angles)
        except TypeError:
            count = 0
        if count != len(muscles):
            raise InputError(f"angles is {angles!r}: give {len(muscles)} numbers in rad")
    placed = []
    for index, one in enumerate(muscles):
        muscle = one.muscle.replace(**muscle_changes) if muscle_changes else one.muscle
        angle = one.angle if angles is None else angles[index]
        placed.append(PlacedMuscle(name=one.name, muscle=muscle, angle=angle))
    return design.replace(muscles=tuple(placed), **rest)


def _is_of_muscle(name: str) -> bool:
    return name.startswith("muscle.")


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
        If there is nothing to vary, a name is unknown, or the deflection is negative.
    """
    wanted = check_number("deflection", deflection, low=0.0, high=1e6, unit="mm")
    names = tuple(parameters)
    choices = [tuple(parameters[name]) for name in names]
    if not names or not all(choices):
        raise InputError("there is nothing to vary: give a parameter with 1 value or more")
    for name in names:
        check_parameter(effector.design, name)
    total = math.prod(len(values) for values in choices)
    rows = []
    for index, values in enumerate(itertools.product(*choices)):
        changes = dict(zip(names, values, strict=True))
        rows.append(_try_design(effector, changes, wanted))
        progress("designs", (index + 1) / total)
    return Sweep(parameters=names, deflection=wanted, rows=tuple(rows))


def check_parameter(design: EffectorDesign, name: str) -> None:
    """Raise if a parameter is not one, rather than call every design of a sweep infeasible."""
    fields = [*EffectorDesign.__dataclass_fields__, "length", "angles"]
    own = design.muscles[0].muscle.__dataclass_fields__
    known = name.removeprefix("muscle.") in own if _is_of_muscle(name) else name in fields
    if not known:
        raise InputError(
            f"there is no parameter '{name}': choose one of {fields}, or 'muscle.' and one of "
            f"{list(own)}"
        )


def _try_design(effector: Effector, changes: dict[str, Any], deflection: float) -> SweepRow:
    try:
        tried = Effector(change_design(effector.design, changes), effector.model)
        known = reach(tried)
        found = workspace(tried, directions=12, samples=1)
    except BozziniError as error:
        return SweepRow(changes=changes, feasible=False, reason=str(error))
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

"""What fittings and a rig add to any model: a zero offset, a series compliance, a slack region.

A muscle of length ``L`` that contracts by ``x`` and pulls with ``F`` between fittings that give by
``c`` per newton, in a rig whose zero is off by ``x0``, is measured as ::

    x_measured = x + x0 - c F

With the pull ``f(P, x)`` of the model the force at a measured contraction is therefore the root of
``F = f(P, x_measured - x0 + c F)``, its stiffness ``k / (1 + c k)`` with the model's own ``k``. A
slack or kinked muscle does not pull less than a certain force, and a sensor reads that force
there: ``F = max(F, F0)``, with a sharp edge. The edge is in the reading only: the contraction under
a load, and the pressure for a force, are those of the muscle that is taut.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import broadcast, check_array, check_fields, check_number, quantity
from ..errors import InputError
from ..numeric.arrays import Floats
from ..numeric.roots import find_between
from .compose import find_limits
from .design import PRESSURE_LIMIT
from .model import MuscleModel, MuscleState, name_directions, parse_direction

if TYPE_CHECKING:
    from .hysteresis import Hysteresis

_Forces = tuple[Floats, NDArray[np.bool_], Floats]

MARGIN = 1e-9
"""Share of the legal contractions that the search for a force keeps clear of at both ends."""

_STEPS = 50  # of the secant method for the force with a compliance
_TOLERANCE = 1e-12  # relative, of that force
_TRIED = 65  # contractions tried for the free one
_ZOOMS = 4  # times that as many are tried between the two about it, before a line is drawn


@dataclass(frozen=True, kw_only=True)
class EndEffects:
    """Zero offset, series compliance and slack region of a muscle in a rig.

    Parameters
    ----------
    offset : float
        Measured contraction less the muscle's own at zero force [mm].
    compliance : float
        By how much fittings and rig give [mm/N]; the pull stretches them, so that the measured
        contraction is smaller.
    slack_force : float, optional
        The least force that is measured [N]: a slack or kinked muscle reads this. It is a sharp
        edge; None, the default, for none.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    offset: float = quantity(
        "length", "Measured contraction less the muscle's own.", default=0.0, low=-1e4, high=1e4
    )
    compliance: float = quantity(
        "compliance", "What fittings and rig give.", default=0.0, low=0.0, high=1e3
    )
    slack_force: float | None = quantity(
        "force", "Force that a slack muscle reads.", default=None, low=-1e6, high=1e6
    )

    def __post_init__(self) -> None:
        check_fields(self, "ends ")

    def replace(self, **changes: float) -> EndEffects:
        """Return these effects with some values changed."""
        return dataclasses.replace(self, **changes)

    def mount(self, model: MuscleModel) -> MuscleModel:
        """Return a model with these effects; the model itself if there are none."""
        return model if self == EndEffects() else MountedMuscle(model, self)


@dataclass(frozen=True)
class MountedMuscle(MuscleModel):
    """A model of a muscle with the effects of its fittings and of the rig.

    Parameters
    ----------
    model : MuscleModel
        Any model.
    ends : EndEffects
        The effects.
    """

    model: MuscleModel
    ends: EndEffects = field(default_factory=EndEffects)

    def __post_init__(self) -> None:
        if not isinstance(self.model, MuscleModel) or not isinstance(self.ends, EndEffects):
            raise InputError(
                f"a mounted muscle has a {type(self.model).__name__} and a "
                f"{type(self.ends).__name__}: it must be a MuscleModel and EndEffects"
            )
        own: Mapping[str, object] = {
            "muscle": self.model.muscle,
            "name": self.model.name,
            "hysteresis": self.model.hysteresis,
        }
        for name, value in own.items():
            object.__setattr__(self, name, value)

    hysteresis: Hysteresis | None = field(init=False, repr=False, compare=False)

    @property
    def takes_load(self) -> bool:
        """Whether the contraction depends on the load."""
        return self.model.takes_load or self.ends.compliance > 0.0

    @property
    def pressure_limits(self) -> tuple[float, float]:
        """Legal pressures [MPa]."""
        return self.model.pressure_limits

    @property
    def contraction_limits(self) -> tuple[float, float]:
        """Measured contractions without force at which the muscle's own are legal [mm]."""
        low, high = find_limits(self.model)
        return low + self.ends.offset, high + self.ends.offset

    def dead_band(self) -> float:
        """Return the pressure below which the muscle does not contract [MPa]."""
        return self.model.dead_band()

    def force(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the force that is measured [N], `EndEffects.slack_force` or more.

        Raises
        ------
        InputError
            If the muscle's own contraction is outside the legal range of its model.
        """
        found, held, own = self._find_force(pressure, contraction, direction)
        if not held.all():
            self.model.force(pressure, own, direction=direction)  # its own words
            raise InputError("no force was found at which muscle and fittings are in balance")
        return found

    def try_force(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the force that is measured [N], and where there is one."""
        found, held, _ = self._find_force(pressure, contraction, direction)
        return found, held

    def _find_force(
        self, pressure: ArrayLike, contraction: ArrayLike, direction: ArrayLike | None
    ) -> _Forces:
        """Return the force, where there is one, and the muscle's own contraction [mm].

        By the secant method on ``F - f(P, x + c F)``, which grows with F where the muscle is not
        unstable; its first step takes the stiffness by a difference.
        """
        signs = parse_direction(direction)
        pressures, given, _ = broadcast(
            ("pressure", check_array("pressure", pressure)),
            ("contraction", check_array("contraction", contraction)),
            ("direction", signs),
        )
        ends = self.ends
        base = given - ends.offset
        force, held = self.model.try_force(pressures, base, direction=direction)
        own = base
        if ends.compliance > 0.0:
            last, left = np.zeros(force.shape), -force
            now = force
            for _ in range(_STEPS):
                own = base + ends.compliance * now
                pull, held = self.model.try_force(pressures, own, direction=direction)
                rest = now - pull
                settled = np.abs(rest) <= _TOLERANCE * (1.0 + np.abs(now))
                if settled.all():
                    break
                with np.errstate(all="ignore"):
                    step = -rest * (now - last) / (rest - left)
                step = np.where(np.isfinite(step), step, -0.5 * rest)
                last, left, now = now, rest, np.where(settled, now, now + step)
            else:
                held = held & (np.abs(rest) <= 1e-6 * (1.0 + np.abs(now)))
            force = now
            if not held.all():
                force, held, own = self._bracket_force(pressures, base, signs, (force, held, own))
        floored = force if ends.slack_force is None else np.maximum(force, ends.slack_force)
        return floored, np.asarray(held), own

    def _bracket_force(
        self, pressures: Floats, base: Floats, signs: Floats, known: _Forces
    ) -> _Forces:
        """Return what `_find_force` does, with the rows in which the secant method left the range.

        Such are rows in which the muscle would be longer than it can be, if nothing gave.
        """
        force, held, own = np.array(known[0]), np.array(known[1]), np.array(known[2])
        rows = np.flatnonzero(~held)
        pressure, start = pressures.ravel()[rows], base.ravel()[rows]
        words = name_directions(np.broadcast_to(signs, base.shape)).ravel()[rows]

        def excess(index: NDArray[np.intp], at: Floats) -> Floats:
            pull, good = self.model.try_force(pressure[index], at, direction=words[index])
            return np.where(good, pull - (at - start[index]) / self.ends.compliance, np.nan)

        low, high = find_limits(self.model)
        margin = MARGIN * (high - low)
        ends = np.full((2, rows.size), [[low + margin], [high - margin]])
        found = find_between(excess, *ends)
        rows, found = rows[np.isfinite(found)], found[np.isfinite(found)]
        force.flat[rows] = (found - base.ravel()[rows]) / self.ends.compliance
        held.flat[rows], own.flat[rows] = True, found
        return force, held, own

    def contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the measured contraction under a load [mm], of the taut muscle."""
        return self._shift(self.model.contraction(pressure, load, direction=direction), load)

    def try_contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the measured contraction [mm], and where there is one."""
        own, held = self.model.try_contraction(pressure, load, direction=direction)
        return self._shift(own, load), held

    def try_pressure(
        self, force: ArrayLike, length: ArrayLike, *, direction: ArrayLike | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the pressure [MPa] of a force at a measured length, and where there is one."""
        given = np.asarray(length, dtype=np.float64) + self.ends.offset
        own = given - self.ends.compliance * np.asarray(force, dtype=np.float64)
        return self.model.try_pressure(force, own, direction=direction)

    def stiffness(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return ``-d force / d contraction`` [N/mm]; 0 where the muscle is slack."""
        force, _, own = self._find_force(pressure, contraction, direction)
        stiff = self.model.stiffness(pressure, own, direction=direction)
        stiff = stiff / (1.0 + self.ends.compliance * stiff)
        floor = self.ends.slack_force
        return np.asarray(stiff if floor is None else np.where(force <= floor, 0.0, stiff))

    def solve(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> MuscleState:
        """Return everything the model gives, with contraction and length as they are measured."""
        state = self.model.solve(pressure, load, direction=direction)
        contraction = self._shift(state.contraction, load)
        return dataclasses.replace(
            state, contraction=contraction, length=np.asarray(self.muscle.length - contraction)
        )

    def _shift(self, own: Floats, load: ArrayLike) -> Floats:
        """Return the measured contractions of a muscle's own."""
        pull = np.asarray(load, dtype=np.float64)
        return np.asarray(own + self.ends.offset - self.ends.compliance * pull)


def find_offset(model: MuscleModel, *, pressure: float, length: float) -> float:
    """Return the zero offset with which a model without load is so long at a pressure [mm].

    Parameters
    ----------
    model : MuscleModel
        Without end effects.
    pressure : float
        [MPa].
    length : float
        Measured length of the unloaded muscle at that pressure [mm].

    Raises
    ------
    InputError
        If a value is outside its range, or the model has no free contraction at that pressure.
    """
    check_number("pressure", pressure, low=0.0, high=PRESSURE_LIMIT, unit="MPa")
    check_number("length", length, low=0.0, low_open=True, unit="mm")
    return model.muscle.length - length - _find_free(model, pressure)


def _find_free(model: MuscleModel, pressure: float) -> float:
    """Return the free contraction [mm], by forces alone where the model has them explicitly."""
    limits = getattr(model, "contraction_limits", None)
    if limits is not None and model.takes_load and limits[1] > 0.0:
        low, high, first = 0.0, float(limits[1]), True
        for _ in range(_ZOOMS):
            over = np.linspace(low, high, _TRIED)
            pull, held = model.try_force(pressure, over)
            crossed = held[:-1] & held[1:] & (pull[:-1] > 0.0) & (pull[1:] <= 0.0)
            if not crossed.any() or (first and pull[0] <= 0.0):
                break
            i, first = int(np.argmax(crossed)), False
            low, high = float(over[i]), float(over[i + 1])
        else:
            share = pull[i] / (pull[i] - pull[i + 1])
            return low + float(share) * (high - low)
    return float(model.contraction(pressure, 0.0))

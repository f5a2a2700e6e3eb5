"""Several muscles as one: a bundle side by side, and a joint between two that pull against."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import (
    broadcast,
    check_array,
    check_fields,
    check_kind,
    check_range,
    name_at,
    quantity,
    refuse_first,
    show_apart,
)
from ..errors import InputError
from ..numeric.arrays import Floats
from ..numeric.roots import find_between
from ..results import Shown
from .design import LOCKING_ANGLE, Muscle
from .model import MuscleModel


def find_limits(model: MuscleModel) -> tuple[float, float]:
    """Return the legal contractions of a model that has some, else twice and no length [mm]."""
    length = model.muscle.length
    limits: tuple[float, float] = getattr(model, "contraction_limits", (-length, length))
    return limits


@dataclass(frozen=True)
class Bundle(MuscleModel):
    """Muscles side by side between two plates, under one pressure: their pulls add.

    It is a model as any other, of the length and the braid of the first muscle. Under a load each
    muscle bears what it pulls at the common contraction.

    Parameters
    ----------
    models : sequence of MuscleModel
        At least one, all of one length; one that is there several times counts so often.

    Raises
    ------
    InputError
        If there is none, one does not respond to a load, or the lengths differ.
    """

    models: tuple[MuscleModel, ...]
    muscle: Muscle = field(init=False, repr=False, compare=False)

    name = "bundle"

    def __post_init__(self) -> None:
        models = tuple(self.models) if isinstance(self.models, Sequence) else ()
        if not models:
            raise InputError(
                f"models of a bundle is {self.models!r:.60}: it must have one at least"
            )
        for model in models:
            check_kind("model of a bundle", model, MuscleModel)
            if not model.takes_load:
                raise InputError(
                    f"model of a bundle is {model.name}, which has no response to a load: it must "
                    "have one"
                )
            if model.muscle.length != models[0].muscle.length:
                shown = show_apart(model.muscle.length, models[0].muscle.length)
                raise InputError(
                    f"muscle of a bundle is {shown[0]} mm long: all must be as long "
                    f"as the first, {shown[1]} mm"
                )
        object.__setattr__(self, "models", models)
        object.__setattr__(self, "muscle", models[0].muscle)

    @property
    def pressure_limits(self) -> tuple[float, float]:
        """Pressures that are legal for all muscles [MPa]."""
        lows, highs = zip(*(model.pressure_limits for model in self.models), strict=True)
        return max(lows), min(highs)

    @property
    def contraction_limits(self) -> tuple[float, float]:
        """Contractions that are legal for all muscles [mm]."""
        lows, highs = zip(*map(find_limits, self.models), strict=True)
        return max(lows), min(highs)

    def dead_band(self) -> float:
        """Return the pressure below which no muscle contracts [MPa]."""
        return min(model.dead_band() for model in self.models)

    def force(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the sum of the pulls [N]."""
        pulls = [model.force(pressure, contraction, direction=direction) for model in self.models]
        return np.asarray(reduce(np.add, pulls))

    def stiffness(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the sum of the stiffnesses [N/mm]."""
        each = [m.stiffness(pressure, contraction, direction=direction) for m in self.models]
        return np.asarray(reduce(np.add, each))

    def contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the common contraction under a load [mm].

        It lies between those of the muscles that each bear the same part of the load.
        """
        share = check_array("load", load) / len(self.models)
        alone = np.stack(
            [model.contraction(pressure, share, direction=direction) for model in self.models]
        )
        low, high = alone.min(axis=0), alone.max(axis=0)
        pressures, shares = np.broadcast_arrays(np.asarray(pressure, np.float64), share)
        flat = [np.broadcast_to(part, low.shape).ravel() for part in (pressures, shares)]
        words = None if direction is None else np.broadcast_to(np.asarray(direction), low.shape)

        found = low.ravel().copy()
        apart = np.flatnonzero((high > low).ravel())

        def excess(index: NDArray[np.intp], at: Floats) -> Floats:
            rows = apart[index]
            way = None if words is None else words.ravel()[rows]
            pull = self.force(flat[0][rows], at, direction=way)
            return np.asarray(pull - len(self.models) * flat[1][rows])

        if apart.size:
            found[apart] = find_between(excess, low.ravel()[apart], high.ravel()[apart])
        refuse_first(
            np.isnan(found).reshape(low.shape),
            "load",
            np.asarray(len(self.models) * flat[1]).reshape(low.shape),
            "the muscles of the bundle have no common contraction there",
            unit="N",
        )
        return np.asarray(found.reshape(low.shape))


@dataclass(frozen=True)
class AntagonisticJoint(Shown):
    """A joint turned by two muscles on a pulley, one each way.

    At an angle the agonist is shorter by ``radius * angle`` than at rest of the joint, and the
    antagonist longer: ``T = r (F1(P1, x0 + r a) - F2(P2, x0 - r a))``, with the stiffness
    ``-dT/da = r**2 (k1 + k2)``. A muscle that is let go slack does not push; one with a braid above
    the locking angle, which gets longer under pressure, may.

    Parameters
    ----------
    agonist, antagonist : MuscleModel
        Any models that respond to a load.
    radius : float
        Of the pulley [mm].
    rest_contraction : float
        Contraction of both muscles at the angle 0 [mm]; negative where they are mounted stretched.

    Raises
    ------
    InputError
        If a value is not legal, or the joint cannot be at the angle 0.
    """

    agonist: MuscleModel
    antagonist: MuscleModel
    radius: float = quantity("length", kw_only=True, low=1e-3, high=1e4)
    rest_contraction: float = quantity("length", kw_only=True, default=0.0, low=-1e4, high=1e4)

    def __post_init__(self) -> None:
        check_fields(self, "joint ")
        for name in ("agonist", "antagonist"):
            model = getattr(self, name)
            check_kind(name, model, MuscleModel)
            if not model.takes_load:
                raise InputError(
                    f"{name} is of the model {model.name}, which has no response to a load: it "
                    "must have one"
                )
        low, high = self.angle_limits
        if not low < 0.0 < high:
            least = max(find_limits(model)[0] for model in (self.agonist, self.antagonist))
            shown = show_apart(self.rest_contraction, least)
            raise InputError(
                f"joint rest contraction is {shown[0]} mm: it must lie above "
                f"{shown[1]} mm, at which a muscle cannot be stretched further"
            )

    @property
    def angle_limits(self) -> tuple[float, float]:
        """Angles at which a muscle is as long as it can be [rad]."""
        one, other = (find_limits(model)[0] for model in (self.agonist, self.antagonist))
        rest, radius = self.rest_contraction, self.radius
        return (one - rest) / radius, (rest - other) / radius

    def torque(self, pressures: ArrayLike, angle: ArrayLike) -> Floats:
        """Return the torque of the joint towards the agonist's side [N mm].

        Parameters
        ----------
        pressures : (..., 2) array_like
            Of agonist and antagonist [MPa].
        angle : (...) array_like
            Angle [rad], positive where the agonist is shorter.

        Raises
        ------
        InputError
            If an argument is outside its legal range.
        """
        one, other, angles = self._take(pressures, ("angle", angle), self.angle_limits, "rad")
        return self._turn(one, other, angles)

    def stiffness(self, pressures: ArrayLike, angle: ArrayLike) -> Floats:
        """Return ``-d torque / d angle`` [N mm/rad]; a slack muscle has none."""
        one, other, angles = self._take(pressures, ("angle", angle), self.angle_limits, "rad")
        each = []
        for model, pressure, sign in ((self.agonist, one, 1.0), (self.antagonist, other, -1.0)):
            contraction = self._place(model, sign * angles)
            stiffness = model.stiffness(pressure, contraction)
            each.append(np.where(_pull(model, pressure, contraction) == 0.0, 0.0, stiffness))
        return np.asarray(self.radius**2 * (each[0] + each[1]))

    def angle(self, pressures: ArrayLike, torque: ArrayLike = 0.0) -> Floats:
        """Return the angle [rad] at which the joint holds a torque against its muscles [N mm].

        Where both muscles are slack without a torque it is one of the angles at which they are.

        Parameters
        ----------
        pressures : (..., 2) array_like
            Of agonist and antagonist [MPa].
        torque : (...) array_like
            Torque of the muscles at rest, that of a load on the joint the other way.

        Raises
        ------
        InputError
            If an argument is outside its legal range, or no angle has that torque.
        """
        one, other, torques = self._take(pressures, ("torque", torque), (-1e15, 1e15), "N mm")
        flat = one.ravel(), other.ravel(), torques.ravel()

        def excess(index: NDArray[np.intp], angles: Floats) -> Floats:
            return self._turn(flat[0][index], flat[1][index], angles) - flat[2][index]

        inside = 1e-9 * (self.angle_limits[1] - self.angle_limits[0])
        low, high = self.angle_limits[0] + inside, self.angle_limits[1] - inside
        ends = np.full((2, flat[0].size), [[low], [high]])
        found = find_between(excess, ends[0], ends[1])
        if np.isnan(found).any():
            index = int(np.argmax(np.isnan(found)))
            most, least = (
                float(self._turn(flat[0][index], flat[1][index], np.asarray(end)))
                for end in (low, high)
            )
            shown = show_apart(flat[2][index], least, most)
            raise InputError(
                f"{name_at('torque', torques, index)} is {shown[0]} N mm: at the pressures "
                f"{flat[0][index]:g} and {flat[1][index]:g} MPa it must lie in [{shown[1]}, "
                f"{shown[2]}] N mm"
            )
        return found.reshape(one.shape)

    def _take(
        self,
        pressures: ArrayLike,
        other: tuple[str, ArrayLike],
        limits: tuple[float, float],
        unit: str,
    ) -> tuple[Floats, Floats, Floats]:
        """Return both pressures and angles or torques, of one shape."""
        given = check_array("pressures", pressures)
        if given.ndim == 0 or given.shape[-1] != 2:
            raise InputError(f"pressures has shape {given.shape}: it must be (..., 2)")
        check_range("pressures", given, 0.0, math.inf, "MPa")
        name, values = other
        rest = check_array(name, values)
        check_range(name, rest, *limits, unit)
        one, two, three = broadcast(
            ("agonist pressure", given[..., 0]),
            ("antagonist pressure", given[..., 1]),
            (name, rest),
        )
        return one, two, three

    def _place(self, model: MuscleModel, angle: Floats) -> Floats:
        """Contraction of a muscle at an angle to its own side; a slack one is no shorter."""
        contraction = self.rest_contraction + self.radius * angle
        return np.asarray(np.minimum(contraction, find_limits(model)[1]))

    def _turn(self, one: Floats, other: Floats, angle: Floats) -> Floats:
        """Torque [N mm]."""
        pull = _pull(self.agonist, one, self._place(self.agonist, angle))
        against = _pull(self.antagonist, other, self._place(self.antagonist, -angle))
        return np.asarray(self.radius * (pull - against))


def _pull(model: MuscleModel, pressure: Floats, contraction: Floats) -> Floats:
    """Pull [N]; none where a muscle that contracts is slack."""
    force = model.force(pressure, contraction)
    return force if model.muscle.braid_angle > LOCKING_ANGLE else np.maximum(force, 0.0)

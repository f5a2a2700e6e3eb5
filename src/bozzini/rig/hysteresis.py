"""Muscles with hysteresis on the rig, and its compensation by the inverse operator."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_array
from ..effector.motion import EffectorMotion
from ..errors import InputError
from ..muscle.hysteresis import InvertibleOperator, Operator
from ..muscle.model import MuscleModel
from ..numeric.arrays import Floats
from .plant import MUSCLES, Chamber, Plant, PlantDesign
from .protocol import SETPOINT_MAX


class MotionObserver:
    """What acts in the muscles, by what their pressures were: plays and creep of a motion.

    Parameters
    ----------
    motion : EffectorMotion
        Its lags are left out: those of the rig are in its pressures.

    Attributes
    ----------
    state : MotionState
        Of one rig; at rest without pressure to begin with.
    """

    def __init__(self, motion: EffectorMotion) -> None:
        self.motion = dataclasses.replace(motion, fill_lag=0.0, bleed_lag=0.0)
        self.state = self.motion.begin(np.zeros((1, MUSCLES)))

    def observe(self, duration: float, pressures: ArrayLike) -> Floats:
        """Return the effective pressures (3,) after a time [s] at pressures (3,) [MPa]."""
        held = np.broadcast_to(np.asarray(pressures, dtype=np.float64), (1, 2, MUSCLES)).copy()
        acting = self.motion.act(np.array([0.0, duration]), held, initial=self.state)
        self.state = acting.state
        return np.asarray(acting.effective[0, 1])


class HystereticPlant(Plant):
    """A plant whose muscles do not contract by their pressure, but by an effective one.

    The operator stands between the pressure and the model of the muscle; the volume of the muscle
    follows the pressure itself.

    Parameters
    ----------
    muscles : MuscleModel or Chamber, or sequence of three
        As `Plant` takes them.
    operator : Operator or EffectorMotion
        From the pressure to the effective one [MPa], the same for each muscle, each with a memory
        of its own; at rest without pressure. Of a motion its plays and its creep: the lag is that
        of the plant's own valves and lines.
    design : PlantDesign, optional
        The constants.
    seed : int
        Seed of the transducers' noise.

    Attributes
    ----------
    effective_pressures : (3,) ndarray
        What the muscles contract by [MPa gauge], 0 or more.
    """

    def __init__(
        self,
        muscles: MuscleModel | Chamber | Sequence[MuscleModel | Chamber],
        operator: Operator | EffectorMotion,
        design: PlantDesign | None = None,
        *,
        seed: int = 0,
    ) -> None:
        super().__init__(muscles, design, seed=seed)
        self._observer: MotionObserver | None = None
        if isinstance(operator, EffectorMotion):
            self._observer = MotionObserver(operator)
        elif isinstance(operator, Operator):
            self._operator, self._state = operator, operator.rest((MUSCLES,))
        else:
            raise InputError(
                f"operator is a {type(operator).__name__}: it must be an Operator or an "
                "EffectorMotion"
            )
        self._follow_operator(0.0)

    def step(self, duty: ArrayLike, duration: float) -> None:
        """Move on in time under duties of the valves; see `Plant.step`."""
        super().step(duty, duration)
        self._follow_operator(duration)

    def _follow_operator(self, duration: float) -> None:
        if self._observer is not None:
            self.effective_pressures = self._observer.observe(duration, self.pressures)
            return
        output, self._state = self._operator.run(self.pressures[:, None], initial=self._state)
        self.effective_pressures = np.maximum(output[:, 0], 0.0)

    @property
    def contractions(self) -> Floats:
        """Contractions of the muscles, shape (3,) [mm]."""
        pairs = zip(self.effective_pressures, self.chambers, strict=True)
        return np.array([np.interp(p, c.pressure, c.contraction) for p, c in pairs])


class HysteresisCompensator:
    """Turns effective pressures that are wanted into those that the muscles must have.

    The operator is inverted sample by sample, with the memory that belongs to the pressures asked
    for so far. The pressures of the muscles should go from one to the next without detours:
    those of more than the smallest width of a loop are not known to it.

    Parameters
    ----------
    operator : InvertibleOperator
        From the pressure to the effective one [MPa], such as the operator of a
        `bozzini.muscle.loops.LoopModel` that has a static model, or what
        `bozzini.muscle.hysteresis.MaxwellSlip.to_plays` gives.

    Raises
    ------
    InputError
        If the operator has no inverse.
    """

    def __init__(self, operator: InvertibleOperator) -> None:
        if not isinstance(operator, InvertibleOperator):
            raise InputError(
                f"operator is a {type(operator).__name__}: it must be an InvertibleOperator"
            )
        operator.invert_history([], between=(0.0, SETPOINT_MAX))
        self.operator = operator
        self._asked = self._measured = operator.rest((MUSCLES,))

    def compensate(self, effective: ArrayLike) -> Floats:
        """Return the pressures (3,) for effective ones (3,), in the board's range [MPa]."""
        wanted = check_array("effective", effective)
        pressures = self.operator.invert_history(
            wanted[:, None], between=(0.0, SETPOINT_MAX), initial=self._asked, clip=True
        )
        _, self._asked = self.operator.run(pressures, initial=self._asked)
        return np.asarray(pressures[:, 0])

    def observe(self, pressures: ArrayLike) -> Floats:
        """Return the effective pressures (3,) at measured ones (3,) [MPa], 0 or more."""
        measured = check_array("pressures", pressures)
        output, self._measured = self.operator.run(measured[:, None], initial=self._measured)
        return np.maximum(output[:, 0], 0.0)

"""The recommended model: one energy, from which force, contraction, stiffness and volume follow."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from . import _kernels
from ._equilibrium import Equilibrium
from .design import Muscle
from .hysteresis import Hysteresis
from .model import (
    LOAD_LIMIT,
    MuscleState,
    StaticModel,
    broadcast,
    check_array,
    check_hysteresis,
    check_range,
    demand_convergence,
    describe_stop,
    parse_direction,
)

__all__ = ["ENDS", "PRESSURE_LIMIT", "EnergyMuscle"]

ENDS = ("none", "trellis")

PRESSURE_LIMIT = 1e4
"""Largest legal pressure [MPa]: a limit of the arithmetic, far above what a muscle can bear."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class EnergyMuscle(StaticModel):
    """A muscle from one potential energy.

    An incompressible thick wall (neo-Hookean, or Mooney-Rivlin by `Muscle.mooney_ratio`) inside a
    braid of strands that do not stretch. The braid only holds the tube back: before they touch
    (the gap phase) the tube is free. With the stretch ``z`` of the part that contracts, the map
    ``r**2 = (R**2 + k) / z`` of the wall, its energy ``W``, and the braid's ``k <= k_b(z)``::

        potential = 2 pi l_a W(z, k) - P pi l_a (R_i**2 + k) - F l
        contact   P_o = P - 2 dW/dk,   pull F = 2 pi dW/dz - pi P_o dk_b/dz

    Force, contraction, stiffness and enclosed volume all come from it and agree with each other.
    In the limit of a wall that resists nothing it is Gaylord's force (`Braid.ideal_force`).

    Nothing that was measured validates it. It cannot reproduce the loaded rows of the thesis's
    Tables 4.1-4.4 (off by 2.2 mm rms for ``effector-45``, 4.0 mm for ``fitted-45``), nor the
    stiffness of 0.63 N/mm measured in Fig. 3.16 (it has 0.15 to 0.36 N/mm): an ideal braid is
    several times softer, and the wall adds little. With the thesis's own dimensions and modulus it
    contracts by 11 mm where the thesis has 7.6: what is missing is the length that does not
    contract (`Muscle.dead_length`) and a stiffer wall, see ``fitted-45``. It knows nothing of
    strands that stretch, bend or have a thickness, and nothing of buckling.

    Legal are pressures in [0, 10000] MPa, contractions from where the braid has squeezed 98 % of
    the bore's area out of the tube to where it locks, and loads of 0 or more up to those that
    squeeze the bore so: a muscle cannot push, and beyond its free contraction `force` is negative.
    With friction the contraction may go past locking, where the deflating branch can end, to a
    cosine of 0.35 at most.

    Parameters
    ----------
    muscle : Muscle
        The design.
    ends : str
        ``"none"``: a cylinder all along, plus `Muscle.dead_length`. ``"trellis"``: with the taper
        from the fittings to the cylinder, of a net whose crossings do not slip. It costs some 0.1
        mm, far less than the 5 mm of cone the thesis measured. It wants a muscle longer than its
        two tapers, and has no `force` beyond the free contraction. A muscle that is not shorter
        than at rest has no taper.
    hysteresis : Hysteresis, optional
        Operator for `trace_contraction`.

    Raises
    ------
    InputError
        If `ends` is unknown, or the muscle is not one for it.
    """

    muscle: Muscle
    ends: str = field(default="none", kw_only=True)
    hysteresis: Hysteresis | None = field(default=None, kw_only=True)
    _equilibrium: Equilibrium = field(init=False, repr=False, compare=False)

    name = "energy"
    unused: ClassVar[tuple[str, ...]] = (
        "strands",
        "strand_radius",
        "end_length",
        "poisson_ratio",
        "strand_modulus",
    )

    def __post_init__(self) -> None:
        check_hysteresis(self.hysteresis)
        if self.ends not in ENDS:
            raise InputError(f"ends is '{self.ends}': it must be one of {list(ENDS)}")
        tapered = self.ends == "trellis"
        if tapered and self.muscle.active_length < 6.0 * self.taper_length:
            raise InputError(
                f"muscle active length is {self.muscle.active_length:g} mm: with trellis ends it "
                f"must be at least {6.0 * self.taper_length:g} mm, for two tapers"
            )
        object.__setattr__(self, "_equilibrium", Equilibrium.of(self.muscle, tapered=tapered))

    @property
    def packed_design(self) -> tuple[float, ...]:
        """The design as the compiled equations take it."""
        return self._equilibrium.design

    @property
    def taper_length(self) -> float:
        """Length over which a taper falls to 1/e, of a soft wall held at its free length [mm].

        ``R cot(angle)**2 / sqrt(3)``, with radius and angle of the cylinder: it gets shorter as the
        muscle contracts, and longer under load.
        """
        return self.muscle.braid_radius / math.tan(self.muscle.braid_angle) ** 2 / math.sqrt(3.0)

    @property
    def contraction_limits(self) -> tuple[float, float]:
        """Legal contractions [mm], from the bore squeezed shut (negative: longer) to locking.

        Trellis ends of a small braid angle shorten by more than their share of a locked cylinder;
        with them the second is the length that contracts, and the free contraction is the limit.
        """
        low, high = self._equilibrium.stretches
        active = self.muscle.active_length
        shortest = 0.0 if self.ends == "trellis" else low
        return active * (1.0 - high), active * (1.0 - shortest)

    def force(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the pull of the muscle.

        Parameters
        ----------
        pressure : array_like
            Pressure [MPa].
        contraction : array_like
            How much shorter than at rest the muscle is held [mm].
        direction : str or array of str, optional
            ``"inflating"`` or ``"deflating"`` for the branch of friction; None or ``""`` for the
            curve without friction.

        Returns
        -------
        (...) ndarray
            Pull [N]; negative beyond the free contraction.

        Raises
        ------
        InputError
            If an argument is outside its legal range; the message has the first such value.
        """
        pressures, contractions, signs = self._take(pressure, "contraction", contraction, direction)
        stretches = self._equilibrium.place(pressures, contractions, signs)
        return np.asarray(self._equilibrium.evaluate(pressures, stretches, signs)[0])

    def stiffness(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return ``-d force / d contraction`` [N/mm] at a pressure, along a branch of friction.

        Without `direction` that is the curve without friction; neither is what a muscle shows that
        has just turned round, whose crossings have to let go first. With trellis ends the slope of
        the taper is a finite difference, good to about 1e-6.

        Raises
        ------
        InputError
            As `force` does.
        """
        pressures, contractions, signs = self._take(pressure, "contraction", contraction, direction)
        stretches = self._equilibrium.place(pressures, contractions, signs)
        slope = self._equilibrium.evaluate(pressures, stretches, signs)[1]
        length_slope = np.full(slope.shape, self.muscle.active_length)
        if self.ends == "trellis":
            # Towards the free length only: on the other side the braid may come loose.
            step = 1e-4 * np.maximum(1.0 - stretches, 0.0)
            here, near, far = (
                self._equilibrium.measure_ends(pressures, stretches + k * step)[0] for k in range(3)
            )
            moved = step > 0.0
            length_slope[moved] -= (4.0 * near - 3.0 * here - far)[moved] / step[moved]
        return np.asarray(slope / length_slope)

    def contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the contraction under a load.

        Parameters
        ----------
        pressure : array_like
            Pressure [MPa].
        load : array_like
            Load that the muscle holds [N].
        direction : str or array of str, optional
            As in `force`.

        Returns
        -------
        (...) ndarray
            Contraction [mm]; negative where the muscle is longer than at rest.

        Raises
        ------
        InputError
            If an argument is outside its legal range, or the muscle cannot hold the load.
        ConvergenceError
            If the solver stops short of its tolerance; `solve` tells where.
        """
        pressures, loads, signs = self._take(pressure, "load", load, direction)
        stretches = self._demand(pressures, loads, signs)
        return self._equilibrium.shorten(pressures, stretches)

    def solve(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> MuscleState:
        """Return everything the model says about the muscle under `pressure` and `load`.

        Where the solver stops short of its tolerance, `MuscleState.converged` is false.

        Raises
        ------
        InputError
            As `contraction` does.
        """
        pressures, loads, signs = self._take(pressure, "load", load, direction)
        stretches, iterations = self._equilibrium.find(pressures, loads, signs)
        contraction = self._equilibrium.shorten(pressures, stretches)
        pull, _, contact, _ = self._equilibrium.evaluate(pressures, stretches, signs)
        converged = iterations < _kernels.MAX_ITERATIONS
        return MuscleState(
            contraction=contraction,
            length=np.asarray(self.muscle.length - contraction),
            braid_angle=np.asarray(np.arccos(stretches * math.cos(self.muscle.braid_angle))),
            contact_pressure=contact,
            force=pull,
            converged=np.asarray(converged),
            residual=np.asarray(pull - loads),
            iterations=iterations,
            reason=np.where(converged, "", describe_stop(_kernels.MAX_ITERATIONS)),
        )

    def volume(self, pressure: ArrayLike, load: ArrayLike = 0.0) -> Floats:
        """Return the volume of the bore [mm^3], over the length that contracts, without friction.

        It is ``-d potential / d pressure`` at the equilibrium.

        Raises
        ------
        InputError
            As `contraction` does.
        """
        pressures, _, stretches, swells = self._settle(pressure, load)
        ends = self._equilibrium.measure_ends(pressures, stretches)[1]
        return np.asarray(self._measure_bore(swells) - 2.0 * ends)

    def potential(self, pressure: ArrayLike, load: ArrayLike = 0.0) -> Floats:
        """Return wall energy less the work of `pressure` and `load` at equilibrium [N mm].

        Its derivatives are ``-volume`` in the pressure and ``-length`` in the load.

        Raises
        ------
        InputError
            As `contraction` does.
        """
        pressures, loads, stretches, swells = self._settle(pressure, load)
        length = self.muscle.active_length * stretches + self.muscle.dead_length
        wall = self._equilibrium.measure_wall(stretches, swells)
        ends = self._equilibrium.measure_ends(pressures, stretches)[2]
        work = pressures * self._measure_bore(swells) + loads * length
        return np.asarray(wall - work + 2.0 * ends)

    def dead_band(self) -> float:
        """Return the pressure at which the unloaded tube meets the braid [MPa]; 0 without a gap.

        A closed tube gets longer as it fills, so the muscle is back at its free length only at a
        slightly higher pressure.
        """
        if self.muscle.gap == 0.0:
            return 0.0
        design = self._equilibrium.design
        stretch = _kernels.find_contact(design)
        swell = _kernels.braid_swell(design, stretch)[0]
        shear = design[6] / stretch + design[7] * stretch
        return float(2.0 * shear * _kernels.swell_terms(design, swell)[1])

    def _take(
        self, pressure: ArrayLike, name: str, other: ArrayLike, direction: ArrayLike | None
    ) -> tuple[Floats, Floats, Floats]:
        """Arrays of one shape, checked: pressures, loads or contractions, signs of friction."""
        pressures, others = check_array("pressure", pressure), check_array(name, other)
        check_range("pressure", pressures, 0.0, PRESSURE_LIMIT, "MPa")
        if name == "load":
            slack = 1e-9 * self.muscle.modulus * self.muscle.tube.wall_area
            check_range("load", others, 0.0, LOAD_LIMIT, "N", slack=slack)
        else:
            slack = 1e-9 * self.muscle.active_length
            check_range("contraction", others, *self.contraction_limits, "mm", slack=slack)
        signs = parse_direction(direction)
        first, second, third = broadcast(
            ("pressure", pressures), (name, others), ("direction", signs)
        )
        return first, second, third

    def _settle(
        self, pressure: ArrayLike, load: ArrayLike
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Pressures and loads, stretches and swells at equilibrium."""
        pressures, loads, signs = self._take(pressure, "load", load, None)
        stretches = self._demand(pressures, loads, signs)
        terms = self._equilibrium.evaluate(pressures, stretches, signs)
        return pressures, loads, stretches, terms[3]

    def _demand(self, pressures: Floats, loads: Floats, signs: Floats) -> Floats:
        """Stretches at equilibrium, all converged."""
        stretches, iterations = self._equilibrium.find(pressures, loads, signs)
        demand_convergence(pressures, iterations, _kernels.MAX_ITERATIONS, model=self.name)
        return stretches

    def _measure_bore(self, swells: Floats) -> Floats:
        """Volume of the bore of a cylinder [mm^3]."""
        area = math.pi * (self.muscle.inner_radius**2 + swells)
        return np.asarray(self.muscle.active_length * area)

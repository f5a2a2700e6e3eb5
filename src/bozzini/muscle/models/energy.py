"""The recommended model: one energy, from which force, contraction and volume follow."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import ClassVar, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_word, name_at, show_apart
from ...errors import ConvergenceError, InputError
from ...numeric.arrays import Floats
from ...numeric.vectors import settle_layout
from ..design import PRESSURE_LIMIT, Muscle, check_muscle
from ..hysteresis import Hysteresis
from ..kernels import ends as end_kernels
from ..kernels import energy as kernels
from ..kernels import interface
from ..model import (
    CompiledMuscle,
    MuscleModel,
    MuscleState,
    check_hysteresis,
    demand_convergence,
    describe_stop,
    is_as_defined,
    take_arguments,
)

PAST_LOCKING = 0.35
"""Cosine of the braid angle at which a muscle with friction ends."""


Ends = Literal["none", "trellis"]
ENDS: tuple[Ends, ...] = get_args(Ends)


def pack_design(muscle: Muscle) -> tuple[float, ...]:
    """Return a muscle as the kernels take it; the last two are the legal stretches."""
    packed: tuple[float, ...] = kernels.pack_design(
        float(muscle.inner_radius),
        float(muscle.outer_radius),
        float(muscle.braid_angle),
        float(muscle.gap),
        float(muscle.modulus),
        float(muscle.mooney_ratio),
        float(muscle.friction_length),
        PAST_LOCKING,
    )
    return packed


@dataclass(frozen=True)
class EnergyMuscle(MuscleModel):
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

    Legal are pressures in [0, 20] MPa, contractions from where the braid has squeezed 98 % of
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
    ends: Ends = field(default="none", kw_only=True)
    hysteresis: Hysteresis | None = field(default=None, kw_only=True)
    _design: tuple[float, ...] = field(init=False, repr=False, compare=False)

    name = "energy"
    fit_fields: ClassVar[tuple[str, ...]] = ("modulus", "dead_length")
    choices: ClassVar[Mapping[str, tuple[str, ...]]] = MappingProxyType({"ends": ENDS})
    unused: ClassVar[tuple[str, ...]] = (
        "strands",
        "strand_radius",
        "end_length",
        "poisson_ratio",
        "strand_modulus",
    )

    def __post_init__(self) -> None:
        check_muscle(self.muscle, self)
        check_hysteresis(self.hysteresis)
        check_word("ends", self.ends, ENDS)
        if self._tapered and self.muscle.active_length < 6.0 * self.taper_length:
            shown = show_apart(self.muscle.active_length, 6.0 * self.taper_length)
            raise InputError(
                f"muscle active length is {shown[0]} mm: with trellis ends it "
                f"must be at least {shown[1]} mm, for two tapers"
            )
        object.__setattr__(self, "_design", pack_design(self.muscle))

    @property
    def _tapered(self) -> bool:
        return self.ends == "trellis"

    @property
    def compiled(self) -> CompiledMuscle | None:
        """The equations without friction as compiled functions; None with trellis ends."""
        if self.ends != "none" or not is_as_defined(self, EnergyMuscle):
            return None
        numbers = (*self._design, self.muscle.active_length)
        return interface.compile_model(kernels, numbers)

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
        low, high = self._design[9:]
        active = self.muscle.active_length
        shortest = 0.0 if self.ends == "trellis" else low
        return active * (1.0 - high), active * (1.0 - shortest)

    def force(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the pull of the muscle."""
        pressures, contractions, signs = self._take(pressure, "contraction", contraction, direction)
        stretches = self._place(pressures, contractions, signs)
        return np.asarray(self._evaluate(pressures, stretches, signs)[0])

    def stiffness(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return ``-d force / d contraction`` [N/mm] at a pressure, along a branch of friction.

        Without `direction` that is the curve without friction; neither is what a muscle shows that
        has just turned round, whose crossings have to let go first. With trellis ends the slope of
        the taper is a finite difference, good to about 1e-6.
        """
        pressures, contractions, signs = self._take(pressure, "contraction", contraction, direction)
        stretches = self._place(pressures, contractions, signs)
        slope = self._evaluate(pressures, stretches, signs)[1]
        length_slope = np.full(slope.shape, self.muscle.active_length)
        if self.ends == "trellis":
            # Towards the free length only: on the other side the braid may come loose.
            step = 1e-4 * np.maximum(1.0 - stretches, 0.0)
            here, near, far = (
                self._measure_ends(pressures, stretches + k * step)[0] for k in range(3)
            )
            moved = step > 0.0
            length_slope[moved] -= (4.0 * near - 3.0 * here - far)[moved] / step[moved]
        return np.asarray(slope / length_slope)

    def contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the contraction under a load."""
        pressures, loads, signs = self._take(pressure, "load", load, direction)
        stretches = self._demand(pressures, loads, signs)
        return self._shorten(pressures, stretches)

    def solve(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> MuscleState:
        """Return everything the model gives of the muscle under `pressure` and `load`.

        Where the solver stops short of its tolerance, `MuscleState.converged` is false.
        """
        pressures, loads, signs = self._take(pressure, "load", load, direction)
        stretches, iterations = self._find(pressures, loads, signs)
        contraction = self._shorten(pressures, stretches)
        pull, _, contact, _ = self._evaluate(pressures, stretches, signs)
        return self._report(
            contraction,
            braid_angle=np.asarray(np.arccos(stretches * math.cos(self.muscle.braid_angle))),
            contact_pressure=contact,
            force=pull,
            residual=np.asarray(pull - loads),
            iterations=iterations,
        )

    @property
    def _iteration_limit(self) -> int:
        return kernels.MAX_ITERATIONS

    def volume(self, pressure: ArrayLike, load: ArrayLike = 0.0) -> Floats:
        """Return the volume of the bore [mm^3], over the length that contracts, without friction.

        It is ``-d potential / d pressure`` at the equilibrium.
        """
        pressures, _, stretches, swells = self._settle(pressure, load)
        ends = self._measure_ends(pressures, stretches)[1]
        return np.asarray(self._measure_bore(swells) - 2.0 * ends)

    def potential(self, pressure: ArrayLike, load: ArrayLike = 0.0) -> Floats:
        """Return wall energy less the work of `pressure` and `load` at equilibrium [N mm].

        Its derivatives are ``-volume`` in the pressure and ``-length`` in the load.
        """
        pressures, loads, stretches, swells = self._settle(pressure, load)
        length = self.muscle.active_length * stretches + self.muscle.dead_length
        wall = self._measure_wall(stretches, swells)
        ends = self._measure_ends(pressures, stretches)[2]
        work = pressures * self._measure_bore(swells) + loads * length
        return np.asarray(wall - work + 2.0 * ends)

    def dead_band(self) -> float:
        """Return the pressure at which the unloaded tube meets the braid [MPa]; 0 without a gap.

        A closed tube gets longer as it fills, so the muscle is back at its free length only at a
        slightly higher pressure.
        """
        if self.muscle.gap == 0.0:
            return 0.0
        design = self._design
        stretch = kernels.find_contact(design)
        swell = kernels.braid_swell(design, stretch)[0]
        shear = design[6] / stretch + design[7] * stretch
        return float(2.0 * shear * kernels.swell_terms(design, swell)[1])

    def _take(
        self, pressure: ArrayLike, name: str, other: ArrayLike, direction: ArrayLike | None
    ) -> tuple[Floats, Floats, Floats]:
        """Arrays of one shape, checked: pressures, loads or contractions, signs of friction."""
        limits, slack = None, 1e-9 * self.muscle.modulus * self.muscle.tube.wall_area
        if name == "contraction":
            limits, slack = self.contraction_limits, 1e-9 * self.muscle.active_length
        return take_arguments(
            pressure, (name, other), direction, most=PRESSURE_LIMIT, limits=limits, slack=slack
        )

    def _settle(
        self, pressure: ArrayLike, load: ArrayLike
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Pressures and loads, stretches and swells at equilibrium."""
        pressures, loads, signs = self._take(pressure, "load", load, None)
        stretches = self._demand(pressures, loads, signs)
        terms = self._evaluate(pressures, stretches, signs)
        return pressures, loads, stretches, terms[3]

    def _demand(self, pressures: Floats, loads: Floats, signs: Floats) -> Floats:
        """Stretches at equilibrium, all converged."""
        stretches, iterations = self._find(pressures, loads, signs)
        demand_convergence(pressures, iterations, kernels.MAX_ITERATIONS, model=self.name)
        return stretches

    def _measure_bore(self, swells: Floats) -> Floats:
        """Volume of the bore of a cylinder [mm^3]."""
        area = math.pi * (self.muscle.inner_radius**2 + swells)
        return np.asarray(self.muscle.active_length * area)

    def _find(
        self, pressures: Floats, loads: Floats, signs: Floats
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Return the stretches under loads and the iterations, or raise `InputError`.

        One that did not converge took `kernels.MAX_ITERATIONS`.
        """
        stretches = np.empty(pressures.shape)
        iterations = np.empty(pressures.shape, dtype=np.int64)
        code, index = kernels.find_stretches(
            self._design,
            _flatten(pressures),
            _flatten(loads),
            _flatten(signs),
            stretches.reshape(-1),
            iterations.reshape(-1),
        )
        if code != kernels.CONVERGED:
            pressure, sign = float(pressures.flat[index]), float(signs.flat[index])
            low, high = (
                kernels.find_force(self._design, pressure, stretch, sign)[0]
                for stretch in self._design[9:]
            )
            shown = show_apart(loads.flat[index], max(0.0, low), high)
            raise InputError(
                f"{name_at('load', loads, index)} is {shown[0]} N: at a pressure of "
                f"{pressure:g} MPa it must lie in [{shown[1]}, {shown[2]}] N, above "
                "which the braid squeezes the bore shut"
            )
        return stretches, iterations

    def _place(self, pressures: Floats, contractions: Floats, signs: Floats) -> Floats:
        """Return the stretches at given contractions, or raise an error."""
        low, high = self._design[9:]
        if not self._tapered:
            return np.clip(1.0 - contractions / self.muscle.active_length, low, high)
        stretches = np.empty(pressures.shape)
        code, index = end_kernels.find_ended_stretches(
            self._design,
            self.muscle.active_length,
            settle_layout(pressures.ravel()),
            settle_layout(contractions.ravel()),
            settle_layout(signs.ravel()),
            stretches.reshape(-1),
        )
        if code != kernels.CONVERGED:
            name = name_at("contraction", contractions, index)
            if code == kernels.STOPPED:
                raise ConvergenceError(
                    f"no taper of the energy model at {name} = {contractions.flat[index]:g} mm: "
                    f"{describe_stop(kernels.MAX_ITERATIONS)}"
                )
            raise InputError(
                f"{name} is {contractions.flat[index]:g} mm: with trellis ends at a pressure of "
                f"{pressures.flat[index]:g} MPa it must be at most the free contraction, or 0 mm "
                "below the dead band"
            )
        return np.clip(stretches, low, high)

    def _shorten(self, pressures: Floats, stretches: Floats) -> Floats:
        """Return the contractions at given stretches of the cylinder."""
        contraction = self.muscle.active_length * (1.0 - stretches)
        if self._tapered:
            contraction = contraction + 2.0 * self._measure_ends(pressures, stretches)[0]
        return np.asarray(contraction)

    def _evaluate(self, pressures: Floats, stretches: Floats, signs: Floats) -> Floats:
        """Return pull, its slope in the stretch, contact pressure and swell, (4, ...)."""
        out = np.empty((4, *pressures.shape))
        kernels.find_forces(
            self._design,
            _flatten(pressures),
            _flatten(stretches),
            _flatten(signs),
            out.reshape(4, -1),
        )
        return out

    def _measure_wall(self, stretches: Floats, swells: Floats) -> Floats:
        """Return the strain energy of the wall [N mm]."""
        energy = np.empty(stretches.shape)
        kernels.fill_energies(self._design, stretches.ravel(), swells.ravel(), energy.reshape(-1))
        return 2.0 * math.pi * self.muscle.active_length * energy

    def _measure_ends(self, pressures: Floats, stretches: Floats) -> Floats:
        """Return by how much an end is shorter, holds less and has more potential, (3, ...)."""
        out = np.zeros((3, *pressures.shape))
        if not self._tapered:
            return out
        code, index = end_kernels.fill_ends(
            self._design,
            settle_layout(pressures.ravel()),
            settle_layout(stretches.ravel()),
            out.reshape(3, -1),
        )
        if code != kernels.CONVERGED:
            raise InputError(
                f"{name_at('pressure', pressures, index)} is {pressures.flat[index]:g} MPa: "
                "friction leaves the tapered ends no tension; it must be less, or the ends 'none'"
            )
        return out


def _flatten(array: Floats) -> Floats:
    """Return an array as a row, writable: kernels are compiled anew for arrays that are not."""
    return np.require(array.ravel(), requirements="W")

"""A reconstruction of the thesis's two-phase model of a miniature muscle (thesis 3.3)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import ClassVar, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_array, check_word, name_at, refuse_first, show_apart, show_range
from ...errors import InputError
from ...numeric.arrays import Floats
from ...numeric.roots import bisect
from ..design import Muscle, check_muscle
from ..hysteresis import Hysteresis
from ..kernels import interface
from ..kernels import thesis as kernels
from ..model import (
    CompiledMuscle,
    MuscleModel,
    MuscleState,
    check_hysteresis,
    demand_convergence,
    is_as_defined,
    take_arguments,
)


def find_contact_pressure(muscle: Muscle) -> float:
    """Return the pressure at which the free tube meets the braid [MPa], eq. (3.11), no load."""
    if muscle.gap == 0.0:
        return 0.0
    state = muscle.tube.deform(1.0)  # linear: the displacements at 1 MPa scale
    radial = float(state.radial_displacement(muscle.outer_radius))
    axial = float(state.c3)
    cosine, sine = math.cos(muscle.braid_angle), math.sin(muscle.braid_angle)

    def overlap(pressure: float) -> float:
        square = max(0.0, 1.0 - (cosine * (1.0 + axial * pressure)) ** 2)
        braid = muscle.braid_radius * math.sqrt(square) / sine
        return muscle.outer_radius + radial * pressure - braid

    # The tube gets no shorter, so the braid no wider than at rest: they have met by then.
    return bisect(overlap, 0.0, muscle.gap / radial)


def meet_braid(muscle: Muscle) -> tuple[float, tuple[float, ...]]:
    """Return the pressure of contact [MPa] and the design of `kernels` from there on."""
    cover = muscle.strands * muscle.strand_radius / (math.pi * muscle.outer_radius)
    if cover > 1.0:
        shown = show_apart(muscle.strand_radius, muscle.strand_radius / cover)
        raise InputError(
            f"muscle strand radius is {shown[0]} mm: it must lie in (0, "
            f"{shown[1]}] mm for the contact area of eq. (3.22)"
        )
    tube, contact = muscle.tube, find_contact_pressure(muscle)
    touched = tube.deform(contact)
    outer = muscle.outer_radius + float(touched.radial_displacement(muscle.outer_radius))
    inner = muscle.inner_radius + float(touched.radial_displacement(muscle.inner_radius))
    length = muscle.length + float(touched.elongation)
    cosine = length / muscle.length * math.cos(muscle.braid_angle)
    if cosine >= 1.0:
        raise InputError(
            f"muscle gap is {muscle.gap:g} mm: with a Poisson's ratio of {muscle.poisson_ratio:g} "
            "the tube pulls the braid straight before they touch"
        )
    sine = math.sqrt(1.0 - cosine * cosine)
    strands = math.pi * muscle.strand_radius**2 * muscle.strands * muscle.strand_modulus
    wall = math.cos(muscle.braid_angle) * tube.wall_area * muscle.modulus
    return contact, (
        *tube.lame_constants,
        inner,
        outer,
        length,
        sine,
        cosine,
        sine / cosine,
        0.25 * cover * cover,  # (sin cos)^2 of half the angle whose sine is the cover
        float(muscle.end_length),
        strands / (strands + wall),
    )


LoadPath = Literal["none", "bulk"]
LOAD_PATHS: tuple[LoadPath, ...] = get_args(LoadPath)

PRESSURE_LIMIT = 10.0
"""Largest legal pressure [MPa]; the thesis measured up to 0.827 and extrapolated in Fig. 3.17."""

ANGLE_LIMIT = math.radians(60.0)
"""Largest legal braid angle [rad]; the thesis's own curve overshoots the locking angle a little."""


@dataclass(frozen=True)
class ThesisMuscle(MuscleModel):
    """The thesis's model as far as it can be reconstructed: a linear tube, then a braid round it.

    Below the pressure of contact, eq. (3.11), the tube expands freely, eq. (3.5). Above it, lengths
    and pressures start anew from contact; the braid's kinematics (3.13) fix two displacements of
    the tube, whose Lamé constants (3.3) give the braid's pressure; that must equal the braid's
    pull, by virtual work (3.21), over the contact area (3.22). The pull is the share of the
    pressure on the deformed bore that the strands bear (3.17).

    It is a reconstruction, one of many readings, chosen because it meets the contractions without
    load of the thesis's chapter 4 (7.6, 7.1 and 6.2 mm at 689.4, 551.6 and 413.6 kPa) for a tube of
    0.75 mm outer radius and nothing fitted; for 0.55 mm it does not (10.8 mm). The printed
    equations cannot be solved as they stand:

    - (3.3) prints ``+P_o`` in ``c1``, which fails the boundary condition; ``-P_o`` is used.
    - (3.12) prints ``Pbar**2`` for ``Pbar r_i**2``, and loads the wall over the area of the bore.
    - (3.13) drops the gap unless lengths start anew at contact, as they do here.
    - (3.23) is missing from the text; it follows from (3.17), (3.21) and (3.22).
    - The braid angle at which strands lie side by side is (2.10) as printed.
    - The load enters the system only added to an unknown force, so that it cancels: *the printed
      model has no response to a load*.

    So `contraction` takes no load, and `force`, `stiffness` and `blocked_force` refuse, unless
    ``load_path="bulk"`` adds what the thesis does not have: the wall as a column that holds its
    cross-section, ``l0 / (L1 A)`` of length per newton, with Lamé's first constant. This comes
    nearest to the loaded rows of Tables 4.1-4.4 (0.06 mm rms), but is not what the thesis has,
    and gives one stiffness at all pressures. Neither the thesis's 0.94 N/mm nor its locking at
    54.7 degrees is reproduced: the angle peaks near 3 MPa (49.3 degrees for an outer radius of 0.75
    mm, 53.5 for 0.55) and would fall again, because the linear tube can be compressed. Pressures
    beyond that peak are refused.

    There is no friction in it: `direction` is checked and makes no difference. What the muscle has
    and the model does not use is in `unused`. It is not validated on anything measured.

    Parameters
    ----------
    muscle : Muscle
        The design.
    load_path : str
        ``"none"`` or ``"bulk"``.
    hysteresis : Hysteresis, optional
        Operator for `trace_contraction`.

    Raises
    ------
    InputError
        If `load_path` is unknown, or the model has no answer for such a muscle.
    """

    muscle: Muscle
    load_path: LoadPath = field(default="none", kw_only=True)
    hysteresis: Hysteresis | None = field(default=None, kw_only=True)
    _contact: float = field(init=False, repr=False, compare=False, default=0.0)
    _design: tuple[float, ...] = field(init=False, repr=False, compare=False, default=())
    _free_strain: float = field(init=False, repr=False, compare=False, default=0.0)

    name = "thesis"
    fit_fields: ClassVar[tuple[str, ...]] = ("modulus", "end_length")
    choices: ClassVar[Mapping[str, tuple[str, ...]]] = MappingProxyType({"load_path": LOAD_PATHS})
    unused: ClassVar[tuple[str, ...]] = ("dead_length", "mooney_ratio", "friction_length")

    def __post_init__(self) -> None:
        check_muscle(self.muscle, self)
        check_hysteresis(self.hysteresis)
        check_word("load path", self.load_path, LOAD_PATHS)
        if self.load_path == "bulk" and self.muscle.poisson_ratio < 0.01:
            raise InputError(
                f"Poisson's ratio is {self.muscle.poisson_ratio:g}: with the load path 'bulk' it "
                "must lie in [0.01, 0.499999]"
            )
        contact, design = meet_braid(self.muscle)
        object.__setattr__(self, "_contact", contact)
        object.__setattr__(self, "_design", design)
        # A tube with closed ends, eq. (3.5), per MPa: it is linear.
        object.__setattr__(self, "_free_strain", float(self.muscle.tube.deform(1.0).c3))

    @property
    def takes_load(self) -> bool:
        """Whether the contraction depends on the load: not without a load path."""
        return self.load_path != "none"

    @property
    def compiled(self) -> CompiledMuscle | None:
        """The equations as compiled functions."""
        if not is_as_defined(self, ThesisMuscle):
            return None
        return interface.compile_model(kernels, self._pack_numbers())

    def _pack_numbers(self) -> tuple[float, ...]:
        """Return what the compiled functions take."""
        return (
            *self._design,
            self._contact,
            self.muscle.length,
            self._free_strain,
            0.5 * math.acos(self._design[6]),
            ANGLE_LIMIT,
            self.load_stiffness if self.takes_load else 0.0,
        )

    @property
    def load_stiffness(self) -> float:
        """Load per shortening lost [N/mm] with ``load_path="bulk"``."""
        tube = self.muscle.tube
        return tube.lame_constants[0] * tube.wall_area / self.muscle.length

    @property
    def contraction_limits(self) -> tuple[float, float]:
        """Legal contractions [mm]: strands straight (negative: longer), braid at `ANGLE_LIMIT`."""
        strand = self.muscle.braid.strand_length
        length = self.muscle.length
        return length - strand, length - strand * math.cos(ANGLE_LIMIT)

    def contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the contraction [mm] at `pressure` [MPa] under `load` [N].

        Raises
        ------
        InputError
            If a pressure is not in [0, 10] MPa or beyond the peak of the angle, if there is a load
            and ``load_path="none"``, if the load would stretch the braid beyond its strands, or if
            the model has no answer.
        ConvergenceError
            If the solver stops short of its tolerance; `solve` reports where.
        """
        state = self.solve(pressure, load, direction=direction)
        demand_convergence(
            np.broadcast_to(np.asarray(pressure, dtype=np.float64), state.iterations.shape),
            state.iterations,
            kernels.MAX_ITERATIONS,
            model=self.name,
        )
        return state.contraction

    def force(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the pull [N] at `pressure` [MPa] and `contraction` [mm]; needs a load path.

        Raises
        ------
        InputError
            If an argument is outside its legal range, or ``load_path="none"``.
        """
        pressures, contractions = self._take_contraction(pressure, contraction, direction)
        free, _, _, iterations = self._solve_free(pressures)
        limit = kernels.MAX_ITERATIONS
        demand_convergence(pressures, iterations, limit, model=self.name)
        return np.asarray((free - contractions) * self.load_stiffness)

    def stiffness(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the stiffness of the load path [N/mm], the same everywhere."""
        pressures, _ = self._take_contraction(pressure, contraction, direction)
        return np.full(pressures.shape, self.load_stiffness)

    def dead_band(self) -> float:
        """Return the pressure at which the unloaded tube meets the braid [MPa], eq. (3.11)."""
        return self._contact

    def solve(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> MuscleState:
        """Return everything the model gives of the muscle under `pressure` and `load`.

        `MuscleState.contact_pressure` counts from contact and is that without load;
        `MuscleState.residual` is that of eq. (3.23). Where the solver stops short of its tolerance,
        `MuscleState.converged` is false.

        Raises
        ------
        InputError
            As `contraction` does.
        """
        given = check_array("load", load)
        if self.load_path == "none":
            refuse_first(
                given != 0.0,
                "load",
                given,
                "it must be 0 N, the thesis's equations have no response to a load (the load path "
                "'bulk' adds one)",
                unit="N",
            )
        pressures, loads, _ = take_arguments(
            pressure,
            ("load", given),
            direction,
            most=PRESSURE_LIMIT,
            slack=1e-9 * self.load_stiffness,
        )
        free, contact, residual, iterations = self._solve_free(pressures)
        contraction = free
        if self.load_path == "bulk":
            contraction = np.asarray(free - loads / self.load_stiffness)
            most = (free - self.contraction_limits[0]) * self.load_stiffness
            refuse_first(
                contraction < self.contraction_limits[0],
                "load",
                loads,
                lambda index: (
                    f"at a pressure of {pressures.flat[index]:g} MPa it must lie in "
                    f"{show_range(loads, index, 0.0, most)} N, at which the strands are straight"
                ),
                unit="N",
            )
        return self._report(
            contraction,
            braid_angle=self.muscle.braid.angle_at(self.muscle.length - contraction),
            contact_pressure=contact,
            force=np.array(loads),
            residual=residual,
            iterations=iterations,
        )

    @property
    def _iteration_limit(self) -> int:
        return kernels.MAX_ITERATIONS

    def _solve_free(self, pressures: Floats) -> tuple[Floats, Floats, Floats, NDArray[np.int64]]:
        """Contraction, contact pressure, residual and iterations without load."""
        muscle = self.muscle
        out = np.zeros((3, pressures.size))
        iterations = np.zeros(pressures.size, dtype=np.int64)
        flat = pressures.ravel()
        above = np.flatnonzero(flat > self._contact)
        part, taken = np.empty((3, above.size)), np.empty(above.size, dtype=np.int64)
        cosine = self._design[6]
        failed = kernels.find_angles(
            self._design,
            flat[above] - self._contact,
            0.5 * math.acos(cosine),
            ANGLE_LIMIT,
            part,
            taken,
        )
        if failed >= 0:
            index = int(above[failed])
            shown = show_apart(flat[index], self._find_limit(float(flat[index])))
            raise InputError(
                f"{name_at('pressure', pressures, index)} is {shown[0]} MPa: it must lie in "
                f"[0, {shown[1]}] MPa, above which the thesis's "
                "equations have no answer or this muscle gets longer again"
            )
        out[1:, above] = part[1:]
        iterations[above] = taken
        out[0] = -muscle.length * self._free_strain * np.minimum(flat, self._contact)
        ratio = np.cos(part[0]) / cosine
        out[0, above] = muscle.length - self._design[4] * ratio
        shape = pressures.shape
        return (
            out[0].reshape(shape),
            out[1].reshape(shape),
            out[2].reshape(shape),
            iterations.reshape(shape),
        )

    def _find_limit(self, refused: float) -> float:
        """Return the pressure up to which there is an answer [MPa], below one that is refused."""
        numbers = np.array(self._pack_numbers())

        def refuses(pressure: float) -> float:
            return -1.0 if kernels.find_free_contraction(numbers, pressure)[1] else 1.0

        low = self._contact + 1e-9  # not a pressure so small that the arithmetic fails
        return bisect(refuses, low, refused) if refused > low else self._contact

    def _take_contraction(
        self, pressure: ArrayLike, contraction: ArrayLike, direction: ArrayLike | None
    ) -> tuple[Floats, Floats]:
        if self.load_path == "none":
            raise InputError(
                "load path is 'none': the thesis's equations have no response to a load, so no "
                "force or stiffness; it must be 'bulk' for that"
            )
        pressures, contractions, _ = take_arguments(
            pressure,
            ("contraction", contraction),
            direction,
            most=PRESSURE_LIMIT,
            limits=self.contraction_limits,
        )
        return pressures, contractions

"""How tendon displacements and the bends of all sections go together, for parallel tendons.

A tendon at offset ``a`` and angle ``psi`` gets shorter by ``a (cos psi, sin psi) . b`` in a
section that bends by ``b = theta (cos phi, sin phi)``, and a distal one so in every section that it
passes: the displacements are linear in the bends. Where tendons leave a bend open the backbone
takes the shape of least elastic energy; where a cable would have to push, it goes slack.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number
from ..errors import GeometryError, InputError
from .robot import ContinuumRobot, check_robot
from .section import GRAIN

__all__ = [
    "BendSolution",
    "Coupling",
    "check_displacements",
    "coupling_matrix",
    "find_crooked",
    "require_arcs",
]

Floats = NDArray[np.float64]

THIN = 1e-9
"""Ratio of singular values below which directions count as one."""


@dataclass(frozen=True, kw_only=True)
class BendSolution:
    """Bends of the sections under tendon displacements.

    Attributes
    ----------
    bends : (..., m, 2) ndarray
        ``(theta cos(phi), theta sin(phi))`` of each section [rad].
    misfit : (..., t) ndarray
        Commanded displacement less that of the bends [mm]; negative where a tendon is loose.
    residual : (...) ndarray
        Largest misfit of the tendons that are not slack [mm].
    slack : (..., t) ndarray of bool
        Cables that hang loose.
    converged : (...) ndarray of bool
        Whether the bends give what was commanded.
    reason : (...) ndarray of str
        Which tendon does not go, and by how much; empty where converged.
    """

    bends: Floats
    misfit: Floats
    residual: Floats
    slack: NDArray[np.bool_]
    converged: NDArray[np.bool_]
    reason: NDArray[np.str_]


def check_displacements(robot: ContinuumRobot, displacements: ArrayLike) -> Floats:
    """Return displacements as a finite array of shape (..., t), or raise `InputError`."""
    count = len(robot.tendons)
    array = check_array("displacements", displacements)
    if array.ndim == 0 or array.shape[-1] != count:
        raise InputError(
            f"displacements has shape {array.shape}: it must be (..., {count}), one for each of "
            f"the tendons {list(robot.tendon_names)}"
        )
    if not np.isfinite(array).all():
        place = np.argwhere(~np.isfinite(array))[0]
        name = robot.tendon_names[place[-1]]
        raise InputError(f"displacement of tendon '{name}' is {array[tuple(place)]}: not finite")
    return array


def coupling_matrix(robot: ContinuumRobot, *, model: str = "arc") -> Floats:
    """Return the matrix from bends to displacements, shape (t, 2 m) [mm/rad].

    Raises
    ------
    GeometryError
        If a tendon is not parallel to the backbone or does not end at its section's end.
    """
    check_robot(robot)
    if not robot.tendons:
        raise GeometryError(f"robot '{robot.name}' has no tendons: nothing can move it")
    crooked = find_crooked(robot)
    if crooked:
        raise GeometryError(
            f"{crooked}: the {model} model takes tendons parallel to the backbone up to the end of "
            "their section; take the energy or the rod model"
        )
    matrix = np.zeros((len(robot.tendons), len(robot.sections), 2))
    for row, tendon in enumerate(robot.tendons):
        matrix[row, : int(robot.tendon_sections[row]) + 1] = tendon.path(0.0)
    return matrix.reshape(len(matrix), -1)


def find_crooked(robot: ContinuumRobot) -> str:
    """Return which tendon is not parallel to the backbone up to its section's end; else empty."""
    for row, tendon in enumerate(robot.tendons):
        end = float(robot.section_ends[int(robot.tendon_sections[row])])
        if not tendon.is_parallel:
            return f"tendon '{tendon.name}' changes its offset or angle on its way"
        if robot.tendon_ends[row] < end - GRAIN:
            where = f"{robot.tendon_ends[row]:g} mm, before its section does at {end:g} mm"
            return f"tendon '{tendon.name}' ends at {where}"
    return ""


def require_arcs(robot: ContinuumRobot, user: str) -> None:
    """Raise `GeometryError`, in the words of one who needs arcs, unless all tendons are parallel.

    Parameters
    ----------
    robot : ContinuumRobot
        The robot.
    user : str
        Who takes sections that bend in arcs only.
    """
    check_robot(robot)
    crooked = find_crooked(robot)
    if crooked:
        raise GeometryError(
            f"{crooked}: {user} takes sections that bend in arcs, by tendons parallel to the "
            "backbone up to the end of their section"
        )


def reason_array(shape: tuple[int, ...], reasons: dict[tuple[int, ...], str]) -> NDArray[np.str_]:
    """Return an array of texts, empty but at the places given."""
    width = max((len(text) for text in reasons.values()), default=1)
    array = np.zeros(shape, dtype=f"<U{width}")
    for place, text in reasons.items():
        array[place] = text
    return array


class Coupling:
    """Bends from displacements, and back, for one robot of parallel tendons.

    Parameters
    ----------
    robot : ContinuumRobot
        The robot.
    model : str
        Model that messages speak of.
    tolerance : float
        Displacement by which a command may miss being consistent [mm], in (0, 1].

    Raises
    ------
    GeometryError
        If a tendon is not parallel.
    """

    def __init__(
        self, robot: ContinuumRobot, *, model: str = "arc", tolerance: float = 1e-6
    ) -> None:
        self.robot = robot
        self.tolerance = check_number(
            "tolerance", tolerance, low=0.0, high=1.0, low_open=True, unit="mm"
        )
        self.matrix = coupling_matrix(robot, model=model)
        compliance = [section.length / section.bending_stiffness for section in robot.sections]
        self._scale = np.sqrt(np.repeat(compliance, 2))
        self._scaled = self.matrix * self._scale
        inverse = np.linalg.pinv(self._scaled, rcond=THIN)
        self.inverse = self._scale[:, None] * inverse
        self._tension = inverse.T @ inverse
        self._rods = np.asarray([tendon.pushes for tendon in robot.tendons])
        self._always_taut = bool(self._rods.all()) or self._can_be_preloaded()

    def solve(self, displacements: Floats) -> BendSolution:
        """Return the bends under checked displacements of shape (..., t)."""
        bends = displacements @ self.inverse.T
        misfit = displacements - bends @ self.matrix.T
        fits = np.abs(misfit).max(axis=-1) <= self.tolerance
        slack = np.zeros(displacements.shape, dtype=bool)
        reasons: dict[tuple[int, ...], str] = {}
        good = fits.copy()
        if not self._always_taut:
            tensions = displacements @ self._tension.T
            least = np.where(self._rods, 0.0, tensions).min(axis=-1)
            good &= least >= -THIN * np.abs(tensions).max(axis=-1)
        converged = np.array(good)
        for index in np.argwhere(~good):
            place = tuple(int(i) for i in index)
            found = self._solve_slack(displacements[place])
            if found is None:
                reasons[place] = self._explain(misfit[place])
                continue
            bends[place] = found
            misfit[place] = displacements[place] - self.matrix @ found
            slack[place] = ~self._rods & (misfit[place] < -self.tolerance)
            converged[place] = True
        sections = len(self.robot.sections)
        return BendSolution(
            bends=bends.reshape(*bends.shape[:-1], sections, 2),
            misfit=misfit,
            residual=np.where(slack, 0.0, np.abs(misfit)).max(axis=-1),
            slack=slack,
            converged=converged,
            reason=reason_array(fits.shape, reasons),
        )

    def open_directions(self) -> tuple[str, ...]:
        """Return one sentence for each section whose own tendons do not bend it every way."""
        words = []
        for index, section in enumerate(self.robot.sections):
            label = self.robot.section_label(index)
            if not section.tendons:
                words.append(f"{label} has no tendons of its own: no bend of it is controlled")
                continue
            own = self.matrix[self.robot.tendon_sections == index][:, 2 * index : 2 * index + 2]
            _, sizes, ways = np.linalg.svd(own)
            if len(sizes) < 2 or sizes[1] < THIN * sizes[0]:
                angle = np.degrees(np.arctan2(ways[1, 1], ways[1, 0])) % 180.0
                words.append(
                    f"{label} has tendons in one plane only: its bend towards {angle:.4g} deg "
                    "is not controlled"
                )
        return tuple(words)

    def _can_be_preloaded(self) -> bool:
        """Whether every cable can be tight at once without bending anything."""
        from scipy.optimize import nnls

        rods = self._scaled[self._rods]
        columns = np.vstack([self._scaled, -rods]).T
        size = float(np.abs(columns).max())
        load = -self._scaled[~self._rods].sum(axis=0) / size
        return bool(nnls(columns / size, load)[1] < 1e-9)

    def _solve_slack(self, displacements: Floats) -> Floats | None:
        """Return the bends of least energy that no cable is too short for, or None if none.

        Least-distance programming by non-negative least squares (Lawson and Hanson 1974, ch. 23).
        """
        from scipy.optimize import nnls

        sign = np.concatenate([np.ones(len(self._rods)), -np.ones(int(self._rods.sum()))])
        rows = np.vstack([self._scaled, self._scaled[self._rods]]) * sign[:, None]
        short = np.concatenate([displacements, displacements[self._rods]]) * sign
        size, reach = float(np.abs(rows).max()), float(np.abs(short).max())
        system = np.vstack([rows.T / size, short / reach])
        target = np.zeros(len(system))
        target[-1] = 1.0
        weights, _ = nnls(system, target)
        left = system @ weights - target
        if -left[-1] < 1e-12:
            return None
        bends = self._scale * (left[:-1] / -left[-1]) * (reach / size)
        missed = displacements - self.matrix @ bends
        if missed.max() > self.tolerance or -missed[self._rods].min(initial=0.0) > self.tolerance:
            return None
        return np.asarray(bends)

    def _explain(self, misfit: Floats) -> str:
        names = self.robot.tendon_names
        worst = int(np.argmax(np.where(self._rods, np.abs(misfit), misfit)))
        amount = float(misfit[worst])
        if amount > 0.0:
            return (
                f"tendon '{names[worst]}' is pulled {amount:.4g} mm more than the nearest shape "
                "gives way: it would have to stretch (let out those on the other side)"
            )
        return (
            f"rod '{names[worst]}' is pushed {-amount:.4g} mm more than the nearest shape gives "
            "way: it would have to be squeezed (pull those on the other side)"
        )

"""What an estimate of a robot's shape answers: shape, loads and errors with their intervals."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..numeric.arrays import Floats
from ..results import Json, Result, Shown, list_row, rows_of, tabulated, take_axes, to_plain
from .estimate_walls import WallPush
from .robot import RobotDesign

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LIMIT = 1.959963985
"""Half of a 95 % interval, in standard deviations."""
SURPRISED, DRAWN = 1e-4, 2048
"""Chance below which readings are not as expected, and sizes that are drawn for an interval."""
HIDDEN = ("curvature", "coupling")
"""So begin the names of numbers that mean nothing one by one."""


@dataclass(frozen=True, eq=False)
class EstimatorState(Shown):
    """What is known of all that the model does not know.

    Parameters
    ----------
    mean : (q,) ndarray
    covariance : (q, q) ndarray
    rotation_vectors, lengths : ndarray
        Of the segments and tendons, from which the next shape is searched.
    nominal : ndarray, optional
        Rotation vectors of the model alone, where it is among walls.
    """

    mean: Floats
    covariance: Floats
    rotation_vectors: Floats
    lengths: Floats
    nominal: Floats | None = None


@dataclass(frozen=True)
class EstimatedLoad(Shown):
    """A load that was found.

    Parameters
    ----------
    place, place_low, place_high : float
        Where, with its 95 % interval [mm].
    force, force_low, force_high : float
        How large, likewise [N].
    moment, moment_low, moment_high : float
        Likewise [N mm].
    vector : tuple of float
        The force in the world [N].
    """

    place: float = tabulated("mm")
    place_low: float = tabulated("mm")
    place_high: float = tabulated("mm")
    force: float = tabulated("N")
    force_low: float = tabulated("N")
    force_high: float = tabulated("N")
    moment: float = tabulated("N mm")
    moment_low: float = tabulated("N mm")
    moment_high: float = tabulated("N mm")
    vector: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class EstimatedContact(Shown):
    """How walls press the body at its stations, in the world.

    Parameters
    ----------
    gaps : (k,) ndarray
        Between body and wall [mm]; infinite where it is far, and at the base.
    forces : (k, 3) ndarray
        [N].
    deviations : (k,) ndarray
        Standard deviation of the size of each [N].
    resultant_covariance : (3, 3) ndarray
        Of their sum [N^2].
    """

    gaps: Floats
    forces: Floats
    deviations: Floats
    resultant_covariance: Floats

    @classmethod
    def make(cls, push: WallPush, moved: Floats, covariance: Floats) -> EstimatedContact:
        """Return it of stations but the first that move by a state's numbers as (n, 3, q)."""
        change = -push.blocks @ moved
        sizes = np.linalg.norm(push.forces, axis=1)
        ways = push.forces / np.maximum(sizes, 1e-300)[:, None]
        size_changes = np.einsum("ni,niq->nq", ways, change)
        variances = np.einsum("nq,qr,nr->n", size_changes, covariance, size_changes)
        whole = change.sum(axis=0)
        return cls(
            np.append(np.inf, push.gaps),
            np.concatenate([np.zeros((1, 3)), push.forces]),
            np.append(0.0, np.sqrt(np.maximum(variances, 0.0))),
            np.asarray(whole @ covariance @ whole.T),
        )

    @property
    def sizes(self) -> Floats:
        """Of the forces [N], (k,)."""
        return np.asarray(np.linalg.norm(self.forces, axis=1))

    @property
    def resultant(self) -> Floats:
        """Sum of the forces [N], (3,)."""
        return np.asarray(self.forces.sum(axis=0))


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapeEstimate(Result):
    """The shape of a robot in the world, and how well it is known.

    Parameters
    ----------
    robot : RobotDesign
    arc_length : (k,) ndarray
        Stations [mm].
    frames : (k, 4, 4) ndarray
        Frames there in the world [mm].
    covariance : (k, 6, 6) ndarray
        Of rotation [rad] and place [mm] in the axes of the world.
    commanded : (k, 3) ndarray
        Where the model alone has the stations [mm].
    tensions, tension_deviations : (t,) ndarray
        Of the tendons [N].
    loads : tuple of EstimatedLoad
    contact : EstimatedContact or None
        With walls, if there is a shape.
    names : tuple of str
        Of the numbers of the state.
    state : EstimatorState
        All that was estimated beside the shape.
    residual : float
        Root mean square of what readings miss after they were taken in, by their noise.
    innovation : float
        Sum of squares of what they missed before, by what was expected.
    numbers : int
        That were read.
    log_likelihood : float
        Of the readings, by the linearised model.
    steps : int
        Of the search.
    converged : bool
    reason : str
    """

    robot: RobotDesign
    arc_length: Floats
    frames: Floats
    covariance: Floats
    commanded: Floats
    tensions: Floats
    tension_deviations: Floats
    loads: tuple[EstimatedLoad, ...] = rows_of(EstimatedLoad)
    contact: EstimatedContact | None = None
    names: tuple[str, ...]
    state: EstimatorState
    residual: float
    innovation: float = 0.0
    numbers: int = 0
    log_likelihood: float
    steps: int
    converged: bool
    reason: str

    @property
    def points(self) -> Floats:
        """Places of the stations in the world, (k, 3) [mm]."""
        return np.asarray(self.frames[:, :3, 3])

    @property
    def deviations(self) -> Floats:
        """Standard deviation of each coordinate of the stations, (k, 3) [mm]."""
        return np.asarray(np.sqrt(np.einsum("kii->ki", self.covariance[:, 3:, 3:])))

    @property
    def surprise(self) -> float:
        """Root mean square of what readings missed before, by what was expected: 1 is right."""
        return math.sqrt(self.innovation / self.numbers) if self.numbers else math.nan

    @property
    def expected(self) -> bool:
        """Whether readings are where they may be: within the 99.99 % of a chi-square."""
        from scipy.special import chdtrc

        return not self.numbers or bool(chdtrc(self.numbers, self.innovation) > SURPRISED)

    @property
    def tip(self) -> Floats:
        """Where the robot ends, in the world, (3,) [mm]."""
        return np.asarray(self.points[-1])

    @property
    def tip_covariance(self) -> Floats:
        """Of the place of the tip, (3, 3) [mm^2]."""
        return np.asarray(self.covariance[-1, 3:, 3:])

    def widen(self, factor: float) -> ShapeEstimate:
        """Return it with deviations of the shape and the tensions times a factor."""
        return dataclasses.replace(
            self,
            covariance=factor**2 * self.covariance,
            tension_deviations=factor * self.tension_deviations,
        )

    def to_dict(self) -> Json:
        """Return the estimate as plain values, units in the names."""
        spread = np.sqrt(np.maximum(np.diag(self.state.covariance), 0.0))
        values: Json = {
            "converged": self.converged,
            "reason": self.reason,
            "residual": self.residual,
            "surprise": self.surprise,
            "tip_mm": self.tip,
            "tip_covariance_mm2": self.tip_covariance,
            "tip_direction": self.frames[-1, :3, 2],
            "arc_length_mm": self.arc_length,
            "backbone_mm": self.points,
            "deviation_mm": self.deviations,
            "tensions_N": dict(zip(self.robot.tendon_names, self.tensions, strict=True)),
            "loads": [list_row(load) for load in self.loads],
            "state": {
                name: {"value": value, "standard_deviation": deviation}
                for name, value, deviation in zip(self.names, self.state.mean, spread, strict=True)
                if not name.startswith(HIDDEN)
            },
            "log_likelihood": self.log_likelihood,
            "steps": self.steps,
        }
        if self.contact is not None:
            values["wall_force_N"] = self.contact.sizes
            values["wall_force_deviation_N"] = self.contact.deviations
            values["wall_resultant_N"] = self.contact.resultant
            values["wall_resultant_covariance_N2"] = self.contact.resultant_covariance
        return {name: to_plain(value) for name, value in values.items()}

    def list_columns(self) -> dict[str, Floats]:
        """Return the columns of `to_frame`, a row for each station."""
        columns: dict[str, Floats] = {"arc_length_mm": self.arc_length}
        for k, axis in enumerate("xyz"):
            columns[f"{axis}_mm"] = self.points[:, k]
            columns[f"{axis}_deviation_mm"] = self.deviations[:, k]
        if self.contact is not None:
            columns["gap_mm"] = self.contact.gaps
            columns["wall_force_N"] = self.contact.sizes
            columns["wall_force_deviation_N"] = self.contact.deviations
        return columns

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the shape from the side with its 95 % band, and the model alone; return the axes."""
        frame = self.robot.base_frame
        local = (self.points - frame[:3, 3]) @ frame[:3, :3]
        alone = (self.commanded - frame[:3, 3]) @ frame[:3, :3]
        angle = float(np.arctan2(local[-1, 1], local[-1, 0]))
        side = np.array([math.cos(angle), math.sin(angle), 0.0])
        axes = take_axes(ax, x="along the base's axis [mm]",
                         y=f"towards {np.degrees(angle):z.0f}° [mm]", equal=True)  # fmt: skip
        turned = frame[:3, :3].T @ self.covariance[:, 3:, 3:] @ frame[:3, :3]
        view = np.stack([np.array([0.0, 0.0, 1.0]), side])
        flat, cov = local @ view.T, view @ turned @ view.T
        ways = self.frames[:, :3, 2] @ frame[:3, :3] @ view.T
        across = np.stack([-ways[:, 1], ways[:, 0]], axis=-1)
        across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
        half = LIMIT * np.sqrt(np.einsum("ki,kij,kj->k", across, cov, across))[:, None]
        band = np.concatenate([flat + half * across, (flat - half * across)[::-1]])
        axes.fill(*band.T, alpha=0.3, label="95 %")
        axes.plot(*(alone @ view.T).T, "0.6", linestyle="--", label="model alone")
        axes.plot(*flat.T, "k", label="estimate")
        for load in self.loads:
            at = [np.interp(load.place, self.arc_length, column) for column in flat.T]
            axes.plot(*at, "rv", label=f"{load.force:.3g} N")
        axes.legend(fontsize="small")
        return axes


def measure_sizes(known: Sequence[tuple[Floats, Floats]], weights: Floats) -> tuple[float, float]:
    """Return the 95 % interval of the size of a vector, from means and covariances with weights.

    It begins at 0 where that is within an ellipsoid of 95 %.
    """
    from scipy.stats import chi2

    count = len(known[0][0])
    if not count:
        return 0.0, 0.0
    drawn = np.random.default_rng(0).standard_normal((DRAWN, count))
    drawn = np.concatenate([drawn, -drawn])
    limit, near, sizes = chi2.ppf(0.95, count), [], []
    for mean, covariance in known:
        values, ways = np.linalg.eigh(covariance)
        spread = np.sqrt(np.maximum(values, 1e-24))
        near.append(float(np.sum((mean @ ways / spread) ** 2)) < limit)
        sizes.append(np.linalg.norm(mean + (drawn * spread) @ ways.T, axis=1))
    order = np.argsort(whole := np.concatenate(sizes))
    shares = np.cumsum(np.repeat(weights, len(drawn))[order])
    tail = 0.05 if float(weights @ np.array(near)) > 0.05 * weights.sum() else 0.025
    low, high = np.interp([tail, 1.0 - tail], shares / shares[-1], whole[order])
    return (0.0 if tail == 0.05 else float(low)), float(high)

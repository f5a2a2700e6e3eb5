"""The shape of a robot: what every model answers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..results import Json, Result, check_drawn, take_axes, to_plain
from .friction import FrictionState
from .robot import RobotDesign

if TYPE_CHECKING:
    from matplotlib.axes import Axes


STATION_TOLERANCE_MM = 1e-6
"""Distance at which a station counts as the place of a disc [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shape(Result):
    """Shapes of a robot, one for each set of displacements, in the frame of its base.

    ``...`` is the shape of the batch, empty for one set; ``k`` counts stations along the
    backbone, ``t`` tendons, ``m`` sections, ``d`` discs.

    Parameters
    ----------
    robot : RobotDesign
        The robot.
    model : str
        Name of the model.
    arc_length : (k,) ndarray
        Arc length of the stations [mm], from 0 to the robot's length, discs among them.
    frames : (..., k, 4, 4) ndarray
        Frames of the cross-sections at the stations [mm]: columns x, y, tangent, place.
    displacements : (..., t) ndarray
        Displacements that were commanded [mm].
    tendon_lengths : (..., t) ndarray
        Length of each tendon in this shape [mm]; a slack tendon is longer than this.
    section_parameters : (..., m, 2) ndarray
        Bend of each section as ``(theta cos(phi), theta sin(phi))`` [rad]; m is 0 where a
        section has no one bend.
    tensions : (..., t) ndarray
        Tension of each tendon [N]; t is 0 where the model knows no forces.
    slack : (..., t) ndarray of bool
        Tendons that are slack.
    residual : (...) ndarray
        How far the shape misses what was commanded, the largest over the tendons [mm].
    iterations : (...) ndarray of int
        Steps of the solver; 0 for a closed form.
    converged : (...) ndarray of bool
        Whether this is the robot's shape under the command. Where it is False the frames are
        the model's nearest try and `reason` states what is wrong.
    reason : (...) ndarray of str
        Why not; empty where converged.
    disc_arc_length : (d,) ndarray, optional
        Arc length of the discs [mm], those of the robot unless given; each is a station.
    friction : FrictionState, optional
        What tendons with friction remember; None of a model or robot without friction.
    stability : (...) ndarray, optional
        Least eigenvalue of the second variation of the energy under what is commanded, lengths or
        tensions, by that of the straight unloaded robot: 1 is as stiff as at rest, and below 0
        the equilibrium is unstable. Infinite where the model does not know it. The energy model
        without loads gives a lower bound where it is not negative.

    Raises
    ------
    InputError
        If the arrays do not go together, or a disc is no station.
    """

    rows_have_verdict = True

    robot: RobotDesign
    model: str
    arc_length: Floats
    frames: Floats
    displacements: Floats
    tendon_lengths: Floats
    section_parameters: Floats
    tensions: Floats
    slack: NDArray[np.bool_]
    residual: Floats
    iterations: NDArray[np.int64]
    converged: NDArray[np.bool_]
    reason: NDArray[np.str_]
    disc_arc_length: Floats = field(default_factory=lambda: np.empty(0))
    friction: FrictionState | None = field(default=None, repr=False)
    stability: Floats = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        if not self.stability.size:
            object.__setattr__(self, "stability", np.full(self.converged.shape, np.inf))
        if not self.disc_arc_length.size:
            object.__setattr__(self, "disc_arc_length", self.robot.disc_arc_length)
        batch = self.displacements.shape[:-1]
        count = len(self.robot.tendons)
        stations = len(self.arc_length)
        wanted: dict[str, tuple[tuple[int, ...], ...]] = {
            "arc_length": ((stations,),),
            "frames": ((*batch, stations, 4, 4),),
            "displacements": ((*batch, count),),
            "tendon_lengths": ((*batch, count),),
            "section_parameters": ((*batch, len(self.robot.sections), 2), (*batch, 0, 2)),
            "tensions": ((*batch, count), (*batch, 0)),
            "slack": ((*batch, count),),
            "residual": (batch,),
            "iterations": (batch,),
            "converged": (batch,),
            "reason": (batch,),
            "stability": (batch,),
        }
        for name, legal in wanted.items():
            array: NDArray[np.generic] = getattr(self, name)
            if array.shape not in legal:
                words = " or ".join(str(shape) for shape in legal)
                raise InputError(f"shape's {name} has shape {array.shape}: it must be {words}")
        index = self._disc_index()
        off = np.abs(self.arc_length[index] - self.disc_arc_length)
        if off.size and off.max() > STATION_TOLERANCE_MM:
            place = self.disc_arc_length[int(np.argmax(off))]
            raise InputError(f"shape's arc_length has no station at the disc at {place:g} mm")

    @property
    def points(self) -> Floats:
        """Points of the backbone at the stations, shape (..., k, 3) [mm]."""
        return self.frames[..., :3, 3]

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Whether each equilibrium is stable, shape (...); True where the model does not know."""
        return np.asarray(self.stability >= 0.0)

    @property
    def world_frames(self) -> Floats:
        """Frames at the stations in the world, shape (..., k, 4, 4) [mm]."""
        return np.asarray(self.robot.base_frame @ self.frames)

    @property
    def world_points(self) -> Floats:
        """Points of the backbone at the stations in the world, shape (..., k, 3) [mm]."""
        return self.world_frames[..., :3, 3]

    @property
    def tip(self) -> Floats:
        """Where the robot ends, shape (..., 3) [mm]."""
        return self.frames[..., -1, :3, 3]

    @property
    def tip_frame(self) -> Floats:
        """Frame of the robot's end, shape (..., 4, 4)."""
        return self.frames[..., -1, :, :]

    @property
    def disc_frames(self) -> Floats:
        """Frames of the discs, shape (..., d, 4, 4)."""
        return self.frames[..., self._disc_index(), :, :]

    @property
    def tendon_points(self) -> tuple[Floats, ...]:
        """Points of each tendon at the stations it passes, each of shape (..., k_i, 3) [mm]."""
        lines = []
        for tendon, end in zip(self.robot.tendons, self.robot.tendon_ends, strict=True):
            places = self.arc_length[self.arc_length <= end + STATION_TOLERANCE_MM]
            frames = self.frames[..., : len(places), :3, :]
            path = tendon.place_at(np.minimum(places, end))
            across = frames[..., :2] @ path[..., None]
            lines.append(frames[..., 3] + across[..., 0])
        return tuple(lines)

    @property
    def tendon_tensions(self) -> Floats:
        """Tensions along the tendons [N], shape (..., t, k); 0 beyond a tendon's end.

        `tensions` are those at the base. Where the model knows no forces, t is 0.
        """
        if self.friction is None:
            along = np.repeat(self.tensions[..., None], len(self.arc_length), axis=-1)
        else:
            along = self.friction.tensions_at(self.arc_length)
        if not along.shape[-2]:
            return along
        runs = self.arc_length <= self.robot.tendon_ends[:, None] + STATION_TOLERANCE_MM
        return np.where(runs, along, 0.0)

    @property
    def end_tensions(self) -> Floats:
        """Tension of each tendon where it ends [N], shape (..., t)."""
        index = np.searchsorted(self.arc_length, self.robot.tendon_ends - STATION_TOLERANCE_MM)
        last = np.minimum(index, len(self.arc_length) - 1)
        return self.tendon_tensions[..., np.arange(len(last)), last]

    def require(self) -> Shape:
        """Return this shape if every set of displacements has one.

        Raises
        ------
        GeometryError
            With the first reason, and its place in the batch.
        """
        require_all(self.converged, self.reason)
        return self

    def to_dict(self) -> Json:
        """Return the shapes as plain values, units in the names.

        Unless all have converged there are no places, only reasons and displacements.
        """
        known = bool(np.all(self.converged))
        tendons: dict[str, dict[str, object]] = {}
        for k, name in enumerate(self.robot.tendon_names):
            tendons[name] = {"displacement_mm": self.displacements[..., k]}
            if known:
                tendons[name] |= {
                    "length_mm": self.tendon_lengths[..., k],
                    "slack": self.slack[..., k],
                    "tension_N": self.tensions[..., k] if self.tensions.size else None,
                }
                if self.friction is not None:
                    tendons[name]["end_tension_N"] = self.end_tensions[..., k]
        places = {
            "tip_mm": self.tip,
            "tip_direction": self.tip_frame[..., :3, 2],
            "tip_frame": self.tip_frame,
            "residual_mm": self.residual,
            "iterations": self.iterations,
            "sections": describe_bends(self.robot, self.section_parameters),
            "arc_length_mm": self.arc_length,
            "backbone_mm": self.points,
        }
        if np.any(self.robot.base_frame != np.eye(4)):
            places |= {
                "tip_world_mm": self.world_frames[..., -1, :3, 3],
                "backbone_world_mm": self.world_points,
            }
        verdict = {"converged": self.converged, "reason": self.reason}
        if np.isfinite(self.stability).any():
            verdict |= {"stable": self.stable, "stability": self.stability}
        plain = to_plain(verdict | (places if known else {}) | {"tendons": tendons})
        return dict(plain)

    def list_columns(self) -> dict[str, NDArray[np.generic]]:
        """Return the columns of `to_frame`: the backbone, station by station, shape by shape."""
        batch = self.frames.shape[:-3]
        columns: dict[str, NDArray[np.generic]] = {
            "arc_length_mm": np.broadcast_to(self.arc_length, self.points.shape[:-1])
        }
        for kind, values in (("{}_mm", self.points), ("tangent_{}", self.frames[..., :3, 2])):
            columns |= {kind.format(axis): values[..., k] for k, axis in enumerate("xyz")}
        if batch:
            index = np.arange(int(np.prod(batch))).reshape(*batch, 1)
            columns = {"shape": np.broadcast_to(index, self.points.shape[:-1])} | columns
        return {name: values.ravel() for name, values in columns.items()}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw backbones, discs and tendons from the side, and return the axes.

        The plane of the picture holds the base's axis and the place furthest from it; slack
        tendons are dotted. Shapes whose frames are not finite are left out.

        Raises
        ------
        InputError
            If there are more than 100 shapes.
        """
        check_drawn(int(np.prod(self.frames.shape[:-3])), "shapes")
        places = self.points[np.isfinite(self.points).all(axis=(-2, -1))].reshape(-1, 3)
        far = places[np.argmax(np.hypot(*places.T[:2]))] if len(places) else np.zeros(3)
        angle = float(np.arctan2(far[1], far[0]))
        view = np.array([[np.cos(angle), np.sin(angle), 0.0], [0.0, 0.0, 1.0]])
        axes = take_axes(ax, x=f"towards {np.degrees(angle):z.0f}° [mm]", y="z [mm]", equal=True)
        radii = np.array([section.radius for section in self.robot.sections])
        radii = radii[self.robot.section_at(self.disc_arc_length)]
        discs, tendons, names = self.disc_frames, self.tendon_points, self.robot.tendon_names
        for count, index in enumerate(np.ndindex(self.frames.shape[:-3])):
            if not np.isfinite(self.frames[index]).all():
                continue
            # From the side a disc is an ellipse: its long axis is drawn.
            ways, sizes, _ = np.linalg.svd(view @ discs[index][:, :3, :2])
            half = (radii * sizes[:, 0])[:, None] * ways[:, :, 0]
            middle = discs[index][:, :3, 3] @ view.T
            axes.plot(*np.stack([middle - half, middle + half], axis=1).T, color="0.7", linewidth=1)
            for name, points, slack in zip(names, tendons, self.slack[index], strict=True):
                style, label = ":" if slack else "-", None if count else name
                axes.plot(*(view @ points[index].T), style, linewidth=1.0, label=label)
            label = None if count else "backbone"
            axes.plot(*(view @ self.points[index].T), "k", linewidth=2.0, label=label)
        return axes

    def _disc_index(self) -> NDArray[np.int64]:
        index = np.searchsorted(self.arc_length, self.disc_arc_length - STATION_TOLERANCE_MM)
        return np.minimum(index, len(self.arc_length) - 1).astype(np.int64)


def require_all(converged: NDArray[np.bool_], reason: NDArray[np.str_]) -> None:
    """Raise `GeometryError` with the first reason and its place, unless all have converged."""
    if not converged.all():
        index = int(np.argmin(converged))
        place = np.unravel_index(index, converged.shape)
        where = f" (displacements {[int(i) for i in place]})" if place else ""
        raise GeometryError(f"{reason.flat[index]}{where}")


def describe_bends(robot: RobotDesign, bends: Floats) -> list[dict[str, object]]:
    """Return the bends of sections, shape (..., m, 2), as rows; none where m is 0."""
    return [
        {
            "name": robot.sections[k].name,
            "bend_rad": np.hypot(bends[..., k, 0], bends[..., k, 1]),
            "direction_rad": np.arctan2(bends[..., k, 1], bends[..., k, 0]),
        }
        for k in range(bends.shape[-2])
    ]

"""The head as capsules: what is how far from what, what the camera sees, and pictures of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_points
from ..effector.section import find_bends
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import ReasonedResult, measured, tabulated, take_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .design import Head, HeadCamera, PlacedEffector, SectionPoses

ROUND_OFF = 1e-9
"""What overlaps by less touches nothing [mm]."""
_PAIRS = 4_000_000  # of segments, at once


class Capsules(NamedTuple):
    """A body as capsules along polylines (n, k, 3) of one radius [mm], n poses of it."""

    lines: Floats
    radius: float


def make_chains(
    placed: PlacedEffector, poses: SectionPoses, *, short: float = 1.0
) -> tuple[Capsules, ...]:
    """Return section and instrument in poses; their round ends reach no further than they do.

    The instrument is short of its tip by so many of its radii; drawn in, it ends in the holder.
    """
    tool, ways = placed.instrument, poses.direction
    body = poses.body.copy()
    body[:, -1] -= min(placed.radius, placed.effector.design.holder_length) * ways
    radius = 0.5 * tool.diameter
    end, start = poses.tip - short * radius * ways, poses.holder_tip
    is_in = ((end - start) * ways).sum(axis=1) < 0.0
    rod = Capsules(np.stack([np.where(is_in[:, None], end, start), end], axis=1), radius)
    return (Capsules(body, placed.radius), rod)[: 2 if tool.reach > 0.0 else 1]


def make_camera_chains(head: Head) -> tuple[Capsules, ...]:
    """Return the arm, as it is free, and the camera's housing."""
    arm, housing = head.lay_arm()
    radius = 0.5 * head.camera.diameter
    trim = min(radius / head.camera.length, 0.5)
    ends = housing[0] + np.array([[trim], [1.0 - trim]]) * (housing[1] - housing[0])
    return Capsules(arm[None], 0.5 * head.camera.thickness), Capsules(ends[None], radius)


def measure_gaps(one: tuple[Capsules, ...], other: tuple[Capsules, ...]) -> Floats:
    """Return the least gaps (n, m) between n poses of a body and m of another [mm].

    Negative where they overlap.
    """
    found = [_measure_lines(a.lines, b.lines) - (a.radius + b.radius) for a in one for b in other]
    return np.asarray(np.min(found, axis=0))


def _measure_lines(one: Floats, other: Floats) -> Floats:
    """Return the least distances (n, m) between polylines (n, k, 3) and (m, l, 3)."""
    size = max(1, _PAIRS // (other.shape[0] * one.shape[1] * other.shape[1]))
    parts = []
    for start in range(0, len(one), size):
        lines = one[start : start + size]
        a, b = lines[:, None, :-1, None], lines[:, None, 1:, None]
        c, d = other[None, :, None, :-1], other[None, :, None, 1:]
        parts.append(_measure_segments(a, b - a, c, d - c).min(axis=(2, 3)))
    return np.concatenate(parts)


def _measure_segments(a: Floats, u: Floats, c: Floats, v: Floats) -> Floats:
    """Return distances between segments from a along u and from c along v (..., 3).

    C. Ericson, Real-Time Collision Detection (2005), 5.1.9.
    """
    apart = a - c
    uu, vv, uv = (u * u).sum(-1), (v * v).sum(-1), (u * v).sum(-1)
    ua, va = (u * apart).sum(-1), (v * apart).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.clip(np.nan_to_num((uv * va - ua * vv) / (uu * vv - uv * uv)), 0.0, 1.0)
        t = np.clip(np.nan_to_num((uv * s + va) / vv), 0.0, 1.0)
        s = np.clip(np.nan_to_num((uv * t - ua) / uu), 0.0, 1.0)
    return np.asarray(np.linalg.norm(apart + s[..., None] * u - t[..., None] * v, axis=-1))


def see_places(camera: HeadCamera, housing: Floats, places: ArrayLike) -> NDArray[np.bool_]:
    """Return whether places (..., 3) lie in a camera's cone and in its depth of view: (2, ...)."""
    ahead = (housing[1] - housing[0]) / np.linalg.norm(housing[1] - housing[0])
    away = check_points("places", places) - housing[1]
    depth = away @ ahead
    in_cone = depth >= np.cos(0.5 * camera.view) * np.linalg.norm(away, axis=-1)
    return np.stack([in_cone, (depth >= camera.near) & (depth <= camera.far)])


def is_hidden(lens: Floats, tips: Floats, bodies: Sequence[Capsules]) -> NDArray[np.bool_]:
    """Return which tips (n, 3) bodies of the same n poses, or of one, stand before."""
    hidden = np.zeros(len(tips), dtype=np.bool_)
    for body in bodies:
        start, end = body.lines[:, :-1], body.lines[:, 1:]
        apart = _measure_segments(lens, (tips - lens)[:, None], start, end - start)
        # A tip on the end of a body is as far from its line as that is thick, seen from ahead.
        hidden |= apart.min(axis=1) < body.radius - ROUND_OFF
    return hidden


def see_tips(head: Head, index: int, poses: Sequence[SectionPoses]) -> NDArray[np.bool_]:
    """Return whether tips of an end-effector are in the cone, in the depth, and hidden: (3, n).

    The other end-effectors have as many poses, or one. An instrument is taken without its last end,
    as long as it is thick: a tip is hidden by its own instrument if it is seen from behind within
    30 degrees of its line.
    """
    _, housing = head.lay_arm()
    screens = [make_camera_chains(head)[0]]
    for k, (placed, pose) in enumerate(zip(head.effectors, poses, strict=True)):
        screens += make_chains(placed, pose, short=2.0 if k == index else 1.0)
    tips = poses[index].tip
    seen = see_places(head.camera, housing, tips)
    return np.concatenate([seen, is_hidden(housing[1], tips, screens)[None]])


@dataclass(frozen=True, kw_only=True, eq=False)
class HeadPose(ReasonedResult):
    """A head, free, with its end-effectors under pressures.

    Attributes
    ----------
    head : Head
    pressures : tuple of (m,) ndarray
        Of each end-effector [MPa].
    tip : (e, 3) float
        Tips of the instruments, in the head's frame [mm].
    direction : (e, 3) float
        Unit vectors of the instruments.
    bodies : tuple of (k, 3) ndarray
        Lines of the end-effectors up to the ends of their holders [mm].
    in_view : (e,) bool
        Whether the camera sees the tips: in its cone, in its depth, and not hidden.
    gap : float
        The least between camera, arm, end-effectors and instruments [mm].
    reason : str
        What touches; empty if nothing does.
    """

    head: Head
    pressures: tuple[Floats, ...]
    tip: Floats = tabulated("mm", "tip_{}")
    direction: Floats
    bodies: tuple[Floats, ...] = measured("mm")
    in_view: NDArray[np.bool_] = tabulated()
    gap: float = measured("mm")
    reason: str

    @property
    def residual(self) -> float:
        """By how much bodies overlap [mm]."""
        return max(0.0, -self.gap)

    def list_poses(self) -> list[SectionPoses]:
        """Return the poses of the end-effectors, one each."""
        return shape_effectors(self.head, self.pressures)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw it from the side, and return the axes."""
        return draw_head(self.head, ax, pose=self)


def pose_head(head: Head, pressures: Sequence[ArrayLike | Mapping[str, ArrayLike]]) -> HeadPose:
    """Return the pose of a head; see `Head.forward`."""
    if not isinstance(pressures, Sequence) or len(pressures) != len(head.effectors):
        raise InputError(
            f"pressures are {pressures!r:.60}: there must be one set for each of "
            f"{len(head.effectors)} end-effectors"
        )
    given = []
    for placed, one in zip(head.effectors, pressures, strict=True):
        table = placed.effector.take_pressures(one)
        if table.ndim != 1:
            raise InputError(f"pressures have shape {table.shape}: one pose has (m,)")
        given.append(table)
    poses = shape_effectors(head, given)
    gap, reason = find_overlap(head, poses)
    tips = np.concatenate([pose.tip for pose in poses])
    seen = np.concatenate([see_tips(head, k, poses) for k in range(len(poses))], axis=1)
    return HeadPose(
        head=head,
        pressures=tuple(given),
        tip=tips,
        direction=np.concatenate([pose.direction for pose in poses]),
        bodies=tuple(pose.body[0] for pose in poses),
        in_view=seen[0] & seen[1] & ~seen[2],
        gap=gap,
        reason=reason,
    )


def find_overlap(head: Head, poses: Sequence[SectionPoses]) -> tuple[float, str]:
    """Return the least gap between a head's bodies in one pose [mm], and which overlap, if any."""
    bodies = list_bodies(head, poses)
    gaps = {
        f"{one} and {other}": float(measure_gaps(bodies[one], bodies[other])[0, 0])
        for one, other in list_pairs(head)
    }
    closest = min(gaps, key=gaps.__getitem__)
    gap = gaps[closest]
    return gap, f"{closest} overlap by {-gap:.2f} mm" if gap < -ROUND_OFF else ""


def shape_effectors(head: Head, pressures: Sequence[Floats]) -> list[SectionPoses]:
    """Return the pose of each end-effector under its pressures (m,) [MPa], unchecked."""
    return [
        placed.shape(find_bends(placed.effector, one[None]))
        for placed, one in zip(head.effectors, pressures, strict=True)
    ]


def list_bodies(head: Head, poses: Sequence[SectionPoses]) -> dict[str, tuple[Capsules, ...]]:
    """Return the bodies of a head, free, by name."""
    bodies = {"camera": make_camera_chains(head)}
    for k, (placed, pose) in enumerate(zip(head.effectors, poses, strict=True)):
        bodies[name_effector(k)] = make_chains(placed, pose)
    return bodies


def name_effector(index: int) -> str:
    """Return what the end-effector of an index is called."""
    return f"end-effector {index + 1}"


def list_pairs(head: Head) -> list[tuple[str, str]]:
    """Return the pairs of bodies that may touch."""
    names = ["camera", *map(name_effector, range(len(head.effectors)))]
    return [(one, other) for k, one in enumerate(names) for other in names[k + 1 :]]


def draw_head(head: Head, ax: Axes | None = None, *, pose: HeadPose | None = None) -> Axes:
    """Draw a head from the side: in the plane of its axis and the camera's arm."""
    axes = take_axes(ax, x="along the axis [mm]", y="towards the camera's arm [mm]", equal=True)
    up = np.array([np.cos(head.camera.azimuth), np.sin(head.camera.azimuth), 0.0])

    def draw(
        line: Floats, color: str, label: str = "", look: str = "-", width: float = 1.6
    ) -> None:
        axes.plot(line[:, 2], line @ up, look, color=color, label=label, linewidth=width)

    half = 0.5 * head.diameter
    for free, look in ((False, "--"), (True, "-")):
        front = head.cap.find_front(free=free)
        label = "cap, pulled back" if free else "cap, forward"
        axes.plot([front - head.cap.length, front, front, front - head.cap.length],
                  [half, half, -half, -half], color="0.5", linestyle=look, label=label)  # fmt: skip
    if pose is None:
        zero = [np.zeros(len(placed.effector.design.muscles)) for placed in head.effectors]
        pose = pose_head(head, zero)
    for k, (placed, body) in enumerate(zip(head.effectors, pose.bodies, strict=True)):
        draw(body, f"C{k}", name_effector(k))
        draw(np.stack([body[-1], pose.tip[k]]), f"C{k}", look=":")
        axes.plot([0.0, 0.0], placed.place @ up + placed.radius * np.array([-1.0, 1.0]),
                  color=f"C{k}", linewidth=4.0)  # fmt: skip
    for free, color in ((False, "0.7"), (True, "C3")):
        arm, housing = head.lay_arm(free=free)
        draw(arm, color, "camera, free" if free else "camera, under the cap")
        draw(housing, color, width=5.0)
    _, (back, lens) = head.lay_arm()
    axis, across = (lens - back) / head.camera.length, np.tan(0.5 * head.camera.view)
    side = np.cross(np.cross(up, [0.0, 0.0, 1.0]), axis)  # in the plane of the arm
    for way in (axis + across * side, axis - across * side):
        end = lens + 0.5 * head.camera.far * way / np.linalg.norm(way)
        draw(np.stack([lens, end]), "C3", look=":", width=0.7)
    axes.legend(fontsize="x-small")
    return axes

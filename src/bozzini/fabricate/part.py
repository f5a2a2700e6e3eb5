"""A part: a body turned about z with round channels in it, as a closed surface."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import GeometryError
from ..numeric.arrays import Floats
from ..results import Json, Shown

if TYPE_CHECKING:
    import trimesh

Integers = NDArray[np.int64]

CHORD_ERROR_MM = 0.005
"""How far a facet may lie inside the circle that it stands for [mm]."""

LEAST_FACETS = 24
"""Facets of a circle, at least."""

SAMPLES = 5
"""Heights between two rings at which walls are measured, ends included."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel(Shown):
    """A round hole through a part, or into it.

    Parameters
    ----------
    name : str
        What runs in it.
    centre : (n, 3) ndarray
        Its middle line from low to high z [mm]; two rings at one height are a step of diameter.
    diameter : (n,) ndarray
        Across the middle line [mm].
    slope : (n, 2) ndarray
        dx/dz and dy/dz of the middle line. Cut across z the channel is an ellipse.
    """

    name: str
    centre: Floats
    diameter: Floats
    slope: Floats

    @property
    def is_straight(self) -> bool:
        """Whether its middle line is straight."""
        return bool(np.ptp(self.slope, axis=0).max() == 0.0)

    @property
    def stretch(self) -> Floats:
        """Length of the middle line per height (n,): long over short axis of the ellipse."""
        return np.asarray(np.sqrt(1.0 + np.sum(self.slope**2, axis=1)))


def drill(name: str, diameter: float, low: Floats, high: Floats) -> Channel:
    """Return a straight channel of one diameter between two points (3,) [mm]."""
    slope = (high[:2] - low[:2]) / (high[2] - low[2])
    return Channel(
        name=name,
        centre=np.stack([low, high]),
        diameter=np.full(2, diameter),
        slope=np.stack([slope, slope]),
    )


@dataclass(frozen=True, kw_only=True)
class Part(Shown):
    """A solid to be made: a body of revolution about z, less its channels.

    Parameters
    ----------
    name : str
        Name of its files.
    outline : tuple of (z, radius)
        Height and radius [mm] from the lower face to the upper one; two at one height are a step.
    channels : tuple of Channel
        Holes; one that ends below the upper face or above the lower one is blind.
    places : tuple of (x, y, z)
        Where the origin of each copy of the part stands in the assembly [mm].
    """

    name: str
    outline: tuple[tuple[float, float], ...]
    channels: tuple[Channel, ...]
    places: tuple[tuple[float, float, float], ...]

    @property
    def count(self) -> int:
        """How many of it are needed."""
        return len(self.places)

    @property
    def low(self) -> float:
        """Height of the lower face [mm]."""
        return self.outline[0][0]

    @property
    def high(self) -> float:
        """Height of the upper face [mm]."""
        return self.outline[-1][0]

    @cached_property
    def volume(self) -> float:
        """Volume with round walls [mm^3]: exact for straight channels."""
        z, radius = np.array(self.outline).T
        total = math.pi * np.sum(np.diff(z) * radius[1:] ** 2)
        for channel in self.channels:
            area = 0.25 * math.pi * channel.diameter**2 * channel.stretch
            total -= np.sum(np.diff(channel.centre[:, 2]) * 0.5 * (area[1:] + area[:-1]))
        return float(total)

    def check_walls(self, wall: float) -> None:
        """Raise `GeometryError` if a wall, measured across z, is thinner than `wall` [mm].

        A slanted channel counts with the long half-axis of its cut in every direction.
        """
        for channel in self.channels:
            rings, edge = channel.centre[:, 2], np.array(self.outline)
            heights = np.concatenate([rings, edge[:, 0]])
            z, x, y, reach = _sample(channel, rings[0], rings[-1], heights)
            # Where the radius steps the smaller one counts.
            radius = np.minimum(*(np.interp(z + e, *edge.T) for e in (-1e-9, 1e-9)))
            left = radius - np.hypot(x, y) - reach
            self._refuse(left, wall, z, channel.name, "the outside")
            for end, face in ((rings[0], self.low), (rings[-1], self.high)):
                if abs(end - face) > 1e-9:  # it is blind
                    floor = np.array([abs(end - face)])
                    self._refuse(floor, wall, np.array([end]), channel.name, "the end face")
        for one, other in itertools.combinations(self.channels, 2):
            low = max(one.centre[0, 2], other.centre[0, 2])
            high = min(one.centre[-1, 2], other.centre[-1, 2])
            if low >= high:
                continue
            heights = np.unique(np.concatenate([one.centre[:, 2], other.centre[:, 2]]))
            z, x, y, reach = _sample(one, low, high, heights)
            _, u, v, other_reach = _sample(other, low, high, heights)
            left = np.hypot(x - u, y - v) - reach - other_reach
            self._refuse(left, wall, z, one.name, other.name)

    def _refuse(self, left: Floats, wall: float, z: Floats, one: str, other: str) -> None:
        worst = int(np.argmin(left))
        if left[worst] >= wall - 1e-9:
            return
        size = f"{abs(left[worst]):.3g} mm"
        what = f"a wall of {size}" if left[worst] > 0.0 else f"no wall (they overlap by {size})"
        raise GeometryError(
            f"{self.name}: {what} is left between {one} and {other} at z = {z[worst]:.3g} mm: "
            f"at least {wall:g} mm must be"
        )

    def mesh(self, wall: float) -> trimesh.Trimesh:
        """Return the surface as triangles, closed and facing outwards.

        Parameters
        ----------
        wall : float
            Thinnest wall of the part [mm]: on the end faces facets are no longer than that, so that
            the Delaunay triangulation of their corners holds every edge of every hole.

        Raises
        ------
        GeometryError
            If the surface does not close: a wall is thinner than `wall`.
        """
        import trimesh

        outline = np.array(self.outline)
        body = Channel(
            name="outside",
            centre=np.column_stack([np.zeros((len(outline), 2)), outline[:, 0]]),
            diameter=2.0 * outline[:, 1],
            slope=np.zeros((len(outline), 2)),
        )
        points: list[Floats] = []
        triangles: list[Integers] = []
        faces: dict[float, list[Integers]] = {self.low: [], self.high: []}
        start = 0
        for channel in (body, *self.channels):
            rings = _rings(channel, wall)
            index = start + np.arange(rings[..., 0].size).reshape(rings.shape[:2])
            start += index.size
            points.append(rings.reshape(-1, 3))
            sides = _join(index)
            triangles.append(sides if channel is body else sides[:, ::-1])
            for ring, height, end in ((index[0], channel.centre[0, 2], self.low),
                                      (index[-1], channel.centre[-1, 2], self.high)):  # fmt: skip
                if abs(height - end) <= 1e-9:
                    faces[end].append(ring)
                else:
                    fan = np.column_stack([np.full(len(ring) - 2, ring[0]), ring[1:-1], ring[2:]])
                    triangles.append(fan if end == self.low else fan[:, ::-1])
        corners = np.concatenate(points)
        for end, loops in faces.items():
            filled = _fill(corners[:, :2], loops)
            triangles.append(filled if end == self.high else filled[:, ::-1])
        made = trimesh.Trimesh(corners, np.concatenate(triangles), process=False)
        if not made.is_volume:
            raise GeometryError(
                f"{self.name}: its surface does not close with facets of {wall:g} mm: a wall is "
                "thinner than that"
            )
        return made

    def to_dict(self) -> Json:
        """Return what a summary holds of the part."""
        return {
            "name": self.name,
            "count": self.count,
            "places_mm": [list(place) for place in self.places],
            "height_mm": self.high - self.low,
            "diameter_mm": 2.0 * max(radius for _, radius in self.outline),
            "volume_mm3": self.volume,
            "channels": [
                {
                    "name": channel.name,
                    "diameter_mm": float(channel.diameter.min()),
                    "low_mm": channel.centre[0].tolist(),
                    "high_mm": channel.centre[-1].tolist(),
                }
                for channel in self.channels
            ],
        }


def gather_copies(parts: list[Part]) -> list[Part]:
    """Return the parts with those of one shape as one part with many places."""
    kinds: dict[tuple[object, ...], list[Part]] = {}
    for part in parts:
        arrays = [np.array(part.outline)]
        arrays += [np.column_stack([c.centre, c.diameter, c.slope]) for c in part.channels]
        # Adding 0 makes of -0 the same bytes as of 0.
        key = tuple((np.round(array, 8) + 0.0).tobytes() for array in arrays)
        kinds.setdefault(key, []).append(part)
    return [
        replace(copies[0], places=tuple(place for part in copies for place in part.places))
        for copies in kinds.values()
    ]


def _sample(
    channel: Channel, low: float, high: float, heights: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Heights within [low, high], the middle line there, and its reach; both sides of a step."""
    rings = channel.centre[:, 2]
    knots = np.unique(np.clip(heights, low, high))
    parts = np.linspace(0.0, 1.0, SAMPLES)
    parts[[0, -1]] = 1e-9, 1.0 - 1e-9
    z = (knots[:-1, None] + np.diff(knots)[:, None] * parts).ravel()
    x, y, reach = (
        np.interp(z, rings, values)
        for values in (*channel.centre[:, :2].T, 0.5 * channel.diameter * channel.stretch)
    )
    return z, x, y, reach


def cut(channel: Channel, around: Floats) -> Floats:
    """Return where points (k, 2) of the unit circle lie on each cut across z, (n, k, 3) [mm].

    With t the line's direction |v - (v t) t| = r: along the slope v is 1 / cos as long.
    """
    steep = np.sum(channel.slope**2, axis=1)
    longer = (channel.stretch - 1.0) / np.where(steep > 0.0, steep, 1.0)
    along = longer[:, None] * (channel.slope @ around.T)
    points = np.repeat(channel.centre[:, None], len(around), axis=1)
    points[..., :2] += (
        0.5 * channel.diameter[:, None, None]
        * (around + along[..., None] * channel.slope[:, None])
    )  # fmt: skip
    return points


def _rings(channel: Channel, wall: float) -> Floats:
    """Corners (n, k, 3) of a channel's cut at each of its heights."""
    radius = 0.5 * float(channel.diameter.max())
    chord = math.pi / math.acos(max(1.0 - CHORD_ERROR_MM / radius, 0.0))
    longest = 2.0 * math.pi * radius * float(channel.stretch.max()) / wall
    facets = math.ceil(max(LEAST_FACETS, chord, longest))
    angle = 2.0 * math.pi * np.arange(facets) / facets
    return cut(channel, np.column_stack([np.cos(angle), np.sin(angle)]))


def _join(index: Integers) -> Integers:
    """Triangles between rings of corners (rings, k) that face outwards."""
    nextt = np.roll(index, -1, axis=1)
    a, b, c, d = index[:-1], nextt[:-1], nextt[1:], index[1:]
    return np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).reshape(
        -1, 3
    )


def _fill(points: Floats, loops: list[Integers]) -> Integers:
    """Triangles of a flat face that face +z: its first loop less the others.

    The edges of the loops are shorter than the walls between them, so no corner lies in the circle
    over an edge and the Delaunay triangulation holds them all (Gabriel's condition).
    """
    from scipy.spatial import Delaunay

    owner = np.repeat(np.arange(len(loops)), [len(loop) for loop in loops])
    corners = np.concatenate(loops)
    found = Delaunay(points[corners]).simplices
    owners = owner[found]
    inside = (owners[:, 0] > 0) & (owners == owners[:, :1]).all(axis=1)
    found = found[~inside]
    a, b, c = (points[corners[found[:, k]]] for k in range(3))
    turned = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) < (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    found[turned] = found[turned][:, ::-1]
    filled: Integers = corners[found]
    return filled

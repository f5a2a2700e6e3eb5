"""A phantom of the upper gastro-intestinal tract: made by rule, from published dimensions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number, check_points
from ..errors import GeometryError, InputError
from . import _mesh
from ._line import trace_line
from ._parts import HEADINGS, compute_radii, find_fault, plan_legs
from .dimensions import draw_dimensions
from .tract import LabelTract, SurfaceTract

__all__ = ["REGIONS", "Phantom", "make_phantom"]

REGIONS: Mapping[int, str] = MappingProxyType({1: "oesophagus", 2: "stomach", 3: "duodenum"})
"""Label of each part."""

STEP = 2.0
"""Largest distance between samples of the centreline [mm]."""

MAX_DRAWS = 200

_JITTER = 0.08
"""Spread of each component of a heading for seeds other than 0."""


@dataclass(frozen=True, kw_only=True)
class Phantom:
    """A tract as balls strung on a line: the union of all balls is the lumen.

    Attributes
    ----------
    centreline : ndarray, shape (n, 3)
        From the mouth's end of the oesophagus to the end of the duodenum [mm]. Frame: +x to the
        patient's right, +y to the front, +z to the head (RAS+); the origin is the junction of
        oesophagus and stomach.
    radii : ndarray, shape (n,)
        Radius of the ball at each sample, linear between samples [mm].
    region : ndarray of uint8, shape (n,)
        1 oesophagus, 2 stomach, 3 duodenum: the part that starts or goes on at the sample.
    seed : int
    dimensions : mapping of str to float
        What it was made from, by the names in `bozzini.anatomy.dimensions.DIMENSIONS` [mm].
    """

    centreline: NDArray[np.float64]
    radii: NDArray[np.float64]
    region: NDArray[np.uint8]
    seed: int
    dimensions: Mapping[str, float]

    def __post_init__(self) -> None:
        points = check_points("centreline", self.centreline)
        number = len(points)
        if points.ndim != 2 or number < 2:
            raise InputError(f"centreline has shape {points.shape}: it must be (n, 3), n >= 2")
        if np.shape(self.radii) != (number,) or np.shape(self.region) != (number,):
            raise InputError(
                f"radii {np.shape(self.radii)} and region {np.shape(self.region)} must have one "
                f"value for each of the {number} samples of the centreline"
            )
        if not (np.isfinite(self.radii).all() and np.min(self.radii) > 0):
            raise InputError(f"the least radius is {np.min(self.radii):g} mm: it must be above 0")

    @property
    def length(self) -> float:
        """Length of the centreline [mm]."""
        return float(np.linalg.norm(np.diff(self.centreline, axis=0), axis=1).sum())

    def region_lengths(self) -> dict[str, float]:
        """Return the length of each part along the centreline [mm]."""
        pieces = np.linalg.norm(np.diff(self.centreline, axis=0), axis=1)
        return {name: float(pieces[self.region[:-1] == at].sum()) for at, name in REGIONS.items()}

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return ``min(|p - c| - r)`` over all balls on the line, negative inside [mm].

        Outside this is the distance to the wall, exactly. Inside its magnitude is how far the
        deepest ball that holds the point reaches beyond it: never more than the distance to the
        wall, and equal to it where that ball touches the wall next to the point; on the inner
        side of a bend it is smaller.

        Parameters
        ----------
        points : array_like, shape (..., 3)
            World [mm].

        Returns
        -------
        ndarray, shape (...)

        Raises
        ------
        InputError
            If a point is not finite.
        """
        from ._kernels import measure_distance

        array = check_points("points", points)
        flat = np.ascontiguousarray(array.reshape(-1, 3))
        result: NDArray[np.float64] = measure_distance(flat, self.centreline, self.radii)
        return result.reshape(array.shape[:-1])

    def to_labels(self, voxel: float = 1.0) -> LabelTract:
        """Return the phantom as voxels with the labels of `REGIONS`.

        Parameters
        ----------
        voxel : float
            Side of a voxel [mm]. A voxel is lumen if its centre is inside.

        Raises
        ------
        InputError
            If `voxel` is not in [0.5, 4] mm.
        """
        from ._kernels import fill_distance

        voxel = check_number("voxel", voxel, low=0.5, high=4.0, unit="mm")
        origin, shape = self._grid(voxel, 3.0 * voxel)
        _, owner = fill_distance(shape, origin, voxel, self.centreline, self.radii, 0.0)
        label = np.append(self.region[:-1], np.uint8(0)).astype(np.uint16)
        affine = np.diag([voxel, voxel, voxel, 1.0])
        affine[:3, 3] = origin
        return LabelTract(
            labels=label[owner],
            affine=affine,
            source=self._name(),
            label_names=dict(REGIONS),
            organ="upper-tract",
            frame="RAS",
        )

    def to_surface(self, spacing: float = 1.5) -> SurfaceTract:
        """Return the wall as a closed surface, by marching cubes on a grid.

        Parameters
        ----------
        spacing : float
            Distance between the nodes of the grid [mm]. The surface departs from the wall by
            about ``spacing ** 2 / (8 r)`` where the radius is r.

        Raises
        ------
        InputError
            If `spacing` is not in [0.5, 4] mm.
        """
        import skimage.measure

        from ._kernels import fill_distance

        spacing = check_number("spacing", spacing, low=0.5, high=4.0, unit="mm")
        reach = 2.0 * spacing
        origin, shape = self._grid(spacing, reach)
        field, _ = fill_distance(shape, origin, spacing, self.centreline, self.radii, reach)
        tiny = np.float32(1e-3 * spacing)  # a node on the wall would make flat triangles
        field[np.abs(field) < tiny] = tiny
        measure: Any = skimage.measure
        index, faces, _, _ = measure.marching_cubes(field, 0.0)
        vertices = origin + spacing * index.astype(np.float64)
        triangles = faces.astype(np.int64)
        if _mesh.measure_volume(vertices, triangles) < 0:
            triangles = np.ascontiguousarray(triangles[:, ::-1])
        return SurfaceTract(
            vertices=vertices,
            faces=triangles,
            source=self._name(),
            organ="upper-tract",
            frame="RAS",
        )

    def _grid(self, step: float, margin: float) -> tuple[NDArray[np.float64], tuple[int, ...]]:
        reach = self.radii[:, None] + margin
        low = np.floor((self.centreline - reach).min(axis=0) / step)
        high = np.ceil((self.centreline + reach).max(axis=0) / step)
        return low * step, tuple(int(count) for count in high - low + 1)

    def _name(self) -> str:
        return f"phantom (seed {self.seed})"


def make_phantom(*, seed: int = 0) -> Phantom:
    """Make a phantom of oesophagus, stomach and duodenum.

    The line consists of straight pieces and circular bends; the radius changes smoothly along
    it. The oesophagus runs down, the stomach is a J, the duodenum a C out of one plane, in four
    parts. Lengths and diameters are those of `bozzini.anatomy.dimensions.DIMENSIONS`, each with
    its source. What it leaves out: the dome of the fundus above the junction, folds, the
    narrow places of the oesophagus, and that a lumen is not round.

    Parameters
    ----------
    seed : int
        0 is the standard anatomy. Any other draws every dimension evenly from its range and
        tilts every heading a little, and draws again until the phantom is valid: bends wider
        than the lumen by at least 6 mm, and limbs at least 8 mm apart.

    Raises
    ------
    InputError
        If the seed is not a whole number from 0 on.
    GeometryError
        If no draw is valid.
    """
    seed = check_integer("seed", seed, low=0)
    if seed == 0:
        phantom, fault = _build(0, draw_dimensions(None), HEADINGS)
        if fault:
            raise GeometryError(f"the standard phantom is not valid: {fault}")
        return phantom
    random = np.random.default_rng(seed)
    fault = ""
    for _ in range(MAX_DRAWS):
        dimensions = draw_dimensions(random)
        headings = {name: _tilt(heading, random) for name, heading in HEADINGS.items()}
        phantom, fault = _build(seed, dimensions, headings)
        if not fault:
            return phantom
    raise GeometryError(f"seed {seed}: none of {MAX_DRAWS} draws is valid, the last: {fault}")


def _tilt(
    heading: tuple[float, float, float], random: np.random.Generator
) -> tuple[float, float, float]:
    shift = random.uniform(-_JITTER, _JITTER, 3)
    return heading[0] + shift[0], heading[1] + shift[1], heading[2] + shift[2]


def _build(
    seed: int,
    size: Mapping[str, float],
    headings: Mapping[str, tuple[float, float, float]],
) -> tuple[Phantom, str]:
    """Build a phantom from its dimensions; return it and what is wrong with it, or nothing."""
    legs, fault = plan_legs(size, headings)
    points, bends, breaks = trace_line(legs, step=STEP)
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    along *= breaks[-1] / along[-1]  # chords are shorter than arcs, by 1 part in 10^4
    junction, pylorus = breaks[3], breaks[5]
    radii = compute_radii(along, size, float(junction), float(pylorus))
    region = np.where(along < junction - 1e-6, 1, np.where(along < pylorus - 1e-6, 2, 3))
    at = int(np.searchsorted(along, junction - 1e-6))
    phantom = Phantom(
        centreline=points - points[at],
        radii=radii,
        region=region.astype(np.uint8),
        seed=seed,
        dimensions=MappingProxyType(dict(size)),
    )
    return phantom, fault or find_fault(points, radii, bends, along)

"""A cloud of points on the wall as a duct (thesis 5.3.3.3), without making a surface of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_number, show_apart
from ...errors import GeometryError, InputError
from ...numeric.vectors import order_points
from ..base import Duct
from ..checks import (
    check_counts,
    check_places,
    check_size,
    freeze_array,
    freeze_places,
    set_fields,
)

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

# Which places a cloud of wall samples keeps apart: balls about them, by their Delaunay cells.
#
# Balls of one radius about the samples keep two places apart exactly if their tetrahedra are not
# joined through triangles that the balls leave open (Edelsbrunner, Discrete Comput. Geom. 13,
# 1995: the balls' union and its alpha shape have the same complement, up to homotopy). The path
# through a triangle runs between the centres of its tetrahedra's circumspheres, equally far from
# its corners all along. It is nearest to them in the middle of the triangle's own circle, or, where
# a fourth corner lies in the ball of that circle, at one of its ends.

FLAT = 1e-9
"""A cell is flat, a triangle a needle, or a corner on a circle, within this share of its size."""


class Cells(NamedTuple):
    """Delaunay cells of samples, and what joins them.

    Attributes
    ----------
    samples : (n, 3) float
        Where they are [mm].
    corners, neighbours : (m, 4) int
        Samples of each cell, and the cell beyond the side opposite to each, -1 for none.
    centres, radii : (m, 3) and (m,) float
        Of the circumspheres [mm]; infinite for flat cells.
    gates : (g, 2) int
        Cells on both sides of each triangle, -1 for outside the hull.
    widths : (g,) float
        Radius of the largest ball that passes each triangle [mm].
    groups : (m,) int
        Which cells are joined by open triangles; group 0 is joined with the outside.
    """

    samples: NDArray[np.float64]
    corners: NDArray[np.int64]
    neighbours: NDArray[np.int64]
    centres: NDArray[np.float64]
    radii: NDArray[np.float64]
    gates: NDArray[np.int64]
    widths: NDArray[np.float64]
    groups: NDArray[np.int64]


def make_cells(samples: NDArray[np.float64], radius: float) -> Cells:
    """Return the cells of samples (n, 3), not all in a plane, whose balls have `radius` [mm]."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import Delaunay

    delaunay = Delaunay(samples)
    cells = delaunay.simplices.astype(np.int64)
    neighbours = delaunay.neighbors.astype(np.int64)
    centres, radii = _find_spheres(samples, cells)
    gates, widths = _measure_gates(samples, cells, neighbours, radii)
    wide = gates[widths > radius] + 1  # node 0 is the outside
    count = len(cells) + 1
    graph = coo_matrix((np.ones(len(wide), np.int8), (wide[:, 0], wide[:, 1])), (count, count))
    _, label = connected_components(graph, directed=False)
    _, groups = np.unique(np.where(label == label[0], -1, label), return_inverse=True)
    groups = groups.reshape(-1)[1:].astype(np.int64)
    return Cells(samples, cells, neighbours, centres, radii, gates, widths, groups)


def _find_spheres(
    samples: NDArray[np.float64], cells: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return centres (m, 3) and radii (m,) of the circumspheres; infinite for flat cells."""
    a, b, c, d = np.moveaxis(samples[cells], 1, 0)
    b, c, d = b - a, c - a, d - a
    bc, cd, db = np.cross(b, c), np.cross(c, d), np.cross(d, b)
    squares = [np.einsum("ij,ij->i", side, side) for side in (b, c, d)]
    volume = np.einsum("ij,ij->i", b, cd)
    flat = np.abs(volume) <= FLAT * np.max(squares, axis=0) ** 1.5
    top = squares[0][:, None] * cd + squares[1][:, None] * db + squares[2][:, None] * bc
    centre = top / np.where(flat, 1.0, 2.0 * volume)[:, None]
    radii = np.where(flat, np.inf, np.linalg.norm(centre, axis=1))
    return np.where(flat[:, None], np.inf, a + centre), radii


def _measure_gates(
    samples: NDArray[np.float64],
    cells: NDArray[np.int64],
    neighbours: NDArray[np.int64],
    radii: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the cells on both sides of every triangle, and its width."""
    cell, corner = np.nonzero(np.arange(len(cells))[:, None] > neighbours)
    other = neighbours[cell, corner]
    shared = cells[cell[:, None], (corner[:, None] + np.array([1, 2, 3])) % 4]
    a, b, c = np.moveaxis(samples[shared], 1, 0)
    b, c = b - a, c - a
    normal = np.cross(b, c)
    square = np.einsum("ij,ij->i", normal, normal)
    bb, cc = np.einsum("ij,ij->i", b, b), np.einsum("ij,ij->i", c, c)
    thin = square <= (FLAT * np.maximum(bb, cc)) ** 2  # a needle: its circle is not known
    top = bb[:, None] * np.cross(c, normal) + cc[:, None] * np.cross(normal, b)
    middle = top / np.where(thin, 1.0, 2.0 * square)[:, None]
    radius = np.linalg.norm(middle, axis=1)
    middle = middle + a
    outside = other < 0
    # The fourth corners: the one of the cell, and the one of the neighbour that is not shared.
    fourth = cells[cell, corner]
    beyond = np.where(outside, fourth, cells[other].sum(axis=1) - shared.sum(axis=1))
    nearest = np.minimum(
        np.linalg.norm(samples[fourth] - middle, axis=1),
        np.linalg.norm(samples[beyond] - middle, axis=1),
    )
    at_ends = np.minimum(radii[cell], np.where(outside, np.inf, radii[other]))
    empty = (nearest >= radius * (1.0 - FLAT)) & ~thin
    return np.stack([cell, other], axis=1), np.where(empty, radius, at_ends)


def find_cells(cells: Cells, points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the cell (n,) of each point (n, 3), -1 outside the samples' hull."""
    from ..kernels.inside import locate_cells

    found = np.empty(len(points), dtype=np.int64)
    locate_cells(cells.samples, cells.corners, cells.neighbours, points, found)
    return found


def find_opening(cells: Cells, cell: int) -> tuple[float, int]:
    """Return the width of the widest path from a cell to the outside, and its narrowest gate."""
    parent = np.arange(len(cells.groups) + 1)

    def find(k: int) -> int:
        while parent[k] != k:
            parent[k] = parent[parent[k]]
            k = int(parent[k])
        return k

    for gate in np.argsort(-cells.widths):
        a, b = (find(int(k) + 1) for k in cells.gates[gate])
        parent[a] = b
        if find(0) == find(cell + 1):
            return float(cells.widths[gate]), int(gate)
    return 0.0, 0


JITTER_SHARE = 1e-6
"""Samples are moved by this share of the spacing for their Delaunay cells, which are then never
flat; the balls are larger by four times as much."""


@dataclass(frozen=True, eq=False)
class PointCloud(Duct):
    """What samples of a wall enclose for certain.

    Parameters
    ----------
    points : (n, 3) float
        Samples of the wall [mm].
    spacing : float
        No place of the wall is farther than this from a sample [mm].
    seeds : (m, 3) float, optional
        Places inside [mm]: the duct is what is connected with them.
    normals : (n, 3) float, optional
        Outward normals of the wall at the samples, instead of seeds: the duct is all closed
        spaces on whose inner side most samples around them place them.

    Raises
    ------
    InputError
        If neither or both of `seeds` and `normals` are given, or `spacing` is not positive.
    GeometryError
        If a seed is nearer than `spacing` to a sample, or connected with the outside through an
        opening, with where it is and the spacing that closes it; or nothing is enclosed.

    Notes
    -----
    The wall lies somewhere in balls of radius `spacing` about the samples, so these are taken for
    it: inside, the distance is that to the nearest sample less the spacing (and 4e-6 of it). It
    is exact to the balls, and never more than the distance to the wall. Places that the balls do
    not part no wall parts; which these are is found from the samples' Delaunay cells.
    So with seeds nothing is inside that a wall parts from all of them. Normals only name the
    side. `kind` is "bound".

    The wall cannot be moved outwards (`inflation` is 0): how far a place outside is from the lumen
    is not known, only how far from the balls, which have another side.
    """

    points: NDArray[np.float64]
    spacing: float
    seeds: NDArray[np.float64] | None = field(default=None, kw_only=True)
    normals: NDArray[np.float64] | None = field(default=None, kw_only=True)
    inflation: float = field(default=0.0, init=False)
    wall: str = field(default="", init=False)
    wall_error: float | None = field(default=None, init=False)

    name = "cloud"
    unit_kinds = dict.fromkeys(("points", "spacing", "seeds"), "length")
    dim = 3

    def __post_init__(self) -> None:
        points = freeze_places("points", self.points, 3, least=4)
        check_size("spacing", self.spacing)
        if (self.seeds is None) == (self.normals is None):
            given = "both" if self.seeds is not None else "neither"
            raise InputError(f"{given} of seeds and normals are given: it must be one of them")
        wall = f"balls of {self.spacing:g} mm about {len(points)} samples"
        set_fields(self, points=points, wall=wall, wall_error=float(self.spacing))
        if self.seeds is not None:
            set_fields(self, seeds=freeze_places("seeds", self.seeds, 3))
        if self.normals is not None:
            normals = freeze_array("normals", self.normals, (3,))
            check_counts(len(points), {"normals": normals}, per="point")
            set_fields(self, normals=normals)
        extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if extent[-1] <= 1e-9 * extent[0]:
            raise GeometryError(
                f"the {len(points)} points of the cloud lie in a plane: they enclose nothing"
            )
        if not self._lumen.any():
            raise GeometryError(
                f"the cloud encloses nothing with a spacing of {self.spacing:g} mm: its balls "
                f"leave an opening or fill the lumen"
            )

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) corners of the box around the samples [mm]."""
        return np.stack([self.points.min(axis=0), self.points.max(axis=0)])

    @property
    def inflation_max(self) -> float:
        """How far the wall can be moved outwards: not at all [mm]."""
        return 0.0

    def inflate(self, distance: float) -> Self:
        """Return the same duct: its wall cannot be moved outwards.

        Raises
        ------
        InputError
            If `distance` is not 0.
        """
        if check_number("distance", distance, low=0.0, unit="mm") > 0.0:
            raise InputError(
                f"distance is {distance:g} mm: it must be 0 mm, because how far a place outside a "
                "cloud is from its lumen is not known"
            )
        return self

    def signed_distance(self, points: ArrayLike, /) -> NDArray[np.float64]:
        """Return the (...) signed distance at points (..., 3) [mm], negative inside."""
        array = check_places("points", points)
        far, _, inside, order = self._measure(array.reshape(-1, 3))
        value = np.empty(len(far))
        # In a ball the lumen is at least as far as the ball's border.
        value[order] = np.where(inside, self._radius - far, np.abs(far - self._radius))
        return value.reshape(array.shape[:-1])

    def gradient(self, points: ArrayLike, /) -> NDArray[np.float64]:
        """Return the (..., 3) gradient of the signed distance; where it has several, one."""
        array = check_places("points", points)
        flat = array.reshape(-1, 3)
        far, index, inside, order = self._measure(flat)
        away = (flat[order] - self.points[index]) / np.where(far > 0.0, far, 1.0)[:, None]
        falls = inside | (far < self._radius)
        gradient = np.empty_like(flat)
        gradient[order] = np.where(falls[:, None], -away, away)
        return gradient.reshape(array.shape)

    def _measure(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_], NDArray[np.int64]]:
        """Return how far the nearest sample is, which, if inside; and the order of all these."""
        order = order_points(points)
        near = points[order]
        far, index = self._tree.query(near)
        inside = np.asarray(far > self._radius)
        inside[inside] = self._ask(near[inside])
        return far, index, inside, order

    def _ask(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether points farther than `spacing` from all samples are inside.

        It is quick for points that lie near those before and after them.
        """
        low, high = self.bounds
        # Cells are searched with a tolerance that grows with a point's coordinates.
        near = np.flatnonzero(np.all((points >= low) & (points <= high), axis=1))
        cell = find_cells(self._cells, points[near])
        answer = np.zeros(len(points), dtype=bool)
        answer[near] = (cell >= 0) & self._lumen[self._cells.groups[np.maximum(cell, 0)]]
        return answer

    @property
    def _default_voxel(self) -> float:
        return max(float(self.spacing), super()._default_voxel)

    @property
    def _radius(self) -> float:
        return float(self.spacing) * (1.0 + 4.0 * JITTER_SHARE)

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree

        # Half the time of the default tree, for samples of a surface.
        return cKDTree(self.points, leafsize=24, compact_nodes=False)

    @cached_property
    def _cells(self) -> Cells:
        random = np.random.default_rng(len(self.points))
        moved = random.uniform(-1.0, 1.0, self.points.shape) * (JITTER_SHARE * self.spacing)
        # A moved ball of this radius holds that of the spacing, and is in that of `_radius`.
        return make_cells(self.points + moved, self.spacing * (1.0 + 2.0 * JITTER_SHARE))

    @cached_property
    def _lumen(self) -> NDArray[np.bool_]:
        """Which groups of cells are the duct."""
        cells = self._cells
        chosen = np.zeros(int(cells.groups.max()) + 1, dtype=bool)
        if self.seeds is not None:
            self._choose_by_seeds(chosen)
        elif self.normals is not None:
            self._choose_by_normals(self.normals, chosen)
        return chosen

    def _choose_by_seeds(self, chosen: NDArray[np.bool_]) -> None:
        seeds = np.asarray(self.seeds)
        far = self._tree.query(seeds)[0]
        for k, seed in enumerate(seeds):
            where = ", ".join(f"{x:.1f}" for x in seed)
            if far[k] <= self._radius:
                shown = show_apart(far[k], self.spacing, digits=3)
                raise GeometryError(
                    f"seeds[{k}] at ({where}) mm is {shown[0]} mm from a sample: it must be "
                    f"farther than the spacing, {shown[1]} mm"
                )
            cell = int(find_cells(self._cells, seed[None])[0])
            if cell < 0:
                raise GeometryError(f"seeds[{k}] at ({where}) mm lies outside the cloud")
            group = int(self._cells.groups[cell])
            if group == 0:
                width, gate = find_opening(self._cells, cell)
                inner, outer = self._cells.gates[gate]
                corners = self._cells.corners[inner]
                # The triangle's corners: the cell's without the one opposite to it.
                shared = corners[self._cells.neighbours[inner] != outer]
                middle = ", ".join(f"{x:.1f}" for x in self.points[shared].mean(axis=0))
                raise GeometryError(
                    f"seeds[{k}] at ({where}) mm is connected with the outside, through an "
                    f"opening of the samples near ({middle}) mm: the spacing must be at least "
                    f"{width:.4g} mm to close it, it is {self.spacing:g} mm"
                )
            chosen[group] = True

    def _choose_by_normals(self, normals: NDArray[np.float64], chosen: NDArray[np.bool_]) -> None:
        """Let the four samples nearest to each circumsphere's centre vote on its side."""
        cells = self._cells
        corners = cells.corners
        free = np.isfinite(cells.radii) & (cells.radii > self.spacing)
        away = np.where(free[:, None], cells.centres, 0.0)[:, None] - self.points[corners]
        signs = np.sign(-np.einsum("ijk,ijk->ij", normals[corners], away)).sum(axis=1)
        votes = np.bincount(cells.groups, weights=np.where(free, signs, 0.0), minlength=len(chosen))
        chosen[votes > 0.0] = True
        chosen[0] = False

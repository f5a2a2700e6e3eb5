"""Walls that a scope touches in MuJoCo: a prism for each triangle, or a signed-distance penalty.

MuJoCo replaces a mesh by its convex hull, which fills a lumen. Here every triangle of the wall
becomes a convex body of its own, behind the triangle. It is as thick as half of what lies between
the lumen and its neighbour, at most.

The other wall is no body at all: the depth is that by the lumen's own signed distance.

The force is the same for both, a stiffness times the depth at the end of each step
(`bozzini.physics.kernels.contact`): it is stable for any stiffness. MuJoCo's own contact is not
used: what its ``solref`` sets is a stiffness per mass.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..anatomy.tract import LabelTract, SurfaceTract, name_place
from ..duct.base import Duct
from ..errors import GeometryError, InputError
from ..motion.scope import Introducer
from ..numeric.arrays import Floats as Floats
from ..results import Shown
from ..scene.make_view import draw_wall
from .options import WallOptions

NEWTON = 1e3
"""Of the unit of force of a scene in mm, kg and s: mN."""

MARGIN_MM = 0.05
"""What comes this near is looked at before it touches, besides what it moves in two steps [mm]."""

THIN_MM = 0.4
"""A wall between two lumens thinner than this is reported."""

THINNEST_MM = 0.02
"""Prisms are this thick at least: thinner bodies have no volume for MuJoCo."""

FLAT_SHARE = 1e-4
"""Area of a hole over the squares of its edges, up to which it is none."""

_RISE = 0.5  # of the distance by the depth, below which another lumen is near
_SHARE = 0.75  # of the depth where that is so: then half the gap is left
_DEPTHS = 24


@dataclass(frozen=True, kw_only=True, eq=False)
class Prisms:
    """The bodies behind the triangles of a wall.

    Parameters
    ----------
    corners : (m, 6, 3) float
        Of each prism: its triangle, then the same behind it [mm].
    thickness : (m,) float
        The least of each prism [mm].
    inward : float
        How far a simplified triangle stands in the lumen, at most [mm].
    findings : tuple of str
        Where the wall between two lumens is thin, in sentences.
    """

    corners: Floats
    thickness: Floats
    inward: float = 0.0
    findings: tuple[str, ...] = ()


def build_prisms(
    surface: tuple[Floats, NDArray[np.int64]], duct: Duct | None = None, *, thickness: float = 3.0
) -> Prisms:
    """Return a prism behind each triangle of a closed surface.

    A prism goes outwards along the normals of its corners: to `thickness`, but not beyond the
    middle between the lumen and its neighbour.

    Parameters
    ----------
    surface : (n, 3) float, (m, 3) int
        Corners [mm] and triangles, turned outwards.
    duct : Duct, optional
        The lumen, to measure how far triangles stand in it.
    thickness : float
        [mm].

    Raises
    ------
    GeometryError
        If the surface is open.
    """
    import igl

    vertices, faces = surface
    _check_closed(vertices, faces)
    normals = find_normals(vertices, faces)
    depths = thickness / _SHARE * np.arange(1, _DEPTHS + 1) / _DEPTHS
    probes = vertices[:, None] + depths[:, None] * normals[:, None]
    found = igl.signed_distance(
        np.ascontiguousarray(probes.reshape(-1, 3)),
        vertices,
        faces,
        sign_type=igl.SIGNED_DISTANCE_TYPE_FAST_WINDING_NUMBER,
    )
    distance = np.asarray(found[0]).reshape(len(vertices), -1)
    rising = np.logical_and.accumulate(distance >= _RISE * depths, axis=1)
    reach = np.where(rising.any(axis=1), depths[rising.sum(axis=1) - 1], 0.0)
    behind = np.maximum(_SHARE * reach, THINNEST_MM)
    corners = np.concatenate(
        [vertices[faces], (vertices + behind[:, None] * normals)[faces]], axis=1
    )
    least = behind[faces].min(axis=1)
    findings = []
    thin = np.flatnonzero(2.0 * least < THIN_MM)
    if len(thin):
        worst = int(thin[np.argmin(least[thin])])
        findings.append(
            f"the wall between two parts of the lumen is less than {THIN_MM:g} mm thick behind "
            f"{len(thin)} of {len(faces)} triangles, the thinnest near "
            f"{name_place(vertices[faces[worst]].mean(axis=0))} mm: a link may be pressed through "
            "there, which is reported where the voxels show the wall; the penalty wall holds "
            "until the body's axis is in it"
        )
    inward = 0.0
    if duct is not None:
        middles = vertices[faces].mean(axis=1)
        inward = max(0.0, float(-duct.signed_distance(middles).min()))
    return Prisms(corners=corners, thickness=least, inward=inward, findings=tuple(findings))


def find_normals(vertices: Floats, faces: NDArray[np.int64]) -> Floats:
    """Return the normals (n, 3) of vertices, weighted by area; zero where faces cancel out."""
    crosses = np.cross(
        vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
    )
    normals = np.zeros_like(vertices)
    np.add.at(normals, faces.ravel(), np.repeat(crosses, 3, axis=0))
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12))


def _check_closed(vertices: Floats, faces: NDArray[np.int64]) -> None:
    """Raise `GeometryError` if there is a hole that has an area.

    A hole without one is what a flat triangle leaves that was taken away.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, first, counts = np.unique(np.sort(sides, axis=1), axis=0, return_index=True,
                                 return_counts=True)  # fmt: skip
    open_ = sides[first[counts % 2 == 1]]
    if not len(open_):
        return
    graph = coo_matrix((np.ones(len(open_)), open_.T), shape=(len(vertices),) * 2)
    hole = connected_components(graph, directed=False)[1][open_[:, 0]]
    for number in np.unique(hole):
        ends = vertices[open_[hole == number]]
        middle = ends.mean(axis=(0, 1))
        area = 0.5 * np.linalg.norm(np.cross(*np.moveaxis(ends - middle, 1, 0)).sum(axis=0))
        if area > FLAT_SHARE * np.sum((ends[:, 1] - ends[:, 0]) ** 2):
            raise GeometryError(
                f"the wall is open: a hole of {len(ends)} edges near {name_place(middle)} mm; a "
                "wall of prisms must be closed"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class LumenWall(Shown):
    """The wall of a lumen with the introducer before it.

    Parameters
    ----------
    duct : Duct
        The lumen: what containment is measured in, whatever the wall.
    surface : LabelTract, SurfaceTract or Duct, optional
        From which the triangles of a wall of prisms are made; by default the duct.
    introducer : Introducer, optional
        The straight tube before the entry.
    guide : float, optional
        Inner radius of the introducer [mm]; by default its bore.
    options : WallOptions

    Raises
    ------
    InputError
        If the duct is planar; of `prisms`, if the mouth is so wide that no triangle is left.
    """

    duct: Duct
    surface: LabelTract | SurfaceTract | Duct | None = None
    introducer: Introducer | None = None
    guide: float | None = None
    options: WallOptions = WallOptions()

    def __post_init__(self) -> None:
        if self.duct.dim != 3:
            raise InputError("the duct is planar: a simulation needs one in space")

    @cached_property
    def tube(self) -> Floats:
        """The introducer in the duct's own frame, (7,); zeros without one."""
        if self.introducer is None:
            return np.zeros(7)
        packed = self.introducer.pack(self.duct)
        packed[6] = self.bore
        return packed

    @property
    def bore(self) -> float:
        """Inner radius of the introducer [mm]; 0 without one."""
        if self.introducer is None:
            return 0.0
        return self.introducer.bore if self.guide is None else self.guide

    @cached_property
    def prisms(self) -> Prisms:
        """The wall as prisms, open where the introducer comes in."""
        mesh, _ = draw_wall(self.surface or self.duct, most_faces=self.options.faces)
        prisms = build_prisms(
            (mesh.vertices, mesh.faces), self.duct, thickness=self.options.thickness
        )
        if self.introducer is None:
            return prisms
        middles = prisms.corners[:, :3].mean(axis=1) - self.introducer.entry
        along = middles @ self.introducer.outward
        off = np.linalg.norm(middles - along[:, None] * self.introducer.outward, axis=1)
        radius = max(self.options.mouth, self.bore)
        kept = (off > radius) | (along < -radius)
        if not kept.any():
            raise InputError(
                f"mouth is {self.options.mouth:g} mm: it must be less, as no triangle of the wall "
                "is that far from the introducer's axis"
            )
        return Prisms(
            corners=prisms.corners[kept],
            thickness=prisms.thickness[kept],
            inward=prisms.inward,
            findings=prisms.findings,
        )

    def measure(self, points: Floats) -> Floats:
        """Return the (...) clearance of points (..., 3) in lumen or introducer [mm]."""
        return np.asarray(self._measure_both(points).max(axis=0))

    def is_introducer(self, points: Floats) -> NDArray[np.bool_]:
        """Return (...) whether the wall at points (..., 3) is the introducer's, not the lumen's."""
        lumen, tube = self._measure_both(points)
        return np.asarray(tube > lumen)

    def _measure_both(self, points: Floats) -> Floats:
        """Return the (2, ...) clearance in the lumen, and in the introducer [mm]."""
        clear = -self.duct.signed_distance(points)
        if self.introducer is None:
            return np.stack([clear, np.full(clear.shape, -np.inf)])
        way = points - self.introducer.entry
        along = way @ self.introducer.outward
        off = np.linalg.norm(way - along[..., None] * self.introducer.outward, axis=-1)
        return np.stack([clear, np.where(along >= 0.0, self.bore - off, -np.inf)])

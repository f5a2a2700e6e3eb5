"""Shapes for a duct: round cones, connected cylinders or super-ellipsoids in place of its wall."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...anatomy.tract import LabelTract, SurfaceTract
from ...checks import check_integer, check_number, check_word
from ...errors import GeometryError, InputError
from ...progress import Progress, no_progress
from ...results import ReasonedResult, Shown
from ..base import Duct, SampledField
from ..centreline import Centreline, find_centreline
from ..field import build_field, check_tract
from ..shape_files import save_shapes
from ..shapes.cones import RoundCones
from ..shapes.cylinders import ConnectedCylinders
from ..shapes.mesh import TriangleMesh
from ..shapes.super_ellipses import SuperEllipsoids
from .blocks import add_balls, cover_blocks, fit_blocks, shrink_blocks
from .chain import (
    BallChain,
    ChainCones,
    choose_chain,
    fit_cone_chain,
    fit_cylinder_chain,
    inscribe_cylinders,
    measure_edges,
    place_chain,
)
from .measure import (
    ROUND_OFF_MM,
    FitReport,
    Sections,
    cut_sections,
    explain_shortfall,
    find_inner,
    find_outside,
    measure_fit,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# The wall of a tract as a mesh: its triangles, or the faces between lumen voxels and the others.


def mesh_from_tract(tract: LabelTract | SurfaceTract, *, inflation: float = 0.0) -> TriangleMesh:
    """Return the wall of a tract as a mesh, moved outwards by `inflation` [mm]."""
    if isinstance(tract, LabelTract):
        return mesh_from_mask(tract.mask, tract.affine, inflation=inflation)
    return TriangleMesh(tract.vertices, tract.faces, inflation=inflation)


def mesh_from_mask(mask: ArrayLike, affine: ArrayLike, *, inflation: float = 0.0) -> TriangleMesh:
    """Return the mesh of the faces of voxels, whose distance is exact.

    Parameters
    ----------
    mask : (nx, ny, nz) bool
        The lumen.
    affine : (4, 4) float
        Voxel index (the centre of the voxel) to world [mm].
    inflation : float
        The wall is moved outwards by this much [mm].

    Raises
    ------
    GeometryError
        If the lumen is empty.
    """
    lumen = np.pad(np.asarray(mask, dtype=bool), 1)
    matrix = np.asarray(affine, dtype=np.float64)
    if not lumen.any():
        raise GeometryError("the lumen is empty: no voxel is set")
    shape = np.array(lumen.shape) + 1
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        change = np.diff(lumen.astype(np.int8), axis=axis)
        for sign in (1, -1):
            corner = np.argwhere(change == sign)
            corner[:, axis] += 1
            # Corners of the face in order, out of the lumen by the right hand.
            steps = [(0, 0), (1, 0), (1, 1), (0, 1)][::-sign]
            around = []
            for a, b in steps:
                place = corner.copy()
                place[:, u] += a
                place[:, v] += b
                around.append(np.ravel_multi_index(tuple(place.T), tuple(shape)))
            quads.append(np.stack(around, axis=1))
    corners = np.concatenate(quads)
    faces = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    names, numbers = np.unique(faces, return_inverse=True)
    # The pad moved indices by one, a voxel's first corner lies half a voxel before its centre.
    index = np.stack(np.unravel_index(names, tuple(shape)), axis=1) - 1.5
    vertices: NDArray[np.float64] = index @ matrix[:3, :3].T + matrix[:3, 3]
    spacing = np.linalg.norm(matrix[:3, :3], axis=0)
    return TriangleMesh(
        vertices,
        numbers.reshape(-1, 3),
        inflation=inflation,
        wall="faces between lumen voxels and the others",
        wall_error=0.5 * float(np.linalg.norm(spacing)),
    )


Kind = Literal["cones", "cylinders", "superellipsoids"]
KINDS = ("cones", "cylinders", "superellipsoids")
"""What a duct can be fitted as."""

Shapes: TypeAlias = RoundCones | ConnectedCylinders | SuperEllipsoids

PIECES_MAX = 500
ALLOWANCES = (0.8, 0.5, 0.25, 0.0)
"""Shares of the largest error that shapes may take up, tried in turn until it is kept."""

LOSSES = (0.6, 0.35, 0.2)
"""Shares of the largest error that balls of a chain may lose, tried in turn until it is kept."""

LINE_SHARE = 0.8
"""Share of the largest error that super-ellipsoids on the centreline may lose at the places."""

POINTS = 3000
"""Least squares of cones uses about this many wall points."""

WALL_SHARE = 0.3
"""Share of the usual radius by which cones may reach outside before least squares."""

ROUNDS = 12
"""How often blocks are made smaller where they reach outside."""

WALL_PIECES = 20
"""Super-ellipsoids fitted by least squares where no number is given."""


@dataclass(frozen=True, kw_only=True)
class ShapeFitOptions(Shown):
    """How shapes are fitted.

    Parameters
    ----------
    kind : {"cones", "cylinders", "superellipsoids"}
        Round cones are hulls of balls that touch the wall. Cylinders join circles across the
        centreline. Super-ellipsoids are placed wherever in the lumen they are largest, after
        enough of them cover the centreline.
    max_error : float
        How far outside the true lumen a point of the fitted one may be [mm].
    pieces : int, optional
        How many shapes at most, losing as little clearance as they can. By default few that lose
        no more than `max_error` of the clearance on the centreline (of cones the fewest);
        super-ellipsoids are added to these until one more would add less than 0.3 % of the volume.
    inside : bool
        Keep the shapes inside. If not, the wall is fitted by least squares of distances (cones:
        to the chain; cylinders: circles in their sections; super-ellipsoids: on rays, one for
        each stretch of equal length, 20 where `pieces` is not given), and crosses the true
        one: for looking at, not for planning.

    Raises
    ------
    InputError
        If an option is not legal.
    """

    kind: Kind = "cones"
    max_error: float = 1.0
    pieces: int | None = None
    inside: bool = True

    def __post_init__(self) -> None:
        check_word("kind", self.kind, KINDS)
        check_number("max error", self.max_error, low=0.0, low_open=True, unit="mm")
        if self.pieces is not None:
            check_integer("pieces", self.pieces, low=1, high=PIECES_MAX)


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedDuct(ReasonedResult):
    """A duct made of shapes, and what they keep of the true one.

    Attributes
    ----------
    duct : RoundCones, ConnectedCylinders or SuperEllipsoids
        Its `wall_error` is how far it may reach outside the true wall: what is proved of the
        fit, and the true duct's own. Inside the wall it may be much farther away.
    options : ShapeFitOptions
    report : FitReport
    converged : bool
        Whether it is proved that no point of the fitted lumen is farther outside than
        `max_error`, and, where the number of pieces was free, that no more clearance than that is
        lost on the centreline.
    reason : str
        What was not reached; empty if all was.
    """

    duct: Shapes
    options: ShapeFitOptions
    report: FitReport
    reason: str

    @property
    def residual(self) -> float:
        """How far no point of the fitted lumen lies outside the true one, proved [mm]."""
        return self.report.outside_bound

    def save(self, path: str | os.PathLike[str], *, note: str = "", force: bool = False) -> Path:
        """Write the shapes to a file, and how they were fitted: see `bozzini.duct.save`."""
        fit = "inscribed" if self.options.inside else "least squares"
        return save_shapes(self.duct, path, fit=fit, note=note, force=force)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the fitted duct and return the axes."""
        return self.duct.plot(ax)


def fit(
    source: LabelTract | SurfaceTract | Duct,
    kind: Kind = "cones",
    *,
    centreline: Centreline | None = None,
    max_error: float = 1.0,
    pieces: int | None = None,
    inside: bool = True,
) -> FittedDuct:
    """Fit shapes to a tract or a duct along its centreline, and measure what they keep.

    Parameters
    ----------
    source : LabelTract, SurfaceTract or Duct
        The true lumen, of three dimensions. Of a tract its own wall counts, triangles or faces of
        voxels, of which more is proved than of a field sampled from it.
    kind, max_error, pieces, inside
        See `ShapeFitOptions`.
    centreline : Centreline, optional
        Inside it; by default found in the sampled lumen.

    Raises
    ------
    InputError
        If an argument is not legal.
    GeometryError
        If so few shapes cannot follow the centreline, or there is no proved clearance on it.
    """
    options = ShapeFitOptions(kind=kind, max_error=max_error, pieces=pieces, inside=inside)
    if isinstance(source, Duct):
        duct: Duct = source
        draft = source if isinstance(source, SampledField) else None
    else:
        check_tract("source", source, legal="a LabelTract, a SurfaceTract or a Duct")
        duct, draft = mesh_from_tract(source), build_field(source)
    if centreline is None:
        field = duct.sample() if draft is None else draft
        if not isinstance(field, SampledField):
            raise InputError("the duct has 2 dimensions: it must have 3")
        centreline = find_centreline(field)
    return fit_duct(duct, centreline, options, draft=draft)


def fit_duct(
    duct: Duct,
    centreline: Centreline,
    options: ShapeFitOptions,
    *,
    draft: Duct | None = None,
    progress: Progress = no_progress,
) -> FittedDuct:
    """Fit shapes to a duct along its centreline, as `fit`.

    Parameters
    ----------
    duct : Duct
        The true one, of three dimensions.
    centreline : Centreline
        Inside it.
    options : ShapeFitOptions
    draft : Duct, optional
        The same duct as a sampled field, where many points are asked for super-ellipsoids.
    """
    if duct.dim != 3:
        raise InputError("the duct has 2 dimensions: it must have 3")
    cuts = cut_sections(duct, centreline)
    job = _Job(duct, duct if draft is None else draft, centreline, cuts, options, progress)
    if not options.inside:
        shapes = job.fit_wall()
    elif options.kind == "superellipsoids":
        shapes = job.inscribe_blocks()
    else:
        shapes = job.inscribe_chain()
    report = measure_fit(
        shapes,
        duct,
        centreline,
        max_error=options.max_error if options.inside else 0.0,
        sections=cuts,
        progress=progress,
    )
    shapes = replace(
        shapes,
        wall=f"{shapes.wall}; fitted to {duct.wall}",
        wall_error=report.outside_bound + (duct.wall_error or 0.0),
    )
    if isinstance(shapes, SuperEllipsoids):
        shapes = replace(shapes, connected=True)  # which is checked here, once
    reason = explain_shortfall(report, options.max_error, free=options.pieces is None)
    return FittedDuct(duct=shapes, options=options, report=report, reason=reason)


@dataclass(frozen=True)
class _Job:
    """A fit: the duct, the same for many points, its centreline and sections, the options."""

    duct: Duct
    draft: Duct
    centreline: Centreline
    cuts: Sections
    options: ShapeFitOptions
    progress: Progress

    def inscribe_chain(self) -> Shapes:
        """Return cones or cylinders inside the duct."""
        chain = place_chain(self.duct, self.centreline)
        for share in ALLOWANCES:
            allowance = share * self.options.max_error
            shapes = self._join(chain, self._measure_edges(chain, allowance), allowance)
            highest = find_outside(shapes, self.duct, max_error=self.options.max_error)
            found = highest.value if self.duct.kind == "sampled" else highest.bound
            if found <= self.options.max_error:
                break
        return shapes

    def inscribe_blocks(self) -> Shapes:
        """Return super-ellipsoids inside the duct."""
        max_error = self.options.max_error
        shapes = cover_blocks(
            self.draft,
            place_chain(self.duct, self.centreline),
            pieces=self.options.pieces,
            max_loss=LINE_SHARE * max_error,
            allowance=0.5 * max_error,
            progress=self.progress,
        )
        for _ in range(ROUNDS):
            highest = find_outside(shapes, self.duct, max_error=0.9 * max_error)
            if len(highest.places) == 0:
                break
            shapes = shrink_blocks(shapes, highest.places)
        if self.options.pieces is not None:
            return shapes
        # Between the places asked for, and of blocks made smaller, more may be lost.
        clearance = -self.duct.signed_distance(self.cuts.centres)
        inner = find_inner(self.cuts.arc_length, clearance)
        return add_balls(
            shapes, self.duct, self.cuts.centres[inner], clearance[inner], max_loss=max_error
        )

    def fit_wall(self) -> Shapes:
        """Return shapes fitted to the wall by least squares."""
        pieces = self.options.pieces
        if self.options.kind == "superellipsoids":
            pieces = WALL_PIECES if pieces is None else pieces
            return fit_blocks(self.cuts, pieces, progress=self.progress)
        chain = place_chain(self.duct, self.centreline)
        # Least squares moves the wall anyhow: there need not be so many that cones stay inside.
        allowance = max(self.options.max_error, WALL_SHARE * float(np.median(chain.radii)))
        places = self._choose(self._measure_edges(chain, allowance), chain)
        if self.options.kind == "cones":
            wall = self.cuts.wall.reshape(-1, 3)
            wall = wall[:: max(1, len(wall) // POINTS)]
            return fit_cone_chain(wall, chain.centres[places], chain.radii[places])
        stations = chain.arc_length[places]
        walls = cut_sections(self.duct, self.centreline, stations=stations).wall
        return fit_cylinder_chain(chain, places, walls)

    def _measure_edges(self, chain: BallChain, allowance: float) -> ChainCones:
        return measure_edges(
            self.duct,
            chain,
            allowance=allowance,
            cylinders=self.options.kind == "cylinders",
            progress=self.progress,
        )

    def _choose(self, edges: ChainCones, chain: BallChain, share: float = 1.0) -> list[int]:
        max_loss = share * self.options.max_error
        return choose_chain(edges, len(chain.radii), max_loss=max_loss, pieces=self.options.pieces)[
            0
        ]

    def _join(self, chain: BallChain, edges: ChainCones, allowance: float) -> Shapes:
        """Return cones or cylinders; maybe more, as between the places more may be lost."""
        shapes = self._inscribe(chain, self._choose(edges, chain), allowance)
        if self.options.pieces is not None:
            return shapes
        for share in LOSSES:
            if self._lose(shapes) <= self.options.max_error + ROUND_OFF_MM:
                break
            try:
                places = self._choose(edges, chain, share)
            except GeometryError:  # no chain loses so little
                break
            shapes = self._inscribe(chain, places, allowance)
        return shapes

    def _inscribe(self, chain: BallChain, places: list[int], allowance: float) -> Shapes:
        if self.options.kind == "cones":
            return RoundCones(chain.centres[places], chain.radii[places])
        return inscribe_cylinders(self.duct, chain, places, allowance=allowance)

    def _lose(self, shapes: Shapes) -> float:
        """Return the most clearance that is lost on the centreline, off its ends [mm]."""
        centres = self.cuts.centres
        clearance = -self.duct.signed_distance(centres)
        loss = clearance + shapes.signed_distance(centres)
        return float(loss[find_inner(self.cuts.arc_length, clearance)].max())

"""Shapes for a duct: round cones, connected cylinders or super-ellipsoids in place of its wall."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_integer, check_number
from ...errors import GeometryError, InputError
from ...progress import Progress, no_progress
from ..base import Duct
from ..centreline import Centreline
from ..shape_files import count_pieces
from ..shapes.cones import RoundCones
from ..shapes.cylinders import ConnectedCylinders
from ..shapes.mesh import TriangleMesh
from ..shapes.super_ellipses import SuperEllipsoids
from .blocks import Chain, Edges, choose_chain, measure_edges, place_chain
from .measure import (
    FitReport,
    Sections,
    cut_sections,
    explain_shortfall,
    find_inner,
    find_outside,
    measure_fit,
)

# The wall of a label volume as a mesh: the faces between lumen voxels and the others.


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


KINDS = ("cones", "cylinders", "superellipsoids")
"""What a duct can be fitted as."""

Shapes = RoundCones | ConnectedCylinders | SuperEllipsoids

PIECES_MAX = 500
ALLOWANCES = (0.8, 0.5, 0.25, 0.0)
"""Shares of the largest error that shapes may take up, tried in turn until it is kept."""

LOSSES = (0.6, 0.35, 0.2)
"""Shares of the largest error that cylinders' balls may lose, tried in turn until it is kept."""

WAY = 0.8
"""Share of the largest error that super-ellipsoids on the way may lose at the places of a chain."""

POINTS = 3000
"""Least squares of cones uses about this many wall points."""

WALL_SHARE = 0.3
"""Share of the usual radius by which cones may reach outside before least squares."""

ROUNDS = 12
"""How often blocks are drawn in where they reach outside."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedDuct:
    """A duct made of shapes, and what they keep of the true one.

    Attributes
    ----------
    duct : RoundCones, ConnectedCylinders or SuperEllipsoids
        Its `wall_error` is how far it may reach outside the true wall: what is proved of the
        fit, and the true duct's own. Inside the wall it may be much farther away.
    kind : str
        One of `KINDS`.
    inside : bool
        Whether the shapes were to stay inside the wall.
    max_error : float
        How far they were allowed outside [mm].
    report : FitReport
    reached : bool
        Whether it is proved that no point of the fitted lumen is farther outside than
        `max_error`, and, where the number of pieces was free, that no more room than that is lost
        on the centreline.
    reason : str
        What was not reached; empty if all was.
    """

    duct: Shapes
    kind: str
    inside: bool
    max_error: float
    report: FitReport
    reached: bool
    reason: str


def fit_duct(
    duct: Duct,
    centreline: Centreline,
    kind: str,
    *,
    max_error: float = 1.0,
    pieces: int | None = None,
    inside: bool = True,
    draft: Duct | None = None,
    progress: Progress = no_progress,
) -> FittedDuct:
    """Fit shapes to a duct along its centreline, and measure what they keep.

    Parameters
    ----------
    duct : Duct
        The true one, of three dimensions. Of a mesh (`TriangleMesh`) more is proved than of a
        field sampled from it.
    centreline : Centreline
        Inside it.
    kind : {"cones", "cylinders", "superellipsoids"}
        Round cones are hulls of balls that touch the wall. Cylinders join circles across the
        centreline. Super-ellipsoids are placed wherever in the lumen they are largest, after
        enough of them cover the way.
    max_error : float
        How far outside the true lumen a point of the fitted one may be [mm].
    pieces : int, optional
        How many shapes at most, losing as little room as they can. By default few that lose no
        more than `max_error` of the room that there is on the centreline (of cones the fewest);
        super-ellipsoids are added to these until one more would add less than 0.3 % of the volume.
    inside : bool
        Keep the shapes inside. If not, the wall is fitted by least squares of distances (cones:
        to the chain; cylinders: circles in their sections; super-ellipsoids: on rays, one for
        each stretch of equal length, 20 where `pieces` does not say), and goes through the true
        one: for looking at, not for planning.
    draft : Duct, optional
        The same duct as a sampled field, where many points are asked for super-ellipsoids.

    Raises
    ------
    InputError
        If an argument is not legal.
    GeometryError
        If so few shapes cannot go along the centreline, or there is no proved room on it.
    """
    if kind not in KINDS:
        raise InputError(f"kind is '{kind}': it must be one of {', '.join(KINDS)}")
    check_number("max error", max_error, low=0.0, low_open=True, unit="mm")
    if pieces is not None:
        check_integer("pieces", pieces, low=1, high=PIECES_MAX)
    if duct.dim != 3:
        raise InputError("the duct has 2 dimensions: it must have 3")
    cuts = cut_sections(duct, centreline)
    if not inside:
        shapes = _fit_wall(duct, centreline, kind, cuts, max_error, pieces, progress)
    elif kind == "superellipsoids":
        shapes = _inscribe_blocks(duct, centreline, cuts, max_error, pieces, draft, progress)
    else:
        shapes = _inscribe_chain(duct, centreline, kind, max_error, pieces, progress)
    report = measure_fit(
        shapes,
        duct,
        centreline,
        pieces=count_pieces(shapes),
        max_error=max_error if inside else 0.0,
        sections=cuts,
        progress=progress,
    )
    told: dict[str, Any] = {
        "wall": f"{shapes.wall}; fitted to {duct.wall}",
        "wall_error": report.outside_bound + (duct.wall_error or 0.0),
    }
    if kind == "superellipsoids":
        told["connected"] = True  # that they hang together is asked here, once
    shapes = replace(shapes, **told)
    reason = explain_shortfall(report, max_error, free=pieces is None)
    return FittedDuct(
        duct=shapes,
        kind=kind,
        inside=inside,
        max_error=max_error,
        report=report,
        reached=not reason,
        reason=reason,
    )


def _inscribe_chain(
    duct: Duct,
    centreline: Centreline,
    kind: str,
    max_error: float,
    pieces: int | None,
    progress: Progress,
) -> Shapes:
    chain = place_chain(duct, centreline)
    for share in ALLOWANCES:
        allowance = share * max_error
        edges = measure_edges(
            duct, chain, allowance=allowance, cylinders=kind == "cylinders", progress=progress
        )
        if kind == "cones":
            places, _ = choose_chain(edges, len(chain.radii), max_loss=max_error, pieces=pieces)
            shapes: Shapes = RoundCones(chain.centres[places], chain.radii[places])
        else:
            shapes = _join_circles(duct, chain, edges, allowance, max_error, pieces)
        highest = find_outside(shapes, duct, max_error=max_error)
        if (highest.value if duct.kind == "sampled" else highest.bound) <= max_error:
            break
    return shapes


def _join_circles(
    duct: Duct, chain: Chain, edges: Edges, allowance: float, max_error: float, pieces: int | None
) -> Shapes:
    """Return cylinders; as circles that lean on each other leave less room, maybe more of them."""
    from .tubes import inscribe_cylinders

    places, _ = choose_chain(edges, len(chain.radii), max_loss=max_error, pieces=pieces)
    shapes = inscribe_cylinders(duct, chain, places, allowance=allowance)
    if pieces is not None:
        return shapes
    for part in LOSSES:
        if _lost(shapes, duct, chain) <= max_error:
            break
        try:
            places, _ = choose_chain(
                edges, len(chain.radii), max_loss=part * max_error, pieces=None
            )
        except GeometryError:  # no chain loses so little
            break
        shapes = inscribe_cylinders(duct, chain, places, allowance=allowance)
    return shapes


def _lost(shapes: Shapes, duct: Duct, chain: Chain) -> float:
    """Return the most room that is lost on the centreline, off its ends [mm]."""
    room = -duct.signed_distance(chain.centres)
    loss = room + shapes.signed_distance(chain.centres)
    return float(loss[find_inner(chain.arc_length, room)].max())


def _inscribe_blocks(
    duct: Duct,
    centreline: Centreline,
    cuts: Sections,
    max_error: float,
    pieces: int | None,
    draft: Duct | None,
    progress: Progress,
) -> Shapes:
    from .blocks import add_balls, cover_blocks, shrink_blocks

    shapes = cover_blocks(
        duct if draft is None else draft,
        place_chain(duct, centreline),
        pieces=pieces,
        max_loss=WAY * max_error,
        allowance=0.5 * max_error,
        progress=progress,
    )
    for _ in range(ROUNDS):
        highest = find_outside(shapes, duct, max_error=0.9 * max_error)
        if len(highest.places) == 0:
            break
        shapes = shrink_blocks(shapes, highest.places)
    if pieces is not None:
        return shapes
    # Between the places asked for, and of blocks drawn in, more may be lost.
    room = -duct.signed_distance(cuts.centres)
    inner = find_inner(cuts.arc_length, room)
    return add_balls(shapes, duct, cuts.centres[inner], room[inner], max_loss=max_error)


def _fit_wall(
    duct: Duct,
    centreline: Centreline,
    kind: str,
    cuts: Sections,
    max_error: float,
    pieces: int | None,
    progress: Progress,
) -> Shapes:
    from .blocks import fit_blocks
    from .tubes import fit_cone_chain, fit_cylinder_chain

    if kind == "superellipsoids":
        return fit_blocks(cuts, 20 if pieces is None else pieces, progress=progress)
    chain = place_chain(duct, centreline)
    # Least squares moves the wall anyhow: the places need not be so many that cones stay inside.
    allowance = max(max_error, WALL_SHARE * float(np.median(chain.radii)))
    edges = measure_edges(
        duct, chain, allowance=allowance, cylinders=kind == "cylinders", progress=progress
    )
    places, _ = choose_chain(edges, len(chain.radii), max_loss=max_error, pieces=pieces)
    if kind == "cones":
        wall = cuts.wall.reshape(-1, 3)
        wall = wall[:: max(1, len(wall) // POINTS)]
        return fit_cone_chain(wall, chain.centres[places], chain.radii[places])
    walls = cut_sections(duct, centreline, stations=chain.arc_length[places]).wall
    return fit_cylinder_chain(chain, places, walls)

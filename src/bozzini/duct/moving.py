"""A lumen that moves: the distance to its wall near a path, anew in every frame.

A deformation phi of the lumen, one to one and smooth, takes a place x with distance d to the wall
at rest to a place whose distance to the moved wall is at least the integral of the least singular
value of D phi from 0 to d: a way from x to the wall crosses all radii below d about x, and each
part of it is shortened by no more than that value. With ``|D^2 phi| <= H`` this is at least
``s d - H d^2 / 2`` (``s^2 / 2 H`` where d exceeds s / H), s being the least singular value at x;
``(1 - e) d`` is a bound, too, where ``|D u| <= e`` for the displacement u. Where neither decides
whether a body fits, the distance to the moved triangles is measured.

Every node is then a lower bound of its distance or exact, or 0. The certificate takes such a
field: the squared distance less ``|x|^2`` is concave, so values at most as large as the distances
give an interpolant that is at most as large, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number, check_points, show_apart
from ..errors import DeformationError, InputError
from ..numeric.arrays import Floats
from ..numeric.polylines import resample_polyline
from .base import NODES_MAX, SampledField
from .checks import set_fields
from .deformation import Displacement, displace, measure_displacement, name_place, trace

if TYPE_CHECKING:
    from ..anatomy.tract import SurfaceTract
    from .kernels.nearest import Tree


REACH_MM, REACH_CELLS = 3.0, 1.5
"""Nodes within so much of the path, and so many cells more, are known; others count as wall [mm].

Wider bands certify more where joints stray from the path, and cost more.
"""

SPACING_MM = 1.0
"""The path's points are so far apart when nodes near it are looked for [mm]."""

SIDES = (4, 2, 1)
"""Nodes of a block along each axis: the first that keeps to `MISS_MM`, or the last."""

MISS_MM = 0.1
"""So far may the deformation be from linear in a block [mm]."""

TRACED_MM = 0.25
"""The middle of a block is traced back until its tissue is within so much of it [mm]."""

PROBE_MM = 0.25
"""Gradients are central differences over so much to both sides [mm]."""

LOOKED_PLACES, LOOKED_TURNS = 48, 3
"""At so many places the largest derivatives along any line are sought, in so many turns."""

EXCESS_MM = 1e-6
"""So far may a vertex be from where the displacement takes it, by rounding [mm]."""

EXCESS = 1e-6
"""So much may a gradient be above its bound, by rounding."""

SHARES = 16
"""Into how many shares the nodes to be measured are divided for the processors."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MovedField(SampledField):
    """The distance to a moved wall in a band around a path; 0 farther away, as if wall.

    Nodes are lower bounds of the distance, or exact; see `MovingField.update`.

    Parameters
    ----------
    band : int
        Nodes in the band.
    measured : int
        Nodes of them whose distance to the moved wall was measured.
    largest : float
        The largest distance stored [mm].
    """

    band: int = 0
    measured: int = 0
    largest: float = 0.0

    def __post_init__(self) -> None:
        # The grid is made by this module: looking at all of it would take as long as filling it.
        set_fields(self, _rounding=self.largest * 2.0**-23)


class MovingField:
    """A sampled lumen that is deformed anew in every frame.

    Parameters
    ----------
    field : SampledField
        Of the tract at rest, not inflated.
    surface : SurfaceTract, optional
        What `field` was made of. With it distances to the moved triangles are measured where the
        bound does not decide; without it, as for labels, the bound stands alone.

    Raises
    ------
    InputError
        If the field is inflated, or is not of the surface.
    """

    def __init__(self, field: SampledField, surface: SurfaceTract | None = None) -> None:
        if not isinstance(field, SampledField):
            raise InputError(f"the field is a {type(field).__name__}: it must be a SampledField")
        if field.inflation != 0.0:
            raise InputError(
                f"the field is inflated by {field.inflation:g} mm: a wall that moves must be at "
                "0 mm"
            )
        from ..anatomy.tract import SurfaceTract

        if not (surface is None or isinstance(surface, SurfaceTract)):
            raise InputError(
                f"the surface is a {type(surface).__name__}: it must be a SurfaceTract, or left out"
            )
        self.field = field
        self.surface = surface
        self._wall = None if surface is None else _MovingWall(field, surface)
        self._seeds = np.zeros(field.values.shape if self._wall else (1, 1, 1), dtype=np.int32)

    def update(
        self,
        displacement: Displacement | None = None,
        *,
        vertices: ArrayLike | None = None,
        gradient_bound: float | None = None,
        second_bound: float | None = None,
        path: ArrayLike,
        radius: float,
    ) -> MovedField:
        """Return the distance to the wall as it is now, near a path.

        With a displacement most nodes take the bound of their distance, and few are measured; with
        vertices alone all in the moved surface are measured, which takes about twice as long.

        Parameters
        ----------
        displacement : callable, optional
            Takes places (n, 3) of tissue at rest to its displacement (n, 3), world frame [mm].
        vertices : (v, 3) float, optional
            Where the surface's vertices are now, world frame [mm]. Beside a displacement every one
            is compared with it.
        gradient_bound : float, optional
            The largest singular value of the displacement's gradient, in [0, 1); below 1 the
            deformation is one to one. With vertices alone it is not needed, but checked if given.
        second_bound : float, optional
            The largest second derivative along any line [1/mm]. Vertices alone make no use of it.
        path : (n, 3) float
            As it is now, world frame [mm]. Nodes within 3 mm and one and a half cells are known.
        radius : float
            Of the body [mm]: nodes are measured where the bound does not decide for it.

        Returns
        -------
        MovedField
            No value is above the distance to the moved triangles, or without a surface to the
            deformed wall.

        Raises
        ------
        DeformationError
            If the frame breaks its bounds, or its vertices are not displaced as stated.
        InputError
            If an argument is out of range, or what is needed is not given.

        Notes
        -----
        Where a node is not measured, its value needs both bounds to hold at certain places at
        rest. Its tissue is at x there, d from the wall, and the middle of its block of at most
        4 x 4 x 4 nodes at m:

        - in the ball of radius d around x, which lies in the lumen;
        - on the line from x to m, and 0.25 mm around m;
        - on the triangles of the wall that are nearest to the band once they have moved;

        and the deformation to be one to one in the closed lumen. All of it follows if the bounds
        hold in the convex hull of the lumen at rest and of the places m, and 0.25 mm around it.

        Verified in every frame: the gradient bound on all sides of all triangles, and both bounds
        by differences around the places m, along the axes, and for the 48 largest along the line
        on which they are largest. Trusted: both bounds between those places, and that the lumen
        does not come to overlap itself. Nodes that are measured need all this only to be on the
        right side of the wall, and with vertices alone not even for that.
        """
        from .kernels.moving import CAP, measure_nodes

        way, field = check_points("path", path), self.field
        if way.ndim != 2 or len(way) < 2:
            raise InputError(f"path has shape {way.shape}: it must be (n, 3) with at least 2 rows")
        span = np.ptp(field.to_grid(way), axis=0) + 2.0 * REACH_MM
        if np.prod(span / field.spacing + 2.0 * REACH_CELLS) > NODES_MAX:
            raise InputError(
                f"path spans {span.max():.3g} mm: the band would have more than {NODES_MAX:.0e} "
                f"nodes of {field.spacing.max():g} mm"
            )
        radius = check_number("radius", radius, low=0.0, high=1e3, unit="mm")
        gradient = self._check(displacement, vertices, gradient_bound, second_bound)
        bend = check_number("second bound", second_bound or 0.0, low=0.0, high=1e3, unit="1/mm")
        wall = self._wall
        if wall is not None:
            wall.move(displacement, vertices, gradient)
        band = _Band(field, way, bend)
        if displacement is None:
            largest, wanted, places = 0.0, *self._list_inside(band)
        else:
            largest, wanted, places = self._bound(displacement, band, radius, gradient, bend)
        if wall is not None:
            measure_nodes(
                wall.tree, band.nodes, wanted, band.low, field.spacing, radius + CAP,
                places, self._seeds, band.values, SHARES,
            )  # fmt: skip
        return MovedField(
            values=band.values,
            spacing=field.spacing,
            origin=field.to_world(band.low * field.spacing),
            rotation=field.rotation,
            wall=f"{field.wall}, moved",
            wall_error=field.wall_error,
            exact_outside=False,
            frame=field.frame,
            band=len(band.nodes),
            measured=len(wanted),
            largest=max(radius + CAP, largest),
        )

    def _check(
        self,
        displacement: Displacement | None,
        vertices: ArrayLike | None,
        gradient: float | None,
        bend: float | None,
    ) -> float:
        """Return the gradient's bound, infinite if none is needed, or raise `InputError`."""
        if not (displacement is None or callable(displacement)):
            raise InputError(
                f"the displacement is a {type(displacement).__name__}: it must be a function of "
                "places"
            )
        if displacement is None and vertices is None:
            raise InputError("nothing was given that moves: give a displacement or vertices")
        if vertices is not None and self._wall is None:
            raise InputError(
                "vertices were given, but the field has no surface: give a displacement"
            )
        if displacement is not None and (gradient is None or bend is None):
            raise InputError("a displacement was given: give its gradient_bound and second_bound")
        if gradient is None:
            return np.inf
        return check_number("gradient bound", gradient, low=0.0, high=0.999)

    def _bound(
        self,
        displacement: Displacement,
        band: _Band,
        radius: float,
        gradient: float,
        bend: float,
    ) -> tuple[float, NDArray[np.int64], NDArray[np.int32]]:
        """Store bounds; return the largest, the nodes to be measured, and where each is at rest."""
        from .kernels.moving import bound_nodes, store_nodes

        wall, field, count = self._wall, self.field, len(band.nodes)
        facet = 0.0 if wall is None else bend * wall.side**2 / 6.0
        middles = self._look_around(displacement, band.middles, gradient, bend)
        places, bounds = np.empty((count, 3), dtype=np.int32), np.empty(count)
        kinds, wanted = np.empty(count, dtype=np.uint8), np.empty(count, dtype=np.int64)
        cell = float(field.spacing.max())
        limits = np.array([radius, facet, field.error, cell, float(wall is not None)])
        data = field.pack()
        bound_nodes(data, middles, band.nodes, band.blocks, band.low, limits, places, bounds, kinds)
        measured = int(store_nodes(band.nodes, bounds, kinds, band.values, wanted))
        return float(bounds.max(initial=0.0)), wanted[:measured], places

    def _list_inside(self, band: _Band) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        """Return the band's nodes in the moved surface, and the reference field's next to each."""
        from .field import MeshWall
        from .kernels.nearest import INSIDE

        wall, field = self._wall, self.field
        flags = np.zeros(band.values.shape, dtype=np.uint8)
        if wall is not None:
            mesh = MeshWall(wall.places, wall.surface.faces)
            mesh.flag_inside(flags, band.low * field.spacing, field.spacing)
        inside = flags[tuple(band.nodes.T)] & INSIDE != 0
        places = np.clip(band.nodes + band.low, 0, np.array(field.values.shape) - 1)
        return np.flatnonzero(inside), places.astype(np.int32)

    def _look_around(
        self, displacement: Displacement, targets: Floats, gradient: float, bend: float
    ) -> Floats:
        """Return the deformation near places (b, 3) of the grid's frame, as kernels take it."""
        from .kernels.moving import describe_middles

        field, turn = self.field, self.field.rotation
        rest, _ = trace(field.to_world(targets), displacement, within=TRACED_MM)
        probes = np.concatenate([np.zeros((1, 3)), PROBE_MM * turn.T, -PROBE_MM * turn.T])
        moves = measure_displacement(displacement, (rest[None] + probes[:, None]).reshape(-1, 3))
        moves = (moves @ turn).reshape(7, len(rest), 3)
        middles = np.empty((len(rest), 19))
        found = describe_middles(field.to_grid(rest), moves, PROBE_MM, gradient, bend, middles)
        steep = self._find_steep(displacement, rest, moves)
        curved = self._find_curved(displacement, rest, moves)
        for what, value, limit, unit, which in (
            ("gradient", found[0], gradient, "", int(found[1])),
            ("gradient", steep[0], gradient, "", steep[1]),
            ("second derivative", found[2], bend, " 1/mm", int(found[3])),
            ("second derivative", curved[0], bend, " 1/mm", curved[1]),
        ):
            if value > limit + EXCESS:
                raise DeformationError(
                    f"the displacement's {what} is {value:.4g}{unit} near "
                    f"{name_place(rest[which])} mm: its stated bound is {limit:.4g}{unit}"
                )
        return middles

    def _find_curved(
        self, displacement: Displacement, rest: Floats, moves: Floats
    ) -> tuple[float, int]:
        """Return the largest second difference along a line that was found, and at which place.

        Of the places with the largest ones along the axes: the direction is sought by turns with
        that of the displacement's change.
        """
        turn, pairs = self.field.rotation, ((0, 1), (0, 2), (1, 2))
        along = moves[1:4] - 2.0 * moves[0] + moves[4:]
        some = np.argsort(np.linalg.norm(along, axis=2).max(axis=0))[-LOOKED_PLACES:]
        probes = PROBE_MM * np.stack([turn.T[i] + turn.T[j] for i, j in pairs])
        probes = (rest[some] + probes[:, None]).reshape(-1, 3)
        mixed = (measure_displacement(displacement, probes) @ turn).reshape(3, len(some), 3)
        second = np.empty((len(some), 3, 3, 3))
        for k in range(3):
            second[:, :, k, k] = along[k, some]
        for (i, j), there in zip(pairs, mixed, strict=True):
            jump = there - moves[1 + i, some] - moves[1 + j, some] + moves[0, some]
            second[:, :, i, j] = second[:, :, j, i] = jump
        way = np.eye(3)[np.argmax(np.linalg.norm(along[:, some], axis=2), axis=0)]
        for _ in range(LOOKED_TURNS):
            change = np.einsum("najk,nj,nk->na", second, way, way)
            change /= np.maximum(np.linalg.norm(change, axis=1, keepdims=True), 1e-300)
            values, vectors = np.linalg.eigh(np.einsum("na,najk->njk", change, second))
            largest = np.argmax(np.abs(values), axis=1)
            way = vectors[np.arange(len(some)), :, largest]
        ends = self._probe_lines(displacement, rest[some], way)
        size = np.linalg.norm(ends[0] - 2.0 * moves[0, some] + ends[1], axis=1) / PROBE_MM**2
        worst = int(np.argmax(size))
        return float(size[worst]), int(some[worst])

    def _find_steep(
        self, displacement: Displacement, rest: Floats, moves: Floats
    ) -> tuple[float, int]:
        """Return the largest difference quotient that was found, and at which place."""
        gradient = np.moveaxis(moves[1:4] - moves[4:], 0, -1)
        some = np.argsort(np.linalg.norm(gradient, axis=(1, 2)))[-LOOKED_PLACES:]
        way = np.linalg.svd(gradient[some])[2][:, 0]
        ends = self._probe_lines(displacement, rest[some], way)
        size = np.linalg.norm(ends[0] - ends[1], axis=1) / (2.0 * PROBE_MM)
        worst = int(np.argmax(size))
        return float(size[worst]), int(some[worst])

    def _probe_lines(self, displacement: Displacement, places: Floats, way: Floats) -> Floats:
        """Return the displacement (2, n, 3) a little ahead and behind along lines, grid's frame."""
        turn = self.field.rotation
        step = PROBE_MM * way @ turn.T
        ends = np.stack([places + step, places - step]).reshape(-1, 3)
        moves = measure_displacement(displacement, ends) @ turn
        return np.asarray(moves.reshape(2, len(places), 3))


class _Band:
    """The nodes near a path, in blocks, and an empty grid around them."""

    def __init__(self, field: SampledField, path: Floats, bend: float) -> None:
        from .kernels.moving import mark_path

        step = field.spacing
        reach = REACH_MM + REACH_CELLS * float(step.max())
        half = 0.5 * float(np.linalg.norm(step))
        fits = (n for n in SIDES if 0.5 * bend * (half * (n - 1)) ** 2 <= MISS_MM)
        side = next(fits, SIDES[-1])
        points = np.ascontiguousarray(resample_polyline(field.to_grid(path), SPACING_MM))
        low = np.floor((points.min(axis=0) - reach) / step / side).astype(np.int64) * side
        high = np.ceil((points.max(axis=0) + reach) / step).astype(np.int64)
        counts = (high - low) // side * side + side
        self.low = low
        self.values = np.zeros(counts, dtype=np.float32)
        ball = np.prod(2.0 * reach / step + 1.0)
        most = min(int(np.prod(counts)), int(len(points) * ball) + 1)
        nodes, corners = np.empty((most, 3), np.int32), np.empty((most, 3), np.int32)
        blocks = np.empty(most, dtype=np.int32)
        flags = np.zeros(counts, dtype=np.uint8)
        table = np.full(counts // side, -1, dtype=np.int32)
        count, number = mark_path(
            points, reach, low, step, side, flags, table, nodes, blocks, corners
        )
        self.nodes, self.blocks = nodes[:count], blocks[:count]
        self.middles = (low + corners[:number] + 0.5 * (side - 1)) * step


class _MovingWall:
    """The triangles of a surface in the order of a tree, which is fitted to them as they move."""

    def __init__(self, field: SampledField, surface: SurfaceTract) -> None:
        from .kernels.nearest import Tree, build_tree

        points = field.to_grid(surface.vertices)
        corners = points[surface.faces]
        low, high = corners.min(axis=1), corners.max(axis=1)
        order, boxes, right, first, counts = build_tree(low, high)
        corners = corners[order]
        sides = corners[:, 1:] - corners[:, :1]
        self.rest = np.concatenate([corners[:, 0], sides.reshape(-1, 6)], axis=1)
        self.tree: Tree = Tree(self.rest.copy(), boxes, right, first, counts)
        self.corners = np.ascontiguousarray(surface.faces[order])
        self.side = float(np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max())
        self.field, self.surface = field, surface
        self.places = points
        off = np.abs(field.signed_distance(surface.vertices))
        if off.max() > field.error + EXCESS_MM:
            worst = surface.vertices[int(np.argmax(off))]
            shown = show_apart(off.max(), field.error)
            raise InputError(
                "field and surface do not belong together: at the vertex "
                f"{name_place(worst)} mm the field has {shown[0]} mm to the wall, it must be "
                f"within {shown[1]} mm"
            )

    def move(
        self, displacement: Displacement | None, vertices: ArrayLike | None, gradient: float
    ) -> None:
        """Move the triangles, or raise `DeformationError` where a side changes too much."""
        from .kernels.moving import move_parts, refit_boxes

        rest = self.surface.vertices
        moved = rest if displacement is None else displace(rest, displacement)
        if vertices is not None:
            given = check_points("vertices", vertices)
            if given.shape != rest.shape:
                raise InputError(
                    f"vertices have shape {given.shape}: the surface's have {rest.shape}"
                )
            off = np.linalg.norm(moved - given, axis=1)
            if displacement is not None and off.max() > EXCESS_MM:
                raise DeformationError(
                    f"vertex {int(np.argmax(off))} is {off.max():.3g} mm from where the "
                    "displacement takes it: both must be of one frame"
                )
            moved = given
        excess = np.empty(len(self.corners))
        field = self.field
        straight = np.array_equal(field.rotation, np.eye(3))
        places = moved - field.origin if straight else field.to_grid(moved)
        self.places = np.ascontiguousarray(places)
        move_parts(self.places, self.corners, self.rest, self.tree.parts, gradient, excess)
        worst = int(np.argmax(excess))
        if np.isfinite(gradient) and not excess[worst] <= 0.0:
            before, after = (
                np.stack([part[3:6], part[6:], part[3:6] - part[6:]])
                for part in (self.rest[worst], self.tree.parts[worst])
            )
            lengths = np.maximum(np.linalg.norm(before, axis=1), 1e-12)
            change = np.linalg.norm(after - before, axis=1) / lengths
            raise DeformationError(
                f"a side of the wall near {name_place(rest[self.corners[worst, 0]])} mm changes by "
                f"{change.max():.4g} of its length: the stated gradient bound is {gradient:.4g}"
            )
        refit_boxes(self.tree)

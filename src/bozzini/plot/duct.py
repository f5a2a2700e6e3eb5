"""Figures of ducts made of shapes: each shape's outline from two sides, and how wide they are.

One mm is the same in all directions of a view. The world frame
is read as RAS+, as in `bozzini.plot.fluoroscopy`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

from ..checks import check_number
from ..errors import InputError
from .fluoroscopy import VIEWS, Projection, render_fluoroscopy
from .style import (
    AMBER,
    BLUE,
    GREEN,
    INK,
    LUMEN,
    RED,
    color_lumen,
    make_figure,
    make_panels,
    style_axes,
    take_panel,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..duct import Centreline, Duct, SampledField
    from ..duct.fitting.measure import SectionCircles, Sections
    from ..duct.shapes.super_ellipses import SuperEllipsoids
    from ..motion.traverse import LinkLimits

    Shapes = Duct


def draw_link_limits(limits: LinkLimits, *, link: float | None = None) -> Figure:
    """Return a figure of the bounds of the link over the place, and of the lumen below.

    Parameters
    ----------
    limits : LinkLimits
    link : float, optional
        A length to mark [mm].
    """
    size, ratios = (9.6, 6.0), (2.2, 1.0)
    figure, (upper, lower) = make_panels(2, 1, size=size, sharex=True, height_ratios=ratios)
    draw_link_bounds(limits, link=link, ax=upper)
    lower.fill_between(limits.arc_length, 0.0, limits.radius, color=LUMEN, lw=0)
    lower.axhline(0.5 * limits.diameter, color=RED, linewidth=1.3, linestyle=(0, (5, 2)))
    upper.set_xlabel("")
    lower.set(xlabel="place along the centreline [mm]", ylabel="clearance there [mm]")
    lower.set_ylim(bottom=0.0)
    return figure


def draw_link_bounds(
    limits: LinkLimits, *, link: float | None = None, ax: Axes | None = None
) -> Axes:
    """Draw the bounds of the link over the place.

    Parameters
    ----------
    limits : LinkLimits
    link : float, optional
        A length to mark [mm].
    ax : Axes, optional
        Axes to draw into.
    """
    if link is not None:
        check_number("link", link, low=0.0, low_open=True, unit="mm")
    upper = take_panel(ax)
    where, named = limits.arc_length, []
    lines = (
        (limits.rigid, RED, "no longer link passes", limits.link_high, limits.link_high_at),
        (
            limits.head_on_line,
            AMBER,
            "… with its head on the centreline",
            limits.link_head,
            limits.link_head_at,
        ),
        (
            limits.on_line,
            GREEN,
            "shorter links pass, joints on the centreline",
            limits.link_low,
            limits.link_low_at,
        ),
    )
    for values, color, name, best, place in lines:
        shown = np.where(np.isfinite(values), values, np.nan)
        upper.plot(where, shown, color=color, linewidth=1.7, label=name)
        if math.isfinite(place):
            upper.plot(place, best, "o", color=color, markersize=6)
            named.append(best)
    if link is not None:
        upper.axhline(link, color=INK, linewidth=1.3, linestyle=(0, (5, 2)), label=f"{link:g} mm")
        named.append(link)
    top = 3.0 * max(named) if named and max(named) > 0.0 else None
    upper.set_ylim(0.0, top)
    upper.set(xlabel="place along the centreline [mm]", ylabel="length of a link [mm]")
    upper.set_title(f"body of {limits.diameter:g} mm", fontsize=10, loc="left")
    # Above the axes: the curves fill them.
    upper.legend(
        frameon=False,
        fontsize=9,
        ncols=2,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderpad=0.0,
    )
    return upper


SIDES = ("coronal", "sagittal")
POINTS = 32
BALL = 400

_MARGIN = 6.0


def draw_shapes(
    shapes: Shapes,
    *,
    field: SampledField | None = None,
    line: Centreline | None = None,
    title: str = "",
) -> Figure:
    """Return a figure of the outlines of shapes from two sides, over the lumen if it is given.

    Parameters
    ----------
    shapes : RoundCones, ConnectedCylinders or SuperEllipsoids
    field : SampledField, optional
        The lumen that they stand for.
    line : Centreline, optional
        Then a third panel shows the clearance on it, true and as the shapes have it.
    title : str

    Raises
    ------
    InputError
        If `line` is given without `field`.
    """
    if line is not None and field is None:
        raise InputError("a centreline is drawn with its lumen: give the field too")
    outlines = outline_shapes(shapes)
    figure, panels = _make_views(outlines, extra=line is not None)
    for axes, side in zip(panels, SIDES, strict=False):
        picture = None if field is None else render_fluoroscopy(field, axis=side)
        _draw_view(axes, side, outlines, picture)
        if line is not None:
            axes.plot(*(line.points @ _flatten(side, picture).T).T, color=AMBER, linewidth=1.2)
    if line is not None and field is not None:
        draw_line_clearance(field, line, shapes, ax=panels[2])
    if title:
        figure.suptitle(title, fontsize=10.5, color=INK, x=0.01, ha="left")
    return figure


def draw_sections(
    field: SampledField,
    line: Centreline,
    sections: Sections,
    circles: Mapping[str, SectionCircles],
    *,
    title: str = "",
) -> Figure:
    """Return a figure of sections: their walls from two sides, radii of circles along it.

    Parameters
    ----------
    field : SampledField
    line : Centreline
    sections : Sections
    circles : mapping of str to SectionCircles
        What to draw, by the name in the legend.
    title : str

    Raises
    ------
    InputError
        If there are no circles.
    """
    wall = sections.wall
    figure, panels = _make_views(wall, extra=True)
    for axes, side in zip(panels, SIDES, strict=False):
        picture = render_fluoroscopy(field, axis=side)
        _draw_view(axes, side, wall[:: max(1, len(wall) // 60)], picture)
        axes.plot(*(line.points @ picture.matrix.T).T, color=AMBER, linewidth=1.2)
    draw_radii(field, line, sections, circles, ax=panels[2])
    if title:
        figure.suptitle(title, fontsize=10.5, color=INK, x=0.01, ha="left")
    return figure


def draw_line_clearance(
    field: SampledField, line: Centreline, shapes: Duct, *, ax: Axes | None = None
) -> Axes:
    """Draw the clearance on a centreline, of the lumen and of shapes that stand for it.

    Parameters
    ----------
    field : SampledField
    line : Centreline
    shapes : RoundCones, ConnectedCylinders or SuperEllipsoids
    ax : Axes, optional
        Axes to draw into.
    """
    axes = take_panel(ax)
    for duct, color, label in ((field, INK, "true"), (shapes, BLUE, "of the shapes")):
        clearance = -duct.signed_distance(line.points)
        axes.plot(line.arc_length, clearance, color=color, linewidth=1.4, label=label)
    return _name_curves(axes, "clearance on the centreline [mm]")


def draw_radii(
    field: SampledField,
    line: Centreline,
    sections: Sections,
    circles: Mapping[str, SectionCircles],
    *,
    ax: Axes | None = None,
) -> Axes:
    """Draw radii of circles along a centreline, and the clearance on it.

    Parameters
    ----------
    field, line, sections, circles
        As for `draw_sections`.
    ax : Axes, optional
        Axes to draw into.

    Raises
    ------
    InputError
        If there are no circles.
    """
    if not circles:
        raise InputError("there are 0 kinds of circles to draw: give 1 or more")
    axes = take_panel(ax)
    axes.plot(
        line.arc_length, -field.signed_distance(line.points), color=INK, linewidth=1.4,
        label="clearance on the centreline",
    )  # fmt: skip
    colors = (BLUE, RED, GREEN, AMBER)
    for color, (name, group) in zip(colors, circles.items(), strict=False):
        axes.plot(sections.arc_length, group.radii, color=color, linewidth=1.2, label=name)
    return _name_curves(axes, "radius [mm]")


def outline_shapes(shapes: Shapes) -> NDArray[np.float64]:
    """Return (pieces, k, 3) points on the wall of every shape [mm].

    From any side the hull of a shape's points is its outline, short of it by about a
    hundredth of its size; inflation counts.
    """
    from ..duct.shapes.cones import RoundCones
    from ..duct.shapes.cylinders import ConnectedCylinders
    from ..duct.shapes.super_ellipses import SuperEllipsoids

    if isinstance(shapes, RoundCones):
        radii = (shapes.radii + shapes.inflation)[:, None, None]
        balls = shapes.centres[:, None] + radii * _spread(BALL)
        return np.concatenate([balls[:-1], balls[1:]], axis=1) if len(balls) > 1 else balls
    if isinstance(shapes, ConnectedCylinders):
        angles = 2.0 * np.pi * np.arange(POINTS) / POINTS
        spokes = np.stack([np.cos(angles), np.sin(angles)])
        rays = np.einsum("nji,ik->nkj", shapes.frames[:, :, :2], spokes)
        rims = shapes.centres[:, None] + (shapes.radii + shapes.inflation)[:, None, None] * rays
        return np.concatenate([rims[:-1], rims[1:]], axis=1)
    if isinstance(shapes, SuperEllipsoids):
        return _outline_blocks(shapes)
    raise InputError(
        f"a {type(shapes).__name__} cannot be drawn: RoundCones, ConnectedCylinders and "
        "SuperEllipsoids can"
    )


def _outline_blocks(shapes: SuperEllipsoids) -> NDArray[np.float64]:
    """Points at equal steps of the parameters, which come close together at corners."""
    tall, wide = np.meshgrid(
        np.linspace(-0.5 * np.pi, 0.5 * np.pi, POINTS // 2 + 1),
        2.0 * np.pi * np.arange(POINTS) / POINTS,
    )
    e1, e2 = shapes.e1[:, None], shapes.e2[:, None]
    flat = _power(np.cos(tall.ravel()), e1)
    local = np.stack(
        [
            flat * _power(np.cos(wide.ravel()), e2),
            flat * _power(np.sin(wide.ravel()), e2),
            _power(np.sin(tall.ravel()), e1),
        ],
        axis=2,
    )
    local *= (shapes.half_axes + shapes.inflation)[:, None]
    turned = np.einsum("nkj,nij->nki", local, shapes.rotations)
    return np.asarray(shapes.centres[:, None] + turned)


def _power(values: NDArray[np.float64], exponents: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.sign(values) * np.abs(values) ** exponents)


def _spread(count: int) -> NDArray[np.float64]:
    """Return unit vectors spread evenly (a Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    height = 1.0 - 2.0 * k / count
    turn = np.pi * (1.0 + 5.0**0.5) * k
    off = np.sqrt(1.0 - height**2)
    return np.stack([off * np.cos(turn), off * np.sin(turn), height], axis=1)


def _flatten(side: str, picture: Projection | None) -> NDArray[np.float64]:
    """Return the map (2, 3) of a view: the picture's own, or along a world axis."""
    if picture is not None:
        return picture.matrix
    _, right, up = VIEWS[side]
    return np.stack([right[1] * np.eye(3)[right[0]], up[1] * np.eye(3)[up[0]]])


def _make_views(points: NDArray[np.float64], *, extra: bool) -> tuple[Figure, list[Axes]]:
    sizes = [np.ptp((points @ _flatten(side, None).T).reshape(-1, 2), axis=0) for side in SIDES]
    tall = max(float(size[1]) for size in sizes) + 4.0 * _MARGIN
    ratios = [float(np.clip((size[0] + 4.0 * _MARGIN) / tall, 0.3, 2.5)) for size in sizes]
    ratios += [0.9] if extra else []
    figure = make_figure((0.9 * len(ratios) + 4.6 * sum(ratios), 5.4))
    panels = figure.subplots(1, len(ratios), squeeze=False, width_ratios=ratios)[0]
    return figure, list(panels)


def _draw_view(
    axes: Axes, side: str, outlines: NDArray[np.float64], picture: Projection | None
) -> None:
    from scipy.spatial import ConvexHull

    flat = outlines @ _flatten(side, picture).T
    if picture is not None:
        axes.imshow(color_lumen(1.0 - 0.55 * picture.image), extent=picture.extent, zorder=0)
    rings = [points[ConvexHull(points, qhull_options="QJ").vertices] for points in flat]
    axes.add_collection(
        PolyCollection(
            rings, facecolors=(0.12, 0.37, 0.66, 0.06), edgecolors=BLUE, linewidths=0.7, zorder=3
        )
    )
    low, high = flat.reshape(-1, 2).min(axis=0), flat.reshape(-1, 2).max(axis=0)
    if picture is not None:
        left, right, bottom, top = picture.extent
        low, high = np.minimum(low, (left, bottom)), np.maximum(high, (right, top))
    axes.set_xlim(low[0] - _MARGIN, high[0] + _MARGIN)
    axes.set_ylim(low[1] - _MARGIN, high[1] + _MARGIN)
    axes.set_aspect("equal")
    axes.set_title(side, fontsize=10, loc="left", color=INK)
    axes.tick_params(labelsize=8)
    axes.set_xlabel("[mm]", fontsize=9)


def _name_curves(axes: Axes, label: str) -> Axes:
    style_axes(axes)
    axes.set(xlabel="along the centreline [mm]", ylabel=label)
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    axes.legend(frameon=False, fontsize=9)
    return axes

"""Figures of continuum robots: a shape with its discs and tendons, models over each other.

Lengths are in mm, one mm the same in all directions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number, check_points
from ..errors import InputError
from ..numeric.arrays import Floats
from .style import (
    AMBER,
    BLUE,
    COLORS,
    GREEN,
    INK,
    LUMEN,
    RED,
    Dash,
    fit_space,
    make_figure,
    make_panels,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import QuadMesh
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

    from ..continuum import LinearDynamics, Shape
    from ..continuum.workspace import DexterityMap
    from ..motion.actuate.actuation import Actuation


def draw_workspace(found: DexterityMap, *, length: float | None = None) -> Figure:
    """Return a figure of a dexterity map: share of directions left, manipulability right.

    In the half-plane cells are rings about the base's axis, seen in section; in space each cell
    is a point.

    Parameters
    ----------
    found : DexterityMap
    length : float, optional
        Length of the robot [mm], to draw it at rest.

    Raises
    ------
    InputError
        If `length` is not positive.
    """
    if length is not None:
        check_number("length", length, low=0.0, low_open=True, unit="mm")
    figure = make_figure((10.4, 5.2))
    unit = {1: "mm/rad", 2: "mm²/rad²", 3: "mm³/rad³"}[found.rank]
    panels = (
        (found.direction_share, "share of directions", "viridis", 0.0),
        (found.manipulability, f"mean manipulability [{unit}]", "cividis", None),
    )
    drawn: ScalarMappable
    for place, (values, name, colors, low) in enumerate(panels, start=1):
        if found.half_plane:
            axes = figure.add_subplot(1, 2, place)
            drawn = _fill_cells(axes, found, values, colors, low)
            if length is not None:
                axes.plot([0.0, 0.0], [0.0, length], color=INK, linewidth=2.0, label="at rest")
                axes.legend(frameon=False, fontsize=9, loc="upper right")
            axes.set(xlabel="distance from the axis [mm]", ylabel="z [mm]", aspect="equal")
            axes.set_xlim(left=-found.cell)
        else:
            axes = figure.add_subplot(1, 2, place, projection="3d")
            drawn = axes.scatter(*found.centres.T, c=values, s=6.0, cmap=colors, vmin=low)
            if length is not None:
                axes.plot([0.0, 0.0], [0.0, 0.0], [0.0, length], color=INK, linewidth=2.0)
            axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]", aspect="equal")
        figure.colorbar(drawn, ax=axes, label=name, shrink=0.8)
    return figure


def _fill_cells(
    axes: Axes, found: DexterityMap, values: NDArray[np.float64], colors: str, low: float | None
) -> QuadMesh:
    """Draw the cells of a half-plane as squares, those without a tip left white."""
    index = np.rint(found.centres[:, (0, 2)] / found.cell - 0.5).astype(np.int64)
    first, last = index.min(axis=0), index.max(axis=0)
    grid = np.full(tuple(last - first + 1), np.nan)
    grid[tuple((index - first).T)] = values
    edges = [found.cell * np.arange(first[k], last[k] + 2) for k in range(2)]
    drawn = axes.pcolormesh(*edges, np.ma.masked_invalid(grid.T), cmap=colors, vmin=low)
    style_axes(axes)
    return drawn


NEAR = 1.5
"""Ratio to the largest bend from which the bend at which discs meet is not shown."""


SHOWN_MODES, LEAST_GAIN = 6, 1e-3
"""Modes that a Bode figure reaches to, and the least gain in it by the largest."""


def draw_bode(found: LinearDynamics, tendon: str, *, modes: int | None = None) -> Figure:
    """Return a Bode figure: gain and phase from a tendon's command to the tip's coordinates.

    Coordinates that it moves by less than a thousandth of the most are left out.

    Parameters
    ----------
    found : LinearDynamics
    tendon : str
        Name of the tendon.
    modes : int, optional
        The slowest ones that count; all unless given.

    Raises
    ------
    InputError
        If there is no such tendon, or there are not so many modes.
    """
    names = found.robot.tendon_names
    if tendon not in names:
        raise InputError(f"there is no tendon '{tendon}': there are {', '.join(names) or 'none'}")
    system, own = found.state_space(modes), names.index(tendon)
    count = len(system.A) // 2
    slowest = found.frequency[: min(count, SHOWN_MODES)]
    near = np.outer(slowest, np.linspace(0.9, 1.1, 100))  # none is where an undamped one has no end
    hertz = np.append(np.geomspace(0.1 * slowest[0], 10.0 * slowest[-1], 400), near)
    hertz = np.unique(hertz)
    speeds = 2j * math.pi * hertz[:, None, None]
    # Amplitudes of the modes; polynomials of so many would be round-off.
    inner = speeds**2 * np.eye(count) - speeds * system.A[count:, count:] - system.A[count:, :count]
    moved = np.linalg.solve(inner, system.B[count:, own : own + 1])
    drawn = dict(zip("xyz", (system.C[:, :count] @ moved)[..., 0].T, strict=True))
    most = max(float(np.abs(gain).max()) for gain in drawn.values())
    figure, (gains, phases) = make_panels(2, size=(7.0, 5.0))
    unit = "mm/N" if found.given == "tensions" else "mm/mm"
    for (axis, gain), color in zip(drawn.items(), COLORS, strict=False):
        if np.abs(gain).max() >= LEAST_GAIN * most:
            gains.loglog(hertz, np.abs(gain), color=color, label=axis)
            phases.semilogx(hertz, np.degrees(np.unwrap(np.angle(gain))), color=color)
    gains.set_ylabel(f"tip by {tendon} [{unit}]")
    phases.set(xlabel="frequency [Hz]", ylabel="phase [deg]")
    gains.legend()
    return figure


def draw_robot_motion(actuation: Actuation) -> Figure:
    """Return a figure of a robot's motion: four panels over how far its tip is in.

    Bends of the sections with their limits; how far the body is off the path; estimated clearance
    with the proved bound; tendon displacements. Where the motion goes back and forth, it is drawn
    over the steps instead.

    Parameters
    ----------
    actuation : Actuation
    """
    heads = actuation.head_arc_length
    onwards = bool(np.all(np.diff(heads) >= -1e-9))
    across = heads if onwards else np.arange(actuation.steps, dtype=np.float64)
    label = "tip along the path [mm]" if onwards else "step"
    figure, panels = make_panels(2, 2, size=(11.0, 8.0), sharex=True)
    draws = (_draw_bends, _draw_fit, _draw_clearance, _draw_tendons)
    for draw, axes in zip(draws, panels, strict=True):
        draw(axes, actuation, across)
    for axes in panels[2:]:
        axes.set_xlabel(label)
    robot = actuation.robot
    title = f"{robot.name}: {len(robot.sections)} sections, {robot.length:g} mm long, "
    title += f"{2.0 * robot.radius:g} mm thick"
    figure.suptitle(title, color=INK, fontsize=13, x=0.01, ha="left")
    if actuation.status == "stopped":
        _mark_end(panels, across, actuation)
    return figure


def _draw_bends(axes: Axes, actuation: Actuation, across: NDArray[np.float64]) -> None:
    angles = np.degrees(np.linalg.norm(actuation.bends, axis=2))
    sections = actuation.robot.sections
    colors = _spread_colors(len(sections))
    for index, color in enumerate(colors):
        axes.plot(across, angles[:, index], color=color, linewidth=1.2)
    limits = sorted(
        {
            min(math.degrees(item.max_bend), meet)
            for item in sections
            for meet in [math.degrees(item.length / item.radius)]
            # Discs mostly meet far beyond: shown if a section comes near.
            if math.degrees(item.max_bend) <= meet or meet < NEAR * float(angles.max())
        }
    )
    for limit in limits[:3]:
        axes.axhline(limit, color=RED, linewidth=1.4, linestyle=(0, (5, 2)))
    highest = max([float(angles.max()), 1.0, *limits])
    axes.set_ylim(0.0, 1.3 * highest)
    axes.set_ylabel("bend of the sections [deg]")
    handles = [
        Line2D([], [], color=colors[0], label="first section"),
        Line2D([], [], color=colors[-1], label="last section, with the tip"),
    ]
    if limits:
        handles.append(Line2D([], [], color=RED, linestyle=(0, (5, 2)), label="limit"))
    axes.legend(handles=handles, frameon=False, fontsize=8.5, loc="upper left")


def _draw_fit(axes: Axes, actuation: Actuation, across: NDArray[np.float64]) -> None:
    axes.fill_between(across, 0.0, actuation.fit_max, color=LUMEN, lw=0, label="largest")
    axes.plot(across, actuation.fit_rms, color=BLUE, linewidth=1.4, label="rms")
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("backbone off the path [mm]")
    axes.legend(frameon=False, fontsize=8.5, loc="upper left")


def _draw_clearance(axes: Axes, actuation: Actuation, across: NDArray[np.float64]) -> None:
    clearance = np.where(np.isfinite(actuation.clearance), actuation.clearance, np.nan)
    axes.plot(across, clearance, color=GREEN, linewidth=1.4, label="estimated at the steps")
    if actuation.certified:
        axes.axhline(
            actuation.certificate.clearance,
            color=INK,
            linewidth=1.2,
            linestyle=(0, (1, 1.5)),
            label="proved at all times",
        )
    axes.axhline(0.0, color=RED, linewidth=1.2)
    axes.set_ylabel("body to wall [mm]")
    axes.legend(frameon=False, fontsize=8.5, loc="upper right")


def _draw_tendons(axes: Axes, actuation: Actuation, across: NDArray[np.float64]) -> None:
    names = actuation.robot.tendon_names
    few = len(names) <= _NAMED
    sections = actuation.robot.tendon_sections
    colors = _spread_colors(len(names) if few else len(actuation.robot.sections))
    for index, name in enumerate(names):
        axes.plot(
            across,
            actuation.displacements[:, index],
            color=colors[index if few else int(sections[index])],
            linewidth=1.0,
            label=name,
        )
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.set_ylabel("tendon displacement [mm], pulled > 0")
    if few:
        axes.legend(frameon=False, fontsize=8.5, loc="upper left", ncols=2)
    else:
        axes.text(
            0.02, 0.97, "colour: section at the end of a tendon", transform=axes.transAxes,
            fontsize=8.5, va="top", color=INK,
        )  # fmt: skip


def _mark_end(panels: list[Axes], across: Floats, actuation: Actuation) -> None:
    for axes in panels:
        axes.axvline(across[-1], color=AMBER, linewidth=2.0)
    panels[0].set_title(
        f"ends here: {actuation.reason_code.replace('_', ' ').lower()}",
        color=AMBER,
        fontsize=10,
        loc="right",
    )


def _spread_colors(count: int) -> list[tuple[float, float, float, float]]:
    """Return colours from dark (base) to light (tip)."""
    from matplotlib import colormaps

    return [colormaps["viridis"](value) for value in np.linspace(0.0, 0.88, max(count, 1))]


_COLORS = (BLUE, AMBER, GREEN, RED, "#6f4fa8", "#2a94b8", "#7a6a58", "#c0508f")
_STYLES: dict[str, tuple[str, Dash]] = {
    "arc": (BLUE, (0, (6, 2))),
    "linkage": (AMBER, (0, (2, 1.5))),
    "energy": (GREEN, (0, (6, 2, 1.5, 2))),
    "rod": (INK, (0, ())),
}
_DISC = "#8fa3b8"
_NAMED = 8
"""Tendons that a legend lists at most."""
_MATCH = 1e-6
_AZIMUTHS = (-60.0, 30.0, 120.0, -150.0)
"""From where the robot may be seen [deg]: never along an axis."""


def draw_shape(
    shape: Shape, *, target: ArrayLike | None = None, direction: ArrayLike | None = None
) -> Figure:
    """Return a figure of one shape: in space, from the side and from above the tip.

    From the side the plane of the picture holds the base's axis and the tip.

    Parameters
    ----------
    shape : Shape
        A single one that is converged, not a batch.
    target : (3,) array_like, optional
        Where the tip should be [mm].
    direction : (3,) array_like, optional
        Where it should look, from the target or the tip; of any length.

    Raises
    ------
    InputError
        If `shape` is a batch or no shape at all, or a vector has another shape or is zero.
    """
    _check_single("shape", shape)
    figure = make_figure((11.4, 5.4))
    turn, words = _side_view(shape)
    rims = _rings(shape).reshape(-1, 3)
    wide, deep = _span(rims @ turn[0], rims[:, 2])
    grid = figure.add_gridspec(1, 3, width_ratios=(1.1, min(max(wide / deep, 0.5), 1.1), 0.8))
    space = figure.add_subplot(grid[0], projection="3d")
    side, top = figure.add_subplot(grid[1]), figure.add_subplot(grid[2])
    marks = [] if target is None else [_check_vector("target", target)]
    arrow = None
    if direction is not None:
        aim = _check_vector("direction", direction)
        if not np.any(aim):
            raise InputError("direction is (0, 0, 0): it must not be zero")
        aim = aim / np.abs(aim).max()  # its square might be out of a float's range
        begin = marks[0] if marks else shape.tip
        arrow = np.stack([begin, begin + 0.15 * shape.robot.length * aim / np.linalg.norm(aim)])
    for axes, views in (
        (space, np.eye(3)),
        (side, np.stack([turn[0], (0.0, 0.0, 1.0)])),
        (top, np.eye(3)[:2]),
    ):
        _draw_body(axes, shape, views, named=axes is space)
        for mark in marks:
            axes.plot(*(views @ mark)[:, None], "x", color=AMBER, markersize=9.0,
                      markeredgewidth=2.4, zorder=9, label="target")  # fmt: skip
        if arrow is not None:
            axes.plot(*(views @ arrow.T), color=AMBER, linewidth=1.8, zorder=9)
    every = np.concatenate([rims, *(mark[None] for mark in marks)])
    fit_space(space, every, least=0.364 * float(np.ptp(every, axis=0).max()), zoom=0.95)
    towards = math.degrees(math.atan2(turn[0][1], turn[0][0]))
    azimuth = max(_AZIMUTHS, key=lambda angle: abs(math.sin(math.radians(angle - towards))))
    space.view_init(elev=18.0, azim=azimuth)
    handles, labels = space.get_legend_handles_labels()
    if labels:
        figure.legend(
            handles, labels, loc="outside lower center", ncols=10, frameon=False, fontsize=8.5
        )
    for axes, across, along in ((side, words, "z"), (top, "x", "y")):
        style_axes(axes)
        axes.set(xlabel=f"{across} [mm]", ylabel=f"{along} [mm]", aspect="equal")
        axes.margins(0.06)
    place = ", ".join(f"{value:z.2f}" for value in shape.tip)
    title = f"{shape.robot.name}, {shape.model}: tip at {place} mm"
    loose = [
        name for name, slack in zip(shape.robot.tendon_names, shape.slack, strict=True) if slack
    ]
    if loose:
        title += f"; slack (dotted): {', '.join(loose[:6])}{' …' if len(loose) > 6 else ''}"
    figure.suptitle(title, fontsize=10.5, color=INK, x=0.01, ha="left")
    return figure


def draw_comparison(shapes: Mapping[str, Shape], *, reference: str | None = "rod") -> Figure:
    """Return a figure of several models' shapes of one robot under the same displacements.

    Backbones over each other from two sides, and the distance from the reference along them.

    Parameters
    ----------
    shapes : mapping of str to Shape
        What to draw, by the name in the legend.
    reference : str, optional
        The name of the shape that the others are compared with.

    Raises
    ------
    InputError
        If there is nothing to draw, a shape is a batch or none, or the reference is not there.
    """
    if not shapes:
        raise InputError("there are 0 shapes to draw: give 1 or more")
    for name, shape in shapes.items():
        _check_single(name, shape)
    if reference is not None and reference not in shapes:
        raise InputError(f"reference '{reference}' is not among {', '.join(shapes)}")
    base = shapes[next(iter(shapes)) if reference is None else reference]
    count = 2 if reference is None or len(shapes) < 2 else 3
    turn, words = _side_view(base)
    points = np.concatenate([_rings(base).reshape(-1, 3), *(s.points for s in shapes.values())])
    sizes = np.array([_span(points @ turn[0], points @ turn[1], points[:, 2])]).ravel()
    ratios = np.clip(sizes[:2] / sizes[2], 0.45, 1.3)
    size = (1.2 + 4.2 * float(ratios.sum()) + 4.4 * (count - 2), 5.0)
    widths = (*(4.2 * ratios), 4.4)[:count]
    figure, panels = make_panels(1, count, size=size, width_ratios=widths)
    other = "y [mm]" if words == "x" else "across that plane [mm]"
    for axes, row, label in ((panels[0], turn[0], f"{words} [mm]"), (panels[1], turn[1], other)):
        views = np.stack([row, (0.0, 0.0, 1.0)])
        _fill_discs(axes, base, views)
        for name, (color, dashes) in _pick_styles(shapes).items():
            below = name == reference  # wide and pale, the others over it
            axes.plot(*(views @ shapes[name].points.T), color=color, linestyle=dashes,
                      linewidth=4.5 if below else 1.6, alpha=0.35 if below else 1.0,
                      zorder=2 if below else 3, label=name)  # fmt: skip
        axes.set(xlabel=label, ylabel="z [mm]", aspect="equal")
        axes.margins(0.06)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    if count == 3 and reference is not None:
        _draw_distances(panels[2], shapes, reference)
    panels[0].set_title(base.robot.name, fontsize=10, loc="left")
    return figure


def _draw_distances(axes: Axes, shapes: Mapping[str, Shape], reference: str) -> None:
    """Draw distances at the arc lengths that a shape shares with the reference."""
    theirs = shapes[reference]
    drawn = False
    for name, (color, dashes) in _pick_styles(shapes).items():
        if name == reference:
            continue
        ours = shapes[name]
        near = np.abs(ours.arc_length[:, None] - theirs.arc_length) < _MATCH
        rows, columns = np.nonzero(near)
        apart = np.linalg.norm(ours.points[rows] - theirs.points[columns], axis=1)
        seen = apart > 1e-9
        axes.plot(ours.arc_length[rows][seen], apart[seen], color=color, linestyle=dashes,
                  marker="." if len(rows) < 40 else None, label=name)  # fmt: skip
        drawn = drawn or bool(seen.any())
    if drawn:
        axes.set_yscale("log")
    axes.set(xlabel="arc length [mm]", ylabel=f"distance from the {reference} [mm]")


def _draw_body(axes: Axes | Axes3D, shape: Shape, views: Floats, *, named: bool) -> None:
    """Draw discs, tendons and backbone in the plane or space that `views` leads to."""
    if len(views) == 2:
        _fill_discs(axes, shape, views)
    else:
        for ring in _rings(shape):
            axes.plot(*ring.T, color=_DISC, linewidth=0.8, alpha=0.8)
    robot = shape.robot
    few = len(robot.tendons) <= _NAMED
    for k, points in enumerate(shape.tendon_points):
        color = _COLORS[(k if few else int(robot.tendon_sections[k])) % len(_COLORS)]
        line = views @ points.T
        axes.plot(*line, color=color, linewidth=1.3, label=robot.tendon_names[k] if few else None,
                  linestyle=":" if shape.slack[k] else "-")  # fmt: skip
        axes.plot(*line[:, -1:], "o", color=color, markersize=3.0)
    axes.plot(*(views @ shape.points.T), color=INK, linewidth=2.2,
              label="backbone" if named and few else None)  # fmt: skip


def _fill_discs(axes: Axes, shape: Shape, views: Floats) -> None:
    for ring in _rings(shape):
        axes.fill(*(views @ ring.T), facecolor="#dfe8f1", edgecolor=_DISC, linewidth=0.8,
                  alpha=0.55, zorder=1)  # fmt: skip


def _rings(shape: Shape) -> Floats:
    """Return the rims of base and discs, (d + 1, 49, 3)."""
    angle = np.linspace(0.0, 2.0 * math.pi, 49)
    frames = np.concatenate([shape.frames[:1], shape.disc_frames])
    places = np.concatenate([[0.0], shape.disc_arc_length])
    radii = np.array([section.radius for section in shape.robot.sections])
    size = radii[shape.robot.section_at(places)]
    flat = np.stack([np.cos(angle), np.sin(angle)])
    rims = size[:, None, None] * (frames[:, :3, :2] @ flat)
    return np.asarray(np.moveaxis(rims + frames[:, :3, 3:], 1, 2))


def _side_view(shape: Shape) -> tuple[Floats, str]:
    """Return the axes across the base's, the first towards where the robot goes, and its name."""
    points = shape.points
    aside = np.hypot(points[:, 0], points[:, 1])
    far = points[int(np.argmax(aside))]
    if aside.max() < 1e-6 * shape.robot.length:
        far = np.array([1.0, 0.0, 0.0])
    angle = math.atan2(far[1], far[0])
    if abs(math.sin(angle)) < 1e-9:
        return np.eye(3)[:2], "x"
    cosine, sine = math.cos(angle), math.sin(angle)
    turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0]])
    return turn, f"towards {math.degrees(angle):z.0f}°"


def _span(*values: Floats) -> tuple[float, ...]:
    return tuple(float(np.ptp(row)) for row in values)


def _pick_styles(names: Iterable[str]) -> dict[str, tuple[str, Dash]]:
    return {
        name: _STYLES.get(name, (_COLORS[k % len(_COLORS)], (0, ())))
        for k, name in enumerate(names)
    }


def _check_vector(name: str, given: ArrayLike) -> Floats:
    vector = check_points(name, given)
    if vector.shape != (3,):
        raise InputError(f"{name} has shape {vector.shape}: it must be (3,)")
    return vector


def _check_single(name: str, shape: Shape) -> None:
    if shape.points.ndim != 2:
        raise InputError(
            f"{name} has points of shape {shape.points.shape}: one shape is drawn, (k, 3)"
        )
    if not bool(shape.converged):
        raise InputError(f"{name} is no shape to draw: {shape.reason}")

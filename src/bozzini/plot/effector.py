"""Figures of the end-effector: pose, workspace, curves, forces, sweeps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_points
from ..errors import InputError
from ..numeric.arrays import Floats
from .style import (
    AMBER,
    BLUE,
    COLORS,
    DASHES,
    GREEN,
    GRID,
    INK,
    RED,
    Look,
    fit_space,
    make_panels,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from mpl_toolkits.mplot3d import Axes3D

    from ..effector import (
        Balance,
        CubicFit,
        Effector,
        EffectorPose,
        Sweep,
        Trace,
        Workspace,
    )

# Drawn without pyplot; `bozzini.plot.write_figure` writes the figures.

_OWN = {"R": RED, "G": GREEN, "B": BLUE}
_RISING, _FALLING = (0, (4, 1.5)), (0, (1, 1.5))
_CUBIC: Look = {"color": INK, "linewidth": 1.1}
LEAST_SIDE = 26.0
"""Shortest side of a 3-D panel [mm]."""
_SMALL = 1e-6  # an error of the trace that is round-off [mm]
_PRESSURE = "pressure [kPa]"


def pick_colors(names: Sequence[str]) -> dict[str, str]:
    """Return a colour for each muscle: R, G and B as they are called, others in a fixed order."""
    if set(names) <= set(_OWN):
        return {name: _OWN[name] for name in names}
    return {name: COLORS[k % len(COLORS)] for k, name in enumerate(names)}


def draw_deflection(
    effector: Effector,
    *,
    cubics: Mapping[str, CubicFit] | None = None,
    measured: ArrayLike | None = None,
    points: int = 201,
) -> Figure:
    """Return a figure of the deflection by each muscle alone over its pressure (Fig. 4.16).

    Muscles with the same curve share a line. With cubics, a second panel shows how far each is
    off; where a cubic falls, the controller cannot use it, and it is drawn dotted.

    Parameters
    ----------
    effector : Effector
    cubics : mapping of str to CubicFit, optional
        Cubic fits by the name of the muscle.
    measured : (n, 2) array_like, optional
        Measurements to draw beside it: pressure [MPa], deflection [mm].
    points : int
        Pressures of a line.

    Raises
    ------
    InputError
        If an argument is outside its legal range, or a muscle has no answer.
    """
    from ..effector import balance

    points = check_integer("points", points, low=2, high=1_000_000)
    fits = dict(cubics or {})
    figure, panels = make_panels(1, 2 if fits else 1)
    axes, limit = panels[0], effector.design.pressure_limit
    over = np.linspace(0.0, limit, points)
    colors = pick_colors(effector.design.names)
    curves = {name: balance(effector, name, pressure=over) for name in colors}
    lines = {name: np.asarray(curve.lateral) for name, curve in curves.items()}
    for k, names in enumerate(_group_lines(lines)):
        line, style = lines[names[0]], DASHES[k % len(DASHES)]
        axes.plot(
            1e3 * over, line, color=colors[names[0]], linewidth=1.9, linestyle=style,
            label=", ".join(names),
        )  # fmt: skip
        full = np.asarray(curves[names[0]].saturated)
        if full.any():
            axes.plot(1e3 * over[full], line[full], color=RED, linewidth=4.0, alpha=0.35,
                      label=f"{', '.join(names)} saturated")  # fmt: skip
        fit = next((fits[name] for name in names if name in fits), None)
        if fit is None:
            continue
        reach = np.linspace(fit.start, fit.limit, points)
        cubic = _evaluate(fit, reach)
        rising = reach >= fit.rising_from
        axes.plot(1e3 * reach[rising], cubic[rising], linestyle=_RISING, **_CUBIC)
        axes.plot(1e3 * reach[~rising], cubic[~rising], linestyle=_FALLING, **_CUBIC)
        exact = np.interp(reach, over, line)
        panels[1].plot(
            1e3 * reach, cubic - exact, color=colors[names[0]], linewidth=1.6, linestyle=style,
            label=f"{', '.join(names)}: {fit.rms_error:.2f} mm rms",
        )  # fmt: skip
    if fits:
        axes.plot([], [], linestyle=_RISING, label="cubic", **_CUBIC)
        if not all(fit.monotone for fit in fits.values()):
            axes.plot([], [], linestyle=_FALLING, label="cubic, where it falls", **_CUBIC)
        panels[1].axhline(0.0, color=INK, linewidth=0.8)
        panels[1].set(xlabel=_PRESSURE, ylabel="cubic less exact [mm]", xlim=(0.0, 1e3 * limit))
        panels[1].legend(frameon=False, fontsize=9)
    if measured is not None:
        rows = check_points("measured", measured, dim=2).reshape(-1, 2)
        axes.plot(1e3 * rows[:, 0], rows[:, 1], "o", color=INK, markerfacecolor="none",
                  markersize=5.5, label="measured", zorder=4)  # fmt: skip
    axes.set(xlabel=_PRESSURE, ylabel="deflection of the backbone's tip [mm]",
             xlim=(0.0, 1e3 * limit))  # fmt: skip
    axes.legend(frameon=False, fontsize=9)
    return figure


def draw_iteration(balances: Mapping[str, Balance]) -> Figure:
    """Return a figure of the thesis's fixed-point iteration (Tables 4.1-4.4).

    Left the force against the deflection of every row, right how much the force still changes.

    Parameters
    ----------
    balances : mapping of str to Balance
        Results of ``balance(..., method="fixed-point")`` at one pressure each, by what the legend
        calls them.

    Raises
    ------
    InputError
        If there is none, or one has no table.
    """
    if not balances:
        raise InputError("there are 0 iterations to draw: give 1 or more")
    figure, (left, right) = make_panels(1, 2)
    for k, (name, found) in enumerate(balances.items()):
        table = np.asarray(found.table, dtype=np.float64)
        if table.ndim != 2 or not len(table):
            raise InputError(
                f"the balance '{name}' has no single iteration table: it must come from one "
                "pressure with method='fixed-point'"
            )
        force, _, lateral, following = table[:, :4].T
        style: Look = {
            "color": COLORS[k % len(COLORS)],
            "markersize": 4.5,
            "linewidth": 1.5,
        }
        left.plot(np.arange(1, len(table) + 1), lateral, "o-", label=name, **style)
        change = np.abs(following - force)
        right.semilogy(
            np.flatnonzero(change > 0.0) + 1, change[change > 0.0], "o-", label=name, **style
        )
    rows = max(len(np.asarray(found.table)) for found in balances.values())
    for axes in (left, right):
        axes.set_xlabel("row of the table")
        axes.set_xlim(0.5, rows + 0.5)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if not any(np.size(line.get_xdata()) for line in right.lines):
        right.set_yscale("linear")
        right.set_yticks([])
        right.text(0.5, 0.5, "nothing changes: no muscle pulls", transform=right.transAxes,
                   ha="center", fontsize=9.5)  # fmt: skip
    left.set_ylabel("deflection δe [mm]")
    right.set_ylabel("change of the force |F* − F| [N]")
    left.legend(frameon=False, fontsize=9)
    return figure


def draw_trace(trace: Trace, names: Sequence[str], *, outline: ArrayLike | None = None) -> Figure:
    """Return a figure of a trace, as the thesis's Figs 4.23 and 4.24.

    Left what was wanted and what the model does, seen from the tip; right the pressures, step by
    step, with the steps that are out of reach shaded.

    Parameters
    ----------
    trace : Trace
    names : sequence of str
        The muscles, in the order of the design.
    outline : (k, 2) array_like, optional
        Boundary of the workspace [mm].

    Raises
    ------
    InputError
        If there are not as many names as muscles.
    """
    pressures = np.asarray(trace.pressures)
    if len(names) != pressures.shape[1]:
        raise InputError(f"there are {len(names)} names: give {pressures.shape[1]}, one a muscle")
    figure, (plane, axes) = make_panels(1, 2, width_ratios=(1.0, 1.25))
    if outline is not None:
        edge = check_points("outline", outline, dim=2)
        plane.fill(*edge.T, facecolor="#eef2f6", edgecolor="#a9b4bf", linewidth=1.0)
    plane.plot(*trace.targets.T, color=AMBER, linewidth=3.4, alpha=0.55, label="wanted")
    plane.plot(*trace.achieved.T, color=INK, linewidth=1.3, label="achieved")
    lost = ~np.asarray(trace.reachable, dtype=np.bool_)
    if lost.any():
        plane.plot(*trace.targets[lost].T, "x", color=RED, markersize=4.5, label="out of reach")
    plane.plot(*trace.achieved[0], "o", color=INK, markersize=5.5)
    plane.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    plane.set_adjustable("datalim")
    plane.legend(frameon=False, fontsize=9, loc="best")
    worst = trace.reachable_error
    title = f"largest error {f'{worst:.2g}' if worst > _SMALL else f'below {_SMALL:g}'} mm"
    if lost.all():
        title = "nothing in reach"
    if lost.any():
        title += f"\n{np.count_nonzero(lost)} of {len(lost)} out of reach, by up to "
        title += f"{trace.largest_error:.2g} mm"
    plane.set_title(title, fontsize=10, loc="left")
    steps = np.arange(len(pressures))
    for k, (name, color) in enumerate(pick_colors(names).items()):
        axes.plot(
            steps, 1e3 * pressures[:, k], color=color, linewidth=1.7, label=name,
            linestyle=DASHES[k % len(DASHES)],
        )  # fmt: skip
    for begin, end in _find_runs(lost):
        axes.axvspan(begin - 0.5, end - 0.5, color="#f6e0de", lw=0, zorder=0)
    axes.set(xlabel="step", ylabel=_PRESSURE, xlim=(0, max(1, len(steps) - 1)))
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, fontsize=9, ncols=3)
    axes.set_title(f"pressures, {trace.pressure_map}", fontsize=10, loc="left")
    return figure


def _evaluate(fit: CubicFit, pressure: Floats) -> Floats:
    return np.asarray(fit.find_lateral(np.clip(pressure, fit.start, fit.limit)))


def _group_lines(lines: Mapping[str, Floats]) -> list[list[str]]:
    """Return the names of equal lines together."""
    groups: list[list[str]] = []
    for name, line in lines.items():
        for group in groups:
            if np.allclose(lines[group[0]], line, rtol=0.0, atol=1e-9):
                group.append(name)
                break
        else:
            groups.append([name])
    return groups


def _find_runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return begin and end of every run of true values."""
    padded = np.concatenate([[False], flags, [False]]).astype(np.int8)
    edges = np.flatnonzero(np.diff(padded))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


_FAINT = "#8a97a5"


def draw_force(
    effector: Effector,
    *,
    lateral: ArrayLike = (0.0, 0.0),
    pressures: ArrayLike | Mapping[str, ArrayLike] | None = None,
    points: int = 361,
) -> Figure:
    """Return a figure of what the tip can press with and withstand, over the direction.

    Left the largest force of the tip while something holds it at `lateral`, right the lateral
    stiffness ``d . K d`` for a displacement in direction ``d``, passive and under `pressures`.

    Parameters
    ----------
    effector : Effector
    lateral : (2,) array_like
        Where the tip is held [mm].
    pressures : (m,) array_like or mapping, optional
        Pressures [MPa] for the stiffness; those that bring the tip to `lateral` by default.
    points : int
        Directions.

    Raises
    ------
    InputError
        If an argument is outside its legal range.
    """
    from ..effector import solve_inverse, tip_force, tip_stiffness

    points = check_integer("points", points, low=4, high=1_000_000)
    place = check_points("lateral", lateral, dim=2)
    angle = np.linspace(0.0, 2.0 * math.pi, points)
    toward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = tip_force(effector, toward, lateral=place)
    if pressures is None:
        pressures = solve_inverse(effector, place).pressures
    matrix = tip_stiffness(effector, pressures)
    if matrix.shape != (2, 2):
        raise InputError(f"pressures are a batch of shape {matrix.shape[:-2]}: give one set")
    passive = tip_stiffness(effector, np.zeros(len(effector.design.muscles)))
    figure = Figure(figsize=(9.6, 4.6), facecolor="white", layout="constrained")
    polar: list[Any] = [figure.add_subplot(1, 2, k, projection="polar") for k in (1, 2)]
    force, stiff = polar
    force.plot(angle, found.force, color=INK, linewidth=1.8)
    if found.force.max() > 0.0:
        force.fill(angle, found.force, color="#dfe8f1")
        force.set_ylim(bottom=0.0)
    else:
        force.set_ylim(0.0, 1.0)
        force.text(0.5, 0.25, "no force in any direction", transform=force.transAxes, ha="center",
                   fontsize=9.5, color=INK)  # fmt: skip
    for k, (name, color) in enumerate(pick_colors(effector.design.names).items()):
        place_of = float(effector.design.angles[k])
        tall = float(tip_force(effector, [math.cos(place_of), math.sin(place_of)],
                               lateral=place).force)  # fmt: skip
        force.plot([place_of, place_of], [0.0, tall], color=color, linewidth=2.0, label=name)
    force.legend(frameon=False, fontsize=9, loc="lower left", bbox_to_anchor=(-0.12, -0.08))
    force.set_title(
        f"largest force [N], tip held at {place[0]:g}, {place[1]:g} mm", fontsize=10, loc="left"
    )
    shown: list[tuple[Floats, str, Look]] = [
        (passive, "without pressure", {"color": _FAINT, "linestyle": DASHES[1]})
    ]
    if not np.array_equal(matrix, passive):
        shown.append((matrix, "under pressure", {"color": BLUE}))
    for tensor, label, look in shown:
        value = np.einsum("ni,ij,nj->n", toward, tensor, toward)
        stiff.plot(angle, value, linewidth=1.8, label=label, **look)
    stiff.set_ylim(bottom=0.0)
    stiff.legend(frameon=False, fontsize=9, loc="lower left", bbox_to_anchor=(-0.12, -0.08))
    stiff.set_title("lateral stiffness of the tip [N/mm]", fontsize=10, loc="left")
    for axes in polar:
        axes.grid(color=GRID, linewidth=0.8)
        axes.tick_params(labelsize=8.5)
        axes.set_rlabel_position(_find_free_angle(effector))
        top = float(axes.get_ylim()[1])
        axes.set_rticks([r for r in MaxNLocator(4).tick_values(0.0, top) if 0.0 < r <= top])
    if not found.force.max() > 0.0:
        force.set_rticks([])
    return figure


def _find_free_angle(effector: Effector) -> float:
    """Return the middle of the largest gap between muscles [degrees], for numbers to stand in."""
    angles = np.sort(np.mod(np.asarray(effector.design.angles), 2.0 * math.pi))
    gaps = np.diff(angles, append=angles[0] + 2.0 * math.pi)
    widest = int(np.argmax(gaps))
    return math.degrees(angles[widest] + 0.5 * gaps[widest])


def draw_sweep(sweep: Sweep) -> Figure:
    """Return a figure of a sweep over the first parameter, a line for each value of the others.

    Left what every direction has and what a muscle alone does, right the pressure that the wanted
    deflection needs, or the area if none was asked for. Designs that do not work are crosses at
    the foot; numbers of parameters are in the units of the library (mm, N, MPa, rad).

    Parameters
    ----------
    sweep : Sweep
    """
    from ..effector.study import find_quantity, name_column

    first, *others = sweep.parameters
    known = find_quantity(first)
    unit = known.unit.replace("^2", "²") if known else ""
    columns, labels = sweep.list_columns(), []
    place = np.array(columns[name_column(first)])
    if place.dtype.kind not in "iuf":
        words = [_format(row.changes[first]) for row in sweep.rows]
        labels = list(dict.fromkeys(words))
        place = np.array([labels.index(word) for word in words])
    keys = list(zip(*(columns[name_column(name)] for name in others), strict=True))
    keys = keys or [()] * len(place)
    figure, (left, right) = make_panels(1, 2)
    wanted = sweep.deflection > 0.0
    failed = place[~np.array(columns["feasible"], dtype=np.bool_)]
    for k, values in enumerate(dict.fromkeys(keys)):
        name = ", ".join(f"{key} {_format(v)}" for key, v in zip(others, values, strict=True))
        # A design that only needs more pressure than is legal has all its numbers.
        built = [i for i, row in enumerate(sweep.rows) if keys[i] == values and row.built]
        for axes, column, dash in (
            (left, "largest_amplitude_mm", DASHES[0]),
            (left, "inner_radius_mm", DASHES[1]),
            (right, "needed_pressure_MPa" if wanted else "area_mm2", DASHES[0]),
        ):
            heights = np.array([columns[column][i] for i in built], dtype=np.float64)
            heights *= 1e3 if column.endswith("MPa") else 1.0
            axes.plot(
                place[built],
                heights if axes is left else np.where(heights > 0.0, heights, np.nan),
                marker="o",
                linestyle=dash,
                markersize=3.5,
                color=COLORS[k % len(COLORS)],
                linewidth=1.5,
                label=name if axes is right else None,
            )
    for axes in (left, right):
        axes.set_xlabel(f"{first} [{unit}]" if unit else first)
        top = float(axes.dataLim.y1)
        axes.set_ylim(0.0, 1.06 * top if 0.0 < top < np.inf else 1.0)
        if failed.size:
            axes.plot(failed, 0.0 * failed, "x", color=RED, markersize=6.0, clip_on=False, zorder=4)
        if labels:
            axes.set_xticks(range(len(labels)), labels, fontsize=8.5, rotation=12)
            axes.set_xlim(-0.4, len(labels) - 0.6)
    left.plot([], [], linestyle=DASHES[0], color=INK, label="largest of a muscle alone")
    left.plot([], [], linestyle=DASHES[1], color=INK, label="in every direction")
    left.set_ylabel("deflection [mm]")
    right.set_ylabel(
        f"pressure for {sweep.deflection:g} mm [kPa]" if wanted else "area of the workspace [mm²]"
    )
    left.legend(frameon=False, fontsize=8.5)
    if others:
        right.legend(frameon=False, fontsize=8.5)
    works = f"{len(sweep.feasible)} of {len(sweep.rows)} designs work"
    left.set_title(works, fontsize=10, loc="left")
    return figure


def _format(value: object) -> str:
    if isinstance(value, (tuple, list, np.ndarray)):
        return "/".join(f"{math.degrees(angle):g}°" for angle in value)
    return f"{value:g}" if isinstance(value, (int, float)) else str(value)


_FILL = "#dfe8f1"
_EDGE = "#7f93a8"
_PALE = "#a9b4bf"
_HOLDER = "#4a5866"


def draw_pose(
    effector: Effector,
    pose: EffectorPose,
    *,
    workspace: Workspace | None = None,
    target: ArrayLike | None = None,
) -> Figure:
    """Return a figure of one pose: in space, and seen from the tip over the workspace.

    A muscle that pulls alone is drawn where the linkage puts it. Otherwise the muscles are drawn
    beside the backbone, where they would lie if they did not drift: the model of several muscles
    does not give where they are.

    Parameters
    ----------
    effector : Effector
    pose : EffectorPose
        A single one, not a batch.
    workspace : Workspace, optional
        Drawn behind the view from the tip.
    target : (2,) array_like, optional
        Where the tip should be [mm].

    Raises
    ------
    InputError
        If `pose` is a batch.
    """
    tip = np.asarray(pose.tip, dtype=np.float64)
    if tip.shape != (3,):
        raise InputError(f"the pose has a tip of shape {tip.shape}: one pose is drawn, shape (3,)")
    design = effector.design
    figure = Figure(figsize=(10.4, 5.0), facecolor="white", layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=(1.15, 1.0))
    space: Axes3D = figure.add_subplot(grid[0], projection="3d")
    plane = figure.add_subplot(grid[1])
    colors = pick_colors(design.names)
    backbone, end = np.asarray(pose.backbone), np.asarray(pose.holder_tip)
    lines = _place_muscles(effector, pose)
    pressures = np.asarray(pose.pressures)
    for k, name in enumerate(design.names):
        active = pressures[k] > 0.0
        space.plot(
            *lines[k].T, color=colors[name], linewidth=2.2 if active else 1.0,
            alpha=1.0 if active else 0.55, label=f"{name}: {1e3 * pressures[k]:.1f} kPa",
        )  # fmt: skip
    space.plot(*backbone.T, color=INK, linewidth=2.4, label="backbone")
    space.plot(*np.stack([backbone[-1], end]).T, color=_HOLDER, linewidth=6.0,
               solid_capstyle="butt", label="distal holder")  # fmt: skip
    for frame in (lines[:, 0], lines[:, -1]):
        ring = np.concatenate([frame, frame[:1]])
        space.plot(*ring.T, color=_PALE, linewidth=0.9)
    fit_space(space, np.concatenate([backbone, end[None], *lines]), least=LEAST_SIDE, zoom=1.0)
    space.view_init(elev=20.0, azim=_turn_view(math.degrees(float(pose.azimuth)) - 65.0))
    _name_lines(space)

    if workspace is not None:
        _fill_workspace(plane, workspace)
    _draw_spokes(plane, effector, workspace)
    plane.plot(*backbone[:, :2].T, color=INK, linewidth=2.0)
    plane.plot(*np.stack([backbone[-1], end])[:, :2].T, color=_HOLDER, linewidth=5.0,
               solid_capstyle="butt")  # fmt: skip
    plane.plot(*tip[:2], "o", color=INK, markersize=6.0, zorder=5)
    if target is not None:
        plane.plot(*check_points("target", target, dim=2), "x", color=AMBER, markersize=9.0,
                   markeredgewidth=2.4, zorder=6, label="target")  # fmt: skip
        plane.legend(frameon=False, fontsize=9)
    style_axes(plane)
    plane.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    plane.margins(0.08)
    degrees = math.degrees(float(pose.azimuth)) % 360.0
    title = f"tip {float(pose.lateral):.2f} mm from the axis, at {degrees:.1f}°"
    if bool(pose.saturated):
        title += f"\nsaturated: {float(pose.demanded_lateral):.2f} mm demanded"
    plane.set_title(title, fontsize=10, loc="left")
    return figure


def _place_muscles(effector: Effector, pose: EffectorPose) -> Floats:
    """Return the lines of the muscles to draw, (m, n + 1, 3)."""
    from ..effector import bend

    design = effector.design
    backbone = np.asarray(pose.backbone, dtype=np.float64)
    frames = transport_frames(backbone)
    angles = np.asarray(design.angles)
    radial = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)
    lines = backbone[None] + design.offset * np.einsum("nij,mj->mni", frames, radial)
    pulling = np.flatnonzero(np.asarray(pose.force) > 0.0)
    if len(pulling) == 1:
        k = int(pulling[0])
        flat = np.asarray(bend(design, float(np.asarray(pose.contraction)[k])).muscle)
        lines[k] = flat[:, :1] * radial[k] + flat[:, 1:] * np.array([0.0, 0.0, 1.0])
    return np.asarray(lines, dtype=np.float64)


def transport_frames(line: Floats) -> Floats:
    """Return rotations (n, 3, 3) that follow a line from +z on without twist."""
    steps = np.diff(line, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    middles = steps[:-1] + steps[1:]
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    tangents = np.concatenate([[[0.0, 0.0, 1.0]], middles, steps[-1:]])
    frames = np.empty((len(tangents), 3, 3))
    frames[0] = np.eye(3)
    for j in range(1, len(tangents)):
        axis = np.cross(tangents[j - 1], tangents[j])
        cosine = float(tangents[j - 1] @ tangents[j])
        cross = np.cross(np.eye(3), axis)
        frames[j] = (np.eye(3) + cross + cross @ cross / (1.0 + cosine)) @ frames[j - 1]
    return frames


def _turn_view(degrees: float) -> float:
    """Return an azimuth to look from that is not along an axis, where its numbers would crowd."""
    beyond = degrees % 90.0
    return degrees - beyond + min(max(beyond, 25.0), 65.0)


def _name_lines(space: Axes3D) -> None:
    """Give a 3-D panel a legend in its corner, which takes no space from it."""
    legend = space.legend(frameon=False, fontsize=8.5, loc="upper left", bbox_to_anchor=(-0.2, 1.0))
    legend.set_in_layout(False)


def draw_workspace(effector: Effector, workspace: Workspace) -> Figure:
    """Return a figure of the workspace: seen from the tip with its sectors, and in space.

    Parameters
    ----------
    effector : Effector
    workspace : Workspace
        That of the effector.
    """
    from ..effector import place_tips

    figure = Figure(figsize=(10.4, 4.9), facecolor="white", layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=(1.0, 1.1))
    plane = figure.add_subplot(grid[0])
    space: Axes3D = figure.add_subplot(grid[1], projection="3d")
    _fill_workspace(plane, workspace)
    _draw_spokes(plane, effector, workspace)
    sectors, amplitudes = workspace.reach.sectors, workspace.reach.amplitudes
    for k in np.flatnonzero(sectors.covered):
        corner = workspace.sector_corners[k]
        for muscle in (sectors.order[k], sectors.order[(k + 1) % len(sectors.order)]):
            angle = effector.design.angles[muscle]
            side = amplitudes[muscle] * np.array([math.cos(angle), math.sin(angle)])
            plane.plot(*np.stack([side, corner]).T, color=_EDGE, linewidth=0.9,
                       linestyle=(0, (4, 2)))  # fmt: skip
    inner = workspace.inner_radius
    if inner > 0.0:
        ring = np.linspace(0.0, 2.0 * math.pi, 181)
        plane.plot(inner * np.cos(ring), inner * np.sin(ring), color=AMBER, linewidth=1.3,
                   label=f"every direction: {inner:.1f} mm")  # fmt: skip
        plane.legend(frameon=False, fontsize=9, loc="lower center", bbox_to_anchor=(0.5, -0.24))
    style_axes(plane)
    plane.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    plane.margins(0.1)
    limit = 1e3 * workspace.reach.pressure_limit
    plane.set_title(f"{workspace.area:.0f} mm² at {limit:.0f} kPa", fontsize=10, loc="left")

    shares = np.linspace(0.0, 1.0, 13)[:, None, None]
    outline = _subdivide(np.concatenate([workspace.boundary, workspace.boundary[:1]]))
    surfaces = place_tips(effector.design, shares * outline)
    for surface, color, name in zip(
        surfaces, (BLUE, _HOLDER), ("end of the backbone", "end of the holder"), strict=True
    ):
        if workspace.area > 0.0:  # a single muscle has a line
            stride = max(1, len(outline) // 60)
            space.plot_surface(*np.moveaxis(surface, -1, 0), color=color, alpha=0.3, rstride=2,
                               cstride=stride, linewidth=0.3, edgecolor=color)  # fmt: skip
        space.plot(*surface[-1].T, color=color, linewidth=1.6, label=name)
    length = effector.design.backbone_length
    ends = np.array([length, length + effector.design.holder_length])
    space.plot(0.0 * ends, 0.0 * ends, ends, color=INK, linewidth=3.0, label="holder at rest")
    every = np.concatenate([*surfaces]).reshape(-1, 3)
    fit_space(space, every, least=LEAST_SIDE, zoom=1.2)
    space.view_init(elev=28.0, azim=-60.0)
    _name_lines(space)
    return figure


def _subdivide(line: Floats, pieces: int = 240) -> Floats:
    """Return a line with more points, so that no step is long beside the whole."""
    steps = np.hypot(*np.diff(line, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    places = np.unique(np.concatenate([along, np.linspace(0.0, along[-1], pieces)]))
    return np.stack([np.interp(places, along, line[:, k]) for k in range(2)], axis=-1)


def _fill_workspace(axes: Axes, workspace: Workspace) -> None:
    axes.fill(*workspace.boundary.T, facecolor=_FILL, edgecolor=_EDGE, linewidth=1.2, zorder=0)


def _draw_spokes(axes: Axes3D, effector: Effector, workspace: Workspace | None) -> None:
    """Draw the direction of each muscle, as far as it deflects alone, and its name."""
    from ..effector import find_reach

    amplitudes = (find_reach(effector) if workspace is None else workspace.reach).amplitudes
    angles = effector.design.angles
    far = float(np.max(amplitudes, initial=effector.design.offset))
    for k, (name, color) in enumerate(pick_colors(effector.design.names).items()):
        along = np.array([math.cos(angles[k]), math.sin(angles[k])])
        axes.plot(*np.stack([0.0 * along, amplitudes[k] * along]).T, color=color, linewidth=1.8)
        beside = 0.09 * far * np.array([-along[1], along[0]])
        spot = (amplitudes[k] + 0.07 * far) * along + beside
        axes.update_datalim([spot])
        axes.text(
            *spot, name, color=color, fontsize=11,
            fontweight="bold", ha="center", va="center",
        )  # fmt: skip

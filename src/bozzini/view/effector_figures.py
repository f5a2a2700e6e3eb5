"""Figures of the effector: a pose, and the workspace.

Drawn with matplotlib's objects only (no pyplot). Every function returns a `Figure`, which
`bozzini.view.write_figure` writes. Lengths are in mm, angles shown in degrees.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from ..checks import check_points
from ..errors import InputError
from .effector_curves import (
    BLUE,
    draw_deflection,
    draw_iteration,
    draw_trace,
    pick_colors,
    style_axes,
)
from .effector_force import draw_force
from .effector_sweep import draw_sweep
from .palette import AMBER, INK

if TYPE_CHECKING:
    from ..effector import Effector, EffectorPose, Workspace

__all__ = [
    "draw_deflection",
    "draw_force",
    "draw_iteration",
    "draw_pose",
    "draw_sweep",
    "draw_trace",
    "draw_workspace",
]

Floats = NDArray[np.float64]

_FILL = "#dfe8f1"
_EDGE = "#7f93a8"
_FAINT = "#a9b4bf"
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
    does not say where they are.

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
    space: Any = figure.add_subplot(grid[0], projection="3d")
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
        space.plot(*ring.T, color=_FAINT, linewidth=0.9)
    _fit_box(space, np.concatenate([backbone, end[None], *lines]))
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


def _name_lines(space: Any) -> None:
    """Give a 3-D panel a legend in its corner, which takes no room from it."""
    legend = space.legend(frameon=False, fontsize=8.5, loc="upper left", bbox_to_anchor=(-0.2, 1.0))
    legend.set_in_layout(False)


def _fit_box(space: Any, points: Floats, *, least: float = 26.0, zoom: float = 1.0) -> None:
    """Give a 3-D panel equal scales, and sides of at least `least` mm."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * np.maximum(1.04 * (high - low), least)
    for k, name in enumerate("xyz"):
        getattr(space, f"set_{name}lim")(middle[k] - half[k], middle[k] + half[k])
        axis = getattr(space, f"{name}axis")
        axis.get_major_locator().set_params(nbins=5)
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
    space.set_box_aspect(2.0 * half, zoom=zoom)
    space.tick_params(labelsize=8.5)
    space.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")


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
    space: Any = figure.add_subplot(grid[1], projection="3d")
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
    _fit_box(space, np.concatenate([*surfaces]).reshape(-1, 3), zoom=1.2)
    space.view_init(elev=28.0, azim=-60.0)
    _name_lines(space)
    return figure


def _subdivide(line: Floats, pieces: int = 240) -> Floats:
    """Return a line with more points, so that no step is long beside the whole."""
    steps = np.hypot(*np.diff(line, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    places = np.unique(np.concatenate([along, np.linspace(0.0, along[-1], pieces)]))
    return np.stack([np.interp(places, along, line[:, k]) for k in range(2)], axis=-1)


def _fill_workspace(axes: Any, workspace: Workspace) -> None:
    axes.fill(*workspace.boundary.T, facecolor=_FILL, edgecolor=_EDGE, linewidth=1.2, zorder=0)


def _draw_spokes(axes: Any, effector: Effector, workspace: Workspace | None) -> None:
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

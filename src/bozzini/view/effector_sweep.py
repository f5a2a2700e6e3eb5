"""Figure of a sweep over designs of the effector; see `bozzini.view.effector_figures`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from .effector_curves import DASHES, PALETTE, make_panels
from .palette import INK, RED

if TYPE_CHECKING:
    from ..effector import Sweep, SweepRow

__all__ = ["draw_sweep"]

UNITS = {
    **dict.fromkeys(("offset", "length", "backbone_length", "holder_length"), "mm"),
    **dict.fromkeys(("flexural_rigidity", "catheter_rigidity"), "N mm²"),
    **dict.fromkeys(("pressure_limit", "muscle.modulus", "muscle.strand_modulus"), "MPa"),
    "muscle.braid_angle": "rad",
    **{
        f"muscle.{name}": "mm"
        for name in ("outer_radius", "inner_radius", "gap", "strand_radius", "end_length",
                     "dead_length", "friction_length")
    },
}  # fmt: skip


def draw_sweep(sweep: Sweep) -> Figure:
    """Return a figure of a sweep over the first parameter, a line for each value of the others.

    Left what every direction has and what a muscle alone does, right the pressure that the wanted
    deflection needs, or the area if none was asked for. Designs that do not work are crosses at
    the foot; numbers of parameters are in the units of the library (mm, N, MPa, rad).

    Parameters
    ----------
    sweep : Sweep
    """
    first, *others = sweep.parameters
    over, labels = _number([row.changes[first] for row in sweep.rows])
    groups: dict[str, list[int]] = {}
    for index, row in enumerate(sweep.rows):
        name = ", ".join(f"{key} {_tell(row.changes[key])}" for key in others)
        groups.setdefault(name, []).append(index)
    figure, (left, right) = make_panels(2)
    wanted = sweep.deflection > 0.0
    failed = over[[not row.feasible for row in sweep.rows]]
    for k, (name, members) in enumerate(groups.items()):
        rows = [sweep.rows[i] for i in members]
        # A design that only needs more pressure than is legal has all its numbers.
        shown = np.array([row.built for row in rows], dtype=np.bool_)
        place = over[members]
        for axes, quantity, dash in (
            (left, "largest_amplitude", DASHES[0]),
            (left, "inner_radius", DASHES[1]),
            (right, "needed_pressure" if wanted else "area", DASHES[0]),
        ):
            values = _take(rows, quantity)
            # 0 is no pressure: none reaches the deflection. The line ends there.
            some = shown if axes is left else values > 0.0
            heights = np.where(some, values, np.nan)
            axes.plot(
                place[shown], heights[shown], marker="o", linestyle=dash, markersize=3.5,
                color=PALETTE[k % len(PALETTE)], linewidth=1.5,
                label=name if axes is right else None,
            )  # fmt: skip
    for axes in (left, right):
        axes.set_xlabel(f"{first} [{UNITS[first]}]" if first in UNITS else first)
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


def _number(values: list[Any]) -> tuple[Any, list[str]]:
    """Return places on an axis, and labels if the values are no numbers."""
    if all(isinstance(value, (int, float)) for value in values):
        return np.array(values, dtype=np.float64), []
    names = list(dict.fromkeys(_tell(value) for value in values))
    return np.array([names.index(_tell(value)) for value in values], dtype=np.float64), names


def _tell(value: Any) -> str:
    if isinstance(value, (tuple, list, np.ndarray)):
        return "/".join(f"{math.degrees(angle):g}°" for angle in value)
    return f"{value:g}" if isinstance(value, (int, float)) else str(value)


def _take(rows: list[SweepRow], quantity: str) -> Any:
    scale = 1e3 if quantity == "needed_pressure" else 1.0
    return scale * np.array([getattr(row, quantity) for row in rows])

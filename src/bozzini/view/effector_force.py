"""Figure of what the effector's tip presses with and withstands, over the direction.

`bozzini.view.effector_figures` has all figures of the effector in one place.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from ..checks import check_integer, check_points
from ..errors import InputError
from .effector_curves import BLUE, DASHES, GRID, pick_colors
from .palette import INK

if TYPE_CHECKING:
    from ..effector import Effector

__all__ = ["draw_force"]

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
    shown: list[tuple[Any, str, dict[str, Any]]] = [
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

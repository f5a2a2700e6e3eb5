"""The lumen's inscribed radius along the tract, beside the scope's own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..motion.plan import Plan
from .claim import read_claim
from .palette import AMBER, INK, RED
from .records import ceil_mm, read_number
from .sampling import find_radius
from .way import RefusalMark, Way

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_radius"]

_BLUE = "#1f5fa8"


def draw_radius(
    axes: Axes,
    plan: Plan,
    way: Way,
    *,
    mark: RefusalMark | None,
    summary: Mapping[str, Any],
    legend: Axes,
) -> None:
    """Draw radius across, place along the tract upwards; what stands in the way is marked.

    Parameters
    ----------
    axes : Axes
        The panel; its vertical axis is the place along the tract [mm].
    plan : Plan
    way : Way
        The whole way; its radius is drawn to the goal, also where the plan ends before.
    mark : RefusalMark or None
    summary : mapping
        `passage_mm` is drawn if it is there.
    legend : Axes
        Empty axes to write the legend into.
    """
    axes.fill_betweenx(way.arc_length, 0.0, way.radius, color="#d7e3ee", lw=0)
    name = "lumen on the centreline" if way.is_centreline else "lumen on the head's path"
    handles = axes.plot(way.radius, way.arc_length, color=_BLUE, linewidth=1.4, label=name)
    largest = float(way.radius.max())
    if way.is_centreline:
        soft = read_claim(plan, summary).soft
        room = plan.path_radius - (0.0 if soft is None else soft.used)  # to the wall at rest
        handles += axes.plot(
            room, way.place(plan.path_arc_length), color="#6f7d8a", linewidth=1.1,
            linestyle=(0, (3, 1.2)), label="… on the head's path",
        )  # fmt: skip
        largest = max(largest, float(room.max()))
    scope = find_radius(plan)
    if scope > 0.0:
        handles.append(
            axes.axvline(
                scope, color=RED, linewidth=1.6, linestyle=(0, (5, 2)),
                label=f"the scope's, {scope:g} mm",
            )
        )  # fmt: skip
        axes.fill_betweenx(
            way.arc_length, 0.0, scope, where=way.radius < scope, color=RED, alpha=0.4, lw=0
        )
    passage = read_number(summary, "passage_mm")
    if passage is not None and passage > 0.0:
        handles.append(
            axes.axvline(
                passage, color=INK, linewidth=1.4, linestyle=(0, (1, 1.5)),
                label=f"passage, at most {ceil_mm(passage)} mm",
            )
        )  # fmt: skip
    if mark is not None and mark.needs is not None and mark.offers is not None:
        offers = max(0.0, mark.offers)
        axes.plot((offers, mark.needs), (mark.at, mark.at), color=AMBER, lw=3.0, clip_on=False)
        axes.plot(offers, mark.at, "o", color=AMBER, markersize=5, clip_on=False)
        handles += axes.plot(
            mark.needs, mark.at, "x", color=AMBER, markersize=9, markeredgewidth=2.4,
            linestyle="none", label="needs (✕), offers (●)", clip_on=False,
        )  # fmt: skip
        largest = max(largest, mark.needs)
    axes.set_xlim(0.0, 1.05 * max(largest, scope, 1e-9))
    axes.set_xlabel("inscribed radius [mm]")
    axes.tick_params(labelleft=False)
    legend.set_axis_off()
    legend.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(-0.03, -0.04), fontsize=8.5,
        frameon=False, borderpad=0.0, labelspacing=0.35, handlelength=1.9, handletextpad=0.6,
    )  # fmt: skip

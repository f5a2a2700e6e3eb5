"""Contact with a soft wall: where along the tract the body stands beyond it, and how deep."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from .clearance import choose_abscissa
from .plan_data import (
    find_radius,
    read_centreline,
    sample_motion,
)
from .style import AMBER, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

    from ..duct.field import SampledField
    from ..motion.plan import Plan

_ROWS = 240
_FRACTIONS = 33
_DEPTHS = ["#ffe9c7", "#f0a030", "#a04000", "#3f1400"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Contact:
    """How deep the body stands beyond the wall at rest, by place and moment.

    Parameters
    ----------
    over : (k,) float
        Insertion [mm] of each sampled moment, or its step number if the scope goes back and forth.
    label : str
        What `over` is.
    places : (rows,) float
        Arc length along the tract of the middle of each stretch [mm].
    depth : (rows, k) float
        Deepest contact in the stretch at the moment [mm]; 0 where there is none.
    length : float
        Length of the tract [mm].
    """

    over: NDArray[np.float64]
    label: str
    places: NDArray[np.float64]
    depth: NDArray[np.float64]
    length: float

    @property
    def deepest(self) -> NDArray[np.float64]:
        """Deepest contact ``(rows,)`` [mm] at each place over the whole motion."""
        result: NDArray[np.float64] = self.depth.max(axis=1)
        return result

    @property
    def touched(self) -> float:
        """Length of the tract that is touched at any time [mm]."""
        return float((self.deepest > 0.0).mean() * self.length)


def measure_contact(plan: Plan, field: SampledField, *, count: int = 300) -> Contact:
    """Return where and how deep the body of a scope stands beyond the wall at rest.

    Parameters
    ----------
    plan : Plan
        Its clearances are those to the wall at rest: links below 0 are looked at closely, and
        the deepest point of each has the clearance of the plan.
    field : SampledField
        The lumen at rest.
    count : int
        Moments sampled.

    Raises
    ------
    InputError
        If the plan's arrays do not fit each other.
    """
    sample = sample_motion(plan, count=count)
    length = read_centreline(plan).length
    depth = np.zeros((_ROWS, len(sample.steps)))
    row, link = np.nonzero(sample.visible < 0.0)
    if len(row):
        fractions = np.linspace(0.0, 1.0, _FRACTIONS)
        ends = sample.joints[row, link], sample.joints[row, link + 1]
        points = ends[0][:, None] + fractions[:, None] * (ends[1] - ends[0])[:, None]
        found = find_radius(plan) + field.signed_distance(points)
        front, back = sample.places[row, link], sample.places[row, link + 1]
        places = front[:, None] + fractions * (back - front)[:, None]
        found = np.where(places >= 0.0, found, 0.0)
        deepest = -sample.clearance[row, link]
        found = np.clip(found, 0.0, deepest[:, None])
        # The plan looked more closely: where a link is deepest, its own value counts.
        found[np.arange(len(row)), found.argmax(axis=1)] = deepest
        # A fine line between samples, so that no stretch under a touching link is skipped.
        finer = np.linspace(0.0, 1.0, 4 * (_FRACTIONS - 1) + 1)
        for k in range(len(row)):
            rows = np.interp(finer, fractions, places[k]) / length * _ROWS
            rows = np.clip(rows.astype(np.int64), 0, _ROWS - 1)
            np.maximum.at(depth[:, row[k]], rows, np.interp(finer, fractions, found[k]))
    over, label = choose_abscissa(sample)
    middles = (np.arange(_ROWS) + 0.5) * length / _ROWS
    return Contact(over=over, label=label, places=middles, depth=depth, length=length)


def draw_contact(
    plan: Plan, field: SampledField, *, used: float | None = None, allowed: float | None = None
) -> Figure:
    """Return a figure of contact with a soft wall: along the tract, and over the insertion.

    Parameters
    ----------
    plan : Plan
    field : SampledField
        The lumen at rest.
    used, allowed : float, optional
        How far the wall was taken as displaced, and how far it may be [mm]; drawn as lines.

    Raises
    ------
    InputError
        If the plan's arrays do not fit each other.
    """
    contact = measure_contact(plan, field)
    highest = max(float(contact.depth.max()), 0.05)
    figure = Figure(figsize=(11.6, 4.4), facecolor="white")
    left = figure.add_axes((0.07, 0.13, 0.53, 0.81))
    bar_axes = figure.add_axes((0.612, 0.13, 0.012, 0.81))
    right = figure.add_axes((0.715, 0.13, 0.265, 0.81), sharey=left)
    image = _draw_depths(left, contact, highest)
    bar = figure.colorbar(image, cax=bar_axes)
    bar.outline.set_visible(False)
    bar.set_label("wall pushed outwards [mm]", color=INK)
    _draw_deepest(right, contact, {"used": used, "allowed": allowed}, highest)
    for axes in (left, right):
        axes.grid(color="#e3e8ed", linewidth=0.8)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _draw_depths(axes: Axes, contact: Contact, highest: float) -> AxesImage:
    from matplotlib.colors import LinearSegmentedColormap

    edge = 0.5 * (contact.over[-1] - contact.over[0]) / max(len(contact.over) - 1, 1) or 0.5
    image = axes.imshow(
        np.ma.masked_less_equal(_even(contact), 0.0),
        origin="lower",
        extent=(contact.over[0] - edge, contact.over[-1] + edge, 0.0, contact.length),
        cmap=LinearSegmentedColormap.from_list("contact", _DEPTHS),
        vmin=0.0,
        vmax=highest,
        aspect="auto",
        interpolation="nearest",
    )
    axes.set_facecolor("#f4f6f8")
    axes.set_xlabel(contact.label)
    axes.set_ylabel("place along the tract [mm]")
    return image


def _draw_deepest(
    axes: Axes, contact: Contact, limits: Mapping[str, float | None], highest: float
) -> None:
    deepest = contact.deepest
    axes.fill_betweenx(contact.places, 0.0, deepest, color="#f0a030", lw=0)
    axes.plot(deepest, contact.places, color="#a04000", linewidth=1.2)
    known = {name: value for name, value in limits.items() if value is not None and value > 0.0}
    width = 1.12 * max([highest, *known.values()])
    drawn = sorted(known.items(), key=lambda item: item[1])
    for (name, value), dash in zip(drawn, ((0, (2, 1.5)), (0, (6, 2))), strict=False):
        axes.axvline(value, color=AMBER, linewidth=1.6, linestyle=dash)
        axes.text(
            value, 1.005, name, color=AMBER, fontsize=9, va="bottom",
            ha="center" if value < 0.85 * width else "right", transform=axes.get_xaxis_transform(),
        )  # fmt: skip
    axes.set_xlim(0.0, width)
    axes.set_ylim(0.0, contact.length)
    axes.set_xlabel("deepest contact [mm]")
    axes.tick_params(labelleft=False)
    worst = int(np.argmax(deepest))
    if not deepest[worst] > 0.0:
        axes.text(0.5, 0.5, "no contact", transform=axes.transAxes, ha="center", color=INK)
        return
    high, wide = contact.places[worst] > 0.8 * contact.length, deepest[worst] > 0.5 * width
    axes.annotate(
        f"{deepest[worst]:.2f} mm at {contact.places[worst]:.0f} mm",
        (deepest[worst], contact.places[worst]),
        xytext=(-4 if wide else 4, -10 if high else 10),
        textcoords="offset points",
        color=INK,
        fontweight="bold",
        ha="right" if wide else "left",
        va="top" if high else "bottom",
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5},
    )


def _even(contact: Contact) -> NDArray[np.float64]:
    """Return the depth on evenly spaced moments: each column the sampled moment nearest to it."""
    columns = np.linspace(contact.over[0], contact.over[-1], len(contact.over))
    nearest = np.abs(columns[:, None] - contact.over[None]).argmin(axis=1)
    return contact.depth[:, nearest]

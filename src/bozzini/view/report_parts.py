"""Parts of the report that are drawn: the slider's pictures, contact, methods side by side."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..motion.plan import Plan
from .claim import Claim, read_claim
from .end_marks import list_marks
from .fluoroscopy import Projection
from .scope_drawing import MARK, REST, choose_bar_length
from .viewer_data import encode_picture
from .way import Way, find_refusal, share_centreline

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..duct.field import SampledField

__all__ = ["encode_figure", "render_comparison", "render_contact", "render_panel"]


def render_panel(picture: Projection, plan: Plan, way: Way, summary: Mapping[str, Any]) -> str:
    """Return one picture of the slider, with the way not reached, its scale bar and letters."""
    left, right, bottom, top = picture.labels
    bar = choose_bar_length(picture.width)
    return (
        f'<div class="panel" style="flex:{picture.width:.3f} 1 0">'
        f'<img src="{encode_picture(picture)}" alt="{picture.axis} view of the lumen">'
        f'<span class="name">{picture.axis}</span><span class="l">{left}</span>'
        f'<span class="r">{right}</span><span class="t">{top}</span><span class="b">{bottom}</span>'
        f'<span class="bar" style="width:{100.0 * bar / picture.width:.2f}%">{bar:g} mm</span>'
        f"{_render_marks(picture, plan)}{_render_rest(picture, plan, way, summary)}"
        "<canvas></canvas></div>"
    )


def _render_marks(picture: Projection, plan: Plan) -> str:
    """Return the ends of the tract as numbered rings, "" where the plan records none."""
    marks = list_marks(plan)
    if not marks:
        return ""
    corner = np.array([picture.extent[0], picture.extent[3]])
    size = 0.012 * picture.height
    parts = [
        f'<svg viewBox="0 0 {picture.width:.2f} {picture.height:.2f}" fill="none" '
        f'stroke="{MARK}" stroke-width="{0.25 * size:.2f}" aria-hidden="true">'
    ]
    for mark in marks:
        u, v = (picture.project(mark.point) - corner) * [1.0, -1.0]
        parts.append(
            f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{size:.2f}"/><text x="{u + 1.4 * size:.1f}" '
            f'y="{v + 0.8 * size:.1f}" fill="{MARK}" stroke="none" font-size="{2.4 * size:.1f}">'
            f"{mark.number}</text>"
        )
    return "".join(parts) + "</svg>"


def _render_rest(picture: Projection, plan: Plan, way: Way, summary: Mapping[str, Any]) -> str:
    """Return the way that was not reached, and the refusal's place, as an overlay."""
    if plan.status != "stopped":
        return ""
    reached = max(0.0, float(way.place(plan.head_arc_length).max()))
    corner = np.array([picture.extent[0], picture.extent[3]])
    size = 0.018 * picture.height
    parts = [
        f'<svg viewBox="0 0 {picture.width:.2f} {picture.height:.2f}" fill="none" '
        f'stroke="{REST}" stroke-linecap="round" aria-hidden="true">'
    ]
    rest = way.cut_rest(reached)
    if len(rest):
        place = (picture.project(rest) - corner) * [1.0, -1.0]
        points = " ".join(f"{u:.1f},{v:.1f}" for u, v in place)
        parts.append(
            f'<polyline points="{points}" stroke-width="{0.4 * size:.2f}" '
            f'stroke-dasharray="0 {1.1 * size:.2f}"/>'
        )
    mark = find_refusal(plan, summary)
    if mark is not None:
        u, v = (picture.project(way.locate(mark.at)) - corner) * [1.0, -1.0]
        cross = (
            f"M{u - size:.1f} {v - size:.1f}l{2 * size:.1f} {2 * size:.1f}"
            f"m0 {-2 * size:.1f}l{-2 * size:.1f} {2 * size:.1f}"
        )
        parts.append(f'<path d="{cross}" stroke="#05080c" stroke-width="{1.1 * size:.2f}"/>')
        parts.append(f'<path d="{cross}" stroke-width="{0.6 * size:.2f}"/>')
    return "".join(parts) + "</svg>"


def render_contact(plan: Plan, field: SampledField, claim: Claim) -> str:
    """Return the section on contact with a soft wall, "" where the wall is rigid."""
    if claim.soft is None:
        return ""
    from .contact_plot import draw_contact, measure_contact

    contact = measure_contact(plan, field)
    share = 100.0 * contact.touched / contact.length
    image = encode_figure(
        draw_contact(plan, field, used=claim.soft.used, allowed=claim.soft.allowed), dpi=130.0
    )
    return (
        "<h2>Contact</h2><p>Where the body stands beyond the wall at rest, and by how much: left "
        "at every moment, right the deepest at each place. About "
        f"{contact.touched:.0f} mm of the tract ({share:.0f} %) are touched at some time.</p>"
        f'<figure><img src="{image}" alt="Depth of contact along the tract"></figure>'
    )


def render_comparison(plan: Plan, summary: Mapping[str, Any], comparison: Sequence[Plan]) -> str:
    """Return the section that puts methods side by side, "" where there is nothing to compare."""
    from .comparison import list_methods, render_methods
    from .comparison_plot import draw_comparison

    records = summary.get("comparison") or ()
    if not isinstance(records, Sequence) or isinstance(records, str):
        records = ()
    if not comparison and not records:
        return ""
    soft = read_claim(plan, summary).soft is not None
    first, *plans = share_centreline([plan, *comparison])
    if not soft and plan.method not in (other.method for other in plans):
        plans.insert(0, first)
    rows = list_methods(plans, records)
    figure = ""
    if comparison:
        image = encode_figure(draw_comparison(plans, records=rows), dpi=130.0)
        figure = f'<figure><img src="{image}" alt="Clearance and movement by method"></figure>'
    rigid = " against the wall at rest, taken as rigid" if soft else ""
    return (
        f"<h2>Methods side by side</h2><p>The same scope and tract, planned by each method{rigid}. "
        "A clearance is proved or an estimate, as it says; joint movement is the sum over all "
        "joints and steps, against a chain pulled freely along the same head path (no wall "
        "holds it back) and one whose joints all follow that path.</p>"
        f"{render_methods(rows)}{figure}"
    )


def encode_figure(figure: Figure, *, dpi: float) -> str:
    """Return a figure as a ``data:`` address of a PNG."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dpi, facecolor=figure.get_facecolor())
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode("ascii")

"""The words and numbers of the report, as escaped HTML fragments."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from ..motion.plan import Plan
from .sampling import find_link_length, find_radius

if TYPE_CHECKING:
    from ..anatomy.findings import Finding
    from ..duct.field import SampledField

__all__ = [
    "list_limitations",
    "list_rows",
    "render_cards",
    "render_findings",
    "render_table",
]

_MINUS = "\N{MINUS SIGN}"


def _show(value: Any, digits: int, unit: str = "") -> str:
    """Return a number for reading, or a dash where there is none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}f}".replace("-", _MINUS)
    return f"{text} {unit}".strip()


def _read_step_ratio(summary: Mapping[str, Any]) -> float | None:
    joint, head = summary.get("joint_step_max_mm"), summary.get("head_step_mm")
    if isinstance(joint, (int, float)) and isinstance(head, (int, float)) and head > 0:
        return float(joint) / float(head)
    return None


def _show_angle(summary: Mapping[str, Any]) -> str:
    angle = summary.get("joint_angle_max_rad")
    if not isinstance(angle, (int, float)):
        return "–"
    return f"{_show(math.degrees(angle), 1)}°"


def render_cards(plan: Plan, summary: Mapping[str, Any]) -> str:
    """Return the four numbers that matter most."""
    clearance = summary.get("clearance_min_mm")
    whole = summary.get("centreline_length_mm", float(plan.path_arc_length[-1]))
    bad = isinstance(clearance, (int, float)) and clearance < 0.0
    stopped = plan.status == "stopped"
    ratio = _read_step_ratio(summary)
    cards = (
        (_show(clearance, 2, "mm"), "smallest clearance, wall to scope surface", bad),
        (
            _show(plan.inserted, 1, "mm"),
            f"inserted, of {_show(whole, 1, 'mm')}",
            stopped,
        ),
        (_show_angle(summary), "largest angle at a joint", False),
        (
            "–" if ratio is None else f"{ratio:.2f}×",
            "largest joint step per step of the head",
            False,
        ),
    )
    return "".join(
        f'<div class="card{" bad" if red else ""}"><b>{escape(value)}</b>'
        f"<span>{escape(name)}</span></div>"
        for value, name, red in cards
    )


def list_rows(plan: Plan, field: SampledField, summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the table of numbers as (name, value) texts."""
    radius = find_radius(plan)
    certified = bool(summary.get("certified", plan.meta.get("certified", False)))
    reason = plan.reason or "–"
    if plan.reason_code:
        reason = f"{reason} ({plan.reason_code})"
    ratio = _read_step_ratio(summary)
    rows = [
        ("Method", plan.method),
        ("Status", plan.status),
        ("Reason", reason),
        ("Clearance certified", "yes" if certified else "no: estimated"),
        ("Centreline", _show(summary.get("centreline_length_mm"), 1, "mm")),
        ("Inserted", _show(plan.inserted, 1, "mm")),
        ("Stopped at", _show(summary.get("stopped_at_mm"), 1, "mm")),
        ("Scope diameter", _show(2.0 * radius if radius > 0.0 else None, 2, "mm")),
        ("Link length", _show(find_link_length(plan), 2, "mm")),
        ("Links", str(plan.links)),
        ("Recorded steps", str(plan.steps)),
        ("Smallest clearance", _show(summary.get("clearance_min_mm"), 3, "mm")),
        ("… at this place of the tract", _show(summary.get("clearance_where_mm"), 1, "mm")),
        ("Largest angle at a joint", _show_angle(summary)),
        ("Largest joint step", _show(summary.get("joint_step_max_mm"), 3, "mm")),
        ("Head step", _show(summary.get("head_step_mm"), 3, "mm")),
        ("Joint step per head step", "–" if ratio is None else f"{ratio:.2f}"),
        ("Wall", str(plan.meta.get("wall") or field.wall)),
        ("Wall moved outwards (inflation)", _show(float(field.inflation), 2, "mm")),
        (
            "Error of the distance between grid nodes, at most",
            _show(getattr(field, "error", None), 2, "mm"),
        ),
        (
            "True wall may differ from the stated one by",
            _show(getattr(field, "wall_error", None), 2, "mm"),
        ),
        ("Grid spacing", " × ".join(f"{float(step):.3g}" for step in field.spacing) + " mm"),
    ]
    seconds = summary.get("seconds")
    if isinstance(seconds, Mapping):
        text = ", ".join(f"{name} {_show(value, 2)}" for name, value in seconds.items())
        rows.append(("Seconds by stage", text))
    return [row for row in rows if row[1] != "–"]


def render_table(rows: Sequence[tuple[str, str]]) -> str:
    """Return rows of a two-column table; wrapped in ``<table>`` by the caller's template."""
    return "".join(
        f'<tr><th scope="row">{escape(name)}</th><td>{escape(value)}</td></tr>'
        for name, value in rows
    )


def render_findings(findings: Sequence[Finding]) -> str:
    """Return the findings as a list, warnings first."""
    if not findings:
        return "<p>Nothing unusual was found.</p>"
    ordered = sorted(findings, key=lambda finding: finding.severity != "warning")
    return (
        "<ul>"
        + "".join(
            f'<li><span class="tag{" warning" if item.severity == "warning" else ""}">'
            f"{escape(item.severity)}</span>{escape(item.message)} "
            f'<span class="note">({escape(item.code)})</span></li>'
            for item in ordered
        )
        + "</ul>"
    )


def list_limitations(plan: Plan, field: SampledField, summary: Mapping[str, Any]) -> list[str]:
    """Return what the reader must know before believing the numbers."""
    certified = bool(summary.get("certified", plan.meta.get("certified", False)))
    wall = str(plan.meta.get("wall") or field.wall)
    texts = [
        "Clearance is the distance from the scope's round surface to the wall, the smallest over "
        "the whole body in the tract; below zero the body is through the wall by that much. "
        "What is still in the introducer does not count.",
        f"The wall is: {wall}."
        + (
            f" It was moved outwards by {field.inflation:g} mm, as insufflation would; limbs of "
            "the tract closer than twice that may merge."
            if field.inflation > 0.0
            else ""
        ),
    ]
    if certified:
        texts.append("The clearance is certified: a lower bound for all points and all times.")
    else:
        texts.append(
            "The clearance is estimated: from sampled points of the body at the recorded steps. "
            "It is not a proof, and what happens between steps is not covered."
        )
    error = float(getattr(field, "error", 0.0))
    if error > 0.0:
        texts.append(
            f"The distance is sampled on a grid: between its nodes it may be wrong by up to "
            f"{error:.2f} mm. A clearance smaller than that decides nothing."
        )
    if plan.method == "thesis":
        texts.append(
            "The method 'thesis' keeps the joints inside the wall, not the links between them: "
            "links can cut through the wall at bends."
        )
    texts += [
        "The wall is rigid and at rest: no friction, gravity, breathing or tissue that gives way.",
        "Research software, not a medical device.",
    ]
    return texts

"""The words and numbers of the report, as escaped HTML fragments."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from ..checks import ceil_mm, floor_mm
from ..motion.plan import Plan
from ..plot.plan_data import (
    METHOD_NAMES,
    PlanClearance,
    Record,
    WallContact,
    find_link_length,
    find_radius,
    read_centreline,
    read_clearance,
    read_movement,
    read_number,
    read_part,
)
from ..plot.scope import list_marks
from .verdict import list_unreached

if TYPE_CHECKING:
    from ..anatomy.tract import Finding
    from ..duct.field import SampledField

# The limits of a report's numbers: what is proved, for which wall, and what is not.


def list_limitations(plan: Plan, field: SampledField, summary: Record) -> list[str]:
    """Return what the reader must know before believing the numbers."""
    known = read_clearance(plan, summary)
    wall = plan.wall or field.wall
    below = "pushes the wall outwards" if known.soft is not None else "is through the wall"
    texts = [
        "Clearance is the distance from the scope's round surface to the wall, the smallest over "
        f"the whole body in the tract; below zero the body {below} by that much. "
        "What is still in the introducer does not count.",
        f"The wall is: {wall}."
        + (
            f" It was moved outwards by {field.inflation:g} mm, as insufflation would; "
            "limbs of the tract closer than twice that merge. That no link passes between them was "
            "seen at samples of the motion, it is not proved."
            if field.inflation > 0.0
            else ""
        ),
    ]
    texts += _describe_proof(known) if known.certified else _describe_estimate(field)
    passage = read_number(summary, "passage_mm")
    if passage is not None:
        texts.append(
            f"Proved, whatever the motion: no scope with a radius above "
            f"{ceil_mm(passage)} mm passes inside the stated wall."
        )
    if known.soft is not None:
        texts.append(
            f"The wall may give way by up to {known.soft.allowed:g} mm and was taken as displaced "
            f"by {known.soft.used:g} mm all round. Depths of contact are against the wall at "
            "rest, from sampled points at the recorded steps; no force is computed."
        )
    wall_error = getattr(field, "wall_error", None)
    if wall_error is None:
        texts.append("How far the true wall of the body lies from the stated one is not known.")
    elif wall_error > 0.0:
        texts.append(
            f"The true wall of the body may lie up to {ceil_mm(wall_error)} mm from the stated "
            "one, "
            "by the resolution of the scan alone; how well it was drawn is not known here."
        )
    if plan.method == "thesis":
        texts.append(
            "The method 'thesis' keeps the joints inside the wall, not the links between them: "
            "links can cut through the wall at bends."
        )
    soft = "gives way all round alike" if known.soft is not None else "is rigid"
    texts += [
        f"The wall {soft} and is at rest: no friction, gravity or breathing.",
        "Research software, not a medical device.",
    ]
    return texts


def _describe_proof(known: PlanClearance) -> list[str]:
    bound = "stays inside it"
    if known.proved is not None and known.proved >= 0.01:
        bound = f"stays at least {floor_mm(known.proved)} mm from it"
    wall = "the displaced wall" if known.soft is not None else "the wall stated here"
    return [
        f"Proved, for {wall}: every point of the scope's surface that is in the tract {bound}, at "
        "the recorded steps and between them, where each joint moves along a straight line from "
        "step to step. The proof bounds the distance in whole cells of body and time, the error "
        "between grid nodes included; it was made after planning, on the motion itself.",
        "Not proved: anything about the real anatomy, whose wall differs from the stated one, "
        "or about a scope that does not follow these joints.",
        "The clearances in pictures and plots are estimates at sampled points, for seeing where it "
        "is tight; the proved bound is the one number given as proved.",
    ]


def _describe_estimate(field: SampledField) -> list[str]:
    texts = [
        "The clearance is estimated: from sampled points of the body at the recorded steps. "
        "It is not a proof, and what happens between steps is not covered."
    ]
    error = float(getattr(field, "error", 0.0))
    if error > 0.0:
        texts.append(
            f"The distance is sampled on a grid: between its nodes it may be wrong by up to "
            f"{ceil_mm(error)} mm. A clearance smaller than that decides nothing."
        )
    return texts


_MINUS = "\N{MINUS SIGN}"


def _show(value: object, digits: int, unit: str = "") -> str:
    """Return a number for reading, or a dash where there is none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}f}".replace("-", _MINUS)
    return f"{text} {unit}".strip()


def _show_or_unknown(value: float | None, digits: int, unit: str) -> str:
    return "unknown" if value is None else _show(value, digits, unit)


def _read_step_ratio(summary: Record) -> float | None:
    ratio = read_number(summary, "joint_step_ratio_max")
    joint, head = read_number(summary, "joint_step_max_mm"), read_number(summary, "head_step_mm")
    if ratio is None and joint is not None and head is not None and head > 0.0:
        return joint / head
    return ratio


def _show_angle(summary: Record) -> str:
    angle = read_number(summary, "joint_angle_max_rad")
    return "–" if angle is None else f"{_show(math.degrees(angle), 1)}°"


def _show_lower(value: float | None, unit: str = "mm") -> str:
    """Return a proved lower bound, rounded down."""
    return "–" if value is None else f"{floor_mm(value).replace('-', _MINUS)} {unit}"


def _show_upper(values: Record, key: str, digits: int) -> str:
    """Return an upper bound, rounded up."""
    value = read_number(values, key)
    return "–" if value is None else f"{ceil_mm(value, digits)} mm"


def render_cards(plan: Plan, summary: Record) -> str:
    """Return the few numbers that matter most."""
    known = read_clearance(plan, summary)
    centreline = read_centreline(plan)
    whole = summary.get("centreline_length_mm", centreline.length)
    stopped = plan.status == "stopped"
    reached = whole if not stopped else float(centreline.to_centreline(plan.head_arc_length).max())
    if known.soft is not None:
        first = (_show(known.soft.contact, 2, "mm"), "deepest contact: wall pushed outwards", False)
    elif known.certified and known.proved is not None:
        first = (_show_lower(known.proved), "proved clearance, whole body, all times", False)
    else:
        bad = known.estimate is not None and known.estimate < 0.0
        first = (
            _show(known.estimate, 2, "mm"),
            "smallest clearance, wall to scope surface, estimated",
            bad,
        )
    cards = [
        first,
        (
            _show(reached, 1, "mm"),
            f"of the centreline's {_show(whole, 1, 'mm')} reached; "
            f"{_show(plan.inserted, 1, 'mm')} inserted along the head's path",
            stopped,
        ),
        (_show_angle(summary), "largest angle at a joint", False),
        (_show_times(_read_step_ratio(summary)), "largest joint step per step of the head", False),
    ]
    moved = read_number(read_part(summary, "displacement_ratio"), "tractrix")
    if moved is not None:
        cards.append((_show_times(moved), "joint movement, of a freely pulled chain's", False))
    return "".join(
        f'<div class="card{" bad" if red else ""}"><b>{escape(value)}</b>'
        f"<span>{escape(name)}</span></div>"
        for value, name, red in cards
    )


def _show_times(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}×"


def list_rows(plan: Plan, field: SampledField, summary: Record) -> list[tuple[str, str]]:
    """Return the table of numbers as (name, value) texts."""
    radius = find_radius(plan)
    known = read_clearance(plan, summary)
    rows = [
        ("Method", plan.method),
        ("Status", plan.status),
        ("Reason", plan.reason + (f" ({plan.reason_code})" if plan.reason_code else "") or "–"),
        ("Clearance certified", "yes" if known.certified else "no: estimated"),
        ("Centreline, its length", _show(summary.get("centreline_length_mm"), 1, "mm")),
        ("Inserted, along the head's path", _show(plan.inserted, 1, "mm")),
        ("Stopped at, along the head's path", _show(summary.get("stopped_at_mm"), 1, "mm")),
        ("Scope diameter", _show(2.0 * radius if radius > 0.0 else None, 2, "mm")),
        ("Link length", _show(find_link_length(plan), 2, "mm")),
        ("Links", str(plan.links)),
        ("Recorded steps", str(plan.steps)),
        ("Proved clearance, at least", _show_lower(known.proved)),
        ("… so the proof holds for a wall wrong by at most", _show_lower(known.proved)),
        ("Stated error of the wall", _show(summary.get("label_error_mm"), 2, "mm")),
        ("Smallest clearance, estimated", _show(known.estimate, 3, "mm")),
        ("… at this place of the centreline", _show(known.place, 1, "mm")),
        *_list_fit(summary),
        *_list_contact(known.soft),
        ("Largest angle at a joint", _show_angle(summary)),
        ("Largest joint step", _show(summary.get("joint_step_max_mm"), 3, "mm")),
        ("Head step", _show(summary.get("head_step_mm"), 3, "mm")),
        ("Largest joint step per head step", _show(_read_step_ratio(summary), 2)),
    ]
    moved = read_part(summary, "displacement_ratio")
    for key, name in (("tractrix", "a freely pulled chain"), ("follow", "follow-the-leader")):
        rows.append((f"Joint movement, of that of {name}", _show(moved.get(key), 3)))
    rows += [
        ("Wall", plan.wall or field.wall),
        ("Wall moved outwards (inflation)", _show(float(field.inflation), 2, "mm")),
        (
            "Error of the distance between grid nodes, at most",
            _show(getattr(field, "error", None), 2, "mm"),
        ),
        (
            "True wall may differ from the stated one by",
            _show_or_unknown(getattr(field, "wall_error", None), 2, "mm"),
        ),
        ("Grid spacing", " × ".join(f"{float(step):.3g}" for step in field.spacing) + " mm"),
    ]
    seconds = summary.get("seconds")
    if isinstance(seconds, Mapping):
        text = ", ".join(f"{name} {_show(value, 2)}" for name, value in seconds.items())
        rows.append(("Seconds by stage", text))
    return [row for row in rows if row[1] != "–"]


def _list_fit(summary: Record) -> list[tuple[str, str]]:
    """Return what limits the scope, and what would fit."""
    refusal, largest = read_part(summary, "refusal"), read_part(summary, "largest")
    return [
        ("Refused at this place of the centreline", _show(refusal.get("at_mm"), 1, "mm")),
        ("… needs, from the axis to the wall", _show(refusal.get("needs_mm"), 2, "mm")),
        ("… offers", _show_lower(read_number(refusal, "offers_mm"))),
        ("Would fit: diameter of at most", _show_lower(read_number(refusal, "diameter_max_mm"))),
        ("Would fit: links of at most", _show_lower(read_number(refusal, "link_max_mm"))),
        ("Would fit: wall inflated by about", _show_upper(refusal, "inflate_mm", 1)),
        ("Proved: none passes of a radius above", _show_upper(summary, "passage_mm", 2)),
        (
            "Largest diameter found to fit"
            + _describe_tested(largest, "diameter_tested_link_mm", "link_tested_mm", "links"),
            _show_lower(read_number(largest, "diameter_mm")),
        ),
        (
            "Longest link found to fit"
            + _describe_tested(
                largest, "link_tested_diameter_mm", "diameter_tested_mm", "diameter"
            ),
            _show_lower(read_number(largest, "link_mm")),
        ),
    ]


def _describe_tested(largest: Record, key: str, other: str, name: str) -> str:
    value = read_number(largest, key)
    value = read_number(largest, other) if value is None else value
    return "" if value is None else f", at {value:g} mm {name}"


def _list_contact(soft: WallContact | None) -> list[tuple[str, str]]:
    if soft is None:
        return []
    return [
        ("Wall may give way by", _show(soft.allowed, 2, "mm")),
        ("Wall taken as displaced by", _show(soft.used, 2, "mm")),
        ("Deepest contact, estimated", _show(soft.contact, 2, "mm")),
        ("… contact at this place of the centreline", _show(soft.place, 1, "mm")),
    ]


def render_table(rows: Sequence[tuple[str, str]]) -> str:
    """Return rows of a two-column table; wrapped in ``<table>`` by the caller's template."""
    return "".join(
        f'<tr><th scope="row">{escape(name)}</th><td>{escape(value)}</td></tr>'
        for name, value in rows
    )


def render_findings(findings: Sequence[Finding]) -> str:
    """Return the findings: warnings as a list, notes folded behind it."""
    parts = []
    warnings = [item for item in findings if item.severity == "warning"]
    notes = [item for item in findings if item.severity != "warning"]
    if warnings:
        parts.append(_render_list(warnings))
    if notes:
        count = f"{len(notes)} notes" if len(notes) > 1 else "1 note"
        parts.append(
            f"<details><summary>{count} about the input</summary>{_render_list(notes)}</details>"
        )
    return "".join(parts) or '<p class="small">Nothing unusual was found in the input.</p>'


def _render_list(findings: Sequence[Finding]) -> str:
    return (
        "<ul>"
        + "".join(
            f'<li><span class="tag{" warning" if item.severity == "warning" else ""}">'
            f"{escape(item.severity)}</span>{escape(item.message)} "
            f'<span class="note">({escape(item.code)})</span></li>'
            for item in findings
        )
        + "</ul>"
    )


def render_notes(notes: Sequence[str]) -> str:
    """Return what belongs to a verdict, a line each."""
    return "".join(f'<div class="note">{escape(note)}</div>' for note in notes)


def render_ends(plan: Plan, summary: Record) -> str:
    """Return the section on the ends of the tract and what is not reached, "" without a record."""
    marks = list_marks(plan)
    if not marks:
        return ""
    rows = "".join(
        f'<tr><th scope="row">{mark.number}</th><td>{escape(mark.role or "–")}</td>'
        f"<td>{escape(mark.name)}</td><td>{escape(mark.place)}</td>"
        f"<td>{_show(mark.radius, 1, 'mm')}</td><td>{_show(mark.length, 0, 'mm')}</td></tr>"
        for mark in marks
    )
    entry = read_part(summary, "entry")
    basis = f"The entry is this end because {entry['basis']}. " if entry.get("basis") else ""
    parts = "".join(f"<li>{escape(str(part['text']))}</li>" for part in list_unreached(summary))
    rest = f"<p>Not reached, or missing:</p><ul>{parts}</ul>" if parts else ""
    return (
        f"<h2>Ends of the tract</h2><p>{escape(basis)}Every place where the centreline could begin "
        "or end; the numbers are those in the pictures. Choose with --start, --end, --via or "
        '--reverse.</p><div class="wide"><table class="methods"><thead><tr><th>No.</th>'
        "<th>Taken for</th><th>What it is</th><th>x, y, z [mm]</th><th>Radius of the opening</th>"
        "<th>Centreline from the opposite end</th></tr></thead>"
        f"<tbody>{rows}</tbody></table></div>{rest}"
    )


def render_methods(rows: Sequence[Record]) -> str:
    """Return an HTML table, one row a method; every text is escaped."""
    heads = [
        "Method", "Result", "Clearance", "Joint step<br>per head step", "Largest<br>angle",
        "Joint movement,<br>of a free chain's", "… of follow-<br>the-leader's", "Seconds",
    ]  # fmt: skip
    table = [_render_cells(row) for row in rows]
    shown = [k for k in range(len(heads)) if any(cells[k] != "–" for cells in table)]
    body = "".join(
        f'<tr><th scope="row">{cells[0]}</th>'
        + "".join(f"<td>{cells[k]}</td>" for k in shown[1:])
        + "</tr>"
        for cells in table
    )
    head = "".join(f'<th scope="col">{heads[k]}</th>' for k in shown)
    return (
        '<div class="wide"><table class="methods"><thead><tr>'
        f"{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _render_cells(row: Record) -> list[str]:
    method = str(row.get("method", "?"))
    moved = read_movement(row)
    return [
        escape(METHOD_NAMES.get(method, method)),
        _render_result(row),
        _render_clearance(row),
        _show_times(moved["step"]),
        _show_angle(row),
        _show_times(moved["tractrix"]),
        _show_times(moved["follow"]),
        _show(read_number(row, "seconds"), 2, "s"),
    ]


def _render_result(row: Record) -> str:
    if row.get("status") == "complete":
        return "reaches the far end"
    code = str(row.get("reason_code") or "")
    title = f' title="{escape(str(row.get("reason") or ""), quote=True)}"'
    stop = _show(read_number(row, "inserted_mm"), 0, "mm")
    return f'<b class="bad"{title}>stops at {stop}</b> {escape(code)}'


def _render_clearance(row: Record) -> str:
    proved, estimate = (
        read_number(row, key) for key in ("clearance_certified_mm", "clearance_min_mm")
    )
    if row.get("certified"):
        if proved is None:
            return "proved to stay inside"
        return f"at least {floor_mm(proved).replace('-', _MINUS)} mm, <b>proved</b>"
    if estimate is None:
        return "–"
    if estimate < 0.0:
        return f'<b class="bad">{_show(estimate, 2, "mm")}</b>, through the wall'
    return f"{_show(estimate, 2, 'mm')}, estimated"

"""The report: one HTML file that stands alone and states whether the scope fits.

Pictures, data and the small script are all inside the file; nothing is loaded from anywhere.
Every text that comes from outside (file names, reasons, findings) is escaped.
"""

from __future__ import annotations

import base64
import io
import json
import os
import re
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from importlib.resources import files as package_files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..io.files import write_text
from ..motion.plan import Plan, write_record
from ..plot.fluoroscopy import Projection, render_fluoroscopy
from ..plot.plan_data import (
    PlanClearance,
    Record,
    check_plan,
    read_clearance,
    read_number,
    share_centreline,
)
from ..scene.make_view import view_plan
from ..scene.page import allow_only, bundle_scripts, pack_view, read_web
from .text import (
    list_limitations,
    list_rows,
    render_cards,
    render_ends,
    render_findings,
    render_methods,
    render_notes,
    render_table,
)
from .verdict import judge_plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..anatomy.tract import Finding
    from ..duct.field import SampledField

# Parts of the report that are drawn: contact, methods side by side.


def render_contact(plan: Plan, field: SampledField, known: PlanClearance) -> str:
    """Return the section on contact with a soft wall, "" where the wall is rigid."""
    if known.soft is None:
        return ""
    from ..plot.contact import draw_contact, measure_contact

    contact = measure_contact(plan, field)
    share = 100.0 * contact.touched / contact.length
    image = encode_figure(
        draw_contact(plan, field, used=known.soft.used, allowed=known.soft.allowed), dpi=130.0
    )
    return (
        "<h2>Contact</h2><p>Where the body stands beyond the wall at rest, and by how much: left "
        "at every moment, right the deepest at each place. About "
        f"{contact.touched:.0f} mm of the tract ({share:.0f} %) are touched at some time.</p>"
        f'<figure><img src="{image}" alt="Depth of contact along the tract"></figure>'
    )


def render_comparison(plan: Plan, summary: Record, comparison: Sequence[Plan]) -> str:
    """Return the section that puts methods side by side, "" where there is nothing to compare."""
    from ..plot.comparison import draw_comparison
    from ..plot.plan_data import list_methods

    records = summary.get("comparison") or ()
    if not isinstance(records, Sequence) or isinstance(records, str):
        records = ()
    if not comparison and not records:
        return ""
    soft = read_clearance(plan, summary).soft is not None
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
        "A clearance is marked as proved or as an estimate; joint movement is the sum over all "
        "joints and steps, against a chain pulled freely along the same head path (no wall "
        "holds it back) and one whose joints all follow that path.</p>"
        f"{render_methods(rows)}{figure}"
    )


def encode_figure(figure: Figure, *, dpi: float) -> str:
    """Return a figure as a ``data:`` address of a PNG."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dpi, facecolor=figure.get_facecolor())
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


_NOTE_REST = "The orange line is the centreline not reached, a red dot the place that was refused."


def write_report(
    path: str | os.PathLike[str],
    *,
    plan: Plan,
    field: SampledField,
    summary: Record,
    findings: Sequence[Finding] = (),
    comparison: Sequence[Plan] = (),
) -> Path:
    """Write the report of a plan as one HTML file and return its path.

    Parameters
    ----------
    path : path-like
        The file to write.
    plan : Plan
        The motion; what it does not state is left out.
    field : SampledField
        The lumen that the plan was made in; for a soft wall, the lumen at rest.
    summary : mapping
        The object that ``bozzini plan --json`` prints; its numbers are the ones quoted.
    findings : sequence of Finding
        What was noticed about the input.
    comparison : sequence of Plan
        Plans by other methods for the same scope and tract, to be put side by side.

    Raises
    ------
    InputError
        If plan, field and summary do not belong together.
    OutputError
        If the file cannot be written.
    """
    from ..plot.clearance import draw_clearance
    from ..plot.figures import draw_depths

    check_plan(plan)
    _check_summary(plan, summary)
    _check_field(plan, field)
    for other in comparison:
        check_plan(other)
        _check_field(other, field)
    known = read_clearance(plan, summary)
    error = read_number(summary, "clearance_error_mm")
    verdict = judge_plan(plan, summary, error=field.error if error is None else error)
    pictures = [render_fluoroscopy(field, axis=axis) for axis in ("coronal", "sagittal")]
    depths = min(5, plan.steps)
    title = _find_title(plan)
    view = view_plan(plan, field, title=title)
    style, script = read_package_text("report.css") + read_web("view.css"), bundle_scripts()
    page = _fill(
        read_package_text("report_template.html"),
        {
            "title": escape(title),
            "policy": allow_only((script,), (style,)),
            "style": style,
            "tone": verdict.tone,
            "label": escape(verdict.label),
            "sentence": escape(verdict.sentence),
            "basis": escape(_describe_basis(known, plan, field)),
            "notes": render_notes(verdict.notes),
            "ends": render_ends(plan, summary),
            "cards": render_cards(plan, summary),
            "below_long": "pushes the wall outwards"
            if known.soft is not None
            else "is through the wall",
            "rest_note": _NOTE_REST if plan.status == "stopped" else "",
            "depths_image": encode_figure(draw_depths(plan, field, depths=depths), dpi=100.0),
            "depths_alt": f"Two views of the scope in the tract at {depths} insertion depths",
            "depths_text": f"{depths} depths up to {plan.inserted:.0f} mm",
            "frame_note": escape(_describe_frame(pictures, field.frame)),
            "clearance_image": encode_figure(draw_clearance(plan, summary=summary), dpi=130.0),
            "clearance_alt": escape(verdict.sentence),
            "contact": render_contact(plan, field, known),
            "comparison": render_comparison(plan, summary, comparison),
            "rows": render_table(list_rows(plan, field, summary)),
            "findings": render_findings(findings),
            "limitations": "".join(
                f"<li>{escape(text)}</li>" for text in list_limitations(plan, field, summary)
            ),
            "provenance": _render_provenance(plan, summary),
            "parts": read_web("view.html"),
            "view": pack_view(view),
            "script": script,
        },
    )
    return write_text(path, page)


def _check_summary(plan: Plan, summary: Record) -> None:
    if not isinstance(summary, Mapping):
        raise InputError(f"summary is a {type(summary).__name__}: it must be a mapping")
    facts = {"steps": plan.steps, "links": plan.links, "status": plan.status, "method": plan.method}
    for key, value in facts.items():
        if key in summary and summary[key] != value:
            raise InputError(
                f"summary and plan do not belong together: {key} is {summary[key]!r} in the "
                f"summary and {value!r} in the plan"
            )


def _check_field(plan: Plan, field: SampledField) -> None:
    size = (np.array(field.values.shape) - 1) * np.asarray(field.spacing)
    grid = field.to_grid(plan.path)
    inside = np.all((grid > -1e-6) & (grid < size + 1e-6), axis=-1)
    if inside.mean() < 0.5:
        raise InputError(
            f"field and plan do not belong together: {int((~inside).sum())} of {len(inside)} "
            "path points lie outside the field's grid"
        )


def _find_title(plan: Plan) -> str:
    name = plan.input and (plan.input.source or plan.input.file)
    return f"Insertion plan: {Path(name).name}" if name else "Insertion plan"


def _describe_basis(known: PlanClearance, plan: Plan, field: SampledField) -> str:
    wall = plan.wall or field.wall
    if known.certified:
        parts = [f"Certified for the whole body at all times. The wall is: {wall}."]
    else:
        parts = ["The clearance is an estimate at the recorded steps, not certified."]
    if field.inflation > 0.0:
        parts.append(f"The wall was moved outwards by {field.inflation:g} mm first.")
    return " ".join(parts)


def _describe_frame(pictures: Sequence[Projection], frame: str | None) -> str:
    directions = (
        f"follow the file's frame, {frame}"
        if frame
        else "take the file's frame for RAS, because the file does not state one"
    )
    letters = "R right, L left, A front, P back, S head, I feet of the patient"
    text = f"Directions ({letters}) {directions}."
    tilt = max(np.degrees(picture.tilt) for picture in pictures)
    if tilt > 2.0:
        text += f" The views follow the grid, up to {tilt:.0f}° off the body's axes."
    return text


def _render_provenance(plan: Plan, summary: Record) -> str:
    parts = []
    if plan.more.get("command"):
        parts.append(f"<pre>{escape(str(plan.more['command']))}</pre>")
    rows = []
    stated: dict[str, Mapping[str, object]] = {
        "input": {} if plan.input is None else plan.input.describe(),
        "scope": {} if plan.scope is None else write_record(plan.scope),
        "introducer": {} if plan.introducer is None else write_record(plan.introducer),
        "field": {} if plan.field is None else write_record(plan.field),
        "versions": plan.versions,
    }
    for key, values in stated.items():
        rows += [(f"{key}: {name}".replace("_", " "), _show(v)) for name, v in values.items()]
    if rows:
        parts.append(f"<table>{render_table(rows)}</table>")
    if plan.more.get("attribution"):
        parts.append(f"<p><b>Data:</b> {escape(str(plan.more['attribution']))}</p>")
    text = json.dumps(dict(summary), indent=2, default=str, ensure_ascii=False)
    parts.append(
        f"<details><summary>The whole summary</summary><pre>{escape(text)}</pre></details>"
    )
    return "".join(parts)


def _show(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else json.dumps(value, default=str, ensure_ascii=False)


def _fill(template: str, values: Mapping[str, str]) -> str:
    return re.sub(r"\{\{(\w+)\}\}", lambda match: values[match.group(1)], template)


@cache
def read_package_text(name: str) -> str:
    """Return a text that lies beside this module."""
    return package_files(__package__).joinpath(name).read_text(encoding="utf-8")

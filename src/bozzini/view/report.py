"""The report: one HTML file that stands alone and says whether the scope fits.

Pictures, data and the small script are all inside the file; nothing is loaded from anywhere.
Every text that comes from outside (file names, reasons, findings) is escaped.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from importlib.resources import files as package_files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..files import write_text
from ..motion.plan import Plan
from .claim import Claim, read_claim
from .fluoroscopy import Projection, render_fluoroscopy
from .limitations import list_limitations
from .palette import AMBER, GREEN, RED, choose_clearance_scale, list_clearance_colors
from .report_parts import encode_figure, render_comparison, render_contact, render_panel
from .report_text import (
    list_rows,
    render_cards,
    render_ends,
    render_findings,
    render_notes,
    render_table,
)
from .sampling import check_plan, find_radius, place_tightest, sample_motion
from .verdict import judge_plan
from .viewer_data import pack_viewer
from .way import find_way

if TYPE_CHECKING:
    from ..anatomy.findings import Finding
    from ..duct.field import SampledField

__all__ = ["write_report"]

_TONES = {"green": GREEN, "amber": AMBER, "red": RED}
_VIEWER_JOINTS = 60_000
_VIEWER_STEPS = 300
_NOTE_REST = "Orange dots are the way not reached, an orange cross the place that was refused."


def write_report(
    path: str | os.PathLike[str],
    *,
    plan: Plan,
    field: SampledField,
    summary: Mapping[str, Any],
    findings: Sequence[Finding] = (),
    comparison: Sequence[Plan] = (),
) -> Path:
    """Write the report of a plan as one HTML file and return its path.

    Parameters
    ----------
    path : path-like
        The file to write.
    plan : Plan
        The motion. Of its `meta`, the keys scope, certified, certificate, centreline, refusal,
        soft_wall, input, versions, command and attribution are used where they are present.
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
    from .figures import draw_clearance, draw_depths

    check_plan(plan)
    _check_summary(plan, summary)
    _check_field(plan, field)
    for other in comparison:
        check_plan(other)
        _check_field(other, field)
    claim, way = read_claim(plan, summary), find_way(plan)
    error = float(getattr(field, "error", 0.0))
    verdict = judge_plan(plan, summary, error=error)
    count = int(np.clip(_VIEWER_JOINTS // plan.joints.shape[1], 2, _VIEWER_STEPS))
    sample = sample_motion(plan, count=count)
    scale = choose_clearance_scale(sample.visible)
    pictures = [render_fluoroscopy(field, axis=axis) for axis in ("coronal", "sagittal")]
    depths = min(5, plan.steps)
    motion = pack_viewer(
        sample,
        pictures,
        places=place_tightest(sample, field),
        scale=scale,
        radius=find_radius(plan),
    )
    title = _find_title(plan)
    colors = list_clearance_colors(scale)
    page = _fill(
        _read_package_text("report_template.html"),
        {
            "title": escape(title),
            "tone_color": _TONES[verdict.tone],
            "label": escape(verdict.label),
            "sentence": escape(verdict.sentence),
            "basis": escape(_describe_basis(claim, plan, field)),
            "notes": render_notes(verdict.notes),
            "ends": render_ends(plan, summary),
            "cards": render_cards(plan, summary),
            "panels": "".join(render_panel(picture, plan, way, summary) for picture in pictures),
            "below": "pushing the wall" if claim.soft is not None else "through the wall",
            "below_long": "pushes the wall outwards"
            if claim.soft is not None
            else "is through the wall",
            "rest_note": _NOTE_REST if plan.status == "stopped" else "",
            "panels_shape": f"{sum(p.width for p in pictures) / pictures[0].height:.4f}",
            "gradient": ",".join(
                f"{color} {100.0 * k / len(colors):.2f}% {100.0 * (k + 1) / len(colors):.2f}%"
                for k, color in enumerate(colors)
            ),
            "scale_low": f"{scale.low:g} mm".replace("-", "&minus;"),
            "scale_high": f"{scale.high:g} mm",
            "depths_image": encode_figure(draw_depths(plan, field, depths=depths), dpi=100.0),
            "depths_alt": f"Two views of the scope in the tract at {depths} insertion depths",
            "depths_text": f"{depths} depths up to {plan.inserted:.0f} mm",
            "frame_note": escape(_describe_frame(pictures, field.frame)),
            "clearance_image": encode_figure(draw_clearance(plan, summary=summary), dpi=130.0),
            "clearance_alt": escape(verdict.sentence),
            "contact": render_contact(plan, field, claim),
            "comparison": render_comparison(plan, summary, comparison),
            "rows": render_table(list_rows(plan, field, summary)),
            "findings": render_findings(findings),
            "limitations": "".join(
                f"<li>{escape(text)}</li>" for text in list_limitations(plan, field, summary)
            ),
            "provenance": _render_provenance(plan, summary),
            "motion": _embed_json(motion),
            "script": _read_package_text("report_viewer.js"),
        },
    )
    return write_text(path, page)


def _check_summary(plan: Plan, summary: Mapping[str, Any]) -> None:
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
    source = plan.meta.get("input")
    name = source
    if isinstance(source, Mapping):
        name = next((source[k] for k in ("source", "path", "name", "file") if source.get(k)), None)
    return f"Insertion plan: {Path(str(name)).name}" if name else "Insertion plan"


def _describe_basis(claim: Claim, plan: Plan, field: SampledField) -> str:
    wall = str(plan.meta.get("wall") or field.wall)
    if claim.certified:
        parts = [f"Certified for the whole body at all times. The wall is: {wall}."]
    else:
        parts = ["The clearance is an estimate at the recorded steps, not certified."]
    if field.inflation > 0.0:
        parts.append(f"The wall was moved outwards by {field.inflation:g} mm first.")
    return " ".join(parts)


def _describe_frame(pictures: Sequence[Projection], frame: str | None) -> str:
    known = (
        f"follow the file's frame, {frame}"
        if frame
        else "take the file's frame for RAS, because the file does not state one"
    )
    text = f"Directions (R right, L left, A front, P back, S head, I feet of the patient) {known}."
    tilt = max(np.degrees(picture.tilt) for picture in pictures)
    if tilt > 2.0:
        text += f" The views follow the grid, up to {tilt:.0f}° off the body's axes."
    return text


def _render_provenance(plan: Plan, summary: Mapping[str, Any]) -> str:
    parts = []
    if plan.meta.get("command"):
        parts.append(f"<pre>{escape(str(plan.meta['command']))}</pre>")
    rows = []
    for key in ("input", "scope", "introducer", "field", "versions"):
        value = plan.meta.get(key)
        if isinstance(value, Mapping):
            rows += [(f"{key}: {name}".replace("_", " "), _show(v)) for name, v in value.items()]
        elif value:
            rows.append((key, _show(value)))
    if rows:
        parts.append(f"<table>{render_table(rows)}</table>")
    if plan.meta.get("attribution"):
        parts.append(f"<p><b>Data:</b> {escape(str(plan.meta['attribution']))}</p>")
    text = json.dumps(dict(summary), indent=2, default=str, ensure_ascii=False)
    parts.append(
        f"<details><summary>The whole summary</summary><pre>{escape(text)}</pre></details>"
    )
    return "".join(parts)


def _show(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else json.dumps(value, default=str, ensure_ascii=False)


def _embed_json(value: Any) -> str:
    """Return JSON that no browser takes for the end of its script element."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _fill(template: str, values: Mapping[str, str]) -> str:
    return re.sub(r"\{\{(\w+)\}\}", lambda match: values[match.group(1)], template)


@cache
def _read_package_text(name: str) -> str:
    return package_files(__package__).joinpath(name).read_text(encoding="utf-8")

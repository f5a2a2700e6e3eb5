"""Methods side by side: one row of numbers for each, as records and as an HTML table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from ..errors import InputError
from ..motion.measures import measure_displacement
from ..motion.plan import Plan
from ..motion.refusal import floor_mm
from .records import read_number
from .way import find_way

__all__ = ["METHOD_NAMES", "list_methods", "read_movement", "render_methods"]

METHOD_NAMES = {
    "tube": "tube (default)",
    "follow": "follow the leader",
    "thesis": "thesis, section 5.3",
}
"""Methods in words."""

_MINUS = "\N{MINUS SIGN}"


def list_methods(
    plans: Sequence[Plan], records: Sequence[Mapping[str, Any]] = ()
) -> list[dict[str, Any]]:
    """Return one record for each method, with the keys of the summary's `comparison`.

    Parameters
    ----------
    plans : sequence of Plan
        What the records lack is computed from these.
    records : sequence of mapping
        Records already made; they come first and are kept as they are.
    """
    rows = [dict(record) for record in records if isinstance(record, Mapping)]
    by_method = {str(row.get("method")): row for row in rows}
    for plan in plans:
        row = by_method.setdefault(plan.method, {"method": plan.method})
        if row not in rows:
            rows.append(row)
        for key, value in _describe(plan, skip=row).items():
            row.setdefault(key, value)
    return rows


def _describe(plan: Plan, *, skip: Mapping[str, Any]) -> dict[str, Any]:
    measures = plan.meta.get("measures")
    measures = measures if isinstance(measures, Mapping) else {}
    certificate = plan.meta.get("certificate")
    certified = bool(plan.meta.get("certified", False))
    proved = None
    if certified and isinstance(certificate, Mapping):
        proved = read_number(certificate, "clearance_mm")
    smallest = float(plan.clearance.min())
    estimate = read_number(measures, "clearance_min_mm")
    return {
        "status": plan.status,
        "reason": plan.reason,
        "reason_code": plan.reason_code,
        "certified": certified,
        "clearance_certified_mm": proved,
        "clearance_min_mm": smallest if estimate is None and math.isfinite(smallest) else estimate,
        "inserted_mm": plan.inserted,
        "centreline_length_mm": find_way(plan).length,
        "joint_step_ratio_max": read_number(measures, "joint_step_ratio_max"),
        "joint_angle_max_rad": read_number(measures, "joint_angle_max_rad"),
        "displacement_ratio": None
        if skip.get("displacement_ratio") is not None
        else _measure_displacement(plan),
    }


def _measure_displacement(plan: Plan) -> dict[str, float] | None:
    try:
        return measure_displacement(plan)
    except (InputError, KeyError, TypeError):  # the plan does not say where its introducer is
        return None


def render_methods(rows: Sequence[Mapping[str, Any]]) -> str:
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


def read_movement(row: Mapping[str, Any]) -> dict[str, float | None]:
    """Return `step`, `tractrix` and `follow`: how joints move; None where not known."""
    moved = row.get("displacement_ratio")
    moved = moved if isinstance(moved, Mapping) else {}
    if row.get("inserted_mm") == 0.0:  # a scope that does not enter moves no joint
        return {"step": None, "tractrix": None, "follow": None}
    return {
        "step": read_number(row, "joint_step_ratio_max"),
        "tractrix": read_number(moved, "tractrix"),
        "follow": read_number(moved, "follow"),
    }


def _render_cells(row: Mapping[str, Any]) -> list[str]:
    method = str(row.get("method", "?"))
    moved = read_movement(row)
    angle = read_number(row, "joint_angle_max_rad")
    return [
        escape(METHOD_NAMES.get(method, method)),
        _render_result(row),
        _render_clearance(row),
        _show(moved["step"], 2, "×"),
        _show(None if angle is None else math.degrees(angle), 1, "°"),
        _show(moved["tractrix"], 2, "×"),
        _show(moved["follow"], 2, "×"),
        _show(read_number(row, "seconds"), 2, " s"),
    ]


def _render_result(row: Mapping[str, Any]) -> str:
    if row.get("status") == "complete":
        return "reaches the far end"
    code = str(row.get("reason_code") or "")
    title = f' title="{escape(str(row.get("reason") or ""), quote=True)}"'
    stop = _show(read_number(row, "inserted_mm"), 0, " mm")
    return f'<b class="bad"{title}>stops at {stop}</b> {escape(code)}'


def _render_clearance(row: Mapping[str, Any]) -> str:
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
        return f'<b class="bad">{_show(estimate, 2, " mm")}</b>, through the wall'
    return f"{_show(estimate, 2, ' mm')}, estimated"


def _show(value: float | None, digits: int, unit: str) -> str:
    return "–" if value is None else f"{value:.{digits}f}{unit}".replace("-", _MINUS)

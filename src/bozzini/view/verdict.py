"""The verdict: one sentence that says whether the scope gets there, and how close to the wall."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..motion.plan import Plan
from .sampling import find_radius, sample_motion

__all__ = ["Verdict", "judge_plan"]


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What a plan comes to.

    Parameters
    ----------
    tone : {"green", "amber", "red"}
        Green: reaches the end, clear of the wall. Amber: reaches the end, but the wall is nearer
        than the error of the distance. Red: through the wall, or stopped on the way.
    label : str
        The same in a word or two.
    sentence : str
        The verdict.
    """

    tone: str
    label: str
    sentence: str


def judge_plan(plan: Plan, summary: Mapping[str, Any], *, error: float = 0.0) -> Verdict:
    """Return the verdict on a plan.

    Parameters
    ----------
    plan : Plan
    summary : mapping
        The summary of the run; `clearance_min_mm` and `clearance_where_mm` of it are quoted,
        and taken from the plan where it lacks them.
    error : float
        Largest error of the distance to the wall [mm]. A clearance below it that is not
        certified is too close to call.
    """
    radius = find_radius(plan)
    scope = f"The {2.0 * radius:.1f} mm scope" if radius > 0.0 else "The scope"
    whole = _read_number(summary, "centreline_length_mm", float(plan.path_arc_length[-1]))
    clearance = _read_number(summary, "clearance_min_mm", None)
    place = _read_number(summary, "clearance_where_mm", None)
    if clearance is None:
        sample = sample_motion(plan, count=400, worst_between=True)
        row, link = sample.find_tightest()
        if sample.in_tract[row, link]:
            clearance = float(sample.clearance[row, link])
            place = max(0.0, float(sample.places[row, link : link + 2].mean()))
    where = "" if place is None else f" at {place:.0f} mm"
    certified = bool(summary.get("certified", plan.meta.get("certified", False)))

    if plan.status == "stopped":
        reason = plan.reason.strip().rstrip(".") or plan.reason_code or "no reason was recorded"
        sentence = f"{scope} stops at {plan.inserted:.0f} mm of {whole:.0f} mm: {reason}."
        if clearance is not None and clearance < 0.0:
            sentence += (
                f" Before that its body passes through the wall{where} by {-clearance:.2f} mm."
            )
        elif clearance is not None:
            sentence += f" Up to there it keeps {clearance:.2f} mm from the wall (nearest{where})."
        return Verdict(tone="red", label="Stopped", sentence=sentence)

    reaches = f"{scope} reaches the far end ({whole:.0f} mm)"
    if clearance is None:
        return Verdict(tone="amber", label="Clearance unknown", sentence=f"{reaches}.")
    if clearance < 0.0:
        return Verdict(
            tone="red",
            label="Through the wall",
            sentence=f"{reaches}, but its body passes through the wall{where} "
            f"by {-clearance:.2f} mm.",
        )
    if clearance < error and not certified:
        return Verdict(
            tone="amber",
            label="Too close to call",
            sentence=f"{reaches}, but comes within {clearance:.2f} mm of the wall{where}: less "
            f"than the {error:.2f} mm by which the distance may be wrong.",
        )
    return Verdict(
        tone="green",
        label="Fits",
        sentence=f"{reaches} and keeps {clearance:.2f} mm from the wall (nearest{where}).",
    )


def _read_number(summary: Mapping[str, Any], key: str, otherwise: Any) -> Any:
    value = summary.get(key)
    return float(value) if isinstance(value, (int, float)) else otherwise

"""What a report says about its own numbers: what is proved, for which wall, and what is not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..motion.plan import Plan
from ..motion.refusal import floor_mm
from .claim import Claim, read_claim
from .records import ceil_mm, read_number

if TYPE_CHECKING:
    from ..duct.field import SampledField

__all__ = ["list_limitations"]


def list_limitations(plan: Plan, field: SampledField, summary: Mapping[str, Any]) -> list[str]:
    """Return what the reader must know before believing the numbers."""
    claim = read_claim(plan, summary)
    wall = str(plan.meta.get("wall") or field.wall)
    below = "pushes the wall outwards" if claim.soft is not None else "is through the wall"
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
    texts += _describe_proof(claim) if claim.certified else _describe_estimate(field)
    passage = read_number(summary, "passage_mm")
    if passage is not None:
        texts.append(
            f"Proved, whatever the motion: no scope with a radius above "
            f"{ceil_mm(passage)} mm passes inside the stated wall."
        )
    if claim.soft is not None:
        texts.append(
            f"The wall may give way by up to {claim.soft.allowed:g} mm and was taken as displaced "
            f"by {claim.soft.used:g} mm all round. Depths of contact are against the wall at "
            "rest, from sampled points at the recorded steps; no force is computed."
        )
    wall_error = getattr(field, "wall_error", None)
    if wall_error is None:
        texts.append("How far the true wall of the body lies from the stated one is not known.")
    elif wall_error > 0.0:
        texts.append(
            f"The true wall of the body may lie up to {wall_error:.2f} mm from the stated one, "
            "by the resolution of the scan alone; how well it was drawn is not known here."
        )
    if plan.method == "thesis":
        texts.append(
            "The method 'thesis' keeps the joints inside the wall, not the links between them: "
            "links can cut through the wall at bends."
        )
    soft = "gives way all round alike" if claim.soft is not None else "is rigid"
    texts += [
        f"The wall {soft} and is at rest: no friction, gravity or breathing.",
        "Research software, not a medical device.",
    ]
    return texts


def _describe_proof(claim: Claim) -> list[str]:
    bound = "stays inside it"
    if claim.proved is not None and claim.proved >= 0.01:
        bound = f"stays at least {floor_mm(claim.proved)} mm from it"
    wall = "the displaced wall" if claim.soft is not None else "the wall stated here"
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
            f"{error:.2f} mm. A clearance smaller than that decides nothing."
        )
    return texts

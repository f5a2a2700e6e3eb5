"""What a plan states beside its motion, compared with what that motion and its wall give anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..anatomy.tract import Finding
from ..checks import ceil_mm
from ..duct.base import Duct
from .measures import measure_moves, summarise_field
from .plan import ROUND_OFF_MM, Measures, Plan
from .planners import PLANNERS
from .space import FreeSpace, find_passage, grid_of

STATED_ROUND_OFF_MM = 0.01
"""How far what is stated of a centreline may be off, which is written rounded."""

ROUND_OFF = 1e-6
"""How far a stated number may be off the one found anew, by it."""

CLEARANCE_CODES = ("ENTRY_CLEARANCE", "GOAL_CLEARANCE", "NO_PASSAGE")
"""Refusals in which a clearance is needed."""


class FaultError(Exception):
    """What a check found wrong, one sentence."""


def check_measures(plan: Plan) -> str | None:
    """Compare the measures of a motion with those of its joints and clearances."""
    stated = plan.measures
    if stated is None:
        return None
    least = plan.clearance_min
    found = measure_moves(plan.joints, plan.head_arc_length)
    if np.isfinite(least):
        found["clearance_min"] = least
        if plan.displaced == 0.0:  # else it is that of the displaced wall
            step = int(np.unravel_index(int(np.argmin(plan.clearance)), plan.clearance.shape)[0])
            found["clearance_insertion"] = float(plan.head_arc_length[step])
    for name, anew in found.items():
        _compare(f"measures.{_name(name)}", getattr(stated, name), anew)
    shown = f"the smallest estimated clearance is {least:.3f} mm and " if np.isfinite(least) else ""
    return f"{shown}joints travel {found['joint_travel']:.0f} mm, as stated"


def _name(name: str) -> str:
    item = next(item for item in fields(Measures) if item.name == name)
    return f"{name}_{item.metadata['quantity'].unit}".rstrip("_")


def _compare(name: str, stated: float | None, anew: float) -> None:
    """Raise `FaultError` where a number is stated that is not the one found anew."""
    if stated is None:
        return
    if not abs(stated - anew) <= ROUND_OFF * max(1.0, abs(anew)):
        raise FaultError(f"the plan states {name} {stated:.6g}: it is {anew:.6g}")


def check_errors(plan: Plan) -> str | None:
    """Check that the error of a clearance is the sum of those that make it."""
    stated = plan.field
    if stated is None or stated.clearance_error is None:
        return None
    if stated.interpolation_error is None or stated.sampling_error is None:
        raise FaultError(
            f"the plan states field.clearance_error_mm {stated.clearance_error:g}, but not the "
            f"errors that make it"
        )
    total = stated.interpolation_error + stated.sampling_error
    if not abs(stated.clearance_error - total) <= ROUND_OFF * max(1.0, total):
        raise FaultError(
            f"the plan states field.clearance_error_mm {stated.clearance_error:.6g}, but "
            f"interpolation_error_mm {stated.interpolation_error:.6g} and sampling_error_mm "
            f"{stated.sampling_error:.6g}, whose sum it must be"
        )
    return f"clearances are estimated to within {ceil_mm(total)} mm, as stated"


def check_soft_wall(plan: Plan) -> str | None:
    """Compare what a plan states of its contact with its clearances, which are those at rest."""
    soft = plan.soft_wall
    if soft is None or plan.measures is None or not np.isfinite(plan.clearance_min):
        return None
    deepest = max(0.0, -plan.clearance_min)
    share = float((plan.clearance.min(axis=1) < 0.0).mean())
    _compare("soft_wall.contact_max_mm", soft.contact_max, deepest)
    _compare("soft_wall.contact_step_share", soft.contact_step_share, share)
    if soft.contact_where is not None and plan.measures.clearance_where is not None:
        _compare("soft_wall.contact_where_mm", soft.contact_where, plan.measures.clearance_where)
    return f"the wall is touched at {100.0 * share:.0f} % of the steps, as stated"


def check_named_ends(plan: Plan) -> None:
    """Check that the stated entry and goal are where the centreline begins and ends."""
    ends = plan.more.get("ends")
    if plan.centreline is None or not isinstance(ends, (list, tuple)):
        return
    places = {"entry": plan.centreline.points[0], "goal": plan.centreline.points[-1]}
    for role, place in places.items():
        named = [item for item in ends if isinstance(item, Mapping) and item.get("role") == role]
        given = [item.get("point_mm") for item in named if item.get("kind") == "end"]
        try:
            off = float(np.linalg.norm(np.asarray(given, dtype=float) - place))
        except (TypeError, ValueError):
            off = np.inf
        if len(given) != 1 or not off <= STATED_ROUND_OFF_MM:
            where = ", ".join(f"{value:.2f}" for value in place)
            said = " and ".join(map(str, given)) or "no place"
            raise FaultError(f"the plan states its {role} at {said} mm: it is at [{where}] mm")


def check_findings(plan: Plan, found: Sequence[Finding]) -> None:
    """Check that what is found on reading is stated; another version may find other things."""
    stated = plan.input is not None and plan.input.sha256 is not None
    if not stated or plan.versions.get("bozzini") != __version__:
        return
    for item in found:
        if f"{item.severity}: {item.message}" not in plan.findings:
            raise FaultError(f"the plan does not state what the file gives: {item.message}")


def check_scope(plan: Plan) -> str | None:
    """Check that a scope of a stated length has as many links as the motion."""
    if plan.scope is None or plan.scope.length is None:
        return None
    count = plan.scope.count_links(0.0)
    if count != plan.links:
        raise FaultError(
            f"a scope of {plan.scope.length:g} mm with links of {plan.scope.link_length:g} mm has "
            f"{count}: the motion has {plan.links}"
        )
    return f"{plan.links} links make the scope of {plan.scope.length:g} mm"


def check_method(plan: Plan) -> str | None:
    """Check that the planner is the one that was asked for."""
    if plan.method not in PLANNERS:
        return f"{plan.method!r} is none of this package's planners: only its motion is judged"
    if plan.asked in PLANNERS and plan.asked != "best" and plan.method != plan.asked:
        raise FaultError(f"the plan is by {plan.method!r}, but {plan.asked!r} was asked for")
    return None


def check_refusal(plan: Plan) -> str | None:
    """Compare the numbers of a refusal with the reason, the scope and the centreline."""
    refusal = plan.refusal
    if refusal is None:
        return None
    if refusal.code != plan.reason_code:
        raise FaultError(
            f"the plan stops by {plan.reason_code or 'nothing'}, but states why by {refusal.code}"
        )
    line = plan.centreline
    most = None if line is None else line.length + STATED_ROUND_OFF_MM
    for name in ("at", "ends_at"):
        value = getattr(refusal, name)
        if value is not None and most is not None and not -ROUND_OFF_MM <= value <= most:
            raise FaultError(
                f"the plan states refusal.{name}_mm {value:g}: its centreline has {most:g} mm"
            )
    if refusal.code in CLEARANCE_CODES and refusal.needs is not None and plan.scope is not None:
        if refusal.needs < plan.scope.radius - ROUND_OFF_MM:
            raise FaultError(
                f"the plan states that the scope needs {refusal.needs:g} mm: its radius is "
                f"{plan.scope.radius:g} mm"
            )
    return f"it stops by {refusal.code} at {refusal.at:.1f} mm of the centreline"


def check_certificate(plan: Plan) -> str | None:
    """Check that the place of the smallest clearance lies on the link that is stated."""
    proof = plan.certificate
    if proof is None or not np.isfinite(proof.clearance) or proof.link < 1:
        return None
    if proof.certified and proof.found < proof.clearance - ROUND_OFF_MM:
        raise FaultError(
            f"a place of {proof.found:.3f} mm is stated, but {proof.clearance:.3f} mm are claimed "
            f"everywhere"
        )
    if proof.link > plan.links or not 0.0 <= proof.step <= plan.steps - 1:
        raise FaultError(
            f"its closest place is on link {proof.link} at step {proof.step:g}: the motion has "
            f"{plan.links} links and {plan.steps} steps"
        )
    step = min(int(proof.step), plan.steps - 1)
    after = min(step + 1, plan.steps - 1)
    share = proof.step - step
    chain = (1.0 - share) * plan.joints[step] + share * plan.joints[after]
    head, tail = chain[proof.link - 1], chain[proof.link]
    place = np.asarray(proof.place)[: len(head)]
    along = tail - head
    part = float(np.clip((place - head) @ along / (along @ along), 0.0, 1.0))
    off = float(np.linalg.norm(place - head - part * along))
    if off > STATED_ROUND_OFF_MM:
        raise FaultError(
            f"its closest place lies {off:.3g} mm off link {proof.link} at step {proof.step:g}"
        )
    return None


def compare_field(plan: Plan, duct: Duct) -> str | None:
    """Compare the stated errors of a field with those of the field sampled anew."""
    stated = plan.field
    if stated is None:
        return None
    found = summarise_field(FreeSpace(duct, introducer=plan.introducer))
    if stated.kind and stated.kind != found.kind:
        raise FaultError(f"the plan states a field that is {stated.kind}: it is {found.kind}")
    for name in ("interpolation", "wall", "sampling", "clearance"):
        given, anew = (getattr(each, f"{name}_error") for each in (stated, found))
        if given is not None and anew is None:
            raise FaultError(f"the plan states field.{name}_error_mm {given:g}: it is not known")
        if anew is not None:
            _compare(f"field.{name}_error_mm", given, anew)
    return None


def compare_wall(plan: Plan, duct: Duct) -> None:
    """Compare what the plan says its wall is with what it is anew."""
    own = plan.certificate
    stated = [plan.wall, "" if own is None else own.wall]
    legal = (duct.wall, f"{duct.wall}, displaced by up to {plan.displaced:g} mm")
    for words in stated:
        if words and words not in legal:
            raise FaultError(f"the plan states its wall as '{words}': it is '{duct.wall}'")


def compare_path(plan: Plan, duct: Duct) -> str | None:
    """Compare the stated radius of the lumen along the path with that found anew."""
    over = np.abs(plan.path_radius + duct.signed_distance(plan.path))
    worst = int(np.argmax(over))
    if over[worst] > ROUND_OFF_MM:
        anew = -float(duct.signed_distance(plan.path[worst]))
        raise FaultError(
            f"the lumen is stated to have a radius of {plan.path_radius[worst]:.3f} mm at "
            f"{plan.path_arc_length[worst]:.1f} mm of the path: it has {anew:.3f} mm"
        )
    return "the radius of the lumen along the path is as stated"


def compare_passage(plan: Plan, duct: Duct) -> str | None:
    """Prove anew that nothing wider passes, where a refusal states that."""
    refusal, line = plan.refusal, plan.centreline
    if refusal is None or line is None:
        return None
    bounds = [] if refusal.diameter_bound is None else [0.5 * refusal.diameter_bound]
    if refusal.code == "NO_PASSAGE" and refusal.offers is not None:
        bounds.append(refusal.offers)
    if not bounds:
        return None
    grid = grid_of(duct)
    passage = find_passage(duct if grid is None else grid, line.points[0], goal=line.points[-1])
    for bound in bounds:
        if bound < passage.bound - STATED_ROUND_OFF_MM:
            raise FaultError(
                f"the plan states that no way has more than {ceil_mm(bound, 3)} mm: "
                f"{ceil_mm(passage.bound, 3)} mm "
                f"is what is proved"
            )
    return f"no way through has more than {ceil_mm(passage.bound)} mm, proved anew"


def compare_place(plan: Plan, worst: NDArray[np.float64]) -> None:
    """Compare where the smallest clearance is stated to be with where it is found (dim + 1,)."""
    measures, line = plan.measures, plan.centreline
    where = None if measures is None else measures.clearance_where
    if where is None or line is None or not np.isfinite(worst[-1]):
        return
    near = np.linalg.norm(line.points - worst[: line.points.shape[1]], axis=1)
    found = line.arc_length[near <= near.min() + STATED_ROUND_OFF_MM]
    if np.abs(found - where).min() > STATED_ROUND_OFF_MM:
        raise FaultError(
            f"the plan states its smallest clearance at {where:.1f} mm of the centreline: it is at "
            f"{found[0]:.1f} mm"
        )

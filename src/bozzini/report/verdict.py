"""The verdict: one sentence on whether the scope gets there, and how close to the wall."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..checks import ceil_mm, floor_beside, floor_mm
from ..motion.plan import Plan
from ..plot.plan_data import (
    PlanClearance,
    Record,
    WallContact,
    find_radius,
    read_centreline,
    read_clearance,
    read_number,
    read_part,
    read_parts,
)

CUT_OFF = ("component", "beyond")
"""Kinds of parts not reached to which a centreline without given ends had to lead."""

MISSING = "missing"
"""The kind of a part that the file lacks."""

SHARE_REACHED = 0.02
"""Up to this share of the lumen may be left out by what counts as all of it."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What a plan comes to.

    Parameters
    ----------
    tone : {"green", "amber", "red"}
        Green: reaches the end, clear of the wall. Amber: reaches the end, but the wall is nearer
        than the error of an estimate or than its own error, or states none, or has to give way; or
        lumen is missing or not reached, or something that the scope may meet was not checked. Red:
        through the wall, or stopped.
    label : str
        The same in a word or two.
    sentence : str
        The verdict: one or two sentences.
    notes : tuple of str
        What belongs to it, a sentence each: what was not reached where the sentence does not
        state it, up to which error of the wall the proof holds.
    """

    tone: str
    label: str
    sentence: str
    notes: tuple[str, ...] = ()


def judge_plan(plan: Plan, summary: Record, *, error: float = 0.0) -> Verdict:
    """Return the verdict on a plan.

    Parameters
    ----------
    plan : Plan
    summary : mapping
        The summary of the run; its clearances and their places are quoted, and taken from the
        plan where it lacks them.
    error : float
        Largest error of the distance to the wall [mm]. A clearance below it that is not
        certified is too close to call.
    """
    known = read_clearance(plan, summary)
    radius = find_radius(plan)
    scope = f"The {round(2.0 * radius, 6)} mm scope" if radius > 0.0 else "The scope"
    verdict = _judge(plan, summary, known, scope, error)
    verdict = _add_unreached(verdict, plan, summary)
    verdict = _add_unchecked(verdict, plan, summary)
    verdict = _add_robot(verdict, read_part(summary, "robot"))
    return _add_wall_error(verdict, plan, known, summary)


def _judge(plan: Plan, summary: Record, known: PlanClearance, scope: str, error: float) -> Verdict:
    if plan.status == "stopped":
        return _judge_stopped(plan, summary, known, scope)
    reaches = (
        f"{scope} reaches {_read_goal(summary)} "
        f"({_read_length(plan, summary):.0f} mm of centreline)"
    )
    if known.soft is not None:
        return _judge_contact(reaches, known, known.soft)
    if known.certified:
        return Verdict(
            tone="green",
            label="Fits, proved",
            sentence=f"{reaches}; proved to {_promise(known)} at all times.",
        )
    where = _at(known.place)
    if known.estimate is None:
        return Verdict(tone="amber", label="Clearance unknown", sentence=f"{reaches}.")
    if known.estimate < 0.0:
        return Verdict(
            tone="red",
            label="Through the wall",
            sentence=f"{reaches}, but its body passes through the wall{where} "
            f"by {ceil_mm(-known.estimate)} mm.",
        )
    if known.estimate < error:
        shown = floor_beside(known.estimate, error)
        return Verdict(
            tone="amber",
            label="Too close to call",
            sentence=f"{reaches}, but comes within {shown[0]} mm of the wall{where}: "
            f"less than the {shown[1]} mm by which the distance may be wrong.",
        )
    return Verdict(
        tone="green",
        label="Fits",
        sentence=f"{reaches} and keeps {known.estimate:.2f} mm from the wall (nearest{where}).",
    )


def _add_unreached(verdict: Verdict, plan: Plan, summary: Record) -> Verdict:
    """State what of the lumen is not reached: a plan fits only to the end that it reaches."""
    parts = list_unreached(summary)
    told = [part for part in parts if part.get("stated")]
    chosen = _is_goal_given(summary)
    share = sum(read_number(part, "share") or 0.0 for part in parts)
    lacks = sum(read_number(part, "share") or 0.0 for part in parts if part.get("kind") == MISSING)
    # What is left out on purpose is named, too, but it is no lack of the plan.
    left = read_number(summary, "unreached_share")
    left = (0.0 if chosen else share) if left is None else left
    if left > SHARE_REACHED and not told:
        told = parts
    if not told:
        return verdict
    gone = [str(part["text"]) for part in told if part.get("kind") == MISSING]
    rest = [part for part in told if part.get("kind") != MISSING]
    texts = gone
    if rest:
        texts.append(f"not reached: {join_words([str(part['text']) for part in rest])}")
    text = "; ".join(texts)
    text = f"{_begin_sentence(text)}."
    if plan.status == "stopped":
        return replace(verdict, notes=(*verdict.notes, text))
    label, tone = verdict.label, verdict.tone
    if label.startswith("Fits") and chosen:
        label = label.replace("Fits", f"Fits to {_read_goal(summary)}", 1)
    elif label.startswith("Fits") and not _are_ends_given(summary) and _is_cut_off(told):
        label = label.replace("Fits", "Reaches the end of a part", 1)
    elif label.startswith("Fits") and (left > SHARE_REACHED or lacks > 0.0):
        label = label.replace("Fits", f"Reaches {_read_goal(summary)}", 1)
    if share > 0.0 and verdict.tone != "red":
        how = "not reached" if lacks <= 0.0 else "is missing in the file"
        how = "not reached or missing in the file" if 0.0 < lacks < share else how
        part = f"{100.0 * share:.0f} %" if share >= 0.01 else "under 1 %"
        label += f"; {part} of the lumen {how}"
        tone = "amber"
    return replace(verdict, label=label, tone=tone, sentence=f"{verdict.sentence} {text}")


def _is_cut_off(parts: Sequence[Record]) -> bool:
    return any(part.get("kind") in CUT_OFF for part in parts)


REACHES = ("Fits", "Reaches", "The scope fits")
"""How labels begin of plans that reach their end."""

VOXEL_SURFACE = "voxel-surface"
"""The code of the finding that a surface was made from voxels, and of which size."""

UNCHECKED = {
    "introducer-crosses": "the introducer crosses the organ",
    "parts-cross": "parts left out reach into the lumen",
    "version-doubtful": "the labels may be of another version",
    "affines-differ": "the file states two places or sizes",
}
"""Findings of what the proof does not cover, and each in a few words."""


def _add_unchecked(verdict: Verdict, plan: Plan, summary: Record) -> Verdict:
    """State what the scope may meet that nothing was proved of."""
    for item in read_parts(summary, "findings"):
        words = UNCHECKED.get(str(item.get("code")))
        if words is None:
            continue
        message = str(item.get("message", words)).strip().rstrip(".")
        text = f"{_begin_sentence(message)}."
        if plan.status == "stopped":
            verdict = replace(verdict, notes=(*verdict.notes, text))
            continue
        verdict = replace(
            verdict,
            label=f"{verdict.label}; {words}",
            tone="amber" if verdict.tone == "green" else verdict.tone,
            sentence=f"{verdict.sentence} {text}",
        )
    return verdict


def _begin_sentence(text: str) -> str:
    """Return a text with a capital letter, but where it begins with a label's or a file's name."""
    is_name = re.match(r"\w*[-:._/0-9]\w", text)
    return text if is_name else f"{text[:1].upper()}{text[1:]}"


def _add_robot(verdict: Verdict, robot: Record) -> Verdict:
    """State that a robot does not follow a plan that its scope fits."""
    if robot.get("fits", True) or verdict.tone == "red":
        return verdict
    name = f"robot '{robot.get('name', '')}'"
    label = verdict.label.replace("Fits", "The scope fits", 1)
    return replace(
        verdict,
        tone="red",
        label=f"{label}; {name} does not get there",
        sentence=f"{verdict.sentence} The {name} does not follow: {robot.get('reason', '')}.",
    )


def _add_wall_error(verdict: Verdict, plan: Plan, known: PlanClearance, summary: Record) -> Verdict:
    """State for which error of the given wall the clearance holds, or that this is not known."""
    error, stated = _read_wall_error(plan, summary), read_number(summary, "label_error_mm")
    source = read_number(summary, "source_error_mm")
    limits = [error or 0.0, *(each for each in (stated, source) if each is not None)]
    if known.certified and known.proved is not None:
        kept = known.proved
        shown = floor_beside(kept, *limits)
        text = f"The proof holds as long as the given wall is wrong by at most {shown[0]} mm"
    elif verdict.label.startswith(REACHES) and not known.soft and known.estimate is not None:
        kept = known.estimate
        shown = floor_beside(kept, *limits)
        text = f"The estimate of {shown[0]} mm is for the given wall"
    else:
        return verdict
    label, tone = verdict.label, verdict.tone
    if error is None and stated is None:
        label = label.replace("Fits", "Fits this surface", 1) if label.startswith("Fits") else label
        if tone != "red" and source is None:
            label += "; the surface's own error is not known"
        elif tone != "red" and source is not None:
            whether = "also" if kept >= source else "not"
            label += f"; {whether} for a wall wrong by the {shown[-1]} mm of its voxels"
        text += "; the surface states no error of its own: give it with --label-error"
        for item in read_parts(summary, "findings"):
            if item.get("code") == VOXEL_SURFACE:
                text += f". Of its error: {item.get('message')}"
    elif error:
        relation = "more" if kept >= error else "less"
        text += f", {relation} than the {shown[1]} mm by which its resolution may displace it"
        if kept < error and ", proved" in label:
            label = label.replace(", proved", ", proved for the stated wall", 1)
        elif kept < error:
            label = label.replace("Fits", "Fits the stated wall", 1)
    if stated is not None:
        covers = kept >= stated
        text += f"; it {'covers' if covers else 'does not cover'} the stated error of {stated:g} mm"
        if not covers and tone != "red":
            label = f"{label}; not for a wall wrong by {stated:g} mm"
    if label != verdict.label and tone == "green":
        tone = "amber"
    return replace(verdict, label=label, tone=tone, notes=(*verdict.notes, f"{text}."))


def _read_wall_error(plan: Plan, summary: Record) -> float | None:
    """Return what the wall may be wrong by [mm]; 0 where nothing is said of the wall at all."""
    if "wall_error_mm" in summary:
        return read_number(summary, "wall_error_mm")
    return 0.0 if plan.field is None else plan.field.wall_error


def list_unreached(summary: Record) -> list[Record]:
    """Return what a summary lists as not reached, largest first."""
    return [part for part in read_parts(summary, "unreached") if part.get("text")]


def join_words(words: Sequence[str]) -> str:
    """Return words as a list for people: ``a, b and c``."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _are_ends_given(summary: Record) -> bool:
    """Whether an end of the centreline was given, or is not stated not to be."""
    return read_part(summary, "goal").get("given") is not False


def _read_goal(summary: Record) -> str:
    return str(read_part(summary, "goal").get("name") or "the far end")


def _is_goal_given(summary: Record) -> bool:
    return bool(read_part(summary, "goal").get("chosen"))


def _judge_stopped(plan: Plan, summary: Record, known: PlanClearance, scope: str) -> Verdict:
    reason = plan.reason.strip().rstrip(".") or plan.reason_code or "no reason was recorded"
    place = float(read_centreline(plan).to_centreline(plan.head_arc_length).max())
    whole = _read_length(plan, summary)
    if place <= 0.0:
        sentence = f"{scope} does not enter: {reason}."
        return Verdict(tone="red", label="Stopped", sentence=sentence)
    sentence = f"{scope} stops at {place:.0f} mm of {whole:.0f} mm of centreline: {reason}."
    estimate, where = known.estimate, _at(known.place)
    note = ""
    if known.soft is not None:
        note = f"Up to there {_describe_contact(known, known.soft)}."
    elif known.certified:
        note = f"Up to there it is proved to {_promise(known)} at all times."
    elif estimate is not None and estimate < 0.0:
        note = f"Before that its body passes through the wall{where} by {ceil_mm(-estimate)} mm."
    elif estimate is not None:
        note = f"Up to there it keeps {estimate:.2f} mm from the wall (nearest{where})."
    notes = (note,) if note else ()
    return Verdict(tone="red", label="Stopped", sentence=sentence, notes=notes)


def _judge_contact(reaches: str, known: PlanClearance, soft: WallContact) -> Verdict:
    if not known.certified and soft.contact > soft.used:
        return Verdict(
            tone="red",
            label="Through the wall",
            sentence=f"{reaches}, but its body stands up to {ceil_mm(soft.contact)} mm beyond the "
            "wall"
            f"{_at(soft.place)}, which gives way by at most {soft.used:g} mm.",
        )
    return Verdict(
        tone="amber",
        label="Fits with contact",
        sentence=f"{reaches} if the wall gives way: {_describe_contact(known, soft)}.",
    )


def _describe_contact(known: PlanClearance, soft: WallContact) -> str:
    if soft.contact > 0.0:
        text = f"it pushes the wall outwards by up to {ceil_mm(soft.contact)} mm{_at(soft.place)}"
    else:
        text = "no contact was found at the recorded steps"
    proof = "it is proved" if known.certified else "it is not proved"
    return f"{text}; {proof} that the wall never has to give way by more than {soft.used:g} mm"


def _promise(known: PlanClearance) -> str:
    """Return what is proved, as what follows "proved to"; rounded down, as a lower bound is."""
    wall = f"the wall inflated by {known.inflation:g} mm" if known.inflation > 0.0 else "the wall"
    if known.proved is None or known.proved < 0.01:
        return f"stay inside {wall}"
    return f"stay at least {floor_mm(known.proved)} mm from {wall}"


def _at(place: float | None) -> str:
    return "" if place is None else f" at {place:.0f} mm of the centreline"


def _read_length(plan: Plan, summary: Record) -> float:
    stated = read_number(summary, "centreline_length_mm")
    return read_centreline(plan).length if stated is None else stated

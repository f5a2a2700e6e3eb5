"""The verdict says no more than is known, and says it in one sentence."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.report.verdict import judge_plan
from tests.plot.fake_motion import make_plan, make_stopped, make_summary


@pytest.mark.parametrize(
    ("changes", "label", "tone", "words"),
    [
        (
            {},
            "Fits",
            "green",
            "reaches the far end (80 mm of centreline) and keeps 4.00 mm",
        ),
        (
            {"dent": 4.4},
            "Through the wall",
            "red",
            "passes through the wall at 40 mm of the centreline by 0.40 mm",
        ),
        (
            {"dent": 3.9},
            "Too close to call",
            "amber",
            "0.10 mm of the wall at 40 mm of the centreline",
        ),
        (
            {"reach": 61.0, "status": "stopped"},
            "Stopped",
            "red",
            "at 61 mm of 80 mm of centreline: link 3 is locked. Up to there it keeps 4.00 mm",
        ),
        (
            {"reach": 61.0, "status": "stopped", "dent": 5.0},
            "Stopped",
            "red",
            "Before that its body passes through the wall at 40 mm of the centreline by 1.00 mm",
        ),
    ],
)
def test_verdict(changes, label, tone, words):
    plan = make_plan(**changes)
    verdict = judge_plan(plan, make_summary(plan), error=0.5)
    assert (verdict.label, verdict.tone) == (label, tone)
    assert words in " ".join([verdict.sentence, *verdict.notes])
    assert verdict.sentence.count(". ") <= 1
    # Without a summary the plan itself gives the same verdict.
    assert judge_plan(plan, {}, error=0.5).tone == tone


@given(proved=st.floats(0.0, 3.9), error=st.floats(0.0, 9.0))
def test_what_is_proved_is_never_too_close_and_never_overstated(proved, error):
    plan = make_plan(meta={"certified": True})
    summary = {**make_summary(plan), "certified": True, "clearance_certified_mm": proved}
    verdict = judge_plan(plan, summary, error=error)
    assert (verdict.tone, verdict.label) == ("green", "Fits, proved")
    quoted = re.search(r"at least ([0-9.]+) mm from the wall at all times", verdict.sentence)
    if quoted:
        assert 0.0 <= proved - float(quoted[1]) < 0.01 + 1e-6
    else:
        assert proved < 0.01 and "proved to stay inside the wall" in verdict.sentence


def test_the_bound_is_taken_from_the_certificate_where_the_summary_lacks_it():
    plan = make_plan(meta={"certified": True, "certificate": {"clearance_mm": 1.239}})
    summary = {**make_summary(plan), "certified": True}
    assert "at least 1.23 mm from the wall" in judge_plan(plan, summary).sentence
    inflated = judge_plan(plan, {**summary, "inflation_mm": 4.0}).sentence
    assert "at least 1.23 mm from the wall inflated by 4 mm" in inflated
    # A bound alone is no proof.
    doubted = judge_plan(plan, {**summary, "certified": False, "clearance_certified_mm": 1.2})
    assert "proved" not in doubted.sentence + doubted.label


def test_a_stopped_plan_is_proved_as_far_as_it_goes():
    plan = make_stopped()
    verdict = judge_plan(plan, {**make_summary(plan), "certified": True})
    assert (verdict.tone, verdict.label) == ("red", "Stopped")
    assert "stops at 50 mm of 80 mm of centreline: link 3 is locked" in verdict.sentence
    assert "Up to there it is proved to stay at least 3.45 mm from the wall" in verdict.notes[0]
    outside = make_plan(steps=1, reach=0.0, status="stopped", meta={"certified": False})
    assert "does not enter: link 3 is locked." in judge_plan(outside, {}).sentence


SOFT = {"allowed_mm": 4.0, "used_mm": 2.0, "contact_max_mm": 1.25, "contact_where_mm": 41.0}


@pytest.mark.parametrize("where", ["summary", "meta"])
def test_contact_is_amber_and_says_how_deep_and_where(where):
    meta = {"certified": True, **({"soft_wall": SOFT} if where == "meta" else {})}
    plan = make_plan(dent=5.25, meta=meta)
    summary = {**make_summary(plan), "certified": True}
    if where == "summary":
        summary["soft_wall"] = SOFT
    verdict = judge_plan(plan, summary)
    assert (verdict.tone, verdict.label) == ("amber", "Fits with contact")
    assert "by up to 1.25 mm at 41 mm of the centreline" in verdict.sentence
    assert "proved that the wall never has to give way by more than 2 mm" in verdict.sentence


def test_a_wall_that_need_not_give_way_is_no_contact():
    plan = make_plan(meta={"certified": True})
    summary = {**make_summary(plan), "certified": True, "clearance_certified_mm": 0.5}
    summary["soft_wall"] = {"allowed_mm": 4.0, "used_mm": 0.0, "contact_max_mm": 0.0}
    assert judge_plan(plan, summary).label == "Fits, proved"


def test_a_soft_wall_that_gives_way_too_little_is_red():
    plan = make_plan(dent=9.0)
    summary = {**make_summary(plan), "soft_wall": {**SOFT, "contact_max_mm": 5.0}}
    verdict = judge_plan(plan, summary)
    assert verdict.tone == "red" and "5.00 mm beyond the wall" in verdict.sentence
    stopped = make_stopped()
    summary = {**make_summary(stopped), "certified": True, "soft_wall": SOFT}
    verdict = judge_plan(stopped, summary)
    words = " ".join([verdict.sentence, *verdict.notes])
    assert "pushes the wall outwards by up to 1.25 mm" in words and "through" not in words


@pytest.mark.parametrize("changes", [{}, {"reach": 61.0, "status": "stopped"}])
@pytest.mark.parametrize("code", ["parts-cross", "introducer-crosses"])
def test_what_the_proof_does_not_cover_stands_in_the_verdict(code, changes):
    plan = make_plan(**changes)
    summary = make_summary(plan)
    bare = judge_plan(plan, {**summary, "findings": [{"code": "scale", "message": "it is long"}]})
    message = "parts left out reach into the lumen: 'polyp'; the scope may cross them"
    told = judge_plan(plan, {**summary, "findings": [{"code": code, "message": message}]})
    text = message.replace("parts", "Parts", 1) + "."
    if changes:
        assert told == replace(bare, notes=(*bare.notes, text))
        return
    assert told.sentence == f"{bare.sentence} {text}"
    assert told.tone == "amber" and told.label.startswith(f"{bare.label}; ")


@given(proved=st.floats(0.001, 3.9), share=st.floats(0.98, 1.02))
def test_what_is_proved_reads_apart_from_the_walls_error(proved, share):
    plan = make_plan(meta={"certified": True})
    error = proved * share
    summary = {**make_summary(plan), "certified": True, "clearance_certified_mm": proved}
    text = " ".join(judge_plan(plan, {**summary, "wall_error_mm": error}).notes)
    found = re.search(r"at most ([0-9.]+) mm, (more|less) than the ([0-9.]+)", text)
    assert found is not None
    kept, relation, other = found.groups()
    assert float(kept) <= proved
    if error != proved:
        assert float(kept) != float(other)
    assert relation == ("more" if proved >= error else "less")


def test_a_small_part_not_reached_is_not_rounded_up():
    plan = make_plan()
    part = {"text": "a pouch", "share": 0.0005, "stated": True, "kind": "branch"}
    assert (
        "; under 1 % of the lumen not reached"
        in judge_plan(plan, {**make_summary(plan), "unreached": [part]}).label
    )


@given(kept=st.floats(0.1, 3.9), apart=st.floats(-0.02, 0.02))
def test_the_error_that_the_proof_covers_reads_as_large_as_the_stated_one(kept, apart):
    stated = round(kept + apart, 3)
    plan = make_plan(meta={"certified": True})
    summary = {**make_summary(plan), "certified": True, "clearance_certified_mm": kept}
    note = judge_plan(plan, {**summary, "label_error_mm": stated}).notes[-1]
    shown = float(re.search(r"wrong by at most ([0-9.]+) mm", note)[1])
    assert shown <= kept
    assert (shown >= stated) == (kept >= stated) == ("it covers the stated error" in note)


@pytest.mark.parametrize("diameter", [5.96, 6.0])
def test_a_diameter_is_written_as_it_was_given(diameter):
    plan = make_plan()
    plan = replace(plan, scope=replace(plan.scope, diameter=diameter))
    sentence = judge_plan(plan, make_summary(plan)).sentence
    assert float(re.match(r"The ([0-9.]+) mm scope", sentence)[1]) == diameter


@pytest.mark.parametrize("stopped", [False, True])
def test_a_wall_just_passed_is_not_passed_by_nothing(stopped):
    plan = make_stopped() if stopped else make_plan()
    verdict = judge_plan(plan, {**make_summary(plan), "clearance_min_mm": -0.001})
    depth = re.search(r"by ([0-9.]+) mm", " ".join([verdict.sentence, *verdict.notes]))
    assert float(depth[1]) >= 0.001


def test_an_identifier_keeps_its_small_letters():
    plan = make_plan()
    finding = {"code": "version-doubtful", "message": "totalsegmentator-v2:colon is label 20"}
    sentence = judge_plan(plan, {**make_summary(plan), "findings": [finding]}).sentence
    assert "totalsegmentator-v2:colon" in sentence


@given(kept=st.floats(0.001, 3.9), source=st.floats(0.001, 3.9) | st.none())
def test_a_surface_that_states_no_error_is_amber_and_compared_with_its_voxels(kept, source):
    plan = make_plan(meta={"certified": True})
    proved = {"certified": True, "clearance_certified_mm": kept}
    stated = {"wall_error_mm": None, "source_error_mm": source}
    verdict = judge_plan(plan, {**make_summary(plan), **proved, **stated})
    assert verdict.tone == "amber" and verdict.label.startswith("Fits this surface, proved; ")
    assert "--label-error" in verdict.notes[-1]
    found = re.search(r"; (also|not) for a wall wrong by the ([0-9.]+) mm of", verdict.label)
    if source is None:
        assert found is None and verdict.label.endswith("the surface's own error is not known")
        return
    assert (found[1] == "also") == (kept >= source) and float(found[2]) >= source


@pytest.mark.parametrize("chosen", [False, True])
def test_a_lumen_of_which_a_little_is_missing_is_no_fit_but_to_an_end_that_was_chosen(chosen):
    plan = make_plan(meta={"certified": True})
    part = {"text": "0.1 mL are missing", "share": 0.001, "stated": True, "kind": "missing"}
    goal = {"name": "the given end", "given": chosen, "chosen": chosen}
    summary = {**make_summary(plan), "certified": True, "clearance_certified_mm": 1.0}
    verdict = judge_plan(plan, {**summary, "unreached": [part], "goal": goal, "unreached_share": 0})
    begin = "Fits to the given end" if chosen else "Reaches the given end"
    assert verdict.label.startswith(begin) and verdict.tone == "amber"
    assert "under 1 % of the lumen is missing in the file" in verdict.label

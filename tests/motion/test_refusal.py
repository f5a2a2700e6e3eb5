"""What a refusal says: rounding that never flatters, advice only where there is some."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bozzini.checks import floor_beside, floor_mm
from bozzini.motion import Scope
from bozzini.motion.plan import write_record
from bozzini.motion.refusal import REASON_CODES, Refusal
from bozzini.motion.tube import _no_path


@given(st.floats(-50.0, 50.0))
def test_a_length_offered_is_rounded_down(value):
    written = float(floor_mm(value))
    assert written <= value + 1e-8
    assert value - written < 0.01 + 1e-8
    assert re.fullmatch(r"-?\d+\.\d\d", floor_mm(value))
    for shown in (floor_beside(value, value + 1e-9), floor_beside(1e-9 * value, 1e-8)):
        assert all(re.fullmatch(r"-?\d+\.\d+", one) for one in shown)


def test_lengths_near_0_read_apart_as_numbers():
    one, other = floor_beside(1e-9, 1e-8)
    assert 0.0 <= float(one) <= 1e-9 and float(other) >= 1e-8


@given(radius=st.floats(0.5, 6.0), lack=st.floats(0.011, 3.0))
def test_what_is_offered_never_reads_like_what_is_needed(radius, lack):
    refusal = Refusal.at_entry(Scope(diameter=2.0 * radius, link_length=5.0), radius - lack)
    needs, offers = (float(v) for v in re.findall(r"(-?\d+\.\d\d) mm", refusal.what)[:2])
    assert offers < needs
    # What would fit is not known before it has been planned.
    assert refusal.inflate is None and refusal.diameter_max is None


@given(radius=st.floats(0.5, 6.0), share=st.floats(0.0, 0.99))
def test_what_the_proof_needs_is_told_apart_from_the_scope(radius, share):
    scope = Scope(diameter=2.0 * radius, link_length=5.0)
    refusal = Refusal.at_entry(scope, radius + 0.05 * share, slack=0.05)
    words = r"needs ([0-9.]+) mm from its axis to the wall and 0.05 mm for the proof"
    assert abs(float(re.search(words, refusal.what)[1]) - radius) <= 0.005 + 1e-9
    assert refusal.needs > refusal.offers


def test_no_way_for_any_link_is_not_called_too_long_a_link():
    job = SimpleNamespace(
        scope=Scope(diameter=12.5, link_length=5.0),
        line=SimpleNamespace(arc_length=np.array([0.0, 10.0])),
        bound=np.array([6.27, 6.27]),
        passages=SimpleNamespace(grid=None),
    )
    refusal = _no_path(job, 5.0, 6.0, math.inf)
    assert "links of any length" in refusal.what
    assert "LINK" not in refusal.code and "whatever the links" in REASON_CODES[refusal.code]
    assert "6.25 mm" in refusal.what and "0.05 mm for the proof" in refusal.what


def make(**changes):
    values = {
        "code": "NO_PASSAGE",
        "at": 12.0,
        "needs": 3.0,
        "offers": 2.0,
        "what": "does not fit",
    }
    return Refusal(**{**values, **changes})


def test_advice_lists_what_was_found_and_no_more():
    assert make().reason == "does not fit"
    reason = make(diameter_max=4.55, link_max=8.0, inflate=0.9, diameter_bound=5.0).reason
    assert "a scope of 4.55 mm diameter" in reason
    assert "links of 8.00 mm" in reason
    assert "inflated by 0.9 mm" in reason
    assert reason.count(" or ") == 2
    assert "5.00" not in reason


def test_without_a_plan_an_upper_bound_is_called_so():
    reason = make(diameter_bound=4.0001).reason
    assert "at most 4.01 mm could pass, but no plan was found" in reason
    assert "Would fit" not in reason
    # A bound that the scope keeps is no answer.
    assert make(diameter_bound=6.5).reason == "does not fit"


@given(at=st.floats(0.0, 900.0), end=st.floats(0.0, 900.0))
def test_a_motion_that_ends_elsewhere_names_its_end_on_the_centreline(at, end):
    reason = make(at=at, diameter_max=3.0).stop_at(end).reason
    assert ("the motion ends at" in reason) == (abs(at - end) > 10.0)
    assert reason.count(". ") <= 1
    if abs(at - end) > 10.0:
        assert f"{end:.1f} mm of the centreline" in reason


def test_advice_is_added_without_changing_the_statement():
    plain = make()
    advised = replace(plain, link_max=6.0)
    assert advised.what == plain.what and plain.link_max is None
    assert advised.reason != plain.reason


def test_a_description_is_plain_json():
    description = write_record(make(link_max=3.0))
    assert json.loads(json.dumps(description, allow_nan=False)) == description
    assert description["code"] in REASON_CODES
    assert description["link_max_mm"] == 3.0 and description["inflate_mm"] is None


def test_an_angle_is_stated_in_degrees():
    reason = Refusal.at_angle(math.radians(30.0), 55.0, at=52.0, joint=3).reason
    assert "at the joint of links 3 and 4" in reason
    assert "30.0 deg" in reason
    assert (
        "52.0 mm of the centreline" in reason and "head 55.0 mm inserted along its path" in reason
    )

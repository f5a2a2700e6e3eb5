"""What a refusal says: rounding that never flatters, advice only where there is some."""

from __future__ import annotations

import json
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.motion import Scope
from bozzini.motion.refusal import REASON_CODES, Refusal, floor_mm


@given(st.floats(-50.0, 50.0))
def test_a_length_offered_is_rounded_down(value):
    written = float(floor_mm(value))
    assert written <= value + 1e-8
    assert value - written < 0.01 + 1e-8
    assert re.fullmatch(r"-?\d+\.\d\d", floor_mm(value))


@given(radius=st.floats(0.5, 6.0), lack=st.floats(0.011, 3.0))
def test_what_is_offered_never_reads_like_what_is_needed(radius, lack):
    refusal = Refusal.at_entry(Scope(diameter=2.0 * radius, link_length=5.0), radius - lack)
    needs, offers = (float(v) for v in re.findall(r"(-?\d+\.\d\d) mm", refusal.what)[:2])
    assert offers < needs
    assert refusal.inflate == pytest.approx(lack)
    assert refusal.diameter_max == pytest.approx(2.0 * (radius - lack))


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
    assert make(diameter_max=-0.5, link_max=0.0, inflate=-1.0).reason == "does not fit"
    reason = make(diameter_max=4.567, link_max=8.0, inflate=0.91).reason
    assert "4.56 mm diameter" in reason
    assert "8.00 mm" in reason
    # An inflation is rounded up, as a diameter is rounded down.
    assert "1.0 mm" in reason
    assert reason.count(" or ") == 2


@given(st.floats(0.01, 9.0))
def test_inflation_advised_is_enough(lack):
    advised = float(re.findall(r"about (\d+\.\d) mm", make(inflate=lack).reason)[0])
    assert lack - 1e-9 <= advised <= lack + 0.1 + 1e-9


def test_advice_is_added_without_changing_the_statement():
    plain = make()
    advised = plain.advise(link_max=6.0)
    assert advised.what == plain.what and plain.link_max is None
    assert advised.reason != plain.reason


def test_a_description_is_plain_json():
    description = make(link_max=3.0).describe()
    assert json.loads(json.dumps(description, allow_nan=False)) == description
    assert description["code"] in REASON_CODES
    assert description["link_max_mm"] == 3.0 and description["inflate_mm"] is None


def test_an_angle_is_stated_in_degrees():
    assert "30.0 deg" in Refusal.at_angle(math.radians(30.0), 55.0).reason

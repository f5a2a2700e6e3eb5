"""A centreline moved to where the duct has more clearance: never to less."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.duct import Centreline, RoundCones
from bozzini.duct.centreline import widen_line
from tests.shapes import bend_curve

BEND = bend_curve(30.0, 2.0, 15.0)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), off=st.floats(0.0, 3.0))
def test_clearance_does_not_get_less_and_ends_stay(seed, off):
    random = np.random.default_rng(seed)
    duct = RoundCones(BEND, random.uniform(6.0, 9.0, len(BEND)))
    aside = np.cumsum(random.normal(0.0, 1.0, BEND.shape), axis=0)
    aside *= off / max(float(np.linalg.norm(aside, axis=1).max()), 1e-9)
    line = Centreline.from_points(BEND + aside, duct)
    wider = widen_line(line, duct)
    assert wider.radius.min() >= line.radius.min() - 1e-9
    assert wider.points[[0, -1]] == pytest.approx(line.points[[0, -1]])
    assert wider.radius == pytest.approx(-duct.signed_distance(wider.points))


def test_a_way_along_the_wall_comes_to_the_middle():
    centres = np.array([[0, 0, 0], [0, 0, 60.0]])
    duct = RoundCones(centres, np.full(2, 8.0))
    way = np.stack([np.zeros(61), 3.0 * np.sin(np.linspace(0, np.pi, 61)), np.arange(61.0)], 1)
    wider = widen_line(Centreline.from_points(way, duct), duct)
    assert wider.radius.min() > 7.5

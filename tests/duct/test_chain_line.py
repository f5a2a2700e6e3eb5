"""The way along a chain of shapes: through its middle, between the ends that are asked for."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.duct import RoundCones
from bozzini.duct.centreline import follow_chain
from bozzini.duct.shapes.cylinders import ConnectedCylinders
from tests.shapes import bend_curve

BEND = bend_curve(30.0, 2.0, 15.0)


def make(kind, radius=8.0):
    if kind == "cones":
        return RoundCones(BEND, np.full(len(BEND), radius))
    return ConnectedCylinders(BEND, np.gradient(BEND, axis=0), np.full(len(BEND), radius))


@pytest.mark.parametrize("kind", ["cones", "cylinders"])
def test_the_way_is_in_the_middle(kind):
    chain = make(kind)
    line = follow_chain(chain)
    away = np.linalg.norm(line.points[:, None] - BEND, axis=-1).min(axis=1)
    assert away.max() <= 2.0
    assert line.radius == pytest.approx(-chain.signed_distance(line.points))
    # Of a tube 16 mm wide all of it is kept, up to where its flat ends take the room away.
    assert line.radius.min() > 7.0
    assert np.diff(line.arc_length).max() <= 1.0 + 1e-9
    lost = np.linalg.norm(line.points[[0, -1]] - BEND[[0, -1]], axis=1).max()
    assert lost < (1e-2 if kind == "cones" else 12.0)


@pytest.mark.parametrize("kind", ["cones", "cylinders"])
def test_ends_that_are_given_are_kept_to(kind):
    chain = make(kind)
    start, end = BEND[-8] + [0.0, 0.0, 1.0], BEND[9]
    both = follow_chain(chain, (start, end))
    assert np.linalg.norm(both.points[0] - start) < 2.0
    assert np.linalg.norm(both.points[-1] - end) < 2.0
    # With one of them the way goes to the end of the chain that is farther from it.
    far, near = follow_chain(chain, (start, None)), follow_chain(chain, (None, start))
    assert np.linalg.norm(far.points[-1] - BEND[0]) < 12.0
    assert far.length > 0.5 * follow_chain(chain).length
    assert near.reverse().points == pytest.approx(far.points)


def test_a_chain_that_stands_still_between_two_balls_has_a_way():
    centres = np.array([[0, 0, 0], [0, 0, 0], [0, 0, 20.0]])
    line = follow_chain(RoundCones(centres, np.array([4.0, 5.0, 5.0])))
    assert line.length == pytest.approx(20.0, rel=1e-2)

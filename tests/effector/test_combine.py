"""Two muscles by the thesis's eight steps: its example, the steps as printed, and their defects."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.effector import (
    Effector,
    EffectorDesign,
    PlacedMuscle,
    bend,
    effector_preset,
    find_resultant,
    lateral_deflection,
    place_curve,
)
from bozzini.effector.pose import combine_bends, take_order
from bozzini.errors import GeometryError
from bozzini.muscle import preset as muscle_preset
from tests.effector.reference import combine_printed

DESIGN = effector_preset("prototype")
EFFECTOR = Effector(DESIGN)


def combine(effector, contractions, order=None):
    """Backbone of contractions by name, with the forces of the beam."""
    design = effector.design
    table = np.array([[contractions.get(name, 0.0) for name in design.names]])
    forces = lateral_deflection(design, table) / design.compliance
    return combine_bends(effector, table, forces, take_order(effector, order))[0]


def measure(backbone):
    pieces = np.linalg.norm(np.diff(backbone, axis=0), axis=-1)
    return float(pieces.sum()), float(pieces.min()), float(pieces.max())


def test_direction_cosines_of_the_example():
    """G at 689 kPa and 1.61 N, R at 413 kPa and 1.28 N; the other way round does not give it."""
    found = find_resultant(np.radians([307.5, 219.0]), [1.28, 1.61])
    assert found == pytest.approx([-0.17, -0.70], abs=0.01)
    assert math.degrees(math.atan2(-found[0], -found[1])) == pytest.approx(13.3, abs=0.3)
    other = find_resultant(np.radians([307.5, 219.0]), [1.61, 1.28])
    assert abs(other[0] + 0.17) > 0.1
    # They are no direction cosines: no unit vector.
    assert np.linalg.norm(found) == pytest.approx(0.72, abs=0.005)


def test_resultant_is_the_moment():
    angles, forces = np.radians([307.5, 219.0, 75.0]), np.array([[1.0, 2.0, 0.5], [0.0, 0.0, 0.0]])
    found = find_resultant(angles, forces)
    arms = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1)
    moment = np.cross(arms, forces[0][:, None] * [0.0, 0.0, 1.0]).sum(axis=0)
    whole = np.cross([*found[0], 0.0], [0.0, 0.0, forces[0].sum()])
    assert whole == pytest.approx(moment)
    assert np.array_equal(found[1], [0.0, 0.0])


@given(
    st.sampled_from([("R", "G"), ("G", "R"), ("R", "B"), ("B", "G"), ("G", "B")]),
    st.floats(1.0, 10.0),
    st.floats(1.0, 10.0),
)
def test_against_the_steps_as_printed(order, one, two):
    contractions = {order[0]: one, order[1]: two}
    found = combine(EFFECTOR, contractions, order)
    places = [DESIGN.index(name) for name in order]
    curves = [
        place_curve(bend(DESIGN, contractions[name]).backbone, DESIGN.angles[place])
        for name, place in zip(order, places, strict=True)
    ]
    forces = [float(lateral_deflection(DESIGN, contractions[name])) for name in order]
    expected = combine_printed(*curves, find_resultant(DESIGN.angles[places], forces))
    assert found == pytest.approx(expected, abs=1e-9)
    # It lies in the plane of the resultant.
    across = find_resultant(DESIGN.angles[places], forces)
    assert found[:, 0] * across[1] - found[:, 1] * across[0] == pytest.approx(
        np.zeros(16), abs=1e-9
    )


@pytest.mark.parametrize("name", DESIGN.names)
def test_one_muscle_is_exact(name):
    angle = DESIGN.angles[DESIGN.index(name)]
    assert combine(EFFECTOR, {name: 6.9}) == pytest.approx(
        place_curve(bend(DESIGN, 6.9).backbone, angle), abs=1e-12
    )
    assert combine(EFFECTOR, {})[:, 2] == pytest.approx(np.linspace(0.0, 45.0, 16))


@pytest.mark.parametrize(
    ("contractions", "order", "length", "least", "most"),
    [
        ({"R": 6.9, "G": 6.9}, None, 42.19, 2.25, 3.00),
        ({"G": 6.9, "R": 5.7}, ("G", "R"), 43.61, 2.56, 3.00),
        ({"G": 6.9, "R": 5.7}, ("R", "G"), 42.25, 2.25, 3.00),
        ({"R": 6.9, "B": 6.9}, None, 50.37, 3.00, 4.36),
        ({"B": 6.9, "G": 5.7}, ("B", "G"), 52.98, 3.00, 5.24),
    ],
)
def test_the_steps_do_not_keep_the_length(contractions, order, length, least, most):
    """A defect of the steps, measured: 45 mm and pieces of 3 mm would be right."""
    found = measure(combine(EFFECTOR, contractions, order))
    assert found == pytest.approx((length, least, most), abs=0.015)


def test_the_steps_depend_on_the_order():
    """A defect of the steps: 3.3 mm between G then R and R then G. The azimuth does not."""
    tips = [combine(EFFECTOR, {"G": 6.9, "R": 5.7}, order)[-1] for order in ("GR", "RG")]
    lateral = [math.hypot(tip[0], tip[1]) for tip in tips]
    assert lateral == pytest.approx([20.95, 17.6], abs=0.05)
    azimuths = [math.atan2(tip[1], tip[0]) for tip in tips]
    assert azimuths[0] == pytest.approx(azimuths[1], abs=1e-12)


def test_the_steps_disagree_with_the_thesis_own_inverse():
    """By 9 mm where both pull with 6.9 mm: the inverse (4.13) adds the lateral vectors."""
    tip = combine(EFFECTOR, {"R": 6.9, "G": 6.9})[-1]
    single = float(lateral_deflection(DESIGN, 6.9))
    added = single * abs(sum(np.exp(1j * DESIGN.angles[:2])))
    assert added - math.hypot(tip[0], tip[1]) == pytest.approx(9.0, abs=0.1)


def pair_at(degrees):
    muscle = muscle_preset("fitted-45")
    return Effector(
        EffectorDesign(
            muscles=(
                PlacedMuscle(name="A", muscle=muscle, angle=0.3),
                PlacedMuscle(name="B", muscle=muscle, angle=0.3 + math.radians(degrees)),
            )
        )
    )


@pytest.mark.parametrize("two", [0.0, 1e-9, 2.0, 6.9])
def test_opposite_muscles_add_in_their_plane(two):
    found = combine(pair_at(180.0), {"A": 6.9, "B": two})
    assert np.all(np.isfinite(found))
    aside = found[:, 1] * math.cos(0.3) - found[:, 0] * math.sin(0.3)
    assert aside == pytest.approx(np.zeros(16), abs=1e-9)


def test_a_direction_parallel_to_the_plane_is_an_error():
    """A second displacement, turned into the section's axis, never meets the plane."""
    effector = pair_at(120.0)
    contractions = np.array([[6.9, 6.9]])
    backbone = bend(effector.design, 6.9).backbone
    # Forces that put the plane on the turned displacement of the tip.
    base = np.array([0.0, 45.0])
    across, along = backbone[-1] - base
    beta = bend(effector.design, 6.9).backbone_angle[-1]
    ahead = across * math.cos(math.radians(120.0))
    turned = ahead * math.cos(beta) + along * math.sin(beta)
    aside = across * math.sin(math.radians(120.0))
    # (cos 0, sin 0) F1 + (cos 120, sin 120) F2 along (turned, aside), up to its sign.
    second = aside / math.sin(math.radians(120.0))
    first = turned - second * math.cos(math.radians(120.0))
    forces = np.array([[first, second]])
    with pytest.raises(GeometryError, match="muscles A and B: at joint 15 .*parallel"):
        combine_bends(effector, contractions, forces, take_order(effector, None))

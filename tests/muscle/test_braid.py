"""The braid: strands of fixed length, and the force of an ideal muscle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.errors import InputError
from bozzini.muscle import LOCKING_ANGLE, Braid
from bozzini.muscle.design import BRAID_ANGLES, PRESSURE_LIMIT

braids = st.builds(
    Braid,
    length=st.floats(0.1, 1000.0),
    radius=st.floats(0.01, 100.0),
    angle=st.floats(*BRAID_ANGLES),
)


@given(braids, st.floats(0.01, 0.99))
def test_strands_keep_their_length(braid, share):
    length = share * braid.strand_length
    around = 2.0 * math.pi * braid.turns * braid.radius_at(length)
    assert math.hypot(length, around) == pytest.approx(braid.strand_length, rel=1e-12)
    assert math.tan(braid.angle_at(length)) == pytest.approx(around / length, rel=1e-9)


@given(braids, st.floats(0.01, 1.56))
def test_length_and_angle_are_inverse(braid, angle):
    assert braid.angle_at(braid.length_at(angle)) == pytest.approx(angle, rel=1e-9)


@given(braids)
def test_rest_is_what_was_given(braid):
    assert braid.radius_at(braid.length) == pytest.approx(braid.radius, rel=1e-12)
    assert braid.angle_at(braid.length) == pytest.approx(braid.angle, rel=1e-12)


@given(braids)
def test_volume_is_largest_at_locking(braid):
    assert math.degrees(LOCKING_ANGLE) == pytest.approx(54.7356, abs=5e-5)
    assert braid.angle_at(braid.locking_length) == pytest.approx(LOCKING_ANGLE, rel=1e-12)
    lengths = braid.locking_length * np.array([0.99, 1.0, 1.01])
    below, top, above = braid.volume_at(lengths)
    assert top > below
    assert top > above
    assert braid.locking_contraction == pytest.approx(braid.length - braid.locking_length)


@given(braids, st.floats(0.3, 0.95), st.floats(0.0, 10.0))
def test_ideal_force_is_the_work_of_the_pressure(braid, share, pressure):
    length = share * braid.strand_length
    step = 1e-4 * length
    slope = (braid.volume_at(length + step) - braid.volume_at(length - step)) / (2.0 * step)
    scale = pressure * math.pi * braid.radius_at(length) ** 2
    assert braid.ideal_force(pressure, length) == pytest.approx(
        -pressure * slope, abs=1e-6 * scale + 1e-300
    )


@given(braids, st.floats(0.0, 10.0))
def test_ideal_force_in_the_form_of_the_contraction(braid, pressure):
    """Thesis eq. (2.4): the same force from the radius and angle at rest."""
    contraction = 0.1
    cosine, sine = math.cos(braid.angle), math.sin(braid.angle)
    area = math.pi * braid.radius**2 * pressure
    expected = area * (3.0 * (cosine / sine * (1.0 - contraction)) ** 2 - 1.0 / sine**2)
    force = braid.ideal_force(pressure, braid.length * (1.0 - contraction))
    assert force == pytest.approx(expected, rel=1e-9, abs=1e-9 * area + 1e-300)
    assert braid.ideal_force(pressure, braid.locking_length) == pytest.approx(
        0.0, abs=1e-12 * area / sine**2 + 1e-300
    )


@given(st.floats(), st.floats(), st.floats(*BRAID_ANGLES), st.floats(), st.floats(0.0, 1.0))
def test_any_float_is_answered_or_refused(length, radius, angle, pressure, share):
    try:
        braid = Braid(length=length, radius=radius, angle=angle)
        at = share * braid.strand_length
        answers = [braid.ideal_force(pressure, at), braid.angle_at(at), braid.volume_at(at)]
    except InputError as error:
        assert "must lie in" in str(error)
    else:
        assert np.isfinite([*answers, braid.turns]).all()


@pytest.mark.parametrize("power", [-6.0, 6.0])
def test_the_extremes_of_the_range_are_answered(power):
    braid = Braid(length=10.0**power, radius=10.0**-power, angle=0.6)
    lengths = braid.strand_length * np.linspace(0.0, 1.0, 5)
    assert np.isfinite(braid.ideal_force(PRESSURE_LIMIT, lengths)).all()
    assert braid.angle_at(braid.length_at(1.2)) == pytest.approx(1.2)

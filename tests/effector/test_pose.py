"""`pose`: several muscles, symmetries, saturation, and batches."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.effector import (
    Effector,
    EffectorDesign,
    balance,
    bend,
    effector_preset,
    find_peak,
    lateral_deflection,
    place_curve,
    pose,
)
from bozzini.errors import BozziniError
from bozzini.muscle import EnergyMuscle, ThesisMuscle
from tests.effector.models import SpringMuscle
from tests.effector.reference import turn
from tests.effector.strategies import designs

DESIGN = effector_preset("prototype")
EFFECTOR = Effector(DESIGN)
SHARES = st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3)


def turned_design(design: EffectorDesign, angle: float, *, sign: float = 1.0) -> EffectorDesign:
    return design.replace(
        muscles=tuple(
            dataclasses.replace(one, angle=sign * one.angle + angle) for one in design.muscles
        )
    )


@pytest.mark.parametrize("method", ["superposition", "thesis"])
@pytest.mark.parametrize("name", DESIGN.names)
def test_one_muscle_is_its_balance(method, name):
    found = pose(EFFECTOR, {name: [0.0, 0.03, 0.4, 0.827]}, method=method)
    alone = balance(EFFECTOR, name, pressure=[0.0, 0.03, 0.4, 0.827])
    place = DESIGN.index(name)
    assert np.array_equal(found.contraction[:, place], alone.contraction)
    assert np.array_equal(found.force[:, place], alone.force)
    assert found.lateral == pytest.approx(alone.lateral, abs=1e-12)
    bent = bend(DESIGN, alone.contraction)
    angle = np.full(4, DESIGN.angles[place])
    assert found.backbone == pytest.approx(place_curve(bent.backbone, angle), abs=1e-11)
    tip = place_curve(bent.holder_tip[:, None], angle)[:, 0]
    assert found.holder_tip == pytest.approx(tip, abs=1e-11)
    assert np.exp(1j * found.azimuth[2:]) == pytest.approx(np.exp(1j * angle[2:]))
    assert found.length_error == pytest.approx(np.zeros(4), abs=1e-12)


@given(SHARES)
def test_superposition_adds_lateral_vectors(shares):
    pressures = 0.827 * np.array(shares)
    found = pose(EFFECTOR, pressures)
    single = [
        float(balance(EFFECTOR, n, pressure=p).lateral)
        for n, p in zip("RGB", pressures, strict=True)
    ]
    units = np.stack([np.cos(DESIGN.angles), np.sin(DESIGN.angles)], axis=-1)
    assert found.lateral_vector == pytest.approx(single @ units, abs=1e-11)
    assert found.tip[:2] == pytest.approx(found.lateral_vector, abs=1e-12)
    assert found.lateral == pytest.approx(np.hypot(*found.lateral_vector), abs=1e-12)
    # And as a section that is bent by one muscle there.
    assert np.linalg.norm(np.diff(found.backbone, axis=0), axis=-1) == pytest.approx(
        np.full(15, 3.0), abs=1e-9
    )
    if found.lateral > 1e-3:
        assert found.azimuth == pytest.approx(math.atan2(*found.lateral_vector[::-1]))
        plane = np.array([-np.sin(found.azimuth), np.cos(found.azimuth), 0.0])
        assert found.backbone @ plane == pytest.approx(np.zeros(16), abs=1e-11)
        aside = np.hypot(found.backbone[:, 0], found.backbone[:, 1])
        assert lateral_deflection(DESIGN, 0.0) <= aside[-1] == pytest.approx(found.lateral)
    assert np.linalg.norm(found.direction) == pytest.approx(1.0, abs=1e-12)
    assert found.holder_tip - found.tip == pytest.approx(10.0 * found.direction, abs=1e-12)


@given(SHARES, st.permutations(range(3)))
def test_superposition_has_no_order(shares, places):
    design = DESIGN.replace(muscles=tuple(DESIGN.muscles[i] for i in places))
    pressures = 0.827 * np.array(shares)
    one, other = pose(EFFECTOR, pressures), pose(Effector(design), pressures[list(places)])
    assert one.backbone == pytest.approx(other.backbone, abs=1e-9)


@given(SHARES, st.floats(-7.0, 7.0), st.sampled_from(["superposition", "thesis"]))
def test_rotation_and_mirror(shares, angle, method):
    pressures = 0.827 * np.array(shares)
    if method == "thesis":
        pressures[np.argmin(pressures)] = 0.0
    here = pose(EFFECTOR, pressures, method=method)
    there = pose(Effector(turned_design(DESIGN, angle)), pressures, method=method)
    for name in ("tip", "holder_tip", "direction", "backbone"):
        assert getattr(there, name) == pytest.approx(turn(getattr(here, name), angle), abs=1e-7)
    mirrored = pose(Effector(turned_design(DESIGN, 0.0, sign=-1.0)), pressures, method=method)
    flip = np.array([1.0, -1.0, 1.0])
    for name in ("tip", "holder_tip", "direction", "backbone"):
        assert getattr(mirrored, name) == pytest.approx(getattr(here, name) * flip, abs=1e-7)


def test_equal_pulls_all_round_cancel():
    angles = np.radians([0.0, 120.0, 240.0])
    design = DESIGN.replace(
        muscles=tuple(
            dataclasses.replace(one, angle=float(angle))
            for one, angle in zip(DESIGN.muscles, angles, strict=True)
        )
    )
    found = pose(Effector(design), [0.6, 0.6, 0.6])
    assert found.tip == pytest.approx([0.0, 0.0, 45.0], abs=1e-6)
    assert found.force == pytest.approx(np.full(3, found.force[0]))


def test_no_pressure_is_straight():
    for method in ("superposition", "thesis"):
        found = pose(EFFECTOR, {}, method=method)
        assert np.array_equal(found.tip, [0.0, 0.0, 45.0])
        assert np.array_equal(found.holder_tip, [0.0, 0.0, 55.0])
        assert np.array_equal(found.direction, [0.0, 0.0, 1.0])
        assert found.lateral == found.azimuth == 0.0


def thesis_free(muscle):
    return ThesisMuscle(muscle.replace(dead_length=0.0, modulus=0.35))


def test_saturation_is_said():
    """R and G without a load path ask for more than the section has (27.7 mm)."""
    effector = Effector(DESIGN, thesis_free)
    found = pose(effector, {"R": [0.6894, 0.2], "G": [0.6894, 0.2]})
    peak = find_peak(DESIGN)
    assert found.saturated.tolist() == [True, False]
    assert found.settled.all() and found.converged.tolist() == [False, True]
    assert found.demanded_lateral[0] > peak.lateral
    assert found.lateral[0] == peak.lateral
    assert np.hypot(*found.tip[0, :2]) == pytest.approx(peak.lateral, rel=1e-12)
    asked = (
        f"saturated: the muscles ask for {found.demanded_lateral[0]:.4g} mm, at 27.7 mm, the most "
        "there is"
    )
    assert found.reason.tolist() == [asked, ""]
    # It still points where the sum points.
    single = [float(balance(effector, name, pressure=0.6894).lateral) for name in "RG"]
    whole = single[0] * np.exp(1j * DESIGN.angles[0]) + single[1] * np.exp(1j * DESIGN.angles[1])
    assert np.exp(1j * found.azimuth[0]) == pytest.approx(whole / abs(whole))
    assert found.demanded_lateral[0] == pytest.approx(abs(whole))


def test_a_saturated_muscle_is_said():
    soft = Effector(DESIGN.replace(flexural_rigidity=1.0, pressure_limit=5.0), SpringMuscle)
    for method in ("superposition", "thesis"):
        found = pose(soft, {"G": 3.0}, method=method)
        assert found.saturated and not found.converged
        assert str(found.reason).startswith("muscle G saturated: the muscle could hold")
        assert found.lateral == pytest.approx(find_peak(DESIGN).lateral)


def test_the_length_error_of_the_thesis_steps():
    found = pose(EFFECTOR, {"R": 0.827, "G": 0.6}, method="thesis")
    pieces = np.linalg.norm(np.diff(found.backbone, axis=0), axis=-1)
    assert found.length_error == pytest.approx(pieces.sum() - 45.0)
    assert found.length_error < -0.4
    assert pose(EFFECTOR, {"R": 0.827, "G": 0.6}).length_error == 0.0
    other = pose(EFFECTOR, {"R": 0.827, "G": 0.6}, method="thesis", order=["G", "R"])
    assert abs(other.lateral - found.lateral) > 0.1


MIXED = Effector(
    DESIGN,
    lambda muscle: EnergyMuscle(muscle, ends="trellis"),
)


@pytest.mark.parametrize("effector", [EFFECTOR, MIXED, Effector(DESIGN, SpringMuscle)])
@pytest.mark.parametrize("method", ["superposition", "thesis"])
def test_a_batch_is_its_members(effector, method):
    pressures = np.random.default_rng(2).uniform(0.0, 0.827, (2, 3, 3))
    pressures[..., 1] = 0.0
    batch = pose(effector, pressures, method=method)
    assert batch.backbone.shape == (2, 3, 16, 3)
    assert batch.tip.shape == batch.direction.shape == (2, 3, 3)
    for index in np.ndindex(2, 3):
        one = pose(effector, pressures[index], method=method)
        for field in dataclasses.fields(batch)[1:]:  # all but the names
            value, expected = getattr(one, field.name), getattr(batch, field.name)[index]
            assert value.shape == expected.shape
            if field.name != "reason":
                assert value == pytest.approx(expected, abs=1e-11)
    assert pose(effector, np.zeros((0, 3)), method=method).tip.shape == (0, 3)


def test_pressures_by_name():
    by_name = pose(EFFECTOR, {"B": [0.2, 0.3], "R": 0.5})
    by_place = pose(EFFECTOR, [[0.5, 0.0, 0.2], [0.5, 0.0, 0.3]])
    assert np.array_equal(by_name.pressures, by_place.pressures)
    assert np.array_equal(by_name.tip, by_place.tip)


@settings(max_examples=100)
@given(designs(), st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4), st.booleans())
def test_any_design_gives_a_pose_or_one_line(design, shares, by_steps):
    count = len(design.muscles)
    pressures = design.pressure_limit * np.array(shares[:count])
    method = "thesis" if by_steps else "superposition"
    try:
        found = pose(Effector(design), pressures, method=method)
    except BozziniError as error:
        assert "\n" not in str(error)
        assert by_steps
        return
    for field in dataclasses.fields(found)[1:]:  # all but the names
        if field.name != "reason":
            assert np.all(np.isfinite(getattr(found, field.name))), field.name
    assert (found.reason == "") == bool(found.converged)
    size = design.backbone_length
    if not by_steps:
        pieces = np.linalg.norm(np.diff(found.backbone, axis=0), axis=-1)
        assert pieces == pytest.approx(
            np.full(design.segments, size / design.segments), abs=1e-12 * size
        )
        assert found.lateral <= find_peak(design).lateral * (1.0 + 1e-12)
        assert np.hypot(*found.tip[:2]) == pytest.approx(float(found.lateral), abs=1e-9 * size)

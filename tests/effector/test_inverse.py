"""The exact inverse against the forward model, for any design and any muscle model."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.effector.design import PlacedMuscle, effector_preset
from bozzini.effector.effector import Effector
from bozzini.effector.equilibrium import balance
from bozzini.effector.inverse import find_reach, solve_inverse
from bozzini.effector.linkage import find_peak, lateral_deflection
from bozzini.effector.pose import pose
from bozzini.effector.workspace import workspace
from bozzini.muscle import EnergyMuscle, ThesisMuscle
from tests.effector.models import SpringMuscle
from tests.effector.strategies import designs

PROTOTYPE = effector_preset("prototype")
MODELS: dict[str, Any] = {
    "energy": EnergyMuscle,
    "thesis": ThesisMuscle,
    "bulk": partial(ThesisMuscle, load_path="bulk"),
    "spring": SpringMuscle,
}


def draw_targets(count: int, *, radius: float = 25.0) -> np.ndarray:
    random = np.random.default_rng(7)
    return random.uniform(-radius, radius, (count, 2))


@pytest.mark.parametrize("name", MODELS)
def test_the_pose_is_the_target(name: str) -> None:
    effector = Effector(PROTOTYPE, MODELS[name])
    found = solve_inverse(effector, draw_targets(400))
    assert found.settled.all() and found.displacement_error.max() < 1e-9
    assert found.converged.tolist() == found.reachable.tolist()
    assert 20 < found.reachable.sum() < 400
    posed = pose(effector, found.pressures)
    assert np.abs(posed.lateral_vector - found.delivered).max() < 1e-8
    inside = found.reachable
    assert np.abs(posed.lateral_vector - found.target)[inside].max() < 1e-8
    assert np.abs(posed.contraction - found.contraction).max() < 1e-8
    assert np.abs(posed.force - found.force).max() < 1e-8


def test_the_pose_is_the_target_with_trellis_ends() -> None:
    effector = Effector(PROTOTYPE, partial(EnergyMuscle, ends="trellis"))
    found = solve_inverse(effector, draw_targets(12, radius=12.0))
    assert found.settled.all()
    posed = pose(effector, found.pressures)
    assert np.abs(posed.lateral_vector - found.delivered).max() < 1e-8


@settings(max_examples=60)
@given(designs(), st.floats(0.0, 2.0), st.floats(-math.pi, math.pi))
def test_any_design(design: Any, share: float, azimuth: float) -> None:
    effector = Effector(design)
    known = find_reach(effector)
    size = share * max(float(known.amplitudes.max()), 1e-6)
    target = size * np.array([math.cos(azimuth), math.sin(azimuth)])
    found = solve_inverse(effector, target)
    scale = design.backbone_length
    assert found.settled and found.converged == found.reachable
    assert np.all((found.pressures >= 0.0) & (found.pressures <= design.pressure_limit))
    assert (str(found.reason) == "") == bool(found.reachable)
    posed = pose(effector, found.pressures)
    assert np.abs(posed.lateral_vector - found.delivered).max() < 1e-9 * scale
    # Never further out than wanted, and in the same direction.
    across = found.delivered[0] * target[1] - found.delivered[1] * target[0]
    assert abs(across) < 1e-9 * scale * scale
    assert np.hypot(*found.delivered) <= size * (1.0 + 1e-12)


@pytest.mark.parametrize("name", MODELS)
def test_one_muscle_gives_back_its_pressure(name: str) -> None:
    effector = Effector(PROTOTYPE, MODELS[name])
    pressure = np.linspace(0.2, PROTOTYPE.pressure_limit, 25)
    for index, angle in enumerate(PROTOTYPE.angles):
        lateral = balance(effector, PROTOTYPE.names[index], pressure=pressure).lateral
        target = lateral[:, np.newaxis] * np.array([math.cos(angle), math.sin(angle)])
        found = solve_inverse(effector, target)
        assert found.reachable.all()
        assert found.pressures[:, index] == pytest.approx(pressure, abs=1e-9)
        assert np.abs(np.delete(found.pressures, index, axis=1)).max() < 0.2


@pytest.mark.parametrize("name", MODELS)
def test_pressure_rises_from_the_dead_band(name: str) -> None:
    effector = Effector(PROTOTYPE, MODELS[name])
    unit = np.array([math.cos(PROTOTYPE.angles[1]), math.sin(PROTOTYPE.angles[1])])
    size = np.geomspace(1e-6, find_reach(effector).amplitudes[1], 200)
    pressure = solve_inverse(effector, size[:, np.newaxis] * unit).pressures[:, 1]
    assert np.all(np.diff(pressure) > 0.0)
    # Nothing to do is no pressure; the least there is to do needs the muscle to take hold.
    assert solve_inverse(effector, [0.0, 0.0]).pressures[1] == 0.0
    hold = effector.models[1].dead_band()
    assert pressure[0] > hold
    assert balance(effector, "G", pressure=pressure[0] * 0.999).lateral < 1e-4
    tiny = solve_inverse(effector, 1e-12 * unit)
    assert tiny.reachable and tiny.pressures[1] == pytest.approx(pressure[0], rel=1e-2)


def test_turning_the_muscles_turns_the_answer() -> None:
    turn = 1.234
    turned = Effector(
        PROTOTYPE.replace(
            muscles=tuple(
                PlacedMuscle(name=one.name, muscle=one.muscle, angle=one.angle + turn)
                for one in PROTOTYPE.muscles
            )
        )
    )
    targets = draw_targets(50, radius=12.0)
    rotation = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    here = solve_inverse(Effector(PROTOTYPE), targets)
    there = solve_inverse(turned, targets @ rotation)
    assert there.pressures == pytest.approx(here.pressures, abs=1e-10)


def test_saturation_at_the_largest_deflection() -> None:
    # Strong muscles: the backbone is what limits, alone and together.
    effector = Effector(PROTOTYPE, partial(SpringMuscle, spring=50.0, gain=40.0))
    peak = find_peak(PROTOTYPE).lateral
    assert find_reach(effector).saturated.all()
    assert find_reach(effector).amplitudes == pytest.approx(peak)
    targets = draw_targets(200, radius=60.0)
    found = solve_inverse(effector, targets)
    far = np.hypot(*targets.T) > peak * (1.0 + 1e-9)
    assert far.any() and (~far).any()
    cut = found.code == 2
    assert np.all(np.hypot(*found.delivered[cut].T) <= peak * (1.0 + 1e-12))
    assert not found.reachable[far].any()
    assert "backbone deflects by" in str(found.reason[cut][0])
    posed = pose(effector, found.pressures)
    assert np.abs(posed.lateral_vector - found.delivered).max() < 1e-6


def test_contraction_and_force_meet_their_equations() -> None:
    effector = Effector(PROTOTYPE)
    found = solve_inverse(effector, draw_targets(100, radius=10.0))
    used = found.displacements > 0.0
    lateral = lateral_deflection(PROTOTYPE, found.contraction)
    assert np.abs(lateral - found.displacements).max() < 1e-10
    pull = effector.models[0].force(found.pressures[used], found.contraction[used])
    assert pull == pytest.approx(found.displacements[used] / PROTOTYPE.compliance, abs=1e-10)


def test_unreachable_says_why() -> None:
    effector = Effector(PROTOTYPE)
    found = solve_inverse(effector, [[40.0, 0.0], [1.0, 1.0]])
    assert list(found.reachable) == [False, True]
    assert "muscle R" in str(found.reason[0]) and "0.827 MPa" in str(found.reason[0])
    assert str(found.reason[1]) == ""
    pair = Effector(PROTOTYPE.replace(muscles=PROTOTYPE.muscles[:2]))
    assert "gap of half a turn" in str(solve_inverse(pair, [0.0, 5.0]).reason)


def test_only_a_target_that_is_met_has_converged() -> None:
    effector = Effector(PROTOTYPE)
    near, far = solve_inverse(effector, [1.0, 1.0]), solve_inverse(effector, [40.0, 0.0])
    assert near.converged and near.settled and str(near.reason) == ""
    assert not far.converged and far.settled
    given = float(np.hypot(*far.delivered))
    assert f"the target is 40 mm away, {given:.4g} mm are given" in str(far.reason)
    both = solve_inverse(effector, [[1.0, 1.0], [40.0, 0.0]])
    assert both.converged.tolist() == [True, False] and both.settled.all()
    assert both.reason.tolist() == [str(near.reason), str(far.reason)]
    targets = draw_targets(100)
    found = solve_inverse(effector, targets)
    met = np.linalg.norm(pose(effector, found.pressures).lateral_vector - targets, axis=1) < 1e-5
    assert met.tolist() == found.converged.tolist() == (found.reason == "").tolist()
    assert met.any() and not met.all()


def test_a_limit_below_the_dead_band_reaches_nothing() -> None:
    effector = Effector(PROTOTYPE.replace(pressure_limit=0.01))
    found = solve_inverse(effector, [[1.0, 1.0], [0.0, 0.0]])
    assert list(found.reachable) == [False, True]
    assert not found.pressures.any() and not found.delivered.any()


def test_shapes() -> None:
    effector = Effector(PROTOTYPE)
    found = solve_inverse(effector, np.zeros((4, 0, 2)))
    assert found.pressures.shape == (4, 0, 3) and found.reason.shape == (4, 0)
    one = solve_inverse(effector, [3.0, 4.0])
    assert one.pressures.shape == (3,) and one.reachable.shape == ()


def test_reach_is_the_balance_at_the_limit() -> None:
    effector = Effector(PROTOTYPE)
    known = find_reach(effector)
    for name, amplitude in zip(known.names, known.amplitudes, strict=True):
        assert amplitude == pytest.approx(
            float(balance(effector, name, pressure=PROTOTYPE.pressure_limit).lateral), abs=1e-12
        )
    assert find_reach(effector) is known
    with pytest.raises(ValueError, match="read-only"):
        known.amplitudes[0] = 1.0


def test_muscles_that_differ_reach_each_its_own_amplitude() -> None:
    # R, G and B are not in the order of their angles.
    design = effector_preset("prototype")
    placed = tuple(
        dataclasses.replace(one, muscle=one.muscle.replace(modulus=modulus))
        for one, modulus in zip(design.muscles, (0.45, 0.55, 0.7), strict=True)
    )
    effector = Effector(design.replace(muscles=placed))
    amplitudes = find_reach(effector).amplitudes
    units = np.stack([np.cos(design.angles), np.sin(design.angles)], axis=1)
    ends = amplitudes[:, np.newaxis] * units
    assert solve_inverse(effector, 0.999 * ends).converged.all()
    cut = solve_inverse(effector, 1.2 * ends)
    assert not cut.reachable.any()
    assert cut.share == pytest.approx(1.0 / 1.2)
    boundary = workspace(effector).boundary
    for end in ends:
        assert np.hypot(*(boundary - end).T).min() == pytest.approx(0.0, abs=1e-9)

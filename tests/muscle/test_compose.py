"""Bundles and antagonistic joints: sums, symmetries and round trips of any model."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from bozzini.errors import InputError
from bozzini.muscle import (
    MODELS,
    AntagonisticJoint,
    Bundle,
    EndEffects,
    EnergyMuscle,
    Muscle,
    MuscleModel,
    ThesisMuscle,
    preset,
)

ENERGY = EnergyMuscle(preset("effector-45"))
BALANCE = MODELS["kothera-balance"](preset("effector-45", modulus=0.5))
MOUNTED = EndEffects(offset=0.3, compliance=0.05, slack_force=0.1).mount(BALANCE)
JOINT = AntagonisticJoint(ENERGY, ENERGY, radius=5.0, rest_contraction=5.0)


@dataclass(frozen=True)
class Spring(MuscleModel):
    """A muscle of which all is known in closed form."""

    muscle: Muscle
    rate: float = 2.0
    name = "spring"

    def contraction(self, pressure, load=0.0, *, direction=None):
        return 12.0 * np.asarray(pressure, float) - np.asarray(load, float) / self.rate

    def force(self, pressure, contraction, *, direction=None):
        return self.rate * (12.0 * np.asarray(pressure, float) - np.asarray(contraction, float))


def test_equal_muscles_share_the_load():
    pressure, load = np.array([0.3, 0.6])[:, None], np.array([0.0, 0.6, 1.2])
    three = Bundle([ENERGY] * 3)
    assert three.contraction(pressure, 3.0 * load) == pytest.approx(
        ENERGY.contraction(pressure, load), abs=1e-9
    )
    assert three.force(0.5, 4.0) == pytest.approx(3.0 * ENERGY.force(0.5, 4.0))
    assert three.stiffness(0.5, 4.0) == pytest.approx(3.0 * ENERGY.stiffness(0.5, 4.0))
    assert Bundle([ENERGY]).contraction(0.5, 1.0) == pytest.approx(ENERGY.contraction(0.5, 1.0))


def test_a_joint_turns_until_a_muscle_is_as_long_as_it_can_be():
    low, high = JOINT.angle_limits
    assert low < 0.0 and low == pytest.approx(-high)
    inside = 1e-6 * (high - low)
    longest = JOINT.rest_contraction + JOINT.radius * low
    assert np.isfinite(ENERGY.force(0.3, longest + inside))
    assert np.isfinite(JOINT.torque([0.3, 0.3], [low + inside, high - inside])).all()
    with pytest.raises(InputError, match="contraction is "):
        ENERGY.force(0.3, longest - inside)
    for angle in (low - inside, high + inside):
        with pytest.raises(InputError, match="angle is "):
            JOINT.torque([0.3, 0.3], angle)


def test_different_muscles_meet_at_one_contraction():
    bundle = Bundle((ENERGY, BALANCE, BALANCE))
    pressure, load = np.array([0.3, 0.6])[:, None], np.array([0.0, 0.6, 2.0])
    found = bundle.contraction(pressure, load)
    assert found.shape == (2, 3)
    assert bundle.force(pressure, found) == pytest.approx(np.broadcast_to(load, (2, 3)), abs=1e-9)
    alone = np.stack([one.contraction(pressure, load / 3.0) for one in (ENERGY, BALANCE)])
    assert np.all((alone.min(axis=0) <= found) & (found <= alone.max(axis=0)))
    assert float(bundle.contraction(0.6, 2.0)) == pytest.approx(found[1, 2])
    state = bundle.solve(0.6, 2.0)
    assert bool(state.converged) and float(state.residual) == pytest.approx(0.0, abs=1e-9)


def test_a_joint_of_springs_is_linear():
    muscle = preset("effector-45")
    joint = AntagonisticJoint(
        Spring(muscle), Spring(muscle, rate=3.0), radius=8.0, rest_contraction=2.0
    )
    # 8 (2 (12 P1 - 2 - 8 a) - 3 (12 P2 - 2 + 8 a)), while both are taut.
    angle = 0.1
    wanted = 8.0 * (2.0 * (12.0 * 0.5 - 2.0 - 8.0 * angle) - 3.0 * (12.0 * 0.4 - 2.0 + 8.0 * angle))
    assert joint.torque([0.5, 0.4], angle) == pytest.approx(wanted)
    assert joint.stiffness([0.5, 0.4], angle) == pytest.approx(64.0 * 5.0, rel=1e-6)
    assert joint.angle([0.5, 0.4], wanted) == pytest.approx(angle)
    # The antagonist without pressure is slack, and does not push.
    assert joint.torque([0.5, 0.0], 0.0) == pytest.approx(8.0 * 2.0 * 4.0)
    assert joint.stiffness([0.5, 0.0], 0.0) == pytest.approx(64.0 * 2.0, rel=1e-6)


@pytest.mark.parametrize("model", [ENERGY, BALANCE, MOUNTED], ids=["energy", "balance", "mounted"])
def test_a_joint_of_equals_is_symmetric(model):
    joint = AntagonisticJoint(model, model, radius=5.0, rest_contraction=5.0)
    assert joint.angle([[0.3, 0.3], [0.6, 0.6]]) == pytest.approx([0.0, 0.0], abs=1e-9)
    one, other = joint.angle([[0.6, 0.3], [0.3, 0.6]])
    assert one > 0.1 and one == pytest.approx(-other, abs=1e-9)
    pressures, torque = np.array([[0.6, 0.3], [0.5, 0.5]]), np.array([[2.0], [0.0], [-2.0]])
    angle = joint.angle(pressures, torque)
    assert angle.shape == (3, 2)
    assert joint.torque(pressures, angle) == pytest.approx(
        np.broadcast_to(torque, (3, 2)), abs=1e-7
    )
    assert np.all(np.diff(angle, axis=0) > 0.0)  # it gives way to a torque


def test_stiffness_of_a_joint_is_the_slope_and_grows_with_both_pressures():
    step = 1e-4
    slope = -(JOINT.torque([0.6, 0.4], 0.1 + step) - JOINT.torque([0.6, 0.4], 0.1 - step))
    assert JOINT.stiffness([0.6, 0.4], 0.1) == pytest.approx(slope / (2.0 * step), rel=1e-5)
    low, high = JOINT.stiffness([[0.3, 0.3], [0.8, 0.8]], 0.0)
    assert high > low


def test_extensile_muscles_push_a_joint():
    muscle = Muscle(length=50.0, outer_radius=5.0, inner_radius=4.0, braid_angle=math.radians(68.0))
    model = MODELS["gaylord-1"](muscle)
    joint = AntagonisticJoint(model, model, radius=10.0)
    assert joint.torque([0.3, 0.0], 0.0) < 0.0
    assert joint.torque([0.3, 0.3], 0.0) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Bundle([]), "models of a bundle is []: it must have one at least"),
        (lambda: Bundle([ENERGY, 1]), "model of a bundle is 1: it must be a MuscleModel"),
        (lambda: Bundle([ThesisMuscle(preset("effector-45"))]), "no response to a load"),
        (
            lambda: Bundle([ENERGY, EnergyMuscle(preset("thesis-60"))]),
            "is 60 mm long: all must be as long as the first, 45 mm",
        ),
        (lambda: Bundle([ENERGY, BALANCE]).contraction(0.3, 1e4), "load"),
        (lambda: AntagonisticJoint(ENERGY, ENERGY, radius=0.0), "joint radius is 0 mm"),
        (lambda: AntagonisticJoint(ENERGY, 3, radius=5.0), "antagonist is 3"),
        (
            lambda: AntagonisticJoint(ENERGY, ENERGY, radius=5.0, rest_contraction=-40.0),
            "joint rest contraction is -40 mm: it must lie above",
        ),
        (lambda: JOINT.torque([0.3, 0.3, 0.3], 0.0), "pressures has shape (3,)"),
        (lambda: JOINT.torque([0.3, 0.3], 9.0), "angle is 9 rad: it must lie in"),
        (lambda: JOINT.angle([0.3, 0.3], 1e6), "torque is 1e+06 N mm: at the pressures 0.3 and"),
        (lambda: JOINT.angle([0.3, -0.3]), "pressures[1] is -0.3 MPa: it must lie in [0, inf]"),
    ],
)
def test_refused(call, message):
    with pytest.raises(InputError) as error:
        call()
    assert message in str(error.value) and "\n" not in str(error.value)

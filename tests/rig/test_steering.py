"""The loop from the stick to the tip, with feed-forward, and with muscles that have hysteresis."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.effector import Effector, effector_preset
from bozzini.errors import InputError
from bozzini.muscle.hysteresis import MaxwellSlip, PrandtlIshlinskii
from bozzini.rig import (
    BoardStick,
    Chamber,
    Cosimulation,
    EmulatedBoard,
    Feedforward,
    Host,
    HysteresisCompensator,
    HystereticPlant,
    LockstepLink,
    NativeBoard,
    Plant,
    PlantDesign,
    ScriptedStick,
    Steering,
)
from bozzini.rig.demo import VOLTS_PER_COUNT

FRICTION = MaxwellSlip((0.3, 0.2, 0.2), (0.01, 0.01, 0.01)).to_plays()
EFFECTOR = Effector(effector_preset("prototype"))
CHAMBERS = [Chamber.from_model(model) for model in EFFECTOR.models]


def find_tip(pressures):
    return EFFECTOR.forward(np.clip(pressures, 0.0, EFFECTOR.design.pressure_limit)).lateral_vector


def run_circle(kind, *, forward=False, operator=None, compensated=False, period=0.01, duration=2.7):
    """Return the log of a circle at 0.5 Hz, and the distance of the true tip from its target."""
    script = ScriptedStick.circle(0.5, duration)
    plant = HystereticPlant(CHAMBERS, operator) if operator else Plant(CHAMBERS)
    with kind() as board:
        host = Host(LockstepLink(Cosimulation(board, plant)), period=period)
        known = host.connect()
        shaper = Feedforward(PlantDesign(), CHAMBERS, known, period=period) if forward else None
        steering = Steering(
            EFFECTOR,
            BoardStick(),
            feedforward=shaper,
            compensator=HysteresisCompensator(operator) if compensated else None,
        )
        acting = []

        def control(time, telemetry):
            plant.stick_voltages = script.read(time, script.readings[0]) * VOLTS_PER_COUNT
            acting.append(plant.effective_pressures if operator else plant.pressures)
            return steering(time, telemetry)

        run = host.run(control, duration)
    assert run.converged, run.reason
    table = run.to_frame()
    target = table[["target_x_mm", "target_y_mm"]].to_numpy()
    after = table["time_s"].to_numpy() > 0.6
    return table[after], np.hypot(*(find_tip(acting) - target)[after].T)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def test_feedforward_brings_the_tip_nearer_to_a_circle(toolchain):
    table, error = run_circle(NativeBoard, forward=True, duration=1.6)
    _, alone = run_circle(NativeBoard, duration=1.6)
    assert rms(error) < 0.8 * rms(alone)
    # The columns of the log are the forward kinematics of the measured pressures.
    measured = table[[f"pressure_{k}_MPa" for k in (1, 2, 3)]].to_numpy()
    tip = table[["tip_x_mm", "tip_y_mm"]].to_numpy()
    assert np.allclose(find_tip(measured), tip, atol=1e-9)
    assert np.hypot(table["target_x_mm"], table["target_y_mm"]).min() > 5.0


@pytest.mark.slow
@pytest.mark.parametrize(("period", "share"), [(0.002, 0.6), (0.01, 0.8)])
def test_circle_of_the_emulated_board(toolchain, period, share):
    _, error = run_circle(EmulatedBoard, forward=True, period=period, duration=4.5)
    _, alone = run_circle(EmulatedBoard, period=period, duration=4.5)
    assert rms(error) < share * rms(alone)
    assert rms(alone) < 1.5  # [mm]


@pytest.mark.slow
def test_each_of_feedforward_and_compensation_helps_with_hysteresis(toolchain):
    errors = {
        (forward, compensated): rms(
            run_circle(EmulatedBoard, forward=forward, operator=FRICTION, compensated=compensated)[
                1
            ]
        )
        for forward in (False, True)
        for compensated in (False, True)
    }
    assert errors[False, True] < errors[False, False]
    assert errors[True, False] < errors[False, False]
    assert errors[True, True] < 0.6 * errors[True, False]
    assert errors[True, True] < 1.5


def test_compensator_undoes_the_operator():
    """Within the board's range the muscles get what they should; the memory follows the clip."""
    rng = np.random.default_rng(4)
    wanted = rng.uniform(0.05, 0.7, (200, 3))
    wanted[50] = 0.827  # above what the largest set-point gives
    compensator, state = HysteresisCompensator(FRICTION), FRICTION.rest((3,))
    for k, one in enumerate(wanted):
        pressures = compensator.compensate(one)
        given, state = FRICTION.run(pressures[:, None], initial=state)
        if k == 50:
            assert np.all(given[:, 0] < one)
            assert np.all(pressures == 0.827)
        else:
            assert np.allclose(given[:, 0], one, atol=1e-9)


def test_observer_follows_the_plant():
    plant, compensator = HystereticPlant(CHAMBERS, FRICTION), HysteresisCompensator(FRICTION)
    rng = np.random.default_rng(5)
    for pressures in rng.uniform(0.0, 0.8, (50, 3)):
        plant.set_pressures(pressures)
        plant.step(np.zeros(6), 1e-4)
        seen = compensator.observe(plant.pressures)
        assert np.allclose(seen, plant.effective_pressures, atol=1e-12)


def test_plant_with_the_identity_is_the_plant_without_hysteresis():
    plants = Plant(CHAMBERS), HystereticPlant(CHAMBERS, PrandtlIshlinskii((0.0,), (1.0,)))
    duty = np.array([0.5, 0.6, 0.4, 0.0, 0.0, 0.0])
    for plant in plants:
        plant.step(duty, 0.05)
    assert np.array_equal(plants[0].pressures, plants[1].pressures)
    assert np.allclose(plants[0].contractions, plants[1].contractions, rtol=1e-12)


def test_hysteresis_opens_a_loop_of_contraction_over_pressure():
    plant = HystereticPlant(CHAMBERS, FRICTION)
    up, down = [], []
    ladder = np.linspace(0.05, 0.8, 16)
    for way, found in ((ladder, up), (ladder[::-1], down)):
        for pressure in way:
            plant.set_pressures(pressure)
            plant.step(np.zeros(6), 1e-4)
            found.append(plant.contractions[0])
    width = np.array(down[::-1]) - np.array(up)
    assert np.all(width[3:-1] > 0.0)
    copied = plant.copy()
    copied.set_pressures(0.1)
    copied.step(np.zeros(6), 1e-4)
    assert np.all(plant.effective_pressures < copied.effective_pressures)


def test_operators_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="operator is a float: it must be an Operator"):
        HystereticPlant(CHAMBERS, 0.1)
    with pytest.raises(InputError, match="operator is a MaxwellSlip: it must be an Invertible"):
        HysteresisCompensator(MaxwellSlip((0.5,), (0.01,)))
    with pytest.raises(InputError, match="this operator has no inverse for certain"):
        HysteresisCompensator(PrandtlIshlinskii((0.1,), (1.0,)))

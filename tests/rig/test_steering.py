"""The loop from the stick to the tip, with feed-forward, and with muscles that have hysteresis."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bozzini.effector import (
    Effector,
    EffectorFile,
    EffectorMotion,
    MusclePull,
    effector_preset,
    write_effector,
)
from bozzini.errors import InputError
from bozzini.muscle.hysteresis import MaxwellSlip, PrandtlIshlinskii
from bozzini.rig import (
    BoardStick,
    Chamber,
    Cosimulation,
    EmulatedBoard,
    Host,
    HysteresisCompensator,
    HystereticPlant,
    LockstepLink,
    NativeBoard,
    Plant,
    PlantDesign,
    ScriptedStick,
    Steering,
    emulate_rig,
    make_controller,
    open_rig_effector,
)
from bozzini.rig.demo import VOLTS_PER_COUNT

FRICTION = MaxwellSlip((0.3, 0.2, 0.2), (0.01, 0.01, 0.01)).to_plays()
EFFECTOR = Effector(effector_preset("prototype"))
TRUE = PlantDesign()
CHAMBERS = [Chamber.from_model(model) for model in EFFECTOR.models]


def find_tip(pressures, effector=EFFECTOR):
    return effector.forward(np.clip(pressures, 0.0, effector.design.pressure_limit)).lateral_vector


def run_circle(
    kind, *, controller="static", operator=None, compensated=False, period=0.01, duration=2.7,
    effector=EFFECTOR, design=None,
):  # fmt: skip
    """Return the log of a circle at 0.5 Hz, and the distance of the true tip from its target."""
    script = ScriptedStick.circle(0.5, duration)
    chambers = [Chamber.from_model(model) for model in effector.models]
    plant = HystereticPlant(chambers, operator) if operator else Plant(chambers, design)
    with kind() as board:
        host = Host(LockstepLink(Cosimulation(board, plant)), period=period)
        steering = Steering(
            effector,
            BoardStick(),
            controller=make_controller(controller, effector, host.connect(), period=period),
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
    tip = find_tip(acting, effector)
    return table[after], np.hypot(*(tip - target)[after].T)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def test_feedforward_brings_the_tip_nearer_to_a_circle(toolchain):
    table, error = run_circle(NativeBoard, controller="feedforward", duration=1.6)
    _, alone = run_circle(NativeBoard, duration=1.6)
    assert rms(error) < 0.8 * rms(alone)
    # The columns of the log are the forward kinematics of the measured pressures.
    measured = table[[f"pressure_{k}_MPa" for k in (1, 2, 3)]].to_numpy()
    tip = table[["tip_x_mm", "tip_y_mm"]].to_numpy()
    assert np.allclose(find_tip(measured), tip, atol=1e-9)
    assert np.hypot(table["target_x_mm"], table["target_y_mm"]).min() > 5.0


FAST, SLOW = (
    PlantDesign(fill_area=share * TRUE.fill_area, bleed_area=share * TRUE.bleed_area)
    for share in (1.2, 0.8)
)
RUBBING = EffectorMotion(play_radii=FRICTION.thresholds[1:], play_weights=FRICTION.weights[1:])


@pytest.mark.parametrize(
    ("effector", "more"),
    [
        (EFFECTOR, {}),
        (EFFECTOR, {"design": FAST}),
        (EFFECTOR, {"design": SLOW, "period": 0.02}),
        (Effector.from_preset("measured"), {}),
        (dataclasses.replace(EFFECTOR, motion=RUBBING), {"operator": FRICTION}),
    ],
    ids=["prototype", "wide orifices", "narrow orifices, slow host", "measured", "hysteresis"],
)
def test_predictive_control_is_twice_as_near_as_the_static_inverse(toolchain, effector, more):
    """By the plant's own state; the controller has a lag in place of board, valves and lines."""
    _, error = run_circle(NativeBoard, controller="predictive", effector=effector, **more)
    _, alone = run_circle(NativeBoard, effector=effector, **more)
    assert 2.0 * rms(error) < rms(alone)


def test_predictive_set_points_keep_to_the_limits_whatever_the_stick_does(toolchain):
    effector = Effector(effector_preset("prototype"))
    jumps = ScriptedStick(
        [0.0, 0.2, 0.2001, 0.6, 0.6001, 0.9],
        [[512, 512], [512, 512], [1024, 0], [1024, 0], [0, 1024], [0, 1024]],
    )
    with NativeBoard() as board:
        host = Host(LockstepLink(Cosimulation(board, Plant(CHAMBERS))), period=0.01)
        known = host.connect()
        made = make_controller("predictive", effector, known, period=0.01)
        run = host.run(Steering(effector, jumps, controller=made), 0.9)
    assert run.converged, run.reason
    sent = run.to_frame()[[f"setpoint_{k}_MPa" for k in (1, 2, 3)]].to_numpy()
    assert sent.min() >= 0.0 and 0.6 < sent.max() <= known.setpoint_max
    held = sent[::2]  # at 50 Hz
    assert np.array_equal(held, sent[1::2])
    assert np.abs(np.diff(held, axis=0)).max() <= 0.02 * known.slew_rate + 1e-4


def test_effectors_that_no_rig_can_have_are_refused(toolchain, tmp_path):
    made = EFFECTOR.design
    file = EffectorFile(muscles=made.muscles, motion=RUBBING)
    kept = write_effector(tmp_path / "arm.yaml", file)
    assert open_rig_effector(str(kept)).motion == RUBBING
    rig = emulate_rig(EFFECTOR.models, board="native", motion=RUBBING)
    assert isinstance(rig.plant, HystereticPlant)
    pulls = dataclasses.replace(file, pulls=(MusclePull(),) * 3)
    kept = write_effector(tmp_path / "pulls.yaml", pulls)
    with pytest.raises(InputError, match="has laws of pull, without the inverse and the volume"):
        open_rig_effector(str(kept))
    two = dataclasses.replace(file, muscles=made.muscles[:2])
    with pytest.raises(InputError, match="has 2 muscles: a board has 3"):
        open_rig_effector(str(write_effector(tmp_path / "two.yaml", two)))
    with pytest.raises(InputError, match="choose one of static, feedforward, predictive"):
        make_controller("mpc", EFFECTOR, None, period=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("period", "share"), [(0.002, 0.6), (0.01, 0.8)])
def test_circle_of_the_emulated_board(toolchain, period, share):
    _, error = run_circle(EmulatedBoard, controller="feedforward", period=period, duration=4.5)
    _, alone = run_circle(EmulatedBoard, period=period, duration=4.5)
    assert rms(error) < share * rms(alone)
    assert rms(alone) < 1.5  # [mm]


@pytest.mark.slow
def test_each_of_feedforward_and_compensation_helps_with_hysteresis(toolchain):
    errors = {
        (controller, compensated): rms(
            run_circle(
                EmulatedBoard, controller=controller, operator=FRICTION, compensated=compensated
            )[1]
        )
        for controller in ("static", "feedforward")
        for compensated in (False, True)
    }
    assert errors["static", True] < errors["static", False]
    assert errors["feedforward", False] < errors["static", False]
    assert errors["feedforward", True] < 0.6 * errors["feedforward", False]
    assert errors["feedforward", True] < 1.5


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

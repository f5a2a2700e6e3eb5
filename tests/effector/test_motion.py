"""An end-effector in time: what its motion begins with, ends at, and goes on with."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bozzini.effector import (
    Effector,
    EffectorDesign,
    EffectorMotion,
    MusclePull,
    PlacedMuscle,
    TipView,
    effector_preset,
)
from bozzini.effector.section import find_bends, shape_sections
from bozzini.errors import InputError
from bozzini.muscle import Muscle
from bozzini.muscle.hysteresis import PrandtlIshlinskii
from bozzini.rig import HystereticPlant
from bozzini.rig.plant import Chamber

TIMES = np.linspace(0.0, 6.0, 121)
MOTION = EffectorMotion(
    fill_lag=0.3, bleed_lag=0.5, play_radii=(0.02, 0.08), play_weights=(0.3, 0.2),
    creep_share=0.2, creep_time=2.0, body_lag=0.1,
)  # fmt: skip


def make_arm(**motion: float) -> Effector:
    muscle = Muscle(length=100.0, outer_radius=2.0)
    placed = tuple(
        PlacedMuscle(name=name, muscle=muscle, angle=math.radians(angle))
        for name, angle in (("A", 0.0), ("B", 120.0), ("C", 240.0))
    )
    design = EffectorDesign(
        muscles=placed, offset=6.0, backbone_length=100.0, flexural_rigidity=2e4
    )
    pulls = tuple(MusclePull(area=a, area_slope=1.0, stiffening=s)
                  for a, s in ((20.0, 3.0), (24.0, 2.0), (18.0, 4.0)))  # fmt: skip
    return Effector(design, pulls=pulls, motion=EffectorMotion(**motion))


def command(random: np.random.Generator, count: int = 3) -> np.ndarray:
    knots = random.uniform(0.0, 0.6, (7, count))
    return np.stack([np.interp(TIMES, np.arange(7.0), column) for column in knots.T], axis=1)


def test_without_lags_the_motion_is_the_pose_of_the_command_before():
    effector = Effector(effector_preset("measured"))
    commands = command(np.random.default_rng(1))
    track = effector.simulate(TIMES, commands)
    still = effector.forward(commands)
    assert track.tip[1:] == pytest.approx(still.tip[:-1], abs=1e-12)
    assert track.direction[1:] == pytest.approx(still.direction[:-1], abs=1e-12)
    assert track.tip[0] == pytest.approx(still.tip[0], abs=1e-12)


@pytest.mark.parametrize("effector", [
    Effector(effector_preset("measured"), motion=MOTION),
    Effector(make_arm().design, pulls=make_arm().pulls, motion=MOTION),
])  # fmt: skip
def test_a_motion_goes_on_where_it_ended_and_a_batch_is_its_runs(effector):
    random = np.random.default_rng(2)
    runs = np.stack([command(random), command(random)])
    whole = effector.simulate(TIMES, runs)
    first = effector.simulate(TIMES[:50], runs[:, :50])
    second = effector.simulate(TIMES[49:], runs[:, 49:], initial=first.state)
    assert np.array_equal(second.tip, whole.tip[:, 49:])
    assert np.array_equal(first.tip, whole.tip[:, :50])
    for k in range(2):
        assert np.array_equal(effector.simulate(TIMES, runs[k]).tip, whole.tip[k])
    # one sample at a time, as a controller does
    state, tips = None, []
    for i in range(len(TIMES) - 1):
        step = effector.simulate(TIMES[i : i + 2], runs[0, i : i + 2], initial=state)
        state = step.state
        tips.append(step.tip[1])
    assert np.array(tips) == pytest.approx(whole.tip[0, 1:], abs=1e-12)


def test_lags_are_those_of_the_differential_equations():
    motion = EffectorMotion(fill_lag=0.3, bleed_lag=0.7, creep_share=0.3, creep_time=1.5)
    fine = np.linspace(0.0, 4.0, 4001)
    commands = np.where((fine > 0.5) & (fine < 2.0), 0.5, 0.1)[None, :, None]
    found = motion.act(fine, commands, initial=None)

    def rate(time: float, state: np.ndarray) -> list[float]:
        target = 0.5 if 0.5 < time < 2.0 else 0.1
        pressure, late = state
        lag = 0.3 if target > pressure else 0.7
        return [(target - pressure) / lag, (pressure - late) / 1.5]

    true = solve_ivp(rate, (0.0, 4.0), [0.1, 0.1], t_eval=fine, max_step=1e-3, rtol=1e-8).y
    assert found.pressures[0, :, 0] == pytest.approx(true[0], abs=3e-3)
    assert found.effective[0, :, 0] == pytest.approx(0.7 * true[0] + 0.3 * true[1], abs=3e-3)


def test_plays_are_those_of_the_muscle_and_of_the_rig():
    motion = EffectorMotion(play_radii=(0.02, 0.08), play_weights=(0.3, 0.2))
    history = command(np.random.default_rng(3))
    found = motion.act(TIMES, history[None].copy(), initial=None)
    operator = PrandtlIshlinskii((0.0, 0.02, 0.08), (0.5, 0.3, 0.2))
    pressures = found.pressures[0]
    assert found.effective[0].T == pytest.approx(np.maximum(operator.apply(pressures.T), 0.0))
    chamber = Chamber(pressure=[0.0, 1.2], volume=[400.0, 401.0], contraction=[0.0, 12.0])
    plant = HystereticPlant(chamber, motion.operator)
    for row in pressures:
        plant.set_pressures(row)
        plant.step(np.zeros(6), 1e-6)
    assert plant.effective_pressures == pytest.approx(found.effective[0, -1], abs=1e-4)


def test_the_rig_creeps_as_the_motion_does():
    motion = EffectorMotion(
        fill_lag=9.0, play_radii=(0.02,), play_weights=(0.3,), creep_share=0.4, creep_time=0.5
    )
    chamber = Chamber(pressure=[0.0, 1.2], volume=[400.0, 401.0], contraction=[0.0, 12.0])
    plant = HystereticPlant(chamber, motion)
    seen, acting = [plant.pressures], [plant.effective_pressures]
    for _ in range(100):
        plant.step([0.6, 0.5, 0.4, 0.0, 0.0, 0.0], 0.01)
        seen.append(plant.pressures)
        acting.append(plant.effective_pressures)
    alone = EffectorMotion(play_radii=(0.02,), play_weights=(0.3,), creep_share=0.4, creep_time=0.5)
    # a command holds until the next sample: the plant's pressure is known at the end of a step
    commands = np.array([*seen[1:], seen[-1]])[None]
    state = alone.begin(np.zeros((1, 3)))
    found = alone.act(np.linspace(0.0, 1.0, 101), commands, initial=state)
    assert np.array(acting) == pytest.approx(found.effective[0], abs=1e-12)
    assert np.ptp(acting, axis=0).min() > 0.1


def test_a_section_of_pulls_is_in_balance():
    arm = make_arm()
    pressures = command(np.random.default_rng(4))
    bends = find_bends(arm, pressures)
    design = arm.design
    ways = np.stack([np.cos(design.angles), np.sin(design.angles)], axis=1)
    contraction = design.offset * bends @ ways.T
    area = np.array([law.area for law in arm.pulls]) + pressures
    held = np.array([law.stiffening for law in arm.pulls]) * pressures
    pulls = area * pressures - held * contraction
    moment = design.offset * pulls @ ways
    assert bends * design.rigidity / design.backbone_length == pytest.approx(moment)


def test_an_arc_ends_where_its_angles_say_and_a_ray_meets_the_board():
    arm = make_arm()
    bends = np.array([[0.3, 0.0], [0.0, 0.0], [-0.4, 0.9]])
    shapes = shape_sections(arm, bends, np.array([0.0, 50.0, 100.0, 130.0]))
    angle = np.linalg.norm(bends, axis=1)
    radius = 100.0 / angle[[0, 2]]
    assert np.linalg.norm(shapes.points[[0, 2], 2, :2], axis=1) == pytest.approx(
        radius * (1.0 - np.cos(angle[[0, 2]]))
    )
    assert shapes.points[[0, 2], 2, 2] == pytest.approx(radius * np.sin(angle[[0, 2]]))
    assert shapes.direction[:, 2] == pytest.approx(np.cos(angle))
    assert np.linalg.norm(shapes.points[:, 3] - shapes.points[:, 2], axis=1) == pytest.approx(30.0)
    view = TipView(board_distance=200.0, board_slope_x=0.2, board_x=1.0, base_turn_x=0.1)
    spot = view.observe(arm, bends, channels=["spot x", "spot y", "bend"])
    # seen without a turn of the base the straight one points along the axis
    plain = TipView(board_distance=200.0, board_x=1.0, board_y=-2.0)
    assert plain.observe(arm, bends, channels=["spot x", "spot y"])[1] == pytest.approx([1.0, -2.0])
    assert spot[1, 2] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ((TIMES[::-1], command(np.random.default_rng(1))), "times must increase"),
        ((TIMES, np.full((121, 3), 2.0)), "pressure of muscle R is 2 MPa"),
        ((TIMES, np.zeros((5, 3))), "a row for each time"),
    ],
)
def test_bad_motions_are_refused(given, said):
    with pytest.raises(InputError, match=said):
        Effector(effector_preset("measured")).simulate(*given)


def test_bad_constants_are_refused():
    with pytest.raises(InputError, match="1 radii of plays and 0 weights"):
        EffectorMotion(play_radii=(0.1,))
    with pytest.raises(InputError, match="creep share is 2"):
        EffectorMotion(creep_share=2.0)
    with pytest.raises(InputError, match="inverse takes a model of the muscles"):
        make_arm().inverse([1.0, 1.0])
    with pytest.raises(InputError, match="a MusclePull for each"):
        Effector(effector_preset("measured"), pulls=(MusclePull(),))

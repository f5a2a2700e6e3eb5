"""Control of an end-effector in time: what is undone, kept to, and gained."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from bozzini.cli.main import main
from bozzini.effector import (
    CONTROLLERS,
    Effector,
    EffectorDesign,
    EffectorFile,
    EffectorMotion,
    InverseInTime,
    LagFeedforward,
    MusclePull,
    PlacedMuscle,
    PredictiveControl,
    StaticInverse,
    compare_controllers,
    draw_plant,
    run_control,
    write_effector,
)
from bozzini.errors import InputError
from bozzini.muscle import Muscle
from bozzini.numeric.limited import solve_limited
from bozzini.tracking import trace_places

MOTION = EffectorMotion(
    fill_lag=0.3, bleed_lag=0.25, play_radii=(0.01, 0.08), play_weights=(0.5, 0.1),
    creep_share=0.1, creep_time=5.0,
)  # fmt: skip
PERIOD = 0.02


def make_arm(
    motion: EffectorMotion | None = None,
    *,
    angles: tuple[float, ...] = (0.0, 120.0, 240.0),
    limit: float = 0.7,
) -> Effector:
    muscle = Muscle(length=100.0, outer_radius=2.0)
    placed = tuple(
        PlacedMuscle(name=name, muscle=muscle, angle=math.radians(angle))
        for name, angle in zip("ABC", angles, strict=False)
    )
    design = EffectorDesign(
        muscles=placed, offset=6.0, backbone_length=100.0, flexural_rigidity=2e4,
        pressure_limit=limit,
    )  # fmt: skip
    laws = ((20.0, 3.0), (24.0, 2.0), (18.0, 4.0))[: len(placed)]
    pulls = tuple(MusclePull(area=a, area_slope=1.0, stiffening=s) for a, s in laws)
    return Effector(design, pulls=pulls, motion=motion or EffectorMotion())


def circle(radius: float, count: int, frequency: float = 0.5) -> np.ndarray:
    phase = 2.0 * np.pi * frequency * PERIOD * np.arange(count + 1)
    return radius * np.stack([np.cos(phase), np.sin(phase)], axis=1)


def rms(off: np.ndarray) -> float:
    return float(np.sqrt(np.square(off).sum(axis=-1).mean()))


def test_limited_least_squares_is_the_bounded_one_and_keeps_to_inequalities():
    random = np.random.default_rng(3)
    for _ in range(20):
        matrix, target = random.normal(size=(9, 4)), random.normal(size=9)
        eye = np.eye(4)
        found = solve_limited(matrix, target, np.concatenate([eye, -eye]), np.full(8, -0.1))
        known = lsq_linear(matrix, target, bounds=(-0.1, 0.1), method="bvls", tol=1e-14).x
        assert found == pytest.approx(known, abs=1e-9)
        sides, floors = random.normal(size=(6, 4)), random.uniform(-1.0, 0.0, 6)
        found = solve_limited(matrix, target, sides, floors)
        slack = sides @ found - floors
        assert slack.min() > -1e-9
        # The gradient is a sum of the limits that bind, each pushing inwards.
        bound = slack < 1e-7
        push = matrix.T @ (matrix @ found - target)
        factors = np.linalg.lstsq(sides[bound].T, push, rcond=None)[0]
        assert sides[bound].T @ factors == pytest.approx(push, abs=1e-6)
        assert (factors > -1e-7).all()
    with pytest.raises(ValueError, match="contradict"):
        solve_limited(np.eye(1), np.zeros(1), np.array([[1.0], [-1.0]]), np.array([1.0, 1.0]))


def test_without_limits_and_memory_the_predictive_commands_are_the_exact_inverse():
    arm = make_arm(limit=2.0)
    wanted = circle(8.0, 40)
    exact = run_control(StaticInverse(effector=arm, rate=1e9), wanted, plant=arm)
    assert exact.tip == pytest.approx(wanted, abs=1e-6)
    predictive = PredictiveControl(
        effector=arm, rate=1e9, level=1e-3, smoothness=0.0, rounds=5, knots=tuple(range(6))
    )
    found = run_control(predictive, wanted, plant=arm)
    assert found.tip[1:] == pytest.approx(wanted[1:], abs=1e-5)
    assert found.commands == pytest.approx(exact.commands, abs=1e-5)


@pytest.mark.parametrize("body_lag", [0.0, 0.1])
def test_the_inverse_in_time_undoes_the_motion(body_lag):
    motion = dataclasses.replace(MOTION, body_lag=body_lag)
    arm = make_arm(motion, angles=(0.0, 90.0))
    times = PERIOD * np.arange(101)
    commands = np.stack(
        [0.35 + 0.25 * np.sin(3.0 * times), 0.35 - 0.25 * np.sin(2.0 * times)], axis=1
    )
    track = arm.simulate(times, commands)
    inverse = InverseInTime(effector=arm, rate=1e9)
    state = inverse.begin(commands[0])
    for k in range(100):
        command, state = inverse.step(state, track.tip[k + 1 : k + 2, :2])
        assert command == pytest.approx(commands[k], abs=1e-5)
        assert state.tip == pytest.approx(track.tip[k + 1, :2], abs=1e-6)


def test_commands_keep_to_pressure_and_rate():
    arm = make_arm(MOTION, limit=0.3)
    wanted = circle(12.0, 60, frequency=2.0)
    for kind, seen in CONTROLLERS.values():
        controller = kind(effector=arm, rate=2.0)
        found = run_control(controller, wanted, plant=arm, seen=seen)
        first = controller.rest_at(wanted[0])
        changes = np.diff(np.concatenate([first[None], found.commands]), axis=0)
        assert found.commands.min() >= 0.0
        assert found.commands.max() <= 0.3
        assert np.abs(changes).max() <= 2.0 * PERIOD + 1e-12


def test_each_thing_that_is_undone_makes_the_error_smaller():
    arm = make_arm(MOTION)
    wanted = circle(5.0, 150)
    static, led, undone, predicted = (
        rms((run_control(kind(effector=arm), wanted, plant=arm).tip - wanted)[50:])
        for kind in (StaticInverse, LagFeedforward, InverseInTime, PredictiveControl)
    )
    assert led < 0.7 * static
    assert undone < 0.1 * led
    assert predicted < 0.1 * led


def test_a_plan_ahead_is_nearer_where_the_limit_of_rate_binds():
    arm = make_arm(MOTION)
    wanted = circle(6.0, 150)
    sample, ahead = (
        rms((run_control(kind(effector=arm, rate=1.0), wanted, plant=arm).tip - wanted)[50:])
        for kind in (InverseInTime, PredictiveControl)
    )
    assert ahead < 0.7 * sample


def test_a_tip_that_is_seen_makes_up_for_constants_that_are_off():
    arm, wanted = make_arm(MOTION), circle(5.0, 100, frequency=0.2)
    laws = tuple(dataclasses.replace(law, area=1.15 * law.area) for law in arm.pulls or ())
    plant = dataclasses.replace(arm, pulls=laws)
    controller = PredictiveControl(effector=arm)
    blind, sees = (
        rms((run_control(controller, wanted, plant=plant, seen=seen).tip - wanted)[50:])
        for seen in (False, True)
    )
    assert sees < 0.3 * blind


def test_a_tip_that_is_seen_far_off_is_answered():
    arm = make_arm(MOTION)
    for kind, _ in CONTROLLERS.values():
        controller = kind(effector=arm, trust=1.0)
        command, after = controller.step(controller.begin(), [[60.0, 0.0]], seen=[-1e3, 1.0])
        assert np.isfinite(command).all()
        assert np.isfinite(after.tip).all()


def test_a_state_goes_on_as_one_run_does():
    arm, wanted = make_arm(MOTION), circle(5.0, 12)
    controller = PredictiveControl(effector=arm)
    state = controller.begin()
    commands = []
    for k in range(12):
        command, after = controller.step(state, wanted[k + 1 :])
        again, _ = controller.step(state, wanted[k + 1 :])
        assert np.array_equal(command, again)
        commands.append(command)
        state = after
    held = np.concatenate([commands, commands[-1:]])
    track = arm.simulate(PERIOD * np.arange(13), held, initial=controller.begin().motion)
    assert state.tip == pytest.approx(track.tip[-1, :2], abs=1e-9)


def make_file(**intervals: tuple[float, ...]) -> EffectorFile:
    arm = make_arm(MOTION)
    return EffectorFile(
        muscles=arm.design.muscles,
        section={"offset": 6.0, "backbone_length": 100.0, "flexural_rigidity": 2e4,
                 "pressure_limit": 0.7},
        motion=MOTION,
        pulls=arm.pulls or (),
        intervals=intervals,
    )  # fmt: skip


@pytest.mark.parametrize("plays", [(), (0.3,)])
def test_models_of_muscles_are_controlled_from_their_dead_band_on(plays):
    """Without pressure no muscle bends the section: there is no slope to begin with."""
    motion = EffectorMotion(fill_lag=0.03, bleed_lag=0.03, play_radii=(0.03,)[: len(plays)],
                            play_weights=plays)  # fmt: skip
    arm = dataclasses.replace(Effector.from_preset("prototype"), motion=motion)
    assert not arm.forward([0.05, 0.0, 0.0]).lateral
    wanted = circle(8.0, 100)
    wanted[:25] = wanted[25]
    off = {}
    for kind in (StaticInverse, PredictiveControl):
        controller = kind(effector=arm)
        state, tips = controller.begin(), []
        for k in range(1, 101):
            command, state = controller.step(state, wanted[k : k + 20])
            tips.append(state.tip)
            assert controller.highest >= command.max() and command.min() >= 0.0
        off[kind] = rms((np.array(tips) - wanted[1:])[30:])
    assert 2.0 * off[PredictiveControl] < off[StaticInverse] < 3.0
    controller = StaticInverse(effector=arm)
    place = np.array([4.0, -3.0])
    assert controller.rest_at(place) == pytest.approx(arm.inverse(place).pressures, abs=1e-12)


def test_plants_are_off_by_the_standard_errors_of_the_fit():
    half = 1.96 * 0.1
    names = [f"muscles.each.area[{name}]" for name in "ABC"]
    file = make_file(
        **{name: (20.0, 20.0 - half, 20.0 + half) for name in names},
        **{"motion.fill_lag": (0.3,), "motion.creep_share": (0.1, -2.0, 2.2)},
    )
    random = np.random.default_rng(5)
    plants = [draw_plant(file, random)[0] for _ in range(200)]
    off = np.array([
        [law.area - was.area for law, was in zip(one.pulls, file.pulls, strict=True)]
        for one in plants
    ])  # fmt: skip
    assert off.std(axis=0) == pytest.approx([0.1] * 3, rel=0.15)
    assert {one.motion.fill_lag for one in plants} == {0.3}
    shares = np.array([one.motion.creep_share for one in plants])
    assert shares.min() == 0.0
    assert shares.max() <= 0.95


def test_refusals():
    with pytest.raises(InputError, match="no pulls of its own"):
        InverseInTime(effector=Effector.from_preset("measured"))
    controller = StaticInverse(effector=make_arm())
    with pytest.raises(InputError, match="wanted 90 mm from the axis: it must be 70 mm"):
        controller.step(controller.begin(), [[90.0, 0.0]])
    with pytest.raises(InputError, match="finite"):
        controller.step(controller.begin(), [[math.nan, 0.0]])
    with pytest.raises(InputError, match=r"shape \(2,\)"):
        controller.begin([0.0, 0.1])
    with pytest.raises(InputError, match="seen has 1 point"):
        controller.step(controller.begin(), [[5.0, 0.0]], seen=[math.nan, 0.0])
    with pytest.raises(InputError, match="0.8 MPa"):
        controller.begin([0.0, 0.1, 0.8])
    with pytest.raises(InputError, match="must begin at 0 and increase"):
        PredictiveControl(effector=make_arm(), knots=(0, 2, 2))


def test_the_command_tracks_and_draws(tmp_path, capsys):
    write_effector(tmp_path / "arm.yaml", make_file())
    words = ["effector", "track", str(tmp_path / "arm.yaml"), "--trace", "line", "--radius"]
    words += ["5mm", "--frequency", "2Hz", "--plants", "1"]
    assert main([*words, "--json", "--out", str(tmp_path / "track.png")]) == 0
    found = json.loads(capsys.readouterr().out)["controllers"]
    assert list(found) == list(CONTROLLERS)
    # No constant was fitted, so the plant that is off is the same one.
    assert all(row["rms_off_mm"] == pytest.approx(row["rms_mm"]) for row in found.values())
    assert (tmp_path / "track.png").stat().st_size > 10_000
    assert main([*words[:6], "95mm"]) == 2
    assert "it must be 70 mm at most" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("trace", ["circle", "line"])
@pytest.mark.parametrize("frequency", [0.25, 0.5])
def test_four_controllers(trace, frequency):
    wanted = trace_places(trace, radius=5.0, frequency=frequency, period=PERIOD)
    found = compare_controllers(make_arm(MOTION), wanted)
    by_name = {row.controller: row for row in found.rows}
    static = by_name["static inverse"]
    for name in ("inverse in time", "predictive", "predictive, tip seen"):
        assert 2.0 * by_name[name].rms < static.rms
    assert by_name["predictive"].step_median < 0.01

"""Control of tendon robots in time: what each controller reaches, and keeps to."""

from __future__ import annotations

import dataclasses
import json
import math
from functools import cache

import numpy as np
import pytest
import yaml

from bozzini.cli.main import main
from bozzini.continuum import (
    TENDON_CONTROLLERS,
    AimedTip,
    ContinuumRobot,
    ContinuumTracking,
    DynamicsOptions,
    LinearQuadratic,
    ProportionalIntegral,
    ResolvedRates,
    RobotCalibration,
    Section,
    StaticTensions,
    Tendon,
    TendonChoice,
    TendonController,
    TendonTrackedBy,
    TensionPrediction,
    Wire,
    compare_tendons,
    linearise,
    run_tendons,
    simulate,
    soften,
)
from bozzini.errors import GeometryError, InputError
from bozzini.tracking import trace_places

OPTIONS = DynamicsOptions(segment="channel", damping_time=5e-3, tip_weight=0.02, max_step=2.5e-3)
KINDS = list(TENDON_CONTROLLERS.values())
SEEING = KINDS[1:]
RADIUS = 20.0


def make_arm(sections: int = 1) -> ContinuumRobot:
    wire = Wire(diameter=1.0, modulus=60e3, density=6450.0)
    return ContinuumRobot(
        tuple(
            Section(
                length=100.0 / sections,
                radius=5.0,
                discs=6 // sections,
                wire=wire,
                line_weight=1e-4,
                disc_weight=1e-3,
                tendons=tuple(
                    Tendon(name=f"{part}{k}", offset=4.0, angle=2.0 * math.pi * k / 3 + 0.4 * part)
                    for k in range(3)
                ),
            )
            for part in range(sections)
        )
    )


ARM = make_arm()


def make(kind, **known):
    return kind(robot=ARM, options=OPTIONS, **known)


@cache
def track(kind, *, softer=0.0, frequency=1.0, noise=0.0, **known) -> TendonTrackedBy:
    controller = make(kind, **known)
    wanted = trace_places("circle", radius=RADIUS, frequency=frequency, period=controller.period)
    found = compare_tendons({"": controller}, wanted, plant=soften(ARM, softer), noise=noise)
    return found.rows[0]


def stand(kind, *, softer=0.2, count=250, **known):
    controller = make(kind, **known)
    wanted = np.tile([RADIUS, 5.0], (count + 1, 1))
    run = run_tendons(controller, wanted, plant=soften(ARM, softer))
    return np.hypot(*(run.tip - wanted).T)[-20:].max()


@pytest.mark.parametrize("sections", [1, 2])
def test_the_inverse_holds_the_tip_by_the_smallest_tensions(sections):
    controller = StaticTensions(robot=make_arm(sections), options=OPTIONS)
    held = controller.begin([RADIUS, -7.0]).held
    moved = simulate(controller.robot, [0.0, 0.01], tensions=held.tensions, options=OPTIONS)
    assert moved.tip[0, :2] == pytest.approx([RADIUS, -7.0], abs=1e-3)
    assert held.tensions.min() >= 0.0
    # Three that pull evenly do nothing, so the smallest tension is none.
    assert held.tensions[:3].min() < 1e-9
    # Slopes against differences.
    for k, slope in enumerate(held.by_tension.T):
        high, low = (
            controller.hold(held.tensions + sign * 1e-4 * np.eye(3 * sections)[k])
            for sign in (1.0, -1.0)
        )
        assert (high.place - low.place) / 2e-4 == pytest.approx(slope, abs=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_a_slow_circle_is_tracked_by_a_perfect_model(kind):
    assert track(kind, frequency=0.25, delay=0).largest < 0.01 * RADIUS


@pytest.mark.parametrize("kind", SEEING)
def test_what_sees_the_tip_has_no_steady_error(kind):
    assert stand(kind) < 1e-3 * RADIUS
    assert stand(StaticTensions) > 0.1 * RADIUS


def test_wrong_stiffness_at_1_hz():
    baseline, rates, pi, regulator, predictive = (
        track(kind, softer=0.2, noise=0.1).rms for kind in KINDS
    )
    assert max(rates, pi) < 0.85 * baseline
    assert max(regulator, predictive) < 0.35 * min(rates, pi)
    assert 0.2 * RADIUS < baseline < 0.3 * RADIUS  # 1 / 0.8 of the bend


def test_friction_that_no_controller_knows_of():
    plant = soften(ARM, 0.2)
    (section,) = plant.sections
    rubbing = tuple(dataclasses.replace(one, friction=0.3) for one in section.tendons)
    rubbing = dataclasses.replace(plant, sections=(dataclasses.replace(section, tendons=rubbing),))
    controllers = {kind.__name__: make(kind) for kind in (StaticTensions, LinearQuadratic)}
    wanted = trace_places("circle", radius=RADIUS, frequency=1.0, period=0.01)
    smooth, rough = (compare_tendons(controllers, wanted, plant=one) for one in (plant, rubbing))
    assert rough.rows[1].rms < 0.35 * rough.rows[0].rms
    for one, other in zip(smooth.rows, rough.rows, strict=True):
        assert other.largest > 1.1 * one.largest
    assert "friction" in rough.notes[-1] and len(smooth.notes) == 1


@pytest.mark.parametrize("kind", SEEING)
def test_a_delay_makes_it_worse(kind):
    rms = [track(kind, softer=0.2, delay=delay).rms for delay in (0, 3)]
    assert rms[1] > 1.08 * rms[0]


def test_the_aimed_tip_moves_as_the_robot_does():
    controller = make(LinearQuadratic, modes=100)
    model = controller.model
    assert model.c @ model.at_rest == pytest.approx(np.eye(2), abs=1e-9)
    held = controller.reach(np.array([0.2, 0.1]), controller.hold(np.zeros(3)))
    times = controller.period * np.arange(12)
    pulled = np.tile(held.tensions, (12, 1))
    fine = dataclasses.replace(OPTIONS, max_step=2e-4)
    still = simulate(ARM, [0.0, 0.01], tensions=np.zeros(3), options=fine)
    moved = simulate(ARM, times, tensions=pulled, options=fine, initial=still)
    state, tips = model.at_rest @ controller.hold(np.zeros(3)).place, []
    for _ in times:
        tips.append(model.c @ state)
        state = model.a @ state + model.b @ held.place
    assert np.array(tips) == pytest.approx(moved.tip[:, :2], abs=0.02 * 0.2)
    few = AimedTip.of(controller, 2)
    assert few.c @ few.at_rest == pytest.approx(np.eye(2), abs=1e-9)


@pytest.mark.parametrize("effort", [0.01, 0.1, 1.0])
def test_the_regulator_and_its_filter_are_stable(effort):
    controller = make(LinearQuadratic, effort=effort)
    model, own = controller.model, len(controller.model.a) - 2
    closed = (model.a - model.b @ controller.feedback)[:own, :own]
    assert np.abs(np.linalg.eigvals(closed)).max() < 1.0
    gain = model.find_filter(noise=0.1, drift=0.2)
    seen = model.a @ (np.eye(own + 2) - gain @ model.c)
    assert np.abs(np.linalg.eigvals(seen)).max() < 1.0


def test_a_long_plan_without_limits_is_the_regulator():
    # At a still place, from a tip that is off.
    known = {"effort": 0.5, "highest": 1e3, "rate": 1e6, "delay": 1}
    wanted = np.array([[2.0, 1.0]])
    places = []
    for controller in (
        make(LinearQuadratic, **known),
        make(TensionPrediction, knots=tuple(range(40)), **known),
    ):
        state = controller.begin(wanted[0])
        _, state = controller.step(state, wanted, seen=wanted[0] + [0.1, -0.05])
        places.append(state.held.place - wanted[0])
    assert np.hypot(*places[0]) > 0.02
    assert places[1] == pytest.approx(places[0], abs=0.02 * np.hypot(*places[0]))


@pytest.mark.parametrize("kind", KINDS)
def test_commands_keep_to_the_limits(kind):
    controller = make(kind, rate=12.0, highest=3.0)
    wanted = trace_places("circle", radius=RADIUS, frequency=2.0, period=controller.period)
    run = run_tendons(controller, wanted, plant=soften(ARM, 0.2))
    assert run.commands.min() >= 0.0
    assert run.commands.max() <= 3.0
    changes = np.abs(np.diff(run.commands, axis=0))
    assert changes.max() == pytest.approx(0.12)
    found = compare_tendons({"": controller}, wanted, plant=soften(ARM, 0.2))
    assert found.rows[0].at_limits > 0.2


def test_a_plan_within_limits_of_rate_is_nearer():
    known = {"rate": 20.0, "frequency": 1.0}
    predictive, regulator = (track(kind, **known) for kind in (TensionPrediction, LinearQuadratic))
    assert predictive.rms < 0.8 * regulator.rms


def test_a_robot_that_goes_on_keeps_its_rod():
    tensions = np.array([1.0, 0.0, 0.0])
    first = simulate(ARM, [0.0, 0.01], tensions=tensions, options=OPTIONS)
    again = simulate(ARM, [0.0, 0.01], tensions=tensions, options=OPTIONS, initial=first)
    other = simulate(
        ARM, [0.0, 0.01], tensions=tensions, initial=first,
        options=dataclasses.replace(OPTIONS, damping_time=0.1),
    )  # fmt: skip
    assert again.rod is first.rod
    assert other.rod is not first.rod


def test_a_softer_robot_has_slower_modes():
    weightless = DynamicsOptions(segment="channel", gravity=(0.0, 0.0, 0.0))
    before, after = (linearise(robot, options=weightless) for robot in (ARM, soften(ARM, 0.2)))
    assert (after.frequency / before.frequency)[:6] == pytest.approx(math.sqrt(0.8), rel=1e-6)


def test_an_aim_out_of_reach_does_not_end_across_a_fold():
    controller = make(StaticTensions, highest=60.0)
    rest = controller.hold(np.zeros(3))
    for angle in (0.0, 0.7, 2.0):
        way = np.array([math.cos(angle), math.sin(angle)])
        held, ahead = controller.reach(300.0 * way, rest), []
        ahead = [controller.reach(size * way, rest).place @ way for size in (20.0, 40.0, 60.0)]
        assert np.all(np.diff([*ahead, held.place @ way]) > -1e-3)
        # It is where it comes to from rest, without a jump.
        slowly = rest
        for share in np.linspace(0.1, 1.0, 10):
            slowly = controller.hold(share * held.tensions, slowly)
        assert held.place == pytest.approx(slowly.place, abs=1e-3)


def test_a_controller_of_ones_own_chooses_tensions():
    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Constant(TendonController):
        def choose(self, state, *, wanted, seen, limits):
            return TendonChoice(np.array([1.0, 0.0, 0.0]), state.estimate)

    run = run_tendons(make(Constant), np.zeros((6, 2)), plant=ARM)
    np.testing.assert_allclose(run.commands[-1], [1.0, 0.0, 0.0])


def test_controllers_without_damping_say_so():
    options = dataclasses.replace(OPTIONS, damping_time=0.0)
    controller = ResolvedRates(robot=ARM, options=options)
    found = compare_tendons({"": controller}, np.zeros((5, 2)), plant=ARM)
    assert any("no damping" in note for note in found.notes)


def test_what_is_not_legal_is_told():
    with pytest.raises(InputError, match="knots are"):
        make(TensionPrediction, knots=(0, 0))
    with pytest.raises(InputError, match="tensions up to 0.5 N hold it"):
        make(ResolvedRates, highest=0.5).begin([30.0, 0.0])
    controller = make(ProportionalIntegral)
    state = controller.begin([1.0, 0.0])
    with pytest.raises(InputError, match="seen"):
        controller.step(state, [[1.0, 0.0]], seen=[1.0])
    with pytest.raises(GeometryError, match="no tendons"):
        StaticTensions(robot=ContinuumRobot((Section(length=50.0, radius=2.0),)))


def test_track_command(tmp_path, capsys):
    path = tmp_path / "arm.yaml"
    ARM.to_yaml(path)
    words = ["continuum", "track", str(path), "--radius", "15mm", "--frequency", "5Hz", "--json"]
    assert main([*words, "--damping-time", "5ms", "--out", str(tmp_path / "track.png")]) == 0
    found = json.loads(capsys.readouterr().out)
    assert list(found["controllers"]) == list(TENDON_CONTROLLERS)
    assert (tmp_path / "track.png").stat().st_size > 10_000
    bare = yaml.safe_load(path.read_text())
    for section in bare["sections"]:
        section.pop("line_weight")
        section.pop("disc_weight")
        section["wire"].pop("density")
    path.write_text(yaml.safe_dump(bare))
    assert main(words) == 2
    assert "parts without mass" in capsys.readouterr().err


def test_limits_of_a_calibrated_robot_are_those_commanded(tmp_path, monkeypatch) -> None:
    seen = {}

    def keep(controllers, wanted, **others):
        seen.update(controllers)
        raise InterruptedError

    monkeypatch.setattr("bozzini.continuum.tracking.compare_tendons", keep)
    known = RobotCalibration(command="tension", scale=0.5)
    path = tmp_path / "fitted.yaml"
    dataclasses.replace(ARM, calibration=known).to_yaml(path)
    with pytest.raises(InterruptedError):
        ContinuumTracking(robot=str(path), radius=5.0, highest=10.0, rate=60.0).run()
    limits = {(controller.highest, controller.rate) for controller in seen.values()}
    assert limits == {(5.0, 30.0)}

"""Derivatives of motions, and fits of robots to records of one."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from bozzini.continuum import (
    ContinuumRobot,
    DynamicsOptions,
    Marker,
    RobotFitOptions,
    RobotMeasurements,
    RobotSetup,
    Section,
    Tendon,
    Wire,
    differentiate_motion,
    fit_robot,
    parse_unknowns,
    predict_points,
    read_robot_measurements,
    simulate,
)
from bozzini.continuum.observation import Observation
from bozzini.errors import InputError, UnitError

BENDING = 60e3 * math.pi / 64.0
OPTIONS = DynamicsOptions(segment="arc", damping_time=4e-3, max_step=2e-3)
MARKERS = (Marker(name="tip"), Marker(name="middle", arc_length=55.0, offset=(5.0, 0.0, 0.0)))
COMMANDS = {"tension": (2.0, 2.0), "displacement": (2.0, 2.0)}


def make_robot(**changes) -> ContinuumRobot:
    tendons = tuple(
        Tendon(name=f"T{k}", offset=4.0, angle=2.0 * math.pi * k / 3.0, stiffness=60.0)
        for k in range(3)
    )
    wire = Wire(diameter=1.0, modulus=60e3, density=6450.0)
    section = Section(
        length=100.0, radius=5.0, discs=6, wire=wire, disc_weight=5e-3, tendons=tendons
    )
    return ContinuumRobot((section,), **changes)


def change(setup: RobotSetup, **values: float) -> RobotSetup:
    """Return a setup with another modulus, offset and damping."""
    section = setup.robot.sections[0]
    wire = dataclasses.replace(section.wire, modulus=values["modulus"])
    tendons = tuple(dataclasses.replace(one, offset=values["offset"]) for one in section.tendons)
    robot = dataclasses.replace(
        setup.robot, sections=(dataclasses.replace(section, wire=wire, tendons=tendons),)
    )
    dynamics = dataclasses.replace(OPTIONS, damping_time=values["damping_time"])
    return dataclasses.replace(setup, robot=robot, dynamics=dynamics)


def record(
    truth: RobotSetup, *, command: str = "tension", noise: float = 0.0, seed: int = 0
) -> RobotMeasurements:
    """Return a record of 0.8 s at 50 Hz that begins at rest."""
    times = np.linspace(0.0, 0.8, 41)
    level, swing = COMMANDS[command]
    waves = np.sin(np.outer(times, [11.0, 17.0, 23.0])) + 0.5 * np.sin(np.outer(times, [40.0] * 3))
    commands = level * (times > 0.0)[:, None] + swing * 0.4 * waves
    commands[0] = 0.0
    blank = RobotMeasurements(
        command=command,
        tendons=truth.robot.tendon_names,
        commands=np.maximum(commands, 0.0) if command == "tension" else commands,
        markers=truth.markers,
        points=np.zeros((len(times), len(truth.markers), 3)),
        times=times,
    )
    points = predict_points(truth, blank).predicted
    drawn = np.random.default_rng(seed).normal(0.0, noise, points.shape)
    return dataclasses.replace(blank, points=points + drawn)


TRUE = {"modulus": 75e3, "offset": 3.7, "damping_time": 6e-3}
FREE = ("sections.*.modulus", "tendons.*.offset", "motion.damping_time")
TRUTH = change(RobotSetup(make_robot(), MARKERS), **TRUE)


def test_derivatives_obey_the_scaling_of_time() -> None:
    # With stiffness times x, damping time by its root and tensions that grow as time does times
    # x to the 3/2, all goes as before, the root of x times as fast.
    times = np.linspace(0.0, 0.2, 21)
    options = dataclasses.replace(OPTIONS, gravity=(0.0, 0.0, 0.0), max_step=5e-4)
    by = ("sections.*.modulus", "motion.damping_time", "commands.scale")
    found = differentiate_motion(
        make_robot(), times, by=by, options=options, tensions=np.outer(times, [20.0, 5.0, 0.0])
    )
    assert found.converged and found.residual < 1e-3
    modulus, damping, tension = np.moveaxis(found.points, -1, 0)
    speed = found.history.velocities * times[:, None, None]
    left = modulus + 1.5 * tension - 0.5 * damping
    np.testing.assert_allclose(left, 0.5 * speed, atol=2e-3 * np.abs(speed).max())
    assert np.abs(modulus).max() > 0.1 * np.abs(speed).max()
    assert np.abs(damping).max() > 0.01 * np.abs(speed).max()


def test_derivatives_at_a_bound_are_those_of_finer_differences() -> None:
    times = np.linspace(0.0, 0.2, 6)
    options = dataclasses.replace(OPTIONS, max_step=2e-3)
    pulls = np.outer(times, [60.0, 30.0, 0.0])

    def rub(friction: float) -> np.ndarray:
        section = make_robot().sections[0]
        tendons = (dataclasses.replace(one, friction=friction) for one in section.tendons)
        robot = ContinuumRobot((dataclasses.replace(section, tendons=tuple(tendons)),))
        return simulate(robot, times, tensions=pulls, options=options).tip

    found = differentiate_motion(
        make_robot(), times, by=["tendons.*.friction"], options=options, tensions=pulls
    )
    none, little, more = (rub(friction) for friction in (0.0, 1e-3, 2e-3))
    finer = (4.0 * little - 3.0 * none - more) / 2e-3
    size = np.abs(finer).max()
    assert size > 0.1
    np.testing.assert_allclose(found.tip[..., 0], finer, atol=5e-4 * size)


def test_derivatives_of_round_off_are_none_to_doubt() -> None:
    options = dataclasses.replace(OPTIONS, gravity=(0.0, 0.0, 0.0), drag=1e-6, max_step=5e-3)
    even = np.full(3, 0.5)
    found = differentiate_motion(
        make_robot(), [0.0, 0.01, 0.02], by=["motion.drag"], options=options, tensions=even
    )
    assert np.abs(found.tip).max() < 1e-9
    assert found.converged, found.reason


def test_derivatives_of_a_fit_are_those_of_finer_differences() -> None:
    data = record(TRUTH, command="displacement")
    by = ("sections.1.modulus", "tendons.T1.offset", "tendons.*.stiffness", "motion.damping_time")
    found = differentiate_motion(
        TRUTH, data.times, by=by, options=TRUTH.dynamics, displacements=data.commands
    )
    unknowns = parse_unknowns(by, TRUTH)
    observation = Observation(TRUTH, data, "motion", {}, data.seen_rows)
    none = np.zeros(len(by))
    plain = observation.differentiate(unknowns, none, observation.change(unknowns, none))[:, 0]
    size = np.abs(found.tip).max(axis=(0, 1))
    assert np.all(np.abs(plain - found.tip).max(axis=(0, 1)) < 5e-3 * size)
    assert found.residual < 1e-3
    assert set(found.to_frame()) >= {"time_s", "tip_by_motion.damping_time_x_mm"}
    assert len(found.plot().lines) == 4 and found.to_dict()["derivatives"].keys() == set(by)


@pytest.mark.parametrize("command", ["tension", "displacement"])
def test_truth_comes_back_from_a_record_and_rows_left_out_are_predicted(command: str) -> None:
    data = record(TRUTH, command=command, noise=0.05)
    options = RobotFitOptions(dynamics=OPTIONS, folds=2, smaller=False)
    fit = fit_robot(make_robot(), data, free=FREE, options=options)
    assert fit.converged and not fit.undetermined
    for one, value in zip(fit.estimates, TRUE.values(), strict=True):
        # Three intervals of 95 %, each at most half as wide again for this one draw.
        assert abs(one.value - value) < 1.5 * (one.high - one.low) / 2.0
        assert one.value == pytest.approx(value, rel=0.1)
    noise = 0.05 * math.sqrt(3.0)
    assert fit.rms == pytest.approx(noise, rel=0.15)
    assert fit.validation.rms == pytest.approx(noise, rel=0.2)
    other = record(TRUTH, command=command, noise=0.05, seed=1)
    assert fit.predict(other).rms == pytest.approx(noise, rel=0.2)
    assert fit.robot.calibration.model == "energy"
    assert fit.to_dict()["model"] == "motion"


@pytest.mark.slow(20)
def test_intervals_of_records_cover_the_truth() -> None:
    options, covered = RobotFitOptions(dynamics=OPTIONS, folds=0, loss="linear"), []
    for seed in range(15):
        data = record(TRUTH, noise=0.1, seed=seed)
        fit = fit_robot(TRUTH, data, free=FREE, options=options)
        covered += [
            one.low <= value <= one.high
            for one, value in zip(fit.estimates, TRUE.values(), strict=True)
        ]
    assert 0.85 <= np.mean(covered) <= 1.0


def test_a_record_in_time_is_read_and_one_without_times_is_refused(tmp_path) -> None:
    robot, path = make_robot(), tmp_path / "rows.csv"
    head = "time [ms],T0 tension [N],tip x [mm],tip y [mm],tip z [mm]\n"
    path.write_text(head + "0,0,0,0,100\n20,1,,,\n40,2,1,0,99\n")
    data = read_robot_measurements(path, robot=robot, timed=True)
    np.testing.assert_allclose(data.times, [0.0, 0.02, 0.04])
    assert not data.notes or "ignored" not in " ".join(data.notes)
    assert data.select([0, 2]).times.tolist() == [0.0, 0.04]
    still = read_robot_measurements(path, robot=robot)
    assert not still.times.size
    with pytest.raises(InputError, match="no times"):
        fit_robot(robot, still, free=(), options=RobotFitOptions(dynamics=OPTIONS))
    path.write_text(head + "0,0,0,0,100\n20,1,1,0,99\n20,2,1,0,99\n")
    with pytest.raises(InputError, match="row 3 comes after"):
        read_robot_measurements(path, robot=robot, timed=True)
    path.write_text(head.replace(" [ms]", "") + "0,0,0,0,100\n")
    with pytest.raises(UnitError, match="time"):
        read_robot_measurements(path, robot=robot, timed=True)


@pytest.mark.parametrize(
    ("words", "free", "options"),
    [
        ("at rest, not in time", ["motion.damping_time"], {"dynamics": None}),
        ("is 0: give", ["motion.drag"], {}),
        ("leave it out", ["tendons.*.offset"], {"model": "rod"}),
        ("cannot be fitted", ["motion.max_step"], {}),
    ],
)
def test_what_does_not_fit_a_record_is_refused(words, free, options) -> None:
    data = record(TRUTH)
    with pytest.raises(InputError, match=words):
        fit_robot(
            TRUTH, data, free=free, options=RobotFitOptions(**{"dynamics": OPTIONS, **options})
        )


def test_derivatives_by_what_does_not_move_the_robot_are_refused() -> None:
    for by, words in ((["base"], "not of the motion"), ("base", "sequence"), ([], "sequence")):
        with pytest.raises(InputError, match=words):
            differentiate_motion(make_robot(), [0.0, 0.1], by=by)

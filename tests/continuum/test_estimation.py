"""Shape and loads from sensors: derivatives, limits, and how often intervals hold the truth."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bozzini.cli.main import main
from bozzini.continuum import (
    BodySensor,
    ContinuumRobot,
    CurvatureSensor,
    EnergyModel,
    ModelError,
    PlaceSensor,
    PointLoad,
    PoseSensor,
    Section,
    SensorRecord,
    ShapeEstimator,
    SightSensor,
    StrainSensor,
    Tendon,
    TensionSensor,
    UnknownLoad,
    fit_model_error,
    follow_record,
    plan_sensors,
    read_sensor_table,
)
from bozzini.errors import BozziniError, InputError
from bozzini.vision import aim_camera

PULLED = np.array([2.5, -1.0, -1.5, 0.8, -0.5, -0.3])


def make_robot(stiffer: float = 1.0) -> ContinuumRobot:
    return ContinuumRobot(
        tuple(
            Section(
                length=80.0,
                radius=5.0,
                discs=4,
                bending_stiffness=3000.0 * stiffer,
                torsional_stiffness=2500.0 * stiffer,
                tendons=tuple(
                    Tendon(name=f"{part}{k}", offset=4.0, angle=2.1 * k + part, stiffness=3000.0)
                    for k in range(3)
                ),
            )
            for part in range(2)
        ),
        base_position=(5.0, 0.0, 20.0),
        base_rotation=(0.3, 0.1, 0.0),
    )


MODEL = EnergyModel(make_robot(), segment="channel")
CAMERA = aim_camera((400.0, 50.0, 100.0), (0.0, 0.0, 100.0), focal=800.0, size=(640, 480))
SENSORS: tuple[BodySensor, ...] = (
    PlaceSensor(name="marker", arc_length=100.0, offset=(3.0, 0.0, 0.0)),
    PoseSensor(name="tracker"),
    CurvatureSensor(name="cores", arc_length=50.0),
    StrainSensor(name="grating", arc_length=30.0, offset=(0.5, 0.5), bias=1e-4),
    SightSensor(name="sight", arc_length=80.0),
    TensionSensor(name="00"),
)
WRONG = ModelError(coupling=0.02, position=1.0, rotation=0.02)


def read_sensors(truth, sensors, random=None) -> dict[str, np.ndarray]:
    """Return what sensors at stations, or in the middle of segments, read of a shape."""
    readings = {}
    steps = np.linalg.inv(truth.frames[:-1]) @ truth.frames[1:]
    bends = Rotation.from_matrix(steps[:, :3, :3]).as_rotvec() / np.diff(truth.arc_length)[:, None]
    middles = 0.5 * (truth.arc_length[1:] + truth.arc_length[:-1])
    for sensor in sensors:
        at = truth.robot.length if sensor.arc_length is None else sensor.arc_length
        frame = truth.frames[int(np.argmin(np.abs(truth.arc_length - at)))]
        place = frame[:3, :3] @ sensor.at + frame[:3, 3]
        bend = bends[int(np.argmin(np.abs(middles - at)))]
        noise = np.zeros(6) if random is None else random.standard_normal(6)
        if isinstance(sensor, PoseSensor):
            turn = Rotation.from_rotvec(sensor.rotation_deviation * noise[3:])
            turned = turn * Rotation.from_matrix(frame[:3, :3])
            reading = np.append(place + sensor.deviation * noise[:3], turned.as_rotvec())
        elif isinstance(sensor, SightSensor):
            way = CAMERA.rays(CAMERA.project(place))
            reading = np.append(CAMERA.centre, way + sensor.angle * np.cross(way, noise[:3]))
        else:
            exact = {
                PlaceSensor: place,
                CurvatureSensor: bend[:2],
                StrainSensor: np.array([0.5 * bend[0] - 0.5 * bend[1]]),
                TensionSensor: truth.tensions[:1],
            }[type(sensor)]
            reading = exact + sensor.deviation * noise[: len(exact)]
        readings[sensor.name] = reading
    return readings


def draw_truth(estimator: ShapeEstimator, random) -> object:
    """Return a shape whose state is drawn from what is known before."""
    state = estimator.begin()
    spread = np.sqrt(np.diag(state.covariance))
    drawn = state.mean + spread * random.standard_normal(len(spread))
    return estimator.estimate(PULLED, state=dataclasses.replace(state, mean=drawn))


def test_without_readings_the_estimate_is_the_model():
    loads = (PointLoad(arc_length=120.0, force=(0.1, 0.0, -0.1)),)
    model = EnergyModel(make_robot(), segment="channel", loads=loads)
    found = ShapeEstimator(model=model).estimate(PULLED)
    assert found.converged
    np.testing.assert_allclose(found.points, model.shape(PULLED).world_points, atol=1e-3)
    np.testing.assert_allclose(found.commanded, found.points, atol=1e-9)


def test_exact_readings_change_nothing_and_shrink_what_is_not_known():
    estimator = ShapeEstimator(model=MODEL, sensors=SENSORS, error=WRONG)
    before = estimator.estimate(PULLED)
    after = estimator.estimate(PULLED, read_sensors(before, SENSORS))
    np.testing.assert_allclose(after.points, before.points, atol=1e-3)
    assert after.residual < 1e-3
    assert np.all(after.deviations[2:] < before.deviations[2:])


def test_slopes_of_readings_are_those_of_differences():
    load = UnknownLoad(along=0.5, moment=3.0)
    estimator = ShapeEstimator(model=MODEL, sensors=SENSORS, error=WRONG, loads=(load,))
    random = np.random.default_rng(1)
    state = estimator.begin()
    spread = np.sqrt(np.diag(state.covariance))
    mean = state.mean + 0.3 * spread * random.standard_normal(len(spread))
    mean[estimator.names.index("load 1 place [mm]")] = 113.0
    truth = estimator.estimate(PULLED, state=dataclasses.replace(state, mean=mean))
    read = estimator._take_readings(read_sensors(truth, SENSORS))
    start = truth.state.rotation_vectors, truth.state.lengths
    nominal = estimator._solve(PULLED, 0.0 * mean, start, None)
    known = {"start": start, "short": MODEL.natural_lengths - nominal.lengths}
    slopes = estimator._evaluate(PULLED, read, mean, **known).slopes * spread
    found = np.empty_like(slopes)
    for index in range(len(mean)):
        step = 1e-4 * spread[index] * np.eye(len(mean))[index]
        less, more = (
            estimator._evaluate(PULLED, read, mean + sign * step, **known).missed
            for sign in (-1.0, 1.0)
        )
        found[:, index] = (less - more) / 2e-4
    off = np.abs(found - slopes) / np.abs(slopes).max(axis=1, keepdims=True)
    assert off.max() < 3e-5


def test_intervals_hold_the_truth_as_often_as_they_say():
    random = np.random.default_rng(2)
    estimator = ShapeEstimator(model=MODEL, sensors=SENSORS[:4], error=WRONG)
    inside, closer = [], []
    for _ in range(40):
        truth = draw_truth(estimator, random)
        found = estimator.estimate(PULLED, read_sensors(truth, estimator.sensors, random))
        assert found.converged
        off = truth.points - found.points
        inside.append(np.abs(off[2:]) < 1.96 * found.deviations[2:])
        closer.append(np.linalg.norm(off[-1]) < np.linalg.norm(truth.tip - found.commanded[-1]))
    assert 0.90 < np.mean(inside) < 0.985
    assert np.mean(closer) > 0.9


def test_a_force_is_found_where_it_acts():
    error = ModelError(curvature=1e-6, twist=1e-6, stiffness=1e-3, zero=1e-3)
    gratings = tuple(
        CurvatureSensor(name=f"g{k}", arc_length=10.0 + 20.0 * k, deviation=1e-6, share=0.01)
        for k in range(8)
    )
    loads = (PointLoad(arc_length=115.0, force=(0.3, 0.2, 0.0), frame="body"),)
    truth = ShapeEstimator(model=dataclasses.replace(MODEL, loads=loads), error=error)
    readings = read_sensors(truth.estimate(PULLED), gratings)
    estimator = ShapeEstimator(model=MODEL, sensors=gratings, error=error, loads=(UnknownLoad(),))
    found = estimator.estimate(PULLED, readings)
    load = found.loads[0]
    assert found.converged
    assert load.place == pytest.approx(115.0, abs=8.0)
    assert load.place_low < 115.0 < load.place_high
    assert load.force == pytest.approx(math.hypot(0.3, 0.2), rel=0.1)
    assert load.force_low < math.hypot(0.3, 0.2) < load.force_high
    there = dataclasses.replace(estimator, loads=(UnknownLoad(arc_length=115.0),))
    near = there.estimate(PULLED, readings).loads[0]
    assert near.force_high - near.force_low < load.force_high - load.force_low


def test_errors_that_last_are_learnt_and_forgotten():
    error = ModelError(zero=0.5, memory=10.0, drift=0.01)
    estimator = ShapeEstimator(model=MODEL, sensors=(SENSORS[1],), error=error)
    random = np.random.default_rng(3)
    truth = draw_truth(estimator, random)
    found = estimator.estimate(PULLED, read_sensors(truth, estimator.sensors))
    other = 0.8 * PULLED
    drawn = dataclasses.replace(truth.state, covariance=found.state.covariance)
    truth_there = estimator.estimate(other, state=drawn)
    later = estimator.estimate(other, state=estimator.wait(found.state, 1.0))
    alone = np.linalg.norm(truth_there.tip - later.commanded[-1])
    assert np.linalg.norm(truth_there.tip - later.tip) < 0.5 * alone
    late = estimator.wait(found.state, 1e4)
    fresh = estimator.begin()
    forgets = ["curvature" in name or "zero" in name for name in estimator.names]
    np.testing.assert_allclose(late.mean[forgets], 0.0, atol=1e-12)
    variances = np.diag(late.covariance), np.diag(fresh.covariance)
    np.testing.assert_allclose(variances[0][forgets], variances[1][forgets])


def test_tensions_are_commanded_too():
    estimator = ShapeEstimator(
        model=MODEL, sensors=SENSORS[:2], command="tension", error=ModelError(coupling=0.05)
    )
    pulls = np.array([3.0, 0.0, 1.0, 0.5, 0.0, 2.0])
    found = estimator.estimate(pulls)
    shape = MODEL.shape_under_tensions(pulls)
    np.testing.assert_allclose(found.points, shape.world_points, atol=1e-6)
    state = estimator.begin()
    spread = np.sqrt(np.diag(state.covariance))
    mean = spread * np.random.default_rng(4).standard_normal(len(spread))
    truth = estimator.estimate(pulls, state=dataclasses.replace(state, mean=mean))
    after = estimator.estimate(pulls, read_sensors(truth, estimator.sensors))
    assert np.linalg.norm(after.tip - truth.tip) < 0.3 * np.linalg.norm(found.tip - truth.tip)


def test_a_base_that_was_moved_is_found():
    moved = dataclasses.replace(make_robot(), base_position=(7.0, -1.0, 20.5))
    model = dataclasses.replace(MODEL, robot=moved)
    error = ModelError(position=2.0, rotation=0.02, curvature=1e-5, zero=0.01, stiffness=0.01)
    sensors = (PlaceSensor(name="low", arc_length=20.0, deviation=0.05), SENSORS[1])
    truth = ShapeEstimator(model=model).estimate(PULLED)
    found = ShapeEstimator(model=MODEL, sensors=sensors, error=error).estimate(
        PULLED, read_sensors(truth, sensors)
    )
    shift = found.frames[0, :3, 3] - MODEL.robot.base_frame[:3, 3]
    np.testing.assert_allclose(shift, (2.0, -1.0, 0.5), atol=0.3)
    assert found.state.mean[found.names.index("base position x [mm]")] != 0.0


def test_results_are_told():
    estimator = ShapeEstimator(model=MODEL, sensors=SENSORS, loads=(UnknownLoad(),))
    seen = read_sensors(estimator.estimate(PULLED), SENSORS)["marker"] + 3.0
    found = estimator.estimate(PULLED, {"marker": seen, "tracker": np.full(6, np.nan)})
    told = found.to_dict()
    assert told["converged"] and len(told["loads"]) == 1
    assert "bias of grating" in told["state"] and "zero of 00 [mm]" in told["state"]
    assert len(found.list_columns()["x_deviation_mm"]) == len(MODEL.arc_length)
    assert found.plot().get_legend() is not None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sensors": (SENSORS[0], SENSORS[0])}, "two sensors 'marker'"),
        ({"sensors": (TensionSensor(name="x"),)}, "of no tendon"),
        ({"loads": (UnknownLoad(arc_length=200.0),)}, r"200 mm: it must lie in \[0, 160\] mm"),
    ],
)
def test_what_does_not_fit_the_robot_is_refused(change, words):
    with pytest.raises(InputError, match=words):
        ShapeEstimator(model=MODEL, **change)


def test_illegal_readings_are_refused():
    estimator = ShapeEstimator(model=MODEL, sensors=SENSORS)
    with pytest.raises(InputError, match="no sensor 'nose'"):
        estimator.estimate(PULLED, {"nose": (1.0,)})
    with pytest.raises(InputError, match=r"must be \(3,\)"):
        estimator.estimate(PULLED, {"marker": (1.0,)})
    with pytest.raises(InputError, match="no force and no moment"):
        UnknownLoad(force=0.0)


def record_drift(rows: int) -> tuple[SensorRecord, SensorRecord]:
    """Return a recording of a robot of which a zero drifts, for a fit and for a check."""
    random = np.random.default_rng(5)
    estimator = ShapeEstimator(model=MODEL, sensors=SENSORS[1:2])
    first = estimator.names.index("zero of 00 [mm]")
    state, zero, tips, commands = estimator.begin(), 0.5, [], []
    for row in range(rows):
        zero = 0.9 * zero + 0.4 * math.sqrt(1.0 - 0.9**2) * random.standard_normal()
        mean = 0.0 * state.mean
        mean[first] = zero
        commands.append(PULLED * (1.0 + 0.3 * math.sin(0.3 * row)))
        truth = estimator.estimate(commands[-1], state=dataclasses.replace(state, mean=mean))
        tips.append(truth.tip + 0.1 * random.standard_normal(3))
    whole = SensorRecord(
        times=np.arange(float(rows)), commands=np.array(commands), readings={"tip": np.array(tips)}
    )
    half = np.arange(rows) < rows // 2
    return whole.select(half), whole.select(~half)


def test_sizes_of_errors_are_found_and_predict():
    fitted, checked = record_drift(120)
    tip = (PlaceSensor(name="tip", deviation=0.1),)
    error = ModelError(curvature=1e-4, stiffness=0.0, twist=0.0, zero=0.1, memory=3.0)
    estimator = ShapeEstimator(model=MODEL, sensors=tip, error=error)
    found = fit_model_error(estimator, fitted, ahead=(1,), most=40)
    assert found.error.zero > 0.1
    assert 3.0 < found.error.memory < 40.0
    assert 0.7 < found.widenings[1] < 1.4
    history = follow_record(
        dataclasses.replace(estimator, error=found.error), checked, ahead=(1, 10)
    )
    assert history.converged
    near, far = history.predictions
    alone = [
        np.linalg.norm(reading - one.commanded[-1])
        for reading, one in zip(checked.readings["tip"], history.estimates, strict=True)
    ]
    assert near.rms < 0.8 * math.sqrt(np.mean(np.square(alone)))
    assert near.rms < far.rms
    assert 0.9 < near.measure_coverage() < 0.99
    assert near.measure_coverage(near.find_widening()) == pytest.approx(0.95, abs=0.02)
    assert len(history.list_columns()["tip_x_mm"]) == len(checked)
    assert history.to_dict()["predictions"][0]["ahead"] == 1
    assert history.plot().get_xlabel() == "time [s]"


def write_table(path, rows: int = 3) -> np.ndarray:
    """Write a table of commands and readings of the model alone; return its last tip."""
    shapes = MODEL.shape(np.outer(np.linspace(0.2, 1.0, rows), PULLED))
    names = MODEL.robot.tendon_names
    axes = [f"tip {axis} [mm]" for axis in "xyz"]
    bends = ["curvature at 50 mm x [rad/m]", "curvature at 50 mm y [rad/m]"]
    titles = ["time [s]", *(f"{name} displacement [mm]" for name in names), *axes, *bends]
    lines = [",".join([*titles, f"{names[0]} tension [N]"])]
    for row, tip in enumerate(shapes.world_points[:, -1]):
        step = np.linalg.inv(shapes.frames[row, 2]) @ shapes.frames[row, 3]
        bend = Rotation.from_matrix(step[:3, :3]).as_rotvec()[:2] / 20.0 * 1e3
        numbers = [row, *shapes.displacements[row], *(tip if row != 1 else [math.nan] * 3)]
        cells = [f"{value:.9g}" for value in [*numbers, *bend, shapes.tensions[row, 0]]]
        lines.append(",".join(cells).replace("nan", ""))
    path.write_text("\n".join(lines) + "\n")
    return shapes.world_points[-1, -1]


def test_a_table_is_estimated(tmp_path, capsys):
    tip = write_table(tmp_path / "table.csv")
    robot = MODEL.robot.to_yaml(tmp_path / "robot.yaml")
    out = tmp_path / "out.csv"
    line = (
        f"continuum estimate {robot} {tmp_path / 'table.csv'} --ahead 1 --load --json --out {out}"
    )
    assert main(line.split()) == 0
    told = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(told["last"]["tip_mm"], tip, atol=0.05)
    assert told["last"]["loads"][0]["force_N"] < 0.05
    assert told["predictions"][0]["rms"] < 0.1
    assert len(out.read_text().splitlines()) == 4
    table = read_sensor_table(tmp_path / "table.csv", MODEL.robot)
    assert [type(one).__name__ for one in table.sensors] == [
        "PlaceSensor", "CurvatureSensor", "TensionSensor",
    ]  # fmt: skip
    assert np.isnan(table.record.readings["tip"][1]).all()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("00 displacement", "09 displacement", "is of no tendon"),
        ("tip z [mm]", "other [mm]", "place 'tip' has no column of its axis z"),
        ("time [s]", "time [mm]", "time"),
    ],
)
def test_wrong_columns_are_refused(tmp_path, old, new, words):
    write_table(tmp_path / "table.csv")
    text = (tmp_path / "table.csv").read_text()
    (tmp_path / "table.csv").write_text(text.replace(old, new, 1))
    with pytest.raises(BozziniError, match=words):
        read_sensor_table(tmp_path / "table.csv", MODEL.robot)


def test_a_sensor_is_planned_where_it_leaves_least():
    estimator = ShapeEstimator(model=MODEL)
    places = [20.0 * k for k in range(1, 9)]
    candidates = [PlaceSensor(name=f"{place}", arc_length=place) for place in places]
    plan = plan_sensors(estimator, candidates, commands=PULLED, count=3, aim="shape")
    greedy, exact = ([getattr(one, name) for one in plan.choices] for name in ("greedy", "exact"))
    assert np.all(np.diff(greedy) < 0.0)
    assert np.all(np.array(exact) <= np.array(greedy) + 1e-12)
    assert exact[1] == greedy[1]
    chosen = [one for one in candidates if one.arc_length in plan.best.places]
    after = ShapeEstimator(model=MODEL, sensors=chosen)
    readings = read_sensors(after.estimate(PULLED), chosen)
    spread = after.estimate(PULLED, readings).covariance[1:, 3:, 3:]
    worst = math.sqrt(np.linalg.eigvalsh(spread).max())
    assert plan.best.exact == pytest.approx(worst, rel=0.02)
    there = dataclasses.replace(estimator, sensors=tuple(chosen[:1]))
    others = [one for one in candidates if one is not chosen[0]]
    assert plan_sensors(there, others, commands=PULLED, count=1).choices[0].exact < exact[0]


def test_sensors_are_planned_by_a_command(tmp_path, capsys):
    robot = MODEL.robot.to_yaml(tmp_path / "robot.yaml")
    line = f"continuum sensors {robot} --kind curvature --count 2 --candidates 4 --json"
    assert main(line.split()) == 0
    told = json.loads(capsys.readouterr().out)["choices"]
    assert [one["sensors"] for one in told] == [0, 1, 2]
    assert told[2]["exact"] < told[1]["exact"] < told[0]["exact"]
    assert main(f"continuum sensors {robot} --count 5 --candidates 4".split()) == 2
    assert "it must be at most 4" in capsys.readouterr().err


def test_a_cable_that_is_wrongly_taut_is_turned_over():
    gratings = tuple(
        CurvatureSensor(name=f"g{k}", arc_length=10.0 + 20.0 * k, share=0.01) for k in range(8)
    )
    estimator = ShapeEstimator(model=MODEL, sensors=gratings)
    random, better = np.random.default_rng(5), 0
    for _ in range(6):
        truth = draw_truth(estimator, random)
        read = estimator._take_readings(read_sensors(truth, gratings, random))
        before = estimator.begin()
        start = before.rotation_vectors, before.lengths
        alone = estimator._solve(PULLED, 0.0 * before.mean, start, None)
        short = MODEL.natural_lengths - alone.lengths
        first = estimator._search(PULLED, read, before, short)
        found = estimator._try_cables(PULLED, read, before, short, first)
        assert found.cost <= first.cost
        better += found.cost < first.cost - 5.0
    assert better > 0

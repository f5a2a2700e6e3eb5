"""Estimates row by row: loads that come and go, rows that cannot be, calibration, what goes out."""

from __future__ import annotations

import dataclasses
import io
import math
import sys

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from scipy.spatial.transform import Rotation, Slerp

from bozzini.cli.main import main
from bozzini.continuum import (
    CurvatureSensor,
    ModelError,
    PlaceSensor,
    PointLoad,
    PoseSensor,
    RobotCalibration,
    SensorRecord,
    ShapeEstimator,
    SightSensor,
    StrainSensor,
    UnknownLoad,
    fit_model_error,
    follow_record,
    predict_unread,
    read_sensor_table,
)
from bozzini.duct import RoundCones
from bozzini.duct.shape_files import save_shapes
from bozzini.errors import BozziniError, InputError
from tests.continuum.test_estimation import MODEL, PULLED, SENSORS, write_table

SURE = ModelError(curvature=1e-6, twist=1e-6, stiffness=1e-3, zero=1e-3)
TIP = PlaceSensor(name="tip")


def test_a_force_that_comes_and_goes_is_found_where_it_is():
    gratings = tuple(
        CurvatureSensor(name=f"g{k}", arc_length=10.0 + 20.0 * k, share=0.01) for k in range(8)
    )
    loads = (PointLoad(arc_length=55.0, force=(0.3, 0.2, 0.0), frame="body"),)
    pushed = dataclasses.replace(MODEL, loads=loads)
    free, held = (
        ShapeEstimator(model=model, sensors=gratings, error=SURE).predict(PULLED)
        for model in (MODEL, pushed)
    )
    estimator = ShapeEstimator(model=MODEL, sensors=gratings, error=SURE, loads=(UnknownLoad(),))
    record = SensorRecord(
        times=np.arange(3.0),
        commands=np.tile(PULLED, (3, 1)),
        readings={name: np.array([free[name], held[name], free[name]]) for name in free},
    )
    before, during, after = (one.loads[0] for one in follow_record(estimator, record).estimates)
    assert during.place_low < 55.0 < during.place_high
    assert during.place_high - during.place_low < 10.0
    assert during.force_low < math.hypot(0.3, 0.2) < during.force_high
    for load in (before, after):
        assert load.force_low == 0.0 and load.force < 1e-3
        assert load.place_low <= load.place <= load.place_high
    # Turned as the body is at the place itself, not at the next station.
    whole = ShapeEstimator(model=pushed, error=SURE).estimate(PULLED)
    turns = Rotation.from_matrix(whole.frames[2:4, :3, :3])  # stations at 40 and 60 mm
    there = Slerp([40.0, 60.0], turns)(during.place).apply([0.3, 0.2, 0.0])
    np.testing.assert_allclose(during.vector, there, atol=1e-3)
    lasting = dataclasses.replace(estimator, loads=(UnknownLoad(memory=100.0),))
    state = lasting.estimate(PULLED, held).state
    assert lasting.estimate(PULLED, state=lasting.wait(state, 1.0)).loads[0].force > 0.3


def test_of_a_force_that_nothing_shows_the_interval_is_all_of_it():
    nothing = ShapeEstimator(model=MODEL, loads=(UnknownLoad(arc_length=100.0, force=2.0),))
    load = nothing.estimate(PULLED).loads[0]
    # Of two normal numbers: Rayleigh's distribution.
    assert load.force_low == 0.0
    assert load.force_high == pytest.approx(2.0 * math.sqrt(-2.0 * math.log(0.05)), rel=0.03)


def test_rows_that_cannot_be_are_told():
    estimator = ShapeEstimator(model=MODEL, sensors=(TIP,))
    tip = estimator.predict(PULLED)["tip"]
    near, far = (estimator.estimate(PULLED, {"tip": tip + off}) for off in ((3.0, 3.0, 0.3), 100.0))
    assert near.expected and near.surprise < 2.0
    assert not far.expected and far.surprise > 5.0
    lost = estimator.estimate(1e3 * PULLED, {"tip": tip})
    assert not lost.converged
    assert np.isnan(lost.deviations).all() and np.isnan(lost.tip).all()
    again = estimator.estimate(PULLED, {"tip": tip}, state=estimator.wait(lost.state, 1.0))
    np.testing.assert_allclose(again.tip, tip, atol=0.1)


def test_numbers_that_are_there_count():
    pose, place = PoseSensor(name="a", deviation=0.3), PlaceSensor(name="a", deviation=0.3)
    poses = ShapeEstimator(model=MODEL, sensors=(pose,))
    tip = poses.predict(PULLED)["a"][:3] + (2.0, -1.0, 0.5)
    found = poses.estimate(PULLED, {"a": [*tip, *[math.nan] * 3]})
    alone = ShapeEstimator(model=MODEL, sensors=(place,)).estimate(PULLED, {"a": tip})
    np.testing.assert_allclose(found.points, alone.points, atol=1e-6)
    height = poses.estimate(PULLED, {"a": [math.nan, math.nan, tip[2], *[math.nan] * 3]})
    before = poses.estimate(PULLED)
    assert height.deviations[-1, 2] < 0.5 < before.deviations[-1, 2]
    missed, _ = poses.miss(PULLED, {"a": [math.nan, math.nan, 0.0, *[math.nan] * 3]},
                           state=poses.begin())  # fmt: skip
    assert np.flatnonzero(np.isfinite(missed)).tolist() == [2]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: PoseSensor(name="a", bias=1.0), "such a sensor has none"),
        (lambda: SightSensor(name="a", bias=1.0), "such a sensor has none"),
        (lambda: PlaceSensor(name="a", offset=(1.0, 2.0)), "must be"),
        (lambda: StrainSensor(name="a", offset=(math.nan, 0.0)), "offset"),
        (lambda: ShapeEstimator(model=MODEL).wait(ShapeEstimator(model=MODEL).begin(), -1.0),
         "elapsed is -1 s"),
        (lambda: ShapeEstimator(model=MODEL, error=None), "ModelError"),
        (lambda: ShapeEstimator(model=MODEL).estimate(
            PULLED, state=ShapeEstimator(model=MODEL, error=SURE, loads=(UnknownLoad(),)).begin()),
         "it must be of this estimator"),
        (lambda: ShapeEstimator(model=MODEL, sensors=(TIP,)).estimate(
            PULLED, {"tip": (math.inf, 0.0, 0.0)}), "infinite"),
        (lambda: ShapeEstimator(model=MODEL, sensors=(SightSensor(name="s"),)).estimate(
            PULLED, {"s": np.zeros(6)}), "without a direction"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def make_record(rows: int, seed: int) -> SensorRecord:
    """Return tips of a robot that is worse than its `SURE` model, each by errors of its own."""
    random = np.random.default_rng(seed)
    estimator = ShapeEstimator(model=MODEL, sensors=(TIP, SENSORS[0]), error=ModelError(zero=0.05))
    state = estimator.begin()
    spread, tips, marks = np.sqrt(np.diag(state.covariance)), [], []
    for _ in range(rows):
        mean = spread * random.standard_normal(len(spread))
        read = estimator.predict(PULLED, state=dataclasses.replace(state, mean=mean))
        tips.append(read["tip"] + 0.5 * random.standard_normal(3))
        marks.append(read["marker"] + 0.5 * random.standard_normal(3))
    return SensorRecord(
        times=100.0 * np.arange(rows),
        commands=np.tile(PULLED, (rows, 1)),
        readings={"tip": np.array(tips), "marker": np.array(marks)},
    )


def test_calibration_rows_make_intervals_hold():
    error = ModelError(curvature=1e-4, stiffness=0.01, zero=0.02, memory=1.0)
    estimator = ShapeEstimator(model=MODEL, sensors=(TIP, SENSORS[0]), error=error)
    fitted, checked = (
        predict_unread(estimator, make_record(60, seed), read=("marker",)) for seed in (1, 2)
    )
    assert np.isnan(fitted.misses[:, 3:]).all()  # the marker is read
    widening = fitted.find_widening()
    assert widening > 1.3
    assert checked.measure_coverage() < 0.9
    assert 0.91 < checked.measure_coverage(widening) < 0.99
    ahead = predict_unread(estimator, make_record(5, 1), read=("marker", "tip"))
    assert ahead.ahead == 1 and np.isnan(ahead.misses[0]).all()


def test_a_fit_of_errors_refuses_what_it_cannot_do():
    estimator = ShapeEstimator(model=MODEL, sensors=(TIP, SENSORS[0]))
    record = make_record(3, 1)
    for change, words in (
        ({"free": ("reach",), "ahead": (1,)}, "free is 'reach'"),
        ({"free": ("position",), "ahead": (1,)}, "begin above 0"),
        ({"ahead": ()}, "ahead is empty"),
        ({"ahead": (5,)}, "ahead is 5"),
    ):
        with pytest.raises(InputError, match=words):
            fit_model_error(estimator, record, **change)
    with pytest.raises(InputError, match="no rows"):
        record.select(np.zeros(3, dtype=bool))
    one = SensorRecord(times=[0.0, 1.0], commands=np.zeros((2, 6)), readings={"00": [1.0, 2.0]})
    assert one.readings["00"].shape == (2, 1)


def run(line: str) -> int:
    return main(line.split())


def test_rows_of_stdin_are_answered_as_those_of_a_table(tmp_path, capsys, monkeypatch):
    write_table(tmp_path / "table.csv")
    robot = MODEL.robot.to_yaml(tmp_path / "robot.yaml")
    assert (
        run(f"continuum estimate {robot} {tmp_path / 'table.csv'} --out {tmp_path / 'o.csv'}") == 0
    )
    capsys.readouterr()
    lines = io.StringIO((tmp_path / "table.csv").read_text())
    monkeypatch.setattr(sys, "stdin", lines)
    assert run(f"continuum estimate {robot} -") == 0
    streamed = capsys.readouterr().out.splitlines()
    whole = (tmp_path / "o.csv").read_text().splitlines()
    assert streamed[0] == whole[0] and len(streamed) == len(whole) == 4
    pairs = [
        (row.split(",")[:7] for row in pair) for pair in zip(streamed[1:], whole[1:], strict=True)
    ]
    for one, other in pairs:
        np.testing.assert_allclose(
            np.array(list(one), dtype=float), np.array(list(other), dtype=float), atol=1e-6
        )
    rows = lines.getvalue().splitlines()
    far = ",".join([rows[2].split(",")[0], "1000", *rows[2].split(",")[2:]])
    for wrong, code in ((far, 1), ("0," + rows[2].split(",", 1)[1], 0), ("-1,", 2)):
        monkeypatch.setattr(sys, "stdin", io.StringIO("\n".join([*rows[:2], wrong])))
        assert run(f"continuum estimate {robot} -") == code
    capsys.readouterr()
    assert run(f"continuum estimate {robot} - --json") == 2
    assert "leave --out and --json out" in capsys.readouterr().err


def test_a_log_has_the_tip_with_its_covariance_and_walls_are_kept(tmp_path, capsys):
    write_table(tmp_path / "table.csv")
    robot = MODEL.robot.to_yaml(tmp_path / "robot.yaml")
    base = MODEL.robot.base_frame
    tube = RoundCones(base[:3, 3] + np.outer([-60.0, 260.0], base[:3, 2]), [90.0, 90.0])
    save_shapes(tube, tmp_path / "tube.json")
    out = tmp_path / "out.mcap"
    line = f"continuum estimate {robot} {tmp_path / 'table.csv'} --shapes {tmp_path / 'tube.json'}"
    assert run(f"{line} --calibrate {tmp_path / 'table.csv'} --out {out}") == 0
    told = capsys.readouterr().out
    assert "the wall presses with" in told and "times as wide" in told
    with out.open("rb") as file:
        read = list(make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    tips = [one.decoded_message for one in read if one.channel.topic == "/tip"]
    assert len(tips) == 3
    covariance = np.reshape(tips[-1].pose.covariance, (6, 6))
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)
    place = [getattr(tips[-1].pose.pose.position, axis) for axis in "xyz"]
    assert all(f"{1e3 * value:.2f} ±" in told for value in place)
    rows = (tmp_path / "table.csv").read_text().splitlines()
    far = ",".join(["0", "1000", *rows[1].split(",")[2:]])
    (tmp_path / "far.csv").write_text("\n".join([rows[0], far]))
    assert run(f"continuum estimate {robot} {tmp_path / 'far.csv'} --out {tmp_path}/far.mcap") == 1
    assert "of the last there is no estimate" in capsys.readouterr().out
    with (tmp_path / "far.mcap").open("rb") as file:
        assert not list(make_reader(file).iter_messages())


def test_strains_and_sights_have_columns(tmp_path):
    titles = [*(f"{name} displacement [mm]" for name in MODEL.robot.tendon_names)]
    titles += ["strain at 30 mm beside 0.5 -0.5 mm [%]"]
    titles += [f"tip camera {k} [mm]" for k in "xyz"] + [f"tip ray {k}" for k in "xyz"]
    path = tmp_path / "table.csv"
    path.write_text(",".join(titles) + "\n" + ",".join("0000001203001") + "\n")
    table = read_sensor_table(path, MODEL.robot)
    assert [type(one).__name__ for one in table.sensors] == ["StrainSensor", "SightSensor"]
    assert table.sensors[0].offset == (0.5, -0.5)
    assert table.record.readings["strain at 30 mm beside 0.5 -0.5 mm"][0, 0] == 0.01
    np.testing.assert_array_equal(table.record.readings["tip ray"][0], [2, 0, 3, 0, 0, 1])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("curvature at 50 mm x", "curvature at 1.2.3 mm x", "is not understood"),
        ("curvature at 50 mm x", "Curvature at 50mm x", "is not understood"),
        ("00 tension [N]", "tip ray x", "has not all columns"),
    ],
)
def test_columns_that_are_meant_as_readings_are_not_left_out(tmp_path, old, new, words):
    write_table(tmp_path / "table.csv")
    text = (tmp_path / "table.csv").read_text()
    (tmp_path / "table.csv").write_text(text.replace(old, new, 1))
    with pytest.raises(BozziniError, match=words):
        read_sensor_table(tmp_path / "table.csv", MODEL.robot)


def test_a_command_tells_what_it_leaves_out(tmp_path, capsys):
    robot = MODEL.robot.to_yaml(tmp_path / "robot.yaml")
    write_table(tmp_path / "table.csv", rows=2)
    text = (tmp_path / "table.csv").read_text().replace("tip", "Tip")
    (tmp_path / "other.csv").write_text(text)
    assert run(f"continuum estimate {robot} {tmp_path / 'other.csv'}") == 0
    assert "not read: 'Tip x [mm]'" in capsys.readouterr().out
    table = tmp_path / "table.csv"
    for options, words in (
        ("--load-place 50mm", "load-place is given without load"),
        ("--ahead 2", "ahead is 2: it must be below 2"),
        ("--place 0mm", "place is 0 mm: it must lie in [0.0001"),
        ("--wall-stiffness 1MPa", "without shapes"),
    ):
        assert run(f"continuum estimate {robot} {table} {options}") == 2
        assert words in capsys.readouterr().err


def test_sensors_are_planned_under_commands_as_calibrated(tmp_path, capsys):
    known = RobotCalibration(command="displacement", scale=0.5)
    halved = dataclasses.replace(MODEL.robot, calibration=known)
    found = []
    for name, robot, factor in (("plain", MODEL.robot, 0.5), ("halved", halved, 1.0)):
        path = robot.to_yaml(tmp_path / f"{name}.yaml")
        titles = ["time [s]", *(f"{one} displacement [mm]" for one in robot.tendon_names)]
        rows = ["0,0,0,0,0,0,0", ",".join(f"{x:.6g}" for x in [1.0, *factor * 2.0 * PULLED])]
        (tmp_path / "t.csv").write_text("\n".join([",".join(titles), *rows]) + "\n")
        line = f"continuum sensors {path} --commands {tmp_path / 't.csv'} --count 1 --candidates 2"
        assert run(line) == 0
        found.append(capsys.readouterr().out)
    assert found[0] == found[1]


def test_two_forces_are_found_where_they_are():
    gratings = tuple(
        CurvatureSensor(name=f"g{k}", arc_length=10.0 + 20.0 * k, share=0.01) for k in range(8)
    )
    forces = ((50.0, 0.4), (130.0, -0.3))
    loads = tuple(
        PointLoad(arc_length=place, force=(force, 0.1, 0.0), frame="body")
        for place, force in forces
    )
    pushed = dataclasses.replace(MODEL, loads=loads)
    read = ShapeEstimator(model=pushed, sensors=gratings, error=SURE).predict(PULLED)
    both = ShapeEstimator(model=MODEL, sensors=gratings, error=SURE, loads=(UnknownLoad(),) * 2)
    found = sorted(both.estimate(PULLED, read).loads, key=lambda one: one.place)
    for load, (place, force) in zip(found, forces, strict=True):
        assert load.place_low < place < load.place_high
        assert load.force_low < math.hypot(force, 0.1) < load.force_high

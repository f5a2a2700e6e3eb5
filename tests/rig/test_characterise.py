"""The experiment on a muscle: its table, what it flags, pictures, interruptions."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from functools import partial

import numpy as np
import pandas as pd
import pytest

from bozzini.cli.main import main
from bozzini.errors import InputError, OutputError
from bozzini.muscle import EnergyMuscle, calibrate, preset, read_measurements
from bozzini.muscle.hysteresis import PrandtlIshlinskii
from bozzini.rig import (
    Chamber,
    Cosimulation,
    Fault,
    Host,
    LockstepLink,
    NativeBoard,
    Plant,
    SerialLink,
    emulated_port,
)
from bozzini.rig.characterise import PictureHook, PlantGauge, characterise_muscle
from bozzini.rig.hysteresis import HystereticPlant
from bozzini.rig.protocol import State
from bozzini.rig.stairs import Stairs

LOAD = 0.05
MUSCLE = preset("fitted-45")
SHORT = Stairs(highest=0.3, steps=1, repeats=1, hold=0.4)
COPY = f"{sys.executable} -S -c 'import sys; open(sys.argv[1], \"w\").write(sys.argv[2])'"


@pytest.fixture(scope="module")
def chamber():
    return Chamber.from_model(EnergyMuscle(MUSCLE), LOAD)


@pytest.fixture
def host(toolchain, chamber):
    """Give a connected host of the plant, in lock-step, 2 ms a step."""
    with NativeBoard() as board:
        rig = Cosimulation(board, Plant(chamber, seed=3), period=2e-3)
        host = Host(LockstepLink(rig))
        host.connect()
        yield host


def plant_of(host):
    return host.link.rig.plant


def test_the_table_of_the_plant_gives_back_the_constants_of_its_muscle(host, tmp_path):
    stairs = Stairs(highest=0.8, steps=3, repeats=2, hold=0.8, specimen="A")
    found = characterise_muscle(host, stairs, gauge=PlantGauge(plant_of(host), seed=1))
    assert found.converged, found.reason
    assert len(found.rows) == 2 * 7
    for name in ("table.csv", "table.parquet"):
        data = read_measurements(found.save(tmp_path / name))
        assert data.has_both_directions and set(data.specimen) == {"A"}
        for column in ("pressure", "contraction", "load", "direction"):
            expected = getattr(found.to_measurements(), column)
            np.testing.assert_array_equal(getattr(data, column), expected)
    start = MUSCLE.replace(modulus=0.4, dead_length=9.0)
    fit = calibrate(EnergyMuscle, start, data=data, free=("modulus", "dead_length"))
    assert fit.converged
    for name, (low, high) in fit.intervals.items():
        assert low <= getattr(MUSCLE, name) <= high, name
    assert fit.sigma == pytest.approx(0.05, rel=0.5)


def test_the_loop_of_a_muscle_with_hysteresis_is_in_the_table(host, chamber):
    """A play follows the furthest pressure of a branch, at half its width behind."""
    half_width = 0.05
    host.link.rig.plant = HystereticPlant(chamber, PrandtlIshlinskii((half_width,), (1.0,)), seed=3)
    stairs = Stairs(highest=0.6, steps=2, repeats=1, hold=0.6)
    found = characterise_muscle(host, stairs, gauge=PlantGauge(plant_of(host), deviation=0.0))
    model = EnergyMuscle(MUSCLE)
    for row in found.rows:
        assert row.overshoot < 0.03
        sign = 1.0 if row.direction == "inflating" else -1.0
        furthest = row.setpoint + sign * row.overshoot
        if furthest - sign * half_width > 0.0:
            expected = model.contraction(furthest - sign * half_width, LOAD)
            assert row.contraction == pytest.approx(float(expected), abs=0.15), row


def test_a_step_that_does_not_settle_is_flagged_and_kept(host):
    plant_of(host).set_faults(Fault("leak", 0, 0.01))
    found = characterise_muscle(host, SHORT, gauge=PlantGauge(plant_of(host)))
    assert len(found.rows) == 3
    assert not found.converged and found.flagged == 1
    assert "not settled: mean off by -" in found.rows[1].flags[0]
    assert "1 of 3 steps" in found.reason and found.residual > SHORT.tolerance
    assert found.to_frame()["flags"].str.contains("not settled").sum() == 1


def test_a_board_that_leaves_its_armed_state_ends_it_with_what_was_measured(host):
    gauge = PlantGauge(plant_of(host))

    def read():
        if plant_of(host).pressures[0] > 0.2:
            plant_of(host).set_faults(Fault("sensor open", 0))
        return gauge()

    found = characterise_muscle(host, SHORT, gauge=read)
    assert [row.direction for row in found.rows] == ["inflating", "inflating"]
    assert "left ARMED" in found.reason and "sensor" in found.reason


def test_an_interruption_vents_and_keeps_what_was_measured(host, tmp_path):
    def progress(stage, share):
        if share > 0.6:
            raise KeyboardInterrupt

    path = tmp_path / "table.csv"
    with pytest.raises(KeyboardInterrupt):
        characterise_muscle(
            host,
            SHORT,
            gauge=PlantGauge(plant_of(host)),
            keep=lambda found: found.save(path),
            progress=progress,
        )
    assert host.telemetry.state is State.DISARMED
    host.link.wait(host.link.now + 0.3)
    assert plant_of(host).pressures.max() < 0.02
    assert len(read_measurements(path)) == 1


class RunningLink(LockstepLink):
    """A link whose clock counts as one that runs by itself, so that a host must keep up with it."""

    real_time = True


@pytest.mark.parametrize("link_kind", [LockstepLink, RunningLink])
def test_pictures_are_listed_as_the_measurement_of_lengths_takes_them(host, tmp_path, link_kind):
    host.link = link_kind(host.link.rig)
    hook = PictureHook(
        command=f"{COPY} {{file}} '{{pressure}} {{direction}} {{repeat}}'",
        folder=tmp_path / "with blanks",
    )
    found = characterise_muscle(host, SHORT, camera=hook)
    assert found.converged, found.reason
    assert not found.has_contraction and "contraction [mm]" not in found.to_frame()
    listed = pd.read_csv(found.save_pictures(tmp_path / "manifest.csv"))
    assert list(listed.direction) == ["inflate", "inflate", "deflate"]
    written = [(tmp_path / name).read_text(encoding="utf-8") for name in listed.image]
    assert written == ["0 inflating 1", "0.3 inflating 1", "0 deflating 1"]
    np.testing.assert_allclose(listed.pressure_kpa, [0.0, 300.0, 0.0], atol=7.0)
    assert list(listed.setpoint_kpa) == [0.0, 300.0, 0.0]  # one state of two directions
    with pytest.raises(InputError, match="no contraction"):
        found.to_measurements()
    with pytest.raises(OutputError, match="not empty"):
        characterise_muscle(host, SHORT, camera=hook)


@pytest.mark.slow  # pictures are rendered and measured
def test_pictures_of_a_hook_become_lengths_and_measurements(host, tmp_path):
    pytest.importorskip("cv2", reason="the extra 'vision' is not installed")
    from bozzini import vision
    from bozzini.vision.pictures import read_manifest

    board = vision.StripBoard()
    camera = vision.LengthSetup(pitch=0.1, columns=860, rows=700).make_camera(board)
    free, inflated = EnergyMuscle(MUSCLE).contraction(np.array([0.0, 0.3]), LOAD)
    for name, contraction in {"0": free, "0.3": inflated}.items():
        muscle = vision.HungMuscle(length=MUSCLE.length - float(contraction))
        scene = muscle.make_scene(board)
        vision.write_picture(vision.render_picture(scene, camera), tmp_path / f"{name}.png")
    hook = PictureHook(command=f"cp '{tmp_path}/{{pressure}}.png' {{file}}", folder=tmp_path / "p")
    stairs = Stairs(highest=0.3, steps=1, repeats=2, hold=0.4, load=LOAD)
    table = characterise_muscle(host, stairs, camera=hook)
    assert table.converged, table.reason
    path = table.save_pictures(tmp_path / "p" / "manifest.csv")
    series = vision.measure_series(
        read_manifest(path, ("image", "pressure_kpa")),
        board,
        options=vision.LengthOptions(height=2.8, diameter=1.6, ring=2.0),
        camera=camera,
    )
    assert series.converged, series.reason
    states = {(row["direction"], row["pressure_kpa"]): row for row in series.summarise()}
    state = states["inflating", 300.0]
    assert state["n"] == 2
    assert state["contraction_mm"] == pytest.approx(inflated - free, abs=0.02)
    vision.write_series(series, tmp_path / "out")
    read = read_measurements(tmp_path / "out" / "contractions.csv")
    measured = [row.pressure for row in table.rows if row.setpoint > 0.0]
    assert read.pressure[read.pressure > 0.1] == pytest.approx(measured)


@pytest.mark.parametrize(
    ("words", "flag"),
    [
        ("import sys; sys.exit(3)", "exit status 3"),
        ("pass", "no picture"),
        ("import time; time.sleep(9)", "not done within 0.1 s"),
    ],
)
def test_a_hook_that_fails_flags_the_step(host, tmp_path, words, flag):
    hook = PictureHook(
        command=f"{sys.executable} -S -c '{words}' {{file}}", folder=tmp_path / "p", timeout=0.1
    )
    found = characterise_muscle(host, SHORT, camera=hook, gauge=PlantGauge(plant_of(host)))
    assert len(found.rows) == found.flagged == 3
    assert all(flag in "; ".join(row.flags) for row in found.rows)
    assert np.isfinite(found.to_measurements().contraction).all()


def test_what_a_hook_has_started_ends_with_it(host, tmp_path):
    alive = tmp_path / "alive"
    words = f"sh -c '(sleep 0.4; touch {alive}) & wait' {{file}}"
    hook = PictureHook(command=words, folder=tmp_path / "p", timeout=0.1)
    characterise_muscle(host, SHORT, camera=hook)
    time.sleep(0.4)
    assert not alive.exists()


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("camera", "must have {file}"),
        ("camera {file}", "there is no program 'camera'"),
        ("camera {file} {presure}", "but not {presure}"),
        ("camera '{file}", "no closing quotation"),
    ],
)
def test_a_hook_that_cannot_work_is_refused_at_once(tmp_path, command, words):
    with pytest.raises(InputError, match=words):
        PictureHook(command=command, folder=tmp_path)


def test_illegal_stairs_are_refused(host):
    for wrong in ({"highest": 0.9}, {"steps": 0}, {"muscle": 4}, {"specimen": "a\nb"}):
        with pytest.raises(InputError):
            Stairs(**wrong)
    with pytest.raises(InputError, match="neither"):
        characterise_muscle(host)
    assert host.telemetry.state is State.DISARMED


def test_the_plot_shows_both_directions(host):
    found = characterise_muscle(host, SHORT, gauge=partial(float, 1.0))
    labels = [text.get_text() for text in found.plot().get_legend().get_texts()]
    assert labels == ["inflating", "deflating"]


STAIRS = ("--highest", "0.3MPa", "--steps", "1", "--repeats", "1", "--hold", "0.4s")


@pytest.fixture
def run(capsys, tmp_path, monkeypatch, toolchain):
    """Give the command, run in an empty directory: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        code = main(["rig", "characterise", *arguments])
        return code, *capsys.readouterr()

    return call


def test_the_command_writes_table_pictures_and_curve(run, tmp_path):
    code, out, _ = run(
        *STAIRS, "--board", "native", "--preset", "fitted-45", "--channel", "2", "--json",
        "--hook", f"{COPY} {{file}} x", "--out", "t.csv", "--plot", "t.png", "--quiet",
    )  # fmt: skip
    assert code == 0, out
    answer = json.loads(out)
    assert answer["converged"] and answer["rows"] == 3 and answer["file"] == "t.csv"
    data = read_measurements(tmp_path / "t.csv")
    np.testing.assert_allclose(data.pressure, answer["columns"]["pressure [MPa]"], atol=1e-12)
    model = EnergyMuscle(MUSCLE)
    expected = [model.contraction(pressure, LOAD) for pressure in data.pressure]
    np.testing.assert_allclose(data.contraction, expected, atol=0.2)
    assert (tmp_path / "t.png").stat().st_size
    listed = pd.read_csv(tmp_path / "t-pictures/manifest.csv")
    assert all((tmp_path / "t-pictures" / name).is_file() for name in listed.image)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--highest", "900kPa"), "highest is 0.9 MPa: it must lie in (0, 0.827] MPa"),
        (("--port", "nowhere"), "--port needs --hook"),
        (
            ("--port", "nowhere", "--hook", "true {file}", "--preset", "thesis-40"),
            "MUSCLE has no",
        ),
        (("--port", "nowhere", "--hook", "true {file}"), "port is 'nowhere'"),
        (("--hook", "true {file} {x}"), "but not {x}"),
    ],
)
def test_wrong_input_is_one_line(run, tmp_path, arguments, words):
    code, _, err = run(*arguments, "--out", "t.csv")
    assert code == 2 and words in err and err.count("\n") == 1, err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_terminated_command_keeps_what_was_measured_over_a_port(toolchain, tmp_path):
    with emulated_port("--board", "native") as port:
        hook = f"{COPY} {{file}} x"
        command = [sys.executable, "-m", "bozzini", "rig", "characterise", "--port", port]
        command += ["--hook", hook, "--hold", "0.5s", "--out", str(tmp_path / "t.csv")]
        with subprocess.Popen(command, stderr=subprocess.PIPE) as process:
            end = time.monotonic() + 60.0
            while not list(tmp_path.glob("t-pictures/0002-*")) and time.monotonic() < end:
                time.sleep(0.05)
            process.terminate()
            assert b"interrupted" in process.communicate()[1]
        host = Host(SerialLink(port))
        host.connect()
        assert host.telemetry.state is State.DISARMED
        host.link.close()
    assert 1 <= len(pd.read_csv(tmp_path / "t.csv")) <= 3

"""A characterisation by a camera: from the plant's true muscle to its constants again."""

from __future__ import annotations

import dataclasses
import json
import math
from datetime import UTC, datetime

import numpy as np
import pandas as pd
import pytest

from bozzini.cli.main import main
from bozzini.cli.rig_camera import CameraRequest
from bozzini.errors import InputError
from bozzini.muscle import EnergyMuscle, preset, read_muscle
from bozzini.rig.camera_bench import BenchReport, VideoCamera
from bozzini.rig.characterise import Characterisation, StairStep
from bozzini.rig.stairs import Stairs
from bozzini.vision import LengthOptions, LengthSetup, MuscleLength, RenderedSetup, StripBoard
from bozzini.vision.pictures import read_manifest
from bozzini.vision.series import LengthSeries, read_series

KNOWN = LengthOptions(height=2.8, diameter=1.5, ring=2.0)
SMALL = LengthSetup(pitch=0.1, columns=860, rows=700)


@pytest.mark.slow  # pictures are rendered and measured
def test_the_constants_of_the_true_muscle_come_back_from_its_pictures(toolchain, tmp_path, capsys):
    pytest.importorskip("cv2", reason="the extra 'vision' is not installed")
    true = preset("effector-45", modulus=0.46, braid_angle=math.radians(34.0))
    command = ["rig", "characterise", "--camera", "rendered", "--weights", "0.15N,0.05N"]
    command += ["--repeats", "2", "--steps", "3", "--hold", "1s", "--board", "native", "--json"]
    command += ["--modulus", "0.46MPa", "--braid-angle", "34deg", "--seed", "4", "--quiet"]
    assert main([*command, "--out", str(tmp_path / "m.csv")]) == 0
    answer = json.loads(capsys.readouterr().out)
    fitted = read_muscle(tmp_path / "m-fit.yaml").muscle
    assert fitted.modulus == pytest.approx(true.modulus, rel=0.03)
    assert fitted.braid.strand_length == pytest.approx(true.braid.strand_length, rel=0.03)
    low, high = answer["intervals_95"]["braid_angle"]
    assert low < true.braid_angle < high
    # The stiffness of the true muscle between the weights, by another way.
    model, weights = EnergyMuscle(true), np.array([0.05, 0.15])
    for item in answer["stiffness"]:
        lengths = -model.contraction(item["pressure"], weights)
        wanted = 0.1 / np.diff(lengths)[0]
        assert item["stiffness"] == pytest.approx(
            wanted, abs=4 * item["uncertainty"] + 0.02 * wanted
        )
    table = pd.read_csv(tmp_path / "m.csv")
    assert sorted(set(table["load [N]"])) == [0.05, 0.15] and table["flags"].isna().all()
    assert (table["length [mm]"] + table["contraction [mm]"]).std() < 1e-9
    page = (tmp_path / "m.html").read_text(encoding="utf-8")
    assert page.count("<figure>") == 3 and "Fitted" in page


def _make_report(lengths: dict[float, list[float]]) -> BenchReport:
    """Return a report of one set-point, with lengths by the weight."""
    runs, rows, found = [], ["image,pressure_kpa,setpoint_kpa,direction,load_n"], []
    for load, values in lengths.items():
        step = StairStep(
            repeat=1, direction="inflating", setpoint=0.3, pressure=0.3, deviation=0.0,
            overshoot=0.0, contraction=None, time=0.0, image="x.png",
        )  # fmt: skip
        stairs = Stairs(load=load)
        runs.append(
            Characterisation(stairs=stairs, rows=(step,) * len(values), start=datetime.now(UTC))
        )
        rows += [f"x.png,300,300,inflate,{load}"] * len(values)
        found += [
            MuscleLength(
                length=value, budget={"ring_1": 0.004, "map": 0.0, "height": 1e-3 * value},
                marks=np.zeros((2, 2)), edges=np.zeros((4, 2)), rings=(2.0, 2.0), contrast=50.0,
                plane_miss=0.05, corners=52, distance=300.0, pitch=0.06, mode="pose",
            )
            for value in values
        ]  # fmt: skip
    return BenchReport(runs=tuple(runs), lengths=(rows, found), fit=None)  # type: ignore[arg-type]


def test_the_stiffness_is_the_slope_of_the_weights(tmp_path):
    draw = np.random.default_rng(2)
    slopes, claimed = [], []
    for _ in range(200):
        lengths = {
            load: list(40.0 + load / 0.8 + draw.normal(0.0, 0.005, 5)) for load in (0.05, 0.1, 0.2)
        }
        report = _make_report(lengths)
        text, found = report.lengths  # type: ignore[misc]
        path = tmp_path / "m.csv"
        path.write_text("\n".join(text) + "\n")
        manifest = read_manifest(path, ("image", "pressure_kpa"))
        series = LengthSeries(
            rows=read_series(manifest), found=tuple(found), reasons=("",) * len(found),
            manifest=manifest, options=KNOWN,
        )  # fmt: skip
        (item,) = BenchReport(runs=report.runs, lengths=series, fit=None).find_stiffness()
        slopes.append(item.stiffness)
        claimed.append(item.uncertainty)
    assert np.mean(slopes) == pytest.approx(0.8, rel=0.01)
    assert np.mean(claimed) == pytest.approx(np.std(slopes), rel=0.2)


def test_a_film_is_a_camera(tmp_path):
    cv2 = pytest.importorskip("cv2", reason="the extra 'vision' is not installed")
    setup = RenderedSetup.draw(SMALL, StripBoard(), options=KNOWN, random=np.random.default_rng(0))
    frames = [setup.render(length, seed=0).bytes for length in (40.0, 36.0)]
    film = cv2.VideoWriter(
        str(tmp_path / "film.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 5.0, setup.camera.size
    )
    for frame in frames:
        film.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    film.release()
    with VideoCamera(folder=tmp_path, name=str(tmp_path / "film.avi")) as camera:
        for index, frame in enumerate(frames):
            assert camera.take(tmp_path / f"{index}.png", {}, idle=lambda: None) == []
            seen = cv2.imread(str(tmp_path / f"{index}.png"), cv2.IMREAD_GRAYSCALE)
            assert np.abs(seen.astype(float) - frame).mean() < 4.0  # what the film's JPEG leaves
        assert camera.take(tmp_path / "2.png", {}, idle=lambda: None) == ["camera: no picture came"]
    with pytest.raises(InputError, match="cannot open it"):
        VideoCamera(folder=tmp_path, name=str(tmp_path / "none.avi"))


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("--weights 0.1N", "--weights has no effect without --camera"),
        ("--height 3mm", "--height has no effect without --camera"),
        ("--camera rendered --hook x{file}", "--hook and --camera both take the pictures"),
        ("--camera rendered --port /dev/x", "leave out --port"),
        ("--camera 0", "a real camera needs --strips and --cameras"),
        (
            "--camera rendered --weights 0.1N,0.1N",
            "weights are 0.1 N, 0.1 N: give one or more, each once",
        ),
        ("--camera rendered --weights 1mm", "1mm"),
        ("--camera rendered --plot x.png", "--figure has no effect"),
        ("--camera rendered --free modulus,colour", "colour"),
        ("--camera rendered --weights 0.05N --steps 1 --repeats 1", "too few"),
        ("--play 2MPa", "play is 2"),
    ],
)
def test_wrong_use_is_one_line(toolchain, tmp_path, capsys, words, told):
    out = tmp_path / "m.csv"
    command = ["rig", "characterise", "--board", "native", "--quiet", "--out", str(out)]
    assert main([*command, *words.split()]) == 2
    said = capsys.readouterr().err.strip()
    assert told in said and "\n" not in said
    assert list(tmp_path.iterdir()) == []


def test_the_emulated_muscle_holds_two_weights_by_default():
    asked = dict.fromkeys(item.name for item in dataclasses.fields(CameraRequest))
    sizes = {"height": 2.8, "ring": 2.0}
    rendered, real = (
        CameraRequest(**{**asked, **sizes, "camera": name}) for name in ("rendered", "0")
    )
    assert rendered.list_weights(Stairs(load=0.05)) == pytest.approx((0.05, 0.15))
    assert real.list_weights(Stairs(load=0.05)) == (0.05,)


@pytest.mark.parametrize("name", ["m.html", "m-fit.yaml", "m-lengths"])
def test_what_is_there_is_not_replaced(toolchain, tmp_path, capsys, name):
    (tmp_path / name).write_text("kept")
    command = ["rig", "characterise", "--board", "native", "--quiet", "--camera", "rendered"]
    assert main([*command, "--out", str(tmp_path / "m.csv")]) == 2
    assert name in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_play_of_the_emulated_muscle_is_its_hysteresis(toolchain, tmp_path):
    out = tmp_path / "m.csv"
    command = ["rig", "characterise", "--board", "native", "--quiet", "--play", "20kPa"]
    command += ["--steps", "2", "--repeats", "1", "--reading-error", "0mm", "--hold", "1s"]
    assert main([*command, "--preset", "fitted-45", "--out", str(out)]) == 0
    table = pd.read_csv(out)
    table = table[table["setpoint [MPa]"] == 0.4]
    model = EnergyMuscle(preset("fitted-45"))
    shifted = table["pressure [MPa]"] + np.where(table["direction"] == "inflating", -0.02, 0.02)
    wanted = model.contraction(shifted.to_numpy(), 0.05)
    # Inflating, the pressure went beyond the step by the overshoot, which the play remembers.
    assert table["contraction [mm]"].to_numpy() == pytest.approx(wanted, abs=0.2)
    assert table["contraction [mm]"].diff().iloc[-1] == pytest.approx(np.diff(wanted)[0], abs=0.3)

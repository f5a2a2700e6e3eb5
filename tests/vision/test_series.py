from __future__ import annotations

import csv
import dataclasses
import json
import math

import numpy as np
import pytest
from PIL import Image

from bozzini.cli.main import main
from bozzini.errors import FileFormatError, InputError
from bozzini.muscle import EnergyMuscle, calibrate, preset, read_measurements
from bozzini.vision import (
    DemoOptions,
    HungMuscle,
    LengthOptions,
    LengthSetup,
    MuscleLength,
    Sensor,
    StripBoard,
    load_board,
    load_cameras,
    measure_length,
    measure_series,
    render_picture,
    write_demo,
    write_picture,
    write_series,
)
from bozzini.vision.pictures import read_manifest
from bozzini.vision.planning import DEMO_LENGTH
from bozzini.vision.series import LengthSeries, read_series

OPTIONS = LengthOptions(height=2.8, diameter=1.6, ring=2.0)
READ, COMMON = 0.004, 1e-3


def _make_length(length: float) -> MuscleLength:
    return MuscleLength(
        length=length,
        budget={"ring_1": READ, "ring_2": 0.0, "map": 0.0, "height": COMMON * length},
        marks=np.zeros((2, 2)),
        edges=np.zeros((4, 2)),
        rings=(2.0, 2.0),
        contrast=50.0,
        plane_miss=0.05,
        corners=52,
        distance=300.0,
        pitch=0.06,
        mode="pose",
    )


def _make_series(tmp_path, states, setpoints=None) -> LengthSeries:
    """Return a series of (pressure, direction, length); a length of None failed."""
    asked = setpoints or [""] * len(states)
    lines = ["image,specimen,pressure_kpa,direction,repeat,setpoint_kpa"]
    lines += [f"{k}.png,m,{p},{word},{k},{asked[k]}" for k, (p, word, _) in enumerate(states)]
    path = tmp_path / "m.csv"
    path.write_text("\n".join(lines) + "\n")
    manifest = read_manifest(path, ("image", "pressure_kpa"))
    found = tuple(None if length is None else _make_length(length) for *_, length in states)
    return LengthSeries(
        rows=read_series(manifest),
        found=found,
        reasons=tuple("" if item else "no muscle" for item in found),
        manifest=manifest,
        options=OPTIONS,
    )


def _repeat(pressure, word, mean, spread=0.02, count=5):
    return [(pressure, word, mean + spread * off) for off in np.linspace(-1.0, 1.0, count)]


def test_what_a_set_up_shares_cancels_in_a_contraction(tmp_path):
    series = _make_series(tmp_path, [*_repeat(0, "inflate", 40.0), *_repeat(200, "inflate", 34.0)])
    free, short = series.summarise()
    assert free["u_B_mm"] == pytest.approx(COMMON * 40.0)
    assert short["contraction_mm"] == pytest.approx(6.0)
    rest = math.hypot(free["u_A_mm"], short["u_A_mm"], COMMON * 6.0)
    assert short["u_contraction_mm"] == pytest.approx(rest)
    assert short["u_contraction_mm"] < 0.4 * math.hypot(free["u_mm"], short["u_mm"])
    # The same pictures with a set-up twice as uncertain: only the shared part grows.
    assert free["contraction_mm"] == 0.0


def test_repeats_give_the_interval_of_student(tmp_path):
    from scipy.stats import t

    lengths = [40.0, 40.03, 39.98, 40.01, 40.04]
    series = _make_series(tmp_path, [(0, "none", length) for length in lengths])
    (group,) = series.summarise()
    spread = np.std(lengths, ddof=1)
    assert group["s_mm"] == pytest.approx(spread)
    assert group["u_A_mm"] == pytest.approx(spread / math.sqrt(5))
    freedom = group["u_mm"] ** 4 / (group["u_A_mm"] ** 4 / 4)
    assert group["nu_eff"] == pytest.approx(freedom)
    assert group["U95_mm"] == pytest.approx(t.ppf(0.975, freedom) * group["u_mm"])
    assert group["flags"] == ""


def test_repeats_that_agree_too_well_do_not_claim_less_than_a_picture_can_be_read(tmp_path):
    (group,) = _make_series(tmp_path, [(0, "none", 40.0)] * 4).summarise()
    assert group["s_mm"] == 0.0
    assert group["u_A_mm"] == pytest.approx(READ / 2.0)
    assert group["flags"] == "few_repeats"
    (single,) = _make_series(tmp_path, [(0, "none", 40.0)]).summarise()
    assert single["s_mm"] is None
    assert single["u_A_mm"] == pytest.approx(READ)


def test_inflation_and_deflation_are_not_pooled_and_differ_by_the_hysteresis(tmp_path):
    states = [*_repeat(0, "inflate", 40.0), *_repeat(200, "inflate", 36.0)]
    states += [*_repeat(200, "deflate", 35.4), *_repeat(100, "deflate", 38.0)]
    groups = _make_series(tmp_path, states).summarise()
    assert [group["n"] for group in groups] == [5, 5, 5, 5]
    up, down, alone = groups[1:]
    assert down["hysteresis_mm"] == pytest.approx(0.6)
    rest = math.hypot(up["u_A_mm"], down["u_A_mm"], COMMON * 0.6)
    assert down["u_hysteresis_mm"] == pytest.approx(rest)
    assert up["hysteresis_mm"] is None
    assert alone["hysteresis_mm"] is None


def test_repeats_of_a_set_point_belong_together_whatever_was_measured(tmp_path):
    states = [(0.2, "inflate", 40.0), (199.0, "inflate", 36.1), (0.0, "inflate", 40.2)]
    states += [(202.0, "inflate", 35.9)]
    series = _make_series(tmp_path, states, ["0", "200", "0", "200"])
    free, short = series.summarise()
    assert (free["n"], short["n"], short["pressure_kpa"]) == (2, 2, 200.0)
    assert short["contraction_mm"] == pytest.approx(4.1)
    columns = series.list_contractions()
    assert columns["pressure [kPa]"] == [199.0, 202.0]  # a model is fitted to what was measured
    assert columns["contraction [mm]"] == pytest.approx([4.0, 4.2])


@pytest.mark.slow
def test_every_fault_of_a_picture_is_its_row(tmp_path):
    board, setup = StripBoard(), LengthSetup(pitch=0.1, columns=860, rows=700)
    camera, muscle = setup.make_camera(board), HungMuscle(length=37.0)
    taken = Sensor(jpeg=0, bits=16)
    deep = render_picture(muscle.make_scene(board), camera, sensor=taken)
    write_picture(deep, tmp_path / "deep.png")
    plain = dataclasses.replace(deep, bits=8)
    whole = write_picture(plain, tmp_path / "grey.png").read_bytes()
    Image.fromarray(plain.bytes).convert("RGB").save(tmp_path / "colour.png")
    note = Image.Exif()
    note[274] = 6
    Image.fromarray(plain.bytes).save(tmp_path / "turned.jpg", exif=note, quality=95)
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.png").write_text("this is no picture")
    for name, values in {
        "blank.png": np.full_like(plain.values, 0.6),
        "mirrored.png": plain.values[:, ::-1],
        "small.png": plain.values[:600],
    }.items():
        write_picture(dataclasses.replace(plain, values=values), tmp_path / name)
    hidden, ring = plain.values.copy(), measure_length(plain, board, options=OPTIONS, camera=camera)
    x, y = np.round(ring.edges[0]).astype(int)
    hidden[y - 20 : y + 20, x - 10 : x + 2] = np.median(hidden[y - 5 : y + 5, x - 9 : x - 4])
    write_picture(dataclasses.replace(plain, values=hidden), tmp_path / "hidden.png")
    expected = {
        "deep.png": ("ok", "", ""),
        "hidden.png": ("flagged", "ring_changed", ""),
        "grey.png": ("ok", "", ""),
        "colour.png": ("ok", "colour", ""),
        "turned.jpg": ("flagged", "exif_rotated", ""),
        "cut.png": ("failed", "", "cannot be read"),
        "text.png": ("failed", "", "not a picture"),
        "none.png": ("failed", "", "no such picture"),
        "blank.png": ("failed", "", "no marker of the board"),
        "mirrored.png": ("failed", "", "mirrored"),
        "small.png": ("failed", "", "calibrated with 860 x 700"),
    }
    lines = ["image,pressure_kpa", *(f"{name},0" for name in expected)]
    (tmp_path / "m.csv").write_text("\n".join(lines) + "\n")
    manifest = read_manifest(tmp_path / "m.csv", ("image", "pressure_kpa"))
    series = measure_series(manifest, board, options=OPTIONS, camera=camera)
    columns = series.list_columns()
    rows = zip(*(columns[name] for name in ("image", "status", "flags", "reason")), strict=True)
    for name, status, flags, reason in rows:
        assert (status, flags) == expected[name][:2], name
        assert expected[name][2] in reason
        assert "\n" not in reason
    for item in series.found:
        if item and "ring_changed" not in item.flags:
            assert item.length == pytest.approx(37.0, abs=0.02)


def test_a_failed_picture_is_a_row_with_its_reason(tmp_path):
    series = _make_series(tmp_path, [(0, "none", 40.0), (100, "none", None), (100, "none", 38.0)])
    columns = series.list_columns()
    assert columns["status"] == ["ok", "failed", "ok"]
    assert columns["length_mm"] == [40.0, None, 38.0]
    assert columns["reason"][1] == "no muscle"
    assert columns["repeat"] == ["0", "1", "2"]
    assert not series.converged
    assert "row 2" in series.reason
    assert [group["failed"] for group in series.summarise()] == [0, 1]


def test_without_a_length_at_no_pressure_there_is_no_contraction(tmp_path):
    series = _make_series(tmp_path, [(0, "none", None), (100, "none", 38.0)])
    assert series.summarise()[1]["contraction_mm"] is None
    assert series.list_contractions()["direction"] == []


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("a.png,up-and-down,1,,,,", "direction is"),
        ("a.png,inflate,much,,,,", "pressure_kpa is 'much'"),
        ("a.png,inflate,-5,,,,", "pressure_kpa is '-5'"),
        ("a.png,inflate,1,3,,,", "give all of"),
    ],
)
def test_a_wrong_row_is_named(tmp_path, line, words):
    head = "image,direction,pressure_kpa,override_x1,override_y1,override_x2,override_y2"
    (tmp_path / "m.csv").write_text(f"{head}\n{line}\n")
    with pytest.raises(FileFormatError, match=words) as caught:
        read_series(read_manifest(tmp_path / "m.csv", ()))
    assert "row 1" in str(caught.value)


def test_neither_camera_nor_distance_is_refused_before_any_picture(tmp_path):
    series = _make_series(tmp_path, [(0, "none", 40.0)])
    with pytest.raises(InputError, match="distance"):
        measure_series(series.manifest, StripBoard(), options=OPTIONS)


def _measure(folder, target):
    found = measure_series(
        read_manifest(folder / "manifest.csv", ("image", "pressure_kpa")),
        load_board(folder / "board.yaml"),
        options=DEMO_LENGTH,
        camera=load_cameras(folder / "cameras.yaml").cameras[0],
    )
    write_series(found, target)
    return found


@pytest.mark.slow
def test_the_commands_measure_what_the_demonstration_renders(tmp_path, capsys):
    demo, out = tmp_path / "demo", tmp_path / "out"
    words = ["vision", "demo", "--repeats", "1", "--steps", "3", "--deflation", "--out", str(demo)]
    assert main(words) == 0
    capsys.readouterr()
    with (demo / "manifest.csv").open("a") as file:
        file.write("pictures/none.jpg,muscle-1,0,inflate,2,0\n")
    words = ["vision", "length", str(demo / "manifest.csv"), "--board", str(demo / "board.yaml")]
    words += ["--cameras", str(demo / "cameras.yaml"), "--height", "2.8mm", "--diameter", "1.6mm"]
    words += ["--ring", "2mm", "--height-uncertainty", "0.1mm", "--out", str(out), "--jobs", "1"]
    assert main([*words, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["failed"] == 1
    with (demo / "truth.csv").open() as file:
        truth = [float(row["length_mm"]) for row in csv.DictReader(file)]
    with (out / "lengths.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(truth) + 1
    for row, length in zip(rows, truth, strict=False):
        assert abs(float(row["length_mm"]) - length) < 3.0 * float(row["u_mm"])
    assert rows[-1]["status"] == "failed"
    assert "no such picture" in rows[-1]["reason"]
    assert len(list((out / "overlays").iterdir())) == len(truth)
    assert len(read_measurements(out / "contractions.csv")) == len(truth) - 1


@pytest.mark.slow(40)
def test_the_fit_recovers_the_muscle_of_the_demonstration(tmp_path):
    muscle, within = preset("effector-45"), 0
    setup = LengthSetup(pitch=0.1, columns=820, rows=660)
    for seed in range(6):
        folder, target = tmp_path / f"demo{seed}", tmp_path / f"out{seed}"
        options = DemoOptions(repeats=2, steps=5, seed=seed)
        write_demo(folder, options=options, setup=setup)
        assert _measure(folder, target).converged
        data = read_measurements(target / "contractions.csv", muscle=muscle)
        intervals = calibrate(EnergyMuscle, muscle, data=data).intervals
        truth = {"modulus": options.modulus, "dead_length": options.dead_length}
        within += all(
            intervals[name][0] <= value <= intervals[name][1] for name, value in truth.items()
        )
    assert within >= 5

"""``bozzini effector fit`` and ``simulate``: files, refusals, and that they belong together."""

from __future__ import annotations

import bz2
import csv
import gzip
import json
import lzma
import math

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.effector import Effector, effector_preset, read_effector

TABLE = """R contraction [mm],lateral [mm],R force [N]
7.6,22.8,1.69
6.9,20.4,1.51
6.5,18.9,1.40
7.1,21.2,1.57
5.7,15.8,1.17
"""
FIT = ("--free", "offset,flexural_rigidity", "--preset", "prototype", "--set", "offset=3.6mm")
PULLS = ("--pulls", "--per-volt", "100kPa", "--angles", "A=0deg,B=120deg,C=240deg", "--quiet")


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, str, str]:
        code = main(["effector", *arguments])
        return code, *capsys.readouterr()

    return call


def test_a_table_of_the_thesis_is_fitted_and_its_file_goes_on(run, tmp_path):
    (tmp_path / "t.csv").write_text(TABLE, encoding="utf-8")
    code, out, err = run(
        "fit", "t.csv", *FIT, "--out", "mine.yaml", "--figure", "mine.png", "--json", "--quiet"
    )
    assert (code, err) == (0, "")
    found = json.loads(out)["estimates"]
    assert found["offset"]["value"] == pytest.approx(4.0, abs=0.02)
    assert found["flexural_rigidity"]["value"] == pytest.approx(200.0, abs=2.0)
    assert (tmp_path / "mine.png").exists()
    assert read_effector("mine.yaml").intervals["offset"][1] < 4.0
    code, out, _ = run("pose", "--preset", "mine.yaml", "--pressure", "R=500kPa", "--json")
    design = effector_preset("prototype").replace(
        offset=found["offset"]["value"], flexural_rigidity=found["flexural_rigidity"]["value"]
    )
    same = Effector(design).forward({"R": 0.5})
    assert code == 0
    assert json.loads(out)["lateral_mm"] == pytest.approx(float(same.lateral), rel=1e-9)


def test_a_recording_is_fitted_and_simulated(run, tmp_path):
    times = np.arange(0.0, 12.0, 0.1)
    rows = ["run,time_s,command_A_V,command_B_V,command_C_V,dot_x_mm,dot_y_mm"]
    for name, shift in (("one", 0.0), ("two", 1.0)):
        speeds = (0.7, 1.1, 1.7)
        volts = np.stack([3.0 + 2.0 * np.sin(w * times + shift) for w in speeds], axis=1)
        ways = np.exp(2j * math.pi * np.arange(3) / 3.0)
        dot = 0.4 * volts @ ways
        late = np.concatenate([[dot[0]], dot[:-1]])
        rows += [
            f"{name},{t:.2f},{v[0]:.6f},{v[1]:.6f},{v[2]:.6f},{z.real:.5f},{z.imag:.5f}"
            for t, v, z in zip(times, volts, late, strict=True)
        ]
    (tmp_path / "runs.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    free = "muscles.each.area,muscles.each.angle,board.x,board.y"
    still = ("--set", "motion.fill_lag=0s", "--set", "motion.bleed_lag=0s",
             "--set", "motion.creep_share=0")  # fmt: skip
    code, out, _ = run("fit", "runs.csv", *PULLS, *still, "--free", free, "--hold", "two",
                       "--out", "arm.yaml", "--json")  # fmt: skip
    said = json.loads(out)
    assert code == 0, said
    assert said["fitted"]["rms_mm"] < 0.05
    assert said["checks"]["runs.csv, held"]["rms_mm"] < 0.05
    code, _, err = run("simulate", "arm.yaml", "runs.csv", "--out", "tips.csv")
    assert (code, err) == (0, "")
    table = list(csv.DictReader((tmp_path / "tips.csv").open(encoding="utf-8")))
    seen = list(csv.DictReader((tmp_path / "runs.csv").open(encoding="utf-8")))
    off = [float(a["spot_x_mm"]) - float(b["dot_x_mm"]) for a, b in zip(table, seen, strict=True)]
    assert np.sqrt(np.mean(np.square(off))) < 0.05
    (tmp_path / "high.csv").write_text("time_s,command_A_V\n0,1\n1,20\n", encoding="utf-8")
    code, _, err = run("simulate", "arm.yaml", "high.csv", "--out", "high_tips.csv")
    assert code == 2 and "high.csv: row 2 of the data: the pressure of muscle A is 2 MPa" in err
    assert not (tmp_path / "high_tips.csv").exists()
    # How far the section bends does not depend on where its base stands.
    code, out, _ = run("simulate", "arm.yaml", "runs.csv", "--json")
    text = (tmp_path / "arm.yaml").read_text(encoding="utf-8")
    (tmp_path / "off.yaml").write_text(text.replace("base_x: 0.0", "base_x: 90.0"), "utf-8")
    _, moved, _ = run("simulate", "off.yaml", "runs.csv", "--json")
    one, other = (json.loads(answer)["largest_lateral_mm"] for answer in (out, moved))
    assert code == 0 and other == pytest.approx(one, rel=1e-12)


def test_a_rest_goes_on_with_the_file(run, tmp_path):
    times = np.arange(0.0, 12.0, 0.1)
    rows = ["run,time_s,command_A_V,command_B_V,command_C_V,dot_x_mm,dot_y_mm"]
    for name, shift in (("one", 0.0), ("two", 1.0)):
        speeds = (0.7, 1.1, 1.7)
        volts = np.stack([3.0 + 2.0 * np.sin(w * times + shift) for w in speeds], axis=1)
        dot = 0.4 * volts @ np.exp(2j * math.pi * np.arange(3) / 3.0)
        dot += 0.05 * volts[:, 0] * volts[:, 1]  # which is nothing of the model
        rows += [
            f"{name},{t:.2f},{v[0]:.6f},{v[1]:.6f},{v[2]:.6f},{z.real:.9f},{z.imag:.9f}"
            for t, v, z in zip(times, volts, dot, strict=True)
        ]
    (tmp_path / "runs.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    fit = ("fit", "runs.csv", *PULLS, "--together", "--free", "muscles.each.area,board.x,board.y")
    _, out, _ = run(*fit, "--rest", "polynomial", "--out", "arm.yaml", "--json")
    errors = json.loads(out)["fitted"]["errors_mm"]["two"]
    assert errors["fit and rest"] < 0.5 * errors["fit"]
    code, out, err = run("simulate", "arm.yaml", "runs.csv", "--out", "tips.csv")
    assert (code, err) == (0, "") and "not in it: what the rest adds to spot x, spot y" in out
    table = list(csv.DictReader((tmp_path / "tips.csv").open(encoding="utf-8")))
    seen = list(csv.DictReader((tmp_path / "runs.csv").open(encoding="utf-8")))
    half = len(seen) // 2

    def miss(share):
        off = [
            [float(a[f"spot_{k}_mm"]) + share * float(a[f"rest of spot {k}"])
             - float(b[f"dot_{k}_mm"]) for k in "xy"]
            for a, b in zip(table[half:], seen[half:], strict=True)
        ]  # fmt: skip
        return math.sqrt(np.square(off).sum(axis=1).mean())

    assert miss(0.0) == pytest.approx(errors["fit"], rel=1e-5)
    assert miss(1.0) == pytest.approx(errors["fit and rest"], rel=1e-4)
    code, out, _ = run("track", "arm.yaml", "--radius", "0.1mm", "--frequency", "5Hz", "--plants",
                       "0", "--json")  # fmt: skip
    assert code == 0 and "rest that the fit has learned" in json.loads(out)["notes"][0]
    text = (tmp_path / "arm.yaml").read_text(encoding="utf-8")
    (tmp_path / "arm.yaml").write_text(text.replace("products:", "product:"), encoding="utf-8")
    code, _, err = run("simulate", "arm.yaml", "runs.csv")
    assert (code, err.count("\n")) == (2, 1) and "the rest has not delays" in err


@pytest.mark.parametrize(("module", "suffix"), [(gzip, "gz"), (bz2, "bz2"), (lzma, "xz")])
def test_packed_tables_are_read_and_damaged_ones_refused_in_one_line(run, tmp_path, module, suffix):
    (tmp_path / "t.csv").write_text(TABLE, encoding="utf-8")
    packed = module.compress(TABLE.encode())
    path = tmp_path / f"t.csv.{suffix}"
    path.write_bytes(packed)
    _, plain, _ = run("fit", "t.csv", *FIT, "--json", "--quiet")
    code, out, err = run("fit", path.name, *FIT, "--json", "--quiet")
    assert (code, err) == (0, "")
    assert json.loads(out)["estimates"] == json.loads(plain)["estimates"]
    wrong = bytearray(packed)
    wrong[len(wrong) // 2] ^= 0xFF
    for damaged in (packed[:-9], bytes(wrong), TABLE.encode(), b"PK" + packed):
        path.write_bytes(damaged)
        code, out, err = run("fit", path.name, *FIT, "--out", "mine.yaml")
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert f"t.csv.{suffix} is damaged and cannot be unpacked: " in err
    assert not (tmp_path / "mine.yaml").exists()


@pytest.mark.parametrize(
    ("rows", "more", "said"),
    [
        (["time_s,command_A_V,dot_x_cm", "0,1,1", "1,1,2"], (), "say how much pressure a volt is"),
        (["time_s,command_A_V,dot_x_cm", "0,9,1", "1,1,2"], PULLS,
         "row 1 of the data: the pressure of muscle A is 0.9 MPa: it must lie in [0, 0.827] MPa"),
        (["time_s,command_A_V,dot_x_cm", "0,1,1", "1,-1,2"], PULLS,
         "row 2 of the data: the pressure of muscle A is -0.1 MPa"),
        (["time_s,command_A_V,dot_x_cm", "0,1,1", "2,1,1", "1,1,2"], PULLS,
         "time runs backwards or stands at row 3 of the data"),
        (["run,time_s,command_A_V,dot_x_cm", "a,0,1,1", ",1,1,2"], PULLS, "the run has no name"),
        (["time_s,command_A_V,dot_x_cm", "0,1,1", "1,nan,2"], PULLS, "must be a finite number"),
        (["time_s,command_A_V,dot_x_cm", "0,1,1", "1,1,2", "0,1,1"], PULLS, "name the runs"),
        (["time_s,command_A_V,dot_x_cm", "0,1,1", "1,1,2"], PULLS, "are too few for"),
        (["time_s,command_A_V,dot_x_cm", "0,1,", "1,1,nan"], PULLS, "nothing was seen"),
        (["run,time_s,command_A_V,dot_x_cm", "a,0,1,1", "a,1,1,2"], (*PULLS, "--hold", "b"),
         "there is no run 'b'"),
        (["R pressure [kPa],lateral [mm]", "100,2", "200,4"], (), "--free is needed"),
        (["R pressure [kPa],lateral [mm]", "100,2", "200,4"], ("--free", "offset", "--set", "a=1"),
         "'a' cannot be fitted"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_nothing_is_written(run, tmp_path, rows, more, said):
    (tmp_path / "t.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    code, out, err = run("fit", "t.csv", *more, "--out", "mine.yaml")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1 and said in err
    assert not (tmp_path / "mine.yaml").exists()

"""``bozzini muscle``: what it prints is what the library says; a bad input is one line."""

from __future__ import annotations

import csv
import io
import json
import math

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.muscle import EnergyMuscle, ThesisMuscle, preset
from bozzini.muscle.dataset import Measurements, write_measurements

TRUTH = preset("thesis-45", modulus=0.5, dead_length=10.0)


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        capsys.readouterr()
        code = main(["muscle", *map(str, arguments)])
        return code, *capsys.readouterr()

    return call


@pytest.fixture
def table(tmp_path):
    pressure = np.linspace(0.0, 0.8, 20)
    error = 0.05 * np.random.default_rng(2).normal(size=20)
    data = Measurements(
        pressure=pressure, contraction=EnergyMuscle(TRUTH).contraction(pressure) + error
    )
    return write_measurements(tmp_path / "data.csv", data)


def test_solve_is_the_library(run):
    code, out, err = run(
        "solve", "--preset", "effector-45", "--model", "thesis",
        "--pressure", "100psi", "--load", "0N", "--json",
    )  # fmt: skip
    assert (code, err) == (0, "")
    said = json.loads(out)
    model = ThesisMuscle(preset("effector-45"))
    pressure = 100 * 0.006894757293168
    assert said["pressure_MPa"] == pytest.approx(pressure)
    assert said["contraction_mm"] == pytest.approx(float(model.contraction(pressure)))
    assert said["contraction_mm"] == pytest.approx(7.6, abs=0.05)  # thesis, chapter 4
    assert said["length_mm"] == pytest.approx(45.0 - said["contraction_mm"])
    assert said["braid_angle_rad"] == pytest.approx(float(model.braid_angle(pressure)))
    assert said["dead_band_MPa"] == pytest.approx(model.dead_band())
    assert said["converged"] is True


def test_every_field_can_be_overridden(run):
    fields = {
        "length": ("5cm", "length_mm", 50.0),
        "outer-radius": ("0.75mm", "outer_radius_mm", 0.75),
        "inner-radius": ("0.3", "inner_radius_mm", 0.3),
        "braid-angle": ("30deg", "braid_angle_rad", math.radians(30.0)),
        "gap": ("50um", "gap_mm", 0.05),
        "strands": ("24", "strands", 24),
        "strand-radius": ("0.03mm", "strand_radius_mm", 0.03),
        "end-length": ("4mm", "end_length_mm", 4.0),
        "dead-length": ("3mm", "dead_length_mm", 3.0),
        "modulus": ("400kPa", "modulus_MPa", 0.4),
        "poisson-ratio": ("0.49", "poisson_ratio", 0.49),
        "strand-modulus": ("2GPa", "strand_modulus_MPa", 2000.0),
        "mooney-ratio": ("0.1", "mooney_ratio", 0.1),
        "friction-length": ("0.01mm", "friction_length_mm", 0.01),
    }
    options = [word for name, (text, _, _) in fields.items() for word in (f"--{name}", text)]
    code, out, _ = run("solve", "--pressure", "0.5MPa", "--load", "0.2N", "--direction",
                       "inflating", "--json", *options)  # fmt: skip
    said = json.loads(out)
    assert code == 0
    assert set(said["muscle"]) == {key for _, key, _ in fields.values()}
    changes = {}
    for name, (_, key, value) in fields.items():
        assert said["muscle"][key] == pytest.approx(value)
        changes[name.replace("-", "_")] = value
    assert isinstance(said["muscle"]["strands"], int)
    model = EnergyMuscle(preset("effector-45", **changes))
    contraction = model.contraction(0.5, 0.2, direction="inflating")
    assert said["contraction_mm"] == pytest.approx(float(contraction))


def test_options_of_a_model_reach_it(run):
    def solve(*options):
        code, out, _ = run("solve", "--pressure", "0.6MPa", "--json", *options)
        assert code == 0
        return json.loads(out)["contraction_mm"]

    assert solve("--ends", "trellis") != solve("--ends", "none")
    loaded = ("--model", "thesis", "--load", "1N", "--load-path", "bulk")
    assert solve(*loaded) < solve(*loaded, "--load", "0.5N")


def test_text_says_the_same_as_json(run):
    _, text, _ = run("solve", "--pressure", "0.6MPa")
    _, out, _ = run("solve", "--pressure", "0.6MPa", "--json")
    assert f"contraction {json.loads(out)['contraction_mm']:.4g} mm" in text


@pytest.mark.parametrize("kind", ["contraction", "force", "angle", "phases"])
def test_a_curve_is_a_table_and_a_picture(run, kind, tmp_path):
    code, out, err = run("curve", "--of", kind, "--pressure", "0.6MPa", "--points", "7")
    assert (code, err) == (0, "")
    rows = list(csv.DictReader(io.StringIO(out)))
    assert len(rows) == 7
    model = EnergyMuscle(preset("effector-45"))
    for row in ({key: float(value) for key, value in row.items()} for row in rows):
        if kind == "force":
            force = float(model.force(0.6, row["contraction_mm"]))
            assert row["force_N"] == pytest.approx(force, abs=1e-6)
        else:
            contraction = float(model.contraction(row["pressure_MPa"]))
            assert row["contraction_mm"] == pytest.approx(contraction, abs=1e-6)
    for name in ("curve.csv", "curve.png"):
        code, _, _ = run("curve", "--of", kind, "--pressure", "0.6MPa", "--points", "7",
                         "--out", name)  # fmt: skip
        assert code == 0
    assert (tmp_path / "curve.csv").read_text() == out
    assert (tmp_path / "curve.png").read_bytes()[:4] == b"\x89PNG"


def test_a_file_is_replaced_only_by_force(run, tmp_path):
    command = ("curve", "--points", "3", "--out", "curve.csv")
    assert run(*command)[0] == 0
    before = (tmp_path / "curve.csv").read_bytes()
    code, _, err = run(*command, "--pressure", "0.3MPa")
    assert code == 2
    assert "exists already" in err
    assert (tmp_path / "curve.csv").read_bytes() == before
    assert run(*command, "--pressure", "0.3MPa", "--force")[0] == 0
    assert (tmp_path / "curve.csv").read_bytes() != before


def test_fit_finds_the_truth(run, table, tmp_path):
    code, out, err = run("fit", table, "--preset", "thesis-45", "--json", "--out", "fit.png")
    said = json.loads(out)
    assert (code, err) == (0, "")
    for name, truth in (("modulus", 0.5), ("dead_length", 10.0)):
        assert said["estimates"][name]["value"] == pytest.approx(truth, rel=0.05)
        low, high = said["estimates"][name]["interval_95"]
        assert low < said["estimates"][name]["value"] < high
    assert said["estimates"]["modulus"]["unit"] == "MPa"
    assert said["muscle"]["dead_length_mm"] == said["estimates"]["dead_length"]["value"]
    assert said["warnings"] == []
    assert (tmp_path / "fit.png").exists()
    _, text, _ = run("fit", table, "--preset", "thesis-45")
    assert "dead_length" in text and "converged" in text


def test_fit_refuses_what_the_data_cannot_tell_or_warns(run, table):
    command = ("fit", table, "--preset", "thesis-45", "--free", "modulus,dead-length,braid-angle")
    code, out, err = run(*command)
    assert (code, out) == (2, "")
    assert "second load" in err
    code, out, _ = run(*command, "--anyway")
    assert code == 1
    assert "warning: dead_length and braid_angle cannot be told apart" in out


def test_compare_scores_models(run, table, tmp_path):
    code, out, _ = run("compare", table, "--preset", "thesis-45", "--modulus", "0.5MPa",
                       "--dead-length", "10mm", "--json", "--out", "models.svg")  # fmt: skip
    said = json.loads(out)
    assert code == 0
    assert [row["model"] for row in said["models"]] == ["energy", "thesis"]
    assert said["models"][0]["rmse_mm"] < 0.1
    assert (tmp_path / "models.svg").exists()
    _, fitted, _ = run("compare", table, "--preset", "thesis-45", "--fit", "--json")
    for row in json.loads(fitted)["models"]:
        assert len(row["fitted"]) == 2
        before = next(item for item in said["models"] if item["model"] == row["model"])
        assert row["rmse_mm"] <= before["rmse_mm"] + 1e-9
    code, text, _ = run("compare", table, "--model", "energy")
    assert code == 0
    assert "thesis" not in text


def test_compare_with_no_model_that_answers(run, tmp_path):
    (tmp_path / "loaded.csv").write_text(
        "pressure_kPa,contraction_mm,load_N\n500,5,1\n600,6,1\n", encoding="utf-8"
    )
    code, out, _ = run("compare", "loaded.csv", "--model", "thesis")
    assert code == 1
    assert "no answer" in out


def test_units_and_the_mean_of_directions(run, tmp_path):
    text = "pressure,length [mm],branch,note\n"
    for row in ("200,43,up", "400,41,up", "600,40,up", "600,39,down", "400,39,down", "200,41,down"):
        text += f"{row},x\n"
    (tmp_path / "both.csv").write_text(text, encoding="utf-8")
    code, out, _ = run("compare", "both.csv", "--unit", "pressure=kPa", "--mean", "--json")
    said = json.loads(out)
    assert code == 0
    assert said["rows"] == 3
    assert said["largest_contraction_mm"] == pytest.approx(5.5)
    assert said["ignored_columns"] == ["note"]
    assert "ignored columns: note" in run("compare", "both.csv", "--unit", "pressure=kPa")[1]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["solve"], "--pressure"),
        (["solve", "--pressure", "100 furlongs"], "furlongs"),
        (["solve", "--pressure", "1e9MPa"], "pressure is 1e+09 MPa"),
        (["solve", "--pressure=-1kPa"], "pressure is -0.001 MPa"),
        (["solve", "--pressure", "0.5MPa", "--load", "500N"], "load is 500 N"),
        (["solve", "--pressure", "0.5MPa", "--preset", "none-45"], "'none-45'"),
        (["solve", "--pressure", "0.5MPa", "--model", "liu"], "'liu'"),
        (["solve", "--pressure", "0.5MPa", "--ends", "round"], "'round'"),
        (["solve", "--pressure", "0.5MPa", "--braid-angle", "80deg"], "braid angle is 1.39626"),
        (["solve", "--pressure", "0.5MPa", "--strands", "30.5"], "30.5"),
        (["solve", "--pressure", "0.5MPa", "--length", "3kg"], "wrong kind of unit"),
        (["curve", "--points", "1"], "points is 1"),
        (["curve", "--out", "curve.txt"], ".csv"),
        (["curve", "--out", "nowhere/curve.csv"], "nowhere"),
        (["curve", "--of", "phases", "--pressure", "1kPa", "--out", "a.png"], "pressure is 0.001"),
        (["curve", "--of", "force", "--model", "thesis"], "load path"),
        (["fit", "nothing.csv"], "nothing.csv"),
        (["fit", "bad.csv"], "row 3: pressure is 'x'"),
        (["fit", "bad.csv", "--unit", "kPa"], "COLUMN=UNIT"),
        (["fit", "good.csv", "--free", "colour"], "'colour'"),
        (["fit", "good.csv", "--out", "fit.csv"], ".png"),
        (["compare", "good.csv", "--model", "liu"], "'liu'"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(run, tmp_path, arguments, said):
    (tmp_path / "bad.csv").write_text("pressure_kPa,length_mm\n1,44\nx,43\n", encoding="utf-8")
    good = "pressure_kPa,length_mm\n200,44\n300,43\n400,42\n"
    (tmp_path / "good.csv").write_text(good, encoding="utf-8")
    code, out, err = run(*arguments)
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1
    assert said in err
    assert {path.name for path in tmp_path.iterdir()} == {"bad.csv", "good.csv"}

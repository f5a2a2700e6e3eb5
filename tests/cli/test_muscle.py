"""``bozzini muscle``: what it prints is what the library says; a bad input is one line."""

from __future__ import annotations

import csv
import io
import json
import math
import re

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.cli.muscle_options import CHOICES
from bozzini.muscle import (
    MODELS,
    PRESETS,
    EnergyMuscle,
    Measurements,
    MuscleFile,
    ThesisMuscle,
    preset,
    read_muscle,
    write_measurements,
    write_muscle,
)
from bozzini.muscle.kernels import energy as _kernels
from bozzini.muscle.models.energy import ENDS
from bozzini.muscle.models.thesis import LOAD_PATHS

OWN_MODELS = [name for name in MODELS if name not in MODELS.cards]
OWN = tuple(word for name in OWN_MODELS for word in ("--model", name))
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


FIELDS = {
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
WAY = {"energy": ("--direction", "inflating", "--load", "0.2N"), "thesis": ()}


@pytest.mark.parametrize("name", OWN_MODELS)
def test_every_field_of_a_model_can_be_overridden(run, name):
    used = {key: field for key, field in FIELDS.items()
            if key.replace("-", "_") not in MODELS[name].unused}  # fmt: skip
    options = [word for key, (text, _, _) in used.items() for word in (f"--{key}", text)]
    command = ("solve", "--preset", "effector-45", "--model", name, "--pressure", "0.5MPa")
    code, out, _ = run(*command, "--json", *WAY[name], *options)
    said = json.loads(out)
    assert code == 0
    assert set(said["muscle"]) == {key for _, key, _ in FIELDS.values()}
    changes = {}
    for key, (_, shown, value) in used.items():
        assert said["muscle"][shown] == pytest.approx(value)
        changes[key.replace("-", "_")] = value
    assert isinstance(said["muscle"]["strands"], int)
    model = MODELS[name](preset("effector-45", **changes))
    load, direction = (0.2, "inflating") if name == "energy" else (0.0, None)
    contraction = model.contraction(0.5, load, direction=direction)
    assert said["contraction_mm"] == pytest.approx(float(contraction))
    assert (said["load_N"], said["direction"]) == (load, direction)
    assert said["ends"] == ("none" if name == "energy" else None)
    assert said["load_path"] == ("none" if name == "thesis" else None)
    assert abs(said["residual_N"]) < 1e-9


@pytest.mark.parametrize("name", OWN_MODELS)
def test_a_field_without_effect_is_refused(run, table, name):
    for field in MODELS[name].unused:
        option = f"--{field.replace('_', '-')}"
        for command in (["solve", "--pressure", "0.5MPa"], ["curve"], ["fit", table]):
            code, out, err = run(*command, "--model", name, option, FIELDS[option[2:]][0])
            assert (code, out) == (2, "")
            assert f"{option} has no effect in the model {name}: leave it out" in err
    both = run("compare", table, *OWN, "--preset", "thesis-45", "--strands", "28")
    assert both[0] == 0  # one of the two uses it


def test_the_choices_of_the_options_are_those_of_the_library():
    assert {name: (model, words) for model in MODELS
            for name, words in MODELS[model].choices.items()} == CHOICES  # fmt: skip
    assert CHOICES == {"ends": ("energy", ENDS), "load_path": ("thesis", LOAD_PATHS)}


def test_options_of_a_model_reach_it(run):
    def solve(*options):
        code, out, _ = run("solve", "--pressure", "0.6MPa", "--json", *options)
        assert code == 0
        return json.loads(out)["contraction_mm"]

    assert solve("--ends", "trellis") != solve("--ends", "none")
    loaded = ("--model", "thesis", "--load-path", "bulk", "--load")
    assert solve(*loaded, "1N") < solve(*loaded, "0.5N")


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
    for name, points in (("curve.csv", ("--points", "7")), ("curve.png", ())):
        code, _, _ = run("curve", "--of", kind, "--pressure", "0.6MPa", *points, "--out", name)
        assert code == 0
    assert (tmp_path / "curve.csv").read_text(encoding="utf-8") == out
    assert (tmp_path / "curve.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize("kind", ["contraction", "force", "angle", "phases"])
def test_a_curve_of_one_direction(run, kind):
    options = ("--friction-length", "0.05mm", "--direction", "deflating", "--json")
    code, out, _ = run("curve", "--of", kind, "--pressure", "0.6MPa", *options)
    said = json.loads(out)
    assert code == 0
    assert said["direction"] == "deflating"
    assert said["pressure_MPa"] == 0.6
    columns = said["columns"]
    model = EnergyMuscle(preset("effector-45", friction_length=0.05))
    if kind == "force":
        x = np.array(columns["contraction_mm"])
        assert columns["force_N"] == pytest.approx(model.force(0.6, x, direction="deflating"))
        slope = model.stiffness(0.6, x, direction="deflating")
        assert columns["stiffness_N_per_mm"] == pytest.approx(slope)
    else:
        state = model.solve(columns["pressure_MPa"], direction="deflating")
        assert columns["contraction_mm"] == pytest.approx(state.contraction)
        assert columns["braid_angle_rad"] == pytest.approx(state.braid_angle)


def test_no_solution_is_exit_code_1(run, monkeypatch):
    for function in ("find_stretch", "find_stretches", "find_force", "find_forces"):
        monkeypatch.setattr(_kernels, function, getattr(_kernels, function).py_func)
    monkeypatch.setattr(_kernels, "MAX_ITERATIONS", 2)
    code, out, _ = run("solve", "--pressure", "0.6MPa")
    assert code == 1
    assert "no solution: the tolerance was not met within 2 iterations" in out
    code, out, _ = run("solve", "--pressure", "0.6MPa", "--json")
    said = json.loads(out)
    assert (code, said["converged"]) == (1, False)
    assert "within 2 iterations" in said["reason"]


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
    both = ("--out", "fit.yaml", "--figure", "again.png", "--json")
    assert run("fit", table, "--preset", "thesis-45", *both)[0] == 0
    assert (tmp_path / "again.png").read_bytes() == (tmp_path / "fit.png").read_bytes()
    assert read_muscle(tmp_path / "fit.yaml").muscle.modulus == pytest.approx(
        said["estimates"]["modulus"]["value"], rel=1e-12
    )
    code, out, err = run("fit", table, "--preset", "thesis-45", "--figure", "fit.doc")
    assert (code, out) == (2, "") and "fit.doc" in err and ".png" in err


def test_a_file_that_names_an_unknown_model_is_one_line(run, tmp_path):
    file = MuscleFile(muscle=preset("effector-45"), model="nobody")
    write_muscle(tmp_path / "mine.yaml", file)
    code, out, err = run("solve", "--muscle", "mine.yaml", "--pressure", "1kPa")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "mine.yaml: model is 'nobody': choose one of" in err and "energy" in err
    known = ("solve", "--muscle", "mine.yaml", "--model", "chou", "--pressure", "1kPa")
    assert run(*known)[0] == 0


def test_fit_refuses_what_the_data_cannot_tell_or_warns(run, table):
    command = ("fit", table, "--preset", "thesis-45", "--free", "modulus,dead-length,braid-angle")
    code, out, err = run(*command)
    assert (code, out) == (2, "")
    assert "second load" in err
    code, out, _ = run(*command, "--anyway")
    assert code == 1
    assert "warning: dead_length and braid_angle cannot be distinguished" in out


def test_compare_scores_models(run, table, tmp_path):
    code, out, _ = run("compare", table, *OWN, "--preset", "thesis-45", "--modulus", "0.5MPa",
                       "--dead-length", "10mm", "--json", "--out", "models.svg")  # fmt: skip
    said = json.loads(out)
    assert code == 0
    assert [row["model"] for row in said["models"]] == ["energy", "thesis"]
    assert said["models"][0]["rmse_mm"] < 0.1
    assert (tmp_path / "models.svg").exists()
    _, fitted, _ = run("compare", table, *OWN, "--preset", "thesis-45", "--fit", "--json")
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


LOADED = "pressure_kPa,contraction_mm,load_N\n300,4.5,0\n500,6,0.3\n600,7,0\n700,8,0.3\n"


@pytest.mark.parametrize("fit", [(), ("--fit",)])
def test_a_model_that_refuses_does_not_take_the_others_along(run, tmp_path, fit):
    (tmp_path / "loaded.csv").write_text(LOADED, encoding="utf-8")
    code, out, err = run("compare", "loaded.csv", *OWN, *fit, "--out", "both.png", "--json")
    said = json.loads(out)
    assert (code, err) == (1 if said.get("poor") else 0, "")
    assert [row["model"] for row in said["models"]] == ["energy", "thesis"]
    assert [row["rows_answered"] for row in said["models"]] == [4, 2]
    assert said["refusals"] == {}
    assert (tmp_path / "both.png").exists()
    assert said["file"] == "both.png"


def test_no_picture_without_a_model_that_answers(run, tmp_path):
    loaded = LOADED.replace(",0\n", ",0.2\n")
    (tmp_path / "loaded.csv").write_text(loaded, encoding="utf-8")
    command = ("compare", "loaded.csv", "--model", "thesis", "--out", "none.png")
    code, out, err = run(*command)
    assert (code, err) == (1, "")
    assert "thesis: no answer: loaded.csv: row 2" in out
    assert not (tmp_path / "none.png").exists()
    assert json.loads(run(*command, "--json")[1])["file"] is None


def test_compare_tells_the_warnings_of_its_fits(run, tmp_path):
    text = "pressure_kPa,contraction_mm\n"
    for pressure in (200, 300, 400, 500, 600, 700):  # dead over nearly all of its length
        text += f"{pressure},{0.1 + 1e-4 * pressure:g}\n"
    (tmp_path / "still.csv").write_text(text, encoding="utf-8")
    command = ("compare", "still.csv", "--model", "energy", "--fit")
    code, out, _ = run(*command)
    assert code == 1
    assert "energy: warning: " in out and "is at its bound" in out
    assert "no model fits: the nearest is off by" in out
    (row,) = json.loads(run(*command, "--json")[1])["models"]
    assert any("is at its bound" in line for line in row["fit_warnings"])
    assert row["fit_converged"] is True


def test_fit_of_the_thesis_model_has_its_own_default(run, tmp_path):
    truth = preset("thesis-45", modulus=0.5, end_length=4.0)
    pressure = np.linspace(0.1, 0.8, 15)
    contraction = ThesisMuscle(truth).contraction(pressure)
    write_measurements(
        tmp_path / "data.csv", Measurements(pressure=pressure, contraction=contraction)
    )
    code, out, err = run("fit", "data.csv", "--preset", "thesis-45", "--model", "thesis", "--json")
    said = json.loads(out)
    assert (code, err) == (0, "")
    assert said["estimates"]["end_length"]["value"] == pytest.approx(4.0, rel=1e-2)
    assert said["load_path"] == "none"


def test_fit_within_bounds(run, table):
    command = ("fit", table, "--preset", "thesis-45", "--bound")
    code, out, _ = run(*command, "dead-length=0mm:0.8cm", "--json")
    said = json.loads(out)
    assert code == 1  # it is at its bound
    assert said["bounds"] == {"dead_length": [0.0, 8.0]}
    assert said["estimates"]["dead_length"]["value"] == pytest.approx(8.0)
    for bound, words in (
        ("dead-length=-5mm:60mm", "lower bound of dead_length is -5 mm: it must lie in [0, 44.55]"),
        ("modulus=3", "--bound is 'modulus=3': it must be FIELD=LOW:HIGH"),
        ("colour=1:2", "--bound is 'colour=1:2'"),
        ("gap=0:0.1", "bounds are given for gap"),
    ):
        code, out, err = run(*command, bound)
        assert (code, out) == (2, "")
        assert words in err


def test_what_the_mean_leaves_out_is_said(run, tmp_path):
    rows = "200,2,up\n400,4,up\n600,5,up\n700,5.5,up\n600,6,down\n400,5,down\n200,3,down\n"
    (tmp_path / "both.csv").write_text(f"pressure_kPa,contraction_mm,branch\n{rows}", "utf-8")
    command = ("compare", "both.csv", *OWN, "--mean")
    assert "note: specimen '' at 0 N: inflation at 0.7 MPa left out" in run(*command)[1]
    said = json.loads(run(*command, "--json")[1])
    assert said["rows"] == 3
    assert len(said["notes"]) == 1


def test_units_and_the_mean_of_directions(run, tmp_path):
    text = "pressure,length [mm],branch,note\n"
    for row in ("200,43,up", "400,41,up", "600,40,up", "600,39,down", "400,39,down", "200,41,down"):
        text += f"{row},x\n"
    (tmp_path / "both.csv").write_text(text, encoding="utf-8")
    code, out, _ = run("compare", "both.csv", *OWN, "--unit", "pressure=kPa", "--mean", "--json")
    said = json.loads(out)
    assert code == 0
    assert said["rows"] == 3
    assert said["largest_contraction_mm"] == pytest.approx(5.5)
    assert said["ignored_columns"] == ["note"]
    _, text, _ = run("compare", "both.csv", *OWN, "--unit", "pressure=kPa")
    assert "ignored columns: note" in text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["solve"], "--pressure"),
        (["solve", "--pressure", "100 furlongs"], "furlongs"),
        (["solve", "--pressure", "1e9MPa"], "pressure is 1e+09 MPa"),
        (["solve", "--pressure=-1kPa"], "pressure is -0.001 MPa"),
        (["solve", "--pressure", "0.5MPa", "--load", "500N"], "load is 500 N"),
        (["solve", "--pressure", "0.5MPa", "--preset", "none-45"], "'none-45'"),
        (["solve", "--pressure", "0.5MPa", "--model", "lee"], "no model 'lee'"),
        (["solve", "--pressure", "0.5MPa", "--ends", "round"], "'round'"),
        (["solve", "--pressure", "0.5MPa", "--braid-angle", "88deg"], "braid angle is 1.53589"),
        (["solve", "--pressure", "0.5MPa", "--strands", "30.5"], "30.5"),
        (["solve", "--pressure", "0.5MPa", "--length", "3kg"], "wrong kind of unit"),
        (["solve", "--pressure", "1kPa**9**9**9"], "power that is not one digit"),
        (["solve", "--pressure", "0.5MPa", "--model", "thesis", "--ends", "trellis"], "--ends has"),
        (["solve", "--pressure", "0.5MPa", "--load-path", "bulk"], "--load-path has no effect"),
        (["solve", "--pressure", "0.5MPa", "--load-path", "foo"], "'foo'"),
        (["solve", "--pressure", "0.5MPa", "--friction-length", "9um"], "without --direction"),
        (["solve", "--pressure", "0.5MPa", "--direction", "inflating"], "--direction has no effe"),
        (
            ["solve", "--pressure", "0.5MPa", "--direction", "inflating", "--model", "thesis"],
            "--direction has no effect in the model thesis",
        ),
        (["curve", "--friction-length", "9um"], "without --direction"),
        (["curve", "--of", "force", "--load", "2N"], "--load has no effect with --of force"),
        (["curve", "--points", "7", "--out", "a.png"], "--points has no effect on a picture"),
        (["curve", "--pressure", "0kPa"], "pressure is 0 MPa: it must lie in (0"),
        (["curve", "--of", "force", "--pressure", "30kPa"], "pressure is 0.03 MPa"),
        (["fit", "good.csv", "--friction-length", "9um"], "no row of the data has a direction"),
        (["fit", "good.csv", "--model", "thesis", "--ends", "none"], "--ends has no effect"),
        (["fit", "light.csv"], "light.csv: no load is positive in 'load_N', and one is -1 N"),
        (["fit", "good.csv", "--response", "torque"], "torque"),
        (["fit", "good.csv", "--each", "modulus"], "--each needs --shared"),
        (["fit", "good.csv", "--offset", "1mm", "--offset-from-length"], "give one of them"),
        (["fit", "good.csv", "--offset-from-length"], "has no length at a pressure"),
        (["fit", "good.csv", "--compliance", "-1"], "ends compliance is -1 mm/N"),
        (["fit", "short.csv"], "short.csv: row 3: length is -155 mm"),
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
        (
            ["compare", "good.csv", "--model", "lee"],
            "no model 'lee': choose one of energy, thesis, ",
        ),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(run, tmp_path, arguments, said):
    (tmp_path / "bad.csv").write_text("pressure_kPa,length_mm\n1,44\nx,43\n", encoding="utf-8")
    good = "pressure_kPa,length_mm\n200,44\n300,43\n400,42\n"
    (tmp_path / "good.csv").write_text(good, encoding="utf-8")
    for name, row in (("heavy", "300,2,500"), ("light", "300,2,-1"), ("short", "300,200,0")):
        text = f"pressure_kPa,contraction_mm,load_N\n200,1,0\n{row}\n400,3,0\n"
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    before = {path.name for path in tmp_path.iterdir()}
    code, out, err = run(*arguments)
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1
    assert said in err
    assert {path.name for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            ("--pressure", "20000psi"),
            "pressure is 137.895 MPa: it must lie in [0, 20] MPa; is it in kPa? "
            "(20000psi was given, [0, 2900.75] psi is legal)",
        ),
        (("--pressure", "3psi", "--of", "force"), "(3psi was given)"),
        (
            ("--braid-angle", "1deg"),
            "is 0.0174533 rad: it must lie in [0.0872665, {high}] rad (1deg was given, [5, ",
        ),
        (
            ("--pressure", "200MPa"),
            "pressure is 200 MPa: it must lie in [0, 20] MPa; is it in kPa?\n",
        ),
    ],
)
def test_an_error_has_the_value_as_it_was_typed(run, given, message):
    high = f"{preset('effector-45').legal_range('braid_angle')[1]:g}"
    code, _, told = run("curve", *given)
    assert code == 2
    assert message.replace("{high}", high) in told


MUSCLE_FILE = """
muscle: {length: 83 mm, outer_radius: 5 mm, inner_radius: 4 mm, braid_angle: 23 deg, strands: 40}
model: tondu-lopez
constants: {kappa1: -0.5, kappa2: 1.2}
ends: {offset: 0.3 mm}
"""


def test_a_muscle_file_is_where_muscle_model_constants_and_ends_begin(run, tmp_path):
    (tmp_path / "m.yaml").write_text(MUSCLE_FILE)
    file = read_muscle(tmp_path / "m.yaml")
    command = ("solve", "--muscle", "m.yaml", "--pressure", "300kPa", "--json")
    code, out, err = run(*command)
    said = json.loads(out)
    assert (code, said["model"], said["preset"]) == (0, "tondu-lopez", None)
    assert said["constants"]["kappa2"] == 1.2
    assert "strands" in said["muscle"] and "modulus_MPa" not in said["muscle"]
    assert said["contraction_mm"] == pytest.approx(float(file.build().contraction(0.3)))
    assert "note: the model tondu-lopez does not use: inner radius, strands" in err
    other = json.loads(run(*command, "--set", "kappa2=1", "--length", "9cm")[1])
    own = MODELS["tondu-lopez"](file.muscle.replace(length=90.0), kappa1=-0.5, kappa2=1.0)
    assert other["contraction_mm"] == pytest.approx(0.3 + float(own.contraction(0.3)))
    chou = json.loads(run(*command, "--model", "chou")[1])
    assert chou["contraction_mm"] == pytest.approx(
        float(MODELS["chou"](file.muscle).contraction(0.3))
    )
    for options, expected in (
        (
            ("--preset", "effector-45"),
            "muscle is given more than once, as 'effector-45' and 'm.yaml'",
        ),
        (("--model", "energy"), "the model energy needs the muscle's modulus: give --modulus"),
        (("--model", "kothera-energy"), "muscle's strand-radius, strand-modulus: give"),
    ):
        code, out, err = run(*command[:-1], *options)
        assert (code, out) == (2, "") and expected in err
    code, _, err = run("solve", "--muscle", "nowhere.yaml", "--pressure", "1kPa")
    assert code == 2 and "cannot read nowhere.yaml" in err


def test_length_and_radius_alone_inherit_nothing(run):
    size = ("solve", "--length", "83mm", "--outer-radius", "5mm", "--pressure", "0.3MPa")
    code, _, err = run(*size)
    assert code == 2 and "needs the muscle's inner-radius, braid-angle, modulus" in err
    code, out, _ = run(*size, "--braid-angle", "23deg", "--model", "gaylord-1", "--json")
    said = json.loads(out)
    assert (code, said["preset"], said["muscle"]["gap_mm"]) == (0, None, 0.0)
    festo = ("solve", "--preset", "festo-10", "--length", "83mm", *size[5:])
    festo += ("--braid-angle", "23deg", "--model", "gaylord-1", "--json")
    of_festo = json.loads(run(*festo)[1])
    assert of_festo["contraction_mm"] == said["contraction_mm"]


def test_presets_are_listed_with_their_sources(run):
    code, out, _ = run("presets", "--json")
    said = json.loads(out)["presets"]
    assert code == 0 and set(said) == set(PRESETS)
    assert said["festo-20"]["outer_radius_mm"] == 10.0
    assert "braid_angle" in said["festo-20"]["unset"]
    text = run("presets")[1]
    assert all(f"{name}: length" in text and item.source in text for name, item in PRESETS.items())
    assert "braid angle 36 deg" in text


def test_a_table_with_geometry_needs_its_muscle(run, tmp_path):
    rows = "".join(f"{p},{x},{200.0 + p - 10.0 * x},a,83\n" for p in (100, 300) for x in (0, 5, 9))
    (tmp_path / "d.csv").write_text(
        f"pressure [kPa],contraction [mm],load [N],specimen,rest length [mm]\n{rows}"
    )
    command = ("compare", "d.csv", "--model", "gaylord-1")
    code, out, err = run(*command)
    assert (code, out) == (2, "") and "the geometry of its specimens (rest length)" in err
    for named in (("--preset", "festo-10"), ("--length", "1m", "--outer-radius", "5mm")):
        assert run(*command, *named, "--braid-angle", "23deg")[0] == 0


def test_a_bare_pressure_in_kPa_is_asked_about(run):
    code, _, err = run("solve", "--pressure", "300")
    assert code == 2 and "pressure is 300 MPa: it must lie in [0, 20] MPa; is it in kPa?" in err


def test_a_fitted_angle_is_in_degrees(run, table):
    command = ("fit", table, "--free", "braid-angle,modulus", "--anyway")
    text = run(*command)[1]
    said = json.loads(run(*command, "--json")[1])
    found = said["estimates"]["braid_angle"]
    assert found["unit"] == "rad"
    angle = math.degrees(found["value"])
    assert re.search(rf"^braid_angle +{angle:.4g} deg ", text, re.MULTILINE)


def test_a_muscle_that_gets_longer_has_a_curve_of_force(run):
    size = ("--length", "80mm", "--outer-radius", "5mm", "--braid-angle", "70deg")
    command = ("curve", "--model", "gaylord-1", *size, "--of", "force", "--points", "5")
    code, out, err = run(*command)
    assert (code, err) == (0, "")
    rows = list(csv.DictReader(io.StringIO(out)))
    assert float(rows[0]["force_N"]) < 0.0  # it pushes when blocked
    assert float(rows[-1]["contraction_mm"]) < 0.0
    assert float(rows[-1]["force_N"]) == pytest.approx(0.0, abs=1e-9)


def test_muscles_side_by_side_share_the_load(run):
    """Three under thrice the load contract as one does, and pull three times as much."""
    ask = ("--pressure", "0.5MPa", "--json")
    one, three = (
        json.loads(run("solve", *ask, "--load", load, *more)[1])
        for load, more in (("0.5N", ()), ("1.5N", ("--side-by-side", "3")))
    )
    assert three["contraction_mm"] == pytest.approx(one["contraction_mm"], abs=1e-9)
    assert three["side_by_side"] == 3 and three["load_N"] == 1.5
    assert {**three, "side_by_side": 0}.keys() == {**one, "side_by_side": 0}.keys()
    curve, bundle = (
        json.loads(run("curve", "--of", "force", *ask, *more)[1])["columns"]
        for more in ((), ("--side-by-side", "3"))
    )
    for name in ("force_N", "stiffness_N_per_mm"):
        assert bundle[name] == pytest.approx([3.0 * value for value in curve[name]])
    for chosen in (("--model", "chou"), ("--model", "energy")):  # from where one holds its share
        lines = [
            json.loads(run("curve", *ask, *chosen, "--load", load, *more)[1])["columns"]
            for load, more in (("0.5N", ()), ("1.5N", ("--side-by-side", "3")))
        ]
        for name, values in lines[0].items():
            assert lines[1][name] == pytest.approx(values, abs=1e-8)
    code, _, err = run("solve", "--pressure", "0.5MPa", "--side-by-side", "0")
    assert code == 2 and "side by side is 0: it must" in err
    code, _, err = run("solve", "--pressure", "0.5MPa", "--model", "thesis", "--side-by-side", "2")
    assert code == 2 and "which has no response to a load" in err

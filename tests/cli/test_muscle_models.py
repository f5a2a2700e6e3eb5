"""``bozzini muscle`` with the models of the catalogue: listed, solved, fitted, ranked."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.muscle import (
    MODELS,
    EndEffects,
    Measurements,
    Muscle,
    preset,
    write_measurements,
)
from tests.muscle.models.catalogue import SURVEY

MUSCLE = preset("effector-45")
SLOW = pytest.mark.slow


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
    pressure, load = np.repeat(np.linspace(0.15, 0.8, 10), 2), np.tile([0.0, 0.2], 10)
    contraction = MODELS["kothera-balance"](MUSCLE).contraction(pressure, load)
    error = 0.02 * np.random.default_rng(0).normal(size=20)
    data = Measurements(pressure=pressure, contraction=contraction + error, load=load)
    return write_measurements(tmp_path / "data.csv", data)


def test_the_list_is_the_catalogue(run):
    code, out, _ = run("models")
    assert code == 0
    lines = out.splitlines()
    assert [line.split()[0] for line in lines[1:-1]] == list(SURVEY)
    assert lines[-1].startswith(f"{len(SURVEY)} models of the literature: ")
    said = json.loads(run("models", "--json")[1])
    assert [item["name"] for item in said["models"]] == list(SURVEY)
    assert sum(said["counts"].values()) == len(SURVEY)


@pytest.mark.parametrize("name", SURVEY)
def test_a_card_tells_all(run, name):
    code, out, _ = run("models", name)
    card = MODELS[name].card
    assert code == 0
    for words in (card.title, card.reference, card.latex, *card.keywords, *card.errata):
        assert words in out
    said = json.loads(run("models", name, "--json")[1])
    assert (said["equation"], said["status"]) == (card.equation, card.status)


@pytest.mark.parametrize("name", ["gaylord-1", "kothera-balance"])
def test_a_model_without_constants_is_solved(run, name):
    code, out, err = run(
        "solve", "--model", name, "--pressure", "0.5MPa", "--load", "0.1N", "--json"
    )
    said = json.loads(out)
    assert (code, err) == (0, "")
    expected = float(MODELS[name](MUSCLE).contraction(0.5, 0.1))
    assert said["contraction_mm"] == pytest.approx(expected)
    assert said["constants"] == {}


def test_constants_are_set_in_their_unit_or_as_quantities(run):
    options = ("--set", "largest_force=2N", "--set", "largest-contraction=1cm",
               "--set", "test_pressure=500kPa")  # fmt: skip
    command = ("solve", "--model", "andrikopoulos", "--pressure", "0.3MPa", "--load", "0.2N")
    code, out, _ = run(*command, *options, "--json")
    said = json.loads(out)
    assert code == 0
    given = {"largest_force": 2.0, "largest_contraction": 10.0, "test_pressure": 0.5}
    assert said["constants"] == pytest.approx(given)
    model = MODELS["andrikopoulos"](MUSCLE, **given)
    assert said["contraction_mm"] == pytest.approx(float(model.contraction(0.3, 0.2)))
    code, out, _ = run("curve", "--model", "andrikopoulos", *options, "--points", "3", "--json")
    columns = json.loads(out)["columns"]
    expected = model.contraction(columns["pressure_MPa"])
    assert columns["contraction_mm"] == pytest.approx(expected)


def test_friction_has_a_direction(run):
    command = ("solve", "--model", "tondu-lopez", "--pressure", "0.5MPa", "--json",
               "--set", "kappa1=0", "--set", "kappa2=1", "--load", "0.1N")  # fmt: skip
    up, down = (
        json.loads(run(*command, "--set", "friction=0.001", "--direction", way)[1])
        for way in ("inflating", "deflating")
    )
    assert up["contraction_mm"] < down["contraction_mm"]
    code, _, err = run(*command, "--direction", "inflating")
    assert code == 2
    assert "--direction has no effect in the model tondu-lopez without friction" in err


def test_friction_is_friction_at_any_pressure(run):
    command = ("solve", "--model", "tondu-lopez", "--set", "kappa1=0", "--set", "kappa2=1",
               "--direction", "inflating", "--pressure", "0kPa")  # fmt: skip
    assert run(*command, "--set", "friction=0.01")[0] == 0
    code, _, err = run(*command, "--set", "friction=0")
    assert (code, err.count("--direction has no effect")) == (2, 1)
    # Whose strain factor is legal at 1 kPa, but at no typical pressure.
    steep = ("solve", "--model", "tondu-lopez", "--set", "kappa1=1", "--set", "kappa2=-0.5",
             "--set", "pressure_unit=10kPa", "--direction", "inflating")  # fmt: skip
    assert run(*steep, "--pressure", "1kPa")[0] == 0
    code, _, err = run(*steep, "--pressure", "20MPa")
    assert code == 2 and "strain factor k of the model tondu-lopez" in err


def test_a_word_is_a_choice(run):
    command = ("solve", "--model", "davis-caldwell", "--pressure", "0.5MPa", "--json",
               "--set", "kappa1=0", "--set", "kappa2=1")  # fmt: skip
    said = json.loads(run(*command, "--set", "scale=radii")[1])
    assert said["constants"]["scale"] == "radii"


def test_fit_finds_constants(run, table):
    code, out, _ = run("fit", table, "--model", "kothera-balance", "--json")
    said = json.loads(out)
    assert code == 0
    assert said["estimates"]["modulus"]["value"] == pytest.approx(MUSCLE.modulus, rel=0.02)
    code, out, _ = run("fit", table, "--model", "tondu-lopez", "--free", "kappa1,kappa2",
                       "--bound", "kappa2=0.5:0.6", "--set", "friction=0", "--json")  # fmt: skip
    said = json.loads(out)
    assert set(said["estimates"]) == {"kappa1", "kappa2"}
    assert 0.5 <= said["estimates"]["kappa2"]["value"] <= 0.6
    assert said["estimates"]["kappa1"]["unit"] == ""


@pytest.mark.slow
def test_fit_holds_what_the_data_do_not_distinguish(run, table):
    _, text, _ = run("fit", table, "--model", "andrikopoulos")
    assert "test_pressure: held" in text
    assert "largest_force" in text and " N " in text


def test_compare_ranks(run, table, tmp_path):
    models = ("gaylord-1", "kothera-balance", "wang")
    options = [word for name in models for word in ("--model", name)]
    code, out, err = run("compare", table, *options, "--fit", "--out", "rank.png", "--json")
    said = json.loads(out)
    assert (code, err) == (0, "")
    assert said["models"][0]["model"] == "kothera-balance"
    assert said["models"][0]["fitted"]["modulus"] == pytest.approx(MUSCLE.modulus, rel=0.02)
    assert (said["ranked_by"], said["folds"]) == ("aicc", 5)
    values = [row["aicc"] for row in said["models"]]
    assert values == sorted(values)
    assert "it is in Wang" in said["refusals"]["wang"]
    assert (tmp_path / "rank.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.slow
def test_compare_ranks_by_the_rows_left_out(run, table):
    options = [
        w
        for m in ("gaylord-1", "chou", "kothera-balance", "itto-b", "wang")
        for w in ("--model", m)
    ]
    code, text, _ = run("compare", table, *options, "--fit", "--by", "cv", "--folds", "3")
    assert code == 0
    assert text.splitlines()[1].startswith("kothera-balance")
    assert "not fitted: wang: " in text


def test_compare_without_a_model_fits_and_ranks_all(run, table, monkeypatch):
    few = {name: MODELS[name] for name in ("gaylord-1", "kothera-balance", "wang")}
    monkeypatch.setitem(MODELS.__dict__, "own", few)
    said = json.loads(run("compare", table, "--json")[1])
    assert said["ranked_by"] == "aicc"
    assert [row["model"] for row in said["models"]] == ["kothera-balance", "gaylord-1"]
    assert said["models"][0]["fitted"] and said["models"][0]["left_out_mm"] > 0.0
    assert set(said["refusals"]) == {"wang"}


def test_compare_without_a_fit_takes_what_is_set(run, table):
    options = ("--model", "chou", "--model", "tondu-lopez", "--set", "kappa1=0", "--json")
    code, out, _ = run("compare", table, *options, "--set", "kappa2=1")
    said = json.loads(out)
    assert code == 0
    assert {row["model"] for row in said["models"]} == {"chou", "tondu-lopez"}
    said = json.loads(run("compare", table, *options)[1])
    assert "must be given kappa2" in said["refusals"]["tondu-lopez"]


def test_a_constant_of_one_of_several_models(run, table):
    options = ("--model", "itto-b", "--model", "tondu-lopez", "--json")
    code, out, _ = run("compare", table, *options, "--set", "itto-b.kappa1=0.5",
                       "--set", "itto-b.kappa2=0", "--set", "tondu-lopez.kappa1=-0.4",
                       "--set", "tondu-lopez.kappa2=1.2")  # fmt: skip
    said = json.loads(out)
    assert code == 0
    assert said["set"] == {
        "itto-b": {"kappa1": 0.5, "kappa2": 0.0}, "tondu-lopez": {"kappa1": -0.4, "kappa2": 1.2},
    }  # fmt: skip
    assert len(said["models"]) == 2
    command = ("solve", "--model", "meller", "--pressure", "0.5MPa", "--json")
    values = ("kappa1=9", "kappa2=1", "kappa3=0.05", "pressure-unit=2kPa")
    one, other = (
        run(*command, *(word for value in values for word in ("--set", mark + value)))[1]
        for mark in ("", "meller.")
    )
    assert json.loads(one) == json.loads(other)
    assert json.loads(one)["constants"]["pressure_unit"] == pytest.approx(0.002)


def test_the_list_loads_no_other_room():
    said = "import sys\nfrom bozzini.cli.main import main\nmain(['muscle', 'models'])\n"
    said += "print(*sys.modules, sep='\\n', file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)
    loaded = done.stderr.split()
    assert "bozzini.muscle.models" in loaded
    rooms = {name.split(".")[1] for name in loaded if name.startswith("bozzini.")}
    assert not rooms & {"view", "duct", "motion", "anatomy", "effector", "continuum"}


@pytest.mark.parametrize(
    ("names", "kind", "load"),
    [
        (["gaylord-1"], "contraction", 0.0),
        (["gaylord-1"], "phases", 0.0),
        (["gaylord-1", "braid-tension"], "angle", 0.1),
        *(
            pytest.param(["meller", "gaylord-1", "braid-tension"], kind, load, marks=SLOW)
            for kind in ("contraction", "angle", "phases")
            for load in (0.0, 0.1)
        ),
    ],
)
def test_a_curve_begins_where_the_model_has_an_answer(run, names, kind, load):
    guess = MODELS["meller"].guess_parameters(MUSCLE)
    constants = [word for key, value in guess.items() for word in ("--set", f"{key}={value!r}")]
    for name in names:
        if name == "braid-tension" and not load:
            continue
        given = constants if name == "meller" else []
        command = ("curve", "--model", name, *given, "--of", kind, "--load", f"{load}N")
        code, out, err = run(*command, "--points", "5", "--json")
        assert (code, err) == (0, "")
        columns = json.loads(out)["columns"]
        model = MODELS[name](MUSCLE, **(guess if given else {}))
        first, *_, last = columns["pressure_MPa"]
        assert last == pytest.approx(0.8)
        lowest = model.pressure_limits[0]
        assert first == pytest.approx(lowest) if not load else first >= lowest
        assert columns["contraction_mm"] == pytest.approx(
            model.contraction(columns["pressure_MPa"], load)
        )
        if load:
            assert not model.try_contraction(max(lowest, 0.99 * first), load)[1]
        assert run(*command, "--out", f"{name}.png")[:2] == (0, f"{name}.png: {kind}\n")


SOLVE = ("solve", "--pressure", "0.5MPa", "--model")
MANY = ["--model", "itto-b", "--model", "tondu-lopez", "--model", "chou"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["models", "lee"], "no model 'lee': choose one of energy, thesis, gaylord-1"),
        (["models", "energy"], "has no card"),
        ([*SOLVE, "lee"], "no model 'lee': choose one of energy, thesis, gaylord-1"),
        ([*SOLVE, "tondu-lopez"], "must be given kappa1, kappa2: the survey has no values"),
        ([*SOLVE, "tondu-lopez", "--set", "kappa1"], "--set is 'kappa1': it must be NAME=VALUE"),
        ([*SOLVE, "tondu-lopez", "--set", "kappa1=x"], "kappa1 is 'x': it must be a number"),
        ([*SOLVE, "tondu-lopez", "--set", "kappa1=nan", "--set", "kappa2=1"], "kappa1 of the"),
        ([*SOLVE, "tondu-lopez", "--set", "kappa1=1e9", "--set", "kappa2=1"], "[-100, 100]"),
        ([*SOLVE, "tondu-lopez", "--set", "kappa1=1", "--set", "kappa1=2"], "more than once"),
        ([*SOLVE, "tondu-lopez", "--set", "colour=1"], "the model tondu-lopez takes kappa1, kapp"),
        ([*SOLVE, "energy", "--set", "kappa1=1"], "the model energy takes no constants"),
        ([*SOLVE, "ball", "--set", "n_layers=2.5"], "it must be a whole number in [1, 1000]"),
        ([*SOLVE, "chou", "--set", ".kappa1=1"], "it must be NAME=VALUE or MODEL.NAME=VALUE"),
        ([*SOLVE, "itto-b", "--set", "itto-b.kappa1=1", "--set", "kappa1=1"], "more than once"),
        ([*SOLVE, "itto-b", "--set", "chou.kappa1=1"], "not among those taken: it must be itto-b"),
        ([*SOLVE, "itto-b", "--set", "lee.kappa1=1"], "model 'lee', which is not known"),
        (["compare", "data.csv", *MANY, "--set", "kappa1=1"],
         "name the model, as in itto-b.kappa1=VALUE; they are itto-b, tondu-lopez"),
        (["compare", "data.csv", *MANY, "--set", "chou.kappa1=1"], "model chou takes no constants"),
        (["compare", "data.csv", *MANY, "--set", "itto-b.kappa1=1e9"], "lie in [0, 100]"),
        (["compare", "data.csv", "--model", "itto-b", "--set", "kappa1=1e9"], "lie in [0, 100]"),
        (["compare", "data.csv", "--model", "davis-caldwell", "--set", "scale=big"],
         "must be one of areas, radii"),
        (["compare", "data.csv", "--set", "kappa1=1"], "name the model, as in tondu-lopez."),
        (["curve", "--model", "braid-tension"],
         "load is 0 N: at a pressure of 0.8 MPa it must lie in [0.00"),
        ([*SOLVE, "andrikopoulos", "--set", "largest_force=2mm"], "2mm"),
        ([*SOLVE, "schulte", "--set", "friction=0.1"], "must be given the law inflation_pressure"),
        ([*SOLVE, "schulte", "--set", "inflation_pressure=1"], "is a law, a function of radius"),
        ([*SOLVE, "davis-caldwell", "--set", "scale=big", "--set", "kappa1=0", "--set", "kappa2=1"],
         "must be one of areas, radii"),
        ([*SOLVE, "chou", "--modulus", "1MPa"], "--modulus has no effect in the model chou"),
        (["compare", "data.csv", "--model", "chou", "--by", "bic"], "--by has no effect"),
        (["compare", "data.csv", "--model", "chou", "--folds", "3"], "--folds has no effect"),
        (["compare", "data.csv", "--fit", "--folds", "1"], "folds is 1"),
        (["compare", "data.csv", "--fit", "--folds", "99"], "there are 20 different"),
        (["compare", "data.csv", "--fit", "--seed", "-1"], "seed is -1"),
        (["fit", "data.csv", "--model", "itto-b", "--bound", "kappa1=a:b"], "kappa1 is 'a'"),
        (["fit", "data.csv", "--model", "gaylord-1"], "no parameter is free"),
        (["fit", "data.csv", "--model", "wang"], "it is in Wang"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line(run, table, arguments, said):
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert said in err


SPECIMENS = MODELS["chou"], (83.0, 132.0, 182.0)
OF_TEN = ("--outer-radius", "5mm", "--inner-radius", "4mm", "--braid-angle", "25deg")


@pytest.fixture
def isometric(tmp_path):
    """Write forces of three specimens; their lengths without load are known at 620 kPa."""
    muscle = Muscle(length=83.0, outer_radius=5.0, inner_radius=4.0, braid_angle=np.radians(23.0))
    rows = ["pressure [kPa],contraction [mm],load [N],specimen,rest length [mm],"
            "length at 620 kPa [mm]"]  # fmt: skip
    for index, length in enumerate(SPECIMENS[1]):
        ends = EndEffects(offset=0.3 * index, compliance=0.01)
        model = ends.mount(SPECIMENS[0](muscle.replace(length=length)))
        free = length - float(model.contraction(0.62))
        for pressure in np.linspace(0.1, 0.6, 6):
            for x in np.linspace(0.0, 0.12, 4) * length:
                force = float(model.force(pressure, x))
                rows.append(f"{1e3 * pressure},{x},{force},m{index},{length},{free}")
    (tmp_path / "iso.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return "iso.csv"


def test_a_fit_of_forces_predicts_a_muscle_that_was_not_measured(run, isometric, tmp_path):
    fit = ("fit", isometric, "--model", "chou", "--length", "83mm", *OF_TEN)
    code, out, err = run(*fit, "--shared", "braid-angle,compliance", "--offset-from-length",
                         "--out", "fit.yaml", "--json")  # fmt: skip
    assert (code, err) == (0, "")
    said = json.loads(out)
    assert said["response"] == "force" and said["sigma_N"] < 1e-4
    assert said["estimates"]["braid_angle"]["value"] == pytest.approx(np.radians(23.0), rel=1e-6)
    assert said["estimates"]["compliance"]["value"] == pytest.approx(0.01, rel=1e-4)
    code, out, _ = run("predict", "fit.yaml", isometric, "--json")
    table = json.loads(out)
    assert code == 0 and table["rms_N"] < 1e-3 and len(table["force_N"]) == 72
    code, out, _ = run("predict", "fit.yaml", "--rest-length", "150mm", "--pressure", "400kPa",
                       "--contraction", "5mm", "--offset", "x")  # fmt: skip
    assert code == 2
    state = ("--pressure", "400kPa", "--contraction", "5mm")
    one = run("predict", "fit.yaml", "--rest-length", "150mm", *state, "--json")
    muscle = Muscle(length=150.0, outer_radius=5.0, inner_radius=4.0, braid_angle=np.radians(23.0))
    own = SPECIMENS[0](muscle)
    mounted = EndEffects(offset=0.3, compliance=0.01).mount(own)  # the mean of the offsets
    assert json.loads(one[1])["force_N"] == pytest.approx(
        [float(mounted.force(0.4, 5.0))], rel=1e-3
    )
    free = 150.0 - float(own.contraction(0.62)) - 1.0
    text = f"620kPa={free!r}mm"
    two = run("predict", "fit.yaml", "--rest-length", "150mm", "--free-length", text, *state,
              "--json")  # fmt: skip
    mounted = EndEffects(offset=1.0, compliance=0.01).mount(own)
    assert json.loads(two[1])["force_N"] == pytest.approx(
        [float(mounted.force(0.4, 5.0))], rel=1e-3
    )
    assert run("predict", "fit.yaml", isometric, "--out", "p.csv")[0] == 0
    assert (tmp_path / "p.csv").read_text(encoding="utf-8").count("\n") == 73


@SLOW
def test_each_specimen_has_its_own_and_a_ranking_leaves_one_out(run, isometric):
    fit = ("fit", isometric, "--model", "chou", "--length", "83mm", *OF_TEN)
    code, out, _ = run(*fit, "--shared", "braid-angle,compliance", "--each", "offset", "--json")
    values = {name: item["value"] for name, item in json.loads(out)["estimates"].items()}
    assert code == 0
    for index in range(3):
        assert values[f"offset[m{index}]"] == pytest.approx(0.3 * index, abs=1e-4)
    code, out, _ = run("compare", isometric, "--model", "chou", "--model", "gaylord-1", "--fit",
                       "--length", "83mm", *OF_TEN, "--free", "braid-angle,compliance",
                       "--offset-from-length", "--leave-out", "specimen", "--json")  # fmt: skip
    said = json.loads(out)
    assert code == 0
    first = said["models"][0]
    assert first["model"] == "chou" and first["left_out_N"] < 1e-3
    assert set(first["left_out_each"]) == {"m0", "m1", "m2"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("predict", "none.yaml"), "none.yaml"),
        (("predict", "fit.yaml", "--pressure", "1kPa"), "--contraction is missing"),
        (("predict", "fit.yaml", "iso.csv", "--pressure", "1kPa"), "no effect with a table"),
        (("predict", "fit.yaml", "--pressure", "1kPa", "--load", "1N"), "is what is predicted"),
        (("predict", "fit.yaml", "iso.csv", "--level", "2"), "level is 2"),
        (("predict", "fit.yaml", "iso.csv", "--free-length", "5mm"), "PRESSURE=LENGTH"),
    ],
)
def test_wrong_predictions_are_one_line(run, isometric, arguments, words):
    run("fit", isometric, "--model", "chou", "--length", "83mm", *OF_TEN, "--free", "braid-angle",
        "--out", "fit.yaml")  # fmt: skip
    code, out, err = run(*arguments)
    assert code == 2 and out == ""
    assert words in err and len(err.splitlines()) == 1

"""Models as C and as Python: the same numbers as the model; tables: the same force."""

from __future__ import annotations

import ctypes
import importlib.util
import shutil
import subprocess

import numpy as np
import pandas
import pytest

from bozzini.cli.main import main
from bozzini.errors import BozziniError, InputError
from bozzini.muscle import (
    MODELS,
    Bundle,
    EndEffects,
    EnergyMuscle,
    ScaledMuscle,
    export_muscle,
    preset,
)

MUSCLE = preset("effector-45", dead_length=3.0)
PRESSURES = np.array([0.1, 0.3, 0.8])
CONTRACTIONS = np.linspace(-3.0, 12.0, 7)
LOADS = np.array([-0.5, 0.0, 0.3, 1.0, 30.0])
NAMES = ("muscle_force", "muscle_contraction", "muscle_pressure")


def build(name):
    kind = MODELS[name]
    return kind(MUSCLE, **kind.guess_parameters(MUSCLE))


def load_c(path):
    """Compile a file with all warnings as errors, and return its functions on arrays."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    library = path.with_suffix(".so")
    flags = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-std=c99", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, "-o", library, path, "-lm"], check=True)
    functions = [getattr(ctypes.CDLL(str(library)), name) for name in NAMES]
    for function in functions:
        function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double] * 2
    quiet = np.errstate(all="ignore")  # C compares NaN, which sets a flag
    return [quiet(np.vectorize(function)) for function in functions]


def load_python(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return [getattr(module, name) for name in NAMES]


@np.vectorize
def ask(call, *arguments):
    """Return a model's answer, NaN where it has none."""
    try:
        return float(call(*arguments))
    except BozziniError:
        return np.nan


def check(functions, model, **ways):
    """The code has the answers of the model, and none where it has none."""
    force, contract, inflate = functions
    pressure = PRESSURES[:, None]
    pulls = ask(lambda p, x: model.force(p, x, **ways), pressure, CONTRACTIONS)
    assert force(pressure, CONTRACTIONS) == pytest.approx(pulls, rel=1e-12, abs=1e-12, nan_ok=True)
    held = ask(lambda p, f: model.contraction(p, f, **ways), pressure, LOADS)
    assert np.isfinite(held).any()
    assert contract(pressure, LOADS) == pytest.approx(held, rel=1e-12, abs=1e-12, nan_ok=True)
    # The pressure is the lowest that pulls so, at which the force is that again.
    length = MUSCLE.length - CONTRACTIONS
    found = inflate(pulls, length)
    good = np.isfinite(pulls) & np.isfinite(found)
    asked = ask(lambda f, at: model.pressure(f, at, **ways), pulls, length)
    assert found == pytest.approx(asked, rel=1e-9, abs=1e-9, nan_ok=True)
    assert good.any()
    assert np.all(found[good] <= np.broadcast_to(pressure, pulls.shape)[good] * (1.0 + 1e-9))
    again = force(found, MUSCLE.length - length)
    assert again[good] == pytest.approx(pulls[good], rel=1e-9, abs=1e-10)
    assert np.isnan(force(-0.1, 1.0)) and np.isnan(force(0.3, 44.0)) and np.isnan(force(1e3, 1.0))


FEW = ("gaylord-1", "kothera-balance", "tondu-lopez")
REFUSED = ("trivedi", "ball")  # a root and a sum over layers within the law


@pytest.mark.parametrize("load", [load_c, load_python], ids=["c", "python"])
def test_code_is_the_model(load, tmp_path):
    for name in FEW:
        suffix = ".c" if load is load_c else ".py"
        check(load(export_muscle(build(name), tmp_path / f"{name}{suffix}")), build(name))


@pytest.mark.slow
@pytest.mark.parametrize("load", [load_c, load_python], ids=["c", "python"])
@pytest.mark.parametrize("name", [*MODELS.own])
def test_code_of_every_model_is_the_model_or_refused(load, name, tmp_path):
    path = tmp_path / ("model.c" if load is load_c else "model.py")
    try:
        model = MODELS[name](MUSCLE) if MODELS[name].card is None else build(name)
    except InputError:
        pytest.skip("the model needs a law")
    if name in (*REFUSED, "energy", "thesis"):
        with pytest.raises(InputError, match=r"cannot be written as code, .*: write a table"):
            export_muscle(model, path)
        assert not path.exists()
        return
    if name == "linear-strain":  # its force does not depend on the pressure
        return
    check(load(export_muscle(model, path)), model)


@pytest.mark.parametrize("slack_force", [None, 0.2])
@pytest.mark.parametrize("load", [load_c, load_python], ids=["c", "python"])
def test_code_of_a_mounted_muscle(load, slack_force, tmp_path):
    ends = EndEffects(offset=0.4, compliance=0.05, slack_force=slack_force)
    mounted = ends.mount(build("kothera-balance"))
    path = export_muscle(mounted, tmp_path / ("m.c" if load is load_c else "m.py"))
    force, contract, inflate = load(path)
    held = ask(mounted.contraction, 0.4, LOADS)
    assert contract(0.4, LOADS) == pytest.approx(held, rel=1e-12, nan_ok=True)
    over = np.linspace(-2.0, 11.0, 8)
    pulls = ask(mounted.force, 0.4, over)
    assert force(0.4, over) == pytest.approx(pulls, rel=1e-10, abs=1e-10, nan_ok=True)
    assert np.nanmin(pulls) == 0.2 if slack_force else np.nanmin(pulls) < 0.0
    taut = pulls > 0.2
    assert inflate(pulls[taut], MUSCLE.length - over[taut]) == pytest.approx(0.4, rel=1e-9)


@pytest.mark.parametrize("load", [load_c, load_python], ids=["c", "python"])
def test_every_force_below_the_largest_has_a_pressure(load, tmp_path):
    soft = preset("effector-45", dead_length=3.0, strand_modulus=100.0)
    kind = MODELS["kothera-energy"]
    model = kind(soft, **{**kind.guess_parameters(soft), "friction": 0.0})
    over = np.linspace(0.0, 10.0, 20_001)
    pulls = model.force(over, 2.0)
    most = pulls.max()
    assert 0.0 < over[np.argmax(pulls)] < 9.0  # the strands take more at high pressure
    wanted = most - (most - pulls[0]) * np.geomspace(1e-7, 1.0, 200)[:-1]
    found = model.pressure(wanted, soft.length - 2.0)
    assert model.force(found, 2.0) == pytest.approx(wanted, rel=1e-9)
    assert np.all(found <= over[np.argmax(pulls)] * (1.0 + 1e-3))  # the lowest
    assert not model.try_pressure(most + 1e-3 * (most - pulls[0]), soft.length - 2.0)[1]
    path = export_muscle(model, tmp_path / ("m.c" if load is load_c else "m.py"))
    inflate = load(path)[2]
    assert inflate(wanted, soft.length - 2.0) == pytest.approx(found, rel=1e-6)
    assert np.isnan(inflate(most + 1e-3 * (most - pulls[0]), soft.length - 2.0))


@pytest.mark.parametrize("load", [load_c, load_python], ids=["c", "python"])
def test_code_of_a_muscle_that_would_be_too_long_without_give(load, tmp_path):
    mounted = EndEffects(offset=0.4, compliance=0.05).mount(build("ogden"))
    force, *_ = load(export_muscle(mounted, tmp_path / ("m.c" if load is load_c else "m.py")))
    over = np.array([-20.0, -8.0, -5.0, -3.0])
    pulls = ask(mounted.force, 0.4, over)
    assert np.isnan(pulls).tolist() == [True, False, False, False]
    assert force(0.4, over) == pytest.approx(pulls, rel=1e-9, nan_ok=True)


def test_code_of_compositions_and_of_friction(tmp_path):
    one = build("kothera-balance")
    bundle = Bundle([ScaledMuscle(one, 1.05), build("gaylord-1"), one])
    check(load_c(export_muscle(bundle, tmp_path / "bundle.c")), bundle)
    rubs = build("kothera-energy").replace(friction=0.1)
    way = "inflating"
    check(
        load_python(export_muscle(rubs, tmp_path / "rubs.py", direction=way)), rubs, direction=way
    )
    path = export_muscle(rubs, tmp_path / "rubs.c", direction=way)
    assert "Branch of friction: inflating." in path.read_text(encoding="utf-8")
    code = load_c(path)
    check(code, rubs, direction=way)
    for function in code:
        assert np.isnan(function(np.nan, 1.0)) and np.isnan(function(0.3, np.nan))
        assert np.isnan(function(np.inf, 1.0)) and np.isnan(function(0.3, np.inf))


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_is_the_model(suffix, tmp_path):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    model = EnergyMuscle(MUSCLE)
    path = export_muscle(model, tmp_path / f"table{suffix}", points=9, pressure=0.6)
    table = pandas.read_csv(path) if suffix == ".csv" else pandas.read_parquet(path)
    assert list(table.columns) == ["pressure_MPa", "contraction_mm", "force_N"]
    assert len(table) == 81
    pressure, contraction, force = table.to_numpy().T
    assert pressure.max() == 0.6
    assert contraction.max() == pytest.approx(float(model.contraction(0.6)))
    wanted = ask(model.force, pressure, contraction)
    assert force == pytest.approx(wanted, rel=1e-9, abs=1e-9, nan_ok=True)


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        code = main(["muscle", "export", *arguments])
        return code, *capsys.readouterr()

    return call


def test_the_command(run, tmp_path):
    code, out, _ = run("--model", "chou", "--dead-length", "3mm", "--out", "chou.py")
    assert (code, out) == (0, "chou.py: the model chou\n")
    check(load_python(tmp_path / "chou.py"), MODELS["chou"](MUSCLE))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("--out", "a.c"), "the model energy cannot be written as code, it is no explicit force"),
        (("--model", "chou", "--out", "a.txt"), "a.txt"),
        (("--model", "chou", "--points", "9", "--out", "a.c"), "--points has no effect on code"),
        (("--points", "1", "--out", "a.csv"), "points is 1: it must lie in [2, 1000]"),
        (("--pressure", "0psi", "--out", "a.csv"), "pressure is 0 MPa: it must lie in (0, inf)"),
        (("--model", "thesis", "--out", "a.csv"), "no response to a load"),
        (("--model", "chou"), "--out"),
    ],
)
def test_a_wrong_command_is_one_line(run, tmp_path, given, message):
    code, out, told = run(*given)
    assert (code, out) == (2, "")
    assert message in told and told.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_refused():
    with pytest.raises(InputError, match="it must end in one of .c, .py, .csv, .parquet"):
        export_muscle(build("chou"), "a.f90")
    with pytest.raises(InputError, match="model is 3: it must be a MuscleModel"):
        export_muscle(3, "a.c")

"""``bozzini muscle hysteresis``: from a record to pressures that undo the hysteresis."""

from __future__ import annotations

import csv
import io
import json

import numpy as np
import pytest

from bozzini.cli import muscle_hysteresis
from bozzini.cli.main import main
from bozzini.muscle.loops import OPERATORS, load_loop_model
from tests.muscle.loops.plants import Plant, drift, make_record, make_relays

CUT = 2100
OPTIONS = ("--static", "energy", "--load", "0.3N", "--drift", "log", "--samples", "600")


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        capsys.readouterr()
        code = main(["muscle", "hysteresis", *map(str, arguments)])
        return code, *capsys.readouterr()

    return call


def write(path, **columns):
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return path


@pytest.fixture(scope="module")
def plant():
    return Plant(make_relays())


@pytest.fixture
def record(tmp_path, plant):
    """A record in kPa of a length, not from rest; and what was done and shown after it."""
    whole, pressure, shown = make_record(plant)
    given = {"time [s]": whole.time, "pressure [kPa]": 1e3 * whole.pressure,
             "length [mm]": 60.0 - whole.response}  # fmt: skip
    write(tmp_path / "loop.csv", **{name: values[:CUT] for name, values in given.items()})
    write(tmp_path / "wanted.csv",
          **{"time [s]": whole.time[CUT:], "length [mm]": 60.0 - shown[CUT:]})  # fmt: skip
    return whole, pressure, shown


def read(text):
    rows = list(csv.DictReader(io.StringIO(text)))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def test_fit_carry_and_compensate(run, record, plant, tmp_path):
    """The plant is one of relays with a drift; what it misses is five times less than without."""
    whole, pressure, shown = record
    code, out, err = run("fit", "loop.csv", *OPTIONS, "--out", "fit.yaml", "--plot", "fit.png")
    assert (code, err) == (0, "")
    assert "does not start at rest, but at" in out and "a drift of" in out
    assert (tmp_path / "fit.png").read_bytes()[:4] == b"\x89PNG"

    # carried: the file gives what the library gives
    model = load_loop_model(tmp_path / "fit.yaml")
    history = write(tmp_path / "history.csv", **{"pressure [MPa]": pressure[CUT::30]})
    code, out, err = run("trace", "fit.yaml", history)
    assert (code, err) == (0, "")
    traced = read(out)["contraction_mm"] - model.offset
    carried = model.carry().trace_contraction(pressure[CUT::30], 0.3)
    assert traced == pytest.approx(carried, abs=1e-6)

    # compensated
    code, out, err = run("invert", "fit.yaml", "wanted.csv", "--resume")
    assert (code, err) == (0, "")
    found = read(out)
    edges = np.linspace(0.0, 0.7, 40)
    place = np.digitize(whole.pressure[:CUT], edges)
    mean = [whole.response[:CUT][place == i].mean() for i in range(1, 40)]
    middle = 0.5 * (edges[1:] + edges[:-1])
    plain = np.interp(shown[CUT:], np.maximum.accumulate(mean), middle)
    errors = []
    for given in (plain, found["pressure_MPa"]):
        moved = plant.run(np.concatenate([pressure[:CUT], given]))[CUT:]
        errors.append(np.sqrt(np.mean((moved + drift(whole.time[CUT:]) - shown[CUT:]) ** 2)))
    assert errors[0] > 5.0 * errors[1]


def test_out_of_reach_is_said_with_the_bound(run, record, tmp_path):
    run("fit", "loop.csv", *OPTIONS, "--out", "fit.json")
    write(tmp_path / "far.csv", length_mm=[58.0, 55.0, 40.0, 50.0])
    code, out, _ = run("invert", "fit.json", "far.csv", "--highest", "600kPa", "--json")
    said = json.loads(out)
    assert code == 1 and not said["converged"] and "out of reach" in said["reason"]
    assert said["columns"]["saturated"][2] and said["columns"]["pressure_MPa"][2] == 0.6
    assert not said["columns"]["saturated"][1]
    code, out, _ = run("invert", "fit.json", "far.csv", "--out", "far.png")
    assert code == 1 and "out of reach" in out
    pytest.importorskip("pyarrow")
    import pandas

    run("invert", "fit.json", "far.csv", "--highest", "600kPa", "--out", "far.parquet")
    table = pandas.read_parquet(tmp_path / "far.parquet")
    assert table["pressure_MPa"].tolist() == said["columns"]["pressure_MPa"]


def test_operators_are_those_of_the_library():
    assert tuple(OPERATORS) == muscle_hysteresis.OPERATORS


GOOD = "time [s],pressure [kPa],contraction [mm]\n" + "".join(
    f"{i},{100 * (i % 7)},{i % 7}\n" for i in range(20)
)
BAD = [
    (GOOD.splitlines()[0] + "\n1,100,2\n", (), "the record has 1 sample(s): it must have 10"),
    ("\n".join([GOOD.splitlines()[0], *(f"{i},100,2" for i in range(12))]), (),
     "pressure is 0.1 MPa all along: it must change"),
    (GOOD.replace("\n5,", "\n3,"), (), "time[5] is 3 s after 4 s: it must increase"),
    (GOOD.replace("\n5,500,5", "\n5,nan,5"), (), "pressure is 'nan': it must be a finite number"),
    (GOOD.replace(" [kPa]", ""), (), "column 'pressure' has no unit: write 'pressure [kPa]'"),
    (GOOD.replace("time [s]", "time"), (), "column 'time' has no unit: write 'time [s]'"),
    (GOOD.replace("time [s]", "hour [h]"), (), "there is no column time"),
    (GOOD.replace("contraction [mm]", "angle [deg]"), (), "no column contraction, length or force"),
    (GOOD, ("--hold-out", "2"), "hold out is 2: it must lie in [0, 0.9]"),
    (GOOD, ("--samples", "3"), "samples is 3: it must lie in [20, 100000]"),
    (GOOD, ("--modulus", "1MPa"), "--modulus has no effect without --static"),
    (GOOD, ("--load", "1N", "--contraction", "1mm"), "only one of them is held"),
    (GOOD, ("--out", "a.txt"), "a.txt"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "options", "words"), BAD)
def test_a_bad_input_is_one_line(run, tmp_path, text, options, words):
    (tmp_path / "bad.csv").write_text(text)
    given = () if "--out" in options else ("--out", "fit.yaml")
    code, out, err = run("fit", "bad.csv", *options, *given)
    assert (code, out) == (2, "") and err.count("\n") == 1 and words in err
    assert not list(tmp_path.glob("fit*"))


def test_files_that_are_none_are_one_line(run, tmp_path):
    (tmp_path / "loop.csv").write_text(GOOD)
    run("fit", "loop.csv", "--operator", "friction-band", "--out", "band.yaml")
    for arguments, words in (
        (("invert", "loop.csv", "loop.csv"), "it has no 'kind: bozzini-hysteresis'"),
        (("invert", "band.yaml", "loop.csv"), "the operator friction-band has no inverse: fit one"),
        (("trace", "band.yaml", "none.csv"), "cannot read"),
    ):
        code, out, err = run(*arguments)
        assert (code, out) == (2, "") and err.count("\n") == 1 and words in err

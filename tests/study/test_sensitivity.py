"""Sobol indices: known ones, SciPy's, failures that are never silent, and boxes without them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.stats import sobol_indices

from bozzini.cli.main import main
from bozzini.errors import InputError
from bozzini.io.records import read_record
from bozzini.study import Engine, Sampling, Study, StudySpec, read_rows, run_study
from bozzini.study.factors import draw_shares
from bozzini.study.sensitivity import analyse_rows, analyse_study, find_indices
from tests.study.test_sweep_rows import SERIAL

PLACE = "tests.study.test_sensitivity"
FACTORS = {name: {"range": [-math.pi, math.pi]} for name in ("x", "y", "z")}


def ishigami(x: float, y: float, z: float) -> dict[str, float]:
    return {
        "value": math.sin(x) + 7.0 * math.sin(y) ** 2 + 0.1 * z**4 * math.sin(x),
        "same": 1.0,
    }


def fail_in_a_corner(x: float, y: float, kind: float = 1.0) -> dict[str, float]:
    if (x > 0.8 and y > 0.7) or kind == 3.0:
        raise InputError("x and y are both large")
    return {"value": x + 2.0 * y, "half": 0.5}


def fail_always(x: float) -> float:
    return math.nan


def make_study(function: str = "ishigami", **changes: Any) -> Study:
    given = {
        "format": "bozzini-study-1",
        "job": f"{PLACE}:{function}",
        "factors": FACTORS,
        "sampling": {"method": "saltelli", "count": 256, "seed": 5},
        "outputs": ["value"],
    }
    return Study(read_record(given | changes, StudySpec))


def make_corner(**changes: Any) -> Study:
    factors = {"x": {"range": [0, 1]}, "y": {"range": [0, 1]}}
    return make_study("fail_in_a_corner", **({"factors": factors} | changes))


@pytest.mark.slow
def test_ishigami(tmp_path: Path) -> None:
    sampling = {"method": "saltelli", "count": 2**13, "seed": 7}
    found = analyse_study(
        make_study(sampling=sampling, outputs=["value", "same"]), tmp_path / "out", engine=SERIAL
    )
    indices = found.indices["value"]
    a, b = 7.0, 0.1
    parts = [0.5 * (1.0 + b * math.pi**4 / 5.0) ** 2, a**2 / 8.0, 0.0]
    mixed = 8.0 * b**2 * math.pi**8 / 225.0
    whole = sum(parts) + mixed
    assert indices.first == pytest.approx(np.array(parts) / whole, abs=0.01)
    total = np.array([parts[0] + mixed, parts[1], mixed]) / whole
    assert indices.total == pytest.approx(total, abs=0.01)
    for ends, truth in ((indices.first_interval, parts), (indices.total_interval, total * whole)):
        assert (ends[:, 0] <= np.array(truth) / whole + 1e-3).all()
        assert (ends[:, 1] >= np.array(truth) / whole - 1e-3).all()
    assert np.isnan(found.indices["same"].total).all()  # it does not vary: no zeros
    spread = found.to_dict()["outputs"]["value"]
    assert spread["rows"] == 2**14 and spread["mean"] == pytest.approx(0.5 * a, abs=0.02)
    assert spread["sd"] == pytest.approx(math.sqrt(whole), rel=0.01)


def test_the_estimates_are_those_of_scipy() -> None:
    values = np.random.default_rng(0).normal(size=64 * 5).cumsum()
    rows = values.reshape(64, 5)
    found = find_indices(values, ("a", "b", "c"), level=0.95, seed=0)
    parts = {"f_A": rows[:, 0], "f_B": rows[:, 1], "f_AB": rows[:, 2:].T[:, None, :]}
    other = sobol_indices(func=parts, n=64)
    assert found.total == pytest.approx(other.total_order)
    assert found.first == pytest.approx(other.first_order)


@pytest.mark.parametrize("value", [0.1, 1e5 / 3.0, 0.0])
def test_an_output_that_is_rounded_alone_does_not_vary(value: float) -> None:
    noise = 1e-16 * np.random.default_rng(0).standard_normal(1280)
    found = find_indices(value * (1.0 + noise), ("x", "y", "z"), level=0.95, seed=0)
    assert np.isnan(found.first).all() and np.isnan(found.total_interval).all()


def test_intervals_hold_what_is_true() -> None:
    """Of y = x1 + 2 x2 with independent draws: 0.2 and 0.8, in about 95 of 100 intervals."""
    held = []
    for seed in range(60):
        a, b = np.random.default_rng(seed).random((2, 256, 2))
        mixed = [np.where(np.arange(2) == k, b, a) @ [1.0, 2.0] for k in range(2)]
        values = np.stack([a @ [1.0, 2.0], b @ [1.0, 2.0], *mixed], axis=1).ravel()
        found = find_indices(values, ("x", "y"), level=0.95, seed=0)
        for ends in (found.first_interval, found.total_interval):
            held += [ends[0, 0] <= 0.2 <= ends[0, 1], ends[1, 0] <= 0.8 <= ends[1, 1]]
    assert 0.9 < np.mean(held) <= 0.995


def test_rows_of_the_design_are_a_b_and_their_mixtures() -> None:
    sampling = Sampling(method="saltelli", count=32, seed=3)
    whole = draw_shares(4, sampling, 0, 32 * 6)
    for first, count in ((0, 1), (5, 3), (11, 100)):
        assert np.array_equal(draw_shares(4, sampling, first, count), whole[first : first + count])
    for a, b, *mixed in whole.reshape(32, 6, 4):
        assert (a != b).all()
        assert np.array_equal(mixed, np.where(np.eye(4, dtype=bool), b, a))


@pytest.mark.slow
def test_workers_change_nothing(tmp_path: Path) -> None:
    study = make_study(chunk=100)
    one = analyse_study(study, tmp_path / "one", engine=SERIAL)
    two = analyse_study(make_study(chunk=37), tmp_path / "two", engine=Engine(workers=2))
    assert one.to_dict() == two.to_dict()


def test_a_row_that_fails_is_refused_by_name(tmp_path: Path) -> None:
    study = make_corner()
    with pytest.raises(InputError, match="has no value .x and y are both large.*indicator") as e:
        analyse_study(study, tmp_path / "out", engine=SERIAL)
    rows = read_rows(tmp_path / "out")
    first = rows[rows["code"] != 0]["row"].iloc[0]
    assert f"row {first} " in str(e.value)
    run_study(make_study("fail_always", factors={"x": {"range": [0, 1]}}), tmp_path / "nan",
              engine=SERIAL)  # fmt: skip
    with pytest.raises(InputError, match="row 0 has no value .an output is not finite"):
        analyse_rows(make_study("fail_always", factors={"x": {"range": [0, 1]}}),
                     read_rows(tmp_path / "nan"))  # fmt: skip


def test_failing_is_an_output_of_its_own(tmp_path: Path) -> None:
    sampling = {"method": "saltelli", "count": 4096, "seed": 2}
    found = analyse_study(
        make_corner(sampling=sampling), tmp_path / "out", engine=SERIAL, failures="indicator"
    )
    assert list(found.indices) == ["failed"] and "no indices of value" in found.note
    p, q = 0.2, 0.3  # of a product of two indicators
    whole = p * q * (1.0 - p * q)
    first = [p * (1 - p) * q**2 / whole, q * (1 - q) * p**2 / whole]
    assert found.indices["failed"].first == pytest.approx(first, abs=0.03)
    assert found.spreads["value"].failed == pytest.approx(2 * 4096 * p * q, rel=0.1)
    whole_study = analyse_study(
        make_corner(factors={"x": {"range": [0, 0.7]}, "y": {"range": [0, 1]}}),
        tmp_path / "none",
        engine=SERIAL,
        failures="indicator",
    )
    assert list(whole_study.indices) == ["value"] and not whole_study.note


def test_a_box_without_failures(tmp_path: Path) -> None:
    sides = {"range": [0, 1]}
    study = make_corner(factors={"x": sides, "y": sides, "kind": {"values": [1, 2, 3]}})
    found = analyse_study(study, tmp_path / "out", engine=SERIAL, failures="box")
    assert found.box is not None and found.box["kind"] == [1.0, 2.0]
    (low, high), (below, above) = found.box["x"], found.box["y"]
    assert (high <= 0.81) != (above <= 0.71)
    assert (high - low) * (above - below) > 0.6  # of the 0.7 or 0.8 that are possible
    variances = np.array([(high - low) ** 2, 4.0 * (above - below) ** 2, 0.0])
    assert found.indices["value"].first == pytest.approx(variances / variances.sum(), abs=0.03)
    assert not found.failures
    bad = make_study("fail_always", factors={"x": {"range": [0, 1]}})
    with pytest.raises(InputError, match="no box"):
        analyse_study(bad, tmp_path / "bad", engine=SERIAL, failures="box")


def test_other_factors_keep_their_kind_in_a_box(tmp_path: Path) -> None:
    study = make_study(
        "fail_in_a_corner",
        factors={"x": {"normal": [0.5, 0.3]}, "y": {"range": [0.1, 2], "scale": "log"}},
    )
    found = analyse_study(study, tmp_path / "out", engine=SERIAL, failures="box")
    assert found.box is not None
    rows = read_rows(max((tmp_path / "out").glob("box-*")))
    for name in ("x", "y"):
        low, high = found.box[name]
        assert rows[name].min() >= low and rows[name].max() <= high
    assert np.median(np.log(rows["y"])) == pytest.approx(np.mean(np.log(found.box["y"])), abs=0.02)


@pytest.mark.parametrize(
    ("sampling", "message"),
    [
        ({"method": "saltelli", "count": 100}, "power of two, such as 128"),
        ({"method": "saltelli"}, "no count"),
        ({"method": "saltelli", "count": 2**29}, "at most"),
    ],
)
def test_designs_that_are_none(sampling: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_study(sampling=sampling)


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "study.yaml", tmp_path / "out"
    study = {
        "format": "bozzini-study-1",
        "job": "effector-design",
        "fixed": {"preset": "prototype"},
        "factors": {
            "offset": {"range": ["3 mm", "4 mm"]},
            "muscle.modulus": {"normal": ["0.56 MPa", "20 kPa"]},
        },
        "sampling": {"method": "saltelli", "count": 64, "seed": 1},
        "outputs": ["largest_amplitude"],
    }
    path.write_text(yaml.safe_dump(study))
    run = ["uncertainty", str(path), "--workers", "1", "--json", "--quiet"]
    assert main(run) == 2 and "--out is missing" in capsys.readouterr().err
    assert main([*run, "--out", str(out)]) == 0
    found = json.loads(capsys.readouterr().out)
    first = found["sobol"]["largest_amplitude_mm"]["first"]
    assert sum(first) == pytest.approx(1.0, abs=0.1)
    assert {"summary.json", "indices.csv", "indices.png", "outputs.png"} < {
        file.name for file in out.iterdir()
    }
    assert main(["uncertainty", str(out), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["sobol"] == found["sobol"]
    path.write_text(yaml.safe_dump(study | {"sampling": {"method": "sobol", "count": 64}}))
    assert main([*run[:-2], "--out", str(tmp_path / "plain")]) == 0
    text = capsys.readouterr().out
    assert "largest_amplitude_mm" in text and "indices need the sampling saltelli" in text
    assert main(["uncertainty", str(out), "--out", str(tmp_path / "plain")]) == 2
    assert "results of another study" in capsys.readouterr().err
    assert main(["uncertainty", str(tmp_path)]) == 2
    assert main([*run, "--out", str(path)]) == 2

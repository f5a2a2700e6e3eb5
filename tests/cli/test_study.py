"""`bozzini study`: run, status, resume, show, export, jobs, schema."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pandas
import pytest
import yaml

from bozzini.cli.main import main

STUDY = {
    "format": "bozzini-study-1",
    "job": "effector-design",
    "fixed": {"preset": "prototype", "deflection": "12 mm"},
    "factors": {
        "offset": {"range": ["1 mm", "4.5 mm"], "levels": 8},
        "segments": {"integers": [10, 15]},
    },
    "sampling": {"method": "grid"},
    "chunk": 10,
}


@pytest.fixture
def results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(STUDY))
    out = tmp_path / "out"
    assert main(["study", "run", str(path), "--out", str(out), "--workers", "1", "--quiet"]) == 0
    assert "48 of 48 rows" in capsys.readouterr().out
    return out


def test_status_and_resume(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "status", str(results), "--json"]) == 0
    status = json.loads(capsys.readouterr().out)
    assert status["done"] == status["rows"] == 48 and status["converged"]
    assert status["feasible"] + sum(status["reasons"].values()) == 48
    (results / "rows" / "part-000002.parquet").unlink()
    assert main(["study", "status", str(results)]) == 1
    assert "38 of 48 rows" in capsys.readouterr().out
    assert main(["study", "resume", str(results), "--workers", "1"]) == 0
    assert main(["study", "status", str(results)]) == 0


def test_show_and_export(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for figure, columns in (
        ("map", "offset_mm,segments,area_mm2"),
        ("map", "offset_mm,segments"),
        ("parallel", "offset_mm,segments,area_mm2"),
        ("pareto", "needed_pressure_MPa,-area_mm2"),
    ):
        picture = results.parent / f"{figure}{len(columns)}.png"
        words = ["--figure", figure, "--columns", columns, "--out", str(picture)]
        assert main(["study", "show", str(results), *words]) == 0
        assert picture.read_bytes()[:4] == b"\x89PNG"
    for suffix in ("csv", "parquet"):
        table = results.parent / f"table.{suffix}"
        assert main(["study", "export", str(results), "--out", str(table)]) == 0
        read = pandas.read_csv(table) if suffix == "csv" else pandas.read_parquet(table)
        assert read["row"].tolist() == list(range(48))
        assert read["feasible"].sum() == pandas.read_parquet(results / "rows")["feasible"].sum()
    capsys.readouterr()
    wrong = ["--columns", "offset_mm,nonsense", "--out", str(results.parent / "x.png")]
    assert main(["study", "show", str(results), *wrong]) == 2
    assert "there is no column 'nonsense'" in capsys.readouterr().err
    assert not (results.parent / "x.png").exists()


def test_provenance(results: Path) -> None:
    manifest = json.loads((results / "study.json").read_text(encoding="utf-8"))
    assert {"bozzini", "numpy", "scipy", "python"} <= set(manifest["versions"])
    assert manifest["ended"] >= manifest["begun"] and len(manifest["key"]) == 64
    assert manifest["columns"]["offset"] == "offset_mm"


def test_jobs_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "jobs"]) == 0
    assert "effector-design" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["status", "resume", "show"])
def test_a_folder_of_nothing_is_one_line(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study", command, str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "no directory of a study" in error
    (tmp_path / "study.json").write_text('{"format": "bozzini-study-result-1"}')
    assert main(["study", command, str(tmp_path)]) == 2
    assert "is missing" in capsys.readouterr().err


def test_no_feasible_row_is_exit_code_1(tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(STUDY | {"constraints": {"area": {"at_most": 1}}}))
    out = str(tmp_path / "out")
    assert main(["study", "run", str(path), "--out", out, "--workers", "1"]) == 1


@pytest.mark.parametrize("package", ["pyarrow", "distributed"])
def test_a_missing_extra_is_one_line(
    package: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(STUDY))
    words = ["--cluster", "local"] if package == "distributed" else []
    assert main(["study", "run", str(path), "--out", str(tmp_path / "out"), *words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and f"'{package}'" in error
    assert not (tmp_path / "out").exists()

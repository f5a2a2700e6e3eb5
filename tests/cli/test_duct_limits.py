"""``bozzini duct limits``: its answer, its picture, its exit codes and its refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from bozzini.cli.duct import limits_command
from bozzini.duct import RoundCones
from bozzini.duct.shape_files import save_shapes
from bozzini.errors import BozziniError
from tests.cli.plan_cases import Tracts


def run(*words: object):
    runner = CliRunner()
    return runner.invoke(limits_command, [*map(str, words), "--quiet"])


@pytest.fixture(scope="module")
def answer(tracts: Tracts, tmp_path_factory: pytest.TempPathFactory):
    picture = tmp_path_factory.mktemp("limits") / "limits.png"
    words = ("--diameter", "6mm", "--link", "1cm", "--json", "--out", picture)
    return run(tracts.volume, *words), picture


@pytest.mark.slow
def test_json(answer) -> None:
    result = answer[0]
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["verdict"] == "passes"
    assert found["link_mm"] == 10.0
    assert found["diameter_mm"] == 6.0
    high = found["link_high_mm"]
    assert 10.0 < found["link_low_mm"] < (float("inf") if high is None else high)
    assert 6.0 < found["diameter_low_mm"] < 16.0 < found["diameter_high_mm"] + 2.0
    assert found["with_link"]["diameter_low_mm"] <= found["diameter_low_mm"] * 1.02
    assert len(found["arc_length_mm"]) == len(found["rigid_mm"]) == len(found["on_line_mm"])
    assert found["input"] == "tube.nii.gz"


@pytest.mark.slow
def test_picture(answer) -> None:
    assert answer[1].read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_surface_and_volume_agree(tracts: Tracts, answer) -> None:
    result = run(tracts.surface, "--diameter", "6mm", "--json")
    found, other = json.loads(result.stdout), json.loads(answer[0].stdout)
    assert result.exit_code == 0
    assert found["diameter_low_mm"] == pytest.approx(other["diameter_low_mm"], abs=2.5)


def test_a_body_too_wide_is_a_negative_answer(tracts: Tracts) -> None:
    result = run(tracts.volume, "--diameter", "30mm", "--link", "5mm")
    assert result.exit_code == 1
    assert "too wide" in result.stdout
    assert "Traceback" not in result.output


@pytest.mark.slow
def test_shapes_from_a_file(tmp_path: Path) -> None:
    centres = np.stack([np.linspace(0, 40, 13), np.zeros(13), np.zeros(13)], axis=1)
    file = save_shapes(RoundCones(centres, np.full(13, 6.0)), tmp_path / "tube.json")
    result = run(file, "--diameter", "5mm", "--link", "12mm")
    assert result.exit_code == 0, result.output
    assert "Links of 12 mm pass." in result.stdout
    for words, match in ((("--labels", "1"), "no labels"), (("--unit", "cm"), "is in mm")):
        error = run(file, *words).exception
        assert isinstance(error, BozziniError)
        assert match in str(error)


@pytest.mark.parametrize("fit", ["", "inscribed", "least squares"])
def test_what_bounds_of_fitted_shapes_are_about_is_told(tmp_path: Path, fit: str) -> None:
    centres = np.stack([np.linspace(0, 40, 13), np.zeros(13), np.zeros(13)], axis=1)
    file = save_shapes(RoundCones(centres, np.full(13, 4.0)), tmp_path / "tube.json", fit=fit)
    picture = tmp_path / "limits.png"
    result = run(file, "--diameter", "9mm", "--link", "15mm", "--out", picture)
    assert result.exit_code == 1, result.output
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "no link passes at all" in result.stdout
    # That there is no room for the body is not the links' fault.
    assert "Links of 15 mm do not pass: the body is too wide." in result.stdout
    assert ("upper bounds do not hold for the tract" in result.stdout) == (fit == "inscribed")
    assert ("no bound holds for the tract" in result.stdout) == (fit == "least squares")
    assert (" of the shapes:" in result.stdout) == (fit != "")


def test_a_picture_that_cannot_be_written_is_told_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "limits.png").mkdir()
    error = run("nothing.stl", "--out", tmp_path / "limits.png", "--force").exception
    assert "is a directory: choose a file" in str(error)


@pytest.mark.parametrize(
    ("words", "match"),
    [
        (("--diameter", "0mm"), r"diameter is 0 mm: it must lie in (0, inf) mm"),
        (("--link", "-1mm"), "link is -1 mm"),
        (("--inflate", "-1mm"), "inflation is -1 mm"),
        (("--out", "limits.txt"), "ends in '.txt'"),
        (("--start", "9"), "start is label 9"),
    ],
)
def test_bad_options(tracts: Tracts, words: tuple[str, ...], match: str) -> None:
    error = run(tracts.volume, *words).exception
    assert isinstance(error, BozziniError)
    assert match in str(error)
    assert "\n" not in str(error)


def test_no_file() -> None:
    assert isinstance(run("nothing.stl").exception, BozziniError)

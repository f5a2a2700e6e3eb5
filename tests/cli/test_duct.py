"""``bozzini duct fit`` and ``bozzini duct show``: files, one JSON object, exit codes, one line."""

from __future__ import annotations

import json
from importlib.metadata import EntryPoint
from typing import NamedTuple

import numpy as np
import pytest

from bozzini.cli.main import COMMANDS, main
from bozzini.duct import DUCT_SHAPES, Polygon, RoundCones
from bozzini.duct.shape_files import load_shapes_file, save_shapes


class Answer(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture
def duct(capsys, monkeypatch):
    monkeypatch.setitem(COMMANDS, "duct", "Fit shapes to a tract.")

    def call(*arguments):
        capsys.readouterr()
        code = main(["duct", *map(str, arguments)])
        return Answer(code, *capsys.readouterr())

    return call


@pytest.fixture(scope="module")
def cones(tmp_path_factory):
    """A file of shapes."""
    folder = tmp_path_factory.mktemp("cones")
    shapes = RoundCones([[0, 0, 0], [2.0, 0, 20.0], [9.0, 0, 38.0]], [5.0, 6.0, 4.0])
    return save_shapes(shapes, folder / "cones.json")


def test_kinds_lists_the_shapes_of_other_packages_beside_ours(duct, monkeypatch):
    point = EntryPoint("torus", "tests.duct.torus:Torus", DUCT_SHAPES.group)
    monkeypatch.setitem(DUCT_SHAPES.__dict__, "plugins", {"torus": point})
    kinds = json.loads(duct("kinds", "--json").out)["kinds"]
    assert list(kinds) == list(DUCT_SHAPES)
    assert kinds["torus"]["package"] == point.value
    assert all(kinds[name]["package"] == "bozzini" for name in DUCT_SHAPES.own)
    shown = duct("kinds")
    assert shown.code == 0
    for name, row in kinds.items():
        assert name in shown.out and row["summary"] and row["summary"] in shown.out


@pytest.mark.slow
def test_fit_writes_a_file_that_can_be_read_and_shown(duct, tracts, tmp_path):
    out = tmp_path / "cones.yaml"
    answer = duct(
        "fit", tracts.folder / "tube.stl", "--as", "cones", "--max-error", "0.5mm",
        "--out", out, "--json", "--quiet",
    )  # fmt: skip
    assert answer.code == 0, answer.err
    told = json.loads(answer.out)
    assert told["reached"] is True and told["reason"] == ""
    assert told["outside_proved_mm"] <= 0.5
    assert told["kept"] == pytest.approx(told["volume_kept_mm3"] / told["volume_true_mm3"])
    assert told["kept"] > 0.75
    file = load_shapes_file(out)
    shapes = file.shapes
    assert file.fit == "inscribed" and file.note == f"{told['pieces']} cones fitted to tube.stl"
    assert isinstance(shapes, RoundCones)
    assert len(shapes.radii) == told["pieces"] + 1
    assert np.median(shapes.radii) == pytest.approx(8.0, abs=1.0)
    picture = tmp_path / "cones.png"
    shown = duct("show", out, "--out", picture)
    assert shown.code == 0, shown.err
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert f"{len(shapes.radii) - 1} cones in " in shown.out


def test_shapes_in_the_plane_are_shown_too(duct, tmp_path):
    save_shapes(Polygon([(0, 0), (8, 0), (8, 3)]), tmp_path / "wedge.json")
    shown = duct("show", tmp_path / "wedge.json", "--out", tmp_path / "wedge.png")
    assert shown.code == 0, shown.err
    assert (tmp_path / "wedge.png").read_bytes().startswith(b"\x89PNG")


def test_fit_tells_people(duct, tracts):
    answer = duct("fit", tracts.folder / "tube.nii.gz", "--as", "cylinders", "--quiet")
    assert answer.code == 0, answer.err
    assert "cylinders keep" in answer.out and "(proved)" in answer.out
    assert "Shapes:" not in answer.out


@pytest.mark.slow
def test_fit_by_least_squares_answers_no(duct, tracts, tmp_path):
    out = tmp_path / "s.json"
    answer = duct(
        "fit", tracts.folder / "tube.stl", "--as", "cones", "--max-error", "0.01mm",
        "--pieces", "12", "--least-squares", "--out", out, "--quiet",
    )  # fmt: skip
    assert answer.code == 1, answer.err
    assert "Not reached: " in answer.out
    assert load_shapes_file(out).fit == "least squares"


def test_show_tells_the_sections_of_a_tract(duct, tracts, tmp_path):
    picture = tmp_path / "tube.svg"
    answer = duct(
        "show", tracts.folder / "tube.nii.gz", "--spacing", "5mm", "--out", picture, "--json"
    )
    assert answer.code == 0, answer.err
    told = json.loads(answer.out)
    count = len(told["arc_length_mm"])
    for name in ("room_mm", "inscribed_radius_mm", "fitted_radius_mm", "area_mm2"):
        assert len(told[name]) == count
    assert np.diff(told["arc_length_mm"]) == pytest.approx(5.0, rel=0.1)
    # The voxels are 1.5 mm.
    assert np.median(told["inscribed_radius_mm"]) == pytest.approx(8.0, abs=1.2)
    assert np.median(told["area_mm2"]) == pytest.approx(np.pi * 64.0, rel=0.15)
    assert "<svg" in picture.read_text(encoding="utf-8")


def test_shapes_are_shown_over_their_tract(duct, tracts, cones, tmp_path):
    picture = tmp_path / "over.png"
    answer = duct("show", cones, "--over", tracts.folder / "tube.stl", "--out", picture, "--quiet")
    assert answer.code == 0, answer.err
    assert picture.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("fit", "no.stl"), "no.stl"),
        (("fit", "TUBE", "--as", "boxes"), "'boxes'"),
        (("fit", "TUBE", "--max-error", "0mm"), "--max-error is 0 mm: it must lie in (0, inf)"),
        (("fit", "TUBE", "--max-error", "1kg"), "kg"),
        (("fit", "TUBE", "--pieces", "0"), "--pieces is 0"),
        (("fit", "no.stl", "--pieces", "100000"), "--pieces is 100000: it must lie in [1, 500]"),
        (("fit", "no.stl", "--out", "FOLDER.json", "--force"), "is a directory: choose a file"),
        (("show", "CONES", "--out", "FOLDER.png", "--force"), "is a directory: choose a file"),
        (("show", "TUBE", "--spacing", "1e-9mm"), "--spacing is 1e-09 mm: it must lie in [0.01"),
        (("fit", "TUBE", "--out", "x.stl"), "must end in .json, .yaml, .yml"),
        (("fit", "TUBE", "--out", "no/x.json"), "is not a directory"),
        (("fit", "TUBE", "--out", "CONES"), "exists already"),
        (("fit", "TUBE", "--pieces", "1"), "cannot follow the centreline"),
        (("show", "CONES", "--out", "x.txt"), "must end in"),
        (("show", "CONES", "--spacing", "2mm"), "--spacing has no effect"),
        (("show", "CONES", "--reverse"), "--reverse has no effect"),
        (("show", "TUBE", "--over", "TUBE"), "--over has no effect"),
        (("show", "no.json"), "No such file"),
    ],
)
def test_wrong_input_is_told_in_one_line(
    duct, tracts, cones, tmp_path, monkeypatch, arguments, message
):
    monkeypatch.chdir(tmp_path)
    names = {"TUBE": tracts.folder / "tube.stl", "CONES": cones}
    for suffix in ("json", "png"):
        names[f"FOLDER.{suffix}"] = tmp_path.parent / f"{tmp_path.name}.{suffix}"
        names[f"FOLDER.{suffix}"].mkdir()
    before = cones.read_bytes()
    answer = duct(*(names.get(word, word) for word in arguments), "--quiet")
    assert answer.code == 2, answer.out
    lines = answer.err.strip().splitlines()
    assert message in lines[-1] and lines[-1].startswith("bozzini: error: ")
    assert "Traceback" not in answer.err
    assert list(tmp_path.iterdir()) == []
    assert cones.read_bytes() == before


def test_wrong_shape_is_named(duct, cones, tmp_path):
    data = json.loads(cones.read_text(encoding="utf-8"))
    data["shapes"][1]["radius"] = -3.0
    wrong = tmp_path / "wrong.json"
    wrong.write_text(json.dumps(data))
    answer = duct("show", wrong, "--json")
    assert answer.code == 2
    assert "shapes[1].radius is -3 mm: it must lie in [1e-06, 1e+06] mm" in answer.err
    assert json.loads(answer.out)["error"]["type"] == "FileFormatError"

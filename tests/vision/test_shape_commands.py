"""``bozzini vision shape`` on the command line: files, reasons, comparison with a model."""

from __future__ import annotations

import csv
import json
import math

import numpy as np
import pytest
from PIL import Image

from bozzini.cli.main import main
from bozzini.vision import write_picture
from bozzini.vision.camera import CameraSet
from tests.vision.sets import PAIR

pytest.importorskip("cv2", reason="the extra 'vision' is not installed")

GIVEN = ["--length", "47mm", "--jobs", "1", "--quiet"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, bent_tube):
    """Give a folder with cameras and the pictures of a pair as they are, and damaged."""
    place = tmp_path_factory.mktemp("shape")
    cameras = CameraSet(names=("cam0", "cam1"), cameras=PAIR)
    cameras.save(place / "cameras.yaml")
    CameraSet(names=("cam0",), cameras=PAIR[:1]).save(place / "one.yaml")
    CameraSet(names=("left", "right"), cameras=PAIR).save(place / "names.yaml")
    curve, pictures = bent_tube
    for i, picture in enumerate(pictures):
        write_picture(picture, place / f"{i}.png")
        grey = picture.bytes
        Image.fromarray(np.repeat(grey[..., None], 3, axis=2)).save(place / f"colour{i}.png")
        Image.fromarray(grey.astype(np.uint16) * 257).save(place / f"deep{i}.png")
        Image.fromarray(grey[:, ::-1]).save(place / f"mirrored{i}.png")
        turned = Image.Exif()
        turned[274] = 6
        Image.fromarray(grey).save(place / f"turned{i}.png", exif=turned)
    Image.fromarray(grey[:300]).save(place / "cut.png")
    (place / "short.png").write_bytes((place / "1.png").read_bytes()[:9000])
    (place / "text.png").write_text("no picture\n")
    lines = [f"bent,{x},{y},{z}" for x, y, z in curve[::19]]
    (place / "model.csv").write_text("\n".join(["pose,x_mm,y_mm,z_mm", *lines]) + "\n")
    return place


def run(folder, rows, *options, code=0):
    """Measure the rows of a table; return the summary and the rows of its answer."""
    table = folder / "table.csv"
    table.write_text("\n".join(["pose,cam0,cam1,note", *rows]) + "\n")
    given = [str(table), "--cameras", str(folder / "cameras.yaml"), "--out", str(folder / "out")]
    assert main(["vision", "shape", *given, *GIVEN, "--force", *options]) == code
    with (folder / "out" / "shape_summary.csv").open() as file:
        return json.loads((folder / "out" / "summary.json").read_text(encoding="utf-8")), list(
            csv.DictReader(file)
        )


def read_tip(row) -> np.ndarray:
    """Return the tip of a row [mm]."""
    return np.array([float(row[f"tip_{axis}_mm"]) for axis in "xyz"])


@pytest.mark.slow
def test_a_pair_that_fails_is_a_row_with_its_reason(folder, bent_tube) -> None:
    reasons = {
        "bent,0.png,1.png,a": "",
        "b,0.png,none.png,b": "there is no such picture",
        "c,0.png,,c": "no picture of camera 'cam1'",
        "d,0.png,cut.png,d": "the picture has 640 x 300 px, its camera has 640 x 400",
        "e,0.png,short.png,e": "cannot be read",
        "f,0.png,text.png,f": "not a picture of a known format",
    }
    summary, rows = run(folder, reasons, code=1)
    assert (summary["ok"], summary["failed"]) == (1, 5)
    for row, (line, reason) in zip(rows, reasons.items(), strict=True):
        assert row["note"] == line[-1] and reason in row["reason"]
        assert row["status"] == ("failed" if reason else "ok")
        assert bool(row["tip_x_mm"]) != bool(reason)
    assert np.linalg.norm(read_tip(rows[0]) - bent_tube[0][-1]) < 0.2
    assert "overlays/0001_cam0.jpg" in summary["files"]
    assert list(summary["inputs"].values()).count(None) == 2


@pytest.mark.slow
def test_a_model_is_compared_in_a_figure_and_tables_may_be_parquet(folder) -> None:
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow", reason="the extra 'tables' is not installed")
    options = ["--model", str(folder / "model.csv"), "--alignment", "world", "--parquet"]
    table = folder / "table.csv"
    table.write_text("pose,cam0,cam1\nbent,0.png,1.png\n")
    given = [str(table), "--cameras", str(folder / "cameras.yaml"), "--out", str(folder / "figure")]
    assert main(["vision", "shape", *given, *GIVEN, *options]) == 0
    summary = json.loads((folder / "figure" / "summary.json").read_text(encoding="utf-8"))
    assert summary["comparison"]["rms_mm"] < 0.2
    assert Image.open(folder / "figure" / "comparison.png").size[0] > 600
    frame = pandas.read_parquet(folder / "figure" / "comparison.parquet")
    assert math.sqrt((frame["distance_mm"] ** 2).mean()) == pytest.approx(
        summary["comparison"]["rms_mm"]
    )


@pytest.mark.slow
def test_pictures_of_other_kinds_give_the_same_and_wrong_ones_none(folder) -> None:
    kinds = ["0.png,1.png", "deep0.png,deep1.png", "colour0.png,1.png", "turned0.png,1.png"]
    kinds += ["1.png,0.png", "mirrored0.png,mirrored1.png", "0.png,0.png"]
    summary, rows = run(folder, [f"{k},{kind}," for k, kind in enumerate(kinds)], code=1)
    for row in rows[1:4]:
        assert np.abs(read_tip(row) - read_tip(rows[0])).max() < 0.01
    assert [row["flags"] for row in rows[:4]] == ["", "", "", "exif_rotated"]
    assert [row["status"] for row in rows[4:]] == ["failed"] * 3
    assert summary["failed"] == 3 and all(row["reason"] for row in rows[4:])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--cameras", "one.yaml"], "1 cameras: a shape needs two"),
        (["--cameras", "names.yaml"], "needs one column 'left'"),
        (["--cameras", "model.csv"], "model.csv"),
        (["--cameras", "none.yaml"], "none.yaml"),
        (["--cameras", "cameras.yaml", "--model", "table.csv"], "needs one column 'x_mm'"),
        (["--cameras", "cameras.yaml", "--model", "model.csv"], "pose 'other' needs two points"),
        (["--cameras", "cameras.yaml", "--diameter", "0mm"], "diameter is 0 mm"),
        (["--cameras", "cameras.yaml", "--base", "front"], "front"),
    ],
)
def test_wrong_input_is_one_line(folder, monkeypatch, capsys, options, said) -> None:
    monkeypatch.chdir(folder)
    (folder / "table.csv").write_text("pose,cam0,cam1\nother,0.png,1.png\n")
    command = ["vision", "shape", "table.csv", *GIVEN, "--out", "wrong"]
    assert main([*command, *options]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and said in err
    assert not (folder / "wrong").exists()

"""``bozzini vision``: boards, calibration and tracking on the command line."""

from __future__ import annotations

import csv
import json
import sys

import numpy as np
import pytest

from bozzini.cli import common
from bozzini.cli.main import main
from bozzini.vision import Picture, StripBoard, load_board, load_cameras, write_picture
from tests.vision.sets import BOARD, PAIR

RINGS = ("--height", "3mm", "--diameter", "1.6mm", "--ring", "2mm")


@pytest.fixture(autouse=True)
def no_lines_of_progress(monkeypatch):
    """Keep a slow machine from adding lines of progress to what the tests read."""
    monkeypatch.setattr(common.LineProgress, "interval", float("inf"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory, pair_pictures):
    """Give a folder with the pictures of a calibration, the board and a table of markers."""
    place = tmp_path_factory.mktemp("vision")
    BOARD.save(place / "board.yaml")
    StripBoard().save(place / "strips.yaml")
    (place / "pictures").mkdir()
    for k, pictures in enumerate(pair_pictures[0][:8]):
        for i, picture in enumerate(pictures):
            write_picture(picture, place / "pictures" / f"cam{i}_{k:02d}.bmp")
    (place / "blank").mkdir()
    for k in range(8):
        blank = Picture(np.full((40, 60), 0.5, np.float32))
        write_picture(blank, place / "blank" / f"{k}.png")
    points = np.linspace([-10.0, 0.0, 20.0], [10.0, 3.0, 30.0], 8)
    rows = np.hstack([camera.project(points) for camera in PAIR])
    lines = ["cam0x1,cam0y1,cam1x1,cam1y1", *(",".join(f"{v:.3f}" for v in row) for row in rows)]
    (place / "markers.csv").write_text("\n".join(lines) + "\n")
    return place


@pytest.fixture(scope="module")
def cameras(folder):
    """Give the file of the calibrated cameras."""
    out = folder / "cameras.yaml"
    given = [str(folder / "pictures"), "--board", str(folder / "board.yaml"), "--jobs", "1"]
    assert main(["vision", "calibrate", *given, "--resamples", "2", "--out", str(out)]) == 0
    return out


@pytest.mark.parametrize(
    ("kind", "options", "corners"),
    [
        ("charuco", [], 70),
        ("strips", ["--rows", "10", "--gap", "2.5cm"], 36),
        ("checkerboard", ["--columns", "8", "--rows", "5", "--check-line", "100.2mm"], 40),
    ],
)
def test_a_board_is_a_page_and_its_description(tmp_path, capsys, kind, options, corners):
    page = tmp_path / "board.pdf"
    assert main(["vision", "board", kind, *options, "--out", str(page), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["corners"] == corners == len(load_board(result["description"]).corners)
    assert page.read_bytes().startswith(b"%PDF")
    assert main(["vision", "board", kind, "--out", str(page)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_calibration_writes_cameras_that_read_back(folder, cameras, capsys):
    whole = load_cameras(cameras)
    assert whole.baseline == pytest.approx(
        np.linalg.norm(PAIR[0].centre - PAIR[1].centre), rel=0.01
    )
    assert len(whole.resamples) == 2
    assert cameras.with_suffix(".png").exists()


def test_a_refused_calibration_writes_no_cameras(folder, tmp_path, capsys):
    out = tmp_path / "cameras.yaml"
    given = [str(folder / "pictures"), "--board", str(folder / "board.yaml"), "--jobs", "1"]
    more = ["--resamples", "0", "--baseline", "200mm", "--json", "--out", str(out)]
    assert main(["vision", "calibrate", *given, *more]) == 1
    result = json.loads(capsys.readouterr().out)
    assert "200.00 mm were expected" in result["reason"]
    assert result["file"] is None
    assert [path.name for path in tmp_path.iterdir()] == ["cameras.png"]


def test_tracking_writes_points_with_units(folder, cameras, tmp_path, capsys):
    out = tmp_path / "out"
    command = ["vision", "track", str(folder / "markers.csv"), "--cameras", str(cameras)]
    assert main([*command, "--out", str(out), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["ok"], result["failed"], result["rows"]) == (8, 0, 8)
    with (out / "points.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {"x_mm", "u_x_mm", "cov_xy_mm2", "residual_px", "status"} <= set(rows[0])
    assert sorted(path.name for path in out.iterdir()) == result["files"]
    assert main([*command, "--out", str(out)]) == 2
    assert main([*command, "--out", str(out), "--force"]) == 0


def test_a_lost_marker_is_exit_code_1(folder, cameras, tmp_path, capsys):
    table = tmp_path / "markers.csv"
    lines = (folder / "markers.csv").read_text(encoding="utf-8").splitlines()
    lines[3] = ",,10,20"
    table.write_text("\n".join(lines) + "\n")
    command = ["vision", "track", str(table), "--cameras", str(cameras)]
    assert main([*command, "--out", str(tmp_path / "out")]) == 1
    assert "row 3, marker 1: not seen by two cameras" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["board", "charuco", "--gap", "3mm", "--out", "b.pdf"], "--gap has no effect"),
        (["board", "strips", "--square", "0mm", "--out", "b.pdf"], "square is 0 mm"),
        (["board", "strips", "--out", "b.png"], ".pdf"),
        (["board", "round", "--out", "b.pdf"], "round"),
        (["calibrate", "none", "--board", "{board}", "--out", "c.yaml"], "no such folder"),
        (["calibrate", "{pictures}", "--board", "none.yaml", "--out", "c.yaml"], "none.yaml"),
        (["calibrate", "{blank}", "--board", "{board}", "--out", "c.yaml"], "0 of 8 views"),
        (["calibrate", "{folder}", "--board", "{board}", "--out", "c.yaml"], "one camera or two"),
        (["calibrate", "{pictures}", "--board", "{board}", "--out", "c.csv"], ".yaml"),
        (["track", "{board}", "--cameras", "{cameras}", "--out", "d"], "markers in its columns"),
        (["track", "{table}", "--cameras", "{board}", "--out", "d"], "unknown field 'kind'"),
        (["length", "{table}", "--board", "{board}", "--out", "d"], "'--height'"),
        (["length", "{table}", "--board", "{board}", *RINGS, "--out", "d"], "before strips"),
        (["length", "{table}", "--board", "{strips}", *RINGS, "--out", "d"], "'image'"),
        (["plan-setup", *RINGS, "--pitch", "0.01mm"], "0 corners"),
        (["plan-setup", *RINGS, "--length", "200mm"], "not both in the picture"),
        (["demo", "--steps", "1", "--out", "d"], "steps is 1"),
        (["track", "none.csv", "--cameras", "{cameras}", "--out", "d"], "none.csv"),
        (["track", "{table}", "--cameras", "{cameras}", "--out", "d", "--markers", "9"], "[1, 6]"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(
    folder, cameras, tmp_path, monkeypatch, capsys, arguments, said
):
    monkeypatch.chdir(tmp_path)
    names = {
        "folder": folder,
        "pictures": folder / "pictures",
        "board": folder / "board.yaml",
        "blank": folder / "blank",
        "table": folder / "markers.csv",
        "cameras": cameras,
        "strips": folder / "strips.yaml",
    }
    given = [word.format(**names) for word in arguments]
    jobs = ["--jobs", "1"] if given[0] == "calibrate" else []
    assert main(["vision", *given, *jobs]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert said in err
    assert list(tmp_path.iterdir()) == []


def test_without_opencv_the_extra_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "cv2", None)
    assert main(["vision", "board", "charuco", "--out", str(tmp_path / "b.pdf")]) == 2
    assert "bozzini[vision]" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []

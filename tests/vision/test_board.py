from __future__ import annotations

import dataclasses
import re

import cv2
import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from bozzini.errors import FileFormatError, InputError
from bozzini.vision import (
    CharucoBoard,
    Checkerboard,
    HungMuscle,
    Picture,
    Scene,
    Sensor,
    StripBoard,
    aim_camera,
    load_board,
    render_picture,
)
from tests.vision.sets import BOARD

STRIPS = StripBoard()
CHESS = Checkerboard(columns=9, rows=6, square=6.0)
LENS = (-0.12, 0.05, 4e-4, -3e-4, 0.0)


def _look(board, *, pitch=0.12, size=(640, 400), aside=(15.0, -10.0), down=(0.0, 1.0, 0.0)):
    middle = np.array([*board.extent, 0.0]) / 2.0
    eye = middle + [*aside, -300.0]
    return aim_camera(eye, middle, focal=300.0 / pitch, size=size, distortion=LENS, down=down)


@pytest.fixture(scope="module")
def charuco():
    camera = _look(BOARD)
    return camera, render_picture(Scene(board=BOARD), camera)


@pytest.mark.parametrize(
    ("board", "down", "least"),
    [
        (BOARD, (0.0, 1.0, 0.0), 70),
        (STRIPS, (1.0, 0.0, 0.0), 50),
        (CHESS, (0.0, 1.0, 0.0), 54),
        (CHESS, (0.1, -1.0, 0.0), 54),
    ],
)
def test_corners_are_found_where_they_are(board, down, least):
    camera = _look(board, down=down, pitch=0.16 if board is STRIPS else 0.12)
    scene = Scene(board=board)
    if board is STRIPS:
        scene = HungMuscle(length=30.0).make_scene(STRIPS)
    found = board.detect(render_picture(scene, camera, seed=1))
    off = found.corners - camera.project(found.points)
    assert len(found.ids) >= least
    assert np.abs(off.mean(axis=0)).max() < 0.03
    assert np.abs(off).max() < 0.15
    assert found.points == pytest.approx(board.corners[found.ids])


def test_the_half_pixel_of_older_detectors_does_no_harm(charuco, monkeypatch):
    """OpenCV before 4.14 returns ChArUco corners shifted by (0.5, 0.5) px (its issue 25539)."""
    camera, picture = charuco
    right = BOARD.detect(picture)
    raw = []

    detector = cv2.aruco.CharucoDetector

    class Shifted:
        def __init__(self, *given):
            self.detector = detector(*given)

        def detectBoard(self, *given, **named):
            corners, ids, *more = self.detector.detectBoard(*given, **named)
            plain = np.asarray(corners).reshape(-1, 2)
            truth = camera.project(BOARD.corners[np.ravel(ids)])
            shift = 0.5 - np.round(2.0 * np.median(plain - truth)) / 2.0  # to the older ones'
            raw.append(plain + shift - truth)
            return np.asarray(corners) + np.float32(shift), ids, *more

    monkeypatch.setattr(cv2.aruco, "CharucoDetector", Shifted)
    found = BOARD.detect(picture)
    assert np.median(raw[0]) == pytest.approx(0.5, abs=0.05)  # what would come without refinement
    off = found.corners - camera.project(found.points)
    assert np.abs(off.mean(axis=0)).max() < 0.03
    assert np.array_equal(found.ids, right.ids)
    assert found.corners == pytest.approx(right.corners, abs=0.02)


def test_the_print_is_the_pattern_that_opencv_knows():
    texels = 20
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    theirs = cv2.aruco.CharucoBoard((11, 8), 6.0, 3.9, dictionary)
    image = theirs.generateImage((66 * texels, 48 * texels))
    ours = np.zeros(image.shape, bool)
    for x0, y0, x1, y1 in np.round(BOARD.rectangles * texels).astype(int):
        ours[y0:y1, x0:x1] = True
    wrong = ours != (image < 128)
    assert not binary_erosion(wrong, iterations=2).any()  # edges are rounded, nothing else
    assert BOARD.nominal_corners == pytest.approx(np.asarray(theirs.getChessboardCorners()))


def test_strips_have_their_own_markers_and_corners():
    assert len(STRIPS.nominal_corners) == 52
    left, top, right, foot = STRIPS.window
    assert (left, top, right, foot) == (15.0, 0.0, 45.0, 70.0)
    x0, _, x1, _ = STRIPS.rectangles.T
    assert not np.any((x1 > left + 1e-9) & (x0 < right - 1e-9))  # nothing is printed in the window


@pytest.mark.parametrize("board", [BOARD, STRIPS, CHESS], ids=lambda board: board.kind)
def test_the_page_has_the_true_scale(tmp_path, board):
    text = board.write_pdf(tmp_path / "board.pdf").read_bytes().decode("latin-1")
    boxes = np.array(re.findall(r"^([\d.]+) ([\d.]+) ([\d.]+) ([\d.]+) re$", text, re.M), float)
    boxes *= 25.4 / 72.0
    bar, print_ = boxes[-1], boxes[:-1]
    assert bar[2] == pytest.approx(100.0, abs=1e-3)
    assert np.sum(print_[:, 2] * print_[:, 3]) == pytest.approx(
        np.sum(np.diff(board.rectangles[:, [0, 2]]) * np.diff(board.rectangles[:, [1, 3]])),
        rel=1e-4,
    )
    ends = (print_[:, :2] + print_[:, 2:]).max(axis=0) - print_[:, :2].min(axis=0)
    assert ends == pytest.approx(board.extent, abs=1e-3)
    page = np.array(re.search(r"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", text).groups(), float)
    assert (boxes[:, :2] >= 0.0).all()
    assert (boxes[:, :2] + boxes[:, 2:] <= page * 25.4 / 72.0).all()
    # What is upper on the board is upper on the page, where y goes up.
    upper = print_[np.argmin(board.rectangles[:, 1]), 1]
    assert upper > print_[np.argmax(board.rectangles[:, 3]), 1]


def test_a_measured_bar_scales_every_length():
    stretched = dataclasses.replace(BOARD, check_line=101.0)
    assert stretched.corners == pytest.approx(1.01 * BOARD.corners)
    camera = _look(stretched)
    found = stretched.detect(render_picture(Scene(board=stretched), camera))
    assert found.corners == pytest.approx(camera.project(found.points), abs=0.15)


@pytest.mark.parametrize("board", [BOARD, STRIPS, CHESS], ids=lambda board: board.kind)
def test_a_description_comes_back(tmp_path, board):
    measured = dataclasses.replace(board, check_line=100.13, flatness=0.25)
    for name in ("board.yaml", "board.json"):
        assert load_board(measured.save(tmp_path / name)) == measured
    text = (tmp_path / "board.yaml").read_text(encoding="utf-8")
    (tmp_path / "board.yaml").write_text(text.replace("100.13", "10.013 cm"))
    assert load_board(tmp_path / "board.yaml").check_line == pytest.approx(100.13)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("kind: chess", "kind is 'chess'"),
        ("kind: {a: 1}", "choose one of"),
        ("columns: 3", "must hold 'kind'"),
        ("[1, 2]", "must hold 'kind'"),
        ("{kind: strips, square: 0}", "square"),
        ("{kind: strips, sqare: 5}", "did you mean 'square'"),
        ("{kind: strips, columns: 4, rows: 30}", "has 120 markers"),
        ("{kind: charuco, check_line: 4cm}", "check_line"),
        ("{kind: charuco, columns: 20, rows: 20}", "last marker is 199"),
        ("{kind: checkerboard, columns: 8, rows: 6}", "upside down"),
    ],
)
def test_a_wrong_description_is_one_line(tmp_path, text, said):
    (tmp_path / "b.yaml").write_text(text)
    with pytest.raises(FileFormatError, match=said) as caught:
        load_board(tmp_path / "b.yaml")
    assert "\n" not in str(caught.value)


def test_what_cannot_be_found_has_a_reason(charuco):
    camera, picture = charuco
    blank = Picture(np.full((400, 640), 0.7, np.float32))
    for board in (BOARD, STRIPS, CHESS):
        found = board.detect(blank)
        assert not found.found
        assert "found" in found.reason
    mirrored = dataclasses.replace(picture, values=picture.values[:, ::-1])
    assert BOARD.detect(mirrored).reason == "the board is mirrored"
    others = CharucoBoard(first_marker=50, columns=8, rows=8)
    assert others.detect(picture).reason == "markers of another board found"
    assert "7 x 6" in dataclasses.replace(CHESS, columns=7).detect(picture).reason


def test_one_marker_read_wrongly_costs_only_its_corners(charuco, monkeypatch):
    camera, picture = charuco
    whole = BOARD.detect(picture)
    detector = cv2.aruco.ArucoDetector

    class Misread:
        def __init__(self, *given):
            self.detector = detector(*given)

        def detectMarkers(self, *given):
            corners, numbers, *more = self.detector.detectMarkers(*given)
            wrong = np.array(numbers)
            wrong[5] = wrong[20]
            return corners, wrong, *more

    monkeypatch.setattr(cv2.aruco, "ArucoDetector", Misread)
    found = BOARD.detect(picture)
    assert len(whole.ids) - 4 <= len(found.ids) <= len(whole.ids)
    assert found.corners == pytest.approx(camera.project(found.points), abs=0.15)


def test_a_board_of_other_columns_does_not_fit_a_plane(charuco):
    camera, picture = charuco
    wrong = CharucoBoard(columns=10, rows=8).detect(picture)
    assert len(wrong.ids) < 0.5 * len(BOARD.detect(picture).ids)


def test_part_of_a_board_will_do_and_the_border_is_left_out():
    camera = _look(BOARD, pitch=0.07)
    found = BOARD.detect(render_picture(Scene(board=BOARD), camera))
    assert 10 < len(found.ids) < 50
    assert found.corners == pytest.approx(camera.project(found.points), abs=0.15)
    assert (found.corners > 8.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("gloss", [0.0, 0.4])
@pytest.mark.parametrize("aperture", [0.0, 3.0])
@pytest.mark.parametrize("down", [(0.0, 1.0, 0.0), (1.0, 1.0, 0.0)])
def test_gloss_and_defocus_shift_no_corner(gloss, aperture, down):
    from bozzini.vision import Light

    camera = _look(BOARD, aside=(60.0, -40.0), down=down)
    light = Light(position=(-40.0, 60.0, -400.0), gloss=gloss)
    sensor = Sensor(aperture=aperture, focus=280.0)
    found = BOARD.detect(render_picture(Scene(board=BOARD, light=light), camera, sensor=sensor))
    off = found.corners - camera.project(found.points)
    assert len(found.ids) > 35
    assert np.abs(off.mean(axis=0)).max() < 0.05
    assert np.sqrt(np.mean(off**2)) < 0.1


def test_numbers_are_checked():
    for given in ({"square": -1.0}, {"columns": 2}, {"columns": 3.5}, {"check_line": np.nan}):
        with pytest.raises(InputError):
            CharucoBoard(**given)

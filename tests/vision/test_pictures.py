from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

from bozzini.errors import FileFormatError, GeometryError, InputError
from bozzini.io.files import new_directory
from bozzini.vision import Picture, read_picture, write_picture
from bozzini.vision.pictures import (
    Stroke,
    measure_each,
    read_manifest,
    write_overlay,
    write_summary,
)

GREY = np.random.default_rng(0).integers(0, 256, (30, 40)).astype(np.uint8)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp"])
def test_grey_bytes_come_back(tmp_path, suffix):
    path = write_picture(Picture(GREY / np.float32(255)), tmp_path / f"a{suffix}")
    back = read_picture(path)
    assert np.array_equal(back.bytes, GREY)
    assert (back.size, back.bits, back.flags) == ((40, 30), 8, ())


def test_sixteen_bits_keep_what_eight_would_lose(tmp_path):
    deep = np.linspace(0.0, 1.0, 40 * 30, dtype=np.float32).reshape(30, 40)
    for name in ("a.png", "a.tif"):
        back = read_picture(write_picture(Picture(deep, bits=16), tmp_path / name))
        assert back.bits == 16
        assert np.abs(back.values - deep).max() < 1.0 / 65535
    assert back.saturated == pytest.approx(1 / 1200)


def test_colour_becomes_grey_whatever_its_form(tmp_path):
    colour = np.random.default_rng(1).integers(0, 256, (30, 40, 3)).astype(np.uint8)
    expected = colour @ np.array([0.299, 0.587, 0.114]) / 255
    for mode in ("RGB", "RGBA"):
        Image.fromarray(colour).convert(mode).save(tmp_path / "a.png")
        back = read_picture(tmp_path / "a.png")
        assert back.values == pytest.approx(expected, abs=1e-5)
        assert back.flags == ("colour",)
    Image.fromarray(GREY).convert("P").save(tmp_path / "b.png")
    Image.fromarray(GREY).convert("LA").save(tmp_path / "c.png")
    for name in ("b.png", "c.png"):
        assert np.array_equal(read_picture(tmp_path / name).bytes, GREY)


def test_a_note_to_turn_the_picture_is_not_obeyed_but_kept(tmp_path):
    note = Image.Exif()
    note[274] = 6
    Image.fromarray(GREY).save(tmp_path / "a.png", exif=note)
    back = read_picture(tmp_path / "a.png")
    assert back.size == (40, 30)
    assert back.flags == ("exif_rotated",)


def test_what_is_no_picture_is_one_line(tmp_path):
    good = write_picture(Picture(GREY / np.float32(255)), tmp_path / "good.png").read_bytes()
    write_picture(Picture(GREY / np.float32(255)), tmp_path / "good.jpg")
    lossy = (tmp_path / "good.jpg").read_bytes()
    cases = {
        "cut.png": good[: len(good) // 2],
        "cut.jpg": lossy[: len(lossy) // 2],
        "text.png": b"this is no picture",
        "empty.png": b"",
        "damaged.png": good[:60] + bytes(200) + good[260:],
    }
    Image.fromarray(GREY.astype(np.float32)).save(tmp_path / "floats.tif")
    for name, content in cases.items():
        (tmp_path / name).write_bytes(content)
    for name in (*cases, "missing.png", "floats.tif"):
        with pytest.raises(FileFormatError) as caught:
            read_picture(tmp_path / name)
        assert "\n" not in str(caught.value)
        assert name in str(caught.value)
    with pytest.raises(InputError, match="written as"):
        write_picture(Picture(GREY / np.float32(255)), tmp_path / "a.gif")


def test_a_table_of_pictures_keeps_all_its_columns(tmp_path):
    (tmp_path / "m.csv").write_text(
        '# made by hand\nimage, note\na.png,"one, two"\n\nb.png,\n', encoding="utf-8-sig"
    )
    manifest = read_manifest(tmp_path / "m.csv", ("image",))
    assert manifest.columns == ("image", "note")
    assert [row["note"] for row in manifest.rows] == ["one, two", ""]
    assert manifest.find_picture(manifest.rows[1], "image") == tmp_path / "b.png"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a,b\n1,2\n", "needs one column 'image'"),
        ("image,image\n1,2\n", "needs one column 'image'"),
        ("image,x,x\n1,2,3\n", "same name"),
        ("image\n", "no rows"),
        ("", "no rows"),
        ("image,b\n1\n", "row 1 has 1 cells"),
        ('image,b\n1,"2\n', "comma-separated"),
        ("image,\na.png,3\n", "column 2 has no title and the number 3 in row 1"),
    ],
)
def test_a_wrong_table_is_one_line(tmp_path, text, said):
    (tmp_path / "m.csv").write_text(text)
    with pytest.raises(FileFormatError, match=said) as caught:
        read_manifest(tmp_path / "m.csv", ("image",))
    assert "\n" not in str(caught.value)


def _measure(number: int) -> dict[str, object]:
    if number == 2:
        raise GeometryError("nothing is seen")
    return {"value": 10 * number}


def test_a_picture_that_fails_is_a_row(jobs=1):
    heard = []
    rows = measure_each([1, 2, 3], _measure, jobs=jobs, progress=lambda *told: heard.append(told))
    assert [row["status"] for row in rows] == ["ok", "failed", "ok"]
    assert rows[1]["reason"] == "nothing is seen"
    assert [row.get("value") for row in rows] == [10, None, 30]
    assert heard[-1] == ("measure", 1.0)


@pytest.mark.slow  # each process imports the package anew
def test_processes_give_the_same_rows():
    test_a_picture_that_fails_is_a_row(jobs=2)


def test_an_overlay_marks_what_was_found(tmp_path):
    picture = Picture(np.full((60, 80), 0.5, np.float32))
    line = Stroke(np.array([[10.0, 20.0], [50.0, 20.0]]))
    cross = Stroke(np.array([[40.0, 40.0], [np.nan, 1.0]]), crosses=True)
    path = write_overlay(tmp_path / "o.png", picture, [line, cross], ["text"], refused=True)
    drawn = np.asarray(Image.open(path)).astype(int)
    coloured = np.abs(drawn - drawn.mean(axis=2, keepdims=True)).max(axis=2) > 50
    assert coloured[20, 30] and coloured[40, 40] and coloured[0, 0]
    assert not coloured[50, 60]


def test_a_summary_lists_its_files_and_inputs(tmp_path):
    (tmp_path / "in.csv").write_text("a")
    for _ in range(2):  # the second replaces the first, by the files that it lists
        with new_directory(tmp_path / "out", force=True) as folder:
            (folder / "points.csv").write_text("b")
            given = write_summary(
                folder,
                settings={"a": 1},
                inputs=[tmp_path / "in.csv", tmp_path / "none.csv"],
                result={"bad": float("nan")},
            )
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary == given
    assert summary["files"] == ["points.csv", "summary.json"]
    assert list(summary["inputs"].values())[1] is None
    assert summary["bad"] is None

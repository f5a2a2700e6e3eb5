"""``bozzini segment``: labels that ``bozzini plan`` reads, a picture, nothing left when refused."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import nibabel
import numpy as np
import pytest

from bozzini.anatomy import read_tract
from bozzini.cli.main import main
from tests.cli.plan_cases import write_scan


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    """Write a block of tissue in air, with two tubes of gas of different width."""
    return write_scan(tmp_path / "ct.nii.gz")


@pytest.mark.slow
def test_labels_picture_and_report(scan: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = scan.parent / "labels.nii.gz"
    assert main(["segment", str(scan), "--out", str(target), "--json", "--quiet"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (scan.parent / "labels.png").read_bytes().startswith(b"\x89PNG")
    assert [item["label"] for item in found["segments"]] == [1, 2]
    assert "does not replace" in found["limits"]
    for item, radius in zip(found["segments"], (12.0, 9.0), strict=True):
        tract = read_tract(target, labels=[f"gas {item['label']}"])
        assert tract.volume / 1000.0 == pytest.approx(item["volume_ml"])
        assert item["volume_ml"] == pytest.approx(np.pi * radius**2 * 99.0 / 1000.0, rel=0.12)
        assert tract.not_reached == ()
    # It exists: nothing is replaced unasked.
    before = target.read_bytes()
    assert main(["segment", str(scan), "--out", str(target), "--quiet"]) == 2
    assert "exists already" in capsys.readouterr().err
    point = ",".join(f"{value}mm" for value in found["segments"][1]["point_mm"])
    words = ["segment", str(scan), "--out", str(target), "--force", "--quiet", f"--seed={point}"]
    assert main(words) == 0
    assert "label 1: " in capsys.readouterr().out
    assert target.read_bytes() != before
    assert read_tract(target).volume / 1000.0 == pytest.approx(found["segments"][1]["volume_ml"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--out", "labels.stl"], "labels are written as .nii or .nii.gz"),
        (["--out", "labels.txt"], "labels are written as .nii or .nii.gz"),
        (["--out", "labels.nii", "--threshold", "-300"], "-1000.0<=x<=-400.0"),
        (["--out", "labels.nii", "--seed", "60mm,60mm,5mm"], "from the nearest gas"),
        (["--out", "labels.nii", "--threshold", "5"], "threshold"),
        (["--out", "none/labels.nii"], "not a directory"),
    ],
)
def test_a_refusal_leaves_nothing(
    scan: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(scan.parent)
    assert main(["segment", scan.name, "--quiet", *words]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("bozzini: error: ") and said in line
    assert [item.name for item in scan.parent.iterdir()] == ["ct.nii.gz"]


def test_a_label_volume_is_not_taken_for_a_ct(
    scan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    labels = np.zeros((10, 10, 10), dtype=np.uint8)
    labels[3:7, 3:7, 3:7] = 1
    nibabel.save(nibabel.Nifti1Image(labels, np.eye(4)), scan.parent / "labels.nii")
    words = ["segment", str(scan.parent / "labels.nii"), "--out", str(scan.parent / "x.nii")]
    assert main([*words, "--quiet"]) == 2
    assert "CT in HU" in capsys.readouterr().err


@pytest.mark.parametrize("force", [False, True])
def test_a_picture_that_cannot_be_written_is_refused_before_the_work(
    scan: Path, capsys: pytest.CaptureFixture[str], force: bool
) -> None:
    (scan.parent / "labels.png").mkdir()
    words = ["segment", str(scan), "--out", str(scan.parent / "labels.nii"), "--quiet"]
    assert main([*words, *["--force"] * force]) == 2
    assert "labels.png is a directory" in capsys.readouterr().err
    assert sorted(item.name for item in scan.parent.iterdir()) == ["ct.nii.gz", "labels.png"]


def test_what_cannot_be_put_in_place_leaves_the_old_files(
    scan: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for file in ("labels.nii", "labels.png"):
        (scan.parent / file).write_text("old")
    replace = Path.replace

    def fail(self: Path, target: Path) -> Path:
        if Path(target).name == "labels.png":
            raise OSError(28, "No space left on device")
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", fail)
    words = ["segment", str(scan), "--out", str(scan.parent / "labels.nii"), "--force", "--quiet"]
    assert main(words) == 2
    assert "No space left" in capsys.readouterr().err
    for file in ("labels.nii", "labels.png"):
        assert (scan.parent / file).read_text(encoding="utf-8") == "old"
    assert len(list(scan.parent.iterdir())) == 3


def test_a_name_that_no_font_holds_is_drawn_without_a_warning(
    scan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = scan.rename(scan.with_name("\u65e5\u672c.nii.gz"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        words = ["segment", str(source), "--out", str(scan.parent / "labels.nii"), "--quiet"]
        assert main(words) == 0
    assert capsys.readouterr().err == ""

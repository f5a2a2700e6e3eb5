from __future__ import annotations

import json

import pytest

from bozzini.anatomy import read_tract
from bozzini.cli.main import main


@pytest.mark.parametrize("suffix", ["stl", "nii.gz"])
def test_it_writes_what_it_says(tmp_path, capsys, suffix):
    path = tmp_path / f"phantom.{suffix}"
    assert main(["phantom", "--out", str(path), "--voxel", "0.3cm", "--json"]) == 0
    out, err = capsys.readouterr()
    said = json.loads(out)
    assert err == ""
    assert said["voxel_mm"] == 3.0
    assert said["volume_ml"] == pytest.approx(
        read_tract(path, labels="all" if suffix == "nii.gz" else None).volume / 1000.0, rel=1e-5
    )
    total = sum(said["region_lengths_mm"].values())
    assert said["centreline_length_mm"] == pytest.approx(total)
    assert said["kind"] == ("surface" if suffix == "stl" else "labels")


def test_a_file_is_replaced_only_by_force(tmp_path, capsys):
    path = tmp_path / "phantom.ply"
    command = ["phantom", "--out", str(path), "--voxel", "4mm"]
    assert main(command) == 0
    before = path.read_bytes()
    assert main([*command, "--seed", "4"]) == 2
    assert path.read_bytes() == before
    assert main([*command, "--seed", "4", "--force"]) == 0
    assert path.read_bytes() != before
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--out", "phantom.step"], ".stl"),
        (["--out", "nowhere/phantom.stl"], "nowhere"),
        (["--out", "phantom.stl", "--voxel", "9mm"], "[0.5, 4] mm"),
        (["--out", "phantom.stl", "--voxel", "1 furlongs/s"], "furlongs"),
        (["--out", "phantom.stl", "--seed", "-1"], "seed is -1"),
        (["--out", "phantom.stl", "--seed", "x"], "'x'"),
        ([], "--out"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(tmp_path, capsys, monkeypatch, options, said):
    monkeypatch.chdir(tmp_path)
    assert main(["phantom", *options]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert said in err
    assert list(tmp_path.iterdir()) == []

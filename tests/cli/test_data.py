from __future__ import annotations

import json

import pytest

from bozzini.anatomy import fetch as catalogue
from bozzini.anatomy.fetch import CATALOGUE, PublicData
from bozzini.cli.main import main


@pytest.fixture
def local(tmp_path, monkeypatch):
    source = tmp_path / "source.stl"
    source.write_bytes(b"triangles" * 100)
    entry = PublicData(
        name="local",
        what="A file on this disk",
        licence="CC0",
        citation="Nobody 2026",
        url=source.as_uri(),
        file_name="local.stl",
    )
    monkeypatch.setattr(catalogue, "CATALOGUE", (entry,))
    return source


def test_the_list_names_every_data_set_and_its_licence(capsys):
    assert main(["data", "list"]) == 0
    text = capsys.readouterr().out
    assert main(["data", "list", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)["data"]
    for entry, item in zip(CATALOGUE, said, strict=True):
        assert entry.name in text
        assert entry.licence in text
        assert (item["name"], item["sha256"]) == (entry.name, entry.sha256)


def test_a_fetch_brings_the_file_and_says_it_was_not_verified(tmp_path, capsys, local):
    assert main(["data", "fetch", "local", "--to", str(tmp_path / "data"), "--json"]) == 0
    out, _ = capsys.readouterr()
    said = json.loads(out)
    assert said["verified"] is False
    assert (tmp_path / "data" / "local.stl").read_bytes() == local.read_bytes()
    assert "Nobody 2026" in (tmp_path / "data" / "local.stl.citation.txt").read_text(
        encoding="utf-8"
    )
    assert main(["data", "fetch", "local", "--to", str(tmp_path / "data"), "--force"]) == 0
    assert "not verified" in capsys.readouterr().out


def test_failures_are_one_line(tmp_path, capsys, local):
    local.unlink()
    for name in ("local", "unknown"):
        assert main(["data", "fetch", name, "--to", str(tmp_path / "data")]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.count("\n") == 1
        assert name in err
    assert not (tmp_path / "data").exists()

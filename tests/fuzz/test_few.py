"""A few cases of the fuzz program, always the same: ``make fuzz`` runs many."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz.mutate import UNTITLED, damage, make_value, repeat_option

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="each case is a forked process")
@pytest.mark.slow(60)  # a first run compiles all kernels in one process
@pytest.mark.parametrize("count", [20])
def test_a_few_damaged_files_and_odd_options(tmp_path: Path, count: int) -> None:
    options = [
        "--count",
        str(count),
        "--seed",
        "3",
        "--jobs",
        "1",
        "--seconds",
        "250",
        "--skip-sound",
    ]
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", *options, "--keep", str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=290,
        env={**os.environ, "MPLBACKEND": "Agg"},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{count} cases of seed 3: {count} right, 0 wrong" in done.stdout


@pytest.mark.parametrize("name", ["a.yaml", "a.json", "a.csv", "a.stl", "a.nii", "a.xyz"])
def test_damage_is_reproducible_and_does_damage(tmp_path: Path, name: str) -> None:
    text = "name: tube\nvalues: [1, 2.5, 3]\n" if name != "a.json" else '{"a": [1, 2.5], "b": "c"}'
    sound = text.encode() + (b"\0" * 400 if name in ("a.stl", "a.nii") else b"")
    changed = 0
    for seed in range(40):
        results = []
        for _ in range(2):
            (tmp_path / name).write_bytes(sound)
            damage(tmp_path / name, random.Random(seed))
            results.append((tmp_path / name).read_bytes())
        assert results[0] == results[1]
        changed += results[0] != sound
    assert changed > 30
    assert [make_value(random.Random(1), "mm")] * 2 == [
        make_value(random.Random(1), "mm") for _ in range(2)
    ]


def test_tables_are_damaged_as_tables_are(tmp_path: Path) -> None:
    sound = "time [s],pressure [kPa],length_mm\n" + "".join(f"{k},{k}.5,10\n" for k in range(5))
    seen: dict[str, set[str]] = {}
    for seed in range(400):
        (tmp_path / "a.csv").write_text(sound)
        way = damage(tmp_path / "a.csv", random.Random(seed))
        changed = (tmp_path / "a.csv").read_bytes().decode("utf-8", "replace")
        seen.setdefault(way.partition(": ")[2], set()).add(changed)
    assert {"units", "row_of_units", "swap", "gaps", UNTITLED} <= set(seen)
    assert all("" in text.split("\n")[0].replace(" ", "").split(",") for text in seen[UNTITLED])
    assert any(text.startswith("pressure [kPa],time [s]") for text in seen["swap"])
    assert any("(in %)" in text for text in seen["units"])
    assert any("(s),(kPa),(mm)" in text for text in seen["row_of_units"])


def test_an_option_is_repeated_with_the_same_value_or_another() -> None:
    told = set()
    for seed in range(20):
        words = ["it", "--length", "5mm"]
        differs = repeat_option(words, "--length", random.Random(seed), "mm")
        last = words[-1].removeprefix("--length=")
        assert differs == (last != "5mm")
        told.add(differs)
    assert told == {True, False}

"""Bounds in messages: a lower one is rounded down, an upper one up; JSON has them in full."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.checks import ceil_mm, floor_beside, floor_mm
from bozzini.cli import live
from bozzini.cli.main import main
from bozzini.motion import Plan
from tests.cli.plan_cases import SCOPE, Tracts

LENGTHS = st.floats(0.0, 50.0)


@given(value=LENGTHS, other=LENGTHS, digits=st.integers(0, 4))
def test_bounds_are_rounded_to_the_safe_side(value: float, other: float, digits: int) -> None:
    assert float(floor_mm(value, digits)) <= value <= float(ceil_mm(value, digits)) + 1e-8
    low, high = (float(text) for text in floor_beside(value, other))
    assert low <= value and other <= high + 1e-8
    if abs(value - other) > 1e-9:
        assert np.sign(low - high) == np.sign(value - other)


def read_bounds(text: str) -> tuple[list[float], list[float]]:
    """Return the lengths that a text states as lower and as upper bounds."""
    low = r"(?:at least|clearance|anew|between) (\d+\.\d+)"
    high = r"(?:up to|to within|no wider than) (\d+\.\d+)"
    return [[float(item) for item in re.findall(form, text)] for form in (low, high)]  # type: ignore[return-value]


def test_frames_of_a_moving_tract_overstate_nothing() -> None:
    found: dict[str, Any] = dict.fromkeys(
        ("frames", "frames_held", "frames_now", "frames_lost", "frames_refused", "frames_late"), 1
    )
    found |= dict.fromkeys(("latency_median_s", "latency_p95_s", "latency_max_s"), 0.01)
    found |= {"clearance_min_mm": 0.016771, "carried_min_mm": 0.118, "margin_mm": 0.157080}
    run = SimpleNamespace(to_dict=lambda: found, speed=4.71239, rate=30.0, reason="")
    low, high = read_bounds(live._describe(run))  # type: ignore[arg-type]
    assert len(low) == 2 and len(high) == 1
    assert low[0] <= found["clearance_min_mm"] and low[1] <= found["carried_min_mm"]
    assert high[0] >= found["margin_mm"]


@pytest.mark.slow
def test_a_plan_and_its_check_overstate_nothing(
    capsys: pytest.CaptureFixture[str], tracts: Tracts, tmp_path: Path
) -> None:
    out = tmp_path / "way"
    assert (
        main(["plan", str(tracts.volume), *SCOPE, "--compare", "--quiet", "--out", str(out)]) == 0
    )
    low, high = read_bounds(capsys.readouterr().out)
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    rows = [item["clearance_certified_mm"] for item in summary["comparison"]]
    proved = [summary["clearance_certified_mm"], *(row for row in rows if row is not None)]
    for written, value in zip(low, proved, strict=True):
        assert 0.0 <= value - written < 0.011
    for more in ([], ["--independent"]):
        files = [str(out / "plan.npz"), str(tracts.volume)]
        assert main(["certify", *files, *more, "--quiet"]) == 0
        low, high = read_bounds(capsys.readouterr().out)
        assert main(["certify", *files, *more, "--quiet", "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        proof, second = found["clearance_certified_mm"], found["second_check"]
        limits = [proof, proof] if second is None else [proof, second["clearance_mm"], proof]
        assert len(low) == len(limits)
        assert all(written <= limit for written, limit in zip(low, limits, strict=True))
        plan = Plan.load(out / "plan.npz")
        step = float(np.linalg.norm(np.diff(plan.joints, axis=0), axis=2).max())
        assert any(step <= written < step + 1e-3 for written in high)

"""The rod against another group's Cosserat solver, on all of its shapes."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest


@pytest.mark.slow
def test_its_shapes_are_those_of_another_solver(robot_dirs, monkeypatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "validation"))
    import sorosim_statics as sorosim

    found = sorosim.compare(sorosim.read_statics(robot_dirs("sorosim_statics") / "SpringSteel.csv"))
    sys.modules.pop("section", None)
    assert not found.reasons
    assert np.mean(found.tip <= 1e-3) >= 0.99
    assert found.tip.max() <= 1.5e-3
    assert found.turn.max() <= 0.5

"""The colon of the Visible Human female, open shells of a wall, from its anus to the caecum."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from bozzini.anatomy import read_tract
from bozzini.motion import Scope
from bozzini.study import InsertionOptions, run_insertion


@pytest.fixture(scope="module")
def reviewed(colon_dir: Path) -> np.ndarray:
    """Return the reviewed mid-line, which begins at the anus and ends at the appendix tip."""
    points = json.loads((colon_dir / "large_intestine_path.jsn").read_text(encoding="utf-8"))[
        "points"
    ]
    return np.array(points, dtype=np.float64)


@pytest.fixture(scope="module")
def tract(colon_dir: Path):
    return replace(read_tract(colon_dir / "large-intestine.vtk"), organ="colon")


@pytest.mark.slow
@pytest.mark.parametrize("diameter", [5.0, 9.0, 12.8])
def test_a_colon_is_entered_at_the_anus_and_certified(tract, reviewed, diameter) -> None:
    scope = Scope(diameter=diameter, link_length=8.0)
    study = run_insertion(tract, scope, options=InsertionOptions(method="tube", head_step=1.0))
    line = study.line
    ends = [np.linalg.norm(point - reviewed[0]) for point in line.points[[0, -1]]]
    assert ends[0] < 20.0 < ends[1]
    assert study.plan.status == "complete" and study.plan.certified, study.plan.reason
    # The reviewed line lies beside the middle: by 4 mm on average, and with less clearance.
    gaps, nearest = cKDTree(reviewed).query(line.points)
    assert gaps.mean() < 5.0
    assert (study.field.signed_distance(reviewed) < 0.0).mean() >= 0.85
    assert np.ptp(nearest) >= 0.8 * len(reviewed)  # less the two ends, a radius each
    assert np.all(np.diff(nearest) > -15)
    beside = reviewed[nearest.min() : nearest.max()]
    assert np.median(line.radius) > np.median(-study.field.signed_distance(beside))

"""What all tests share: the real anatomy where there is one, Hypothesis, a headless matplotlib."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

os.environ.setdefault("MPLBACKEND", "Agg")

settings.register_profile(
    "default", deadline=None, suppress_health_check=[HealthCheck.too_slow], max_examples=50
)
settings.register_profile("ci", settings.get_profile("default"), derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")


@pytest.fixture(scope="session")
def upper_gi_dir() -> Path:
    """Give the directory of the CT-derived upper tract, which is not part of the project.

    ``BOZZINI_DATA`` names its parent; otherwise it is looked for beside the checkout.
    """
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    directory = Path(os.environ.get("BOZZINI_DATA", beside)) / "upper_gi"
    if not directory.is_dir():
        pytest.skip(f"no CT-derived anatomy at {directory} (set BOZZINI_DATA to its parent)")
    return directory

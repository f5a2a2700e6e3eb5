"""Fixtures of the command line's tests: a small tract in every form, and ``bozzini plan``."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from skimage.measure import marching_cubes

from bozzini.cli import common
from bozzini.cli.main import main
from tests.cli.plan_cases import CURVE, Outcome, Run, Tracts, write_volume
from tests.shapes import curve_distance


@pytest.fixture(scope="session")
def tracts(tmp_path_factory: pytest.TempPathFactory) -> Tracts:
    folder = tmp_path_factory.mktemp("tracts")
    low, high = CURVE.min(axis=0) - 12.0, CURVE.max(axis=0) + 12.0
    axes = [np.arange(a, b, 1.5) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    distance = curve_distance(CURVE, 8.0)(points)
    vertices, faces, _, _ = marching_cubes(distance, level=0.0, spacing=(1.5,) * 3)
    mesh = trimesh.Trimesh(vertices, faces)
    mesh.export(folder / "tube.stl")
    labels = np.where(distance < 0.0, np.where(points[..., 2] < 10.0, 1, 2), 0).astype(np.uint8)
    write_volume(folder / "halves.nii.gz", labels)
    write_volume(folder / "tube.nii.gz", np.minimum(labels, 1))
    return Tracts(folder, mesh, labels)


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: object) -> Outcome:
        capsys.readouterr()
        code = main(["plan", *map(str, arguments)])
        return Outcome(code, *capsys.readouterr())

    return call


@pytest.fixture(autouse=True)
def no_lines_of_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep a slow machine from adding lines of progress to what the tests read."""
    monkeypatch.setattr(common._LineProgress, "interval", float("inf"))

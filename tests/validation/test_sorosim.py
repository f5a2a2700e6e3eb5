"""The rod against another group's Cosserat solver, on all of its shapes."""

from __future__ import annotations

import csv
import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bozzini.continuum import ContinuumRobot, PointLoad, RodModel, Section, Wire


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "validation"))
    yield
    sys.modules.pop("section", None)


@pytest.fixture
def sorosim(folder: None) -> ModuleType:
    import sorosim_statics

    return sorosim_statics


@pytest.fixture
def releases(folder: None) -> ModuleType:
    import sorosim_dynamics

    return sorosim_dynamics


def test_another_rod_with_other_stations_is_read(sorosim, tmp_path: Path) -> None:
    specimen = sorosim.Specimen(length=200.0, radius=1.0, modulus=50e3, density=0.0)
    middle, tip = (0.0, 0.3, -0.2), (0.0, 0.1, 0.2)  # N, in the axes of the file
    halves = np.array([0.0, 0.4, 1.0]), np.array([0.0, 0.25, 0.5, 1.0])
    places = np.concatenate([100.0 * halves[0], 100.0 + 100.0 * halves[1]])
    wire = Wire(diameter=2.0, modulus=50e3, poisson_ratio=0.33)
    discs = tuple(np.unique(places)[1:])
    robot = ContinuumRobot((Section(length=200.0, radius=1.0, disc_positions=discs, wire=wire),))
    into = sorosim.INTO_WORLD
    loads = [
        PointLoad(arc_length=at, force=tuple(np.array(force) @ into))
        for at, force in ((100.0, middle), (None, tip))
    ]
    shape = RodModel(robot, loads=loads, stretches=True).shape_under_tensions([]).require()
    index = [int(np.argmin(np.abs(shape.arc_length - place))) for place in places]
    np.testing.assert_allclose(shape.arc_length[index], places, atol=1e-9)
    points = 1e-3 * shape.frames[index, :3, 3] @ into.T
    turns = into @ shape.frames[index, :3, :3] @ into.T
    angles = Rotation.from_matrix(turns).as_euler("XYZ")
    rows = [["label", *"gmt", *map(str, range(7))], ["s", 0, 0, 0, *halves[0], *halves[1]]]
    rows += [[f"Eul{k}", 0.0, 0.0, 0.0, *angles[:, k]] for k in range(3)]
    rows += [[f"P{k}", 0.0, middle[k], tip[k], *points[:, k]] for k in range(3)]
    with (tmp_path / "rod.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    found = sorosim.compare(sorosim.read_statics(tmp_path / "rod.csv", specimen))
    assert not found.reasons and found.tip.max() < 1e-9 and found.turn.max() < 1e-4
    softer = dataclasses.replace(specimen, modulus=45e3)
    assert sorosim.compare(sorosim.read_statics(tmp_path / "rod.csv", softer)).tip.max() > 1e-3


def test_releases_of_a_steel_rod_are_those_of_another_solver(releases, data_dir) -> None:
    # All ten by the set of `make validate`; the baselines miss the same bounds.
    data = releases.read_release(data_dir("sorosim_dynamics") / "steel_1.txt")
    moved = data.simulate()
    found = releases.compare(data, moved.tip)
    assert moved.converged and max(found.whole, found.first_second) < 1e-3
    assert found.frequency == pytest.approx(1.0, rel=1e-3)
    swing, rest = (releases.compare(data, tip()) for tip in (data.swing, data.rest))
    assert found.first_second < 1e-2 * swing.first_second < 1e-2 * rest.first_second


def test_another_release_is_read_with_its_own_axes(releases, tmp_path: Path) -> None:
    other = dataclasses.replace(releases.SPRING_STEEL, length=400.0, radius=5.0, modulus=70.0)
    head = [0.01, *6 * [0.0], 9.81, 0.0, 0.0]
    held = [0.0, *3 * [0.0], 0.0, 1e-3, 0.0, *3 * [0.0], 0.0, 0.0, 2e-3]
    rows = [[k / 200.0, *6 * [0.0], *3 * [0.0], 0.4, 0.0, 0.01 * k] for k in range(3)]
    lines = [" ".join(map(str, row)) for row in (head, held, *rows)]
    (tmp_path / "one.txt").write_text("\n".join(lines))
    data = releases.read_release(tmp_path / "one.txt", other)
    assert data.gravity.tolist() == [0.0, 0.0, 9.81]  # along the rod
    np.testing.assert_allclose(data.forces, [[1e-3, 0.0, 0.0], [0.0, 2e-3, 0.0]])
    np.testing.assert_allclose(data.tip[:, 1:], [[0.0, 400.0], [10.0, 400.0], [20.0, 400.0]])
    light = dataclasses.replace(data, gravity=np.zeros(3))
    rigidity = 70.0 * np.pi * 5.0**4 / 4.0
    bent = [1e-3 * 200.0**2 * 1000.0 / 6.0 / rigidity, 2e-3 * 400.0**3 / 3.0 / rigidity]
    np.testing.assert_allclose(light.simulate(20).tip[0, :2], bent, rtol=5e-3)

"""Tendons given by x and y: they may cross the backbone, and every model takes them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import trapezoid

from bozzini.continuum import ContinuumRobot, EnergyModel, Helix, RodModel, Section, Tendon
from bozzini.errors import InputError

PLACES = np.linspace(0.0, 60.0, 31)


def make_robot(tendon: Tendon, *, discs: int = 30) -> ContinuumRobot:
    return ContinuumRobot((Section(length=60.0, radius=3.0, tendons=(tendon,), discs=discs),))


def cross(places: np.ndarray) -> np.ndarray:
    """A path that crosses the backbone twice."""
    return np.stack([2.0 * np.cos(math.pi * places / 40.0), 0.3 * np.ones_like(places)], axis=1)


def make_crossing(interpolation: str = "cubic") -> Tendon:
    knots = np.column_stack([PLACES, cross(PLACES)]).tolist()
    return Tendon(name="c", path=knots, interpolation=interpolation)  # type: ignore[arg-type]


def test_a_helix_by_x_and_y_bends_as_one_by_its_angle() -> None:
    helix = make_robot(Tendon(name="h", offset=2.0, angle=Helix(turns=1.0)))
    angles = 2.0 * math.pi * PLACES / 60.0
    knots = np.column_stack([PLACES, 2.0 * np.cos(angles), 2.0 * np.sin(angles)]).tolist()
    path = make_robot(Tendon(name="h", path=knots, interpolation="cubic"))
    assert path.rest_lengths == pytest.approx(helix.rest_lengths, abs=1e-4)
    for kind in (RodModel, EnergyModel):
        options = {} if kind is RodModel else {"segment": "channel"}
        one, other = (kind(robot, **options).shape([1.0]).require() for robot in (helix, path))
        index = np.searchsorted(other.arc_length, one.disc_arc_length - 1e-6)
        ours = np.searchsorted(one.arc_length, one.disc_arc_length - 1e-6)
        assert np.abs(one.points[ours] - other.points[index]).max() < 2e-3


def test_a_tendon_that_crosses_the_backbone_has_one_shape_in_both_models() -> None:
    robot = make_robot(make_crossing(), discs=60)
    rod = RodModel(robot).shape_under_tensions([6.0]).require()
    again = RodModel(robot).shape(rod.displacements).require()
    energy = EnergyModel(robot, segment="channel").shape(rod.displacements).require()
    assert again.tensions == pytest.approx([6.0], abs=1e-3)
    assert energy.tensions == pytest.approx([6.0], rel=2e-3)
    off = energy.disc_frames[:, :3, 3] - rod.disc_frames[:, :3, 3]
    assert np.linalg.norm(off, axis=1).max() < 0.05
    # It bends to one side, then to the other.
    bend = np.diff(rod.disc_frames[:, 0, 2])
    assert bend.max() > 0.0 > bend.min()


def test_the_length_of_a_tendon_is_that_of_its_points() -> None:
    robot = make_robot(make_crossing(), discs=60)
    shape = RodModel(robot, between=9).shape_under_tensions([6.0]).require()
    points = shape.tendon_points[0]
    measured = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert shape.tendon_lengths[0] == pytest.approx(measured, abs=1e-3)


def test_what_a_tendon_pays_out_is_the_work_of_its_tension() -> None:
    # The complementary energy of the rod grows with the tension by what the tendon gets shorter:
    # so the elastic energy does by tension times that.
    robot = make_robot(make_crossing())
    model = RodModel(robot, between=3)
    tensions = np.linspace(0.0, 6.0, 61)[:, None]
    shapes = model.shape_under_tensions(tensions)
    work = trapezoid(tensions[:, 0], shapes.displacements[:, 0])
    frames = shapes.frames[-1, :, :3, :3]
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_matrix(np.swapaxes(frames[:-1], 1, 2) @ frames[1:]).as_rotvec()
    stiffness = np.array([200.0, 200.0, 200.0 / 1.3])
    energy = 0.5 * np.sum(stiffness * turns**2 / np.diff(shapes.arc_length)[:, None])
    assert work == pytest.approx(energy, rel=2e-3)


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_knots_of_a_path_are_met_with_its_slope(interpolation: str) -> None:
    tendon = make_crossing(interpolation)
    assert np.allclose(tendon.place_at(PLACES), cross(PLACES))
    places = np.linspace(0.5, 59.5, 40)
    step = 1e-6
    measured = (tendon.place_at(places + step) - tendon.place_at(places - step)) / (2.0 * step)
    assert np.allclose(tendon.slope_at(places), measured, atol=1e-6)
    assert np.allclose(tendon.offset_at(places), np.hypot(*tendon.place_at(places).T))
    assert not tendon.is_parallel


def test_a_straight_path_is_a_parallel_tendon() -> None:
    path = make_robot(Tendon(name="a", path=[(0.0, 0.0, 2.0), (60.0, 0.0, 2.0)]))
    polar = make_robot(Tendon(name="a", offset=2.0, angle=0.5 * math.pi))
    assert path.is_parallel
    assert np.allclose(path.forward([3.0]).points, polar.forward([3.0]).points, atol=1e-9)


def test_a_robot_file_holds_paths(tmp_path) -> None:  # type: ignore[no-untyped-def]
    robot = make_robot(make_crossing())
    again = ContinuumRobot.from_yaml(robot.to_yaml(tmp_path / "robot.yaml"))
    assert again == robot
    assert "angle" not in robot.to_dict()["sections"][0]["tendons"][0]
    given = {"sections": [{"length": "6 cm", "radius": 3, "tendons": [
        {"name": "c", "path": [[0, "2 mm", 0], ["3 cm", 0, "-0.1 cm"], [60, 1, 1]]}]}]}  # fmt: skip
    tendon = ContinuumRobot.from_dict(given).tendons[0]
    assert tendon.path == ((0.0, 2.0, 0.0), (30.0, 0.0, -1.0), (60.0, 1.0, 1.0))


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"offset": 2.0, "path": [(0, 1, 0), (60, 1, 0)]}, "takes no offset and no angle"),
        ({"angle": 0.0, "path": [(0, 1, 0), (60, 1, 0)]}, "takes no offset and no angle"),
        ({}, "neither an offset nor a path"),
        ({"path": [(0, 0, 0), (60, 0, 0)]}, "runs along the backbone's axis"),
        ({"path": [(0, 1, 0), (60, 1)]}, "knot 1 is (60, 1): it must be (arc length, x, y)"),
        ({"path": [(0, 1, 0), (0, 2, 0)]}, "arc lengths must increase"),
        ({"path": [(0, 1, 0), (9, math.nan, 0)]}, "path x knot 1 is nan mm"),
        ({"path": 3.0}, "path is 3.0: it must be knots"),
        ({"path": [(0, 1, 0), (50, 1, 0)]}, "path has knots from 0 to 50 mm"),
        ({"path": [(0, 1, 0), (60, 3.5, 0)]}, "offset is 3.5 mm in section 1"),
    ],
)
def test_what_is_no_path_is_refused(fields: dict, words: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(InputError, match=".*") as caught:
        make_robot(Tendon(name="a", **fields))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)

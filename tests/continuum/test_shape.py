"""The result: what goes together, what is read off it, what it refuses."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bozzini.continuum import (
    CONTINUUM_MODELS,
    ArcModel,
    ContinuumModel,
    ContinuumRobot,
    LinkageModel,
    Section,
    Shape,
    Tendon,
    displacements_for,
)
from tests.continuum.robots import QUARTER, THIRD, make_robot

PULLED = np.array([[2.0, -1.0, -1.0, 2.0, -1.0, -1.0], [0.0, 0.0, 0.0, 1.0, -0.5, -0.5]])


@pytest.fixture
def shape() -> Shape:
    return ArcModel(make_robot(THIRD, THIRD), between=2).shape(PULLED).require()


def test_discs_are_stations(shape: Shape) -> None:
    assert shape.disc_frames.shape == (2, 20, 4, 4)
    places = np.searchsorted(shape.arc_length, shape.robot.disc_arc_length - 1e-9)
    assert np.array_equal(shape.disc_frames, shape.frames[:, places])
    assert np.array_equal(shape.disc_frames[:, -1], shape.tip_frame)
    assert np.array_equal(shape.tip, shape.points[:, -1])


def test_tendons_run_at_their_offset_in_the_cross_sections_to_their_end(shape: Shape) -> None:
    for tendon, end, points in zip(
        shape.robot.tendons, shape.robot.tendon_ends, shape.tendon_points, strict=True
    ):
        count = int(np.sum(shape.arc_length <= end + 1e-9))
        assert points.shape == (2, count, 3)
        frames = shape.frames[:, :count]
        local = np.einsum("...ji,...j->...i", frames[..., :3, :3], points - frames[..., :3, 3])
        assert np.allclose(local[..., :2], tendon.place_at(shape.arc_length[:count]), atol=1e-9)
        assert np.allclose(local[..., 2], 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["arc", "linkage"])
def test_models_answer_the_same_way(name: str) -> None:
    robot = make_robot(THIRD, THIRD)
    model = CONTINUUM_MODELS[name](robot)
    assert isinstance(model, ContinuumModel)
    assert model.name == name
    assert model.robot is robot
    shape = model.shape(PULLED)
    assert shape.model == name
    assert shape.tensions.shape == (2, 0)
    assert np.allclose(shape.disc_arc_length, robot.disc_arc_length)
    assert shape.iterations.tolist() == [0, 0]
    assert np.array_equal(shape.displacements, PULLED)
    assert model.shape(PULLED[0]).tip.shape == (3,)


def test_linkage_with_segments_of_its_own_has_discs_at_its_joints() -> None:
    shape = LinkageModel(make_robot(THIRD, THIRD), segments=3).shape(PULLED)
    assert shape.disc_frames.shape == (2, 6, 4, 4)


@pytest.mark.parametrize("name", list(CONTINUUM_MODELS))
def test_no_command_has_no_shape(name: str) -> None:
    shape = CONTINUUM_MODELS[name](make_robot(THIRD, THIRD)).shape(np.zeros((0, 6)))
    assert shape.frames.shape[0] == 0
    assert shape.section_parameters.shape == (0, 2, 2)
    assert shape.converged.shape == shape.reason.shape == (0,)
    assert CONTINUUM_MODELS[name](make_robot(THIRD)).shape(np.zeros((2, 0, 3))).tip.shape == (
        2,
        0,
        3,
    )


@pytest.mark.parametrize("name", list(CONTINUUM_MODELS))
def test_commands_are_kept_not_shared(name: str) -> None:
    commands = PULLED.copy()
    shape = CONTINUUM_MODELS[name](make_robot(THIRD, THIRD)).shape(commands)
    commands[:] = 7.0
    assert np.array_equal(shape.displacements, PULLED)


@pytest.mark.parametrize("name", list(CONTINUUM_MODELS))
def test_every_model_keeps_the_limits(name: str) -> None:
    def told(shape: Shape, words: str) -> bool:
        return bool(shape.converged[0]) and words in shape.reason[1]

    tendons = tuple(Tendon(name=f"t{k}", offset=4.0, angle=0.5 * np.pi * k) for k in range(4))
    held = tuple(dataclasses.replace(tendon, travel=(-6.0, 5.0)) for tendon in tendons)
    for fields, words in (
        ({"tendons": held}, "tendon 't0' is moved 5.5 mm: its travel is [-6, 5] mm"),
        ({"max_bend": 1.0}, "its largest bend is 57.3 deg"),
        ({"radius": 90.0}, "its discs, of radius 90 mm, meet at 63.66 deg"),
    ):
        section = Section(**{"length": 100.0, "radius": 6.0, "tendons": tendons, **fields})
        shape = CONTINUUM_MODELS[name](ContinuumRobot((section,))).shape(
            [[2.0, 0.0, -2.0, 0.0], [5.5, 0.0, -5.5, 0.0]]
        )
        assert told(shape, words)
        assert np.isfinite(shape.frames).all()


@pytest.mark.parametrize("name", ["energy", "rod"])
def test_discs_meet_where_an_uneven_bend_is_tightest(name: str) -> None:
    # The moment of a tendon that comes nearer falls along the robot: so does the curvature.
    tendon = Tendon(name="t", offset=((0.0, 6.0), (100.0, 1.0)))
    for radius, converged in ((20.0, True), (45.0, False)):
        robot = ContinuumRobot((Section(length=100.0, radius=radius, tendons=(tendon,)),))
        shape = CONTINUUM_MODELS[name](robot).shape([6.0])
        assert bool(shape.converged) == converged, shape.reason
    assert "mm where it is tightest: its discs, of radius 45 mm, meet" in str(shape.reason)


@pytest.mark.parametrize("turn", np.radians([0.0, 45.0, 90.0, 135.0, 200.0, 315.0]))
def test_discs_are_drawn_across_the_bend_whatever_its_direction(turn: float) -> None:
    robot = make_robot(QUARTER)
    bend = 1.2 * np.array([[np.cos(turn), np.sin(turn)]])
    shape = robot.forward(displacements_for(robot, bend))
    batch = robot.forward([shape.displacements, 0.5 * shape.displacements])
    axes = shape.plot()
    discs = [np.array(line.get_data()) for line in axes.lines if line.get_color() == "0.7"]
    assert len(discs) == len(shape.disc_arc_length)
    assert len(batch.plot().lines) == 2 * len(axes.lines)
    for disc, place in zip(discs, shape.disc_arc_length, strict=True):
        along = (disc[:, 1] - disc[:, 0]) * (1.0 if disc[0, 1] > disc[0, 0] else -1.0)
        slope = 1.2 * place / robot.length
        radius = robot.sections[0].radius
        assert along == pytest.approx(2.0 * radius * np.array([np.cos(slope), -np.sin(slope)]))

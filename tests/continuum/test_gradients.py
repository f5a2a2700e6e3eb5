"""Derivatives of elastic shapes: by routing and base against differences, and their relations."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bozzini.continuum import (
    ContinuumRobot,
    ElasticModel,
    EnergyModel,
    Helix,
    LineLoad,
    PointLoad,
    RodModel,
    Section,
    Shape,
    ShapeJacobian,
    Tendon,
)
from bozzini.errors import GeometryError, InputError
from tests.continuum.rods import cross_tendons, make_robot

TENDONS = (
    Tendon(name="a", offset=((0.0, 5.0), (60.0, 3.0)), angle=0.3, stiffness=2e3, pretension=0.2),
    Tendon(name="b", offset=4.0, angle=Helix(turns=0.3, start=2.0)),
    Tendon(name="c", offset=4.0, angle=4.0, end=45.0),
)
LOADS = (
    PointLoad(arc_length=33.0, force=(0.01, 0.02, -0.01), moment=(0.2, -0.3, 0.1), frame="world"),
    PointLoad(arc_length=21.0, force=(0.02, -0.01, 0.0)),
    LineLoad(force=(5e-4, 2e-4, 0.0), start=10.0, frame="world"),
    LineLoad(force=(0.0, 4e-4, 0.0), frame="base"),
    PointLoad(force=(0.01, 0.0, 0.01), frame="body"),
)
PULLS = np.array([1.2, 0.9, 0.6])
STEP = 1e-3


def build(*, offset: tuple[int, float] = (0, 0.0), angle: tuple[int, float] = (0, 0.0)) -> Section:
    """A curved section with weight, the routing of one of its tendons changed."""
    tendons = list(TENDONS)
    index, wider = offset
    given = tendons[index].offset
    scaled = (
        tuple((s, r * (1.0 + wider)) for s, r in given)
        if isinstance(given, tuple)
        else given * (1.0 + wider)
    )
    tendons[index] = dataclasses.replace(tendons[index], offset=scaled)
    index, turned = angle
    own = tendons[index].angle
    if isinstance(own, Helix):
        other: object = dataclasses.replace(own, start=own.start + turned)
    else:
        other = own + turned
    tendons[index] = dataclasses.replace(tendons[index], angle=other)
    return Section(
        length=60.0,
        radius=6.0,
        discs=6,
        bending_stiffness=300.0,
        torsional_stiffness=220.0,
        curvature=(2e-3, -1e-3, 3e-3),
        line_weight=4e-4,
        disc_weight=2e-3,
        tendons=tuple(tendons),
    )


def base(position: object = (3.0, 1.0, -2.0), turn: object = (0.4, -0.9, 0.3)) -> dict[str, object]:
    return {"base_position": position, "base_rotation": turn}


def make(kind: str, robot: ContinuumRobot) -> ElasticModel:
    common = {"tip_force": (0.01, -0.02, 0.01), "loads": LOADS, "tendon_stiffness": 3e3}
    if kind == "rod":
        return RodModel(robot, steps=100, **common)
    return EnergyModel(robot, segment=kind, **common)


def find_difference(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Rotation and motion of frames (k, 4, 4) from the other to one, by 2 steps, (k, 6)."""
    turns = one[:, :3, :3] @ np.swapaxes(other[:, :3, :3], 1, 2)
    turned = Rotation.from_matrix(turns).as_rotvec()
    return np.concatenate([turned, one[:, :3, 3] - other[:, :3, 3]], axis=1) / (2.0 * STEP)


@pytest.mark.parametrize("held", ["tensions", "displacements"])
@pytest.mark.parametrize("kind", ["chord", "channel", "rod"])
def test_routing_and_base_are_differences(kind: str, held: str) -> None:
    model = make(kind, ContinuumRobot((build(),), **base()))
    shape = model.shape_under_tensions(PULLS).require()
    found = model.jacobian(shape, held=held)

    def solve(robot: ContinuumRobot) -> Shape:
        other = dataclasses.replace(model, robot=robot)
        if held == "tensions":
            return other.shape_under_tensions(PULLS, initial=shape).require()
        return other.shape(shape.displacements, initial=shape).require()

    def agree(rows: np.ndarray, change: Callable[[float], np.ndarray]) -> None:
        wanted = find_difference(change(STEP), change(-STEP))
        assert rows == pytest.approx(wanted, abs=2e-5 * np.abs(wanted).max() + 2e-6)

    for k in range(len(TENDONS)):
        for column, name in enumerate(("offset", "angle")):

            def wind(h: float, k: int = k, name: str = name) -> np.ndarray:
                return solve(ContinuumRobot((build(**{name: (k, h)}),), **base())).frames

            agree(found.by_routing[..., k, column], wind)
    axes = model.robot.base_frame[:3, :3]
    for k in range(6):

        def place(h: float, k: int = k) -> np.ndarray:
            turn = Rotation.from_matrix(axes) * Rotation.from_rotvec(h * np.eye(6)[k, :3])
            position = model.robot.base_frame[:3, 3] + axes @ (h * np.eye(6)[k, 3:])
            robot = ContinuumRobot((build(),), **base(position, turn.as_rotvec()))
            # Seen from where the base was.
            return np.linalg.inv(model.robot.base_frame) @ solve(robot).world_frames

        agree(found.by_base[..., k], place)


@pytest.mark.parametrize("kind", ["chord", "rod"])
def test_a_batch_has_the_derivatives_of_each_and_they_agree_with_each_other(kind: str) -> None:
    model = make(kind, ContinuumRobot((build(),), **base()))
    shapes = model.shape_under_tensions(np.array([PULLS, 0.5 * PULLS]))
    for held in ("tensions", "displacements"):
        both = model.jacobian(shapes, held=held)
        alone = model.jacobian(model.shape_under_tensions(0.5 * PULLS), held=held)
        for field in dataclasses.fields(ShapeJacobian)[2:]:
            many, one = getattr(both, field.name), getattr(alone, field.name)
            assert many.shape == (2, *one.shape)
            assert many[1] == pytest.approx(one, abs=1e-8 * np.abs(one).max())
        # Displacements act by the tensions that they make.
        acted = both.by_tension @ both.tensions_by_displacement[:, None]
        assert both.by_displacement == pytest.approx(acted, abs=1e-9 * np.abs(acted).max())
        # The clamped end moves with the base, and by nothing else.
        assert np.array_equal(both.by_base[:, 0], np.stack([np.eye(6)] * 2))
        assert not both.by_routing[:, 0].any() and not both.by_tip_wrench[:, 0].any()
        # About the vertical, weight and loads of the world turn with the robot but for their way.
        assert both.by_base[..., 3:] == pytest.approx(
            np.concatenate([np.zeros((3, 3)), np.eye(3)]) + 0.0 * both.by_base[..., 3:]
        )


@pytest.mark.parametrize("kind", ["chord", "channel", "rod"])
def test_symmetries_of_routing_and_base(kind: str) -> None:
    robot = make_robot(cross_tendons(3), discs=6, line_weight=5e-4, disc_weight=1e-3)
    turned = dataclasses.replace(robot, base_rotation=(0.7, 0.2, 0.0))
    command = np.array([2.0, 0.5, -3.0])

    def build_model(own: ContinuumRobot) -> ElasticModel:
        return RodModel(own) if kind == "rod" else EnergyModel(own, segment=kind)

    # About the vertical a robot with its weight moves as a rigid body.
    model = build_model(turned)
    shape = model.shape_under_tensions([0.4, 0.1, 0.0]).require()
    found = model.jacobian(shape, held="tensions")
    vertical = turned.base_frame[:3, :3].T @ [0.0, 0.0, 1.0]
    motion = found.by_base[..., :3] @ vertical
    assert motion[:, :3] == pytest.approx(np.tile(vertical, (len(motion), 1)), abs=1e-9)
    assert motion[:, 3:] == pytest.approx(np.cross(vertical, shape.points), abs=1e-7)
    # Without weight all tendons clocked alike turn the shape, and wider ones bend it less.
    model = build_model(make_robot(cross_tendons(3), discs=6))
    shape = model.shape(command).require()
    found = model.jacobian(shape)
    clocked = found.by_routing[..., 1].sum(axis=-1)
    assert clocked[:, 3:] == pytest.approx(np.cross([0.0, 0.0, 1.0], shape.points), abs=1e-6)
    wider = found.by_routing[..., 0].sum(axis=-1)
    less = -found.by_displacement @ shape.displacements
    assert wider == pytest.approx(less, abs=1e-5 * np.abs(less).max())


def test_shapes_of_others_are_refused() -> None:
    robot = ContinuumRobot((build(),), **base())
    model, other = make("chord", robot), make("channel", robot)
    shape = model.shape_under_tensions(PULLS)
    for wrong in (make("rod", robot), dataclasses.replace(other, between=1)):
        with pytest.raises(InputError, match="shape is of the energy model"):
            wrong.jacobian(shape)
    with pytest.raises(InputError, match=r"held is 'length'"):
        model.jacobian(shape, held="length")  # type: ignore[arg-type]
    limited = dataclasses.replace(
        model,
        robot=dataclasses.replace(
            robot, sections=(dataclasses.replace(robot.sections[0], max_bend=math.radians(1.0)),)
        ),
    )
    with pytest.raises(GeometryError, match="its largest bend is 1 deg"):
        limited.jacobian(limited.shape_under_tensions(PULLS))

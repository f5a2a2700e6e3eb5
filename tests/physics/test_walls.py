"""Walls in MuJoCo: forces and depths against their stated compliance, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.duct import SampledField
from bozzini.errors import GeometryError, InputError
from bozzini.physics.simulate import Chain, Dynamics, Simulation
from bozzini.physics.walls import LumenWall, WallOptions, build_prisms
from tests.shapes import sample_field

HALF = 20.0
RADIUS = 3.0
WEAK = {"slide_gain": 1e-3, "slide_damping": 0.01}
KINDS = ("penalty", "prism")


@pytest.fixture(scope="module")
def room() -> SampledField:
    """A cubic lumen with flat walls."""

    def distance(points):
        off = np.abs(points) - HALF
        beyond = np.linalg.norm(np.maximum(off, 0.0), axis=-1)
        return beyond + np.minimum(off.max(axis=-1), 0.0)

    return sample_field(distance, [-HALF - 4.0] * 3, [HALF + 4.0] * 3, 1.0)


def make_capsule(height):
    """Return a chain of one link that points up from a height [mm]."""
    frame = np.eye(4)
    frame[:3, 3] = 1.3, 0.7, height
    return Chain(
        lengths=np.array([10.0]),
        radius=RADIUS,
        frame=frame,
        springs=np.zeros(1),
        servos=np.full(1, 500.0),
    )


def press(room, force, *, height=16.9, **options):
    """Press a capsule, end on, against the upper wall with a force [N] until it rests."""
    step = options.pop("step", 0.002)
    wall = LumenWall(duct=room, options=WallOptions(faces=400, **options))
    simulation = Simulation(make_capsule(height - 10.0), wall, Dynamics(step=step, **WEAK))
    simulation.data.xfrc_applied[2, 2] = 1e3 * force
    for _ in range(round(3.0 / step)):
        simulation.step(np.array([simulation.inserted, 0.0, 0.0]))
    return simulation


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("stiffness", [0.1, 0.3, 1.0])
def test_a_pressed_capsule_has_the_force_and_the_stated_depth(room, kind, stiffness) -> None:
    force = 0.1
    touch = press(room, force, kind=kind, stiffness=stiffness).touch
    resultant = np.linalg.norm(touch.forces.sum(axis=0))
    assert resultant == pytest.approx(force, abs=0.001)
    # Places side by side share the force, as springs do.
    compliance = WallOptions(stiffness=stiffness).compliance
    assert touch.depths.mean() == pytest.approx(force * compliance / len(touch.links), rel=0.05)
    assert touch.depths == pytest.approx(compliance * touch.normals, rel=0.05)


@pytest.mark.parametrize("kind", KINDS)
def test_the_depth_does_not_depend_on_the_mass(room, kind) -> None:
    # MuJoCo's own reference is a stiffness per mass.
    depths = []
    for density in (1100.0, 11000.0):
        wall = LumenWall(duct=room, options=WallOptions(kind=kind, faces=400))
        simulation = Simulation(make_capsule(6.9), wall, Dynamics(density=density, **WEAK))
        simulation.data.xfrc_applied[2, 2] = 100.0
        for _ in range(1500):
            simulation.step(np.array([simulation.inserted, 0.0, 0.0]))
        depths.append(-simulation.least)
    assert depths[0] == pytest.approx(depths[1], rel=0.01)


@pytest.mark.parametrize("stiffness", [1.0, 100.0])
def test_the_penalty_wall_is_stable_at_any_stiffness(room, stiffness) -> None:
    # An explicit force would need a step below 2 sqrt(m / k): 1.3 ms at 1 N/mm, 0.13 ms at 100.
    simulation = press(room, 0.1, kind="penalty", stiffness=stiffness, step=0.005)
    assert abs(simulation.data.qvel).max() < 1e-6
    assert -simulation.least == pytest.approx(0.1 / stiffness, rel=1e-3)


def test_friction_holds_up_to_coulombs_limit(room) -> None:
    held = {}
    for friction in (0.0, 0.3):
        simulation = press(room, 0.1, kind="penalty", friction=friction)
        simulation.data.xfrc_applied[2, 0] = 20.0  # mN across, below 0.3 x 100 mN
        for _ in range(500):
            simulation.step(np.array([simulation.inserted, 0.0, 0.0]))
        touch = simulation.touch
        across = np.linalg.norm(touch.forces.sum(axis=0)[:2])
        assert across <= friction * touch.normals.sum() * (1.0 + 1e-6) + 1e-9
        held[friction] = across
    assert held[0.0] == 0.0
    assert held[0.3] > 0.0


def test_prisms_stop_half_way_to_the_next_lumen() -> None:
    import trimesh

    gap = 1.0
    boxes = [trimesh.creation.box([20.0, 20.0, 20.0]) for _ in range(2)]
    boxes[1].apply_translation([20.0 + gap, 0.0, 0.0])
    both = trimesh.util.concatenate([box.subdivide().subdivide() for box in boxes])
    prisms = build_prisms((np.asarray(both.vertices), np.asarray(both.faces)), thickness=3.0)
    assert prisms.thickness.max() == pytest.approx(3.0, rel=0.05)
    depths = np.abs(prisms.corners[:, 3:, 0] - 10.0 - 0.5 * gap)
    between = (prisms.corners[:, :3, 0].min(axis=1) > 9.9) & (
        prisms.corners[:, :3, 0].max(axis=1) < 10.0 + gap + 0.1
    )
    inner = between & (np.abs(prisms.corners[:, :3, 1:]).max(axis=(1, 2)) < 9.0)
    assert inner.any()
    assert depths[inner].max() < 0.2 * gap  # both end near the middle
    assert not prisms.findings


def test_a_thin_septum_is_reported() -> None:
    import trimesh

    boxes = [trimesh.creation.box([20.0, 20.0, 20.0]).subdivide() for _ in range(2)]
    boxes[1].apply_translation([20.1, 0.0, 0.0])
    both = trimesh.util.concatenate(boxes)
    prisms = build_prisms((np.asarray(both.vertices), np.asarray(both.faces)))
    assert "thinnest near (10." in prisms.findings[0]


def test_an_open_surface_is_refused() -> None:
    import trimesh

    box = trimesh.creation.box([20.0, 20.0, 20.0])
    with pytest.raises(GeometryError, match="a hole of 3 edges near"):
        build_prisms((np.asarray(box.vertices), np.asarray(box.faces)[1:]))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("gap", [1.0, 2.0])
def test_a_wall_thinner_than_the_body_is_deep_in_it_holds_as_stated(kind, gap) -> None:
    # Two rooms with a thin wall between; the body is pressed to beyond its middle.
    def distance(points):
        rooms = []
        for height in (0.0, 2.0 * HALF + gap):
            off = np.abs(points - [0.0, 0.0, height]) - HALF
            beyond = np.linalg.norm(np.maximum(off, 0.0), axis=-1)
            rooms.append(beyond + np.minimum(off.max(axis=-1), 0.0))
        return np.minimum(*rooms)

    size = HALF + 4.0
    rooms = sample_field(distance, [-size] * 3, [size, size, size + 2.0 * HALF + gap], 0.5)
    simulation = press(rooms, 0.3, kind=kind)
    assert np.linalg.norm(simulation.touch.forces.sum(axis=0)) == pytest.approx(0.3, abs=1e-3)
    assert -simulation.least == pytest.approx(0.3 * WallOptions().compliance, rel=0.05)


def test_a_mouth_that_leaves_no_wall_is_refused(room) -> None:
    from bozzini.motion.scope import Introducer

    tube = Introducer(
        entry=np.array([0.0, 0.0, -HALF]), outward=np.array([0.0, 0.0, -1.0]), bore=4.0
    )
    wall = LumenWall(duct=room, introducer=tube, options=WallOptions(mouth=500.0, faces=400))
    with pytest.raises(InputError, match="mouth is 500 mm: it must be less"):
        _ = wall.prisms


def test_a_link_that_is_shot_through_the_wall_is_seen(room) -> None:
    # 10 N on less than a gram, from 7 mm away: thin prisms are passed in a step.
    wall = LumenWall(duct=room, options=WallOptions(kind="prism", faces=400, thickness=0.2))
    chain = Chain(
        lengths=np.array([10.0]),
        radius=RADIUS,
        frame=np.eye(4),
        springs=np.zeros(1),
        servos=np.full(1, 500.0),
    )
    simulation = Simulation(chain, wall, Dynamics(slide_gain=1e-3, slide_damping=1e-6))
    simulation.data.xfrc_applied[2, 2] = 10_000.0
    for _ in range(60):
        simulation.step(np.array([simulation.inserted, 0.0, 0.0]))
    assert simulation.least + RADIUS < 0.0


def test_a_planar_duct_is_refused() -> None:
    from bozzini.duct.shapes.cones import Circles  # a planar shape

    with pytest.raises(InputError, match="planar"):
        LumenWall(duct=Circles(centres=[[0.0, 0.0]], radii=[1.0]))


def test_forces_that_do_not_settle_are_told() -> None:
    """Two contacts that press each other through one mass: no sweep is enough for 1e-300."""
    from bozzini.physics.kernels.contact import balance_contacts

    effect = np.kron(np.array([[1.0, 0.9], [0.9, 1.0]]), np.eye(3))
    depth, velocity = np.array([0.1, 0.2]), np.zeros(6)
    loose, tight = np.zeros(6), np.zeros(6)
    assert balance_contacts(effect, velocity, depth, (300.0, 1.0, 0.1, 1e-3, 1e-6), loose)
    assert not balance_contacts(effect, velocity, depth, (300.0, 1.0, 0.1, 1e-3, -1.0), tight)
    np.testing.assert_allclose(loose, tight, rtol=1e-4, atol=1e-6)

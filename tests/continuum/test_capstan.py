"""Friction of tendons in time: the static law's limit, sticking, energy, and no friction at all."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from bozzini.continuum import (
    ContactOptions,
    ContinuumRobot,
    DynamicsOptions,
    RodModel,
    Section,
    Tendon,
    Wire,
    simulate,
)

LENGTH = 100.0
OPTIONS = DynamicsOptions(segment="channel", damping_time=0.02, max_step=2e-3)


def make_arm(friction: float = 0.3, twist: float = 0.0, stiffness: float = 2e3) -> ContinuumRobot:
    """A section of two tendons; they wind about the backbone if it has a twist."""
    wire = Wire(diameter=1.0, modulus=60e3, density=6450.0)
    tendons = tuple(
        Tendon(
            name=name,
            offset=4.0,
            angle=((0.0, angle), (LENGTH, angle + twist)),
            friction=friction,
            stiffness=stiffness,
        )
        for name, angle in (("A", 0.0), ("B", math.pi))
    )
    section = Section(
        length=LENGTH, radius=5.0, discs=14, wire=wire, line_weight=1e-4, tendons=tendons
    )
    return ContinuumRobot((section,))


def hold(commands, dwell: float):
    """Times and commands that go from row to row, and stay there as long."""
    times = dwell * np.arange(2 * len(commands))
    return times, np.repeat(commands, 2, axis=0)


WAYS = {
    "tensions": [
        [0.0, 0.5],
        [6.0, 0.5],
        [2.0, 0.5],
        [2.4, 0.5],
        [2.0, 0.5],
        [2.0, 3.0],
        [5.0, 3.0],
    ],
    "displacements": [[0.0, 0.0], [3.0, -2.9], [1.0, -0.9], [1.2, -1.1], [1.0, -0.9], [3.0, -2.9]],
}


@pytest.mark.parametrize("given", list(WAYS))
@pytest.mark.parametrize(("segment", "twist"), [("channel", 2.0), ("arc", 0.0)])
def test_slow_motion_is_the_static_history(given: str, segment: str, twist: float) -> None:
    robot, corners = make_arm(twist=twist), np.array(WAYS[given])
    way = [
        np.linspace(one, two, 16)[1:] for one, two in zip(corners[:-1], corners[1:], strict=True)
    ]
    commands = np.concatenate([corners[:1], *way])
    model = RodModel(robot)
    trace = model.trace_tensions if given == "tensions" else model.trace_displacements
    still = trace(commands).shapes
    times, rows = hold(commands, 0.5)
    options = dataclasses.replace(OPTIONS, segment=segment, max_step=0.25, spectral_radius=0.5)
    moved = simulate(robot, times, **{given: rows}, options=options)
    assert still.converged.all() and moved.converged
    away = np.linalg.norm(moved.tip[1::2] - still.tip, axis=-1)
    reach = np.ptp(still.tip[:, 0])
    assert reach > 20.0
    # Where a tendon slides to and fro within a command, the static answer depends on its parts.
    near = 2.5e-3 if segment == "channel" else 8e-3
    assert max(away[::15].max(), np.quantile(away, 0.9)) < near * reach
    np.testing.assert_allclose(moved.tensions[1::30], still.tensions[::15], atol=0.1)
    np.testing.assert_allclose(moved.displacements[1::30], still.displacements[::15], atol=0.03)
    # Without friction it is another motion.
    smooth = simulate(make_arm(0.0, twist), times, **{given: rows}, options=options)
    assert np.linalg.norm(moved.tip - smooth.tip, axis=-1).max() > 0.03 * reach


def measure_angles(moved):
    """Angles by which a straight tendon has turned up to the middles of the segments."""
    tangents = moved.frames[-1, :, :3, 2]
    turned = np.arccos(np.clip(tangents @ tangents[0], -1.0, 1.0))
    return 0.5 * (turned[1:] + turned[:-1])


def test_tension_falls_by_the_angle_and_sticks_on_the_way_back() -> None:
    robot, options = make_arm(), dataclasses.replace(OPTIONS, max_step=0.02)
    times = np.array([0.0, 2.0, 3.0])
    pulled = simulate(robot, times, tensions=[[0.0, 0.0], [6.0, 0.0], [6.0, 0.0]], options=options)
    angles = measure_angles(pulled)
    tensions = pulled.state.pulls[0]
    assert angles[-1] > 0.5 and tensions[0] == 6.0
    np.testing.assert_allclose(tensions[1:], 6.0 * np.exp(-0.3 * angles), rtol=3e-4)
    tips = []
    for tension in (5.8, 6.2, 6.0, 3.0):
        rows = [[6.0, 0.0], [tension, 0.0], [tension, 0.0]]
        then = simulate(robot, times + 3.0, tensions=rows, options=options, initial=pulled)
        tips.append((then.state.pulls[0, -1], then.tip[-1, 0]))
        if tension == 6.2:
            fallen = 6.2 * math.exp(-0.3 * measure_angles(then)[-1])
            assert tips[-1][0] == pytest.approx(fallen, rel=1e-3)
        back = simulate(robot, times + 6.0, tensions=rows[::-1], options=options, initial=then)
        if tension == 5.8:  # a reversal within the dead band leaves no trace
            assert back.tip[-1] == pytest.approx(pulled.tip[-1], abs=0.01)
        if tension == 3.0:
            assert back.tip[-1, 0] < pulled.tip[-1, 0] + 1e-3
    (low, low_tip), (high, high_tip), (same, same_tip), (far, _) = tips
    onwards = high - same
    assert onwards > 0.1
    assert abs(low - same) < 0.01 * onwards
    assert abs(low_tip - same_tip) < 0.2 * (high_tip - same_tip)
    assert far > 3.1  # it slides to the tip: there is more tension than at the drive


@pytest.mark.parametrize("segment", ["chord", "arc", "channel"])
@pytest.mark.parametrize("given", ["tensions", "displacements"])
def test_without_friction_it_is_the_motion_without(segment: str, given: str) -> None:
    times = np.linspace(0.0, 0.3, 31)
    size = 4.0 if given == "tensions" else 2.0
    commands = size * np.sin(np.outer(times, [17.0, 23.0])) ** 2
    options = dataclasses.replace(OPTIONS, segment=segment, drag=1e-6)
    none, little, some = (
        simulate(make_arm(friction, 1.0), times, **{given: commands}, options=options)
        for friction in (0.0, 1e-9, 0.1)
    )
    np.testing.assert_allclose(little.frames, none.frames, atol=1e-5)
    np.testing.assert_allclose(little.tensions, none.tensions, atol=1e-6)
    np.testing.assert_allclose(little.displacements, none.displacements, atol=1e-7)
    assert np.abs(some.tip - none.tip).max() > 0.1
    assert not none.energy.friction.any() and none.state.pulls.size == 0


@pytest.mark.parametrize("given", ["tensions", "displacements"])
def test_friction_only_takes_energy_and_the_balance_closes(given: str) -> None:
    times = np.linspace(0.0, 0.4, 401)
    size = 4.0 if given == "tensions" else 2.0
    commands = 0.2 * size + size * np.sin(np.outer(times, [17.0, 23.0])) ** 2
    residuals = []
    for step in (1e-3, 2.5e-4):
        options = dataclasses.replace(OPTIONS, max_step=step)
        moved = simulate(make_arm(), times, **{given: commands}, options=options)
        balance = moved.energy
        assert np.diff(balance.friction).min() >= 0.0
        assert np.all(balance.friction <= balance.dissipated)
        residuals.append(moved.residual / balance.friction[-1])
    assert balance.friction[-1] > 1.0
    assert residuals[1] < 0.5 * residuals[0] and residuals[1] < 0.02


@pytest.mark.parametrize("step", [1e-3, 0.02, 0.5])
def test_it_is_stable_at_any_step(step: float) -> None:
    # What is pulled slowly, or by one large step, comes to rest at the same place.
    times = np.array([0.0, 4.0, 8.0])
    rows = [[0.0, 0.5], [5.0, 0.5], [5.0, 0.5]]
    options = dataclasses.replace(OPTIONS, max_step=step, spectral_radius=0.5)
    moved = simulate(make_arm(), times, tensions=rows, options=options)
    model = RodModel(make_arm())
    still = model.trace_tensions(np.linspace(rows[0], rows[1], 20)).shapes
    assert np.linalg.norm(moved.tip[-1] - still.tip[-1]) < 3e-3 * still.tip[-1, 0]
    assert np.abs(moved.velocities[-1]).max() < 0.1


def test_a_motion_with_friction_goes_on_from_where_it_was() -> None:
    times = np.linspace(0.0, 0.2, 21)
    pulls = np.outer(np.sin(30.0 * times) ** 2, [3.0, 0.0]) + 0.2
    whole = simulate(make_arm(), times, tensions=pulls, options=OPTIONS)
    first = simulate(make_arm(), times[:11], tensions=pulls[:11], options=OPTIONS)
    second = simulate(make_arm(), times[10:], tensions=pulls[10:], options=OPTIONS, initial=first)
    np.testing.assert_allclose(second.tip, whole.tip[10:], atol=1e-5)
    np.testing.assert_allclose(second.state.pulls, whole.state.pulls, atol=1e-5)


@dataclasses.dataclass(frozen=True)
class Tub:
    """A lumen between two planes."""

    half: float = 12.0
    dim: int = 3
    error: float = 0.0

    def signed_distance(self, points, /):
        return np.abs(np.asarray(points)[..., 0]) - self.half


def test_a_robot_with_friction_is_held_by_a_wall() -> None:
    times = np.linspace(0.0, 2.0, 101)
    pulls = np.outer(np.minimum(times, 1.0), [5.0, 0.0])
    known = {"tensions": pulls, "options": OPTIONS}
    contact = ContactOptions(wall_stiffness=0.5, friction=0.2)
    free = simulate(make_arm(), times, **known)
    held = simulate(make_arm(), times, duct=Tub(), contact=contact, **known)
    assert free.tip[-1, 0] > 15.0 > held.tip[-1, 0]
    assert held.converged and held.wall_sum[-1] > 0.1
    assert np.diff(held.energy.friction).min() >= 0.0
    # The wall keeps it straighter: less friction.
    assert held.state.pulls[0, -1] > free.state.pulls[0, -1]

"""The workspace against areas in closed form, the inverse and the forward model."""

from __future__ import annotations

import math
from functools import partial
from itertools import combinations

import numpy as np
import pytest

from bozzini.effector.design import PlacedMuscle, effector_preset
from bozzini.effector.effector import Effector
from bozzini.effector.inverse import solve_inverse
from bozzini.effector.linkage import find_peak
from bozzini.effector.pose import pose
from bozzini.effector.workspace import place_tips, workspace
from tests.effector.models import SpringMuscle

PROTOTYPE = effector_preset("prototype")
STRONG = partial(SpringMuscle, spring=50.0, gain=40.0)


def turn_muscles(degrees: list[float]):
    muscle = PROTOTYPE.muscles[0].muscle
    return PROTOTYPE.replace(
        muscles=tuple(
            PlacedMuscle(name=f"M{k}", muscle=muscle, angle=math.radians(angle))
            for k, angle in enumerate(degrees)
        )
    )


def cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


@pytest.mark.parametrize(
    "degrees", [[307.5, 219.0, 75.0], [0.0, 120.0, 240.0], [10.0, 160.0, 200.0]]
)
def test_three_muscles_make_a_convex_hexagon_which_is_all_they_reach(degrees: list[float]) -> None:
    design = turn_muscles(degrees)
    found = workspace(Effector(design), directions=12)
    amplitudes = found.reach.amplitudes
    # All sums of the three, 0 <= a_i <= A_i, have this area; the parallelograms of pairs fill it.
    everything = sum(
        amplitudes[i] * amplitudes[j] * abs(math.sin(design.angles[i] - design.angles[j]))
        for i, j in combinations(range(3), 2)
    )
    assert found.area == pytest.approx(everything, rel=1e-12)
    step = np.roll(found.boundary, -1, axis=0) - found.boundary
    assert cross(step, np.roll(step, -1, axis=0)).min() > -1e-9
    assert not found.limited.any()


def test_corners_of_the_thesis() -> None:
    # With A = 22.4 mm (thesis 4.5); the ratios hold for any amplitude.
    found = workspace(Effector(PROTOTYPE), directions=12)
    ratio = np.hypot(*found.sector_corners.T) / found.reach.amplitudes[0]
    assert 22.4 * ratio == pytest.approx([13.84, 32.09, 19.81], abs=0.01)
    assert found.outer_radius == pytest.approx(ratio.max() * found.reach.amplitudes[0])


def test_four_muscles_at_right_angles_make_a_square() -> None:
    found = workspace(Effector(turn_muscles([0.0, 90.0, 180.0, 270.0])), directions=12)
    side = 2.0 * found.reach.amplitudes[0]
    assert found.area == pytest.approx(side**2, rel=1e-9)
    assert found.inner_radius == pytest.approx(0.5 * side, rel=1e-9)


def test_inner_radius_is_reachable_all_round_and_no_more() -> None:
    effector = Effector(PROTOTYPE)
    radius = workspace(effector).inner_radius
    angle = np.linspace(0.0, 2.0 * math.pi, 2001)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert solve_inverse(effector, radius * (1.0 - 1e-9) * ring).reachable.all()
    assert not solve_inverse(effector, radius * 1.001 * ring).reachable.all()


def test_points_inside_are_where_the_pose_brings_the_tip() -> None:
    effector = Effector(PROTOTYPE)
    found = workspace(effector, directions=60, samples=150)
    assert 100 < len(found.interior) < 250
    for lateral, tip, holder in (
        (found.interior, found.tip, found.holder_tip),
        (found.boundary, found.boundary_tip, found.boundary_holder_tip),
    ):
        answer = solve_inverse(effector, lateral)
        assert answer.reachable.all()
        posed = pose(effector, answer.pressures)
        assert np.abs(posed.tip - tip).max() < 1e-8
        assert np.abs(posed.holder_tip - holder).max() < 1e-8
    outwards = solve_inverse(effector, found.boundary * 1.0001)
    assert not outwards.reachable.any()


@pytest.mark.slow
def test_area_of_the_surface_against_triangles() -> None:
    effector = Effector(PROTOTYPE)
    found = workspace(effector, directions=720)
    # Rings of the boundary, shrunk: two triangles between each two points.
    share = np.linspace(0.0, 1.0, 201)
    rings = share[:, np.newaxis, np.newaxis] * found.boundary
    tip, _ = place_tips(PROTOTYPE, rings)
    one, two = tip[:-1], tip[1:]
    right, left = np.roll(one, -1, axis=1), np.roll(two, -1, axis=1)
    area = 0.5 * np.linalg.norm(np.cross(two - one, left - one), axis=-1).sum()
    area += 0.5 * np.linalg.norm(np.cross(left - one, right - one), axis=-1).sum()
    assert found.tip_area == pytest.approx(area, rel=3e-5)
    assert found.tip_area > found.area


def test_the_backbone_limits_strong_muscles() -> None:
    effector = Effector(PROTOTYPE, STRONG)
    peak = find_peak(PROTOTYPE).lateral
    found = workspace(effector, directions=2000)
    assert found.outer_radius == pytest.approx(peak)
    assert found.limited.any() and not found.limited.all()
    assert found.area < math.pi * peak**2
    weak = workspace(Effector(PROTOTYPE))
    assert found.area < weak.area * (peak / weak.reach.amplitudes[0]) ** 2
    # The arc is a chord polygon: half the directions change little.
    assert workspace(effector, directions=1000).area == pytest.approx(found.area, rel=1e-4)


@pytest.mark.parametrize(("degrees", "points"), [([30.0], 2), ([0.0, 100.0], 4)])
def test_gaps_lead_through_the_origin(degrees: list[float], points: int) -> None:
    found = workspace(Effector(turn_muscles(degrees)), directions=12)
    assert found.inner_radius == 0.0
    assert np.hypot(*found.boundary.T).min() == 0.0
    assert len(found.boundary) >= points
    assert 500 < len(found.interior) < 5000
    size = found.reach.amplitudes[0]
    assert found.area == pytest.approx(
        size**2 * math.sin(math.radians(100.0)) if points == 4 else 0.0, abs=1e-9
    )


def test_no_workspace_below_the_dead_band() -> None:
    found = workspace(Effector(PROTOTYPE.replace(pressure_limit=0.01)))
    assert found.area == 0.0 and found.outer_radius == 0.0 and found.tip_area == 0.0
    assert not found.interior.any() and len(found.interior) == 1

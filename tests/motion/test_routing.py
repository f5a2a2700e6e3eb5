"""Routings designed for a curve: closed forms, limits, both models, and what the way in takes."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest

from bozzini.continuum import ContinuumRobot, RodModel, Section
from bozzini.continuum.routing import (
    BackboneSteps,
    RoutingLimits,
    find_bends,
    fit_bend,
    route_one,
    route_pair,
)
from bozzini.errors import GeometryError, InputError
from bozzini.motion.routing import (
    InsertionRankOptions,
    RobotSearch,
    design_routing,
    insertion_rank,
)

STIFFNESS = np.array([200.0, 200.0, 200.0 / 1.3])


def bend_s(length: float = 120.0, angle: float = 0.9) -> np.ndarray:
    """A planar S, arc length from 0: two bends of opposite sign."""
    s = np.linspace(0.0, length, 1201)
    turn = angle * np.sin(2.0 * math.pi * s / length)
    ways = np.stack([np.sin(turn), 0.0 * s, np.cos(turn)], axis=1)
    steps = 0.5 * (ways[1:] + ways[:-1]) * np.diff(s)[:, None]
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def wind_helix(radius: float = 15.0, pitch: float = 30.0, length: float = 120.0) -> np.ndarray:
    rise = pitch / (2.0 * math.pi)
    turn = np.linspace(0.0, length / math.hypot(radius, rise), 1201)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), rise * turn], axis=1)


CURVES = {"s": bend_s(), "helix": wind_helix()}


@pytest.fixture(scope="module")
def designs():  # type: ignore[no-untyped-def]
    return {
        (name, tendons): design_routing(curve, tendons=tendons)
        for name, curve in CURVES.items()
        for tendons in (1, 2)
    }


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("tendons", [1, 2])
def test_the_rod_takes_the_curve_under_the_tensions(designs, name, tendons) -> None:  # type: ignore[no-untyped-def]
    design = designs[name, tendons]
    assert design.converged, design.reason
    assert design.error_rms <= 0.05
    assert design.energy_error_rms <= 0.05
    # Told by displacements, the rod finds the tensions again.
    shape = RodModel(design.robot).shape(design.displacements).require()
    assert shape.tensions == pytest.approx(design.tensions, rel=1e-3)
    limits = RoutingLimits()
    assert design.slope <= limits.slope_max + 1e-3
    assert design.gap >= limits.gap_min - 1e-3
    assert design.offset_most <= limits.offset_max + 1e-3


def test_one_tendon_crosses_the_backbone_at_an_inflection_and_two_do_not(designs) -> None:  # type: ignore[no-untyped-def]
    assert designs["s", 1].offset_least < 0.2
    assert designs["s", 2].offset_least == pytest.approx(2.0, abs=5e-3)
    assert designs["helix", 1].offset_least > 1.9


def test_a_design_moves_with_the_curve(designs) -> None:  # type: ignore[no-untyped-def]
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    moved = design_routing(CURVES["helix"] @ turn.T + [5.0, 0.0, -3.0], tendons=1)
    design = designs["helix", 1]
    assert moved.tensions == pytest.approx(design.tensions, rel=1e-3)
    assert moved.frame[:3, 2] == pytest.approx(turn @ design.frame[:3, 2], abs=1e-4)


def test_stiffness_scales_tension_and_nothing_else(designs) -> None:  # type: ignore[no-untyped-def]
    body = ContinuumRobot((Section(length=10.0, radius=2.5, bending_stiffness=600.0),))
    stiff = design_routing(CURVES["helix"], tendons=1, robot=body)
    design = designs["helix", 1]
    assert stiff.tensions == pytest.approx(3.0 * design.tensions, rel=2e-3)
    assert stiff.displacements == pytest.approx(design.displacements, rel=2e-3)


def test_sensitivity_is_that_of_the_rod(designs) -> None:  # type: ignore[no-untyped-def]
    design = designs["s", 2]
    model = RodModel(design.robot, between=3)
    moved = model.shape_under_tensions(1.01 * design.tensions)
    off = np.linalg.norm(moved.points - model.shape_under_tensions(design.tensions).points, axis=1)
    assert design.by_tension[-1] == pytest.approx(off.max())
    assert np.all(design.by_displacement > 0.0)


def test_the_twist_of_the_closed_form_is_the_rods() -> None:
    # A helical curve of curvature times offset below 0.1.
    target = fit_bend(wind_helix(radius=20.0, pitch=60.0))
    tension = 1.02 * STIFFNESS[0] * target.sharpest / 1.5
    path = route_one(target, STIFFNESS, tension)
    assert target.sharpest * np.hypot(*path.T).max() < 0.1
    places = target.steps.places
    slopes = np.stack([np.gradient(column, places) for column in path.T], axis=1)
    guides = np.concatenate([path, slopes], axis=1)[:, None]
    bends, _, _ = find_bends(STIFFNESS, guides, np.array([tension]), start=np.zeros((len(path), 3)))
    x, y = target.curvature.T
    turning = (x * target.slope[:, 1] - y * target.slope[:, 0]) / (x**2 + y**2)
    close = np.hypot(x, y) * np.hypot(*path.T)
    first = -(STIFFNESS[0] / STIFFNESS[2]) * close * turning
    inner = slice(10, -10)
    assert bends[inner, 2] == pytest.approx((first / (1.0 - close))[inner], rel=0.01)
    assert bends[inner, 2] == pytest.approx(first[inner], rel=0.1)


def test_a_curve_in_a_plane_needs_no_twist() -> None:
    target = fit_bend(bend_s())
    path = route_one(target, STIFFNESS, 5.0)
    across = np.linalg.svd(path)[1]
    assert across[1] < 1e-3 * across[0]


def test_moves_of_a_backbone_are_its_differences() -> None:
    rng = np.random.default_rng(1)
    steps = BackboneSteps.cut(50.0)
    bends, change = 0.05 * rng.normal(size=(2, 2 * steps.count, 3))
    trace = steps.trace(bends, np.eye(4), moves=True)
    told = trace.move(change.reshape(steps.count, 2, 3, 1))[..., 0]
    far, near = (steps.trace(bends + e * change, np.eye(4)).points for e in (1e-6, -1e-6))
    assert told == pytest.approx((far - near) / 2e-6, abs=1e-6)


def test_curvatures_derivatives_are_differences() -> None:
    rng = np.random.default_rng(2)
    guides = rng.normal(size=(4, 2, 4)) * [1.5, 1.5, 0.2, 0.2]
    tensions, start = np.array([4.0, 6.0]), np.zeros((4, 3))
    _, by_guides, by_tensions = find_bends(STIFFNESS, guides, tensions, start=start)
    way = rng.normal(size=guides.shape)
    far, near = (
        find_bends(STIFFNESS, guides + e * way, tensions, start=start)[0] for e in (1e-6, -1e-6)
    )
    told = np.einsum("mkcu,mkc->mu", by_guides, way)
    assert told == pytest.approx((far - near) / 2e-6, abs=1e-8)
    far, near = (find_bends(STIFFNESS, guides, tensions + e, start=start)[0] for e in (1e-6, -1e-6))
    assert by_tensions.sum(axis=1) == pytest.approx((far - near) / 2e-6, abs=1e-8)


def test_limits_that_cannot_be_kept_are_a_reason() -> None:
    design = design_routing(
        CURVES["s"], tendons=1, limits=RoutingLimits(core_radius=1.0, error_max=0.1)
    )
    assert not design.converged
    assert "from the curve" in design.reason or "core's radius" in design.reason


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: design_routing(CURVES["s"], tendons=5), "tendons is 5: it must lie in [1, 4]"),
        (lambda: design_routing(CURVES["s"][:1]), "it must be (m, 3) with m at least 2"),
        (lambda: design_routing(0.01 * CURVES["s"]), "it must be 5 to 1500 mm"),
        (
            lambda: design_routing(CURVES["helix"], limits=RoutingLimits(offset_max=18.0)),
            "offset max is 18 mm: it must be less than 16.",
        ),
        (
            lambda: design_routing(CURVES["s"], tendons=4, limits=RoutingLimits(gap_min=3.0)),
            "gap min is 3 mm: 4 tendons 2 mm from the backbone are at most 2.83 mm apart",
        ),
        (lambda: design_routing(100.0 * CURVES["s"]), "it must be 5 to 1500 mm"),
        (lambda: RoutingLimits(core_radius=3.0), "core radius is 3 mm: it must lie in [0, 2] mm"),
        (lambda: InsertionRankOptions(modes=(0,)), "modes[0] is 0"),
        (lambda: InsertionRankOptions(modes=4), "modes is 4: it must be whole numbers"),  # type: ignore[arg-type]
        (lambda: RobotSearch(sections=4), "sections is 4: it must be whole numbers"),  # type: ignore[arg-type]
        (
            lambda: insertion_rank(
                CURVES["s"], options=InsertionRankOptions(modes=(2,), sections=(), stride=100)
            ),
            "modes is 2: it must lie in [1, 1] on this path of 1 poses",
        ),
    ],
)
def test_a_wrong_input_is_one_line(call, words) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError) as caught:
        call()
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_curve_that_turns_back_is_refused() -> None:
    line = np.linspace(0.0, 50.0, 51)[:, None] * [0.0, 0.0, 1.0]
    with pytest.raises(GeometryError, match="turns back"):
        design_routing(np.concatenate([line, line[::-1]]))


def test_a_straight_curve_is_refused() -> None:
    with pytest.raises(GeometryError, match="straight line"):
        insertion_rank([[0, 0, 0], [0, 0, 40]])
    with pytest.raises(GeometryError, match="straight"):
        design_routing(np.linspace(0.0, 50.0, 51)[:, None] * [0.0, 0.6, 0.8])


@pytest.mark.parametrize("tendons", [2, 3, 4])
def test_bundles_of_any_number_give_the_moment_that_bends_the_curve(tendons) -> None:  # type: ignore[no-untyped-def]
    target, limits = fit_bend(bend_s()), RoutingLimits()
    angles, tensions = route_pair(target, STIFFNESS, limits, start=(0.02, 1.0), tendons=tendons)
    places = limits.offset_max * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    moments = np.einsum("k,mka->ma", tensions, places)
    # In a plane there is no twist.
    assert moments == pytest.approx(STIFFNESS[0] * target.curvature, abs=0.05 * tensions.sum())
    apart = [
        np.linalg.norm(places[:, one] - places[:, two], axis=1).min()
        for one, two in combinations(range(tendons), 2)
    ]
    assert min(apart) >= limits.gap_min * (1.0 - 1e-9)


def test_three_tendons_hold_what_two_do(designs) -> None:  # type: ignore[no-untyped-def]
    three = design_routing(CURVES["helix"], tendons=3)
    assert three.converged, three.reason
    assert three.error_rms <= max(designs["helix", 2].error_rms, 0.01)
    assert max(three.tensions) <= 1.1 * max(designs["helix", 2].tensions)


def test_a_design_is_kept_in_a_file(designs, tmp_path) -> None:  # type: ignore[no-untyped-def]
    design = designs["s", 2]
    again = ContinuumRobot.from_yaml(design.to_yaml(tmp_path / "robot.yaml"))
    shape = RodModel(again).shape_under_tensions(design.tensions)
    ours = RodModel(design.robot).shape_under_tensions(design.tensions)
    assert shape.tip == pytest.approx(ours.tip, abs=1e-6)
    values = design.to_dict()
    assert values["tension_sum_N"] == pytest.approx(design.tensions.sum())
    assert set(values["moved_by_1_percent_tension_mm"]) == {"T1", "T2", "all"}
    assert len(design.to_frame()) == len(design.robot.stations(between=3))


# The whole way in.


@pytest.fixture(scope="module")
def rank():  # type: ignore[no-untyped-def]
    curve = wind_helix(radius=30.0, pitch=40.0, length=80.0)
    options = InsertionRankOptions(modes=(2, 4), sections=(2, 4), stride=8, rounds=3)
    return insertion_rank(curve, options=options)


def test_no_routings_pass_the_bound(rank) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(3)
    matrix, rows = rank.matrix, len(rank.matrix)
    for _ in range(1000):
        k = int(rng.integers(1, len(rank.singular_values)))
        routing = rng.normal(size=(rows, k)) if rng.random() < 0.5 else None
        if routing is None:  # near to the best ones
            left = np.linalg.svd(matrix, full_matrices=False)[0][:, :k]
            routing = left + 0.05 * rng.normal(size=left.shape)
        tensions = np.maximum(np.linalg.lstsq(routing, matrix, rcond=None)[0], 0.0)
        left_out = np.linalg.norm(matrix - routing @ tensions)
        assert left_out >= rank.tails[k] - 1e-12


def test_the_bound_falls_to_nothing(rank) -> None:  # type: ignore[no-untyped-def]
    assert rank.bounds[0] == 1.0
    assert np.all(np.diff(rank.tails) <= 1e-15)
    assert rank.tails[-1] == 0.0
    assert rank.tails[0] == pytest.approx(np.linalg.norm(rank.matrix))


def test_routings_fitted_to_places_are_nearer_than_those_of_the_curvature(rank) -> None:  # type: ignore[no-untyped-def]
    found = {(way.source, way.count): way for way in rank.ways}
    for count in (2, 4):
        first, better = found["curvature", count], found["positions", count]
        assert first.rms <= first.projected_rms
        assert better.exact_rms < first.exact_rms
    assert found["sections", 4].rms < found["sections", 2].rms

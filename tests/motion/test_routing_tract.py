"""Robots designed for human tracts: what is claimed of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bozzini.anatomy import read_tract
from bozzini.continuum.routing import RoutingLimits
from bozzini.duct import Centreline, RoundCones
from bozzini.motion import PlannerOptions, Scope, plan_insertion
from bozzini.motion.routing import (
    InsertionRankOptions,
    RobotSearch,
    design_robot,
    design_routing,
    insertion_rank,
)
from bozzini.study import run_insertion

pytestmark = pytest.mark.slow

LIMITS = RoutingLimits(offset_max=2.0, slope_max=0.4, gap_min=1.2)


@pytest.fixture(scope="module")
def upper(upper_gi_dir: Path):  # type: ignore[no-untyped-def]
    tract = read_tract(upper_gi_dir / "upper_gi_labels_1mm.nii.gz", labels=[1, 2, 3])
    return run_insertion(tract, Scope(diameter=5.0, link_length=12.0))


def test_two_tendons_hold_the_upper_tract(upper) -> None:  # type: ignore[no-untyped-def]
    design = design_routing(upper.plan, tendons=2, limits=LIMITS, duct=upper.field)
    assert design.converged, design.reason
    assert design.error_rms <= 0.15
    assert design.error_max <= 0.5
    assert design.energy_error_rms <= 0.2
    assert design.slope <= 0.4 + 1e-3
    assert design.gap >= 1.2 - 1e-3
    assert design.tensions.sum() <= 12.0
    assert design.robot.radius == 2.5
    assert design.clearance is not None and design.clearance >= 0.5
    straight = design_routing(upper.plan, tendons=6, routing="straight")
    assert straight.error_rms >= 5.0 * design.error_rms
    # Open loop it is sensitive, and says so.
    assert 0.5 < design.by_tension[-1] < 10.0


def test_one_tendon_holds_the_colon(colon_dir: Path) -> None:
    tract = read_tract(colon_dir / "large-intestine.vtk")
    study = run_insertion(tract, Scope(diameter=8.0, link_length=12.0))
    design = design_routing(study.plan, tendons=1, duct=study.field)
    assert design.converged, design.reason
    assert design.error_rms <= 0.1


def test_fitted_routings_do_with_half_the_cables(upper) -> None:  # type: ignore[no-untyped-def]
    options = InsertionRankOptions(modes=(8,), sections=(4, 6, 8), stride=6, rounds=6)
    found = insertion_rank(upper.plan, options=options)
    ways = {(way.source, way.count): way for way in found.ways}
    eight = ways["positions", 8]
    assert eight.exact_rms < 0.5 * ways["sections", 8].rms
    assert eight.cables < ways["sections", 8].cables


@pytest.fixture(scope="module")
def rank(upper):  # type: ignore[no-untyped-def]
    """The way of a tube's path for 6 mm, 326 mm long: that of the earlier calculation."""
    plan = plan_insertion(
        upper.field,
        upper.plan.centreline,
        scope=Scope(diameter=6.0, link_length=12.0),
        method="tube",
        options=PlannerOptions(advise=False),
    )
    options = InsertionRankOptions(
        modes=(4, 6, 8, 10, 12, 16, 20),
        sections=(4, 6, 8, 12, 17),
        stride=3,
        rounds=0,
        exact=False,
    )
    return insertion_rank(plan, options=options)


def test_the_table_of_an_earlier_independent_calculation(rank) -> None:  # type: ignore[no-untyped-def]
    assert rank.length == pytest.approx(326.0, abs=1.0)
    ways = {(way.source, way.count): way for way in rank.ways}
    routings = {
        4: (0.48, 6.7),
        6: (0.39, 4.9),
        8: (0.30, 2.8),
        10: (0.23, 2.2),
        12: (0.17, 1.0),
        16: (0.09, 0.45),
        20: (0.04, 0.14),
    }
    for count, (bound, rms) in routings.items():
        assert ways["curvature", count].bound == pytest.approx(bound, abs=0.015)
        assert ways["curvature", count].projected_rms == pytest.approx(rms, rel=0.2)
    for count, rms in ((4, 4.15), (6, 2.03), (8, 1.00), (12, 0.40), (17, 0.15)):
        assert ways["sections", count].rms == pytest.approx(rms, rel=0.2)


def bend_twice() -> tuple[RoundCones, Centreline]:
    """A pipe of 9 mm: 120 mm straight, then two bends of 28 mm against each other."""
    s = np.arange(0.0, 200.1, 2.0)
    curvature = np.where(s < 120.0, 0.0, np.where(s < 155.0, 1.0, -1.0)) / 28.0
    turn = np.concatenate([[0.0], np.cumsum(curvature[1:] + curvature[:-1])])
    ways = np.stack([np.sin(turn), 0.0 * turn, np.cos(turn)], axis=1)
    points = np.concatenate([np.zeros((1, 3)), np.cumsum(ways[1:] + ways[:-1], axis=0)])
    radii = np.full(len(s), 4.5)
    return RoundCones(points, radii), Centreline(points=points, arc_length=s, radius=radii)


def test_sections_are_short_where_the_tract_bends() -> None:
    cones, line = bend_twice()
    search = RobotSearch(diameter_min=6.0, diameter_max=6.0, diameters=1, sections=(5,))
    found = design_robot(cones.sample(1.0), line, options=search)
    assert found.converged, found.reason
    assert found.robot is not None
    # Even lengths do not come through; the base, which stays in the straight part, is long.
    assert [(trial.even, trial.passed) for trial in found.trials] == [(True, False), (False, True)]
    first, *others = [section.length for section in found.robot.sections]
    assert first > 3.0 * max(others)
    bends = [section.max_bend for section in found.robot.sections]
    assert bends[0] < 0.5 * max(bends)


def test_a_robot_of_sections_comes_through_a_pipe() -> None:
    turn = np.linspace(0.0, 1.5, 40)
    points = np.stack([60.0 * (1.0 - np.cos(turn)), 0.0 * turn, 60.0 * np.sin(turn)], axis=1)
    duct = RoundCones(points, np.full(len(points), 8.0)).sample(1.0)
    line = Centreline(points=points, arc_length=60.0 * turn, radius=np.full(len(points), 8.0))
    search = RobotSearch(diameter_min=4.0, diameter_max=6.0, diameters=1, sections=(2, 4))
    found = design_robot(duct, line, options=search)
    assert found.converged, found.reason
    assert found.robot is not None and found.actuation is not None
    assert found.robot.radius == 3.0
    bends = np.linalg.norm(found.actuation.bends, axis=2).max(axis=0)
    assert all(
        section.max_bend >= bend for section, bend in zip(found.robot.sections, bends, strict=True)
    )
    assert found.actuation.certificate.clearance >= 0.0
    none = design_robot(duct, line, options=RobotSearch(diameter_min=17.0, diameter_max=20.0))
    assert not none.converged
    assert "proved" in none.reason

"""The inverse by tensions: round trips, least tensions, limits, and reasons out of reach."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from bozzini.continuum import ContinuumRobot, EnergyModel, Helix, RodModel, Section, Tendon
from bozzini.errors import GeometryError, InputError

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
HELICAL = ContinuumRobot.from_yaml(EXAMPLES / "helical.yaml")


def make(**fields: object) -> ContinuumRobot:
    """Four tendons about one short section, two of them along a helix through another."""
    near = tuple(
        Tendon(name=f"A{k}", offset=4.0, angle=k * math.pi / 2.0, **fields)  # type: ignore[arg-type]
        for k in range(4)
    )
    far = tuple(
        Tendon(name=f"B{k}", offset=3.0, angle=Helix(start=2.0 * k, turns=0.2), **fields)  # type: ignore[arg-type]
        for k in range(3)
    )
    sections = (
        Section(length=40.0, radius=5.0, discs=4, tendons=near, bending_stiffness=400.0),
        Section(length=40.0, radius=5.0, discs=4, tendons=far, bending_stiffness=200.0),
    )
    return ContinuumRobot(sections)


ROBOT = make()
PULLS = np.array([0.4, 0.0, 0.0, 0.3, 0.8, 0.0, 0.3])
LOADED = EnergyModel(ROBOT, tip_force=(0.0, 0.02, -0.01), tendon_stiffness=1e4)


@pytest.fixture(scope="module")
def wanted() -> np.ndarray:
    return np.asarray(LOADED.shape_under_tensions(PULLS).require().tip_frame)


def test_a_place_a_direction_and_a_pose_are_met_under_load(wanted: np.ndarray) -> None:
    place = ROBOT.inverse(wanted[:3, 3], model=LOADED).require()
    looking = ROBOT.inverse(wanted[:3, 3], direction=wanted[:3, 2], model=LOADED).require()
    posed = ROBOT.inverse(wanted, model=LOADED).require()
    for found in (place, looking, posed):
        assert found.tip == pytest.approx(wanted[:3, 3], abs=1e-4)
        assert found.tensions.min() >= 0.0
        again = LOADED.shape_under_tensions(found.tensions)
        assert again.tip == pytest.approx(found.tip, abs=1e-6)
        assert again.displacements == pytest.approx(found.displacements)
    assert looking.tip_frame[:3, 2] == pytest.approx(wanted[:3, 2], abs=2e-5)
    assert posed.tip_frame == pytest.approx(wanted, abs=1e-4)
    # More that is asked for takes more tension.
    sums = [float(found.tensions @ found.tensions) for found in (place, looking, posed)]
    assert sums[0] <= sums[1] * 1.001 <= sums[2] * 1.002 <= float(PULLS @ PULLS) * 1.01


def test_of_all_tensions_the_least_are_taken(wanted: np.ndarray) -> None:
    found = ROBOT.inverse(wanted[:3, 3], model=LOADED).require()
    shape = LOADED.shape_under_tensions(found.tensions)
    slope = LOADED.jacobian(shape, held="tensions").by_tension[-1, 3:]
    # Nearby, none with the same tip has a smaller sum of squares.
    count = len(PULLS)
    rows = np.concatenate([1e4 * slope, np.eye(count)])
    sides = np.concatenate([1e4 * slope @ found.tensions, np.zeros(count)])
    least = lsq_linear(rows, sides, (0.0, np.inf), method="bvls").x
    assert least == pytest.approx(found.tensions, abs=2e-3)


def test_other_tensions_with_the_same_tip_are_larger(wanted: np.ndarray) -> None:
    found = ROBOT.inverse(wanted[:3, 3], model=LOADED).require()
    rng, count, moved = np.random.default_rng(7), len(PULLS), 0.0
    for _ in range(6):
        # Towards drawn tensions, along what leaves the tip where it is, by Newton's method.
        pulls = found.tensions + rng.uniform(0.0, 0.6, count)
        for _ in range(8):
            shape = LOADED.shape_under_tensions(pulls).require()
            slope = LOADED.jacobian(shape, held="tensions").by_tension[-1, 3:]
            miss = wanted[:3, 3] - shape.tip
            rows = np.concatenate([1e4 * slope, np.eye(count)])
            sides = np.concatenate([1e4 * (slope @ pulls + miss), pulls])
            pulls = np.maximum(lsq_linear(rows, sides, (0.0, np.inf), method="bvls").x, 0.0)
        assert LOADED.shape_under_tensions(pulls).tip == pytest.approx(wanted[:3, 3], abs=1e-4)
        assert np.linalg.norm(pulls) > np.linalg.norm(found.tensions)
        moved = max(moved, float(np.abs(pulls - found.tensions).max()))
    assert moved > 0.2


@pytest.mark.parametrize("kind", [EnergyModel, pytest.param(RodModel, marks=pytest.mark.slow)])
def test_displacements_that_were_found_give_the_same_tip(kind: type, wanted: np.ndarray) -> None:
    model = kind(ROBOT, tip_force=LOADED.tip_force, tendon_stiffness=1e4)
    found = ROBOT.inverse(wanted[:3, 3], model=model).require()
    again = model.shape(found.displacements)
    assert again.tip == pytest.approx(wanted[:3, 3], abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [EnergyModel, RodModel])
def test_random_tips_of_helical_robots_are_met(kind: type) -> None:
    rng = np.random.default_rng(4)
    for robot in (HELICAL, ROBOT):
        model = kind(robot)
        for _ in range(5):
            pulls = rng.uniform(0.0, 0.5, len(robot.tendons)) * (
                rng.random(len(robot.tendons)) < 0.6
            )
            tip = model.shape_under_tensions(pulls).require().tip
            found = robot.inverse(tip, model=model).require()
            assert found.tip == pytest.approx(tip, abs=1e-4)
            assert found.tensions @ found.tensions <= 1.02 * pulls @ pulls + 1e-9


def test_out_of_reach_is_explained() -> None:
    far = ROBOT.inverse((200.0, 0.0, 0.0), model="energy", starts=1)
    assert not far.converged and far.residual > 100.0
    assert "the target lies 200 mm from the base, out of reach of a backbone of 80 mm" in far.reason
    weak = make(tension_limit=0.1).inverse((20.0, 5.0, 70.0), model="energy", starts=1)
    assert not weak.converged
    assert "mm from the target; tendon '" in weak.reason and "its limit, 0.1 N" in weak.reason
    assert weak.tensions.max() <= 0.1 * (1.0 + 1e-9)
    short = make(travel=(-0.5, 0.5)).inverse((20.0, 5.0, 70.0), model="energy", starts=1)
    assert not short.converged and "at the end of its travel, 0.5 mm" in short.reason
    alone = ContinuumRobot(
        (Section(length=40.0, radius=5.0, tendons=(Tendon(name="A", offset=4.0),)),)
    ).inverse((10.0, 1.0, 35.0), model="energy", starts=1)
    assert "move the tip in 1 independent ways, the target takes 3" in alone.reason
    with pytest.raises(GeometryError, match="independent ways"):
        alone.require()


def test_results_have_tensions_and_a_picture(wanted: np.ndarray) -> None:
    found = ROBOT.inverse(wanted[:3, 3], model=LOADED)
    plain = found.to_dict()
    assert plain["model"] == "energy" and plain["sections"] == []
    assert list(plain["tensions_N"]) == list(ROBOT.tendon_names)
    assert list(found.to_frame().columns)[:3] == ["tendon", "displacement_mm", "tension_N"]
    assert found.plot().lines


def test_what_is_not_for_it_is_refused() -> None:
    with pytest.raises(InputError, match="the linkage model has no inverse"):
        ROBOT.inverse((1.0, 0.0, 79.0), model=_parallel().model("linkage"))
    with pytest.raises(InputError, match="has no option 'smallest_bends'"):
        ROBOT.inverse((1.0, 0.0, 79.0), model="energy", smallest_bends=True)
    with pytest.raises(InputError, match=r"target has shape \(2,\): it must be \(3,\)"):
        ROBOT.inverse((1.0, 0.0), model="energy")
    with pytest.raises(InputError, match="starts is 0"):
        ROBOT.inverse((1.0, 0.0, 79.0), model="energy", starts=0)


def _parallel() -> ContinuumRobot:
    return ContinuumRobot((dataclasses.replace(ROBOT.sections[0]),))

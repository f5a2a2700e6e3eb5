"""A robot in a known lumen: its estimate lies inside, and tells what the wall does."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bozzini.continuum import (
    ContactModel,
    ContactOptions,
    ContinuumRobot,
    EnergyModel,
    ModelError,
    PlaceSensor,
    Section,
    ShapeEstimator,
    Tendon,
)
from bozzini.duct import RoundCones
from bozzini.errors import InputError

PULLED = np.array([2.5, -1.0, -1.5, 0.8, -0.5, -0.3])
TIP = PlaceSensor(name="tip", deviation=0.2)


def make_robot(stiffer: float = 1.0) -> ContinuumRobot:
    sections = tuple(
        Section(
            length=80.0, radius=5.0, discs=4,
            bending_stiffness=3000.0 * stiffer, torsional_stiffness=2500.0 * stiffer,
            tendons=tuple(
                Tendon(name=f"{part}{k}", offset=4.0, angle=2.1 * k + part, stiffness=3000.0)
                for k in range(3)
            ),
        )
        for part in range(2)
    )  # fmt: skip
    return ContinuumRobot(sections, base_position=(5.0, 0.0, 20.0), base_rotation=(0.3, 0.1, 0.0))


ROBOT = make_robot()
MODEL = EnergyModel(ROBOT, segment="channel", between=1)
TUBE = RoundCones(
    ROBOT.base_frame[:3, 3] + np.outer([-60.0, 260.0], ROBOT.base_frame[:3, 2]), [12.0, 12.0]
)


def measure_depth(found) -> float:
    """Return how deep the body is in the wall at the worst station [mm]."""
    return float((TUBE.signed_distance(found.points) + ROBOT.radius).max())


def test_a_body_in_a_lumen_lies_inside_and_the_wall_presses_as_the_static_solver_says():
    softer = ContactModel(make_robot(0.95), TUBE, options=ContactOptions(segment_length=10.0))
    truth = softer.shape(PULLED)
    assert truth.converged
    read = {"tip": truth.tip + np.array([0.1, -0.1, 0.1])}
    free = ShapeEstimator(model=MODEL, sensors=(TIP,))
    walled = dataclasses.replace(free, duct=TUBE)
    assert measure_depth(free.estimate(PULLED)) > 30.0
    assert measure_depth(free.estimate(PULLED, read)) > 0.3
    known, found = walled.estimate(PULLED), walled.estimate(PULLED, read)
    for one in (known, found):
        assert one.converged, one.reason
        assert measure_depth(one) < 0.03
        contact = one.contact
        off = contact.resultant - truth.resultant
        spread = np.sqrt(np.diag(contact.resultant_covariance))
        assert np.all(np.abs(off) < 1.96 * spread + 0.01)
        assert np.all(spread < 0.3 * np.linalg.norm(truth.resultant))
    assert np.abs(found.points - truth.points).max() < 0.5
    # What presses along the wall is known across it, and nowhere else as well.
    assert np.all(known.deviations[-1] < 0.5 * free.estimate(PULLED).deviations[-1].max())
    assert len(found.list_columns()["wall_force_N"]) == len(MODEL.arc_length)
    assert "wall_resultant_N" in found.to_dict()
    firm = dataclasses.replace(walled, wall_stiffness=1e4).estimate(PULLED)
    np.testing.assert_allclose(firm.points, known.points, atol=0.01)
    soft = dataclasses.replace(walled, wall_stiffness=0.01).estimate(PULLED)
    assert measure_depth(soft) > 1.0


def test_slopes_among_walls_are_those_of_differences():
    error = ModelError(coupling=0.02, position=1.0, rotation=0.02)
    estimator = ShapeEstimator(model=MODEL, sensors=(TIP,), duct=TUBE, error=error)
    state = estimator.begin()
    spread = np.sqrt(np.diag(state.covariance))
    mean = 0.3 * spread * np.random.default_rng(1).standard_normal(len(spread))
    there = dataclasses.replace(state, mean=mean)
    start = estimator.estimate(PULLED, state=there).state
    read = {0: np.zeros(3)}
    known = {
        "start": (start.rotation_vectors, start.lengths),
        "short": 0.02 * PULLED,
    }
    fit = estimator._evaluate(PULLED, read, mean, **known)
    moved = estimator._place(mean, fit.body, estimator._ends)[2][:, 3:]
    exact = np.concatenate([fit.slopes, -(fit.body.push.blocks @ moved).sum(axis=0)]) * spread
    chosen = [k for k, name in enumerate(estimator.names) if not name.startswith("coupling")]
    for index in chosen[::3] + chosen[-6:]:
        step = 1e-4 * spread[index] * np.eye(len(mean))[index]
        less, more = (
            estimator._evaluate(PULLED, read, mean + sign * step, **known) for sign in (-1.0, 1.0)
        )
        forces = [one.body.push.forces.sum(axis=0) for one in (less, more)]
        both = np.concatenate([less.missed - more.missed, forces[1] - forces[0]]) / 2e-4
        np.testing.assert_allclose(
            both, exact[:, index], atol=1e-5 * np.abs(exact).max(), rtol=1e-5
        )


def test_intervals_among_walls_hold_the_truth():
    estimator, taut = ShapeEstimator(model=MODEL, sensors=(TIP,), duct=TUBE), PULLED + 2.0
    random, inside, forces = np.random.default_rng(2), [], []
    state = estimator.begin()
    spread = np.sqrt(np.diag(state.covariance))
    for _ in range(12):
        drawn = dataclasses.replace(state, mean=spread * random.standard_normal(len(spread)))
        truth = estimator.estimate(taut, state=drawn)
        read = {"tip": truth.tip + TIP.deviation * random.standard_normal(3)}
        found = estimator.estimate(taut, read)
        assert found.converged
        inside.append(np.abs(found.points - truth.points)[2:] < 1.96 * found.deviations[2:])
        off = found.contact.resultant - truth.contact.resultant
        half = 1.96 * np.sqrt(np.diag(found.contact.resultant_covariance))
        forces.append(np.abs(off) < half)
    assert 0.88 < np.mean(inside) < 0.99
    assert np.mean(forces) > 0.8


def test_what_is_no_wall_is_refused():
    with pytest.raises(InputError, match="duct is 3: it must be a duct"):
        ShapeEstimator(model=MODEL, duct=3)
    with pytest.raises(InputError, match="wall_stiffness is -1"):
        ShapeEstimator(model=MODEL, duct=TUBE, wall_stiffness=-1.0)

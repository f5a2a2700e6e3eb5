"""Traces and the cubic in place of the exact inverse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bozzini.effector.design import effector_preset
from bozzini.effector.effector import Effector
from bozzini.effector.equilibrium import balance
from bozzini.effector.steering import (
    CubicFit,
    fit_cubic,
    look_up_pressures,
    trace_circle,
    trace_line,
    trace_path,
)
from bozzini.effector.workspace import workspace
from bozzini.errors import InputError

DESIGN = effector_preset("prototype")
EFFECTOR = Effector(DESIGN)


def test_a_circle_inside_is_followed() -> None:
    radius = 0.99 * workspace(EFFECTOR).inner_radius
    trace = trace_circle(EFFECTOR, radius, steps=90)
    assert trace.kind == "circle" and trace.complete
    assert trace.targets.shape == (91, 2) and trace.pressures.shape == (91, 3)
    assert trace.largest_error < 1e-9
    assert np.hypot(*trace.achieved.T) == pytest.approx(radius)
    assert np.array_equal(trace.pressures[0], trace.pressures[-1])
    # All three muscles have their turn, and never more than two at a time.
    assert np.all(trace.pressures.max(axis=0) > 0.2)
    assert np.count_nonzero(trace.pressures, axis=1).max() == 2


def test_a_line_of_one_muscle_needs_only_that() -> None:
    unit = np.array([math.cos(DESIGN.angles[2]), math.sin(DESIGN.angles[2])])
    trace = trace_line(EFFECTOR, [0.0, 0.0], end=10.0 * unit, steps=20)
    assert trace.complete and trace.largest_error < 1e-9
    assert trace.displacements[:, :2].max() < 1e-10
    assert np.all(np.diff(trace.pressures[:, 2]) > 0.0)
    assert trace.targets[0] == pytest.approx([0.0, 0.0])
    assert trace.targets[-1] == pytest.approx(10.0 * unit)


def test_a_line_that_leaves_the_workspace_says_where() -> None:
    trace = trace_line(EFFECTOR, [0.0, 0.0], end=[30.0, 0.0], steps=40)
    assert not trace.complete
    inside = trace.reachable
    assert inside[0] and not inside[-1]
    assert np.array_equal(inside, np.sort(inside)[::-1])  # once out, it stays out
    assert trace.error[inside].max() < 1e-9 < trace.error[~inside].min()
    assert trace.reachable_error == trace.error[inside].max()
    assert trace.converged.tolist() == inside.tolist() and trace.settled.all()
    lost = f"{int((~inside).sum())} target(s) out of reach, by up to {trace.largest_error:.3g} mm"
    assert trace.reason == lost
    # Outside, the tip stays at the edge in the direction of the target.
    assert trace.achieved[~inside] == pytest.approx(
        np.broadcast_to(trace.achieved[-1], trace.achieved[~inside].shape)
    )


def test_one_path_is_the_tips() -> None:
    trace = trace_path(EFFECTOR, [[1.0, 2.0], [-3.0, 4.0]])
    assert trace.tip[:, :2] == pytest.approx(trace.achieved)
    assert np.all(trace.holder_tip[:, 2] > trace.tip[:, 2])


@pytest.mark.parametrize("start", [0.0, 0.15])
def test_the_cubic_is_the_best_one(start: float) -> None:
    cubic = fit_cubic(EFFECTOR, "G", start=start)
    points = balance(EFFECTOR, "G", pressure=cubic.pressure).lateral
    assert cubic.lateral == pytest.approx(points)
    error = cubic.find_lateral(cubic.pressure) - points
    assert cubic.rms_error == pytest.approx(float(np.sqrt(np.mean(error**2))))
    assert cubic.largest_error == pytest.approx(float(np.abs(error).max()))
    # The normal equations: the error is orthogonal to every power.
    for power in range(4):
        assert abs(error @ cubic.pressure**power) < 1e-8 * len(error)
    own = np.polynomial.Polynomial.fit(cubic.pressure, points, 3).convert()
    assert cubic.coefficients == pytest.approx(own.coef)


def test_the_cubic_is_inverted_where_it_rises() -> None:
    cubic = fit_cubic(EFFECTOR, "R")
    low, high = cubic.lateral_range
    lateral = np.linspace(max(low, 0.0) + 1e-6, high, 50)
    pressure = cubic.find_pressure(lateral)
    assert np.all(np.diff(pressure) > 0.0)
    assert cubic.find_lateral(pressure) == pytest.approx(lateral, abs=1e-9)
    assert cubic.find_pressure(0.0) == 0.0


def test_a_cubic_that_turns_is_only_inverted_past_its_turn() -> None:
    # (p - 0.2)^2 (p + 0.1) falls from 0 to 0.2.
    root = np.polynomial.Polynomial.fromroots([0.2, 0.2, -0.1])
    from bozzini.effector.steering import find_rise

    assert find_rise(root.coef, 0.0, 0.8, "R") == pytest.approx(0.2)
    assert find_rise(root.coef, 0.3, 0.8, "R") == 0.3
    with pytest.raises(InputError, match="cannot be inverted"):
        find_rise(-root.coef, 0.0, 0.8, "R")


def test_a_true_cubic_is_found() -> None:
    cubic = fit_cubic(EFFECTOR, "B", start=0.3)
    assert cubic.monotone and cubic.largest_error < 0.05


def test_steering_by_cubics_is_off_by_about_their_error() -> None:
    cubics = {name: fit_cubic(EFFECTOR, name, start=0.2) for name in DESIGN.names}
    exact = trace_circle(EFFECTOR, 8.0)
    trace = trace_circle(EFFECTOR, 8.0, cubics=cubics)
    assert trace.pressure_map == "cubic" and exact.pressure_map == "exact"
    assert trace.displacements == pytest.approx(exact.displacements)
    used = trace.displacements
    inside = np.all((used == 0.0) | (used > cubics["R"].lateral_range[0]), axis=1)
    assert inside.any()
    assert exact.largest_error < 1e-9 < trace.error[inside].max()
    assert exact.converged.all() and exact.reason == ""
    assert trace.settled.all() and not trace.converged.all()
    assert "missed by the cubics" in trace.reason
    assert trace.error[inside].max() <= 2.0 * max(c.largest_error for c in cubics.values())


def test_looking_up_caps_at_the_limit() -> None:
    cubics: dict[str, CubicFit] = {name: fit_cubic(EFFECTOR, name) for name in DESIGN.names}
    pressures = look_up_pressures(cubics, DESIGN.names, displacements=[100.0, 0.0, 5.0])
    assert pressures[0] == pytest.approx(DESIGN.pressure_limit)
    assert pressures[1] == 0.0

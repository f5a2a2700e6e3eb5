"""The stick: centre, dead zone, scale, saturation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.effector import (
    Effector,
    balance,
    find_peak,
    fit_cubic,
    look_up_pressures,
    pose,
)
from bozzini.effector.design import effector_preset
from bozzini.effector.inverse import solve_inverse
from bozzini.effector.steering import Stick, find_stick_scale, steer
from bozzini.effector.workspace import workspace
from bozzini.muscle import preset as muscle_preset

EFFECTOR = Effector(effector_preset("prototype"))

readings = st.floats(0.0, 1023.0)


def test_corners_of_the_converter() -> None:
    travel = Stick().find_travel([[512, 512], [0, 512], [1023, 512], [512, 0], [512, 1023]])
    assert travel * 512.0 == pytest.approx(
        np.array([[0, 0], [-512, 0], [511, 0], [0, 512], [0, -511]])
    )
    assert not np.signbit(travel[0]).any()
    assert Stick().find_travel([1024, 1024]) == pytest.approx([1.0, -1.0])  # the thesis's corner
    assert 512.0 * np.hypot(*Stick().find_travel([0, 0])) == pytest.approx(724.0, abs=0.1)


@given(readings, readings, st.floats(1.0, 400.0))
def test_dead_zone_keeps_directions_and_does_not_jump(x: float, y: float, zone: float) -> None:
    plain = Stick().find_travel([x, y])
    travel = Stick(dead_zone=zone).find_travel([x, y])
    size, before = math.hypot(*travel), math.hypot(*plain)
    if before * 512.0 <= zone:
        assert not travel.any()
    # Linear from the edge of the zone to the full span.
    assert size == pytest.approx(
        max(0.0, (before - zone / 512.0) / (1.0 - zone / 512.0)), abs=1e-12
    )
    assert abs(travel[0] * plain[1] - travel[1] * plain[0]) < 1e-12
    assert travel @ plain >= 0.0


def test_dead_zone_is_continuous_and_full_at_the_span() -> None:
    stick = Stick(dead_zone=30.0)
    assert np.hypot(*stick.find_travel([512.0 + 30.0 + 1e-9, 512.0])) < 1e-10
    assert stick.find_travel([0.0, 512.0])[0] == pytest.approx(-1.0)


def test_scale_is_the_furthest_corner() -> None:
    scale = find_stick_scale(EFFECTOR)
    assert scale == pytest.approx(workspace(EFFECTOR).outer_radius)
    assert find_stick_scale(EFFECTOR, amplitudes=22.4) == pytest.approx(
        min(32.09, 27.70), abs=0.01
    )  # the corner of G and R is beyond the backbone's largest deflection
    assert find_stick_scale(EFFECTOR, amplitudes=[5.0, 5.0, 18.0]) == pytest.approx(18.0)


def test_steering_is_the_inverse_of_the_scaled_travel() -> None:
    raw = np.array([[512, 512], [600, 400], [0, 0], [1023, 700]])
    found = steer(EFFECTOR, raw)
    scale = find_stick_scale(EFFECTOR)
    target = scale / 512.0 * np.stack([raw[:, 0] - 512, 512 - raw[:, 1]], axis=1)
    assert found.target == pytest.approx(target)
    assert found.pressures == pytest.approx(solve_inverse(EFFECTOR, target).pressures)
    assert not found.pressures[0].any() and found.reachable[0]
    assert not found.reachable[2]  # the corner of the stick
    half = steer(EFFECTOR, raw[1], scale=0.5 * scale)
    assert half.target == pytest.approx(0.5 * target[1])


def test_every_point_of_the_workspace_is_on_the_stick() -> None:
    boundary = workspace(EFFECTOR, directions=36).boundary
    scale = find_stick_scale(EFFECTOR)
    assert np.abs(boundary).max() <= scale * (1.0 + 1e-12)


def test_steering_by_a_cubic_says_what_its_pressures_do():
    effector = Effector(effector_preset("prototype"))
    cubics = {name: fit_cubic(effector, name, start=0.1) for name in "RGB"}
    raw = [[700, 400], [600, 700], [512, 512], [1023, 512]]
    exact, cubic = steer(effector, raw), steer(effector, raw, cubics=cubics)
    assert (exact.pressure_map, cubic.pressure_map) == ("exact", "cubic")
    assert np.array_equal(cubic.displacements, exact.displacements)
    found = look_up_pressures(cubics, effector.design.names, displacements=exact.displacements)
    assert np.array_equal(cubic.pressures, found)
    posed = pose(effector, cubic.pressures)
    assert cubic.delivered == pytest.approx(posed.lateral_vector)
    away = np.linalg.norm(posed.lateral_vector - exact.delivered, axis=-1)
    assert cubic.displacement_error == pytest.approx(away)
    assert 0.0 < away.max() < 1.0 and away[2] == 0.0
    missed = np.linalg.norm(cubic.target - cubic.delivered, axis=-1)
    assert cubic.residual == pytest.approx(missed)
    # A cubic that misses has not converged, and gives by how much.
    assert exact.converged.tolist() == [True, True, True, False]
    assert cubic.settled.all() and cubic.converged.tolist() == [False, False, True, False]
    assert str(cubic.reason[0]) == f"the cubics miss the target by {away[0]:.3g} mm"
    assert cubic.reason[3] == exact.reason[3]


def test_a_cubic_ends_where_the_backbone_does():
    """Beyond, the curve is flat, and no pressure of it says anything of the muscle."""
    muscle = muscle_preset("effector-45")
    design = effector_preset("prototype", beam_factor=2.0, pressure_limit=3.0)
    placed = tuple(
        type(one)(name=one.name, muscle=muscle, angle=one.angle) for one in design.muscles
    )
    effector = Effector(design.replace(muscles=placed))
    cubic = fit_cubic(effector, "R", start=0.1)
    peak = find_peak(design).lateral
    assert cubic.saturated and 0.1 < cubic.limit < 3.0
    assert cubic.lateral[-1] == pytest.approx(peak, rel=1e-9)
    below, above = balance(
        effector, "R", pressure=[cubic.limit - 1e-6, cubic.limit + 1e-6]
    ).saturated
    assert above and not below
    short = Effector(effector.design.replace(pressure_limit=0.827))
    assert not fit_cubic(short, "R", start=0.1).saturated

"""The stick: centre, dead zone, scale, saturation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.effector.effector import Effector
from bozzini.effector.inverse import solve_inverse
from bozzini.effector.presets import preset
from bozzini.effector.stick import Stick, find_stick_scale, steer
from bozzini.effector.workspace import workspace
from bozzini.errors import InputError

EFFECTOR = Effector(preset("prototype"))

readings = st.floats(0.0, 1023.0)


def test_corners_of_the_converter() -> None:
    travel = Stick().find_travel([[512, 512], [0, 512], [1023, 512], [512, 0], [512, 1023]])
    assert travel * 512.0 == pytest.approx(
        np.array([[0, 0], [-512, 0], [511, 0], [0, 512], [0, -511]])
    )
    assert not np.signbit(travel[0]).any()
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


@pytest.mark.parametrize(
    ("raw", "word"),
    [
        ([1024, 500], "x is 1024: it must lie in \\[0, 1023\\]"),
        ([500, -1], "y is -1"),
        ([500, math.nan], "not finite"),
        ([500], "shape"),
    ],
)
def test_readings_out_of_range(raw: list[float], word: str) -> None:
    with pytest.raises(InputError, match=word):
        steer(EFFECTOR, raw)


@pytest.mark.parametrize(
    "changes",
    [{"centre": 2000.0}, {"span": 0.0}, {"dead_zone": 500.0}, {"highest": -1.0}],
)
def test_wrong_sticks(changes: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(changes)).replace("_", " ")):
        Stick(**changes)


def test_wrong_scale() -> None:
    with pytest.raises(InputError, match="stick scale is 0 mm"):
        steer(EFFECTOR, [500, 500], scale=0.0)

"""A wall moved outwards joins limbs that lie close: no motion may pass between them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from bozzini.duct import Centreline, SampledField
from bozzini.motion import FreeSpace, Introducer, Scope
from bozzini.motion.measures import find_crossing
from tests.motion.plans import insert
from tests.shapes import curve_distance, sample_field

RADIUS, DEPTH = 5.0, 45.0


@cache
def make_hairpin(gap: float, inflation: float) -> tuple[SampledField, Centreline]:
    """Return two straight limbs of a tube side by side, `gap` of wall between, joined by a bend."""
    bend = RADIUS + 0.5 * gap
    turn = np.linspace(0.0, np.pi, 40)
    down = np.arange(0.0, DEPTH, 1.0)
    zero = np.zeros_like
    curve = np.concatenate(
        [
            np.stack([zero(down), zero(down), down], axis=1),
            np.stack([bend - bend * np.cos(turn), zero(turn), DEPTH + bend * np.sin(turn)], axis=1),
            np.stack([zero(down) + 2.0 * bend, zero(down), down[::-1]], axis=1),
        ]
    )
    low, high = curve.min(axis=0) - 13.0, curve.max(axis=0) + 13.0
    axes = [np.arange(a, b, 0.5) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    field = SampledField(
        values=curve_distance(curve, RADIUS)(points).astype(np.float32),
        spacing=np.full(3, 0.5),
        origin=low,
        rotation=np.eye(3),
        inflation=inflation,
    )
    inner = curve[6:-6]
    return field, Centreline.from_points(inner, field)


def count_in_septum(joints: np.ndarray, gap: float) -> int:
    """Count samples of the body on the middle plane between the limbs, below the bend."""
    parts = np.linspace(0.0, 1.0, 41)[:, None, None, None]
    body = joints[None, :, 1:] + parts * (joints[None, :, :-1] - joints[None, :, 1:])
    middle = RADIUS + 0.5 * gap
    near = np.abs(body[..., 0] - middle) < 0.5 * gap
    return int(np.count_nonzero(near & (body[..., 2] < DEPTH - 15.0) & (body[..., 2] > 0.0)))


@pytest.mark.slow
@pytest.mark.parametrize(("gap", "inflation", "link"), [(2.0, 4.0, 20.0), (1.0, 3.0, 12.0)])
@pytest.mark.parametrize("method", ["best", "follow"])
def test_no_motion_passes_through_the_wall_between_two_limbs(gap, inflation, link, method):
    field, line = make_hairpin(gap, inflation)
    plan = insert(
        field, line, scope=Scope(diameter=2.0, link_length=link), method=method, head_step=1.0
    )
    assert count_in_septum(plan.joints, gap) == 0
    if plan.status == "stopped":
        assert plan.reason


@pytest.mark.slow
def test_the_bend_itself_is_passed():
    field, line = make_hairpin(8.0, 2.0)
    plan = insert(field, line, scope=Scope(diameter=4.0, link_length=6.0), head_step=1.0)
    assert plan.status == "complete" and plan.certified
    assert count_in_septum(plan.joints, 8.0) == 0


def test_limbs_past_the_entry_plane_are_told_apart_too():
    # Beside the entry a tract passes its plane twice, with a thin wall between these two limbs.
    corners = [[0, 0, 0], [0, 0, -30], [30, 0, -30], [30, 0, 40], [42, 0, 40], [42, 0, -30]]
    corners = np.array(corners, dtype=float)
    low, high = corners.min(axis=0) - 13.0, corners.max(axis=0) + 13.0
    field = sample_field(curve_distance(corners, RADIUS), low, high, 0.5, inflation=3.0)
    line = Centreline.from_points(corners, field)
    introducer = Introducer(entry=corners[0], outward=np.array([0.0, 0.0, 1.0]), bore=RADIUS)
    space = FreeSpace(field, line, introducer)
    behind = np.array([[0.0, 0.0, 20.0 + 10.0 * k] for k in range(2)])
    way = np.array([[30.0, 0.0, -10.0], [30.0, 0.0, -30.0], [0.0, 0.0, -30.0], [0.0, 0.0, 0.0]])
    for height in (-15.0, 25.0):
        head = np.array([[42.0, 0.0, height], [30.0, 0.0, height]])
        found = find_crossing(np.concatenate([head, way, behind])[None], space, radius=2.0)
        assert found is not None
        assert found.point[2] == pytest.approx(height, abs=1e-6)
        # The same link is no crossing where it stays in its limb.
        head[0] = [30.0, 0.0, height + 12.0]
        assert find_crossing(np.concatenate([head, way, behind])[None], space, radius=2.0) is None

"""The loop in tracts that turn back past their entry: what is certified between frames holds there.

Body samples stand at times between the frames, beside the moved triangles. Left out is what stands
in the introducer, counted from the tail: the head of such a scope lies past the entry plane too.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from bozzini.anatomy import Breathing, Peristalsis
from bozzini.duct import Centreline, build_field
from bozzini.motion import LiveOptions, Scope, follow_tissue
from bozzini.numeric.polylines import carry_frames
from tests.duct.test_moving import sweep_tube
from tests.exact import MeshWall
from tests.motion.plans import insert
from tests.motion.test_live import Later, find_joints

SCOPE = Scope(diameter=6.0, link_length=10.0)
SLACK_MM = 1.0


def join(*pieces):
    """A line through the points of all pieces (n, 3), a point each mm."""
    points = np.concatenate(pieces)
    arc = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    even = np.linspace(0.0, arc[-1], round(arc[-1]) + 1)
    return np.stack([np.interp(even, arc, column) for column in points.T], axis=1)


def turn_about(centre, radius, angles, rise=0.0):
    """An arc in the plane of x and z, which moves along y by `rise` over its length."""
    share = np.linspace(0.0, 1.0, 200)
    angle = angles[0] + share * (angles[1] - angles[0])
    x, z = -radius * np.cos(angle), radius * np.sin(angle)
    return np.array(centre) + np.stack([x, rise * share, z], axis=1)


def make_line(name):
    """The middle of a tube that begins upwards and comes back past where it began."""
    up = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 39.0]])
    over = turn_about((18.0, 0.0, 40.0), 18.0, (0.0, np.pi))
    if name == "hook":
        return join(up, over, np.array([[36.0, 0.0, 39.0], [36.0, 0.0, -40.0]]))
    if name == "u":
        return join(up, over, np.array([[36.0, 0.0, 39.0], [36.0, 0.0, -14.0]]))
    loop = turn_about((20.0, 0.0, 12.0), 20.0, (0.0, 1.9 * np.pi), rise=30.0)
    return join(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 11.0]]), loop)


@pytest.fixture(scope="module", params=["hook", pytest.param("u", marks=pytest.mark.slow), "loop"])
def rest(request):
    line = make_line(request.param)
    tangents = np.gradient(line, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    surface = sweep_tube(line, carry_frames(tangents)[:, :, 0], radius=7.0, spacing=1.5)
    field = build_field(surface, voxel=1.0)
    plan = insert(field, Centreline.from_points(line[8:-8], field), scope=SCOPE, method="tube")
    assert plan.status == "complete", plan.reason
    # The head comes back past the entry plane: that alone is no introducer.
    tube = plan.introducer
    assert ((plan.path - tube.entry) @ tube.outward).max() > 5.0
    return surface, field, plan


def make_motion(name, plan):
    if name == "peristalsis":
        return Peristalsis(line=plan.path, depth=0.15, width=15.0, wave_speed=20.0)
    amplitude = 30.0 if name == "deep breathing" else 6.0
    return Breathing(amplitude=amplitude, wavelength=800.0, period=4.0, direction=(1.0, 0.0, 0.0))


def leave_introducer(points, joints, tubes):
    """The points (links, k, 3) of a chain that are not in an introducer, from the tail on."""
    last = len(joints)
    for tube in tubes:
        away = joints - tube.entry
        along = away @ tube.outward
        off = np.linalg.norm(away - along[:, None] * tube.outward, axis=1)
        stands = (along >= 0.0) & (off <= tube.bore - SCOPE.radius + SLACK_MM)
        last = min(last, len(joints) - int(np.logical_and.accumulate(stands[::-1]).sum()))
    free = points[: max(last - 1, 0)].reshape(-1, 3)
    edge = points[last - 1 : last].reshape(-1, 3)
    for tube in tubes:
        edge = edge[(edge - tube.entry) @ tube.outward < 0.0]
    return np.concatenate([free, edge])


def measure_between(before, frame, surface, motion):
    """The smallest clearance of the body to the triangles at times between two frames [mm]."""
    least = np.inf
    for share in (0.0, 0.3, 0.6, 0.9, 1.0):
        time = before.time + share * (frame.time - before.time)
        wall = MeshWall(surface.vertices + motion.at(time)(surface.vertices), surface.faces)
        joints = find_joints(before, frame, share)
        along = np.linspace(0.0, 1.0, 11)[None, :, None]
        points = joints[:-1, None] + along * np.diff(joints, axis=0)[:, None]
        points = leave_introducer(points, joints, (before.plan.introducer, frame.plan.introducer))
        assert len(points) > 50
        least = min(least, wall.clearance(points).min() - SCOPE.radius)
    return least


@pytest.mark.parametrize(
    ("name", "advance", "inserted"),
    [
        ("breathing", 0.0, 0.85),
        ("peristalsis", 0.0, 0.85),
        pytest.param("deep breathing", 0.0, 0.85, marks=pytest.mark.slow),
        pytest.param("breathing", 20.0, 0.6, marks=pytest.mark.slow),
        pytest.param("deep breathing", 20.0, 0.7, marks=pytest.mark.slow),
        pytest.param("peristalsis", 20.0, 0.6, marks=pytest.mark.slow),
    ],
)
def test_nothing_comes_nearer_than_certified_where_the_head_is_past_the_entry(
    rest, name, advance, inserted
):
    surface, field, plan = rest
    motion = Later(make_motion(name, plan), 0.4)
    options = LiveOptions(rate=12.0, duration=0.5, horizon=5.0, advance=advance, inserted=inserted)
    frames = list(follow_tissue(plan, field, motion=motion, surface=surface, options=options))
    known = [frame for frame in frames if frame.status != "refused"]
    assert len(known) >= 3, frames[-1].reason
    for before, frame in itertools.pairwise(known):
        least = measure_between(before, frame, surface, motion)
        assert least >= frame.carried
        # Nor is it far below, but where the body did not keep off the wall.
        assert frame.carried >= least - 1.5 or frame.status != "held"

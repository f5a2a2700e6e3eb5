"""A human oesophagus, stomach and duodenum: what fits, what does not, and the proof of it."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.motion import Scope, find_passage
from tests.exact import MeshWall, VoxelWall, outside_introducer, sample_body
from tests.human import FILES, load_human
from tests.motion.plans import insert


class Human:
    def __init__(self, folder, kind):
        self.tract, self.field, self.line = load_human(folder, kind)
        if self.tract.kind == "labels":
            self.wall = VoxelWall(self.tract.mask, self.tract.affine)
        else:
            self.wall = MeshWall(self.tract.vertices, self.tract.faces)

    def plan(self, diameter, link, *, inflate=0.0, **options):
        field = self.field.inflate(inflate)
        scope = Scope(diameter=diameter, link_length=link)
        return insert(field, self.line, scope=scope, **options)


@pytest.fixture(scope="module")
def labels(upper_gi_dir):
    return Human(upper_gi_dir, "labels")


@pytest.fixture(scope="module")
def surface(upper_gi_dir):
    return Human(upper_gi_dir, "surface")


@pytest.fixture(params=list(FILES))
def human(request):
    return request.getfixturevalue(request.param)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("diameter", "link"), [(5.5, 8.0), (5.5, 12.0), (5.5, 20.0), (6.0, 8.0), (6.0, 12.0)]
)
def test_the_scope_passes_certified(human, diameter, link):
    plan = human.plan(diameter, link)
    assert plan.status == "complete", plan.reason
    assert plan.certified
    proved = plan.certificate.clearance
    points, *_ = sample_body(plan.joints, 12_000, np.random.default_rng(0))
    introducer = plan.introducer
    points = points[outside_introducer(points, introducer, 0.5 * diameter)]
    assert human.wall.clearance(points).min() - 0.5 * diameter >= proved - 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("link", [8.0, 20.0])
def test_nine_millimetres_are_refused_and_pass_when_inflated(human, link):
    plan = human.plan(9.0, link)
    assert plan.status == "stopped"
    refusal = plan.refusal
    assert plan.reason_code in (
        *("NO_PASSAGE", "GOAL_CLEARANCE", "HEAD_CLEARANCE", "LINK_TOO_LONG"),
    )
    assert refusal.offers < refusal.needs
    # Whatever the links: the widest way on the grid is narrower than the scope.
    assert find_passage(human.field, human.line.points[0], goal=human.line.points[-1]).level < 4.55
    assert plan.inserted == 0.0 or plan.certified
    inflated = human.plan(9.0, link, inflate=4.0)
    assert inflated.status == "complete", inflated.reason
    assert inflated.certified


@pytest.mark.slow
def test_joint_moves_stay_near_the_head_step(labels):
    ratios = []
    for step in (0.4, 0.025):
        plan = labels.plan(5.5, 12.0, head_step=step)
        moves = np.linalg.norm(np.diff(plan.joints, axis=0), axis=2).max()
        ratios.append(moves / np.diff(plan.head_arc_length).max())
    assert ratios[0] <= 2.0
    assert ratios[1] == pytest.approx(ratios[0], rel=0.1)


@pytest.mark.slow
def test_in_out_in_is_certified_and_spares_motion(surface):
    there_and_back = surface.plan(6.0, 12.0, route=(1.0, 0.0, 1.0))
    assert there_and_back.status == "complete" and there_and_back.certified
    travel = [
        np.linalg.norm(np.diff(surface.plan(6.0, 12.0, method=name).joints, axis=0), axis=2).sum()
        for name in ("tube", "follow")
    ]
    assert travel[0] <= travel[1]

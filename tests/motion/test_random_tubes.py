"""Random tubes: a planted passage is found and proved, a pinched tube refused at the pinch."""

from __future__ import annotations

import numpy as np
import pytest

from tests.exact import sample_body
from tests.motion.plans import insert
from tests.motion.planted import plant


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(7))
def test_a_planted_passage_is_found_and_certified(seed):
    tube = plant(seed)
    plan = insert(tube.field, tube.line, scope=tube.scope, head_step=0.5)
    assert plan.status == "complete", plan.reason
    assert plan.certified
    proved = plan.certificate.clearance
    points, *_ = sample_body(plan.joints, 4000, np.random.default_rng(seed))
    entry = plan.introducer.entry
    outward = np.array(plan.introducer.outward)
    points = points[(points - entry) @ outward < 0.0]
    assert tube.wall.clearance(points).min() - tube.scope.radius >= proved - 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 106))
def test_a_pinched_tube_is_refused_at_the_pinch(seed):
    tube = plant(seed, pinched=True, spare=1.2, grid=1.0)
    plan = insert(tube.field, tube.line, scope=tube.scope, head_step=0.5)
    assert plan.reason_code == "NO_PASSAGE", plan.reason
    refusal = plan.refusal
    at = np.array([np.interp(refusal.at, tube.line.arc_length, c) for c in tube.line.points.T])
    assert np.linalg.norm(at - tube.pinch) <= 10.0
    assert refusal.offers < tube.scope.radius
    # As far as it goes, certified, and the head stops before the pinch.
    assert plan.inserted == 0.0 or plan.certified
    assert 0.0 < plan.inserted < refusal.at + 1.0
    ahead = np.linalg.norm(plan.joints[-1, 0] - tube.pinch)
    assert ahead >= 0.5
    assert ahead <= np.linalg.norm(tube.line.points[0] - tube.pinch)

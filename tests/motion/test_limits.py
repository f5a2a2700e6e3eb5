"""When the goal is out of reach: the right reason, the right place, advice that holds."""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass

import numpy as np
import pytest

from bozzini.duct import PackedDuct, SampledField, field_from_mask, find_centreline
from bozzini.duct.base import Wrapped
from bozzini.errors import InputError
from bozzini.motion import Scope
from bozzini.numeric.polylines import measure_arc_length, resample_polyline
from tests.exact import VoxelWall, sample_body, voxelise
from tests.motion.plans import insert
from tests.motion.planted import plant
from tests.shapes import bend_curve


class Lumen:
    def __init__(self, curve, radius, ends=None):
        mask, affine = voxelise(curve, radius)
        self.field = field_from_mask(mask, affine)
        self.wall = VoxelWall(mask, affine)
        self.line = find_centreline(self.field, ends or (curve[12], curve[-12]))
        self.plan = functools.cache(self._plan)

    def _plan(self, diameter, link, *, inflate=0.0, advise=True, **options):
        field = self.field.inflate(inflate)
        line = self.line
        if inflate:
            line = type(line)(
                points=line.points, arc_length=line.arc_length, radius=line.radius + inflate
            )
        scope = Scope(diameter=diameter, link_length=link)
        return insert(field, line, scope=scope, advise=advise, **options)


def straight(radius_at):
    curve = np.arange(0.0, 110.0)[:, None] * np.array([0.1, 0.0, 1.0])
    return Lumen(curve, radius_at(measure_arc_length(curve)))


@pytest.fixture(scope="module")
def pinched():
    return straight(lambda s: 6.0 - 3.5 * np.exp(-(((s - 70.0) / 6.0) ** 2)))


@pytest.fixture(scope="module")
def narrow_end():
    return straight(lambda s: np.where(s < 90.0, 6.0, 3.0))


@pytest.fixture(scope="module")
def narrow_start():
    return straight(lambda s: np.where(s > 25.0, 6.0, 3.0))


@pytest.fixture(scope="module")
def hairpin():
    return Lumen(bend_curve(9.0, np.pi, 45.0), 5.0)


def check_prefix(lumen, plan):
    """The motion made is certified, and exact samples of it do not belie that."""
    assert plan.certified
    points, *_ = sample_body(plan.joints, 8000, np.random.default_rng(0))
    entry = plan.introducer.entry
    outward = np.array(plan.introducer.outward)
    points = points[(points - entry) @ outward < 0.0]
    radius = 0.5 * plan.scope.diameter
    assert lumen.wall.clearance(points).min() - radius >= plan.certificate.clearance


def test_a_pinch_is_no_passage_and_the_motion_ends_before_it(pinched):
    plan = pinched.plan(8.0, 9.0)
    refusal = plan.refusal
    assert (plan.status, plan.reason_code) == ("stopped", "NO_PASSAGE")
    place = np.interp(refusal.at, pinched.line.arc_length, pinched.line.points[:, 2])
    assert place == pytest.approx(70.0, abs=3.0)
    assert refusal.offers < refusal.needs == 4.0
    assert 30.0 < plan.inserted < refusal.at
    check_prefix(pinched, plan)
    # What it says would fit: not more than was proved to be too much.
    assert refusal.diameter_max < 2.0 * refusal.offers + 1e-9
    assert pinched.plan(refusal.diameter_max - 0.6, 5.0).status == "complete"


def test_it_passes_when_the_wall_gives_way(pinched):
    refusal = pinched.plan(8.0, 9.0).refusal
    assert pinched.plan(8.0, 9.0, inflate=refusal.inflate + 0.5).status == "complete"
    assert pinched.plan(8.0, 9.0, inflate=0.3).status == "stopped"


def test_a_narrow_goal_is_named_as_such(narrow_end):
    plan = narrow_end.plan(7.0, 9.0)
    refusal = plan.refusal
    assert plan.reason_code == "GOAL_CLEARANCE"
    assert refusal.at == pytest.approx(narrow_end.line.length)
    assert plan.inserted > 0.6 * narrow_end.line.length
    check_prefix(narrow_end, plan)
    assert narrow_end.plan(refusal.diameter_max - 0.1, 9.0).status == "complete"


@pytest.mark.slow
def test_what_stops_it_far_before_a_narrow_goal_is_named():
    curve = np.arange(0.0, 140.0)[:, None] * np.array([0.0, 0.0, 1.0])
    s = measure_arc_length(curve)
    goal = np.where(s < 100.0, 7.0, 3.3)
    waist = 7.0 - 3.2 * np.exp(-(((s - 50.0) / 4.0) ** 2))
    plan = Lumen(curve, np.minimum(goal, waist)).plan(8.0, 9.0)
    refusal = plan.refusal
    alone = Lumen(curve, waist).plan(8.0, 9.0)
    assert (refusal.code, refusal.offers) == (alone.refusal.code, alone.refusal.offers)
    assert refusal.at == pytest.approx(alone.refusal.at, abs=1.0)
    assert refusal.ends_at == pytest.approx(plan.inserted, abs=3.0)
    assert abs(refusal.ends_at - refusal.at) < 15.0 and "goal" not in refusal.what
    # Where nothing stops it but the goal, that is named.
    assert Lumen(curve, goal).plan(8.0, 9.0).reason_code == "GOAL_CLEARANCE"


def test_a_narrow_entry_is_named_as_such_and_nothing_moves(narrow_start):
    plan = narrow_start.plan(7.0, 9.0)
    assert plan.reason_code == "ENTRY_CLEARANCE"
    assert plan.inserted == 0.0 and plan.steps == 1
    assert not plan.certified
    fits = plan.refusal.diameter_max
    assert fits < 7.0
    assert narrow_start.plan(fits - 0.1, 9.0).status == "complete"
    # A scope that the entry just admits, but with no room to plan in, is told so too.
    offers = plan.refusal.offers
    nearly = narrow_start.plan(2.0 * offers - 0.02, 9.0)
    assert nearly.reason_code == "ENTRY_CLEARANCE"
    assert nearly.refusal.needs > offers


@pytest.mark.slow
def test_too_long_a_link_is_named_and_a_shorter_one_fits(hairpin):
    plan = hairpin.plan(5.0, 22.0)
    refusal = plan.refusal
    assert plan.reason_code in ("LINK_TOO_LONG", "FOLD")
    bend = hairpin.line.points[:, 2] > -5.0
    where = np.interp(refusal.at, hairpin.line.arc_length, np.arange(len(bend)))
    assert np.flatnonzero(bend)[0] - 10 <= where <= np.flatnonzero(bend)[-1] + 22
    assert 0.0 < plan.inserted < hairpin.line.length
    check_prefix(hairpin, plan)
    assert refusal.link_max is None or 2.0 <= refusal.link_max < 22.0
    assert hairpin.plan(5.0, 6.0).status == "complete"
    assert refusal.diameter_max is None or refusal.diameter_max < 5.0


@pytest.mark.slow
def test_a_shorter_link_gets_as_far_or_farther(hairpin):
    reached = []
    for link in (6.0, 16.0, 24.0):
        head = hairpin.plan(5.0, link, advise=False).joints[-1, 0]
        near = np.linalg.norm(hairpin.line.points - head, axis=1).argmin()
        reached.append(hairpin.line.arc_length[near])
    assert reached[0] >= reached[1] - 2.0 >= reached[2] - 4.0
    assert reached[0] > reached[2] + 5.0


def test_an_angle_limit_stops_the_motion_below_it(hairpin):
    free = hairpin.plan(4.0, 8.0)
    widest = free.measures.joint_angle_max
    plan = hairpin.plan(4.0, 8.0, angle_limit=0.7 * widest)
    assert plan.reason_code == "ANGLE"
    assert 0.0 < plan.inserted < free.inserted
    assert plan.measures.joint_angle_max <= 0.7 * widest
    check_prefix(hairpin, plan)


@pytest.mark.slow
def test_refused_plans_still_say_why_in_one_line(pinched, narrow_end, narrow_start, hairpin):
    for lumen, diameter, link in (
        (pinched, 8.0, 9.0),
        (narrow_end, 7.0, 9.0),
        (narrow_start, 7.0, 9.0),
        (hairpin, 5.0, 22.0),
    ):
        plan = lumen.plan(diameter, link)
        assert plan.reason and "\n" not in plan.reason
        assert "nan" not in plan.reason and "inf" not in plan.reason.split()
        assert plan.refusal.code == plan.reason_code


def test_a_surface_inflated_within_its_reach_gets_a_bound_and_beyond_it_is_refused():
    import trimesh

    from bozzini.duct import Centreline, field_from_mesh

    # An hourglass: round, wide at both ends, with a waist.
    outline = [[0, -30], [8, -30], [8, -10], [3, -2], [3, 2], [8, 10], [8, 30], [0, 30]]
    glass = trimesh.creation.revolve(np.array(outline, dtype=float), sections=48)
    rigid = field_from_mesh(glass.vertices, glass.faces, voxel=1.0)
    with pytest.raises(InputError, match=r"distance is 5 mm: it must be at most 4 mm"):
        rigid.inflate(5.0)
    field = rigid.inflate(3.0)
    line = Centreline.from_points([[0.0, 0.0, -20.0], [0.0, 0.0, 20.0]], field)
    plan = insert(field, line, scope=Scope(diameter=15.0, link_length=8.0))
    assert plan.status == "stopped"
    assert plan.reason_code == "NO_PASSAGE"
    assert 3.0 + 3.0 - 0.05 <= plan.refusal.offers < 7.5
    assert plan.refusal.at == pytest.approx(20.0, abs=5.0)


def coil(length, radius=45.0, pitch=34.0):
    """A helix (n, 3) of `length` mm, 2 mm between points."""
    turn = np.arange(0.0, length, 2.0) / np.hypot(radius, pitch / (2.0 * np.pi))
    rise = pitch * turn / (2.0 * np.pi)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), rise], axis=1)


@pytest.fixture(scope="module")
def plated():
    """A tube of 1 m that widens and narrows, with a plate across it at 800 mm."""
    curve = coil(1000.0)
    s = measure_arc_length(curve)
    mask, affine = voxelise(curve, 7.2 + 0.8 * np.sin(s / 17.0) + 0.4 * np.sin(s / 41.0))
    centre, along = curve[400], curve[401] - curve[399]
    index = np.argwhere(mask)
    away = index @ affine[:3, :3].T + affine[:3, 3] - centre
    offset = away @ along / np.linalg.norm(along)
    plate = (np.abs(offset) < 1.0) & (np.linalg.norm(away, axis=1) < 20.0)
    # A hole that joins both sides, too small for any scope here.
    hole = np.linalg.norm(away, axis=1) < 2.5
    mask[tuple(index[plate & ~hole].T)] = False
    field = field_from_mask(mask, affine)
    return field, find_centreline(field, (curve[10], curve[-10])), centre


@pytest.mark.slow
@pytest.mark.parametrize(("diameter", "link"), [(6.0, 8.0), (8.0, 10.0), (7.0, 20.0)])
def test_a_motion_stops_near_the_obstacle_however_long_the_way(plated, diameter, link):
    # Before, a point of the line with too little clearance for the bisection ended the search.
    field, line, plate = plated
    scope = Scope(diameter=diameter, link_length=link)
    plan = insert(field, line, scope=scope, head_step=2.0, method="tube", advise=False)
    assert plan.reason_code == "NO_PASSAGE"
    assert plan.certified
    ahead = np.linalg.norm(plan.joints[-1, 0] - plate)
    assert scope.radius < ahead < scope.radius + 4.0


@pytest.mark.parametrize("seed", range(100, 106))
def test_a_pinched_tube_is_entered_up_to_where_it_gets_too_narrow(seed):
    tube = plant(seed, pinched=True, spare=1.2, grid=1.0)
    plan = insert(tube.field, tube.line, scope=tube.scope, head_step=1.0, advise=False)
    head = np.linalg.norm(tube.line.points - plan.joints[-1, 0], axis=1).argmin()
    narrow = np.argmax(tube.line.radius < tube.scope.radius)
    assert 0.0 <= tube.line.arc_length[narrow] - tube.line.arc_length[head] <= 3.0
    assert plan.refusal.ends_at == pytest.approx(tube.line.arc_length[head], abs=1.0)


def test_what_ends_a_motion_far_from_the_place_that_decides_is_told():
    # A bend that a long link does not pass, and far behind it a waist too narrow for the scope.
    bend = bend_curve(14.0, 0.5 * np.pi, 45.0)
    after = bend[-1] + np.arange(1.0, 90.0)[:, None] * (bend[-1] - bend[-2])
    curve = resample_polyline(np.concatenate([bend, after]), 1.0)
    s = measure_arc_length(curve)
    lumen = Lumen(curve, 6.0 - 3.5 * np.exp(-(((s - s[-1] + 40.0) / 5.0) ** 2)))
    plan = lumen.plan(8.0, 30.0, advise=False)
    refusal = plan.refusal
    assert refusal.code == "NO_PASSAGE" and refusal.at - refusal.ends_at > 40.0
    assert refusal.ends_code in ("LINK_TOO_LONG", "FOLD")
    # Where it ends, which part of the body meets which limit there, then what decides farther on.
    begin = f"the motion ends at {refusal.ends_at:.1f} mm of the centreline: link 1, that of the"
    assert plan.reason.startswith(begin)
    assert f"; farther on, {refusal.what}" in plan.reason
    # Links that pass the bend go on to the waist: the same place decides and ends.
    short = lumen.plan(8.0, 8.0, advise=False)
    assert short.refusal.code == "NO_PASSAGE"
    assert short.refusal.ends_at > refusal.ends_at + 30.0
    assert short.refusal.ends_code == "HEAD_CLEARANCE"
    at = float(re.search(r"at (\S+) mm of the centreline", short.refusal.ends_what)[1])
    assert short.refusal.ends_at - 1.0 <= at <= short.refusal.at
    # It is kept in the file of the plan.
    assert plan.meta["refusal"]["ends_what"] in plan.reason


def test_an_introducer_is_no_wider_than_the_entry(narrow_start):
    plan = narrow_start.plan(7.0, 9.0)
    bore = plan.introducer.bore
    entry = narrow_start.line.points[0]
    assert bore == pytest.approx(float(narrow_start.field.clearance_bound(entry)))
    assert bore < 3.5
    assert not plan.certified
    fits = narrow_start.plan(plan.refusal.diameter_max, 9.0)
    assert fits.certified
    assert fits.introducer.bore == pytest.approx(bore)


def test_a_scope_has_the_links_of_its_length(pinched):
    scope = Scope(diameter=2.0, link_length=8.0, length=200.0)
    assert insert(pinched.field, pinched.line, scope=scope).links == 25


@dataclass(frozen=True, eq=False)
class Refined(Wrapped, PackedDuct):
    """A duct with a coarse part for searches, as a refined field has one."""

    coarse: SampledField

    @property
    def _inner(self):
        return self.coarse

    def pack(self):
        return self.coarse.pack()

    def inflate(self, distance):
        return Refined(self.coarse.inflate(distance))


def test_a_duct_with_a_coarse_part_is_searched_on_it(pinched):
    duct = Refined(pinched.field)
    for diameter in (3.0, 8.0):
        scope = Scope(diameter=diameter, link_length=9.0)
        plans = [insert(d, pinched.line, scope=scope) for d in (duct, pinched.field)]
        assert plans[0].reason == plans[1].reason
        assert np.array_equal(plans[0].joints, plans[1].joints)
        assert plans[0].field == plans[1].field

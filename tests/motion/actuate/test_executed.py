"""The certificate of moving arcs is a proof: exact walls sampled, planted violations seen."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.continuum import ContinuumRobot, Section
from bozzini.errors import InputError
from bozzini.motion import FreeSpace, Introducer
from bozzini.motion.actuate.actuation import ArcCertificate
from bozzini.motion.actuate.executed import certify_arcs, choose_grid, find_base_frame, place_bodies
from bozzini.motion.kernels.actuate import bound_bending
from tests.motion.actuate.motions import place_point
from tests.shapes import sample_field


def random_motion(seed, *, steps=3, swing=0.4):
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 6))
    lengths = random.uniform(5.0, 40.0, count)
    bends = random.normal(size=(1, count, 2)) + swing * random.normal(size=(steps, count, 2))
    advances = np.cumsum(random.uniform(0.0, 2.0, steps))
    robot = ContinuumRobot([Section(length=float(size), radius=1.0) for size in lengths])
    return random, robot, lengths, bends, advances


def place_moving(lengths, bends, advances, time, arc):
    step = min(int(time), len(bends) - 2)
    share = time - step
    now = (1.0 - share) * bends[step] + share * bends[step + 1]
    advance = (1.0 - share) * advances[step] + share * advances[step + 1]
    return place_point(lengths, now, arc) + [0.0, 0.0, advance - lengths.sum()]


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.sampled_from([0.5, 0.05, 0.01]))
def test_no_point_of_the_chain_is_off_its_point_of_the_body_by_more_than_is_said(seed, deviation):
    random, robot, lengths, bends, advances = random_motion(seed)
    chords, parts, off = choose_grid(lengths, bends, deviation=deviation)
    assert off <= 2.0 * deviation + 1e-6
    for _ in range(20):
        step, section = int(random.integers(0, 2)), int(random.integers(0, len(lengths)))
        part, chord = random.integers(0, parts[step]), random.integers(0, chords[section])
        u, v = random.uniform(size=2)
        times = step + (part + np.array([0.0, 1.0])) / parts[step]
        arcs = lengths[:section].sum() + (chord + np.array([0.0, 1.0])) * (
            lengths[section] / chords[section]
        )
        corner = [[place_moving(lengths, bends, advances, t, s) for s in arcs] for t in times]
        chain = (1 - u) * ((1 - v) * corner[0][0] + v * corner[0][1])
        chain = chain + u * ((1 - v) * corner[1][0] + v * corner[1][1])
        body = place_moving(
            lengths,
            bends,
            advances,
            (1 - u) * times[0] + u * times[1],
            (1 - v) * arcs[0] + v * arcs[1],
        )
        assert np.linalg.norm(chain - body) <= off


@settings(max_examples=25)
@given(st.integers(0, 10**6))
def test_second_derivative_in_time_keeps_its_bound(seed):
    random, _, lengths, bends, advances = random_motion(seed, steps=2)
    bound = np.zeros(1)
    bound_bending(lengths, bends, bound)
    tip, h = lengths.sum(), 1e-3
    time = random.uniform(h, 1.0 - h)
    x = [place_moving(lengths, bends, advances, time + k * h, tip) for k in (-1, 0, 1)]
    curving = np.linalg.norm(x[0] - 2.0 * x[1] + x[2]) / h**2
    assert curving <= bound[0] * (1.0 + 1e-4) + 1e-5


def test_the_bound_in_time_is_met_by_a_section_that_starts_to_bend():
    # x = L (1 - cos theta) / theta = L theta / 2, z = L (1 - theta^2 / 6): z'' = L theta'^2 / 3.
    bends = np.array([[[0.0, 0.0]], [[1e-3, 0.0]]])
    bound = np.zeros(1)
    bound_bending(np.array([30.0]), bends, bound)
    assert bound[0] == pytest.approx(30.0 * 1e-6 / 3.0, rel=1e-9)


@settings(max_examples=20)
@given(st.integers(0, 10**6))
def test_bodies_are_placed_as_by_quadrature(seed):
    random, robot, lengths, bends, advances = random_motion(seed)
    outward = random.normal(size=3)
    introducer = Introducer(
        entry=random.normal(size=3), outward=outward / np.linalg.norm(outward), bore=3.0
    )
    frame = find_base_frame(introducer, roll=float(random.uniform(-3.0, 3.0)))
    assert frame[:3, :3] @ frame[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(frame[:3, :3]) == pytest.approx(1.0)
    assert frame[:3, 2] == pytest.approx(-introducer.outward)
    time = float(random.uniform(0.0, 2.0))
    joints = place_bodies(
        robot, bends, advances, frame, times=[time], chords=np.full(len(lengths), 3)
    )[0, ::-1]
    share = np.repeat(np.arange(len(lengths)), 3), np.tile([1, 2, 3], len(lengths)) / 3.0
    starts = np.concatenate([[0.0], np.cumsum(lengths)])
    for k, (section, part) in enumerate(zip(*share, strict=True)):
        arc = starts[section] + part * lengths[section]
        local = place_moving(lengths, bends, advances, time, arc)
        assert joints[k + 1] == pytest.approx(frame[:3, :3] @ local + frame[:3, 3], abs=1e-9)


@pytest.fixture(scope="module")
def hall():
    """A wide straight hall along z with the introducer before it; wall: the box's faces."""

    def distance(points):
        gap = np.maximum(np.abs(points[..., :2]).max(axis=-1) - 20.0, -points[..., 2])
        return np.maximum(gap, points[..., 2] - 100.0)

    field = sample_field(distance, (-24.0, -24.0, -4.0), (24.0, 24.0, 104.0), 2.0)
    entry = np.array([0.0, 0.0, 4.0])
    return SimpleNamespace(
        field=field,
        exact=distance,
        introducer=Introducer(entry=entry, outward=np.array([0.0, 0.0, -1.0]), bore=3.5),
    )


ROBOT = ContinuumRobot([Section(length=30.0, radius=2.0), Section(length=30.0, radius=2.0)])


def sample_clearance(hall, bends, advances, count=4000, seed=3):
    """Smallest exact clearance at random times and arc lengths outside the introducer."""
    random = np.random.default_rng(seed)
    lengths = np.array([30.0, 30.0])
    least = np.inf
    for _ in range(count):
        time = random.uniform(0.0, len(bends) - 1.0)
        place = place_moving(lengths, bends, advances, time, random.uniform(0.0, 60.0))
        if place[2] > 0.0:
            least = min(least, -hall.exact(place + hall.introducer.entry) - 2.0)
    return least


def wave(steps, size):
    """The robot outside, its two sections bending to and fro."""
    t = np.linspace(0.0, 2.0 * np.pi, steps)
    bends = np.zeros((steps, 2, 2))
    bends[:, 0, 0] = size * np.sin(t) * (1.0 + 0.02 * t)  # no two of its extremes alike
    bends[:, 1, 1] = size * np.cos(t)
    return bends, np.full(steps, 60.0)


def test_certificate_is_below_sampled_clearance_and_not_far(hall):
    bends, advances = wave(9, 0.35)
    proof = certify_arcs(ROBOT, bends, advances, FreeSpace(hall.field, introducer=hall.introducer))
    found = sample_clearance(hall, bends, advances)
    assert proof.certified and proof.resolved
    assert proof.clearance <= found
    assert found - proof.clearance < 0.1 + proof.deviation + hall.field.error
    finer = certify_arcs(
        ROBOT, bends, advances, FreeSpace(hall.field, introducer=hall.introducer), deviation=0.001
    )
    assert finer.deviation < proof.deviation
    assert finer.clearance <= found


def test_a_wall_that_is_hit_between_two_steps_only_is_seen():
    # From a bend to one side to the other in one step: half way the straight robot is too long.
    def distance(points):
        gap = np.maximum(np.abs(points[..., :2]).max(axis=-1) - 76.0, -points[..., 2])
        return np.maximum(gap, points[..., 2] - 80.0)

    field = sample_field(distance, (-80.0, -80.0, -8.0), (80.0, 80.0, 88.0), 8.0)
    introducer = Introducer(
        entry=np.array([0.0, 0.0, 4.0]), outward=np.array([0.0, 0.0, -1.0]), bore=3.5
    )
    robot = ContinuumRobot([Section(length=48.0, radius=2.0), Section(length=48.0, radius=2.0)])
    bends = np.zeros((2, 2, 2))
    bends[0, :, 0], bends[1, :, 0] = 1.4, -1.4
    advances = np.full(2, 96.0)
    space = FreeSpace(field, introducer=introducer)
    for k in (0, 1):
        still = bends[k : k + 1]
        assert certify_arcs(robot, still, advances[:1], space).certified
    moving = certify_arcs(robot, bends, advances, space)
    # The tip of the straight robot is at 100 mm, its end 2 mm farther: 22 mm in the wall.
    assert moving.clearance == pytest.approx(-22.0, abs=field.error + 0.2)
    assert (moving.section, moving.place[2]) == (1, pytest.approx(100.0, abs=0.5))
    assert moving.step == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("section", [0, 1])
def test_a_planted_violation_is_seen(hall, section):
    bends, advances = wave(9, 0.35)
    bends[4, section] += [2.2, 0.0]
    proof = certify_arcs(ROBOT, bends, advances, FreeSpace(hall.field, introducer=hall.introducer))
    assert sample_clearance(hall, bends, advances) < 0.0
    assert not proof.certified
    assert 3.0 < proof.step < 5.0
    assert proof.section == 1  # the tip gets farthest
    assert -hall.exact(proof.place) < 2.0


def test_in_the_introducer_nothing_is_proved_and_nothing_is_wrong(hall):
    proof = certify_arcs(
        ROBOT, np.zeros((3, 2, 2)), np.zeros(3), FreeSpace(hall.field, introducer=hall.introducer)
    )
    assert proof.clearance > 0.0
    assert proof.section == 1 and proof.arc_length < ROBOT.length
    bent = np.full((3, 2, 2), 0.8)
    assert not certify_arcs(
        ROBOT, bent, np.zeros(3), FreeSpace(hall.field, introducer=hall.introducer)
    ).certified


def test_blocks_do_not_change_the_bound(hall, monkeypatch):
    bends, advances = wave(9, 0.35)
    whole = certify_arcs(ROBOT, bends, advances, FreeSpace(hall.field, introducer=hall.introducer))
    monkeypatch.setattr("bozzini.motion.actuate.executed.BLOCK", 200)
    pieces = certify_arcs(ROBOT, bends, advances, FreeSpace(hall.field, introducer=hall.introducer))
    assert pieces.clearance == pytest.approx(whole.clearance, abs=0.1)
    assert pieces.found == pytest.approx(whole.found, abs=0.1)
    assert pieces.step == pytest.approx(whole.step, abs=0.5)


def test_description_comes_back(hall):
    bends, advances = wave(3, 0.3)
    proof = certify_arcs(ROBOT, bends, advances, FreeSpace(hall.field, introducer=hall.introducer))
    again = ArcCertificate.from_description(proof.describe())
    assert again.describe() == proof.describe()
    with pytest.raises(InputError, match="not a certificate"):
        ArcCertificate.from_description({"clearance_mm": 1.0})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"bends": np.zeros((3, 1, 2))}, r"bends has shape \(3, 1, 2\)"),
        ({"bends": np.full((3, 2, 2), np.nan)}, "not finite"),
        ({"advances": np.zeros(2)}, r"advances has shape \(2,\)"),
        ({"deviation": 0.0}, "deviation is 0"),
        ({"roll": np.nan}, "roll is nan"),
        ({"bends": 1e5 * np.eye(3)[:, :2, None] * np.ones(2)}, "too coarse to certify"),
    ],
)
def test_what_cannot_be_certified_is_said(hall, change, words):
    given = {"bends": np.zeros((3, 2, 2)), "advances": np.zeros(3), **change}
    bends, advances = given.pop("bends"), given.pop("advances")
    with pytest.raises(InputError, match=words):
        certify_arcs(
            ROBOT, bends, advances, FreeSpace(hall.field, introducer=hall.introducer), **given
        )

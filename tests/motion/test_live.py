"""The loop in a tract that moves: what it certifies holds, and what it cannot it says."""

from __future__ import annotations

import io
import itertools
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from bozzini.anatomy import (
    Breathing,
    Peristalsis,
    RecordedMotion,
    TissueFrame,
    TissueMotion,
)
from bozzini.duct import Centreline, MovingField, build_field, carry_tissue
from bozzini.errors import InputError
from bozzini.motion import (
    LiveFrame,
    LiveOptions,
    LiveRun,
    Plan,
    ReplanOptions,
    Scope,
    certify_plan,
    follow_tissue,
    replan,
)
from bozzini.motion.live import _judge
from tests.duct.test_moving import make_tube
from tests.exact import MeshWall, outside_introducer, sample_body
from tests.human import load_human
from tests.motion.plans import insert
from tests.plot.fake_motion import make_plan

SCOPE = Scope(diameter=5.0, link_length=8.0)
BREATH = Breathing(amplitude=3.0, wavelength=120.0, period=2.0, direction=(0.0, 1.0, 0.0))


@pytest.fixture(scope="module")
def rest():
    surface, line = make_tube(radius=6.0, length=70.0, bend=40.0)
    field = build_field(surface, voxel=1.0)
    way = Centreline.from_points(line[4:-4], field)
    plan = insert(field, way, scope=SCOPE, method="tube", head_step=1.0)
    assert plan.status == "complete"
    return surface, field, plan


def record(line, steepness=0.12):
    """Displacements on a coarse grid around a line, that come and go."""
    low, spacing = line.min(axis=0) - 20.0, np.array([12.0, 12.0, 12.0])
    shape = np.ceil((np.ptp(line, axis=0) + 40.0) / spacing).astype(int) + 1
    nodes = low + np.stack(np.indices(shape), -1) * spacing
    wave = np.array([0.02, 0.0, 0.05])
    height = steepness / np.linalg.norm(wave) * np.sin(nodes @ wave)
    times = np.linspace(0.0, 2.0, 9)
    strength = np.sin(np.pi * times / 2.0) ** 2
    grids = strength[:, None, None, None, None] * height[..., None] * np.array([0.0, 1.0, 0.0])
    return RecordedMotion(displacement=grids, times=times, origin=low, spacing=spacing)


def make_motions(line, depth=0.3):
    return {
        "breathing": BREATH,
        "peristalsis": Peristalsis(line=line, depth=depth, width=15.0, wave_speed=20.0),
        "recorded": record(line),
    }


def measure_exactly(frame, surface, motion, count, random):
    """The smallest clearance of samples of the frame's motion to the moved triangles [mm]."""
    moved = surface.vertices + motion.at(frame.time)(surface.vertices)
    plan, radius = frame.plan, frame.plan.scope.radius
    points = sample_body(plan.joints, count, random)[0]
    points = points[outside_introducer(points, plan.introducer, radius)]
    return MeshWall(moved, surface.faces).clearance(points).min() - radius, len(points)


def run(rest, motion, **options):
    surface, field, plan = rest
    made = LiveOptions(**{"rate": 10.0, "horizon": 15.0, "advance": 10.0, **options})
    return list(follow_tissue(plan, field, motion=motion, surface=surface, options=made))


@pytest.mark.parametrize(
    "name", ["breathing", "recorded", pytest.param("peristalsis", marks=pytest.mark.slow)]
)
def test_certificates_are_below_the_exact_clearance(rest, name):
    surface, _, plan = rest
    motion = make_motions(plan.path)[name]
    random = np.random.default_rng(0)
    frames = run(rest, motion, duration=min(motion.period, 1.0))
    for frame in frames:
        assert frame.status in ("held", "now"), frame.reason
        least, count = measure_exactly(frame, surface, motion, 1000, random)
        assert count > 300
        assert frame.clearance <= least
        # The rest of the way has no more; where the horizon is beyond the goal it is the same.
        if frame.rest is not None:
            assert frame.rest <= frame.clearance + 0.1
        assert frame.plan.status != "complete" or frame.rest == frame.clearance
        # A certificate is made of the plan alone: who asks again gets it again.
        assert certify_plan(frame.plan, frame.field).clearance == pytest.approx(frame.clearance)
    assert max(frame.tissue_move for frame in frames) > 0.1
    assert len({frame.head for frame in frames}) > 3


def test_the_body_moves_with_the_tissue_and_keeps_its_links(rest):
    frames = run(rest, BREATH, duration=2.0, advance=0.0)
    for before, frame in itertools.pairwise(frames):
        links = np.linalg.norm(np.diff(frame.body, axis=0), axis=1)
        assert links == pytest.approx(np.full(len(links), SCOPE.link_length))
        moved = carry_tissue(before.body, BREATH.at(before.time), now=BREATH.at(frame.time))
        inside = len(frame.body) - 3  # the last joints stand in the introducer
        gone = np.linalg.norm(frame.body - before.body, axis=1)[:inside]
        off = np.linalg.norm(frame.body - moved, axis=1)[:inside]
        assert off.max() < 0.5 * max(gone.max(), 0.2)
        assert frame.carried >= 0.0
    # After a breath it stands about where it stood.
    assert np.abs(frames[-1].body - frames[0].body)[:5].max() < 0.5


def find_joints(before, frame, share):
    """Where the joints are at a share of the time between two frames, by the loop's schedule."""
    plan, last = before.plan, before.next_step
    begin = 0.5 if last > 0 else 0.0
    if share < begin:
        place = last * share / begin
        step = min(int(place), last - 1)
        return plan.joints[step] + (place - step) * (plan.joints[step + 1] - plan.joints[step])
    along = (share - begin) / (1.0 - begin)
    return (1.0 - along) * plan.joints[last] + along * frame.body


def measure_between(before, frame, surface, motion, shares, count=400):
    """The smallest clearance of samples of the body to the triangles, at times between frames."""
    random, least = np.random.default_rng(1), np.inf
    for share in shares:
        time = before.time + share * (frame.time - before.time)
        wall = MeshWall(surface.vertices + motion.at(time)(surface.vertices), surface.faces)
        chain = find_joints(before, frame, share)
        points = sample_body(np.stack([chain, chain]), count, random)[0]
        for plan in (before.plan, frame.plan):
            points = points[outside_introducer(points, plan.introducer, SCOPE.radius)]
            points = points[(points - plan.introducer.entry) @ plan.introducer.outward < 0.0]
        assert len(points) > 50
        least = min(least, wall.clearance(points).min() - SCOPE.radius)
    return least


class Refused(TissueMotion):
    """A motion that states too little at some times, and is not known at others."""

    def __init__(self, motion, *times):
        self.motion, self.times = motion, times
        self.period, self.speed = motion.period, motion.speed

    def at(self, time):
        frame = self.motion.at(time)
        if any(abs(time - each) < 1e-9 for each in self.times[::2]):
            return replace(frame, gradient_bound=0.3 * frame.gradient_bound)
        if any(abs(time - each) < 1e-9 for each in self.times[1::2]):
            return replace(frame, move=lambda points: np.full(points.shape, np.nan))
        return frame


@pytest.mark.parametrize(
    ("name", "advance"),
    [
        ("breathing", 40.0),
        pytest.param("recorded", 0.0, marks=pytest.mark.slow),
        pytest.param("breathing", 0.0, marks=pytest.mark.slow),
        pytest.param("recorded", 40.0, marks=pytest.mark.slow),
        pytest.param("peristalsis", 0.0, marks=pytest.mark.slow),
        pytest.param("peristalsis", 40.0, marks=pytest.mark.slow),
    ],
)
def test_between_frames_nothing_comes_nearer_than_certified(rest, name, advance):
    surface, _, plan = rest
    motion = make_motions(plan.path)[name]
    begin = 0.4 * motion.period
    stated = Later(motion, begin)
    loop = Refused(stated, 0.3, 0.4)
    frames = run(rest, loop, duration=0.8, advance=advance, inserted=0.35)
    assert [frame.number for frame in frames if frame.status == "refused"] == [3, 4]
    known = [frame for frame in frames if frame.status != "refused"]
    for before, frame in itertools.pairwise(known):
        shares = (0.1, 0.45, 0.6, 0.9)
        assert measure_between(before, frame, surface, stated, shares) >= frame.carried
    assert (max(frame.next_step for frame in frames) > 2) == (advance > 0.0)


class Later(TissueMotion):
    """A motion that begins at a later time of its cycle."""

    def __init__(self, motion, begin):
        self.motion, self.begin = motion, begin
        self.period, self.speed = motion.period, motion.speed

    def at(self, time):
        return self.motion.at(time + self.begin)


def test_a_refused_frame_counts_as_if_there_was_none(rest):
    # With every other frame refused the loop is one of half the rate.
    missed = run(rest, Refused(BREATH, 0.25, 0.75), rate=4.0, duration=1.25, advance=0.0)
    seldom = run(rest, BREATH, rate=2.0, duration=1.5, advance=0.0)
    assert [frame.status == "refused" for frame in missed] == [False, True, False, True, False]
    assert [missed[k].carried for k in (2, 4)] == [seldom[k].carried for k in (1, 2)]
    assert [missed[k].clearance for k in (0, 2, 4)] == [frame.clearance for frame in seldom]
    # What the wall may do until the next frame: in a refused one twice as much.
    moved = BREATH.speed / 4.0
    assert [frame.margin for frame in missed[:3]] == pytest.approx([moved, 2.0 * moved, moved])


def test_while_the_head_moves_on_the_plan_is_compared_with_the_wall_it_was_made_for(rest):
    frames = run(rest, BREATH, duration=1.0, advance=40.0, inserted=0.4)
    for before, frame in itertools.pairwise(frames):
        assert before.next_step > 0
        heads = before.plan.head_arc_length
        assert heads[before.next_step] - heads[0] == pytest.approx(4.0, abs=1.0)
        assert frame.carried <= before.clearance - 0.5 * before.margin + 1e-12
    found = LiveRun.collect(frames, rate=10.0, motion=BREATH)
    assert found.to_dict()["carried_min_mm"] == min(frame.carried for frame in frames[1:])


def test_a_head_that_was_held_up_does_not_make_up_for_it(rest):
    _, _, plan = rest
    middle = plan.path[int(0.75 * len(plan.path))]

    class Pinch(Breathing):
        def at(self, time):
            depth = 0.92 if time < 1.0 else 0.0

            def move(points):
                away = points - middle
                return -depth * np.exp(-np.einsum("ij,ij->i", away, away) / 128.0)[:, None] * away

            return TissueFrame(move=move, gradient_bound=depth, second_bound=1.3803 * depth / 8.0)

    frames = run(rest, Pinch(amplitude=0.1), inserted=0.4, horizon=40.0, duration=1.4)
    held_up = [frame.ahead == 0.0 for frame in frames]
    assert held_up == [True] * 10 + [False] * 4
    gone = np.diff([frame.head for frame in frames])
    assert np.abs(gone[:9]).max() < 0.1
    # 10 mm/s at 10 Hz, in steps of 1 mm.
    assert gone[10:].max() < 2.1
    assert gone[10:].sum() > 1.5


def test_what_is_certified_reads_apart_from_what_the_wall_may_do(rest):
    _, _, plan = rest
    sound = replace(plan, certificate=replace(plan.certificate, clearance=0.1555))
    status, reason = _judge(sound, None, 0.157)
    assert status == "now"
    assert "0.15 mm are certified, the wall may move by 0.16 mm" in reason
    assert "-0.01 mm were certified" in _judge(sound, -0.003, 0.0)[1]
    assert "nothing was certified" in _judge(sound, -np.inf, 0.0)[1]


def test_a_move_that_is_not_certified_takes_the_hold_from_the_frame_before(rest):
    first, second = run(rest, replace(BREATH, amplitude=0.5), duration=0.2, advance=0.0)
    assert first.status == "held"
    found = LiveRun.collect([first, replace(second, carried=-0.045)], rate=10.0, motion=BREATH)
    assert found.frames[0].status == "now"
    assert "while the tissue moved on, -0.05 mm were certified" in found.frames[0].reason


def test_the_margin_is_the_walls_speed_over_the_rate(rest):
    slow, fast = (run(rest, BREATH, rate=rate, duration=0.2)[-1] for rate in (5.0, 50.0))
    assert slow.margin == pytest.approx(BREATH.speed / 5.0)
    assert fast.margin == pytest.approx(0.1 * slow.margin)
    # What is certified is the same; whether it holds up to the next frame depends on the rate.
    assert fast.clearance >= fast.margin
    rushed = run(rest, replace(BREATH, period=0.1), rate=4.0, duration=0.5)[0]
    assert rushed.status == "now"
    assert "until the next frame" in rushed.reason


def test_where_the_way_ahead_is_closed_the_body_is_still_kept_clear(rest):
    _, _, plan = rest
    middle = plan.path[int(0.8 * len(plan.path))]

    class Pinch(Breathing):
        def at(self, time):
            def move(points):
                away = points - middle
                return -0.92 * np.exp(-np.einsum("ij,ij->i", away, away) / 128.0)[:, None] * away

            return TissueFrame(move=move, gradient_bound=0.92, second_bound=1.3803 * 0.92 / 8.0)

    frames = run(rest, Pinch(amplitude=0.1), inserted=0.4, horizon=40.0, duration=0.3)
    for frame in frames:
        assert frame.status == "held"
        assert frame.ahead == 0.0
        assert frame.clearance > 0.0
        assert "could not be planned" in frame.reason


def test_a_ring_that_closes_on_the_scope_is_said(rest):
    _, _, plan = rest
    ring = make_motions(plan.path, depth=0.9)["peristalsis"]
    frames = run(rest, ring, rate=4.0, duration=1.1 * ring.period, inserted=0.4, advance=0.0)
    lost = [frame for frame in frames if frame.status == "lost"]
    assert lost
    assert all(frame.reason and frame.clearance is None for frame in lost)
    assert all(frame.clearance >= 0.0 for frame in frames if frame.status != "lost")
    found = LiveRun.collect(frames, rate=4.0, motion=ring)
    assert not found.converged
    assert found.reason.startswith(f"frame {lost[0].number} ")
    assert found.residual >= len(lost) / len(frames)
    # Where the ring has passed the scope is clear again.
    assert frames[-1].status != "lost"
    assert frames[-1].clearance > 0.0


class Liar(Breathing):
    """Moves more than it states, in its second half."""

    def at(self, time):
        frame = super().at(time)
        return replace(frame, gradient_bound=(0.5 if time > 0.45 else 1.0) * frame.gradient_bound)


def test_a_frame_that_breaks_its_bounds_is_refused_and_the_loop_goes_on(rest):
    liar = Liar(amplitude=3.0, wavelength=120.0, period=2.0, direction=(0.0, 1.0, 0.0))
    frames = run(rest, liar, rate=20.0, duration=0.6)
    states = [frame.status for frame in frames]
    assert states[:10] == ["held"] * 10
    assert states[10:] == ["refused"] * 2
    for frame in frames[10:]:
        assert frame.clearance is None
        assert frame.field is None
        assert frame.plan is frames[9].plan
        assert "stated" in frame.reason


def test_a_horizon_is_planned_on_from_where_the_scope_stands(rest, tmp_path):
    surface, field, plan = rest
    moving = MovingField(field, surface)
    still = {"gradient_bound": 0.0, "second_bound": 0.0, "radius": SCOPE.radius}
    lumen = moving.update(np.zeros_like, path=plan.path, **still)
    step = plan.steps // 2
    ahead = replan(plan, lumen, options=ReplanOptions(step=step, horizon=12.0, measure=False))
    assert (ahead.status, ahead.reason_code) == ("stopped", "HORIZON")
    assert ahead.measures is None
    heads = ahead.head_arc_length
    assert heads[0] == pytest.approx(plan.head_arc_length[step], abs=0.1)
    assert heads[-1] - heads[0] == pytest.approx(12.0, abs=0.1)
    # The body stands as it stood, the path leads on to the same goal.
    assert np.abs(ahead.joints[0] - plan.joints[step]).max() < 0.3
    assert ahead.path[[0, -1]] == pytest.approx(plan.path[[0, -1]])
    # It can be planned on from, to the goal; the whole way has no more clearance than a part of it.
    read = Plan.load(ahead.save(tmp_path / "plan.npz"))
    assert (read.reason_code, read.certificate.clearance) == ("HORIZON", ahead.proved)
    rest_ = replan(read, lumen, options=ReplanOptions(step=0))
    assert rest_.status == "complete"
    assert rest_.certificate.clearance <= ahead.certificate.clearance + 0.1
    assert rest_.inserted == pytest.approx(rest_.path_arc_length[-1])
    with pytest.raises(InputError, match="step is 9999"):
        replan(plan, lumen, options=ReplanOptions(step=9999))
    thin = Scope(diameter=4.0, link_length=6.0)
    with pytest.raises(InputError, match="another scope"):
        replan(plan, lumen, scope=thin, options=ReplanOptions(step=0))
    with pytest.raises(InputError, match="no step"):
        ReplanOptions(horizon=5.0)


def test_a_run_is_a_table_and_two_pictures(rest):
    frames = run(rest, BREATH, duration=0.5)
    found = LiveRun.collect(frames, rate=10.0, motion=BREATH)
    table = found.to_frame()
    assert len(table) == len(frames) == 5
    assert list(table["clearance_mm"]) == [frame.clearance for frame in frames]
    summary = found.to_dict()
    counts = [summary[f"frames_{name}"] for name in ("held", "now", "lost", "refused")]
    assert sum(counts) == summary["frames"]
    assert summary["clearance_min_mm"] == table["clearance_mm"].min()
    assert found.plot().get_ylabel() == "clearance [mm]"
    assert found.plot_latency().get_xlabel() == "latency [ms]"
    with pytest.raises(InputError, match="at least one"):
        LiveRun(frames=(), rate=1.0, speed=1.0)


@pytest.mark.parametrize("slow", [0.0, 2e-4, 0.4])
def test_the_picture_of_latencies_shows_bars(slow):
    """Steady frames of 14 ms, alike or nearly, or with one that takes long."""
    frame = LiveFrame(number=0, time=0.0, status="held", latency=0.014, plan=make_plan())
    frames = [frame] * 9 + [replace(frame, latency=0.014 + slow)]
    figure = Figure(figsize=(3.0, 3.6))
    axes = LiveRun(frames=frames, rate=20.0, speed=1.0).plot_latency(figure.subplots())
    figure.savefig(io.BytesIO())
    bars = [patch for patch in axes.patches if patch.get_height() > 0.0]
    assert sum(patch.get_height() for patch in bars) == len(frames)
    assert min(patch.get_window_extent().width for patch in bars) > 2.0  # pixels


def test_a_motion_that_is_not_known_along_the_way_is_refused(rest):
    _, field, plan = rest
    known = record(plan.path)
    in_metres = replace(known, origin=1e-3 * known.origin, spacing=1e-3 * known.spacing,
        displacement=1e-3 * known.displacement)  # fmt: skip
    with pytest.raises(InputError, match="the grid of displacements reaches from.*in mm"):
        next(follow_tissue(plan, field, motion=in_metres))
    assert next(follow_tissue(plan, field, motion=known)).status == "held"


def test_what_is_no_plan_lumen_or_motion_is_refused(rest):
    _, field, plan = rest
    for call, message in (
        (lambda: replan(None, field), "plan is a NoneType: it must be a Plan"),
        (lambda: replan(plan, plan), "duct is a Plan: it must be a Duct"),
        (lambda: next(follow_tissue(plan, field, motion=plan)), "motion is a Plan: it must be"),
    ):
        with pytest.raises(InputError, match=message):
            call()


def test_labels_are_followed_by_the_bound_alone(rest):
    _, field, plan = rest
    gentle = replace(BREATH, amplitude=1.0)
    options = LiveOptions(rate=10.0, duration=0.5, horizon=15.0)
    frames = list(follow_tissue(plan, field, motion=gentle, options=options))
    assert all(frame.measured == 0 for frame in frames)
    assert all(frame.status == "held" for frame in frames)


@pytest.fixture(scope="module")
def human(upper_gi_dir):
    surface, field, line = load_human(upper_gi_dir, "surface", 1.0)
    scope = Scope(diameter=6.0, link_length=12.0)
    return surface, field, line, insert(field, line, scope=scope, method="tube", head_step=1.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["breathing", "peristalsis", "recorded"])
def test_a_human_tract_that_moves(human, name):
    surface, field, line, plan = human
    scope = plan.scope
    sway = Breathing(amplitude=6.0, wavelength=200.0, direction=(1.0, 0.0, 0.0))
    motion = {
        "breathing": sway,
        "peristalsis": Peristalsis(line=line.points, depth=0.1, wave_speed=27.0),
        "recorded": record(line.points, steepness=0.1),
    }[name]
    random = np.random.default_rng(0)
    samples = 0
    options = LiveOptions(rate=20.0 / motion.period, advance=2.0, inserted=0.6, horizon=30.0)
    frames = list(follow_tissue(plan, field, motion=motion, surface=surface, options=options))
    for frame in frames:
        assert frame.status != "refused", frame.reason
        if frame.clearance is not None:
            least, count = measure_exactly(frame, surface, motion, 4000, random)
            samples += count
            assert frame.clearance <= least
    assert samples >= 40_000
    # and planned again as a whole, from the introducer
    moving, last = MovingField(field, surface), motion.at(0.0)
    for number in range(1, 6):
        now = motion.at(number * motion.period / 6)
        path = carry_tissue(plan.path, last, now=now)
        bounds = {"gradient_bound": now.gradient_bound, "second_bound": now.second_bound}
        lumen = moving.update(now, path=path, radius=scope.radius, **bounds)
        begin, last = last, now
        plan = replan(
            plan, lumen, advect=lambda points, a=begin, b=now: carry_tissue(points, a, now=b)
        )
        assert plan.status == "complete", plan.reason
        wall = MeshWall(surface.vertices + now(surface.vertices), surface.faces)
        points = sample_body(plan.joints, 6000, random)[0]
        points = points[outside_introducer(points, plan.introducer, scope.radius)]
        assert plan.certificate.clearance <= wall.clearance(points).min() - scope.radius
        # A field built anew proves as much, or more: the band's nodes are no larger.
        if number in (2, 5):
            moved = replace(surface, vertices=surface.vertices + now(surface.vertices))
            anew = certify_plan(plan, build_field(moved, voxel=1.0))
            assert anew.clearance == pytest.approx(plan.certificate.clearance, abs=0.3)

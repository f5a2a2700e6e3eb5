"""Motions of tissue keep the bounds that they state, repeat, and are read from files."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.anatomy import Breathing, Peristalsis, RecordedMotion
from bozzini.errors import FileFormatError, InputError

LINE = np.stack([20.0 * np.sin(np.linspace(0, 3, 60)), np.zeros(60), np.linspace(0, 90, 60)], 1)
PROBE = 1e-3


def record(frames=6, steepness=0.1, shape=(9, 8, 10)):
    """Displacements of a smooth wave that comes and goes, on a coarse grid."""
    origin, spacing = np.array([-40.0, -30.0, -10.0]), np.array([10.0, 9.0, 12.0])
    nodes = origin + np.stack(np.indices(shape), -1) * spacing
    wave = np.array([0.03, -0.02, 0.04])
    height = steepness / np.linalg.norm(wave) * np.cos(nodes @ wave)
    grid = height[..., None] * np.array([0.6, 0.0, 0.8])
    times = np.linspace(0.0, 3.0, frames)
    strength = np.sin(np.pi * times / 3.0) ** 2
    return RecordedMotion(
        displacement=strength[:, None, None, None, None] * grid,
        times=times,
        origin=origin,
        spacing=spacing,
    )


MOTIONS = {
    "breathing": Breathing(amplitude=9.0, wavelength=150.0, direction=(1.0, 1.0, 0.0)),
    "peristalsis": Peristalsis(line=LINE, depth=0.5, width=9.0, wave_speed=5.0),
    "recorded": record(),
}


@pytest.fixture(params=list(MOTIONS))
def motion(request):
    return MOTIONS[request.param]


def draw_places(count, seed=0):
    return np.random.default_rng(seed).uniform(
        [-50.0, -40.0, -20.0], [50.0, 50.0, 110.0], (count, 3)
    )


@pytest.mark.parametrize("share", [0.13, 0.4, 0.77])
def test_the_derivatives_keep_their_bounds(motion, share):
    frame = motion.at(share * motion.period)
    places = np.concatenate([draw_places(4000), LINE, LINE + 0.7])
    steps = PROBE * np.eye(3)
    gradient = np.stack([frame(places + s) - frame(places - s) for s in steps], -1) / (2.0 * PROBE)
    largest = np.linalg.svd(gradient, compute_uv=False)[:, 0].max()
    assert largest <= frame.gradient_bound + 1e-6
    assert largest > 0.2 * frame.gradient_bound  # and they are no more than some times too large
    way = np.random.default_rng(1).normal(size=places.shape)
    way *= 0.1 / np.linalg.norm(way, axis=1, keepdims=True)
    turn = frame(places + way) - 2.0 * frame(places) + frame(places - way)
    second = np.linalg.norm(turn, axis=1).max() / 0.01
    assert second <= frame.second_bound + 1e-6
    assert second > 0.1 * frame.second_bound


def test_no_tissue_is_faster_than_stated(motion):
    places = np.concatenate([draw_places(1000), LINE + [3.0, 1.0, 0.0]])
    times = np.linspace(0.0, motion.period, 200)
    moves = np.stack([motion.at(t)(places) for t in times])
    speed = np.linalg.norm(np.diff(moves, axis=0), axis=2).max() / np.diff(times)[0]
    assert 0.2 * motion.speed < speed <= motion.speed * (1.0 + 1e-9)


def test_it_repeats_and_nothing_jumps_where_it_begins_anew(motion):
    places = draw_places(50)
    for share in (0.0, 0.31, 0.8):
        time = share * motion.period
        moved = motion.at(time)(places)
        assert motion.at(time + motion.period)(places) == pytest.approx(moved, abs=1e-6)
    step = 1e-6 * motion.period
    jump = motion.at(0.0)(places) - motion.at(motion.period - step)(places)
    assert np.abs(jump).max() <= motion.speed * step


def test_a_cycle_that_is_nearly_closed_is_closed():
    recorded = MOTIONS["recorded"]
    open_ = recorded.displacement.copy()
    open_[-1] += 0.008
    closed = RecordedMotion(
        displacement=open_,
        times=recorded.times,
        origin=recorded.origin,
        spacing=recorded.spacing,
    )
    test_no_tissue_is_faster_than_stated(closed)
    test_it_repeats_and_nothing_jumps_where_it_begins_anew(closed)
    assert np.array_equal(closed.displacement[-1], closed.displacement[0])


def test_a_breath_begins_at_rest_and_is_deepest_halfway():
    breath = MOTIONS["breathing"]
    places = draw_places(400)
    assert np.all(breath.at(0.0)(places) == 0.0)
    size = [np.abs(breath.at(t)(places)).max() for t in np.linspace(0.0, breath.period, 41)]
    assert np.argmax(size) == 20
    deepest = np.linalg.norm(breath.at(0.5 * breath.period)(places), axis=1).max()
    assert deepest == pytest.approx(breath.amplitude, rel=0.01)


def test_a_ring_closes_the_share_it_states():
    ring = MOTIONS["peristalsis"]
    for share in (0.3, 0.5):
        frame = ring.at(share * ring.period)
        # Of places near the line the one whose neighbourhood shrinks most: there by the depth.
        steps = PROBE * np.eye(3)
        fine = np.stack([np.interp(np.linspace(0, 59, 2000), np.arange(60), c) for c in LINE.T], 1)
        gradient = np.stack([frame(fine + s) - frame(fine - s) for s in steps], -1) / (2 * PROBE)
        most = -np.linalg.eigvalsh(0.5 * (gradient + gradient.swapaxes(1, 2)))[:, 0].min()
        assert most == pytest.approx(ring.depth, rel=0.03)


def test_a_recorded_motion_passes_through_its_nodes():
    recorded = MOTIONS["recorded"]
    shape = recorded.displacement.shape[1:4]
    nodes = recorded.origin + np.stack(np.indices(shape), -1) * recorded.spacing
    inner = (slice(2, -2),) * 3
    for k in (1, 3):
        found = recorded.at(recorded.times[k])(nodes[inner].reshape(-1, 3))
        wanted = recorded.displacement[k][inner].reshape(-1, 3)
        assert found == pytest.approx(wanted, abs=1e-6)
    # Beyond the grid the displacement at its border holds.
    corner = recorded.origin - [500.0, 500.0, 500.0]
    farther = corner - 100.0
    now = recorded.at(1.0)
    assert now(corner[None]) == pytest.approx(now(farther[None]), abs=1e-12)


def test_a_recorded_motion_is_read_from_a_file(tmp_path):
    recorded = MOTIONS["recorded"]
    given = {
        name: getattr(recorded, name) for name in ("displacement", "times", "origin", "spacing")
    }
    path = tmp_path / "motion.npz"
    np.savez(path, **given)
    places = draw_places(20)
    read = RecordedMotion.load(path)
    assert read.at(0.7)(places) == pytest.approx(recorded.at(0.7)(places))
    assert read.speed == recorded.speed
    for changed, message in (
        ({"times": given["times"] + 1.0}, "must rise from 0 s"),
        ({"times": np.append(given["times"][:-1], np.inf)}, "must rise from 0 s"),
        ({"times": given["times"][:-1]}, "times has shape"),
        ({"displacement": 1e3 * given["displacement"]}, "per mm.* all in mm"),
        ({"spacing": np.zeros(3)}, "spacing is"),
        ({"displacement": given["displacement"][..., :2]}, "displacement has shape"),
        ({"displacement": np.nan * given["displacement"]}, "finite"),
        ({"displacement": np.cumsum(1.0 + given["displacement"], axis=0)}, "must agree"),
    ):
        np.savez(path, **{**given, **changed})
        with pytest.raises(FileFormatError, match=message):
            RecordedMotion.load(path)
    path.write_bytes(b"no archive")
    with pytest.raises(FileFormatError, match="no motion of tissue"):
        RecordedMotion.load(path)
    with pytest.raises(FileFormatError, match="no such file"):
        RecordedMotion.load(tmp_path / "none.npz")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Breathing(amplitude=6.0, wavelength=30.0), "must be below 4.77 mm"),
        (lambda: Breathing(amplitude=-1.0), "amplitude is -1 mm"),
        (lambda: Breathing(direction=(0.0, 0.0, 0.0)), "must be a direction"),
        (lambda: Peristalsis(line=LINE, depth=1.0), "depth is 1"),
        (lambda: Peristalsis(line=LINE[:1]), "line has shape"),
    ],
)
def test_a_wrong_number_is_one_line(make, message):
    with pytest.raises(InputError, match=message):
        make()

"""Records of loops: their samples along the way, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.errors import InputError
from bozzini.muscle.loops import LoopRecord, read_loop

TIME = np.linspace(0.0, 10.0, 1001)
PRESSURE = 0.35 * (1.0 - np.cos(2.0 * np.pi * TIME / 5.0))


def record(**changes):
    given = {"time": TIME, "pressure": PRESSURE, "response": 20.0 * PRESSURE}
    return LoopRecord(**(given | changes))


def test_samples_are_means_of_all_rows_in_order():
    samples = record().resample(100)
    assert 80 < len(samples) < 130
    assert np.all(np.diff(samples.time) > 0.0)
    assert samples.response == pytest.approx(20.0 * samples.pressure, abs=1e-12)
    assert np.ptp(samples.pressure) == pytest.approx(0.7, abs=0.02)
    # as many as there are: the record itself
    whole = record().resample(100_000)
    assert whole.pressure == pytest.approx(PRESSURE) and len(whole) == len(TIME)


def test_samples_do_not_depend_on_the_timing_and_rests_do_not_count_more():
    """Half of the samples are in one rest; a fifth of those kept may be."""
    stands = np.interp(TIME, [0.0, 2.0, 7.0, 10.0], [0.0, 0.6, 0.6, 0.0])
    samples = record(pressure=stands, response=stands).resample(200)
    resting = samples.direction == 0.0
    assert 0.05 < resting.mean() < 0.25
    assert np.all(samples.pressure[resting][1:] > 0.59)  # the first sample has no way before it
    assert set(samples.direction.tolist()) == {-1.0, 0.0, 1.0}
    steps = np.diff(samples.pressure[samples.direction > 0.0])[1:-2]
    assert steps == pytest.approx(steps.mean(), rel=0.2)


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_noise_makes_no_turning_points(noise):
    random = np.random.default_rng(5)
    samples = record(pressure=PRESSURE + noise * random.normal(size=len(TIME)) + 0.01).resample(300)
    ways = samples.direction[samples.direction != 0.0]
    assert np.count_nonzero(np.diff(ways)) == 3


def test_what_was_changed_is_said_and_rest_is_seen():
    low = record(pressure=PRESSURE - 0.005)
    assert low.pressure.min() == 0.0 and "are taken as 0" in low.notes[0]
    assert low.starts_at_rest and not record(pressure=PRESSURE + 0.1).starts_at_rest


def write(path, columns, names):
    lines = [",".join(names)]
    lines += [",".join(f"{x:.6g}" for x in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_files_have_units_and_the_response_is_what_changes(tmp_path):
    path = write(
        tmp_path / "a.csv",
        (TIME * 1e3, PRESSURE * 1e3, 60.0 - 20.0 * PRESSURE, np.full(len(TIME), 0.5)),
        ("time [ms]", "pressure [kPa]", "length [mm]", "load [kg]"),
    )
    found = read_loop(path)
    assert (found.kind, found.unit, found.longest) == ("contraction", "mm", 60.0)
    assert found.held == pytest.approx(0.5 * 9.80665)
    assert found.time == pytest.approx(TIME, abs=1e-5)
    assert found.response == pytest.approx(20.0 * PRESSURE, abs=1e-3)
    force = write(
        tmp_path / "b.csv",
        (TIME, PRESSURE, 100.0 * PRESSURE, np.full(len(TIME), 2.0)),
        ("time_s", "pressure_MPa", "force_N", "contraction_mm"),
    )
    assert (read_loop(force).kind, read_loop(force).held) == ("force", 2.0)
    assert read_loop(force, kind="contraction", held=3.0).held == 3.0
    assert read_loop(force).plot().get_ylabel() == "force [N]"


REFUSALS = [
    ({"time": TIME[:1], "pressure": PRESSURE[:1], "response": PRESSURE[:1]}, "1 sample(s)"),
    ({"pressure": np.full(len(TIME), 0.3)}, "pressure is 0.3 MPa all along: it must change"),
    ({"time": TIME[::-1]}, "time[1] is 9.99 s after 10 s: it must increase"),
    ({"response": np.where(TIME == 5.0, np.nan, 1.0)}, "response[500] is nan"),
    ({"pressure": PRESSURE - 0.1}, "pressure[0] is -0.1 MPa: it must lie in"),
    ({"pressure": 1e3 * PRESSURE}, "it must lie in"),
    ({"response": PRESSURE[1:]}, "response has shape (1000,)"),
    ({"kind": "stiffness"}, "kind is 'stiffness': it must be one of contraction, force"),
]


@pytest.mark.parametrize(("changes", "words"), REFUSALS)
def test_refused(changes, words):
    with pytest.raises(InputError) as caught:
        record(**changes)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_samples_refused():
    with pytest.raises(InputError, match="samples is 5: it must lie in"):
        record().resample(5)

"""Board and plant in lock-step, with a board in Python: order, determinism, record."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.errors import InputError
from bozzini.muscle import EnergyMuscle, preset
from bozzini.rig import Chamber, Cosimulation, Plant
from tests.rig.boards import PiBoard

CHAMBER = Chamber.from_model(EnergyMuscle(preset("fitted-45")))
TARGETS = np.array([0.6, 0.3, 0.1])


def send_targets(_, __):
    return TARGETS.tobytes()


def make(seed=0, **more):
    return Cosimulation(PiBoard(), Plant(CHAMBER, seed=seed), host=send_targets, **more)


def test_loop_reaches_its_set_points() -> None:
    record = make().run(0.6)
    assert record.pressures[-1] == pytest.approx(TARGETS, abs=5e-3)
    assert record.time == pytest.approx(np.arange(1, 601) * 1e-3)
    assert not np.any((record.duty[:, :3] > 0.0) & (record.duty[:, 3:6] > 0.0))
    assert record.contractions[-1, 0] > record.contractions[-1, 1] > 0.0


def test_same_seed_gives_the_same_numbers_even_interleaved() -> None:
    alone = make(seed=4).run(0.2).to_frame()
    first, second, other = make(seed=4), make(seed=4), make(seed=5)
    pieces = [[], [], []]
    for _ in range(4):
        for piece, loop in zip(pieces, (first, second, other), strict=True):
            piece.append(loop.run(0.05).to_frame().to_numpy())
    joined = [np.concatenate(piece) for piece in pieces]
    assert np.array_equal(joined[0], alone.to_numpy())
    assert np.array_equal(joined[1], alone.to_numpy())
    assert not np.array_equal(joined[2], alone.to_numpy())


def test_board_sees_the_voltages_from_before_the_period() -> None:
    class Watcher(PiBoard):
        def __init__(self):
            super().__init__()
            self.seen = []

        def set_voltages(self, voltages):
            self.seen.append(np.array(voltages))
            super().set_voltages(voltages)

    board, plant = Watcher(), Plant(CHAMBER)
    first = plant.sensor_voltages()
    record = Cosimulation(board, plant, host=send_targets).run(0.05)
    assert np.array_equal(board.seen[0], first)
    assert np.array_equal(np.array(board.seen), record.voltages)
    assert not np.array_equal(plant.sensor_voltages(), record.voltages[-1])


def test_host_gets_what_the_board_sent_and_the_time() -> None:
    heard = []

    def host(time, data):
        heard.append((time, len(data)))
        return b"" if time > 0.0 else TARGETS.tobytes()

    Cosimulation(PiBoard(), Plant(CHAMBER), host=host).run(0.005)
    assert [time for time, _ in heard] == pytest.approx([0.0, 0.001, 0.002, 0.003, 0.004])
    assert [size for _, size in heard] == [0, 24, 24, 24, 24]


def test_record_is_a_table_and_a_picture() -> None:
    record = make().run(0.02)
    frame = record.to_frame()
    assert len(frame) == 20
    assert np.array_equal(frame["pressure_2_MPa"], record.pressures[:, 1])
    assert np.array_equal(frame["bleed_3"], record.duty[:, 5])
    assert len(record.plot().lines) == 3


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: make(period=1.0), "period is 1"),
        (lambda: make().run(0.0), "duration is 0"),
        (lambda: make().run(0.00155), "multiple"),
    ],
)
def test_wrong_input_is_one_line(call, words) -> None:
    with pytest.raises(InputError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)

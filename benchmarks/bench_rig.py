"""The boards that run the firmware, and the plant: simulated seconds a second of computing."""

from __future__ import annotations

import pytest

from bozzini.muscle import EnergyMuscle, preset
from bozzini.rig import EmulatedBoard, NativeBoard, Plant
from bozzini.rig.firmware import find_missing_tools
from bozzini.rig.protocol import Arm, SetPoint

SPAN = 1.0
"""Simulated time of a round [s]."""


@pytest.mark.skipif(
    bool(find_missing_tools()), reason=f"missing: {', '.join(find_missing_tools())}"
)
@pytest.mark.parametrize("kind", [NativeBoard, EmulatedBoard])
def test_armed_board_with_setpoints_at_100_hz(benchmark, kind):
    with kind() as board:
        board.run(0.03)
        board.write(SetPoint((0.3, 0.2, 0.1)).encode(0) + Arm().encode(1))

        def run():
            for k in range(round(SPAN / 0.01)):
                board.write(SetPoint((0.3, 0.2, 0.1)).encode(k))
                for _ in range(10):
                    board.run(1e-3)
            return board.read()

        assert benchmark(run)
    benchmark.extra_info["times_real_time"] = SPAN / benchmark.stats.stats.min


def test_plant_of_three_muscles_in_steps_of_1_ms(benchmark):
    plant = Plant(EnergyMuscle(preset("fitted-45")))

    def run():
        for _ in range(1000):
            plant.step([0.5] * 6, 1e-3)
            voltages = plant.sensor_voltages()
        return voltages

    assert benchmark(run).max() < 5.0
    benchmark.extra_info["times_real_time"] = SPAN / benchmark.stats.stats.min

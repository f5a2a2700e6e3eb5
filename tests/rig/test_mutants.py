"""Each safety function is taken out of a copy of the sources once: its test must then fail."""

from __future__ import annotations

import pytest

from bozzini.rig.board import NativeBoard
from bozzini.rig.emulator import EmulatedBoard
from tests.rig import test_protocol, test_safety
from tests.rig.test_firmware import copy_sources, patch

MUTANTS = {
    "no silence check": (
        "src/safety.c",
        "safety->state == BZ_STATE_ARMED && safety->silence >= BZ_SILENCE_TICKS",
        "0",
        test_safety.test_host_silence_vents,
    ),
    "refused set-points count as alive": (
        "src/safety.c",
        "if (values[i] > BZ_SETPOINT_MAX) return BZ_BAD_VALUE;",
        "if (values[i] > BZ_SETPOINT_MAX) { safety->silence = 0; return BZ_BAD_VALUE; }",
        test_safety.test_setpoints_out_of_range_are_no_sign_of_life,
    ),
    "no over-pressure check": (
        "src/safety.c",
        "trip(safety, BZ_FAULT_OVERPRESSURE);",
        "(void)0;",
        test_safety.test_overpressure_vents,
    ),
    "no sensor check": (
        "src/safety.c",
        "trip(safety, BZ_FAULT_SENSOR);",
        "(void)0;",
        lambda board: test_safety.test_sensor_open_or_short_vents(board, 1, 0.0),
    ),
    "no tracking check": (
        "src/safety.c",
        "trip(safety, BZ_FAULT_TRACKING);",
        "(void)0;",
        test_safety.test_pressure_that_stays_off_its_reference_trips,
    ),
    "no scan check": (
        "src/safety.c",
        "trip(safety, BZ_FAULT_SCAN);",
        "(void)0;",
        test_safety.test_lost_measurement_vents_before_the_watchdog,
    ),
    "no slew limit": (
        "src/config.h",
        "#define BZ_SLEW 30 ",
        "#define BZ_SLEW 9000 ",
        test_safety.test_reference_follows_no_faster_than_the_slew_limit,
    ),
    "clear at any time": (
        "src/safety.c",
        "safety->scans < BZ_BOOT_TICKS || is_present(safety)",
        "0",
        test_safety.test_clear_is_refused_while_the_cause_is_present,
    ),
    "arm without set-points": (
        "src/safety.c",
        "if (safety->silence >= BZ_SILENCE_TICKS) return BZ_NO_SETPOINT;",
        "",
        test_safety.test_arming_needs_fresh_setpoints_and_empty_muscles,
    ),
    "supply stays on": (
        "src/safety.c",
        "    safety->supply = 0;\n",
        "",
        test_safety.test_muscles_are_vented_and_the_supply_is_shut_until_armed,
    ),
    "watchdog reset is no fault": (
        "src/safety.c",
        "if (was_watchdog) trip(safety, BZ_FAULT_WATCHDOG);",
        "(void)was_watchdog;",
        test_safety.test_program_that_hangs_is_reset_into_a_latched_fault,
    ),
    "both valves open": (
        "src/control.c",
        "muscle->fill = command > 0 ?",
        "muscle->fill = command ?",
        test_safety.test_fill_and_bleed_are_never_both_open,
    ),
    "measurement begins before the last is taken": (
        "src/main.c",
        "chain < CHAIN || is_measured",
        "chain < CHAIN",
        test_safety.test_measurements_stay_whole_when_frames_leave_no_time_for_them,
    ),
    "watchdog fed on every wake": (
        "src/main.c",
        "        sleep_until_interrupt(handled);\n",
        "        sleep_until_interrupt(handled);\n        wdt_reset();\n",
        test_safety.test_lost_tick_is_reset_into_a_latched_fault,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTANTS)
def test_mutant_is_killed(toolchain, tmp_path, name):
    file, old, new, check = MUTANTS[name]
    kind = EmulatedBoard if file == "src/main.c" else NativeBoard
    with kind(is_test_build=True) as board:
        check(board)
    sources = copy_sources(tmp_path / "firmware")
    patch(sources, file, old, new)
    with kind(is_test_build=True, sources=sources) as board, pytest.raises(AssertionError):
        check(board)


@pytest.mark.slow
def test_mutant_without_crc_is_killed(toolchain, tmp_path):
    sources = copy_sources(tmp_path / "firmware")
    patch(
        sources,
        "src/protocol.c",
        "if (bz_crc16(reader->bytes, length) == bz_get_u16(reader->bytes + length)) return length;",
        "return length;",
    )
    codec = test_protocol.Codec(sources)
    with pytest.raises(AssertionError):
        test_protocol.test_no_damaged_frame_is_obeyed(codec, 10_000)

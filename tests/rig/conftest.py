"""The tools that build and emulate the firmware, and a board in the state that a test needs."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from bozzini.rig.board import CompiledBoard, NativeBoard
from bozzini.rig.emulator import EmulatedBoard
from bozzini.rig.firmware import find_missing_tools


@pytest.fixture(scope="session")
def toolchain() -> None:
    """Skip where the firmware cannot be built; in continuous integration that is a failure."""
    missing = find_missing_tools()
    if missing:
        reason = f"no {', '.join(missing)}: apt-get install {' '.join(missing.values())}"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(reason)


BOARDS = {"native": NativeBoard, "emulated": EmulatedBoard}


@pytest.fixture(params=BOARDS)
def board(toolchain: None, request: pytest.FixtureRequest) -> Iterator[CompiledBoard]:
    """Give a board just switched on: once compiled for this computer, once emulated.

    It obeys the frames that stop it.
    """
    with BOARDS[request.param](is_test_build=True) as new:
        yield new


@pytest.fixture(params=BOARDS)
def ordinary_board(toolchain: None, request: pytest.FixtureRequest) -> Iterator[CompiledBoard]:
    """Give a board as it is flashed."""
    with BOARDS[request.param]() as new:
        yield new

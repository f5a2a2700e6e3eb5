"""An emulated rig: a board with a plant, in lock-step or behind a pseudo-terminal."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Literal, get_args

from ..effector.motion import EffectorMotion
from ..errors import InputError
from ..muscle.model import MuscleModel
from .board import NativeBoard
from .cosimulation import Cosimulation
from .emulator import EmulatedBoard
from .hysteresis import HystereticPlant
from .plant import Chamber, Plant, PlantDesign

BoardKind = Literal["emulated", "native"]
BOARD_KINDS: tuple[BoardKind, ...] = get_args(BoardKind)

SLICE = 2e-3
"""Time that an emulated rig advances at once in real time [s]."""
LARGEST_BACKLOG = 0.05
"""A rig that is behind its clock by more than this [s] lets the rest of it go: half of the host's
silence that trips, so that a computer that stalls as a whole is none."""


def emulate_rig(
    muscles: Sequence[MuscleModel | Chamber] | MuscleModel | Chamber,
    design: PlantDesign | None = None,
    *,
    board: BoardKind = "emulated",
    seed: int = 0,
    motion: EffectorMotion | None = None,
) -> Cosimulation:
    """Return a board with a plant, in lock-step.

    Parameters
    ----------
    muscles : MuscleModel or Chamber, or sequence of three
        The muscles, such as the `models` of an effector.
    design : PlantDesign, optional
        Constants of the plant.
    board : {"emulated", "native"}
        The chip of the board, cycle by cycle, or its code compiled for this computer.
    seed : int
        Of the transducers' noise.
    motion : EffectorMotion, optional
        Plays and creep of the muscles, such as the `motion` of an effector.

    Raises
    ------
    InputError
        If a value is not legal.
    ToolchainError
        If the firmware cannot be built.
    """
    if board not in BOARD_KINDS:
        raise InputError(f"board is {board!r}: it must be one of {', '.join(BOARD_KINDS)}")
    if motion is None or (motion.operator is None and motion.creep_share == 0.0):
        plant = Plant(muscles, design, seed=seed)
    else:
        plant = HystereticPlant(muscles, motion, design, seed=seed)
    return Cosimulation(EmulatedBoard() if board == "emulated" else NativeBoard(), plant)


def serve(
    rig: Cosimulation, announce: Callable[[str], None], *, stop: threading.Event | None = None
) -> None:
    """Run a rig in real time behind a pseudo-terminal, until it is stopped.

    Parameters
    ----------
    rig : Cosimulation
        The board and the plant.
    announce : callable
        Is given the path of the pseudo-terminal.
    stop : threading.Event, optional
        Ends it.

    Raises
    ------
    InputError
        If the system has no pseudo-terminals.
    """
    try:
        import pty
        import tty
    except ImportError:
        raise InputError(f"system is {sys.platform}: it has no pseudo-terminals") from None
    master, port = pty.openpty()
    try:
        tty.setraw(port)
        os.set_blocking(master, False)
        announce(os.ttyname(port))
        begin = time.monotonic() - rig.plant.time
        while stop is None or not stop.is_set():
            with suppress(BlockingIOError):
                rig.board.write(os.read(master, 65536))
            rig.run(SLICE)
            with suppress(BlockingIOError):  # nobody reads: the bytes are lost, as on a line
                os.write(master, rig.board.read())
            ahead = begin + rig.plant.time - time.monotonic()
            if ahead > 0.0:
                time.sleep(ahead)
            elif ahead < -LARGEST_BACKLOG:
                begin -= ahead
    finally:
        os.close(master)
        os.close(port)


@contextmanager
def emulated_port(*options: str) -> Iterator[str]:
    """Run an emulated rig in real time in a process of its own; give the path of its port.

    Parameters
    ----------
    *options : str
        Options of ``bozzini rig emulate``.

    Raises
    ------
    InputError
        If the emulated rig does not start; its message is passed on.
    """
    command = [sys.executable, "-m", "bozzini", "rig", "emulate", *options]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as rig:
        try:
            line = rig.stdout.readline() if rig.stdout else ""
            if not line:
                words = rig.stderr.read().strip() if rig.stderr else ""
                raise InputError(f"the emulated rig did not start: {words}")
            yield line.strip()
        finally:
            rig.terminate()

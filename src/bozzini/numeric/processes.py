"""Work in several processes at once."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

from ..errors import BozziniError


@contextmanager
def open_processes(count: int, caller: str) -> Iterator[Executor]:
    """Yield an executor whose processes end with the block, at once where it is interrupted.

    Parameters
    ----------
    count : int
        How many processes.
    caller : str
        The public function that opens them, for messages.

    Raises
    ------
    BozziniError
        If a process ended.
    """
    pool = ProcessPoolExecutor(
        count,
        # A forked process would inherit the locks of the threads of compiled loops.
        mp_context=multiprocessing.get_context("spawn"),
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_IGN),  # this process ends them
    )
    try:
        yield pool
    except BrokenProcessPool:
        raise BozziniError(
            f"a process of {caller} ended: it was out of memory, what it computed ended it, or a "
            f"script calls {caller} outside of \"if __name__ == '__main__':\"; with 1 job there "
            "are no processes"
        ) from None
    except BaseException:  # an interrupt must not wait for the work that is left
        for process in pool._processes.values():
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)

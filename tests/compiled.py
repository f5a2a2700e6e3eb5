"""Which kernels Bozzini calls from Python, with what types: `doctor --compile` has to know all.

``python -m tests.compiled FOLDER`` lists those that test runs recorded in a folder.
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from numba.core.dispatcher import Dispatcher

from bozzini.numeric.signatures import name_kernel, write_signatures, write_type

Signatures = dict[str, set[str]]


@contextmanager
def recording(*, only_compiled: bool = False) -> Iterator[Signatures]:
    """Give the signatures of kernels, filled while Bozzini's own code calls them.

    Or only those that were compiled for it, and not loaded.
    """
    found: Signatures = defaultdict(set)
    load: Any = Dispatcher._compile_for_args

    def load_and_record(kernel: Any, *args: Any, **options: Any) -> Any:
        caller = sys._getframe(1).f_globals.get("__name__", "")
        before, compiled = set(kernel.overloads), sum(kernel.stats.cache_misses.values())
        answer = load(kernel, *args, **options)
        if only_compiled and sum(kernel.stats.cache_misses.values()) == compiled:
            return answer
        if caller.startswith("bozzini.") and kernel.py_func.__module__.startswith("bozzini."):
            for kinds in set(kernel.overloads) - before:
                with suppress(ValueError):  # ducts of the tests' own
                    listed = "".join(f"{write_type(kind)}, " for kind in kinds)
                    found[name_kernel(kernel)].add(f"({listed})")
        return answer

    Dispatcher._compile_for_args = load_and_record
    try:
        yield found
    finally:
        Dispatcher._compile_for_args = load


if __name__ == "__main__":
    union: Signatures = defaultdict(set)
    for path in Path(sys.argv[1]).glob("*.json"):
        for kernel_name, signatures in json.loads(path.read_text(encoding="utf-8")).items():
            union[kernel_name] |= set(signatures)
    write_signatures(union)

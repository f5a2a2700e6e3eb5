"""Which arguments the kernels take, so that all of them can be compiled before they are needed.

``signatures.json`` beside this file has, by kernel, the types it is called with from Python, as
Numba writes them; `make kernels` records it anew from the tests, which find what it lacks.
"""

from __future__ import annotations

import importlib
import json
import multiprocessing
import os
import signal
from collections.abc import Iterable, Mapping
from pathlib import Path

from numba import types
from numba.core.dispatcher import Dispatcher

from ..progress import Progress, announce, announce_by, no_progress
from .compiling import COMPILING

RECORD = Path(__file__).with_name("signatures.json")
PACKED = "bozzini.duct.packed"
"""Where the named tuples are that kernels take."""


def write_type(kind: types.Type) -> str:
    """Return the expression that makes a type of Numba.

    Raises
    ------
    ValueError
        If it is of a kind that no kernel of Bozzini takes.
    """
    if isinstance(kind, types.Array):
        if kind.mutable and kind.aligned and kind.layout in "CFA":
            axes = [":"] * kind.ndim
            if kind.layout != "A":
                axes[-1 if kind.layout == "C" else 0] = "::1"
            return f"{kind.dtype}[{', '.join(axes)}]"
        return (
            f"Array({write_type(kind.dtype)}, {kind.ndim}, {kind.layout!r}, "
            f"readonly={not kind.mutable}, aligned={kind.aligned})"
        )
    if isinstance(kind, types.BaseTuple):
        members = "".join(f"{write_type(member)}, " for member in kind.types)  # type: ignore[attr-defined]
        named = getattr(kind, "instance_class", None)
        if named is None:
            return f"Tuple(({members}))"
        if named.__module__ != PACKED:
            raise ValueError(f"{named} is not of {PACKED}")
        return f"NamedTuple(({members}), {named.__name__})"
    if isinstance(kind, types.NumPyRandomGeneratorType):
        return "npy_rng"
    if isinstance(kind, (types.Number, types.Boolean)):
        return str(kind)
    raise ValueError(f"{kind} is taken by no kernel")


def read_signature(text: str) -> tuple[types.Type, ...]:
    """Return the types that a tuple of expressions of `write_type` makes."""
    names = {**vars(importlib.import_module(PACKED)), **vars(types), "bool": types.boolean}
    kinds: tuple[types.Type, ...] = eval(text, {"__builtins__": {}}, names)  # our own file
    return kinds


def find_kernel(name: str) -> Dispatcher:
    """Return a kernel by its module within Bozzini and its name, such as ``duct.kernels.fit.x``."""
    module, _, own = name.rpartition(".")
    found: Dispatcher = getattr(importlib.import_module(f"bozzini.{module}"), own)
    return found


def name_kernel(kernel: Dispatcher) -> str:
    """Return the name by which `find_kernel` finds a kernel."""
    module: str = kernel.py_func.__module__
    return f"{module.removeprefix('bozzini.')}.{kernel.py_func.__name__}"


def read_signatures() -> dict[str, list[str]]:
    """Return the recorded signatures, each a tuple of types, by kernel."""
    found: dict[str, list[str]] = json.loads(RECORD.read_text(encoding="utf-8"))
    return found


def write_signatures(found: Mapping[str, Iterable[str]]) -> None:
    """Record signatures by kernel."""
    rows = {name: sorted(set(found[name])) for name in sorted(found)}
    RECORD.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


def compile_kernels(*, progress: Progress = no_progress) -> None:
    """Compile all kernels that are not yet compiled here, on all cores.

    One process takes a module at a time, for its kernels call each other.
    """
    modules: dict[str, list[tuple[str, list[str]]]] = {}
    for name, signatures in read_signatures().items():
        modules.setdefault(name.rpartition(".")[0], []).append((name, signatures))
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    done, total = 0, sum(map(len, modules.values()))
    # A forked process would inherit the locks of threads. Leaving the block ends the processes.
    with multiprocessing.get_context("spawn").Pool(cores, _leave_interrupts) as pool:
        ordered = sorted(modules.values(), key=len, reverse=True)
        for count, said in pool.imap_unordered(_compile_module, ordered):
            for text in said:
                announce(text)
            done += count
            progress("compiling", done / total)


def _leave_interrupts() -> None:
    """Let the process that began the work decide what an interrupt does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _compile_module(kernels: list[tuple[str, list[str]]]) -> tuple[int, list[str]]:
    """Return how many kernels were compiled, and what was told of that."""
    said: list[str] = []
    announce_by(said.append)
    for name, signatures in kernels:
        kernel = find_kernel(name)
        for signature in signatures:
            kernel.compile(read_signature(signature))
    return len(kernels), [text for text in said if text != COMPILING]

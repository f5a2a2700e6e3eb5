"""How kernels are compiled: once for each kind of arguments, and then kept on disk.

`kernel` is the decorator of all of them. While one is compiled the garbage collector stands still:
a compiler makes many objects that live long, and looking through them took a seventh of its time.
"""

from __future__ import annotations

import functools
import gc
import time
from collections.abc import Callable, Iterable, Mapping
from pickle import UnpicklingError
from typing import Any, Literal

from numba import njit, types
from numba.core import event
from numba.core.caching import IndexDataCacheFile

from ..progress import announce

COMPILING = "compiling (once)"

LONG = 2.0
"""Seconds of compiling from which on the user is told."""


def kernel(
    function: Callable[..., object] | None = None,
    *,
    error_model: Literal["python", "numpy"] = "python",
    inline: Literal["never", "always"] = "never",
    nogil: bool = False,
    parallel: bool = False,
) -> Any:
    """Compile a function on its first call; as a decorator, with these options of `numba.njit`."""
    if function is None:
        return functools.partial(
            kernel, error_model=error_model, inline=inline, nogil=nogil, parallel=parallel
        )
    compiled = njit(  # type: ignore[call-overload]  # its stub lacks the last option
        function,
        cache=True,
        error_model=error_model,
        inline=inline,
        nogil=nogil,
        parallel=parallel,
        no_cfunc_wrapper=True,  # a kernel is called from Python or from kernels, never from C
    )
    if not hasattr(compiled, "get_call_template"):
        return compiled  # it is the function itself, by NUMBA_DISABLE_JIT
    choose = compiled.get_call_template

    def choose_any_value(args: Iterable[types.Type], kws: Mapping[str, types.Type]) -> object:
        # Numba compiles anew for a number that stands in the call: 0 is another type than n.
        plain = {name: types.unliteral(kind) for name, kind in kws.items()}
        return choose([types.unliteral(kind) for kind in args], plain)

    compiled.get_call_template = choose_any_value
    return compiled


class _Watch(event.Listener):
    """Stops the garbage collector while something is compiled, and tells where it takes long."""

    def __init__(self) -> None:
        self.depth, self.spent, self.begin = 0, 0.0, 0.0
        self.collects = self.told = False

    def on_start(self, event: event.Event) -> None:
        if self.depth == 0:
            self.begin, self.collects = time.monotonic(), gc.isenabled()
            gc.disable()
        self.depth += 1

    def on_end(self, event: event.Event) -> None:
        self.depth -= 1
        now = time.monotonic()
        if not self.told and self.spent + now - self.begin > LONG:
            self.told = True
            announce(COMPILING)
        if self.depth == 0:
            self.spent += now - self.begin
            if self.collects:
                gc.enable()


event.register("numba:compile", _Watch())


def _forgive_files() -> None:
    """Let work go on where compiled code cannot be kept, or what was kept cannot be read.

    Numba's index of a function lists its signatures; one with a packed duct of a package that is
    gone could otherwise not be read, nor could any of ours beside it. It counts as empty then.
    """
    load: Callable[[IndexDataCacheFile], object] = IndexDataCacheFile._load_index
    save: Callable[..., None] = IndexDataCacheFile.save

    @functools.wraps(load)
    def load_index(self: IndexDataCacheFile) -> object:
        try:
            return load(self)
        except (ImportError, AttributeError, EOFError, UnpicklingError):
            return {}

    @functools.wraps(save)
    def save_if_possible(self: IndexDataCacheFile, *given: object) -> None:
        try:
            save(self, *given)
        except OSError as error:
            _tell_unsaved(error.strerror or str(error))

    IndexDataCacheFile._load_index = load_index  # type: ignore[method-assign]
    IndexDataCacheFile.save = save_if_possible  # type: ignore[method-assign]


@functools.cache
def _tell_unsaved(why: str) -> None:
    announce(f"compiled code cannot be kept: {why}; NUMBA_CACHE_DIR names another place")


_forgive_files()

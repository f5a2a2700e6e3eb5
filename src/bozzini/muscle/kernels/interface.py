"""How a muscle model brings compiled equations: three C functions, called by their addresses.

A model whose `MuscleModel.compiled` is not None runs compiled wherever muscles are solved in
batches, such as on an end-effector. Its three functions take the model's numbers as a pointer to
float64 and write to a pointer of three float64; each returns an int64::

    start(numbers, pressure, most, out)                      -> one of the codes below
        out: a state for `pull`; the largest contraction to look at, at most `most`; a first guess
    pull(numbers, state, pressure, contraction, out)         -> 0
        out: pull of the muscle [N], its slope in the contraction [N/mm]
    pressure(numbers, contraction, force, limit, out)        -> iterations
        out: the pressure, at most `limit`, at which it pulls `force` there [MPa]

`compile_start`, `compile_pull` and `compile_pressure` make them of plain Python functions of the
restricted kind that Numba compiles; `view_numbers` and `view_out` turn the pointers into arrays.
Any C function with such a signature will do as well.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import ModuleType
from typing import Any

from numba import carray, cfunc, types  # type: ignore[attr-defined]
from numba.extending import intrinsic

from ...numeric.compiling import kernel
from ..model import NUMBERS_LIMIT, CompiledMuscle

PULLS, SLACK, NO_ANSWER, RIGID = 0, 1, 2, 3
"""Codes of ``start``: it pulls; it is longer than the section; no answer; no response to a load.

A rigid muscle has its contraction as the state.
"""

_POINTER = types.CPointer(types.float64)
_START = types.int64(_POINTER, types.float64, types.float64, _POINTER)
_PULL = types.int64(_POINTER, types.float64, types.float64, types.float64, _POINTER)
_PRESSURE = _PULL


@kernel(inline="always")
def view_numbers(pointer):
    """The numbers of a model as an array."""
    return carray(pointer, (NUMBERS_LIMIT,))


@kernel(inline="always")
def view_out(pointer):
    """The results of a function as an array."""
    return carray(pointer, (3,))


@kernel
def unpack_design(numbers):
    """The first eleven numbers as a tuple, which is how the kernels of the models take a design."""
    return (
        numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5],
        numbers[6], numbers[7], numbers[8], numbers[9], numbers[10],
    )  # fmt: skip


@cache  # what is compiled must stay, for its address is in use
def _compile(function, signature):
    return cfunc(signature, cache=True)(function)


def compile_start(function: Callable[..., int]) -> int:
    """Return the address of a compiled ``start``."""
    return int(_compile(function, _START).address)


def compile_pull(function: Callable[..., int]) -> int:
    """Return the address of a compiled ``pull``."""
    return int(_compile(function, _PULL).address)


def compile_pressure(function: Callable[..., int]) -> int:
    """Return the address of a compiled ``pressure``."""
    return int(_compile(function, _PRESSURE).address)


def compile_model(kernels: ModuleType, numbers: tuple[float, ...]) -> CompiledMuscle:
    """Return a model from its numbers and a module with ``start``, ``pull`` and ``pressure``."""
    return CompiledMuscle(
        numbers=numbers,
        start=compile_start(kernels.start),
        pull=compile_pull(kernels.pull),
        pressure=compile_pressure(kernels.pressure),
    )


def _call(signature):
    """Return what calls a function of a signature by its address, pointers given as integers."""

    def generate(context, builder, types_, values):
        address, *given = values
        kinds = [context.get_value_type(kind) for kind in signature.args]
        given = [
            builder.inttoptr(value, kind) if wanted is _POINTER else value
            for value, kind, wanted in zip(given, kinds, signature.args, strict=True)
        ]
        from llvmlite import ir

        pointer = ir.FunctionType(ir.IntType(64), kinds).as_pointer()
        return builder.call(builder.inttoptr(address, pointer), given)

    taken = (types.intp if kind is _POINTER else kind for kind in signature.args)
    return types.int64(types.intp, *taken), generate


@intrinsic
def _call_start(typing_context, address, numbers, pressure, most, out):
    return _call(_START)


@intrinsic
def _call_pull(typing_context, address, numbers, state, pressure, contraction, out):
    return _call(_PULL)


@intrinsic
def _call_pressure(typing_context, address, numbers, contraction, force, limit, out):
    return _call(_PRESSURE)


call_start: Any = _call_start
"""Call a ``start``: its address, the addresses of numbers and results as integers."""
call_pull: Any = _call_pull
"""Call a ``pull``."""
call_pressure: Any = _call_pressure
"""Call a ``pressure``."""

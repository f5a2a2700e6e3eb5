"""A muscle model as a C function, a Python file that needs NumPy alone, or a lookup table.

The model's force law, which is written for NumPy's arrays, is run once on an array that keeps what
is done to it. What comes out is a list of steps, which is printed as C or as Python; the inverses
(contraction, pressure) are bracketed roots of that law. A law that branches on numbers, loops over
arrays or is compiled cannot be kept so: such a model gives a table only.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np

from .. import __version__
from ..checks import check_integer, check_kind, check_number
from ..errors import BozziniError, InputError
from ..io.files import write_text
from ..io.sheets import write_table
from ..numeric.arrays import Floats
from .compose import Bundle, find_limits
from .ends import MARGIN, EndEffects, MountedMuscle
from .model import DIRECTIONS, LOAD_LIMIT, MuscleModel, parse_direction
from .models.base import STEPS, ExplicitModel
from .terms import ScaledMuscle

SUFFIXES = (".c", ".py", ".csv", ".parquet")
"""What `export_muscle` writes, by the ending of the file."""

_INFIX = {
    "add": "+",
    "subtract": "-",
    "multiply": "*",
    "divide": "/",
    "greater": ">",
    "greater_equal": ">=",
    "less": "<",
    "less_equal": "<=",
    "equal": "==",
}
_CALLS = {
    "sqrt": "sqrt",
    "exp": "exp",
    "expm1": "expm1",
    "log": "log",
    "log1p": "log1p",
    "sin": "sin",
    "cos": "cos",
    "tan": "tan",
    "arcsin": "asin",
    "arccos": "acos",
    "arctan": "atan",
    "arctan2": "atan2",
    "sinh": "sinh",
    "cosh": "cosh",
    "tanh": "tanh",
    "hypot": "hypot",
    "power": "pow",
    "absolute": "fabs",
}
"""Functions of NumPy, and their names in C."""
_C_FORMS = {
    "negative": "-{0}",
    "positive": "{0}",
    "square": "{0} * {0}",
    "sign": "({0} > 0.0) - ({0} < 0.0)",
    "maximum": "isnan({1}) || {1} > {0} ? {1} : {0}",
    "minimum": "isnan({1}) || {1} < {0} ? {1} : {0}",
    "where": "{0} != 0.0 ? {1} : {2}",
}
_PY_FORMS = {"negative": "-{0}", "positive": "{0}"}


class _UntracedError(Exception):
    """Something was done to a `_Traced` that cannot be kept."""


@dataclass
class _Tape:
    """Steps in the order in which they were taken; equal ones are one."""

    steps: list[tuple[str, tuple[str, ...]]] = field(default_factory=list)
    known: dict[tuple[str, tuple[str, ...]], str] = field(default_factory=dict)

    def take(self, name: str, *arguments: object) -> _Traced:
        """Return the outcome of a step."""
        if name not in _INFIX and name not in _CALLS and name not in _C_FORMS:
            raise _UntracedError(f"numpy.{name}")
        step = (name, tuple(map(self.spell, arguments)))
        if step not in self.known:
            self.known[step] = f"t{len(self.steps)}"
            self.steps.append(step)
        return self.name(self.known[step])

    def name(self, word: str) -> _Traced:
        """Return a value that has a name."""
        traced = np.empty((), dtype=object).view(_Traced)
        traced.tape, traced.word = self, word
        return traced

    def spell(self, value: object) -> str:
        """Return the name of a value, or the digits of a number."""
        if isinstance(value, _Traced):
            if not value.word:
                raise _UntracedError("a view of an array")
            return value.word
        number = np.asarray(value)
        if number.ndim or number.dtype.kind not in "fiub":
            raise _UntracedError("an array within the law")
        return f"({float(number)!r})" if float(number) < 0.0 else repr(float(number))


class _Traced(np.ndarray[tuple[int, ...], np.dtype[np.float64]]):
    """A number that keeps what NumPy does to it, and has no value; it holds an object instead."""

    tape: _Tape
    word: str

    def __array_finalize__(self, given: object) -> None:
        self.word = ""

    def __array_ufunc__(
        self, ufunc: np.ufunc, method: str, *inputs: object, **more: object
    ) -> _Traced:
        if method != "__call__" or more:
            raise _UntracedError(f"numpy.{ufunc.__name__}.{method}")
        return self._find_tape(inputs).take(ufunc.__name__, *inputs)

    def __array_function__(
        self,
        func: Callable[..., object],
        types: object,
        args: Iterable[object],
        kwargs: Mapping[str, object],
    ) -> object:
        name, given = func.__name__, list(args)
        if name == "where" and len(given) == 3:
            return self._find_tape(given).take("where", *given)
        if name == "clip" and len(given) == 3:
            tape = self._find_tape(given)
            return tape.take("minimum", tape.take("maximum", *given[:2]), given[2])
        if name == "shape":
            return ()
        raise _UntracedError(f"numpy.{name}")

    @staticmethod
    def _find_tape(values: Sequence[object]) -> _Tape:
        return next(value.tape for value in values if isinstance(value, _Traced))

    def _refuse(self, *given: object, **more: object) -> NoReturn:
        raise _UntracedError("a branch or a loop")

    __bool__ = __float__ = __int__ = __getitem__ = __setitem__ = __iter__ = _refuse
    ravel = reshape = flatten = sum = min = max = any = all = astype = copy = _refuse


@dataclass(frozen=True)
class _Law:
    """A traced model: steps of the pull and of the legal contractions, and its constants."""

    tape: _Tape
    pull: str
    limits: tuple[str, str]
    model: MuscleModel

    @property
    def constants(self) -> dict[str, float]:
        """Constants of the printed code, by name."""
        ends = self.model.ends if isinstance(self.model, MountedMuscle) else EndEffects()
        low, high = self.model.pressure_limits
        least, most = _find_loads(self.model)
        return {
            "LENGTH": self.model.muscle.length,
            "LEAST_PRESSURE": float(low),
            "MOST_PRESSURE": float(high),
            "LEAST_LOAD": float(least),
            "MOST_LOAD": float(most),
            "OFFSET": ends.offset,
            "COMPLIANCE": ends.compliance,
            "SLACK_FORCE": -math.inf if ends.slack_force is None else ends.slack_force,
            "GOLDEN": 0.5 * (math.sqrt(5.0) - 1.0),
        }


def export_muscle(
    model: MuscleModel,
    path: str | os.PathLike[str],
    *,
    direction: str | None = None,
    pressure: float = 0.8,
    points: int = 41,
) -> Path:
    """Write a model as C, as Python that needs NumPy alone, or as a table, and return the path.

    C and Python have ``muscle_force(pressure, contraction)``, ``muscle_contraction(pressure,
    load)`` and ``muscle_pressure(force, length)`` in MPa, mm and N. They answer NaN where the model
    has no answer, and agree with it to round-off. A table has the force over pressure and
    contraction; where there is none its cell is empty.

    Parameters
    ----------
    model : MuscleModel
        The model. C and Python need an explicit force law: a model of the catalogue, a `Bundle` or
        `ScaledMuscle` of such, or one with end effects.
    path : str or path
        Ends in one of `SUFFIXES`, which is what is written. A file that exists is replaced.
    direction : str, optional
        ``"inflating"`` or ``"deflating"`` for a branch of friction.
    pressure : float
        Largest pressure of a table [MPa].
    points : int
        Pressures and contractions of a table, each, in [2, 1000].

    Raises
    ------
    InputError
        If the ending is not legal, or the model has no force law that can be written as code; the
        message names what was in the way.
    MissingExtraError
        If the table is Parquet and ``pyarrow`` is not installed.
    OutputError
        If the file cannot be written.
    """
    check_kind("model", model, MuscleModel)
    parse_direction(direction)
    suffix = Path(path).suffix.lower()
    if suffix == ".c":
        return write_text(path, print_c(model, direction=direction))
    if suffix == ".py":
        return write_text(path, print_python(model, direction=direction))
    if suffix not in SUFFIXES:
        raise InputError(f"{path} ends in '{suffix}': it must end in one of {', '.join(SUFFIXES)}")
    table = tabulate_force(model, pressure=pressure, points=points, direction=direction)
    return write_table(path, table)


def tabulate_force(
    model: MuscleModel, *, pressure: float = 0.8, points: int = 41, direction: str | None = None
) -> Mapping[str, Floats]:
    """Return a table of the force over pressure and contraction, as columns; NaN where none is.

    Pressures go from the lowest legal one to `pressure`, contractions between those without load
    at the two, and at least from 0.

    Raises
    ------
    InputError
        If an argument is outside its legal range, or the model has no force at all.
    """
    points = check_integer("points", points, low=2, high=1000)
    lowest = float(model.pressure_limits[0])
    most = check_number("pressure", pressure, low=lowest, low_open=True, unit="MPa")
    model.force(most, 0.0, direction=direction)  # the model's own reason, if it has no force
    ends = [0.0, float(model.contraction(most, 0.0, direction=direction))]
    pressures, contractions = (
        grid.ravel()
        for grid in np.meshgrid(
            np.linspace(lowest, most, points),
            np.linspace(min(ends), max(ends), points),
            indexing="ij",
        )
    )
    force = np.full(pressures.shape, np.nan)
    for k, pair in enumerate(zip(pressures.tolist(), contractions.tolist(), strict=True)):
        try:
            force[k] = model.force(*pair, direction=direction)
        except BozziniError:
            continue
    return {"pressure_MPa": pressures, "contraction_mm": contractions, "force_N": force}


def print_c(model: MuscleModel, *, direction: str | None = None) -> str:
    """Return a model as the text of a C file.

    Raises
    ------
    InputError
        If the model has no force law that can be written as code.
    """
    law = _trace(model, direction)

    def spell(step: tuple[str, tuple[str, ...]]) -> str:
        name, given = step
        arguments = [_spell_c(word) for word in given]
        if name in _INFIX:
            return f" {_INFIX[name]} ".join(arguments)
        if name in _CALLS:
            return f"{_CALLS[name]}({', '.join(arguments)})"
        return _C_FORMS[name].format(*arguments)

    def fill(*outcomes: str) -> str:
        steps = law.tape.steps
        return "\n".join(f"    const double {word} = {spell(steps[k])};" for k, word in
                         _find_needed(steps, outcomes))  # fmt: skip

    constants = law.constants
    lines = [f"#define {name} ({_spell_c(repr(value))})" for name, value in constants.items()]
    text = _C_CODE.format(
        about=_describe(model, direction),
        constants="\n".join(lines),
        steps=STEPS,
        margin=MARGIN,
        pull=fill(law.pull),
        pull_word=_spell_c(law.pull),
        limits=fill(*law.limits),
        low=_spell_c(law.limits[0]),
        high=_spell_c(law.limits[1]),
    )
    return text.replace("\n\n    return", "\n    return")


def print_python(model: MuscleModel, *, direction: str | None = None) -> str:
    """Return a model as the text of a Python file that needs NumPy alone.

    Raises
    ------
    InputError
        If the model has no force law that can be written as code.
    """
    law = _trace(model, direction)

    def spell(step: tuple[str, tuple[str, ...]]) -> str:
        name, arguments = step
        if name in _INFIX:
            return f" {_INFIX[name]} ".join(arguments)
        form = _PY_FORMS.get(name, f"np.{name}({', '.join(arguments)})")
        return form.format(*arguments)

    def fill(*outcomes: str) -> str:
        steps = law.tape.steps
        return "\n".join(f"    {word} = {spell(steps[k])}" for k, word in
                         _find_needed(steps, outcomes))  # fmt: skip

    lines = [
        f"{name} = {repr(value).replace('inf', 'np.inf')}" for name, value in law.constants.items()
    ]
    return _PY_CODE.format(
        about=_describe(model, direction),
        constants="\n".join(lines),
        steps=STEPS,
        margin=MARGIN,
        pull=fill(law.pull),
        pull_word=law.pull,
        limits=fill(*law.limits),
        low=law.limits[0],
        high=law.limits[1],
    )


def _spell_c(word: str) -> str:
    """Return a number or a name as C has it."""
    return word.replace("inf", "INFINITY")


def _describe(model: MuscleModel, direction: str | None) -> str:
    """Return what the code is of, as lines of a comment."""
    lines = [f"Pneumatic muscle, model {model.name}, written by Bozzini {__version__}."]
    if direction:
        lines.append(f"Branch of friction: {direction}.")
    lines += [
        "Pressures in MPa (gauge), lengths and contractions in mm, forces in N; a contraction is",
        f"how much shorter than {model.muscle.length!r} mm the muscle is. NaN: no answer.",
    ]
    return "\n".join(lines)


def _find_needed(
    steps: list[tuple[str, tuple[str, ...]]], outcomes: tuple[str, ...]
) -> list[tuple[int, str]]:
    """Return index and name of the steps that the outcomes need, in order."""
    needed = set(outcomes)
    found = []
    for k in reversed(range(len(steps))):
        if f"t{k}" in needed:
            needed |= set(steps[k][1])
            found.append((k, f"t{k}"))
    return found[::-1]


def _trace(model: MuscleModel, direction: str | None) -> _Law:
    """Return the law of a model, or raise the `InputError` that names what is in the way."""
    tape = _Tape()
    inner = model.model if isinstance(model, MountedMuscle) else model
    pressure, contraction = tape.name("pressure"), tape.name("contraction")
    try:
        with np.errstate(all="ignore"):
            pull = tape.spell(_trace_pull(inner, pressure, contraction, direction))
            limits = [tape.spell(end) for end in _trace_limits(inner, pressure)]
    except _UntracedError as stop:
        raise InputError(
            f"the model {model.name} cannot be written as code, {stop}: write a table, .csv or "
            ".parquet"
        ) from None
    return _Law(tape, pull, (limits[0], limits[1]), model)


def _trace_pull(
    model: MuscleModel, pressure: _Traced, contraction: Floats, direction: str | None
) -> Floats:
    """Return the traced pull of a model."""
    if isinstance(model, ScaledMuscle):
        return _trace_pull(model.model, pressure, contraction / model.factor, direction)
    if isinstance(model, Bundle):
        pulls = [_trace_pull(one, pressure, contraction, direction) for one in model.models]
        return sum(pulls[1:], start=pulls[0])
    if not isinstance(model, ExplicitModel):
        raise _UntracedError("it is no explicit force law")
    length = model.braid.length - contraction
    sign = np.asarray(DIRECTIONS[direction or ""])
    sign = model._sign_friction(sign)
    pull = model._pull(pressure, length)
    return pull + float(sign) * model._friction(pressure, length) if sign.any() else pull


def _find_loads(model: MuscleModel) -> tuple[float, float]:
    """Return the loads that a model has a contraction under [N]."""
    if isinstance(model, (MountedMuscle, ScaledMuscle)):
        return _find_loads(model.model)
    if isinstance(model, Bundle):
        lows, highs = zip(*map(_find_loads, model.models), strict=True)
        return len(lows) * max(lows), len(highs) * min(highs)
    return model.load_limits if isinstance(model, ExplicitModel) else (0.0, LOAD_LIMIT)


def _trace_limits(model: MuscleModel, pressure: _Traced) -> tuple[Floats | float, Floats | float]:
    """Return the traced legal contractions of a model."""
    if isinstance(model, ScaledMuscle):
        low, high = _trace_limits(model.model, pressure)
        return model.factor * low, model.factor * high
    if isinstance(model, Bundle):
        lows, highs = zip(*(_trace_limits(one, pressure) for one in model.models), strict=True)
        tape = pressure.tape
        low, high = lows[0], highs[0]
        for one, other in zip(lows[1:], highs[1:], strict=True):
            low, high = tape.take("maximum", low, one), tape.take("minimum", high, other)
        return low, high
    if not isinstance(model, ExplicitModel):  # cannot come here: its pull was refused
        return find_limits(model)
    shortest, longest = model._find_lengths(pressure)
    return model.braid.length - longest, model.braid.length - shortest


_C_CODE = """\
/* {about} */
#include <math.h>

double muscle_force(double pressure, double contraction);
double muscle_contraction(double pressure, double load);
double muscle_pressure(double force, double length);

{constants}

/* The force law: pull of the muscle itself, taut. */
static double pull(double pressure, double contraction)
{{
{pull}
    (void)pressure, (void)contraction;
    return {pull_word};
}}

static void find_limits(double pressure, double *low, double *high)
{{
{limits}
    (void)pressure;
    *low = {low};
    *high = {high};
}}

/* The contraction within its legal range; NaN outside. */
static double place(double pressure, double contraction)
{{
    const double slack = 1e-9 * LENGTH;
    double low, high;
    if (!(pressure >= LEAST_PRESSURE && pressure <= MOST_PRESSURE))
        return NAN;
    find_limits(pressure, &low, &high);
    if (!(low < high && contraction >= low - slack && contraction <= high + slack))
        return NAN;
    return fmin(fmax(contraction, low), high);
}}

typedef double (*excess_of)(double at, double one, double other);

/* The point between near and far at which the excess is gone, to the last bits; NaN at a jump. */
static double find_root(excess_of excess, double one, double other, double near, double far)
{{
    const double first = excess(near, one, other), last = excess(far, one, other);
    const double scale = fmax(fabs(first), fabs(last));
    int k;
    for (k = 0; k < 200; k++) {{
        const double middle = 0.5 * (near + far);
        if (middle == near || middle == far)
            break;
        if (excess(middle, one, other) * first > 0.0)
            near = middle;
        else
            far = middle;
    }}
    return fabs(excess(far, one, other)) <= 1e-6 * scale ? far : NAN;
}}

static double miss_force(double force, double pressure, double contraction)
{{
    return pull(pressure, contraction - OFFSET + COMPLIANCE * force) - force;
}}

/* Of the contraction of the muscle itself, where base is without give. */
static double miss_own(double own, double pressure, double base)
{{
    return pull(pressure, own) - (own - base) / COMPLIANCE;
}}

static double miss_load(double contraction, double pressure, double load)
{{
    return pull(pressure, contraction) - load;
}}

static double miss_pressure(double pressure, double force, double contraction)
{{
    return pull(pressure, place(pressure, contraction)) - force;
}}

/* Pull at a pressure and a contraction. */
double muscle_force(double pressure, double contraction)
{{
    const double base = contraction - OFFSET;
    double force = pull(pressure, base), own, low, high, margin;
    if (COMPLIANCE > 0.0)
        force = find_root(miss_force, pressure, contraction, 0.0, force);
    if (COMPLIANCE > 0.0 && isnan(place(pressure, base + COMPLIANCE * force))) {{
        find_limits(pressure, &low, &high);
        margin = {margin} * (high - low);
        own = find_root(miss_own, pressure, base, low + margin, high - margin);
        force = (own - base) / COMPLIANCE;
    }}
    own = place(pressure, base + COMPLIANCE * force);
    if (isnan(own) || isnan(force))
        return NAN;
    if (COMPLIANCE == 0.0)
        force = pull(pressure, own);
    return force < SLACK_FORCE ? SLACK_FORCE : force;
}}

/* Contraction under a load: the first one on the way from the free length. */
double muscle_contraction(double pressure, double load)
{{
    double low, high, start, end, near, first;
    int k;
    if (!(pressure >= LEAST_PRESSURE && pressure <= MOST_PRESSURE))
        return NAN;
    if (!(load >= LEAST_LOAD && load <= MOST_LOAD))
        return NAN;
    find_limits(pressure, &low, &high);
    if (!(low < high))
        return NAN;
    start = near = fmin(fmax(0.0, low), high);
    first = miss_load(start, pressure, load);
    if (first == 0.0)
        return start + OFFSET - COMPLIANCE * load;
    end = first > 0.0 ? high : low;
    for (k = 1; k <= {steps}; k++) {{
        const double at = k == {steps} ? end : start + (end - start) * (k / {steps}.0);
        if (miss_load(at, pressure, load) * first <= 0.0)
            return find_root(miss_load, pressure, load, near, at) + OFFSET - COMPLIANCE * load;
        near = at;
    }}
    return NAN;
}}

/* The lowest pressure that pulls so at a length. */
double muscle_pressure(double force, double length)
{{
    const double own = LENGTH - length - OFFSET + COMPLIANCE * force;
    double near = LEAST_PRESSURE, step = 0.02, left = miss_pressure(near, force, own);
    double low = near, high = near, best = left;
    int k;
    if (left == 0.0)
        return near;
    while (near < MOST_PRESSURE) {{
        const double far = fmin(LEAST_PRESSURE + step, MOST_PRESSURE);
        const double right = miss_pressure(far, force, own);
        if (left * right <= 0.0)
            return find_root(miss_pressure, force, own, near, far);
        if (high == near)
            high = far;
        if (fabs(right) < fabs(best) || isnan(best)) {{
            low = near;
            high = far;
            best = right;
        }}
        near = far;
        left = right;
        step *= 2.0;
    }}
    /* The force may pass twice in one step: golden sections about the nearest one tried. */
    for (k = 0; k < 60 && !isnan(miss_pressure(low, force, own)); ++k) {{
        const double one = high - GOLDEN * (high - low), other = low + GOLDEN * (high - low);
        const double less = miss_pressure(one, force, own);
        const double more = miss_pressure(other, force, own);
        if (less * best <= 0.0)
            return find_root(miss_pressure, force, own, low, one);
        if (more * best <= 0.0)
            return find_root(miss_pressure, force, own, low, other);
        if (isnan(less + more))
            break;
        if (fabs(less) < fabs(more))
            high = other;
        else
            low = one;
    }}
    return NAN;
}}
"""

_PY_CODE = '''\
"""{about}"""

import numpy as np

{constants}


def _pull(pressure, contraction):
    """Pull of the muscle itself, taut."""
{pull}
    return {pull_word} + 0.0 * contraction


def _find_limits(pressure):
    """Legal contractions."""
{limits}
    return {low} + 0.0 * pressure, {high} + 0.0 * pressure


def _place(pressure, contraction):
    """The contraction within its legal range; NaN outside."""
    slack = 1e-9 * LENGTH
    low, high = _find_limits(pressure)
    legal = (pressure >= LEAST_PRESSURE) & (pressure <= MOST_PRESSURE) & (low < high)
    legal &= (contraction >= low - slack) & (contraction <= high + slack)
    return np.where(legal, np.minimum(np.maximum(contraction, low), high), np.nan)


def _find_root(excess, near, far):
    """The points between two ends at which the excess is gone; NaN where it jumps."""
    near, far = near.copy(), far.copy()
    first = excess(near)
    scale = np.maximum(np.abs(first), np.abs(excess(far)))
    for _ in range(200):
        middle = 0.5 * (near + far)
        if np.all((middle == near) | (middle == far) | np.isnan(middle)):
            break
        ahead = excess(middle) * first > 0.0
        near, far = np.where(ahead, middle, near), np.where(ahead, far, middle)
    return np.where(np.abs(excess(far)) <= 1e-6 * scale, far, np.nan)


def _take(*values):
    return [np.array(value, dtype=np.float64) for value in np.broadcast_arrays(*values)]


def muscle_force(pressure, contraction):
    """Pull at a pressure and a contraction."""
    pressure, contraction = _take(pressure, contraction)
    with np.errstate(all="ignore"):
        base = contraction - OFFSET
        force = _pull(pressure, base)
        if COMPLIANCE > 0.0:
            force = _find_root(
                lambda at: _pull(pressure, base + COMPLIANCE * at) - at,
                np.zeros(force.shape),
                force,
            )
            low, high = _find_limits(pressure)
            margin = {margin} * (high - low)
            own = _find_root(
                lambda at: _pull(pressure, at) - (at - base) / COMPLIANCE,
                low + margin,
                high - margin,
            )
            wrong = np.isnan(_place(pressure, base + COMPLIANCE * force))
            force = np.where(wrong, (own - base) / COMPLIANCE, force)
        own = _place(pressure, base + COMPLIANCE * force)
        if COMPLIANCE == 0.0:
            force = _pull(pressure, own)
        return np.where(np.isnan(own), np.nan, np.maximum(force, SLACK_FORCE))[()]


def muscle_contraction(pressure, load):
    """Contraction under a load: the first one on the way from the free length."""
    pressure, load = _take(pressure, load)
    with np.errstate(all="ignore"):
        low, high = _find_limits(pressure)
        start = np.minimum(np.maximum(0.0, low), high)
        first = _pull(pressure, start) - load
        end = np.where(first > 0.0, high, low)
        near, far = start.copy(), np.where(first == 0.0, start, np.nan)
        for k in range(1, {steps} + 1):
            at = end if k == {steps} else start + (end - start) * (k / {steps})
            crossed = np.isnan(far) & ((_pull(pressure, at) - load) * first <= 0.0)
            far = np.where(crossed, at, far)
            near = np.where(np.isnan(far), at, near)
        found = _find_root(lambda at: _pull(pressure, at) - load, near, far)
        found = np.where(first == 0.0, start, found) + OFFSET - COMPLIANCE * load
        legal = (pressure >= LEAST_PRESSURE) & (pressure <= MOST_PRESSURE) & (low < high)
        legal &= (load >= LEAST_LOAD) & (load <= MOST_LOAD)
        return np.where(legal, found, np.nan)[()]


def muscle_pressure(force, length):
    """The lowest pressure that pulls so at a length."""
    force, length = _take(force, length)
    own = LENGTH - length - OFFSET + COMPLIANCE * force

    def excess(at):
        return _pull(at, _place(at, own)) - force

    with np.errstate(all="ignore"):
        near = np.full(force.shape, LEAST_PRESSURE)
        left = excess(near)
        lowest, far, step, at = left == 0.0, np.full(force.shape, np.nan), 0.02, LEAST_PRESSURE
        tried, values = np.array([at]), np.array([left])
        while at < MOST_PRESSURE:
            at = min(LEAST_PRESSURE + step, MOST_PRESSURE)
            right = excess(np.full(force.shape, at))
            crossed = np.isnan(far) & (left * right <= 0.0)
            far = np.where(crossed, at, far)
            near = np.where(np.isnan(far), at, near)
            left, step = right, 2.0 * step
            tried, values = np.append(tried, at), np.concatenate([values, [right]])
        # The force may pass twice in one step: golden sections about the nearest one tried.
        place = np.argmin(np.where(np.isnan(values), np.inf, np.abs(values)), axis=0)
        best = np.take_along_axis(values, np.expand_dims(place, 0), axis=0)[0]
        low = tried[np.maximum(place - 1, 0)]
        high = tried[np.minimum(place + 1, len(tried) - 1)]
        lost = ~lowest & np.isnan(far) & ~np.isnan(excess(low))
        for _ in range(60):
            if not np.any(lost):
                break
            one, other = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
            less, more = excess(one), excess(other)
            passed = np.where(more * best <= 0.0, other, np.nan)
            passed = np.where(less * best <= 0.0, one, passed)
            new = lost & ~np.isnan(passed)
            near, far = np.where(new, low, near), np.where(new, passed, far)
            lost &= np.isnan(passed) & ~np.isnan(less + more)
            down = np.abs(less) < np.abs(more)
            high, low = np.where(lost & down, other, high), np.where(lost & ~down, one, low)
        return np.where(lowest, LEAST_PRESSURE, _find_root(excess, near, far))[()]
'''

"""What a study varies: factors, and the rows that a sampling draws of them, by row number."""

from __future__ import annotations

import dataclasses
import math
import warnings
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..checks import Quantity, check_fields, quantity, show_value
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Shown
from ..units import parse_quantity

Value = float | str
"""A number, a quantity as text with its unit, or a word."""

FORMAT = "bozzini-study-1"
MOST_ROWS = 10**9
_KINDS = ("range", "integers", "normal", "values", "files")


@dataclass(frozen=True, kw_only=True)
class Factor(Shown):
    """How one input varies: exactly one of range, integers, normal, values and files.

    Parameters
    ----------
    range : (low, high), optional
        Uniform between two values; with ``scale: log`` uniform in the logarithm.
    integers : (low, high), optional
        Whole numbers, both ends included.
    normal : (mean, standard deviation), optional
        A normal distribution; `clip` cuts it, and what is outside is not drawn.
    values, files : tuple, optional
        These values, or these files.
    scale : {"linear", "log"}
        Of a range.
    clip : (low, high), optional
        Of a normal distribution.
    levels : int
        How many values a grid has of a range or a normal distribution, 2 to 100,000.

    Raises
    ------
    InputError
        If not exactly one is given, or a value is not legal.
    """

    range: tuple[Value, Value] | None = None
    integers: tuple[int, int] | None = None
    normal: tuple[Value, Value] | None = None
    values: tuple[Value, ...] | None = None
    files: tuple[str, ...] | None = None
    scale: Literal["linear", "log"] = "linear"
    clip: tuple[Value, Value] | None = None
    levels: int = quantity(default=10, low=2, high=100_000, whole=True)

    def __post_init__(self) -> None:
        check_fields(self)
        given = [name for name in _KINDS if getattr(self, name) is not None]
        if len(given) != 1:
            raise InputError(
                f" has {' and '.join(given) or 'none of these'}: give one of {', '.join(_KINDS)}"
            )
        if self.scale == "log" and self.range is None:
            raise InputError(f" has scale log with {given[0]}: only a range has it")
        if self.clip is not None and self.normal is None:
            raise InputError(f" has clip with {given[0]}: only normal has it")
        for name in ("values", "files"):
            if getattr(self, name) == ():
                raise InputError(f".{name} is empty: give 1 or more")


@dataclass(frozen=True, kw_only=True)
class Sampling(Shown):
    """Which rows are drawn: row i is the same whatever the chunks and workers.

    Parameters
    ----------
    method : {"grid", "sobol", "random", "saltelli"}
        Every combination, the last factor fastest; a scrambled Sobol sequence; at random; or the
        design of Sobol indices: each draw of a scrambled Sobol sequence gives two rows A and B, and
        for each factor the row A with that factor of B.
    count : int, optional
        Rows, not for a grid; of ``saltelli`` the draws, a power of two, each of which is as many
        rows as there are factors, and two more.
    seed : int
    """

    method: Literal["grid", "sobol", "random", "saltelli"] = "grid"
    count: int | None = quantity(default=None, low=1, high=MOST_ROWS, whole=True)
    seed: int = quantity(default=0, low=0, high=2**32 - 1, whole=True)

    def __post_init__(self) -> None:
        check_fields(self)
        if (self.count is None) != (self.method == "grid"):
            wrong = "has no count" if self.count is None else "has a count"
            raise InputError(f" {wrong} with method {self.method}: a grid has none, others need it")
        if self.method == "saltelli" and self.count is not None and self.count.bit_count() != 1:
            raise InputError(
                f".count is {self.count}: of saltelli it must be a power of two, such as "
                f"{2 ** self.count.bit_length()}"
            )


@dataclass(frozen=True, kw_only=True)
class Limit(Shown):
    """What an output must keep for a row to be feasible: at least, at most, or both."""

    at_least: Value | None = None
    at_most: Value | None = None

    def __post_init__(self) -> None:
        if self.at_least is None and self.at_most is None:
            raise InputError(" has neither at_least nor at_most: give one or both")


@dataclass(frozen=True, kw_only=True)
class Search(Shown):
    """A search for the best in place of a sampling; factors are its bounds.

    Parameters
    ----------
    minimise : tuple of str
        Outputs to make small; ``-name`` makes one large. Two or more need the method ``nsga2``.
    method : {"differential-evolution", "nsga2", "tpe"}
        SciPy's, in whole generations at once; pymoo's, for several aims; Optuna's, for dear rows.
    evaluations : int
        Rows to compute, about.
    seed : int
    """

    minimise: tuple[str, ...]
    method: Literal["differential-evolution", "nsga2", "tpe"] = "differential-evolution"
    evaluations: int = quantity(default=2000, low=10, high=10_000_000, whole=True)
    seed: int = quantity(default=0, low=0, high=2**32 - 1, whole=True)

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.minimise or (len(self.minimise) > 1) != (self.method == "nsga2"):
            raise InputError(
                f" has {len(self.minimise)} outputs to minimise with method {self.method}: nsga2 "
                "takes two or more, the others one"
            )


@dataclass(frozen=True, kw_only=True)
class StudySpec(Shown):
    """A study file: a job, what is fixed, what varies, and what is kept.

    Parameters
    ----------
    format : str
        ``bozzini-study-1``.
    job : str
        A name of `bozzini.study.JOBS`, or ``module:function``.
    factors : mapping of str to Factor
        What varies, in this order.
    fixed : mapping, optional
        Inputs that do not vary; quantities as text with their unit.
    sampling : Sampling
    search : Search, optional
        In place of a sampling.
    outputs : tuple of str
        Columns to keep; by default all that the job has. A function's must be named.
    constraints : mapping of str to Limit
        By output.
    chunk : int, optional
        Rows of one part; by default what the job proposes.
    """

    format: str
    job: str
    factors: dict[str, Factor]
    fixed: dict[str, Value] = field(default_factory=dict)
    sampling: Sampling | None = None
    search: Search | None = None
    outputs: tuple[str, ...] = ()
    constraints: dict[str, Limit] = field(default_factory=dict)
    chunk: int | None = quantity(default=None, low=1, high=1_000_000, whole=True)

    def __post_init__(self) -> None:
        check_fields(self)
        if self.format != FORMAT:
            raise InputError(f"format is {show_value(self.format)}: it must be {FORMAT}")
        if not self.factors:
            raise InputError("factors is empty: a study varies 1 or more")
        twice = next((name for name in self.factors if name in self.fixed), None)
        if twice is not None:
            raise InputError(f"'{twice}' is fixed and a factor: give it once")
        if (self.sampling is None) == (self.search is None):
            raise InputError("a study has either sampling or search: give one of them")


class Axis:
    """A factor whose values are numbers in Bozzini's units, or words.

    Parameters
    ----------
    name : str
    factor : Factor
    known : Quantity
        What is known of the input: its unit, its legal range, and whether it is whole.
    """

    def __init__(self, name: str, factor: Factor, known: Quantity) -> None:
        self.name, self.factor, self.known = name, factor, known
        kind = next(kind for kind in _KINDS if getattr(factor, kind) is not None)
        given: tuple[Value, ...] = getattr(factor, kind)
        self.kind = kind
        words = kind == "files" or known.kind in ("text", "file")
        if words and kind in ("range", "integers", "normal"):
            raise InputError(f"factors.{name} is a {kind}: it takes values or files")
        self.values: tuple[Value, ...] = (
            tuple(str(value) for value in given)
            if words
            else tuple(
                self._take(value, legal=(kind, place) != ("normal", 1))
                for place, value in enumerate(given)
            )
        )
        if kind in ("range", "integers"):
            low, high = (float(value) for value in self.values)
            if not low < high or (factor.scale == "log" and low <= 0.0):
                above = " of positive values" if factor.scale == "log" else ""
                raise InputError(
                    f"factors.{name}.{kind} is [{low:g}, {high:g}]: give a lower and a higher "
                    f"end{above}"
                )
        if kind == "range" and known.whole:
            raise InputError(f"factors.{name} is a range: it takes whole numbers, give integers")
        if kind == "normal":
            if not float(self.values[1]) > 0.0:
                raise InputError(
                    f"factors.{name}.normal has a standard deviation of {self.values[1]}: it must "
                    "be above 0"
                )
            ends = factor.clip or (-math.inf, math.inf)
            low, high = (self._take(end) if factor.clip else float(end) for end in ends)
            self.clip = (low, high)
            if not low < high:
                raise InputError(f"factors.{name}.clip is {self.clip}: give low, then high")

    def _take(self, value: Value, *, legal: bool = True) -> float:
        known = dataclasses.replace(self.known, whole=False)
        if not legal:  # a standard deviation
            known = dataclasses.replace(known, low=-math.inf, high=math.inf)
        place = f"factors.{self.name}"
        try:
            number = take_value(value, known)
        except InputError as error:
            raise InputError(f"{place}: {error}") from None
        if not isinstance(number, (int, float)):
            raise InputError(f"{place} has {show_value(value)}: it takes numbers, or files")
        if self.known.whole and number != round(number):
            raise InputError(f"{place} has {number:g}: it takes whole numbers")
        return float(number)

    @property
    def is_words(self) -> bool:
        """Whether the values are words."""
        return isinstance(self.values[0], str)

    @property
    def levels(self) -> int:
        """How many values a grid has of it."""
        if self.kind == "integers":
            return int(float(self.values[1]) - float(self.values[0])) + 1
        return len(self.values) if self.kind in ("values", "files") else self.factor.levels

    def place(self, shares: Floats) -> NDArray[np.generic]:
        """Return the values at shares in [0, 1): quantiles of the factor."""
        if self.kind in ("values", "files", "integers"):
            return self.pick(np.minimum((shares * self.levels).astype(int), self.levels - 1))
        first, second = (float(value) for value in self.values)
        if self.kind == "range" and self.factor.scale == "log":
            return np.exp(math.log(first) + shares * math.log(second / first))
        if self.kind == "range":
            return first + shares * (second - first)
        from scipy.special import ndtr, ndtri

        ends = np.array([(end - first) / second for end in self.clip])
        if ends[0] > 0.0:  # mirrored: near to 1 a probability has no digits left
            low, high = (float(probability) for probability in ndtr(-ends))
            values = first - second * ndtri(np.maximum(low + shares * (high - low), 1e-300))
        else:
            low, high = (float(probability) for probability in ndtr(ends))
            values = first + second * ndtri(np.maximum(low + shares * (high - low), 1e-300))
        return np.asarray(np.clip(values, self.clip[0], self.clip[1]))

    def pick(self, indices: NDArray[np.int64]) -> NDArray[np.generic]:
        """Return the values of a grid at indices."""
        if self.kind in ("values", "files"):
            return np.asarray(self.values, dtype=object if self.is_words else float)[indices]
        if self.kind == "integers":
            return int(float(self.values[0])) + indices
        if self.kind == "range":
            return self.place(indices / (self.levels - 1.0))
        return self.place((indices + 0.5) / self.levels)


def take_value(value: Value, known: Quantity) -> Value:
    """Return a fixed input as a number in Bozzini's units, or a word; `InputError` if not legal."""
    if known.kind in ("text", "file"):
        if known.words and value not in known.words:
            raise InputError(f"{show_value(value)} must be one of {', '.join(known.words)}")
        return str(value)
    if known.kind == "dimensionless" and known.help == FREE and isinstance(value, str):
        return value
    number = parse_quantity(value, known.kind)
    if callable(known.low) or callable(known.high):
        return number
    name = known.label or "value"
    return known.check(name, int(number) if known.whole and number == int(number) else number)


FREE = "an input of a function"
"""Help of an input of which nothing is known."""


def draw_rows(
    axes: list[Axis], sampling: Sampling, *, first: int, count: int
) -> dict[str, NDArray[np.generic]]:
    """Return the factors of rows first to first + count, each (count,)."""
    if sampling.method == "grid":
        shape = [axis.levels for axis in axes]
        indices = np.unravel_index(np.arange(first, first + count), shape)
        return {
            axis.name: axis.pick(np.asarray(index))
            for axis, index in zip(axes, indices, strict=True)
        }
    shares = draw_shares(len(axes), sampling, first, count)
    return {axis.name: axis.place(shares[:, k]) for k, axis in enumerate(axes)}


def draw_shares(dim: int, sampling: Sampling, first: int, count: int) -> Floats:
    """Return shares in [0, 1) of `dim` factors in some rows, (count, dim); not of a grid."""
    if sampling.method == "sobol":
        return _draw_sobol(dim, sampling.seed, first, count)
    if sampling.method == "saltelli":
        return _draw_saltelli(dim, sampling.seed, first, count)
    # A step of the generator gives four numbers.
    begin = first * dim
    bits = np.random.Philox(key=sampling.seed).advance(begin // 4)
    skipped = begin % 4
    drawn = np.random.Generator(bits).random(skipped + count * dim)
    return np.asarray(drawn[skipped:].reshape(count, dim))


def _draw_sobol(dim: int, seed: int, first: int, count: int) -> Floats:
    from scipy.stats import qmc

    with warnings.catch_warnings():
        # A part of a sequence is no balanced set; whether the whole is one is the user's choice.
        warnings.simplefilter("ignore", UserWarning)
        engine = qmc.Sobol(dim, scramble=True, seed=np.random.default_rng(seed))
        if first:
            engine.fast_forward(first)
        return np.asarray(engine.random(count))


def _draw_saltelli(dim: int, seed: int, first: int, count: int) -> Floats:
    """Return rows of the design: of each draw A, B, and A with one factor of B in turn."""
    draw, place = np.divmod(np.arange(first, first + count), dim + 2)
    drawn = _draw_sobol(2 * dim, seed, int(draw[0]), int(draw[-1] - draw[0]) + 1)[draw - draw[0]]
    of_b = (place == 1)[:, None] | (place[:, None] - 2 == np.arange(dim))
    return np.asarray(np.where(of_b, drawn[:, dim:], drawn[:, :dim]))


def count_rows(axes: list[Axis], sampling: Sampling) -> int:
    """Return how many rows a sampling has.

    Raises
    ------
    InputError
        If there are more than `MOST_ROWS`.
    """
    total = sampling.count or math.prod(axis.levels for axis in axes)
    if sampling.method == "saltelli":
        total *= len(axes) + 2
    if total > MOST_ROWS:
        raise InputError(f"{sampling.method} has {total} rows: at most {MOST_ROWS} are legal")
    return total

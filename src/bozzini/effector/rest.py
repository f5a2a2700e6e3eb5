"""What a fitted model leaves over, learned from the data: a rest on top of it, and baselines."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations_with_replacement

import numpy as np

from ..checks import check_array, check_integer
from ..errors import InputError
from ..numeric.arrays import Floats
from ..registry import Registry
from ..results import Shown
from .kernels import motion as kernels

RIDGES = (0.1, 1.0, 10.0, 100.0, 1000.0)
"""Ridges that are tried, on runs left out."""
_LIMIT = 10.0
"""Size, in ranges of the data, within which a polynomial of past samples is kept."""


class Rest(Shown, ABC):
    """A rule that is learned from what a model leaves over, on top of it.

    Another package adds one by an entry point of the group ``bozzini.rests``.
    """

    @abstractmethod
    def learn(self, states: Sequence[tuple[Floats, Floats]], misses: Sequence[Floats]) -> Rest:
        """Return the rule for runs.

        Parameters
        ----------
        states : sequence of tuple
            Of each run times (n,) [s], and pressures that act (n, m) [MPa].
        misses : sequence of ndarray, shape (n, q)
            Measured less model, NaN where nothing was seen.
        """

    @abstractmethod
    def predict(self, times: Floats, states: Floats) -> Floats:
        """Return what a run is off by, (n, q)."""

    def pack(self) -> Mapping[str, tuple[float, ...]]:
        """Return the numbers by name that `unpack` makes the rule of again, for files.

        Raises
        ------
        InputError
            If this rule has none: it cannot be written.
        """
        raise InputError(f"a {type(self).__name__} has no numbers that a file could hold")

    @classmethod
    def unpack(cls, numbers: Mapping[str, tuple[float, ...]]) -> Rest:
        """Return the rule of numbers, as `pack` gives them."""
        raise InputError(f"a {cls.__name__} is not read from files")


@dataclass(frozen=True, kw_only=True, eq=False)
class PolynomialRest(Rest):
    """A polynomial of the pressures that act, now and before.

    Parameters
    ----------
    delays : tuple of float
        How long before [s]; 0 is now. Before the first row all was as there.
    degree : int
        1 to 3.
    weights : ndarray, shape (f, q), optional
        Of the products; what `learn` finds, with the ridge that predicts runs left out best.
    ridge : float
        Of them.
    """

    delays: tuple[float, ...] = (0.0, 0.5, 3.0)
    degree: int = 2
    weights: Floats | None = None
    ridge: float = 0.0

    def __post_init__(self) -> None:
        check_integer("degree of the rest", self.degree, low=1, high=3)
        delays = check_array("delays", self.delays)
        if delays.ndim != 1 or not delays.size or delays.min() < 0.0:
            raise InputError(f"delays are {self.delays}: they must be times of 0 s or more")

    def learn(self, states: Sequence[tuple[Floats, Floats]], misses: Sequence[Floats]) -> Rest:
        """Return the rule for runs; see `Rest`."""
        products = [self._list_products(*state) for state in states]
        normal, right = [], []
        for rows, miss in zip(products, misses, strict=True):
            kept = np.isfinite(miss).all(axis=-1)
            normal.append(rows[kept].T @ rows[kept])
            right.append(rows[kept].T @ miss[kept])

        def solve(ridge: float, left_out: int | None = None) -> Floats:
            which = [k for k in range(len(normal)) if k != left_out]
            matrix = sum(normal[k] for k in which) + ridge * np.eye(len(normal[0]))
            return np.asarray(np.linalg.solve(matrix, sum(right[k] for k in which)))

        def miss_left_out(ridge: float) -> float:
            off = [misses[k] - products[k] @ solve(ridge, k) for k in range(len(misses))]
            return float(np.nansum(np.concatenate(off) ** 2))

        ridge = min(RIDGES, key=miss_left_out) if len(misses) > 1 else RIDGES[-1]
        return PolynomialRest(
            delays=self.delays, degree=self.degree, weights=solve(ridge), ridge=ridge
        )

    def predict(self, times: Floats, states: Floats) -> Floats:
        """Return what a run is off by, (n, q); see `Rest`."""
        if self.weights is None:
            raise InputError("the rest has learned nothing yet")
        return np.asarray(self._list_products(times, states) @ self.weights)

    def pack(self) -> Mapping[str, tuple[float, ...]]:
        """Return the numbers by name; see `Rest`."""
        if self.weights is None:
            raise InputError("the rest has learned nothing yet")
        return {
            "delays": tuple(self.delays),
            "degree": (float(self.degree),),
            "ridge": (float(self.ridge),),
            "products": (float(len(self.weights)),),
            "weights": tuple(self.weights.ravel().tolist()),
        }

    @classmethod
    def unpack(cls, numbers: Mapping[str, tuple[float, ...]]) -> PolynomialRest:
        """Return the rule of numbers; see `Rest`."""
        try:
            weights = np.array(numbers["weights"]).reshape(int(numbers["products"][0]), -1)
            return cls(
                delays=tuple(numbers["delays"]),
                degree=int(numbers["degree"][0]),
                weights=weights,
                ridge=numbers["ridge"][0],
            )
        except (KeyError, IndexError, ValueError):
            raise InputError(
                "the rest has not delays, degree, ridge, products, and weights of these"
            ) from None

    def _list_products(self, times: Floats, states: Floats) -> Floats:
        columns = [
            np.interp(times - delay, times, column) for delay in self.delays for column in states.T
        ]
        return _multiply(np.stack(columns, axis=-1), self.degree)


def _multiply(variables: Floats, degree: int) -> Floats:
    """Return 1, variables (n, v), and their products up to a degree, (n, f)."""
    columns = [np.ones(len(variables))]
    for order in range(1, degree + 1):
        for places in combinations_with_replacement(range(variables.shape[1]), order):
            columns.append(np.prod(variables[:, places], axis=1))
    return np.stack(columns, axis=-1)


def _find_base() -> type[Rest]:
    return Rest


RESTS: Registry[Rest] = Registry(
    "bozzini.rests", _find_base, lambda: {"polynomial": PolynomialRest}, noun="rest"
)
"""Rules for what a fit leaves over, by name."""


def is_storable(name: str) -> bool:
    """Return whether a rule of `RESTS` can be written to a file."""
    return RESTS.choose(name).pack is not Rest.pack


@dataclass(frozen=True, eq=False)
class Baseline:
    """A black box beside a fit: a constant, or a polynomial of two past samples.

    Its variables are what was seen and commanded at the two samples before; it is fitted one step
    ahead, and then runs by itself from the first two samples of a run on.

    Parameters
    ----------
    degree : int
        0 for the mean of what was seen, 1 or 2.
    weights : ndarray, shape (f, q)
    scales : tuple of float
        Size of what was commanded and seen.
    """

    degree: int
    weights: Floats
    scales: tuple[float, float]

    @property
    def name(self) -> str:
        """What it is, for people."""
        return ("constant", "linear, two past samples", "quadratic, two past samples")[self.degree]

    @property
    def count(self) -> int:
        """How many constants it has."""
        return int(self.weights.size)

    @classmethod
    def learn(cls, degree: int, runs: Sequence[tuple[Floats, Floats]]) -> Baseline:
        """Return the one fitted to runs: commands (n, m) and what was seen (n, q) of each."""
        scales = tuple(
            float(np.nanmax([np.nanmax(np.abs(run[k])) for run in runs])) or 1.0 for k in (0, 1)
        )
        if degree == 0:
            mean = np.nanmean(np.concatenate([seen for _, seen in runs]), axis=0)
            return cls(0, mean[None] / scales[1], (scales[0], scales[1]))
        rows, wanted = [], []
        for commands, seen in runs:
            u, y = commands / scales[0], seen / scales[1]
            past = np.concatenate([y[1:-1], y[:-2], u[1:-1], u[:-2]], axis=1)
            kept = np.isfinite(past).all(axis=1) & np.isfinite(y[2:]).all(axis=1)
            rows.append(_multiply(past[kept], degree))
            wanted.append(y[2:][kept])
        weights = np.linalg.lstsq(np.concatenate(rows), np.concatenate(wanted), rcond=None)[0]
        return cls(degree, weights, (scales[0], scales[1]))

    def predict(self, commands: Floats, seen: Floats) -> Floats:
        """Return a run (n, q) of which only the first two samples are known."""
        found = np.ascontiguousarray(np.broadcast_to(self.weights[:1], seen.shape)).copy()
        if self.degree and len(seen) > 2:
            found[:2] = np.nan_to_num(seen[:2] / self.scales[1])
            kernels.run_polynomial(
                np.ascontiguousarray(commands / self.scales[0]),
                np.ascontiguousarray(self.weights),
                self.degree == 2,
                _LIMIT,
                found,
            )
        return found * self.scales[1]


BASELINES = tuple(partial(Baseline.learn, degree) for degree in (0, 1, 2))
"""The baselines of a fit in time."""

"""What a least-squares fit has determined: covariance by blocks, and what it has not.

Rows that follow each other in a recording err alike, by what the model leaves out as well: taken as
independent they make intervals too short. So blocks of rows count as independent of each other, and
the covariance is the jackknife over them, linearised at the minimum: each is left out in turn
(`measure_spread`; J. G. MacKinnon, M. O. Nielsen, M. D. Webb, *Journal of Econometrics* 232, 2023,
272-299, their CV3). Few blocks are long ones, and Student's factor for ten is hardly larger. A
block must be long against the rows over which errors stay alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from .arrays import Floats

Places = NDArray[np.int64]

RUNS = 10
"""Runs of rows, in the order of the table, that count as independent of each other."""
LEAST_LABELS = 5
"""So many labels of rows, or more, are the blocks in place of runs."""
ALONE = 1e-6
"""Share of what determines a constant that must be left without any one block."""

CONDITION_LIMIT = 30.0
"""Above this condition of the Jacobian, its columns scaled to length 1, a warning is given."""
CORRELATION_LIMIT = 0.98
"""Above this correlation of two parameters a warning is given."""
LOST = 1e-3
"""Singular value of the scaled Jacobian that counts as none: a share of the largest, 1 at least."""
_LEAST = 1e-12  # length of a column, or a singular value, that stands for none


@dataclass(frozen=True)
class Determination:
    """How far a Jacobian determines its parameters.

    Parameters
    ----------
    inverse : ndarray, shape (k, k)
        Inverse of the normal matrix: the covariance for errors of variance 1.
    correlations : ndarray, shape (k, k)
    condition : float
        Condition number of the Jacobian with columns of length 1.
    singular : ndarray, shape (k,)
        Singular values of that, the largest first.
    basis : ndarray, shape (k, k)
        Its right singular vectors, one in each row.
    lengths : ndarray, shape (k,)
        Lengths of the columns.
    """

    inverse: Floats
    correlations: Floats
    condition: float
    singular: Floats
    basis: Floats
    lengths: Floats

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Which singular values determine something, (k,); columns without effect leave none."""
        return np.asarray(self.singular >= LOST * max(self.singular[0], 1.0))


def determine(jacobian: Floats) -> Determination:
    """Return how far a Jacobian (n, k), n at least k, determines its parameters."""
    length = np.maximum(np.linalg.norm(jacobian, axis=0), _LEAST)  # huge, not infinite, if lost
    _, singular, basis = np.linalg.svd(jacobian / length, full_matrices=False)
    singular = np.maximum(singular, _LEAST)
    inverse = (basis.T / singular**2) @ basis
    spread = np.sqrt(np.diag(inverse))
    return Determination(
        inverse=inverse / np.outer(length, length),
        correlations=np.clip(inverse / np.outer(spread, spread), -1.0, 1.0),
        condition=float(max(singular[0], 1.0) / singular[-1]),
        singular=singular,
        basis=basis,
        lengths=length,
    )


@dataclass(frozen=True)
class Blocks:
    """Rows that count together.

    Parameters
    ----------
    of_row : ndarray of int, shape (n,)
        Block of each row, from 0.
    freedom : int
        Blocks that determine a constant, at least, less one.
    rule : str
        What the blocks are, for people.
    """

    of_row: Places
    freedom: int
    rule: str


def make_blocks(labels: Sequence[str] | NDArray[np.str_], *, apart: bool = False,
                noun: str = "labels") -> Blocks:  # fmt: skip
    """Return the blocks of a table: at most `RUNS` runs of rows, in the order of the table.

    Parameters
    ----------
    labels : sequence of str, shape (n,)
        Of the rows; `LEAST_LABELS` different ones or more are the blocks in place of the runs.
    apart : bool
        Whether each label has constants of its own: there are runs of the rows of each, then.
    noun : str
        What labels are, for people.
    """
    names, own = np.unique(np.asarray(labels, dtype=np.str_), return_inverse=True)
    rows = len(own)
    if not apart and len(names) >= LEAST_LABELS:
        return Blocks(own.astype(np.int64), len(names) - 1, f"{len(names)} {noun}")
    groups = [np.flatnonzero(own == k) for k in range(len(names))] if apart else [np.arange(rows)]
    of_row, count, fewest = np.zeros(rows, dtype=np.int64), 0, RUNS
    for group in groups:
        runs = min(len(group), RUNS)
        of_row[group] = count + np.arange(len(group)) * runs // len(group)
        count, fewest = count + runs, min(fewest, runs)
    sizes = sorted({int(size) for size in np.bincount(of_row)})
    length = f"{sizes[0]}" if len(sizes) == 1 else f"{sizes[0]} to {sizes[-1]}"
    rule = f"{count} runs of {length} row(s), in the order of the table"
    rule += f", within each of {len(names)} {noun}" if len(groups) > 1 else ""
    return Blocks(of_row, fewest - 1, rule)


def draw_rows(
    blocks: Blocks, parts: Sequence[NDArray[np.int64]], *, random: np.random.Generator
) -> Places:
    """Return rows of blocks drawn with replacement, as many as each part of the rows has."""
    rows: list[Places] = []
    for part in parts:
        own = np.unique(blocks.of_row[part])
        for block in random.choice(own, size=len(own)):
            rows.append(part[blocks.of_row[part] == block])
    return np.sort(np.concatenate(rows))


@dataclass(frozen=True)
class FitCovariance:
    """Covariance of what was fitted.

    Parameters
    ----------
    covariance : ndarray, shape (k, k)
    freedom : int
        Degrees of freedom, for Student's factor.
    rule : str
        What counts as independent, for people.
    """

    covariance: Floats
    freedom: int
    rule: str

    @property
    def deviations(self) -> Floats:
        """Standard errors (k,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def factor(self) -> float:
        """Half of a 95 % interval, in standard errors."""
        from scipy.stats import t as student

        return float(student.ppf(0.975, self.freedom))

    def describe(self) -> str:
        """Return what the intervals take as independent, and what they do not cover."""
        return (
            f"intervals: 95 %, {self.rule}; they hold if the model is right, for rows like these: "
            "others can ask for other constants"
        )


def measure_spread(
    jacobian: Floats,
    misfit: Floats,
    blocks: Blocks,
    *,
    rows: Places | None = None,
    weights: tuple[Floats, Floats] | None = None,
    lost: bool = False,
) -> FitCovariance:
    """Return the covariance at a minimum: the jackknife of blocks, linearised.

    Where one block alone determines a constant, or there is one block only, nothing is known of how
    blocks differ: rows then count as independent, and the rule says so.

    Parameters
    ----------
    jacobian : ndarray, shape (n, k)
        Derivatives of the misfits.
    misfit : ndarray, shape (n,)
    blocks : Blocks
    rows : ndarray of int, shape (n,), optional
        Row of each misfit, where a row has several.
    weights : tuple of ndarray, optional
        Of a robust loss, (n,) each: influence over misfit, and slope of the influence.
    lost : bool
        Whether what is not determined at all has its huge variance, in place of 0.
    """
    weight, rate = (np.ones(len(misfit)),) * 2 if weights is None else weights
    block = blocks.of_row if rows is None else blocks.of_row[rows]
    known = determine(jacobian * np.sqrt(rate)[:, None])
    kept = known.kept
    # In coordinates of which the normal matrix is the identity.
    back = known.basis[kept].T / known.singular[kept] / known.lengths[:, None]
    scores = jacobian @ back
    order = np.argsort(block, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(block[order])) + 1)
    changes = []
    for part in parts if len(parts) > 1 else ():
        own = scores[part]
        left = np.eye(len(back.T)) - (own.T * rate[part]) @ own
        if np.linalg.eigvalsh(left).min(initial=1.0) < ALONE:
            break
        changes.append(np.linalg.solve(left, own.T @ (weight * misfit)[part]))
    freedom = max(len(misfit) - jacobian.shape[1], 1)
    square = float(weight @ misfit**2) / freedom
    if len(changes) == len(parts):
        steps = np.array(changes) @ back.T
        covariance = (1.0 - 1.0 / len(parts)) * steps.T @ steps
        freedom, rule = max(blocks.freedom, 1), f"{blocks.rule}, count as independent"
    else:
        covariance = square * back @ back.T
        rule = "rows count as independent, as one block of them alone determines a constant: if "
        rule += "rows err alike they are too short"
    if lost:
        away = known.basis[~kept].T / known.singular[~kept] / known.lengths[:, None]
        covariance = covariance + square * away @ away.T
    return FitCovariance(covariance, freedom, rule)


def find_lost(found: Determination) -> list[tuple[tuple[int, ...], int]]:
    """Return sets of parameters that are not determined, and how many of each set are."""
    null = found.basis[~found.kept]
    share = null.T @ null
    members = [int(i) for i in np.flatnonzero(np.diag(share) > 1e-2)]
    groups: list[list[int]] = []
    for i in members:
        near = [group for group in groups if any(abs(share[i, j]) > 1e-2 for j in group)]
        groups = [group for group in groups if group not in near] + [sum(near, [i])]
    sets = [tuple(sorted(group)) for group in groups]
    return [(one, len(one) - round(float(sum(share[i, i] for i in one)))) for one in sets]


def describe_lost(names: Sequence[str], found: Determination) -> list[str]:
    """Return a sentence for each set of parameters that the data do not determine."""
    words = []
    for members, rank in find_lost(found):
        own = [names[i] for i in members]
        if len(own) == 1:
            words.append(f"{own[0]} has no effect at these rows: it is not determined")
        else:
            most = f"only {rank}" if rank else "none"
            words.append(
                f"{', '.join(own[:-1])} and {own[-1]}: {most} of these {len(own)} "
                f"{'is' if rank == 1 else 'are'} determined"
            )
    return words


def judge_fit(free: Sequence[str], correlations: Floats, condition: float) -> list[str]:
    """Return warnings on what a fit could not determine."""
    warnings = []
    if condition > CONDITION_LIMIT:
        warnings.append(
            f"the data determine the parameters poorly: condition {condition:.0f} is above "
            f"{CONDITION_LIMIT:.0f}"
        )
    for i, j in combinations(range(len(free)), 2):
        if abs(correlations[i, j]) > CORRELATION_LIMIT:
            warnings.append(
                f"{free[i]} and {free[j]} cannot be distinguished: correlation "
                f"{correlations[i, j]:+.3f}"
            )
    return warnings


def find_conformal_limit(scores: Floats, level: float) -> float:
    """Return what a share of new scores stays within, from scores of rows left out.

    The ``ceil((n + 1) level)``-th smallest of the n that are finite, or the largest where they are
    too few: split conformal prediction (Vovk, Gammerman, Shafer, *Algorithmic Learning in a Random
    World*, 2005).
    """
    known = np.sort(scores[np.isfinite(scores)])
    return float(known[min(math.ceil((len(known) + 1) * level), len(known)) - 1])

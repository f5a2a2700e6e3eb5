"""What a least-squares fit has determined: covariance, correlations, and what it has not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

CONDITION_LIMIT = 30.0
"""Above this condition of the Jacobian, its columns scaled to length 1, a warning is given."""
CORRELATION_LIMIT = 0.98
"""Above this correlation of two parameters a warning is given."""
LOST = 1e-3
"""Singular value of the scaled Jacobian, as a share of the largest, that counts as none."""
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
    def sound_inverse(self) -> Floats:
        """`inverse` in what is determined, and 0 across it."""
        kept = self.singular >= LOST * self.singular[0]
        basis = self.basis[kept] / self.lengths
        return np.asarray((basis.T / self.singular[kept] ** 2) @ basis)


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
        condition=float(singular[0] / singular[-1]),
        singular=singular,
        basis=basis,
        lengths=length,
    )


def find_lost(found: Determination) -> list[tuple[tuple[int, ...], int]]:
    """Return sets of parameters that are not determined, and how many of each set are."""
    null = found.basis[found.singular < LOST * found.singular[0]]
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

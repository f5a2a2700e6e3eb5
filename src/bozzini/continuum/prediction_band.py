"""How far predictions of a fitted robot miss, by kind of motion, from rows left out of the fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..errors import InputError
from ..numeric.arrays import Floats
from ..numeric.estimation import find_conformal_limit
from ..results import Json, Shown

MOVES = 0.2
"""Share of the largest bend of a section from which on it counts as moved."""
ENOUGH = 40
"""Rows left out of a kind of motion from which on it has a radius of its own."""
FURTHER = 1.2
"""Times the largest bend of a section in the fit: a row that bends more is of another kind."""
LEVEL = 0.95
SLACK = 0.1
"""Share of points by which a band may hold less than it promises before that is told."""
REST = "rest"
"""Kind of motion of a row in which no section moves."""


def name_kinds(bends: Floats, largest: Floats, names: tuple[str, ...]) -> NDArray[np.str_]:
    """Return the kind of motion of each row (n,): the sections that bend, as ``1+3``.

    A row in which a section bends further than any of the fit did is of a kind of its own.

    Parameters
    ----------
    bends : ndarray, shape (n, s)
        How far each section turns [rad].
    largest : ndarray, shape (s,)
        The largest that each turned in what was fitted [rad].
    names : tuple of str
        Of the sections.
    """
    known = np.nan_to_num(bends)
    moved = _find_moved(known, largest)
    further = np.any(known > FURTHER * largest, axis=-1).tolist()
    kinds = ["+".join(np.array(names)[row]) or REST for row in moved]
    return np.array(
        [f"{kind} further" if more else kind for kind, more in zip(kinds, further, strict=True)],
        dtype=np.str_,
    )


def _find_moved(bends: Floats, largest: Floats) -> NDArray[np.bool_]:
    return np.asarray(bends > MOVES * np.where(largest > 0.0, largest, np.inf))


@dataclass(frozen=True, kw_only=True)
class PredictionBand(Shown):
    """Distances that predictions stay within, by kind of motion and marker.

    A radius is the quantile of the distances of rows that were left out of the fit (split
    conformal: Vovk, Gammerman, Shafer, *Algorithmic Learning in a Random World*, 2005): it holds
    for rows that are like these. A kind of fewer than 40 rows has the radius of all rows, or, if
    larger, of those in which as many sections move or more (of one less if these are too few, and
    so on): many rows in which little moves would hide that what moves more is missed by more. What
    moves sections together in a way that no row of the fit does, or further, is of no kind that
    was seen: nothing is known of it, and the widest radius stands for it. Kinds tell how far
    sections bend, not to which side: rows that bend to a side not seen may miss by more.

    Parameters
    ----------
    level : float
        Share of predictions that stay within; less than was asked for where rows are few.
    markers : tuple of str
    sections : tuple of str
        Names of the sections.
    largest_bends : tuple of float
        Of each section in the fit [rad]; it counts as moved from a fifth of that on.
    radii : mapping of str to tuple of float
        Of each kind, a radius for each marker [mm].
    rows : mapping of str to int
        How many rows of each kind were left out.
    coverage : float
        Share of the points left out that a band made without their block holds; 0 where no marker
        is in more than one.

    Raises
    ------
    InputError
        If a value is outside its legal range, or there is not one for each section or marker.
    """

    level: float
    markers: tuple[str, ...]
    sections: tuple[str, ...]
    largest_bends: tuple[float, ...]
    radii: Mapping[str, tuple[float, ...]]
    rows: Mapping[str, int]
    coverage: float

    def __post_init__(self) -> None:
        check_number("band level", self.level, low=0.0, high=1.0)
        check_number("band coverage", self.coverage, low=0.0, high=1.0)
        for bend in self.largest_bends:
            check_number("band largest_bends", bend, low=0.0, unit="rad")
        if len(self.largest_bends) != len(self.sections):
            raise InputError(
                f"the band has {len(self.largest_bends)} largest_bends: it must have one for each "
                f"of its {len(self.sections)} sections"
            )
        if not self.radii or set(self.radii) != set(self.rows):
            raise InputError(
                f"the band has radii of {', '.join(self.radii) or 'no kind'} and rows of "
                f"{', '.join(self.rows) or 'no kind'}: they must be of the same kinds, at least one"
            )
        for kind, values in self.radii.items():
            if len(values) != len(self.markers):
                raise InputError(
                    f"the band has {len(values)} radii of '{kind}': it must have one for each of "
                    f"its {len(self.markers)} markers"
                )
            for value in values:
                check_number(f"band radius of '{kind}'", value, low=0.0, unit="mm")

    @property
    def widest(self) -> tuple[float, ...]:
        """Largest radius of each marker, which holds for no kind that was not seen [mm]."""
        return tuple(np.max(np.array(list(self.radii.values())), axis=0).tolist())

    def name_kinds(self, bends: Floats) -> NDArray[np.str_]:
        """Return the kinds of motion (n,) of rows with bends (n, s) [rad]."""
        return name_kinds(bends, np.array(self.largest_bends), self.sections)

    def find_radii(self, kinds: NDArray[np.str_]) -> Floats:
        """Return the radii (n, m) [mm] of rows by their kinds (n,), the widest of unseen ones."""
        return np.array([self.radii.get(str(kind), self.widest) for kind in kinds])

    def find_unseen(self, kinds: NDArray[np.str_]) -> NDArray[np.bool_]:
        """Return which rows (n,) are of a kind that was not seen in the fit."""
        return ~np.isin(kinds, list(self.radii))

    def to_dict(self) -> Json:
        """Return the band as plain values."""
        return {
            "level": self.level,
            "markers": self.markers,
            "sections": self.sections,
            "largest_bends_rad": self.largest_bends,
            "radii_mm": dict(self.radii),
            "rows": dict(self.rows),
            "coverage": self.coverage,
        }

    def describe(self) -> str:
        """Return the radii in words."""
        shown = [
            f"{kind} {'/'.join(f'{value:.3g}' for value in values)}"
            + ("" if self.rows[kind] >= ENOUGH else "*")
            for kind, values in self.radii.items()
        ]
        pooled = any(count < ENOUGH for count in self.rows.values())
        many = f" of {', '.join(self.markers)}" if len(self.markers) > 1 else ""
        few = f", * of fewer than {ENOUGH} rows: with others" if pooled else ""
        return (
            f"{self.level:.0%} of predictions{many} are within [mm], by the sections that move: "
            f"{', '.join(shown)}{few}; of motions not among these nothing is known; of rows left "
            f"out {self.coverage:.1%} are within a band made without their block"
        )


def _make_radii(
    distances: Floats, kinds: NDArray[np.str_], moved: NDArray[np.int64], level: float
) -> dict[str, tuple[float, ...]]:
    """Return the radii by kind; `moved` (n,) are how many sections of each row move."""
    radii = {}
    for kind in np.unique(kinds):
        own, least = kinds == kind, int(moved[kinds == kind][0])
        harder = [own, *(moved >= count for count in range(least, -1, -1))]
        radii[str(kind)] = tuple(_find_radius(column, harder, level) for column in distances.T)
    return radii


def _find_radius(distances: Floats, pools: list[NDArray[np.bool_]], level: float) -> float:
    """Return the radius of the first pool with enough rows; but for the first, at least of all."""
    seen = [distances[pool & np.isfinite(distances)] for pool in pools]
    chosen = next((own for own in seen if len(own) >= ENOUGH), seen[-1])
    radius = find_conformal_limit(chosen, level)
    return radius if chosen is seen[0] else max(radius, find_conformal_limit(seen[-1], level))


def make_band(
    distances: Floats,
    bends: Floats,
    blocks: NDArray[np.int64],
    *,
    markers: tuple[str, ...],
    sections: tuple[str, ...],
    level: float = LEVEL,
) -> PredictionBand:
    """Return the band of predictions from the distances of rows left out.

    Parameters
    ----------
    distances : ndarray, shape (n, m)
        From predicted to measured [mm]; NaN where a point was not seen.
    bends : ndarray, shape (n, s)
        How far each section turns, as predicted [rad].
    blocks : ndarray of int, shape (n,)
        Which rows were left out together.
    """
    largest = np.nanmax(np.nan_to_num(bends), axis=0)
    kinds = name_kinds(bends, largest, sections)
    moved = _find_moved(np.nan_to_num(bends), largest).sum(axis=-1)
    held, judged, seen = 0, 0, np.isfinite(distances)
    for block in np.unique(blocks):
        out = blocks == block
        if not seen[~out].any(axis=0).all():
            continue
        radii = _make_radii(distances[~out], kinds[~out], moved[~out], level)
        widest = np.max(np.array(list(radii.values())), axis=0)
        limits = np.array([radii.get(str(kind), widest) for kind in kinds[out]])
        held += int((distances[out] <= limits).sum())
        judged += int(seen[out].sum())
    fewest = int(seen.sum(axis=0).min())
    return PredictionBand(
        level=min(level, fewest / (fewest + 1.0)),
        markers=markers,
        sections=sections,
        largest_bends=tuple(largest.tolist()),
        radii=_make_radii(distances, kinds, moved, level),
        rows={str(kind): int((kinds == kind).sum()) for kind in np.unique(kinds)},
        coverage=held / max(judged, 1),
    )

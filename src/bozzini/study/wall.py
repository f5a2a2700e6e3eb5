"""How likely a planned motion touches a wall that is not quite where it is said to be.

Two errors of the wall are taken. A uniform one moves it inwards by the same everywhere: that takes
exactly as much off every distance inside, so that contact is a question of the certificate. A
random field ``mean + sd g(q)`` has errors of its own along the way. Its draws are sums of
waves (random Fourier features: Rahimi and Recht, NIPS 2007), so that any place can be asked and no
matrix is needed.

With the field a point of the body at the distance d from the wall, q being the nearest place of
it, comes to ``d - mean - sd g(q)``: to first order, where the field changes little over d and is
not steep. The body is sampled once, and a draw is then a sum over some hundred places.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_fields, check_integer, check_points, quantity
from ..duct.base import Duct
from ..errors import InputError
from ..motion.certify import Certificate, find_waiting
from ..motion.plan import Plan
from ..motion.recheck import EntryTube, TriangleWall
from ..motion.space import FreeSpace
from ..numeric.arrays import Floats
from ..plot.plan_data import read_centreline
from ..progress import Progress, no_progress
from ..results import Json

Interval = tuple[float, float]

FEATURES = 400
"""Waves of a draw."""

PITCH_MM, CUBE_MM = 0.25, 0.5
"""The body is sampled so often along its links, and of a cube one sample is kept."""

STEPS = 64
"""Steps that are sampled at a time."""

CELL, CELL_ALONG = 0.1, 0.2
"""Of samples with their places of the wall in one cell, of this times the correlation length, the
nearest counts: for contact, and along the way."""

REACH, SPARE_MM = 4.0, 0.3
"""A sample may decide if it is nearer to the wall than so many deviations and so much more."""

STATION_MM, STATION_DRAWS = 2.0, 1000
"""Along the way: length of a station, and how many of the draws are evaluated there."""

QUANTILES = (0.05, 0.5, 0.95)

BLOCK = 128
"""Places of a field that are evaluated at a time: so few stay in the cache."""


@dataclass(frozen=True, kw_only=True)
class WallError:
    """By how much the true wall is farther inwards than the given one, along its normal.

    A stationary Gaussian field, to within what 400 waves in a draw give.

    Parameters
    ----------
    sd : float
        Standard deviation [mm].
    correlation : float
        Places that are h apart have the correlation ``exp(-h^2 / 2 correlation^2)`` [mm].
    mean : float
        [mm].
    """

    sd: float = quantity("length", low=0.0, low_open=True, high=20.0)
    correlation: float = quantity("length", default=10.0, low=0.1, high=1e4)
    mean: float = quantity("length", default=0.0, low=-20.0, high=20.0)

    def __post_init__(self) -> None:
        check_fields(self)

    def draw(self, points: ArrayLike, *, seed: int, number: int) -> Floats:
        """Return one draw at places (n, 3): how far inwards the wall is there, (n,) [mm].

        Parameters
        ----------
        points : (n, 3) float
            World frame [mm].
        seed, number : int
            The draw depends on these two alone, whatever else was drawn before.
        """
        places = check_points("points", points)
        check_integer("seed", seed, low=0)
        random = np.random.default_rng((seed, check_integer("number", number, low=0)))
        waves = random.standard_normal((FEATURES, 3)) / self.correlation
        phases = random.uniform(0.0, 2.0 * math.pi, FEATURES)
        total = np.empty(len(places))
        for begin in range(0, len(places), BLOCK):
            some = places[begin : begin + BLOCK]
            # Written out: a product of matrices may round otherwise for another number of rows.
            phase = some[:, :1] * waves[:, 0] + phases
            for k in (1, 2):
                phase += some[:, k : k + 1] * waves[:, k]
            # In single precision a cosine is off by 1e-5 at most, and takes a quarter of the time.
            total[begin : begin + BLOCK] = np.cos(phase.astype(np.float32)).sum(axis=1)
        return np.asarray(self.mean + self.sd * math.sqrt(2.0 / FEATURES) * total)

    def bound_contact(self, certificate: Certificate) -> Interval:
        """Return bounds of the probability of contact if the error is the same everywhere."""
        from scipy.stats import norm

        return bound_contact(certificate, norm(self.mean, self.sd))


def bound_contact(certificate: Certificate, offset: object) -> Interval:
    """Return bounds of the probability that a wall moved inwards by a random offset is touched.

    The wall is moved by the same everywhere. That takes as much off every distance inside, so that
    there is contact if and only if the offset exceeds the plan's clearance.

    Parameters
    ----------
    certificate : Certificate
        With a small tolerance, such as 0.003 mm: see `bozzini.motion.certify_plan`.
    offset : frozen distribution of SciPy
        How far inwards the wall is moved [mm]: ``scipy.stats.norm(0.0, 0.5)``.

    Returns
    -------
    low, high : float
        `high` is proved: the tail at the certified clearance; 1 where none is certified. `low` is
        the tail at the smallest clearance found. It is proved where the duct is exact; in a sampled
        field that clearance is a lower bound itself, and `low` too large by its looseness.
    """
    tail = getattr(offset, "sf", None)
    if tail is None:
        raise InputError(
            f"the offset is a {type(offset).__name__}: it must be a distribution of scipy.stats, "
            "with its parameters"
        )
    if certificate.clearance == math.inf:  # it never leaves the introducer
        return 0.0, 0.0
    high = float(tail(certificate.clearance)) if certificate.certified else 1.0
    return min(float(tail(certificate.found)), high), high


def count_interval(hits: int, count: int) -> Interval:
    """Return the 95 % interval (Clopper and Pearson) of what `hits` of `count` draws had."""
    from scipy.stats import binomtest

    found = binomtest(hits, count).proportion_ci(0.95, method="exact")
    return float(found.low), float(found.high)


# The body, once: which of its points may touch the wall, and where on the wall that is.


@dataclass(frozen=True, kw_only=True, eq=False)
class BodySamples:
    """Places of a body's axis in a motion, and of the wall, that are near to each other.

    They are places of the axis, each with the nearest place of the wall; and corners of the wall,
    each with the nearest of these. Without the second a body in the middle of a round tube, which
    is near to the wall all round, would touch it on one side only.

    Parameters
    ----------
    points : (n, 3) float
        Of the axis, world frame [mm].
    distance : (n,) float
        From there to the wall, negative outside [mm].
    foot : (n, 3) float
        The place of the wall [mm].
    place : (n,) float
        Arc length of the centreline beside it [mm].
    insertion : (n,) float
        Arc length of the head along its path then [mm].
    """

    points: Floats
    distance: Floats
    foot: Floats
    place: Floats
    insertion: Floats

    def take(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> BodySamples:
        """Return some of them."""
        names = ("points", "distance", "foot", "place", "insertion")
        return BodySamples(**{name: getattr(self, name)[chosen] for name in names})

    def thin(self, cell: float, station: NDArray[np.int64] | None = None) -> BodySamples:
        """Keep the nearest of those whose feet are in one cell, and of one station."""
        keys = np.floor(self.foot / cell).astype(np.int64)
        if station is not None:
            keys = np.column_stack([keys, station])
        _, groups = np.unique(keys, axis=0, return_inverse=True)
        return self.take(_find_least(groups.reshape(-1), self.distance))


def _find_least(groups: NDArray[np.int64], values: Floats) -> NDArray[np.int64]:
    """Return the index of the smallest value of each group."""
    order = np.lexsort((values, groups))
    return np.asarray(order[np.diff(groups[order], prepend=-1) != 0])


def sample_body(plan: Plan, duct: Duct, wall: TriangleWall) -> BodySamples:
    """Sample a body over a motion, and measure the exact distances to the wall.

    Of each cube of 0.5 mm the place of the axis that is nearest to the wall is taken. What stands
    in the introducer is left out, as by the certificate.

    Parameters
    ----------
    plan : Plan
    duct : Duct
        The lumen that it was made in: it chooses the sample of a cube.
    wall : TriangleWall
        Before inflation; the plan's is added to its distances.

    Raises
    ------
    InputError
        If the plan is planar, or the body never leaves the introducer.
    """
    joints = plan.joints
    if joints.shape[2] != 3:
        raise InputError("the plan has 2 dimensions: a wall's error is drawn in 3")
    radius, length = plan.get_scope().radius, plan.get_scope().link_length
    space, tube = FreeSpace(duct, None, plan.introducer), None
    waiting = find_waiting(joints, space, radius=radius)
    if plan.introducer is not None:
        entry, outward = plan.introducer.entry, plan.introducer.outward
        tube = EntryTube(
            entry=entry, outward=outward, bore=float(space.pack_exempt(radius).introducer[6])
        )
    shares = np.linspace(0.0, 1.0, max(2, math.ceil(length / PITCH_MM) + 1))[:, None]
    low = joints.min(axis=(0, 1)) - CUBE_MM
    sides = np.ceil((joints.max(axis=(0, 1)) - low) / CUBE_MM).astype(np.int64) + 2
    kept: list[tuple[Floats, NDArray[np.int64], NDArray[np.int64], Floats]] = []
    for begin in range(0, len(joints), STEPS):
        block = np.arange(begin, min(begin + STEPS, len(joints)))
        # A link with its head in the introducer is there as a whole.
        row, link = np.nonzero(np.arange(joints.shape[1] - 1) < waiting[block, None])
        step = block[row]
        heads, tails = joints[step, link], joints[step, link + 1]
        points = heads[:, None] + shares * (tails - heads)[:, None]
        free = np.ones(points.shape[:2], dtype=bool)
        edge = link + 1 >= waiting[step]
        if tube is not None:
            free[edge] = ~tube.holds(points[edge], radius)
        flat, steps = points[free], np.repeat(step, free.sum(axis=1))
        depth = duct.signed_distance(flat)
        cube = np.ravel_multi_index(
            tuple(np.floor((flat - low) / CUBE_MM).astype(np.int64).T), tuple(sides)
        )
        best = _find_least(cube, -depth)
        kept.append((flat[best], steps[best], cube[best], -depth[best]))
    points, steps, cubes, clearance = (np.concatenate(column) for column in zip(*kept, strict=True))
    if not len(points):
        raise InputError("the scope never leaves the introducer: there is no wall to touch")
    best = _find_least(cubes, clearance)
    points, steps = points[best], steps[best]
    distance, foot = wall.find_nearest(points)
    distance = np.where(wall.is_inside(points), distance, -distance) + plan.inflation
    from scipy.spatial import KDTree

    line = read_centreline(plan)
    place = line.arc_length[KDTree(line.points).query(points)[1]]
    # The other way round: of each corner of the wall the nearest of these.
    corners = wall.vertices[np.unique(wall.faces)]
    away, near = KDTree(points).query(corners)
    every = np.concatenate([np.arange(len(points)), near])
    return BodySamples(
        points=points[every],
        distance=np.concatenate([distance, away + plan.inflation]),
        foot=np.concatenate([foot, corners]),
        place=place[every],
        insertion=plan.head_arc_length[steps[every]],
    )


# Draws in which the plan is kept.


@dataclass(frozen=True, kw_only=True, eq=False)
class Stations:
    """The clearance along the way over draws, in stations of 2 mm of the centreline.

    Parameters
    ----------
    place : (k,) float
        Middle of each [mm].
    nominal : (k,) float
        The clearance without an error [mm].
    quantiles : (k, 3) float
        5, 50 and 95 % of the draws [mm].
    contact : (k,) float
        Share of the draws with contact there.
    draws : int
    """

    place: Floats
    nominal: Floats
    quantiles: Floats
    contact: Floats
    draws: int

    def list_columns(self) -> Json:
        """Return the columns of a table, a row each station."""
        return {
            "place_mm": self.place,
            "clearance_mm": self.nominal,
            **{
                f"clearance_{round(100 * q)}_percent_mm": self.quantiles[:, k]
                for k, q in enumerate(QUANTILES)
            },
            "contact": self.contact,
        }


def draw_reaches(
    samples: BodySamples,
    error: WallError,
    *,
    seed: int,
    numbers: range,
    progress: Progress = no_progress,
) -> tuple[Floats, NDArray[np.int64]]:
    """Return how near to the wall each draw brings the body's axis, and at which sample.

    Parameters
    ----------
    samples : BodySamples
    error : WallError
    seed : int
    numbers : range
        Which draws.
    progress : Progress

    Returns
    -------
    reach : (n,) float
        A body of a larger radius touches the wall [mm].
    closest : (n,) int
    """
    reach = np.empty(len(numbers))
    closest = np.empty(len(numbers), dtype=np.int64)
    for k, number in enumerate(numbers):
        if k % 100 == 0:
            progress("draw", k / len(numbers))
        left = samples.distance - error.draw(samples.foot, seed=seed, number=number)
        closest[k] = np.argmin(left)
        reach[k] = left[closest[k]]
    progress("draw", 1.0)
    return reach, closest


def choose_deciding(samples: BodySamples, error: WallError, radius: float) -> BodySamples:
    """Return the samples that may be the nearest to the wall, or touch it, in a draw.

    Parameters
    ----------
    samples : BodySamples
    error : WallError
    radius : float
        Of the widest body that is asked for [mm].
    """
    near = max(float(samples.distance.min()), radius + error.mean)
    chosen = samples.take(samples.distance < near + REACH * error.sd + SPARE_MM)
    return chosen.thin(CELL * error.correlation)


def draw_stations(
    samples: BodySamples, error: WallError, *, radius: float, seed: int, draws: int
) -> Stations:
    """Return the distribution of the clearance along the way."""
    numbers = np.floor(samples.place / STATION_MM).astype(np.int64)
    known, station = np.unique(numbers, return_inverse=True)
    least = np.full(len(known), np.inf)
    np.minimum.at(least, station, samples.distance)
    near = samples.distance < least[station] + REACH * error.sd + SPARE_MM
    chosen = samples.take(near).thin(CELL_ALONG * error.correlation, station[near])
    station = np.searchsorted(known, np.floor(chosen.place / STATION_MM).astype(np.int64))
    order = np.argsort(station, kind="stable")
    chosen, first = chosen.take(order), np.searchsorted(station[order], np.arange(len(known)))
    left = np.empty((min(draws, STATION_DRAWS), len(known)))
    for number in range(len(left)):
        moved = chosen.distance - error.draw(chosen.foot, seed=seed, number=number)
        left[number] = np.minimum.reduceat(moved, first)
    return Stations(
        place=STATION_MM * (known.astype(np.float64) + 0.5),
        nominal=least - radius,
        quantiles=np.quantile(left - radius, QUANTILES, axis=0).T,
        contact=(left < radius).mean(axis=0),
        draws=len(left),
    )

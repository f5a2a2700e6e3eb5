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

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..anatomy.tract import LabelTract, SurfaceTract
from ..checks import check_fields, check_integer, check_kind, check_points, quantity
from ..duct.base import Duct
from ..duct.field import SampledField, build_field
from ..duct.moving import MovingField
from ..errors import BozziniError, InputError
from ..motion.certify import Certificate
from ..motion.moving import ReplanOptions, replan
from ..motion.plan import Plan
from ..motion.recheck import Tube, Wall
from ..motion.space import FreeSpace, grid_of
from ..motion.verify import build_wall, certify_plan, rebuild_field
from ..plot.plan_data import read_centreline
from ..progress import Progress, no_progress
from ..results import Json, Result, measured, to_plain
from .options import ContactOptions

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..report.short_page import ShortPage

Floats = NDArray[np.float64]
Interval = tuple[float, float]

FEATURES = 400
"""Waves of a draw."""

TOLERANCE_MM = 0.003
"""Of the certificate: for probabilities the bound must be near to what is found."""

PITCH_MM, CUBE_MM = 0.25, 0.5
"""The body is sampled so often along its links, and of a cube one sample is kept."""

STEPS = 64
"""Steps that are sampled at a time."""

CELL, CELL_ALONG = 0.05, 0.2
"""Samples whose nearest places of the wall lie in one cell, of this times the correlation length,
count as one: for contact, and along the way."""

REACH, SPARE_MM = 4.0, 0.3
"""A sample may decide if it is nearer to the wall than so many deviations and so much more."""

STATION_MM, STATION_DRAWS = 2.0, 1000
"""Along the way: length of a station, and how many of the draws are evaluated there."""

QUANTILES = (0.05, 0.5, 0.95)

BLOCK = 4096
"""Places of a field that are evaluated at a time."""

NEAR, STEEP = 2.0, 0.07
"""First order is said to be doubtful where the correlation length is less than so many times the
distance to the wall, or the deviation more than so much of it."""


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
    """Return the 95 % interval of a probability of which `count` draws had `hits` (Clopper and
    Pearson).
    """
    from scipy.stats import binomtest

    found = binomtest(hits, count).proportion_ci(0.95, method="exact")
    return float(found.low), float(found.high)


# The body, once: which of its points may touch the wall, and where on the wall that is.


@dataclass(frozen=True, kw_only=True, eq=False)
class BodySamples:
    """Points of a body's axis in a motion, the nearest to the wall of each small cube.

    Parameters
    ----------
    points : (n, 3) float
        World frame [mm].
    distance : (n,) float
        To the wall, exact; negative outside [mm].
    foot : (n, 3) float
        The nearest place of the wall [mm].
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
        """Keep of those whose feet are in one cell, and of one station, that with the least
        distance.
        """
        keys = np.floor(self.foot / cell).astype(np.int64)
        if station is not None:
            keys = np.column_stack([keys, station])
        _, groups = np.unique(keys, axis=0, return_inverse=True)
        return self.take(_find_least(groups.reshape(-1), self.distance))


def _find_least(groups: NDArray[np.int64], values: Floats) -> NDArray[np.int64]:
    """Return the index of the smallest value of each group."""
    order = np.lexsort((values, groups))
    return order[np.diff(groups[order], prepend=-1) != 0]


def sample_body(plan: Plan, duct: Duct, wall: Wall) -> BodySamples:
    """Sample a body over a motion, and measure the exact distances to the wall.

    What stands in the introducer is left out, as by the certificate.

    Parameters
    ----------
    plan : Plan
    duct : Duct
        The lumen that it was made in: it chooses the sample of a cube.
    wall : Wall
        Before inflation; the plan's is added to its distances.

    Raises
    ------
    InputError
        If the plan is planar, or the body never leaves the introducer.
    """
    joints = plan.joints
    if joints.shape[2] != 3:
        raise InputError("the plan has 2 dimensions: a wall's error is drawn in 3")
    waiting, tube = _find_waiting(plan, duct)
    radius, length = plan.get_scope().radius, plan.get_scope().link_length
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
    return BodySamples(
        points=points,
        distance=distance,
        foot=foot,
        place=line.arc_length[KDTree(line.points).query(points)[1]],
        insertion=plan.head_arc_length[steps],
    )


def _find_waiting(plan: Plan, duct: Duct) -> tuple[NDArray[np.int64], Tube | None]:
    """Return from which joint on the chain stands in the introducer, and that as it counts."""
    from ..motion.kernels.certify import mark_introduced

    introducer, radius = plan.introducer, plan.get_scope().radius
    waiting = np.full(plan.steps, plan.links + 1, dtype=np.int64)
    if introducer is None:
        return waiting, None
    bore = min(introducer.bore, max(float(duct.clearance_bound(introducer.entry)), radius))
    packed = FreeSpace(duct, introducer=introducer).intro.copy()
    packed[6] = bore
    mark_introduced(np.ascontiguousarray(duct.to_grid(plan.joints)), packed, radius, waiting)
    return waiting, Tube(entry=introducer.entry, outward=introducer.outward, bore=bore)


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
        place=(known + 0.5) * STATION_MM,
        nominal=least - radius,
        quantiles=np.quantile(left - radius, QUANTILES, axis=0).T,
        contact=(left < radius).mean(axis=0),
        draws=len(left),
    )


# Draws in which it is planned anew.


@dataclass(frozen=True, kw_only=True, eq=False)
class Replannings:
    """Whether there is a certified plan in each of the first draws, after planning anew.

    Parameters
    ----------
    clearance : (n,) float
        What is certified [mm]; NaN where there is no plan.
    kept : (n,) bool
        Whether the head's path served as it was.
    rebuilt : (n,) bool
        Whether the whole field was built anew, and all planners tried.
    reasons : tuple of str
        Why there is none; "" where there is one.
    """

    clearance: Floats
    kept: NDArray[np.bool_]
    rebuilt: NDArray[np.bool_]
    reasons: tuple[str, ...]

    @property
    def failed(self) -> int:
        """In how many there is none."""
        return int(np.isnan(self.clearance).sum())

    @property
    def interval(self) -> Interval:
        """The 95 % interval of the probability that there is none."""
        return count_interval(self.failed, len(self.clearance))


@dataclass(frozen=True, eq=False)
class _WallToMove:
    """The wall as a surface whose vertices are moved along its normals."""

    surface: SurfaceTract
    normals: Floats
    field: SampledField

    @classmethod
    def of(cls, tract: LabelTract | SurfaceTract, duct: Duct) -> _WallToMove:
        from ..scene.make_view import draw_wall

        grid = grid_of(duct)
        if grid is None:
            raise InputError(f"the duct is a {type(duct).__name__}: it must be a sampled field")
        is_own = isinstance(tract, SurfaceTract) and grid.inflation == 0.0
        mesh, _ = draw_wall(tract if is_own else grid, most_faces=2**31 - 1)
        surface = SurfaceTract(
            vertices=mesh.vertices,
            faces=mesh.faces,
            source=tract.source,
            frame=tract.frame,
            wall=tract.wall,
        )
        if not is_own:
            grid = build_field(surface, voxel=float(grid.spacing.max()))
        return cls(surface, mesh.normals, grid)

    def move(self, error: WallError, *, seed: int, number: int) -> Floats:
        """Return where the vertices are in a draw."""
        inwards = error.draw(self.surface.vertices, seed=seed, number=number)
        return self.surface.vertices - inwards[:, None] * self.normals


def displace_wall(
    tract: LabelTract | SurfaceTract,
    error: WallError,
    *,
    seed: int,
    number: int,
    duct: Duct | None = None,
) -> SurfaceTract:
    """Return the wall of a tract in one draw, its vertices moved along their normals.

    Parameters
    ----------
    tract : LabelTract or SurfaceTract
        The wall of labels, or one that is inflated, is the surface at the level of the `duct`.
    error : WallError
    seed, number : int
        Which draw.
    duct : Duct, optional
        The tract's field; built unless given.
    """
    duct = build_field(tract) if duct is None else duct
    wall = _WallToMove.of(tract, duct)
    return replace(wall.surface, vertices=wall.move(error, seed=seed, number=number))


def replan_draws(
    plan: Plan,
    tract: LabelTract | SurfaceTract,
    error: WallError,
    *,
    duct: Duct,
    options: ContactOptions,
    progress: Progress = no_progress,
) -> Replannings:
    """Plan anew in the walls of the first `options.replan` draws.

    The vertices of the wall are moved along their normals. Near the path the distances to the moved
    triangles are measured, each exactly: of a displacement of the wall alone nothing is known
    inside, so that there is no bound to take. The path is bent where it lacks clearance, and what
    is certified decides. Where that fails, the whole field is built anew and the insertion planned
    in full. That no plan is found then is no proof that there is none.

    Raises
    ------
    InputError
        If the plan does not reach its goal, or is the thesis's.
    """
    if plan.status != "complete":
        raise InputError(
            f"the plan stopped ({plan.reason_code}): only one that reaches its goal can be planned "
            "anew"
        )
    wall = _WallToMove.of(tract, duct)
    moving, radius = MovingField(wall.field, wall.surface), plan.get_scope().radius
    clearance = np.full(options.replan, np.nan)
    kept, rebuilt = (np.zeros(options.replan, dtype=bool) for _ in range(2))
    reasons = []
    for number in range(options.replan):
        progress("replan", number / options.replan)
        vertices = wall.move(error, seed=options.seed, number=number)
        try:
            lumen = moving.update(vertices=vertices, path=plan.path, radius=radius)
            found = replan(plan, lumen, options=ReplanOptions(measure=False))
            rebuilt[number] = found.status != "complete" or found.proved is None
            if rebuilt[number]:
                moved = replace(wall.surface, vertices=vertices)
                anew = build_field(moved, voxel=float(wall.field.spacing.max()))
                found = replan(plan, anew, options=ReplanOptions(measure=False))
        except BozziniError as problem:
            reasons.append(str(problem))
            continue
        reasons.append(found.reason)
        if found.status == "complete" and found.proved is None:
            reasons[-1] = "a motion was found, but its clearance could not be certified"
        if not reasons[-1] and found.proved is not None:
            clearance[number] = found.proved
            note = found.replan
            kept[number] = note is not None and note.warm and note.sweeps == 0
    progress("replan", 1.0)
    return Replannings(clearance=clearance, kept=kept, rebuilt=rebuilt, reasons=tuple(reasons))


# All of it: what a plan's wall error comes to.


@dataclass(frozen=True, kw_only=True, eq=False)
class ContactRisk(Result):
    """How likely a plan touches its wall.

    ``n`` counts the draws.

    Attributes
    ----------
    plan : Plan
    error : WallError
    seed : int
    certificate : Certificate
        With a tolerance of 0.003 mm, for the wall as it is given.
    uniform : tuple of float
        Bounds of the probability of contact if the error is the same everywhere.
    clearance : (n,) ndarray
        Of the kept plan in each draw, to first order [mm].
    place, insertion : (n,) ndarray
        Where that is: arc length of the centreline, and of the head then [mm].
    samples, deciding : int
        Samples of the body, and those that a draw evaluates.
    nearest : float
        Smallest exact distance of a sample, less the radius: the clearance is at most this [mm].
    stations : Stations
    diameters : (k,) ndarray
        [mm].
    replanned : Replannings, optional
    notes : tuple of str
        What to know before believing the numbers.
    """

    plan: Plan
    error: WallError
    seed: int
    certificate: Certificate
    uniform: Interval
    clearance: Floats = measured("mm")
    place: Floats = measured("mm")
    insertion: Floats = measured("mm")
    samples: int
    deciding: int
    nearest: float
    stations: Stations
    diameters: Floats
    replanned: Replannings | None = None
    notes: tuple[str, ...] = field(default=())

    @property
    def draws(self) -> int:
        """How many random walls were drawn."""
        return len(self.clearance)

    @property
    def contact(self) -> float:
        """Share of the draws in which the plan, kept, touches the wall."""
        return float((self.clearance < 0.0).mean())

    @property
    def interval(self) -> Interval:
        """The 95 % interval of that probability, by the number of draws alone."""
        return count_interval(int((self.clearance < 0.0).sum()), self.draws)

    @property
    def converged(self) -> bool:
        """Whether the plan is proved clear of the wall as it is given."""
        return self.certificate.certified

    @property
    def reason(self) -> str:
        """Why not."""
        return "" if self.converged else "the plan is not proved clear of the wall as it is given"

    @property
    def residual(self) -> float:
        """Half the width of the interval."""
        low, high = self.interval
        return 0.5 * (high - low)

    @cached_property
    def over_diameters(self) -> Json:
        """The probability over other diameters of the same motion, as columns."""
        radius = self.plan.get_scope().radius
        hits = [int((self.clearance + radius < 0.5 * d).sum()) for d in self.diameters]
        low, high = zip(*(count_interval(k, self.draws) for k in hits), strict=True)
        return {
            "diameter_mm": self.diameters,
            "contact": np.array(hits) / self.draws,
            "contact_low": np.array(low),
            "contact_high": np.array(high),
        }

    def list_columns(self) -> Mapping[str, object]:
        """Return the columns of `to_frame`: a row each draw."""
        columns: Json = {"draw": np.arange(self.draws), **self.list_measured()}
        columns["contact"] = self.clearance < 0.0
        if self.replanned is not None:
            found = self.replanned
            columns["replanned_clearance_mm"] = _fill(found.clearance, self.draws)
        return columns

    def to_dict(self) -> Json:
        """Return the summary as plain values."""
        low, high = self.interval
        summary: Json = {
            "diameter_mm": self.plan.get_scope().diameter,
            "sd_mm": self.error.sd,
            "mean_mm": self.error.mean,
            "correlation_mm": self.error.correlation,
            "seed": self.seed,
            "draws": self.draws,
            "clearance_certified_mm": self.certificate.clearance if self.converged else None,
            "clearance_found_mm": self.certificate.found,
            "clearance_sampled_mm": self.nearest,
            "contact_uniform": {"low": self.uniform[0], "high": self.uniform[1]},
            "contact_kept": {"share": self.contact, "low": low, "high": high},
            "clearance_quantiles_mm": {
                f"{round(100 * q)}_percent": float(np.quantile(self.clearance, q))
                for q in QUANTILES
            },
            "samples": self.samples,
            "deciding": self.deciding,
            "converged": self.converged,
            "reason": self.reason,
            "notes": list(self.notes),
        }
        again = self.replanned
        if again is not None:
            count = len(again.clearance)
            summary["replanned"] = {
                "draws": count,
                "no_plan": {
                    "share": again.failed / count,
                    "low": again.interval[0],
                    "high": again.interval[1],
                },
                "contact_kept_same_draws": float((self.clearance[:count] < 0.0).mean()),
                "path_kept": int(again.kept.sum()),
                "field_built_anew": int(again.rebuilt.sum()),
                "clearance_median_mm": (
                    float(np.nanmedian(again.clearance)) if again.failed < count else None
                ),
                "reasons": sorted({why for why in again.reasons if why})[:5],
            }
        return dict(to_plain(summary))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the distribution of the clearance over the draws, and return the axes."""
        from ..plot.uncertainty import draw_clearances

        return draw_clearances(self.clearance, self.certificate.clearance, ax)

    def draw(self) -> Figure:
        """Draw clearances, the probability over diameters, and both along the way."""
        from ..plot.uncertainty import draw_uncertainty

        return draw_uncertainty(
            self.clearance,
            self.place,
            stations=self.stations.list_columns(),
            diameters=self.over_diameters,
            diameter=self.plan.get_scope().diameter,
            certified=self.certificate.clearance,
        )

    def list_answers(self) -> list[tuple[str, str, str]]:
        """Return what was asked in words, the probability, and between which ends it lies."""
        rows = [
            ("contact, plan kept, error the same everywhere", None, self.uniform),
            (f"contact, plan kept, random wall, {self.draws} draws", self.contact, self.interval),
        ]
        again = self.replanned
        if again is not None:
            count = len(again.clearance)
            kept = int((self.clearance[:count] < 0.0).sum())
            rows += [
                (
                    f"contact, plan kept, the first {count} of them",
                    kept / count,
                    count_interval(kept, count),
                ),
                (
                    f"no certified plan after planning anew, the same {count}",
                    again.failed / count,
                    again.interval,
                ),
            ]
        return [
            (words, "" if share is None else _show_percent(share), _show_interval(ends))
            for words, share, ends in rows
        ]

    def make_page(self) -> ShortPage:
        """Return the report."""
        from ..report.short_page import ShortPage

        error, scope = self.error, self.plan.get_scope()
        source = "" if self.plan.input is None else self.plan.input.file or ""
        low, high = self.interval
        sentence = (
            f"If the plan is kept, the {scope.diameter:g} mm scope touches the wall in "
            f"{_show_percent(self.contact)} of the random walls ({_show_percent(low)} to "
            f"{_show_percent(high)}); error of the wall: standard deviation {error.sd:.3g} mm, "
            f"correlation length {error.correlation:g} mm, mean {error.mean:g} mm inwards."
        )
        worst = int(np.argmax(self.stations.contact))
        rows = [(name, f"{share} ({ends})" if share else ends) for name, share, ends in
                self.list_answers()]  # fmt: skip
        rows += [
            ("certified clearance, no error", f"{self.certificate.clearance:.3f} mm"),
            ("smallest exact distance of a sample, less the radius", f"{self.nearest:.3f} mm"),
            ("clearance in a draw: 5, 50, 95 %", " / ".join(
                f"{value:.2f} mm" for value in np.quantile(self.clearance, QUANTILES))),
            ("most often touched", f"{self.stations.place[worst]:.0f} mm of the centreline, in "
             f"{_show_percent(float(self.stations.contact[worst]))} of {self.stations.draws} draws"),
            ("seed", str(self.seed)),
        ]  # fmt: skip
        touched = bool((self.clearance < 0.0).any())
        return ShortPage(
            title=f"Uncertainty of a plan: {source}" if source else "Uncertainty of a plan",
            label="Contact is likely" if low > 0.5 else "Contact is possible" if touched else
            "No contact in any draw",
            tone="red" if not self.converged or low > 0.5 else "amber" if touched else "green",
            sentence=sentence,
            notes=self.notes,
            figures=[(self.draw(), _CAPTION)],
            rows=rows,
            limitations=_LIMITS if self.replanned is not None else _LIMITS[:-1],
        )  # fmt: skip

    def write(self, folder: Path) -> Json:
        """Write tables, figure and report into a directory, and return the summary."""
        from importlib.util import find_spec

        from .. import plot
        from ..io.files import write_parquet, write_text

        plot.write_figure(self.draw(), folder / "uncertainty.png")
        tables = {"stations": self.stations.list_columns(), "diameters": self.over_diameters}
        for name, columns in tables.items():
            _write_table(columns, folder / f"{name}.csv")
        _write_table(self.list_columns(), folder / "draws.csv")
        if find_spec("pyarrow") is not None:
            write_parquet(folder / "draws.parquet", self.to_frame())
        self.make_page().write(folder / "report.html")
        names = {path.name for path in folder.iterdir()} | {"summary.json"}
        summary = self.to_dict() | {"files": sorted(names)}
        write_text(folder / "summary.json", json.dumps(summary, indent=2, allow_nan=False))
        return summary


_CAPTION = (
    "Clearance of the kept plan over the random walls; the probability over the diameter of the "
    "same motion, with its 95 % interval; clearance along the way; where the least one lies."
)

_LIMITS = (
    "Contact if the plan is kept: the motion as it is, while the wall is another one than it was "
    "planned for. Nobody looks, nothing gives way.",
    "With an error that is the same everywhere there is contact if and only if it exceeds the "
    "clearance: the certificate gives that exactly, the upper end is proved.",
    "With a random wall every narrow place has an error of its own. That makes contact likelier "
    "than an error that is the same everywhere: one of many places is off soon. Which of the two is "
    "true of a scan is not known here.",
    "The random wall is taken to first order: it moves along the normal, changes little over the "
    "distance from the body, and no other part of the wall bulges out. The interval is that of the "
    "number of draws alone.",
    "Standard deviation and correlation length are stated, not measured.",
    "Research software, not a medical device.",
    "No certified plan after planning anew: in each wall it is planned again. That none is found is "
    "no proof that there is none; it counts what this planner and this certificate achieve.",
)


def _show_percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


def _show_interval(ends: Interval) -> str:
    return f"{100.0 * ends[0]:.3g} to {100.0 * ends[1]:.3g} %"


def _write_table(columns: Mapping[str, object], path: Path) -> None:
    import pandas

    pandas.DataFrame(columns).to_csv(path, index=False)


def _fill(values: Floats, count: int) -> Floats:
    return np.concatenate([values, np.full(count - len(values), np.nan)])


def study_contact(
    plan: Plan,
    tract: LabelTract | SurfaceTract,
    *,
    options: ContactOptions | None = None,
    duct: Duct | None = None,
    progress: Progress = no_progress,
) -> ContactRisk:
    """Find how likely a plan touches a wall that is not quite where it is said to be.

    Parameters
    ----------
    plan : Plan
    tract : LabelTract or SurfaceTract
        What it was made from.
    options : ContactOptions, optional
    duct : Duct, optional
        The tract's field as the plan states it; built unless given.
    progress : Progress

    Raises
    ------
    InputError
        If `options.sd` is not given for a surface, the plan is planar, or never leaves the
        introducer; or is to be planned anew and does not reach its goal.
    """
    options = ContactOptions() if options is None else options
    check_kind("plan", plan, Plan)
    sd, notes = _take_sd(tract, options)
    error = WallError(sd=sd, correlation=options.correlation, mean=options.mean)
    duct = rebuild_field(plan, tract, progress=progress) if duct is None else duct
    progress("certify", 0.0)
    certificate = certify_plan(plan, duct, tolerance=TOLERANCE_MM)
    progress("sample", 0.0)
    samples = sample_body(plan, duct, build_wall(tract))
    scope = plan.get_scope()
    diameters = np.array(options.diameters or np.linspace(0.6, 1.2, 13) * scope.diameter)
    deciding = choose_deciding(samples, error, 0.5 * max(diameters.max(), scope.diameter))
    reach, closest = draw_reaches(
        deciding, error, seed=options.seed, numbers=range(options.draws), progress=progress
    )
    progress("stations", 0.0)
    stations = draw_stations(
        samples, error, radius=scope.radius, seed=options.seed, draws=options.draws
    )
    again = None
    if options.replan:
        again = replan_draws(plan, tract, error, duct=duct, options=options, progress=progress)
    nearest = float(samples.distance.min()) - scope.radius
    return ContactRisk(
        plan=plan,
        error=error,
        seed=options.seed,
        certificate=certificate,
        uniform=error.bound_contact(certificate),
        clearance=reach - scope.radius,
        place=deciding.place[closest],
        insertion=deciding.insertion[closest],
        samples=len(samples.points),
        deciding=len(deciding.points),
        nearest=nearest,
        stations=stations,
        diameters=diameters,
        replanned=again,
        notes=(*notes, *_list_notes(plan, error, certificate, nearest + scope.radius)),
    )


def _take_sd(
    tract: LabelTract | SurfaceTract, options: ContactOptions
) -> tuple[float, tuple[str, ...]]:
    """Return the standard deviation [mm], and a note if it is the default."""
    if options.sd is not None:
        return options.sd, ()
    if isinstance(tract, SurfaceTract):
        raise InputError(
            "sd is not given: a surface does not state how far its wall may be off, give a "
            "standard deviation in (0, 20] mm"
        )
    voxel = float(tract.spacing.max())
    sd = voxel / math.sqrt(12.0)
    return sd, (
        f"sd is {sd:.3g} mm, that of rounding to voxels of {voxel:.3g} mm; how well the labels were "
        "drawn is not in it",
    )


def _list_notes(
    plan: Plan, error: WallError, certificate: Certificate, distance: float
) -> Iterator[str]:
    """Give what to know before believing the numbers."""
    if not certificate.certified:
        yield "the plan is not proved clear of the wall as it is given"
    if plan.status != "complete":
        yield f"the plan stops at {plan.inserted:.1f} mm of its path: what follows is up to there"
    if plan.inflation > 0.0:
        yield f"the wall is inflated by {plan.inflation:g} mm, and the error is about that wall"
    if error.correlation < NEAR * distance:
        yield (
            f"first order is doubtful: the correlation length, {error.correlation:g} mm, is less "
            f"than {NEAR:g} times the distance to the wall, {distance:.2f} mm"
        )
    steep = error.sd / error.correlation
    if steep > STEEP:
        yield (
            f"first order is doubtful: sd over correlation length is {steep:.2g}, more than "
            f"{STEEP:g}"
        )

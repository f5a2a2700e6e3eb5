"""A phantom of the upper gastro-intestinal tract: made by rule, from published dimensions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number, check_points, show_apart
from ..errors import GeometryError, InputError
from ..numeric.level_sets import find_level_set
from ..results import Shown
from .tract import LabelTract, Organ, SurfaceTract

# A smooth line in space from headings, straight pieces and circular bends.

Vector = NDArray[np.float64]
Direction = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Leg:
    """A bend into a heading, then a straight piece along it.

    Attributes
    ----------
    heading : tuple of float
        Direction after the bend (right, front, up); need not be of unit length.
    bend : float
        Radius of the bend that leads into it [mm].
    straight : float
        Length of the straight piece after it [mm].
    """

    heading: Direction
    bend: float
    straight: float


def measure_turn(one: Direction, other: Direction) -> float:
    """Return the angle between two headings [rad]."""
    a, b = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


def trace_line(legs: list[Leg], *, step: float) -> tuple[Vector, Vector, Vector]:
    """Trace the legs from the origin, the first without its bend.

    Returns samples at most `step` [mm] apart, shape (n, 3), with bends as circular arcs; the radius
    of the bend of each, infinite on straight pieces; and the arc length at the end of each leg's
    straight piece, with 0 in front.
    """
    place = np.zeros(3)
    heading = _unit(legs[0].heading)
    points, bends = [place], [math.inf]
    breaks, length = [0.0], 0.0
    for number, leg in enumerate(legs):
        target = _unit(leg.heading)
        angle = measure_turn(tuple(heading), tuple(target)) if number else 0.0
        if angle > 1e-9:
            inward = _unit(target - (target @ heading) * heading)
            count = max(math.ceil(leg.bend * angle / step), 1)
            for turn in angle * np.arange(1, count + 1) / count:
                arc = math.sin(turn) * heading + (1.0 - math.cos(turn)) * inward
                points.append(place + leg.bend * arc)
                bends.append(leg.bend)
            place = points[-1]
            length += leg.bend * angle
        heading = target
        if leg.straight > 0:
            count = max(math.ceil(leg.straight / step), 1)
            for part in leg.straight * np.arange(1, count + 1) / count:
                points.append(place + part * heading)
                bends.append(math.inf)
            place = points[-1]
            length += leg.straight
        breaks.append(length)
    return np.array(points), np.array(bends), np.array(breaks)


def _unit(vector: ArrayLike) -> Vector:
    array = np.asarray(vector, dtype=np.float64)
    return np.asarray(array / np.linalg.norm(array))


# The rule behind the phantom: its legs, its radii, and what would make it unclean.

LIMB_GAP_MM = 8.0
"""Smallest gap between two limbs of a valid phantom [mm]."""

BEND_GAP_MM = 6.0
"""Smallest difference of bend radius and lumen radius in a valid phantom [mm]."""

# Headings (right, front, up): the lumen goes down the back, turns left and forward into the
# stomach, sweeps right through the J, backs up to the pylorus and rounds the C of the duodenum.
HEADINGS = {
    "upper": (0.0, -0.08, -1.0),
    "lower": (-0.05, 0.12, -1.0),
    "hiatus": (-0.45, 0.30, -1.0),
    "body": (-0.22, 0.25, -1.0),
    "antrum": (0.90, -0.25, 0.30),
    "superior": (0.75, -0.60, 0.20),
    "descending": (0.05, -0.12, -1.0),
    "horizontal": (-1.0, 0.12, 0.05),
    "ascending": (-0.45, 0.25, 0.85),
}


def plan_legs(
    size: Mapping[str, float], headings: Mapping[str, Direction]
) -> tuple[list[Leg], str]:
    """Share the lengths of the parts out among straight pieces and bends."""
    names = list(HEADINGS)
    flexure, wide = size["flexure_bend"], 120.0
    bend = {
        "upper": 0.0, "lower": wide, "hiatus": wide / 2, "body": 1.5 * size["stomach_bend"],
        "antrum": size["stomach_bend"], "superior": 1.5 * flexure, "descending": flexure,
        "horizontal": flexure, "ascending": flexure,
    }  # fmt: skip
    arc = {names[0]: 0.0}
    for before, name in zip(names[:-1], names[1:], strict=True):
        arc[name] = bend[name] * measure_turn(headings[before], headings[name])
    gullet = size["oesophagus_length"] - arc["lower"] - arc["hiatus"]
    stomach = size["stomach_length"] - arc["body"] - arc["antrum"]
    straight = {
        "upper": 0.5 * gullet,
        "lower": 0.4 * gullet,
        "hiatus": 0.1 * gullet,
        "body": 0.62 * stomach,
        "antrum": 0.38 * stomach,
        "superior": size["superior_length"] - arc["superior"] - arc["descending"] / 2,
        "descending": size["descending_length"] - (arc["descending"] + arc["horizontal"]) / 2,
        "horizontal": size["horizontal_length"] - (arc["horizontal"] + arc["ascending"]) / 2,
        "ascending": size["ascending_length"] - arc["ascending"] / 2,
    }
    least = min(straight, key=lambda name: straight[name])
    fault = ""
    if straight[least] < 1.0:
        fault = f"the {least} part is too short for its bends"
        straight = {name: max(length, 1.0) for name, length in straight.items()}
    legs = [Leg(heading=headings[name], bend=bend[name], straight=straight[name]) for name in names]
    return legs, fault


def compute_radii(
    along: Vector, size: Mapping[str, float], junction: float, pylorus: float
) -> Vector:
    """Return the radius along the line, eased between knots [mm]."""
    stomach = pylorus - junction
    gullet, body, antrum = (
        size[name] / 2 for name in ("oesophagus_diameter", "body_diameter", "antrum_diameter")
    )
    narrow, bowel = size["pylorus_diameter"] / 2, size["duodenum_diameter"] / 2
    knots = [
        (0.0, gullet),
        (junction, gullet),
        (junction + 0.26 * stomach, body),
        (junction + 0.40 * stomach, body),
        (junction + 0.68 * stomach, antrum),
        (junction + 0.80 * stomach, antrum),
        (pylorus - 4.0, narrow),
        (pylorus + 3.0, narrow),
        (pylorus + 22.0, 1.06 * bowel),  # the bulb
        (pylorus + 50.0, bowel),
        (float(along[-1]), bowel),
    ]
    places = np.array([place for place, _ in knots])
    values = np.array([value for _, value in knots])
    left = np.clip(np.searchsorted(places, along, side="right") - 1, 0, len(places) - 2)
    part = np.clip((along - places[left]) / (places[left + 1] - places[left]), 0.0, 1.0)
    ease = part * part * (3.0 - 2.0 * part)
    return np.asarray(values[left] + ease * (values[left + 1] - values[left]))


def find_fault(
    points: Vector,
    radii: Vector,
    bends: Vector,
    along: Vector,
) -> str:
    """Return why the union of balls would not be a clean tube, or nothing."""
    slope = np.abs(np.diff(radii) / np.diff(along))
    if slope.max() > 0.9:
        return f"the radius changes by {slope.max():.2f} mm per mm"
    gap = float((bends - radii).min())
    if gap < BEND_GAP_MM:
        shown = show_apart(gap, BEND_GAP_MM, digits=2)
        return f"a bend is only {shown[0]} mm wider than its lumen, at least {shown[1]} is legal"
    between = np.linalg.norm(points[:, None] - points[None], axis=2)
    reach = radii[:, None] + radii[None]
    # Samples so far apart along the line cannot be neighbours around one bend.
    limbs = np.abs(along[:, None] - along[None]) > 0.5 * math.pi * (reach + LIMB_GAP_MM)
    gap = float(np.where(limbs, between - reach, np.inf).min())
    if gap < LIMB_GAP_MM:
        return f"two limbs are {gap:.1f} mm apart, at least {LIMB_GAP_MM:g} is legal"
    return ""


# The phantom's dimensions, each with where it comes from, and the range over which it varies.


@dataclass(frozen=True, kw_only=True)
class Dimension:
    """One dimension of the phantom.

    Attributes
    ----------
    name, unit : str
        What it is.
    value : float
        Of the standard phantom (seed 0).
    low, high : float
        Range from which other seeds draw, evenly.
    basis : str
        The published figure behind it, or that it is a choice.
    """

    name: str
    unit: str
    value: float
    low: float
    high: float
    basis: str

    def __post_init__(self) -> None:
        if not self.low <= self.value <= self.high:
            shown = show_apart(self.value, self.low, self.high)
            raise InputError(f"{self.name} is {shown[0]}: it must lie in [{shown[1]}, {shown[2]}]")


_LI = (
    "22.9 cm between the sphincters, men 23.6, women 22.4: Li, Castell, Castell, 'Manometric "
    "determination of esophageal length', Am J Gastroenterol 1994;89:722-5"
)
_FERHATOGLU = (
    "about 2 cm in diameter: Ferhatoglu, Kivilcim, 'Anatomy of Esophagus', in Esophageal "
    "Abnormalities, 2017, doi:10.5772/intechopen.69583"
)
_KUIKEN = (
    "chosen so that the stomach holds about 0.4 L, between fasting 0.18 L and after a meal "
    "0.69 L: Kuiken et al., 'Development of a test to measure gastric accommodation in humans', "
    "Am J Physiol 1999;277:G1217-21"
)
_STOMACH = (
    "length 19 +- 2.5 cm in men, 17.1 +- 2.0 cm in women, J-shaped in 58 %: 'A study of "
    "variations of the stomach in adults and growth of the fetal stomach' (50 cadavers); the line "
    "along a J is longer than the J is high"
)
_PYLORUS = (
    "14.3 +- 1.8 mm at 50 mL of an EndoFLIP balloon, 24 healthy volunteers: PMC9529766; 90th "
    "percentile 17.6 mm at 40 mL: Jagtap et al., 'Assessment of pyloric sphincter physiology "
    "using functional luminal imaging probe in healthy volunteers', J Neurogastroenterol Motil "
    "2020;26:391-6"
)
_DUODENUM = (
    "24.8 +- 4.5 mm on MR enterography: Cronin et al., 'Normal small bowel wall characteristics "
    "on MR enterography', Eur J Radiol (65 subjects)"
)
_GRAY = "Gray, 'Anatomy of the Human Body', 20th ed. 1918, p. 1169-70: "
_CHOICE = "a choice: no figure was found"

DIMENSIONS = tuple(
    Dimension(name=name, unit="mm", value=value, low=low, high=high, basis=basis)
    for name, value, low, high, basis in (
        ("oesophagus_length", 230.0, 210.0, 250.0, _LI),
        ("oesophagus_diameter", 20.0, 18.0, 22.0, _FERHATOGLU),
        ("stomach_length", 210.0, 190.0, 230.0, _STOMACH),
        ("body_diameter", 64.0, 56.0, 70.0, _KUIKEN),
        ("antrum_diameter", 44.0, 38.0, 48.0, _CHOICE),
        ("stomach_bend", 42.0, 41.0, 46.0, _CHOICE),
        ("pylorus_diameter", 14.3, 12.5, 16.1, _PYLORUS),
        ("superior_length", 50.0, 47.0, 55.0, _GRAY + "superior part about 5 cm"),
        ("descending_length", 95.0, 75.0, 100.0, _GRAY + "descending part 7 to 10 cm"),
        ("horizontal_length", 72.0, 55.0, 75.0, _GRAY + "horizontal part 5 to 7.5 cm"),
        ("ascending_length", 30.0, 25.0, 35.0, _GRAY + "ascending part about 2.5 cm"),
        ("duodenum_diameter", 24.8, 21.0, 28.0, _DUODENUM),
        ("flexure_bend", 21.0, 20.0, 23.0, _CHOICE),
    )
)
"""The phantom's dimensions in the order in which a seed draws them."""


def draw_dimensions(random: np.random.Generator | None) -> dict[str, float]:
    """Return the standard dimensions, or a draw from their ranges."""
    if random is None:
        return {item.name: item.value for item in DIMENSIONS}
    return {item.name: float(random.uniform(item.low, item.high)) for item in DIMENSIONS}


REGIONS: Mapping[int, str] = MappingProxyType({1: "oesophagus", 2: "stomach", 3: "duodenum"})
"""Label of each part."""

STEP_MM = 2.0
"""Largest distance between samples of the centreline [mm]."""

MAX_DRAWS = 200

_JITTER = 0.08
"""Spread of each component of a heading for seeds other than 0."""


@dataclass(frozen=True, kw_only=True)
class Phantom(Shown):
    """A tract as balls strung on a line: the union of all balls is the lumen.

    Attributes
    ----------
    centreline : ndarray, shape (n, 3)
        From the mouth's end of the oesophagus to the end of the duodenum [mm]. Frame: +x to the
        patient's right, +y to the front, +z to the head (RAS+); the origin is the junction of
        oesophagus and stomach.
    radii : ndarray, shape (n,)
        Radius of the ball at each sample, linear between samples [mm].
    region : ndarray of uint8, shape (n,)
        1 oesophagus, 2 stomach, 3 duodenum: the part that starts or goes on at the sample.
    seed : int
    dimensions : mapping of str to float
        What it was made from, by the names in `bozzini.anatomy.phantom.DIMENSIONS` [mm].
    organ, regions, voxel_range
        What it is, the names of its parts by their labels, and which voxels are legal [mm].
    """

    organ: ClassVar[Organ] = "upper-tract"
    regions: ClassVar[Mapping[int, str]] = REGIONS
    voxel_range: ClassVar[tuple[float, float]] = (0.5, 4.0)

    centreline: Vector
    radii: Vector
    region: NDArray[np.uint8]
    seed: int
    dimensions: Mapping[str, float]

    def __post_init__(self) -> None:
        points = check_points("centreline", self.centreline)
        number = len(points)
        if points.ndim != 2 or number < 2:
            raise InputError(f"centreline has shape {points.shape}: it must be (n, 3), n >= 2")
        if np.shape(self.radii) != (number,) or np.shape(self.region) != (number,):
            raise InputError(
                f"radii {np.shape(self.radii)} and region {np.shape(self.region)} must have one "
                f"value for each of the {number} samples of the centreline"
            )
        if not (np.isfinite(self.radii).all() and np.min(self.radii) > 0):
            raise InputError(f"the least radius is {np.min(self.radii):g} mm: it must be above 0")

    @property
    def length(self) -> float:
        """Length of the centreline [mm]."""
        return float(np.linalg.norm(np.diff(self.centreline, axis=0), axis=1).sum())

    def region_lengths(self) -> dict[str, float]:
        """Return the length of each part along the centreline [mm]."""
        pieces = np.linalg.norm(np.diff(self.centreline, axis=0), axis=1)
        return {
            name: float(pieces[self.region[:-1] == at].sum()) for at, name in self.regions.items()
        }

    def signed_distance(self, points: ArrayLike) -> Vector:
        """Return ``min(|p - c| - r)`` over all balls on the line, negative inside [mm].

        Outside this is the distance to the wall, exactly. Inside its magnitude is how far the
        deepest ball that holds the point reaches beyond it: never more than the distance to the
        wall, and equal to it where that ball touches the wall next to the point; on the inner
        side of a bend it is smaller.

        Parameters
        ----------
        points : array_like, shape (..., 3)
            World [mm].

        Returns
        -------
        ndarray, shape (...)

        Raises
        ------
        InputError
            If a point is not finite.
        """
        from .kernels.meshes import measure_distance

        array = check_points("points", points)
        flat = np.ascontiguousarray(array.reshape(-1, 3))
        result: Vector = measure_distance(flat, self.centreline, self.radii)
        return result.reshape(array.shape[:-1])

    def to_labels(self, voxel: float = 1.0) -> LabelTract:
        """Return the phantom as voxels with the labels of `regions`.

        Parameters
        ----------
        voxel : float
            Side of a voxel [mm]. A voxel is lumen if its centre is inside.

        Raises
        ------
        InputError
            If `voxel` is not in `voxel_range`.
        """
        from .kernels.meshes import fill_distance

        low, high = self.voxel_range
        voxel = check_number("voxel", voxel, low=low, high=high, unit="mm")
        origin, shape = self._grid(voxel, 3.0 * voxel)
        _, owner = fill_distance(shape, origin, voxel, self.centreline, self.radii, 0.0)
        label = np.append(self.region[:-1], np.uint8(0)).astype(np.uint16)
        affine = np.diag([voxel, voxel, voxel, 1.0])
        affine[:3, 3] = origin
        return LabelTract(
            labels=label[owner],
            affine=affine,
            source=self._name(),
            label_names=dict(self.regions),
            organ=self.organ,
            frame="RAS",
        )

    def to_surface(self, spacing: float = 1.5) -> SurfaceTract:
        """Return the wall as a closed surface, by marching cubes on a grid.

        Parameters
        ----------
        spacing : float
            Distance between the nodes of the grid [mm]. The surface departs from the wall by
            about ``spacing ** 2 / (8 r)`` where the radius is r.

        Raises
        ------
        InputError
            If `spacing` is not in `voxel_range`.
        """
        from .kernels.meshes import fill_distance

        low, high = self.voxel_range
        spacing = check_number("spacing", spacing, low=low, high=high, unit="mm")
        reach = 2.0 * spacing
        origin, shape = self._grid(spacing, reach)
        field, _ = fill_distance(shape, origin, spacing, self.centreline, self.radii, reach)
        tiny = np.float32(1e-3 * spacing)  # a node on the wall would make flat triangles
        field[np.abs(field) < tiny] = tiny
        index, faces = find_level_set(field)
        return SurfaceTract(
            vertices=origin + spacing * index,
            faces=faces,
            source=self._name(),
            organ=self.organ,
            frame="RAS",
        )

    def _grid(self, step: float, margin: float) -> tuple[Vector, tuple[int, ...]]:
        reach = self.radii[:, None] + margin
        low = np.floor((self.centreline - reach).min(axis=0) / step)
        high = np.ceil((self.centreline + reach).max(axis=0) / step)
        return low * step, tuple(int(count) for count in high - low + 1)

    def _name(self) -> str:
        named = "" if self.organ == "upper-tract" else f" {self.organ}"
        return f"phantom{named} (seed {self.seed})"


def make_phantom(*, seed: int = 0) -> Phantom:
    """Make a phantom of oesophagus, stomach and duodenum.

    The line consists of straight pieces and circular bends; the radius changes smoothly along
    it. The oesophagus runs down, the stomach is a J, the duodenum a C out of one plane, in four
    parts. Lengths and diameters are those of `bozzini.anatomy.phantom.DIMENSIONS`, each with
    its source. What it leaves out: the dome of the fundus above the junction, folds, the
    narrow places of the oesophagus, and that a lumen is not round.

    Parameters
    ----------
    seed : int
        0 is the standard anatomy. Any other draws every dimension evenly from its range and
        tilts every heading a little, and draws again until the phantom is valid: bends wider
        than the lumen by at least 6 mm, and limbs at least 8 mm apart.

    Raises
    ------
    InputError
        If the seed is not a whole number from 0 on.
    GeometryError
        If no draw is valid.
    """
    seed = check_integer("seed", seed, low=0)
    if seed == 0:
        phantom, fault = _build(0, draw_dimensions(None), HEADINGS)
        if fault:
            raise GeometryError(f"the standard phantom is not valid: {fault}")
        return phantom
    random = np.random.default_rng(seed)
    fault = ""
    for _ in range(MAX_DRAWS):
        dimensions = draw_dimensions(random)
        headings = {name: _tilt(heading, random) for name, heading in HEADINGS.items()}
        phantom, fault = _build(seed, dimensions, headings)
        if not fault:
            return phantom
    raise GeometryError(f"seed {seed}: none of {MAX_DRAWS} draws is valid, the last: {fault}")


def _tilt(heading: Direction, random: np.random.Generator) -> Direction:
    shift = random.uniform(-_JITTER, _JITTER, 3)
    return heading[0] + shift[0], heading[1] + shift[1], heading[2] + shift[2]


def _build(
    seed: int,
    size: Mapping[str, float],
    headings: Mapping[str, Direction],
) -> tuple[Phantom, str]:
    """Build a phantom from its dimensions; return it and what is wrong with it, or nothing."""
    legs, fault = plan_legs(size, headings)
    points, bends, breaks = trace_line(legs, step=STEP_MM)
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    along *= breaks[-1] / along[-1]  # chords are shorter than arcs, by 1 part in 10^4
    junction, pylorus = breaks[3], breaks[5]
    radii = compute_radii(along, size, float(junction), float(pylorus))
    region = np.where(along < junction - 1e-6, 1, np.where(along < pylorus - 1e-6, 2, 3))
    at = int(np.searchsorted(along, junction - 1e-6))
    phantom = Phantom(
        centreline=points - points[at],
        radii=radii,
        region=region.astype(np.uint8),
        seed=seed,
        dimensions=MappingProxyType(dict(size)),
    )
    return phantom, fault or find_fault(points, radii, bends, along)

"""A phantom of the airways: a tree made by rule, from published dimensions of each generation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from ..checks import check_integer
from ..numeric.arrays import Floats
from .phantom import Dimension, Phantom
from .tract import Organ

_WEIBEL = "generation {} of model A: Weibel, 'Morphometry of the Human Lung', 1963, p. 139"
_GRAY = "about {} cm long: Gray, 'Anatomy of the Human Body', 20th ed. 1918, p. 1085"

DIAMETERS = (18.0, 12.2, 8.3, 5.6, 4.5, 3.5, 2.8, 2.3, 1.86, 1.54)
"""Of the branches by generation [mm]; the trachea is generation 0."""

LENGTHS = (120.0, 47.6, 19.0, 7.6, 12.7, 10.7, 9.0, 7.6, 6.4, 5.4)
"""Of the branches by generation [mm]."""

DIMENSIONS = (
    *(
        Dimension(
            name=f"{name}_{generation}", unit="mm", value=value, low=0.85 * value,
            high=1.15 * value, basis=_WEIBEL.format(generation),
        )
        for name, values in (("diameter", DIAMETERS), ("length", LENGTHS))
        for generation, value in enumerate(values)
        if (name, generation) != ("length", 1)
    ),
    Dimension(
        name="right_length", unit="mm", value=25.0, low=20.0, high=30.0,
        basis="the right bronchus is " + _GRAY.format("2.5"),
    ),
    Dimension(
        name="left_length", unit="mm", value=50.0, low=43.0, high=56.0,
        basis="the left bronchus is " + _GRAY.format("5"),
    ),
    Dimension(
        name="end_diameter", unit="mm", value=2.4, low=2.1, high=2.7,
        basis="below it a branch is not drawn: what a CT of 0.6 mm voxels shows",
    ),
)  # fmt: skip
"""The phantom's dimensions in the order in which a seed draws them."""

ANGLE = math.radians(20.0), math.radians(50.0)
"""Between a branch and its parent: drawn from this range, a choice [rad]."""

SCATTER = 0.12
"""A branch's diameter and length are drawn evenly from this share about its generation's."""

GAP_MM = 1.2
"""Between the walls of branches that are no neighbours [mm]."""

_DRAWS = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class AirwayBranch:
    """A branch of the phantom: a straight round tube.

    Attributes
    ----------
    parent : int
        Number of the branch that it leaves; -1 of the trachea.
    generation : int
    start, end : (3,) float
        World [mm].
    radius : float
        [mm]
    """

    parent: int
    generation: int
    start: Floats
    end: Floats
    radius: float

    @property
    def way(self) -> Floats:
        """Unit vector along it."""
        along = self.end - self.start
        return np.asarray(along / np.linalg.norm(along))


@dataclass(frozen=True, kw_only=True, eq=False)
class AirwayPhantom(Phantom):
    """Airways as balls strung on a walk that goes along every branch, there and back.

    Attributes
    ----------
    branches : tuple of AirwayBranch
        Each after its parent; the first is the trachea, from its upper end. Frame: +x to the
        patient's right, +y to the front, +z to the head (RAS+); the origin is the carina.
    """

    organ: ClassVar[Organ] = "airway"
    regions: ClassVar[Mapping[int, str]] = MappingProxyType({1: "airway"})
    voxel_range: ClassVar[tuple[float, float]] = (0.2, 2.0)

    branches: tuple[AirwayBranch, ...]

    @property
    def length(self) -> float:
        """Length of all branches [mm]."""
        return sum(float(np.linalg.norm(each.end - each.start)) for each in self.branches)

    def region_lengths(self) -> dict[str, float]:
        """Return the length of all branches [mm]."""
        return {"airway": self.length}

    @property
    def ends(self) -> tuple[int, ...]:
        """Numbers of the branches that have no daughters."""
        parents = {each.parent for each in self.branches}
        return tuple(k for k in range(len(self.branches)) if k not in parents)


def make_airway(*, seed: int = 0) -> AirwayPhantom:
    """Make a phantom of the airways from the trachea on.

    Every branch parts in two, each about as long and wide as the mean of its generation, in a plane
    that is turned by about 90 degrees against the last one. Where there is no room for two
    branches, or they would be narrower than is drawn, the parent is an end. What it leaves out:
    cartilage rings, that branches bend and taper, and the lungs' shape.

    Parameters
    ----------
    seed : int
        Another number, another anatomy.

    Raises
    ------
    InputError
        If the seed is not a whole number from 0 on.
    """
    seed = check_integer("seed", seed, low=0)
    random = np.random.default_rng(seed)
    size = {item.name: item.value for item in DIMENSIONS}
    if seed:
        size = {item.name: float(random.uniform(item.low, item.high)) for item in DIMENSIONS}
    top = np.array([0.0, 0.0, size["length_0"]])
    trachea = AirwayBranch(
        parent=-1, generation=0, start=top, end=np.zeros(3), radius=0.5 * size["diameter_0"]
    )
    branches, normals = [trachea], [np.array([0.0, 1.0, 0.0])]
    number = 0
    while number < len(branches):  # breadth first: wide branches take their room before narrow ones
        pair = _draw_pair(number, branches, normals[number], size, random)
        branches += [branch for branch, _ in pair]
        normals += [normal for _, normal in pair]
        number += 1
    points, radii = _walk(branches)
    return AirwayPhantom(
        centreline=points,
        radii=radii,
        region=np.ones(len(points), dtype=np.uint8),
        seed=seed,
        dimensions=MappingProxyType(size),
        branches=tuple(branches),
    )


def _draw_pair(
    parent: int,
    branches: list[AirwayBranch],
    normal: Floats,
    size: Mapping[str, float],
    random: np.random.Generator,
) -> list[tuple[AirwayBranch, Floats]]:
    """Return two daughters of a branch, each with the normal of its plane; none without room."""
    stem = branches[parent]
    generation = stem.generation + 1
    if generation >= len(DIAMETERS):
        return []
    for _ in range(_DRAWS):
        side = np.cross(normal, stem.way)
        pair = []
        for sign in (1.0, -1.0):
            angle = float(random.uniform(*ANGLE))
            scale = random.uniform(1.0 - SCATTER, 1.0 + SCATTER, 2)
            radius = 0.5 * size[f"diameter_{generation}"] * float(scale[0])
            if generation == 1:
                length = size["right_length" if sign * side[0] > 0.0 else "left_length"]
            else:
                length = size[f"length_{generation}"]
            way = math.cos(angle) * stem.way + sign * math.sin(angle) * side
            end = stem.end + float(scale[1]) * length * way
            branch = AirwayBranch(
                parent=parent, generation=generation, start=stem.end, end=end,
                radius=min(radius, 0.95 * stem.radius),
            )  # fmt: skip
            turn = float(random.uniform(-0.35, 0.35))
            pair.append((branch, math.cos(turn) * side + math.sin(turn) * normal))
        if any(2.0 * branch.radius < size["end_diameter"] for branch, _ in pair):
            return []
        if all(_has_room(branch, branches) for branch, _ in pair):
            return [(branch, _square(plane, branch.way)) for branch, plane in pair]
        turn = float(random.uniform(-0.8, 0.8))
        normal = math.cos(turn) * normal + math.sin(turn) * side
    return []


def _square(normal: Floats, way: Floats) -> Floats:
    """Return the part of a vector that is normal to a way, of unit length."""
    across = normal - (normal @ way) * way
    return np.asarray(across / np.linalg.norm(across))


def _has_room(branch: AirwayBranch, others: list[AirwayBranch]) -> bool:
    """Whether a branch keeps off all others but its parent, its sister and its parent's parent."""
    stem = others[branch.parent]
    near = {branch.parent, stem.parent}
    samples = branch.start + np.linspace(0.0, 1.0, 12)[:, None] * (branch.end - branch.start)
    for k, other in enumerate(others):
        if k in near:
            continue
        along = other.end - other.start
        share = np.clip((samples - other.start) @ along / (along @ along), 0.0, 1.0)
        away = np.linalg.norm(other.start + share[:, None] * along - samples, axis=1)
        if other.parent == stem.parent:  # it begins where the parent does
            away = away[1:]
        if away.min() < branch.radius + other.radius + GAP_MM:
            return False
    return True


def _walk(branches: list[AirwayBranch]) -> tuple[Floats, Floats]:
    """Return the ends of the branches in the order of a walk round the tree, and their radii."""
    points, radii = [], []

    def go(number: int) -> None:
        branch = branches[number]
        there = [branch.start, branch.end]
        points.extend(there)
        radii.extend([branch.radius] * 2)
        for k, other in enumerate(branches):
            if other.parent == number:
                go(k)
                points.append(branch.end)
                radii.append(branch.radius)
        points.append(branch.start)
        radii.append(branch.radius)

    go(0)
    return np.array(points), np.array(radii)

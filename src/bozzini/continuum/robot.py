"""A tendon robot: sections in series, whose distal tendons pass through the proximal ones."""

from __future__ import annotations

import dataclasses
import math
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import broadcast, check_array, check_integer, quantity, show_apart
from ..errors import InputError
from ..io.records import load_record, read_record, save_record, write_record
from ..numeric.arrays import Floats
from ..results import Json, Shown
from .checks import check_items, check_text, check_turn, check_values
from .profile import ROUND_OFF_MM
from .section import Helix, Section, Tendon

Vector = tuple[float, float, float]

ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class RobotDesign(Shown):
    """Sections in series, base first: what all models take.

    Its base's frame stands somewhere in the world, whose weight acts along -z. In that frame the
    robot is straight along +z at rest, unless sections have curvatures of their own.

    `bozzini.continuum.ContinuumRobot` is the same with forward and inverse kinematics.

    Parameters
    ----------
    sections : sequence of Section
        At least one, from base to tip.
    name : str
        Name of the robot.
    base_position : (x, y, z)
        Where the base stands in the world [mm].
    base_rotation : (x, y, z) or (3, 3) array_like
        How the base is turned in the world: a rotation vector [rad], or a matrix whose columns
        are the base's axes; kept as a vector.

    Raises
    ------
    InputError
        If names are used twice, a tendon does not end in its section or leaves the body, or the
        base's pose is none.
    """

    sections: tuple[Section, ...]
    name: str = "robot"
    base_position: Vector = quantity(
        "length", "Place of the base in the world.", default=ZERO, kw_only=True
    )
    base_rotation: Vector = quantity(
        "angle", "Turn of the base in the world.", default=ZERO, kw_only=True
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", check_text("robot name", self.name))
        place = check_values("robot base_position", self.base_position, (3,), unit="mm")
        turn = check_turn("robot base_rotation", self.base_rotation)
        object.__setattr__(self, "base_position", tuple(place.tolist()))
        object.__setattr__(self, "base_rotation", tuple(turn.tolist()))
        sections = check_items("a robot's sections", self.sections, Section)
        if not sections:
            raise InputError("a robot needs at least 1 section, got none")
        ends = np.cumsum([section.length for section in sections]).tolist()
        sections = tuple(map(_resolve_helices, sections, ends))
        object.__setattr__(self, "sections", sections)
        for what, names in (
            ("tendons", [tendon.name for section in sections for tendon in section.tendons]),
            ("sections", [section.name for section in sections if section.name]),
        ):
            twice = [name for name, count in Counter(names).items() if count > 1]
            if twice:
                raise InputError(f"two {what} are called '{twice[0]}': names must differ")
        for tendon in self.tendons:
            self._check_inside(tendon)

    @cached_property
    def tendons(self) -> tuple[Tendon, ...]:
        """All tendons, those of the first section first, each with the arc length of its end."""
        return tuple(
            self._resolve(tendon, index)
            for index, section in enumerate(self.sections)
            for tendon in section.tendons
        )

    @property
    def tendon_names(self) -> tuple[str, ...]:
        """Names of the tendons, in the order of `tendons`."""
        return tuple(tendon.name for tendon in self.tendons)

    @cached_property
    def tendon_sections(self) -> NDArray[np.int64]:
        """Index of the section where each tendon ends, shape (t,)."""
        return np.repeat(
            np.arange(len(self.sections)), [len(section.tendons) for section in self.sections]
        )

    @cached_property
    def tendon_ends(self) -> Floats:
        """Arc length where each tendon ends [mm], shape (t,)."""
        return np.asarray([_end(tendon) for tendon in self.tendons], dtype=np.float64)

    @cached_property
    def tendon_travel(self) -> Floats:
        """Smallest and largest displacement of each tendon [mm], shape (t, 2); may be infinite."""
        travel = [tendon.travel for tendon in self.tendons]
        return np.asarray(travel, dtype=np.float64).reshape(-1, 2)

    @cached_property
    def rest_lengths(self) -> Floats:
        """Length of each tendon in the straight robot, as a smooth curve [mm], shape (t,)."""
        return np.asarray([_rest_length(tendon) for tendon in self.tendons], dtype=np.float64)

    @cached_property
    def pushes(self) -> NDArray[np.bool_]:
        """Which tendons are rods that push as well, shape (t,)."""
        return np.asarray([tendon.pushes for tendon in self.tendons], dtype=np.bool_)

    @cached_property
    def tendon_friction(self) -> Floats:
        """Coefficient of friction of each tendon in its channel, shape (t,)."""
        return np.asarray([tendon.friction for tendon in self.tendons], dtype=np.float64)

    @cached_property
    def tendon_stiffness(self) -> Floats:
        """EA of each tendon [N], shape (t,); infinite where it does not stretch."""
        return np.asarray([tendon.stiffness for tendon in self.tendons], dtype=np.float64)

    @cached_property
    def pretensions(self) -> Floats:
        """Tension of each tendon in the straight robot at rest [N], shape (t,)."""
        return np.asarray([tendon.pretension for tendon in self.tendons], dtype=np.float64)

    @cached_property
    def tension_limits(self) -> Floats:
        """Largest tension of each tendon [N], shape (t,); may be infinite."""
        return np.asarray([tendon.tension_limit for tendon in self.tendons], dtype=np.float64)

    @cached_property
    def disc_weights(self) -> Floats:
        """Weight of each disc [N], shape (d,)."""
        return np.concatenate(
            [np.full(section.discs, section.disc_weight) for section in self.sections]
        )

    @cached_property
    def has_line_weight(self) -> bool:
        """Whether the backbone has weight."""
        return any(np.any(section.weight_at([0.0, section.length])) for section in self.sections)

    @cached_property
    def is_straight(self) -> bool:
        """Whether no section has a curvature or twist of its own."""
        return not any(np.any(section.curvature) for section in self.sections)

    @cached_property
    def base_frame(self) -> Floats:
        """Frame of the base in the world, shape (4, 4) [mm]."""
        from scipy.spatial.transform import Rotation

        frame = np.eye(4)
        frame[:3, :3] = Rotation.from_rotvec(self.base_rotation).as_matrix()
        frame[:3, 3] = self.base_position
        return frame

    @cached_property
    def is_parallel(self) -> bool:
        """Whether the offset and the angle of every tendon are the same all along."""
        return all(tendon.is_parallel for tendon in self.tendons)

    @cached_property
    def section_lengths(self) -> Floats:
        """Length of each section [mm], shape (m,)."""
        return np.asarray([section.length for section in self.sections], dtype=np.float64)

    @cached_property
    def section_stiffness(self) -> Floats:
        """EI, EI and GJ of each section, its means where they change [N mm^2], shape (m, 3)."""
        return np.stack([section.mean_stiffness for section in self.sections])

    @cached_property
    def section_ends(self) -> Floats:
        """Arc length where each section ends [mm], shape (m,)."""
        return np.cumsum(self.section_lengths)

    @cached_property
    def section_starts(self) -> Floats:
        """Arc length where each section starts [mm], shape (m,)."""
        return np.concatenate([[0.0], self.section_ends[:-1]])

    @property
    def length(self) -> float:
        """Length of the backbone [mm]."""
        return float(self.section_ends[-1])

    @property
    def radius(self) -> float:
        """Largest radius of the body [mm]."""
        return max(section.radius for section in self.sections)

    @cached_property
    def disc_arc_length(self) -> Floats:
        """Arc length of all discs from the base [mm], shape (d,); none stands at the base."""
        places = []
        for start, end, section in zip(
            self.section_starts, self.section_ends, self.sections, strict=True
        ):
            discs = start + section.disc_places
            discs[-1] = end
            places.append(discs)
        return np.concatenate(places)

    def section_at(self, arc_length: ArrayLike) -> NDArray[np.int64]:
        """Return the index of the section at arc lengths [mm]; an end belongs to its section."""
        places = check_array("arc_length", arc_length)
        index = np.searchsorted(self.section_ends, places - ROUND_OFF_MM, side="left")
        return np.minimum(index, len(self.sections) - 1).astype(np.int64)

    def stiffness_at(self, arc_length: ArrayLike) -> Floats:
        """Return the backbone's stiffnesses; at the end of a section they are that section's.

        Parameters
        ----------
        arc_length : array_like, shape (...)
            Arc lengths from the base [mm].

        Returns
        -------
        (..., 6) ndarray
            GA, GA, EA [N], EI, EI, GJ [N mm^2]: shear along x and y, stretch, bend about x and
            y, twist.
        """
        return self._evaluate("stiffness_at", arc_length)

    def curvature_at(self, arc_length: ArrayLike) -> Floats:
        """Return curvature about x and y and twist at rest [rad/mm], shape (..., 3)."""
        return self._evaluate("curvature_at", arc_length)

    def weight_at(self, arc_length: ArrayLike) -> Floats:
        """Return the backbone's weight per length [N/mm], shape (...); discs are not in it."""
        return self._evaluate("weight_at", arc_length)

    def _evaluate(self, method: str, arc_length: ArrayLike) -> Floats:
        places = check_array("arc_length", arc_length)
        owner = self.section_at(places)
        parts = [
            getattr(section, method)(places - start)
            for section, start in zip(self.sections, self.section_starts, strict=True)
        ]
        values = np.asarray(parts[0])
        for index, part in enumerate(parts[1:], start=1):
            here = (owner == index).reshape(owner.shape + (1,) * (values.ndim - owner.ndim))
            values = np.where(here, part, values)
        return values

    def section_label(self, index: int) -> str:
        """Return how messages call a section: ``section 1`` is the first, by its name if any."""
        name = self.sections[index].name
        return f"section {index + 1}" + (f" '{name}'" if name else "")

    def stations(self, *, between: int = 0) -> Floats:
        """Return arc lengths of base and discs, and of points evenly `between` two discs [mm].

        Raises
        ------
        InputError
            If `between` is not a whole number in [0, 1000].
        """
        parts = check_integer("between", between, low=0, high=1000) + 1
        discs = np.concatenate([[0.0], self.disc_arc_length])
        steps = np.arange(parts) / parts
        inner = discs[:-1, None] + np.diff(discs)[:, None] * steps
        return np.append(inner.ravel(), discs[-1])

    def order_displacements(
        self, displacements: Mapping[str, ArrayLike], *, missing: float = math.nan
    ) -> Floats:
        """Return displacements (...) [mm] by the tendons' names as an array (..., t).

        Those left out are `missing`, by default NaN: those tendons follow.

        Raises
        ------
        InputError
            If there is no such tendon, or a displacement is no number or array of numbers.
        """
        return self._order("displacement", displacements, missing)

    def order_tensions(self, tensions: Mapping[str, ArrayLike]) -> Floats:
        """Return tensions (...) [N] by the tendons' names as an array (..., t); 0 if left out.

        Raises
        ------
        InputError
            If there is no such tendon, or a tension is no number or array of numbers.
        """
        return self._order("tension", tensions, 0.0)

    def _order(self, what: str, given: Mapping[str, ArrayLike], missing: float) -> Floats:
        for name in given:
            if name not in self.tendon_names:
                raise InputError(
                    f"there is no tendon '{name}': those of robot '{self.name}' are "
                    f"{', '.join(self.tendon_names) or 'none'}"
                )
        named = [
            (name, check_array(f"{what} of tendon '{name}'", given.get(name, missing)))
            for name in self.tendon_names
        ]
        return np.stack(broadcast(*named), axis=-1) if named else np.zeros(0)

    @classmethod
    def from_dict(cls, fields: Json) -> Self:
        """Build a robot from plain data, as a YAML file holds it (see `from_yaml`).

        Raises
        ------
        InputError
            One line that names the field, its value and what is legal.
        """
        return read_record(fields, cls, name="robot")

    def to_dict(self) -> Json:
        """Return the robot as plain data that `from_dict` reads."""
        data = write_record(self)
        for section in data["sections"]:
            section.setdefault("tendons", [])
        return {"name": self.name} | data

    @classmethod
    def from_yaml(cls, path: str | os.PathLike[str]) -> Self:
        """Read a robot from a YAML file; quantities may carry units, ``20 mm`` or ``36 deg``.

        Raises
        ------
        FileFormatError
            One line that names the file, the field, its value and what is legal.
        """
        return load_record(path, cls, name="robot")

    def to_yaml(self, path: str | os.PathLike[str]) -> Path:
        """Write the robot as a YAML file, whole or not at all, and return its path.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        return save_record(self, path, note="Lengths in mm, angles in rad, stiffnesses in N mm^2.")

    def _resolve(self, tendon: Tendon, index: int) -> Tendon:
        start, end = float(self.section_starts[index]), float(self.section_ends[index])
        if tendon.end is None:
            return tendon.ending_at(end)
        if not start + ROUND_OFF_MM < tendon.end <= end + ROUND_OFF_MM:
            shown = show_apart(tendon.end, start, end)
            raise InputError(
                f"tendon '{tendon.name}' end is {shown[0]} mm: it belongs to "
                f"{self.section_label(index)} and must lie in ({shown[1]}, {shown[2]}] mm"
            )
        return tendon.ending_at(min(tendon.end, end))

    def _check_inside(self, tendon: Tendon) -> None:
        for index, section in enumerate(self.sections):
            start = float(self.section_starts[index])
            end = min(float(self.section_ends[index]), _end(tendon))
            if start >= end:
                break
            corners = tendon.corners()
            places = np.concatenate([[start], corners[(corners > start) & (corners < end)], [end]])
            if tendon.path is not None:  # between corners of others the offset is monotone
                parts = np.arange(PIECES_LOOKED_AT) / PIECES_LOOKED_AT
                inner = places[:-1, None] + np.diff(places)[:, None] * parts
                places = np.append(inner, end)
            most = float(tendon.offset_at(places).max())
            if most > section.radius * (1.0 + 1e-12):
                shown = show_apart(most, section.radius)
                raise InputError(
                    f"tendon '{tendon.name}' offset is {shown[0]} mm in "
                    f"{self.section_label(index)}: it must lie in (0, {shown[1]}] mm, "
                    "inside the body's radius"
                )


PIECES_LOOKED_AT = 16
"""Parts of a piece of a path where it is checked to be inside the body."""


def check_robot(robot: object) -> None:
    """Raise `InputError` unless `robot` is one."""
    if not isinstance(robot, RobotDesign):
        raise InputError(f"robot is of type {type(robot).__name__}: it must be a ContinuumRobot")


def _resolve_helices(section: Section, end: float) -> Section:
    """Return a section whose helices are knots; without an end of their own they end at `end`."""
    tendons = tuple(
        dataclasses.replace(tendon, angle=tendon.angle.knots(end))
        if isinstance(tendon.angle, Helix)
        else tendon
        for tendon in section.tendons
    )
    return section if tendons == section.tendons else dataclasses.replace(section, tendons=tendons)


def _end(tendon: Tendon) -> float:
    return np.inf if tendon.end is None else tendon.end


def _rest_length(tendon: Tendon) -> float:
    if tendon.is_parallel:
        return _end(tendon)
    nodes, weights = np.polynomial.legendre.leggauss(32)
    edges = np.concatenate([[0.0], tendon.corners(), [_end(tendon)]])
    half = 0.5 * np.diff(edges)[:, None]
    slopes = tendon.slope_at(edges[:-1, None] + half * (1.0 + nodes))
    return float(np.sum(half * weights * np.sqrt(1.0 + np.sum(slopes**2, axis=-1))))

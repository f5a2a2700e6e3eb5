"""The two forms in which a tract comes: voxels with labels, or the triangles of its wall."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_points, check_word, show_apart
from ..errors import GeometryError, InputError
from ..results import Shown, show_briefly
from ._mesh import Faces, Vertices, measure_volume

# What a check found in an input: not an error, but its user should know it.

SEVERITIES = ("note", "warning")


@dataclass(frozen=True)
class Finding:
    """One thing that a check of an input found.

    Attributes
    ----------
    code : str
        A short, stable name such as ``"components-dropped"``, for programs.
    severity : str
        ``"note"`` (for the record) or ``"warning"`` (look at it before trusting the result).
    message : str
        One line for people.

    Raises
    ------
    InputError
        If the severity is neither of the two.
    """

    code: str
    severity: str
    message: str

    def __post_init__(self) -> None:
        check_word("severity", self.severity, SEVERITIES)

    def __str__(self) -> str:
        return f"{self.severity}: {self.message}"


Point = tuple[float, float, float]


def to_point(place: Iterable[float]) -> Point:
    """Return a place of the world as a tuple of floats."""
    x, y, z = (float(value) for value in place)
    return x, y, z


def name_place(point: Iterable[float]) -> str:
    """Return a place of the world as text, ``"(12.0, -3.5, 80.1)"``."""
    return "(" + ", ".join(f"{float(value):.1f}" for value in point) + ")"


def show_volume(volume: float) -> str:
    """Return a volume [mm^3] as text in mL."""
    return f"{volume / 1000.0:.3g} mL"


def count_noun(number: int, one: str, several: str = "") -> str:
    """Return a number and its noun, ``"1 handle"`` or ``"2 handles"``."""
    return f"{number} {one if number == 1 else several or f'{one}s'}"


PLAUSIBLE_MM = (10.0, 3000.0)
"""Longest side of the box around a plausible tract."""

POSSIBLE_MM = (1.0, 10_000.0)
"""Longest side of the box around what is taken for a tract at all."""


def check_scale(longest: float, *, hint: str) -> list[Finding]:
    """Warn if the longest side of the box around a tract is implausible, refuse an absurd one.

    Parameters
    ----------
    longest : float
        Longest side [mm].
    hint : str
        What to try.

    Raises
    ------
    GeometryError
        If it is outside `POSSIBLE_MM`.
    """
    low, high = PLAUSIBLE_MM
    if low <= longest <= high:
        return []
    word = "small" if longest < low else "large"
    wrong = f"the tract is implausibly {word}: its longest side is {longest:.3g} mm"
    least, most = POSSIBLE_MM
    if not least <= longest <= most:
        raise GeometryError(f"{wrong}, it must be {least:g} to {most:g} mm; {hint}")
    return [Finding("scale", "warning", f"{wrong}, expected {low:g} to {high:g} mm; {hint}")]


def report_handles(handles: int) -> list[Finding]:
    """Return a finding on ways on which a lumen closes on itself, if there are any."""
    message = f"{count_noun(handles, 'handle')} (the lumen closes on itself): ways around may be "
    return [Finding("handles", "warning", message + "false")] if handles > 0 else []


FARTHEST_MM = 1e9
"""Largest coordinate that is taken for one; beyond it a file is damaged."""


def check_mesh(vertices: ArrayLike, faces: ArrayLike, source: str) -> tuple[Vertices, Faces]:
    """Return corners [mm] and triangles as arrays; `InputError` if they are not a surface."""
    points, triangles = check_array(f"vertices of {source}", vertices), np.asarray(faces)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"vertices of {source} have shape {points.shape}: it must be (n, 3)")
    bad = int(np.count_nonzero(~np.isfinite(points).all(axis=1)))
    if bad:
        what = count_noun(bad, "vertex that is", "vertices that are")
        raise InputError(f"{source} has {what} not finite (NaN or infinite)")
    farthest = float(np.abs(points).max(initial=0.0))
    if farthest > FARTHEST_MM:
        shown = show_apart(farthest, FARTHEST_MM)
        raise InputError(
            f"{source} has a coordinate of {shown[0]} mm: it must lie within {shown[1]} mm"
        )
    if triangles.size == 0:
        raise InputError(f"{source} has no faces")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
        raise InputError(
            f"faces of {source} are {triangles.dtype} of shape {triangles.shape}: they must be "
            f"integers (m, 3)"
        )
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise InputError(
            f"faces of {source} point at vertices {triangles.min()} to {triangles.max()}: they "
            f"must lie in [0, {len(points) - 1}]"
        )
    return points, triangles.astype(np.int64)


Organ = Literal["upper-tract", "small-bowel", "colon", "airway", "vessel"]
"""An organ whose entry is known: the upper tract and the small bowel are entered from their higher
end, the colon from its lower end (the anus)."""

ORGANS: tuple[Organ, ...] = ("upper-tract", "small-bowel", "colon", "airway", "vessel")


@dataclass(frozen=True, kw_only=True)
class Opening(Shown):
    """An open end of the file's wall, which was closed by a flat cap: a candidate for an end.

    Attributes
    ----------
    point : tuple of float
        Its middle, world frame [mm].
    radius : float
        Of the circle of the same area [mm].
    name : str
        How it is called in messages and by ``--start`` and ``--end``.
    """

    point: Point
    radius: float
    name: str


@dataclass(frozen=True, kw_only=True)
class Component(Shown):
    """A part of a lumen that is not joined to the part that was kept, or that the file lacks.

    Attributes
    ----------
    volume : float
        [mm^3].
    point : tuple of float
        The place inside it that is nearest to its middle, world frame [mm].
    label_names : tuple of str
        Its labels, by their names as far as they have any, else ``"label 3"``.
    """

    volume: float
    point: Point
    label_names: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class TractSource(Shown):
    """What is known of a tract, whichever its form.

    Attributes
    ----------
    source : str
        Where it came from, for reports.
    findings : tuple of Finding
        What the checks found.
    organ : {"upper-tract", "small-bowel", "colon", "airway", "vessel"}, optional
        Which organ this is, as far as the file states it; None where it does not.
    landmarks : mapping of str to (x, y, z)
        Named places in the world frame [mm], as far as the file has them.
    openings : tuple of Opening
        Open ends that were capped.
    not_reached : tuple of Component
        The other parts of the lumen, largest first: no motion in this tract reaches them.
    missing : tuple of Component
        Lumen that the file lacks: places that only an outer sheet of the wall encloses.
    frame : str, optional
        Where the world axes point in the patient, a letter each (R or L, A or P, S or I), such as
        "RAS" or "LPS"; None where the file does not state it.
    wall : str
        What the wall is, in words, where it is not simply the faces of the voxels or the triangles
        of the file.
    wall_error : float, optional
        How far the true wall may be from the stated one [mm], where it is not simply half a
        voxel's diagonal; of a surface, where it is known.
    """

    source: str
    findings: tuple[Finding, ...] = ()
    organ: Organ | None = None
    landmarks: Mapping[str, Point] = field(default_factory=dict)
    openings: tuple[Opening, ...] = ()
    not_reached: tuple[Component, ...] = ()
    missing: tuple[Component, ...] = ()
    frame: str | None = None
    wall: str = ""
    wall_error: float | None = None


@dataclass(frozen=True, kw_only=True)
class LabelTract(TractSource):
    """A lumen given by voxels.

    Attributes
    ----------
    labels : ndarray of uint16, shape (nx, ny, nz)
        0 is not lumen, every other value the label of a part of it. One connected component,
        cropped to it, with at least two voxels of zero on every side.
    affine : ndarray, shape (4, 4)
        Voxel index (the centre of the voxel) to world [mm], of this cropped array.
    label_names : mapping of int to str
        Names of labels, as far as the file or its maker states them.
    source, findings, organ, landmarks, openings, not_reached, missing, frame, wall, wall_error
        As in `TractSource`.

    Raises
    ------
    InputError
        If an array has the wrong shape or type.
    GeometryError
        If there is no lumen, or it comes within two voxels of the border of the array.
    """

    __repr__ = show_briefly

    labels: NDArray[np.uint16]
    affine: NDArray[np.float64]
    label_names: Mapping[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        labels = np.asarray(self.labels)
        if labels.ndim != 3 or labels.dtype != np.uint16:
            raise InputError(
                f"labels are {labels.dtype} of shape {labels.shape}: they must be uint16 with "
                f"3 dimensions"
            )
        affine = check_points("affine", self.affine, dim=4)
        if affine.shape != (4, 4):
            raise InputError(f"affine has shape {affine.shape}: it must be (4, 4)")
        inner = labels[2:-2, 2:-2, 2:-2]
        filled = np.count_nonzero(labels)
        if filled == 0:
            raise GeometryError("the label volume has no lumen: every voxel is 0")
        if np.count_nonzero(inner) != filled:
            raise GeometryError("the lumen is closer than two voxels to the border of its array")
        object.__setattr__(self, "labels", labels)
        object.__setattr__(self, "affine", affine)

    @property
    def kind(self) -> str:
        """Which form this is: ``"labels"``."""
        return "labels"

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Whether a voxel is lumen, shape (nx, ny, nz)."""
        return np.asarray(self.labels != 0)

    @property
    def spacing(self) -> NDArray[np.float64]:
        """Size of a voxel along its three axes [mm], shape (3,)."""
        return np.asarray(np.linalg.norm(self.affine[:3, :3], axis=0))

    @property
    def volume(self) -> float:
        """Volume of the lumen [mm^3]."""
        return float(np.count_nonzero(self.labels) * abs(np.linalg.det(self.affine[:3, :3])))

    @property
    def label_values(self) -> tuple[int, ...]:
        """The labels that are there."""
        there = np.zeros(1 << 16, dtype=bool)
        for layer in self.labels:  # one at a time: an index takes eight bytes a voxel
            there[layer] = True
        there[0] = False
        return tuple(int(value) for value in np.flatnonzero(there))


@dataclass(frozen=True, kw_only=True)
class SurfaceTract(TractSource):
    """A lumen given by the triangles of its wall.

    Attributes
    ----------
    vertices : ndarray, shape (n, 3)
        World [mm].
    faces : ndarray of int64, shape (m, 3)
        Corners of each triangle, anticlockwise seen from outside the lumen.
    source, findings, organ, landmarks, openings, not_reached, missing, frame, wall, wall_error
        As in `TractSource`.
    source_error : float, optional
        Half a diagonal of the voxels that the surface was made from [mm], where it shows them: of
        its `wall_error` the part that is known.

    Raises
    ------
    InputError
        If an array has the wrong shape, a vertex is not finite or a face points nowhere.
    """

    __repr__ = show_briefly

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    source_error: float | None = None

    def __post_init__(self) -> None:
        vertices, faces = check_mesh(self.vertices, self.faces, self.source)
        object.__setattr__(self, "vertices", np.ascontiguousarray(vertices))
        object.__setattr__(self, "faces", np.ascontiguousarray(faces))

    @property
    def kind(self) -> str:
        """Which form this is: ``"surface"``."""
        return "surface"

    @property
    def volume(self) -> float:
        """Volume inside [mm^3], positive where the faces turn outwards."""
        return measure_volume(self.vertices, self.faces)


Tract = LabelTract | SurfaceTract
"""Either form."""

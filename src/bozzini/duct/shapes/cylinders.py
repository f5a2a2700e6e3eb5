"""Connected cylinders (thesis 5.3.3.2 and appendix B): circles in space, joined by rulings."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import GeometryError, InputError
from ..checks import (
    check_counts,
    check_places,
    check_radii,
    freeze_array,
    freeze_places,
    scale_to_unit_normals,
    set_fields,
)
from .base import ShapeUnion

TOLERANCE = 1e-7
"""How much too small the distance to the wall may be, as a fraction of the largest radius."""


@dataclass(frozen=True)
class CylinderCoordinates:
    """Where points lie in a chain of cylinders (thesis eq. 5.31, inverted).

    Attributes
    ----------
    segments : (...) int
        The segment whose blended disc holds the point; -1 where none does.
    t : (...) float
        Along the segment, 0 to 1; 0 without a segment.
    u : (...) float
        Off the axis, 1 at the wall; infinite without a segment.
    theta : (...) float
        Angle about the axis in the chain's twist-free frame [rad], (-pi, pi].
    """

    segments: NDArray[np.int64]
    t: NDArray[np.float64]
    u: NDArray[np.float64]
    theta: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ConnectedCylinders(ShapeUnion):
    """Circles in space, each two consecutive ones joined by straight rulings.

    Parameters
    ----------
    centres : (n, 3) float
        Of the circles, along the duct [mm]; at least 2.
    normals : (n, 3) float
        Of the circles' planes, of any length. Their sign is free: they are turned along the duct.
    radii : (n,) float
        Of the circles [mm].
    inflation, wall, wall_error
        See `DuctShape`.

    Raises
    ------
    InputError
        If a radius is not positive, a normal has no length, or there is one circle only.
    GeometryError
        If a circle cannot be turned along the duct (the chain folds back on it), or two
        consecutive circles meet: the spacing is too short for the bend.

    Notes
    -----
    A ruling joins equal angles of frames that are carried from circle to circle without twist
    (the smallest rotation from normal to normal), so a wall is never pinched as that of eqs
    6.3-6.5 is, whose angles belong to frames about fixed axes. Whether a point is inside is
    answered in closed form, a quadratic equation for each segment.

    The distance is that to the wall, which is all rulings and the discs at both ends, by a
    search with a lower bound; it is too small by at most 1e-7 of the largest radius, and exact
    otherwise. Where segments that are not neighbours overlap, the walls of each count in the
    other, so that it is a lower bound of the clearance: `kind` is "bound". Between circles that are
    not parallel the section is an ellipse, narrower in the plane of the bend by the cosine of
    half the angle. A smaller radius (thesis 5.3.3.2) is not the same as a clearance where the
    chain tapers or bends; `erode` is.
    """

    centres: NDArray[np.float64]
    normals: NDArray[np.float64]
    radii: NDArray[np.float64]
    wall: str = field(default="connected cylinders, ends closed by discs", kw_only=True)

    name = "cylinders"
    code = 11
    joined = True
    dim = 3
    columns = {
        "centre": ("centres", "lengths"),
        "normal": ("normals", "numbers"),
        "radius": ("radii", "length"),
    }

    def __post_init__(self) -> None:
        centres = freeze_places("centres", self.centres, 3, least=2)
        normals = freeze_array("normals", self.normals, (3,), least=2)
        radii = freeze_array("radii", self.radii, (), least=2)
        check_counts(len(centres), {"normals": normals, "radii": radii})
        check_radii(radii)
        super().__post_init__()
        normals = scale_to_unit_normals("normals", normals)
        _turn_normals(centres, normals)
        _check_apart(centres, normals, radii)
        normals.flags.writeable = False
        set_fields(self, centres=centres, normals=normals, radii=radii)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) corners of the smallest box around the duct [mm]."""
        reach = self.radii[:, None] * np.sqrt(np.maximum(1.0 - self.normals**2, 0.0))
        reach += self.inflation
        return np.stack([(self.centres - reach).min(axis=0), (self.centres + reach).max(axis=0)])

    @property
    def frames(self) -> NDArray[np.float64]:
        """(n, 3, 3) frame of each circle, as columns: spoke of angle 0, of a right angle, normal.

        Carried along without twist: a ruling joins equal angles.
        """
        return self._frames

    def locate(self, points: ArrayLike) -> CylinderCoordinates:
        """Return the coordinates (t, u, theta) of points (..., 3), in closed form.

        Raises
        ------
        InputError
            If the points are not finite or not (..., 3).
        """
        from ..kernels.cylinders import locate_points

        array = check_places("points", points)
        flat = np.array(array.reshape(-1, 3), order="C")
        segments = np.empty(len(flat), dtype=np.int64)
        result = np.empty((len(flat), 4))
        locate_points(self._numbers, flat, segments, result)
        shape = array.shape[:-1]
        start = self._bends[np.maximum(segments, 0)]
        theta = np.arctan2(result[:, 3], result[:, 2]) + start
        theta = np.where(segments < 0, 0.0, np.pi - (np.pi - theta) % (2.0 * np.pi))
        return CylinderCoordinates(
            segments.reshape(shape),
            result[:, 0].reshape(shape),
            result[:, 1].reshape(shape),
            theta.reshape(shape),
        )

    def place(self, coordinates: CylinderCoordinates) -> NDArray[np.float64]:
        """Return the points (..., 3) of coordinates: thesis eq. 5.31 in twist-free frames."""
        segments = np.asarray(coordinates.segments)
        last = len(self.centres) - 2
        if segments.size and (segments.min() < 0 or segments.max() > last):
            raise InputError(
                f"segments lie in [{segments.min()}, {segments.max()}]: they must lie in "
                f"[0, {last}]"
            )
        ends = []
        for circle in (segments, segments + 1):
            spoke = (
                np.cos(coordinates.theta)[..., None] * self.frames[circle, :, 0]
                + np.sin(coordinates.theta)[..., None] * self.frames[circle, :, 1]
            )
            size = (self.radii[circle] * coordinates.u)[..., None]
            ends.append(self.centres[circle] + size * spoke)
        t = np.asarray(coordinates.t)[..., None]
        return np.asarray((1.0 - t) * ends[0] + t * ends[1])

    @cached_property
    def _axes(self) -> NDArray[np.float64]:
        """(n - 1, 3) direction across the bend of each segment, in both circles' planes."""
        axes = []
        for n1, n2 in zip(self.normals[:-1], self.normals[1:], strict=True):
            axis = np.cross(n1, n2)
            if np.linalg.norm(axis) < 1e-12:
                axis = np.cross(n1, np.eye(3)[int(np.argmin(np.abs(n1)))])
            # Rounding leaves a part along the normals; off them it is of second order.
            axis = axis / np.linalg.norm(axis)
            axis -= (axis @ n1) * n1
            axes.append(axis / np.linalg.norm(axis))
        return np.array(axes)

    @cached_property
    def _frames(self) -> NDArray[np.float64]:
        frames = np.empty((len(self.centres), 3, 3))
        normal = self.normals[0]
        spoke = np.cross(self._axes[0], normal)
        for i, n in enumerate(self.normals):
            if i > 0:
                k = self._axes[i - 1]
                before, after = np.cross(k, self.normals[i - 1]), np.cross(k, n)
                spoke = (spoke @ before) * after + (spoke @ k) * k
                spoke = spoke / np.linalg.norm(spoke)
            frames[i] = np.stack([spoke, np.cross(n, spoke), n], axis=1)
        frames.flags.writeable = False
        return frames

    @cached_property
    def _bends(self) -> NDArray[np.float64]:
        """(n - 1,) angle, in the chain's frame, of the spoke in the plane of each bend [rad]."""
        spokes = np.cross(self._axes, self.normals[:-1])
        along = np.einsum("ij,ij->i", spokes, self.frames[:-1, :, 0])
        across = np.einsum("ij,ij->i", spokes, self.frames[:-1, :, 1])
        return np.asarray(np.arctan2(across, along))

    @cached_property
    def _numbers(self) -> NDArray[np.float64]:
        return pack_chain(self.centres, self.normals, self.radii, self._axes)

    def numbers(self) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
        """Return the numbers of the chain, and its bounding ball [mm]."""
        low = (self.centres - self.radii[:, None]).min(axis=0)
        high = (self.centres + self.radii[:, None]).max(axis=0)
        middle = 0.5 * (low + high)
        reach = float((np.linalg.norm(self.centres - middle, axis=1) + self.radii).max())
        return [self._numbers], np.array([[*middle, reach]])


def pack_chain(
    centres: NDArray[np.float64],
    normals: NDArray[np.float64],
    radii: NDArray[np.float64],
    axes: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the numbers of a chain for `kernels.cylinders`."""
    count = len(centres) - 1
    rows = [
        np.array([count, TOLERANCE * radii.max()]),
        np.array([*centres[0], *-normals[0], radii[0]]),
        np.array([*centres[-1], *normals[-1], radii[-1]]),
    ]
    for i in range(count):
        d = centres[i + 1] - centres[i]
        r1, r2, k = float(radii[i]), float(radii[i + 1]), axes[i]
        a1 = r1 * np.cross(k, normals[i])
        da = r2 * np.cross(k, normals[i + 1]) - a1
        dr = r2 - r1
        m1 = r1 * normals[i]
        dm = r2 * normals[i + 1] - m1
        # A ball about any point of the axis that reaches both circles holds all between them.
        t = min(max(0.5 + 0.5 * dr / float(np.linalg.norm(d)), 0.0), 1.0)
        middle = centres[i] + t * d
        reach = np.linalg.norm(centres[i : i + 2] - middle, axis=1) + radii[i : i + 2]
        spread = 0.25 * r1 * r2 * float(np.sum((normals[i + 1] - normals[i]) ** 2))
        rows.append(np.concatenate([centres[i], d, a1, da, k, [r1, dr], m1, dm, middle]))
        rows.append(np.array([reach.max() * (1.0 + 1e-12), spread]))
        rows.append(np.array([a1 @ d, r1 * (k @ d), d @ d, d @ da, dr * (k @ d)]))
        rows.append(np.array([a1 @ da, r1 * dr, da @ da, dr * dr]))
    return np.concatenate(rows)


def _turn_normals(centres: NDArray[np.float64], normals: NDArray[np.float64]) -> None:
    """Turn normals along the chain, in place."""
    steps = np.diff(centres, axis=0)
    sizes = np.linalg.norm(steps, axis=1)
    if sizes.min() == 0.0:
        i = int(np.argmin(sizes))
        raise GeometryError(f"circles {i} and {i + 1} have the same centre: there is no axis")
    for i, normal in enumerate(normals):
        ahead = [float(normal @ steps[j]) / sizes[j] for j in (i - 1, i) if 0 <= j < len(steps)]
        if min(ahead) < 0.0 and max(ahead) < 0.0:
            normal *= -1.0
        elif min(ahead) <= 0.0:
            angles = " and ".join(f"{np.degrees(np.arccos(c)):.0f} deg" for c in ahead)
            raise GeometryError(
                f"circle {i} does not lie across the duct: its normal is {angles} off the "
                "directions to its neighbours, it must be less than 90 deg off each"
            )


def measure_gaps(
    centres: NDArray[np.float64], normals: NDArray[np.float64], radii: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (n - 1,) how far circles stay from the planes of their neighbours, at least [mm]."""
    d = np.diff(centres, axis=0)
    sine = np.linalg.norm(np.cross(normals[:-1], normals[1:]), axis=1)
    ahead = np.einsum("ij,ij->i", normals[:-1], d) - radii[1:] * sine
    return np.asarray(np.minimum(ahead, np.einsum("ij,ij->i", normals[1:], d) - radii[:-1] * sine))


def _check_apart(
    centres: NDArray[np.float64], normals: NDArray[np.float64], radii: NDArray[np.float64]
) -> None:
    """Raise `GeometryError` if a circle reaches through the plane of the one before or after."""
    meet = measure_gaps(centres, normals, radii) <= 0.0
    if meet.any():
        i = int(np.argmax(meet))
        n1, n2 = normals[i], normals[i + 1]
        angle = np.degrees(np.arctan2(np.linalg.norm(np.cross(n1, n2)), float(n1 @ n2)))
        raise GeometryError(
            f"circles {i} and {i + 1} overlap: the spacing "
            f"{np.linalg.norm(centres[i + 1] - centres[i]):.3g} mm is too short for a bend of "
            f"{angle:.3g} deg and radii {radii[i]:g} and {radii[i + 1]:g} mm"
        )

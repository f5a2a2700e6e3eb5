"""Closed forms of arcs whose length is free: to a place, along a direction, through joints.

A section that may change its length reaches every place except straight behind its start. For
fixed lengths see `bozzini.continuum.inverse` and `bozzini.continuum.inverse`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bozzini.continuum.checks import check_directions, check_places
from bozzini.continuum.kernels.arc import put_arc
from bozzini.errors import GeometryError, InputError

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class SectionArc:
    """Arcs that start at the origin along +z, of any shape of batch.

    Parameters
    ----------
    bends : (..., 2) ndarray
        ``(theta cos(phi), theta sin(phi))`` [rad].
    lengths : (...) ndarray
        Their lengths [mm].
    """

    bends: Floats
    lengths: Floats

    @property
    def angle(self) -> Floats:
        """Bend angle theta [rad], not negative."""
        return np.asarray(np.hypot(self.bends[..., 0], self.bends[..., 1]))

    @property
    def direction(self) -> Floats:
        """Angle phi of the bending plane from +x about +z [rad]; 0 where straight."""
        return np.asarray(np.arctan2(self.bends[..., 1], self.bends[..., 0]))

    @property
    def curvature(self) -> Floats:
        """Curvature [1/mm]."""
        return self.angle / self.lengths


def solve_extensible(tips: ArrayLike) -> SectionArc:
    """Return the arcs from the origin, along +z, to places; their lengths are free.

    With ``rho = hypot(x, y)``: ``theta = 2 atan2(rho, z)``, and the chord gives the length.

    Parameters
    ----------
    tips : array_like, shape (..., 3)
        Places [mm].

    Returns
    -------
    SectionArc

    Raises
    ------
    InputError
        If `tips` has another shape, is not finite, or holds a place at or straight behind the
        origin, where no arc leads.
    """
    places = check_places("tips", tips)
    across = np.hypot(places[..., 0], places[..., 1])
    bad = (across == 0.0) & (places[..., 2] <= 0.0)
    if bad.any():
        x, y, z = places[bad][0]
        raise InputError(
            f"tip ({x:g}, {y:g}, {z:g}) mm lies at the start of the section or straight behind it, "
            "where no arc leads: z must be positive where x = y = 0"
        )
    half = np.arctan2(across, places[..., 2])
    plane = places[..., :2] / np.where(across > 0.0, across, 1.0)[..., None]
    chord = np.linalg.norm(places, axis=-1)
    bends = 2.0 * half[..., None] * plane
    return SectionArc(bends=bends, lengths=chord / np.sinc(half / math.pi))


def solve_joints(joints: ArrayLike) -> SectionArc:
    """Return arcs in series through chosen joints, each smooth with the one before.

    The lengths of the sections come out; for fixed lengths use `bozzini.continuum.inverse`.

    Parameters
    ----------
    joints : array_like, shape (m, 3)
        End of each section, from base to tip [mm]; the base stands at the origin along +z.

    Returns
    -------
    SectionArc
        With ``bends`` (m, 2), each in the frame of its section's start.

    Raises
    ------
    InputError
        If `joints` has another shape or is not finite.
    GeometryError
        If a joint lies straight behind the one before it; the message names the section.
    """
    points = check_places("joints", joints)
    if points.ndim != 2 or not len(points):
        raise InputError(f"joints has shape {points.shape}: it must be (m, 3), m at least 1")
    bends = np.empty((len(points), 2))
    lengths = np.empty(len(points))
    frame, after = np.eye(4), np.empty((4, 4))
    for index, point in enumerate(points):
        local = frame[:3, :3].T @ (point - frame[:3, 3])
        try:
            arc = solve_extensible(local)
        except InputError:
            raise GeometryError(
                f"joint {index + 1} lies straight behind the start of section {index + 1}, "
                "where no arc leads"
            ) from None
        bends[index], lengths[index] = arc.bends, arc.lengths
        put_arc(frame, float(arc.lengths), float(arc.bends[0]), float(arc.bends[1]), after)
        frame[:] = after
    return SectionArc(bends=bends, lengths=lengths)


def solve_direction(tangents: ArrayLike) -> Floats:
    """Return the bends after which the tip looks along tangents, whatever the length.

    Parameters
    ----------
    tangents : array_like, shape (..., 3)
        Directions, of any length. Straight back every plane is right; that of +x is taken.

    Returns
    -------
    (..., 2) ndarray
        ``(theta cos(phi), theta sin(phi))`` [rad], theta in [0, pi].

    Raises
    ------
    InputError
        If `tangents` has another shape, is not finite or holds a zero.
    """
    axes = check_directions("tangents", tangents)
    across = np.hypot(axes[..., 0], axes[..., 1])
    angle = np.arctan2(across, axes[..., 2])
    plane = np.arctan2(axes[..., 1], axes[..., 0])
    return np.stack([angle * np.cos(plane), angle * np.sin(plane)], axis=-1)

"""Unions of balls: discs in the plane, and round cones, the analytic tubular duct."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ...checks import check_number, show_apart
from ...errors import InputError
from ...numeric.arrays import Floats
from ..base import DuctShape
from ..checks import (
    check_counts,
    check_radii,
    freeze_array,
    freeze_places,
    set_fields,
)
from .base import ShapeUnion


class _Balls(DuctShape):
    """What unions of balls share."""

    centres: NDArray[np.float64]
    radii: NDArray[np.float64]

    columns = {"centre": ("centres", "lengths"), "radius": ("radii", "length")}
    exact_outside = True

    def __post_init__(self) -> None:
        centres = freeze_places("centres", self.centres, self.dim)
        radii = freeze_array("radii", self.radii, ())
        check_counts(len(centres), {"radii": radii})
        check_radii(radii)
        super().__post_init__()
        set_fields(self, centres=centres, radii=radii)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, dim) corners of the box around the balls [mm]."""
        reach = (self.radii + self.inflation)[:, None]
        return np.stack([(self.centres - reach).min(axis=0), (self.centres + reach).max(axis=0)])


@dataclass(frozen=True, eq=False)
class Circles(_Balls, ShapeUnion):
    """The union of discs: what `without` takes away from a planar duct.

    Parameters
    ----------
    centres : (n, 2) float
        Of the discs [mm].
    radii : (n,) float
        Of the discs [mm].
    inflation, wall, wall_error
        See `DuctShape`.

    Raises
    ------
    InputError
        If a radius is not positive.

    Notes
    -----
    ``|x - c| - r`` of the nearest disc: exact outside, and inside a lower bound of the depth,
    exact in one disc. Eq. 5.14's ``|x - c|^2 - r^2`` is an area. The discs need not be
    connected.
    """

    centres: NDArray[np.float64]
    radii: NDArray[np.float64]
    wall: str = field(default="union of discs", kw_only=True)

    name = "circles"
    code = 2
    dim = 2

    def guard_links(self, length: float, *, radius: float = 0.0) -> Circles:
        """Return discs so much larger that no link between joints outside them cuts the old ones.

        A joint outside each disc does not keep a link outside: a chord with both ends at least
        ``sqrt((r + radius)^2 + length^2 / 4)`` from the centre stays ``r + radius`` away.

        Parameters
        ----------
        length : float
            Of a link [mm].
        radius : float
            Of its body [mm].
        """
        check_number("length", length, low=0.0, unit="mm")
        check_number("radius", radius, low=0.0, unit="mm")
        grown = [math.hypot(float(r) + radius, 0.5 * length) for r in self.radii]
        return replace(self, radii=np.array(grown))

    def numbers(self) -> tuple[list[Floats], Floats]:
        """Return centre and radius of each disc, and bounding balls [mm]."""
        numbers = np.concatenate([self.centres, self.radii[:, None]], axis=1)
        flat = np.zeros((len(self.radii), 1))
        balls = np.concatenate([self.centres, flat, self.radii[:, None]], axis=1)
        return list(numbers), balls

    @staticmethod
    def move(row: Floats, rotation: Floats, shift: Floats) -> bool:
        """Move the centre."""
        row[:2] = rotation[:2, :2] @ row[:2] + shift[:2]
        return True


@dataclass(frozen=True, eq=False)
class RoundCones(_Balls, ShapeUnion):
    """The hulls of each two consecutive balls of a chain: a tube of changing radius.

    Parameters
    ----------
    centres : (n, 3) float
        Of the balls, along the tube [mm].
    radii : (n,) float
        Of the balls [mm]. Between two centres the radius changes linearly.
    inflation, wall, wall_error
        See `DuctShape`.

    Raises
    ------
    InputError
        If a centre is not finite or a radius not positive.

    Notes
    -----
    The signed distance is the smallest of ``|x - c| - r(c)`` over all points c of the chain. It
    is exact outside. Inside it is the clearance of the ball of the chain that leaves most, a lower
    bound of the depth: exact in one cone, less where the chain bends or narrows to a neck. It is
    1-Lipschitz, and `erode` is exact: the same with smaller radii. Both ends are closed by balls.
    A single ball is a chain too.
    """

    centres: NDArray[np.float64]
    radii: NDArray[np.float64]
    wall: str = field(default="chain of round cones, ends closed by balls", kw_only=True)

    name = "cones"
    code = 14
    joined = True
    dim = 3

    def erode(self, clearance: float) -> RoundCones:
        """Return the tube of all places with at least `clearance` mm to the wall.

        Raises
        ------
        InputError
            If nothing is left at a ball, with its index: the tube would be interrupted there.
        """
        check_number("clearance", clearance, low=0.0, unit="mm")
        rest = self.radii + self.inflation - clearance
        if rest.min() <= 0.0:
            index = int(np.argmin(rest))
            shown = show_apart(clearance, self.radii[index] + self.inflation)
            raise InputError(
                f"clearance is {shown[0]} mm: it must be below the radius of every ball, and "
                f"ball {index} has {shown[1]} mm"
            )
        wall = f"{self.wall}, {clearance:g} mm inside"
        return RoundCones(self.centres, rest, wall=wall, wall_error=self.wall_error)

    def numbers(self) -> tuple[list[Floats], Floats]:
        """Return the numbers of each cone, and bounding balls [mm].

        Start (3), axis (3), length, sine and cosine of the half angle, both radii. A cone whose
        one ball holds the other is that ball.
        """
        rows, balls = [], []
        for k in range(max(1, len(self.centres) - 1)):
            pair = [k, min(k + 1, len(self.centres) - 1)]
            (a, b), (ra, rb) = self.centres[pair], self.radii[pair].tolist()
            size = float(np.linalg.norm(b - a))
            sine = (ra - rb) / size if size > abs(ra - rb) else 1.0
            cosine = math.sqrt(max((1.0 - sine) * (1.0 + sine), 0.0))
            if cosine < 1e-9:
                a, ra = (a, ra) if ra >= rb else (b, rb)
                rows.append(np.array([*a, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, ra, ra]))
                balls.append([*a, ra])
                continue
            axis = (b - a) / size
            around = 0.5 * (size + ra + rb)
            rows.append(np.array([*a, *axis, size, sine, cosine, ra, rb]))
            balls.append([*(a + (around - ra) * axis), around])
        return rows, np.array(balls)

    @staticmethod
    def move(row: Floats, rotation: Floats, shift: Floats) -> bool:
        """Move the start, turn the axis."""
        row[:3] = rotation @ row[:3] + shift
        row[3:6] = rotation @ row[3:6]
        return True

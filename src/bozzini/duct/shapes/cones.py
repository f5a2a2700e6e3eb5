"""A chain of round cones: the analytic tubular duct, in place of the thesis's cylinders."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...checks import check_number
from ...errors import InputError
from ..base import check_counts, check_radii, check_wall, freeze_array, freeze_places, set_fields
from .common import ROUNDING, AnalyticDuct

if TYPE_CHECKING:
    from ..kernels.clearance import ConesData


@dataclass(frozen=True, eq=False)
class RoundCones(AnalyticDuct):
    """The hulls of each two consecutive balls of a chain: a tube of changing radius.

    Parameters
    ----------
    centres : (n, 3) float
        Of the balls, along the tube [mm].
    radii : (n,) float
        Of the balls [mm]. Between two centres the radius changes linearly.
    inflation : float
        The wall is moved outwards by this much [mm]: all radii count as larger by it.
    wall : str
        What the wall is, in words.
    wall_error : float
        How far the true wall may be from the stated one [mm]; 0 if the cones are the tube itself.

    Raises
    ------
    InputError
        If a centre is not finite or a radius not positive.

    Notes
    -----
    The signed distance is the smallest of ``|x - c| - r(c)`` over all points c of the chain. It
    is exact outside. Inside it is the room of the roomiest ball of the chain there, a lower bound
    of the depth: exact in one cone, less where the chain bends or narrows to a neck. It is
    1-Lipschitz, and `erode` is exact: the same with smaller radii. Both ends are closed by balls.
    A single ball is a chain too.
    """

    centres: NDArray[np.float64]
    radii: NDArray[np.float64]
    inflation: float = field(default=0.0, kw_only=True)
    wall: str = field(default="chain of round cones, ends closed by balls", kw_only=True)
    wall_error: float = field(default=0.0, kw_only=True)

    dim = 3

    def __post_init__(self) -> None:
        centres = freeze_places("centres", self.centres, 3)
        radii = freeze_array("radii", self.radii, ())
        check_counts(len(centres), {"radii": radii})
        check_radii(radii)
        check_wall(self.inflation, self.wall_error)
        set_fields(self, centres=centres, radii=radii)

    @property
    def kind(self) -> str:
        """The distance is a lower bound of the room."""
        return "bound"

    @property
    def exact_outside(self) -> bool:
        """Outside it is the distance, before inflation."""
        return True

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) corners of the box around the tube [mm]."""
        reach = (self.radii + self.inflation)[:, None]
        low, high = (self.centres - reach).min(axis=0), (self.centres + reach).max(axis=0)
        return np.stack([low, high])

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
            raise InputError(
                f"clearance is {clearance:g} mm: it must be below the radius of every ball, and "
                f"ball {index} has {self.radii[index] + self.inflation:g} mm"
            )
        wall = f"{self.wall}, {clearance:g} mm inside"
        return RoundCones(self.centres, rest, wall=wall, wall_error=self.wall_error)

    def pack(self) -> ConesData:
        """Return the tube for compiled kernels."""
        return self._data

    @cached_property
    def _data(self) -> ConesData:
        from ..kernels.clearance import ConesData

        cones = pack_cones(self.centres, self.radii)
        size = float(np.abs(self.centres).max() + self.radii.max())
        return ConesData(cones, pack_blocks(cones), float(self.inflation), ROUNDING * size)


def pack_cones(centres: NDArray[np.float64], radii: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return one row (15,) per cone.

    Start (3), axis (3), length, sine and cosine of the half angle, both radii, and the bounding
    ball (4). A cone whose one ball holds the other is that ball.
    """
    rows = []
    for k in range(max(1, len(centres) - 1)):
        a, b = centres[k], centres[min(k + 1, len(centres) - 1)]
        ra, rb = float(radii[k]), float(radii[min(k + 1, len(radii) - 1)])
        size = float(np.linalg.norm(b - a))
        sine = (ra - rb) / size if size > abs(ra - rb) else 1.0
        cosine = math.sqrt(max((1.0 - sine) * (1.0 + sine), 0.0))
        if cosine < 1e-9:
            a, ra = (a, ra) if ra >= rb else (b, rb)
            rows.append([*a, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, ra, ra, *a, ra])
            continue
        axis = (b - a) / size
        around = 0.5 * (size + ra + rb)
        middle = a + (around - ra) * axis
        rows.append([*a, *axis, size, sine, cosine, ra, rb, *middle, around])
    return np.array(rows)


def pack_blocks(cones: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return bounding balls of runs of consecutive cones: centre (3), radius, first, last + 1."""
    count = len(cones)
    run = max(1, math.isqrt(count))
    blocks = []
    for first in range(0, count, run):
        balls = cones[first : first + run, 11:15]
        centre = 0.5 * (
            (balls[:, :3] - balls[:, 3:]).min(axis=0) + (balls[:, :3] + balls[:, 3:]).max(axis=0)
        )
        reach = float((np.linalg.norm(balls[:, :3] - centre, axis=1) + balls[:, 3]).max())
        blocks.append([*centre, reach * (1.0 + 1e-12), first, min(first + run, count)])
    return np.array(blocks)

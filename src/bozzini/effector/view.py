"""What is seen of an end-effector: places of its tip and markers, angles, a pointer's spot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..checks import check_fields, check_number, quantity
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Shown
from .section import shape_sections

if TYPE_CHECKING:
    from .effector import Effector

TIP = "tip"
"""Name of the backbone's end."""
SPOT = ("spot x", "spot y")
ANGLES = ("bend", "azimuth")
LATERAL = "lateral"

_PLACE = {"default": 0.0, "low": -1e5, "high": 1e5, "scale": 1.0}
_TURN = {"default": 0.0, "low": -math.pi, "high": math.pi, "scale": 0.05}


@dataclass(frozen=True, kw_only=True)
class TipView(Shown):
    """Where the base stands, and what a pointer at the tip throws its spot on.

    Angles and places are in the frame of whoever looks: places of the tip are turned and moved with
    the base. The board is met by a ray that goes straight on from the end of the holder.

    Parameters
    ----------
    base_x, base_y, base_z : float
        Origin of the base [mm].
    base_turn_x, base_turn_y, base_turn_z : float
        Rotation vector of the base [rad].
    board_distance : float
        From the end of the holder of the straight section to the board, along the axis [mm].
    board_slope_x, board_slope_y : float
        How much farther the board is for each mm sideways.
    board_x, board_y : float
        Reading on the board where the axis of the frame meets it [mm].
    markers : mapping of str to float
        Arc lengths of points on the body from the base [mm], by name.

    Raises
    ------
    InputError
        If a value is not legal.
    """

    base_x: float = quantity("length", "Origin of the base.", **_PLACE)
    base_y: float = quantity("length", "Origin of the base.", **_PLACE)
    base_z: float = quantity("length", "Origin of the base.", **_PLACE)
    base_turn_x: float = quantity("angle", "Turn of the base.", **_TURN)
    base_turn_y: float = quantity("angle", "Turn of the base.", **_TURN)
    base_turn_z: float = quantity("angle", "Turn of the base.", **_TURN)
    board_distance: float = quantity(
        "length", "From the straight tip to the board.", default=100.0, low=1e-3, high=1e5
    )
    board_slope_x: float = quantity(
        help="Slope of the board.", default=0.0, low=-2.0, high=2.0, scale=0.1
    )
    board_slope_y: float = quantity(
        help="Slope of the board.", default=0.0, low=-2.0, high=2.0, scale=0.1
    )
    board_x: float = quantity("length", "Reading at the axis.", **_PLACE)
    board_y: float = quantity("length", "Reading at the axis.", **_PLACE)
    markers: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_fields(self)
        for name, arc in self.markers.items():
            check_number(f"arc length of marker {name}", arc, low=0.0, high=1e5, unit="mm")

    def observe(self, effector: Effector, bends: Floats, *, channels: Sequence[str]) -> Floats:
        """Return what is seen, (n, q), of sections bent as of `find_bends` (n, 2).

        Channels are such as ``tip x`` and ``marker z`` [mm], ``spot x`` [mm], ``lateral`` [mm],
        ``bend`` and ``azimuth`` [rad] of the end's direction. A pointer that is turned away from
        the board has no spot: NaN.
        """
        design = effector.design
        end = design.backbone_length + design.holder_length
        arcs = {TIP: design.backbone_length, **self.markers}
        if set(channels) <= {*SPOT, *ANGLES}:
            arcs = {}  # what is seen is all of the end
        names = list(arcs)
        shapes = shape_sections(effector, bends, np.array([*arcs.values(), end]))
        points, ways = shapes.points, shapes.direction
        lateral = np.hypot(points[:, 0, 0], points[:, 0, 1])
        turn = (self.base_turn_x, self.base_turn_y, self.base_turn_z)
        if any(turn):
            from scipy.spatial.transform import Rotation

            matrix = Rotation.from_rotvec(turn).as_matrix()
            points, ways = points @ matrix.T, ways @ matrix.T
        points = points + np.array([self.base_x, self.base_y, self.base_z])
        spot = np.empty((0, 2))
        if not set(SPOT).isdisjoint(channels):
            spot = self._meet_board(points[:, -1], ways, end)
        found = []
        for channel in channels:
            name, _, axis = channel.rpartition(" ")
            if channel in SPOT:
                found.append(spot[:, SPOT.index(channel)])
            elif channel == LATERAL:
                found.append(lateral)
            elif channel == "bend":
                found.append(np.arctan2(np.hypot(ways[:, 0], ways[:, 1]), ways[:, 2]))
            elif channel == "azimuth":
                found.append(np.arctan2(ways[:, 1], ways[:, 0]))
            elif name in arcs and axis in ("x", "y", "z"):
                found.append(points[:, names.index(name), "xyz".index(axis)])
            else:
                raise InputError(
                    f"'{channel}' is nothing that is seen: name a marker with its arc length, or "
                    f"give {TIP} x, {', '.join(SPOT)}, {LATERAL}, {', '.join(ANGLES)}"
                )
        return np.stack(found, axis=-1)

    def _meet_board(self, ends: Floats, ways: Floats, end: float) -> Floats:
        """Return readings (n, 2) where rays from ends (n, 3) meet the board; NaN if they do not."""
        slope = np.array([-self.board_slope_x, -self.board_slope_y, 1.0])
        left, speed = end + self.board_distance - ends @ slope, ways @ slope
        meets = (speed > 0.0) & (left >= 0.0)
        steps = np.divide(left, speed, out=np.full(len(ends), np.nan), where=meets)
        hit = ends + steps[:, None] * ways
        return np.asarray(hit[:, :2] + np.array([self.board_x, self.board_y]))

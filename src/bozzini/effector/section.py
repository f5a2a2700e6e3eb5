"""A section in balance with what its muscles pull, by a law for each that is fitted to it.

Where nothing is known of braid and wall, or where muscles hinder each other, a muscle is what it
does to the section: it pulls with a force that rises with its pressure and falls with its
contraction (`MusclePull`). The section is an arc, and all muscles act at the same time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from ..checks import check_fields, quantity
from ..errors import InputError
from ..numeric.arrays import Floats
from .equilibrium import settle_muscles
from .kernels import motion as kernels
from .kernels import pose as pose_kernels
from .linkage import refuse_open

if TYPE_CHECKING:
    from .effector import Effector


@dataclass(frozen=True, kw_only=True)
class MusclePull:
    """What a muscle pulls with: ``F = (A + B P + C P**2) P - (k + s P) x`` [N].

    P is the pressure that acts [MPa], x the contraction [mm].

    Parameters
    ----------
    area : float
        A: pull per pressure of a low pressure, without contraction [mm^2].
    area_slope, area_curve : float
        B [mm^2/MPa] and C [mm^2/MPa^2]: how that changes with the pressure.
    stiffness : float
        k: without pressure [N/mm].
    stiffening : float
        s: stiffness per pressure [mm].
    """

    area: float = quantity(
        "area", "Pull per pressure without contraction.", default=1.0, scale=0.1,
        low=-1e4, high=1e4,
    )  # fmt: skip
    area_slope: float = quantity(
        help="Change of the area with pressure [mm^2/MPa].", default=0.0, scale=0.3,
        low=-1e5, high=1e5,
    )  # fmt: skip
    area_curve: float = quantity(
        help="Change of that with pressure [mm^2/MPa^2].", default=0.0, scale=0.3,
        low=-1e5, high=1e5,
    )  # fmt: skip
    stiffness: float = quantity(
        "stiffness", "Without pressure.", default=0.0, scale=0.1, low=0.0, high=1e4
    )
    stiffening: float = quantity(
        "length", "Stiffness per pressure.", default=0.0, scale=0.1, low=-1e4, high=1e4
    )

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, eq=False)
class Shapes:
    """Points (n, k, 3) [mm] of n sections at k arc lengths, and where they end: (n, 3) unit."""

    points: Floats
    direction: Floats


def find_bends(effector: Effector, pressures: Floats) -> Floats:
    """Return how sections at rest bend under pressures (n, m) that act [MPa], unchecked.

    With pulls of its own that is the bend (n, 2) [rad], otherwise the lateral deflection [mm] that
    the muscles ask for by superposition.
    """
    bends = np.empty((len(pressures), 2))
    design, packed = effector.design, effector.packed
    if effector.pulls is not None:
        kernels.balance_pulls(
            pack_pulls(effector.pulls),
            packed.cosines,
            packed.sines,
            design.offset,
            design.backbone_length / design.rigidity,
            np.ascontiguousarray(pressures),
            bends,
        )
        return bends
    lateral = settle_muscles(effector, np.ascontiguousarray(pressures)).lateral
    return np.stack([lateral @ packed.cosines, lateral @ packed.sines], axis=-1)


def pack_pulls(pulls: Sequence[MusclePull]) -> Floats:
    """Return laws as numbers (m, 5)."""
    names = [item.name for item in fields(MusclePull)]
    return np.array([[getattr(law, name) for name in names] for law in pulls])


def shape_sections(effector: Effector, bends: Floats, arcs: Floats) -> Shapes:
    """Return points at arc lengths (k,) [mm] of sections that are bent as of `find_bends` (n, 2).

    What is beyond the backbone goes straight on.
    """
    length = effector.design.backbone_length
    inside = np.minimum(arcs, length)
    beyond = (arcs - inside)[:, None]
    if effector.pulls is None:
        points, ends = _bend_linkage(effector, bends, inside)
    else:
        angle = np.linalg.norm(bends, axis=-1)[:, None]
        share = angle * inside / length
        # sin(x)/x and (1 - cos(x))/x**2 without their gaps at 0.
        sine = inside * np.sinc(share / np.pi)
        sideways = 0.5 * inside**2 / length * np.sinc(0.5 * share / np.pi) ** 2
        points = np.stack(
            [sideways * bends[:, :1], sideways * bends[:, 1:], sine + 0.0 * share], axis=-1
        )
        lean = np.sinc(angle / np.pi)
        ends = np.concatenate([lean * bends, np.cos(angle)], axis=-1)
    return Shapes(points + beyond * ends[:, None, :], ends)


def _bend_linkage(effector: Effector, bends: Floats, arcs: Floats) -> tuple[Floats, Floats]:
    """Return points (n, k, 3) and ends (n, 3) of the linkage, between its joints."""
    packed, design = effector.packed, effector.design
    count, joints = len(bends), design.segments + 1
    vectors, backbones = np.empty((count, 4)), np.empty((count, joints, 3))
    ends = np.empty((count, 3))
    case, failed = pose_kernels.superpose(
        packed.linkage,
        packed.peak.contraction,
        packed.peak.lateral,
        np.array([1.0, 0.0]),
        np.array([0.0, 1.0]),
        np.zeros((count, 2)),
        np.ascontiguousarray(bends),
        np.empty((2, joints)),
        vectors,
        backbones,
        ends,
    )
    if failed > 0:
        raise refuse_open(design, float(vectors[case, 3]), failed)
    places = arcs * design.segments / design.backbone_length
    below = np.minimum(places.astype(np.int64), design.segments - 1)
    share = (places - below)[:, None]
    return (1.0 - share) * backbones[:, below] + share * backbones[:, below + 1], ends


def take_pulls(pulls: object, names: tuple[str, ...]) -> tuple[MusclePull, ...]:
    """Return the laws of all muscles, checked."""
    found = tuple(pulls) if isinstance(pulls, Sequence) else ()
    if len(found) != len(names) or not all(isinstance(law, MusclePull) for law in found):
        raise InputError(
            f"pulls are {pulls!r:.60}: they must be a MusclePull for each of {list(names)}"
        )
    return found

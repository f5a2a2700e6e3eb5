"""How far each muscle alone takes the tip at the pressure limit."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ._equilibrium_kernels import SATURATED
from ._pack import PackedEffector
from ._settle import settle_muscles
from .effector import Effector
from .forward import describe_end
from .sectors import Sectors, find_sectors

__all__ = ["Reach", "find_reach"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Reach:
    """What the muscles of an end-effector can do, each alone.

    Attributes
    ----------
    names : tuple of str
        The muscles, in the order of the design.
    amplitudes : (m,) float
        Lateral deflection by each at the pressure limit, ``A_i`` [mm].
    saturated : (m,) bool
        Whether the muscle could go on, but the backbone's largest deflection is reached.
    peak : float
        The backbone's largest deflection [mm].
    peak_reason : str
        What ends it there, in words.
    pressure_limit : float
        The pressure limit [MPa].
    sectors : Sectors
        The sectors between the muscles.
    """

    names: tuple[str, ...]
    amplitudes: NDArray[np.float64]
    saturated: NDArray[np.bool_]
    peak: float
    peak_reason: str
    pressure_limit: float
    sectors: Sectors


# By identity: packing is what an effector does once, and its hash would cost more than an inverse.
_KNOWN: WeakKeyDictionary[PackedEffector, Reach] = WeakKeyDictionary()


def find_reach(effector: Effector) -> Reach:
    """Return how far each muscle alone takes the tip; computed once for an effector.

    It is what it does at the pressure limit, which is the most as long as more pressure contracts
    the muscle more. (`ThesisMuscle` contracts less again above some 3 MPa.)

    Raises
    ------
    InputError
        If a muscle's model has no answer at the pressure limit.
    """
    known = _KNOWN.get(effector.packed)
    if known is not None:
        return known
    design = effector.design
    settled = settle_muscles(effector, np.full((1, len(design.muscles)), design.pressure_limit))
    amplitudes = np.minimum(settled.lateral[0], effector.packed.peak.lateral)
    saturated = settled.code[0] == SATURATED
    amplitudes.setflags(write=False)
    saturated.setflags(write=False)
    found = Reach(
        names=design.names,
        amplitudes=amplitudes,
        saturated=saturated,
        peak=effector.packed.peak.lateral,
        peak_reason=describe_end(design),
        pressure_limit=design.pressure_limit,
        sectors=find_sectors(design),
    )
    _KNOWN[effector.packed] = found
    return found

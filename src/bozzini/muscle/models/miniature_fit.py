"""A pull of Gaylord's form with fitted constants, solved for the strain (thesis 2.2.8)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import broadcast, check_array, check_range, name_at
from ...errors import InputError
from ..design import Muscle
from ..model import LOAD_LIMIT
from .base import PRESSURE_LIMIT, CatalogueModel
from .card import SHAPE_FIELDS, Card, Parameter

__all__ = ["FAMILY", "StrainFit"]

Floats = NDArray[np.float64]


class StrainFit(CatalogueModel):
    """A pull of Gaylord's form with fitted constants, which the survey solves for the strain.

    ``F = P [kappa1 (1 - eps)**2 + kappa3] + kappa2``; `find_strain` is the closed form of (2.40).
    Gaylord's has ``kappa1 = pi r0**2 q1``, ``kappa3 = -pi r0**2 q2`` and no ``kappa2``.
    `find_radial_strain` is (2.41), of constants that come from measured radii, not forces; only
    their ratios matter, and by default the muscle keeps its volume.
    """

    card = Card(
        name="strain-fit",
        title="Gaylord's form with fitted constants, solved for the strain",
        authors="unnamed in the survey",
        reference="Reference [45] of the thesis",
        equation="(2.40)-(2.41)",
        status="fitted",
        parameters=(
            Parameter(
                name="kappa1",
                unit="N/MPa",
                what="pull per pressure and squared stretch",
                source="fitted",
                bounds=(1e-9, 1e9),
                linear=True,
            ),
            Parameter(
                name="kappa2",
                unit="N",
                what="pull without pressure",
                source="fitted",
                neutral=0.0,
                bounds=(-1e9, 1e9),
                linear=True,
            ),
            Parameter(
                name="kappa3",
                unit="N/MPa",
                what="pull per pressure, negative",
                source="fitted",
                bounds=(-1e9, 1e9),
                linear=True,
            ),
            Parameter(
                name="kappa4",
                unit="",
                what="volume per squared strain",
                source="measured",
                default=0.0,
                neutral=0.0,
                bounds=(-1e9, 1e9),
            ),
            Parameter(
                name="kappa5",
                unit="",
                what="volume per strain",
                source="measured",
                default=0.0,
                neutral=0.0,
                bounds=(-1e9, 1e9),
            ),
            Parameter(
                name="kappa6",
                unit="",
                what="volume at rest",
                source="measured",
                default=1.0,
                neutral=1.0,
                bounds=(1e-9, 1e9),
            ),
        ),
        uses=SHAPE_FIELDS,
        latex=r"\epsilon = 1 - \sqrt{\frac{1}{\kappa_1} \left(\frac{F - \kappa_2}{P} - "
        r"\kappa_3\right)}, \quad \epsilon_r = \sqrt{\frac{\kappa_4 \epsilon^2 + \kappa_5 \epsilon "
        r"+ \kappa_6}{\kappa_6 (1 - \epsilon)}} - 1",
    )

    @classmethod
    def guess_parameters(cls, muscle: Muscle) -> dict[str, float]:
        """Return the constants of Gaylord's pull."""
        area = math.pi * muscle.braid_radius**2
        return {
            **super().guess_parameters(muscle),
            "kappa1": 3.0 * area / math.tan(muscle.braid_angle) ** 2,
            "kappa3": -area / math.sin(muscle.braid_angle) ** 2,
        }

    def find_strain(self, pressure: ArrayLike, load: ArrayLike = 0.0) -> Floats:
        """Return the strain of contraction under a load, in closed form (2.40).

        Parameters
        ----------
        pressure : array_like
            Pressure [MPa], above 0.
        load : array_like
            Load [N]; broadcast with `pressure`.

        Raises
        ------
        InputError
            If an argument is outside its legal range, or the strain is not a legal contraction's.
        """
        given = self.parameters
        pressures, loads = check_array("pressure", pressure), check_array("load", load)
        check_range("pressure", pressures, 1e-300, PRESSURE_LIMIT, "MPa")
        check_range("load", loads, 0.0, LOAD_LIMIT, "N")
        pressures, loads = broadcast(("pressure", pressures), ("load", loads))
        with np.errstate(all="ignore"):
            square = ((loads - given["kappa2"]) / pressures - given["kappa3"]) / given["kappa1"]
        low, high = (1.0 - x / self.braid.length for x in self.contraction_limits[::-1])
        check_range(
            "squared stretch",
            square,
            low**2,
            high**2,
            hint=": pressure and load must leave a legal length",
        )
        return np.asarray(1.0 - np.sqrt(square))

    def find_radial_strain(self, strain: ArrayLike) -> Floats:
        """Return the strain of the radius ``(r - r0) / r0`` at a strain of contraction (2.41).

        Parameters
        ----------
        strain : array_like
            Strain of contraction, below 1.

        Raises
        ------
        InputError
            If a strain is 1 or above, or the constants have no volume there.
        """
        given, strains = self.parameters, check_array("strain", strain)
        check_range("strain", strains, -1e6, 1.0 - 1e-12)
        volume = (given["kappa4"] * strains + given["kappa5"]) * strains / given["kappa6"] + 1.0
        if volume.size and volume.min() < 0.0:
            index = int(np.argmin(volume))
            raise InputError(
                f"{name_at('strain', strains, index)} is {strains.flat[index]:g}: the volume of "
                f"(2.41) is {volume.flat[index]:g} of that at rest there, it must not be negative"
            )
        return np.asarray(np.sqrt(volume / (1.0 - strains)) - 1.0)

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        given = self.parameters
        stretch = length / self.braid.length
        share = given["kappa1"] * stretch**2 + given["kappa3"]
        return np.asarray(pressure * share + given["kappa2"])


FAMILY: tuple[type[CatalogueModel], ...] = (StrainFit,)
"""The models of this module, for the registry."""

"""The phantom's dimensions, each with where it comes from, and the range over which it varies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError

__all__ = ["DIMENSIONS", "Dimension", "draw_dimensions"]


@dataclass(frozen=True, kw_only=True)
class Dimension:
    """One dimension of the phantom.

    Attributes
    ----------
    name, unit : str
        What it is.
    value : float
        Of the standard phantom (seed 0).
    low, high : float
        Range from which other seeds draw, evenly.
    basis : str
        The published figure behind it, or that it is a choice.
    """

    name: str
    unit: str
    value: float
    low: float
    high: float
    basis: str

    def __post_init__(self) -> None:
        if not self.low <= self.value <= self.high:
            raise InputError(
                f"{self.name} is {self.value:g}: it must lie in [{self.low:g}, {self.high:g}]"
            )


_LI = (
    "22.9 cm between the sphincters, men 23.6, women 22.4: Li, Castell, Castell, 'Manometric "
    "determination of esophageal length', Am J Gastroenterol 1994;89:722-5"
)
_FERHATOGLU = (
    "about 2 cm in diameter: Ferhatoglu, Kivilcim, 'Anatomy of Esophagus', in Esophageal "
    "Abnormalities, 2017, doi:10.5772/intechopen.69583"
)
_KUIKEN = (
    "chosen so that the stomach holds about 0.4 L, between fasting 0.18 L and after a meal "
    "0.69 L: Kuiken et al., 'Development of a test to measure gastric accommodation in humans', "
    "Am J Physiol 1999;277:G1217-21"
)
_STOMACH = (
    "length 19 +- 2.5 cm in men, 17.1 +- 2.0 cm in women, J-shaped in 58 %: 'A study of "
    "variations of the stomach in adults and growth of the fetal stomach' (50 cadavers); the line "
    "along a J is longer than the J is high"
)
_PYLORUS = (
    "14.3 +- 1.8 mm at 50 mL of an EndoFLIP balloon, 24 healthy volunteers: PMC9529766; 90th "
    "percentile 17.6 mm at 40 mL: Jagtap et al., 'Assessment of pyloric sphincter physiology "
    "using functional luminal imaging probe in healthy volunteers', J Neurogastroenterol Motil "
    "2020;26:391-6"
)
_DUODENUM = (
    "24.8 +- 4.5 mm on MR enterography: Cronin et al., 'Normal small bowel wall characteristics "
    "on MR enterography', Eur J Radiol (65 subjects)"
)
_GRAY = "Gray, 'Anatomy of the Human Body', 20th ed. 1918, p. 1169-70: "
_CHOICE = "a choice: no figure was found"

DIMENSIONS = (
    Dimension(
        name="oesophagus_length", unit="mm", value=230.0, low=210.0, high=250.0, basis=_LI
    ),
    Dimension(
        name="oesophagus_diameter", unit="mm", value=20.0, low=18.0, high=22.0, basis=_FERHATOGLU
    ),
    Dimension(name="stomach_length", unit="mm", value=210.0, low=190.0, high=230.0, basis=_STOMACH),
    Dimension(name="body_diameter", unit="mm", value=64.0, low=56.0, high=70.0, basis=_KUIKEN),
    Dimension(name="antrum_diameter", unit="mm", value=44.0, low=38.0, high=48.0, basis=_CHOICE),
    Dimension(name="stomach_bend", unit="mm", value=42.0, low=41.0, high=46.0, basis=_CHOICE),
    Dimension(name="pylorus_diameter", unit="mm", value=14.3, low=12.5, high=16.1, basis=_PYLORUS),
    Dimension(
        name="superior_length", unit="mm", value=50.0, low=47.0, high=55.0,
        basis=_GRAY + "superior part about 5 cm",
    ),
    Dimension(
        name="descending_length", unit="mm", value=95.0, low=75.0, high=100.0,
        basis=_GRAY + "descending part 7 to 10 cm",
    ),
    Dimension(
        name="horizontal_length", unit="mm", value=72.0, low=55.0, high=75.0,
        basis=_GRAY + "horizontal part 5 to 7.5 cm",
    ),
    Dimension(
        name="ascending_length", unit="mm", value=30.0, low=25.0, high=35.0,
        basis=_GRAY + "ascending part about 2.5 cm",
    ),
    Dimension(
        name="duodenum_diameter", unit="mm", value=24.8, low=21.0, high=28.0, basis=_DUODENUM
    ),
    Dimension(name="flexure_bend", unit="mm", value=21.0, low=20.0, high=23.0, basis=_CHOICE),
)  # fmt: skip
"""The phantom's dimensions in the order in which a seed draws them."""


def draw_dimensions(random: np.random.Generator | None) -> dict[str, float]:
    """Return the standard dimensions, or a draw from their ranges."""
    if random is None:
        return {item.name: item.value for item in DIMENSIONS}
    return {item.name: float(random.uniform(item.low, item.high)) for item in DIMENSIONS}

"""Measured Festo muscles fitted by SciPy alone: formulas, reader and fits of their own.

Nothing of the package is used here: what it finds on the same rows is held against this.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

RADIUS, THICKNESS = 5.0, 1.0
"""Radius of the braid, and thickness of the wall inside it [mm]: taken, not measured."""


@dataclass(frozen=True)
class Rows:
    """Columns of the table, shape (n,): MPa, mm, N; `inflating` is a flag."""

    pressure: np.ndarray
    contraction: np.ndarray
    force: np.ndarray
    rest: np.ndarray
    inflating: np.ndarray
    free: np.ndarray

    @property
    def stretch(self) -> np.ndarray:
        return 1.0 - self.contraction / self.rest

    def select(self, rows: np.ndarray) -> Rows:
        return Rows(*(column[rows] for column in vars(self).values()))


def read_rows(path: Path) -> Rows:
    """The taut plateaus; `Rows.free` is the length without load at 620 kPa."""
    lines = [line for line in path.read_text("utf-8").splitlines() if not line.startswith("#")]
    head, *body = [line.split(",") for line in lines]
    column = {name: [row[i] for row in body] for i, name in enumerate(head)}

    def take(name: str) -> np.ndarray:
        return np.array(column[name], dtype=np.float64)

    return Rows(
        pressure=take("pressure [kPa]") / 1e3,
        contraction=take("contraction [mm]"),
        force=take("load [N]"),
        rest=take("rest length [mm]"),
        inflating=np.array(column["direction"]) == "inflating",
        free=take("length at 620 kPa [mm]"),
    )


# Laws: pull at a pressure and a stretch, of a cylinder of radius `RADIUS` in a braid whose strands
# keep their length, r**2 = r0**2 (1 - stretch**2 cos**2) / sin**2. All work with complex stretches,
# so that slopes are those of complex steps.


def widen(angle: float, stretch: np.ndarray) -> np.ndarray:
    """Radius over that at rest."""
    return np.sqrt(1.0 - stretch**2 * np.cos(angle) ** 2) / np.sin(angle)


def slope(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    return np.imag(function(at + 1e-30j)) / 1e-30


def ideal(angle: float, pressure: np.ndarray, stretch: np.ndarray) -> np.ndarray:
    """Pressure times the slope of the volume, pi r**2 l."""
    return -pressure * np.pi * RADIUS**2 * slope(lambda x: widen(angle, x) ** 2 * x, stretch)


def factored(angle: float, pressure: np.ndarray, acting: np.ndarray) -> np.ndarray:
    """Gaylord's pull with a strain of another size; NaN where the strands would be hoops."""
    first, second = 3.0 / np.tan(angle) ** 2, 1.0 / np.sin(angle) ** 2
    cosine = np.cos(angle) * (1.0 - acting)
    legal = (cosine >= np.cos(np.radians(89.0))) & (cosine <= np.cos(np.radians(0.5)))
    force = np.pi * RADIUS**2 * pressure * (first * (1.0 - acting) ** 2 - second)
    return np.where(legal, force, np.nan)


AREA = np.pi * THICKNESS * (2.0 * RADIUS - THICKNESS)


def thickness(angle: float, stretch: np.ndarray) -> np.ndarray:
    """Of a wall that keeps its volume."""
    radius = RADIUS * widen(angle, stretch)
    return radius - np.sqrt(radius**2 - AREA / np.pi / stretch)


def stored(angle: float, stretch: np.ndarray, density: Callable[..., np.ndarray]) -> np.ndarray:
    """Slope of the energy of a wall that keeps its volume, by the stretch of its middle."""

    def energy(x: np.ndarray) -> np.ndarray:
        radius, thick = RADIUS * widen(angle, x), thickness(angle, x)
        return density(x, (2.0 * radius - thick) / (2.0 * RADIUS - THICKNESS))

    return AREA * slope(energy, stretch)


def gaylord(p, x, angle):
    return ideal(angle, p, x)


def chou(p, x, angle):
    volume = lambda y: np.pi * (RADIUS * widen(angle, y) - THICKNESS) ** 2 * y  # noqa: E731
    return -p * slope(volume, x)


def tondu_lopez(p, x, angle, kappa1, kappa2):
    return factored(angle, p, (kappa1 * np.exp(-p / 0.1) + kappa2) * (1.0 - x))


def itto_b(p, x, angle, kappa1, kappa2):
    return factored(angle, p, kappa1 * (1.0 + np.exp(kappa2 * p)) * (1.0 - x))


def ferraresi(p, x, angle, modulus):
    """Axial stress on the area at rest; hoop stress times thickness at rest works on the radius."""
    round_it = THICKNESS * 2.0 * np.pi * RADIUS * x * slope(lambda y: widen(angle, y), x)
    wall = modulus * (x - 1.0) * AREA + modulus * (widen(angle, x) - 1.0) * round_it
    return ideal(angle, p, x) + wall


def kothera_balance(p, x, angle, modulus):
    """Balance of a wall that keeps its volume: both stresses, and the pressure on its section."""
    thick = thickness(angle, x)
    round_it = thick * 2.0 * np.pi * RADIUS * x * slope(lambda y: widen(angle, y), x)
    hoop = modulus * (THICKNESS / (thick * x) - 1.0)
    section = AREA / x
    return ideal(angle, p, x) + (modulus * (x - 1.0) + p) * section + (hoop + p) * round_it


def delson(p, x, angle, c10, c01):
    def density(one, two):
        three = 1.0 / (one * two)
        first, second = one**2 + two**2 + three**2, one**-2 + two**-2 + three**-2
        return c10 * first + c01 * second

    return ideal(angle, p, x) + stored(angle, x, density)


def ogden(p, x, angle, modulus, exponent):
    def density(one, two):
        powers = one**exponent + two**exponent + (one * two) ** -exponent
        return 2.0 * modulus / (3.0 * exponent**2) * powers

    return ideal(angle, p, x) + stored(angle, x, density)


def quadratic_strain(p, x, *kappa):
    e = 1.0 - x
    return kappa[0] + kappa[1] * e + kappa[2] * e**2 + (kappa[3] + kappa[4] * e) * p


def quartic_strain(p, x, *kappa):
    e = 1.0 - x
    return np.polyval(kappa[2::-1], e) * p + np.polyval(kappa[:2:-1], e)


def damped_strain(p, x, *kappa):
    return np.polyval(kappa[:3], p) * (1.0 - x) + kappa[3] * p + kappa[4]


def strain_fit(p, x, *kappa):
    return kappa[1] + p * (kappa[2] + kappa[0] * x**2)


LAWS: dict[str, tuple[Callable[..., np.ndarray], tuple[float, ...]]] = {
    "gaylord-2": (gaylord, (0.45,)),
    "chou": (chou, (0.45,)),
    "tondu-lopez": (tondu_lopez, (0.45, 2.0, 1.5)),
    "itto-b": (itto_b, (0.45, 0.8, -1.0)),
    "ferraresi": (ferraresi, (0.45, 3.0)),
    "kothera-balance": (kothera_balance, (0.45, 3.0)),
    "delson": (delson, (0.45, 0.5, 0.1)),
    "ogden": (ogden, (0.45, 5.0, 1.5)),
    "quadratic-strain": (quadratic_strain, (0.0, 0.0, 0.0, 600.0, 0.0)),
    "quartic-strain": (quartic_strain, (600.0, *7 * (0.0,))),
    "damped-strain": (damped_strain, (0.0, 0.0, 0.0, 600.0, 0.0)),
    "strain-fit": (strain_fit, (600.0, 0.0, 0.0)),
}
"""Laws by the names of the catalogue, with where a fit begins; an angle comes first [rad]."""


def fit_law(name: str, rows: Rows) -> tuple[np.ndarray, float]:
    """Constants of the best of several searches on all lengths together, and rms error [N]."""
    law, start = LAWS[name]
    scale = np.maximum(np.abs(start), 0.1)

    def miss(constants: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            found = law(rows.pressure, rows.stretch, *constants) - rows.force
        return np.where(np.isfinite(found), found, np.ptp(rows.force))

    generator = np.random.default_rng(0)
    best = None
    for spread in (0.0, 0.2, 0.5, 0.8):
        begin = np.array(start) + spread * scale * generator.uniform(-0.5, 0.5, len(start))
        found = least_squares(miss, begin, x_scale=scale, max_nfev=200)
        if best is None or found.cost < best.cost:
            best = found
    return best.x, float(np.sqrt(2.0 * best.cost / len(rows.force)))

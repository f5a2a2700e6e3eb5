"""A ranking on measured forces, against one made with SciPy and equations written anew here.

The data are isometric forces of DMSP-10 muscles of four lengths; they are not distributed with the
package. Without them the same is done on forces that are made here.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from bozzini.muscle import (
    MODELS,
    FitOptions,
    Measurements,
    Muscle,
    RankOptions,
    rank,
    read_measurements,
)

RADIUS, INNER, ANGLE = 5.0, 4.0, math.radians(23.0)
THICKNESS = RADIUS - INNER
Q1, Q2 = 3.0 / math.tan(ANGLE) ** 2, 1.0 / math.sin(ANGLE) ** 2
AREA = math.pi * RADIUS**2
MUSCLE = Muscle(
    length=100.0, outer_radius=RADIUS, inner_radius=INNER, braid_angle=ANGLE, modulus=1.0
)


def list_lengths(rest, x):
    """Length, strand, turns and radius of the braid."""
    strand = rest / math.cos(ANGLE)
    turns = strand * math.sin(ANGLE) / (2.0 * math.pi * RADIUS)
    length = rest - x
    return length, strand, turns, np.sqrt(strand**2 - length**2) / (2.0 * math.pi * turns)


def gaylord(p, x, rest):
    length, strand, turns, _ = list_lengths(rest, x)
    return p * (3.0 * length**2 - strand**2) / (4.0 * math.pi * turns**2)


def chou(p, x, rest):
    length, strand, turns, _ = list_lengths(rest, x)
    sine = np.sqrt(1.0 - (length / strand) ** 2)
    wall = strand * THICKNESS / (math.pi * turns) * (2.0 * sine - 1.0 / sine) - THICKNESS**2
    return gaylord(p, x, rest) + math.pi * p * wall


def doric(p, x, rest, k2):
    return chou(p, x, rest) - k2 * p * x / rest / rest


def kothera(p, x, rest, modulus):
    length, strand, turns, radius = list_lengths(rest, x)
    volume = math.pi * (RADIUS**2 - INNER**2) * rest
    wall = radius - np.sqrt(radius**2 - volume / (math.pi * length))
    slope = length / (2.0 * math.pi * radius * turns**2)
    return (
        gaylord(p, x, rest)
        + p * (volume / length - wall * length * slope)
        + modulus * volume * (1.0 / rest - 1.0 / length)
        + modulus * slope * (wall * length - THICKNESS * rest)
    )


def sangian(p, x, rest, modulus, threshold):
    radius = list_lengths(rest, x)[3]
    wall = modulus * THICKNESS / RADIUS**2 * (radius - RADIUS)
    return gaylord(np.maximum(p - threshold, 0.0) - wall, x, rest)


def itto(p, x, rest, k1, k2):
    return AREA * p * (Q1 * (1.0 - k1 * (1.0 + np.exp(k2 * p)) * x / rest) ** 2 - Q2)


def andrikopoulos(p, x, rest, scale, factor):
    """The largest contraction is a length, so that one constant holds for all rest lengths."""
    return scale * p * (Q1 * (1.0 - factor * x) ** 2 - Q2)


def takosoglu(p, x, rest, k1, k2, k3, k4, k5, k6):
    power = k1 * np.exp(-p / k2) + k3
    return AREA * p * ((k4 * np.exp(-p / k5) + k6) * (1.0 - x / rest) ** power - Q2)


def quadratic(p, x, rest, a, b, c, d, e):
    s = x / rest
    return a + b * s + c * s**2 + d * p + e * s * p


def quartic(p, x, rest, *k):
    s = x / rest
    return (k[0] + k[1] * s + k[2] * s**2) * p + sum(k[3 + i] * s**i for i in range(5))


def damped(p, x, rest, a, b, c, d, e):
    s = x / rest
    return (a * p**2 + b * p + c) * s + d * p + e


def line(p, x, rest, a, b):
    return a + b * x / rest


def fitted(p, x, rest, a, b, c):
    return p * (a * (1.0 - x / rest) ** 2 + c) + b


# Each with where SciPy's searches start.
FORMULAS = {
    "gaylord-1": (gaylord, [()]),
    "chou": (chou, [()]),
    "doric": (doric, [(0.0,)]),
    "kothera-balance": (kothera, [(1.0,), (5.0,)]),
    "sangian": (sangian, [(1.0, 0.05), (3.0, 0.1)]),
    "itto-b": (itto, [(0.5, 0.0), (0.7, -3.0), (0.6, 0.5)]),
    "andrikopoulos": (andrikopoulos, [(60.0, 0.01), (40.0, 0.02)]),
    "takosoglu": (
        takosoglu,
        [(a, 0.5, b, c, 0.5, Q1) for a in (0.0, 3.0, -3.0) for b in (2.0, 4.0) for c in (0.0, 5.0)],
    ),
    "quadratic-strain": (quadratic, [(0.0,) * 5]),
    "quartic-strain": (quartic, [(0.0,) * 8]),
    "damped-strain": (damped, [(0.0,) * 5]),
    "linear-strain": (line, [(0.0,) * 2]),
    "strain-fit": (fitted, [(0.0,) * 3]),
}


def find_data():
    """Return the measured forces if they are there, else None."""
    for folder in Path(__file__).resolve().parents:
        path = folder / "shared" / "data" / "festo10" / "plateaus_taut.csv"
        if path.exists():
            return read_measurements(path)
    return None


def simulate():
    """Simulate forces of three specimens that no model here has exactly."""
    random = np.random.default_rng(3)
    rest = np.repeat([80.0, 130.0, 190.0], 60)
    p = np.tile(np.repeat(np.linspace(0.1, 0.6, 10), 6), 3)
    x = rest * np.tile(np.linspace(0.0, 0.12, 6), 30)
    force = kothera(p, x, rest, 2.0) * (1.0 - 0.3 * x / rest) - 8.0 + 4.0 * random.normal(size=180)
    return Measurements(
        pressure=p,
        contraction=x,
        load=force,
        specimen=[f"{length:g}" for length in rest],
        geometry={"length": rest},
    )


def rank_by_scipy(data):
    """Return root mean square and AICc of each model."""
    p, x, rest, force = data.pressure, data.contraction, data.geometry["length"], data.load
    found = {}
    for name, (formula, starts) in FORMULAS.items():
        best = math.inf
        for start in starts:
            if not start:
                best = float(np.sum((formula(p, x, rest) - force) ** 2))
                continue
            with np.errstate(all="ignore"):
                end = least_squares(
                    lambda k, formula=formula: np.nan_to_num(
                        formula(p, x, rest, *k) - force, nan=1e4, posinf=1e4, neginf=-1e4
                    ),
                    start,
                    x_scale="jac",
                    max_nfev=2000,
                )
            best = min(best, 2.0 * end.cost)
        count, rows = len(starts[0]) + 1, len(p)
        aicc = rows * math.log(best / rows) + 2.0 * count * rows / (rows - count - 1)
        found[name] = (math.sqrt(best / rows), aicc)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("source", [find_data, simulate])
def test_order_and_errors_are_those_of_an_independent_ranking(source):
    data = source()
    if data is None:
        pytest.skip("the measured forces are not here")
    expected = rank_by_scipy(data)
    ranking = rank(
        data,
        MUSCLE,
        models={name: MODELS[name] for name in FORMULAS},
        options=RankOptions(folds=0, fit=FitOptions(response="force", budget=60.0)),
    )
    assert not ranking.refusals
    for entry in ranking.models:
        assert entry.score.answered.all(), entry.name
        rms, aicc = expected[entry.name]
        assert entry.score.rmse == pytest.approx(rms, rel=0.02), entry.name
    order = [entry.name for entry in ranking.models]
    assert order == sorted(expected, key=lambda name: expected[name][1])

"""Plain Python of the recursions as the thesis has them, one sample after the other."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import strategies as st

from bozzini.muscle.hysteresis import (
    AsymmetricPrandtlIshlinskii,
    BoucWen,
    FrictionBand,
    GeneralisedPrandtlIshlinskii,
    MaxwellFriction,
    MaxwellSlip,
    MonotoneCurve,
    PrandtlIshlinskii,
    Preisach,
    UnparallelPrandtlIshlinskii,
)

LEVELS = tuple(np.linspace(0.0, 1.0, 9).tolist())
WEIGHTS = tuple(np.random.default_rng(5).uniform(0.1, 1.0, 36).tolist())

OPERATORS = {
    "plays": PrandtlIshlinskii((0.0, 0.1, 0.25), (0.6, 0.3, 0.2), origin=0.05, offset=0.1),
    "generalised": GeneralisedPrandtlIshlinskii(
        PrandtlIshlinskii((0.0, 0.1, 0.25), (0.6, 0.3, 0.2)),
        output=MonotoneCurve((0.0, 0.3, 0.8), (0.0, 0.2, 0.9)),
        input=MonotoneCurve((0.0, 0.5, 1.0), (0.0, 0.6, 1.0)),
    ),
    "asymmetric": AsymmetricPrandtlIshlinskii(
        1.0, (0.05, 0.2), (0.1, 0.2), (0.25, 0.1), (0.02, 0.7, 0.4), offset=0.2
    ),
    "unparallel": UnparallelPrandtlIshlinskii(
        (0.0, 0.1, 0.3), (0.5, 0.3, 0.2), (1.0, 0.9, 1.1), (1.0, 1.2, 1.5)
    ),
    "slips": MaxwellSlip((2.0, 1.0, 0.5), (0.1, 0.2, 0.2)),
    "maxwell-slip": MaxwellFriction(4.0, (2.0, 1.0, 0.5), (0.1, 0.2, 0.2)),
    "bouc-wen": BoucWen(slope=2.0, alpha=0.9, beta=6.0, gamma=-2.0, exponent=1.5, offset=0.1),
    "bouc-wen-1": BoucWen(slope=2.0, alpha=0.9, beta=3.0, gamma=1.0),
    "relays": Preisach(LEVELS, WEIGHTS, offset=0.3),
    "band": FrictionBand(-0.1, -0.05),
}
"""One of each; all are defined on inputs from 0 to 1."""

PLAIN = {}


def plain(name):
    def keep(function):
        PLAIN[name] = function
        return function

    return keep


def list_histories(low=0.0, high=1.0, longest=30):
    """Histories of numbers with up to three decimals, where levels are met exactly as well."""
    steps = st.integers(round(1000 * low), round(1000 * high)).map(lambda i: i / 1000)
    return st.lists(steps, min_size=1, max_size=longest).map(np.array)


def refine(history, start, count=3):
    """More samples on the way from each to the next, and where the old ones are."""
    ends = np.concatenate([[start], history])
    parts = [np.linspace(a, b, count + 1)[1:] for a, b in zip(ends, ends[1:], strict=False)]
    for part, end in zip(parts, history, strict=True):
        part[-1] = end
    return np.concatenate(parts), np.arange(len(history)) * count + count - 1


def play(before, low, high):
    return max(low, min(high, before))


@plain("plays")
def run_plays(operator, history):
    places, output = [0.0] * len(operator.weights), []
    for value in history:
        here = value - operator.origin
        places = [
            play(h, here - r, here + r) for h, r in zip(places, operator.thresholds, strict=True)
        ]
        pairs = zip(operator.weights, places, strict=True)
        output.append(operator.offset + sum(w * h for w, h in pairs))
    return np.array(output)


@plain("generalised")
def run_generalised(operator, history):
    """The first and the last piece of a curve go on."""

    def bend(curve, values):
        output = []
        for value in values:
            piece = sum(value >= corner for corner in curve.inputs[1:-1])
            low, high = curve.inputs[piece], curve.inputs[piece + 1]
            share = (value - low) / (high - low)
            output.append((1.0 - share) * curve.outputs[piece] + share * curve.outputs[piece + 1])
        return np.array(output)

    inner = run_plays(operator.plays, bend(operator.input, history))
    return bend(operator.output, inner)


@plain("asymmetric")
def run_asymmetric(operator, history):
    count = len(operator.thresholds)
    rising, falling, output = [0.0] * count, [0.0] * count, []
    a0, a1, a2 = operator.envelope
    for p in history:
        curve = a0 + a1 * p + a2 * p * p
        total = operator.offset + operator.slope * p
        for i, r in enumerate(operator.thresholds):
            rising[i] = play(rising[i], p - r, p + r)
            falling[i] = play(falling[i], p - r, curve + r)
            total += operator.ascending_weights[i] * (rising[i] - p)
            total += operator.descending_weights[i] * (falling[i] - p)
        output.append(total)
    return np.array(output)


@plain("unparallel")
def run_unparallel(operator, history):
    places, output = [0.0] * len(operator.weights), []
    for p in history:
        for i, r in enumerate(operator.thresholds):
            up, down = operator.ascending_slopes[i], operator.descending_slopes[i]
            places[i] = play(places[i], up * (p - r), down * (p + r))
        pairs = zip(operator.weights, places, strict=True)
        output.append(operator.offset + sum(w * h for w, h in pairs))
    return np.array(output)


@plain("maxwell-slip")
def run_friction(operator, history):
    return operator.slope * history - run_slips(operator, history)


@plain("slips")
def run_slips(operator, history):
    forces, before, output = [0.0] * len(operator.limits), 0.0, []
    for here in history:
        for i, (k, w) in enumerate(zip(operator.stiffnesses, operator.limits, strict=True)):
            forces[i] = min(max(forces[i] + k * (here - before), -w), w)
        before = here
        output.append(sum(forces))
    return np.array(output)


def follow_return_points(operator, history):
    """(2.51): branches are the virgin curve twice as large, from the last return point.

    A branch that comes back to the return point before last closes a loop: both are forgotten and
    the branch below goes on. One that comes to the mirror image of the first return point, or
    beyond it, goes on along the virgin curve.
    """
    elements = list(zip(operator.stiffnesses, operator.limits, strict=True))
    points, way, before, force, output = [], 0.0, 0.0, 0.0, []
    for here in history:
        if here != before:
            new = math.copysign(1.0, here - before)
            if way not in (0.0, new):
                points.append((before, force))
            way = new
            while len(points) >= 2 and way * here >= way * points[-2][0]:
                del points[-2:]
            if len(points) == 1 and way * here >= abs(points[0][0]):
                points.clear()
            start, base = points[-1] if points else (0.0, 0.0)
            scale = 2.0 if points else 1.0
            moved = (here - start) / scale
            force = base + scale * sum(min(max(k * moved, -w), w) for k, w in elements)
            before = here
        output.append(force)
    return np.array(output)


@plain("bouc-wen")
def run_bouc_wen(operator, history):
    """(2.53) by SciPy, from sample to sample."""
    from scipy.integrate import solve_ivp

    a, b, g, n = operator.alpha, operator.beta, operator.gamma, operator.exponent
    h, before, output = 0.0, 0.0, []
    for here in history:
        way = math.copysign(1.0, here - before)

        def slope(_, h, way=way):
            return a - g * abs(h) ** n - b * h * way * abs(h) ** (n - 1.0)

        if here != before:
            h = solve_ivp(slope, (before, here), [h], rtol=1e-10, atol=1e-12).y[0, -1]
        before = here
        output.append(operator.scale * (operator.slope * here - h) + operator.offset)
    return np.array(output)


PLAIN["bouc-wen-1"] = run_bouc_wen


@plain("relays")
def run_relays(operator, history):
    signs, output = [-1.0] * len(operator.weights), []
    for here in history:
        number, total = 0, operator.offset
        for i in range(len(operator.levels) - 1):
            for j in range(i + 1):
                if here >= operator.levels[i + 1]:
                    signs[number] = 1.0
                elif here <= operator.levels[j]:
                    signs[number] = -1.0
                total += operator.weights[number] * signs[number]
                number += 1
        output.append(total)
    return np.array(output)


@plain("band")
def run_band(operator, history):
    way, before, output = 0.0, 0.0, []
    for p in history:
        if p != before:
            way = math.copysign(1.0, p - before)
        before = p
        mu = -(operator.kappa1 + operator.kappa2 * p)
        output.append(p * (1.0 - way * mu))
    return np.array(output)

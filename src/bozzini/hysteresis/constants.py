"""Constants of a fitted law with intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..checks import legal_range, list_quantities
from ..errors import UnitError
from ..numeric.arrays import Floats
from ..results import Json
from ..units import parse_unit
from .fitting import Fitted, Mask, Samples
from .law import LoopLaw

_STEP = 1e-3
_SIDE = 1.96
_FEW_RUNS = 20


@dataclass(frozen=True, kw_only=True)
class Constant:
    """A constant of a law with its 95 % interval.

    Parameters
    ----------
    name : str
    value, low, high : float
        In units of the table; the interval has no values that are not legal.
    is_determined : bool
        Whether the interval is narrower than twice the value; of an apex than the range of the
        input, and of the fraction of beta than 1.
    """

    name: str
    value: float
    low: float
    high: float
    is_determined: bool = True


def judge_constants(fit: Fitted, samples: Samples, mask: Mask) -> tuple[Constant, ...]:
    """Return the constants that have a meaning, with intervals by the derivatives at the fit.

    The variance is that of the residuals, larger where these go with each other; coefficients,
    the start of each run and a drift are free besides.
    """
    law = fit.law
    moves: dict[str, tuple[float, float, Callable[[LoopLaw, float], LoopLaw]]] = {}
    if len(law.thresholds) == 1 and law.thresholds[0] > 0.0:
        moves["half width"] = (
            law.thresholds[0],
            _STEP * law.reach,
            lambda item, value: replace(item, thresholds=(value,)),
        )
    if law.fan:
        for key in ("fan", "apex"):
            moves[key] = getattr(law, key), _STEP * (1.0 if key == "fan" else law.reach), (
                _change_field(key)
            )  # fmt: skip
    if len(law.thresholds) > 1:
        for k, (width, weight) in enumerate(zip(law.thresholds, law.weights, strict=True)):
            if weight:
                moves[f"weight at {width:.4g}"] = (weight, _STEP, _change_weight(k))
    if law.height:
        for key in ("yield_input", "beta_fraction", "exponent", "height"):
            value = float(getattr(law, key))
            step = -_STEP * max(abs(value), 1e-3) if key == "exponent" and value > 1.01 else (
                _STEP * max(abs(value), 1e-3)
            )  # fmt: skip
            moves[key.replace("_", " ")] = value, step, _change_field(key)
    if not moves:
        return ()
    base = fit.predict(samples)[mask]
    columns = []
    for value, step, change in moves.values():
        moved = replace(fit, law=change(law, value + step)).predict(samples)[mask]
        columns.append((moved - base) / step)
    for k in range(len(law.coefficients)):
        size = max(map(abs, law.coefficients)) or 1.0
        more = list(law.coefficients)
        more[k] += _STEP * size
        moved = replace(fit, law=replace(law, coefficients=tuple(more))).predict(samples)[mask]
        columns.append((moved - base) / (_STEP * size))
    # Of many runs each start matters little.
    for k, start in enumerate(fit.starts if len(fit.starts) <= _FEW_RUNS else ()):
        starts = list(fit.starts)
        starts[k] = (start + _STEP) % 2.0
        moved = replace(fit, starts=tuple(starts)).predict(samples)[mask]
        columns.append((moved - base) / _STEP)
    slope = np.hstack([np.stack(columns, axis=-1), samples.terms[mask]])
    left = samples.outputs[mask] - base
    # Sizes of weights have the sum 1: what they share with the curve is none of theirs.
    some = [weight for weight in law.weights if weight and len(law.weights) > 1]
    errors = _find_errors(slope, left, np.sign(np.array(some)))
    found = []
    for (label, (value, _, _)), error in zip(moves.items(), errors.tolist(), strict=False):
        side = _SIDE * error
        widest = {"apex": law.reach, "beta fraction": 0.5}.get(label, abs(value))
        low, high = _find_limits(law, label)
        found.append(
            Constant(name=label, value=value, low=max(value - side, low),
                     high=min(value + side, high), is_determined=bool(side < widest))
        )  # fmt: skip
    return tuple(found)


def _find_limits(law: LoopLaw, label: str) -> tuple[float, float]:
    """Return the lowest and highest legal value of a constant."""
    name = label.replace(" ", "_")
    if name in list_quantities(LoopLaw):
        return legal_range(law, name)
    return 0.0 if label == "half width" else -math.inf, math.inf


def identify_tendon(
    law: LoopLaw, known: Sequence[Constant], *, input_unit: str, output_unit: str
) -> tuple[Constant, ...]:
    """Return what a capstan's fan says of a tendon in a channel, pulled against a spring.

    The tension falls along the channel by ``exp(-f)``, f the coefficient of friction times the
    angle of wrap, and the tendon stretches by what it bears. Of tensions over what is moved at the
    end both edges are lines, ``T exp(-f)`` and ``T exp(f)``: ``f = atanh(fan)``. Of displacements::

        input / output = 1 + q (exp(f) - 1) / f  pulled,  1 + q (1 - exp(-f)) / f  let out

    with q the compliance of the tendon times the stiffness of what it moves: two equations for
    both, where input and output are lengths. Of angles only a lower bound of f is known,
    ``2 atanh(fan)``, that of a tendon much softer than what it moves. Of other units, or none,
    nothing is told: that may be no tendon.

    Parameters
    ----------
    law : LoopLaw
    known : sequence of Constant
        Its constants, of which the fan's interval is taken.
    input_unit, output_unit : str
        As in the titles.
    """
    fan = next((item for item in known if item.name == "fan"), None)
    both = input_unit, output_unit
    if fan is None or not all(any(_is_unit(one, kind) for kind in _TENDON) for one in both):
        return ()
    ends = [min(max(share, 1e-9), 0.95) for share in (fan.value, fan.low, fan.high)]
    if _is_unit(input_unit, "force"):
        return (_gather(_WRAP, [math.atanh(share) for share in ends], fan),)
    if _is_unit(input_unit, "length") and _is_unit(output_unit, "length"):
        slope = abs(law.coefficients[1]) / law.half
        slope *= parse_unit(output_unit, "length") / parse_unit(input_unit, "length")
        if slope * (1.0 + max(ends)) < 1.0:
            pairs = []
            for share in ends:
                pulled, let_out = (1.0 / (slope * (1.0 - s)) - 1.0 for s in (share, -share))
                wrap = math.log(pulled / let_out)
                pairs.append((wrap, pulled * wrap / math.expm1(wrap)))
            wraps, shares = zip(*pairs, strict=True)
            return _gather(_WRAP, wraps, fan), _gather(_COMPLIANCE, shares, fan)
    bounds = [2.0 * math.atanh(share) for share in ends]
    return (_gather(f"{_WRAP}, at least", bounds, fan),)


_TENDON = ("length", "angle", "force")
_WRAP = "friction times wrap angle"
_COMPLIANCE = "compliance times stiffness"


def _is_unit(unit: str, kind: str) -> bool:
    try:
        parse_unit(unit, kind)
    except UnitError:
        return False
    return bool(unit)


def _gather(name: str, ends: Sequence[float], fan: Constant) -> Constant:
    """Return a constant that follows from the fan: its value, and those at the interval's ends."""
    return Constant(
        name=name, value=ends[0], low=min(ends), high=max(ends), is_determined=fan.is_determined
    )


def _change_weight(place: int) -> Callable[[LoopLaw, float], LoopLaw]:
    def change(law: LoopLaw, value: float) -> LoopLaw:
        weights = list(law.weights)
        weights[place] = value
        return replace(law, weights=tuple(weights))

    return change


def _change_field(name: str) -> Callable[[LoopLaw, float], LoopLaw]:
    def change(law: LoopLaw, value: float) -> LoopLaw:
        changes: Json = {name: value}
        return replace(law, **changes)

    return change


def _find_errors(slope: Floats, left: Floats, sides: Floats) -> Floats:
    """Return standard errors (k,) of what moves the model by `slope` (n, k).

    The first of these times `sides` have a sum that stays.
    """
    ways = np.eye(slope.shape[1])
    if count := len(sides):
        ways[:count, :count] = np.linalg.svd(sides[None])[2].T
        ways = ways[:, 1:]  # the first is along the sides
    moves = slope @ ways
    sizes = np.linalg.norm(moves, axis=0)
    scales = np.where(sizes > 0.0, sizes, 1.0)
    _, values, directions = np.linalg.svd(moves / scales, full_matrices=False)
    inverse = np.where(values > 1e-9 * values[0], 1.0 / np.maximum(values, 1e-300), 1e9)
    spread = np.linalg.norm((ways / scales) @ (directions.T * inverse), axis=1)
    away = left - left.mean()
    total = float(away @ away)
    share = min(max(float(away[1:] @ away[:-1]) / total, 0.0), 0.999) if total > 0.0 else 0.0
    freedom = max(len(left) - moves.shape[1], 1)
    variance = total / freedom * (1.0 + share) / (1.0 - share)
    known = np.linalg.norm(slope, axis=0) > 0.0
    return np.where(known, np.sqrt(variance) * spread, np.inf)

"""Constants of a fitted law with intervals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..numeric.arrays import Floats
from ..results import Json
from .fitting import Fitted, Mask, Samples
from .law import LoopLaw

_STEP = 1e-3
_SIDE = 1.96


@dataclass(frozen=True, kw_only=True)
class Constant:
    """A constant of a law with its 95 % interval.

    Parameters
    ----------
    name : str
    value, low, high : float
        In units of the table.
    is_determined : bool
        Whether the interval is narrower than twice the value, where it is one above 0.
    """

    name: str
    value: float
    low: float
    high: float
    is_determined: bool = True


def judge_constants(name: str, fit: Fitted, samples: Samples, mask: Mask) -> tuple[Constant, ...]:
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
    elif len(law.thresholds) > 1:
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
    for k in range(1 if len(law.thresholds) > 1 else 0, len(law.coefficients)):
        size = max(map(abs, law.coefficients)) or 1.0
        more = list(law.coefficients)
        more[k] += _STEP * size
        moved = replace(fit, law=replace(law, coefficients=tuple(more))).predict(samples)[mask]
        columns.append((moved - base) / (_STEP * size))
    for k, start in enumerate(fit.starts):
        starts = list(fit.starts)
        starts[k] = (start + _STEP) % 2.0
        moved = replace(fit, starts=tuple(starts)).predict(samples)[mask]
        columns.append((moved - base) / _STEP)
    slope = np.hstack([np.stack(columns, axis=-1), samples.terms[mask]])
    left = samples.outputs[mask] - base
    errors = _find_errors(slope, left)
    found = []
    for (label, (value, _, _)), error in zip(moves.items(), errors.tolist(), strict=False):
        side = _SIDE * error
        least = 1.0 if label == "exponent" else 0.0
        known = side < abs(value - least) or label in ("exponent", "beta fraction")
        found.append(
            Constant(name=label, value=value, low=value - side, high=value + side,
                     is_determined=bool(known))
        )  # fmt: skip
    return tuple(found)


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


def _find_errors(slope: Floats, left: Floats) -> Floats:
    """Return standard errors (k,) of what moves the model by `slope` (n, k)."""
    sizes = np.linalg.norm(slope, axis=0)
    scales = np.where(sizes > 0.0, sizes, 1.0)
    _, values, directions = np.linalg.svd(slope / scales, full_matrices=False)
    inverse = np.where(values > 1e-9 * values[0], 1.0 / np.maximum(values, 1e-300), 1e9)
    spread = np.sqrt(np.square(inverse[:, None] * directions).sum(axis=0))
    away = left - left.mean()
    total = float(away @ away)
    share = min(max(float(away[1:] @ away[:-1]) / total, 0.0), 0.999) if total > 0.0 else 0.0
    freedom = max(len(left) - slope.shape[1], 1)
    variance = total / freedom * (1.0 + share) / (1.0 - share)
    return np.where(sizes > 0.0, np.sqrt(variance) * spread / scales, np.inf)

"""Equilibria of any muscle model on the section, in batches: contraction, deflection, codes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..muscle import MuscleModel
from . import _equilibrium_kernels as kernels
from .effector import Effector
from .forward import describe_end, lateral_deflection, measure_laterals

__all__ = ["Settled", "describe", "settle_muscles"]

Floats = NDArray[np.float64]

MAX_ITERATIONS = 200


@dataclass(frozen=True, eq=False)
class Settled:
    """Equilibria of k cases of m muscles; arrays (k, m), of the units of `Balance`."""

    contraction: Floats
    lateral: Floats
    residual: Floats
    iterations: NDArray[np.int64]
    code: NDArray[np.int64]


def settle_muscles(effector: Effector, pressures: Floats) -> Settled:
    """Return the equilibria of each muscle alone, at pressures (k, m) [MPa].

    Raises
    ------
    InputError
        If a model has no answer at a pressure.
    """
    packed = effector.packed
    out = np.empty((3, *pressures.shape))
    iterations = np.empty(pressures.shape, dtype=np.int64)
    codes = np.empty(pressures.shape, dtype=np.int64)
    kernels.settle(
        packed.kinds,
        packed.rows,
        packed.linkage,
        packed.compliance,
        packed.peak.contraction,
        pressures,
        out,
        iterations,
        codes,
    )
    for j in np.flatnonzero(packed.kinds == kernels.OTHER):
        model = effector.models[j]
        out[:, :, j], iterations[:, j], codes[:, j] = _settle_model(
            effector, model, pressures[:, j]
        )
    if np.any(codes == kernels.NO_ANSWER):
        i, j = np.argwhere(codes == kernels.NO_ANSWER)[0]
        raise InputError(
            f"pressure of muscle {effector.design.names[j]} is {pressures[i, j]:g} MPa: the "
            "thesis's equations have no answer there for this muscle; give a lower pressure (legal "
            f"are at most [0, {effector.design.pressure_limit:g}] MPa)"
        )
    return Settled(out[0], out[1], out[2], iterations, codes)


def describe(effector: Effector, code: int, contraction: float, residual: float) -> str:
    """Return why an equilibrium is none, or "" if it is one."""
    peak = effector.packed.peak
    if code == kernels.SATURATED:
        demanded = peak.lateral + effector.packed.compliance * residual
        more = f"the muscle could hold {demanded:.4g} mm" if residual > 0.0 else "it contracts more"
        return f"saturated: {more}, at {peak.lateral:.4g} mm, {describe_end(effector.design)}"
    if code == kernels.STOPPED:
        return f"not converged: {residual:.3g} N is left over at {contraction:g} mm of contraction"
    return ""


def _settle_model(
    effector: Effector, model: MuscleModel, pressures: Floats
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """The same for any model, by Newton's method in a bracket on `force` and `stiffness`."""
    packed = effector.packed
    out = np.zeros((3, pressures.size))
    iterations = np.zeros(pressures.size, dtype=np.int64)
    codes = np.full(pressures.size, kernels.BALANCED, dtype=np.int64)
    free = np.zeros(pressures.size)
    pressed = np.flatnonzero(pressures > 0.0)
    if pressed.size:
        free[pressed] = model.free_contraction(pressures[pressed])
    codes[free < 0.0] = kernels.SLACK
    active = np.flatnonzero(free > 0.0)
    low, high = np.zeros(pressures.size), np.minimum(free, packed.peak.contraction)
    x = 0.5 * high
    ends = active[free[active] > packed.peak.contraction]
    if ends.size:
        # At the end of the branch first: a muscle that pulls more there has no root.
        left = model.force(pressures[ends], high[ends]) - packed.peak.lateral / packed.compliance
        beyond = ends[left > 0.0]
        codes[beyond] = kernels.SATURATED
        x[beyond] = packed.peak.contraction
        iterations[beyond] = 1
        active = np.setdiff1d(active, beyond)
    codes[active] = kernels.STOPPED
    tolerance = kernels.STEP * packed.linkage[1]
    for iteration in range(1, MAX_ITERATIONS):
        if not active.size:
            break
        here, pressure = x[active], pressures[active]
        lateral, slope = measure_laterals(effector.design, here)
        pull, stiffness = model.force(pressure, here), model.stiffness(pressure, here)
        miss = pull - lateral / packed.compliance
        steep = stiffness + slope / packed.compliance
        small = kernels.MISS * np.abs(pull) + kernels.ROUND_OFF * (
            packed.linkage[1] * np.abs(stiffness) + here * np.abs(steep)
        )
        low[active] = np.where(miss >= 0.0, here, low[active])
        high[active] = np.where(miss <= 0.0, here, high[active])
        bottom, top = low[active], high[active]
        with np.errstate(divide="ignore", invalid="ignore"):
            following = here + miss / steep
        inside = (steep > 0.0) & (bottom <= following) & (following <= top)
        middle = 0.5 * (bottom + top)
        x[active] = np.where(inside, following, middle)
        iterations[active] = iteration
        ended = inside & (np.abs(following - here) <= tolerance) & (np.abs(miss) <= small)
        ended |= (miss == 0.0) | ~((bottom < middle) & (middle < top))
        codes[active[ended]] = kernels.BALANCED
        active = active[~ended]
    moved = free > 0.0
    out[0] = np.where(moved, x, 0.0)
    out[1] = lateral_deflection(effector.design, out[0])
    if moved.any():
        pull = model.force(pressures[moved], out[0, moved])
        out[2, moved] = pull - out[1, moved] / packed.compliance
    return out, iterations, codes

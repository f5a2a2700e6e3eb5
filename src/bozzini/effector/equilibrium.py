"""One muscle on the section: contraction, pull and deflection at a pressure (thesis 4.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number
from ..errors import InputError
from ..muscle import MuscleModel, ThesisMuscle
from . import _equilibrium_kernels as kernels
from ._settle import describe, settle_muscles
from .effector import Effector
from .forward import lateral_deflection

__all__ = ["BALANCE_METHODS", "Balance", "balance"]

Floats = NDArray[np.float64]

BALANCE_METHODS = ("root", "fixed-point")

MAX_ITERATIONS = 300


@dataclass(frozen=True, kw_only=True, eq=False)
class Balance:
    """One muscle and the section at rest under a pressure. Arrays of the pressures' shape.

    Attributes
    ----------
    name : str
        The muscle.
    pressure : (...) ndarray
        Pressure [MPa].
    contraction : (...) ndarray
        Contraction of the muscle [mm], ``Delta``.
    lateral : (...) ndarray
        Lateral deflection of the backbone's end [mm], ``delta_e``.
    force : (...) ndarray
        Pull that holds the section there [N], ``lateral / compliance``.
    iterations : (...) ndarray of int
        Steps of the solver.
    converged : (...) ndarray of bool
        Whether the muscle's pull is `force` to the solver's tolerance. A slack muscle counts.
    saturated : (...) ndarray of bool
        Whether there is no equilibrium up to the largest deflection. The answer is that deflection
        then; by the fixed point, what it ended with beyond.
    slack : (...) ndarray of bool
        Whether the muscle is longer than the section under this pressure and does not pull; its
        contraction is given as 0.
    residual : (...) ndarray
        The muscle's pull at `contraction` less `force` [N]; 0 for a slack muscle. By the fixed
        point: the last change of `force`.
    reason : (...) ndarray of str
        Why it is no equilibrium; empty where it is one.
    table : (..., rows, 4) ndarray
        Of the fixed point, a row a step: load put on the muscle [N], contraction [mm], deflection
        [mm], load that this deflection needs [N]. In a batch, one that ends early repeats its last
        row. No rows by the root.
    """

    name: str
    pressure: Floats
    contraction: Floats
    lateral: Floats
    force: Floats
    iterations: NDArray[np.int64]
    converged: NDArray[np.bool_]
    saturated: NDArray[np.bool_]
    slack: NDArray[np.bool_]
    residual: Floats
    reason: NDArray[np.str_]
    table: Floats


def balance(
    effector: Effector,
    name: str,
    pressure: ArrayLike,
    *,
    method: str = "root",
    tolerance: float = 1e-6,
) -> Balance:
    """Return one muscle and the section at rest under a pressure.

    The section resists like a beam, ``F = lateral / c`` with ``c = a L**2 / (k EI)``, and the
    muscle pulls by its model; the equilibrium is ``model.force(P, x) = lateral(x) / c``.

    - ``"root"`` solves that in a bracket, and always ends.
    - ``"fixed-point"`` is the thesis's iteration: contraction without load, deflection, the load
      that it needs, contraction under that load, and so on. It ends where the root is if the muscle
      is stiff enough, ``d lateral / d x < c * model.stiffness``, and otherwise does not converge. A
      step may put more on the muscle than its model can hold, which is an `InputError`.

    With ``ThesisMuscle(preset("effector-45"), load_path="bulk")`` and the prototype, Tables 4.1,
    4.3 and 4.4 end at 6.87, 6.42 and 5.65 mm, 20.36, 18.60 and 15.49 mm, 1.51, 1.38 and 1.15 N;
    printed are 6.9, 6.4 and 5.7, 20.4, 18.5 and 15.8, 1.51, 1.37 and 1.17. What differs is that the
    thesis rounds contractions to 0.1 mm (0.4 mm of deflection) before it goes on, and that its
    muscle's response to load is not printed and here a straight line. Table 4.2 corrects the
    contractions by a rule that is not printed.

    Parameters
    ----------
    effector : Effector
        Section and muscles.
    name : str
        The muscle under pressure.
    pressure : array_like
        Pressure [MPa].
    method : str
        ``"root"`` or ``"fixed-point"``.
    tolerance : float
        Change of the deflection at which the fixed point ends [mm].

    Raises
    ------
    InputError
        If there is no such muscle or method, a pressure is outside [0, pressure limit], the
        tolerance outside (0, 1000] mm, or a model has no answer.
    GeometryError
        If a step of the fixed point asks for a contraction at which a segment cannot close.
    """
    place = effector.design.index(name)
    if method not in BALANCE_METHODS:
        raise InputError(f"method is '{method}': it must be one of {list(BALANCE_METHODS)}")
    pressures = effector.take_pressures({name: pressure})[..., place]
    tolerance = check_number("tolerance", tolerance, low=0.0, high=1e3, low_open=True, unit="mm")
    if method == "fixed-point":
        return _iterate(effector, place, pressures, tolerance)
    cases = np.zeros((pressures.size, len(effector.models)))
    cases[:, place] = pressures.ravel()
    settled = settle_muscles(effector, cases)
    column = (slice(None), place)
    codes, lateral = settled.code[column], settled.lateral[column]
    contraction, residual = settled.contraction[column], settled.residual[column]
    reasons = [
        describe(effector, code, x, left)
        for code, x, left in zip(codes, contraction, residual, strict=True)
    ]
    shape = pressures.shape
    return Balance(
        name=name,
        pressure=pressures,
        contraction=contraction.reshape(shape),
        lateral=lateral.reshape(shape),
        force=lateral.reshape(shape) / effector.packed.compliance,
        iterations=settled.iterations[column].reshape(shape),
        converged=np.asarray((codes <= kernels.SLACK).reshape(shape)),
        saturated=np.asarray((codes == kernels.SATURATED).reshape(shape)),
        slack=np.asarray((codes == kernels.SLACK).reshape(shape)),
        residual=residual.reshape(shape),
        reason=np.array(reasons, dtype=np.str_).reshape(shape),
        table=np.zeros((*shape, 0, 4)),
    )


def _iterate(effector: Effector, place: int, pressures: Floats, tolerance: float) -> Balance:
    """Solve by the thesis's fixed point."""
    name, model = effector.design.names[place], effector.models[place]
    packed = effector.packed
    flat = pressures.ravel()
    load = np.zeros(flat.size)
    rows: list[Floats] = []
    iterations = np.zeros(flat.size, dtype=np.int64)
    converged = np.zeros(flat.size, dtype=np.bool_)
    change = np.zeros(flat.size)
    slack = np.zeros(flat.size, dtype=np.bool_)
    for step in range(1, MAX_ITERATIONS + 1):
        row = np.array(rows[-1]) if rows else np.zeros((flat.size, 4))
        going = np.flatnonzero(~converged)
        if not going.size:
            break
        try:
            found = _contract(model, flat[going], load[going])
            slack[going] |= (found < 0.0) & (load[going] == 0.0)
            contraction = np.maximum(found, 0.0)
            lateral = lateral_deflection(effector.design, contraction)
        except InputError as error:
            message = f"muscle {name}, step {step} of the fixed point: {error}"
            raise type(error)(f"{message}; method='root' has no such steps") from None
        needed = lateral / packed.compliance
        change[going] = needed - load[going]
        previous = row[going, 2]
        row[going] = np.stack([load[going], contraction, lateral, needed], axis=-1)
        rows.append(row)
        iterations[going] = step
        if step > 1:
            converged[going] = np.abs(lateral - previous) <= tolerance
        converged[going] |= (lateral == 0.0) & (load[going] == 0.0)
        load[going] = needed
    table = np.stack(rows, axis=-2) if rows else np.zeros((flat.size, 0, 4))
    last = table[:, -1, :] if rows else np.zeros((flat.size, 4))
    # Past the largest deflection the iteration may well end, but the section is folded over.
    saturated = last[:, 1] > packed.peak.contraction
    reasons = [
        f"not converged: the deflection still changes after {MAX_ITERATIONS} steps; the section is "
        "stiffer than the muscle, use method='root'"
        if not done
        else f"saturated: a contraction of {x:.4g} mm is past {packed.peak.contraction:.4g} mm, "
        "where the deflection is largest"
        if past
        else ""
        for done, past, x in zip(converged, saturated, last[:, 1], strict=True)
    ]
    shape = pressures.shape
    return Balance(
        name=name,
        pressure=pressures,
        contraction=np.array(last[:, 1]).reshape(shape),
        lateral=np.array(last[:, 2]).reshape(shape),
        force=np.array(last[:, 3]).reshape(shape),
        iterations=iterations.reshape(shape),
        converged=np.asarray((converged & ~saturated).reshape(shape)),
        saturated=np.asarray(saturated.reshape(shape)),
        slack=slack.reshape(shape),
        residual=change.reshape(shape),
        reason=np.array(reasons, dtype=np.str_).reshape(shape),
        table=table.reshape(*shape, table.shape[-2], 4),
    )


def _contract(model: MuscleModel, pressures: Floats, loads: Floats) -> Floats:
    if isinstance(model, ThesisMuscle) and model.load_path == "none":
        return model.contraction(pressures)  # it has no response to a load
    return model.contraction(pressures, loads)

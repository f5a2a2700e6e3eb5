"""One muscle on the section, at rest under a pressure.

With the muscle's pull ``F(P, x)`` [N] at a pressure ``P`` [MPa], its contraction ``x`` [mm], the
lateral deflection ``delta(x)`` of the backbone's end [mm] by the linkage (4.4), and the section's
compliance ``c = a L^2 / (k EI)`` [mm/N], the one unknown ``x`` of each muscle meets ::

    F(P, x) = delta(x) / c ,   0 <= x <= x_peak

on the rising branch of ``delta``. The left side falls and the right side rises: a bracketed Newton
method (`kernels.balance`), or roots of any model's `force`, ends at the only root; where ``F`` is
more than ``delta / c`` at ``x_peak`` the section is saturated, where ``F(P, 0)`` is below 0 the
muscle is slack. The thesis's fixed point is there to be compared with. docs/theory/effector.md
has the assumptions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number, check_word
from ..errors import InputError
from ..muscle import MuscleModel
from ..numeric.arrays import Floats
from ..numeric.roots import MAX_ITERATIONS, polish
from ..results import Json, Result, tabulated, take_axes
from .kernels import balance as kernels
from .linkage import describe_end, lateral_deflection
from .model import EffectorModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False)
class Settled:
    """Equilibria of k cases of m muscles; arrays (k, m), of the units of `Balance`."""

    contraction: Floats
    lateral: Floats
    residual: Floats
    iterations: NDArray[np.int64]
    code: NDArray[np.int64]

    def select(self, place: int, shape: tuple[int, ...]) -> Settled:
        """Return the equilibria of one muscle, as arrays of a shape."""
        return Settled(
            self.contraction[:, place].reshape(shape),
            self.lateral[:, place].reshape(shape),
            self.residual[:, place].reshape(shape),
            self.iterations[:, place].reshape(shape),
            self.code[:, place].reshape(shape),
        )


def settle_muscles(effector: EffectorModel, pressures: Floats) -> Settled:
    """Return the equilibria of each muscle alone, at pressures (k, m) [MPa]."""
    packed = effector.packed
    out = np.empty((3, *pressures.shape))
    iterations = np.empty(pressures.shape, dtype=np.int64)
    codes = np.empty(pressures.shape, dtype=np.int64)
    kernels.settle(
        packed.functions,
        packed.rows,
        packed.linkage,
        packed.compliance,
        packed.peak.contraction,
        pressures,
        out,
        iterations,
        codes,
    )
    for j in packed.uncompiled:
        model = effector.models[j]
        out[:, :, j], iterations[:, j], codes[:, j] = _settle_model(
            effector, model, pressures[:, j]
        )
    if np.any(codes == kernels.NO_ANSWER):
        i, j = np.argwhere(codes == kernels.NO_ANSWER)[0]
        raise InputError(
            f"pressure of muscle {effector.design.names[j]} is {pressures[i, j]:g} MPa: the "
            f"equations of the {effector.models[j].name} model have no answer there for this "
            "muscle; give a lower pressure (legal "
            f"are at most [0, {effector.design.pressure_limit:g}] MPa)"
        )
    return Settled(out[0], out[1], out[2], iterations, codes)


def explain_equilibrium(
    effector: EffectorModel, code: int, contraction: float, residual: float
) -> str:
    """Return why an equilibrium is none, or "" if it is one."""
    peak = effector.packed.peak
    if code == kernels.SATURATED:
        demanded = peak.lateral + effector.packed.compliance * residual
        more = f"the muscle could hold {demanded:.4g} mm" if residual > 0.0 else "it contracts more"
        return f"saturated: {more}, at {peak.lateral:.4g} mm, {describe_end(effector.design)}"
    if code == kernels.STOPPED:
        return f"not converged: {residual:.3g} N is left over at {contraction:g} mm of contraction"
    return ""


def list_muscles(names: tuple[str, ...], **columns: NDArray[np.generic]) -> Json:
    """Return what is known of each muscle (..., m) as plain values, by the muscles' names."""
    return {
        name: {key: values[..., k].tolist() for key, values in columns.items()}
        for k, name in enumerate(names)
    }


def _settle_model(
    effector: EffectorModel, model: MuscleModel, pressures: Floats
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """The same for any model, by roots of its `force` less the load of the linkage."""
    packed = effector.packed
    out = np.zeros((3, pressures.size))
    iterations = np.zeros(pressures.size, dtype=np.int64)
    codes = np.full(pressures.size, kernels.BALANCED, dtype=np.int64)
    free = np.zeros(pressures.size)
    pressed = np.flatnonzero(pressures > 0.0)
    if pressed.size:
        free[pressed] = model.free_contraction(pressures[pressed])
    codes[free < 0.0] = kernels.SLACK

    def excess(index: NDArray[np.intp], x: Floats) -> Floats:
        load = lateral_deflection(effector.design, x) / packed.compliance
        return model.force(pressures[index], x) - load

    active = np.flatnonzero(free > 0.0)
    high = np.minimum(free, packed.peak.contraction)
    if active.size:
        zeros = np.zeros(active.size)
        low_end, high_end = excess(active, zeros), excess(active, high[active])
        # A muscle that pulls more at the end of the branch has no root.
        beyond = (high_end > 0.0) & (free[active] > packed.peak.contraction)
        codes[active[beyond]], iterations[active[beyond]] = kernels.SATURATED, 1
        out[0, active[beyond]] = packed.peak.contraction
        inside = ~beyond
        active = active[inside]
        ends = (zeros[inside], low_end[inside]), (high[active], high_end[inside])
        out[0, active], _, iterations[active] = polish(excess, active, *ends)
        codes[active[iterations[active] >= MAX_ITERATIONS]] = kernels.STOPPED
    out[1] = lateral_deflection(effector.design, out[0])
    moved = np.flatnonzero(free > 0.0)
    if moved.size:
        out[2, moved] = excess(moved, out[0, moved])
    return out, iterations, codes


BalanceMethod = Literal["root", "fixed-point"]
BALANCE_METHODS: tuple[BalanceMethod, ...] = get_args(BalanceMethod)

MAX_STEPS = 300


@dataclass(frozen=True, kw_only=True, eq=False)
class Balance(Result):
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

    rows_have_verdict = True

    name: str
    pressure: Floats = tabulated("MPa")
    contraction: Floats = tabulated("mm")
    lateral: Floats = tabulated("mm")
    force: Floats = tabulated("N")
    iterations: NDArray[np.int64]
    converged: NDArray[np.bool_]
    saturated: NDArray[np.bool_]
    slack: NDArray[np.bool_]
    residual: Floats
    reason: NDArray[np.str_]
    table: Floats

    def list_steps(self) -> list[dict[str, float]]:
        """Return `table` of a single pressure as rows, units in the names."""
        names = ("force_N", "contraction_mm", "lateral_mm", "next_force_N")
        return [dict(zip(names, row, strict=True)) for row in self.table.tolist()]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the deflection over the pressure, and return the axes."""
        axes = take_axes(ax, x="pressure [kPa]", y="lateral deflection [mm]")
        axes.plot(1e3 * np.ravel(self.pressure), np.ravel(self.lateral), ".-", label=self.name)
        return axes


def balance(
    effector: EffectorModel,
    name: str,
    *,
    pressure: ArrayLike,
    method: BalanceMethod = "root",
    tolerance: float = 1e-6,
) -> Balance:
    """Return one muscle and the section at rest under a pressure.

    The section resists like a beam, ``F = lateral / c`` with ``c = a L**2 / (k EI)``, and the
    muscle pulls by its model; the equilibrium is ``model.force(P, x) = lateral(x) / c``.

    - ``"root"`` solves that in a bracket, and always ends.
    - ``"fixed-point"`` is the thesis's iteration: contraction without load, deflection, the load
      that it needs, contraction under that load, and so on. It converges to the root if the
      muscle is stiff enough, ``d lateral / d x < c * model.stiffness``, and otherwise does not. A
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
    check_word("method", method, BALANCE_METHODS)
    pressures = effector.take_pressures({name: pressure})[..., place]
    tolerance = check_number("tolerance", tolerance, low=0.0, high=1e3, low_open=True, unit="mm")
    if method == "fixed-point":
        return _iterate(effector, place, pressures, tolerance)
    cases = np.zeros((pressures.size, len(effector.models)))
    cases[:, place] = pressures.ravel()
    shape = pressures.shape
    settled = settle_muscles(effector, cases).select(place, shape)
    codes = settled.code
    reasons = [
        explain_equilibrium(effector, int(code), float(x), float(left))
        for code, x, left in zip(
            codes.flat, settled.contraction.flat, settled.residual.flat, strict=True
        )
    ]
    return Balance(
        name=name,
        pressure=pressures,
        contraction=settled.contraction,
        lateral=settled.lateral,
        force=settled.lateral / effector.packed.compliance,
        iterations=settled.iterations,
        converged=np.asarray(codes <= kernels.SLACK),
        saturated=np.asarray(codes == kernels.SATURATED),
        slack=np.asarray(codes == kernels.SLACK),
        residual=settled.residual,
        reason=np.array(reasons, dtype=np.str_).reshape(shape),
        table=np.zeros((*shape, 0, 4)),
    )


def _iterate(effector: EffectorModel, place: int, pressures: Floats, tolerance: float) -> Balance:
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
    for step in range(1, MAX_STEPS + 1):
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
        f"not converged: the deflection still changes after {MAX_STEPS} steps; the section is "
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
    return model.contraction(pressures, loads) if model.takes_load else model.contraction(pressures)

"""What changes a muscle's contraction beside pressure and load: time and temperature, as factors.

Both are first terms of a series, to be fitted to one's own muscle: they describe, and explain
nothing. A model with a factor is a model (`ScaledMuscle`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..checks import broadcast, check_array, check_fields, check_kind, check_range, quantity
from ..errors import InputError
from ..numeric.arrays import Floats
from ..numeric.estimation import make_blocks, measure_spread
from ..results import Result, measured
from .compose import find_limits
from .design import Muscle
from .model import MuscleModel


@dataclass(frozen=True, kw_only=True)
class Creep:
    """Contraction that goes on at a constant pressure: ``1 + share (1 - exp(-t / tau))``.

    The creep of a standard linear solid under a stress that is put on at once and stays (W. N.
    Findley, J. S. Lai, K. Onaran, Creep and Relaxation of Nonlinear Viscoelastic Materials, 1976,
    ch. 5).

    Parameters
    ----------
    share : float
        What is added in the end, as a share of the contraction at once.
    time_constant : float
        ``tau`` [s].

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    share: float = quantity(low=-0.99, high=100.0)
    time_constant: float = quantity("time", low=1e-6, high=1e9)

    def __post_init__(self) -> None:
        check_fields(self, "creep ")

    def factor(self, time: ArrayLike) -> Floats:
        """Return the factor of the contraction at a time [s] after the pressure was put on."""
        since = check_array("time", time)
        check_range("time", since, 0.0, math.inf, "s")
        return np.asarray(1.0 - self.share * np.expm1(-since / self.time_constant))


@dataclass(frozen=True, kw_only=True)
class Thermal:
    """Contraction over temperature, to first order: ``1 + slope (T - reference)``.

    The modulus of a rubber grows with its absolute temperature (L. R. G. Treloar, The Physics of
    Rubber Elasticity, 1975, ch. 4), which makes the slope negative; a softening thermoplastic makes
    it positive. The thermal strain of the bladder is in the model ``andrikopoulos-thermal``.

    Parameters
    ----------
    slope : float
        Change of the factor per kelvin [1/K].
    reference : float
        Temperature at which the factor is 1 [degrees Celsius].

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    slope: float = quantity(low=-1.0, high=1.0)
    reference: float = quantity(default=20.0, low=-273.15, high=1000.0)

    def __post_init__(self) -> None:
        check_fields(self, "thermal ")

    def factor(self, temperature: ArrayLike) -> Floats:
        """Return the factor of the contraction at a temperature [degrees Celsius]."""
        given = check_array("temperature", temperature)
        check_range("temperature", given, -273.15, 1000.0, "degC")
        factor = np.asarray(1.0 + self.slope * (given - self.reference))
        if (factor <= 0.0).any():
            raise InputError(
                f"temperature is {given.flat[int(np.argmin(factor))]:g} degC: the factor of the "
                f"contraction is {factor.min():g} there, it must be above 0"
            )
        return factor


@dataclass(frozen=True)
class ScaledMuscle(MuscleModel):
    """A model whose contraction is multiplied, by `Creep` and `Thermal` for example.

    ``x = factor * x_model(P, F)``, so that the pull is ``F_model(P, x / factor)``.

    Parameters
    ----------
    model : MuscleModel
        Any model.
    factor : float
        In [0.01, 100].

    Raises
    ------
    InputError
        If the factor is outside its range.
    """

    model: MuscleModel
    factor: float = quantity(low=0.01, high=100.0)
    muscle: Muscle = field(init=False, repr=False, compare=False)
    name: str = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_fields(self, "contraction ")
        check_kind("model", self.model, MuscleModel)
        object.__setattr__(self, "muscle", self.model.muscle)
        object.__setattr__(self, "name", self.model.name)

    @property
    def takes_load(self) -> bool:
        """Whether the contraction depends on the load."""
        return self.model.takes_load

    @property
    def pressure_limits(self) -> tuple[float, float]:
        """Legal pressures of the model [MPa]."""
        return self.model.pressure_limits

    @property
    def contraction_limits(self) -> tuple[float, float]:
        """Legal contractions of the model times the factor [mm]."""
        low, high = find_limits(self.model)
        return self.factor * low, self.factor * high

    def dead_band(self) -> float:
        """Return the dead band of the model [MPa]."""
        return self.model.dead_band()

    def force(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the pull of the model at the contraction without the factor [N]."""
        own = check_array("contraction", contraction) / self.factor
        return self.model.force(pressure, own, direction=direction)

    def contraction(
        self, pressure: ArrayLike, load: ArrayLike = 0.0, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return the contraction under a load [mm]."""
        own = self.model.contraction(pressure, load, direction=direction)
        return np.asarray(self.factor * own)

    def stiffness(
        self, pressure: ArrayLike, contraction: ArrayLike, *, direction: ArrayLike | None = None
    ) -> Floats:
        """Return ``-d force / d contraction`` [N/mm]."""
        own = check_array("contraction", contraction) / self.factor
        return np.asarray(self.model.stiffness(pressure, own, direction=direction) / self.factor)


@dataclass(frozen=True, kw_only=True, eq=False)
class TermFit(Result):
    """A term fitted to contractions of one muscle at one pressure and load.

    Attributes
    ----------
    term : Creep or Thermal
        What was fitted.
    contraction : float
        Contraction at the factor 1 [mm].
    standard_errors : dict
        Of the numbers of the term and of the contraction, linearised; runs of rows in the order of
        the table count as independent (`bozzini.numeric.estimation.measure_spread`).
    converged : bool
        Whether a minimum was found, and the record determines the term.
    reason : str
        Why not.
    residual : float
        Root mean square of measured less fitted [mm].
    """

    term: Creep | Thermal
    contraction: float = measured("mm")
    standard_errors: dict[str, float]
    converged: bool
    reason: str
    residual: float = measured("mm")


def fit_creep(time: ArrayLike, contraction: ArrayLike) -> TermFit:
    """Fit `Creep` to contractions (n,) [mm] at times (n,) [s] after the pressure was put on.

    Raises
    ------
    InputError
        If there are fewer than four rows, one is not finite, or the times are all one.
    """
    from scipy.optimize import minimize_scalar

    times, values = _take_rows("time", time, contraction)
    span = float(np.ptp(times))

    def solve(log_tau: float) -> tuple[Floats, Floats]:
        columns = np.stack([np.ones(times.size), -np.expm1(-times / math.exp(log_tau))], axis=1)
        found = np.linalg.lstsq(columns, values, rcond=None)[0]
        return found, values - columns @ found

    # Linear but for the time constant: the best of a grid, made better.
    grid = np.linspace(math.log(1e-3 * span), math.log(1e2 * span), 60)
    sums = [float(np.sum(solve(at)[1] ** 2)) for at in grid]
    best = int(np.clip(np.argmin(sums), 1, grid.size - 2))
    found = minimize_scalar(
        lambda at: float(np.sum(solve(at)[1] ** 2)),
        bounds=(grid[best - 1], grid[best + 1]),
        method="bounded",
        options={"xatol": 1e-10},
    )
    (start, added), residuals = solve(float(found.x))
    tau = math.exp(float(found.x))
    if not start > 0.0:
        raise InputError(f"contraction at the time 0 comes out as {start:g} mm: it must be above 0")
    share = added / start
    decay = np.exp(-times / tau)
    jacobian = np.stack(
        [1.0 + share * (1.0 - decay), start * (1.0 - decay), -added * decay * times / tau**2],
        axis=1,
    )
    errors = _find_errors(("contraction", "share", "time_constant"), jacobian, residuals)
    reason = ""
    if tau > span:
        reason = f"the record of {span:g} s is shorter than the time constant found, {tau:.3g} s"
    return TermFit(
        term=Creep(share=share, time_constant=tau),
        contraction=float(start),
        standard_errors=errors,
        converged=not reason,
        reason=reason,
        residual=float(np.sqrt(np.mean(residuals**2))),
    )


def fit_thermal(
    temperature: ArrayLike, contraction: ArrayLike, *, reference: float = 20.0
) -> TermFit:
    """Fit `Thermal` to contractions (n,) [mm] at temperatures (n,) [degrees Celsius].

    Raises
    ------
    InputError
        If there are fewer than four rows, one is not finite, or the temperatures are all one.
    """
    given, values = _take_rows("temperature", temperature, contraction)
    columns = np.stack([np.ones(given.size), given - reference], axis=1)
    (start, slope), *_ = np.linalg.lstsq(columns, values, rcond=None)
    if not start > 0.0:
        raise InputError(
            f"contraction at {reference:g} degC comes out as {start:g} mm: it must be above 0"
        )
    residuals = values - columns @ np.array([start, slope])
    factor = slope / start
    jacobian = np.stack([1.0 + factor * columns[:, 1], start * columns[:, 1]], axis=1)
    return TermFit(
        term=Thermal(slope=factor, reference=reference),
        contraction=float(start),
        standard_errors=_find_errors(("contraction", "slope"), jacobian, residuals),
        converged=True,
        reason="",
        residual=float(np.sqrt(np.mean(residuals**2))),
    )


def _take_rows(name: str, given: ArrayLike, contraction: ArrayLike) -> tuple[Floats, Floats]:
    """Return two columns of a record, checked."""
    first, second = broadcast(
        (name, check_array(name, given)), ("contraction", check_array("contraction", contraction))
    )
    if first.ndim != 1 or first.size < 4:
        raise InputError(f"{name} has shape {first.shape}: it must be (n,), with n of 4 or more")
    check_range(name, first, -273.15 if name == "temperature" else 0.0, 1e12)
    check_range("contraction", second, -1e6, 1e6, "mm")
    if np.ptp(first) == 0.0:
        raise InputError(f"{name} is {first[0]:g} in all rows: they must differ")
    return first, second


def _find_errors(names: tuple[str, ...], jacobian: Floats, residuals: Floats) -> dict[str, float]:
    """Return linearised standard errors by name; rows that follow each other err alike."""
    blocks = make_blocks([""] * residuals.size)
    spread = measure_spread(jacobian, residuals, blocks, lost=True)
    return dict(zip(names, spread.deviations.tolist(), strict=True))

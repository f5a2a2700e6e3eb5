"""A fit as a least-squares problem: predictions of a model, unknowns, derivatives.

A model with unknowns ``p`` answers one *response* ``f``, given the two other columns ``u`` of a
row: the force at ``(P, x)``, the contraction at ``(P, F)`` or the pressure at ``(F, l)``; pressure
``P`` [MPa], contraction ``x`` [mm], force ``F`` [N], length ``l`` [mm]. What is made small, over
the rows i, and its Jacobian are ::

    r_i(p) = (f(u_i; p) - y_i) / s_i ,   J_iq = (df/dp_q) scale_q / s_i ,   low_q <= p_q <= high_q

with the measured response ``y_i`` and its standard error ``s_i``, 1 where none is known.
*Unknowns*, in the order of `Problem.free`, which is fields of the muscle and constants of the model
or ends; one that each specimen has its own value of stands there once for each, in the order of
`Measurements.list_specimens`. A point of the search has ``p_q / scale_q``. `muscle_fit` makes the
sum of squares small by bounded least squares. docs/theory/muscle.md states what such a fit
determines.

*Derivatives*. Of a contraction by the theorem of implicit functions, ``dx/dp = (dF/dp) / k`` with
the stiffness ``k = -dF/dx``; of the force of a mounted muscle ``F = f(P, x - x_0 + c F)``, with
offset ``x_0`` and compliance ``c``, ``dF/dp = (df/dp) / (1 + c k)`` with ``k = -df/dx``;
differences of ``f`` itself otherwise. Rows without an answer count by `FitData.worst`.

*Errors in several columns*. A row ``i`` has a measured response ``y`` and measured states ``u``,
the true ones off by independent normal errors. To first order in these the response of a model
``f`` misses the measured one with the variance ::

    s_i**2 = s_y**2 + sum over u of (df/du)**2 s_u**2

(Orear, American Journal of Physics 50, 1982, 912-916), and ``sum (f - y)**2 / s_i**2`` is, to that
order, the sum of squares of the orthogonal distance: what is left if the true states are fitted as
well. It is that sum which is made small, with the derivatives taken at the parameters of each
trial. To hold the weights of the trial before and iterate is not the same: for a straight line with
errors that are alike the weights are alike then, and its slope is that of ordinary least squares,
too small by ``1 / (1 + s_u**2 / var(u))``.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number, check_word, list_quantities
from ..errors import BozziniError, InputError
from ..numeric.arrays import Floats
from ..numeric.least_squares import Clock
from .data import Measurements
from .design import BRAID_ANGLES, Muscle
from .ends import EndEffects, MountedMuscle, find_offset
from .model import MuscleModel, try_rows
from .models.base import CatalogueModel

if TYPE_CHECKING:
    from .models.card import Parameter

Answers = tuple[Floats, NDArray[np.bool_]]

Response = Literal["force", "contraction", "pressure"]
RESPONSES: tuple[Response, ...] = get_args(Response)
"""What a model answers with, the two other columns being given."""

RESPONSE_UNITS: dict[Response, str] = {"force": "N", "contraction": "mm", "pressure": "MPa"}
"""The unit of each response."""

RESPONSE_COLUMNS: dict[Response, str] = {
    "force": "load",
    "contraction": "contraction",
    "pressure": "pressure",
}
"""The column of `Measurements` that a response is compared with."""

END_FIELDS = list_quantities(EndEffects)
"""The end effects that may be fitted of every model."""


class States(NamedTuple):
    """Columns of measured states, arrays of shape (n,); `branch` is None without directions."""

    pressure: Floats
    contraction: Floats
    load: Floats
    branch: NDArray[np.str_] | None

    @classmethod
    def of(cls, data: Measurements) -> States:
        """Return the states of measurements."""
        return cls(data.pressure, data.contraction, data.load, data.branch)

    def select(self, rows: NDArray[np.generic]) -> States:
        """Return the rows of a mask or of indices."""
        branch = None if self.branch is None else self.branch[rows]
        return States(self.pressure[rows], self.contraction[rows], self.load[rows], branch)

    def replace(self, name: str, values: Floats) -> States:
        """Return the states with another column."""
        return States(
            values if name == "pressure" else self.pressure,
            values if name == "contraction" else self.contraction,
            values if name == "load" else self.load,
            self.branch,
        )


class _Columns(Protocol):
    @property
    def pressure(self) -> Floats: ...
    @property
    def contraction(self) -> Floats: ...
    @property
    def load(self) -> Floats: ...
    @property
    def branch(self) -> NDArray[np.str_] | None: ...


def try_response(model: MuscleModel, rows: _Columns, response: Response) -> Answers:
    """Return what a model answers at each row, and which rows it has an answer for."""
    if response == "force":
        return model.try_force(rows.pressure, rows.contraction, direction=rows.branch)
    if response == "contraction":
        return model.try_contraction(rows.pressure, rows.load, direction=rows.branch)
    length = model.muscle.length - rows.contraction
    return model.try_pressure(rows.load, length, direction=rows.branch)


def explain_gap(model: MuscleModel, data: Measurements, response: Response) -> str:
    """Return why a model has no answer at the first row where it has none; empty if it has all."""
    _, answered = try_response(model, data, response)
    if answered.all():
        return ""
    row = int(np.argmin(answered))
    one = States.of(data).select(np.array([row]))
    try:
        if response == "force":
            model.force(one.pressure, one.contraction, direction=one.branch)
        elif response == "contraction":
            model.contraction(one.pressure, one.load, direction=one.branch)
        else:
            length = model.muscle.length - one.contraction
            model.pressure(one.load, length, direction=one.branch)
    except BozziniError as error:
        text = str(error)
        for name in ("pressure", "load", "force", "contraction", "length"):
            text = text.replace(f"{name}[0]", name)
        return f"{data.name_row(row)}: {text}"
    return f"{data.name_row(row)}: no answer was found"


PARAMETER_UNITS = {
    name: quantity.unit
    for name, quantity in list_quantities(Muscle).items()
    if name not in ("length", "strands")
}
"""The parameters of a `Muscle` that may be fitted, and their units.

The free length is not one of them: a table of lengths becomes contractions by it, so it has to be
measured.
"""

ALL_UNITS = PARAMETER_UNITS | {name: known.unit for name, known in END_FIELDS.items()}
"""The same, with the end effects."""


@dataclass(frozen=True, eq=False)
class SpecimenRows:
    """The rows of one specimen, its muscle, and its free length at a pressure if that is used."""

    specimen: str
    rows: NDArray[np.intp]
    muscle: Muscle
    anchor: tuple[float, float] | None


@dataclass(frozen=True, kw_only=True, eq=False)
class FitData:
    """What is fitted to what, whatever the model.

    Parameters
    ----------
    muscle : Muscle
        What is not measured of a specimen.
    data : Measurements
    response : str
        One of `RESPONSES`.
    ends : EndEffects
        Where free end effects start, and the others.
    anchored : bool
        Whether the offset of each specimen is such that the model without load is as long as the
        specimen was at a pressure, `Measurements.free_lengths`.
    each : tuple of str
        Parameters that every specimen has its own value of.
    """

    muscle: Muscle
    data: Measurements
    response: Response = "contraction"
    ends: EndEffects = field(default_factory=EndEffects)
    anchored: bool = False
    each: tuple[str, ...] = ()

    @property
    def unit(self) -> str:
        """The unit of the response."""
        return RESPONSE_UNITS[self.response]

    @cached_property
    def measured(self) -> Floats:
        """The measured response, shape (n,)."""
        column: Floats = getattr(self.data, RESPONSE_COLUMNS[self.response])
        return column

    @cached_property
    def span(self) -> float:
        """Largest less smallest measured response, or the largest if all are one; above 0."""
        return float(np.ptp(self.measured)) or float(np.abs(self.measured).max()) or 1.0

    @cached_property
    def worst(self) -> float:
        """What a row without an answer counts with: the span, or the largest if that is more."""
        return max(self.span, float(np.abs(self.measured).max()))

    @cached_property
    def states(self) -> States:
        """The measured states."""
        return States.of(self.data)

    @cached_property
    def parts(self) -> tuple[SpecimenRows, ...]:
        """The specimens, each with its rows; all rows together where nothing tells them apart."""
        data = self.data
        if not (data.geometry or self.each or self.anchored):
            return (SpecimenRows("", np.arange(len(data)), self.muscle, None),)
        parts = []
        for name in data.list_specimens():
            rows = np.flatnonzero(data.specimen == name)
            anchor = self._find_anchor(name, rows) if self.anchored else None
            parts.append(SpecimenRows(name, rows, data.muscle_of(name, self.muscle), anchor))
        return tuple(parts)

    def _find_anchor(self, name: str, rows: NDArray[np.intp]) -> tuple[float, float]:
        """Return the pressure [MPa] and the length [mm] of a specimen without load."""
        for pressure, lengths in self.data.free_lengths.items():
            if np.isfinite(lengths[rows[0]]):
                return pressure, float(lengths[rows[0]])
        raise InputError(
            f"specimen {name!r} has no length at a pressure: give a column such as "
            "'length at 620 kPa [mm]', or an offset"
        )

    @cached_property
    def input_errors(self) -> dict[str, Floats]:
        """Standard errors of the columns that the response follows from; empty for none."""
        own = RESPONSE_COLUMNS[self.response]
        inputs = {"pressure", "contraction", "load"} - {own}
        return {name: self.data.errors[name] for name in sorted(inputs) if name in self.data.errors}

    @cached_property
    def response_errors(self) -> Floats | None:
        """Standard errors of the response; None if they are not known."""
        return self.data.errors.get(RESPONSE_COLUMNS[self.response])

    def check(self) -> None:
        """Raise `InputError` if the task cannot be fitted."""
        check_word("response", self.response, RESPONSES)
        if self.input_errors and self.response_errors is None:
            own = RESPONSE_COLUMNS[self.response]
            raise InputError(
                f"there are errors of {' and '.join(self.input_errors)} and none of {own}, which "
                f"is fitted: give a column '{own} error', or fit another response"
            )
        for part in self.parts:
            lengths = part.muscle.length - self.data.contraction[part.rows]
            short = ~(lengths > 0.0)
            if short.any():
                row = int(part.rows[np.argmax(short)])
                raise InputError(
                    f"{self.data.name_row(row)}: length is {lengths[np.argmax(short)]:g} mm: it "
                    "must be above 0"
                )

    def select(self, rows: NDArray[np.bool_]) -> FitData:
        """Return the task with some rows."""
        return replace(self, data=self.data.select(rows))


def choose_scale(name: str, start: float, *, own: bool) -> float:
    """Return how much of an unknown matters."""
    scale = 0.1 * abs(start) or 0.1
    known = None if own or name in END_FIELDS else list_quantities(Muscle)[name].scale
    return scale if known is None else known


def choose_bounds(
    free: Sequence[str],
    task: FitData,
    bounds: Mapping[str, tuple[float, float]],
    own: Mapping[str, Parameter] | None = None,
) -> NDArray[np.float64]:
    """Return the bounds of the free parameters, shape (k, 2): those given, or wide ones."""
    muscle = min((part.muscle for part in task.parts), key=lambda muscle: muscle.length)
    radius = muscle.outer_radius
    most = max(float(np.abs(task.data.load).max()), 1e-3)
    wide = {
        "modulus": (0.01, 20.0),
        "dead_length": (0.0, 0.8 * muscle.length),
        "gap": (0.0, 0.5 * radius),
        "braid_angle": (math.radians(15.0), BRAID_ANGLES[1]),
        "friction_length": (0.0, 0.25 * radius),
        "mooney_ratio": (0.0, 1.0),
        "inner_radius": (0.05 * radius, 0.95 * radius),
        "outer_radius": (1.05 * muscle.given.get("inner_radius", 0.0), 3.0 * radius),
        "end_length": (0.0, 0.4 * muscle.length),
        "poisson_ratio": (0.3, 0.4999),
        "offset": (-0.2 * muscle.length, 0.2 * muscle.length),
        "compliance": (0.0, 0.2 * muscle.length / most),
        "slack_force": (-most, most),
    }
    if not isinstance(bounds, Mapping):
        raise InputError(
            f"bounds must be a mapping from names to pairs: it is a {type(bounds).__name__}"
        )
    for name in bounds:
        if name not in free:
            raise InputError(f"bounds are given for {name}: the free ones are {', '.join(free)}")
    table = []
    for name in free:
        constant = (own or {}).get(name)
        if constant is not None:
            least, largest, unit = *constant.bounds, constant.unit
        elif name in END_FIELDS:
            known = END_FIELDS[name]
            least, largest, unit = float(known.low), float(known.high), known.unit  # type: ignore[arg-type]
        else:
            least, largest = muscle.legal_range(name)
            unit = PARAMETER_UNITS[name]
        if name in bounds:
            low, high = _take_pair(name, bounds[name], least, largest, unit)
        elif constant is not None or name in END_FIELDS:
            low, high = wide.get(name, (least, largest)) if constant is None else constant.bounds
        else:
            value = float(getattr(muscle, name))
            # Inside the legal range, with a margin for the steps of numeric differences.
            low, high = wide.get(name, (0.2 * value, 5.0 * value))
            low, high = max(low, least), min(high, largest - 1e-4 * (largest - least))
        table.append((low, high))
    return np.array(table, dtype=np.float64)


def _take_pair(
    name: str, pair: object, least: float, most: float, unit: str
) -> tuple[float, float]:
    if not isinstance(pair, Sequence) or isinstance(pair, str) or len(pair) != 2:
        raise InputError(f"bounds of {name} is {pair!r:.60}: it must be a pair (low, high)")
    low = check_number(f"lower bound of {name}", pair[0], low=least, high=most, unit=unit)
    high = check_number(
        f"upper bound of {name}", pair[1], low=low, high=most, low_open=True, unit=unit
    )
    return low, high


_STEEPEST = 1e9  # of a derivative, so that its square is finite
_LEAST_STIFFNESS_N_PER_MM = 1e-12  # keeps a quotient finite where a model has no stiffness [N/mm]
DIFFERENCE_STEP = 1e-4  # of a difference, in scales: small against curvature, above round-off
_LEAST_SCALE = 1e-4  # of an unknown, in the scale that goes with the model's guess
_ROUGH_STEP = 1e-6  # the same of a difference to one side
_SLOPE_STEP = 1e-6  # of a difference by the contraction, of the muscle's length
_INPUT_STEP = 1e-5  # of a difference by a measured column, of its largest value


_TOLERANCE = {"pressure": 1e-6, "contraction": 1e-9, "load": 1e-9}
"""Differences of states that count as none [MPa, mm, N]."""


def find_states(task: FitData) -> tuple[int, NDArray[np.int64]]:
    """Return how many different states the rows have, and which one each row has, shape (n,).

    A state is a specimen's, where these are told apart, and has what the response follows from: of
    a contraction the pressure, the load and the direction.
    """
    inputs = [name for name in _TOLERANCE if name != RESPONSE_COLUMNS[task.response]]
    columns: list[list[object]] = [
        np.round(getattr(task.data, name) / _TOLERANCE[name]).tolist() for name in inputs
    ]
    columns.append(task.data.direction.tolist())
    if len(task.parts) > 1:
        columns.append(task.data.specimen.tolist())
    keys = list(zip(*columns, strict=True))
    states = {key: index for index, key in enumerate(dict.fromkeys(keys))}
    return len(states), np.array([states[key] for key in keys])


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """A least-squares problem whose unknowns are those of muscle, model and ends, in their scales.

    Free are fields of the muscle, constants of the model and end effects. Limits are (k, 2), one
    for each free name, and `model_class` makes the model from a muscle and constants by their
    names. What each specimen has its own value of is one unknown for each of them; `starts` are
    where unknowns start that do not start at the task's or at `constants`. A rough problem takes
    derivatives of a force by differences to one side, good to about 1e-6, for half the work.
    """

    model_class: Callable[..., MuscleModel]
    task: FitData
    free: tuple[str, ...]
    limits: NDArray[np.float64]
    constants: Mapping[str, float] = field(default_factory=dict)
    starts: Mapping[str, float] = field(default_factory=dict)
    clock: Clock = field(default_factory=Clock)
    rough: bool = False

    @cached_property
    def _linear(self) -> frozenset[str]:
        """The constants that the force is affine in."""
        own = list_own(self.model_class) if self.constants else {}
        return frozenset(name for name, item in own.items() if item.linear)

    @cached_property
    def _labels(self) -> tuple[tuple[str, int], ...]:
        """Each unknown, with the index of its name in `free`."""
        found: list[tuple[str, int]] = []
        for index, name in enumerate(self.free):
            if name in self.task.each:
                found += [(label_unknown(name, p.specimen), index) for p in self.task.parts]
            else:
                found.append((name, index))
        return tuple(found)

    @cached_property
    def unknowns(self) -> tuple[str, ...]:
        """The unknowns by name, those of each specimen as ``name[specimen]``."""
        return tuple(label for label, _ in self._labels)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The free name of each unknown."""
        return tuple(self.free[index] for _, index in self._labels)

    @cached_property
    def bounds(self) -> NDArray[np.float64]:
        """The bounds of each unknown, shape (K, 2)."""
        return self.limits[[index for _, index in self._labels]]

    @cached_property
    def of_part(self) -> tuple[tuple[tuple[str, str], ...], ...]:
        """For each part, the free names and the unknowns that are their values."""
        each = self.task.each
        return tuple(
            tuple((n, label_unknown(n, p.specimen) if n in each else n) for n in self.free)
            for p in self.task.parts
        )

    @cached_property
    def start(self) -> dict[str, float]:
        """Where the unknowns start."""
        begin: dict[str, float] = {}
        lowest = float(self.task.data.load.min())
        for part, pairs in zip(self.task.parts, self.of_part, strict=True):
            known = {**vars(self.task.ends), **vars(part.muscle), **self.constants}
            if known["slack_force"] is None:
                known["slack_force"] = lowest
            for name, label in pairs:
                begin.setdefault(label, float(self.starts.get(label, known[name])))
        return {label: begin[label] for label in self.unknowns}

    @cached_property
    def scales(self) -> NDArray[np.float64]:
        """How much of each unknown matters, shape (K,)."""
        most = float(np.abs(self.task.data.load).max()) or 1.0
        length = min(part.muscle.length for part in self.task.parts)
        ends = {
            "offset": 0.01 * length,
            "compliance": 0.02 * length / most,
            "slack_force": 0.02 * most,
        }
        return np.array(
            [
                ends[name]
                if name in ends and name not in self.constants
                else max(
                    choose_scale(name, value, own=name in self.constants),
                    # A search that left a constant at next to 0 must not begin at that scale.
                    _LEAST_SCALE * choose_scale(name, self.constants.get(name, 0.0), own=True),
                )
                for name, value in zip(self.names, self.start.values(), strict=True)
            ]
        )

    def choose_start(self) -> NDArray[np.float64]:
        """Return where to start, off the bounds: a search hardly leaves one."""
        start = np.array(list(self.start.values()))
        low, high = self.bounds.T
        margin = np.minimum(0.5 * self.scales, 0.25 * (high - low))
        inside: NDArray[np.float64] = np.clip(start, low + margin, high - margin)
        return inside / self.scales

    def name_values(self, point: NDArray[np.float64]) -> dict[str, float]:
        """Return the unknowns at a point of the search."""
        values = np.clip(point * self.scales, self.bounds[:, 0], self.bounds[:, 1])
        return dict(zip(self.unknowns, values.tolist(), strict=True))

    def move(self, values: Mapping[str, float]) -> Problem:
        """Return the problem with another start, and the scales that go with it."""
        return replace(self, starts=dict(values))

    def build(self, values: Mapping[str, float], index: int = 0) -> MuscleModel:
        """Return the model of a part, with some values of the unknowns."""
        own = {name: values[label] for name, label in self.of_part[index] if label in values}
        part = self.task.parts[index]
        return assemble(self.model_class, part.muscle, own, task=self.task, anchor=part.anchor)

    @cached_property
    def _models(self) -> dict[int, tuple[Mapping[str, float], MuscleModel]]:
        """The models of the last answer of `compare`, by their parts, with the unknowns."""
        return {}

    def _build_again(self, values: Mapping[str, float], index: int) -> MuscleModel:
        """Return what `build` does, the last model for a part again if it has these values."""
        last = self._models.get(index)
        names = [label for _, label in self.of_part[index]]
        if last is not None and all(last[0][name] == values[name] for name in names):
            return last[1]
        return self.build(values, index)

    def evaluate(self, point: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return model less measurement, and which rows the trial has an answer for."""
        return self.compare(self.name_values(point))[:2]

    def compare(
        self, values: Mapping[str, float]
    ) -> tuple[Floats, NDArray[np.bool_], Floats | None]:
        """Return model less measurement, which rows have an answer, and their effective errors.

        The errors are None where none are known. The last answer is kept: a search asks for the
        misfit and the derivatives at one point.
        """
        key = tuple(values.items())
        if key not in self._last:
            self._last.clear()
            self._last[key] = self._compare(values)
        return self._last[key]

    @cached_property
    def _last(self) -> dict[object, tuple[Floats, NDArray[np.bool_], Floats | None]]:
        """The last answer of `compare`, by its values."""
        return {}

    def _compare(
        self, values: Mapping[str, float]
    ) -> tuple[Floats, NDArray[np.bool_], Floats | None]:
        """Return what `compare` does, computed anew."""
        task = self.task
        residuals, answered = np.zeros(len(task.data)), np.zeros(len(task.data), dtype=np.bool_)
        errors = task.response_errors
        errors = None if errors is None else np.array(errors)
        for index, part in enumerate(task.parts):
            try:
                model = self.build(values, index)
            except BozziniError:  # each value is legal, but not all together
                continue
            self._models[index] = values, model
            rows = task.states.select(part.rows)
            predicted, good = try_response(model, rows, task.response)
            residuals[part.rows] = np.where(good, predicted - task.measured[part.rows], 0.0)
            answered[part.rows] = good
            if task.input_errors and errors is not None:
                errors[part.rows] = np.sqrt(
                    errors[part.rows] ** 2 + self._propagate(model, rows, part, predicted, good)
                )
        return residuals, answered, errors

    def _propagate(
        self,
        model: MuscleModel,
        rows: States,
        part: SpecimenRows,
        predicted: Floats,
        good: NDArray[np.bool_],
    ) -> Floats:
        """Return the variance of the response that the errors of the other columns make."""
        variance = np.zeros(len(part.rows))
        for name, errors in self.task.input_errors.items():
            column: Floats = getattr(rows, name)
            step = _INPUT_STEP * float(np.abs(getattr(self.task.data, name)).max() or 1.0)
            derivatives = []
            for change in (step, -step):
                moved = rows.replace(name, column + change)
                there, answered = try_response(model, moved, self.task.response)
                derivatives.append(np.where(answered & good, (there - predicted) / change, np.nan))
            with np.errstate(all="ignore"):
                both = np.where(np.isfinite(derivatives[0]), derivatives[0], derivatives[1])
                derivative = np.where(
                    np.isfinite(derivatives).all(axis=0), 0.5 * sum(derivatives), both
                )
            variance += np.nan_to_num(derivative * errors[part.rows]) ** 2
        return variance

    def measure_residuals(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the search makes small, ``r`` (n,): `evaluate`, by a row's error if known.

        A row without an answer counts as `FitData.worst`. In a response of contraction, with
        constants of the model, which may start far off, it is `take_newton_steps` there, moved away
        from 0 by the muscle's length, so that the search finds back.
        """
        residuals, answered, errors = self.compare(self.name_values(point))
        if not answered.all():
            substitute = np.full(residuals.shape, self.task.worst)
            if self.constants and self.task.response == "contraction":
                steps = self.take_newton_steps(point)
                substitute = steps + np.copysign(self.task.muscle.length, steps)
            residuals = np.where(answered, residuals, substitute)
        return residuals if errors is None else residuals / errors

    def measure_cost(self, point: NDArray[np.float64]) -> float:
        """Return the sum of squares in which a row without an answer is `FitData.worst`."""
        residuals, answered, errors = self.compare(self.name_values(point))
        all_residuals = np.where(answered, residuals, self.task.worst)
        all_residuals = all_residuals if errors is None else all_residuals / errors
        return float(all_residuals @ all_residuals)

    def measure_jacobian(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivatives of `measure_residuals` by the point, ``J`` (n, K).

        In rows without an answer 0, or those of `take_newton_steps` where that is the residual.
        """
        task, values = self.task, self.name_values(point)
        if task.input_errors:
            return self._measure_jacobian_directly(point)
        residuals, answered, errors = self.compare(values)
        jacobian = np.zeros((len(task.data), len(self.unknowns)))
        column_of = {label: column for column, label in enumerate(self.unknowns)}
        for index, (part, pairs) in enumerate(zip(task.parts, self.of_part, strict=True)):
            good = part.rows[answered[part.rows]]
            columns = np.array([column_of[label] for _, label in pairs])
            if not good.size:
                continue
            jacobian[np.ix_(good, columns)] = self.scales[columns] * differentiate(
                functools.partial(self._build_again, index=index),
                {label: values[label] for _, label in pairs},
                pairs=self._choose_differences(values, columns),
                data=task.states.select(good),
                predicted=residuals[good] + task.measured[good],
                response=task.response,
            )
        if errors is not None:
            jacobian /= errors[:, None]
        if self.constants and task.response == "contraction" and not answered.all():
            weights = 1.0 if errors is None else errors[~answered]
            here = self.take_newton_steps(point)
            for column, step in enumerate(self._choose_steps(point)):
                there = point.copy()
                there[column] += step
                jacobian[~answered, column] = ((self.take_newton_steps(there) - here) / step)[
                    ~answered
                ] / weights
        return np.clip(np.nan_to_num(jacobian), -_STEEPEST, _STEEPEST)

    def _choose_differences(
        self, values: Mapping[str, float], columns: NDArray[np.intp]
    ) -> list[tuple[str, float, float]]:
        """Return unknowns with the two values that a difference is taken between.

        One of them is the value itself where the force is affine, or if that is good enough.
        """
        found = []
        force = self.task.response == "force"
        for column in columns.tolist():
            label, (low, high) = self.unknowns[column], self.bounds[column].tolist()
            value = values[label]
            size = max(float(self.scales[column]), abs(value))  # the start may have been next to 0
            linear = self.names[column] in self._linear
            if force and (linear or self.rough):
                step = size * (DIFFERENCE_STEP if linear else _ROUGH_STEP)
                up = value + step <= high
                found.append((label, value, value + step) if up else (label, value - step, value))
            else:
                step = size * DIFFERENCE_STEP
                found.append((label, max(low, value - step), min(high, value + step)))
        return found

    def _measure_jacobian_directly(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return central differences of `measure_residuals`, in which weights change as well."""
        columns = []
        low, high = self.bounds.T / self.scales
        for column in range(len(point)):
            ends = []
            for away in (-DIFFERENCE_STEP, DIFFERENCE_STEP):
                there = point.copy()
                there[column] = min(max(there[column] + away, low[column]), high[column])
                ends.append((there[column], self.measure_residuals(there)))
            (a, one), (b, other) = ends
            columns.append((other - one) / (b - a))
        jacobian = np.nan_to_num(np.stack(columns, axis=-1))
        answered = self.evaluate(point)[1]
        return np.clip(np.where(answered[:, None], jacobian, 0.0), -_STEEPEST, _STEEPEST)

    def measure(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return residuals (n,), of a contraction the cheaper ones of `take_newton_steps`."""
        return (
            self.take_newton_steps(point)
            if self.task.response == "contraction"
            else self.measure_residuals(point)
        )

    def take_newton_steps(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a step of Newton's method from each measured state, shape (n,) [mm].

        It is ``(f(P, x) - F) / k``, to first order the model's contraction less the measured one,
        limited smoothly to half the muscle's length, which it is in rows without an answer.
        """
        task, values = self.task, self.name_values(point)
        largest = 0.5 * task.muscle.length
        newton_steps = np.full(len(task.data), largest)
        for index, part in enumerate(task.parts):
            try:
                model = self.build(values, index)
            except BozziniError:
                continue
            rows = task.states.select(part.rows)
            force, answered = model.try_force(
                rows.pressure, rows.contraction, direction=rows.branch
            )
            direction = None if rows.branch is None else rows.branch[answered]
            stiffness, known = try_rows(
                model.stiffness,
                ("pressure", rows.pressure[answered]),
                ("contraction", rows.contraction[answered]),
                direction,
            )
            with np.errstate(all="ignore"):
                steps = (force - rows.load)[answered] / (
                    np.abs(stiffness) + _LEAST_STIFFNESS_N_PER_MM
                )
                limited = steps / np.hypot(1.0, steps / largest)
            newton_steps[part.rows[answered]] = np.where(
                known & np.isfinite(limited), limited, largest
            )
        return newton_steps

    def find_forces(self, point: NDArray[np.float64]) -> tuple[Floats, Floats]:
        """Return the forces at the measured states [N], and the weights of the rows, (n,).

        A weight is 0 in a row without an answer, else 1, or for the contraction 1 over the
        stiffness [mm/N].
        """
        task, values = self.task, self.name_values(point)
        forces, weights = np.zeros(len(task.data)), np.zeros(len(task.data))
        for index, part in enumerate(task.parts):
            model, rows = self.build(values, index), task.states.select(part.rows)
            force, answered = model.try_force(
                rows.pressure, rows.contraction, direction=rows.branch
            )
            forces[part.rows], weights[part.rows] = force, answered
            if task.response == "contraction":
                stiffness = model.stiffness(rows.pressure, rows.contraction, direction=rows.branch)
                weights[part.rows] /= np.abs(stiffness) + _LEAST_STIFFNESS_N_PER_MM
        return forces, weights

    def _choose_steps(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return small steps that stay inside the bounds, in scales."""
        return np.where(
            point + DIFFERENCE_STEP * 10.0 <= self.bounds[:, 1] / self.scales, 1.0, -1.0
        ) * (DIFFERENCE_STEP * 10.0)


def label_unknown(name: str, specimen: str) -> str:
    """Return the name of an unknown that each specimen has its own value of."""
    return f"{name}[{specimen}]" if specimen else name


def assemble(
    model_class: Callable[..., MuscleModel],
    muscle: Muscle,
    values: Mapping[str, float],
    *,
    task: FitData,
    anchor: tuple[float, float] | None,
) -> MuscleModel:
    """Return a model of a muscle with values of its fields, constants and end effects."""
    ends = {name: value for name, value in values.items() if name in END_FIELDS}
    fields = {name: value for name, value in values.items() if name in PARAMETER_UNITS}
    own = {name: value for name, value in values.items() if name not in {*ends, *fields}}
    model = model_class(muscle.replace(**fields) if fields else muscle, **own)
    if anchor is not None:
        ends["offset"] = find_offset(model, pressure=anchor[0], length=anchor[1])
    return (task.ends.replace(**ends) if ends else task.ends).mount(model)


def predict_parts(task: FitData, build: Callable[[SpecimenRows], MuscleModel]) -> Answers:
    """Return the response at each row of a task, and which rows have one."""
    predicted, answered = np.zeros(len(task.data)), np.zeros(len(task.data), dtype=np.bool_)
    for part in task.parts:
        rows = task.states.select(part.rows)
        predicted[part.rows], answered[part.rows] = try_response(build(part), rows, task.response)
    return predicted, answered


def move_model(model: MuscleModel, muscle: Muscle) -> MuscleModel:
    """Return a model of another muscle, with the same constants and end effects."""
    if model.muscle == muscle:
        return model
    if isinstance(model, MountedMuscle):
        return model.ends.mount(move_model(model.model, muscle))
    if isinstance(model, CatalogueModel):
        return model.replace(muscle)
    return replace(model, muscle=muscle)  # type: ignore[type-var]


def list_constants(model: MuscleModel) -> dict[str, float | str]:
    """Return the constants and choices of a model, as its class takes them; laws are left out."""
    if isinstance(model, CatalogueModel):
        return {name: x for name, x in model.keywords.items() if isinstance(x, (int, float, str))}
    names = [*(item.name for item in model.list_parameters()), *model.choices]
    return {name: getattr(model, name) for name in names if name not in list_quantities(Muscle)}


def change_model(
    model: MuscleModel, values: Mapping[str, float], *, anchor: tuple[float, float] | None = None
) -> MuscleModel:
    """Return a model with other values of muscle, constants and ends; an anchor sets the offset."""
    ends = EndEffects()
    if isinstance(model, MountedMuscle):
        ends, model = model.ends, model.model
    of_ends = {name: value for name, value in values.items() if name in END_FIELDS}
    fields = {name: value for name, value in values.items() if name in PARAMETER_UNITS}
    own = {name: x for name, x in values.items() if name not in {*of_ends, *fields}}
    muscle = model.muscle.replace(**fields)
    if isinstance(model, CatalogueModel):
        model = model.replace(muscle, **own)
    else:
        model = replace(model, muscle=muscle, **own)  # type: ignore[type-var]
    if anchor is not None:
        of_ends["offset"] = find_offset(model, pressure=anchor[0], length=anchor[1])
    return ends.replace(**of_ends).mount(model)


def differentiate(
    build: Callable[[Mapping[str, float]], MuscleModel],
    values: Mapping[str, float],
    *,
    pairs: Sequence[tuple[str, float, float]],
    data: _Columns,
    predicted: NDArray[np.float64],
    response: Response = "contraction",
) -> NDArray[np.float64]:
    """Return the derivatives of a response by the parameters, shape (n, k).

    `pairs` are the parameters with the two values that a difference is taken between.

    Of the contraction by the theorem of implicit functions, ``dx/dp = (dF/dp) / k``: the one is a
    difference of the force, which has a closed form in `EnergyMuscle`, the other the model's own.
    So is the force of a mounted muscle ``F = f(P, x - x_0 + c F)``, by differences of ``f``. Of
    other responses, for a model without force, or where a difference leaves its domain, they are
    differences of the response.
    """
    if response == "contraction":
        try:
            return _differentiate_implicitly(build, values, pairs, data, predicted)
        except (BozziniError, ZeroDivisionError, FloatingPointError):
            pass
    model = build(values)
    if response == "force" and isinstance(model, MountedMuscle):
        return _differentiate_mounted(build, values, pairs, data, predicted, model)
    return _differentiate_directly(build, values, pairs, data, predicted, response)


def _differentiate_implicitly(
    build: Callable[[Mapping[str, float]], MuscleModel],
    values: Mapping[str, float],
    pairs: Sequence[tuple[str, float, float]],
    data: _Columns,
    predicted: NDArray[np.float64],
) -> NDArray[np.float64]:
    at, branch = (data.pressure, predicted), data.branch
    stiffness = build(values).stiffness(*at, direction=branch)
    columns = []
    for name, low, high in pairs:
        less, more = (build({**values, name: x}).force(*at, direction=branch) for x in (low, high))
        columns.append((more - less) / (high - low))
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        jacobian: NDArray[np.float64] = np.stack(columns, axis=-1) / stiffness[:, None]
    return jacobian


def _differentiate_mounted(
    build: Callable[[Mapping[str, float]], MuscleModel],
    values: Mapping[str, float],
    pairs: Sequence[tuple[str, float, float]],
    data: _Columns,
    predicted: NDArray[np.float64],
    mounted: MountedMuscle,
) -> NDArray[np.float64]:
    """Return ``dF/dp = (df/dp) / (1 - c df/dx)``, where ``F`` is the slack force 1 by that or 0.

    ``f`` is the force of the muscle at ``x - x_0 + c F``, with F held, so that ``df/dx_0`` is
    ``-df/dx`` and ``df/dc`` is ``F df/dx``.
    """
    floor = mounted.ends.slack_force
    taut = np.ones(len(predicted), np.bool_) if floor is None else predicted > floor
    branch = None if data.branch is None else data.branch[taut]
    pressure, force = data.pressure[taut], predicted[taut]

    def force_at(at: MuscleModel, away: float = 0.0) -> Answers:
        at = at if isinstance(at, MountedMuscle) else MountedMuscle(at)
        own_contraction = (
            data.contraction[taut] + away - at.ends.offset + at.ends.compliance * force
        )
        return at.model.try_force(pressure, own_contraction, direction=branch)

    def force_with(name: str, x: float) -> Answers:
        return force_at(build({**values, name: x}))

    step = _SLOPE_STEP * mounted.muscle.length
    force_slope = _difference(lambda away: force_at(mounted, away), (-step, step), 0.0, force)
    jacobian = np.zeros((len(predicted), len(pairs)))
    for column, (name, low, high) in enumerate(pairs):
        if name == "offset":
            change = -force_slope
        elif name == "compliance":
            change = force_slope * force
        elif name == "slack_force":
            jacobian[~taut, column] = 1.0
            continue
        else:
            change = _difference(
                functools.partial(force_with, name), (low, high), values[name], force
            )
        with np.errstate(all="ignore"):
            jacobian[taut, column] = change / (1.0 - mounted.ends.compliance * force_slope)
    return jacobian


def _differentiate_directly(
    build: Callable[[Mapping[str, float]], MuscleModel],
    values: Mapping[str, float],
    pairs: Sequence[tuple[str, float, float]],
    data: _Columns,
    predicted: NDArray[np.float64],
    response: Response,
) -> NDArray[np.float64]:

    def answer(name: str, x: float) -> Answers:
        return try_response(build({**values, name: x}), data, response)

    columns = [
        _difference(functools.partial(answer, name), (low, high), values[name], predicted)
        for name, low, high in pairs
    ]
    return np.stack(columns, axis=-1)


def _difference(
    answer: Callable[[float], Answers], ends: tuple[float, float], at: float, known: Floats
) -> Floats:
    """Return central differences, to one side where the other has no answer, 0 without any."""
    pairs = []
    for x in ends:
        try:
            found, answered = (known, np.ones(len(known), np.bool_)) if x == at else answer(x)
        except BozziniError:  # such a value is not legal
            found, answered = known, np.zeros(len(known), np.bool_)
        pairs.append((np.where(answered, found, known), np.where(answered, x, at)))
    (one, a), (other, b) = pairs
    with np.errstate(all="ignore"):
        return np.where(b > a, (other - one) / (b - a), 0.0)


_TRIALS = 16  # points at which the data are examined
_DEPENDENT = 1e-5  # of a column of the Jacobian: what is left across those before it
_NO_EFFECT = 1e-9  # largest change by a step of an unknown that counts as none, of the span or [mm]


@dataclass(frozen=True, kw_only=True)
class Unknowns:
    """Fields of the muscle and constants of a model that are fitted, with where these start.

    `held` are unknowns that are not fitted, and why. `build` makes the model from a
    muscle and the constants in `start`.
    """

    fields: tuple[str, ...]
    start: dict[str, float]
    held: dict[str, str]
    build: Callable[..., MuscleModel]

    @property
    def free(self) -> tuple[str, ...]:
        """All that is fitted, by name."""
        return (*self.fields, *self.start)


def unwrap(make: Callable[..., MuscleModel]) -> tuple[object, dict[str, object]]:
    """Return the class behind what makes a model, and the keywords it is given."""
    given: dict[str, object] = {}
    while isinstance(make, functools.partial):
        given = {**make.keywords, **given}
        make = make.func
    return make, given


def split_model(
    model_class: Callable[..., MuscleModel],
) -> tuple[type[CatalogueModel] | None, dict[str, object]]:
    """Return the class of the catalogue behind what makes a model, and the keywords it has."""
    make, given = unwrap(model_class)
    found = isinstance(make, type) and issubclass(make, CatalogueModel)
    return (make if found else None), given  # type: ignore[return-value]


def list_parameters(model_class: Callable[..., MuscleModel]) -> tuple[Parameter, ...]:
    """Return the constants that a model has beside the muscle."""
    kind, _ = unwrap(model_class)
    is_model = isinstance(kind, type) and issubclass(kind, MuscleModel)
    return kind.list_parameters() if is_model else ()  # type: ignore[attr-defined]


def list_own(model_class: Callable[..., MuscleModel]) -> dict[str, Parameter]:
    """Return the constants of a model that are not given, by name."""
    _, given = unwrap(model_class)
    return {item.name: item for item in list_parameters(model_class) if item.name not in given}


def list_unused(model_class: Callable[..., MuscleModel]) -> tuple[str, ...]:
    """Return the fields of a muscle that make no difference to a model."""
    return tuple(getattr(unwrap(model_class)[0], "unused", ()))


FITTED_UNSET = ("braid_angle", "modulus")
"""Fields that are fitted where they are not given."""
HELD_UNSET = ("inner_radius",)
"""Fields that are held at a typical value: a thin wall is known by modulus times thickness only."""


def settle_unset(
    model_class: Callable[..., MuscleModel], task: FitData
) -> tuple[FitData, tuple[str, ...]]:
    """Return a task whose muscle has what is not given, and which of that is to be fitted."""
    unused = list_unused(model_class)
    unset = [name for name in FITTED_UNSET if name in task.muscle.unset and name not in unused]
    return replace(task, muscle=task.muscle.fill((*HELD_UNSET, *unset))), tuple(unset)


def name_default_fields(model_class: Callable[..., MuscleModel]) -> tuple[str, ...]:
    """Return the fields of a muscle that are fitted if none are named."""
    fields = getattr(unwrap(model_class)[0], "fit_fields", ("modulus", "dead_length"))
    return tuple(name for name in fields if name not in list_unused(model_class))


def choose_unknowns(
    model_class: Callable[..., MuscleModel], task: FitData, *, fields: tuple[str, ...] | None = None
) -> Unknowns:
    """Return what can be fitted of a model to such data.

    Fitted are the constants that the model's source fitted, and those that it must be given and
    that are not. What the data do not determine, having no effect or the same as others, is held
    where the fit would start.
    """
    wanted = name_default_fields(model_class) if fields is None else fields
    muscle = task.muscle
    kind, given = split_model(model_class)
    known = list_own(model_class)
    wanted = tuple(name for name in wanted if name not in {*known, *given})
    if kind is None and not any(item.source == "fitted" for item in known.values()):
        return Unknowns(fields=wanted, start={}, held={}, build=model_class)
    muscle = muscle.fill(wanted)
    task = replace(task, muscle=muscle)
    begin = guess_constants(model_class, muscle)
    guess = {**begin, **given}
    held = {} if kind is None else _find_unsupported(kind, given)
    own = {
        item.name: item
        for item in sorted(known.values(), key=lambda item: item.source != "fitted")
        if item.name not in held and _is_unknown(item, given)
    }
    start = {name: begin[name] for name in own}
    build = _hold(model_class, guess, start)
    build(muscle, **start)  # raises if a law is missing
    names = (*wanted, *own)
    if not names:
        return Unknowns(fields=(), start={}, held=held, build=build)
    problem = Problem(
        model_class=build,
        task=replace(task, each=()),
        free=names,
        limits=choose_bounds(names, task, {}, own),
        constants=start,
    )
    undetermined = _find_undetermined(problem)
    start = {name: value for name, value in start.items() if name not in undetermined}
    return Unknowns(
        fields=tuple(name for name in wanted if name not in undetermined),
        start=start,
        held={**held, **undetermined},
        build=_hold(model_class, guess, start),
    )


def guess_constants(model_class: Callable[..., MuscleModel], muscle: Muscle) -> dict[str, float]:
    """Return where a fit of each constant may begin, those included that not every fit needs.

    A model outside the catalogue begins at its defaults. Without a guess or a default it is the
    muscle's length for a length, else the middle of the bounds.
    """
    kind, _ = split_model(model_class)
    items = list_parameters(model_class)
    defaults = {item.name: item.default for item in items if item.default is not None}
    guess = defaults if kind is None else kind.guess_parameters(muscle)
    for item in items:
        low, high = item.bounds
        middle = muscle.active_length if item.unit == "mm" else 0.5 * (low + high)
        if item.source == "fitted":
            guess.setdefault(item.name, min(max(middle, low), high))
    return guess


def draw_point(problem: Problem, random: np.random.Generator) -> NDArray[np.float64]:
    """Return a point of the search somewhere about the start.

    A constant moves by a factor between 1/4 and 4, one that starts at 0 to something between
    1/100 and 3, of either sign if that is legal.
    """
    values = []
    starts = zip(problem.names, problem.start.values(), problem.bounds, strict=True)
    for name, value, (low, _) in starts:
        factor = 4.0 ** random.uniform(-1.0, 1.0)
        if name not in problem.constants:
            factor = 1.25 ** random.uniform(-1.0, 1.0)
        elif value == 0.0:
            value = 1.0 if low >= 0.0 else float(random.choice([-1.0, 1.0]))
            factor = 10.0 ** random.uniform(-2.0, 0.5)
        values.append(value * factor)
    return np.asarray(np.clip(np.array(values), *problem.bounds.T) / problem.scales)


def _hold(
    model_class: Callable[..., MuscleModel],
    guess: Mapping[str, object],
    free: Mapping[str, float],
) -> Callable[..., MuscleModel]:
    """Return what makes the model with the guess for all that is neither given nor free."""
    own = list_own(model_class)
    return functools.partial(
        model_class, **{name: guess[name] for name in own if name in guess and name not in free}
    )


def _is_unknown(item: Parameter, given: Mapping[str, object]) -> bool:
    if item.only_with and not given.get(item.only_with) and item.source != "fitted":
        return False
    required = item.default is None and item.source != "unit"
    return item.source == "fitted" or required


def _find_unsupported(kind: type[CatalogueModel], given: Mapping[str, object]) -> dict[str, str]:
    """Return the constants that stay at 0, since what they need beside them is not given."""
    lacking: dict[str, list[str]] = {}
    for item in kind.card.parameters:
        needed = item.default is None and item.source != "fitted"
        if item.only_with and needed and item.name not in given:
            lacking.setdefault(item.only_with, []).append(item.name)
    for law in kind.card.laws:
        if law.only_with and law.required and law.name not in given:
            lacking.setdefault(law.only_with, []).append(f"the law {law.name} ({law.paper})")
    unknown = [item.name for item in kind.card.parameters if _is_unknown(item, given)]
    return {
        name: f"held at 0: it needs {' and '.join(needs)}"
        for name, needs in lacking.items()
        if name not in given and name in unknown
    }


def _find_undetermined(problem: Problem) -> dict[str, str]:
    """Return the unknowns that such data leave undetermined, and why."""
    random = np.random.default_rng(0)
    lost: list[dict[str, str]] = []
    for _ in range(_TRIALS):
        point = draw_point(problem, random)
        jacobian = problem.measure_jacobian(point)[problem.evaluate(point)[1]]
        if np.isfinite(jacobian).all() and jacobian.any():
            lost.append(_find_dependent(problem.free, jacobian))
    if not lost:
        return {}
    return {name: text for name, text in lost[0].items() if all(name in one for one in lost)}


def _find_dependent(names: tuple[str, ...], jacobian: NDArray[np.float64]) -> dict[str, str]:
    """Return the columns that are no more than those before them, and in what words.

    By Gram and Schmidt: what is left of a column across those before it.
    """
    words = {}
    basis: list[NDArray[np.float64]] = []
    for name, column in zip(names, jacobian.T, strict=True):
        length = float(np.linalg.norm(column))
        if length <= _NO_EFFECT:
            words[name] = "held: it has no effect at these rows"
            continue
        remainder = column / length
        for other in basis:
            remainder = remainder - (remainder @ other) * other
        size = float(np.linalg.norm(remainder))
        if size <= _DEPENDENT:
            words[name] = "held: these rows do not distinguish it"
            continue
        basis.append(remainder / size)
    return words

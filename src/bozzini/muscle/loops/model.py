"""A muscle by its identified loops: what it does along a history, its inverse, and its file."""

from __future__ import annotations

import dataclasses
import json
import os
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import (
    check_array,
    check_number,
    check_path,
    check_range,
    check_word,
    choose,
)
from ...errors import FileFormatError, InputError
from ...io.files import write_text
from ...io.records import format_yaml, load_data, read_record, write_record
from ...numeric.arrays import Floats
from ...results import Json, Result, Shown, measured, take_axes
from ..design import PRESSURE_LIMIT
from ..ends import MountedMuscle
from ..files import MuscleFile
from ..hysteresis import (
    AsymmetricPrandtlIshlinskii,
    BoucWen,
    FrictionBand,
    GeneralisedPrandtlIshlinskii,
    HysteresisState,
    InvertibleOperator,
    MaxwellFriction,
    Operator,
    PrandtlIshlinskii,
    Preisach,
    UnparallelPrandtlIshlinskii,
)
from ..hysteresis.operator import LIMIT
from ..model import MuscleModel
from .record import RESPONSES, Response

if TYPE_CHECKING:
    from matplotlib.axes import Axes


OPERATORS: dict[str, type[Operator]] = {
    "generalised": GeneralisedPrandtlIshlinskii,
    "prandtl-ishlinskii": PrandtlIshlinskii,
    "asymmetric": AsymmetricPrandtlIshlinskii,
    "unparallel": UnparallelPrandtlIshlinskii,
    "bouc-wen": BoucWen,
    "preisach": Preisach,
    "friction-band": FrictionBand,
    "maxwell-slip": MaxwellFriction,
}
"""The operators that recorded loops are fitted with, by name."""

KIND, VERSION = "bozzini-hysteresis", 1
_POINTS = 1001  # of a static curve's table
_BEYOND = (1.5, 1.25, 1.0)  # times the largest pressure of a record: a table goes so far if it can
_NEAR = 1e-9  # of the highest pressure: so near to a bound is there
_MISSED = 1e-4  # of the span of the responses: so much less than wanted is not reached


@dataclass(frozen=True, eq=False)
class StaticCurve:
    """A model's response over the pressure that acts, held load or contraction being constant."""

    acting: Floats
    response: Floats

    def apply(self, acting: Floats) -> Floats:
        """Return the responses; beyond the ends those of the ends."""
        return np.interp(acting, self.acting, self.response)

    def invert(self, response: Floats) -> Floats:
        """Return the pressures that act; beyond the ends those of the ends."""
        return np.interp(response, self.response, self.acting)

    def find_slopes(self, acting: Floats) -> Floats:
        """Return the slopes, by central differences of the table."""
        return np.interp(acting, self.acting, np.gradient(self.response, self.acting))


@dataclass(frozen=True, eq=False, kw_only=True)
class LoopModel(Shown):
    """A muscle with the hysteresis that was identified: contraction or force over a history.

    Parameters
    ----------
    operator : Operator
        From the pressure to the one that acts [MPa] if there is a static model, else to the
        response.
    kind : str
        ``"contraction"`` [mm] or ``"force"`` [N]: the response.
    static : MuscleModel, optional
        The model without hysteresis.
    held : float
        Load [N] while the contraction is asked for, contraction [mm] while the force is.
    pressures : tuple of float
        Lowest and highest pressure that the operator was fitted to [MPa].
    offset : float
        What the record that it was fitted to is off by at its end, drift included [mm or N]:
        responses are those that its sensor would show then.
    longest : float
        Length that contractions are counted from [mm], where lengths were recorded; 0 otherwise.
    state : HysteresisState, optional
        What the operator remembers at the end of what was fitted.
    """

    operator: Operator
    kind: Response = "contraction"
    static: MuscleModel | None = None
    held: float = 0.0
    pressures: tuple[float, float] = (0.0, PRESSURE_LIMIT)
    offset: float = 0.0
    longest: float = 0.0
    state: HysteresisState | None = None

    def __post_init__(self) -> None:
        check_word("kind", self.kind, tuple(RESPONSES))
        if not isinstance(self.operator, tuple(OPERATORS.values())):
            raise InputError(
                f"operator is a {type(self.operator).__name__}: it must be one of "
                f"{', '.join(kind.__name__ for kind in OPERATORS.values())}"
            )

    @property
    def operator_name(self) -> str:
        """Name of the operator in `OPERATORS`."""
        return next(name for name, kind in OPERATORS.items() if type(self.operator) is kind)

    def carry(self) -> MuscleModel:
        """Return the static model with the operator as its `hysteresis`.

        Raises
        ------
        InputError
            If there is no static model.
        """
        if self.static is None:
            raise InputError("there is no static model to carry the operator: fit with one")
        return _carry(self.static, self.operator)

    def trace(self, pressure: ArrayLike, *, resume: bool = False) -> Floats:
        """Return the response [mm or N] along a history of pressures (n,) [MPa].

        It begins at rest, or at the end of the record that was fitted to `resume` there.

        Raises
        ------
        InputError
            If a pressure is negative or the operator or the model refuses the history.
        """
        pressures = check_array("pressure", pressure)
        check_range("pressure", pressures, 0.0, PRESSURE_LIMIT, "MPa")
        acting, _ = self.operator.run(pressures, initial=self._begin(resume))
        if self.static is not None and self.kind == "contraction":
            acting = self.static.contraction(acting, self.held)
        elif self.static is not None:
            acting = self.static.force(acting, self.held)
        return acting + self.offset

    def _begin(self, resume: bool) -> HysteresisState | None:
        if resume and self.state is None:
            raise InputError("there is no state of a record to resume at")
        return self.state if resume else None

    @cached_property
    def curve(self) -> StaticCurve | None:
        """The static response over the pressure that acts; None without a static model."""
        if self.static is None:
            return None
        return tabulate(self.static, self.kind, self.held, self.pressures[1])

    def compensate(
        self, wanted: ArrayLike, *, highest: float | None = None, resume: bool = False
    ) -> Compensation:
        """Return the pressures that give the responses wanted, in spite of the hysteresis.

        Sample by sample, from rest or, to `resume` there, from the end of the record. A response
        out of reach gets the pressure that comes nearest: none, or the highest; what follows is
        computed from there.

        Parameters
        ----------
        wanted : (n,) array_like
            Responses in the order of time [mm or N].
        highest : float, optional
            Highest pressure [MPa]; by default the highest that the operator was fitted to.
        resume : bool
            Whether to begin at the end of what was fitted.

        Raises
        ------
        InputError
            If the operator has no inverse.
        """
        asked = np.atleast_1d(check_array("wanted", wanted))
        check_range("wanted", asked, -LIMIT, LIMIT, RESPONSES[self.kind])
        if asked.ndim != 1 or not asked.size:
            raise InputError(f"wanted has shape {asked.shape}: a history has (n,)")
        if not isinstance(self.operator, InvertibleOperator):
            legal = [name for name, x in OPERATORS.items() if issubclass(x, InvertibleOperator)]
            raise InputError(
                f"the operator {self.operator_name} has no inverse: fit one of {', '.join(legal)}"
            )
        top = self.pressures[1] if highest is None else highest
        top = check_number("highest", top, low=0.0, low_open=True, high=PRESSURE_LIMIT, unit="MPa")
        curve = self.curve
        acting = asked - self.offset
        acting = acting if curve is None else curve.invert(acting)
        pressure = self.operator.invert_history(
            acting, between=(0.0, top), initial=self._begin(resume), clip=True
        )
        pressure = np.clip(pressure, 0.0, top)
        reached = self.trace(pressure, resume=resume)
        least, most = self.trace([0.0, top]).tolist()
        at_end = (pressure <= _NEAR * top) | (pressure >= (1.0 - _NEAR) * top)
        return Compensation(
            wanted=asked,
            pressure=pressure,
            reached=reached,
            saturated=at_end & (np.abs(reached - asked) > _MISSED * (most - least)),
            highest=top,
            bounds=(least, most),
            kind=self.kind,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Compensation(Result):
    """Pressures for a history of contractions or forces.

    Attributes
    ----------
    wanted, reached : (n,) ndarray
        Responses asked for and, by the identified operator, reached [mm or N].
    pressure : (n,) ndarray
        Pressures [MPa].
    saturated : (n,) ndarray of bool
        Where the inverse is at its bound: no pressure, or the highest.
    highest : float
        Highest pressure [MPa].
    bounds : tuple of float
        Responses without pressure and at the highest, from rest [mm or N].
    kind : str
        What the responses are.
    """

    wanted: Floats
    reached: Floats
    pressure: Floats = measured("MPa")
    saturated: NDArray[np.bool_]
    highest: float = measured("MPa")
    bounds: tuple[float, float]
    kind: Response = field(default="contraction")

    @property
    def converged(self) -> bool:
        """Whether all that is wanted is reached."""
        return not self.saturated.any()

    @property
    def reason(self) -> str:
        """How much is out of reach."""
        if self.converged:
            return ""
        unit = RESPONSES[self.kind]
        return (
            f"{int(self.saturated.sum())} of {len(self.wanted)} samples are out of reach: from "
            f"rest up to {1e3 * self.highest:.4g} kPa the {self.kind} lies in "
            f"[{self.bounds[0]:.4g}, {self.bounds[1]:.4g}] {unit}"
        )

    @property
    def residual(self) -> Floats:
        """Wanted less reached [mm or N]."""
        return self.wanted - self.reached

    def list_columns(self) -> Json:
        """Return the columns of `to_frame`, a row for each sample."""
        unit = RESPONSES[self.kind]
        return {
            f"wanted_{unit}": self.wanted,
            "pressure_MPa": self.pressure,
            f"reached_{unit}": self.reached,
            "saturated": self.saturated,
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the pressures over the samples, those at a bound marked, and return the axes."""
        axes = take_axes(ax, x="sample", y="pressure [kPa]")
        axes.plot(1e3 * self.pressure)
        places = np.flatnonzero(self.saturated)
        axes.plot(places, 1e3 * self.pressure[places], ".", color="tab:red")
        return axes


def tabulate(model: MuscleModel, kind: Response, held: float, highest: float) -> StaticCurve:
    """Return a model's response over pressures up to beyond the highest, without hysteresis."""

    def answer(acting: Floats) -> Floats:
        ask = model.contraction if kind == "contraction" else model.force
        return np.asarray(ask(acting, held))

    def find_lowest(low: float, high: float) -> float:
        """Lowest pressure with an answer: under a load some models have none below it."""
        for _ in range(50):
            middle = 0.5 * (low + high)
            try:
                answer(np.array([middle]))
                high = middle
            except InputError:
                low = middle
        return high

    for share in _BEYOND:
        top = min(share * highest, PRESSURE_LIMIT)
        try:
            answer(np.array([top]))
            break
        except InputError:
            if share == _BEYOND[-1]:
                raise
    acting = np.linspace(0.0, top, _POINTS)
    try:
        response = answer(acting)
    except InputError:
        acting = np.linspace(find_lowest(0.0, top), top, _POINTS)
        response = answer(acting)
    if not np.ptp(response) > 0.0 or response[-1] <= response[0]:
        raise InputError(
            f"the {kind} of the model {model.name} does not increase up to {top:g} MPa: it cannot "
            "be the static model"
        )
    return StaticCurve(acting, np.maximum.accumulate(response))


# Files


@dataclass(frozen=True)
class _Head:
    """Plain fields of a file."""

    kind: str
    version: int
    operator: str
    response: Response
    held: float
    pressures: tuple[float, float]
    offset: float
    longest: float


@dataclass(frozen=True)
class _State:
    """What the operator remembers, in a file."""

    last: float
    memory: tuple[float, ...]


def save_loop_model(
    path: str | os.PathLike[str], model: LoopModel, *, fit: Json | None = None
) -> Path:
    """Write an identified operator as YAML, or as JSON if the name ends in ``.json``.

    Parameters
    ----------
    path : path-like
    model : LoopModel
    fit : dict, optional
        Plain values on the fit, for people; `load_loop_model` does not read them.

    Raises
    ------
    OutputError
        If the file cannot be written.
    InputError
        If the static model has laws that are functions, which no file holds.
    """
    target = check_path("path", path)
    data = {
        **write_record(
            _Head(
                KIND, VERSION, model.operator_name, model.kind, model.held, model.pressures,
                model.offset, model.longest,
            )
        ),
        "constants": write_record(model.operator),
    }  # fmt: skip
    if model.static is not None:
        data["static"] = write_record(_describe_static(model.static))
    if model.state is not None:
        memory = tuple(model.state.memory.tolist())
        data["state"] = write_record(_State(float(model.state.last), memory))
    if fit:
        data["fit"] = fit
    text = json.dumps(data, indent=2) + "\n"
    return write_text(target, text if target.suffix.lower() == ".json" else format_yaml(data))


def load_loop_model(path: str | os.PathLike[str]) -> LoopModel:
    """Read a file of `save_loop_model`.

    Raises
    ------
    FileFormatError
        If it is none; the message has the field.
    """
    source = check_path("path", path)
    data = load_data(source)
    try:
        return _read_model(data)
    except InputError as error:
        raise FileFormatError(f"{source}: {error}") from None


def _read_model(data: object) -> LoopModel:
    if not isinstance(data, dict) or data.get("kind") != KIND:
        raise InputError(f"it has no 'kind: {KIND}': it is no file of identified loops")
    parts = ("constants", "static", "state", "fit")
    head = read_record({name: x for name, x in data.items() if name not in parts}, _Head)
    if head.version != VERSION:
        raise InputError(f"version is {head.version}: it must be {VERSION}")
    kind = choose("operator", head.operator, OPERATORS)
    low = check_number("pressures[0]", head.pressures[0], low=0.0, high=PRESSURE_LIMIT, unit="MPa")
    check_number(
        "pressures[1]", head.pressures[1], low=low, low_open=True, high=PRESSURE_LIMIT, unit="MPa"
    )
    state = data.get("state")
    if state is not None:
        known = read_record(state, _State, name="state")
        state = HysteresisState(np.array(known.last), np.array(known.memory))
    static = data.get("static")
    operator: Operator = read_record(data.get("constants"), kind, name="constants")
    if state is not None:
        operator.run([], initial=state)
    return LoopModel(
        operator=operator,
        kind=head.response,
        static=None if static is None else read_record(static, MuscleFile, name="static").build(),
        held=head.held,
        pressures=head.pressures,
        offset=head.offset,
        longest=head.longest,
        state=state,
    )


def _describe_static(model: MuscleModel) -> MuscleFile:
    """Return the muscle file of a model."""
    if isinstance(model, MountedMuscle):
        return dataclasses.replace(_describe_static(model.model), ends=model.ends)
    own = {item.name: getattr(model, item.name) for item in type(model).list_parameters()}
    own |= {name: getattr(model, name) for name in model.choices}
    given: Json = getattr(model, "keywords", own)
    for name, value in given.items():
        if callable(value):
            raise InputError(f"{name} of the model {model.name} is a function: no file holds it")
    constants = {name: value for name, value in given.items() if value is not None}
    return MuscleFile(muscle=model.muscle, model=model.name, constants=constants)


def _carry(model: MuscleModel, operator: Operator) -> MuscleModel:
    """Return a model with an operator."""
    if isinstance(model, MountedMuscle):
        return dataclasses.replace(model, model=_carry(model.model, operator))
    if dataclasses.is_dataclass(model):
        return dataclasses.replace(model, hysteresis=operator)  # type: ignore[unreachable]
    return model.replace(hysteresis=operator)  # type: ignore[attr-defined,no-any-return]

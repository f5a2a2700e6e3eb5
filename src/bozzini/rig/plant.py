"""The pneumatic plant: compressor, reservoir, valves, lines, three muscles, transducers, faults."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..checks import (
    check_array,
    check_fields,
    check_integer,
    check_number,
    check_range,
    list_quantities,
    quantity,
    show_apart,
)
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import ClosedForm, Shown, measured, take_axes
from .kernels import plant as kernels
from .pneumatics import ATMOSPHERE, HEAT_RATIO, NOZZLE_RATIO, NOZZLE_SPEED, Orifice

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..muscle.model import MuscleModel

MUSCLES = 3
"""Muscles of the rig."""

VISCOSITY = 1.82e-11
"""Of air at 20 °C [MPa s]."""

LONGEST_STEP = 1e-4
"""Longest time step [s]."""
SHORTEST_STEP = 1e-6
"""Shortest time step [s]; a design that needs a shorter one is refused."""
STEPS_PER_TIME_CONSTANT = 20.0
"""Steps in the shortest time constant of a valve or leak and a volume: no step overshoots."""

STICK_CENTRE = 2.5
"""Voltage of the stick at rest [V]."""

PROVENANCES = ("thesis", "data sheet", "measured", "assumption")
"""With one of these the source of a field of `PlantDesign` begins."""


@dataclass(frozen=True, kw_only=True)
class PlantDesign(Shown):
    """Every constant of the plant, each with the source of its default (`Quantity.source`).

    Parameters
    ----------
    reservoir_volume, reservoir_pressure, reservoir_leak_area : float
        Volume [mm^3], gauge pressure at the beginning [MPa], effective area of its leak [mm^2].
    compressor_flow, compressor_pressure, compressor_on, compressor_off : float
        Free air against no pressure [mm^3/s], gauge pressure at which it delivers nothing, below
        which it starts and above which it stops [MPa].
    fill_area, bleed_area, critical_ratio : float
        Effective areas of the valves fully open [mm^2], and their critical pressure ratio.
    valve_lag, valve_hysteresis, valve_dead_zone, valve_leak : float
        First-order lag [s]; width of the play, duty at which the valve begins to open, and opening
        when shut, as shares.
    tube_length, tube_bore, dead_volume : float
        Tube from the valves to the muscle [mm], and fittings and transducer [mm^3].
    pipette_length, pipette_bore : float
        Narrow end of the line at the muscle [mm], beyond the transducer; of length 0 it resists
        nothing.
    exponent : float
        Of the change of state: 1 isothermal, 1.4 adiabatic.
    sensor_range, sensor_lag, sensor_noise : float
        Gauge pressure of the full span [MPa], first-order lag [s], standard deviation [MPa].
    sensor_zero, sensor_span, sensor_supply : float
        Reading without pressure and its span as shares of the supply, and the supply [V].

    Raises
    ------
    InputError
        If a value is outside its legal range, or a line is so small that the steps would be
        shorter than `SHORTEST_STEP`.
    """

    reservoir_volume: float = quantity(
        "volume",
        "Volume of the reservoir.",
        default=1e6,
        low=1e3,
        high=1e9,
        source="thesis 3.2: 1 litre (at NTP)",
    )
    reservoir_pressure: float = quantity(
        "pressure",
        "Gauge pressure of the reservoir at the beginning.",
        default=0.88,
        low=0.0,
        high=2.0,
        source="assumption: within the compressor's band",
    )
    reservoir_leak_area: float = quantity(
        "area", "Leak of the reservoir.", default=0.0, low=0.0, high=1.0, source="assumption: none"
    )
    compressor_flow: float = quantity(
        "volume flow",
        "Free air against no pressure.",
        default=1e7 / 60.0,
        low=0.0,
        high=1e8,
        source="assumption: 10 L/min, a small oil-free compressor",
    )
    compressor_pressure: float = quantity(
        "pressure",
        "Gauge pressure at which the compressor delivers nothing.",
        default=1.034,
        low=1e-3,
        high=2.0,
        source="thesis 3.2: maximum output pressure 1034 kPa",
    )
    compressor_on: float = quantity(
        "pressure",
        "Gauge pressure below which the compressor starts.",
        default=0.85,
        low=0.0,
        high=2.0,
        source="assumption: above the 827 kPa that thesis 3.2 has available at all times",
    )
    compressor_off: float = quantity(
        "pressure",
        "Gauge pressure above which the compressor stops.",
        default=0.93,
        low=lambda design: design.compressor_on,
        high=2.0,
        source="assumption: below the maximum output pressure",
    )
    fill_area: float = quantity(
        "area",
        "Effective area of a fill valve fully open.",
        default=0.0304,
        low=0.0,
        low_open=True,
        high=10.0,
        source="assumption: an orifice of 0.25 mm with a discharge coefficient of 0.62",
    )
    bleed_area: float = quantity(
        "area",
        "Effective area of a bleed valve fully open.",
        default=0.0779,
        low=0.0,
        low_open=True,
        high=10.0,
        source="assumption: an orifice of 0.4 mm, which empties a muscle within 0.1 s",
    )
    critical_ratio: float = quantity(
        help="Critical pressure ratio of all orifices.",
        default=NOZZLE_RATIO,
        low=0.01,
        high=0.95,
        source="assumption: an ideal nozzle; data sheets of valves have 0.2 to 0.5",
    )
    valve_lag: float = quantity(
        "time",
        "First-order lag of a valve.",
        default=4e-3,
        low=0.0,
        high=1.0,
        source="assumption: a small proportional solenoid valve",
    )
    valve_hysteresis: float = quantity(
        help="Width of a valve's play, as a share of the full duty.",
        default=0.04,
        low=0.0,
        high=0.5,
        source="assumption",
    )
    valve_dead_zone: float = quantity(
        help="Duty at which a valve begins to open.",
        default=0.3,
        low=0.0,
        high=0.95,
        source="assumption",
    )
    valve_leak: float = quantity(
        help="Opening of a valve that is shut.",
        default=2e-5,
        low=0.0,
        high=0.1,
        source="assumption",
    )
    tube_length: float = quantity(
        "length",
        "Tube from the valves to the muscle.",
        default=500.0,
        low=0.0,
        high=1e5,
        source="assumption",
    )
    tube_bore: float = quantity(
        "length",
        "Bore of the tube.",
        default=1.0,
        low=0.01,
        high=20.0,
        source="assumption: thesis 4.2 has Teflon tubes of 2 mm diameter, without the bore",
    )
    dead_volume: float = quantity(
        "volume",
        "Fittings and transducer.",
        default=37.0,
        low=0.0,
        high=1e7,
        source="assumption",
    )
    pipette_length: float = quantity(
        "length",
        "Length of the micro-pipette at the muscle.",
        default=30.0,
        low=0.0,
        high=1e4,
        source="assumption: thesis 3.2 has a micro-pipette, without its size",
    )
    pipette_bore: float = quantity(
        "length",
        "Bore of the micro-pipette.",
        default=0.3,
        low=0.01,
        high=20.0,
        source="assumption: below the 0.5 mm bore of the muscle's tube (thesis Fig. 3.11)",
    )
    exponent: float = quantity(
        help="Exponent of the change of state.",
        default=1.0,
        low=1.0,
        high=HEAT_RATIO,
        source="assumption: isothermal; thermal times in a bore of 1 mm are 2 to 16 ms",
    )
    sensor_range: float = quantity(
        "pressure",
        "Gauge pressure of the transducer's full span.",
        default=1.034,
        low=1e-3,
        high=10.0,
        source="thesis 3.2: Honeywell, 0 to 1034 kPa",
    )
    sensor_lag: float = quantity(
        "time",
        "First-order lag of the transducer.",
        default=5e-4,
        low=0.0,
        high=1.0,
        source="data sheet: Honeywell HSC analog, updated at about 1 kHz",
    )
    sensor_noise: float = quantity(
        "pressure",
        "Standard deviation of the transducer's noise.",
        default=1.5e-3,
        low=0.0,
        high=0.1,
        source="assumption",
    )
    sensor_zero: float = quantity(
        help="Reading without pressure, as a share of the supply.",
        default=0.1,
        low=0.0,
        high=0.9,
        source="assumption: 0.5 V of 5 V, usual for ratiometric transducers",
    )
    sensor_span: float = quantity(
        help="Span of the reading, as a share of the supply.",
        default=0.8,
        low=0.01,
        high=lambda design: 1.0 - design.sensor_zero,
        source="assumption: 0.5 to 4.5 V of 5 V",
    )
    sensor_supply: float = quantity(
        "voltage",
        "Supply of transducers and stick.",
        default=5.0,
        low=1.0,
        high=30.0,
        source="thesis 4.6: the stick reads 0 to 1024 for 0 to 5 V",
    )

    def __post_init__(self) -> None:
        check_fields(self, "plant ")
        step = self._find_step(0.0)
        if step < SHORTEST_STEP:
            shown = show_apart(self.line_volume, self.line_volume * SHORTEST_STEP / step)
            raise InputError(
                f"tube and dead volume are {shown[0]} mm^3: with these valves they must "
                f"be at least {shown[1]} mm^3"
            )

    @property
    def line_volume(self) -> float:
        """Volume of a line up to the pipette [mm^3]."""
        return 0.25 * math.pi * self.tube_bore**2 * self.tube_length + self.dead_volume

    @property
    def pipette_conductance(self) -> float:
        """Laminar pV flow over the difference of the squared absolute pressures [mm^3/(s MPa)].

        ``pi d**4 / (256 mu L)``: Poiseuille's law for a gas, isothermal.
        """
        if self.pipette_length == 0.0:
            return math.inf
        return math.pi * self.pipette_bore**4 / (256.0 * VISCOSITY * self.pipette_length)

    @property
    def fill_valve(self) -> Orifice:
        """A fill valve fully open."""
        return Orifice(area=self.fill_area, critical_ratio=self.critical_ratio)

    @property
    def bleed_valve(self) -> Orifice:
        """A bleed valve fully open."""
        return Orifice(area=self.bleed_area, critical_ratio=self.critical_ratio)

    def to_voltage(self, pressure: ArrayLike) -> Floats:
        """Return the reading [V] of a transducer at a gauge pressure [MPa], within the supply."""
        share = self.sensor_zero + self.sensor_span * np.asarray(pressure) / self.sensor_range
        return np.asarray(self.sensor_supply * np.clip(share, 0.0, 1.0))

    def to_pressure(self, voltage: ArrayLike) -> Floats:
        """Return the gauge pressure [MPa] that a reading [V] stands for."""
        share = np.asarray(voltage) / self.sensor_supply - self.sensor_zero
        return np.asarray(share / self.sensor_span * self.sensor_range)

    def find_step(self, chambers: Sequence[Chamber], faults: Sequence[Fault] = ()) -> float:
        """Return the longest time step [s] that resolves the valves and the leaks."""
        leaks = [
            fault.amount / float(chambers[fault.muscle].volume.min())
            for fault in faults
            if fault.kind == "leak"
        ]
        return self._find_step(max(leaks, default=0.0))

    def _find_step(self, leak: float) -> float:
        """Longest step, where `leak` is the largest ratio of a leak's area to its volume [1/mm]."""
        areas = MUSCLES * self.fill_area + self.reservoir_leak_area
        ratio = max(
            max(self.fill_area, self.bleed_area) / max(self.line_volume, 1e-9),
            areas / self.reservoir_volume,
            leak,
        )
        rate = self.exponent * NOZZLE_SPEED * ratio
        return min(LONGEST_STEP, 1.0 / (STEPS_PER_TIME_CONSTANT * rate))

    def pack(self, cell: float) -> tuple[float, ...]:
        """Return the design as the kernel takes it; `cell` is the spacing of the volumes [MPa]."""
        return (
            ATMOSPHERE,
            self.line_volume,
            self.pipette_conductance,
            self.exponent,
            self.fill_area * NOZZLE_SPEED,
            self.bleed_area * NOZZLE_SPEED,
            NOZZLE_SPEED,
            self.critical_ratio,
            self.valve_lag,
            0.5 * self.valve_hysteresis,
            self.valve_dead_zone,
            self.valve_leak,
            self.reservoir_volume,
            self.reservoir_leak_area * NOZZLE_SPEED,
            self.compressor_flow * ATMOSPHERE,
            self.compressor_pressure,
            self.compressor_on,
            self.compressor_off,
            self.sensor_lag,
            cell,
        )

    def format_provenance(self) -> str:
        """Return a table in Markdown: field, value, unit, source of the default."""
        rows = ["| constant | default | unit | source |", "|---|---|---|---|"]
        for name, known in list_quantities(type(self)).items():
            words = f"`{name}`: {known.help[:1].lower()}{known.help[1:].rstrip('.')}"
            rows.append(f"| {words} | {getattr(self, name):.6g} | {known.unit} | {known.source} |")
        return "\n".join(rows)


CHAMBER_PRESSURE = 1.2
"""Gauge pressure up to which a muscle is tabulated [MPa]; beyond it nothing changes."""
CHAMBER_POINTS = 241
"""Rows of that table."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Chamber(ClosedForm):
    """A muscle as the plant sees it: volume and contraction over gauge pressure, under its load.

    Each pressure has one volume and one contraction: the muscle is in equilibrium with its load
    at all times. Mass, damping and hysteresis of the muscle are not in it.

    Attributes
    ----------
    pressure : (n,) ndarray
        Evenly spaced gauge pressures from 0 [MPa].
    volume : (n,) ndarray
        Volume of air in the muscle [mm^3].
    contraction : (n,) ndarray
        How much shorter than at rest the muscle is [mm].

    Raises
    ------
    InputError
        If the pressures are not evenly spaced from 0, or a volume is not positive or shrinks as
        the pressure rises by more than a gas does.
    """

    pressure: Floats = measured("MPa")
    volume: Floats = measured("mm^3")
    contraction: Floats = measured("mm")

    def __post_init__(self) -> None:
        over, volume, _ = (self._take(name) for name in ("pressure", "volume", "contraction"))
        steps = np.diff(over)
        even = over.size > 1 and over[0] == 0.0 and steps[0] > 0.0
        if not even or not np.allclose(steps, steps[0], rtol=1e-6):
            raise InputError("the pressures of a chamber must begin at 0 and be evenly spaced")
        check_range("chamber volume", volume, 1e-6, 1e9, "mm^3")
        # Pressure times volume must grow with pressure; the exponent makes it stricter.
        capacity = volume[:-1] + HEAT_RATIO * (over[:-1] + ATMOSPHERE) * np.diff(volume) / steps
        if not np.all(capacity > 0.0):
            index = int(np.argmin(capacity))
            raise InputError(
                f"chamber volume falls too fast above {over[index]:g} MPa: a volume may shrink "
                "only more slowly than that of an enclosed gas"
            )

    def _take(self, name: str) -> Floats:
        values = np.array(check_array(f"chamber {name}", getattr(self, name)))
        if values.ndim != 1 or not np.all(np.isfinite(values)) or values.size != len(self.pressure):
            raise InputError(
                f"chamber {name} must be as many finite numbers as there are pressures"
            )
        values.flags.writeable = False
        object.__setattr__(self, name, values)
        return values

    @classmethod
    def from_model(cls, model: MuscleModel, load: float = 0.0) -> Chamber:
        """Return the chamber of a muscle that holds a load [N].

        The volume is `model.volume` where the model has it, plus the bore over the dead length.
        Otherwise it is that of the braid less that of the wall, which is incompressible, and below
        the dead band in between this and the bore at rest. Where the model has no answer at low
        pressures, the muscle stays as it is at the lowest that has one.

        Raises
        ------
        InputError
            If the model has no answer at `CHAMBER_PRESSURE`, or the load is not legal.
        """
        over = np.linspace(0.0, CHAMBER_PRESSURE, CHAMBER_POINTS)
        first = _find_lowest(model, over, load)
        held = np.maximum(over, over[first])
        contraction = model.contraction(held, load)
        if hasattr(model, "volume"):
            bore = math.pi * model.muscle.inner_radius**2
            volume = model.volume(held, load) + bore * model.muscle.dead_length
        else:
            volume = _estimate_volume(model, over, contraction)
        return cls(pressure=over, volume=volume, contraction=contraction)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the volume over the pressure, and return the axes."""
        axes = take_axes(ax, x="pressure [kPa]", y="volume [mm³]")
        axes.plot(1e3 * self.pressure, self.volume)
        return axes


def _find_lowest(model: MuscleModel, over: Floats, load: float) -> int:
    """Return the index of the lowest pressure from which on a model has an answer."""

    def answers(index: int) -> bool:
        try:
            model.contraction(over[index:], load)
        except InputError:
            return False
        return True

    model.contraction(over[-1], load)  # without an answer there it is an error
    low, high = -1, over.size - 1
    if answers(0):
        return 0
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if answers(middle) else (middle, high)
    return high


def _estimate_volume(model: MuscleModel, over: Floats, contraction: Floats) -> Floats:
    """Return the volume of a braid less its wall [mm^3]; less below the dead band."""
    muscle = model.muscle
    rest = math.pi * muscle.inner_radius**2 * muscle.length
    length = np.clip(muscle.length - contraction, 0.0, muscle.braid.strand_length)
    full = muscle.braid.volume_at(length) - muscle.tube.wall_area * muscle.length
    band = float(model.dead_band())
    share = np.minimum(over / band, 1.0) if band > 0.0 else 1.0
    return np.asarray(np.maximum(rest + share * (full - rest), 0.02 * rest))


FaultKind = Literal["sensor open", "sensor short", "valve stuck", "leak", "line blocked"]
FAULT_KINDS: tuple[FaultKind, ...] = get_args(FaultKind)


@dataclass(frozen=True)
class Fault(Shown):
    """One fault of the plant.

    Parameters
    ----------
    kind : str
        ``"sensor open"``: the input is pulled up to the supply. ``"sensor short"``: it is at 0 V.
        ``"valve stuck"``: the fill valve stays at an opening whatever its duty is. ``"leak"``: from
        the muscle to the surroundings. ``"line blocked"``: no air passes the pipette.
    muscle : int
        Index of the muscle, 0 to 2.
    amount : float
        Opening of a stuck valve, 0 to 1; effective area of a leak, 0 to 10 mm^2; without meaning
        for other kinds.

    Raises
    ------
    InputError
        If a value is not legal.
    """

    kind: FaultKind
    muscle: int
    amount: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in FAULT_KINDS:
            raise InputError(f"fault is {self.kind!r}: it must be one of {', '.join(FAULT_KINDS)}")
        check_integer("faulty muscle", self.muscle, low=0, high=MUSCLES - 1)
        if self.kind == "valve stuck":
            check_number("opening of the stuck valve", self.amount, low=0.0, high=1.0)
        elif self.kind == "leak":
            check_number("area of the leak", self.amount, low=0.0, high=10.0, unit="mm^2")


class Plant:
    """The plant through time; its state is its own, `copy` makes another.

    Parameters
    ----------
    muscles : MuscleModel or Chamber, or sequence of three
        The muscles; one stands for three alike. A model is taken without load; for another,
        `Chamber.from_model`.
    design : PlantDesign, optional
        The constants.
    seed : int
        Seed of the transducers' noise.

    Attributes
    ----------
    stick_voltages : (2,) ndarray
        Voltages of the thumb-stick, x and y [V]; to be set.
    time : float
        Time since the beginning [s].

    Raises
    ------
    InputError
        If there are not one or three muscles, or the seed is no whole number of 0 or more.
    """

    def __init__(
        self,
        muscles: MuscleModel | Chamber | Sequence[MuscleModel | Chamber],
        design: PlantDesign | None = None,
        *,
        seed: int = 0,
    ) -> None:
        given = list(muscles) if isinstance(muscles, Sequence) else [muscles] * MUSCLES
        if len(given) != MUSCLES:
            raise InputError(f"there are {len(given)} muscles: give one, or {MUSCLES}")
        made = {id(m): m if isinstance(m, Chamber) else Chamber.from_model(m) for m in given}
        self.chambers = tuple(made[id(muscle)] for muscle in given)
        cells = {chamber.pressure[1] for chamber in self.chambers}
        sizes = {chamber.pressure.size for chamber in self.chambers}
        if len(cells) > 1 or len(sizes) > 1:
            raise InputError("the chambers must have the same pressures")
        self.design = design or PlantDesign()
        self.stick_voltages = np.full(2, STICK_CENTRE)
        self.time = 0.0
        self._random = np.random.default_rng(check_integer("seed", seed, low=0))
        self._volumes = np.array([chamber.volume for chamber in self.chambers])
        self._packed = tuple(map(float, self.design.pack(cells.pop())))
        self._channels = np.zeros((MUSCLES, kernels.CHANNEL_COLUMNS))
        self._channels[:, [kernels.LINE, kernels.MUSCLE]] = ATMOSPHERE
        start = self.design.reservoir_pressure
        self._supply = np.zeros(kernels.SUPPLY_COLUMNS)
        self._supply[kernels.RESERVOIR] = start + ATMOSPHERE
        self._supply[kernels.RESERVOIR_SENSOR] = start
        self._supply[kernels.SUPPLY_SPOOL] = 1.0
        self.set_faults()
        self._draw_noise()

    def set_faults(self, *faults: Fault) -> None:
        """Let these be the faults from now on, and no others."""
        self.faults = faults
        self._step = self.design.find_step(self.chambers, faults)
        if self._step < SHORTEST_STEP:
            raise InputError(
                "a leak is so wide for its muscle that steps would be shorter than "
                f"{SHORTEST_STEP:g} s: give a smaller area"
            )
        table = np.tile([-1.0, 0.0, 1.0], (MUSCLES, 1))
        for fault in faults:
            column, value = {
                "valve stuck": (kernels.STUCK, fault.amount),
                "leak": (kernels.LEAK, fault.amount),
                "line blocked": (kernels.LINE_OPEN, 0.0),
            }.get(fault.kind, (None, 0.0))
            if column is not None:
                table[fault.muscle, column] = value
        self._faults = table

    def step(self, duty: ArrayLike, duration: float) -> None:
        """Move on in time under duties of the valves.

        Parameters
        ----------
        duty : array_like, shape (6,) or (7,)
            Duties in [0, 1], averaged over the duration: fill 1 to 3, bleed 1 to 3, and that of a
            valve between reservoir and fill valves, which is open without it.
        duration : float
            Time to move on by, in (0, 3600] s.

        Raises
        ------
        InputError
            If a value is outside its legal range.
        """
        duties = check_array("duty", duty)
        if duties.shape == (2 * MUSCLES,):
            duties = np.append(duties, 1.0)
        if duties.shape != (2 * MUSCLES + 1,):
            legal = f"({2 * MUSCLES},) or ({2 * MUSCLES + 1},)"
            raise InputError(f"duty has shape {duties.shape}: it must be {legal}")
        check_range("duty", duties, 0.0, 1.0, slack=1e-9)
        span = check_number("duration", duration, low=0.0, low_open=True, high=3600.0, unit="s")
        count = math.ceil(span / self._step - 1e-9)
        kernels.advance(
            self._channels,
            self._supply,
            duties,
            self._faults,
            self._volumes,
            self._packed,
            count,
            span / count,
        )
        self.time += span
        self._draw_noise()

    def _draw_noise(self) -> None:
        self._noise = self._random.normal(0.0, self.design.sensor_noise, MUSCLES + 1)

    def sensor_voltages(self) -> Floats:
        """Return what the board's inputs see [V]: muscle 1 to 3, reservoir, stick x and y.

        The noise of a reading is drawn once a step.
        """
        channels = self._channels[:, kernels.SENSOR]
        read = np.append(channels, self._supply[kernels.RESERVOIR_SENSOR])
        voltages = self.design.to_voltage(read + self._noise)
        for fault in self.faults:
            if fault.kind == "sensor open":
                voltages[fault.muscle] = self.design.sensor_supply
            elif fault.kind == "sensor short":
                voltages[fault.muscle] = 0.0
        return np.concatenate([voltages, self.stick_voltages])

    def set_pressures(self, pressures: ArrayLike) -> None:
        """Put lines, muscles and transducers at gauge pressures, shape () or (3,) [MPa].

        Raises
        ------
        InputError
            If a pressure is not in [0, 2] MPa.
        """
        given = check_array("pressures", pressures)
        check_range("pressures", given, 0.0, 2.0, "MPa")
        self._channels[:, kernels.LINE] = given + ATMOSPHERE
        self._channels[:, kernels.MUSCLE] = given + ATMOSPHERE
        self._channels[:, kernels.SENSOR] = given

    @property
    def pressures(self) -> Floats:
        """Gauge pressures in the muscles, shape (3,) [MPa]."""
        return np.asarray(self._channels[:, kernels.MUSCLE] - ATMOSPHERE)

    @property
    def line_pressures(self) -> Floats:
        """Gauge pressures in the lines, where the transducers are, shape (3,) [MPa]."""
        return np.asarray(self._channels[:, kernels.LINE] - ATMOSPHERE)

    @property
    def reservoir_pressure(self) -> float:
        """Gauge pressure in the reservoir [MPa]."""
        return float(self._supply[kernels.RESERVOIR] - ATMOSPHERE)

    @property
    def compressor_runs(self) -> bool:
        """Whether the compressor runs."""
        return bool(self._supply[kernels.COMPRESSOR])

    @property
    def contractions(self) -> Floats:
        """Contractions of the muscles, shape (3,) [mm]."""
        pairs = zip(self.pressures, self.chambers, strict=True)
        return np.array([np.interp(p, c.pressure, c.contraction) for p, c in pairs])

    @property
    def gas(self) -> float:
        """Air in reservoir, lines and muscles, as pressure times volume [MPa mm^3]."""
        inside = self._channels[:, kernels.MUSCLE]
        held = [
            np.interp(p - ATMOSPHERE, c.pressure, c.volume)
            for p, c in zip(inside, self.chambers, strict=True)
        ]
        lines = self._channels[:, kernels.LINE].sum() * self.design.line_volume
        reservoir = self._supply[kernels.RESERVOIR] * self.design.reservoir_volume
        return float(reservoir + lines + inside @ np.array(held))

    @property
    def gas_delivered(self) -> float:
        """Air that the compressor has delivered since the beginning [MPa mm^3]."""
        return float(self._supply[kernels.GAS_IN])

    @property
    def gas_lost(self) -> float:
        """Air that has left for the surroundings since the beginning [MPa mm^3]."""
        return float(self._supply[kernels.GAS_OUT])

    def copy(self) -> Plant:
        """Return another plant in the same state, noise included."""
        return copy.deepcopy(self)

"""The plant: against closed forms, conservation, the order of its steps, muscles, faults."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from bozzini.checks import list_quantities
from bozzini.errors import InputError
from bozzini.muscle import EnergyMuscle, ThesisMuscle, preset
from bozzini.muscle.models import MODELS
from bozzini.rig import ATMOSPHERE, Chamber, Fault, Plant, PlantDesign
from bozzini.rig.plant import CHAMBER_POINTS, CHAMBER_PRESSURE, PROVENANCES, VISCOSITY

OVER = np.linspace(0.0, CHAMBER_PRESSURE, CHAMBER_POINTS)
RIGID = Chamber(pressure=OVER, volume=np.full(OVER.size, 15.0), contraction=0.0 * OVER)
IDEAL = PlantDesign(
    valve_lag=0.0, valve_hysteresis=0.0, valve_dead_zone=0.0, valve_leak=0.0, sensor_noise=0.0,
    sensor_lag=0.0, reservoir_volume=1e9, compressor_flow=0.0, pipette_length=0.0,
    reservoir_pressure=0.827,
)  # fmt: skip
VOLUME = IDEAL.line_volume + 15.0
FILL, BLEED = np.eye(6)[0], np.eye(6)[3]


@pytest.fixture(scope="module")
def energy_chamber():
    return Chamber.from_model(EnergyMuscle(preset("fitted-45")))


def time_to(plant, pressure, duty, *, step=1e-4):
    """Return when the first muscle crosses a pressure, between two steps linearly."""
    before = plant.pressures[0]
    rising = before < pressure
    while True:
        plant.step(duty, step)
        now = plant.pressures[0]
        if (now >= pressure) == rising:
            return plant.time - step * (now - pressure) / (now - before)
        before = now


def fill_and_vent(step):
    """Return times to 90 % and from the supply to 20 kPa over those of the closed forms."""
    plant = Plant(RIGID, IDEAL)
    fill = time_to(plant, 0.9 * 0.827, FILL, step=step) / float(
        IDEAL.fill_valve.fill_time(VOLUME, 0.827, end=0.9 * 0.827)
    )
    plant = Plant(RIGID, IDEAL)
    plant.set_pressures(0.827)
    vent = time_to(plant, 0.02, BLEED, step=step) / float(
        IDEAL.bleed_valve.vent_time(VOLUME, 0.827, end=0.02)
    )
    return np.array([fill, vent])


def test_steps_agree_with_the_closed_forms_to_first_order() -> None:
    errors = np.array([fill_and_vent(step) - 1.0 for step in (1e-4, 5e-5, 2.5e-5)])
    assert np.abs(errors).max() < 5e-3
    ratios = np.abs(errors[:-1] / errors[1:])
    assert ratios.ravel() == pytest.approx([2.0] * 4, rel=0.1)


def test_adiabatic_air_is_faster_by_its_exponent() -> None:
    design = dataclasses.replace(IDEAL, exponent=1.4)
    quick = time_to(Plant(RIGID, design), 0.7, FILL)
    slow = time_to(Plant(RIGID, IDEAL), 0.7, FILL)
    assert slow / quick == pytest.approx(1.4, rel=5e-3)


def test_air_is_conserved_by_moving_muscles(energy_chamber) -> None:
    plant = Plant(energy_chamber, seed=1)
    random = np.random.default_rng(3)
    before = plant.gas
    moved = 0.0
    for _ in range(500):
        held = plant.pressures @ np.full(3, 430.0)
        plant.step(random.uniform(0.0, 1.0, 6), 1e-3)
        moved += abs(plant.pressures @ np.full(3, 430.0) - held)
    error = plant.gas - before - plant.gas_delivered + plant.gas_lost
    assert plant.gas_lost > 100.0
    assert abs(error) < 5e-4 * (plant.gas_lost + moved)


def test_compressor_keeps_the_reservoir_in_its_band() -> None:
    # Free air of 0.2 L/min leaves through this area at a gauge pressure of 0.89 MPa.
    area = 0.2e6 / 60.0 * ATMOSPHERE / (198_630.0 * (0.89 + ATMOSPHERE))
    plant = Plant(RIGID, PlantDesign(reservoir_leak_area=area, reservoir_volume=1e5))
    seen, runs = [], []
    for _ in range(600):
        plant.step(np.zeros(6), 0.1)
        seen.append(plant.reservoir_pressure)
        runs.append(plant.compressor_runs)
    starts = np.flatnonzero(np.diff(np.array(runs, dtype=int)) == 1)
    stops = np.flatnonzero(np.diff(np.array(runs, dtype=int)) == -1)
    assert starts.size >= 1 and stops.size >= 1
    late = np.array(seen)[starts[0] :]
    assert late.min() == pytest.approx(0.850, abs=1e-3)
    assert late.max() == pytest.approx(0.930, abs=1e-3)


def test_muscle_takes_its_own_volume_besides_that_of_the_line(energy_chamber) -> None:
    plant = Plant(energy_chamber, IDEAL)
    before = plant.gas
    plant.step(FILL, 0.2)
    model = EnergyMuscle(preset("fitted-45"))
    bore = math.pi * 0.25**2 * 11.7
    inside = plant.pressures[0]
    expected = (inside + ATMOSPHERE) * (IDEAL.line_volume + float(model.volume(inside)) + bore)
    expected -= ATMOSPHERE * (IDEAL.line_volume + float(model.volume(0.0)) + bore)
    reservoir = IDEAL.reservoir_volume * (plant.reservoir_pressure - 0.827)
    assert plant.gas - before - reservoir == pytest.approx(expected, rel=1e-3)
    assert plant.contractions[0] == pytest.approx(float(model.contraction(inside)), abs=0.01)


def test_growing_muscle_fills_more_slowly_than_a_rigid_one_of_its_smallest_volume() -> None:
    grown = Chamber(pressure=OVER, volume=50.0 + 500.0 * OVER, contraction=OVER)
    small, large = (
        Chamber(pressure=OVER, volume=np.full(OVER.size, v), contraction=OVER)
        for v in (50.0, 50.0 + 500.0 * CHAMBER_PRESSURE)
    )
    times = [time_to(Plant(c, IDEAL), 0.7, FILL) for c in (small, grown, large)]
    assert times[0] < times[1]
    # Choked, the air that enters is flow times time: p V at the end less p V at the beginning.
    choked = time_to(Plant(grown, IDEAL), 0.35, FILL)
    gas = 0.451325 * (IDEAL.line_volume + 225.0) - ATMOSPHERE * (IDEAL.line_volume + 50.0)
    flow = float(IDEAL.fill_valve.flow(0.827, 0.0))
    assert choked == pytest.approx(gas / flow, rel=5e-3)
    assert times[2] > times[0]


@pytest.mark.parametrize(
    "model",
    [EnergyMuscle(preset("thesis-40")), ThesisMuscle(preset("thesis-40")),
     MODELS["chou"](preset("thesis-40"))],
    ids=lambda model: model.name,
)  # fmt: skip
def test_chamber_of_any_model_begins_near_the_bore(model) -> None:
    load = 0.05 if model.takes_load else 0.0
    chamber = Chamber.from_model(model, load=load)
    bore = math.pi * 0.25**2 * 40.0
    assert 0.8 * bore < chamber.volume[0] < 2.5 * bore
    assert 20.0 < chamber.volume[-1] < 45.0
    assert chamber.contraction[100] == pytest.approx(float(model.contraction(OVER[100], load)))


def test_volume_from_the_braid_is_that_of_the_energy_once_in_contact() -> None:
    muscle = preset("thesis-40")
    energy = Chamber.from_model(EnergyMuscle(muscle))

    class Bare:
        """The same muscle without its volume."""

        def __init__(self):
            model = EnergyMuscle(muscle)
            self.muscle, self.contraction = muscle, model.contraction
            self.dead_band = model.dead_band

    braid = Chamber.from_model(Bare())
    high = OVER > 0.15
    assert braid.volume[high] == pytest.approx(energy.volume[high], rel=1e-6)


def test_pipette_delays_the_muscle_by_its_own_time_constant() -> None:
    wide = dataclasses.replace(IDEAL, pipette_length=30.0, pipette_bore=0.1)
    plant = Plant(RIGID, wide)
    plant.set_pressures(0.5)
    plant.set_faults(Fault("line blocked", 0))
    plant.step(BLEED, 5e-4)
    plant.set_faults()
    before = plant.line_pressures[0] - plant.pressures[0]
    # Poiseuille: 128 mu L V / (pi d^4 p), both ends of the line taken together.
    tau = 128 * 1.82e-11 * 30.0 * 15.0 / (math.pi * 0.1**4 * (0.5 + ATMOSPHERE))
    tau /= 1.0 + 15.0 / wide.line_volume
    plant.step(np.zeros(6), tau)
    after = plant.line_pressures[0] - plant.pressures[0]
    assert abs(before) > 1e-3
    assert after / before == pytest.approx(math.exp(-1.0), rel=0.02)


def test_valve_lags_plays_and_has_a_dead_zone() -> None:
    design = PlantDesign(valve_leak=0.0, sensor_noise=0.0)
    assert Plant(RIGID, design).pressures[0] == 0.0
    plant = Plant(RIGID, design)
    plant.step(0.31 * FILL, 0.5)  # the play takes 0.02 of the 0.31: still shut
    assert plant.pressures[0] == 0.0
    plant.step(0.5 * FILL, 0.2)
    reached = plant.pressures[0]
    assert reached > 0.01
    # Coming from above the play holds the valve open at a duty that did not open it from below.
    plant.step(0.31 * FILL, 0.2)
    assert plant.pressures[0] > reached + 1e-4
    plant.step(np.zeros(6), 0.05)
    held = plant.pressures[0]
    plant.step(np.zeros(6), 0.2)
    assert plant.pressures[0] == held


def test_reading_is_ratiometric_and_its_noise_is_seeded() -> None:
    design = PlantDesign(sensor_lag=0.0)
    plants = [Plant(RIGID, design, seed=seed) for seed in (5, 5, 6)]
    read = []
    for plant in plants:
        plant.set_pressures([0.1, 0.5, 1.0])
        rows = []
        for _ in range(400):
            plant.step(np.zeros(6), 1e-3)
            assert np.array_equal(plant.sensor_voltages(), plant.sensor_voltages())
            rows.append(plant.sensor_voltages())
        read.append(np.array(rows))
    assert np.array_equal(read[0], read[1])
    assert not np.array_equal(read[0], read[2])
    pressures = design.to_pressure(read[0][:, :3])
    assert pressures.mean(axis=0) == pytest.approx([0.1, 0.5, 1.0], abs=5e-4)
    assert pressures[:, 1].std() == pytest.approx(design.sensor_noise, rel=0.15)
    assert design.to_pressure(design.to_voltage(0.3)) == pytest.approx(0.3)
    assert design.to_voltage([0.0, design.sensor_range]) == pytest.approx([0.5, 4.5])


def test_copy_goes_on_as_the_original_does() -> None:
    plant = Plant(RIGID, seed=2)
    plant.step(FILL, 0.01)
    other = plant.copy()
    for each in (plant, other):
        each.step(0.5 * FILL, 0.01)
    assert np.array_equal(plant.sensor_voltages(), other.sensor_voltages())
    other.step(FILL, 0.01)
    assert plant.time != other.time
    assert plant.pressures[0] != other.pressures[0]


def test_faults_do_what_they_say() -> None:
    plant = Plant(RIGID)
    plant.set_pressures(0.5)
    plant.set_faults(Fault("sensor open", 0), Fault("sensor short", 1), Fault("leak", 2, 0.01))
    plant.step(np.zeros(6), 0.1)
    voltages = plant.sensor_voltages()
    assert voltages[0] > 4.75
    assert voltages[1] < 0.25
    assert plant.pressures[2] < plant.pressures[0] - 0.1
    plant.set_faults(Fault("line blocked", 0), Fault("valve stuck", 1, 1.0))
    plant.step(np.concatenate([np.zeros(3), [1.0, 0.0, 0.0]]), 0.3)
    assert plant.pressures[0] == pytest.approx(0.5, abs=1e-3)
    assert plant.line_pressures[0] < 0.05
    assert plant.pressures[1] > 0.8
    plant.set_faults()
    plant.step(np.concatenate([np.zeros(3), np.ones(3)]), 1.0)
    assert plant.pressures.max() < 0.01


@pytest.mark.parametrize(
    ("bleed_area", "opening"), [(IDEAL.fill_area, 0.5), (IDEAL.bleed_area, 0.84)]
)
def test_stuck_fill_valve_leaves_the_choked_balance(bleed_area, opening) -> None:
    # Both choked: the muscle's absolute pressure is the supply's times the ratio of the areas.
    plant = Plant(RIGID, dataclasses.replace(IDEAL, bleed_area=bleed_area))
    plant.set_faults(Fault("valve stuck", 0, opening))
    plant.step(BLEED, 2.0)
    left = opening * IDEAL.fill_area / bleed_area * 0.928325
    assert plant.pressures[0] + ATMOSPHERE == pytest.approx(left, rel=1e-3)


def test_supply_valve_shuts_off_a_stuck_fill_valve() -> None:
    plant = Plant(RIGID, IDEAL)
    plant.set_faults(Fault("valve stuck", 0, 1.0))
    plant.step(np.append(BLEED, 1.0), 1.0)
    assert plant.pressures[0] > 0.2
    plant.step(np.append(BLEED, 0.0), 1.0)
    assert plant.pressures[0] < 0.01
    other = Plant(RIGID, IDEAL)
    without = Plant(RIGID, IDEAL)
    other.step(np.append(FILL, 1.0), 0.02)
    without.step(FILL, 0.02)
    assert np.array_equal(other.pressures, without.pressures)


def test_every_constant_has_a_source() -> None:
    known = list_quantities(PlantDesign)
    assert set(known) == {field.name for field in dataclasses.fields(PlantDesign)}
    for item in known.values():
        assert item.source.split(":")[0].startswith(PROVENANCES)
        assert item.help
    table = PlantDesign().format_provenance()
    assert table.count("\n") == len(known) + 1


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: PlantDesign(valve_lag=-1.0), "plant valve lag is -1"),
        (lambda: PlantDesign(compressor_off=0.5), "plant compressor off is 0.5"),
        (lambda: PlantDesign(dead_volume=0.0, tube_length=0.0), "must be at least"),
        (lambda: Fault("fire", 0), "fault is 'fire'"),
        (lambda: Fault("leak", 3), "faulty muscle is 3"),
        (lambda: Fault("valve stuck", 0, 2.0), "opening of the stuck valve is 2"),
        (lambda: Plant([RIGID, RIGID]), "2 muscles"),
        (lambda: Plant(RIGID).step(np.zeros(8), 1.0), "duty has shape"),
        (lambda: Plant(RIGID).step(np.full(6, 1.5), 1.0), "is 1.5"),
        (lambda: Plant(RIGID).step(np.zeros(6), 0.0), "duration is 0"),
        (lambda: Plant(RIGID).set_pressures(5.0), "pressures is 5"),
        (lambda: Plant(RIGID).set_faults(Fault("leak", 0, 10.0)), "smaller area"),
        (lambda: Chamber(pressure=OVER + 1.0, volume=OVER + 1.0, contraction=OVER), "begin at 0"),
        (lambda: Chamber(pressure=OVER, volume=OVER, contraction=OVER), "chamber volume"),
        (lambda: Chamber(pressure=OVER, volume=300.0 - 200.0 * OVER, contraction=OVER),
         "falls too fast"),
    ],
)  # fmt: skip
def test_wrong_input_is_one_line(call, words) -> None:
    with pytest.raises(InputError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_flow_of_the_pipette_is_that_of_slices_in_a_row() -> None:
    """Poiseuille's law for each short slice; the pV flow is the same in all of them."""
    design = PlantDesign(pipette_length=30.0, pipette_bore=0.3)
    upstream, downstream = 0.5 + ATMOSPHERE, ATMOSPHERE
    flow = design.pipette_conductance * (upstream**2 - downstream**2)
    slices, pressure = 20_000, upstream
    resistance = 128.0 * VISCOSITY * design.pipette_length / (math.pi * design.pipette_bore**4)
    for _ in range(slices):
        pressure -= resistance / slices * flow / pressure
    assert pressure == pytest.approx(downstream, rel=1e-3)
    twice = PlantDesign(pipette_length=60.0, pipette_bore=0.3).pipette_conductance
    assert twice == pytest.approx(0.5 * design.pipette_conductance)
    assert math.isinf(PlantDesign(pipette_length=0.0).pipette_conductance)

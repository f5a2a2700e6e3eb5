"""From a record to an operator that a model carries, and to pressures that undo the hysteresis."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.errors import FileFormatError, InputError
from bozzini.muscle.ends import EndEffects, MountedMuscle
from bozzini.muscle.hysteresis import (
    GeneralisedPrandtlIshlinskii,
    MonotoneCurve,
    PrandtlIshlinskii,
)
from bozzini.muscle.hysteresis.operator import fit_linear
from bozzini.muscle.loops import (
    OPERATORS,
    LoopFitOptions,
    LoopModel,
    LoopRecord,
    fit_loop,
    load_loop_model,
    save_loop_model,
)
from tests.muscle.hysteresis.reference import OPERATORS as REFERENCE
from tests.muscle.loops.plants import (
    DRIFT,
    LOAD,
    NOISE,
    STATIC,
    TIME,
    TURNS,
    Plant,
    drift,
    make_record,
    make_relays,
)

LOG = LoopFitOptions(drift="log", samples=600)
PLAYS = PrandtlIshlinskii((0.0, 0.05, 0.1), (0.6, 0.2, 0.15))


@pytest.fixture(scope="module")
def relays():
    return Plant(make_relays())


@pytest.fixture(scope="module")
def measured(relays):
    return make_record(relays)


@pytest.mark.parametrize("name", OPERATORS)
def test_every_operator_can_be_carried_at_once(name, measured):
    """The record is asymmetric, off by 0.8 mm, drifts, and does not start at rest."""
    record, pressure, _ = measured
    fit = fit_loop(record, name, static=STATIC, options=LOG)
    up = np.linspace(0.0, 0.7, 40)
    for history in (pressure[::20], np.concatenate([up, up[::-1], 0.5 * up])):
        traced = fit.model.carry().trace_contraction(history, LOAD)
        assert np.all(np.isfinite(traced))
        assert fit.model.trace(history) - fit.model.offset == pytest.approx(traced, abs=1e-9)
    assert fit.model.operator.apply([0.0])[0] == pytest.approx(0.0, abs=1e-12)
    assert any("does not start at rest, but at" in note for note in fit.notes)
    assert fit.to_dict()["rms_mm"]["fitted"] == fit.deviation
    assert set(fit.parts) >= {"fitted", "rising", "falling", "before the first maximum"}


@pytest.mark.parametrize("static", [None, STATIC], ids=["alone", "carried"])
def test_maxwell_slips_are_the_plays_of_the_same_loop(static, measured):
    """What slips leave of the pressure is a sum of plays: two classes, one answer."""
    record, pressure, shown = measured
    slips, plays = (
        fit_loop(record, name, static=static, options=LOG).model
        for name in ("maxwell-slip", "prandtl-ishlinskii")
    )
    history = pressure[::20]
    assert slips.trace(history) == pytest.approx(plays.trace(history), abs=1e-9)
    found, same = (model.compensate(shown[::20]).pressure for model in (slips, plays))
    assert found == pytest.approx(same, abs=1e-6)
    friction = slips.operator.slope * history - slips.operator.apply(history)
    assert friction == pytest.approx(slips.operator.slips.apply(history), abs=1e-12)


def test_bent_plays_leave_little_more_than_the_noise(measured):
    record, _, _ = measured
    fit = fit_loop(record, static=STATIC, options=LOG)
    assert fit.converged and fit.deviation < 1.5 * NOISE
    plain = fit_loop(record, "prandtl-ishlinskii", static=STATIC, options=LOG)
    assert plain.deviation > 5.0 * fit.deviation
    assert np.sqrt(np.mean(fit.residual[fit.skipped :] ** 2)) == pytest.approx(fit.deviation)
    assert any("a drift of" in note for note in fit.notes)
    assert fit.plot().get_xlabel() == "pressure [kPa]"


def follow(plant, pressure, before, time):
    """What the sensor shows while the plant goes on with other pressures."""
    return plant.run(np.concatenate([before, pressure]))[len(before) :] + drift(time)


def invert_mean(record, wanted):
    """Pressures by the mean curve of the record, both branches together."""
    edges = np.linspace(0.0, 0.7, 40)
    place = np.digitize(record.pressure, edges)
    mean = [record.response[place == i].mean() for i in range(1, 40)]
    return np.interp(wanted, np.maximum.accumulate(mean), 0.5 * (edges[1:] + edges[:-1]))


@pytest.mark.parametrize("static", [None, STATIC], ids=["alone", "carried"])
def test_compensation_of_the_held_out_part_is_five_times_better(static, relays, measured):
    """The plant is one of relays with a drift, the operator bent plays."""
    record, pressure, shown = measured
    cut = 2100
    fit = fit_loop(record.take(slice(cut)), static=static, options=LOG)
    wanted, time = shown[cut:], record.time[cut:]
    found = fit.model.compensate(wanted, resume=True)
    error, plain = (
        np.sqrt(np.mean((follow(relays, x, pressure[:cut], time) - wanted) ** 2))
        for x in (found.pressure, invert_mean(record.take(slice(cut)), wanted))
    )
    assert plain > 5.0 * error
    assert found.pressure == pytest.approx(pressure[cut:], abs=0.02)  # those that were applied
    # the held-out part is judged by the fit as well
    held = fit_loop(
        record, static=static, options=LoopFitOptions(drift="log", samples=600, hold_out=0.3)
    )
    assert held.parts["held out"] < 3.0 * NOISE


def test_the_true_operator_is_found_with_offset_and_drift():
    record, _, _ = make_record(Plant(PLAYS))
    fit = fit_loop(record, "prandtl-ishlinskii", static=STATIC, options=LOG)
    assert fit.deviation < 1.2 * NOISE
    assert fit.drift == pytest.approx(DRIFT, abs=0.15)
    # the same output, though other thresholds were tried
    other = np.abs(0.7 * np.sin(np.linspace(0.0, 12.0, 200)))
    found = fit.model.trace(other) - fit.model.offset
    truth = STATIC.contraction(PLAYS.apply(other), LOAD)
    assert np.std(found - truth) < 0.1


def test_resampling_changes_little():
    """Faster records, other counts and other speeds: the same slopes of the virgin curve."""
    slopes = []
    for count, samples in ((1500, 400), (6000, 400), (6000, 1500)):
        record, _, _ = make_record(Plant(PLAYS), count=count)
        options = LoopFitOptions(drift="log", samples=samples)
        fit = fit_loop(record, "prandtl-ishlinskii", options=options, static=STATIC)
        slopes.append(fit.model.operator.load_virgin(np.linspace(0.0, 0.35, 8)))
    assert np.ptp(slopes, axis=0).max() < 0.04 * 0.35
    # at another speed all along, without noise and drift
    time = np.linspace(0.0, 1.0, 2000)
    pressure = np.interp(time, np.linspace(0.0, 1.0, len(TURNS) + 1), (0.0, *TURNS))
    response = PLAYS.apply(pressure)
    none = LoopFitOptions(drift="none", samples=100_000)
    even, odd = (
        fit_loop(
            LoopRecord(time=when, pressure=pressure, response=response), "prandtl-ishlinskii",
            options=none,
        )
        for when in (time, time**3 + 0.1 * time)
    )  # fmt: skip
    assert even.model.operator.weights == pytest.approx(odd.model.operator.weights, abs=1e-9)


def test_a_static_model_that_is_the_identity_changes_nothing(measured):
    """Two routes: the response fitted by itself, and through a static curve of slope 1."""
    record, _, _ = measured

    class Line(type(STATIC)):
        def contraction(self, pressure, load=0.0, *, direction=None):
            return np.asarray(pressure, dtype=float)

    alone = fit_loop(record, "prandtl-ishlinskii", options=LOG)
    line = Line(STATIC.muscle)
    scaled = LoopRecord(
        time=record.time, pressure=record.pressure, response=record.response / 20.0, held=LOAD
    )
    carried = fit_loop(scaled, "prandtl-ishlinskii", static=line, options=LOG)
    assert np.array(alone.model.operator.weights) == pytest.approx(
        20.0 * np.array(carried.model.operator.weights), abs=1e-6
    )
    assert alone.drift == pytest.approx(20.0 * carried.drift, abs=1e-6)


def test_forces_are_fitted_as_contractions_are():
    pressure = np.interp(np.linspace(0, 1, 800), np.linspace(0, 1, 6), [0, 0.7, 0.1, 0.6, 0, 0.5])
    force = STATIC.force(PLAYS.apply(pressure), 1.0) + 0.2
    record = LoopRecord(
        time=np.arange(800.0), pressure=pressure, response=force, kind="force", held=1.0
    )
    fit = fit_loop(record, "prandtl-ishlinskii", static=STATIC,
                   options=LoopFitOptions(drift="none"))  # fmt: skip
    assert fit.deviation < 0.01 * fit.span
    assert fit.model.offset == pytest.approx(0.2, abs=0.02 * fit.span)
    assert fit.model.trace(pressure) == pytest.approx(force, abs=0.03 * fit.span)
    found = fit.model.compensate(force[:400])
    assert found.reached == pytest.approx(force[:400], abs=0.03 * fit.span)
    acts = pressure[:400] > 0.2  # below, this muscle is slack at 1 mm
    assert found.pressure[acts] == pytest.approx(pressure[:400][acts], abs=0.02)


def test_warnings_of_drift_and_of_a_first_rise_that_is_another():
    time = np.linspace(0.0, TIME, 1500)
    pressure = np.interp(time, np.linspace(0.0, TIME, 8), [0, 0.7, 0, 0.6, 0.1, 0.7, 0.2, 0.5])
    used = PLAYS.apply([0.7, *pressure])[1:]
    fit = fit_loop(
        LoopRecord(time=time, pressure=pressure, response=20 * used + 0.003 * time),
        options=LoopFitOptions(drift="none", samples=400),
    )
    assert any("hold a part out to see whether a drift predicts it" in note for note in fit.notes)
    drifting = fit_loop(
        LoopRecord(time=time, pressure=pressure, response=20 * PLAYS.apply(pressure) + 0.01 * time),
        options=LoopFitOptions(samples=400),
    )
    assert drifting.drift == pytest.approx(0.01 * TIME, rel=0.02)


def bent():
    curve = MonotoneCurve((0.0, 0.3, 0.7), (0.0, 0.2, 0.65))
    return GeneralisedPrandtlIshlinskii(PLAYS, output=curve)


@settings(max_examples=25, deadline=None)
@given(
    shares=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=25),
    carried=st.booleans(),
    offset=st.floats(-1.0, 1.0),
)
def test_compensated_pressures_reach_what_can_be_reached(shares, carried, offset):
    static = STATIC if carried else None
    model = LoopModel(
        operator=bent(), static=static, held=LOAD, pressures=(0.0, 0.7), offset=offset
    )
    low, high = model.trace([0.0, 0.7])
    wanted = low + (high - low) * np.array(shares)
    found = model.compensate(wanted)
    near = 1e-3 * (high - low)
    miss = found.saturated | (np.abs(found.residual) < near)
    assert miss.all()
    assert found.pressure.min() >= 0.0 and found.pressure.max() <= 0.7
    # from rest it rises to all of these, and only what lags behind a fall is out of reach
    rising = np.sort(wanted)
    assert model.compensate(rising).residual == pytest.approx(0.0, abs=near)
    beyond = model.compensate([high + 1.0, wanted[0]])
    assert beyond.saturated[0] and beyond.pressure[0] == 0.7 and not beyond.converged
    assert "1 of 2" in beyond.reason or "2 of 2" in beyond.reason


KINDS = {"prandtl-ishlinskii": "plays", "friction-band": "band"}


@pytest.mark.parametrize("name", OPERATORS)
def test_files_give_the_model_back(name, tmp_path):
    operator = make_relays(8) if name == "preisach" else REFERENCE[KINDS.get(name, name)]
    history = np.array([0.1, 0.5, 0.3])
    mounted = MountedMuscle(STATIC, EndEffects(offset=0.2, compliance=0.01))
    for static, suffix in ((None, "json"), (STATIC, "yaml"), (mounted, "yml")):
        model = LoopModel(
            operator=operator, static=static, held=LOAD, pressures=(0.1, 0.7), offset=-0.2,
            longest=60.0, state=operator.run([0.4, 0.2])[1],
        )  # fmt: skip
        path = save_loop_model(tmp_path / f"a.{suffix}", model, fit={"any": "words"})
        again = load_loop_model(path)
        assert again.operator == model.operator and again.static == model.static
        assert (again.pressures, again.longest) == (model.pressures, 60.0)
        assert np.array_equal(again.trace(history, resume=True), model.trace(history, resume=True))
        if static is not None:
            carried = again.carry().trace_contraction(history, LOAD)
            assert model.trace(history) == pytest.approx(carried - 0.2, abs=1e-12)


def damage(path, **changes):
    from bozzini.io.records import format_yaml, load_data

    path.write_text(format_yaml({**load_data(path), **changes}))
    return path


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"kind": "bozzini-muscle"}, "it has no 'kind: bozzini-hysteresis'"),
        ({"version": 2}, "version is 2: it must be 1"),
        ({"operator": "springs"}, "there is no operator 'springs'"),
        ({"pressures": [0.5, 0.1]}, "pressures[1] is 0.1 MPa"),
        ({"constants": {}}, "constants has no 'thresholds'"),
        ({"state": {"last": 0.0, "memory": [0.0]}}, "initial has last ()"),
        ({"static": {"model": "energy"}}, "static has no 'muscle'"),
        ({"offset": "x"}, "offset"),
        ({"colour": 1}, "unknown field 'colour'"),
    ],
)
def test_files_refused(tmp_path, changes, words):
    path = save_loop_model(tmp_path / "a.yaml", LoopModel(operator=PLAYS, pressures=(0.0, 0.7)))
    with pytest.raises(FileFormatError) as caught:
        load_loop_model(damage(path, **changes))
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_refused(measured):
    record, _, _ = measured
    with pytest.raises(InputError, match="there is no operator 'springs'"):
        fit_loop(record, "springs")
    with pytest.raises(InputError, match="contraction is 3 all along: it must change"):
        fit_loop(dataclasses.replace(record, response=np.full(len(record.time), 3.0)))
    with pytest.raises(InputError, match="drift is 'cubic'"):
        LoopFitOptions(drift="cubic")
    with pytest.raises(InputError, match="hold out is 1"):
        LoopFitOptions(hold_out=1.0)
    with pytest.raises(InputError, match="there is no static model"):
        LoopModel(operator=PLAYS).carry()
    with pytest.raises(InputError, match="no state of a record"):
        LoopModel(operator=PLAYS).trace([0.1], resume=True)
    with pytest.raises(InputError, match="the operator friction-band has no inverse: fit one of"):
        LoopModel(operator=OPERATORS["friction-band"](-0.1)).compensate([0.1])
    with pytest.raises(InputError, match="highest is 0"):
        LoopModel(operator=PLAYS).compensate([0.1], highest=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("static", [None, STATIC], ids=["alone", "carried"])
@pytest.mark.parametrize("name", OPERATORS)
def test_more_samples_take_no_more_solutions(name, static, relays, monkeypatch):
    """The linear systems that a fit solves become longer, not more: its time is linear in them."""
    solved = []

    def count(*args, **options):
        solved.append(len(args[1]))
        return fit_linear(*args, **options)

    for module in ("operator", "generalised"):
        monkeypatch.setattr(f"bozzini.muscle.hysteresis.{module}.fit_linear", count)
    record, _, _ = make_record(relays)
    numbers = []
    for samples in (250, 1000):
        solved.clear()
        fit_loop(record, name, static=static, options=LoopFitOptions(drift="log", samples=samples))
        assert max(solved) <= samples
        numbers.append(len(solved))
    assert 0 < numbers[1] <= 1.5 * numbers[0] + 5

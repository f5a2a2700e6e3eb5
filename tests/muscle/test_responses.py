"""Force, contraction and pressure: one model, three questions, and fits of each."""

from __future__ import annotations

import dataclasses
import math
import os
import time
from pathlib import Path

import numpy as np
import pandas
import pytest
from scipy.stats import t as student

from bozzini.errors import InputError
from bozzini.muscle import (
    MODELS,
    EndEffects,
    EnergyMuscle,
    FitOptions,
    Measurements,
    MountedMuscle,
    Muscle,
    RankOptions,
    calibrate,
    find_offset,
    predict,
    preset,
    rank,
    read_measurements,
    read_muscle,
    take_measurements,
    write_measurements,
    write_muscle,
)
from bozzini.muscle.problem import FitData, Problem
from bozzini.muscle.ranking import split_pressures, split_specimens
from bozzini.numeric.least_squares import Clock

MUSCLE = Muscle(
    length=120.0,
    outer_radius=5.0,
    inner_radius=4.2,
    braid_angle=math.radians(25.0),
    modulus=1.0,
)
ENDS = EndEffects(offset=0.8, compliance=0.01, slack_force=6.0)
KINDS = ("gaylord-1", "chou", "kothera-balance", "energy", "quadratic-strain")


def make(name, muscle=MUSCLE):
    kind = MODELS[name]
    guess = kind.guess_parameters(muscle) if name == "quadratic-strain" else {}
    return kind(muscle, **guess)


def measure(model, *, lengths=None, noise=0.0, seed=0, specimen=""):
    """Simulate isometric rows: forces at 8 pressures and 5 contractions."""
    pressure = np.tile(np.linspace(0.1, 0.6, 8), 5)
    contraction = np.repeat(np.linspace(0.0, 0.16, 5) * model.muscle.length, 8)
    force = model.force(pressure, contraction)
    error = noise * np.random.default_rng(seed).normal(size=force.size)
    return Measurements(
        pressure=pressure,
        contraction=contraction,
        load=force + error,
        specimen=specimen,
        geometry={"length": model.muscle.length} if specimen else {},
    )


def join(*tables):
    columns = {
        name: np.concatenate([getattr(table, name) for table in tables])
        for name in ("pressure", "contraction", "load", "specimen")
    }
    lengths = np.concatenate([table.geometry["length"] for table in tables])
    return Measurements(**columns, geometry={"length": lengths})


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("ends", [EndEffects(), ENDS])
def test_pressure_is_the_inverse_of_force(name, ends):
    model = ends.mount(make(name))
    pressure = np.linspace(0.2, 0.6, 5)[:, None]
    contraction = np.array([1.0, 4.0, 9.0])
    force = model.force(pressure, contraction)
    taut = force > 10.0
    found, held = model.try_pressure(force, MUSCLE.length - contraction)
    assert held[taut].all()
    assert found[taut] == pytest.approx((pressure + 0.0 * contraction)[taut], rel=1e-9)
    with pytest.raises(InputError, match="no pressure in"):
        model.pressure(1e7, MUSCLE.length)


def test_pressure_along_a_branch_of_friction():
    model = EnergyMuscle(MUSCLE.replace(friction_length=0.05))
    for direction in ("inflating", "deflating"):
        force = model.force(0.4, 5.0, direction=direction)
        found = model.pressure(force, MUSCLE.length - 5.0, direction=direction)
        assert found == pytest.approx(0.4, rel=1e-9)


@pytest.mark.parametrize("name", KINDS)
def test_what_is_tried_is_what_is_asked(name):
    """Where there is an answer it is that of `force` and `contraction`; elsewhere these refuse."""
    model = make(name)
    contraction = np.array([-200.0, -1.0, 0.0, 10.0, 119.0])
    force, held = model.try_force(0.3, contraction)
    for x, f, good in zip(contraction, force, held, strict=True):
        if good:
            assert f == pytest.approx(float(model.force(0.3, x)), rel=1e-12, abs=1e-9)
        else:
            with pytest.raises(InputError):
                model.force(0.3, x)
    load = np.array([-1.0, 0.0, 20.0, 1e7])
    answers, held = model.try_contraction(0.3, load)
    assert held[1] and not held[0] and not held[3]
    for load_, x, good in zip(load, answers, held, strict=True):
        if good:
            assert x == pytest.approx(float(model.contraction(0.3, load_)), rel=1e-9)


@pytest.mark.parametrize("name", KINDS)
def test_a_mounted_muscle_answers_its_own_questions(name):
    """Force and contraction are inverse, and the stiffness is the slope of the force."""
    own = make(name)
    model = ENDS.mount(own)
    load = np.array([20.0, 50.0, 90.0])
    contraction = model.contraction(0.5, load)
    assert contraction == pytest.approx(own.contraction(0.5, load) + 0.8 - 0.01 * load)
    assert model.force(0.5, contraction) == pytest.approx(load, rel=1e-9)
    step = 1e-4
    slope = (model.force(0.5, contraction - step) - model.force(0.5, contraction + step)) / 2e-4
    assert model.stiffness(0.5, contraction) == pytest.approx(slope, rel=1e-4)
    state = model.solve(0.5, load)
    assert state.contraction == pytest.approx(contraction)
    assert state.length == pytest.approx(MUSCLE.length - contraction)
    slack = float(model.contraction(0.5)) + 2.0
    assert float(model.force(0.5, slack)) == 6.0
    assert float(model.stiffness(0.5, slack)) == 0.0


@pytest.mark.parametrize("name", ["energy", "ogden", "gaylord-1"])
def test_fittings_that_give_answer_where_the_muscle_alone_could_not_be_so_long(name):
    own = make(name)
    load = np.linspace(50.0, 400.0, 8)
    model = EndEffects(compliance=0.05).mount(own)
    contraction, held = model.try_contraction(0.5, load)
    assert (contraction[held] < own.contraction_limits[0]).any()
    assert model.force(0.5, contraction[held]) == pytest.approx(load[held], rel=1e-9)


def test_a_muscle_that_gets_longer_is_tried_under_a_push():
    model = MODELS["gaylord-1"](MUSCLE.replace(braid_angle=math.radians(68.0)))
    load = np.array([-5.0, 0.0, 2.0])
    contraction, held = model.try_contraction(0.3, load)
    assert held.all()
    assert contraction == pytest.approx(model.contraction(0.3, load))


@pytest.mark.parametrize("response", ["force", "contraction"])
def test_muscles_that_only_push_are_read_and_ranked(response, tmp_path):
    muscle = MUSCLE.replace(braid_angle=math.radians(68.0))
    truth = MODELS["ogden"](muscle)
    pressure, contraction = np.tile(np.linspace(0.05, 0.3, 8), 3), np.repeat([0.0, -2.0, -4.0], 8)
    load = truth.force(pressure, contraction)
    assert load.max() < 0.0
    data = Measurements(pressure=pressure, contraction=contraction, load=load)
    path = write_measurements(tmp_path / "push.csv", data)
    with pytest.raises(InputError, match="turn the sign"):
        read_measurements(path, muscle=MUSCLE)
    data = read_measurements(path, muscle=muscle)
    models = ("gaylord-1", "ogden")
    options = RankOptions(fields=("modulus",), folds=0, fit=FitOptions(response=response))
    best = rank(data, muscle.replace(modulus=1.5), models=models, options=options).models[0]
    assert best.name == "ogden"
    assert best.calibration.estimates["modulus"] == pytest.approx(1.0, rel=1e-6)


def test_end_effects_of_none_are_none():
    own = make("chou")
    assert EndEffects().mount(own) is own
    pressure, contraction = np.linspace(0.1, 0.6, 7), np.linspace(0.0, 9.0, 7)
    plain = MountedMuscle(own, EndEffects())
    assert plain.force(pressure, contraction) == pytest.approx(own.force(pressure, contraction))
    soft = EndEffects(compliance=1e-9).mount(own)
    assert soft.force(pressure, contraction) == pytest.approx(
        own.force(pressure, contraction), rel=1e-6
    )


@pytest.mark.parametrize("name", KINDS)
def test_an_offset_from_a_length_gives_that_length(name):
    own = make(name)
    offset = find_offset(own, pressure=0.6, length=97.0)
    mounted = EndEffects(offset=offset).mount(own)
    assert MUSCLE.length - float(mounted.contraction(0.6)) == pytest.approx(97.0, abs=1e-8)
    assert float(mounted.force(0.6, MUSCLE.length - 97.0)) == pytest.approx(0.0, abs=1e-6)


FREE = {
    "kothera-balance": ("modulus", "braid_angle", "outer_radius"),
    "energy": ("modulus", "dead_length", "braid_angle"),
    "quadratic-strain": None,
}


@pytest.mark.parametrize("response", ["force", "contraction", "pressure"])
@pytest.mark.parametrize(
    "name",
    [
        "energy",
        pytest.param("kothera-balance", marks=pytest.mark.slow),
        pytest.param("quadratic-strain", marks=pytest.mark.slow),
    ],
)
def test_without_noise_the_truth_is_found_in_each_response(name, response):
    truth = make(name, MUSCLE.replace(dead_length=4.0 if name == "energy" else 0.0))
    data = measure(truth)
    data = data.select(data.load > 5.0)
    start = MUSCLE.replace(modulus=0.7, braid_angle=math.radians(27.0))
    found = calibrate(
        MODELS[name],
        start,
        data=data,
        free=FREE[name],
        options=FitOptions(response=response, force=True),
    )
    assert found.response == response
    assert found.sigma < 1e-6 * np.ptp(found.task.measured)
    for key, value in found.estimates.items():
        known = truth.muscle.given if key in truth.muscle.given else truth.keywords
        assert value == pytest.approx(known[key], rel=1e-4, abs=1e-9), key


def test_end_effects_are_found_beside_the_muscle():
    truth = ENDS.mount(make("kothera-balance"))
    data = measure(truth)
    assert (data.load == 6.0).any()
    found = calibrate(
        MODELS["kothera-balance"],
        MUSCLE.replace(modulus=1.5),
        data=data,
        free=("modulus", "offset", "compliance", "slack_force"),
    )
    for name in ("offset", "compliance", "slack_force"):
        assert found.estimates[name] == pytest.approx(getattr(ENDS, name), rel=1e-4)
    assert found.estimates["modulus"] == pytest.approx(1.0, rel=1e-4)
    assert found.fitted.ends.compliance == found.estimates["compliance"]


def make_specimens(noise=0.0, offsets=(0.5, -0.4, 0.2), compliance=0.01):
    """Simulate three specimens of other lengths, each with a zero of its own."""
    tables, free = [], []
    for index, (length, offset) in enumerate(zip((80.0, 120.0, 180.0), offsets, strict=True)):
        model = EndEffects(offset=offset, compliance=compliance).mount(
            make("chou", MUSCLE.replace(length=length))
        )
        tables.append(measure(model, specimen=f"m{index}", noise=noise, seed=index))
        free.append(np.full(40, length - float(model.contraction(0.6))))
    return dataclasses.replace(join(*tables), free_lengths={0.6: np.concatenate(free)})


def test_what_is_shared_and_what_is_each_specimens_own():
    data = make_specimens()
    start = MUSCLE.replace(braid_angle=math.radians(27.0))
    found = calibrate(
        MODELS["chou"],
        start,
        data=data,
        free=("braid_angle", "compliance", "offset"),
        options=FitOptions(each=("offset",)),
    )
    assert found.free == ("braid_angle", "compliance", "offset[m0]", "offset[m1]", "offset[m2]")
    values = list(found.estimates.values())
    assert values == pytest.approx([MUSCLE.braid_angle, 0.01, 0.5, -0.4, 0.2], rel=1e-5)
    assert found.fitted.ends.offset == pytest.approx(0.1, abs=1e-5)  # the mean
    assert {m.muscle.length for m in found.models.values()} == {80.0, 120.0, 180.0}
    anchored = calibrate(
        MODELS["chou"],
        start,
        data=data,
        free=("braid_angle", "compliance"),
        options=FitOptions(anchored=True),
    )
    assert anchored.estimates["braid_angle"] == pytest.approx(MUSCLE.braid_angle, rel=1e-5)
    offsets = [model.ends.offset for model in anchored.models.values()]
    assert offsets == pytest.approx([0.5, -0.4, 0.2], abs=1e-4)


@pytest.mark.slow
def test_nothing_is_fitted_to_the_specimen_left_out():
    """The error of a specimen left out is that of a prediction from a fit to the others."""
    data = make_specimens(noise=1.0)
    each = FitOptions(each=("offset",), force=True)
    ranking = rank(
        data,
        MUSCLE,
        models=["chou"],
        options=RankOptions(
            fields=("braid_angle", "offset"), leave_out="specimen", criterion="cv", fit=each
        ),
    )
    found = ranking.models[0].validation
    assert found.names == ("m0", "m1", "m2")
    for name, error in zip(found.names, found.errors, strict=True):
        rest, out = data.select(data.specimen != name), data.select(data.specimen == name)
        fit = calibrate(
            MODELS["chou"], MUSCLE, data=rest, free=("braid_angle", "offset"), options=each
        )
        own = [fit.estimates[key] for key in fit.free if key.startswith("offset[")]
        model = EndEffects(offset=float(np.mean(own))).mount(
            MODELS["chou"](out_muscle(out, fit.estimates["braid_angle"]))
        )
        miss = model.force(out.pressure, out.contraction) - out.load
        assert error == pytest.approx(np.sqrt(np.mean(miss**2)), rel=1e-4)
        assert fit.predict(out).residual == pytest.approx(error, rel=1e-4)


def out_muscle(data, angle):
    return MUSCLE.replace(length=float(data.geometry["length"][0]), braid_angle=angle)


def test_folds_are_partitions():
    task = FitData(muscle=MUSCLE, data=make_specimens(), response="force")
    for folds in (split_specimens(task), split_pressures(task)):
        assert np.sum(list(folds.values()), axis=0).tolist() == [1] * 120
    assert len(split_pressures(task)) == 8  # the levels of the pressures
    noisy = dataclasses.replace(
        task.data, pressure=np.random.default_rng(1).uniform(0.1, 0.6, size=120)
    )
    assert 2 <= len(split_pressures(FitData(muscle=MUSCLE, data=noisy))) <= 20


@pytest.mark.slow
def test_errors_in_the_pressure_bias_ordinary_least_squares_and_not_total():
    """The pull of an ideal braid is proportional to the pressure, so its slope is pulled to 0."""
    truth = MODELS["gaylord-1"](MUSCLE)
    random = np.random.default_rng(4)
    pressure = np.tile(np.linspace(0.3, 0.5, 40), 2)
    contraction = np.repeat([0.0, 10.0], 40)
    force = truth.force(pressure, contraction)
    estimates = {"ordinary": [], "total": []}
    for _ in range(25):
        noisy = Measurements(
            pressure=pressure + 0.06 * random.normal(size=80),
            contraction=contraction,
            load=force + 2.0 * random.normal(size=80),
        )
        stated = dataclasses.replace(noisy, errors={"load": 2.0, "pressure": 0.06})
        for name, data in (("ordinary", noisy), ("total", stated)):
            found = calibrate(
                MODELS["gaylord-1"],
                MUSCLE,
                data=data,
                free=("outer_radius",),
                options=FitOptions(response="force"),
            )
            estimates[name].append(found.estimates["outer_radius"])
    mean = {name: np.mean(values) for name, values in estimates.items()}
    spread = np.std(estimates["total"]) / math.sqrt(25)
    assert abs(mean["total"] - 5.0) < 4.0 * spread
    assert mean["ordinary"] < 5.0 - 8.0 * spread


def test_total_least_squares_of_a_line_is_demings():
    """For a force proportional to the pressure the minimum has a closed form."""
    random = np.random.default_rng(2)
    truth = MODELS["gaylord-1"](MUSCLE)
    slope = float(truth.force(1.0, 0.0))
    pressure = np.linspace(0.2, 0.6, 30)
    x = pressure + 0.02 * random.normal(size=30)
    y = slope * pressure + 5.0 * random.normal(size=30)
    data = Measurements(pressure=x, contraction=0.0, load=y, errors={"load": 5.0, "pressure": 0.02})
    found = calibrate(
        MODELS["gaylord-1"], MUSCLE, data=data, free=("outer_radius",),
        options=FitOptions(response="force"),
    )  # fmt: skip
    fitted = float(found.fitted.force(1.0, 0.0))
    ratio = (5.0 / 0.02) ** 2
    sxx, syy, sxy = x @ x, y @ y, x @ y
    deming = (syy - ratio * sxx + math.hypot(syy - ratio * sxx, 2.0 * math.sqrt(ratio) * sxy)) / (
        2.0 * sxy
    )
    assert fitted == pytest.approx(deming, rel=1e-6)
    assert fitted > y @ x / sxx  # ordinary least squares
    with pytest.raises(InputError, match="errors of pressure and none of load"):
        alone = dataclasses.replace(data, errors={"pressure": 0.02})
        calibrate(MODELS["gaylord-1"], MUSCLE, data=alone, free=("outer_radius",),
                  options=FitOptions(response="force"))  # fmt: skip


def test_rows_with_large_errors_hardly_count():
    truth = make("kothera-balance")
    data = measure(truth)
    wrong = np.arange(len(data)) % 5 == 0
    spoilt = dataclasses.replace(data, load=data.load + np.where(wrong, 40.0, 0.0))
    stated = dataclasses.replace(spoilt, errors={"load": np.where(wrong, 4e4, 0.1)})
    for table, tolerance in ((spoilt, None), (stated, 1e-3)):
        found = calibrate(MODELS["kothera-balance"], MUSCLE, data=table, free=("modulus",))
        off = abs(found.estimates["modulus"] - 1.0)
        assert off < tolerance if tolerance else off > 0.05


def test_a_poor_fit_is_told_by_the_span_or_by_the_repeats():
    data = measure(make("energy", MUSCLE.replace(modulus=4.0)), noise=0.5)
    poor = calibrate(MODELS["gaylord-1"], MUSCLE, data=data, free=("outer_radius",))
    assert any(line.startswith("the fit is poor") for line in poor.warnings)
    good = calibrate(MODELS["energy"], MUSCLE, data=data, free=("modulus",))
    assert not any("poor" in line for line in good.warnings)
    # rows that repeat each other no better than that: the model is not to blame
    span = np.ptp(data.load)
    twice = data.select(np.tile(np.arange(40), 2))
    error = 0.08 * span * np.random.default_rng(0).normal(size=80)
    loud = dataclasses.replace(twice, load=twice.load + error)
    found = calibrate(MODELS["energy"], MUSCLE, data=loud, free=("modulus",))
    assert found.sigma > 0.05 * span
    assert not any("poor" in line or "does not fit" in line for line in found.warnings)


def test_zero_rows_kill_no_model():
    """Rows of no pressure, of no load, and of both."""
    data = measure(make("chou"))
    zero = Measurements(pressure=[0.0, 0.0, 0.3], contraction=[0.0, 5.0, 30.0], load=[0, 0, 0])
    columns = ("pressure", "contraction", "load")
    both = Measurements(
        **{n: np.concatenate([getattr(data, n), getattr(zero, n)]) for n in columns}
    )
    names = ("gaylord-1", "chou", "kothera-balance", "itto-b", "energy", "quadratic-strain")
    ranking = rank(both, MUSCLE, models=names, options=RankOptions(folds=0))
    assert not ranking.refusals
    assert {entry.name for entry in ranking.models} == set(names)


def test_bands_of_a_specimen_of_the_fit_are_narrower_than_those_of_another():
    parts = []
    for index, offset in enumerate((-2.0, 0.0, 2.0)):
        muscle = MUSCLE.replace(length=100.0 + 20.0 * index)
        mounted = EndEffects(offset=offset).mount(make("chou", muscle))
        parts.append(measure(mounted, noise=1.0, seed=index, specimen="abc"[index]))
    found = calibrate(
        MODELS["chou"],
        MUSCLE,
        data=join(*parts),
        free=("braid_angle", "offset"),
        options=FitOptions(each=("offset",), response="force"),
    )
    known = found.predict(parts[2])
    other = found.predict(dataclasses.replace(parts[2], specimen="d"))
    assert known.residual < 1.2 and known.covered > 0.85
    every = found.predict(join(*parts))
    shares = [every.residual_by_specimen[name] ** 2 for name in "abc"]
    assert every.residual**2 == pytest.approx(np.mean(shares))
    assert shares[2] == pytest.approx(known.residual**2)
    assert np.all(known.confidence < other.confidence / 5.0)
    # Three specimens give what they have of their own two degrees of freedom, not that of all rows.
    wide, narrow = (
        found.predict(dataclasses.replace(parts[2], specimen=name), level=0.99).confidence
        / found.predict(dataclasses.replace(parts[2], specimen=name), level=0.5).confidence
        for name in ("d", "c")
    )
    assert wide == pytest.approx(student.ppf(0.995, 2) / student.ppf(0.75, 2), rel=0.05)
    assert found.freedom == 9  # ten runs of rows within each specimen
    assert "30 runs of 4 row(s), in the order of the table, within each of 3 specimens" in (
        found.interval_rule
    )
    assert narrow == pytest.approx(student.ppf(0.995, 9) / student.ppf(0.75, 9), rel=1e-6)
    # Not below the band of its own offset alone.
    stiff = found.models["c"].stiffness(parts[2].pressure, parts[2].contraction)
    assert np.mean(known.confidence) > np.mean(stiff) * found.standard_errors["offset[c]"]
    bare = dataclasses.replace(parts[2], geometry={})
    with pytest.raises(InputError, match=r"'c' was fitted with a rest length of 140.*or another"):
        found.predict(bare)
    assert np.array_equal(predict(found.to_file(), bare, length=140.0).predicted, known.predicted)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"resamples": 1}, "resamples is 1: it must be 2 or more"),
        ({"resamples": -1}, "resamples is -1"),
        ({"budget": math.nan}, "budget is nan s"),
        ({"budget": -1.0}, "budget is -1 s"),
        ({"seed": 0.5}, "seed is 0.5"),
        ({"each": "offset"}, "each is 'offset': it must be a sequence of names"),
    ],
)
def test_options_of_a_fit_are_checked(wrong, words):
    data = measure(make("kothera-balance"))
    with pytest.raises(InputError, match=words):
        calibrate(MODELS["kothera-balance"], MUSCLE, data=data, options=FitOptions(**wrong))
    with pytest.raises(InputError, match="free is 'modulus': it must be a sequence"):
        calibrate(MODELS["kothera-balance"], MUSCLE, data=data, free="modulus")


def test_errors_that_are_alike_change_no_criterion():
    clean = measure(make("chou"))
    data = dataclasses.replace(clean, load=clean.load + np.sin(np.arange(40.0)))
    options = RankOptions(folds=0)
    names = ["chou", "tondu-lopez"]
    plain = rank(data, MUSCLE, models=names, options=options)
    weighted = dataclasses.replace(data, errors={"load": 3.0})
    again = rank(weighted, MUSCLE, models=names, options=options)
    for one, other in zip(plain.models, again.models, strict=True):
        assert (one.name, one.parameters) == (other.name, other.parameters)
        assert other.aicc == pytest.approx(one.aicc, abs=1e-6)
    # Nor does it matter that one model has nothing to fit: noisy rows count less for all alike.
    unlike = np.where(np.arange(40) % 2, 1.0, 50.0)
    shaken = clean.load + unlike * np.sin(np.arange(40.0))
    data = dataclasses.replace(clean, load=shaken, errors={"load": unlike})
    known = rank(data, MUSCLE, models=["chou"], options=options).models[0]
    miss = (clean.load - shaken) / unlike
    wanted = 40 * math.log(miss @ miss / 40) + np.sum(2.0 * np.log(unlike)) + math.log(40)
    assert known.parameters == 0 and known.bic == pytest.approx(wanted)


def test_repeats_without_noise_are_no_lack_of_fit():
    clean = measure(make("kothera-balance"))
    twice = clean.select(np.tile(np.arange(40), 2))
    found = calibrate(MODELS["kothera-balance"], MUSCLE, data=twice, free=("modulus",))
    assert found.trusted


def test_lack_of_fit_goes_by_the_errors_of_the_rows():
    clean = measure(make("chou"))
    thrice = clean.select(np.tile(np.arange(40), 3))
    error = np.where(thrice.pressure > 0.5, 20.0, 0.5)
    random = np.random.default_rng(0)
    noisy = thrice.load + error * random.normal(size=120)
    # A misfit at the exact rows, small beside the errors of the others.
    bent = noisy + np.where(thrice.pressure > 0.5, 0.0, 1.5 * np.sin(thrice.contraction))

    def fit(force, **errors):
        data = dataclasses.replace(thrice, load=force, errors=errors)
        options = FitOptions(response="force")
        found = calibrate(MODELS["chou"], MUSCLE, data=data, free=("braid_angle",), options=options)
        return [text for text in found.warnings if "does not fit" in text]

    assert not fit(noisy, load=error)
    (said,) = fit(bent, load=error)
    assert "standard errors, repeats by" in said
    # Errors that are alike are the test without errors.
    assert bool(fit(bent, load=2.0)) == bool(fit(bent))


@pytest.mark.slow
def test_bands_hold_what_they_say(tmp_path):
    truth = make("kothera-balance")
    clean = measure(truth)
    free, inside, means = ("modulus", "braid_angle"), [], []
    fresh = clean.select(np.arange(0, 40, 3))
    for seed in range(40):
        random = np.random.default_rng(seed)
        data = dataclasses.replace(clean, load=clean.load + 2.0 * random.normal(size=40))
        found = calibrate(MODELS["kothera-balance"], MUSCLE, data=data, free=free)
        new = dataclasses.replace(fresh, load=fresh.load + 2.0 * random.normal(size=len(fresh)))
        band = found.predict(new)
        inside.append(band.covered)
        means.append(np.mean(np.abs(band.predicted - fresh.load) <= band.confidence))
    assert 0.92 <= np.mean(inside) <= 0.98
    assert 0.88 <= np.mean(means) <= 1.0
    path = write_muscle(tmp_path / "fit.yaml", found.to_file())
    again = predict(read_muscle(path), new)
    assert again.predicted == pytest.approx(band.predicted, rel=1e-12)
    assert again.prediction == pytest.approx(band.prediction, rel=1e-9)
    longer = predict(read_muscle(path), new, length=150.0)
    model = MODELS["kothera-balance"](found.muscle.replace(length=150.0))
    assert longer.predicted == pytest.approx(model.force(new.pressure, new.contraction))
    anchored = predict(read_muscle(path), new, length=150.0, free_length=(0.6, 120.0))
    offset = find_offset(model, pressure=0.6, length=120.0)
    mounted = EndEffects(offset=offset).mount(model)
    assert anchored.predicted == pytest.approx(mounted.force(new.pressure, new.contraction))
    assert len(band.to_frame()) == len(new)


def test_what_is_predicted_need_not_be_in_the_table(tmp_path):
    model = EnergyMuscle(preset("effector-45"))
    pressure = np.linspace(0.1, 0.7, 12)
    data = pandas.DataFrame({"pressure [MPa]": pressure, "load [N]": 0.0})
    shown = data.assign(**{"contraction [mm]": model.contraction(pressure)})
    options = FitOptions(response="contraction")
    fit = calibrate(EnergyMuscle, model.muscle, data=shown, free=("modulus",), options=options)
    file = fit.to_file()
    for table in (shown, data):
        assert predict(file, table).predicted == pytest.approx(model.contraction(pressure))
    with pytest.raises(InputError, match="no column contraction"):
        take_measurements(data)


@pytest.mark.slow
def test_resampled_errors_are_near_the_linearised_ones():
    data = measure(make("kothera-balance"), noise=2.0)
    one, other = (
        calibrate(
            MODELS["kothera-balance"],
            MUSCLE,
            data=data,
            free=("modulus", "braid_angle"),
            options=FitOptions(resamples=count),
        )
        for count in (0, 40)
    )
    assert one.estimates == other.estimates
    for name in one.free:
        assert other.standard_errors[name] == pytest.approx(one.standard_errors[name], rel=0.5)


def test_a_band_has_an_end():
    found = calibrate(
        MODELS["kothera-balance"],
        MUSCLE,
        data=measure(make("kothera-balance"), noise=2.0),
        free=("modulus",),
    )
    states = measure(make("kothera-balance"))
    assert np.isfinite(found.predict(states, level=0.999999).prediction).all()
    with pytest.raises(InputError, match="level is 1: it must lie in"):
        found.predict(states, level=1.0)


def test_rows_of_one_state_cannot_show_whether_a_model_fits():
    data = measure(make("kothera-balance")).select(np.full(30, 20))
    found = calibrate(MODELS["kothera-balance"], MUSCLE, data=data, free=("modulus",))
    assert any("1 state(s) for 1 parameter(s)" in text for text in found.warnings)
    assert not found.trusted


@pytest.mark.parametrize("done", [0, 5])
def test_resamples_without_time_do_not_count(done, monkeypatch):
    """A resample that is stopped is where it began: it would make the errors too small."""
    data = measure(make("kothera-balance"), noise=2.0)
    calls, limit = [0], [10**9]

    def is_over(clock):
        calls[0] += 1
        return calls[0] > limit[0]

    monkeypatch.setattr(Clock, "is_over", property(is_over))

    def fit(resamples):
        calls[0] = 0
        free, options = ("modulus", "braid_angle"), FitOptions(resamples=resamples)
        return calibrate(MODELS["kothera-balance"], MUSCLE, data=data, free=free, options=options)

    expected = fit(0)
    if done:
        limit[0] = 10**9
        expected = fit(done)
    limit[0] = calls[0]
    stopped = fit(20)
    assert f"used up after {done} of 20 resamples" in " ".join(stopped.warnings)
    assert stopped.standard_errors == pytest.approx(expected.standard_errors)


def test_a_fit_without_time_is_stopped_and_says_so():
    data = measure(make("kothera-balance"), noise=1.0)
    found = calibrate(
        MODELS["pressure-stiffening"],
        MUSCLE,
        data=data,
        options=FitOptions(budget=1e-9, force=True),
    )
    assert not found.converged and found.reason.startswith("stopped")
    ranking = rank(
        data,
        MUSCLE,
        models=["pressure-stiffening", "gaylord-1"],
        options=RankOptions(folds=2, fit=FitOptions(budget=1e-9)),
    )
    doubt = {entry.name: entry.doubt for entry in ranking.models}
    assert doubt["gaylord-1"] == "" and "stopped" in doubt["pressure-stiffening"]


class Idle(EnergyMuscle):
    """A model that takes its time, and leaves a file when it is done."""

    def __post_init__(self):
        time.sleep(60.0)
        Path(os.environ["IDLE_IS_DONE"]).touch()


@pytest.mark.slow
def test_an_interrupt_does_not_wait_for_the_models_that_are_left(monkeypatch, tmp_path):
    done = tmp_path / "done"
    monkeypatch.setenv("IDLE_IS_DONE", str(done))
    data = measure(make("kothera-balance"))
    models = {"first": MODELS["gaylord-1"], **{f"idle {k}": Idle for k in range(6)}}

    def interrupt(text, share):
        if text == "fitted first":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rank(data, MUSCLE, models=models, options=RankOptions(jobs=2), progress=interrupt)
    assert not done.exists()


@pytest.mark.slow
def test_processes_give_the_same_ranking():
    data = measure(make("kothera-balance"), noise=1.0)
    names = ("gaylord-1", "chou", "kothera-balance", "itto-b")
    one, two = (
        rank(data, MUSCLE, models=names, options=RankOptions(folds=2, jobs=jobs)) for jobs in (1, 2)
    )
    assert one.format_table() == two.format_table()


@pytest.mark.parametrize("response", ["force", "pressure"])
@pytest.mark.parametrize("errors", [{}, {"load": 2.0, "pressure": 0.01, "contraction": 0.2}])
def test_derivatives_of_the_misfit_by_two_routes(response, errors):
    data = dataclasses.replace(measure(make("chou"), noise=1.0), errors=errors)
    data = data.select(data.load > 5.0)
    problem = Problem(
        model_class=MODELS["chou"],
        task=FitData(muscle=MUSCLE, data=data, response=response, ends=EndEffects(compliance=0.01)),
        free=("braid_angle", "outer_radius", "compliance"),
        limits=np.array([[0.3, 0.6], [4.5, 8.0], [0.0, 0.1]]),
    )
    point = problem.choose_start()
    held = problem.evaluate(point)[1]
    table = problem.measure_jacobian(point)[held]
    for column in range(3):
        step = np.zeros(3)
        step[column] = 3e-5
        slope = (problem.measure_residuals(point + step) - problem.measure_residuals(point - step))[
            held
        ] / 6e-5
        assert table[:, column] == pytest.approx(slope, rel=1e-3, abs=1e-3 * np.abs(slope).max())


def test_derivatives_behind_fittings_cost_two_forces_a_parameter(monkeypatch):
    ends = EndEffects(offset=0.4, compliance=0.02, slack_force=20.0)
    data = measure(make("kothera-balance"), noise=1.0)
    names = ("modulus", "braid_angle", "offset", "compliance", "slack_force")
    problem = Problem(
        model_class=MODELS["kothera-balance"],
        task=FitData(muscle=MUSCLE, data=data, response="force", ends=ends),
        free=names,
        limits=np.array([[0.1, 9.0], [0.3, 0.6], [-9.0, 9.0], [0.0, 0.1], [0.0, 50.0]]),
    )
    point = problem.choose_start()
    residuals, calls, kind = problem.measure_residuals(point), [], MODELS["kothera-balance"]
    ask = kind.try_force
    monkeypatch.setattr(
        kind, "try_force", lambda *args, **more: calls.append(1) or ask(*args, **more)
    )
    table = problem.measure_jacobian(point)
    assert len(calls) <= 2 * len(names) + 2
    slack = residuals + data.load < 20.0 + 1e-9
    assert 0 < slack.sum() < len(data)
    for column, name in enumerate(names):
        step = np.zeros(len(names))
        step[column] = 3e-5
        slope = (
            problem.measure_residuals(point + step) - problem.measure_residuals(point - step)
        ) / 6e-5
        assert table[:, column] == pytest.approx(slope, rel=1e-4, abs=1e-4 * np.abs(slope).max())
        assert name == "slack_force" or not table[slack, column].any()


def test_derivatives_of_an_offset_from_a_length_by_two_routes():
    model = EndEffects(offset=0.5, compliance=0.01).mount(make("kothera-balance"))
    data = dataclasses.replace(measure(model, specimen="A"), free_lengths={0.62: np.full(40, 92.0)})
    problem = Problem(
        model_class=MODELS["kothera-balance"],
        task=FitData(
            muscle=MUSCLE, data=data, response="force", ends=EndEffects(compliance=0.01),
            anchored=True,
        ),
        free=("modulus", "braid_angle"),
        limits=np.array([[0.1, 9.0], [0.3, 0.6]]),
    )  # fmt: skip
    point = problem.choose_start()
    held, table = problem.evaluate(point)[1], problem.measure_jacobian(point)
    for column in range(2):
        step = np.zeros(2)
        step[column] = 3e-5
        slope = (
            problem.measure_residuals(point + step) - problem.measure_residuals(point - step)
        ) / 6e-5
        expected = pytest.approx(slope[held], rel=1e-3, abs=1e-3 * np.abs(slope).max())
        assert table[held, column] == expected

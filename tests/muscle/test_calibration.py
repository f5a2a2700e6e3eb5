"""Calibration finds known parameters again, says how well, and refuses what data cannot tell."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import t as student

from bozzini.errors import InputError
from bozzini.muscle import (
    MODELS,
    EnergyMuscle,
    FitOptions,
    Measurements,
    RankOptions,
    ThesisMuscle,
    calibrate,
    preset,
    rank,
)
from bozzini.muscle import problem as fitting
from bozzini.muscle.muscle_fit import judge_parameters, judge_repeats
from bozzini.muscle.problem import FitData
from bozzini.numeric.estimation import CONDITION_LIMIT, CORRELATION_LIMIT, determine

TRUTH = preset("thesis-45", modulus=0.5, dead_length=10.0)
START = TRUTH.replace(modulus=0.35, dead_length=0.0)
PRESSURES = np.linspace(0.0, 0.827, 20)
NOISE = 0.1


def measure(*branches, muscle=TRUTH, noise=0.0, seed=0, model=EnergyMuscle, pressures=PRESSURES):
    """Simulate branches, each a (load, direction), one after the other."""
    parts = []
    for load, direction in branches or [(0.0, "")]:
        contraction = model(muscle).contraction(pressures, load, direction=direction)
        parts.append((pressures, contraction, np.full(len(pressures), load), direction))
    error = np.random.default_rng(seed).normal(size=len(parts) * len(pressures))
    return Measurements(
        pressure=np.concatenate([part[0] for part in parts]),
        contraction=np.concatenate([part[1] for part in parts]) + noise * error,
        load=np.concatenate([part[2] for part in parts]),
        direction=np.repeat([part[3] for part in parts], len(pressures)),
    )


def block(count=8):
    """Simulate forces of the blocked muscle."""
    pressure = np.linspace(0.1, 0.827, count)
    force = EnergyMuscle(TRUTH).blocked_force(pressure)
    return Measurements(pressure=pressure, contraction=np.zeros(count), load=force)


def join(*tables):
    return Measurements(
        **{
            name: np.concatenate([getattr(table, name) for table in tables])
            for name in ("pressure", "contraction", "load", "direction")
        }
    )


MEAN = ((0.0, ""),)
UP = ((0.0, "inflating"),)
BOTH = ((0.0, "inflating"), (0.0, "deflating"))
RUBBING = TRUTH.replace(friction_length=0.02)

# The table of what can be identified: free parameters, data, and what one standard deviation of
# 0.1 mm comes to; condition; worst correlation. (friction in mm, angle in degrees)
SETS = {
    "default": (("modulus", "dead_length"), MEAN, (0.006, 0.17), 3, -0.74),
    "gap": (("modulus", "gap", "dead_length"), MEAN, (0.014, 0.0055, 0.22), 7, -0.91),
    "angle": (
        ("modulus", "gap", "dead_length", "braid_angle"), MEAN,
        (0.028, 0.007, 4.7, 3.9), 97, -0.999,
    ),
    "Mooney": (("modulus", "dead_length", "mooney_ratio"), MEAN, (0.016, 0.18, 0.09), 9, 0.92),
    "angle, loaded": (
        ("modulus", "gap", "dead_length", "braid_angle"), (*MEAN, (0.5, "")),
        (0.007, 0.0018, 0.20, 0.08), 4, -0.66,
    ),
    "friction, one way": (
        ("modulus", "dead_length", "friction_length"), UP, (0.056, 22.0, 0.32), 426, -1.0,
    ),
    "friction, both ways": (
        ("modulus", "dead_length", "friction_length"), BOTH, (0.004, 0.12, 0.0013), 3, None,
    ),
    "all": (
        ("modulus", "gap", "dead_length", "braid_angle", "friction_length"),
        (*BOTH, (0.5, "inflating")), (0.006, 0.0017, 0.16, 0.08, 0.0013), 5, None,
    ),
}  # fmt: skip
LOST = {"angle", "friction, one way"}


@pytest.mark.parametrize("name", SETS)
def test_table_of_what_can_be_identified(name, monkeypatch):
    """The errors of the table are those of rows that err independently."""
    known = []
    monkeypatch.setattr(
        "bozzini.muscle.muscle_fit.determine",
        lambda table: known.append(determine(table)) or known[-1],
    )
    free, branches, spread, condition, worst = SETS[name]
    muscle = RUBBING if "friction_length" in free else TRUTH
    if name == "Mooney":  # off its bound
        muscle = muscle.replace(mooney_ratio=0.05)
    # hardly any noise: the fit ends at the truth, and the statistics are those there
    data = measure(*branches, muscle=muscle, noise=1e-4)
    found = calibrate(EnergyMuscle, muscle, data=data, free=free, options=FitOptions(force=True))
    assert found.converged
    units = {"braid_angle": math.degrees(1.0)}
    deviations = np.sqrt(np.diag(known[-1].inverse))
    errors = [one * units.get(key, 1.0) * NOISE for key, one in zip(free, deviations, strict=True)]
    assert errors == pytest.approx(spread, rel=0.12)
    assert found.condition == pytest.approx(condition, rel=0.2)
    off = known[-1].correlations[np.triu_indices(len(free), 1)]
    if worst is not None:
        assert off[np.argmax(np.abs(off))] == pytest.approx(worst, abs=0.02)
    assert bool(found.warnings) == (name in LOST)
    assert found.trusted == (name not in LOST)
    if name in LOST:
        assert found.condition > CONDITION_LIMIT
        assert np.abs(off).max() > CORRELATION_LIMIT
        assert any("cannot be distinguished" in line for line in found.warnings)
        with pytest.raises(InputError, match="do the same to one curve"):
            calibrate(EnergyMuscle, muscle, data=data, free=free)


def test_blocked_forces_tell_the_angle():
    free = ("modulus", "dead_length", "braid_angle")
    data = join(measure(), block())
    start = START.replace(braid_angle=math.radians(34.0))
    found = calibrate(EnergyMuscle, start, data=data, free=free)
    assert found.trusted
    assert found.condition < 5.0
    assert found.estimates["braid_angle"] == pytest.approx(TRUTH.braid_angle, abs=1e-6)
    with pytest.raises(InputError, match="second load"):
        calibrate(EnergyMuscle, start, data=measure(), free=free)


COVERED = {
    "default": (TRUTH, ("modulus", "dead_length"), MEAN),
    "gap": (TRUTH, ("modulus", "gap", "dead_length"), MEAN),
    "friction": (RUBBING, ("modulus", "dead_length", "friction_length"), BOTH),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", COVERED)
def test_intervals_hold_the_truth_in_90_to_99_percent_of_100_draws(name):
    """From a start far from the truth. Of 1000 draws it is 93 to 97 %, see the guide."""
    truth, free, branches = COVERED[name]
    clean = measure(*branches, muscle=truth)
    draws = 100
    random = np.random.default_rng(7)
    held = dict.fromkeys(free, 0)
    for _ in range(draws):
        error = NOISE * random.normal(size=len(clean))
        data = dataclasses.replace(clean, contraction=clean.contraction + error)
        found = calibrate(EnergyMuscle, START, data=data, free=free)
        assert found.converged
        for parameter, (low, high) in found.intervals.items():
            held[parameter] += low <= getattr(truth, parameter) <= high
    assert all(0.90 * draws <= count <= 0.99 * draws for count in held.values()), held


@pytest.mark.slow
def test_the_minimum_does_not_depend_on_the_start():
    """Moving contact past a measured pressure is a kink that could catch the search."""
    free = ("modulus", "gap", "dead_length")
    starts = (TRUTH, START, START.replace(gap=0.1), START.replace(modulus=1.0, gap=0.005))
    for seed in range(15):
        data = measure(noise=NOISE, seed=seed)
        sigmas = [calibrate(EnergyMuscle, start, data=data, free=free).sigma for start in starts]
        assert sigmas == pytest.approx([min(sigmas)] * len(starts), rel=1e-6)


def test_the_gap_needs_pressures_where_it_acts():
    """Three of them; rows without pressure, and repeats, do not count."""
    contact = EnergyMuscle(TRUTH).dead_band()
    high = np.linspace(4.0 * contact, 0.8, 12)
    for low, warned in (
        ([0.0] * 4, True),
        ([1.5 * contact] * 4, True),
        ([0.8 * contact, 1.5 * contact], True),
        ([0.8 * contact, 1.5 * contact, 2.2 * contact], False),
    ):
        pressure = np.concatenate([low, high])
        data = measure(pressures=pressure, noise=0.01)
        found = calibrate(EnergyMuscle, START, data=data, free=("modulus", "gap", "dead_length"))
        assert any(line.startswith("gap has") for line in found.warnings) == warned


@settings(max_examples=15)
@given(
    modulus=st.floats(0.1, 2.0),
    dead_length=st.floats(0.5, 25.0),
    gap=st.floats(0.01, 0.1),
    angle=st.floats(25.0, 45.0),
)
def test_without_noise_the_truth_is_found(modulus, dead_length, gap, angle):
    truth = TRUTH.replace(
        modulus=modulus, dead_length=dead_length, gap=gap, braid_angle=math.radians(angle)
    )
    free = ("modulus", "gap", "dead_length", "braid_angle")
    data = measure((0.0, ""), (0.3, ""), muscle=truth, pressures=np.linspace(0.0, 2.0, 40))
    found = calibrate(EnergyMuscle, TRUTH, data=data, free=free)
    assert found.converged
    assert found.sigma < 1e-5
    for name in free:
        assert found.estimates[name] == pytest.approx(getattr(truth, name), rel=1e-4)


def test_the_preset_fitted_to_chapter_4_is_found_again():
    # the thesis's contractions without load, for the tube of 1.5 mm
    data = Measurements(pressure=[0.6894, 0.5516, 0.4136], contraction=[7.6, 7.1, 6.2])
    found = calibrate(EnergyMuscle, preset("effector-45"), data=data)
    fitted = preset("fitted-45")
    assert found.estimates["modulus"] == pytest.approx(fitted.modulus, abs=0.005)
    assert found.estimates["dead_length"] == pytest.approx(fitted.dead_length, abs=0.05)
    assert np.abs(found.residuals).max() < 0.05  # the tables are rounded to 0.1


@pytest.mark.parametrize("ends", ["none", "trellis"])
def test_the_model_may_have_options(ends):
    make = functools.partial(EnergyMuscle, ends=ends)
    data = measure(model=make)
    found = calibrate(make, START, data=data)
    assert found.estimates["dead_length"] == pytest.approx(10.0, abs=1e-4)
    assert found.estimates["modulus"] == pytest.approx(0.5, abs=1e-5)
    assert found.model == "energy"


def test_the_thesis_model_is_fitted_by_what_it_has():
    data = measure(model=ThesisMuscle, muscle=TRUTH.replace(end_length=4.0))
    found = calibrate(ThesisMuscle, START, data=data, free=("modulus", "end_length"))
    assert found.estimates["modulus"] == pytest.approx(0.5, rel=1e-3)
    assert found.estimates["end_length"] == pytest.approx(4.0, rel=1e-2)
    with pytest.raises(InputError, match="dead_length has no effect"):
        calibrate(ThesisMuscle, START, data=data, free=("modulus", "dead_length"))
    assert calibrate(ThesisMuscle, START, data=data).free == ("modulus", "end_length")


@pytest.mark.parametrize("branches", [MEAN, BOTH, ((0.5, ""), (1.0, ""))])
@pytest.mark.parametrize(
    "name", ["modulus", "dead_length", "gap", "braid_angle", "mooney_ratio", "outer_radius"]
)
def test_derivatives_by_two_routes(name, branches):
    muscle = RUBBING.replace(mooney_ratio=0.2)
    data = measure(*branches, muscle=muscle)
    value = {name: float(getattr(muscle, name))}

    def build(values):
        return EnergyMuscle(muscle.replace(**values))

    pairs = [(name, (1.0 - 1e-4) * value[name], (1.0 + 1e-4) * value[name])]
    one = fitting.differentiate(build, value, pairs=pairs, data=data, predicted=data.contraction)[
        :, 0
    ]
    step = 1e-5 * value[name]
    ends = [
        fitting.try_response(build({name: value[name] + sign * step}), data, "contraction")[0]
        for sign in (1.0, -1.0)
    ]
    other = (ends[0] - ends[1]) / (2.0 * step)
    assert one == pytest.approx(other, rel=1e-4, abs=1e-5 * np.abs(other).max())


def test_statistics_by_the_textbook():
    data = measure(noise=NOISE)
    found = calibrate(EnergyMuscle, START, data=data)
    model = EnergyMuscle(found.muscle)
    rest = data.contraction - model.contraction(data.pressure)
    assert found.residuals == pytest.approx(rest, abs=1e-9)
    assert found.sigma == pytest.approx(math.sqrt(rest @ rest / 18.0))
    low, high = found.intervals["modulus"]
    half = student.ppf(0.975, 9) * found.standard_errors["modulus"]
    assert (low + high) / 2.0 == pytest.approx(found.estimates["modulus"])
    assert (high - low) / 2.0 == pytest.approx(half)
    assert np.diag(found.correlations) == pytest.approx([1.0, 1.0])
    assert found.correlations == pytest.approx(found.correlations.T)
    # a minimum: every small step away is worse
    for name in found.free:
        for factor in (0.999, 1.001):
            there = found.muscle.replace(**{name: factor * found.estimates[name]})
            away = data.contraction - EnergyMuscle(there).contraction(data.pressure)
            assert away @ away > rest @ rest


def test_twice_the_noise_is_twice_the_interval():
    one, two = (
        calibrate(EnergyMuscle, TRUTH, data=measure(noise=noise, seed=3)) for noise in (0.01, 0.02)
    )
    for name in one.free:
        assert two.standard_errors[name] == pytest.approx(2.0 * one.standard_errors[name], rel=0.02)


def test_a_wrong_fixed_angle_does_not_show():
    # the reason why the angle must not be fitted to one curve: the dead length hides it
    data = measure()
    found = calibrate(EnergyMuscle, START.replace(braid_angle=math.radians(37.0)), data=data)
    assert found.estimates["dead_length"] == pytest.approx(8.7, abs=0.2)
    assert found.sigma < 0.02
    without_gap = calibrate(EnergyMuscle, START.replace(gap=0.0), data=data)
    assert without_gap.sigma > 0.2
    assert without_gap.estimates["modulus"] > 0.6


def test_it_warns_at_a_bound_and_of_a_gap_without_rows():
    found = calibrate(
        EnergyMuscle, START, data=measure(), options=FitOptions(bounds={"dead_length": (0.0, 8.0)})
    )
    assert found.converged
    assert not found.trusted
    assert found.estimates["dead_length"] == pytest.approx(8.0)
    assert any("dead_length is at its bound" in line for line in found.warnings)
    high = measure(pressures=np.linspace(0.2, 0.8, 20))
    found = calibrate(EnergyMuscle, START, data=high, free=("modulus", "gap"))
    assert any("gap has 0 pressure(s)" in line for line in found.warnings)


def test_a_model_that_does_not_fit_is_told_by_repeats():
    # friction in the data and none in the model: branches that differ, repeats that do not
    data = join(*(measure(*BOTH, muscle=RUBBING, noise=0.02, seed=seed) for seed in (1, 2)))
    smooth = calibrate(EnergyMuscle, START, data=data)
    assert any("does not fit" in line for line in smooth.warnings)
    assert not smooth.trusted
    rubbing = calibrate(EnergyMuscle, START, data=data, free=(*smooth.free, "friction_length"))
    assert rubbing.trusted


def test_lack_of_fit_is_seldom_seen_where_there_is_none():
    random = np.random.default_rng(5)
    pressure = np.repeat(PRESSURES, 3)
    seen = 0
    for _ in range(300):
        error = random.normal(size=60)
        data = Measurements(pressure=pressure, contraction=error)
        line = np.polynomial.Polynomial.fit(pressure, error, 1)
        seen += bool(
            judge_repeats(FitData(muscle=TRUTH, data=data), error - line(pressure), parameters=2)
        )
    assert seen <= 3  # 0.1 % of 300 is expected
    alone = Measurements(pressure=PRESSURES, contraction=np.zeros(20))
    assert judge_repeats(FitData(muscle=TRUTH, data=alone), np.full(20, 9.0), parameters=2) == []


def test_rules_before_the_fit():
    mean, up = measure(), measure(*UP, muscle=RUBBING)
    loaded, both = measure((0.0, ""), (0.5, "")), measure(*BOTH, muscle=RUBBING)
    pair = ("modulus", "dead_length")
    for free, data, counts in [
        (pair, mean, (0, 0)),
        ((*pair, "braid_angle"), mean, (1, 0)),
        ((*pair, "braid_angle"), loaded, (0, 0)),
        (("modulus", "braid_angle"), mean, (0, 1)),
        ((*pair, "friction_length"), up, (1, 0)),
        ((*pair, "friction_length"), both, (0, 0)),
        (("modulus", "friction_length"), up, (0, 1)),
        ((*pair, "gap"), mean, (0, 0)),
        ((*pair, "gap"), measure(pressures=np.linspace(0.1, 0.8, 20)), (0, 1)),
    ]:
        never, doubts = judge_parameters(free, data, contact_pressure=0.05)
        assert (len(never), len(doubts)) == counts, free


@pytest.mark.parametrize(
    ("model", "free", "lost"),
    [
        (EnergyMuscle, ("modulus", "dead_length"), "modulus and dead_length have"),
        (EnergyMuscle, ("modulus", "braid_angle"), "modulus has"),
        (MODELS["tondu-lopez"], ("kappa1", "kappa2"), "kappa1 and kappa2 have"),
    ],
)
def test_constants_that_the_rows_do_not_touch_are_not_fitted(model, free, lost):
    """Of a blocked muscle whose tube touches the braid."""
    data = block()
    muscle = TRUTH.replace(gap=0.0)
    with pytest.raises(InputError, match=f"^{lost} no effect at these rows"):
        calibrate(model, muscle, data=data, free=free)
    fit = calibrate(model, muscle, data=data, free=free, options=FitOptions(force=True))
    for name in lost.split()[:-1:2]:
        assert any(text.startswith(f"{name} has no effect") for text in fit.warnings)
        assert math.isinf(fit.standard_errors[name])
    assert "not determined" in fit.format_table() and not fit.trusted
    assert np.isfinite(fit.covariance).all()


def test_ends_of_an_interval_read_apart_from_the_value():
    """A good fit has intervals of less than the fourth digit."""
    fit = calibrate(EnergyMuscle, START, data=measure(noise=1e-6))
    for line in fit.format_table().splitlines()[: len(fit.free)]:
        _, value, _, _, _, low, _, high = line.split()
        assert float(low) < float(value) < float(high)


def test_what_one_muscle_has_of_its_own_has_a_plain_name():
    options = FitOptions(each=("modulus",))
    fit = calibrate(EnergyMuscle, START, data=measure(), free=["modulus"], options=options)
    assert fit.free == ("modulus",)
    shared = calibrate(EnergyMuscle, START, data=measure(), free=["modulus"])
    assert fit.estimates["modulus"] == pytest.approx(shared.estimates["modulus"])
    assert fit.to_file().fit.names == ("modulus",)


def test_what_is_offered_has_an_effect_and_resamples_have_an_end():
    model = functools.partial(MODELS["tondu-lopez"], kappa2=1.0)
    with pytest.raises(InputError, match="'kappa2' is given") as caught:
        calibrate(model, TRUTH, data=block(), free=["kappa2"])
    offered = str(caught.value).partition(": use ")[2].split(", ")
    assert "kappa1" in offered and "braid_angle" in offered
    assert not {"inner_radius", "modulus", "kappa2"} & {*offered}
    with pytest.raises(InputError, match=r"resamples is 100000000: .*\[0, 100000\]"):
        calibrate(EnergyMuscle, TRUTH, data=block(), options=FitOptions(resamples=10**8))


def test_too_few_rows_and_rows_that_no_muscle_holds():
    two = Measurements(pressure=[0.4, 0.6], contraction=[7.0, 8.0])
    with pytest.raises(InputError, match="2 row"):
        calibrate(EnergyMuscle, START, data=two)
    heavy = Measurements(
        pressure=[0.4, 0.5, 0.6],
        contraction=[7.0, 8.0, 8.5],
        load=[0.0, 1e6, 0.0],
        numbers=[2, 4, 5],
    )
    found = calibrate(
        EnergyMuscle,
        START,
        data=dataclasses.replace(heavy, load=[0.0, 1e6, 0.0]),
        free=("modulus",),
    )
    assert found.answered.tolist() == [True, False, True] and not found.trusted
    why = "2 of 3 rows; row 4: load is 1e+06 N: at a pressure of 0.5 MPa"
    assert any(why in line for line in found.warnings)
    with pytest.raises(InputError, match=r"^row 2: load is 1e\+06 N: at a pressure of 0.4 MPa"):
        calibrate(EnergyMuscle, START, data=dataclasses.replace(heavy, load=1e6))


@pytest.mark.parametrize("contraction", [200.0, 2e5, 6e200, -12.0])
def test_lengths_that_no_strand_allows_are_refused(contraction):
    data = Measurements(pressure=[0.4, 0.5, 0.6], contraction=[7.0, contraction, 8.5])
    with pytest.raises(InputError, match="^row 2: length is "):
        calibrate(EnergyMuscle, START, data=data)


def test_a_longer_strand_is_legal_where_the_angle_is_fitted():
    start = START.replace(braid_angle=math.radians(30.0))
    length = 1.02 * start.braid.strand_length  # the strands of a braid of 40 degrees reach so far
    data = Measurements(
        pressure=[0.0, 0.2, 0.4, 0.6],
        contraction=[45.0 - length, 3.0, 5.0, 6.0],
        load=[50, 0, 0, 0],
    )
    with pytest.raises(InputError, match="longer than the strand"):
        calibrate(EnergyMuscle, start, data=data)
    found = calibrate(EnergyMuscle, start, data=data, free=("modulus", "braid_angle"))
    assert any("row 1: load is 50 N" in x for x in found.warnings)  # its length is no reason


def test_trials_that_have_no_answer_are_stepped_back_from():
    # near the largest load that the model takes, weaker trials cannot hold it
    problem = fitting.Problem(
        model_class=EnergyMuscle,
        task=FitData(muscle=TRUTH, data=measure()),
        free=("outer_radius",),
        limits=np.array([[0.1, 1.0]]),
    )
    _, held = problem.evaluate(np.array([0.2]) / problem.scales)  # thinner than its bore
    assert not held.any()
    assert problem.evaluate(np.array([0.5]) / problem.scales)[1].all()
    assert (problem.measure_jacobian(np.array([0.2]) / problem.scales) == 0.0).all()
    data = measure(muscle=TRUTH.replace(outer_radius=0.5))
    found = calibrate(
        EnergyMuscle,
        TRUTH,
        data=data,
        free=("outer_radius",),
        options=FitOptions(bounds={"outer_radius": (0.01, 1.0)}),
    )
    assert found.converged
    assert found.estimates["outer_radius"] == pytest.approx(0.5, abs=1e-6)


def test_a_fit_takes_what_a_ranking_takes() -> None:
    bare = preset("festo-10", length=233.0)
    truth = bare.replace(inner_radius=4.0, braid_angle=math.radians(24.0), modulus=1.5)
    pressures, contractions = map(np.ravel, np.meshgrid([0.2, 0.4, 0.6], [0.0, 5.0, 15.0, 30.0]))
    forces = EnergyMuscle(truth).force(pressures, contractions)
    data = Measurements(pressure=pressures, contraction=contractions, load=forces)
    found = calibrate(EnergyMuscle, bare, data=data)
    assert found.free == ("modulus", "dead_length", "braid_angle")
    assert found.held == {"inner_radius": "not given, so held at a typical value, 4 mm"}
    assert found.estimates["braid_angle"] == pytest.approx(truth.braid_angle, abs=1e-4)
    assert found.estimates["modulus"] == pytest.approx(1.5, rel=1e-3)
    ranked = rank(data, bare, models=["energy"], options=RankOptions(folds=0)).models[0]
    assert ranked.calibration.estimates == pytest.approx(found.estimates, rel=1e-6, abs=1e-6)
    one = calibrate(EnergyMuscle, bare, data=data, free=("modulus",))
    assert one.free == ("modulus", "braid_angle")
    thick = calibrate(EnergyMuscle, bare.replace(inner_radius=3.0), data=data)
    assert thick.held == {}
    chou = calibrate(MODELS["chou"], bare, data=data)
    assert chou.free == ("braid_angle",)


def test_a_fit_without_a_braid_angle_warns_where_one_curve_cannot_tell_it() -> None:
    bare = preset("thesis-45", braid_angle=None)
    found = calibrate(EnergyMuscle, bare, data=measure())
    assert "braid_angle" in found.free
    assert any("braid_angle and dead_length do the same" in text for text in found.warnings)
    with pytest.raises(InputError, match="braid_angle and dead_length do the same"):
        calibrate(EnergyMuscle, preset("thesis-45"), data=measure(),
                  free=("braid_angle", "dead_length"))  # fmt: skip

"""Ranking: data that a model made rank it first, or one that describes them as well."""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np
import pytest

from bozzini.errors import BozziniError, InputError, MissingLawError
from bozzini.muscle import (
    CATALOGUE,
    MODELS,
    Measurements,
    Muscle,
    calibrate,
    compare_models,
    rank_models,
)
from bozzini.muscle._folds import count_states, cross_validate, split_rows

MUSCLE = Muscle(length=45.0, outer_radius=0.75, inner_radius=0.4, gap=0.05)
ALL = {**MODELS, **CATALOGUE}
RIVALS = ("gaylord-1", "chou", "ferraresi")
LOADS = ((0.0, 0.15), (0.05, 0.15), (0.0,))


def measure(model, *, noise=0.0, seed=0, options=LOADS):
    """Simulate what the model can hold: 12 pressures under two loads, or without load."""
    for loads in options:
        pressure = np.repeat(np.linspace(0.15, 0.8, 12), len(loads))
        load = np.tile(loads, 12)
        try:
            contraction = model.contraction(pressure, load)
        except BozziniError:
            continue
        error = noise * np.random.default_rng(seed).normal(size=pressure.size)
        return Measurements(pressure=pressure, contraction=contraction + error, load=load)
    raise AssertionError(model.name)


def make(name):
    """Build a model with constants off those that a fit starts from, if it has an answer so."""
    kind = ALL[name]
    if name in MODELS:
        return kind(MUSCLE)
    ways = itertools.product(LOADS, (1.1, 0.95, 1.0), (0.2, 0.02, 0.002, 0.0))
    for loads, factor, other in ways:
        given = dict(kind.guess_parameters(MUSCLE))
        for item in kind.card.fitted:
            if item.name in given:
                low, high = item.bounds
                value = factor * given[item.name]
                if value == 0.0 and item.default is None:
                    value = other
                given[item.name] = min(max(value, low), high)
        try:
            model = kind(MUSCLE, **given)
            measure(model, options=[loads])
        except (InputError, AssertionError) as error:
            if isinstance(error, MissingLawError) and other == 0.0:
                raise
            continue
        return model
    raise AssertionError(name)


@pytest.mark.parametrize("name", ALL)
def test_data_of_a_model_rank_it_first_or_what_fits_as_well(name):
    try:
        data = measure(make(name))
    except MissingLawError as error:
        ranking = rank_models(MUSCLE, measure(make("chou")), models={name: ALL[name]}, folds=0)
        assert not ranking.models
        assert "it is in" in ranking.refusals[name] or "they are in" in ranking.refusals[name]
        assert str(error).startswith(f"the model {name} must be given")
        return
    names = dict.fromkeys((*RIVALS, name))
    ranking = rank_models(MUSCLE, data, models={each: ALL[each] for each in names}, folds=0)
    order = [entry.name for entry in ranking.models]
    assert name in order, ranking.refusals
    for entry in ranking.models[: order.index(name) + 1]:
        assert entry.score.rmse < 1e-5 * data.largest_contraction


def test_noise_does_not_hide_the_truth():
    names = ("gaylord-1", "chou", "kothera-balance", "andrikopoulos", "doric", "quadratic-strain")
    models = {name: CATALOGUE[name] for name in names}
    data = measure(make("kothera-balance"), noise=0.05)
    ranking = rank_models(MUSCLE, data, models=models)
    best = ranking.models[0]
    assert best.name == "kothera-balance"
    assert best.score.rmse == pytest.approx(0.05, rel=0.4)
    assert best.validation_error == pytest.approx(0.05, rel=0.4)
    assert [entry.aicc for entry in ranking.models] == sorted(e.aicc for e in ranking.models)
    for value in ("bic", "validation_error"):
        assert min(ranking.models, key=lambda entry: getattr(entry, value)) is best
    # most constants, least error: that is not what it goes by
    assert min(ranking.models, key=lambda entry: entry.score.rmse).name == "quadratic-strain"


@pytest.mark.parametrize(
    ("criterion", "value"), [("aicc", "aicc"), ("bic", "bic"), ("cv", "validation_error")]
)
def test_every_criterion_sorts(criterion, value):
    models = {name: CATALOGUE[name] for name in ("gaylord-1", "chou", "doric", "ferraresi")}
    data = measure(make("chou"), noise=0.05)
    ranking = rank_models(MUSCLE, data, models=models, criterion=criterion)
    values = [getattr(entry, value) for entry in ranking.models]
    assert values == sorted(values)


@pytest.fixture(scope="module")
def ranking():
    names = ("energy", "gaylord-1", "gaylord-2", "chou", "andrikopoulos", "tondu-lopez", "wang")
    data = measure(make("chou"), noise=0.05)
    return rank_models(MUSCLE, data, models={name: ALL[name] for name in names})


def test_scores_are_those_of_a_fit_alone(ranking):
    for entry in ranking.models:
        if entry.calibration is None:
            assert entry.parameters == 0
            continue
        alone = calibrate(ALL[entry.name], MUSCLE, ranking.data)
        assert alone.free == entry.calibration.free
        assert len(alone.free) == entry.parameters
        assert entry.calibration.estimates == pytest.approx(alone.estimates)
        found = compare_models(
            {entry.name: alone.fitted}, ranking.data, fitted={entry.name: len(alone.free)}
        )
        assert entry.score.standard_error == pytest.approx(found.scores[0].standard_error)
    assert sum(entry.weight for entry in ranking.models) == pytest.approx(1.0)


def test_models_that_say_the_same_are_told(ranking):
    same = {entry.name: entry.same_as for entry in ranking.models}
    assert same["gaylord-1"] == ""
    assert same["gaylord-2"] == "gaylord-1"
    assert same["chou"] == ""


def test_what_the_data_do_not_tell_is_held(ranking):
    held = {entry.name: entry.held for entry in ranking.models}
    assert "no effect" in held["tondu-lopez"]["friction"]  # no row has a direction
    assert "cannot tell it" in held["andrikopoulos"]["test_pressure"]  # only a ratio matters
    unloaded = ranking.data.select(ranking.data.load == 0.0)
    alone = calibrate(CATALOGUE["andrikopoulos"], MUSCLE, unloaded)
    assert alone.free == ("largest_contraction",)  # a force of any size is none at all


def test_friction_is_fitted_with_both_directions():
    truth = CATALOGUE["tondu-lopez"](MUSCLE, kappa1=0.0, kappa2=1.1, friction=2e-3)
    pressure = np.tile(np.linspace(0.15, 0.8, 10), 2)
    direction = np.repeat(["inflating", "deflating"], 10)
    contraction = truth.contraction(pressure, 0.1, direction=direction)
    data = Measurements(pressure=pressure, contraction=contraction, load=0.1, direction=direction)
    found = calibrate(CATALOGUE["tondu-lopez"], MUSCLE, data)
    assert found.estimates["friction"] == pytest.approx(2e-3, rel=1e-5)
    assert found.estimates["kappa2"] == pytest.approx(1.1, rel=1e-5)
    scale = CATALOGUE["davis-caldwell"]
    lame = calibrate(scale, MUSCLE, data)
    assert "strand_poisson_ratio" in lame.held["friction"]
    whole = calibrate(partial(scale, strand_poisson_ratio=0.4), MUSCLE, data)
    assert "friction" in whole.free
    assert whole.sigma < lame.sigma


def test_linear_constants_are_found_to_the_last_digits():
    kind = CATALOGUE["quadratic-strain"]
    truth = make("quadratic-strain")
    found = calibrate(kind, MUSCLE, measure(truth))
    for name, value in truth.parameters.items():
        assert found.estimates[name] == pytest.approx(value, rel=1e-8), name


def test_constants_that_are_known_are_not_fitted():
    data = measure(make("tondu-lopez"))
    kind = partial(CATALOGUE["tondu-lopez"], kappa2=1.1)
    found = calibrate(kind, MUSCLE, data)
    assert found.free == ("kappa1",)
    assert found.fitted.parameters["kappa2"] == 1.1
    with pytest.raises(InputError, match="'kappa2' is not known: use "):
        calibrate(kind, MUSCLE, data, free=("kappa2",))
    with pytest.raises(InputError, match="start is given for kappa2: .* are kappa1"):
        calibrate(kind, MUSCLE, data, start={"kappa2": 1.0})
    begun = calibrate(kind, MUSCLE, data, start={"kappa1": 0.1})
    assert begun.estimates["kappa1"] == pytest.approx(found.estimates["kappa1"], abs=1e-6)
    narrow = calibrate(CATALOGUE["tondu-lopez"], MUSCLE, data, free=("kappa1", "kappa2"),
                       bounds={"kappa2": (0.5, 1.0)})  # fmt: skip
    assert narrow.estimates["kappa2"] == pytest.approx(1.0)
    assert any("kappa2 is at its bound" in line for line in narrow.warnings)


def test_no_constant_has_the_name_of_a_field():
    for kind in CATALOGUE.values():
        assert not set(kind.card.keywords) & set(vars(MUSCLE)), kind.card.name


def test_folds_are_a_partition_that_keeps_repeats_together():
    pressure = np.repeat(np.linspace(0.1, 0.8, 11), 3)
    data = Measurements(pressure=pressure, contraction=10.0 * pressure)
    parts = split_rows(data, folds=4, seed=3)
    assert np.sum(parts, axis=0).tolist() == [1] * 33
    assert count_states(data) == 11
    for part in parts:
        assert 6 <= part.sum() <= 9
        assert not set(pressure[part]) & set(pressure[~part])
    again, other = (split_rows(data, folds=4, seed=seed) for seed in (3, 4))
    assert np.array_equal(parts, again)
    assert not np.array_equal(parts, other)


def test_cross_validation_is_the_error_of_rows_that_the_fit_did_not_see():
    data = measure(make("chou"), noise=0.1)
    parts = split_rows(data, folds=6)
    seen = []

    def fit(rows):
        seen.append(len(rows))
        return make("chou")

    found = cross_validate(fit, data, parts)
    assert seen == [len(data) - part.sum() for part in parts]
    error = make("chou").contraction(data.pressure, data.load) - data.contraction
    assert found.error == pytest.approx(np.sqrt(np.mean(error**2)))
    assert found.errors[0] == pytest.approx(np.sqrt(np.mean(error[parts[0]] ** 2)))

    def refuse(rows):
        raise InputError("not today")

    lost = cross_validate(refuse, data, parts)
    assert lost.error == np.inf
    assert lost.reason == "not today"


def test_ranking_tells_its_progress_and_is_the_same_again():
    data = measure(make("chou"), noise=0.05)
    models = {name: CATALOGUE[name] for name in ("chou", "itto-b")}
    told = []
    one = rank_models(MUSCLE, data, models=models, seed=5, progress=lambda *now: told.append(now))
    other = rank_models(MUSCLE, data, models=models, seed=5)
    assert [fraction for _, fraction in told] == [0.0, 0.5, 1.0]
    assert one.format_table() == other.format_table()


def test_fields_can_be_chosen():
    data = measure(make("kothera-balance"))
    models = {"kothera-balance": CATALOGUE["kothera-balance"], "chou": CATALOGUE["chou"]}
    both = rank_models(MUSCLE, data, models=models, fields=("modulus", "dead_length"), folds=0)
    free = {entry.name: entry.calibration.free for entry in both.models}
    assert free == {"kothera-balance": ("modulus", "dead_length"), "chou": ("dead_length",)}
    none = rank_models(MUSCLE, data, models=models, fields=(), folds=0)
    assert all(entry.calibration is None for entry in none.models)


def test_few_rows_and_a_single_state():
    data = measure(make("chou"))
    few = data.select([0, 7, 14, 21])
    ranking = rank_models(MUSCLE, few, models={n: CATALOGUE[n] for n in ("chou", "itto-b")})
    assert ranking.folds == 4
    assert ranking.models[0].name == "chou"
    assert ranking.models[1].aicc == np.inf  # 4 rows, 2 constants and the variance
    assert ranking.models[1].weight == 0.0
    assert "none" in ranking.format_table()
    one = rank_models(MUSCLE, data.select([5]), models={"chou": CATALOGUE["chou"]})
    assert one.folds == 0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"models": {}}, "0 models"),
        ({"criterion": "best"}, "criterion is 'best': it must be one of aicc, bic, cv"),
        ({"folds": 1}, "folds is 1: it must be 2 or more"),
        ({"folds": -1}, "folds is -1"),
        ({"folds": 99}, "folds is 99: there are 24 different"),
        ({"folds": 0, "criterion": "cv"}, "to rank by the rows left out"),
        ({"seed": -1}, "seed is -1"),
    ],
)
def test_bad_questions(change, said):
    with pytest.raises(InputError, match=said):
        options = {"models": {"chou": CATALOGUE["chou"]}, **change}
        rank_models(MUSCLE, measure(make("chou")), **options)

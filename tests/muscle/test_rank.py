"""Ranking: data that a model made rank it first, or one that describes them as well."""

from __future__ import annotations

import dataclasses
import json
from functools import partial

import numpy as np
import pytest

from bozzini.checks import list_quantities
from bozzini.errors import BozziniError, InputError, MissingLawError
from bozzini.muscle import (
    MODELS,
    FitOptions,
    Measurements,
    Muscle,
    RankOptions,
    calibrate,
    compare_models,
    preset,
    rank,
)
from bozzini.muscle.muscle_fit import fit_task
from bozzini.muscle.problem import FitData, find_states
from bozzini.muscle.ranking import cross_validate, split_rows
from tests.muscle.models.catalogue import SURVEY

MUSCLE = preset("effector-45", inner_radius=0.4, gap=0.05)
ALL = dict(MODELS)
RIVALS = ("gaylord-1", "chou", "ferraresi")
LOADS = ((0.0, 0.15), (0.05, 0.15), (0.0,))
SLOW = pytest.mark.slow
QUICK = {"gaylord-1", "chou", "ferraresi", "braid-tension", "tondu-lopez"}
LAWLESS = {name for name, kind in SURVEY.items() if kind.card.laws} - {"hocking-2"}
FEW = ("gaylord-1", "gaylord-2", "chou")
MANY = (*FEW, "energy", "andrikopoulos", "tondu-lopez", "wang")
EACH = [name if name in QUICK | LAWLESS else pytest.param(name, marks=SLOW) for name in ALL]


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


def make(name, seed=0):
    """Build a model whose constants are drawn about those that a fit starts from.

    They are drawn closer and closer until the model has an answer. None is 0, but those that
    need others beside them.
    """
    kind = ALL[name]
    if name not in SURVEY:
        return kind(MUSCLE)
    random = np.random.default_rng(seed)
    guess = kind.guess_parameters(MUSCLE)
    needed = (*(x for x in kind.card.parameters if x.name not in guess), *kind.card.laws)
    needy = {item.only_with for item in needed}
    for spread in 0.15 * 0.85 ** np.arange(60):
        given = dict(guess)
        for item in kind.card.fitted:
            if item.name in given and item.name not in needy:
                change = spread * random.uniform(0.5, 1.0) * random.choice([-1.0, 1.0])
                value = given[item.name] * (1.0 + change) if given[item.name] else change
                low, high = item.bounds
                given[item.name] = float(np.clip(abs(value) if low >= 0.0 else value, low, high))
        try:
            model = kind(MUSCLE, **given)
            data = measure(model)
        except MissingLawError:
            raise
        except (InputError, AssertionError):
            continue
        if data.contraction.max() > 0.1:
            return model
    raise AssertionError(name)


@pytest.mark.parametrize("name", EACH)
def test_data_of_a_model_rank_it_first_or_what_fits_as_well(name):
    try:
        data = measure(make(name))
    except MissingLawError as error:
        ranking = rank(
            measure(make("chou")), MUSCLE, models={name: ALL[name]}, options=RankOptions(folds=0)
        )
        assert not ranking.models
        assert "it is in" in ranking.refusals[name] or "they are in" in ranking.refusals[name]
        assert str(error).startswith(f"the model {name} must be given")
        return
    names = dict.fromkeys((*RIVALS, name))
    ranking = rank(
        data, MUSCLE, models={each: ALL[each] for each in names}, options=RankOptions(folds=0)
    )
    order = [entry.name for entry in ranking.models]
    assert name in order, ranking.refusals
    least = 1e-9 * data.largest_contraction
    assert ranking.models[order.index(name)].score.rmse < 100.0 * least
    for entry in ranking.models[: order.index(name)]:
        assert entry.score.rmse <= least


@pytest.mark.slow
@pytest.mark.parametrize("name", ["quartic-strain"])
def test_models_that_follow_any_curve_do_not_hide_the_truth(name):
    """Eight constants come to within 1e-5 mm of a curve, which is not none."""
    data = measure(make(name))
    names = ("pressure-stiffening", "quartic-strain")
    ranking = rank(
        data, MUSCLE, models={each: ALL[each] for each in names}, options=RankOptions(folds=0)
    )
    first, second = ranking.models[:2]
    assert first.name == name
    assert first.score.rmse < 1e-9 * data.largest_contraction < second.score.rmse


@pytest.mark.parametrize("offset", [0.2, pytest.param(0.4, marks=SLOW)])
def test_a_constant_that_tells_only_in_some_places_is_not_held(offset):
    """Without load the dead band matters only if it reaches into the measured pressures."""
    kind = ALL["de-volder"]
    guess = kind.guess_parameters(MUSCLE)
    data = measure(kind(MUSCLE, **{**guess, "pressure_offset": offset}), options=((0.0,),))
    assert (data.contraction == 0.0).any() and (data.contraction > 0.0).any()
    found = calibrate(kind, MUSCLE, data=data, options=FitOptions(force=True))
    assert "pressure_offset" in found.free
    assert np.abs(found.residuals).max() < 1e-6


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_a_constant_that_starts_next_to_zero_is_told_all_the_same():
    data = measure(make("meller"))
    found = calibrate(ALL["de-volder"], MUSCLE, data=data, options=FitOptions(force=True))
    errors = found.standard_errors
    lost = {name for name, error in errors.items() if not np.isfinite(error)}
    assert len(lost) < len(errors) and not any(map(np.isnan, errors.values()))
    assert all(any(name in line for line in found.warnings) for name in lost)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0])
def test_noise_does_not_hide_many_constants(seed):
    """The constants that look nearest by one step of Newton's method have no answer at a row."""
    muscle, kind = preset("effector-45"), ALL["quartic-strain"]
    truth = {name: 1.1 * value for name, value in kind.guess_parameters(muscle).items()}
    data = measure(kind(muscle, **truth), noise=0.05, seed=seed)
    found = calibrate(kind, muscle, data=data, options=FitOptions(force=True))
    assert found.converged
    assert np.sqrt(np.mean(found.residuals**2)) < 0.06


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truth", "name", "spreads"),
    [("kothera-balance", "hocking-1", ()), ("energy", "itto-b", (0.0, 0.5, 0.5))],
)
def test_no_other_start_is_better(truth, name, spreads):
    """On data of another model there are several minima; the guess is one of the starts."""
    data = measure(make(truth), noise=0.02)
    kind = ALL[name]
    found = calibrate(kind, MUSCLE, data=data, options=FitOptions(force=True))
    guess = {key: kind.guess_parameters(MUSCLE)[key] for key in found.free if key != "modulus"}
    random = np.random.default_rng(3)
    for spread in spreads:
        start = {
            key: (value or spread * random.normal()) * (1.0 + spread * random.uniform(-1.0, 1.0))
            for key, value in guess.items()
        }
        try:
            other = calibrate(
                kind,
                MUSCLE,
                data=data,
                free=found.free,
                options=FitOptions(start=start, force=True),
            )
        except InputError:
            continue
        assert other.sigma > 0.99 * found.sigma
    assert found.converged


def test_a_row_without_an_answer_is_counted_and_drops_no_model():
    data = measure(make("chou"))
    heavy = dataclasses.replace(data, load=np.where(np.arange(24) == 5, 1e3, data.load))
    found = calibrate(ALL["tondu-lopez"], MUSCLE, data=heavy)
    assert found.answered.tolist() == [row != 5 for row in range(24)]
    assert any("23 of 24 rows; row 6: load is 1000 N" in x for x in found.warnings)
    models = {name: ALL[name] for name in ("chou", "tondu-lopez")}
    ranking = rank(heavy, MUSCLE, models=models, options=RankOptions(folds=0))
    assert [entry.name for entry in ranking.models][0] == "chou"
    span = np.ptp(data.contraction)  # or the largest, which is more
    for entry in ranking.models:
        assert "23 of 24 rows" in entry.doubt
        assert entry.score.rmse >= span / np.sqrt(24) * (1 - 1e-12)


def test_no_model_wins_by_its_gaps():
    """The fewer rows a model has answers for, the worse: each missing one counts as the span."""
    data = measure(make("chou"), noise=0.05)
    last = []
    for count in range(4):
        heavy = np.where(np.arange(24) < count, 1e3, data.load)
        ranking = rank(
            dataclasses.replace(data, load=heavy),
            MUSCLE,
            models={"chou": ALL["chou"]},
            options=RankOptions(folds=2),
        )
        last.append((ranking.models[0].aicc, ranking.models[0].validation_error))
    assert last == sorted(last)
    assert [b for _, b in last] == sorted(b for _, b in last)


@pytest.mark.slow
def test_a_fold_that_comes_nearer_to_all_rows_is_begun_from(monkeypatch):
    """The fit to all rows is spoilt here: it stops at a minimum that is not the smallest."""
    data = measure(make("energy"), noise=0.02)
    spoilt = []

    def spoil(kind, task, *, options, **rest):
        options = dataclasses.replace(options, start={"kappa1": 0.0, "kappa2": 0.02})
        spoilt.append(fit_task(kind, task, options=options, **rest))
        return spoilt[0]

    monkeypatch.setattr("bozzini.muscle.ranking.fit_task", spoil)
    models = {"itto-b": ALL["itto-b"]}
    best = rank(data, MUSCLE, models=models).models[0].calibration
    assert best.sigma < spoilt[0].sigma


@pytest.mark.parametrize("more", [(), pytest.param(("andrikopoulos", "doric"), marks=SLOW)])
def test_noise_does_not_hide_the_truth(more):
    names = ("gaylord-1", "chou", "kothera-balance", *more, "quadratic-strain")
    models = {name: MODELS[name] for name in names}
    data = measure(make("kothera-balance"), noise=0.05)
    ranking = rank(data, MUSCLE, models=models, options=RankOptions(folds=5 if more else 2))
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
    models = {name: MODELS[name] for name in ("gaylord-1", "chou", "ferraresi")}
    data = measure(make("chou"), noise=0.05)
    ranking = rank(data, MUSCLE, models=models, options=RankOptions(criterion=criterion, folds=2))
    values = [getattr(entry, value) for entry in ranking.models]
    assert values == sorted(values)


@pytest.fixture(scope="module", params=[FEW, pytest.param(MANY, marks=SLOW)])
def ranking(request):
    data = measure(make("chou"), noise=0.05)
    return rank(
        data, MUSCLE, models={n: ALL[n] for n in request.param}, options=RankOptions(folds=2)
    )


def test_scores_are_those_of_a_fit_alone(ranking):
    for entry in ranking.models:
        if entry.calibration is None:
            assert entry.parameters == 0
            continue
        alone = calibrate(ALL[entry.name], MUSCLE, data=ranking.data)
        assert alone.free == entry.calibration.free
        assert len(alone.free) == entry.parameters
        assert entry.calibration.estimates == pytest.approx(alone.estimates)
        found = compare_models(
            {entry.name: alone.fitted}, ranking.data, fitted={entry.name: len(alone.free)}
        )
        assert entry.score.standard_error == pytest.approx(found.scores[0].standard_error)


def test_plain_values_are_those_of_the_entries(ranking):
    plain = ranking.to_dict()
    json.dumps(plain, allow_nan=False)
    assert plain["refusals"] == ranking.refusals and plain["converged"]
    assert plain["residual"] == min(row["rmse_mm"] for row in plain["models"])
    for entry, row in zip(ranking.models, plain["models"], strict=True):
        assert (row["model"], row["weight"]) == (entry.name, entry.weight)
        if entry.calibration is not None:
            fit = entry.calibration.to_dict()
            assert {name: each["value"] for name, each in fit["estimates"].items()} == row["fitted"]
            assert fit["residual"] == fit["sigma_mm"] and fit["reason"] == row["fit_reason"]


def test_a_curve_counts_once_in_the_weights(ranking):
    entries = {entry.name: entry for entry in ranking.models}
    once = [entry for entry in ranking.models if entry.name != "gaylord-2"]
    assert entries["gaylord-2"].weight == entries["gaylord-1"].weight
    assert sum(entry.weight for entry in once) == pytest.approx(1.0)
    alone = rank(
        ranking.data,
        MUSCLE,
        models={e.name: ALL[e.name] for e in once},
        options=RankOptions(folds=0),
    )
    for entry in alone.models:
        assert entry.weight == pytest.approx(entries[entry.name].weight, rel=1e-6)
    assert "(" in next(x for x in ranking.format_table().splitlines() if x.startswith("gaylord-2"))


def test_models_that_say_the_same_are_told(ranking):
    same = {entry.name: entry.same_as for entry in ranking.models}
    assert same["gaylord-1"] == ""
    assert same["gaylord-2"] == "gaylord-1"
    assert same["chou"] == ""


@pytest.mark.slow
def test_what_the_data_do_not_tell_is_held():
    data = measure(make("chou"), noise=0.05)
    names = ("tondu-lopez", "andrikopoulos")
    held = {name: calibrate(MODELS[name], MUSCLE, data=data).held for name in names}
    assert "no effect" in held["tondu-lopez"]["friction"]  # no row has a direction
    assert "do not distinguish it" in held["andrikopoulos"]["test_pressure"]  # only a ratio matters
    unloaded = data.select(data.load == 0.0)
    alone = calibrate(MODELS["andrikopoulos"], MUSCLE, data=unloaded)
    assert alone.free == ("largest_contraction",)  # a force of any size is none at all


@pytest.fixture(scope="module")
def both_ways():
    """Measurements of a muscle with friction, up and down."""
    truth = MODELS["tondu-lopez"](MUSCLE, kappa1=0.0, kappa2=1.1, friction=2e-3)
    pressure = np.tile(np.linspace(0.15, 0.8, 10), 2)
    direction = np.repeat(["inflating", "deflating"], 10)
    contraction = truth.contraction(pressure, 0.1, direction=direction)
    return Measurements(pressure=pressure, contraction=contraction, load=0.1, direction=direction)


def test_friction_is_fitted_with_both_directions(both_ways):
    found = calibrate(MODELS["tondu-lopez"], MUSCLE, data=both_ways)
    assert found.estimates["friction"] == pytest.approx(2e-3, rel=1e-5)
    assert found.estimates["kappa2"] == pytest.approx(1.1, rel=1e-5)


@pytest.mark.slow
def test_friction_needs_the_constants_that_it_goes_with(both_ways):
    scale = MODELS["davis-caldwell"]
    lame = calibrate(scale, MUSCLE, data=both_ways)
    assert "strand_poisson_ratio" in lame.held["friction"]
    whole = calibrate(partial(scale, strand_poisson_ratio=0.4), MUSCLE, data=both_ways)
    assert "friction" in whole.free
    assert whole.sigma < lame.sigma


def test_linear_constants_are_found_to_the_last_digits():
    kind = MODELS["quadratic-strain"]
    truth = make("quadratic-strain")
    found = calibrate(kind, MUSCLE, data=measure(truth))
    for name, value in truth.parameters.items():
        assert found.estimates[name] == pytest.approx(value, rel=1e-8), name


def test_constants_that_are_known_are_not_fitted():
    data = measure(make("tondu-lopez"))
    kind = partial(MODELS["tondu-lopez"], kappa2=1.1)
    found = calibrate(kind, MUSCLE, data=data)
    assert found.free == ("kappa1",)
    assert found.fitted.parameters["kappa2"] == 1.1
    with pytest.raises(InputError, match="'kappa2' is given, so it cannot be free: use .* kappa1"):
        calibrate(kind, MUSCLE, data=data, free=("kappa2",))
    with pytest.raises(InputError, match="start is given for kappa2: .* are kappa1"):
        calibrate(kind, MUSCLE, data=data, options=FitOptions(start={"kappa2": 1.0}))
    begun = calibrate(kind, MUSCLE, data=data, options=FitOptions(start={"kappa1": 0.1}))
    assert begun.estimates["kappa1"] == pytest.approx(found.estimates["kappa1"], abs=1e-6)


@pytest.mark.slow
def test_an_estimate_at_its_bound_is_warned_of():
    data = measure(make("tondu-lopez"))
    options = FitOptions(bounds={"kappa2": (0.5, 0.7)})
    free = ("kappa1", "kappa2")
    narrow = calibrate(MODELS["tondu-lopez"], MUSCLE, data=data, free=free, options=options)
    assert narrow.estimates["kappa2"] == pytest.approx(0.7)
    assert any("kappa2 is at its bound" in line for line in narrow.warnings)


def test_no_constant_has_the_name_of_a_field():
    for kind in SURVEY.values():
        assert not set(kind.card.keywords) & set(list_quantities(Muscle)), kind.card.name


def test_folds_are_a_partition_that_keeps_repeats_together():
    pressure = np.repeat(np.linspace(0.1, 0.8, 11), 3)
    data = Measurements(pressure=pressure, contraction=10.0 * pressure)
    task = FitData(muscle=MUSCLE, data=data)
    parts = list(split_rows(task, folds=4, seed=3).values())
    assert np.sum(parts, axis=0).tolist() == [1] * 33
    assert find_states(task)[0] == 11
    for part in parts:
        assert 6 <= part.sum() <= 9
        assert not set(pressure[part]) & set(pressure[~part])
    again, other = (list(split_rows(task, folds=4, seed=seed).values()) for seed in (3, 4))
    assert np.array_equal(parts, again)
    assert not np.array_equal(parts, other)


def test_cross_validation_is_the_error_of_rows_that_the_fit_did_not_see():
    data = measure(make("chou"), noise=0.1)
    task = FitData(muscle=MUSCLE, data=data)
    folds = split_rows(task, folds=6)
    parts = list(folds.values())
    seen = []

    def fit(rows):
        seen.append(len(rows.data))
        return (lambda part: make("chou")), len(seen) != 2

    found = cross_validate(fit, task, folds)
    assert seen == [len(data) - part.sum() for part in parts]
    error = make("chou").contraction(data.pressure, data.load) - data.contraction
    assert found.error == pytest.approx(np.sqrt(np.mean(error**2)))
    assert found.errors[0] == pytest.approx(np.sqrt(np.mean(error[parts[0]] ** 2)))
    assert found.unsettled == 1

    def refuse(rows):
        raise InputError("not today")

    lost = cross_validate(refuse, task, folds)
    assert lost.error == np.inf
    assert lost.reason == "not today"


def test_ranking_tells_its_progress_and_is_the_same_again():
    data = measure(make("chou"), noise=0.05)
    models = {name: MODELS[name] for name in ("chou", "itto-b")}
    told = []
    one = rank(
        data,
        MUSCLE,
        models=models,
        progress=lambda *now: told.append(now),
        options=RankOptions(fit=FitOptions(seed=5), folds=2),
    )
    other = rank(data, MUSCLE, models=models, options=RankOptions(fit=FitOptions(seed=5), folds=2))
    assert [fraction for _, fraction in told] == [0.0, 0.5, 1.0]
    assert one.format_table() == other.format_table()


def test_fields_can_be_chosen():
    data = measure(make("kothera-balance"))
    models = {"kothera-balance": MODELS["kothera-balance"], "chou": MODELS["chou"]}
    both = rank(
        data, MUSCLE, models=models, options=RankOptions(fields=("modulus", "dead_length"), folds=0)
    )
    free = {entry.name: entry.calibration.free for entry in both.models}
    assert free == {"kothera-balance": ("modulus", "dead_length"), "chou": ("dead_length",)}
    none = rank(data, MUSCLE, models=models, options=RankOptions(fields=(), folds=0))
    assert all(entry.calibration is None for entry in none.models)


def test_few_rows_and_a_single_state():
    data = measure(make("chou"))
    few = data.select([0, 7, 14, 21])
    ranking = rank(few, MUSCLE, models={n: MODELS[n] for n in ("chou", "itto-b")})
    assert ranking.folds == 4
    assert ranking.models[0].name == "chou"
    assert ranking.models[1].aicc == np.inf  # 4 rows, 2 constants and the variance
    assert ranking.models[1].weight == 0.0
    assert "none" in ranking.format_table()
    one = rank(data.select([5]), MUSCLE, models={"chou": MODELS["chou"]})
    assert one.folds == 0
    with pytest.raises(InputError, match="the rows are of 1 state: .* 2 or more"):
        rank(data.select([5]), MUSCLE, options=RankOptions(criterion="cv"))


@pytest.mark.parametrize("names", [("gaylord-1", "chou"), ("chou", "gaylord-1")])
def test_without_any_aicc_it_goes_by_bic_and_says_so(names):
    two = measure(make("chou"), noise=0.05).select([8, 15])
    ranking = rank(
        two, MUSCLE, models={name: ALL[name] for name in names}, options=RankOptions(folds=0)
    )
    assert [entry.name for entry in ranking.models] == ["chou", "gaylord-1"]
    assert ranking.models[0].score.rmse < 0.1 < ranking.models[1].score.rmse
    (note,) = ranking.notes
    assert note.startswith("no AICc for chou, gaylord-1: it needs 3 rows more than")
    assert note.endswith("there are 2 row(s); the models are ranked by BIC instead")
    assert note in ranking.format_table()


def test_doubts_are_marked():
    data = measure(make("chou"), noise=0.05)
    models = {"chou": ALL["chou"], "itto-b": ALL["itto-b"]}
    fine = rank(data, MUSCLE, models=models, options=RankOptions(criterion="cv", folds=3))
    assert not fine.notes
    assert not any(entry.doubt for entry in fine.models)
    first, second = fine.models
    lost = dataclasses.replace(first.validation, reason="not today", unsettled=2)
    stopped = dataclasses.replace(second.calibration, converged=False)
    entries = (
        dataclasses.replace(first, validation=lost),
        dataclasses.replace(second, calibration=stopped),
    )
    doubtful = dataclasses.replace(fine, models=entries)
    assert doubtful.notes == (
        f"{first.name}: no error of the rows left out (it comes last, by BIC): not today",
    )
    lines = doubtful.format_table().splitlines()
    assert lines[1].endswith("2 of the folds not converged")
    assert " none " in lines[1]
    assert lines[2].endswith("not converged")
    assert lines[3] == doubtful.notes[0]


def test_models_are_given_by_name_or_by_class():
    pressure = np.linspace(0.2, 0.8, 6)
    data = Measurements(
        pressure=pressure, contraction=MODELS["energy"](MUSCLE).contraction(pressure)
    )
    options = RankOptions(folds=0)
    by_name = rank(data, MUSCLE, models=["gaylord-1", "chou"], options=options)
    kinds = {name: MODELS[name] for name in ("gaylord-1", "chou")}
    by_class = rank(data, MUSCLE, models=kinds, options=options)
    assert by_name.to_dict() == by_class.to_dict() and len(by_name.models) == 2

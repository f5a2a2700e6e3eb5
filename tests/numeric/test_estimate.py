"""One engine for fits: what is declared is kept, and what comes back can be trusted."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.errors import InputError
from bozzini.numeric.estimate import EstimateOptions, FitParameter, estimate
from bozzini.numeric.least_squares import LeastSquares, sum_loss, weigh

RUNS, ROWS = 8, 40
LABELS = np.repeat([f"run {k + 1}" for k in range(RUNS)], ROWS)
TIME = np.tile(np.linspace(0.0, 3.0, ROWS), RUNS)
TRUTH = {"height": 2.0, "rate": 1.3, "floor": 0.5}
FREE = (
    FitParameter("height", 1.5, low=0.0, high=10.0),
    FitParameter("rate", 1.0, low=0.0, high=10.0),
    FitParameter("floor", 0.4),
)


def decay(values, time=TIME):
    return values["height"] * np.exp(-values["rate"] * time) + values["floor"]


def miss(measured, model=decay):
    return lambda values, rows: (model(values) - measured)[rows]


def measure(seed=0, alike=0.03):
    """Return the truth with errors of rows, and with some that all rows of a run share."""
    random = np.random.default_rng(seed)
    rows, runs = random.normal(size=TIME.size), random.normal(size=RUNS)
    return decay(TRUTH) + 0.02 * rows + alike * np.repeat(runs, ROWS)


DRAWS = 60


def test_intervals_hold_the_truth_where_rows_of_a_run_err_alike():
    hits, alone, truth = 0, 0, np.array(list(TRUTH.values()))
    for seed in range(DRAWS):
        found = estimate(miss(measure(seed, alike=0.1)), FREE, labels=LABELS)
        assert found.converged
        hits += np.prod(found.intervals[2] - truth[2]) <= 0.0
        rows = 1.96 * found.residual * np.sqrt(np.diag(found.known.inverse))
        alone += abs(found.point - truth)[2] <= rows[2]
    assert hits >= 0.95 * DRAWS - 3.0 * np.sqrt(DRAWS * 0.95 * 0.05)  # less three standard errors
    assert alone < 0.7 * DRAWS  # of intervals by rows as if independent


@pytest.mark.parametrize("groups", [1, 3, 5])
def test_few_groups_that_differ_are_warned_of_as_their_intervals_are_too_short(groups):
    labels, hits = np.repeat([f"group {k}" for k in range(groups)], 30), 0
    for seed in range(DRAWS):
        random = np.random.default_rng(seed)
        measured = 0.05 * random.normal(size=labels.size) + random.normal(size=groups).repeat(30)
        level = estimate(
            lambda values, rows, measured=measured: (values["level"] - measured)[rows],
            [FitParameter("level", 0.0)],
            labels=labels,
        )
        hits += np.prod(level.intervals[0]) <= 0.0
    assert (hits > 0.85 * DRAWS) == (groups == 5)
    warned = any("3 groups do not tell how groups differ" in text for text in level.warnings)
    assert warned == (groups == 3)


def test_values_of_groups_are_those_of_separate_fits_if_nothing_is_shared():
    groups = tuple(np.unique(LABELS))
    of_row = np.repeat(np.arange(RUNS), ROWS)
    own = [FitParameter(one.name, one.start, groups=groups) for one in FREE]
    measured = measure(1)

    def model(values):
        return decay({name: value[of_row] for name, value in values.items()})

    found = estimate(miss(measured, model), own, labels=LABELS)
    assert found.names[:2] == ("height[run 1]", "height[run 2]")
    for k, group in enumerate(groups):
        kept = LABELS == group
        alone = estimate(
            lambda values, rows, kept=kept: (decay(values, TIME[kept]) - measured[kept])[rows],
            [FitParameter(one.name, one.start) for one in FREE],
            labels=LABELS[kept],
        )
        assert alone.point == pytest.approx([found.values[name][k] for name in TRUTH], rel=1e-4)


def test_blocks_are_runs_unless_runs_have_values_of_their_own():
    """Two muscles in every run, with a value each, are blocks of no kind."""
    of_row, measured = np.arange(TIME.size) % 2, measure(8)

    def fit(groups, of_row):
        own = FitParameter("floor", 0.4, groups=groups)
        return estimate(
            miss(measured, lambda values: decay({**values, "floor": values["floor"][of_row]})),
            [*FREE[:2], own],
            labels=LABELS,
        )

    found = fit(("left", "right"), of_row)
    assert found.spread.rule == "8 groups, count as independent"
    assert found.names == ("height", "rate", "floor[left]", "floor[right]")
    runs = fit(tuple(np.unique(LABELS)), np.repeat(np.arange(RUNS), ROWS))
    assert "within each of 8 groups" in runs.spread.rule


def test_a_shared_value_is_that_of_all_rows_and_a_fixed_one_is_fixed():
    measured = measure(2)
    fixed = (FREE[0], FitParameter("rate", 1.3, fixed=True), FREE[2])
    found = estimate(miss(measured), fixed, labels=LABELS)
    table = np.stack([np.exp(-1.3 * TIME), np.ones(TIME.size)], axis=1)
    assert found.point == pytest.approx(np.linalg.lstsq(table, measured)[0], rel=1e-6)
    assert found.names == ("height", "floor")
    assert found.values["rate"] == 1.3
    assert found.residual == pytest.approx(np.sqrt(np.mean(found.misfit**2)))


def test_bounds_are_kept_and_named():
    low = (FREE[0], FitParameter("rate", 0.5, low=0.0, high=1.0), FREE[2])
    found = estimate(miss(measure()), low, labels=LABELS)
    assert 1.0 - 1e-6 < found.values["rate"] <= 1.0
    assert found.intervals[1, 1] <= 1.0
    assert "rate is at its bound, where its interval does not hold" in found.warnings
    assert not estimate(miss(measure()), FREE, labels=LABELS).warnings


@pytest.mark.parametrize("loss", ["soft_l1", "huber"])
def test_a_robust_loss_counts_outliers_less(loss):
    measured = measure(3)
    measured[::17] += 2.0
    plain = estimate(miss(measured), FREE, labels=LABELS)
    robust = estimate(miss(measured), FREE, labels=LABELS, options=EstimateOptions(loss=loss))
    truth = np.array(list(TRUTH.values()))
    assert np.linalg.norm(robust.point - truth) < 0.3 * np.linalg.norm(plain.point - truth)
    # At the minimum the influences are orthogonal to the derivatives, which are not scaled.
    scaled = robust.misfit / robust.loss_scale
    influence = weigh(scaled, loss)[0] * scaled
    assert np.abs(influence @ robust.slope).max() < 1e-3 * np.abs(robust.slope).sum(axis=0).max()
    table = np.stack([np.exp(-robust.point[1] * TIME), np.ones(TIME.size)], axis=1)
    assert robust.slope[:, [0, 2]] == pytest.approx(table, abs=1e-4)


def test_rows_left_out_are_missed_as_by_fits_by_hand():
    measured = measure(4)
    line = [FitParameter("at", 1.0), FitParameter("slope", 0.0)]

    def model(values):
        return values["at"] + values["slope"] * TIME

    found = estimate(miss(measured, model), line, labels=LABELS).leave_out()
    table = np.stack([np.ones(TIME.size), TIME], axis=1)
    for label in np.unique(LABELS):
        out = LABELS == label
        by_hand = np.linalg.lstsq(table[~out], measured[~out])[0]
        assert found[out] == pytest.approx((table @ by_hand - measured)[out], abs=1e-6)


def test_a_group_left_out_has_the_mean_of_the_values_of_others():
    groups, of_row = tuple(np.unique(LABELS)), np.repeat(np.arange(RUNS), ROWS)
    measured = measure(5, alike=1.0)
    level = FitParameter("level", 1.0, groups=groups)

    def model(values):
        return values["level"][of_row]

    found = estimate(miss(measured, model), [level], labels=LABELS)
    means = measured.reshape(RUNS, ROWS).mean(axis=1)
    assert found.values["level"] == pytest.approx(means, rel=1e-6)
    others = (means.sum() - means) / (RUNS - 1)
    assert found.leave_out() == pytest.approx(others[of_row] - measured, abs=1e-6)


def test_what_is_not_determined_is_named_and_has_no_interval():
    more = [*FREE, FitParameter("more", 0.1), FitParameter("idle", 1.0)]

    def model(values):
        return decay(values) + values["more"]

    found = estimate(miss(measure(), model), more, labels=LABELS)
    said = " ".join(found.undetermined)
    assert (
        "floor and more: only 1 of these 2 is determined" in said and "idle has no effect" in said
    )
    assert np.isinf(found.deviations[2:]).all() and np.isfinite(found.deviations[:2]).all()
    assert np.isinf(found.intervals[4]).all()


def test_draws_of_blocks_err_as_the_blocks_left_out_do():
    found = estimate(miss(measure(6)), FREE, labels=LABELS)
    drawn = found.resample(40)
    assert drawn.deviations == pytest.approx(found.spread.deviations, rel=0.4)
    assert drawn.rule == found.spread.rule
    again = [found.resample(8, seed=3).covariance for _ in range(2)]
    assert np.array_equal(*again)


def test_points_of_a_row_are_no_more_rows():
    measured = measure(7)
    one = estimate(miss(measured), FREE, labels=LABELS)
    two = estimate(
        lambda values, rows: np.repeat(miss(measured)(values, rows)[:, None], 2, axis=1),
        FREE,
        labels=LABELS,
    )
    assert two.misfit.shape == (TIME.size, 2)
    assert two.spread.deviations == pytest.approx(one.spread.deviations, rel=1e-3)


def test_further_starts_find_the_least_of_several_minima():
    measured = np.sin(7.0 * TIME)
    wave = [FitParameter("frequency", 1.0, low=0.1, high=20.0)]

    def model(values):
        return np.sin(values["frequency"] * TIME)

    caught = estimate(miss(measured, model), wave, labels=LABELS)
    options = EstimateOptions(starts=30)
    found = estimate(miss(measured, model), wave, labels=LABELS, options=options)
    assert caught.residual > 0.5
    assert found.values["frequency"] == pytest.approx(7.0)


def test_where_a_misfit_is_not_finite_no_search_begins_and_none_goes_on():
    rate = [FitParameter("rate", 1.0, low=-5.0, high=5.0)]

    def model(values):
        low = values["rate"] < 0.0
        return np.full(TIME.size, np.nan) if low else np.exp(-values["rate"] * TIME)

    options = EstimateOptions(starts=6)
    found = estimate(miss(model({"rate": 2.0}), model), rate, labels=LABELS, options=options)
    assert found.values["rate"] == pytest.approx(2.0)
    with pytest.raises(InputError, match="a derivative of the misfits is not finite"):
        estimate(
            miss(np.ones(TIME.size), lambda values: np.where(values["rate"] < 1.0, TIME, np.nan)),
            [FitParameter("rate", 1.0 - 1e-12)],
            labels=LABELS,
        )


def test_a_fit_without_time_ends_at_the_best_point_until_then():
    options = EstimateOptions(budget=1e-9)
    found = estimate(miss(measure()), FREE, labels=LABELS, options=options)
    assert not found.converged and found.reason == "stopped: the time of the fit is used up"
    assert found.point == pytest.approx([1.5, 1.0, 0.4])
    with pytest.raises(InputError, match="the budget of 1e-09 s is too short"):
        found.resample(4)


def test_searches_from_several_starts_count_together_and_end_when_one_is_enough():
    tried = []

    def ask(x):
        tried.append(x.copy())
        return np.array([x[0] ** 2 - 4.0, 0.1 * (x[0] - 2.0)])

    search = LeastSquares(misfit=ask, bounds=(-5.0, 5.0), margin=0.1)
    starts = [np.array([-5.0]), np.array([5.0])]
    best = search.search(starts)
    assert best.point == pytest.approx(2.0) and tried[0] == pytest.approx(-4.0)
    assert best.evaluations == sum(search.descend(start).evaluations for start in starts)
    first = search.search(starts, enough=lambda end: True)
    assert first.point == pytest.approx(-2.0, abs=0.1)
    staged = search.search(starts, trial=2)
    assert staged.point == pytest.approx(2.0) and staged.evaluations > 4


@pytest.mark.parametrize("loss", ["linear", "soft_l1", "huber"])
def test_an_influence_is_the_derivative_of_the_loss(loss):
    at, step = np.linspace(-3.0, 3.0, 12), 1e-6
    for x, weight, rate in zip(at, *weigh(at, loss), strict=True):
        ends = np.array([x - step, x + step])
        losses = [sum_loss(ends[[side]], loss) for side in (0, 1)]
        assert np.diff(losses) / (4.0 * step) == pytest.approx(weight * x, abs=1e-6)
        influences = weigh(ends, loss)[0] * ends
        assert np.diff(influences) / (2.0 * step) == pytest.approx(rate, abs=1e-6)


@pytest.mark.parametrize(
    ("parameters", "labels", "said"),
    [
        ([FREE[0], FREE[0]], LABELS, "parameters are height, height: each must have a name"),
        ([FitParameter("rate", 1.0, fixed=True)], LABELS, "no parameter is free"),
        (FREE, LABELS[:3], "3 misfit\\(s\\) are too few for 3 unknown\\(s\\)"),
    ],
)
def test_what_cannot_be_fitted_is_refused(parameters, labels, said):
    with pytest.raises(InputError, match=said):
        estimate(lambda values, rows: np.ones(len(rows)), parameters, labels=labels)


def test_parameters_are_checked():
    with pytest.raises(InputError, match="bounds of a are 2 and 1"):
        FitParameter("a", 1.0, low=2.0, high=1.0)
    with pytest.raises(InputError, match="start of a is 3"):
        FitParameter("a", 3.0, low=0.0, high=1.0)
    with pytest.raises(InputError, match="the misfit of row 2 is not finite"):
        estimate(
            lambda values, rows: np.where(rows == 1, np.nan, values["a"]),
            [FitParameter("a", 1.0)],
            labels=["x"] * 5,
        )
    with pytest.raises(InputError, match="groups of a are x, x: each once"):
        FitParameter("a", 1.0, groups=("x", "x"))
    with pytest.raises(InputError, match="there are 4 misfits of 5 rows"):
        estimate(
            lambda values, rows: values["a"] - rows[1:], [FitParameter("a", 1.0)], labels=["x"] * 5
        )
    alone = estimate(
        lambda values, rows: values["a"] - rows, [FitParameter("a", 1.0)], labels=["x"] * 5
    )
    with pytest.raises(InputError, match="all rows are of the group 'x'"):
        alone.leave_out()

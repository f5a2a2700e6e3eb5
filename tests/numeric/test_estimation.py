"""Intervals of fits: by blocks of rows, as rows that follow each other err alike."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t as student

from bozzini.muscle.terms import fit_creep
from bozzini.numeric.estimation import (
    CONDITION_LIMIT,
    Blocks,
    describe_lost,
    determine,
    find_lost,
    make_blocks,
    measure_spread,
)

DRAWS = 400
TOLERANCE = 3.0 * np.sqrt(0.95 * 0.05 / DRAWS)
"""Three standard errors of a share of 95 % of the draws."""


def draw_errors(rows, correlation, random):
    """Return errors of variance 1, each alike to the one before it: AR(1)."""
    errors = random.normal(size=rows)
    for k in range(1, rows):
        errors[k] = correlation * errors[k - 1] + np.sqrt(1.0 - correlation**2) * errors[k]
    return errors


def cover(correlation, rows=600):
    """Return shares of intervals that hold the truth, of independent rows and of blocks."""
    at = np.linspace(0.0, 3.0, rows)
    table = np.stack([np.ones(rows), at, np.sin(7.0 * at)], axis=1)
    random, hits = np.random.default_rng(1), np.zeros(2)
    blocks = make_blocks([""] * rows)
    inverse = determine(table).inverse
    for _ in range(DRAWS):
        errors = draw_errors(rows, correlation, random)
        off = np.linalg.lstsq(table, errors, rcond=None)[0]
        rest = errors - table @ off
        alone = np.sqrt(np.diag(inverse) * (rest @ rest) / (rows - 3))
        spread = measure_spread(table, rest, blocks)
        hits += [
            np.mean(np.abs(off) <= student.ppf(0.975, rows - 3) * alone),
            np.mean(np.abs(off) <= spread.factor * spread.deviations),
        ]
    return hits / DRAWS


def test_intervals_by_blocks_hold_the_truth_where_rows_err_alike():
    """Errors of AR(1) with 0.9: 35 % with the rows as if independent, 93 % by blocks."""
    alone, blocks = cover(0.9)
    assert alone < 0.5
    assert abs(blocks - 0.95) <= TOLERANCE


def test_intervals_by_blocks_hold_the_truth_where_rows_are_independent():
    alone, blocks = cover(0.0)
    assert abs(alone - 0.95) <= TOLERANCE
    assert abs(blocks - 0.95) <= TOLERANCE


@pytest.mark.parametrize(("correlation", "least"), [(0.0, 0.92), (0.9, 0.86)])
def test_a_fit_over_time_holds_its_constants(correlation, least):
    """Creep, by the package's own fit: 95 % of 200 intervals, for both."""
    time, random, hits = np.linspace(0.0, 100.0, 400), np.random.default_rng(2), 0.0
    true = 10.0 * (1.0 + 0.1 * -np.expm1(-time / 15.0))
    for _ in range(100):
        found = fit_creep(time, true + 0.02 * draw_errors(400, correlation, random))
        values = {"contraction": (found.contraction, 10.0), "share": (found.term.share, 0.1)}
        factor = student.ppf(0.975, 9)
        for name, (value, truth) in values.items():
            hits += abs(value - truth) <= factor * found.standard_errors[name]
    assert least <= hits / 200.0 <= 0.99


def test_the_jackknife_is_that_of_fits_without_a_block():
    """For a linear model the linearised changes are those of fits again."""
    random = np.random.default_rng(3)
    table, target = random.normal(size=(50, 3)), random.normal(size=50)
    blocks = make_blocks([""] * 50)
    whole = np.linalg.lstsq(table, target, rcond=None)[0]
    changes = []
    for k in range(10):
        kept = blocks.of_row != k
        changes.append(np.linalg.lstsq(table[kept], target[kept], rcond=None)[0] - whole)
    expected = 0.9 * np.array(changes).T @ np.array(changes)
    spread = measure_spread(table, table @ whole - target, blocks)
    assert spread.covariance == pytest.approx(expected)
    assert spread.freedom == 9
    doubled = measure_spread(
        np.repeat(table, 2, axis=0), np.repeat(table @ whole - target, 2), blocks,
        rows=np.repeat(np.arange(50), 2),
    )  # fmt: skip
    assert doubled.covariance == pytest.approx(expected)  # a row twice is no more rows


def test_blocks_of_a_table():
    runs = make_blocks([""] * 1003)
    assert runs.rule == "10 runs of 100 to 101 row(s), in the order of the table"
    assert np.all(np.diff(runs.of_row) >= 0) and runs.freedom == 9
    assert make_blocks([""] * 4).freedom == 3
    few = make_blocks(["a", "b"] * 50)
    assert few.rule == "10 runs of 10 row(s), in the order of the table"
    many = make_blocks(list("abcde") * 4, noun="specimens")
    assert many.rule == "5 specimens" and many.freedom == 4
    assert np.array_equal(many.of_row[:5], many.of_row[5:10])
    apart = make_blocks(["a"] * 30 + ["b"] * 6, apart=True)
    assert len(np.unique(apart.of_row)) == 16 and apart.freedom == 5
    assert np.unique(apart.of_row[:30]).max() < apart.of_row[30:].min()


def test_what_one_block_alone_determines_has_no_interval_by_blocks():
    table = np.ones((20, 2))
    table[:, 1] = np.arange(20) < 2
    rest = np.random.default_rng(4).normal(size=20)
    rest -= table @ np.linalg.lstsq(table, rest, rcond=None)[0]
    spread = measure_spread(table, rest, make_blocks([""] * 20))
    assert "one block of them alone determines a constant" in spread.rule
    inverse = determine(table).inverse
    assert spread.covariance == pytest.approx(inverse * (rest @ rest) / 18.0)
    one = Blocks(np.zeros(20, dtype=np.int64), 0, "one")
    assert measure_spread(table, rest, one).freedom == 18


def test_columns_without_effect_are_lost_even_if_all_are():
    rest = np.random.default_rng(5).normal(size=20)
    found = determine(np.zeros((20, 2)))
    assert [text.split()[0] for text in describe_lost(["a", "b"], found)] == ["a", "b"]
    assert found.condition > CONDITION_LIMIT
    blocks = make_blocks([""] * 20)
    assert (measure_spread(np.zeros((20, 2)), rest, blocks, lost=True).deviations > 1e6).all()
    assert (measure_spread(np.zeros((20, 2)), rest, blocks).deviations == 0.0).all()


def test_sets_that_are_lost_are_told_apart_with_how_many_are_determined():
    a, c, e, alone = np.random.default_rng(6).normal(size=(4, 30))
    found = determine(np.stack([a, c, -2.0 * a, alone, c + e, e], axis=1))
    assert sorted(find_lost(found)) == [((0, 2), 1), ((1, 4, 5), 2)]

"""Models compared on one data set: the scores are what their names say."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bozzini.muscle import EnergyMuscle, ThesisMuscle, preset
from bozzini.muscle.data import Measurements
from bozzini.muscle.ranking import compare_models

MUSCLE = preset("effector-45")
ENERGY, THESIS = EnergyMuscle(MUSCLE), ThesisMuscle(MUSCLE)
PRESSURES = np.linspace(0.1, 0.7, 13)


def measure(shift=0.0):
    return Measurements(pressure=PRESSURES, contraction=ENERGY.contraction(PRESSURES) + shift)


@given(arrays(np.float64, 13, elements=st.floats(-1.0, 1.0)), st.integers(0, 3))
def test_scores_by_numpy(shift, fitted):
    data = measure(shift)
    (score,) = compare_models({"energy": ENERGY}, data, fitted={"energy": fitted}).scores
    squares = np.sum(shift**2)
    assert score.rmse == pytest.approx(math.sqrt(squares / 13), abs=1e-9)
    assert score.standard_error == pytest.approx(math.sqrt(squares / (13 - fitted)), abs=1e-9)
    assert score.bias == pytest.approx(-np.mean(shift), abs=1e-9)
    assert score.largest == pytest.approx(np.abs(shift).max(), abs=1e-9)
    percent = 100.0 * score.standard_error / data.contraction.max()
    assert score.standard_error_percent == pytest.approx(percent, abs=1e-9)


def test_a_constant_error_is_all_bias():
    (score,) = compare_models({"energy": ENERGY}, measure(-0.5)).scores
    assert score.bias == pytest.approx(0.5)
    assert score.rmse == pytest.approx(0.5)
    assert score.standard_error == pytest.approx(0.5)


def test_the_nearest_comes_first_whatever_the_order():
    models = {"thesis": THESIS, "energy": ENERGY, "stiff": EnergyMuscle(MUSCLE.replace(modulus=2))}
    for names in (list(models), list(models)[::-1]):
        comparison = compare_models({name: models[name] for name in names}, measure(0.01))
        errors = [score.standard_error for score in comparison.scores]
        assert comparison.scores[0].name == "energy"
        assert errors == sorted(errors)
        lines = comparison.format_table().splitlines()
        assert len(lines) == 4
        assert [line.split()[0] for line in lines[1:]] == [s.name for s in comparison.scores]


def test_a_model_without_an_answer_says_why():
    data = Measurements(pressure=[0.5, 0.6], contraction=[5.0, 6.0], load=[1.0, 1.0])
    comparison = compare_models({"thesis": THESIS, "energy": ENERGY}, data)
    assert [score.name for score in comparison.scores] == ["energy"]
    assert comparison.refusals["thesis"].startswith("row 1: load is 1 N")
    assert "thesis: no answer" in comparison.format_table()


def test_a_model_with_a_gap_is_judged_and_does_not_win_by_it():
    data = Measurements(pressure=[0.5, 0.6], contraction=[5.0, 6.0], load=[0.0, 1.0])
    comparison = compare_models({"thesis": THESIS, "energy": ENERGY}, data)
    assert [score.name for score in comparison.scores] == ["energy", "thesis"]
    assert comparison.scores[1].answered.tolist() == [True, False]
    assert comparison.scores[1].largest == 6.0  # a gap is as wrong as the largest response
    assert "1 of 2 rows" in comparison.format_table()


def test_a_model_that_gave_up_before_is_told_as_well():
    comparison = compare_models({"energy": ENERGY}, measure(), refusals={"thesis": "not today"})
    assert [score.name for score in comparison.scores] == ["energy"]
    assert "thesis: no answer: not today" in comparison.format_table()
    assert compare_models({}, measure(), refusals={"thesis": "not today"}).scores == ()


def test_directions_count():
    rubbing = EnergyMuscle(MUSCLE.replace(friction_length=0.03))
    up, down = (rubbing.contraction(PRESSURES, direction=d) for d in ("inflating", "deflating"))
    data = Measurements(
        pressure=np.tile(PRESSURES, 2),
        contraction=np.concatenate([up, down]),
        direction=np.repeat(["inflating", "deflating"], 13),
    )
    comparison = compare_models({"smooth": ENERGY, "rubbing": rubbing}, data)
    assert comparison.scores[0].name == "rubbing"
    assert comparison.scores[0].rmse < 1e-9 < comparison.scores[1].rmse

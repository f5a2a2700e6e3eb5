"""The figure of a ranking: a row for each model, curves of the best that differ."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bozzini.muscle import MODELS, Measurements, preset, rank
from bozzini.plot import write_figure
from bozzini.plot.muscle import draw_ranking

MUSCLE = preset("effector-45")
NAMES = ("gaylord-1", "gaylord-2", "chou", "ferraresi", "itto-b")


@pytest.fixture(scope="module")
def ranking():
    pressure, load = np.repeat(np.linspace(0.2, 0.8, 8), 2), np.tile([0.0, 0.2], 8)
    error = 0.05 * np.random.default_rng(0).normal(size=16)
    contraction = MODELS["chou"](MUSCLE).contraction(pressure, load) + error
    data = Measurements(pressure=pressure, load=load, contraction=contraction)
    models = {name: MODELS[name] for name in NAMES}
    return rank(data, MUSCLE, models={**models, "wang": MODELS["wang"]})


def test_it_shows_all_that_are_ranked(ranking, tmp_path):
    figure = draw_ranking(ranking, curves=2)
    left, right = figure.axes
    shown = [label.get_text() for label in left.get_yticklabels()]
    assert shown == [f"{entry.name} ({entry.parameters})" for entry in ranking.models]
    assert set(NAMES) == {entry.name for entry in ranking.models}
    dots = [line.get_xdata()[0] for line in left.lines if line.get_markersize() == 5.5]
    scale = 100.0 / ranking.data.largest_contraction
    assert dots == pytest.approx([scale * entry.score.rmse for entry in ranking.models])
    named = [text.get_text() for text in right.get_legend().get_texts()]
    assert named[1:] == [entry.name for entry in ranking.models if not entry.same_as][:2]
    assert "gaylord-2" not in named  # it is the same curve as gaylord-1
    write_figure(figure, tmp_path / "ranking.png")


def test_doubts_show(ranking):
    """A cross where the fit did not converge, a triangle where rows left out have no answer."""
    first, second, *others = ranking.models
    assert second.calibration is not None
    lost = replace(first, validation=replace(first.validation, reason="not today"))
    stopped = replace(second, calibration=replace(second.calibration, converged=False))
    left = draw_ranking(replace(ranking, models=(lost, stopped, *others))).axes[0]
    marks = {row: set() for row in range(len(ranking.models))}
    for line in left.lines:
        marks[line.get_ydata()[0]].add(line.get_marker())
    assert marks[0] == {"o", ">"}
    assert marks[1] >= {"X", "o"}
    assert all("X" not in marks[row] and ">" not in marks[row] for row in marks if row > 1)
    named = [text.get_text() for text in left.get_legend().get_texts()]
    assert {"not converged", "no answer at rows left out"} <= set(named)
    plain = draw_ranking(ranking).axes[0].get_legend().get_texts()
    assert [text.get_text() for text in plain] == ["rows of the fit", "rows left out"]

"""Figures of hysteresis show the operators' own numbers."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.muscle.hysteresis import BoucWen, PrandtlIshlinskii
from bozzini.plot import write_figure
from bozzini.plot.muscle import draw_fit, draw_loops

PLAYS = PrandtlIshlinskii((0.0, 0.1), (0.5, 0.4))
BOTH = {"plays": PLAYS, "bouc-wen": BoucWen(slope=2.0, alpha=0.9, beta=6.0, gamma=-2.0)}


def fade_loops(largest, *, loops=4, count=60):
    """Return a history of loops from 0 that shrink."""
    parts = []
    for loop in range(loops):
        up = np.linspace(0.0, largest * (1.0 - loop / loops), count)
        parts += [up[1 if parts else 0 :], up[-2::-1]]
    return np.concatenate(parts)


def test_loops_are_those_of_the_operators(tmp_path):
    history = fade_loops(0.7, loops=3, count=20)
    figure = draw_loops(BOTH, history, input_label="pressure [MPa]")
    for axes, operator in zip(figure.axes, BOTH.values(), strict=True):
        pieces = np.array(axes.collections[0].get_segments())
        assert pieces[:, 0, 0] == pytest.approx(history[:-1])
        assert pieces[:, 1, 1] == pytest.approx(operator.apply(history)[1:])
        (turns,) = axes.lines
        tops = 0.7 * np.array([1.0, 2.0 / 3.0, 1.0 / 3.0])
        assert turns.get_xdata() == pytest.approx([tops[0], 0.0, tops[1], 0.0, tops[2]])
        assert axes.get_xlabel() == "pressure [MPa]"
    assert write_figure(figure, tmp_path / "a.png", dpi=40).read_bytes()[:4] == b"\x89PNG"


def test_fit_shows_the_residual():
    history = fade_loops(0.7)
    response = PLAYS.apply(history) + 0.01 * np.sin(np.arange(len(history)))
    fit = PrandtlIshlinskii.identify(history, response, thresholds=PLAYS.thresholds)
    left, right = draw_fit(fit, history, response).axes
    assert right.lines[0].get_ydata() == pytest.approx(fit.residual)
    assert left.lines[1].get_ydata() == pytest.approx(fit.operator.apply(history))
    assert f"{fit.deviation:.3g}" in right.get_title(loc="left")

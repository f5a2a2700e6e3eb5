"""Figures of muscles show the model's own numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bozzini.muscle import EnergyMuscle, ThesisMuscle, preset
from bozzini.muscle.data import Measurements
from bozzini.muscle.ranking import compare_models
from bozzini.plot import write_figure
from bozzini.plot.muscle import (
    draw_braid_angle,
    draw_contraction,
    draw_force,
    draw_models,
    draw_phases,
)

ENERGY, THESIS = (model(preset("effector-45")) for model in (EnergyMuscle, ThesisMuscle))
BOTH = {"energy": ENERGY, "thesis": THESIS}


def measure(load=0.0, direction=""):
    pressure = np.linspace(0.0, 0.7, 8)
    return Measurements(
        pressure=pressure,
        contraction=ENERGY.contraction(pressure, load) + 0.1,
        load=load,
        direction=direction,
    )


def find_lines(axes, minimum=20):
    return [line for line in axes.lines if len(line.get_xdata()) > minimum]


@pytest.mark.parametrize("model", [ENERGY, THESIS], ids=lambda model: model.name)
def test_phases_show_the_dead_band(model, tmp_path):
    figure = draw_phases(model, pressure=0.7)
    band = 1e3 * model.dead_band()
    near, whole = figure.axes
    for axes in (near, whole):
        (line,) = find_lines(axes)
        pressure, contraction = np.array(line.get_xdata()) / 1e3, np.array(line.get_ydata())
        assert contraction == pytest.approx(model.contraction(pressure), abs=1e-12)
        assert band == pytest.approx(axes.patches[0].get_window_extent().transformed(
            axes.transData.inverted()).x1, rel=1e-6)  # fmt: skip
    assert near.get_xlim()[1] == pytest.approx(2.5 * band)
    # only the finite-strain model gets longer in the gap, and has a way back to go
    assert len(whole.patches) == (2 if model is ENERGY else 1)
    assert f"{band:.1f} kPa" in near.get_title(loc="left")
    assert write_figure(figure, tmp_path / "a.png", dpi=40).read_bytes()[:4] == b"\x89PNG"


def list_bands(axes):
    """Low and high end of each shaded band [MPa], by its label."""
    bands = {}
    for patch in axes.patches:
        box = patch.get_window_extent().transformed(axes.transData.inverted())
        bands.setdefault(patch.get_label(), []).append((box.x0 / 1e3, box.x1 / 1e3))
    return bands


@pytest.mark.parametrize("load", [0.0, 0.002, 0.01, 0.5])
def test_phases_under_a_load_are_those_of_the_solver(load):
    # the load stretches the tube, so that the braid grips it sooner, and heavy ones at once
    for axes in draw_phases(ENERGY, pressure=0.7, load=load).axes:
        bands = list_bands(axes)
        over = np.linspace(0.0, axes.get_xlim()[1] / 1e3, 400)
        state = ENERGY.solve(over, load)
        for label, expected in (
            ("gap: the tube grows alone", ~state.in_contact),
            ("contact, longer than at rest", state.in_contact & (state.contraction < 0.0)),
        ):
            shown = np.zeros(len(over), dtype=bool)
            for low, high in bands.get(label, []):
                shown |= (over >= low) & (over < high)
            assert np.count_nonzero(shown != expected) <= 2  # its ends
    if load == 0.5:
        assert "gap: the tube grows alone" not in bands


def test_a_muscle_without_a_gap_has_phases_too():
    tight = EnergyMuscle(preset("effector-45", gap=0.0))
    left, right = draw_phases(tight, pressure=0.5).axes
    assert left.get_xlim()[1] < right.get_xlim()[1]


@pytest.mark.parametrize("direction", ["inflating", "deflating"])
def test_figures_of_one_direction(direction):
    rubbing = EnergyMuscle(preset("effector-45", friction_length=0.05))
    options = {"pressure": 0.6, "direction": direction}
    (line,) = find_lines(draw_contraction({"a": rubbing}, **options))
    assert line.get_ydata()[-1] == pytest.approx(
        float(rubbing.contraction(0.6, direction=direction))
    )
    (line,) = find_lines(draw_braid_angle({"a": rubbing}, **options))
    assert math.radians(line.get_ydata()[-1]) == pytest.approx(
        float(rubbing.solve(0.6, direction=direction).braid_angle)
    )
    (line,) = find_lines(draw_force(rubbing, [0.6], direction=direction))
    assert line.get_ydata()[0] == pytest.approx(float(rubbing.force(0.6, 0.0, direction=direction)))
    assert line.get_ydata()[-1] == pytest.approx(0.0, abs=1e-9)


def test_contraction_has_a_line_a_model():
    models = {f"{n} mm": EnergyMuscle(preset("thesis-40", length=float(n))) for n in (40, 45, 60)}
    axes = draw_contraction(models, pressure=0.8)
    lines = find_lines(axes)
    assert [line.get_label() for line in lines] == list(models)
    ends = [line.get_ydata()[-1] for line in lines]
    for end, model in zip(ends, models.values(), strict=True):
        assert end == pytest.approx(float(model.contraction(0.8)))
    assert ends == sorted(ends)


def test_a_figure_of_one_panel_is_drawn_into_axes_that_are_given():
    first = draw_contraction({"energy": ENERGY}, pressure=0.5)
    assert draw_contraction({"again": ENERGY}, pressure=0.5, ax=first) is first
    assert [line.get_label() for line in find_lines(first)] == ["energy", "again"]
    assert draw_force(ENERGY, [0.5], ax=first) is first
    assert draw_braid_angle({"energy": ENERGY}, pressure=0.5, ax=first) is first


def test_force_runs_from_blocked_to_free():
    axes = draw_force(ENERGY, [0.6, 0.3])
    lines = find_lines(axes)
    assert [line.get_label() for line in lines] == ["300 kPa", "600 kPa"]
    for line, pressure in zip(lines, (0.3, 0.6), strict=True):
        assert line.get_ydata()[0] == pytest.approx(float(ENERGY.blocked_force(pressure)))
        assert line.get_xdata()[-1] == pytest.approx(float(ENERGY.free_contraction(pressure)))
        assert line.get_ydata()[-1] == pytest.approx(0.0, abs=1e-9)


def test_braid_angle_comes_to_locking_from_below():
    axes = draw_braid_angle({"energy": ENERGY}, pressure=20.0)
    (line,) = find_lines(axes)
    locking = math.degrees(math.atan(math.sqrt(2.0)))
    assert axes.get_xscale() == "log"
    assert 54.0 < line.get_ydata()[-1] < locking
    assert any(f"{locking:.2f}" in text.get_text() for text in axes.texts)


@pytest.mark.parametrize("load", [0.0, 0.5])
def test_models_against_measurements(load, tmp_path):
    bulk = {"energy": ENERGY, "thesis": ThesisMuscle(preset("effector-45"), load_path="bulk")}
    comparison = compare_models(bulk, measure(load, "inflating"))
    left, right = (figure := draw_models(comparison, bulk)).axes
    labels = [text.get_text() for text in left.get_legend().get_texts()]
    assert labels[0] == "measured inflating"
    for score, label in zip(comparison.scores, labels[1:], strict=True):
        assert label == f"{score.name}: {score.standard_error_percent:.1f} %"
    dots = [line for line in right.lines if len(line.get_xdata()) == 8]
    shown = {round(float(np.mean(line.get_ydata())), 9) for line in dots}
    assert shown == {round(score.bias, 9) for score in comparison.scores}
    write_figure(figure, tmp_path / "a.svg")

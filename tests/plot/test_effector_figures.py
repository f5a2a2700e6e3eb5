"""Figures of the effector show the library's own numbers."""

from __future__ import annotations

import dataclasses
import math
from functools import cache

import numpy as np
import pytest

from bozzini.effector import (
    Effector,
    balance,
    bend,
    effector_preset,
    fit_cubic,
    pose,
    solve_inverse,
    sweep,
    tip_force,
    tip_stiffness,
    trace_circle,
    trace_line,
    workspace,
)
from bozzini.muscle import ThesisMuscle
from bozzini.muscle import preset as muscle_preset
from bozzini.plot import write_figure
from bozzini.plot.effector import (
    draw_deflection,
    draw_force,
    draw_iteration,
    draw_pose,
    draw_sweep,
    draw_trace,
    draw_workspace,
)

# A layout that matplotlib gives up, or an empty mean, would only be a warning.
# What matplotlib and its parser say of each other aside.
pytestmark = pytest.mark.filterwarnings(
    "error", "ignore::DeprecationWarning:(matplotlib|pyparsing)"
)

EFFECTOR = Effector(effector_preset("prototype"))


@cache
def places():
    return workspace(EFFECTOR)


def keep(angles):
    muscles = EFFECTOR.design.muscles[: len(angles)]
    placed = [dataclasses.replace(m, angle=a) for m, a in zip(muscles, angles, strict=True)]
    return Effector(EFFECTOR.design.replace(muscles=tuple(placed)))


def make_thesis():
    muscle = muscle_preset("effector-45")
    muscles = (dataclasses.replace(m, muscle=muscle) for m in EFFECTOR.design.muscles)
    design = EFFECTOR.design.replace(muscles=tuple(muscles))
    return Effector(design, lambda made: ThesisMuscle(made, load_path="bulk"))


THESIS = make_thesis()


def get_lines(axes):
    """Give the labelled lines of a panel as (n, 2) or (n, 3) arrays."""
    found = {}
    for line in axes.lines:
        data = line.get_data_3d() if hasattr(line, "get_data_3d") else line.get_data()
        found[line.get_label()] = np.stack([np.asarray(values, float) for values in data], axis=-1)
    return found


def is_written(figure, path):
    return write_figure(figure, path, dpi=50).read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize("pressures", [{"R": 0.7}, {"R": 0.7, "G": 0.4}, {}, {"G": 0.05}])
def test_pose_in_space(pressures, tmp_path):
    found = pose(EFFECTOR, pressures)
    figure = draw_pose(EFFECTOR, found, workspace=places(), target=(3.0, 4.0))
    space, plane = figure.axes
    lines = get_lines(space)
    assert lines["backbone"] == pytest.approx(found.backbone)
    assert lines["distal holder"] == pytest.approx(np.stack([found.tip, found.holder_tip]))
    offset = EFFECTOR.design.offset
    for name, angle in zip("RGB", EFFECTOR.design.angles, strict=True):
        line = lines[f"{name}: {1e3 * pressures.get(name, 0.0):.1f} kPa"]
        start = offset * np.array([math.cos(angle), math.sin(angle), 0.0])
        assert line[0] == pytest.approx(start, abs=1e-12)
        # held at the offset at every turn of the spring
        apart = np.linalg.norm(line - found.backbone, axis=1)
        assert apart == pytest.approx(np.full(16, offset), abs=1e-9)
    assert f"tip {float(found.lateral):.2f} mm" in plane.get_title(loc="left")
    assert any(np.array_equal(line[0], found.tip[:2]) for line in get_lines(plane).values())
    assert is_written(figure, tmp_path / "a.png")


def test_a_muscle_that_pulls_alone_is_where_the_linkage_puts_it():
    found = pose(EFFECTOR, {"B": 0.7})
    line = get_lines(draw_pose(EFFECTOR, found).axes[0])["B: 700.0 kPa"]
    flat = bend(EFFECTOR.design, found.contraction[2]).muscle
    assert np.hypot(*line[:, :2].T) == pytest.approx(np.abs(flat[:, 0]))
    assert line[:, 2] == pytest.approx(flat[:, 1])
    pieces = np.linalg.norm(np.diff(line, axis=0), axis=1)
    assert pieces.sum() == pytest.approx(45.0 - float(found.contraction[2]))


@pytest.mark.parametrize("method", ["superposition", "thesis"])
def test_a_pose_that_asks_for_too_much_says_so(method):
    found = pose(THESIS, {"R": 0.6894, "G": 0.6894}, method=method)
    title = draw_pose(THESIS, found).axes[1].get_title(loc="left")
    assert ("saturated" in title) == (method == "superposition")


@pytest.mark.parametrize("angles", [(5.4, 3.8, 1.3), (0.3, 1.7), (2.0,)])
def test_workspace(angles, tmp_path):
    effector = keep(angles)
    found = workspace(effector)
    figure = draw_workspace(effector, found)
    plane, space = figure.axes
    (patch,) = [patch for patch in plane.patches if patch.get_facecolor()[3] > 0.0]
    assert patch.get_path().vertices[: len(found.boundary)] == pytest.approx(found.boundary)
    lines = get_lines(space)
    for name, points in (
        ("end of the backbone", found.boundary_tip),
        ("end of the holder", found.boundary_holder_tip),
    ):
        for point in points[::40]:
            assert np.linalg.norm(lines[name] - point, axis=1).min() < 1e-9
    assert {text.get_text() for text in plane.texts} == set(effector.design.names)
    for text in plane.texts:  # inside the panel
        x, y = text.get_position()
        assert plane.get_xlim()[0] < x < plane.get_xlim()[1]
        assert plane.get_ylim()[0] < y < plane.get_ylim()[1]
    circle = [name for name in get_lines(plane) if name.startswith("every direction")]
    assert bool(circle) == (found.inner_radius > 0.0)
    assert is_written(figure, tmp_path / "a.png")


def test_deflection_and_cubic(tmp_path):
    cubics = {"R": fit_cubic(EFFECTOR, "R", start=0.1)}
    figure = draw_deflection(EFFECTOR, cubics=cubics, measured=[[0.6894, 20.4], [0.5516, 18.5]])
    left, right = figure.axes
    line = get_lines(left)["R, G, B"]  # equal muscles share a line
    assert line[:, 1] == pytest.approx(balance(EFFECTOR, "G", pressure=line[:, 0] / 1e3).lateral)
    assert get_lines(left)["measured"][0] == pytest.approx([689.4, 20.4])
    error = get_lines(right)[f"R, G, B: {cubics['R'].rms_error:.2f} mm rms"]
    exact = balance(EFFECTOR, "R", pressure=error[:, 0] / 1e3).lateral
    cubic = cubics["R"].find_lateral(np.minimum(error[:, 0] / 1e3, cubics["R"].limit))
    assert error[:, 1] == pytest.approx(cubic - exact, abs=0.01)
    assert is_written(figure, tmp_path / "a.png")
    assert len(draw_deflection(EFFECTOR).axes) == 1


def test_different_muscles_have_a_line_each():
    first, *rest = EFFECTOR.design.muscles
    other = dataclasses.replace(first, muscle=first.muscle.replace(dead_length=5.0))
    effector = Effector(EFFECTOR.design.replace(muscles=(other, *rest)))
    assert {"R", "G, B"} <= set(get_lines(draw_deflection(effector).axes[0]))


def test_iteration_is_the_table(tmp_path):
    found = {"100 psi": balance(THESIS, "R", pressure=0.6894, method="fixed-point")}
    figure = draw_iteration(found)
    left, right = figure.axes
    table = found["100 psi"].table
    assert get_lines(left)["100 psi"][:, 1] == pytest.approx(table[:, 2])
    change = get_lines(right)["100 psi"]
    assert change[0] == pytest.approx([1.0, table[0, 3]])
    assert change[-1, 1] < 1e-6
    assert is_written(figure, tmp_path / "a.png")


@pytest.mark.parametrize("radius", [8.0, 10.0])
def test_trace(radius, tmp_path):
    found = trace_circle(EFFECTOR, radius)
    figure = draw_trace(found, EFFECTOR.design.names, outline=places().boundary)
    plane, steps = figure.axes
    lines = get_lines(plane)
    assert np.array_equal(lines["wanted"], found.targets)
    assert np.array_equal(lines["achieved"], found.achieved)
    for k, name in enumerate("RGB"):
        assert get_lines(steps)[name][:, 1] == pytest.approx(1e3 * found.pressures[:, k])
    assert ("out of reach" in lines) == (radius > places().inner_radius)
    shaded = sum(patch.get_width() for patch in steps.patches)
    assert shaded == pytest.approx(np.count_nonzero(~found.reachable))
    assert is_written(figure, tmp_path / "a.png")


def test_error_that_is_round_off_is_not_shown_as_one():
    found = trace_line(EFFECTOR, (0.0, 0.0), end=(3.0, -4.0))
    title = draw_trace(found, EFFECTOR.design.names).axes[0].get_title(loc="left")
    assert title == "largest error below 1e-06 mm"


@pytest.mark.parametrize("held", [(0.0, 0.0), (4.0, -5.0)])
def test_force_and_stiffness(held, tmp_path):
    figure = draw_force(EFFECTOR, lateral=held)
    force, stiff = figure.axes
    line = max(get_lines(force).values(), key=len)
    toward = np.stack([np.cos(line[:, 0]), np.sin(line[:, 0])], axis=1)
    assert line[:, 1] == pytest.approx(tip_force(EFFECTOR, toward, lateral=held).force)
    lines = get_lines(stiff)
    assert set(lines) == {"without pressure"} | ({"under pressure"} if any(held) else set())
    matrix = tip_stiffness(EFFECTOR, solve_inverse(EFFECTOR, held).pressures)
    last = list(lines.values())[-1]
    assert last[:, 1] == pytest.approx(np.einsum("ni,ij,nj->n", toward, matrix, toward))
    assert is_written(figure, tmp_path / "a.png")


def test_sweep(tmp_path):
    found = sweep(EFFECTOR, {"offset": [1.0, 3.0, 4.0], "segments": [12, 15]}, deflection=12.0)
    figure = draw_sweep(found)
    left, right = figure.axes
    line = get_lines(right)["segments 15"]
    rows = [row for row in found.rows if row.changes["segments"] == 15 and row.area > 0.0]
    assert line == pytest.approx(
        np.array([[row.changes["offset"], 1e3 * row.needed_pressure] for row in rows])
    )
    crosses = [line for line in left.lines if line.get_marker() == "x"]
    assert list(crosses[0].get_xdata()) == [1.0, 1.0]
    assert left.get_title(loc="left") == "4 of 6 designs work"
    assert is_written(figure, tmp_path / "a.png")


def test_a_pressure_that_none_is_is_no_point(tmp_path):
    found = sweep(EFFECTOR, {"offset": [3.0, 4.0, 8.0]}, deflection=20.0)
    needed = [row.needed_pressure for row in found.rows]
    assert needed[0] > 0.0 == needed[2]
    figure = draw_sweep(found)
    left, right = figure.axes
    line = next(line for line in right.lines if len(line.get_xdata()) == 3)
    drawn = np.asarray(line.get_ydata())
    assert np.isnan(drawn[2]) and drawn[0] == pytest.approx(1e3 * needed[0])
    for axes in (left, right):
        top = max(np.nanmax(line.get_ydata()) for line in axes.lines if len(line.get_ydata()))
        assert axes.get_ylim()[0] == 0.0 and axes.get_ylim()[1] > 1.03 * top
    assert is_written(figure, tmp_path / "a.png")


def test_no_force_is_no_disc(tmp_path):
    weak = Effector(effector_preset("prototype", pressure_limit=0.01))
    figure = draw_force(weak)
    force = figure.axes[0]
    assert not force.patches and "no force" in force.texts[0].get_text()
    assert force.get_ylim()[0] == 0.0
    assert draw_force(EFFECTOR).axes[0].get_ylim()[0] == 0.0
    assert is_written(figure, tmp_path / "a.png")


def test_an_iteration_of_a_slack_muscle_says_that_nothing_changes(tmp_path):
    figure = draw_iteration({"R": balance(EFFECTOR, "R", pressure=0.01, method="fixed-point")})
    assert "nothing changes" in figure.axes[1].texts[0].get_text()
    assert is_written(figure, tmp_path / "a.png")


def test_the_error_of_a_trace_is_that_of_what_is_in_reach():
    found = trace_circle(EFFECTOR, 10.0)
    title = draw_trace(found, EFFECTOR.design.names).axes[0].get_title(loc="left")
    away = np.count_nonzero(~found.reachable)
    assert title.startswith("largest error below 1e-06 mm\n")
    assert title.endswith(f"{away} of 73 out of reach, by up to {found.largest_error:.2g} mm")
    none = draw_trace(trace_line(EFFECTOR, (40.0, 0.0), end=(50.0, 0.0)), "RGB")
    assert none.axes[0].get_title(loc="left").startswith("nothing in reach\n")


def test_where_a_curve_is_flat_is_drawn():
    strong = Effector(THESIS.design.replace(pressure_limit=3.0, beam_factor=2.0))
    flat = get_lines(draw_deflection(strong).axes[0])["R, G, B saturated"]
    assert flat[:, 1] == pytest.approx(np.full(len(flat), flat[0, 1]))
    assert "R, G, B saturated" not in get_lines(draw_deflection(EFFECTOR).axes[0])


def test_sweep_of_angles_has_names(tmp_path):
    found = sweep(EFFECTOR, {"angles": [(0.0, 2.1, 4.2), (0.0, 1.5, 3.0)]})
    figure = draw_sweep(found)
    labels = [text.get_text() for text in figure.axes[0].get_xticklabels()]
    assert labels[0].startswith("0°/120.3")
    assert is_written(figure, tmp_path / "a.png")

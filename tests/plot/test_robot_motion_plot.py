"""The figure of a robot's motion shows the motion's own numbers."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.motion.actuate.actuate import actuate_plan
from bozzini.plot import draw_robot_motion, write_figure
from tests.motion.actuate.motions import make_plan, make_robot, make_tube


def move(robot, **options):
    return actuate_plan(make_plan(**options), robot, make_tube()[0])


def find_lines(axes):
    return [line for line in axes.lines if len(line.get_xdata()) > 2]


def test_four_panels_show_the_motion(tmp_path):
    moved = move(make_robot(30.0, 4, max_bend=2.0))
    figure = draw_robot_motion(moved)
    bends, fit, clearance, tendons = figure.axes
    for index, line in enumerate(find_lines(bends)):
        angles = np.degrees(np.linalg.norm(moved.bends[:, index], axis=1))
        assert np.asarray(line.get_ydata()) == pytest.approx(angles)
        assert np.array_equal(line.get_xdata(), moved.head_arc_length)
    assert len(find_lines(bends)) == 4
    assert any(
        np.asarray(line.get_ydata()) == pytest.approx(np.degrees(2.0)) for line in bends.lines[4:]
    )
    assert np.array_equal(find_lines(fit)[0].get_ydata(), moved.fit_rms)
    shown = np.asarray(find_lines(clearance)[0].get_ydata())
    finite = np.isfinite(moved.clearance)
    assert np.array_equal(shown[finite], moved.clearance[finite])
    assert len(find_lines(tendons)) == 12
    assert write_figure(figure, tmp_path / "a.png", dpi=40).read_bytes()[:4] == b"\x89PNG"


@pytest.mark.slow
def test_a_motion_that_ends_early_says_so():
    moved = move(make_robot(20.0, 3))
    figure = draw_robot_motion(moved)
    assert figure.axes[0].get_title(loc="right") == "ends here: robot too short"
    assert figure.axes[3].get_legend() is None  # nine tendons: colours tell the section
    assert len(draw_robot_motion(move(make_robot(60.0, 2))).axes[3].get_legend().texts) == 6


def test_to_and_fro_is_drawn_over_the_steps():
    moved = move(make_robot(20.0, 6), route=(1.0, 0.0))
    axes = draw_robot_motion(moved).axes[2]
    assert axes.get_xlabel() == "step"
    assert np.array_equal(find_lines(axes)[0].get_xdata(), np.arange(moved.steps))


@pytest.mark.slow
def test_the_limit_is_drawn_where_discs_meet_if_sections_come_near():
    def limits(robot):
        lines = draw_robot_motion(move(robot)).axes[0].lines
        return [float(line.get_ydata()[0]) for line in lines if len(line.get_xdata()) == 2]

    assert limits(make_robot(20.0, 6)) == []  # they meet at 10 rad
    assert limits(make_robot(20.0, 6, max_bend=20.0)) == []
    assert limits(make_robot(20.0, 6, max_bend=2.0)) == pytest.approx([np.degrees(2.0)])

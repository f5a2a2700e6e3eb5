"""The figure of link limits: what is known is drawn, what is not is left out."""

from __future__ import annotations

import numpy as np

from bozzini.duct import Centreline, Polygon
from bozzini.motion.traverse import find_link_limits
from bozzini.plot.duct import draw_link_limits
from bozzini.plot.figures import write_figure
from tests.motion.bends import bend_duct


def test_bend(tmp_path) -> None:
    duct, line = bend_duct(10.0, 3.0, 3.0, 30.0, inset=4.0, count=60)
    limits = find_link_limits(duct, line, diameter=2.0, stations=12)
    figure = draw_link_limits(limits, link=12.0)
    upper = figure.axes[0]
    names = [text.get_text() for text in upper.get_legend().get_texts()]
    assert "12 mm" in names
    drawn = [np.asarray(item.get_ydata(), float) for item in upper.lines]
    known = [values for values in drawn if len(values) == len(limits.rigid)]
    for values, given in zip(
        known, (limits.rigid, limits.head_on_line, limits.on_line), strict=True
    ):
        np.testing.assert_array_equal(np.isfinite(values), np.isfinite(given))
        np.testing.assert_array_equal(values[np.isfinite(values)], given[np.isfinite(given)])
    assert limits.link_high < upper.get_ylim()[1]
    assert write_figure(figure, tmp_path / "limits.png").stat().st_size > 5000
    # The legend covers none of the curves.
    assert upper.get_legend().get_window_extent().y0 >= upper.get_window_extent().y1 - 1.0


def test_nothing_known(tmp_path) -> None:
    duct = Polygon([[0, 0], [40, 0], [40, 6], [0, 6]])
    line = Centreline.from_points([[3, 3], [37, 3]], duct)
    figure = draw_link_limits(find_link_limits(duct, line, diameter=1.0, stations=5))
    assert write_figure(figure, tmp_path / "limits.svg").exists()

"""Bode figures of small oscillations."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.continuum import DynamicsOptions, EnergyModel, linearise
from bozzini.errors import InputError
from bozzini.plot import draw_bode
from tests.continuum.test_dynamics import make_arm


def test_gain_begins_at_the_static_one_and_peaks_at_the_frequencies() -> None:
    pulls, more = np.ones(6), 1e-3 * np.eye(6)[0]
    options = DynamicsOptions(damping_time=2e-4, gravity=(0.0, 0.0, 0.0))
    found = linearise(make_arm(), tensions=pulls, options=options)
    gains, phases = draw_bode(found, "00").axes
    lines = {line.get_label(): line.get_xydata() for line in gains.lines}
    at = EnergyModel(make_arm(), segment="chord")
    static = (at.shape_under_tensions(pulls + more).tip - at.shape_under_tensions(pulls).tip) / 1e-3
    assert lines["x"][0, 1] == pytest.approx(abs(static[0]), rel=0.03)
    top = lines["x"][np.argmax(lines["x"][:, 1])]
    assert top[0] == pytest.approx(found.frequency[0], rel=0.01)
    assert top[1] == pytest.approx(0.5 * abs(static[0]) / found.damping_ratio[0], rel=0.2)
    phase = phases.lines[0].get_ydata()
    assert abs(phase[0]) < 5.0 and phase.min() < -170.0
    assert gains.get_ylabel().endswith("[mm/N]")


def test_few_modes_are_those_of_the_state_space_and_wrong_names_are_refused() -> None:
    found = linearise(make_arm(), displacements=np.zeros(6))
    one, all_ = (draw_bode(found, "02", modes=modes).axes[0] for modes in (2, None))
    assert one.lines[0].get_xdata().max() < all_.lines[0].get_xdata().max()
    assert one.get_ylabel().endswith("[mm/mm]")
    with pytest.raises(InputError, match="no tendon 'z'"):
        draw_bode(found, "z")

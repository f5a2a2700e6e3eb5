"""Sweeps and the design with the least pressure."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bozzini.effector.design import effector_preset
from bozzini.effector.effector import Effector
from bozzini.effector.equilibrium import balance
from bozzini.effector.study import change_design, find_needed_pressure, optimise_design, sweep
from bozzini.effector.workspace import workspace

DESIGN = effector_preset("prototype")
EFFECTOR = Effector(DESIGN)


def test_needed_pressure_reaches_the_deflection() -> None:
    pressure = find_needed_pressure(EFFECTOR, 11.0)
    for name in DESIGN.names:
        assert balance(EFFECTOR, name, pressure=pressure).lateral == pytest.approx(11.0, abs=1e-9)
    # Above the limit too, which is the sweep's business.
    above = find_needed_pressure(EFFECTOR, 16.0)
    assert above > DESIGN.pressure_limit
    wide = Effector(DESIGN.replace(pressure_limit=10.0))
    assert balance(wide, "R", pressure=above).lateral == pytest.approx(16.0, abs=1e-9)


def test_needed_pressure_is_that_of_the_weakest_muscle() -> None:
    weak = DESIGN.muscles[0].muscle.replace(modulus=1.0)
    changed = DESIGN.replace(
        muscles=(type(DESIGN.muscles[0])(name="R", muscle=weak, angle=0.0), *DESIGN.muscles[1:])
    )
    pressure = find_needed_pressure(Effector(changed), 8.0)
    assert pressure > find_needed_pressure(EFFECTOR, 8.0)
    assert balance(Effector(changed), "R", pressure=pressure).lateral == pytest.approx(
        8.0, abs=1e-9
    )


def test_changes() -> None:
    changed = change_design(
        DESIGN,
        {"length": 60.0, "offset": 5.0, "angles": [0.0, 2.0, 4.0], "muscle.braid_angle": 0.5},
    )
    assert changed.backbone_length == 60.0 and changed.offset == 5.0
    assert changed.angles == pytest.approx([0.0, 2.0, 4.0])
    assert all(p.muscle.length == 60.0 and p.muscle.braid_angle == 0.5 for p in changed.muscles)
    assert change_design(DESIGN, {}) == DESIGN


def test_muscles_can_be_changed_with_their_length() -> None:
    other = DESIGN.resize(60.0).muscles[:2]
    changed = change_design(DESIGN, {"muscles": other, "length": 50.0, "angles": [0.0, 1.0]})
    assert changed.names == ("R", "G") and changed.backbone_length == 50.0
    assert {placed.muscle.length for placed in changed.muscles} == {50.0}


def test_sweep_has_every_design_and_tells_progress() -> None:
    told: list[float] = []
    found = sweep(
        EFFECTOR,
        {"offset": [1.0, 3.0, 4.0], "segments": [12, 15]},
        deflection=14.0,
        progress=lambda stage, fraction: told.append(fraction),
    )
    assert [(r.changes["offset"], r.changes["segments"]) for r in found.rows] == [
        (a, n) for a in (1.0, 3.0, 4.0) for n in (12, 15)
    ]
    assert told == pytest.approx(np.arange(1, 7) / 6)
    assert all(bool(row.reason) != row.feasible for row in found.rows)
    assert "at least" in found.rows[0].reason
    last = found.rows[-1]
    assert last.feasible and found.feasible[-1] is last
    whole = workspace(EFFECTOR)
    assert last.area == pytest.approx(whole.area)
    assert last.inner_radius == pytest.approx(whole.inner_radius)
    assert last.largest_amplitude == pytest.approx(whole.reach.amplitudes.max())
    assert last.needed_pressure == pytest.approx(find_needed_pressure(EFFECTOR, 14.0))
    nowhere = sweep(EFFECTOR, {"offset": [4.0]}, deflection=27.5).rows[0]
    assert not nowhere.feasible and nowhere.needed_pressure == 0.0
    assert nowhere.area == pytest.approx(whole.area)
    short = next(r for r in found.rows if r.changes == {"offset": 4.0, "segments": 12})
    assert not short.feasible and short.needed_pressure > DESIGN.pressure_limit
    assert "MPa of at most 0.827" in short.reason


def test_even_angles_have_the_largest_inner_radius() -> None:
    third = 2.0 * math.pi / 3.0
    found = sweep(EFFECTOR, {"angles": [DESIGN.angles, (0.0, third, 2.0 * third)]})
    printed, even = found.rows
    assert even.inner_radius > printed.inner_radius
    assert even.inner_radius == pytest.approx(even.largest_amplitude * math.sin(third))


def test_optimum_of_the_offset_beats_a_fine_sweep() -> None:
    found = optimise_design(EFFECTOR, 12.0, bounds={"offset": (1.6, 8.0)})
    assert found.converged and found.reason == ""
    fine = sweep(EFFECTOR, {"offset": np.linspace(1.6, 8.0, 300)}, deflection=12.0)
    pressures = [row.needed_pressure for row in fine.rows if row.needed_pressure > 0.0]
    best = min(pressures)
    assert best - 1e-3 < found.pressure <= best + 1e-12
    assert found.pressure < found.pressure_before
    assert found.pressure_before == pytest.approx(find_needed_pressure(EFFECTOR, 12.0))
    assert found.pressure == pytest.approx(find_needed_pressure(found.effector, 12.0))
    assert found.effector.design.offset == pytest.approx(found.changes["offset"])
    # Stationary: a step either way needs more.
    for step in (-0.05, 0.05):
        near = DESIGN.replace(offset=found.changes["offset"] + step)
        assert find_needed_pressure(Effector(near), 12.0) > found.pressure


def test_optimum_over_segments_and_on_a_bound() -> None:
    found = optimise_design(
        EFFECTOR, 10.0, bounds={"flexural_rigidity": (100.0, 300.0)}, segments=[12, 15, 20], grid=4
    )
    assert found.converged and "lower bound" in found.reason
    assert found.changes["flexural_rigidity"] == pytest.approx(100.0, rel=1e-5)
    each = [
        find_needed_pressure(
            Effector(DESIGN.replace(flexural_rigidity=100.0, segments=count)), 10.0
        )
        for count in (12, 15, 20)
    ]
    assert found.pressure == pytest.approx(min(each), rel=1e-5)
    assert found.changes["segments"] == (12, 15, 20)[int(np.argmin(each))]


def test_no_optimum() -> None:
    nothing = optimise_design(EFFECTOR, 200.0, bounds={"offset": (3.0, 4.0)}, grid=3)
    assert not nothing.converged and nothing.pressure == 0.0
    assert nothing.infeasible == nothing.evaluations == 3
    assert "no design within the bounds is feasible" in nothing.reason
    above = optimise_design(EFFECTOR, 17.0, bounds={"offset": (3.5, 4.5)}, grid=3)
    assert not above.converged and "above the limit" in above.reason
    assert above.pressure > DESIGN.pressure_limit


def test_a_design_over_its_own_limit_is_no_optimum() -> None:
    """The least pressure is the same whether the limit lies just above it or far above."""
    wide = optimise_design(EFFECTOR, 12.0, bounds={"offset": (1.6, 8.0)})
    limit = 1.001 * wide.pressure
    tight = Effector(DESIGN.replace(pressure_limit=limit))
    found = optimise_design(tight, 12.0, bounds={"offset": (1.6, 8.0)})
    assert found.converged and found.pressure == pytest.approx(wide.pressure, rel=1e-6)
    assert 0 < found.infeasible < found.evaluations
    # Which design is within its limit may depend on what is varied.
    stiff = optimise_design(EFFECTOR, 14.0, bounds={"flexural_rigidity": (150.0, 900.0)}, grid=4)
    assert stiff.converged and 0 < stiff.infeasible

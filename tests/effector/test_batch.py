"""Designs in batches: the same numbers and refusals as one design at a time."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from bozzini.effector import Effector, effector_preset, sweep
from bozzini.effector.batch import can_batch, measure_designs
from bozzini.effector.design import PlacedMuscle
from bozzini.effector.study import explain_design, try_design
from bozzini.muscle import ThesisMuscle

EFFECTOR = Effector(effector_preset("prototype"))
NAMES = ("least_amplitude", "largest_amplitude", "inner_radius", "area", "needed_pressure")


def draw_designs(count: int, *, seed: int) -> dict[str, NDArray[np.generic]]:
    """Designs of which some cannot be built, some do not reach 12 mm, and some do."""
    rng = np.random.default_rng(seed)
    return {
        "offset": rng.uniform(1.2, 5.5, count),
        "flexural_rigidity": np.exp(rng.uniform(np.log(50.0), np.log(400.0), count)),
        "segments": rng.integers(8, 22, count),
        "length": rng.uniform(30.0, 60.0, count),
        "pressure_limit": rng.uniform(0.3, 1.2, count),
        "muscle.modulus": rng.uniform(0.3, 0.9, count),
        "muscle.braid_angle": rng.uniform(0.5, 0.97, count),
        "muscle.gap": rng.uniform(0.0, 0.15, count),
        "muscle.dead_length": rng.uniform(0.0, 40.0, count),
        "muscle.friction_length": rng.uniform(0.0, 0.1, count),
        "muscle.mooney_ratio": rng.uniform(-0.02, 0.5, count),
    }


def compare(
    effector: Effector, columns: dict[str, NDArray[np.generic]], *, deflection: float
) -> NDArray[np.int8]:
    """Check a batch against one design at a time, and return its codes."""
    found = measure_designs(effector, columns, deflection=deflection)
    for i in range(found.code.size):
        changes = {name: values[i].tolist() for name, values in columns.items()}
        row = try_design(effector, changes, deflection)
        assert row.feasible == (found.code[i] == 0), changes
        assert explain_design(effector, changes, deflection=deflection) == row.reason
        for name in NAMES:
            expected = getattr(row, name)
            given = float(getattr(found, name)[i])
            if not row.built or (name == "needed_pressure" and expected == 0.0):
                assert np.isnan(given)
            else:
                assert given == pytest.approx(expected, rel=1e-12, abs=1e-12)
    return found.code


@pytest.mark.slow(15)
def test_batch_is_what_one_design_at_a_time_gives() -> None:
    codes = compare(EFFECTOR, draw_designs(700, seed=1), deflection=12.0)
    assert np.all(np.bincount(codes, minlength=5)[:5] > 10)  # every kind of answer was met


def test_batch_of_few_designs() -> None:
    compare(EFFECTOR, draw_designs(40, seed=2), deflection=9.0)


@pytest.mark.parametrize("count", [1, 2, 4, 5])
def test_batch_of_other_muscles_and_angles(count: int) -> None:
    design = effector_preset("prototype")
    muscle = design.muscles[0].muscle
    placed = tuple(
        PlacedMuscle(name=f"M{k}", muscle=muscle.replace(modulus=0.4 + 0.1 * k), angle=0.9 * k)
        for k in range(count)
    )
    effector = Effector(design.replace(muscles=placed))
    rng = np.random.default_rng(count)
    angles = rng.uniform(-4.0, 8.0, (12, count))
    angles[0] = angles[0, 0]  # all at one place: no design, if there are several
    columns = {"angles": angles, "muscle.gap": np.linspace(0.0, 0.2, 12)}
    codes = compare(effector, columns, deflection=6.0)
    assert (codes[0] == 1) == (count > 1)


def test_sweep_uses_the_batch_where_it_holds() -> None:
    assert can_batch(EFFECTOR, ("offset", "angles"))
    assert not can_batch(EFFECTOR, ("muscles",))
    assert not can_batch(EFFECTOR, ("length", "backbone_length"))
    other = Effector(effector_preset("prototype"), lambda muscle: ThesisMuscle(muscle))
    assert not can_batch(other, ("offset",))
    parameters = {"offset": [1.0, 4.0], "muscle.braid_angle": [0.55, 0.7, 0.96]}
    for row in sweep(EFFECTOR, parameters, deflection=11.0).rows:
        alone = try_design(EFFECTOR, row.changes, 11.0)
        assert (row.reason, row.built) == (alone.reason, alone.built)
        assert row.area == pytest.approx(alone.area, rel=1e-12)
        assert row.needed_pressure == pytest.approx(alone.needed_pressure, rel=1e-12)

"""Stiffness and force of the tip against the model's own equations and classical beams."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq, linprog

from bozzini.effector.design import effector_preset
from bozzini.effector.effector import Effector
from bozzini.effector.equilibrium import balance
from bozzini.effector.inverse import solve_inverse
from bozzini.effector.linkage import contraction_for_lateral
from bozzini.effector.workspace import passive_stiffness, tip_force, tip_stiffness
from bozzini.muscle import EnergyMuscle, ThesisMuscle

PROTOTYPE = effector_preset("prototype")
UNITS = np.stack([np.cos(PROTOTYPE.angles), np.sin(PROTOTYPE.angles)], axis=-1)


@pytest.mark.parametrize("model", [EnergyMuscle, partial(ThesisMuscle, load_path="bulk")])
def test_stiffness_is_the_slope_of_the_loaded_equilibrium(model: Any) -> None:
    effector = Effector(PROTOTYPE, model)
    muscle, pressure, soft = effector.models[0], 0.6, 1.0 / passive_stiffness(PROTOTYPE)

    def settle(load: float) -> float:
        def miss(lateral: float) -> float:
            contraction = contraction_for_lateral(PROTOTYPE, lateral)
            pull = float(muscle.force(pressure, contraction))
            return lateral - PROTOTYPE.compliance * pull - soft * load

        return float(brentq(miss, 0.1, 20.0, xtol=1e-13, rtol=1e-15))

    assert settle(0.0) == pytest.approx(
        float(balance(effector, "R", pressure=pressure).lateral), abs=1e-9
    )
    step = 1e-4
    slope = (settle(step) - settle(-step)) / (2.0 * step)
    matrix = tip_stiffness(effector, {"R": pressure})
    along, across = UNITS[0], np.array([-UNITS[0, 1], UNITS[0, 0]])
    assert along @ matrix @ along == pytest.approx(1.0 / slope, rel=1e-6)
    assert across @ matrix @ across == pytest.approx(passive_stiffness(PROTOTYPE))
    assert along @ matrix @ across == pytest.approx(0.0, abs=1e-15)


def test_stiffness_without_pressure_is_a_cantilever() -> None:
    effector = Effector(PROTOTYPE)
    deflection = 0.1 / passive_stiffness(PROTOTYPE)
    assert deflection == pytest.approx(15.19, abs=0.005)  # "approximately 15" in the thesis
    assert tip_stiffness(effector, [0.0, 0.0, 0.0]) == pytest.approx(
        passive_stiffness(PROTOTYPE) * np.eye(2)
    )


def test_stiffness_of_several_muscles_is_symmetric_and_grows() -> None:
    effector = Effector(PROTOTYPE)
    pressures = np.random.default_rng(6).uniform(0.0, 0.827, (40, 3))
    matrix = tip_stiffness(effector, pressures)
    assert matrix.shape == (40, 2, 2)
    assert matrix == pytest.approx(np.swapaxes(matrix, 1, 2))
    assert np.linalg.eigvalsh(matrix).min() >= passive_stiffness(PROTOTYPE) * (1.0 - 1e-12)


def test_force_of_one_muscle_is_the_reaction_of_a_held_beam() -> None:
    design = PROTOTYPE.replace(muscles=PROTOTYPE.muscles[:1], beam_factor=2.0)
    effector = Effector(design)
    found = tip_force(effector, UNITS[0])
    pull = float(effector.models[0].blocked_force(design.pressure_limit))
    # Clamped and simply held, an end moment M gives the reaction 3 M / (2 L).
    reaction = 3.0 * design.offset * pull / (2.0 * design.backbone_length)
    assert found.force == pytest.approx(reaction)
    assert tip_force(effector, -UNITS[0]).force == 0.0
    across = tip_force(effector, [-UNITS[0, 1], UNITS[0, 0]]).force
    assert across == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("lateral", [(0.0, 0.0), (3.0, -4.0), (-2.0, 6.0)])
def test_force_is_the_optimum_of_a_linear_programme(lateral: tuple[float, float]) -> None:
    effector = Effector(PROTOTYPE)
    angle = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    toward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = tip_force(effector, 7.0 * toward, lateral=lateral)
    assert found.direction == pytest.approx(toward)
    soft = 1.0 / passive_stiffness(PROTOTYPE)
    for one, force in zip(toward, found.force, strict=True):
        # c sum F_i e_i - soft f d = v, maximise f.
        equal = np.column_stack([PROTOTYPE.compliance * UNITS.T, -soft * one])
        bounds = [(0.0, pull) for pull in found.pulls] + [(0.0, None)]
        answer = linprog([0.0, 0.0, 0.0, -1.0], A_eq=equal, b_eq=lateral, bounds=bounds)
        assert answer.status == 0
        assert force == pytest.approx(-answer.fun, abs=1e-9)


def test_nothing_is_left_at_the_edge() -> None:
    effector = Effector(PROTOTYPE)
    edge = solve_inverse(effector, 100.0 * UNITS[0]).delivered
    assert tip_force(effector, UNITS[0], lateral=edge).force == pytest.approx(0.0, abs=1e-9)
    inside = tip_force(effector, UNITS[0], lateral=0.5 * edge).force
    assert 0.0 < inside < tip_force(effector, UNITS[0]).force

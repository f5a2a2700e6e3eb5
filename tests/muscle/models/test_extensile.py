"""Muscles with a braid above the locking angle: they get longer under pressure, and push."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bozzini.errors import InputError
from bozzini.muscle import LOCKING_ANGLE, Muscle, preset
from bozzini.muscle.models import MODELS
from tests.muscle.models.catalogue import differentiate

SOFT = Muscle(
    length=50.0, outer_radius=5.0, inner_radius=4.95, braid_angle=math.radians(68.0), modulus=1e-6
).fill()
HOLDS = [name for name in MODELS.own if MODELS[name].extensile]


def build(name, muscle):
    kind = MODELS[name]
    guess = kind.guess_parameters(muscle) if kind.card.parameters else {}
    return kind(muscle, **guess)


def test_some_models_hold():
    assert {"gaylord-1", "gaylord-2", "kothera-balance", "delson"} <= set(HOLDS)


@pytest.mark.parametrize("name", HOLDS)
def test_a_thin_soft_wall_leaves_the_ideal_braid(name):
    model = build(name, SOFT)
    braid = SOFT.braid
    contraction = np.array([-20.0, -10.0, 0.0, 4.0])
    ideal = braid.ideal_force(0.3, 50.0 - contraction)
    assert model.force(0.3, contraction) == pytest.approx(ideal, rel=0.06, abs=0.5)
    # ... which is the pressure times the volume that it gains.
    slope = differentiate(braid.volume_at, 50.0 - contraction)
    assert ideal == pytest.approx(-0.3 * slope, rel=1e-6)
    assert model.force(0.3, 0.0) < 0.0  # it pushes


@pytest.mark.parametrize("name", HOLDS)
def test_it_gets_longer_up_to_locking_and_holds_what_pushes(name):
    model = build(name, SOFT)
    free = model.contraction([0.1, 0.3])
    assert np.all(free < 0.0)
    assert model.braid_angle(0.3) == pytest.approx(LOCKING_ANGLE, abs=math.radians(0.5))
    # A load that pushes makes it shorter, one that pulls longer; both are forces at their lengths.
    loads = np.array([-20.0, -5.0, 0.0, 5.0])
    held = model.contraction(0.3, loads)
    assert np.all(np.diff(held) < 0.0)
    assert model.force(0.3, held) == pytest.approx(loads, abs=1e-6)


def test_friction_is_against_the_motion():
    law = {"inflation_pressure": lambda radius: 0.0 * radius}
    model = MODELS["schulte"](SOFT, friction=0.01, **law)
    up, none, down = (
        float(model.contraction(0.3, -5.0, direction=way)) for way in ("inflating", "", "deflating")
    )
    assert up > none > down  # not yet as long on the way up


@pytest.mark.parametrize("name", sorted(set(MODELS.own) - set(HOLDS)))
def test_the_others_refuse_in_one_line(name):
    with pytest.raises(InputError, match=r"braid angle is 68 deg: .* \[5, 54\] deg") as error:
        MODELS[name](SOFT)
    assert "\n" not in str(error.value)


def test_a_muscle_that_contracts_cannot_push():
    with pytest.raises(InputError, match=r"load is -1 N: it must lie in \[0, "):
        MODELS["gaylord-1"](preset("effector-45")).contraction(0.3, -1.0)

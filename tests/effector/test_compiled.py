"""A model that brings compiled functions gives what it gives without them."""

from __future__ import annotations

import pickle
from dataclasses import dataclass

import numpy as np
import pytest

from bozzini.effector import Effector, effector_preset
from bozzini.errors import InputError
from bozzini.muscle import CompiledMuscle, EnergyMuscle, ThesisMuscle
from bozzini.muscle.kernels import interface
from bozzini.muscle.kernels.interface import view_numbers, view_out
from tests.effector.models import SpringMuscle


def start(numbers_at, pressure, most, out_at):
    numbers, out = view_numbers(numbers_at), view_out(out_at)
    free = numbers[1] * (pressure - numbers[2])
    out[0] = out[1] = out[2] = 0.0
    if free <= 0.0:
        return 1 if free < 0.0 else 0
    out[0] = free
    out[1] = min(free, most)
    out[2] = 0.5 * out[1]
    return 0


def pull(numbers_at, state, pressure, contraction, out_at):
    numbers, out = view_numbers(numbers_at), view_out(out_at)
    out[0] = numbers[0] * (state - contraction)
    out[1] = -numbers[0]
    return 0


def pressure(numbers_at, contraction, force, limit, out_at):
    numbers, out = view_numbers(numbers_at), view_out(out_at)
    out[0] = min(limit, (force / numbers[0] + contraction) / numbers[1] + numbers[2])
    return 1


@dataclass(frozen=True)
class CompiledSpring(SpringMuscle):
    @property
    def compiled(self):
        return CompiledMuscle(
            numbers=(self.spring, self.gain, self.contact),
            start=interface.compile_start(start),
            pull=interface.compile_pull(pull),
            pressure=interface.compile_pressure(pressure),
        )


class SlowEnergy(EnergyMuscle):
    compiled = None


class SlowThesis(ThesisMuscle):
    compiled = None


@pytest.mark.parametrize(
    ("fast", "slow"),
    [
        (CompiledSpring, SpringMuscle),
        (EnergyMuscle, SlowEnergy),
        (lambda m: ThesisMuscle(m, load_path="bulk"), lambda m: SlowThesis(m, load_path="bulk")),
    ],
)
def test_compiled_or_not_the_answers_are_the_same(fast, slow):
    one, other = (Effector(effector_preset("prototype"), kind) for kind in (fast, slow))
    assert not one.packed.uncompiled and len(other.packed.uncompiled) == 3
    table = np.random.default_rng(1).uniform(0.0, 0.8, (12, 3))
    table[0] = 0.0
    assert one.forward(table).tip == pytest.approx(other.forward(table).tip, abs=1e-7)
    targets = 5.0 * np.random.default_rng(2).normal(size=(12, 2))
    found, again = one.inverse(targets), other.inverse(targets)
    assert found.pressures == pytest.approx(again.pressures, abs=1e-7)
    assert found.converged.all()


def test_a_subclass_with_another_force_is_not_taken_for_its_parent():
    class Half(EnergyMuscle):
        def force(self, pressure, contraction, *, direction=None):
            return 0.5 * super().force(pressure, contraction, direction=direction)

    assert Half(effector_preset("prototype").muscles[0].muscle).compiled is None


def test_an_effector_is_packed_anew_in_another_process():
    effector = Effector(effector_preset("prototype"))
    again = pickle.loads(pickle.dumps(effector))
    assert again == effector
    assert again.forward({"R": 0.5}).tip == pytest.approx(effector.forward({"R": 0.5}).tip)


def test_a_model_of_too_many_numbers_is_refused():
    with pytest.raises(InputError, match="has 33 numbers: it must have at most 32"):
        CompiledMuscle(numbers=(0.0,) * 33, start=0, pull=0, pressure=0)

"""What has to hold of any model of the catalogue, for the tests of its families."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import assume
from hypothesis import strategies as st

from bozzini.checks import list_quantities
from bozzini.errors import InputError
from bozzini.muscle import ConvergenceError, Muscle, MuscleModel
from bozzini.muscle.models import MODELS, CatalogueModel
from tests.muscle.models.catalogue import MUSCLE, built, find_lengths
from tests.muscle.strategies import pressures

WAYS = ["inflating", "", "deflating"]


def pull(model: CatalogueModel, pressure: Any, length: Any, **rest: Any) -> Any:
    """Force at a length that contracts, instead of a contraction."""
    return model.force(pressure, model.braid.length - length, **rest)


def check_model(model: CatalogueModel, pressure: Any, load: Any, *, edge: float = 0.02) -> None:
    """Protocol, copies, batches, equilibria, and the slope of the force."""
    assert isinstance(model, MuscleModel)
    again = pickle.loads(pickle.dumps(model))
    assert again == model == model.replace() and hash(again) == hash(model)
    pressure, load = np.broadcast_arrays(np.asarray(pressure)[:, None], np.asarray(load))
    for way in WAYS:
        state = model.solve(pressure, load, direction=way)
        assert state.converged.all()
        held = model.force(pressure, state.contraction, direction=way)
        stiff = np.abs(model.stiffness(pressure, state.contraction, direction=way))
        assert np.all(np.abs(held - load) <= 1e-11 * (1.0 + np.abs(load) + 42.0 * stiff))
        one = model.contraction(pressure[-1, -1], load[-1, -1], direction=way)
        assert one == state.contraction[-1, -1]
        assert np.all(state.contact_pressure >= 0.0)
        slope_at, step = model.braid.length - find_lengths(model, 5, edge=edge), 1e-4
        near = [
            model.force(pressure[:, :1], slope_at + k * step, direction=way) for k in (-1.0, 1.0)
        ]
        slope = (near[0] - near[1]) / (2.0 * step)
        assert model.stiffness(pressure[:, :1], slope_at, direction=way) == pytest.approx(
            slope, rel=1e-5, abs=1e-6 * np.abs(slope).max() + 1e-12
        )


def find_unused(make: Callable[[Muscle], CatalogueModel], load: float = 0.1) -> set[str]:
    """Fields of a muscle that make no difference."""

    def answer(muscle: Muscle) -> list[float]:
        model = make(muscle)
        state = model.solve(0.5, load, direction=WAYS[:2])
        return [*state.contraction, *state.length, *state.braid_angle, *state.contact_pressure]

    changes = {field: 1.01 * getattr(MUSCLE, field) for field in list_quantities(Muscle)}
    changes |= {"strands": 28, "mooney_ratio": 0.1, "friction_length": 0.01, "end_length": 3.0,
                "poisson_ratio": 0.4}  # fmt: skip
    return {
        field
        for field, value in changes.items()
        if answer(MUSCLE.replace(**{field: value})) == answer(MUSCLE)
    }


def ask_anything(data: st.DataObject, name: str, muscle: Muscle, *, least: float = 1e-30) -> None:
    """Any legal model, any question: a finite answer or a typed error of one line.

    A load is held to `least` [N], below which a strain of the last digit of a length is more.
    """
    model = data.draw(built(name, muscle))
    assume(model is not None)
    pressure = data.draw(st.one_of(pressures(muscle), st.floats()))
    low, high = model.contraction_limits
    other = data.draw(st.one_of(st.floats(low, high), st.just(0.0), st.floats()))
    direction = data.draw(st.sampled_from([None, *WAYS]))
    for question in (model.force, model.stiffness, model.contraction, model.solve):
        try:
            answer = question(pressure, other, direction=direction)
        except InputError as error:
            assert "must" in str(error) and "\n" not in str(error)
            continue
        except ConvergenceError:
            assert question == model.contraction
            continue
        for value in vars(answer).values() if question == model.solve else [answer]:
            assert value.dtype.kind == "U" or np.isfinite(value).all()
        if question == model.solve and answer.converged:
            held = model.force(pressure, answer.contraction, direction=direction)
            scale = np.abs(model.stiffness(pressure, answer.contraction, direction=direction))
            reach = scale * np.ptp(find_lengths(model, 3, edge=0.0))
            slack = 1e-6 * (reach + other + np.abs(held)) + least
            assert held == pytest.approx(other, abs=float(slack))


def recover_linear(
    name: str, truth: dict[str, float], muscle: Muscle = MUSCLE, **laws: Any
) -> dict[str, float]:
    """The linear constants of a model, from forces that it gives with `truth`, by least squares."""
    kind = MODELS[name]
    names = [item.name for item in kind.card.parameters if item.linear and item.name in truth]
    fixed = {**kind.guess_parameters(muscle), **laws, **truth}
    model = kind(muscle, **fixed)
    lengths = find_lengths(model, 24, edge=0.1)
    pressure = np.linspace(0.1, 0.8, 7)[:, None]
    ways = np.array(WAYS)[np.arange(24) % 3]

    def forces(**changes: float) -> np.ndarray:
        return np.ravel(
            pull(kind(muscle, **{**fixed, **changes}), pressure, lengths, direction=ways)
        )

    steps, base = {}, {}
    for item in kind.card.parameters:
        if item.name in names:
            low, high = item.bounds
            steps[item.name] = min(1.0, 0.25 * (high - low))
            base[item.name] = max(0.0, low + steps[item.name])
    start = forces(**base)
    columns = [
        (forces(**{**base, name: base[name] + steps[name]}) - start) / steps[name] for name in names
    ]
    matrix = np.stack(columns, axis=1)
    scale = np.linalg.norm(matrix, axis=0)
    found = np.linalg.lstsq(matrix / scale, forces() - start, rcond=None)[0] / scale
    return {name: base[name] + float(value) for name, value in zip(names, found, strict=True)}

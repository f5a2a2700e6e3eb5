"""The design: checked when built, changed by copy, and the presets."""

from __future__ import annotations

import dataclasses
import math
import pickle

import numpy as np
import pytest
from hypothesis import given

from bozzini.checks import list_quantities
from bozzini.errors import InputError
from bozzini.io.records import read_record, write_record
from bozzini.muscle import MODELS, PRESETS, Muscle, preset
from bozzini.results import to_plain
from tests.muscle.strategies import muscles

RANGED = (
    "length",
    "outer_radius",
    "inner_radius",
    "braid_angle",
    "gap",
    "friction_length",
    "strand_radius",
    "end_length",
    "dead_length",
    "modulus",
    "poisson_ratio",
    "strand_modulus",
    "mooney_ratio",
)


@given(muscles())
def test_parts_have_the_muscles_dimensions(muscle):
    assert muscle.braid.radius == muscle.outer_radius + muscle.gap
    assert muscle.braid.length == muscle.tube.length == muscle.length
    assert muscle.tube.outer_radius == muscle.outer_radius
    assert muscle.active_length + muscle.dead_length == pytest.approx(muscle.length)
    assert pickle.loads(pickle.dumps(muscle)) == muscle


@pytest.mark.parametrize("name", RANGED)
def test_ranges_end_where_they_say(name):
    muscle = preset("thesis-45")
    low, high = muscle.legal_range(name)
    assert low < high
    for value in (low - 1e-3 * (high - low), high + 1e-3 * (high - low), math.nan, math.inf):
        with pytest.raises(InputError, match=f"muscle {name.replace('_', ' ')} is .*must lie in"):
            muscle.replace(**{name: value})
    if name not in ("length", "outer_radius", "inner_radius", "strand_radius", "braid_angle"):
        for value in (low, high):  # the others have company that these ends would make illegal
            assert getattr(muscle.replace(**{name: value}), name) == value


def test_fields_become_plain_numbers():
    """Whatever they came as, so that equal muscles are equal and models need not look again."""
    muscle = preset(
        "thesis-45", length=np.int64(45), outer_radius=np.array(0.55), strands=30.0, gap=0
    )
    assert muscle == preset("thesis-45", gap=0.0)
    assert {type(getattr(muscle, name)) for name in ("length", "outer_radius", "gap")} == {float}
    assert type(muscle.strands) is int


BARE = Muscle(length=250.0, outer_radius=9.0)


def test_what_is_not_given_is_unset_and_not_inherited():
    assert set(BARE.unset) == {
        *("inner_radius", "braid_angle", "strands", "strand_radius", "modulus", "strand_modulus")
    }
    assert set(BARE.given) | set(BARE.unset) == set(list_quantities(Muscle))
    for name in BARE.unset:
        with pytest.raises(InputError, match=f"the muscle has no {name.replace('_', ' ')}"):
            getattr(BARE, name)
    for part in ("tube", "braid"):
        with pytest.raises(InputError, match="the muscle has no"):
            getattr(BARE, part)
    assert BARE.gap == BARE.dead_length == BARE.end_length == BARE.friction_length == 0.0
    assert pickle.loads(pickle.dumps(BARE)) == BARE == BARE.replace(modulus=None)
    assert hash(BARE) == hash(BARE.replace())
    assert BARE != BARE.replace(modulus=1.0) != BARE.replace(modulus=2.0)
    assert eval(repr(BARE), {"Muscle": Muscle}) == BARE
    assert to_plain(BARE) == BARE.given == read_record(write_record(BARE), Muscle).given
    assert BARE.fill().unset == ()
    assert BARE.fill(["modulus"]).unset == tuple(n for n in BARE.unset if n != "modulus")
    assert BARE.replace(modulus=3.0).fill().modulus == 3.0


def answer(model):
    """What a model pulls with, or why it has no answer."""
    try:
        return float(model.force(0.2, 1.0))
    except InputError as error:
        return str(error)


@pytest.mark.parametrize("name", MODELS)
def test_a_model_needs_what_makes_a_difference_to_it_and_no_more(name):
    kind, full = MODELS[name], BARE.fill()
    own = {item.name: item.bounds[0] for item in kind.list_parameters() if item.default is None}
    own |= kind.guess_parameters(BARE) if name in MODELS.cards else {}
    own |= {law.name: (lambda *at: 0.1 * at[0]) for law in kind.card.laws} if kind.card else {}
    needed = [field for field in BARE.unset if field not in kind.unused]
    enough = BARE.replace(**{field: getattr(full, field) for field in needed})
    assert answer(kind(enough, **own)) == answer(kind(full, **own))
    for field in needed:
        word = field.replace("_", "-")
        with pytest.raises(InputError, match=f"the model {name} needs the muscle's {word}: give "):
            kind(enough.replace(**{field: None}), **own)
    with pytest.raises(InputError, match=", ".join(needed).replace("_", "-")):
        kind(BARE, **own)


def test_strands_that_do_not_fit_are_refused():
    muscle = preset("thesis-45")
    high = muscle.legal_range("strand_radius")[1]
    # Thirty strands in two families, flat side by side across the strands' direction.
    assert 15 * 2.0 * high == pytest.approx(
        2.0 * math.pi * muscle.braid_radius * math.cos(muscle.braid_angle)
    )
    with pytest.raises(InputError, match="muscle strand radius is 0.2 mm"):
        muscle.replace(strand_radius=0.2)
    with pytest.raises(InputError, match="muscle strands is 2.5: it must be a whole number"):
        muscle.replace(strands=2.5)


def test_presets():
    miniature = {"thesis-40", "thesis-45", "thesis-60", "effector-45", "fitted-45", "measured-45"}
    assert set(PRESETS) == miniature | {"festo-10", "festo-20", "festo-40"}
    for name, item in PRESETS.items():
        assert preset(name) == item.muscle
        assert item.source
        size = float(name.split("-")[1])
        if name in miniature:
            assert item.muscle.length == size
            assert item.muscle.unset == ()
        else:
            assert 2.0 * item.muscle.outer_radius == size
            assert item.muscle.unset == BARE.unset
    assert preset("effector-45", outer_radius=0.55) == preset("thesis-45")
    fitted = preset("fitted-45", modulus=0.35, dead_length=0.0)
    assert fitted == preset("effector-45")


def test_a_field_is_described_once():
    """Options, files and fits read unit, kind and help from the fields themselves."""
    from bozzini.cli.muscle import solve_command
    from bozzini.muscle.problem import PARAMETER_UNITS, choose_scale
    from bozzini.units import INTERNAL_UNITS

    options = {option.name: option for option in solve_command.params}
    for name, quantity in list_quantities(Muscle).items():
        assert options[name].help == quantity.help
        assert options[name].type.name == quantity.kind.replace("dimensionless", "number")
        assert quantity.unit == INTERNAL_UNITS[quantity.kind]
        if name not in ("length", "strands"):
            assert PARAMETER_UNITS[name] == quantity.unit
            assert choose_scale(name, 3.0, own=False) == (quantity.scale or pytest.approx(0.3))
    assert set(list_quantities(Muscle)) == {field.name for field in dataclasses.fields(Muscle)}

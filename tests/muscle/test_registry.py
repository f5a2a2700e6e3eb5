"""Models of other packages: listed, loaded when asked for, computed with like our own."""

from __future__ import annotations

import json
from importlib.metadata import EntryPoint

import numpy as np
import pytest

import bozzini.muscle
from bozzini.cli.main import main
from bozzini.effector import Effector, effector_preset
from bozzini.errors import PluginError
from bozzini.muscle import MODELS, CatalogueModel, EnergyMuscle
from bozzini.muscle.models import ModelRegistry

GROUP = MODELS.group

SPRING = EntryPoint("spring", "tests.effector.models:SpringMuscle", GROUP)
LOST = EntryPoint("lost", "no_such_package:Model", GROUP)
NONE = EntryPoint("none", "json:JSONDecoder", GROUP)
OURS = EntryPoint("energy", "no_such_package:Model", GROUP)


@pytest.fixture
def registry(monkeypatch):
    points = [SPRING, LOST, NONE, OURS]
    monkeypatch.setattr(
        "bozzini.registry.entry_points",
        lambda *, group: [point for point in points if point.group == group],
    )
    return ModelRegistry()


@pytest.fixture
def run(capsys, monkeypatch):
    monkeypatch.setitem(MODELS.__dict__, "plugins", {"spring": SPRING})

    def call(*arguments):
        capsys.readouterr()
        code = main(["muscle", *arguments])
        return code, capsys.readouterr().out

    return call


def test_models_of_other_packages_stand_beside_ours(registry):
    assert [*registry][-3:] == ["spring", "lost", "none"]
    assert len(registry) == len(registry.own) + 3
    assert registry["energy"] is EnergyMuscle  # a name that we have stays ours
    muscle = effector_preset("prototype").muscles[0].muscle
    effector = Effector(effector_preset("prototype"), registry["spring"])
    assert effector.models[0].muscle == muscle
    assert effector.packed.uncompiled == [0, 1, 2]
    tip = effector.forward({"R": 0.3}).tip
    assert effector.inverse(tip[:2]).pressures == pytest.approx([0.3, 0.0, 0.0], abs=1e-6)


def test_a_package_that_is_broken_harms_only_its_own_model(registry):
    with pytest.raises(PluginError, match="'lost' of no_such_package:Model cannot be imported"):
        registry["lost"]
    with pytest.raises(PluginError, match="'none' of json:JSONDecoder .* must be a MuscleModel"):
        registry["none"]
    with pytest.raises(KeyError):
        registry["nobody"]
    assert "nobody" not in registry


def test_every_model_of_ours_is_found_by_its_name():
    for name, kind in MODELS.own.items():
        assert kind.name == name
        assert (kind.card is None) == (not issubclass(kind, CatalogueModel))
        assert kind.card is None or kind.card.name == name


def test_every_model_of_ours_is_in_the_package_by_the_name_of_its_class():
    names = dir(bozzini.muscle)
    assert {*bozzini.muscle.__all__} <= {*names}
    for kind in MODELS.own.values():
        assert kind.__name__ in names and getattr(bozzini.muscle, kind.__name__) is kind


def test_commands_know_models_of_other_packages(run):
    code, out = run("models")
    assert code == 0
    assert "spring: of the package tests.effector.models:SpringMuscle" in out
    listed = json.loads(run("models", "--json")[1])
    assert listed["plugins"] == {"spring": SPRING.value}
    code, out = run(
        "solve", "--model", "spring", "--pressure", "0.3MPa", "--load", "0.5N", "--json"
    )
    found = json.loads(out)
    assert code == 0
    model = MODELS["spring"](effector_preset("prototype").muscles[0].muscle)
    assert found["contraction_mm"] == pytest.approx(float(model.contraction(0.3, 0.5)))
    assert found["converged"] and abs(found["residual_N"]) < 1e-12
    assert run("models", "spring")[0] == 2


def test_what_a_model_does_not_bring_follows_from_force_and_contraction():
    class Plain(MODELS.own["energy"]):
        """Only the two methods that every model must have are its own."""

        name = "plain"

    for name in ("stiffness", "solve", "dead_band"):
        setattr(Plain, name, getattr(EnergyMuscle.__mro__[1], name))
    muscle = effector_preset("prototype").muscles[0].muscle
    plain, known = Plain(muscle), EnergyMuscle(muscle)
    pressure, held = np.array([0.3, 0.6]), np.array([2.0, 4.0])
    assert plain.stiffness(pressure, held) == pytest.approx(
        known.stiffness(pressure, held), rel=1e-5
    )
    one, other = plain.solve(pressure, 0.1), known.solve(pressure, 0.1)
    assert one.contraction == pytest.approx(other.contraction)
    assert one.length == pytest.approx(other.length)
    assert np.abs(one.residual).max() < 1e-9
    assert plain.compiled is None and known.compiled is not None

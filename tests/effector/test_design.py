"""`EffectorDesign`: what is legal, what follows from it, and what does not fit together."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.effector import (
    EFFECTOR_PRESETS,
    Effector,
    EffectorDesign,
    PlacedMuscle,
    bend,
    effector_preset,
    find_conflicts,
    find_peak,
    rigidity_from_test,
)
from bozzini.errors import BozziniError, GeometryError, InputError
from bozzini.muscle import preset as muscle_preset
from tests.effector.strategies import designs


def test_prototype():
    design = effector_preset("prototype")
    assert design.names == ("R", "G", "B")
    assert np.degrees(design.angles) == pytest.approx([307.5, 219.0, 75.0])
    assert design.compliance == pytest.approx(13.5)
    assert design.index("B") == 2
    assert set(EFFECTOR_PRESETS) == {"measured", "prototype", "thesis"}
    assert pickle.loads(pickle.dumps(design)) == design


def test_rigidity_from_a_test():
    # 0.1 N deflects the section that the tables were made with by "approximately 15 mm".
    assert rigidity_from_test(0.1, 15.1875, length=45.0) == pytest.approx(200.0)
    assert rigidity_from_test(0.1, 15.0, length=45.0) == pytest.approx(202.5)


def test_a_catheter_adds_and_the_beam_formula_matters():
    design = effector_preset("prototype")
    with_catheter = design.replace(catheter_rigidity=100.0)
    assert with_catheter.rigidity == pytest.approx(300.0)
    assert with_catheter.compliance == pytest.approx(design.compliance * 2.0 / 3.0)
    # The end moment deflects by 1.5 times what the printed formula says.
    assert design.replace(beam_factor=2).compliance == pytest.approx(1.5 * design.compliance)


def test_an_offset_below_half_a_segment_is_refused():
    with pytest.raises(GeometryError, match="at least 1.5 mm, half a segment"):
        effector_preset("prototype", offset=1.49)
    assert find_peak(effector_preset("prototype", offset=1.51)).lateral > 0.0


def test_resize():
    longer = effector_preset("prototype").resize(60.0)
    assert longer.backbone_length == 60.0
    assert {placed.muscle.length for placed in longer.muscles} == {60.0}
    assert longer.resize(45.0) == effector_preset("prototype")


def test_conflicts_of_the_prototype():
    """The drawn holder has space for 2.75 to 3.5 mm, the tables need 4."""
    found = find_conflicts(effector_preset("prototype"))
    assert any("has space for [2.75, 3.5] mm" in line for line in found)
    assert not any("apart" in line for line in found)
    # Wide enough, with a thin coil, everything fits.
    assert (
        find_conflicts(effector_preset("prototype", holder_diameter=12.0, coil_diameter=2.0)) == ()
    )


def test_conflicts_of_others():
    muscle = muscle_preset("fitted-45")
    close = EffectorDesign(
        muscles=tuple(
            PlacedMuscle(name=name, muscle=muscle, angle=angle)
            for name, angle in (("A", 0.1), ("B", math.tau - 0.1))
        )
    )
    assert any("A and B are" in line for line in find_conflicts(close))
    inner = find_conflicts(effector_preset("prototype", offset=2.5))
    assert any("touches the 4 mm coil from a contraction of 0 mm" in line for line in inner)
    assert any("offset is 2.5 mm: from a contraction of 6.306 mm on not every" in k for k in inner)


def test_the_coil_is_touched_where_spacing_and_radius_meet():
    design = effector_preset("prototype")
    line = next(line for line in find_conflicts(design) if "coil" in line)
    contraction = float(line.split("contraction of ")[1].split()[0])
    muscle = design.muscles[0].muscle

    def room(contraction):
        length = muscle.active_length - contraction
        braid = muscle.replace(length=muscle.active_length, dead_length=0.0).braid
        return bend(design, contraction).spacing.min() - float(braid.radius_at(length)) - 2.0

    assert room(contraction - 0.1) > 0.0 > room(contraction + 0.1)


@given(designs(), st.sampled_from(["offset", "segments", "backbone_length", "flexural_rigidity"]))
def test_a_legal_design_is_usable(design, field):
    peak = find_peak(design)
    assert 0.0 < peak.contraction < design.backbone_length
    assert 0.0 < peak.lateral < design.backbone_length
    assert all(isinstance(line, str) for line in find_conflicts(design))
    try:
        changed = design.replace(**{field: 3})
    except BozziniError as error:
        assert "\n" not in str(error)
    else:
        assert math.isfinite(find_peak(changed).lateral)


def test_a_preset_brings_the_model_it_is_made_for():
    assert Effector.from_preset("prototype", offset=3.9) == Effector(
        effector_preset("prototype", offset=3.9)
    )
    found = Effector.from_preset("thesis").forward({"R": [0.6894, 0.5516, 0.4136]})
    assert found.lateral[0] == pytest.approx(20.4, abs=0.05)
    assert found.lateral == pytest.approx([20.4, 18.5, 15.8], abs=0.35)  # Tables 4.1, 4.3, 4.4
    assert pickle.loads(pickle.dumps(Effector.from_preset("thesis"))).models[0].name == "thesis"
    with pytest.raises(InputError, match="no effector preset 'fable'"):
        Effector.from_preset("fable")

"""Hypothesis strategies over the legal designs of an end-effector."""

from __future__ import annotations

import math
from typing import Any

from hypothesis import strategies as st

from bozzini.effector import EffectorDesign, PlacedMuscle
from bozzini.muscle import preset
from tests.muscle.strategies import spread


@st.composite
def designs(draw: Any, *, most: int = 4, closes: bool | None = None) -> EffectorDesign:
    """Any legal design; `closes`: whether every segment closes at every contraction."""
    length = draw(spread(12.0, 500.0))
    segments = draw(st.integers(1, 60))
    least = length / segments * (1.0 if closes else 0.5)
    offset = least * draw(spread(1.0001, 20.0 if closes is not False else 1.9999))
    muscle = preset("fitted-45", length=length, end_length=0.0, dead_length=0.3 * length)
    count = draw(st.integers(1, most))
    places = draw(st.lists(st.integers(0, 359), min_size=count, max_size=count, unique=True))
    return EffectorDesign(
        muscles=tuple(
            PlacedMuscle(name=f"M{i}", muscle=muscle, angle=math.radians(place))
            for i, place in enumerate(places)
        ),
        offset=min(offset, 1000.0),
        backbone_length=length,
        segments=segments,
        flexural_rigidity=draw(spread(1e-2, 1e6)),
        catheter_rigidity=draw(st.sampled_from([0.0, 50.0])),
        beam_factor=draw(st.sampled_from([2.0, 3.0])),
    )

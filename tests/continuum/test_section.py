"""Sections: disc places, stiffness by default, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from bozzini.continuum import Section, Tendon
from bozzini.errors import InputError


def test_discs_are_even_and_the_last_stands_at_the_end() -> None:
    section = Section(length=30.0, radius=5.0, discs=4)
    assert np.allclose(section.disc_places, [7.5, 15.0, 22.5, 30.0])


def test_given_discs_are_kept() -> None:
    section = Section(length=30.0, radius=5.0, disc_positions=(2.0, 9.0, 30.0))
    assert section.discs == 3
    assert section.disc_places.tolist() == [2.0, 9.0, 30.0]


def test_torsional_stiffness_is_that_of_a_round_rod_unless_given() -> None:
    # EI = E pi r^4 / 4 and GJ = E / (2 (1 + nu)) pi r^4 / 2.
    section = Section(length=30.0, radius=5.0, bending_stiffness=130.0)
    assert section.torsional_stiffness == pytest.approx(100.0)
    assert Section(length=1.0, radius=5.0, torsional_stiffness=7.0).torsional_stiffness == 7.0


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"length": 0.0}, r"section length is 0 mm: it must lie in \(0, 100000\] mm"),
        ({"length": math.nan}, "section length is nan"),
        ({"radius": -1.0}, "section radius is -1 mm"),
        ({"bending_stiffness": 0.0}, r"bending stiffness is 0 N mm\^2"),
        ({"torsional_stiffness": -1.0}, "torsional stiffness is -1"),
        ({"max_bend": 0.0}, "max bend is 0 rad"),
        ({"discs": 2.5}, "discs is 2.5"),
        ({"discs": -1}, "discs is -1"),
        ({"discs": 3, "disc_positions": (30.0,)}, "discs is 3 but disc_positions has 1"),
        ({"disc_positions": (10.0, 10.0, 30.0)}, r"disc_positions\[1\] is 10 mm"),
        ({"disc_positions": (10.0, 20.0)}, "ends at 20 mm"),
        ({"disc_positions": (10.0, 31.0)}, r"disc_positions\[1\] is 31 mm"),
        ({"tendons": ("a",)}, "each must be a Tendon"),
        ({"name": 3}, "name is 3"),
        ({"bending_stiffness": 1e300}, r"is 1e\+300 N mm\^2: it must lie in \[1e-09, 1e\+15\]"),
        ({"bending_stiffness": 1e-300}, r"is 1e-300 N mm\^2: it must lie in \[1e-09, 1e\+15\]"),
        ({"torsional_stiffness": 1e16}, "torsional stiffness is 1e"),
        ({"torsional_stiffness": 1e-20}, "torsional stiffness is 1e-20"),
        ({"tendons": Tendon(name="a", offset=1.0)}, "it must be a sequence of Tendon"),
        ({"tendons": None}, "tendons is None"),
        ({"disc_positions": 5}, "disc_positions is 5"),
        ({"disc_positions": None}, "disc_positions is None"),
        ({"disc_positions": (True, 30.0)}, r"disc_positions\[0\] is True"),
        ({"max_bend": np.ones(3)}, "max bend is array"),
    ],
)
def test_bad_field_is_refused_in_one_line(fields: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        Section(**{"length": 30.0, "radius": 5.0, **fields})
    assert "\n" not in str(caught.value)


def test_fields_are_plain_numbers() -> None:
    section = Section(length=30, radius=5, tendons=[Tendon(name="a", offset=1)])  # type: ignore[arg-type]
    assert isinstance(section.length, float)
    assert isinstance(section.tendons, tuple)
    placed = Section(length=30, radius=5, disc_positions=(np.float32(10.0), 30))  # type: ignore[arg-type]
    assert all(type(place) is float for place in placed.disc_positions)
    hash(section)

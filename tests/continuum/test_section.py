"""Sections: disc places, stiffness by default, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.continuum import Section, Tendon


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


def test_fields_are_plain_numbers() -> None:
    section = Section(length=30, radius=5, tendons=[Tendon(name="a", offset=1)])  # type: ignore[arg-type]
    assert isinstance(section.length, float)
    assert isinstance(section.tendons, tuple)
    placed = Section(length=30, radius=5, disc_positions=(np.float32(10.0), 30))  # type: ignore[arg-type]
    assert all(type(place) is float for place in placed.disc_positions)
    hash(section)

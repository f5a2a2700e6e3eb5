"""Fits of measured Festo muscles against fits by SciPy alone."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from bozzini.muscle import FitOptions, Muscle, RankOptions, rank, read_measurements
from bozzini.muscle.models import MODELS
from tests.validation.festo10 import LAWS, RADIUS, THICKNESS, fit_law, read_rows

MUSCLE = Muscle(
    length=100.0,
    outer_radius=RADIUS,
    inner_radius=RADIUS - THICKNESS,
    gap=0.0,
    dead_length=0.0,
    braid_angle=0.45,
    modulus=3.0,
)
SCIPY_AGREES = 0.02
"""Largest difference of an error from that of SciPy's own fit, as a share."""


@pytest.fixture
def table(festo10_dir):
    return festo10_dir / "plateaus_taut.csv"


@pytest.mark.parametrize("name", LAWS)
def test_laws_written_anew_are_those_of_the_catalogue(name):
    law, start = LAWS[name]
    kind, angle = MODELS[name], 0.45
    given = [item for item in kind.card.parameters if item.default is None and not item.only_with]
    names = [item.name for item in given]
    names += ["exponent"] if name == "ogden" else []
    uses_angle = law.__code__.co_argcount > 2
    constants = list(start[1:] if uses_angle else start)
    muscle = MUSCLE.replace(braid_angle=angle)
    if "modulus" in kind.card.uses:
        muscle = muscle.replace(modulus=constants.pop(0))
    model = kind(muscle, **dict(zip(names, constants, strict=True)))
    pressure, held = np.linspace(0.05, 0.6, 7)[:, None], np.linspace(0.0, 18.0, 5)
    expected = law(pressure, 1.0 - held / MUSCLE.length, *start)
    scale = np.abs(expected).max()
    assert model.force(pressure, held) == pytest.approx(expected, rel=1e-9, abs=1e-9 * scale)


@pytest.mark.slow
def test_the_ranking_is_that_of_fits_by_scipy_alone(table):
    rows = read_rows(table)
    own = {name: fit_law(name, rows)[1] for name in LAWS}
    options = RankOptions(
        fields=("braid_angle", "modulus"), folds=0, fit=FitOptions(response="force")
    )
    ranking = rank(read_measurements(table), MUSCLE, models=list(LAWS), options=options)
    found = {entry.name: entry.score.rmse for entry in ranking.models}
    assert found == pytest.approx(own, rel=SCIPY_AGREES)
    for one, other in combinations(LAWS, 2):
        if abs(own[one] / own[other] - 1.0) > SCIPY_AGREES:
            assert (found[one] < found[other]) == (own[one] < own[other])

"""Loops of measured Festo muscles at constant length."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.muscle.hysteresis import GeneralisedPrandtlIshlinskii, LoopOptions
from bozzini.muscle.loops import LoopFitOptions, LoopRecord, fit_loop

ERROR = 1.5
"""Root mean square [N] of a loop that was not fitted; the forces reach 300 to 400 N."""


@pytest.mark.slow
def test_a_festo_muscle_at_constant_length_has_next_to_no_loop(festo10_dir):
    """One loop of each specimen is fitted, the next predicted; a curve without memory does so too.

    The fit must not find a loop where there is none.
    """
    import pandas

    table = pandas.read_csv(festo10_dir / "plateaus.csv", comment="#")
    for _, rows in table.groupby("specimen"):
        records = []
        for test in (9, 10):
            own = rows[(rows["test"] == test) & (rows["contraction [mm]"] == 0.0)]
            own = own.sort_values("time [s]")
            records.append(
                LoopRecord(
                    time=own["time [s]"],
                    pressure=own["pressure [kPa]"] / 1e3,
                    response=own["load [N]"],
                    kind="force",
                )
            )
        first, second = records
        fit = fit_loop(first, options=LoopFitOptions(drift="none"))
        without = GeneralisedPrandtlIshlinskii.identify(
            first.pressure,
            first.response,
            count=1,
            options=LoopOptions(carried=True, terms=np.ones((len(first.time), 1))),
        )
        missed = second.response - fit.model.trace(second.pressure)
        bare = second.response - without.operator.apply(second.pressure) - without.terms[0]
        assert np.sqrt(np.mean(missed**2)) < ERROR
        assert np.sqrt(np.mean(bare**2)) < ERROR
        assert any("hardly rises after" in note for note in fit.notes)

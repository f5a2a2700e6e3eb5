"""Loops that do not start at rest: what counts, what is not determined, and what is no advice."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.muscle.hysteresis import GeneralisedPrandtlIshlinskii, PrandtlIshlinskii
from bozzini.muscle.hysteresis.operator import LoopOptions
from bozzini.muscle.loops import LoopFitOptions, LoopRecord, fit_loop

TURNS = (5, 3, 8, 2, 7, 1.5, 8, 3, 7, 2, 8, 2, 10, 3, 8, 0.95, 10, 0, 9, 0, 10, 0, 8, 0, 6, 0, 5)
"""Inputs of a range of 10 that begin in its middle: the largest comes late, the lowest later [kPa].
"""
PLAYS = PrandtlIshlinskii((0.0, 5e-4, 2e-3), (4000.0, 2000.0, 1500.0))


def make_record(*, dip: float = 6.0, slope: float = 0.0, seed: int = 0) -> LoopRecord:
    """Return a record of plays that jumps where its input is low, which no play does."""
    ways = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(TURNS)))])
    time = np.linspace(0.0, 288.0, 2400)
    input_ = np.interp(time, 288.0 * ways / ways[-1], TURNS)
    response = PLAYS.apply([0.0, 6e-3, *(1e-3 * input_)])[2:]
    response = response - dip * np.clip((1.0 - input_) / 0.08, 0.0, 1.0) + slope * time
    noise = 0.3 * np.random.default_rng(seed).normal(size=len(time))
    return LoopRecord(time=time, pressure=1e-3 * input_, response=response + noise)


@pytest.mark.parametrize("seed", [0, 2])
def test_no_play_takes_a_weight_against_the_offset(seed):
    """Weights of 26,000 mm/MPa against an offset of -170 mm fitted as well, and were legal."""
    options = LoopFitOptions(drift="linear", hold_out=0.5)
    fit = fit_loop(make_record(seed=seed), "asymmetric", options=options)
    operator = fit.model.operator
    weights = (*operator.ascending_weights, *operator.descending_weights)
    assert max(weights) < sum(PLAYS.weights)
    assert abs(fit.model.offset) < 0.2 * fit.span


def test_the_counts_and_both_errors_stand_together():
    fit = fit_loop(make_record(), "asymmetric", options=LoopFitOptions(hold_out=0.5))
    said = fit.to_dict()
    assert said["fitted"] + said["skipped"] + said["held_out"] == said["samples"]
    assert said["skipped"] > said["fitted"] > 0
    for text in (
        f"{fit.fitted} of {len(fit.samples)} samples",
        f"{fit.skipped} samples skipped",
        f"{fit.error:.4g} mm held out",
        f"rms {fit.deviation:.4g} mm fitted",
    ):
        assert text in fit.describe_error()
    assert fit.error == fit.parts["held out"] > 3.0 * fit.deviation
    assert any("the rms of the fit is no error of what it predicts" in one for one in fit.notes)
    assert "held out" in fit.plot().get_title(loc="left")
    bare = fit_loop(make_record(), "asymmetric")
    assert "nothing held out, so that it is not known how well it predicts" in bare.describe_error()


def test_a_fit_is_poor_by_what_it_predicts():
    record = make_record(dip=0.0)
    response = record.response.copy()
    later = record.time > 160.0
    response[later] = 0.5 * response[later]  # another muscle than that fitted
    other = LoopRecord(time=record.time, pressure=record.pressure, response=response)
    fit = fit_loop(other, "prandtl-ishlinskii", options=LoopFitOptions(hold_out=0.45))
    assert fit.converged and fit.deviation < 0.02 * fit.span
    assert fit.is_poor and fit.to_dict()["poor"]
    assert any("the fit is poor" in one and "held out" in one for one in fit.notes)


def test_the_command_ends_with_1_if_what_is_held_out_is_missed(tmp_path, capsys):
    record = make_record(dip=0.0)
    shown = np.where(record.time > 160.0, 0.5, 1.0) * record.response
    rows = zip(record.time, 1e3 * record.pressure, shown, strict=True)
    table = tmp_path / "loop.csv"
    table.write_text(
        "time [s],pressure [kPa],contraction [mm]\n"
        + "".join(",".join(f"{x:.6g}" for x in row) + "\n" for row in rows)
    )
    command = ["muscle", "hysteresis", "fit", str(table), "--operator", "prandtl-ishlinskii"]
    assert main([*command, "--hold-out", "0.45"]) == 1
    said = capsys.readouterr().out
    assert "fitted" in said and "held out" in said and "skipped" in said and "is poor" in said


def test_a_drift_is_advised_where_it_helps_on_what_is_held_out():
    none = LoopFitOptions(drift="none", hold_out=0.45)
    still = fit_loop(make_record(), "prandtl-ishlinskii", options=none)
    assert not any("choose it" in one for one in still.notes)
    drifting = make_record(dip=0.0, slope=0.05)
    fit = fit_loop(drifting, "prandtl-ishlinskii", options=none)
    advice = [one for one in fit.notes if "choose it" in one]
    assert len(advice) == 1 and "a linear drift makes it" in advice[0]
    taken = LoopFitOptions(drift="linear", hold_out=0.45)
    assert fit_loop(drifting, "prandtl-ishlinskii", options=taken).error < 0.5 * fit.error
    bare = fit_loop(drifting, "prandtl-ishlinskii", options=LoopFitOptions(drift="none"))
    assert any("hold a part out to see whether a drift predicts it" in one for one in bare.notes)
    assert not any("choose it" in one for one in bare.notes)


@pytest.mark.parametrize("kind", [PrandtlIshlinskii, GeneralisedPrandtlIshlinskii])
def test_a_play_that_hardly_moves_is_named_and_left_out(kind):
    """Threshold 4.5 on a range of 10: after the first samples it moves by 0.1 of 9.1."""
    input_ = np.interp(np.linspace(0.0, 6.0, 400), range(7), [0, 10, 0.9, 10, 2, 9, 0.9])
    skip = int(np.argmax(input_)) + 1
    response = PrandtlIshlinskii((0.0, 1.0), (1.0, 0.5)).apply(input_)
    response = response - 2.0 * (input_ < 0.95)  # what that play would take for its own
    options = LoopOptions(skip=skip, carried=True, terms=np.ones((400, 1)))
    found = kind.identify(input_, response, thresholds=(0.0, 1.0, 4.5), options=options)
    plays = getattr(found.operator, "plays", found.operator)
    assert any(name.endswith("weights[2]") for name in found.undetermined)
    assert plays.weights[2] == 0.0
    assert plays.thresholds == (0.0, 1.0, 4.5)
    # chosen for the samples fitted, thresholds leave out plays that do not move over them
    short = np.concatenate([[0.0, 10.0], np.tile([4.0, 6.0], 20)])
    fit = kind.identify(short, short, options=LoopOptions(skip=2))
    assert max(getattr(fit.operator, "plays", fit.operator).thresholds) < 1.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_pressure_that_never_turns_tells_neither_loops_nor_a_drift(sign):
    """A rise, or a fall: time and pressure are one."""
    time = np.linspace(0.0, 120.0, 61)
    pressure = 1e-3 * (time if sign > 0.0 else 120.0 - time)
    record = LoopRecord(time=time, pressure=pressure, response=50.0 * pressure)
    fit = fit_loop(record, "prandtl-ishlinskii")
    assert "drift" in fit.undetermined and "drift" in fit.to_dict()["undetermined"]
    assert any("never turns" in one and "nor a drift" in one for one in fit.notes)
    assert not any("no part of the operator" in one for one in fit.notes)
    bare = fit_loop(record, "prandtl-ishlinskii", options=LoopFitOptions(drift="none"))
    assert any("do not tell loops" in one for one in bare.notes)
    assert "drift" not in bare.undetermined
    whole = fit_loop(make_record(), "prandtl-ishlinskii")
    assert whole.turns and "drift" not in whole.undetermined


def test_the_command_ends_with_1_if_a_drift_is_not_told_from_the_operator(tmp_path, capsys):
    table = tmp_path / "rise.csv"
    rows = "".join(f"{2 * k},{2 * k},{0.1 * k}\n" for k in range(61))
    table.write_text("time [s],pressure [kPa],contraction [mm]\n" + rows)
    command = ["muscle", "hysteresis", "fit", str(table), "--operator", "prandtl-ishlinskii"]
    assert main(command) == 1
    assert "linear, not determined" in capsys.readouterr().out
    assert main([*command, "--drift", "none"]) == 0

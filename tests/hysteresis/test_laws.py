"""Laws with memory: a free start, what they predict of rows held out, intervals that hold truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bozzini.errors import InputError
from bozzini.hysteresis import LoopRuns, compare_laws
from bozzini.hysteresis.comparison import BASELINES, LAWS
from bozzini.hysteresis.constants import Constant, identify_tendon, judge_constants
from bozzini.hysteresis.fitting import Fitted, Samples, fit_backlash, fit_bouc_wen, fit_plays
from bozzini.hysteresis.law import LoopLaw, place_plays, tell_turn, trace_plays
from bozzini.muscle.hysteresis import PrandtlIshlinskii
from bozzini.numeric.arrays import Floats
from tests.hysteresis.plants import BOUC_WEN, CONTAINS, PLANTS, WIDTH, make_record

FORMS = (
    {"windows": 1},
    {"windows": 3, "turn": -40.0},
    {"windows": 2, "drift": 0.3, "turn": 0.001},
)


@pytest.mark.parametrize("form", FORMS, ids=["one", "windows", "drift"])
@pytest.mark.parametrize("plant", PLANTS)
def test_laws_that_contain_a_plant_predict_it(plant: str, form: dict[str, float]) -> None:
    record = make_record(plant, seed=3, **form)  # type: ignore[arg-type]
    found = compare_laws(record.runs, hold_out=0.3, drift="linear" if "drift" in form else "none")
    errors = {row.law: row.held_out for row in found.rows}
    baseline = min(errors[law] for law in BASELINES)
    for law in CONTAINS[plant]:
        assert errors[law] < 1.2 * baseline
        assert errors[law] < 1.2 * record.noise
    assert found.row.law == found.best and found.converged
    assert errors[found.best] < 1.2 * min(errors.values())
    assert 0.88 < found.coverage <= 1.0
    parts = found.parts
    assert (parts.fitted.astype(int) + parts.held_out + parts.lead == 1).all()


def test_runs_held_out_are_settled_by_their_first_rows_alone() -> None:
    record = make_record("plays", windows=3)
    found = compare_laws(record.runs, hold_out=("b",))
    place = record.runs.slices[1]
    lead = found.parts.lead
    assert 0 < lead.sum() <= 0.2 * (place.stop - place.start)
    assert not lead[: place.start].any() and not lead[place.stop :].any()
    assert found.row.held_out < 1.2 * record.noise
    far = record.runs.output.copy()
    far[place.start + int(lead.sum()) : place.stop] += 50.0 * record.noise
    other = compare_laws(replace(record.runs, output=far), hold_out=("b",))
    assert other.fit.starts == found.fit.starts  # what is to be predicted does not matter
    assert other.row.fitted == found.row.fitted


@pytest.mark.parametrize("start", [0.0, 0.1, 0.35, 0.8, 1.0, 1.05, 1.4, 1.9])
def test_a_start_is_a_history_that_turned_last_where_it_says(start: float) -> None:
    widths, first, reach = np.array([0.0, 0.4, 1.1, 3.0, 5.0]), 1.3, 5.0
    turn = tell_turn(first, start, reach)
    afar = 60.0 if turn < first or start == 1.0 else -60.0
    history = [0.0, afar, turn, first] if start != 1.0 else [0.0, 60.0, first]
    for width, place in zip(widths, place_plays(first, widths, start, reach), strict=True):
        assert place == pytest.approx(PrandtlIshlinskii((width,), (1.0,)).apply(history)[-1])


def test_a_fan_is_a_play_between_its_own_edges() -> None:
    random = np.random.default_rng(1)
    inputs = np.repeat(random.uniform(-5.0, 5.0, size=200), 2)
    share, apex, width = 0.2, 0.7, 0.3
    place = place_plays(inputs[0], np.array([width]), 0.3, 5.0, (share, apex))[0]
    wanted = []
    for one in inputs:
        half = width + share * abs(one - apex)
        place = max(one - half, min(one + half, place))
        wanted.append(place)
    traced = trace_plays(inputs, (width,), 0.3, 5.0, (share, apex))
    assert traced[:, 0] == pytest.approx(wanted)


def test_starts_go_round() -> None:
    widths = np.array([0.4, 1.1, 3.0])
    for one, two in ((0.0, 2.0), (1.0, 1.0 + 1e-12)):
        first, second = (place_plays(0.0, widths, start, 3.0) for start in (one, two))
        assert first == pytest.approx(second)


def make_dip(seed: int) -> LoopRuns:
    """Return plays that jump where the input is low, as no play does; the range is 10."""
    turns = (
        5,
        3,
        8,
        2,
        7,
        1.5,
        8,
        3,
        7,
        2,
        8,
        2,
        10,
        3,
        8,
        0.95,
        10,
        0,
        9,
        0,
        10,
        0,
        8,
        0,
        6,
        0,
        5,
    )
    ways = np.append(0.0, np.cumsum(np.abs(np.diff(turns))))
    input_ = np.interp(np.linspace(0.0, ways[-1], 2400), ways, turns)
    output = PrandtlIshlinskii((0.0, 0.5, 2.0), (4.0, 2.0, 1.5)).apply([0.0, 6.0, *input_])[2:]
    output = output - 6.0 * np.clip((1.0 - input_) / 0.08, 0.0, 1.0)
    noise = 0.3 * np.random.default_rng(seed).normal(size=2400)
    return LoopRuns(
        input=input_, output=output + noise, time=np.arange(2400.0), labels=("1",), first=(0,),
        input_title="p [kPa]", output_title="y [mm]", time_title="time [s]",
    )  # fmt: skip


@pytest.mark.parametrize("seed", [0, 2])
def test_no_play_takes_a_weight_against_the_offset(seed: int) -> None:
    """A play of half width 4.5 took a weight of 27,281 against an offset of -213 mm."""
    runs = make_dip(seed)
    found = compare_laws(runs, hold_out=0.5, samples=600)
    rows = {row.law: row for row in found.rows}
    for law in ("prandtl-ishlinskii", "generalised"):
        one = compare_laws(runs, hold_out=0.5, law=law, samples=600)
        steep = one.fit.law.coefficients[1] / one.fit.law.half
        assert max(one.fit.law.weights) * abs(steep) < 10.0
        assert abs(one.fit.law.coefficients[0]) < 60.0
        assert rows[law].held_out < 1.2 * rows["backlash-cubic"].held_out
    assert rows[found.best].held_out < 1.2 * rows["backlash-cubic"].held_out


def test_a_play_that_hardly_moves_is_named_and_left_out() -> None:
    input_ = np.concatenate([np.linspace(0.0, 10.0, 50), np.tile([10.0, 7.0], 100), [0.0] * 2])
    input_ = np.interp(np.linspace(0.0, len(input_) - 1.0, 2000), np.arange(len(input_)), input_)
    output = PrandtlIshlinskii((0.0, 1.0), (1.0, 0.5)).apply(input_)
    samples = Samples((input_,), output, np.empty((2000, 0)))
    mask = (np.arange(2000) > 500) & (np.arange(2000) < 1900)
    backlash = fit_backlash(samples, mask)
    found = fit_plays(samples, mask, backlash)
    assert found.still == ()  # half widths are those of the rows fitted, here a range of 3
    assert max(found.law.thresholds) < 1.5
    wide = replace(backlash, law=replace(backlash.law, reach=5.0))
    found = fit_plays(samples, mask, wide)
    assert max(found.law.thresholds) < 1.5 < min(found.still)


def test_half_widths_of_backlash_come_back_with_intervals_that_hold_them() -> None:
    held = []
    for seed in range(200):
        record = make_record("backlash", seed=seed, count=150, noise=0.02)
        samples = Samples((record.runs.input,), record.runs.output, np.empty((150, 0)))
        mask = np.ones(150, dtype=np.bool_)
        start = LoopLaw(thresholds=(WIDTH,), weights=(1.0,), coefficients=(0.0,), centre=0.0,
                        half=1.0, straight=(0.0, 0.0), reach=9.0)  # fmt: skip
        first = fit_backlash(samples, mask, Fitted(start, (0.0,), np.empty(0)))
        found = fit_backlash(samples, mask, first)
        width = judge_constants(found, samples, mask)[0]
        assert width.name == "half width" and width.is_determined
        held.append(width.low < WIDTH < width.high)
    assert 0.9 <= np.mean(held) <= 0.99


def test_intervals_of_weights_hold_them_wherever_the_input_is_zero() -> None:
    """They were up to a hundred times too wide where an input is as far below 0 as above."""
    truth = np.array([1.0, 0.5, 0.6, 0.4]) / 2.5
    widths = (0.0, 0.5, 1.5, 3.0)
    input_ = 8.0 * np.sin(np.linspace(0.0, 94.0, 600)) * np.linspace(0.3, 1.0, 600)
    clean = PLANTS["plays"](np.append([0.0, 9.0, -4.0], input_))[3:]
    mask = np.ones(600, dtype=np.bool_)
    held = []
    for seed in range(30):
        noise = 0.2 * np.random.default_rng(seed).normal(size=600)
        ends = []
        for shift in (0.0, -0.5 * float(input_.max() + input_.min()), 20.0):
            samples = Samples((input_ + shift,), clean + noise, np.empty((600, 0)))
            plays = samples.trace(widths, (0.0,), 8.0)
            found = np.linalg.lstsq(np.c_[plays, mask], samples.outputs, rcond=None)[0]
            law = LoopLaw(thresholds=widths, weights=tuple(found[:4] / found[:4].sum()),
                          coefficients=(found[4], found[:4].sum()), centre=0.0, half=1.0,
                          straight=(-99.0, 99.0), reach=8.0)  # fmt: skip
            known = judge_constants(Fitted(law, (0.0,), np.empty(0)), samples, mask)
            ends.append([(item.low, item.high) for item in known])
        assert np.ptp(ends, axis=0).max() < 1e-4
        held += [low < share < high for (low, high), share in zip(ends[0], truth, strict=True)]
    assert 0.88 <= np.mean(held) <= 0.99


def test_an_apex_that_the_rows_do_not_show_is_named() -> None:
    """Of inputs on one side of the apex only what half width and apex make up together is known."""
    input_ = 75.0 + 25.0 * np.sin(np.linspace(0.0, 60.0, 400)) * np.linspace(0.4, 1.0, 400)
    play = trace_plays(input_, (1.0,), 0.5, 25.0, (0.15, 10.0))[:, 0]
    samples = Samples((input_,), play + 0.05 * np.sin(7.0 * np.arange(400)), np.empty((400, 0)))
    law = LoopLaw(thresholds=(1.0,), weights=(1.0,), coefficients=(0.0, 1.0), centre=0.0, half=1.0,
                  straight=(-999.0, 999.0), reach=25.0, fan=0.15, apex=10.0)  # fmt: skip
    known = judge_constants(Fitted(law, (0.5,), np.empty(0)), samples, np.ones(400, dtype=np.bool_))
    assert [(item.name, item.is_determined) for item in known] == [
        ("half width", False), ("fan", True), ("apex", False)
    ]  # fmt: skip
    assert known[0].low == 0.0 and known[0].high > 100.0


def test_constants_of_bouc_wen_that_the_rows_do_not_show_are_named() -> None:
    """Where the input never comes near yielding neither exponent nor fraction is known."""
    input_ = np.sin(np.linspace(0.0, 40.0, 200))
    law = LoopLaw(thresholds=(0.0,), weights=(1.0,), coefficients=(0.0, 1.0), centre=0.0, half=1.0,
                  straight=(-9.0, 9.0), reach=1.0, height=5.0, yield_input=60.0, beta_fraction=0.5,
                  exponent=2.0)  # fmt: skip
    noise = 0.1 * np.random.default_rng(0).normal(size=200)
    samples = Samples((input_,), law.trace(input_, 0.5) + noise, np.empty((200, 0)))
    known = judge_constants(Fitted(law, (0.5,), np.empty(0)), samples, np.ones(200, dtype=np.bool_))
    assert len(known) == 4 and not any(item.is_determined for item in known)
    ends = {item.name: (item.low, item.high) for item in known}
    assert ends["exponent"] == (1.0, 20.0) and ends["beta fraction"] == (0.0, 10.0)
    assert ends["yield input"][0] == 0.0


def test_constants_of_bouc_wen_come_back_with_intervals_that_hold_them() -> None:
    truth = {
        "yield input": BOUC_WEN.bound / BOUC_WEN.alpha,
        "height": -BOUC_WEN.scale * BOUC_WEN.bound,
        "exponent": BOUC_WEN.exponent,
        "beta fraction": BOUC_WEN.beta / (BOUC_WEN.beta + BOUC_WEN.gamma),
    }
    held = {name: 0 for name in truth}
    law = LoopLaw(
        thresholds=(0.0,), weights=(1.0,), coefficients=(0.0,), centre=0.0, half=1.0,
        straight=(0.0, 0.0), reach=9.0, height=truth["height"], yield_input=truth["yield input"],
        beta_fraction=truth["beta fraction"], exponent=truth["exponent"],
    )  # fmt: skip
    count = 60
    for seed in range(count):
        record = make_record("bouc-wen", seed=seed, count=200, noise=0.01)
        samples = Samples((record.runs.input,), record.runs.output, np.empty((200, 0)))
        mask = np.arange(200) >= 20  # by then the start is forgotten
        begin = Fitted(law, (0.5,), np.empty(0))
        found = fit_bouc_wen(samples, mask, begin, begin)
        for item in judge_constants(found, samples, mask):
            held[item.name] += item.low < truth[item.name] < item.high
    for name, times in held.items():
        assert times >= 0.85 * count, name


def move_sheath(
    inputs: Floats, *, wrap: float, softness: float, count: int = 8
) -> tuple[Floats, Floats]:
    """Return what a tendon in a channel moves against a spring of stiffness 1, and its tension.

    Pieces of the tendon are springs, and between them it rubs: it stays where the tensions on both
    sides differ by less than friction.
    """
    stiffness, ratio = count / softness, float(np.exp(wrap / count))
    places = np.zeros(count + 1)
    moved, tensions = [], []
    for place in inputs.tolist():
        places[0], left = place, 1.0
        while left > 1e-7:
            left = 0.0
            for i in range(1, count + 1):
                before = stiffness * (places[i - 1] - places[i])
                after = stiffness * (places[i] - places[i + 1]) if i < count else places[i]
                if after / ratio <= before <= after * ratio:
                    continue
                share = ratio if before > after else 1.0 / ratio
                far = share * (places[i + 1] if i < count else 0.0)
                near = stiffness * places[i - 1] if i == count else places[i - 1]
                new = (near + far) / ((stiffness if i == count else 1.0) + share)
                left, places[i] = max(left, abs(new - places[i])), new
        moved.append(places[-1])
        tensions.append(stiffness * (places[0] - places[1]))
    return np.array(moved), np.array(tensions)


def test_friction_and_compliance_of_a_tendon_come_from_its_loops() -> None:
    wrap, softness = 0.6, 0.8
    inputs = np.interp(np.linspace(0.0, 6.0, 121), range(7), [0, 10, 3, 8, 2, 10, 1])
    moved, tensions = move_sheath(inputs, wrap=wrap, softness=softness)
    kept = slice(14, None)  # off rest
    noise = 0.003 * np.ptp(moved) * np.random.default_rng(0).normal(size=121)
    for given, unit, output in ((inputs, "mm", "mm"), (tensions, "N", "mm"), (inputs, "mm", "deg")):
        runs = LoopRuns(
            input=given[kept], output=(moved + noise)[kept], time=np.arange(107.0), labels=("1",),
            first=(0,), input_title=f"tendon [{unit}]", output_title=f"tip [{output}]",
        )  # fmt: skip
        found = compare_laws(runs, hold_out=0.2)
        assert found.best == "capstan"
        errors = {row.law: row.held_out for row in found.rows}
        assert errors["capstan"] < 0.5 * errors["backlash-cubic"]
        known = {item.name: item for item in found.constants}
        if output == "deg":
            assert 0.2 < known["friction times wrap angle, at least"].value < wrap
            continue
        assert known["friction times wrap angle"].value == pytest.approx(wrap, rel=0.12)
        if unit == "mm":
            assert known["compliance times stiffness"].value == pytest.approx(softness, rel=0.12)


@pytest.mark.parametrize(
    ("units", "count"),
    [(("mm", "mm"), 2), (("N", "mm"), 1), (("mm", "deg"), 1), (("kPa", "mm"), 0), (("", ""), 0),
     (("mm", "counts"), 0)],
)  # fmt: skip
def test_friction_is_told_of_what_a_tendon_has(units: tuple[str, str], count: int) -> None:
    law = LoopLaw(thresholds=(0.0,), weights=(1.0,), coefficients=(0.0, 0.5), centre=0.0, half=1.0,
                  straight=(-9.0, 9.0), reach=5.0, fan=0.2)  # fmt: skip
    fan = Constant(name="fan", value=0.2, low=0.19, high=0.21)
    told = identify_tendon(law, (fan,), input_unit=units[0], output_unit=units[1])
    assert len(told) == count


def test_the_band_holds_95_percent_of_rows_held_out() -> None:
    shares = []
    for seed in range(8):
        record = make_record("backlash", seed=seed, count=240)
        shares.append(compare_laws(record.runs, hold_out=0.4, law="cubic").coverage)
    assert 0.92 < np.mean(shares) < 0.985


def test_a_drift_is_advised_where_it_helps_on_all_blocks_held_out() -> None:
    drifting = make_record("plays", drift=0.5)
    found = compare_laws(drifting.runs, hold_out=0.3)
    advice = [note for note in found.notes if "choose it" in note]
    assert len(advice) == 1 and "linear drift" in advice[0]
    taken = compare_laws(drifting.runs, hold_out=0.3, drift="linear")
    assert taken.row.held_out < 0.5 * found.row.held_out
    assert taken.drifted == pytest.approx(0.5 * drifting.noise / 0.01, rel=0.1)
    for seed in range(2):
        bare = compare_laws(make_record("bouc-wen", seed=seed).runs, hold_out=0.3)
        assert not any("choose it" in note for note in bare.notes)


def test_a_drift_goes_on_where_the_time_restarts() -> None:
    record = make_record("plays", windows=3, drift=0.5)
    runs = record.runs
    time = np.concatenate([runs.time[place] - runs.time[place.start] for place in runs.slices])
    whole, restarted = (
        compare_laws(one, drift="linear", law="generalised")
        for one in (runs, replace(runs, time=time))
    )
    assert restarted.row.left_out == pytest.approx(whole.row.left_out, rel=1e-6)
    assert restarted.drifted == pytest.approx(whole.drifted, rel=1e-6)
    assert any("the time restarts" in note for note in restarted.notes)
    assert not any("the time restarts" in note for note in whole.notes)


def test_an_input_that_never_turns_tells_no_loops() -> None:
    rise = make_record("plays").runs
    way = np.linspace(-5.0, 5.0, len(rise))
    found = compare_laws(replace(rise, input=way, output=way**3))
    assert not found.converged and "never turns" in found.reason


def test_many_rows_are_fitted_as_means_and_judged_as_they_are() -> None:
    record = make_record("plays", count=6000)
    found = compare_laws(record.runs, hold_out=0.3, samples=500)
    assert 500 <= found.kept < 700 and len(found.predicted) == 6000
    assert found.row.held_out < 1.1 * record.noise
    assert 0.93 < found.coverage < 0.97


def test_rows_held_out_are_in_no_mean_that_is_fitted() -> None:
    runs = make_record("plays", count=3000).runs
    one = compare_laws(runs, hold_out=0.31, samples=50, law="cubic")
    far = np.where(one.parts.held_out, 1e3, 0.0) + runs.output
    two = compare_laws(replace(runs, output=far), hold_out=0.31, samples=50, law="cubic")
    assert two.fit.law == one.fit.law
    assert [row.left_out for row in two.rows] == [row.left_out for row in one.rows]


def test_rows_far_off_are_named() -> None:
    runs = make_record("plays").runs
    assert not any("outliers" in note for note in compare_laws(runs).notes)
    swapped = runs.output.copy()
    swapped[[99, 300, 301]] += 0.5 * np.ptp(swapped)
    notes = compare_laws(replace(runs, output=swapped)).notes
    said = [note for note in notes if "outliers" in note]
    assert len(said) == 1 and said[0].startswith("3 rows") and "at row 100 of" in said[0]


@pytest.mark.parametrize("kind", ["one row a run", "a spike", "two levels", "noise alone"])
def test_odd_records_have_an_answer(kind: str) -> None:
    runs, turn = make_record("plays", count=60).runs, np.linspace(0.0, 20.0, 60)
    input_, output, first = np.sin(turn), np.sin(turn - 0.3), (0,)
    if kind == "one row a run":
        first = tuple(range(60))
    elif kind == "a spike":
        input_[-1] = 1e6
    elif kind == "two levels":
        input_, output = np.sign(input_), np.sign(output)
    else:
        input_, output = np.random.default_rng(0).normal(size=(2, 60))
    labels = tuple(map(str, first))
    odd = replace(runs, input=input_, output=output, first=first, labels=labels)
    found = compare_laws(odd)
    assert np.isfinite(found.predicted).all() and np.isfinite(found.residual)
    assert found.converged == (not found.reason)


def test_what_cannot_be_fitted_is_refused() -> None:
    runs = make_record("plays", count=60).runs
    with pytest.raises(InputError, match="20"):
        compare_laws(runs, hold_out=0.8)
    with pytest.raises(InputError, match=r"hold out is 'z': it must be one of a"):
        compare_laws(runs, hold_out=("z",))
    with pytest.raises(InputError, match="input is 1 in all rows fitted"):
        compare_laws(replace(runs, input=np.ones(60)))
    with pytest.raises(InputError, match="output is 2 in all rows fitted"):
        compare_laws(replace(runs, output=np.full(60, 2.0)))
    with pytest.raises(InputError, match="law is 'x'"):
        compare_laws(runs, law="x")
    assert [row.law for row in compare_laws(runs).rows] == list(LAWS)

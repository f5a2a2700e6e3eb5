"""Fits of robots: simulated ones, whose constants are known."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from bozzini.continuum import (
    ContinuumRobot,
    Marker,
    RobotFitOptions,
    RobotMeasurements,
    RobotSetup,
    Section,
    Tendon,
    fit_robot,
    parse_unknowns,
    predict_points,
)
from bozzini.continuum.left_out import Validation
from bozzini.continuum.observation import place_markers
from bozzini.errors import InputError
from bozzini.muscle.hysteresis import PrandtlIshlinskii

LENGTHS = (40.0, 50.0)
BARE = RobotFitOptions(folds=0)


def make_robot(*, offset: float = 4.0, stiffness: float = 2e3, lengths=LENGTHS, **base):
    sections = []
    for k, length in enumerate(lengths):
        tendons = tuple(
            Tendon(
                name=f"T{3 * k + j + 1}",
                offset=offset,
                angle=0.5 * k + 2.0 * math.pi / 3.0 * j,
                stiffness=stiffness,
            )
            for j in range(3)
        )
        sections.append(
            Section(length=length, radius=6.0, discs=1, bending_stiffness=500.0, tendons=tendons)
        )
    return ContinuumRobot(tuple(sections), **base)


MARKERS = (Marker(name="tip"), Marker(name="m", arc_length=40.0, offset=(5.0, 0.0, 1.0)))


def simulate(
    truth: RobotSetup, *, rows: int = 24, noise: float = 0.0, seed: int = 0, ordered: bool = False
) -> RobotMeasurements:
    random = np.random.default_rng(seed)
    commands = random.uniform(-2.0, 3.0, (rows, len(truth.robot.tendons)))
    if ordered:
        commands = 1.5 + 1.5 * np.sin(np.linspace(0.0, 9.0, rows)[:, None] + np.arange(6.0))
    blank = np.zeros((rows, len(truth.markers), 3))
    data = RobotMeasurements(
        command="displacement",
        tendons=truth.robot.tendon_names,
        commands=commands,
        markers=truth.markers,
        points=blank,
    )
    points = predict_points(truth, data).predicted
    return dataclasses.replace(data, points=points + random.normal(0.0, noise, points.shape))


def find(fit, name):
    return next(one for one in fit.estimates if one.name == name)


@pytest.mark.slow
def test_true_constants_come_back():
    turned = (0.1, -0.2, 0.3)
    truth = RobotSetup(
        make_robot(offset=4.4, stiffness=1e3, base_position=(3.0, -2.0, 5.0), base_rotation=turned),
        MARKERS,
        (0.1,) * 3 + (-0.2,) * 3,
    )
    free = ["base", "tendons.*.offset", "tendons.*.stiffness", "sections.each.tendons.zero"]
    fit = fit_robot(make_robot(), simulate(truth), free=free, options=BARE)
    assert fit.converged
    assert fit.rms < 1e-3
    assert not fit.undetermined
    assert find(fit, "tendons.*.offset").value == pytest.approx(4.4, rel=1e-3)
    assert find(fit, "tendons.*.stiffness").value == pytest.approx(1e3, rel=1e-2)
    assert fit.robot.base_rotation == pytest.approx(turned, abs=1e-3)
    assert fit.setup.zeros == pytest.approx(truth.zeros, abs=1e-3)


def test_a_few_true_constants_come_back():
    truth = RobotSetup(make_robot(offset=4.4, stiffness=1e3), MARKERS, (0.1,) * 6)
    free = ["tendons.*.offset", "tendons.*.stiffness", "tendons.*.zero"]
    fit = fit_robot(make_robot(), simulate(truth), free=free, options=BARE)
    assert fit.rms < 1e-3
    assert find(fit, "tendons.*.stiffness").value == pytest.approx(1e3, rel=1e-2)
    assert fit.setup.zeros == pytest.approx(truth.zeros, abs=1e-3)


def test_the_base_is_found_from_any_start():
    far = make_robot(base_position=(100.0, 200.0, -50.0), base_rotation=(1.5, 1.5, -1.0))
    fit = fit_robot(make_robot(), simulate(RobotSetup(far, MARKERS)), free=["base"], options=BARE)
    assert fit.rms < 1e-3
    assert fit.robot.base_frame == pytest.approx(far.base_frame, abs=1e-3)


def test_what_is_degenerate_is_named():
    truth = RobotSetup(make_robot(lengths=LENGTHS[:1]), MARKERS[:1], (6.0,) * 3)
    free = ["base.position.z", "tendons.*.offset", "commands.scale"]
    fit = fit_robot(truth, simulate(truth, noise=0.1), free=free, options=BARE)
    assert fit.undetermined == (
        "tendons.*.offset and commands.scale: only 1 of these 2 is determined",
    )
    assert not math.isfinite(find(fit, "commands.scale").standard_error)
    assert math.isfinite(find(fit, "base.position.z").standard_error)


def test_the_output_names_the_blocks_that_the_intervals_are_of():
    truth = RobotSetup(make_robot(offset=4.4), MARKERS[:1])
    data = simulate(truth, noise=0.1)
    fit = fit_robot(make_robot(), data, free=["tendons.*.offset"], options=BARE)
    rule = "10 runs of 2 to 3 row(s), in the order of the table, count as independent"
    assert rule in fit.format_table() and rule in fit.to_dict()["interval_rule"]
    assert "for rows like these: others can ask for other constants" in fit.interval_rule
    labels = np.repeat(list("abcdef"), 4)
    labelled = dataclasses.replace(data, blocks=labels)
    other = fit_robot(make_robot(), labelled, free=["tendons.*.offset"], options=BARE)
    assert "6 labels, count as independent" in other.interval_rule
    assert find(other, "tendons.*.offset").value == find(fit, "tendons.*.offset").value
    bare = fit_robot(make_robot(), data, free=[], options=BARE)
    assert bare.interval_rule == "" and "intervals" not in bare.format_table()


def test_points_that_were_not_seen_make_no_difference():
    truth = RobotSetup(make_robot(offset=4.4), MARKERS)
    data = simulate(truth)
    hidden = data.points.copy()
    hidden[::3, 0] = np.nan
    fit = fit_robot(
        make_robot(), dataclasses.replace(data, points=hidden), free=["tendons.*.offset"],
        options=BARE,
    )  # fmt: skip
    assert find(fit, "tendons.*.offset").value == pytest.approx(4.4, rel=1e-4)
    assert np.isnan(fit.prediction.distances).sum() == np.isnan(hidden[..., 0]).sum()


def test_backlash_comes_back():
    truth = RobotSetup(make_robot(), MARKERS, backlash=0.2)
    fit = fit_robot(
        make_robot(), simulate(truth, rows=80, ordered=True), free=["commands.backlash"],
        options=BARE,
    )  # fmt: skip
    assert fit.setup.backlash == pytest.approx(0.2, abs=1e-2)


def hide_peaks(data: RobotMeasurements) -> RobotMeasurements:
    """Return a recording without points where a command turns, and most of what precedes it."""
    first = data.commands[:, 0]
    peaks = np.abs(first - np.median(first)) > 0.6 * np.abs(first - np.median(first)).max()
    hidden = data.points.copy()
    hidden[peaks] = np.nan
    return dataclasses.replace(data, points=hidden)


def test_backlash_heeds_the_commands_of_rows_without_a_point():
    truth = RobotSetup(make_robot(lengths=LENGTHS[:1]), MARKERS[:1], backlash=0.5)
    commands = 3.0 * np.sin(np.linspace(0.0, 19.0, 60)[:, None] + np.zeros(3))
    commands = commands * [1.0, -0.5, -0.5]
    blank = simulate(truth, rows=60)
    moved = dataclasses.replace(blank, commands=commands)
    data = dataclasses.replace(moved, points=predict_points(truth, moved).predicted)
    gaps = hide_peaks(data)
    assert 20 < len(gaps.seen_rows) < 45
    start = RobotSetup(make_robot(lengths=LENGTHS[:1]), MARKERS[:1])
    options = RobotFitOptions(folds=3, split="blocks", smaller=False)
    fit = fit_robot(start, gaps, free=["commands.backlash"], options=options)
    assert fit.setup.backlash == pytest.approx(0.5, abs=1e-2)
    assert fit.rms < 1e-2
    # The blocks left out see the history as well, of rows left out and of those without a point.
    assert fit.validation is not None and fit.validation.rms < 1e-2
    assert fit.robot.calibration.rows == len(gaps.seen_rows)
    # What is predicted of a row goes with the row of the table.
    rows = gaps.seen_rows
    assert fit.prediction.predicted[rows] == pytest.approx(data.points[rows], abs=1e-2)
    assert np.isnan(fit.prediction.predicted).all(axis=(1, 2)).sum() == 60 - len(rows)
    # Without their history the rows contradict each other.
    lost = fit_robot(start, gaps.select(rows), free=["commands.backlash"], options=BARE)
    assert lost.rms > 10.0 * fit.rms


def test_a_first_row_of_zeros_without_a_point_begins_a_recording_at_rest():
    truth = RobotSetup(make_robot(lengths=LENGTHS[:1]), MARKERS[:1], backlash=0.5)
    start = dataclasses.replace(truth, backlash=0.0)
    blank = simulate(truth, rows=40)
    turn = np.linspace(1.5, 14.0, 40)
    commands = 3.0 * np.stack([np.sin(turn + k * 2.0 * math.pi / 3.0) for k in range(3)], axis=-1)
    commands[0] = 0.0
    moved = dataclasses.replace(blank, commands=commands)
    points = predict_points(truth, moved).predicted
    points[0] = np.nan
    data = dataclasses.replace(moved, points=points)
    fits = [
        fit_robot(start, rows, free=["commands.backlash"], options=BARE)
        for rows in (data, data.select(np.arange(1, 40)))
    ]
    assert fits[0].setup.backlash == pytest.approx(0.5, abs=1e-3)
    assert fits[0].rms < 1e-3
    assert fits[1].rms > 0.1
    warned = [any("began at rest" in text for text in fit.warnings) for fit in fits]
    assert warned == [False, True]


def record_loops(friction: float, *, cycles: int, each: int = 8) -> RobotMeasurements:
    """Return growing loops of one tendon's tension, seen at the tip without noise."""
    tendon = Tendon(name="a", offset=4.0, angle=0.3, friction=friction, stiffness=2e3)
    section = Section(length=60.0, radius=6.0, discs=1, bending_stiffness=500.0, tendons=(tendon,))
    turns = np.arange(cycles * each) / each
    pulls = 0.25 * (1.0 + turns / cycles) * (1.0 - np.cos(2.0 * np.pi * turns))
    data = RobotMeasurements(
        command="tension",
        tendons=("a",),
        commands=pulls[:, None],
        markers=MARKERS[:1],
        points=np.zeros((len(pulls), 1, 3)),
    )
    setup = RobotSetup(ContinuumRobot((section,)))
    points = predict_points(setup, data, model="rod", model_options=FEW_STEPS).predicted
    return dataclasses.replace(data, points=points)


FEW_STEPS = {"steps": 10}
FRICTION = 0.25


@pytest.fixture(scope="module")
def loops() -> RobotMeasurements:
    return record_loops(FRICTION, cycles=4)


def fit_loops(data: RobotMeasurements, *free: str, **options):
    tendon = Tendon(name="a", offset=4.0, angle=0.3, stiffness=2e3)
    section = Section(length=60.0, radius=6.0, discs=1, bending_stiffness=500.0, tendons=(tendon,))
    chosen = RobotFitOptions(folds=0, model="rod", model_options=FEW_STEPS, **options)
    return fit_robot(ContinuumRobot((section,)), data, free=free, options=chosen)


@pytest.mark.slow
def test_friction_of_a_recorded_loop_comes_back(loops):
    fit = fit_loops(loops.select(np.arange(12)), "tendons.*.friction", loss="linear")
    assert fit.converged
    assert find(fit, "tendons.a.friction").value == pytest.approx(FRICTION, rel=0.03)
    without = fit_loops(loops).rms
    assert fit.predict(loops).rms < 0.2 * without
    # The same with rows that were not seen: their tensions are part of the history.
    points = loops.points.copy()
    points[:22] = np.nan
    late = dataclasses.replace(loops, points=points)
    assert fit.predict(late).distances[22] == pytest.approx(fit.predict(loops).distances[22])
    # A row depends on those before it: alone it is another shape.
    assert fit.predict(loops.select([22])).rms > 0.5 * without


@pytest.mark.slow
def test_friction_comes_back_from_noise_and_predicts_a_loop_that_was_not_fitted(loops):
    noise, free = 0.05, ("tendons.*.friction", "sections.*.bending_stiffness")
    fitted, later = np.arange(24), np.arange(24, 32)
    draws = [
        dataclasses.replace(
            loops,
            points=loops.points
            + np.random.default_rng(seed).normal(0.0, noise, loops.points.shape),
        )
        for seed in (1, 2, 3)
    ]
    fits = [fit_loops(noisy.select(fitted), *free, loss="linear") for noisy in draws]
    for fit in fits:
        one = find(fit, "tendons.a.friction")
        # No share of hits is claimed of its interval, and the fit warns of that.
        assert one.value == pytest.approx(FRICTION, rel=0.15)
        assert one.low < one.value < one.high < one.low + 0.5 * FRICTION
        assert any("lower bounds where friction is free" in text for text in fit.warnings)
    lagging = fit_loops(draws[0].select(fitted), "commands.scale", free[1], loss="linear")
    errors = [
        float(np.sqrt(np.mean(fit.predict(draws[0]).distances[later] ** 2)))
        for fit in (fits[0], lagging)
    ]
    assert errors[0] == pytest.approx(noise * math.sqrt(3.0), rel=0.5)
    assert errors[1] > 2.0 * errors[0]


def test_an_operator_of_hysteresis_lags_the_commands_of_a_fit():
    lag = PrandtlIshlinskii(thresholds=(0.0, 0.3, 0.8), weights=(0.5, 0.3, 0.2))
    robot = make_robot(offset=4.4)
    commands = 1.5 + 1.5 * np.sin(np.linspace(0.0, 18.0, 60)[:, None] + np.arange(6.0))
    seen = simulate(RobotSetup(robot, MARKERS), rows=60, ordered=True)
    acting = dataclasses.replace(seen, commands=lag.apply(commands.T).T)
    points = predict_points(RobotSetup(robot, MARKERS), acting).predicted
    measured = dataclasses.replace(seen, commands=commands, points=points)
    lagged = dataclasses.replace(measured, commands=lag.apply(measured.commands.T).T)
    first, later = np.arange(40), np.arange(40, 60)
    errors = [
        fit_robot(make_robot(), data.select(first), free=[*free], options=BARE).predict(data)
        .distances[later].mean()
        for data, free in (
            (lagged, ["tendons.*.offset"]),
            (measured, ["tendons.*.offset", "commands.backlash"]),
            (measured, ["tendons.*.offset"]),
        )
    ]  # fmt: skip
    # The operator that is there is exact, one play is better than none.
    assert errors[0] < 1e-3 < errors[1] < errors[2]


def test_an_amount_without_a_unit_is_no_factor_and_intervals_end_at_bounds():
    tendon = Tendon(name="a", offset=4.0, angle=0.3, stiffness=2e3)
    section = Section(length=60.0, radius=6.0, discs=1, bending_stiffness=500.0, tendons=(tendon,))
    setup = RobotSetup(ContinuumRobot((section,)))
    blank = RobotMeasurements(
        command="tension",
        tendons=("a",),
        commands=np.array([0.0, 0.4, 0.6, 0.3, 0.1])[:, None],
        markers=MARKERS[:1],
        points=np.zeros((5, 1, 3)),
    )
    points = predict_points(setup, blank, model="rod", model_options=FEW_STEPS).predicted
    noise = np.random.default_rng(0).normal(0.0, 0.5, points.shape)
    data = dataclasses.replace(blank, points=points + noise)
    fit = fit_loops(data, "tendons.*.friction", loss="linear")
    (friction,) = fit.estimates
    assert friction.change == "shift"
    assert 0.0 <= friction.low <= friction.value <= friction.high <= 2.0
    # Without the cut it is as wide on both sides.
    assert friction.high - friction.value > friction.value - friction.low
    assert "times" not in fit.format_table()
    scaled = fit_loops(data, "commands.scale", loss="linear")
    assert scaled.estimates[0].change == "factor"
    assert "times" in scaled.format_table()


def test_the_error_is_a_share_of_the_span():
    truth = RobotSetup(make_robot(offset=4.4), MARKERS[:1])
    data = simulate(truth, noise=0.2)
    fits = [fit_robot(truth, data, free=free) for free in ((), ("commands.scale",))]
    for fit, rows in zip(fits, ("the rows", "rows left out"), strict=True):
        share = f"{fit.error:.3g} mm rms of {rows} is {100.0 * fit.error / data.span:.2g} % of"
        assert share in fit.format_table() and not fit.is_poor
    far = dataclasses.replace(data, points=data.points + 50.0)
    poor = fit_robot(truth, far, free=())
    assert poor.is_poor and any(text.startswith("the fit is poor: 86") for text in poor.warnings)
    assert poor.format_table().count("of the points' span") == 1


def test_friction_takes_the_rod():
    data = simulate(RobotSetup(make_robot(), MARKERS))
    options = dataclasses.replace(BARE, model="energy")
    with pytest.raises(InputError, match="leaves out the friction of tendons"):
        fit_robot(make_robot(), data, free=["tendons.*.friction"], options=options)


def test_rows_left_out_are_predicted_as_well_as_the_noise():
    truth = RobotSetup(make_robot(offset=4.4), MARKERS[:1])
    data = simulate(truth, noise=0.2)
    fit = fit_robot(make_robot(), data, free=["tendons.*.offset"])
    assert fit.validation is not None
    expected = 0.2 * math.sqrt(3.0)
    assert fit.validation.rms == pytest.approx(expected, rel=0.3)
    assert fit.predict(data).rms == pytest.approx(fit.rms)


@pytest.mark.parametrize("loss", ["soft_l1", "huber", "linear"])
def test_rows_that_a_robust_loss_counts_less_are_named(loss):
    truth = RobotSetup(make_robot(lengths=LENGTHS[:1], offset=4.4), MARKERS[:1])
    data = simulate(truth, noise=0.01)
    points = data.points.copy()
    wrong = [3, 8]
    points[wrong, 0, 1] += 20.0
    spoilt = dataclasses.replace(data, points=points)
    options = RobotFitOptions(folds=0, loss=loss)
    fit = fit_robot(
        make_robot(lengths=LENGTHS[:1]), spoilt, free=["tendons.*.offset"], options=options
    )
    said = "of 24 rows less than half weight" in fit.format_table()
    assert said == (loss != "linear")
    if loss == "linear":
        assert not fit.outliers
        return
    assert set(wrong) <= set(fit.outliers) and len(fit.outliers) < 8
    assert find(fit, "tendons.*.offset").value == pytest.approx(4.4, rel=1e-2)
    # The rms is of all points, those two as well; the median is that of the others.
    assert fit.rms == pytest.approx(20.0 * math.sqrt(2.0 / 24.0), rel=0.05)
    assert fit.prediction.median < 0.1
    # Rows without a point shift no number.
    hidden = points.copy()
    hidden[0] = np.nan
    gap = fit_robot(
        make_robot(lengths=LENGTHS[:1]), dataclasses.replace(data, points=hidden),
        free=["tendons.*.offset"], options=options,
    )  # fmt: skip
    assert set(wrong) <= set(gap.outliers)


def test_a_random_split_of_a_recording_is_refused():
    data = simulate(RobotSetup(make_robot(), MARKERS), rows=80, ordered=True)
    with pytest.raises(InputError, match="a random split tests no prediction"):
        fit_robot(make_robot(), data, free=["base"], options=RobotFitOptions(split="random"))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("sections.3.length", "names '3': there are 1, 2"),
        ("tendons.T1.colour", "use offset, angle, stiffness"),
        ("tendon.T1.zero", "cannot be fitted: use"),
        ("base.position.w", "cannot be fitted"),
        ("sections.1.modulus,sections.1.modulus", "free more than once"),
    ],
)
def test_wrong_names_are_refused(name, words):
    with pytest.raises(InputError, match=words):
        parse_unknowns(name.split(","), RobotSetup(make_robot()))


def test_names_stand_for_one_number_or_for_one_each():
    setup = RobotSetup(make_robot())
    assert len(parse_unknowns(["base"], setup)) == 6
    assert len(parse_unknowns(["tendons.*.zero"], setup)) == 1
    assert len(parse_unknowns(["tendons.each.zero"], setup)) == 6
    assert len(parse_unknowns(["sections.each.tendons.zero"], setup)) == 2


def test_a_longer_section_moves_what_stands_on_it():
    robot = make_robot()
    truth = RobotSetup(
        dataclasses.replace(
            robot,
            sections=tuple(
                dataclasses.replace(
                    one,
                    length=1.1 * one.length,
                    disc_positions=(),
                    tendons=tuple(dataclasses.replace(t, end=None) for t in one.tendons),
                )
                for one in robot.sections
            ),
        ),
        (Marker(name="tip"), Marker(name="m", arc_length=44.0)),
    )
    data = simulate(truth)
    data = dataclasses.replace(data, markers=(MARKERS[0], Marker(name="m", arc_length=40.0)))
    fit = fit_robot(robot, data, free=["sections.*.length"], options=BARE)
    assert fit.rms < 1e-3
    assert fit.robot.length == pytest.approx(1.1 * robot.length, rel=1e-5)


def test_a_fitted_robot_comes_back_from_its_file(tmp_path):
    truth = RobotSetup(make_robot(), MARKERS, (0.1,) * 6, backlash=0.05)
    data = simulate(truth, rows=8)
    start = dataclasses.replace(truth, zeros=())
    fit = fit_robot(start, data, free=["tendons.*.zero"], options=BARE)
    again = ContinuumRobot.from_yaml(fit.robot.to_yaml(tmp_path / "fitted.yaml"))
    assert again == fit.robot
    assert RobotSetup.of(again).zeros == fit.setup.zeros
    # What the file predicts of the rows is what the fit predicts, by each route.
    predicted = fit_robot(again, data, free=[], options=BARE).prediction.predicted
    assert predicted == pytest.approx(fit.prediction.predicted, abs=1e-9)
    moved = again.to_displacements(data.commands, in_time=True)
    model = again.model()
    assert place_markers(RobotSetup.of(again), model.shape(moved)) == pytest.approx(predicted)
    assert again.to_commands(again.to_displacements(data.commands)) == pytest.approx(data.commands)
    first = again.forward(data.commands[0])
    assert place_markers(RobotSetup.of(again), first) == pytest.approx(predicted[0])


@pytest.mark.slow
def test_fewer_constants_keep_a_base_that_is_free_in_all():
    truth = RobotSetup(make_robot(), MARKERS)
    data = simulate(truth, rows=12, noise=1.0, seed=3)
    free = ["base", "tendons.each.zero"]
    fit = fit_robot(make_robot(), data, free=free, options=RobotFitOptions(folds=3))
    assert fit.smaller is not None
    assert {name for name in fit.smaller.names if name.startswith("base")} == {
        one.name for one in parse_unknowns(["base"], truth)
    }
    # Who follows the advice gets what it promises.
    again = fit_robot(
        make_robot(), data, free=fit.smaller.names, options=RobotFitOptions(folds=3, smaller=False)
    )
    assert again.validation is not None
    assert again.validation.rms == pytest.approx(fit.smaller.rms, rel=1e-2)
    # Six constants of 36 points: what is left out is missed by more than what is fitted.
    assert again.validation.rms > 1.05 * again.rms


@pytest.mark.slow
def test_intervals_cover_the_truth():
    truth = RobotSetup(make_robot(offset=4.4), MARKERS, (0.1,) * 6)
    free, hits, tries = ["tendons.*.offset", "tendons.*.zero", "base.position.z"], 0, 30
    values = (4.4, 0.1, 0.0)
    for seed in range(tries):
        data = simulate(truth, rows=30, noise=0.3, seed=seed)
        fit = fit_robot(make_robot(), data, free=free, options=BARE)
        pairs = zip(fit.estimates, values, strict=True)
        hits += sum(one.low <= value <= one.high for one, value in pairs)
    assert 0.88 <= hits / (3 * tries) <= 0.99


def make_validation(*blocks: float) -> Validation:
    return Validation(("a",), math.sqrt(sum(value**2 for value in blocks) / len(blocks)), blocks)


def test_a_validation_is_better_beyond_the_scatter_of_its_blocks():
    blocks = np.array([2.0, 1.0, 3.0, 2.0])
    every = make_validation(*blocks)
    assert not every.beats(every)
    # A gain of every block counts however small it is, one within the scatter of them does not.
    assert make_validation(*(blocks - 1e-3)).beats(every)
    for gain, wins in ((0.5, True), (0.15, False)):
        gains = gain + np.array([0.5, -0.5, 0.3, -0.3])
        fewer = make_validation(*(blocks - gains))
        assert fewer.rms < every.rms
        t = gains.mean() / (gains.std(ddof=1) / math.sqrt(4))
        assert fewer.beats(every) == wins == (t > 1.0)
        assert not every.beats(fewer)


@pytest.mark.slow
def test_fewer_constants_that_predict_better_are_said():
    truth = RobotSetup(make_robot(offset=4.4), MARKERS[:1])
    data = simulate(truth, rows=12, noise=1.0, seed=3)
    free = ["tendons.*.offset", "tendons.each.zero", "sections.each.bending_stiffness"]
    fit = fit_robot(make_robot(), data, free=free)
    assert fit.smaller is not None
    assert fit.validation is not None
    assert fit.smaller.rms <= fit.validation.rms
    assert fit.smaller.beats(fit.validation)
    assert set(fit.smaller.names) < {one.name for one in fit.estimates}
    assert "fewer constants predict better" in fit.format_table()

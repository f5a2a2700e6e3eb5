"""What rows left out of a robot's fit tell: bands, residuals, baselines, and fits in stages."""

from __future__ import annotations

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from bozzini.cli.main import main
from bozzini.continuum import (
    ContinuumRobot,
    RobotFitOptions,
    RobotSetup,
    fit_in_stages,
    fit_robot,
    predict_points,
    staged_fit,
)
from bozzini.continuum.command_baselines import predict_by_commands
from bozzini.continuum.prediction_band import PredictionBand, make_band, name_kinds
from bozzini.continuum.section_residual import SectionStates, learn_residual
from bozzini.errors import InputError
from bozzini.numeric.estimation import find_conformal_limit
from bozzini.study.tip import DrawOptions, robot_tip_error

from .test_fit import LENGTHS, MARKERS, make_robot, simulate

SECTIONS = ("1", "2")


def draw_misses(random, rows):
    """Distances of rows in which no, one or both sections move, each kind with its own error."""
    bends = random.uniform(0.5, 1.0, (rows, 2)) * random.integers(0, 2, (rows, 2))
    size = 1.0 + bends.astype(bool).sum(axis=1)
    return np.abs(random.normal(0.0, size)).reshape(-1, 1), bends


def test_a_band_holds_its_share_of_new_rows_of_each_kind():
    random = np.random.default_rng(0)
    distances, bends = draw_misses(random, 4000)
    band = make_band(
        distances, bends, np.arange(4000) * 8 // 4000, markers=("tip",), sections=SECTIONS
    )
    there, others = draw_misses(random, 8000)
    kinds = band.name_kinds(others)
    within = (there <= band.find_radii(kinds))[:, 0]
    assert set(kinds) == {"rest", "1", "2", "1+2"} == set(band.radii)
    for kind in set(kinds):
        assert within[kinds == kind].mean() == pytest.approx(0.95, abs=0.02)
    assert band.coverage == pytest.approx(0.95, abs=0.01)
    # Each kind has the radius of its own error: the normal's 1.96 deviations.
    assert band.radii["1+2"][0] == pytest.approx(1.96 * 3.0, rel=0.08)
    assert band.radii["rest"][0] == pytest.approx(1.96, rel=0.08)


def test_a_kind_that_was_not_seen_has_the_widest_radius_and_few_rows_that_of_all():
    random = np.random.default_rng(1)
    distances, bends = draw_misses(random, 600)
    both = (bends > 0.0).all(axis=1)
    band = make_band(
        distances[~both], bends[~both], np.arange(600)[~both] % 4,
        markers=("tip",), sections=SECTIONS,
    )  # fmt: skip
    assert "1+2" not in band.radii
    assert band.find_unseen(band.name_kinds(bends)).sum() == both.sum()
    assert band.find_radii(np.array(["1+2"]))[0, 0] == max(r[0] for r in band.radii.values())
    few = make_band(
        distances[:12], bends[:12], np.arange(12) % 3, markers=("tip",), sections=SECTIONS
    )
    assert {radius[0] for radius in few.radii.values()} == {distances[:12].max()}
    assert few.level == 12 / 13 and few.describe().startswith("92% of predictions are within")


def test_a_kind_of_few_rows_is_not_diluted_by_kinds_that_move_less():
    random = np.random.default_rng(2)
    distances, bends = draw_misses(random, 2000)
    both = np.flatnonzero((bends > 0.0).all(axis=1))
    kept = np.sort(np.concatenate([np.flatnonzero((bends == 0.0).any(axis=1)), both[:20]]))
    band = make_band(
        distances[kept], bends[kept], np.arange(len(kept)) % 4, markers=("tip",), sections=SECTIONS
    )
    there, others = draw_misses(random, 4000)
    both = (others > 0.0).all(axis=1)
    known = band.find_radii(band.name_kinds(others))[:, 0]
    one = (bends[kept] > 0.0).any(axis=1)
    # At least that of the rows in which any section moves; the many at rest do not count.
    assert band.radii["1+2"][0] == find_conformal_limit(distances[kept][one, 0], 0.95)
    assert band.radii["1+2"][0] > find_conformal_limit(distances[kept][:, 0], 0.95)
    assert (there[both, 0] <= known[both]).mean() > 0.8


def test_a_section_counts_as_moved_from_a_fifth_of_its_largest_bend_on():
    bends = np.array([[0.19, 0.0], [0.21, 0.0], [0.21, 0.11], [np.nan, 0.5], [1.3, 0.0]])
    kinds = name_kinds(bends, np.array([1.0, 0.5]), SECTIONS).tolist()
    assert kinds == ["rest", "1", "1+2", "2", "1 further"]


def test_points_move_with_a_section_as_the_rates_say():
    # A little more bend of all a robot's sections, by other commands of a robot that hardly bends.
    setup = RobotSetup(make_robot(), MARKERS)
    data = simulate(setup, rows=2)
    near = dataclasses.replace(data, commands=0.02 * data.commands + 0.5)
    further = dataclasses.replace(near, commands=1.02 * (near.commands - 0.5) + 0.5)
    one, two = (predict_points(setup, each) for each in (near, further))
    change = two.states.values - one.states.values
    moved = np.einsum("nmisa,nsa->nmi", one.states.rates[..., :2], change[..., :2])
    assert np.abs(moved).max() > 1e-3
    assert np.linalg.norm(two.predicted - one.predicted - moved) < 0.02 * np.linalg.norm(moved)
    # A marker is moved by what lies before it only.
    assert not one.states.rates[:, 1, :, 1].any() and one.states.rates[:, 0, :, 1].any()


def disturb(data, truth):
    """Measure a robot whose second section bends less the more it bends, and is stretched."""
    states = predict_points(truth, data).states
    bends = states.values[..., :2]
    motion = np.zeros((len(data), 2, 4))
    motion[:, 1, :2] = -0.6 * bends[:, 1] * np.linalg.norm(bends[:, 1], axis=-1, keepdims=True)
    motion[:, 1, 3] = 2.0 * np.linalg.norm(bends[:, 1], axis=-1)
    moved = np.einsum("nmisa,nsa->nmi", states.rates, motion)
    return dataclasses.replace(data, points=data.points + moved)


def test_a_residual_finds_what_the_model_leaves_out_and_no_more():
    truth = RobotSetup(make_robot(offset=4.4), MARKERS)
    noise = 0.1
    wide = simulate(truth, rows=300)
    near = dataclasses.replace(wide, commands=0.5 + 0.5 * (wide.commands - 0.5))
    scatter = np.random.default_rng(1).normal(0.0, noise, near.points.shape)
    plain = dataclasses.replace(near, points=predict_points(truth, near).predicted + scatter)
    options = RobotFitOptions(residual=True, smaller=False)
    bent = disturb(plain, truth)
    first, later = np.arange(220), np.arange(220, 300)
    fit = fit_robot(make_robot(), bent.select(first), free=["tendons.*.offset"], options=options)
    check = fit.check(bent.select(later))
    assert check.prediction.rms > 6.0 * noise
    assert check.corrected.rms < 0.3 * check.prediction.rms
    # The error that rows left out of the fit state is that of new rows.
    assert fit.corrected.rms == pytest.approx(check.corrected.rms, rel=0.4)
    assert check.coverage == pytest.approx(0.95, abs=0.06)
    # Where the model is right there is nothing to learn but noise.
    good = fit_robot(make_robot(), plain.select(first), free=["tendons.*.offset"], options=options)
    assert good.corrected.rms < 1.05 * good.validation.rms
    assert good.check(plain.select(later)).corrected.rms == pytest.approx(
        noise * np.sqrt(3.0), rel=0.2
    )


def test_two_blocks_and_rows_without_a_shape_are_enough_to_learn_from():
    truth = RobotSetup(make_robot(offset=4.4), MARKERS)
    wide = simulate(truth, rows=240)
    near = dataclasses.replace(wide, commands=0.5 + 0.5 * (wide.commands - 0.5))
    near = dataclasses.replace(near, points=predict_points(truth, near).predicted)
    data = disturb(near, truth)
    free = ["tendons.*.offset"]
    fits = [
        fit_robot(
            make_robot(),
            data,
            free=free,
            options=RobotFitOptions(folds=folds, residual=True, smaller=False),
        )
        for folds in (2, 4)
    ]
    for fit in fits:
        assert fit.corrected.rms < 0.5 * fit.validation.rms
    # A row without a shape counts neither for a residual nor against it.
    random = np.random.default_rng(0)
    states = fits[0].prediction.states
    noise = random.normal(0.0, 0.1, (240, 2, 3))
    values, missed = states.values.copy(), noise.copy()
    values[3], missed[3] = np.nan, 50.0
    blocks = np.arange(240) % 4
    others = np.delete(np.arange(240), 3)
    without = learn_residual(states.select(others), noise[others], blocks[others])
    gap = learn_residual(SectionStates(values, states.rates), missed, blocks)
    assert (gap.degree, gap.ridge) == (without.degree, without.ridge)
    assert np.allclose(gap.coefficients, without.coefficients)
    none = learn_residual(SectionStates(values * np.nan, states.rates), missed, blocks)
    assert none.degree == 0 and not none.shift(states).any()


def test_a_robot_as_it_is_has_a_band_and_a_residual_too():
    truth = RobotSetup(make_robot(), MARKERS[:1])
    data = simulate(truth, rows=80, noise=0.1)
    fit = fit_robot(truth, data, free=(), options=RobotFitOptions(residual=True))
    assert fit.validation is None and fit.corrected.rms < 1.05 * fit.rms
    assert fit.band.coverage == pytest.approx(0.95, abs=0.06)
    assert fit_robot(truth, data.select([0, 1]), free=()).band is None


def test_states_beyond_those_learned_from_are_cut():
    truth = RobotSetup(make_robot(), MARKERS)
    data = disturb(simulate(truth, rows=80), truth)
    prediction = predict_points(truth, data)
    states = prediction.states
    residual = learn_residual(states, data.points - prediction.predicted, np.arange(80) % 4)
    far = SectionStates(states.values * 50.0, states.rates)
    edge = SectionStates(np.clip(far.values, residual.low, residual.high), states.rates)
    assert np.array_equal(residual.shift(far), residual.shift(edge))
    assert residual.shift(far).any()


def test_a_better_baseline_is_named():
    truth = RobotSetup(make_robot(lengths=LENGTHS[:1]), MARKERS[:1])
    data = simulate(truth, rows=120, noise=0.01)
    wrong = make_robot(lengths=LENGTHS[:1], offset=2.0)
    fit = fit_robot(wrong, data, free=["base.position.x"])
    assert any("predicts rows left out better" in text for text in fit.warnings)
    assert fit.is_poor and fit.better.rms < fit.error / 1.2
    right = fit_robot(wrong, data, free=["tendons.*.offset"])
    assert not any("predicts rows left out better" in text for text in right.warnings)
    assert right.better is None and not right.is_poor
    # Of a robot as it is nothing was fitted that could be worse than a baseline that is.
    assert fit_robot(wrong, data, free=()).better is None
    errors = {one.names[0]: one.rms for one in right.baselines}
    assert right.validation.rms < min(errors.values())
    assert errors["cubic of the commands"] < errors["quadratic of the commands"]


def test_what_commands_alone_predict_better_makes_a_fit_poor_and_a_residual_mends_it():
    truth = RobotSetup(make_robot(offset=4.4), MARKERS[:1])
    wide = simulate(truth, rows=240)
    near = dataclasses.replace(wide, commands=0.5 + 0.3 * (wide.commands - 0.5))
    data = disturb(dataclasses.replace(near, points=predict_points(truth, near).predicted), truth)
    plain, mended = (
        fit_robot(
            make_robot(),
            data,
            free=["tendons.*.offset"],
            options=RobotFitOptions(residual=residual, smaller=False),
        )
        for residual in (False, True)
    )
    assert not plain.is_far and plain.is_poor
    assert any(text.startswith("the fit is poor: quadratic of") for text in plain.warnings)
    assert plain.better.rms < plain.error / 1.2
    assert mended.error == plain.error and mended.better is None and not mended.is_poor


def test_a_marker_that_is_seen_in_one_block_alone_counts_in_none_that_is_predicted():
    truth = RobotSetup(make_robot(offset=4.4), MARKERS)
    data = simulate(truth, rows=60, noise=0.05)
    points = data.points.copy()
    points[:45, 1] = points[45:, 0] = np.nan  # then the last block has no baseline
    fit = fit_robot(
        make_robot(), dataclasses.replace(data, points=points), free=["tendons.*.offset"]
    )
    assert all(np.isnan(one.blocks[-1]) and np.isfinite(one.rms) for one in fit.baselines)
    assert not fit.is_poor and not any("predicts rows left out" in text for text in fit.warnings)
    points = data.points.copy()
    points[:, 1] = np.nan
    points[50, 1] = data.points[50, 1]
    fit = fit_robot(
        make_robot(), dataclasses.replace(data, points=points), free=["tendons.*.offset"]
    )
    assert fit.band.coverage > 0.85


def test_baselines_represent_what_they_can():
    random = np.random.default_rng(0)
    commands, asked = random.uniform(-1.0, 1.0, (200, 2)), random.uniform(-0.9, 0.9, (50, 2))

    def place(u, order):
        return np.stack([u[:, 0] ** order, u[:, 1], u[:, 0] * u[:, 1]], axis=-1)[:, None]

    for order in (2, 3):
        found = predict_by_commands(commands, place(commands, order), asked)
        errors = {name: np.abs(there - place(asked, order)).max() for name, there in found.items()}
        assert errors["cubic of the commands"] < 1e-3
        assert (errors["quadratic of the commands"] < 1e-3) == (order == 2)
    # Rows that are there five times are found again.
    often = np.repeat(commands, 5, axis=0)
    again = predict_by_commands(often, place(often, 3), commands)["mean of the nearest 5 rows"]
    assert np.allclose(again, place(commands, 3))


def test_kinds_of_motion_are_left_out():
    truth = RobotSetup(make_robot(offset=4.4), MARKERS[:1])
    data = simulate(truth, rows=90, noise=0.05)
    commands = data.commands.copy()
    commands[:30, 3:] = 0.5
    commands[30:60, :3] = 0.5
    data = dataclasses.replace(data, commands=commands)
    seen = dataclasses.replace(data, points=predict_points(truth, data).predicted)
    options = RobotFitOptions(split="kinds", smaller=False)
    fit = fit_robot(make_robot(), seen, free=["tendons.*.offset"], options=options)
    many = [kind for kind, rows in fit.band.rows.items() if rows >= 10]
    assert len(fit.validation.blocks) == len(many) >= 2 and "1+2" in many
    alone = seen.select(np.arange(30))
    single = fit_robot(make_robot(), alone, free=["tendons.*.offset"])
    check = single.check(seen.select(np.arange(60, 90)))
    assert sum(count for _, count in check.unseen) >= 5
    assert "sections move together, or as far, as in no row of the fit" in "\n".join(
        check.format_lines("x")
    )
    # By how far sections bend: the furthest rows come last, and are those missed most.
    wrong = fit_robot(
        make_robot(),
        disturb(seen, truth),
        free=["tendons.*.offset"],
        options=RobotFitOptions(split="amplitude", smaller=False, folds=3),
    )
    near, _, far = wrong.validation.blocks
    assert far > 2.0 * near and wrong.validation.labels[-1] == "to 100%"
    assert f"to 100% {far:.3g})" in wrong.format_table()
    assert fit.validation.labels == tuple(sorted(many))
    still = dataclasses.replace(alone, commands=0.001 * alone.commands + 0.5)
    with pytest.raises(InputError, match="1 kind of motion|0 kind"):
        fit_robot(make_robot(), still, free=["tendons.*.offset"], options=options)


@pytest.mark.slow
def test_stages_free_what_is_there_to_be_found():
    turned = (0.05, -0.04, 0.0)
    short = {"lengths": LENGTHS[:1]}
    lean = make_robot(offset=4.5, base_position=(1.0, 0.0, 2.0), base_rotation=turned, **short)
    data = simulate(RobotSetup(lean, MARKERS[:1]), rows=30, noise=0.05)
    found = fit_in_stages(make_robot(**short), data)
    kept = {stage.what for stage in found.stages if stage.kept}
    assert {"place and tilt of the base", "distance of the tendons"} <= kept
    assert "backlash" not in kept
    errors = [stage.error for stage in found.stages if stage.kept]
    assert errors == sorted(errors, reverse=True)
    assert found.fit.error == pytest.approx(0.05 * np.sqrt(3.0), rel=0.3)
    # Nothing is freed of a robot that is as its file says.
    good = make_robot(**short)
    as_it_is = fit_in_stages(good, simulate(RobotSetup(good, MARKERS[:1]), rows=30, noise=0.05))
    assert not any(stage.kept for stage in as_it_is.stages)
    assert [stage.what for stage in as_it_is.stages] == [stage.what for stage in found.stages]


def test_a_stage_that_cannot_be_freed_is_told_and_passed_by():
    robot = make_robot(lengths=LENGTHS[:1], stiffness=np.inf)
    balanced = np.random.default_rng(0).uniform(-1.0, 1.0, (24, 2)) @ np.array(
        [[1.0, -0.5, -0.5], [0.0, 0.75**0.5, -(0.75**0.5)]]
    )
    blank = simulate(RobotSetup(make_robot(lengths=LENGTHS[:1]), MARKERS[:1]))
    data = dataclasses.replace(blank, commands=balanced)
    truth = RobotSetup(make_robot(lengths=LENGTHS[:1], stiffness=np.inf, offset=4.5), MARKERS[:1])
    data = dataclasses.replace(data, points=predict_points(truth, data).predicted)
    found = fit_in_stages(robot, data, options=RobotFitOptions(model="arc", folds=2))
    stages = {stage.what: stage for stage in found.stages}
    assert "is inf in the robot file" in stages["stiffness of the tendons"].reason
    assert stages["distance of the tendons"].kept or found.fit.rms < 1e-3
    assert "-" in found.format_table()


def test_a_stage_that_is_refused_early_is_tried_once_more(monkeypatch):
    """Fits that are made up: clocking helps only where backlash is free."""
    errors = {(): 9.0, ("base",): 5.0, ("base", "commands.backlash"): 4.0,
              ("base", "commands.backlash", "tendons.*.offset"): 2.0}  # fmt: skip
    asked = []

    def fit(setup, data, *, free, options):
        asked.append(free)
        error = errors.get(free, 9.0)
        return SimpleNamespace(error=error, rms=error, undetermined=(), converged=True)

    monkeypatch.setattr(staged_fit, "fit_robot", fit)
    data = simulate(RobotSetup(make_robot(), MARKERS[:1]))
    found = fit_in_stages(make_robot(), data)
    assert [stage.what for stage in found.stages if stage.kept] == [
        "place and tilt of the base", "backlash", "distance of the tendons"
    ]  # fmt: skip
    assert found.stages[-1].error == 2.0 and len({stage.what for stage in found.stages}) == 8
    # What came after the last that stayed is not asked twice, nor what had stayed.
    assert len(asked) == 1 + 8 + 5 + 1


def test_a_residual_and_stages_ask_for_rows_left_out():
    with pytest.raises(InputError, match="folds is 0: a residual"):
        RobotFitOptions(folds=0, residual=True)
    data = simulate(RobotSetup(make_robot(), MARKERS[:1]))
    with pytest.raises(InputError, match="folds is 0: stages"):
        fit_in_stages(make_robot(), data, options=RobotFitOptions(folds=0))


def test_the_file_of_a_fit_has_its_band_and_the_error_of_a_tip_states_it(tmp_path):
    truth = RobotSetup(make_robot(lengths=LENGTHS[:1]), MARKERS[:1])
    data = simulate(truth, rows=120, noise=0.1)
    fit = fit_robot(truth, data, free=["base.position.x"])
    fit.robot.to_yaml(tmp_path / "fitted.yaml")
    robot = ContinuumRobot.from_yaml(tmp_path / "fitted.yaml")
    assert robot.calibration.band == fit.model_band
    band = fit.model_band
    for pull, kind in ((2.0, "1"), (0.0, "rest"), (9.0, "1 further")):
        found = robot_tip_error(robot, {"T1": pull}, command_sd=0.1, options=DrawOptions(draws=64))
        assert found.within[0] == kind and found.within[2] == 0.95
        assert found.within[1] == pytest.approx(band.radii.get(kind, (np.nan,))[0], nan_ok=True)
    # Of a fit to displacements nothing is said under tensions.
    pulled = robot_tip_error(
        robot, {"T1": 1.0}, held="tensions", command_sd=0.1, options=DrawOptions(draws=64)
    )
    assert pulled.within is None and pulled.left_out is None
    # With noise alone the radius is that of the length of a normal vector.
    assert band.radii["1"][0] == pytest.approx(0.1 * np.sqrt(chi2.ppf(0.95, 3)), rel=0.2)


def test_what_a_file_predicts_of_a_table_is_what_its_fit_predicts_with_the_band(tmp_path, capsys):
    truth = RobotSetup(make_robot(lengths=LENGTHS[:1]), MARKERS[:1])
    data = simulate(truth, rows=120, noise=0.1)
    fit = fit_robot(truth, data.select(np.arange(80)), free=["commands.backlash"])
    fit.robot.to_yaml(tmp_path / "fitted.yaml")
    later = data.select(np.arange(80, 120))
    later.commands[-1] = 9.0, -4.5, -4.5  # further than any row of the fit
    points = later.points[:, 0].copy()
    points[3] = np.nan
    titles = [f"{name} displacement [mm]" for name in later.tendons]
    where = [f"tip {axis} [mm]" for axis in "xyz"]
    write_table(tmp_path / "rows.csv", titles + where, np.hstack([later.commands, points]))
    write_table(tmp_path / "commands.csv", titles, later.commands)
    found = predict(tmp_path, "rows.csv", capsys)
    columns = found["columns"]
    places = np.stack([columns[f"tip_{axis}_mm"] for axis in "xyz"], axis=-1)
    expected = fit.predict(later)
    assert np.allclose(places, expected.predicted[:, 0], atol=1e-9)
    missed = np.linalg.norm(places - points, axis=-1)
    assert found["rms_mm"] == pytest.approx(np.sqrt(np.nanmean(missed**2)))
    kinds = np.array(columns["moved"])
    assert kinds[-1] == "1 further" and found["outside"] == {"1 further": 1}
    radii = fit.model_band.find_radii(kinds)[:, 0]
    assert columns["tip_within_mm"][:-1] == radii[:-1].tolist()
    assert columns["tip_within_mm"][-1] is None
    known = np.isfinite(missed[:-1])
    assert found["coverage"] == pytest.approx((missed <= radii)[:-1][known].mean())
    # Without points the places are the same, and nothing is said of their error.
    blind = predict(tmp_path, "commands.csv", capsys)
    assert blind["columns"]["tip_x_mm"] == columns["tip_x_mm"] and blind["rms_mm"] is None
    assert "tip_error_mm" not in blind["columns"]
    # pose says the same of one row.
    pull = ",".join(
        f"{name}={value}mm" for name, value in zip(data.tendons, data.commands[0], strict=True)
    )
    words = ["continuum", "pose", str(tmp_path / "fitted.yaml"), "--displacement", pull]
    assert main([*words, "--json"]) == 0
    band = json.loads(capsys.readouterr().out)["prediction_band"]
    assert band["radii_mm"]["tip"] == fit.model_band.radii[band["kind"]][0]
    assert main([*words, "--load", "at=10mm,force=1mN:0:0", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["prediction_band"] is None
    write_table(tmp_path / "pulled.csv", [f"{data.tendons[0]} tension [N]"], np.ones((2, 1)))
    assert (
        main(
            ["continuum", "predict", *map(str, (tmp_path / "fitted.yaml", tmp_path / "pulled.csv"))]
        )
        == 2
    )
    assert "was fitted to displacements" in capsys.readouterr().err


def write_table(path, titles, rows):
    np.savetxt(path, rows, delimiter=",", header=",".join(titles), comments="", fmt="%.17g")


def predict(folder, table, capsys):
    code = main(
        ["continuum", "predict", str(folder / "fitted.yaml"), str(folder / table), "--json"]
    )
    assert code == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"level": 95.0}, r"band level is 95: it must lie in \[0, 1\]"),
        ({"largest_bends": (0.7,)}, "1 largest_bends: it must have one for each of its 2 sections"),
        (
            {"radii": {"1": (1.0, 2.0)}},
            "2 radii of '1': it must have one for each of its 1 m",
        ),
        ({"radii": {"1": (-1.0,)}}, "band radius of '1' is -1"),
        ({"radii": {}}, "no kind and rows of 1"),
    ],
)
def test_a_band_that_cannot_be_is_refused(change, said):
    known = {
        "level": 0.95, "markers": ("tip",), "sections": SECTIONS, "largest_bends": (0.7, 0.5),
        "radii": {"1": (1.0,)}, "rows": {"1": 50}, "coverage": 0.9,
    }  # fmt: skip
    band = PredictionBand(**known)
    with pytest.raises(InputError, match=said):
        dataclasses.replace(band, **change)


def test_a_marker_that_was_never_seen_is_named():
    truth = RobotSetup(make_robot(lengths=LENGTHS[:1]), MARKERS)
    data = simulate(truth, rows=30, noise=0.1)
    data.points[:, -1] = np.nan
    with pytest.raises(InputError, match=f"marker '{MARKERS[-1].name}' was seen in no row"):
        fit_robot(truth, data, free=["base.position.x"])

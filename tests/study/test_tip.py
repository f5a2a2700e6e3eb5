"""Errors of a tip: first order against exact draws, closed forms, the models' derivatives."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bozzini.cli.main import main
from bozzini.continuum import ContinuumRobot, RobotCalibration, jacobian
from bozzini.effector import Effector, effector_preset
from bozzini.errors import FileFormatError, InputError
from bozzini.muscle import preset
from bozzini.muscle.files import FitSummary, MuscleFile
from bozzini.study.tip import (
    DrawOptions,
    Errors,
    effector_tip_error,
    read_robot_errors,
    read_robot_fit,
    robot_tip_error,
    spread_tip,
)

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
POSES = ({"R": 0.5, "G": 0.35}, {"R": 0.6}, {"G": 0.4, "B": 0.55})
EFFECTOR = Effector(effector_preset("prototype"))
MANY = DrawOptions(draws=100_000)


def make_errors(count: int = 3, seed: int = 0) -> Errors:
    root = np.random.default_rng(seed).normal(size=(count, count))
    names = tuple(f"e{k}" for k in range(count))
    return Errors(names=names, units=("",) * count, covariance=root @ root.T)


def test_a_linear_tip_is_exact() -> None:
    matrix = np.array([[1.0, 2.0, 0.5], [0.0, -1.0, 3.0]])
    errors = make_errors()
    found = spread_tip(lambda rows: rows @ matrix.T + 7.0, errors, options=DrawOptions(draws=4096))
    assert found.jacobian == pytest.approx(matrix)
    assert found.covariance == pytest.approx(matrix @ errors.covariance @ matrix.T)
    assert found.drawn_covariance == pytest.approx(found.covariance, rel=0.02)
    assert found.converged and not found.reason
    assert found.coverage == pytest.approx(0.95, abs=0.005)
    lengths, ways = found.axes
    assert ways.T @ np.diag(lengths**2) @ ways == pytest.approx(found.covariance)


def test_a_flat_ellipsoid_is_seen_in_its_plane() -> None:
    lift = np.array([[1.0, 0.0], [0.0, 2.0], [1.0, 1.0]])
    found = spread_tip(lambda rows: rows @ lift.T, make_errors(2), options=DrawOptions(draws=8192))
    assert found.axes[0][2] == pytest.approx(0.0, abs=1e-6)
    assert found.coverage == pytest.approx(0.95, abs=0.01)


def test_a_bent_tip_is_told() -> None:
    errors = Errors(names=("e",), units=("mm",), covariance=np.eye(1))

    def bend(rows: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack([rows[:, 0], rows[:, 0] ** 2])

    found = spread_tip(bend, errors)
    assert not found.converged and "take the draws" in found.reason
    # Of the square of a normal number the variance is 2, and to first order 0.
    assert found.covariance == pytest.approx(np.diag([1.0, 0.0]), abs=1e-12)
    assert found.drawn_covariance == pytest.approx(np.diag([1.0, 2.0]), abs=0.15)


@pytest.mark.parametrize("pose", POSES)
def test_pressures_of_an_effector(pose: dict[str, float]) -> None:
    """The thresholds of the issue: coverage 95 +- 1 %, covariance within 5 %."""
    found = effector_tip_error(EFFECTOR, pose, pressure_sd=0.005, options=MANY)
    assert len(found.drawn) == 100_000 and not found.failed
    assert found.residual < 0.05
    if len(pose) > 1:
        assert found.coverage == pytest.approx(0.95, abs=0.01)
    # One muscle moves the tip along a line: 95 % lie within 1.96 standard deviations of it.
    assert found.tip == pytest.approx(EFFECTOR.forward(pose).tip[:2])
    alone = [effector_tip_error(EFFECTOR, pose, pressure_sd=sd).axes[0][0] for sd in (0.001, 0.002)]
    assert alone[1] == pytest.approx(2.0 * alone[0], rel=1e-3)


def test_one_pressure_is_covered_too() -> None:
    found = effector_tip_error(EFFECTOR, {"R": 0.6}, pressure_sd=0.005, options=MANY)
    assert found.coverage == pytest.approx(0.95, abs=0.01)
    assert found.factor == pytest.approx(1.96, abs=0.001)


def test_near_the_dead_band_draws_are_asked_for() -> None:
    found = effector_tip_error(EFFECTOR, {"R": 0.06}, pressure_sd=0.03)
    assert not found.converged and "take the draws" in found.reason


def test_parameters_of_an_effector() -> None:
    sd = {"muscle.modulus": 0.02, "offset": 0.05}
    found = effector_tip_error(EFFECTOR, POSES[0], parameter_sd=sd)
    for name, value in sd.items():
        alone = effector_tip_error(EFFECTOR, POSES[0], parameter_sd={name: value})
        assert alone.alone == pytest.approx([found.alone[list(sd).index(name)]])
    assert np.trace(found.covariance) == pytest.approx(float((found.alone**2).sum()))
    design = EFFECTOR.design
    moved = Effector(design.replace(offset=design.offset + 1e-3)).forward(POSES[0]).tip[:2]
    assert (moved - found.tip) / 1e-3 == pytest.approx(found.jacobian[:, 1], rel=0.01, abs=1e-4)
    assert found.residual < 0.05


def make_fit(each: tuple[str, ...]) -> MuscleFile:
    muscle = EFFECTOR.design.muscles[0].muscle
    names = ("modulus", "braid_angle")
    return MuscleFile(
        muscle=muscle,
        model="energy",
        fit=FitSummary(
            response="contraction",
            names=names,
            covariance=((4e-4, 1e-5), (1e-5, 1e-6)),
            shared=tuple(name for name in names if name not in each),
            each=each,
        ),
    )


def test_a_fit_of_muscles() -> None:
    """What is shared is the same error as a parameter of all muscles; what is not adds up."""
    shared = effector_tip_error(EFFECTOR, POSES[0], fit=make_fit(()))
    plain = effector_tip_error(
        EFFECTOR, POSES[0], parameter_sd={"muscle.modulus": 0.02, "muscle.braid_angle": 1e-3}
    )
    assert shared.tip == pytest.approx(plain.tip) and shared.errors.names == make_fit(()).fit.names  # type: ignore[union-attr]
    assert shared.jacobian == pytest.approx(plain.jacobian, rel=1e-6)
    cross = np.outer(shared.jacobian[:, 0], shared.jacobian[:, 1]) * 1e-5
    assert shared.covariance == pytest.approx(plain.covariance + cross + cross.T)
    own = effector_tip_error(EFFECTOR, POSES[0], fit=make_fit(("modulus",)))
    assert set(own.errors.names) == {"modulus[R]", "modulus[G]", "modulus[B]", "braid_angle"}
    by_muscle = own.jacobian[:, ["modulus" in name for name in own.errors.names]]
    assert by_muscle.sum(axis=1) == pytest.approx(shared.jacobian[:, 0], rel=1e-3)


def test_muscles_are_specimens_about_a_mean_that_is_not_known_exactly() -> None:
    values = (0.50, 0.52, 0.57)
    among = float(np.var(values, ddof=1))
    mean = np.array([[1e-4, 9e-6], [9e-6, 1e-6]])  # of the fit, strongly correlated
    file = make_fit(("modulus",))
    covariance = mean + np.diag([among * (1.0 + 1.0 / 3.0), 0.0])
    fit = replace(
        file.fit,  # type: ignore[type-var]
        covariance=tuple(map(tuple, covariance.tolist())),
        specimens={f"s{k}": {"modulus": value} for k, value in enumerate(values)},
    )
    found = effector_tip_error(EFFECTOR, POSES[0], fit=replace(file, fit=fit)).errors
    draws = np.random.default_rng(1)
    common = draws.multivariate_normal([0.0, 0.0], mean, 400_000)
    common[:, 0] += math.sqrt(among / 3.0) * draws.standard_normal(len(common))
    drawn = {
        name: common[:, 0] + math.sqrt(among) * draws.standard_normal(len(common))
        if "modulus" in name
        else common[:, 1]
        for name in found.names
    }
    expected = np.cov(np.array([drawn[name] for name in found.names]))
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert found.covariance / size == pytest.approx(expected / size, abs=0.01)
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0


def make_robot() -> ContinuumRobot:
    return ContinuumRobot.from_yaml(EXAMPLES / "two_sections.yaml")


def test_displacements_of_a_robot_agree_with_its_jacobian() -> None:
    robot, given = make_robot(), {"T1": 2.0, "T4": 3.5}
    found = robot_tip_error(robot, given, command_sd=0.05, options=DrawOptions(draws=4096))
    shape = robot.forward(given)
    assert found.tip == pytest.approx(shape.tip)
    bends = np.asarray(shape.section_parameters, dtype=np.float64)
    slopes = jacobian(robot, bends)[:3]
    for k, name in enumerate(given):
        step = 1e-4
        ahead = robot.forward(given | {name: given[name] + step}).section_parameters
        moved = slopes @ ((np.asarray(ahead) - bends) / step).reshape(-1)
        assert found.jacobian[:, k] == pytest.approx(moved, abs=1e-3)
    assert found.residual < 0.05 and found.converged
    assert found.coverage == pytest.approx(0.95, abs=0.01)


@pytest.mark.slow
def test_tensions_agree_with_the_derivatives_of_the_elastic_model() -> None:
    robot, given = make_robot(), {"T1": 2.0, "T5": 1.0}
    found = robot_tip_error(robot, given, held="tensions", command_sd=0.01)
    model = robot.model(robot.choose_model({}, pulled=True))
    shape = model.shape_under_tensions(robot.order_tensions(given))
    slopes = model.jacobian(shape, held="tensions").by_tension[-1, 3:]  # type: ignore[attr-defined]
    turned = robot.base_frame[:3, :3] @ slopes
    columns = [robot.tendon_names.index(name) for name in given]
    assert found.jacobian == pytest.approx(turned[:, columns], rel=0.02, abs=0.02)


@pytest.mark.slow
def test_errors_of_the_base_move_and_turn_the_tip() -> None:
    robot, deviations = make_robot(), {"base.position.x": 0.5, "base.rotation.z": 0.01}
    errors = Errors.independent(deviations, {"base.position.x": "mm", "base.rotation.z": "rad"})
    found = robot_tip_error(robot, {"T1": 2.0}, parameters=errors)
    tip = robot.forward({"T1": 2.0}).tip
    assert found.tip == pytest.approx(tip)
    assert found.jacobian[:, 0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-6)
    assert found.jacobian[:, 1] == pytest.approx(np.cross([0.0, 0.0, 1.0], tip), abs=1e-3)
    still = Errors.independent({"tendons.T4.zero": 0.01}, {"tendons.T4.zero": "mm"})
    with pytest.raises(InputError, match="do not move the tip"):
        robot_tip_error(robot, {"T1": 2.0, "T4": -2.0}, parameters=still)


def write_fit(path: Path, names: list[str], left_out: float = 0.0) -> Path:
    estimates = {name: {"value": 2.0, "unit": "mm", "standard_error": 0.1} for name in names}
    robot = replace(make_robot(), calibration=RobotCalibration(
        values=dict.fromkeys(names, 2.0), validation_rms=left_out))  # fmt: skip
    found = {"estimates": estimates, "correlations": [[1.0, 0.3], [0.3, 1.0]]}
    path.write_text(json.dumps(found | {"robot": robot.to_dict()}), encoding="utf-8")
    return path


@pytest.mark.slow
def test_a_fit_of_a_robot(tmp_path: Path) -> None:
    names = ["sections.1.length", "tendons.T1.zero"]
    errors = read_robot_errors(write_fit(tmp_path / "fit.json", names))
    assert errors.names == tuple(names) and errors.units == ("relative", "mm")
    assert errors.deviations == pytest.approx([0.05, 0.1])
    assert errors.covariance[0, 1] == pytest.approx(0.3 * 0.05 * 0.1)
    found = robot_tip_error(make_robot(), {"T1": 2.0}, parameters=errors)
    # A zero of a tendon is as much as an error of its displacement.
    other = robot_tip_error(make_robot(), {"T1": 2.0}, command_sd=0.1)
    assert found.jacobian[:, 1] == pytest.approx(other.jacobian[:, 0], rel=1e-3, abs=1e-3)
    assert found.alone[0] > 0.0
    (tmp_path / "bad.json").write_text("{}")
    with pytest.raises(FileFormatError, match="no fit of a robot"):
        read_robot_errors(tmp_path / "bad.json")
    with pytest.raises(InputError, match="sections"):
        robot_tip_error(make_robot(), {"T1": 2.0}, parameters=Errors.independent(
            {"section.9.length": 1.0}, {"section.9.length": ""}))  # fmt: skip


def test_what_is_refused() -> None:
    with pytest.raises(InputError, match="nothing is uncertain"):
        effector_tip_error(EFFECTOR, POSES[0])
    with pytest.raises(InputError, match="holds no fit"):
        effector_tip_error(
            EFFECTOR, POSES[0], fit=MuscleFile(muscle=preset("effector-45"), model="energy")
        )
    with pytest.raises(InputError, match="2 rows of 2"):
        Errors(names=("a", "b"), units=("", ""), covariance=np.eye(3)[:, :2])
    for matrix, words in ((np.eye(3), "2 rows of 2"), ([[1, 0], [0.5, 1]], "not symmetric")):
        with pytest.raises(InputError, match=words):
            Errors(names=("a", "b"), units=("", ""), covariance=np.array(matrix))
    crossed = Errors(names=("a", "b"), units=("", ""), covariance=np.array([[1, 2], [2, 1]]))
    with pytest.raises(InputError, match="negative eigenvalue"):
        spread_tip(lambda rows: rows, crossed)


def test_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = ["effector", "tip-error", "--pressure", "R=500kPa,G=350kPa"]
    assert main(run) == 2 and "nothing is uncertain" in capsys.readouterr().err
    picture = tmp_path / "tip.png"
    assert main([*run, "--pressure-sd", "5kPa", "--out", str(picture)]) == 0
    assert "semi-axes" in capsys.readouterr().out and picture.stat().st_size > 4_000
    assert main([*run, "--sd", "muscle.modulus=20kPa", "--draws", "64", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["errors"]["muscle.modulus"]["sd"] == pytest.approx(0.02)
    assert main([*run, "--sd", "colour=1mm"]) == 2
    robot = str(EXAMPLES / "two_sections.yaml")
    run = ["continuum", "tip-error", robot, "--displacement", "T1=2mm"]
    table = tmp_path / "draws.csv"
    given = ["--displacement-sd", "0.05mm", "--sd", "sections.1.length=0.01", "--draws", "100"]
    assert main([*run, *given, "--out", str(table)]) == 0
    assert len(table.read_text(encoding="utf-8").splitlines()) == 101
    fit = write_fit(tmp_path / "fit.json", ["sections.1.length", "tendons.T1.zero"])
    assert main([*run, "--fit", str(fit), "--draws", "100", "--json"]) in (0, 1)
    assert main([*run, "--tension-sd", "1N"]) == 2
    assert main([*run, "--tension", "T1=2N"]) == 2


def test_the_ellipsoid_is_named_with_its_frame_and_the_error_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is of the errors given alone: measured poses are off by that of the model as well."""
    robot = str(EXAMPLES / "two_sections.yaml")
    run = ["continuum", "tip-error", robot, "--displacement", "T1=2mm"]
    alone = [*run, "--displacement-sd", "0.05mm", "--draws", "64"]
    capsys.readouterr()
    assert main(alone) == 0
    said = capsys.readouterr().out
    assert "of errors of commands and parameters alone: no band of poses" in said
    assert "left-out error of the fit: not known" in said
    assert "mm, in the frame of the base" in said
    assert main([*alone, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["left_out_rms_mm"] is None and found["frame"] == "base"
    assert "no band of poses" in found["ellipse_of"]
    fit = write_fit(tmp_path / "fit.json", ["sections.1.length", "tendons.T1.zero"], left_out=4.7)
    assert main([*run, "--fit", str(fit), "--draws", "64"]) in (0, 1)
    assert "left-out error of the fit: 4.7 mm rms, not in these" in capsys.readouterr().out
    run = ["effector", "tip-error", "--pressure", "R=500kPa", "--pressure-sd", "5kPa"]
    assert main([*run, "--draws", "64"]) == 0
    said = capsys.readouterr().out
    assert "in the frame of the base" in said and "not known" in said
    for command in ("effector", "continuum"):
        main([command, "tip-error", "--help"])
        assert "no band of poses" in " ".join(capsys.readouterr().out.split())
    axes = effector_tip_error(EFFECTOR, POSES[0], pressure_sd=0.005).plot()
    assert any("of these errors alone" in text.get_text() for text in axes.get_legend().texts)


def test_the_robot_that_was_fitted_serves_as_well_as_the_one_that_came_of_it(
    tmp_path: Path,
) -> None:
    """A play that the robot as given has not is that of the fit, and never below 0."""
    names = ["commands.backlash", "tendons.T1.zero"]
    robot = replace(make_robot(), calibration=RobotCalibration(
        backlash=0.02, values=dict.fromkeys(names, 0.02), validation_rms=1.0))  # fmt: skip
    estimates = {name: {"value": 0.02, "unit": "mm", "standard_error": 0.3} for name in names}
    found = {"estimates": estimates, "correlations": np.eye(2).tolist()}
    place = tmp_path / "fit.json"
    place.write_text(json.dumps(found | {"robot": robot.to_dict()}))
    fit = read_robot_fit(place)
    taken, notes = fit.take_robot(make_robot())
    assert taken == fit.take_robot(robot)[0] == robot and fit.take_robot(robot)[1] == ()
    assert notes == ("the numbers are those of fit.json, not of robot 'two sections' as given",)
    spread = robot_tip_error(
        taken, {"T1": 2.0}, parameters=fit.errors, options=DrawOptions(draws=64)
    )
    assert spread.left_out == 1.0 and spread.failed == 0
    place.write_text(json.dumps(found))
    with pytest.raises(InputError, match="does not have the numbers of fit.json: give the robot"):
        read_robot_fit(place).take_robot(make_robot())


@pytest.mark.slow(30)
def test_fits_as_the_commands_write_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = make_robot()
    random = np.random.default_rng(1)
    names = robot.tendon_names
    lines = [
        ",".join([*(f"{n} displacement [mm]" for n in names), *(f"tip {a} [mm]" for a in "xyz")])
    ]
    for first, second in ((0, 0), (1, 2), (2, -1), (3, 3), (-2, 2), (-3, -3)):
        given = np.asarray(robot.forward({"T1": max(first, 0.0), "T2": max(-first, 0.0),
                                          "T4": 3.0 + second}).displacements)  # fmt: skip
        tip = robot.forward(given).tip + random.normal(0.0, 0.3, 3)
        lines.append(",".join(f"{value:.6f}" for value in (*given, *tip)))
    (tmp_path / "rows.csv").write_text("\n".join(lines) + "\n")
    source = str(EXAMPLES / "two_sections.yaml")
    free = "sections.1.length,sections.2.length"
    fitted = tmp_path / "fitted.yaml"
    fit = ["continuum", "fit", source, str(tmp_path / "rows.csv"), "--free", free, "--only"]
    capsys.readouterr()
    assert main([*fit, "--model", "arc", "--out", str(fitted), "--json"]) in (0, 1)
    text = capsys.readouterr().out
    (tmp_path / "fit.json").write_text(text)
    run = ["continuum", "tip-error", str(fitted), "--displacement", "T1=1mm,T4=3mm"]
    assert main([*run, "--fit", str(tmp_path / "fit.json"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["left_out_rms_mm"] == pytest.approx(json.loads(text)["validation"]["rms_mm"])
    # The robot that was fitted serves as well: it is the one that the help names.
    run[2] = source
    assert main([*run, "--fit", str(tmp_path / "fit.json"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["tip_mm"] == pytest.approx(found["tip_mm"])
    known = json.loads(text)["estimates"]
    for name, one in found["errors"].items():
        assert one["sd"] == pytest.approx(known[name]["standard_error"] / known[name]["value"])
    # A length that is known by its error moves the tip by less than this much and its bend.
    assert 0.01 < max(found["semi_axes_mm"]) < 3.0

    pressure = np.linspace(0.1, 0.7, 12)
    pulled = EFFECTOR.models[0].contraction(pressure) + random.normal(0.0, 0.05, 12)
    rows = [f"{1000 * p:.1f},{x:.5f}" for p, x in zip(pressure, pulled, strict=True)]
    table = tmp_path / "muscle.csv"
    table.write_text("\n".join(["pressure [kPa],contraction [mm]", *rows]) + "\n")
    place = tmp_path / "muscle.yaml"
    fit = ["muscle", "fit", str(table), "--preset", "fitted-45", "--free", "modulus"]
    assert main([*fit, "--out", str(place)]) in (0, 1)
    capsys.readouterr()
    run = ["effector", "tip-error", "--pressure", "R=500kPa", "--fit", str(place), "--json"]
    assert main(run) == 0
    found = json.loads(capsys.readouterr().out)
    assert list(found["errors"]) == ["modulus"] and found["semi_axes_mm"][0] > 0.0

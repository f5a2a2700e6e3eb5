"""Measured robots: errors at rows that nothing was fitted to, and what makes them smaller."""

from __future__ import annotations

import dataclasses
import importlib
import sys
from pathlib import Path

import pytest

from bozzini.continuum import RobotFitOptions, fit_robot

FOLDER = Path(__file__).resolve().parents[2] / "validation"


@pytest.fixture(scope="module")
def load():
    sys.path.insert(0, str(FOLDER))
    yield importlib.import_module
    sys.path.remove(str(FOLDER))


@pytest.mark.slow
def test_quarters_of_a_recording_are_predicted(load, robot_dirs):
    case = load("three_section_robot")
    robot, folder = case.make_robot(), robot_dirs("three_section_robot")
    data = case.read_rows(folder, robot)
    found = case.fit_form(data, robot, case.CHOSEN)
    assert len(found.estimates) <= 15
    assert found.validation.rms <= 5.5
    by_length = case.fit_form(data, case.make_robot(even_compliance=False), case.CHOSEN)
    assert found.validation.rms < by_length.validation.rms


@pytest.mark.slow
def test_tips_of_other_commands_are_predicted(load, robot_dirs):
    case = load("three_cable_robot")
    setup = case.make_setup()
    data, others = case.read_rows(robot_dirs("three_cable_robot"), setup.robot)
    found = case.fit_form(data, setup, case.CHOSEN)
    assert len(found.estimates) <= 9
    assert found.predict(others).rms <= 3.2
    assert not found.undetermined
    scaled = case.fit_form(data, setup, case.DEGENERATE)
    assert any("commands.scale" in words for words in scaled.undetermined)


@pytest.mark.slow
def test_poses_of_a_tentacle_are_met(load, robot_dirs):
    case = load("tentacle")
    robot = case.make_robot()
    data = case.read_poses(robot_dirs("tentacle"), robot)
    options = RobotFitOptions(
        model="rod", model_options={"stretches": True}, loss="linear", folds=0
    )
    found = fit_robot(robot, data, free=case.CHOSEN, options=options)
    assert len(found.estimates) <= 3
    assert found.rms <= 12.5
    bare = dataclasses.replace(options, model_options={"stretches": False})
    stiff = fit_robot(robot, data, free=case.CHOSEN, options=bare)
    assert found.rms < stiff.rms

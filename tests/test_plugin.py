"""The example of a package that adds to Bozzini, installed and used as a user would."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

PLUGIN = Path(__file__).resolve().parents[1] / "examples" / "plugin"

USE = """
import numpy as np
import bozzini
from bozzini.continuum.models import CONTINUUM_MODELS
from bozzini.continuum.robot import RobotDesign
from bozzini.duct import find_centreline
from bozzini.duct.shape_files import load_shapes, save_shapes
from bozzini.duct.shapes import DUCT_SHAPES
from bozzini.effector import Effector, effector_preset
from bozzini.motion import PLANNERS, Scope, plan_insertion
from bozzini.muscle import MODELS
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return the directory into which the package was installed."""
    target = tmp_path_factory.mktemp("site")
    source = tmp_path_factory.mktemp("source")
    for path in PLUGIN.iterdir():
        if path.is_file():
            (source / path.name).write_bytes(path.read_bytes())
    command = ["pip", "install", "--no-deps", "--no-build-isolation", "--no-index", "--quiet"]
    subprocess.run(
        [sys.executable, "-m", *command, "--target", str(target), str(source)],
        check=True,
        capture_output=True,
        timeout=120,
    )
    return target


@pytest.fixture
def run(site, tmp_path):
    """Return a function that runs Python with the package installed, and gives its output."""

    def call(*arguments, code=0):
        done = subprocess.run(
            [sys.executable, *arguments],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(site), *sys.path])},
            capture_output=True,
            text=True,
            timeout=250,
        )
        assert done.returncode == code, done.stderr
        return done.stdout

    return call


def test_commands_list_what_the_package_adds(run):
    assert "spring" in run("-m", "bozzini", "muscle", "models")
    assert "bozzini_plugin:Ring" in run("-m", "bozzini", "duct", "kinds")
    assert "pulled" in run("-m", "bozzini", "plan", "--help")
    assert "rigid-discs" in run("-m", "bozzini", "continuum", "pose", "--help")


def test_the_duct_is_planned_in_by_the_planner_and_kept_in_a_file(run):
    run(
        "-c",
        USE
        + """
ring = DUCT_SHAPES["ring"](radius=60.0, tube=14.0)
angle = np.linspace(0.0, 2.0 * np.pi, 33)
middle = 60.0 * np.stack([np.cos(angle), np.sin(angle), np.zeros(33)], axis=1)
assert np.allclose(ring.signed_distance(middle), -14.0)
wall = middle + [0.0, 0.0, 14.0]
assert np.allclose(ring.gradient(wall), [0.0, 0.0, 1.0], atol=1e-6)
save_shapes(ring, "ring.json")
assert load_shapes("ring.json").signed_distance([0.0, 0.0, 0.0]) == ring.signed_distance(
    [0.0, 0.0, 0.0]
)

field = ring.sample(1.0)
line = find_centreline(field, (middle[2], middle[14]))
scope = Scope(diameter=6.0, link_length=8.0)
plan = plan_insertion(field, line, scope=scope, method="pulled")
assert plan.method == "pulled" and plan.status == "complete"
inserted = plan.joints[-1][:10]
left = -ring.signed_distance(inserted) - scope.radius
assert 0.0 < plan.certificate.clearance < left.min()
# A pulled chain cuts the bend: its links lie inside the line that the head takes.
assert (np.hypot(*inserted[1:, :2].T) < 59.0).any()
plan.save("plan.npz")
assert bozzini.Plan.load("plan.npz").method == "pulled"
""",
    )


def test_the_muscle_moves_an_effector(run):
    run(
        "-c",
        USE
        + """
effector = Effector(effector_preset("prototype"), MODELS["spring"])
tip = effector.forward({"R": 0.3}).tip
assert np.allclose(effector.inverse(tip[:2]).pressures, [0.3, 0.0, 0.0], atol=1e-6)

from bozzini.errors import InputError
from functools import partial

from bozzini.muscle import MuscleModel, RankOptions, calibrate, preset, rank

model = MODELS["spring"](preset("effector-45"))
held = model.contraction([[0.2], [0.6]], [0.0, 0.5])
assert held.shape == (2, 2)
assert np.allclose(model.force([[0.2], [0.6]], held), [0.0, 0.5])
assert np.allclose(MuscleModel.stiffness(model, 0.4, held), model.stiffness(0.4, held))
for wrong in (lambda: model.contraction(-0.1), lambda: model.force(0.1, 50.0),
              lambda: model.contraction(5.0), lambda: MODELS["spring"](model.muscle, spring=0.0)):
    try:
        wrong()
    except InputError as error:
        assert "must lie in" in str(error)
    else:
        raise AssertionError(wrong)

import pandas
table = pandas.DataFrame({"pressure [MPa]": [0.2, 0.4, 0.6], "contraction [mm]": [2.4, 4.8, 7.2]})
known = {"spring": partial(MODELS["spring"], spring=2.0, gain=12.0)}
ranking = rank(table, models=known, options=RankOptions(folds=0))
assert ranking.models[0].parameters == 0 and ranking.models[0].score.rmse < 1e-9

# Without loads only the gain is determined, with loads the spring too; both start at the defaults.
table["contraction [mm]"] = [3.0, 6.0, 9.0]
(free,) = rank(table, models=["spring"], options=RankOptions(folds=0)).models
assert free.calibration.free == ("gain",) and "spring" in free.held
assert np.isclose(free.calibration.estimates["gain"], 15.0)
loads = np.repeat([0.0, 0.5, 1.0], 3)
table = pandas.concat([table] * 3)
table["load [N]"], table["contraction [mm]"] = loads, table["contraction [mm]"] - loads / 1.25
fit = calibrate(MODELS["spring"], preset("effector-45"), data=table)
assert np.allclose([fit.estimates["spring"], fit.estimates["gain"]], [1.25, 15.0])
assert fit.units["spring"] == "N/mm" and fit.fitted.spring == fit.estimates["spring"]
""",
    )


def test_commands_set_and_fit_the_numbers_of_the_muscle(run, tmp_path):
    solve = "-m", "bozzini", "muscle", "solve", "--pressure", "0.5MPa", "--model", "spring"
    assert json.loads(run(*solve, "--json"))["contraction_mm"] == pytest.approx(6.0)
    found = json.loads(run(*solve, "--set", "gain=10", "--load", "1N", "--json"))
    assert found["contraction_mm"] == pytest.approx(10.0 * 0.5 - 1.0 / 2.0)
    run(*solve, "--set", "gain=-1", code=2)
    rows = "\n".join(f"{p},{q},{15.0 * p - q / 1.25}" for p in (0.2, 0.4, 0.6) for q in (0, 0.5, 1))
    (tmp_path / "loads.csv").write_text(f"pressure [MPa],load [N],contraction [mm]\n{rows}\n")
    found = json.loads(
        run("-m", "bozzini", "muscle", "fit", "loads.csv", "--model", "spring", "--json")
    )
    estimates = {name: item["value"] for name, item in found["estimates"].items()}
    assert estimates == pytest.approx({"spring": 1.25, "gain": 15.0})


def test_the_continuum_model_tends_to_arcs_as_discs_are_added(run):
    run(
        "-c",
        USE
        + """
from bozzini.continuum import Section, Tendon

errors = []
for discs in (5, 10, 20):
    angles = {"a": 0.0, "b": 2.0 * np.pi / 3.0, "c": 4.0 * np.pi / 3.0}
    tendons = tuple(Tendon(name=name, offset=4.0, angle=angle) for name, angle in angles.items())
    design = RobotDesign((Section(length=80.0, radius=5.0, discs=discs, tendons=tendons),))
    models = [CONTINUUM_MODELS[name](design) for name in ("rigid-discs", "arc")]
    tips = [model.shape([4.8, -2.4, -2.4]).frames[-1, :3, 3] for model in models]
    errors.append(np.linalg.norm(tips[0] - tips[1]))
assert errors[0] > 0.0
assert np.allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=0.05), errors
""",
    )

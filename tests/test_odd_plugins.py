"""Packages that cannot be imported: named in one line, and harmless to everything else."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bozzini.anatomy import tract_from_labels
from bozzini.cli.main import main
from bozzini.continuum import CONTINUUM_MODELS
from bozzini.duct import DUCT_SHAPES, Centreline, DuctShape, RoundCones, load
from bozzini.errors import BozziniError, GeometryError, PluginError
from bozzini.motion import (
    PLANNERS,
    FreeSpace,
    Motion,
    Planner,
    PlannerOptions,
    Scope,
    certify_plan,
    move_free_chain,
    plan_insertion,
    verify_plan,
)
from bozzini.muscle import MODELS, Measurements, preset, rank, write_measurements
from bozzini.study import InsertionOptions, run_insertion

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
MODULE = """
from bozzini.continuum.coupling import ParallelModel
from bozzini.errors import InputError
from bozzini.muscle import MuscleModel

class Plain:
    name = "plain"

class Honest(MuscleModel):
    name = "honest"
    def __init__(self, muscle): self.muscle = muscle
    def force(self, pressure, contraction, *, direction=None): raise InputError("no answer")
    def contraction(self, pressure, load=0.0, *, direction=None): raise InputError("no answer")

class Stiff(ParallelModel):
    name = "stiff"
    def shape(self, displacements): pass
"""
NAMES = {
    "bozzini.muscles": {
        "missing": "no_such_module:Model", "spelled": "odd_syntax:Model", "absent": "odd:Model",
        "plain": "odd:Plain", "honest": "odd:Honest",
    },
    "bozzini.planners": {"missing": "no_such_module:Planner", "plain": "odd:Plain"},
    "bozzini.ducts": {"missing": "no_such_module:Duct"},
    "bozzini.continuum": {"missing": "no_such_module:Model"},
}  # fmt: skip
BROKEN = {
    "missing": "cannot be imported: ModuleNotFoundError: No module named 'no_such_module'",
    "spelled": "cannot be imported: SyntaxError",
    "absent": "cannot be imported: AttributeError",
    "plain": "it must be a MuscleModel",
}
SOLVE = "muscle", "solve", "--pressure", "0.3MPa", "--model"


@pytest.fixture(autouse=True)
def installed(tmp_path, monkeypatch):
    """Install a package with nothing but odd classes."""
    (tmp_path / "odd.py").write_text(MODULE)
    (tmp_path / "odd_syntax.py").write_text("class Model(\n")
    about = tmp_path / "odd_package-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: odd-package\nVersion: 1.0\n")
    text = "".join(
        f"[{group}]\n" + "".join(f"{name} = {place}\n" for name, place in names.items())
        for group, names in NAMES.items()
    )
    (about / "entry_points.txt").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    for registry in (MODELS, PLANNERS, DUCT_SHAPES, CONTINUUM_MODELS):
        monkeypatch.delitem(registry.__dict__, "plugins", raising=False)
        monkeypatch.setattr(registry, "_loaded", {})
    yield
    for registry in (MODELS, PLANNERS, DUCT_SHAPES, CONTINUUM_MODELS):
        registry.__dict__.pop("plugins", None)


@pytest.fixture
def run(capsys):
    def call(*arguments):
        capsys.readouterr()
        code = main([str(item) for item in arguments])
        return code, *capsys.readouterr()

    return call


@pytest.fixture
def data():
    pressure = np.linspace(0.2, 0.8, 12)
    contraction = MODELS["energy"](preset("effector-45")).contraction(pressure)
    return Measurements(pressure=pressure, contraction=contraction)


@pytest.mark.parametrize(("name", "words"), BROKEN.items())
def test_a_broken_model_asked_for_by_name_is_one_line(run, name, words):
    code, out, err = run(*SOLVE, name)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert f"'{name}' of odd-package ({NAMES['bozzini.muscles'][name]})" in err and words in err


def test_broken_models_are_listed_with_the_reason(run):
    code, out, _ = run("muscle", "models", "--json")
    listed = json.loads(out)
    assert code == 0 and listed["plugins"] == NAMES["bozzini.muscles"]
    assert {*listed["broken"]} == {*BROKEN} == {*MODELS.broken}
    for name, words in BROKEN.items():
        assert words in listed["broken"][name]
    assert "broken: the model 'spelled' of odd-package" in run("muscle", "models")[1]
    assert "cannot be imported" in run("continuum", "models")[1]


def install(folder: Path, package: str, *, group: str, name: str, place: str) -> None:
    about = folder / f"{package}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[{group}]\n{name} = {place}\n")


def test_a_name_that_bozzini_has_is_listed_and_stays_its_own(run, tmp_path):
    kind = MODELS["energy"]
    install(tmp_path, "copy", group="bozzini.muscles", name="energy", place="odd:Honest")
    install(tmp_path, "rod-copy", group="bozzini.continuum", name="rod", place="odd:Stiff")
    assert MODELS["energy"] is kind and "energy" not in MODELS.plugins
    for command, line in (
        ("muscle", "broken: 'energy' of copy (odd:Honest) is not used: Bozzini has a model"),
        ("continuum", "broken: 'rod' of rod-copy (odd:Stiff) is not used: Bozzini has a model"),
    ):
        code, out, _ = run(command, "models")
        assert code == 0 and out.count(line) == 1
    assert run(*SOLVE, "energy")[0] == 0


def test_a_name_that_two_packages_use_is_refused_with_both(run, tmp_path):
    install(tmp_path, "second", group="bozzini.muscles", name="sound", place="odd:Plain")
    install(tmp_path, "first", group="bozzini.muscles", name="sound", place="odd:Honest")
    words = "cannot be used: first (odd:Honest) and second (odd:Plain) have one of that name"
    code, out, err = run(*SOLVE, "sound")
    assert (code, out, err.count("\n")) == (2, "", 1) and words in err
    assert f"broken: the model 'sound' {words}" in run("muscle", "models")[1]
    assert words in MODELS.broken["sound"]


@pytest.mark.slow
def test_broken_models_are_refused_in_a_ranking_and_the_others_ranked(run, data, monkeypatch):
    one = {"thesis": MODELS["thesis"]}
    monkeypatch.setitem(MODELS.__dict__, "own", one)
    refused = BROKEN | {"honest": "no answer"}
    table = write_measurements("data.csv", data)
    code, out, err = run("muscle", "compare", table, "--folds", "0", "--json")
    assert code == 0, err
    found = json.loads(out)
    assert [entry["model"] for entry in found["models"]] == ["thesis"]
    assert {*found["refusals"]} == {*refused}
    ranking = rank(data).refusals
    for name, words in refused.items():
        assert words in found["refusals"][name] and words in ranking[name]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("missing", "cannot be imported"),
        ("plain", "it must be a Planner"),
    ],
)
def test_a_broken_planner_is_named(name, words):
    duct = RoundCones([(0, 0, 0), (60, 0, 0)], [5.0, 5.0])
    line = Centreline.from_points([(0, 0, 0), (50, 0, 0)], duct)
    scope = Scope(diameter=3.0, link_length=6.0)
    with pytest.raises(PluginError) as caught:
        plan_insertion(duct, line, scope=scope, method=name)
    assert f"planner '{name}' of odd-package" in str(caught.value)
    assert words in str(caught.value)


class Rail(Planner):
    """Pulls the joints along the line; `change` is what it states otherwise."""

    name = "rail"

    def __init__(self, **change):
        self.change = change

    def move(self, space, scope, *, options, progress=None):
        line = space.centreline
        heads = np.linspace(0.0, line.length, int(np.ceil(line.length / options.head_step)) + 1)
        places = np.stack([np.interp(heads, line.arc_length, c) for c in line.points.T], axis=1)
        chain = space.tube.place_chain(scope.count_links(line.length) + 1, scope.link_length)
        joints = move_free_chain(chain, places, slip=options.slip)
        given = {"joints": joints, "head_arc_length": heads, "path": line.points}
        made = {k: v(given[k]) if callable(v) else v for k, v in self.change.items()}
        return Motion(**(given | made))


RAIL_DUCT = RoundCones([(0, 0, 0), (60, 0, 0)], [5.0, 5.0])


def pull(**change):
    line = Centreline.from_points([(0, 0, 0), (50, 0, 0)], RAIL_DUCT)
    options = PlannerOptions(head_step=1.0, advise=False)
    return Rail(**change).plan(
        FreeSpace(RAIL_DUCT, line), Scope(diameter=3.0, link_length=6.0), options=options
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"joints": lambda j: np.repeat(j[:1], len(j), axis=0)}, "head is 50 mm off its path"),
        ({"path": lambda p: p * np.nan}, "not finite"),
        ({"joints": lambda j: 2.0 * j}, "mm long at step 0: it must be 6 mm"),
        ({"joints": lambda j: j * np.nan}, "must be finite"),
        ({"joints": lambda j: j[::9], "head_arc_length": lambda s: s[::9]}, "moves 9 mm in a step"),
        ({"joints": lambda j: j[:-2], "head_arc_length": lambda s: s[:-2]}, "route ends at 50.0"),
    ],
)
def test_a_motion_that_is_not_that_of_its_path_is_refused(change, words):
    with pytest.raises(BozziniError) as caught:
        pull(**change)
    assert words in str(caught.value)


def test_a_planner_may_give_lists_and_its_certificate_is_computed_anew():
    plan = pull()
    again = pull(joints=lambda j: j.tolist(), path=lambda p: p.tolist())
    claimed = pull(certificate=replace(plan.certificate, clearance=99.0, evaluations=-1))
    assert plan.status == "complete" and verify_plan(plan, RAIL_DUCT).certified
    for other in (again, claimed):
        assert np.array_equal(other.joints, plan.joints)
        assert other.proved == plan.proved == certify_plan(plan, RAIL_DUCT).clearance
    assert claimed.certificate.evaluations == plan.certificate.evaluations


def test_a_shape_that_cannot_be_imported_is_named(tmp_path):
    head = {"format": "bozzini shapes", "version": 1, "units": "mm", "shapes": [{}]}
    path = tmp_path / "shapes.json"
    path.write_text(json.dumps(head | {"kind": "missing"}))
    with pytest.raises(PluginError, match="the shape 'missing' of odd-package"):
        load(path)


class Ball(DuctShape):
    """A ball of 10 mm that answers with what it is given, changed."""

    bounds = np.array([[-10.0] * 3, [10.0] * 3])

    def __init__(self, change):
        super().__init__()
        object.__setattr__(self, "change", change)

    def signed_distance(self, points):
        return self.change(np.linalg.norm(points, axis=-1) - 10.0)


@pytest.mark.parametrize("use", [lambda d: d.sample(2.0), lambda d: d.pack()])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d * np.nan, r"is nan at \(.*\) mm: it must be finite"),
        (lambda d: np.zeros(()), r"has shape \(\) at points of shape"),
        (lambda d: 2.0 * d, "changes by more than"),
    ],
)
def test_what_proofs_see_of_a_shape_is_checked(change, words, use):
    with pytest.raises(GeometryError, match=f"the signed distance of a Ball {words}"):
        use(Ball(change))


def test_a_continuum_model_that_cannot_be_imported_is_refused(run):
    robot = EXAMPLES / "two_sections.yaml"
    command = [robot, "--displacement", "T1=1mm,T2=-0.5mm,T3=-0.5mm"]
    code, out, err = run("continuum", "compare", *command, "--json")
    assert code == 0, err
    rows = json.loads(out)["models"]
    assert [name for name, row in rows.items() if row["refused"]] == ["missing"]
    code, out, err = run("continuum", "pose", *command, "--model", "missing")
    assert (code, out, err.count("\n")) == (2, "", 1) and "odd-package" in err


@pytest.mark.slow
def test_a_comparison_of_plans_goes_on_without_broken_planners():
    tract = tract_from_labels(np.pad(np.ones((9, 9, 30), dtype=np.uint8), 2), np.eye(4))
    options = InsertionOptions(voxel=1.0, head_step=2.0, compare=True)
    study = run_insertion(tract, Scope(diameter=4.0, link_length=6.0), options=options)
    assert [plan.asked for plan in study.comparison] == ["tube", "follow", "thesis"]
    named = [item.message for item in study.findings if item.code == "plugin"]
    assert len(named) == len(NAMES["bozzini.planners"])
    assert {line.split("'")[1] for line in named} == {*NAMES["bozzini.planners"]}
    assert all(f"warning: {line}" in study.plan.findings for line in named)

"""Packages that add something broken: named in one line, and harmless to everything else."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bozzini.anatomy import tract_from_labels
from bozzini.cli.main import main
from bozzini.continuum import CONTINUUM_MODELS
from bozzini.duct import DUCT_SHAPES, Centreline, DuctShape, RoundCones, load, union
from bozzini.errors import FileFormatError, GeometryError, InputError, PluginError
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
from bozzini.muscle import MODELS, Measurements, RankOptions, preset, rank, write_measurements
from bozzini.study import InsertionOptions, run_insertion

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
MODULE = """
import numpy as np
from bozzini.continuum.coupling import ParallelModel
from bozzini.duct.base import DuctShape
from bozzini.errors import InputError
from bozzini.motion import Planner
from bozzini.muscle import MuscleModel

class Plain:
    name = "plain"

class Muscle(MuscleModel):
    def __init__(self, muscle): self.muscle = muscle
    def force(self, pressure, contraction, *, direction=None): return 1 / 0
    def contraction(self, pressure, load=0.0, *, direction=None): return {}["gain"]

class Raising(Muscle): name = "raising"
class Nameless(Muscle): pass
class Renamed(Muscle): name = "another"
class Greedy(Muscle):
    name = "greedy"
    def __init__(self, muscle, gain): pass
class Unbuilt(Muscle):
    name = "unbuilt"
    def __init__(self, muscle): raise OSError("no table")
class Unfinished(MuscleModel):
    name = "unfinished"
    def force(self, pressure, contraction, *, direction=None): pass
class Nothing(Muscle):
    name = "nothing"
    def contraction(self, pressure, load=0.0, *, direction=None): return None
class Sound(Muscle):
    name = "sound"
    def force(self, pressure, contraction, *, direction=None):
        return 9.0 * np.asarray(pressure) - contraction
    def contraction(self, pressure, load=0.0, *, direction=None):
        return 9.0 * np.asarray(pressure) - load
class Forceless(Sound):
    name = "forceless"
    def force(self, pressure, contraction, *, direction=None): return None
class Misshapen(Sound):
    name = "misshapen"
    def contraction(self, pressure, load=0.0, *, direction=None): return np.zeros(7)
class Honest(Muscle):
    name = "honest"
    def contraction(self, pressure, load=0.0, *, direction=None): raise InputError("no answer")

class Lost(Planner):
    name = "lost"
    def move(self, space, scope, *, options, progress=None): raise IndexError("no way")
class Mute(Lost):
    name = "mute"
    def move(self, space, scope, *, options, progress=None): pass
class Fussy(Lost):
    name = "fussy"
    def __init__(self, speed): pass

class Hole(DuctShape):
    name = "hole"
    @property
    def bounds(self): return np.array([[-1.0] * 3, [1.0] * 3])
    def signed_distance(self, points): return points / None

class Stiff(ParallelModel):
    name = "stiff"
    def shape(self, displacements): raise np.linalg.LinAlgError("singular")
class Blank(ParallelModel):
    name = "blank"
    def shape(self, displacements): return None
"""
NAMES = {
    "bozzini.muscles": {
        "missing": "no_such_module:Model", "spelled": "odd_syntax:Model", "absent": "odd:Model",
        "plain": "odd:Plain", "nameless": "odd:Nameless", "renamed": "odd:Renamed",
        "greedy": "odd:Greedy", "unbuilt": "odd:Unbuilt", "unfinished": "odd:Unfinished",
        "raising": "odd:Raising", "nothing": "odd:Nothing", "honest": "odd:Honest",
        "forceless": "odd:Forceless", "misshapen": "odd:Misshapen",
    },
    "bozzini.planners": {
        "missing": "no_such_module:Planner", "plain": "odd:Plain", "lost": "odd:Lost",
        "mute": "odd:Mute", "fussy": "odd:Fussy",
    },
    "bozzini.ducts": {"missing": "no_such_module:Duct", "hole": "odd:Hole"},
    "bozzini.continuum": {
        "missing": "no_such_module:Model", "stiff": "odd:Stiff",
        "blank": "odd:Blank",
    },
}  # fmt: skip
BROKEN = {
    "missing": "cannot be imported: ModuleNotFoundError: No module named 'no_such_module'",
    "spelled": "cannot be imported: SyntaxError",
    "absent": "cannot be imported: AttributeError",
    "plain": "it must be a MuscleModel",
    "nameless": "the class is without a name, its name must be 'nameless'",
    "renamed": "the class is named 'another', its name must be 'renamed'",
    "greedy": "it must be made with 1 argument(s): missing a required argument: 'gain'",
    "unfinished": "it has no contraction",
}
FAILING = {
    "unbuilt": "failed in __init__: OSError: no table",
    "raising": "failed in contraction: KeyError: 'gain'",
}
WRONG_ANSWERS = {
    "forceless": "(odd.Forceless) gave None as force: it must give a number for each",
    "misshapen": "(odd.Misshapen) gave array([0., 0., 0., 0., 0., 0., 0.]) as contraction",
    "nothing": "(odd.Nothing) gave None as contraction: it must give a number for each",
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


@pytest.mark.parametrize(("name", "words"), (BROKEN | FAILING).items())
def test_a_broken_model_asked_for_by_name_is_one_line(run, name, words):
    code, out, err = run(*SOLVE, name)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert f"'{name}' of odd-package ({NAMES['bozzini.muscles'][name]})" in err and words in err


@pytest.mark.parametrize(("name", "words"), WRONG_ANSWERS.items())
def test_a_model_that_gives_no_numbers_is_one_line(run, name, words):
    code, out, err = run(*SOLVE, name)
    assert (code, out, err.count("\n")) == (2, "", 1) and words in err
    model = MODELS[name](preset("effector-45"))
    with pytest.raises(PluginError, match=f"the model {name} .odd"):
        model.solve([0.1, 0.2], [[1.0], [2.0]])


def test_a_model_of_another_package_answers_for_every_argument():
    import odd

    model = odd.Sound(preset("effector-45"))
    state = model.solve([0.1, 0.2], [[0.0], [0.5]])
    assert state.force == pytest.approx(np.broadcast_to([[0.0], [0.5]], (2, 2)))
    with pytest.raises(InputError, match="shapes do not go together"):
        model.force([0.1, 0.2], [1.0, 2.0, 3.0])


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
    install(tmp_path, "second", group="bozzini.muscles", name="sound", place="odd:Sound")
    install(tmp_path, "first", group="bozzini.muscles", name="sound", place="odd:Honest")
    words = "cannot be used: first (odd:Honest) and second (odd:Sound) have one of that name"
    code, out, err = run(*SOLVE, "sound")
    assert (code, out, err.count("\n")) == (2, "", 1) and words in err
    assert f"broken: the model 'sound' {words}" in run("muscle", "models")[1]
    assert words in MODELS.broken["sound"]


@pytest.mark.slow
def test_broken_models_are_refused_in_a_ranking_and_the_others_ranked(run, data, monkeypatch):
    one = {"thesis": MODELS["thesis"]}
    monkeypatch.setitem(MODELS.__dict__, "own", one)
    others = {"honest": "no answer", "forceless": "it cannot be fitted"}
    refused = BROKEN | FAILING | WRONG_ANSWERS | others
    table = write_measurements("data.csv", data)
    code, out, err = run("muscle", "compare", table, "--folds", "0", "--json")
    assert code == 0, err
    found = json.loads(out)
    assert [entry["model"] for entry in found["models"]] == ["thesis"]
    assert {*found["refusals"]} == {*refused}
    ranking = rank(data).refusals
    for name, words in refused.items():
        assert words in found["refusals"][name] and words in ranking[name]


@pytest.mark.slow
def test_broken_models_are_refused_by_processes_as_without(data):
    names = ["chou", *FAILING, *WRONG_ANSWERS]
    alone, apart = (
        rank(data, models=names, options=RankOptions(folds=0, jobs=jobs)) for jobs in (1, 2)
    )
    assert alone.refusals == apart.refusals and {*FAILING} <= {*alone.refusals}
    assert [entry.name for entry in alone.models] == [entry.name for entry in apart.models]


def test_an_exception_of_a_model_keeps_its_cause():
    model = MODELS["raising"](preset("effector-45"))
    for call in (lambda: model.force(0.3, 0.0), lambda: model.contraction(0.3)):
        with pytest.raises(PluginError, match="'raising' of odd-package") as caught:
            call()
        assert isinstance(caught.value.__cause__, (ZeroDivisionError, KeyError))
    with pytest.raises(InputError, match="^no answer$"):
        MODELS["honest"](preset("effector-45")).contraction(0.3)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("missing", "cannot be imported"),
        ("plain", "it must be a Planner"),
        ("fussy", "it must be made with 0 argument(s)"),
        ("lost", "failed in move: IndexError: no way"),
        ("mute", "gave a NoneType: it must give a Motion"),
    ],
)
def test_a_planner_that_is_broken_or_fails_is_named(name, words):
    duct = RoundCones([(0, 0, 0), (60, 0, 0)], [5.0, 5.0])
    line = Centreline.from_points([(0, 0, 0), (50, 0, 0)], duct)
    scope = Scope(diameter=3.0, link_length=6.0)
    with pytest.raises(PluginError) as caught:
        plan_insertion(duct, line, scope=scope, method=name)
    assert f"planner '{name}' of odd-package" in str(caught.value) or name == "mute"
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
        ({"joints": lambda j: j[:0], "head_arc_length": lambda s: s[:0]}, "at least 1 step"),
        ({"joints": lambda j: j[..., :2]}, r"must give (steps, joints, 3)"),
        ({"joints": "all of them"}, "joints of a motion is 'all of them'"),
        ({"path": None}, "path of a motion is None"),
        ({"path": lambda p: p[0]}, "gave a path of shape (3,)"),
        ({"path": lambda p: p[:1]}, "n at least 2"),
        ({"path": lambda p: p * np.nan}, "not finite"),
        ({"joints": lambda j: j[::9], "head_arc_length": lambda s: s[::9]}, "moves 9 mm in a step"),
        ({"joints": lambda j: j[:-2], "head_arc_length": lambda s: s[:-2]}, "route ends at 50.0"),
        ({"reason_code": "ANGLE", "reason": 5}, "the reason 5: it must give both as text"),
        ({"reason_code": "ANGLE"}, "must give both as text"),
        ({"refusal": "ANGLE"}, "must be a Refusal or None"),
        ({"method": 5}, "gave the method 5"),
    ],
)
def test_a_motion_that_is_none_is_refused(change, words):
    with pytest.raises(PluginError) as caught:
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


def test_a_shape_that_is_broken_or_fails_is_named(tmp_path):
    head = {"format": "bozzini shapes", "version": 1, "units": "mm", "shapes": [{}]}
    path = tmp_path / "shapes.json"
    path.write_text(json.dumps(head | {"kind": "missing"}))
    with pytest.raises(PluginError, match="the shape 'missing' of odd-package"):
        load(path)
    path.write_text(json.dumps(head | {"kind": "hole"}))
    with pytest.raises(PluginError, match="'hole' of odd-package .* failed in signed_distance"):
        load(path).signed_distance([(0.0, 0.0, 0.0)])
    path.write_text(json.dumps(head | {"kind": "hole", "shapes": [{"radius": 1.0}]}))
    with pytest.raises(FileFormatError, match="radius"):
        load(path)


class Ball(DuctShape):
    """A ball of 10 mm that answers with what it is given, changed."""

    def __init__(self, *, box=((-10.0,) * 3, (10.0,) * 3), change=lambda d: d):
        super().__init__()
        object.__setattr__(self, "box", box)
        object.__setattr__(self, "change", change)

    @property
    def bounds(self):
        return self.box

    def signed_distance(self, points):
        return self.change(np.linalg.norm(points, axis=-1) - 10.0)


USES = {
    "distance": lambda duct: duct.signed_distance([(1.0, 0.0, 0.0)]),
    "bound": lambda duct: duct.clearance_bound([(1.0, 0.0, 0.0)]),
    "gradient": lambda duct: duct.gradient([(1.0, 0.0, 0.0)]),
    "erode": lambda duct: duct.erode(1.0),
    "union": lambda duct: union(duct, Ball()),
    "sample": lambda duct: duct.sample(2.0),
    "plot": lambda duct: duct.plot(),
}
WRONG_DISTANCES = {
    "nan": (lambda d: d * np.nan, r"is nan at \(.*\) mm: it must be finite"),
    "number": (lambda d: -1.0, r"has shape \(\) at points of shape"),
    "none": (lambda d: None, "is None: it must be a number or an array"),
}


@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize("wrong", WRONG_DISTANCES)
def test_a_distance_that_is_none_is_refused_wherever_it_is_used(wrong, use):
    change, words = WRONG_DISTANCES[wrong]
    with pytest.raises(GeometryError, match=f"the signed distance of a Ball {words}"):
        USES[use](Ball(change=change))


def test_a_shape_may_answer_with_lists():
    lists, arrays = Ball(change=lambda d: d.tolist()), Ball(box=np.array(Ball().bounds))
    points = np.random.default_rng(0).uniform(-8.0, 8.0, (20, 3))
    assert np.array_equal(lists.signed_distance(points), arrays.signed_distance(points))
    assert np.array_equal(lists.gradient(points), arrays.gradient(points))
    assert np.array_equal(lists.erode(1.0).bounds, arrays.erode(1.0).bounds)
    with pytest.raises(InputError, match="1 point"):
        lists.signed_distance([(np.nan, 0.0, 0.0)])


@pytest.mark.parametrize(
    "box",
    [[(1.0,) * 3] * 2, [(0.0,) * 4, (1.0,) * 4], [(0.0,) * 3, (np.inf,) * 3], None, [[1.0], 2]],
)
def test_bounds_that_are_no_box_are_refused(box):
    for use in (lambda duct: duct.dim, USES["erode"], USES["plot"], USES["union"]):
        with pytest.raises(GeometryError, match="the bounds of a Ball"):
            use(Ball(box=box))


def test_a_continuum_model_that_is_broken_or_fails_is_refused(run):
    robot = EXAMPLES / "two_sections.yaml"
    command = [robot, "--displacement", "T1=1mm,T2=-0.5mm,T3=-0.5mm"]
    code, out, err = run("continuum", "compare", *command, "--json")
    assert code == 0, err
    rows = json.loads(out)["models"]
    assert {name for name, row in rows.items() if row["refused"]} == {"missing", "stiff", "blank"}
    assert "failed in shape: LinAlgError: singular" in rows["stiff"]["reason"]
    assert rows["blank"]["reason"] == "the model blank gave a NoneType: it must give a Shape"
    for name in ("missing", "stiff", "blank"):
        code, out, err = run("continuum", "pose", *command, "--model", name)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert ("it must give a Shape" if name == "blank" else "odd-package") in err


@pytest.mark.slow
def test_a_comparison_of_plans_goes_on_without_broken_planners():
    tract = tract_from_labels(np.pad(np.ones((9, 9, 30), dtype=np.uint8), 2), np.eye(4))
    options = InsertionOptions(voxel=1.0, head_step=2.0, compare=True)
    study = run_insertion(tract, Scope(diameter=4.0, link_length=6.0), options=options)
    assert [plan.asked for plan in study.comparison] == ["tube", "follow", "thesis"]
    named = [item.message for item in study.findings if item.code == "plugin"]
    assert len(named) == len(NAMES["bozzini.planners"])
    assert {line.split("'")[1] for line in named if "odd-package" in line} == {
        *NAMES["bozzini.planners"]
    } - {"mute"}
    assert all(f"warning: {line}" in study.plan.findings for line in named)

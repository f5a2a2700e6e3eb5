"""A task of another package: declared once, found as command, file, study, form and page."""

from __future__ import annotations

import asyncio
import csv
import importlib
import json
import os
import sys
from dataclasses import dataclass, make_dataclass, replace

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from bozzini.checks import quantity
from bozzini.cli.main import main
from bozzini.cli.task import make_command
from bozzini.cockpit.forms import fill_form, list_forms, list_words
from bozzini.errors import InputError
from bozzini.results import ReasonedResult, measured
from bozzini.study import Study
from bozzini.study.tasks import TASKS, TaskJob
from bozzini.task import Task
from bozzini.vision import LengthOptions, StripBoard, plan_setup
from bozzini.vision.planning import SetupPlanning
from docs.made_pages import format_commands

MODULE = '''
import math
from dataclasses import dataclass

from bozzini.checks import quantity
from bozzini.results import ClosedForm, measured
from bozzini.task import Task


@dataclass(frozen=True)
class Chord(ClosedForm):
    """What an arc spans."""

    chord: float = measured("mm")
    rise: float = measured("mm")


@dataclass(frozen=True, kw_only=True)
class ArcTask(Task):
    """Find the chord of an arc, and how far it rises above that."""

    name = "arc"
    result = Chord

    length: float = quantity("length", "Of the arc.", low=0.0, low_open=True, high=1e3)
    bend: float = quantity("angle", "Of the arc.", low=1e-3, high=math.pi, default=1.0)

    def run(self, progress=None):
        """Return the chord."""
        radius, half = self.length / self.bend, 0.5 * self.bend
        return Chord(2.0 * radius * math.sin(half), radius * (1.0 - math.cos(half)))
'''
STUDY = """
format: bozzini-study-1
job: arc
fixed: {length: 1 cm}
factors: {bend: {range: [0.1 rad, 3 rad]}}
sampling: {method: grid}
"""


@pytest.fixture
def arc(tmp_path, monkeypatch):
    """Install a package with a task of two inputs and two results, and return that."""
    folder = tmp_path / "site"
    (folder / "arcs-1.0.dist-info").mkdir(parents=True)
    (folder / "arcs.py").write_text(MODULE, encoding="utf-8")
    for name, text in (
        ("METADATA", "Metadata-Version: 2.1\nName: arcs\nVersion: 1.0\n"),
        ("entry_points.txt", "[bozzini.tasks]\narc = arcs:ArcTask\n"),
    ):
        (folder / "arcs-1.0.dist-info" / name).write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(folder), *sys.path]))
    monkeypatch.chdir(tmp_path)
    TASKS.__dict__.pop("plugins", None)
    yield importlib.import_module("arcs").ArcTask
    TASKS.__dict__.pop("plugins", None)
    sys.modules.pop("arcs")


def test_command(arc, capsys) -> None:
    assert main(["arc", "--length", "1cm", "--bend", "180deg", "--json", "--out", "a.csv"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["inputs"] == {"length_mm": 10.0, "bend_rad": np.pi}
    assert answer["chord_mm"] == pytest.approx(2.0 * answer["rise_mm"])
    with open("a.csv", encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert float(row["chord_mm"]) == pytest.approx(answer["chord_mm"])
    assert arc(length=10.0, bend=np.pi).run().to_frame()["rise_mm"][0] == answer["rise_mm"]
    assert main(["--help"]) == 0
    assert "A task of arcs:ArcTask" in capsys.readouterr().out
    assert main(["arc", "--length", "10mm"]) == 0
    assert capsys.readouterr().out.splitlines()[0].startswith("chord 9.58")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--length", "2m"], "length is 2000 mm: it must lie in (0, 1000] mm (2m was given"),
        ([], "Missing option '--length'"),
        (["--length", "1mm", "--out", "a.png"], "a.png"),
    ],
)
def test_bad_input_is_one_line(arc, capsys, arguments, said) -> None:
    assert main(["arc", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_schema_and_template(arc, capsys) -> None:
    assert main(["schema", "arc"]) == 0
    check = Draft202012Validator(json.loads(capsys.readouterr().out))
    assert check.is_valid({"length": "1 cm", "bend": 2.0})
    assert not check.is_valid({"length": "1 cm", "width": 2.0})
    assert not check.is_valid({"bend": 4.0})
    assert main(["new", "arc"]) == 0
    template = open("task.yaml", encoding="utf-8").read()
    assert "mm, in (0, 1000]" in template
    # All of it is remarks: no options.
    capsys.readouterr()
    assert main(["arc", "--options", "task.yaml", "--length", "1cm", "--json"]) == 0
    with open("task.yaml", "w", encoding="utf-8") as file:
        file.write(template.replace("#length: needed", "length: 1 cm"))
    capsys.readouterr()
    assert main(["arc", "--options", "task.yaml", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["inputs"]["length_mm"] == 10.0


def test_study(arc, tmp_path, capsys) -> None:
    (tmp_path / "study.yaml").write_text(STUDY, encoding="utf-8")
    study = Study.load(tmp_path / "study.yaml")
    assert study.columns == {"bend": "bend_rad", "chord": "chord_mm", "rise": "rise_mm"}
    drawn = study.draw(0, study.rows)
    rows = study.compute(drawn)
    expected = [arc(length=10.0, bend=bend).run().chord for bend in drawn["bend"]]
    assert rows.outputs["chord"] == pytest.approx(expected)
    before = study.key
    (tmp_path / "site" / "arcs.py").write_text(MODULE.replace("2.0 *", "2 *"), encoding="utf-8")
    assert Study.load(tmp_path / "study.yaml").key != before
    assert main(["study", "jobs"]) == 0
    assert "arcs:ArcTask" in capsys.readouterr().out


def test_form(arc) -> None:
    (form,) = (form for form in list_forms() if form["name"] == "arc")
    assert [field["needed"] for field in form["fields"]] == [True, False]
    words = list_words("arc", {"length": "1cm", "bend": "", "width": "3"})
    assert words == ["arc", "--length=1cm"]
    found = asyncio.run(fill_form("arc", {"length": "1cm"}))
    assert found["command"] == "bozzini arc --length=1cm"
    assert found["answer"]["chord_mm"] == pytest.approx(arc(length=10.0).run().chord)
    for name, length, said in (("arc", "-1mm", "length is -1 mm"), ("none", "", "no task")):
        refused = asyncio.run(fill_form(name, {"length": length}))["answer"]
        assert said in refused["error"]["message"]


def test_a_form_answers_whatever_is_filled_in(arc, tmp_path, capfd) -> None:
    asked = [{"length": "1cm\0"}, {"length": "x" * 200_000}, {"length": "--help"}]
    for values in asked:
        found = asyncio.run(fill_form("arc", values))["answer"]
        assert "length" in found["error"]["message"]
    (tmp_path / "site" / "arcs.py").write_text(
        MODULE.replace("radius, half =", "print('so')\n        radius, half ="), encoding="utf-8"
    )
    found = asyncio.run(fill_form("arc", {"length": "1cm"}))["answer"]
    assert found["error"]["message"] == "the command wrote something else than its answer"


def test_a_form_that_takes_too_long_is_ended(arc, monkeypatch) -> None:
    monkeypatch.setattr("bozzini.cockpit.forms.TIME_LIMIT", 0.01)
    found = asyncio.run(fill_form("arc", {"length": "1cm"}))["answer"]
    assert "the command was ended after" in found["error"]["message"]


def test_a_task_that_is_named_like_a_command_is_told(arc, tmp_path, capsys) -> None:
    points = "[bozzini.tasks]\nplan = arcs:ArcTask\n"
    (tmp_path / "site/arcs-1.0.dist-info/entry_points.txt").write_text(points, encoding="utf-8")
    assert main(["--help"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "The task of arcs:ArcTask is left out, as a command of Bozzini is called 'plan'" in said


def test_a_task_that_cannot_be_a_command_is_refused_alone(arc, tmp_path) -> None:
    points = "[bozzini.tasks]\narc = arcs:ArcTask\nbow = arcs:ArcTask\nno = none:No\n"
    points += "routing = ways:RoutingTask\n"
    ways = MODULE.replace('"arc"', '"routing"').replace("ArcTask", "RoutingTask")
    (tmp_path / "site/ways.py").write_text(ways, encoding="utf-8")
    (tmp_path / "site/arcs-1.0.dist-info/entry_points.txt").write_text(points, encoding="utf-8")
    TASKS.__dict__.pop("plugins", None)
    assert {"arc", "vision-plan-setup"} <= {form["name"] for form in list_forms()}
    for name, said in (
        ("bow", "its command is 'arc'"),
        ("no", "cannot be imported"),
        ("routing", "a job of studies has that name"),
    ):
        assert said in asyncio.run(fill_form(name, {}))["answer"]["error"]["message"]
    assert main(["bow", "--length", "1cm"]) == 2


@dataclass(frozen=True)
class Found(ReasonedResult):
    share: float = measured("")
    width: float | None = measured("mm")
    reason: str = ""
    residual: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Odd(Task):
    """Take what is odd."""

    name = "odd"
    result = Found

    share: float = quantity(default=2.0 / 3.0, low=0.0, high=2.0 / 3.0)
    count: int = quantity(default=3, whole=True)
    kind: str | None = quantity("text", default=None, words=("a", "b"), example="b")

    def run(self, progress=None):
        return Found(self.share, None)


def test_defaults_of_a_command_are_those_of_the_task(capsys) -> None:
    command = make_command(Odd)
    for arguments in (["--json"], ["--json", "--count", "-7"]):
        command.main(arguments, standalone_mode=False)
        assert json.loads(capsys.readouterr().out)["share"] == 2.0 / 3.0
    command.main(["--help"], standalone_mode=False)
    assert "0.666667" in capsys.readouterr().out
    with pytest.raises(
        InputError, match=r"count is 2.5: it must be a whole number in \[-inf, inf\]"
    ):
        Odd(count=2.5)


def test_an_output_that_is_no_number_is_not_known_and_one_called_like_an_input_is_left_out() -> (
    None
):
    job = TaskJob.of(Odd)({})
    assert job.outputs == {"width": "mm"}
    rows = job.run({"share": np.array([0.1, 0.2])})
    assert np.isnan(rows.outputs["width"]).all() and not rows.code.any()


def test_a_form_proposes_the_default_word_and_not_the_example(monkeypatch) -> None:
    monkeypatch.setitem(TASKS.own, "odd", Odd)
    (form,) = (form for form in list_forms() if form["name"] == "odd")
    assert form["fields"][2]["shown"] == ""


@pytest.mark.parametrize(
    ("field", "said"),
    [
        (("force", float, quantity("force", default=1.0)), "the input 'force': every command"),
        (("pull", float, quantity("force", default=1.0, option="out")), "every command has one"),
        (("on", bool, quantity("flag", default=True)), "'on': it must be false by default"),
    ],
)
def test_inputs_that_can_be_no_options_are_refused(field, said) -> None:
    kind = make_dataclass("Bad", [field], bases=(Task,), frozen=True, kw_only=True)
    with pytest.raises(TypeError, match=said):
        kind.list_fields()


def test_page(arc) -> None:
    page = format_commands()
    assert "## bozzini arc" in page
    assert "Find the chord of an arc" in page


def test_a_study_varies_an_input_that_the_result_repeats() -> None:
    given = {"away": 250.0, "height": 2.8, "diameter": 1.6, "ring": 2.0}
    job = TaskJob.of(SetupPlanning)(given)
    assert "length" not in job.outputs
    rows = job.run({"length": np.array([30.0, 60.0])})
    task = SetupPlanning.from_inputs({**given, "length": 60.0})
    assert rows.outputs["uncertainty"][1] == task.run().uncertainty


def test_parts_of_a_task_are_inputs_of_its_command_and_study() -> None:
    given = {"away": 250.0, "height": 2.8, "diameter": 1.6, "ring": 2.0, "length": 30.0}
    task = SetupPlanning.from_inputs(given)
    assert task.inputs.items() >= {f"{name}_mm": value for name, value in given.items()}.items()
    options = LengthOptions(height=2.8, diameter=1.6, ring=2.0)
    direct = plan_setup(replace(task.setup), StripBoard(), options=options, length=30.0)
    assert task.run().uncertainty == direct.uncertainty
    with pytest.raises(InputError, match="away is 1"):
        SetupPlanning.from_inputs({**given, "away": 1.0})

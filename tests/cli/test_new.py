"""``bozzini new``: every file runs as it is, and every line at rest is one that can be set."""

from __future__ import annotations

import html
import json
import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bozzini import Plan
from bozzini.checks import Quantity, list_quantities
from bozzini.cli._tract_options import list_plan_options
from bozzini.cli.main import main
from bozzini.continuum import ContinuumRobot, Section, Tendon
from bozzini.muscle import EndEffects, Muscle, preset, read_muscle
from bozzini.physics.manoeuvre import Manoeuvre, Step
from bozzini.study import Study
from tests.cli.plan_cases import CURVE, SCOPE, Tracts

KINDS = ("plan", "muscle", "robot", "study", "manoeuvre")
AT_REST = re.compile(r"^( *)#(?=[\w.]+:)", re.M)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def ask(capsys: pytest.CaptureFixture[str]) -> Callable[..., Any]:
    def call(*words: object, code: int = 0) -> Any:
        capsys.readouterr()
        assert main([*map(str, words), "--json"]) == code
        return json.loads(capsys.readouterr().out)

    return call


@pytest.fixture
def refuse(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Return what runs a command that is refused, and gives its line."""

    def call(*words: object) -> str:
        capsys.readouterr()
        before = sorted(Path().rglob("*"))
        assert main([*map(str, words)]) == 2
        out, err = capsys.readouterr()
        assert out == "" and err.count("\n") == 1 and err.startswith("bozzini: error: ")
        assert sorted(Path().rglob("*")) == before
        return err

    return call


def test_a_new_robot_runs_at_once(ask: Callable[..., Any], refuse: Callable[..., str]) -> None:
    assert ask("new", "robot")["tendons"] == 6
    said = ask("continuum", "pose", "robot.yaml", "--displacement", "T1=2mm")
    assert said["converged"] and said["tendons"]["T1"]["displacement_mm"] == 2.0
    for tendons in (1, 5):
        ask("new", "robot", "--sections", 3, "--tendons", tendons, "--out", f"{tendons}.yaml")
        robot = ContinuumRobot.from_yaml(f"{tendons}.yaml")
        assert len(robot.sections) == 3 and len(robot.tendons) == 3 * tendons
    assert "robot.yaml" in refuse("new", "robot")
    line = refuse("new", "robot", "--sections", 0, "--out", "none.yaml")
    assert line == "bozzini: error: sections is 0: it must lie in [1, 20]\n"


def test_the_comment_on_the_offset_of_a_tendon_is_what_is_checked(
    ask: Callable[..., Any], refuse: Callable[..., str]
) -> None:
    ask("new", "robot", "--sections", 1, "--tendons", 1)
    text = Path("robot.yaml").read_text(encoding="utf-8")
    assert "; at most the radius." in text
    radius = re.search(r"radius: (\S+) mm", text)
    assert radius is not None
    for factor in (1.0, 1.001):
        offset = float(radius[1]) * factor
        Path("robot.yaml").write_text(
            re.sub(r"offset: [\d.]+ mm", f"offset: {offset} mm", text), encoding="utf-8"
        )
        if factor == 1.0:
            assert ask("continuum", "pose", "robot.yaml", "--displacement", "T1=1mm")["converged"]
        else:
            assert f"(0, {radius[1]}] mm" in refuse("continuum", "pose", "robot.yaml")


def test_a_new_muscle_is_the_preset_that_it_begins_with(ask: Callable[..., Any]) -> None:
    ask("new", "muscle")
    assert read_muscle("muscle.yaml").muscle == preset("effector-45")
    given = ("--pressure", "300kPa", "--load", "1N")
    found = ask("muscle", "solve", "--muscle", "muscle.yaml", *given)
    same = ask("muscle", "solve", "--preset", "effector-45", *given)
    assert found["contraction_mm"] == pytest.approx(same["contraction_mm"], rel=1e-9)


def test_a_new_study_runs_at_once(ask: Callable[..., Any]) -> None:
    ask("new", "study")
    found = ask("study", "run", "study.yaml", "--out", "results", "--workers", 1)
    assert found["done"] == found["rows"] == Study.load("study.yaml").rows
    assert 0 < found["feasible"] < found["rows"]  # the constraint is neither idle nor hopeless


def test_a_new_plan_runs_at_once_and_the_command_line_goes_before(
    ask: Callable[..., Any], tracts: Tracts
) -> None:
    ask("new", "plan")
    wide = ["--options", "plan.yaml", "--head-step", "1mm", "--link", "8mm"]
    found = ask("plan", tracts.volume, *wide, "--out", "found", "--quiet")
    assert found["fits"] and found["scope"] == {"diameter_mm": 9.0, "link_length_mm": 8.0}
    assert found["head_step_mm"] == 1.0


@pytest.mark.slow
def test_options_of_a_file_are_those_of_the_command_line(
    ask: Callable[..., Any], tracts: Tracts
) -> None:
    words = dict(zip(SCOPE[::2], SCOPE[1::2], strict=True))
    middle = (CURVE[len(CURVE) // 2] - CURVE.min(axis=0) + 12.0).round(3).tolist()
    typed = ["--via", ",".join(map(str, middle)), "--labels", "1,2", "--reverse"]
    Path("deep").mkdir()
    Path("deep", "plan.json").write_text(
        json.dumps(
            {name[2:].replace("-", "_"): value for name, value in words.items()}
            | {"via": [middle], "labels": [1, 2], "reverse": True}
        ),
        encoding="utf-8",
    )
    ask("plan", tracts.halves, *SCOPE, *typed, "--out", "typed", "--quiet")
    ask("plan", tracts.halves, "--options", "deep/plan.json", "--out", "read", "--quiet")
    first, second = (Plan.load(Path(name, "plan.npz")) for name in ("typed", "read"))
    np.testing.assert_array_equal(first.joints, second.joints)
    assert first.input == second.input


@pytest.mark.slow
def test_the_command_in_a_plan_makes_it_again_at_another_place(
    ask: Callable[..., Any], tracts: Tracts, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = {"head_step": "2 mm", "link": 8, "reverse": True, "diameter": "7 mm"}
    Path("mine.json").write_text(json.dumps(options), encoding="utf-8")
    said = ask(
        "plan", tracts.volume, "--options=mine.json", "--diameter=6 mm", "--organ", "colon",
        "--out", "first", "--quiet", "--force",
    )  # fmt: skip
    first = Plan.load("first/plan.npz")
    assert said["command"] == first.more["command"]
    assert "8" in said["command"] and "mine.json" not in said["command"]
    assert said["command"] in html.unescape(Path("first/report.html").read_text("utf-8"))
    Path("else").mkdir()
    shutil.copy(tracts.volume, "else")
    monkeypatch.chdir("else")
    ask(*shlex.split(said["command"])[1:], "--quiet")
    again = Plan.load("bozzini-plan/plan.npz")
    np.testing.assert_array_equal(again.joints, first.joints)
    assert again.input == first.input and again.more == first.more


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("diamter: 5 mm", "there is no option 'diamter'"),
        ("diameter: {of: 5}", "diameter is {'of': 5}: it must be a number or text"),
        ("diameter:", "diameter is None: it must be a number or text"),
        ("repair: maybe", "repair is 'maybe': it must be true or false"),
        ("out: elsewhere", "there is no option 'out'"),
        ("[1, 2]", "is [1, 2]: it must hold options by name"),
        ("diameter: 5 kg", "'5 kg' has the wrong kind of unit"),
        ("method: none", "'none' is not one of"),
        ("head_step: 1 km", "head step is 1e+06 mm: it must lie in"),
        ("diameter: [", "not YAML in line"),
        ("diameter: 1\ndiameter: 2", "given twice"),
    ],
)
def test_a_wrong_file_of_options_is_one_line(
    text: str, words: str, refuse: Callable[..., str], tracts: Tracts
) -> None:
    Path("plan.yaml").write_text(text, encoding="utf-8")
    assert words in refuse("plan", tracts.volume, "--options", "plan.yaml")
    assert "nowhere.yaml" in refuse("plan", tracts.volume, "--options", "nowhere.yaml")


def _set_each(kind: str) -> list[str]:
    """Return the file once for each line at rest, with that line set."""
    text = Path(f"{kind}.yaml").read_text(encoding="utf-8")
    found = list(AT_REST.finditer(text))
    return [text[: rest.start()] + rest[1] + text[rest.end() :] for rest in found]


@pytest.mark.parametrize("kind", KINDS)
def test_every_line_at_rest_can_be_set(
    kind: str, ask: Callable[..., Any], refuse: Callable[..., str]
) -> None:
    ask("new", "robot")
    if kind != "robot":
        ask("new", kind)
    texts = _set_each(kind)
    assert len(texts) >= 2
    for text in texts:
        Path("set.yaml").write_text(text, encoding="utf-8")
        if kind == "plan":  # all of it is read before the tract is looked for
            assert "nowhere.nii" in refuse("plan", "nowhere.nii", "--options", "set.yaml")
        else:
            {
                "muscle": read_muscle,
                "robot": ContinuumRobot.from_yaml,
                "study": Study.load,
                "manoeuvre": Manoeuvre.load,
            }[kind]("set.yaml")


def _list_known(kind: str) -> dict[str, tuple[Quantity, object]]:
    """Return what the fields of a template are known by, and what limits depend on."""
    if kind == "plan":
        return {name: (known, None) for name, (known, _) in list_plan_options().items()}
    if kind == "muscle":
        muscle = preset("effector-45")
        fields = {name: (known, muscle) for name, known in list_quantities(Muscle).items()}
        return fields | {name: (item, None) for name, item in list_quantities(EndEffects).items()}
    if kind == "manoeuvre":
        return {name: (known, None) for name, known in list_quantities(Step).items()}
    if kind == "study":
        return {name: (known, None) for name, known in Study.load("study.yaml").inputs.items()}
    fields = {**list_quantities(Section), **list_quantities(Tendon)}
    left_out = ("disc_positions", "end", "path")
    return {name: (item, None) for name, item in fields.items() if name not in left_out}


@pytest.mark.parametrize("kind", KINDS)
def test_a_comment_names_unit_and_range_of_every_field(kind: str, ask: Callable[..., Any]) -> None:
    ask("new", kind)
    lines = Path(f"{kind}.yaml").read_text(encoding="utf-8").splitlines()
    text = " ".join(line.strip(" #") for line in lines)
    for name, (known, item) in _list_known(kind).items():
        told = known.describe(item).partition("; ")[2] or known.describe(item)
        assert f"{name}:" in text and told in text, name
        assert known.unit in ("", "rad") or known.unit in told


def test_a_range_in_words_is_the_one_that_is_checked() -> None:
    for known in (*list_quantities(Muscle).values(), *list_quantities(Section).values()):
        words = re.search(
            r"in [\[(]([\d.e+-]+), ([\d.e+-]+)\]", known.describe(preset("effector-45"))
        )
        if words is None or known.whole:
            continue
        low, high = (float(words[k]) for k in (1, 2))
        scale = np.pi / 180.0 if known.kind == "angle" else 1.0
        muscle, near = preset("effector-45"), 1e-3 * (high - low)
        for end, inwards in ((low, near), (high, -near)):
            assert known.is_legal((end + inwards) * scale, muscle)
            assert not known.is_legal((end - inwards) * scale, muscle)

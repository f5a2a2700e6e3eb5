"""``bozzini plan --robot``: a tendon robot goes the way, or one line says why it does not."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.motion.actuate import Actuation
from tests.cli.plan_cases import Run, Tracts, list_all
from tests.cli.test_show import read_view
from tests.motion.actuate.motions import make_robot

FAST = ["--head-step", "1mm", "--quiet"]
EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "gastroscope.yaml"


def write_robot(folder: Path, *given: float, **options: float) -> Path:
    return make_robot(*given, **options).to_yaml(folder / "robot.yaml")


def test_a_robot_goes_the_way(run: Run, tracts: Tracts, tmp_path: Path) -> None:
    robot = write_robot(tmp_path, 15.0, 7, radius=2.5)
    found = run(tracts.volume, "--robot", robot, *FAST, "--out", tmp_path / "out")
    assert found.code == 0, found.err
    assert "Robot 'arm' gets there; proved to keep" in found.out
    summary = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))
    # What is not given is the robot's own.
    assert summary["scope"] == {"diameter_mm": 5.0, "link_length_mm": 7.5}
    assert summary["robot"]["certified"] and summary["robot"]["name"] == "arm"
    assert summary["robot"]["certificate"]["clearance_mm"] > 0.0
    table = (tmp_path / "out" / "tendons.csv").open(encoding="utf-8", newline="")
    with table as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == summary["steps"]
    assert {"s0a_mm", "s6c_mm", "base_advance_mm"} <= rows[0].keys()
    largest = max(abs(float(row["s6c_mm"])) for row in rows)
    told = summary["robot"]["tendons"]["s6c"]
    assert largest == max(-told["min_mm"], told["max_mm"])
    # 'bozzini show' shows that motion beside the scope's, in the tract.
    made, page = tmp_path / "out", tmp_path / "page.html"
    files = [made / "robot.npz", made / "plan.npz", tracts.volume]
    assert main(["show", *map(str, files), "--out", str(page), "--quiet"]) == 0
    bodies = {item["name"]: item for item in read_view(page)["bodies"]}
    moved = Actuation.load(made / "robot.npz")
    tips = moved.place_body(range(moved.steps))[:, 0]
    np.testing.assert_allclose(bodies["arm"]["joints"][:, 0], tips, atol=0.02)
    assert bodies["scope"]["joints"].shape[0] == summary["steps"]


def test_a_robot_that_does_not_get_there_exits_with_1(
    run: Run, tracts: Tracts, tmp_path: Path
) -> None:
    robot = write_robot(tmp_path, 15.0, 7, radius=2.5, max_bend=0.2)
    found = run(tracts.volume, "--robot", robot, *FAST, "--json", "--out", tmp_path / "out")
    assert found.code == 1
    assert found.result["robot"]["reason_code"] == "BEND_LIMIT"
    assert found.result["fits"] is False and found.result["certified"] is True
    assert "does not get there: section" in found.err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sections: [{length: 10 mm}]", "sections[0] has no 'radius'"),
        ("sections: [{length: 10 mm, radius: 3 mm}]", "has no tendons"),
        ("sections: 4", "sections is 4"),
    ],
)
def test_a_wrong_robot_is_one_line(
    run: Run, tracts: Tracts, tmp_path: Path, text: str, words: str
) -> None:
    (tmp_path / "robot.yaml").write_text(text)
    before = list_all(tmp_path)
    found = run(tracts.volume, "--robot", tmp_path / "robot.yaml", *FAST, "--out", tmp_path / "out")
    assert found.code == 2
    assert words in found.err and len(found.err.splitlines()) == 1
    assert list_all(tmp_path) == before


def test_a_missing_robot_is_one_line(run: Run, tracts: Tracts, tmp_path: Path) -> None:
    found = run(tracts.volume, "--robot", tmp_path / "none.yaml", "--out", tmp_path / "out")
    assert found.code == 2
    assert "none.yaml" in found.err and len(found.err.splitlines()) == 1


@pytest.mark.slow
def test_the_example_goes_through_the_phantom(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    options = ["--voxel", "4mm", "--diameter", "5mm", "--quiet", "--json", "--out", str(out)]
    code = main(["demo", "--robot", str(EXAMPLE), *options])
    told = json.loads(capsys.readouterr().out)["robot"]
    assert told["sections"] == 17 and len(told["tendons"]) == 51
    assert code == (0 if told["fits"] else 1)
    assert told["fits"] or told["reason"]
    assert (out / "tendons.csv").exists()

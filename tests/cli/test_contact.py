"""The commands ``continuum contact`` and ``continuum insert``."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bozzini.cli.main import main
from bozzini.continuum import ContinuumRobot, RobotDesign, Section, Tendon
from bozzini.duct import RoundCones, save
from bozzini.motion.actuate import Actuation
from bozzini.motion.actuate.executed import ArcCertificate

LINE = np.array([[0.0, 0.0, -20.0], [0.0, 0.0, 60.0]])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    tendons = tuple(
        Tendon(name=f"T{k}", offset=2.0, angle=k * np.pi / 2.0, stiffness=5000.0) for k in range(4)
    )
    section = Section(length=40.0, radius=3.0, tendons=tendons, bending_stiffness=300.0)
    RobotDesign((section,)).to_yaml("robot.yaml")
    save(RoundCones(LINE, np.array([5.0, 5.0])), "tube.yaml")
    return tmp_path


def test_contact_gives_the_forces_as_json_and_as_a_table(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("contact", "robot.yaml", "tube.yaml", "--tip-force", "0.2N,0N,0N")
    assert main(["continuum", *words, "--json", "--out", "forces.csv"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["converged"] and found["contacts"]
    # The gap of 2 mm takes 3 EI g / L^3 of the force.
    wanted = 0.2 - 3.0 * 300.0 * 2.0 / 40.0**3
    assert found["resultant_N"][0] == pytest.approx(-wanted, rel=0.01)
    rows = (folder / "forces.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0].startswith("arc_length_mm,x_mm,y_mm,z_mm,gap_mm,normal_force_N")
    assert len(rows) == len(found["arc_length_mm"]) + 1


def test_contact_converts_the_commands_of_a_calibrated_robot(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = Path("robot.yaml").read_text(encoding="utf-8")
    Path("fitted.yaml").write_text(
        f"{text}calibration: {{zeros: {{T0: 0.5}}, scale: 2}}\n", encoding="utf-8"
    )
    tips = []
    for file, pulled in (("fitted.yaml", "T0=0.25mm"), ("robot.yaml", "T0=1mm")):
        words = ("contact", file, "tube.yaml", "--displacement", pulled, "--json")
        assert main(["continuum", *words]) == 0
        tips.append(json.loads(capsys.readouterr().out)["tip_mm"])
    assert tips[0] == pytest.approx(tips[1], abs=1e-9)


@pytest.mark.parametrize("words", [("contact",), ("insert", "--to", "10mm")])
def test_the_friction_of_tendons_is_said_to_be_left_out(
    folder: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    robot = ContinuumRobot.from_yaml("robot.yaml")
    section = robot.sections[0]
    tendons = tuple(dataclasses.replace(tendon, friction=0.2) for tendon in section.tendons)
    RobotDesign((dataclasses.replace(section, tendons=tendons),)).to_yaml("rough.yaml")
    for file, noted in (("rough.yaml", True), ("robot.yaml", False)):
        command = ["continuum", words[0], file, "tube.yaml", *words[1:], "--quiet"]
        assert main(command) == 0
        said = "note: among walls the friction of tendons is left out"
        assert (said in capsys.readouterr().out) == noted


def test_loads_are_those_of_pose(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def ask(*words: str) -> dict[str, Any]:
        assert main(["continuum", *words, "--json"]) == 0
        return dict(json.loads(capsys.readouterr().out))

    tube = ("contact", "robot.yaml", "tube.yaml")
    force = ask(*tube, "--tip-force", "0.2N,0N,0N")
    load = ask(*tube, "--load", "force=0.2N:0:0,frame=world")
    assert load["points_mm"] == force["points_mm"]
    parts = ask(*tube, "--load", "force=0.1N:0:0", "--load", "line=2.5N/m:0:0")
    assert parts["loads_N"] == pytest.approx([0.2, 0.0, 0.0])
    # Where it touches nothing it is the shape of pose.
    light = ("--load", "at=30mm,force=0:5mN:0,moment=0.1N mm:0:0,frame=body")
    among, alone = ask(*tube, *light), ask("pose", "robot.yaml", *light, "--model", "rod")
    assert among["contacts"] == []
    assert among["tip_mm"] == pytest.approx(alone["tip_mm"], abs=0.02)
    insert = ("insert", "robot.yaml", "tube.yaml", "--to", "30mm", "--step", "10mm")
    pushed = ask(*insert, "--load", "force=0:0:-0.1N")
    assert pushed["push_force_N"][-1] == pytest.approx(0.1, rel=1e-3)
    assert abs(ask(*insert)["push_force_N"][-1]) < 1e-3


def test_a_shape_that_is_refused_names_the_options_to_type(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save(RoundCones(np.array([[1.0, -20.0, 5.0], [1.0, 20.0, 5.0]]), np.full(2, 0.1)), "wire.yaml")
    words = ["contact", "robot.yaml", "--obstacle", "wire.yaml", "--segment-length", "10mm"]
    said = "take a smaller --segment-length or --smoothing"
    assert main(["continuum", *words, "--out", "forces.csv"]) == 1
    assert said in capsys.readouterr().out
    assert main(["continuum", *words, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["reason"].endswith(said)
    assert not Path("forces.csv").exists()


def test_insert_writes_force_and_contacts(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("insert", "robot.yaml", "tube.yaml", "--to", "30mm", "--step", "10mm")
    files = ("--out", "force.csv", "--contacts", "contacts.csv", "--quiet")
    assert main(["continuum", *words, *files]) == 0
    assert "inserted 30.0 mm" in capsys.readouterr().out
    assert (folder / "force.csv").read_text(encoding="utf-8").startswith("inserted_mm,push_force_N")
    assert (
        (folder / "contacts.csv")
        .read_text(encoding="utf-8")
        .startswith("inserted_mm,arc_length_mm")
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("contact", "robot.yaml"), "contact needs a wall: give INPUT, or --obstacle"),
        (
            ("contact", "robot.yaml", "tube.yaml", "--tension", "T9=1N"),
            "--tension names 'T9': the tendons of robot 'robot' are T0, T1, T2, T3",
        ),
        (
            (
                "contact",
                "robot.yaml",
                "tube.yaml",
                "--displacement",
                "T1=1mm",
                "--tension",
                "T1=1N",
            ),
            "contact takes --displacement or --tension: give one of them",
        ),
        (("insert", "robot.yaml", "tube.yaml", "--to", "90mm"), "must be at most 40 mm"),
        (("contact", "robot.yaml", "tube.yaml", "--labels", "1"), "has no labels to select"),
        (("insert", "robot.yaml", "tube.yaml", "--repair"), "--repair has no effect on a file"),
        (
            ("insert", "robot.yaml", "tube.yaml", "--friction", "3"),
            "friction is 3: it must lie in [0, 2]",
        ),
    ],
)
def test_wrong_input_is_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    assert main(["continuum", *words, "--quiet"]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert sorted(path.name for path in folder.iterdir()) == ["robot.yaml", "tube.yaml"]


def test_insert_stands_where_the_plan_of_the_drives_does(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = ContinuumRobot.from_yaml("robot.yaml")
    frame = np.eye(4)
    frame[:3, :3] = Rotation.from_rotvec([0.0, 0.03, 0.4]).as_matrix()
    frame[:3, 3] = 0.1, 0.0, -20.0
    Path("plan").mkdir()
    Path("plan/tendons.csv").write_text(
        "base_advance_mm,T0_mm,T1_mm,T2_mm,T3_mm\n0,0,0,0,0\n5,0,0,0,0\n15,0,0,0,0\n",
        encoding="utf-8",
    )
    words = ("insert", "robot.yaml", "tube.yaml", "--drives", "plan/tendons.csv", "--json")
    assert main(["continuum", *words]) == 0
    along_tube = json.loads(capsys.readouterr().out)["last"]
    np.testing.assert_allclose(along_tube["tangents"][0], [0.0, 0.0, 1.0], atol=1e-9)
    certificate = ArcCertificate(
        step=0.0,
        section=0,
        arc_length=0.0,
        place=np.zeros(3),
        deviation=0.0,
        resolved=True,
        chords=1,
        instants=1,
        evaluations=1,
        wall="",
    )
    Actuation(
        robot=robot,
        head_arc_length=np.array([0.0, 15.0]),
        base_advance=np.array([0.0, 15.0]),
        bends=np.zeros((2, 1, 2)),
        displacements=np.zeros((2, 4)),
        fit_rms=np.zeros(2),
        fit_max=np.zeros(2),
        clearance=np.zeros(2),
        frame=frame,
        certificate=certificate,
        status="complete",
    ).save("plan/robot.npz")
    assert main(["continuum", *words]) == 0
    placed = json.loads(capsys.readouterr().out)["last"]
    np.testing.assert_allclose(placed["tangents"][0], frame[:3, 2], atol=1e-9)


def test_nothing_is_left_of_an_insertion_that_is_stopped(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("bozzini.continuum.insert_robot", stop)
    words = ("insert", "robot.yaml", "tube.yaml", "--out", "force.csv", "--contacts", "all.csv")
    assert main(["continuum", *words, "--quiet"]) == 130
    assert sorted(path.name for path in folder.iterdir()) == ["robot.yaml", "tube.yaml"]

"""``bozzini continuum``: what it prints is what the library says; a bad input is one line."""

from __future__ import annotations

import csv
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.continuum import CONTINUUM_MODELS, ArcModel, ContinuumRobot, EnergyModel, RodModel
from bozzini.continuum.arc import displacements_for
from bozzini.continuum.inverse import solve_tip
from bozzini.continuum.workspace import map_dexterity, sample_workspace

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
TWO, HELICAL, CONVERGING, COLONOSCOPE = (
    EXAMPLES / f"{name}.yaml" for name in ("two_sections", "helical", "converging", "colonoscope")
)
ROBOT = ContinuumRobot.from_yaml(TWO)
BENDS = np.array([[0.4, -0.3], [1.1, 0.7]])
WIRE = ("--tendon-stiffness", "10kN")
SECTION_FIELDS = ("name", "length", "radius", "discs", "disc_positions", "bending_stiffness",
                  "torsional_stiffness", "max_bend", "tendons")  # fmt: skip
TENDON_FIELDS = ("name", "offset", "angle", "end", "pushes", "travel", "interpolation", "friction")
HELIX_FIELDS = ("start", "turns")
PNG = b"\x89PNG"


def spell(robot, displacements, digits=9):
    names = robot.tendon_names
    return ",".join(f"{n}={d:.{digits}f}mm" for n, d in zip(names, displacements, strict=True))


BENT = spell(ROBOT, displacements_for(ROBOT, BENDS))
CLAMPED = "T1=3mm,T2=0mm,T3=0mm,T4=0mm,T5=0mm,T6=0mm"
WOUND = "H1=2mm,H2=-5mm,H3=-5mm,H4=-5mm"


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        capsys.readouterr()
        code = main(["continuum", *map(str, arguments)])
        return code, *capsys.readouterr()

    return call


@pytest.fixture
def ask(run):
    def call(*arguments, code=0):
        got, out, err = run(*arguments, "--json")
        assert (got, err) == (code, "")
        return json.loads(out)

    return call


@pytest.mark.parametrize("name", CONTINUUM_MODELS)
def test_pose_is_the_library(ask, name):
    said = ask("pose", TWO, "--displacement", BENT, "--model", name)
    shape = CONTINUUM_MODELS[name](ROBOT).shape(displacements_for(ROBOT, BENDS))
    assert said["model"] == name
    assert said["converged"] is True
    near = 1e-4 if name in ("energy", "rod") else 1e-6  # these stop within the tolerance
    assert said["tip_mm"] == pytest.approx(shape.tip.tolist(), abs=near)
    assert said["tip_direction"] == pytest.approx(shape.tip_frame[:3, 2].tolist(), abs=near)
    assert said["backbone_mm"][-1] == said["tip_mm"]
    for k, tendon in enumerate(ROBOT.tendon_names):
        row = said["tendons"][tendon]
        assert row["length_mm"] == pytest.approx(shape.tendon_lengths[k], abs=near)
        if name in ("arc", "linkage"):
            assert row["tension_N"] is None
        else:
            assert row["tension_N"] == pytest.approx(shape.tensions[k], abs=1e-4)
    bend = said["sections"][1]
    assert bend["bend_rad"] == pytest.approx(math.hypot(1.1, 0.7), rel=5e-3)
    assert bend["direction_rad"] == pytest.approx(math.atan2(0.7, 1.1), abs=1e-5)


def test_the_model_is_chosen_by_routing_and_loads(ask):
    assert ask("pose", TWO, "--displacement", BENT)["model"] == "arc"
    assert ask("pose", HELICAL, "--displacement", WOUND)["model"] == "energy"
    loaded = ask("pose", TWO, "--displacement", BENT, "--tip-force", "0,20mN,0", *WIRE)
    assert loaded["model"] == "rod"
    rod = RodModel(ROBOT, tip_force=(0.0, 0.02, 0.0), tendon_stiffness=1e4)
    shape = rod.shape(displacements_for(ROBOT, BENDS))
    assert loaded["tip_mm"] == pytest.approx(shape.tip.tolist(), abs=1e-3)
    free = ask("pose", TWO, "--displacement", BENT, "--model", "rod", *WIRE)
    assert loaded["tip_mm"][1] > free["tip_mm"][1] + 1.0


def test_loads_bend_a_loose_robot_as_a_beam(ask):
    # A small load that is spread evenly bends a cantilever as 3/8 of it at the tip does.
    free = ("pose", TWO, "--displacement", "T1=-8mm,T2=-8mm,T3=-8mm,T4=-8mm,T5=-8mm,T6=-8mm")
    stiff = ContinuumRobot.from_yaml(TWO).to_dict()
    for section in stiff["sections"]:
        section["bending_stiffness"] = 300.0
    ContinuumRobot.from_dict(stiff).to_yaml("even.yaml")
    free = ("pose", "even.yaml", *free[2:])
    along = ask(*free, "--line-force", "1e-7N/mm,0,0", *WIRE)["tip_mm"][0]
    tip = ask(*free, "--tip-force", f"{0.375 * 110e-7}N,0,0", *WIRE)["tip_mm"][0]
    assert along == pytest.approx(tip, rel=1e-4)
    assert tip == pytest.approx(0.375 * 110e-7 * 110**3 / 900.0, rel=1e-3)


def test_options_reach_their_model(ask):
    fine, coarse = (
        ask("compare", TWO, "--displacement", BENT, "--segments", n, "--between", m)["models"]
        for n, m in ((40, 3), (10, 0))
    )
    assert coarse["linkage"]["tip_from_rod_mm"] > 10.0 * fine["linkage"]["tip_from_rod_mm"]
    assert coarse["energy"]["tip_from_rod_mm"] > 10.0 * fine["energy"]["tip_from_rod_mm"]
    smooth = ask("pose", TWO, "--displacement", BENT, "--model", "energy",
                 "--segment-kind", "channel")  # fmt: skip
    arc = ask("pose", TWO, "--displacement", BENT)
    assert smooth["tip_mm"] == pytest.approx(arc["tip_mm"], abs=1e-5)


@pytest.mark.parametrize("name", ["arc", "energy", "rod"])
def test_typed_numbers_need_not_be_exact(ask, name):
    bent = displacements_for(ROBOT, BENDS)
    off = 3e-4 * np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0])  # no bend does this
    kind = ("--segment-kind", "channel") if name == "energy" else ()
    command = ("pose", TWO, "--model", name, *kind, "--displacement")
    said = ask(*command, spell(ROBOT, bent + off))
    assert "moved by up to 0.0003 mm, so as to be consistent" in said["notes"][0]
    moved = [row["displacement_mm"] for row in said["tendons"].values()]
    assert moved == pytest.approx(bent.tolist(), abs=1e-8)
    assert said["tip_mm"] == pytest.approx(ArcModel(ROBOT).shape(bent).tip, abs=1e-4)
    assert not any(row["slack"] for row in said["tendons"].values())
    assert ask(*command, spell(ROBOT, bent), "--tolerance", "1nm")["notes"] == []
    assert ask(*command, spell(ROBOT, bent + off), "--tolerance", "1nm", code=1)["reason"]


def test_a_slack_tendon_is_said(ask, run):
    # The tendons of the distal section follow the bend of the proximal one.
    bent = displacements_for(ROBOT, [[0.75, 0.0], [0.0, 0.0]])
    bent[[1, 2]] -= 3.0
    said = ask("pose", TWO, "--displacement", spell(ROBOT, bent))
    assert [name for name, row in said["tendons"].items() if row["slack"]] == ["T2", "T3"]
    _, text, _ = run("pose", TWO, "--displacement", spell(ROBOT, bent))
    assert text.count("slack") == 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([CLAMPED], "tendon 'T1' is pulled 1 mm more than the nearest shape gives way"),
        ([CLAMPED, "--model", "energy"], "tendon 'T1' would have to stretch"),
        ([CLAMPED, "--model", "rod"], "'T1' would have to stretch"),
        (["T1=-9.5mm"], "tendon 'T1' is moved -9.5 mm: its travel is [-9, 9] mm"),
        (["T1=-9.5mm", "--model", "energy"], "its travel is [-9, 9] mm"),
        (["T1=-9.5mm", "--model", "rod"], "its travel is [-9, 9] mm"),
        (
            [spell(ROBOT, displacements_for(ROBOT, [[0.0, 0.0], [3.0, 0.0]])), "--model", "rod"],
            "section 2 'distal' would bend 171.9 deg: its largest bend is 150 deg",
        ),
    ],
)
def test_no_shape_is_said_and_nothing_is_written(run, tmp_path, arguments, said):
    command = ("pose", TWO, "--displacement", *arguments, "--out", "shape.png")
    code, text, err = run(*command)
    assert (code, err) == (1, "")
    assert said in text
    code, out, err = run(*command, "--json")
    told = json.loads(out)
    assert (code, err, told["converged"]) == (1, "", False)
    assert said in told["reason"]
    assert "tip_mm" not in told
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["arc", "energy", "rod"])
def test_discs_that_meet_are_no_shape(ask, name):
    wide = {"sections": [{"length": 20, "radius": 8, "tendons": [
        {"name": f"t{k}", "offset": 4, "angle": k * math.pi / 2} for k in range(4)
    ]}]}  # fmt: skip
    robot = ContinuumRobot.from_dict(wide)
    robot.to_yaml("wide.yaml")
    bends = 2.4, 2.6  # they meet at 2.5 rad
    good, bad = (spell(robot, displacements_for(robot, [[bend, 0.0]])) for bend in bends)
    command = ("pose", "wide.yaml", "--model", name, "--displacement")
    assert ask(*command, good)["converged"] is True
    assert "its discs, of radius 8 mm, meet" in ask(*command, bad, code=1)["reason"]


def test_a_linkage_says_how_many_segments_it_needs(ask):
    robot = ContinuumRobot.from_yaml(COLONOSCOPE)
    bent = spell(robot, displacements_for(robot, [[0.0, 0.0], [0.0, 3.1]]))
    command = ("pose", COLONOSCOPE, "--displacement", bent, "--model", "linkage", "--segments")
    told = ask(*command, 1, code=1)
    assert "section 2 'distal' has 1 segments" in told["reason"]
    assert "at least 2" in told["reason"]
    assert ask(*command, 2)["converged"] is True


def test_bends_without_control_are_noted(ask):
    robot = {"sections": [{"length": 50, "radius": 5, "tendons": [{"name": "a", "offset": 4}]}]}
    ContinuumRobot.from_dict(robot).to_yaml("one.yaml")
    (note,) = ask("pose", "one.yaml", "--displacement", "a=2mm")["notes"]
    assert "in one plane only" in note


def test_reach_comes_back_by_pose(ask):
    said = ask("reach", TWO, "--to", "30mm,1cm,80mm")
    assert said["success"] is True
    assert said["reason"] == ""
    found = solve_tip(ROBOT, [30.0, 10.0, 80.0])
    assert said["tip_mm"] == pytest.approx(found.tip.tolist(), abs=1e-9)
    moved = [said["displacements_mm"][name] for name in ROBOT.tendon_names]
    assert ArcModel(ROBOT).shape(moved).tip == pytest.approx([30.0, 10.0, 80.0], abs=1e-5)
    posed = ask("pose", TWO, "--displacement", spell(ROBOT, moved))
    assert posed["tip_mm"] == pytest.approx([30.0, 10.0, 80.0], abs=1e-5)
    for ours, theirs in zip(said["sections"], posed["sections"], strict=True):
        assert ours["bend_rad"] == pytest.approx(theirs["bend_rad"], abs=1e-6)
        assert ours["direction_rad"] == pytest.approx(theirs["direction_rad"], abs=1e-6)


def test_nothing_is_told_as_minus_nought(run):
    # Bends in the plane of x and z: round-off in y is of either sign.
    for sign in (1.0, -1.0):
        bent = spell(ROBOT, displacements_for(ROBOT, [[0.5 * sign, -1e-9], [-0.3, 1e-9]]))
        for command in (("pose", TWO, "--displacement", bent), ("reach", TWO, "--to", "-0,-0,110")):
            code, text, _ = run(*command)
            assert code == 0
            assert not re.search(r"-0(\.0*)?(?![.\d])", text), text


@pytest.mark.parametrize("scale", ["1e6", "1e-13"])
def test_a_direction_has_any_length(ask, scale):
    said = ask("reach", TWO, "--to", "20mm,0,95mm", "--direction", f"{scale},0,{scale}", code=1)
    same = ask("reach", TWO, "--to", "20mm,0,95mm", "--direction", "1,0,1", code=1)
    assert said["tip_mm"] == pytest.approx(same["tip_mm"], abs=1e-5)
    assert said["angle_rad"] == pytest.approx(same["angle_rad"], abs=1e-5)


def test_reach_with_a_direction(ask):
    frame = ArcModel(ROBOT).shape(displacements_for(ROBOT, BENDS)).tip_frame
    place = ",".join(f"{value:.12f}" for value in frame[:3, 3])
    way = ",".join(f"{5.0 * value:.12f}" for value in frame[:3, 2])
    said = ask("reach", TWO, "--to", place, "--direction", way)
    assert said["success"] is True
    assert said["tip_direction"] == pytest.approx(frame[:3, 2].tolist(), abs=1e-6)
    other = ask("reach", TWO, "--to", place, "--direction", "0,0,-1", code=1)
    assert "2 section(s) have 4 freedoms, the target 5" in other["reason"]


def test_out_of_reach_says_by_how_much(ask, run, tmp_path):
    said = ask("reach", TWO, "--to", "0,0,150mm", "--out", "reach.png", code=1)
    assert said["residual_mm"] == pytest.approx(40.0, abs=1e-5)
    assert "out of reach of a backbone of 110 mm" in said["reason"]
    code, text, err = run("reach", TWO, "--to", "0,0,150mm")
    assert (code, err) == (1, "")
    assert text.startswith("not reached: the target lies 150 mm from the base")
    assert list(tmp_path.iterdir()) == []


def test_one_section_says_which_length_would_reach(ask):
    single = {"sections": [ROBOT.to_dict()["sections"][0]]}
    ContinuumRobot.from_dict(single).to_yaml("single.yaml")
    said = ask("reach", "single.yaml", "--to", "30mm,0,50mm", code=1)
    needed = said["needed_length_mm"]
    assert f"a section of {needed:.6g} mm would reach it" in said["reason"]
    single["sections"][0] |= {"length": needed}
    ContinuumRobot.from_dict(single).to_yaml("single.yaml")
    assert ask("reach", "single.yaml", "--to", "30mm,0,50mm")["success"] is True


def test_smallest_bends_are_smaller(ask):
    command = ("reach", TWO, "--to", "35mm,0,90mm", "--starts", "1")
    sizes = [
        sum(row["bend_rad"] ** 2 for row in ask(*command, *more)["sections"])
        for more in ((), ("--smallest-bends",))
    ]
    assert sizes[1] <= sizes[0]


def test_compare_holds_models_against_the_rod(ask):
    said = ask("compare", TWO, "--displacement", BENT)
    rows = said["models"]
    assert list(rows) == list(CONTINUUM_MODELS)
    assert said["reference"] == "rod"
    assert rows["arc"]["tip_from_rod_mm"] < 1e-4
    assert rows["rod"]["tip_from_rod_mm"] == 0.0
    # Chords with parallel tendons are the linkage.
    assert rows["energy"]["tip_mm"] == pytest.approx(rows["linkage"]["tip_mm"], abs=1e-5)
    assert 1e-3 < rows["linkage"]["tip_from_rod_mm"] < 0.5
    for row in rows.values():
        assert row["time_s"] > 0.0
        aside = np.linalg.norm(np.cross(row["tip_direction"], rows["rod"]["tip_direction"]))
        assert math.sin(row["direction_from_rod_rad"]) == pytest.approx(aside, abs=1e-9)
    ours, theirs = rows["energy"]["tensions_N"], rows["rod"]["tensions_N"]
    assert ours == pytest.approx(theirs, rel=2e-2, abs=1e-3)


def test_compare_names_what_models_refuse(ask, run):
    rows = ask("compare", HELICAL, "--displacement", WOUND)["models"]
    assert [name for name, row in rows.items() if row["refused"]] == ["arc", "linkage"]
    assert "changes its offset or angle" in rows["arc"]["reason"]
    assert rows["energy"]["tip_from_rod_mm"] < 0.1
    assert rows["energy"]["slack"] == rows["rod"]["slack"] == ["H2", "H3", "H4"]
    _, text, _ = run("compare", HELICAL, "--displacement", WOUND)
    assert "arc: refused: tendon 'H1'" in text


def test_compare_without_any_shape_is_a_negative_answer(run):
    code, out, err = run("compare", TWO, "--displacement", CLAMPED, "--out", "no.png", "--json")
    said = json.loads(out)
    assert (code, err) == (1, "")
    assert said["reference"] is None
    assert said["file"] is None
    assert all("T1" in row["reason"] for row in said["models"].values())
    assert not Path("no.png").exists()


def test_compare_gives_loads_to_models_of_forces(ask):
    free, loaded = (
        ask("compare", TWO, "--displacement", BENT, *more)
        for more in ((), ("--tip-force", "0,0.05N,0", *WIRE))
    )
    assert loaded["models"]["arc"]["tip_mm"] == free["models"]["arc"]["tip_mm"]
    assert loaded["models"]["arc"]["tip_from_rod_mm"] > 0.1
    assert "the energy and the rod model bear the load" in loaded["notes"][0]
    assert "tendons stretch" in loaded["notes"][1]


def test_workspace_is_the_library(ask):
    said = ask("workspace", TWO, "--count", 3000, "--seed", 3, "--cell", "8mm")
    sample = sample_workspace(ROBOT, 3000, seed=3)
    assert said["reach_mm"] == pytest.approx(np.linalg.norm(sample.tips, axis=1).max())
    found = map_dexterity(sample, cell=8.0, half_plane=True)
    assert said["map"]["from_axis_mm"] == pytest.approx(found.centres[:, 0].tolist())
    assert said["map"]["direction_share"] == pytest.approx(found.direction_share.tolist())
    assert sum(said["map"]["tips"]) == 3000
    assert said["manipulability_unit"] == "mm^3/rad^3"
    for k, (name, row) in enumerate(said["tendons"].items()):
        assert name == ROBOT.tendon_names[k]
        assert row["low_mm"] == pytest.approx(sample.displacements[:, k].min())
        assert row["allowed_mm"][0] <= row["low_mm"] < row["high_mm"] <= row["allowed_mm"][1]
    assert said["hull_mm3"] > 0.0
    space = ask("workspace", TWO, "--count", 3000, "--seed", 3, "--cell", "8mm", "--in-space")
    assert set(space["map"]) > {"x_mm", "y_mm", "z_mm"}
    assert space["occupied_mm3"] == said["occupied_mm3"]


def test_workspace_says_in_how_many_directions_the_tip_looks(ask, run):
    said = ask("workspace", TWO, "--count", 100, "--at", "30mm,10mm,80mm", "--directions", 20)
    assert said["directions_at"]["share"] == 0.0
    assert "have no area" in said["notes"][0]
    code, text, _ = run("workspace", TWO, "--count", 100, "--at", "30mm,10mm,80mm",
                        "--directions", 20, "--quiet")  # fmt: skip
    assert code == 0
    assert "have no area" in text
    assert "take more shapes or larger cells" in text


@pytest.mark.slow
def test_files(run, tmp_path):
    bent = ("--displacement", BENT)
    assert run("pose", TWO, *bent, "--out", "pose.png")[0] == 0
    assert run("pose", TWO, *bent, "--out", "pose.csv")[0] == 0
    assert run("compare", TWO, *bent, "--out", "compare.png")[0] == 0
    assert run("compare", TWO, *bent, "--out", "compare.csv")[0] == 0
    assert run("reach", TWO, "--to", "30,10,80", "--out", "reach.png")[0] == 0
    assert run("reach", TWO, "--to", "30,10,80", "--out", "reach.csv")[0] == 0
    few = ("workspace", TWO, "--count", 500)
    assert run(*few, "--out", "space.png")[0] == 0
    assert run(*few, "--in-space", "--out", "cubes.svg")[0] == 0
    assert run(*few, "--out", "space.csv")[0] == 0
    for path in tmp_path.glob("*.png"):
        assert path.read_bytes()[:4] == PNG
    line = np.loadtxt(tmp_path / "pose.csv", delimiter=",", skiprows=1)
    assert line[-1, 0] == ROBOT.length
    assert line[-1, 1:4] == pytest.approx(
        ArcModel(ROBOT).shape(displacements_for(ROBOT, BENDS)).tip
    )
    with open("reach.csv", encoding="utf-8", newline="") as file:
        rows = {row["tendon"]: float(row["displacement_mm"]) for row in csv.DictReader(file)}
    assert rows == pytest.approx(dict(zip(ROBOT.tendon_names,
        solve_tip(ROBOT, [30.0, 10.0, 80.0]).displacements, strict=True)))  # fmt: skip
    with open("compare.csv", encoding="utf-8", newline="") as file:
        assert [row["model"] for row in csv.DictReader(file)] == list(CONTINUUM_MODELS)
    code, _, err = run("pose", TWO, *bent, "--out", "pose.png")
    assert code == 2
    assert "exists already" in err


@pytest.mark.parametrize("path", [TWO, HELICAL, CONVERGING, COLONOSCOPE], ids=lambda p: p.stem)
def test_example_robots_bend_alike_by_energy_and_rod(path):
    robot = ContinuumRobot.from_yaml(path)
    pulled = -0.3 * np.ones(len(robot.tendons))
    pulled[0] = 0.2
    energy, rod = (model(robot).shape(pulled).require() for model in (EnergyModel, RodModel))
    assert energy.tip == pytest.approx(rod.tip, abs=0.02)
    assert np.linalg.norm(rod.tip - [0.0, 0.0, robot.length]) > 0.1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["pose", "none.yaml", "--displacement", "T1=1mm"], "none.yaml"),
        (["pose", TWO], "--displacement"),
        (["pose", TWO, "--displacement", "Q=1mm"], "'Q': the tendons of robot 'two sections' are"),
        (["pose", TWO, "--displacement", "T1"], "'T1': it must be NAME=LENGTH"),
        (["pose", TWO, "--displacement", "T1=1mm,"], "has the part ''"),
        (["pose", TWO, "--displacement", "T1=1mm,T1=2mm"], "'T1' more than once"),
        (["pose", TWO, "--displacement", "T1=1N"], "'1N' has the wrong kind of unit"),
        (["pose", TWO, "--displacement", "T1=nan"], "'nan'"),
        (["pose", TWO, "--displacement", BENT, "--model", "pcc"], "'pcc'"),
        (["pose", TWO, "--displacement", BENT, "--segments", "3"], "not for the arc model"),
        (["pose", TWO, "--displacement", BENT, "--model", "arc", "--tip-force", "0,0,1"],
         "--tip-force is not for the arc model: it is for energy and rod"),
        (["pose", TWO, "--displacement", BENT, "--model", "linkage", "--line-force", "0,0,1"],
         "--line-force is not for the linkage model"),
        (["pose", TWO, "--displacement", BENT, "--model", "rod", "--segment-kind", "arc"],
         "--segment-kind is not for the rod model: it is for energy"),
        (["pose", TWO, "--displacement", BENT, "--tip-force", "0,1N"], "2 part"),
        (["pose", TWO, "--displacement", BENT, "--tip-force", "0,1N,0"],
         "--tip-force needs --tendon-stiffness"),
        (["compare", TWO, "--displacement", BENT, "--line-force", "0,1N/mm,0"],
         "--line-force needs --tendon-stiffness"),
        (["pose", TWO, "--displacement", BENT, "--tip-force", "0,0,1mm"], "wrong kind of unit"),
        (["pose", TWO, "--displacement", BENT, "--tolerance=-1mm"], "tolerance is -1 mm"),
        (["pose", TWO, "--displacement", BENT, "--model", "linkage", "--segments", "0"],
         "segments is 0"),
        (["pose", TWO, "--displacement", BENT, "--model", "rod", "--steps", "1"], "steps is 1"),
        (["pose", TWO, "--displacement", BENT, "--model", "energy", "--between=-1"],
         "between is -1"),
        (["pose", HELICAL, "--displacement", WOUND, "--model", "arc"], "tendon 'H1' changes"),
        (["pose", TWO, "--displacement", BENT, "--out", "a.txt"], ".csv"),
        (["pose", TWO, "--displacement", BENT, "--out", "nowhere/a.png"], "nowhere"),
        (["reach", TWO], "--to"),
        (["reach", TWO, "--to", "1mm,2mm"], "2 part"),
        (["reach", TWO, "--to", "1,2,3", "--direction", "0,0,0"], "must not be zero"),
        (["reach", TWO, "--to", "1,2,3", "--starts", "0"], "starts is 0"),
        (["reach", HELICAL, "--to", "1,2,3"], "give --model energy or --model rod"),
        (["compare", TWO, "--displacement", BENT, "--tip-force", "0,0,x"], "'x'"),
        (["workspace", HELICAL], "only pose and compare take others"),
        (["workspace", TWO, "--count", "0"], "count is 0"),
        (["workspace", TWO, "--cell", "0mm"], "--cell is 0 mm: it must lie in [0.11, 1e+09] mm"),
        (["workspace", TWO, "--cell", "1um", "--out", "map.png"],
         "--cell is 0.001 mm: it must lie in [0.11, 1e+09] mm, at most 1000 cells along the robot"),
        (["workspace", TWO, "--cell", "1e200mm"], "'--cell': '1e200mm' is 1e+200 mm"),
        (["workspace", TWO, "--at", "1e200,0,0"], "'--at': '1e200' is 1e+200 mm"),
        (["reach", TWO, "--to", "1e200,0,1e200"], "'--to': '1e200' is 1e+200 mm"),
        (["workspace", TWO, "--bend-cap", "0"], "bend_cap is 0"),
        (["workspace", TWO, "--seed", "x"], "'x'"),
        (["workspace", TWO, "--directions", "0"], "directions is 0"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_nothing_is_written(run, tmp_path, arguments, said):
    code, out, err = run(*arguments)
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1
    assert said in err
    assert list(tmp_path.iterdir()) == []


def test_a_robot_without_tendons_is_refused(run, tmp_path):
    (tmp_path / "bare.yaml").write_text("sections: [{length: 20 mm, radius: 2 mm}]\n")
    for command in (("reach", "bare.yaml", "--to", "0,0,20"), ("workspace", "bare.yaml")):
        code, _, err = run(*command)
        assert code == 2
        assert "has no tendons" in err


def test_a_bad_field_of_a_robot_is_named(run, tmp_path):
    text = TWO.read_text(encoding="utf-8").replace("offset: 4 mm", "offset: 40 mm", 1)
    (tmp_path / "bad.yaml").write_text(text)
    code, _, err = run("pose", "bad.yaml", "--displacement", "T1=0")
    assert code == 2
    assert err.count("\n") == 1
    assert "bad.yaml: tendon 'T1' offset is 40 mm" in err


def test_the_file_format_in_the_guide_is_read(run, tmp_path):
    page = (EXAMPLES.parent / "docs" / "guide" / "continuum.md").read_text(encoding="utf-8")
    text, elastic = re.findall(r"^```yaml\n(.*?)^```", page, re.M | re.S)
    for name, block in (("guide.yaml", text), ("elastic.yaml", elastic)):
        (tmp_path / name).write_text(block, encoding="utf-8")
    assert ContinuumRobot.from_yaml(tmp_path / "elastic.yaml").weight_at([0.0]) > 0.0
    robot = ContinuumRobot.from_yaml(tmp_path / "guide.yaml")
    plain = robot.to_dict()
    told = {key for section in plain["sections"] for key in section}
    assert told == set(SECTION_FIELDS)  # the guide leaves out no field
    assert {k for s in plain["sections"] for t in s["tendons"] for k in t} >= {"end", "pushes"}
    assert all(f"{name}:" in text for name in (*SECTION_FIELDS, *TENDON_FIELDS, *HELIX_FIELDS))
    assert run("pose", "guide.yaml", "--displacement", "D1=0.5mm,D2=-2mm,D3=-2mm,T1=-2mm,T2=-2mm,"
               "T3=-2mm")[0] == 0  # fmt: skip


def test_a_rod_without_tendons_is_posed_by_loads_alone(ask, run, capsys):
    assert main(["new", "robot", "--tendons", "0", "--sections", "1"]) == 0
    capsys.readouterr()
    rod = ContinuumRobot.from_yaml("robot.yaml")
    assert rod.tendons == ()
    said = ask("pose", "robot.yaml", "--load", "force=1mN:0:0", "--out", "rod.csv")
    assert said["model"] == "rod" and said["tendons"] == {}
    # F L^3 / 3 EI of the beam.
    sag = 1e-3 * rod.length**3 / (3.0 * rod.sections[0].bending_stiffness)
    assert said["tip_mm"][0] == pytest.approx(sag, rel=1e-3)
    assert "tendon" not in run("pose", "robot.yaml", "--load", "force=1mN:0:0")[1]
    assert run("pose", "robot.yaml", "--load", "force=1mN:0:0", "--out", "rod.png")[0] == 0
    straight = ask("pose", "robot.yaml")
    assert straight["tip_mm"] == pytest.approx([0.0, 0.0, rod.length], abs=1e-9)


def test_under_loads_alone_all_tendons_follow(ask, run):
    load = ("--load", "force=2mN:1mN:0")
    follow, slack = (ask("pose", TWO, *words, *load) for words in ((), ("--tension", "T1=0N")))
    assert follow["tip_mm"] == pytest.approx(slack["tip_mm"], abs=1e-6)
    assert follow["tip_mm"] == ask("pose", TWO, "--tip-force", "2mN,1mN,0")["tip_mm"]
    code, _, err = run("pose", TWO, *load, "--history", "T1=1mm")
    assert code == 2 and "--history goes with --displacement" in err


def test_tendons_that_are_not_named_follow(ask):
    said = ask("pose", TWO, "--displacement", "T1=2mm,T4=3mm")
    shape = ROBOT.forward({"T1": 2.0, "T4": 3.0}, model="arc")
    assert said["tip_mm"] == pytest.approx(shape.tip.tolist())
    moved = [row["displacement_mm"] for row in said["tendons"].values()]
    again = ask("pose", TWO, "--displacement", spell(ROBOT, moved, digits=12))
    assert again["tip_mm"] == pytest.approx(said["tip_mm"], abs=1e-6)


def test_tensions_are_taken_by_name(ask, run):
    said = ask("pose", TWO, "--tension", "T1=0.5N,T4=300mN")
    pulls = [0.5, 0.0, 0.0, 0.3, 0.0, 0.0]
    assert said["model"] == "rod"
    assert [row["tension_N"] for row in said["tendons"].values()] == pytest.approx(pulls)
    assert said["tip_mm"] == pytest.approx(ROBOT.forward(tensions=pulls).tip.tolist())
    for words, line in (
        (("--tension", "T1=1N", "--displacement", "T1=1mm"), "pose takes --displacement or"),
        ((), "pose needs --displacement or --tension, or a load: give one of them"),
        (("--tension", "T1=1mm"), "'1mm' has the wrong kind of unit"),
        (("--tension", "T1=-1N"), "tension of tendon 'T1' is -1 N: it must lie in [0, inf) N"),
        (("--tension", "T1=1N", "--model", "arc"), "the arc model takes displacements only"),
        (("--tension", "T1=1N", "--history", "T1=1mm"), "--history goes with --displacement"),
    ):
        code, out, err = run("pose", TWO, *words)
        assert (code, out) == (2, "") and line in err and err.count("\n") == 1


def test_places_in_the_world_where_the_base_has_a_pose(ask, run):
    turned = ContinuumRobot(
        ROBOT.sections, base_position=(1.0, 2.0, 3.0), base_rotation=(0.0, math.pi / 2.0, 0.0)
    )
    turned.to_yaml("turned.yaml")
    said = ask("pose", "turned.yaml", "--displacement", "T1=2mm")
    plain = ask("pose", TWO, "--displacement", "T1=2mm")
    x, y, z = plain["tip_mm"]
    assert said["tip_mm"] == plain["tip_mm"]
    assert said["tip_world_mm"] == pytest.approx([1.0 + z, 2.0 + y, 3.0 - x])
    assert "tip_world_mm" not in plain
    assert "in the world at" in run("pose", "turned.yaml", "--displacement", "T1=2mm")[1]


@pytest.mark.parametrize(
    ("load", "line"),
    [
        ("force=1:2:3mN", "--load force is '1:2:3mN': 1 has no unit, give each one its own"),
        ("force=1N", "--load force is '1N': it must be X:Y:Z, such as 0:0:-1N"),
        ("at=30mm", "--load is 'at=30mm': it has no force, moment or line"),
        ("at=1mm,line=0:0:1N/m", "--load names 'at': a load along a line has line, from, to,"),
        ("force=0:0:1N,force=0:0:1N", "--load names 'force' more than once"),
        ("force=0:0:1N,frame=tool", "load's frame is 'tool': it must be one of base, world, body"),
        ("nonsense", "--load is 'nonsense': it must be at=30mm,force=0:0:-1N,frame=body"),
    ],
)
def test_loads_are_refused(run, load, line):
    code, out, err = run("pose", TWO, "--displacement", "T1=1mm", "--load", load, *WIRE)
    assert (code, out) == (2, "") and line in err and err.count("\n") == 1


def test_jacobian_is_the_library(ask, run):
    said = ask("jacobian", HELICAL, "--displacement", WOUND, "--out", "motion.csv")
    robot = ContinuumRobot.from_yaml(HELICAL)
    model = EnergyModel(robot)
    found = model.jacobian(robot.forward({"H1": 2.0, "H2": -5, "H3": -5, "H4": -5}, model="energy"))
    assert said["arc_length_mm"] == robot.length and said["held"] == "displacements"
    for k, name in enumerate(robot.tendon_names):
        assert said["by_displacement"][name] == pytest.approx(
            found.by_displacement[-1, :, k].tolist(), rel=1e-3, abs=1e-6
        )
        for column, what in enumerate(("by_offset", "by_clocking")):
            rows = found.by_routing[-1, :, k, column].tolist()
            assert said[what][name] == pytest.approx(rows, rel=1e-3, abs=1e-5)
    for row, column in zip(said["rows"], found.by_base[-1].T, strict=True):
        assert said["by_base"][row] == pytest.approx(column.tolist(), rel=1e-3, abs=1e-6)
    rows = list(csv.DictReader(Path("motion.csv").open(encoding="utf-8")))
    assert [row["row"] for row in rows] == said["rows"]
    assert float(rows[4]["by_displacement_H1"]) == pytest.approx(said["by_displacement"]["H1"][4])
    pulled = ask("jacobian", HELICAL, "--tension", "H1=1N", "--at", "30mm")
    assert pulled["held"] == "tensions" and list(pulled["by_tension"]) == list(robot.tendon_names)
    assert pulled["arc_length_mm"] == pytest.approx(30.0, abs=robot.length / 20)
    code, _, err = run("jacobian", HELICAL, "--tension", "H1=1N", "--at", "300mm")
    assert code == 2 and "--at is 300 mm: it must lie in [0, " in err


def test_jacobian_says_what_its_model_leaves_out(ask, run):
    said = "the energy model leaves out the friction of tendons: the rod model has it"
    rough = TWO.read_text(encoding="utf-8").replace("angle: 0 deg", "angle: 0 deg, friction: 0.2")
    Path("rough.yaml").write_text(rough, encoding="utf-8")
    assert ask("jacobian", "rough.yaml", "--tension", "T1=1N")["notes"] == [said]
    assert f"note: {said}" in run("jacobian", "rough.yaml", "--tension", "T1=1N")[1]
    assert ask("jacobian", TWO, "--tension", "T1=1N")["notes"] == []


def test_reach_takes_any_routing_by_tensions(ask, run):
    said = ask("reach", HELICAL, "--to", "30mm,10mm,90mm", "--model", "energy")
    assert said["model"] == "energy" and said["success"]
    assert said["tip_mm"] == pytest.approx([30.0, 10.0, 90.0], abs=1e-4)
    pulls = ",".join(f"{name}={value:.9f}N" for name, value in said["tensions_N"].items())
    again = ask("pose", HELICAL, "--tension", pulls, "--model", "energy")
    assert again["tip_mm"] == pytest.approx(said["tip_mm"], abs=1e-3)
    assert "tension [N]" in run("reach", HELICAL, "--to", "30mm,10mm,90mm", "--model", "energy")[1]
    code, _, err = run("reach", HELICAL, "--to", "30mm,10mm,90mm")
    assert code == 2 and "give --model energy or --model rod" in err
    code, _, err = run("reach", TWO, "--to", "30mm,10mm,90mm", "--load", "force=1N:0N:0N")
    assert code == 2 and "--load is not for the arc model" in err


TUBE = {
    "format": "bozzini shapes",
    "version": 1,
    "kind": "cones",
    "shapes": [
        {"centre": list(centre), "radius": 7} for centre in ((0, 0, 0), (0, 0, 40), (25, 0, 90))
    ],
}
SOFT = ("--tract", "tube.json", "--wall-stiffness", "0.5MPa", "--between", "1")
MOVED = ("--speed", "40mm/s", "--max-step", "5ms")
PUSHED = ("simulate", "passive.yaml", "times.csv", *SOFT, *MOVED)


@pytest.fixture
def tube(tmp_path):
    (tmp_path / "tube.json").write_text(json.dumps(TUBE))
    names = ("density: 6450 kg/m^3", "diameter: 1 mm", "modulus: 60 GPa")
    wire = "\n".join(f"    {name}" for name in names)
    tendons = "  tendons:\n  - {name: T1, offset: 1.5 mm, angle: 0 deg}"
    own = "\n".join(
        [tendons, "  radius: 2 mm", "  discs: 10", "  line_weight: 0.1 N/m", "  wire:", wire]
    )
    (tmp_path / "passive.yaml").write_text(f"name: passive\nsections:\n- length: 60 mm\n{own}\n")
    (tmp_path / "times.csv").write_text("time [s],T1 tension [N]\n" + "0,0\n1,0\n2,0\n")


def test_a_robot_is_pushed_into_a_tract_in_time(run, tube):
    code, out, _ = run(*PUSHED, "--damping-time", "20ms", "--json", "--out", "tip.csv")
    found = json.loads(out)
    assert code == 0
    assert found["wall_N"][0] == 0.0 < found["wall_N"][-1]
    before, after = np.array(found["tip_mm"])[[0, -1]]
    assert 50.0 < after[2] - before[2] < 60.0
    assert "wall_N" in Path("tip.csv").read_text().splitlines()[0]


@pytest.mark.parametrize(
    ("kind", "unit", "scale", "command"),
    [("tension", "N", 0.5, 10.0), ("displacement", "mm", 0.5, 1.0)],
)
def test_a_calibrated_robot_at_rest_is_where_pose_has_it(run, tube, kind, unit, scale, command):
    text = Path("passive.yaml").read_text().replace("angle: 0 deg", "angle: 0 deg, stiffness: 5 kN")
    zeros = "  zeros: {T1: 0.4}\n" if kind == "displacement" else ""
    text += f"calibration:\n  command: {kind}\n  scale: {scale}\n{zeros}"
    Path("fitted.yaml").write_text(text)
    rows = "".join(f"{time},{command}\n" for time in (0, 0.01))
    Path("held.csv").write_text(f"time [s],T1 {kind} [{unit}]\n{rows}")
    line = ("simulate", "fitted.yaml", "held.csv", "--segment-kind", "channel", "--json")
    code, out, err = run(*line)
    assert code == 0, err
    given = ("--model", "energy", f"--{kind}", f"T1={command}{unit}", "--json")
    code, still, _ = run("pose", "fitted.yaml", *given)
    assert code == 0
    moved, posed = json.loads(out)["tip_mm"][0], json.loads(still)["tip_mm"]
    assert posed[0] > 3.0
    np.testing.assert_allclose(moved, posed, atol=0.3)


def test_a_motion_states_its_frame_and_what_of_the_table_is_ignored(run, tube):
    Path("typo.csv").write_text("time [s],T1 tension [N],T2 tensoin [N]\n0,1,2\n0.01,1,2\n")
    line = ("simulate", "passive.yaml", "typo.csv")
    code, out, _ = run(*line, "--json", "--out", "tip.csv")
    found = json.loads(out)
    assert (code, found["frame"]) == (0, "base at rest")
    assert found["notes"] == ["ignored columns: T2 tensoin [N]"]
    head, first, *_ = Path("tip.csv").read_text().splitlines()
    assert (head.split(",")[-1], first.split(",")[-1]) == ("frame", "base at rest")
    code, out, _ = run(*line)
    assert code == 0 and "in the frame of the base at rest" in out
    assert "note: ignored columns: T2 tensoin [N]" in out


def test_loads_and_base_of_a_motion_are_columns_of_the_table(run, tube):
    def move(head, rows, *arguments):
        lines = [f"{time},1{row}" for time, row in zip((0, 0.05, 0.1), rows, strict=True)]
        Path("rows.csv").write_text("\n".join([f"time [s],T1 tension [N]{head}", *lines]))
        code, out, err = run("simulate", "passive.yaml", "rows.csv", *arguments, "--json")
        return np.array(json.loads(out)["tip_mm"]) if code == 0 else err

    none, load = move("", [""] * 3), ("--load", "force=0:0.2N:0")
    np.testing.assert_array_equal(move(",load 1", [",0"] * 3, *load), none)
    held = move(",load 1", [",0"] * 3, *load, "--held-by", load[1])
    assert held[0, 1] > none[0, 1] + 1.0
    moved = move(",base x [cm],base rz [deg]", [",0,0", ",0.5,0", ",1,0"])
    assert moved[-1, 0] - none[-1, 0] == pytest.approx(10.0, abs=2.0)
    fallen = move("", [""] * 3, "--free", "--gravity", "0,3,0")
    assert fallen[-1, 1] - fallen[0, 1] == pytest.approx(0.5 * 3e3 * 0.1**2, rel=0.2)
    assert "'load 2': there are 1 loads" in move(",load 2", [",0"] * 3, *load)


def test_what_a_moving_robot_is_outside_of(run, tube):
    shapes = {
        **TUBE,
        "shapes": [{"centre": list(at), "radius": 5} for at in ((9, 0, 0), (9, 0, 99))],
    }
    Path("bar.json").write_text(json.dumps(shapes))
    Path("rows.csv").write_text("time [s],T1 tension [N]\n0,0\n0.1,3\n0.2,3\n")
    line = ("simulate", "passive.yaml", "rows.csv", "--damping-time", "20ms", "--json")
    code, out, err = run(*line, "--obstacle", "bar.json", "--wall-stiffness", "0.5MPa")
    assert (code, err) == (0, "") and json.loads(out)["wall_N"][-1] > 0.0
    code, _, err = run(*line, "--obstacle", "bar.json")
    assert code == 2 and "wall_stiffness is not given" in err


def test_drives_of_a_calibrated_robot_have_the_rate_that_is_commanded(run, tube):
    text = Path("passive.yaml").read_text().replace("angle: 0 deg", "angle: 0 deg, stiffness: 5 kN")
    Path("fitted.yaml").write_text(text + "calibration:\n  command: displacement\n  scale: 0.5\n")
    Path("jump.csv").write_text("time [s],T1 displacement [mm]\n0,0\n0.1,2\n0.2,2\n")
    code, out, err = run("simulate", "fitted.yaml", "jump.csv", "--drive-rate", "10mm/s", "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["tendons"]["T1"]["displacement_mm"] == pytest.approx([0.0, 0.5, 1.0])


def test_energy_from_nowhere_ends_the_command_with_a_note(run, tube, monkeypatch):
    monkeypatch.setattr("bozzini.continuum.dynamics.GAINED", -1.0)
    code, out, _ = run("simulate", "passive.yaml", "times.csv")
    assert code == 1 and "note: " in out and "take smaller steps" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (SOFT[:2], "wall_stiffness is not given"),
        (("--speed", "20mm/s"), "without --tract"),
        (("--friction", "0.1"), "without --tract"),
        ((*SOFT, "--speed", "-2mm/s"), "speed is -2 mm/s"),
        (("--held-by", "up"), "--held-by"),
    ],
)
def test_walls_of_a_motion_are_refused_in_one_line(run, tube, arguments, words):
    code, out, err = run("simulate", "passive.yaml", "times.csv", *arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert words in err


def test_a_motion_is_a_page_with_a_step_for_each_time(run, tube):
    code, _, err = run(*PUSHED, "--quiet", "--out", "motion.html")
    assert (code, err) == (0, "")
    assert "Robot in motion: passive, 0 to 2 s" in Path("motion.html").read_text("utf-8")


def test_a_film_without_a_browser_is_refused_before_any_work(run, tube, monkeypatch):
    monkeypatch.setattr("bozzini.scene.film.find_browser", lambda: None)
    code, out, err = run(
        "simulate", "passive.yaml", "times.csv", "--load", "x", "--out", "motion.gif"
    )
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "needs Chromium" in err

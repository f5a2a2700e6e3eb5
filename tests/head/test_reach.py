"""A head at the tip of a planned scope: what of the wall it reaches."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from bozzini.cli.main import main
from bozzini.duct import RoundCones
from bozzini.errors import InputError
from bozzini.head import (
    Head,
    Instrument,
    PlacedEffector,
    ReachOptions,
    find_reached,
    stand_head,
    write_head,
)
from bozzini.motion import Plan
from bozzini.motion.plan import TractInput
from bozzini.numeric.level_sets import find_level_set

LENGTH = 200.0
TURNS = {
    "none": np.eye(3),
    "axes": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "any": Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix(),
}
SHIFT = np.array([7.0, -20.0, 31.0])
FAST = ReachOptions(roll=0.0, samples=100, spacing=4.0)


def make_tube(radius: float = 40.0, turn: np.ndarray = TURNS["none"]) -> tuple[RoundCones, Plan]:
    """Return a straight round tube and a plan along it, turned and moved."""
    ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, LENGTH]])
    heads = np.linspace(0.0, LENGTH, 21)
    joints = np.zeros((21, 25, 3))
    joints[..., 2] = heads[:, None] - 10.0 * np.arange(25)
    path = joints[:, 0]
    plan = Plan(
        joints=joints @ turn.T + SHIFT,
        head_arc_length=heads,
        clearance=np.full((21, 24), radius - 6.0),
        path=path @ turn.T + SHIFT,
        path_arc_length=heads,
        path_radius=np.full(21, radius),
        method="follow",
        status="complete",
    )
    return RoundCones(ends @ turn.T + SHIFT, [radius, radius]), plan


def place(turn: np.ndarray, *point: float) -> np.ndarray:
    return turn @ np.array(point) + SHIFT


def sample_tips(placed: PlacedEffector, count: int) -> np.ndarray:
    """Return tips of the instrument in the head's frame by pressures, and not by deflections."""
    limit = placed.effector.design.pressure_limit
    one = np.linspace(0.0, limit, count)
    pressures = np.stack(np.meshgrid(one, one, one), axis=-1).reshape(-1, 3)
    pressures = pressures[(pressures > 0.0).sum(axis=1) < 3]
    pose = placed.effector.forward(pressures)
    out = np.linspace(0.0, placed.instrument.out, 41)[:, None, None]
    tips = (pose.holder_tip + out * pose.direction).reshape(-1, 3)
    turn = Rotation.from_euler("z", placed.turn).as_matrix()
    return tips @ turn.T + placed.place


@pytest.mark.parametrize("goal", [(18.0, -12.0, 170.0), (-30.0, 4.0, 165.0), (5.0, 30.0, 130.0)])
def test_the_miss_is_that_of_dense_pressures(goal: tuple[float, float, float]) -> None:
    duct, plan = make_tube(radius=150.0)  # no wall near
    target, options = place(TURNS["none"], *goal), ReachOptions(roll=0.0)
    stand = stand_head(plan, 100.0)
    found = find_reached(Head(), stand, duct=duct, target=target, options=options)
    tips = sample_tips(Head().effectors[0], 41)
    brute = float(np.linalg.norm(tips - (np.array(goal) - [0.0, 0.0, 100.0]), axis=1).min())
    (row,) = found.rows
    assert row.miss_of_poses <= brute + 0.05
    assert row.miss_of_poses == pytest.approx(brute, abs=1.0)
    assert found.converged == (row.miss <= 1.5) == (not found.reason)


def test_pressures_bring_the_tip_to_the_target() -> None:
    duct, plan = make_tube()
    goal = place(TURNS["none"], 20.0, -33.0, 158.0)
    head = Head()
    found = find_reached(head, stand_head(plan, 100.0), duct=duct, target=goal)
    assert found.converged
    (row,) = found.rows
    slid = Head(effectors=(replace(head.effectors[0], instrument=Instrument(out=row.out)),))
    pose = slid.forward([found.pressures])
    tip = stand_head(plan, 100.0).roll(row.roll) @ pose.tip[0] + found.stand.origin
    assert np.linalg.norm(tip - goal) == pytest.approx(row.miss, abs=0.01)
    assert -duct.signed_distance(tip) >= -1e-6


@pytest.mark.parametrize("name", ["axes", "any"])
def test_turning_tract_and_plan_turns_the_answer(name: str) -> None:
    goal = (20.0, -33.0, 158.0)
    options = ReachOptions(samples=150, spacing=4.0, roll=0.0 if name == "axes" else None)
    answers = []
    for turn in (TURNS["none"], TURNS[name]):
        duct, plan = make_tube(turn=turn)
        stands = [stand_head(plan, at) for at in (90.0, 100.0)]
        target = place(turn, *goal)
        answers.append(find_reached(Head(), stands, duct=duct, target=target, options=options))
    one, other = answers
    assert other.stand.frame[:, 2] == pytest.approx(TURNS[name] @ one.stand.frame[:, 2])
    if name == "axes":  # the frame turns with the tract: nothing else may change
        assert other.miss == pytest.approx(one.miss, abs=1e-6)
        assert other.area_reached == pytest.approx(one.area_reached, rel=1e-3)
        turned = (one.vertices - SHIFT) @ TURNS[name].T + SHIFT
        np.testing.assert_allclose(other.vertices, turned, atol=1e-3)
    else:  # the rolls that are tried begin elsewhere
        assert other.converged == one.converged
        assert other.insertion == one.insertion
        assert other.area_reached == pytest.approx(one.area_reached, rel=0.05)


def test_at_a_free_roll_a_round_tube_is_reached_all_round() -> None:
    duct, plan = make_tube()
    found = find_reached(Head(), stand_head(plan, 100.0), duct=duct)
    seen = (found.vertices - found.stand.origin) @ found.stand.frame
    around = np.arctan2(seen[:, 1], seen[:, 0])
    reached = found.codes == 2
    counts = [
        np.ptp(seen[reached & (np.abs(around - angle) < 0.2), 2]) for angle in (-2.0, 0.0, 1.0, 2.5)
    ]
    assert np.ptp(counts) <= 4.0  # two cells of the grid
    given = find_reached(Head(), stand_head(plan, 100.0), duct=duct, options=ReachOptions(roll=0.5))
    assert 0.0 < given.area_reached < found.area_reached
    assert np.all(np.hypot(seen[reached, 0], seen[reached, 1]) == pytest.approx(40.0, abs=0.5))


def test_every_reached_place_is_near_a_tip_of_dense_pressures() -> None:
    duct, plan = make_tube()
    options = ReachOptions(roll=0.0, samples=1000)
    found = find_reached(Head(), stand_head(plan, 100.0), duct=duct, options=options)
    seen = (found.vertices - found.stand.origin) @ found.stand.frame
    tips = sample_tips(Head().effectors[0], 41)
    away = np.array([np.linalg.norm(tips - each, axis=1).min() for each in seen[found.codes == 2]])
    assert len(away) > 50
    assert away.max() <= options.tolerance + 1.0
    missed = np.array(
        [np.linalg.norm(tips - each, axis=1).min() for each in seen[found.codes == 0][::40]]
    )
    assert missed.min() >= options.tolerance - 0.5


def test_a_wall_is_in_the_way() -> None:
    goal = place(TURNS["none"], 0.0, -30.0, 160.0)
    wide, plan = make_tube()
    assert find_reached(Head(), stand_head(plan, 100.0), duct=wide, target=goal).converged
    narrow, plan = make_tube(radius=26.0)  # the camera has space, the target is beyond the wall
    found = find_reached(Head(), stand_head(plan, 100.0), duct=narrow, target=goal)
    assert "something" not in found.reason
    assert "in the way: without touching it the tip comes to" in found.reason
    assert found.rows[0].miss > 1.5 >= found.rows[0].miss_of_poses
    tight, plan = make_tube(radius=8.0)
    found = find_reached(Head(), stand_head(plan, 100.0), duct=tight, target=goal)
    assert (found.free_share, found.area_reached) == (0.0, 0.0)
    assert found.area_blocked > 0.0
    assert found.reason.endswith("nowhere")
    assert find_reached(
        Head(), stand_head(plan, 100.0), duct=tight, options=FAST
    ).converged  # nothing was asked


def test_the_best_insertion_bends_least() -> None:
    duct, plan = make_tube()
    goal = place(TURNS["none"], 0.0, -38.0, 160.0)
    found = find_reached(
        Head(),
        [stand_head(plan, at) for at in [60.0, 95.0, 100.0, 105.0, 150.0]],
        duct=duct,
        target=goal,
    )
    reached = [row for row in found.rows if row.miss <= 1.5]
    assert len(reached) >= 2
    best = next(row for row in found.rows if row.insertion == found.insertion)
    assert best.deflection == min(row.deflection for row in reached)
    far = find_reached(
        Head(), [stand_head(plan, at) for at in [0.0, 20.0]], duct=duct, target=goal, options=FAST
    )
    assert far.insertion == 20.0
    assert far.reason.startswith("the target is out of reach")


def test_two_end_effectors_reach_what_either_does() -> None:
    duct, plan = make_tube()
    thin = Instrument(diameter=1.0, rigidity=20.0)
    changes = {"muscle.outer_radius": 0.4, "muscle.inner_radius": 0.2, "offset": 1.9,
               "holder_diameter": 4.6, "bore_diameter": 1.2, "flexural_rigidity": 60.0}  # fmt: skip
    pair = [
        PlacedEffector(changes=changes, x=x, y=0.0, turn=turn, instrument=thin)
        for x, turn in ((3.2, 0.0), (-3.2, math.pi))
    ]
    both = find_reached(
        Head(diameter=14.0, effectors=tuple(pair)), stand_head(plan, 100.0), duct=duct, options=FAST
    )
    for one in pair:
        alone = find_reached(
            Head(diameter=14.0, effectors=(one,)), stand_head(plan, 100.0), duct=duct, options=FAST
        )
        assert 0.0 < alone.area_reached < both.area_reached
        assert not ((alone.codes == 2) & (both.codes == 0)).any()


def test_a_stand_is_between_steps() -> None:
    _, plan = make_tube(turn=TURNS["any"])
    stand = stand_head(plan, 93.0)
    assert stand.origin == pytest.approx(place(TURNS["any"], 0.0, 0.0, 93.0))
    np.testing.assert_allclose(stand.frame.T @ stand.frame, np.eye(3), atol=1e-12)
    assert np.linalg.det(stand.frame) == pytest.approx(1.0)
    assert stand_head(plan).insertion == LENGTH
    for at in (-1.0, 201.0):
        with pytest.raises(InputError, match=r"insertion is .* mm: it must lie in \[0, 200\] mm"):
            stand_head(plan, at)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a plan, its tube as a surface, and another tube."""
    folder = tmp_path_factory.mktemp("reach")
    for name, radius in (("tube", 40.0), ("other", 20.0)):
        duct, plan = make_tube(radius)
        low = duct.bounds[0] - 6.0
        axes = [
            low[k] + 3.0 * np.arange((duct.bounds[1, k] + 6.0 - low[k]) / 3.0) for k in range(3)
        ]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        vertices, faces = find_level_set(duct.signed_distance(nodes))
        mesh = trimesh.Trimesh(low + 3.0 * vertices, faces)
        moved = mesh.vertices + ([60.0, 0.0, 0.0] if name == "other" else 0.0)
        trimesh.Trimesh(moved, mesh.faces).export(folder / f"{name}.stl")
        plan = replace(plan, input=TractInput(voxel=4.0))
        plan.save(folder / f"{name}.npz")
    write_head(folder / "head.yaml", Head())
    return folder


def test_the_command_finds_a_place(files, tmp_path, capsys) -> None:
    goal = ",".join(f"{x:g}mm" for x in place(TURNS["none"], 20.0, -32.0, 158.0))
    table, picture = tmp_path / "rows.csv", tmp_path / "reach.png"
    given = ["head", "reach", str(files / "tube.npz"), str(files / "tube.stl")]
    near = [f"--target={goal}", "--step", "20mm", "--samples", "100", "--spacing", "4mm"]
    assert main([*given, *near, "--json", "--out", str(table)]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["converged"]
    assert answer["insertion_mm"] in (80.0, 100.0)
    assert set(answer["pressures"]) == {"R", "G", "B"}
    assert [row["insertion_mm"] for row in answer["rows"]] == [20.0 * k for k in range(11)]
    with table.open() as file:
        assert len(list(csv.DictReader(file))) == 11
    head = ["--head", str(files / "head.yaml"), "--roll", "0deg", "--samples", "50"]
    assert main([*given, "--at", "50mm", *head, "--out", str(picture)]) == 0
    assert "cm^2 of the wall are reached" in capsys.readouterr().out
    assert picture.exists()
    page = tmp_path / "reach.html"
    assert main([*given, "--at", "50mm", *head, "--out", str(page)]) == 0
    assert "Reach at 50.0 mm of insertion" in page.read_text(encoding="utf-8")
    assert main([*given, "--at", "50mm", *head, "--out", str(page)]) == 2
    capsys.readouterr()
    assert main([*given, "--at", "50mm", f"--target={goal}", *head]) == 1
    assert "the target is out of reach" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--at", "412mm"], "insertion is 412 mm: it must lie in [0, 200] mm"),
        (["--target", "1mm,2mm"], "'1mm,2mm' has 2 part(s): give 3"),
        (["--target", "1mm,2mm,3s"], "3s"),
        (["--samples", "1"], "samples is 1: it must lie in [10, 100000]"),
        (["--samples", "90000"], "samples is 90000: it must be at most 10162 for 24 rolls"),
        (["--spacing", "0.25mm"], "spacing is 0.25 mm: it must be at least 0.55 mm"),
        (["--roll", "900deg"], "roll is 15.708 rad"),
        (["--head", "nothing.yaml"], "cannot read nothing.yaml"),
    ],
)
def test_wrong_input_is_one_line(files, tmp_path, capsys, more: list[str], said: str) -> None:
    out = tmp_path / "reach.png"
    given = ["head", "reach", str(files / "tube.npz"), str(files / "tube.stl")]
    assert main([*given, *more, "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not out.exists()


def test_another_tract_is_refused(files, capsys) -> None:
    assert main(["head", "reach", str(files / "tube.npz"), str(files / "other.stl")]) == 2
    assert "its path leaves the lumen by" in capsys.readouterr().err


def test_wall_and_head_are_shown(files, tmp_path) -> None:
    duct, plan = make_tube()
    goal = place(TURNS["none"], 20.0, -32.0, 158.0)
    found = find_reached(
        Head(), stand_head(plan, 100.0), duct=duct, target=goal, options=replace(FAST, roll=None)
    )
    view = found.show().view
    assert sum(len(item.faces) for item in view.surfaces) == len(found.faces)
    names = [item.name for item in view.bodies]
    assert names == ["end-effector 1", "instrument 1", "camera's arm", "camera"]
    (mark,) = view.marks
    assert mark.text == "target"
    (tool,) = (item for item in view.bodies if item.name == "instrument 1")
    assert np.linalg.norm(tool.joints[0, 0] - goal) == pytest.approx(
        tool.radius, abs=FAST.tolerance
    )
    assert main(["show", str(files / "head.yaml"), "--out", str(tmp_path / "head.html")]) == 0

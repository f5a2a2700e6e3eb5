"""The examples run, and come to the results that the guide claims."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from bozzini.anatomy import make_phantom
from bozzini.continuum import ContinuumRobot
from bozzini.motion import Scope

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
PNG = b"\x89PNG"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_example_is_tested():
    assert {path.stem for path in EXAMPLES.glob("*.py")} == {
        "bicycle_chain",
        "breathing",
        "contact_bulb",
        "duct_family",
        "continuum_compare",
        "effector_stick",
        "fabricate",
        "insertion_baselines",
        "muscle_calibration",
        "play_plan",
        "routed_tendons",
        "send_plan",
        "train_insertion",
    }


def test_files_of_measured_robots_are_read_and_named_on_their_page():
    page = (EXAMPLES.parent / "docs" / "measured-robots.md").read_text("utf-8")
    tendons = {}
    for path in (EXAMPLES / "measured").iterdir():
        robot = ContinuumRobot.from_yaml(path)
        tendons[robot.to_dict()["name"]] = len(robot.tendons)
        assert f" examples/measured/{path.name} " in page
    assert tendons == {"tentacle": 2, "three cables": 3, "three sections": 9, "helical": 3}


@pytest.mark.slow
def test_breathing_plans_every_frame_again(tmp_path, capsys):
    example = load("breathing")
    out = tmp_path / "breathing.png"
    rows = example.main(["--frames", "2", "--voxel", "2", "--diameter", "7", "--out", str(out)])
    assert [row["plan"].status for row in rows] == ["complete"] * 2
    assert all(row["certified_mm"] >= 0.0 for row in rows)
    # breathed in the first plan goes through the wall; breathed out it fits as before
    assert rows[0]["first_plan_mm"] < 0.0 < rows[1]["first_plan_mm"]
    assert len(capsys.readouterr().out.splitlines()) == 3
    assert out.read_bytes()[:4] == PNG
    assert out.stat().st_size < 150_000


@pytest.mark.slow
def test_breathing_takes_labels_as_it_takes_surfaces(tmp_path):
    example = load("breathing")
    phantom, scope = make_phantom(), Scope(diameter=6.0, link_length=12.0)
    found = {}
    for name, tract in (("labels", phantom.to_labels(2.0)), ("surface", phantom.to_surface(2.0))):
        _, rows = example.follow_breath(tract, scope, frames=2, voxel=1.5)
        assert all(row["certified_mm"] >= 0.0 for row in rows)
        found[name] = rows
    # Without triangles the bound stands alone.
    assert found["labels"][0]["certified_mm"] <= found["surface"][0]["certified_mm"] + 1.0


def test_bicycle_chain_lies_the_flatter_the_more_it_slips(tmp_path, capsys):
    example = load("bicycle_chain")
    out = tmp_path / "chain.png"
    poses = example.main(["--out", str(out)])
    ends = np.array([joints[-1, -1] for joints in poses.values()])
    assert list(poses) == sorted(poses)
    assert np.all(np.diff(ends[:, 1]) < 0.0)  # the other end is dragged along the more
    assert np.all(np.diff(ends[:, 0]) > 0.0)  # and pulled in the less
    for joints in poses.values():
        links = np.linalg.norm(np.diff(joints, axis=1), axis=2)
        assert links == pytest.approx(np.full(links.shape, example.PITCH))
    assert len(capsys.readouterr().out.splitlines()) == 6
    assert out.read_bytes()[:4] == PNG
    assert out.stat().st_size < 150_000


def test_muscle_calibration_finds_its_truth_and_refuses_the_rest(tmp_path, capsys):
    example = load("muscle_calibration")
    out = tmp_path / "muscle.png"
    found = example.main(["--out", str(out)])
    for name, (low, high) in found["both"].intervals.items():
        assert low <= getattr(example.TRUTH, name) <= high
    assert found["both"].trusted
    assert found["both"].sigma == pytest.approx(example.NOISE, rel=0.3)
    low, high = found["lost"].intervals["dead_length"]
    assert high - low > 10.0  # nothing is known of it
    assert not found["lost"].trusted
    assert found["comparison"].scores[0].name == "energy, 3 fitted"
    said = capsys.readouterr().out
    assert "refused: friction_length and dead_length" in said
    assert out.read_bytes()[:4] == PNG
    assert out.stat().st_size < 150_000
    again = example.main([str(tmp_path / "muscle.csv"), "--out", str(tmp_path / "again.png")])
    assert again["both"].estimates == found["both"].estimates


def test_effector_stick_follows_where_it_can(tmp_path, capsys):
    example = load("effector_stick")
    out = tmp_path / "stick.png"
    found = example.main(["--out", str(out)])
    exact, cubic = found["exact"], found["cubic"]
    assert exact.error[exact.reachable].max() < 1e-8
    assert 1e-3 < cubic.error[cubic.reachable].max() < 0.5
    lost = ~exact.reachable
    assert 0 < lost.sum() < len(lost)
    directions = [np.arctan2(*path[lost].T[::-1]) for path in (exact.targets, exact.achieved)]
    assert directions[0] == pytest.approx(directions[1], abs=1e-9)  # the direction is kept
    assert np.all(exact.achieved[np.all(exact.targets == 0.0, axis=1)] == 0.0)
    assert len(capsys.readouterr().out.splitlines()) == 5
    assert out.read_bytes()[:4] == PNG
    assert out.stat().st_size < 150_000
    (tmp_path / "own.csv").write_text("512,512\n1023,512\n", encoding="utf-8")
    own = example.main([str(tmp_path / "own.csv"), "--out", str(tmp_path / "own.png")])
    assert own["exact"].targets == pytest.approx(
        np.array([[0.0, 0.0], [found["scale"] * 491.0 / 492.0, 0.0]])
    )


def test_continuum_compare_converges_to_the_rod_and_routing_matters(tmp_path, capsys):
    example = load("continuum_compare")
    out = tmp_path / "robots.png"
    found = example.main(["--out", str(out)])
    said = capsys.readouterr().out
    assert said.count(" changes its offset or angle on its way") == 4  # two robots, two models
    assert out.read_bytes()[:4] == PNG
    assert out.stat().st_size < 200_000
    off = {
        robot: {name: np.linalg.norm(s.tip - shapes["rod"].tip) for name, s in shapes.items()}
        for robot, shapes in found.items()
    }
    for robot in off.values():
        errors = np.array([robot[f"energy, {count} between"] for count in example.FINER])
        orders = np.log2(errors[:-1] / errors[1:])
        assert orders == pytest.approx([2.0, 2.0], abs=0.1)
    parallel = off["two_sections"]
    assert parallel["arc"] < 1e-4
    assert parallel["straightened"] < 1e-9
    assert parallel["linkage"] == pytest.approx(parallel["energy, 0 between"], rel=1e-3)
    assert off["converging"]["straightened"] > 5.0
    assert off["helical"]["straightened"] > 50.0
    own = example.main([str(EXAMPLES / "colonoscope.yaml"), "--out", str(out)])
    assert list(own) == ["colonoscope"]


@pytest.mark.slow
def test_duct_family_takes_one_way_through_every_pipe(tmp_path, capsys):
    example = load("duct_family")
    out = tmp_path / "pipes.png"
    names = ["polygon", "with obstacles", "round cones", "sampled field"]
    found = example.main(["--only", *names, "--out", str(out)])
    assert list(found) == names
    for name, result in found.items():
        plan = result["plan"]
        assert (plan.links, plan.status) == (example.LINKS, "complete")
        links = np.linalg.norm(result["tails"] - result["heads"], axis=1)
        assert links == pytest.approx(np.full(len(links), example.LINK))
        room = -result["duct"].signed_distance(result["tails"])
        assert room.min() == pytest.approx(example.CHAIN.radius, abs=1e-6)
        gap = plan.joints[-1][:, :2] - found["polygon"]["plan"].joints[-1]
        assert (np.abs(gap).max() > 0.5) == (name == "with obstacles")
    assert len(capsys.readouterr().out.splitlines()) == len(names)
    assert out.read_bytes()[:4] == PNG
    assert out.stat().st_size < 150_000


@pytest.mark.slow
def test_routed_tendons_hold_the_s_and_straight_ones_do_not(tmp_path, capsys):
    out = tmp_path / "routed.png"
    one, two, *straight = load("routed_tendons").main(["--out", str(out)])
    assert max(one.error_rms, two.error_rms) < 0.05
    assert min(design.error_rms for design in straight) > 5.0 * two.error_rms
    assert len(capsys.readouterr().out.splitlines()) == 5
    assert out.read_bytes()[:4] == PNG


def test_fabricate_draws_closed_parts(tmp_path):
    out = tmp_path / "parts.png"
    meshes = load("fabricate").main(["--out", str(out)])
    assert out.read_bytes().startswith(PNG)
    assert all(mesh.is_volume for mesh in meshes)


@pytest.mark.slow
def test_a_soft_rod_coils_up_in_a_bulb_and_a_stiff_one_passes(tmp_path, capsys):
    out = tmp_path / "bulb.png"
    soft, middle, stiff = load("contact_bulb").main(["--out", str(out)])
    assert not soft.converged and soft.looped_at < 100.0
    # It coils up before the exit, and is pushed harder than what resists at the tip.
    assert soft.tip_progress.max() < 70.0 and soft.push_force.max() > 0.1
    for passed in (middle, stiff):
        assert passed.converged, passed.reason
        assert np.isnan(passed.looped_at) and np.isnan(passed.buckled_at)
        assert passed.tip_progress[-1] == pytest.approx(140.0, abs=1.0)
        # Loads, walls and base are in balance at each step.
        for shape in passed.shapes:
            total = shape.base_force + shape.resultant + shape.loads
            np.testing.assert_allclose(total, 0.0, atol=1e-6 * 0.1)
            np.testing.assert_allclose(shape.forces.sum(axis=0), shape.resultant, atol=1e-12)
    assert len(capsys.readouterr().out.splitlines()) == 3
    assert out.read_bytes()[:4] == PNG


@pytest.mark.slow
def test_baselines_that_look_ahead_do_better_than_chance(capsys):
    rated = load("insertion_baselines").main(["1"])
    random, centre, plan = (rated[name][0] for name in ("random", "centre", "plan"))
    assert centre["complete"] == plan["complete"] == 1.0
    assert min(centre["reward"], plan["reward"]) > random["reward"]
    assert len(capsys.readouterr().out.splitlines()) == 5


@pytest.mark.slow
def test_a_policy_is_trained_and_its_curve_drawn(tmp_path):
    pytest.importorskip("stable_baselines3", reason="needs Stable-Baselines3")
    words = ["--steps", "2048", "--phantoms", "1", "--trials", "1", "--out", str(tmp_path)]
    load("train_insertion").main(words)
    assert (tmp_path / "curve.png").read_bytes()[:4] == PNG
    steps = np.loadtxt(tmp_path / "curve.csv", delimiter=",", skiprows=1, ndmin=2)[:, 0]
    assert 0 < len(steps) and np.all(np.diff(steps) >= 0) and steps[-1] <= 2048

"""The phantom of the airways, and how lungs breathe."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bozzini.anatomy import Breathing
from bozzini.anatomy.airway import DIAMETERS, GAP_MM, make_airway
from bozzini.cli.main import main
from bozzini.errors import InputError


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_every_branch_leaves_the_end_of_its_parent_and_parts_in_two(seed: int) -> None:
    phantom = make_airway(seed=seed)
    branches = phantom.branches
    daughters: dict[int, int] = {}
    for number, branch in enumerate(branches[1:], start=1):
        parent = branches[branch.parent]
        assert branch.parent < number
        assert branch.generation == parent.generation + 1
        assert np.array_equal(branch.start, parent.end)
        assert branch.radius < parent.radius
        daughters[branch.parent] = daughters.get(branch.parent, 0) + 1
    assert set(daughters.values()) == {2}
    assert len(phantom.ends) == (len(branches) + 1) // 2
    assert len(phantom.ends) >= 30


def test_diameters_and_lengths_are_those_of_their_generation() -> None:
    phantoms = [make_airway(seed=seed) for seed in range(8)]
    for generation in range(6):
        widths = [
            2.0 * branch.radius
            for phantom in phantoms
            for branch in phantom.branches
            if branch.generation == generation
        ]
        assert np.mean(widths) == pytest.approx(DIAMETERS[generation], rel=0.1)


def test_branches_that_are_no_neighbours_keep_apart() -> None:
    """By dense samples of both, beyond the balls of the places where they branch."""
    phantom = make_airway(seed=1)
    branches = phantom.branches
    share = np.linspace(0.0, 1.0, 60)[:, None]
    lines = [branch.start + share * (branch.end - branch.start) for branch in branches]
    for k, branch in enumerate(branches):
        near = {k, branch.parent, branches[branch.parent].parent if branch.parent >= 0 else -1}
        for j, other in enumerate(branches[:k]):
            if j in near or other.parent in near:
                continue
            gaps = np.linalg.norm(lines[k][:, None] - lines[j][None], axis=2)
            assert gaps.min() > branch.radius + other.radius + 0.8 * GAP_MM


def test_lumen_holds_every_line_with_its_radius() -> None:
    phantom = make_airway()
    for branch in phantom.branches:
        middle = 0.5 * (branch.start + branch.end)
        assert phantom.signed_distance(middle) <= -branch.radius + 1e-9
    labels = phantom.to_labels(1.0)
    index = np.rint((phantom.branches[0].end - labels.affine[:3, 3]) / 1.0).astype(int)
    assert labels.labels[tuple(index)] == 1
    assert labels.organ == "airway"


def test_another_seed_is_another_tree_and_the_same_one_the_same() -> None:
    assert np.array_equal(make_airway(seed=5).centreline, make_airway(seed=5).centreline)
    assert len({make_airway(seed=seed).length for seed in range(6)}) == 6
    with pytest.raises(InputError, match="seed is -1"):
        make_airway(seed=-1)


def test_command_writes_airways(tmp_path, capsys) -> None:  # type: ignore[no-untyped-def]
    line = ["phantom", "--organ", "airway", "--out"]
    assert main([*line, str(tmp_path / "a.nii.gz"), "--voxel", "2mm", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["ends"] == len(make_airway().ends)
    assert told["labels"] == {"airway": 1}
    assert main([*line, str(tmp_path / "a.stl"), "--voxel", "3mm"]) == 2
    assert "[0.2, 2] mm" in capsys.readouterr().err


def test_lungs_move_most_at_their_base_and_not_at_the_trachea() -> None:
    breath = Breathing.of_organ("airway", (-150.0, 60.0))
    heights = np.linspace(60.0, -150.0, 50)
    points = np.stack([np.zeros(50), np.zeros(50), heights], axis=1)
    moved = breath.at(0.5 * breath.period)(points)
    assert moved[0, 2] == pytest.approx(0.0, abs=1e-9)
    assert moved[-1, 2] == pytest.approx(breath.amplitude)
    assert (np.diff(moved[:, 2]) > 0.0).all()
    assert Breathing.of_organ("colon", (-150.0, 60.0)) == Breathing()

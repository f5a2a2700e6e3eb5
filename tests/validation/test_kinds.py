"""Errors of the robot of three sections by kind of motion: what belongs to which kind."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).resolve().parents[2] / "validation"


@pytest.fixture
def robot():
    sys.path.insert(0, str(FOLDER))
    yield importlib.import_module("three_section_robot")
    sys.path.remove(str(FOLDER))


def test_a_label_belongs_to_its_kind_of_motion(robot, tmp_path):
    labels = [
        "rep1_tendon0_id4_pull", "rep2_tendon0_id4_pull_hold", "rep1_seg1_circle",
        "rep1_seg3_dir180_hold", "rep12_pair13_opp_dir60", "rep1_pair23_same_dir0", "other",
    ]  # fmt: skip
    table = "\n".join(["pattern_label,x", *(f"{label},0" for label in labels)])
    (tmp_path / "train.csv").write_text(table + "\n")
    kinds = robot.read_kinds(tmp_path)
    assert kinds.tolist() == ["tendon", "tendon", "seg1", "seg3", "pair13", "pair23", ""]
    assert set(kinds.tolist()) - {""} <= set(robot.KINDS)


def test_every_row_has_a_kind_and_pairs_come_last(robot, data_dir):
    kinds = robot.read_kinds(data_dir("three_section_robot"))
    assert set(kinds.tolist()) == set(robot.KINDS)
    pairs = np.char.startswith(kinds, robot.PAIR)
    assert np.all(np.diff(pairs.astype(int)) >= 0) and pairs.any() and not pairs[0]

"""Insertion: force and energy agree, friction has its sign, loops and narrow places are found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bozzini.continuum import (
    ContactModel,
    ContactOptions,
    DriveTable,
    RobotDesign,
    Section,
    Tendon,
    insert_robot,
)
from bozzini.duct import RoundCones, SampledField
from bozzini.errors import FileFormatError, InputError


def make_robot(length: float = 70.0, *, stiffness: float = 500.0) -> RobotDesign:
    tendons = tuple(Tendon(name=f"T{k}", offset=2.5, angle=k * np.pi / 2.0) for k in range(4))
    section = Section(length=length, radius=3.0, tendons=tendons, bending_stiffness=stiffness)
    return RobotDesign((section,))


def bend_path(radius: float = 40.0, *, after: float = 30.0) -> NDArray[np.float64]:
    """A straight piece along z, a quarter circle towards x, and a straight piece."""
    angle = np.linspace(0.0, np.pi / 2.0, 25)
    bend = np.stack([1.0 - np.cos(angle), np.zeros(25), np.sin(angle)], axis=1) * radius
    ends = [[0.0, 0.0, -30.0]], [[radius + after, 0.0, radius]]
    return np.concatenate([ends[0], bend, ends[1]])


PATH = bend_path()
TUBE = RoundCones(PATH, np.full(len(PATH), 8.0))
OPTIONS = ContactOptions(segment_length=5.0)


def test_the_push_is_how_the_energy_changes_with_the_length() -> None:
    model = ContactModel(make_robot(), TUBE, options=OPTIONS)
    found = insert_robot(model, PATH, step=10.0, drives=DriveTable.passive(model.robot, 63.0))
    assert found.converged, found.reason
    assert found.push_force[-1] > 0.01
    placed = found.last
    model = ContactModel(placed.robot, TUBE, options=OPTIONS)
    low, high = (
        model.shape(inserted=placed.inserted + side * 0.01, initial=placed) for side in (-1, 1)
    )
    slope = (high.energy - low.energy) / 0.02
    assert placed.push_force == pytest.approx(slope, rel=1e-3)
    # The wall's force along the introducer is more: bent rods are pressed out of it.
    assert placed.push_force < -placed.resultant @ (0.0, 0.0, 1.0)
    assert np.all(found.tip_progress[1:] > found.tip_progress[:-1])
    assert np.isnan(found.buckled_at) and np.isnan(found.looped_at)


@pytest.mark.slow
def test_friction_holds_back_either_way() -> None:
    free = ContactModel(make_robot(), TUBE, options=OPTIONS)
    rough = ContactModel(
        make_robot(), TUBE, options=ContactOptions(segment_length=5.0, friction=0.2)
    )
    table = DriveTable(inserted=np.array([63.0, 60.0]), displacements=np.full((2, 4), np.nan))
    smooth = insert_robot(free, PATH, step=5.0, drives=table)
    found = insert_robot(rough, PATH, step=5.0, drives=table)
    assert found.converged, found.reason
    inward, outward = (int(np.argmax(smooth.inserted)), -1)
    assert found.push_force[inward] > 1.05 * smooth.push_force[inward]
    assert found.push_force[outward] < 0.95 * smooth.push_force[outward]


@pytest.mark.slow
def test_a_sampled_lumen_agrees_with_its_shapes() -> None:
    robot = make_robot(stiffness=300.0)
    table = DriveTable.passive(robot, 60.0)
    field = TUBE.sample(1.0)
    assert isinstance(field, SampledField)
    exact, sampled = (
        insert_robot(ContactModel(robot, duct, options=OPTIONS), PATH, step=10.0, drives=table)
        for duct in (TUBE, field)
    )
    assert exact.converged and sampled.converged, sampled.reason
    np.testing.assert_allclose(sampled.last.tip, exact.last.tip, atol=0.2)
    assert sampled.last.energy == pytest.approx(exact.last.energy, rel=0.15)


@pytest.mark.slow
def test_a_lumen_narrower_than_the_body_stops_it_with_the_place() -> None:
    line = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 40.0], [0.0, 0.0, 60.0], [0.0, 0.0, 100.0]])
    narrow = RoundCones(line, np.array([8.0, 8.0, 2.0, 2.0]))
    found = insert_robot(ContactModel(make_robot(), narrow, options=OPTIONS), line, step=5.0)
    assert not found.converged
    assert found.reason
    # The body, of radius 3 mm, stops where the cone is as wide.
    assert found.tip_progress.max() < 60.0


def test_tendon_drives_of_a_planner_are_followed(tmp_path: Path) -> None:
    robot = make_robot()
    file = tmp_path / "tendons.csv"
    file.write_text(
        "step,head_arc_length_mm,base_advance_mm,T0_mm,T1_mm,T2_mm,T3_mm\n"
        "0,10,10,0,0,0,0\n1,50,50,1.2,0,-1.2,0\n"
    )
    table = DriveTable.from_csv(file, robot)
    active = insert_robot(ContactModel(robot, TUBE, options=OPTIONS), PATH, step=5.0, drives=table)
    assert active.converged, active.reason
    np.testing.assert_allclose(active.last.displacements, [1.2, 0.0, -1.2, 0.0])
    assert active.last.tip[0] > 1.0
    file.write_text("base_advance_mm,T0_mm\n1,2\n")
    with pytest.raises(FileFormatError, match="no column 'T1_mm'"):
        DriveTable.from_csv(file, robot)
    file.write_text("base_advance_mm,T0_mm,T1_mm,T2_mm,T3_mm,\n10,0,0,0,0,7\n")
    with pytest.raises(FileFormatError, match="column 6 has no title and the number 7"):
        DriveTable.from_csv(file, robot)


def test_rigid_tendons_that_are_all_commanded_go_in_or_name_a_stiffness() -> None:
    tendons = tuple(Tendon(name=f"T{k}", offset=2.0, angle=k * 2 * np.pi / 3) for k in range(3))
    section = Section(length=60.0, radius=3.0, tendons=tendons, bending_stiffness=300.0)
    model = ContactModel(RobotDesign((section,)), TUBE, options=OPTIONS)
    rows = np.array([[0.0, 0.0, 0.0], [0.4, -0.2, -0.2]])
    drives = DriveTable(inserted=np.array([10.0, 45.0]), displacements=rows)
    found = insert_robot(model, PATH, step=5.0, drives=drives)
    assert found.converged, found.reason
    np.testing.assert_allclose(found.last.displacements, rows[-1])
    # Lengths that contradict each other end at once.
    drives = DriveTable(inserted=np.array([10.0, 45.0]), displacements=rows + [0.0, 0.0, 0.5])
    found = insert_robot(model, PATH, step=5.0, drives=drives)
    assert not found.converged
    assert "there is an equilibrium; state theirs" in found.reason
    assert found.reason.startswith("at 10 mm: ")


def test_rows_that_are_near_each_other_are_taken_together() -> None:
    # In to 30 mm by rows a quarter of a millimetre apart, 10 mm back and in again.
    there = np.concatenate([np.arange(0.0, 30.0, 0.25), np.arange(30.0, 20.0, -0.25), [28.0]])
    pulled = np.column_stack([0.1 * there, np.full(len(there), np.nan)])
    steps = list(DriveTable(inserted=there, displacements=pulled).list_steps(4.0, 3.0))
    lengths = np.array([length for length, _ in steps])
    assert np.abs(np.diff(lengths)).max() <= 3.0 + 1e-9
    assert len(lengths) < 20
    assert lengths.max() == 30.0 and lengths[-1] == 28.0
    assert lengths[np.argmax(lengths) :].min() == 20.25
    np.testing.assert_allclose([row[0] for _, row in steps], 0.1 * lengths, atol=1e-12)
    assert np.isnan([row[1] for _, row in steps]).all()


def test_results_are_tables_pictures_and_plain_values() -> None:
    model = ContactModel(make_robot(), TUBE, options=OPTIONS)
    found = insert_robot(model, PATH, step=20.0, drives=DriveTable.passive(model.robot, 50.0))
    assert len(found.to_frame()) == len(found.shapes)
    assert found.to_dict()["last"]["inserted_mm"] == pytest.approx(50.0)
    assert found.plot() is not None and found.plot_force() is not None
    contacts = found.list_contacts()
    assert len(contacts["normal_force_N"]) == sum(
        int(np.count_nonzero(shape.normal_forces)) for shape in found.shapes
    )


def test_wrong_input_is_refused_in_one_line() -> None:
    robot = make_robot()
    model = ContactModel(robot, TUBE)
    with pytest.raises(InputError, match=r"path has shape \(1, 3\)"):
        insert_robot(model, PATH[:1])
    with pytest.raises(InputError, match="must be at most 70 mm"):
        insert_robot(model, PATH, drives=DriveTable.passive(robot, 80.0))
    with pytest.raises(InputError, match="there is no wall"):
        ContactModel(robot)
    with pytest.raises(InputError, match="duct is 3: it must be a duct"):
        ContactModel(robot, 3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="needs as much there"):
        insert_robot(model, PATH + np.array([7.0, 0.0, 0.0]))
    with pytest.raises(InputError, match=r"inserted is 100 mm: it must lie in \(0, 70\] mm"):
        model.shape(inserted=100.0)


def test_tendons_that_end_in_the_introducer_do_nothing() -> None:
    def make(name: str, length: float, angle: float) -> Section:
        tendon = Tendon(name=name, offset=2.0, angle=angle)
        return Section(length=length, radius=3.0, tendons=(tendon,), bending_stiffness=300.0)

    robot = RobotDesign((make("T1", 30.0, 0.0), make("T2", 30.0, np.pi)))
    # The end of T1, 30 mm before the tip, passes the introducer's at any part of a segment.
    table = DriveTable(
        inserted=np.array([31.7, 28.3]), displacements=np.array([[0.0, 0.3], [0.0, 0.3]])
    )
    found = insert_robot(ContactModel(robot, TUBE, options=OPTIONS), PATH, step=1.0, drives=table)
    assert found.converged, found.reason
    assert found.last.tensions[0] == 0.0 and found.last.tensions[1] > 0.0

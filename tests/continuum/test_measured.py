"""Tables of commands and points: units, gaps, and one line for what is wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bozzini.continuum import (
    ContinuumRobot,
    Marker,
    Section,
    Tendon,
    read_robot_measurements,
)
from bozzini.errors import FileFormatError, InputError, UnitError

ROBOT = ContinuumRobot(
    (
        Section(
            length=50.0,
            radius=5.0,
            tendons=(Tendon(name="T1", offset=4.0), Tendon(name="T2", offset=4.0, angle=2.0)),
        ),
    )
)
M1 = Marker(name="m_1", arc_length=20.0, offset=(0.0, 0.0, 1.0))
HEAD = "T1 displacement [mm],T2 displacement [0.1 mm],tip x [m],tip y [mm],tip_z [mm]"


def read(folder, text, **options):
    path = folder / "rows.csv"
    path.write_text(text)
    return read_robot_measurements(path, robot=ROBOT, **options)


def test_units_are_in_the_titles(tmp_path):
    data = read(tmp_path, f"{HEAD}\n1,20,0.005,6,7\n")
    assert data.command == "displacement"
    assert data.commands == pytest.approx(np.array([[1.0, 2.0]]))
    assert data.points == pytest.approx(np.array([[[5.0, 6.0, 7.0]]]))
    assert [marker.name for marker in data.markers] == ["tip"]


def test_places_that_are_empty_were_not_seen(tmp_path):
    head = f"{HEAD},m_1_x [mm],m_1_y [mm],m_1_z [mm]"
    data = read(tmp_path, f"{head}\n0,0,,6,7,1,2,3\n0,0,nan,,,,,\n0,0,0,1,2,,,\n", markers=[M1])
    # The row without a point stays: its command is the history of the next one.
    assert len(data) == 3
    assert data.seen_rows.tolist() == [0, 2]
    assert np.isnan(data.points[:, :, 0]).tolist() == [[True, False], [True, True], [False, True]]
    assert any("1 row(s) without a point" in note for note in data.notes)


def test_titles_of_the_file_can_be_others(tmp_path):
    text = "a,b,x,y,z\n1,2,3,4,5\n"
    columns = {"a": "T1 tension [N]", "b": "T2 tension [N]"}
    columns |= {axis: f"tip {axis} [mm]" for axis in "xyz"}
    assert read(tmp_path, text, columns=columns).command == "tension"


@pytest.mark.parametrize(
    ("text", "kind", "words"),
    [
        ("tip x [mm],tip y [mm],tip z [mm]\n1,2,3\n", FileFormatError, "no column with a command"),
        ("T1 displacement [mm]\n1\n", FileFormatError, "no column with a point"),
        (HEAD.replace("T2", "T9") + "\n1,1,1,1,1\n", InputError, "there is no tendon 'T9'"),
        (HEAD.replace(" [m]", "") + "\n1,1,1,1,1\n", UnitError, "'tip x' has no unit"),
        (HEAD.replace("[m]", "[N]") + "\n1,1,1,1,1\n", UnitError, "column 'tip x"),
        (HEAD + "\n1,one,1,1,1\n", FileFormatError, "row 2: 'T2 displacement.* is 'one'"),
        (HEAD + "\n1,1,1\n", FileFormatError, "row 2: it has 3 cell"),
        (HEAD + "\n1,1,,,\n", InputError, "no point was seen"),
        (HEAD + ",T1 tension [N]\n1,1,1,1,1,1\n", FileFormatError, "give one kind"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path, text, kind, words):
    with pytest.raises(kind, match=words) as caught:
        read(tmp_path, text)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("rows.csv: ")


def test_every_tendon_needs_a_displacement(tmp_path):
    text = "T1 displacement [mm],tip x [mm],tip y [mm],tip z [mm]\n1,2,3,4\n"
    with pytest.raises(InputError, match="T2 displacement"):
        read(tmp_path, text).order_commands(ROBOT)
    tensions = read(tmp_path, text.replace("displacement [mm]", "tension [N]"))
    assert tensions.order_commands(ROBOT).tolist() == [[1.0, 0.0]]


def test_rows_in_the_order_of_time_are_known_as_such(tmp_path):
    turn = np.linspace(0.0, 2.0 * math.pi, 40)
    lines = [f"0,0,{0.01 * math.cos(a):.6f},{10 * math.sin(a):.4f},50" for a in turn]
    assert read(tmp_path, "\n".join([HEAD, *lines])).is_ordered
    mixed = np.random.default_rng(0).permutation(lines).tolist()
    assert not read(tmp_path, "\n".join([HEAD, *mixed])).is_ordered


TRACKED = """row,T1 displacement [mm],T2 displacement [mm],marker,x_mm,y_mm,z_mm,u_x_mm,status
1,0.5,1,tip,5,6,7,0.1,ok
1,0.5,1,m_1,1,2,3,0.1,ok
2,0.7,1,tip,8,9,10,0.1,ok
2,0.7,1,m_1,,,,,failed
"""


def test_a_table_with_a_row_for_each_point_is_one_with_a_row_for_each_moment(tmp_path):
    data = read(tmp_path, TRACKED, markers=[M1])
    wide = (
        "T1 displacement [mm],T2 displacement [mm],tip x [mm],tip y [mm],tip z [mm],m_1 x [mm],"
        "m_1 y [mm],m_1 z [mm]\n0.5,1,5,6,7,1,2,3\n0.7,1,8,9,10,,,\n"
    )
    same = read(tmp_path, wide, markers=[M1])
    assert np.array_equal(data.points, same.points, equal_nan=True)
    assert np.array_equal(data.commands, same.commands)
    with pytest.raises(FileFormatError, match="marker 'tip' is in row 1 twice"):
        read(tmp_path, TRACKED + "1,0.5,1,tip,5,6,7,0.1,ok\n", markers=[M1])

"""A head in the cockpit: cameras, slide, targets."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.cockpit.drive import SEEN, EffectorDrive
from bozzini.cockpit.head import HeadDrive
from bozzini.cockpit.session import Session, ShownPlan
from bozzini.cockpit.wire import MessageError, read_message
from bozzini.effector import Effector
from bozzini.errors import InputError
from bozzini.head import Head, HeadCamera, PlacedEffector, list_touches, stand_head
from bozzini.head.operate import TargetTask
from tests.cockpit.conftest import make_plan
from tests.head.test_reach import make_tube

STEP = 10


def show_tube() -> tuple[ShownPlan, HeadDrive]:
    duct, plan = make_tube()
    shown = ShownPlan(
        view=b"view",
        joints=plan.joints.astype(np.float32),
        clearance=plan.clearance.astype(np.float32),
        travel=plan.head_arc_length,
        radius=6.0,
        wall=duct,
    )
    return shown, HeadDrive(Head(), targets=3)


def test_still_camera_stays_and_the_one_on_the_tip_leans_with_it() -> None:
    plan, drive = show_tube()
    rest = {name: None for name in ("still", "tip")}
    for name in rest:
        drive.command_head(name, plan, STEP)
        rest[name] = drive.place(plan, STEP).camera
    for travel in ((0.4, 0.0), (-0.2, 0.4), (0.1, -0.5)):
        drive.hold(np.array(travel))
        drive.command_head("still", plan, STEP)
        drive.slide(0.5)
        assert np.array_equal(drive.place(plan, STEP).camera, rest["still"])
        drive.command_head("tip", plan, STEP)
        place, way, up = drive.place(plan, STEP).camera
        lean = math.acos(float(drive.effector.forward(drive.state.measured).direction[2]))
        assert math.acos(way @ rest["tip"][1]) == pytest.approx(lean, abs=1e-6)
        assert way @ up == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("azimuth", [0.5 * math.pi, 0.3])
@pytest.mark.parametrize("travel", [(0.3, 0.0), (0.0, 0.25), (-0.2, 0.1)])
def test_stick_moves_the_tip_as_the_still_picture_shows_it(azimuth, travel) -> None:
    plan, _ = show_tube()
    drive = HeadDrive(Head(camera=HeadCamera(azimuth=azimuth)))
    camera = drive.head.look()
    frame, origin = plan.frames[STEP], plan.joints[STEP, 0]
    drive.slide(0.2)
    spots = []
    for each in ((0.0, 0.0), travel):
        drive.hold(np.array(each))
        tip = drive.place(plan, STEP).tip[-1]
        spots.append(camera.project((tip - origin) @ frame.T))
    right, down = spots[1] - spots[0]
    assert right * travel[0] >= 0.0 and -down * travel[1] >= 0.0
    assert abs(right) > 5.0 or not travel[0]
    assert abs(right) < 0.1 * abs(down) or travel[0]


def test_it_is_said_where_the_camera_has_no_room() -> None:
    plan, drive = show_tube()
    drive.place(plan, STEP)
    assert not drive.state.note
    drive.place(replace(plan, wall=make_tube(20.0)[0]), STEP)
    assert "the camera's arm goes through the wall" in drive.state.note


def show_two(apart: float = 10.0) -> tuple[ShownPlan, HeadDrive]:
    two = [PlacedEffector(x=x, turn=turn) for x, turn in ((-0.5 * apart, 0.4), (0.5 * apart, -1.0))]
    return show_tube()[0], HeadDrive(Head(diameter=apart + 14.0, effectors=tuple(two)))


def place_parts(drive: HeadDrive, plan: ShownPlan) -> dict[str, np.ndarray]:
    """Return the bodies' lines by name, in the head's frame."""
    points = (drive.place(plan, STEP).tip - plan.joints[STEP, 0]) @ plan.frames[STEP].T
    parts = drive.describe()["head"]["parts"]
    ends = np.cumsum([part["points"] for part in parts])
    assert ends[-1] == len(points)
    lines = np.split(points, ends[:-1])
    return {part["name"]: line for part, line in zip(parts, lines, strict=True)}


def test_each_end_effector_is_steered_and_the_other_stays() -> None:
    plan, drive = show_two()
    rest = place_parts(drive, plan)
    names = [f"{what} {k}" for k in (1, 2) for what in ("end-effector", "instrument")]
    assert list(rest) == ["camera's arm", "camera", *names]
    first, second = np.array([-0.4, 0.1]), np.array([0.2, 0.3])
    drive.hold(first)
    drive.slide(0.5)
    given = [drive.state.measured]
    one = place_parts(drive, plan)
    drive.command_head("2", plan, STEP)
    for travel in (first, np.zeros(2), second):  # held still, let go, moved
        kept = place_parts(drive, plan)
        assert all(np.array_equal(kept[name], one[name]) for name in one)
        drive.hold(travel)
    drive.slide(1.0)
    given.append(drive.state.measured)
    both = place_parts(drive, plan)
    assert [name for name in one if not np.array_equal(both[name], one[name])] == names[2:]
    pose = drive.head.forward(given)
    for k, name in enumerate(names[::2]):
        assert both[name] == pytest.approx(pose.bodies[k], abs=1e-9)
    assert both["instrument 2"][1] == pytest.approx(pose.tip[1], abs=1e-9)
    tool = one["instrument 1"]
    assert np.linalg.norm(tool[1] - tool[0]) == pytest.approx(10.0)
    drive.hold(np.zeros(2))
    drive.command_head("1", plan, STEP)
    drive.hold(np.zeros(2))
    again = place_parts(drive, plan)
    assert np.array_equal(again["end-effector 1"], one["end-effector 1"])
    assert drive.tell()["effector"] == 1 and drive.tell()["out"] == 0.5
    assert drive.state.tip == pytest.approx(np.array(drive.turn.T @ drive._poses[0].bends[0]))


def test_collision_of_two_instruments_is_noted() -> None:
    plan, drive = show_two(24.0)
    for number, way in ((1, -1.0), (2, 1.0)):  # to the left there is +x
        drive.command_head(str(number), plan, STEP)
        drive.hold(np.zeros(2))
        drive.hold(np.array([0.45 * way, 0.0]))
        drive.place(plan, STEP)
        assert ("end-effector 1 and end-effector 2 overlap" in drive.state.note) == (number == 2)
    given = [drive.placed.effector.inverse(pose.bends[0]).pressures for pose in drive._poses]
    drive.slide(1.0)
    drive.slide(1.0, 1)
    drive.place(plan, STEP)
    assert drive.state.note == drive.head.forward(given).reason
    drive.hold(np.array([-0.45, 0.0]))
    drive.place(plan, STEP)
    assert not drive.state.note


def test_another_instrument_neither_goes_the_way_to_it_nor_touches_by_staying() -> None:
    task = TargetTask(np.array([[10.0, 0.0, 0.0]]))
    for at in (0.0, 1.0):
        task.take(at, np.array([at, 0.0, 0.0]), touches=False)
    task.change_instrument()
    for touches in (True, True, False, True):
        assert not task.rows
        task.take(2.0, np.array([10.0, 0.0, 0.0]), touches=touches)
    assert [(row.path, row.error) for row in task.rows] == [(1.0, 0.0)]


def test_end_effector_that_is_not_there_is_refused() -> None:
    plan, drive = show_two()
    with pytest.raises(InputError, match=r"^end-effector is 3: it must .* 2[^\n]*$"):
        drive.command_head("3", plan, STEP)
    with pytest.raises(InputError, match="end-effector is 3"):
        drive.slide(0.5, 3)
    session = Session()
    session.drive, drive.state = drive, replace(drive.state, note="two overlap")
    session.take(session.open(), read_message('{"kind": "head", "what": "3"}'))
    assert session.describe()["note"].startswith("two overlap; end-effector is 3: ")
    assert drive.number == 1
    for wrong in ('"head", "what": "4"', '"slide", "out": 0.5, "effector": 0'):
        with pytest.raises(MessageError):
            read_message(f'{{"kind": {wrong}}}')


@pytest.mark.parametrize(("show", "number", "count"), [(show_tube, 1, 3), (show_two, 2, 1)])
def test_instrument_stops_at_the_wall_and_that_is_a_touch(show, number, count) -> None:
    plan, drive = show()
    drive.count = count
    drive.command_head(str(number), plan, STEP)
    drive.hold(np.zeros(2))
    drive.command_head("targets", plan, STEP)
    assert drive.sum_up().reason == f"{count} of {count} targets are left"
    duct, known = make_tube()
    stand = replace(stand_head(known, 100.0), frame=plan.frames[STEP].T)
    chosen = list_touches(drive.head, stand, duct=duct, number=number).choose(count)
    assert drive.task.targets == pytest.approx(chosen.place, abs=1e-3)
    for bend in chosen.bends:
        drive.hold(SEEN * (bend @ drive.turn) / drive.scale)
        for out in (0.0, 1.0):
            drive.slide(out)
            body = drive.place(plan, STEP)
        assert body.gap == pytest.approx(0.0, abs=0.05)
    drive.slide(0.0)
    drive.place(plan, STEP)
    run = drive.sum_up()
    assert run.converged and len(run.rows) == count
    assert run.error < 0.5 and run.camera == "still"


def test_messages_reach_the_head_and_are_refused_without_one() -> None:
    plan, drive = show_tube()
    session = Session()
    session.drive = drive
    session.show(plan)
    session.go_to(STEP)
    window = session.open()
    session.take(window, read_message('{"kind": "slide", "out": 0.5}'))
    session.take(window, read_message('{"kind": "head", "what": "tip"}'))
    session.take(window, read_message('{"kind": "head", "what": "targets"}'))
    told = session.describe()["head"]
    assert (told["out"], told["camera"], len(told["targets"])) == (0.5, "tip", 3)
    session.show(replace(make_plan(), wall=None))
    session.plan = replace(session.plan, wall=None)
    session.take(window, read_message('{"kind": "head", "what": "targets"}'))
    assert "no wall" in session.describe()["note"]
    session.drive = EffectorDrive(Effector.from_preset("prototype"))
    session.take(window, read_message('{"kind": "slide", "out": 0.5}'))
    assert "there is no head" in session.describe()["note"]
    assert session.describe()["head"] is None
    for wrong in ('"slide", "out": 2', '"head", "what": "up"'):
        with pytest.raises(MessageError):
            read_message(f'{{"kind": {wrong}}}')


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--targets", "3"], "--targets has no effect without --head"),
        (["--head", "default", "--rig", "demo"], "--rig cannot be used with --head"),
        (["--head", "default", "--operator", "line"], "--operator cannot be used with --head"),
        (["--head", "default", "--moving", "breathing"], "--moving cannot be used with --head"),
        (["--head", "nothing.yaml"], "cannot read nothing.yaml"),
        (["--out", "a.csv"], "--out has no effect without --operator or --head"),
    ],
)
def test_wrong_options_are_one_line(more, said, capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["cockpit", "--port", "0", "--no-browser", *more]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line

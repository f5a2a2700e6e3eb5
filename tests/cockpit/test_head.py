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
from bozzini.head import Head, HeadCamera, PlacedEffector, list_touches, stand_head
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


def test_end_effectors_that_rest_are_drawn_too() -> None:
    plan, _ = show_tube()
    apart = [PlacedEffector(x=x) for x in (-5.0, 5.0)]
    drive = HeadDrive(Head(diameter=24.0, effectors=tuple(apart)))
    rest = drive.place(plan, STEP).tip
    drive.hold(np.array([0.5, 0.0]))
    drive.slide(0.5)
    moved = drive.place(plan, STEP).tip
    ends = np.cumsum([0, *(part["points"] for part in drive.describe()["head"]["parts"])])
    stood = [np.array_equal(rest[a:b], moved[a:b]) for a, b in zip(ends, ends[1:], strict=False)]
    names = [part["name"] for part in drive.describe()["head"]["parts"]]
    assert names == ["camera's arm", "camera", "end-effector 2", "end-effector", "instrument"]
    assert stood == [True, True, True, False, False] and len(rest) == ends[-1]


def test_instrument_stops_at_the_wall_and_that_is_a_touch() -> None:
    plan, drive = show_tube()
    drive.command_head("targets", plan, STEP)
    assert drive.sum_up().reason == "3 of 3 targets are left"
    duct, known = make_tube()
    stand = replace(stand_head(known, 100.0), frame=plan.frames[STEP].T)
    chosen = list_touches(Head(), stand, duct=duct).choose(3)
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
    assert run.converged and len(run.rows) == 3
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

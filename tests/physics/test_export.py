"""Files for other tools, each read by its own parser."""

from __future__ import annotations

import dataclasses
import runpy
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from bozzini.physics.export import format_mjcf, format_trajectory, format_urdf
from bozzini.physics.log import write_execution_log, write_plan_log
from bozzini.physics.options import ExecuteOptions, WallOptions
from bozzini.physics.robots import PlanDrive
from bozzini.physics.simulate import Dynamics
from bozzini.physics.study import Scenery


def test_mujoco_reads_the_scene_and_has_the_wall(clear: Scenery) -> None:
    wall = dataclasses.replace(clear, wall=WallOptions(kind="prism", faces=600)).make_wall("plan")
    model = mujoco.MjModel.from_xml_string(format_mjcf(clear.plan, wall))
    assert model.nmesh == len(wall.prisms.corners)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert 1e3 * data.site("tip").xpos == pytest.approx(clear.plan.joints[0, 0], abs=1e-4)
    assert data.ncon == 0
    # The wall is where it was: each corner is on it.
    geom = model.geom("wall0").id
    mesh = model.geom_dataid[geom]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    corners = model.mesh_vert[first : first + count] @ data.geom_xmat[geom].reshape(3, 3).T
    corners = 1e3 * (corners + data.geom_xpos[geom])
    gaps = np.linalg.norm(corners[:, None] - wall.prisms.corners[0], axis=2)
    assert gaps.min(axis=0).max() < 1e-3


def test_a_scene_in_metres_moves_as_one_in_millimetres(clear: Scenery) -> None:
    drive, wall = PlanDrive(clear.plan), clear.make_wall("plan")
    here = drive.chain.to_spec(Dynamics(), None).compile()
    there = mujoco.MjModel.from_xml_string(format_mjcf(clear.plan, wall))
    assert there.body_mass == pytest.approx(here.body_mass, rel=1e-6)
    assert there.body_inertia == pytest.approx(1e-6 * here.body_inertia, rel=1e-6)
    ends = []
    for model, unit in ((here, 1.0), (there, 1e-3)):
        data = mujoco.MjData(model)
        data.qpos[:], data.ctrl[:] = drive.start, drive.table[20]
        data.qpos[0], data.ctrl[0] = unit * data.qpos[0], unit * data.ctrl[0]
        mujoco.mj_step(model, data, nstep=50)
        ends.append(data.site("tip").xpos / unit)
    assert np.linalg.norm(ends[0] - clear.plan.joints[0, 0]) > 1.0
    assert ends[1] == pytest.approx(ends[0], abs=1e-3)


def test_the_player_takes_the_tip_to_the_end_of_the_plan(clear: Scenery, tmp_path) -> None:
    player = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "play_plan.py"))
    files = tmp_path / "scene.xml", tmp_path / "trajectory.yaml"
    files[0].write_text(format_mjcf(clear.plan, clear.make_wall("plan")))
    files[1].write_text(format_trajectory(clear.plan, speed=100.0))
    tip = 1e3 * player["play"](*files).site("tip").xpos
    assert tip == pytest.approx(clear.plan.joints[-1, 0], abs=0.1)


def read_log(path) -> dict[str, list[tuple[int, object]]]:
    found: dict[str, list[tuple[int, object]]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for each in reader.iter_decoded_messages():
            found.setdefault(each.channel.topic, []).append(
                (each.message.log_time, each.decoded_message)
            )
    return found


def test_rosbags_reads_a_log_and_its_trajectory_as_the_file_has_them(
    clear: Scenery, tmp_path
) -> None:
    plan = clear.plan
    path = write_plan_log(plan, tmp_path / "plan.mcap", speed=10.0)
    ours = read_log(path)
    counts: dict[str, int] = {}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, time, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            number = counts.setdefault(connection.topic, 0)
            stamp, own = ours[connection.topic][number]
            assert time == stamp
            counts[connection.topic] += 1
            if connection.topic == "/joint_states":
                assert list(message.name) == list(own.name)
                assert message.position.tolist() == list(own.position)
            if connection.topic == "/tf":
                for there, here in zip(message.transforms, own.transforms, strict=True):
                    assert there.child_frame_id == here.child_frame_id
                    there, here = there.transform.translation, here.transform.translation
                    assert read_point(there) == read_point(here)
    assert counts == {topic: len(messages) for topic, messages in ours.items()}


def test_what_is_sent_to_a_controller_is_a_message_of_ros(clear: Scenery, tmp_path) -> None:
    sender = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "send_plan.py"))
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}

    def make_point(**fields):
        arrays = {name: np.array(fields.pop(name), dtype=np.float64) for name in list(fields)[:4]}
        return types["JointTrajectoryPoint"](**arrays, **fields)

    file = tmp_path / "trajectory.yaml"
    file.write_text(format_trajectory(clear.plan, speed=10.0))
    message = sender["make_message"](file, {**types, "JointTrajectoryPoint": make_point})
    kind = "trajectory_msgs/msg/JointTrajectory"
    back = store.deserialize_cdr(store.serialize_cdr(message, kind), kind)
    drive = PlanDrive(clear.plan, 10.0)
    rows = np.array([point.positions for point in back.points])
    assert len(back.joint_names) == rows.shape[1] == drive.table.shape[1]
    assert 1e3 * rows[:, 0] == pytest.approx(drive.table[:, 0], abs=1e-5)
    ends = [point.time_from_start for point in back.points]
    assert [end.sec + 1e-9 * end.nanosec for end in ends] == pytest.approx(drive.times, abs=1e-9)


def read_point(point) -> list[float]:
    return [point.x, point.y, point.z]


def test_a_log_of_a_plan_has_its_chain_and_its_wall(clear: Scenery, tmp_path) -> None:
    plan, drive = clear.plan, PlanDrive(clear.plan, 10.0)
    corners = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0]])
    wall = corners, np.array([[0, 2, 1]])
    log = read_log(write_plan_log(plan, tmp_path / "plan.mcap", wall=wall, speed=10.0))
    assert log["/robot_description"][0][1].data == format_urdf(plan)
    (_, trajectory), = log["/trajectory"]  # fmt: skip
    states = [state for _, state in log["/joint_states"]]
    assert list(trajectory.joint_names) == list(states[0].name)
    rows = np.array([point.positions for point in trajectory.points])
    assert rows == pytest.approx(np.array([state.position for state in states]), abs=1e-9)
    assert 1e3 * rows[:, 0] == pytest.approx(drive.table[:, 0], abs=1e-5)
    times = [state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec for state in states]
    assert times == pytest.approx(drive.times, abs=1e-9)
    assert [1e-9 * time for time, _ in log["/tf"]] == pytest.approx(drive.times, abs=1e-9)
    # The frames are those of MuJoCo's reader of the URDF.
    model = mujoco.MjModel.from_xml_string(format_urdf(plan))
    data = mujoco.MjData(model)
    data.qpos[:] = states[-1].position
    mujoco.mj_forward(model, data)
    *links, tip = log["/tf"][-1][1].transforms
    for frame in links:
        body = data.body(frame.child_frame_id)
        turn = frame.transform.rotation
        matrix = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
        assert matrix == pytest.approx(body.xmat.reshape(3, 3), abs=1e-6)
        assert read_point(frame.transform.translation) == pytest.approx(body.xpos, abs=1e-7)
    head = 1e-3 * plan.joints[-1, 0]
    assert read_point(tip.transform.translation) == pytest.approx(head, abs=1e-7)
    (body,) = log["/scope"][-1][1].markers
    shown = [read_point(point) for point in body.points]
    assert shown == pytest.approx(1e-3 * plan.joints[-1], abs=1e-9)
    assert body.scale.x == pytest.approx(1e-3 * plan.get_scope().diameter)
    (surface,) = log["/wall"][0][1].markers
    assert [read_point(p) for p in surface.points] == pytest.approx(1e-3 * corners[[0, 2, 1]])


def test_a_log_of_a_driven_motion_has_its_contacts(touching: Scenery, tmp_path) -> None:
    found = touching.run(ExecuteOptions(speed=100.0, step=4e-3))
    log = read_log(write_execution_log(found, tmp_path / "plan.mcap"))
    assert len(log["/scope"]) == len(log["/push_force"]) == len(found.time)
    total = np.zeros(3)
    for time, contact in log["/contacts"]:
        row = int(np.argmin(np.abs(found.time - 1e-9 * time)))
        (frame,) = (
            frame
            for moment, message in log["/tf"]
            for frame in message.transforms
            if moment == time and frame.child_frame_id == contact.header.frame_id
        )
        link = int(contact.header.frame_id.removeprefix("joint"))
        start = found.joints[row, ::-1][link]
        assert 1e3 * np.array(read_point(frame.transform.translation)) == pytest.approx(start)
        mine = found.touched[(found.touched[:, 0] == row) & (found.touched[:, 1] == link)]
        turned = np.cross(mine[:, 2:5] - start, mine[:, 5:8]).sum(axis=0)
        torque = read_point(contact.wrench.torque)
        assert 1e3 * np.array(torque) == pytest.approx(turned, abs=1e-9)
        total += read_point(contact.wrench.force)
    assert np.linalg.norm(total) > 0.0
    assert total == pytest.approx(found.touched[:, 5:8].sum(axis=0))


def test_mujoco_reads_the_urdf_and_has_the_same_chain(clear: Scenery) -> None:
    model = mujoco.MjModel.from_xml_string(format_urdf(clear.plan))
    drive = PlanDrive(clear.plan)
    data = mujoco.MjData(model)
    for step in (0, -1):
        data.qpos[:] = drive.table[step]
        data.qpos[0] *= 1e-3
        mujoco.mj_forward(model, data)
        last = model.body(f"link{clear.plan.links - 1}").id
        length = float(drive.chain.lengths[-1])
        tip = 1e3 * data.xpos[last] + length * data.xmat[last, [2, 5, 8]]
        assert tip == pytest.approx(clear.plan.joints[step, 0], abs=1e-4)


def test_a_trajectory_goes_where_the_plan_goes(clear: Scenery) -> None:
    message = yaml.safe_load(format_trajectory(clear.plan, speed=10.0))
    urdf = format_urdf(clear.plan)
    assert all(f'name="{name}"' in urdf for name in message["joint_names"])
    times = [
        point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"]
        for point in message["points"]
    ]
    assert (np.diff(times) > 0.0).all()
    drive = PlanDrive(clear.plan, 10.0)
    rows = np.array([point["positions"] for point in message["points"]])
    assert rows[:, 1:] == pytest.approx(drive.table[:, 1:], abs=1e-8)
    assert 1e3 * rows[:, 0] == pytest.approx(drive.table[:, 0], abs=1e-5)

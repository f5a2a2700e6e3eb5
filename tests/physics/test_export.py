"""Files for other tools, each read by its own parser."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest
import yaml

from bozzini.physics.export import format_mjcf, format_trajectory, format_urdf
from bozzini.physics.options import WallOptions
from bozzini.physics.robots import PlanDrive
from bozzini.physics.study import Scenery


def test_mujoco_reads_the_scene_and_has_the_wall(clear: Scenery) -> None:
    wall = dataclasses.replace(clear, wall=WallOptions(kind="prism", faces=600)).make_wall("plan")
    model = mujoco.MjModel.from_xml_string(format_mjcf(clear.plan, wall))
    assert model.nmesh == len(wall.prisms.corners)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.site("tip").xpos == pytest.approx(clear.plan.joints[0, 0], abs=1e-4)
    assert data.ncon == 0
    # The wall is where it was: each corner is on it.
    geom = model.geom("wall0").id
    mesh = model.geom_dataid[geom]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    corners = model.mesh_vert[first : first + count] @ data.geom_xmat[geom].reshape(3, 3).T
    corners = corners + data.geom_xpos[geom]
    gaps = np.linalg.norm(corners[:, None] - wall.prisms.corners[0], axis=2)
    assert gaps.min(axis=0).max() < 1e-3


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

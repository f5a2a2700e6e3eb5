"""Play a plan in MuJoCo: its joints are driven by servos, and touch the wall if it comes to that.

    bozzini export mujoco plan.npz tract.stl --out scene.xml
    bozzini export ros2 plan.npz --out trajectory.yaml
    python examples/play_plan.py scene.xml trajectory.yaml

Both files are in metres, and have the same joints.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import mujoco
import numpy as np
import yaml


def play(scene, trajectory, *, show=lambda model, data: None):
    """Drive the joints of a scene as a trajectory says; `show` is called after each step."""
    model = mujoco.MjModel.from_xml_path(str(scene))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    message = yaml.load(Path(trajectory).read_text("utf-8"), yaml.CSafeLoader)
    servos = [model.actuator(name).id for name in message["joint_names"]]
    rows = np.array([point["positions"] for point in message["points"]])
    stamps = [point["time_from_start"] for point in message["points"]]
    times = [stamp["sec"] + 1e-9 * stamp["nanosec"] for stamp in stamps]
    while data.time < times[-1] + 0.3:  # then it comes to rest
        data.ctrl[servos] = [np.interp(data.time, times, column) for column in rows.T]
        mujoco.mj_step(model, data)
        show(model, data)
    return data


def main(scene, trajectory):
    """Play in a window, at the speed of the plan."""
    from mujoco.viewer import launch_passive

    windows = []

    def show(model, data):
        if not windows:
            windows.append((launch_passive(model, data), time.monotonic()))
        window, begin = windows[0]
        if data.time // 0.02 != (data.time - model.opt.timestep) // 0.02:
            window.sync()
            time.sleep(max(begin + data.time - time.monotonic(), 0.0))

    tip = play(scene, trajectory, show=show).site("tip").xpos
    print(f"The tip ends at {np.round(1e3 * tip, 2)} mm.")


if __name__ == "__main__":
    main(*sys.argv[1:])

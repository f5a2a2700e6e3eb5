"""Send a plan to a controller of ROS 2 that follows trajectories, and wait until it is done.

    bozzini export ros2 plan.npz --out trajectory.yaml
    python examples/send_plan.py trajectory.yaml /joint_trajectory_controller

Metres, radians and seconds; the joints are those of `bozzini export urdf`. It needs rclpy, and a
joint_trajectory_controller (ros2_control) of these joints.
"""

from __future__ import annotations

import sys
from pathlib import Path

import yaml


def make_message(file, types):
    """Return the trajectory in a file as a message; `types` has the classes of messages by name."""
    stated = yaml.load(Path(file).read_text("utf-8"), yaml.CSafeLoader)
    points = [
        types["JointTrajectoryPoint"](
            positions=point["positions"],
            velocities=[],
            accelerations=[],
            effort=[],
            time_from_start=types["Duration"](**point["time_from_start"]),
        )
        for point in stated["points"]
    ]
    header = types["Header"](stamp=types["Time"](sec=0, nanosec=0), frame_id="")  # from now on
    names = stated["joint_names"]
    return types["JointTrajectory"](header=header, joint_names=names, points=points)


def main(file, controller):
    """Send a trajectory, and tell how it ended."""
    import rclpy
    from builtin_interfaces.msg import Duration, Time
    from control_msgs.action import FollowJointTrajectory
    from rclpy.action import ActionClient
    from std_msgs.msg import Header
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    kinds = (Duration, Time, Header, JointTrajectory, JointTrajectoryPoint)
    message = make_message(file, {kind.__name__: kind for kind in kinds})
    rclpy.init()
    node = rclpy.create_node("bozzini_plan")
    client = ActionClient(node, FollowJointTrajectory, f"{controller}/follow_joint_trajectory")
    if not client.wait_for_server(timeout_sec=10.0):
        sys.exit(f"no controller answers at {controller}")
    sent = client.send_goal_async(FollowJointTrajectory.Goal(trajectory=message))
    rclpy.spin_until_future_complete(node, sent)
    if not sent.result().accepted:
        sys.exit(
            f"{controller} refuses the trajectory: are its joints {message.joint_names[:3]}...?"
        )
    done = sent.result().get_result_async()
    rclpy.spin_until_future_complete(node, done)
    result = done.result().result
    sys.exit(result.error_string if result.error_code else 0)


if __name__ == "__main__":
    main(*sys.argv[1:])

"""Files for other tools: a scene for MuJoCo, the chain as URDF, the plan as a ROS 2 trajectory."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import numpy as np
from mujoco import MjSpec, mjtJoint

from ..io.mcap import METRE, make_header, make_stamp
from ..motion.plan import Plan
from ..numeric.arrays import Floats
from .options import ScopeOptions
from .robots import PlanDrive
from .simulate import Chain, Dynamics
from .walls import LumenWall


def format_mjcf(plan: Plan, wall: LumenWall, *, dynamics: Dynamics | None = None) -> str:
    """Return a scene for MuJoCo as one text: the chain, its servos, a prism for each triangle.

    Units are m, kg and s, as in the other files. The key ``start`` is the plan's first step;
    contact is MuJoCo's own, and no tissue stiffness.
    """
    drive = PlanDrive(plan, options=ScopeOptions())
    spec = drive.chain.to_spec(Dynamics() if dynamics is None else dynamics, wall)
    _convert_to_metres(spec)
    start = drive.start.copy()
    start[0] *= METRE
    spec.add_key(name="start", qpos=start, ctrl=start)
    spec.compile()
    return str(spec.to_xml())


def _convert_to_metres(spec: MjSpec) -> None:
    """Turn a scene in mm, kg and s into one in m, whose motion is the same."""
    spec.comment = "Units: m, kg, s; forces in N. Made by Bozzini."
    spec.option.ccd_tolerance *= METRE
    for part in (*spec.bodies, *spec.geoms, *spec.sites):
        part.pos = METRE * part.pos
    for geom in spec.geoms:
        geom.size, geom.fromto = METRE * geom.size, METRE * geom.fromto
        geom.density /= METRE**3
    for mesh in spec.meshes:
        mesh.uservert = METRE * np.array(mesh.uservert)
    hinges = {joint.name: joint for joint in spec.joints if joint.type == mjtJoint.mjJNT_HINGE}
    for joint in hinges.values():
        joint.armature *= METRE**2
        joint.stiffness = METRE**2 * joint.stiffness
        joint.damping = METRE**2 * joint.damping
    for servo in spec.actuators:
        if servo.target in hinges:  # that of the slide is a force over a length: mN/mm is N/m
            servo.gainprm, servo.biasprm = METRE**2 * servo.gainprm, METRE**2 * servo.biasprm


def format_urdf(plan: Plan) -> str:
    """Return the plan's chain as URDF: metres, kilograms, one joint for each degree of freedom.

    Its base link is the world; the names of the joints are those of `format_trajectory`.
    """
    chain = PlanDrive(plan).chain
    robot = ElementTree.Element("robot", name="bozzini")
    ElementTree.SubElement(robot, "link", name="world")
    parent, place = "world", chain.frame
    mass = _weigh(chain)
    for k, length in enumerate(chain.lengths):
        if k == 0:
            _add_joint(robot, "slide", ("world", "slider"), place=place, kind="prismatic")
            _add_link(robot, "slider", mass[0] * 1e-3)
            parent, place = "slider", np.eye(4)
        _add_joint(robot, f"bend{k}x", (parent, f"knuckle{k}"), place=place, axis="1 0 0")
        _add_link(robot, f"knuckle{k}", mass[k] * 1e-3)
        _add_joint(robot, f"bend{k}y", (f"knuckle{k}", f"link{k}"), place=np.eye(4), axis="0 1 0")
        _add_link(robot, f"link{k}", mass[k], length=float(length), radius=chain.radius)
        parent, place = f"link{k}", np.eye(4)
        place[2, 3] = length
    _add_joint(robot, "tip", (parent, "tip_frame"), place=place, kind="fixed")
    _add_link(robot, "tip_frame", 0.0)
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def _weigh(chain: Chain) -> Floats:
    density = 1e-9 * Dynamics().density
    return np.asarray(density * math.pi * chain.radius**2 * chain.lengths)


def _add_joint(
    robot: ElementTree.Element,
    name: str,
    links: tuple[str, str],
    *,
    place: Floats,
    axis: str = "0 0 1",
    kind: str = "revolute",
) -> None:
    from scipy.spatial.transform import Rotation

    joint = ElementTree.SubElement(robot, "joint", name=name, type=kind)
    turn = Rotation.from_matrix(place[:3, :3]).as_euler("xyz")
    ElementTree.SubElement(joint, "origin", xyz=_join(METRE * place[:3, 3]), rpy=_join(turn))
    ElementTree.SubElement(joint, "parent", link=links[0])
    ElementTree.SubElement(joint, "child", link=links[1])
    if kind == "fixed":
        return
    ElementTree.SubElement(joint, "axis", xyz=axis)
    low, high = ("-10", "10") if kind == "prismatic" else ("-3.1", "3.1")
    ElementTree.SubElement(joint, "limit", lower=low, upper=high, effort="100", velocity="10")


def _add_link(
    robot: ElementTree.Element, name: str, mass: float, *, length: float = 0.0, radius: float = 1.0
) -> None:
    link = ElementTree.SubElement(robot, "link", name=name)
    if mass <= 0.0:
        return
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=_join([0.0, 0.0, 0.5 * METRE * length]))
    ElementTree.SubElement(inertial, "mass", value=f"{mass:.9g}")
    size, across = METRE * length, METRE * radius
    about = mass * (3.0 * across**2 + size**2) / 12.0
    tensor = ElementTree.SubElement(inertial, "inertia", ixy="0", ixz="0", iyz="0")
    for key, value in (("ixx", about), ("iyy", about), ("izz", 0.5 * mass * across**2)):
        tensor.set(key, f"{value:.9g}")
    if length > 0.0:
        for tag in ("visual", "collision"):
            part = ElementTree.SubElement(link, tag)
            ElementTree.SubElement(part, "origin", xyz=_join([0.0, 0.0, 0.5 * size]))
            shape = ElementTree.SubElement(part, "geometry")
            ElementTree.SubElement(shape, "cylinder", radius=f"{across:.9g}", length=f"{size:.9g}")


def _join(values: Floats | list[float]) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def name_joints(chain: Chain) -> list[str]:
    """Return the names of a chain's joints: the slide, then two hinges a link."""
    hinges = [f"bend{k}{axis}" for k in range(len(chain.lengths)) for axis in "xy"]
    return ["slide", *hinges]


def make_trajectory(drive: PlanDrive) -> dict[str, object]:
    """Return a plan as the ROS 2 message ``JointTrajectory``, in metres and radians."""
    points = []
    for time, row in zip(drive.times, drive.table, strict=True):
        positions = [METRE * float(row[0]), *map(float, row[1:])]
        points.append(
            {
                "positions": [round(value, 9) for value in positions],
                "time_from_start": make_stamp(float(time)),
            }
        )
    header = make_header(0.0)
    return {"header": header, "joint_names": name_joints(drive.chain), "points": points}


def format_trajectory(plan: Plan, *, speed: float = 20.0) -> str:
    """Return the plan as a ROS 2 message ``trajectory_msgs/msg/JointTrajectory`` in YAML.

    Metres and radians; its joints are those of `format_urdf`. Times are those of a head that moves
    at `speed` [mm/s].
    """
    import yaml

    message = make_trajectory(PlanDrive(plan, speed))
    return str(yaml.safe_dump(message, sort_keys=False, default_flow_style=None, width=1000))

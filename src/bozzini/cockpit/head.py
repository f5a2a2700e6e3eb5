"""The drive of a distal head: a stick and a slide steer its instrument, seen by a still camera."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..duct.base import Duct
from ..errors import InputError
from ..head.anchor import Stand, find_wall_along, list_touches
from ..head.choices import CAMERAS, EFFECTORS
from ..head.design import Head, PlacedEffector, SectionPoses
from ..head.operate import TargetRun, TargetTask, find_up
from ..head.shape import find_overlap, make_camera_chains
from ..numeric.arrays import Floats
from ..results import Json
from .drive import EffectorDrive, describe_effector
from .session import PlacedBody, ShownPlan

_STEPS = 41  # places along the instrument at which the wall is looked for


class HeadBody(NamedTuple):
    """A body that moves: its line (k, 3) [mm], and how it is drawn."""

    name: str
    color: str
    radius: float
    line: Floats


class HeadDrive(EffectorDrive):
    """A head at the tip of the scope, without a rig.

    The stick moves one end-effector; the others keep the bend and the slide that they were given.

    Parameters
    ----------
    head : Head
    targets : int
        How many there are to touch.
    """

    name = "head without a rig"

    def __init__(self, head: Head, *, targets: int = 5) -> None:
        self.head, self.count = head, targets
        self.camera, self.cameras = CAMERAS[0], {CAMERAS[0]}
        self.task: TargetTask | None = None
        self._arm, self._housing = head.lay_arm()
        self.number = 0
        self._outs = np.zeros(len(head.effectors))
        self._travels = [np.zeros(2) for _ in head.effectors]
        self._poses = [placed.shape(np.zeros((1, 2))) for placed in head.effectors]
        self._compared, self._overlap = np.empty(0), ""
        super().__init__(head.effectors[0].effector)
        self.choose(1)
        self._is_neutral = True

    @property
    def placed(self) -> PlacedEffector:
        """The end-effector that is moved."""
        return self.head.effectors[self.number - 1]

    @property
    def wanted(self) -> float:
        """How far its instrument would be out without a wall [mm]."""
        return float(self._outs[self.number - 1])

    def choose(self, number: int) -> None:
        """Move another end-effector; it stays as it is until the stick, once let go, is moved.

        Raises
        ------
        InputError
            If there is none of that number.
        """
        placed = self.head.get_effector(number)
        if number == self.number:
            return
        self.number, self.turn = number, _find_turn(self.head, placed)
        self.take(placed.effector)
        super().hold(self._travels[number - 1])
        self._is_neutral = self._is_steered = False
        if self.task is not None:
            self.task.change_instrument()

    def hold(self, travel: Floats) -> None:
        """Take the travel (2,) of the stick for the end-effector that is moved."""
        index, is_moved = self.number - 1, bool(travel.any())
        self._is_neutral |= not is_moved
        self._is_steered |= self._is_neutral and is_moved
        super().hold(travel if self._is_steered else self._travels[index])
        self._travels[index] = self.travel
        self._poses[index] = self.placed.shape((self.turn @ self.state.tip)[None])

    def slide(self, out: float, number: int | None = None) -> None:
        """Slide an instrument out, as a share of its reach; it stops at the wall."""
        number = self.number if number is None else number
        self._outs[number - 1] = out * self.head.get_effector(number).instrument.reach

    def command_head(self, what: str, plan: ShownPlan | None, step: int) -> None:
        """Choose camera or end-effector, or set targets to touch from where the head stands."""
        if what in CAMERAS:
            self.camera = what
            self.cameras.add(what)
            return
        if what in EFFECTORS:
            self.choose(int(what))
            return
        if plan is None or not isinstance(plan.wall, Duct):
            raise InputError("there is no wall yet to set targets on")
        stand = _find_stand(plan, step)
        found = list_touches(self.head, stand, duct=plan.wall, number=self.number)
        self.task = TargetTask(found.choose(self.count).place)
        self.cameras = {self.camera}

    def place(self, plan: ShownPlan, step: int) -> PlacedBody:
        """Return body and head at a step, and tell the task where the instrument's tip is."""
        stand, index = _find_stand(plan, step), self.number - 1
        wall = plan.wall if isinstance(plan.wall, Duct) else None
        if wall is not None and wall.signed_distance(stand.origin[None])[0] >= 0.0:
            wall = None
        free = np.full(len(self._outs), math.inf) if wall is None else self._trace(stand, wall)
        outs = np.minimum(self._outs, np.maximum(free, 0.0))
        poses = [
            replace(pose, tip=pose.holder_tip + out * pose.direction)
            for pose, out in zip(self._poses, outs, strict=True)
        ]
        tip = stand.origin + stand.frame @ poses[index].tip[0]
        gap, notes = math.nan, [self._find_overlap(poses)]
        if wall is not None:
            gap = float(-wall.signed_distance(tip[None])[0])
            for chain in make_camera_chains(self.head):
                line = stand.origin + chain.lines[0] @ stand.frame.T
                if (wall.signed_distance(line) > -chain.radius).any():
                    notes[1:] = [
                        "the camera's arm goes through the wall: here the head stays capped"
                    ]
            if self.task is not None:
                touches = bool(0.0 < free[index] < self.wanted)
                self.task.take(time.monotonic(), tip, touches=touches)
        self.state = replace(self.state, note="; ".join(filter(None, notes)))
        points = np.concatenate([part.line for part in self.list_parts(poses)])
        return PlacedBody(
            joints=plan.joints[step],
            clearance=plan.clearance[step],
            gap=gap,
            tip=stand.origin + points @ stand.frame.T,
            camera=self._look(stand, poses[index]),
        )

    def _trace(self, stand: Stand, wall: Duct) -> Floats:
        """Return how far out the instruments (n,) meet the wall, at most as far as they go [mm]."""
        starts = np.concatenate([pose.holder_tip for pose in self._poses]) @ stand.frame.T
        ways = np.concatenate([pose.direction for pose in self._poses]) @ stand.frame.T
        steps = np.linspace(0.0, max(float(self._outs.max()), 1e-6), _STEPS)
        return find_wall_along(wall, stand.origin + starts, ways, steps)

    def _find_overlap(self, poses: Sequence[SectionPoses]) -> str:
        """Return which bodies of the head overlap, looked at again where a tip has moved."""
        tips = np.concatenate([pose.tip for pose in poses])
        if not np.array_equal(tips, self._compared):
            self._compared, (_, self._overlap) = tips, find_overlap(self.head, poses)
        return self._overlap

    def _look(self, stand: Stand, poses: SectionPoses) -> Floats:
        """Return place, way and up of the chosen camera, world (3, 3)."""
        back, lens = self._housing
        if self.camera == "tip":
            lens, way = poses.holder_tip[0], poses.direction[0]
            up = find_up(self.head, way)
        else:
            way = (lens - back) / np.linalg.norm(lens - back)
            azimuth = self.head.camera.azimuth
            up = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
            up = up - (up @ way) * way
            up /= np.linalg.norm(up)
        return np.stack([stand.origin + stand.frame @ lens, stand.frame @ way, stand.frame @ up])

    def list_parts(self, poses: Sequence[SectionPoses]) -> list[HeadBody]:
        """Return the bodies in the head's frame, at last each end-effector and its instrument."""
        camera = self.head.camera
        parts = [
            HeadBody("camera's arm", "#8a96a3", 0.5 * camera.thickness, self._arm),
            HeadBody("camera", "#c0392b", 0.5 * camera.diameter, self._housing),
        ]
        for k, (placed, pose) in enumerate(zip(self.head.effectors, poses, strict=True)):
            body, radius = pose.body[0], 0.5 * placed.instrument.diameter
            rod = np.stack([body[-1], pose.tip[0]])
            parts += [
                HeadBody(self._name("end-effector", k), "#4f7cac", placed.radius, body),
                HeadBody(self._name("instrument", k), "#d8dde2", radius, rod),
            ]
        return parts

    def _name(self, what: str, index: int) -> str:
        return what if len(self.head.effectors) == 1 else f"{what} {index + 1}"

    def describe(self) -> Json:
        """Return what the page needs to know once."""
        parts = [
            {"name": name, "color": color, "radius": radius, "points": len(line)}
            for name, color, radius, line in self.list_parts(self._poses)
        ]
        each = [
            describe_effector(placed.effector, _find_turn(self.head, placed))
            for placed in self.head.effectors
        ]
        head = {"parts": parts, "view": self.head.camera.view, "effectors": each}
        return {**super().describe(), "head": head}

    def describe_tip(self, diameter: float) -> str:
        """Return how wide the head is, if that is another diameter than the scope's."""
        if abs(self.head.diameter - diameter) < 0.05:
            return ""
        return f"The head is {self.head.diameter:g} mm wide, the scope {diameter:g} mm."

    def tell(self) -> Json:
        """Return what the page shows as text: camera, end-effector, slide, targets and touches."""
        task, own = self.task, [self._name("end-effector", self.number - 1)]
        return {
            "camera": self.camera,
            "effector": self.number,
            "out": self.wanted / max(self.placed.instrument.reach, 1e-9),
            "hidden": ["camera's arm", "camera", *(own if self.camera == "tip" else [])],
            "words": self._describe_touches(),
            "targets": [] if task is None else task.targets.round(3).tolist(),
            "touches": []
            if task is None
            else [
                {"time_s": row.time, "path_mm": row.path, "error_mm": row.error}
                for row in task.rows
            ],
        }

    def _describe_touches(self) -> str:
        """Return how many targets were touched, and how."""
        if self.task is None:
            return "Touch targets on the wall: slide the instrument out until it meets them."
        rows = self.task.rows
        words = f"{len(rows)} of {len(self.task.targets)} touched"
        if not rows:
            return words
        time, way = sum(row.time for row in rows), sum(row.path for row in rows)
        return f"{words}: {time:.1f} s, {way:.0f} mm of way, last error {rows[-1].error:.1f} mm"

    def sum_up(self) -> TargetRun | None:
        """Return how the targets were touched; None if there are none."""
        if self.task is None:
            return None
        return self.task.sum_up(" and ".join(name for name in CAMERAS if name in self.cameras))


def _find_turn(head: Head, placed: PlacedEffector) -> Floats:
    """Return what turns places in the still camera's picture into an end-effector's frame."""
    angle = head.camera.azimuth - 0.5 * math.pi - placed.turn
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]])


def _find_stand(plan: ShownPlan, step: int) -> Stand:
    return Stand(
        insertion=float(plan.travel[step]),
        origin=plan.joints[step, 0].astype(np.float64),
        frame=plan.frames[step].T,
    )

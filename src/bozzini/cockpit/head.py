"""The drive of a distal head: a stick and a slide steer its instrument, seen by a still camera."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..duct.base import Duct
from ..errors import InputError
from ..head.anchor import Stand, find_wall_along, list_touches
from ..head.choices import CAMERAS
from ..head.design import Head, SectionPoses
from ..head.operate import TargetRun, TargetTask, find_up
from ..head.shape import make_camera_chains, name_effector
from ..numeric.arrays import Floats
from ..results import Json
from .drive import EffectorDrive
from .session import PlacedBody, ShownPlan

_STEPS = 41  # places along the instrument at which the wall is looked for

_UNSEEN = {"still": ("camera's arm", "camera"), "tip": ("camera's arm", "camera", "end-effector")}
"""Bodies that carry a camera, and are not in its picture."""


class HeadBody(NamedTuple):
    """A body that moves: its line (k, 3) [mm], and how it is drawn."""

    name: str
    color: str
    radius: float
    line: Floats


class HeadDrive(EffectorDrive):
    """A head at the tip of the scope, without a rig.

    Its first end-effector is moved; others rest, their instruments drawn in.

    Parameters
    ----------
    head : Head
    targets : int
        How many there are to touch.
    """

    name = "head without a rig"

    def __init__(self, head: Head, *, targets: int = 5) -> None:
        self.head, self.placed, self.count = head, head.effectors[0], targets
        angle = head.camera.azimuth - 0.5 * math.pi - self.placed.turn
        cosine, sine = math.cos(angle), math.sin(angle)
        self.turn = np.array([[cosine, -sine], [sine, cosine]])
        self.camera, self.cameras = CAMERAS[0], {CAMERAS[0]}
        self.wanted = 0.0
        self.task: TargetTask | None = None
        self._arm, self._housing = head.lay_arm()
        self._others = [
            HeadBody(
                name_effector(k), "#4f7cac", other.radius, other.shape(np.zeros((1, 2))).body[0]
            )
            for k, other in enumerate(head.effectors)
            if k > 0
        ]
        super().__init__(self.placed.effector)

    def slide(self, out: float) -> None:
        """Slide the instrument out, as a share of its reach; it stops at the wall."""
        self.wanted = out * self.placed.instrument.reach

    def command_head(self, what: str, plan: ShownPlan | None, step: int) -> None:
        """Choose the camera, or set targets to touch from where the head stands."""
        if what in CAMERAS:
            self.camera = what
            self.cameras.add(what)
            return
        if plan is None or not isinstance(plan.wall, Duct):
            raise InputError("there is no wall yet to set targets on")
        found = list_touches(self.head, _find_stand(plan, step), duct=plan.wall)
        self.task = TargetTask(found.choose(self.count).place)
        self.cameras = {self.camera}

    def place(self, plan: ShownPlan, step: int) -> PlacedBody:
        """Return body and head at a step, and tell the task where the instrument's tip is."""
        stand = _find_stand(plan, step)
        poses = self._pose()
        start = stand.origin + stand.frame @ poses.holder_tip[0]
        way = stand.frame @ poses.direction[0]
        wall, out = plan.wall, self.wanted
        free, gap, note = math.inf, math.nan, ""
        if isinstance(wall, Duct) and wall.signed_distance(stand.origin[None])[0] < 0.0:
            steps = np.linspace(0.0, max(out, 1e-6), _STEPS)
            free = float(find_wall_along(wall, start[None], way[None], steps)[0])
            out = min(out, max(free, 0.0))
            tip = start + out * way
            gap = float(-wall.signed_distance(tip[None])[0])
            for chain in make_camera_chains(self.head):
                line = stand.origin + chain.lines[0] @ stand.frame.T
                if (wall.signed_distance(line) > -chain.radius).any():
                    note = "the camera's arm goes through the wall: here the head stays capped"
            if self.task is not None:
                touches = 0.0 < free < self.wanted
                self.task.take(time.monotonic(), tip, touches=touches)
        self.state = replace(self.state, note=note)
        parts = self.list_parts(poses, out)
        points = stand.origin + np.concatenate([part.line for part in parts]) @ stand.frame.T
        return PlacedBody(
            joints=plan.joints[step],
            clearance=plan.clearance[step],
            gap=gap,
            tip=points,
            camera=self._look(stand, poses),
        )

    def _pose(self) -> SectionPoses:
        bends = self.turn @ self.state.tip
        return self.placed.shape(bends[None])

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

    def list_parts(self, poses: SectionPoses, out: float) -> list[HeadBody]:
        """Return the bodies in the head's frame, the instrument, so far out [mm], as the last."""
        camera, placed = self.head.camera, self.placed
        body = poses.body[0]
        rod = np.stack([body[-1], body[-1] + out * poses.direction[0]])
        return [
            HeadBody("camera's arm", "#8a96a3", 0.5 * camera.thickness, self._arm),
            HeadBody("camera", "#c0392b", 0.5 * camera.diameter, self._housing),
            *self._others,
            HeadBody("end-effector", "#4f7cac", placed.radius, body),
            HeadBody("instrument", "#d8dde2", 0.5 * placed.instrument.diameter, rod),
        ]

    def describe(self) -> Json:
        """Return what the page needs to know once."""
        parts = [
            {"name": name, "color": color, "radius": radius, "points": len(line)}
            for name, color, radius, line in self.list_parts(self._pose(), 0.0)
        ]
        head = {"parts": parts, "reach_mm": self.placed.instrument.reach,
                "view": self.head.camera.view}  # fmt: skip
        return {**super().describe(), "head": head}

    def tell(self) -> Json:
        """Return what the page shows as text: camera, slide, targets and touches."""
        task = self.task
        return {
            "camera": self.camera,
            "out": self.wanted / max(self.placed.instrument.reach, 1e-9),
            "hidden": _UNSEEN[self.camera],
            "targets": [] if task is None else task.targets.round(3).tolist(),
            "touches": []
            if task is None
            else [
                {"time_s": row.time, "path_mm": row.path, "error_mm": row.error}
                for row in task.rows
            ],
        }

    def sum_up(self) -> TargetRun | None:
        """Return how the targets were touched; None if there are none."""
        if self.task is None:
            return None
        return self.task.sum_up(" and ".join(name for name in CAMERAS if name in self.cameras))


def _find_stand(plan: ShownPlan, step: int) -> Stand:
    return Stand(
        insertion=float(plan.travel[step]),
        origin=plan.joints[step, 0].astype(np.float64),
        frame=plan.frames[step].T,
    )

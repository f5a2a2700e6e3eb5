"""Static shapes of a rod by another group's Cosserat solver, SoRoSim, computed again by `rod`."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from section import Bound, Section

from bozzini.continuum import ContinuumRobot, LineLoad, PointLoad, RodModel, Wire
from bozzini.continuum import Section as RobotSection

LENGTH, RADIUS = 600.0, 0.8
DENSITY = 7870.0
"""Of the rod [mm], [kg/m^3]; the wrench in the middle is at half of its length."""

INTO_WORLD = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Base axes in the world of the data, whose x is the tangent at the base."""


@dataclass(frozen=True)
class Statics:
    """Loads and shapes in the base's frame, n of them.

    Attributes
    ----------
    arc_length : (k,) ndarray
        Stations [mm].
    gravity : (n, 3) ndarray
        Acceleration [m/s^2].
    moments, forces : (n, 2, 3) ndarray
        Wrenches in the middle and at the tip [N mm], [N].
    points, frames : (n, k, 3), (n, k, 3, 3) ndarray
        Places [mm], and axes of the cross-sections.
    """

    arc_length: NDArray[np.float64]
    gravity: NDArray[np.float64]
    moments: NDArray[np.float64]
    forces: NDArray[np.float64]
    points: NDArray[np.float64]
    frames: NDArray[np.float64]


def read_statics(path: Path) -> Statics:
    """Read the table: six rows for a shape, angles and places."""
    with path.open(newline="", encoding="utf-8") as file:
        table = list(csv.reader(file))
    places = np.array(table[1][4:], dtype=np.float64)
    half = len(places) // 2
    arc_length = 0.5 * LENGTH * (places + np.repeat([0.0, 1.0], half))
    values = np.array([row[1:] for row in table[2:]], dtype=np.float64).reshape(-1, 2, 3, 17)
    # The end of the first half is the start of the second.
    kept = [index for index in range(2 * half) if index != half]
    angles, points = (np.moveaxis(values[:, k, :, 3:], 1, 2)[:, kept] for k in (0, 1))
    turns = Rotation.from_euler("XYZ", angles.reshape(-1, 3)).as_matrix()
    frames = turns.reshape(*angles.shape[:2], 3, 3)
    return Statics(
        arc_length=arc_length[kept],
        gravity=values[:, 1, :, 0] @ INTO_WORLD,
        moments=1e3 * np.moveaxis(values[:, 0, :, 1:3], 1, 2) @ INTO_WORLD,
        forces=np.moveaxis(values[:, 1, :, 1:3], 1, 2) @ INTO_WORLD,
        points=1e3 * points @ INTO_WORLD,
        frames=INTO_WORLD.T @ frames @ INTO_WORLD,
    )


@dataclass(frozen=True)
class Errors:
    """Errors of shapes: of the tip by the length, and of all stations' axes [deg]; and reasons."""

    tip: NDArray[np.float64]
    turn: NDArray[np.float64]
    reasons: tuple[str, ...]


def compare(data: Statics) -> Errors:
    """Compute all shapes again; one that is not found has an infinite error."""
    wire = Wire(diameter=2.0 * RADIUS, modulus=200e3, poisson_ratio=0.33)
    robot = ContinuumRobot(
        (
            RobotSection(
                length=LENGTH,
                radius=RADIUS,
                disc_positions=tuple(data.arc_length[1:]),
                wire=wire,
            ),
        )
    )
    line = 1e-9 * DENSITY * np.pi * RADIUS**2
    tips, turns, reasons = [], [], []
    for index in range(len(data.points)):
        wrenches = zip((0.5 * LENGTH, None), data.forces[index], data.moments[index], strict=True)
        loads = [LineLoad(force=tuple(line * data.gravity[index]))]
        loads += [
            PointLoad(arc_length=place, force=tuple(force), moment=tuple(moment))
            for place, force, moment in wrenches
        ]
        shape = RodModel(robot, loads=loads, stretches=True).shape_under_tensions([])
        if not shape.converged:
            reasons.append(str(shape.reason))
            tips.append(np.inf)
            turns.append(np.inf)
            continue
        tips.append(np.linalg.norm(shape.tip - data.points[index, -1]) / LENGTH)
        off = np.swapaxes(shape.frames[:, :3, :3], 1, 2) @ data.frames[index]
        turns.append(np.degrees(Rotation.from_matrix(off).magnitude().max()))
    return Errors(np.array(tips), np.array(turns), tuple(reasons))


def validate(folder: Path, images: Path) -> Section:
    """Return the section; it has no picture."""
    data = read_statics(folder / "SpringSteel.csv")
    found = compare(data)
    percent = 100.0 * found.tip
    good = np.isfinite(percent)
    beyond = float(100.0 * np.mean(percent > 0.1))
    return Section(
        title="Static shapes of a steel rod by another solver",
        source="ContinuumRoboticsLab/opencr-mujoco, commit 17fff8b; computed there with SoRoSim "
        "(Mathew et al., IEEE Robotics and Automation Magazine, 2022).",
        licence="MIT.",
        text=(
            f"{len(data.points)} shapes of a spring-steel rod, 600 mm long and 1.6 mm thick, under "
            "its weight in any direction, a wrench in its middle and one at its tip, both of fixed "
            "direction. The rod is described by its diameter, modulus, Poisson's ratio and density "
            "as published; nothing is fitted. `RodModel(loads=…, stretches=True)` found "
            f"{good.sum()} of them. Its tip is off by {np.median(percent[good]):.3f} % of the "
            f"length in the median and by {percent[good].max():.3f} % at most; in "
            f"{100.0 - beyond:.1f} % of the shapes by no more than 0.1 %. Axes of "
            f"the cross-sections at all stations are off by {found.turn[good].max():.3f} deg at "
            "most.",
            "",
            "How far to trust it: the data are rounded to 0.1 mm and 1e-4 rad, and the other "
            "solver has an error of its own, so what is left is no error of one or the other. Both "
            "are models of the same rod: a measured one has a friction, a play and a curvature at "
            "rest besides.",
        ),
        bounds=(
            Bound("tip, worst shape", float(percent.max()), 0.15, "%"),
            Bound(
                "shapes with the tip off by more than 0.1 %",
                float(100.0 * np.mean(percent > 0.1)),
                1.0,
                "%",
            ),
            Bound("axes at all stations, worst", float(found.turn.max()), 0.5, "deg"),
        ),
    )

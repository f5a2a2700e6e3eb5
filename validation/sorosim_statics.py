"""Static shapes of a rod by another group's Cosserat solver, SoRoSim, computed again by `rod`.

    python validation/sorosim_statics.py FILE.csv --length 600mm --radius 0.8mm --modulus 200GPa

holds any rod of the same layout against its file; `--help` lists what is taken of the published
one unless given.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from section import Bound, Section

from bozzini.checks import check_fields, quantity
from bozzini.cli.common import options_of
from bozzini.continuum import ContinuumRobot, LineLoad, PointLoad, RodModel, Wire
from bozzini.continuum import Section as RobotSection

INTO_WORLD = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Base axes in the world of the data, whose x is the tangent at the base."""

LOAD_COLUMNS = 4
"""Columns before those of the stations: label, gravity, wrench in the middle and at the tip."""


@dataclass(frozen=True, kw_only=True)
class Specimen:
    """A round rod; the defaults are the published one of spring steel.

    Parameters
    ----------
    length, radius : float
        Of the rod [mm]; the first wrench acts at half of its length.
    modulus : float
        Young's modulus [MPa].
    poisson_ratio : float
    density : float
        Density [kg/m^3], for its weight.
    """

    length: float = quantity("length", "Length.", low=0.0, low_open=True, default=600.0)
    radius: float = quantity("length", "Radius.", low=0.0, low_open=True, default=0.8)
    modulus: float = quantity("pressure", "Modulus.", low=0.0, low_open=True, default=200e3)
    poisson_ratio: float = quantity(help="Poisson's ratio.", low=0.0, high=0.5, default=0.33)
    density: float = quantity("density", "Density.", low=0.0, default=7870.0)

    def __post_init__(self) -> None:
        check_fields(self)


SPRING_STEEL = Specimen()


@dataclass(frozen=True)
class Statics:
    """Loads and shapes of a specimen in the base's frame, n of them at k stations.

    Attributes
    ----------
    specimen : Specimen
    arc_length : (k,) ndarray
        Stations [mm].
    gravity : (n, 3) ndarray
        Acceleration [m/s^2].
    moments, forces : (n, 2, 3) ndarray
        Wrenches in the middle and at the tip [N mm], [N].
    points, frames : (n, k, 3), (n, k, 3, 3) ndarray
        Places [mm], and axes of the cross-sections.
    """

    specimen: Specimen
    arc_length: NDArray[np.float64]
    gravity: NDArray[np.float64]
    moments: NDArray[np.float64]
    forces: NDArray[np.float64]
    points: NDArray[np.float64]
    frames: NDArray[np.float64]


def read_statics(path: Path, specimen: Specimen = SPRING_STEEL) -> Statics:
    """Read the table: six rows for a shape, angles and places; as many stations as it has."""
    with path.open(newline="", encoding="utf-8") as file:
        table = list(csv.reader(file))
    fractions = np.array(table[1][LOAD_COLUMNS:], dtype=np.float64)
    # Each half goes from 0 to 1; the end of the first one is the start of the second.
    second = np.arange(len(fractions)) > np.argmax(fractions == 1.0)
    arc_length = 0.5 * specimen.length * (fractions + second)
    kept = np.append(True, np.diff(arc_length) > 0.0)
    values = np.array([row[1:] for row in table[2:]], dtype=np.float64)
    values = values.reshape(-1, 2, 3, LOAD_COLUMNS - 1 + len(fractions))
    stations = values[..., LOAD_COLUMNS - 1 :][..., kept]
    angles, points = (np.moveaxis(stations[:, k], 1, 2) for k in (0, 1))
    turns = Rotation.from_euler("XYZ", angles.reshape(-1, 3)).as_matrix()
    frames = turns.reshape(*angles.shape[:2], 3, 3)
    return Statics(
        specimen=specimen,
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
    rod = data.specimen
    wire = Wire(diameter=2.0 * rod.radius, modulus=rod.modulus, poisson_ratio=rod.poisson_ratio)
    robot = ContinuumRobot(
        (
            RobotSection(
                length=rod.length,
                radius=rod.radius,
                disc_positions=tuple(data.arc_length[1:]),
                wire=wire,
            ),
        )
    )
    line = 1e-9 * rod.density * np.pi * rod.radius**2
    tips, turns, reasons = [], [], []
    for index in range(len(data.points)):
        wrenches = zip(
            (0.5 * rod.length, None), data.forces[index], data.moments[index], strict=True
        )
        loads: list[LineLoad | PointLoad] = [LineLoad(force=tuple(line * data.gravity[index]))]
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
        tips.append(float(np.linalg.norm(shape.tip - data.points[index, -1])) / rod.length)
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
            f"{beyond:.1f} % of the shapes by more than 0.1 %. Axes of the cross-sections at all "
            f"stations are off by {found.turn[good].max():.3f} deg at most. The data are rounded "
            "to 0.1 mm and 1e-4 rad, and the other solver has an error of its own. Both are models "
            "of the same rod, not a measured one.",
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


@click.command()
@click.argument("file", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@options_of(Specimen, "specimen")
def main(file: Path, specimen: Specimen) -> None:
    """Compute the shapes in FILE again, and print by how much they differ."""
    found = compare(read_statics(file, specimen))
    good = np.isfinite(found.tip)
    print(f"{good.sum()} of {len(good)} shapes were found")
    if good.any():
        tip = 100.0 * found.tip[good]
        print(f"tip off by {np.median(tip):.3g} % of the length, at most {tip.max():.3g} %")
        print(f"axes off by {found.turn[good].max():.3g} deg at most")
    for reason in found.reasons:
        print(f"no shape: {reason}")


if __name__ == "__main__":
    main()

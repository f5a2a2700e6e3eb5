"""Which model for which robot: all of them beside a Kirchhoff rod, on robots of this folder.

    python examples/continuum_compare.py                  the three robots named below
    python examples/continuum_compare.py my_robot.yaml    your own; 2 N on its first tendon

The rod is put under tensions. How far its tendons move then is what the other models are told,
so that no tendon contradicts another.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from bozzini.continuum import CONTINUUM_MODELS, ContinuumRobot, EnergyModel, RodModel
from bozzini.errors import GeometryError
from bozzini.plot import write_figure
from bozzini.plot.continuum import draw_comparison

HERE = Path(__file__).resolve().parent
TENSIONS = {
    "two_sections": {"T1": 1.0, "T4": 1.5},
    "converging": {"C1": 2.0, "C3": 3.0},
    "helical": {"H1": 4.0, "H2": 3.0},
}
"""Robots, and the tensions of the tendons that are pulled [N]."""

FINER = (0, 1, 3)
"""Further cross-sections between two discs, by which the energy model gets finer."""


def straighten(robot):
    """Return the robot as one who does not look at its routing sees it: tendons as at the base."""
    sections = []
    for section in robot.sections:
        tendons = [
            replace(tendon, offset=float(tendon.offset_at(0.0)), angle=float(tendon.angle_at(0.0)))
            for tendon in section.tendons
        ]
        radius = max([section.radius, *(tendon.offset for tendon in tendons)])
        sections.append(replace(section, tendons=tuple(tendons), radius=radius))
    return ContinuumRobot(tuple(sections), name=f"{robot.name}, straightened")


def compare(robot, pulls):
    """Return shapes by name, under the tensions of the rod or the displacements that follow."""
    tensions = np.array([pulls.get(name, 0.0) for name in robot.tendon_names])
    rod = RodModel(robot).shape_under_tensions(tensions).require()
    shapes = {}
    for name, model in CONTINUUM_MODELS.items():
        if name == "energy":
            for between in FINER:
                finer = EnergyModel(robot, between=between)
                shapes[f"energy, {between} between"] = finer.shape(rod.displacements).require()
        elif name != "rod":
            try:
                shapes[name] = model(robot).shape(rod.displacements).require()
            except GeometryError as error:
                print(f"    {name}: {str(error).partition(':')[0]}")
    straight = RodModel(straighten(robot)).shape_under_tensions(tensions).require()
    return {**shapes, "straightened": straight, "rod": rod}


def main(arguments=None):
    """Run the example."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot", nargs="?", type=Path, help="your own robot (.yaml)")
    parser.add_argument("--out", type=Path, default=Path("continuum_compare.png"))
    given = parser.parse_args(arguments)
    jobs = {HERE / f"{name}.yaml": pulls for name, pulls in TENSIONS.items()}
    if given.robot is not None:
        jobs = {given.robot: {}}
    found = {}
    for path, pulls in jobs.items():
        robot = ContinuumRobot.from_yaml(path)
        if not pulls:
            pulls = {robot.tendon_names[0]: 2.0}
        print(f"{robot.name}: {', '.join(f'{name} {pull:g} N' for name, pull in pulls.items())}")
        shapes = compare(robot, pulls)
        found[path.stem] = shapes
        for name, shape in shapes.items():
            off = np.linalg.norm(shape.tip - shapes["rod"].tip)
            place = ", ".join(f"{value:.3f}" for value in shape.tip)
            print(f"    {name:20s}{off:10.4f} mm off, tip at {place} mm")
    write_figure(draw_comparison(shapes), given.out)
    print(f"{robot.name} drawn in {given.out}")
    return found


if __name__ == "__main__":
    main()

"""Rods pushed through a bulb with an exit opposite: a soft one coils up in it, a stiff one passes.

    python examples/contact_bulb.py --out bulb.png

A force at the tip stands for what resists there. A rod without tendons takes the place of a
passive scope; its walls are rigid and smooth.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from bozzini.continuum import (
    ContactModel,
    ContactOptions,
    PointLoad,
    RobotDesign,
    Section,
    insert_robot,
)
from bozzini.duct import RoundCones, Union
from bozzini.plot import write_figure

BULB = 30.0  # radius [mm]
RESISTANCE = (0.01, 0.005, -0.1)  # force at the tip [N]
STIFFNESSES = (50.0, 500.0, 2000.0)  # of the rods against bending [N mm^2]


def make_bulb():
    """Return a tube, a bulb and a wider tube as one lumen, and the way through it (5, 3)."""
    exit_way = np.array([np.sin(0.1), 0.0, np.cos(0.1)])
    path = np.array([[0.0, 0.0, -40.0], [0.0, 0.0, -28.0], [0.0, 0.0, 0.0], 28.0 * exit_way,
                     110.0 * exit_way])  # fmt: skip
    bulb = RoundCones(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.01]]), np.full(2, BULB))
    return Union((RoundCones(path[:2], [4.0, 4.0]), bulb, RoundCones(path[2:], [8.0] * 3))), path


def push_rod(stiffness):
    """Return the insertion of a rod of a bending stiffness [N mm^2], as far as it goes."""
    lumen, path = make_bulb()
    rod = RobotDesign((Section(length=140.0, radius=2.0, bending_stiffness=stiffness),))
    model = ContactModel(
        rod,
        lumen,
        loads=(PointLoad(force=RESISTANCE, frame="world"),),
        options=ContactOptions(segment_length=4.0),
    )
    return insert_robot(model, path, step=4.0)


def main(arguments=None):
    """Print what comes of each rod, and draw them; return the insertions."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="picture of the rods")
    options = parser.parse_args(arguments)
    found = [push_rod(stiffness) for stiffness in STIFFNESSES]
    for stiffness, item in zip(STIFFNESSES, found, strict=True):
        print(
            f"EI {stiffness:6.0f} N mm^2: in {item.inserted[-1]:5.1f} mm, the tip "
            f"{item.tip_progress[-1]:5.1f} mm, at most {item.push_force.max():.3f} N; "
            f"{item.reason or 'it passes'}"
        )
    if options.out:
        from matplotlib.figure import Figure

        figure = Figure(figsize=(12.0, 4.5), layout="constrained")
        for axes, stiffness, item in zip(
            figure.subplots(1, len(found)), STIFFNESSES, found, strict=True
        ):
            item.plot(axes)
            axes.set_title(f"EI {stiffness:g} N mm²")
        write_figure(figure, options.out)
    return found


if __name__ == "__main__":
    main()

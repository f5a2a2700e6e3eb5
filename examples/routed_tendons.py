"""Tendons routed so that constant tensions hold a robot in an S, against straight ones.

    python examples/routed_tendons.py --out routed.png

One tendon that may cross the backbone, two at a constant offset, and straight tendons, each with an
end of its own. The robot is that of the designs; what holds the shape is tension alone, so it is
printed how far the robot moves for 1 % more of it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from bozzini.motion.routing import design_routing
from bozzini.plot import write_figure
from bozzini.plot.routing import draw_design

LENGTH = 120.0  # of the robot [mm]
ANGLE = 0.9  # largest turn of its tangent, to either side [rad]


def make_s():
    """Return points (n, 3) of an S, the bend to one side and then to the other."""
    s = np.linspace(0.0, LENGTH, 601)
    turn = ANGLE * np.sin(2.0 * np.pi * s / LENGTH)
    ways = np.stack([np.sin(turn), np.zeros_like(s), np.cos(turn)], axis=1)
    steps = 0.5 * (ways[1:] + ways[:-1]) * np.diff(s)[:, None]
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def main(arguments=None):
    """Print a table of designs, and draw the one of one tendon."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="picture of the design of one tendon")
    options = parser.parse_args(arguments)
    curve = make_s()
    rows = []
    print("tendons         rms [mm]  max [mm]  tension [N]  moved by 1 % [mm]")
    for count, kind in ((1, "curved"), (2, "curved"), (2, "straight"), (4, "straight")):
        design = design_routing(curve, tendons=count, routing=kind)
        rows.append(design)
        print(
            f"{count} {kind:<12}{design.error_rms:>10.3f}{design.error_max:>10.3f}"
            f"{design.tensions.sum():>13.2f}{design.by_tension[-1]:>19.2f}"
        )
    if options.out is not None:
        write_figure(draw_design(rows[0]), options.out)
    return rows


if __name__ == "__main__":
    main()

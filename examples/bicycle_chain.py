"""Pull a bicycle chain sideways over paper and gravel: the tractrix with slip.

    python examples/bicycle_chain.py

The chain lies straight along x and is pulled by one end along -y. With nu = 0 each link only ever
moves along itself; with nu = 1 it is shifted without turning. The thesis (Appendix C) reads 0.86
off a chain on gravel and 0.95 off one on photo paper.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from bozzini.motion import move_free_chain

PITCH = 12.7  # of a bicycle chain: half an inch [mm]
SLIPS = {
    0.0: ("tractrix", "#17212b"),
    0.5: ("", "#2f7fd0"),
    0.86: ("gravel", "#0f7b6c"),
    0.95: ("photo paper", "#b26a00"),
    1.0: ("shifted", "#b3261e"),
}


def pull(slip, *, links=40, way=400.0, steps=200):
    """Return the chain (steps + 1, links + 1, 2) while its head goes `way` mm along -y."""
    chain = np.stack([PITCH * np.arange(links + 1), np.zeros(links + 1)], axis=1)
    heads = np.stack([np.zeros(steps + 1), -np.linspace(0.0, way, steps + 1)], axis=1)
    return move_free_chain(chain, heads, slip=slip)


def print_table(poses):
    """Print how far the other end is dragged along, and how much of the chain hangs behind."""
    print("  nu   other end moves   links that turned by more than 45 deg")
    for slip, joints in poses.items():
        moved = np.linalg.norm(joints[-1, -1] - joints[0, -1])
        links = np.diff(joints[-1], axis=0)
        turned = int(np.count_nonzero(np.abs(links[:, 1]) > np.abs(links[:, 0])))
        print(f"{slip:4.2f}  {moved:11.1f} mm   {turned:4d} of {len(links)}")


def draw(poses, path):
    """Draw the chain where it comes to rest, and on its way there on gravel."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    for slip, joints in poses.items():
        name, color = SLIPS.get(slip, ("", "#5d7388"))
        label = f"$\\nu$ = {slip:g}" + (f"  ({name})" if name else "")
        left.plot(*joints[-1].T, ".-", color=color, markersize=3.5, linewidth=1.0, label=label)
    first = next(iter(poses.values()))[0]
    left.plot(*first.T, ":", color="#5d7388", label="at first")
    left.set(title="where the chain comes to rest", xlabel="x [mm]", ylabel="y [mm]")
    left.legend(frameon=False, fontsize=8, loc=(0.45, 0.1))
    gravel = pull(0.86)
    for stage in range(0, len(gravel), 40):
        shade = 0.25 + 0.75 * stage / (len(gravel) - 1)
        right.plot(*gravel[stage].T, color="#0f7b6c", alpha=shade, linewidth=1.4)
    for joint, color in ((0, "#17212b"), (20, "#b26a00"), (40, "#2f7fd0")):
        name = f"way of joint {joint}" + (" (head)" if joint == 0 else "")
        right.plot(*gravel[:, joint].T, "--", color=color, linewidth=1.0, label=name)
    right.legend(frameon=False, fontsize=8, loc="lower right")
    right.set(title="on gravel, every 80 mm", xlabel="x [mm]")
    for axes in (left, right):
        axes.set_aspect("equal")
    figure.savefig(path, dpi=110)


def main(arguments=None):
    """Run the example."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slip", type=float, nargs="+", default=list(SLIPS), help="nu, 0 to 1")
    parser.add_argument("--out", type=Path, default=Path("bicycle_chain.png"))
    given = parser.parse_args(arguments)
    poses = {slip: pull(slip) for slip in given.slip}
    print_table(poses)
    draw(poses, given.out)
    return poses


if __name__ == "__main__":
    main()

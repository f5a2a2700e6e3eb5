"""Steer the catheter tip by a thumb-stick, as the thesis's controller does (section 4.6).

    python examples/effector_stick.py                 a round of the stick, made up here
    python examples/effector_stick.py readings.csv    your own: two columns of raw readings, 0..1023

Each reading becomes a target in the workspace, and pressures by the exact inverse and by a cubic
fit; the model says where the tip goes under both, and how long one step takes.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from bozzini.effector import (
    Effector,
    Stick,
    effector_preset,
    find_stick_scale,
    fit_cubic,
    trace_path,
    workspace,
)

STICK = Stick(dead_zone=20.0)


def turn_stick(count=120):
    """Make up readings: from the centre to the right, and once round at half travel."""
    out = np.linspace(0.0, 0.5, count // 4)
    angle = np.linspace(0.0, 2.0 * np.pi, count - len(out))
    x = np.concatenate([out, 0.5 * np.cos(angle)])
    y = np.concatenate([0.0 * out, 0.5 * np.sin(angle)])
    raw = STICK.centre + STICK.span * np.stack([x, -y], axis=1)  # readings count downwards
    return np.clip(np.rint(raw), 0.0, STICK.highest)


def read_readings(path):
    """Read two columns of raw readings."""
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    raw = np.loadtxt(lines or ["0"], delimiter=",", ndmin=2)
    if raw.shape[1:] != (2,) or not len(raw):
        raise ValueError(f"{path} has readings of shape {raw.shape}: give two columns")
    return raw


def main(arguments=None):
    """Run the example."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("readings", nargs="?", type=Path, help="your own readings (.csv)")
    parser.add_argument("--out", type=Path, default=Path("effector_stick.png"))
    given = parser.parse_args(arguments)
    effector = Effector(effector_preset("prototype"))
    scale = find_stick_scale(effector)
    try:
        raw = turn_stick() if given.readings is None else read_readings(given.readings)
        targets = scale * STICK.find_travel(raw)
    except (OSError, ValueError) as error:  # one line, whatever the file has
        parser.error(" ".join(str(error).split()))
    print(f"{len(raw)} readings; a full stick is {scale:.2f} mm")

    exact = trace_path(effector, targets)
    cubics = {name: fit_cubic(effector, name, start=0.1) for name in effector.design.names}
    cubic = trace_path(effector, targets, cubics=cubics)
    inside = exact.reachable
    for found in (exact, cubic):
        off = found.error[inside].max(initial=0.0)
        print(f"{found.pressure_map:6s} pressures: off by {off:.2g} mm where the tip can go")
    print(f"{np.count_nonzero(~inside)} of the readings lead out of reach; the direction is kept")

    begin = time.perf_counter()
    for target in targets:
        trace_path(effector, target[None])
    each = (time.perf_counter() - begin) / len(targets)
    print(f"a step, inverse and pose, takes {1e6 * each:.0f} us")

    from bozzini.plot import write_figure
    from bozzini.plot.effector import draw_trace

    outline = workspace(effector).boundary
    write_figure(draw_trace(cubic, effector.design.names, outline=outline), given.out)
    return {"exact": exact, "cubic": cubic, "scale": scale}


if __name__ == "__main__":
    main()

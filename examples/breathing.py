"""Plan a scope again and again while breathing sways the tract sideways.

    python examples/breathing.py                  a phantom tract
    python examples/breathing.py tract.nii.gz     your own: a surface or one label

In each frame the field of the moved lumen is built anew (this takes nearly all of the time: see
the table), the last head path is moved with the tissue, and the motion is planned and proved
again. Each proof is for the lumen as it stands in its frame.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from bozzini.anatomy import LabelTract, make_phantom, read_tract
from bozzini.duct import build_field, find_centreline
from bozzini.motion import FreeSpace, Scope, plan_insertion, replan
from bozzini.motion.measures import measure_body

AMPLITUDE = 6.0  # of the sideways wave [mm]
WAVELENGTH = 200.0  # along the body's axis [mm]


def breathe(points, begin, end):
    """Move tissue from one time of the breath to another (0 out, 0.5 in, 1 out again).

    A wave along z that sways x: u = A sin^2(pi t) cos(2 pi z / wavelength).
    """
    moved = np.array(points, dtype=float)
    depth = np.sin(np.pi * end) ** 2 - np.sin(np.pi * begin) ** 2
    moved[..., 0] += AMPLITUDE * depth * np.cos(2.0 * np.pi * moved[..., 2] / WAVELENGTH)
    return moved


def move_tract(tract, now):
    """Return the tract at a time of the breath."""
    if not isinstance(tract, LabelTract):
        return replace(tract, vertices=breathe(tract.vertices, 0.0, now))
    pad = int(np.ceil(AMPLITUDE / tract.spacing.min())) + 2
    affine = tract.affine.copy()
    affine[:3, 3] -= pad * affine[:3, :3].sum(axis=1)
    labels = np.pad(tract.labels, pad)
    # A voxel now is what the tissue at its centre was at rest.
    centres = np.argwhere(np.ones_like(labels)) @ affine[:3, :3].T + affine[:3, 3]
    source = (breathe(centres, now, 0.0) - affine[:3, 3]) @ np.linalg.inv(affine[:3, :3]).T
    source = np.clip(np.rint(source).astype(int), 0, np.array(labels.shape) - 1)
    return replace(tract, labels=labels[tuple(source.T)].reshape(labels.shape), affine=affine)


def follow_breath(tract, scope, *, frames=8, voxel=2.0):
    """Plan in every frame of one breath; return a row of results per frame."""
    field = build_field(move_tract(tract, 0.0), voxel=voxel)
    plan = still = plan_insertion(field, find_centreline(field), scope=scope)
    # Once, to have everything compiled before anything is timed.
    replan(plan, field)
    rows = []
    for frame in range(1, frames + 1):
        last, now = (frame - 1) / frames, frame / frames
        moved = move_tract(tract, now)
        begin = time.perf_counter()
        field = build_field(moved, voxel=voxel)
        built = time.perf_counter()
        plan = replan(plan, field, advect=lambda points, a=last, b=now: breathe(points, a, b))
        done = time.perf_counter()
        rows.append(
            {
                "frame": frame,
                "plan": plan,
                "field": field,
                "field_s": built - begin,
                "replan_ms": 1e3 * (done - built),
                "certified_mm": plan.certificate.clearance,
                "first_plan_mm": measure_body(
                    FreeSpace(field, introducer=still.introducer), still.joints, scope
                )[0].min(),
            }
        )
        if plan.status != "complete":
            break
    return rows


def print_table(rows):
    """Print what came out, frame by frame."""
    print("frame  tissue moved  path       field    re-plan  certified  first plan, if kept")
    for row in rows:
        note = row["plan"].replan
        how = f"moved+{note.sweeps}" if note.warm else "in full"
        print(
            f"{row['frame']:5d}  {note.tissue_move:9.2f} mm  {how:9s} "
            f"{row['field_s']:6.2f} s  {row['replan_ms']:5.0f} ms  {row['certified_mm']:6.2f} mm  "
            f"{row['first_plan_mm']:6.2f} mm   {row['plan'].reason}"
        )


def draw(rows, path):
    """Draw head paths from the front, and the certified clearance over the breath."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.5))
    middle = max(rows, key=lambda row: np.sin(np.pi * row["frame"] / len(rows)))
    for row, color, name in ((middle, "#2f7fd0", "breathed in"), (rows[-1], "#17212b", "out")):
        field = row["field"]
        index = np.stack(np.indices((field.values.shape[0], 1, field.values.shape[2])), axis=-1)
        nodes = field.to_world(index[:, 0] * field.spacing)
        shadow = field.values.min(axis=1)
        left.contour(nodes[..., 0], nodes[..., 2], shadow, [0.0], colors=color, linewidths=0.8)
        left.plot(*row["plan"].path[:, [0, 2]].T, color=color, linewidth=1.4, label=name)
    left.set(xlabel="x [mm]", ylabel="z [mm]", title="lumen and head path", aspect="equal")
    left.legend(frameon=False, fontsize=8, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.13))
    frames = [row["frame"] for row in rows]
    right.plot(
        frames,
        [row["certified_mm"] for row in rows],
        "o-",
        color="#0f7b6c",
        label="planned again: proved",
    )
    right.plot(
        frames,
        [row["first_plan_mm"] for row in rows],
        "s--",
        color="#b3261e",
        label="first plan, kept: estimated",
    )
    right.axhline(0.0, color="#17212b", linewidth=0.8)
    right.set(xlabel="frame", ylabel="clearance [mm]", title="one breath")
    right.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=110)


def main(arguments=None):
    """Run the example."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tract", nargs="?", type=Path, help="label volume or surface")
    parser.add_argument("--diameter", type=float, default=8.0, help="of the scope [mm]")
    parser.add_argument("--link", type=float, default=12.0, help="length of a link [mm]")
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--voxel", type=float, default=2.0, help="of the field [mm]")
    parser.add_argument("--out", type=Path, default=Path("breathing.png"))
    given = parser.parse_args(arguments)
    tract = make_phantom().to_surface(2.0) if given.tract is None else read_tract(given.tract)
    scope = Scope(diameter=given.diameter, link_length=given.link)
    rows = follow_breath(tract, scope, frames=given.frames, voxel=given.voxel)
    print_table(rows)
    draw(rows, given.out)
    return rows


if __name__ == "__main__":
    main()

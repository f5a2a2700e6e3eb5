"""Plan a scope again and again while breathing sways the tract sideways.

    python examples/breathing.py                  a phantom tract
    python examples/breathing.py tract.nii.gz     your own: a surface or one label

The field of the tract is built once, at rest. In each frame the distance to the moved wall is made
anew near the path, the last head path is moved with the tissue, and the motion is planned and
proved again. Each proof is for the lumen as it stands in its frame.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from bozzini.anatomy import Breathing, make_phantom, read_tract
from bozzini.duct import MovingField, build_field, carry_tissue, find_centreline, trace_back
from bozzini.motion import ReplanOptions, Scope, plan_insertion, replan

BREATH = Breathing(
    amplitude=6.0, wavelength=200.0, period=4.0, direction=(1.0, 0.0, 0.0), along=(0.0, 0.0, 1.0)
)


def follow_breath(tract, scope, *, frames=8, voxel=2.0, breath=BREATH):
    """Plan in every frame of one breath; return a row of results per frame."""
    field = build_field(tract, voxel=voxel)
    moving = MovingField(field, tract if tract.kind == "surface" else None)
    last = breath.at(0.0)
    plan = still = plan_insertion(field, find_centreline(field), scope=scope, method="tube")
    body = sample_body(still)
    rows = []
    # The first time everything is compiled: it is not kept.
    for frame in (0, *range(frames + 1)):
        now = breath.at(breath.period * frame / frames)
        begin = time.perf_counter()
        path = carry_tissue(plan.path, last, now=now)
        lumen = moving.update(
            now,
            gradient_bound=now.gradient_bound,
            second_bound=now.second_bound,
            path=path,
            radius=scope.radius,
        )
        built = time.perf_counter()
        plan = replan(
            plan,
            lumen,
            advect=lambda points, a=last, b=now: carry_tissue(points, a, now=b),
            options=ReplanOptions(measure=False),
        )
        done = time.perf_counter()
        last = now
        # How deep the first plan's body would be in the tissue as it lies now.
        depth = -field.signed_distance(trace_back(body, now)) - scope.radius
        row = {
            "frame": frame,
            "plan": plan,
            "displacement": now,
            "field_ms": 1e3 * (built - begin),
            "replan_ms": 1e3 * (done - built),
            "certified_mm": plan.certificate.clearance,
            "first_plan_mm": depth.min(),
        }
        if frame > 0:
            rows.append(row)
        if plan.status != "complete":
            break
    return field, rows


def sample_body(plan):
    """Return points on the links of a plan, without those in the introducer."""
    joints = plan.joints[:: max(1, plan.steps // 60)]
    share = np.linspace(0.0, 1.0, 9)[:, None, None, None]
    points = (joints[:, :-1] + share * (joints[:, 1:] - joints[:, :-1])).reshape(-1, 3)
    tube = plan.get_introducer()
    return points[(points - tube.entry) @ tube.outward < -0.5 * plan.get_scope().diameter]


def print_table(rows):
    """Print what came out, frame by frame."""
    print("frame  tissue moved  path       field   re-plan  certified  first plan, if kept")
    for row in rows:
        note = row["plan"].replan
        how = f"moved+{note.sweeps}" if note.warm else "in full"
        print(
            f"{row['frame']:5d}  {note.tissue_move:9.2f} mm  {how:9s} "
            f"{row['field_ms']:5.0f} ms  {row['replan_ms']:4.0f} ms  {row['certified_mm']:6.2f} mm "
            f" {row['first_plan_mm']:6.2f} mm   {row['plan'].reason}"
        )


def draw(field, rows, path):
    """Draw head paths from the front, and the certified clearance over the breath."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.5))
    middle = max(rows, key=lambda row: np.sin(np.pi * row["frame"] / len(rows)))
    shape = field.values.shape
    index = np.stack(np.indices((shape[0], 1, shape[2])), axis=-1)[:, 0]
    nodes = field.to_world(index * field.spacing)
    shadow = field.values.min(axis=1)
    for row, color, name in ((middle, "#2f7fd0", "breathed in"), (rows[-1], "#17212b", "out")):
        moved = nodes + row["displacement"](nodes.reshape(-1, 3)).reshape(nodes.shape)
        left.contour(moved[..., 0], moved[..., 2], shadow, [0.0], colors=color, linewidths=0.8)
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
    parser.add_argument("--voxel", type=float, default=1.5, help="of the field [mm]")
    parser.add_argument("--out", type=Path, default=Path("breathing.png"))
    given = parser.parse_args(arguments)
    tract = make_phantom().to_surface(2.0) if given.tract is None else read_tract(given.tract)
    scope = Scope(diameter=given.diameter, link_length=given.link)
    field, rows = follow_breath(tract, scope, frames=given.frames, voxel=given.voxel)
    print_table(rows)
    draw(field, rows, given.out)
    return rows


if __name__ == "__main__":
    main()

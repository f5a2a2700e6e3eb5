"""The same bent pipe in every representation of a duct: one link, and a chain of 40, through each.

    python examples/duct_family.py

The head goes along the middle of the pipe. A single link's tail moves least at each step, with the
scope's radius kept from the wall (thesis eq. 5.15); a chain does so link after link
(`method="thesis"`). Every motion of a chain is held against the duct again by a certificate, for
the whole body: the scheme itself looks at joints only. Compare thesis Figs 5.14 to 5.28.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from bozzini.duct import Centreline, Circles, Polygon, RoundCones
from bozzini.duct.compose import without
from bozzini.duct.shapes.curves import BetweenCurves
from bozzini.duct.shapes.cylinders import ConnectedCylinders
from bozzini.duct.shapes.mesh import TriangleMesh
from bozzini.duct.shapes.points import PointCloud
from bozzini.duct.shapes.polyhedron import ConvexPolyhedra
from bozzini.duct.shapes.quads import StitchedQuads
from bozzini.duct.shapes.super_ellipses import SuperEllipses, SuperEllipsoids
from bozzini.motion import PlannerOptions, Scope, place_tail, plan_insertion

RADIUS = 8.0  # of the pipe [mm]
BEND = 30.0  # radius of its middle line in both bends [mm]
LIMB = 50.0  # length of its straight ends [mm]
LINKS = 40
CHAIN = Scope(diameter=6.0, link_length=4.4, length=LINKS * 4.4)
LINK = 20.0  # length of the single link [mm]
STEP = 0.5  # of the head [mm]
OPTIONS = PlannerOptions(head_step=STEP)
COLORS = {"wall": "#5d7388", "lumen": "#e8eef3", "link": "#2f7fd0", "chain": "#0f7b6c"}


def follow_pipe(arc):
    """Return points (n, 2) of the pipe's middle line, and the directions along it (n, 2)."""
    arc = np.asarray(arc, dtype=float)
    quarter = 0.5 * np.pi * BEND
    first = np.clip(arc - LIMB, 0.0, quarter) / BEND
    second = np.clip(arc - LIMB - quarter, 0.0, quarter) / BEND
    rest = arc - LIMB - BEND * (first + second)
    before, after = np.minimum(rest, 0.0), np.maximum(rest, 0.0)
    heading = first - second
    x = LIMB + before + BEND * (np.sin(first) + 1.0 - np.cos(second)) + after
    y = BEND * (1.0 - np.cos(first) + np.sin(second))
    return np.stack([x, y], axis=-1), np.stack([np.cos(heading), np.sin(heading)], axis=-1)


LENGTH = 2.0 * LIMB + np.pi * BEND


def offset_wall(arc, distance):
    """Return points (n, 2) at `distance` to the left of the middle line."""
    middle, along = follow_pipe(arc)
    return middle + distance * np.stack([-along[:, 1], along[:, 0]], axis=1)


def make_planar():
    """Return the planar pipe by name of its representation."""
    arc = np.linspace(0.0, LENGTH, 98)
    left, right = offset_wall(arc, RADIUS), offset_wall(arc, -RADIUS)
    polygon = Polygon(np.concatenate([left, right[::-1]]))
    middle, along = follow_pipe(np.arange(3.0, LENGTH, 6.0))
    above, below = np.array([30.0, 62.0, 125.0]), np.array([46.0, 110.0, 160.0])
    stones = np.concatenate([offset_wall(above, 7.0), offset_wall(below, -7.0)])
    pebbles = Circles(stones, np.full(len(stones), 2.5))
    return {
        "polygon": polygon,
        "stitched quads": StitchedQuads(left, right),
        "super-ellipses": SuperEllipses(
            middle,
            np.broadcast_to([7.0, RADIUS], (len(middle), 2)),
            powers=np.full(len(middle), 6.0),
            angles=np.arctan2(along[:, 1], along[:, 0]),
        ),
        "between curves": BetweenCurves(
            lambda arc: offset_wall(arc, -RADIUS),
            lambda arc: offset_wall(arc, RADIUS),
            span=(0.0, LENGTH),
        ),
        "sampled, planar": polygon.sample(0.5),
        "with obstacles": without(polygon, pebbles),
    }


def make_rings(arc, count=32):
    """Return rings (n, count, 3) around the pipe, and the outward normals there."""
    middle, along = follow_pipe(arc)
    turn = 2.0 * np.pi * np.arange(count) / count
    across = np.stack([-along[:, 1], along[:, 0], 0.0 * arc], axis=1)
    normals = np.cos(turn)[None, :, None] * across[:, None] + np.sin(turn)[None, :, None] * [
        0,
        0,
        1,
    ]
    return np.pad(middle, ((0, 0), (0, 1)))[:, None] + RADIUS * normals, normals


def make_mesh(spacing=3.0):
    """Return vertices and faces of the pipe, its ends closed by fans."""
    rings, _ = make_rings(np.linspace(0.0, LENGTH, round(LENGTH / spacing) + 1))
    count, around = rings.shape[:2]
    index = np.arange(count * around).reshape(count, around)
    a, b = index[:-1], index[1:]
    a2, b2 = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    faces = [np.stack([a, a2, b], axis=-1), np.stack([a2, b2, b], axis=-1)]
    faces = [part.reshape(-1, 3) for part in faces]
    for ring, middle, turn in ((index[0], count * around, -1), (index[-1], count * around + 1, 1)):
        fan = np.stack([np.full(around, middle), ring, np.roll(ring, -1)], axis=1)
        faces.append(fan[:, ::turn])
    ends = rings[[0, -1]].mean(axis=1)
    return np.concatenate([rings.reshape(-1, 3), ends]), np.concatenate(faces)


def sample_wall():
    """Return points (n, 3) of the pipe's wall and of both ends, about 1 mm apart."""
    rings, _ = make_rings(np.linspace(0.0, LENGTH, round(LENGTH) + 1), 51)
    ends = rings[[0, -1]]
    middle = ends.mean(axis=1, keepdims=True)
    discs = [middle + share * (ends - middle) for share in np.arange(0.0, 1.0, 0.1)]
    return np.concatenate([rings.reshape(-1, 3), *(disc.reshape(-1, 3) for disc in discs)])


def make_solid():
    """Return the round pipe in space by name of its representation."""
    knots = np.linspace(0.0, LENGTH, 41)
    middle, along = (np.pad(part, ((0, 0), (0, 1))) for part in follow_pipe(knots))
    radii = np.full(len(knots), RADIUS)
    across = np.stack([-along[:, 1], along[:, 0], 0.0 * radii], axis=1)
    frames = np.stack([across, np.broadcast_to([0.0, 0.0, 1.0], across.shape), along], axis=2)
    rings, _ = make_rings(np.linspace(0.0, LENGTH, 65), 16)
    vertices, faces = make_mesh()
    samples = sample_wall()
    cones = RoundCones(middle, radii)
    return {
        "round cones": cones,
        "cylinders": ConnectedCylinders(middle, along, radii),
        "super-ellipsoids": SuperEllipsoids(
            middle,
            np.broadcast_to([RADIUS, RADIUS, 6.0], middle.shape),
            e1=np.full(len(knots), 0.3),
            e2=np.ones(len(knots)),
            rotations=frames,
        ),
        "convex polyhedra": ConvexPolyhedra.from_points(
            [rings[k : k + 5].reshape(-1, 3) for k in range(len(rings) - 4)]
        ),
        "mesh": TriangleMesh(vertices, faces),
        "points of the wall": PointCloud(samples, 1.0, seeds=middle[20:21]),
        "sampled field": cones.sample(1.0),
    }


def make_line(duct):
    """Return the middle line as the head's way, away from the pipe's closed ends."""
    points, _ = follow_pipe(np.arange(10.0, LENGTH - 9.5, 1.0))
    return Centreline.from_points(np.pad(points, ((0, 0), (0, duct.bounds.shape[1] - 2))), duct)


def move_link(duct, line):
    """Return heads and tails (n, dim) of one link, moved through the duct as far as it goes."""
    arc = np.arange(LINK, line.length, STEP)
    heads = np.stack([np.interp(arc, line.arc_length, column) for column in line.points.T], axis=1)
    tails = [line.points[0]]
    for head in heads:
        placed = place_tail(duct, head, old_tail=tails[-1], length=LINK, clearance=CHAIN.radius)
        if not placed.found:
            print(f"    {placed.reason}")
            break
        tails.append(placed.tail)
    return heads[: len(tails) - 1], np.array(tails[1:])


def run(ducts):
    """Move a link and a chain through each duct; return what came of it, by name."""
    results = {}
    for name, duct in ducts.items():
        line = make_line(duct)
        heads, tails = move_link(duct, line)
        plan = plan_insertion(duct, line, scope=CHAIN, method="thesis", options=OPTIONS)
        proved = plan.certificate.clearance
        room = -duct.signed_distance(tails).max()
        print(
            f"{name:18s}  link: {len(tails):3d} steps, tail {room:.2f} mm from the wall   chain: "
            f"{plan.links} links, {plan.steps} steps, {plan.status}, body at least {proved:.2f} mm"
        )
        results[name] = {"duct": duct, "heads": heads, "tails": tails, "plan": plan}
    return results


def draw(results, path):
    """Draw each duct twice: every twentieth place of the link, and the chain at its end."""
    from matplotlib.figure import Figure

    names = list(results)
    figure = Figure(figsize=(11.0, 2.55 * len(names)), layout="constrained")
    panels = figure.subplots(len(names), 2, sharex=True, sharey=True, squeeze=False)
    x, y = np.meshgrid(np.linspace(-10.0, 170.0, 361), np.linspace(-10.0, 70.0, 161))
    for name, (left, right) in zip(names, panels, strict=False):
        result = results[name]
        dim = result["duct"].bounds.shape[1]
        grid = np.pad(np.stack([x, y], axis=-1), ((0, 0), (0, 0), (0, dim - 2)))
        value = result["duct"].signed_distance(grid)
        for axes in (left, right):
            axes.contourf(x, y, value, [-99.0, 0.0], colors=[COLORS["lumen"]])
            axes.contour(x, y, value, [0.0], colors=[COLORS["wall"]], linewidths=0.8)
            axes.set(aspect="equal", xticks=[], yticks=[])
            axes.set_frame_on(False)
        ends = np.stack([result["heads"], result["tails"]])[:, ::20]
        left.plot(*ends[..., :2].transpose(2, 0, 1), color=COLORS["link"], linewidth=1.1)
        left.plot(*ends[0, :, :2].T, ".", color=COLORS["link"], markersize=6.0)
        chain = result["plan"].joints[-1]
        right.plot(*chain.T[:2], ".-", color=COLORS["chain"], markersize=5.0, linewidth=1.1)
        left.set_title(name, fontsize=12, loc="left")
    bar = panels[0, 1]
    bar.plot([120.0, 170.0], [-6.0, -6.0], color="#2b3640", linewidth=2.0, solid_capstyle="butt")
    bar.text(145.0, -3.0, "50 mm", ha="center", va="bottom", fontsize=10)
    figure.savefig(path, dpi=80)


def main(arguments=None):
    """Run the example."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", default=None, help="names of representations")
    parser.add_argument("--out", type=Path, default=Path("duct_family.png"))
    given = parser.parse_args(arguments)
    ducts = {**make_planar(), **make_solid()}
    unknown = set(given.only or []) - set(ducts)
    if unknown:
        parser.error(f"--only: {sorted(unknown)} must be among {', '.join(ducts)}")
    results = run({name: duct for name, duct in ducts.items() if name in (given.only or ducts)})
    draw(results, given.out)
    return results


if __name__ == "__main__":
    main()

"""Draw what `bozzini continuum fabricate` and `bozzini effector fabricate` make.

    python examples/fabricate.py

A section with two helical tendons as discs and as a sleeve, its routing unrolled, and the holders
and fittings of the thesis's end-effector in a holder of 11 mm.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from bozzini.continuum import Helix, RobotDesign, Section, Tendon
from bozzini.effector import effector_preset
from bozzini.fabricate import BodyOptions, build_body, build_holders, tabulate_routing

ROBOT = RobotDesign(
    [
        Section(
            length=40.0,
            radius=5.0,
            discs=5,
            tendons=[
                Tendon(name="A", offset=3.8, angle=Helix(start=0.0, turns=0.75)),
                Tendon(name="B", offset=[(0.0, 3.8), (20.0, 1.8), (40.0, 3.8)], angle=2.6),
            ],
        )
    ]
)
BODY = {"tendon_diameter": 0.6, "backbone_diameter": 1.5}
LIGHT = np.array([0.35, -0.75, 0.55])


def draw_solid(axes, meshes, *, cut=False):
    """Draw meshes in shades of grey; `cut` leaves out the triangles at the front."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    triangles = np.concatenate([mesh.triangles for mesh in meshes])
    normals = np.concatenate([mesh.face_normals for mesh in meshes])
    if cut:
        kept = triangles.mean(axis=1)[:, 1] > -0.5
        triangles, normals = triangles[kept], normals[kept]
    shade = 0.45 + 0.5 * np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
    colors = shade[:, None] * np.array([0.80, 0.88, 0.95])
    axes.add_collection3d(
        Poly3DCollection(triangles, facecolors=colors, edgecolors=colors, linewidths=0.2)
    )
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    for name, a, b in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{name}lim")(a, b)
    axes.set_box_aspect(high - low, zoom=1.25)
    axes.view_init(elev=24.0, azim=-75.0)
    axes.set_axis_off()


def place_copies(parts, wall):
    """Return the meshes of parts where they stand in the assembly."""
    meshes = []
    for part in parts:
        mesh = part.mesh(wall)
        meshes += [mesh.copy().apply_translation(place) for place in part.places]
    return meshes


def draw(path):
    """Draw four panels and return the meshes in them."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    grid = figure.add_gridspec(2, 4, height_ratios=(1.0, 1.5))
    tabulate_routing(ROBOT, 0.5).plot(figure.add_subplot(grid[0, :]))
    design = effector_preset("prototype", holder_diameter=11.0)
    proximal, distal, fitting, pin = build_holders(design)
    panels = {
        "discs": (place_copies(build_body(ROBOT, BodyOptions(**BODY)), 0.4), False),
        "sleeve, cut open": (
            place_copies(build_body(ROBOT, BodyOptions(form="sleeve", **BODY)), 0.4),
            True,
        ),
        "holders with fittings": (place_copies([proximal, distal, fitting, pin], 0.3), False),
        "proximal holder, fitting, pin": (
            [
                proximal.mesh(0.3),
                fitting.mesh(0.3).apply_translation([12.0, 0.0, 0.0]),
                pin.mesh(0.3).apply_translation([18.0, 0.0, -5.0]),
            ],
            False,
        ),
    }
    shown = []
    for k, (title, (meshes, cut)) in enumerate(panels.items()):
        axes = figure.add_subplot(grid[1, k], projection="3d")
        draw_solid(axes, meshes, cut=cut)
        axes.set_title(title, fontsize=10)
        shown += meshes
    figure.savefig(path, dpi=110)
    return shown


def main(arguments=None):
    """Write the picture and return its meshes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("fabricate.png"))
    given = parser.parse_args(arguments)
    meshes = draw(given.out)
    print(f"{given.out}: {len(meshes)} solids")
    return meshes


if __name__ == "__main__":
    main()

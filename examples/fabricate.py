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
PLACES = ((-0.06, 0.03, 0.38), (0.16, 0.03, 0.38), (0.38, 0.03, 0.38), (0.62, 0.05, 0.36))
BODY = {"tendon_diameter": 0.6, "backbone_diameter": 0.8}
VIEW = np.array([0.236, -0.882, 0.407])  # towards the viewer
LIGHT = np.array([0.35, -0.75, 0.55])


def draw_solid(axes, meshes, *, cut=False):
    """Draw meshes, the walls of channels in amber; `cut` leaves out the outside at the front."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    triangles = np.concatenate([mesh.triangles for mesh in meshes])
    normals = np.concatenate([mesh.face_normals for mesh in meshes])
    hole = np.concatenate([find_channels(mesh) for mesh in meshes])
    # Of a closed solid only triangles that face the viewer are seen.
    kept = hole | (triangles[:, :, 1].min(axis=1) > -0.3) if cut else normals @ VIEW > 0.0
    triangles, normals, hole = triangles[kept], normals[kept], hole[kept]
    shade = 0.45 + 0.5 * np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
    tint = np.where(hole[:, None], [0.95, 0.68, 0.30], [0.80, 0.88, 0.95])
    colors = shade[:, None] * tint
    axes.computed_zorder = False
    # Walls of channels lie behind the outside, but where it is cut open.
    for order, part in ((2.0 * cut, hole), (1.0, ~hole)):
        look = {"facecolors": colors[part], "edgecolors": colors[part], "linewidths": 0.2}
        axes.add_collection3d(Poly3DCollection(triangles[part], zorder=order, **look))
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    for name, a, b in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{name}lim")(a, b)
    axes.set_box_aspect(high - low, zoom=0.9)
    axes.view_init(elev=24.0, azim=-75.0)
    axes.set_proj_type("ortho")
    axes.set_axis_off()


def find_channels(mesh):
    """Return which triangles (n,) are walls of channels: those that face their own middle."""
    import trimesh

    steep = np.flatnonzero(np.abs(mesh.face_normals[:, 2]) < 0.9)
    pairs = mesh.face_adjacency[np.isin(mesh.face_adjacency, steep).all(axis=1)]
    found = np.zeros(len(mesh.faces), dtype=bool)
    for part in trimesh.graph.connected_components(pairs, nodes=steep, min_len=2):
        height = mesh.triangles_center[part][:, 2]
        low = part[height < height.min() + 1.0]
        aside = mesh.triangles_center[low] - mesh.triangles_center[low].mean(axis=0)
        found[part] = np.sum(aside * mesh.face_normals[low]) < 0.0
    return found


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

    figure = Figure(figsize=(11.0, 7.6))
    tabulate_routing(ROBOT, 0.5).plot(figure.add_axes((0.07, 0.69, 0.9, 0.25)))
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
                fitting.mesh(0.3).apply_translation([8.5, 0.0, 0.0]),
                pin.mesh(0.3).apply_translation([12.0, 0.0, -5.0]),
            ],
            False,
        ),
    }
    shown = []
    for k, (title, (meshes, cut)) in enumerate(panels.items()):
        left, bottom, size = PLACES[k]
        axes = figure.add_axes((left, bottom, size, size * 11.0 / 7.6), projection="3d")
        axes.patch.set_visible(False)
        draw_solid(axes, meshes, cut=cut)
        figure.text(left + 0.5 * size, 0.015, title, ha="center", fontsize=10)
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

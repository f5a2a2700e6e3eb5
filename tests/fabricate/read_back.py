"""Cylinders read back from files: from an STL's triangles, and from a STEP's text."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import trimesh


@dataclass(frozen=True)
class Cylinder:
    """A round wall; `inside` for a hole."""

    point: np.ndarray  # where its axis crosses z = 0
    way: np.ndarray  # along its axis, upwards
    diameter: float
    inside: bool
    rings: dict[float, np.ndarray]


def read_walls(path):
    """Return the walls of an STL that are not flat: connected triangles off the faces across z."""
    mesh = trimesh.load(path)
    assert mesh.is_volume
    assert mesh.volume > 0.0
    steep = np.flatnonzero(np.abs(mesh.face_normals[:, 2]) < 0.9)
    pairs = mesh.face_adjacency[np.isin(mesh.face_adjacency, steep).all(axis=1)]
    parts = trimesh.graph.connected_components(pairs, nodes=steep, min_len=2)
    return [_fit(mesh, part) for part in parts]


def read_cylinders(path):
    """The same, in the order of holes by diameter; each wall must be a straight cylinder."""
    return sorted(read_walls(path), key=lambda wall: (not wall.inside, wall.diameter))


def _fit(mesh, part):
    normals = mesh.face_normals[part]
    weights = mesh.area_faces[part][:, None]
    way = np.linalg.svd(np.sqrt(weights) * normals, full_matrices=False)[2][2]
    way = way * np.sign(way[2])
    points = mesh.vertices[np.unique(mesh.faces[part])]
    first = np.cross(way, [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    plane = np.stack([first, np.cross(way, first)])
    u, v = plane @ points.T
    (a, b, c), *_ = np.linalg.lstsq(
        np.column_stack([2 * u, 2 * v, np.ones_like(u)]), u * u + v * v, rcond=None
    )
    centre = a * plane[0] + b * plane[1]
    middle = mesh.triangles_center[part].mean(axis=0)
    outwards = mesh.triangles_center[part] - middle
    outwards -= np.outer(outwards @ way, way)
    rings = {
        float(z): points[np.abs(points[:, 2] - z) < 1e-5][:, :2]
        for z in np.unique(np.round(points[:, 2], 5))
    }
    return Cylinder(
        point=centre - centre[2] / way[2] * way,
        way=way,
        diameter=2.0 * float(np.sqrt(c + a * a + b * b)),
        inside=bool(np.sum(outwards * normals) < 0.0),
        rings=rings,
    )


def read_step(path):
    """Return point, direction and diameter of each cylindrical surface in a STEP file's text."""
    text = path.read_text(encoding="utf-8")
    assert "MILLI" in text
    rows = dict(re.findall(r"#(\d+) = (.*?);\s*\n", text.replace("\n  ", " "), re.S))
    rows = {key: " ".join(row.split()) for key, row in rows.items()}

    def numbers(key):
        return np.array(
            [float(n) for n in re.search(r"\(([^()]*)\)\s*\)$", rows[key])[1].split(",")]
        )

    found = []
    for row in rows.values():
        match = re.match(r"CYLINDRICAL_SURFACE\('',#(\d+),([^)]*)\)", row)
        if match:
            origin, axis, _ = re.findall(r"#(\d+)", rows[match[1]])
            point, way = numbers(origin), numbers(axis)
            way = way * np.sign(way[2])
            found.append((point - point[2] / way[2] * way, way, 2.0 * float(match[2])))
    return found

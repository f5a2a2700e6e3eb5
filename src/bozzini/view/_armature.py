"""The scope in the file: an armature of bones, the skin bound to it, and their animation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._bones import compute_bone_rotations, convert_to_matrices
from ._tube import build_tube
from .gltf import ARRAY_BUFFER, GlbDocument

__all__ = ["UPRIGHT", "UPRIGHT_QUATERNION", "add_scope"]

Floats = NDArray[np.float64]

UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turn of -90 degrees about X: world (x, y, z) to glTF (x, z, -y)."""

UPRIGHT_QUATERNION = [-float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5))]
"""The same turn as a quaternion (x, y, z, w)."""


def add_scope(
    document: GlbDocument, poses: Floats, times: Floats, *, radius: float, material: int
) -> tuple[int, int]:
    """Add bones, skin and animation to a document.

    Parameters
    ----------
    document : GlbDocument
        The document to add to.
    poses : ndarray, shape (keys, joints, 3)
        Joint positions in the keys, world frame [m]; joint 0 is the head.
    times : ndarray, shape (keys,)
        Times of the keys [s].
    radius : float
        Radius of the scope [m].
    material : int
        Index of the skin's material.

    Returns
    -------
    armature, skin : int
        The node above the bones, to be put under the world's node, and the node of the skin, to
        be put at the top of the scene.
    """
    rotations = compute_bone_rotations(poses)
    frames = convert_to_matrices(rotations[-1])
    bones = len(frames)
    names = [f"bone_{bone:03d}" for bone in range(bones)]
    nodes = [
        document.add(
            "nodes",
            {
                "name": names[bone],
                "translation": poses[-1, bone].tolist(),
                "rotation": rotations[-1, bone].tolist(),
            },
        )
        for bone in range(bones)
    ]
    armature = document.add("nodes", {"name": "scope", "children": nodes})

    # The skin's vertices are bound in glTF's own frame: a skinned mesh ignores its node's parents.
    frames, head_side = UPRIGHT @ frames, poses[-1] @ UPRIGHT.T
    tube = build_tube(head_side, frames, radius=radius)
    inverse = np.zeros((bones, 4, 4))
    inverse[:, :3, :3] = np.swapaxes(frames, 1, 2)
    inverse[:, :3, 3] = -np.einsum("bji,bj->bi", frames, head_side[:-1])
    inverse[:, 3, 3] = 1.0
    columns = np.swapaxes(inverse, 1, 2).reshape(bones, 16).astype(np.float32)
    skin = document.add(
        "skins",
        {
            "name": "scope",
            "joints": nodes,
            "skeleton": armature,
            "inverseBindMatrices": document.add_array(columns),
        },
    )
    attributes = {
        "POSITION": document.add_array(
            tube.vertices.astype(np.float32), target=ARRAY_BUFFER, bounds=True
        ),
        "NORMAL": document.add_array(tube.normals.astype(np.float32), target=ARRAY_BUFFER),
        "JOINTS_0": document.add_array(tube.bones.astype(np.uint16), target=ARRAY_BUFFER),
        "WEIGHTS_0": document.add_array(tube.weights.astype(np.float32), target=ARRAY_BUFFER),
    }
    primitive = {
        "attributes": attributes,
        "indices": document.add_indices(tube.faces, len(tube.vertices)),
        "material": material,
    }
    mesh = document.add("meshes", {"name": "scope_skin", "primitives": [primitive]})
    skinned = document.add("nodes", {"name": "scope_skin", "mesh": mesh, "skin": skin})
    _add_animation(document, nodes, poses[:, :-1], rotations, times)
    return armature, skinned


def _add_animation(
    document: GlbDocument, nodes: list[int], places: Floats, rotations: Floats, times: Floats
) -> None:
    clock = document.add_array(times.astype(np.float32), bounds=True)
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    for name, values in (("translation", places), ("rotation", rotations)):
        outputs = document.add_arrays(np.swapaxes(values, 0, 1).astype(np.float32))
        for node, output in zip(nodes, outputs, strict=True):
            channels.append({"sampler": len(samplers), "target": {"node": node, "path": name}})
            samplers.append({"input": clock, "interpolation": "LINEAR", "output": output})
    document.add("animations", {"name": "insertion", "channels": channels, "samplers": samplers})

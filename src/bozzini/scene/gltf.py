"""A small writer of binary glTF 2.0 files (``.glb``): arrays in, one file out.

It packs NumPy arrays into the file's one buffer and keeps the JSON lists beside it. trimesh writes
GLB too, but neither skins nor animations.

Source: Khronos Group, glTF 2.0 Specification (ISO/IEC 12113:2022), sections 3.6 (binary data),
3.11 (animations) and 4 (GLB container).
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Json

# The scope's skin: one tube over all links, rounded at the head, closed at the tail.

_SIDES = 16
_CAP_RINGS = 4
_INSET = 0.2


@dataclass(frozen=True, kw_only=True)
class SkinnedTube:
    """A skinned mesh, in the pose in which it is bound.

    Attributes
    ----------
    vertices, normals : ndarray, shape (n, 3)
        In the unit of the joints; normals of unit length.
    faces : ndarray, shape (m, 3)
        Counter-clockwise seen from outside.
    bones : ndarray, shape (n, 4)
        Bone indices; 0 where the weight is 0.
    weights : ndarray, shape (n, 4)
        Each row sums to 1. One bone of weight 1 on a link, two of 1/2 where two links meet.
    """

    vertices: Floats
    normals: Floats
    faces: NDArray[np.int64]
    bones: NDArray[np.int64]
    weights: Floats


def build_tube(joints: Floats, frames: Floats, *, radius: float) -> SkinnedTube:
    """Build the skin around a chain of links.

    Each link carries two rigid rings, set in from its joints; where two links meet, one more ring
    follows both half and half. The head ends in a half-sphere about joint 0, so that the skin is
    the body that clearances are computed for; the tail ends in a flat disc.

    Parameters
    ----------
    joints : ndarray, shape (joints, 3)
        Joint positions in the pose to bind in; joint 0 is the head.
    frames : ndarray, shape (joints - 1, 3, 3)
        Rotation of each bone; its third column points from the head to the tail.
    radius : float
        Radius of the scope, in the unit of the joints.
    """
    bones = len(frames)
    lengths = np.linalg.norm(np.diff(joints, axis=0), axis=1)
    angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(_SIDES)], axis=1)

    # Rings from head to tail: first and second bone, place along each, radius, normal's slope.
    rows: list[tuple[int, int, float, float, float, float]] = []
    for ring in range(_CAP_RINGS):
        height = 0.5 * np.pi * (ring + 1) / _CAP_RINGS
        sine, cosine = float(np.sin(height)), float(np.cos(height))
        rows.append((0, 0, -radius * cosine, -radius * cosine, radius * sine, -cosine))
    for bone, length in enumerate(lengths.tolist()):
        if bone:
            rows.append((bone - 1, bone, float(lengths[bone - 1]), 0.0, radius, 0.0))
        rows.append((bone, bone, _INSET * length, _INSET * length, radius, 0.0))
        rows.append((bone, bone, (1 - _INSET) * length, (1 - _INSET) * length, radius, 0.0))
    end = float(lengths[-1])
    rows.append((bones - 1, bones - 1, end, end, radius, 0.0))
    table = np.array(rows)
    pairs = table[:, :2].astype(np.int64)

    points, normals = [], []
    for side in range(2):
        owner, along = pairs[:, side], table[:, 2 + side]
        local = table[:, 4, None, None] * circle + along[:, None, None] * [0.0, 0.0, 1.0]
        slope = table[:, 5]
        local_normals = np.sqrt(1 - slope**2)[:, None, None] * circle
        local_normals = local_normals + slope[:, None, None] * [0.0, 0.0, 1.0]
        turned = np.einsum("rij,rsj->rsi", frames[owner], local)
        points.append(turned + joints[owner][:, None])
        normals.append(np.einsum("rij,rsj->rsi", frames[owner], local_normals))
    rings = 0.5 * (points[0] + points[1])
    ring_normals = normals[0] + normals[1]
    folded = np.linalg.norm(ring_normals, axis=2) < 1e-6  # a link folded back on its neighbour
    ring_normals[folded] = normals[0][folded]

    # The apex, the rings, and the tail's disc with its own normals.
    back, last = frames[0, :, 2], frames[-1, :, 2]
    vertices = np.concatenate(
        [[joints[0] - radius * back], rings.reshape(-1, 3), rings[-1], [joints[-1]]]
    )
    tail = np.tile(last, (_SIDES + 1, 1))
    all_normals = np.concatenate([[-back], ring_normals.reshape(-1, 3), tail])
    all_normals /= np.linalg.norm(all_normals, axis=1, keepdims=True)
    first = np.concatenate([[0], np.repeat(pairs[:, 0], _SIDES), np.full(_SIDES + 1, bones - 1)])
    second = np.concatenate([[0], np.repeat(pairs[:, 1], _SIDES), np.full(_SIDES + 1, bones - 1)])
    shared = first != second
    indices = np.zeros((len(vertices), 4), dtype=np.int64)
    weights = np.zeros((len(vertices), 4))
    indices[:, 0], indices[shared, 1] = first, second[shared]
    weights[:, 0], weights[shared, 1] = np.where(shared, 0.5, 1.0), 0.5
    return SkinnedTube(
        vertices=vertices,
        normals=all_normals,
        faces=_connect(len(rows)),
        bones=indices,
        weights=weights,
    )


def _connect(rings: int) -> NDArray[np.int64]:
    """Faces of apex, rings and tail disc; rings run from the head (-z) to the tail (+z)."""
    here = np.arange(_SIDES)
    after = (here + 1) % _SIDES
    apex = np.stack([np.zeros_like(here), 1 + after, 1 + here], axis=1)
    start = 1 + _SIDES * np.arange(rings - 1)[:, None]
    a, b = start + here, start + after
    c, d = a + _SIDES, b + _SIDES
    sides = np.concatenate(
        [np.stack([a, b, d], axis=-1).reshape(-1, 3), np.stack([a, d, c], axis=-1).reshape(-1, 3)]
    )
    disc = 1 + _SIDES * rings
    centre = np.full(_SIDES, disc + _SIDES)
    tail = np.stack([centre, disc + here, disc + after], axis=1)
    faces: NDArray[np.int64] = np.concatenate([apex, sides, tail]).astype(np.int64)
    return faces


# Bones of a scope: which poses become keys, and how each link is turned in them.
#
# A bone sits at its link's head-side joint; its local -z runs towards the head, so that a camera
# fixed to the first bone looks along the insertion (glTF cameras look down -z). Quaternions are
# ``(x, y, z, w)``, as in glTF.


def choose_keys(steps: int, keys: int) -> NDArray[np.intp]:
    """Return at most `keys` step indices, evenly spread, the first and last step among them."""
    chosen = np.rint(np.linspace(0, steps - 1, min(steps, keys))).astype(np.intp)
    return np.unique(chosen)


def compute_bone_rotations(joints: Floats) -> Floats:
    """Turn every link by the smallest rotation from key to key, so that none rolls about itself.

    In the first key the frames are carried along the body from the head by smallest rotations
    (a Bishop frame); the head's +y is the world's anterior (+y) as nearly as its direction lets it.

    Parameters
    ----------
    joints : ndarray, shape (keys, joints, 3)
        Joint positions [any length]; joint 0 is the head. No link may have zero length.

    Returns
    -------
    ndarray, shape (keys, joints - 1, 4)
        Unit quaternions (x, y, z, w), sign-continuous over the keys.
    """
    back = np.diff(joints, axis=1)
    back /= np.linalg.norm(back, axis=2, keepdims=True)
    keys, bones = back.shape[:2]
    rotations = np.empty((keys, bones, 4))
    rotations[0, 0] = _orient_head(back[0, 0])
    turns = _find_smallest_rotation(back[0, :-1], back[0, 1:])
    for bone in range(1, bones):
        rotations[0, bone] = _multiply(turns[bone - 1], rotations[0, bone - 1])
    for key in range(1, keys):
        turn = _find_smallest_rotation(back[key - 1], back[key])
        rotations[key] = _multiply(turn, rotations[key - 1])
        rotations[key] /= np.linalg.norm(rotations[key], axis=1, keepdims=True)
    return rotations


def convert_to_matrices(rotations: Floats) -> Floats:
    """Return the rotation matrices of unit quaternions, shape (..., 4) to (..., 3, 3)."""
    matrices = Rotation.from_quat(rotations.reshape(-1, 4)).as_matrix()
    return np.asarray(matrices.reshape(*rotations.shape[:-1], 3, 3))


def _orient_head(back: Floats) -> Floats:
    """Quaternion whose +z is `back` and whose +y is as near the world's +y (else +z) as can be."""
    up = np.array([0.0, 1.0, 0.0]) if abs(back[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    x = np.cross(up, back)
    x /= np.linalg.norm(x)
    y = np.cross(back, x)
    # Turn +z to `back` first, then about `back` until +x is right: two exact steps, no branches.
    swing = _find_smallest_rotation(np.array([[0.0, 0.0, 1.0]]), back[np.newaxis])[0]
    swung = convert_to_matrices(swing)[:, 0]
    half = 0.5 * np.arctan2(-(swung @ y), swung @ x)
    twist = np.append(np.sin(half) * back, np.cos(half))
    return _multiply(twist, swing)


def _find_smallest_rotation(start: Floats, end: Floats) -> Floats:
    """Smallest rotations that take unit vectors (n, 3) to others; w >= 0 always."""
    axis = np.cross(start, end)
    real = 1.0 + np.sum(start * end, axis=1)
    opposite = real < 1e-9
    if np.any(opposite):
        # Half a turn about any perpendicular: take the one across the smallest component.
        across = np.eye(3)[np.argmin(np.abs(start[opposite]), axis=1)]
        axis[opposite] = np.cross(start[opposite], across)
        real[opposite] = 0.0
    quaternion = np.concatenate([axis, real[:, np.newaxis]], axis=1)
    length: Floats = np.linalg.norm(quaternion, axis=1, keepdims=True)
    return quaternion / length


def _multiply(first: Floats, second: Floats) -> Floats:
    """Quaternion product: the rotation `second`, then the rotation `first`."""
    u, a = first[..., :3], first[..., 3:]
    v, b = second[..., :3], second[..., 3:]
    vector = a * v + b * u + np.cross(u, v)
    scalar = a * b - np.sum(u * v, axis=-1, keepdims=True)
    return np.concatenate([vector, scalar], axis=-1)


ARRAY_BUFFER = 34962
"""Buffer target of vertex attributes."""

ELEMENT_ARRAY_BUFFER = 34963
"""Buffer target of vertex indices."""

_COMPONENTS = {
    np.dtype(np.uint8): 5121,
    np.dtype(np.uint16): 5123,
    np.dtype(np.uint32): 5125,
    np.dtype(np.float32): 5126,
}
_WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_MAGIC, _VERSION = 0x46546C67, 2
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942


class GlbDocument:
    """A glTF document being built: JSON lists and one binary buffer.

    Parameters
    ----------
    generator : str
        Name of the writing program, kept in ``asset.generator``.
    extras : dict, optional
        Free notes, kept in ``asset.extras``.

    Notes
    -----
    The same calls give the same bytes: nothing depends on the time or the machine.
    """

    def __init__(self, *, generator: str, extras: Json | None = None) -> None:
        asset: Json = {"version": "2.0", "generator": generator}
        if extras:
            asset["extras"] = extras
        self._json: Json = {"asset": asset}
        self._chunks: list[bytes] = []
        self._length = 0

    def add(self, kind: str, item: Json) -> int:
        """Append `item` to a top-level list (``"nodes"``, ``"meshes"``, …); return its index."""
        items: list[Json] = self._json.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def get(self, kind: str, index: int) -> Json:
        """Return an item of a top-level list, to be completed in place."""
        item: Json = self._json[kind][index]
        return item

    def set_scene(self, index: int) -> None:
        """Make scene `index` the one that viewers show."""
        self._json["scene"] = index

    def use_extension(self, name: str, content: Json | None = None) -> None:
        """Declare an optional extension, with its document-level content if it has one."""
        used: list[str] = self._json.setdefault("extensionsUsed", [])
        if name not in used:
            used.append(name)
        if content is not None:
            self._json.setdefault("extensions", {})[name] = content

    def add_array(
        self, array: NDArray[np.generic], *, target: int | None = None, bounds: bool = False
    ) -> int:
        """Store one array and return its accessor's index.

        Parameters
        ----------
        array : ndarray, shape (n,) or (n, width)
            uint8, uint16, uint32 or float32 values; `width` is 1, 2, 3, 4 or 16.
        target : int, optional
            `ARRAY_BUFFER` or `ELEMENT_ARRAY_BUFFER`; none for animation data.
        bounds : bool
            Whether to write the accessor's min and max (positions and times need them).

        Raises
        ------
        InputError
            If glTF has no accessor for this type or shape.
        """
        return self.add_arrays(array[np.newaxis], target=target, bounds=bounds)[0]

    def add_arrays(
        self, arrays: NDArray[np.generic], *, target: int | None = None, bounds: bool = False
    ) -> list[int]:
        """Store a stack of equal arrays in one buffer view; return one accessor for each.

        Parameters
        ----------
        arrays : ndarray, shape (stack, n) or (stack, n, width)
            As for `add_array`.
        target, bounds
            As for `add_array`.

        Raises
        ------
        InputError
            If glTF has no accessor for this type or shape, or a row is not 4-byte aligned.
        """
        data = np.ascontiguousarray(arrays)
        width = 1 if data.ndim == 2 else int(np.prod(data.shape[2:]))
        if data.dtype not in _COMPONENTS or data.ndim not in (2, 3) or width not in _WIDTHS:
            raise InputError(
                f"array of type {data.dtype} and shape {data.shape} has no glTF accessor: it must "
                "be uint8, uint16, uint32 or float32 of shape (n,) or (n, 1|2|3|4|16)"
            )
        if data.size == 0:
            raise InputError(f"array of shape {data.shape} is empty: glTF accessors are not")
        stride = data[0].nbytes
        if (len(data) > 1 and stride % 4) or (target == ARRAY_BUFFER and data[0, 0].nbytes % 4):
            raise InputError(
                f"array of type {data.dtype} and shape {data.shape} would not be aligned to 4 bytes"
            )
        view = self._add_view(data.astype(data.dtype.newbyteorder("<")).tobytes(), target)
        accessors = []
        for index, item in enumerate(data):
            accessor: Json = {
                "bufferView": view,
                "componentType": _COMPONENTS[data.dtype],
                "count": len(item),
                "type": _WIDTHS[width],
            }
            if index:
                accessor["byteOffset"] = index * stride
            if bounds:
                rows = item.reshape(len(item), width)
                accessor["min"] = rows.min(axis=0).tolist()
                accessor["max"] = rows.max(axis=0).tolist()
            accessors.append(self.add("accessors", accessor))
        return accessors

    def add_indices(self, faces: NDArray[np.generic], vertices: int) -> int:
        """Store faces over so many vertices in the smallest type that holds them.

        The largest value of a type is left free: some graphics interfaces use it as a mark.
        """
        kind = np.uint16 if vertices <= 65535 else np.uint32
        return self.add_array(faces.ravel().astype(kind), target=ELEMENT_ARRAY_BUFFER)

    def to_bytes(self) -> bytes:
        """Return the whole ``.glb`` file."""
        binary = b"".join(self._chunks)
        content = dict(self._json)
        if binary:
            content["buffers"] = [{"byteLength": len(binary)}]
        text = json.dumps(content, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        parts = [struct.pack("<II", len(text), _JSON_CHUNK), text]
        if binary:
            parts += [struct.pack("<II", len(binary), _BINARY_CHUNK), binary]
        length = 12 + sum(len(part) for part in parts)
        return b"".join([struct.pack("<III", _MAGIC, _VERSION, length), *parts])

    def _add_view(self, data: bytes, target: int | None) -> int:
        view: Json = {
            "buffer": 0,
            "byteOffset": self._length,
            "byteLength": len(data),
        }
        if target is not None:
            view["target"] = target
        padded = data + b"\0" * (-len(data) % 4)
        self._chunks.append(padded)
        self._length += len(padded)
        return self.add("bufferViews", view)


# The scope in the file: an armature of bones, the skin bound to it, and their animation.

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
    samplers: list[Json] = []
    channels: list[Json] = []
    for name, values in (("translation", places), ("rotation", rotations)):
        outputs = document.add_arrays(np.swapaxes(values, 0, 1).astype(np.float32))
        for node, output in zip(nodes, outputs, strict=True):
            channels.append({"sampler": len(samplers), "target": {"node": node, "path": name}})
            samplers.append({"input": clock, "interpolation": "LINEAR", "output": output})
    document.add("animations", {"name": "insertion", "channels": channels, "samplers": samplers})

"""A plan as an animated 3-D scene, one ``.glb`` file that Blender and glTF viewers open.

The scope is one skinned tube with a bone for each link, played by one animation, ``insertion``.
The tract is drawn twice: its outside translucent, its inside opaque. Each shows one side only, so
from outside one looks through the near wall onto the scope before the far wall, and the camera at
the tip sees a solid wall, lit by a lamp beside it.

The file is written by `bozzini.scene.gltf`: trimesh writes GLB too, but neither skins nor
animations.

Frame: metres. The data keep their right-handed world frame (x, y, z), under the root node
``bozzini_world`` whose -90 degrees about X takes world +z (superior, in RAS) to glTF's +Y. Blender
undoes that turn on import, so there the coordinates are the world's own, in metres.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_fields, check_number, check_points, quantity
from ..errors import InputError
from ..io.files import write_bytes
from ..numeric.arrays import Floats
from ..results import Json
from .gltf import ARRAY_BUFFER, UPRIGHT_QUATERNION, GlbDocument, add_scope, choose_keys

if TYPE_CHECKING:
    import trimesh

# The tract's wall made ready for viewing: checked, decimated, turned outwards, with normals.

Faces = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class TractMesh:
    """A triangle mesh whose faces turn outwards.

    Attributes
    ----------
    vertices, normals : ndarray, shape (n, 3)
    faces : ndarray, shape (m, 3)
    mean_width : float
        Four volumes by one area: the diameter, for a long round tube.
    """

    vertices: Floats
    normals: Floats
    faces: Faces
    mean_width: float

    def scaled(self, factor: float) -> TractMesh:
        """Return the mesh in another unit of length."""
        return TractMesh(
            vertices=self.vertices * factor,
            normals=self.normals,
            faces=self.faces,
            mean_width=self.mean_width * factor,
        )


def prepare_tract(surface: tuple[ArrayLike, ArrayLike], *, max_faces: int) -> TractMesh:
    """Check a surface and make it ready for viewing.

    Raises
    ------
    InputError
        If it has no faces, wrong shapes, vertices that are not finite, or indices out of range.
    """
    import trimesh

    vertices, faces = _check_surface(surface)
    centre = vertices.mean(axis=0)  # the library that decimates may work in single precision
    mesh = trimesh.Trimesh(vertices - centre, faces, process=False)
    if len(vertices) == 3 * len(faces):  # a loose set of triangles
        mesh.merge_vertices()
    if len(mesh.faces) > max_faces:
        from fast_simplification import simplify

        # Quadric edge collapse (Garland and Heckbert, SIGGRAPH 1997).
        faces = mesh.faces.astype(np.int32)
        points, faces, *_ = simplify(mesh.vertices, faces, target_count=max_faces)
        mesh = trimesh.Trimesh(np.asarray(points), np.asarray(faces), process=False)
    flat = mesh.area_faces == 0.0
    if flat.all():
        raise InputError(f"surface has {len(flat)} faces, all of zero area: it must have area")
    mesh.update_faces(~flat)
    mesh.remove_unreferenced_vertices()
    shift = mesh.vertices.mean(axis=0)
    mesh.apply_translation(-shift)
    if mesh.volume < 0.0:
        mesh.invert()
    return TractMesh(
        vertices=np.asarray(mesh.vertices) + shift + centre,
        normals=_find_normals(mesh),
        faces=np.asarray(mesh.faces, dtype=np.int64),
        mean_width=4.0 * abs(mesh.volume) / mesh.area,
    )


def _check_surface(surface: tuple[ArrayLike, ArrayLike]) -> tuple[Floats, Faces]:
    if not isinstance(surface, (tuple, list)) or len(surface) != 2:
        raise InputError("surface must be a pair: vertices (n, 3) and faces (m, 3)")
    vertices = check_points("surface vertices", surface[0])
    if vertices.ndim != 2:
        raise InputError(f"surface vertices has shape {vertices.shape}: it must be (n, 3)")
    faces = np.asarray(surface[1])
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise InputError(
            f"surface faces has shape {faces.shape} and type {faces.dtype}: it must be (m, 3) "
            "whole numbers"
        )
    if len(faces) == 0 or len(vertices) == 0:
        raise InputError(
            f"surface has {len(vertices)} vertices and {len(faces)} faces: it must have at least 1 "
            "face"
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(
            f"surface faces has indices {faces.min()} to {faces.max()}: they must lie in "
            f"[0, {len(vertices) - 1}]"
        )
    return vertices, faces.astype(np.int64)


def _find_normals(mesh: trimesh.Trimesh) -> Floats:
    """Vertex normals weighted by area; where faces cancel out, that of one of them."""
    crosses, corners = np.repeat(mesh.triangles_cross, 3, axis=0), mesh.faces.ravel()
    normals, one = np.zeros((2, len(mesh.vertices), 3))
    np.add.at(normals, corners, crosses)
    one[corners] = crosses
    largest = np.zeros(len(normals))
    np.maximum.at(largest, corners, np.linalg.norm(crosses, axis=1))
    cancelled = np.linalg.norm(normals, axis=1) <= 1e-6 * largest
    normals[cancelled] = one[cancelled]
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


_METRE = 1e-3
_LIGHTS = "KHR_lights_punctual"
_TIP_VIEW = 1.75  # rad, about 100 degrees: as wide as a perspective picture bears
_OVERVIEW_VIEW = 0.6  # rad
_TIP_GAP = 0.05  # of the radius, between the skin and the camera
_LAMP_LUX = 25.0  # on a wall one lumen width away; farther walls are seen by it too
_MATERIALS: dict[str, tuple[list[float], float, float]] = {
    # base colour, metallic, roughness
    "tract_outside": ([0.80, 0.42, 0.36, 0.28], 0.0, 0.6),
    "tract_inside": ([0.60, 0.22, 0.18, 1.0], 0.0, 0.55),
    "scope": ([0.03, 0.10, 0.32, 1.0], 0.0, 0.45),
    "path": ([1.0, 0.85, 0.2, 1.0], 0.0, 1.0),
}


@dataclass(frozen=True, kw_only=True)
class SceneInfo:
    """What a scene file holds.

    Attributes
    ----------
    bytes : int
        Size of the file.
    bones : int
        Links of the scope.
    keys : int
        Poses in the animation.
    faces : int
        Faces of the tract as drawn (each is there twice, for outside and inside).
    link_length_change : float
        Largest difference between a link's length in a key and in the last key [mm]. The tube's
        links are rigid, so this is how far from its tail-side joint a link may be drawn.
    """

    bytes: int
    bones: int
    keys: int
    faces: int
    link_length_change: float


@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """How a scene is animated, and how fine its surface is.

    Parameters
    ----------
    duration : float
        Length of the animation [s]; steps are evenly spread over it.
    keys : int
        Most poses to keep; they are spread evenly over the steps and include the first and last.
        Joints are exact in the keys and interpolated in between.
    max_faces : int
        A finer surface is decimated to about this many faces, for viewing only.
    title : str
        Title kept in the file.

    Raises
    ------
    InputError
        If a number is outside its range.
    """

    duration: float = quantity("time", default=20.0, low=1e-3)
    keys: int = quantity(whole=True, default=200, low=2, high=65536)
    max_faces: int = quantity(whole=True, default=40000, low=100, label="max_faces")
    title: str = "Insertion of an endoscope"

    def __post_init__(self) -> None:
        check_fields(self)


def write_scene(
    target: str | os.PathLike[str],
    *,
    surface: tuple[ArrayLike, ArrayLike],
    joints: ArrayLike,
    diameter: float,
    path: ArrayLike | None = None,
    options: SceneOptions | None = None,
) -> SceneInfo:
    """Write a tract and the motion of a scope through it as an animated binary glTF file.

    Parameters
    ----------
    target : path-like
        The ``.glb`` file to write.
    surface : (vertices (n, 3), faces (m, 3))
        Triangles of the tract's wall [mm]. Faces may turn in or out, but all the same way.
    joints : array_like, shape (steps, joints, 3)
        Joint positions [mm]; joint 0 is the head. Links still outside are drawn as given.
    diameter : float
        Diameter of the scope [mm].
    path : array_like, shape (m, 3), optional
        A curve to draw as a thin line, for example the centreline [mm].
    options : SceneOptions, optional
        The animation, and how fine the surface is.

    Returns
    -------
    SceneInfo
        Size and counts, and how well the links kept their length.

    Raises
    ------
    InputError
        If an array has the wrong shape or values that are not finite, a link has no length, or a
        number is outside its range.
    OutputError
        If the file cannot be written; nothing is left behind.

    Notes
    -----
    Bones turn by the smallest rotation from key to key, so neither the scope nor the picture of
    `tip_camera` rolls; a real scope's may, as its shaft carries the operator's torque.
    """
    check_number("diameter", diameter, low=0.0, low_open=True, unit="mm")
    options = SceneOptions() if options is None else options
    chain = _check_joints(joints)
    line = None if path is None else _check_path(path)
    tract = prepare_tract(surface, max_faces=options.max_faces).scaled(_METRE)

    steps = choose_keys(len(chain), options.keys)
    poses = chain[steps] * _METRE
    times = options.duration * steps / max(len(chain) - 1, 1)
    radius = 0.5 * diameter * _METRE

    document = GlbDocument(generator="Bozzini", extras=_describe(options.title))
    root = document.add(
        "nodes", {"name": "bozzini_world", "rotation": UPRIGHT_QUATERNION, "children": []}
    )
    children: list[int] = document.get("nodes", root)["children"]
    children += _add_tract(document, tract)
    if line is not None:
        children.append(_add_path(document, line * _METRE))
    paint = _add_material(document, "scope")
    scope, skin = add_scope(document, poses, times, radius=radius, material=paint)
    children.append(scope)
    size = float(np.linalg.norm(np.ptp(tract.vertices, axis=0)))
    _add_tip(document, document.get("nodes", scope)["children"][0], tract, radius, size)
    low = np.minimum(tract.vertices.min(axis=0), poses[-1].min(axis=0) - radius)
    high = np.maximum(tract.vertices.max(axis=0), poses[-1].max(axis=0) + radius)
    children.append(_add_overview(document, low, high))
    document.set_scene(document.add("scenes", {"name": "bozzini", "nodes": [root, skin]}))

    data = document.to_bytes()
    write_bytes(target, data)
    lengths = np.linalg.norm(np.diff(chain[steps], axis=1), axis=2)
    return SceneInfo(
        bytes=len(data),
        bones=chain.shape[1] - 1,
        keys=len(steps),
        faces=len(tract.faces),
        link_length_change=float(np.abs(lengths - lengths[-1]).max()),
    )


def _check_joints(joints: ArrayLike) -> Floats:
    chain = check_points("joints", joints)
    if chain.ndim != 3 or chain.shape[0] < 1 or chain.shape[1] < 2:
        raise InputError(
            f"joints has shape {chain.shape}: it must be (steps, joints, 3) with at least 1 step "
            "and 2 joints"
        )
    lengths = np.linalg.norm(np.diff(chain, axis=1), axis=2)
    if lengths.min() < 1e-6:
        step, link = np.unravel_index(int(lengths.argmin()), lengths.shape)
        raise InputError(
            f"link {link} is {lengths.min():g} mm long at step {step}: "
            "its length must lie in [1e-06, inf) mm"
        )
    return chain


def _check_path(path: ArrayLike) -> Floats:
    line = check_points("path", path)
    if line.ndim != 2 or len(line) < 2:
        raise InputError(f"path has shape {line.shape}: it must be (m, 3) with m at least 2")
    return line


def _describe(title: str) -> dict[str, str]:
    return {
        "title": str(title),
        "unit": "metre (millimetre data times 0.001)",
        "frame": (
            "node bozzini_world holds the data in their own right-handed world frame; "
            "it is turned -90 degrees about X, so world +z (superior in RAS) is glTF +Y (up) "
            "and world +y (anterior in RAS) is glTF -Z"
        ),
        "scope": "bound in the last pose; joint 0 (head) is the origin of bone_000",
    }


def _add_material(document: GlbDocument, name: str, **options: object) -> int:
    colour, metallic, roughness = _MATERIALS[name]
    surface = {"baseColorFactor": colour, "metallicFactor": metallic, "roughnessFactor": roughness}
    return document.add("materials", {"name": name, "pbrMetallicRoughness": surface, **options})


def _add_tract(document: GlbDocument, tract: TractMesh) -> list[int]:
    vertices = document.add_array(
        tract.vertices.astype(np.float32), target=ARRAY_BUFFER, bounds=True
    )
    nodes = []
    sides: list[tuple[str, Floats, NDArray[np.int64], Json]] = [
        ("tract_inside", -tract.normals, tract.faces[:, ::-1], {}),
        ("tract_outside", tract.normals, tract.faces, {"alphaMode": "BLEND"}),
    ]
    for name, normals, faces, options in sides:
        primitive = {
            "attributes": {
                "POSITION": vertices,
                "NORMAL": document.add_array(normals.astype(np.float32), target=ARRAY_BUFFER),
            },
            "indices": document.add_indices(faces, len(tract.vertices)),
            "material": _add_material(document, name, **options),
        }
        mesh = document.add("meshes", {"name": name, "primitives": [primitive]})
        nodes.append(document.add("nodes", {"name": name, "mesh": mesh}))
    return nodes


def _add_path(document: GlbDocument, line: Floats) -> int:
    vertices = document.add_array(line.astype(np.float32), target=ARRAY_BUFFER, bounds=True)
    document.use_extension("KHR_materials_unlit")
    material = _add_material(document, "path", extensions={"KHR_materials_unlit": {}})
    primitive = {"attributes": {"POSITION": vertices}, "mode": 3, "material": material}
    mesh = document.add("meshes", {"name": "path", "primitives": [primitive]})
    return document.add("nodes", {"name": "path", "mesh": mesh})


def _add_tip(
    document: GlbDocument, head: int, tract: TractMesh, radius: float, size: float
) -> None:
    """Fix a camera and a lamp to the first bone, just before the skin's apex."""
    near = 0.5 * _TIP_GAP * radius
    camera = document.add(
        "cameras",
        {
            "name": "tip_camera",
            "type": "perspective",
            "perspective": {"yfov": _TIP_VIEW, "znear": near, "zfar": 2.0 * size + near},
        },
    )
    width = max(tract.mean_width, 2.0 * radius)
    lamp = {
        "name": "tip_lamp",
        "type": "spot",
        "color": [1.0, 0.96, 0.9],
        "intensity": _LAMP_LUX * width**2,  # candela: lux times square metre
        "spot": {"innerConeAngle": 0.6, "outerConeAngle": 1.4},
    }
    document.use_extension(_LIGHTS, {"lights": [lamp]})
    ahead = [0.0, 0.0, -(1.0 + _TIP_GAP) * radius]
    children = [
        document.add("nodes", {"name": "tip_camera", "camera": camera, "translation": ahead}),
        document.add(
            "nodes",
            {"name": "tip_lamp", "translation": ahead, "extensions": {_LIGHTS: {"light": 0}}},
        ),
    ]
    document.get("nodes", head)["children"] = children


def _add_overview(document: GlbDocument, low: Floats, high: Floats) -> int:
    """Add a camera before the box (anterior, +y), +z up, that sees all of it when not upright."""
    width, depth, height = (high - low).tolist()
    distance = 0.55 * max(width, height) / np.tan(0.5 * _OVERVIEW_VIEW) + 0.5 * depth
    near = 0.02 * distance
    camera = document.add(
        "cameras",
        {
            "name": "overview",
            "type": "perspective",
            "perspective": {"yfov": _OVERVIEW_VIEW, "znear": near, "zfar": 4.0 * distance + depth},
        },
    )
    half = float(np.sqrt(0.5))
    place = 0.5 * (low + high) + np.array([0.0, distance, 0.0])
    return document.add(
        "nodes",
        {
            "name": "overview",
            "camera": camera,
            "translation": place.tolist(),
            # x to -x, y to z, z to y: looks along -y with +z up.
            "rotation": [0.0, half, half, 0.0],
        },
    )

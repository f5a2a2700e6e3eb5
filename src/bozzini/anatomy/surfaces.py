"""The wall of a lumen from files of triangles."""

from __future__ import annotations

import io
import json
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError, InputError, UnitError
from . import _mesh
from ._nesting import find_touching
from ._reading import (
    LARGEST,
    SMALLEST,
    check_file,
    check_scale,
    explain,
    has_suffix,
    name_file,
    quiet_libraries,
)
from ._solidify import close_sheet
from .frame import check_frame
from .surface import tract_from_surface, unite_parts
from .tract import Finding, LabelTract, SurfaceTract

__all__ = ["SURFACE_SUFFIXES", "read_surface"]

SURFACE_SUFFIXES = (".stl", ".ply", ".obj", ".glb", ".off", ".vtk", ".vtp")

GLB_FRAME = "LSA"
"""Where the axes of a GLB point if its figure faces the viewer: +y up and +z to the front."""

MARK = "bozzini"
"""Key under which `write_tract` keeps the frame in a GLB."""

SMALL = 0.05
"""Volume of a part of a scene, by the largest one's, below which it is no lumen of its own."""

LISTED = 12
"""Parts that a message lists."""

_UNIT_WORD = re.compile(r"[^\W\d_][^\W\d]*")
"""A word: a number in it would multiply the unit."""


@dataclass(frozen=True, kw_only=True)
class _Part:
    """A mesh of a file: its name, corners in the file's unit, triangles, and volume [mm^3]."""

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    volume: float = 0.0


def read_surface(
    path: str | os.PathLike[str],
    *,
    part: str | int | Sequence[str | int] | None = None,
    unit: str | None = None,
    frame: str | None = None,
    repair: bool = False,
) -> SurfaceTract | LabelTract:
    """Read the wall of a lumen from a file of triangles, as mm in the file's own frame.

    A scene (GLB, OBJ) may hold several parts; each is moved to where its node puts it. Without
    `part`, parts that touch or overlap are united, small ones are taken for obstacles, and a scene
    of parts apart from each other is refused with a list of them.

    The voxel size, the landmarks and the organ of a GCA model are read from the model's JSON and
    mid-line beside the ``.vtk`` file, where they are there.

    Parameters
    ----------
    path : path-like
        A ``.stl``, ``.ply``, ``.obj``, ``.glb``, ``.off``, ``.vtk`` (legacy) or ``.vtp`` file.
    part : str, int or sequence of them, optional
        Parts by name or number (1 is the largest), ``"all"``; several are united. A file of
        one mesh has its connected parts, numbered from the largest.
    unit : str, optional
        Unit of the file's coordinates, for example ``"mm"``, ``"m"``, ``"in"``. By default m for
        GLB, as its standard says, the voxel size of a GCA model, else mm.
    frame : str, optional
        Where the world axes of the file point in the patient, such as ``"LPS"``.
    repair : bool
        Mend what can be mended safely; see `tract_from_surface`.

    Returns
    -------
    SurfaceTract or LabelTract
        Voxels where open sheets or several parts were united.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, broken or holds no triangles.
    UnitError
        If the unit is not a length.
    InputError, GeometryError
        As `tract_from_surface` does; if there is no such part, or a scene has several apart.
    """
    scale = None if unit is None else _measure_unit(unit)
    code = None if frame is None else check_frame(frame)
    check_file(path)
    if not has_suffix(path, SURFACE_SUFFIXES):
        raise FileFormatError(f"{path} is not named {', '.join(SURFACE_SUFFIXES)}")
    file = Path(path)
    found: list[Finding] = []
    meshes, marked = _read_meshes(file)
    if not any(len(mesh.faces) for mesh in meshes):
        raise FileFormatError(f"{path} holds no triangles")
    model = None
    if has_suffix(path, (".vtk",)):
        from ._surface_formats import find_model

        model = find_model(file)
    sizes = np.ones(3)
    if scale is not None:
        sizes = sizes * scale
    elif has_suffix(path, (".glb",)):
        sizes = sizes * 1000.0
    elif model is not None:
        sizes = model.voxel
    if scale is None and has_suffix(path, (".glb",)) and marked is None:
        message = "coordinates taken as m, as the GLB standard says; if they are mm, give --unit mm"
        found.append(Finding("unit-assumed", "note", message))
    meshes = [_measure(replace(mesh, vertices=mesh.vertices * sizes), path) for mesh in meshes]
    meshes = [mesh for mesh in meshes if len(mesh.faces)]
    meshes.sort(key=lambda mesh: (-float(f"{mesh.volume:.6g}"), mesh.name))
    longest = max(float(np.ptp(mesh.vertices, axis=0).max()) for mesh in meshes)
    hint = _propose_unit(longest, scale, path)
    if np.isfinite(longest):
        check_scale(longest, hint=hint)  # an absurd size is refused before any work
    tract = _choose(meshes, part, name_file(path), found, repair=repair)
    if has_suffix(path, (".glb",)):
        tract = _add_frame(tract, marked)
    if model is not None:
        corners = np.concatenate([mesh.vertices for mesh in meshes])
        tract = model.describe(tract, corners, sizes, found_unit=scale is None)
    if code is not None:
        tract = _set_frame(tract, code)
    return _replace_hint(tract, hint)


def _measure_unit(unit: str) -> float:
    from ..units import parse_quantity

    if not _UNIT_WORD.fullmatch(unit):
        raise UnitError(f"unit is '{unit}': it must be a unit of length such as mm, cm, m or in")
    return parse_quantity(f"1 {unit}", "length")


def _read_meshes(file: Path) -> tuple[list[_Part], dict[str, Any] | None]:
    """Return the meshes of a file, and what `write_tract` noted in a GLB."""
    if has_suffix(file, (".stl",)):
        from ._surface_formats import read_stl

        vertices, faces = read_stl(file)
    elif has_suffix(file, (".vtk",)):
        from ._surface_formats import read_vtk

        vertices, faces = read_vtk(file)
    elif has_suffix(file, (".vtp",)):
        from ._surface_formats import read_vtp

        vertices, faces = read_vtp(file)
    else:
        return _load(file)
    return [_Part(name="1", vertices=vertices, faces=faces)], None


def _load(file: Path) -> tuple[list[_Part], dict[str, Any] | None]:
    import trimesh

    kind = file.suffix.lower().lstrip(".")
    marked = _check_glb(file) if kind == "glb" else None
    with quiet_libraries():
        try:
            data = file.read_bytes()
            if kind == "off":
                data = _check_off(data.decode("latin-1")).encode()
            elif kind == "obj":
                _check_obj(data.decode("latin-1"))
            if kind in ("obj", "off") and not _is_text(data):
                data = data.decode("latin-1").encode()  # names and remarks; numbers are ASCII
            loaded: Any = trimesh.load(io.BytesIO(data), file_type=kind, process=False)
            parts = _list_parts(loaded)
        except Exception as error:  # trimesh's loaders raise many kinds on a broken file
            raise FileFormatError(
                f"{file} is not {kind.upper()} triangles: {explain(error)}"
            ) from None
    return parts, marked


def _check_off(text: str) -> str:
    """Return an OFF file without remarks; `ValueError` unless it has the lines that it states."""
    lines = [line.split("#")[0].split() for line in text.splitlines()]
    lines = [line for line in lines if line]
    if not lines or not lines[0][0].endswith("OFF"):
        raise ValueError("it does not begin with OFF")
    if len(lines[0]) > 1:  # the counts may stand on the same line
        lines[:1] = [lines[0][:1], lines[0][1:]]
    counts, rest = (lines[1] if len(lines) > 1 else []), lines[2:]
    if len(counts) < 2:
        raise ValueError("it states no numbers of vertices and faces")
    corners, faces = int(counts[0]), int(counts[1])
    if min(corners, faces) < 0 or len(rest) != corners + faces:
        raise ValueError(
            f"its header states {corners} vertices and {faces} faces, it has {len(rest)} lines "
            "of them: it is cut short or damaged"
        )
    for line in rest[:corners]:
        if len(line) < 3:
            raise ValueError(f"the vertex '{' '.join(line)}' has {len(line)} numbers, not 3")
    for line in rest[corners:]:
        if len(line) < 1 + max(int(line[0]), 3):
            raise ValueError(f"the face '{' '.join(line)[:60]}' is cut short")
    return "\n".join(" ".join(line) for line in lines)


def _check_obj(text: str) -> None:
    """Raise `ValueError` for half a line of an OBJ file, or a face of vertices not there."""
    corners, highest = 0, 0
    for line in text.replace("\r\n", "\n").replace("\\\n", " ").split("\n"):
        key, *words = line.split("#")[0].split() or [""]
        if key not in ("v", "f"):
            continue
        if len(words) < 3:
            raise ValueError(f"the line '{line.strip()[:60]}' is cut short")
        if key == "v":
            corners += 1
            continue
        for word in words:
            index = int(word.split("/")[0])
            if index == 0 or index < -corners:
                raise ValueError(f"the face '{line.strip()[:60]}' names no vertex {index}")
            highest = max(highest, index)
    if highest > corners:
        raise ValueError(f"a face names vertex {highest}, but it has {corners} vertices")


def _is_text(data: bytes) -> bool:
    try:
        data.decode()
    except UnicodeDecodeError:
        return False
    return True


def _list_parts(loaded: Any) -> list[_Part]:
    """Return the vertices, moved to the world, and the faces of each mesh of what was loaded."""
    import trimesh

    placed: list[tuple[str, Any, NDArray[np.float64]]] = [("1", loaded, np.eye(4))]
    if isinstance(loaded, trimesh.Scene):
        placed = []
        for node in loaded.graph.nodes_geometry:
            transform, name = loaded.graph[node]
            placed.append((str(node), loaded.geometry[name], np.asarray(transform, np.float64)))
    parts = []
    for name, mesh, transform in placed:
        if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
            continue
        vertices = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
        faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
        vertices = vertices @ transform[:3, :3].T + transform[:3, 3]
        parts.append(_Part(name=name, vertices=vertices, faces=faces))
    return parts


def _check_glb(file: Path) -> dict[str, Any] | None:
    """Refuse a GLB whose counts cannot be in the file; return what `write_tract` noted in it."""
    data = file.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    if data[:4] != b"glTF" or int.from_bytes(data[8:12], "little") != len(data):
        raise FileFormatError(f"{file} is not GLB triangles: it is cut short or damaged")
    try:
        tree = json.loads(data[20 : 20 + length])
        counts = [int(item["count"]) for item in tree.get("accessors", [])]
        marked = tree.get("asset", {}).get("extras", {}).get(MARK)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise FileFormatError(f"{file} is not GLB triangles: its JSON is damaged") from None
    packed = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"} & set(
        map(str, tree.get("extensionsRequired", []))
    )
    if packed:
        raise FileFormatError(f"{file} is packed by {packed.pop()}: save it without compression")
    if counts and not 0 <= min(counts) <= max(counts) <= len(data):
        raise FileFormatError(
            f"{file} is not GLB triangles: {max(counts)} numbers stated, {len(data)} bytes there"
        )
    return marked if isinstance(marked, dict) else None


def _measure(mesh: _Part, path: str | os.PathLike[str]) -> _Part:
    """Weld equal corners, and measure the volume with flat caps."""
    faces = mesh.faces
    bad = len(faces) and (faces.min() < 0 or faces.max() >= len(mesh.vertices))
    if bad or not np.isfinite(mesh.vertices).all():
        return mesh  # `tract_from_surface` says what is wrong
    points, faces = _mesh.weld(mesh.vertices, faces)
    faces = _mesh.drop_degenerate(faces)
    if not len(faces):
        return replace(mesh, vertices=points, faces=faces) if len(mesh.faces) == 0 else mesh
    turned, _ = _mesh.agree(faces, len(points))
    closed = close_sheet(points, turned, _mesh.find_holes(points, turned))
    return replace(mesh, volume=abs(_mesh.measure_volume(*closed)))


def _choose(
    meshes: list[_Part],
    part: str | int | Sequence[str | int] | None,
    source: str,
    found: list[Finding],
    *,
    repair: bool,
) -> SurfaceTract | LabelTract:
    if part is None:
        return _take_all(meshes, source, found, repair=repair)
    if len(meshes) == 1:
        meshes = _split(meshes[0])
    chosen = _find_parts(meshes, part, source)
    left = [mesh for k, mesh in enumerate(meshes) if k not in chosen]
    if left:
        message = f"parts left out, as they were not asked for: {_list_names(left)}"
        found.append(Finding("parts-left-out", "note", message))
    if len(chosen) > 1:
        parts = [(meshes[k].name, meshes[k].vertices, meshes[k].faces) for k in chosen]
        tract: SurfaceTract | LabelTract = unite_parts(parts, source=source, findings=found)
    else:
        one = meshes[chosen[0]]
        tract = tract_from_surface(
            one.vertices, one.faces, source=source, findings=found, repair=repair
        )
    return _check_left(tract, left)


def _take_all(
    meshes: list[_Part], source: str, found: list[Finding], *, repair: bool
) -> SurfaceTract | LabelTract:
    """Unite parts that meet, take small ones for obstacles, refuse parts apart."""
    largest = max(mesh.volume for mesh in meshes)
    main = [mesh for mesh in meshes if mesh.volume >= SMALL * largest]
    if len(main) > 1:
        label, overlapping = _group(main)
        if label.max() > 0:
            raise InputError(
                f"{source} has {len(meshes)} parts that do not all touch: choose with --part, for "
                f"example --part '{main[0].name}'; it has {_list_names(meshes)}"
            )
        if overlapping:
            parts = [(mesh.name, mesh.vertices, mesh.faces) for mesh in main]
            small = [mesh for mesh in meshes if mesh.volume < SMALL * largest]
            if small:
                message = (
                    f"small parts taken for wall where they meet the lumen: {_list_names(small)}"
                )
                found.append(Finding("parts-small", "warning", message))
            obstacles = [(mesh.name, mesh.vertices, mesh.faces) for mesh in small]
            return unite_parts(parts, obstacles, source=source, findings=found)
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return tract_from_surface(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + at for mesh, at in zip(meshes, starts, strict=True)]),
        source=source,
        findings=found,
        repair=repair,
    )


def _group(parts: list[_Part]) -> tuple[NDArray[np.int64], bool]:
    """Number the parts that meet, and say whether some overlap without one being in the other."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    number = len(parts)
    meets = np.zeros((number, number), dtype=bool)
    overlapping = False
    solids = []
    for part in parts:
        points, faces = _mesh.weld(part.vertices, part.faces)
        faces, _ = _mesh.agree(_mesh.drop_degenerate(faces), len(points))
        holes = _mesh.find_holes(points, faces)
        solids.append((*close_sheet(points, faces, holes), bool(holes)))
    for j in range(number):
        for k in range(j):
            (p, f, is_open), (q, g, other_open) = solids[j], solids[k]
            corners = np.concatenate((p, q))
            faces = np.concatenate((f, g + len(p)))
            label = np.repeat((0, 1), (len(f), len(g)))
            touches, enters = find_touching(corners, faces, label, 0)
            _, back = find_touching(corners, faces, 1 - label, 0)
            meets[j, k] = touches[1] or enters[1] or back[1]
            overlapping |= bool(touches[1]) and not (is_open or other_open)
    _, group = connected_components(csr_array(meets), directed=False)
    return np.asarray(group, dtype=np.int64), overlapping


def _split(mesh: _Part) -> list[_Part]:
    """Number the connected parts of a mesh from the largest."""
    points, faces = _mesh.weld(mesh.vertices, mesh.faces)
    faces = _mesh.drop_degenerate(faces)
    if not len(faces):
        return [mesh]
    label = _mesh.label_parts(faces, len(points))
    order = np.argsort(label, kind="stable")
    pieces = np.split(faces[order], np.cumsum(np.bincount(label))[:-1])
    parts = [_measure(_Part(name="", vertices=points, faces=piece), "") for piece in pieces]
    parts.sort(key=lambda part: -part.volume)
    return [
        replace(
            part,
            name=str(k + 1),
            vertices=points[np.unique(part.faces)],
            faces=np.unique(part.faces, return_inverse=True)[1].reshape(-1, 3),
        )
        for k, part in enumerate(parts)
    ]


def _find_parts(
    meshes: list[_Part], part: str | int | Sequence[str | int], source: str
) -> list[int]:
    names = [mesh.name for mesh in meshes]
    if isinstance(part, str) and part not in names and part.lower() == "all":
        return list(range(len(meshes)))
    asked = [part] if isinstance(part, (str, int)) else list(part)
    if len(asked) == 1 and isinstance(asked[0], str) and asked[0] not in names:
        asked = [word.strip() for word in asked[0].split(",")]
    chosen: list[int] = []
    for item in asked:
        text = str(item)
        exact = [k for k, name in enumerate(names) if name == text]
        loose = [k for k, name in enumerate(names) if name.lower() == text.lower()]
        hits = exact or loose
        if not hits and text.isascii() and text.isdigit() and 1 <= int(text[:9]) <= len(names):
            hits = [int(text) - 1]
        if not hits:
            raise InputError(f"{source} has no part '{text}': it has {_list_names(meshes)}")
        chosen += [k for k in hits if k not in chosen]
    if not chosen:
        raise InputError(f"no part was given: {source} has {_list_names(meshes)}")
    return chosen


def _list_names(meshes: Sequence[_Part]) -> str:
    shown = ", ".join(
        f"'{_clean(mesh.name)}' ({mesh.volume / 1000.0:.3g} mL)" for mesh in meshes[:LISTED]
    )
    return shown + (f" and {len(meshes) - LISTED} more" if len(meshes) > LISTED else "")


def _clean(name: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in name)[:60]


def _check_left(tract: SurfaceTract | LabelTract, left: list[_Part]) -> SurfaceTract | LabelTract:
    """Warn of parts that were not asked for, but reach into the lumen."""
    inside = [mesh.name for mesh in left if _reaches(tract, mesh)]
    if not inside:
        return tract
    names = ", ".join(f"'{_clean(name)}'" for name in inside[:LISTED])
    message = f"parts left out reach into the lumen: {names}; the scope may cross them"
    return replace(tract, findings=(*tract.findings, Finding("parts-cross", "warning", message)))


def _reaches(tract: SurfaceTract | LabelTract, mesh: _Part) -> bool:
    if isinstance(tract, LabelTract):
        places = np.concatenate((mesh.vertices, mesh.vertices[mesh.faces].mean(axis=1)))
        index = np.linalg.solve(tract.affine[:3, :3], (places - tract.affine[:3, 3]).T).T
        index = np.rint(index).astype(np.int64)
        index = index[((index >= 0) & (index < tract.labels.shape)).all(axis=1)]
        return bool(tract.mask[tuple(index.T)].any())
    points = np.concatenate((tract.vertices, mesh.vertices))
    faces = np.concatenate((tract.faces, mesh.faces + len(tract.vertices)))
    label = np.repeat((0, 1), (len(tract.faces), len(mesh.faces)))
    touches, enters = find_touching(points, faces, label, 0)
    return bool(touches[1] or enters[1])


def _add_frame(
    tract: SurfaceTract | LabelTract, marked: dict[str, Any] | None
) -> SurfaceTract | LabelTract:
    if marked is None:
        message = (
            f"axes taken as {GLB_FRAME} (+x to the patient's left, +y to the head, +z to the "
            f"front), as of a GLB figure that faces the viewer; if not, give --frame"
        )
        found = (*tract.findings, Finding("frame-assumed", "note", message))
        return replace(tract, frame=GLB_FRAME, findings=found)
    try:
        return replace(tract, frame=check_frame(marked["frame"]))
    except (KeyError, InputError):
        return tract


def _set_frame(tract: SurfaceTract | LabelTract, code: str) -> SurfaceTract | LabelTract:
    found = [item for item in tract.findings if item.code != "frame-assumed"]
    if tract.frame not in (None, code) and len(found) == len(tract.findings):
        message = f"the file states the frame {tract.frame}, but {code} was given: taken as {code}"
        found.append(Finding("frame-overridden", "warning", message))
    return replace(tract, frame=code, findings=tuple(found))


def _propose_unit(longest: float, scale: float | None, path: str | os.PathLike[str]) -> str:
    """Return another unit where that of the file gives no plausible size."""
    used = scale or (1000.0 if has_suffix(path, (".glb",)) else 1.0)
    better = [
        name
        for name, size in (("mm", 1.0), ("cm", 10.0), ("m", 1000.0))
        if SMALLEST <= longest / used * size <= LARGEST
    ]
    return f"give --unit {better[0]}" if better else "give the file's own unit"


def _replace_hint(tract: SurfaceTract | LabelTract, hint: str) -> SurfaceTract | LabelTract:
    found = tuple(
        Finding(item.code, item.severity, re.sub(r"; [^;]*$", f"; {hint}", item.message))
        if item.code == "scale"
        else item
        for item in tract.findings
    )
    return replace(tract, findings=found)

"""Reading a tract from a file: a label volume or the triangles of its wall."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import FileFormatError, InputError, UnitError
from ..units import parse_quantity
from . import _mesh
from ._mesh import Faces, Integers, SurfaceSheet, Vertices
from ._nesting import PartSet
from ._surface_formats import SURFACE_SUFFIXES, find_model, join_meshes, read_parts
from .files import PathLike, check_file, explain, has_suffix
from .frame import check_frame
from .labels import Labels, override_frame
from .surface import tract_from_surface, unite_parts
from .tract import (
    FARTHEST_MM,
    PLAUSIBLE_MM,
    Finding,
    LabelTract,
    Tract,
    check_scale,
    count_noun,
    show_volume,
)
from .volumes import LABEL_SUFFIXES, find_sidecars, is_volume, read_labels

GLB_FRAME = "LSA"
"""Where the axes of a GLB point if its figure faces the viewer: +y up and +z to the front."""

SMALL_SHARE = 0.05
"""Volume of a part of a scene, by the largest one's, below which it is no lumen of its own."""

MOST_LISTED = 12
"""Parts that a message lists."""

_UNIT_WORD = re.compile(r"[^\W\d_][^\W\d]*")
"""A word: a number in it would multiply the unit."""

PartNames = str | int | Sequence[str | int]
"""Parts of a scene by name or number (1 is the largest), or ``"all"``."""


def hash_input(path: PathLike) -> str:
    """Return the SHA-256 of a tract's file, of all files of a folder, or of several files of one.

    These are a header and its data, and the surface, JSON and mid-lines of a GCA model.

    Parameters
    ----------
    path : path-like
        What `read_tract` reads. Of a folder the names of the files count too: they may be those of
        the labels.

    Raises
    ------
    FileFormatError
        If it is missing or cannot be read.
    """
    try:
        return _hash_files(Path(path))
    except FileNotFoundError:
        raise FileFormatError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise FileFormatError(f"{path} cannot be read: {explain(error)}") from None


def _hash_files(place: Path) -> str:
    total = hashlib.sha256()
    files = [place]
    if place.is_dir():
        files = sorted(
            item for item in place.iterdir() if item.is_file() and not item.name.startswith(".")
        )
        total.update(b"".join(os.fsencode(item.name) + b"\0" for item in files))
    if has_suffix(place, (".nhdr", ".mhd")):
        found = re.search(
            rb"(?im)^(?:data ?file\s*:|ElementDataFile\s*=)\s*(.+?)\s*$", place.read_bytes()
        )
        if found and (place.parent / os.fsdecode(found[1])).is_file():
            files.append(place.parent / os.fsdecode(found[1]))
    files += find_sidecars(place)[1]
    model = find_model(place)
    files += model.files if model else ()
    for file in files:
        with file.open("rb") as handle:
            while piece := handle.read(1 << 20):
                total.update(piece)
    return total.hexdigest()


def read_tract(
    path: PathLike,
    *,
    labels: Labels | None = None,
    part: PartNames | None = None,
    unit: str | None = None,
    frame: str | None = None,
    repair: bool = False,
) -> Tract:
    """Read a tract from a label volume or a surface, by the suffix of the file.

    Parameters
    ----------
    path : path-like
        ``.nii``, ``.nii.gz``, ``.nrrd``, ``.nhdr``, ``.mha``, ``.mhd`` or a folder of such masks
        (labels), or ``.stl``, ``.ply``, ``.obj``, ``.glb``, ``.off``,
        ``.vtk`` (surface).
    labels : sequence of int or str, optional
        The labels that make up the lumen, by number or name, or ``"all"``; only for a label
        volume.
    part : str, int or sequence of them, optional
        Parts of a scene by name or number, ``"all"``; several are united. Only for a surface.
    unit : str, optional
        Unit of the file's coordinates; only for a surface (a volume's header states its own).
    frame : str, optional
        Where the world axes of the file point in the patient, such as ``"LPS"``; by default as
        the file states.
    repair : bool
        Mend what can be mended safely; only for a surface.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, broken, or of a kind that is not read.
    InputError, GeometryError, UnitError
        If what it holds cannot be used, or an argument does not go with it.
    """
    if is_volume(path):
        if unit not in (None, "mm"):
            raise InputError(
                f"unit is '{unit}': a label volume is in the unit of its header, mm without one; "
                f"leave it out"
            )
        if part is not None:
            raise InputError(f"{path} is a label volume: it has labels, no parts")
        tract = read_labels(path, labels=labels, frame=frame)
        converted = [item.message for item in tract.findings if item.code == "unit-converted"]
        if unit is not None and converted:
            raise InputError(f"unit is '{unit}', but {converted[0]}: leave the unit out")
        return tract
    if has_suffix(path, SURFACE_SUFFIXES):
        if labels is not None:
            raise InputError(f"{path} is a surface: it has no labels to select")
        return read_surface(path, part=part, unit=unit, frame=frame, repair=repair)
    known = ", ".join(LABEL_SUFFIXES + SURFACE_SUFFIXES)
    raise FileFormatError(f"{path}: cannot tell its kind from the name; known are {known}")


def read_surface(
    path: PathLike,
    *,
    part: PartNames | None = None,
    unit: str | None = None,
    frame: str | None = None,
    repair: bool = False,
) -> Tract:
    """Read the wall of a lumen from a file of triangles, as mm in the file's own frame.

    A scene (GLB, OBJ, 3MF) may hold several parts; each is moved to where its node puts it. Without
    `part`, parts that touch or overlap are united, small ones are taken for obstacles, and a scene
    of parts apart from each other is refused with a list of them.

    The voxel size, the landmarks and the organ of a GCA model are read from the model's JSON and
    mid-line beside the ``.vtk`` file, where they are there.

    Parameters
    ----------
    path : path-like
        A ``.stl``, ``.ply``, ``.obj``, ``.glb``, ``.off``, ``.3mf``, ``.vtk`` (legacy), ``.vtp``
        or ``.vtu`` file.
    part : str, int or sequence of them, optional
        Parts by name or number (1 is the largest), ``"all"``; several are united. A file of
        one mesh has its connected parts, numbered from the largest.
    unit : str, optional
        Unit of the file's coordinates, for example ``"mm"``, ``"m"``, ``"in"``. By default m for
        GLB, as its standard states, that of a 3MF, the voxel size of a GCA model, else mm.
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
    if frame is not None:
        check_frame(frame)  # before the file is read
    check_file(path)
    if not has_suffix(path, SURFACE_SUFFIXES):
        raise FileFormatError(f"{path} is not named {', '.join(SURFACE_SUFFIXES)}")
    file = Path(path)
    is_glb = has_suffix(path, (".glb",))
    found: list[Finding] = []
    content = read_parts(file, repair=repair)
    if content.short:
        message = f"{count_noun(content.short, 'face')} of one or two corners dropped"
        found.append(Finding("faces-dropped", "note", message))
    model = find_model(file)
    unit_used = scale or content.unit or (1000.0 if is_glb else 1.0)
    sizes = np.ones(3) * unit_used
    if scale is None and model is not None:
        sizes = model.voxel
    if scale is None and is_glb and not content.marked:
        message = "coordinates taken as m, as in the GLB standard; if they are mm, give --unit mm"
        found.append(Finding("unit-assumed", "note", message))
    parts = [
        MeshPart.measure(name, vertices * sizes, faces)
        for name, vertices, faces in content.parts
        if len(faces)
    ]
    if not parts:
        raise FileFormatError(f"{path} holds no triangles")
    parts.sort(key=lambda part: (-float(f"{part.volume:.6g}"), part.name))
    longest = max(float(np.ptp(part.vertices, axis=0).max()) for part in parts)
    hint = _propose_unit(longest, unit_used)
    if np.isfinite(longest):
        check_scale(longest, hint=hint)  # an absurd size is refused before any work
    tract = _choose(parts, part, file.name, found, repair=repair)
    if is_glb:
        tract = _add_frame(tract, content.frame, marked=content.marked)
    if model is not None:
        corners = np.concatenate([part.vertices for part in parts])
        tract = model.annotate(tract, corners, sizes, found_unit=scale is None)
    return _replace_hint(override_frame(tract, frame), hint)


def _measure_unit(unit: str) -> float:
    if not _UNIT_WORD.fullmatch(unit):
        raise UnitError(f"unit is {unit!r}: it must be a unit of length such as mm, cm, m or in")
    return parse_quantity(f"1 {unit}", "length")


@dataclass(frozen=True, kw_only=True)
class MeshPart:
    """A mesh of a file: its name, corners [mm], triangles, and volume with flat caps [mm^3]."""

    name: str
    vertices: Vertices
    faces: Faces
    volume: float = 0.0

    @property
    def arrays(self) -> tuple[str, Vertices, Faces]:
        """Name, corners and triangles."""
        return self.name, self.vertices, self.faces

    @staticmethod
    def measure(name: str, vertices: Vertices, faces: Faces) -> MeshPart:
        """Return a part; `tract_from_surface` refuses what is wrong with its numbers."""
        part = MeshPart(name=name, vertices=vertices, faces=faces)
        bad = faces.min() < 0 or faces.max() >= len(vertices)
        if bad or not (np.abs(vertices) <= FARTHEST_MM).all():
            return part
        points, triangles = part.clean()
        if not len(triangles):
            return part
        return replace(part, volume=_mesh.measure_sheets(points, triangles))

    def clean(self) -> tuple[Vertices, Faces]:
        """Return corners and triangles, equal corners welded and bad triangles left out."""
        points, faces = _mesh.weld(self.vertices, self.faces)
        return points, _mesh.drop_degenerate(faces)


def _choose(
    parts: list[MeshPart],
    names: PartNames | None,
    source: str,
    found: list[Finding],
    *,
    repair: bool,
) -> Tract:
    if names is None:
        return _take_all(parts, source, found, repair=repair)
    if len(parts) == 1:
        parts = _split(parts[0])
    chosen = _find_parts(parts, names, source)
    left = [part for k, part in enumerate(parts) if k not in chosen]
    if left:
        message = f"parts left out, as they were not asked for: {_list_names(left)}"
        found.append(Finding("parts-left-out", "note", message))
    if len(chosen) > 1:
        tract: Tract = unite_parts([parts[k].arrays for k in chosen], source=source, findings=found)
    else:
        _, vertices, faces = parts[chosen[0]].arrays
        tract = tract_from_surface(vertices, faces, source=source, findings=found, repair=repair)
    inside = [_clean(part.name) for part in left if _reaches(tract, part)]
    if not inside:
        return tract
    listed = ", ".join(f"'{name}'" for name in inside[:MOST_LISTED])
    message = f"parts left out reach into the lumen: {listed}; the scope may cross them"
    return replace(tract, findings=(*tract.findings, Finding("parts-cross", "warning", message)))


def _take_all(parts: list[MeshPart], source: str, found: list[Finding], *, repair: bool) -> Tract:
    """Unite parts that meet, take small ones for obstacles, refuse parts apart."""
    largest = max(part.volume for part in parts)
    main = [part for part in parts if part.volume >= SMALL_SHARE * largest]
    if len(main) > 1:
        group, overlapping = _group(main)
        if group.max() > 0:
            raise InputError(
                f"{source} has {len(parts)} parts that do not all touch: choose with --part, for "
                f"example --part '{main[0].name}'; it has {_list_names(parts)}"
            )
        if overlapping:
            small = [part for part in parts if part.volume < SMALL_SHARE * largest]
            if small:
                message = (
                    f"small parts taken for wall where they meet the lumen: {_list_names(small)}"
                )
                found.append(Finding("parts-small", "warning", message))
            united, obstacles = ([part.arrays for part in some] for some in (main, small))
            return unite_parts(united, obstacles, source=source, findings=found)
    vertices, faces = join_meshes([(part.vertices, part.faces) for part in parts])
    return tract_from_surface(vertices, faces, source=source, findings=found, repair=repair)


def _group(parts: list[MeshPart]) -> tuple[Integers, bool]:
    """Number the parts that meet, and find whether some overlap, none wholly in the other."""
    pairs = [(0, 0)]
    overlapping = False
    solids = []
    for part in parts:
        points, faces = part.clean()
        sheet = SurfaceSheet.find(points, faces)
        solids.append((sheet.close(points), bool(sheet.holes)))
    for j, (one, is_open) in enumerate(solids):
        for k, (other, other_open) in enumerate(solids[:j]):
            points, faces = join_meshes([one, other])
            label = np.repeat((0, 1), (len(one[1]), len(other[1])))
            touches, enters = PartSet(points, faces, label).find_touching(0)
            _, back = PartSet(points, faces, 1 - label).find_touching(0)
            if touches[1] or enters[1] or back[1]:
                pairs.append((j, k))
            overlapping |= bool(touches[1]) and not (is_open or other_open)
    return _mesh.label_graph(np.array(pairs), len(parts)), overlapping


def _split(part: MeshPart) -> list[MeshPart]:
    """Return the connected parts of a mesh, numbered from the largest."""
    points, faces = part.clean()
    if not len(faces):
        return [part]
    pieces = []
    for piece in _mesh.split_by(faces, _mesh.label_parts(faces, len(points))):
        used, index = np.unique(piece, return_inverse=True)
        pieces.append(MeshPart.measure("", points[used], index.reshape(-1, 3)))
    pieces.sort(key=lambda part: -part.volume)
    return [replace(part, name=str(k)) for k, part in enumerate(pieces, start=1)]


def _find_parts(parts: list[MeshPart], part: PartNames, source: str) -> list[int]:
    names = [part.name for part in parts]
    if isinstance(part, str) and part not in names and part.lower() == "all":
        return list(range(len(parts)))
    asked = [part] if isinstance(part, (str, int)) else list(part)
    if len(asked) == 1 and isinstance(asked[0], str) and asked[0] not in names:
        asked = [word.strip() for word in asked[0].split(",")]
    chosen: list[int] = []
    for item in asked:
        text = str(item)
        exact = [k for k, name in enumerate(names) if name == text]
        hits = exact or [k for k, name in enumerate(names) if name.lower() == text.lower()]
        if not hits and text.isascii() and text.isdigit() and 1 <= int(text[:9]) <= len(names):
            hits = [int(text) - 1]
        if not hits:
            raise InputError(f"{source} has no part '{text}': it has {_list_names(parts)}")
        chosen += [k for k in hits if k not in chosen]
    if not chosen:
        raise InputError(f"no part was given: {source} has {_list_names(parts)}")
    return chosen


def _list_names(parts: Sequence[MeshPart]) -> str:
    shown = [f"'{_clean(part.name)}' ({show_volume(part.volume)})" for part in parts[:MOST_LISTED]]
    more = f" and {len(parts) - MOST_LISTED} more" if len(parts) > MOST_LISTED else ""
    return ", ".join(shown) + more


def _clean(name: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in name)[:60]


def _reaches(tract: Tract, part: MeshPart) -> bool:
    """Whether a part touches the wall of a tract or reaches into its lumen."""
    if isinstance(tract, LabelTract):
        places = np.concatenate((part.vertices, part.vertices[part.faces].mean(axis=1)))
        index = np.linalg.solve(tract.affine[:3, :3], (places - tract.affine[:3, 3]).T).T
        index = np.rint(index).astype(np.int64)
        index = index[((index >= 0) & (index < tract.labels.shape)).all(axis=1)]
        return bool(tract.mask[tuple(index.T)].any())
    points, faces = join_meshes([(tract.vertices, tract.faces), (part.vertices, part.faces)])
    label = np.repeat((0, 1), (len(tract.faces), len(part.faces)))
    touches, enters = PartSet(points, faces, label).find_touching(0)
    return bool(touches[1] or enters[1])


def _add_frame(tract: Tract, frame: object, *, marked: bool) -> Tract:
    """Set the frame of a GLB: what `write_tract` noted in it, else that of a figure."""
    if marked:
        try:
            return replace(tract, frame=check_frame(str(frame)))
        except InputError:
            return tract
    message = (
        f"axes taken as {GLB_FRAME} (+x to the patient's left, +y to the head, +z to the "
        f"front), as of a GLB figure that faces the viewer; if not, give --frame"
    )
    found = (*tract.findings, Finding("frame-assumed", "note", message))
    return replace(tract, frame=GLB_FRAME, findings=found)


def _propose_unit(longest: float, used: float) -> str:
    """Return another unit [mm] than the one used where that gives no plausible size."""
    better = [
        name
        for name, size in (("mm", 1.0), ("cm", 10.0), ("m", 1000.0))
        if PLAUSIBLE_MM[0] <= longest / used * size <= PLAUSIBLE_MM[1]
    ]
    return f"give --unit {better[0]}" if better else "give the file's own unit"


def _replace_hint(tract: Tract, hint: str) -> Tract:
    found = (
        replace(item, message=re.sub(r"; [^;]*$", f"; {hint}", item.message))
        if item.code == "scale"
        else item
        for item in tract.findings
    )
    return replace(tract, findings=tuple(found))

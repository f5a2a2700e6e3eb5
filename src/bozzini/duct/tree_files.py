"""Trees of lumens in files: SWC, VTK poly data (VMTK), curves of 3D Slicer."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..anatomy.files import has_suffix
from ..anatomy.polylines import SUFFIXES, format_curves, has_lines, read_round_lines
from ..anatomy.tract import FARTHEST_MM
from ..checks import check_kind, check_path, check_points, show_value
from ..errors import FileFormatError, InputError
from ..io.files import write_text
from ..io.inputs import note_input
from ..io.vtp import format_polylines
from ..numeric.arrays import Floats
from .tree import Branch, LumenTree, order_branches
from .tree_merge import Nodes, join_lines

__all__ = ["is_tree", "read_tree", "write_curves", "write_swc", "write_vtp"]

NAMES = 5
"""So many nodes are named in a message."""


def write_swc(tree: LumenTree, path: str | os.PathLike[str]) -> None:
    """Write a tree as SWC: a node in each row, with its place, radius [mm] and the one before.

    Parameters
    ----------
    tree : LumenTree
    path : path-like
    """
    check_kind("tree", tree, LumenTree)
    rows = ["# tree of a lumen, lengths in mm", "# id type x y z radius parent"]
    last: list[int] = []
    for branch in tree.branches:
        skipped = int(bool(last))  # its first point is the last one of its parent, or the root
        before = last[branch.parent] if branch.parent >= 0 else skipped or -1
        for point, radius in zip(branch.points[skipped:], branch.radius[skipped:], strict=True):
            number = len(rows) - 1
            values = " ".join(f"{value:.6f}" for value in (*point, radius))
            rows.append(f"{number} 0 {values} {before}")
            before = number
        last.append(before)
    write_text(Path(path), "\n".join(rows) + "\n")


def read_tree(
    path: str | os.PathLike[str], *, root: ArrayLike | None = None, frame: str | None = None
) -> LumenTree:
    """Read a tree from SWC, from poly data of VTK as VMTK writes it, or from curves of 3D Slicer.

    Lengths are in mm. Lines that run along each other, as those of VMTK from one inlet to all
    outlets, are joined, see `bozzini.duct.tree_merge.join_lines`.

    Parameters
    ----------
    path : path-like
        ``.swc``, ``.vtp``, ``.vtk`` or ``.mrk.json``.
    root : (3,) float, optional
        Where it begins: at the node nearest to this place [mm]. By default at the root of the SWC;
        of lines at the widest end.
    frame : str, optional
        Of the world that it is asked in, such as ``"RAS"``: a file of Slicer's states its own.

    Raises
    ------
    FileFormatError
        If it cannot be read, or is no tree.
    InputError
        If the root lies outside the tree.
    """
    source = check_path("path", path)
    first: int | None = None
    if has_suffix(source, SUFFIXES):
        lines = read_round_lines(source).turn(frame)
        nodes = join_lines(lines.points, lines.radius, source)
        frame = frame or lines.frame
    else:
        nodes, first = _load_swc(source)
    if root is not None:
        first = _find_nearest(nodes, check_points("root", root))
    elif first is None:
        first = _find_widest(nodes)
    return LumenTree(branches=order_branches(_split(source, nodes, first)), frame=frame)


def is_tree(path: str | os.PathLike[str]) -> bool:
    """Whether a file has a tree, and not a lumen: SWC, poly data of lines, curves of 3D Slicer."""
    return has_suffix(path, (".swc",)) or has_lines(path)


def _load_swc(source: Path) -> tuple[Nodes, int]:
    """Return the nodes of a file, and the number of the root."""
    note_input(source)
    try:
        lines = source.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, ValueError) as error:
        raise FileFormatError(f"cannot read {source}: {error}") from None
    table: dict[int, tuple[Floats, int]] = {}
    for number, line in enumerate(lines, start=1):
        text = line.partition("#")[0].split()
        if not text:
            continue
        try:
            key, before = int(text[0]), int(text[6])
            values = np.array([float(word) for word in text[2:6]])
        except (ValueError, IndexError):
            raise FileFormatError(
                f"{source}, line {number} is {show_value(line)}: it must be id, type, x, y, z, "
                "radius, parent"
            ) from None
        if not (np.abs(values) <= FARTHEST_MM).all() or values[3] <= 0.0 or key in table:
            raise FileFormatError(
                f"{source}, line {number} is {show_value(line)}: its place must be within "
                f"{FARTHEST_MM:g} mm, its radius above 0, and its id not given before"
            )
        table[key] = values, before
    ring = _find_ring({key: before for key, (_, before) in table.items()})
    if ring:
        names = ", ".join(map(str, ring[:NAMES])) + ", ..." * (len(ring) > NAMES)
        raise FileFormatError(
            f"{source} is no tree: its nodes form a ring by their parents: {names}"
        )
    roots = [key for key, (_, before) in table.items() if before == -1]
    if len(roots) != 1:
        raise FileFormatError(f"{source} has {len(roots)} roots: it must have 1, of parent -1")
    number_of = {key: number for number, key in enumerate(table)}
    nodes = Nodes([values for values, _ in table.values()], [[] for _ in table])
    for key, (_, before) in table.items():
        if before in number_of:
            nodes.beside[number_of[before]].append(number_of[key])
            nodes.beside[number_of[key]].append(number_of[before])
    return nodes, number_of[roots[0]]


def _find_ring(parents: dict[int, int]) -> list[int]:
    """Return nodes of which each is the next one's parent, and the first the last one's; or []."""
    done: set[int] = set()
    for start in parents:
        way: dict[int, None] = {}
        key = start
        while key in parents and key not in done and key not in way:
            way[key] = None
            key = parents[key]
        if key in way:
            nodes = list(way)
            return nodes[nodes.index(key) :][::-1]
        done.update(way)
    return []


def _find_nearest(nodes: Nodes, place: Floats) -> int:
    table = np.array(nodes.values)
    gaps = np.linalg.norm(table[:, :3] - place, axis=1)
    nearest = int(np.argmin(gaps))
    if gaps[nearest] > 2.0 * table[nearest, 3]:
        at = ", ".join(f"{value:g}" for value in place)
        raise InputError(
            f"start is ({at}) mm: it lies {gaps[nearest]:.1f} mm from the tree, which is "
            f"{table[nearest, 3]:.1f} mm in radius there"
        )
    return nearest


def _find_widest(nodes: Nodes) -> int:
    """Return the end whose branch is the widest; of equally wide ones that with the largest z."""

    def rate(end: int) -> tuple[float, float]:
        way = [end, *nodes.beside[end]]
        while len(after := [k for k in nodes.beside[way[-1]] if k != way[-2]]) == 1:
            way += after
        radius = float(np.median([nodes.values[k][3] for k in way]))
        return radius, float(nodes.values[end][2])

    ends = [k for k, others in enumerate(nodes.beside) if len(others) == 1]
    return max(ends, key=rate, default=0)  # without any there is one node, which is refused


def _split(source: Path, nodes: Nodes, root: int) -> list[Branch]:
    """Return the branches of nodes, each after its parent, not named yet."""
    if not nodes.beside[root]:
        raise FileFormatError(f"{source}: the root must have a node after it")
    waiting = [([root, kid], -1) for kid in nodes.beside[root]]
    branches: list[Branch] = []
    taken = 1
    while waiting:
        way, parent = waiting.pop()
        while len(after := [k for k in nodes.beside[way[-1]] if k != way[-2]]) == 1:
            way.append(after[0])
        taken += len(way) - 1
        table = np.stack([nodes.values[k] for k in way])
        waiting += [([way[-1], kid], len(branches)) for kid in after]
        points, radius = table[:, :3], table[:, 3]
        if (np.linalg.norm(np.diff(points, axis=0), axis=1) == 0.0).any():
            raise FileFormatError(f"{source}: two nodes of one branch have the same place")
        branches.append(Branch("", parent, points, radius, radius, 0, 0.0, not after))
    if taken != len(nodes.values):
        raise FileFormatError(
            f"{source} has {len(nodes.values)} nodes, and {taken} of them are joined to its root: "
            "all must be"
        )
    return branches


def write_curves(tree: LumenTree, path: str | os.PathLike[str]) -> None:
    """Write a tree as markups of 3D Slicer (``.mrk.json``): a curve for each branch, with radii.

    Parameters
    ----------
    tree : LumenTree
    path : path-like
    """
    check_kind("tree", tree, LumenTree)
    rows = tree.branches
    names = [branch.name for branch in rows]
    lines, radii = [branch.points for branch in rows], [branch.radius for branch in rows]
    write_text(Path(path), format_curves(names, lines, radii, frame=tree.frame or "RAS"))


def write_vtp(tree: LumenTree, path: str | os.PathLike[str]) -> None:
    """Write a tree as VTK poly data: a line for each branch, with radius and generation.

    Parameters
    ----------
    tree : LumenTree
    path : path-like
    """
    check_kind("tree", tree, LumenTree)
    rows = tree.branches
    text = format_polylines(
        [branch.points for branch in rows],
        {"MaximumInscribedSphereRadius": np.concatenate([branch.radius for branch in rows])},
        cell_data={
            "Branch": np.arange(len(rows), dtype=np.float64),
            "Parent": np.array([float(branch.parent) for branch in rows]),
            "Generation": np.array([float(branch.generation) for branch in rows]),
        },
        frame=tree.frame,
    )
    write_text(Path(path), text)

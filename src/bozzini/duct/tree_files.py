"""Trees of lumens in files: SWC, as tools for vessels and neurons have it, and VTK poly data."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..checks import check_kind, check_path, show_value
from ..errors import FileFormatError
from ..io.files import write_text
from ..io.inputs import note_input
from ..io.vtp import format_polylines
from ..numeric.arrays import Floats
from .tree import Branch, LumenTree, order_branches

__all__ = ["read_swc", "write_swc", "write_vtp"]


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


def read_swc(path: str | os.PathLike[str]) -> LumenTree:
    """Read a tree from SWC; lengths are taken in mm, as the format states none.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    FileFormatError
        If it cannot be read, or its nodes are no tree.
    """
    source = check_path("path", path)
    note_input(source)
    try:
        lines = source.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, ValueError) as error:
        raise FileFormatError(f"cannot read {source}: {error}") from None
    nodes: dict[int, tuple[Floats, int]] = {}
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
        if not np.isfinite(values).all() or values[3] <= 0.0 or key in nodes:
            raise FileFormatError(
                f"{source}, line {number} is {show_value(line)}: its place must be finite, its "
                "radius above 0, and its id not given before"
            )
        nodes[key] = values, before
    return LumenTree(branches=order_branches(_split(source, nodes)))


def _split(source: Path, nodes: dict[int, tuple[Floats, int]]) -> list[Branch]:
    """Return the branches of nodes, each after its parent, not named yet."""
    kids: dict[int, list[int]] = {}
    for key, (_, before) in nodes.items():
        kids.setdefault(before, []).append(key)
    roots = kids.get(-1, [])
    if len(roots) != 1:
        raise FileFormatError(f"{source} has {len(roots)} roots: it must have 1, of parent -1")
    if roots[0] not in kids:
        raise FileFormatError(f"{source}: the root, node {roots[0]}, must have one node after it")
    waiting = [([roots[0], kid], -1) for kid in kids[roots[0]]]
    branches: list[Branch] = []
    taken = 1 + len(waiting)
    while waiting:
        way, parent = waiting.pop()
        while len(after := kids.get(way[-1], [])) == 1:
            way.append(after[0])
            taken += 1
        taken += len(after)
        table = np.stack([nodes[key][0] for key in way])
        waiting += [([way[-1], kid], len(branches)) for kid in after]
        points, radius = table[:, :3], table[:, 3]
        if (np.linalg.norm(np.diff(points, axis=0), axis=1) == 0.0).any():
            raise FileFormatError(f"{source}: two nodes of one branch have the same place")
        branches.append(Branch("", parent, points, radius, radius, 0, 0.0, not after))
    if taken != len(nodes):
        raise FileFormatError(
            f"{source} has {len(nodes)} nodes, and {taken} of them are joined to its root: all "
            "must be"
        )
    return branches


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
    )
    write_text(Path(path), text)

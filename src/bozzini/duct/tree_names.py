"""Names of anatomy for the branches of a tree: of lobes, segments, bronchi."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..anatomy.regions import Regions, read_regions
from ..anatomy.volumes import is_volume
from ..checks import show_value
from ..errors import FileFormatError, InputError
from ..io.sheets import Sheet, read_sheet, take_number
from .tree import LumenTree, TreeFinding

__all__ = ["name_by_regions", "read_names"]

MOSTLY = 0.5
"""More than this share of a territory has the label, and of the label lies in the territory."""


def read_names(tree: LumenTree, path: str | os.PathLike[str]) -> LumenTree:
    """Return a tree whose branches have the names in a file as their `Branch.anatomy`.

    Parameters
    ----------
    tree : LumenTree
    path : path-like
        A label volume of lobes or segments in the world of the tree, see `name_by_regions`; or a
        table with the columns ``branch,name`` or ``x,y,z,name`` [mm]: the branch whose line is
        nearest to that place.

    Raises
    ------
    BozziniError
        If it cannot be read, or names a branch twice, or two branches the same.
    """
    if is_volume(path):
        return name_by_regions(tree, read_regions(path, tree.frame))
    sheet = read_sheet(Path(path))
    titles = [title.strip().lower() for title in sheet.titles]
    if "name" not in titles or not ({"branch"} <= {*titles} or {"x", "y", "z"} <= {*titles}):
        raise FileFormatError(
            f"{path} has the columns {', '.join(sheet.titles)}: it must have branch,name or "
            "x,y,z,name"
        )
    named: dict[int, str] = {}
    for row, number in zip(sheet.rows, sheet.numbers, strict=True):
        where = f"{path}, row {number}"
        name = str(row[titles.index("name")]).strip()
        index = _find_row(tree, sheet, titles, row, where)
        branch = tree.branches[index].name
        if not name or name in tree.names or name in named.values() or index in named:
            raise InputError(
                f"{where} gives branch {branch} the name {show_value(name)}: each branch has one "
                "name, and each name one branch, other than those by path such as 0.1"
            )
        named[index] = name
    return _give(tree, named)


def _find_row(tree: LumenTree, sheet: Sheet, titles: list[str], row: object, where: str) -> int:
    cells = dict(zip(titles, row, strict=False))  # type: ignore[call-overload]
    if "branch" in titles:
        return tree.find_branch(str(cells["branch"]).strip())
    commas = sheet.may_have_commas
    place = [take_number(where, axis, cells[axis], commas=commas) for axis in "xyz"]
    return int(tree.nearest(place)[0])


def name_by_regions(tree: LumenTree, regions: Regions) -> LumenTree:
    """Return a tree whose branches are named after the regions of the organ that they supply.

    The territory of a branch are the voxels of all regions that are nearer to it, or to a branch
    behind it, than to any other: labels of lobes leave out the airways, so that the label along
    the line itself says nothing. A region's name goes to the branch whose territory is most like
    it, by the volume of what both have over that of what either has; of equal ones to the last.
    That is the root of the branches in it, such as the lobar bronchus of a lobe. Where that is no
    more than `MOSTLY` of either, the name is not given, and a finding says so.

    Parameters
    ----------
    tree : LumenTree
    regions : Regions
    """
    owner, _ = tree.nearest(regions.places)
    count = len(tree.branches)
    shared = np.stack([np.bincount(owner[inside], minlength=count) for inside in regions.inside])
    whole = np.bincount(owner, minlength=count)
    for k in range(count - 1, 0, -1):  # each before its parent
        parent = tree.branches[k].parent
        if parent >= 0:
            shared[:, parent] += shared[:, k]
            whole[parent] += whole[k]
    sizes = regions.inside.sum(axis=1)[:, None]
    alike = shared / np.maximum(whole + sizes - shared, 1)
    alike[(shared <= MOSTLY * whole) | (shared <= MOSTLY * sizes)] = 0.0
    generation = np.array([branch.generation for branch in tree.branches])
    pairs = sorted(
        zip(*np.nonzero(alike), strict=True), key=lambda pair: (-alike[pair], -generation[pair[1]])
    )
    named: dict[int, str] = {}
    for region, branch in pairs:
        if regions.names[region] not in named.values() and branch not in named:
            named[int(branch)] = regions.names[region]
    findings = []
    for name, inside in zip(regions.names, regions.inside, strict=True):
        if name not in named.values() and inside.any():
            x, y, z = regions.places[inside].mean(axis=0).tolist()
            message = f"no branch supplies most of {name} and little else: none has that name"
            findings.append(TreeFinding("unnamed", "note", message, "", (x, y, z), 0.0))
    tree = replace(tree, findings=(*tree.findings, *findings))
    return _give(tree, named)


def _give(tree: LumenTree, named: dict[int, str]) -> LumenTree:
    return replace(
        tree,
        branches=tuple(
            replace(branch, anatomy=named.get(k, branch.anatomy))
            for k, branch in enumerate(tree.branches)
        ),
    )

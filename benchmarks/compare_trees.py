"""The tree of an airway in Bozzini and by kimimaro: ends, places and radii against a known one.

    pip install bozzini kimimaro
    python -m benchmarks.compare_trees airway_labels.nii.gz tree.csv

The table has the known tree: node, parent, x_mm, y_mm, z_mm, radius_mm; the labels were made of it.
An end is found if one of the known ends, or the root, is within 4 mm of it, each counted once for
each known one; another is false. Times are the processor's: of Bozzini after the field is there,
once it has compiled. kimimaro is no part of Bozzini's dependencies: without it a line says so.
"""

from __future__ import annotations

import csv
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from bozzini.anatomy import LabelTract, read_tract
from bozzini.duct import build_field, find_tree
from bozzini.numeric.arrays import Floats

NEAR = 4.0
"""An end within this of a known one is that [mm]."""

SETTINGS = ((2.0, 1.0), (2.5, 1.0), (3.0, 1.0), (4.0, 0.6))
"""Scale and constant [mm] of kimimaro's invalidation that are tried."""


@dataclass(frozen=True)
class Found:
    """A tree as its ends (e, 3), nodes (n, 3) and radii (n,) [mm], and its time [s]."""

    ends: Floats
    nodes: Floats
    radii: Floats
    seconds: float


def read_known(path: str) -> tuple[Floats, Floats, Floats]:
    """Return ends with the root, nodes and radii of the known tree."""
    with open(path, encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    nodes = np.array([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows])
    radii = np.array([float(row["radius_mm"]) for row in rows])
    parents = {int(row["parent"]) for row in rows}
    ends = [k for k, row in enumerate(rows) if int(row["node"]) not in parents]
    return nodes[[*ends, 0]], nodes, radii


def run_bozzini(tract: LabelTract) -> Found:
    """Return the tree that `find_tree` finds."""
    field = build_field(tract)
    find_tree(field)
    begin = time.process_time()
    tree = find_tree(field)
    seconds = time.process_time() - begin
    return Found(
        ends=np.array([*(end.points[-1] for end in tree.ends), tree.branches[0].points[0]]),
        nodes=np.concatenate([branch.points for branch in tree.branches]),
        radii=np.concatenate([branch.radius for branch in tree.branches]),
        seconds=seconds,
    )


def run_kimimaro(tract: LabelTract, scale: float, const: float) -> Found:
    """Return the skeleton that kimimaro finds."""
    import kimimaro

    labels = np.asfortranarray((tract.labels > 0).astype(np.uint8))
    begin = time.process_time()
    skeleton = kimimaro.skeletonize(
        labels,
        teasar_params={"scale": scale, "const": const},
        anisotropy=tuple(float(x) for x in tract.spacing),
        dust_threshold=0,
        progress=False,
        parallel=1,
    )[1]
    seconds = time.process_time() - begin
    index = skeleton.vertices / tract.spacing
    nodes = index @ tract.affine[:3, :3].T + tract.affine[:3, 3]
    return Found(
        ends=nodes[skeleton.terminals()], nodes=nodes, radii=skeleton.radius, seconds=seconds
    )


def compare(found: Found, known: tuple[Floats, Floats, Floats]) -> list[str]:
    """Return ends found and false, error of 95 % of the nodes and of radii [mm], and the time."""
    ends, nodes, radii = known
    near = cKDTree(found.ends).query(ends)[0] <= NEAR
    false = cKDTree(ends).query(found.ends)[0] > NEAR
    away, which = cKDTree(nodes).query(found.nodes)
    return [
        f"{np.count_nonzero(near)} of {len(ends)}",
        f"{np.count_nonzero(false)}",
        f"{np.quantile(away, 0.95):.2f}",
        f"{np.median(np.abs(found.radii - radii[which])):.2f}",
        f"{found.seconds:.1f}",
    ]


def main(arguments: Sequence[str]) -> int:
    """Print the table."""
    tract, known = read_tract(arguments[0]), read_known(arguments[1])
    assert isinstance(tract, LabelTract)
    runs: dict[str, Callable[[], Found]] = {"Bozzini": lambda: run_bozzini(tract)}
    for scale, const in SETTINGS:
        name = f"kimimaro, scale {scale:g}, const {const:g} mm"
        runs[name] = lambda scale=scale, const=const: run_kimimaro(tract, scale, const)
    print("| | ends | false | 95 % of nodes [mm] | radius [mm] | time [s] |")
    print("|---|---|---|---|---|---|")
    for name, run in runs.items():
        try:
            print(f"| {name} | {' | '.join(compare(run(), known))} |", flush=True)
        except ImportError as error:
            print(f"| {name} | {error} | | | | |")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Stages of the main job by file: time, memory and the line's clearance, beside kimimaro and VMTK.

    pip install bozzini kimimaro
    python -m benchmarks.compare_lines FILE...

Times are the processor's, of a second run, once all has compiled; memory is the most that a process
held which did the four stages of Bozzini. kimimaro gets the nodes inside as voxels and both ends,
VMTK the surface of the field. Neither is a dependency of Bozzini: a missing one gets a line that
says so.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import Any

import numpy as np

from bozzini.anatomy import read_tract
from bozzini.duct import Centreline, SampledField, build_field, find_centreline
from bozzini.motion import Scope, plan_insertion
from bozzini.numeric.arrays import Floats
from bozzini.numeric.level_sets import find_level_set
from bozzini.numeric.polylines import measure_arc_length, resample_polyline

SCOPE = Scope(diameter=5.0, link_length=8.0)


def run_stages(path: str) -> tuple[dict[str, float], SampledField, Centreline]:
    """Return seconds by stage, the field and the line."""
    times = [time.process_time()]
    labels = None
    if path.endswith((".nii", ".nii.gz")):
        labels = "all"
    tract = read_tract(path, labels=labels)
    times.append(time.process_time())
    field = build_field(tract)
    times.append(time.process_time())
    line = find_centreline(field)
    times.append(time.process_time())
    plan_insertion(field, line, scope=SCOPE)
    times.append(time.process_time())
    names = ("read", "field", "line", "plan")
    return dict(zip(names, np.diff(times).tolist(), strict=True)), field, line


def run_kimimaro(field: SampledField, line: Centreline) -> tuple[Floats, float]:
    """Return kimimaro's path between the ends of a line, and its time [s]."""
    import kimimaro
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import cKDTree

    inside = (field.values < 0.0).astype(np.uint8)
    ends = np.rint(field.to_grid(line.points[[0, -1]]) / field.spacing).astype(int)
    begin = time.process_time()
    found = kimimaro.skeletonize(
        inside,
        teasar_params={"scale": 2.0, "const": float(field.spacing.max())},
        anisotropy=tuple(field.spacing.tolist()),
        extra_targets_after=[tuple(end) for end in ends.tolist()],
        dust_threshold=0,
        progress=False,
    )
    took = time.process_time() - begin
    skeleton = max(found.values(), key=lambda one: len(one.vertices))
    nodes, edges = np.asarray(skeleton.vertices, dtype=float), skeleton.edges
    steps = np.linalg.norm(nodes[edges[:, 0]] - nodes[edges[:, 1]], axis=1)
    graph = coo_array((steps, tuple(edges.T)), shape=(len(nodes),) * 2).tocsr()
    first, last = cKDTree(nodes).query(ends * field.spacing)[1]
    before = dijkstra(graph, directed=False, indices=first, return_predecessors=True)[1]
    way = [int(last)]
    while before[way[-1]] >= 0:
        way.append(int(before[way[-1]]))
    return field.to_world(nodes[way[::-1]]), took


def run_vmtk(field: SampledField, line: Centreline) -> tuple[Floats, float]:
    """Return VMTK's path between the ends of a line, and its time [s]."""
    from vmtk import vmtkscripts
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    index, faces = find_level_set(field.values)
    corners, cells = vtkPoints(), vtkCellArray()
    corners.SetData(numpy_to_vtk(field.to_world(index * field.spacing), deep=True))
    rows = np.column_stack([np.full(len(faces), 3), faces]).astype(np.int64)
    cells.SetCells(len(faces), numpy_to_vtkIdTypeArray(rows.ravel(), deep=True))
    surface = vtkPolyData()
    surface.SetPoints(corners)
    surface.SetPolys(cells)
    job = vmtkscripts.vmtkCenterlines()
    job.Surface, job.SeedSelectorName = surface, "pointlist"
    job.SourcePoints, job.TargetPoints = line.points[0].tolist(), line.points[-1].tolist()
    begin = time.process_time()
    job.Execute()
    return vtk_to_numpy(job.Centerlines.GetPoints().GetData()), time.process_time() - begin


def show(name: str, field: SampledField, points: Floats, seconds: float) -> str:
    """Return a row: length, mean and least clearance of a path, and its time."""
    path = resample_polyline(points, 1.0)
    clearance = -field.signed_distance(path)
    length = measure_arc_length(path)[-1]
    return (
        f"  {name}: {seconds:.2f} s, {length:.0f} mm long, mean clearance "
        f"{clearance.mean():.2f} mm, least {clearance.min():.2f} mm"
    )


def compare(path: str) -> None:
    """Print the rows of one file."""
    run_stages(path)
    seconds, field, line = run_stages(path)
    stages = ", ".join(f"{name} {value:.2f} s" for name, value in seconds.items())
    print(f"{path}: {stages}, {measure_memory(path):.2f} GB")
    print(show("Bozzini", field, line.points, seconds["line"]))
    peers: tuple[tuple[str, Any], ...] = (("kimimaro", run_kimimaro), ("VMTK", run_vmtk))
    for name, run in peers:
        try:
            print(show(name, field, *run(field, line)))
        except ImportError as error:
            print(f"  {name}: not run, no package {error.name}")


def measure_memory(path: str) -> float:
    """Return the most memory that a process with the stages held [GB]."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.compare_lines", "--memory", path],
        check=True,
        capture_output=True,
        text=True,
    )
    return float(json.loads(done.stdout))


def main(paths: list[str]) -> None:
    """Compare by file, or do the stages and print the memory that they took."""
    if paths[:1] == ["--memory"]:
        import resource

        run_stages(paths[1])
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6)
        return
    for path in paths:
        compare(path)


if __name__ == "__main__":
    main(sys.argv[1:])

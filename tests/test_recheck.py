"""Re-check of saved plans by other means: ``plan.npz``, NumPy and libigl, none of our own code.

The body is sampled anew along the links of the saved joints, and its distance is measured to the
triangles of the STL file, or to the very faces of the voxels; nothing of `bozzini` but the command
line that made the file takes part.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bozzini.cli.main import main

pytestmark = pytest.mark.slow

Distance = Callable[[np.ndarray], np.ndarray]

EVERY = 40
"""Steps of the motion between those that are re-checked."""

SAMPLES = 33
"""Points per link: at 6 mm every 0.19 mm, finer than the saved samples and not among them."""


@dataclass(frozen=True)
class SavedPlan:
    """What NumPy reads from ``plan.npz``."""

    joints: np.ndarray
    head_arc_length: np.ndarray
    clearance: np.ndarray
    path: np.ndarray
    path_arc_length: np.ndarray
    meta: dict[str, Any]


def read_plan(path: Path) -> SavedPlan:
    with np.load(path, allow_pickle=False) as archive:
        names = ("joints", "head_arc_length", "clearance", "path", "path_arc_length")
        return SavedPlan(
            **{name: archive[name] for name in names}, meta=json.loads(str(archive["meta"]))
        )


def triangle_distance(vertices: np.ndarray, faces: np.ndarray, inside: Distance) -> Distance:
    """Signed distance to triangles, negative where `inside` says so."""
    import igl

    boxes = igl.AABB()
    boxes.init(vertices, faces)

    def measure(points: np.ndarray) -> np.ndarray:
        squared = boxes.squared_distance(vertices, faces, points)[0]
        return np.where(inside(points), -1.0, 1.0) * np.sqrt(squared)

    return measure


def stl_distance(path: Path) -> Distance:
    """To the triangles of an STL file; inside by winding number."""
    import igl
    import trimesh

    mesh = trimesh.load_mesh(path)
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
    return triangle_distance(
        vertices, faces, lambda points: igl.fast_winding_number(vertices, faces, points) > 0.5
    )


def voxel_distance(path: Path, labels: tuple[int, ...]) -> Distance:
    """To the faces between lumen voxels and others; inside is where the nearest voxel is lumen."""
    import nibabel
    from scipy import ndimage

    image: Any = nibabel.load(path)
    lumen = np.isin(np.asarray(image.dataobj), labels)
    parts, _ = ndimage.label(lumen)
    lumen = np.pad(parts == np.bincount(parts[lumen]).argmax(), 1)
    affine = np.asarray(image.affine, dtype=np.float64)
    corners = []
    for axis in range(3):
        at = np.argwhere(np.diff(lumen, axis=axis)).astype(np.float64) - 1.0  # the padding
        at[:, axis] += 0.5
        u, v = 0.5 * np.eye(3)[[other for other in range(3) if other != axis]]
        corners.append(np.stack([at - u - v, at + u - v, at + u + v, at - u + v], axis=1))
    quads = np.concatenate(corners)
    vertices = quads.reshape(-1, 3) @ affine[:3, :3].T + affine[:3, 3]
    first = 4 * np.arange(len(quads))[:, None]
    faces = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]]).astype(np.int64)
    inverse = np.linalg.inv(affine)

    def is_lumen(points: np.ndarray) -> np.ndarray:
        index = np.rint(points @ inverse[:3, :3].T + inverse[:3, 3]).astype(int) + 1
        within = ((index >= 0) & (index < lumen.shape)).all(axis=1)
        index[~within] = 0
        return lumen[tuple(index.T)] & within

    return triangle_distance(np.ascontiguousarray(vertices), faces, is_lumen)


def sample_body(plan: SavedPlan, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points along the links from their tails, (steps, links, SAMPLES, 3), and which are counted.

    Not counted is what still waits in the introducer: from the tail of the chain on, every point
    behind the entry and in the bore, up to the first that is not.
    """
    tails, heads = plan.joints[steps, 1:, None], plan.joints[steps, :-1, None]
    points = tails + np.linspace(0.0, 1.0, SAMPLES)[:, None] * (heads - tails)
    introducer = plan.meta["introducer"]
    away = points - np.array(introducer["entry_mm"])
    ahead = away @ np.array(introducer["outward"])
    off = np.linalg.norm(away - ahead[..., None] * np.array(introducer["outward"]), axis=-1)
    waits = (ahead >= 0.0) & (off <= introducer["bore_mm"])
    from_tail = waits[:, ::-1].reshape(len(steps), -1)
    counted = ~np.logical_and.accumulate(from_tail, axis=1).reshape(waits.shape)[:, ::-1]
    return points, counted


def measure_clearance(plan: SavedPlan, steps: np.ndarray, distance: Distance) -> np.ndarray:
    """Least clearance of each link, (steps, links); infinite where all of it waits."""
    points, counted = sample_body(plan, steps)
    room = np.full(counted.shape, np.inf)
    room[counted] = -distance(points[counted])
    radius = 0.5 * plan.meta["scope"]["diameter_mm"]
    return room.min(axis=2) + plan.meta["field"]["inflation_mm"] - radius


def largest_gap(plan: SavedPlan, distance: Distance, *, every: int = EVERY) -> float:
    """Largest difference between the clearance saved and the one measured anew [mm]."""
    # The last step and the worst one are always among those looked at.
    worst = int(plan.clearance.min(axis=1).argmin())
    steps = np.union1d(np.arange(0, len(plan.joints), every), [worst, len(plan.joints) - 1])
    measured = measure_clearance(plan, steps, distance)
    saved = plan.clearance[steps]
    # A link that only just leaves the introducer may be seen by one sampling and not the other.
    both = np.isfinite(measured) & np.isfinite(saved)
    assert (np.isfinite(measured) != np.isfinite(saved)).sum(axis=1).max() <= 1
    assert both.sum() > 0.3 * both.size
    return float(np.abs(measured[both] - saved[both]).max())


def run_plan(source: Path, out: Path, *options: str) -> dict[str, SavedPlan]:
    """Plan by the default method and, for comparison, by the thesis's scheme."""
    arguments = ["plan", str(source), *options, "--diameter", "5mm", "--link", "6mm", "--compare"]
    code = main([*arguments, "--inflate", "3mm", "--quiet", "--json", "--out", str(out)])
    assert code in (0, 1)
    names = {"default": "plan.npz", "thesis": "plan-thesis.npz"}
    return {key: read_plan(out / name) for key, name in names.items()}


@pytest.fixture(scope="module")
def stl(upper_gi_dir: Path) -> Distance:
    return stl_distance(upper_gi_dir / "upper_gi_mc1mm.stl")


@pytest.fixture(scope="module")
def faces(upper_gi_dir: Path) -> Distance:
    return voxel_distance(upper_gi_dir / "upper_gi_labels_1mm.nii.gz", (1, 2, 3))


@pytest.fixture(scope="module")
def surface_plans(
    upper_gi_dir: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, SavedPlan]:
    out = tmp_path_factory.mktemp("surface") / "plan"
    return run_plan(upper_gi_dir / "upper_gi_mc1mm.stl", out)


@pytest.fixture(scope="module")
def label_plans(
    upper_gi_dir: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, SavedPlan]:
    out = tmp_path_factory.mktemp("labels") / "plan"
    return run_plan(upper_gi_dir / "upper_gi_labels_1mm.nii.gz", out, "--labels", "1,2,3")


@pytest.fixture(params=["default", "thesis"])
def surface_plan(request: pytest.FixtureRequest, surface_plans: dict[str, SavedPlan]) -> SavedPlan:
    return surface_plans[request.param]


@pytest.fixture(params=["default", "thesis"])
def label_plan(request: pytest.FixtureRequest, label_plans: dict[str, SavedPlan]) -> SavedPlan:
    return label_plans[request.param]


@pytest.fixture(params=["surface", "labels"])
def plan(
    request: pytest.FixtureRequest,
    surface_plans: dict[str, SavedPlan],
    label_plans: dict[str, SavedPlan],
) -> SavedPlan:
    return {"surface": surface_plans, "labels": label_plans}[request.param]["default"]


def check_proof(plan: SavedPlan, distance: Distance) -> None:
    """What is proved is no more than what is found."""
    found = measure_clearance(plan, np.arange(0, len(plan.joints), EVERY), distance)
    proved = plan.meta["certificate"]["clearance_mm"]
    assert plan.meta["certified"] == (proved >= 0.0)
    if plan.meta["certified"]:
        assert proved <= found.min() + 1e-6


def test_plan_from_the_surface_against_its_triangles(
    surface_plan: SavedPlan, stl: Distance
) -> None:
    stated = surface_plan.meta["field"]
    assert stated["wall_error_mm"] is None
    assert largest_gap(surface_plan, stl) <= stated["clearance_error_mm"]
    check_proof(surface_plan, stl)


def test_plan_from_labels_against_the_faces_of_the_voxels(
    label_plan: SavedPlan, faces: Distance
) -> None:
    assert largest_gap(label_plan, faces) <= label_plan.meta["field"]["clearance_error_mm"]
    check_proof(label_plan, faces)


def test_plan_from_labels_against_the_smoothed_surface(
    label_plan: SavedPlan, stl: Distance
) -> None:
    stated = label_plan.meta["field"]
    assert largest_gap(label_plan, stl) <= stated["clearance_error_mm"] + stated["wall_error_mm"]


def test_a_plan_moved_by_more_than_its_error_fails_the_re_check(
    surface_plan: SavedPlan, stl: Distance
) -> None:
    shift = 3.0 * surface_plan.meta["field"]["clearance_error_mm"]
    introducer = surface_plan.meta["introducer"]
    x, y, z = introducer["entry_mm"]
    moved = replace(
        surface_plan,
        joints=surface_plan.joints + [0.0, 0.0, shift],
        meta={**surface_plan.meta, "introducer": {**introducer, "entry_mm": [x, y, z + shift]}},
    )
    assert largest_gap(moved, stl, every=100) > moved.meta["field"]["clearance_error_mm"]


def test_links_keep_their_length(plan: SavedPlan) -> None:
    length = np.linalg.norm(np.diff(plan.joints, axis=1), axis=2)
    assert length == pytest.approx(plan.meta["scope"]["link_length_mm"], abs=1e-6)


def test_the_head_is_on_the_path(plan: SavedPlan) -> None:
    head = [np.interp(plan.head_arc_length, plan.path_arc_length, x) for x in plan.path.T]
    assert plan.joints[:, 0] == pytest.approx(np.stack(head, axis=1), abs=1e-6)
    assert np.diff(plan.head_arc_length).max() <= plan.meta["head_step_mm"] + 1e-9


def test_the_smallest_clearance_is_the_one_reported(plan: SavedPlan) -> None:
    assert plan.clearance.min() == pytest.approx(
        plan.meta["measures"]["clearance_min_mm"], abs=1e-12
    )

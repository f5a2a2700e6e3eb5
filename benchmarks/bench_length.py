"""From a surface to a certified plan for small bowels of 0.3, 1 and 3 m: how the cost grows."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from bozzini.anatomy import SurfaceTract
from bozzini.duct import build_field, find_centreline
from bozzini.motion import FreeSpace, Plan, Scope, certify_motion, certify_plan, plan_insertion

LENGTHS = (300, 1000, 3000)
SCOPE = Scope(diameter=8.0, link_length=8.0)


def make_bowel(length: float, voxel: float = 2.0) -> SurfaceTract:
    """Return a tube of 9 to 12.5 mm radius with folds, that winds from side to side in layers."""
    from skimage.measure import marching_cubes

    random, (width, pitch, rows) = np.random.default_rng(1), (120.0, 40.0, 5)
    knots, y, z, way = [], 0.0, 0.0, 1.0
    for leg in range(int(length / (width + pitch)) + 3):
        for x in (0.15, 0.5, 0.85)[:: -1 if leg % 2 else 1]:
            knots.append([x * width, y + random.uniform(-4, 4), z + random.uniform(-4, 4)])
        if leg % rows == rows - 1:
            way, z = -way, z + pitch
        else:
            y += way * pitch
    chords = np.sqrt(np.linalg.norm(np.diff(knots, axis=0), axis=1))
    at = np.concatenate([[0.0], np.cumsum(chords)])
    fine = CubicSpline(at, knots)(np.linspace(0.0, at[-1], 20_000))
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    s = np.arange(0.0, length)
    curve = np.stack([np.interp(s, arc, column) for column in fine.T], axis=1)
    radius = 11.0 + 1.5 * np.sin(2.0 * np.pi * s / 90.0)
    radius -= 2.0 * np.exp(-((((s % 24.0) - 12.0) / 3.5) ** 2))
    low = curve.min(axis=0) - 16.0
    counts = np.ceil((curve.max(axis=0) + 16.0 - low) / voxel).astype(int)
    nodes = low + voxel * np.indices(counts).reshape(3, -1).T
    near = cKDTree(curve).query(nodes, distance_upper_bound=16.0)[0] < 16.0
    found, index = cKDTree(curve).query(nodes[near], k=24)
    values = np.full(len(nodes), 5.0)
    values[near] = (found - radius[index]).min(axis=1)
    vertices, faces, *_ = marching_cubes(values.reshape(counts), level=0.0, spacing=(voxel,) * 3)
    corners = vertices[faces].astype(float)
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    outward = faces if volume > 0.0 else faces[:, ::-1]
    return SurfaceTract(
        vertices=vertices.astype(float) + low,
        faces=np.ascontiguousarray(outward, dtype=np.int64),
        source="made",
    )


def run(tract: SurfaceTract) -> tuple[dict[str, float], Plan, FreeSpace]:
    """Return the processor's time of each stage [s], the plan, and its free space."""
    times = [time.process_time()]
    field = build_field(tract, voxel=1.0)
    times.append(time.process_time())
    line = find_centreline(field)
    times.append(time.process_time())
    plan = plan_insertion(field, line, scope=SCOPE)
    times.append(time.process_time())
    certificate = certify_plan(plan, field)
    times.append(time.process_time())
    assert plan.certified and certificate.certified
    names = ("field", "line", "plan", "certificate")
    spent = dict(zip(names, np.diff(times).tolist(), strict=True))
    return spent, plan, FreeSpace(field, introducer=plan.introducer)


def count_alone(plan: Plan, space: FreeSpace) -> int:
    """Return the evaluations of the field when no link follows another."""
    pairs = (plan.joints[:, j - 1 : j + 1] for j in range(1, plan.links + 1))
    return sum(certify_motion(p, space, radius=SCOPE.radius).evaluations for p in pairs)


def fit_exponent(values: list[float]) -> float:
    return float(np.polyfit(np.log(LENGTHS), np.log(values), 1)[0])


def bench_length(benchmark: Any) -> None:
    tracts = [make_bowel(length) for length in LENGTHS]
    run(tracts[0])
    runs = benchmark.pedantic(lambda: [run(tract) for tract in tracts], rounds=1)
    for length, (spent, plan, space) in zip(LENGTHS, runs, strict=True):
        certificate = certify_plan(plan, space.duct)
        ratio = count_alone(plan, space) / certificate.evaluations
        shown = ", ".join(f"{stage} {value:.2f} s" for stage, value in spent.items())
        print(f"{length} mm, {plan.steps} steps x {plan.links} links: {shown}; each link alone "
              f"takes {ratio:.1f} times the evaluations ({certificate.evaluations:,})")  # fmt: skip
    plans, proofs, counts = (
        fit_exponent([run[0]["plan"] for run in runs]),
        fit_exponent([run[0]["certificate"] for run in runs]),
        fit_exponent([certify_plan(run[1], run[2].duct).evaluations for run in runs]),
    )
    total = sum(runs[-1][0].values()) - runs[-1][0]["certificate"]
    benchmark.extra_info.update(
        what="a made small bowel of 3 m, surface to certified plan, and exponents from 0.3 to 3 m",
        measured=f"{total:.1f} s of the processor; plan {plans:.2f}, certificate {proofs:.2f}, its "
        f"evaluations {counts:.2f}; each link alone takes {ratio:.0f} times as many",
        required="10 s and exponents of 1.3 at most",
    )
    assert counts <= 1.3
    assert total <= 10.0
    assert plans <= 1.3 and proofs <= 1.3

"""Contact of a plan: a random wall to first order, against displaced walls, and planned anew."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bozzini.anatomy import SurfaceTract, read_tract
from bozzini.duct import SampledField, build_field, find_centreline
from bozzini.motion import Plan, PlannerOptions, Scope, plan_insertion
from bozzini.motion.recheck import surface_wall
from bozzini.motion.verify import build_wall
from bozzini.study import ContactRiskOptions, WallError
from bozzini.study.contact_risk import displace_wall, replan_draws
from bozzini.study.wall import BodySamples, choose_deciding, draw_reaches, sample_body

DIAMETER = 6.5
DRAWS, BRUTE = 1000, 20
CASES = ((0.5, 10.0), (0.25, 10.0), (0.5, 30.0), (0.3, 15.0))

Rest = tuple[SurfaceTract, SampledField, Plan, BodySamples]


@pytest.fixture(scope="module")
def rest(upper_gi_dir: Path) -> Rest:
    surface = read_tract(upper_gi_dir / "upper_gi_mc1mm.stl")
    field = build_field(surface, voxel=1.0)
    plan = plan_insertion(
        field,
        find_centreline(field),
        scope=Scope(diameter=DIAMETER, link_length=12.0),
        method="tube",
        options=PlannerOptions(head_step=1.0, advise=False),
    )
    assert plan.certified
    return surface, field, plan, sample_body(plan, field, build_wall(surface))


@pytest.mark.parametrize(("sd", "correlation"), CASES)
def bench_random_wall(benchmark: Any, rest: Rest, sd: float, correlation: float) -> None:
    surface, field, _, samples = rest
    error, radius = WallError(sd=sd, correlation=correlation), 0.5 * DIAMETER
    deciding = choose_deciding(samples, error, radius)
    draw_reaches(deciding, error, seed=1, numbers=range(10))
    begin = time.process_time()
    reach, _ = benchmark.pedantic(
        draw_reaches,
        args=(deciding, error),
        kwargs={"seed": 1, "numbers": range(DRAWS)},
        rounds=1,
    )
    each = 1e3 * (time.process_time() - begin) / DRAWS
    near = samples.points[samples.distance < samples.distance.min() + 6.0 * sd + 1.0]
    near = np.unique(near, axis=0)
    brute = []
    begin = time.process_time()
    for number in range(BRUTE):
        moved = displace_wall(surface, error, seed=1, number=number, duct=field)
        brute.append(surface_wall(moved.vertices, moved.faces).measure_clearance(near).min())
    walls = 1e3 * (time.process_time() - begin) / BRUTE
    off = reach[:BRUTE] - np.array(brute)
    hits, wanted = reach[:BRUTE] < radius, np.array(brute) < radius
    benchmark.extra_info.update(
        what=f"a random wall of the upper tract, sd {sd:g} mm, correlation {correlation:g} mm",
        measured=f"{each:.2f} ms of the processor ({len(deciding.points)} places; a displaced wall "
        f"{walls:.0f} ms); clearance off by {off.mean():+.3f}, sd {off.std():.3f}, at most "
        f"{np.abs(off).max():.3f} mm; P {hits.mean():.3f} against {wanted.mean():.3f} of {BRUTE}, "
        f"{int((hits != wanted).sum())} differ; P of {DRAWS}: {(reach < radius).mean():.3f}",
        required="5 ms, sd 0.03 mm",
    )
    assert off.std() <= 0.03
    assert abs(hits.mean() - wanted.mean()) <= 0.05


def bench_planned_anew(benchmark: Any, rest: Rest) -> None:
    surface, field, plan, _ = rest
    error = WallError(sd=0.3)

    def run(count: int) -> int:
        options = ContactRiskOptions(replan=count)
        return replan_draws(plan, surface, error, duct=field, options=options).failed

    run(1)
    begin = time.process_time()
    failed = benchmark.pedantic(run, args=(20,), rounds=1)
    each = 1e3 * (time.process_time() - begin) / 20
    benchmark.extra_info.update(
        what="a random wall of the upper tract, planned anew and certified",
        measured=f"{each:.0f} ms of the processor; no plan in {failed} of 20 "
        f"(load {os.getloadavg()[0]:.1f})",
        required="",
    )

"""Tendon robots along a plan: time of a fitted step, and of the proof of the executed motion."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from bozzini.anatomy import read_tract
from bozzini.duct import build_field, find_centreline
from bozzini.motion import FreeSpace, Scope, plan_insertion
from bozzini.motion.actuate.actuate import FitJob, actuate_plan, check_robot
from tests.motion.actuate.motions import make_robot


@pytest.fixture(scope="module")
def human(upper_gi_dir: Path) -> Any:
    field = build_field(read_tract(upper_gi_dir / "upper_gi_labels_1mm.nii.gz", labels="all"))
    return field, find_centreline(field)


@pytest.mark.parametrize(("section", "radius", "count"), [(20.0, 2.5, 17), (30.0, 2.0, 12)])
def bench_actuation(benchmark: Any, human: Any, section: float, radius: float, count: int) -> None:
    field, line = human
    robot = make_robot(section, count, radius=radius)
    scope = Scope(diameter=2.0 * radius, link_length=0.5 * section)
    plan = plan_insertion(field, line, scope=scope)
    moved = actuate_plan(plan, robot, field)
    space = FreeSpace(field, introducer=plan.introducer)
    job = FitJob(plan, check_robot(robot), space)
    fit = benchmark.pedantic(job.fit, args=(1.0,), rounds=5, warmup_rounds=1)
    each = benchmark.stats.stats.median / plan.steps
    begin = time.perf_counter()
    proof = job.certify(fit)
    seconds = time.perf_counter() - begin
    told = moved.summarise()
    benchmark.extra_info.update(
        what=f"robot of {count} sections of {section:g} mm, radius {radius:g} mm, upper tract",
        measured=f"{1e3 * each:.2f} ms per step, {plan.steps} steps; proof {seconds:.2f} s, "
        f"clear by {proof.clearance:.2f} mm; off the path {told['fit']['rms_max_mm']:.2f} mm rms; "
        f"bends up to {told['bend']['max_rad'] * 57.29578:.0f} deg",
        required="1 ms per step, certified",
    )
    assert each < 1e-3
    assert moved.fits

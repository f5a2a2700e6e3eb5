"""The stages of the main job on a CT-derived upper tract, where that is at hand."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bozzini.anatomy import read_tract
from bozzini.motion import Scope
from bozzini.study import InsertionOptions, InsertionStudy, run_insertion


def run_stages(source: Path, labels: tuple[int, ...] | None) -> InsertionStudy:
    begin = time.perf_counter()
    tract = read_tract(source, labels=labels)
    seconds = {"read": time.perf_counter() - begin}
    scope = Scope(diameter=5.0, link_length=6.0)
    study = run_insertion(tract, scope, options=InsertionOptions(inflate=3.0, method="thesis"))
    return replace(study, seconds=seconds | study.seconds)


@pytest.mark.parametrize(
    ("kind", "name", "labels"),
    [
        ("labels", "upper_gi_labels_1mm.nii.gz", (1, 2, 3)),
        ("surface", "upper_gi_mc1mm.stl", None),
    ],
)
def bench_stages(
    benchmark: Any, upper_gi_dir: Path, kind: str, name: str, labels: tuple[int, ...] | None
) -> None:
    study = benchmark.pedantic(
        run_stages, args=(upper_gi_dir / name, labels), rounds=1, warmup_rounds=1
    )
    stages = ("read", "distance", "centreline", "plan")
    shown = ", ".join(f"{stage} {study.seconds[stage]:.2f} s" for stage in stages)
    benchmark.extra_info.update(
        what=f"stages on the upper tract, from {kind}", measured=shown, seconds=study.seconds
    )
    if kind == "labels":
        benchmark.extra_info["required"] = "centreline from labels within 15 s"
        assert sum(study.seconds[stage] for stage in ("read", "distance", "centreline")) < 15.0

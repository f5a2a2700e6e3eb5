"""Studies: a million designs, parallel efficiency, Dask, maps, a population, Sobol indices."""

from __future__ import annotations

import os
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bozzini.effector import Effector, effector_preset
from bozzini.effector.batch import measure_designs
from bozzini.io.records import read_record
from bozzini.study import (
    Engine,
    Study,
    StudySpec,
    analyse_study,
    count_fits,
    read_rows,
    run_study,
)

DESIGNS: dict[str, Any] = {
    "format": "bozzini-study-1",
    "job": "effector-design",
    "fixed": {"preset": "prototype", "deflection": "12 mm"},
    "factors": {
        "offset": {"range": ["2.5 mm", "4.5 mm"]},
        "flexural_rigidity": {"range": ["50 N mm^2", "400 N mm^2"], "scale": "log"},
        "segments": {"integers": [10, 20]},
        "length": {"range": ["40 mm", "55 mm"]},
        "muscle.modulus": {"normal": ["0.56 MPa", "0.03 MPa"], "clip": ["0.4 MPa", "0.7 MPa"]},
        "muscle.braid_angle": {"range": ["33 deg", "39 deg"]},
    },
}
MAP: dict[str, Any] = {
    "format": "bozzini-study-1",
    "job": "insertion-feasibility",
    "fixed": {
        "tract": "upper_gi_labels_1mm.nii.gz",
        "labels": "1,2,3",
        "organ": "upper-tract",  # else both ends are tried
        "head_step": "1 mm",
    },
    "factors": {
        "link_length": {"values": [4, 6, 9, 12, 16, 20, 25]},
        "diameter": {"values": [4, 5, 6, 7, 8, 8.5, 9, 10, 11]},
    },
    "sampling": {"method": "grid"},
}


def make_study(count: int) -> Study:
    sampling = {"method": "sobol", "count": count, "seed": 7}
    return Study(read_record(DESIGNS | {"sampling": sampling}, StudySpec))


def measure_processor() -> float:
    """Processor time of this process and of those that have ended [s]."""
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in usage)


def time_run(study: Study, folder: Path, engine: Engine) -> tuple[float, float]:
    """Wall-clock and processor time of a study [s]."""
    begin, used = time.perf_counter(), measure_processor()
    run_study(study, folder, engine=engine)
    return time.perf_counter() - begin, measure_processor() - used


def bench_kernel(benchmark: Any) -> None:
    study = make_study(4096)
    columns = study.draw(0, 4096)
    effector = Effector(effector_preset("prototype"))
    measure_designs(effector, columns, deflection=12.0)
    benchmark.pedantic(
        lambda: measure_designs(effector, columns, deflection=12.0), rounds=5, warmup_rounds=1
    )
    each = 1e6 * benchmark.stats.stats.min / 4096
    benchmark.extra_info.update(
        what="a design of an end-effector in a study: amplitudes, radius, area, needed pressure",
        measured=f"{each:.1f} us each, in a batch on one core",
        required="30 us",
    )
    assert each < 30.0


def bench_million_designs(benchmark: Any, tmp_path: Path) -> None:
    study = make_study(1_000_000)
    run_study(make_study(1000), tmp_path / "warm", engine=Engine(workers=1))
    wall, used = benchmark.pedantic(
        time_run, args=(study, tmp_path / "out", Engine(workers=2)), rounds=1
    )
    benchmark.extra_info.update(
        what="a study of 1,000,000 designs of an end-effector, 2 processes, files included",
        measured=f"{wall:.0f} s, {used:.0f} s of the processor",
        required="60 s on 2 quiet cores",
    )
    assert wall < 60.0


def measure_workers(folder: Path) -> float:
    """Return what the largest worker of a pool or of Dask has taken [MB]."""
    for name in (None, "local"):
        engine = Engine(workers=2, cluster=name)
        run_study(make_study(100_000), folder / f"memory-{name}", engine=engine)
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0


def bench_engines(benchmark: Any, tmp_path: Path) -> None:
    run_study(make_study(1000), tmp_path / "warm", engine=Engine(workers=1))

    def time_more(name: str, engine: Engine) -> tuple[float, float]:
        """Wall-clock and processor time of 400,000 designs more [s]: without the start."""
        few = time_run(make_study(40_000), tmp_path / f"{name}-few", engine)
        many = time_run(make_study(440_000), tmp_path / f"{name}-many", engine)
        return many[0] - few[0], many[1] - few[1]

    one, alone = time_more("one", Engine(workers=1))
    two, pool = benchmark.pedantic(time_more, args=("two", Engine(workers=2)), rounds=1)
    _, dask = time_more("dask", Engine(workers=2, cluster="local"))
    # Of a process whose only children are the workers.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as apart:
        memory = apart.submit(measure_workers, tmp_path).result()
    benchmark.extra_info.update(
        what="400,000 designs more: 2 processes against one, and Dask",
        measured=f"efficiency {one / (2.0 * two):.2f} ({one:.1f} and {two:.1f} s, load "
        f"{os.getloadavg()[0]:.1f}); processor time {alone:.1f} s, 2 processes "
        f"{100.0 * (pool / alone - 1.0):+.0f} %, Dask {100.0 * (dask / alone - 1.0):+.0f} %; "
        f"largest worker {memory:.0f} MB",
        required="efficiency 0.8, Dask 15 % on a quiet machine; 500 MB",
    )
    assert memory < 500.0


@pytest.mark.parametrize("workers", [1])
def bench_feasibility_map(benchmark: Any, upper_gi_dir: Path, tmp_path: Path, workers: int) -> None:
    study = Study(read_record(MAP, StudySpec), upper_gi_dir)
    wall, used = benchmark.pedantic(
        time_run, args=(study, tmp_path / "out", Engine(workers=workers)), rounds=1
    )
    rows = run_study(study, tmp_path / "out").read()
    benchmark.extra_info.update(
        what="feasibility map of the upper tract, 9 diameters x 7 links, one process",
        measured=f"{wall:.0f} s, {used:.0f} s of the processor; {rows['feasible'].sum()} of "
        f"{len(rows)} fit, proved",
        required="30 s",
    )
    assert np.isfinite(rows["clearance_mm"][rows["feasible"]]).all()
    assert wall < 30.0


POPULATION: dict[str, Any] = {
    "format": "bozzini-study-1",
    "job": "insertion-feasibility",
    "fixed": {"link_length": "10 mm", "head_step": "1 mm", "voxel": "1.5 mm"},
    "factors": {
        "phantom": {"integers": [1, 100]},
        "diameter": {"values": [8, 10, 11, 12, 13, 14]},
    },
    "sampling": {"method": "grid"},
    "chunk": 6,
}


def bench_population(benchmark: Any, tmp_path: Path) -> None:
    study = Study(read_record(POPULATION, StudySpec))
    _, used = benchmark.pedantic(
        time_run, args=(study, tmp_path / "out", Engine(workers=1)), rounds=1
    )
    found = count_fits(study, read_rows(tmp_path / "out"))
    fits = ", ".join(f"{row['fits']}" for row in found.table.to_dict("records"))
    benchmark.extra_info.update(
        what="which of 100 phantoms six scopes fit, 600 rows, one process",
        measured=f"{used:.0f} s of the processor; {fits} fit",
        required="600 s of the processor: 5 min on 2 cores",
    )
    assert used < 600.0 and not found.table["errors"].any()


def bench_sobol(benchmark: Any, tmp_path: Path) -> None:
    sampling = {"method": "saltelli", "count": 16_384, "seed": 7}
    study = Study(read_record(DESIGNS | {"sampling": sampling}, StudySpec))
    run_study(make_study(1000), tmp_path / "warm", engine=Engine(workers=1))

    def analyse() -> float:
        begin = measure_processor()
        analyse_study(study, tmp_path / "out", failures="indicator", engine=Engine(workers=1))
        return measure_processor() - begin

    used = benchmark.pedantic(analyse, rounds=1)
    benchmark.extra_info.update(
        what="Sobol indices of five outputs of an end-effector over six factors, with intervals",
        measured=f"{study.rows} rows: {used:.1f} s of the processor",
    )

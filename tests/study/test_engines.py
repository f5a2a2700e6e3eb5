"""The same rows by processes, by Dask and after kills; a cluster that dies is one line."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml

from bozzini.errors import InputError
from bozzini.study import Engine, Study, read_rows, run_study
from bozzini.study.run import read_status

STUDY = {
    "format": "bozzini-study-1",
    "job": "effector-design",
    "fixed": {"preset": "prototype", "deflection": "12 mm"},
    "factors": {
        "offset": {"range": ["1.5 mm", "4.5 mm"]},
        "length": {"range": ["40 mm", "55 mm"]},
        "segments": {"integers": [10, 20]},
    },
    "sampling": {"method": "sobol", "count": 10_000, "seed": 7},
    "chunk": 200,
}


def write_study(folder: Path, **changes: object) -> Path:
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(STUDY | changes))
    return path


def wait_for(condition: object, limit: float = 90.0) -> None:
    assert callable(condition)
    end = time.monotonic() + limit
    while not condition():
        assert time.monotonic() < end, "it took too long"
        time.sleep(0.1)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the folder of the study as one process runs it."""
    folder = tmp_path_factory.mktemp("study")
    run_study(Study.load(write_study(folder)), folder / "whole", engine=Engine(workers=1))
    return folder / "whole"


@contextmanager
def started(*words: str, cwd: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Start a program in a process group of its own, which is killed at the end."""
    process = subprocess.Popen(
        [sys.executable, "-m", *words],
        cwd=cwd,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        process.wait()


@pytest.mark.slow(40)
def test_processes_give_the_rows_of_one(tmp_path: Path, whole: Path) -> None:
    study = Study.load(write_study(tmp_path))
    told: list[str] = []
    found = run_study(
        study,
        tmp_path / "two",
        engine=Engine(workers=2),
        progress=lambda stage, _: told.append(stage),
    )
    assert found.converged and read_rows(tmp_path / "two").equals(read_rows(whole))
    assert len(told) == 50 and all("a second" in stage and "left" in stage for stage in told)


@pytest.mark.slow(80)
def test_kills_lose_and_double_nothing(tmp_path: Path, whole: Path) -> None:
    path = write_study(tmp_path)
    study = Study.load(path)
    folder = tmp_path / "out"
    rows = folder / "rows"
    rng = random.Random(5)
    for _ in range(4):
        done = len(list(rows.glob("part-*"))) if rows.is_dir() else 0
        run = ("bozzini", "study", "run", str(path), "--out", str(folder), "--workers", "2")
        with started(*run, cwd=tmp_path) as process:
            wait_for(
                lambda known=done, own=process: (
                    own.poll() is not None
                    or (rows.is_dir() and len(list(rows.glob("part-*"))) > known)
                )
            )
            time.sleep(rng.uniform(0.0, 0.3))
    parts = sorted(rows.glob("part-*"))
    assert parts, "a part was written before a kill"
    parts[0].write_bytes(parts[0].read_bytes()[:-100])
    (rows / ".part-000003.left.parquet").write_bytes(b"")
    found = run_study(study, folder, engine=Engine(workers=1))
    assert found.converged and found.done == 10_000
    assert not list(rows.glob(".*"))
    for part in sorted(rows.iterdir()):
        assert part.read_bytes() == (whole / "rows" / part.name).read_bytes()  # bit by bit


@pytest.mark.slow(90)
def test_dask_gives_the_rows_of_one(tmp_path: Path, whole: Path) -> None:
    pytest.importorskip("distributed")
    study = Study.load(write_study(tmp_path, chunk=2_000))
    run_study(study, tmp_path / "local", engine=Engine(workers=2, cluster="local"))
    rows = read_rows(whole)
    assert read_rows(tmp_path / "local").equals(rows)
    place = str(tmp_path / "scheduler.json")
    quiet = ("--no-dashboard",)
    begin = ("distributed.cli.dask_scheduler", "--scheduler-file", place, "--port", "0", *quiet)
    worker = ("distributed.cli.dask_worker", "--scheduler-file", place, "--nthreads", "1")
    with started(*begin, cwd=tmp_path) as scheduler:
        wait_for(lambda: Path(place).is_file())
        with (
            started(*worker, *quiet, cwd=tmp_path),
            started(*worker, *quiet, cwd=tmp_path),
        ):
            wait_for(lambda: _count_workers(place) == 2)
            run_study(study, tmp_path / "started", engine=Engine(cluster=place))
            assert read_rows(tmp_path / "started").equals(rows)
            long = Study.load(
                write_study(tmp_path, sampling={"method": "sobol", "count": 4_000_000}, chunk=2_000)
            )
            folder = tmp_path / "long"

            def kill_scheduler(stage: str, share: float) -> None:
                os.kill(scheduler.pid, signal.SIGKILL)

            with pytest.raises(InputError, match="the cluster stopped.*resume"):
                run_study(long, folder, engine=Engine(cluster=place), progress=kill_scheduler)
            status = read_status(folder)
            assert 0 < status.done < status.rows and not status.converged


def _count_workers(place: str) -> int:
    from distributed import Client

    with Client(scheduler_file=place, timeout=30) as client:
        return len(client.scheduler_info(n_workers=-1)["workers"])


def test_a_cluster_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="must be local"):
        Engine(cluster="nowhere")
    with pytest.raises(InputError, match="workers"):
        Engine(workers=0)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["Engine(workers=2)", 'Engine(workers=2, cluster="local")'])
def test_a_script_without_a_guard_runs_once(tmp_path: Path, engine: str) -> None:
    """Workers do not run the caller's script, which would start the study again in each."""
    (tmp_path / "study.yaml").write_text(
        "format: bozzini-study-1\njob: muscle-tolerance\nfixed: {preset: thesis-45}\n"
        "factors: {pressure: {range: [0.2 MPa, 0.6 MPa]}}\n"
        "sampling: {method: random, count: 8, seed: 1}\nchunk: 2\n"
    )
    script = tmp_path / "script.py"
    script.write_text(
        "from bozzini.study import Engine, Study, run_study\n"
        "print('begins', flush=True)\n"
        f"print(run_study(Study.load('study.yaml'), 'out', engine={engine}).done)\n"
    )
    ran = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, timeout=300
    )
    assert ran.stdout.split() == ["begins", "8"], ran.stderr

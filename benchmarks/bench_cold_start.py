"""The first plan on a new machine: nothing compiled yet."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any


def run_demo(place: Path, cache: Path) -> float:
    """Seconds of a whole process that plans through the phantom and writes its report."""
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "bozzini", "demo", "--quiet", "--json", "--out", str(place)],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    took = time.perf_counter() - begin
    assert done.returncode in (0, 1), done.stderr
    assert json.loads(done.stdout)["steps"] > 1
    return took


def bench_first_plan(benchmark: Any, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    cache.mkdir()
    cold = benchmark.pedantic(run_demo, args=(tmp_path / "cold", cache), rounds=1)
    assert any(cache.rglob("*.nbi"))
    warm = run_demo(tmp_path / "warm", cache)
    benchmark.extra_info.update(
        what="cold start: `bozzini demo` with nothing compiled, whole process",
        measured=f"{cold:.1f} s (again, compiled: {warm:.1f} s)",
        required="under 20 s",
    )
    assert cold < 20.0

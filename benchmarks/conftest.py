"""Collect ``bench_*.py``, find the real anatomy where there is one, and print what was measured."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import pytest

from tests.conftest import colon_dir, upper_gi_dir  # noqa: F401  (fixtures)


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("python_files", "bench_*.py")
    config.addinivalue_line("python_functions", "bench_*")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Keep with what was measured whether the bound was kept."""
    report = yield
    benchmark = getattr(item, "funcargs", {}).get("benchmark")
    if call.when == "call" and benchmark is not None:
        kept = benchmark.extra_info.get("kept", True)
        benchmark.extra_info["kept"] = report.passed and kept
    return report


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    session = getattr(config, "_benchmarksession", None)
    rows = [bench.extra_info for bench in getattr(session, "benchmarks", [])]
    rows = [row for row in rows if "what" in row]
    if not rows:
        return
    terminalreporter.section("measured, and required")
    width = max(len(row["what"]) for row in rows)
    for row in rows:
        required = f"   (required: {row['required']})" if row.get("required") else ""
        terminalreporter.write_line(f"{row['what']:<{width}}  {row['measured']}{required}")

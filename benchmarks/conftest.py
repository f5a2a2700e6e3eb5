"""Collect ``bench_*.py``, find the real anatomy where there is one, and print what was measured."""

from __future__ import annotations

from typing import Any

import pytest

from tests.conftest import upper_gi_dir  # noqa: F401  (a fixture)


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("python_files", "bench_*.py")
    config.addinivalue_line("python_functions", "bench_*")


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

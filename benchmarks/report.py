"""Run the benchmarks and write their table into ``docs/benchmarks.md``.

python benchmarks/report.py
"""

from __future__ import annotations

import json
import os
import platform
import re
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "benchmarks.md"
BEGIN, END = "<!-- table: begin -->", "<!-- table: end -->"


def run_benchmarks() -> list[dict[str, Any]]:
    """Run all of them and return what each has to say, also where a bound was not kept."""
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "result.json"
        options = ["-o", "addopts=", "-q", "-p", "no:xdist", "--benchmark-only"]
        command = [sys.executable, "-m", "pytest", *options, f"--benchmark-json={result}"]
        code = subprocess.run([*command, "benchmarks"], cwd=ROOT, check=False).returncode
        if not result.exists() or result.stat().st_size == 0:
            raise SystemExit(f"no benchmark was run (pytest ended with {code})")
        benchmarks = json.loads(result.read_text("utf-8"))["benchmarks"]
    return [item["extra_info"] for item in benchmarks if "what" in item["extra_info"]]


def describe_processor() -> str:
    """Say what the processor is, as its maker calls it."""
    info = Path("/proc/cpuinfo")
    match = re.search(r"model name\s*:\s*(.+)", info.read_text()) if info.exists() else None
    return match[1].strip() if match else platform.machine()


def format_table(rows: list[dict[str, Any]]) -> str:
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba"))
    lines = [
        f"Measured on {describe_processor()}, {os.cpu_count()} cores, {platform.system()}, "
        f"Python {platform.python_version()}, {packages}.",
        "",
        "| what | measured | required |",
        "|---|---|---|",
    ]
    lines += [f"| {row['what']} | {row['measured']} | {row.get('required', '')} |" for row in rows]
    return "\n".join(lines)


def main() -> None:
    page = PAGE.read_text("utf-8")
    before, rest = page.split(BEGIN)
    _, after = rest.split(END)
    table = format_table(run_benchmarks())
    PAGE.write_text(f"{before}{BEGIN}\n\n{table}\n\n{END}{after}", "utf-8")


if __name__ == "__main__":
    main()

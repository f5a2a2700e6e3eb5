"""Run benchmarks and write their tables into the documentation.

    python benchmarks/report.py                 all of them
    python benchmarks/report.py physics study   those of bench_physics.py and bench_study.py

``docs/benchmarks-all.md`` gets every row, ``docs/benchmarks.md`` those of `HEADLINES`.
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

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "benchmarks.md"
ALL = ROOT / "docs" / "benchmarks-all.md"
BEGIN, END = "<!-- table: begin -->", "<!-- table: end -->"

HEADLINES = (
    ("A certified plan through a human tract in a tenth of a second", "tract, diameter 6, .*tube"),
    ("Planning anew in a tract that moves keeps pace with a camera", "the loop on the upper tract"),
    ("The thesis's link step, by the formulation as printed", "one link .*as printed"),
    ("Distances to shapes cost less than to a mesh", "signed distance of 100 round cones"),
    ("From CT labels to a plan in seconds", "stages on the upper tract, from labels"),
    ("A million solves of a muscle take half a second", "ends none"),
    ("All models of muscles, fitted, ranked and cross-validated", "all muscle models on 40"),
    ("The pose of a catheter tip, beside SciPy's optimiser", "SLSQP on the squared"),
    ("Its inverse is exact and fast enough for a stick", "stick readings to pressures"),
    ("A robot of linkages, beside SciPy's optimiser", "backbone of 20 linkages"),
    ("The inverse of a tendon robot of six sections", "inverse to a pose, 6 section"),
    ("An elastic robot with winding tendons", r"energy \(channel\), 2 sections"),
    ("A hysteresis operator, beside plain Python", "hysteresis: plays"),
    ("A million designs on two cores", "a study of 1,000,000 designs"),
    ("A motion driven with contact, against real time", "upper tract, .*prism.*"),
)  # fmt: skip
"""What a row shows, and what finds it among the rows' titles: at most 15."""


def run_benchmarks(names: list[str]) -> list[dict[str, str]]:
    """Run all files or those named, and return what each row has to say, bound kept or not."""
    files = [f"benchmarks/bench_{name}.py" for name in names] or ["benchmarks"]
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "result.json"
        options = ["-o", "addopts=", "-q", "-p", "no:xdist", "--benchmark-only"]
        command = [sys.executable, "-m", "pytest", *options, f"--benchmark-json={result}"]
        code = subprocess.run([*command, *files], cwd=ROOT, check=False).returncode
        if not result.exists() or result.stat().st_size == 0:
            raise SystemExit(f"no benchmark was run (pytest ended with {code})")
        benchmarks = json.loads(result.read_text("utf-8"))["benchmarks"]
    return [item["extra_info"] for item in benchmarks if "what" in item["extra_info"]]


def describe_machine() -> str:
    """Say what was measured on, the processor as its maker calls it."""
    info = Path("/proc/cpuinfo")
    match = re.search(r"model name\s*:\s*(.+)", info.read_text()) if info.exists() else None
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba"))
    return (
        f"Measured on {match[1].strip() if match else platform.machine()}, {os.cpu_count()} cores, "
        f"{platform.system()}, Python {platform.python_version()}, {packages}."
    )


def read_rows(page: str) -> dict[str, str]:
    """Return the lines of a page's table by their titles."""
    table = page.partition(BEGIN)[2].partition(END)[0]
    lines = [line for line in table.splitlines() if line.startswith("| ")]
    return {line.split(" | ")[0].removeprefix("| "): line for line in lines[1:]}


def replace_table(page: Path, lines: list[str]) -> None:
    """Write a page with other lines between its marks."""
    before, rest = page.read_text("utf-8").split(BEGIN)
    table = "\n".join([describe_machine(), "", *lines])
    page.write_text(f"{before}{BEGIN}\n\n{table}\n\n{END}{rest.split(END)[1]}", "utf-8")


def choose_headlines(rows: dict[str, str]) -> list[str]:
    """Return the rows of the short table."""
    chosen = []
    for message, pattern in HEADLINES:
        found = next((line for what, line in rows.items() if re.search(pattern, what)), None)
        if found is not None:
            what, measured = found.removeprefix("| ").split(" | ")[:2]
            chosen.append(f"| {message} | {what} | {measured} |")
    return chosen


def main(names: list[str]) -> None:
    """Measure and write both pages."""
    rows = read_rows(ALL.read_text("utf-8")) if names else {}
    for row in run_benchmarks(names):
        line = f"| {row['what']} | {row['measured']} | {row.get('required', '')} |"
        rows[row["what"]] = line
    replace_table(ALL, ["| what | measured | required |", "|---|---|---|", *rows.values()])
    short = choose_headlines(rows)
    replace_table(PAGE, ["| message | case | measured |", "|---|---|---|", *short])


if __name__ == "__main__":
    main(sys.argv[1:])

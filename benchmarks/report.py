"""Run benchmarks, keep what they measured, and write it into the documentation.

    python -m benchmarks.report                 all of them, but for the peers
    python -m benchmarks.report physics study   those of bench_physics.py and bench_study.py
    python -m benchmarks.report peers           the comparison with other packages
    python -m benchmarks.report pages           none: write the pages from what is kept

``benchmarks/measured.json`` is the one source: every row with the machine that measured it, and the
peers. ``make docs`` takes the tables of both pages from there; sentences of all pages get the
numbers that `benchmarks.claims` lists.
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

from .claims import CLAIMS
from .compare_peers import format_peers, measure_peers

ROOT = Path(__file__).resolve().parents[1]
MEASURED = ROOT / "benchmarks" / "measured.json"

HEADLINES = (
    ("A certified plan through a human tract", "tract, diameter 6, .*tube"),
    ("Planning anew in a tract that moves", "the loop on the upper tract"),
    ("The thesis's link step, by the formulation as printed", "one link .*as printed"),
    ("Distances to shapes, beside those to a mesh", "signed distance of 100 round cones"),
    ("From CT labels to a plan", "stages on the upper tract, from labels"),
    ("Solves of a muscle, in a batch", "ends none"),
    ("All models of muscles, fitted, ranked and cross-validated", "all muscle models on 40"),
    ("The pose of a catheter tip, beside SciPy's optimiser", "SLSQP on the squared"),
    ("Its inverse, for a stick", "stick readings to pressures"),
    ("A robot of linkages, beside SciPy's optimiser", "backbone of 20 linkages"),
    ("The inverse of a tendon robot of six sections", "inverse to a pose, 6 section"),
    ("An elastic robot with winding tendons", r"energy \(channel\), 2 sections"),
    ("A hysteresis operator, beside plain Python", "hysteresis: plays"),
    ("A million designs, on two cores", "a study of 1,000,000 designs"),
    ("A motion driven with contact, against real time", "upper tract, .*prism.*"),
)  # fmt: skip
"""What a row is about, without a number, and what finds it among the titles: at most 15."""


def run_benchmarks(names: list[str]) -> list[dict[str, Any]]:
    """Run all files or those named, and return what each has to say, bound kept or not."""
    files = [f"benchmarks/bench_{name}.py" for name in names] or ["benchmarks"]
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "result.json"
        options = ["-o", "addopts=", "-q", "-p", "no:xdist", "--benchmark-only"]
        command = [sys.executable, "-m", "pytest", *options, f"--benchmark-json={result}"]
        code = subprocess.run([*command, *files], cwd=ROOT, check=False).returncode
        if not result.exists() or result.stat().st_size == 0:
            raise SystemExit(f"no benchmark was run (pytest ended with {code})")
        benchmarks = json.loads(result.read_text("utf-8"))["benchmarks"]
    return [{"test": item["fullname"], **item["extra_info"]} for item in benchmarks]


def merge(rows: list[dict[str, Any]], new: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows with those of the benchmarks that ran now in the place of their old ones.

    A benchmark that failed before it had measured takes its row away.
    """
    ran = {row["test"] for row in new} | {row.get("what") for row in new}
    fresh = {row["what"]: {**row, "machine": describe_machine()} for row in new if "what" in row}
    kept = []
    for row in rows:
        if row["what"] in fresh:
            kept.append(fresh.pop(row["what"]))
        elif row["test"] not in ran:
            kept.append(row)
    return [*kept, *fresh.values()]


def describe_machine() -> str:
    """Say what was measured on, the processor as its maker calls it."""
    info = Path("/proc/cpuinfo")
    match = (
        re.search(r"model name\s*:\s*(.+)", info.read_text(encoding="utf-8"))
        if info.exists()
        else None
    )
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba"))
    return (
        f"Measured on {match[1].strip() if match else platform.machine()}, {os.cpu_count()} cores, "
        f"{platform.system()}, Python {platform.python_version()}, {packages}."
    )


def list_table(rows: list[dict[str, Any]]) -> list[str]:
    """Return the table of all rows, in parts by the machine that measured them."""
    lines = []
    for machine in dict.fromkeys(row["machine"] for row in rows):
        own = [row for row in rows if row["machine"] == machine]
        cells = [
            f"| {row['what']} | {row['measured']} | {row.get('required', '')} |" for row in own
        ]
        lines += [machine, "", "| what | measured | required |", "|---|---|---|", *cells, ""]
    late = [row["what"] for row in rows if not row["kept"]]
    lines.append(f"Bounds that were not kept: {'; '.join(late) or 'none'}.")
    return lines


def list_headlines(rows: list[dict[str, Any]]) -> list[str]:
    """Return the short table."""
    chosen = {}
    for message, pattern in HEADLINES:
        found = next((row for row in rows if re.search(pattern, row["what"])), None)
        if found is not None:
            chosen[message] = found
    cells = [f"| {each} | {row['what']} | {row['measured']} |" for each, row in chosen.items()]
    machines = dict.fromkeys(row["machine"] for row in chosen.values())
    return [*machines, "", "| message | case | measured |", "|---|---|---|", *cells]


def list_peers(peers: dict[str, Any]) -> list[str]:
    """Return the table of other packages, with the machine."""
    return [peers["machine"], "", *format_peers(peers)]


def fill(name: str, page: str, measured: dict[str, Any]) -> str:
    """Return a page, by its name from the root, with its numbers as they were measured."""
    for claim in CLAIMS:
        if claim.page == name:
            page = claim.fill(page, measured)
    return page


PAGES = ("README.md", "docs/trust.md", "docs/benchmarks-all.md")
"""What states numbers of the benchmarks."""


def main(names: list[str]) -> None:
    """Measure what is asked for, keep it in `MEASURED`, and write the pages from that."""
    measured = json.loads(MEASURED.read_text("utf-8"))
    wanted = [name for name in names if name not in ("peers", "pages")]
    if wanted or not names:
        measured["rows"] = merge(measured["rows"] if names else [], run_benchmarks(wanted))
    if "peers" in names:
        measured["peers"] = {"machine": describe_machine(), **measure_peers(print)}
    MEASURED.write_text(f"{json.dumps(measured, indent=1, ensure_ascii=False)}\n", "utf-8")
    for name in PAGES:
        page = ROOT / name
        page.write_text(fill(name, page.read_text("utf-8"), measured), "utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])

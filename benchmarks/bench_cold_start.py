"""What the first call of a command costs: processor seconds with an empty cache, and again.

``python -m benchmarks.bench_cold_start [--out table.json] [name ...]`` runs each command in
processes of its own, with a cache of compiled kernels of its own that begins empty. The time that
Numba compiles is counted in another run with an empty cache, so that counting is in no figure.
"""

from __future__ import annotations

import argparse
import compileall
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from bozzini.cli.common import format_rows

ROOT = Path(__file__).resolve().parents[1]
TRACT = ROOT.parent / "shared" / "data" / "upper_gi" / "upper_gi_mc1mm.stl"
ROBOT = str(ROOT / "examples" / "two_sections.yaml")
COMMANDS = {
    "demo": ["demo", "--quiet"],
    "plan": ["plan", str(TRACT), "--diameter", "6mm", "--link", "12mm", "--quiet"],
    "continuum compare": ["continuum", "compare", ROBOT, "--displacement", "T1=2mm"],
    "continuum pose": ["continuum", "pose", ROBOT, "--displacement", "T1=2mm"],
    "effector pose": ["effector", "pose", "--pressure", "R=100psi"],
    "muscle solve": ["muscle", "solve", "--pressure", "100psi"],
}
"""What is run; those that write a folder get one. `plan` needs the human upper tract."""
ENVIRONMENT = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
"""Modules are compiled to byte code once, as pip does when it installs them."""
COUNTED = """
import atexit, json, sys, time
from numba.core import event
spans = []
class Listener(event.Listener):
    depth = 0
    def on_start(self, e):
        self.depth += 1
        if self.depth == 1: self.begin = time.process_time()
    def on_end(self, e):
        spans.append(time.process_time() - self.begin if self.depth == 1 else 0.0)
        self.depth -= 1
event.register("numba:compile", Listener())
atexit.register(lambda: open(sys.argv[1], "w").write(json.dumps([len(spans), sum(spans)])))
from bozzini.__main__ import run
told, sys.argv[1:] = sys.argv[1], sys.argv[2:]
atexit.register(lambda: sys.argv.__setitem__(slice(1, None), [told]))
sys.exit(run())
"""


def time_process(arguments: list[str], cache: Path) -> float:
    """Return the processor seconds of a Python process and its children, beside what it waits."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    errors = os.open(cache / "errors.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    process = os.posix_spawn(
        sys.executable,
        [sys.executable, *arguments],
        {**ENVIRONMENT, "NUMBA_CACHE_DIR": str(cache), "OPENBLAS_NUM_THREADS": "1"},
        file_actions=[(os.POSIX_SPAWN_DUP2, nothing, 1), (os.POSIX_SPAWN_DUP2, errors, 2)],
    )
    _, status, usage = os.wait4(process, 0)
    os.close(nothing)
    os.close(errors)
    if os.waitstatus_to_exitcode(status) not in (0, 1):
        raise SystemExit((cache / "errors.txt").read_text(encoding="utf-8"))
    return usage.ru_utime + usage.ru_stime


def time_command(command: list[str]) -> dict[str, float]:
    """Return the seconds of a command cold, warm and compiling, and how much is compiled."""
    compileall.compile_dir(ROOT / "src", quiet=2)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)

        def run(name: str, begin: list[str], cache: str) -> float:
            (place / cache).mkdir(exist_ok=True)
            writes = command[0] in ("demo", "plan")
            out = ["--out", str(place / name)] if writes else []
            return time_process([*begin, *command, *out], place / cache)

        cold = run("cold", ["-m", "bozzini"], "cache")
        warm = min(run(f"warm{k}", ["-m", "bozzini"], "cache") for k in range(2))
        counted = place / "counted.json"
        run("counted", ["-c", COUNTED, str(counted)], "other")
        count, compiling = json.loads(counted.read_text(encoding="utf-8"))
    return {"cold_s": cold, "warm_s": warm, "compiling_s": compiling, "compilations": count}


def bench_first_plan(benchmark: Any) -> None:
    row = benchmark.pedantic(time_command, args=(COMMANDS["demo"],), rounds=1)
    benchmark.extra_info.update(
        what="cold start: `bozzini demo` with nothing compiled, processor time of the process",
        measured=f"{row['cold_s']:.1f} s (again, compiled: {row['warm_s']:.1f} s)",
        required="under 20 s",
    )
    assert row["cold_s"] < 20.0


def main() -> None:
    """Print the table, and write it where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help=f"of {', '.join(COMMANDS)}")
    parser.add_argument("--out", type=Path, help="a JSON file")
    given = parser.parse_args()
    table = {
        name: time_command(COMMANDS[name])
        for name in given.names or COMMANDS
        if name != "plan" or TRACT.exists()
    }
    columns = ["cold_s", "warm_s", "compiling_s", "compilations"]
    rows = [[name, *(f"{row[key]:.1f}" for key in columns[:3]), f"{row['compilations']:.0f}"]
            for name, row in table.items()]  # fmt: skip
    print(format_rows(["command", "cold [s]", "warm [s]", "compiling [s]", "compilations"], rows))
    if given.out:
        given.out.write_text(json.dumps(table, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

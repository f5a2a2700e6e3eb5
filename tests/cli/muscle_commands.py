"""The commands of ``bozzini muscle`` and ``bozzini effector`` whose answers are kept, in brief.

``python -m tests.cli.muscle_commands FILE`` writes the answers of this version; the test beside
compares them with those in ``muscle_commands.json``.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import shlex
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

COMMANDS = """
muscle solve --preset effector-45 --pressure 100psi --load 1N
muscle solve --preset effector-45 --model thesis --pressure 100psi
muscle solve --preset effector-45 --model thesis --load-path bulk --pressure 100psi --load 1N
muscle solve --pressure 0.6MPa --ends trellis
muscle solve --pressure 0.6MPa --friction-length 20um --direction inflating
muscle solve --pressure 0.6MPa --load 1000N
muscle solve --pressure 0.6MPa --model davis
muscle solve --model kothera-balance --pressure 0.5MPa --load 0.2N
muscle solve --model tondu-lopez --pressure 0.5MPa --set kappa1=0.1 --set kappa2=1
muscle solve --model schulte --pressure 0.5MPa
muscle solve --model thesis --pressure 0.5MPa --load 1N
muscle curve --of force --pressure 700kPa --points 5
muscle curve --of contraction --load 0.5N --points 5
muscle curve --of angle --model thesis --points 5
muscle curve --of phases --points 5
muscle curve --model tondu-lopez --set kappa1=-0.5 --set kappa2=1.2 --points 5
muscle models
muscle models chou
muscle models energy
muscle models nobody
muscle fit data.csv --preset thesis-45 --free modulus,dead-length
muscle fit data.csv --preset thesis-45 --model sangian
muscle fit data.csv --preset thesis-45 --free gap,braid-angle --bound gap=0mm:0.1mm --anyway
muscle compare data.csv --preset thesis-45 --model energy --model thesis
muscle compare data.csv --preset thesis-45 --model energy --model chou --fit
muscle compare data.csv --model energy --model tondu-lopez --fit --by cv --folds 3
effector pose --pressure R=689.4kPa,G=413.6kPa
effector pose --pressure R=689.4kPa,G=413.6kPa --method thesis --order G,R
effector pose --pressure R=689.4kPa --model thesis --load-path bulk --table
effector pose --pressure R=300kPa --model chou
effector pose --pressure Q=1kPa
effector reach --to 12mm,-5mm --beam 2
effector reach --to 3mm,-4mm
effector reach --to 3mm,-4mm --model thesis --load-path bulk
effector reach --to 3mm,-4mm --model gaylord-1
effector reach --to 300mm,0mm
effector workspace
effector workspace --of force --at 2mm,1mm
effector curve --points 7
effector curve --points 7 --cubic-from 250kPa
effector trace circle --radius 8mm --points 12
effector trace line --from 0,0 --to 9mm,3mm --points 5 --cubic-from 250kPa
effector study sweep --vary offset=2.75mm:4mm:3 --vary segments=12,15 --deflection 12mm
effector study least-pressure --between offset=2.75mm:3.5mm --deflection 12mm
effector study sweep --vary muscle.gap=0mm,9mm
"""
"""One command a line; ``--json`` is added."""


def write_data(path: Path) -> None:
    """Write made-up measurements: a smooth contraction with a fixed error."""
    pressure = np.linspace(0.0, 0.8, 20)
    contraction = 9.0 * (1.0 - np.exp(-((pressure / 0.4) ** 2))) + 0.05 * np.sin(37.0 * pressure)
    rows = [f"{p:.6f},{x:.6f}" for p, x in zip(pressure, contraction, strict=True)]
    path.write_text("\n".join(["pressure [MPa],contraction [mm]", *rows, ""]), encoding="utf-8")


def shorten(value: Any) -> Any:
    """Return a JSON value with long lists as their length and three entries, texts cut."""
    if isinstance(value, dict):
        return {key: shorten(item) for key, item in value.items()}
    if isinstance(value, list):
        if len(value) > 8:
            picked = (0, len(value) // 2, len(value) - 1)
            return [len(value), *(shorten(value[place]) for place in picked)]
        return [shorten(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.9g}")
    if isinstance(value, str):
        return value[:40]
    return value


def run(line: str) -> dict[str, Any]:
    """Return exit code and shortened answer of a command."""
    from bozzini.cli.main import main

    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([*shlex.split(line), "--json"])
    text = out.getvalue()
    return {"exit": code, "answer": shorten(json.loads(text)) if text else None}


def run_all() -> dict[str, Any]:
    """Return the answers of all commands, run in a folder of its own."""
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            write_data(Path("data.csv"))
            return {line: run(line) for line in COMMANDS.strip().splitlines()}
        finally:
            os.chdir(here)


if __name__ == "__main__":
    target = Path(sys.argv[1]).resolve()
    lines = [f"{json.dumps(line)}: {json.dumps(kept)}" for line, kept in run_all().items()]
    target.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")

"""A muscle characterised by rendered pictures: how far its constants are off the true ones."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.muscle import preset, read_muscle
from bozzini.rig.firmware import find_missing_tools

SEEDS = 10


@pytest.mark.timeout(3000)
@pytest.mark.skipif(
    bool(find_missing_tools()), reason=f"missing: {', '.join(find_missing_tools())}"
)
def bench_constants_from_pictures(benchmark: Any, tmp_path: Path, capsys: Any) -> None:
    errors, inside = [], []

    def run() -> None:
        for seed in range(SEEDS):
            draw = np.random.default_rng(seed)
            true = preset(
                "effector-45",
                modulus=float(draw.uniform(0.25, 0.6)),
                braid_angle=math.radians(draw.uniform(32.0, 38.0)),
            )
            out = tmp_path / f"{seed}.csv"
            command = ["rig", "characterise", "--camera", "rendered", "--weights", "0.05N,0.15N"]
            command += ["--steps", "4", "--repeats", "2", "--hold", "1s", "--board", "native"]
            command += [
                "--modulus",
                f"{true.modulus}MPa",
                "--braid-angle",
                f"{true.braid_angle}rad",
            ]
            command += ["--seed", str(seed), "--quiet", "--json", "--out", str(out)]
            assert main(command) == 0
            intervals = json.loads(capsys.readouterr().out)["intervals_95"]
            found = read_muscle(out.with_name(f"{seed}-fit.yaml")).muscle
            errors.append(
                (
                    found.modulus / true.modulus - 1.0,
                    found.braid.strand_length / true.braid.strand_length - 1.0,
                )
            )
            truth = {"modulus": true.modulus, "braid_angle": true.braid_angle}
            inside.append(
                [low <= truth[n] <= high for n, (low, high) in intervals.items() if n in truth]
            )

    benchmark.pedantic(run, rounds=1)
    modulus, strand = np.abs(errors).max(axis=0)
    benchmark.extra_info.update(
        what=f"muscle from rendered pictures, {SEEDS} set-ups: largest error",
        measured=f"modulus {100 * modulus:.2f} %, strand length {100 * strand:.2f} %; intervals "
        f"hold the truth in {np.mean(inside, axis=0).tolist()} of them",
        required="3 % each",
    )
    assert max(modulus, strand) <= 0.03

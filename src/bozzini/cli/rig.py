"""``bozzini rig``: the pneumatic rig; constants of the plant from measured curves."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .common import (
    EXIT_NEGATIVE,
    PICTURES,
    Answer,
    QuantityType,
    answer_options,
    format_rows,
    run_exit,
)

if TYPE_CHECKING:
    from ..rig.identify import CurveFit, Identification


@click.group("rig")
def command() -> None:
    """Identify the constants of a pneumatic rig from measured curves of pressure."""


@command.command("identify")
@click.argument(
    "files", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option(
    "--check",
    "checked",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A curve to check: the rest of it is predicted from its beginning; can be repeated.",
)
@click.option(
    "--share",
    type=float,
    help="Share of the change up to which a checked curve is used, 0.3 to 0.89 (default: 0.8).",
)
@click.option(
    "--unit",
    help="Unit of pressures in files that state none, such as kPa, or count (default: count for "
    "whole numbers, otherwise kPa).",
)
@click.option(
    "--supply",
    type=QuantityType("pressure"),
    help="Gauge pressure that the highest count stands for.",
    default="0.62MPa",
    show_default=True,
)
@answer_options(".csv", *PICTURES, quiet=False, help="A table (.csv) or a picture.")
def identify_command(
    files: tuple[Path, ...],
    checked: tuple[Path, ...],
    share: float | None,
    unit: str | None,
    supply: float,
    answer: Answer,
) -> None:
    """Find the law by which muscles fill, or leak, and its constants.

    FILE is a .mat file with a matrix 'data', or a .csv file; its columns are time, (valve,)
    pressure. Curves that rise are fills, others leaks. The laws of a fill are an orifice, one
    behind a regulator or a line that resists, the same with the transducer before the orifice, and
    the second with a volume that grows; of a leak an orifice or a narrow gap.

    Exit code 0: a law describes each curve within 3 % of its change; 1: not; 2: bad input.
    """
    from ..errors import InputError
    from ..rig.curves import read_curve
    from ..rig.identify import CHECK_SHARE, find_kind, identify_fill, identify_leak

    if share is not None and not checked:
        raise InputError("--share has no effect without --check: leave it out")
    curves = [read_curve(path, unit=unit, supply=supply) for path in files]
    others = [read_curve(path, unit=unit, supply=supply) for path in checked]
    kinds = {
        path: find_kind(c) for path, c in zip((*files, *checked), curves + others, strict=True)
    }
    kind = kinds[files[0]]
    for path, other in kinds.items():
        if other != kind:
            raise InputError(f"{path} is a {other}, {files[0]} a {kind}: give files of one kind")
    found = (identify_fill if kind == "fill" else identify_leak)(curves)
    if others:
        found = found.check(others, share=CHECK_SHARE if share is None else share)
    answer.write(found.list_columns(), found.plot)
    result = {
        "kind": found.kind,
        "converged": found.converged,
        "reason": found.reason,
        "residual_MPa": found.residual,
        "worst_time_error": found.worst_time_error,
        "fits": [_describe(fit) for fit in found.fits],
        "checks": [_describe(fit) for fit in found.checks],
        "notes": found.notes,
        "file": answer.out,
    }
    answer.give(result, _format(found))
    if not found.converged:
        run_exit(EXIT_NEGATIVE)


def _describe(fit: CurveFit) -> dict[str, object]:
    return {
        **fit.list_row(),
        "standard_errors": fit.standard_errors,
        "undetermined": fit.undetermined,
    }


def _format(found: Identification) -> str:
    head = ["curve", "law", "residual [kPa]", "t90 measured [s]", "by the law [s]", "error"]
    head += ["time constant [s]"]
    rows = [
        [
            fit.curve.name + (f" (check, to {100 * fit.used:g} %)" if fit.used < 1.0 else ""),
            fit.law,
            f"{1e3 * fit.residual:.1f}",
            f"{fit.measured_time:.4g}",
            f"{fit.model_time:.4g}",
            f"{100 * fit.time_error:+.1f} %",
            f"{fit.constants['time constant']:.4g}",
        ]
        for fit in (*found.fits, *found.checks)
    ]
    lines = [f"{found.kind}: t90 is the time from 5 to 90 % of the change", format_rows(head, rows)]
    lines += [
        f"{fit.curve.name}: not determined: {', '.join(fit.undetermined)}"
        for fit in found.fits
        if fit.undetermined
    ]
    lines += [f"note: {note}" for note in found.notes]
    lines += [f"warning: {text}" for text in found.reason.split("; ") if text]
    return "\n".join(lines)

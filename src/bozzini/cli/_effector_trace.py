"""``bozzini effector trace``: the tip along a line or round a circle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ._effector_options import describe_design, effector_options, make_effector, tell
from ._tables import PICTURES, check_target, format_csv
from .common import (
    EXIT_NEGATIVE,
    QuantityType,
    VectorType,
    force_option,
    json_option,
    run_exit,
)

if TYPE_CHECKING:
    from ..effector import CubicFit, Effector, Trace

__all__ = ["trace_command"]

_PLACE = VectorType("length", size=2)

cubic_option = click.option(
    "--cubic-from",
    type=QuantityType("pressure"),
    help="Pressures from a cubic fitted from this pressure on, as in the thesis's controller.",
)
out_option = click.option(
    "--out", type=click.Path(path_type=Path), metavar="FILE", help="A table (.csv) or a picture."
)


@click.group("trace")
def trace_command() -> None:
    """Follow a line or a circle with the tip, seen along the axis.

    Exit code 0: all of it; 1: parts are out of reach or not solved; 2: bad input.
    """


@trace_command.command("line")
@click.option("--from", "start", type=_PLACE, metavar="X,Y", required=True, help="Where it begins.")
@click.option("--to", "end", type=_PLACE, metavar="X,Y", required=True, help="Where it ends.")
@click.option("--points", default=51, show_default=True, help="Targets, both ends included.")
@cubic_option
@out_option
@effector_options
@force_option
@json_option
def line_command(
    start: tuple[float, ...],
    end: tuple[float, ...],
    points: int,
    cubic_from: float | None,
    out: Path | None,
    given: Mapping[str, Any],
    force: bool,
    as_json: bool,
) -> None:
    """Follow a straight line."""
    from ..effector import trace_line

    check_target(out, (".csv", *PICTURES), force=force)
    _check_points(points, low=2)
    effector = make_effector(given)
    found = trace_line(effector, start, end, steps=points, cubics=_fit(effector, cubic_from))
    _show(effector, found, given, out, as_json)


@trace_command.command("circle")
@click.option("--radius", type=QuantityType("length"), required=True, help="Radius.")
@click.option(
    "--centre", type=_PLACE, metavar="X,Y", default="0,0", show_default=True, help="Centre."
)
@click.option(
    "--points",
    default=72,
    show_default=True,
    help="Targets round the circle; the first comes again at the end, to close it.",
)
@cubic_option
@out_option
@effector_options
@force_option
@json_option
def circle_command(
    radius: float,
    centre: tuple[float, ...],
    points: int,
    cubic_from: float | None,
    out: Path | None,
    given: Mapping[str, Any],
    force: bool,
    as_json: bool,
) -> None:
    """Follow a circle, from +x counter-clockwise."""
    from ..effector import trace_circle

    check_target(out, (".csv", *PICTURES), force=force)
    _check_points(points, low=3)
    effector = make_effector(given)
    found = trace_circle(
        effector, radius, centre=centre, steps=points, cubics=_fit(effector, cubic_from)
    )
    _show(effector, found, given, out, as_json)


def _check_points(points: int, *, low: int) -> None:
    from ..checks import check_integer

    check_integer("points", points, low=low, high=100_000)


def _fit(effector: Effector, cubic_from: float | None) -> dict[str, CubicFit] | None:
    from ..effector import fit_cubic

    if cubic_from is None:
        return None
    return {name: fit_cubic(effector, name, start=cubic_from) for name in effector.design.names}


def _show(
    effector: Effector, found: Trace, given: Mapping[str, Any], out: Path | None, as_json: bool
) -> None:
    from ..files import write_text

    names = effector.design.names
    columns = {
        "target_x_mm": found.targets[:, 0],
        "target_y_mm": found.targets[:, 1],
        **{f"pressure_{name}_MPa": found.pressures[:, k] for k, name in enumerate(names)},
        "achieved_x_mm": found.achieved[:, 0],
        "achieved_y_mm": found.achieved[:, 1],
        "error_mm": found.error,
        "reachable": found.reachable,
    }
    table = format_csv(columns)
    count, reached = len(found.targets), int(found.reachable.sum())
    text = table.rstrip("\n")
    if out is not None:
        text = (
            f"{out}: {reached} of {count} targets in reach, largest error there "
            f"{found.reachable_error:.3g} mm"
        )
        if out.suffix.lower() == ".csv":
            write_text(out, table)
        else:
            from ..effector import workspace
            from ..view import write_figure
            from ..view.effector_figures import draw_trace

            outline = workspace(effector).boundary
            write_figure(draw_trace(found, names, outline=outline), out)
    result = {
        "kind": found.kind,
        "pressure_map": found.pressure_map,
        "model": given["model_name"],
        "targets": count,
        "reachable": reached,
        "complete": found.complete,
        "converged": bool(found.converged.all()),
        "largest_error_mm": found.reachable_error,
        "largest_distance_mm": found.largest_error,
        "columns": columns,
        "design": describe_design(effector.design),
        "file": out,
    }
    notes = []
    if not found.complete:
        notes.append(
            f"{count - reached} of {count} targets are out of reach, the farthest by "
            f"{found.largest_error:.3g} mm"
        )
    if not found.converged.all():
        notes.append(f"not converged at {int((~found.converged).sum())} of {count} targets")
    tell(result, as_json=as_json, text=text, notes=notes)
    if not (found.complete and found.converged.all()):
        run_exit(EXIT_NEGATIVE)

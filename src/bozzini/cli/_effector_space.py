"""``bozzini effector workspace`` and ``curve``: what the tip can reach, and each muscle's curve."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError
from ._effector_options import describe_design, effector_options, make_effector, tell
from ._tables import PICTURES, check_target, format_csv, format_rows
from .common import (
    EXIT_NEGATIVE,
    QuantityType,
    VectorType,
    force_option,
    json_option,
    run_exit,
)

if TYPE_CHECKING:
    from ..effector import Balance, Effector, Workspace

__all__ = ["curve_command", "workspace_command"]

out_option = click.option(
    "--out", type=click.Path(path_type=Path), metavar="FILE", help="A table (.csv) or a picture."
)


@click.command("workspace")
@click.option(
    "--of",
    "kind",
    type=click.Choice(["place", "force"]),
    default="place",
    show_default=True,
    help="Where the tip can go, or how hard it can press in each direction.",
)
@click.option(
    "--at",
    type=VectorType("length", size=2),
    metavar="X,Y",
    help="With --of force: where something holds the tip (default: 0,0).",
)
@out_option
@effector_options
@force_option
@json_option
def workspace_command(
    kind: str,
    at: tuple[float, ...] | None,
    out: Path | None,
    given: Mapping[str, Any],
    force: bool,
    as_json: bool,
) -> None:
    """Find where the tip can go, and what it can press with.

    The table has the boundary, seen along the axis and in space, or the force over the direction.

    Exit code 0: done; 1: the tip cannot be at --at; 2: bad input.
    """
    if at is not None and kind != "force":
        raise InputError("--at has no effect without --of force: leave it out")
    check_target(out, (".csv", *PICTURES), force=force)
    effector = make_effector(given)
    if kind == "force":
        result, text = _find_force(effector, at or (0.0, 0.0), out)
    else:
        result, text = _find_places(effector, out)
    result |= {"model": given["model_name"], "design": describe_design(effector.design)}
    found = bool(result.get("reachable", True))
    tell(result | {"of": kind, "file": out if found else None}, as_json=as_json, text=text)
    if not found:
        run_exit(EXIT_NEGATIVE)


@click.command("curve")
@click.option("--points", default=84, show_default=True, help="Rows of the table.")
@click.option(
    "--cubic-from",
    type=QuantityType("pressure"),
    help="Fit the thesis's cubic from this pressure on, and show how far it is off.",
)
@out_option
@effector_options
@force_option
@json_option
def curve_command(
    points: int,
    cubic_from: float | None,
    out: Path | None,
    given: Mapping[str, Any],
    force: bool,
    as_json: bool,
) -> None:
    """Compute the deflection by each muscle alone over its pressure.

    The table goes to stdout, unless --out names a file. Where the backbone is at its largest
    deflection the curve is flat: the column saturated is 1 there, and a note says from where on.

    Exit code 0: done; 1: an equilibrium was not found; 2: bad input.
    """
    import numpy as np

    from ..checks import check_integer
    from ..effector import balance, fit_cubic
    from ..files import write_text

    check_target(out, (".csv", *PICTURES), force=force)
    check_integer("points", points, low=2, high=100_000)
    effector = make_effector(given)
    names = effector.design.names
    over = np.linspace(0.0, effector.design.pressure_limit, points)
    found = {name: balance(effector, name, over) for name in names}
    columns: dict[str, Any] = {"pressure_MPa": over}
    for name in names:
        columns[f"deflection_{name}_mm"] = found[name].lateral
        columns[f"contraction_{name}_mm"] = found[name].contraction
        columns[f"force_{name}_N"] = found[name].force
        columns[f"saturated_{name}"] = found[name].saturated
    notes, solved = _judge_curves(found)
    cubics = {}
    if cubic_from is not None:
        cubics = {name: fit_cubic(effector, name, start=cubic_from) for name in names}
    table = format_csv(columns)
    lines = [
        f"cubic of {name} from {1e3 * fit.start:g} kPa: {fit.rms_error:.3f} mm rms, "
        f"{fit.largest_error:.3f} mm at most"
        + (f"; fitted up to {1e3 * fit.limit:.4g} kPa, flat beyond" if fit.saturated else "")
        + ("" if fit.monotone else "; falls in places")
        for name, fit in cubics.items()
    ]
    if out is None:
        lines = [table.rstrip("\n"), *(f"# {line}" for line in lines)]
    elif out.suffix.lower() == ".csv":
        write_text(out, table)
    else:
        from ..view import write_figure
        from ..view.effector_figures import draw_deflection

        write_figure(draw_deflection(effector, cubics=cubics), out)
    if out is not None:
        lines.insert(0, f"{out}: deflection over pressure, {points} points")
    result = {
        "model": given["model_name"],
        "columns": columns,
        "cubics": {
            name: {
                "coefficients": fit.coefficients,
                "from_MPa": fit.start,
                "to_MPa": fit.limit,
                "saturated": fit.saturated,
                "rms_error_mm": fit.rms_error,
                "largest_error_mm": fit.largest_error,
                "monotone": fit.monotone,
            }
            for name, fit in cubics.items()
        },
        "design": describe_design(effector.design),
        "file": out,
    }
    tell(result, as_json=as_json, text="\n".join(lines), notes=notes)
    if not solved:
        run_exit(EXIT_NEGATIVE)


def _judge_curves(found: Mapping[str, Balance]) -> tuple[list[str], bool]:
    """Return what there is to say of curves, and whether every equilibrium was found."""
    notes, solved = [], True
    for name, curve in found.items():
        lost = curve.saturated | ~curve.converged
        for which in (curve.saturated, lost & ~curve.saturated):
            if which.any():
                first = int(which.argmax())
                over = 1e3 * float(curve.pressure[first])
                notes.append(f"muscle {name} from {over:.4g} kPa on: {curve.reason[first]}")
        solved &= not bool((lost & ~curve.saturated).any())
    return notes, solved


def _find_places(effector: Effector, out: Path | None) -> tuple[dict[str, Any], str]:
    from ..effector import workspace

    found = workspace(effector)
    if out is not None:
        _write_places(effector, found, out)
    names, amplitudes = effector.design.names, found.reach.amplitudes
    result = {
        "amplitudes_mm": dict(zip(names, amplitudes.tolist(), strict=True)),
        "saturated": dict(zip(names, found.reach.saturated.tolist(), strict=True)),
        "largest_deflection_mm": found.reach.peak,
        "inner_radius_mm": found.inner_radius,
        "outer_radius_mm": found.outer_radius,
        "area_mm2": found.area,
        "tip_area_mm2": found.tip_area,
        "gaps": found.reach.sectors.describe_gaps(effector.design.names),
        "boundary_mm": found.boundary,
        "boundary_tip_mm": found.boundary_tip,
        "boundary_holder_tip_mm": found.boundary_holder_tip,
    }
    lines = [
        f"in every direction {found.inner_radius:.2f} mm, at most {found.outer_radius:.2f} mm; "
        f"{found.area:.1f} mm^2 seen along the axis, {found.tip_area:.1f} mm^2 in space",
        format_rows(
            ["muscle", "alone [mm]", "towards [deg]"],
            [
                [name, f"{amplitudes[k]:.2f}", f"{math.degrees(placed.angle):.1f}"]
                for k, (name, placed) in enumerate(zip(names, effector.design.muscles, strict=True))
            ],
        ),
    ]
    full = [name for k, name in enumerate(names) if found.reach.saturated[k]]
    if full:
        lines.append(
            f"saturated: {', '.join(full)} could go on, but the backbone is at "
            f"{found.reach.peak:.4g} mm, {found.reach.peak_reason}"
        )
    if result["gaps"]:
        lines.append(f"not reached: {result['gaps']}")
    return result, "\n".join(lines)


def _write_places(effector: Effector, found: Workspace, out: Path) -> None:
    from ..files import write_text

    if out.suffix.lower() != ".csv":
        from ..view import write_figure
        from ..view.effector_figures import draw_workspace

        write_figure(draw_workspace(effector, found), out)
        return
    columns = {"x_mm": found.boundary[:, 0], "y_mm": found.boundary[:, 1]}
    for name, points in (("tip", found.boundary_tip), ("holder_tip", found.boundary_holder_tip)):
        columns |= {f"{name}_{axis}_mm": points[:, k] for k, axis in enumerate("xyz")}
    write_text(out, format_csv(columns))


def _find_force(
    effector: Effector, at: tuple[float, ...], out: Path | None
) -> tuple[dict[str, Any], str]:
    import numpy as np

    from ..effector import passive_stiffness, solve_inverse, tip_force, tip_stiffness
    from ..files import write_text

    held = solve_inverse(effector, at)
    if not bool(held.reachable):
        text = f"the tip cannot be at {at[0]:g}, {at[1]:g} mm: {held.reason}"
        return {"at_mm": at, "reachable": False, "reason": str(held.reason)}, text
    angle = np.radians(np.arange(360.0))
    toward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = tip_force(effector, toward, lateral=at)
    stiffness = tip_stiffness(effector, held.pressures)
    passive = passive_stiffness(effector.design)
    if out is not None and out.suffix.lower() == ".csv":
        write_text(out, format_csv({"direction_rad": angle, "force_N": found.force}))
    elif out is not None:
        from ..view import write_figure
        from ..view.effector_figures import draw_force

        write_figure(draw_force(effector, lateral=at), out)
    names = effector.design.names
    result = {
        "at_mm": at,
        "reachable": True,
        "direction_rad": angle,
        "force_N": found.force,
        "pulls_N": dict(zip(names, found.pulls.tolist(), strict=True)),
        "stiffness_N_per_mm": stiffness,
        "passive_stiffness_N_per_mm": passive,
    }
    low, high = int(np.argmin(found.force)), int(np.argmax(found.force))
    text = (
        f"held at {at[0]:g}, {at[1]:g} mm the tip presses with {found.force[low]:.3f} N "
        f"(towards {low} deg) to {found.force[high]:.3f} N (towards {high} deg); "
        f"stiffness without pressure {passive:.4g} N/mm"
    )
    return result, text

"""A shape in words and as plain values."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ._tables import format_rows

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..continuum import ContinuumRobot, Shape

__all__ = ["describe_shape", "find_fault", "format_bends", "format_shape", "list_bends"]

STRAIGHT = 1e-6
"""Bend that counts as none in words [rad]."""


def find_fault(shape: Shape) -> str:
    """Return why a shape is none, in the model's words; else empty."""
    return "" if bool(shape.converged) else str(shape.reason)


def describe_shape(
    robot: ContinuumRobot, displacements: NDArray[np.float64], shape: Shape | None, reason: str
) -> dict[str, Any]:
    """Return a shape as plain values; without its places if there is a reason against it."""
    good = shape is not None and not reason
    result: dict[str, Any] = {"converged": good, "reason": reason}
    tendons: dict[str, dict[str, Any]] = {
        name: {"displacement_mm": displacements[k]} for k, name in enumerate(robot.tendon_names)
    }
    if shape is not None and good:
        for k, row in enumerate(tendons.values()):
            row["length_mm"] = shape.tendon_lengths[k]
            row["slack"] = bool(shape.slack[k])
            row["tension_N"] = shape.tensions[k] if shape.tensions.size else None
        result |= {
            "tip_mm": shape.tip,
            "tip_direction": shape.tip_frame[:3, 2],
            "tip_frame": shape.tip_frame,
            "residual_mm": shape.residual,
            "iterations": shape.iterations,
            "sections": list_bends(robot, shape.section_parameters),
            "arc_length_mm": shape.arc_length,
            "backbone_mm": shape.points,
        }
    return result | {"tendons": tendons}


def list_bends(robot: ContinuumRobot, bends: NDArray[np.float64]) -> list[dict[str, Any]]:
    """Return the bends of sections, shape (m, 2) or (0, 2), as plain values."""
    return [
        {
            "name": robot.sections[k].name,
            "bend_rad": math.hypot(x, y),
            "direction_rad": math.atan2(y, x),
        }
        for k, (x, y) in enumerate(bends.tolist())
    ]


def format_bends(robot: ContinuumRobot, bends: NDArray[np.float64]) -> str:
    """Return the bends of sections for people; a straight one has no direction."""
    rows = []
    for k, row in enumerate(list_bends(robot, bends)):
        angle, towards = math.degrees(row["bend_rad"]), math.degrees(row["direction_rad"])
        told = f"{towards:z.2f}" if row["bend_rad"] > STRAIGHT else "-"
        rows.append([robot.section_label(k), f"{angle:z.2f}", told])
    return format_rows(["section", "bend [deg]", "towards [deg]"], rows)


def format_shape(shape: Shape) -> str:
    """Return a shape for people: tip, sections, tendons."""
    robot = shape.robot
    place = ", ".join(f"{value:z.3f}" for value in shape.tip)
    tangent = shape.tip_frame[:3, 2]
    aside = math.degrees(math.atan2(math.hypot(tangent[0], tangent[1]), tangent[2]))
    lines = [f"tip at {place} mm, looking {aside:.2f} deg away from the base's axis"]
    if len(shape.section_parameters):
        lines.append(format_bends(robot, shape.section_parameters))
    head = ["tendon", "displacement [mm]", "length [mm]"]
    if shape.tensions.size:
        head.append("tension [N]")
    rows = []
    for k, name in enumerate(robot.tendon_names):
        row = [name, f"{shape.displacements[k]:z.4f}", f"{shape.tendon_lengths[k]:.3f}"]
        if shape.tensions.size:
            row.append("slack" if shape.slack[k] else f"{shape.tensions[k]:z.4f}")
        elif shape.slack[k]:
            row.append("slack")
        rows.append(row)
    width = max(map(len, [head, *rows]))
    head += [""] * (width - len(head))
    rows = [row + [""] * (width - len(row)) for row in rows]
    lines.append(format_rows(head, rows))
    return "\n".join(lines)

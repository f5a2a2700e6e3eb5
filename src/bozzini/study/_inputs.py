"""What can be said about the inputs of the main job at once, before any long work."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..anatomy.findings import Finding
from ..anatomy.tract import LabelTract, SurfaceTract
from ..checks import check_number, check_points
from ..duct import Centreline
from ..duct.build import INFLATION_MAX
from ..errors import GeometryError, InputError
from ..motion import Scope
from ..motion.insertion import check_options as check_planner_options

__all__ = ["check_options", "describe_end", "explain_scale", "find_branches", "sort_ends"]

End = ArrayLike | int | None
"""An end of the centreline: a point (3,) [mm], a label, or None to find it."""


def check_options(
    *,
    scope: Scope,
    voxel: float | None,
    inflate: float,
    method: str,
    head_step: float,
    slip: float,
    angle_limit: float | None,
    route: Sequence[float],
    soft_wall: float,
) -> None:
    """Raise `InputError` for any option that is not legal for every tract."""
    check_number("inflation", inflate, low=0.0, high=INFLATION_MAX, unit="mm")
    if voxel is not None:
        check_number("voxel", voxel, low=0.0, low_open=True, unit="mm")
    check_planner_options(
        scope=scope,
        method=method,
        head_step=head_step,
        slip=slip,
        angle_limit=angle_limit,
        route=route,
    )
    check_number("soft wall", soft_wall, low=0.0, high=100.0, unit="mm")


def sort_ends(
    tract: LabelTract | SurfaceTract, start: End, end: End
) -> tuple[
    tuple[ArrayLike | None, ArrayLike | None],
    tuple[NDArray[np.float64] | None, NDArray[np.float64] | None],
]:
    """Split the ends into points and label regions (world points of the voxels)."""
    points: list[ArrayLike | None] = [None, None]
    regions: list[NDArray[np.float64] | None] = [None, None]
    for k, (name, chosen) in enumerate((("start", start), ("end", end))):
        if chosen is None:
            continue
        if isinstance(chosen, (bool, np.bool_)):
            raise InputError(
                f"{name} is {bool(chosen)}: it must be a point (x, y, z) in mm, or the number of "
                "a label"
            )
        if isinstance(chosen, Integral):
            regions[k] = _find_label(tract, name, int(chosen))
            continue
        point = check_points(name, chosen)
        if point.shape != (3,):
            raise InputError(f"{name} has shape {point.shape}: it must be (3,)")
        points[k] = point
    return (points[0], points[1]), (regions[0], regions[1])


def describe_end(chosen: End) -> Any:
    """Return an end as JSON-able values."""
    return int(chosen) if isinstance(chosen, Integral) else np.asarray(chosen).tolist()


def _find_label(tract: LabelTract | SurfaceTract, name: str, label: int) -> NDArray[np.float64]:
    if not isinstance(tract, LabelTract):
        raise InputError(f"{name} is label {label}, but a surface has no labels: give a point")
    there = tract.label_values
    if label not in there:
        raise InputError(
            f"{name} is label {label}, which is not in the lumen: it must be one of "
            f"{', '.join(str(v) for v in there)}"
        )
    voxels = np.argwhere(tract.labels == label)
    return np.asarray(voxels @ tract.affine[:3, :3].T + tract.affine[:3, 3])


def find_branches(line: Centreline) -> tuple[Finding, ...]:
    """Return a warning for every other end that the centreline could have had."""
    found = []
    for other in line.other_ends:
        place = ", ".join(f"{value:.0f}" for value in other.point)
        opposite = "start" if other.end == "end" else "end"
        message = (
            f"another end was found near ({place}) mm, about {other.distance:.0f} mm from the "
            f"{opposite}: give --{other.end} to choose"
        )
        found.append(Finding("branches", "warning", message))
    return tuple(found)


@contextmanager
def explain_scale(tract: LabelTract | SurfaceTract) -> Iterator[None]:
    """Add to an `InputError` that the tract's size is implausible, where that was found."""
    try:
        yield
    except InputError as error:
        scale = [item.message for item in tract.findings if item.code == "scale"]
        if not scale:
            raise
        kind = GeometryError if isinstance(error, GeometryError) else InputError
        raise kind(f"{error}; {scale[0]}") from error

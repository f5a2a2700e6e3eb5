"""What can be said about the inputs of the main job at once, before any long work."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from ..anatomy.tract import LabelTract, SurfaceTract
from ..checks import check_number
from ..duct.build import INFLATION_MAX
from ..errors import GeometryError, InputError
from ..motion import Scope
from ..motion.plan import PlannerOptions
from ..motion.planner import make_planner

__all__ = ["check_field_options", "check_options", "explain_scale"]

VOXEL_MIN = 0.01
"""Finest grid [mm]: a hundredth of the smallest tract."""


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
    label_error: float | None = None,
) -> None:
    """Raise `InputError` for any option that is not legal for every tract."""
    check_field_options(voxel=voxel, inflate=inflate)
    options = PlannerOptions(
        head_step=head_step, slip=slip, angle_limit=angle_limit, route=tuple(route)
    )
    make_planner(method).check(scope, options)
    check_number("soft wall", soft_wall, low=0.0, high=100.0, unit="mm")
    if label_error is not None:
        check_number("label error", label_error, low=0.0, high=100.0, unit="mm")


def check_field_options(*, voxel: float | None, inflate: float) -> None:
    """Raise `InputError` for an option of the distance field that is not legal for every tract."""
    check_number("inflation", inflate, low=0.0, high=INFLATION_MAX, unit="mm")
    if voxel is not None:
        check_number("voxel", voxel, low=VOXEL_MIN, unit="mm")


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

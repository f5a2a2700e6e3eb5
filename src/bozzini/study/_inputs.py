"""What can be said about the inputs of the main job at once, before any long work."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from ..anatomy.tract import LabelTract, SurfaceTract
from ..checks import check_number
from ..duct.build import INFLATION_MAX
from ..errors import GeometryError, InputError
from ..motion import Scope
from ..motion.insertion import check_options as check_planner_options

__all__ = ["check_options", "explain_scale"]


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

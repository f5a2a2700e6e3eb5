"""What a file of a volume states twice: places, voxel sizes and units, compared with each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .frame import compare_affines, rescale
from .tract import Finding

SAME_SHARE = 0.1
"""Distance of a voxel's two places, by the smallest voxel size, that is rounding."""

SAME_SPACING = 0.01
"""Difference of two statements of one voxel size, by it, that is rounding."""


def report_unit(unit: str, scale: float) -> list[Finding]:
    """Return a note on the unit of a file [mm], where it is not mm."""
    if unit == "unknown":
        message = "the file states no unit of length: taken as mm"
        return [Finding("unit-unknown", "note", message)]
    if scale == 1.0:
        return []
    return [Finding("unit-converted", "note", f"the file is in {unit}: converted to mm")]


def _is_regular(affine: NDArray[np.float64]) -> bool:
    return bool(np.isfinite(affine).all()) and abs(float(np.linalg.det(affine[:3, :3]))) > 1e-12


def compare_places(
    what: str,
    affine: NDArray[np.float64],
    other: NDArray[np.float64],
    shape: tuple[int, ...],
    frame: str | None,
    *,
    taken: str,
) -> list[Finding]:
    """Warn where two statements on where voxels lie differ, by how much, and which is taken."""
    if not all(map(_is_regular, (affine, other))):
        if not _is_regular(affine):
            return []  # it is refused by itself
        message = f"{what} differ: one of them is damaged; {taken} is taken"
        return [Finding("affines-differ", "warning", message)]
    gap = compare_affines(affine, other, shape, frame=frame)
    if gap.farthest <= SAME_SHARE * float(np.linalg.norm(affine[:3, :3], axis=0).min()):
        return []
    return [Finding("affines-differ", "warning", f"{what} differ {gap}: {taken} is taken")]


def compare_spacing(
    what: str,
    taken: str,
    affine: NDArray[np.float64],
    spacing: NDArray[np.float64],
    shape: tuple[int, ...],
) -> list[Finding]:
    """Warn where a file states other voxel sizes beside its axes; 0 or NaN states none."""
    sizes = np.linalg.norm(affine[:3, :3], axis=0)
    stated = np.where(np.isfinite(spacing) & (spacing != 0.0), np.abs(spacing), sizes)
    if (np.abs(stated - sizes) <= SAME_SPACING * sizes).all() or not (sizes > 0.0).all():
        return []
    words = [" x ".join(f"{size:.4g}" for size in each) for each in (stated, sizes)]
    text = f"{what} ({words[0]} mm) and {taken} ({words[1]} mm)"
    return compare_places(text, affine, rescale(affine, stated), shape, None, taken=taken)

"""From a tract to shapes that stand for it, and to sections across it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

from ..anatomy.tract import Finding, LabelTract, SurfaceTract
from ..checks import check_number
from ..duct import Centreline, SampledField, build_field
from ..duct.fitting.fit import FitOptions, FittedDuct, Kind, fit_duct, mesh_from_tract
from ..duct.fitting.measure import PERCENTS, SectionCircles, Sections, cut_sections
from ..duct.shapes.mesh import TriangleMesh
from ..progress import Progress, no_progress
from .ends import End, Way, find_way, resolve_places
from .inputs import explain_scale

__all__ = ["SPACING_MIN", "FitStudy", "SectionStudy", "run_fit", "run_sections"]

SPACING_MIN = 0.01
"""Sections are not cut closer together than this [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FitStudy:
    """Shapes fitted to a tract.

    Parameters
    ----------
    mesh : TriangleMesh
        The true wall: triangles of a surface, or faces of voxels.
    field : SampledField
        The same, sampled.
    line : Centreline
    fitted : FittedDuct
    findings : tuple of Finding
    """

    mesh: TriangleMesh
    field: SampledField
    line: Centreline
    fitted: FittedDuct
    findings: tuple[Finding, ...] = ()

    def summarise(self) -> dict[str, Any]:
        """Return JSON-able values."""
        fitted, report = self.fitted, self.fitted.report
        return {
            "kind": fitted.options.kind,
            "pieces": report.pieces,
            "inside": fitted.options.inside,
            "max_error_mm": fitted.options.max_error,
            "reached": fitted.converged,
            "reason": fitted.reason,
            "outside_found_mm": report.outside,
            "outside_proved_mm": report.outside_bound,
            "outside_place_mm": report.outside_place.tolist(),
            "volume_true_mm3": report.volume_true,
            "volume_fitted_mm3": report.volume_fitted,
            "volume_kept_mm3": report.volume_kept,
            "volume_lost_mm3": report.volume_lost,
            "volume_gained_mm3": report.volume_gained,
            "volume_error_mm3": report.volume_error,
            "kept": report.kept,
            "percents": list(PERCENTS),
            "wall_farther_mm": report.wall.tolist(),
            "room_loss_mm": report.room_loss.tolist(),
            "room_loss_place_mm": report.room_loss_place,
            "centreline_length_mm": self.line.length,
            "wall": self.mesh.wall,
            "wall_error_mm": self.mesh.wall_error,
            "inflation_mm": self.mesh.inflation,
            "findings": _list_findings(self.findings),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class SectionStudy:
    """Sections across a tract.

    Parameters
    ----------
    field : SampledField
    line : Centreline
    sections : Sections
    fitted, inscribed : SectionCircles
        By least squares, and the largest inside.
    findings : tuple of Finding
    """

    field: SampledField
    line: Centreline
    sections: Sections
    fitted: SectionCircles
    inscribed: SectionCircles
    findings: tuple[Finding, ...] = ()

    def summarise(self) -> dict[str, Any]:
        """Return JSON-able values."""
        room = -self.field.signed_distance(self.sections.centres)
        return {
            "centreline_length_mm": self.line.length,
            "arc_length_mm": self.sections.arc_length.tolist(),
            "room_mm": room.tolist(),
            "inscribed_radius_mm": self.inscribed.radii.tolist(),
            "fitted_radius_mm": self.fitted.radii.tolist(),
            "fitted_residual_mm": self.fitted.residuals.tolist(),
            "area_mm2": self.sections.areas.tolist(),
            "wall": self.field.wall,
            "wall_error_mm": self.field.wall_error,
            "inflation_mm": self.field.inflation,
            "findings": _list_findings(self.findings),
        }


def run_fit(
    tract: LabelTract | SurfaceTract,
    kind: str,
    *,
    max_error: float = 1.0,
    pieces: int | None = None,
    inside: bool = True,
    start: End = None,
    end: End = None,
    via: Sequence[End] = (),
    reverse: bool = False,
    voxel: float | None = None,
    inflate: float = 0.0,
    progress: Progress = no_progress,
) -> FitStudy:
    """Sample a lumen, find its centreline, and fit shapes to its wall.

    Parameters
    ----------
    tract : LabelTract or SurfaceTract
    kind, max_error, pieces, inside
        See `FitOptions`.
    start, end, via, reverse, voxel, inflate, progress
        See `run_insertion`.

    Raises
    ------
    BozziniError
        If an input is not legal, or no shapes follow the centreline.
    """
    options = FitOptions(kind=cast(Kind, kind), max_error=max_error, pieces=pieces, inside=inside)
    field, way = _find_line(tract, (start, end, via), reverse, voxel, inflate, progress)
    with explain_scale(tract):
        mesh = mesh_from_tract(tract, inflation=inflate)
        fitted = fit_duct(mesh, way.line, options, draft=field, progress=progress)
    return FitStudy(
        mesh=mesh,
        field=field,
        line=way.line,
        fitted=fitted,
        findings=(*tract.findings, *way.findings),
    )


def run_sections(
    tract: LabelTract | SurfaceTract,
    *,
    spacing: float = 2.0,
    start: End = None,
    end: End = None,
    via: Sequence[End] = (),
    reverse: bool = False,
    voxel: float | None = None,
    inflate: float = 0.0,
    progress: Progress = no_progress,
) -> SectionStudy:
    """Sample a lumen, find its centreline, and cut sections across it.

    Parameters
    ----------
    tract : LabelTract or SurfaceTract
    spacing : float
        Of the sections, `SPACING_MIN` or more [mm].
    start, end, via, reverse, voxel, inflate, progress
        See `run_insertion`.

    Raises
    ------
    BozziniError
        If an input is not legal.
    """
    check_number("spacing", spacing, low=SPACING_MIN, unit="mm")
    field, way = _find_line(tract, (start, end, via), reverse, voxel, inflate, progress)
    sections = cut_sections(field, way.line, spacing=spacing)
    return SectionStudy(
        field=field,
        line=way.line,
        sections=sections,
        fitted=sections.fit_circles(),
        inscribed=sections.inscribe_circles(progress=progress),
        findings=(*tract.findings, *way.findings),
    )


def _find_line(
    tract: LabelTract | SurfaceTract,
    ends: tuple[End, End, Sequence[End]],
    reverse: bool,
    voxel: float | None,
    inflate: float,
    progress: Progress,
) -> tuple[SampledField, Way]:
    places = resolve_places(tract, *ends)
    with explain_scale(tract):
        field = build_field(tract, voxel=voxel, inflate=inflate, progress=progress)
        return field, find_way(tract, field, places, reverse=reverse, progress=progress)


def _list_findings(findings: tuple[Finding, ...]) -> list[dict[str, str]]:
    return [
        {"code": item.code, "severity": item.severity, "message": item.message} for item in findings
    ]

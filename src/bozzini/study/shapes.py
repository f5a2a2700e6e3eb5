"""From a tract to shapes that stand for it, and to sections across it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..anatomy.tract import Finding, LabelTract, SurfaceTract
from ..checks import check_number
from ..duct import Centreline, SampledField
from ..duct.fitting.fit import FittedDuct, ShapeFitOptions, fit_duct, mesh_from_tract
from ..duct.fitting.measure import PERCENTS, SectionCircles, Sections, cut_sections
from ..duct.shapes.mesh import TriangleMesh
from ..progress import Progress, no_progress
from ..results import Json, Result
from .case import Case
from .options import PathOptions, TractFitOptions, explain_scale

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SPACING_MIN", "FitStudy", "SectionStudy", "run_fit", "run_sections"]

SPACING_MIN = 0.01
"""Sections are not cut closer together than this [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FitStudy(Result):
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

    @property
    def converged(self) -> bool:
        """Whether the shapes are as near to the wall as was asked for."""
        return self.fitted.converged

    @property
    def reason(self) -> str:
        """Why not, or empty."""
        return self.fitted.reason

    @property
    def residual(self) -> float:
        """How far outside the wall the shapes reach at most, which is proved [mm]."""
        return self.fitted.report.outside_bound

    @property
    def clearance_min(self) -> float:
        """Least clearance of the shapes on the centreline, off its ends [mm]."""
        line = self.line
        last = line.length - line.radius[-1]
        inner = (line.arc_length > line.radius[0]) & (line.arc_length < last)
        points = line.points[inner] if inner.any() else line.points
        return float(-self.fitted.duct.signed_distance(points).max())

    def to_dict(self) -> Json:
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
            "room_loss_mm": report.clearance_loss.tolist(),
            "room_loss_place_mm": report.clearance_loss_place,
            "centreline_length_mm": self.line.length,
            "wall": self.mesh.wall,
            "wall_error_mm": self.mesh.wall_error,
            "inflation_mm": self.mesh.inflation,
            "findings": [asdict(item) for item in self.findings],
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the clearance on the centreline, true and of the shapes, and return the axes."""
        from ..plot.duct import draw_line_clearance

        return draw_line_clearance(self.field, self.line, self.fitted.duct, ax=ax)


@dataclass(frozen=True, kw_only=True, eq=False)
class SectionStudy(Result):
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

    converged = True
    reason = ""

    @property
    def circles(self) -> dict[str, SectionCircles]:
        """Both kinds of circles by their names in a legend."""
        return {"inscribed circle": self.inscribed, "least squares": self.fitted}

    @property
    def residual(self) -> float:
        """Largest root mean square of a circle by least squares [mm]."""
        return float(np.max(self.fitted.residuals))

    def to_dict(self) -> Json:
        """Return JSON-able values."""
        clearance = -self.field.signed_distance(self.sections.centres)
        return {
            "centreline_length_mm": self.line.length,
            "arc_length_mm": self.sections.arc_length.tolist(),
            "room_mm": clearance.tolist(),
            "inscribed_radius_mm": self.inscribed.radii.tolist(),
            "fitted_radius_mm": self.fitted.radii.tolist(),
            "fitted_residual_mm": self.fitted.residuals.tolist(),
            "area_mm2": self.sections.areas.tolist(),
            "wall": self.field.wall,
            "wall_error_mm": self.field.wall_error,
            "inflation_mm": self.field.inflation,
            "findings": [asdict(item) for item in self.findings],
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the radii of the circles along the centreline, and return the axes."""
        from ..plot.duct import draw_radii

        return draw_radii(self.field, self.line, self.sections, self.circles, ax=ax)


def run_fit(
    tract: LabelTract | SurfaceTract,
    options: TractFitOptions | None = None,
    *,
    progress: Progress = no_progress,
) -> FitStudy:
    """Sample a lumen, find its centreline, and fit shapes to its wall.

    Parameters
    ----------
    tract : LabelTract or SurfaceTract
    options : TractFitOptions, optional
    progress : Progress

    Raises
    ------
    BozziniError
        If an input is not legal, or no shapes follow the centreline.
    """
    options = TractFitOptions() if options is None else options
    case = Case.open(tract, options, progress=progress)
    field, ends = case.field, case.centreline
    how = ShapeFitOptions(
        kind=options.kind,  # type: ignore[arg-type]  # which it checks
        max_error=options.max_error,
        pieces=options.pieces,
        inside=not options.least_squares,
    )
    with explain_scale(tract):
        mesh = mesh_from_tract(tract, inflation=options.inflate)
        fitted = fit_duct(mesh, ends.line, how, draft=field, progress=progress)
    findings = (*tract.findings, *ends.findings)
    return FitStudy(mesh=mesh, field=field, line=ends.line, fitted=fitted, findings=findings)


def run_sections(
    tract: LabelTract | SurfaceTract,
    options: PathOptions | None = None,
    *,
    spacing: float = 2.0,
    progress: Progress = no_progress,
) -> SectionStudy:
    """Sample a lumen, find its centreline, and cut sections across it.

    Parameters
    ----------
    tract : LabelTract or SurfaceTract
    options : PathOptions, optional
    spacing : float
        Of the sections, `SPACING_MIN` or more [mm].
    progress : Progress

    Raises
    ------
    BozziniError
        If an input is not legal.
    """
    check_number("spacing", spacing, low=SPACING_MIN, unit="mm")
    case = Case.open(tract, options, progress=progress)
    field, ends = case.field, case.centreline
    sections = cut_sections(field, ends.line, spacing=spacing)
    return SectionStudy(
        field=field,
        line=ends.line,
        sections=sections,
        fitted=sections.fit_circles(),
        inscribed=sections.inscribe_circles(progress=progress),
        findings=(*tract.findings, *ends.findings),
    )

"""From a tract to what limits links and diameters along it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from numbers import Integral
from typing import TYPE_CHECKING, Any

import numpy as np

from ..anatomy.tract import Finding, LabelTract, SurfaceTract
from ..checks import check_number, check_word, show_apart
from ..duct import (
    Centreline,
    Duct,
    RoundCones,
    SampledField,
    find_centreline,
)
from ..duct.centreline import follow_chain, widen_line
from ..duct.shape_files import FITS
from ..duct.shapes.cylinders import ConnectedCylinders
from ..errors import InputError
from ..motion.traverse import DiameterLimits, LinkLimits, find_diameter_limits, find_link_limits
from ..progress import Progress, no_progress
from ..results import Json, Result
from .case import Case
from .ends import list_branches
from .options import PathOptions

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["LimitsStudy", "run_limits"]

NODES = 1_000_000
"""A duct that is no chain is put on a grid of about this many nodes to find its centreline."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LimitsStudy(Result):
    """What limits links along a tract.

    Parameters
    ----------
    duct : Duct
    line : Centreline
    links : LinkLimits
        For bodies of the diameter asked for.
    diameters : DiameterLimits
        For links of any length, however short.
    diameters_of_link : DiameterLimits, optional
        For links of the length asked for.
    fit : str
        How the duct's shapes were fitted to a tract, if they were. All bounds are of the shapes.
        If they are inscribed, what passes them passes the tract too, but for their `wall_error`;
        what does not may well pass the tract.
    findings : tuple of Finding
    """

    duct: Duct
    line: Centreline
    links: LinkLimits
    diameters: DiameterLimits
    diameters_of_link: DiameterLimits | None = None
    fit: str = ""
    findings: tuple[Finding, ...] = ()

    @property
    def link(self) -> float | None:
        """The length asked for [mm]."""
        return None if self.diameters_of_link is None else self.diameters_of_link.link

    @property
    def verdict(self) -> str:
        """``"passes"``, ``"too wide"``, ``"too long"`` or ``"undecided"``.

        Without a link: whether links short enough pass. Where there is no clearance for the
        shortest link somewhere, it is not the links that are too long.
        """
        if self.links.diameter > self.diameters.high or self.links.link_high == 0.0:
            return "too wide"
        if self.link is not None:
            return self.links.judge(self.link)
        return "passes" if self.links.link_low > 0.0 else "undecided"

    @property
    def converged(self) -> bool:
        """Whether the link passes; without one, whether short links do."""
        return self.verdict == "passes"

    @property
    def reason(self) -> str:
        """The verdict, if the link does not pass or that is not decided."""
        return "" if self.converged else self.verdict

    residual = 0.0

    def to_dict(self) -> Json:
        """Return JSON-able values; infinite numbers stay infinite."""
        narrow = self.diameters_of_link
        return {
            "verdict": self.verdict,
            "link_mm": self.link,
            "centreline_length_mm": self.line.length,
            "wall": self.duct.wall,
            "wall_error_mm": self.duct.wall_error,
            "fit": self.fit,
            **self.links.describe(),
            **self.diameters.describe(),
            **({} if narrow is None else {"with_link": narrow.describe()}),
            "findings": [asdict(item) for item in self.findings],
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the bounds of the link over the place, and return the axes."""
        from ..plot.duct import draw_link_bounds

        return draw_link_bounds(self.links, link=self.link, ax=ax)


def run_limits(
    source: LabelTract | SurfaceTract | Duct,
    options: PathOptions | None = None,
    *,
    diameter: float,
    link: float | None = None,
    fit: str = "",
    progress: Progress = no_progress,
) -> LimitsStudy:
    """Sample a lumen, find its centreline, and bound links and diameters along it.

    Parameters
    ----------
    source : LabelTract, SurfaceTract or Duct
        A duct must be 3-D and know how to move its wall if that is inflated. The centreline of a
        chain of cones or cylinders is that of its centres; other ducts are sampled to find it, as
        is a chain if the options name a voxel.
    options : PathOptions, optional
    diameter : float
        Of the body [mm].
    link : float, optional
        A length to judge, and to find the largest diameter for [mm].
    fit : str
        How a duct of shapes was fitted to a tract, one of `bozzini.duct.shape_files.FITS`.
    progress : Progress

    Raises
    ------
    BozziniError
        If an input is not legal; a body that does not fit is a result, not an error.
    """
    options = PathOptions() if options is None else options
    check_number("diameter", diameter, low=0.0, low_open=True, unit="mm")
    if link is not None:
        check_number("link", link, low=0.0, low_open=True, unit="mm")
    if fit:
        check_word("fit", fit, FITS)
    findings: tuple[Finding, ...]
    duct: Duct
    if isinstance(source, (LabelTract, SurfaceTract)):
        case = Case.open(source, options, progress=progress)
        duct, line = case.field, case.line
        findings = (*source.findings, *case.centreline.findings)
    else:
        duct, line = prepare_duct(source, options, progress)
        if options.reverse:
            line = line.reverse()
        findings = (*explain_fit(fit, duct), *list_branches(line))
    links = find_link_limits(duct, line, diameter=diameter, progress=progress)
    diameters = _lower_top(find_diameter_limits(duct, line, progress=progress), links)
    narrow = None
    if link is not None:
        narrow = find_diameter_limits(duct, line, link=link, progress=progress)
        narrow = _lower_top(narrow, links)
        if diameters.high < narrow.high:
            narrow = replace(narrow, high=diameters.high, high_at=diameters.high_at)
    return LimitsStudy(
        duct=duct,
        line=line,
        links=links,
        diameters=diameters,
        diameters_of_link=narrow,
        fit=fit,
        findings=findings,
    )


def _lower_top(diameters: DiameterLimits, links: LinkLimits) -> DiameterLimits:
    """Return the limits with what is proved where no link of a body passes, however short."""
    if links.link_high > 0.0 or links.diameter >= diameters.high:
        return diameters
    return replace(diameters, high=links.diameter, high_at=links.link_high_at)


def explain_fit(fit: str, duct: Duct) -> tuple[Finding, ...]:
    """Return a warning that bounds of fitted shapes are not bounds of the tract."""
    if fit == "inscribed":
        message = (
            "the shapes lie inside a tract and leave out a part of it: upper bounds do not hold "
            f"for the tract; what passes them passes it, within {duct.wall_error or 0.0:.2f} mm"
        )
    elif fit:
        message = (
            "the shapes were fitted through a tract's wall by least squares: no bound holds for "
            "the tract"
        )
    else:
        return ()
    return (Finding("fitted", "warning", message),)


def prepare_duct(duct: Duct, options: PathOptions, progress: Progress) -> tuple[Duct, Centreline]:
    """Return a duct with its wall moved, and its centreline."""
    if options.via:
        raise InputError("via has no effect on shapes: leave it out")
    ends: Any = (options.start, options.end)
    for name, chosen in zip(("start", "end"), ends, strict=True):
        if isinstance(chosen, (Integral, str)):
            raise InputError(
                f"{name} is label {chosen}, but shapes have no labels and no named places: give a "
                "point"
            )
    if options.inflate > 0.0:
        duct = duct.inflate(options.inflate)
    voxel = options.voxel
    if voxel is None and isinstance(duct, (RoundCones, ConnectedCylinders)):
        return duct, follow_chain(duct, ends)
    size = duct.bounds[1] - duct.bounds[0]
    if voxel is None:
        voxel = float(np.prod(size) / NODES) ** (1.0 / len(size))
    elif voxel > size.min():
        shown = show_apart(voxel, size.min())
        raise InputError(
            f"voxel is {shown[0]} mm: it must not exceed the duct's smallest side, {shown[1]} mm"
        )
    field = duct.sample(voxel)
    if not isinstance(field, SampledField):
        raise InputError("the duct is planar: its centreline must be given (find_link_limits)")
    line = find_centreline(field, ends, progress=progress)
    return duct, replace(widen_line(line, duct), other_ends=line.other_ends)

"""What an error of the wall means for a plan: contact if it is kept, or a plan anew."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..anatomy.tract import LabelTract, SurfaceTract
from ..checks import check_kind, floor_mm
from ..duct.base import Duct
from ..duct.field import SampledField, build_field, refine_field
from ..duct.moving import MovingField
from ..errors import BozziniError, InputError
from ..motion.certify import Certificate
from ..motion.moving import ReplanOptions, replan
from ..motion.plan import Plan
from ..motion.space import grid_of
from ..motion.verify import build_wall, certify_plan, rebuild_field
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import Json, Result, tabulated, to_plain
from .options import ContactRiskOptions
from .wall import (
    QUANTILES,
    Interval,
    Stations,
    WallError,
    choose_deciding,
    count_interval,
    draw_reaches,
    draw_stations,
    sample_body,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..report.short_page import ShortPage

TOLERANCE_MM = 0.003
"""Of the certificate: for probabilities the bound must be near to what is found."""

NEAR, STEEP = 2.0, 0.07
"""First order is said to be doubtful where the correlation length is less than so many times the
distance to the wall, or the deviation more than so much of it."""


# Draws in which it is planned anew.


@dataclass(frozen=True, kw_only=True, eq=False)
class Replannings:
    """Whether there is a certified plan in each of the first draws, after planning anew.

    Parameters
    ----------
    clearance : (n,) float
        What is certified [mm]; NaN where there is no plan.
    kept : (n,) bool
        Whether the head's path served as it was.
    rebuilt : (n,) bool
        Whether the whole field was built anew, with finer nodes along the path.
    reasons : tuple of str
        Why there is none; "" where there is one.
    """

    clearance: Floats
    kept: NDArray[np.bool_]
    rebuilt: NDArray[np.bool_]
    reasons: tuple[str, ...]

    @property
    def failed(self) -> int:
        """In how many there is none."""
        return int(np.isnan(self.clearance).sum())

    @property
    def interval(self) -> Interval:
        """The 95 % interval of the probability that there is none."""
        return count_interval(self.failed, len(self.clearance))


@dataclass(frozen=True, eq=False)
class _WallToMove:
    """The wall as a surface whose vertices are moved along its normals."""

    surface: SurfaceTract
    normals: Floats
    field: SampledField

    @classmethod
    def of(cls, tract: LabelTract | SurfaceTract, duct: Duct) -> _WallToMove:
        from ..scene.make_view import draw_wall

        grid = grid_of(duct)
        if grid is None:
            raise InputError(f"the duct is a {type(duct).__name__}: it must be a sampled field")
        is_own = isinstance(tract, SurfaceTract) and grid.inflation == 0.0
        mesh, _ = draw_wall(tract if is_own else grid, most_faces=2**31 - 1)
        surface = SurfaceTract(
            vertices=mesh.vertices,
            faces=mesh.faces,
            source=tract.source,
            frame=tract.frame,
            wall=tract.wall,
        )
        if not is_own:
            grid = build_field(surface, voxel=float(grid.spacing.max()))
        return cls(surface, mesh.normals, grid)

    def move(self, error: WallError, *, seed: int, number: int) -> Floats:
        """Return where the vertices are in a draw."""
        inwards = error.draw(self.surface.vertices, seed=seed, number=number)
        return self.surface.vertices - inwards[:, None] * self.normals


def displace_wall(
    tract: LabelTract | SurfaceTract,
    error: WallError,
    *,
    seed: int,
    number: int,
    duct: Duct | None = None,
) -> SurfaceTract:
    """Return the wall of a tract in one draw, its vertices moved along their normals.

    Parameters
    ----------
    tract : LabelTract or SurfaceTract
        The wall of labels, or one that is inflated, is the surface at the level of the `duct`.
    error : WallError
    seed, number : int
        Which draw.
    duct : Duct, optional
        The tract's field; built unless given.
    """
    duct = build_field(tract) if duct is None else duct
    wall = _WallToMove.of(tract, duct)
    return replace(wall.surface, vertices=wall.move(error, seed=seed, number=number))


def replan_draws(
    plan: Plan,
    tract: LabelTract | SurfaceTract,
    error: WallError,
    *,
    duct: Duct,
    options: ContactRiskOptions,
    progress: Progress = no_progress,
) -> Replannings:
    """Plan anew in the walls of the first `options.replan` draws.

    The vertices of the wall are moved along their normals. Near the path the distances to the moved
    triangles are measured, each exactly: of a displacement of the wall alone nothing is known
    inside, so that there is no bound to take. The path is bent where it lacks clearance, and what
    is certified decides. Where that fails, the whole field is built anew, with finer nodes along
    the path, and the insertion planned in full. That no plan is found then is no proof that there
    is none.

    Raises
    ------
    InputError
        If the plan does not reach its goal, or is the thesis's.
    """
    if plan.status != "complete":
        raise InputError(
            f"the plan stopped ({plan.reason_code}): only one that reaches its goal can be planned "
            "anew"
        )
    wall = _WallToMove.of(tract, duct)
    moving, radius = MovingField(wall.field, wall.surface), plan.get_scope().radius
    clearance = np.full(options.replan, np.nan)
    kept, rebuilt = (np.zeros(options.replan, dtype=bool) for _ in range(2))
    reasons = []
    for number in range(options.replan):
        progress("replan", number / options.replan)
        vertices = wall.move(error, seed=options.seed, number=number)
        try:
            lumen = moving.update(vertices=vertices, path=plan.path, radius=radius)
            found = replan(plan, lumen, options=ReplanOptions(measure=False))
            rebuilt[number] = found.status != "complete" or found.proved is None
            if rebuilt[number]:
                moved = replace(wall.surface, vertices=vertices)
                anew = build_field(moved, voxel=float(wall.field.spacing.max()))
                finer = refine_field(anew, moved, line_points_world=plan.path)
                found = replan(plan, finer, options=ReplanOptions(measure=False))
        except BozziniError as problem:
            reasons.append(str(problem))
            continue
        reasons.append(found.reason)
        if found.status == "complete" and found.proved is None:
            reasons[-1] = "a motion was found, but its clearance could not be certified"
        if not reasons[-1] and found.proved is not None:
            clearance[number] = found.proved
            note = found.replan
            kept[number] = note is not None and note.warm and note.sweeps == 0
    progress("replan", 1.0)
    return Replannings(clearance=clearance, kept=kept, rebuilt=rebuilt, reasons=tuple(reasons))


# All of it: what a plan's wall error comes to.


@dataclass(frozen=True, kw_only=True, eq=False)
class ContactRisk(Result):
    """How likely a plan touches its wall.

    ``n`` counts the draws.

    Attributes
    ----------
    plan : Plan
    error : WallError
    seed : int
    certificate : Certificate
        With a tolerance of 0.003 mm, for the wall as it is given.
    uniform : tuple of float
        Bounds of the probability of contact if the error is the same everywhere; both are proved
        unless the wall is inflated.
    clearance : (n,) ndarray
        Of the kept plan in each draw, to first order [mm].
    place, insertion : (n,) ndarray
        Where that is: arc length of the centreline, and of the head then [mm].
    samples, deciding : int
        Pairs of a place of the body and one of the wall, and those that a draw evaluates.
    nearest : float
        Smallest exact distance of a sample, less the radius: the clearance is at most this [mm].
    stations : Stations
    diameters : (k,) ndarray
        [mm].
    replanned : Replannings, optional
    notes : tuple of str
        What to know before believing the numbers.
    """

    plan: Plan
    error: WallError
    seed: int
    certificate: Certificate
    uniform: Interval
    clearance: Floats = tabulated("mm")
    place: Floats = tabulated("mm")
    insertion: Floats = tabulated("mm")
    samples: int
    deciding: int
    nearest: float
    stations: Stations
    diameters: Floats
    replanned: Replannings | None = None
    notes: tuple[str, ...] = field(default=())

    @property
    def draws(self) -> int:
        """How many random walls were drawn."""
        return len(self.clearance)

    @property
    def contact(self) -> float:
        """Share of the draws in which the plan, kept, touches the wall."""
        return float((self.clearance < 0.0).mean())

    @property
    def interval(self) -> Interval:
        """The 95 % interval of that probability, by the number of draws alone."""
        return count_interval(int((self.clearance < 0.0).sum()), self.draws)

    @property
    def converged(self) -> bool:
        """Whether the plan is proved clear of the wall as it is given."""
        return self.certificate.certified

    @property
    def reason(self) -> str:
        """Why not."""
        return "" if self.converged else "the plan is not proved clear of the wall as it is given"

    @property
    def residual(self) -> float:
        """Half the width of the interval."""
        low, high = self.interval
        return 0.5 * (high - low)

    @cached_property
    def over_diameters(self) -> Json:
        """The probability over other diameters of the same motion, as columns."""
        radius = self.plan.get_scope().radius
        hits = [int((self.clearance + radius < 0.5 * d).sum()) for d in self.diameters]
        low, high = zip(*(count_interval(k, self.draws) for k in hits), strict=True)
        return {
            "diameter_mm": self.diameters,
            "contact": np.array(hits) / self.draws,
            "contact_low": np.array(low),
            "contact_high": np.array(high),
        }

    def list_columns(self) -> Mapping[str, object]:
        """Return the columns of `to_frame`: a row each draw."""
        columns: Json = {"draw": np.arange(self.draws), **super().list_columns()}
        columns["contact"] = self.clearance < 0.0
        if self.replanned is not None:
            found = self.replanned
            columns["replanned_clearance_mm"] = _fill(found.clearance, self.draws)
        return columns

    def to_dict(self) -> Json:
        """Return the summary as plain values."""
        low, high = self.interval
        summary: Json = {
            "diameter_mm": self.plan.get_scope().diameter,
            "sd_mm": self.error.sd,
            "mean_mm": self.error.mean,
            "correlation_mm": self.error.correlation,
            "seed": self.seed,
            "draws": self.draws,
            "clearance_certified_mm": self.certificate.clearance if self.converged else None,
            "clearance_found_mm": self.certificate.found,
            "clearance_sampled_mm": self.nearest,
            "contact_uniform": {"low": self.uniform[0], "high": self.uniform[1]},
            "contact_kept": {"share": self.contact, "low": low, "high": high},
            "clearance_quantiles_mm": {
                f"{round(100 * q)}_percent": float(np.quantile(self.clearance, q))
                for q in QUANTILES
            },
            "samples": self.samples,
            "deciding": self.deciding,
            "converged": self.converged,
            "reason": self.reason,
            "notes": list(self.notes),
        }
        again = self.replanned
        if again is not None:
            count = len(again.clearance)
            summary["replanned"] = {
                "draws": count,
                "no_plan": {
                    "share": again.failed / count,
                    "low": again.interval[0],
                    "high": again.interval[1],
                },
                "contact_kept_same_draws": float((self.clearance[:count] < 0.0).mean()),
                "path_kept": int(again.kept.sum()),
                "field_built_anew": int(again.rebuilt.sum()),
                "clearance_median_mm": (
                    float(np.nanmedian(again.clearance)) if again.failed < count else None
                ),
                "reasons": sorted({why for why in again.reasons if why})[:5],
            }
        return dict(to_plain(summary))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the distribution of the clearance over the draws, and return the axes."""
        from ..plot.uncertainty import draw_clearances

        return draw_clearances(self.clearance, self.certificate.clearance, ax)

    def draw(self) -> Figure:
        """Draw clearances, the probability over diameters, and both along the way."""
        from ..plot.uncertainty import draw_uncertainty

        return draw_uncertainty(
            self.clearance,
            self.place,
            stations=self.stations.list_columns(),
            diameters=self.over_diameters,
            diameter=self.plan.get_scope().diameter,
            certified=self.certificate.clearance,
        )

    def list_answers(self) -> list[tuple[str, str, str]]:
        """Return what was asked in words, the probability, and between which ends it lies."""
        rows = [
            ("contact, plan kept, error the same everywhere", None, self.uniform),
            (f"contact, plan kept, random wall, {self.draws} draws", self.contact, self.interval),
        ]
        again = self.replanned
        if again is not None:
            count = len(again.clearance)
            kept = int((self.clearance[:count] < 0.0).sum())
            rows += [
                (
                    f"contact, plan kept, the first {count} of them",
                    kept / count,
                    count_interval(kept, count),
                ),
                (
                    f"no certified plan after planning anew, the same {count}",
                    again.failed / count,
                    again.interval,
                ),
            ]
        return [
            (words, "" if share is None else _show_percent(share), _show_interval(ends))
            for words, share, ends in rows
        ]

    def make_page(self) -> ShortPage:
        """Return the report."""
        from ..report.short_page import ShortPage

        error, scope = self.error, self.plan.get_scope()
        source = "" if self.plan.input is None else self.plan.input.file or ""
        low, high = self.interval
        sentence = (
            f"If the plan is kept, the {scope.diameter:g} mm scope touches the wall in "
            f"{_show_percent(self.contact)} of the random walls ({_show_percent(low)} to "
            f"{_show_percent(high)}); error of the wall: standard deviation {error.sd:.3g} mm, "
            f"correlation length {error.correlation:g} mm, mean {error.mean:g} mm inwards."
        )
        worst = int(np.argmax(self.stations.contact))
        rows = [(name, f"{share} ({ends})" if share else ends) for name, share, ends in
                self.list_answers()]  # fmt: skip
        rows += [
            ("certified clearance, no error", f"{floor_mm(self.certificate.clearance, 3)} mm"),
            ("smallest exact distance of a sample, less the radius", f"{self.nearest:.3f} mm"),
            ("clearance in a draw: 5, 50, 95 %", " / ".join(
                f"{value:.2f} mm" for value in np.quantile(self.clearance, QUANTILES))),
            ("most often touched", f"{self.stations.place[worst]:.0f} mm of the centreline, in "
             f"{_show_percent(self.stations.contact[worst])} of {self.stations.draws} draws"),
            ("seed", str(self.seed)),
        ]  # fmt: skip
        touched = bool((self.clearance < 0.0).any())
        return ShortPage(
            title=f"Uncertainty of a plan: {source}" if source else "Uncertainty of a plan",
            label="Contact is likely" if low > 0.5 else "Contact is possible" if touched else
            "No contact in any draw",
            tone="red" if not self.converged or low > 0.5 else "amber" if touched else "green",
            sentence=sentence,
            notes=self.notes,
            figures=[(self.draw(), _CAPTION)],
            rows=rows,
            limitations=_LIMITS if self.replanned is not None else _LIMITS[:-1],
        )  # fmt: skip

    def write(self, folder: Path) -> Json:
        """Write tables, figure and report into a directory, and return the summary."""
        from .. import plot
        from ..io.files import has_parquet, write_text
        from ..io.sheets import write_table

        plot.write_figure(self.draw(), folder / "uncertainty.png")
        tables = {"stations": self.stations.list_columns(), "diameters": self.over_diameters}
        for name, columns in tables.items():
            write_table(folder / f"{name}.csv", columns)
        for ending in ("csv", "parquet") if has_parquet() else ("csv",):
            write_table(folder / f"draws.{ending}", self.list_table())
        self.make_page().write(folder / "report.html")
        names = {path.name for path in folder.iterdir()} | {"summary.json"}
        summary = self.to_dict() | {"files": sorted(names)}
        write_text(folder / "summary.json", json.dumps(summary, indent=2, allow_nan=False))
        return summary


_CAPTION = (
    "Clearance of the kept plan over the random walls; the probability over the diameter of the "
    "same motion, with its 95 % interval; clearance along the way; where the least one lies."
)

_LIMITS = (
    "Contact if the plan is kept: the motion as it is, while the wall is another one than it was "
    "planned for. Nobody looks, nothing gives way.",
    "With an error that is the same everywhere there is contact if and only if it exceeds the "
    "clearance: the certificate gives that exactly, the upper end is proved.",
    "With a random wall every narrow place has an error of its own. That makes contact likelier "
    "than an error that is the same everywhere: one of many places is off soon. Which of the two "
    "is true of a scan is not known here.",
    "The random wall is taken to first order: it moves along the normal, changes little over the "
    "distance from the body, and no other part of the wall bulges out. The interval is that of the "
    "number of draws alone.",
    "Standard deviation and correlation length are stated, not measured.",
    "Research software, not a medical device.",
    "No certified plan after planning anew: in each wall it is planned again. That none is found "
    "is no proof that there is none; it counts what this planner and this certificate achieve.",
)


def _show_percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


def _show_interval(ends: Interval) -> str:
    return f"{100.0 * ends[0]:.3g} to {100.0 * ends[1]:.3g} %"


def _fill(values: Floats, count: int) -> Floats:
    return np.concatenate([values, np.full(count - len(values), np.nan)])


def study_contact(
    plan: Plan,
    tract: LabelTract | SurfaceTract,
    *,
    options: ContactRiskOptions | None = None,
    duct: Duct | None = None,
    progress: Progress = no_progress,
) -> ContactRisk:
    """Find how likely a plan touches a wall that is not quite where it is said to be.

    Parameters
    ----------
    plan : Plan
    tract : LabelTract or SurfaceTract
        What it was made from.
    options : ContactRiskOptions, optional
    duct : Duct, optional
        The tract's field as the plan states it; built unless given.
    progress : Progress

    Raises
    ------
    InputError
        If `options.sd` is not given for a surface, the plan is planar, or never leaves the
        introducer; or is to be planned anew and does not reach its goal.
    """
    options = ContactRiskOptions() if options is None else options
    check_kind("plan", plan, Plan)
    sd, notes = _take_sd(tract, options)
    error = WallError(sd=sd, correlation=options.correlation, mean=options.mean)
    duct = rebuild_field(plan, tract, progress=progress) if duct is None else duct
    progress("certify", 0.0)
    certificate = certify_plan(plan, duct, tolerance=TOLERANCE_MM)
    progress("sample", 0.0)
    samples = sample_body(plan, duct, build_wall(tract))
    scope = plan.get_scope()
    diameters = np.array(options.diameters or np.linspace(0.6, 1.2, 13) * scope.diameter)
    deciding = choose_deciding(samples, error, 0.5 * max(diameters.max(), scope.diameter))
    reach, closest = draw_reaches(
        deciding, error, seed=options.seed, numbers=range(options.draws), progress=progress
    )
    progress("stations", 0.0)
    stations = draw_stations(
        samples, error, radius=scope.radius, seed=options.seed, draws=options.draws
    )
    again = None
    if options.replan:
        again = replan_draws(plan, tract, error, duct=duct, options=options, progress=progress)
    nearest = float(samples.distance.min()) - scope.radius
    known = certificate
    if plan.inflation == 0.0:  # an exact distance: the clearance is not more
        known = replace(certificate, found=max(certificate.found, nearest))
    return ContactRisk(
        plan=plan,
        error=error,
        seed=options.seed,
        certificate=certificate,
        uniform=error.bound_contact(known),
        clearance=reach - scope.radius,
        place=deciding.place[closest],
        insertion=deciding.insertion[closest],
        samples=len(samples.points),
        deciding=len(deciding.points),
        nearest=nearest,
        stations=stations,
        diameters=diameters,
        replanned=again,
        notes=(*notes, *_list_notes(plan, error, certificate, nearest + scope.radius)),
    )


def _take_sd(
    tract: LabelTract | SurfaceTract, options: ContactRiskOptions
) -> tuple[float, tuple[str, ...]]:
    """Return the standard deviation [mm], and a note if it is the default."""
    if options.sd is not None:
        return options.sd, ()
    if isinstance(tract, SurfaceTract):
        raise InputError(
            "sd is not given: a surface does not state how far its wall may be off, give a "
            "standard deviation in (0, 20] mm"
        )
    voxel = float(tract.spacing.max())
    sd = voxel / math.sqrt(12.0)
    return sd, (
        f"sd is {sd:.3g} mm, that of rounding to voxels of {voxel:.3g} mm; how well the labels "
        "were drawn is not in it",
    )


def _list_notes(
    plan: Plan, error: WallError, certificate: Certificate, distance: float
) -> Iterator[str]:
    """Give what to know before believing the numbers."""
    if not certificate.certified:
        yield "the plan is not proved clear of the wall as it is given"
    if plan.status != "complete":
        yield f"the plan stops at {plan.inserted:.1f} mm of its path: what follows is up to there"
    if plan.inflation > 0.0:
        yield f"the wall is inflated by {plan.inflation:g} mm, and the error is about that wall"
    if error.correlation < NEAR * distance:
        yield (
            f"first order is doubtful: the correlation length, {error.correlation:g} mm, is less "
            f"than {NEAR:g} times the distance to the wall, {distance:.2f} mm"
        )
    steep = error.sd / error.correlation
    if steep > STEEP:
        yield (
            f"first order is doubtful: sd over correlation length is {steep:.2g}, more than "
            f"{STEEP:g}"
        )

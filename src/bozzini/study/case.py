"""A case: one lumen, how it is sampled, where its centreline runs, and what is planned in it.

The chain tract -> distance field -> ends -> centreline -> plan stands here alone. Commands,
studies, the cockpit and Python go through it, so that the same input has the same answer.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from ..anatomy.tract import Finding, LabelTract, SurfaceTract
from ..checks import check_kind, choose, floor_mm
from ..duct import Centreline, LumenTree, SampledField, build_field, find_tree
from ..duct.field import RefinedField, check_tract, refine_field
from ..duct.tree_names import read_names
from ..motion.largest import Largest, find_largest
from ..motion.moving import plan_with_soft_wall, replan
from ..motion.plan import Plan, TractInput
from ..motion.planner import advise_plan
from ..motion.scope import Scope
from ..motion.space import FreeSpace, Passage, find_passage
from ..progress import Progress, announce, no_progress
from ..results import Json, Shown
from .ends import (
    TREES,
    OrientedCentreline,
    Place,
    choose_branch,
    find_entry,
    find_root,
    orient_centreline,
    resolve_places,
    turn_centreline,
)
from .options import InsertionOptions, PathOptions, ReadOptions, explain_scale
from .reach import Unreached, find_unreached, measure_unreached

if TYPE_CHECKING:
    from ..motion.verify import Verification

T = TypeVar("T")

FINE, CORRIDOR = 0.5, 8.4
"""Spacing of a finer grid, and how far from the centreline it reaches [mm]."""

GRID_CODES = (
    "LINK_TOO_LONG",
    "HEAD_CLEARANCE",
    "CERTIFICATE_UNRESOLVED",
    "GOAL_CLEARANCE",
    "ENTRY_CLEARANCE",
)
"""Refusals that may be the grid's, not the lumen's. A proved one (NO_PASSAGE) is not."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CasePlan(Shown):
    """A plan of a case, and where it was made.

    Attributes
    ----------
    case : Case
    plan : Plan
    centreline : OrientedCentreline
        The line that is planned along, and why it begins where it does.
    duct : SampledField or RefinedField
        The lumen that the plan is proved in: on the first grid, or on the finer one.
    entries : tuple of dict
        Of an organ that is not known: what came of entering at either end, the better one first.
    findings : tuple of Finding
        What is to be said of the entry and of the finer grid.
    final : bool
        Whether no better answer follows.
    """

    case: Case = field(repr=False)
    plan: Plan
    centreline: OrientedCentreline
    duct: SampledField | RefinedField
    entries: tuple[Json, ...] = ()
    findings: tuple[Finding, ...] = ()
    final: bool = True

    @property
    def line(self) -> Centreline:
        """The centreline from the entry to the goal."""
        return self.centreline.line

    @property
    def field(self) -> SampledField:
        """The lumen on the first grid."""
        return self.case.field

    @property
    def space(self) -> FreeSpace:
        """The lumen that the plan is proved in, with its line."""
        return FreeSpace(self.duct, self.line)

    @property
    def unreached(self) -> tuple[Unreached, ...]:
        """The parts of the lumen that the centreline does not reach, largest first."""
        return self.case.find_unreached(self.line)

    @property
    def unreached_share(self) -> float:
        """The share of the lumen that the centreline should reach and does not."""
        return measure_unreached(self.unreached, self.centreline)

    @property
    def passage(self) -> Passage:
        """The widest passage from the entry to the goal."""
        with self.case._clock("passage"):
            return find_passage(self.field, self.line.points[0], goal=self.line.points[-1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Case(Shown):
    """A tract and how it is planned in; what is computed of it is computed once, when first asked.

    Parameters
    ----------
    tract : LabelTract or SurfaceTract
        What `bozzini.anatomy.read_tract` or `make_phantom` gives.
    options : InsertionOptions
        The grid, the ends, how a scope is moved.
    progress : Progress
        Hears of all long work.
    inputs : mapping
        What the tract was read from, kept in plans.

    Attributes
    ----------
    seconds : dict
        Wall-clock time by stage [s].

    Raises
    ------
    BozziniError
        If an input is not legal. What needs the field or the line raises when it is first asked.

    Examples
    --------
    >>> from bozzini.study import Case, open_phantom
    >>> from bozzini import Scope
    >>> case = Case.open(open_phantom(seed=0, voxel=3.0))
    >>> case.plan(Scope(diameter=6.0, link_length=12.0)).plan.status
    'complete'
    """

    tract: LabelTract | SurfaceTract
    options: InsertionOptions = field(default_factory=InsertionOptions)
    progress: Progress = no_progress
    inputs: Mapping[str, object] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_tract("tract", self.tract)
        check_kind("options", self.options, InsertionOptions)
        _ = self.stated  # wrong ends and inputs are told before any long work

    @classmethod
    def open(
        cls,
        source: LabelTract | SurfaceTract | str | os.PathLike[str],
        options: PathOptions | None = None,
        *,
        reading: ReadOptions | None = None,
        progress: Progress = no_progress,
    ) -> Case:
        """Return the case of a tract, or of a file that holds one.

        Parameters
        ----------
        source : LabelTract, SurfaceTract or path-like
        options : PathOptions, optional
            With how a scope is moved too, if they are `InsertionOptions`.
        reading : ReadOptions, optional
            How a file is read.
        progress : Progress
        """
        reading = ReadOptions() if reading is None else reading
        check_kind("reading", reading, ReadOptions)
        if options is None:
            options = InsertionOptions()
        elif not isinstance(options, InsertionOptions):
            check_kind("options", options, PathOptions)
            path = {name: getattr(options, name) for name in PathOptions.__dataclass_fields__}
            options = InsertionOptions(**path)
        if isinstance(source, (LabelTract, SurfaceTract)):
            return cls(tract=source, options=options, progress=progress)
        progress("read", 0.0)
        tract = reading.read(source)
        inputs = describe_source(source, reading, tract=tract, options=options)
        return cls(tract=tract, options=options, progress=progress, inputs=inputs)

    @cached_property
    def _places(self) -> tuple[Place | None, Place | None, tuple[Place, ...]]:
        options = self.options
        return resolve_places(self.tract, options.start, options.end, options.via)

    @property
    def start(self) -> Place | None:
        """The place that was given as the entry."""
        return self._places[0]

    @property
    def end(self) -> Place | None:
        """The place that was given as the goal."""
        return self._places[1]

    @cached_property
    def field(self) -> SampledField:
        """The lumen on the first grid."""
        options = self.options
        with self._clock("distance"), explain_scale(self.tract):
            return build_field(
                self.tract,
                voxel=options.voxel,
                inflate=options.inflate,
                reach=options.inflate + options.soft_wall,
                progress=self.progress,
            )

    @cached_property
    def centreline(self) -> OrientedCentreline:
        """The line from the entry to the other end, and why that end is the entry."""
        options = self.options
        start, end, via = self._places
        branches = self.tract.organ in TREES and not options.reverse
        if options.branch is not None or (branches and end is None and not via):
            return choose_branch(self.tract, self.tree, options.branch, start=start)
        basis = ""
        if branches and start is None:
            start, basis = find_entry(self.tract, self.tree)
        with self._clock("centreline"), explain_scale(self.tract):
            found = orient_centreline(
                self.tract,
                self.field,
                (start, end, via),
                reverse=options.reverse,
                progress=self.progress,
            )
        return replace(found, basis=basis) if basis else found

    @cached_property
    def tree(self) -> LumenTree:
        """All branches of the lumen, from its root: the start that was given, or the widest end."""
        with self._clock("tree"), explain_scale(self.tract):
            root = None if self.start is None else find_root(self.field, self.start)
            tree = find_tree(self.field, root, progress=self.progress)
            findings = (*self.tract.findings, *tree.findings)
            tree = replace(tree, frame=self.tract.frame, findings=findings)
            names = self.options.names
            return tree if names is None else read_names(tree, names)

    @property
    def line(self) -> Centreline:
        """The centreline."""
        return self.centreline.line

    @property
    def space(self) -> FreeSpace:
        """The lumen on the first grid, with the centreline."""
        return FreeSpace(self.field, self.line)

    @cached_property
    def _turned(self) -> OrientedCentreline:
        """The centreline from its other end."""
        return turn_centreline(self.tract, self.centreline)

    @cached_property
    def _kept(self) -> dict[str, tuple[Centreline, object]]:
        """What was last made about a line, by its name."""
        return {}

    def _keep(self, name: str, line: Centreline, make: Callable[[], T]) -> T:
        """Return what is made about a line; the last one is kept."""
        known = self._kept.get(name)
        if known is None or known[0] is not line:
            self._kept[name] = known = line, make()
        return cast(T, known[1])

    def find_unreached(self, line: Centreline) -> tuple[Unreached, ...]:
        """Return the parts of the lumen that a line does not reach, largest first."""
        with self._clock("unreached"):
            make = partial(find_unreached, self.tract, self.field, line)
            return self._keep("unreached", line, make)

    def change(self, **options: object) -> Case:
        """Return the case with other options; what they do not touch is kept.

        Raises
        ------
        BozziniError
            If an option is not legal.
        """
        stated = {f"{name}_mm": options[name] for name in ("voxel", "inflate") if name in options}
        other = replace(
            self,
            options=replace(self.options, **options),  # type: ignore[arg-type]
            inputs={**self.inputs, **stated},
            seconds={},
        )
        known, kept = vars(self), vars(other)
        if not set(options) & {*PathOptions.__dataclass_fields__, "soft_wall"}:
            kept |= {name: known[name] for name in known if name not in kept}
        elif "field" in known and not set(options) & {"voxel", "inflate", "soft_wall"}:
            kept["field"] = known["field"]
        return other

    def plan(self, scope: Scope, *, advise: bool = True) -> CasePlan:
        """Return the plan of a scope: on the first grid, or on a finer one where that helps."""
        *_, found = self.list_plans(scope, advise=advise)
        return found

    def judge(self, scope: Scope) -> CasePlan:
        """Return the plan of a scope if it comes through; else it stands still: as `plan`, faster.

        How far a scope gets that does not come through is not sought, and the reason is that of
        the whole way: `plan` may name another one, of the place that the scope gets to.
        """
        *_, found = self._list_grids(scope, reach=False)
        return found

    def list_plans(self, scope: Scope, *, advise: bool = True) -> Iterator[CasePlan]:
        """Give the plan on the first grid at once, then what is better; the last one is final.

        A plan that fails by so little that it may be the grid's fault is made again with finer
        nodes about the centreline. What would fit is sought last, for the plan that stays.

        Parameters
        ----------
        scope : Scope
        advise : bool
            Whether to seek what would fit, of a scope that does not, if the options have it.
        """
        advise = advise and self.options.advise
        for found in self._list_grids(scope, reach=True):
            if not found.final or advise and found.plan.status == "stopped":
                yield replace(found, final=False)
        if advise and found.plan.status == "stopped":
            announce(f"stopped: {found.plan.reason}; looking for what would fit")
            with self._clock("advice"), explain_scale(self.tract):
                plan = advise_plan(found.plan, found.space, progress=self.progress)
            found = _restate_entry(replace(found, plan=plan))
        yield replace(found, findings=(*_find_other_entry(found), *found.findings))

    def _list_grids(self, scope: Scope, *, reach: bool) -> Iterator[CasePlan]:
        """Give the plan on the first grid, and on the finer one if that may change it."""
        check_kind("scope", scope, Scope)
        self.options.check(scope)
        with explain_scale(self.tract):
            found = self._plan_from_entry(scope, reach=reach)
            if not _may_profit(found.plan, self.field):
                yield found
                return
            yield replace(found, final=False)
            yield self._plan_finer(found, scope, reach=reach)

    def find_largest(self, scope: Scope, line: Centreline | None = None) -> Largest:
        """Return the largest diameter and the longest link that come through along a line."""
        check_kind("scope", scope, Scope)
        options = self.options
        freedom = 0.0 if options.method == "follow" else 1.0
        with self._clock("largest"):
            return find_largest(
                self.field,
                self.line if line is None else line,
                scope=scope,
                options=options.motion,
                freedom=freedom,
                progress=self.progress,
            )

    def replan(self, plan: Plan) -> Plan:
        """Return a plan that was made in another wall, carried over to this one and proved."""
        return replan(plan, self.field)

    def certify(self, plan: Plan) -> Verification:
        """Check a plan in this tract, sampled as the plan states, and prove it anew."""
        from ..motion.verify import build_wall, rebuild_field, verify_plan

        check_kind("plan", plan, Plan)
        field = rebuild_field(plan, self.tract, progress=self.progress)
        return verify_plan(plan, field, wall=build_wall(self.tract), progress=self.progress)

    def state(
        self, plan: Plan, *, centreline: OrientedCentreline, findings: Sequence[Finding]
    ) -> Plan:
        """Return a plan that states what it was made from, and what was found."""
        line = centreline.line
        rounded = Centreline(
            points=round_points(line.points),
            arc_length=round_points(line.arc_length),
            radius=round_points(line.radius),
        )
        stated = self.stated
        if self.options.branch is not None:  # its name by path: others are in another file
            known = self.tree.branches[self.tree.find_branch(self.options.branch)].name
            stated = TractInput.read({**stated.describe(), "branch": known})
        return replace(
            plan,
            input=stated,
            centreline=rounded,
            findings=tuple(f"{item.severity}: {item.message}" for item in findings),
            more={"ends": [candidate.describe() for candidate in centreline.candidates]},
        )

    @cached_property
    def stated(self) -> TractInput:
        """What a plan states of its tract."""
        given: Json = {"source": self.tract.source, **self.inputs}
        start, end, via = self._places
        for name, place in (("start", start), ("end", end)):
            if place is not None:
                given[name] = place.given
        if via:
            given["via"] = [place.given for place in via]
        if self.options.branch is not None:
            given["branch"] = self.options.branch
        return TractInput.read(given)

    def _make_plan(self, space: FreeSpace, scope: Scope, *, reach: bool = True) -> Plan:
        options = self.options
        plan = plan_with_soft_wall(
            space,
            scope,
            soft_wall=options.soft_wall,
            method=options.method,
            options=replace(options.motion, advise=False, reach=reach),
            progress=self.progress,
        )
        return replace(plan, options=options.motion)

    def _plan_from_entry(self, scope: Scope, *, reach: bool) -> CasePlan:
        """Return the plan on the first grid, from the end that is the entry or does better."""
        ends, field = self.centreline, self.field
        with self._clock("plan"):

            def make(along: OrientedCentreline) -> CasePlan:
                plan = self._make_plan(FreeSpace(field, along.line), scope, reach=reach)
                return CasePlan(case=self, plan=plan, centreline=along, duct=field)

            found = make(ends)
            if ends.decided:
                return found
            return _choose_end(found, make(self._turned), reverse=self.options.reverse)

    def _plan_finer(self, found: CasePlan, scope: Scope, *, reach: bool) -> CasePlan:
        """Return the better of a plan and its repetition with finer nodes, and a note on that."""
        with self._clock("refine"):
            duct = self._refine(found.line)
            fine = self._make_plan(FreeSpace(duct, found.line), scope, reach=reach)
        near = f"a grid of {FINE:g} mm within {CORRIDOR:g} mm of the centreline"
        if _is_better(fine, found.plan):
            note = f"planned and proved on {near}: on the coarser one it ended: {found.plan.reason}"
            found = replace(found, duct=duct)
            found = replace(found, plan=_keep_grid(fine, found))
        else:
            note = f"tried again on {near}, which did not help"
        notes = (Finding("finer-grid", "note", note),)
        return _restate_entry(replace(found, findings=notes))

    def _refine(self, line: Centreline) -> RefinedField:
        """Return the lumen with finer nodes about a line; the last one is kept."""
        return self._keep(
            "refined",
            line,
            lambda: refine_field(
                self.field,
                self.tract,
                # As the plan states them, so that the same nodes can be made again.
                line_points_world=round_points(line.points),
                voxel=FINE,
                distance=CORRIDOR,
                progress=self.progress,
            ),
        )

    def _clock(self, stage: str) -> AbstractContextManager[None]:
        return clock(self.seconds, stage)


@contextmanager
def clock(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Keep how long a stage took [s]."""
    begin = time.perf_counter()
    yield
    seconds[stage] = time.perf_counter() - begin


def describe_source(
    source: str | os.PathLike[str],
    reading: ReadOptions,
    *,
    tract: LabelTract | SurfaceTract,
    options: PathOptions,
) -> Json:
    """Return what a plan keeps of the file that its tract was read from."""
    return {
        **reading.describe(source),
        "organ": tract.organ,
        "voxel_mm": options.voxel,
        "inflate_mm": options.inflate,
    }


def open_phantom(*, seed: int, voxel: float = 1.5, organ: str = "upper-tract") -> LabelTract:
    """Return the labels of a phantom oesophagus, stomach and duodenum, or of airways.

    Parameters
    ----------
    seed : int
        Another number, another anatomy.
    voxel : float
        Edge of its voxels [mm].
    organ : {"upper-tract", "airway"}

    Raises
    ------
    InputError
        If there is no phantom of that organ.
    """
    from ..anatomy.airway import make_airway
    from ..anatomy.phantom import Phantom, make_phantom

    kinds: dict[str, Callable[..., Phantom]] = {"upper-tract": make_phantom, "airway": make_airway}
    return choose("phantom of", organ, kinds)(seed=seed).to_labels(voxel)


def round_points(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points as plans state them, to the micrometre [mm]."""
    return np.round(points, 3)


def _may_profit(plan: Plan, field: SampledField) -> bool:
    """Whether a plan fails by so little that a finer grid may show that it fits."""
    if plan.status == "complete" or plan.method == "thesis" or field.spacing.max() <= FINE:
        return False
    if plan.reason_code not in GRID_CODES:
        return False
    if plan.reason_code == "CERTIFICATE_UNRESOLVED" or plan.refusal is None:
        return True
    needs, offers = plan.refusal.needs, plan.refusal.offers
    return needs is None or offers is None or needs - offers <= field.error


def _keep_grid(plan: Plan, found: CasePlan) -> Plan:
    """Return a plan that states its finer nodes, if it was made with some."""
    if plan.field is None or not isinstance(found.duct, RefinedField):
        return plan
    grid = replace(plan.field, fine_spacing=FINE, fine_distance=CORRIDOR)
    return replace(plan, field=grid)


def _choose_end(found: CasePlan, turned: CasePlan, *, reverse: bool) -> CasePlan:
    """Return the better of the plans from either end of a centreline, and both in short.

    Better is: fits, proved; else gets farther; else the larger certified clearance. Of equal
    results that of the higher end is taken, which comes first. With `reverse` it is the other one.
    """
    pair = [found, turned]
    if reverse:
        pair.reverse()  # the line came reversed: the higher end first again
    first, second = pair
    if _is_better(second.plan, first.plan):
        basis = "the organ is not known: the end from which the scope gets farther"
        pair = [second, first]
        if _judge(second.plan)[:2] == _judge(first.plan)[:2]:
            basis = "the organ is not known: the end from which more clearance is proved"
    else:
        basis = "the organ is not known: both ends do alike, and this is the higher one"
        if _is_better(first.plan, second.plan):
            basis = "the organ is not known: the end from which the scope does better"
    if reverse:
        pair.reverse()
        basis = f"reversed ({basis}, was the other one)"
    entries = tuple(_describe_entry(each.line, each.plan) for each in pair)
    chosen = pair[0]
    return replace(
        chosen,
        centreline=replace(chosen.centreline, basis=basis),
        entries=entries,
    )


def _restate_entry(found: CasePlan) -> CasePlan:
    """Return a plan whose list of entries states what came of it by now."""
    if not found.entries:
        return found
    return replace(found, entries=(_describe_entry(found.line, found.plan), *found.entries[1:]))


def _describe_entry(line: Centreline, plan: Plan) -> Json:
    return {
        "point_mm": round_points(line.points[0]).tolist(),
        "status": plan.status,
        "certified": plan.certified,
        "clearance_certified_mm": plan.proved,
        "inserted_mm": plan.inserted,
        "reason": plan.reason,
    }


def _judge(plan: Plan) -> tuple[bool, float, float]:
    # A path along which links pass is a few mm longer or shorter from the one end or the other.
    inserted = np.inf if plan.status == "complete" else 10.0 * round(0.1 * plan.inserted)
    return (
        plan.status == "complete" and plan.certified,
        inserted,
        round(-1.0 if plan.proved is None else plan.proved, 1),
    )


def _is_better(plan: Plan, other: Plan) -> bool:
    return _judge(plan) > _judge(other)


def _find_other_entry(found: CasePlan) -> tuple[Finding, ...]:
    """Return a warning that names both results where both ends were tried."""
    if not found.entries:
        return ()
    places, results = [], []
    for entry in found.entries:
        places.append(f"({', '.join(f'{value:.0f}' for value in entry['point_mm'])}) mm")
        proved = entry["clearance_certified_mm"]
        result = "reaches the other end" if entry["status"] == "complete" else "stops"
        result += f" after {entry['inserted_mm']:.0f} mm of the head's path"
        if proved is not None:
            result += f", {floor_mm(proved)} mm of clearance proved"
        elif entry["status"] == "complete":
            result += ", not proved"
        results.append(result)
    if results[0] == results[1]:
        text = f"the same from either end, {' or '.join(places)}: the scope {results[0]}"
    else:
        pairs = zip(places, results, strict=True)
        text = "; ".join(f"entered at {place} the scope {result}" for place, result in pairs)
    if isinstance(found.duct, RefinedField):
        text += " (tried on the coarser grid alone)"
    message = (
        f"the organ is not known, so both ends were tried: {text}. The first is reported here: "
        "give --organ, --start or --reverse to choose"
    )
    return (Finding("organ-unknown", "warning", message),)

"""What a planner is: from a free space, a scope and options to a certified plan."""

from __future__ import annotations

import dataclasses
import functools
import platform
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from ..checks import check_array, check_kind, check_number, check_word, show_apart
from ..duct.base import Duct
from ..duct.centreline import Centreline
from ..errors import InputError, PluginError
from ..numeric.polylines import measure_arc_length
from ..progress import Progress, no_progress
from ..results import Shown
from .certify import Certificate, certify_motion
from .measures import measure_motion, summarise_field
from .plan import CandidateMotion, Plan
from .planners import HEAD_STEP_MIN_MM, PLANNERS, PlannerOptions
from .refusal import Refusal
from .scope import Scope
from .space import FreeSpace

LINKS_MAX = 10_000
"""A scope has at most as many links."""

POSITIONS_MAX = 10_000_000
"""A plan holds at most as many positions: of all joints, at all steps. They take 240 MB."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion(Shown):
    """What a planner finds: the steps, and why they end before the goal.

    Lists become arrays.

    Parameters
    ----------
    joints : (steps, joints, dim) float
        World frame [mm]; links have the scope's length, joint 0 is the head. At the first step
        the chain stands in the introducer, with its head at the entry.
    head_arc_length : (steps,) float
        Of the head along `path` [mm].
    path : (n, dim) float
        The path that the head follows, world frame [mm].
    reason_code, reason : str
        Why the motion ends before the goal, a word and one sentence; "" where it does not.
    refusal : Refusal, optional
        The same in numbers; its code and reason stand for the two.
    certificate : Certificate, optional
        Where it is known already; `Planner.plan` makes what is not. That of another package's
        planner is not used: its motion is certified anew.
    method : str
        Which planner made it, where a planner chooses between several.
    freedom : float, optional
        Share of the free tube that the joints use.
    candidates : tuple of CandidateMotion
        The motions that were compared for it.

    Raises
    ------
    InputError
        If `joints`, `head_arc_length` or `path` is no array of numbers.
    """

    joints: NDArray[np.float64]
    head_arc_length: NDArray[np.float64]
    path: NDArray[np.float64]
    reason_code: str = ""
    reason: str = ""
    refusal: Refusal | None = None
    certificate: Certificate | None = None
    method: str = ""
    freedom: float | None = None
    candidates: tuple[CandidateMotion, ...] = ()

    def __post_init__(self) -> None:
        for name in ("joints", "head_arc_length", "path"):
            array = check_array(f"{name} of a motion", getattr(self, name))
            object.__setattr__(self, name, array)


class Planner(ABC):
    """A way to plan motions. A subclass moves the joints; the rest is the same for all.

    Another package adds one with an entry point of the group ``bozzini.planners``, see
    `bozzini.motion.PLANNERS`; it is made without arguments.

    Attributes
    ----------
    name : str
        By which it is chosen.
    ignored : tuple of str
        Fields of `PlannerOptions` that it does not know: they must be as by default.
    """

    name: ClassVar[str]
    ignored: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def move(
        self,
        space: FreeSpace,
        scope: Scope,
        *,
        options: PlannerOptions,
        progress: Progress = no_progress,
    ) -> Motion:
        """Return a motion from the entry along the space's line, as far as it goes.

        Scope, options and space are checked: the space has a line and an introducer, and the line
        is no longer than the scope.
        """

    def advise(
        self,
        space: FreeSpace,
        scope: Scope,
        *,
        refusal: Refusal,
        options: PlannerOptions,
        progress: Progress = no_progress,
    ) -> Refusal:
        """Return a refusal of `move` with what would fit; by default as it is."""
        return refusal

    def plan(
        self,
        space: FreeSpace,
        scope: Scope,
        *,
        options: PlannerOptions | None = None,
        progress: Progress = no_progress,
    ) -> Plan:
        """Plan how a scope moves through a free space; see `plan_insertion`.

        Raises
        ------
        InputError
            If an option is not legal for this planner, scope or space.
        PluginError
            If another package's planner gives a motion that is not that of its path.
        """
        options = PlannerOptions() if options is None else options
        check_kind("space", space, FreeSpace)
        check_kind("scope", scope, Scope)
        check_kind("options", options, PlannerOptions)
        self.check(scope, options)
        line = space.centreline
        check_link(scope, line)
        dim = space.duct.dim
        if line.points.shape[1] != dim:
            raise InputError(
                f"the centreline's points have shape {line.points.shape}: this duct needs "
                f"(n, {dim})"
            )
        short = _is_short(scope, line)
        if short:  # it gets in as far as it is long
            space = FreeSpace(space.duct, line.cut(float(scope.length or 0.0)), space.introducer)
        if space.introducer is None:
            space = space.for_link(scope.link_length)
        check_size(scope, space.centreline, options)
        asked = dataclasses.replace(options, advise=options.advise and not short)
        motion = self.move(space, scope, options=asked, progress=progress)
        if asked.advise and motion.refusal is not None:
            refusal = self.advise(
                space, scope, refusal=motion.refusal, options=asked, progress=progress
            )
            motion = dataclasses.replace(motion, refusal=refusal)
        if not self._is_own:
            motion = dataclasses.replace(motion, certificate=None)
        if short and not motion.reason_code and motion.refusal is None:
            motion = dataclasses.replace(motion, refusal=_explain_short(scope, line))
        plan = finish_plan(space, motion, scope=scope, options=options, asked=self.name)
        if not self._is_own:
            self._check_plan(dataclasses.replace(plan, centreline=line))
        progress("certify", 1.0)
        return plan

    @property
    def _is_own(self) -> bool:
        """Whether the planner is one of this package."""
        return type(self).__module__.partition(".")[0] == __name__.partition(".")[0]

    def _check_plan(self, plan: Plan) -> None:
        """Raise `PluginError` for a plan that would be refused when it is verified."""
        from .verify import check_consistency

        for check in check_consistency(plan):
            if not check.ok:
                raise PluginError(
                    f"the planner {self.name} gave a motion that is not consistent: {check.name}: "
                    f"{check.message}"
                )

    def check(self, scope: Scope, options: PlannerOptions) -> None:
        """Raise `InputError` for any option that is not legal for every tract."""
        if scope.length is not None and scope.length > LINKS_MAX * scope.link_length:
            shown = show_apart(scope.length, LINKS_MAX * scope.link_length, scope.link_length)
            raise InputError(
                f"scope length is {shown[0]} mm: it must be at most "
                f"{shown[1]} mm, {LINKS_MAX} links of "
                f"{shown[2]} mm"
            )
        low, high = HEAD_STEP_MIN_MM, scope.link_length
        check_number("head step", options.head_step, low=low, high=high, unit="mm")
        default = PlannerOptions()
        if any(getattr(options, name) != getattr(default, name) for name in self.ignored):
            *names, last = (name.replace("_", " ") for name in self.ignored)
            words = f"{', '.join(names)} or {last}" if names else last
            others = (name for name in PLANNERS if name != self.name)
            raise InputError(
                f"method '{self.name}' has no {words}: leave {'them' if names else 'it'} out, or "
                f"use one of {', '.join(others)}"
            )


def plan_insertion(
    duct: Duct,
    line: Centreline,
    *,
    scope: Scope,
    method: str = "best",
    options: PlannerOptions | None = None,
    progress: Progress = no_progress,
) -> Plan:
    """Plan how a scope moves along a centreline into a lumen.

    Parameters
    ----------
    duct : Duct
        The lumen: a sampled field, or an analytic one; in 2-D or 3-D.
    line : Centreline
        The way from the entry to the goal.
    scope : Scope
        The scope; without a length it is made long enough for the whole line.
    method : str
        A name in `bozzini.motion.PLANNERS`. ``"best"``: ``"tube"``, ``"follow"`` and a motion
        between them, also along a path shaped for more clearance; the one with the most certified
        clearance, of those whose joints step at most four times as far as the head. ``"tube"``:
        the whole body stays inside, proved, and joints move little. ``"follow"``: the same, with
        every joint on the head's path. ``"thesis"``: section 5.3, each next joint moves least with
        the link length kept and the **joints** kept one scope radius inside the wall; the links
        between them are not.
    options : PlannerOptions, optional
        Head step, slip, angle limit, route, and whether to seek what would fit.
    progress : Progress

    Returns
    -------
    Plan
        Also when the scope does not fit: then ``status`` is ``"stopped"``, the motion goes as far
        as it certifiably can, and ``reason`` states why it ends there and what would fit: scopes
        and inflations for which a certified plan of the whole way was made. Every plan carries
        its certificate; only ``certified`` is a proof. ``method`` is the one that made it; with
        ``"best"`` ``candidates`` lists what was compared.

    Raises
    ------
    InputError
        If the method is unknown, the link is longer than the tract, a number is out of range, or
        the motion would have more than `POSITIONS_MAX` positions of joints.
    """
    return make_planner(method).plan(
        FreeSpace(duct, line), scope, options=options, progress=progress
    )


def advise_plan(plan: Plan, space: FreeSpace, *, progress: Progress = no_progress) -> Plan:
    """Return a plan in `space` that states what would fit, if its scope does not.

    That is what `plan_insertion` adds, with `PlannerOptions.advise`, to a plan made without.
    """
    refusal, scope = plan.refusal, plan.get_scope()
    if refusal is None or _is_short(scope, space.centreline):
        return plan
    if plan.displaced > 0.0:
        space = FreeSpace(space.duct.inflate(plan.displaced), space.centreline)
    refusal = make_planner(plan.asked).advise(
        space.for_link(scope.link_length),
        scope,
        refusal=refusal,
        options=plan.options or PlannerOptions(),
        progress=progress,
    )
    return dataclasses.replace(plan, refusal=refusal, reason=refusal.reason)


def _is_short(scope: Scope, line: Centreline) -> bool:
    """Whether a scope is wholly inserted before the end of a line."""
    return scope.length is not None and scope.length < line.length - 1e-6


def make_planner(method: str) -> Planner:
    """Return a planner by its name in `bozzini.motion.PLANNERS`."""
    kind = cast(type[Planner], PLANNERS[check_word("method", method, PLANNERS)])
    return kind()


def finish_plan(
    space: FreeSpace,
    motion: Motion,
    *,
    scope: Scope,
    options: PlannerOptions,
    asked: str,
    measure: bool = True,
) -> Plan:
    """Certify and measure a motion and put it, with all it was made from, into a plan.

    Without `measure` every clearance is the certified one, and there are no measures.
    """
    refusal, certificate, duct = motion.refusal, motion.certificate, space.duct
    if certificate is None:
        certificate = certify_motion(motion.joints, space, radius=scope.radius)
    code, reason = motion.reason_code, motion.reason
    if refusal is not None:
        code, reason = refusal.code, refusal.reason
    measures = None
    clearance = np.full((motion.joints.shape[0], motion.joints.shape[1] - 1), certificate.clearance)
    if measure:
        clearance, measures = measure_motion(space, motion.joints, motion.head_arc_length, scope)
    return Plan(
        joints=motion.joints,
        head_arc_length=motion.head_arc_length,
        clearance=clearance,
        path=motion.path,
        path_arc_length=measure_arc_length(motion.path),
        path_radius=-duct.signed_distance(motion.path),
        method=motion.method or asked,
        status="stopped" if code else "complete",
        reason_code=code,
        reason=reason,
        scope=scope,
        introducer=space.tube,
        options=options,
        asked=asked,
        freedom=motion.freedom if motion.method else None,
        candidates=motion.candidates if motion.method else None,
        wall=duct.wall,
        certificate=certificate,
        field=summarise_field(space),
        measures=measures,
        refusal=refusal,
        versions=dict(_list_versions()),
    )


def _explain_short(scope: Scope, line: Centreline) -> Refusal:
    length = float(scope.length or 0.0)
    return Refusal(
        code="SCOPE_TOO_SHORT",
        at=length,
        needs=line.length,
        offers=length,
        what=f"the scope is {length:g} mm long and wholly inserted: the goal is at "
        f"{line.length:.1f} mm of the centreline",
    )


def check_size(scope: Scope, line: Centreline, options: PlannerOptions) -> None:
    """Raise `InputError` if a motion along `line` would be too large to hold."""
    joints = scope.count_links(line.length) + 1
    travel = float(np.abs(np.diff([0.0, *options.route])).sum()) * line.length
    if joints * (travel / options.head_step + 1.0) > POSITIONS_MAX:
        least = travel * joints / POSITIONS_MAX
        shown = show_apart(options.head_step, least * 1.01, digits=3)
        raise InputError(
            f"head step is {shown[0]} mm: it must be at least {shown[1]} mm for "
            f"{joints} joints on a way of {travel:.0f} mm, or give longer links"
        )


def check_link(scope: Scope, line: Centreline) -> None:
    """Raise `InputError` if a link is longer than the way."""
    if scope.link_length > line.length:
        shown = show_apart(scope.link_length, line.length)
        raise InputError(
            f"link length is {shown[0]} mm: it must be at most the tract's centreline, "
            f"{shown[1]} mm"
        )


@functools.cache
def _list_versions() -> tuple[tuple[str, str], ...]:
    from importlib.metadata import version

    from .. import __version__ as bozzini_version

    return (
        ("bozzini", bozzini_version),
        ("python", platform.python_version()),
        *((name, version(name)) for name in ("numpy", "scipy", "numba")),
    )

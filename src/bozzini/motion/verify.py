"""Whether what a saved plan claims is so: consistency, its input, and the proof made anew."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..anatomy.files import has_suffix
from ..anatomy.labels import MOST_LISTED
from ..anatomy.names import describe_label
from ..anatomy.read import hash_input
from ..anatomy.tract import Finding, LabelTract, SurfaceTract, Tract
from ..anatomy.volumes import is_volume
from ..checks import ceil_mm, check_kind, check_number, floor_mm, show_apart
from ..duct.base import Duct
from ..duct.field import RefinedField, SampledField, build_field, refine_field
from ..duct.shape_tract import open_tract
from ..errors import InputError
from ..numeric.polylines import measure_arc_length
from ..progress import Progress, no_progress
from ..results import Shown, to_plain
from .certify import BUDGET, TOLERANCE_MM, Certificate, certify_motion
from .measures import measure_angles, measure_body
from .plan import LENGTH_ROUND_OFF_MM, ROUND_OFF_MM, Plan, TractInput, write_record
from .recheck import EntryTube, Recheck, TriangleWall, recheck_motion, surface_wall, voxel_wall
from .space import FreeSpace, grid_of
from .stated import (
    STATED_ROUND_OFF_MM,
    FaultError,
    check_certificate,
    check_errors,
    check_findings,
    check_measures,
    check_method,
    check_named_ends,
    check_refusal,
    check_scope,
    check_soft_wall,
    compare_field,
    compare_passage,
    compare_path,
    compare_place,
    compare_wall,
)

CLAIM_ROUND_OFF_MM = 1e-6
"""How far a claimed clearance may lie above the one proved anew."""

FINE_SPACING_MIN_MM, FINE_DISTANCE_MAX_MM = 0.25, 20.0
"""Least spacing of a plan's finer grid, and how far from the centreline it may reach."""

SPREADING = ("tube", "follow")
"""Planners that spread the steps of the head evenly from target to target."""

FINEST_TOLERANCE_MM = 0.005
"""Tolerance of the certificate to which a claim is followed."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """One thing that was checked.

    Parameters
    ----------
    name : str
        What it is about.
    ok : bool
    message : str
        What was found, one sentence.
    """

    name: str
    ok: bool
    message: str


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How the file of a plan was read again, as the plan states.

    Parameters
    ----------
    file : str
        What was read, as it was given.
    form : {"labels", "surface"}
    labels : tuple of int
        The labels that are lumen.
    label_names : tuple of str
        Their names, ``"label 3"`` without one.
    part : str
        The parts of a surface that were asked for.
    unit : str
        Unit of the file's coordinates, and why it is taken.
    frame, organ : str or None
        As `LabelTract` has them, by the file or as the plan states.
    repair : bool
    volume_ml : float
        Of the lumen [mL].
    findings : tuple of Finding
        What was found while reading.
    """

    file: str
    form: str
    labels: tuple[int, ...]
    label_names: tuple[str, ...]
    part: str
    unit: str
    frame: str | None
    organ: str | None
    repair: bool
    volume_ml: float
    findings: tuple[Finding, ...] = ()

    @classmethod
    def of(cls, plan: Plan, path: str | os.PathLike[str], tract: Tract) -> Reading:
        """Describe a tract that `read_input` read from a file."""
        stated = plan.input or TractInput()
        labels = tract.label_values if isinstance(tract, LabelTract) else ()
        known = tract.label_names if isinstance(tract, LabelTract) else {}
        parts = stated.part if isinstance(stated.part, tuple) else (stated.part,)
        return cls(
            file=os.fspath(path),
            form=tract.kind,
            labels=labels,
            label_names=tuple(describe_label(label, known) for label in labels),
            part=", ".join(str(part) for part in parts if part is not None) or "all of it",
            unit=_tell_unit(stated.unit, path, tract),
            frame=tract.frame,
            organ=tract.organ or stated.organ,
            repair=bool(stated.repair),
            volume_ml=tract.volume / 1000.0,
            findings=tract.findings,
        )

    def __str__(self) -> str:
        """Return one line: from which file, which labels or part, in which unit."""
        if self.form == "labels":
            pairs = zip(self.labels, self.label_names, strict=True)
            shown = [f"{k} ({name})" if name != f"label {k}" else str(k) for k, name in pairs]
            word = "label" if len(shown) == 1 else "labels"
            what = f"{word} {', '.join(shown[:MOST_LISTED])}"
            what += f" and {len(shown) - MOST_LISTED} more" if len(shown) > MOST_LISTED else ""
        else:
            what = f"part {self.part}" + (", repaired" if self.repair else "")
        return (
            f"{self.file}: {what}, unit {self.unit}, frame {self.frame or 'not stated'}, organ "
            f"{self.organ or 'not stated'}, {self.volume_ml:.3g} mL"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Verification(Shown):
    """What became of a plan's claim.

    Parameters
    ----------
    plan : Plan
    checks : tuple of Check
        All checks that were made.
    certificate : Certificate, optional
        The proof made anew; None without the wall.
    recheck : Recheck, optional
        What the second, independent check found, if it was asked for.
    reading : Reading, optional
        How the file was read, if one was given.
    """

    plan: Plan
    checks: tuple[Check, ...]
    certificate: Certificate | None = None
    recheck: Recheck | None = None
    reading: Reading | None = None

    @property
    def consistent(self) -> bool:
        """Whether no check failed."""
        return all(check.ok for check in self.checks)

    @property
    def certified(self) -> bool:
        """Whether the motion is proved clear of the wall, and nothing in the plan is wrong."""
        proved = self.certificate is not None and self.certificate.certified
        return proved and self.consistent

    def describe(self) -> dict[str, object]:
        """Return the result as JSON-able values; ``certified`` is None without the wall."""
        plan, proof, second = self.plan, self.certificate, self.recheck
        values: dict[str, object] = to_plain(
            {
                "consistent": self.consistent,
                "certified": None if proof is None else self.certified,
                "claimed": plan.certified,
                "clearance_claimed_mm": plan.proved,
                "clearance_certified_mm": (
                    proof.clearance if proof is not None and proof.certified else None
                ),
                "status": plan.status,
                "reason_code": plan.reason_code,
                "method": plan.method,
                "inserted_mm": plan.inserted,
                "path_length_mm": float(plan.path_arc_length[-1]),
                "steps": plan.steps,
                "links": plan.links,
                "scope": None if plan.scope is None else write_record(plan.scope),
                "inflation_mm": None if plan.field is None else plan.inflation,
                "soft_wall_mm": None if plan.soft_wall is None else plan.displaced,
                "wall": None if proof is None else proof.wall,
                "input_stated": None if plan.input is None else plan.input.describe(),
                "reading": self.reading,
                "checks": self.checks,
                "second_check": None
                if second is None
                else {
                    "clear": second.clear,
                    "clearance_mm": second.lower,
                    "found_mm": second.found,
                    "step": second.step,
                    "link": second.link,
                    "place_mm": second.place,
                    "samples": second.samples,
                    "resolved": second.resolved,
                },
            }
        )
        return values


def _tell_unit(given: str | None, path: str | os.PathLike[str], tract: Tract) -> str:
    codes = {item.code: item.message for item in tract.findings}
    if "unit-converted" in codes:
        return codes["unit-converted"]
    if "unit-unknown" in codes:
        return "mm, as the file states none"
    if isinstance(tract, LabelTract) and is_volume(path):
        return "mm"
    if given is not None:
        return f"{given}, as the plan states"
    if "model-read" in codes:
        return "the voxel size of the model's JSON"
    return "m, as of a GLB" if has_suffix(path, (".glb",)) else "mm, by default"


def certify_plan(
    plan: Plan,
    duct: Duct,
    *,
    tolerance: float = TOLERANCE_MM,
    budget: int = BUDGET,
    settle: bool = True,
) -> Certificate:
    """Prove a lower bound on the clearance of any saved plan.

    Parameters
    ----------
    plan : Plan
        Only its joints, the scope's diameter and the introducer are used.
    duct : Duct
        The free space to compare it with.
    tolerance, budget, settle
        As for `certify_motion`.

    Raises
    ------
    InputError
        If the plan has no scope.
    """
    check_kind("plan", plan, Plan)
    return certify_motion(
        plan.joints,
        FreeSpace(duct, introducer=plan.introducer),
        radius=plan.get_scope().radius,
        tolerance=tolerance,
        budget=budget,
        settle=settle,
    )


def verify_file(
    plan: Plan,
    path: str | os.PathLike[str],
    *,
    independent: bool = False,
    progress: Progress = no_progress,
) -> Verification:
    """Check a plan against the file that it was made from, read as the plan states.

    Parameters
    ----------
    plan : Plan
    path : path-like
        The label volume or surface.
    independent : bool
        Also measure the clearance by the second checker (`bozzini.motion.recheck`).
    progress : Progress

    Raises
    ------
    BozziniError
        If the file cannot be read as the plan states.
    """
    if plan.joints.shape[2] != 3:
        raise InputError("the plan has 2 dimensions: a file holds a tract in 3")
    progress("read", 0.0)
    source = _run("input", _check_source, plan, path)
    if not source[0].ok:  # another file has no bearing on this plan
        return Verification(plan=plan, checks=source)
    tract = read_input(plan, path)
    reading = Reading.of(plan, path, tract)
    field = rebuild_field(plan, tract, progress=progress)
    wall = build_wall(tract) if independent else None
    result = verify_plan(plan, field, wall=wall, progress=progress)
    read = Check(name="reading", ok=True, message=str(reading))
    own = (*source, read, *_run("findings", check_findings, plan, tract.findings))
    own = (*own, *_run("grid", _check_grid, plan, field))
    return Verification(
        plan=plan,
        checks=(*result.checks[:1], *own, *result.checks[1:]),
        certificate=result.certificate,
        recheck=result.recheck,
        reading=reading,
    )


def verify_plan(
    plan: Plan,
    duct: Duct | None = None,
    *,
    wall: TriangleWall | None = None,
    progress: Progress = no_progress,
) -> Verification:
    """Check whether a plan agrees with itself and, given the lumen, certify it anew.

    Parameters
    ----------
    plan : Plan
        Nothing in it is trusted: its stated clearances are compared with what is found.
    duct : Duct, optional
        The lumen, inflated as the plan states. Without it the wall is not checked.
    wall : TriangleWall, optional
        The wall before inflation, for the second check; see `build_wall`.
    progress : Progress

    Raises
    ------
    InputError
        If the duct has not the plan's dimensions, or the plan lacks its scope.
    """
    check_kind("plan", plan, Plan)
    checks = check_consistency(plan)
    if duct is None:
        return Verification(plan=plan, checks=checks)
    if plan.joints.shape[2] != duct.dim:
        raise InputError(
            f"the plan has {plan.joints.shape[2]} dimensions, the duct has "
            f"{duct.dim}: they must agree"
        )
    progress("certify", 0.0)
    certificate, claimed, tolerance = certify_plan(plan, duct), plan.proved, TOLERANCE_MM
    while (
        claimed is not None
        and certificate.resolved
        and certificate.clearance + CLAIM_ROUND_OFF_MM < claimed <= certificate.found
        and tolerance > FINEST_TOLERANCE_MM
    ):
        tolerance *= 0.5
        finer = certify_plan(plan, duct, tolerance=tolerance)
        certificate = finer if finer.clearance > certificate.clearance else certificate
    progress("certify", 1.0)
    checks = (*checks, *_list_wall_checks(plan, duct))
    checks = (*checks, *_run("certificate", _check_claim, plan, duct, certificate))
    second = None
    if wall is not None:
        progress("second check", 0.0)
        second = _run_recheck(plan, wall)
        progress("second check", 1.0)
        checks = (*checks, *_run("second check", _compare, certificate, second))
    return Verification(plan=plan, checks=checks, certificate=certificate, recheck=second)


def check_consistency(plan: Plan) -> tuple[Check, ...]:
    """Check a plan against itself: its motion, and all that it states of it."""
    checks = {
        "links": _check_links,
        "head": _check_head,
        "steps": _check_order,
        "moves": _check_moves,
        "method": check_method,
        "scope": check_scope,
        "ends": _check_ends,
        "introducer": _check_introducer,
        "inflation": _check_inflation,
        "soft wall": check_soft_wall,
        "errors": check_errors,
        "measures": check_measures,
        "closest place": check_certificate,
        "refusal": check_refusal,
    }
    return tuple(item for name, check in checks.items() for item in _run(name, check, plan))


def read_input(plan: Plan, path: str | os.PathLike[str]) -> LabelTract | SurfaceTract:
    """Read a tract as the plan states that its own was read: labels, unit and the like.

    Raises
    ------
    BozziniError
        If the file cannot be read so.
    """
    stated = plan.input or TractInput()
    unit = stated.unit
    labels = None if stated.labels is None else list(stated.labels)

    def read(unit: str | None) -> LabelTract | SurfaceTract:
        return open_tract(
            path,
            labels=labels,
            part=stated.part,
            unit=unit,
            frame=stated.frame,
            repair=bool(stated.repair),
        )

    try:
        return read(unit)
    except InputError:
        # A volume states its own unit; plans state mm of it all the same.
        if unit != "mm":
            raise
        return read(None)


def is_made_from(plan: Plan, path: str | os.PathLike[str]) -> bool | None:
    """Return whether a plan was made from a file; None if it does not state the file's hash."""
    known = None if plan.input is None else plan.input.sha256
    return None if known is None else known == hash_input(path)


def rebuild_field(
    plan: Plan, tract: LabelTract | SurfaceTract, *, progress: Progress = no_progress
) -> SampledField | RefinedField:
    """Sample a tract as the plan states: voxel, inflation, finer nodes, its wall displaced.

    Raises
    ------
    InputError
        If the plan's voxel, inflation or finer grid is not legal for the tract.
    """
    used, soft, stated = plan.displaced, plan.soft_wall, plan.field
    allowed = 0.0 if soft is None else soft.allowed
    rest = max(plan.inflation - used, 0.0)
    voxel = None if plan.input is None else plan.input.voxel
    reach = rest + max(allowed, used)
    field = build_field(tract, voxel=voxel, inflate=rest, reach=reach, progress=progress)
    if stated is None or stated.fine_spacing is None:
        return field.inflate(used)
    spacing = check_number(
        "meta.field.fine_spacing_mm", stated.fine_spacing, low=FINE_SPACING_MIN_MM, unit="mm"
    )
    distance = check_number(
        "meta.field.fine_distance_mm",
        stated.fine_distance or 0.0,
        low=0.0,
        high=FINE_DISTANCE_MAX_MM,
        unit="mm",
    )
    if plan.centreline is None:
        raise InputError("the plan has a finer grid about its centreline, but no centreline")
    points = plan.centreline.points
    finer = refine_field(
        field, tract, line_points_world=points, voxel=spacing, distance=distance, progress=progress
    )
    return finer.inflate(used)


def build_wall(tract: LabelTract | SurfaceTract) -> TriangleWall:
    """Return the wall of a tract for the second check, before inflation."""
    if isinstance(tract, LabelTract):
        return voxel_wall(tract.mask, tract.affine)
    return surface_wall(tract.vertices, tract.faces)


def _run_recheck(plan: Plan, wall: TriangleWall) -> Recheck:
    introducer, tube = plan.introducer, None
    if introducer is not None:
        tube = EntryTube(entry=introducer.entry, outward=introducer.outward, bore=introducer.bore)
    radius = plan.get_scope().radius
    return recheck_motion(plan.joints, wall, radius=radius, tube=tube, inflation=plan.inflation)


def _run(name: str, check: Callable[..., str | None], *given: object) -> tuple[Check, ...]:
    """Return the outcome of a check, which returns what it found or raises `FaultError`."""
    try:
        message = check(*given)
    except FaultError as fault:
        return (Check(name=name, ok=False, message=str(fault)),)
    return () if message is None else (Check(name=name, ok=True, message=message),)


def _check_source(plan: Plan, path: str | os.PathLike[str]) -> str:
    given, digest = plan.input or TractInput(), hash_input(path)
    if given.sha256 is None:
        # The command line always states both; only a plan made in Python states neither.
        if given.file is not None:
            raise FaultError(
                f"the plan does not state the sha256 of its file; this one's is {digest}"
            )
        return "the plan does not state from which file it was made: what follows is for this one"
    if digest != given.sha256:
        raise FaultError(
            f"the plan was made from another file: its sha256 is {given.sha256}, this one's "
            f"{digest}"
        )
    return f"the plan was made from this file ({digest})"


def _check_links(plan: Plan) -> str:
    if plan.scope is None:
        raise FaultError("the plan does not state its link length")
    length = plan.scope.link_length
    sizes = np.linalg.norm(np.diff(plan.joints, axis=1), axis=2)
    off = np.abs(sizes - length)
    step, link = np.unravel_index(int(np.argmax(off)), off.shape)
    if off.max() > LENGTH_ROUND_OFF_MM:
        raise FaultError(
            f"link {link + 1} is {sizes[step, link]:.4f} mm long at step {step}: it must be "
            f"{length:g} mm"
        )
    return f"{plan.links} of {length:g} mm at all {plan.steps} steps, to within {off.max():.1g} mm"


def _check_head(plan: Plan) -> str:
    arc = measure_arc_length(plan.path)
    off = float(np.abs(arc - plan.path_arc_length).max())
    if off > ROUND_OFF_MM:
        raise FaultError(f"path_arc_length is {off:.3g} mm off the length of the path's points")
    low, high = float(plan.head_arc_length.min()), float(plan.head_arc_length.max())
    if low < -ROUND_OFF_MM or high > arc[-1] + ROUND_OFF_MM:
        raise FaultError(f"it goes from {low:g} to {high:g} mm: its path ends at {arc[-1]:g} mm")
    place = np.stack([np.interp(plan.head_arc_length, arc, column) for column in plan.path.T], 1)
    miss = np.linalg.norm(plan.joints[:, 0] - place, axis=1)
    step = int(np.argmax(miss))
    if miss[step] > ROUND_OFF_MM:
        raise FaultError(f"at step {step} the head is {miss[step]:.3g} mm off its path")
    return f"on its path at all steps; {plan.inserted:.1f} mm of {arc[-1]:.1f} mm of it"


def _follow_route(plan: Plan) -> Iterator[tuple[float, int, int, bool]]:
    """Give of each target of the route where it is, from and to which step, and if it is met."""
    at = 0
    for share in plan.route:
        target = share * float(plan.path_arc_length[-1])
        there = np.flatnonzero(np.abs(plan.head_arc_length[at:] - target) <= ROUND_OFF_MM)
        stop = at + int(there[0]) if len(there) else plan.steps - 1
        yield target, at, stop, len(there) > 0
        at = stop
        if not len(there):
            return


def _check_order(plan: Plan) -> str:
    """Check that the head goes from target to target of its route, in steps as stated."""
    heads, stated = plan.head_arc_length, plan.options
    largest = float(np.abs(np.diff(heads)).max(initial=0.0))
    if abs(heads[0]) > ROUND_OFF_MM:
        raise FaultError(
            f"the motion begins with the head at {heads[0]:g} mm: it must begin at 0 mm"
        )
    if stated is not None and largest > stated.head_step + 1e-6:
        raise FaultError(
            f"the head moves {largest:.4g} mm in a step: the plan states {stated.head_step:g} mm"
        )
    at, met = 0, True
    for target, begin, at, met in _follow_route(plan):  # noqa: B007
        _check_spread(plan, target, begin, at)
        # All steps go towards this target, until one stands there.
        away = np.diff(np.abs(heads[begin : at + 1] - target))
        if (away > ROUND_OFF_MM).any():
            step = begin + int(np.argmax(away)) + 1
            raise FaultError(
                f"at step {step} the head moves away from {target:.1f} mm, where its route leads"
            )
    if met and np.abs(heads[at:] - heads[at]).max() > ROUND_OFF_MM:
        raise FaultError(f"the head moves on after step {at}, where its route has ended")
    if not met and plan.status == "complete":
        end = plan.route[-1] * float(plan.path_arc_length[-1])
        raise FaultError(
            f"the plan is called complete, but its route ends at {end:.1f} mm and the head at "
            f"{heads[-1]:.1f} mm"
        )
    return f"{plan.steps} along the route, the head up to {ceil_mm(largest, 3)} mm each"


def _check_spread(plan: Plan, target: float, begin: int, end: int) -> None:
    """Check that steps towards a target are as many as the stated head step takes."""
    if plan.options is None or plan.replan is not None or plan.method not in SPREADING:
        return
    moves = np.abs(np.diff(plan.head_arc_length[begin : end + 1]))
    way = abs(target - float(plan.head_arc_length[begin]))
    each = way / max(1.0, np.ceil(way / plan.options.head_step - 1e-9))
    if len(moves) and abs(float(moves.max()) - each) > ROUND_OFF_MM:
        shown = show_apart(float(moves.max()), each, digits=4)
        raise FaultError(
            f"the head moves {shown[0]} mm in a step: with the stated head_step_mm of "
            f"{plan.options.head_step:g} it is {shown[1]} mm"
        )


def _check_ends(plan: Plan) -> str | None:
    """Check that the path leads from the entry of the stated centreline to its goal."""
    if plan.centreline is None:
        return None
    points = plan.centreline.points
    if points.shape[1] != plan.path.shape[1]:
        raise FaultError(f"the centreline has shape {points.shape}: it must be as the path")
    first, last = (float(np.linalg.norm(plan.path[at] - points[at])) for at in (0, -1))
    if first > STATED_ROUND_OFF_MM:
        raise FaultError(f"the path begins {first:.3g} mm from where the centreline begins")
    reached = last <= STATED_ROUND_OFF_MM
    if plan.status == "complete" and not reached:
        raise FaultError(
            f"the plan is called complete, but its path ends {last:.3g} mm from the end of the "
            "centreline"
        )
    if plan.status == "stopped" and reached and all(met for *_, met in _follow_route(plan)):
        raise FaultError("the plan is called stopped, but its head goes the whole way to the goal")
    check_named_ends(plan)
    rest = " and ends at its end" if reached else f", and ends {last:.1f} mm short"
    return f"the path begins where the centreline begins{rest}"


def _check_inflation(plan: Plan) -> str | None:
    """Check the wall's inflation against what was asked for and what the soft wall used."""
    asked = None if plan.input is None else plan.input.inflate
    if asked is None:
        return None
    total, used = plan.inflation, plan.displaced
    if not abs(total - asked - used) <= ROUND_OFF_MM:
        raise FaultError(
            f"the wall is inflated by {total:g} mm, but {asked:g} mm were asked for and the soft "
            f"wall used {used:g} mm"
        )
    return f"the wall is inflated by {total:g} mm, as stated"


def _check_moves(plan: Plan) -> str:
    moves = np.linalg.norm(np.diff(plan.joints, axis=0), axis=2)
    largest = float(moves.max(initial=0.0))
    stated = None if plan.measures is None else plan.measures.joint_step_max
    if stated is not None and largest > stated + 1e-6:
        step, joint = np.unravel_index(int(np.argmax(moves)), moves.shape)
        shown = show_apart(largest, stated, digits=4)
        raise FaultError(
            f"joint {joint} moves {shown[0]} mm between steps {step} and {step + 1}: the plan "
            f"states at most {shown[1]} mm"
        )
    limit = None if plan.options is None else plan.options.angle_limit
    if limit is not None and plan.links > 1:
        angle = float(measure_angles(plan.joints).max())
        if angle > limit + 1e-6:
            shown = show_apart(np.degrees(angle), np.degrees(limit), digits=2, form="f")
            raise FaultError(
                f"neighbouring links turn by {shown[0]} deg: the plan states at most {shown[1]} deg"
            )
    return f"joints move up to {ceil_mm(largest, 3)} mm between two steps"


def _check_introducer(plan: Plan) -> str | None:
    introducer = plan.introducer
    if introducer is None:
        return None
    off = float(np.linalg.norm(introducer.entry - plan.path[0]))
    if off > ROUND_OFF_MM:
        raise FaultError(f"it ends {off:.3g} mm from where the path begins")
    length = 0.0 if plan.scope is None else plan.scope.link_length
    first = plan.path[plan.path_arc_length <= max(length, float(plan.path_arc_length[1]))]
    inward = first.mean(axis=0) - plan.path[0]
    if float(inward @ introducer.outward) >= 0.0:
        raise FaultError("it does not lead out of the tract: the path begins along it")
    depth = float(((plan.joints[:, -1] - introducer.entry) @ -introducer.outward).max())
    if depth > length + ROUND_OFF_MM:
        raise FaultError(
            f"the last joint gets {depth:.1f} mm past the entry: the scope is too short for that"
        )
    return f"a straight tube of {introducer.bore:.2f} mm radius that ends where the path begins"


def _is_same_grid(plan: Plan, duct: Duct) -> bool | None:
    """Whether a duct is sampled as the plan states; None where it states no grid."""
    stated, grid = plan.field, grid_of(duct)
    if grid is None or stated is None or stated.spacing is None:
        return None
    same = len(stated.spacing) == 3 and np.allclose(stated.spacing, grid.spacing, rtol=1e-6)
    fine = isinstance(duct, RefinedField)
    return bool(
        same
        and stated.nodes == tuple(grid.values.shape)
        and (stated.fine_spacing is not None) == fine
    )


def _is_same_field(plan: Plan, duct: Duct) -> bool:
    """Whether a duct is sampled as the plan states, or neither is sampled and both are inflated."""
    if plan.field is None or abs(plan.inflation - duct.inflation) > ROUND_OFF_MM:
        return False
    same = _is_same_grid(plan, duct)
    return same or (same is None and grid_of(duct) is None and plan.field.kind == duct.kind)


def _check_grid(plan: Plan, field: SampledField | RefinedField) -> str:
    grid = field.coarse if isinstance(field, RefinedField) else field
    same = _is_same_grid(plan, field)
    size = " x ".join(str(count) for count in grid.values.shape)
    message = f"{size} nodes, {float(grid.spacing.max()):.4g} mm apart"
    if same is None:
        return f"{message}; the plan states none"
    if not same:
        raise FaultError(
            f"{message}; the plan states another grid, so it was not made from this input so read"
        )
    return f"{message}, as stated"


def _list_wall_checks(plan: Plan, duct: Duct) -> tuple[Check, ...]:
    """Check what the plan states of the wall: inflation, errors, bore, and clearances."""
    checks = [*_run("wall", _check_wall, plan, duct)]
    if _is_same_field(plan, duct):
        checks += _run("field", compare_field, plan, duct)
        checks += _run("wall", compare_wall, plan, duct)
        checks += _run("path", compare_path, plan, duct)
        checks += _run("passage", compare_passage, plan, duct)
    if plan.introducer is not None and plan.scope is not None:
        checks += _run("bore", _check_bore, plan, duct)
        checks += _run("clearances", _check_clearances, plan, duct)
    return tuple(checks)


def _check_wall(plan: Plan, duct: Duct) -> None:
    stated = plan.inflation
    if abs(stated - duct.inflation) > ROUND_OFF_MM:
        raise FaultError(
            f"the plan inflates the wall by {stated:g} mm, this one by {duct.inflation:g} mm"
        )


def _check_bore(plan: Plan, duct: Duct) -> None:
    introducer, radius = plan.get_introducer(), plan.get_scope().radius
    offered = float(duct.clearance_bound(introducer.entry))
    # A scope that is too thick for the entry stands before it, in a tube of its own radius.
    least = radius if plan.inserted <= ROUND_OFF_MM else 0.0
    if introducer.bore > max(offered, least) + ROUND_OFF_MM:
        shown = show_apart(introducer.bore, offered, digits=3, form="f")
        raise FaultError(
            f"the introducer's bore is {shown[0]} mm: the lumen at the entry offers {shown[1]} mm"
        )


def _check_clearances(plan: Plan, duct: Duct) -> str | None:
    rest = duct
    if plan.displaced > 0.0:
        if not isinstance(duct, (SampledField, RefinedField)):
            return None
        rest = duct.inflate(-plan.displaced)
    space = FreeSpace(rest, introducer=plan.introducer)
    anew, worst = measure_body(space, plan.joints, plan.get_scope())
    error = 0.0 if plan.field is None else plan.field.clearance_error or 0.0
    over = _subtract(plan.clearance, anew)
    step, link = np.unravel_index(int(np.argmax(over)), over.shape)
    most = float(over[step, link])
    same = _is_same_grid(plan, duct)
    if most <= ROUND_OFF_MM and same:
        # The same samples of the same field: they must agree.
        under = _subtract(np.where(np.isinf(anew), -np.inf, anew), plan.clearance)
        step, link = np.unravel_index(int(np.argmax(under)), under.shape)
        most, error = float(under[step, link]), 0.0
    if not most <= min(error, duct.error) + ROUND_OFF_MM:
        raise FaultError(
            f"link {link + 1} at step {step} is stated to have {plan.clearance[step, link]:.3f} "
            f"mm, but has {anew[step, link]:.3f} mm"
        )
    if same:
        compare_place(plan, worst)
    return f"none is stated {'otherwise' if same else 'larger'} than it is found anew"


def _subtract(stated: NDArray[np.float64], anew: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by how much clearances are overstated; infinite ones are those not measured."""
    free = np.isinf(anew)
    over: NDArray[np.float64] = np.where(free, -np.inf, stated - np.where(free, 0.0, anew))
    return over


def _check_claim(plan: Plan, duct: Duct, certificate: Certificate) -> str:
    proof, claimed = certificate.clearance, plan.proved
    if proof == np.inf:
        message = "the scope never leaves the introducer: there is no proof"
        if claimed is not None:
            raise FaultError(message)
        return message
    if claimed is None:
        if not certificate.certified:
            return "the plan claims no proof, and none is found"
        return f"the plan claims no proof, but {floor_mm(proof, 3)} mm are proved"
    if claimed > proof + CLAIM_ROUND_OFF_MM:
        shown = show_apart(claimed, float(floor_mm(proof, 3)), digits=3, form="f")
        anew = f"{shown[1]} mm are proved" if certificate.certified else "nothing is proved"
        raise FaultError(f"the plan claims {shown[0]} mm: anew {anew}")
    stated = plan.certificate
    if stated is not None and certificate.resolved and not stated.resolved:
        raise FaultError("the plan states that its proof was not settled: anew it is")
    found = np.inf if stated is None else stated.found
    if proof > found + ROUND_OFF_MM and _is_same_grid(plan, duct):
        raise FaultError(
            f"the plan states a place of the body with {ceil_mm(found, 3)} mm: anew "
            f"{floor_mm(proof, 3)} mm are "
            "proved everywhere, so this is another scope, wall or motion"
        )
    return f"the plan claims {floor_mm(claimed, 3)} mm: anew {floor_mm(proof, 3)} mm are proved"


def _compare(certificate: Certificate, second: Recheck) -> str:
    counted = f"{second.samples:,} exact distances"
    place = f"(step {second.step:g}, link {second.link})"
    if not second.resolved:
        raise FaultError(f"not settled by {counted}")
    if certificate.certified and certificate.clearance > second.found + CLAIM_ROUND_OFF_MM:
        raise FaultError(
            f"a point of the body has {second.found:.3f} mm, less than the certificate {place}"
        )
    if not second.clear:
        message = (
            f"by {counted} the body comes to {second.found:.3f} mm {place}: not shown to be clear"
        )
        if certificate.certified:
            raise FaultError(message)
        return message
    ends = f"{floor_mm(second.lower, 3)} and {ceil_mm(second.found, 3)} mm"
    return f"by {counted} the clearance lies between {ends}"

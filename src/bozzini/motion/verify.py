"""Whether what a saved plan claims is so: consistency, its input, and the proof made anew."""

from __future__ import annotations

import inspect
import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..anatomy.read import hash_input, read_tract
from ..anatomy.tract import LabelTract, SurfaceTract
from ..checks import check_number, check_points
from ..duct.base import Duct, count_dimensions
from ..duct.field import RefinedField, SampledField, build_field, refine_field
from ..errors import FileFormatError, InputError
from ..numeric.polylines import measure_arc_length
from ..progress import Progress, no_progress
from .certify import TOLERANCE, Certificate, certify_plan
from .insertion import METHODS, measure_body
from .introducer import Introducer
from .measures import measure_angles
from .plan import SLACK, Plan, read_route
from .recheck import Recheck, Tube, Wall, recheck_motion, surface_wall, voxel_wall
from .scope import Scope
from .tube import grid_of

__all__ = [
    "Check",
    "Verification",
    "build_wall",
    "check_consistency",
    "read_input",
    "rebuild_field",
    "verify_file",
    "verify_plan",
]

LENGTH_SLACK = 1e-4
"""How far a link may be off its length [mm]."""

CLAIM_SLACK = 1e-6
"""How far a claimed clearance may lie above the one proved anew, by rounding [mm]."""

ROUNDED = 0.01
"""How far the ends of a path may be off those of its centreline, which is stated rounded [mm]."""

FINE_MIN, DISTANCE_MAX = 0.25, 20.0
"""Least spacing of a plan's finer grid, and how far from the centreline it may reach [mm]."""

FINEST = 0.005
"""Tolerance of the certificate to which a claim is followed [mm]."""


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Verification:
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
    """

    plan: Plan
    checks: tuple[Check, ...]
    certificate: Certificate | None = None
    recheck: Recheck | None = None

    @property
    def consistent(self) -> bool:
        """Whether no check failed."""
        return all(check.ok for check in self.checks)

    @property
    def certified(self) -> bool:
        """Whether the motion is proved clear of the wall, and nothing in the plan is wrong."""
        proved = self.certificate is not None and self.certificate.certified
        return proved and self.consistent

    def describe(self) -> dict[str, Any]:
        """Return the result as JSON-able values; ``certified`` is None without the wall."""
        meta, proof, second = self.plan.meta, self.certificate, self.recheck
        return {
            "consistent": self.consistent,
            "certified": None if proof is None else self.certified,
            "claimed": bool(meta.get("certified", False)),
            "clearance_claimed_mm": _read_claim(self.plan),
            "clearance_certified_mm": (
                proof.clearance if proof is not None and proof.certified else None
            ),
            "status": self.plan.status,
            "reason_code": self.plan.reason_code,
            "method": self.plan.method,
            "inserted_mm": self.plan.inserted,
            "path_length_mm": float(self.plan.path_arc_length[-1]),
            "steps": self.plan.steps,
            "links": self.plan.links,
            "scope": meta.get("scope"),
            "inflation_mm": _read_number(meta, "field", "inflation_mm"),
            "soft_wall_mm": _read_number(meta, "soft_wall", "used_mm"),
            "wall": None if proof is None else proof.wall,
            "checks": [
                {"name": item.name, "ok": item.ok, "message": item.message} for item in self.checks
            ],
            "second_check": None
            if second is None
            else {
                "clear": second.clear,
                "clearance_mm": second.lower if np.isfinite(second.lower) else None,
                "found_mm": second.found if np.isfinite(second.found) else None,
                "step": second.step,
                "link": second.link,
                "place_mm": [float(v) for v in second.place],
                "samples": second.samples,
                "resolved": second.resolved,
            },
        }


def verify_file(
    plan: Plan,
    path: str | os.PathLike[str],
    *,
    independent: bool = False,
    progress: Progress = no_progress,
) -> Verification:
    """Check a plan against the file that it was made from, read as the plan says it was.

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
        If the file cannot be read as the plan says.
    """
    if plan.joints.shape[2] != 3:
        raise InputError("the plan has 2 dimensions: a file holds a tract in 3")
    progress("read", 0.0)
    source = _check_source(plan, path)
    if not source.ok:  # what another file offers says nothing about this plan
        return Verification(plan=plan, checks=(source,))
    tract = read_input(plan, path)
    field = rebuild_field(plan, tract, progress=progress)
    wall = build_wall(tract) if independent else None
    result = verify_plan(plan, field, wall=wall, progress=progress)
    return Verification(
        plan=plan,
        checks=(*result.checks[:1], source, _check_grid(plan, field), *result.checks[1:]),
        certificate=result.certificate,
        recheck=result.recheck,
    )


def verify_plan(
    plan: Plan,
    duct: Duct | None = None,
    *,
    wall: Wall | None = None,
    progress: Progress = no_progress,
) -> Verification:
    """Check whether a plan agrees with itself and, given the lumen, certify it anew.

    Parameters
    ----------
    plan : Plan
        Nothing in it is trusted: what it says of its clearance is compared with what is found.
    duct : Duct, optional
        The lumen, inflated as the plan says. Without it nothing is said about the wall.
    wall : Wall, optional
        The wall before inflation, for the second check; see `build_wall`.
    progress : Progress

    Raises
    ------
    InputError
        If the duct has not the plan's dimensions, or the plan lacks its scope.
    """
    checks = check_consistency(plan)
    if duct is None:
        return Verification(plan=plan, checks=checks)
    if plan.joints.shape[2] != count_dimensions(duct):
        raise InputError(
            f"the plan has {plan.joints.shape[2]} dimensions, the duct has "
            f"{count_dimensions(duct)}: they must agree"
        )
    progress("certify", 0.0)
    certificate = certify_plan(plan, duct)
    claimed = _read_claim(plan)
    tolerance = TOLERANCE
    while (
        claimed is not None
        and certificate.resolved
        and certificate.clearance + CLAIM_SLACK < claimed <= certificate.found
        and tolerance > FINEST
    ):
        tolerance *= 0.5
        finer = certify_plan(plan, duct, tolerance=tolerance)
        certificate = finer if finer.clearance > certificate.clearance else certificate
    progress("certify", 1.0)
    checks = (*checks, *_check_wall(plan, duct), _check_claim(plan, duct, certificate, claimed))
    second = None
    if wall is not None:
        progress("second check", 0.0)
        second = _run_recheck(plan, wall)
        progress("second check", 1.0)
        checks = (*checks, _compare(certificate, second))
    return Verification(plan=plan, checks=checks, certificate=certificate, recheck=second)


def check_consistency(plan: Plan) -> tuple[Check, ...]:
    """Check a plan against itself: links, head, steps, ends, inflation, introducer, measures."""
    return (
        _check_links(plan),
        _check_head(plan),
        _check_order(plan),
        _check_moves(plan),
        *_check_method(plan),
        *_check_ends(plan),
        *_check_introducer(plan),
        *_check_inflation(plan),
        *_check_measures(plan),
    )


def read_input(plan: Plan, path: str | os.PathLike[str]) -> LabelTract | SurfaceTract:
    """Read a tract as the plan says that its own was read: labels, unit and what else it names.

    Raises
    ------
    BozziniError
        If the file cannot be read so.
    """
    stated = plan.meta.get("input") or {}
    options: dict[str, Any] = {}
    for key, kinds in _READ_OPTIONS.items():
        value = stated.get(key)
        if value is None or value is False:
            continue
        items = value if key == "labels" or (key == "part" and type(value) is list) else [value]
        if not isinstance(items, list) or not items or not all(type(v) in kinds for v in items):
            raise FileFormatError(
                f"the plan's meta.input.{key} is {value!r}: it is nothing to read a tract with"
            )
        options[key] = value
    known = inspect.signature(read_tract).parameters
    for key in options:
        if key not in known:
            raise InputError(f"the plan's input was read with {key}: this version cannot do that")
    try:
        return read_tract(path, **options)
    except InputError:
        # A volume states its own unit; plans say mm of it all the same.
        if options.pop("unit", None) != "mm":
            raise
        return read_tract(path, **options)


_READ_OPTIONS: dict[str, tuple[type, ...]] = {
    "labels": (int, str),
    "part": (int, str),
    "unit": (str,),
    "frame": (str,),
    "repair": (bool,),
}
"""What of ``meta.input`` is given on to `read_tract`, and of what type it is."""


def rebuild_field(
    plan: Plan, tract: LabelTract | SurfaceTract, *, progress: Progress = no_progress
) -> SampledField | RefinedField:
    """Sample a tract as the plan says: its voxel, inflation and finer nodes, its wall displaced.

    Raises
    ------
    InputError
        If the plan's voxel, inflation or finer grid is not legal for the tract.
    """
    voxel = (plan.meta.get("input") or {}).get("voxel_mm")
    total = _read_number(plan.meta, "field", "inflation_mm") or 0.0
    used = _read_number(plan.meta, "soft_wall", "used_mm") or 0.0
    allowed = _read_number(plan.meta, "soft_wall", "allowed_mm") or 0.0
    rest = max(total - used, 0.0)
    reach = rest + max(allowed, used)
    field = build_field(tract, voxel=voxel, inflate=rest, reach=reach, progress=progress)
    fine = (plan.meta.get("field") or {}).get("fine_spacing_mm")
    if fine is None:
        return field.inflate(used)
    spacing = check_number("meta.field.fine_spacing_mm", fine, low=FINE_MIN, unit="mm")
    distance = check_number(
        "meta.field.fine_distance_mm",
        plan.meta["field"].get("fine_distance_mm"),
        low=0.0,
        high=DISTANCE_MAX,
        unit="mm",
    )
    line = plan.meta.get("centreline")
    stated: Any = line.get("points_mm") if isinstance(line, dict) else None
    points = check_points("meta.centreline.points_mm", stated)
    finer = refine_field(field, tract, points, voxel=spacing, distance=distance, progress=progress)
    return finer.inflate(used)


def build_wall(tract: LabelTract | SurfaceTract) -> Wall:
    """Return the wall of a tract for the second check, before inflation."""
    if isinstance(tract, LabelTract):
        return voxel_wall(tract.mask, tract.affine)
    return surface_wall(tract.vertices, tract.faces)


def _run_recheck(plan: Plan, wall: Wall) -> Recheck:
    introducer, tube = _read_introducer(plan), None
    if introducer is not None:
        tube = Tube(entry=introducer.entry, outward=introducer.outward, bore=introducer.bore)
    return recheck_motion(
        plan.joints,
        wall,
        radius=0.5 * float(plan.meta["scope"]["diameter_mm"]),
        tube=tube,
        inflation=_read_number(plan.meta, "field", "inflation_mm") or 0.0,
    )


def _read_number(meta: dict[str, Any], key: str, name: str) -> float | None:
    value = (meta.get(key) or {}).get(name)
    return None if value is None else float(value)


def _read_claim(plan: Plan) -> float | None:
    """Return the clearance that the plan says is certified [mm], or None."""
    if not plan.meta.get("certified"):
        return None
    return _read_number(plan.meta, "certificate", "clearance_mm")


def _read_introducer(plan: Plan) -> Introducer | None:
    given = plan.meta.get("introducer")
    return None if given is None else Introducer.from_description(given)


def _check_source(plan: Plan, path: str | os.PathLike[str]) -> Check:
    given = plan.meta.get("input") or {}
    stated = given.get("sha256")
    digest = hash_input(path)
    if stated is None:
        # The command line always states both; only a plan made in Python states neither.
        message = "the plan does not state from which file it was made"
        if "sha256" in given or "file" in given:
            message = f"the plan does not state the sha256 of its file; this one's is {digest}"
            return Check(name="input", ok=False, message=message)
        return Check(name="input", ok=True, message=f"{message}: what follows is for this one")
    if digest == stated:
        return Check(name="input", ok=True, message=f"the plan was made from this file ({digest})")
    return Check(
        name="input",
        ok=False,
        message=f"the plan was made from another file: its sha256 is {stated}, this one's {digest}",
    )


def _check_links(plan: Plan) -> Check:
    length = _read_number(plan.meta, "scope", "link_length_mm")
    sizes = np.linalg.norm(np.diff(plan.joints, axis=1), axis=2)
    if length is None:
        return Check(name="links", ok=False, message="the plan does not state its link length")
    off = np.abs(sizes - length)
    step, link = np.unravel_index(int(np.argmax(off)), off.shape)
    if off.max() > LENGTH_SLACK:
        return Check(
            name="links",
            ok=False,
            message=f"link {link + 1} is {sizes[step, link]:.4f} mm long at step {step}: it must "
            f"be {length:g} mm",
        )
    return Check(
        name="links",
        ok=True,
        message=f"{plan.links} of {length:g} mm at all {plan.steps} steps, to within "
        f"{off.max():.1g} mm",
    )


def _check_head(plan: Plan) -> Check:
    arc = measure_arc_length(plan.path)
    off = float(np.abs(arc - plan.path_arc_length).max())
    if off > SLACK:
        return Check(
            name="head",
            ok=False,
            message=f"path_arc_length is {off:.3g} mm off the length of the path's points",
        )
    low, high = float(plan.head_arc_length.min()), float(plan.head_arc_length.max())
    if low < -SLACK or high > arc[-1] + SLACK:
        return Check(
            name="head",
            ok=False,
            message=f"it goes from {low:g} to {high:g} mm: its path ends at {arc[-1]:g} mm",
        )
    place = np.stack([np.interp(plan.head_arc_length, arc, column) for column in plan.path.T], 1)
    miss = np.linalg.norm(plan.joints[:, 0] - place, axis=1)
    step = int(np.argmax(miss))
    if miss[step] > SLACK:
        return Check(
            name="head",
            ok=False,
            message=f"at step {step} the head is {miss[step]:.3g} mm off its path",
        )
    return Check(
        name="head",
        ok=True,
        message=f"on its path at all steps; {plan.inserted:.1f} mm of {arc[-1]:.1f} mm of it",
    )


def _check_order(plan: Plan) -> Check:
    """Check that the head goes from target to target of its route, in steps as stated."""
    heads, end = plan.head_arc_length, float(plan.path_arc_length[-1])
    targets = [share * end for share in read_route(plan)]
    moves = np.diff(heads)
    stated = plan.meta.get("head_step_mm")
    largest = float(np.abs(moves).max(initial=0.0))

    def fail(message: str) -> Check:
        return Check(name="steps", ok=False, message=message)

    if abs(heads[0]) > SLACK:
        return fail(f"the motion begins with the head at {heads[0]:g} mm: it must begin at 0 mm")
    if stated is not None and largest > float(stated) + 1e-6:
        return fail(f"the head moves {largest:.4g} mm in a step: the plan states {stated:g} mm")
    at, goal = 0, 0
    while goal < len(targets):
        # From here on all steps go towards this target, until one stands there.
        rest = np.abs(heads[at:] - targets[goal])
        there = np.flatnonzero(rest <= SLACK)
        stop = at + int(there[0]) if len(there) else len(heads) - 1
        if (np.diff(np.abs(heads[at : stop + 1] - targets[goal])) > SLACK).any():
            step = at + int(np.argmax(np.diff(rest[: stop - at + 1]))) + 1
            return fail(
                f"at step {step} the head moves away from {targets[goal]:.1f} mm, where its route "
                "leads"
            )
        at = stop
        if not len(there):
            break
        goal += 1
    if goal == len(targets) and np.abs(heads[at:] - heads[at]).max() > SLACK:
        return fail(f"the head moves on after step {at}, where its route has ended")
    if goal < len(targets) and plan.status == "complete":
        return fail(
            f"the plan is called complete, but its route ends at {targets[-1]:.1f} mm and the "
            f"head at {heads[-1]:.1f} mm"
        )
    return Check(
        name="steps",
        ok=True,
        message=f"{plan.steps} along the route, the head up to {largest:.3g} mm each",
    )


def _has_ended(plan: Plan) -> bool:
    """Whether the head comes to all targets of its route, in their order."""
    at = 0
    for share in read_route(plan):
        rest = np.abs(plan.head_arc_length[at:] - share * plan.path_arc_length[-1])
        there = np.flatnonzero(rest <= SLACK)
        if not len(there):
            return False
        at += int(there[0])
    return True


def _check_method(plan: Plan) -> tuple[Check, ...]:
    if plan.method in METHODS:
        return ()
    message = f"{plan.method!r} is none of this package's planners: only its motion is judged"
    return (Check(name="method", ok=True, message=message),)


def _check_ends(plan: Plan) -> tuple[Check, ...]:
    """Check that the path leads from the entry of the stated centreline to its goal."""
    line = plan.meta.get("centreline")
    if line is None:
        return ()

    def fail(message: str) -> tuple[Check, ...]:
        return (Check(name="ends", ok=False, message=message),)

    stated: Any = line.get("points_mm") if isinstance(line, dict) else None
    points = check_points("meta.centreline.points_mm", stated, dim=plan.path.shape[1])
    if points.ndim != 2 or len(points) < 2:
        return fail(f"the centreline has shape {points.shape}: it must have at least 2 points")
    first, last = (float(np.linalg.norm(plan.path[at] - points[at])) for at in (0, -1))
    if first > ROUNDED:
        return fail(f"the path begins {first:.3g} mm from where the centreline begins")
    if plan.status == "complete" and last > ROUNDED:
        return fail(
            f"the plan is called complete, but its path ends {last:.3g} mm from the end of the "
            "centreline"
        )
    if plan.status == "stopped" and last <= ROUNDED and _has_ended(plan):
        return fail("the plan is called stopped, but its head goes the whole way to the goal")
    return (
        Check(
            name="ends",
            ok=True,
            message="the path begins where the centreline begins"
            + (" and ends where it ends" if last <= ROUNDED else f", and ends {last:.1f} mm short"),
        ),
    )


def _check_inflation(plan: Plan) -> tuple[Check, ...]:
    """Check the wall's inflation against what was asked for and what the soft wall used."""
    asked = _read_number(plan.meta, "input", "inflate_mm")
    if asked is None:
        return ()
    total = _read_number(plan.meta, "field", "inflation_mm") or 0.0
    used = _read_number(plan.meta, "soft_wall", "used_mm") or 0.0
    ok = abs(total - asked - used) <= SLACK
    message = (
        f"the wall is inflated by {total:g} mm, as stated"
        if ok
        else f"the wall is inflated by {total:g} mm, but {asked:g} mm were asked for and the soft "
        f"wall used {used:g} mm"
    )
    return (Check(name="inflation", ok=ok, message=message),)


def _check_moves(plan: Plan) -> Check:
    moves = np.linalg.norm(np.diff(plan.joints, axis=0), axis=2)
    largest = float(moves.max(initial=0.0))
    stated = _read_number(plan.meta, "measures", "joint_step_max_mm")
    if stated is not None and largest > stated + 1e-6:
        step, joint = np.unravel_index(int(np.argmax(moves)), moves.shape)
        return Check(
            name="moves",
            ok=False,
            message=f"joint {joint} moves {largest:.4g} mm between steps {step} and {step + 1}: "
            f"the plan states at most {stated:.4g} mm",
        )
    limit = (plan.meta.get("options") or {}).get("angle_limit_rad")
    if limit is not None and plan.links > 1:
        angle = float(measure_angles(plan.joints).max())
        if not isinstance(limit, (int, float)) or angle > limit + 1e-6:
            return Check(
                name="moves",
                ok=False,
                message=f"neighbouring links turn by {np.degrees(angle):.2f} deg: the plan states "
                f"at most {limit!r} rad",
            )
    return Check(
        name="moves", ok=True, message=f"joints move up to {largest:.3g} mm between two steps"
    )


def _check_introducer(plan: Plan) -> tuple[Check, ...]:
    introducer = _read_introducer(plan)
    if introducer is None:
        return ()

    def fail(message: str) -> tuple[Check, ...]:
        return (Check(name="introducer", ok=False, message=message),)

    off = float(np.linalg.norm(introducer.entry - plan.path[0]))
    if off > SLACK:
        return fail(f"it ends {off:.3g} mm from where the path begins")
    length = _read_number(plan.meta, "scope", "link_length_mm") or 0.0
    first = plan.path[plan.path_arc_length <= max(length, float(plan.path_arc_length[1]))]
    inward = first.mean(axis=0) - plan.path[0]
    if float(inward @ introducer.outward) >= 0.0:
        return fail("it does not lead out of the tract: the path begins along it")
    depth = float(((plan.joints[:, -1] - introducer.entry) @ -introducer.outward).max())
    if depth > length + SLACK:
        return fail(
            f"the last joint gets {depth:.1f} mm past the entry: the scope is too short for that"
        )
    return (
        Check(
            name="introducer",
            ok=True,
            message=f"a straight tube of {introducer.bore:.2f} mm radius that ends where the path "
            "begins",
        ),
    )


def _check_measures(plan: Plan) -> tuple[Check, ...]:
    stated = _read_number(plan.meta, "measures", "clearance_min_mm")
    least = plan.clearance_min
    if stated is None or not np.isfinite(least):
        return ()
    ok = abs(stated - least) <= 1e-6
    message = (
        f"the smallest estimated clearance is {least:.3f} mm, as stated"
        if ok
        else f"the plan states {stated:.3f} mm as its smallest clearance, its steps have "
        f"{least:.3f} mm"
    )
    return (Check(name="measures", ok=ok, message=message),)


def _is_same_grid(plan: Plan, duct: Duct) -> bool | None:
    """Whether a duct is sampled as the plan states; None where it states no grid."""
    stated = plan.meta.get("field") or {}
    grid = grid_of(duct)
    if grid is None or "spacing_mm" not in stated:
        return None
    spacing = [float(value) for value in grid.spacing]
    try:
        same = bool(np.allclose(np.array(stated["spacing_mm"], float), spacing, rtol=1e-6))
    except (TypeError, ValueError):
        return False
    fine = isinstance(duct, RefinedField)
    return (
        same
        and stated.get("nodes") == list(grid.values.shape)
        and (stated.get("fine_spacing_mm") is not None) == fine
    )


def _check_grid(plan: Plan, field: SampledField | RefinedField) -> Check:
    grid = field.coarse if isinstance(field, RefinedField) else field
    same = _is_same_grid(plan, field)
    size = " x ".join(str(count) for count in grid.values.shape)
    message = f"{size} nodes, {float(grid.spacing.max()):.4g} mm apart"
    if same is None:
        return Check(name="grid", ok=True, message=f"{message}; the plan states none")
    if same:
        return Check(name="grid", ok=True, message=f"{message}, as stated")
    message += "; the plan states another grid, so it was not made from this input so read"
    return Check(name="grid", ok=False, message=message)


def _check_wall(plan: Plan, duct: Duct) -> tuple[Check, ...]:
    """Check what the plan says of the wall: inflation, bore, and clearances at the steps."""
    checks = []
    stated = _read_number(plan.meta, "field", "inflation_mm") or 0.0
    if abs(stated - duct.inflation) > SLACK:
        message = f"the plan inflates the wall by {stated:g} mm, this one by {duct.inflation:g} mm"
        checks.append(Check(name="wall", ok=False, message=message))
    introducer = _read_introducer(plan)
    if introducer is None:
        return tuple(checks)
    offered = float(duct.clearance_bound(introducer.entry))
    radius = 0.5 * float(plan.meta["scope"]["diameter_mm"])
    # A scope that is too thick for the entry stands before it, in a tube of its own radius.
    if introducer.bore > max(offered, radius if plan.inserted <= SLACK else 0.0) + SLACK:
        message = (
            f"the introducer's bore is {introducer.bore:.3f} mm: the lumen at the entry offers "
            f"{offered:.3f} mm"
        )
        checks.append(Check(name="bore", ok=False, message=message))
    rest = duct
    used = _read_number(plan.meta, "soft_wall", "used_mm") or 0.0
    if used > 0.0:
        if not isinstance(duct, (SampledField, RefinedField)):
            return tuple(checks)
        rest = duct.inflate(-used)
    length = _read_number(plan.meta, "scope", "link_length_mm")
    if length is None:
        return tuple(checks)
    scope = Scope(diameter=2.0 * radius, link_length=length)
    anew, _ = measure_body(rest, plan.joints, scope=scope, introducer=introducer)
    error = _read_number(plan.meta, "field", "clearance_error_mm") or 0.0
    over = _subtract(plan.clearance, anew)
    step, link = np.unravel_index(int(np.argmax(over)), over.shape)
    most = float(over[step, link])
    same = _is_same_grid(plan, duct)
    if most <= SLACK and same:
        # The same samples of the same field: they must agree.
        under = _subtract(np.where(np.isinf(anew), -np.inf, anew), plan.clearance)
        step, link = np.unravel_index(int(np.argmax(under)), under.shape)
        most, error = float(under[step, link]), 0.0
    ok = most <= min(error, duct.error) + SLACK
    message = (
        f"none is stated {'otherwise' if same else 'larger'} than it is found anew"
        if ok
        else f"link {link + 1} at step {step} is stated to have {plan.clearance[step, link]:.3f} "
        f"mm, but has {anew[step, link]:.3f} mm"
    )
    return (*checks, Check(name="clearances", ok=ok, message=message))


def _subtract(stated: NDArray[np.float64], anew: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by how much clearances are overstated; infinite ones are those not measured."""
    free = np.isinf(anew)
    over: NDArray[np.float64] = np.where(free, -np.inf, stated - np.where(free, 0.0, anew))
    return over


def _check_claim(plan: Plan, duct: Duct, certificate: Certificate, claimed: float | None) -> Check:
    def make(ok: bool, message: str) -> Check:
        return Check(name="certificate", ok=ok, message=message)

    proof = certificate.clearance
    if proof == np.inf:
        return make(claimed is None, "the scope never leaves the introducer: there is no proof")
    if claimed is None:
        said = "the plan claims no proof"
        if not certificate.certified:
            return make(True, f"{said}, and none is found")
        return make(True, f"{said}, but {proof:.3f} mm are proved")
    if claimed > proof + CLAIM_SLACK:
        anew = f"{proof:.3f} mm are proved" if certificate.certified else "nothing is proved"
        return make(False, f"the plan claims {claimed:.3f} mm: anew {anew}")
    found = _read_number(plan.meta, "certificate", "found_mm")
    if found is not None and proof > found + SLACK and _is_same_grid(plan, duct):
        return make(
            False,
            f"the plan states a place of the body with {found:.3f} mm: anew {proof:.3f} mm are "
            "proved everywhere, so this is another scope, wall or motion",
        )
    return make(True, f"the plan claims {claimed:.3f} mm: anew {proof:.3f} mm are proved")


def _compare(certificate: Certificate, second: Recheck) -> Check:
    def make(ok: bool, message: str) -> Check:
        return Check(name="second check", ok=ok, message=message)

    counted = f"{second.samples:,} exact distances"
    if not second.resolved:
        return make(False, f"not settled by {counted}")
    if certificate.certified and certificate.clearance > second.found + CLAIM_SLACK:
        return make(
            False,
            f"a point of the body has {second.found:.3f} mm, less than the certificate says "
            f"(step {second.step:g}, link {second.link})",
        )
    if not second.clear:
        return make(
            not certificate.certified,
            f"by {counted} the body comes to {second.found:.3f} mm "
            f"(step {second.step:g}, link {second.link}): not shown to be clear",
        )
    return make(
        True,
        f"by {counted} the clearance lies between {second.lower:.3f} and {second.found:.3f} mm",
    )

"""The job of ``bozzini reach``: scopes in a tree, and a target."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from ..anatomy.fiducials import read_fiducial
from ..anatomy.frame import find_axis
from ..anatomy.labels import find_centres
from ..anatomy.tract import Finding, LabelTract
from ..checks import ceil_mm, floor_mm, quantity, show_value
from ..duct import LumenTree
from ..duct.tree import TreeFinding
from ..duct.tree_files import is_tree, read_tree, write_curves, write_swc, write_vtp
from ..duct.tree_names import read_names
from ..errors import InputError
from ..motion.approach import Approach, find_approaches
from ..motion.branches import NEEDLE, TreeReach, TreeReachOptions, reach_tree
from ..motion.planners import PlannerOptions
from ..motion.scope import SIZE_MIN_MM, Scope
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import format_rows
from ..task import Task
from ..units import parse_quantity, parse_vector
from .case import Case
from .ends import find_root
from .options import LumenOptions, ReadOptions, copy_field

FINDINGS = 8
"""So many things that look odd in a tree are told at once."""

SHOWN = 3
"""Approaches to a target, and names of thin ends, that people are told of."""


@dataclass(frozen=True, kw_only=True)
class TreeListing(Task):
    """List the branches of the lumen in INPUT: airways, vessels, or another one that branches.

    INPUT is a label volume, a surface, or a tree: SWC, lines of VMTK with their radius (.vtp,
    .vtk), curves of 3D Slicer (.mrk.json). The tree begins at its widest end, or at --start. A name
    says where a branch is: 0.1 is the second widest of those that leave the end of branch 0. The
    table has a row for each; a picture is the tree unrolled, a page the tree in space. What looks
    odd is told: loops, branches wider than what they leave, loose parts, ends thinner than a voxel.
    """

    name = "tree"
    result = LumenTree
    formats = MappingProxyType({".swc": write_swc, ".vtp": write_vtp, ".mrk.json": write_curves})
    has_page = True

    input: str = quantity("file", "A label volume or a surface.")
    reading: ReadOptions
    lumen: LumenOptions

    def run(self, progress: Progress = no_progress) -> LumenTree:
        """Return the tree."""
        if is_tree(self.input):
            return self._read()
        case = Case.open(self.input, self.lumen.path, reading=self.reading, progress=progress)
        return case.tree

    def _read(self) -> LumenTree:
        """Return the tree that INPUT is."""
        for part in (self.reading, self.lumen):
            for name, item in part.__dataclass_fields__.items():
                if name not in ("frame", "start", "names") and getattr(part, name) != item.default:
                    raise InputError(
                        f"{self.input} is a tree already: it has no {name}, leave it out"
                    )
        start = self.lumen.start
        if isinstance(start, (str, int)):
            raise InputError(
                f"start is {show_value(start)}: {self.input} is a tree, it must be a point x,y,z"
            )
        tree = read_tree(self.input, root=start, frame=self.reading.frame)
        return tree if self.lumen.names is None else read_names(tree, self.lumen.names)

    def describe(self, found: LumenTree) -> str:
        """Return the generations in a table, and what looks odd."""
        rows = []
        for generation in range(found.generations):
            own = [branch for branch in found.branches if branch.generation == generation]
            widths = [branch.mean_radius for branch in own]
            rows.append(
                [
                    f"{generation}",
                    f"{len(own)}",
                    f"{sum(branch.is_end for branch in own)}",
                    f"{sum(branch.length for branch in own) / len(own):.1f}",
                    f"{min(widths):.2f} to {max(widths):.2f}",
                ]
            )
        head = ["generation", "branches", "ends", "mean length [mm]", "radius [mm]"]
        lines = [
            f"{len(found.branches)} branches with {len(found.ends)} ends, {found.length:.0f} mm "
            "of centreline in all",
            format_rows(head, rows),
        ]
        return "\n".join([*lines, *_tell_findings(found.findings)])


def _tell_findings(found: Sequence[Finding], *, notes: bool = True) -> list[str]:
    """Return a line for each thing that looks odd, warnings first, as far as people read them.

    Thin ends have one line together.
    """
    findings = [item for item in found if notes or item.severity == "warning"]
    thin = [item for item in findings if isinstance(item, TreeFinding) and item.code == "thin-end"]
    if len(thin) > 1:
        names = ", ".join(f"'{item.branch}'" for item in thin[:SHOWN])
        names += ", ..." if len(thin) > SHOWN else ""
        widest = max(item.size for item in thin)
        message = f"{len(thin)} ends are no wider than a voxel, {widest:.2f} mm at most: {names}"
        findings = [item for item in findings if item not in thin]
        findings.append(Finding("thin-end", "note", message))
    findings.sort(key=lambda item: item.severity != "warning")
    lines = [f"{item.severity}: {item.message}" for item in findings[:FINDINGS]]
    if len(findings) > FINDINGS:
        lines.append(f"and {len(findings) - FINDINGS} findings more: --json has them all")
    return lines


def _show_share(share: float) -> str:
    return "-" if math.isnan(share) else f"{100.0 * share:.0f} %"


def _tell_name(tree: LumenTree, branch: str) -> str:
    anatomy = tree.branches[tree.find_branch(branch)].anatomy
    return f"{branch} ({anatomy})" if anatomy else branch


def _tell_vessels(near: Approach) -> str:
    return "" if near.vessels is None else f", {floor_mm(near.vessels, 1)} mm from vessels"


@dataclass(frozen=True, kw_only=True)
class TreeReaching(Task):
    """Find how far scopes come into every branch of the lumen in INPUT, each motion certified.

    INPUT is a label volume or a surface of airways, vessels or another lumen that branches. The
    scope is planned from the root towards every end, up to where the lumen is too narrow for it, or
    else as far as a certified motion is found; the table says for every branch how far it gets and
    what stops it. With --target the branches are listed from which the target is near.

    Exit code 0: a scope enters; 1: none does; 2: bad input.
    """

    name = "reach"
    result = TreeReach
    has_page = True

    input: str = quantity("file", "A label volume or a surface.")
    reading: ReadOptions
    lumen: LumenOptions
    tree: str | None = quantity(
        "file", "A tree of the lumen (as 'bozzini tree' reads it), in place of one that is found.",
        default=None, example="tree.swc",
    )  # fmt: skip
    diameter: float = quantity(
        "length", "Outer diameter of the scope.", default=3.5, low=SIZE_MIN_MM, high=500.0
    )
    diameters: str | None = quantity(
        "text", "Several, in place of --diameter: LENGTH,LENGTH,...", default=None,
        example="2.2mm,2.8mm,3.5mm,4.2mm",
    )  # fmt: skip
    link: float = quantity(
        "length", "Length of a rigid link.", default=5.0, low=SIZE_MIN_MM, high=1e4
    )
    angle_limit: float | None = copy_field(PlannerOptions, "angle_limit")
    robot: str | None = quantity(
        "file", "A tendon robot (.yaml) that has to follow each motion.", default=None,
        example="robot.yaml",
    )  # fmt: skip
    target: str | None = quantity(
        "text",
        "A place to come near to: X,Y,Z with units; a label in INPUT; a fiducial of Slicer "
        "(.mrk.json, .fcsv).",
        default=None,
        example="12mm,-5mm,0mm",
    )
    target_radius: float = quantity(
        "length", "Radius of a target that is a point.", default=0.0, low=0.0, high=1e3
    )
    needle: float = quantity(
        "length",
        "How far a needle reaches: the share of the organ within it is told.",
        default=NEEDLE,
        low=0.0,
        high=1e3,
    )
    needle_angle: float | None = quantity(
        "angle", "Largest angle between the scope's axis and a needle (default: any).",
        default=None, low=0.0, high=math.pi, example="45 deg",
    )  # fmt: skip
    vessels: str | None = quantity(
        "text", "Labels in INPUT that are vessels: how far the needle stays from them is told.",
        default=None, example="3,4",
    )  # fmt: skip

    def run(self, progress: Progress = no_progress) -> TreeReach:
        """Return what is reached."""
        sizes = [self.diameter]
        if self.diameters is not None:
            sizes = [parse_quantity(part, "length") for part in self.diameters.split(",")]
        scopes = [Scope(diameter=size, link_length=self.link) for size in sizes]
        robot = None
        if self.robot is not None:
            from ..continuum import ContinuumRobot

            robot = ContinuumRobot.from_yaml(self.robot)
        case = Case.open(self.input, self.lumen.path, reading=self.reading, progress=progress)
        target, radius = self._find_target(case)
        vessels, corner = None, 0.0
        if self.vessels is not None:
            vessels, corner = self._find_label(self.vessels)
        options = TreeReachOptions(
            planner=PlannerOptions(angle_limit=self.angle_limit),
            robot=robot,
            up=tuple(find_axis(case.tract.frame or "RAS", "A").tolist()),
            needle=self.needle,
        )
        tree = self._find_tree(case)
        found = reach_tree(case.field, tree, scopes=scopes, options=options, progress=progress)
        if target is None:
            return found
        near = find_approaches(
            found,
            target,
            radius=radius,
            most=math.pi if self.needle_angle is None else self.needle_angle,
            vessels=vessels,
            vessel_radius=corner,
        )
        shortest = min((each.needle for each in near), default=None)
        far = self._judge_target(tree, target, radius, shortest)
        return replace(
            found, approaches=near, needle_needed=shortest, findings=(*far, *found.findings)
        )

    def _judge_target(
        self, tree: LumenTree, target: Floats, radius: float, needle: float | None
    ) -> list[Finding]:
        """Return a warning where no needle that is long enough gets to a target."""
        if needle is not None and needle <= self.needle:
            return []
        branches, gaps = tree.nearest(np.atleast_2d(target))
        nearest = int(np.argmin(gaps))
        away = max(float(gaps[nearest]) - radius, 0.0)
        what = "no place is reached from which a needle fits"
        if needle is not None:
            what = (
                f"{ceil_mm(needle, 1)} mm from what is reached, and a needle reaches "
                f"{self.needle:g} mm"
            )
        message = (
            f"the target is out of reach: {what}; it is {away:.1f} mm from the middle of the "
            f"nearest branch, '{tree.branches[branches[nearest]].name}'"
        )
        return [Finding("target-far", "warning", message)]

    def _find_tree(self, case: Case) -> LumenTree:
        """Return the tree of the case, or the one that was given."""
        if self.tree is None:
            return case.tree
        start = None if case.start is None else find_root(case.field, case.start)
        tree = read_tree(self.tree, root=start, frame=case.tract.frame)
        root = tree.branches[0].points[0]
        outside = float(case.field.signed_distance(root))
        if outside >= 0.0:
            place = ", ".join(f"{value:.1f}" for value in root)
            raise InputError(
                f"{self.tree} is no tree of {self.input}: its root ({place}) mm lies outside the "
                f"lumen by {outside:.1f} mm"
            )
        return tree if self.lumen.names is None else read_names(tree, self.lumen.names)

    def _find_target(self, case: Case) -> tuple[Floats | None, float]:
        """Return places of the target, world frame, and its radius about them [mm]."""
        if self.target is None:
            return None, 0.0
        if self.target.lower().endswith((".json", ".fcsv")):
            return read_fiducial(self.target, case.tract.frame), self.target_radius
        if "," in self.target:
            return np.array(parse_vector(self.target, "length")), self.target_radius
        return self._find_label(self.target)[0], 0.0

    def _find_label(self, names: str) -> tuple[Floats, float]:
        """Return the centres (k, 3) of the voxels of labels, and half a voxel's diagonal [mm]."""
        tract = replace(self.reading, labels=tuple(names.split(",")), organ=None).read(self.input)
        if not isinstance(tract, LabelTract):
            raise InputError(f"{self.input} is a surface: it has no label {names}")
        corner = 0.5 * float(np.linalg.norm(tract.spacing))
        return find_centres(tract.mask, tract.affine), corner

    def describe(self, found: TreeReach) -> str:
        """Return a table of the scopes, and the nearest approaches."""
        within = f"within {self.needle:g} mm"
        head = ["diameter [mm]", "branches", "ends", "length", "volume", within, "deepest [mm]"]
        rows = [
            [
                f"{each.diameter:g}",
                _show_share(each.entered),
                _show_share(each.ends),
                _show_share(each.length),
                _show_share(each.volume),
                _show_share(each.near),
                floor_mm(each.depth, 1),
            ]
            for each in found.scopes
        ]
        tree = found.tree
        ends = sum(branch.is_end for branch in tree.branches)
        lines = [
            f"{len(tree.branches)} branches with {ends} ends; shares that are reached, and of the "
            "organ's volume those nearest to it and in a needle's reach:",
            format_rows(head, rows),
        ]
        for size in dict.fromkeys(each.diameter for each in found.approaches):
            near = [each for each in found.approaches if each.diameter == size]
            lines += [
                f"{size:g} mm to the target: from branch {_tell_name(tree, each.branch)} at "
                f"{each.depth:.1f} mm, needle {ceil_mm(each.needle, 1)} mm at "
                f"{math.degrees(each.angle):.0f} deg to the axis{_tell_vessels(each)}; "
                f"{each.route or 'straight on'}"
                for each in near[:SHOWN]
            ]
            if len(near) > SHOWN:
                more = f"and from {len(near) - SHOWN} branches more: a table (.csv) and --json"
                lines.append(f"{size:g} mm: {more} have them all")
        lines += filter(None, [found.reason])
        return "\n".join([*lines, *_tell_findings(found.findings, notes=False)])

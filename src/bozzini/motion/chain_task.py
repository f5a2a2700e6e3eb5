"""A chain of rigid links whose head follows a path: free, in a duct, around obstacles, with slip.

The thesis's own motion (5.3.1 to 5.3.3, appendix C), in a plane or in space: each joint moves least
with the link length kept, and in a duct the joints stay inside it. The links between them need not.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..checks import quantity
from ..errors import FileFormatError, InputError
from ..io.sheets import read_sheet, split_title, take_numbers
from ..numeric.arrays import Floats
from ..numeric.polylines import measure_arc_length
from ..progress import Progress, no_progress
from ..results import Json, ReasonedResult, measured, take_axes
from ..task import Task
from ..units import parse_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..duct.base import Duct

THIN = 0.2
"""Diameter of a chain that is to be a line [mm]: joints keep half of it from the wall."""
SHOWN = 5
"""Places of the chain that a picture has."""
ALONG_LINK = np.linspace(0.0, 1.0, 9)
"""Shares of a link where its depth in the wall is looked at."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ChainMotion(ReasonedResult):
    """What a chain did.

    Attributes
    ----------
    links : int
    link_length : float
        [mm]
    head_way, tail_way : float
        How far the head's joint and the last one went, along their ways [mm].
    depth : float, optional
        By how much a link whose two joints are inside reaches out of the duct, at most [mm]; 0 if
        none does, None without a duct.
    joints : ndarray, shape (steps, joints, 2 or 3)
        Where the joints are at each step, head first [mm].
    path : ndarray, shape (n, 2 or 3)
        The head's path [mm].
    duct : Duct, optional
    reason : str
        Why the head did not come to the end of its path; empty if it did.
    """

    links: int = measured("")
    link_length: float = measured("mm")
    head_way: float = measured("mm")
    tail_way: float = measured("mm")
    depth: float | None = measured("mm")
    joints: Floats
    path: Floats
    duct: Duct | None
    reason: str = ""

    @property
    def residual(self) -> float:
        """Largest deviation of a link from its length [mm]."""
        lengths = np.linalg.norm(np.diff(self.joints, axis=1), axis=2)
        return float(np.abs(lengths - lengths[0]).max())

    def list_columns(self) -> Json:
        """Return a row for each joint at each step."""
        steps, count, dim = self.joints.shape
        flat = self.joints.reshape(-1, dim)
        return {
            "step": np.repeat(np.arange(steps), count),
            "joint": np.tile(np.arange(count), steps),
            **{f"{axis} [mm]": flat[:, k] for k, axis in enumerate("xyz"[:dim])},
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the duct and the chain on its way, in x and y; return the axes."""
        axes = take_axes(ax, x="x [mm]", y="y [mm]")
        axes.set_aspect("equal")
        if self.duct is not None and self.duct.dim == 2:
            (left, low), (right, high) = self.duct.bounds + [[-4.0], [4.0]]
            x, y = np.meshgrid(np.linspace(left, right, 361), np.linspace(low, high, 241))
            value = self.duct.signed_distance(np.stack([x, y], axis=-1))
            axes.contourf(x, y, value, [-1e9, 0.0], colors=["#e8eef2"])
            axes.contour(x, y, value, [0.0], colors=["#17212b"], linewidths=0.8)
            axes.set(xlim=(left, right), ylim=(low, high))
        axes.plot(*self.path.T[:2], ":", color="#2f7fd0", label="the head's path")
        steps = np.linspace(0, len(self.joints) - 1, SHOWN).astype(int)
        for shown, step in enumerate(steps):
            shade = 0.25 + 0.75 * shown / (SHOWN - 1)
            axes.plot(
                *self.joints[step].T[:2], ".-", color="#0f7b6c", markersize=3, alpha=shade,
                linewidth=1.0,
            )  # fmt: skip
        axes.legend(frameon=False, fontsize="small")
        return axes


@dataclass(frozen=True, kw_only=True)
class ChainTask(Task):
    """Move a chain of rigid links by its head, the thesis's way (5.3, appendix C).

    PATH is a table of the head's path, with columns x [mm], y [mm] and, in space, z [mm]. With
    --shapes the joints stay in these, out of --obstacles; the chain comes in from where the path
    begins. Without shapes it is free: it begins straight behind the head, or as --start says, and
    may slip.

    Exit code 0: the head gets to the end; 1: it does not; 2: bad input.
    """

    name = "chain"
    group = "duct"
    result = ChainMotion

    path: str = quantity("file", "A table of the head's path.")
    shapes: str | None = quantity("file", "A file of shapes that the joints stay in.", default=None)
    obstacles: str | None = quantity(
        "file", "A file of shapes that the joints stay out of, with --shapes.", default=None
    )
    start: str | None = quantity(
        "file", "A table of where a free chain's joints begin, head first.", default=None
    )
    links: int = quantity(help="Links of the chain.", default=20, low=1, high=2000, whole=True)
    link: float | None = quantity(
        "length",
        "Length of a link (default: a chain in shapes is as long as the path, a free one half).",
        default=None,
        low=1e-3,
        high=1e4,
    )
    slip: float = quantity(
        help="Share of its head's move that a tail takes on as it is; 0 is the tractrix.",
        default=0.0,
        low=0.0,
        high=1.0,
    )

    def run(self, progress: Progress = no_progress) -> ChainMotion:
        """Return the motion."""
        path = read_points(self.path)
        if len(path) < 2:
            raise InputError(f"{self.path} has {len(path)} row(s): a path needs two or more")
        path = path[np.append(True, np.any(path[1:] != path[:-1], axis=1))]
        if len(path) < 2:
            raise InputError(f"{self.path} is one place in all rows: a path needs two or more")
        if self.shapes is None:
            if self.obstacles is not None:
                raise InputError("obstacles without shapes: give the space that they stand in, too")
            return self._move_free(path)
        if self.start is not None:
            raise InputError("start is for a free chain: in shapes it comes in along the path")
        from ..duct.compose import without
        from ..duct.shape_files import load_shapes

        duct = load_shapes(self.shapes)
        if self.obstacles is not None:
            duct = without(duct, load_shapes(self.obstacles))
        if duct.dim != path.shape[1]:
            raise InputError(
                f"{self.path} has {path.shape[1]} coordinates, {self.shapes} {duct.dim}: they must "
                "have as many"
            )
        return self._move_inside(duct, path, progress)

    def _move_free(self, path: Floats) -> ChainMotion:
        if self.start is None:
            length = self.link or 0.5 * float(measure_arc_length(path)[-1]) / self.links
            back = path[0] - path[1]
            back /= np.linalg.norm(back)
            start = path[0] + length * np.arange(self.links + 1)[:, None] * back
        else:
            if self.link is not None:
                raise InputError("link and start both say how long the links are: give one")
            start = read_points(self.start)
            if start.shape[1:] != path.shape[1:] or len(start) < 2:
                raise InputError(
                    f"{self.start} must have two rows or more of {path.shape[1]} coordinates, as "
                    "the path has"
                )
            path = np.concatenate([start[:1], path]) if np.any(start[0] != path[0]) else path
        from .link import move_free_chain

        joints = move_free_chain(start, path, slip=self.slip)
        length = float(np.linalg.norm(start[0] - start[1]))
        return _describe(joints, path, None, link=length)

    def _move_inside(self, duct: Duct, path: Floats, progress: Progress) -> ChainMotion:
        from ..duct.centreline import Centreline
        from .planner import plan_insertion
        from .planners import PlannerOptions
        from .scope import Scope

        line = Centreline.from_points(path, duct)
        # A little more, so that the last joint is not short of the entry by round-off.
        length = self.link or 1.0001 * line.length / self.links
        scope = Scope(diameter=THIN, link_length=length, length=length * self.links)
        plan = plan_insertion(
            duct,
            line,
            scope=scope,
            method="thesis",
            options=PlannerOptions(head_step=min(1.0, 0.5 * length), advise=False, slip=self.slip),
            progress=progress,
        )
        return _describe(plan.joints, path, duct, link=length, reason=plan.reason)


def _describe(
    joints: Floats, path: Floats, duct: Duct | None, *, link: float, reason: str = ""
) -> ChainMotion:
    """Return the motion with its numbers."""
    ways = np.linalg.norm(np.diff(joints[:, [0, -1]], axis=0), axis=2).sum(axis=0)
    depth = None
    if duct is not None:
        inside = duct.signed_distance(joints) <= 1e-6
        both = inside[:, 1:] & inside[:, :-1]
        share = ALONG_LINK[:, None, None, None]
        body = (1.0 - share) * joints[None, :, :-1] + share * joints[None, :, 1:]
        out = duct.signed_distance(body[:, both])
        depth = max(float(out.max(initial=0.0)), 0.0)
    return ChainMotion(
        links=joints.shape[1] - 1,
        link_length=link,
        head_way=float(ways[0]),
        tail_way=float(ways[1]),
        depth=depth,
        joints=joints,
        path=path,
        duct=duct,
        reason=reason,
    )


def read_points(path: str) -> Floats:
    """Read points (n, 2) or (n, 3) [mm] from a table with columns x, y and perhaps z.

    Raises
    ------
    FileFormatError
        If it is no such table.
    """
    sheet = read_sheet(Path(path))
    titles = [split_title(title) for title in sheet.titles]
    places = {name.removesuffix("_mm"): place for place, (name, _) in enumerate(titles)}
    for axis in "xy":
        if axis not in places:
            raise FileFormatError(f"{path} has no column '{axis}': points have x, y and perhaps z")
    return np.stack(
        [
            parse_unit(titles[places[axis]][1] or "mm", "length")
            * take_numbers(sheet, places[axis], where=f"{path}: ")
            for axis in "xyz"
            if axis in places
        ],
        axis=1,
    )

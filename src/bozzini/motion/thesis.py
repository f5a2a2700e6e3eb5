"""The thesis's own scheme (section 5.3): joints inside the wall, each next one moves least.

Eq. (5.15): minimise ``|x_t - X_t|`` subject to ``|x_h - x_t| = L`` and the joint inside the duct,
link after link from the head. The scheme is greedy and looks at joints only. What the thesis
leaves open is settled so: a joint keeps one scope radius of clearance; the tail moves to the
nearest feasible **direction** (the same minimiser, because all candidates lie on a sphere); a joint
that would jump by more than `JUMP_STEPS` head steps has its head step halved down to 1/64, and if
the jump remains the motion stops there with that reason (the lock of Fig. 5.30).
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..checks import floor_mm
from ..duct.centreline import Centreline
from ..progress import Progress, no_progress
from .link import bound_slope
from .planner import Motion, Planner
from .planners import PlannerOptions
from .refusal import needs_mm
from .scope import Scope
from .space import FreeSpace

JUMP_STEPS = 4.0
"""A joint may move by this many head steps at most."""

ROWS = 256
"""Steps that a kernel makes at a time."""


class ThesisPlanner(Planner):
    """The thesis's scheme, in any duct, in 2-D or 3-D.

    A motion that ends before the goal has the code ``ENTRY_CLEARANCE`` or ``HEAD_CLEARANCE`` (the
    path itself lacks clearance), ``LINK_INFEASIBLE`` (no direction of a link keeps its tail
    inside) or ``LINK_LOCKED`` (the nearest feasible tail is a jump away).
    """

    name: ClassVar[str] = "thesis"
    ignored: ClassVar[tuple[str, ...]] = ("slip", "angle_limit", "route")

    def move(
        self,
        space: FreeSpace,
        scope: Scope,
        *,
        options: PlannerOptions,
        progress: Progress = no_progress,
    ) -> Motion:
        """Move each joint least, link after link from the head."""
        return move_by_thesis(
            space,
            scope,
            links=scope.count_links(space.centreline.length),
            head_step=options.head_step,
            progress=progress,
        )


def move_by_thesis(
    space: FreeSpace,
    scope: Scope,
    *,
    links: int,
    head_step: float,
    progress: Progress = no_progress,
) -> Motion:
    """Move a chain of some links along the space's line by the thesis's scheme."""
    from .kernels import chain as kernels

    duct, line, length = space.duct, space.centreline, float(scope.link_length)
    path = np.ascontiguousarray(duct.to_grid(line.points))
    chain = np.ascontiguousarray(duct.to_grid(space.tube.place_chain(links + 1, length)))
    packed, state = space.pack(), np.zeros(4)
    parts = [chain[None].copy()]
    trails = [np.zeros(1)]
    out = np.empty((ROWS, links + 1, 3))
    trail = np.empty(ROWS)
    code = kernels.BUFFER_FULL
    while code == kernels.BUFFER_FULL:
        code, rows = kernels.advance_chain(
            packed, path, line.arc_length, length, float(scope.radius),
            bound_slope(duct), duct.dim == 2, float(head_step),
            JUMP_STEPS * head_step, chain, state, out, trail,
        )  # fmt: skip
        parts.append(out[:rows].copy())
        trails.append(trail[:rows].copy())
        progress("plan", float(state[0]) / line.length)
    made = np.concatenate(trails)
    reason_code, reason = _explain(code, state, line, scope, step=len(made))
    return Motion(
        joints=duct.to_world(np.concatenate(parts)),
        head_arc_length=made,
        path=line.points,
        reason_code=reason_code,
        reason=reason,
    )


def _explain(
    code: int, state: NDArray[np.float64], line: Centreline, scope: Scope, *, step: int
) -> tuple[str, str]:
    from .kernels import chain as kernels

    at, link, value, tried = float(state[0]), int(state[1]), float(state[2]), float(state[3])
    if code == kernels.HEAD_BLOCKED and at == 0.0:
        return "ENTRY_CLEARANCE", (
            f"does not fit at the entry: needs {needs_mm(scope.radius, line.radius[0])} mm from "
            "the wall, "
            f"the lumen offers {floor_mm(line.radius[0])} mm there"
        )
    if code == kernels.HEAD_BLOCKED:
        return "HEAD_CLEARANCE", (
            f"does not fit at {at:.1f} mm: needs {needs_mm(scope.radius, -value)} mm from the "
            "wall, "
            f"the lumen offers {floor_mm(-value)} mm on the centreline"
        )
    head = ", ".join(f"{np.interp(tried, line.arc_length, column):.1f}" for column in line.points.T)
    where = f"in step {step}, with the head at {at:.1f} mm ({head})"
    if code == kernels.LINK_INFEASIBLE:
        return "LINK_INFEASIBLE", (
            f"link {link} has no place {where}: no tail at "
            f"{scope.link_length:g} mm has {scope.radius:.2f} mm from the wall, the best "
            f"lacks {value:.2g} mm"
        )
    if code == kernels.LINK_LOCKED:
        return "LINK_LOCKED", (
            f"link {link} locks {where}: its nearest tail at {scope.link_length:g} mm with "
            f"{scope.radius:.2f} mm from the wall is a jump of {value:.2f} mm away, which does "
            "not shrink with the head's step"
        )
    return "", ""

"""The thesis's own scheme (section 5.3): joints inside the wall, each next one moves least.

Eq. (5.15): minimise ``|x_t - X_t|`` subject to ``|x_h - x_t| = L`` and the joint inside the duct,
link after link from the head. The scheme is greedy and looks at joints only. What the thesis
leaves open is settled so: a joint keeps one scope radius of room; the tail moves to the nearest
feasible **direction** (the same minimiser, because all candidates lie on a sphere); a joint that
would jump by more than `JUMP_STEPS` head steps has its head step halved down to 1/64, and if the
jump remains the motion stops there and says so, instead of jumping (the lock of Fig. 5.30).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..duct.base import Duct, count_dimensions
from ..duct.centreline import Centreline
from ..progress import Progress, no_progress
from .introducer import Introducer
from .link import bound_slope
from .refusal import floor_mm
from .scope import Scope

__all__ = ["Motion", "move_by_thesis"]

JUMP_STEPS = 4.0
"""A joint may move by this many head steps at most."""

ROWS = 256


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What a method gives: the steps, and why they ended.

    Parameters
    ----------
    joints : (steps, joints, dim) float
        World frame [mm].
    head_arc_length : (steps,) float
        [mm].
    status, reason_code, reason : str
        As in `Plan`.
    """

    joints: NDArray[np.float64]
    head_arc_length: NDArray[np.float64]
    status: str
    reason_code: str = ""
    reason: str = ""


def move_by_thesis(
    duct: Duct,
    line: Centreline,
    *,
    scope: Scope,
    introducer: Introducer,
    links: int,
    head_step: float,
    progress: Progress = no_progress,
) -> Motion:
    """Move a chain along a centreline by the thesis's scheme, in any duct, in 2-D or 3-D.

    Returns
    -------
    Motion
        ``reason_code`` is ``HEAD_CLEARANCE`` (the path itself has not the room),
        ``LINK_INFEASIBLE`` (no direction of a link keeps its tail inside) or ``LINK_LOCKED``
        (the nearest feasible tail is a jump away).
    """
    from .kernels import chain as kernels

    data, tube = duct.pack(), introducer.pack(duct)
    path = np.ascontiguousarray(duct.to_grid(line.points))
    chain = np.ascontiguousarray(duct.to_grid(introducer.place_chain(links + 1, scope.link_length)))
    state = np.zeros(4)
    parts = [chain[None].copy()]
    trails = [np.zeros(1)]
    out = np.empty((ROWS, links + 1, 3))
    trail = np.empty(ROWS)
    code = kernels.BUFFER_FULL
    while code == kernels.BUFFER_FULL:
        code, rows = kernels.advance_chain(
            data,
            tube,
            path,
            line.arc_length,
            float(scope.link_length),
            float(scope.radius),
            bound_slope(duct),
            count_dimensions(duct) == 2,
            float(head_step),
            JUMP_STEPS * head_step,
            chain,
            state,
            out,
            trail,
        )
        parts.append(out[:rows].copy())
        trails.append(trail[:rows].copy())
        progress("plan", float(state[0]) / line.length)
    made = np.concatenate(trails)
    reason_code, reason = _explain(code, state, line, scope, step=len(made))
    return Motion(
        joints=duct.to_world(np.concatenate(parts)),
        head_arc_length=made,
        status="complete" if code == kernels.DONE else "stopped",
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
            f"does not fit at the entry: needs {scope.radius:.2f} mm from the wall, "
            f"the lumen offers {floor_mm(line.radius[0])} mm there"
        )
    if code == kernels.HEAD_BLOCKED:
        return "HEAD_CLEARANCE", (
            f"does not fit at {at:.1f} mm: needs {scope.radius:.2f} mm from the wall, "
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

"""Plan the insertion of a scope: check the input, call the method, measure the result."""

from __future__ import annotations

import platform
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..duct.centreline import Centreline
from ..duct.field import SampledField
from ..errors import InputError
from ..progress import Progress, no_progress
from .introducer import Introducer
from .measures import measure_plan
from .plan import Plan
from .scope import Scope
from .thesis import Motion, move_by_thesis

__all__ = ["METHODS", "plan_insertion"]

METHODS = ("thesis",)
"""The planners."""


def plan_insertion(
    duct: SampledField,
    line: Centreline,
    *,
    scope: Scope,
    method: str = "thesis",
    head_step: float = 0.25,
    progress: Progress = no_progress,
) -> Plan:
    """Plan how a scope moves along a centreline into a lumen.

    Parameters
    ----------
    duct : SampledField
        The lumen.
    line : Centreline
        The path of the head, from the entry to the goal.
    scope : Scope
        The scope; without a length it is made long enough for the whole line.
    method : {"thesis"}
        ``"thesis"``: section 5.3.3, each next joint moves least with the link length kept and the
        **joints** kept one scope radius inside the wall. The links between them are not: read
        `Plan.clearance`.
    head_step : float
        How far the head moves per step [mm]; it is halved where a joint would jump.

    Returns
    -------
    Plan
        Also when the scope does not fit: then ``status`` is ``"stopped"`` and ``reason`` says why.

    Raises
    ------
    InputError
        If the method is unknown, the link is longer than the tract, or a number is out of range.
    """
    if method not in METHODS:
        raise InputError(f"method is {method!r}: it must be one of {', '.join(METHODS)}")
    check_number("head step", head_step, low=1e-3, high=scope.link_length, unit="mm")
    if scope.link_length > line.length:
        raise InputError(
            f"link length is {scope.link_length:g} mm: it must be at most the tract's "
            f"centreline, {line.length:.1f} mm"
        )
    links = scope.count_links(line.length)
    introducer = Introducer.at_start(
        line, bore=max(float(line.radius[0]), scope.radius), along=scope.link_length
    )
    motion = move_by_thesis(
        duct,
        line,
        scope=scope,
        introducer=introducer,
        links=links,
        head_step=head_step,
        progress=progress,
    )
    progress("check", 0.0)
    clearance, worst = measure_body(duct, motion.joints, scope=scope, introducer=introducer)
    progress("check", 1.0)
    measures = measure_plan(
        motion.joints, motion.head_arc_length, clearance, line=line, worst=worst
    )
    return Plan(
        joints=motion.joints,
        head_arc_length=motion.head_arc_length,
        clearance=clearance,
        path=line.points,
        path_arc_length=line.arc_length,
        path_radius=line.radius,
        method=method,
        status=motion.status,
        reason_code=motion.reason_code,
        reason=motion.reason,
        meta=_describe(duct, scope, introducer, head_step, measures),
    )


def body_pitch(duct: SampledField) -> float:
    """Distance between the samples along a link in the body check [mm]."""
    return 0.25 * float(np.min(duct.spacing))


def measure_body(
    duct: SampledField,
    joints: NDArray[np.float64],
    *,
    scope: Scope,
    introducer: Introducer,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Estimate the clearance of the whole body at every step, from the sampled field.

    Parameters
    ----------
    joints : (steps, joints, 3) float
        World frame [mm].

    Returns
    -------
    clearance : (steps, joints - 1) float
        Scope surface to wall, the least over samples of each link [mm]; infinite for links wholly
        in the introducer.
    worst : (4,) float
        The place of the smallest clearance in the world frame, and its value [mm].
    """
    from ._chain_kernels import measure_body as measure

    chains = np.ascontiguousarray(duct.to_grid(joints))
    clearance = np.empty((joints.shape[0], joints.shape[1] - 1))
    worst = np.zeros(4)
    measure(
        duct.values,
        duct.spacing,
        duct.inflation,
        introducer.pack(duct),
        chains,
        scope.radius,
        body_pitch(duct),
        clearance,
        worst,
    )
    worst[:3] = duct.to_world(worst[:3])
    return clearance, worst


def _describe(
    duct: SampledField,
    scope: Scope,
    introducer: Introducer,
    head_step: float,
    measures: dict[str, float],
) -> dict[str, Any]:
    from importlib.metadata import version

    from .. import __version__ as bozzini_version

    return {
        "scope": {"diameter_mm": scope.diameter, "link_length_mm": scope.link_length},
        "introducer": introducer.describe(),
        "head_step_mm": head_step,
        "wall": duct.wall,
        "certified": False,
        "field": {
            "spacing_mm": [float(h) for h in duct.spacing],
            "nodes": list(duct.values.shape),
            "inflation_mm": duct.inflation,
            "interpolation_error_mm": duct.error,
            "wall_error_mm": duct.wall_error,
            "sampling_error_mm": 0.5 * body_pitch(duct),
            "clearance_error_mm": duct.error + 0.5 * body_pitch(duct),
        },
        "measures": measures,
        "versions": {
            "bozzini": bozzini_version,
            "python": platform.python_version(),
            **{name: version(name) for name in ("numpy", "scipy", "numba")},
        },
    }

"""A wall that gives way: let it be displaced as little as needed, and say where it is touched."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..checks import check_number
from ..duct.centreline import Centreline
from ..duct.field import SampledField
from .insertion import measure_body, plan_insertion
from .introducer import Introducer
from .plan import Plan
from .scope import Scope

__all__ = ["plan_with_soft_wall"]

SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Shares of the allowed displacement that are tried in turn."""


def plan_with_soft_wall(
    duct: SampledField, line: Centreline, *, scope: Scope, soft_wall: float, **options: Any
) -> Plan:
    """Plan an insertion where the body may displace the wall by up to `soft_wall` mm.

    The wall is first taken as rigid, then displaced outwards by growing shares of what is allowed
    until the scope comes through; what is proved is proved for the displaced wall. The plan's
    clearances are against the wall at rest: where they are negative, the body pushes it.

    Parameters
    ----------
    soft_wall : float
        Largest displacement allowed [mm].
    **options
        As for `plan_insertion`.

    Returns
    -------
    Plan
        ``meta["soft_wall"]`` says what was allowed and used, the deepest contact, where it is,
        and the share of steps with contact.

    Raises
    ------
    InputError
        As `plan_insertion`, or if `soft_wall` is negative.
    """
    check_number("soft wall", soft_wall, low=0.0, high=100.0, unit="mm")
    best: Plan | None = None
    used = 0.0
    for share in SHARES:
        trial = soft_wall * share
        # With several shares, what would fit is only sought for the one that is taken.
        advise = soft_wall == 0.0
        plan = plan_insertion(duct.inflate(trial), line, scope=scope, advise=advise, **options)
        if best is None or plan.inserted > best.inserted + 1.0 or plan.status == "complete":
            best, used = plan, trial
        if plan.status == "complete" or soft_wall == 0.0:
            break
    if best is None:
        raise RuntimeError("no share was tried")
    if best.status == "stopped" and soft_wall > 0.0:
        best = plan_insertion(duct.inflate(used), line, scope=scope, **options)
    introducer = Introducer.from_description(best.meta["introducer"])
    clearance, worst = measure_body(duct, best.joints, scope=scope, introducer=introducer)
    inside = bool(np.isfinite(worst[-1]))
    deepest = max(0.0, -float(worst[-1])) if inside else 0.0
    place = worst[: line.points.shape[1]]
    near = int(np.argmin(np.linalg.norm(line.points - place, axis=1)))
    where = float(line.arc_length[near])
    measures = {**best.meta["measures"]}
    if inside:
        measures |= {"clearance_min_mm": float(worst[-1]), "clearance_where_mm": where}
    meta = {
        **best.meta,
        "measures": measures,
        "soft_wall": {
            "allowed_mm": soft_wall,
            "used_mm": used,
            "contact_max_mm": deepest,
            "contact_where_mm": where if deepest > 0.0 else None,
            "contact_step_share": float((clearance.min(axis=1) < 0.0).mean()),
        },
    }
    if used > 0.0:
        meta["wall"] = f"{duct.wall}, displaced by up to {used:g} mm"
        meta["certificate"] = {**best.meta["certificate"], "wall": meta["wall"]}
    return replace(best, clearance=clearance, meta=meta)

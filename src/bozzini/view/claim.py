"""What is claimed for a plan: proved or estimated, against which wall, and with what contact."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..motion.plan import Plan
from .records import read_number
from .sampling import sample_motion

__all__ = ["Claim", "SoftWall", "read_claim"]


@dataclass(frozen=True, kw_only=True)
class SoftWall:
    """A wall that may give way.

    Parameters
    ----------
    allowed, used : float
        How far the wall may be displaced, and how far it was for the motion to be proved [mm].
    contact : float
        Deepest contact: how far the body stands beyond the wall at rest [mm], 0 if nowhere.
    place : float or None
        Arc length along the tract of the deepest contact [mm].
    """

    allowed: float
    used: float
    contact: float
    place: float | None


@dataclass(frozen=True, kw_only=True)
class Claim:
    """What may be said about the clearance of a plan.

    Parameters
    ----------
    certified : bool
        Whether it is proved that the body keeps off the wall at all times.
    proved : float or None
        Proved lower bound of the clearance [mm]; None where nothing is proved.
    estimate : float or None
        Smallest clearance at sampled points and recorded steps, to the wall at rest [mm].
    place : float or None
        Arc length along the tract of the estimate [mm].
    inflation : float
        How far the wall was moved outwards for all of this [mm].
    soft : SoftWall or None
        Set where the wall was allowed to give way and had to.
    """

    certified: bool
    proved: float | None
    estimate: float | None
    place: float | None
    inflation: float
    soft: SoftWall | None

    @property
    def headline(self) -> float | None:
        """The clearance to quote first [mm]: the proved one where there is one."""
        return self.proved if self.certified and self.proved is not None else self.estimate


def read_claim(plan: Plan, summary: Mapping[str, Any]) -> Claim:
    """Return what a plan's certificate, summary and arrays allow to be said.

    Parameters
    ----------
    plan : Plan
    summary : mapping
        The summary of the run; what it lacks is taken from the plan.
    """
    certified = bool(summary.get("certified", plan.meta.get("certified", False)))
    proved = read_number(summary, "clearance_certified_mm")
    certificate = plan.meta.get("certificate")
    if proved is None and isinstance(certificate, Mapping):
        proved = read_number(certificate, "clearance_mm")
    estimate = read_number(summary, "clearance_min_mm")
    place = read_number(summary, "clearance_where_mm")
    if estimate is None:
        sample = sample_motion(plan, count=400, worst_between=True)
        row, link = sample.find_tightest()
        if sample.in_tract[row, link]:
            estimate = float(sample.clearance[row, link])
            place = max(0.0, float(sample.places[row, link : link + 2].mean()))
    soft = _read_soft_wall(plan, summary, estimate, place)
    inflation = read_number(summary, "inflation_mm")
    field = plan.meta.get("field")
    if inflation is None and isinstance(field, Mapping):
        inflation = read_number(field, "inflation_mm") or 0.0
        inflation -= 0.0 if soft is None else soft.used  # planned in the displaced wall
    return Claim(
        certified=certified,
        proved=proved if certified else None,
        estimate=estimate,
        place=place,
        inflation=max(0.0, inflation or 0.0),
        soft=soft,
    )


def _read_soft_wall(
    plan: Plan, summary: Mapping[str, Any], estimate: float | None, place: float | None
) -> SoftWall | None:
    record = summary.get("soft_wall") or plan.meta.get("soft_wall")
    if not isinstance(record, Mapping):
        return None
    allowed = read_number(record, "allowed_mm") or 0.0
    used = read_number(record, "used_mm")
    used = allowed if used is None else used
    if used <= 0.0:  # the rigid wall was enough, or none of what was allowed helped
        return None
    contact = read_number(record, "contact_max_mm")
    if contact is None:
        contact = -min(0.0, estimate or 0.0)
    where = read_number(record, "contact_where_mm")
    return SoftWall(
        allowed=allowed,
        used=used,
        contact=max(0.0, contact),
        place=place if where is None else where,
    )

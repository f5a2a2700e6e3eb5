"""Why a scope does not get to its goal: a code, a place, and what would make it fit."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from decimal import ROUND_FLOOR, Decimal
from typing import Any

from .scope import Scope

__all__ = ["REASON_CODES", "Refusal", "floor_mm"]

REASON_CODES = {
    "ENTRY_CLEARANCE": "the lumen at the entry is narrower than the scope",
    "GOAL_CLEARANCE": "the lumen at the goal is narrower than the scope",
    "NO_PASSAGE": "proved: no way to the goal is wide enough, whatever the links",
    "LINK_TOO_LONG": "no path was found on which links of this length stay inside",
    "FOLD": "links of this length would fold back in a bend",
    "SCOPE_TOO_SHORT": "the scope is wholly inserted before the goal",
    "ANGLE": "neighbouring links would turn by more than the limit",
    "CERTIFICATE_UNRESOLVED": "a motion was found, but its clearance could not be proved",
    "HEAD_CLEARANCE": "the head's path lacks the room (method thesis)",
    "LINK_INFEASIBLE": "a link has no feasible place (method thesis)",
    "LINK_LOCKED": "a link's next feasible place is a jump away (method thesis)",
}
"""Every reason code and what it says."""


def floor_mm(value: float) -> str:
    """Write a length rounded down, so that what is offered never reads like what is needed."""
    return str(Decimal(value).quantize(Decimal("0.01"), rounding=ROUND_FLOOR))


@dataclass(frozen=True, kw_only=True)
class Refusal:
    """Why a motion ends before the goal.

    Parameters
    ----------
    code : str
        A key of `REASON_CODES`.
    at : float
        Arc length along the centreline of the place that decides [mm].
    needs, offers : float
        Room needed and room there [mm].
    what : str
        The statement, without the advice.
    diameter_max, link_max, inflate : float or None
        What would make it fit, each alone [mm]; None where it was not found or does not apply.
    """

    code: str
    at: float
    needs: float
    offers: float
    what: str
    diameter_max: float | None = None
    link_max: float | None = None
    inflate: float | None = None

    @property
    def reason(self) -> str:
        """The statement and the advice, one sentence."""
        advice = []
        if self.diameter_max is not None and self.diameter_max > 0.0:
            advice.append(f"a scope of at most {floor_mm(self.diameter_max)} mm diameter")
        if self.link_max is not None and self.link_max > 0.0:
            advice.append(f"links of at most {floor_mm(self.link_max)} mm")
        if self.inflate is not None and self.inflate > 0.0:
            advice.append(f"the wall inflated by about {math.ceil(10 * self.inflate) / 10:.1f} mm")
        return self.what + (f"; would fit: {' or '.join(advice)}" if advice else "")

    def stop_at(self, arc: float, blocked: str) -> Refusal:
        """Return the refusal with where on the centreline the motion itself ends."""
        if abs(arc - self.at) < 5.0:
            return self
        return replace(
            self, what=f"{self.what}; this motion ends at {arc:.1f} mm of the centreline{blocked}"
        )

    def advise(self, **changes: float | None) -> Refusal:
        """Return the refusal with advice filled in."""
        return replace(self, **changes)  # type: ignore[arg-type]

    def describe(self) -> dict[str, Any]:
        """Return the refusal as JSON-able values."""
        return {
            "code": self.code,
            "at_mm": self.at,
            "needs_mm": self.needs,
            "offers_mm": self.offers,
            "diameter_max_mm": self.diameter_max,
            "link_max_mm": self.link_max,
            "inflate_mm": self.inflate,
        }

    @classmethod
    def at_entry(cls, scope: Scope, room: float, *, slack: float = 0.0) -> Refusal:
        """The lumen at the entry is too narrow; `slack`: room asked for beyond the radius."""
        return cls(
            code="ENTRY_CLEARANCE",
            at=0.0,
            needs=scope.radius + slack,
            offers=room,
            what=f"does not fit at the entry: needs {scope.radius + slack:.2f} mm from the wall, "
            f"the lumen offers {floor_mm(room)} mm there",
            diameter_max=2.0 * (room - slack),
            inflate=scope.radius + slack - room,
        )

    @classmethod
    def at_angle(cls, limit: float, head: float) -> Refusal:
        """Links turn too far."""
        return cls(
            code="ANGLE",
            at=head,
            needs=limit,
            offers=limit,
            what=f"neighbouring links would turn by more than {math.degrees(limit):.1f} deg beyond "
            f"a head at {head:.1f} mm of its path; shorter links turn less",
        )

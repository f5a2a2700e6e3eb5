"""Why a scope does not reach its goal: a code, a place, and what would make it fit."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from ..checks import ceil_mm, floor_mm, quantity, show_apart
from ..results import Shown
from .scope import Scope

REASON_CODES = {
    "ENTRY_CLEARANCE": "the lumen at the entry is narrower than the scope",
    "GOAL_CLEARANCE": "the lumen at the goal is narrower than the scope",
    "NO_PASSAGE": "proved: no way to the goal is wide enough, whatever the links",
    "LINK_TOO_LONG": "no path was found on which links of this length stay inside",
    "LIMBS_JOINED": "links would pass between limbs that only a moved wall joins",
    "FOLD": "links of this length would fold back in a bend",
    "SCOPE_TOO_SHORT": "the scope is wholly inserted before the goal",
    "ANGLE": "neighbouring links would turn by more than the limit",
    "CERTIFICATE_UNRESOLVED": "a motion was found, but its clearance could not be proved",
    "HORIZON": "planned again only as far as was asked for",
    "NOT_CARRIED": "the body could not be moved with the tissue and kept clear",
    "HEAD_CLEARANCE": "no way for the head was found that is wide enough, whatever the links",
    "LINK_INFEASIBLE": "a link has no feasible place (method thesis)",
    "LINK_LOCKED": "a link's next feasible place is a jump away (method thesis)",
}
"""Every reason code and what it means."""

NEAR_MM = 10.0
"""A motion that ends farther than this from the place that stops it names its end."""


def needs_mm(value: float, offers: float) -> str:
    """Write a length that is needed with as many decimals as tell it from what is offered."""
    return show_apart(value, float(floor_mm(offers)), digits=2, form="f")[0]


def tell_needs(radius: float, offers: float, margin: float, whose: str = "its") -> str:
    """Return what a scope needs, and apart from it what the proof does [mm], as words."""
    more = f" and {margin:g} mm for the proof" if margin else ""
    return f"{needs_mm(radius, offers)} mm from {whose} axis to the wall{more}"


@dataclass(frozen=True, kw_only=True)
class Bind:
    """What a motion meets where it ends.

    Parameters
    ----------
    code : str
        A key of `REASON_CODES`.
    what : str
        Which link or joint meets which limit, in words.
    """

    code: str
    what: str


@dataclass(frozen=True, kw_only=True)
class Refusal(Shown):
    """Why a motion ends before the goal.

    Parameters
    ----------
    code : str
        A key of `REASON_CODES`.
    at : float
        Arc length along the centreline of the place that decides [mm].
    needs, offers : float or None
        Clearance needed and clearance there, from the scope's axis to the wall [mm]; None where it
        is not clearance that lacks.
    what : str
        The statement, one sentence without its full stop; empty in a plan read from a file, whose
        `reason` has it.
    diameter_max, link_max, inflate : float or None
        What a certified plan of the whole way was found for, each alone: a diameter, a link
        length, an inflation (all of it, with what the lumen was inflated by already) [mm]. None
        where none was found or sought.
    diameter_bound : float or None
        No wider scope passes, proved [mm].
    link_shaped : float or None
        Longest link for which a path was found, but no motion proved [mm].
    ends_at : float or None
        Arc length along the centreline at which the motion ends [mm].
    ends_code, ends_what : str
        What ends it there, if that is not the place that decides: a key of `REASON_CODES`, and
        which link or joint meets which limit, in words.
    """

    code: str
    at: float = quantity("length")
    needs: float | None = quantity("length", default=None)
    offers: float | None = quantity("length", default=None)
    what: str = field(default="", metadata={"recorded": False})
    diameter_max: float | None = quantity("length", default=None)
    link_max: float | None = quantity("length", default=None)
    inflate: float | None = quantity("length", default=None)
    diameter_bound: float | None = quantity("length", default=None)
    link_shaped: float | None = field(default=None, metadata={"recorded": False})
    ends_at: float | None = quantity("length", default=None)
    ends_code: str = field(default="", metadata={"omitted": True})
    ends_what: str = field(default="", metadata={"omitted": True})

    @property
    def reason(self) -> str:
        """The statement and the advice, at most two sentences; the last without its full stop."""
        statement = self.what
        if self.ends_at is not None and abs(self.ends_at - self.at) > NEAR_MM:
            ended = f"the motion ends at {self.ends_at:.1f} mm of the centreline"
            if self.ends_what:
                side = "farther on" if self.ends_at < self.at else "before that"
                statement = f"{ended}: {self.ends_what}; {side}, {statement}"
            else:
                statement += f"; {ended}"
        advice = []
        if self.diameter_max is not None:
            advice.append(f"a scope of {floor_mm(self.diameter_max)} mm diameter")
        if self.link_max is not None:
            advice.append(f"links of {floor_mm(self.link_max)} mm")
        if self.inflate is not None:
            advice.append(f"the wall inflated by {ceil_mm(self.inflate, 1)} mm")
        if advice:
            return f"{statement}. Would fit, planned and certified: {' or '.join(advice)}"
        most = math.inf if self.diameter_bound is None else self.diameter_bound
        if self.needs is not None and most < 2.0 * self.needs:
            return (
                f"{statement}. A scope of at most {ceil_mm(most)} mm could pass, but no plan was "
                "found for one"
            )
        return statement

    def stop_at(self, arc: float, bind: Bind | None = None) -> Refusal:
        """Return the refusal with where on the centreline the motion itself ends, and why there."""
        if bind is None:
            return replace(self, ends_at=arc)
        return replace(self, ends_at=arc, ends_code=bind.code, ends_what=bind.what)

    @classmethod
    def at_entry(cls, scope: Scope, clearance: float, *, slack: float = 0.0) -> Refusal:
        """The lumen at the entry is too narrow; `slack`: asked for beyond the radius [mm]."""
        return cls(
            code="ENTRY_CLEARANCE",
            at=0.0,
            needs=scope.radius + slack,
            offers=clearance,
            what=f"does not fit at the entry: the scope needs "
            f"{tell_needs(scope.radius, clearance, slack)}, the lumen is sure to have "
            f"{floor_mm(clearance)} mm there",
        )

    @classmethod
    def at_angle(cls, limit: float, head: float, *, at: float, joint: int) -> Refusal:
        """Links turn too far beyond a head `head` mm along its path, at `at` on the centreline.

        Joint `j` is that between the links j and j + 1; the head's link is 1.
        """
        return cls(
            code="ANGLE",
            at=at,
            what=f"neighbouring links would turn by more than {math.degrees(limit):.1f} deg beyond "
            f"{at:.1f} mm of the centreline, at the joint of links {joint} and {joint + 1}, with "
            f"the head {head:.1f} mm inserted along its path",
        )

"""What the cockpit shows, in 3D Slicer too; start and end from there."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, replace
from functools import partial

from ..errors import BozziniError
from ..numeric.arrays import Floats
from ..scene.slicer import SlicerLink
from .session import Outline, Session, ShownPlan, run_beside
from .wire import Change

PERIOD = 0.1
"""Between two looks at what is shown [s]."""


@dataclass(eq=False)
class SlicerWindow:
    """3D Slicer as one more window of a session.

    Parameters
    ----------
    link : SlicerLink
    session : Session
    """

    link: SlicerLink
    session: Session
    wall: Floats | None = None
    """Where the tissue has moved the wall's vertices to [mm]."""
    _outline: Outline | None = None
    _wall: Floats | None = None
    _body: tuple[ShownPlan, int] | None = None

    async def run(self) -> None:
        """Show what is shown, and plan anew for points that come, until the link ends."""
        try:
            while True:
                await asyncio.sleep(PERIOD)
                plan, moved = self.session.plan, self.session.moved
                if plan is None or plan.outline is None:
                    continue
                wall = self.wall if moved is not None else plan.outline.vertices
                body = (plan, self.session.step) if moved is None else (moved, 0)
                points = await run_beside(partial(self._exchange, plan.outline, wall, body))
                ends = {k: tuple(points[k][0].tolist()) for k in ("start", "end") if k in points}
                if ends and self.session.ask_plan is not None:
                    self.session.ask_plan(Change(start=ends.get("start"), end=ends.get("end")))
        except BozziniError as error:
            self.session.refuse(str(error))

    def _exchange(
        self, outline: Outline, wall: Floats | None, body: tuple[ShownPlan, int]
    ) -> dict[str, Floats]:
        """Send what has changed, and return the points that have come."""
        link = replace(self.link, frame=outline.frame or "RAS")
        if wall is not None and wall is not self._wall:
            link.send_wall(wall, outline.faces)
        if outline is not self._outline:
            link.send_line(outline.line)
        if body != self._body:
            plan, step = body
            link.send_scope(plan.joints[step], radius=plan.radius)
        self._outline, self._wall, self._body = outline, wall, body
        return link.receive_points(quiet=0.01)

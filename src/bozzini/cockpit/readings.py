"""A robot with sensors: the shape that is commanded, and the one that is estimated, row by row."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..continuum.error_fit import EstimateHistory
from ..continuum.robot import RobotDesign
from ..continuum.shape_estimate import ShapeEstimate
from ..errors import BozziniError
from ..numeric.arrays import Floats
from ..scene.make_view import draw_tube
from ..scene.view import Surface, View, encode_view
from ..study.estimating import ContinuumEstimating
from .session import Session, run_beside

BAND = 2.0
"""Half of the band, in standard deviations."""
FLOOR_SIDES = 47
"""Corners of the disc at the base: no tube has that many vertices."""
LOOKS = (
    ("commanded: the model alone", "#8a96a3", 0.45, 16),
    ("estimated", "#1f7a8c", 1.0, 18),
    (f"within {BAND:g} standard deviations", "#e08a00", 0.25, 20),
)
"""Name, colour, opacity and sides of the tubes: pages tell them apart by their vertices' number."""


def draw_floor(robot: RobotDesign) -> Surface:
    """Return a disc across the base, as wide as the robot reaches: the picture has room for it."""
    base, angles = robot.base_frame, np.linspace(0.0, 2.0 * np.pi, FLOOR_SIDES, endpoint=False)
    rim = np.outer(np.cos(angles), base[:3, 0]) + np.outer(np.sin(angles), base[:3, 1])
    k = np.arange(1, FLOOR_SIDES - 1)
    return Surface(
        vertices=base[:3, 3] + robot.length * rim,
        faces=np.stack([0 * k, k, k + 1], axis=1),
        name="base",
        color="#8a96a3",
        opacity=0.1,
    )


def draw_estimate(found: ShapeEstimate) -> list[Surface]:
    """Return the commanded shape, the estimated one, and a tube about it in which it is.

    The tube is wider than the body by `BAND` standard deviations across it, the largest there.
    """
    across = np.eye(3) - np.einsum("ki,kj->kij", *[found.frames[:, :3, 2]] * 2)
    spread = np.linalg.eigvalsh(across @ found.covariance[:, 3:, 3:] @ across)[:, -1]
    body = np.full(len(found.points), found.robot.radius)
    radii = (body, body, body + BAND * np.sqrt(np.maximum(spread, 0.0)))
    surfaces = []
    for (name, color, opacity, sides), line, radius in zip(
        LOOKS, (found.commanded, found.points, found.points), radii, strict=True
    ):
        vertices, faces = draw_tube(line, radius, sides=sides)
        surfaces.append(
            Surface(vertices=vertices, faces=faces, name=name, color=color, opacity=opacity)
        )
    return surfaces


@dataclass(eq=False)
class SensedRobot:
    """The shapes of a robot with sensors, shown to the windows of a session.

    Parameters
    ----------
    task : ContinuumEstimating
        Robot and readings: ``"-"`` for rows from stdin, as they come; those of a file are shown
        in the time that they were read in.
    session : Session
    """

    task: ContinuumEstimating
    session: Session
    rows: int = 0
    _begin: tuple[float, float] = (0.0, 0.0)

    async def run(self) -> None:
        """Show row after row, until there is none.

        Raises
        ------
        BozziniError
            If there is nothing to show, as the robot or the first row is not legal.
        """
        self.session.waiting = "Waiting for the first row of readings…"
        is_live = self.task.table == "-"
        rows = self.task.follow(sys.stdin if is_live else None)
        try:
            while (found := await run_beside(partial(_take_next, rows))) is not None:
                if not is_live:
                    await self._wait(float(found.times[-1]))
                self.show(found)
            self._say_end("these are all the rows")
        except BozziniError as error:
            if not self.rows:
                raise
            self._say_end(str(error))

    def _say_end(self, words: str) -> None:
        self.session.readings = f"{self.session.readings}\nEnded: {words}."

    async def _wait(self, moment: float) -> None:
        """Wait until a time of the rows [s]."""
        if not self.rows:
            self._begin = time.monotonic(), moment
        begin, first = self._begin
        await asyncio.sleep(begin + moment - first - time.monotonic())

    def show(self, found: EstimateHistory) -> None:
        """Show the estimate of a row."""
        (estimate,), session = found.estimates, self.session
        self.rows += 1
        session.readings = f"Row {self.rows}, {found.times[-1]:.2f} s\n{_describe(estimate)}"
        if not np.isfinite([*estimate.points.flat, *estimate.commanded.flat]).all():
            return
        surfaces = draw_estimate(estimate)
        title = f"Cockpit: robot {estimate.robot.name}"
        shown = draw_floor(estimate.robot), *surfaces
        view = encode_view(View(title=title, surfaces=shown))
        if session.view:
            session.view = view  # for windows that are opened later
        else:
            session.show_scene(view)
        session.show_surfaces([surface.vertices for surface in surfaces])


def _take_next(rows: Iterator[EstimateHistory]) -> EstimateHistory | None:
    return next(rows, None)


def _describe(found: ShapeEstimate) -> str:
    """Return what people read of an estimate."""
    if not found.converged:
        return f"There is no estimate: {found.reason}."
    places: Floats = np.stack([found.tip, BAND * found.deviations[-1]], axis=1)
    tip = ", ".join(f"{place:.1f} ± {half:.1f}" for place, half in places)
    away = float(np.linalg.norm(found.tip - found.commanded[-1]))
    lines = [
        f"Tip at {tip} mm ({BAND:g} standard deviations)",
        f"{away:.1f} mm from where the model alone has it",
    ]
    if not found.expected:
        lines.append(
            f"The readings are {found.surprise:.3g} times as far off as expected: the band is too "
            "narrow"
        )
    return "\n".join(lines)

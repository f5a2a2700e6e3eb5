"""A scripted operator: a window without a page that draws the thesis's line and circle (4.7)."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..numeric.arrays import Floats
from ..results import Json, ReasonedResult, list_coordinates, take_axes
from .drive import SEEN, DriveState, EffectorDrive
from .guard import Access

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from websockets.asyncio.client import ClientConnection

FigureKind = Literal["line", "circle"]

SIZE = 8.0
"""Radius of the circle, and half of the line, where the workspace is that wide [mm]."""
SHARE = 0.95
"""Of the widest circle in the workspace, at most."""
RISE = 1.5
"""From the rest to the figure [s]."""
TURN = 8.0
"""Once round the circle, or along the line and back [s]."""
RATE = 60.0
"""Of the stick's messages [Hz]."""


@dataclass(frozen=True, kw_only=True)
class Figure:
    """What the operator draws, about the axis.

    Attributes
    ----------
    kind : {"line", "circle"}
    size : float
        Radius of the circle, half the length of the line [mm].
    """

    kind: FigureKind
    size: float

    @property
    def duration(self) -> float:
        """From rest to the end [s]."""
        return RISE + TURN

    def place(self, time: float) -> Floats:
        """Return where the tip is wanted (2,) at a time [s]."""
        angle = 2.0 * math.pi * min(max(time - RISE, 0.0) / TURN, 1.0)
        share = min(time / RISE, 1.0)
        y = math.sin(angle) if self.kind == "circle" else 0.0
        return self.size * share * np.array([math.cos(angle), y])

    def measure_distance(self, places: Floats) -> Floats:
        """Return how far places (n, 2) are from the figure [mm]."""
        if self.kind == "circle":
            return np.asarray(np.abs(np.hypot(places[:, 0], places[:, 1]) - self.size))
        beyond = np.maximum(np.abs(places[:, 0]) - self.size, 0.0)
        return np.asarray(np.hypot(beyond, places[:, 1]))

    @classmethod
    def within(cls, kind: FigureKind, drive: EffectorDrive) -> Figure:
        """Return the figure of a size that the workspace has room for."""
        inner = drive.effector.workspace(directions=72, samples=1).inner_radius
        return cls(kind=kind, size=min(SIZE, SHARE * inner))


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawing(ReasonedResult):
    """What the operator drew.

    Attributes
    ----------
    figure : Figure
    rig : bool
        Whether there was a rig, or the model alone.
    by : str
        What was driven, for people.
    states : sequence of DriveState
        Of the drive, one after the other, from the beginning of the figure on.
    reason : str
        Why it is not whole; empty if it is.
    """

    figure: Figure
    rig: bool
    by: str
    states: Sequence[DriveState]
    reason: str = ""

    def __post_init__(self) -> None:
        if not self.states:
            object.__setattr__(self, "reason", self.reason or "nothing was drawn")

    @property
    def residual(self) -> float:
        """Root mean square of `errors` [mm]."""
        return float(np.sqrt(np.mean(self.errors**2))) if len(self.states) else 0.0

    def _stack(self, name: str) -> Floats:
        return np.array([getattr(state, name) for state in self.states])

    @property
    def errors(self) -> Floats:
        """Distances of the tip from where the stick wanted it at that time (n,) [mm]."""
        away = self._stack("tip") - self._stack("target")
        return np.asarray(np.linalg.norm(away, axis=-1))

    @property
    def off_path(self) -> Floats:
        """Distances of the tip from the figure, whatever the time (n,) [mm]."""
        return self.figure.measure_distance(self._stack("tip"))

    def to_dict(self) -> Json:
        """Return the errors as plain values."""
        known = len(self.states) > 0
        return {
            "figure": self.figure.kind,
            "size_mm": self.figure.size,
            "rig": self.rig,
            "converged": self.converged,
            "reason": self.reason,
            "samples": len(self.states),
            "error_rms_mm": self.residual if known else None,
            "error_max_mm": float(self.errors.max()) if known else None,
            "off_path_rms_mm": float(np.sqrt(np.mean(self.off_path**2))) if known else None,
            "off_path_max_mm": float(self.off_path.max()) if known else None,
        }

    def list_columns(self) -> Json:
        """Return the columns of `to_frame`, a row for each sample."""
        time = self._stack("time")
        columns: Json = {"time_s": time - time[:1]}
        for name in ("target", "delivered", "tip"):
            columns |= list_coordinates(name, self._stack(name).reshape(-1, 2))
        for name in ("setpoints", "measured"):
            values = self._stack(name).reshape(-1, 3)
            columns |= {f"{name}_{k + 1}_MPa": values[:, k] for k in range(3)}
        return {**columns, "error_mm": self.errors, "state": [each.name for each in self.states]}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw where the tip was wanted and where it was, seen along the axis."""
        axes = take_axes(ax, x="x [mm]", y="y [mm]", equal=True)
        label = "tip, from measured pressures" if self.rig else "tip, of the model"
        axes.plot(*self._stack("target").reshape(-1, 2).T, color="0.75", lw=4.0, label="stick")
        axes.plot(*self._stack("tip").reshape(-1, 2).T, lw=1.2, label=label)
        axes.legend(frameon=False, fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0))
        return axes

    def write_report(self, path: Path) -> None:
        """Write a page with the path, the error over time and the figures."""
        from matplotlib.figure import Figure as Picture

        from ..io.files import write_text
        from ..report.report import encode_figure
        from ..report.text import render_table

        picture = Picture(figsize=(9.0, 4.2), layout="constrained")
        left, right = picture.subplots(1, 2)
        self.plot(left)
        axes = take_axes(right, x="time [s]", y="error [mm]")
        time = self._stack("time")
        axes.plot(time - time[:1], self.errors, label="from the stick's target at that time")
        axes.plot(time - time[:1], self.off_path, label=f"from the {self.figure.kind}")
        axes.legend(frameon=False, fontsize=8)
        rows = [(name.replace("_", " "), _show(value)) for name, value in self.to_dict().items()]
        title = f"Drawn with the stick: a {self.figure.kind} of {self.figure.size:.3g} mm"
        write_text(
            path,
            _PAGE.format(
                title=escape(title),
                words=escape(self.describe()),
                picture=encode_figure(picture, dpi=120),
                rows=render_table(rows),
            ),
        )

    def describe(self) -> str:
        """Return what people read of it."""
        if not len(self.states):
            return f"Nothing was drawn: {self.reason}."
        found = self.to_dict()
        words = (
            f"A {self.figure.kind} of {self.figure.size:.3g} mm, by the {self.by}: the tip is "
            f"{found['error_rms_mm']:.2f} mm rms from where the stick wants it, "
            f"{found['error_max_mm']:.2f} mm at most; {found['off_path_rms_mm']:.2f} mm rms off "
            f"the {self.figure.kind}, {found['off_path_max_mm']:.2f} mm at most."
        )
        return f"{words} {self.reason}." if self.reason else words


_PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>{title}</title>
<meta http-equiv="Content-Security-Policy"
content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<style>
:root {{ color-scheme: light dark; }}
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; }}
img {{ width: 100%; background: #fff; border-radius: 8px; }}
th {{ text-align: left; font-weight: 500; padding-right: 2rem; }}
</style>
<h1>{title}</h1><p>{words}</p>
<img src="{picture}" alt="Left: the path of the tip. Right: its error over time.">
<table>{rows}</table>
"""


def _show(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    return ("yes" if value else "no") if isinstance(value, bool) else str(value)


async def draw(figure: Figure, drive: EffectorDrive, access: Access) -> Drawing:
    """Draw a figure with the stick, as a window of the cockpit does: through its web socket.

    Parameters
    ----------
    figure : Figure
    drive : EffectorDrive
        Of the session; with a rig it is armed before and disarmed afterwards.
    access : Access
        By which the server is reached.
    """
    from websockets.asyncio.client import connect
    from websockets.exceptions import ConnectionClosed

    host = f"127.0.0.1:{access.port}"
    query = f"?token={access.token}" if access.token else ""
    states: list[DriveState] = []
    reason = ""
    async with connect(f"ws://{host}/ws{query}", origin=f"http://{host}", max_size=None) as window:  # type: ignore[arg-type]
        hears = asyncio.create_task(_ignore(window))
        try:
            if drive.has_rig:
                await window.send(json.dumps({"kind": "rig", "what": "arm"}))
                reason = await _wait_for(drive, "ARMED")
            if not reason:
                reason = await _move(figure, drive, window, states)
        except ConnectionClosed:
            reason = "the connection to the cockpit has ended"
        finally:
            with suppress(ConnectionClosed):
                await window.send(json.dumps({"kind": "stick", "x": 0.0, "y": 0.0}))
                if drive.has_rig:
                    await window.send(json.dumps({"kind": "rig", "what": "disarm"}))
                    await _wait_for(drive, "DISARMED")
            hears.cancel()
            await asyncio.gather(hears, return_exceptions=True)
    return Drawing(figure=figure, rig=drive.has_rig, by=drive.name, states=states, reason=reason)


async def _move(
    figure: Figure, drive: EffectorDrive, window: ClientConnection, states: list[DriveState]
) -> str:
    """Move the stick along a figure; keep the states of the drive and return what went wrong."""
    loop = asyncio.get_running_loop()
    begin, number = loop.time(), 0

    def keep(state: DriveState) -> None:
        if loop.time() - begin >= RISE:
            states.append(state)

    drive.listeners.append(keep)
    try:
        while (time := loop.time() - begin) < figure.duration:
            x, y = SEEN * figure.place(time) / drive.scale
            await window.send(json.dumps({"kind": "stick", "x": x, "y": y}))
            if drive.has_rig and drive.state.name != "ARMED":
                return f"the rig has left ARMED: {drive.state.note or drive.state.name}"
            number = int(time * RATE) + 1
            await asyncio.sleep(begin + number / RATE - loop.time())
    finally:
        drive.listeners.remove(keep)
    return next((state.reason for state in states if state.reason), "")


async def _wait_for(drive: EffectorDrive, name: str) -> str:
    """Wait for a state of the rig; return why it does not come."""
    for _ in range(300):
        if drive.state.name == name:
            return ""
        await asyncio.sleep(0.01)
    return f"the rig does not become {name}: {drive.state.note or drive.state.name}"


async def _ignore(window: ClientConnection) -> None:
    """Take the frames, so that they do not pile up."""
    async for _ in window:
        pass

"""The motion of an end-effector under commands in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_array, check_kind
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import ReasonedResult, measured, tabulated, take_axes
from .motion import Acting, MotionState
from .section import Shapes, find_bends, shape_sections

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .effector import Effector


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectorTrack(ReasonedResult):
    """The motion of an end-effector, or of b of them, with the axis (b,) before that of time.

    Attributes
    ----------
    names : tuple of str
        The muscles.
    times : ndarray, shape (n,)
        Times [s].
    pressures, effective : ndarray, shape (..., n, m)
        In the muscles, and what they contract by [MPa].
    bends : ndarray, shape (..., n, 2)
        Of the body: bend [rad] of a section with pulls of its own, lateral deflection [mm] else.
    tip : ndarray, shape (..., n, 3)
        End of the backbone [mm].
    direction : ndarray, shape (..., n, 3)
        Unit vector there.
    state : MotionState
        At the last time; `initial` of what comes next.
    """

    names: tuple[str, ...]
    times: Floats = tabulated("s")
    pressures: Floats = tabulated("MPa", "pressure_{}", over="names")
    effective: Floats = tabulated("MPa", "effective_{}", over="names")
    bends: Floats
    tip: Floats = tabulated("mm", "tip_{}")
    direction: Floats = measured("")
    state: MotionState

    reason = ""
    residual = 0.0

    def list_columns(self) -> Mapping[str, object]:
        """Return the columns of `to_frame`, a row for each time; runs follow each other."""
        columns = dict(super().list_columns())
        repeats = self.tip[..., 0].size // self.times.size
        return {**columns, "time_s": np.tile(self.times, repeats)}

    def to_dict(self) -> dict[str, object]:
        """Return the motion as plain values, without the state."""
        return {
            "names": list(self.names),
            "columns": {
                name: np.asarray(column).tolist() for name, column in self.list_columns().items()
            },
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw both lateral coordinates over time, and return the axes."""
        axes = take_axes(ax, x="time [s]", y="tip, lateral [mm]")
        for k, name in enumerate("xy"):
            axes.plot(self.times, np.atleast_2d(self.tip[..., k]).T, f"C{k}", label=name)
        axes.legend()
        return axes


def simulate_effector(
    effector: Effector,
    times: ArrayLike,
    *,
    pressures: ArrayLike | Mapping[str, ArrayLike],
    initial: MotionState | None = None,
) -> EffectorTrack:
    """Return the motion of an end-effector, by its `EffectorMotion`, under commanded pressures.

    A command holds from its time to the next: the last one has not acted yet. The motion goes on
    with ``initial=track.state`` and times that begin where those of `track` ended.

    Parameters
    ----------
    effector : Effector
    times : array_like, shape (n,)
        Increasing [s].
    pressures : array_like, shape (..., n, m), or mapping
        Commanded pressures [MPa], of all muscles in order, or by name; a batch of runs may come
        before.
    initial : MotionState, optional
        At the first time; without it the muscles were brought up to the first commands, and stayed
        there.

    Raises
    ------
    InputError
        If times do not increase, a pressure is not legal, or a state is none of these runs.
    """
    over = check_array("times", times)
    if over.ndim != 1 or not len(over) or not np.isfinite(over).all():
        raise InputError(f"times have shape {over.shape}: they must be finite numbers (n,)")
    if (back := np.flatnonzero(np.diff(over) <= 0.0)).size:
        row = int(back[0])
        raise InputError(
            f"times[{row + 1}] is {over[row + 1]:g} s after {over[row]:g} s: times must increase"
        )
    table = effector.take_pressures(pressures)
    if table.ndim < 2 or table.shape[-2] != len(over):
        raise InputError(
            f"pressures have shape {table.shape}: they must be (..., {len(over)}, "
            f"{table.shape[-1]}), a row for each time"
        )
    batch = table.shape[:-2]
    runs = np.ascontiguousarray(table.reshape(-1, *table.shape[-2:]))
    if initial is not None:
        check_kind("initial", initial, MotionState)
        if np.shape(initial.pressures) != (len(runs), runs.shape[2]):
            raise InputError(
                f"initial has pressures {np.shape(initial.pressures)}: these runs need "
                f"{(len(runs), runs.shape[2])}"
            )
    acting, bends, shapes, state = move_section(effector, over, runs, initial=initial)
    rows = (*batch, len(over))
    return EffectorTrack(
        names=effector.design.names,
        times=over,
        pressures=acting.pressures.reshape(table.shape),
        effective=acting.effective.reshape(table.shape),
        bends=bends.reshape(*rows, 2),
        tip=shapes.points[:, 0].reshape(*rows, 3),
        direction=shapes.direction.reshape(*rows, 3),
        state=state,
    )


def move_section(
    effector: Effector, times: Floats, pressures: Floats, *, initial: MotionState | None
) -> tuple[Acting, Floats, Shapes, MotionState]:
    """Return what `simulate_effector` is made of, unchecked, of runs (b, n, m).

    These are the pressures that act, the bends (b, n, 2), the ends of the backbone of all rows, and
    the state at the last time.
    """
    acting = effector.motion.act(times, pressures, initial=initial)
    still = find_bends(effector, acting.effective.reshape(-1, pressures.shape[2]))
    bends, state = effector.motion.move(
        times, still.reshape(*pressures.shape[:2], 2), state=acting.state
    )
    length = np.array([effector.design.backbone_length])
    return acting, bends, shape_sections(effector, bends.reshape(-1, 2), length), state

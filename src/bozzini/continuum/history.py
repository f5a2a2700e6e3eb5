"""Histories of tendon commands: shapes on the way, and the loops that friction makes of them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer
from ..numeric.arrays import Floats
from ..results import Json, Result, list_coordinates, take_axes
from .shape import Shape

if TYPE_CHECKING:
    from matplotlib.axes import Axes


BATCHED = (
    "frames",
    "displacements",
    "tendon_lengths",
    "section_parameters",
    "tensions",
    "slack",
    "residual",
    "iterations",
    "converged",
    "reason",
    "stability",
)
"""Fields of a `Shape` with one value for each of the batch."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TendonHistory(Result):
    """Shapes of a robot in the order of time, each from the one before.

    Parameters
    ----------
    shapes : Shape
        A batch of ``n`` shapes.
    given : {"tensions", "displacements"}
        What was commanded.
    """

    shapes: Shape
    given: Literal["tensions", "displacements"]

    @property
    def converged(self) -> bool:
        """Whether every shape has converged."""
        return bool(np.all(self.shapes.converged))

    @property
    def reason(self) -> str:
        """Return why the first shape that has not converged has not; else nothing."""
        wrong = np.flatnonzero(~self.shapes.converged)
        return f"command {wrong[0]}: {self.shapes.reason[wrong[0]]}" if wrong.size else ""

    @property
    def residual(self) -> float:
        """Largest residual of the shapes [mm]."""
        return float(np.max(self.shapes.residual, initial=0.0))

    @property
    def work(self) -> Floats:
        """Work of the tensions at the base up to each shape [N mm], shape (n,).

        Over a closed loop it is what friction has taken: the area of the loops of tension over
        displacement.
        """
        pulls = self.shapes.tensions
        steps = 0.5 * (pulls[1:] + pulls[:-1]) * np.diff(self.shapes.displacements, axis=0)
        return np.concatenate([[0.0], np.cumsum(np.sum(steps, axis=1))])

    def pick(self, index: int) -> Shape:
        """Return one of the shapes, for ``initial=`` of what comes after it; -1 is the last.

        Raises
        ------
        InputError
            If there are not so many.
        """
        count = len(self.shapes.displacements)
        place = check_integer("index", index, low=-count, high=count - 1)
        parts = {name: getattr(self.shapes, name)[place] for name in BATCHED}
        state = self.shapes.friction
        return dataclasses.replace(
            self.shapes, **parts, friction=None if state is None else state.pick((place,))
        )

    def select(self, rows: NDArray[np.int64]) -> Shape:
        """Return some of the shapes as a batch, without their friction."""
        parts = {name: getattr(self.shapes, name)[rows] for name in BATCHED}
        return dataclasses.replace(self.shapes, **parts, friction=None)

    def to_dict(self) -> Json:
        """Return the verdict, and the shapes as `Shape.to_dict`."""
        verdict = {"converged": self.converged, "reason": self.reason, "given": self.given}
        return verdict | {"work_N_mm": self.work.tolist(), "shapes": self.shapes.to_dict()}

    def list_columns(self) -> dict[str, NDArray[np.generic]]:
        """Return the columns of `to_frame`: tensions, displacements and tip, a command each row."""
        shapes, names = self.shapes, self.shapes.robot.tendon_names
        columns: dict[str, NDArray[np.generic]] = {}
        for k, name in enumerate(names):
            columns |= {
                f"{name}_N": shapes.tensions[:, k],
                f"{name}_end_N": shapes.end_tensions[:, k],
                f"{name}_mm": shapes.displacements[:, k],
            }
        return columns | list_coordinates("tip", shapes.tip) | {"work_N_mm": self.work}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the tip over the command: how far it is from where it began, for every tendon.

        A tendon whose command does not change is left out.
        """
        unit = "N" if self.given == "tensions" else "mm"
        values = getattr(self.shapes, self.given)
        axes = take_axes(ax, x=f"{self.given[:-1]} [{unit}]", y="tip moved [mm]")
        good = self.shapes.converged
        moved = np.linalg.norm(self.shapes.tip - self.shapes.tip[0], axis=-1)
        for k, name in enumerate(self.shapes.robot.tendon_names):
            if np.unique(values[good, k]).size > 1:
                axes.plot(values[good, k], moved[good], label=name)
        return axes

"""The ends of a tract as numbered marks: in the report's table and in its pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..motion.plan import Plan
from .records import read_number

__all__ = ["EndMark", "list_marks"]


@dataclass(frozen=True, kw_only=True, eq=False)
class EndMark:
    """One place where a way could begin or end.

    Attributes
    ----------
    number : int
        From 1, in the table and in the pictures.
    name, role : str
        What it is, and what it was taken for.
    point : (3,) float
        World frame [mm].
    radius, length : float or None
        Of an opening; of the centreline from the opposite end [mm].
    """

    number: int
    name: str
    role: str
    point: NDArray[np.float64]
    radius: float | None
    length: float | None

    @property
    def place(self) -> str:
        """The point for people."""
        return ", ".join(f"{value:.1f}" for value in self.point)


def list_marks(plan: Plan) -> list[EndMark]:
    """Return the ends that a plan records, [] where it records none."""
    records = plan.meta.get("ends")
    if isinstance(records, str) or not isinstance(records, Sequence):
        return []
    marks: list[EndMark] = []
    for record in records:
        if not isinstance(record, Mapping):
            continue
        point = np.asarray(record.get("point_mm"), dtype=np.float64)
        if point.shape != (3,) or not np.isfinite(point).all():
            continue
        kind = {"opening": "opening ", "landmark": "landmark "}.get(str(record.get("kind")), "")
        marks.append(
            EndMark(
                number=len(marks) + 1,
                name=f"{kind}{record.get('name')}",
                role=str(record.get("role") or ""),
                point=point,
                radius=read_number(record, "radius_mm"),
                length=read_number(record, "length_mm"),
            )
        )
    return marks

"""What unions of shapes share: how they are packed for compiled kernels, and moved."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import ClassVar

import numpy as np

from ...numeric.arrays import Floats
from ..base import DuctShape, PackedDuct
from ..packed import ShapesData, measure_slack, pack_shapes

FAMILY: dict[int, type[ShapeUnion]] = {}
"""The class of each kind of shape that kernels know, by its code in `kernels.shapes`."""


class ShapeUnion(DuctShape, PackedDuct):
    """A union of shapes of one kind that compiled kernels know.

    A new kind is a frozen dataclass that brings its `code`, `numbers` and `move`, and a kernel of
    that code in `kernels.shapes`.
    """

    code: ClassVar[int]

    def __init_subclass__(cls) -> None:
        """Note the class by its code."""
        super().__init_subclass__()
        FAMILY[cls.code] = cls

    @abstractmethod
    def numbers(self) -> tuple[list[Floats], Floats]:
        """Return the numbers of each shape for its kernel, and bounding balls (k, 4) [mm]."""

    @staticmethod
    def move(row: Floats, rotation: Floats, shift: Floats) -> bool:
        """Move the numbers of a shape by ``x -> rotation x + shift``, or return False."""
        return False

    @property
    def family_shapes(self) -> ShapesData:
        """The shapes as kernels see them."""
        return self.pack()

    def pack(self) -> ShapesData:
        """Return the duct for compiled kernels."""
        return self._packed

    @cached_property
    def _packed(self) -> ShapesData:
        from ..kernels.shapes import inflate_shapes

        data = pack_shapes(self.code, *self.numbers(), planar=self.dim == 2)
        if self.inflation == 0.0:
            return data
        inflate_shapes(data.table, data.params, float(self.inflation))
        return data.bound()


def move_shapes(data: ShapesData, rotation: Floats, shift: Floats) -> ShapesData | None:
    """Return the shapes moved by ``x -> rotation x + shift`` (3-D); None if a kind cannot be."""
    params = data.params.copy()
    ends = np.append(data.first[1:], len(params))
    for kind, start, stop in zip(data.kinds, data.first, ends, strict=True):
        if not FAMILY[int(kind)].move(params[start:stop], rotation, shift):
            return None
    table = data.table.copy()
    table[:, :3] = table[:, :3] @ rotation.T + shift
    # The numbers are rounded once more.
    slack = data.slack + 2.0 * measure_slack(table[:, :4])
    return data._replace(params=params, table=table, slack=slack).bound()

"""Fluoroscopy: the lumen seen through the body, as on a barium X-ray, from its sampled field.

The picture is an orthographic projection along the grid axis that lies nearest to a world axis.
`SampledField.frame` states where the world's axes point in the patient; without it they are read
as RAS: +x to the patient's right, +y to the front, +z to the head. Views follow
radiological custom: the coronal view faces the patient (the patient's right is on the left of the
picture), the sagittal view looks from the patient's left (front on the left), the axial view looks
from the feet (front on top).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..anatomy.frame import find_axis
from ..checks import check_number, check_points, check_word
from ..errors import GeometryError
from ..results import Shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..anatomy.labels import Volume
    from ..anatomy.segment import Segmentation
    from ..duct.field import SampledField

# For each view: the world axis looked along, then the world directions of picture right and up.
VIEWS: dict[str, tuple[int, tuple[int, int], tuple[int, int]]] = {
    "coronal": (1, (0, -1), (2, +1)),
    "sagittal": (0, (1, -1), (2, +1)),
    "axial": (2, (0, -1), (1, +1)),
}

_LETTERS = (("L", "R"), ("P", "A"), ("I", "S"))
_ABSORPTION = 2.0
_SLAB_VOXELS = 500_000


@dataclass(frozen=True, kw_only=True)
class Projection(Shown):
    """A picture of the lumen and the map from the world onto it.

    Parameters
    ----------
    axis : {"coronal", "sagittal", "axial"}
        The view.
    image : (h, w) float32
        Brightness 0 (no lumen) to 1 (thickest lumen); row 0 is the top of the picture.
    thickness : (h, w) float32
        Length of the ray through the lumen behind each pixel [mm].
    extent : (left, right, bottom, top)
        Outer edges of the picture in its own coordinates (u to the right, v up) [mm].
    matrix : (2, 3) float
        ``(u, v) = matrix @ (x, y, z)``.
    labels : (left, right, bottom, top)
        Letters of the body directions: R/L, A/P, S/I.
    tilt : float
        Angle between the line of sight and the world axis the view is named after [rad]; the
        letters are approximate if it is not 0.
    """

    axis: str
    image: NDArray[np.float32]
    thickness: NDArray[np.float32]
    extent: tuple[float, float, float, float]
    matrix: NDArray[np.float64]
    labels: tuple[str, str, str, str]
    tilt: float

    @property
    def width(self) -> float:
        """Width of the picture [mm]."""
        return self.extent[1] - self.extent[0]

    @property
    def height(self) -> float:
        """Height of the picture [mm]."""
        return self.extent[3] - self.extent[2]

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return picture coordinates ``(..., 2)`` [mm] of world points ``(..., 3)`` [mm]."""
        result: NDArray[np.float64] = check_points("points", points) @ self.matrix.T
        return result


def render_fluoroscopy(
    field: SampledField, *, axis: str = "coronal", margin: float = 10.0
) -> Projection:
    """Return the lumen of a sampled field as seen along one body axis.

    Parameters
    ----------
    field : SampledField
        Signed distance on a grid; the grid may be rotated, mirrored and anisotropic. Its
        inflation counts: the picture is of the lumen that the scope sees.
    axis : {"coronal", "sagittal", "axial"}
        The view.
    margin : float
        Empty border left around the lumen [mm].

    Returns
    -------
    Projection

    Raises
    ------
    InputError
        If the view is unknown or the margin is negative.
    GeometryError
        If the field has no inside.
    """
    check_word("view", axis, VIEWS)
    check_number("margin", margin, low=0.0, unit="mm")
    along, right, up = VIEWS[axis]
    # Where the patient's right, front and head lie in the world.
    turn = np.stack([find_axis(field.frame or "RAS", side) for side in "RAS"])
    rotation = turn @ np.asarray(field.rotation, dtype=np.float64)
    spacing = np.asarray(field.spacing, dtype=np.float64)
    of_world = _match_axes(rotation)
    depth_axis, u_axis, v_axis = of_world[along], of_world[right[0]], of_world[up[0]]
    u_sign = right[1] * _sign(rotation[right[0], u_axis])
    v_sign = up[1] * _sign(rotation[up[0], v_axis])

    thickness = _measure_thickness(field, depth_axis)
    if v_axis < u_axis:
        thickness = thickness.T  # rows over u, columns over v
    # Now thickness[u, v] over node indices; flip so that both run along picture right and up.
    if u_sign < 0:
        thickness = thickness[::-1]
    if v_sign < 0:
        thickness = thickness[:, ::-1]
    matrix = np.stack([u_sign * rotation[:, u_axis], v_sign * rotation[:, v_axis]])
    matrix = matrix @ turn
    start = matrix @ np.asarray(field.origin, dtype=np.float64)
    if u_sign < 0:
        start[0] -= spacing[u_axis] * (thickness.shape[0] - 1)
    if v_sign < 0:
        start[1] -= spacing[v_axis] * (thickness.shape[1] - 1)
    step = spacing[[u_axis, v_axis]]
    thickness, start = _frame_lumen(thickness, start, step, margin)
    size = step * thickness.shape
    low = start - 0.5 * step
    drawing = np.ascontiguousarray(thickness.T[::-1])
    return Projection(
        axis=axis,
        image=_expose(drawing),
        thickness=drawing,
        extent=(
            float(low[0]),
            float(low[0] + size[0]),
            float(low[1]),
            float(low[1] + size[1]),
        ),
        matrix=matrix,
        labels=(
            _LETTERS[right[0]][int(right[1] < 0)],
            _LETTERS[right[0]][int(right[1] > 0)],
            _LETTERS[up[0]][int(up[1] < 0)],
            _LETTERS[up[0]][int(up[1] > 0)],
        ),
        tilt=math.acos(min(1.0, abs(float(rotation[along, depth_axis])))),
    )


def _sign(value: float) -> int:
    return -1 if value < 0 else 1


def _match_axes(rotation: NDArray[np.float64]) -> tuple[int, int, int]:
    """Return for each world axis the grid axis nearest to it, each used once."""
    best = max(
        itertools.permutations(range(3)),
        key=lambda order: sum(abs(rotation[world, order[world]]) for world in range(3)),
    )
    return best[0], best[1], best[2]


def _measure_thickness(field: SampledField, axis: int) -> NDArray[np.float32]:
    """Return the lumen's thickness along a grid axis [mm], the wall soft over one voxel."""
    values = field.values
    spacing = np.asarray(field.spacing, dtype=np.float64)
    softness = np.float32(1.0 / spacing.min())
    level = np.float32(0.5 + field.inflation / spacing.min())
    shape = tuple(n for k, n in enumerate(values.shape) if k != axis)
    total = np.zeros(shape, dtype=np.float32)
    # Slabs keep the scratch memory small on big volumes: cut along the first axis.
    rows = max(1, _SLAB_VOXELS // max(1, values[0].size))
    for first in range(0, values.shape[0], rows):
        slab = values[first : first + rows]
        filled = np.clip(level - slab * softness, 0.0, 1.0)
        if axis == 0:
            total += filled.sum(axis=0, dtype=np.float32)
        else:
            total[first : first + rows] = filled.sum(axis=axis, dtype=np.float32)
    if not total.any():
        raise GeometryError("the field has no inside: no node lies within the wall")
    return total * np.float32(spacing[axis])


def _frame_lumen(
    thickness: NDArray[np.float32],
    start: NDArray[np.float64],
    step: NDArray[np.float64],
    margin: float,
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Crop or pad to the lumen and a border around it."""
    for k in (0, 1):
        inside = np.flatnonzero(thickness.any(axis=1 - k))
        border = math.ceil(margin / step[k])
        first, last = int(inside[0]) - border, int(inside[-1]) + border + 1
        padding = [(0, 0), (0, 0)]
        padding[k] = (max(0, -first), max(0, last - thickness.shape[k]))
        keep = [slice(None), slice(None)]
        keep[k] = slice(max(0, first), min(last, thickness.shape[k]))
        start = start.copy()
        start[k] += step[k] * first
        thickness = np.pad(thickness[keep[0], keep[1]], padding)
    return thickness, start


def _expose(thickness: NDArray[np.float32]) -> NDArray[np.float32]:
    """Turn thickness into brightness: absorption saturates, so that thin parts stay visible."""
    whole = float(np.percentile(thickness[thickness > 0], 99.5))
    image = -np.expm1(-_ABSORPTION * thickness / whole) / -np.expm1(-_ABSORPTION)
    result: NDArray[np.float32] = np.minimum(image, 1.0).astype(np.float32)
    return result


def draw_segmentation(volume: Volume, result: Segmentation) -> Figure:
    """Return a figure of a scan's mean and its segments of gas, along the three voxel axes.

    Parameters
    ----------
    volume : Volume
        The scan [HU].
    result : Segmentation
    """
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure

    image = volume.array.reshape(result.labels.shape, order="A")
    spacing = np.linalg.norm(result.affine[:3, :3], axis=0)
    figure = Figure(figsize=(12.0, 5.0), dpi=100, layout="constrained")
    colours = ListedColormap([f"C{k % 10}" for k in range(len(result.segments))])
    inverse = np.linalg.inv(result.affine)
    for panel, axis in zip(figure.subplots(1, 3), (1, 0, 2), strict=True):
        across, up = (other for other in range(3) if other != axis)
        extent = (0.0, spacing[across] * image.shape[across], 0.0, spacing[up] * image.shape[up])
        mean = image.mean(axis=axis, dtype=np.float32).T
        panel.imshow(mean, cmap="gray", origin="lower", extent=extent)
        seen = result.labels.max(axis=axis).T
        panel.imshow(
            np.ma.masked_equal(seen, 0),
            cmap=colours,
            vmin=0.5,
            vmax=len(result.segments) + 0.5,
            origin="lower",
            extent=extent,
            alpha=0.6,
            interpolation="nearest",
        )
        for item in result.segments[:20]:
            place = (inverse @ (*item.point, 1.0))[:3] * spacing
            panel.annotate(str(item.label), (place[across], place[up]), color="white", ha="center")
        panel.set_xlabel(f"{'ijk'[across]} [mm]")
        panel.set_ylabel(f"{'ijk'[up]} [mm]")
    figure.suptitle(f"Gas below {result.threshold:g} HU in {result.source}, along the voxel axes")
    return figure

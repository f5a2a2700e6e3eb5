"""The length of a muscle between two ring marks, from one picture in front of a board of strips.

The picture gives the map from the board to its pixels: the pose of a calibrated camera, or a
homography with one radial term where there is no calibration. The muscle is found in the window,
the grey values along its axis are fitted by two bands with blurred edges, and their middles are
placed in the plane in which the rings are seen. Blur, exposure and gamma move the two edges of a
band in opposite directions: its middle stays where it is, and single edges do not.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ..checks import check_fields, quantity, show_apart
from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..results import Json, Result, Shown, take_axes
from .board import BORDER, Detection, StripBoard
from .camera import Camera, distort, prepare_pose
from .pictures import Picture, import_opencv
from .render import HungMuscle, Sensor

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Mode = Literal["pose", "homography"]

FEW_CORNERS, LEAST_CORNERS = 12, 8
"""Corners of the board below which a length is flagged, and refused."""

FLAGGED_MISS, REFUSED_MISS = 0.3, 1.0
"""Residuals of the corners, rms [px], above which a length is flagged, and refused."""

FLAGGED_WIDTH, REFUSED_WIDTH = 0.15, 0.5
"""Share by which a ring's length is off its nominal one."""

FLAGGED_CONTRAST, REFUSED_CONTRAST = 8.0, 4.0
"""Depth of a ring over the residuals of its fit, below which a length is flagged, and refused."""

FLAGGED_ANGLE = math.radians(5.0)
"""Angle of the muscle against the strips."""

FLAGGED_SATURATION = 0.05
"""Share of the muscle's pixels that are the largest possible."""

FLAGGED_DISTANCE = 0.03
"""Share by which the camera's distance is off the one that was measured by tape."""

MANUAL_PIXEL = 1.0
"""Standard uncertainty of a mark that a person has set [px]."""

_AMBIGUOUS = 0.6
_EVEN = 0.5
_APART = 3.0
_WIDEST = 0.6
"""Share of the window's width up to which a muscle is told from the paper."""
_LINES = 9
_SHARE = 0.3
"""Lines along the muscle, within this share of its diameter either side of the axis."""

_CORNER_NOISE = 0.05
"""Of a corner of the board, for predictions [px]."""
_PAPER = 0.85
_ROUND = 1.0 / math.sqrt(12.0)

_PIXEL_FLOOR = 0.012
"""Uncertainty of a ring's middle that no residual shows [px]: sampling and compression.

Measured: with it the errors of 170 rendered pictures, 10 of each condition that the tests have but
of other seeds, are 1.0 times the claimed uncertainty rms.
"""


@dataclass(frozen=True, kw_only=True)
class LengthOptions(Shown):
    """What is known of the muscle and of where it hangs.

    Parameters
    ----------
    height : float
        Of the muscle's axis over the board [mm].
    diameter : float
        Of the rings [mm].
    ring : float
        Length of a ring along the axis [mm].
    height_uncertainty : float
        Standard uncertainty of the height [mm].
    tilt_uncertainty : float
        Standard uncertainty of the axis's angle out of the plane of the board [rad], which one
        camera cannot see.
    distance : float
        Of the camera from the board, by tape measure [mm]; 0 if not measured. Needed without a
        calibrated camera, and with one a check.
    distance_uncertainty : float
        Its standard uncertainty [mm].
    """

    height: float = quantity(
        "length", "Of the muscle's axis over the board.", low=0.0, high=100.0, example="2.8 mm"
    )
    diameter: float = quantity("length", "Of the rings.", low=0.1, high=50.0, example="1.6 mm")
    ring: float = quantity(
        "length", "Length of a ring along the axis.", low=0.2, high=20.0, example="2 mm"
    )
    height_uncertainty: float = quantity(
        "length",
        "Standard uncertainty of the height.",
        default=0.3,
        low=0.0,
        high=10.0,
        by_name=True,
    )
    tilt_uncertainty: float = quantity(
        "angle",
        "Standard uncertainty of the angle between axis and board.",
        default=0.0175,
        low=0.0,
        high=0.3,
        by_name=True,
    )
    distance: float = quantity(
        "length",
        "Camera to board by tape; needed without cameras, else a check.",
        default=0.0,
        low=10.0,
        high=1e5,
        by_name=True,
    )
    distance_uncertainty: float = quantity(
        "length", "Standard uncertainty of that.", default=5.0, low=0.0, high=1e3, by_name=True
    )

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def seen_height(self) -> float:
        """Mean height of the surface along the lines that are sampled [mm]."""
        offsets = 2.0 * _SHARE * np.linspace(-1.0, 1.0, _LINES)
        return self.height + 0.5 * self.diameter * float(np.mean(np.sqrt(1.0 - offsets**2)))


@dataclass(frozen=True, kw_only=True, eq=False)
class MuscleLength(Result):
    """A length between two rings.

    Attributes
    ----------
    length : float
        Between the middles of the rings [mm].
    budget : dict
        Standard uncertainty that each cause brings [mm]: ``ring_1``, ``ring_2`` and ``map`` differ
        from picture to picture; ``scale``, ``height``, ``tilt``, ``distance`` and ``flatness`` are
        those of the set-up, in proportion to a length.
    marks : ndarray, shape (2, 2)
        Middles of the rings in the picture, the upper one on the board first [px].
    edges : ndarray, shape (4, 2)
        Edges of both rings in the picture, along the axis [px].
    rings : tuple of float
        Fitted lengths of the rings [mm]; NaN where a person set the mark.
    contrast : float
        Depth of the weaker ring over the residuals of its fit.
    plane_miss : float
        Residuals of the board's corners, rms [px].
    corners : int
        Corners of the board that were used.
    distance : float
        Of the camera from the board [mm].
    pitch : float
        Size of a pixel where the muscle is [mm].
    mode : str
        "pose" with a calibrated camera, else "homography".
    flags : tuple of str
        What speaks against the length.
    """

    length: float
    budget: dict[str, float]
    marks: Floats
    edges: Floats
    rings: tuple[float, float]
    contrast: float
    plane_miss: float
    corners: int
    distance: float
    pitch: float
    mode: Mode
    flags: tuple[str, ...] = ()

    converged = True
    reason = ""

    @property
    def residual(self) -> float:
        """Residuals of the board's corners, rms [px]."""
        return self.plane_miss

    @property
    def independent(self) -> float:
        """Standard uncertainty that differs from picture to picture [mm]."""
        return math.hypot(*(self.budget[name] for name in ("ring_1", "ring_2", "map")))

    @property
    def common(self) -> float:
        """Standard uncertainty that all lengths of a set-up share, as a share of the length."""
        shared = [value for name, value in self.budget.items() if name not in _INDEPENDENT]
        return math.hypot(*shared) / self.length

    @property
    def uncertainty(self) -> float:
        """Combined standard uncertainty [mm]."""
        return math.hypot(*self.budget.values())

    def to_dict(self) -> Json:
        """Return plain values with units in their names."""
        (x1, y1), (x2, y2) = self.marks.tolist()
        return {
            "length_mm": self.length,
            "u_mm": self.uncertainty,
            "u_independent_mm": self.independent,
            "u_common": self.common,
            "x1_px": x1,
            "y1_px": y1,
            "x2_px": x2,
            "y2_px": y2,
            "ring_1_mm": self.rings[0] if math.isfinite(self.rings[0]) else None,
            "ring_2_mm": self.rings[1] if math.isfinite(self.rings[1]) else None,
            "contrast": self.contrast if math.isfinite(self.contrast) else None,
            "plane_rms_px": self.plane_miss,
            "corners": self.corners,
            "distance_mm": self.distance,
            "pitch_mm": self.pitch,
            "mode": self.mode,
            **{f"u_{name}_mm": value for name, value in self.budget.items()},
            "flags": ";".join(self.flags),
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the error budget as bars; return the axes."""
        ax = take_axes(ax, x="standard uncertainty [mm]", y="")
        names = [*self.budget, "combined"]
        ax.barh(names, [*self.budget.values(), self.uncertainty])
        ax.invert_yaxis()
        return ax


_INDEPENDENT = ("ring_1", "ring_2", "map")


def measure_length(
    picture: Picture,
    board: StripBoard,
    *,
    options: LengthOptions,
    camera: Camera | None = None,
    marks: Floats | None = None,
) -> MuscleLength:
    """Measure the length between the two rings of a muscle in front of a board of strips.

    Parameters
    ----------
    picture : Picture
    board : StripBoard
    options : LengthOptions
    camera : Camera, optional
        The calibrated camera; its pose is found anew. Without one, `LengthOptions.distance` is
        needed.
    marks : ndarray, shape (2, 2), optional
        Middles of the rings that a person has set, in place of the detection [px].

    Returns
    -------
    MuscleLength

    Raises
    ------
    GeometryError
        If the board, the muscle or its two rings are not found, or are too poor for a length.
    InputError
        If the camera has another size than the picture, or a distance is missing.
    """
    if camera is None and not options.distance:
        raise InputError("without a calibrated camera the distance from the board must be given")
    if camera is not None and camera.size != picture.size:
        raise InputError(
            f"{picture.name} has {picture.size[0]} x {picture.size[1]} pixels, the camera was "
            f"calibrated with {camera.size[0]} x {camera.size[1]}"
        )
    seen = board.detect(picture)
    if len(seen.ids) < LEAST_CORNERS:
        found = f"{len(seen.ids)} corners of the board are seen, {LEAST_CORNERS} are needed"
        raise GeometryError(seen.reason or found)
    plane = _fit_pose(seen, camera) if camera else _fit_homography(seen, options.distance)
    if plane.miss > REFUSED_MISS:
        shown = show_apart(plane.miss, REFUSED_MISS, digits=2, form="f")
        raise GeometryError(
            f"the corners of the board miss by {shown[0]} px rms, more than "
            f"{shown[1]} px: another board, a bent one, or another camera"
        )
    flags = list(picture.flags)
    if len(seen.ids) < FEW_CORNERS:
        flags.append("few_corners")
    if plane.miss > FLAGGED_MISS:
        flags.append("plane_residual")
    if options.distance and abs(plane.distance / options.distance - 1.0) > FLAGGED_DISTANCE:
        flags.append("distance")
    depth = -options.seen_height
    if marks is None:
        axis = _find_axis(picture, board, plane, options)
        flags += axis.flags
        rings = _find_rings(picture, plane, axis, options)
        flags += rings.flags
        along = axis.start + np.outer(rings.middles, axis.direction)
        edges = axis.start + np.outer(rings.edges, axis.direction)
        ends, spread, widths, contrast = along, rings.spread, rings.widths, rings.contrast
        pixels = plane.project(_lift(ends, depth))
        lines = plane.project(_lift(edges, depth))
    else:
        pixels = np.asarray(marks, dtype=float)
        ends = plane.place(pixels, depth)
        pitch = plane.find_pitch(ends.mean(axis=0), depth)
        spread, widths = np.full(2, MANUAL_PIXEL * pitch), (math.nan, math.nan)
        contrast, lines = math.nan, np.full((4, 2), np.nan)
        flags.append("manual")
    length = float(np.linalg.norm(ends[1] - ends[0]))
    if length < 1e-6:
        raise GeometryError("the two marks are at the same place")
    budget = {
        "ring_1": float(spread[0]),
        "ring_2": float(spread[1]),
        "map": plane.spread_length(pixels, depth),
        **_share_budget(board, options, plane, ends, length),
    }
    margin = 2.0
    size = np.array(picture.size)
    if np.any(pixels < margin) or np.any(pixels > size - 1.0 - margin):
        flags.append("border")
    return MuscleLength(
        length=length,
        budget=budget,
        marks=pixels,
        edges=lines,
        rings=widths,
        contrast=contrast,
        plane_miss=plane.miss,
        corners=len(seen.ids),
        distance=plane.distance,
        pitch=plane.find_pitch(ends.mean(axis=0), depth),
        mode="pose" if camera else "homography",
        flags=tuple(dict.fromkeys(flags)),
    )


def predict_budget(
    camera: Camera,
    board: StripBoard,
    options: LengthOptions,
    *,
    length: float,
    sensor: Sensor,
) -> tuple[dict[str, float], int]:
    """Predict the error budget of a length in the middle of a board's window.

    A ring's middle has the least variance that the noise allows (Cramer and Rao) for an edge of the
    muscle's grey values, blurred by the sensor; the map has that of the corners that are seen.

    Parameters
    ----------
    camera : Camera
        Placed in front of the board. It is taken for calibrated unless the options have a distance.
    board : StripBoard
    options : LengthOptions
    length : float
        [mm]
    sensor : Sensor

    Returns
    -------
    budget : dict
        Standard uncertainty by cause [mm], see `MuscleLength.budget`.
    corners : int
        Corners of the board in the picture.

    Raises
    ------
    GeometryError
        If too few corners or not both rings are in the picture.
    """
    size = np.array(camera.size)
    pixels = camera.project(board.corners)
    inside = np.all((pixels > BORDER) & (pixels < size - 1.0 - BORDER), axis=1)
    count = int(inside.sum())
    if count < LEAST_CORNERS:
        raise GeometryError(f"{count} corners of the board are in view, {LEAST_CORNERS} are needed")
    noise = _CORNER_NOISE * np.random.default_rng(0).standard_normal((count, 2))
    seen = Detection(
        pixels[inside] + noise, board.corners[inside], np.flatnonzero(inside), camera.size
    )
    plane = _fit_homography(seen, options.distance) if options.distance else _fit_pose(seen, camera)
    left, top, right, foot = board.window
    middle = np.array([0.5 * (left + right), 0.5 * (top + foot)])
    ends = middle + np.outer([-0.5, 0.5], [0.0, length])
    depth = -options.seen_height
    marks = camera.project(_lift(ends, depth))
    reach = camera.project(
        _lift(middle + np.outer([-0.5, 0.5], [0.0, length + 3.0 * options.ring]), depth)
    )
    if np.any(reach < 2.0) or np.any(reach > size - 3.0):
        raise GeometryError(f"rings {length:g} mm apart are not both in the picture")
    pitch = plane.find_pitch(middle, depth)
    body, ring = (
        albedo * sensor.exposure / _PAPER for albedo in (HungMuscle.body, HungMuscle.dark)
    )
    mean = 0.5 * (body + ring)
    slope = mean ** (1.0 / sensor.gamma - 1.0) / sensor.gamma
    spread = math.hypot(
        sensor.noise * math.sqrt(0.1 + 0.9 * mean) * slope, _ROUND / (2**sensor.bits)
    )
    depth_of_ring = body ** (1.0 / sensor.gamma) - ring ** (1.0 / sensor.gamma)
    lines = max(2.0 * _SHARE * options.diameter / pitch, 1.0)
    edge = (
        spread
        / depth_of_ring
        * math.sqrt(2.0 * math.sqrt(math.pi) * math.hypot(sensor.blur, 0.3) / lines)
    )
    ring_spread = pitch * math.hypot(edge / math.sqrt(2.0), _PIXEL_FLOOR)
    return {
        "ring_1": ring_spread,
        "ring_2": ring_spread,
        "map": plane.spread_length(marks, depth),
        **_share_budget(board, options, plane, ends, length),
    }, count


def _share_budget(
    board: StripBoard, options: LengthOptions, plane: _Plane, ends: Floats, length: float
) -> dict[str, float]:
    """Return the terms that all lengths of a set-up share [mm]."""
    direction = (ends[1] - ends[0]) / length
    off = abs(float((ends.mean(axis=0) - plane.foot) @ direction))
    angle, away = options.tilt_uncertainty, plane.distance
    terms = {
        "scale": length * board.scale_uncertainty,
        "height": length * options.height_uncertainty / away,
        # Of an angle about 0: its cosine, and where the rings move when seen from the side.
        "tilt": length * math.hypot(0.5 * math.sqrt(3.0) * angle**2, angle * off / away),
        "flatness": length * board.flatness / away,
    }
    if plane.is_taped:
        terms["distance"] = length * options.seen_height * options.distance_uncertainty / away**2
    return terms


def _lift(points: Floats, depth: float) -> Floats:
    """Return points (n, 2) of the plane z = depth as (n, 3)."""
    return np.column_stack([points, np.full(len(points), depth)])


# From the board to the picture.

_Project = Callable[[Floats, Floats], Floats]


@dataclass(frozen=True, eq=False)
class _Plane:
    """How points in front of the board are seen: parameters, their covariance, and residuals."""

    parameters: Floats
    covariance: Floats
    miss: float
    image: _Project
    distance: float
    foot: Floats
    is_taped: bool

    def project(self, points: Floats) -> Floats:
        return self.image(self.parameters, points)

    def place(self, pixels: Floats, depth: float, parameters: Floats | None = None) -> Floats:
        """Return where pixels (n, 2) lie in the plane z = depth, by Newton's steps."""
        given = self.parameters if parameters is None else parameters
        points = np.tile(self.foot, (len(pixels), 1))
        step = 1e-3
        for _ in range(30):
            here = self.image(given, _lift(points, depth))
            slope = np.stack(
                [
                    (self.image(given, _lift(points + step * side, depth)) - here) / step
                    for side in np.eye(2)
                ],
                axis=-1,
            )
            move = np.linalg.solve(slope, (pixels - here)[..., None])[..., 0]
            points = points + move
            if np.abs(move).max() < 1e-7:
                break
        return points

    def find_pitch(self, point: Floats, depth: float) -> float:
        """Return the size of a pixel at a point of the plane z = depth [mm]."""
        around = self.project(_lift(point + np.array([[0, 0], [1, 0], [0, 1]]), depth))
        return 1.0 / math.sqrt(abs(float(np.linalg.det(around[1:] - around[0]))))

    def spread_length(self, pixels: Floats, depth: float) -> float:
        """Return the uncertainty of the distance of two pixels that the parameters bring [mm]."""
        step = np.sqrt(np.diag(self.covariance))
        slope = np.zeros(len(step))
        for k in np.flatnonzero(step > 0.0):
            shift = np.zeros(len(step))
            shift[k] = step[k]
            ends = [
                self.place(pixels, depth, self.parameters + sign * shift) for sign in (1.0, -1.0)
            ]
            far, near = (float(np.linalg.norm(end[1] - end[0])) for end in ends)
            slope[k] = (far - near) / (2.0 * step[k])
        return float(np.sqrt(slope @ self.covariance @ slope))


def _fit_plane(image: _Project, start: Floats, seen: Detection) -> tuple[Floats, Floats, float]:
    """Fit the parameters of an image to the corners of a board; see `_Plane`."""
    from scipy.optimize import least_squares

    scale = np.maximum(np.abs(start), 1e-3)

    def miss(share: Floats) -> Floats:
        return (image(share * scale, seen.points) - seen.corners).ravel()

    found = least_squares(miss, start / scale, loss="soft_l1", f_scale=0.3, method="trf")
    residuals = miss(found.x)
    free = max(residuals.size - start.size, 1)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * float(residuals @ residuals) / free
    rms = float(np.sqrt(2.0 * np.mean(residuals**2)))
    return found.x * scale, covariance * np.outer(scale, scale), rms


def _fit_pose(seen: Detection, camera: Camera) -> _Plane:
    """Return the pose of a calibrated camera."""
    from scipy.spatial.transform import Rotation

    cv2 = import_opencv()

    def image(pose: Floats, points: Floats) -> Floats:
        inside = points @ Rotation.from_rotvec(pose[:3]).as_matrix().T + pose[3:]
        bent = distort(inside[:, :2] / inside[:, 2:], camera.distortion)
        return np.asarray(bent @ camera.matrix[:2, :2].T + camera.matrix[:2, 2])

    start = _solve_pose(cv2, seen.points, *prepare_pose(camera, seen.corners))
    pose, covariance, miss = _fit_plane(image, start, seen)
    turn = Rotation.from_rotvec(pose[:3]).as_matrix()
    centre = -turn.T @ pose[3:]
    return _Plane(pose, covariance, miss, image, -float(centre[2]), centre[:2], False)


def _solve_pose(
    cv2: object, points: Floats, pixels: Floats, matrix: Floats, distortion: Floats
) -> Floats:
    """Return a rotation vector and translation of the board, to start from."""
    found, rotation, shift = cv2.solvePnP(  # type: ignore[attr-defined]
        np.ascontiguousarray(points),
        np.ascontiguousarray(pixels),
        matrix,
        distortion,
        flags=cv2.SOLVEPNP_IPPE,  # type: ignore[attr-defined]
    )
    if not found:
        raise GeometryError("the pose of the board is not determined by its corners")
    return np.concatenate([np.ravel(rotation), np.ravel(shift)])


def _fit_homography(seen: Detection, distance: float) -> _Plane:
    """Return a homography with one radial term about the middle of the picture."""
    cv2 = import_opencv()
    size = np.array(seen.size, dtype=float)
    middle, wide = 0.5 * (size - 1.0), float(size.max())
    start, _ = cv2.findHomography(
        seen.points[:, :2], (seen.corners - middle) / wide, cv2.RANSAC, 3.0 / wide
    )
    if start is None:
        raise GeometryError("the corners of the board do not lie on a plane")
    # Where the camera is: of a lens without distortion whose focal length suits the distance.
    centre = seen.points[:, :2].mean(axis=0)
    around = cv2.perspectiveTransform(
        (centre + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))[:, None], start
    )[:, 0]
    focal = wide * distance * math.sqrt(abs(float(np.linalg.det(around[1:] - around[0]))))
    matrix = np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])
    pose = _solve_pose(cv2, seen.points, seen.corners, matrix, np.zeros(5))
    turn, _ = cv2.Rodrigues(pose[:3])
    foot = (-turn.T @ pose[3:])[:2]

    def image(values: Floats, points: Floats) -> Floats:
        # A point in front of the board is seen where its ray meets the board.
        stretch = distance / (distance + points[:, 2:])
        flat = foot + stretch * (points[:, :2] - foot)
        mapped = (
            np.column_stack([flat, np.ones(len(flat))]) @ np.append(values[:8], 1.0).reshape(3, 3).T
        )
        plain = mapped[:, :2] / mapped[:, 2:]
        square = np.sum(plain**2, axis=1, keepdims=True)
        return np.asarray(middle + wide * plain * (1.0 + values[8] * square))

    values = np.append(start.ravel()[:8] / start[2, 2], 0.0)
    values, covariance, miss = _fit_plane(image, values, seen)
    return _Plane(values, covariance, miss, image, distance, foot, True)


# The muscle and its rings.


@dataclass(frozen=True, eq=False)
class _Axis:
    """The straight axis of the muscle in the plane in which its rings are seen."""

    start: Floats
    direction: Floats
    reach: tuple[float, float]
    pitch: float
    flags: tuple[str, ...]


def _sample(picture: Picture, pixels: Floats, order: int) -> Floats:
    """Return grey values at pixels (..., 2), from the part of the picture around them."""
    from scipy.ndimage import map_coordinates

    low = np.clip(np.floor(pixels.reshape(-1, 2).min(axis=0)).astype(int) - 8, 0, None)
    high = np.ceil(pixels.reshape(-1, 2).max(axis=0)).astype(int) + 9
    part = picture.values[low[1] : high[1], low[0] : high[0]]
    if part.size == 0:
        raise GeometryError("the muscle is not in the picture")
    where = np.moveaxis(pixels - low, -1, 0)[::-1]
    return np.asarray(map_coordinates(part, where, order=order, mode="nearest"), dtype=float)


def _find_axis(picture: Picture, board: StripBoard, plane: _Plane, options: LengthOptions) -> _Axis:
    """Find the muscle in the window of the board: what is tall and not like the paper."""
    from scipy import ndimage
    from scipy.optimize import least_squares

    depth = -options.seen_height
    left, top, right, foot = board.window
    pitch = plane.find_pitch(np.array([0.5 * (left + right), 0.5 * (top + foot)]), depth)
    step = min(1.5 * pitch, options.diameter / 6.0)
    side = 1.5 + 0.02 * (right - left)
    across, along = np.arange(left + side, right - side, step), np.arange(top, foot, step)
    grid = np.stack(np.meshgrid(across, along), axis=-1)
    pixels = plane.project(_lift(grid.reshape(-1, 2), depth)).reshape(grid.shape)
    inside = np.all((pixels > 1.0) & (pixels < np.array(picture.size) - 2.0), axis=-1)
    rows = inside.all(axis=1)
    if rows.sum() * step < 4.0 * options.ring:
        raise GeometryError("the window of the board is not in the picture")
    grid, pixels, along = grid[rows], pixels[rows], along[rows]
    values = ndimage.gaussian_filter(_sample(picture, pixels, 1), 0.7)
    width = 2 * round(1.5 * options.diameter / step) + 1
    most = max(width, round(_WIDEST * len(across)))
    paper = ndimage.grey_closing(ndimage.gaussian_filter(values, 1.5), size=(1, most))
    ratio = values / np.maximum(ndimage.uniform_filter(paper, width), 1e-3)
    noise = 1.4826 * float(np.median(np.abs(ratio - np.median(ratio))))
    body = _take_tallest(ratio < float(np.median(ratio)) - max(5.0 * noise, 0.05), step, options)
    level = 0.5 * (float(np.median(ratio)) + float(np.median(ratio[body])))
    body = _take_tallest(ratio < level, step, options)
    filled = np.flatnonzero(body.any(axis=1))
    first = body[filled].argmax(axis=1)
    last = body.shape[1] - 1 - body[filled][:, ::-1].argmax(axis=1)
    middles = across[0] + 0.5 * step * (first + last)
    heights = along[filled]
    line = least_squares(
        lambda p: p[0] + p[1] * (heights - heights.mean()) - middles,
        [float(np.median(middles)), 0.0],
        loss="soft_l1",
        f_scale=step,
    ).x
    direction = np.array([line[1], 1.0]) / math.hypot(line[1], 1.0)
    start = np.array([line[0], heights.mean()])
    flags = []
    if abs(math.atan(line[1])) > FLAGGED_ANGLE:
        flags.append("angle")
    wide = step * float(np.median(last - first + 1))
    if abs(wide / options.diameter - 1.0) > 0.4:
        flags.append("diameter")
    covered = pixels[body]
    bright = picture.values[
        np.round(covered[:, 1]).astype(int), np.round(covered[:, 0]).astype(int)
    ]
    if np.mean(bright >= 1.0 - 0.5 / (2**picture.bits - 1)) > FLAGGED_SATURATION:
        flags.append("saturated")
    reach = (heights[[0, -1]] - heights.mean()) / direction[1]
    return _Axis(start, direction, (float(reach[0]), float(reach[1])), pitch, tuple(flags))


def _take_tallest(
    mask: NDArray[np.bool_], step: float, options: LengthOptions
) -> NDArray[np.bool_]:
    """Return the part of a mask that reaches down furthest, or raise `GeometryError`."""
    from scipy import ndimage

    numbers, count = ndimage.label(mask, np.ones((3, 3)))
    places = ndimage.find_objects(numbers)
    heights = [place[0].stop - place[0].start for place in places]
    if not count or max(heights) * step < (1.0 + _APART) * options.ring:
        raise GeometryError("no muscle is seen in the window of the board")
    return np.asarray(numbers == 1 + int(np.argmax(heights)))


@dataclass(frozen=True, eq=False)
class _Rings:
    """The two rings along the axis [mm]."""

    middles: Floats
    edges: Floats
    spread: Floats
    widths: tuple[float, float]
    contrast: float
    flags: tuple[str, ...]


def _find_rings(picture: Picture, plane: _Plane, axis: _Axis, options: LengthOptions) -> _Rings:
    """Find two rings along the axis and fit their edges."""
    step = 0.5 * axis.pitch
    along = np.arange(*axis.reach, step)
    normal = np.array([axis.direction[1], -axis.direction[0]])
    offsets = _SHARE * options.diameter * np.linspace(-1.0, 1.0, _LINES)
    points = axis.start + along[:, None, None] * axis.direction + offsets[None, :, None] * normal
    pixels = plane.project(_lift(points.reshape(-1, 2), -options.seen_height))
    grey = _sample(picture, pixels.reshape(len(along), _LINES, 2), 3).mean(axis=1)
    places, sign, flags = _pick_rings(grey, options.ring / step)
    fits = [_fit_band(along, sign * grey, along[place], options.ring, step) for place in places]
    order = np.argsort([fit.middle for fit in fits])
    fits = [fits[k] for k in order]
    widths = [fit.edges[1] - fit.edges[0] for fit in fits]
    contrast = min(fit.contrast for fit in fits)
    off = max(abs(width / options.ring - 1.0) for width in widths)
    if off > REFUSED_WIDTH:
        words = " and ".join(f"{width:.2f}" for width in widths)
        raise GeometryError(
            f"the rings are {words} mm long, nominally {options.ring:g} mm: no rings, or hidden"
        )
    if contrast < REFUSED_CONTRAST:
        raise GeometryError(
            f"a ring's depth is {contrast:.1f} times the noise, {REFUSED_CONTRAST:g} is needed"
        )
    if off > FLAGGED_WIDTH:
        flags.append("ring_width")
    if contrast < FLAGGED_CONTRAST:
        flags.append("low_contrast")
    floor = _PIXEL_FLOOR * axis.pitch
    return _Rings(
        np.array([fit.middle for fit in fits]),
        np.concatenate([fit.edges for fit in fits]),
        np.array([math.hypot(fit.spread, floor) for fit in fits]),
        (float(widths[0]), float(widths[1])),
        contrast,
        tuple(flags),
    )


def _pick_rings(grey: Floats, ring: float) -> tuple[list[int], float, list[str]]:
    """Return where the two best bands of a profile are, and 1 if they are bright, -1 if dark."""
    from scipy.ndimage import uniform_filter1d

    wide, half = max(3, round(ring)), max(2, round(0.5 * ring))
    inner = uniform_filter1d(grey, wide)
    outer = uniform_filter1d(grey, half)
    reach = half + half // 2
    best: tuple[float, list[int], float, list[float]] = (0.0, [], 0.0, [])
    for sign in (-1.0, 1.0):
        score = np.full(len(grey), -np.inf)
        middle = slice(reach, len(grey) - reach)
        flanks = np.stack([outer[: -2 * reach], outer[2 * reach :]])
        # Both flanks must differ: an edge alone is no band.
        score[middle] = np.min(sign * (inner[middle] - flanks), axis=0)
        peaks, heights = [], []
        for _ in range(3):
            k = int(np.argmax(score))
            if not score[k] > 0.0:
                break
            peaks.append(k)
            heights.append(float(score[k]))
            score[max(0, k - round(_APART * ring)) : k + round(_APART * ring)] = -np.inf
        if len(heights) > 1 and heights[1] > best[0]:
            best = heights[1], peaks[:2], sign, heights
    _, places, sign, heights = best
    if len(places) < 2 or heights[1] < _EVEN * heights[0]:
        raise GeometryError("fewer than two rings are seen on the muscle")
    unsure = len(heights) > 2 and heights[2] > _AMBIGUOUS * heights[0]
    return places, sign, ["ambiguous"] if unsure else []


@dataclass(frozen=True, eq=False)
class _Band:
    """A fitted band: middle and edges [mm], uncertainty of the middle, depth over residuals."""

    middle: float
    edges: Floats
    spread: float
    contrast: float


def _fit_band(along: Floats, grey: Floats, place: float, ring: float, step: float) -> _Band:
    """Fit a bright band with blurred edges on a sloping ground."""
    from scipy.optimize import least_squares
    from scipy.special import erf

    near = np.abs(along - place) <= 1.25 * ring
    x, values = along[near] - place, grey[near]
    low, high = float(values.min()), float(values.max())
    start = [low, 0.0, high - low, -0.5 * ring, 0.5 * ring, 2.0 * step]

    def miss(p: Floats) -> Floats:
        wide = math.sqrt(2.0) * max(abs(p[5]), 0.2 * step)
        band = 0.5 * p[2] * (erf((x - p[3]) / wide) - erf((x - p[4]) / wide))
        return np.asarray(p[0] + p[1] * x + band - values)

    depth = max(high - low, 1e-6)
    scale = [depth, depth / ring, depth, step, step, step]
    found = least_squares(
        miss, start, loss="soft_l1", f_scale=0.05 * depth, x_scale=scale, max_nfev=100
    )
    residuals = miss(found.x)
    variance = float(residuals @ residuals) / max(len(x) - 6, 1)
    edges = np.sort(found.x[3:5]) + place
    middle = float(edges.mean())
    # What is alike on both sides of the middle does not move it: gamma, and the shape of the blur.
    odd = 0.5 * (residuals - np.interp(2.0 * (middle - place) - x, x, residuals))
    weights = 0.5 * np.linalg.pinv(found.jac)[3:5].sum(axis=0)
    spread = math.sqrt(2.0 * _sum_correlated(weights, odd) / max(len(x) - 4, 1))
    noise = max(math.sqrt(variance), 1e-9)
    return _Band(middle, edges, spread, abs(float(found.x[2])) / noise)


def _sum_correlated(weights: Floats, residuals: Floats) -> float:
    """Return the variance of a weighted sum of residuals, times their number.

    Their autocorrelation counts up to where it ends.
    """
    total = float(residuals @ residuals) * float(weights @ weights)
    for lag in range(1, len(residuals) // 4):
        shared = float(residuals[lag:] @ residuals[:-lag])
        if shared <= 0.0:
            break
        total += 2.0 * shared * float(weights[lag:] @ weights[:-lag])
    return max(total, 0.0)

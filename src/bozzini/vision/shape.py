"""The shape of a tube from its silhouettes in two calibrated pictures.

The centrelines of both silhouettes are matched by epipolar geometry, which gives points in space. A
rod whose curvature varies smoothly is fitted to them and then to the tube's edges and rings, which
are looked for where the rod has them. Its points, tip, tangent and length carry uncertainties; a
shape that is not to be trusted is refused with a reason, and its numbers are NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_fields, quantity, show_apart
from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..numeric.least_squares import sum_loss, weigh
from ..numeric.polylines import (
    carry_frames,
    interpolate_polyline,
    measure_arc_length,
    resample_polyline,
)
from ..results import Json, ReasonedResult, Shown, list_coordinates, take_axes, to_plain
from .camera import Camera, CameraSet, distort, triangulate
from .kernels.rods import bend_rod, match_curves, miss_line, outline_tube
from .pictures import Picture
from .silhouette import BLUR, BLURRED_CONTRAST, Silhouette, find_silhouette, sample_values

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STEPS = 96
"""Arcs of a rod."""
LENGTH, RADIUS = -2, -1
CURVATURES, MORE_CURVATURES = 5, 20
"""Coefficients of the curvature about each axis, and those of a rod that bends unevenly."""

MOST_RESIDUAL = 0.6
"""Of the edges, root mean square [px]; above it the shape is refused, as by the limits below."""
LEAST_COVERAGE = 0.8
"""Share of the edges that were found, over both pictures."""
MOST_TIP_UNCERTAINTY = 0.5
"""[mm]"""
MOST_RADIUS_ERROR = 0.05
"""Share of the radius by which the one found may differ from the one given."""
MOST_EPIPOLAR = 0.1
"""Of the distance from matched points to the rod, root mean square [mm], or..."""
MOST_EPIPOLAR_PIXELS = 2.0
"""...in pixels at the tube, whichever is more."""
MOST_LENGTH_ERROR = 0.3
"""Difference from the length that is given [mm], or three uncertainties if less; and 0.2 mm."""
LENGTH_OFF = 0.1
"""Difference from the length that is given, above which it is flagged [mm]."""
MOST_SATURATED = 0.05
"""Share of the tube with the largest value, above which it is flagged."""
END_ON = math.radians(25.0)
"""Angle between tube and ray below which the shape is flagged [rad]."""

_UNEVEN = 1.2
"""What neighbouring edges miss a rod by together, as a share of the blur: above it the rod has more
coefficients."""
_NO_EFFECT = 2e-6
"""Effect of a change of parameters that is taken for none, as a share of the largest."""
_FINE_BEND = 0.3
"""Usual bend of the whole rod by a coefficient beyond the first ones [rad]."""
_LIMB_SHARE = 0.08
"""Standard uncertainty of a whole limb by the model of its light, as a share of the blur."""
_CAP = 20.0
"""Most that a point or edge may miss by [px]."""
_EDGE_STEP = 2.5
"""Spacing of edges along a limb [px]."""
_EDGE_SIGMA, _RING_SIGMA = 0.1, 0.1
"""Least standard uncertainties that an edge and a ring along the tube are weighted by [px]."""
_RING_ERROR = 0.05
"""Least standard uncertainty of a ring along the tube [px]."""
_BLURS = np.array([0.5, 0.7, 0.9, 1.2, 1.6, 2.1, 2.8, 3.7, 5.0])
"""Standard deviations of the blur that are tried [px]."""


@dataclass(frozen=True, kw_only=True)
class ShapeOptions(Shown):
    """What is known of a tube.

    Parameters
    ----------
    diameter : float
        Of the tube [mm].
    length : float
        Between the middles of its rings [mm]; 0 if it is not known.
    ring : float
        Length of a ring along the tube [mm].
    holder : float
        Length of a straight holder beyond the ring at the tip [mm]: the tip is its end.
    base : str
        The side of the pictures that the tube's base is nearest to.
    gamma : float
        Exponent of the stored values: their power by it is the light; 1 for linear pictures.
    points : int
        Points of the shape, from one ring to the other.
    """

    diameter: float = quantity("length", "Of the tube.", default=7.0, low=0.1, high=1e3)
    length: float = quantity(
        "length", "Between the rings; 0 if not known.", default=0.0, low=0.0, high=1e4
    )
    ring: float = quantity("length", "Length of a ring.", default=2.0, low=0.1, high=100.0)
    holder: float = quantity(
        "length", "Straight, beyond the tip ring.", default=0.0, low=0.0, by_name=True
    )
    base: str = quantity(
        "text",
        "Side of the pictures where the base is.",
        default="bottom",
        words=("bottom", "top", "left", "right"),
        by_name=True,
    )
    gamma: float = quantity(
        help="Exponent of stored values.", default=2.2, low=0.1, high=10.0, by_name=True
    )
    points: int = quantity(
        help="Points of a shape.", default=25, low=2, high=1000, whole=True, by_name=True
    )

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class BackboneShape(ReasonedResult):
    """The measured shape of a tube, with its uncertainty; NaN where it is refused.

    Attributes
    ----------
    arc_length : ndarray, shape (n,)
        Of the points, from the base's ring [mm].
    points : ndarray, shape (n, 3)
        On the axis, in the world of the cameras [mm].
    covariance : ndarray, shape (n, 3, 3)
        Of each point: edges, calibration and model [mm^2].
    tip : ndarray, shape (3,)
        The end of the holder, or the tip's ring without one [mm].
    tip_covariance : ndarray, shape (3, 3)
        [mm^2]
    tangents : ndarray, shape (n, 3)
        Unit vectors along the axis.
    tangent_uncertainty : ndarray, shape (n,)
        Standard uncertainty of their direction, the larger one across [rad].
    length, length_uncertainty : float
        Between the rings [mm].
    radius, radius_uncertainty : float
        Of the tube [mm].
    residual : float
        Of the edges, root mean square [px].
    ring_residual : float
        The largest of a ring, along the tube [px].
    epipolar_residual : float
        Of the points matched between both pictures from the rod, root mean square [mm].
    view_angle : float
        The least angle between the tube and a ray to it [rad].
    coverage : float
        Share of the edges that were found, in the picture with fewer.
    rings : ndarray of bool, shape (2, 2)
        Whether each picture shows the base's ring and the tip's.
    parts : tuple of int
        Pieces of the silhouettes.
    contrast : float
        The lower one, in standard deviations of the noise.
    saturated : float
        Share of the tube with the largest value, in the picture with more.
    flags : tuple of str
        What was noticed.
    reason : str
        Why the shape is refused; empty if it is not.
    limbs : tuple of ndarray, shape (2, m, 2)
        The fitted tube's limbs in each picture [px], also where the shape is refused; empty if
        there is none.
    centrelines : tuple of ndarray, shape (k, 2)
        Of the silhouettes [px].
    ring_pixels : ndarray, shape (2, 2, 2)
        Where each picture shows the rings of base and tip [px].
    options : ShapeOptions
    world : str
        What the frame of the points is.
    """

    arc_length: Floats
    points: Floats
    covariance: Floats
    tip: Floats
    tip_covariance: Floats
    tangents: Floats
    tangent_uncertainty: Floats
    length: float
    length_uncertainty: float
    radius: float
    radius_uncertainty: float
    residual: float
    ring_residual: float
    epipolar_residual: float
    view_angle: float
    coverage: float
    rings: NDArray[np.bool_]
    parts: tuple[int, ...]
    contrast: float
    saturated: float
    flags: tuple[str, ...]
    reason: str
    limbs: tuple[Floats, ...] = field(repr=False)
    centrelines: tuple[Floats, ...] = field(repr=False)
    ring_pixels: Floats = field(repr=False)
    options: ShapeOptions = ShapeOptions()
    world: str = ""

    @property
    def uncertainty(self) -> Floats:
        """Standard uncertainty of each coordinate of the points, shape (n, 3) [mm]."""
        return np.asarray(np.sqrt(np.einsum("...ii->...i", self.covariance)))

    @property
    def tip_uncertainty(self) -> float:
        """Standard uncertainty of the tip in the direction where it is largest [mm]."""
        if not np.isfinite(self.tip_covariance).all():
            return math.nan
        return math.sqrt(float(np.linalg.eigvalsh(self.tip_covariance)[-1]))

    def list_summary(self) -> Json:
        """Return one row: tip, length, radius, what they rest on, status, flags and reason."""
        spread = np.sqrt(np.diag(self.tip_covariance))
        return {
            **{f"tip_{axis}_mm": to_plain(self.tip[k]) for k, axis in enumerate("xyz")},
            **{f"u_tip_{axis}_mm": to_plain(spread[k]) for k, axis in enumerate("xyz")},
            "u_tip_mm": to_plain(self.tip_uncertainty),
            **{f"tangent_{axis}": to_plain(self.tangents[-1, k]) for k, axis in enumerate("xyz")},
            "u_tangent_rad": to_plain(self.tangent_uncertainty[-1]),
            "length_mm": to_plain(self.length),
            "u_length_mm": to_plain(self.length_uncertainty),
            "radius_mm": to_plain(self.radius),
            "u_radius_mm": to_plain(self.radius_uncertainty),
            "rms_px": to_plain(self.residual),
            "ring_residual_px": to_plain(self.ring_residual),
            "epipolar_rms_mm": to_plain(self.epipolar_residual),
            "view_angle_deg": to_plain(math.degrees(self.view_angle)),
            "coverage": to_plain(self.coverage),
            "rings": int(self.rings.sum()),
            "parts": max(self.parts, default=0),
            "contrast": to_plain(self.contrast),
            "saturated": to_plain(self.saturated),
            "status": "failed" if self.reason else "flagged" if self.flags else "ok",
            "flags": ";".join(self.flags),
            "reason": self.reason,
        }

    def list_columns(self) -> Json:
        """Return a row for each point: arc length, place, uncertainty, tangent."""
        columns: Json = {"s_mm": self.arc_length, **list_coordinates("", self.points)}
        for k, axis in enumerate("xyz"):
            columns[f"u_{axis}_mm"] = self.uncertainty[:, k]
        for k, axis in enumerate("xyz"):
            columns[f"tangent_{axis}"] = self.tangents[:, k]
        columns["u_tangent_rad"] = self.tangent_uncertainty
        return columns

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the shape in the plane that it bends in; return the axes."""
        if self.reason:
            raise GeometryError(f"the shape was refused, there is nothing to draw: {self.reason}")
        ax = take_axes(ax, x="across the base [mm]", y="along the base [mm]", equal=True)
        off = self.points - self.points[0]
        x, y = find_plane(off, self.tangents[0]) @ off.T
        wide = 2.0 * np.max(self.uncertainty, axis=1)
        bars = {"xerr": wide, "yerr": wide, "ecolor": "0.4", "elinewidth": 0.8}
        ax.errorbar(x, y, **bars, fmt="o-", markersize=3, linewidth=1.2)
        ax.set_title("bars: 2 standard uncertainties", fontsize="small")
        return ax


def find_plane(points: Floats, up: Floats) -> Floats:
    """Return two directions (2, 3): across `up`, where points (n, 3) spread most, and `up`."""
    across = points - np.outer(points @ up, up)
    side = np.linalg.svd(across, full_matrices=False)[2][0]
    return np.stack([math.copysign(1.0, float(points.sum(axis=0) @ side)) * side, up])


def measure_shape(
    pictures: Sequence[Picture], cameras: CameraSet, *, options: ShapeOptions = ShapeOptions()
) -> BackboneShape:
    """Measure the shape of a bright tube with a dark ring near each end.

    Parameters
    ----------
    pictures : sequence of Picture
        One of each of two cameras, taken at the same time.
    cameras : CameraSet
        The two.
    options : ShapeOptions

    Returns
    -------
    BackboneShape
        With `reason` where the shape is refused.

    Raises
    ------
    InputError
        If there are not two pictures of two cameras, or a picture has another size.

    Notes
    -----
    The rod has 18 parameters: the place and direction of its base, five coefficients of the
    curvature about each of two axes that do not twist, its length and the tube's radius; where that
    leaves a pattern, as at the joint of two sections, the curvature has twenty. The limbs of a tube
    of constant radius are exact: the normal of its surface is normal to the ray. The covariance of
    the parameters is that of the least squares, times how much the residuals of neighbouring edges
    resemble each other, and of limbs that the model of their light moves as a whole.
    """
    if len(pictures) != 2 or len(cameras.cameras) != 2:
        raise InputError(
            f"{len(pictures)} pictures and {len(cameras.cameras)} cameras: a shape needs two each"
        )
    for picture, camera in zip(pictures, cameras.cameras, strict=True):
        if picture.size != camera.size:
            have, need = (f"{width} x {height}" for width, height in (picture.size, camera.size))
            raise InputError(f"{picture.name}: the picture has {have} px, its camera has {need}")
    seen: list[Silhouette] = []
    try:
        seen += [_orient(find_silhouette(picture), options) for picture in pictures]
        matched = _match_lines(seen, cameras.cameras)
        theta = _start_rod(seen, matched, options)
        given = zip(seen, pictures, cameras.cameras, strict=True)
        eyes = [_open_eye(*one, options) for one in given]
        shape = _fit_shape(seen, cameras, eyes, (theta, matched), options)
    except GeometryError as error:
        shape = _refuse(str(error), cameras, options, seen)
    turned = any("exif_rotated" in picture.flags for picture in pictures)
    return replace(shape, flags=(*shape.flags, "exif_rotated")) if turned else shape


def _refuse(
    reason: str,
    cameras: CameraSet,
    options: ShapeOptions,
    seen: Sequence[Silhouette] = (),
) -> BackboneShape:
    """Return a shape without numbers."""
    n = options.points
    return BackboneShape(
        arc_length=np.full(n, np.nan),
        points=np.full((n, 3), np.nan),
        covariance=np.full((n, 3, 3), np.nan),
        tip=np.full(3, np.nan),
        tip_covariance=np.full((3, 3), np.nan),
        tangents=np.full((n, 3), np.nan),
        tangent_uncertainty=np.full(n, np.nan),
        length=math.nan,
        length_uncertainty=math.nan,
        radius=math.nan,
        radius_uncertainty=math.nan,
        residual=math.nan,
        ring_residual=math.nan,
        epipolar_residual=math.nan,
        view_angle=math.nan,
        coverage=math.nan,
        rings=np.zeros((2, 2), dtype=bool),
        parts=tuple(one.parts for one in seen),
        contrast=min((one.contrast for one in seen), default=math.nan),
        saturated=max((one.saturated for one in seen), default=math.nan),
        flags=(),
        reason=reason,
        limbs=(),
        centrelines=tuple(one.line[one.lit] for one in seen),
        ring_pixels=np.full((2, 2, 2), np.nan),
        options=options,
        world=cameras.world,
    )


def _orient(seen: Silhouette, options: ShapeOptions) -> Silhouette:
    """Return a silhouette whose line starts at the base."""
    axis = 0 if options.base in ("left", "right") else 1
    sign = 1.0 if options.base in ("right", "bottom") else -1.0
    return seen if sign * (seen.line[0, axis] - seen.line[-1, axis]) > 0.0 else seen.reverse()


# From two centrelines to a first rod.


def _match_lines(seen: Sequence[Silhouette], cameras: Sequence[Camera]) -> Matched:
    """Return points in space where both centrelines meet, and where these are on the lines."""
    pixels = [resample_polyline(one.line, 3.0) for one in seen]
    arcs = [measure_arc_length(line) for line in pixels]
    inside = [
        (arc > one.ends[0] - 0.6 * one.width) & (arc < one.ends[1] + 0.6 * one.width)
        for arc, one in zip(arcs, seen, strict=True)
    ]
    pixels = [line[part] for line, part in zip(pixels, inside, strict=True)]
    arcs = [arc[part] for arc, part in zip(arcs, inside, strict=True)]
    first, second = cameras
    turn = second.rotation @ first.rotation.T
    shift = second.translation - turn @ first.translation
    cross = np.array(
        [[0.0, -shift[2], shift[1]], [shift[2], 0.0, -shift[0]], [-shift[1], shift[0], 0.0]]
    )
    flat = [_raise(camera.undistort(line)) for camera, line in zip(cameras, pixels, strict=True)]
    lines = flat[0] @ (cross @ turn).T
    lines /= np.linalg.norm(lines[:, :2], axis=1)[:, None]
    away = second.focal * lines @ flat[1].T
    pairs = match_curves(np.minimum(np.abs(away), _CAP) ** 2, 0.05)
    rows, columns = [], []
    for i in np.unique(pairs[:, 0]):
        own = pairs[pairs[:, 0] == i, 1]
        low, high = max(own[0] - 1, 0), min(own[-1] + 1, away.shape[1] - 1)
        part = away[i, low : high + 1]
        change = np.flatnonzero((part[:-1] <= 0.0) != (part[1:] <= 0.0))
        if len(change):
            k = int(change[len(change) // 2])
            rows.append(i)
            columns.append(low + k + part[k] / (part[k] - part[k + 1]))
    if len(rows) < 8:
        raise GeometryError("the silhouettes of both pictures do not belong to one tube")
    at = np.array(columns)
    other = interpolate_polyline(pixels[1], np.arange(len(pixels[1]), dtype=float), at)
    points = triangulate(cameras, np.stack([pixels[0][rows], other]))
    places = [arcs[0][rows], np.interp(at, np.arange(len(arcs[1])), arcs[1])]
    sure = np.ones(len(rows), dtype=bool)
    for one, place in zip(seen, places, strict=True):
        dark = measure_arc_length(one.line)[~one.lit]
        sure &= (np.abs(place[:, None] - dark) > one.width).all(axis=1)
    return Matched(points, np.stack(places), sure)


@dataclass(frozen=True, eq=False)
class Matched:
    """Points (n, 3) [mm] from both centrelines, their places (2, n) on these [px].

    `sure` are those that do not rest on a line that was extended, or interpolated.
    """

    points: Floats
    places: Floats
    sure: NDArray[np.bool_]


def _raise(flat: Floats) -> Floats:
    """Return (..., 3) homogeneous points."""
    return np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1)


def _start_rod(seen: Sequence[Silhouette], matched: Matched, options: ShapeOptions) -> Floats:
    """Return the parameters of a rod through matched points, from one ring to the other."""
    from scipy.ndimage import gaussian_filter1d
    from scipy.spatial.transform import Rotation

    smooth = gaussian_filter1d(matched.points, 4.0, axis=0, mode="nearest")
    arc = measure_arc_length(smooth)
    ends = np.full((2, 2), np.nan)
    for i, (one, places) in enumerate(zip(seen, matched.places, strict=True)):
        order = np.argsort(places, kind="stable")
        for k in range(2):
            if np.isfinite(one.rings[k]):
                ends[i, k] = _read_line(places[order], arc[order], one.rings[k])
    if not np.isfinite(ends).any():
        raise GeometryError("no ring was found at either end of the tube")
    start, end = (_choose_end(ends, k, options) for k in range(2))
    if math.isnan(start):
        start = end - options.length if options.length else 0.0
    if math.isnan(end):
        end = start + options.length if options.length else float(arc[-1])
    if end - start < 2.0 * options.ring:
        raise GeometryError("the rings are nearer to each other than two of their lengths")
    inside = (arc > start) & (arc < end)
    if inside.sum() < 8:
        raise GeometryError("too little of the tube is seen in both pictures")
    at, points = arc[inside] - start, smooth[inside]
    length = end - start
    fit = np.polynomial.legendre.Legendre.fit
    curves = [
        fit(at, points[:, k], min(5, inside.sum() // 3), domain=[0, length]) for k in range(3)
    ]
    s = np.linspace(0.0, length, STEPS + 1)
    tangents = np.stack([curve.deriv()(s) for curve in curves], axis=1)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    frames = carry_frames(tangents)
    bends = np.gradient(tangents, s, axis=0)
    theta = np.zeros(8 + 2 * CURVATURES)
    theta[:3] = [curve(0.0) for curve in curves]
    theta[3:6] = Rotation.from_matrix(frames[0]).as_rotvec()
    x = 2.0 * s / length - 1.0
    bases = np.polynomial.legendre.legvander(x, CURVATURES - 1)
    for k in range(2):
        across = np.einsum("ni,ni->n", bends, frames[:, :, k])
        theta[6 + k * CURVATURES : 6 + (k + 1) * CURVATURES] = np.linalg.lstsq(bases, across)[0]
    theta[LENGTH], theta[RADIUS] = length, 0.5 * options.diameter

    def miss(free: Floats) -> Floats:
        whole = np.concatenate([free, theta[LENGTH:]])
        line, _ = bend_rod(whole, STEPS)
        off = interpolate_polyline(line, s, at) - points
        return np.concatenate([off.ravel() / 0.05, 0.1 * length * free[6:]])

    theta[:LENGTH], _ = _least_squares(miss, theta[:LENGTH], _scales(theta)[:LENGTH], 3.0)
    return theta


def _read_line(places: Floats, arc: Floats, at: float) -> float:
    """Return the arc length at a place, beyond the known ones by their mean slope."""
    slope = (arc[-1] - arc[0]) / max(places[-1] - places[0], 1e-9)
    if at < places[0]:
        return float(arc[0] - slope * (places[0] - at))
    if at > places[-1]:
        return float(arc[-1] + slope * (at - places[-1]))
    return float(np.interp(at, places, arc))


def _choose_end(ends: Floats, k: int, options: ShapeOptions) -> float:
    """Return where a ring is from what both pictures show, with the length that is given."""
    own = ends[np.isfinite(ends[:, k]), k]
    if len(own) == 0:
        return math.nan
    other = ends[np.isfinite(ends[:, 1 - k]), 1 - k]
    if np.ptp(own) < options.ring or not options.length or len(other) == 0:
        return float(own.mean())
    off = np.abs(np.abs(own[:, None] - other) - options.length).min(axis=1)
    return float(own[off.argmin()])


def _least_squares(
    residuals: Callable[[Floats], Floats],
    start: Floats,
    scale: Floats,
    loss: float,
    steps: int = 40,
) -> tuple[Floats, Floats]:
    """Return the least robust squares (soft l1) by Levenberg and Marquardt, and the Jacobian.

    The normal equations are small, and much faster here than those of SciPy for all residuals.
    """
    at, damp = start, 1e-3
    values = residuals(at)
    cost = loss**2 * sum_loss(values / loss, "soft_l1")
    slope = np.empty((len(values), len(at)))
    for _ in range(steps):
        for k, step in enumerate(1e-4 * scale):
            moved = at.copy()
            moved[k] += step
            slope[:, k] = (residuals(moved) - values) * (scale[k] / step)
        weight, _ = weigh(values / loss, "soft_l1")
        normal, right = slope.T @ (weight[:, None] * slope), slope.T @ (weight * values)
        for _ in range(8):
            change = np.linalg.solve(normal + damp * np.diag(np.diag(normal) + 1e-12), right)
            trial = residuals(at - scale * change)
            fall = cost - loss**2 * sum_loss(trial / loss, "soft_l1")
            if fall > 0.0:
                break
            damp *= 5.0
        else:
            break
        at, values, cost = at - scale * change, trial, cost - fall
        damp = max(0.2 * damp, 1e-7)
        if fall < 1e-5 * cost:
            break
    return at, slope / scale


def _scales(theta: Floats) -> Floats:
    """Return how much each parameter may change for about a mm at the tip."""
    length = max(theta[LENGTH], 1.0)
    return np.array(
        [1.0] * 3 + [1.0 / length] * 3 + [2.0 / length**2] * (len(theta) - 8) + [1.0, 0.5]
    )


# Edges and rings, looked for where a rod has them.


@dataclass(frozen=True, eq=False)
class Eye:
    """A camera and what its picture holds.

    Attributes
    ----------
    camera : Camera
    light : ndarray
        Values of the picture in proportion to the light, as coefficients of a cubic spline.
    corner : ndarray, shape (2,)
        Pixel of the first of these.
    """

    camera: Camera
    light: Floats
    corner: Floats

    def read(self, pixels: Floats) -> Floats:
        """Return the light at pixels (..., 2)."""
        return sample_values(self.light, pixels - self.corner, order=3)

    def bend(self, flat: Floats) -> Floats:
        """Return the pixels of points (..., 2) in the plane at the focal length."""
        camera = self.camera
        bent = distort(flat / camera.focal, camera.distortion)
        return np.asarray(bent @ camera.matrix[:2, :2].T + camera.matrix[:2, 2])

    def flatten(self, pixels: Floats) -> Floats:
        """Return the reverse of `bend`."""
        return np.asarray(self.camera.undistort(pixels) * self.camera.focal)

    def measure_scale(self, points: Floats) -> float:
        """Return the pixels a mm at points (n, 3), the mean."""
        return self.camera.focal / float(np.mean(self.camera.to_camera(points)[:, 2]))

    def outline(self, points: Floats, tangents: Floats, radius: float) -> Floats:
        """Return both limbs and the nearest line of a tube, (3, n, 2), in that plane."""
        camera = self.camera
        turn, shift = np.array(camera.rotation), np.array(camera.translation)
        return np.asarray(
            outline_tube(points, tangents, radius, turn, shift, camera.focal), dtype=float
        )


def _open_eye(seen: Silhouette, picture: Picture, camera: Camera, options: ShapeOptions) -> Eye:
    """Return a camera with the part of its picture where the tube is."""
    from scipy.ndimage import gaussian_filter, spline_filter

    margin = 1.5 * seen.width
    size = np.array(camera.size)
    low = np.clip(np.floor(seen.line.min(axis=0) - margin), 0, size - 2).astype(int)
    high = np.clip(np.ceil(seen.line.max(axis=0) + margin), low + 2, size).astype(int)
    light = picture.values[low[1] : high[1], low[0] : high[0]].astype(float) ** options.gamma
    if seen.blurred:
        light = gaussian_filter(light, BLUR)
    return Eye(camera, spline_filter(light), low.astype(float))


@dataclass(frozen=True, eq=False)
class TubeEdges:
    """What a picture shows of the tube, in the plane at the focal length.

    Attributes
    ----------
    limbs : tuple of ndarray, shape (n, 4)
        Edges on each side: x, y, and the direction across.
    rings : ndarray, shape (2, 5)
        Rings of base and tip: x, y, the direction along the tube, standard uncertainty [px]; NaN
        where there is none.
    coverage : float
        Share of the places where there was an edge.
    blur : float
        Standard deviation of the picture's blur [px].
    """

    limbs: tuple[Floats, Floats]
    rings: Floats
    coverage: float
    blur: float


@lru_cache(maxsize=1)
def _root_table() -> tuple[Floats, Floats]:
    """Return z and the mean of sqrt(z + n) where positive, for standard normal n."""
    z = np.linspace(-8.0, 40.0, 2401)
    n = np.linspace(-6.0, 6.0, 601)
    weight = np.exp(-0.5 * n**2)
    weight /= weight.sum()
    return z, np.sqrt(np.clip(z[:, None] + n, 0.0, None)) @ weight


@lru_cache(maxsize=16)
def _edge_bases(blur: float, reach: float) -> tuple[Floats, Floats, Floats]:
    """Return offsets (m,), trial edges (k,) and orthonormal bases (k, m, 3) of profiles.

    A profile is the ground, a step where the tube starts, and a root of the depth: at a limb the
    light on a round tube changes as that.
    """
    from scipy.special import ndtr

    inner, outer = 3.0 + 3.0 * blur, 2.5 + 2.5 * blur
    offsets = np.arange(-inner - reach, outer + reach + 0.25, 0.5)
    trials = np.arange(-reach, reach + 0.05, 0.1)
    depth = (trials[:, None] - offsets) / blur
    root = np.interp(depth, *_root_table())
    ones = np.ones_like(depth)
    bases = np.stack([ones, ndtr(depth), root], axis=-1)
    return offsets, trials, np.linalg.qr(bases)[0]


def _fit_edges(profiles: Floats, blur: float, reach: float) -> tuple[Floats, Floats, Floats]:
    """Return edge offsets (n,) [px], the fall over each, and what is left of it (rms)."""
    offsets, trials, bases = _edge_bases(blur, reach)
    flat = bases.transpose(1, 0, 2).reshape(len(offsets), -1)
    held = (profiles @ flat).reshape(len(profiles), *bases[:, 0].shape)
    left = np.sum(profiles**2, axis=1)[:, None] - np.sum(held**2, axis=2)
    left = np.maximum(left, 0.0)
    best = left.argmin(axis=1)
    i, at = np.arange(len(profiles)), np.clip(best, 1, len(trials) - 2)
    low, mid, high = left[i, at - 1], left[i, at], left[i, at + 1]
    curve = low - 2.0 * mid + high
    shift = np.divide(0.5 * (low - high), curve, where=curve > 0.0, out=np.zeros(len(i)))
    found = trials[at] + (trials[1] - trials[0]) * np.clip(shift, -1.0, 1.0)
    found[(best == 0) | (best == len(trials) - 1)] = np.nan
    third = len(offsets) // 4
    fall = profiles[:, :third].mean(axis=1) - profiles[:, -third:].mean(axis=1)
    return found, fall, np.sqrt(mid / len(offsets))


def _find_edges(
    eye: Eye, theta: Floats, options: ShapeOptions, reach: float, blur: float
) -> TubeEdges:
    """Return the edges and rings near those of a rod; a blur of 0 is found first."""
    points, tangents = bend_rod(theta, STEPS)
    s = np.linspace(0.0, theta[LENGTH], STEPS + 1)
    outline = eye.outline(points, tangents, theta[RADIUS])
    margin = 0.5 * options.ring
    scale = eye.measure_scale(points)
    clear = reach + max(3.0 + 3.0 * (blur or 1.0), 0.1 * options.diameter * scale)
    reaching = np.linspace(-options.diameter, theta[LENGTH] + options.diameter, 2 * STEPS)
    whole = eye.bend(eye.outline(*_read_rod(theta, reaching), theta[RADIUS])[:2])
    rows = []
    for side in range(2):
        line = outline[side]
        good = np.isfinite(line).all(axis=1) & (s > margin) & (s < theta[LENGTH] - margin)
        if good.sum() < 4:
            raise GeometryError("the tube is seen end-on by a camera")
        pixels = resample_polyline(eye.bend(line[good]), _EDGE_STEP)
        middle = eye.bend(0.5 * (outline[0] + outline[1])[good])
        normals = _outward(pixels, middle)
        free = ~_find_hidden(pixels, whole)
        bows = _bow(outline[:, good], side, clear)
        first, last = (math.ceil((clear + bow) / _EDGE_STEP) for bow in bows)
        free[:first] = free[len(free) - last :] = False
        if free.sum() < 4:
            raise GeometryError("the tube is seen end-on by a camera")
        rows.append((pixels[free], normals[free]))
    blur = blur or _find_blur(eye, rows, reach)
    limbs, share = [], []
    offsets = _edge_bases(blur, reach)[0]
    for pixels, normals in rows:
        rays = pixels[:, None] + offsets[:, None] * normals[:, None]
        inside = np.all((rays >= 0.0) & (rays <= np.array(eye.camera.size) - 1.0), axis=(1, 2))
        profiles = eye.read(rays)
        found, fall, left = _fit_edges(profiles, blur, reach)
        usual = float(np.median(fall))
        good = inside & np.isfinite(found) & (fall > 0.3 * usual) & (fall > 4.0 * left)
        share.append(good.mean())
        at = pixels[good] + found[good, None] * normals[good]
        here, there = eye.flatten(at), eye.flatten(at + normals[good])
        across = there - here
        limbs.append(np.hstack([here, across / np.linalg.norm(across, axis=1)[:, None]]))
    rings = np.stack([_locate_ring(eye, theta, k, options) for k in range(2)])
    return TubeEdges((limbs[0], limbs[1]), rings, float(np.mean(share)), blur)


def _bow(outline: Floats, side: int, inside: float) -> tuple[float, float]:
    """Return how much nearer a ring comes `inside` of a limb than at it, at each end [px].

    A ring that is seen from its side is half an ellipse from limb to limb.
    """
    middle = 0.5 * (outline[0] + outline[1])
    bows = []
    for end, step in ((0, 1), (-1, -1)):
        along = middle[end + step] - middle[end]
        wide = float(np.linalg.norm(outline[side, end] - middle[end]))
        across = max(1.0 - inside / wide, 0.0)
        deep = (outline[2, end] - middle[end]) @ along / np.linalg.norm(along)
        bows.append(max(math.sqrt(1.0 - across**2) * float(deep), 0.0))
    return bows[0], bows[1]


def _find_hidden(pixels: Floats, limbs: Floats) -> NDArray[np.bool_]:
    """Return which pixels (n, 2) of a limb lie on another part of the tube, or next to those."""
    from scipy.ndimage import binary_dilation
    from scipy.spatial.distance import cdist

    seen = np.isfinite(limbs).all(axis=(0, 2))
    middle, half = limbs[:, seen].mean(axis=0), 0.5 * np.linalg.norm(limbs[0] - limbs[1], axis=1)
    inside = (cdist(pixels, middle) < half[seen] - 0.5).any(axis=1)
    return np.asarray(binary_dilation(inside, iterations=4))


def _outward(pixels: Floats, middle: Floats) -> Floats:
    """Return unit normals (n, 2) of a limb, away from the middle line of the tube."""
    along = np.gradient(pixels, axis=0)
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    there = resample_polyline(middle, measure_arc_length(middle)[-1] / (len(pixels) - 1))
    out = np.einsum("ni,ni->n", normals, pixels - there[: len(pixels)])
    return normals * math.copysign(1.0, float(np.median(out)))


def _find_blur(eye: Eye, rows: Sequence[tuple[Floats, Floats]], reach: float) -> float:
    """Return the blur that leaves least of the profiles [px]."""
    left = np.array([_misfit(eye, rows, trial, reach) for trial in _BLURS])
    at = int(np.clip(left.argmin(), 1, len(left) - 2))
    if not np.isfinite(left[at - 1 : at + 2]).all():
        return float(_BLURS[left.argmin()])
    fit = np.polyfit(np.log(_BLURS[at - 1 : at + 2]), left[at - 1 : at + 2], 2)
    best = math.exp(-0.5 * fit[1] / fit[0]) if fit[0] > 0.0 else _BLURS[left.argmin()]
    return float(np.clip(best, _BLURS[0], _BLURS[-1]))


def _misfit(eye: Eye, rows: Sequence[tuple[Floats, Floats]], blur: float, reach: float) -> float:
    """Return what a blur leaves of the profiles, as a share of their variance."""
    shares = []
    offsets = _edge_bases(blur, reach)[0]
    for pixels, normals in rows:
        profiles = eye.read(pixels[::4, None] + offsets[:, None] * normals[::4, None])
        found, fall, left = _fit_edges(profiles, blur, reach)
        good = np.isfinite(found) & (fall > 0.0)
        shares.append(left[good] / fall[good])
    every = np.concatenate(shares)
    return float(np.median(every)) if len(every) else math.inf


def _locate_ring(eye: Eye, theta: Floats, k: int, options: ShapeOptions) -> Floats:
    """Return the place, direction and uncertainty of a ring (5,), NaN if it is not there."""
    from scipy.special import ndtr

    nothing = np.full(5, np.nan)
    step = 0.04
    half = 2.2 * options.ring
    offsets = np.arange(-half, half + 0.5 * step, step)
    points, tangents = _read_rod(theta, offsets + k * theta[LENGTH])
    lines = [
        eye.outline(points, tangents, theta[RADIUS])[2],
        *_side_lines(eye, points, tangents, theta[RADIUS]),
    ]
    if not np.isfinite(lines).all():
        return nothing
    near = eye.bend(lines[0])
    size = np.array(eye.camera.size) - 1.0
    if np.any((near < 0.0) | (near > size)):
        return nothing
    profile = np.mean([eye.read(eye.bend(line)) for line in lines], axis=0)
    count = len(offsets)
    span = round(options.ring / step)
    total = np.concatenate([[0.0], np.cumsum(profile)])
    best, at = -math.inf, 0
    for i in range(span // 2, count - 2 * span):
        dark = (total[i + span] - total[i]) / span
        before = total[i] - total[i - span // 2]
        after = total[i + span + span // 2] - total[i + span]
        gain = min(before, after) / (span // 2) - dark
        if gain > best:
            best, at = gain, i
    middle = offsets[at] + 0.5 * options.ring
    height = max(float(np.ptp(profile)), 1e-6)
    local = np.abs(offsets - middle) < 1.1 * options.ring
    x, y = offsets[local], profile[local] / height
    per = np.linalg.norm(np.diff(near, axis=0), axis=1).mean() / step  # px a mm

    def model(p: Floats) -> Floats:
        blur = max(abs(p[2]), 0.01)
        fall = ndtr((x - p[0] + 0.5 * p[1]) / blur) - ndtr((x - p[0] - 0.5 * p[1]) / blur)
        return np.asarray((p[4] + p[5] * (x - middle)) * (1.0 - p[3] * fall))

    start = np.array([middle, options.ring, 0.15, 0.8, y.max(), 0.0])
    scale = np.array([0.1, 0.1, 0.05, 0.1, 0.1, 0.1])
    fit, slope = _least_squares(lambda p: model(p) - y, start, scale, 0.05)
    place, wide, _, depth = fit[:4]
    left = model(fit) - y
    rms = math.sqrt(float(np.mean(left**2)))
    if depth < 0.4 or rms > 0.1 or abs(wide / options.ring - 1.0) > 0.25:
        return nothing
    if abs(place) > half - options.ring:
        return nothing
    spread = np.linalg.pinv(slope.T @ slope) * rms**2
    u = math.sqrt(max(float(spread[0, 0]), 0.0))
    flat = lines[0]
    here = interpolate_polyline(flat, offsets, np.array([place - step, place, place + step]))
    along = here[2] - here[0]
    return np.array([*here[1], *(along / np.linalg.norm(along)), max(u * per, _RING_ERROR)])


def _side_lines(eye: Eye, points: Floats, tangents: Floats, radius: float) -> list[Floats]:
    """Return lines along a tube at both sides of the one nearest to a camera."""
    away = points - eye.camera.centre
    away = away - np.einsum("ni,ni->n", away, tangents)[:, None] * tangents
    away /= np.linalg.norm(away, axis=1)[:, None]
    side = np.cross(tangents, away)
    lines = []
    for angle in np.radians([-35.0, -20.0, 20.0, 35.0]):
        surface = points + radius * (math.sin(angle) * side - math.cos(angle) * away)
        inside = eye.camera.to_camera(surface)
        lines.append(np.asarray(eye.camera.focal * inside[:, :2] / inside[:, 2:]))
    return lines


def _read_rod(theta: Floats, at: Floats) -> tuple[Floats, Floats]:
    """Return points and tangents (n, 3) of a rod at arc lengths, straight beyond its ends."""
    points, tangents = bend_rod(theta, STEPS)
    s = np.linspace(0.0, theta[LENGTH], STEPS + 1)
    inside = np.clip(at, 0.0, theta[LENGTH])
    along = interpolate_polyline(tangents, s, inside)
    along /= np.linalg.norm(along, axis=1)[:, None]
    beyond = (at - inside)[:, None] * along
    return interpolate_polyline(points, s, inside) + beyond, along


def _sum_correlation(residuals: Floats) -> float:
    """Return the sum of the autocorrelation of residuals up to where it may be by chance."""
    off = residuals - residuals.mean()
    n = len(off)
    if n < 8 or not off.any():
        return 0.0
    lags = np.correlate(off, off, "full")[n:] / float(off @ off)
    # Beyond the first that is not larger than by chance the sum would only grow by noise.
    chance = np.flatnonzero(lags < 2.0 / math.sqrt(n))
    return float(lags[: chance[0] if len(chance) else n // 2].sum())


# The fit.


def _miss_edges(theta: Floats, eyes: Sequence[Eye], edges: Sequence[TubeEdges]) -> list[Floats]:
    """Return, for each picture, the misses of its limbs and then of its rings [px]."""
    points, tangents = bend_rod(theta, STEPS)
    beyond = 0.1 * theta[LENGTH]
    points = np.vstack(
        [points[0] - beyond * tangents[0], points, points[-1] + beyond * tangents[-1]]
    )
    tangents = np.vstack([tangents[:1], tangents, tangents[-1:]])
    misses = []
    for eye, seen in zip(eyes, edges, strict=True):
        lines = eye.outline(points, tangents, theta[RADIUS])
        misses += [miss_line(seen.limbs[k], lines[k], _CAP) for k in range(2)]
        near = lines[2][[1, -2]]
        off = np.einsum("ki,ki->k", near - seen.rings[:, :2], seen.rings[:, 2:4])
        misses.append(off)
    return misses


def _fit_rod(
    theta: Floats, eyes: Sequence[Eye], edges: Sequence[TubeEdges], options: ShapeOptions
) -> tuple[Floats, Floats]:
    """Return the parameters that fit edges and rings best, and the Jacobian of the residuals."""
    weights = []
    for seen in edges:
        weights += [np.full(len(limb), 1.0 / _EDGE_SIGMA) for limb in seen.limbs]
        weights.append(np.nan_to_num(1.0 / np.maximum(seen.rings[:, 4], _RING_SIGMA)))
    weight = np.concatenate(weights)
    terms = np.arange((len(theta) - 8) // 2)
    rarity = np.tile(np.where(terms < CURVATURES, 0.01, 1.0 / _FINE_BEND), 2)

    def residuals(trial: Floats) -> Floats:
        misses = np.nan_to_num(np.concatenate(_miss_edges(trial, eyes, edges)))
        extra = [trial[LENGTH] * trial[6:LENGTH] * rarity]
        if options.length:
            extra.append(np.array([(trial[LENGTH] - options.length) / 0.1]))
        return np.concatenate([misses * weight, *extra])

    return _least_squares(residuals, theta, _scales(theta), 3.0)


@dataclass(frozen=True, eq=False)
class RodFit:
    """A fitted rod, the Jacobian of its residuals, and what it was fitted to."""

    theta: Floats
    jacobian: Floats
    eyes: Sequence[Eye]
    edges: Sequence[TubeEdges]
    flags: tuple[str, ...]


def _fit_shape(
    seen: Sequence[Silhouette],
    cameras: CameraSet,
    eyes: Sequence[Eye],
    start: tuple[Floats, Matched],
    options: ShapeOptions,
) -> BackboneShape:
    """Fit the rod to edges and rings, look for these where it is now, and judge it."""
    theta, matched = start
    theta, jacobian, edges = _fit_in_passes(theta, eyes, options)
    blur = max(one.blur for one in edges)
    if _measure_pattern(_miss_edges(theta, eyes, edges)) > _UNEVEN * blur:
        bends = theta[6:LENGTH].reshape(2, CURVATURES)
        more = np.pad(bends, ((0, 0), (0, MORE_CURVATURES - CURVATURES)))
        theta = np.concatenate([theta[:6], more.ravel(), theta[LENGTH:]])
        theta, jacobian, edges = _fit_in_passes(theta, eyes, options)
    flags = []
    misses = _miss_edges(theta, eyes, edges)
    while _worst_ring(misses)[0] > 1.0:
        _, i, k = _worst_ring(misses)
        edges[i].rings[k] = np.nan
        flags.append("ring_dropped")
        theta, jacobian = _fit_rod(theta, eyes, edges, options)
        misses = _miss_edges(theta, eyes, edges)
    fit = RodFit(theta, jacobian, eyes, edges, tuple(dict.fromkeys(flags)))
    return _judge(seen, cameras, fit, matched, options)


def _fit_in_passes(
    theta: Floats, eyes: Sequence[Eye], options: ShapeOptions
) -> tuple[Floats, Floats, list[TubeEdges]]:
    """Return a rod fitted to edges that are looked for nearer and nearer to it."""
    blurs = [0.0, 0.0]
    wide = 2.0 * theta[RADIUS] * min(eye.measure_scale(theta[None, :3]) for eye in eyes)
    # Rings of a rod that bends unevenly are found in a later pass.
    later = (2.0,) * (4 if len(theta) > 8 + 2 * CURVATURES else 1)
    for reach in (min(10.0, 0.2 * wide), 4.0, *later):
        edges = [
            _find_edges(eye, theta, options, reach, blur)
            for eye, blur in zip(eyes, blurs, strict=True)
        ]
        blurs = [one.blur for one in edges]
        theta, jacobian = _fit_rod(theta, eyes, edges, options)
    return theta, jacobian, edges


def _measure_pattern(misses: Sequence[Floats]) -> float:
    """Return what neighbouring edges miss a rod by together, over the square root of one [px]."""
    limbs = [misses[k] for k in (0, 1, 3, 4)]
    return max(
        math.sqrt(float(np.mean(limb**2)) * (1.0 + 2.0 * _sum_correlation(limb))) for limb in limbs
    )


def _worst_ring(misses: Sequence[Floats]) -> tuple[float, int, int]:
    """Return the largest miss of a ring [px], its picture and its end."""
    rings = np.abs(np.nan_to_num(np.stack([misses[2], misses[5]])))
    i, k = np.unravel_index(int(rings.argmax()), rings.shape)
    return float(rings.max()), int(i), int(k)


def _find_spread(fit: RodFit, misses: Sequence[Floats], residual: float) -> Floats:
    """Return the covariance of the parameters.

    Edges next to each other are not independent, and each limb is off as a whole by its light;
    rings and what is given are independent.
    """
    scale = _scales(fit.theta)
    slope = fit.jacobian * scale
    # A turn of the frame about the rod changes no point: it is left out.
    inverse = np.linalg.pinv(slope.T @ slope, rcond=_NO_EFFECT**2, hermitian=True)
    rows = np.cumsum([0, *map(len, misses)])
    resemble = np.mean([_sum_correlation(misses[k]) for k in (0, 1, 3, 4)])
    factors = np.ones(len(slope))
    limbs = np.zeros((4, len(fit.theta)))
    for i, k in enumerate((0, 1, 3, 4)):
        part = slice(rows[k], rows[k + 1])
        factors[part] = max(residual / _EDGE_SIGMA, 0.3) ** 2 * (1.0 + 2.0 * resemble)
        share = _LIMB_SHARE * fit.edges[i // 2].blur / _EDGE_SIGMA
        limbs[i] = share * slope[part].sum(axis=0)
    for k, seen in zip((2, 5), fit.edges, strict=True):
        part = slice(rows[k], rows[k + 1])
        factors[part] = np.minimum(np.nan_to_num(seen.rings[:, 4]) / _RING_SIGMA, 1.0) ** 2
    middle = slope.T @ (factors[:, None] * slope) + limbs.T @ limbs
    return np.asarray(scale[:, None] * (inverse @ middle @ inverse) * scale)


def _judge(
    seen: Sequence[Silhouette],
    cameras: CameraSet,
    fit: RodFit,
    matched: Matched,
    options: ShapeOptions,
) -> BackboneShape:
    """Return the shape of a fitted rod with its uncertainty, or without if it is refused."""
    theta, eyes, edges = fit.theta, fit.eyes, fit.edges
    misses = _miss_edges(theta, eyes, edges)
    every = np.concatenate([misses[k] for k in (0, 1, 3, 4)])
    residual = math.sqrt(float(np.mean(every**2))) if len(every) else math.inf
    spread = _find_spread(fit, misses, residual)

    def answer(trial: Floats) -> Floats:
        """Return points, tip and tangents of a rod, one after the other."""
        points, tangents = _read_rod(trial, np.linspace(0.0, trial[LENGTH], options.points))
        tip = points[-1] + options.holder * tangents[-1]
        return np.concatenate([points, tip[None], tangents])

    values = answer(theta)
    slopes = np.empty((*values.shape, len(theta)))
    for k, step in enumerate(1e-3 * _scales(theta)):
        moved = theta.copy()
        moved[k] += step
        slopes[..., k] = (answer(moved) - values) / step
    covariance = slopes @ spread @ np.swapaxes(slopes, -1, -2)
    n = options.points
    points, tip, tangents = values[:n], values[n], values[n + 1 :]
    rays = [points - camera.centre for camera in cameras.cameras]
    angles = [
        np.arccos(
            np.clip(
                np.abs(np.einsum("ni,ni->n", ray / np.linalg.norm(ray, axis=1)[:, None], tangents)),
                0,
                1,
            )
        )
        for ray in rays
    ]
    view_angle = float(np.min(angles))
    pitch = max(
        float(np.mean(np.linalg.norm(ray, axis=1))) / camera.focal
        for ray, camera in zip(rays, cameras.cameras, strict=True)
    )
    own = np.concatenate([points, tip[None]])
    places = np.stack([camera.project(own) for camera in cameras.cameras])
    rings = np.stack([np.isfinite(one.rings[:, 0]) for one in edges])
    saturated = max(one.saturated for one in seen)
    # Seen from its end, with a ring hidden, or in white, the tube has edges that mislead.
    sound = view_angle >= END_ON and rings.all() and saturated <= MOST_SATURATED
    double = 1.0 if sound else 4.0
    whole = double * covariance[: n + 1] + cameras.calibration_covariance(places)
    line, _ = bend_rod(theta, 4 * STEPS)
    epipolar = _measure_epipolar(matched.points[matched.sure], line)
    outlines = _draw_limbs(theta, eyes)
    result = BackboneShape(
        arc_length=np.linspace(0.0, theta[LENGTH], n),
        points=points,
        covariance=whole[:n],
        tip=tip,
        tip_covariance=whole[n],
        tangents=tangents,
        tangent_uncertainty=np.sqrt(double * np.linalg.eigvalsh(covariance[n + 1 :])[:, -1]),
        length=float(theta[LENGTH]),
        length_uncertainty=math.sqrt(double * spread[LENGTH, LENGTH]),
        radius=float(theta[RADIUS]),
        radius_uncertainty=math.sqrt(double * spread[RADIUS, RADIUS]),
        residual=residual,
        ring_residual=_worst_ring(misses)[0],
        epipolar_residual=epipolar,
        view_angle=view_angle,
        coverage=min(one.coverage for one in edges),
        rings=rings,
        parts=tuple(one.parts for one in seen),
        contrast=min(one.contrast for one in seen),
        saturated=saturated,
        flags=(),
        reason="",
        limbs=outlines,
        centrelines=tuple(one.line[one.lit] for one in seen),
        ring_pixels=np.stack(
            [eye.bend(one.rings[:, :2]) for eye, one in zip(eyes, edges, strict=True)]
        ),
        options=options,
        world=cameras.world,
    )
    reason = _find_reason(result, pitch)
    result = replace(result, flags=(*fit.flags, *_find_flags(result)), reason=reason)
    return _blank(result) if reason else result


def _measure_epipolar(points: Floats, line: Floats) -> float:
    """Return the distance of points from a line, root mean square, without those beyond its end."""
    if len(points) == 0:
        return math.inf
    off = np.linalg.norm(points[:, None] - line, axis=2)
    nearest = off.argmin(axis=1)
    inside = (nearest > 0) & (nearest < len(line) - 1)
    return math.sqrt(float(np.mean(off.min(axis=1)[inside] ** 2))) if inside.any() else math.inf


def _draw_limbs(theta: Floats, eyes: Sequence[Eye]) -> tuple[Floats, ...]:
    """Return both limbs in each picture, (2, m, 2) [px]."""
    points, tangents = bend_rod(theta, STEPS)
    return tuple(eye.bend(eye.outline(points, tangents, theta[RADIUS])[:2]) for eye in eyes)


def _find_reason(shape: BackboneShape, pitch: float) -> str:
    """Return why a shape is not to be trusted; empty if it is."""
    options = shape.options
    base, end = (bool(shape.rings[:, k].any()) for k in range(2))
    off = shape.length - options.length if options.length else 0.0
    wide, tip, away = 2.0 * shape.radius, shape.tip_uncertainty, shape.epipolar_residual
    most = max(MOST_EPIPOLAR, MOST_EPIPOLAR_PIXELS * pitch)
    tests = [
        (base, "no picture shows the ring of the base"),
        (end, "no picture shows the ring of the tip"),
        (bool(shape.rings.any(axis=1).all()), "a picture shows none of the rings"),
        (
            shape.residual <= MOST_RESIDUAL,
            "the edges miss the rod by {} px, at most {}".format(
                *show_apart(shape.residual, MOST_RESIDUAL, digits=2)
            ),
        ),
        (
            shape.coverage >= LEAST_COVERAGE,
            f"{shape.coverage:.0%} of the edges were found, {LEAST_COVERAGE:.0%} are needed",
        ),
        (
            abs(off) <= min(3.0 * shape.length_uncertainty, MOST_LENGTH_ERROR) + 0.2,
            f"the length is {shape.length:.2f} mm instead of {options.length:g} mm",
        ),
        (
            abs(wide / options.diameter - 1.0) <= MOST_RADIUS_ERROR,
            f"the diameter is {wide:.2f} mm instead of {options.diameter:g} mm",
        ),
        (
            tip <= MOST_TIP_UNCERTAINTY,
            "the tip is uncertain by {} mm, at most {}".format(
                *show_apart(tip, MOST_TIP_UNCERTAINTY, digits=2)
            ),
        ),
        (
            away <= most,
            "points matched in both pictures miss the rod by {} mm, at most {}".format(
                *show_apart(away, most, digits=2)
            ),
        ),
    ]
    legal = " is allowed"
    return next((text + legal * ("at most" in text) for good, text in tests if not good), "")


def _find_flags(shape: BackboneShape) -> list[str]:
    """Return what is to be known of a shape."""
    tests = {
        "end_on": shape.view_angle < END_ON,
        "ring_missing": not shape.rings.all(),
        "parts": max(shape.parts) > 1,
        "few_edges": shape.coverage < 0.95,
        "length_off": bool(shape.options.length)
        and abs(shape.length - shape.options.length) > LENGTH_OFF,
        "low_contrast": shape.contrast < BLURRED_CONTRAST,
        "saturated": shape.saturated > MOST_SATURATED,
    }
    return [name for name, found in tests.items() if found]


def _blank(shape: BackboneShape) -> BackboneShape:
    """Return a refused shape: what was seen stays, what was to be measured is NaN."""
    return replace(
        shape,
        arc_length=np.full_like(shape.arc_length, np.nan),
        points=np.full_like(shape.points, np.nan),
        covariance=np.full_like(shape.covariance, np.nan),
        tip=np.full(3, np.nan),
        tip_covariance=np.full((3, 3), np.nan),
        tangents=np.full_like(shape.tangents, np.nan),
        tangent_uncertainty=np.full_like(shape.tangent_uncertainty, np.nan),
        length=math.nan,
        length_uncertainty=math.nan,
        radius=math.nan,
        radius_uncertainty=math.nan,
    )

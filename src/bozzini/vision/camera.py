"""Cameras: a pinhole with a lens, its place in the world, sets of them, and files of sets.

Pixels are counted from the centre of the first one, which is (0, 0); x goes right, y down. The
frame of a camera has x right, y down and z forwards. The lens is that of Brown (1971) with two
radial and two tangential terms and a third radial one, or the fisheye of Kannala and Brandt (2006)
with four terms, each in the order of OpenCV. Directions are x/z and y/z: what a fisheye sees beside
or behind the camera has none.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number, check_points
from ..errors import FileFormatError, InputError
from ..io.records import load_record, save_record
from ..numeric.arrays import Floats
from ..numeric.vectors import nearest_rotation
from ..results import Shown

_UNDISTORT_STEPS = 20
_UNDISTORT_TOLERANCE = 1e-12
_TINY = 1e-12

FISHEYE_TERMS = 4
"""Terms of the distortion of a fisheye; other lenses have five."""


def distort(normalised: Floats, distortion: Floats) -> Floats:
    """Return where the lens puts points of the plane at distance 1.

    Parameters
    ----------
    normalised : ndarray, shape (..., 2)
        x/z and y/z in the camera's frame.
    distortion : ndarray, shape (5,) or (4,)
        k1, k2, p1, p2, k3; or k1, k2, k3, k4 of a fisheye.

    Returns
    -------
    ndarray, shape (..., 2)

    References
    ----------
    D. C. Brown, "Close-range camera calibration", Photogrammetric Engineering 37 (1971) 855-866.
    J. Kannala, S. S. Brandt, IEEE Trans. Pattern Analysis and Machine Intelligence 28 (2006) 1335.
    """
    if len(distortion) == FISHEYE_TERMS:
        radius = np.linalg.norm(normalised, axis=-1, keepdims=True)
        bent, _ = _bend_angle(np.arctan(radius), distortion)
        return np.asarray(normalised * (bent / np.maximum(radius, _TINY)))
    k1, k2, p1, p2, k3 = distortion
    x, y = normalised[..., 0], normalised[..., 1]
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    return np.stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
            y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
        ],
        axis=-1,
    )


def _bend_angle(angle: Floats, distortion: Floats) -> tuple[Floats, Floats]:
    """Return the radius at which a fisheye shows an angle from its axis, and its slope."""
    k1, k2, k3, k4 = distortion
    square = angle * angle
    radius = angle * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
    slope = 1.0 + square * (
        3.0 * k1 + square * (5.0 * k2 + square * (7.0 * k3 + square * 9.0 * k4))
    )
    return radius, slope


def undistort_fisheye(normalised: Floats, distortion: Floats) -> Floats:
    """Return `distort` of a fisheye undone; NaN beyond 90 degrees, and where it folds."""
    radius = np.linalg.norm(normalised, axis=-1, keepdims=True)
    angle = np.minimum(radius, 0.5 * np.pi)
    with np.errstate(all="ignore"):
        for _ in range(_UNDISTORT_STEPS):
            bent, slope = _bend_angle(angle, distortion)
            angle = angle - (bent - radius) / slope
        bent, slope = _bend_angle(angle, distortion)
        seen = (np.abs(bent - radius) < 1e-9) & (slope > 0.0) & (angle >= 0.0)
        seen &= angle < 0.5 * np.pi
        scale = np.where(radius > _TINY, np.tan(angle) / np.maximum(radius, _TINY), 1.0)
        return np.where(seen, normalised * scale, np.nan)


def _distort_slope(points: Floats, distortion: Floats) -> tuple[Floats, Floats, Floats]:
    """Return dx'/dx, dx'/dy (equal to dy'/dx) and dy'/dy of `distort`."""
    k1, k2, p1, p2, k3 = distortion
    x, y = points[..., 0], points[..., 1]
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    slope = 2.0 * (k1 + square * (2.0 * k2 + 3.0 * square * k3))
    across = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
    return (
        radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
        across,
        radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera(Shown):
    """A calibrated camera.

    Parameters
    ----------
    matrix : array_like, shape (3, 3)
        Focal lengths and principal point [px]: ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]``.
    distortion : array_like, shape (5,) or (4,)
        k1, k2, p1, p2, k3 of the lens, or k1, k2, k3, k4 of a fisheye.
    size : tuple of int
        Width and height of its pictures [px].
    rotation : array_like, shape (3, 3)
        From the world's axes to the camera's.
    translation : array_like, shape (3,)
        The world's origin in the camera's frame [mm].

    Raises
    ------
    InputError
        If a value is not finite, a focal length is not positive, or the rotation is none.
    """

    matrix: Floats
    size: tuple[int, int]
    distortion: Floats = dataclasses.field(default_factory=lambda: np.zeros(5))
    rotation: Floats = dataclasses.field(default_factory=lambda: np.eye(3))
    translation: Floats = dataclasses.field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        terms = FISHEYE_TERMS if np.shape(self.distortion) == (FISHEYE_TERMS,) else 5
        shapes = {"matrix": (3, 3), "distortion": (terms,), "rotation": (3, 3), "translation": (3,)}
        for name, shape in shapes.items():
            value = check_array(f"the camera's {name}", getattr(self, name)).copy()
            if value.shape != shape or not np.all(np.isfinite(value)):
                raise InputError(f"the camera's {name} must hold {shape} finite numbers")
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        for name, focal in zip(("fx", "fy"), np.diag(self.matrix), strict=False):
            check_number(f"the camera's {name}", float(focal), low=0.0, low_open=True, unit="px")
        wrong = np.abs(self.rotation @ self.rotation.T - np.eye(3)).max()
        if wrong > 1e-6 or np.linalg.det(self.rotation) < 0.0:
            raise InputError("the camera's rotation is no rotation: R R^T must be the identity")
        object.__setattr__(self, "rotation", nearest_rotation(self.rotation))

    @cached_property
    def centre(self) -> Floats:
        """Where the camera is, shape (3,) [mm]."""
        return np.asarray(-self.rotation.T @ self.translation)

    @property
    def is_fisheye(self) -> bool:
        """Whether its lens is a fisheye."""
        return len(self.distortion) == FISHEYE_TERMS

    @cached_property
    def focal(self) -> float:
        """Mean focal length [px]."""
        return float(np.mean(np.diag(self.matrix)[:2]))

    def place(self, rotation: ArrayLike, translation: ArrayLike) -> Camera:
        """Return the same camera with another pose."""
        return dataclasses.replace(
            self, rotation=np.asarray(rotation), translation=np.asarray(translation)
        )

    def move_world(self, rotation: ArrayLike, translation: ArrayLike) -> Camera:
        """Return the camera seen from a new world.

        Parameters
        ----------
        rotation : array_like, shape (3, 3)
            From the new world's axes to the present one's.
        translation : array_like, shape (3,)
            Origin of the new world in the present one [mm].
        """
        turn, shift = np.asarray(rotation), np.asarray(translation)
        return self.place(self.rotation @ turn, self.rotation @ shift + self.translation)

    def to_camera(self, points: ArrayLike) -> Floats:
        """Return points of the world (..., 3) in the camera's frame [mm]; NaN stays NaN."""
        given = check_array("points", points)
        if given.ndim == 0 or given.shape[-1] != 3:
            raise InputError(f"points has shape {given.shape}: it must be (..., 3)")
        return np.asarray(given @ self.rotation.T + self.translation)

    def project(self, points: ArrayLike) -> Floats:
        """Return the pixels of points in the world.

        Parameters
        ----------
        points : array_like, shape (..., 3)
            Points [mm].

        Returns
        -------
        ndarray, shape (..., 2)
            Pixels; NaN where a point is not in front of the camera.
        """
        inside = self.to_camera(points)
        depth = np.where(inside[..., 2:] > 0.0, inside[..., 2:], np.nan)
        bent = distort(inside[..., :2] / depth, self.distortion)
        return np.asarray(bent @ self.matrix[:2, :2].T + self.matrix[:2, 2])

    def undistort(self, pixels: ArrayLike) -> Floats:
        """Return the directions of pixels as x/z, y/z in the camera's frame: `project` undone.

        Parameters
        ----------
        pixels : array_like, shape (..., 2)

        Returns
        -------
        ndarray, shape (..., 2)
            NaN where the lens model folds and no direction gives that pixel.
        """
        given = check_array("pixels", pixels)
        target = (given - self.matrix[:2, 2]) @ np.linalg.inv(self.matrix[:2, :2]).T
        if self.is_fisheye:
            return undistort_fisheye(target, self.distortion)
        points = target.copy()
        with np.errstate(all="ignore"):
            for _ in range(_UNDISTORT_STEPS):
                error = target - distort(points, self.distortion)
                xx, xy, yy = _distort_slope(points, self.distortion)
                size = xx * yy - xy * xy
                step = np.stack(
                    [
                        (yy * error[..., 0] - xy * error[..., 1]) / size,
                        (xx * error[..., 1] - xy * error[..., 0]) / size,
                    ],
                    axis=-1,
                )
                points = points + step
                if not np.any(np.abs(step) > _UNDISTORT_TOLERANCE):
                    break
            error = np.abs(target - distort(points, self.distortion)).max(axis=-1)
        folded = ~(error < 1e-9) | (xx <= 0.0) | (yy <= 0.0)
        return np.where(folded[..., None], np.nan, points)

    def rays(self, pixels: ArrayLike) -> Floats:
        """Return unit vectors (..., 3) in the world, from `centre` through pixels (..., 2)."""
        flat = self.undistort(pixels)
        ahead = np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1) @ self.rotation
        return np.asarray(ahead / np.linalg.norm(ahead, axis=-1, keepdims=True))


def prepare_pose(camera: Camera, pixels: Floats) -> tuple[Floats, Floats, Floats]:
    """Return pixels, matrix and distortion as OpenCV's poses take them: a fisheye undistorted."""
    if not camera.is_fisheye:
        return pixels, np.array(camera.matrix), np.array(camera.distortion)
    return camera.undistort(pixels), np.eye(3), np.zeros(5)


def aim_camera(
    position: ArrayLike,
    target: ArrayLike,
    *,
    focal: float,
    size: tuple[int, int],
    distortion: ArrayLike = (0.0, 0.0, 0.0, 0.0, 0.0),
    down: ArrayLike = (0.0, 1.0, 0.0),
) -> Camera:
    """Return a camera that looks at a point.

    Parameters
    ----------
    position, target : array_like, shape (3,)
        Where it is and what it looks at [mm].
    focal : float
        Focal length [px].
    size : tuple of int
        Width and height of the picture [px]; the principal point is its middle.
    distortion : array_like, shape (5,) or (4,)
        Of the lens, as `Camera` has it.
    down : array_like, shape (3,)
        The direction in the world that the picture shows downwards.
    """
    eye, aim = check_points("position", position), check_points("target", target)
    ahead = aim - eye
    right = np.cross(check_points("down", down), ahead)
    if np.linalg.norm(right) < 1e-9 * np.linalg.norm(ahead):
        raise InputError("the camera's direction is zero or parallel to `down`: choose another")
    axes = np.array([right, np.cross(ahead, right), ahead])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    width, height = size
    middle = (0.5 * (width - 1), 0.5 * (height - 1))
    return Camera(
        matrix=np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]]),
        distortion=np.asarray(distortion),
        size=(width, height),
        rotation=axes,
        translation=-axes @ eye,
    )


def triangulate(cameras: Sequence[Camera], pixels: ArrayLike) -> Floats:
    """Return the points seen at given pixels of two or more cameras.

    The point has the least sum of squares of the reprojection errors in undistorted pixels, found
    by Gauss-Newton steps from the point nearest to the rays.

    Parameters
    ----------
    cameras : sequence of Camera
    pixels : array_like, shape (c, ..., 2)
        One pixel a camera.

    Returns
    -------
    ndarray, shape (..., 3)
        Points [mm]; NaN where a pixel is NaN.

    References
    ----------
    R. Hartley, A. Zisserman, *Multiple View Geometry*, 2nd ed. (2004), chapter 12.
    """
    seen = check_array("pixels", pixels)
    if len(seen) != len(cameras) or len(cameras) < 2:
        raise InputError(f"{len(cameras)} cameras and {len(seen)} sets of pixels: give two or more")
    shape = seen.shape[1:-1]
    seen = seen.reshape(len(cameras), -1, 2)
    rays = np.stack([camera.rays(seen[i]) for i, camera in enumerate(cameras)])
    across = np.eye(3) - rays[..., :, None] * rays[..., None, :]
    centres = np.stack([camera.centre for camera in cameras])
    sides = np.einsum("cnij,cj->ni", across, centres)
    whole = np.isfinite(sides).all(axis=-1)
    points = np.full((seen.shape[1], 3), np.nan)
    points[whole] = np.linalg.solve(across[:, whole].sum(axis=0), sides[whole][..., None])[..., 0]
    flat = [camera.undistort(seen[i, whole]) for i, camera in enumerate(cameras)]
    for _ in range(3):
        normal, right = np.zeros((whole.sum(), 3, 3)), np.zeros((whole.sum(), 3))
        for i, camera in enumerate(cameras):
            inside = camera.to_camera(points[whole])
            depth = inside[:, 2, None]
            error = camera.focal * (flat[i] - inside[:, :2] / depth)
            slope = (
                camera.focal
                * (
                    camera.rotation[None, :2]
                    - (inside[:, :2] / depth)[..., None] * camera.rotation[2]
                )
                / depth[..., None]
            )
            normal += np.einsum("nki,nkj->nij", slope, slope)
            right += np.einsum("nki,nk->ni", slope, error)
        points[whole] += np.linalg.solve(normal, right[..., None])[..., 0]
    return points.reshape(*shape, 3)


def align(points: Floats, target: Floats) -> tuple[Floats, Floats]:
    """Return the rotation and translation that carry points onto others best.

    Parameters
    ----------
    points, target : ndarray, shape (n, 3)
        Three points or more, not on a line.

    Returns
    -------
    rotation, translation : ndarray
        ``target`` is nearly ``points @ rotation.T + translation``.

    References
    ----------
    W. Kabsch, Acta Crystallographica A 32 (1976) 922.
    """
    here, there = points.mean(axis=0), target.mean(axis=0)
    left, _, right = np.linalg.svd((target - there).T @ (points - here))
    sign = np.sign(np.linalg.det(left @ right))
    turn = left @ np.diag([1.0, 1.0, sign]) @ right
    return turn, there - turn @ here


Triple = tuple[float, float, float]
Area = tuple[float, float, float, float]
"""Least x and y, greatest x and y [px]."""


@dataclass(frozen=True, kw_only=True)
class _CameraRecord:
    """A camera as it stands in a file."""

    name: str
    size: tuple[int, int]
    matrix: tuple[Triple, Triple, Triple]
    distortion: tuple[float, ...]
    rotation: tuple[Triple, Triple, Triple]
    translation: Triple


@dataclass(frozen=True, kw_only=True)
class _SetRecord:
    """A set of cameras as it stands in a file."""

    world: str
    rms: float
    cameras: tuple[_CameraRecord, ...]
    resamples: tuple[tuple[_CameraRecord, ...], ...] = ()
    scale_uncertainty: float = 0.0
    areas: tuple[Area, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraSet(Shown):
    """One camera or more in one world, with their uncertainty.

    Attributes
    ----------
    names : tuple of str
        Names of the cameras.
    cameras : tuple of Camera
    world : str
        What the world's frame is.
    rms : float
        Of the calibration's residuals [px].
    resamples : tuple of tuple of Camera
        The same cameras from resampled views, each in its own estimate of the same world: their
        spread is the uncertainty of the calibration.
    scale_uncertainty : float
        Standard uncertainty of all lengths, as a share of them: that of the board's print.
    areas : tuple of (float, float, float, float)
        Where corners were seen in each camera's pictures: least x and y, greatest x and y [px].
        Elsewhere the lens is extrapolated. Empty if it is not known.
    """

    names: tuple[str, ...]
    cameras: tuple[Camera, ...]
    world: str = ""
    rms: float = 0.0
    resamples: tuple[tuple[Camera, ...], ...] = ()
    scale_uncertainty: float = 0.0
    areas: tuple[Area, ...] = ()

    def __post_init__(self) -> None:
        counts = {len(self.names), len(self.cameras), *map(len, self.resamples)}
        if len(counts) > 1 or 0 in counts:
            raise InputError(
                "a set of cameras needs a name for each, and each resample all of them"
            )

    @property
    def baseline(self) -> float:
        """Distance of the first two cameras [mm]; 0 for one camera."""
        centres = [camera.centre for camera in self.cameras[:2]]
        return float(np.linalg.norm(centres[-1] - centres[0]))

    def covers(self, pixels: ArrayLike) -> NDArray[np.bool_]:
        """Return which pixels (c, ..., 2) all cameras see where their lens was calibrated."""
        seen = np.asarray(pixels, dtype=float)
        inside = np.ones(seen.shape[1:-1], dtype=bool)
        for area, own in zip(self.areas, seen, strict=False):
            inside &= np.all((own >= area[:2]) & (own <= area[2:]), axis=-1)
        return inside

    def triangulate(self, pixels: ArrayLike) -> Floats:
        """Return points (..., 3) [mm] of pixels (c, ..., 2); see `triangulate`."""
        return triangulate(self.cameras, pixels)

    def calibration_covariance(self, pixels: ArrayLike) -> Floats:
        """Return the covariance of triangulated points that the calibration brings.

        It is the spread of the points over the resamples, and the scale of the board about the
        world's origin.

        Parameters
        ----------
        pixels : array_like, shape (c, ..., 2)

        Returns
        -------
        ndarray, shape (..., 3, 3)
            [mm^2]
        """
        points = self.triangulate(pixels)
        covariance = self.scale_uncertainty**2 * points[..., :, None] * points[..., None, :]
        if len(self.resamples) > 1:
            drawn = np.stack([triangulate(cameras, pixels) for cameras in self.resamples])
            off = drawn - drawn.mean(axis=0)
            covariance = covariance + np.einsum("b...i,b...j->...ij", off, off) / (len(drawn) - 1)
        return np.asarray(covariance)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the set to a file (.yaml, .json) and return its path."""
        record = _SetRecord(
            world=self.world,
            rms=self.rms,
            cameras=_list_records(self.names, self.cameras),
            resamples=tuple(_list_records(self.names, cameras) for cameras in self.resamples),
            scale_uncertainty=self.scale_uncertainty,
            areas=self.areas,
        )
        note = "Cameras; mm, px, the centre of the first pixel is (0, 0); rotation: world to camera"
        return save_record(record, path, note=note)


def _list_records(names: Sequence[str], cameras: Sequence[Camera]) -> tuple[_CameraRecord, ...]:
    return tuple(
        _CameraRecord(
            name=name,
            size=camera.size,
            matrix=_to_rows(camera.matrix),
            distortion=tuple(camera.distortion.tolist()),
            rotation=_to_rows(camera.rotation),
            translation=tuple(camera.translation.tolist()),
        )
        for name, camera in zip(names, cameras, strict=True)
    )


def _to_rows(matrix: Floats) -> tuple[Triple, Triple, Triple]:
    first, second, third = (tuple(row) for row in matrix.tolist())
    return first, second, third


def load_cameras(path: str | os.PathLike[str]) -> CameraSet:
    """Read a set of cameras from a file (.yaml, .json).

    Raises
    ------
    FileFormatError
        One line that names the file and the field.
    """
    record = load_record(path, _SetRecord, name="the file of cameras")
    try:
        return CameraSet(
            names=tuple(camera.name for camera in record.cameras),
            cameras=_make_cameras(record.cameras),
            world=record.world,
            rms=record.rms,
            resamples=tuple(map(_make_cameras, record.resamples)),
            scale_uncertainty=record.scale_uncertainty,
            areas=record.areas,
        )
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from None


def _make_cameras(records: Sequence[_CameraRecord]) -> tuple[Camera, ...]:
    return tuple(
        Camera(
            matrix=np.array(record.matrix),
            distortion=np.array(record.distortion),
            size=record.size,
            rotation=np.array(record.rotation),
            translation=np.array(record.translation),
        )
        for record in records
    )

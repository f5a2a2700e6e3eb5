"""Pictures computed from a scene: boards and tubes seen by a camera with lens, light and noise.

They serve as documentation, as test data with a known truth, and to plan a set-up. What is
modelled: lens distortion, the area of pixels, a point light with Lambert's law and Blinn's gloss,
uneven light, defocus by a disc that depends on depth, a Gaussian point spread, noise that grows
with the signal, gamma, 8 or 16 bits, and JPEG. What is not: shadows, inter-reflection, blooming,
motion.
"""

from __future__ import annotations

import dataclasses
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_fields, check_integer, check_points, quantity
from ..errors import InputError
from ..numeric.arrays import Floats
from ..numeric.polylines import measure_arc_length, resample_polyline
from ..numeric.vectors import nearest_rotation
from ..results import Shown
from .board import Board, StripBoard
from .camera import FISHEYE_TERMS, Camera, aim_camera, undistort_fisheye
from .pictures import Grey, Picture

PAPER_MARGIN = 10.0
"""White paper around the print of a board [mm]."""

_BLACK, _WHITE = 0.04, 0.85
"""Albedo of ink and paper."""

_TEXELS = 20.0
"""Of a board's texture a mm, if that makes no more than..."""
_MOST_TEXELS = 4000
"""...so many across."""

_CURVE_STEP = 0.1
"""Spacing of the points of a tube's axis [mm]."""

_BLUR_LEVELS = 5


@dataclass(frozen=True, kw_only=True)
class Sensor(Shown):
    """What a camera makes of the light that falls on it.

    Parameters
    ----------
    blur : float
        Standard deviation of the point spread [px].
    aperture : float
        Diameter of the entrance pupil [mm]; 0 for everything in focus.
    focus : float
        Distance in focus [mm].
    noise : float
        Standard deviation of the noise of white, before gamma, as a share of the full range.
    uneven : float
        Share of the light that is lost from the brightest corner of the picture to the darkest.
    exposure : float
        White paper in full light is this share of the full range.
    gamma : float
        Exponent: the stored value is the light to the power of 1/gamma.
    jpeg : int
        Quality of JPEG from 1 to 100; 0 for none.
    bits : int
        Of a stored value, 8 or 16.
    supersampling : int
        Rays a pixel in each direction. Edges of bands are exact for any number.
    """

    blur: float = quantity(help="Point spread [px].", default=0.8, low=0.0, high=50.0)
    aperture: float = quantity("length", "Entrance pupil.", default=0.0, low=0.0, high=100.0)
    focus: float = quantity("length", "Distance in focus.", default=300.0, low=1.0, high=1e5)
    noise: float = quantity(help="Noise of white.", default=0.012, low=0.0, high=1.0)
    uneven: float = quantity(help="Light lost over the picture.", default=0.2, low=0.0, high=1.0)
    exposure: float = quantity(help="White paper.", default=0.8, low=0.0, high=100.0)
    gamma: float = quantity(help="Exponent.", default=2.2, low=0.1, high=10.0)
    jpeg: int = quantity(help="Quality; 0 for none.", default=90, low=0, high=100, whole=True)
    bits: int = quantity(help="Of a value.", default=8, low=8, high=16, whole=True)
    supersampling: int = quantity(help="Rays a pixel.", default=2, low=1, high=8, whole=True)

    def __post_init__(self) -> None:
        check_fields(self, "the sensor's ")
        if self.bits not in (8, 16) or (self.jpeg and self.bits == 16):
            raise InputError(f"the sensor's bits are {self.bits}: 8, or 16 without JPEG")


@dataclass(frozen=True, kw_only=True)
class Light(Shown):
    """A point light.

    Parameters
    ----------
    position : tuple of float
        Where it is in the world [mm].
    ambient, diffuse : float
        Light from all sides and from the point, for an albedo of 1.
    gloss : float
        Strength of the mirror-like part.
    exponent : float
        How narrow that is.
    """

    position: tuple[float, float, float] = (-150.0, -200.0, -600.0)
    ambient: float = 0.4
    diffuse: float = 0.6
    gloss: float = 0.0
    exponent: float = 40.0

    def pack(self) -> Floats:
        """Return it as the kernels take it."""
        return np.array(
            [*self.position, self.ambient, self.diffuse, self.gloss, self.exponent], dtype=float
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedTube(Shown):
    """A tube about a curve, with rounded ends and bands around it.

    Parameters
    ----------
    curve : array_like, shape (n, 3)
        Its axis in the world [mm], near enough for straight lines between.
    radius : float
        [mm]
    albedo : float
        Share of the light that it returns.
    bands : sequence of (float, float, float)
        Start and end along the axis [mm], and albedo, of each band.
    """

    curve: Floats
    radius: float
    albedo: float = 0.6
    bands: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self) -> None:
        points = check_points("the tube's curve", self.curve)
        if points.ndim != 2 or len(points) < 2:
            raise InputError("the tube's curve must be (n, 3) points, two or more")
        object.__setattr__(self, "curve", points)


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene(Shown):
    """What stands before a camera.

    Parameters
    ----------
    board : Board, optional
        In the plane z = 0 of the world; its print starts at the origin.
    tubes : tuple of RenderedTube
    light : Light
    background : float
        Light that comes from where there is nothing.
    """

    board: Board | None = None
    tubes: tuple[RenderedTube, ...] = ()
    light: Light = Light()
    background: float = 0.03


def render_picture(
    scene: Scene, camera: Camera, *, sensor: Sensor = Sensor(), seed: int = 0
) -> Picture:
    """Return the picture that a camera takes of a scene.

    The same seed gives the same picture. Kept for the next picture are the rays of a camera's lens,
    the board before a camera, and the light of the last two scenes for other sensors.
    """
    check_integer("seed", seed, low=0)
    radiance, depth = _trace_scene(scene, camera, sensor.supersampling)
    if sensor.aperture > 0.0:
        radiance = _defocus(radiance, depth, camera.focal, sensor)
    return _expose(radiance, sensor, seed)


@lru_cache(maxsize=2)
def _trace_scene(scene: Scene, camera: Camera, samples: int) -> tuple[Floats, Floats]:
    """Return the mean light and the depth [mm] of each pixel, without lens blur or noise."""
    from .kernels.rays import render_tube

    grid = _find_rays(camera, samples)
    light, turn, origin = scene.light.pack(), np.array(camera.rotation), np.array(camera.centre)
    if scene.board is None:
        radiance = np.full(grid.shape[:2], scene.background, np.float32)
        depth = np.full(grid.shape[:2], np.inf, np.float32)
    else:
        drawn = _trace_board(scene.board, scene.background, tuple(light), camera, samples)
        radiance, depth = (values.copy() for values in drawn)
    for tube in scene.tubes:
        curve = _densify(tube.curve)
        region = _find_region(curve, tube.radius, camera, samples)
        bands = np.array([(-np.inf, np.inf, tube.albedo), *tube.bands], dtype=float)
        render_tube(
            *(grid, region, turn, origin, curve, measure_arc_length(curve), tube.radius),
            *(bands, light, radiance, depth),
        )
    return _join(radiance, samples, np.add) / samples**2, _join(depth, samples, np.minimum)


@lru_cache(maxsize=1)
def _trace_board(
    board: Board, background: float, light: tuple[float, ...], camera: Camera, samples: int
) -> tuple[Grey, Grey]:
    """Return the light and the depth [mm] of each ray, of a board alone."""
    from .kernels.rays import render_plane

    grid = _find_rays(camera, samples)
    radiance = np.full(grid.shape[:2], background, np.float32)
    depth = np.full(grid.shape[:2], np.inf, np.float32)
    texture, texels = _draw_texture(board)
    edge = -PAPER_MARGIN + 0.5 / texels
    place = np.array([board.scale * edge, board.scale * edge, texels / board.scale])
    turn, origin = np.array(camera.rotation), np.array(camera.centre)
    render_plane(grid, turn, origin, texture, place, np.array(light), radiance, depth)
    return radiance, depth


def _join(values: Grey, samples: int, add: np.ufunc) -> Floats:
    """Return a value for each pixel from those of its rays."""
    joined = values[::samples, ::samples].astype(float)
    for k in range(1, samples**2):
        add(joined, values[k // samples :: samples, k % samples :: samples], out=joined)
    return joined


def _densify(curve: Floats) -> Floats:
    """Return the axis of a tube with points near each other, or a straight line's two ends."""
    return curve if len(curve) == 2 else resample_polyline(curve, _CURVE_STEP)


def _find_rays(camera: Camera, samples: int) -> Grey:
    """Return what `_ray_grid` does, of a camera."""
    lens = tuple(camera.matrix.ravel()), tuple(camera.distortion)
    return _ray_grid(*lens, camera.size, samples)


@lru_cache(maxsize=4)
def _ray_grid(
    matrix: tuple[float, ...], distortion: tuple[float, ...], size: tuple[int, int], samples: int
) -> Grey:
    """Return x/z and y/z of the rays of a lens, `samples` a pixel each way, (h, w, 2)."""
    from .kernels.rays import undistort_grid

    fx, skew, cx, _, fy, cy = matrix[:6]
    if skew:
        raise InputError("pictures are rendered for cameras without skew")
    x, y = ((np.arange(n * samples) + 0.5) / samples - 0.5 for n in size)
    if len(distortion) == FISHEYE_TERMS:
        grid = np.stack(np.meshgrid((x - cx) / fx, (y - cy) / fy), axis=-1)
        rays = undistort_fisheye(grid, np.array(distortion))
        if not np.isfinite(rays).all():
            raise InputError("pictures are rendered for views of less than 180 degrees")
        return np.asarray(rays, dtype=np.float32)
    return np.asarray(undistort_grid((x - cx) / fx, (y - cy) / fy, *distortion))


@lru_cache(maxsize=4)
def _draw_texture(board: Board) -> tuple[Grey, float]:
    """Return the albedo of a board and the paper around it, and its texels a nominal mm."""
    width, height = (length + 2.0 * PAPER_MARGIN for length in board.extent)
    texels = min(_TEXELS, _MOST_TEXELS / max(width, height))
    ink = np.zeros((round(height * texels), round(width * texels)), np.float32)
    for x0, y0, x1, y1 in (board.rectangles + PAPER_MARGIN) * texels:
        down, across = _cover(y0, y1), _cover(x0, x1)
        ink[int(y0) : int(y0) + len(down), int(x0) : int(x0) + len(across)] += np.outer(
            down, across
        )
    return (_WHITE - (_WHITE - _BLACK) * np.minimum(ink, 1.0)).astype(np.float32), texels


def _cover(start: float, end: float) -> Floats:
    """Return how much of each texel from int(start) on lies between start and end."""
    edges = np.arange(int(start), math.ceil(end) + 1, dtype=float)
    return np.diff(np.clip(edges, start, end))


def _find_region(curve: Floats, radius: float, camera: Camera, samples: int) -> NDArray[np.int64]:
    """Return the part of the grid that a tube may be seen in."""
    points = resample_polyline(curve, max(radius, 1.0))  # the middle may be nearer than the ends
    inside = camera.to_camera(points)
    if inside[:, 2].min() <= radius:
        raise InputError("a tube reaches behind the camera: move it or the camera")
    pixels = camera.project(points)
    margin = 2.0 + 1.3 * camera.focal * radius / (inside[:, 2].min() - radius)
    low, high = pixels.min(axis=0) - margin, pixels.max(axis=0) + margin
    limit = np.array(camera.size)
    first = np.clip(np.floor(low), 0, limit).astype(int) * samples
    last = np.clip(np.ceil(high) + 1, 0, limit).astype(int) * samples
    return np.array([first[1], last[1], first[0], last[0]])


def _defocus(radiance: Floats, depth: Floats, focal: float, sensor: Sensor) -> Floats:
    """Blur each pixel by the disc of its depth, between blurs by a few discs."""
    from scipy.ndimage import convolve

    seen = np.isfinite(depth)
    if not seen.any():
        return radiance
    nearest = np.where(seen, depth, np.max(depth[seen]))
    radius = 0.5 * sensor.aperture * focal * np.abs(1.0 / nearest - 1.0 / sensor.focus)
    low, high = float(radius.min()), float(radius.max())
    levels = np.linspace(low, high, 1 if high - low < 0.1 else _BLUR_LEVELS)
    # Further from what is seen than the largest disc the background is even.
    margin = math.ceil(high) + 1
    rows, columns = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
    part = _widen(rows, margin), _widen(columns, margin)
    sharp, radius, result = radiance[part], radius[part], radiance.copy()
    result[part] = 0.0
    for level in levels:
        share = 1.0
        if len(levels) > 1:
            share = np.clip(1.0 - np.abs(radius - level) / (levels[1] - levels[0]), 0.0, 1.0)
        result[part] += share * convolve(sharp, _make_disc(level), mode="nearest")
    return result


def _widen(places: NDArray[np.intp], margin: int) -> slice:
    """Return the range from the first to the last place, and so many more at each end."""
    return slice(max(int(places[0]) - margin, 0), int(places[-1]) + margin + 1)


def _make_disc(radius: float) -> Floats:
    """Return a disc as a filter whose sum is 1."""
    half = math.ceil(radius)
    fine = (np.arange((2 * half + 1) * 8) + 0.5) / 8.0 - half - 0.5
    inside = np.add.outer(fine**2, fine**2) <= max(radius, 0.1) ** 2
    disc = inside.reshape(2 * half + 1, 8, 2 * half + 1, 8).sum(axis=(1, 3)).astype(float)
    return np.asarray(disc / disc.sum())


def _expose(radiance: Floats, sensor: Sensor, seed: int) -> Picture:
    """Return what the sensor stores."""
    from scipy.ndimage import gaussian_filter

    height, width = radiance.shape
    if sensor.uneven > 0.0:
        x, y = np.linspace(0.0, 0.5, width), np.linspace(0.0, 0.5, height)[:, None]
        radiance = radiance * (1.0 - sensor.uneven * (x + y))
    signal = radiance * (sensor.exposure / _WHITE)
    if sensor.blur > 0.0:
        signal = gaussian_filter(signal, sensor.blur, mode="nearest")
    if sensor.noise > 0.0:
        draw = np.random.default_rng(seed).standard_normal(signal.shape)
        signal = signal + sensor.noise * np.sqrt(0.1 + 0.9 * np.clip(signal, 0.0, 1.0)) * draw
    full = 2**sensor.bits - 1
    stored = np.round(full * np.clip(signal, 0.0, 1.0) ** (1.0 / sensor.gamma))
    picture = Picture((stored / full).astype(np.float32), bits=sensor.bits, name="rendered")
    return _compress(picture, sensor.jpeg) if sensor.jpeg else picture


def _compress(picture: Picture, quality: int) -> Picture:
    """Return a picture as JPEG leaves it."""
    from PIL import Image

    packed = io.BytesIO()
    Image.fromarray(picture.bytes).save(packed, "jpeg", quality=quality)
    values = np.asarray(Image.open(packed), dtype=np.float32) / np.float32(255.0)
    return dataclasses.replace(picture, values=values)


# Scenes.


@dataclass(frozen=True, kw_only=True)
class HungMuscle(Shown):
    """A straight muscle with two dark rings in front of a board of strips.

    Parameters
    ----------
    length : float
        Between the middles of the rings [mm].
    diameter : float
        [mm]
    ring : float
        Length of a ring along the axis [mm].
    height : float
        Of the axis in front of the board [mm], at the muscle's middle.
    angle : float
        Of the axis against the board's y, in the plane of the board [rad].
    tilt : float
        Of the axis out of that plane [rad].
    offset : tuple of float
        Of the muscle's middle from the middle of the window, x and y [mm].
    body, dark : float
        Albedo of the muscle and of its rings.
    end : float
        How far the muscle goes on beyond the middle of a ring [mm].
    """

    length: float = quantity("length", "Between the rings.", default=38.0, low=1.0, high=1e3)
    diameter: float = quantity("length", "Diameter.", default=1.6, low=0.1, high=50.0)
    ring: float = quantity("length", "Length of a ring.", default=2.0, low=0.1, high=20.0)
    height: float = quantity("length", "Axis over the board.", default=2.8, low=0.1, high=100.0)
    angle: float = quantity("angle", "In the board's plane.", default=0.0, low=-1.0, high=1.0)
    tilt: float = quantity("angle", "Out of that plane.", default=0.0, low=-1.0, high=1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    body: float = quantity(help="Albedo of the muscle.", default=0.5, low=0.0, high=1.0)
    dark: float = quantity(help="Albedo of the rings.", default=0.05, low=0.0, high=1.0)
    end: float = quantity("length", "Beyond a ring.", default=6.0, low=0.1, high=100.0)

    def __post_init__(self) -> None:
        check_fields(self, "the muscle's ")

    def find_marks(self, board: StripBoard) -> Floats:
        """Return the middles of the rings on the axis, upper one first, shape (2, 3) [mm]."""
        left, top, right, foot = board.window
        middle = np.array(
            [
                0.5 * (left + right) + self.offset[0],
                0.5 * (top + foot) + self.offset[1],
                -self.height,
            ]
        )
        return np.asarray(middle + np.outer([-0.5, 0.5], self.length * self._direction))

    @property
    def _direction(self) -> Floats:
        flat = math.cos(self.tilt)
        return np.array(
            [flat * math.sin(self.angle), flat * math.cos(self.angle), math.sin(self.tilt)]
        )

    def make_scene(self, board: StripBoard, *, light: Light = Light()) -> Scene:
        """Return the scene of the muscle in the window of a board."""
        marks = self.find_marks(board)
        ends = marks + np.outer([-self.end, self.end], self._direction)
        half = 0.5 * self.ring
        rings = tuple(
            (at - half, at + half, self.dark) for at in (self.end, self.end + self.length)
        )
        tube = RenderedTube(curve=ends, radius=0.5 * self.diameter, albedo=self.body, bands=rings)
        return Scene(board=board, tubes=(tube,), light=light)


def make_backbone_scene(
    curve: ArrayLike,
    *,
    diameter: float = 7.0,
    ring: float = 2.0,
    ends: float = 4.0,
    light: Light = Light(position=(-100.0, -400.0, 150.0)),
) -> Scene:
    """Return the scene of a bright tube on dark ground, with a dark ring at both ends of a curve.

    Parameters
    ----------
    curve : array_like, shape (n, 3)
        From the middle of the base ring to that of the tip ring [mm].
    diameter : float
        [mm]
    ring : float
        Length of a ring [mm].
    ends : float
        How far the tube goes straight on beyond both [mm].
    light : Light
    """
    points = check_points("curve", curve)
    first, last = points[0] - points[1], points[-1] - points[-2]
    whole = np.vstack(
        [
            points[0] + ends * first / np.linalg.norm(first),
            points,
            points[-1] + ends * last / np.linalg.norm(last),
        ]
    )
    length, half = float(measure_arc_length(points)[-1]), 0.5 * ring
    bands = tuple((at - half, at + half, 0.05) for at in (ends, ends + length))
    tube = RenderedTube(curve=whole, radius=0.5 * diameter, albedo=0.75, bands=bands)
    return Scene(tubes=(tube,), light=light)


def bend_curve(length: float, angle: float, *, plane: float = 0.0, count: int = 400) -> Floats:
    """Return an arc from the origin, upright (+z) at its start, shape (count, 3) [mm].

    Parameters
    ----------
    length : float
        [mm]
    angle : float
        By which its end is turned [rad].
    plane : float
        Direction that it bends in, from +x about +z [rad].
    """
    s = np.linspace(0.0, length, count)
    bend = angle / length
    straight = abs(angle) < 1e-6
    aside = 0.5 * bend * s**2 if straight else (1.0 - np.cos(bend * s)) / bend
    up = s if straight else np.sin(bend * s) / bend
    return np.stack([math.cos(plane) * aside, math.sin(plane) * aside, up], axis=1)


@dataclass(frozen=True, kw_only=True)
class PairLayout(Shown):
    """Two cameras either side of the direction in which a target is looked at.

    Parameters
    ----------
    target : tuple of float
        What they look at [mm].
    distance : float
        Of each from it [mm].
    half_angle : float
        Between each camera's axis and +y [rad].
    pitch : float
        Size of a pixel at the target [mm].
    size : tuple of int
        Width and height of the pictures [px].
    distortion : tuple of float
        Of both lenses.
    """

    target: tuple[float, float, float] = (0.0, 0.0, 25.0)
    distance: float = quantity("length", "From the target.", default=250.0, low=10.0, high=1e4)
    half_angle: float = quantity(
        "angle", "Of each camera.", default=math.radians(35.0), low=0.01, high=1.5
    )
    pitch: float = quantity("length", "A pixel at the target.", default=0.086, low=1e-4, high=10.0)
    size: tuple[int, int] = (1280, 800)
    distortion: tuple[float, float, float, float, float] = (-0.12, 0.05, 4e-4, -3e-4, 0.0)

    def __post_init__(self) -> None:
        check_fields(self, "the layout's ")

    def make_cameras(self) -> tuple[Camera, Camera]:
        """Return the left and the right camera; their pictures show -z downwards."""
        target = np.array(self.target)
        left, right = (
            aim_camera(
                target + self.distance * np.array([side, -math.cos(self.half_angle), 0.0]),
                target,
                focal=self.distance / self.pitch,
                size=self.size,
                distortion=self.distortion,
                down=(0.0, 0.0, -1.0),
            )
            for side in (-math.sin(self.half_angle), math.sin(self.half_angle))
        )
        return left, right


def make_board_poses(
    board: Board,
    cameras: Sequence[Camera],
    *,
    target: ArrayLike,
    count: int = 12,
    seed: int = 0,
) -> list[tuple[Floats, Floats]]:
    """Return poses of a board in the world for a calibration of cameras.

    The board faces the cameras, tilted up to 30, 18 and 40 degrees about its axes, with its middle
    near the target.

    Returns
    -------
    list of (rotation, translation)
        From the board's frame to the world; `Camera.move_world` takes them.
    """
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    facing = nearest_rotation(np.mean([camera.rotation.T for camera in cameras], axis=0))
    middle = board.scale * np.array([*board.extent, 0.0]) / 2.0
    most = np.radians([30.0, 18.0, 40.0])
    poses = []
    for k in range(count):
        spread = rng.uniform(-1.0, 1.0, 3)
        spread[k % 2] = math.copysign(rng.uniform(0.6, 1.0), spread[k % 2])
        turn = facing @ Rotation.from_euler("xyz", most * spread).as_matrix()
        aside = facing @ (rng.uniform(-1.0, 1.0, 3) * 0.15 * max(board.extent))
        poses.append((turn, np.asarray(target) + aside - turn @ middle))
    return poses

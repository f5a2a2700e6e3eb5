"""Calibration of one camera or two from pictures of a board.

The lens has two radial terms and two tangential ones, and a third radial one where corners were
seen far from the axis, as it is not determined otherwise; or it is a fisheye of four terms. The
world is the board of one view, found from all cameras together: the axes of a single camera trade
off against its principal point.
"""

from __future__ import annotations

import dataclasses
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_fields, quantity, show_apart
from ..errors import FileFormatError, InputError
from ..numeric.arrays import Floats
from ..numeric.vectors import nearest_rotation
from ..progress import Progress, no_progress
from ..results import Json, ReasonedResult, take_axes, to_plain
from .board import CHECK_LINE, Board, Detection
from .camera import FISHEYE_TERMS, Area, Camera, CameraSet, align, prepare_pose, triangulate
from .pictures import SUFFIXES, Grey, import_opencv, measure_each, read_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST_VIEWS = 8
"""Views that a calibration needs."""

LEAST_COVERAGE = 0.1
"""Share of the picture's cells that corners must be seen in."""

GOOD_COVERAGE = 0.4
"""Share of the picture's cells below which a calibration is flagged."""

LEAST_TILT = math.radians(15.0)
"""Angle between the two most different directions of the board [rad]."""

MOST_RMS = 0.3
"""Root mean square of the residuals above which a calibration is refused [px]."""

_CELLS = (8, 6)
_WIDE_FIELD = 0.5
_OUTLIER = 3.0
_HOLD_OUT_EVERY = 4
_LEAST_CORNERS = 8


@dataclass(frozen=True, kw_only=True)
class CalibrationOptions:
    """How a calibration is made.

    Parameters
    ----------
    world : str
        Name of the view whose board is the world; empty for the first that is used.
    resamples : int
        How often views are drawn anew to find the uncertainty; 0 for none.
    baseline : float
        Expected distance of two cameras [mm]: a calibration that is farther from it than 2 % is
        refused, which finds a wrong size of the squares; 0 for none.
    seed : int
        Of the draws.
    lens : {"plain", "fisheye"}
        Model of the lenses: a fisheye for a field of view beyond about 110 degrees.
    """

    world: str = quantity(
        "text", "View whose board is the world; by default the first.", default=""
    )
    resamples: int = quantity(
        "dimensionless",
        "Draws of views for the uncertainty.",
        default=10,
        low=0,
        high=1000,
        whole=True,
    )
    baseline: float = quantity(
        "length", "Expected distance of the cameras, to check.", default=0.0, low=0.0, high=1e5
    )
    seed: int = quantity(help="Of the draws.", default=0, low=0, high=2**31, whole=True)
    lens: str = quantity(
        "text",
        "Model of the lenses: fisheye for a view wider than about 110 degrees.",
        default="plain",
        words=("plain", "fisheye"),
    )

    def __post_init__(self) -> None:
        check_fields(self)


BASELINE_TOLERANCE = 0.02
"""Share by which a baseline may be off the expected one."""


@dataclass(frozen=True)
class BoardView:
    """A board seen by each camera at the same time.

    Attributes
    ----------
    name : str
    detections : tuple of Detection
        One a camera; without corners where the board was not found.
    reason : str
        Why it is not used; empty if it is.
    rms : float
        Of its residuals in all cameras [px]; NaN if it is not used.
    """

    name: str
    detections: tuple[Detection, ...]
    reason: str = ""
    rms: float = math.nan


@dataclass(frozen=True)
class HoldOut:
    """How a calibration from some of the views fits the others.

    Attributes
    ----------
    views : int
        Views that were left out.
    rms : float
        Of the residuals in them [px].
    length_rms : float
        Of the errors of distances between triangulated neighbouring corners [mm]; NaN for one
        camera.
    baseline : float
        Distance of the cameras from the other views [mm]; NaN for one camera.
    """

    views: int = 0
    rms: float = math.nan
    length_rms: float = math.nan
    baseline: float = math.nan


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraCalibration(ReasonedResult):
    """Calibrated cameras, or the reason why they are refused.

    Attributes
    ----------
    cameras : CameraSet
        The cameras; not to be used if `converged` is False.
    views : tuple of BoardView
        All views, those not used with their reasons.
    coverage : tuple of float
        Share of each camera's picture in which corners were seen.
    tilt : float
        Angle between the two most different directions of the board [rad].
    hold_out : HoldOut
        The check on views that were left out.
    focal_uncertainty : tuple of float
        Standard uncertainty of each camera's focal length, from the resamples [px].
    baseline_uncertainty : float
        Standard uncertainty of the distance of the cameras, with the scale of the board [mm].
    errors : tuple of ndarray, shape (n, 4)
        For each camera the pixel of each corner and its residual [px].
    flags : tuple of str
        What else should be known.
    reason : str
        Why it is refused; empty if it is not.
    """

    cameras: CameraSet
    views: tuple[BoardView, ...]
    coverage: tuple[float, ...]
    tilt: float
    hold_out: HoldOut
    focal_uncertainty: tuple[float, ...]
    baseline_uncertainty: float
    errors: tuple[Floats, ...] = dataclasses.field(repr=False)
    flags: tuple[str, ...] = ()
    reason: str = ""

    @property
    def residual(self) -> float:
        """Root mean square of the residuals [px]."""
        return self.cameras.rms

    def to_dict(self) -> Json:
        """Return the result as plain values with units in their names."""
        cameras = [
            {
                "name": name,
                "size_px": list(camera.size),
                "focal_px": np.diag(camera.matrix)[:2].tolist(),
                "focal_uncertainty_px": spread,
                "principal_point_px": camera.matrix[:2, 2].tolist(),
                "distortion": camera.distortion.tolist(),
                "coverage": covered,
            }
            for name, camera, spread, covered in zip(
                self.cameras.names,
                self.cameras.cameras,
                self.focal_uncertainty,
                self.coverage,
                strict=True,
            )
        ]
        held = self.hold_out
        return {
            "converged": self.converged,
            "reason": self.reason,
            "rms_px": self.cameras.rms,
            "world": self.cameras.world,
            "cameras": cameras,
            "baseline_mm": to_plain(self.cameras.baseline or math.nan),
            "baseline_uncertainty_mm": to_plain(self.baseline_uncertainty),
            "tilt_rad": self.tilt,
            "hold_out": {
                "views": held.views,
                "rms_px": to_plain(held.rms),
                "length_rms_mm": to_plain(held.length_rms),
                "baseline_mm": to_plain(held.baseline),
            },
            "flags": list(self.flags),
            "views": [
                {
                    "view": view.name,
                    "corners": [len(found.ids) for found in view.detections],
                    "rms_px": to_plain(view.rms),
                    "reason": view.reason,
                }
                for view in self.views
            ],
        }

    def list_columns(self) -> Json:
        """Return the views as columns."""
        return {
            "view": [view.name for view in self.views],
            "rms_px": [view.rms for view in self.views],
            "reason": [view.reason for view in self.views],
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw where corners were seen, their residuals magnified, and return the axes."""
        ax = take_axes(ax, x="x [px]", y="y [px]")
        ax.set_aspect("equal")
        left = 0.0
        for name, camera, errors in zip(
            self.cameras.names, self.cameras.cameras, self.errors, strict=True
        ):
            width, height = camera.size
            frame = np.array([[0, 0], [width, 0], [width, height], [0, height], [0, 0]])
            ax.plot(left + frame[:, 0], frame[:, 1], color="0.4", linewidth=0.8)
            ax.text(left, -0.02 * height, name)
            size = np.linalg.norm(errors[:, 2:], axis=1)
            drawn = ax.quiver(
                left + errors[:, 0],
                errors[:, 1],
                *errors[:, 2:].T,
                size,
                angles="xy",
                scale=4.0 * max(self.residual, 1e-9) / (0.05 * width),
                scale_units="xy",
                cmap="viridis",
                clim=(0.0, 3.0 * max(self.residual, 1e-9)),
            )
            left += 1.08 * width
        figure = ax.get_figure(root=True)
        if figure is not None:
            figure.colorbar(drawn, ax=ax, label="residual [px]", shrink=0.7)
        if not ax.yaxis_inverted():
            ax.invert_yaxis()
        return ax


# Pictures.

_NAME = re.compile(r"(?P<camera>.*?)[ _.-]?(?P<view>\d+)")


def list_pictures(
    folder: str | os.PathLike[str],
) -> tuple[tuple[str, ...], list[tuple[str, dict[str, Path]]]]:
    """Return the cameras of a folder of pictures, and the pictures of each view by camera.

    Names are a camera, then a number: ``cam0_01.png`` and ``cam1_01.png`` are one view.

    Raises
    ------
    InputError
        If there are no pictures of one camera or two.
    """
    place = Path(folder)
    if not os.path.isdir(place):
        raise InputError(f"{place}: there is no such folder")
    found: dict[str, dict[str, Path]] = {}
    cameras: set[str] = set()
    for path in sorted(place.iterdir()):
        match = _NAME.fullmatch(path.stem)
        if match and path.suffix.lower() in SUFFIXES and path.is_file():
            if match["camera"] in found.setdefault(match["view"], {}):
                raise InputError(f"{place}: two pictures are view {match['view']} of one camera")
            found[match["view"]][match["camera"]] = path
            cameras.add(match["camera"])
    if not 1 <= len(cameras) <= 2:
        names = ", ".join(sorted(cameras)[:5]) or "none"
        raise InputError(
            f"{place}: pictures of one camera or two are needed, named such as cam0_01.png; "
            f"cameras found: {names}"
        )
    return tuple(sorted(cameras)), sorted(found.items())


def detect_views(
    folder: str | os.PathLike[str],
    board: Board,
    *,
    jobs: int = 1,
    progress: Progress = no_progress,
) -> tuple[tuple[str, ...], list[BoardView]]:
    """Find a board in a folder of pictures.

    Returns
    -------
    cameras : tuple of str
        Names of the cameras.
    views : list of BoardView
        A picture that is missing or cannot be read is a detection with its reason.
    """
    cameras, pairs = list_pictures(folder)
    paths = [pictures.get(camera) for _, pictures in pairs for camera in cameras]
    rows = measure_each(
        paths, partial(_detect_one, board), jobs=jobs, stage="find corners", progress=progress
    )
    found = [row.get("found", _nothing(row["reason"])) for row in rows]
    count = len(cameras)
    return cameras, [
        BoardView(name, tuple(found[k * count : (k + 1) * count]))
        for k, (name, _) in enumerate(pairs)
    ]


def _detect_one(board: Board, path: Path | None) -> Json:
    if path is None:
        raise FileFormatError("the picture of this camera is missing")
    return {"found": board.detect(read_picture(path))}


def _nothing(reason: str) -> Detection:
    """Return a detection of nothing."""
    return Detection(np.zeros((0, 2)), np.zeros((0, 3)), np.zeros(0, np.int64), (0, 0), reason)


# Calibration.


@dataclass(frozen=True)
class _Fit:
    """Cameras in the frame of the first, and the pose of the board in each view."""

    cameras: tuple[Camera, ...]
    poses: list[tuple[Floats, Floats]]
    lens: str  # "plain", "wide" or "fisheye"


def calibrate_cameras(
    views: Sequence[BoardView],
    board: Board,
    names: Sequence[str] = ("camera",),
    *,
    options: CalibrationOptions = CalibrationOptions(),
    progress: Progress = no_progress,
) -> CameraCalibration:
    """Calibrate one camera or two from views of a board.

    Parameters
    ----------
    views : sequence of BoardView
        As `detect_views` gives them.
    board : Board
    names : sequence of str
        Of the cameras, as many as a view has detections.
    options : CalibrationOptions
    progress : callable

    Returns
    -------
    CameraCalibration
        It is refused, with the reason, where corners cover too little of a picture, the board was
        never tilted, the residuals are too large, or the baseline is not the expected one.

    Raises
    ------
    InputError
        If fewer than 8 views can be used, or the view of the world is not among them.

    References
    ----------
    Z. Zhang, IEEE Trans. Pattern Analysis and Machine Intelligence 22 (2000) 1330-1334.
    """
    if any(len(view.detections) != len(names) for view in views):
        raise InputError(f"{len(names)} cameras are named: each view needs a detection for each")
    views = _choose(list(views), names)
    progress("calibrate", 0.0)
    views, fit = _fit_sound(views, options.lens)
    used = _list_used(views)
    world = _find_world(used, options.world)
    rng = np.random.default_rng(options.seed)
    drawn = []
    for k in range(options.resamples):
        progress("uncertainty", k / options.resamples)
        again = _fit([used[i] for i in _draw(rng, len(used))], fit.lens, start=fit)
        drawn.append(_place_world(again.cameras, _draw_corners(rng, world)))
    hold_out = _hold_out(used, options.lens)
    progress("uncertainty", 1.0)
    cameras = CameraSet(
        names=tuple(names),
        cameras=_place_world(fit.cameras, world),
        world=f"the board of view {world.name}",
        rms=_join([view.rms for view in used]),
        resamples=tuple(drawn),
        scale_uncertainty=board.scale_uncertainty,
        areas=tuple(_find_area(used, i) for i in range(len(names))),
    )
    coverage = tuple(_measure_coverage(used, i) for i in range(len(names)))
    pair = len(names) > 1
    spread = _spread([_measure_baseline(each) for each in drawn]) if pair else math.nan
    found = CameraCalibration(
        cameras=cameras,
        views=tuple(views),
        coverage=coverage,
        tilt=_measure_tilt(fit.poses),
        hold_out=hold_out,
        focal_uncertainty=tuple(
            _spread([each[i].focal for each in drawn]) for i in range(len(names))
        ),
        baseline_uncertainty=math.hypot(spread, board.scale_uncertainty * cameras.baseline),
        errors=_list_errors(fit, used),
        flags=_list_flags(views, board, hold_out, dict(zip(names, coverage, strict=True))),
    )
    return dataclasses.replace(found, reason=_find_fault(found, options))


def _fit_sound(views: list[BoardView], lens: str) -> tuple[list[BoardView], _Fit]:
    """Fit all views, once more without those that do not fit, and mark the views."""
    used = _list_used(views)
    fit = _fit(used, lens)
    rms = _list_rms(fit, used)
    limit = max(_OUTLIER * float(np.median(list(rms.values()))), MOST_RMS)
    wrong = {name: value for name, value in rms.items() if value > limit}
    if wrong and len(used) - len(wrong) >= LEAST_VIEWS:
        views = [
            dataclasses.replace(view, reason=f"residuals of {wrong[view.name]:.2f} px: left out")
            if view.name in wrong
            else view
            for view in views
        ]
        used = _list_used(views)
        fit = _fit(used, lens)
        rms = _list_rms(fit, used)
    return [dataclasses.replace(view, rms=rms.get(view.name, math.nan)) for view in views], fit


def _list_rms(fit: _Fit, used: Sequence[BoardView]) -> dict[str, float]:
    """Return the root mean square length of each view's residuals [px]."""
    return {
        view.name: _measure_rms(fit.cameras, view, pose)
        for view, pose in zip(used, fit.poses, strict=True)
    }


def _list_errors(fit: _Fit, used: Sequence[BoardView]) -> tuple[Floats, ...]:
    """Return the pixels and residuals (n, 4) of all corners of each camera."""
    tables: list[list[Floats]] = [[] for _ in fit.cameras]
    for view, pose in zip(used, fit.poses, strict=True):
        residuals = _list_residuals(fit.cameras, view, pose)
        for table, pixels, off in zip(tables, _share(view)[1], residuals, strict=True):
            table.append(np.hstack([pixels, off]))
    return tuple(np.concatenate(table) for table in tables)


def _choose(views: list[BoardView], names: Sequence[str]) -> list[BoardView]:
    """Return the views, those that cannot be used with the reason."""
    sizes: list[tuple[int, int]] = []
    for i in range(len(names)):
        seen = [view.detections[i].size for view in views if view.detections[i].found]
        sizes.append(max(set(seen), key=seen.count) if seen else (0, 0))
    chosen = []
    for view in views:
        reason = view.reason
        for name, found, size in zip(names, view.detections, sizes, strict=True):
            if reason:
                break
            if not found.found:
                reason = f"{name}: {found.reason}" if name else found.reason
            elif found.size != size:
                words = f"{found.size[0]} x {found.size[1]} px, others have {size[0]} x {size[1]}"
                reason = f"{name}: the picture has {words}"
        if not reason and len(_share_ids(view)) < _LEAST_CORNERS:
            reason = f"fewer than {_LEAST_CORNERS} corners of the board are seen"
        chosen.append(dataclasses.replace(view, reason=reason))
    count = len(_list_used(chosen))
    if count < LEAST_VIEWS:
        reasons = [f"view {view.name}: {view.reason}" for view in chosen if view.reason]
        raise InputError(
            f"{count} of {len(chosen)} views can be used, a calibration needs {LEAST_VIEWS}"
            + (f" ({reasons[0]})" if reasons else "")
        )
    return chosen


def _list_used(views: Sequence[BoardView]) -> list[BoardView]:
    return [view for view in views if not view.reason]


def _share_ids(view: BoardView) -> NDArray[np.int64]:
    """Return the numbers of the corners that all cameras see."""
    ids = view.detections[0].ids
    for found in view.detections[1:]:
        ids = np.intersect1d(ids, found.ids)
    return np.sort(ids)


def _share(view: BoardView) -> tuple[Floats, list[Floats]]:
    """Return the corners that all cameras see: on the board and in each picture."""
    ids = _share_ids(view)
    rows = []
    for found in view.detections:
        order = np.argsort(found.ids)
        rows.append(order[np.searchsorted(found.ids, ids, sorter=order)])
    first = view.detections[0]
    return first.points[rows[0]], [
        found.corners[row] for found, row in zip(view.detections, rows, strict=True)
    ]


def _fit(views: Sequence[BoardView], lens: str, start: _Fit | None = None) -> _Fit:
    """Fit lenses, the second camera's pose, and the board's pose in each view."""
    if lens == "fisheye":
        return _fit_fisheye(views, start)
    cv2 = import_opencv()
    shared = [_share(view) for view in views]
    points = [board.astype(np.float32) for board, _ in shared]
    seen = [
        [pixels[i].astype(np.float32) for _, pixels in shared]
        for i in range(len(views[0].detections))
    ]
    sizes = [found.size for found in views[0].detections]
    if start is None:
        lenses = [_fit_lens(points, *each) for each in zip(seen, sizes, strict=True)]
        reach = [
            np.linalg.norm(lens.undistort(np.concatenate(pixels)), axis=1).max()
            for lens, pixels in zip(lenses, seen, strict=True)
        ]
        lens = "wide" if max(reach) > _WIDE_FIELD else "plain"
    else:
        lenses = list(start.cameras)
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | (0 if lens == "wide" else cv2.CALIB_FIX_K3)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-8)
    guess = [item for one in lenses for item in (one.matrix.copy(), one.distortion.copy())]
    if len(lenses) == 1:
        _, matrix, terms, turns, shifts = cv2.calibrateCamera(
            points, seen[0], sizes[0], *guess, flags=flags, criteria=stop
        )
        cameras = [_make_camera(matrix, terms, sizes[0])]
    else:
        _, first, terms, second, terms_2, turn, shift, _, _, turns, shifts, _ = (
            cv2.stereoCalibrateExtended(
                *(points, *seen, *guess, sizes[0], np.eye(3), np.zeros(3)),
                flags=flags,
                criteria=stop,
            )
        )
        cameras = [
            _make_camera(first, terms, sizes[0]),
            _make_camera(second, terms_2, sizes[1]).place(
                nearest_rotation(np.asarray(turn)), np.ravel(shift)
            ),
        ]
    return _Fit(tuple(cameras), _list_poses(turns, shifts), lens)


def _fit_fisheye(views: Sequence[BoardView], start: _Fit | None) -> _Fit:
    """Do what `_fit` does, for fisheyes: each lens by itself, then a pair together."""
    cv2 = import_opencv()
    shared = [_share(view) for view in views]
    points = [board.reshape(1, -1, 3).astype(float) for board, _ in shared]
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-9)
    # OpenCV 4 has flags of its own for fisheyes, 5 has one set for all.
    names = cv2.fisheye if hasattr(cv2.fisheye, "CALIB_FIX_SKEW") else cv2
    flags = names.CALIB_FIX_SKEW | names.CALIB_RECOMPUTE_EXTRINSIC
    guess = np.zeros((3, 3)), np.zeros(FISHEYE_TERMS)
    cameras, poses = [], []
    for i, found in enumerate(views[0].detections):
        if start is not None:
            guess = start.cameras[i].matrix.copy(), start.cameras[i].distortion.copy()
            flags |= names.CALIB_USE_INTRINSIC_GUESS
        pixels = [each[i].reshape(1, -1, 2).astype(float) for _, each in shared]
        try:
            _, matrix, terms, turns, shifts = cv2.fisheye.calibrate(
                points, pixels, found.size, *guess, flags=flags, criteria=stop
            )
        except cv2.error as error:
            raise InputError(
                f"the views do not determine a fisheye ({error.err}): give more, tilted and spread "
                "over the picture, or the plain lens"
            ) from None
        own = Camera(matrix=np.asarray(matrix), distortion=np.ravel(terms), size=found.size)
        cameras.append(own)
        poses.append(_list_poses(turns, shifts))
    if len(cameras) == 1:
        return _Fit((cameras[0],), poses[0], "fisheye")
    return _join_fisheyes((cameras[0], cameras[1]), poses, shared)


def _join_fisheyes(
    cameras: tuple[Camera, Camera],
    poses: list[list[tuple[Floats, Floats]]],
    shared: list[tuple[Floats, list[Floats]]],
) -> _Fit:
    """Fit two fisheyes, their places and those of the board together, from each by itself."""
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    steps = [turn @ first.T for (first, _), (turn, _) in zip(*poses, strict=True)]
    turn = nearest_rotation(np.mean(steps, axis=0))
    moves = [there - turn @ here for (_, here), (_, there) in zip(*poses, strict=True)]
    places = [(turn, np.median(moves, axis=0)), *poses[0]]
    lenses = [
        [*camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], *camera.distortion] for camera in cameras
    ]
    rigid = [[*Rotation.from_matrix(turn).as_rotvec(), *shift] for turn, shift in places]
    view = np.repeat(np.arange(len(shared)), [len(board) for board, _ in shared])
    board = np.concatenate([board for board, _ in shared])
    pixels = [np.concatenate([each[i] for _, each in shared]) for i in range(2)]

    def place(values: Floats) -> tuple[list[Camera], Floats, Floats]:
        own, rest = values[:16].reshape(2, 8), values[16:].reshape(-1, 6)
        turns, shifts = Rotation.from_rotvec(rest[:, :3]).as_matrix(), rest[:, 3:]
        made = [
            dataclasses.replace(
                camera,
                matrix=np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]),
                distortion=np.array(terms),
            )
            for camera, (fx, fy, cx, cy, *terms) in zip(cameras, own, strict=True)
        ]
        return [made[0], made[1].place(turns[0], shifts[0])], turns[1:], shifts[1:]

    def miss(values: Floats) -> Floats:
        made, turns, shifts = place(values)
        world = np.einsum("nij,nj->ni", turns[view], board) + shifts[view]
        off = [camera.project(world) - seen for camera, seen in zip(made, pixels, strict=True)]
        return np.asarray(np.nan_to_num(np.concatenate(off).ravel(), nan=1e3))

    first = np.concatenate([np.ravel(lenses), np.ravel(rigid)])
    found = least_squares(miss, first, method="lm", x_scale="jac", xtol=1e-9)
    made, turns, shifts = place(found.x)
    return _Fit(tuple(made), list(zip(turns, shifts, strict=True)), "fisheye")


def _list_poses(
    turns: Sequence[ArrayLike], shifts: Sequence[ArrayLike]
) -> list[tuple[Floats, Floats]]:
    """Return the board's poses from the rotation vectors and translations of OpenCV."""
    cv2 = import_opencv()
    return [
        (np.asarray(cv2.Rodrigues(np.ravel(turn))[0]), np.ravel(shift))
        for turn, shift in zip(turns, shifts, strict=True)
    ]


def _fit_lens(points: list[Grey], pixels: list[Grey], size: tuple[int, int]) -> Camera:
    """Return a camera by itself, to start from."""
    cv2 = import_opencv()
    _, matrix, lens, *_ = cv2.calibrateCamera(
        points, pixels, size, None, None, flags=cv2.CALIB_FIX_K3
    )
    return _make_camera(matrix, lens, size)


def _make_camera(matrix: ArrayLike, lens: ArrayLike, size: tuple[int, int]) -> Camera:
    return Camera(matrix=np.asarray(matrix), distortion=np.ravel(lens)[:5], size=size)


def _list_residuals(
    cameras: Sequence[Camera], view: BoardView, pose: tuple[Floats, Floats]
) -> list[Floats]:
    """Return for each camera the residuals (n, 2) of a view [px]."""
    points, pixels = _share(view)
    turn, shift = pose
    placed = points @ turn.T + shift
    return [seen - camera.project(placed) for camera, seen in zip(cameras, pixels, strict=True)]


def _measure_rms(cameras: Sequence[Camera], view: BoardView, pose: tuple[Floats, Floats]) -> float:
    """Return the root mean square length of a view's residuals [px]."""
    residuals = np.concatenate(_list_residuals(cameras, view, pose))
    return math.sqrt(float(np.mean(np.sum(residuals**2, axis=1))))


def _find_pose(cameras: Sequence[Camera], view: BoardView) -> tuple[Floats, Floats]:
    """Return the pose of a board from all cameras, in the frame that the cameras are in."""
    points, pixels = _share(view)
    if len(cameras) > 1:
        return align(points, triangulate(cameras, np.stack(pixels)))
    cv2 = import_opencv()
    _, turn, shift = cv2.solvePnP(points, *prepare_pose(cameras[0], pixels[0]))
    return np.asarray(cv2.Rodrigues(turn)[0]), np.ravel(shift)


def _place_world(cameras: Sequence[Camera], view: BoardView) -> tuple[Camera, ...]:
    """Return the cameras in the frame of the board of a view."""
    pose = _find_pose(cameras, view)
    return tuple(camera.move_world(*pose) for camera in cameras)


def _find_world(views: Sequence[BoardView], name: str) -> BoardView:
    """Return the view whose board is the world."""
    for view in views:
        if name in ("", view.name):
            return view
    names = ", ".join(view.name for view in views)
    raise InputError(f"world is '{name}': it must be a view that is used, one of {names}")


def _draw(rng: np.random.Generator, count: int) -> list[int]:
    """Return a draw of views with replacement that has enough different ones."""
    while True:
        chosen = rng.integers(0, count, count).tolist()
        if len(set(chosen)) >= count // 2:
            return [int(k) for k in chosen]


def _draw_corners(rng: np.random.Generator, view: BoardView) -> BoardView:
    """Return a view with a draw of the corners that all cameras see, with replacement."""
    points, pixels = _share(view)
    rows = rng.integers(0, len(points), len(points))
    names = np.arange(len(points))
    return dataclasses.replace(
        view,
        detections=tuple(
            dataclasses.replace(found, corners=own[rows], points=points[rows], ids=names)
            for found, own in zip(view.detections, pixels, strict=True)
        ),
    )


def _hold_out(views: Sequence[BoardView], lens: str) -> HoldOut:
    """Calibrate from three quarters of the views and measure in the others."""
    out = list(views[::_HOLD_OUT_EVERY])
    kept = [view for view in views if view not in out]
    if len(kept) < LEAST_VIEWS:
        return HoldOut()
    cameras = _fit(kept, lens).cameras
    rms = [_measure_rms(cameras, view, _find_pose(cameras, view)) for view in out]
    if len(cameras) == 1:
        return HoldOut(len(out), _join(rms))
    errors = []
    for view in out:
        points, pixels = _share(view)
        found = triangulate(cameras, np.stack(pixels))
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
        near = (apart > 0.0) & (apart < 1.01 * apart[apart > 0.0].min())
        errors.append((np.linalg.norm(found[:, None] - found[None], axis=-1) - apart)[near])
    return HoldOut(len(out), _join(rms), _join(np.concatenate(errors)), _measure_baseline(cameras))


def _join(values: Sequence[float] | Floats) -> float:
    """Return the root mean square."""
    return math.sqrt(float(np.mean(np.square(values))))


def _spread(values: Sequence[float]) -> float:
    """Return the standard deviation, NaN of fewer than two."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else math.nan


def _measure_baseline(cameras: Sequence[Camera]) -> float:
    return float(np.linalg.norm(cameras[1].centre - cameras[0].centre))


def _measure_coverage(views: Sequence[BoardView], camera: int) -> float:
    """Return the share of a picture's cells in which a corner was seen."""
    corners = np.concatenate([view.detections[camera].corners for view in views])
    cells = np.floor((corners + 0.5) / views[0].detections[camera].size * _CELLS).astype(int)
    return len(np.unique(cells, axis=0)) / (_CELLS[0] * _CELLS[1])


def _find_area(views: Sequence[BoardView], camera: int) -> Area:
    """Return the least and greatest x and y of the corners in a camera's pictures [px]."""
    corners = np.concatenate([view.detections[camera].corners for view in views])
    left, top = corners.min(axis=0).tolist()
    right, foot = corners.max(axis=0).tolist()
    return left, top, right, foot


def _measure_tilt(poses: Sequence[tuple[Floats, Floats]]) -> float:
    """Return the angle between the two most different directions of the board [rad]."""
    normals = np.stack([turn[:, 2] for turn, _ in poses])
    return float(np.arccos(np.clip((normals @ normals.T).min(), -1.0, 1.0)))


def _list_flags(
    views: Sequence[BoardView], board: Board, hold_out: HoldOut, coverage: dict[str, float]
) -> tuple[str, ...]:
    """Return what should be known beside the figures."""
    flags = [
        f"corners cover {100 * covered:.0f} % of the picture of {name}: elsewhere the lens is "
        "extrapolated"
        for name, covered in coverage.items()
        if covered < GOOD_COVERAGE
    ]
    out = sum(bool(view.reason) for view in views)
    if out:
        flags.append(f"{out} of {len(views)} views are not used")
    if not hold_out.views:
        flags.append("too few views to hold some out")
    if board.check_line == CHECK_LINE:
        flags.append("the bar of 100 mm is exactly that: was it measured?")
    return tuple(flags)


def _find_fault(found: CameraCalibration, options: CalibrationOptions) -> str:
    """Return why a calibration is refused, or nothing."""
    names = found.cameras.names
    for name, covered in zip(names, found.coverage, strict=True):
        if covered < LEAST_COVERAGE:
            shown = show_apart(100 * covered, 100 * LEAST_COVERAGE, digits=0, form="f")
            return (
                f"corners cover {shown[0]} % of the picture of {name}: it must be {shown[1]} % or "
                "more"
            )
    if found.tilt < LEAST_TILT:
        angles = math.degrees(found.tilt), math.degrees(LEAST_TILT)
        shown = show_apart(*angles, digits=0, form="f")
        return f"the board was tilted by {shown[0]} degrees at most: it must be {shown[1]} or more"
    if found.residual > MOST_RMS:
        shown = show_apart(found.residual, MOST_RMS, digits=2, form="f")
        return f"residuals of {shown[0]} px rms: they must be {shown[1]} px or less"
    expected = options.baseline
    if expected and len(names) > 1:
        off = abs(found.cameras.baseline / expected - 1.0)
        if off > BASELINE_TOLERANCE:
            shown = show_apart(found.cameras.baseline, expected, digits=2, form="f")
            return (
                f"the cameras are {shown[0]} mm apart, {shown[1]} mm were "
                "expected: check the size of the board's squares"
            )
    return ""

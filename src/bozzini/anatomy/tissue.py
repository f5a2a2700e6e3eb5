"""How tissue moves: breathing, peristalsis, and displacements recorded on a grid.

Each motion states, at every time, how far a place at rest is displaced, and bounds of the
displacement's first and second derivatives in space that hold everywhere: where the first is below
1, the deformation is one to one. Figures of amplitude, speed and period are of living people:

- Brandner et al., Int. J. Radiat. Oncol. Biol. Phys. 65 (2006) 554: in 13 patients liver, spleen
  and kidneys move 11 to 13 mm along the body's axis in a breath.
- Seppenwoolde et al., Int. J. Radiat. Oncol. Biol. Phys. 53 (2002) 822: tumours in the lower lobes
  of the lungs move 12 mm along the body's axis in a breath, those in the upper lobes 2 mm.
- Lujan et al., Med. Phys. 26 (1999) 715: a breath in time as an even power of a cosine.
- Kwiatek et al., J. Magn. Reson. Imaging 24 (2006) 1101: contraction waves of the antrum of the
  stomach run at 2.7 mm/s, every 23 s, 7 mm deep, and close 58 % of the lumen's width.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_array, check_fields, check_points, quantity, show_apart
from ..errors import FileFormatError, InputError
from ..io.inputs import note_input
from ..numeric.arrays import Floats
from ..numeric.polylines import interpolate_polyline, measure_arc_length, resample_polyline
from ..results import Shown


@dataclass(frozen=True, kw_only=True, eq=False)
class TissueFrame(Shown):
    """A displacement of tissue at one time, and what bounds it.

    Parameters
    ----------
    move : callable
        Takes places at rest (n, 3) to their displacement (n, 3), world frame [mm].
    gradient_bound : float
        The largest singular value of the displacement's gradient anywhere.
    second_bound : float
        The largest second derivative along any line [1/mm].
    """

    move: Callable[[Floats], Floats]
    gradient_bound: float
    second_bound: float

    def __call__(self, points: ArrayLike) -> Floats:
        """Return the displacement (n, 3) of places at rest (n, 3) [mm]."""
        return self.move(np.asarray(points, dtype=np.float64))


class TissueMotion(Shown, ABC):
    """A motion of tissue that repeats.

    Attributes
    ----------
    period : float
        After which it repeats [s].
    speed : float
        No tissue is ever faster than this [mm/s].
    """

    period: float
    speed: float

    @abstractmethod
    def at(self, time: float) -> TissueFrame:
        """Return the displacement at a time [s]."""

    def check_reach(self, points: ArrayLike) -> None:  # noqa: B027
        """Raise `InputError` where it is not known how places (n, 3) at rest move [mm]."""


_X, _Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class Breathing(TissueMotion):
    """Breathing: a displacement along one direction that falls off along another.

    ``u = amplitude sin^2(pi t / period) cos(2 pi (along . x) / wavelength + phase) direction``

    Parameters
    ----------
    amplitude : float
        Largest displacement [mm]; 12 mm as organs below the diaphragm (Brandner et al. 2006).
    period : float
        Of a breath [s].
    wavelength : float
        Over which the displacement changes its sign twice [mm].
    phase : float
        [rad].
    direction, along : (3,) float
        World frame; scaled to length 1. By default both are the body's axis z.

    Raises
    ------
    InputError
        If a number is out of range, or the displacement is not one to one.
    """

    amplitude: float = quantity(
        "length", "Largest displacement.", low=0.0, high=100.0, default=12.0
    )
    period: float = quantity("time", "Of a breath.", low=0.1, high=1000.0, default=4.0)
    wavelength: float = quantity("length", "Of the wave.", low=1.0, high=1e6, default=800.0)
    phase: float = quantity("angle", "Of the wave.", low=-100.0, high=100.0, default=0.0)
    direction: tuple[float, float, float] = _Z
    along: tuple[float, float, float] = _Z

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("direction", "along"):
            object.__setattr__(self, name, _unit(name, getattr(self, name)))
        steep = self.amplitude * 2.0 * math.pi / self.wavelength
        if steep >= 1.0:
            shown = show_apart(self.amplitude, self.wavelength / (2.0 * math.pi), digits=3)
            raise InputError(
                f"amplitude is {shown[0]} mm: it must be below "
                f"{shown[1]} mm, the wavelength over 2 pi, or the "
                "tissue folds"
            )

    @classmethod
    def of_organ(cls, organ: str | None, ends: tuple[float, float], **given: float) -> Breathing:
        """Return how an organ breathes.

        Airways do not move at the trachea's upper end, and most at the lungs' base: a quarter of a
        wave lies between. Other organs move as by default.

        Parameters
        ----------
        organ : str or None
        ends : pair of float
            The lowest and the highest z of the organ, world frame [mm].
        **given
            Amplitude, wavelength and period, where they are known.
        """
        if organ == "airway" and "wavelength" not in given:
            low, high = ends
            wavelength = 4.0 * (high - low)
            given = {"wavelength": wavelength, "phase": -2.0 * math.pi * low / wavelength, **given}
        return cls(**given)  # type: ignore[arg-type]

    @property
    def speed(self) -> float:  # type: ignore[override]
        """No tissue is ever faster than this [mm/s]."""
        return self.amplitude * math.pi / self.period

    def at(self, time: float) -> TissueFrame:
        """Return the displacement at a time [s]."""
        depth = self.amplitude * math.sin(math.pi * time / self.period) ** 2
        wave = 2.0 * math.pi / self.wavelength
        direction, along = np.array(self.direction), wave * np.array(self.along)

        def move(points: Floats) -> Floats:
            wave_height = depth * np.cos(points @ along + self.phase)
            return np.asarray(wave_height[:, None] * direction)

        return TissueFrame(move=move, gradient_bound=depth * wave, second_bound=depth * wave * wave)


RAMP = 0.1
"""Share of the way over which a wave of peristalsis begins, and ends."""

SECOND = 1.3803
"""Largest second derivative of ``w exp(-|w|^2 / 2)``: of its third Hermite function."""

SMOOTHING_MM = 5.0
"""The line that a wave follows is smoothed over this [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Peristalsis(TissueMotion):
    """Peristalsis: a ring of contraction that runs along a line.

    Around its middle c with the line's direction a, ``u = -depth exp(-|z|^2 / 2 width^2) z'`` with
    z = x - c and z' its part across a: the ring's middle loses the share `depth` of its width.

    Parameters
    ----------
    line : (n, 3) float
        The way of the ring, world frame [mm]: the tract's centreline.
    depth : float
        Share of the lumen's width that is closed, below 1; 0.58 (Kwiatek et al. 2006).
    width : float
        Standard deviation of the ring along the line [mm].
    wave_speed : float
        [mm/s]; 2.7 mm/s (Kwiatek et al. 2006).

    Raises
    ------
    InputError
        If a number is out of range, or the line is none.
    """

    line: Floats
    depth: float = quantity(help="Share of the width closed.", low=0.0, high=0.95, default=0.58)
    width: float = quantity("length", "Of the ring.", low=1.0, high=200.0, default=12.0)
    wave_speed: float = quantity("speed", "Of the ring.", low=1e-3, high=1e3, default=2.7)

    def __post_init__(self) -> None:
        check_fields(self)
        points = check_points("line", self.line)
        if points.ndim != 2 or len(points) < 2 or measure_arc_length(points)[-1] < 5.0:
            raise InputError(
                f"line has shape {points.shape}: it must be (n, 3), at least 5 mm long"
            )
        object.__setattr__(self, "line", points)

    @cached_property
    def _way(self) -> tuple[Floats, Floats, Floats, float]:
        """The smoothed line, its arc length, its directions, and how fast these turn [1/mm]."""
        from scipy.ndimage import gaussian_filter1d

        points = resample_polyline(self.line, 1.0)
        points = gaussian_filter1d(points, SMOOTHING_MM, axis=0, mode="nearest")
        points = resample_polyline(points, 1.0)
        arc = measure_arc_length(points)
        along = np.gradient(points, arc, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        turn = np.linalg.norm(np.diff(along, axis=0), axis=1) / np.diff(arc)
        return points, arc, along, float(turn.max(initial=0.0))

    @property
    def period(self) -> float:  # type: ignore[override]
        """After which the ring starts again [s]."""
        return float(self._way[1][-1]) / self.wave_speed

    @property
    def speed(self) -> float:  # type: ignore[override]
        """No tissue is ever faster than this [mm/s]."""
        # |z exp(-|z|^2 / 2 w^2)| <= w exp(-1/2); between two points the direction is interpolated,
        # then scaled to length 1, which turns it by at most 1.05 times as much as tabulated.
        most = self.width * math.exp(-0.5)
        ramp = 0.5 * math.pi / (RAMP * self.period)
        return self.depth * (self.wave_speed * (1.0 + 1.05 * self._way[3] * most) + ramp * most)

    def at(self, time: float) -> TissueFrame:
        """Return the displacement at a time [s]."""
        points, arc, along, _ = self._way
        share = (time / self.period) % 1.0
        place = np.array([share * arc[-1]])
        middle = interpolate_polyline(points, arc, place)[0]
        axis = interpolate_polyline(along, arc, place)[0]
        axis /= np.linalg.norm(axis)
        edge = min(1.0, min(share, 1.0 - share) / RAMP)
        depth = self.depth * 0.5 * (1.0 - math.cos(math.pi * edge))
        scale = -0.5 / self.width**2

        def move(rest: Floats) -> Floats:
            away = rest - middle
            ring = -depth * np.exp(scale * np.einsum("ij,ij->i", away, away))
            return np.asarray(ring[:, None] * (away - (away @ axis)[:, None] * axis))

        return TissueFrame(
            move=move, gradient_bound=depth, second_bound=SECOND * depth / self.width
        )


PAD = 6
"""So many nodes a grid is continued by its last value before it is turned into splines."""

CLOSED_MM = 0.01
"""The first and the last grid of a cycle agree within this [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedMotion(TissueMotion):
    """Displacements on a grid, such as a registration gives.

    They are cubic splines in space, and linear in time. Beyond the grid the displacement is that at
    its border.

    Parameters
    ----------
    displacement : (k, nx, ny, nz, 3) float
        At the nodes of the grid, of places at rest, world frame [mm]. The last is the first again,
        within 0.01 mm, and is taken to be equal to it.
    times : (k,) float
        Rising, from 0 [s].
    origin : (3,) float
        World position of the first node [mm].
    spacing : (3,) float
        Distance between nodes along x, y and z [mm].

    Raises
    ------
    InputError
        If arrays do not agree, the cycle is not closed, or the tissue may fold.
    """

    displacement: Floats = field(repr=False)
    times: Floats
    origin: Floats
    spacing: Floats

    def __post_init__(self) -> None:
        grids = check_array("displacement", self.displacement)
        times = check_array("times", self.times)
        if grids.ndim != 5 or grids.shape[-1] != 3 or min(grids.shape[:4]) < 2:
            raise InputError(
                f"displacement has shape {grids.shape}: it must be (k, nx, ny, nz, 3), k and each "
                "side at least 2"
            )
        if not np.isfinite(grids).all():
            raise InputError("displacement is not finite everywhere")
        if times.shape != grids.shape[:1]:
            raise InputError(f"times has shape {times.shape}: it must be ({len(grids)},)")
        if times[0] != 0.0 or not (np.diff(times) > 0.0).all() or not np.isfinite(times[-1]):
            raise InputError(f"times is {times} s: it must rise from 0 s")
        for name in ("origin", "spacing"):
            value = check_array(name, getattr(self, name))
            if value.shape != (3,) or not np.isfinite(value).all():
                raise InputError(f"{name} has shape {value.shape}: it must be 3 lengths [mm]")
            object.__setattr__(self, name, value)
        if not self.spacing.min() > 0.0:
            raise InputError(f"spacing is {self.spacing} mm: it must be above 0 mm")
        gap = float(np.abs(grids[-1] - grids[0]).max())
        if gap > CLOSED_MM:
            shown = show_apart(gap, CLOSED_MM)
            raise InputError(
                f"the last displacement is up to {shown[0]} mm from the first: they must agree "
                f"within {shown[1]} mm, because the motion repeats"
            )
        # Exactly, so that nothing jumps where the motion begins anew.
        object.__setattr__(self, "displacement", np.concatenate([grids[:-1], grids[:1]]))
        object.__setattr__(self, "times", times)
        steep = self._splines[1][:, 0]
        if steep.max() >= 1.0:
            raise InputError(
                f"displacement changes by up to {steep.max():.3g} mm per mm at "
                f"{times[np.argmax(steep)]:.3g} s: it must be below 1, or the tissue may fold; are "
                "displacement, origin and spacing all in mm?"
            )

    @classmethod
    def load(cls, path: str | Path) -> RecordedMotion:
        """Read an ``.npz`` file of arrays ``displacement``, ``times``, ``origin``, ``spacing``.

        Raises
        ------
        FileFormatError
            If it is none.
        """
        names = ("displacement", "times", "origin", "spacing")
        note_input(path)
        try:
            with np.load(path, allow_pickle=False) as archive:
                given = {name: archive[name] for name in names}
        except FileNotFoundError:
            raise FileFormatError(f"no such file: {path}") from None
        except Exception as error:
            raise FileFormatError(
                f"{path} is no motion of tissue: it must be an .npz file of {', '.join(names)} "
                f"({type(error).__name__})"
            ) from None
        try:
            return cls(**given)
        except InputError as error:
            raise FileFormatError(f"{path}: {error}") from None

    @cached_property
    def _splines(self) -> tuple[Floats, Floats]:
        """Coefficients (k, ..., 3) of all times, and bounds (k, 2) of the derivatives."""
        from scipy.ndimage import spline_filter1d

        pad = [(0, 0), *[(PAD, PAD)] * 3, (0, 0)]
        coefficients = np.pad(self.displacement, pad, mode="edge")
        for axis in (1, 2, 3):
            coefficients = spline_filter1d(coefficients, 3, axis=axis, mode="mirror")
        return coefficients, np.array([_bound_splines(one, self.spacing) for one in coefficients])

    def check_reach(self, points: ArrayLike) -> None:
        """Raise `InputError` where places (n, 3) at rest are a cell or more beyond the grid."""
        places = check_points("points", points)
        low = self.origin - self.spacing
        high = self.origin + self.spacing * self.displacement.shape[1:4]
        beyond = np.flatnonzero(((places < low) | (places > high)).any(axis=1))
        if len(beyond):
            ends = low + self.spacing, high - self.spacing
            raise InputError(
                f"the grid of displacements reaches from {_name(ends[0])} to {_name(ends[1])} mm, "
                f"the way leads to {_name(places[beyond[0]])} mm: it must be inside; are origin "
                "and spacing in mm, in the tract's frame?"
            )

    @property
    def period(self) -> float:  # type: ignore[override]
        """After which it repeats [s]."""
        return float(self.times[-1])

    @cached_property
    def speed(self) -> float:  # type: ignore[override]
        """No tissue is ever faster than this [mm/s]."""
        moves = np.linalg.norm(np.diff(self._splines[0], axis=0), axis=-1).max(axis=(1, 2, 3))
        return float((moves / np.diff(self.times)).max())

    def at(self, time: float) -> TissueFrame:
        """Return the displacement at a time [s]."""
        within = time % self.period
        first = min(int(np.searchsorted(self.times, within, "right")) - 1, len(self.times) - 2)
        share = (within - self.times[first]) / (self.times[first + 1] - self.times[first])
        coefficients, bounds = self._splines
        now = (1.0 - share) * coefficients[first] + share * coefficients[first + 1]
        gradient, second = (1.0 - share) * bounds[first] + share * bounds[first + 1]
        return TissueFrame(
            move=lambda points: self._evaluate(now, points),
            gradient_bound=float(gradient),
            second_bound=float(second),
        )

    def _evaluate(self, coefficients: Floats, points: Floats) -> Floats:
        from .kernels.splines import evaluate_spline

        result = np.empty((len(points), 3))
        low = self.origin - PAD * self.spacing
        evaluate_spline(coefficients, low, self.spacing, np.ascontiguousarray(points), result)
        return result


def _bound_splines(coefficients: Floats, spacing: Floats) -> tuple[float, float]:
    """Bound gradient and second derivative: both are means of differences of coefficients."""
    first = [np.diff(coefficients, axis=a) / spacing[a] for a in range(3)]
    size = [float(np.linalg.norm(each, axis=-1).max()) for each in first]
    second = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            turn = np.linalg.norm(np.diff(first[a], axis=b), axis=-1) / spacing[b]
            second[a, b] = float(turn.max(initial=0.0))
    return math.hypot(*size), float(np.linalg.eigvalsh(second).max())


def _name(place: Floats) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in place) + ")"


def _unit(name: str, vector: ArrayLike) -> tuple[float, float, float]:
    given = check_array(name, vector)
    size = float(np.linalg.norm(given)) if given.shape == (3,) else 0.0
    if not (math.isfinite(size) and size > 0.0):
        raise InputError(f"{name} is {given.tolist()}: it must be a direction (3,)")
    x, y, z = (float(value) / size for value in given)
    return x, y, z

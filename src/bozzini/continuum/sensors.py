"""What is sensed of a robot: places, poses, curvatures, strains of fibres, tensions, sights."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from ..checks import check_fields, quantity
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Shown
from .checks import check_name, check_values
from .observation import solve_screw

NEAREST = 1e-6
"""Least noise of a sight across its ray, of a point at the camera [mm]."""


class Sensed(NamedTuple):
    """The body where a sensor sits, in the world, and its derivatives by the state (q).

    Attributes
    ----------
    place : (3,) ndarray
        [mm].
    rotation : (3, 3) ndarray
        Axes of the cross-section.
    moved : (6, q) ndarray
        Rotation [rad] and motion [mm].
    curvature : (3,) ndarray
        About the axes of the cross-section [1/mm].
    curved : (3, q) ndarray
        Its derivative.
    tensions : (t,) ndarray
        Of the tendons [N].
    pulled : (t, q) ndarray
        Their derivative.
    names : tuple of str
        Of the tendons.
    """

    place: Floats
    rotation: Floats
    moved: Floats
    curvature: Floats
    curved: Floats
    tensions: Floats
    pulled: Floats
    names: tuple[str, ...]


class Miss(NamedTuple):
    """A reading less what is predicted, the derivative of the prediction, and the noise.

    Attributes
    ----------
    values : (k,) ndarray
    slopes : (k, q) ndarray
    deviations : (k,) ndarray
    """

    values: Floats
    slopes: Floats
    deviations: Floats


@dataclass(frozen=True, kw_only=True)
class BodySensor(Shown, ABC):
    """A sensor at a place of the body.

    Parameters
    ----------
    name : str
        By which its readings are given.
    arc_length : float, optional
        Where it sits [mm]; at the tip unless given.
    bias : float
        Standard deviation of a constant error, one for all its numbers, in their unit, such as of
        the temperature of a grating.
    """

    name: str
    arc_length: float | None = quantity("length", "Where it sits.", low=0.0, default=None)
    bias: float = quantity(help="Standard deviation of a constant error.", low=0.0, default=0.0)

    count: ClassVar[int]
    """Numbers of a reading."""
    unit: ClassVar[str]
    """Of a constant error."""
    may_err: ClassVar[bool] = True
    """Whether it can have one."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", check_name("sensor", self.name))
        skip = () if self.arc_length is not None else ("arc_length",)
        check_fields(self, f"sensor '{self.name}' ", skip=(*skip, "offset"))
        if self.bias and not self.may_err:
            raise InputError(f"sensor '{self.name}' bias is {self.bias:g}: such a sensor has none")
        own = getattr(self, "offset", None)
        if own is not None:
            check_values(f"sensor '{self.name}' offset", own, (len(type(self).offset),))  # type: ignore[attr-defined]

    @property
    def at(self) -> tuple[float, float, float]:
        """Its place in the frame of the cross-section [mm]."""
        return (0.0, 0.0, 0.0)

    def predict(self, seen: Sensed) -> Floats:
        """Return what it reads without noise, (count,).

        Raises
        ------
        InputError
            If that depends on more than the body.
        """
        raise InputError(f"what '{self.name}' reads depends on where the camera is")

    def has_reading(self, reading: Floats) -> bool:
        """Whether there is a number in a reading (count,), in which NaN stands for none."""
        return bool(np.isfinite(reading).any())

    @abstractmethod
    def compare(self, reading: Floats, seen: Sensed) -> Miss:
        """Return what a reading (count,) misses of what the body predicts."""


@dataclass(frozen=True, kw_only=True)
class PlaceSensor(BodySensor):
    """A point that is tracked: its place in the world [mm].

    Parameters
    ----------
    offset : (x, y, z)
        Where it is in the frame of the cross-section [mm].
    deviation : float
        Standard deviation of each coordinate [mm].
    """

    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    deviation: float = quantity("length", "Noise.", low=0.0, low_open=True, default=0.5)

    count = 3
    unit = "mm"

    @property
    def at(self) -> tuple[float, float, float]:
        """Its place in the frame of the cross-section [mm]."""
        return self.offset

    def predict(self, seen: Sensed) -> Floats:
        """Return the place."""
        return seen.place

    def compare(self, reading: Floats, seen: Sensed) -> Miss:
        """Return the miss of a place (3,)."""
        return Miss(reading - seen.place, seen.moved[3:], np.full(3, self.deviation))


@dataclass(frozen=True, kw_only=True)
class PoseSensor(PlaceSensor):
    """A tracked pose: place [mm] and rotation vector [rad], in the world.

    Parameters
    ----------
    rotation_deviation : float
        Standard deviation of the rotation about each axis [rad].
    """

    rotation_deviation: float = quantity("angle", "Noise.", low=0.0, low_open=True, default=0.01)

    count = 6
    may_err = False

    def predict(self, seen: Sensed) -> Floats:
        """Return place and rotation vector."""
        from scipy.spatial.transform import Rotation

        return np.append(seen.place, Rotation.from_matrix(seen.rotation).as_rotvec())

    def compare(self, reading: Floats, seen: Sensed) -> Miss:
        """Return the miss of a pose (6,)."""
        from scipy.spatial.transform import Rotation

        if np.isfinite(reading[3:]).all():
            turned = Rotation.from_rotvec(reading[3:]) * Rotation.from_matrix(seen.rotation).inv()
            turn = turned.as_rotvec()
        else:  # a tracker that has lost it
            return Miss(
                np.append(reading[:3] - seen.place, np.full(3, np.nan)),
                np.concatenate([seen.moved[3:], seen.moved[:3]]),
                np.full(6, self.deviation),
            )
        values = np.concatenate([reading[:3] - seen.place, turn])
        slopes = np.concatenate([seen.moved[3:], solve_screw(-turn, seen.moved[:3].T).T])
        noise = np.repeat([self.deviation, self.rotation_deviation], 3)
        return Miss(values, slopes, noise)


@dataclass(frozen=True, kw_only=True)
class SightSensor(PlaceSensor):
    """A point seen by a camera: its centre [mm] and the direction of the ray, in the world.

    `bozzini.vision.Camera` has both as ``centre`` and ``rays(pixels)``.

    Parameters
    ----------
    angle : float
        Standard deviation of the direction [rad]: that of the pixel over the focal length.
    """

    angle: float = quantity("angle", "Noise.", low=0.0, low_open=True, default=1e-3)

    count = 6
    may_err = False

    def has_reading(self, reading: Floats) -> bool:
        """Whether all six numbers are there."""
        return bool(np.isfinite(reading).all())

    def predict(self, seen: Sensed) -> Floats:
        """Refuse: the centre of the camera is part of the reading."""
        return BodySensor.predict(self, seen)

    def compare(self, reading: Floats, seen: Sensed) -> Miss:
        """Return how far a point is beside a ray (6,), across it.

        Raises
        ------
        InputError
            If the ray has no direction.
        """
        if not np.any(reading[3:]):
            raise InputError(f"reading of '{self.name}' has a ray without a direction")
        way = reading[3:] / np.linalg.norm(reading[3:])
        across = np.linalg.svd(way[None])[2][1:]
        off = seen.place - reading[:3]
        noise = np.full(2, max(self.angle * abs(float(way @ off)), NEAREST))
        return Miss(-across @ off, across @ seen.moved[3:], noise)


@dataclass(frozen=True, kw_only=True)
class CurvatureSensor(BodySensor):
    """Fibre gratings in several cores: the curvature about x and y of the cross-section [1/mm].

    Parameters
    ----------
    deviation : float
        Standard deviation of each [1/mm].
    share : float
        Standard deviation of a part of it that grows with the curvature, as a share.
    """

    deviation: float = quantity("curvature", "Noise.", low=0.0, low_open=True, default=1e-5)
    share: float = quantity(help="Noise by what is read.", low=0.0, default=0.0)

    count = 2
    unit = "1/mm"

    def predict(self, seen: Sensed) -> Floats:
        """Return the curvature."""
        return seen.curvature[:2]

    def compare(self, reading: Floats, seen: Sensed) -> Miss:
        """Return the miss of a curvature (2,)."""
        noise = np.hypot(self.deviation, self.share * np.hypot(*reading))
        return Miss(reading - seen.curvature[:2], seen.curved[:2], np.full(2, noise))


@dataclass(frozen=True, kw_only=True)
class StrainSensor(BodySensor):
    """A fibre grating beside the backbone: its strain.

    Parameters
    ----------
    offset : (x, y)
        Where the fibre passes the cross-section [mm].
    deviation : float
        Standard deviation.
    """

    offset: tuple[float, float] = (1.0, 0.0)
    deviation: float = quantity(help="Noise.", low=0.0, low_open=True, default=1e-6)

    count = 1
    unit = ""

    @property
    def lever(self) -> Floats:
        """Strain by curvature, (1, 3) [mm]."""
        return np.array([[self.offset[1], -self.offset[0], 0.0]])

    def predict(self, seen: Sensed) -> Floats:
        """Return the strain."""
        return np.asarray(self.lever @ seen.curvature)

    def compare(self, reading: Floats, seen: Sensed) -> Miss:
        """Return the miss of a strain (1,)."""
        values = reading - self.predict(seen)
        return Miss(values, self.lever @ seen.curved, np.array([self.deviation]))


@dataclass(frozen=True, kw_only=True)
class TensionSensor(BodySensor):
    """A load cell of the tendon of its name [N].

    Parameters
    ----------
    deviation : float
        Standard deviation [N].
    """

    deviation: float = quantity("force", "Noise.", low=0.0, low_open=True, default=0.1)

    count = 1
    unit = "N"

    def predict(self, seen: Sensed) -> Floats:
        """Return the tension."""
        return seen.tensions[[seen.names.index(self.name)]]

    def compare(self, reading: Floats, seen: Sensed) -> Miss:
        """Return the miss of a tension (1,)."""
        one = [seen.names.index(self.name)]
        noise = np.array([self.deviation])
        return Miss(reading - seen.tensions[one], seen.pulled[one], noise)

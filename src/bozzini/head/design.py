"""What a distal head is made of: camera on its arm, end cap, end-effectors with instruments.

The thesis draws it as a concept (Fig. 4.1). Printed are the end-effector's sizes, a forceps of
2.5 mm that reaches 20 mm out, a depth of view of 0 to 90 mm, and scopes of 9 to 12 mm. The sizes of
camera, arm and cap are ours.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_fields, check_integer, check_kind, check_points, quantity
from ..effector import EFFECTOR_PRESETS, Effector
from ..effector.design import DEFAULT_PRESET
from ..effector.inverse import EffectorInverse, solve_inverse
from ..effector.linkage import find_peak
from ..effector.section import shape_sections
from ..effector.study import change_design
from ..errors import InputError
from ..io.records import load_record, save_record
from ..numeric.arrays import Floats
from ..results import Shown
from ..vision.camera import Camera, aim_camera

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .shape import HeadPose

FITS = ("separate", "integrated", "none")
"""How an instrument is in the bore: as it is; without its coil, for which the section's stands; not
at all."""

_SPOTS = 8  # arc lengths of a section at which its body is looked at
_TABLE = 200  # deflections from which one of the tip is found


@dataclass(frozen=True, kw_only=True)
class Instrument:
    """A catheter or forceps through the bore of an end-effector: an elastic rod, free to slide.

    Beyond the holder it goes straight on, as it is free there. The thesis prints no rigidity.

    Parameters
    ----------
    fit : {"separate", "integrated", "none"}
        Separate: all of its rigidity adds to the section's. Integrated: only that of its cables
        does. None: there is no instrument.
    diameter, out : float
        Its diameter, and how far it reaches beyond the holder [mm].
    rigidity : float
        ``EI`` [N mm^2]. The default is that of a forceps with which `measured` comes to 22.4 mm at
        the holder's end at 827 kPa (Fig. 4.15): a fit to one number, not a measurement.
    core_rigidity : float
        ``EI`` of its cables alone [N mm^2]: by default two of 49 steel wires of 0.05 mm that slide.

    Raises
    ------
    InputError
        If a value is not legal.
    """

    fit: str = quantity("text", "How it is in the bore.", default="separate", words=FITS)
    diameter: float = quantity("length", "Diameter.", default=2.5, low=1e-3, high=100.0)
    out: float = quantity("length", "Reach beyond the holder.", default=20.0, low=0.0, high=1000.0)
    rigidity: float = quantity("rigidity", "Flexural rigidity.", default=323.0, low=0.0, high=1e9)
    core_rigidity: float = quantity("rigidity", "Of its cables.", default=6.0, low=0.0, high=1e9)

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def added_rigidity(self) -> float:
        """What it adds to the section's ``EI`` [N mm^2]."""
        return {"separate": self.rigidity, "integrated": self.core_rigidity, "none": 0.0}[self.fit]

    @property
    def reach(self) -> float:
        """How far there is something beyond the holder [mm]."""
        return 0.0 if self.fit == "none" else self.out


@dataclass(frozen=True, kw_only=True, eq=False)
class SectionPoses(Shown):
    """Poses (n) of one end-effector with its instrument, in the head's frame [mm].

    Attributes
    ----------
    bends : (n, 2) float
        Lateral places of the backbone's end in the section's own frame.
    body : (n, k, 3) float
        Line of the section from its base to the end of the holder.
    direction : (n, 3) float
        Unit vectors in which holder and instrument go on.
    tip : (n, 3) float
        The instrument's tip.
    """

    bends: Floats
    body: Floats
    direction: Floats
    tip: Floats

    @property
    def holder_tip(self) -> Floats:
        """End of the holder (n, 3)."""
        return self.body[:, -1]


@dataclass(frozen=True, kw_only=True)
class PlacedEffector(Shown):
    """An end-effector in a head, with its instrument.

    Parameters
    ----------
    preset : str
        A name of `bozzini.effector.EFFECTOR_PRESETS`.
    changes : mapping of str to float
        What is changed in it, as `bozzini.effector.change_design` takes it: ``length``, ``offset``,
        ``muscle.outer_radius`` and the like, in Bozzini's units.
    x, y : float
        Where its axis stands in the head's face [mm].
    turn : float
        By how much it is turned about its axis [rad]. By default the largest gap between the
        thesis's muscles, where it reaches least, faces the camera's arm.
    instrument : Instrument

    Raises
    ------
    InputError
        If a value is not legal, or the end-effector cannot be built.
    """

    preset: str = quantity(
        "text", "The end-effector.", default=DEFAULT_PRESET, words=tuple(EFFECTOR_PRESETS)
    )
    changes: Mapping[str, float] = field(default_factory=dict)
    x: float = quantity("length", "Place in the face.", default=0.0, low=-1e3, high=1e3)
    y: float = quantity("length", "Place in the face.", default=-0.9, low=-1e3, high=1e3)
    turn: float = quantity("angle", "Turn.", default=math.radians(-57.0), low=-7.0, high=7.0)
    instrument: Instrument = field(default_factory=Instrument)

    def __post_init__(self) -> None:
        check_fields(self)
        check_kind("instrument", self.instrument, Instrument)
        bore = self.effector.design.bore_diameter  # which builds it, too
        if self.instrument.reach and self.instrument.diameter > bore:
            raise InputError(
                f"instrument diameter is {self.instrument.diameter:g} mm: it must be at most "
                f"{bore:g} mm, the bore of the end-effector"
            )

    @cached_property
    def effector(self) -> Effector:
        """The end-effector, its section as rigid as with the instrument in it."""
        known = Effector.from_preset(self.preset)
        design = change_design(known.design, self.changes)
        stiff = design.catheter_rigidity + self.instrument.added_rigidity
        return replace(known, design=design.replace(catheter_rigidity=stiff))

    @property
    def radius(self) -> float:
        """Of all round its axis: holder, and muscles at rest beside it [mm]."""
        design = self.effector.design
        outer = max(placed.muscle.braid_radius for placed in design.muscles)
        return max(0.5 * design.holder_diameter, design.offset + outer)

    @property
    def length(self) -> float:
        """From the base to the end of the holder [mm]."""
        return self.effector.design.backbone_length + self.effector.design.holder_length

    @property
    def place(self) -> Floats:
        """Its base in the head's frame (3,) [mm]."""
        return np.array([self.x, self.y, 0.0])

    def to_head(self, vectors: Floats) -> Floats:
        """Turn vectors (..., 3) of the section's own frame into the head's."""
        cosine, sine = math.cos(self.turn), math.sin(self.turn)
        turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(vectors @ turn)

    def shape(self, bends: Floats) -> SectionPoses:
        """Return the poses of deflections (n, 2) of the backbone's end [mm], unchecked."""
        bends = np.ascontiguousarray(bends, dtype=np.float64)
        length = self.effector.design.backbone_length
        arcs = np.append(np.linspace(0.0, length, _SPOTS), self.length)
        found = shape_sections(self.effector, bends, arcs)
        body = self.to_head(found.points) + self.place
        ways = self.to_head(found.direction)
        tip = body[:, -1] + self.instrument.reach * ways
        return SectionPoses(bends=bends, body=body, direction=ways, tip=tip)

    def list_bends(self, samples: int) -> Floats:
        """Return about so many deflections (n, 2) that cover all it can do: a square grid [mm]."""
        return self.effector.workspace(directions=60, samples=samples).interior

    def inverse(self, place: ArrayLike) -> EffectorInverse:
        """Return the pressures for lateral places (..., 2) of the instrument's tip [mm].

        The places are in the head's frame. Beyond what it reaches, the answer is the last place in
        that direction, and says so; see `bozzini.effector.Effector.inverse`.

        Raises
        ------
        InputError
            If the places are not finite or not (..., 2).
        """
        wanted = check_points("place", place, dim=2) - self.place[:2]
        back = np.concatenate([wanted, np.zeros((*wanted.shape[:-1], 1))], axis=-1)
        cosine, sine = math.cos(self.turn), math.sin(self.turn)
        back = back @ np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        size = np.hypot(back[..., 0], back[..., 1])
        peak = find_peak(self.effector.design).lateral
        steps = np.linspace(0.0, peak, _TABLE)
        tips = self.shape(np.stack([steps, 0.0 * steps], axis=-1)).tip - self.place
        radii = np.hypot(tips[:, 0], tips[:, 1])
        last = int(np.argmax(radii)) + 1  # beyond, an end that turns back comes nearer again
        beyond = steps[last - 1] + np.maximum(size - radii[last - 1], 0.0)
        bend = np.where(size > radii[last - 1], beyond, np.interp(size, radii[:last], steps[:last]))
        share = np.where(size > 0.0, bend / np.where(size > 0.0, size, 1.0), 0.0)
        return solve_inverse(self.effector, share[..., None] * back[..., :2])

    def deflect(self, poses: SectionPoses, force: ArrayLike) -> Floats:
        """Return by how much a force at the instrument's tip moves that, (n, 3) [mm].

        Section and instrument give way as an elastic line with the muscles' pulls kept; the holder
        is rigid. It is of first order, for small deflections; twist and stretch are left out.

        Parameters
        ----------
        poses : SectionPoses
        force : array_like, shape (3,)
            In the head's frame [N].

        Raises
        ------
        InputError
            If the force is not three finite numbers, or there is an instrument without rigidity.
        """
        load = check_points("force", force)
        if load.shape != (3,):
            raise InputError(f"force has shape {load.shape}: it must be (3,)")
        tool = self.instrument
        if tool.reach and not tool.rigidity:
            raise InputError("instrument rigidity is 0 N mm^2: a force needs more than that")
        fine = np.linspace(0.0, self.effector.design.backbone_length, 16 * _SPOTS)
        shaped = shape_sections(self.effector, poses.bends, fine)
        line = self.to_head(shaped.points) + self.place
        moved = _bend_line(line, poses.tip, load, self.effector.design.rigidity)
        if tool.reach:
            out = np.linspace(0.0, tool.reach, 16 * _SPOTS)[:, None]
            line = poses.holder_tip[:, None] + out * poses.direction[:, None]
            moved = moved + _bend_line(line, poses.tip, load, tool.rigidity)
        return moved


def _bend_line(line: Floats, tip: Floats, force: Floats, rigidity: float) -> Floats:
    """Return how far the bending of a line (n, k, 3) under a force at a tip (n, 3) moves that."""
    step = np.diff(line, axis=1)
    size = np.linalg.norm(step, axis=-1, keepdims=True)
    way = step / size
    arm = tip[:, None] - 0.5 * (line[:, 1:] + line[:, :-1])
    moment = np.cross(arm, force)
    moment -= (moment * way).sum(axis=-1, keepdims=True) * way  # the rest twists
    return np.asarray((np.cross(moment, arm) * size).sum(axis=1) / rigidity)


@dataclass(frozen=True, kw_only=True)
class HeadCamera(Shown):
    """A camera with its light on an arm that is bent beforehand, so that it looks down when free.

    The arm lies straight under the cap. Free, its first part bends outwards and its second back,
    further: the camera looks towards the axis. It does not move with the end-effectors. The light
    stands beside the lens and lights what the camera sees.

    Parameters
    ----------
    diameter, length : float
        Of the housing [mm]; the lens is in the middle of its front.
    view : float
        Full angle of the cone that it sees [rad].
    near, far : float
        Depth of view along its axis [mm].
    azimuth : float
        Where the arm stands, from +x about +z [rad].
    thickness : float
        Of the arm, in the plane in which it bends [mm].
    rise_length, fall_length : float
        Of the arm's parts [mm].
    rise_angle, fall_angle : float
        By how much they bend, outwards and back [rad].
    strain_limit : float
        Strain up to which the arm is elastic; the default is that of nickel-titanium.
    """

    diameter: float = quantity("length", "Of the housing.", default=1.8, low=0.1, high=100.0)
    length: float = quantity("length", "Of the housing.", default=6.0, low=0.1, high=100.0)
    view: float = quantity("angle", "Of view.", default=math.radians(120.0), low=0.01, high=3.1)
    near: float = quantity("length", "Depth of view from.", default=0.0, low=0.0, high=1e4)
    far: float = quantity("length", "To.", default=90.0, low=lambda item: item.near, high=1e4)
    azimuth: float = quantity("angle", "Of the arm.", default=0.5 * math.pi, low=-7.0, high=7.0)
    thickness: float = quantity(
        "length", "Of the arm.", default=0.4, low=1e-3, high=lambda item: item.diameter
    )
    rise_length: float = quantity("length", "Of the first part.", default=28.0, low=0.1, high=1e3)
    rise_angle: float = quantity("angle", "Its bend.", default=math.pi / 3.0, low=0.0, high=3.0)
    fall_length: float = quantity("length", "Of the second part.", default=20.0, low=0.1, high=1e3)
    fall_angle: float = quantity("angle", "Its bend.", default=0.5 * math.pi, low=0.0, high=4.0)
    strain_limit: float = quantity(help="Elastic strain.", default=0.06, low=1e-6, high=1.0)

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def strain(self) -> float:
        """Largest strain of the arm when it lies straight."""
        bends = self.rise_angle / self.rise_length, self.fall_angle / self.fall_length
        return 0.5 * self.thickness * max(bends)

    @property
    def straight_length(self) -> float:
        """Of arm and housing under the cap [mm]."""
        return self.rise_length + self.fall_length + self.length

    def lay_arm(self, offset: float, *, free: bool) -> tuple[Floats, Floats]:
        """Return the line of the arm (k, 3), and that of the housing (2, 3) up to its lens [mm].

        Parameters
        ----------
        offset : float
            Distance of the arm's foot from the head's axis [mm].
        free : bool
            Whether it is bent; else it lies straight.
        """
        out = np.array([math.cos(self.azimuth), math.sin(self.azimuth), 0.0])
        lean, place = 0.0, offset * out
        points = [place]
        for length, angle in (
            (self.rise_length, self.rise_angle),
            (self.fall_length, -self.fall_angle),
        ):
            turned = angle if free else 0.0
            share = np.linspace(0.0, 1.0, 9)[1:]
            middle = lean + 0.5 * turned * share
            chord = length * share * np.sinc(0.5 * turned * share / math.pi)
            way = np.sin(middle)[:, None] * out + np.cos(middle)[:, None] * [0.0, 0.0, 1.0]
            points += [*(place + chord[:, None] * way)]
            lean, place = lean + turned, points[-1]
        axis = math.sin(lean) * out + np.array([0.0, 0.0, math.cos(lean)])
        return np.array(points), np.stack([place, place + self.length * axis])


@dataclass(frozen=True, kw_only=True)
class EndCap:
    """A sleeve over all, open in front, that a spring holds forward and cables pull back.

    Parameters
    ----------
    wall : float
        Thickness [mm].
    length : float
        How far it covers what stands on the head's face [mm].
    stroke : float
        How far cables pull it back [mm].
    preload, stiffness : float
        Force [N] of the spring when the cap is forward, and its stiffness [N/mm].
    """

    wall: float = quantity("length", "Thickness.", default=0.3, low=0.01, high=10.0)
    length: float = quantity("length", "How far it covers.", default=56.0, low=0.0, high=1e3)
    stroke: float = quantity("length", "How far it is pulled.", default=56.0, low=0.0, high=1e3)
    preload: float = quantity("force", "Of the spring.", default=1.0, low=0.0, high=1e3)
    stiffness: float = quantity("stiffness", "Of the spring.", default=0.05, low=0.0, high=1e3)

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def pull(self) -> float:
        """What cables pull with to hold it back, without friction [N]."""
        return self.preload + self.stiffness * self.stroke

    def find_front(self, *, free: bool) -> float:
        """Return where its front is along the head's axis [mm]."""
        return self.length - (self.stroke if free else 0.0)


@dataclass(frozen=True, kw_only=True)
class Head(Shown):
    """The distal head of an endoscope, its face in the plane z = 0, its axis along z.

    Parameters
    ----------
    kind : str
        ``"bozzini-head"``, by which a file is known.
    diameter : float
        Of the whole, with its cap [mm].
    camera : HeadCamera
    cap : EndCap
    effectors : tuple of PlacedEffector
        One to three, side by side.

    Raises
    ------
    InputError
        If a value is not legal.
    """

    kind: Literal["bozzini-head"] = field(default_factory=lambda: "bozzini-head")
    diameter: float = quantity("length", "Outer diameter.", default=12.0, low=1.0, high=100.0)
    camera: HeadCamera = field(default_factory=HeadCamera)
    cap: EndCap = field(default_factory=EndCap)
    effectors: tuple[PlacedEffector, ...] = field(default_factory=lambda: (PlacedEffector(),))

    def __post_init__(self) -> None:
        check_fields(self)
        check_kind("camera", self.camera, HeadCamera)
        check_kind("cap", self.cap, EndCap)
        object.__setattr__(self, "effectors", tuple(self.effectors))
        if not 1 <= len(self.effectors) <= 3:
            raise InputError(
                f"the head has {len(self.effectors)} end-effectors: it must have 1 to 3"
            )
        for placed in self.effectors:
            check_kind("end-effector", placed, PlacedEffector)
        if 2.0 * self.cap.wall + self.camera.diameter >= self.diameter:
            least = 2.0 * self.cap.wall + self.camera.diameter
            raise InputError(
                f"diameter is {self.diameter:g} mm: it must be more than {least:g} mm, the camera "
                "and the cap's wall on both sides"
            )

    @property
    def inner_radius(self) -> float:
        """Of the cap [mm]."""
        return 0.5 * self.diameter - self.cap.wall

    @property
    def length(self) -> float:
        """How far it reaches along its axis with all straight and the instruments out [mm]."""
        return max(placed.length + placed.instrument.reach for placed in self.effectors)

    def lay_arm(self, *, free: bool = True) -> tuple[Floats, Floats]:
        """Return the lines of the camera's arm (k, 3) and housing (2, 3) up to the lens [mm]."""
        offset = self.inner_radius - 0.5 * self.camera.diameter
        return self.camera.lay_arm(offset, free=free)

    def look(self, size: int = 480) -> Camera:
        """Return the camera as a pinhole whose square picture holds the cone of view.

        Parameters
        ----------
        size : int
            Width and height of the picture [px].
        """
        size = check_integer("size", size, low=2, high=100_000)
        _, (back, lens) = self.lay_arm()
        focal = 0.5 * size / math.tan(0.5 * self.camera.view)
        out = np.array([math.cos(self.camera.azimuth), math.sin(self.camera.azimuth), 0.0])
        return aim_camera(lens, 2.0 * lens - back, focal=focal, size=(size, size), down=-out)

    def get_effector(self, number: int) -> PlacedEffector:
        """Return an end-effector by its number from 1.

        Raises
        ------
        InputError
            If there is none of that number.
        """
        return self.effectors[
            check_integer("end-effector", number, low=1, high=len(self.effectors)) - 1
        ]

    def forward(self, pressures: Sequence[ArrayLike | Mapping[str, ArrayLike]]) -> HeadPose:
        """Return the pose under pressures [MPa] for each end-effector, in order.

        Raises
        ------
        InputError
            If there are not as many as end-effectors, or a pressure is not legal.
        """
        from .shape import pose_head

        return pose_head(self, pressures)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw it from the side, under the cap and free, and return the axes."""
        from .shape import draw_head

        return draw_head(self, ax)


def read_head(path: str | os.PathLike[str] | None) -> Head:
    """Read the file of a head: JSON if it ends in ``.json``, YAML otherwise; None is the default.

    Raises
    ------
    FileFormatError
        If it is not such a file; the message names the file and the field.
    """
    return Head() if path is None else load_record(path, Head, name="the head")


def write_head(path: str | os.PathLike[str], head: Head) -> Path:
    """Write the file of a head that `read_head` reads back exactly.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    check_kind("head", head, Head)
    return save_record(head, path, note="Numbers are in mm, N, MPa and rad.")

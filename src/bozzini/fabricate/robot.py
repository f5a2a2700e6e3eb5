"""The body of a tendon robot: channelled discs or swept sleeves, and its routing as a table."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..checks import check_fields, check_number, quantity, show_apart
from ..errors import GeometryError
from ..numeric.arrays import Floats
from ..results import ClosedForm, Json, Shown, take_axes
from .part import Channel, Part, drill, gather_copies

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..continuum import RobotDesign, Tendon

Form = Literal["discs", "sleeve"]

ROUND_OFF_MM = 1e-9
"""Length that is round-off [mm]."""

SLEEVE_STEP_MM = 0.5
"""Height between the cuts of a swept channel [mm]: a chord of 0.5 mm lies within 0.005 mm of an arc
of 6.3 mm radius, which is tighter than any channel of an endoscope."""


@dataclass(frozen=True, kw_only=True)
class BodyOptions(Shown):
    """How the body of a tendon robot is made.

    Parameters
    ----------
    form : {"discs", "sleeve"}
        Guide discs on a backbone, or one sleeve a section whose channels follow the tendons.
    backbone_diameter : float
        Of the rod or tube in the middle [mm]; 0 for no central hole.
    tendon_diameter : float
        Of the tendons [mm].
    clearance : float
        By how much a hole is wider than what runs in it [mm].
    thickness : float
        Of a disc [mm].
    wall : float
        Thinnest wall allowed, measured in the cross-section [mm].

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    form: Form = quantity(
        "text", "Discs on a backbone, or sleeves.", default="discs", words=("discs", "sleeve")
    )
    backbone_diameter: float = quantity(
        "length",
        "Rod or tube in the middle; 0 for none.",
        default=1.0,
        low=0.0,
        high=1e3,
        source="a nickel-titanium rod of 1 mm",
    )
    tendon_diameter: float = quantity(
        "length",
        "Diameter of the tendons.",
        default=0.25,
        low=0.01,
        high=100.0,
        source="steel wire of 0.25 mm, which is what the tendon stiffness of 10 kN stands for",
    )
    clearance: float = quantity(
        "length",
        "How much wider a hole is than what runs in it.",
        default=0.1,
        low=0.0,
        high=10.0,
        source="a choice: a wire of 0.25 mm slides; test it on the machine that makes the part",
        by_name=True,
    )
    thickness: float = quantity(
        "length",
        "Thickness of a disc.",
        default=2.0,
        low=0.1,
        high=1e3,
        source="a choice: a hole of 0.35 mm in it guides its wire within 3 degrees",
        by_name=True,
    )
    wall: float = quantity(
        "length",
        "Thinnest wall allowed.",
        default=0.4,
        low=0.05,
        high=100.0,
        source="one line of the usual 0.4 mm nozzle of filament printers",
        by_name=True,
    )

    def __post_init__(self) -> None:
        check_fields(self)


def build_body(robot: RobotDesign, options: BodyOptions | None = None) -> tuple[Part, ...]:
    """Return the discs or sleeves of a robot, those of one shape as one part.

    A disc stands at the base and at each guide disc's place; its channels are straight, along the
    tendons at its middle. A sleeve is a section; its channels follow the tendons, and are blind
    where a tendon ends inside. The origin of a disc is its middle, that of a sleeve its lower end.

    Parameters
    ----------
    robot : RobotDesign
    options : BodyOptions, optional

    Raises
    ------
    GeometryError
        If discs overlap or a wall is thinner than allowed; the message names the place.
    InputError
        If `robot` is none.
    """
    from ..continuum.robot import check_robot

    check_robot(robot)
    given = options or BodyOptions()
    list_parts = _list_discs if given.form == "discs" else _list_sleeves
    parts = gather_copies(list(list_parts(robot, given)))
    for part in parts:
        part.check_walls(given.wall)
    return tuple(parts)


def _list_discs(robot: RobotDesign, given: BodyOptions) -> Iterator[Part]:
    places = np.concatenate([[0.0], robot.disc_arc_length])
    apart = np.diff(places)
    nearest = int(np.argmin(apart))
    if apart[nearest] <= given.thickness:
        shown = show_apart(given.thickness, apart[nearest], places[nearest], places[nearest + 1])
        raise GeometryError(
            f"thickness is {shown[0]} mm: it must be below {shown[1]} mm, the "
            f"distance of the discs at {shown[2]} and {shown[3]} mm"
        )
    half = 0.5 * given.thickness
    for index, place in enumerate(places.tolist()):
        radius = robot.sections[int(robot.section_at(place))].radius
        tendons = [t for t in robot.tendons if _end(t) >= place - ROUND_OFF_MM]
        yield Part(
            name=f"disc-{index:02d}",
            outline=((-half, radius), (half, radius)),
            channels=(
                *_drill_backbone(given, -half, half),
                *(_drill_tendon(tendon, place, given) for tendon in tendons),
            ),
            places=((0.0, 0.0, place),),
        )


def _drill_backbone(given: BodyOptions, low: float, high: float) -> list[Channel]:
    if not given.backbone_diameter:
        return []
    ends = np.array([[0.0, 0.0, low], [0.0, 0.0, high]])
    return [drill("the backbone", given.backbone_diameter + given.clearance, *ends)]


def _drill_tendon(tendon: Tendon, place: float, given: BodyOptions) -> Channel:
    """Return a tendon's straight hole in the disc at a place: along the tendon there."""
    middle = np.append(tendon.place_at(place), 0.0)
    way = 0.5 * given.thickness * np.append(tendon.slope_at(place), 1.0)
    name = f"tendon {tendon.name}"
    return drill(name, given.tendon_diameter + given.clearance, middle - way, middle + way)


def _list_sleeves(robot: RobotDesign, given: BodyOptions) -> Iterator[Part]:
    for index, section in enumerate(robot.sections):
        start, end = float(robot.section_starts[index]), float(robot.section_ends[index])
        tendons = [t for t in robot.tendons if _end(t) > start + ROUND_OFF_MM]
        yield Part(
            name=f"sleeve-{index + 1}",
            outline=((0.0, section.radius), (end - start, section.radius)),
            channels=(
                *_drill_backbone(given, 0.0, end - start),
                *(_sweep(tendon, start, min(end, _end(tendon)), given) for tendon in tendons),
            ),
            places=((0.0, 0.0, start),),
        )


def _sweep(tendon: Tendon, start: float, end: float, given: BodyOptions) -> Channel:
    """Return a tendon's channel between two arc lengths."""
    places = np.linspace(start, end, math.ceil((end - start) / SLEEVE_STEP_MM) + 1)
    corners = tendon.corners()
    places = np.union1d(places, corners[(corners > start) & (corners < end)])
    slope = tendon.slope_at(places)
    if np.ptp(slope, axis=0).max() < 1e-12:
        places, slope = places[[0, -1]], slope[[0, 0]]
    return Channel(
        name=f"tendon {tendon.name}",
        centre=np.column_stack([tendon.place_at(places), places - start]),
        diameter=np.full(len(places), given.tendon_diameter + given.clearance),
        slope=slope,
    )


def _end(tendon: Tendon) -> float:
    return math.inf if tendon.end is None else tendon.end


@dataclass(frozen=True, kw_only=True)
class Routing(ClosedForm):
    """Where the tendons of a robot cross its cross-sections.

    Attributes
    ----------
    robot : RobotDesign
    places : tuple of (n,) ndarray
        Arc lengths of each tendon from the base to its end [mm].
    paths, slopes : tuple of (n, 2) ndarray
        Place in the cross-section [mm], and its derivative with arc length.
    """

    robot: RobotDesign
    places: tuple[Floats, ...]
    paths: tuple[Floats, ...]
    slopes: tuple[Floats, ...]

    def list_columns(self) -> Json:
        """Return a row for each tendon and place; angles are in [0, 2 pi)."""
        x, y = np.concatenate(self.paths).T
        slope = np.concatenate(self.slopes)
        discs = np.append(self.robot.disc_arc_length, 0.0)
        places = np.concatenate(self.places)
        return {
            "tendon": np.repeat(self.robot.tendon_names, [len(s) for s in self.places]),
            "s_mm": places,
            "x_mm": x,
            "y_mm": y,
            "offset_mm": np.hypot(x, y),
            "angle_rad": _turn(x, y),
            "slope_x": slope[:, 0],
            "slope_y": slope[:, 1],
            "length_mm": np.concatenate(
                [_measure(s, p) for s, p in zip(self.places, self.paths, strict=True)]
            ),
            "at_disc": np.isclose(places[:, None], discs, rtol=0.0, atol=1e-9).any(axis=1),
        }

    def to_dict(self) -> Json:
        """Return the ends of each tendon as plain values."""
        return {
            tendon.name: {
                "end_mm": float(s[-1]),
                "length_mm": float(_measure(s, p)[-1]),
                "offset_min_mm": float(np.hypot(*p.T).min()),
                "offset_max_mm": float(np.hypot(*p.T).max()),
                "slope_max": float(np.hypot(*q.T).max()),
            }
            for tendon, s, p, q in zip(
                self.robot.tendons, self.places, self.paths, self.slopes, strict=True
            )
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the routing unrolled, angle over arc length, and return the axes.

        Dots are holes in discs, grey lines the discs. A tendon that turns past 0 or crosses the
        backbone goes on at another angle.
        """
        axes = take_axes(ax, x="arc length [mm]", y="angle from +x about +z [deg]")
        for place in [0.0, *self.robot.disc_arc_length.tolist()]:
            axes.axvline(place, color="#d5dbe1", linewidth=1.0, zorder=0)
        for end in self.robot.section_ends.tolist():
            axes.axvline(end, color="#8fa1b3", linewidth=1.6, zorder=0)
        columns = self.list_columns()
        names = columns["tendon"]
        for k, name in enumerate(self.robot.tendon_names):
            s, angle, disc = (columns[c][names == name] for c in ("s_mm", "angle_rad", "at_disc"))
            angle = np.degrees(angle)
            cuts = np.flatnonzero(np.abs(np.diff(angle)) > 90.0) + 1
            for part in np.split(np.arange(len(s)), cuts):
                axes.plot(s[part], angle[part], color=f"C{k % 10}", linewidth=1.6)
            axes.plot(s[disc], angle[disc], "o", color=f"C{k % 10}", markersize=3.2, label=name)
        axes.set(ylim=(0.0, 360.0), yticks=range(0, 361, 60))
        axes.set_xlim(-0.02 * self.robot.length, 1.02 * self.robot.length)
        if 0 < len(self.robot.tendons) <= 12:
            axes.legend(
                frameon=False, fontsize=8, ncols=6, loc="lower left", bbox_to_anchor=(0.0, 1.0)
            )
        return axes


def tabulate_routing(robot: RobotDesign, step: float = 1.0) -> Routing:
    """Return where the tendons run, at the discs and in between.

    Parameters
    ----------
    robot : RobotDesign
    step : float
        Largest arc length between two rows [mm], in [0.01, 1000].

    Raises
    ------
    InputError
        If an argument is not legal.
    """
    from ..continuum.robot import check_robot

    check_robot(robot)
    check_number("step", step, low=0.01, high=1e3, unit="mm")
    discs = np.append(robot.disc_arc_length, 0.0)
    places = []
    for end in robot.tendon_ends.tolist():
        even = np.linspace(0.0, end, math.ceil(end / step) + 1)
        even = even[np.abs(even[:, None] - discs).min(axis=1) > 1e-6 * step]
        places.append(np.union1d(np.append(even, end), discs[discs < end - ROUND_OFF_MM]))
    return Routing(
        robot=robot,
        places=tuple(places),
        paths=tuple(t.place_at(s) for t, s in zip(robot.tendons, places, strict=True)),
        slopes=tuple(t.slope_at(s) for t, s in zip(robot.tendons, places, strict=True)),
    )


def _turn(x: Floats, y: Floats) -> Floats:
    angle = np.mod(np.arctan2(y, x), 2.0 * math.pi)
    # A tiny negative angle is rounded up to a whole turn.
    return np.where(angle >= 2.0 * math.pi - 1e-12, 0.0, angle)


def _measure(places: Floats, paths: Floats) -> Floats:
    """Length of a tendon along its chords in the straight robot, from the base [mm]."""
    steps = np.linalg.norm(np.diff(np.column_stack([paths, places]), axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])

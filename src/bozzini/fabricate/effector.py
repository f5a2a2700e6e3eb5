"""The hard parts of an end-effector: holders, muscle fittings, and a drilling template."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

import numpy as np

from ..checks import check_fields, quantity, show_apart
from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..results import Shown
from .part import Channel, Part, drill

if TYPE_CHECKING:
    from ..effector import EffectorDesign


@dataclass(frozen=True, kw_only=True)
class HolderOptions(Shown):
    """How the holders and fittings of an end-effector are made (thesis 4.2 and 3.2).

    The holes' places and diameters, the holder's diameter and the length of the distal holder are
    those of the `EffectorDesign`.

    Parameters
    ----------
    proximal_length : float
        Length of the proximal holder [mm].
    seat_depth : float
        Depth of the coil's seat in each holder [mm]; 0 for none.
    nozzle_diameter : float
        Of the nozzle over which a muscle's tube is drawn, and of the one for the air tube [mm].
    nozzle_length : float
        Of both nozzles and of the distal pin [mm].
    air_bore : float
        Of the air's way through the proximal fitting [mm].
    clearance : float
        By how much a hole is wider than what is glued into it [mm].
    wall : float
        Thinnest wall allowed [mm].

    Raises
    ------
    InputError
        If a value is outside its legal range, or the nozzle's wall is too thin.
    """

    proximal_length: float = quantity(
        "length",
        "Length of the proximal holder.",
        default=5.0,
        low=0.5,
        high=1e3,
        source="a choice, half the distal holder: 30 mm^2 of glue on a 2 mm fitting",
        by_name=True,
    )
    seat_depth: float = quantity(
        "length",
        "Depth of the coil's seat in each holder; 0 for none.",
        default=2.0,
        low=0.0,
        high=100.0,
        source="a choice, half the diameter of the thesis's coil",
        by_name=True,
    )
    nozzle_diameter: float = quantity(
        "length",
        "Nozzle for the muscle's tube and for the air tube.",
        default=1.0,
        low=0.1,
        high=100.0,
        source="fits in air tubes of 1 mm bore; stretches the thesis's silicone tube of 0.5 mm",
        by_name=True,
    )
    nozzle_length: float = quantity(
        "length",
        "Length of nozzles and pins.",
        default=3.0,
        low=0.5,
        high=100.0,
        source="a choice: less than half the 11.7 mm at a muscle's ends that do not contract",
        by_name=True,
    )
    air_bore: float = quantity(
        "length",
        "Bore of the proximal fitting.",
        default=0.4,
        low=0.05,
        high=100.0,
        source="a choice: what a wall of 0.3 mm leaves of a nozzle of 1 mm",
        by_name=True,
    )
    clearance: float = quantity(
        "length",
        "How much wider a hole is than what is glued in.",
        default=0.1,
        low=0.0,
        high=10.0,
        source="a choice: 0.05 mm of glue all round",
        by_name=True,
    )
    wall: float = quantity(
        "length",
        "Thinnest wall allowed.",
        default=0.3,
        low=0.05,
        high=100.0,
        source="a choice for turned or resin-printed parts; filament printers need 0.4 mm or more",
        by_name=True,
    )

    def __post_init__(self) -> None:
        check_fields(self)
        left = 0.5 * (self.nozzle_diameter - self.air_bore)
        if left < self.wall - 1e-9:
            raise InputError(
                f"air bore is {self.air_bore:g} mm: a nozzle of {self.nozzle_diameter:g} mm is "
                f"left a wall of {left:.3g} mm where at least {self.wall:g} mm must be"
            )


def build_holders(
    design: EffectorDesign, options: HolderOptions | None = None
) -> tuple[Part, Part, Part, Part]:
    """Return proximal holder, distal holder, air fittings and end pins of an end-effector.

    Directions are those of the design: angles from +x about +z, which points to the tip. z = 0 is
    the face that looks at the other holder. Holes are parallel to the backbone, as in the design.

    Parameters
    ----------
    design : EffectorDesign
    options : HolderOptions, optional

    Raises
    ------
    InputError
        If `design` is none, or a dimension does not go with another.
    GeometryError
        If a wall is thinner than allowed; the message names what does not fit, and the smallest
        holder or offset that does, or the two holes.
    """
    from ..effector import EffectorDesign

    if not isinstance(design, EffectorDesign):
        raise InputError(f"design is of type {type(design).__name__}: it must be an EffectorDesign")
    given = options or HolderOptions()
    _check_fit(design, given)
    _check_room(design, given)
    below, above = given.proximal_length, design.holder_length
    tip = (0.0, 0.0, design.backbone_length)
    holders = (
        _make_holder("holder-proximal", design, given, low=-below, high=0.0, place=(0.0, 0.0, 0.0)),
        _make_holder("holder-distal", design, given, low=0.0, high=above, place=tip),
    )
    body = 0.5 * (design.hole_diameter - given.clearance)
    nozzle, length = 0.5 * given.nozzle_diameter, given.nozzle_length
    ends = _along(np.zeros(2), -below - length, length)
    holes = [tuple(place) for place in _muscle_places(design).tolist()]
    fitting = Part(
        name="fitting-proximal",
        outline=(
            (-below - length, nozzle), (-below, nozzle), (-below, body), (0.0, body),
            (0.0, nozzle), (length, nozzle),
        ),
        channels=(drill("the air bore", given.air_bore, *ends),),
        places=tuple((x, y, 0.0) for x, y in holes),
    )  # fmt: skip
    pin = Part(
        name="fitting-distal",
        outline=((-length, nozzle), (0.0, nozzle), (0.0, body), (above, body)),
        channels=(),
        places=tuple((x, y, design.backbone_length) for x, y in holes),
    )
    for part in (*holders, fitting):
        part.check_walls(given.wall)
    return (*holders, fitting, pin)


def _muscle_places(design: EffectorDesign) -> Floats:
    return design.offset * np.column_stack([np.cos(design.angles), np.sin(design.angles)])


def _along(place: Floats, low: float, high: float) -> Floats:
    """Return the ends (2, 3) of a line parallel to the backbone."""
    return np.column_stack([np.tile(place, (2, 1)), [low, high]])


def _make_holder(
    name: str, design: EffectorDesign, given: HolderOptions, *, low: float, high: float,
    place: tuple[float, float, float],
) -> Part:  # fmt: skip
    radius = 0.5 * design.holder_diameter
    bore = drill("the bore", design.bore_diameter, *_along(np.zeros(2), low, high))
    seat = design.coil_diameter + given.clearance
    if given.seat_depth and seat > design.bore_diameter:
        bore = _add_seat(bore, given.seat_depth if low == 0.0 else -given.seat_depth, seat)
    return Part(
        name=name,
        outline=((low, radius), (high, radius)),
        channels=(
            bore,
            *(
                drill(f"muscle {muscle}", design.hole_diameter, *_along(hole, low, high))
                for muscle, hole in zip(design.names, _muscle_places(design), strict=True)
            ),
        ),
        places=(place,),
    )


def _add_seat(bore: Channel, height: float, diameter: float) -> Channel:
    """Return a bore that is wider between a height and z = 0."""
    low, high = bore.centre[0, 2], bore.centre[-1, 2]
    narrow = float(bore.diameter[0])
    sizes = [diameter, diameter, narrow, narrow]
    z = np.array([low, height, height, high])
    return Channel(
        name=bore.name,
        centre=np.column_stack([np.zeros((4, 2)), z]),
        diameter=np.array(sizes if height > 0.0 else sizes[::-1]),
        slope=np.zeros((4, 2)),
    )


def _check_fit(design: EffectorDesign, given: HolderOptions) -> None:
    for name, length in (
        ("proximal length", given.proximal_length),
        ("holder length", design.holder_length),
    ):
        if length < given.seat_depth + given.wall:
            raise InputError(
                f"{name} is {length:g} mm: a seat of {given.seat_depth:g} mm needs at least "
                f"{given.seat_depth + given.wall:g} mm"
            )
    for name in ("bore_diameter", "hole_diameter"):
        if getattr(design, name) <= 0.0:
            raise InputError(f"{name.replace('_', ' ')} is 0 mm: a holder has both kinds of hole")
    body = design.hole_diameter - given.clearance
    if body <= given.nozzle_diameter:
        shown = show_apart(given.nozzle_diameter, body, given.clearance, design.hole_diameter)
        raise InputError(
            f"nozzle diameter is {shown[0]} mm: it must be below {shown[1]} mm, "
            f"what a clearance of {shown[2]} mm leaves of a hole of "
            f"{shown[3]} mm"
        )
    for placed in design.muscles:
        tube = 2.0 * placed.muscle.inner_radius
        if given.nozzle_diameter <= tube:
            raise InputError(
                f"nozzle diameter is {given.nozzle_diameter:g} mm: the tube of muscle "
                f"{placed.name} has a bore of {tube:g} mm and would not hold on it"
            )


def _check_room(design: EffectorDesign, given: HolderOptions) -> None:
    """Raise `GeometryError` if the muscles' holes have no room between the middle and the rim."""
    seat = design.coil_diameter + given.clearance if given.seat_depth else 0.0
    middle = max(design.bore_diameter, seat)
    centre = f"the {'bore' if seat < middle else 'seat of the coil'} of {middle:g} mm"
    rim = 0.5 * design.hole_diameter + given.wall
    low, high = 0.5 * middle + rim, 0.5 * design.holder_diameter - rim
    if low - 1e-9 <= design.offset <= high + 1e-9:
        return
    holes = f"muscle holes of {design.hole_diameter:g} mm"
    what = (
        f"offset is {design.offset:g} mm: {holes} beside {centre} with walls of {given.wall:g} mm "
        f"need at least {_round_up(low)} mm"
    )
    if design.offset >= low - 1e-9:
        what = (
            f"holder diameter is {design.holder_diameter:g} mm: {holes}, {design.offset:g} mm off "
            f"the axis, with walls of {given.wall:g} mm need at least "
            f"{_round_up(2.0 * (design.offset + rim))} mm"
        )
    raise GeometryError(
        f"{what}; the smallest holder round {centre} is {_round_up(2.0 * (low + rim))} mm, with an "
        f"offset of {_round_up(low)} mm"
    )


def _round_up(length: float) -> str:
    """Return a length [mm] to hundredths, never one that is too small."""
    return f"{math.ceil(100.0 * length - 1e-6) / 100.0:g}"


CHECK_LINE_MM = 50.0
"""Length of the line by which a print is checked [mm]."""


def draw_template(design: EffectorDesign) -> str:
    """Return the drilling template of both holders as SVG at true scale.

    It is seen from the tip: drill the proximal holder from its inner face and the distal one from
    its tip. It holds circles, centre marks, names, angles, a table of coordinates, and a line of
    50 mm to check the print with.

    Parameters
    ----------
    design : EffectorDesign
    """
    radius, pitch = 0.5 * design.holder_diameter, design.offset
    half = max(radius, pitch + 0.5 * design.hole_diameter)
    margin, line = 17.0, 4.2
    wide = max(2.0 * (half + margin), CHECK_LINE_MM + 20.0)
    middle = np.array([0.5 * wide, half + margin])
    foot = 2.0 * (half + margin)
    tall = foot + 12.0 + line * (len(design.muscles) + 3)
    shapes = [
        _circle(middle, radius, "outline"),
        _circle(middle, 0.5 * design.bore_diameter, "bore"),
        _circle(middle, pitch, "pitch"),
        *_cross(middle, 0.5 * design.bore_diameter + 1.0),
        _stroke(middle + [radius, 0.0], middle + [half + 3.0, 0.0]),
        _text(middle + [half + 3.4, 1.0], "+x", "start"),
    ]
    table = [f"holes {design.hole_diameter:g} mm, bore {design.bore_diameter:g} mm"]
    for placed, (x, y) in zip(design.muscles, _muscle_places(design), strict=True):
        way = np.array([math.cos(placed.angle), -math.sin(placed.angle)])
        centre = middle + np.array([x, -y])
        degrees = math.degrees(placed.angle) % 360.0
        label = middle + way * (half + 10.0) + [0.0, 1.0]
        shapes += [_circle(centre, 0.5 * design.hole_diameter, f"muscle {placed.name}")]
        shapes += _cross(centre, 0.5 * design.hole_diameter + 0.6)
        shapes += [_text(label, f"{placed.name} {degrees:.4g}°", "middle")]
        table.append(f"{placed.name}: x {x:z.3f}  y {y:z.3f} mm, {degrees:.3f}°")
    left = middle[0] - 0.5 * CHECK_LINE_MM
    ends = np.array([[left, foot + 3.0], [left + CHECK_LINE_MM, foot + 3.0]])
    shapes += [_stroke(ends[0], ends[1], "check")]
    shapes += [_stroke(end - [0.0, 1.5], end + [0.0, 1.5]) for end in ends]
    words = [f"this line is {CHECK_LINE_MM:g} mm: print at 100 %", "seen from the tip", *table]
    shapes += [
        _text(np.array([left, foot + 9.0 + line * k]), text, "start")
        for k, text in enumerate(words)
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide:.6g}mm" height="{tall:.6g}mm" '
        f'viewBox="0 0 {wide:.6g} {tall:.6g}">\n'
        '<rect width="100%" height="100%" fill="white"/>\n'
        '<g fill="none" stroke="black" stroke-width="0.1" font-family="sans-serif" '
        'font-size="3">\n' + "\n".join(shapes) + "\n</g>\n</svg>\n"
    )


def _circle(centre: Floats, radius: float, name: str) -> str:
    dashes = ' stroke-dasharray="1 0.6"' if name == "pitch" else ""
    return (
        f'<circle id="{escape(name, {chr(34): "&quot;"})}" cx="{centre[0]:.6f}" '
        f'cy="{centre[1]:.6f}" r="{radius:.6f}"{dashes}/>'
    )


def _stroke(one: Floats, other: Floats, name: str = "") -> str:
    label = f'id="{name}" ' if name else ""
    (x1, y1), (x2, y2) = one, other
    return f'<line {label}x1="{x1:.6f}" y1="{y1:.6f}" x2="{x2:.6f}" y2="{y2:.6f}"/>'


def _cross(centre: Floats, half: float) -> list[str]:
    return [
        _stroke(centre - np.array(way), centre + np.array(way))
        for way in ((half, 0.0), (0.0, half))
    ]


def _text(place: Floats, text: str, anchor: str) -> str:
    return (
        f'<text x="{place[0]:.3f}" y="{place[1]:.3f}" text-anchor="{anchor}" fill="black" '
        f'stroke="none">{escape(text)}</text>'
    )

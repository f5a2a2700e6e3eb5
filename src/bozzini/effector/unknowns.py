"""Numbers of an end-effector that a fit may find, by name."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..checks import Quantity, list_quantities
from ..errors import InputError
from ..muscle import Muscle
from ..numeric.arrays import Floats
from ..numeric.estimate import FitParameter
from .design import EffectorDesign
from .motion import EffectorMotion
from .section import MusclePull
from .view import TipView

if TYPE_CHECKING:
    from .effector import Effector

_Item = TypeVar("_Item")

ANGLE = Quantity(kind="angle", help="Direction of a muscle.", scale=0.05)
SCALE = Quantity(help="Pressure over what was commanded.", scale=0.05, low=0.05, high=20.0)
WEIGHT = Quantity(help="Share that goes through a play.", scale=0.1, low=-2.0, high=2.0)
WEIGHTS = "motion.play_weights"


@dataclass(frozen=True)
class EffectorSetup:
    """What is fitted: an end-effector, how it is seen, and a factor on its commands."""

    effector: Effector
    view: TipView
    scale: float = 1.0


@dataclass(frozen=True)
class FreeNumber:
    """A number, or one for each muscle or play, that a fit finds as a change of what it was.

    Parameters
    ----------
    name : str
        As in ``--free``.
    known : Quantity
        Its unit, bounds and scale.
    groups : tuple of str
        Muscles or plays that have one each; none for one number.
    begin : ndarray, shape (k,)
        Where the search begins, one for each group, or one.
    put : callable
        Returns a setup with values (k,) of it.
    """

    name: str
    known: Quantity
    groups: tuple[str, ...]
    begin: Floats
    put: Callable[[EffectorSetup, Floats], EffectorSetup]

    @property
    def parameter(self) -> FitParameter:
        """The change of it, for `estimate`."""
        low, high = (
            end if not callable(end) else math.copysign(math.inf, way)
            for end, way in ((self.known.low, -1.0), (self.known.high, 1.0))
        )
        size = self.known.scale or 0.1 * float(np.abs(self.begin).max()) or 0.1
        return FitParameter(
            self.name, 0.0, low=float((low - self.begin).max()),
            high=float((high - self.begin).min()), scale=size, groups=self.groups,
        )  # fmt: skip


def change_setup(
    setup: EffectorSetup, unknowns: Sequence[FreeNumber], changes: Mapping[str, Floats]
) -> EffectorSetup:
    """Return a setup with changes of unknowns by name, without an axis or with one of groups."""
    for one in unknowns:
        setup = one.put(setup, one.begin + changes[one.name])
    return setup


def parse_unknowns(setup: EffectorSetup, free: Sequence[str]) -> tuple[FreeNumber, ...]:
    """Return the unknowns of names.

    ``muscles.each.modulus`` is a number for each muscle and ``muscles.*.modulus`` one for all, of a
    field of `Muscle`, of `MusclePull`, or the angle; ``offset`` and the others of `EffectorDesign`;
    ``motion.fill_lag`` and the others of `EffectorMotion`, ``motion.play_weights`` one for each
    play; ``base.turn_x`` and ``board.x`` of `TipView`; ``commands.scale``.

    Raises
    ------
    InputError
        If a name is none of these, or stands there twice.
    """
    names = [name.strip() for name in free if name.strip()]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"'{name}' is free twice: name it once")
        if name.replace(".each.", ".*.") != name and name.replace(".each.", ".*.") in names:
            raise InputError(f"'{name}' is free for all muscles at once, too: name it once")
    return tuple(_parse(setup, name) for name in names)


def set_number(setup: EffectorSetup, name: str, value: float) -> EffectorSetup:
    """Return a setup with a number, named as of `parse_unknowns`, in place of what it was."""
    one = _parse(setup, name)
    return one.put(setup, np.full(len(one.begin), value))


def find_kind(setup: EffectorSetup, name: str) -> str:
    """Return the kind of quantity of a number, named as of `parse_unknowns`."""
    return _parse(setup, name).known.kind


def _parse(setup: EffectorSetup, name: str) -> FreeNumber:
    head, _, field = name.partition(".")
    which, _, own = field.partition(".")
    if head == "muscles" and which in ("each", "*"):
        return _take_muscle(setup, name, own, each=which == "each")
    if name == WEIGHTS:
        motion = setup.effector.motion
        if not motion.play_radii:
            raise InputError(f"{name} is free and there are no plays: give their radii")
        return FreeNumber(
            name,
            WEIGHT,
            tuple(f"{1e3 * radius:g}kPa" for radius in motion.play_radii),
            np.array(motion.play_weights),
            lambda setup, values: _put_motion(setup, play_weights=tuple(values.tolist())),
        )
    if name == "commands.scale":
        return FreeNumber(
            name, SCALE, (), np.array([setup.scale]),
            lambda setup, values: dataclasses.replace(setup, scale=float(values[0])),
        )  # fmt: skip
    design, moves, view = (list_quantities(k) for k in (EffectorDesign, EffectorMotion, TipView))
    if name in design and not design[name].whole and name != "backbone_length":
        return _take_field(name, design[name], getattr(setup.effector.design, name), _put_design,
                           name)  # fmt: skip
    if head == "motion" and field in moves:
        return _take_field(name, moves[field], getattr(setup.effector.motion, field), _put_motion,
                           field)  # fmt: skip
    if head in ("base", "board") and f"{head}_{field}" in view:
        own = f"{head}_{field}"
        return _take_field(name, view[own], getattr(setup.view, own), _put_view, own)
    raise InputError(
        f"'{name}' cannot be fitted: give muscles.each.FIELD or muscles.*.FIELD, one of "
        f"{', '.join(k for k in design if not design[k].whole and k != 'backbone_length')}, "
        f"motion.FIELD with one of {', '.join(moves)} or play_weights, base.x to base.turn_z, "
        "board.distance, board.slope_x, board.slope_y, board.x, board.y, or commands.scale"
    )


def _take_field(
    name: str, known: Quantity, value: float, put: Callable[..., EffectorSetup], field: str
) -> FreeNumber:
    return FreeNumber(
        name, known, (), np.array([float(value)]),
        lambda setup, values: put(setup, **{field: float(values[0])}),
    )  # fmt: skip


def _put_design(setup: EffectorSetup, **changes: object) -> EffectorSetup:
    design: EffectorDesign = _swap(setup.effector.design, **changes)
    return _put(setup, design=design)


def _put_motion(setup: EffectorSetup, **changes: object) -> EffectorSetup:
    return _put(setup, motion=_swap(setup.effector.motion, **changes))


def _put_view(setup: EffectorSetup, **changes: object) -> EffectorSetup:
    return dataclasses.replace(setup, view=_swap(setup.view, **changes))


def _put(setup: EffectorSetup, **changes: object) -> EffectorSetup:
    return dataclasses.replace(setup, effector=_swap(setup.effector, **changes))


def _swap(item: _Item, **changes: object) -> _Item:
    """Return a dataclass with some fields changed, by name."""
    swap: Callable[..., _Item] = dataclasses.replace
    return swap(item, **changes)


def _take_muscle(setup: EffectorSetup, name: str, field: str, *, each: bool) -> FreeNumber:
    design, pulls = setup.effector.design, setup.effector.pulls
    muscle, law = list_quantities(Muscle), list_quantities(MusclePull)
    groups = design.names if each else ()
    if field == "angle":
        known, begin = ANGLE, design.angles
        if not each:
            raise InputError("muscles have an angle each: free muscles.each.angle")
    elif pulls is not None and field in law:
        known, begin = law[field], np.array([getattr(one, field) for one in pulls])
    elif pulls is None and field in muscle and field != "length" and not muscle[field].whole:
        known = muscle[field]
        begin = np.array([getattr(placed.muscle, field) for placed in design.muscles])
    else:
        legal = law if pulls is not None else [k for k in muscle if not muscle[k].whole]
        raise InputError(
            f"'{name}' cannot be fitted: of these muscles angle, {', '.join(legal)} can"
        )
    if not each:
        begin = begin[:1]

    def put(setup: EffectorSetup, values: Floats) -> EffectorSetup:
        effector = setup.effector
        design, pulls = effector.design, effector.pulls
        one = np.broadcast_to(values, len(design.muscles)).tolist()
        if pulls is not None and field != "angle":
            laws = [
                dataclasses.replace(law, **{field: x}) for law, x in zip(pulls, one, strict=True)
            ]
            return _put(setup, pulls=tuple(laws))
        placed = tuple(
            dataclasses.replace(item, angle=x)
            if field == "angle"
            else dataclasses.replace(item, muscle=item.muscle.replace(**{field: x}))
            for item, x in zip(design.muscles, one, strict=True)
        )
        return _put(setup, design=design.replace(muscles=placed))

    return FreeNumber(name, known, groups, begin, put)

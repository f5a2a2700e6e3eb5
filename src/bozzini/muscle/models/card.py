"""What is known of a model of the catalogue: source, equation, constants, errata."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from ...checks import Limit, check_number, check_word, list_quantities, show_apart
from ...errors import InputError, MissingLawError
from ...results import Shown
from ...units import INTERNAL_UNITS

STATUSES = ("self-contained", "corrected", "fitted", "partial")
"""How much of a model the survey holds, worst last.

``self-contained``: all, right as printed. ``corrected``: all, once errata are mended. ``fitted``:
the form, with constants that its users have to fit. ``partial``: something essential is in the
cited paper only.
"""

SOURCES = ("measured", "fitted", "geometry", "material", "unit")
"""Where the value of a parameter comes from; ``unit`` is the unit other constants are in."""

BRAID_FIELDS = ("length", "outer_radius", "braid_angle", "gap", "dead_length")
"""What every model takes from a `Muscle`: the braid, over the length that contracts."""

SHAPE_FIELDS = ("length", "dead_length", "braid_angle")
"""What makes a difference where forces are measured: strain, and the braid's angle with it."""

WALL_FIELDS = (*BRAID_FIELDS, "inner_radius")
"""The same, and the thickness of the wall."""


@dataclass(frozen=True)
class Parameter(Shown):
    """A number that a model takes beside the `Muscle`.

    Parameters
    ----------
    name : str
        Keyword of the model's constructor, with the unit if it has one: ``"kappa1 [N/MPa]"``. The
        attributes are `name` and `unit`.
    what : str
        What it is, in a few words.
    bounds : tuple of float
        Smallest and largest legal value.
    source : str
        One of `SOURCES`.
    default : float, optional
        Value if it is not given; None if it has to be given.
    neutral : float, optional
        Value at which it makes no difference, where a fit may start; None if there is none.
    linear : bool
        Whether the model's force is linear in it, the other parameters being as they are.
    only_with : str
        A parameter at whose 0 this one is not needed; empty if it always is.
    whole : bool
        Whether it is a whole number.

    Raises
    ------
    InputError
        If the source is unknown, or default or neutral value lie outside the bounds.
    """

    name: str
    unit: str = field(init=False)
    what: str
    source: str = field(default="fitted", kw_only=True)
    default: float | None = field(default=None, kw_only=True)
    neutral: float | None = field(default=None, kw_only=True)
    bounds: tuple[float, float]
    linear: bool = field(default=False, kw_only=True)
    only_with: str = field(default="", kw_only=True)
    whole: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        _split_unit(self)
        check_word(f"source of {self.name}", self.source, SOURCES)
        low, high = self.bounds
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise InputError(f"bounds of {self.name} are {self.bounds}: low must be below high")
        for word, value in (("default", self.default), ("neutral value", self.neutral)):
            if value is not None and not low <= value <= high:
                shown = show_apart(value, low, high)
                raise InputError(
                    f"{word} of {self.name} is {shown[0]}: it must lie in [{shown[1]}, {shown[2]}]"
                )


def make_friction(what: str, *, unit: str = "", largest: float = 10.0) -> Parameter:
    """Return the parameter ``friction``, 0 or more, of which there is none by default."""
    return Parameter(
        f"friction [{unit}]", what, (0.0, largest), default=0.0, neutral=0.0, linear=True
    )


LARGEST = 1e9
"""Bound of a number whose legal range has no end, or one that depends on other numbers."""


def make_parameters(kind: type) -> tuple[Parameter, ...]:
    """Return the fields of a dataclass that are made by `quantity`, as parameters of a model."""

    def end(limit: Limit, largest: float) -> float:
        return largest if callable(limit) or math.isinf(limit) else float(limit)

    if not dataclasses.is_dataclass(kind):
        return ()
    defaults = {item.name: item.default for item in dataclasses.fields(kind)}
    found = []
    for name, known in list_quantities(kind).items():
        if known.words or known.kind not in INTERNAL_UNITS:
            continue
        default = defaults[name]
        low, high = end(known.low, -LARGEST), end(known.high, LARGEST)
        if known.low_open:
            low += 1e-9 * max(1.0, abs(low))
        found.append(
            Parameter(
                f"{name} [{known.unit}]",
                known.help,
                (low, high),
                source="fitted" if name in getattr(kind, "fit_fields", ()) else "measured",
                default=float(default) if isinstance(default, (int, float)) else None,
                whole=known.whole,
            )
        )
    return tuple(found)


@dataclass(frozen=True, kw_only=True)
class Choice(Shown):
    """A word that a model takes: one of several readings of its source.

    Parameters
    ----------
    name : str
        Keyword of the model's constructor.
    what : str
        What is chosen.
    words : tuple of str
        The choices; the first is the default.
    printed : str
        The default of ``as_printed=True``; empty for the same.
    """

    name: str
    what: str
    words: tuple[str, ...]
    printed: str = ""

    def __post_init__(self) -> None:
        if not self.words or (self.printed and self.printed not in self.words):
            raise InputError(f"choice {self.name} is {self.words}: it must hold '{self.printed}'")


@dataclass(frozen=True)
class Law(Shown):
    """A function that a model takes, since the survey does not hold it.

    Parameters
    ----------
    name : str
        Keyword of the model's constructor, with the unit of its answer: ``"hoop_stress [MPa]"``.
        The attributes are `name` and `unit`.
    arguments : tuple of str
        Its arguments with their units, ``"radius [mm]"`` for example: arrays of one shape.
    what : str
        What it is.
    paper : str
        The paper that holds it.
    required : bool
        Whether the model needs it; if not, the term it makes is left out.
    only_with : str
        A parameter at whose 0 it is not needed; empty if it always is.
    """

    name: str
    arguments: tuple[str, ...]
    unit: str = field(init=False)
    what: str
    paper: str
    required: bool = field(default=True, kw_only=True)
    only_with: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        _split_unit(self)


def _split_unit(item: Parameter | Law) -> None:
    """Take the unit out of a name such as ``"kappa1 [N/MPa]"``."""
    name, _, unit = item.name.partition(" [")
    object.__setattr__(item, "name", name)
    object.__setattr__(item, "unit", unit.removesuffix("]"))


_Item = TypeVar("_Item", Parameter, Choice)


@dataclass(frozen=True, kw_only=True)
class Card(Shown):
    """What is known of a model of the catalogue.

    Parameters
    ----------
    name : str
        Name in `MODELS`.
    title : str
        One line for a table.
    authors : str
    reference : str
        The paper the model comes from.
    equation : str
        Number in the thesis, ``"(2.16)"`` for example, or ``"not in the thesis"``.
    status : str
        One of `STATUSES`.
    parameters : tuple of Parameter
        What the constructor takes beside the `Muscle`.
    choices : tuple of Choice
        Words that the constructor takes.
    laws : tuple of Law
        Functions that the constructor takes.
    uses : tuple of str
        Fields of `Muscle` that make a difference; the others are the model's `unused`.
    errata : tuple of str
        What is wrong in the print and mended here, and what else to know.
    latex : str
        The equation as implemented.
    latex_printed : str, optional
        The equation as printed, where it differs.
    unprintable : str
        Why ``as_printed=True`` cannot be evaluated; empty if it can.
    missing : str
        What the survey does not hold, and which paper does; empty if nothing.

    Raises
    ------
    InputError
        If the status or a field is unknown, or a name is taken twice.
    """

    name: str
    title: str
    authors: str
    reference: str
    equation: str
    status: str
    parameters: tuple[Parameter, ...] = ()
    choices: tuple[Choice, ...] = ()
    laws: tuple[Law, ...] = ()
    uses: tuple[str, ...] = BRAID_FIELDS
    errata: tuple[str, ...] = ()
    latex: str
    latex_printed: str | None = None
    unprintable: str = ""
    missing: str = ""

    def __post_init__(self) -> None:
        check_word(f"status of {self.name}", self.status, STATUSES)
        names = self.keywords
        if len(set(names)) < len(names):
            raise InputError(f"{self.name} has a parameter, choice or law twice: {names}")
        partners = [item.only_with for item in self.parameters]
        partners += [item.only_with for item in self.laws]
        for partner in partners:
            if partner and partner not in names:
                raise InputError(f"{self.name} has no parameter '{partner}'")

    @property
    def keywords(self) -> tuple[str, ...]:
        """What the constructor takes beside the muscle, ``as_printed`` and ``hysteresis``."""
        return (
            *(item.name for item in self.parameters),
            *(item.name for item in self.choices),
            *(item.name for item in self.laws),
        )

    @property
    def place(self) -> str:
        """Where the equation is: the number with the thesis named, or that it is not there."""
        return self.equation if "thesis" in self.equation else f"thesis {self.equation}"

    @property
    def fitted(self) -> tuple[Parameter, ...]:
        """The parameters that a fit is for."""
        return tuple(item for item in self.parameters if item.source == "fitted")

    def check_parameter(self, name: str, value: float) -> float:
        """Return the value of a parameter as a float, if it is legal.

        Raises
        ------
        InputError
            If there is no such parameter, or the value is outside its bounds or not whole.
        """
        item = self._find(self.parameters, "parameter", name)
        low, high = item.bounds
        if type(value) is float and low <= value <= high and not item.whole:
            return value
        words = f"{name} of the model {self.name}"
        number = check_number(words, value, low=low, high=high, unit=item.unit)
        if item.whole and not number.is_integer():
            shown = show_apart(number, low, high)
            raise InputError(
                f"{words} is {shown[0]}: it must be a whole number in [{shown[1]}, {shown[2]}]"
            )
        return number

    def check_choice(self, name: str, word: str) -> str:
        """Return the word of a choice, if there is such a one.

        Raises
        ------
        InputError
            If there is no such choice, or it has no such word.
        """
        words = self._find(self.choices, "choice", name).words
        return check_word(f"{name} of the model {self.name}", word, words)

    def _find(self, items: tuple[_Item, ...], kind: str, name: str) -> _Item:
        for item in items:
            if item.name == name:
                return item
        legal = ", ".join(item.name for item in items) or "none"
        raise InputError(f"{kind} of {self.name} is '{name}': it must be one of {legal}")


def count_statuses(cards: Iterable[Card]) -> dict[str, int]:
    """Return how many of some models have each of `STATUSES`."""
    found = [card.status for card in cards]
    return {status: found.count(status) for status in STATUSES}


def describe_parameter(item: Parameter) -> str:
    """Return name, unit, source and default of a parameter as a line of text."""
    value = "must be given or fitted" if item.default is None else f"default {item.default:g}"
    if item.only_with:
        value = f"with {item.only_with} only" if item.default is None else value
    unit = f" [{item.unit}]" if item.unit else ""
    return f"  {item.name}{unit}: {item.what}; {item.source}; {value}"


def describe_card(card: Card) -> str:
    """Return source, equation, constants, laws and errata of a model as lines of text."""
    lines = [
        f"{card.name}: {card.title}",
        f"  {card.authors}; {card.place}; {card.status}",
        f"  {card.reference}",
        f"  {card.latex}",
    ]
    if card.latex_printed is not None:
        lines.append(f"  as printed: {card.latex_printed}")
    lines += map(describe_parameter, card.parameters)
    lines += [f"  {item.name}: {item.what}: {', '.join(item.words)}" for item in card.choices]
    for law in card.laws:
        need = "needed" if law.required else "may be left out"
        if law.only_with:
            need += f" with {law.only_with} only"
        lines.append(
            f"  law {law.name}({', '.join(law.arguments)}) [{law.unit}]: {law.what}; "
            f"{need}; it is in {law.paper}"
        )
    lines.append(f"  of the muscle: {', '.join(card.uses)}")
    lines += [f"  note: {text}" for text in card.errata]
    if card.unprintable:
        lines.append(f"  cannot be evaluated as printed: {card.unprintable}")
    if card.missing:
        lines.append(f"  missing: {card.missing}")
    return "\n".join(lines)


def take_keywords(card: Card, given: Mapping[str, Any], *, as_printed: bool) -> dict[str, object]:
    """Return parameters, choices and laws in the order of the card, defaults put in."""
    for name in given:
        if name not in card.keywords:
            legal = ", ".join(card.keywords) or "none beside the muscle"
            raise InputError(f"the model {card.name} takes no '{name}': it takes {legal}")
    taken: dict[str, object] = {}
    for item in card.parameters:
        value = given.get(item.name)
        if value is None:
            value = item.default
        if value is not None:
            taken[item.name] = card.check_parameter(item.name, value)
    absent = [
        item.name
        for item in card.parameters
        if item.name not in taken and _is_needed(item.only_with, taken)
    ]
    if absent:
        raise InputError(
            f"the model {card.name} must be given {', '.join(absent)}: the survey has no values"
        )
    for choice in card.choices:
        default = choice.printed if as_printed and choice.printed else choice.words[0]
        word = given.get(choice.name)
        taken[choice.name] = card.check_choice(choice.name, default if word is None else word)
    for law in card.laws:
        function = given.get(law.name)
        if function is not None:
            if not callable(function):
                raise InputError(
                    f"{law.name} of the model {card.name} is {function!r:.60}: it must be a "
                    f"function of {', '.join(law.arguments)}"
                )
            taken[law.name] = function
        elif law.required and _is_needed(law.only_with, taken):
            raise MissingLawError(
                f"the model {card.name} must be given the law {law.name}({', '.join(law.arguments)}"
                f"), {law.what}: it is in {law.paper}"
            )
    return taken


def _is_needed(only_with: str, taken: Mapping[str, object]) -> bool:
    return not only_with or taken.get(only_with, 0.0) != 0.0

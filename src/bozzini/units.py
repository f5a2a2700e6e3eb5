"""Units at the edge: text such as ``100 psi`` or ``36 deg`` becomes a number in mm, N, MPa, rad, s.

Inside the library everything is a plain float in these units; only the command line and study
files pass through here.
"""

from __future__ import annotations

import math
import re
import sys
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from .errors import UnitError

if TYPE_CHECKING:
    import pint


INTERNAL_UNITS = {
    "length": "mm",
    "area": "mm^2",
    "volume": "mm^3",
    "volume flow": "mm^3/s",
    "force": "N",
    "pressure": "MPa",
    "angle": "rad",
    "time": "s",
    "speed": "mm/s",
    "stiffness": "N/mm",
    "compliance": "mm/N",
    "line force": "N/mm",
    "moment": "N mm",
    "rigidity": "N mm^2",
    "curvature": "rad/mm",
    "density": "kg/m^3",
    "angle in turns": "turn",
    "voltage": "V",
    "frequency": "Hz",
    "dimensionless": "",
}
"""The unit that each kind of quantity has inside Bozzini."""


FULL_TURN_RAD = 2.0 * math.pi * (1.0 + 1e-9)
"""Largest angle that may be written without a unit: a full turn, rounded up [rad]."""

LARGEST = {"length": 1e6}
"""What a quantity may be at most, in either direction: a length of 1 km [mm]."""
_LARGEST_OTHER = 1e15

_EXAMPLES = {
    "length": "5mm, 0.5 cm, 0.2in",
    "area": "0.03 mm^2",
    "volume": "30 mm^3, 1 L",
    "volume flow": "10 L/min, 500 mm^3/s",
    "frequency": "0.5Hz, 30 1/min",
    "force": "0.5N, 50 gf",
    "pressure": "100psi, 689 kPa, 0.7MPa",
    "angle": "36deg, 0.63 rad",
    "time": "2s, 50ms",
    "speed": "5mm/s, 2 cm/s",
    "stiffness": "0.1N/mm",
    "compliance": "0.01mm/N, 10 mm/kN",
    "line force": "0.001N/mm, 1N/m",
    "moment": "5Nmm, 0.02 N m",
    "rigidity": "200Nmm^2, 2e-4 N m^2",
    "curvature": "0.01 1/mm, 0.5 deg/mm",
    "density": "1318 kg/m^3, 7.9 g/cm^3",
    "angle in turns": "0.5, 180deg",
    "voltage": "0.5V, 500mV",
    "dimensionless": "0.5",
}
# One number, then at most one unit. The number is not left to pint, which reads 5,0mm as 50 mm.
_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*((?:(?<=\s)1\s*/\s*)?[^\s0-9.,][^,]*)?")

# Pint has no Nmm and no mm2, and would not guess.
_NEWTON_TIMES = re.compile(r"N[·⋅*\s]*(?=(?:[mck]?m)(?![A-Za-z]))")
_SQUARE = re.compile(r"(?<=m)2$")
_PLAIN = ("%", "percent", "dimensionless")

# A unit is arithmetic to pint, which would try to work out kPa**9**9**9.
_LONGEST_UNIT = 40
_POWER = re.compile(r"(?:\*\*|\^)\s*[-+]?[0-9](?![\w.])(?!\s*(?:\*\*|\^|[²³¹⁰⁴-⁹]))")
_SIGN_OF_POWER = re.compile(r"\*\*|\^")
_SUPERSCRIPTS = re.compile(r"[⁻⁺]?[²³¹⁰⁴-⁹](?!\s*(?:\*\*|\^|[²³¹⁰⁴-⁹]))")
_SIGN_OF_SUPERSCRIPT = re.compile(r"[²³¹⁰⁴-⁹]")
_POWER_OF_BRACKETS = re.compile(r"\)\s*(?:\*\*|\^|[²³¹⁰⁴-⁹])")


@lru_cache(maxsize=1)
def _registry() -> pint.UnitRegistry[Any]:
    import pint

    return pint.UnitRegistry()


def parse_quantity(text: str | float, kind: str) -> float:
    """Turn text with a unit into a number in Bozzini's internal unit.

    A bare number is taken in the internal unit. As text, an angle beyond a full turn needs its
    unit: it is mostly meant in degrees.

    Parameters
    ----------
    text : str or float
        For example ``"5 mm"``, ``"100psi"``, ``"36deg"`` or ``5``.
    kind : str
        A key of `INTERNAL_UNITS`.

    Returns
    -------
    float
        The value in `INTERNAL_UNITS[kind]`.

    Raises
    ------
    UnitError
        If the unit is unknown or of another dimension, or the number is not finite or absurdly
        large (a length above 1 km), or text gives an angle beyond a full turn without a unit.
    """
    unit = INTERNAL_UNITS[kind]
    article = "an" if kind[0] in "aeiou" else "a"
    hint = f"give {article} {kind} such as {_EXAMPLES[kind]} (a bare number is in {unit})"
    if not unit:
        hint = f"give a plain number such as {_EXAMPLES[kind]}, without a unit"
    if isinstance(text, str):
        match = _QUANTITY.fullmatch(text)
        if match is None:
            raise UnitError(f"'{text}' is not a quantity: {hint}")
        value = float(match[1])
        if match[2]:
            given = match[2].strip()
            _check_unit(given, text, hint)
            if not unit and given not in _PLAIN:
                # An angle has no dimension to pint: 360 deg would be 6.28.
                raise UnitError(f"'{text}' has a unit: {hint}")
            if kind in ("moment", "rigidity"):
                given = _SQUARE.sub("^2", _NEWTON_TIMES.sub("N*", given))
            value = _convert(value, given, unit, text, hint)
        elif kind == "angle":
            check_bare_angle(value, text.strip())
    else:
        value = _take_number(text, hint)
    if not math.isfinite(value):
        raise UnitError(f"'{text}' is not a finite number: {hint}")
    largest = LARGEST.get(kind, _LARGEST_OTHER)
    if abs(value) > largest:
        what = f"{article} {kind}" if unit else "a plain number"
        shown = f"'{text}' is {value:g} {unit}".rstrip()
        legal = f"[-{largest:g}, {largest:g}] {unit}".rstrip()
        raise UnitError(f"{shown}: {what} must lie in {legal}")
    return value


def restate_typed(message: str, text: str, kind: str) -> str:
    """Return the message of an error with the value as it was given, in another unit than ours.

    The legal range that follows the value is repeated in that unit.
    """
    typed, own = text.strip(), INTERNAL_UNITS[kind]
    value, unit = parse_quantity(text, kind), typed.lstrip("+-.0123456789eE ")
    if not value or not unit or unit == own:
        return message
    number = r"[-+0-9.einf]+"
    shown = re.escape(f"{value:g} {own}")
    form = rf" is {shown}:(?:.*?([\[(])({number}), ({number})([\])]) {re.escape(own)})?"
    match = re.search(form, message)
    if match is None:
        return message
    if match[1] is None:
        return f"{message} ({typed} was given)"
    scale = parse_quantity(f"1{unit}", kind)
    low, high = (float(match[k]) / scale for k in (2, 3))
    return f"{message} ({typed} was given, {match[1]}{low:g}, {high:g}{match[4]} {unit} is legal)"


def check_bare_angle(value: float, text: str) -> None:
    """Raise `UnitError` for an angle [rad] beyond a full turn that was written without a unit."""
    if FULL_TURN_RAD < abs(value) < math.inf:
        raise UnitError(f"{text}: radians? write {text} deg, or {text} rad for so many radians")


def _check_unit(given: str, text: str, hint: str) -> None:
    """Refuse what would take pint long to work out."""
    if len(given) > _LONGEST_UNIT:
        shown = f"{text[:60]}..." if len(text) > 63 else text
        raise UnitError(
            f"'{shown}' has a unit of {len(given)} characters, {_LONGEST_UNIT} at most: {hint}"
        )
    for power, sign in ((_POWER, _SIGN_OF_POWER), (_SUPERSCRIPTS, _SIGN_OF_SUPERSCRIPT)):
        if len(power.findall(given)) != len(sign.findall(given)):
            raise UnitError(f"'{text}' has a power that is not one digit: {hint}")
    if len(_POWER_OF_BRACKETS.findall(given)) > 1:
        raise UnitError(f"'{text}' has more than one power of brackets: {hint}")


def _take_number(value: float, hint: str) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise UnitError(f"{value!r} is not a number: {hint}") from None
    except OverflowError:
        raise UnitError(f"a number above {sys.float_info.max:.3g} is not read: {hint}") from None


def _convert(value: float, given: str, unit: str, text: str, hint: str) -> float:
    import pint

    try:
        quantity: Any = _registry().Quantity(value, given)
    except pint.UndefinedUnitError:
        raise UnitError(f"unknown unit '{given}' in '{text}': {hint}") from None
    except Exception:  # pint's parser raises many kinds on malformed text
        raise UnitError(f"'{text}' is not a quantity: {hint}") from None
    try:
        return float(quantity.to(unit or "dimensionless").magnitude)
    except pint.DimensionalityError:
        raise UnitError(f"'{text}' has the wrong kind of unit: {hint}") from None
    except OverflowError:
        raise UnitError(f"'{text}' is not a finite number: {hint}") from None


def parse_vector(text: str, kind: str, *, size: int = 3) -> tuple[float, ...]:
    """Turn comma-separated quantities, for example ``12mm,-5mm,0``, into a tuple of floats.

    Raises
    ------
    UnitError
        If there are not `size` parts or a part is not a quantity of this kind.
    """
    parts = text.split(",")
    if len(parts) != size:
        raise UnitError(f"'{text}' has {len(parts)} part(s): give {size}, separated by commas")
    return tuple(parse_quantity(part, kind) for part in parts)


def add_unit(name: str, unit: str) -> str:
    """Return a name with its unit, as columns and JSON keys have it: ``length_mm``."""
    words = unit.replace(" ", "").replace("^", "").replace("/", "_per_")
    return f"{name}_{words}" if words else name


def show_unit(column: str) -> str:
    """Return the name of a column as a figure has it: ``length [mm]`` for ``length_mm``."""
    for unit in sorted(filter(None, INTERNAL_UNITS.values()), key=len, reverse=True):
        name = column.removesuffix(add_unit("", unit))
        if name != column:
            return f"{name.replace('_', ' ')} [{unit}]"
    return column

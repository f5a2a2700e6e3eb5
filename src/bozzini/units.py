"""Units at the edge: text such as ``100 psi`` or ``36 deg`` becomes a number in mm, N, MPa, rad, s.

Inside the library everything is a plain float in these units; only the command line and study
files pass through here.
"""

from __future__ import annotations

import math
import re
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache

from .errors import UnitError

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
    "line damping": "N s/mm^2",
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
    "line damping": "1e-6 N s/mm^2, 1 Pa s",
    "density": "1318 kg/m^3, 7.9 g/cm^3",
    "angle in turns": "0.5, 180deg",
    "voltage": "0.5V, 500mV",
    "dimensionless": "0.5",
}
_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
# One number, then at most one unit; 5,0mm is neither 5 mm nor 50 mm.
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*((?:(?<=\s)1\s*)?/[^,]*|[^\s0-9.,/][^,]*)?")
_PLAIN = ("%", "percent", "dimensionless")

# Units. A word that does not stand here is no unit. Titles of columns come here, and a list of all
# units there are makes a factor of many a word: of "in", "at" and "a" for example.

Factor = Fraction | float
_GRAVITY = Fraction("9.80665")
_POUND = Fraction("0.45359237")
_INCH = Fraction("25.4")
_PSI = _POUND * _GRAVITY / _INCH**2
_MERCURY = Fraction("133.322387415") / 10**6
_WATER = _GRAVITY / 10**6
_DEGREE, _TURN = math.pi / 180.0, 2.0 * math.pi

_DIMENSIONS = {
    "pressure": {"force": 1, "length": -2},
    "volume": {"length": 3},
    "mass": {"force": 1, "time": 2, "length": -1},
    "frequency": {"time": -1},
}
"""What these are made of; length, time, force, angle and voltage are made of nothing else."""

_SYMBOLS: Mapping[str, tuple[str, Factor]] = {
    "m": ("length", Fraction(1000)),
    "s": ("time", Fraction(1)),
    "N": ("force", Fraction(1)),
    "gf": ("force", _GRAVITY / 1000),
    "g": ("mass", Fraction(1, 10**6)),
    "Pa": ("pressure", Fraction(1, 10**6)),
    "bar": ("pressure", Fraction(1, 10)),
    "L": ("volume", Fraction(10**6)),
    "l": ("volume", Fraction(10**6)),
    "Hz": ("frequency", Fraction(1)),
    "V": ("voltage", Fraction(1)),
    "rad": ("angle", Fraction(1)),
}
"""Units that take a prefix, in mm, s, N, MPa, V and rad."""
_PREFIXES = {"n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3, "c": -2, "d": -1, "da": 1, "h": 2,
             "k": 3, "M": 6, "G": 9}  # fmt: skip
_NAMES = {"metre": "m", "meter": "m", "second": "s", "sec": "s", "newton": "N", "gram": "g",
          "pascal": "Pa", "litre": "L", "liter": "L", "hertz": "Hz", "volt": "V", "radian": "rad",
          "bar": "bar"}  # fmt: skip
_LONG_PREFIXES = {"": "", "nano": "n", "micro": "u", "milli": "m", "centi": "c", "deci": "d",
                  "kilo": "k", "mega": "M", "giga": "G"}  # fmt: skip
_OTHERS: Mapping[str, tuple[str, Factor]] = {
    **dict.fromkeys(("in", "inch", "inches", '"'), ("length", _INCH)),
    **dict.fromkeys(("ft", "foot", "feet"), ("length", 12 * _INCH)),
    **dict.fromkeys(("yd", "yard", "yards"), ("length", 36 * _INCH)),
    **dict.fromkeys(("mil", "mils", "thou"), ("length", _INCH / 1000)),
    **dict.fromkeys(("micron", "microns"), ("length", Fraction(1, 1000))),
    "lbf": ("force", _POUND * _GRAVITY),
    "ozf": ("force", _POUND * _GRAVITY / 16),
    "kp": ("force", _GRAVITY),
    "dyn": ("force", Fraction(1, 10**5)),
    **dict.fromkeys(("lb", "lbs", "pound", "pounds"), ("mass", _POUND / 1000)),
    "oz": ("mass", _POUND / 16000),
    "psi": ("pressure", _PSI),
    "ksi": ("pressure", 1000 * _PSI),
    "atm": ("pressure", Fraction("0.101325")),
    "torr": ("pressure", Fraction(101325, 760 * 10**6)),
    "mmHg": ("pressure", _MERCURY),
    "cmHg": ("pressure", 10 * _MERCURY),
    "inHg": ("pressure", _INCH * _MERCURY),
    "mmH2O": ("pressure", _WATER),
    "cmH2O": ("pressure", 10 * _WATER),
    "inH2O": ("pressure", _INCH * _WATER),
    "cc": ("volume", Fraction(1000)),
    **dict.fromkeys(("min", "mins", "minute", "minutes"), ("time", Fraction(60))),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), ("time", Fraction(3600))),
    **dict.fromkeys(("day", "days"), ("time", Fraction(86400))),
    **dict.fromkeys(("deg", "degs", "degree", "degrees", "°"), ("angle", _DEGREE)),
    **dict.fromkeys(("turn", "turns", "rev", "revolution", "revolutions"), ("angle", _TURN)),
    "arcmin": ("angle", _DEGREE / 60.0),
    "arcsec": ("angle", _DEGREE / 3600.0),
}
_WITH_PREFIX = ("mm", "cm", "km", "kN", "kgf", "kg", "kPa", "hPa", "kHz", "Hz", "bar", "rad")
_ANY_CASE = {name.lower(): name for name in (*_WITH_PREFIX, *_OTHERS)}
"""Units that mean the same in capitals; of MPa and mPa, for example, the capital decides."""
_MIXED = ("mM", "cM", "kM")
"""Such words are neither lengths nor capitals all through, as MM is in a table of capitals."""

_ALSO = {"curvature": ("1/mm",)}
"""Units of a kind whose dimensions are others than those of its own unit."""

# All pressures are gauge, which may be said; some tables have absolute ones.
_GAUGE = re.compile(
    r"(?<=psi|bar|kpa|mpa)g$|(?<=\w)\s*(?:\((?:g|gauge)\)|\b(?:gauge|gage|g|rel|relative)\b)$",
    re.IGNORECASE,
)
_ABSOLUTE = re.compile(
    r"(?<=psi|bar|kpa|mpa)\s*(?:a|\(a\))$|\s*\b\(?abs(?:olute)?\.?\)?$", re.IGNORECASE
)

_LONGEST_UNIT = 40
_RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺"
_DIGITS = str.maketrans(_RAISED, "0123456789-+")
_TOKEN = re.compile(
    r"\s*(?P<word>(?:mm|cm|in)H2O"
    rf"|[numckM]?N(?=[nuµmck]?m(?![^\W\d_{_RAISED}]))"  # Nmm is N mm
    rf'|[^\W\d_{_RAISED}]+|[°"%]|\))'
    rf"(?:\s*(?:\*\*|\^)\s*(?P<power>[-+]?[0-9])|(?P<raised>[⁻⁺]?[{_RAISED[:10]}])|(?P<glued>[234]))?"
    rf"(?![\d{_RAISED}.])(?!\s*(?:\*\*|\^))|\s*(?P<mark>[*·⋅/(])"
)


class _NoUnitError(Exception):
    """A text is no unit; the words say why, and None that a word is not known."""


@dataclass
class _Unit:
    """What a unit is worth, and the powers of the kinds of its words.

    `turned` is whether one kind stands above and below the line, as in mm/mm.
    """

    factor: Factor = Fraction(1)
    powers: Counter[str] = field(default_factory=Counter)
    turned: bool = False

    def times(self, other: _Unit, power: int) -> None:
        """Multiply by a power of another unit."""
        self.factor *= other.factor**power
        self.turned |= other.turned
        for kind, own in other.powers.items():
            self.turned |= self.powers[kind] * own * power < 0
            self.powers[kind] += own * power

    def list_dimensions(self) -> dict[str, int]:
        """Return the powers of length, time, force, angle and voltage that are not 0."""
        found: Counter[str] = Counter()
        for kind, power in self.powers.items():
            for name, own in _DIMENSIONS.get(kind, {kind: 1}).items():
                found[name] += own * power
        return {name: power for name, power in found.items() if power}


def _find_word(word: str) -> _Unit:
    """Return the unit of one word, or raise `_NoUnitError`."""
    known = _OTHERS.get(word) or _SYMBOLS.get(word)
    if known:
        return _Unit(known[1], Counter({known[0]: 1}))
    for prefix, power in _PREFIXES.items():
        symbol = _SYMBOLS.get(word.removeprefix(prefix))
        if symbol and word.startswith(prefix):
            return _Unit(symbol[1] * Fraction(10) ** power, Counter({symbol[0]: 1}))
    low = word.lower()
    for name, short in _NAMES.items():
        long, found, rest = low.partition(name)
        if found and rest in ("", "s") and long in _LONG_PREFIXES:
            return _find_word(_LONG_PREFIXES[long] + short)
    if _ANY_CASE.get(low, word) == word or word in _MIXED:
        raise _NoUnitError
    return _find_word(_ANY_CASE[low])


_FALL = _Unit(1000 * _GRAVITY, Counter({"length": 1, "time": -2}))
"""The acceleration that makes a mass a weight [mm/s^2]."""


@lru_cache(maxsize=256)
def _read_unit(text: str) -> _Unit:
    """Return the unit that a text is, or raise `_NoUnitError`.

    It is words with powers of one digit; ``*``, ``/`` or a blank between; and brackets.
    """
    if len(text) > _LONGEST_UNIT:
        raise _NoUnitError(f"has a unit of {len(text)} characters, {_LONGEST_UNIT} at most")
    rest = re.sub(r"^\s*1\s*(?=/)", "", text).strip()
    stack, signs, sign, complete = [_Unit()], [1], 1, False
    while rest:
        match = _TOKEN.match(rest)
        if match is None:
            power_is_wrong = re.search(rf"\*\*|\^|[{_RAISED}]", text)
            raise _NoUnitError(
                "has a power that is not one digit" if power_is_wrong else "is not a quantity"
            )
        rest, word, mark = rest[match.end() :].strip(), match["word"], match["mark"]
        digits = match["power"] or match["raised"] or match["glued"] or "1"
        power = int(digits.translate(_DIGITS))
        if word == ")" or (mark and mark not in "/(") or (mark == "/" and stack[-1].powers):
            if not complete or (word and len(stack) == 1):
                raise _NoUnitError("has a unit whose brackets, signs or powers do not go together")
        if mark == "(":
            stack, signs, sign = [*stack, _Unit()], [*signs, sign], 1
        elif mark:
            sign = -1 if mark == "/" else 1
        else:
            unit = stack.pop() if word == ")" else _find_word(word)
            stack[-1].times(unit, (signs.pop() if word == ")" else sign) * power)
            sign = 1
        complete = not mark
    if not complete or len(stack) > 1:
        raise _NoUnitError("has a unit whose brackets, signs or powers do not go together")
    return stack[0]


def parse_quantity(text: str | float, kind: str) -> float:
    """Turn text with a unit into a number in Bozzini's internal unit.

    A bare number is taken in the internal unit. As text, an angle beyond a full turn needs its
    unit: it is mostly meant in degrees.

    Units in capitals all through are read where they can be nothing else, as tables of CAD have
    them: MM, CM, KM and KPA are mm, cm, km and kPa. A capital that means another thing is not
    corrected: Mm is a million metres, and mM, cM, kM, MPA and mPa are refused.

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
    hint = f"{_ask(kind)} (a bare number is in {unit})" if unit else f"{_ask(kind)}, without a unit"
    if isinstance(text, str):
        match = _QUANTITY.fullmatch(text)
        if match is None:
            raise UnitError(f"'{text}' is not a quantity: {hint}")
        value = float(match[1])
        if match[2]:
            value *= _find_factor(match[2], kind, text, hint)
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


def check_bare_angle(value: float, text: str) -> None:
    """Raise `UnitError` for an angle [rad] beyond a full turn that was written without a unit."""
    if FULL_TURN_RAD < abs(value) < math.inf:
        raise UnitError(f"{text}: radians? write {text} deg, or {text} rad for so many radians")


def _ask(kind: str) -> str:
    """Return what messages ask for."""
    article = "an" if kind[0] in "aeiou" else "a"
    what = f"{article} {kind}" if INTERNAL_UNITS[kind] else "a plain number"
    return f"give {what} such as {_EXAMPLES[kind]}"


def parse_unit(text: str, kind: str) -> float:
    """Return the value of a unit as titles of columns have it.

    Parameters
    ----------
    text : str
        For example ``"kPa"``, ``"in kPa"``, or ``"0.1 mm"`` for so many. The word "in" before a
        unit is none. Where a force is asked for, a unit of mass stands for its weight.
    kind : str
        A key of `INTERNAL_UNITS`.

    Raises
    ------
    UnitError
        If it is no unit of this kind.
    """
    unit = drop_in(text)
    match = re.match(rf"{_NUMBER}(?!\s*/)\s*", unit)
    number, unit = (float(match[0]), unit[match.end() :]) if match else (1.0, unit)
    return number * _find_factor(unit, kind, text, _ask(kind), weighs=True)


def drop_in(text: str) -> str:
    """Return the unit in a text: of ``in %`` it is ``%``; ``in`` alone is the inch."""
    return re.sub(r"^in\s+(?=\S)", "", text.strip(), flags=re.IGNORECASE)


def is_unit(text: str) -> bool:
    """Whether a text is a unit of any kind, as titles of columns have it: ``kPa``, ``in %``."""
    unit = drop_in(text)
    if unit in _PLAIN:
        return True
    try:
        return bool(_read_unit(_GAUGE.sub("", unit)).powers)
    except _NoUnitError:
        return False


def is_mass(text: str) -> bool:
    """Whether a text is a unit of mass, which stands for a weight where a force is asked for."""
    try:
        return set(_read_unit(text).powers) == {"mass"}
    except _NoUnitError:
        return False


def _find_factor(given: str, kind: str, text: str, hint: str, *, weighs: bool = False) -> float:
    """Return the value of one unit, or raise `UnitError`; `text` is what it was part of."""
    own, unit = INTERNAL_UNITS[kind], given.strip()
    if not own:
        if unit in _PLAIN:
            return 1.0 if unit == "dimensionless" else 0.01
        raise UnitError(f"'{text}' has a unit: {hint}")
    if kind == "pressure":
        if _ABSOLUTE.search(unit):
            raise UnitError(
                f"'{text}' is an absolute pressure: pressures are gauge; take off that of the air, "
                f"101.325 kPa, and {hint}"
            )
        unit = _GAUGE.sub("", unit)
    try:
        found = _read_unit(unit)
    except _NoUnitError as error:
        shown = f"{text[:60]}..." if len(text) > 63 else text
        if str(error):
            raise UnitError(f"'{shown}' {error}: {hint}") from None
        meant = unit.lower() if unit in _MIXED else "MPa" if unit.lower() == "mpa" else ""
        more = f"; is it {meant}?" if meant else ""
        raise UnitError(f"unknown unit '{unit}' in '{shown}'{more}: {hint}") from None
    if unit == "mPa" and kind == "pressure":
        raise UnitError(f"'{text}' is in thousandths of a Pa: write MPa or kPa; {hint}")
    known = [_read_unit(word) for word in (own, *_ALSO.get(kind, ()))]
    if not found.turned:
        for item in known:
            if item.list_dimensions() == found.list_dimensions():
                return float(found.factor / known[0].factor)
        if found.powers["mass"] == 1 and (kind == "pressure" or (weighs and kind == "force")):
            weight = _Unit()
            weight.times(found, 1)
            weight.times(_FALL, 1)
            if weight.list_dimensions() == known[0].list_dimensions():
                return float(weight.factor / known[0].factor)
    more = (
        ", a mass: for its weight write kgf, gf or lbf" if kind == "force" and is_mass(unit) else ""
    )
    raise UnitError(f"'{text}' has the wrong kind of unit{more}: {hint}")


def _take_number(value: float, hint: str) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise UnitError(f"{value!r} is not a number: {hint}") from None
    except OverflowError:
        raise UnitError(f"a number above {sys.float_info.max:.3g} is not read: {hint}") from None


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

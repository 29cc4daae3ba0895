"""Numbers with units as people write them: ``650mm``, ``15deg``, ``3 Nm``, ``90 rpm``.

A quantity is a number and a unit and nothing else: no sums, no names. It is converted to the unit
that is wanted, with one rounding, so that ``650mm`` is exactly ``0.65`` where metres are wanted
and ``15deg`` exactly ``math.radians(15)``.

Angles count as a dimension of their own here: ``15deg`` is no ratio, and ``1/s`` no angular speed.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from functools import cache
from typing import Any, NamedTuple, SupportsFloat

#: Exponents of length, mass, time and angle.
Dimension = tuple[int, int, int, int]


class Unit(NamedTuple):
    """A unit: ``factor * (pi / 180) ** degrees`` of the SI unit of its dimension."""

    factor: Fraction
    degrees: int
    dimension: Dimension

    def __mul__(self, other: Unit) -> Unit:  # type: ignore[override]  # a product, no repetition
        """Return the product of two units."""
        total = tuple(a + b for a, b in zip(self.dimension, other.dimension, strict=True))
        return Unit(
            self.factor * other.factor,
            self.degrees + other.degrees,
            (total[0], total[1], total[2], total[3]),
        )

    def power(self, exponent: int) -> Unit:
        """Return a whole power of the unit."""
        length, mass, time, angle = (e * exponent for e in self.dimension)
        return Unit(self.factor**exponent, self.degrees * exponent, (length, mass, time, angle))


def _unit(factor: str, dimension: Dimension, degrees: int = 0) -> Unit:
    return Unit(Fraction(factor), degrees, dimension)


_NONE: Dimension = (0, 0, 0, 0)
_LENGTH: Dimension = (1, 0, 0, 0)
_MASS: Dimension = (0, 1, 0, 0)
_TIME: Dimension = (0, 0, 1, 0)
_ANGLE: Dimension = (0, 0, 0, 1)
_FREQUENCY: Dimension = (0, 0, -1, 0)
_SPEED_OF_TURNING: Dimension = (0, 0, -1, 1)
_FORCE: Dimension = (1, 1, -2, 0)
_WORK: Dimension = (2, 1, -2, 0)
_POWER: Dimension = (2, 1, -3, 0)

#: Every unit that is read, by its symbol. Symbols are those of SI: case matters.
UNITS: dict[str, Unit] = {
    "1": _unit("1", _NONE),
    "%": _unit("0.01", _NONE),
    "m": _unit("1", _LENGTH),
    "dm": _unit("0.1", _LENGTH),
    "cm": _unit("0.01", _LENGTH),
    "mm": _unit("1e-3", _LENGTH),
    "um": _unit("1e-6", _LENGTH),
    "nm": _unit("1e-9", _LENGTH),
    "in": _unit("0.0254", _LENGTH),
    "ft": _unit("0.3048", _LENGTH),
    "rad": _unit("1", _ANGLE),
    "mrad": _unit("1e-3", _ANGLE),
    "urad": _unit("1e-6", _ANGLE),
    "deg": _unit("1", _ANGLE, 1),
    "arcmin": _unit("1/60", _ANGLE, 1),
    "arcsec": _unit("1/3600", _ANGLE, 1),
    "rev": _unit("360", _ANGLE, 1),
    "s": _unit("1", _TIME),
    "ms": _unit("1e-3", _TIME),
    "us": _unit("1e-6", _TIME),
    "ns": _unit("1e-9", _TIME),
    "min": _unit("60", _TIME),
    "h": _unit("3600", _TIME),
    "Hz": _unit("1", _FREQUENCY),
    "kHz": _unit("1e3", _FREQUENCY),
    "rpm": _unit("6", _SPEED_OF_TURNING, 1),
    "kg": _unit("1", _MASS),
    "g": _unit("1e-3", _MASS),
    "mg": _unit("1e-6", _MASS),
    "t": _unit("1e3", _MASS),
    "lb": _unit("0.45359237", _MASS),
    "N": _unit("1", _FORCE),
    "mN": _unit("1e-3", _FORCE),
    "kN": _unit("1e3", _FORCE),
    "Nm": _unit("1", _WORK),
    "mNm": _unit("1e-3", _WORK),
    "kNm": _unit("1e3", _WORK),
    "Nmm": _unit("1e-3", _WORK),
    "Ncm": _unit("1e-2", _WORK),
    "J": _unit("1", _WORK),
    "kJ": _unit("1e3", _WORK),
    "W": _unit("1", _POWER),
    "mW": _unit("1e-3", _POWER),
    "kW": _unit("1e3", _POWER),
}
#: Other ways to write a symbol.
_ALIASES = {
    "°": "deg", "º": "deg", "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad",
    "µm": "um", "μm": "um", "µs": "us", "μs": "us", "µrad": "urad", "μrad": "urad",
    "sec": "s", "inch": "in", "1/min": "rpm",
}  # fmt: skip

_NUMBER = r"[+-]?(?:\d[\d_]*(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*(.*?)\s*", re.DOTALL)
_FACTOR = re.compile(r"([*/·⋅ ]?)\s*([^\W\d_]+|[°º%]|1)(?:(?:\^|\*\*)([+-]?\d)|(\d))?(?![\d^])\s*")
_SUPERSCRIPT = re.compile("[⁻¹²³⁴]+")
_PLAIN = str.maketrans("⁻¹²³⁴", "-1234")


class QuantityError(ValueError):
    """A text that is no quantity in the unit that is wanted; its text says why."""


@cache
def parse_unit(text: str) -> Unit:
    """Return a unit from its text, such as ``mm``, ``kg m^2``, ``deg/s^2``, ``N m/rad``.

    Raises
    ------
    QuantityError
    """
    plain = _SUPERSCRIPT.sub(lambda found: "^" + found[0].translate(_PLAIN), text.strip())
    if plain in _ALIASES:
        return UNITS[_ALIASES[plain]]
    found, place = UNITS["1"], 0
    while place < len(plain):
        factor = _FACTOR.match(plain, place)
        symbol = _ALIASES.get(factor[2], factor[2]) if factor else ""
        if factor is None or symbol not in UNITS:
            raise QuantityError(f"{text.strip()!r} is not a known unit{_hint(text.strip())}")
        exponent = int(factor[3] or factor[4] or 1)
        found = found * UNITS[symbol].power(-exponent if factor[1] == "/" else exponent)
        place = factor.end()
    return found


def _hint(text: str) -> str:
    folded = {symbol.casefold(): symbol for symbol in UNITS}
    symbol = folded.get(text.casefold())
    return f": {symbol}?" if symbol else ""


def parse_quantity(text: str, unit: str) -> float:
    """Return a quantity in a unit; a bare number is in that unit.

    Parameters
    ----------
    text : str
    unit : str
        The unit that is wanted, ``"1"`` for none.

    Raises
    ------
    QuantityError
        For a text that is no number with a unit, or whose unit is of another dimension.
    """
    try:
        return float(text)  # inf and nan too: what they may be is the caller's to say
    except ValueError:
        pass
    if re.match(r"\s*[+-]?\d+,\d", text):
        raise QuantityError(f"{text.strip()!r} is no number: a decimal point is needed")
    match = _QUANTITY.fullmatch(text)
    if match is None or match[2][:1] in "*/·⋅":  # 0.7*m is an expression, 0.7m a quantity
        raise QuantityError(f"{text.strip()!r} is no number")
    return convert(match[1], match[2], unit)


def convert(number: str, given: str, wanted: str) -> float:
    """Return a number in one unit as a float in another.

    Raises
    ------
    QuantityError
    """
    source, target = parse_unit(given), parse_unit(wanted)
    if source.dimension != target.dimension:
        what = "a plain number" if wanted == "1" else f"a number in {wanted}"
        raise QuantityError(f"the unit {given} does not fit: {what} is needed")
    plain = float(number)
    if source == target or plain == 0.0 or not math.isfinite(plain):
        return plain
    try:
        value = float(exact_number(number) * source.factor / target.factor)
    except OverflowError:
        return math.copysign(math.inf, plain)
    degrees = source.degrees - target.degrees
    if degrees < 0:
        return value * (180 / math.pi) ** -degrees
    return value * (math.pi / 180) ** degrees if degrees else value


def exact_number(text: str) -> Fraction:
    """Return a finite number's exact value, 0 for what a double cannot distinguish from it.

    Python would write out all digits of ``1e-999999999``.
    """
    return Fraction(text) if float(text) else Fraction(0)


def as_quantity(value: Any, unit: str) -> float:
    """Return a number, or a text that is a quantity, as a float in a unit; it may be infinite.

    Raises
    ------
    QuantityError
        For anything else: no number, a boolean, NaN, another dimension.
    """
    if isinstance(value, str):
        number = parse_quantity(value, unit)
    elif isinstance(value, bool) or not isinstance(value, SupportsFloat):
        raise QuantityError(f"{value!r} is no number")
    else:
        try:
            number = float(value)
        except (OverflowError, TypeError, ValueError):
            raise QuantityError(f"{value!r} is no number that a double can hold") from None
    if math.isnan(number):
        raise QuantityError("nan is no number")
    return number


def in_degrees(value: Any) -> Any:
    """Return numbers that are in degrees as quantities, also within lists."""
    if isinstance(value, list | tuple):
        return [in_degrees(v) for v in value]
    try:
        return math.radians(as_quantity(value, "1"))
    except QuantityError:
        return value  # with a unit of its own, or wrong

"""Numbers with an error and a unit, and how they are written."""

from __future__ import annotations

import math
from collections.abc import Iterator
from decimal import ROUND_HALF_EVEN, Context, Decimal
from typing import Any, Literal, NoReturn

from pmopt.units import ONE

#: Which way the true value lies from one that is known from one side only.
Sign = Literal["", "<=", ">="]
#: Smallest power of ten of a size that is written without one.
_SMALL = -4
#: Relative rounding of a double: no error is stated below it.
_ROUNDING = 2.0**-52
_WIDE = Context(prec=400, rounding=ROUND_HALF_EVEN)


class Quantity(float):
    """A number with its error and unit: it prints as ``12.345 ± 0.012 m^3``.

    In arithmetic, comparisons and NumPy it is its value, a float; ``value, error = quantity``
    takes it apart.

    Attributes
    ----------
    value : float
    error : float
        A standard error or, with ``bounded``, a bound of the error. 0 of an exact number, NaN of
        one that is not known.
    unit : str
        ``"1"`` where there is none.
    sign : {"", "<=", ">="}
        Of a number that is known from one side: where the true one is. It prints before the value.
    bounded : bool
    """

    __slots__ = ("bounded", "error", "sign", "unit")
    error: float
    unit: str
    sign: Sign
    bounded: bool

    def __new__(
        cls, value: float, error: float = math.nan, unit: str = ONE, sign: Sign = "",
        bounded: bool = False,
    ) -> Quantity:  # fmt: skip
        """Return the quantity."""
        self = super().__new__(cls, value)
        for name, given in (("error", float(error)), ("unit", unit), ("sign", sign),
                            ("bounded", bounded)):  # fmt: skip
            object.__setattr__(self, name, given)
        return self

    def __setattr__(self, name: str, value: Any) -> NoReturn:
        raise AttributeError(f"{name} of a quantity cannot be set")

    def __reduce__(self) -> tuple[Any, ...]:
        return Quantity, (self.value, self.error, self.unit, self.sign, self.bounded)

    @property
    def value(self) -> float:
        """The value, a plain float."""
        return float.__pos__(self)

    @property
    def bound(self) -> Literal["found", "proven"]:
        """Whether an extreme is proven, or the true one may lie beyond it."""
        return "found" if self.sign else "proven"

    def in_unit(self, unit: str, bounded: bool = False, sign: Sign = "") -> Quantity:
        """Return the same numbers with a unit."""
        return Quantity(self.value, self.error, unit, sign, bounded)

    def __eq__(self, other: object) -> bool:
        """Return whether a number is the value, or a pair the value and the error."""
        if isinstance(other, tuple):
            return (self.value, self.error) == other
        found: bool = float.__eq__(self, other)
        return found  # or NotImplemented: arrays compare themselves

    def __ne__(self, other: object) -> bool:
        if isinstance(other, tuple):
            return (self.value, self.error) != other
        found: bool = float.__ne__(self, other)
        return found

    __hash__ = float.__hash__

    def __iter__(self) -> Iterator[float]:
        return iter((self.value, self.error))

    def __str__(self) -> str:
        if math.isnan(self):
            return "-"
        if self.error == 0:
            unit = "" if self.unit == ONE else f" {self.unit}"
            text = f"{self.value + 0.0:.6g}{unit}"
        else:
            text = uncertain(self.value, self.error, self.unit, self.bounded)
        return f"{self.sign} {text}" if self.sign else text

    __repr__ = __str__

    def __format__(self, form: str) -> str:
        """Return the value in a format, or the whole text without one."""
        return float.__format__(self, form) if form else str(self)


def uncertain(value: float, error: float, unit: str = ONE, bound: bool = False) -> str:
    """Return a value with its error and unit as one text, e.g. ``12.345 ± 0.012 m^3``.

    The error has two digits and the value ends at the same place. Where that would need zeros that
    are no digits, both stand over one power of ten: ``(2.15 ± 0.17)e8 mm^3``.

    Parameters
    ----------
    value, error : float
        A value that is NaN is ``-``; an error that is not known is ``?``. An exact value has the
        error 0 and six digits.
    unit : str
    bound : bool
        The error is a bound, not a standard error; the text says so behind the unit.
    """
    text = _with_error(value, error)
    text += "" if unit == ONE else f" {unit}"
    return f"{text} (bound)" if bound and text[0] != "-" else text


def _with_error(value: float, error: float) -> str:
    if math.isnan(value):
        return "-"
    if not (math.isfinite(value) and math.isfinite(error) and error >= 0):
        return f"{float(value):.6g} ± ?"
    if error == 0:
        return f"{value + 0.0:.6g} ± 0"
    error = max(error, _ROUNDING * abs(value))
    place = int(f"{error:.1e}".partition("e")[2]) - 1  # of the error's second digit
    whole, beside = (_units_of(x, place) for x in (value, error))
    size = max(len(str(abs(whole))), len(str(beside))) - 1 + place
    if place <= 0 and size >= _SMALL:
        return f"{_placed(whole, place)} ± {_placed(beside, place)}"
    return f"({_placed(whole, place - size)} ± {_placed(beside, place - size)})e{size}"


def _units_of(value: float, place: int) -> int:
    """Return a value rounded to a place, in units of that place."""
    return int(Decimal(repr(float(value))).scaleb(-place, _WIDE).to_integral_value(ROUND_HALF_EVEN))


def _placed(units: int, place: int) -> str:
    """Return a number of units of a decimal place as text, with no digits beyond."""
    return f"{Decimal(units).scaleb(place, _WIDE):f}"

"""Figures as documents print them, and whether a printed one still holds."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from pmopt.quantity import uncertain

#: How many combined standard errors two measurements of one thing may be apart.
ERRORS = 3.0
#: How much two estimates of one error may differ: each is good to about a fifth.
_RATIO = 2.0
_NUMBER = re.compile(r"[-+]?(?:\d{1,3}(?:,\d{3})+|\d+)(?:\.\d+)?(?:e[-+]?\d+)?")
_PLUS_MINUS = "±"


@dataclass(frozen=True)
class Figure:
    """A figure of a document.

    Attributes
    ----------
    text : str
        As it is to be printed.
    value : float, optional
        Of its number, in the unit that is printed; None where every digit has to agree.
    error : float
        Standard error of the value.
    within : float
        How far a printed number may be away for other reasons, e.g. as the result of a search.
    """

    text: str
    value: float | None = None
    error: float = 0.0
    within: float = 0.0

    def holds(self, printed: str) -> bool:
        """Return whether what is printed is this figure, within the errors of both."""
        printed = plain(printed)
        if printed == plain(self.text):
            return True
        if self.value is None or _NUMBER.sub("#", printed) != _NUMBER.sub("#", self.text):
            return False
        numbers = _NUMBER.findall(printed)
        error = 0.0
        if _PLUS_MINUS in printed:
            error = number(numbers[1])
            ratio = _RATIO * max(error, last_place(numbers[1]))
            if not self.error <= ratio or not error <= _RATIO * self.error + last_place(numbers[1]):
                return False
        away = abs(number(numbers[0]) - self.value)
        allowed = ERRORS * math.hypot(self.error, error or self.error) + self.within
        return away <= allowed + 0.5000001 * last_place(numbers[0])


#: Stands for what is printed, whatever it is: a time, say.
ANYTHING = Figure("*")


def sampled(value: float, error: float, unit: str = "1") -> Figure:
    """Return a sampled number with its error, as the product writes them."""
    return Figure(uncertain(value, error, unit), value, error)


def rounded(value: float, form: str, error: float = 0.0, within: float = 0.0) -> Figure:
    """Return a number that stands without its error, in a format such as ``.3f``."""
    text = format(value, form)
    return Figure(text.removeprefix("-") if number(text) == 0 else text, value, error, within)


def number(text: str) -> float:
    """Return the value of a printed number."""
    return float(text.replace(",", ""))


def last_place(text: str) -> float:
    """Return one unit in the last printed digit."""
    mantissa, _, exponent = text.partition("e")
    return float(10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2])))


def plain(text: str) -> str:
    """Return text with single spaces."""
    return " ".join(text.split())

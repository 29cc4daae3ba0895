"""Values with their first and second derivatives by one variable, on whole arrays at once.

Forward-mode differentiation: every operation carries value, first and second derivative along, so
that derivatives are exact up to rounding. Outside the domain of a function all three are NaN.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]


class Jet(NamedTuple):
    """A function's value, first and second derivative at each of N places, (N,) each."""

    value: Values
    first: Values
    second: Values


def variable(places: Values) -> Jet:
    """Return the variable itself."""
    return Jet(places, np.ones_like(places), np.zeros_like(places))


def constant(value: float, places: Values) -> Jet:
    """Return a number at every place."""
    return Jet(np.full_like(places, value), np.zeros_like(places), np.zeros_like(places))


def _linear(combine: Callable[[Values, Values], Values]) -> Callable[[Jet, Jet], Jet]:
    return lambda a, b: Jet(*(combine(x, y) for x, y in zip(a, b, strict=True)))


add = _linear(operator.add)
subtract = _linear(operator.sub)


def negative(a: Jet) -> Jet:
    """Return -a."""
    return Jet(-a.value, -a.first, -a.second)


def multiply(a: Jet, b: Jet) -> Jet:
    """Return a b."""
    return Jet(
        a.value * b.value,
        a.first * b.value + a.value * b.first,
        a.second * b.value + 2 * a.first * b.first + a.value * b.second,
    )


def divide(a: Jet, b: Jet) -> Jet:
    """Return a / b."""
    value = a.value / b.value
    first = (a.first - value * b.first) / b.value
    return Jet(value, first, (a.second - 2 * first * b.first - value * b.second) / b.value)


def chain(a: Jet, value: Values, slope: Values, curvature: Values) -> Jet:
    """Return f(a) from f and its derivatives at a's value."""
    return Jet(value, slope * a.first, slope * a.second + curvature * a.first**2)


def power(a: Jet, exponent: float) -> Jet:
    """Return a to a constant power; whole powers of negative numbers are real."""

    def term(factor: float, lowered: float) -> Values:
        return factor * a.value**lowered if factor else np.zeros_like(a.value)

    n = exponent
    return chain(a, a.value**n, term(n, n - 1), term(n * (n - 1), n - 2))


def _sin(a: Jet) -> Jet:
    sine, cosine = np.sin(a.value), np.cos(a.value)
    return chain(a, sine, cosine, -sine)


def _cos(a: Jet) -> Jet:
    sine, cosine = np.sin(a.value), np.cos(a.value)
    return chain(a, cosine, -sine, -cosine)


def _tan(a: Jet) -> Jet:
    value = np.tan(a.value)
    slope = 1 + value**2
    return chain(a, value, slope, 2 * value * slope)


def _asin(a: Jet) -> Jet:
    slope = 1 / np.sqrt(1 - a.value**2)
    return chain(a, np.arcsin(a.value), slope, a.value * slope**3)


def _acos(a: Jet) -> Jet:
    slope = 1 / np.sqrt(1 - a.value**2)
    return chain(a, np.arccos(a.value), -slope, -a.value * slope**3)


def _atan(a: Jet) -> Jet:
    slope = 1 / (1 + a.value**2)
    return chain(a, np.arctan(a.value), slope, -2 * a.value * slope**2)


def _sqrt(a: Jet) -> Jet:
    root = np.sqrt(a.value)
    return chain(a, root, 0.5 / root, -0.25 / (root * a.value))


def _exp(a: Jet) -> Jet:
    value = np.exp(a.value)
    return chain(a, value, value, value)


def _log(a: Jet) -> Jet:
    return chain(a, np.log(a.value), 1 / a.value, -1 / a.value**2)


def _scaled(factor: float) -> Callable[[Jet], Jet]:
    return lambda a: Jet(factor * a.value, factor * a.first, factor * a.second)


#: Functions by name; ``rad`` turns degrees into radians, ``deg`` radians into degrees.
FUNCTIONS: dict[str, Callable[[Jet], Jet]] = {
    "sin": _sin,
    "cos": _cos,
    "tan": _tan,
    "asin": _asin,
    "acos": _acos,
    "atan": _atan,
    "sqrt": _sqrt,
    "exp": _exp,
    "log": _log,
    "rad": _scaled(np.pi / 180),
    "deg": _scaled(180 / np.pi),
}

"""Unit names, in one place."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Literal

Kind = Literal["length", "angle"]
#: Parameters may also be plain ratios.
ParameterKind = Literal["length", "angle", "ratio"]
LengthUnit = Literal["m", "mm"]

ANGLE = "rad"
#: A length unit in m.
METRES: dict[LengthUnit, float] = {"m": 1.0, "mm": 1e-3}
WATT = "W"
JOULE = "J"
#: Written where a number has no unit, so that every number has an entry.
ONE = "1"


def unit_of(kind: ParameterKind, length_unit: LengthUnit) -> str:
    """Return the unit of a coordinate or parameter of this kind."""
    return {"length": length_unit, "angle": ANGLE, "ratio": ONE}[kind]


def measure_unit(kinds: Iterable[Kind], length_unit: LengthUnit) -> str:
    """Return the unit of a volume over coordinates of these kinds, e.g. ``m^3``, ``m rad^2``."""
    counts = Counter(unit_of(kind, length_unit) for kind in kinds)
    parts = [
        unit if counts[unit] == 1 else f"{unit}^{counts[unit]}"
        for unit in (length_unit, ANGLE)
        if counts[unit]
    ]
    return " ".join(parts)


def product_unit(units: Iterable[str]) -> str:
    """Return the unit of a product: ``m^3`` times ``m^2`` is ``m^5``."""
    counts: Counter[str] = Counter()
    for unit in units:
        for part in unit.split():
            symbol, _, exponent = part.partition("^")
            counts[symbol] += int(exponent or 1)
    del counts[ONE]
    return " ".join(s if n == 1 else f"{s}^{n}" for s, n in counts.items()) or ONE


def pretty(unit: str) -> str:
    """Return the unit as pictures show it: ``m^3`` becomes ``m³``."""
    return unit.translate(
        {ord("^"): None, ord("2"): "²", ord("3"): "³", ord("4"): "⁴", ord("5"): "⁵", ord("6"): "⁶"}
    )


def per_second(unit: str, order: int = 1) -> str:
    """Return the unit of a derivative by time, e.g. ``rad/s^2``."""
    return f"{unit}/s" if order == 1 else f"{unit}/s^{order}"


def effort_unit(kind: Kind) -> str:
    """Return the unit of a force along a length or of a torque about an angle."""
    return "N" if kind == "length" else "N m"


def exact(value: float) -> str:
    """Return a number as it was given: the shortest text that reads back as the same double."""
    return repr(float(value)).removesuffix(".0")


def span_text(ends: tuple[float, float], unit: str) -> str:
    """Return a range as it was given, ``-0.1 .. 0.1 m``."""
    return f"{exact(ends[0])} .. {exact(ends[1])} {unit}"

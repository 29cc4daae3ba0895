"""Whether joint positions and coordinates are within their limits, and by how much not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pmopt.mechanisms.mechanism import Coordinate, Mechanism, Ranges, within, wrap_angle
from pmopt.units import ONE, exact


@dataclass(frozen=True)
class Beyond:
    """A joint position or coordinate that is not within its limits.

    ``miss`` is by how much, of angles modulo a turn; all in ``unit``.
    """

    name: str
    value: float
    lower: float
    upper: float
    miss: float
    unit: str

    def __str__(self) -> str:
        """Return it in words."""
        unit = "" if self.unit == ONE else f" {self.unit}"
        limits = f"[{exact(self.lower)}, {exact(self.upper)}]{unit}"
        text = f"{self.name} = {self.value:.6g}{unit} misses {limits} by {self.miss:.6g}{unit}"
        if self.unit == "rad":
            return text
        return f"{text} ({'too close' if self.value < self.lower else 'too far'})"

    @property
    def short(self) -> str:
        """Only by how much."""
        return f"{self.name} by {self.miss:.6g}" + ("" if self.unit == ONE else f" {self.unit}")

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form; a side that is open is None."""
        return {
            "name": self.name,
            "value": self.value,
            "lower": self.lower if np.isfinite(self.lower) else None,
            "upper": self.upper if np.isfinite(self.upper) else None,
            "miss": self.miss,
            "unit": self.unit,
        }


def of_limb(limited: str, name: str) -> bool:
    """Return whether limits on one name hold for a value: its own, or a limb's of that kind."""
    return name == limited or name.rpartition("_")[0] == limited


class Limits:
    """Ranges of coordinates against which many values are checked."""

    def __init__(
        self, mechanism: Mechanism, ranges: Ranges, coordinates: Sequence[Coordinate]
    ) -> None:
        self._mechanism = mechanism
        self._ranges = [(c, ranges[c.name]) for c in coordinates if c.name in ranges]
        self._pairs: dict[tuple[str, ...], list[tuple[str, Coordinate, tuple[float, float]]]] = {}

    def beyond(self, values: Mapping[str, float]) -> tuple[Beyond, ...]:
        """Return what of the values is not within the ranges, in the order of the coordinates."""
        names = tuple(values)
        pairs = self._pairs.get(names)
        if pairs is None:
            pairs = [(n, c, ends) for c, ends in self._ranges for n in names if of_limb(c.name, n)]
            self._pairs[names] = pairs
        found = []
        for name, c, (low, high) in pairs:
            value = values[name]
            if within(value, (low, high), c.kind):
                continue
            if c.kind == "angle":
                miss = min(abs(wrap_angle(value - low)), abs(wrap_angle(value - high)))
            else:
                miss = max(low - value, value - high)
            found.append(Beyond(name, value, low, high, miss, self._mechanism.unit(c)))
        return tuple(found)


def shown(values: Mapping[str, float]) -> str:
    """Return coordinates in words, with all their digits."""
    return ",".join(f"{name}={exact(value)}" for name, value in values.items())


def out_of_strokes(
    mechanism: Mechanism,
    misses: Sequence[tuple[Beyond, ...]],
    pose: Mapping[str, float],
    where: str,
) -> str:
    """Say which joints are out of their strokes and by how much, of the nearest branch."""
    best = min(misses, key=lambda some: sum(b.miss for b in some))
    names = [c.name for c in mechanism.joints]
    said = []
    for one in best:
        number = names.index(one.name)
        limb = f"{mechanism.limbs[number].name}, " if number < len(mechanism.limbs) else ""
        said.append(f"{limb}{str(one).replace('misses [', 'misses its stroke [')}")
    return f"{where}: {shown(pose)} is out of reach: {'; '.join(said)}"

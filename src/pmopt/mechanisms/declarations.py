"""What a mechanism's parameters, coordinates and limbs are called, and what they measure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pmopt.numerics.elementary import cos
from pmopt.units import Kind, ParameterKind

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
#: Design parameters by name, complete and validated; None for an unset optional one.
Parameters = Mapping[str, float | None]
#: Ranges by coordinate name.
Ranges = Mapping[str, tuple[float, float]]
JacobianKind = Literal["raw", "homogenized"]

#: Physical range of lengths, in the mechanism's length unit: beyond it squares and fourth powers
#: of lengths leave what doubles can distinguish. Coordinates may lie further out.
SMALLEST_LENGTH, LARGEST_LENGTH = 1e-6, 1e6
LARGEST_COORDINATE = 1e9


@dataclass(frozen=True)
class Parameter:
    """A design parameter.

    Attributes
    ----------
    name : str
        The symbol of the literature.
    kind : {"length", "angle", "ratio"}
    default : float or None
        None for an optional parameter that is unset.
    bounds : tuple of float or None
        Optimisation bounds; None where it is no design variable.
    positive : bool
        False where the physical range includes 0.
    meaning, source : str
        What it is, and who chose default and bounds.
    """

    name: str
    kind: ParameterKind
    default: float | None
    bounds: tuple[float, float] | None
    positive: bool
    meaning: str
    source: str

    @property
    def optional(self) -> bool:
        """Whether the parameter may be unset."""
        return self.default is None

    def allowed(self) -> str:
        """Return the physical range in words."""
        if self.kind == "angle":
            return "a number from -pi to pi"
        text = f"a number from {SMALLEST_LENGTH:g} to {LARGEST_LENGTH:g}"
        return text if self.positive else f"{text}, or 0"

    def accepts(self, value: float) -> bool:
        """Return whether the value is within the physical range."""
        if self.kind == "angle":
            return abs(value) <= math.pi
        return SMALLEST_LENGTH <= value <= LARGEST_LENGTH or (value == 0 and not self.positive)


@dataclass(frozen=True)
class Coordinate:
    """A pose or joint coordinate."""

    name: str
    kind: Kind
    meaning: str


@dataclass(frozen=True)
class Limb:
    """A limb.

    Attributes
    ----------
    name : str
    joints : str
        From base to platform (``P_a`` is a parallelogram).
    description : str
        With the joints' names.
    joint_names : tuple of str
        What the joints are called everywhere: one that turns or slides in one way is called as its
        coordinate is (``theta1``), others by kind and point (``U_C1``).
    """

    name: str
    joints: str
    description: str
    joint_names: tuple[str, ...] = ()


def as_number(value: Any) -> float | None:
    """Return a number as a float, None for anything else (text, booleans, NaN)."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.floating | np.integer):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return None if math.isnan(number) else number


def wrap_angle(angle: float) -> float:
    """Return the angle in (-pi, pi]."""
    wrapped = math.remainder(angle, 2 * math.pi)
    return math.pi if wrapped <= -math.pi else wrapped


def within(value: float, limits: tuple[float, float], kind: Kind) -> bool:
    """Return whether a joint position is within its limits; angles count modulo a full turn."""
    low, high = limits
    if kind == "length":
        return low <= value <= high
    if not high - low < 2 * math.pi:
        return True
    return cos(value - (low + high) / 2) >= cos((high - low) / 2) - 4e-16

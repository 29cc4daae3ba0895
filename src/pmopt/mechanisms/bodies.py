"""Rigid bodies of a mechanism: what its dynamics are declared by.

Masses are in kg, inertias in kg m^2; dimensions and centres of mass are in the mechanism's length
unit, densities in kg/m^3. A body moves with the link that follows a joint of a limb, or with the
platform, and is declared in that link's frame:

- the platform's is that of its pose: origin at its centre, axes of its rotation;
- after R and U: origin at the joint, z along the link (the axis of the P joint that follows, or
  the line to the next joint's point), x along the joint's last axis;
- after C: origin at the next joint's point, z along the axis, x along the next joint's first axis;
- after S: origin at the joint, z along the P joint that follows, x the platform's x axis: what
  follows slides only;
- after P and Pa: axes of the link before (the base's are x, y, z), origin at the next joint's
  point and at the bar's end;
- the long bars of Pa, both together as if on one line: origin at the joint's point, z along the
  bars, x along the joint's axis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pmopt.mechanisms.mechanism import PLATFORM, Matrix, Vector

#: Density of the bodies that are ours, kg/m^3.
STEEL = 7800.0

Part = Literal["link", "bars"]


@dataclass(frozen=True)
class Body:
    """A rigid body.

    Attributes
    ----------
    name : str
    limb : int
        Number of the limb from 0, or PLATFORM.
    joint : int
        Number, from 0, of the limb's joint whose link it belongs to.
    mass : float
        kg.
    centre : (3,) float64
        Centre of mass in the link's frame, in the mechanism's length unit.
    inertia : (3, 3) float64
        About the centre of mass, along the link's axes, kg m^2.
    part : {"link", "bars"}
        Of a joint Pa: its moving short side or both long bars.
    source : str
        Who chose the figures.
    """

    name: str
    limb: int
    joint: int
    mass: float
    centre: Vector
    inertia: Matrix
    part: Part = "link"
    source: str = ""


@dataclass(frozen=True)
class MassProperties:
    """Mass, centre and inertia about it, of a shape in its own frame; see :class:`Body`."""

    mass: float
    centre: Vector
    inertia: Matrix

    def times(self, count: int) -> MassProperties:
        """Return as many of them in the same place."""
        return replace(self, mass=count * self.mass, inertia=count * self.inertia)

    def at(self, offset: tuple[float, float, float]) -> MassProperties:
        """Return the same moved by an offset, in the mechanism's length unit."""
        return replace(self, centre=self.centre + np.array(offset))

    def body(
        self, name: str, limb: int = PLATFORM, joint: int = 0, part: Part = "link",
        source: str = "ours: steel",
    ) -> Body:  # fmt: skip
        """Return the body that has these properties."""
        return Body(name, limb, joint, self.mass, self.centre, self.inertia, part, source)


def point_mass(mass: float, place: Sequence[float]) -> MassProperties:
    """Return a mass without extent, at a place in the mechanism's length unit."""
    return MassProperties(mass, np.array(place, dtype=float), np.zeros((3, 3)))


def tube(
    diameter: float, length: float, unit: float, bore: float = 0.0, density: float = STEEL
) -> MassProperties:
    """Return a straight tube from the origin along z; a rod where the bore is 0.

    Parameters
    ----------
    diameter, length, bore : float
        In the mechanism's length unit; ``unit`` is that unit in m.
    """
    d, b, h = diameter * unit, bore * unit, length * unit
    mass = density * math.pi / 4 * (d * d - b * b) * h
    axial = mass * (d * d + b * b) / 8
    across = axial / 2 + mass * h * h / 12
    return MassProperties(mass, np.array([0.0, 0.0, length / 2]), np.diag([across, across, axial]))


def disc(
    diameter: float, thickness: float, unit: float, normal: int = 2, density: float = STEEL
) -> MassProperties:
    """Return a disc about the origin, across axis number ``normal``."""
    flat = tube(diameter, thickness, unit, density=density)
    order = [k for k in range(3) if k != normal]
    moments = np.empty(3)
    moments[[*order, normal]] = np.diag(flat.inertia)
    return MassProperties(flat.mass, np.zeros(3), np.diag(moments))


def plate(size: tuple[float, float, float], unit: float, density: float = STEEL) -> MassProperties:
    """Return a box about the origin with these sides along x, y and z."""
    sides = np.array(size) * unit
    mass = density * float(sides.prod())
    square = sides * sides
    return MassProperties(mass, np.zeros(3), np.diag(mass * (square.sum() - square) / 12))


def triangle(side: float, thickness: float, unit: float, density: float = STEEL) -> MassProperties:
    """Return an equilateral triangular plate about the origin, across z, a corner on the x axis."""
    s, h = side * unit, thickness * unit
    mass = density * math.sqrt(3) / 4 * s * s * h
    flat = mass * s * s / 24 + mass * h * h / 12
    return MassProperties(mass, np.zeros(3), np.diag([flat, flat, mass * s * s / 12]))

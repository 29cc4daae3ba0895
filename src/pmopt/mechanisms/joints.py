"""Joints of limbs at one configuration: what mobility and drawings read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pmopt.mechanisms.declarations import Vector

#: Stands for a limb's number where a segment belongs to the platform.
PLATFORM = -1

JointKind = Literal["R", "P", "C", "U", "S", "Pa"]


@dataclass(frozen=True)
class Joint:
    """A joint of a limb at one configuration, in the base frame.

    Attributes
    ----------
    kind : {"R", "P", "C", "U", "S", "Pa"}
        Revolute, prismatic, cylindrical, universal, spherical, planar parallelogram.
    point : (3,) float64
        A point of the axis; the centre of U and S; for Pa the middle of its base-side short bar.
    axes : tuple of (3,) float64
        Unit vectors. R, P, C: the axis; U: both, the one nearer to the base first; S: none;
        Pa: the common direction of its four revolute axes.
    bar : (3,) float64 or None
        Pa only: the long bar, from its base side to its platform side.
    drive : (str, int) or None
        The actuated coordinate and which elementary freedom of the joint it is (C: 0 turns,
        1 slides; U: 0 turns about the first axis, 1 about the second; R, P, Pa: 0).
    """

    kind: JointKind
    point: Vector
    axes: tuple[Vector, ...] = ()
    bar: Vector | None = None
    drive: tuple[str, int] | None = None


@dataclass(frozen=True)
class Chain:
    """A limb at one configuration: its joints from base to platform."""

    name: str
    joints: tuple[Joint, ...]

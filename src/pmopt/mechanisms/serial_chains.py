"""Joints of a limb as they are declared: by the names of points and vectors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from pmopt.kernels.vectors import Vec3
from pmopt.mechanisms.joints import JointKind


@dataclass(frozen=True)
class Along:
    """The direction from one point to another."""

    start: str
    end: str


@dataclass(frozen=True)
class Normal:
    """The direction across two vectors, of their cross product.

    A layout takes ``otherwise`` where they are parallel: any direction is across both then.
    """

    first: Way
    second: Way
    otherwise: Vec3 | None = None


#: A vector: a constant, the name of one, from a point to another, or what is made of those.
Way = Vec3 | str | tuple[str, str] | Along | Normal


@dataclass(frozen=True)
class Revolute:
    """A revolute joint: a point of its axis, the axis, and the coordinate that drives it."""

    kind: ClassVar[JointKind] = "R"
    point: str
    axis: Way
    drives: str | None = None


@dataclass(frozen=True)
class Prismatic:
    """A prismatic joint: a point of its axis, the axis, and the coordinate that drives it."""

    kind: ClassVar[JointKind] = "P"
    point: str
    axis: Way
    drives: str | None = None


@dataclass(frozen=True)
class Cylindrical:
    """A cylindrical joint: a point of its axis, the axis, and what drives its turn or slide."""

    kind: ClassVar[JointKind] = "C"
    point: str
    axis: Way
    turn: str | None = None
    slide: str | None = None


@dataclass(frozen=True)
class Universal:
    """A universal joint: its centre, both axes from the base on, and what drives one of them."""

    kind: ClassVar[JointKind] = "U"
    point: str
    first: Way
    second: Way
    drives_first: str | None = None
    drives_second: str | None = None


@dataclass(frozen=True)
class Spherical:
    """A spherical joint: its centre."""

    kind: ClassVar[JointKind] = "S"
    point: str


@dataclass(frozen=True)
class Parallelogram:
    """A planar parallelogram: where a long bar is hinged at the base's side, axis and bar."""

    kind: ClassVar[JointKind] = "Pa"
    point: str
    axis: Way
    bar: Way
    drives: str | None = None


AnyJoint = Revolute | Prismatic | Cylindrical | Universal | Spherical | Parallelogram
#: Names of a joint's elementary freedoms, in order; a joint of one has no need of it.
FREEDOM_NAMES: Mapping[JointKind, tuple[str, ...]] = {
    "R": ("turn",), "P": ("slide",), "C": ("turn", "slide"), "U": ("first", "second"),
    "S": ("x", "y", "z"), "Pa": ("turn",),
}  # fmt: skip


def ways_of(joint: AnyJoint) -> tuple[Way, ...]:
    """Return a joint's axes, then the bar of a parallelogram."""
    match joint:
        case Parallelogram():
            return joint.axis, joint.bar
        case Universal():
            return joint.first, joint.second
        case Spherical():
            return ()
    return (joint.axis,)


def drive_of(joint: AnyJoint) -> tuple[str, int] | None:
    """Return the coordinate that drives a joint and which of its freedoms it is."""
    match joint:
        case Spherical():
            return None
        case Universal():
            names = (joint.drives_first, joint.drives_second)
        case Cylindrical():
            names = (joint.turn, joint.slide)
        case _:
            names = (joint.drives, None)
    return next(((name, k) for k, name in enumerate(names) if name is not None), None)


@dataclass(frozen=True)
class SerialChain:
    """A limb: its joints from base to platform, and its links for pictures and clearances.

    Attributes
    ----------
    name : str
    joints : tuple of joints
    bars : tuple of str
        Points that straight bars join, one after the other.
    spoke : str or None
        The point that a radius of the platform leads to from the platform's place.
    """

    name: str
    joints: tuple[AnyJoint, ...]
    bars: tuple[str, ...] = ()
    spoke: str | None = None


class Freedom(NamedTuple):
    """An elementary freedom of a joint, by names, and how often it counts.

    ``which`` is ``"turn"`` or ``"slide"`` of a C joint, ``"first"`` or ``"second"`` of a U joint.
    """

    joint: str
    which: str = ""
    weight: float = 1.0

"""The structure of a mechanism: its joints, links and platform by the names of their points.

A kernel function of the mechanism returns the points of a configuration as a record. The structure
says which of them joints, links and platform are at. From it come the layout (joints as arrays) and
the text of two kernel functions, skeleton and posture: each is declared once, in one place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from pmopt.errors import unknown_name
from pmopt.mechanisms.declarations import Limb, Vector
from pmopt.mechanisms.joints import PLATFORM, Chain, Joint, JointKind
from pmopt.mechanisms.serial_chains import (
    FREEDOM_NAMES,
    Along,
    Cylindrical,
    Freedom,
    Normal,
    Parallelogram,
    Prismatic,
    Revolute,
    SerialChain,
    Spherical,
    Universal,
    drive_of,
    ways_of,
)
from pmopt.mechanisms.structure_text import Evaluated, Text, value_of

#: What a structure is declared with: a file of the catalogue takes all of it from here.
__all__ = [
    "Along", "Cylindrical", "Evaluated", "Freedom", "Normal", "Parallelogram", "PostureRow",
    "Prismatic", "Revolute", "Segment", "SerialChain", "SkeletonRow", "Spherical", "Structure",
    "Universal",
]  # fmt: skip

#: The platform's place, 3 numbers, and its rotation, 9, row by row: how skeleton and posture begin.
_PLACE, _ROTATION = slice(0, 3), slice(3, 12)


class Segment(NamedTuple):
    """A straight line that is drawn and kept clear: its ends by name, and the limb it is of.

    ``limb`` is :data:`PLATFORM` for a radius of the platform; ``meets`` is the limb at its end.
    """

    start: str
    end: str
    limb: int
    meets: int


class SkeletonRow(NamedTuple):
    """Where the numbers of a skeleton are."""

    place: slice
    rotation: slice
    segments: slice
    cones: slice
    size: int


class PostureRow(NamedTuple):
    """Where the numbers of a posture are; ``layout`` has points and axes of all joints."""

    place: slice
    rotation: slice
    joints: slice
    followed: slice
    layout: slice
    size: int


@dataclass(frozen=True, eq=False)
class Structure:
    """Joints, links and platform of a mechanism, by the names of points and vectors.

    Attributes
    ----------
    points : Evaluated
        ``points(*pose, constants)``: the points and vectors of a configuration.
    place : str
        The platform's centre.
    chains : tuple of SerialChain
        The limbs.
    rotation : str or None
        The platform's rotation, a :class:`pmopt.kernels.vectors.Rotation`; None where it never
        turns.
    cones : Evaluated or None
        ``cones(at, constants)``: cosines of the cone angles of passive U and S joints, by joint.
    positions : Evaluated or None
        ``positions(at, constants)``: positions of the actuated and of the followed joints, and
        vectors that postures alone need. Without it there is no posture.
    followed : mapping
        Passive joints that motions show: each the sum of freedoms.
    """

    points: Evaluated
    place: str
    chains: tuple[SerialChain, ...]
    rotation: str | None = None
    cones: Evaluated | None = None
    positions: Evaluated | None = None
    followed: Mapping[str, tuple[Freedom, ...]] = field(default_factory=dict)

    @property
    def cone_names(self) -> tuple[str, ...]:
        """Names of the joints whose cone angles a skeleton has."""
        return () if self.cones is None else tuple(self.cones.record._fields)

    @property
    def segments(self) -> tuple[Segment, ...]:
        """What is drawn: bars limb by limb, then the platform's radii."""
        bars = [
            Segment(start, end, number, number)
            for number, chain in enumerate(self.chains)
            for start, end in zip(chain.bars, chain.bars[1:], strict=False)
        ]
        spokes = [
            Segment(self.place, chain.spoke, PLATFORM, number)
            for number, chain in enumerate(self.chains)
            if chain.spoke is not None
        ]
        return (*bars, *spokes)

    @property
    def skeleton_row(self) -> SkeletonRow:
        """Where the numbers of a skeleton are."""
        ends = _ROTATION.stop + 6 * len(self.segments)
        size = ends + len(self.cone_names)
        return SkeletonRow(_PLACE, _ROTATION, slice(_ROTATION.stop, ends), slice(ends, size), size)

    @property
    def posture_row(self) -> PostureRow:
        """Where the numbers of a posture are."""
        drives = sum(drive_of(joint) is not None for c in self.chains for joint in c.joints)
        first = _ROTATION.stop + drives
        layout = first + len(self.followed)
        size = layout + sum(3 + 3 * len(ways_of(j)) for c in self.chains for j in c.joints)
        return PostureRow(
            _PLACE, _ROTATION, slice(_ROTATION.stop, first), slice(first, layout),
            slice(layout, size), size,
        )  # fmt: skip

    def followed_terms(
        self, limbs: Sequence[Limb]
    ) -> dict[str, tuple[tuple[int, int, float], ...]]:
        """Return the followed joints as sums of (limb, number of the freedom in it, weight).

        Raises
        ------
        InputError
            For a name that no joint or freedom has.
        """
        known: dict[str, tuple[int, int, JointKind]] = {}
        for number, (limb, chain) in enumerate(zip(limbs, self.chains, strict=False)):
            before = 0
            for name, joint in zip(limb.joint_names, chain.joints, strict=False):
                known[name] = number, before, joint.kind
                before += len(FREEDOM_NAMES[joint.kind])
        found = {}
        for follower, freedoms in self.followed.items():
            terms = []
            for freedom in freedoms:
                if freedom.joint not in known:
                    raise unknown_name(f"structure: followed {follower}", freedom.joint, [*known])
                number, before, kind = known[freedom.joint]
                names = FREEDOM_NAMES[kind]
                which = freedom.which or names[0]
                if which not in names:
                    raise unknown_name(f"structure: followed {follower}", which, names)
                terms.append((number, before + names.index(which), freedom.weight))
            found[follower] = tuple(terms)
        return found

    # -- layout ----------------------------------------------------------------------------

    def layout(self, at: Any, constants: Any) -> tuple[Chain, ...]:
        """Return every limb's joints of a configuration, in the base frame.

        Parameters
        ----------
        at : record
            What :attr:`points` returns.
        constants : record or tuple
            Of the kernel, for :attr:`positions`.
        """
        moved: list[Any] = []

        def named(name: str) -> Any:
            value, known = at, self.points.record
            if name.partition(".")[0] not in known._fields and self.positions is not None:
                if not moved:
                    moved.append(self.positions.function(at, constants))
                value = moved[0]
            for part in name.split("."):
                value = getattr(value, part)
            return value

        chains = []
        for chain in self.chains:
            joints = []
            for joint in chain.joints:
                ways = [_array(value_of(way, named)) for way in ways_of(joint)]
                bar = ways.pop() if joint.kind == "Pa" else None
                point = _array(named(joint.point))
                joints.append(Joint(joint.kind, point, tuple(ways), bar, drive_of(joint)))
            chains.append(Chain(chain.name, tuple(joints)))
        return tuple(chains)

    # -- kernel functions ------------------------------------------------------------------

    def skeleton(self, pose: Sequence[str]) -> Callable[..., tuple[float, ...]]:
        """Return the kernel function ``skeleton(*pose, constants)``.

        It returns the platform's position (3) and rotation (9, row by row), both ends of each of
        :attr:`segments` (6 each), and the cosine of each cone angle.
        """
        text = Text(self.points, pose)
        numbers = text.platform(self.place, self.rotation)
        for segment in self.segments:
            numbers += [text.point(segment.start), text.point(segment.end)]
        if self.cones is not None:
            text.call("cones", self.cones, "at")
            numbers.append([f"cones.{name}" for name in self.cone_names])
        return text.function("skeleton", numbers)

    def posture(
        self, pose: Sequence[str], joints: Sequence[str]
    ) -> Callable[..., tuple[float, ...]] | None:
        """Return the kernel function ``posture(*pose, constants)``; None without positions.

        It returns the platform as the skeleton does, the positions of the actuated ``joints``,
        those of :attr:`followed`, then of every joint its point, its axes and, of a parallelogram,
        its bar.
        """
        if self.positions is None:
            return None
        text = Text(self.points, pose)
        text.call("moved", self.positions, "at")
        numbers = text.platform(self.place, self.rotation)
        numbers.append([text.number("moved", name) for name in (*joints, *self.followed)])
        for chain in self.chains:
            for joint in chain.joints:
                numbers.append(text.point(joint.point))
                numbers += [text.vector(way) for way in ways_of(joint)]
        return text.function("posture", numbers)


def _array(value: Any) -> Vector:
    return np.array([value.x, value.y, value.z], dtype=float)

"""A motion as a record: its task and its results."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.motion.dynamics import Mover
from pmopt.analysis.record import OfSubject
from pmopt.mechanisms.mechanism import (
    Coordinate,
    Vector,
)

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Trajectory:
    """What is asked of a motion: coordinates and their derivatives by time.

    Attributes
    ----------
    space : {"task", "joint"}
        Whether the coordinates are those of the pose or the actuated joints.
    t : (N,) float64
        s, ascending.
    values, rates, accelerations : (N, n) float64
        In the mechanism's length unit and rad, per s and s^2.
    """

    space: Literal["task", "joint"]
    t: Vector
    values: Values
    rates: Values
    accelerations: Values


@dataclass(frozen=True)
class Course:
    """Some coordinates along a motion: values, rates and accelerations, (N, k) each."""

    coordinates: tuple[Coordinate, ...]
    values: Values
    rates: Values
    accelerations: Values


@dataclass(frozen=True)
class Span:
    """Instants in a row at which the motion is infeasible, for one reason.

    Attributes
    ----------
    first, last, worst : int
        Numbers of the instants; ``worst`` is where the miss is largest.
    what : str
        The limb, joint, limit or singularity.
    miss : float
        By how much, at the worst instant, in ``unit``.
    text : str
        In words, for the worst instant.
    """

    first: int
    last: int
    worst: int
    what: str
    miss: float
    unit: str
    text: str


@dataclass(frozen=True)
class Approach:
    """Where a motion comes near a singularity without meeting it.

    Attributes
    ----------
    t : float
        s, between instants or at one.
    lci : float
        The least there.
    efforts : dict of str to float
        Of the actuated joints whose efforts there exceed all that instants show, N and N m.
    """

    t: float
    lci: float
    efforts: dict[str, float]

    def text(self, units: Mapping[str, str]) -> str:
        """Return the approach in words; ``units`` are those of efforts by joint."""
        listed = ", ".join(f"{k} {v:.4g} {units[k]}" for k, v in self.efforts.items())
        return (
            f"near a singularity at t = {self.t:.9g} s (LCI = {self.lci:.3g}), where efforts peak: "
            f"{listed}; at other instants they are smaller"
        )


class Centres(Mapping[str, Values]):
    """Position, velocity and acceleration of centres of mass along a motion, by name of the body.

    They are computed when they are asked for: of a long motion they are most of all that there is.

    Parameters
    ----------
    mover : Mover
    pose : Course
        NaN where the motion is not known.
    names : tuple of str
        Of the mover's bodies.
    """

    def __init__(self, mover: Mover, pose: Course, names: tuple[str, ...]) -> None:
        self._mover, self._pose, self._names = mover, pose, names
        self._whole: Values | None = None

    def part(self, instants: slice) -> Values:
        """Return those of all bodies at some instants, (N, B, 3, 3), in the length unit."""
        pose = self._pose
        found = self._mover.state(
            pose.values[instants], pose.rates[instants], pose.accelerations[instants]
        )
        return found.centres / self._mover.unit

    def __getitem__(self, name: str) -> Values:
        """Return those of a body at all instants, (N, 3, 3)."""
        if name not in self._names:
            raise KeyError(name)
        if self._whole is None:
            self._whole = self.part(slice(None))
        return self._whole[:, self._names.index(name)]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the bodies' names."""
        return iter(self._names)

    def __len__(self) -> int:
        """Return the number of bodies."""
        return len(self._names)


@dataclass(frozen=True)
class Motion(OfSubject):
    """A motion: all of it is NaN at infeasible instants.

    Attributes
    ----------
    t : (N,) float64
    pose, parasitic, joints, passive : Course
        ``joints`` are the actuated ones; ``passive`` may have no coordinates.
    effort, power : (N, n) float64 or None
        Force (N) or torque (N m) of each actuated joint and its mechanical power (W); None where
        there are no bodies.
    kinetic, potential : (N,) float64 or None
        Energy, J.
    centres : mapping of str to (N, 3, 3) float64
        Of each body: position, velocity and acceleration of its centre of mass, in the length unit.
    angular : (N, 2, 3) float64
        The platform's angular velocity and acceleration in the base frame, rad/s and rad/s^2.
    infeasible, singular : tuple of Span
        Where it is not possible, and where it meets a forward singularity; with efforts the latter
        are among the former.
    approaches : tuple of Approach
        Where it comes so near a singularity that efforts between instants exceed those at them.
    """

    t: Vector
    pose: Course
    parasitic: Course
    joints: Course
    passive: Course
    effort: Values | None
    power: Values | None
    kinetic: Vector | None
    potential: Vector | None
    centres: Centres
    angular: Values
    infeasible: tuple[Span, ...] = ()
    singular: tuple[Span, ...] = ()
    approaches: tuple[Approach, ...] = ()


def stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last number of every stretch of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]

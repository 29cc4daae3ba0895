"""Motion along a trajectory: kinematics of all joints and bodies, forces and power."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pmopt.mechanisms.base import Coordinate, Parameters, Vector

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
class Motion:
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
    centres : dict of str to (N, 3, 3) float64
        Of each body: position, velocity and acceleration of its centre of mass, in the length unit.
    infeasible : tuple of Span
    """

    mechanism: str
    params: Parameters
    working_mode: str
    t: Vector
    pose: Course
    parasitic: Course
    joints: Course
    passive: Course
    effort: Values | None
    power: Values | None
    kinetic: Vector | None
    potential: Vector | None
    centres: dict[str, Values]
    infeasible: tuple[Span, ...]

"""Joints along a motion: angles without jumps, and the turns that keep limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.kinematics.limits import of_limb
from pmopt.analysis.motion.continuity import (
    angle_columns,
    beyond_limits,
    continuous,
    given_turns,
    in_limits,
)
from pmopt.analysis.motion.dynamics import Mover, State
from pmopt.analysis.motion.records import (
    Course,
    Span,
    Trajectory,
    Values,
    stretches,
)
from pmopt.analysis.singularities.touching import Jets, between
from pmopt.mechanisms.mechanism import (
    Coordinate,
    Mechanism,
    Ranges,
    Vector,
)


class Courses:
    """Joints and parasitic coordinates along a motion, angles without jumps by a turn.

    Parameters
    ----------
    mover : Mover
    trajectory : Trajectory
    pose : Course
        Of the motion.
    state : State
        At its poses.
    determined : (N,) bool
        Where the motion is known.
    """

    def __init__(
        self, mover: Mover, trajectory: Trajectory, pose: Course, state: State,
        determined: NDArray[np.bool_],
    ) -> None:  # fmt: skip
        self.mover, self.trajectory = mover, trajectory
        self.pose, self.determined = pose, determined
        self.plain = _plain_courses(mover, state)

    def limited(self, limits: Ranges) -> tuple[dict[str, Course], list[Span]]:
        """Return the courses by kind, by the turns that keep limits, and where none does."""
        found, spans = {}, []
        for kind, course in self.plain.items():
            values = self._continuous(kind, course)
            for k in angle_columns(course.coordinates):
                name = course.coordinates[k].name
                ends = next((v for n, v in limits.items() if of_limb(n, name)), None)
                if ends is None or kind == "parasitic":
                    continue
                if not self._given(kind):
                    values[:, k] = in_limits(values[:, k], ends)
                spans += self._beyond(name, values[:, k], ends)
            found[kind] = Course(course.coordinates, values, course.rates, course.accelerations)
        return found, spans

    def _given(self, kind: str) -> bool:
        return kind == "joints" and self.trajectory.space == "joint"

    def _continuous(self, kind: str, course: Course) -> Values:
        values = course.values.copy()
        angles = angle_columns(course.coordinates)
        if self._given(kind):
            values[:, angles] = given_turns(values[:, angles], self.trajectory.values[:, angles])
            return values

        def between(first: int, last: int, shares: Vector) -> Values:
            poses = _interpolated(self.trajectory.t, self.pose, first, last, shares)
            none = np.zeros_like(poses)
            courses = _plain_courses(self.mover, self.mover.state(poses, none, none))
            return courses[kind].values[:, angles]

        known = self.determined[:, None]
        position, rate, acceleration = (
            np.where(known, part[:, angles], np.nan)
            for part in (course.values, course.rates, course.accelerations)
        )
        turned = continuous(self.trajectory.t, position, rate, acceleration, between)
        values[:, angles] = np.where(known, turned, values[:, angles])
        return values

    def _beyond(self, name: str, values: Vector, limits: tuple[float, float]) -> list[Span]:
        """Return where a joint has turned out of its limits, though its direction keeps them."""
        low, high = limits
        miss = np.where(self.determined, beyond_limits(values, limits), 0.0)
        spans = []
        for first, last in stretches(miss > 0):
            worst = first + int(np.argmax(miss[first : last + 1]))
            text = (
                f"{name} = {values[worst]:.6g} rad misses [{low:.6g}, {high:.6g}] by "
                f"{miss[worst]:.6g} rad"
            )
            spans.append(Span(first, last, worst, name, float(miss[worst]), "rad", text))
        return spans


def followed_coordinates(mechanism: Mechanism) -> tuple[Coordinate, ...]:
    """Return the passive joints that a motion follows, as coordinates.

    One that stands for a joint of every limb (``theta4`` of ``theta4_1``) lends its kind.
    """
    found = []
    for name in mechanism.followed:
        declared = next((c for c in mechanism.passive if of_limb(c.name, name)), None)
        kind = "angle" if declared is None else declared.kind
        found.append(Coordinate(name, kind, "" if declared is None else declared.meaning))
    return tuple(found)


def _plain_courses(mover: Mover, state: State) -> dict[str, Course]:
    """Return joints, passive joints and parasitic coordinates as a state has them."""
    mechanism = mover.mechanism
    roles = ("x", "y", "z", "yaw", "pitch", "roll")
    own = [roles.index(role) for role in mechanism.parasitic_roles]
    scale = np.array([mover.unit if k < 3 else 1.0 for k in own])
    factor = mover.si(mechanism.joints)
    followed = followed_coordinates(mechanism)
    passive = mover.si(followed)
    return {
        "joints": Course(
            mechanism.joints, state.joints, state.joint_rates / factor,
            state.joint_accelerations / factor,
        ),
        "passive": Course(
            followed, state.passive, state.passive_rates / passive,
            state.passive_accelerations / passive,
        ),
        "parasitic": Course(
            mechanism.parasitic,
            *(state.platform[:, order][:, own] / scale for order in range(3)),
        ),
    }  # fmt: skip


def _interpolated(t: Vector, pose: Course, first: int, last: int, shares: Vector) -> Values:
    """Return poses between two instants."""
    ends = [first, last]
    jets = Jets(pose.values[ends], pose.rates[ends], pose.accelerations[ends])
    return between(t[ends], jets, np.zeros(len(shares), dtype=np.int64), shares).values

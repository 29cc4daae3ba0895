"""Motion along a trajectory: kinematics of all joints and bodies, forces and power."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.motion.courses import Courses
from pmopt.analysis.motion.dynamics import Mover, State, angular_motion
from pmopt.analysis.motion.infeasible import out_of_reach, unknown
from pmopt.analysis.motion.joint_space import follow_joints
from pmopt.analysis.motion.records import (
    Centres,
    Course,
    Motion,
    Span,
    Trajectory,
    Values,
)
from pmopt.analysis.motion.singularities import (
    SINGULAR,
    approaches,
    met_singularities,
    touched_singularities,
)
from pmopt.analysis.record import Subject
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.singularities.touching import Jets
from pmopt.compiler.machine_code import compile_ahead
from pmopt.mechanisms.bodies import Body, MassProperties
from pmopt.mechanisms.mechanism import (
    Coordinate,
    Mechanism,
    Parameters,
    Vector,
)

#: Instants that are looked at at once where that needs much room.
_ROWS = 1 << 16


@dataclass(frozen=True)
class Loads:
    """What the drives have to move.

    Attributes
    ----------
    bodies : sequence of Body or None
        None: the mechanism's own; none of them: there are no efforts.
    payload : MassProperties or None
        On the platform, in its frame.
    gravity : (3,) of float or None
        m/s^2; None: 9.81 along :attr:`Mechanism.down`.
    efforts : bool
        False: only how it moves. Forward singularities, which efforts do not pass, then stand
        apart, as :attr:`Motion.singular`, and do not make it infeasible.
    """

    bodies: Sequence[Body] | None = None
    payload: MassProperties | None = None
    gravity: Sequence[float] | None = None
    efforts: bool = True

    def massive(self, mechanism: Mechanism, parameters: Parameters) -> tuple[Body, ...]:
        """Return all bodies that efforts move, the payload among them."""
        if not self.efforts:
            return ()
        own = mechanism.bodies(parameters) if self.bodies is None else tuple(self.bodies)
        if self.payload is None:
            return own
        return (*own, self.payload.body("payload", source="given"))


def compute_motion(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None,
    trajectory: Trajectory,
    *,
    working_mode: str | None = None,
    loads: Loads | None = None,
    limits: Mapping[str, Any] | None = None,
    threads: int | None = None,
    notify: Callable[[str], None] | None = None,
) -> Motion:
    """Compute a motion and what drives it.

    Parameters
    ----------
    mechanism : Mechanism
    params : mapping or None
        Design parameters; those left out take their defaults.
    trajectory : Trajectory
    working_mode : str, optional
        Default: the mechanism's first.
    loads : Loads, optional
    limits : mapping, optional
        Ranges of actuated and passive joints, beside or instead of the mechanism's own.
    threads : int, optional
        Results do not depend on it.
    notify : callable, optional
        Receives a line when kernels have to be compiled.

    Raises
    ------
    InputError
        For unknown names and bodies on joints that the mechanism does not have.
    """
    parameters = mechanism.resolve(params or {})
    mode = mechanism.check_mode(working_mode)
    loads = loads or Loads()
    massive = loads.massive(mechanism, parameters)
    mover = Mover(mechanism, parameters, mode, massive, loads.gravity, threads, notify)
    sampler = make_sampler(
        mechanism,
        WorkspaceSettings(limits=dict(limits or {}), working_mode=mode, jacobian="homogenized"),
        threads=threads,
        notify=notify,
        where="motion",
    )
    fields = [c for c, entries in sampler.evaluator.kernels.items() if "field" in entries]
    compile_ahead(
        [*((c, "field") for c in fields), *((c, "move_all") for c in mover.kernels)], mover.threads
    )
    poses, rates, accelerations = trajectory.values, trajectory.rates, trajectory.accelerations
    spans: list[Span] = []
    if trajectory.space == "joint":
        poses, rates, accelerations, spans = follow_joints(mover, trajectory)
    known = np.isfinite(poses).all(axis=1)
    design = sampler.design(parameters)
    margin, index = np.full(len(poses), -1.0), np.zeros(len(poses))
    margin[known], index[known] = sampler.evaluator.field(
        design, np.ascontiguousarray(poses[known].T)
    )
    out = known & ~(margin >= 0.0)
    spans += out_of_reach(mechanism, parameters, mode, design.limits, poses, out, margin)
    feasible = known & ~out
    state = mover.state(
        np.where(feasible[:, None], poses, np.nan), rates, accelerations, centres=False
    )
    determined = feasible & state.valid
    spans += unknown(feasible & ~state.valid)
    singular = met_singularities(state, determined, index, trajectory.t)
    jets = Jets(poses, rates, accelerations)

    def index_at(values: Values) -> Vector:
        return sampler.evaluator.field(design, np.ascontiguousarray(values.T))[1]

    touched, near = touched_singularities(
        trajectory.t, jets, determined & (index >= SINGULAR), index_at, singular
    )
    singular = sorted([*singular, *touched], key=lambda span: span.first)
    if loads.efforts:
        determined &= index >= SINGULAR
        spans += singular
    pose = Course(mechanism.pose, poses, rates, accelerations)
    courses = Courses(mover, trajectory, pose, state, determined)
    angular = np.concatenate([
        angular_motion(state.platform[k : k + _ROWS]) for k in range(0, len(poses), _ROWS)
    ])  # fmt: skip
    # What has had its use makes room.
    none = np.empty(0)
    state = replace(
        state, platform=none, inverse_jacobian=none, passive_rates=none, passive_accelerations=none,
        joint_accelerations=none,
    )  # fmt: skip
    turned, beyond = courses.limited(design.limits)
    del courses
    spans += beyond
    for span in beyond:
        determined[span.first : span.last + 1] = False
    spans.sort(key=lambda span: (span.first, span.last))
    subject = Subject.of(
        mechanism, parameters, mode, _extents(mechanism.pose, poses), design.limits
    )
    motion = replace(
        _assembled(mover, subject, _Found(trajectory.t, pose, turned, state, angular), determined),
        infeasible=tuple(spans),
        singular=tuple(singular),
    )
    if motion.effort is None or spans:
        return motion
    return replace(motion, approaches=approaches(mover, motion, jets, near, index))


class _Found(NamedTuple):
    """What a mechanism does along a motion; ``courses`` by kind, without jumps by a turn."""

    t: Vector
    pose: Course
    courses: Mapping[str, Course]
    state: State
    angular: Values


def _extents(coordinates: Sequence[Coordinate], poses: Values) -> dict[str, tuple[float, float]]:
    """Return the least and the greatest value of each coordinate of (N, d) poses that are known."""
    lowest, highest = np.fmin.reduce(poses, axis=0).tolist(), np.fmax.reduce(poses, axis=0).tolist()
    ends = zip(coordinates, lowest, highest, strict=True)
    return {c.name: (low, high) for c, low, high in ends if not math.isnan(low)}


def _assembled(
    mover: Mover, subject: Subject, found: _Found, known_at: NDArray[np.bool_]
) -> Motion:
    """Return the motion in the mechanism's unit, NaN where it is not known."""
    pose, courses, state = found.pose, found.courses, found.state
    lost = ~known_at

    def masked(values: Values) -> Values:
        """Return an array of this motion's own with NaN where nothing is known, in its place.

        Of a long motion there is no room for second copies.
        """
        values[lost] = np.nan
        return values

    def course(plain: Course) -> Course:
        orders = (plain.values, plain.rates, plain.accelerations)
        return Course(tuple(plain.coordinates), *map(masked, orders))

    has = bool(mover.bodies)
    given = pose.values, pose.rates, pose.accelerations
    known = course(Course(pose.coordinates, *(values.copy() for values in given)))
    return Motion(
        subject=subject,
        t=found.t,
        pose=known,
        parasitic=course(courses["parasitic"]),
        joints=course(courses["joints"]),
        passive=course(courses["passive"]),
        effort=masked(state.efforts) if has else None,
        power=masked(state.efforts * state.joint_rates) if has else None,
        kinetic=masked(state.kinetic) if has else None,
        potential=masked(state.potential) if has else None,
        centres=Centres(mover, known, tuple(body.name for body in mover.bodies)),
        angular=masked(found.angular),
    )

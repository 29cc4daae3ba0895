"""Motion along a trajectory: kinematics of all joints and bodies, forces and power."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.dynamics import Mover, State, angular_motion
from pmopt.analysis.kinematics import forward_kinematics, of_limb
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.sweeper import Sweeper
from pmopt.errors import UnreachableError
from pmopt.mechanisms.base import (
    Coordinate,
    InverseSolution,
    Mechanism,
    Parameters,
    Ranges,
    Vector,
    within,
    wrap_angle,
)
from pmopt.mechanisms.bodies import Body, MassProperties
from pmopt.numerics.compiled import compile_ahead
from pmopt.units import exact, unit_of

Values = NDArray[np.float64]

#: LCI of the homogenized Jacobian below which a pose counts as singular.
SINGULAR = 1e-9
#: Instants of an infeasible stretch that are looked at for the reason and the largest miss.
_LOOKS = 40
#: A joint-space motion is followed to this miss of its joints, relative to the characteristic
#: length; in at most so many steps an instant.
_CLOSE = 1e-12
_STEPS = 12


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
    angular : (N, 2, 3) float64
        The platform's angular velocity and acceleration in the base frame, rad/s and rad/s^2.
    infeasible, singular : tuple of Span
        Where it is not possible, and where it meets a forward singularity; with efforts the latter
        are among the former.
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
    angular: Values
    infeasible: tuple[Span, ...]
    singular: tuple[Span, ...]


def compute_motion(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None,
    trajectory: Trajectory,
    *,
    working_mode: str | None = None,
    bodies: Sequence[Body] | None = None,
    payload: MassProperties | None = None,
    gravity: Sequence[float] | None = None,
    limits: Mapping[str, Any] | None = None,
    efforts: bool = True,
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
    bodies : sequence of Body, optional
        Default: the mechanism's own; none of them: no efforts are told.
    payload : MassProperties, optional
        On the platform, in its frame.
    gravity : (3,) of float, optional
        m/s^2; default 9.81 along :attr:`Mechanism.down`.
    limits : mapping, optional
        Ranges of actuated and passive joints, beside or instead of the mechanism's own.
    efforts : bool
        False: only how it moves. Forward singularities, which efforts do not pass, then are told
        apart, as :attr:`Motion.singular`, and do not make it infeasible.
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
    own = mechanism.bodies(parameters) if bodies is None else tuple(bodies)
    massive = own if payload is None else (*own, payload.body("payload", source="given"))
    massive = massive if efforts else ()
    mover = Mover(mechanism, parameters, mode, massive, gravity, threads, notify)
    sweeper = Sweeper(
        mechanism,
        WorkspaceSettings(limits=dict(limits or {}), working_mode=mode, jacobian="homogenized"),
        threads=threads,
        notify=notify,
        where="motion",
    )
    fields = [c for c, entries in sweeper.kernels.items() if "field" in entries]
    compile_ahead(
        [*((c, "field") for c in fields), *((c, "move") for c in mover.kernels)], mover.threads
    )
    poses, rates, accelerations = trajectory.values, trajectory.rates, trajectory.accelerations
    spans: list[Span] = []
    if trajectory.space == "joint":
        poses, rates, accelerations, spans = _followed(mover, parameters, mode, trajectory)
    known = np.isfinite(poses).all(axis=1)
    design = sweeper.design(parameters)
    margin, index = np.full(len(poses), -1.0), np.zeros(len(poses))
    margin[known], index[known] = sweeper.field(design, np.ascontiguousarray(poses[known].T))
    out = known & ~(margin >= 0.0)
    spans += _out_of_reach(mechanism, parameters, mode, design.limits, poses, out, margin)
    feasible = known & ~out
    state = mover.state(np.where(feasible[:, None], poses, np.nan), rates, accelerations)
    told = feasible & state.valid
    spans += _untold(feasible & ~state.valid)
    singular = _singular(state, told, index, trajectory.t)
    if efforts:
        told &= index >= SINGULAR
        spans += singular
    spans.sort(key=lambda span: (span.first, span.last))
    return _assemble(
        mechanism, parameters, mode, trajectory.t, (poses, rates, accelerations), state, told,
        massive, mover, tuple(spans), tuple(singular),
    )  # fmt: skip


def _assemble(
    mechanism: Mechanism,
    parameters: Parameters,
    mode: str,
    t: Vector,
    pose: tuple[Values, Values, Values],
    state: State,
    told: NDArray[np.bool_],
    bodies: tuple[Body, ...],
    mover: Mover,
    spans: tuple[Span, ...],
    singular: tuple[Span, ...],
) -> Motion:
    """Return the motion in the mechanism's unit, NaN where it is not told."""
    unit = mover.unit

    def masked(values: Values) -> Values:
        shape = (-1,) + (1,) * (values.ndim - 1)
        result: Values = np.where(told.reshape(shape), values, np.nan)
        return result

    def course(coordinates: Sequence[Coordinate], *orders: Values) -> Course:
        return Course(tuple(coordinates), *(masked(values) for values in orders))

    roles = ("x", "y", "z", "yaw", "pitch", "roll")
    own = [roles.index(role) for role in mechanism.parasitic_roles]
    scale = np.array([unit if k < 3 else 1.0 for k in own])
    parasitic = [state.platform[:, order][:, own] / scale for order in range(3)]
    factor = mover.si(mechanism.joints)
    followed = followed_coordinates(mechanism)
    passive = mover.si(followed)
    has = bool(bodies)
    return Motion(
        mechanism=mechanism.name,
        params=dict(parameters),
        working_mode=mode,
        t=t,
        pose=course(mechanism.pose, *pose),
        parasitic=course(mechanism.parasitic, *parasitic),
        joints=course(
            mechanism.joints, state.joints, state.joint_rates / factor,
            state.joint_accelerations / factor,
        ),
        passive=course(
            followed, state.passive, state.passive_rates / passive,
            state.passive_accelerations / passive,
        ),
        effort=masked(state.efforts) if has else None,
        power=masked(state.efforts * state.joint_rates) if has else None,
        kinetic=masked(state.kinetic) if has else None,
        potential=masked(state.potential) if has else None,
        centres={
            body.name: masked(state.centres[:, k] / unit) for k, body in enumerate(bodies)
        },
        angular=masked(angular_motion(state.platform)),
        infeasible=spans,
        singular=singular,
    )  # fmt: skip


def followed_coordinates(mechanism: Mechanism) -> tuple[Coordinate, ...]:
    """Return the passive joints that a motion tells, as coordinates.

    One that stands for a joint of every limb (``theta4`` of ``theta4_1``) lends its kind.
    """
    found = []
    for name in mechanism.followed:
        declared = next((c for c in mechanism.passive if of_limb(c.name, name)), None)
        kind = "angle" if declared is None else declared.kind
        found.append(Coordinate(name, kind, "" if declared is None else declared.meaning))
    return tuple(found)


def stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last number of every stretch of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _out_of_reach(
    mechanism: Mechanism,
    parameters: Parameters,
    mode: str,
    limits: Ranges,
    poses: Values,
    out: NDArray[np.bool_],
    margin: Vector,
) -> list[Span]:
    """Return the stretches that no limb reaches or some limit excludes, each by its reason."""
    spans = []
    for first, last in stretches(out):
        looks = np.unique(np.linspace(first, last, _LOOKS).astype(int)).tolist()
        looks.append(first + int(np.argmin(margin[first : last + 1])))
        misses = []
        for k in sorted(set(looks)):
            pose = dict(zip([c.name for c in mechanism.pose], poses[k].tolist(), strict=True))
            misses.append((k, *_miss(mechanism, parameters, mode, limits, pose)))
        k, what, miss, unit, text = max(misses, key=lambda found: found[2])
        spans.append(Span(first, last, k, what, miss, unit, text))
    return spans


def _miss(
    mechanism: Mechanism,
    parameters: Parameters,
    mode: str,
    limits: Ranges,
    pose: Mapping[str, float],
) -> tuple[str, float, str, str]:
    """Return which limb or limit excludes a pose, by how much, the unit and the same in words."""
    length = unit_of("length", mechanism.length_unit)
    solutions = mechanism.inverse(parameters, pose)
    solution = next((s for s in solutions if s.working_mode == mode), None)
    if solution is not None:
        return _limit_missed(mechanism, parameters, limits, pose, solution)
    worst = min(mechanism.reach(parameters, pose), key=lambda reach: reach.distance)
    if worst.distance < 0 and not solutions:
        miss = -float(worst.distance)
        text = f"{worst.limb} misses by {miss:.6g} {length} ({worst.reason})"
        return worst.limb, miss, length, text
    modes = ", ".join(s.working_mode for s in solutions) or "none"
    return "working mode", 0.0, length, f"not reached in working mode {mode} (reached in: {modes})"


def _limit_missed(
    mechanism: Mechanism,
    parameters: Parameters,
    limits: Ranges,
    pose: Mapping[str, float],
    solution: InverseSolution,
) -> tuple[str, float, str, str]:
    size = mechanism.characteristic_length(parameters)
    found: list[tuple[float, str, float, str, str]] = []
    values = {**solution.passive, **solution.joints}
    for coordinate in mechanism.limited:
        if coordinate.name not in limits:
            continue
        low, high = limits[coordinate.name]
        unit = mechanism.unit(coordinate)
        for name, value in values.items():
            if of_limb(coordinate.name, name) and not within(value, (low, high), coordinate.kind):
                if coordinate.kind == "angle":
                    miss = abs(wrap_angle(value - (low + high) / 2)) - (high - low) / 2
                    weight = miss
                else:
                    miss = max(low - value, value - high)
                    weight = miss / size
                text = (
                    f"{name} = {value:.6g} {unit} misses [{exact(low)}, {exact(high)}] "
                    f"by {miss:.6g} {unit}"
                )
                found.append((weight, name, miss, unit, text))
    if found:
        return max(found)[1:]
    length = unit_of("length", mechanism.length_unit)
    if not mechanism.admits(parameters, pose):
        return "design limit", 0.0, length, "a limit that is a design parameter is exceeded"
    # On a boundary, where the kernel and the equations differ by rounding.
    return "reach", 0.0, length, "at the very end of the reach"


def _untold(lost: NDArray[np.bool_]) -> list[Span]:
    """Return where poses are reached but do not tell how the mechanism moves."""
    text = (
        "the pose's angles do not tell the motion (pitch at 90 degrees), or joints of a limb are "
        "dependent there"
    )
    return [Span(a, b, a, "coordinates", 0.0, "rad", text) for a, b in stretches(lost)]


def _singular(
    state: State,
    feasible: NDArray[np.bool_],
    index: Vector,
    t: Vector,
) -> list[Span]:
    """Return where the motion meets a forward singularity, at an instant or between two."""
    near = feasible & (index < SINGULAR)
    words = "a singularity: the actuated joints do not hold the platform, efforts have no bound"
    spans = [
        Span(a, b, a, "singularity", float(index[a]), "1", f"LCI = {index[a]:.3g}: {words}")
        for a, b in stretches(near)
    ]
    told = np.flatnonzero(feasible & ~near)
    with np.errstate(invalid="ignore"):
        sign = np.sign(np.linalg.det(np.where(
            state.valid[:, None, None], state.inverse_jacobian, 0.0
        )))  # fmt: skip
    for a, b in pairwise(told.tolist()):
        # What lies between two instants that are told is singular or out of reach.
        if sign[a] != sign[b] and (b == a + 1 or near[a + 1 : b].all()):
            if b > a + 1:
                continue  # told above
            text = f"between t = {t[a]:.9g} s and t = {t[b]:.9g} s {words}"
            worst = a if index[a] < index[b] else b
            spans.append(Span(a, b, worst, "singularity", float(index[worst]), "1", text))
    return spans


def _followed(
    mover: Mover, parameters: Parameters, mode: str, trajectory: Trajectory
) -> tuple[Values, Values, Values, list[Span]]:
    """Return poses, rates and accelerations of a motion that is given by its joints.

    From the assembly mode nearest to home that has the working mode, Newton's method follows the
    joints from instant to instant; NaN from where it can not.
    """
    mechanism = mover.mechanism
    count, n = trajectory.values.shape
    poses = np.full((count, n), np.nan)
    size = mechanism.characteristic_length(parameters)
    scale = np.array([size if c.kind == "length" else 1.0 for c in mechanism.joints])
    angular = np.array([c.kind == "angle" for c in mechanism.joints])
    to_pose = 1.0 / mover.si(mechanism.pose)
    factor = mover.si(mechanism.joints)
    none = np.zeros((1, n))
    spans: list[Span] = []

    def lost(k: int, text: str) -> None:
        length = unit_of("length", mechanism.length_unit)
        spans.append(Span(k, count - 1, k, "assembly", 0.0, length, text))

    def gap(found: Vector, wanted: Vector) -> Vector:
        miss = wanted - found
        return np.where(angular, np.angle(np.exp(1j * miss)), miss)

    try:
        pose = _first_pose(mechanism, parameters, mode, trajectory.values[0])
    except UnreachableError as error:
        lost(0, str(error))
        return poses, poses.copy(), poses.copy(), spans
    step = np.zeros(n)
    for k in range(count):
        pose = pose + step  # as far on as the last instant
        before = poses[k - 1] if k else pose
        for _ in range(_STEPS):
            now = mover.state(pose[None], none, none)
            miss = gap(now.joints[0], trajectory.values[k])
            if not np.isfinite(miss).all():
                break
            try:
                change = to_pose * np.linalg.solve(now.inverse_jacobian[0], factor * miss)
            except np.linalg.LinAlgError:
                break
            pose = pose + change
            if np.abs(miss / scale).max() <= _CLOSE:
                break
        found = mover.state(pose[None], none, none).joints[0]
        if not np.abs(gap(found, trajectory.values[k]) / scale).max() <= 1e3 * _CLOSE:
            shown = ", ".join(
                f"{c.name}={v:.6g}"
                for c, v in zip(mechanism.joints, trajectory.values[k], strict=True)
            )
            lost(k, f"the platform can not be followed on to {shown}: the joints can not be "
                 "assembled near there, or meet a forward singularity")  # fmt: skip
            break
        step = pose - before if k else step
        poses[k] = pose
    known = np.isfinite(poses).all(axis=1)
    rates, accelerations = np.full((2, count, n), np.nan)
    zero = np.zeros_like(poses)
    state = mover.state(poses, zero, zero)
    jacobian = np.linalg.inv(state.inverse_jacobian[known])
    speed = np.einsum("nij,nj->ni", jacobian, factor * trajectory.rates[known])
    rates[known] = to_pose * speed
    bias = mover.state(poses[known], rates[known], zero[known]).joint_accelerations
    change = factor * trajectory.accelerations[known] - bias
    accelerations[known] = to_pose * np.einsum("nij,nj->ni", jacobian, change)
    return poses, rates, accelerations, spans


def _first_pose(mechanism: Mechanism, parameters: Parameters, mode: str, joints: Vector) -> Vector:
    """Return the pose of these joints nearest to home among those of the working mode."""
    given = dict(zip([c.name for c in mechanism.joints], joints.tolist(), strict=True))
    found = forward_kinematics(mechanism, parameters, given, where="trajectory")
    home = mechanism.home(parameters)
    size = mechanism.characteristic_length(parameters)

    def away(pose: Mapping[str, float]) -> float:
        gaps = (
            size * wrap_angle(pose[c.name] - home[c.name])
            if c.kind == "angle"
            else pose[c.name] - home[c.name]
            for c in mechanism.pose
        )
        return math.hypot(*gaps)

    def same(solution: InverseSolution) -> bool:
        return all(
            abs(wrap_angle(v - given[k])) < 1e-6
            if mechanism.joints[i].kind == "angle"
            else abs(v - given[k]) < 1e-6 * size
            for i, (k, v) in enumerate(solution.joints.items())
        )

    poses = [
        s.pose
        for s in found.solutions
        if any(i.working_mode == mode and same(i) for i in mechanism.inverse(parameters, s.pose))
    ]
    if not poses:
        raise UnreachableError(f"trajectory: no assembly of its start is in working mode {mode}")
    best = min(poses, key=away)
    return np.array([best[c.name] for c in mechanism.pose])

"""Motion along a trajectory: kinematics of all joints and bodies, forces and power."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.kinematics.solve import forward_kinematics, of_limb
from pmopt.analysis.motion.continuity import (
    angle_columns,
    beyond_limits,
    continuous,
    given_turns,
    in_limits,
)
from pmopt.analysis.motion.dynamics import Mover, State, angular_motion
from pmopt.analysis.record import OfSubject, Subject
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.singularities.touching import Jets, Least, between, least_sizes
from pmopt.compiler.machine_code import compile_ahead
from pmopt.errors import UnreachableError
from pmopt.mechanisms.bodies import Body, MassProperties
from pmopt.mechanisms.mechanism import (
    Coordinate,
    InverseSolution,
    Mechanism,
    Parameters,
    Ranges,
    Vector,
    within,
    wrap_angle,
)
from pmopt.units import exact, unit_of

Values = NDArray[np.float64]

#: LCI of the homogenized Jacobian below which a pose counts as singular.
SINGULAR = 1e-9
#: Instants of an infeasible stretch that are looked at for the reason and the largest miss.
_LOOKS = 40
#: A joint-space motion is followed to this miss of its joints, relative to the characteristic
#: length; in at most so many steps an instant.
_CLOSE = 1e-12
#: Instants that are looked at at once where that needs much room.
_ROWS = 1 << 16
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
    infeasible: tuple[Span, ...]
    singular: tuple[Span, ...]
    approaches: tuple[Approach, ...] = ()


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
        poses, rates, accelerations, spans = _followed(mover, parameters, mode, trajectory)
    known = np.isfinite(poses).all(axis=1)
    design = sampler.design(parameters)
    margin, index = np.full(len(poses), -1.0), np.zeros(len(poses))
    margin[known], index[known] = sampler.evaluator.field(
        design, np.ascontiguousarray(poses[known].T)
    )
    out = known & ~(margin >= 0.0)
    spans += _out_of_reach(mechanism, parameters, mode, design.limits, poses, out, margin)
    feasible = known & ~out
    state = mover.state(
        np.where(feasible[:, None], poses, np.nan), rates, accelerations, centres=False
    )
    told = feasible & state.valid
    spans += _untold(feasible & ~state.valid)
    singular = _singular(state, told, index, trajectory.t)
    jets = Jets(poses, rates, accelerations)

    def index_at(values: Values) -> Vector:
        return sampler.evaluator.field(design, np.ascontiguousarray(values.T))[1]

    touched, near = _touched(trajectory.t, jets, told & (index >= SINGULAR), index_at, singular)
    singular = sorted([*singular, *touched], key=lambda span: span.first)
    if efforts:
        told &= index >= SINGULAR
        spans += singular
    pose = Course(mechanism.pose, poses, rates, accelerations)
    courses = _Courses(mover, trajectory, pose, state, told)
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
        told[span.first : span.last + 1] = False
    spans.sort(key=lambda span: (span.first, span.last))
    box = _extents(mechanism.pose, poses)
    subject = Subject.of(mechanism, parameters, mode, box, design.limits)
    motion = _assemble(
        subject, trajectory.t, _Found(pose, turned, state, angular),
        _Verdict(told, tuple(spans), tuple(singular)), massive, mover,
    )  # fmt: skip
    if motion.effort is None or spans:
        return motion
    return replace(motion, approaches=_approaches(mover, motion, jets, near, index))


def _approaches(
    mover: Mover, motion: Motion, jets: Jets, near: Least, index: Vector
) -> tuple[Approach, ...]:
    """Return where efforts between instants exceed those at them, near a singularity."""
    assert motion.effort is not None
    low = near.size < _APPROACH * float(np.median(index))
    if not low.any():
        return ()
    first, share, size = near.first[low], near.share[low], near.size[low]
    found = mover.state(*between(motion.t, jets, first, share)).efforts
    peaks = np.abs(motion.effort).max(axis=0)
    times = motion.t[first] + share * (motion.t[first + 1] - motion.t[first])
    names = [c.name for c in motion.joints.coordinates]
    result = []
    for k in np.argsort(times, kind="stable").tolist():
        beside = np.abs(motion.effort[first[k] : first[k] + 2]).max(axis=0) >= peaks
        told = {
            name: float(found[k, j])
            for j, name in enumerate(names)
            if abs(found[k, j]) > _GROWS * peaks[j] or (beside[j] and peaks[j] > 0)
        }
        if told:
            result.append(Approach(float(times[k]), float(size[k]), told))
    return tuple(result)


class _Courses:
    """Joints and parasitic coordinates along a motion, angles without jumps by a turn.

    Parameters
    ----------
    mover : Mover
    trajectory : Trajectory
    pose : Course
        Of the motion.
    state : State
        At its poses.
    told : (N,) bool
        Where the motion is known.
    """

    def __init__(
        self, mover: Mover, trajectory: Trajectory, pose: Course, state: State,
        told: NDArray[np.bool_],
    ) -> None:  # fmt: skip
        self.mover, self.trajectory, self.pose, self.told = mover, trajectory, pose, told
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

        known = self.told[:, None]
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
        miss = np.where(self.told, beyond_limits(values, limits), 0.0)
        spans = []
        for first, last in stretches(miss > 0):
            worst = first + int(np.argmax(miss[first : last + 1]))
            text = (
                f"{name} = {values[worst]:.6g} rad misses [{low:.6g}, {high:.6g}] by "
                f"{miss[worst]:.6g} rad"
            )
            spans.append(Span(first, last, worst, name, float(miss[worst]), "rad", text))
        return spans


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


#: A least LCI below this share of the motion's median is an approach worth a word.
_APPROACH = 0.2
#: Efforts that grow by so much between the instants are told.
_GROWS = 1.01


def _touched(
    t: Vector,
    jets: Jets,
    told: NDArray[np.bool_],
    index: Callable[[Values], Vector],
    spans: Sequence[Span],
) -> tuple[list[Span], Least]:
    """Return where the motion touches a singularity between instants, and where it comes near.

    Parameters
    ----------
    t : (N,) float64
    jets : Jets
        Of the pose.
    told : (N,) bool
        Where the motion is known.
    index : callable
        Returns the LCI at poses (M, n).
    spans : sequence of Span
        Singular ones that are known already.
    """
    least = least_sizes(t, jets, told, index)
    covered = np.zeros(len(t), dtype=bool)
    for span in spans:
        covered[span.first : span.last + 1] = True
    found = []
    near = np.ones(len(least.size), dtype=bool)
    for k, (first, share, size) in enumerate(zip(*map(np.ndarray.tolist, least), strict=True)):
        if size >= SINGULAR:
            continue
        near[k] = False
        if covered[first] and covered[first + 1]:
            continue
        covered[first : first + 2] = True
        time = t[first] + share * (t[first + 1] - t[first])
        text = (
            f"at t = {time:.9g} s a singularity is touched (LCI = {size:.3g}): the actuated joints "
            "do not hold the platform, efforts have no bound"
        )
        found.append(Span(first, first + 1, first + round(share), "singularity", size, "1", text))
    return found, Least(least.first[near], least.share[near], least.size[near])


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
        told = ", ".join(f"{k} {v:.4g} {units[k]}" for k, v in self.efforts.items())
        return (
            f"near a singularity at t = {self.t:.9g} s (LCI = {self.lci:.3g}), where efforts peak: "
            f"{told}; at other instants they are smaller"
        )


class _Found(NamedTuple):
    """What a mechanism does along a motion; ``courses`` by kind, without jumps by a turn."""

    pose: Course
    courses: Mapping[str, Course]
    state: State
    angular: Values


class _Verdict(NamedTuple):
    """Where a motion is known, (N,), where it is not possible, and where it is singular."""

    known: NDArray[np.bool_]
    spans: tuple[Span, ...]
    singular: tuple[Span, ...]


def _extents(coordinates: Sequence[Coordinate], poses: Values) -> dict[str, tuple[float, float]]:
    """Return the least and the greatest value of each coordinate of (N, d) poses that are known."""
    lowest, highest = np.fmin.reduce(poses, axis=0).tolist(), np.fmax.reduce(poses, axis=0).tolist()
    ends = zip(coordinates, lowest, highest, strict=True)
    return {c.name: (low, high) for c, low, high in ends if not math.isnan(low)}


def _assemble(
    subject: Subject,
    t: Vector,
    found: _Found,
    verdict: _Verdict,
    bodies: tuple[Body, ...],
    mover: Mover,
) -> Motion:
    """Return the motion in the mechanism's unit, NaN where it is not known."""
    pose, courses, state, angular = found
    lost = ~verdict.known

    def masked(values: Values) -> Values:
        """Return an array of this motion's own with NaN where nothing is told, in its place.

        Of a long motion there is no room for second copies.
        """
        values[lost] = np.nan
        return values

    def course(plain: Course) -> Course:
        orders = (plain.values, plain.rates, plain.accelerations)
        return Course(tuple(plain.coordinates), *map(masked, orders))

    has = bool(bodies)
    given = pose.values, pose.rates, pose.accelerations
    known = course(Course(pose.coordinates, *(values.copy() for values in given)))
    return Motion(
        subject=subject,
        t=t,
        pose=known,
        parasitic=course(courses["parasitic"]),
        joints=course(courses["joints"]),
        passive=course(courses["passive"]),
        effort=masked(state.efforts) if has else None,
        power=masked(state.efforts * state.joint_rates) if has else None,
        kinetic=masked(state.kinetic) if has else None,
        potential=masked(state.potential) if has else None,
        centres=Centres(mover, known, tuple(body.name for body in bodies)),
        angular=masked(angular),
        infeasible=verdict.spans,
        singular=verdict.singular,
    )


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

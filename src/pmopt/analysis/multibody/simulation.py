"""A motion on an independent engine: its inverse dynamics, and forward under a controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.motion.config import EFFORT, EngineSettings, MotionTask
from pmopt.analysis.motion.continuity import angle_columns
from pmopt.analysis.motion.dynamics import GRAVITY
from pmopt.analysis.motion.records import Course, Motion
from pmopt.analysis.multibody.mjcf import to_mjcf
from pmopt.analysis.multibody.model import Tree, build_tree
from pmopt.analysis.multibody.mujoco_engine import Engine
from pmopt.analysis.record import OfSubject
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.errors import InputError, PmoptError
from pmopt.mechanisms.mechanism import Coordinate, Vector, wrap_angle
from pmopt.units import METRES, effort_unit

Values = NDArray[np.float64]
Progress = Callable[[int, int], None]

#: A joint whose peak is smaller than this share of the largest bears nothing but rounding: it has
#: no error in per cent.
_ROUNDING = 1e-9
#: Speed of a controller whose gains are not given, rad by hold, and the largest, rad/s.
BANDWIDTH, FASTEST = 0.2, 100.0
#: A joint this far from where it should be, rad or characteristic lengths, has been lost.
_LOST = 0.5
#: A controller that asks for so many times what the motion needs and the drive gives diverges. A
#: joint that needs next to nothing counts with this share of the largest.
_BEYOND, _LIGHT = 100.0, 0.01
#: LCI of the homogenized Jacobian below which what differs is laid to the singularity.
_NEARLY_SINGULAR = 1e-6


@dataclass(frozen=True)
class Comparison:
    """Efforts of both sides at N instants.

    Attributes
    ----------
    t : (N,) float64
        s.
    effort, engine_effort : (N, n) float64
        Of the motion and of the engine, N and N m.
    error : (N, n) float64
        Engine less motion in per cent of the joint's peak; NaN for a joint without load.
    tracking : (N, n) float64
        Engine's joint less the motion's, mechanism's length unit and rad.
    peak : (n,) float64
        Largest size of the motion's effort at these instants.
    """

    t: Vector
    effort: Values
    engine_effort: Values
    error: Values
    tracking: Values
    peak: Vector


@dataclass(frozen=True)
class Saturation:
    """A drive that was asked for more than it can give, and gave its limit.

    Attributes
    ----------
    joint : str
    lower, upper : float
        Its limits, N or N m.
    first, duration : float
        When it is first at one, and for how long in all, s.
    """

    joint: str
    lower: float
    upper: float
    first: float
    duration: float


@dataclass(frozen=True)
class Instability:
    """When a controller was first seen not to hold the motion, s, and why."""

    t: float
    joint: str
    reason: str


@dataclass(frozen=True)
class Forward:
    """A motion under its controller, up to its end or to where the controller is unstable."""

    comparison: Comparison
    saturation: tuple[Saturation, ...]
    unstable: Instability | None


@dataclass(frozen=True)
class Simulation(OfSubject):
    """What an engine says of a motion.

    Attributes
    ----------
    joints : tuple of Coordinate
        Actuated.
    inverse : Comparison
        The engine's inverse dynamics at the motion's instants.
    forward : Comparison or None
        Under the controller, a row for every hold; None without controller.
    saturation : tuple of Saturation
        Of the drives under the controller.
    unstable : Instability or None
        Where the controller does not hold the motion: the rows end there.
    singular : str or None
        Where the motion passes so near a singularity that what differs is laid to it.
    position_error : float
        Largest distance between the two sides' centres of mass of any body, m.
    gap : float
        Largest residual of the engine's loops and actuated positions, m and rad.
    engine, version, model : str
        Name, version and the model's text.
    step : float
        The engine's, s.
    hold : float or None
        The controller's, s; None without.
    gains : dict of str to (n,) float64, or None
        kp, ki, kd by joint; None without controller.
    """

    joints: tuple[Coordinate, ...]
    inverse: Comparison
    forward: Comparison | None
    saturation: tuple[Saturation, ...]
    unstable: Instability | None
    singular: str | None
    position_error: float
    gap: float
    engine: str
    version: str
    model: str
    step: float
    hold: float | None
    gains: dict[str, Vector] | None


def engine_settings(task: MotionTask) -> EngineSettings:
    """Return the configuration's engine, or the default one."""
    return task.config.engine or EngineSettings()


def tree_of(task: MotionTask, pose: Mapping[str, float]) -> Tree:
    """Return what a task moves, at a pose, as links."""
    mechanism, config = task.mechanism, task.config
    gravity = config.gravity or [GRAVITY * d for d in mechanism.down]
    payload = () if task.payload is None else (task.payload.body("payload", source="given"),)
    own = task.bodies or mechanism.bodies(task.parameters)
    mode = mechanism.check_mode(config.working_mode)
    return build_tree(mechanism, task.parameters, pose, mode, (*own, *payload), gravity)


def holds(task: MotionTask) -> tuple[float, int]:
    """Return the controller's hold in s and the number of engine steps in it.

    Raises
    ------
    InputError
        If it is not a whole number of steps.
    """
    step = engine_settings(task).step
    controller = task.config.controller
    hold = controller.hold if controller and controller.hold else step
    count = round(hold / step)
    if count < 1 or abs(count * step - hold) > 1e-9 * hold:
        raise InputError(
            f"{task.where}: controller.hold={hold:g} is not allowed: a whole number of the "
            f"engine's steps of {step:g} s is needed"
        )
    return hold, count


def simulate_motion(
    task: MotionTask,
    motion: Motion,
    fine: Motion | None = None,
    progress: Progress | None = None,
) -> Simulation:
    """Run a motion on an engine.

    Parameters
    ----------
    task : MotionTask
    motion : Motion
        Feasible throughout, with efforts.
    fine : Motion, optional
        The same at half the controller's holds, from the same instant: with it and a controller,
        forward dynamics are run.
    progress : callable, optional
        Receives instants done and planned.

    Raises
    ------
    InputError
        If the mechanism has no masses, or for a hold that is not a whole number of steps.
    PmoptError
        If the engine is missing or its loops do not close.
    """
    if motion.effort is None:
        raise InputError(f"{task.where}: {motion.mechanism} has no masses: [bodies] is needed")
    names = [c.name for c in motion.joints.coordinates]
    start = dict(zip([c.name for c in motion.pose.coordinates], motion.pose.values[0].tolist(),
                     strict=True))  # fmt: skip
    settings = engine_settings(task)
    tree = tree_of(task, start)
    model = to_mjcf(tree, settings.step)
    massive = {body.name for link in tree.links for body in link.bodies}
    bodies = [name for name in motion.centres if name in massive]
    engine = Engine(model, names, bodies)
    factor = joint_factors(task)
    course = motion.joints
    values = from_start(course)
    singular = nearly_singular(task, motion)
    try:
        followed = engine.inverse(
            motion.t, values * factor, course.rates * factor, course.accelerations * factor
        )
    except PmoptError as error:
        if singular is None:
            raise
        raise PmoptError(
            f"{task.where}: {singular}; the engine does not pass it ({error})"
        ) from None
    unit = METRES[task.mechanism.length_unit]
    own = np.stack([motion.centres[name][:, 0] for name in bodies], axis=1) * unit
    inverse = _compared(
        motion.t, motion.effort, followed.efforts, followed.joints / factor - values
    )
    forward, hold, gains = None, None, None
    saturation: tuple[Saturation, ...] = ()
    unstable = None
    if fine is not None and task.config.controller is not None:
        hold, _ = holds(task)
        gains = controller_gains(task, engine)
        run = run_forward(task, engine, fine, gains, followed.efforts[0], progress)
        forward, saturation, unstable = run.comparison, run.saturation, run.unstable
    return Simulation(
        motion.subject, course.coordinates, inverse, forward, saturation, unstable, singular,
        float(np.linalg.norm(followed.centres - own, axis=2).max()), float(followed.gaps.max()),
        engine.name, engine.version, model, settings.step, hold, gains,
    )  # fmt: skip


def nearly_singular(task: MotionTask, motion: Motion) -> str | None:
    """Say where a motion comes so near a singularity that efforts lose their digits, if it does."""
    sampler = make_sampler(
        task.mechanism, WorkspaceSettings(working_mode=motion.working_mode, jacobian="homogenized")
    )
    poses = np.ascontiguousarray(motion.pose.values.T)
    index = sampler.evaluator.field(sampler.design(task.parameters), poses)[1]
    k = int(np.argmin(index))
    if index[k] >= _NEARLY_SINGULAR:
        return None
    return (
        f"the mechanism is nearly singular at t = {motion.t[k]:.9g} s (LCI = {index[k]:.3g}): "
        "efforts have no bound there"
    )


def joint_factors(task: MotionTask) -> Vector:
    """Return what turns positions of the actuated joints to m and rad."""
    unit = METRES[task.mechanism.length_unit]
    return np.array([unit if c.kind == "length" else 1.0 for c in task.mechanism.joints])


def from_start(course: Course) -> Values:
    """Return positions along a motion with angles that begin in (-pi, pi], as an engine's do."""
    values = course.values.copy()
    for k in angle_columns(course.coordinates):
        values[:, k] -= values[0, k] - wrap_angle(float(values[0, k]))
    return values


def _compared(t: Vector, effort: Values, engine_effort: Values, tracking: Values) -> Comparison:
    peak = np.abs(effort).max(axis=0)
    loaded = peak > max(_ROUNDING * float(peak.max()), 1e-300)
    error = 100 * (engine_effort - effort) / np.where(loaded, peak, np.nan)
    return Comparison(t, effort, engine_effort, error, tracking, peak)


def run_forward(
    task: MotionTask, engine: Engine, fine: Motion, gains: Mapping[str, Vector],
    balance: Vector, progress: Progress | None = None,
) -> Forward:  # fmt: skip
    """Run the engine under the controller, from the motion's start.

    At instants t_k, a hold apart, the controller measures the actuated joints and asks for::

        u_k = kp e + ki (sum of e up to t_k) hold + kd e' + effort(t_k + hold / 2)

    with e the motion's joint less the measured one and the last term, the motion's effort at the
    middle of the hold, only with ``feedforward``; without it ``balance`` stands in its place, so
    that the controller takes over without a blow. The engine receives u_k from t_k to t_k + hold,
    which stands for the middle: that is where both sides' efforts are compared, and the
    tracking is the mean of that at both ends.

    A drive gives no more than its limits; while it is at one, errors that would drive it further
    are not summed. The run ends where the controller is unstable: where a joint is lost, the state
    is no longer finite, or the controller asks a drive for a hundred times what the motion needs
    and its limits allow.

    Parameters
    ----------
    task : MotionTask
    engine : Engine
    fine : Motion
        At half holds, from the engine's pose on.
    gains : mapping of str to (n,) float64
        See :func:`controller_gains`.
    balance : (n,) float64
        The engine's own efforts at the start.
    progress : callable, optional
    """
    hold, steps = holds(task)
    controller = task.config.controller
    assert controller is not None and fine.effort is not None
    factor = joint_factors(task)
    kp, ki, kd = (gains[name] for name in ("kp", "ki", "kd"))
    count = _whole_holds(fine.t, hold)
    size = task.mechanism.characteristic_length(task.parameters)
    far = np.array([_LOST * size if c.kind == "length" else _LOST
                    for c in fine.joints.coordinates])  # fmt: skip
    wanted, speeds = from_start(fine.joints), fine.joints.rates
    ahead = fine.effort[1::2]
    if not controller.feedforward:
        ahead = np.broadcast_to(balance, ahead.shape)
    received, tracking = np.empty((count, len(kp))), np.empty((count + 1, len(kp)))
    asked = np.empty_like(received)
    names = [c.name for c in fine.joints.coordinates]
    lowest, highest = effort_limits(task)
    most = _BEYOND * largest_efforts(task, fine, lowest, highest)
    unstable = None
    engine.begin(wanted[0] * factor, speeds[0] * factor)
    total = np.zeros(len(kp))
    good = True
    for k in range(count + 1):
        joints, rates = (part / factor for part in engine.measure())
        missed = wanted[2 * k] - joints
        tracking[k] = -missed
        time = float(fine.t[2 * k])
        if not (good and (np.abs(missed) < far).all()):
            worst = int(np.argmax(np.nan_to_num(np.abs(missed) / far, nan=np.inf)))
            unstable = Instability(time, names[worst], "the controller loses the motion")
            break
        if k == count:
            break
        summed = total + hold * missed
        asked[k] = kp * missed + ki * summed + kd * (speeds[2 * k] - rates) + ahead[k]
        held = (asked[k] > highest) & (missed > 0) | (asked[k] < lowest) & (missed < 0)
        total = np.where(held, total, summed)
        if (np.abs(asked[k]) > most).any():
            worst = int(np.argmax(np.abs(asked[k]) / most))
            joint = fine.joints.coordinates[worst]
            unstable = Instability(
                time, joint.name,
                f"the controller asks for {asked[k, worst]:.3g} {effort_unit(joint.kind)}, beyond "
                f"{most[worst]:.3g} {effort_unit(joint.kind)}",
            )  # fmt: skip
            break
        received[k] = np.clip(asked[k], lowest, highest)
        good = engine.advance(received[k], steps)
        if progress is not None:
            progress(k + 1, count)
    done = k if k else 1
    if not k:  # unstable from the start: what was asked is all there is
        received[0] = np.clip(asked[0], lowest, highest)
        tracking[1] = tracking[0]
    middle = slice(1, 2 * done, 2)
    comparison = _compared(
        fine.t[middle], fine.effort[middle], received[:done],
        (tracking[1 : done + 1] + tracking[:done]) / 2,
    )  # fmt: skip
    starts = fine.t[: 2 * done : 2]
    saturation = _saturation(names, asked[:done], (lowest, highest), starts, hold)
    return Forward(comparison, saturation, unstable)


def effort_limits(task: MotionTask) -> tuple[Vector, Vector]:
    """Return the lowest and highest effort (n,) that each drive can give, N and N m."""
    ends = [
        task.other_limits.get(f"{c.name}{EFFORT}", (-np.inf, np.inf)) for c in task.mechanism.joints
    ]
    return np.array([low for low, _ in ends]), np.array([high for _, high in ends])


def largest_efforts(task: MotionTask, motion: Motion, lowest: Vector, highest: Vector) -> Vector:
    """Return the largest effort (n,) of each joint: what the motion needs, or its drive gives."""
    assert motion.effort is not None
    size = (
        task.mechanism.characteristic_length(task.parameters) * METRES[task.mechanism.length_unit]
    )
    lengths = np.array([c.kind == "length" for c in task.mechanism.joints])
    needed = np.abs(motion.effort).max(axis=0)
    common = float((needed * np.where(lengths, size, 1.0)).max())  # as torques
    needed = np.maximum(needed, _LIGHT * common / np.where(lengths, size, 1.0))
    given = np.maximum(np.abs(lowest), np.abs(highest))
    return np.asarray(np.maximum(needed, np.where(np.isfinite(given), given, 0.0)))


def _saturation(
    names: Sequence[str], asked: Values, limits: tuple[Vector, Vector], t: Vector, hold: float
) -> tuple[Saturation, ...]:
    """Return when which drive was at its limits."""
    lowest, highest = limits
    beyond = (asked < lowest) | (asked > highest)
    return tuple(
        Saturation(name, float(lowest[k]), float(highest[k]), float(t[beyond[:, k]][0]),
                   hold * int(beyond[:, k].sum()))
        for k, name in enumerate(names)
        if beyond[:, k].any()
    )  # fmt: skip


def controller_gains(task: MotionTask, engine: Engine) -> dict[str, Vector]:
    """Return kp, ki and kd, (n,) each: effort by joint position, its integral and its rate.

    Positions are in the mechanism's length unit and rad. Where the configuration gives none of
    the three they are w^2 m, 0 and 2 w m of a critically damped joint with w = 0.2 / hold (at
    most 100 rad/s), slow enough for a controller that sees the joint once a hold, and the mass m
    that the joint feels at the start with the others free.
    """
    controller = task.config.controller
    assert controller is not None
    joints = task.mechanism.joints
    given = {"kp": controller.kp, "ki": controller.ki, "kd": controller.kd}
    if all(gain is None for gain in given.values()):
        speed = min(BANDWIDTH / holds(task)[0], FASTEST)
        mass = engine.joint_masses() * joint_factors(task)
        return {"kp": speed**2 * mass, "ki": 0 * mass, "kd": 2 * speed * mass}
    return {
        name: np.array([gain.get(c.name, 0.0) for c in joints])
        if isinstance(gain, Mapping) else np.full(len(joints), gain or 0.0)
        for name, gain in given.items()
    }  # fmt: skip


def _whole_holds(t: Vector, hold: float) -> int:
    """Return how many holds the instants, half a hold apart, are good for."""
    even = np.flatnonzero(np.abs(t - t[0] - 0.5 * hold * np.arange(len(t))) < 1e-6 * hold)
    return (len(even) - 1) // 2

"""A motion on an independent engine: its inverse dynamics, and forward under a controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.dynamics import GRAVITY
from pmopt.analysis.engine import Engine
from pmopt.analysis.mjcf import to_mjcf
from pmopt.analysis.motion import Course, Motion
from pmopt.analysis.motion_config import EngineSettings, MotionTask
from pmopt.analysis.multibody import Tree, build_tree
from pmopt.errors import InputError, PmoptError
from pmopt.mechanisms.base import Coordinate, Vector
from pmopt.units import METRES

Values = NDArray[np.float64]
Progress = Callable[[int, int], None]

#: Peaks smaller than this share of the largest are rounding: errors are counted in it.
_ROUNDING = 1e-9
#: Speed of a controller whose gains are not given, rad by hold, and the largest, rad/s.
BANDWIDTH, FASTEST = 0.2, 100.0
#: A joint this far from where it should be, rad or characteristic lengths, has been lost.
_LOST = 0.5


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
        Engine less motion in per cent of the joint's peak.
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
class Simulation:
    """What an engine says of a motion.

    Attributes
    ----------
    joints : tuple of Coordinate
        Actuated.
    inverse : Comparison
        The engine's inverse dynamics at the motion's instants.
    forward : Comparison or None
        Under the controller, a row for every hold; None without controller.
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
        If it is no whole number of steps.
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
        If the mechanism has no masses, or for a hold that is no whole number of steps.
    PmoptError
        If the engine is missing, its loops do not close or the controller loses the motion.
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
    values = unwrapped(course)
    followed = engine.inverse(
        motion.t, values * factor, course.rates * factor, course.accelerations * factor
    )
    unit = METRES[task.mechanism.length_unit]
    own = np.stack([motion.centres[name][:, 0] for name in bodies], axis=1) * unit
    inverse = _compared(
        motion.t, motion.effort, followed.efforts, followed.joints / factor - values
    )
    forward, hold, gains = None, None, None
    if fine is not None and task.config.controller is not None:
        hold, _ = holds(task)
        gains = controller_gains(task, engine)
        forward = run_forward(task, engine, fine, gains, followed.efforts[0], progress)
    return Simulation(
        course.coordinates, inverse, forward,
        float(np.linalg.norm(followed.centres - own, axis=2).max()), float(followed.gaps.max()),
        engine.name, engine.version, model, settings.step, hold, gains,
    )  # fmt: skip


def joint_factors(task: MotionTask) -> Vector:
    """Return what turns positions of the actuated joints to m and rad."""
    unit = METRES[task.mechanism.length_unit]
    return np.array([unit if c.kind == "length" else 1.0 for c in task.mechanism.joints])


def unwrapped(course: Course) -> Values:
    """Return positions along a motion with angles that do not jump by a turn: an engine counts."""
    values = course.values.copy()
    angles = [k for k, c in enumerate(course.coordinates) if c.kind == "angle"]
    values[:, angles] = np.unwrap(values[:, angles], axis=0)
    return values


def _compared(t: Vector, effort: Values, engine_effort: Values, tracking: Values) -> Comparison:
    peak = np.abs(effort).max(axis=0)
    counted = np.maximum(peak, max(_ROUNDING * float(peak.max()), 1e-300))
    error = 100 * (engine_effort - effort) / counted
    return Comparison(t, effort, engine_effort, error, tracking, peak)


def run_forward(
    task: MotionTask, engine: Engine, fine: Motion, gains: Mapping[str, Vector],
    balance: Vector, progress: Progress | None = None,
) -> Comparison:  # fmt: skip
    """Run the engine under the controller, from the motion's start.

    At instants t_k, a hold apart, the controller measures the actuated joints and asks for::

        u_k = kp e + ki (sum of e up to t_k) hold + kd e' + effort(t_k + hold / 2)

    with e the motion's joint less the measured one and the last term, the motion's effort at the
    middle of the hold, only with ``feedforward``; without it ``balance`` stands in its place, so
    that the controller takes over without a blow. The engine receives u_k from t_k to t_k + hold,
    which stands for the middle: that is where both sides' efforts are compared, and the
    tracking is the mean of that at both ends.

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
    wanted, speeds = unwrapped(fine.joints), fine.joints.rates
    ahead = fine.effort[1::2]
    if not controller.feedforward:
        ahead = np.broadcast_to(balance, ahead.shape)
    received, tracking = np.empty((count, len(kp))), np.empty((count + 1, len(kp)))
    engine.begin(wanted[0] * factor, speeds[0] * factor)
    total = np.zeros(len(kp))
    good = True
    for k in range(count + 1):
        joints, rates = (part / factor for part in engine.measure())
        missed = wanted[2 * k] - joints
        tracking[k] = -missed
        if not (good and (np.abs(missed) < far).all()):
            raise PmoptError(
                f"the controller loses the motion at t = {fine.t[2 * k]:.9g} s: other gains or a "
                "shorter hold are needed"
            )
        if k == count:
            break
        total += hold * missed
        received[k] = kp * missed + ki * total + kd * (speeds[2 * k] - rates) + ahead[k]
        good = engine.advance(received[k], steps)
        if progress is not None:
            progress(k + 1, count)
    middle = slice(1, 2 * count, 2)
    return _compared(
        fine.t[middle], fine.effort[middle], received, (tracking[1:] + tracking[:-1]) / 2
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

"""A motion that is given by its joints: the poses that follow them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from pmopt.analysis.kinematics.forward import forward_kinematics
from pmopt.analysis.motion.dynamics import Mover
from pmopt.analysis.motion.records import (
    Span,
    Trajectory,
    Values,
)
from pmopt.errors import UnreachableError
from pmopt.mechanisms.mechanism import (
    InverseSolution,
    Mechanism,
    Parameters,
    Vector,
    wrap_angle,
)
from pmopt.units import unit_of

#: A joint-space motion is followed to this miss of its joints, relative to the characteristic
#: length; in at most so many steps an instant.
_CLOSE = 1e-12
_STEPS = 12


def follow_joints(
    mover: Mover, trajectory: Trajectory
) -> tuple[Values, Values, Values, list[Span]]:
    """Return poses, rates and accelerations of a motion that is given by its joints.

    From the assembly mode nearest to home that has the working mode, Newton's method follows the
    joints from instant to instant; NaN from where it cannot.
    """
    mechanism, parameters, mode = mover.mechanism, mover.parameters, mover.working_mode
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
            lost(k, f"the platform cannot be followed on to {shown}: the joints cannot be "
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

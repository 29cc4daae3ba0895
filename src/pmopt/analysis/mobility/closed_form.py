"""A mechanism's closed-form kinematics against its declared joints."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pmopt.analysis.mobility import finite_motion, screws
from pmopt.analysis.mobility.screws import IDENTITY, Displacement, compose, small
from pmopt.mechanisms.mechanism import Chain, Matrix, Mechanism, Parameters, Vector, within

#: Steps of the straight path in pose coordinates from home to a pose.
_PATH = 24
#: Step of the finite differences, in scaled lengths and radians.
_STEP = 1e-3
#: What an agreement must keep: misfit over the characteristic length, sine of an angle.
MISFIT, ANGLE = 1e-9, 1e-6


@dataclass(frozen=True)
class Agreement:
    """How well the closed form and the declared joints agree at random reachable poses.

    Attributes
    ----------
    poses : int
    misfit : float
        Largest distance of a limb's end, its joints moved from home by the product of
        exponentials, from where the closed form has the platform; relative to the characteristic
        length.
    limb_angle : float
        Largest sine between the twists of a limb so moved and those of its declared layout.
    freedom_angle : float
        Largest sine between the platform's velocities by the closed form and its twists.
    rate_error : float
        Largest relative error of a row of J^-1 against the screws, its sign left free.
    """

    poses: int
    misfit: float
    limb_angle: float
    freedom_angle: float
    rate_error: float

    @property
    def holds(self) -> bool:
        """Whether all agree."""
        angles = (self.limb_angle, self.freedom_angle, self.rate_error)
        return self.poses > 0 and self.misfit < MISFIT and max(angles) < ANGLE

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "poses": self.poses,
            "misfit": self.misfit,
            "limb_angle": self.limb_angle,
            "freedom_angle": self.freedom_angle,
            "rate_error": self.rate_error,
            "holds": self.holds,
        }


class _Frame:
    """A mechanism seen in scaled lengths from its platform's centre at home."""

    def __init__(self, mechanism: Mechanism, parameters: Parameters, mode: str) -> None:
        self.mechanism, self.parameters, self.mode = mechanism, parameters, mode
        self.length = mechanism.characteristic_length(parameters)
        self.home = mechanism.home(parameters)
        self.rotation, self.centre = mechanism.platform(parameters, self.home, mode)

    def reachable(self, pose: Mapping[str, float]) -> bool:
        return any(
            s.working_mode == self.mode for s in self.mechanism.inverse(self.parameters, pose)
        )

    def place(self, pose: Mapping[str, float]) -> Displacement:
        """Return the platform's displacement from home."""
        rotation, centre = self.mechanism.platform(self.parameters, pose, self.mode)
        return rotation @ self.rotation.T, (centre - self.centre) / self.length

    def chains(self, pose: Mapping[str, float]) -> tuple[Chain, ...]:
        layout = self.mechanism.layout(self.parameters, pose, self.mode)
        return tuple(screws.scaled(chain, self.centre, self.length) for chain in layout)

    def velocities(self, pose: Mapping[str, float]) -> Matrix | None:
        """Return the platform's twist for unit rates of each scaled pose coordinate."""
        back = screws.inverse(self.place(pose))
        columns = []
        for coordinate in self.mechanism.pose:
            unit = self.length if coordinate.kind == "length" else 1.0
            twist = np.zeros(6)
            for steps, weight in ((-2, 1), (-1, -8), (1, 8), (2, -1)):
                near = {
                    **pose, coordinate.name: pose[coordinate.name] + steps * _STEP * unit
                }  # fmt: skip
                if not self.reachable(near):
                    return None
                twist += weight * small(compose(self.place(near), back))
            # The finite displacement's translation is that of the origin: no correction needed.
            columns.append(twist / (12 * _STEP))
        return np.array(columns).T


def compare(
    mechanism: Mechanism,
    parameters: Parameters,
    mode: str,
    poses: int,
    rng: np.random.Generator,
) -> Agreement:
    """Compare at random reachable poses that a path from home leads to.

    Parameters
    ----------
    mechanism, parameters
    mode : str
        Working mode.
    poses : int
        Poses wanted; fewer where hardly any is reachable.
    rng : numpy Generator
    """
    frame = _Frame(mechanism, parameters, mode)
    worst = np.zeros(4)
    count = 0
    for _ in range(200 * poses):
        if count == poses:
            break
        pose = _random_pose(frame, rng)
        found = None if pose is None else _at(frame, pose)
        if found is not None:
            worst = np.maximum(worst, found)
            count += 1
    misfit, limb, freedom, rate = (float(v) for v in worst)
    return Agreement(count, misfit, limb, freedom, rate)


def _random_pose(frame: _Frame, rng: np.random.Generator) -> dict[str, float] | None:
    """Return a pose between home and a random one of the reach box, if its limits are kept."""
    mechanism, parameters = frame.mechanism, frame.parameters
    limits = mechanism.default_limits(parameters)
    lower, upper = (v.copy() for v in mechanism.reach_box(parameters, limits))
    domain = mechanism.default_domain(parameters)
    for k, coordinate in enumerate(mechanism.pose):
        low, high = domain.get(coordinate.name, (-math.inf, math.inf))
        lower[k], upper[k] = max(lower[k], low), min(upper[k], high)
    target = lower + rng.uniform(size=lower.size) * (upper - lower)
    share = rng.uniform(0.2, 1.0)
    pose = {
        c.name: frame.home[c.name] + share * (float(t) - frame.home[c.name])
        for c, t in zip(mechanism.pose, target, strict=True)
    }
    if not mechanism.admits(parameters, pose):
        return None
    for solution in mechanism.inverse(parameters, pose):
        if solution.working_mode == frame.mode:
            values = {**solution.joints, **solution.passive}
            kept = all(
                within(values[c.name], limits[c.name], c.kind)
                for c in mechanism.limited
                if c.name in limits and c.name in values
            )
            return pose if kept else None
    return None


def _at(frame: _Frame, pose: dict[str, float]) -> Vector | None:
    """Return the four errors at a pose; None where the path or a difference is out of reach."""
    path = [
        {k: h + s / _PATH * (pose[k] - h) for k, h in frame.home.items()}
        for s in range(1, _PATH + 1)
    ]
    if not all(frame.reachable(p) for p in path):
        return None
    velocities = frame.velocities(pose)
    if velocities is None:
        return None
    goals = [frame.place(p) for p in path]
    declared = frame.chains(pose)
    misfit = limb_angle = 0.0
    for chain, final in zip(frame.chains(frame.home), declared, strict=True):
        moved, end = chain, IDENTITY
        for goal in goals:
            moved, end = finite_motion.follow(moved, end, goal)
        error = small(compose(goals[-1], screws.inverse(end)))
        misfit = max(misfit, float(np.abs(error).max()))
        angle = screws.distance(screws.limb_twists(moved), screws.limb_twists(final))
        limb_angle = max(limb_angle, angle)
    # The screws' origin is home's centre, as that of the displacements.
    freedom_angle = screws.distance(velocities, finite_motion.platform_twists(declared))
    return np.array(
        [misfit, limb_angle, freedom_angle, _rate_error(frame, pose, declared, velocities)]
    )


def _rate_error(
    frame: _Frame, pose: dict[str, float], chains: tuple[Chain, ...], velocities: Matrix
) -> float:
    """Return the error of J^-1's rows against the limbs' joint rates."""
    mechanism, parameters = frame.mechanism, frame.parameters
    joints = next(
        s.joints for s in mechanism.inverse(parameters, pose) if s.working_mode == frame.mode
    )
    j_x, j_q = mechanism.velocity_maps(parameters, pose, joints)
    rates = np.linalg.solve(j_q, j_x)
    unit = np.array([frame.length if c.kind == "length" else 1.0 for c in mechanism.pose])
    names = [c.name for c in mechanism.joints]
    worst = 0.0
    for chain in chains:
        maps = np.linalg.pinv(screws.limb_twists(chain)) @ velocities
        for name, column in screws.drive_columns(chain).items():
            k = names.index(name)
            wanted = rates[k] * unit
            if mechanism.joints[k].kind == "length":
                wanted = wanted / frame.length
            size = float(np.linalg.norm(wanted))
            error = min(float(np.linalg.norm(sign * maps[column] - wanted)) for sign in (1, -1))
            worst = max(worst, error / max(size, 1e-300))
    return worst

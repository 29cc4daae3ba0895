"""A mechanism at its defaults, and the poses at which it is checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from pmopt.mechanisms.mechanism import (
    Coordinate,
    InverseSolution,
    Matrix,
    Mechanism,
    Parameters,
    Ranges,
    Vector,
)

#: Random rays from home for each pose that is wanted, and how far in a pose is moved on each.
_TRIES, _SHRINK = 4, (1.0, 0.6, 0.36, 0.2, 0.1, 0.03)
#: Poses of each working mode, and working modes, that are looked at.
POSES, MODES = 6, 3
#: Step of differences, as a share of the characteristic length or of 1 rad.
STEP = 2e-4


@dataclass(frozen=True)
class Sample:
    """A reachable pose and its solution in one working mode, with the kernel's entries."""

    mode: str
    pose: dict[str, float]
    solution: InverseSolution
    entries: Matrix


@dataclass
class Subject:
    """One design of a mechanism.

    Parameters
    ----------
    mechanism : Mechanism
    seed : int
    """

    mechanism: Mechanism
    seed: int = 1
    parameters: Parameters = field(init=False)
    _near: dict[tuple[int, int], list[tuple[dict[str, float], InverseSolution]]] = field(
        init=False, default_factory=dict
    )

    def __post_init__(self) -> None:
        self.parameters = self.mechanism.resolve({})

    @cached_property
    def limits(self) -> Ranges:
        """Limits that hold by default."""
        return dict(self.mechanism.default_limits(self.parameters))

    @cached_property
    def size(self) -> float:
        """Characteristic length."""
        return self.mechanism.characteristic_length(self.parameters)

    @cached_property
    def box(self) -> tuple[Vector, Vector]:
        """Box of reach under the default limits."""
        lower, upper = self.mechanism.reach_box(self.parameters, self.limits)
        return np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)

    @cached_property
    def home(self) -> dict[str, float]:
        """Declared home."""
        return dict(self.mechanism.home(self.parameters))

    @property
    def order(self) -> int:
        """Number of actuated joints."""
        return len(self.mechanism.joints)

    @property
    def modes(self) -> tuple[str, ...]:
        """Working modes that are looked at."""
        return self.mechanism.working_modes[:MODES]

    def constants(self, mode: str, length: float, limits: Ranges) -> tuple[Any, ...]:
        """Return the kernel's constants: a record, or a tuple of numbers."""
        found = self.mechanism.kernel_constants(self.parameters, mode, length, limits)
        return found if isinstance(found, tuple) else tuple(found)

    def random_poses(self, count: int, margin: float, purpose: int) -> Matrix:
        """Return random poses of the box, widened by a share of its width on every side."""
        lower, upper = self.box
        random = np.random.default_rng([self.seed, purpose])
        unit = random.uniform(-margin, 1 + margin, (count, len(lower)))
        poses: Matrix = lower + unit * (upper - lower)
        return poses

    def named(self, row: Vector) -> dict[str, float]:
        """Return a row of numbers as a pose."""
        return {c.name: float(v) for c, v in zip(self.mechanism.pose, row, strict=True)}

    def shown(self, pose: Mapping[str, float], mode: str | None = None) -> str:
        """Return where something holds: `` at x = 0.1 m, .. (out-out)``."""
        text = ", ".join(
            f"{c.name} = {pose[c.name]:.6g} {self.mechanism.unit(c)}" for c in self.mechanism.pose
        )
        return f" at {text}" + (
            f" ({mode})" if mode and len(self.mechanism.working_modes) > 1 else ""
        )

    def solution(self, pose: Mapping[str, float], mode: str) -> InverseSolution | None:
        """Return the solution of a working mode, None where there is none."""
        found = self.mechanism.inverse(self.parameters, pose)
        return next((s for s in found if s.working_mode == mode), None)

    @cached_property
    def samples(self) -> list[Sample]:
        """Reachable poses, of several working modes, each with its solution.

        Each lies on a ray from home to a random pose of the box, as far out as the kernel's
        margin allows. What inverse has no solution for is left out, and found elsewhere.
        """
        found: list[Sample] = []
        home = np.array(list(self.home.values()))
        for number, mode in enumerate(self.modes):
            constants = self.constants(mode, 1.0, self.limits)
            count = 0
            for row in self.random_poses(_TRIES * POSES, 0.0, 10 + number):
                sample = self._inwards(mode, constants, home, row)
                if sample is not None:
                    found.append(sample)
                    count += 1
                if count == POSES:
                    break
        return found

    def _inwards(
        self, mode: str, constants: tuple[float, ...], home: Vector, row: Vector
    ) -> Sample | None:
        """Return the first reachable pose on the way from a pose to home."""
        for share in _SHRINK:
            point = home + share * (row - home)
            margin, *entries = self.mechanism.kernel(*point.tolist(), constants)
            if margin >= 0:
                pose = self.named(point)
                solution = self.solution(pose, mode)
                if solution is None:
                    return None
                matrix = np.reshape(np.array(entries, dtype=float), (self.order, self.order))
                return Sample(mode, pose, solution, matrix)
        return None

    def step(self, coordinate: Coordinate) -> float:
        """Return the step of differences along a coordinate."""
        return STEP * (self.size if coordinate.kind == "length" else 1.0)

    def neighbours(self, sample: Sample, k: int) -> list[tuple[dict[str, float], InverseSolution]]:
        """Return poses 1, -1, 2 and -2 steps along coordinate k, with solutions; [] without."""
        key = (id(sample), k)
        if key not in self._near:
            self._near[key] = self._neighbours(sample, k)
        return self._near[key]

    def _neighbours(self, sample: Sample, k: int) -> list[tuple[dict[str, float], InverseSolution]]:
        coordinate = self.mechanism.pose[k]
        found = []
        for times in (1, -1, 2, -2):
            pose = dict(sample.pose)
            pose[coordinate.name] += times * self.step(coordinate)
            solution = self.solution(pose, sample.mode)
            if solution is None:
                return []
            found.append((pose, solution))
        return found

    def slope(self, values: list[Vector], k: int) -> tuple[Vector, Vector]:
        """Return the derivative by coordinate k of values at its neighbours, and its error."""
        h = self.step(self.mechanism.pose[k])
        near, far = (values[0] - values[1]) / (2 * h), (values[2] - values[3]) / (4 * h)
        return (4 * near - far) / 3, np.abs(near - far)

    def joint_values(self, solution: InverseSolution, about: InverseSolution) -> Vector:
        """Return the actuated joints' positions, angles within half a turn of others."""
        values = []
        for c in self.mechanism.joints:
            value, near = solution.joints[c.name], about.joints[c.name]
            if c.kind == "angle":
                value = near + math.remainder(value - near, 2 * math.pi)
            values.append(value)
        return np.array(values)

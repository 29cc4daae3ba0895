"""What inverse and forward kinematics find."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class InverseSolution:
    """One branch of the inverse kinematics: a working mode and its joint positions.

    ``passive`` are the positions of the passive joints that limits can be set on.
    """

    working_mode: str
    joints: dict[str, float]
    parasitic: dict[str, float]
    passive: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class ForwardSolution:
    """One assembly mode: a pose and the largest residual of the constraints at it."""

    pose: dict[str, float]
    parasitic: dict[str, float]
    residual: float


@dataclass(frozen=True)
class Assemblies:
    """The assembly modes of one set of joint positions.

    Attributes
    ----------
    solutions : tuple of ForwardSolution
        Nearest to home first.
    proven : bool
        Whether it is proven that there are no others.
    free : bool
        Whether the joint positions leave the platform free to move, with no end of solutions.
    """

    solutions: tuple[ForwardSolution, ...]
    proven: bool = False
    free: bool = False


@dataclass(frozen=True)
class Reach:
    """How far a pose is inside (> 0) or outside (< 0) the reach of one limb.

    ``distance`` is the distance to the limb's singular surface, in the length unit; ``reason``
    says what a pose outside is, "too far" or "too close".
    """

    limb: str
    distance: float
    reason: str

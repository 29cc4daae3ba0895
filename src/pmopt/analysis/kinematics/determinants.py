"""Normalised determinants of one pose, by kind of singularity and part of the mechanism."""

from __future__ import annotations

from collections.abc import Mapping

from pmopt.mechanisms.mechanism import InverseSolution, Mechanism, Parameters

KINDS = {"inverse": "inverse (type I)", "forward": "forward (type II)", "constraint": "constraint"}
#: A kind of singularity and the part of the mechanism, a limb or the platform.
Part = tuple[str, str]


def branch_at(
    mechanism: Mechanism, working_mode: str, parameters: Parameters, pose: Mapping[str, float]
) -> InverseSolution | None:
    """Return the working mode's solution of the inverse kinematics, None out of reach."""
    branches = mechanism.inverse(parameters, pose)
    return next((s for s in branches if s.working_mode == working_mode), None)


def measures_at(
    mechanism: Mechanism, working_mode: str, parameters: Parameters, pose: Mapping[str, float]
) -> dict[Part, float] | None:
    """Return every normalised determinant, None out of reach."""
    branch = branch_at(mechanism, working_mode, parameters, pose)
    if branch is None:
        return None
    found = mechanism.singularity_measures(parameters, pose, branch.joints)
    return {(kind, part): value for kind, parts in found.items() for part, value in parts.items()}

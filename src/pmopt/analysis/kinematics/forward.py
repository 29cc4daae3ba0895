"""Forward kinematics: the assembly modes of joint positions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pmopt.analysis.kinematics.inverse import coordinate_units
from pmopt.analysis.kinematics.limits import shown
from pmopt.analysis.record import OfSubject, Subject
from pmopt.compiler import programs
from pmopt.compiler.machine_code import Compiled
from pmopt.errors import InputError, UnreachableError
from pmopt.mechanisms.mechanism import Assemblies, ForwardSolution, Mechanism, wrap_angle
from pmopt.units import unit_of

Complete = Literal["proven", "not proven"]


@dataclass(frozen=True)
class ForwardResult(OfSubject):
    """The assembly modes for a set of joint positions, or the one nearest to a pose.

    ``complete`` says whether it is proven that no assembly mode is missing from the search, and
    ``completeness`` how they were found.
    """

    joints: dict[str, float]
    solutions: tuple[ForwardSolution, ...]
    units: dict[str, str]
    complete: Complete = "not proven"
    completeness: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "mechanism": self.mechanism,
            "joints": self.joints,
            "solutions": [
                {"pose": s.pose, "parasitic": s.parasitic, "residual": s.residual}
                for s in self.solutions
            ],
            "complete": self.complete,
            "units": self.units,
        }


def forward_kinematics(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None,
    joints: Mapping[str, Any],
    where: str = "joints",
    near: Mapping[str, Any] | None = None,
) -> ForwardResult:
    """Solve the forward kinematics: the assembly modes, all that are found or the one nearest.

    Parameters
    ----------
    mechanism, params, where
        See :func:`inverse_kinematics`.
    joints : mapping
        Every actuated joint.
    near : mapping, optional
        A pose; only the assembly mode nearest to it is returned.

    Raises
    ------
    UnreachableError
        Where the mechanism cannot be assembled with these joint positions.
    InputError
        For unknown names and values that are no finite numbers.
    """
    (found,) = Assembling(mechanism, params, near).at([joints], [where])
    if isinstance(found, UnreachableError):
        raise found
    return found


class Assembling:
    """The forward kinematics of one design, for any number of sets of joint positions.

    Parameters
    ----------
    mechanism, params, near
        See :func:`forward_kinematics`.

    Raises
    ------
    InputError
        See :func:`forward_kinematics`.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        params: Mapping[str, Any] | None = None,
        near: Mapping[str, Any] | None = None,
    ) -> None:
        self.mechanism = mechanism
        self.parameters = mechanism.resolve(params or {})
        self._goal = None
        if near is not None:
            self._goal = mechanism.check_coordinates(near, mechanism.pose, "near")
        self._size = mechanism.characteristic_length(self.parameters)
        self._units = _forward_units(mechanism)
        self.subject = Subject.of(mechanism, self.parameters, "all", {}, {})

    @property
    def kernels(self) -> dict[Compiled, tuple[str, ...]]:
        """What is compiled, with the entries that are called."""
        found = self.mechanism.assembler
        return {} if found is None else {programs.assembling(found): ("assemble_all",)}

    def say(self, notify: Callable[[str], None]) -> None:
        """Notify once where it still has to be compiled."""
        name = self.mechanism.name
        for compiled in self.kernels:
            compiled.on_compile = lambda: notify(
                f"compiling the forward kinematics of {name}, once: some seconds"
            )

    def at(
        self, rows: Sequence[Mapping[str, Any]], places: Sequence[str]
    ) -> list[ForwardResult | UnreachableError]:
        """Return what :func:`forward_kinematics` gives of each row alone, to the last bit.

        Parameters
        ----------
        rows : sequence of mapping
            Every actuated joint, each.
        places : sequence of str
            What errors call them.

        Returns
        -------
        list of ForwardResult or UnreachableError
            The latter where the mechanism cannot be assembled.

        Raises
        ------
        InputError
            For unknown names, values that are no finite numbers and joint positions that leave the
            platform free to move.
        """
        mechanism, parameters = self.mechanism, self.parameters
        checked = [
            mechanism.check_coordinates(joints, mechanism.joints, where)
            for joints, where in zip(rows, places, strict=True)
        ]
        found = mechanism.assemblies(parameters, checked)
        return [self._result(*one) for one in zip(checked, places, found, strict=True)]

    def nothing(self, joints: Mapping[str, Any], where: str) -> ForwardResult:
        """Return the result of joint positions that cannot be assembled: no solutions."""
        checked = self.mechanism.check_coordinates(joints, self.mechanism.joints, where)
        return ForwardResult(
            self.subject, checked, (), self._units, completeness=self.mechanism.completeness
        )

    def _result(
        self, joints: dict[str, float], where: str, found: Assemblies
    ) -> ForwardResult | UnreachableError:
        mechanism, goal = self.mechanism, self._goal
        if found.free:
            raise InputError(f"{where}: {mechanism.freed}")
        solutions = found.solutions
        if not solutions:
            reason = mechanism.why_not(self.parameters, joints)
            return UnreachableError(f"{where}: {shown(joints)} cannot be assembled: {reason}")
        if goal is not None:
            nearest = min(solutions, key=lambda s: _distance(mechanism, s.pose, goal, self._size))
            solutions = (nearest,)
        return ForwardResult(
            self.subject, joints, solutions, self._units,
            "proven" if found.proven else "not proven", mechanism.completeness,
        )  # fmt: skip


def _distance(
    mechanism: Mechanism, pose: Mapping[str, float], goal: Mapping[str, float], size: float
) -> float:
    """Return the square of how far two poses are apart, angles weighed by the size.

    Rz(a) Ry(b) Rx(c) is Rz(a + pi) Ry(pi - b) Rx(c + pi): the nearer of both forms counts.
    """

    def apart(pose: Mapping[str, float]) -> float:
        return sum(
            (size * wrap_angle(pose[c.name] - goal[c.name])) ** 2
            if c.kind == "angle"
            else (pose[c.name] - goal[c.name]) ** 2
            for c in mechanism.pose
        )

    turned = dict(pose)
    for role, c in zip(mechanism.roles, mechanism.pose, strict=False):
        if role == "pitch":
            turned[c.name] = math.pi - pose[c.name]
        elif role in ("yaw", "roll"):
            turned[c.name] = pose[c.name] + math.pi
    return min(apart(pose), apart(turned)) if "pitch" in mechanism.roles else apart(pose)


def _forward_units(mechanism: Mechanism) -> dict[str, str]:
    return coordinate_units(mechanism) | {"residual": unit_of("length", mechanism.length_unit)}

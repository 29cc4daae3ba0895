"""Inverse kinematics: joint positions of poses, branch by branch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pmopt.analysis.kinematics.limits import Beyond, Limits, out_of_strokes, shown
from pmopt.analysis.record import OfSubject, Subject
from pmopt.compiler import programs
from pmopt.compiler.machine_code import Compiled
from pmopt.errors import UnreachableError
from pmopt.mechanisms.mechanism import InverseSolution, Mechanism, Parameters
from pmopt.units import unit_of


@dataclass(frozen=True)
class InverseResult(OfSubject):
    """All asked-for branches of the inverse kinematics at a pose.

    Attributes
    ----------
    solutions : tuple of InverseSolution
    within_limits : tuple of bool
        Whether a solution keeps every limit, one a solution.
    beyond : tuple of tuple of Beyond
        What of a solution is not within its limits, one a solution.
    out_of_reach : str or None
        Where no working mode keeps the mechanism's own strokes at the pose, by how much the nearest
        misses them. The same whichever mode is asked for.
    """

    pose: dict[str, float]
    solutions: tuple[InverseSolution, ...]
    within_limits: tuple[bool, ...]
    units: dict[str, str]
    beyond: tuple[tuple[Beyond, ...], ...] = ()
    out_of_reach: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "mechanism": self.mechanism,
            "pose": self.pose,
            "solutions": [
                {
                    "working_mode": s.working_mode,
                    "joints": s.joints,
                    "parasitic": s.parasitic,
                    **({"passive": s.passive} if s.passive else {}),
                    "within_limits": inside,
                    **({} if inside else {"beyond": [b.to_dict() for b in beyond]}),
                }
                for s, inside, beyond in zip(
                    self.solutions, self.within_limits, self.beyond, strict=True
                )
            ],
            "units": self.units,
        }


def coordinate_units(mechanism: Mechanism) -> dict[str, str]:
    """Return the unit of each pose, joint and parasitic coordinate."""
    return {
        c.name: mechanism.unit(c)
        for c in (*mechanism.pose, *mechanism.joints, *mechanism.parasitic)
    }


def inverse_kinematics(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None,
    pose: Mapping[str, Any],
    working_mode: str = "all",
    limits: Mapping[str, Any] | None = None,
    where: str = "pose",
) -> InverseResult:
    """Solve the inverse kinematics at a pose.

    A working mode that closes the limbs is listed whether it keeps the limits or not: what it
    exceeds stands in ``beyond``. One mode gives what all give of it.

    Parameters
    ----------
    mechanism : Mechanism
    params : mapping or None
        Design parameters; those left out take their defaults.
    pose : mapping
        Every pose coordinate, in the mechanism's length unit and rad.
    working_mode : str
        One of the mechanism's, or ``"all"``.
    limits : mapping, optional
        Joint limits ``{joint: (lower, upper)}`` that ``within_limits`` holds against, beside the
        mechanism's own or in their place.
    where : str
        What errors call the pose.

    Raises
    ------
    UnreachableError
        Where the limbs cannot be closed, or not in the working mode, naming the limb and by how
        much the pose is out of its reach.
    InputError
        For unknown names and values that are no finite numbers.
    """
    (found,) = Inverting(mechanism, params, working_mode, limits).at([pose], [where])
    if isinstance(found, OutOfReach):
        raise found.error()
    return found


@dataclass(frozen=True)
class OutOfReach:
    """A pose without what was asked for there; ``error`` returns why."""

    pose: dict[str, float]
    error: Callable[[], UnreachableError]


class Inverting:
    """The inverse kinematics of one design, for any number of poses.

    Parameters
    ----------
    mechanism, params, working_mode, limits
        See :func:`inverse_kinematics`.

    Raises
    ------
    InputError
        See :func:`inverse_kinematics`.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        params: Mapping[str, Any] | None = None,
        working_mode: str = "all",
        limits: Mapping[str, Any] | None = None,
    ) -> None:
        self.mechanism = mechanism
        self.parameters = mechanism.resolve(params or {})
        given = mechanism.check_ranges(limits or {}, mechanism.limited, "limits")
        ranges = {**mechanism.default_limits(self.parameters), **given}
        if working_mode != "all":
            mechanism.check_mode(working_mode)
        self._mode = working_mode
        own = {k: v for k, v in ranges.items() if k not in given}
        strokes = {c.name: own[c.name] for c in mechanism.joints if c.name in own}
        self._strokes = Limits(mechanism, strokes, mechanism.limited)
        self._limits = Limits(mechanism, ranges, mechanism.limited)
        self._fixed = Limits(mechanism, mechanism.pose_limits(self.parameters), mechanism.pose)
        self._units = coordinate_units(mechanism)
        self._ranges = ranges

    @property
    def kernels(self) -> dict[Compiled, tuple[str, ...]]:
        """What is compiled for many poses, with the entries that are called."""
        found = self.mechanism.inverter
        return {} if found is None else {programs.assembling(found): ("assemble_all",)}

    def say(self, notify: Callable[[str], None]) -> None:
        """Notify once where it still has to be compiled."""
        name = self.mechanism.name
        for compiled in self.kernels:
            compiled.on_compile = lambda: notify(
                f"compiling the inverse kinematics of {name}, once: some seconds"
            )

    def at(
        self, poses: Sequence[Mapping[str, Any]], places: Sequence[str]
    ) -> list[InverseResult | OutOfReach]:
        """Return what :func:`inverse_kinematics` gives of each pose alone, to the last bit.

        Parameters
        ----------
        poses : sequence of mapping
            Every pose coordinate, each.
        places : sequence of str
            What errors call them.

        Raises
        ------
        InputError
            For unknown names and values that are no finite numbers.
        """
        mechanism = self.mechanism
        checked = [
            mechanism.check_coordinates(pose, mechanism.pose, where)
            for pose, where in zip(poses, places, strict=True)
        ]
        found = mechanism.inverses(self.parameters, checked)
        return [self._result(*one) for one in zip(checked, places, found, strict=True)]

    def _subject(self, pose: dict[str, float]) -> Subject:
        box = {name: (value, value) for name, value in pose.items()}
        return Subject.of(self.mechanism, self.parameters, self._mode, box, self._ranges)

    def _result(
        self, pose: dict[str, float], where: str, solutions: tuple[InverseSolution, ...]
    ) -> InverseResult | OutOfReach:
        mechanism, mode = self.mechanism, self._mode
        if not solutions:
            return OutOfReach(pose, lambda: _not_reached(mechanism, self.parameters, pose, where))
        chosen = tuple(s for s in solutions if mode in ("all", s.working_mode))
        if not chosen:
            text = (
                f"{where}: {shown(pose)} is out of reach in working mode {mode}; "
                f"it is reached in {', '.join(s.working_mode for s in solutions)}"
            )
            return OutOfReach(pose, lambda: UnreachableError(text))
        misses = [self._strokes.beyond(s.joints) for s in solutions]
        fixed = self._fixed.beyond(pose)
        beyond = tuple((*fixed, *self._limits.beyond({**s.passive, **s.joints})) for s in chosen)
        return InverseResult(
            self._subject(pose),
            pose,
            chosen,
            tuple(not b for b in beyond),
            self._units,
            beyond,
            None if not all(misses) else out_of_strokes(mechanism, misses, pose, where),
        )

    def nothing(self, pose: dict[str, float]) -> InverseResult:
        """Return the result of a pose out of reach: no solutions."""
        return InverseResult(self._subject(pose), pose, (), (), self._units)


def reached(mechanism: Mechanism, result: InverseResult, where: str) -> InverseResult:
    """Return a result of one working mode that keeps the mechanism's own strokes.

    Raises
    ------
    UnreachableError
        Where it does not.
    """
    names = [c.name for c in mechanism.joints]
    misses = tuple(b for b in result.beyond[0] if b.name in names)
    if misses:
        raise UnreachableError(out_of_strokes(mechanism, [misses], result.pose, where))
    return result


def _not_reached(
    mechanism: Mechanism, parameters: Parameters, pose: Mapping[str, float], where: str
) -> UnreachableError:
    """Return the error that names each limb that cannot reach the pose and by how much."""
    unit = unit_of("length", mechanism.length_unit)
    misses = [
        f"{r.limb} misses by {-r.distance:.6g} {unit} ({r.reason})"
        for r in mechanism.reach(parameters, pose)
        if r.distance < 0
    ]
    reason = "; ".join(misses) or "the limbs cannot be assembled there"
    return UnreachableError(f"{where}: {shown(pose)} is out of reach: {reason}")

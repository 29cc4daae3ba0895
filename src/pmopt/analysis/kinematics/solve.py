"""Inverse and forward kinematics and the Jacobian at one pose, as results with units."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np

from pmopt.analysis.kinematics.index_units import entry_units, index_note, mixes_units
from pmopt.compiler import programs
from pmopt.compiler.machine_code import Compiled
from pmopt.errors import InputError, UnreachableError
from pmopt.mechanisms.mechanism import (
    Coordinate,
    ForwardSolution,
    InverseSolution,
    JacobianKind,
    Matrix,
    Mechanism,
    Parameters,
    Ranges,
    Vector,
    within,
    wrap_angle,
)
from pmopt.numerics.elementary import exp, log
from pmopt.numerics.matrices import singular_values, solve
from pmopt.units import ONE, exact, unit_of

#: A pose nearer than this to a singularity (distance over the size of the mechanism, or
#: normalised determinant) is one: rounding in the pose leaves no more.
SINGULAR = 1e-9


Complete = Literal["proven", "not proven"]


@dataclass(frozen=True)
class Beyond:
    """A joint position or coordinate that is not within its limits.

    ``miss`` is by how much, of angles modulo a turn; all in ``unit``.
    """

    name: str
    value: float
    lower: float
    upper: float
    miss: float
    unit: str

    def __str__(self) -> str:
        """Return it in words."""
        unit = "" if self.unit == ONE else f" {self.unit}"
        limits = f"[{exact(self.lower)}, {exact(self.upper)}]{unit}"
        text = f"{self.name} = {self.value:.6g}{unit} misses {limits} by {self.miss:.6g}{unit}"
        if self.unit == "rad":
            return text
        return f"{text} ({'too close' if self.value < self.lower else 'too far'})"

    @property
    def short(self) -> str:
        """Only by how much."""
        return f"{self.name} by {self.miss:.6g}" + ("" if self.unit == ONE else f" {self.unit}")

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form; a side that is open is None."""
        return {
            "name": self.name,
            "value": self.value,
            "lower": self.lower if np.isfinite(self.lower) else None,
            "upper": self.upper if np.isfinite(self.upper) else None,
            "miss": self.miss,
            "unit": self.unit,
        }


@dataclass(frozen=True)
class InverseResult:
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

    mechanism: str
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


@dataclass(frozen=True)
class ForwardResult:
    """The assembly modes for a set of joint positions, or the one nearest to a pose.

    ``complete`` says whether it is proven that no assembly mode is missing from the search, and
    ``completeness`` how they were found.
    """

    mechanism: str
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


@dataclass(frozen=True)
class JacobianResult:
    """Velocity maps and conditioning at a pose in one working mode.

    ``inverse_distance`` is the distance to the inverse (type I) singularity by limb, in the
    length unit; ``inverse_measure``, ``forward_measure`` and ``constraint_measure`` are normalised
    determinants, 0 at an inverse (type I), forward (type II) or constraint singularity.
    ``lci_translational`` and ``lci_rotational`` are of the rows of the homogenized Jacobian for
    lengths and for angles alone; None where there are no such rows.
    """

    mechanism: str
    params: dict[str, float | None]
    pose: dict[str, float]
    working_mode: str
    joints: dict[str, float]
    j_x: Matrix
    j_q: Matrix
    jacobian: Matrix | None
    singular_values: Vector | None
    kind: JacobianKind
    norm: str
    lci_raw: float
    lci_homogenized: float
    lci_translational: float | None
    lci_rotational: float | None
    characteristic_length: float
    inverse_distance: dict[str, float]
    inverse_measure: dict[str, float]
    forward_measure: dict[str, float]
    constraint_measure: dict[str, float]
    singular: tuple[str, ...]
    units: dict[str, str]

    @property
    def lci(self) -> float:
        """The index of the Jacobian asked for."""
        return self.lci_raw if self.kind == "raw" else self.lci_homogenized

    @property
    def matrices(self) -> dict[str, Matrix | None]:
        """J_X, J_q and J by their names."""
        return {"J_X": self.j_x, "J_q": self.j_q, "J": self.jacobian}

    @property
    def rows(self) -> dict[str, list[str]]:
        """Names of the rows: of J the pose's, of J_X and J_q the joint that the equation is of."""
        return {"J_X": [*self.joints], "J_q": [*self.joints], "J": [*self.pose]}

    @property
    def columns(self) -> dict[str, list[str]]:
        """Names of the columns: of J_X those of the pose, else the joints'."""
        return {"J_X": [*self.pose], "J_q": [*self.joints], "J": [*self.joints]}

    @property
    def entry_units(self) -> dict[str, list[list[str]]]:
        """Unit of every entry of the matrices."""
        found = {
            name: _spread(self.units[name], len(self.rows[name]), len(self.columns[name]))
            for name in ("J_X", "J_q")
        }
        units = self.units
        found["J"] = [[f"{units[x]}/{units[q]}" for q in self.joints] for x in self.pose]
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        values = self.singular_values
        unit = self.units["characteristic_length"]
        length = self.characteristic_length
        return {
            "mechanism": self.mechanism,
            "params": self.params,
            "pose": self.pose,
            "working_mode": self.working_mode,
            "joints": self.joints,
            "J_X": self.j_x.tolist(),
            "J_q": self.j_q.tolist(),
            "J": None if self.jacobian is None else self.jacobian.tolist(),
            "rows": self.rows,
            "columns": self.columns,
            "singular_values": None if values is None else values.tolist(),
            "lci": self.lci,
            "lci_raw": self.lci_raw,
            "lci_homogenized": self.lci_homogenized,
            "lci_translational": self.lci_translational,
            "lci_rotational": self.lci_rotational,
            "jacobian": self.kind,
            "norm": self.norm,
            "characteristic_length": self.characteristic_length,
            "index_note": index_note(
                self.kind, length if self.kind != "raw" else None, unit, self.units["entries"]
            ),
            "singularity": {
                "type_1": {"distance": self.inverse_distance, "determinant": self.inverse_measure},
                "type_2": {"determinant": self.forward_measure},
                "constraint": {"determinant": self.constraint_measure},
                "singular": list(self.singular),
            },
            "units": self.units,
        }


def _units(mechanism: Mechanism) -> dict[str, str]:
    return {
        c.name: mechanism.unit(c)
        for c in (*mechanism.pose, *mechanism.joints, *mechanism.parasitic)
    }


def _spread(words: str, rows: int, columns: int) -> list[list[str]]:
    """Return the unit of each entry of a matrix, from :meth:`Mechanism.velocity_map_units`."""
    kind, told, listed = words.partition(",")[0].partition(" in ")
    units = (listed if told else kind).split("; ")
    if len(units) == 1:
        units *= max(rows, columns)
    return [[units[k if kind == "columns" else i] for k in range(columns)] for i in range(rows)]


def of_limb(limited: str, name: str) -> bool:
    """Return whether limits on one name hold for a value: its own, or a limb's of that kind."""
    return name == limited or name.rpartition("_")[0] == limited


def _forward_units(mechanism: Mechanism) -> dict[str, str]:
    return _units(mechanism) | {"residual": unit_of("length", mechanism.length_unit)}


def _not_reached(
    mechanism: Mechanism, parameters: Parameters, pose: Mapping[str, float], where: str
) -> UnreachableError:
    """Return the error that names each limb that can not reach the pose and by how much."""
    unit = unit_of("length", mechanism.length_unit)
    misses = [
        f"{r.limb} misses by {-r.distance:.6g} {unit} ({r.reason})"
        for r in mechanism.reach(parameters, pose)
        if r.distance < 0
    ]
    told = "; ".join(misses) or "the limbs can not be assembled there"
    return UnreachableError(f"{where}: {_shown(pose)} is out of reach: {told}")


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
        self._strokes = _Limits(mechanism, strokes, mechanism.limited)
        self._limits = _Limits(mechanism, ranges, mechanism.limited)
        self._fixed = _Limits(mechanism, mechanism.pose_limits(self.parameters), mechanism.pose)
        self._units = _units(mechanism)

    @property
    def kernels(self) -> dict[Compiled, tuple[str, ...]]:
        """What is compiled for many poses, with the entries that are called."""
        found = self.mechanism.inverter
        return {} if found is None else {programs.assembling(found): ("assemble_all",)}

    def say(self, notify: Callable[[str], None]) -> None:
        """Have a line said where it still has to be compiled."""
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

    def _result(
        self, pose: dict[str, float], where: str, solutions: tuple[InverseSolution, ...]
    ) -> InverseResult | OutOfReach:
        mechanism, mode = self.mechanism, self._mode
        if not solutions:
            return OutOfReach(pose, lambda: _not_reached(mechanism, self.parameters, pose, where))
        chosen = tuple(s for s in solutions if mode in ("all", s.working_mode))
        if not chosen:
            text = (
                f"{where}: {_shown(pose)} is out of reach in working mode {mode}; "
                f"it is reached in {', '.join(s.working_mode for s in solutions)}"
            )
            return OutOfReach(pose, lambda: UnreachableError(text))
        misses = [self._strokes.beyond(s.joints) for s in solutions]
        fixed = self._fixed.beyond(pose)
        beyond = tuple((*fixed, *self._limits.beyond({**s.passive, **s.joints})) for s in chosen)
        return InverseResult(
            mechanism.name,
            pose,
            chosen,
            tuple(not b for b in beyond),
            self._units,
            beyond,
            None if not all(misses) else _out_of_strokes(mechanism, misses, pose, where),
        )


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
        raise UnreachableError(_out_of_strokes(mechanism, [misses], result.pose, where))
    return result


def _shown(values: Mapping[str, float]) -> str:
    return ",".join(f"{name}={exact(value)}" for name, value in values.items())


class _Limits:
    """Ranges of coordinates that values are held against, many times."""

    def __init__(
        self, mechanism: Mechanism, ranges: Ranges, coordinates: Sequence[Coordinate]
    ) -> None:
        self._mechanism = mechanism
        self._ranges = [(c, ranges[c.name]) for c in coordinates if c.name in ranges]
        self._pairs: dict[tuple[str, ...], list[tuple[str, Coordinate, tuple[float, float]]]] = {}

    def beyond(self, values: Mapping[str, float]) -> tuple[Beyond, ...]:
        """Return what of the values is not within the ranges, in the order of the coordinates."""
        names = tuple(values)
        pairs = self._pairs.get(names)
        if pairs is None:
            pairs = [(n, c, ends) for c, ends in self._ranges for n in names if of_limb(c.name, n)]
            self._pairs[names] = pairs
        found = []
        for name, c, (low, high) in pairs:
            value = values[name]
            if within(value, (low, high), c.kind):
                continue
            if c.kind == "angle":
                miss = min(abs(wrap_angle(value - low)), abs(wrap_angle(value - high)))
            else:
                miss = max(low - value, value - high)
            found.append(Beyond(name, value, low, high, miss, self._mechanism.unit(c)))
        return tuple(found)


def _out_of_strokes(
    mechanism: Mechanism,
    misses: Sequence[tuple[Beyond, ...]],
    pose: Mapping[str, float],
    where: str,
) -> str:
    """Say which joints are out of their strokes and by how much, of the nearest branch."""
    best = min(misses, key=lambda some: sum(b.miss for b in some))
    names = [c.name for c in mechanism.joints]
    said = []
    for one in best:
        number = names.index(one.name)
        limb = f"{mechanism.limbs[number].name}, " if number < len(mechanism.limbs) else ""
        said.append(f"{limb}{str(one).replace('misses [', 'misses its stroke [')}")
    return f"{where}: {_shown(pose)} is out of reach: {'; '.join(said)}"


def no_inverse(mechanism: Mechanism, pose: dict[str, float]) -> InverseResult:
    """Return the result of a pose out of reach: no solutions."""
    return InverseResult(mechanism.name, pose, (), (), _units(mechanism), ())


def no_forward(mechanism: Mechanism, joints: dict[str, float]) -> ForwardResult:
    """Return the result of joint positions that can not be assembled: no solutions."""
    return ForwardResult(
        mechanism.name, joints, (), _forward_units(mechanism), "not proven", mechanism.completeness
    )


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
        Where the mechanism can not be assembled with these joint positions.
    InputError
        For unknown names and values that are no finite numbers.
    """
    (found,) = forward_many(mechanism, params, [joints], [where], near)
    if isinstance(found, InputError):
        raise found
    return found


@dataclass(frozen=True)
class Assembling:
    """The compiled forward kinematics of a mechanism, for those who compile ahead."""

    mechanism: Mechanism

    @property
    def kernels(self) -> dict[Compiled, tuple[str, ...]]:
        """What is compiled, with the entries that are called."""
        found = self.mechanism.assembler
        return {} if found is None else {programs.assembling(found): ("assemble_all",)}

    def say(self, notify: Callable[[str], None]) -> None:
        """Have a line said where it still has to be compiled."""
        name = self.mechanism.name
        for compiled in self.kernels:
            compiled.on_compile = lambda: notify(
                f"compiling the forward kinematics of {name}, once: some seconds"
            )


def forward_many(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None,
    rows: Sequence[Mapping[str, Any]],
    places: Sequence[str],
    near: Mapping[str, Any] | None = None,
) -> list[ForwardResult | UnreachableError]:
    """Solve the forward kinematics of many sets of joint positions at once.

    Each gives what :func:`forward_kinematics` gives of it alone, to the last bit.

    Parameters
    ----------
    mechanism, params, near
        See :func:`forward_kinematics`.
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
    parameters = mechanism.resolve(params or {})
    checked = [
        mechanism.check_coordinates(joints, mechanism.joints, where)
        for joints, where in zip(rows, places, strict=True)
    ]
    goal = None if near is None else mechanism.check_coordinates(near, mechanism.pose, "near")
    size = mechanism.characteristic_length(parameters)
    units = _forward_units(mechanism)
    results: list[ForwardResult | UnreachableError] = []
    for joints, where, found in zip(
        checked, places, mechanism.assemblies(parameters, checked), strict=True
    ):
        if found.free:
            raise InputError(f"{where}: {mechanism.freed}")
        solutions = found.solutions
        if not solutions:
            reason = mechanism.why_not(parameters, joints)
            results.append(
                UnreachableError(f"{where}: {_shown(joints)} can not be assembled: {reason}")
            )
            continue
        if goal is not None:
            solutions = (min(solutions, key=lambda s: _distance(mechanism, s.pose, goal, size)),)
        results.append(
            ForwardResult(
                mechanism.name, joints, solutions, units,
                "proven" if found.proven else "not proven", mechanism.completeness,
            )
        )  # fmt: skip
    return results


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


def jacobian_at(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None,
    pose: Mapping[str, Any],
    working_mode: str | None = None,
    *,
    kind: JacobianKind | None = None,
    characteristic_length: float | str | None = None,
    norm: str = "2",
    limits: Mapping[str, Any] | None = None,
    where: str = "pose",
) -> JacobianResult:
    """Compute the Jacobian, its singular values and indices at a pose.

    A singular pose is an answer: J is None and the indices are 0.

    Parameters
    ----------
    mechanism, params, pose, where
        See :func:`inverse_kinematics`.
    working_mode : str, optional
        Default: the mechanism's first.
    kind : {"raw", "homogenized"}, optional
        Default: the mechanism's own, or homogenized where a characteristic length is given.
    characteristic_length : float or "optimal", optional
        Default: the mechanism's own; optimal: the one with the smallest condition number here.
    norm : {"2", "fro"}
    limits : mapping, optional
        Of joints, instead of the mechanism's own.

    Raises
    ------
    UnreachableError, InputError
        See :func:`inverse_kinematics`.
    """
    index = Index(kind, characteristic_length, norm)
    asked = Jacobians(mechanism, params, working_mode, index, limits)
    (found,) = asked.at([pose], [where])
    if isinstance(found, OutOfReach):
        raise found.error()
    return found


@dataclass(frozen=True)
class Index:
    """What conditioning index is asked for; see :func:`jacobian_at`.

    Raises
    ------
    InputError
    """

    kind: JacobianKind | None = None
    characteristic_length: float | str | None = None
    norm: str = "2"

    def __post_init__(self) -> None:
        length = self.characteristic_length
        if length is None:
            return
        if length != "optimal" and not (
            isinstance(length, int | float) and np.isfinite(length) and length > 0
        ):
            raise InputError(f"characteristic length {length} must be a number > 0, or optimal")
        if self.kind == "raw":
            raise InputError("characteristic length: needs the homogenized Jacobian, not raw")


class Jacobians:
    """The Jacobian of one design in one working mode, at any number of poses.

    Parameters
    ----------
    mechanism, params, working_mode, limits
        See :func:`jacobian_at`.
    index : Index

    Raises
    ------
    InputError
        See :func:`jacobian_at`.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        params: Mapping[str, Any] | None = None,
        working_mode: str | None = None,
        index: Index | None = None,
        limits: Mapping[str, Any] | None = None,
    ) -> None:
        self.mode = mechanism.check_mode(working_mode)
        self.inverting = Inverting(mechanism, params, self.mode, limits)
        self.mechanism = mechanism
        self.index = index or Index()
        length = unit_of("length", mechanism.length_unit)
        self.units = {
            **{p.name: mechanism.unit(p) for p in mechanism.parameters},
            **_units(mechanism),
            **_jacobian_units(mechanism),
            "characteristic_length": length,
            "distance": length,
            "determinant": ONE,
            "lci": ONE,
        }

    @cached_property
    def reference(self) -> JacobianResult:
        """The result at home of the default design: what there is to be measured."""
        mechanism = self.mechanism
        return jacobian_at(mechanism, None, mechanism.home(mechanism.resolve({})))

    def at(
        self, poses: Sequence[Mapping[str, Any]], places: Sequence[str]
    ) -> list[JacobianResult | OutOfReach]:
        """Return what :func:`jacobian_at` gives of each pose alone; see :meth:`Inverting.at`."""
        results: list[JacobianResult | OutOfReach] = []
        for found, where in zip(self.inverting.at(poses, places), places, strict=True):
            if isinstance(found, InverseResult):
                try:
                    results.append(_result_at(self, reached(self.mechanism, found, where)))
                except UnreachableError as error:
                    results.append(OutOfReach(found.pose, partial(UnreachableError, str(error))))
            else:
                results.append(found)
        return results


def _result_at(asked: Jacobians, branch: InverseResult) -> JacobianResult:
    mechanism, parameters, mode = asked.mechanism, asked.inverting.parameters, asked.mode
    kind, norm = asked.index.kind, asked.index.norm
    characteristic_length = asked.index.characteristic_length
    if characteristic_length is not None:
        kind = "homogenized"
    joints = branch.solutions[0].joints
    j_x, j_q = mechanism.velocity_maps(parameters, branch.pose, joints)
    reach = {r.limb: r.distance for r in mechanism.reach(parameters, branch.pose)}
    measures = mechanism.singularity_measures(parameters, branch.pose, joints)
    size = mechanism.characteristic_length(parameters)
    inverse = measures["inverse"]
    # At the end of a limb's reach its determinant falls with the root of the distance; at the end
    # of a stroke it does not fall.
    singular = tuple(
        [
            f"type 1, {limb}"
            for limb, value in inverse.items()
            if abs(value) <= SINGULAR
            or (abs(reach.get(limb, np.inf)) <= SINGULAR * size and abs(value) <= 4 * SINGULAR**0.5)
        ]
        + [f"type 2, {k}" for k, v in measures["forward"].items() if abs(v) <= SINGULAR]
        + [
            f"constraint, {k}"
            for k, v in measures.get("constraint", {}).items()
            if abs(v) <= SINGULAR
        ]
    )
    length = size if characteristic_length is None else characteristic_length
    jacobian = values = translational = rotational = None
    raw = homogenized = 0.0
    if not singular:
        jacobian = solve(j_x, j_q)
        values = singular_values(jacobian)
        raw = inverse_condition(jacobian, norm)
        if length == "optimal":
            length = _best_length(mechanism, jacobian, size)
        scaled = homogenize(mechanism, jacobian, float(length))
        homogenized = inverse_condition(scaled, norm)
        angular = np.array([c.kind == "angle" for c in mechanism.pose])
        translational, rotational = (
            inverse_condition(scaled[rows], norm) if rows.any() else None
            for rows in (~angular, angular)
        )
    return JacobianResult(
        mechanism=mechanism.name,
        params=dict(parameters),
        pose=branch.pose,
        working_mode=mode,
        joints=joints,
        j_x=j_x,
        j_q=j_q,
        jacobian=jacobian,
        singular_values=values,
        kind=kind or mechanism.default_jacobian,
        norm=norm,
        lci_raw=raw,
        lci_homogenized=homogenized,
        lci_translational=translational,
        lci_rotational=rotational,
        characteristic_length=size if length == "optimal" else float(length),
        inverse_distance=reach,
        inverse_measure=measures["inverse"],
        forward_measure=measures["forward"],
        constraint_measure=measures.get("constraint", {}),
        singular=singular,
        units=asked.units,
    )


def _jacobian_units(mechanism: Mechanism) -> dict[str, str]:
    """Return the units of J's columns, joint by joint, and whether singular values mix them."""
    columns = [
        ", ".join(dict.fromkeys(row[k] for row in mechanism.entry_units))
        for k in range(len(mechanism.joints))
    ]
    entries = entry_units(mechanism)
    return {
        "J": "columns in " + "; ".join(columns),
        "singular_values": "mixed, see J" if mixes_units(entries) else columns[0],
        "entries": entries,
        **mechanism.velocity_map_units(),
    }


def homogenize(mechanism: Mechanism, jacobian: Matrix, length: float) -> Matrix:
    """Return the Jacobian without units; see :meth:`Mechanism.homogenizing`."""
    rows, columns = mechanism.homogenizing(length)
    return rows[:, None] * jacobian / columns


def _best_length(mechanism: Mechanism, jacobian: Matrix, size: float) -> float:
    """Return the characteristic length with the smallest condition number (2-norm)."""
    from scipy.optimize import minimize_scalar

    def scaled(log_length: float) -> Matrix:
        return homogenize(mechanism, jacobian, exp(log_length))

    def loss(log_length: float) -> float:
        return -inverse_condition(scaled(log_length), "2")

    middle = log(size)
    grid = np.linspace(middle - 7, middle + 7, 57)
    values = singular_values(np.stack([scaled(x) for x in grid]))
    start = grid[int(np.argmax(values[:, -1] / values[:, 0]))]
    found = minimize_scalar(
        loss, bounds=(start - 0.25, start + 0.25), method="bounded", options={"xatol": 1e-9}
    )
    return exp(found.x)


def inverse_condition(matrix: Matrix, norm: str) -> float:
    """Return 1 / (|J| |J^-1|) by singular values: 2-norm or Frobenius."""
    values = singular_values(matrix)
    if values[-1] == 0.0:
        return 0.0
    if norm == "2":
        return float(values[-1] / values[0])
    return float(1 / np.sqrt((values**2).sum() * (1 / values**2).sum()))


__all__ = [
    "Beyond",
    "ForwardResult",
    "Index",
    "InverseResult",
    "Inverting",
    "JacobianResult",
    "Jacobians",
    "OutOfReach",
    "forward_kinematics",
    "forward_many",
    "inverse_kinematics",
    "jacobian_at",
    "reached",
]

"""Inverse and forward kinematics and the Jacobian at one pose, as results with units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pmopt.analysis.workspace import entry_units, index_note, mixes_units
from pmopt.errors import InputError, UnreachableError
from pmopt.mechanisms.base import (
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
from pmopt.units import ONE, exact, unit_of

#: A pose nearer than this to a singularity (distance over the size of the mechanism, or
#: normalised determinant) is one: rounding in the pose leaves no more.
SINGULAR = 1e-9


@dataclass(frozen=True)
class InverseResult:
    """All asked-for branches of the inverse kinematics at a pose."""

    mechanism: str
    pose: dict[str, float]
    solutions: tuple[InverseSolution, ...]
    within_limits: tuple[bool, ...]
    units: dict[str, str]

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
                }
                for s, inside in zip(self.solutions, self.within_limits, strict=True)
            ],
            "units": self.units,
        }


@dataclass(frozen=True)
class ForwardResult:
    """All assembly modes for a set of joint positions."""

    mechanism: str
    joints: dict[str, float]
    solutions: tuple[ForwardSolution, ...]
    units: dict[str, str]

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "mechanism": self.mechanism,
            "joints": self.joints,
            "solutions": [
                {"pose": s.pose, "parasitic": s.parasitic, "residual": s.residual}
                for s in self.solutions
            ],
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


def of_limb(limited: str, name: str) -> bool:
    """Return whether limits on one name hold for a value: its own, or a limb's of that kind."""
    return name == limited or name.rpartition("_")[0] == limited


def _forward_units(mechanism: Mechanism) -> dict[str, str]:
    return _units(mechanism) | {"residual": unit_of("length", mechanism.length_unit)}


def _require_reach(
    mechanism: Mechanism, parameters: Parameters, pose: Mapping[str, float], where: str
) -> None:
    """Raise the error that names each limb that can not reach the pose and by how much."""
    unit = unit_of("length", mechanism.length_unit)
    misses = [
        f"{r.limb} misses by {-r.distance:.6g} {unit} ({r.reason})"
        for r in mechanism.reach(parameters, pose)
        if r.distance < 0
    ]
    told = "; ".join(misses) or "the limbs can not be assembled there"
    raise UnreachableError(f"{where}: {_shown(pose)} is out of reach: {told}")


def inverse_kinematics(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None,
    pose: Mapping[str, Any],
    working_mode: str = "all",
    limits: Mapping[str, Any] | None = None,
    where: str = "pose",
) -> InverseResult:
    """Solve the inverse kinematics at a pose.

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
        Joint limits ``{joint: (lower, upper)}`` that ``within_limits`` is told by, beside the
        mechanism's own.
    where : str
        What errors call the pose.

    Raises
    ------
    UnreachableError
        Naming the limb and by how much the pose is out of its reach.
    InputError
        For unknown names and values that are no finite numbers.
    """
    parameters = mechanism.resolve(params or {})
    checked = mechanism.check_coordinates(pose, mechanism.pose, where)
    given = mechanism.check_ranges(limits or {}, mechanism.limited, "limits")
    ranges = {**mechanism.default_limits(parameters), **given}
    if working_mode != "all":
        mechanism.check_mode(working_mode)
    solutions = mechanism.inverse(parameters, checked)
    if not solutions:
        _require_reach(mechanism, parameters, checked, where)
    chosen = tuple(s for s in solutions if working_mode in ("all", s.working_mode))
    if not chosen:
        raise UnreachableError(
            f"{where}: {_shown(checked)} is out of reach in working mode {working_mode}; "
            f"it is reached in {', '.join(s.working_mode for s in solutions)}"
        )
    # Strokes are the reach of a limb; limits that a user gives instead are told by within_limits.
    strokes = {
        c.name: ranges[c.name] for c in mechanism.joints if c.name in ranges and c.name not in given
    }
    if strokes and not any(_keeps(mechanism, s, strokes) for s in chosen):
        _require_strokes(mechanism, chosen, strokes, checked, where)
    return InverseResult(
        mechanism.name,
        checked,
        chosen,
        tuple(mechanism.admits(parameters, checked) and _keeps(mechanism, s, ranges)
              for s in chosen),
        _units(mechanism),
    )  # fmt: skip


def _shown(values: Mapping[str, float]) -> str:
    return ",".join(f"{name}={value!r}" for name, value in values.items())


def _keeps(mechanism: Mechanism, solution: InverseSolution, ranges: Ranges) -> bool:
    """Return whether joints and passive joints are within their limits."""
    values = {**solution.passive, **solution.joints}
    return all(
        within(value, ranges[c.name], c.kind)
        for c in mechanism.limited
        if c.name in ranges
        for name, value in values.items()
        if of_limb(c.name, name)
    )


def _require_strokes(
    mechanism: Mechanism,
    solutions: tuple[InverseSolution, ...],
    strokes: Ranges,
    pose: Mapping[str, float],
    where: str,
) -> None:
    """Raise the error that names each joint out of its stroke and by how much, best branch."""

    def misses(solution: InverseSolution) -> dict[str, float]:
        beyond = {
            k: max(low - solution.joints[k], solution.joints[k] - high)
            for k, (low, high) in strokes.items()
        }
        return {k: v for k, v in beyond.items() if v > 0}

    best = min(solutions, key=lambda s: sum(misses(s).values()))
    units = _units(mechanism)
    told = []
    for number, joint in enumerate(mechanism.joints):
        miss = misses(best).get(joint.name)
        if miss is None:
            continue
        limb = f"{mechanism.limbs[number].name}, " if number < len(mechanism.limbs) else ""
        low, high = strokes[joint.name]
        reason = "too close" if best.joints[joint.name] < low else "too far"
        told.append(
            f"{limb}{joint.name} = {best.joints[joint.name]:.6g} {units[joint.name]} misses its "
            f"stroke [{exact(low)}, {exact(high)}] by {miss:.6g} {units[joint.name]} ({reason})"
        )
    raise UnreachableError(f"{where}: {_shown(pose)} is out of reach: {'; '.join(told)}")


def no_inverse(mechanism: Mechanism, pose: dict[str, float]) -> InverseResult:
    """Return the result of a pose out of reach: no solutions."""
    return InverseResult(mechanism.name, pose, (), (), _units(mechanism))


def no_forward(mechanism: Mechanism, joints: dict[str, float]) -> ForwardResult:
    """Return the result of joint positions that can not be assembled: no solutions."""
    return ForwardResult(mechanism.name, joints, (), _forward_units(mechanism))


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
    parameters = mechanism.resolve(params or {})
    checked = mechanism.check_coordinates(joints, mechanism.joints, where)
    solutions = mechanism.forward(parameters, checked)
    if not solutions:
        reason = mechanism.why_not(parameters, checked)
        raise UnreachableError(f"{where}: {_shown(checked)} can not be assembled: {reason}")
    if near is not None:
        goal = mechanism.check_coordinates(near, mechanism.pose, "near")
        size = mechanism.characteristic_length(parameters)
        solutions = (min(solutions, key=lambda s: _distance(mechanism, s.pose, goal, size)),)
    return ForwardResult(mechanism.name, checked, solutions, _forward_units(mechanism))


def _distance(
    mechanism: Mechanism, pose: Mapping[str, float], goal: Mapping[str, float], size: float
) -> float:
    """Return how far two poses are from each other, angles weighed by the size."""
    return sum(
        (size * wrap_angle(pose[c.name] - goal[c.name])) ** 2
        if c.kind == "angle"
        else (pose[c.name] - goal[c.name]) ** 2
        for c in mechanism.pose
    )


def jacobian_at(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None,
    pose: Mapping[str, Any],
    working_mode: str | None = None,
    *,
    kind: JacobianKind | None = None,
    characteristic_length: float | str | None = None,
    norm: str = "2",
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

    Raises
    ------
    UnreachableError, InputError
        See :func:`inverse_kinematics`.
    """
    parameters = mechanism.resolve(params or {})
    mode = mechanism.check_mode(working_mode)
    if characteristic_length is not None:
        if characteristic_length != "optimal" and not (
            isinstance(characteristic_length, int | float)
            and np.isfinite(characteristic_length)
            and characteristic_length > 0
        ):
            raise InputError(
                f"characteristic length {characteristic_length} must be a number > 0, or optimal"
            )
        if kind == "raw":
            raise InputError("characteristic length: needs the homogenized Jacobian, not raw")
        kind = "homogenized"
    branch = inverse_kinematics(mechanism, params, pose, mode, where=where)
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
        jacobian = np.asarray(np.linalg.solve(j_x, j_q), dtype=float)
        values = np.asarray(np.linalg.svd(jacobian, compute_uv=False), dtype=float)
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
        units={
            **_units(mechanism),
            **_jacobian_units(mechanism),
            "characteristic_length": unit_of("length", mechanism.length_unit),
            "distance": unit_of("length", mechanism.length_unit),
            "determinant": ONE,
            "lci": ONE,
        },
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

    def loss(log_length: float) -> float:
        return -inverse_condition(homogenize(mechanism, jacobian, float(np.exp(log_length))), "2")

    middle = float(np.log(size))
    grid = np.linspace(middle - 7, middle + 7, 57)
    start = grid[int(np.argmin([loss(x) for x in grid]))]
    found = minimize_scalar(
        loss, bounds=(start - 0.25, start + 0.25), method="bounded", options={"xatol": 1e-9}
    )
    return float(np.exp(found.x))


def inverse_condition(matrix: Matrix, norm: str) -> float:
    """Return 1 / (|J| |J^-1|) by singular values: 2-norm or Frobenius."""
    values = np.linalg.svd(matrix, compute_uv=False)
    if values[-1] == 0.0:
        return 0.0
    if norm == "2":
        return float(values[-1] / values[0])
    return float(1 / np.sqrt((values**2).sum() * (values**-2.0).sum()))


__all__ = [
    "ForwardResult",
    "InverseResult",
    "JacobianResult",
    "forward_kinematics",
    "inverse_kinematics",
    "jacobian_at",
]

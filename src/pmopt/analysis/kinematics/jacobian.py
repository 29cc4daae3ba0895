"""The Jacobian at poses: its index, and how near singularities are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from pmopt.analysis.kinematics.conditioning import best_length, homogenize, inverse_condition
from pmopt.analysis.kinematics.index_units import entry_units, index_note, mixes_units
from pmopt.analysis.kinematics.inverse import (
    InverseResult,
    Inverting,
    OutOfReach,
    coordinate_units,
    reached,
)
from pmopt.analysis.record import OfSubject
from pmopt.errors import InputError, UnreachableError
from pmopt.mechanisms.mechanism import JacobianKind, Matrix, Mechanism, Vector
from pmopt.numerics.matrices import singular_values, solve
from pmopt.units import ONE, unit_of

#: A pose nearer than this to a singularity (distance over the size of the mechanism, or
#: normalised determinant) is one: rounding in the pose leaves no more.
SINGULAR = 1e-9


@dataclass(frozen=True)
class JacobianResult(OfSubject):
    """Velocity maps and conditioning at a pose in one working mode.

    ``inverse_distance`` is the distance to the inverse (type I) singularity by limb, in the
    length unit; ``inverse_measure``, ``forward_measure`` and ``constraint_measure`` are normalised
    determinants, 0 at an inverse (type I), forward (type II) or constraint singularity.
    ``lci_translational`` and ``lci_rotational`` are of the rows of the homogenized Jacobian for
    lengths and for angles alone; None where there are no such rows.
    """

    pose: dict[str, float]
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


def _spread(words: str, rows: int, columns: int) -> list[list[str]]:
    """Return the unit of each entry of a matrix, from :meth:`Mechanism.velocity_map_units`."""
    kind, separator, listed = words.partition(",")[0].partition(" in ")
    units = (listed if separator else kind).split("; ")
    if len(units) == 1:
        units *= max(rows, columns)
    return [[units[k if kind == "columns" else i] for k in range(columns)] for i in range(rows)]


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
            **coordinate_units(mechanism),
            **_jacobian_units(mechanism),
            "characteristic_length": length,
            "distance": length,
            "determinant": ONE,
            "lci": ONE,
        }

    @cached_property
    def reference(self) -> JacobianResult:
        """The result at home of the default design: the quantities that exist."""
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
    mechanism, parameters = asked.mechanism, asked.inverting.parameters
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
            length = best_length(mechanism, jacobian, size)
        scaled = homogenize(mechanism, jacobian, float(length))
        homogenized = inverse_condition(scaled, norm)
        angular = np.array([c.kind == "angle" for c in mechanism.pose])
        translational, rotational = (
            inverse_condition(scaled[rows], norm) if rows.any() else None
            for rows in (~angular, angular)
        )
    return JacobianResult(
        subject=branch.subject,
        pose=branch.pose,
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

"""Inverse and forward kinematics and Jacobians as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pmopt.analysis.kinematics.inverse import OutOfReach
from pmopt.reporting.tables.table import (
    Cell,
    Shown,
    Table,
)
from pmopt.units import ONE

if TYPE_CHECKING:
    from pmopt.analysis.kinematics.forward import ForwardResult
    from pmopt.analysis.kinematics.inverse import InverseResult
    from pmopt.analysis.kinematics.jacobian import JacobianResult, Jacobians

#: Relative size of what rounding leaves.
_NOISE = 1e-14


def inverse_table(
    results: Sequence[InverseResult], many: bool = False, number_from: int = 1
) -> Table:
    """Return branches, a row each; ``many`` poses are numbered, the first as given."""
    first = results[0]
    # Joints and parasitic coordinates; what is a pose coordinate too stands once.
    poses, names = list(first.pose), [c for c in first.units if c not in first.pose]
    if not many and first.solutions:
        names = [*first.solutions[0].joints, *first.solutions[0].parasitic]
        poses = [c for c in first.pose if c not in names]
    columns = (*(["row"] if many else []), *poses, "working_mode", *names, "within_limits",
               "beyond")  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for number, result in enumerate(results, start=number_from):
        head: list[Cell] = [*([number] if many else []), *(result.pose[c] for c in poses)]
        branches: list[list[Cell]] = [
            [
                s.working_mode,
                *((s.joints | s.parasitic)[c] for c in names),
                inside,
                Shown("; ".join(map(str, beyond)) or None,
                      ", ".join(b.short for b in beyond) or None),
            ]
            for s, inside, beyond in zip(
                result.solutions, result.within_limits, result.beyond, strict=True
            )
        ] or [[None] * (len(names) + 3)]  # fmt: skip
        rows += [(*head, *branch) for branch in branches]
    pose = ", ".join(f"{k} = {v:g} {first.units[k]}" for k, v in first.pose.items())
    title = f"{first.mechanism}, {len(results)} poses" if many else f"{first.mechanism}, {pose}"
    parasitic = tuple(first.solutions[0].parasitic) if first.solutions else ()
    return Table(title, columns, tuple(rows), first.units, prose=("beyond",), yielding=parasitic,
                 only_csv=() if many else tuple(poses))  # fmt: skip


def forward_table(
    results: Sequence[ForwardResult], many: bool = False, number_from: int = 1
) -> Table:
    """Return assembly modes, a row each; ``many`` joint positions are numbered from the first's."""
    first = results[0]
    # What is a joint and a pose coordinate too stands once.
    joints = list(first.joints)
    poses = [c for c in first.units if c not in joints and c != "residual"]
    if not many and first.solutions:
        poses = [*first.solutions[0].pose, *first.solutions[0].parasitic]
        joints = [c for c in joints if c not in poses]
    columns = (*(["row"] if many else []), *joints, *poses, "residual", "complete")
    rows: list[tuple[Cell, ...]] = []
    for number, result in enumerate(results, start=number_from):
        head: list[Cell] = [*([number] if many else []), *(result.joints[c] for c in joints)]
        modes: list[list[Cell]] = [
            [
                *({**s.pose, **s.parasitic}.get(c) for c in poses),
                Shown(s.residual, f"{s.residual:.1e}"),
                result.complete,
            ]
            for s in result.solutions
        ] or [[None] * (len(poses) + 2)]
        rows += [(*head, *mode) for mode in modes]
    at = ", ".join(f"{k} = {v:g} {first.units[k]}" for k, v in first.joints.items())
    title = f"{first.mechanism}, {len(results)} rows" if many else f"{first.mechanism}, {at}"
    note = f"complete: {first.completeness}"
    return Table(title, columns, tuple(rows), first.units, (note,),
                 only_csv=() if many else tuple(joints))  # fmt: skip


def jacobian_tables(result: JacobianResult) -> list[Table]:
    """Return indices first, then the matrices."""
    unit = result.units["characteristic_length"]
    rows = [
        (f"lci ({result.kind}, {result.norm}-norm)", result.lci, ONE),
        *((name, value, ONE) for name, value in _indices(result).items() if name != "lci"),
        ("characteristic_length", result.characteristic_length, unit),
        *_singular_values(result),
        *_distances(result),
    ]
    singular = f"singular: {'; '.join(result.singular)}" if result.singular else "not singular"
    note = str(result.to_dict()["index_note"])
    tables = [
        Table(f"{result.mechanism}, {result.working_mode}", ("quantity", "value", "unit"),
              tuple(rows), {}, (singular, f"LCI of the {note}")),
    ]  # fmt: skip
    for name, matrix in result.matrices.items():
        if matrix is not None:
            body = tuple(
                (row, *map(_entry, values, [max(map(abs, values))] * len(values)))
                for row, values in zip(result.rows[name], matrix.tolist(), strict=True)
            )
            columns = ("row", *result.columns[name])
            tables.append(Table(f"{name} ({result.units[name]})", columns, body, {}))
    return tables


def _indices(result: JacobianResult) -> dict[str, float]:
    """Return the indices of a pose, by their names in JSON."""
    found = {
        "lci": result.lci,
        "lci_raw": result.lci_raw,
        "lci_homogenized": result.lci_homogenized,
        "lci_translational": result.lci_translational,
        "lci_rotational": result.lci_rotational,
    }
    return {name: value for name, value in found.items() if value is not None}


def jacobians_table(
    results: Sequence[JacobianResult | OutOfReach], asked: Jacobians, number_from: int = 1
) -> Table:
    """Return the Jacobian's indices and measures at many poses, a row each.

    What is out of reach has a row without them.
    """
    mechanism, unit = asked.mechanism, asked.units["characteristic_length"]
    at_home = _jacobian_columns(asked.reference)
    known = [k for k, value in at_home.items() if value is not None or k == "singularities"]
    values = asked.units["singular_values"].split(",")[0]
    units = {c.name: asked.units[c.name] for c in mechanism.pose}
    units |= {
        name: unit if name.startswith(("characteristic", "distance")) else
        values if name.startswith("singular_value_") else ONE
        for name in known
    }  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for number, one in enumerate(results, start=number_from):
        found = {} if isinstance(one, OutOfReach) else _jacobian_columns(one)
        rows.append((number, *one.pose.values(), *(found.get(name) for name in known)))
    details = ("singular_value", "distance", "determinant", "characteristic")
    return Table(
        f"{mechanism.name}, {asked.mode}, {len(results)} poses",
        ("row", *units), tuple(rows), units,
        tuple(f"lci: {one.kind}, {one.norm}-norm" for one in results
              if not isinstance(one, OutOfReach))[:1],
        prose=("singularities",),
        yielding=tuple(name for name in known if name.startswith(details)),
    )  # fmt: skip


def _jacobian_columns(result: JacobianResult) -> dict[str, Cell]:
    """Return the figures of one pose by the names of their columns."""
    values = result.singular_values
    size = len(result.j_x)

    def named(start: str, measures: Mapping[str, float]) -> dict[str, Cell]:
        return {f"{start}_{name.replace(' ', '_')}": value for name, value in measures.items()}

    return {
        "lci": result.lci,
        "lci_raw": result.lci_raw,
        "lci_homogenized": result.lci_homogenized,
        "singular": bool(result.singular),
        "lci_translational": result.lci_translational,
        "lci_rotational": result.lci_rotational,
        "characteristic_length": result.characteristic_length,
        **{f"singular_value_{k + 1}": None if values is None else float(values[k])
           for k in range(size)},
        **named("distance_type_1", result.inverse_distance),
        **named("determinant_type_1", result.inverse_measure),
        **named("determinant_type_2", result.forward_measure),
        **named("determinant_constraint", result.constraint_measure),
        "singularities": "; ".join(result.singular) or None,
    }  # fmt: skip


def jacobian_document(result: JacobianResult | OutOfReach, asked: Jacobians) -> dict[str, Any]:
    """Return the JSON form of one of many poses; out of reach with the reason and no figures."""
    if not isinstance(result, OutOfReach):
        return result.to_dict()
    return {
        **dict.fromkeys(asked.reference.to_dict()),
        "mechanism": asked.mechanism.name,
        "params": dict(asked.inverting.parameters),
        "pose": result.pose,
        "working_mode": asked.mode,
        "units": asked.units,
        "out_of_reach": str(result.error()),
    }


#: Name, value, unit.
_Quantity = tuple[str, float, str]


def _singular_values(result: JacobianResult) -> list[_Quantity]:
    values = result.singular_values
    unit = result.units["singular_values"].split(",")[0]
    return [
        (f"singular value {i}", float(value), unit)
        for i, value in enumerate(() if values is None else values, start=1)
    ]


def _distances(result: JacobianResult) -> list[_Quantity]:
    """Return how far each kind of singularity is: type 1 in lengths, all by determinants."""
    unit = result.units["distance"]
    return [
        *((f"distance to type 1, {k}", v, unit) for k, v in result.inverse_distance.items()),
        *((f"determinant type 1, {k}", v, ONE) for k, v in result.inverse_measure.items()),
        *((f"determinant type 2, {k}", v, ONE) for k, v in result.forward_measure.items()),
        *((f"determinant constraint, {k}", v, ONE) for k, v in result.constraint_measure.items()),
    ]


def _entry(value: float, largest: float) -> Cell:
    """Return an entry of a matrix; what rounding leaves beside the row's largest is 0."""
    return Shown(value, "0") if abs(value) < _NOISE * largest else value


def jacobian_data(result: JacobianResult) -> Table:
    """Return all of it for CSV: a row a number, entries of matrices by row and column."""
    unit = result.units["characteristic_length"]
    rows: list[tuple[Cell, ...]] = [
        (name, None, None, value, ONE, None) for name, value in _indices(result).items()
    ]
    rows.append(
        ("characteristic_length", None, None, result.characteristic_length, unit, None)
    )  # fmt: skip
    for what, group in (("params", result.params), ("pose", result.pose),
                        ("joints", result.joints)):  # fmt: skip
        rows += [(what, name, None, value, result.units[name], None)
                 for name, value in group.items() if value is not None]  # fmt: skip
    rows += [
        (name, None, None, value, unit, None)
        for name, value, unit in (*_singular_values(result), *_distances(result))
    ]
    for name, matrix in result.matrices.items():
        if matrix is not None:
            units = result.entry_units[name]
            rows += [
                (name, row, column, float(matrix[i, k]), units[i][k], None)
                for i, row in enumerate(result.rows[name])
                for k, column in enumerate(result.columns[name])
            ]
    facts = {
        "working_mode": result.working_mode,
        "jacobian": result.kind,
        "norm": result.norm,
        "index_note": str(result.to_dict()["index_note"]),
        "singular": "; ".join(result.singular) or "no",
    }
    rows += [(name, None, None, None, None, text) for name, text in facts.items()]
    columns = ("quantity", "row", "column", "value", "unit", "text")
    return Table(result.mechanism, columns, tuple(rows), {})

"""Results as tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pmopt.analysis.kinematics.solve import OutOfReach
from pmopt.mechanisms.mechanism import PLATFORM
from pmopt.reporting.tables.table import (
    Cell,
    Shown,
    Table,
    Uncertain,
    design_facts,
    facts,
    given,
    shown,
)
from pmopt.units import ONE, span_text

if TYPE_CHECKING:
    from pmopt.analysis.kinematics.solve import (
        ForwardResult,
        InverseResult,
        JacobianResult,
        Jacobians,
    )
    from pmopt.analysis.workspace.compute import WorkspaceResult
    from pmopt.analysis.workspace.shape import Topology
    from pmopt.mechanisms import Mechanism
    from pmopt.quantity import Quantity
    from pmopt.reporting.runs.pareto_run import ParetoRun
    from pmopt.synthesis.front import Front


#: Relative size of what rounding leaves.
_NOISE = 1e-14


def mechanisms_table(mechanisms: Sequence[Mechanism], left_out: Sequence[object] = ()) -> Table:
    """Return the catalogue; plug-ins that are left out are named below."""
    rows = tuple((m.name, m.freedom, m.length_unit, m.description) for m in mechanisms)
    names = ("name", "freedom", "length_unit", "description")
    return Table("Mechanisms", names, rows, {}, tuple(map(str, left_out)), prose=("description",))


def mechanism_document(m: Mechanism) -> dict[str, Any]:
    """Return all a mechanism declares, as JSON has it."""
    limits = [f"{p.name}: {p.meaning}" for p in m.parameters if p.optional]
    limits += _default_limits(m)
    parameters = m.resolve({})
    return {
        "mechanism": m.name,
        "title": m.title,
        "description": m.description,
        "source": m.source,
        "freedom": m.freedom,
        "length_unit": m.length_unit,
        "limbs": [
            {
                "name": x.name,
                "joints": x.joints,
                "joint_names": list(x.joint_names),
                "description": x.description,
            }
            for x in m.limbs
        ],
        "parameters": [
            {
                "name": p.name,
                "unit": m.unit(p),
                "default": p.default,
                "bounds": None if p.bounds is None else list(p.bounds),
                "allowed": p.allowed(),
                "meaning": p.meaning,
                "source": p.source,
            }
            for p in m.parameters
        ],
        "pose": [{"name": c.name, "unit": m.unit(c), "meaning": c.meaning} for c in m.pose],
        **{
            key: [{"name": c.name, "unit": m.unit(c), "meaning": c.meaning} for c in group]
            for key, group in (
                ("joints", m.joints),
                ("passive", m.passive),
                ("parasitic", m.parasitic),
            )
        },
        "home": m.home(parameters),
        "domain": {
            k: [v if math.isfinite(v) else None for v in ends]
            for k, ends in m.default_domain(parameters).items()
        },
        "layouts": dict(m.layouts),
        "working_modes": list(m.working_modes),
        "limits": limits,
        "jacobian": m.default_jacobian,
        "characteristic_length": m.length_meaning,
        "bodies": [
            {
                "name": body.name,
                "limb": "platform" if body.limb == PLATFORM else m.limbs[body.limb].name,
                "mass": body.mass,
                "centre": body.centre.tolist(),
                "inertia": body.inertia.tolist(),
                "source": body.source,
            }
            for body in m.bodies(parameters)
        ],
        "units": {"mass": "kg", "centre": m.length_unit, "inertia": "kg m^2"},
    }


def _default_limits(m: Mechanism) -> list[str]:
    """Return the limits that hold unless others are given, in words, for the default design."""
    units = {c.name: m.unit(c) for c in m.limited}
    limits = m.default_limits(m.resolve({}))
    return [f"{k}: {span_text(ends, units[k])}" for k, ends in limits.items()]


def mechanism_tables(m: Mechanism) -> list[Table]:
    """Return what a mechanism declares, parameters first."""
    names = ("name", "unit", "default", "lower", "upper", "bounds", "meaning", "source")
    parameters = tuple(
        (p.name, m.unit(p), given(p.default), *_range(p.bounds), p.meaning, p.source)
        for p in m.parameters
    )
    coordinates = tuple(
        (kind, c.name, m.unit(c), c.meaning)
        for kind, group in (
            ("pose", m.pose),
            ("parasitic", m.parasitic),
            ("actuated joint", m.joints),
            ("passive joint", m.passive),
        )
        for c in group
    )
    defaults = m.resolve({})
    home = m.home(defaults)
    limits = m.default_limits(defaults)
    units = {c.name: m.unit(c) for c in (*m.limited, *m.pose)}
    spans = [
        *(("domain", name, units[name], *_range(ends))
          for name, ends in m.default_domain(defaults).items()),
        *(("limit", name, units[name], *_range(ends)) for name, ends in limits.items()),
    ]  # fmt: skip
    bodies: tuple[tuple[Cell, ...], ...] = tuple(
        (body.name, body.mass, *(float(body.inertia[k, k]) for k in range(3)), body.source)
        for body in m.bodies(defaults)
    )
    moments = ("Ixx", "Iyy", "Izz")
    optional = tuple(f"{p.name}: {p.meaning}" for p in m.parameters if p.optional)
    tables = [
        Table(f"{m.title}: {m.description}", names, parameters, {},
              (f"source: {m.source}", *(f"limit unless absent: {text}" for text in optional)),
              "parameter", prose=("meaning", "source"), yielding=("source",),
              only_csv=("lower", "upper"), only_shown=("bounds",)),
        Table("Coordinates", ("kind", "name", "unit", "meaning"), coordinates, {}, (), "coordinate",
              prose=("meaning",)),
        Table("Home pose, at the default dimensions", ("name", "unit", "value"),
              tuple((c.name, m.unit(c), home[c.name]) for c in m.pose), {}, (), "home"),
        Table("Ranges unless others are given, at the default dimensions",
              ("kind", "name", "unit", "lower", "upper", "bounds"), tuple(spans), {},
              () if limits else ("no limits of joints",), "range",
              only_csv=("lower", "upper"), only_shown=("bounds",)),
        Table("Limbs", ("name", "joints", "description"),
              tuple((x.name, x.joints, x.description) for x in m.limbs), {},
              (f"working modes: {', '.join(m.working_modes)} (first one is the default)",
               f"LCI: {m.default_jacobian} by default; homogenized by {m.length_meaning}"), "limb",
              prose=("description",)),
        Table("Layouts of pmopt mobility", ("name", "description"), tuple(m.layouts.items()), {},
              (), "layout", prose=("description",)),
        Table("Bodies, at the default dimensions", ("name", "mass", *moments, "source"), bodies,
              {"mass": "kg", **dict.fromkeys(moments, "kg m^2")},
              ("moments about the centre of mass, along the axes of the body's link",), "body",
              prose=("source",), yielding=("source",)),
    ]  # fmt: skip
    return [table for table in tables if table.rows]


def mechanism_data(m: Mechanism) -> list[Table]:
    """Return all that a mechanism declares for CSV."""
    modes = tuple((name, "other" if k else "default") for k, name in enumerate(m.working_modes))
    texts = {
        "mechanism": m.name,
        "title": m.title,
        "description": m.description,
        "source": m.source,
        "freedom": m.freedom,
        "length unit": m.length_unit,
        "jacobian": m.default_jacobian,
        "characteristic length": m.length_meaning,
    }
    return [
        *mechanism_tables(m),
        Table("", ("name", "kind"), modes, {}, key="working mode"),
        facts({}, texts),
    ]


def _range(ends: tuple[float, float] | None) -> tuple[Cell, Cell, Cell]:
    """Return both ends of a range and its text; an open end is none."""
    if ends is None:
        return None, None, None
    lower, upper = (end if math.isfinite(end) else None for end in ends)
    return lower, upper, " .. ".join(f"{end:.6g}" for end in ends)


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


def bounded(value: float, sign: str, proven: bool = False) -> Cell:
    """Return an extreme as it is known: at most (``<=``), at least (``>=``), or proven."""
    if math.isnan(value):
        return None
    text = shown(value)
    return Shown(value, f"{text}, proven" if proven else f"{sign} {text}")


@dataclass(frozen=True)
class _Figure:
    """A row of the workspace's table; ``bound`` is what CSV says an extreme is."""

    name: str
    value: Cell
    unit: str
    bound: str | None = None


def _figures(result: WorkspaceResult) -> list[_Figure]:
    """Return every number of a workspace with its error."""
    grid, unit = result.grid is not None, result.volume_unit

    def extreme(name: str, found: Quantity, sign: str) -> _Figure:
        value = bounded(found.value, sign, found.bound == "proven")
        return _Figure(name, value, ONE, found.bound)

    def own(name: str, found: Quantity, unit: str) -> _Figure:
        return _Figure(name, _sampled(found, grid), unit)

    found = [
        own("volume", result.volume, unit),
        own("gci", result.gci, ONE),
        extreme("lci min", result.smallest, "<="),
        *(own(f"lci quantile {q:g}", e, ONE)
          for q, e in zip((0.05, 0.5, 0.95), result.quantiles, strict=True)),
        extreme("lci max", result.largest, ">="),
    ]  # fmt: skip
    for region in result.regions:
        name = f"{region.lower:g} <= lci < {region.upper:g}"
        found.append(own(f"volume, {name}", region.volume, unit))
        found.append(own(f"share, {name}", region.share, ONE))
    if result.projection:
        # Counted on voxels: their errors are standard errors beside a grid's bounds too. Where
        # poses are positions the volume is the workspace's own, and so is its error.
        volume, footprint = result.projection.volume, result.projection.footprint
        sign, bound = (">=", "lower") if result.projection.lower else ("", None)
        if volume.error != 0:  # positions on a plane have no volume, and nothing is said of it
            value = _sampled(volume, grid and volume is result.volume, sign)
            found.append(_Figure("projected volume", value, volume.unit, bound))
        found.append(_Figure("footprint", _sampled(footprint), footprint.unit))
    return found


def _sampled(found: Quantity, bound: bool = False, sign: str = "") -> Cell:
    return None if math.isnan(found) else Uncertain(found.value, found.error, bound, sign)


def _errors(result: WorkspaceResult) -> dict[str, tuple[str, ...]]:
    """Return the names that CSV has for the errors."""
    if result.grid is None:
        return {"value": ("standard_error",)}
    names = ("standard_error", "error_bound") if result.projection else ("error_bound",)
    return {"value": names}


def workspace_tables(result: WorkspaceResult) -> list[Table]:
    """Return every sampled number with its error, then the shape."""
    sampler = f"{result.grid} cells an axis" if result.grid else f"{result.replicates} replicates"
    figures = _figures(result)
    standard = [f.name for f in figures if isinstance(f.value, Uncertain) and not f.value.bound]
    errors = "errors are standard errors" if result.grid is None else "errors are bounds"
    if result.grid is not None and standard:
        errors += f", of {' and '.join(standard)} standard errors"
    notes = (
        f"{result.samples} samples ({result.sampler}, {sampler}, seed {result.seed}), "
        f"{result.reachable} reachable; working mode {result.working_mode}",
        errors,
        f"LCI of the {result.index_note}; {result.norm}-norm",
    )
    rows = tuple((f.name, f.value, f.unit) for f in figures)
    tables = [
        Table(f"{result.mechanism}: {design_text(result.params, result.units)}",
              ("quantity", "value", "unit"), rows, {}, notes, errors=_errors(result)),
    ]  # fmt: skip
    if result.shape:
        tables.append(
            Table(
                f"Shape, counted on {result.shape.grid} cells an axis",
                ("set", "pieces", "voids", "pockets", "confirmed"),
                tuple((n, t.pieces, t.voids, t.pockets, t.confirmed)
                      for n, t in _shapes(result).items()),
                {},
                (*([f"positions reached: on {result.projection.grid} voxels along the longest side"]
                   if result.projection else []),
                 "voids are enclosed, pockets open to the domain's boundary only; confirmed: a "
                 "coarser grid counts the same",),
            )
        )  # fmt: skip
    return tables


def _shapes(result: WorkspaceResult) -> dict[str, Topology]:
    """Return what was counted of the workspace, its regions and the positions, by name."""
    if result.shape is None:
        return {}
    names = ["workspace", *(f"{r.lower:g} <= lci < {r.upper:g}" for r in result.regions)]
    found = dict(zip(names, (result.shape.workspace, *result.shape.regions), strict=True))
    return found | ({"positions reached": result.projection.shape} if result.projection else {})


def workspace_data(result: WorkspaceResult) -> Table:
    """Return all of it for CSV, a row a number; what is in words stands under ``text``."""
    rows: list[tuple[Cell, ...]] = [
        (f.name, f.value, f.unit, f.bound, None) for f in _figures(result)
    ]
    for name, shape in _shapes(result).items():
        for what in ("pieces", "voids", "pockets"):
            rows.append((f"{what}, {name}", getattr(shape, what), ONE, None, None))
        rows.append((f"confirmed, {name}", int(shape.confirmed), ONE, None, None))
    counts = {"samples": result.samples, "reachable": result.reachable, "seed": result.seed,
              "replicates": result.replicates, "grid": result.grid,
              "shape grid": result.shape.grid if result.shape else None}  # fmt: skip
    numbers = {name: (n, ONE) for name, n in counts.items()}
    texts = {
        "mechanism": result.mechanism,
        "working mode": result.working_mode,
        "sampler": result.sampler,
        "norm": result.norm,
        "index": result.index_note,
    }
    about = facts({**numbers, **design_facts(result.params, result.units)}, texts)
    rows += [(name, value, unit, None, text) for name, value, unit, text in about.rows]
    return Table("", ("quantity", "value", "unit", "bound", "text"), tuple(rows), {},
                 errors=_errors(result))  # fmt: skip


def design_text(params: Mapping[str, float | None], units: Mapping[str, str]) -> str:
    """Return a design in words; what is not set is left out."""
    return ", ".join(
        f"{k} = {v:g} {units[k]}".removesuffix(f" {ONE}")
        for k, v in params.items()
        if v is not None
    )


def _point(front: Front) -> str:
    """Return the reference point of the hypervolume in words."""
    names = front.designs[0].objectives
    return ", ".join(
        f"{name} {value:.4g}" + ("" if front.units[name] == ONE else f" {front.units[name]}")
        for name, value in zip(names, front.reference, strict=True)
    )


def pareto_tables(run: ParetoRun) -> list[Table]:
    """Return the ends and the knee of the front."""
    from pmopt.synthesis.front import describe_idle

    front = run.front
    ends = ("end", front.designs[0]), ("knee", front.knee), ("end", front.designs[-1])
    parameters = [k for k, v in front.designs[0].parameters.items() if v is not None]
    objectives = list(front.designs[0].objectives)
    rows = tuple(
        (
            name,
            design.number,
            *(design.parameters[k] for k in parameters),
            *(Uncertain(design.objectives[k], design.errors[k]) for k in objectives),
        )
        for name, design in ends
    )
    columns = ("place", "design", *parameters, *objectives)
    notes = [
        f"{len(front.designs)} designs, hypervolume {front.hypervolume:.6g} "
        f"{front.units['hypervolume']} from {_point(front)}"
    ]
    target = run.target_error
    rough = sum(d.errors[k] > target * d.objectives[k] for d in front.designs for k in objectives)
    if rough:
        notes.append(f"{rough} figures have a larger relative error than {target:g}, as stated")
    notes += [describe_idle(direction) for direction in front.idle]
    if run.folder:
        notes.append(f"written to {run.folder}")
    errors = {k: (f"{k}_error",) for k in objectives}
    return [Table("Pareto front", columns, rows, front.units, tuple(notes), errors=errors)]

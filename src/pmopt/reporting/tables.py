"""Results as tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pmopt.analysis.kinematics import OutOfReach
from pmopt.mechanisms.base import PLATFORM
from pmopt.reporting.table import Cell, Table, shown, with_error
from pmopt.units import ONE, exact, span_text

if TYPE_CHECKING:
    from pmopt.analysis.extremes import Extreme
    from pmopt.analysis.kinematics import ForwardResult, InverseResult, JacobianResult, Jacobians
    from pmopt.analysis.workspace import WorkspaceResult
    from pmopt.mechanisms import Mechanism
    from pmopt.reporting.pareto_run import ParetoRun
    from pmopt.synthesis.front import Front


def mechanisms_table(mechanisms: Sequence[Mechanism]) -> Table:
    """Return the catalogue."""
    rows = tuple((m.name, m.freedom, m.length_unit, m.description) for m in mechanisms)
    return Table("Mechanisms", ("name", "freedom", "length_unit", "description"), rows, {})


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
            {"name": x.name, "joints": x.joints, "description": x.description} for x in m.limbs
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
    parameters = tuple(
        (
            p.name,
            m.unit(p),
            p.default,
            "-" if p.bounds is None else f"{exact(p.bounds[0])} .. {exact(p.bounds[1])}",
            p.meaning,
            p.source,
        )
        for p in m.parameters
    )
    names = ("name", "unit", "default", "bounds", "meaning", "source")
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
    modes = f"working modes: {', '.join(m.working_modes)} (first one is the default)"
    defaults = m.resolve({})
    home = ", ".join(f"{c.name} = {m.home(defaults)[c.name]:.6g} {m.unit(c)}" for c in m.pose)
    limits = "; ".join(_default_limits(m)) or "none on joints unless given"
    bodies: tuple[tuple[Cell, ...], ...] = tuple(
        (body.name, body.mass, *(float(body.inertia[k, k]) for k in range(3)), body.source)
        for body in m.bodies(defaults)
    )
    moments = ("Ixx", "Iyy", "Izz")
    return [
        Table(f"{m.title}: {m.description}", names, parameters, {},
              (f"source: {m.source}", f"limits: {limits}", f"home: {home}")),
        Table("Coordinates", ("kind", "name", "unit", "meaning"), coordinates, {}),
        Table("Limbs", ("limb", "joints", "description"),
              tuple((x.name, x.joints, x.description) for x in m.limbs), {},
              (modes, f"LCI: {m.default_jacobian} by default; homogenized by {m.length_meaning}")),
        *([Table("Bodies, at the default dimensions", ("body", "mass", *moments, "source"), bodies,
                 {"mass": "kg", **dict.fromkeys(moments, "kg m^2")},
                 ("moments about the centre of mass, along the axes of the body's link",))]
          if bodies else []),
    ]  # fmt: skip


def inverse_table(
    results: Sequence[InverseResult], many: bool = False, number_from: int = 1
) -> Table:
    """Return branches, a row each; of ``many`` poses each is numbered and repeated."""
    first = results[0]
    # Joints and parasitic coordinates; what is a pose coordinate too stands once.
    names = [c for c in first.units if c not in first.pose]
    if not many and first.solutions:
        names = [*first.solutions[0].joints, *first.solutions[0].parasitic]
    poses = list(first.pose) if many else []
    columns = (*(["row"] if poses else []), *poses, "working_mode", *names, "within_limits",
               "beyond")  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    display: list[tuple[Cell, ...]] = []
    for number, result in enumerate(results, start=number_from):
        head = [number, *result.pose.values()] if poses else []
        branches: list[list[Cell]] = [
            [
                s.working_mode,
                *((s.joints | s.parasitic)[c] for c in names),
                inside,
                "; ".join(map(str, beyond)) or None,
            ]
            for s, inside, beyond in zip(
                result.solutions, result.within_limits, result.beyond, strict=True
            )
        ] or [[None] * (len(names) + 3)]
        rows += [(*head, *branch) for branch in branches]
        short = [", ".join(b.short for b in beyond) or None for beyond in result.beyond] or [None]
        display += [(*head, *b[:-1], text) for b, text in zip(branches, short, strict=True)]
    pose = ", ".join(f"{k} = {v:g} {first.units[k]}" for k, v in first.pose.items())
    title = f"{first.mechanism}, {len(results)} poses" if poses else f"{first.mechanism}, {pose}"
    return Table(title, columns, tuple(rows), first.units, (), tuple(display))


def forward_table(
    results: Sequence[ForwardResult], many: bool = False, number_from: int = 1
) -> Table:
    """Return assembly modes, a row each; of ``many`` joint positions each is numbered."""
    first = results[0]
    poses = [c for c in first.units if c not in first.joints and c != "residual"]
    if not many and first.solutions:
        poses = [*first.solutions[0].pose, *first.solutions[0].parasitic]
    joints = list(first.joints) if many else []
    columns = (*(["row"] if joints else []), *joints, *poses, "residual", "complete")
    rows: list[tuple[Cell, ...]] = []
    for number, result in enumerate(results, start=number_from):
        head = [number, *result.joints.values()] if joints else []
        modes: list[list[Cell]] = [
            [*({**s.pose, **s.parasitic}.get(c) for c in poses), s.residual, result.complete]
            for s in result.solutions
        ] or [[None] * (len(poses) + 2)]
        rows += [(*head, *mode) for mode in modes]
    given = ", ".join(f"{k} = {v:g} {first.units[k]}" for k, v in first.joints.items())
    title = f"{first.mechanism}, {len(results)} rows" if joints else f"{first.mechanism}, {given}"
    note = f"complete: {first.completeness}"
    return Table(title, columns, tuple(rows), first.units, (note,))


def jacobian_tables(result: JacobianResult) -> list[Table]:
    """Return indices first, then the matrices."""
    unit = result.units["characteristic_length"]
    values = result.singular_values
    rows: list[tuple[Cell, ...]] = [
        (f"lci ({result.kind}, {result.norm}-norm)", result.lci, "1"),
        ("lci_raw", result.lci_raw, "1"),
        ("lci_homogenized", result.lci_homogenized, "1"),
        *((f"lci_{name}", value, "1") for name, value in (
            ("translational", result.lci_translational), ("rotational", result.lci_rotational),
        ) if value is not None),
        ("characteristic_length", result.characteristic_length, unit),
        *((f"singular value {i}", float(v), result.units["singular_values"].split(",")[0])
          for i, v in enumerate(() if values is None else values, start=1)),
        *((f"distance to type 1, {k}", v, unit) for k, v in result.inverse_distance.items()),
        *((f"determinant type 1, {k}", v, "1") for k, v in result.inverse_measure.items()),
        *((f"determinant type 2, {k}", v, "1") for k, v in result.forward_measure.items()),
        *((f"determinant constraint, {k}", v, "1") for k, v in result.constraint_measure.items()),
    ]  # fmt: skip
    singular = f"singular: {'; '.join(result.singular)}" if result.singular else "not singular"
    note = str(result.to_dict()["index_note"])
    tables = [
        Table(f"{result.mechanism}, {result.working_mode}", ("quantity", "value", "unit"),
              tuple(rows), {}, (singular, f"LCI of the {note}")),
    ]  # fmt: skip
    matrices = (("J_X", result.j_x), ("J_q", result.j_q), ("J", result.jacobian))
    for name, matrix in matrices:
        if matrix is not None:
            columns = tuple(f"column {i + 1}" for i in range(matrix.shape[1]))
            body = tuple(tuple(row) for row in matrix.tolist())
            tables.append(Table(f"{name} ({result.units[name]})", columns, body, {}))
    return tables


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
    rows = []
    for number, one in enumerate(results, start=number_from):
        found = {} if isinstance(one, OutOfReach) else _jacobian_columns(one)
        rows.append((number, *one.pose.values(), *(found.get(name) for name in known)))
    return Table(
        f"{mechanism.name}, {asked.mode}, {len(results)} poses",
        ("row", *units), tuple(rows), units,
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
    none = ("joints", "J_X", "J_q", "J", "singular_values", "lci", "lci_raw", "lci_homogenized")
    return {
        "mechanism": asked.mechanism.name,
        "pose": result.pose,
        "working_mode": asked.mode,
        **dict.fromkeys(none),
        "out_of_reach": str(result.error()),
        "units": asked.units,
    }


#: Quantities of the workspace table that are measured on voxels.
_IN_SPACE = ("projected volume", "footprint")


def bounded_text(extreme: Extreme, sign: str) -> str:
    """Return the least or the largest LCI as it is known: at most, at least, or proven."""
    if math.isnan(extreme.value):
        return "-"
    text = shown(extreme.value)
    return f"{text}, proven" if extreme.bound == "proven" else f"{sign} {text}"


def workspace_tables(result: WorkspaceResult) -> list[Table]:
    """Return every sampled number with its error, then the shape."""
    unit = result.volume_unit
    quantiles = zip((0.05, 0.5, 0.95), result.quantiles, strict=True)
    extremes = {"lci min": (result.smallest, "<="), "lci max": (result.largest, ">=")}
    entries: list[tuple[str, tuple[float, float], str]] = [
        ("volume", result.volume, unit),
        ("gci", result.gci, ONE),
        ("lci min", (result.smallest.value, math.nan), ONE),
        *((f"lci quantile {q:g}", e, ONE) for q, e in quantiles),
        ("lci max", (result.largest.value, math.nan), ONE),
    ]
    for region in result.regions:
        name = f"{region.lower:g} <= lci < {region.upper:g}"
        entries.append((f"volume, {name}", region.volume, unit))
        entries.append((f"share, {name}", region.share, ONE))
    if result.projection:
        entries.append(
            ("projected volume", result.projection.volume, result.units["projected_volume"])
        )
        entries.append(("footprint", result.projection.footprint, result.units["footprint"]))
    bounded = result.grid is not None
    rows: list[tuple[Cell, ...]] = []
    display: list[tuple[Cell, ...]] = []

    def add(name: str, value: Cell, texts: Sequence[Cell], error: Cell, unit: str,
            own: bool = True) -> None:  # fmt: skip
        """Add a row; errors that are not the grid's ``own`` are standard errors beside it."""
        places = slice(None, None, 1 if own else -1)
        beside: list[Cell] = [None] if bounded else []
        rows.append((name, value, *[error, *beside][places], unit))
        display.append((name, texts[0], *[texts[1], *beside][places], unit))

    for name, e, u in entries:
        value, error = (None if math.isnan(v) else v for v in e)
        own = result.projection is None or e is result.volume or name not in _IN_SPACE
        texts: tuple[str, str | None] = (
            (bounded_text(*extremes[name]), None) if name in extremes else with_error(*e)
        )
        if name == "projected volume" and result.projection and result.projection.lower:
            texts = (f">= {texts[0]}", texts[1])
        add(name, value, texts, error, u, own)
    design = ", ".join(
        f"{k} = {v:g} {result.units[k]}".removesuffix(f" {ONE}")
        for k, v in result.params.items()
        if v is not None
    )
    sampler = f"{result.grid} cells an axis" if result.grid else f"{result.replicates} replicates"
    errors = ("error_bound", "standard_error") if bounded else ("standard_error",)
    notes = (
        f"{result.samples} samples ({result.sampler}, {sampler}, seed {result.seed}), "
        f"{result.reachable} reachable; working mode {result.working_mode}",
        f"LCI of the {result.index_note}; {result.norm}-norm",
    )
    tables = [
        Table(f"{result.mechanism}: {design}", ("quantity", "value", *errors, "unit"),
              tuple(rows), {}, notes, tuple(display)),
    ]  # fmt: skip
    if result.shape:
        names = ["workspace", *(f"{r.lower:g} <= lci < {r.upper:g}" for r in result.regions)]
        shapes = [result.shape.workspace, *result.shape.regions]
        if result.projection:
            names.append("positions reached")
            shapes.append(result.projection.shape)
        tables.append(
            Table(
                f"Shape, counted on {result.shape.grid} cells an axis",
                ("set", "pieces", "voids", "pockets", "confirmed"),
                tuple((n, t.pieces, t.voids, t.pockets, t.confirmed)
                      for n, t in zip(names, shapes, strict=True)),
                {},
                (*([f"positions reached: on {result.projection.grid} voxels along the longest side"]
                   if result.projection else []),
                 "voids are enclosed, pockets open to the domain's boundary only; confirmed: a "
                 "coarser grid counts the same",),
            )
        )  # fmt: skip
    return tables


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
    rows, display = [], []
    for name, design in ends:
        head: list[Cell] = [name, design.number, *(design.parameters[k] for k in parameters)]
        pairs = [(design.objectives[k], design.errors[k]) for k in objectives]
        rows.append((*head, *(number for pair in pairs for number in pair)))
        display.append((*head, *(text for pair in pairs for text in with_error(*pair))))
    columns = (
        "place", "design", *parameters, *(c for k in objectives for c in (k, f"{k}_error")),
    )  # fmt: skip
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
    return [Table("Pareto front", columns, tuple(rows), front.units, tuple(notes), tuple(display))]

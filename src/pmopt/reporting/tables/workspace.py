"""A workspace as tables: every number with its error."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pmopt.reporting.tables.table import (
    Cell,
    Shown,
    Table,
    Uncertain,
    design_facts,
    design_text,
    facts,
    shown,
)
from pmopt.units import ONE

if TYPE_CHECKING:
    from pmopt.analysis.workspace.compute import WorkspaceResult
    from pmopt.analysis.workspace.shape import Topology
    from pmopt.quantity import Quantity


def bounded(value: float, sign: str, proven: bool = False) -> Cell:
    """Return an extreme as it is known: at most (``<=``), at least (``>=``), or proven."""
    if math.isnan(value):
        return None
    text = shown(value)
    return Shown(value, f"{text}, proven" if proven else f"{sign} {text}")


@dataclass(frozen=True)
class _Figure:
    """A row of the workspace's table; ``bound`` is the kind of an extreme in CSV."""

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
        # poses are positions, volume and error are those of the workspace.
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

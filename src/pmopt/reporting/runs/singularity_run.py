"""A whole ``pmopt singularities`` run: result, tables, files."""

from __future__ import annotations

import math
from pathlib import Path

from pmopt.analysis.kinematics.determinants import KINDS
from pmopt.analysis.sampling.evaluator import Notify
from pmopt.analysis.singularities.crossings import PathResult
from pmopt.analysis.singularities.survey import Nearness, SingularityResult, find_singularities
from pmopt.mechanisms import find
from pmopt.reporting.pictures.gallery import write_pictures
from pmopt.reporting.runs.run_folder import RunFolder, claimed
from pmopt.reporting.runs.tasks import WorkspaceTask
from pmopt.reporting.tables.table import (
    Cell,
    Shown,
    Table,
    Uncertain,
    design_facts,
    design_text,
    facts,
    to_csv,
    to_json,
)
from pmopt.reporting.tables.workspace import bounded
from pmopt.units import ONE


def run_singularities(
    task: WorkspaceTask,
    out: Path | None = None,
    *,
    force: bool = False,
    threads: int | None = None,
    notify: Notify | None = None,
) -> SingularityResult:
    """Map the singularities and, with ``out``, write the run's folder.

    Raises
    ------
    InputError, InfeasibleError
    """
    with claimed(out, force) as folder:
        return _run(task, folder, threads, notify)


def _run(
    task: WorkspaceTask, folder: RunFolder | None, threads: int | None, notify: Notify | None
) -> SingularityResult:
    result = find_singularities(
        task.mechanism,
        task.parameters,
        task.settings,
        seed=task.seed,
        threads=threads,
        grid=task.shape_grid or None,
        notify=notify,
    )
    if folder is not None:
        from pmopt.reporting.runs import run_pictures

        folder.open()
        folder.write("result.json", to_json(result.to_dict()) + "\n")
        for name, table in zip(("aspects", "families", "walls"), _numbers(result), strict=True):
            folder.write(f"{name}.csv", to_csv([table]) + "\n")
        missing = write_pictures(
            folder, lambda: run_pictures.of_singularities(task, threads), notify
        )
        folder.close(
            "singularities",
            {
                "mechanism": task.mechanism.name,
                "config": task.to_dict(),
                "seed": task.seed,
                "resumes": [],
                "units": result.units,
                **missing,
            },
        )
    return result


def _numbers(result: SingularityResult) -> tuple[Table, Table, Table]:
    units = result.units
    aspects: list[tuple[Cell, ...]] = [
        (number, Shown(a.sign, "+" if a.sign > 0 else "-"), a.home,
         Uncertain(a.volume.value, a.volume.error), Uncertain(a.share.value, a.share.error))
        for number, a in enumerate(result.aspects, start=1)
    ]  # fmt: skip
    counted = "a coarser grid counts the same" if result.confirmed else (
        "a coarser grid counts others: not to be relied on"
    )  # fmt: skip
    first = Table(
        "Aspects: connected regions without forward or constraint singularity",
        ("aspect", "sign", "home", "volume", "share"),
        tuple(aspects),
        {"volume": result.volume_unit},
        (f"counted on {result.grid} cells an axis ({counted}), {result.specks} specks left out; "
         f"{result.samples} samples, {result.reachable} reachable",),
        "aspect",
        errors={"volume": ("volume_error",), "share": ("share_error",)},
    )  # fmt: skip
    # For CSV a column for each coordinate that is fixed somewhere.
    fixed = list(dict.fromkeys(name for f in result.families for name in f.fixed))
    families: list[tuple[Cell, ...]] = [
        (
            KINDS[f.kind],
            ", ".join(f"{k} = {_angle(v, units[k])}" for k, v in f.fixed.items()) or "all poses",
            *(f.fixed.get(name) for name in fixed),
            ", ".join(f.free),
            "inside" if f.in_domain else "beyond",
            bounded(f.largest_lci, ">="),
            f.poses,
        )
        for f in result.families
    ]
    second = Table(
        "Singular families: every reachable pose of the slice is singular",
        ("kind", "slice", *fixed, "any", "domain", "largest_lci", "poses"),
        tuple(families),
        units,
        (
            "searched in all orientations that the limits leave; domain: whether the slice passes "
            "through the domain of the workspace; largest_lci: of its sampled poses"
            if families
            else "none among the slices that fix coordinates, in all orientations",
        ),
        "family",
        prose=("slice", "any"),
        only_csv=tuple(fixed),
    )
    there = list(dict.fromkeys(name for w in result.walls for name in w.values))
    rows: list[tuple[Cell, ...]] = []
    mechanism = find(result.mechanism)
    main = {c.name for c in (*mechanism.joints, *mechanism.parasitic)}
    for w in result.walls:
        values = ", ".join(
            f"{k} = {_angle(v, units[k])}" for k, v in w.values.items() if k in main
        )  # fmt: skip
        rows.append(
            (f"{w.coordinate} {'+' if w.direction > 0 else '-'}", w.value,
             units[w.coordinate], w.what, values, *(w.values.get(name) for name in there))
        )  # fmt: skip
    home = ", ".join(f"{k} = {v:g} {units[k]}" for k, v in result.home.items())
    third = Table(
        f"From home ({home}) along each coordinate, the first wall",
        ("along", "value", "unit", "wall", "there", *there),
        tuple(rows),
        {},
        () if rows else ("the home pose is out of reach of this design",),
        "wall",
        prose=("wall", "there"),
        only_csv=tuple(there),
    )
    return first, second, third


def _angle(value: float, unit: str) -> str:
    """Return a value with its unit, an angle in degrees too."""
    if unit != "rad":
        return f"{value:.6g} {unit}".strip()
    return f"{value:.6g} rad ({math.degrees(value):.4f} deg)" if value else "0"


def _where(found: Nearness, units: dict[str, str]) -> str:
    """Say whether a determinant changes sign, and what its zeros have in common."""
    if not found.crossed:
        return "one sign"
    same = ", ".join(f"{k} = {_angle(v, units[k.strip('|')])}" for k, v in found.always.items())
    return f"changes sign, always at {same}" if same else "changes sign"


def singularity_tables(result: SingularityResult) -> list[Table]:
    """Return what was found, how near the workspace comes to singularities first."""
    near = Table(
        f"{result.mechanism}: {design_text(result.params, result.units)}",
        ("quantity", "value", "over the workspace", "vanishes where"),
        tuple(_nearness(result)),
        {},
        (f"working mode {result.working_mode}; <= stands before what sampled poses met: the least "
         "of all is at most that",
         "singular values are of the homogenized Jacobian; determinants are normalised, without "
         "unit, and taken by their size; one that changes sign is 0 somewhere"),
        "nearness",
        prose=("over the workspace", "vanishes where"),
    )  # fmt: skip
    return [near, *_numbers(result)]


def singularity_data(result: SingularityResult) -> list[Table]:
    """Return all of it for CSV."""
    counts = {"grid": result.grid, "specks": result.specks, "confirmed": int(result.confirmed),
              "samples": result.samples, "reachable": result.reachable,
              "seed": result.seed}  # fmt: skip
    numbers: dict[str, tuple[float | int | None, str]] = {
        **{name: (n, ONE) for name, n in counts.items()},
        **{f"home {name}": (v, result.units[name]) for name, v in result.home.items()},
        **design_facts(result.params, result.units),
    }
    texts = {"mechanism": result.mechanism, "working mode": result.working_mode}
    return [*singularity_tables(result), facts(numbers, texts)]


def _nearness(result: SingularityResult) -> list[tuple[str, Cell, str | None, str | None]]:
    """Return how near the workspace comes to singularities: what, how near at least, where."""
    rows: list[tuple[str, Cell, str | None, str | None]] = [
        ("smallest lci met", bounded(result.smallest_lci, "<="), None, None),
        ("smallest singular value met", bounded(result.smallest_singular_value, "<="), None, None),
        ("lci at home", result.home_lci, None, None),
    ]
    for n in result.nearness:
        smallest = bounded(n.smallest, "<=") if n.smallest else Shown(0.0, "0")
        where = _where(n, result.units)
        rows.append((f"determinant, {KINDS[n.kind]}, {n.part}", smallest, where, n.condition))
    return rows


def path_tables(result: PathResult) -> list[Table]:
    """Return the crossings of a path, and how near it comes to each kind of singularity."""
    units = result.units
    timed = any(c.time is not None for c in result.crossings)
    poses = [name for name in units if result.crossings and name in result.crossings[0].pose]
    crossings: list[tuple[Cell, ...]] = [
        (KINDS[c.kind], c.part, *([c.time] if timed else []), c.row, c.until, c.changes_sign,
         *(c.pose[k] for k in poses))
        for c in result.crossings
    ]  # fmt: skip
    first = Table(
        f"{result.mechanism}: crossings of a path of {result.rows} poses",
        ("kind", "part", *(["t"] if timed else []), "row", "until", "changes_sign", *poses),
        tuple(crossings),
        units | {"t": units["time"]},
        ("rows count from 1; between rows the path is straight in the pose's coordinates",)
        if crossings
        else ("none: every determinant keeps its sign",),
        "crossing",
    )
    second = Table(
        "Smallest determinants at the path's rows",
        ("kind", "part", "row", "value"),
        tuple((KINDS[n.kind], n.part, n.row, n.value) for n in result.nearest),
        {},
        (f"working mode {result.working_mode}; determinants are normalised, without unit",),
        "smallest",
    )
    return [first, second]

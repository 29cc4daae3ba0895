"""A whole ``pmopt singularities`` run: result, tables, files."""

from __future__ import annotations

import math
from pathlib import Path

from pmopt.analysis.crossings import PathResult
from pmopt.analysis.measures import KINDS
from pmopt.analysis.singularities import Nearness, SingularityResult, find_singularities
from pmopt.analysis.sweeper import Notify
from pmopt.reporting.gallery import write_pictures
from pmopt.reporting.run_folder import RunFolder, claimed
from pmopt.reporting.table import Cell, Table, to_csv, to_json, with_error
from pmopt.reporting.tasks import WorkspaceTask
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
        from pmopt.reporting import pictures

        folder.open()
        folder.write("result.json", to_json(result.to_dict()) + "\n")
        for name, table in zip(("aspects", "families", "walls"), _numbers(result), strict=True):
            folder.write(f"{name}.csv", to_csv([table]) + "\n")
        missing = write_pictures(folder, lambda: pictures.of_singularities(task, threads), notify)
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
        (number, "+" if a.sign > 0 else "-", a.home, *a.volume, *a.share)
        for number, a in enumerate(result.aspects, start=1)
    ]
    shown = tuple(
        (number, "+" if a.sign > 0 else "-", a.home, *with_error(*a.volume), *with_error(*a.share))
        for number, a in enumerate(result.aspects, start=1)
    )
    told = "a coarser grid counts the same" if result.confirmed else (
        "a coarser grid counts others: not to be relied on"
    )  # fmt: skip
    first = Table(
        "Aspects: connected regions without forward or constraint singularity",
        ("aspect", "sign", "home", "volume", "volume_error", "share", "share_error"),
        tuple(aspects),
        {"volume": result.volume_unit, "volume_error": result.volume_unit},
        (f"told apart on {result.grid} cells an axis ({told}), {result.specks} specks left out; "
         f"{result.samples} samples, {result.reachable} reachable",),
        shown,
    )  # fmt: skip
    families: list[tuple[Cell, ...]] = [
        (
            KINDS[f.kind],
            ", ".join(f"{k} = {_angle(v, units[k])}" for k, v in f.fixed.items()) or "all poses",
            ", ".join(f.free),
            "inside" if f.in_domain else "beyond",
            f.largest_lci,
            f.poses,
        )
        for f in result.families
    ]
    second = Table(
        "Singular families: every reachable pose of the slice is singular",
        ("kind", "slice", "any", "domain", "largest_lci", "poses"),
        tuple(families),
        {},
        (
            "searched in all orientations that the limits leave; domain: whether the slice passes "
            "through the domain of the workspace"
            if families
            else "none among the slices that fix coordinates, in all orientations",
        ),
    )
    rows: list[tuple[Cell, ...]] = []
    for w in result.walls:
        values = ", ".join(f"{k} = {_angle(v, units.get(k, ''))}" for k, v in w.values.items())
        rows.append(
            (f"{w.coordinate} {'+' if w.direction > 0 else '-'}", w.value,
             units[w.coordinate], w.what, values)
        )  # fmt: skip
    home = ", ".join(f"{k} = {v:g} {units[k]}" for k, v in result.home.items())
    third = Table(
        f"From home ({home}) along each coordinate, the first wall",
        ("along", "value", "unit", "wall", "there"),
        tuple(rows),
        {},
        () if rows else ("the home pose is out of reach of this design",),
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
    rows: list[tuple[Cell, ...]] = [
        ("smallest lci met", result.smallest_lci, "", ""),
        ("smallest singular value met (homogenized)", result.smallest_singular_value, "", ""),
        ("lci at home", result.home_lci, "", ""),
    ]
    rows += [
        (f"determinant, {KINDS[n.kind]}, {n.part}", n.smallest,
         _where(n, result.units), n.condition)
        for n in result.nearness
    ]  # fmt: skip
    design = ", ".join(
        f"{k} = {v:g} {result.units[k]}".removesuffix(f" {ONE}")
        for k, v in result.params.items()
        if v is not None
    )
    near = Table(
        f"{result.mechanism}: {design}",
        ("quantity", "smallest absolute value", "over the workspace", "vanishes where"),
        tuple(rows),
        {},
        (f"working mode {result.working_mode}; determinants are normalised, without unit, over "
         "sampled poses; a determinant that changes sign is 0 somewhere",),
    )  # fmt: skip
    return [near, *_numbers(result)]


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
    )
    second = Table(
        "Smallest determinants met",
        ("kind", "part", "row", "value"),
        tuple((KINDS[n.kind], n.part, n.row, n.value) for n in result.nearest),
        {},
        (f"working mode {result.working_mode}; determinants are normalised, without unit",),
    )
    return [first, second]

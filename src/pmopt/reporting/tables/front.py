"""A front as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pmopt.reporting.tables.table import (
    Table,
    Uncertain,
)
from pmopt.units import ONE

if TYPE_CHECKING:
    from pmopt.reporting.runs.pareto_run import ParetoRun
    from pmopt.synthesis.front import Front


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

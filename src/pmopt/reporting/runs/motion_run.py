"""A whole ``pmopt motion`` run: trajectory, motion, tables, files."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pmopt.analysis.motion.config import MotionTask
from pmopt.analysis.motion.motion import Loads, compute_motion
from pmopt.analysis.motion.recordings import Residual
from pmopt.analysis.motion.records import Motion, Span
from pmopt.analysis.motion.summary import Demand, broken_limits, columns, demands
from pmopt.analysis.motion.trajectories import Planned, plan_trajectory
from pmopt.analysis.record import Subject
from pmopt.inputs.reading import LARGEST_OF_LINES, read_file
from pmopt.reporting.pictures.gallery import write_pictures
from pmopt.reporting.runs.run_folder import RunFolder, claimed
from pmopt.reporting.tables.streams import csv_pieces
from pmopt.reporting.tables.table import Cell, Shown, Table, to_csv
from pmopt.units import ONE, effort_unit, per_second

Notify = Callable[[str], None]
#: Instants of which rows are written at once.
_ROWS = 4096
#: Name in the run's folder of the file that a trajectory was read from.
RECORDING = "recording.csv"


@dataclass(frozen=True)
class MotionRun:
    """A motion and its report.

    Attributes
    ----------
    task : MotionTask
    planned : Planned
    motion : Motion
    demands : tuple of Demand
        Of each actuated joint; empty where the motion is infeasible.
    infeasible : tuple of Span
        Where it is out of reach, singular or beyond a limit, by time.
    """

    task: MotionTask
    planned: Planned
    motion: Motion
    demands: tuple[Demand, ...]
    infeasible: tuple[Span, ...]

    @property
    def subject(self) -> Subject:
        """The design, and where the motion goes."""
        return self.motion.subject

    @property
    def infeasible_instants(self) -> int:
        """Number of instants at which something is wrong."""
        flags = np.zeros(len(self.motion.t), dtype=bool)
        for span in self.infeasible:
            flags[span.first : span.last + 1] = True
        return int(flags.sum())

    def complaint(self) -> str:
        """Return the one line that says how much of the motion is infeasible, and where."""
        first = self.infeasible[0]
        worst = max(self.infeasible, key=self._severity)
        t = self.motion.t
        text = (
            f"{self.task.where}: infeasible at {self.infeasible_instants} of {len(t)} instants, "
            f"{len(self.infeasible)} span{'s' if len(self.infeasible) > 1 else ''}: first at "
            f"t={_time(t[first.first])} s, {first.what}; "
        )
        return text + f"worst at t={_time(t[worst.worst])} s, {worst.text}"

    def _severity(self, span: Span) -> float:
        """Order spans by the size of the miss: lengths count over the characteristic length.

        At a singularity efforts have no bound, whatever its index is.
        """
        mechanism = self.task.mechanism
        if span.what == "singularity":
            return math.inf
        if span.unit == mechanism.length_unit:
            return abs(span.miss) / mechanism.characteristic_length(self.task.parameters)
        return abs(span.miss)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        trajectory = self.task.config.trajectory
        t = self.motion.t
        document: dict[str, Any] = {
            "mechanism": self.motion.mechanism,
            "params": dict(self.motion.params),
            "working_mode": self.motion.working_mode,
            "space": trajectory.space,
            "source": trajectory.source,
            "start": float(t[0]),
            "duration": float(t[-1] - t[0]),
            "step": trajectory.step,
            "instants": len(t),
            "infeasible_instants": self.infeasible_instants,
            "infeasible": [
                {"from": float(t[s.first]), "to": float(t[s.last]), "worst_at": float(t[s.worst]),
                 "what": s.what, "miss": s.miss, "unit": s.unit, "text": s.text}
                for s in self.infeasible
            ],
            "actuators": [
                {"joint": joint.name,
                 **{d.quantity: _figures(d) for d in self.demands if d.joint == joint.name}}
                for joint in self.motion.joints.coordinates
            ] if self.demands else [],
            "fit": [r.to_dict() for r in self.planned.residuals],
            "approaches": [asdict(a) for a in self.motion.approaches],
            "notes": list(self.planned.notes),
            "units": self.units,
        }  # fmt: skip
        return document

    @property
    def units(self) -> dict[str, str]:
        """Unit of every name."""
        mechanism = self.task.mechanism
        units = {p.name: mechanism.unit(p) for p in mechanism.parameters}
        units |= {name: one.unit for name, one in columns(self.motion, mechanism).items()}
        units["lci"] = ONE
        times = ("t", "start", "duration", "step", "from", "to", "worst_at", "at", "period")
        return units | dict.fromkeys(times, "s")


def _time(t: float) -> str:
    return f"{float(t):.6g}"


def _figures(demand: Demand) -> dict[str, float]:
    found = {"min": demand.low, "max": demand.high, "peak": demand.peak, "at": demand.at}
    return found if demand.rms is None else found | {"rms": demand.rms}


def run_motion(
    task: MotionTask,
    out: Path | None = None,
    *,
    force: bool = False,
    threads: int | None = None,
    notify: Notify | None = None,
) -> MotionRun:
    """Compute a motion and, with ``out`` and if it is feasible, write the run's folder.

    Raises
    ------
    InputError
        When the folder holds a run, or for a trajectory that cannot be made.
    """
    with claimed(out, force) as folder:
        return _run(task, folder, threads, notify)


def _run(
    task: MotionTask, folder: RunFolder | None, threads: int | None, notify: Notify | None
) -> MotionRun:
    planned = plan_trajectory(task)
    motion = compute_motion(
        task.mechanism,
        task.parameters,
        planned.trajectory,
        working_mode=task.config.working_mode,
        loads=Loads(task.bodies or None, task.payload, task.config.gravity, task.config.efforts),
        limits=task.joint_limits,
        threads=threads,
        notify=notify,
    )
    spans = [*motion.infeasible, *broken_limits(motion, task.mechanism, task.other_limits)]
    infeasible = tuple(sorted(spans, key=lambda span: (span.first, span.last)))
    if not task.config.efforts:
        passed = tuple(
            f"passes {span.text}" if span.text.startswith("between") else
            span.text if span.text.startswith("at t") else
            f"at t = {motion.t[span.first]:.9g} s {span.text}"
            for span in motion.singular
        )  # fmt: skip
        planned = replace(planned, notes=(*planned.notes, *passed))
    units = {c.name: effort_unit(c.kind) for c in task.mechanism.joints}
    near = tuple(approach.text(units) for approach in motion.approaches)
    if near and notify is not None:
        for line in near:
            notify(line)
    planned = replace(planned, notes=(*planned.notes, *near))
    run = MotionRun(
        task, planned, motion,
        () if motion.infeasible else demands(motion, task.mechanism), infeasible,
    )  # fmt: skip
    if folder is not None and not infeasible:
        _write(run, folder, notify)
    return run


def _write(run: MotionRun, folder: RunFolder, notify: Notify | None) -> None:
    from pmopt.reporting.pictures import motion_plots

    folder.open()
    folder.write("motion.csv", csv_pieces(motion_tables_of(run)))
    folder.write("summary.csv", to_csv([summary_table(run)]) + "\n")
    centres = centres_table(run, slice(0, 0))
    if centres is not None:
        folder.write("centres.csv", csv_pieces(_centres_tables(run)))
    origin = write_origin(run.task, folder)
    missing = write_pictures(
        folder, lambda: motion_plots.draw_motion(run.motion, run.task.mechanism), notify
    )
    folder.close(
        "motion",
        {
            "mechanism": run.task.mechanism.name,
            **origin,
            "fit": [r.to_dict() for r in run.planned.residuals],
            "notes": list(run.planned.notes),
            "resumes": [],
            **missing,
            "units": run.units | {"mass": "kg", "centre": run.task.mechanism.length_unit,
                                  "inertia": "kg m^2"} | ({} if centres is None else centres.units),
        },
    )  # fmt: skip


def write_origin(task: MotionTask, folder: RunFolder) -> dict[str, Any]:
    """Write the recording a motion came from, if any, and return what the manifest says of it.

    With it the folder holds all that is needed to run the motion again.
    """
    config = task.to_dict()
    source = task.config.trajectory.file
    inputs = {}
    if source is not None:
        inputs = {RECORDING: source}
        folder.write(RECORDING, read_file(task.folder / source, LARGEST_OF_LINES))
        config["trajectory"]["file"] = RECORDING
    bodies = [
        {"name": b.name, "mass": b.mass, "centre": b.centre.tolist(),
         "inertia": b.inertia.tolist(), "limb": b.limb, "joint": b.joint, "part": b.part,
         "source": b.source}
        for b in task.bodies
    ]  # fmt: skip
    return {"config": config, "bodies": bodies, "inputs": inputs}


def _parts(run: MotionRun) -> Iterator[slice]:
    for first in range(0, len(run.motion.t), _ROWS):
        yield slice(first, first + _ROWS)


def motion_tables_of(run: MotionRun) -> Iterator[Table]:
    """Yield the whole motion, one row an instant, some thousand rows a table."""
    series = columns(run.motion, run.task.mechanism)
    units = {"t": "s"} | {name: one.unit for name, one in series.items()}
    for part in _parts(run):
        matrix = np.stack([run.motion.t[part], *(s.values[part] for s in series.values())], axis=1)
        yield Table(
            f"{run.motion.mechanism}: motion", ("t", *series), tuple(map(tuple, matrix.tolist())),
            units,
        )  # fmt: skip


def _centres_tables(run: MotionRun) -> Iterator[Table]:
    for part in _parts(run):
        table = centres_table(run, part)
        assert table is not None  # the motion has bodies
        yield table


def centres_table(run: MotionRun, part: slice) -> Table | None:
    """Return position, velocity and acceleration of each body's centre of mass, None without.

    Of some instants only: ``part``.
    """
    centres = run.motion.centres
    if not centres:
        return None
    unit = run.task.mechanism.length_unit
    units = {"t": "s"}
    parts = [run.motion.t[part, None]]
    found = centres.part(part)
    for order, ending in enumerate(("", "_rate", "_acceleration")):
        for k, name in enumerate(centres):
            parts.append(found[:, k, order])
            scaled = per_second(unit, order) if order else unit
            units |= {f"{name.replace(' ', '_')}_{axis}{ending}": scaled for axis in "xyz"}
    rows = np.concatenate(parts, axis=1).tolist()
    return Table("Centres of mass", tuple(units), tuple(map(tuple, rows)), units)


def summary_table(run: MotionRun) -> Table:
    """Return what the motion asks of each actuated joint."""
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (d.joint, d.quantity, d.low, d.high, d.peak, d.at, d.rms, d.unit) for d in run.demands
    )
    trajectory, t = run.task.config.trajectory, run.motion.t
    notes = [
        f"{len(t)} instants in {float(t[-1] - t[0]):g} s, a step of {trajectory.step:g} s; from "
        f"{trajectory.source} in {trajectory.space} space; working mode {run.motion.working_mode}",
        *run.planned.notes,
    ]
    if run.motion.effort is None:
        why = "the mechanism has no masses" if run.task.config.efforts else "not asked for"
        notes.append(f"no efforts: {why}")
    return Table(
        f"{run.motion.mechanism}: what the motion asks of the actuators",
        ("joint", "quantity", "min", "max", "peak", "at", "rms", "unit"), rows, {"at": "s"},
        tuple(notes), yielding=("min", "max", "at"),
    )  # fmt: skip


def spans_table(run: MotionRun) -> Table:
    """Return the spans of time at which the motion is infeasible."""
    t = run.motion.t
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (float(t[s.first]), float(t[s.last]), s.last - s.first + 1, s.what, float(t[s.worst]),
         Shown(s.miss, f"{s.miss:.3g}"), s.unit, s.text)
        for s in run.infeasible
    )  # fmt: skip
    return Table(
        f"{run.motion.mechanism}: infeasible at {run.infeasible_instants} of {len(t)} instants",
        ("from", "to", "instants", "what", "worst_at", "miss", "unit", "there"), rows,
        {"from": "s", "to": "s", "worst_at": "s"}, prose=("there",),
    )  # fmt: skip


def fit_table(residuals: tuple[Residual, ...]) -> Table:
    """Return what a fit to recorded points leaves."""
    rows: list[tuple[Cell, ...]] = []
    for r in map(asdict, residuals):
        waves = ", ".join(f"{a:.6g} at {p:.6g} rad"
                          for a, p in zip(r["amplitudes"], r["phases"], strict=True))  # fmt: skip
        rows.append((r["coordinate"], r["points"], r["rms"], r["max"], r["unit"], r["period"],
                     r["offset"], waves or None))  # fmt: skip
    return Table(
        "Fit to the recorded points",
        ("coordinate", "points", "rms", "max", "unit", "period", "offset", "amplitudes"),
        tuple(rows), {"period": "s"},
        ("rms and max of the differences at the recorded points",), prose=("amplitudes",),
    )  # fmt: skip


def motion_tables(run: MotionRun) -> list[Table]:
    """Return the tables of a run: spans where it is infeasible, else the demands and the fit."""
    if run.infeasible:
        return [spans_table(run)]
    fits = [fit_table(run.planned.residuals)] if run.planned.residuals else []
    return [summary_table(run), *fits]

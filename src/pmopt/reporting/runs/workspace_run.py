"""A whole ``pmopt workspace`` run: plan, result, files."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

from pmopt.analysis.certification.budgets import Clock
from pmopt.analysis.sampling.evaluator import Notify
from pmopt.analysis.sampling.measuring import Course, Progress, planned_samples
from pmopt.analysis.sampling.partial_sums import Sums
from pmopt.analysis.workspace.compute import (
    WorkspaceResult,
    compute_workspace,
)
from pmopt.analysis.workspace.emptiness import require_reachable
from pmopt.errors import InputError, PmoptError
from pmopt.reporting.pictures.gallery import write_pictures
from pmopt.reporting.runs.run_folder import MANIFEST, RunFolder, claimed, manifest_to_keep
from pmopt.reporting.runs.tasks import Plan, WorkspaceTask
from pmopt.reporting.runs.workspace_checkpoint import GROWS, WorkspaceCheckpoint, resolved
from pmopt.reporting.tables.table import Table, to_csv, to_json
from pmopt.storage.checkpoint import refuse_changes

if TYPE_CHECKING:
    from pmopt.execution.cluster import Cluster

_PROBE = 1 << 18


def plan(task: WorkspaceTask, threads: int | None, notify: Notify) -> Plan:
    """Measure a small probe and scale it to the run asked for."""
    settings, dimension = task.settings, len(task.mechanism.pose)
    for samples in (1024, _PROBE):  # the first round compiles or loads the kernels
        probe = settings.model_copy(
            update={"grid": None, "target_error": None, "samples": samples, "replicates": None}
        )
        clock = Clock()
        found = compute_workspace(
            task.mechanism, task.parameters, probe, seed=task.seed, threads=threads,
            shape_grid=0, notify=notify,
        )  # fmt: skip
        seconds = clock.seconds
    if settings.grid is not None:
        points, what = float(settings.grid) ** dimension * 2, f"grid of {settings.grid} cells"
    elif settings.target_error is not None:
        # Low-discrepancy points: the error falls about with the power 0.85 of their number.
        worst = max(e.error / e.value if e.value > 0 else 0.0 for e in (found.volume, found.gci))
        power = 0.5 if settings.sampler == "monte-carlo" else 0.85
        # The last of the doublings takes half as much again on average.
        points = 1.5 * _PROBE * (worst / settings.target_error) ** (1 / power)
        what = f"{settings.sampler} to a relative error of {settings.target_error:g}"
    else:
        points = float(planned_samples(settings))
        what = f"{points:.0f} samples, {settings.sampler}"
    return Plan(f"workspace {task.mechanism.name}: {what}", points, seconds * points / _PROBE)


def run_workspace(
    task: WorkspaceTask,
    out: Path | None = None,
    *,
    force: bool = False,
    resume: bool = False,
    threads: int | None = None,
    notify: Notify | None = None,
    progress: Progress | None = None,
    cluster: Cluster | None = None,
) -> WorkspaceResult:
    """Sample a workspace and, with ``out``, write the run's folder.

    A long run keeps what it has summed there now and then, and when it is interrupted.

    Parameters
    ----------
    task : WorkspaceTask
    out : Path, optional
        The run's folder; None writes nothing.
    force : bool
        Overwrite a run in the folder.
    resume : bool
        Take up the run in the folder, if there is one.
    threads : int, optional
    notify, progress : callable, optional
    cluster : Cluster, optional
        Samples there.

    Raises
    ------
    InputError
        When the folder holds a run, or one of another task, or for names and values the mechanism
        does not have.
    InfeasibleError
        When nothing is reachable, with what rules it out; nothing is left in the folder.
    """
    continues = resume and out is not None and _continues(task, out)
    with claimed(out, force, resume, continues) as folder:
        checkpoint = None if folder is None else WorkspaceCheckpoint(folder, task)
        begun = Sums()
        if checkpoint is not None and folder is not None and folder.begun:
            begun = checkpoint.resume(notify)
        try:
            result = compute_workspace(
                task.mechanism,
                task.parameters,
                task.settings,
                seed=task.seed,
                threads=threads,
                shape_grid=task.shape_grid,
                notify=notify,
                course=Course(begun, checkpoint.keep if checkpoint else None, progress, cluster),
            )
        except BaseException:  # Ctrl-C above all
            if checkpoint is not None:
                with contextlib.suppress(PmoptError):
                    checkpoint.flush()
            raise
        if checkpoint is not None and result.reachable == 0:
            checkpoint.clear()
        require_reachable(
            result.reachable, task.mechanism, task.parameters, task.settings, "workspace",
            result.samples,
        )  # fmt: skip
        if folder is not None and checkpoint is not None:
            _write(task, result, folder, checkpoint, threads, notify)
    return result


def _write(
    task: WorkspaceTask, result: WorkspaceResult, folder: RunFolder,
    checkpoint: WorkspaceCheckpoint, threads: int | None, notify: Notify | None,
) -> None:  # fmt: skip
    from pmopt.reporting.runs import run_pictures

    folder.open()
    folder.write("result.json", to_json(result.to_dict()) + "\n")
    folder.write("lci_histogram.csv", to_csv([histogram_table(result)]) + "\n")
    folder.write("regions.csv", to_csv([regions_table(result)]) + "\n")
    missing = write_pictures(
        folder, lambda: run_pictures.of_workspace(task, result, threads), notify
    )
    checkpoint.finish()
    folder.close(
        "workspace",
        {
            "mechanism": task.mechanism.name,
            "config": task.to_dict(),
            "seed": task.seed,
            "resumes": checkpoint.resumes,
            "resume_notes": checkpoint.notes,
            "units": result.units,
            **missing,
        },
    )


def finished(task: WorkspaceTask, out: Path) -> bool:
    """Return whether a folder holds this very run, finished.

    Raises
    ------
    InputError
        When it holds a finished run that this one does not continue.
    """
    earlier = _earlier(out)
    return earlier is not None and resolved(earlier) == resolved(task)


def _continues(task: WorkspaceTask, out: Path) -> bool:
    """Return whether a folder holds a finished run; refuse one that this one does not continue."""
    earlier = _earlier(out)
    if earlier is not None:
        refuse_changes(out, resolved(earlier), resolved(task), GROWS)
    return earlier is not None


def _earlier(out: Path) -> WorkspaceTask | None:
    manifest = manifest_to_keep(out)
    if manifest is None:
        return None
    if manifest["command"] != "workspace":
        raise InputError(f"--out: {out} holds a finished {manifest['command']} run, not workspace")
    return WorkspaceTask.from_dict(manifest.get("config", {}), str(out / MANIFEST))


def histogram_table(result: WorkspaceResult) -> Table:
    """Return the LCI histogram: counts, and the volume and share they stand for.

    Bins are equal parts of octaves; see :func:`pmopt.numerics.bins.bin_edges`.

    On lines a point counts with its weight.
    """
    total = sum(result.histogram) or 1
    volume = 0.0 if result.reachable == 0 else result.volume.value
    edges = result.histogram_edges.tolist()
    held = [k for k, count in enumerate(result.histogram) if count] or [0]
    first, last = held[0], held[-1] + 1
    # Empty bins below and above are one row each.
    spans = [(0, first)] * (first > 0) + [(k, k + 1) for k in range(first, last)]
    spans += [(last, len(edges) - 1)] * (last < len(edges) - 1)
    rows = tuple(
        (edges[a], edges[b], count, volume * count / total, count / total)
        for a, b in spans
        for count in (result.histogram[a],)
    )
    return Table("LCI histogram", ("lower", "upper", "count", "volume", "share"), rows,
                 result.units)  # fmt: skip


def regions_table(result: WorkspaceResult) -> Table:
    """Return the volume breakdown by dexterity region."""
    kind = result.error_name
    error = "error" if kind == "standard_error" else kind
    names = ("lower", "upper", "volume", "share", f"volume_{error}", f"share_{error}")
    document = result.to_dict()["regions"]
    keys = ("lower", "upper", "volume", "share", f"volume_{kind}", f"share_{kind}")
    rows = tuple(tuple(r[k] for k in keys) for r in document)
    return Table("Dexterity regions", names, rows, result.units)

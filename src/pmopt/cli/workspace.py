"""``pmopt workspace``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from pmopt.analysis.settings import (
    DEFAULT_SEED,
    SAMPLING,
    VolumeSettings,
    WorkspaceConfig,
    WorkspaceSettings,
)
from pmopt.cli import options
from pmopt.cli.fields import Sectioned, given_options, option_name, options_of
from pmopt.cli.output import emit, notifier, progress_bar
from pmopt.errors import InputError
from pmopt.mechanisms import Mechanism
from pmopt.mechanisms.mechanism import Parameters

#: Of guaranteed bounds, what is no setting of the workspace.
_PROOF = ("gap", "time_budget", "box_budget")


@click.command("workspace", cls=Sectioned)
@options.mechanism_argument
@options.params_option
@options_of(WorkspaceSettings)
@options_of(WorkspaceConfig, only=("seed", "shape_grid"))
@options_of(VolumeSettings, only=_PROOF)
@options.threads_option
@options.scheduler_option
@options.out_options
@options.resume_option
@click.option("--dry-run", is_flag=True, help="Say what would be run and how long it takes.")
@options.common_options
def workspace_command(
    mechanism: Mechanism, params: tuple[str, ...], threads: int | None, scheduler: str | None,
    out: Path | None, force: bool, resume: bool, dry_run: bool, form: str, quiet: bool,
    debug: bool, **values: Any,
) -> None:  # fmt: skip
    """Volume, dexterity (LCI, GCI, regions) and shape of a workspace, each with its error.

    \b
    Example:
      pmopt workspace 2pauu-ppap --params m=1,n=0.7,l1=0.65,l2=1.5,c=0.1
    """
    from pmopt.analysis.validation import validated
    from pmopt.analysis.workspace.shape import DEFAULT_GRIDS, check_cells
    from pmopt.execution.cluster import connect
    from pmopt.reporting.runs import workspace_run
    from pmopt.reporting.runs.tasks import WorkspaceTask
    from pmopt.reporting.tables.workspace import workspace_data, workspace_tables

    given = given_options(WorkspaceSettings, values, mechanism)
    own = given_options(WorkspaceConfig, values, mechanism)
    bounds = given_options(VolumeSettings, values, mechanism)
    proof = {name: bounds[name] for name in _PROOF if name in bounds}
    settings = validated(WorkspaceSettings, given, "workspace")
    if "gap" in proof:
        sampled = [k for k, f in WorkspaceSettings.model_fields.items() if SAMPLING in f.metadata]
        unused = {k: given[k] for k in (*sampled, "regions") if k in given}
        unused |= {k: v for k, v in own.items() if (k, v) != ("seed", DEFAULT_SEED)}
        unused |= {k: v for k, v in (("dry_run", dry_run), ("resume", resume),
                                     ("scheduler", scheduler)) if v}  # fmt: skip
        for name in unused:
            option = f"--{name.replace('_', '-')}"
            raise InputError(f"{option}: not together with --certify, which samples nothing")
        _certify(
            mechanism, options.design_parameters(mechanism, params), settings, proof,
            out, force, form, quiet,
        )  # fmt: skip
        return
    for name in proof:
        raise InputError(f"{option_name(VolumeSettings, name)}: only together with --certify")
    dimension, shape_grid = len(mechanism.pose), own.get("shape_grid")
    cells = DEFAULT_GRIDS[dimension] if shape_grid is None else shape_grid
    task = WorkspaceTask(
        mechanism,
        options.design_parameters(mechanism, params),
        settings,
        own.get("seed", DEFAULT_SEED),
        check_cells(cells, dimension, "--shape-grid"),
    )
    notify = notifier(quiet)
    if dry_run:
        plan = workspace_run.plan(task, threads, notify)
        emit(form, plan.to_dict(), [plan.table()])
        return
    options.check_resume(resume, force, out)
    if out is not None:
        if resume and workspace_run.finished(task, out):
            notify(f"{out} holds this run, finished: nothing to do")
            return
        options.set_resume_hint(f"; continue with: {options.resuming()}")
    with (
        connect(scheduler, notify) as cluster,
        progress_bar(quiet, f"workspace {mechanism.name}", "points") as progress,
    ):
        result = workspace_run.run_workspace(
            task, out, force=force, resume=resume, threads=threads, notify=notify,
            progress=progress, cluster=cluster,
        )  # fmt: skip
    emit(
        form, result.to_dict(), workspace_tables(result), [workspace_data(result)]
    )  # fmt: skip
    if out is not None:
        notify(f"written to {out}")


def _certify(
    mechanism: Mechanism, parameters: Parameters, settings: WorkspaceSettings,
    proof: Mapping[str, Any], out: Path | None, force: bool, form: str, quiet: bool,
) -> None:  # fmt: skip
    from pmopt.analysis.workspace.emptiness import nothing_reachable
    from pmopt.reporting.runs import certify_run

    notify = notifier(quiet)
    budgets = certify_run.Budgets(proof.get("time_budget"), proof.get("box_budget"))
    result = certify_run.run_volume(
        mechanism, parameters, settings, proof["gap"], budgets, out, force=force,
        notify=notify,
    )  # fmt: skip
    emit(
        form, result.to_dict(), certify_run.volume_tables(result),
        certify_run.certified_data(result),
    )  # fmt: skip
    if out is not None:
        notify(f"written to {out}")
    if result.empty:
        raise nothing_reachable(mechanism, parameters, settings, "workspace")

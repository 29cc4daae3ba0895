"""``pmopt singularities``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pmopt.analysis.settings import DEFAULT_SEED, SingularitySettings
from pmopt.cli import options
from pmopt.cli.fields import Sectioned, given_options, options_of
from pmopt.cli.output import emit, notifier
from pmopt.errors import InputError
from pmopt.mechanisms import Mechanism


@click.command("singularities", cls=Sectioned)
@options.mechanism_argument
@options.params_option
@options_of(SingularitySettings)
@click.option(
    "--path",
    type=options.Place(),
    metavar="FILE.csv",
    help="Instead of a survey: where a path of poses, with times in a column t if any, crosses "
    "singularities.",
)
@options.threads_option
@options.out_options
@options.common_options
def singularities_command(
    mechanism: Mechanism, params: tuple[str, ...], path: Path | None, threads: int | None,
    out: Path | None, force: bool, form: str, quiet: bool, debug: bool, **values: Any,
) -> None:  # fmt: skip
    """Singularities over a workspace: families, walls around home, aspects and their volumes.

    \b
    Example:
      pmopt singularities 3-ups-sp --params kite=0.6,twist=0.6
    """
    from pmopt.analysis.singularities.survey import READS
    from pmopt.reporting.runs import singularity_run
    from pmopt.reporting.runs.tasks import WorkspaceTask

    given = given_options(SingularitySettings, values, mechanism)
    if path is not None:
        unused = {k: v for k, v in given.items() if (k, v) != ("seed", DEFAULT_SEED)}
        for name in (*unused, *(["out"] if out else [])):
            if name != "working_mode":
                raise InputError(f"--{name.replace('_', '-')}: not together with --path")
        _follow(path, mechanism, params, given.get("working_mode"), form, quiet)
        return
    settings = READS.settings(given, "singularities")
    task = WorkspaceTask(
        mechanism, options.design_parameters(mechanism, params), settings.of_workspace(),
        settings.seed, settings.grid or 0,
    )  # fmt: skip
    notify = notifier(quiet)
    result = singularity_run.run_singularities(
        task, out, force=force, threads=threads, notify=notify
    )
    emit(
        form, result.to_dict(), singularity_run.singularity_tables(result),
        singularity_run.singularity_data(result),
    )  # fmt: skip
    if out is not None:
        notify(f"written to {out}")


def _follow(
    path: Path, mechanism: Mechanism, params: tuple[str, ...], working_mode: str | None, form: str,
    quiet: bool,
) -> None:  # fmt: skip
    from pmopt.analysis.kinematics.pose_rows import read_rows
    from pmopt.analysis.singularities.crossings import follow_path
    from pmopt.reporting.runs.singularity_run import path_tables

    rows = read_rows(path, "--path", mechanism, mechanism.pose)
    for note in rows.notes:
        notifier(quiet)(note)
    result = follow_path(
        mechanism,
        options.design_parameters(mechanism, params),
        rows.poses(),
        None if rows.times is None else rows.times.tolist(),
        mechanism.check_mode(working_mode, "--working-mode"),
        where=f"--path: {path}",
        rows=rows.lines.tolist(),
    )
    emit(form, result.to_dict(), path_tables(result))

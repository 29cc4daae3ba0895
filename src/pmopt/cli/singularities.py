"""``pmopt singularities``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pmopt.cli import options
from pmopt.cli.output import emit, notifier
from pmopt.errors import InputError
from pmopt.mechanisms import Mechanism


@click.command("singularities")
@options.mechanism_argument
@options.params_option
@click.option(
    "--samples",
    type=options.Count(),
    metavar="N",
    help="Sample points behind the volumes of aspects. Default: 262144.",
)
@click.option(
    "--grid",
    type=click.IntRange(4, 400),
    metavar="N",
    help="Cells an axis on which aspects are told apart.",
)
@options.seed_option
@click.option("--working-mode", metavar="MODE", help="See pmopt info MECH. Default: its first.")
@options.jacobian_options[0]
@options.jacobian_options[1]
@click.option(
    "--domain",
    multiple=True,
    metavar="COORD=LOWER:UPPER,..",
    help="Bounds on pose coordinates; inf is allowed.",
)
@click.option("--limits", multiple=True, metavar="JOINT=LOWER:UPPER,..", help="Bounds on joints.")
@click.option(
    "--path",
    type=options.Place(),
    metavar="FILE.csv",
    help="Instead: where a path of poses, with a column t if there are times, crosses "
    "singularities.",
)
@options.threads_option
@options.out_options
@options.common_options
def singularities_command(
    mechanism: Mechanism, params: tuple[str, ...], samples: int | None, grid: int | None, seed: int,
    working_mode: str | None, kind: str | None, characteristic_length: float | str | None,
    domain: tuple[str, ...], limits: tuple[str, ...], path: Path | None, threads: int | None,
    out: Path | None, force: bool, form: str, quiet: bool, debug: bool,
) -> None:  # fmt: skip
    """Singularities over a workspace: families, walls around home, aspects and their volumes.

    \b
    Example:
      pmopt singularities 3-ups-sp --params kite=0.6,twist=0.6
    """
    from pmopt.analysis.settings import WorkspaceSettings
    from pmopt.analysis.validation import validated
    from pmopt.analysis.workspace.compute import DEFAULT_SEED
    from pmopt.reporting.runs import singularity_run
    from pmopt.reporting.runs.tasks import WorkspaceTask

    given: dict[str, Any] = {
        "samples": samples,
        "working_mode": working_mode,
        "jacobian": kind,
        "characteristic_length": characteristic_length,
        "domain": options.parse_ranges(domain, "--domain", mechanism),
        "limits": options.parse_ranges(limits, "--limits", mechanism),
    }
    if path is not None:
        unused = {"samples": samples, "grid": grid, "domain": domain, "limits": limits, "out": out,
                  "seed": seed - DEFAULT_SEED,
                  "jacobian": kind, "characteristic-length": characteristic_length}  # fmt: skip
        for name, value in unused.items():
            if value:
                raise InputError(f"--{name}: not together with --path")
        _follow(path, mechanism, params, working_mode, form, quiet)
        return
    settings = validated(
        WorkspaceSettings, {k: v for k, v in given.items() if v is not None}, "singularities"
    )
    task = WorkspaceTask(
        mechanism, options.design_parameters(mechanism, params), settings, seed, grid or 0
    )
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

"""``pmopt capability``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pmopt.analysis.settings import CapabilityWorkspace, TaskSettings
from pmopt.cli import options
from pmopt.cli.fields import Sectioned, given_options, options_of
from pmopt.cli.output import emit, notifier
from pmopt.mechanisms import Mechanism


@click.command("capability", cls=Sectioned)
@options.mechanism_argument
@options.params_option
@options_of(TaskSettings)
@options_of(CapabilityWorkspace)
@options.threads_option
@options.out_options
@options.common_options
def capability_command(
    mechanism: Mechanism, params: tuple[str, ...], threads: int | None, out: Path | None,
    force: bool, form: str, quiet: bool, debug: bool, **values: Any,
) -> None:  # fmt: skip
    """Rates and efforts that a payload and a speed ask for, and where given motors suffice.

    \b
    Example:
      pmopt capability 2pauu-ppap --payload 2 --speed 1 --motors theta1_effort=300,theta1_rate=6
    """
    from pmopt.analysis.sizing.actuators import READS, SIZES, Task, check_limits, check_payload
    from pmopt.analysis.validation import validated
    from pmopt.mechanisms.bodies import point_mass
    from pmopt.reporting.runs import capability_run

    task = validated(TaskSettings, given_options(TaskSettings, values, mechanism), "capability")
    check_payload(task.payload, task.payload_centre, "--payload-centre")
    load = point_mass(task.payload, task.payload_centre) if task.payload else None
    settings = READS.settings(given_options(CapabilityWorkspace, values, mechanism), "capability")
    motors = check_limits(mechanism, task.motors, "--motors")
    notify = notifier(quiet)
    asked = capability_run.CapabilityTask(
        mechanism,
        options.design_parameters(mechanism, params),
        settings.of_workspace(),
        Task(**{name: getattr(task, name) for name in SIZES}, payload=load),
        motors,
        task.samples,
        task.seed,
    )
    result = capability_run.run_capability(asked, out, force=force, threads=threads, notify=notify)
    emit(
        form, result.to_dict(), capability_run.capability_tables(result),
        capability_run.capability_data(result),
    )  # fmt: skip
    if out is not None:
        notify(f"written to {out}")

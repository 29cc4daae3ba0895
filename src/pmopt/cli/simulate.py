"""``pmopt simulate``."""

from __future__ import annotations

from pathlib import Path

import click

from pmopt.cli import options
from pmopt.cli.output import emit, notifier, progress_bar

EXIT_UNVERIFIED = 4


@click.command("simulate")
@click.argument("config", type=click.Path(path_type=Path), metavar="CONFIG.toml")
@options.config_options
@options.threads_option
@options.out_options
@options.common_options
def simulate_command(
    config: Path, sets: tuple[str, ...],
    threads: int | None, out: Path | None, force: bool, form: str, quiet: bool,
    debug: bool,
) -> int:  # fmt: skip
    """Run a motion on an independent multibody engine and compare the two.

    The inverse dynamics are compared at every instant and, with a [controller], the forward
    dynamics under feed-forward and PID. --format csv prints the series. The exit code is 4 where
    the inverse dynamics differ by more than [engine] tolerance, 0.01 % of a joint's peak.

    \b
    Example:
      pmopt simulate configs/motion/2uu-upu-t1.toml --out outputs/t1-mujoco
    """
    from pmopt.analysis.motion.config import load_motion
    from pmopt.reporting.runs import simulate_run

    task = load_motion(config, sets)
    options.say_unusual(task.mechanism.beyond_bounds(task.parameters, str(config)))
    notify = notifier(quiet)
    with progress_bar(quiet, f"simulate {task.mechanism.name}", "holds") as progress:
        run = simulate_run.run_simulation(
            task, out, force=force, threads=threads, notify=notify, progress=progress
        )
    table = simulate_run.series_table(run) if form == "csv" else simulate_run.summary_table(run)
    emit(form, run.to_dict(), [table])
    if out is not None:
        notify(f"written to {out}")
    complaint = run.complaint()
    if complaint is None:
        return 0
    click.echo(complaint, err=True)
    return EXIT_UNVERIFIED

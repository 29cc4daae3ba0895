"""``pmopt motion``."""

from __future__ import annotations

from pathlib import Path

import click

from pmopt.cli import options
from pmopt.cli.output import emit, notifier, progress_bar
from pmopt.errors import InputError


@click.command("motion")
@click.argument("config", type=click.Path(path_type=Path), metavar="CONFIG.toml")
@options.config_options
@click.option(
    "--animate",
    type=click.Path(path_type=Path),
    metavar="FILE.gif|.mp4",
    help="The moving mechanism in real time; .mp4 needs ffmpeg.",
)
@click.option("--fps", type=float, metavar="N", help="Frames a second of --animate. Default: 20.")
@options.threads_option
@options.out_options
@options.common_options
def motion_command(
    config: Path, sets: tuple[str, ...],
    animate: Path | None, fps: float | None, threads: int | None,
    out: Path | None, force: bool, form: str, quiet: bool, debug: bool,
) -> None:  # fmt: skip
    """Joint positions, rates, accelerations, efforts and power along a trajectory.

    The table shows what the motion asks of each actuator; --format csv prints the motion itself.
    A motion that is out of reach, singular or beyond a limit ends with exit code 2 and the spans
    of time where it is.

    \b
    Example:
      pmopt motion configs/motion/2uu-upu-t1.toml --out outputs/t1
    """
    from pmopt.analysis.motion.config import load_motion
    from pmopt.reporting.pictures.gallery import wanted
    from pmopt.reporting.runs import motion_run
    from pmopt.reporting.tables.streams import csv_pieces
    from pmopt.storage.files import write_atomic

    task = load_motion(config, sets)
    options.say_unusual(task.mechanism.beyond_bounds(task.parameters, str(config)))
    if animate is not None:
        from pmopt.reporting.pictures import animation

        rate = animation.DEFAULT_FPS if fps is None else fps
        animation.check_animation(animate, rate, force)
    elif fps is not None:
        raise InputError("--fps: only together with --animate")
    notify = notifier(quiet)
    run = motion_run.run_motion(task, out, force=force, threads=threads, notify=notify)
    if form != "table":  # where they stand below it
        for note in run.planned.notes:
            notify(note)
    if form == "csv" and not run.infeasible:
        for text in csv_pieces(motion_run.motion_tables_of(run)):
            click.echo(text, nl=False)
    else:
        emit(form, run.to_dict(), motion_run.motion_tables(run))
    if run.infeasible:
        raise InputError(run.complaint())
    if out is not None:
        notify(f"written to {out}")
    if animate is not None:  # last: what cannot be drawn costs no number
        with (
            wanted(str(animate)),
            progress_bar(quiet, f"frames {task.mechanism.name}", "frames") as progress,
        ):
            picture = animation.animate(
                task.mechanism, run.motion, animate, rate, progress, task.config.gravity
            )
        write_atomic(animate, picture)
        notify(f"written to {animate}")

"""``pmopt pareto``."""

from __future__ import annotations

import shlex
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pmopt.cli import options
from pmopt.cli.output import emit, notifier, progress_bar
from pmopt.mechanisms import find

if TYPE_CHECKING:
    from pmopt.reporting.runs.pareto_run import OnGeneration, OnMeasured
    from pmopt.synthesis.config import RunConfig
    from pmopt.synthesis.optimise import Generation


@click.command("pareto")
@click.argument("config", type=options.Place(), metavar="CONFIG.toml")
@options.config_options
@options.out_options
@options.resume_option
@options.threads_option
@options.scheduler_option
@click.option(
    "--seed", type=click.IntRange(min=0, max=2**63 - 1), help="Instead of the configuration's seed."
)
@click.option("--dry-run", is_flag=True, help="Say what would be run and how long it takes.")
@options.common_options
def pareto_command(
    config: Path, sets: tuple[str, ...],
    out: Path | None, force: bool, resume: bool, threads: int | None,
    scheduler: str | None, seed: int | None, dry_run: bool, form: str, quiet: bool, debug: bool,
) -> None:  # fmt: skip
    """Pareto front of volume against dexterity by NSGA-II.

    \b
    Example:
      pmopt pareto configs/quickstart.toml --out outputs/quickstart
    """
    from pmopt.execution.cluster import connect
    from pmopt.reporting.runs import pareto_run, run_folder
    from pmopt.reporting.tables.front import pareto_tables
    from pmopt.synthesis.config import load_config

    run_config = load_config(config, sets)
    options.say_unusual(
        find(run_config.mechanism).beyond_bounds(run_config.parameters, str(config))
    )
    if seed is not None:
        algorithm = run_config.algorithm.model_copy(update={"seed": seed})
        run_config = run_config.model_copy(update={"algorithm": algorithm})
    notify = notifier(quiet)
    if dry_run:
        plan = pareto_run.plan(run_config, threads, notify)
        emit(form, plan.to_dict(), [plan.table()])
        return
    options.check_resume(resume, force, out)
    if out is None:
        out = run_folder.default_folder("pareto", run_config.mechanism)
    if resume and pareto_run.finished(run_config, out):
        notify(f"{out} holds this run, finished: nothing to do")
        return
    again = ["pmopt", "pareto", str(config), "--out", str(out), "--resume"]
    again += [word for text in sets for word in ("--set", text)]
    again += [] if seed is None else ["--seed", str(seed)]
    options.set_resume_hint(f"; continue with: {shlex.join(again)}")
    with (
        connect(scheduler, notify) as cluster,
        _progress(quiet, run_config) as (on_generation, on_measured),
    ):
        run = pareto_run.run_pareto(
            run_config, out, force=force, resume=resume, threads=threads, notify=notify,
            on_generation=on_generation, on_measured=on_measured, cluster=cluster,
        )  # fmt: skip
    emit(form, run.to_dict(), pareto_tables(run), [run.front_rows()])


@contextmanager
def _progress(quiet: bool, config: RunConfig) -> Iterator[tuple[OnGeneration, OnMeasured]]:
    """Show generation, front size, hypervolume and time left: a bar, or a line now and then."""
    from pmopt.synthesis.objectives import objective_units
    from pmopt.units import product_unit

    planned = config.algorithm.generations
    units = objective_units(find(config.mechanism))
    unit = product_unit(units[name] for name in config.objectives)
    first: tuple[int, float] | None = None  # first generation computed here, and when

    with progress_bar(quiet, "generation", "gen") as report:

        def on_generation(generation: Generation) -> None:
            nonlocal first
            if generation.recorded:
                return
            number, now = generation.number, time.monotonic()
            first = first or (number, now)
            state = f"front {generation.front}, hypervolume {generation.hypervolume:.6g} {unit}"
            if report is not None:
                report(number, planned, f"generation {number}/{planned}, {state}")
            elif not quiet and (number % max(1, planned // 10) == 0 or number == planned):
                left = (now - first[1]) / max(number - first[0], 1) * (planned - number)
                text = f"generation {number}/{planned}: {state}, ETA {left:.0f} s"
                click.echo(text, err=True)

        def on_measured(done: int, count: int) -> None:
            if report is not None:
                text = f"design {done}/{count}, measuring the front"
                report(done, count, text, "designs")
            elif not quiet and done == count:
                click.echo(f"measured the front: {count} designs", err=True)

        yield on_generation, on_measured

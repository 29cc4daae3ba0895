"""``pmopt batch``."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pmopt.cli import options
from pmopt.cli.main import EXIT_INFEASIBLE, EXIT_RUNTIME
from pmopt.cli.output import Pace, emit, notifier, progress_column
from pmopt.errors import InputError

if TYPE_CHECKING:
    from pmopt.reporting.batch.run import Batch
    from pmopt.reporting.batch.summary import BatchResult, RunSummary

#: Most runs at work that the live view names.
_NAMED = 8
#: Names are filled up to the longest, at most this.
_LONGEST = 24


@click.command("batch")
@click.argument("configs", nargs=-1, required=True, metavar="CONFIG..")
@click.option(
    "--set", "sets", multiple=True, metavar="KEY=VALUE",
    help="Replace a value of the files; a list 0.8,1.1 or a range 0.8:1.4:0.3 of values is a "
    "sweep; repeatable.",
)  # fmt: skip
@options.out_options
@click.option(
    "--resume",
    is_flag=True,
    help="Continue the batch in --out; the same --out alone does so too.",
)
@click.option(
    "--workers",
    type=click.IntRange(1, 4096),
    metavar="N",
    help="Processes, one thread each. Default: $NUMBA_NUM_THREADS or all cores; for fewer runs "
    "than that, 1 with all threads.",
)
@options.scheduler_option
@options.threads_option
@click.option("--shard", metavar="K/N", help="Run only part K of N: every N-th run, from the K-th.")
@click.option("--merge", is_flag=True,
              help="CONFIG.. are the folders of shards: one summary of them all.")  # fmt: skip
@click.option("--dry-run", is_flag=True, help="Say what would be run and how long it takes.")
@options.common_options
def batch_command(
    configs: tuple[str, ...], sets: tuple[str, ...],
    out: Path | None, force: bool, resume: bool, workers: int | None,
    scheduler: str | None, threads: int | None, shard: str | None, merge: bool, dry_run: bool,
    form: str, quiet: bool, debug: bool,
) -> int:  # fmt: skip
    """Many runs, each in its own folder, and a summary of them all.

    CONFIG is a file, or a glob in quotes. Its key command is pareto, workspace or motion; without
    it, a file with [trajectory] is a motion, any other a search. Its table [sweep] makes a grid
    of it: "parameters.l1" = [0.5, 0.6] runs it with each value, several keys with every
    combination.

    \b
    Example:
      pmopt batch configs/batch/links.toml --out outputs/links

    Run again with the same --out to do the runs that are not done yet. On several machines without
    a common cluster, each runs one shard; any of them then merges the folders:

    \b
      pmopt batch 'configs/*.toml' --shard 2/5 --out shard-2
      pmopt batch --merge shard-1 shard-2 shard-3 shard-4 shard-5 --out all
    """
    from pmopt.reporting.batch import run as batch_run
    from pmopt.reporting.batch import shards
    from pmopt.reporting.batch.plan import find_configs, parse_shard, plan_runs
    from pmopt.reporting.runs import run_folder

    notify = notifier(quiet)
    if merge:
        given = {"--workers": workers, "--scheduler": scheduler, "--threads": threads,
                 "--shard": shard, "--set": sets or None, "--dry-run": dry_run or None,
                 "--resume": resume or None}  # fmt: skip
        for name, value in given.items():
            if value is not None:
                raise InputError(f"{name}: not together with --merge, which runs nothing")
        folders = [Path(config) for config in configs]
        return _tell(shards.merge(folders, out or run_folder.default_folder("batch"), force), form)
    options.check_resume(resume, force, out)
    part = None if shard is None else parse_shard(shard)
    runs = plan_runs(find_configs(configs), sets)
    batch = batch_run.Batch(runs, out or run_folder.default_folder("batch"), part)
    batch.check(force)
    share = batch_run.shares(len(batch.own), workers, threads, scheduler)
    if dry_run:
        with share.pool(notify) as pool:
            plan = batch.plan(pool.threads, force, notify)
        emit(form, plan.to_dict(), [plan.table()])
        return 0
    if resume and batch.finished():
        notify(f"{batch.folder} holds this batch, finished: nothing to do")
        return 0
    folder = "" if out else f" --out {shlex.quote(str(batch.folder))}"
    options.set_resume_hint(f"; continue with: {options.resuming()}{folder}")
    with share.pool(notify) as pool, _progress(quiet, batch, force) as (on_done, tick):
        result = batch.run(
            pool, force=force, threads=share.threads, notify=notify, on_done=on_done, tick=tick
        )
    return _tell(result, form)


def _tell(result: BatchResult, form: str) -> int:
    emit(form, result.to_dict(), result.tables(), [result.table()])
    if result.infeasible:
        return EXIT_INFEASIBLE
    return 0 if result.complete else EXIT_RUNTIME


@contextmanager
def _progress(
    quiet: bool, batch: Batch, force: bool
) -> Iterator[tuple[Callable[[RunSummary], None], Callable[[list[str]], None]]]:
    """Show what is done and what is at work: bars on a terminal, else a line as each run ends."""
    count = len(batch.own)
    done = count - len(batch.todo(force))

    if quiet or not sys.stderr.isatty():

        def on_done(run: RunSummary) -> None:
            nonlocal done
            done += 1
            if not quiet:
                click.echo(f"[{done}/{count}] {run.headline}", err=True)

        yield on_done, lambda names: None
        return
    from rich.console import Console
    from rich.progress import Progress, TaskID

    by_name = {run.name: run for run in batch.own}
    bars: dict[str, tuple[TaskID, Pace]] = {}
    pace = Pace("runs")
    pace.note(done)
    names = [f"{count} of {count} runs", *by_name]
    room = min(_LONGEST, max(map(len, names)))  # so that the bars stand below each other
    with Progress(
        progress_column(), console=Console(file=sys.stderr), transient=True, expand=True
    ) as progress:
        whole = progress.add_task(
            f"{done} of {count} runs".ljust(room), total=count, completed=done, pace=pace
        )  # fmt: skip

        def on_done_live(run: RunSummary) -> None:
            nonlocal done
            done += 1
            pace.note(done)
            progress.update(whole, advance=1, description=f"{done} of {count} runs".ljust(room))
            progress.console.print(run.headline, markup=False, highlight=False, soft_wrap=True)

        def tick(names: list[str]) -> None:
            for name in [name for name in bars if name not in names]:
                progress.remove_task(bars.pop(name)[0])
            for name in names[:_NAMED]:
                if name not in bars:
                    own = Pace("")
                    bars[name] = progress.add_task(name.ljust(room), total=1.0, pace=own), own
                run = by_name[name]
                share = run.runner.done(batch.run_folder(run)) or 0.0
                task, own = bars[name]
                own.note(share)
                progress.update(task, completed=share)

        yield on_done_live, tick

"""``pmopt warmup``."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click

from pmopt.cli import options
from pmopt.cli.output import emit, notifier, progress_bar
from pmopt.mechanisms import names

#: Seconds between two lines of progress, off a terminal.
_EVERY = 10.0


@click.command("warmup")
@click.argument("mechanisms", nargs=-1, metavar="[MECH]..")
@options.threads_option
@options.common_options
def warmup_command(
    mechanisms: tuple[str, ...], threads: int | None, form: str, quiet: bool, debug: bool
) -> None:
    """Compile the kernels of mechanisms (default: all) ahead, on all cores.

    They are compiled once per machine and version; without it the first command that needs a kernel
    takes some seconds more.

    \b
    Example:
      pmopt warmup 2pauu-ppap 3-cur
    """
    from pmopt import api
    from pmopt.reporting.tables.table import Table

    with _progress(quiet) as progress:
        found = api.warmup(
            *(mechanisms or names()), threads=threads, notify=notifier(quiet), progress=progress
        )
    table = Table("Kernels", ("mechanism", "compiled"), tuple(found.items()), {})
    emit(form, {"compiled": found}, [table])


@contextmanager
def _progress(quiet: bool) -> Iterator[Callable[[int, int], None]]:
    """Show how many kernels are compiled: a bar, or a line now and then."""
    said = time.monotonic()
    with progress_bar(quiet, "compiling", "kernels") as report:

        def progress(done: int, planned: int) -> None:
            nonlocal said
            if report is not None:
                report(done, planned, f"compiling, kernel {done}/{planned}")
            elif not quiet and (done == planned or time.monotonic() - said >= _EVERY):
                said = time.monotonic()
                click.echo(f"compiled {done}/{planned} kernels", err=True)

        yield progress

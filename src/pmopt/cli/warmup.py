"""``pmopt warmup``."""

from __future__ import annotations

import click

from pmopt.cli import options
from pmopt.cli.output import emit, notifier
from pmopt.mechanisms import names


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
    from pmopt.reporting.table import Table

    found = api.warmup(*(mechanisms or names()), threads=threads, notify=notifier(quiet))
    table = Table("Kernels", ("mechanism", "compiled"), tuple(found.items()), {})
    emit(form, {"compiled": found}, [table])

"""``pmopt plot``."""

from __future__ import annotations

from pathlib import Path

import click

from pmopt.cli import options
from pmopt.cli.output import emit
from pmopt.files import write_atomic
from pmopt.folder_lock import FolderLock


@click.command("plot")
@click.argument("run", type=options.Place(), metavar="RUN")
@click.option("--out", type=options.Place(), metavar="DIR",
              help="Folder for the pictures. Default: the run's own.")  # fmt: skip
@options.threads_option
@options.common_options
def plot_command(
    run: Path, out: Path | None, threads: int | None, form: str, quiet: bool, debug: bool
) -> None:
    """Draw the pictures of a finished run again, from the files in its folder.

    \b
    Example:
      pmopt plot outputs/quickstart --out pictures
    """
    from pmopt.reporting import pictures
    from pmopt.reporting.table import Table

    folder = out or run
    pictures.manifest_of(run)
    with FolderLock(folder):  # a run that is being written there comes first
        drawn = pictures.of_folder(run, threads)
        for name, data in drawn.items():
            write_atomic(folder / name, data)
    written = [str(folder / name) for name in drawn]
    rows = tuple((path,) for path in written)
    emit(form, {"written": written}, [Table("Written", ("file",), rows, {})])

"""``pmopt plot``."""

from __future__ import annotations

from pathlib import Path

import click

from pmopt.cli import options
from pmopt.cli.output import emit
from pmopt.errors import InputError, PmoptError
from pmopt.inputs.identify import MANIFEST, describe
from pmopt.storage.files import write_atomic
from pmopt.storage.folder_lock import FolderLock


@click.command("plot")
@click.argument("run", type=options.Place(), metavar="RUN")
@click.option("--out", type=options.Place(), metavar="DIR",
              help="Folder for the pictures. Default: the run's own.")  # fmt: skip
@click.option("--picture-format", type=click.Choice(["png", "svg", "pdf"]), default="png",
              show_default=True, help="SVG and PDF are vector pictures.")  # fmt: skip
@options.threads_option
@options.common_options
def plot_command(
    run: Path, out: Path | None, picture_format: str, threads: int | None, form: str, quiet: bool,
    debug: bool,
) -> None:  # fmt: skip
    """Draw the pictures of a finished run again, from the files in its folder.

    \b
    Example:
      pmopt plot outputs/quickstart --out pictures
    """
    from pmopt.reporting.pictures.gallery import lines_of
    from pmopt.reporting.pictures.style import drawn_as
    from pmopt.reporting.runs import run_pictures
    from pmopt.reporting.tables.table import Shown, Table

    if not (run / MANIFEST).is_file():
        what = describe(run) if run.exists() else "no such folder"
        raise InputError(f"{run}: {what}; the folder of a finished run is needed")
    folder = out or run
    run_pictures.manifest_of(run)
    with drawn_as(picture_format), FolderLock(folder):  # a run that is being written there first
        gallery = run_pictures.of_folder(run, threads)

        def named(name: str) -> str:
            return str(Path(name).with_suffix(f".{picture_format}"))

        drawn = {named(name): data for name, data in gallery.items()}
        for name, data in drawn.items():
            write_atomic(folder / name, data)
    written = [str(folder / name) for name in drawn]
    rows = tuple((Shown(path, name),) for path, name in zip(written, drawn, strict=True))
    emit(form, {"written": written}, [Table(f"Written to {folder}", ("file",), rows, {})])
    missing = getattr(gallery, "missing", {})
    if missing:
        raise PmoptError("; ".join(lines_of({named(k): why for k, why in missing.items()})))

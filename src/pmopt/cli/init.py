"""``pmopt init``."""

from __future__ import annotations

from pathlib import Path

import click

from pmopt.cli.options import Place, common_options
from pmopt.cli.output import emit
from pmopt.errors import InputError
from pmopt.files import write_atomic
from pmopt.mechanisms import find
from pmopt.reporting.starting_config import starting_config
from pmopt.reporting.table import Table


@click.command("init")
@click.argument("mechanism", metavar="[MECH]", default="2pauu-ppap")
@click.option("--out", type=Place(), metavar="FILE.toml",
              help="Default: <mechanism>.toml in this folder.")  # fmt: skip
@click.option("--force", is_flag=True, help="Overwrite the file.")
@common_options
def init_command(
    mechanism: str, out: Path | None, force: bool, form: str, quiet: bool, debug: bool
) -> None:
    """Write a commented starting configuration for ``pmopt pareto``.

    \b
    Example:
      pmopt init 2pauu-ppap --out my-design.toml
    """
    found = find(mechanism)
    path = out or Path(f"{found.name}.toml")
    if path.exists() and not force:
        raise InputError(f"--out: {path} exists; another name or --force is needed")
    write_atomic(path, starting_config(found))
    row = (str(path), f"pmopt pareto {path}")
    emit(form, {"written": row[0], "run": row[1]}, [Table("Written", ("file", "run"), (row,), {})])

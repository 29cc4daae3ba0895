"""``pmopt completion``."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from pmopt.cli.options import common_options
from pmopt.cli.output import emit
from pmopt.errors import PmoptError
from pmopt.reporting.tables.table import Table


@click.command("completion")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@common_options
def completion_command(shell: str, form: str, quiet: bool, debug: bool) -> None:
    """Print the script that makes the shell complete pmopt's commands and options.

    \b
    Example:
      pmopt completion bash >> ~/.bashrc
    """
    from pmopt.cli.commands import cli

    script_class = get_completion_class(shell)
    if script_class is None:  # pragma: no cover - click knows the three
        raise PmoptError(f"no completion for {shell}")
    script = script_class(cli, {}, "pmopt", "_PMOPT_COMPLETE").source()
    if form == "table":
        click.echo(script)
    else:
        table = Table("", ("shell", "script"), ((shell, script),), {})
        emit(form, {"shell": shell, "script": script}, [table])

"""What goes to stdout and stderr."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import click

from pmopt.reporting.table import Table, shown, to_csv, to_json


def emit(form: str, document: Any, tables: Sequence[Table]) -> None:
    """Print a result in the form asked for."""
    if form == "json":
        click.echo(to_json(document))
    elif form == "csv":
        click.echo(to_csv(tables))
    else:
        _print_tables(tables)


def _print_tables(tables: Sequence[Table]) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    terminal = sys.stdout.isatty()
    console = Console(
        file=sys.stdout, highlight=False, markup=False, width=None if terminal else 200
    )
    for table in tables:
        rich = RichTable(box=box.SIMPLE_HEAD if terminal else box.ASCII2)
        for index, head in enumerate(table.heads()):
            numeric = all(not isinstance(r[index], str) or _numeric(r[index]) for r in table.rows)
            rich.add_column(Text(head), justify="right" if numeric else "left", overflow="fold")
        for row in table.display or table.rows:
            rich.add_row(*(Text(shown(cell)) for cell in row))
        console.print(Text(table.title, style="bold"))
        console.print(rich)
        for note in table.notes:
            console.print(Text(note))
        console.print()


def _numeric(text: Any) -> bool:
    try:
        float(text)
    except ValueError:
        return bool(text == "-")
    return True


def notifier(quiet: bool) -> Callable[[str], None]:
    """Return a function that says a line on stderr, or nothing under --quiet."""
    return (lambda text: None) if quiet else (lambda text: click.echo(text, err=True))


class Report(Protocol):
    """Takes what is done, what is planned and, if it changes, the text before the bar."""

    def __call__(self, done: int, planned: int, text: str | None = None) -> None: ...


@contextmanager
def progress_bar(quiet: bool, label: str, unit: str) -> Iterator[Report | None]:
    """Show a bar with rate and time left on stderr; None under --quiet and off a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Any) -> Text:
            speed = task.finished_speed or task.speed
            return Text("" if speed is None else f"{_short(speed)}{unit}/s")

    with Progress(
        TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
        Rate(), TextColumn("ETA"), TimeRemainingColumn(),
        console=Console(file=sys.stderr), transient=True,
    ) as progress:  # fmt: skip
        task = progress.add_task(label, total=None)

        def report(done: int, planned: int, text: str | None = None) -> None:
            progress.update(task, completed=done, total=planned, description=text)

        yield report


def _short(value: float) -> str:
    for size, suffix in ((1e9, " G"), (1e6, " M"), (1e3, " k")):
        if value >= size:
            return f"{value / size:.3g}{suffix}"
    return f"{value:.3g} "

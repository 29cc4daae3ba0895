"""What goes to stdout and stderr."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol, TextIO

import click

from pmopt.cli.encoding import writable
from pmopt.reporting.tables.layout import Style, lay_out, width_of, wrap
from pmopt.reporting.tables.table import Table, to_csv, to_json

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
    from rich.progress import ProgressColumn, Task

#: Bars are this wide, least and most.
_BAR = (8, 40)


def emit(
    form: str, document: Any, tables: Sequence[Table], data: Sequence[Table] | None = None
) -> None:
    """Print a result in the form asked for; ``data`` are the tables of CSV where they differ."""
    if form == "json":
        click.echo(to_json(document))
    elif form == "csv":
        click.echo(to_csv(tables if data is None else data))
    else:
        _print_tables(tables)


def room() -> int | None:
    """Return the width of stdout: $COLUMNS, else the terminal's; None, any, where it is none."""
    return _width(sys.stdout) or (80 if sys.stdout.isatty() else None)


def _width(stream: TextIO) -> int:
    """Return the width that $COLUMNS or the terminal of a stream gives, 0 without."""
    given = os.environ.get("COLUMNS", "")
    if given.isdigit() and int(given) > 0:
        return int(given)
    try:
        return os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError):
        return 0


def _print_tables(tables: Sequence[Table]) -> None:
    terminal, width = sys.stdout.isatty(), room()
    style = Style(framed=not terminal)
    for table in tables:
        for line in wrap(table.title, width):
            _say(click.style(line, bold=True))
        body = lay_out(table, width, style)
        _say(*body or (() if table.notes else ("none",)))
        for note in table.notes:
            _say(*wrap(note, width, "  "))
        _say("")


def _say(*lines: str) -> None:
    """Print lines in what characters stdout can write; click has a way of its own with ASCII."""
    for line in lines:
        click.echo(writable(line))


def notifier(quiet: bool) -> Callable[[str], None]:
    """Return a function that says a line on stderr, or nothing under --quiet."""
    return (lambda text: None) if quiet else (lambda text: click.echo(text, err=True))


class Report(Protocol):
    """Takes the amounts done and planned and, if they change, the text before them and the unit.

    Parts of the text behind commas give way where there is no room. With another unit another
    count begins.
    """

    def __call__(
        self, done: float, planned: float, text: str | None = None, unit: str | None = None
    ) -> None: ...


@contextmanager
def progress_bar(quiet: bool, label: str, unit: str) -> Iterator[Report | None]:
    """Show a bar with rate and time left on stderr; None under --quiet and off a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(
        progress_column(), console=Console(file=sys.stderr), transient=True, expand=True
    ) as progress:
        task = progress.add_task(label, total=None, pace=Pace(unit))

        def report(
            done: float, planned: float, text: str | None = None, unit: str | None = None
        ) -> None:
            pace: Pace = progress.tasks[0].fields["pace"]
            if unit is not None and unit != pace.unit:
                pace = Pace(unit)
            pace.note(done)
            progress.update(task, completed=done, total=planned, description=text, pace=pace)

        yield report


class Pace:
    """How fast something is done, over all of the time since the first count.

    Parameters
    ----------
    unit : str
        What is counted; "" has no rate.
    """

    def __init__(self, unit: str) -> None:
        self.unit = unit
        self._first: tuple[float, float] | None = None
        self._last = (0.0, 0.0)

    def note(self, done: float) -> None:
        """Note what is done now."""
        self._last = time.monotonic(), done
        self._first = self._first or self._last

    @property
    def speed(self) -> float | None:
        """In units a second; None while it is not known."""
        if self._first is None:
            return None
        seconds, count = (b - a for a, b in zip(self._first, self._last, strict=True))
        return count / seconds if seconds > 0 and count > 0 else None

    def rate(self) -> str:
        """Return it in words; slow paces by the minute or hour."""
        speed = self.speed
        if speed is None or not self.unit:
            return ""
        seconds, name = 3600, "h"
        if speed * 60 >= 1:
            seconds, name = (1, "s") if speed >= 1 else (60, "min")
        return f"{_short(speed * seconds)}{self.unit}/{name}"

    def left(self, planned: float | None) -> str:
        """Return the planned time left, less the time since the last count."""
        speed, (when, done) = self.speed, self._last
        if planned is not None and done >= planned:
            return "ETA 0:00:00"
        if speed is None or planned is None:
            return "ETA -:--:--"
        seconds = max(0, round((planned - done) / speed - (time.monotonic() - when)))
        return f"ETA {seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}"


def progress_column() -> ProgressColumn:
    """Return a column of rich's progress that is the whole line of a task with a ``pace``.

    Text before the bar gives way first, then the bar; rate and time left never do.
    """
    from rich.measure import Measurement
    from rich.progress import ProgressColumn
    from rich.progress_bar import ProgressBar
    from rich.table import Table as Grid
    from rich.text import Text

    class Line:
        """The line of a task, composed for the room that it is given."""

        def __init__(self, task: Task) -> None:
            self.task = task

        def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
            return Measurement(options.max_width, options.max_width)

        def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
            task, pace = self.task, self.task.fields["pace"]
            share = f"{task.percentage:>3.0f} %" if task.total is not None else "    %"
            ending = " ".join(filter(None, (share, pace.rate(), pace.left(task.total))))
            text, bar = fitted(task.description, len(ending), options.max_width)
            grid = Grid.grid(padding=(0, 1, 0, 0))
            grid.add_row(
                Text(text, no_wrap=True),
                ProgressBar(
                    total=task.total, completed=task.completed, width=bar, pulse=task.total is None
                ),
                Text(ending, no_wrap=True),
            )
            yield grid

    class Column(ProgressColumn):
        def render(self, task: Task) -> RenderableType:
            return Line(task)

    return Column()


def fitted(text: str, ending: int, width: int) -> tuple[str, int]:
    """Return a text and the width of a bar, so that both and an ending fit into a line.

    Of the text the parts behind commas give way, then its last words, then its end.
    """
    left = width - ending - 3  # a space behind each, and one that no terminal wraps at
    room = max(left - _BAR[0], 0)
    for break_ in (", ", " "):
        while width_of(text.rstrip()) > room and break_ in text.rstrip():
            text = text.rstrip().rpartition(break_)[0]
    if width_of(text.rstrip()) > room:
        while width_of(text) >= max(room, 1):
            text = text[:-1]
        text += "…" * (room > 0)
    if width_of(text) > room:  # filled up with spaces
        text = text.rstrip()
    return text, min(max(left - width_of(text), 0), _BAR[1])


def _short(value: float) -> str:
    for size, suffix in ((1e9, " G"), (1e6, " M"), (1e3, " k")):
        if value >= size:
            return f"{value / size:.3g}{suffix}"
    return f"{value:.3g} "

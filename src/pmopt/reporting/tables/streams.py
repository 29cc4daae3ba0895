"""Results of many rows, passed on block by block as they are computed."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from pmopt.errors import InputError
from pmopt.reporting.tables.table import Table, to_csv, to_json
from pmopt.storage.files import writing

Result = TypeVar("Result")

#: Rows of a file that are computed at once.
BLOCK = 512
#: Rows of a table that people are shown.
SHOWN = 20
#: Forms of files by the endings of their names.
_FORMS = {".csv": "csv", ".json": "json"}


def form_of(path: Path, where: str) -> str:
    """Return the form of a file of rows by the ending of its name.

    Raises
    ------
    InputError
    """
    if path.suffix.lower() not in _FORMS:
        raise InputError(f"{where}: {path}: a name that ends with .csv or .json is needed")
    return _FORMS[path.suffix.lower()]


def csv_pieces(tables: Iterable[Table]) -> Iterator[str]:
    """Yield the text of a CSV file of tables that follow each other, under one header."""
    for number, table in enumerate(tables):
        text = to_csv([table]) + "\n"
        yield text.partition("\n")[2] if number else text


class Stream(Generic[Result]):
    """Results in blocks, each computed when it is asked for.

    Parameters
    ----------
    blocks : iterable of list
    table : callable
        ``table(results, first)`` returns some results as a table, the number of the first given.
    document : callable
        Returns the JSON form of a result.
    rows : callable, optional
        Returns the number of rows that a result has in a table, if not one.
    """

    def __init__(
        self,
        blocks: Iterable[list[Result]],
        table: Callable[[list[Result], int], Table],
        document: Callable[[Result], Any],
        rows: Callable[[Result], int] = lambda result: 1,
    ) -> None:
        self._blocks, self._table, self._document, self._rows = blocks, table, document, rows

    def pieces(self, form: str) -> Iterator[tuple[list[Result], str]]:
        """Yield blocks and their text in a form, ``csv`` or ``json``; the texts are one file."""
        count = 0
        for block in self._blocks:
            if form == "csv":
                text = to_csv([self._table(block, count + 1)]) + "\n"
                yield block, text.partition("\n")[2] if count else text
            else:
                items = [textwrap.indent(to_json(self._document(one)), "  ") for one in block]
                yield block, (",\n" if count else "[\n") + ",\n".join(items)
            count += len(block)
        if form == "json":
            yield [], "\n]\n"

    def write(self, path: Path, form: str) -> Stream[Result]:
        """Return a stream of the same results that writes them to a file as they are taken.

        The file is in its place once all are, whole or not at all.
        """
        return Stream(_written(self, path, form), self._table, self._document, self._rows)

    def head(self, title: str, more: str) -> Table:
        """Take all results and return the first rows as a table.

        Parameters
        ----------
        title : str
            With ``{count}`` for the number of results.
        more : str
            Follows the number of rows that are left out.
        """
        first: Table | None = None
        rows = count = 0
        for block in self._blocks:
            if first is None:
                first = self._table(block, 1)
            elif len(first.rows) < SHOWN:
                table = self._table(block, count + 1)
                first = replace(first, rows=first.rows + table.rows)
            count += len(block)
            rows += sum(map(self._rows, block))
        assert first is not None  # a file without rows is refused
        left = rows - SHOWN
        notes = first.notes if left <= 0 else (*first.notes, f"... {left:,} more rows: {more}")
        return replace(first, title=title.format(count=count), rows=first.rows[:SHOWN], notes=notes)


def _written(stream: Stream[Result], path: Path, form: str) -> Iterator[list[Result]]:
    """Yield the blocks of a stream while they are written to a file."""
    with writing(path) as write:
        for block, text in stream.pieces(form):
            write(text)
            if block:
                yield block

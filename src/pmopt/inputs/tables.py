"""Tables of numbers as users have them: CSV by comma, semicolon or tab, decimal point or comma.

The separator is the one that the header holds, or the one of a line ``sep=``. Where it is no
comma, cells may have a decimal comma. Lines that begin with ``#`` are comments. The unit of a
column may stand in its head: ``x [mm]``, ``x (mm)``, ``x / mm``.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

from pmopt.errors import InputError
from pmopt.inputs.examples import advice
from pmopt.inputs.text import open_lines

_SEPARATORS = (";", "\t", ",")
_NAMES = {";": "semicolon", "\t": "tab", ",": "comma"}
_HEAD = re.compile(r"([^\[(/]*)(?:\[(.*)\]|\((.*)\)|/(.*))?")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*")
_DECIMAL_POINT = re.compile(r"\s*[+-]?\d*\.\d*(?:[eE][+-]?\d+)?\s*")


@dataclass(frozen=True)
class Table:
    """A table of cells.

    Attributes
    ----------
    names : tuple of str
        Of the columns.
    units : tuple of str or None
        As they stand in the heads; None where there is none.
    lines : tuple of int
        The number of each row's line in the file.
    cells : tuple of tuple of str
        Row by row; numbers have a decimal point.
    """

    names: tuple[str, ...]
    units: tuple[str | None, ...]
    lines: tuple[int, ...]
    cells: tuple[tuple[str, ...], ...]

    def column(self, name: str) -> tuple[str, ...]:
        """Return the cells of a column by its name."""
        place = self.names.index(name)
        return tuple(row[place] for row in self.cells)


#: Lines of a file that are read at most.
MAX_LINES = 10_000_000


class Reader:
    """The rows of a table, as often as they are asked for, in little memory.

    Iterating yields the number of a row's line and its cells, numbers with a decimal point.

    Parameters
    ----------
    lines : iterable of str
        That can be iterated again.
    where : str
        What errors call the file.
    columns : sequence of str
        Those that are wanted, for the error of an empty file.

    Attributes
    ----------
    names : tuple of str
        Of the columns.
    units : tuple of str or None
        As they stand in the heads; None where there is none.

    Raises
    ------
    InputError
        Naming the file, and the line of what cannot be read; of rows when they are read.
    """

    def __init__(self, lines: Iterable[str], where: str, columns: Sequence[str] = ()) -> None:
        self._lines, self._where = lines, where
        physical = iter(lines)
        first = next(physical, "")
        self._skipped = 1 if re.fullmatch(r"sep=.\s*", first) else 0
        kept = map(_uncommented, physical if self._skipped else chain([first], physical))
        header = next((line for line in kept if line.strip()), "")
        self._separator = first[4] if self._skipped else _separator(header)
        rows = self._rows()
        head = next(rows, (0, ()))[1]
        if not head or next(rows, None) is None:
            needed = f"; columns needed: {', '.join(columns)}" if columns else ""
            raise InputError(f"{where}: has no rows{needed}")
        while head and not head[-1].strip():  # a separator at the end of every line
            head = head[:-1]
        self.names: tuple[str, ...]
        self.units: tuple[str | None, ...]
        self.names, self.units = zip(
            *(_head(cell, where, self._separator) for cell in head), strict=True
        )
        for name in self.names:
            if self.names.count(name) > 1:
                raise InputError(f"{where}: column {name} is given twice")
        self._comma = self._separator != "," and any(
            _DECIMAL_COMMA.fullmatch(cell) for _, cells in self._body() for cell in cells
        )

    def __iter__(self) -> Iterator[tuple[int, tuple[str, ...]]]:
        """Yield the rows below the head."""
        where, width = self._where, len(self.names)
        for number, cells in self._body():
            while len(cells) > width and not cells[-1].strip():
                cells = cells[:-1]
            if len(cells) != width:
                raise InputError(
                    f"{where}, line {number}: {len(cells)} cells, the header has {width} "
                    f"(separated by {_NAMES.get(self._separator, repr(self._separator))})"
                )
            if self._comma:
                place = f"{where}, line {number}"
                yield number, tuple(_plain(cell, place) for cell in cells)
            else:
                yield number, tuple(map(str.strip, cells))

    def _body(self) -> Iterator[tuple[int, tuple[str, ...]]]:
        return islice(self._rows(), 1, None)

    def _rows(self) -> Iterator[tuple[int, tuple[str, ...]]]:
        """Yield the lines that hold anything, the head's first."""
        # Comments stay as empty lines, so that numbers of lines hold.
        kept = map(_uncommented, islice(self._lines, self._skipped, None))
        reader = csv.reader(kept, delimiter=self._separator)
        try:
            for cells in reader:
                if any(cell.strip() for cell in cells):
                    yield reader.line_num + self._skipped, tuple(cells)
        except csv.Error as error:
            raise InputError(f"{self._where}: is not a CSV file: {error}") from None


@contextmanager
def open_table(path: Path, where: str, columns: Sequence[str] = ()) -> Iterator[Reader]:
    """Open a CSV file.

    Parameters
    ----------
    path, where, columns
        See :class:`Reader`.

    Raises
    ------
    InputError
        Naming the file, and the line of what cannot be read.
    """
    with ExitStack() as stack:
        try:  # all of it is decoded here
            lines = stack.enter_context(open_lines(path, legacy=True))
        except FileNotFoundError:
            raise InputError(f"{where}: no such file{advice(path)}") from None
        except OSError as error:
            raise InputError(f"{where}: cannot read: {error.strerror or error}") from None
        except ValueError as error:
            raise InputError(f"{where}: is not a CSV file: {error}") from None
        if lines.count > MAX_LINES:
            raise InputError(
                f"{where}: {lines.count} lines are not allowed: at most {MAX_LINES} are read"
            )
        yield Reader(lines, where, columns)


def read_table(path: Path, where: str, columns: Sequence[str] = ()) -> Table:
    """Read a CSV file as a whole; see :func:`open_table`."""
    with open_table(path, where, columns) as reader:
        return _whole(reader)


def parse_table(text: str, where: str, columns: Sequence[str] = ()) -> Table:
    """Read a table from text; see :class:`Reader`."""
    return _whole(Reader(text.splitlines(keepends=True), where, columns))


def _whole(reader: Reader) -> Table:
    lines, cells = zip(*reader, strict=True)
    return Table(reader.names, reader.units, lines, cells)


def _uncommented(line: str) -> str:
    return "\n" if line.lstrip().startswith("#") else line


def _separator(header: str) -> str:
    """Return the separator that a header holds; outside of what is quoted."""
    bare = re.sub(r'"[^"]*"', "", header)
    return max(_SEPARATORS, key=bare.count) if any(s in bare for s in _SEPARATORS) else ","


def _head(cell: str, where: str, separator: str) -> tuple[str, str | None]:
    """Return name and unit of a column."""
    match = _HEAD.fullmatch(cell.strip())
    parts = [(part or "").strip() for part in match.groups()] if match else [cell.strip()]
    name, *rest = parts
    unit = next((part for part in rest if part), None)
    if separator == "," and len(name.split()) > 1 and match and unit is None:
        raise InputError(
            f"{where}: the header {cell.strip()!r} is one cell: columns are separated by comma, "
            "semicolon or tab"
        )
    return name, unit


def _plain(cell: str, place: str) -> str:
    """Return a cell of a file with decimal commas with a decimal point."""
    cell = cell.strip()
    if _DECIMAL_COMMA.fullmatch(cell):
        return cell.replace(",", ".")
    if _DECIMAL_POINT.fullmatch(cell):
        raise InputError(f"{place}: {cell}: other cells of the file have a decimal comma")
    return cell

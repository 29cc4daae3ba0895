"""Tables of numbers as people have them: CSV by comma, semicolon or tab, decimal point or comma.

The separator is the one that the header holds, or the one of a line ``sep=``. Where it is no
comma, cells may have a decimal comma. Lines that begin with ``#`` are comments. The unit of a
column may stand in its head: ``x [mm]``, ``x (mm)``, ``x / mm``.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pmopt.errors import InputError
from pmopt.inputs.examples import advice
from pmopt.inputs.text import read_text

#: Largest table, in bytes.
_LARGEST = 1 << 32
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


def read_table(path: Path, where: str, columns: Sequence[str] = ()) -> Table:
    """Read a CSV file.

    Parameters
    ----------
    path : Path
    where : str
        What errors call the file.
    columns : sequence of str
        Those that are wanted, for the error of an empty file.

    Raises
    ------
    InputError
        Naming the file, and the line of what cannot be read.
    """
    try:
        text = read_text(path, legacy=True, largest=_LARGEST)
    except FileNotFoundError:
        raise InputError(f"{where}: no such file{advice(path)}") from None
    except OSError as error:
        raise InputError(f"{where}: cannot read: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(f"{where}: is no CSV file: {error}") from None
    return parse_table(text, where, columns)


def parse_table(text: str, where: str, columns: Sequence[str] = ()) -> Table:
    """Read a table from text; see :func:`read_table`."""
    physical = text.splitlines(keepends=True)
    separator = None
    skipped = 0
    if physical and re.fullmatch(r"sep=.\s*", physical[0]):
        separator, skipped = physical[0][4], 1
    kept = [
        "\n" if line.lstrip().startswith("#") else line for line in physical[skipped:]
    ]  # comments stay as empty lines, so that numbers of lines hold
    header = next((line for line in kept if line.strip()), "")
    if separator is None:
        separator = _separator(header)
    reader = csv.reader(kept, delimiter=separator)
    try:
        rows = [
            (reader.line_num + skipped, tuple(cells))
            for cells in reader
            if any(cell.strip() for cell in cells)
        ]
    except csv.Error as error:
        raise InputError(f"{where}: is no CSV file: {error}") from None
    if len(rows) < 2:
        needed = f"; columns needed: {', '.join(columns)}" if columns else ""
        raise InputError(f"{where}: has no rows{needed}")
    head = rows[0][1]
    while head and not head[-1].strip():  # a separator at the end of every line
        head = head[:-1]
    names, units = zip(*(_head(cell, where, separator) for cell in head), strict=True)
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{where}: column {name} is given twice")
    comma = separator != "," and any(
        _DECIMAL_COMMA.fullmatch(cell) for _, cells in rows[1:] for cell in cells
    )
    lines, body = [], []
    for number, cells in rows[1:]:
        place = f"{where}, line {number}"
        while len(cells) > len(names) and not cells[-1].strip():
            cells = cells[:-1]
        if len(cells) != len(names):
            raise InputError(
                f"{place}: {len(cells)} cells, the header has {len(names)} (separated by "
                f"{_NAMES.get(separator, repr(separator))})"
            )
        lines.append(number)
        body.append(tuple(_plain(cell, comma, place) for cell in cells))
    return Table(names, units, tuple(lines), tuple(body))


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


def _plain(cell: str, comma: bool, place: str) -> str:
    """Return a cell with a decimal point."""
    cell = cell.strip()
    if comma and _DECIMAL_COMMA.fullmatch(cell):
        return cell.replace(",", ".")
    if comma and _DECIMAL_POINT.fullmatch(cell):
        raise InputError(f"{place}: {cell}: other cells of the file have a decimal comma")
    return cell

"""A table: heads with units for people, bare names and full digits for CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any

import numpy as np

from pmopt.quantity import uncertain
from pmopt.units import ONE, exact

#: Name of the column that says which of several tables a row of CSV is from.
TABLE = "table"


@dataclass(frozen=True)
class Uncertain:
    """A number and its error: one column where people read, two in CSV.

    ``bound`` says that the error is a bound, not a standard error; ``sign`` stands before it where
    it is itself only known from one side, ``"<="`` or ``">="``.
    """

    value: float
    error: float
    bound: bool = False
    sign: str = ""


@dataclass(frozen=True)
class Shown:
    """A cell that people read in other words than CSV has it."""

    data: str | float | int | bool | None
    text: str | None


Cell = str | float | int | bool | Uncertain | Shown | None


@dataclass(frozen=True)
class Table:
    """Rows under named columns.

    Attributes
    ----------
    title : str
    columns : tuple of str
        Bare names, as CSV has them.
    rows : tuple of tuple of Cell
    units : dict
        By column.
    notes : tuple of str
        Lines below the table; no part of CSV.
    key : str
        What CSV calls the table where it holds several.
    errors : mapping
        Columns of :class:`Uncertain` cells: the names of their errors in CSV, the standard error
        first, then, if there are such, the bound of the error.
    prose : tuple of str
        Columns that may be broken between words.
    yielding : tuple of str
        Columns that give way first where there is no room.
    only_csv, only_shown : tuple of str
        Columns that people do not see, and those that CSV has in another form.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    units: dict[str, str]
    notes: tuple[str, ...] = ()
    key: str = ""
    errors: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    prose: tuple[str, ...] = ()
    yielding: tuple[str, ...] = ()
    only_csv: tuple[str, ...] = ()
    only_shown: tuple[str, ...] = ()

    def head(self, column: str) -> str:
        """Return a column's name as people read it: with its error's name and its unit."""
        name = column
        if column in self.errors:
            k = self.columns.index(column)
            found = [row[k] for row in self.rows if isinstance(row[k], Uncertain)]
            bounds = {cell.bound for cell in found if isinstance(cell, Uncertain)}
            name += f" ± {'error bound' if bounds == {True} else 'error'}" if found else ""
        unit = self.units.get(column, ONE)
        return name if unit == ONE else f"{name} ({unit})"

    def data(self) -> tuple[list[str], list[list[Any]]]:
        """Return heads and rows as CSV has them: errors in columns of their own."""
        heads: list[str] = []
        for name in self.columns:
            if name not in self.only_shown:
                heads += [name, *self.errors.get(name, ())]
        return heads, [self._spread(row) for row in self.rows]

    def _spread(self, row: tuple[Cell, ...]) -> list[Any]:
        found: list[Any] = []
        for name, cell in zip(self.columns, row, strict=True):
            if name in self.only_shown:
                continue
            names = self.errors.get(name, ())
            errors: list[Any] = [None] * len(names)
            plain: Any = cell
            if isinstance(cell, Uncertain):
                plain = _finite(cell.value)
                errors[-1 if cell.bound else 0] = _finite(cell.error)
            elif isinstance(cell, Shown):
                plain = cell.data
            found += [plain, *errors]
        return found


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def facts(
    numbers: Mapping[str, tuple[float | int | None, str]], texts: Mapping[str, str | None],
    key: str = "about",
) -> Table:  # fmt: skip
    """Return what CSV says of a result beside its tables: numbers with units, then words."""
    rows: list[tuple[Cell, ...]] = [
        (name, value, unit, None) for name, (value, unit) in numbers.items() if value is not None
    ]
    rows += [(name, None, None, text) for name, text in texts.items() if text]
    return Table("", ("quantity", "value", "unit", "text"), tuple(rows), {}, key=key)


def design_text(params: Mapping[str, float | None], units: Mapping[str, str]) -> str:
    """Return a design in words; what is not set is left out."""
    return ", ".join(
        f"{k} = {v:g} {units[k]}".removesuffix(f" {ONE}")
        for k, v in params.items()
        if v is not None
    )


def design_facts(
    params: Mapping[str, float | None], units: Mapping[str, str]
) -> dict[str, tuple[float | None, str]]:
    """Return a design for :func:`facts`."""
    return {f"parameter {name}": (value, units[name]) for name, value in params.items()}


def to_json(document: Any) -> str:
    """Return a document as JSON text, floats in shortest round-trip form."""
    return json.dumps(document, indent=2, allow_nan=False, default=_plain)


def _plain(value: Any) -> Any:
    """Return what a NumPy number or array stands for."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is no JSON")


def to_csv(tables: Sequence[Table]) -> str:
    """Return tables as CSV; of several, ``table`` says whose a row is, under all their columns."""
    several = len(tables) > 1
    parts = [(table.key, *table.data()) for table in tables]
    heads = list(dict.fromkeys(name for _, names, _ in parts for name in names))
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([TABLE, *heads] if several else heads)
    for key, names, rows in parts:
        for row in rows:
            cells = dict(zip(names, map(_csv_cell, row), strict=True))
            line = [cells.get(name, "") for name in heads]
            writer.writerow([key, *line] if several else line)
    return stream.getvalue().rstrip("\n")


def _csv_cell(cell: Any) -> str:
    """Return a cell's text; NumPy's numbers are those they stand for, what is no number is none."""
    if cell is None:
        return ""
    if isinstance(cell, bool | np.bool_):
        return str(bool(cell)).lower()
    if isinstance(cell, float | np.floating):
        return "" if math.isnan(cell) else repr(float(cell))
    return str(cell)


def shown(cell: Cell, digits: int = 6) -> str:
    """Return a cell as a table shows it, a float with this many digits."""
    if cell is None:
        return "-"
    if isinstance(cell, Shown):
        return "-" if cell.text is None else cell.text
    if isinstance(cell, Uncertain):
        text = uncertain(cell.value, cell.error)
        return f"{cell.sign} {text}" if cell.sign else text
    if isinstance(cell, bool | np.bool_):
        return "yes" if cell else "no"
    if isinstance(cell, float | np.floating):
        return "-" if math.isnan(cell) else f"{cell + 0.0:.{digits}g}"  # no -0
    return str(cell)


def given(value: float | None) -> Cell:
    """Return a number as it was given, whatever the room for digits."""
    return None if value is None else Shown(value, exact(value))


def estimated(value: float, digits: int = 2) -> str:
    """Return a rough number with so many digits, without a power of ten: ``1200``, ``0.034``."""
    if value == round(value) and digits > 2:  # a count that is known
        return f"{value:.0f}"
    return f"{Decimal(f'{value:.{digits}g}'):f}"

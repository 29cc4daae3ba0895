"""A table: heads with units for people, bare names for CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pmopt.units import ONE

#: Smaller values are written with a power of ten.
_SMALL = 1e-4
Cell = str | float | int | bool | None


@dataclass(frozen=True)
class Table:
    """Rows under named columns.

    ``units`` are by column name, ``notes`` are lines below, ``display`` stands for the rows where
    people read them, e.g. with values rounded to their errors.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    units: dict[str, str]
    notes: tuple[str, ...] = ()
    display: tuple[tuple[Cell, ...], ...] = ()

    def heads(self) -> list[str]:
        """Return the column names with their units."""
        return [
            f"{c} ({self.units[c]})" if self.units.get(c, ONE) != ONE else c for c in self.columns
        ]


def to_json(document: Any) -> str:
    """Return a document as JSON text, floats in shortest round-trip form."""
    return json.dumps(document, indent=2, allow_nan=False, default=_plain)


def _plain(value: Any) -> Any:
    """Return what a NumPy number or array stands for."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is no JSON")


def to_csv(tables: Sequence[Table]) -> str:
    """Return the first table as CSV."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(tables[0].columns)
    for row in tables[0].rows:
        writer.writerow(["" if cell is None else _csv_cell(cell) for cell in row])
    return stream.getvalue().rstrip("\n")


def _csv_cell(cell: Cell) -> str:
    """Return a cell's text; NumPy's numbers are those they stand for."""
    if isinstance(cell, bool | np.bool_):
        return str(bool(cell)).lower()
    return repr(float(cell)) if isinstance(cell, float | np.floating) else str(cell)


def shown(cell: Cell) -> str:
    """Return a cell as a table shows it."""
    if cell is None:
        return "-"
    if isinstance(cell, bool | np.bool_):
        return "yes" if cell else "no"
    return f"{cell:.6g}" if isinstance(cell, float | np.floating) else str(cell)


def with_error(value: float, error: float) -> tuple[str, str]:
    """Return a value rounded to its error's second digit, and the error with two digits."""
    if math.isnan(value):
        return "-", "-"
    if not error > 0:
        return f"{value:.6g}", "0"
    size = max(abs(value), error)
    if size < _SMALL:
        digits = max(0, 1 + math.floor(math.log10(size)) - math.floor(math.log10(error)))
        return f"{value:.{min(digits, 15)}e}", f"{error:.1e}"
    digits = min(12, max(0, 1 - math.floor(math.log10(error))))
    return f"{value:.{digits}f}", f"{error:.2g}"


def uncertain(value: float, error: float, unit: str = ONE) -> str:
    """Return a value with its error and unit as one text, e.g. ``12.345 ± 0.012 m^3``."""
    text = "-" if math.isnan(value) else " ± ".join(with_error(value, error))
    return text if unit == ONE else f"{text} {unit}"

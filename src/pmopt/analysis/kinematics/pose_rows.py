"""Numbers in text and rows of CSV files of poses and joint positions."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmopt.errors import InputError
from pmopt.inputs.quantities import QuantityError, exact_number, parse_quantity, parse_unit
from pmopt.inputs.tables import Reader, open_table
from pmopt.mechanisms.mechanism import Coordinate, Mechanism, Vector

#: The column of times, in s.
TIME = "t"
#: s; a record that begins further from 0 counts from its first time: a double of a time stamp
#: since 1970 is good to a quarter of a microsecond only, and differences lose those digits.
_EPOCH = 1e6


@dataclass(frozen=True)
class Rows:
    """The rows of a CSV file.

    Attributes
    ----------
    lines : (N,) int64
        The number of each row's line in the file.
    columns : dict of (N,) float64
        The values of each coordinate, in the mechanism's units.
    times : (N,) float64 or None
        s; None without a column ``t``.
    notes : tuple of str
        What the user should know: columns left aside, from when times count.
    """

    lines: NDArray[np.int64]
    columns: dict[str, Vector]
    times: Vector | None
    notes: tuple[str, ...]

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.lines)

    def poses(self, first: int = 0, last: int | None = None) -> list[dict[str, float]]:
        """Return the values row by row, of all rows or from the first to before the last."""
        part = [column[first:last].tolist() for column in self.columns.values()]
        return [dict(zip(self.columns, row, strict=True)) for row in zip(*part, strict=True)]


def parse_number(where: str, name: str, text: str, unit: str = "1") -> float:
    """Return a finite number, with a unit or in the one that is wanted.

    Raises
    ------
    InputError
    """
    try:
        value, reason = parse_quantity(text, unit), ""
    except QuantityError as error:
        value, reason = math.nan, f"{error}: "
    if not math.isfinite(value):
        raise InputError(
            f"{where}: {name}={text} is not allowed: {reason}a finite number is needed"
        )
    return value


def read_rows(
    path: Path, where: str, mechanism: Mechanism, coordinates: Sequence[Coordinate]
) -> Rows:
    """Read a CSV file of poses or joint positions, with a column ``t`` where there is one.

    Columns that are neither are left aside, and named in the notes.

    Parameters
    ----------
    path : Path
    where : str
        What errors call the file's option or key.
    mechanism : Mechanism
    coordinates : sequence of Coordinate
        Whose columns are wanted, each under its name or in degrees with ``_deg`` appended.

    Raises
    ------
    InputError
        Naming the file, and the line of a cell that is no finite number.
    """
    place = f"{where}: {path}"
    with open_table(path, place, [c.name for c in coordinates]) as table:
        units = {c.name: mechanism.unit(c) for c in coordinates}
        degrees = {f"{c.name}_deg": c.name for c in coordinates if c.kind == "angle"}
        found: dict[str, _Column] = {}
        aside = []
        for k, name in enumerate(table.names):
            base = name if name in units else degrees.get(name)
            if base is None:
                aside += [name] if name != TIME else []
                continue
            if base in found:
                raise InputError(f"{place}: {base} is given twice")
            own = "deg" if base != name else None
            found[base] = _Column(name, k, _unit(table, k, units[base], place) or own, units[base])
        for name in units:
            if name not in found:
                raise InputError(
                    f"{place}: {name} is missing, needed: {', '.join(units)}; "
                    f"the header has {', '.join(table.names)}"
                )
        clock = None
        if TIME in table.names:
            k = table.names.index(TIME)
            clock = _Clock(TIME, k, _unit(table, k, "s", place), "s")
        wanted = [*found.values(), *([clock] if clock else [])]
        lines = array("q")
        for line, row in table:
            lines.append(line)
            for column in wanted:
                column.add(row, place, line)
    notes = [f"{place}: columns left aside: {', '.join(aside)}"] if aside else []
    times = None
    if clock is not None:
        times = clock.times()
        notes += [f"{place}: {clock.note} of line {lines[0]}"] if clock.note else []
    return Rows(
        np.array(lines, dtype=np.int64), {name: found[name].array() for name in units}, times,
        tuple(notes),
    )  # fmt: skip


class _Column:
    """The values of a column in a unit.

    A cell's own unit comes first, then the head's, then the one that the name implies: ``unit``.
    """

    def __init__(self, name: str, place: int, unit: str | None, wanted: str) -> None:
        self.name, self.place, self.unit, self.wanted = name, place, unit, wanted
        self.values = array("d")

    def add(self, row: tuple[str, ...], where: str, line: int) -> None:
        """Take the cell of a row."""
        text = row[self.place]
        if self.unit is not None and _is_bare(text):
            text = f"{text} {self.unit}"
        self.values.append(parse_number(f"{where}, line {line}", self.name, text, self.wanted))

    def array(self) -> Vector:
        """Return the values."""
        return np.array(self.values)


class _Clock(_Column):
    """The column of times; in full digits from the first one on, where that is far from 0."""

    def __init__(self, name: str, place: int, unit: str | None, wanted: str) -> None:
        super().__init__(name, place, unit, wanted)
        self.note: str | None = None
        self._first: Fraction | None = None
        self._since = array("d")

    def add(self, row: tuple[str, ...], where: str, line: int) -> None:
        """Take the cell of a row."""
        super().add(row, where, line)
        text, unit = row[self.place], self.unit or "s"
        if len(self.values) == 1 and abs(self.values[0]) >= _EPOCH and _is_bare(text):
            self._first = exact_number(text) * parse_unit(unit).factor
            self.note = f"times count from t = {text} {unit}"
        elif self._first is not None and not _is_bare(text):
            self._first = self.note = None
        if self._first is not None:
            exact = exact_number(text) * parse_unit(unit).factor
            self._since.append(float(exact - self._first))

    def times(self) -> Vector:
        """Return the times in s."""
        return self.array() if self._first is None else np.array(self._since)


def _unit(table: Reader, column: int, wanted: str, place: str) -> str | None:
    """Return the unit in the head of a column, checked."""
    unit = table.units[column]
    if unit is not None:
        try:
            parse_quantity(f"1 {unit}", wanted)
        except QuantityError as error:
            raise InputError(f"{place}: column {table.names[column]}: {error}") from None
    return unit


def _is_bare(text: str) -> bool:
    """Return whether a text is a finite number without unit."""
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False

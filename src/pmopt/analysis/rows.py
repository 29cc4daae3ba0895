"""Numbers in text and rows of CSV files of poses and joint positions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from pmopt.errors import InputError
from pmopt.inputs.quantities import QuantityError, exact_number, parse_quantity, parse_unit
from pmopt.inputs.tables import Table, read_table
from pmopt.mechanisms.base import Coordinate, Mechanism

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
    lines : tuple of int
        The number of each row's line in the file.
    columns : dict
        The values of each coordinate, in the mechanism's units.
    times : list of float or None
        s; None without a column ``t``.
    notes : tuple of str
        What the user should know: columns left aside, from when times count.
    """

    lines: tuple[int, ...]
    columns: dict[str, list[float]]
    times: list[float] | None
    notes: tuple[str, ...]

    def poses(self) -> list[dict[str, float]]:
        """Return the values row by row."""
        return [
            dict(zip(self.columns, row, strict=True))
            for row in zip(*self.columns.values(), strict=True)
        ]


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
    table = read_table(path, place, [c.name for c in coordinates])
    units = {c.name: mechanism.unit(c) for c in coordinates}
    degrees = {f"{c.name}_deg": c.name for c in coordinates if c.kind == "angle"}
    found: dict[str, list[float]] = {}
    aside = []
    for k, name in enumerate(table.names):
        base = name if name in units else degrees.get(name)
        if base is None:
            aside += [name] if name != TIME else []
            continue
        if base in found:
            raise InputError(f"{place}: {base} is given twice")
        found[base] = _values(table, k, units[base], "deg" if base != name else None, place)
    for name in units:
        if name not in found:
            raise InputError(
                f"{place}: {name} is missing, needed: {', '.join(units)}; "
                f"the header has {', '.join(table.names)}"
            )
    notes = [f"{place}: columns left aside: {', '.join(aside)}"] if aside else []
    times = None
    if TIME in table.names:
        times, note = _times(table, place)
        notes += [note] if note else []
    return Rows(table.lines, {name: found[name] for name in units}, times, tuple(notes))


def _values(table: Table, column: int, wanted: str, own: str | None, place: str) -> list[float]:
    """Return the values of a column in a unit.

    A cell's own unit comes first, then the head's, then ``own``, the one that the name implies.
    """
    name = table.names[column]
    unit = _unit(table, column, wanted, place) or own
    values = []
    for line, row in zip(table.lines, table.cells, strict=True):
        text = row[column]
        if unit is not None and _is_bare(text):
            text = f"{text} {unit}"
        values.append(parse_number(f"{place}, line {line}", name, text, wanted))
    return values


def _unit(table: Table, column: int, wanted: str, place: str) -> str | None:
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


def _times(table: Table, place: str) -> tuple[list[float], str | None]:
    """Return times in s, and a note where they count from the first one."""
    column = table.names.index(TIME)
    times = _values(table, column, "s", None, place)
    cells = table.column(TIME)
    if abs(times[0]) < _EPOCH or not all(map(_is_bare, cells)):
        return times, None
    unit = table.units[column] or "s"
    factor = parse_unit(unit).factor
    exact: list[Fraction] = [exact_number(cell) * factor for cell in cells]
    return (
        [float(value - exact[0]) for value in exact],
        f"{place}: times count from t = {cells[0]} {unit} of line {table.lines[0]}",
    )

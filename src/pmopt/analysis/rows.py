"""Numbers in text and rows of CSV files."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from pmopt.errors import InputError


def parse_number(where: str, name: str, text: str) -> float:
    """Return a finite number.

    Raises
    ------
    InputError
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{where}: {name}={text} is not allowed: a finite number is needed")
    return value


def read_rows(path: Path, where: str, columns: Sequence[str]) -> list[tuple[int, dict[str, float]]]:
    """Return the line numbers and rows of a CSV file of poses or joint positions.

    Raises
    ------
    InputError
        Naming the file, and the line of a cell that is no finite number.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream)
            lines = [(reader.line_num, cells) for cells in reader if cells]
    except OSError as error:
        raise InputError(f"{where}: {path}: can not read: {error.strerror or error}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{where}: {path}: is no CSV file: {error}") from None
    if len(lines) < 2:
        raise InputError(f"{where}: {path}: has no rows; columns needed: {', '.join(columns)}")
    head = [name.strip() for name in lines[0][1]]
    for name in head:
        if head.count(name) > 1:
            raise InputError(f"{where}: {path}: column {name} is given twice")
    rows = []
    for number, cells in lines[1:]:
        place = f"{where}: {path}, line {number}"
        if len(cells) != len(head):
            raise InputError(f"{place}: {len(cells)} cells, the header has {len(head)}")
        values = {k: parse_number(place, k, v) for k, v in zip(head, cells, strict=True)}
        rows.append((number, values))
    return rows

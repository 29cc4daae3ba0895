"""Tables as lines of a given width, in which no number, unit or name is ever split.

What gives way first: the width of prose, which is broken between words; digits; then the table
stands on end, a line a field; then columns, which are named below.
"""

from __future__ import annotations

import re
import textwrap
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass

from pmopt.reporting.tables.table import Cell, Shown, Table, Uncertain, shown

#: Numbers of digits that are tried one after the other.
_DIGITS = (6, 5, 4)
#: Prose is no narrower than these, one tried after the other.
_PROSE = (16, 12)
#: Most lines of a table that stands on end, a row below the other.
_ON_END = 56
#: Between the columns of an open table.
_GAP = "  "
#: Stands for a space that holds number and unit together; no text has it.
_HELD = "\ue000"
_NUMBER = r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?|\)(?:e[-+]?\d+)?"
_UNIT = r"(?:mm|m|rad|deg|kg|s|N|W|J|%)(?:\^\d+)?(?:/\(?[a-z]+(?:\^\d+)?(?: [a-z]+\))?)?"


@dataclass(frozen=True)
class Style:
    """How a table is drawn: open on a terminal, framed in a file or a pipe.

    ``rule`` is the character of lines.
    """

    framed: bool = False
    rule: str = "─"

    def overhead(self, columns: int) -> int:
        """Return how much of a line is not cells."""
        return 3 * columns + 1 if self.framed else len(_GAP) * (columns - 1)

    def line(self, cells: Sequence[str]) -> str:
        """Return a line of cells of their columns' widths."""
        if self.framed:
            return f"| {' | '.join(cells)} |"
        return _GAP.join(cells).rstrip()

    def ruled(self, widths: Sequence[int]) -> str:
        """Return the line below the heads."""
        if self.framed:
            return f"+-{'-+-'.join('-' * w for w in widths)}-+"
        return _GAP.join(self.rule * w for w in widths)


@dataclass(frozen=True)
class _Column:
    """A column as texts."""

    name: str
    head: str
    cells: tuple[str, ...]
    numeric: bool
    prose: bool

    def narrowest(self, prose: int) -> int:
        """Return the width at which nothing that must not be broken is."""
        words = [w for cell in (self.head, *self.cells) for w in _words(cell)]
        least = max(map(width_of, words), default=0)
        if self.prose:
            return max(least, min(self.widest, prose))
        return max(least, *map(width_of, self.cells), 0)

    @property
    def widest(self) -> int:
        """The width at which nothing is broken."""
        return max(map(width_of, (self.head, *self.cells)))


def width_of(text: str) -> int:
    """Return how many columns of a terminal a text takes."""
    return sum(
        0 if unicodedata.combining(c) else 1 + (unicodedata.east_asian_width(c) in "WF")
        for c in text
    )


def wrap(text: str, width: int | None, indent: str = "") -> list[str]:
    """Return a text broken between words; numbers keep their units, ``±`` and ``=`` both sides."""
    if width is None or width_of(text) <= width:
        return [text]
    lines = textwrap.wrap(
        _hold(text), max(width, 1), break_long_words=False, break_on_hyphens=False,
        subsequent_indent=indent,
    )  # fmt: skip
    return [line.replace(_HELD, " ") for line in lines]


def _hold(text: str) -> str:
    """Return a text in which the spaces that must not be broken at are other characters."""
    text = re.sub(r" (±|=|<=|>=|<|\.\.) ", rf"{_HELD}\1{_HELD}", text)
    text = re.sub(r"(?<!\S)(<=|>=) (?=[-\d])", rf"\1{_HELD}", text)
    text = re.sub(rf"({_NUMBER}) (?={_UNIT}(?![\w]))", rf"\1{_HELD}", text)
    # Names with a number, such as limb 2, and short brackets, such as (type II).
    text = re.sub(r"(?<=[A-Za-z]) (?=\d+(?![\w.^]))", _HELD, text)
    text = re.sub(r"\((\w+) (\w+)\)", rf"(\1{_HELD}\2)", text)
    # Units of several words, such as m rad^2 and N m.
    return re.sub(rf"({_HELD}(?:mm|m|N)(?:\^\d)?) (?=(?:rad|m)(?:\^\d)?(?![\w]))", rf"\1{_HELD}",
                  text)  # fmt: skip


def _words(text: str) -> list[str]:
    return [word.replace(_HELD, " ") for word in _hold(text).split(" ") if word]


def lay_out(table: Table, width: int | None, style: Style | None = None) -> list[str]:
    """Return a table's lines: heads, rows and what was left out; without rows none.

    Parameters
    ----------
    table : Table
    width : int or None
        That no line exceeds, but for names that are longer by themselves; None is as wide as
        needed.
    style : Style, optional
        Default: open.
    """
    style = style or Style()
    kept = seen(table)
    if not table.rows or not kept:
        return []
    if width is None:
        return _drawn(_columns(table, kept, _DIGITS[0]), None, style)
    for prose in _PROSE:
        for digits in _DIGITS:
            columns = _columns(table, kept, digits)
            if _least(columns, style, prose) <= width:
                return _drawn(columns, width, style, prose)
    for digits in _DIGITS:
        turned = _turned(table, kept, digits)
        if turned and _least(turned, style) <= width:
            return _drawn(turned, width, style)
    if len(table.rows) * (len(kept) + 1) <= _ON_END:
        return _records(table, kept, width)
    return _cut(table, kept, width, style)


def seen(table: Table) -> list[int]:
    """Return the columns that people see: those for them in which there is anything."""
    return [
        k
        for k, name in enumerate(table.columns)
        if name not in table.only_csv and any(not _absent(row[k]) for row in table.rows)
    ]


def _absent(cell: Cell) -> bool:
    return cell is None or (isinstance(cell, Shown) and cell.text is None)


def _columns(table: Table, kept: Sequence[int], digits: int) -> list[_Column]:
    return [
        _column(
            table.columns[k], _head(table, k), [row[k] for row in table.rows], digits,
            table.columns[k] in table.prose,
        )
        for k in kept
    ]  # fmt: skip


def _head(table: Table, k: int) -> str:
    """Return a head that may be broken before its unit, not within it."""
    name, bracket, unit = table.head(table.columns[k]).partition(" (")
    return name + bracket + unit.replace(" ", _HELD)


def _column(
    name: str, head: str, cells: Sequence[Cell], digits: int, prose: bool = False
) -> _Column:
    texts = [shown(cell, digits) for cell in cells]
    numeric = all(_numeric(cell, text) for cell, text in zip(cells, texts, strict=True))
    return _Column(name, head, tuple(_aligned(texts)), numeric and not prose, prose)


def _numeric(cell: Cell, text: str) -> bool:
    if isinstance(cell, Uncertain) or text == "-":
        return True
    try:
        float(text.removeprefix("<= ").removeprefix(">= "))
    except ValueError:
        return False
    return True


def _aligned(texts: Sequence[str]) -> list[str]:
    """Return numbers with errors so that all ± stand below each other."""
    parts = [text.partition(" ± ") for text in texts]
    if not any(middle for _, middle, _ in parts):
        return list(texts)
    before = max(len(a) for a, middle, _ in parts if middle)
    after = max(len(b) for _, middle, b in parts if middle)
    return [
        f"{a:>{before}}{middle}{b:<{after}}" if middle else a
        for a, middle, b in parts
    ]  # fmt: skip


def _least(columns: Sequence[_Column], style: Style, prose: int = _PROSE[0]) -> int:
    return sum(c.narrowest(prose) for c in columns) + style.overhead(len(columns))


def _drawn(
    columns: Sequence[_Column], width: int | None, style: Style, prose: int = _PROSE[0]
) -> list[str]:
    widths = _widths(columns, width, style, prose)
    lines = _row([c.head for c in columns], columns, widths, style)
    lines.append(style.ruled(widths))
    if style.framed:
        lines.insert(0, lines[-1])
    for number in range(len(columns[0].cells)):
        lines += _row([c.cells[number] for c in columns], columns, widths, style)
    return [*lines, lines[0]] if style.framed else lines


def _widths(columns: Sequence[_Column], width: int | None, style: Style, prose: int) -> list[int]:
    """Give the rest of the width to heads and prose that would be broken, least first."""
    if width is None:
        return [c.widest for c in columns]
    widths = [c.narrowest(prose) for c in columns]
    left = width - style.overhead(len(columns)) - sum(widths)
    order = sorted(range(len(columns)), key=lambda k: columns[k].widest - widths[k])
    for place, k in enumerate(order):
        fair = left // (len(order) - place)
        more = min(columns[k].widest - widths[k], fair)
        widths[k] += more
        left -= more
    return widths


def _row(
    texts: Sequence[str], columns: Sequence[_Column], widths: Sequence[int], style: Style
) -> list[str]:
    """Return the lines of a row, more than one where something is broken between words."""
    parts = [wrap(text, width) for text, width in zip(texts, widths, strict=True)]
    lines = []
    for number in range(max(map(len, parts))):
        cells = []
        for part, column, width in zip(parts, columns, widths, strict=True):
            text = part[number] if number < len(part) else ""
            room = " " * (width - width_of(text))
            text = text.replace(_HELD, " ")
            cells.append(room + text if column.numeric else text + room)
        lines.append(style.line(cells))
    return lines


def _turned(table: Table, kept: Sequence[int], digits: int) -> list[_Column]:
    """Return the table with a row for each field, and a column for each row, if it is so taller."""
    if not 1 < len(table.rows) <= max(len(kept), 2) or len(kept) < 3:
        return []
    first, *others = kept
    corner = table.columns[first]
    names = [shown(row[first], digits) for row in table.rows]
    if len(set(names)) < len(names) and len(others) > 1:  # two fields may distinguish them
        second, *others = others
        corner += f", {table.columns[second]}"
        names = [
            f"{name}, {shown(row[second])}" for name, row in zip(names, table.rows, strict=True)
        ]
    if len(set(names)) < len(names):
        return []
    heads = tuple(table.head(table.columns[k]).replace(" ", _HELD) for k in others)
    prose = any(table.columns[k] in table.prose for k in others)
    columns = [_Column("", corner, heads, False, False)]
    for name, row in zip(names, table.rows, strict=True):
        # Numbers of a field are aligned with no others: each stands by itself.
        cells = [
            text if table.columns[k] in table.prose else text.replace(" ", _HELD)
            for k, text in ((k, shown(row[k], digits)) for k in others)
        ]
        columns.append(_Column(name, name, tuple(cells), False, prose))
    return columns


def _records(table: Table, kept: Sequence[int], width: int) -> list[str]:
    """Return the rows below each other, each a line for every field that it has.

    Of several rows the first field is the heading.
    """
    several = len(table.rows) > 1
    fields = kept[1:] if several else kept
    heads = {k: table.head(table.columns[k]) for k in fields}
    room = max(map(width_of, heads.values()))
    indent = _GAP if several else ""
    lines: list[str] = []
    for row in table.rows:
        if several:
            name = shown(row[kept[0]])
            number = _numeric(row[kept[0]], name)
            lines += wrap(f"{table.columns[kept[0]]} {name}" if number else name, width)
        for k, head in heads.items():
            if _absent(row[k]):
                continue
            text = shown(row[k])
            first = indent + head + " " * (room - width_of(head)) + _GAP
            inner = wrap(text, width - width_of(first)) or [""]
            held = text.replace(" ", _HELD) if table.columns[k] not in table.prose else text
            if max(map(width_of, _words(held)), default=0) > width - width_of(first):
                lines += [indent + head, *(_GAP * 2 + part for part in wrap(text, width - 4))]
            else:
                lines += [first + inner[0], *(" " * width_of(first) + more for more in inner[1:])]
        lines.append("")
    return lines


def _cut(table: Table, kept: Sequence[int], width: int, style: Style) -> list[str]:
    """Return the table with as many of its columns as there is room for, the others named."""
    columns = _columns(table, kept, _DIGITS[-1])
    order = [c for c in reversed(columns) if c.name in table.yielding]
    order += [c for c in reversed(columns) if c not in order]
    some = list(columns)
    for column in order[:-1]:
        if _least(some, style) <= width:
            break
        some.remove(column)
    left = ", ".join(c.name for c in columns if c not in some)
    note = f"no room for {left}: a wider terminal or --format json shows them"
    return [*_drawn(some, max(width, _least(some, style)), style), *wrap(note, width, _GAP)]

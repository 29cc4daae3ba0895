"""Tables as HTML, for notebooks: the same heads, digits and errors as in a terminal."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from pmopt.reporting.tables.layout import seen
from pmopt.reporting.tables.table import Table, shown

#: Rows of a table that are shown; of more the first ones.
_MOST = 60


def to_html(tables: Iterable[Table]) -> str:
    """Return tables one below the other, notes below each."""
    return "\n".join(map(_one, tables))


def _one(table: Table) -> str:
    kept = seen(table)
    names = [table.columns[k] for k in kept]
    heads = "".join(f"<th>{escape(table.head(name))}</th>" for name in names)
    lines = ["<table>", f'<caption style="text-align: left">{escape(table.title)}</caption>']
    if kept:
        lines.append(f"<thead><tr>{heads}</tr></thead>")
    lines.append("<tbody>")
    for row in table.rows[:_MOST]:
        cells = "".join(
            f'<td style="text-align: left">{escape(shown(row[k]))}</td>'
            if isinstance(row[k], str) else f"<td>{escape(shown(row[k]))}</td>"
            for k in kept
        )  # fmt: skip
        lines.append(f"<tr>{cells}</tr>")
    lines.append("</tbody></table>")
    more = len(table.rows) - _MOST
    notes = [*table.notes, *([f"and {more} rows more"] if more > 0 else [])]
    lines += [f"<p><small>{escape(note)}</small></p>" for note in notes]
    return "\n".join(lines)

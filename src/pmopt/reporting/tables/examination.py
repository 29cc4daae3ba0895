"""What a check of a mechanism compared, and what it found, as tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pmopt.reporting.tables.table import Table

if TYPE_CHECKING:
    from pmopt.testing.findings import Examination


def examination_tables(found: Examination) -> list[Table]:
    """Return the comparisons that were made, and what is wrong where something is."""
    checks = Table(
        f"{found.mechanism}: parts held against one another",
        ("check", "part", "held", "compared", "count", "deviation", "allowed"),
        tuple(
            (
                c.name,
                c.place,
                "yes" if c.held else "no",
                c.compared,
                c.count,
                c.deviation,
                c.allowed,
            )
            for c in found.checks
        ),
        {},
        ("deviation: the largest, as a share of the size of what is compared",),
        "checks",
        prose=("compared",),
        yielding=("compared", "allowed", "count", "deviation"),
    )
    if found.held:
        return [checks]
    return [checks, _findings(found)]


def examination_data(found: Examination) -> list[Table]:
    """Return both tables for CSV."""
    checks, *_ = examination_tables(found)
    return [checks, _findings(found)]


def _findings(found: Examination) -> Table:
    return Table(
        "What is wrong",
        ("check", "part", "text"),
        tuple((f.check, f.place, f.text) for f in found.findings),
        {},
        key="findings",
        prose=("text",),
    )

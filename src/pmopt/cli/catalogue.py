"""``pmopt list`` and ``pmopt info``."""

from __future__ import annotations

import click

from pmopt.cli.options import any_mechanism_argument, common_options
from pmopt.cli.output import emit
from pmopt.mechanisms import Mechanism, find, left_out, names
from pmopt.reporting.tables import catalogue as tables


@click.command("list")
@common_options
def list_command(form: str, quiet: bool, debug: bool) -> None:
    """The catalogue of mechanisms.

    \b
    Example:
      pmopt list --format json
    """
    found = [find(name, checked=False) for name in names()]
    document = {
        "mechanisms": [
            {
                "name": m.name,
                "title": m.title,
                "freedom": m.freedom,
                "length_unit": m.length_unit,
                "description": m.description,
                "source": m.source,
            }
            for m in found
        ],
        "left_out": [
            {"plugin": p.name, "entry_point": p.value, "reason": p.reason} for p in left_out()
        ],
    }
    emit(form, document, [tables.mechanisms_table(found, left_out())])


@click.command("info")
@any_mechanism_argument
@common_options
def info_command(mechanism: Mechanism, form: str, quiet: bool, debug: bool) -> None:
    """What one mechanism declares: parameters, coordinates, limbs, working modes, limits.

    \b
    Example:
      pmopt info 2pauu-ppap
    """
    emit(
        form, tables.mechanism_document(mechanism), tables.mechanism_tables(mechanism),
        tables.mechanism_data(mechanism),
    )  # fmt: skip

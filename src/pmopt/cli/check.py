"""``pmopt check``."""

from __future__ import annotations

import click

from pmopt.cli.options import any_mechanism_argument, common_options, seed_option
from pmopt.cli.output import emit
from pmopt.mechanisms import Mechanism
from pmopt.reporting.tables.examination import examination_data, examination_tables
from pmopt.testing import examine


@click.command("check")
@any_mechanism_argument
@seed_option
@common_options
def check_command(mechanism: Mechanism, seed: int, form: str, quiet: bool, debug: bool) -> None:
    """Check that a mechanism is consistent: its parts must agree with each other.

    For the author of a mechanism. Kernel, inverse and forward kinematics, Jacobian, layout,
    posture, skeleton, box of reach, freedoms, names and bodies are compared at random poses of the
    default design; nothing is compiled. The exit code is 4 where something is wrong.

    \b
    Example:
      pmopt check 2pauu-ppap
    """
    found = examine(mechanism, seed)
    emit(form, found.to_dict(), examination_tables(found), examination_data(found))
    found.require_held()

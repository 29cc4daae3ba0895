"""``pmopt mobility``."""

from __future__ import annotations

import click

from pmopt.analysis.mobility.freedom import DECLARED, DEFAULT_SAMPLES, mobility_of
from pmopt.cli import options
from pmopt.cli.output import emit
from pmopt.errors import unknown_name
from pmopt.mechanisms import Mechanism
from pmopt.reporting.tables.mobility import mobility_data, mobility_tables


@click.command("mobility")
@options.mechanism_argument
@click.option(
    "--layout",
    default=DECLARED,
    show_default=True,
    help="Layout of the limbs; pmopt info lists the others of a mechanism.",
)
@options.params_option
@click.option(
    "--pose",
    multiple=True,
    metavar="NAME=VALUE,..",
    help="Where limbs are analysed. Default: the mechanism's home.",
)
@click.option("--working-mode", help="Default: the mechanism's first.")
@click.option(
    "--samples",
    type=click.IntRange(min=1, max=100_000),
    default=DEFAULT_SAMPLES,
    show_default=True,
    help="Configurations of the full-cycle check.",
)
@options.seed_option
@options.common_options
def mobility_command(
    mechanism: Mechanism, layout: str, params: tuple[str, ...], pose: tuple[str, ...],
    working_mode: str | None, samples: int, seed: int, form: str, quiet: bool, debug: bool,
) -> None:  # fmt: skip
    """Freedoms, constraints and loops from the declared joints, and after finite motion.

    \b
    Example:
      pmopt mobility 2pauu-ppap
    """
    allowed = (DECLARED, *mechanism.layouts)
    if layout not in allowed:
        raise unknown_name("--layout", layout, allowed)
    if working_mode is not None:
        mechanism.check_mode(working_mode, "--working-mode")
    result = mobility_of(
        mechanism,
        options.design_parameters(mechanism, params),
        layout=layout,
        pose=options.split_pairs(pose, "--pose") if pose else None,
        working_mode=working_mode,
        samples=samples,
        seed=seed,
        where="--pose",
    )
    emit(form, result.to_dict(), mobility_tables(result), mobility_data(result))

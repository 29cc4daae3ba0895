"""``pmopt certify``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pmopt.analysis.settings import ClaimSettings
from pmopt.cli import options
from pmopt.cli.fields import Sectioned, given_options, options_of
from pmopt.cli.output import emit, notifier
from pmopt.errors import InfeasibleError
from pmopt.mechanisms import Mechanism

EXIT_UNVERIFIED = 4


@click.command("certify", cls=Sectioned)
@options.mechanism_argument
@options.params_option
@options_of(ClaimSettings)
@options.out_options
@options.common_options
def certify_command(
    mechanism: Mechanism, params: tuple[str, ...], out: Path | None, force: bool, form: str,
    quiet: bool, debug: bool, **values: Any,
) -> int:  # fmt: skip
    """Prove or refute that no reachable pose of a box is singular, or that each has LCI >= X.

    The exit code is 0 where the claim is proven, 3 where no pose of the box is reachable (empty),
    and 4 where the claim is refuted or undecided.

    \b
    Example:
      pmopt certify 2pauu-ppap --domain x=-0.1:0.1,y=-0.1:0.1,z=1.3:1.5 --min-lci 0.2
    """
    from pmopt.analysis.certification.claim import READS
    from pmopt.reporting.runs import certify_run

    settings = READS.settings(given_options(ClaimSettings, values, mechanism), "certify")
    notify = notifier(quiet)
    time_budget, box_budget = settings.time_budget, settings.box_budget
    if time_budget is None and box_budget is None:
        time_budget = certify_run.DEFAULT_SECONDS
    budgets = certify_run.Budgets(time_budget, box_budget)
    result = certify_run.run_claim(
        mechanism, options.design_parameters(mechanism, params), settings.of_workspace(), budgets,
        out,
        force=force, notify=notify,
    )  # fmt: skip
    emit(
        form, result.to_dict(), certify_run.claim_tables(result),
        certify_run.certified_data(result),
    )  # fmt: skip
    if out is not None:
        notify(f"written to {out}")
    if result.verdict == "empty":
        raise InfeasibleError(f"certify: nothing is reachable: {result.reason}")
    return 0 if result.verdict == "proven" else EXIT_UNVERIFIED

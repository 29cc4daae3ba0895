"""``pmopt certify``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pmopt.cli import options
from pmopt.cli.output import emit, notifier
from pmopt.errors import InfeasibleError
from pmopt.mechanisms import Mechanism

EXIT_UNVERIFIED = 4


@click.command("certify")
@options.mechanism_argument
@options.params_option
@click.option(
    "--domain",
    multiple=True,
    metavar="COORD=LOWER:UPPER,..",
    help="The box: bounds on pose coordinates. Default: the whole workspace.",
)
@click.option("--limits", multiple=True, metavar="JOINT=LOWER:UPPER,..", help="Bounds on joints.")
@click.option(
    "--min-lci",
    type=options.Quantity("1"),
    metavar="X",
    help="Claim LCI >= X at every reachable pose. Default: the claim that none is singular.",
)
@click.option("--working-mode", metavar="MODE", help="See pmopt info MECH. Default: its first.")
@options.jacobian_options[0]
@options.jacobian_options[1]
@options.jacobian_options[2]
@click.option(
    "--time-budget",
    type=options.Quantity("s"),
    metavar="SECONDS",
    help="Work after which the claim is left undecided, compilation not counted. Default: 30 s, "
    "none with --box-budget.",
)
@options.box_budget_option
@options.out_options
@options.common_options
def certify_command(
    mechanism: Mechanism, params: tuple[str, ...], domain: tuple[str, ...],
    limits: tuple[str, ...], min_lci: float | None, working_mode: str | None, kind: str | None,
    characteristic_length: float | str | None, norm: str, time_budget: float | None,
    box_budget: int | None,
    out: Path | None, force: bool, form: str, quiet: bool, debug: bool,
) -> int:  # fmt: skip
    """Prove or refute that no reachable pose of a box is singular, or that each has LCI >= X.

    The exit code is 0 where it is proven, 3 where it is about nothing, as no pose of the box is
    reachable (empty), and 4 where it is refuted or left undecided.

    \b
    Example:
      pmopt certify 2pauu-ppap --domain x=-0.1:0.1,y=-0.1:0.1,z=1.3:1.5 --min-lci 0.2
    """
    from pmopt.analysis.settings import WorkspaceSettings
    from pmopt.analysis.validation import validated
    from pmopt.reporting.runs import certify_run

    given: dict[str, Any] = {
        "working_mode": working_mode,
        "norm": norm,
        "jacobian": kind,
        "characteristic_length": characteristic_length,
        "min_lci": min_lci,
        "domain": options.parse_ranges(domain, "--domain", mechanism),
        "limits": options.parse_ranges(limits, "--limits", mechanism),
    }
    settings = validated(
        WorkspaceSettings, {k: v for k, v in given.items() if v is not None}, "certify"
    )
    notify = notifier(quiet)
    if time_budget is None and box_budget is None:
        time_budget = certify_run.DEFAULT_SECONDS
    budgets = certify_run.Budgets(time_budget, box_budget)
    result = certify_run.run_claim(
        mechanism, options.design_parameters(mechanism, params), settings, budgets, out,
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

"""``pmopt workspace``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pmopt.cli import options
from pmopt.cli.output import emit, notifier, progress_bar
from pmopt.errors import InputError
from pmopt.mechanisms import Mechanism
from pmopt.mechanisms.mechanism import Parameters

if TYPE_CHECKING:
    from pmopt.analysis.settings import WorkspaceSettings


@click.command("workspace")
@options.mechanism_argument
@options.params_option
@click.option(
    "--samples",
    type=options.Count(),
    metavar="N",
    help="Sample points, all replicates together. Default: 4194304.",
)
@click.option(
    "--sampler",
    type=click.Choice(["r-sequence", "sobol", "monte-carlo", "lines"]),
    help="Default: r-sequence. lines: exact along one coordinate, where a mechanism offers it.",
)
@click.option(
    "--replicates",
    type=options.Count(),
    metavar="N",
    help="Independent randomisations behind the error estimates. Default: about 16; 32 with "
    "--target-error.",
)
@click.option(
    "--grid",
    type=int,
    metavar="N",
    help="Midpoint grid of N cells an axis instead; errors are bounds, by as many samples.",
)
@click.option(
    "--target-error",
    type=options.Quantity("1"),
    metavar="X",
    help="Sample until volume and GCI have this relative standard error.",
)
@options.seed_option
@click.option("--working-mode", metavar="MODE", help="See pmopt info MECH. Default: its first.")
@options.jacobian_options[0]
@options.jacobian_options[1]
@options.jacobian_options[2]
@click.option(
    "--min-lci",
    type=options.Quantity("1"),
    metavar="X",
    help="Poses with a smaller LCI do not count.",
)
@click.option(
    "--regions", metavar="0,..,1", help="Edges of the dexterity regions. Default: 0,0.1,0.3,1."
)
@click.option(
    "--domain",
    multiple=True,
    metavar="COORD=LOWER:UPPER,..",
    help="Bounds on pose coordinates; inf is allowed.",
)
@click.option("--limits", multiple=True, metavar="JOINT=LOWER:UPPER,..", help="Bounds on joints.")
@click.option(
    "--aspect",
    type=click.Choice(["home"]),
    help="Count only the singularity-free region around the home pose.",
)
@click.option(
    "--block",
    type=click.Choice(["translational", "rotational"]),
    help="Index of the Jacobian's rows for lengths or for angles alone.",
)
@click.option(
    "--link-diameter",
    type=options.Quantity("length"),
    metavar="X",
    help="Links (limbs and cranks, joint to joint) are capsules of this diameter that must not "
    "meet those of other limbs.",
)
@click.option(
    "--platform-diameter",
    type=options.Quantity("length"),
    metavar="X",
    help="Of the platform's spokes, centre to limb, and the tool; default: the links'.",
)
@click.option(
    "--cone-angle",
    type=options.Quantity("rad"),
    metavar="RAD",
    help="Largest angle of the link at passive U and S joints from its direction at home, seen "
    "from base or platform.",
)
@click.option(
    "--tool",
    metavar="X,Y,Z",
    help="Tool point in the platform's frame; --limits may then bound tool_x, ..",
)
@click.option(
    "--shape-grid",
    type=click.IntRange(0, 1000),
    metavar="N",
    help="Cells an axis on which pieces and voids are counted; 0: not at all. Default: 96 with "
    "three coordinates, 28 with four, 14 with five.",
)
@click.option(
    "--certify",
    type=options.Quantity("1"),
    metavar="GAP",
    help="Guaranteed bounds of the volume, GAP of it apart, and of the least and largest LCI "
    "instead of samples.",
)
@click.option(
    "--time-budget",
    type=options.Quantity("s"),
    metavar="SECONDS",
    help="With --certify: stop with the bounds so far; compilation does not count.",
)
@options.box_budget_option
@options.threads_option
@options.scheduler_option
@options.out_options
@options.resume_option
@click.option("--dry-run", is_flag=True, help="Say what would be done and how long it takes.")
@options.common_options
def workspace_command(
    mechanism: Mechanism, params: tuple[str, ...], samples: int | None, sampler: str | None,
    replicates: int | None, grid: int | None, target_error: float | None, seed: int,
    working_mode: str | None, kind: str | None, characteristic_length: float | str | None,
    norm: str, min_lci: float | None, regions: str | None, domain: tuple[str, ...],
    limits: tuple[str, ...],
    aspect: str | None, block: str | None, link_diameter: float | None,
    platform_diameter: float | None,
    cone_angle: float | None, tool: str | None, shape_grid: int | None,
    certify: float | None, time_budget: float | None, box_budget: int | None,
    threads: int | None, scheduler: str | None,
    out: Path | None, force: bool, resume: bool, dry_run: bool, form: str, quiet: bool,
    debug: bool,
) -> None:  # fmt: skip
    """Volume, dexterity (LCI, GCI, regions) and shape of a workspace, each with its error.

    \b
    Example:
      pmopt workspace 2pauu-ppap --params m=1,n=0.7,l1=0.65,l2=1.5,c=0.1
    """
    from pmopt.analysis.settings import WorkspaceSettings
    from pmopt.analysis.validation import validated
    from pmopt.analysis.workspace.compute import DEFAULT_SEED
    from pmopt.analysis.workspace.shape import DEFAULT_GRIDS, check_cells
    from pmopt.execution.cluster import connect
    from pmopt.reporting.runs import workspace_run
    from pmopt.reporting.runs.tasks import WorkspaceTask
    from pmopt.reporting.tables.workspace import workspace_data, workspace_tables

    given: dict[str, Any] = {
        "samples": samples,
        "sampler": sampler,
        "replicates": replicates,
        "grid": grid,
        "target_error": target_error,
        "working_mode": working_mode,
        "norm": norm,
        "jacobian": kind,
        "characteristic_length": characteristic_length,
        "min_lci": min_lci,
        "regions": None if regions is None else options.parse_edges(regions),
        "domain": options.parse_ranges(domain, "--domain", mechanism),
        "limits": options.parse_ranges(limits, "--limits", mechanism),
        "aspect": aspect,
        "block": block,
        "link_diameter": link_diameter,
        "platform_diameter": platform_diameter,
        "cone_angle": cone_angle,
        "tool": None
        if tool is None
        else options.parse_point(tool, "--tool", mechanism.length_unit),
    }
    settings = validated(
        WorkspaceSettings, {k: v for k, v in given.items() if v is not None}, "workspace"
    )
    if certify is not None:
        unused = {"samples": samples, "sampler": sampler, "replicates": replicates, "grid": grid,
                  "seed": None if seed == DEFAULT_SEED else seed,
                  "target-error": target_error, "regions": regions, "shape-grid": shape_grid,
                  "dry-run": dry_run or None, "resume": resume or None,
                  "scheduler": scheduler}  # fmt: skip
        for name, value in unused.items():
            if value is not None:
                raise InputError(f"--{name}: not together with --certify, which samples nothing")
        _certify(
            mechanism, options.design_parameters(mechanism, params), settings, certify,
            (time_budget, box_budget), out, force, form, quiet,
        )  # fmt: skip
        return
    for name, value in {"time-budget": time_budget, "box-budget": box_budget}.items():
        if value is not None:
            raise InputError(f"--{name}: only together with --certify")
    dimension = len(mechanism.pose)
    cells = DEFAULT_GRIDS[dimension] if shape_grid is None else shape_grid
    task = WorkspaceTask(
        mechanism,
        options.design_parameters(mechanism, params),
        settings,
        seed,
        check_cells(cells, dimension, "--shape-grid"),
    )
    notify = notifier(quiet)
    if dry_run:
        plan = workspace_run.plan(task, threads, notify)
        emit(form, plan.to_dict(), [plan.table()])
        return
    options.check_resume(resume, force, out)
    if out is not None:
        if resume and workspace_run.finished(task, out):
            notify(f"{out} holds this run, finished: nothing to do")
            return
        options.set_resume_hint(f"; continue with: {options.resuming()}")
    with (
        connect(scheduler, notify) as cluster,
        progress_bar(quiet, f"workspace {mechanism.name}", "points") as progress,
    ):
        result = workspace_run.run_workspace(
            task, out, force=force, resume=resume, threads=threads, notify=notify,
            progress=progress, cluster=cluster,
        )  # fmt: skip
    emit(
        form, result.to_dict(), workspace_tables(result), [workspace_data(result)]
    )  # fmt: skip
    if out is not None:
        notify(f"written to {out}")


def _certify(
    mechanism: Mechanism, parameters: Parameters, settings: WorkspaceSettings, gap: float,
    budgets: tuple[float | None, int | None], out: Path | None, force: bool, form: str,
    quiet: bool,
) -> None:  # fmt: skip
    from pmopt.analysis.workspace.emptiness import nothing_reachable
    from pmopt.reporting.runs import certify_run

    notify = notifier(quiet)
    result = certify_run.run_volume(
        mechanism, parameters, settings, gap, certify_run.Budgets(*budgets), out, force=force,
        notify=notify,
    )  # fmt: skip
    emit(
        form, result.to_dict(), certify_run.volume_tables(result),
        certify_run.certified_data(result),
    )  # fmt: skip
    if out is not None:
        notify(f"written to {out}")
    if result.empty:
        raise nothing_reachable(mechanism, parameters, settings, "workspace")

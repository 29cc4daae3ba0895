"""``pmopt export``."""

from __future__ import annotations

from pathlib import Path

import click

from pmopt.cli import options
from pmopt.cli.output import emit, notifier
from pmopt.errors import InputError
from pmopt.mechanisms import Mechanism
from pmopt.reporting.tables.table import Table


@click.command("export")
@options.mechanism_argument
@click.option("--pose", multiple=True, metavar="NAME=VALUE,..", help="Default: the home pose.")
@options.params_option
@click.option("--working-mode", help="Default: the mechanism's first.")
@options.limits_option
@click.option("--step", type=click.FloatRange(1e-6, 0.1), default=0.001, show_default=True,
              metavar="S", help="The engine's step in s.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="FILE.xml|.mjcf",
              help="The model.")  # fmt: skip
@click.option("--force", is_flag=True, help="Overwrite the file.")
@options.common_options
def export_command(
    mechanism: Mechanism, pose: tuple[str, ...], params: tuple[str, ...],
    working_mode: str | None, limits: tuple[str, ...], step: float, out: Path,
    force: bool, form: str, quiet: bool,
    debug: bool,
) -> None:  # fmt: skip
    """Write the mechanism as a MuJoCo model (MJCF): links, masses, joints, loops, motors.

    \b
    Example:
      pmopt export 2uu-upu --out 2uu-upu.xml --force
    """
    from pmopt.analysis.multibody.mjcf import to_mjcf
    from pmopt.analysis.multibody.model import declared_tree
    from pmopt.storage.files import write_atomic

    if out.suffix.lower() not in (".xml", ".mjcf"):
        raise InputError(
            f"--out: {out}: {out.suffix or 'no suffix'} is not offered, allowed: .xml, .mjcf "
            "(MuJoCo)"
        )
    if out.exists() and not force:
        raise InputError(f"--out: {out} exists; --force overwrites it")
    parameters = options.design_parameters(mechanism, params)
    mode = mechanism.check_mode(working_mode, "--working-mode")
    given = options.split_pairs(pose, "--pose") if pose else mechanism.home(parameters)
    at = mechanism.check_coordinates(given, mechanism.pose, "--pose")
    tree = declared_tree(
        mechanism, parameters, at, mode, "--pose",
        options.parse_ranges(limits, "--limits", mechanism),
    )  # fmt: skip
    write_atomic(out, to_mjcf(tree, step))
    notifier(quiet)(f"written to {out}")
    rows = tuple(
        (link.name, sum(body.mass for body in link.bodies), len(link.freedoms),
         ", ".join(f.name for f in link.freedoms if f.actuated) or None)
        for link in tree.links
    )  # fmt: skip
    emit(
        form,
        {"mechanism": mechanism.name, "file": str(out), "pose": at, "working_mode": mode,
         "links": [dict(zip(("name", "mass", "joints", "actuated"), row, strict=True))
                   for row in rows],
         "loops": [closure.name for closure in tree.closures],
         "units": {**{c.name: mechanism.unit(c) for c in mechanism.pose}, "mass": "kg"}},
        [Table(f"{mechanism.name}, {mode}: links of the model",
               ("link", "mass", "joints", "actuated"), rows, {"mass": "kg"},
               (f"loops closed at the end of {', '.join(c.name for c in tree.closures)}",))],
    )  # fmt: skip

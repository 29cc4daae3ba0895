"""``pmopt draw``."""

from __future__ import annotations

from pathlib import Path

import click

from pmopt.analysis.kinematics.inverse import inverse_kinematics, reached
from pmopt.cli import options
from pmopt.cli.output import emit, notifier
from pmopt.errors import InputError
from pmopt.mechanisms import Mechanism
from pmopt.reporting.tables.table import Table


@click.command("draw")
@options.mechanism_argument
@click.option("--pose", multiple=True, metavar="NAME=VALUE,..", help="Default: the home pose.")
@options.params_option
@click.option("--working-mode", help="Default: the mechanism's first.")
@options.limits_option
@click.option("--out", type=options.Place(), required=True, metavar="FILE.png|.svg|.pdf",
              help="The picture.")  # fmt: skip
@click.option("--force", is_flag=True, help="Overwrite the file.")
@options.common_options
def draw_command(
    mechanism: Mechanism, pose: tuple[str, ...], params: tuple[str, ...],
    working_mode: str | None, limits: tuple[str, ...], out: Path, force: bool,
    form: str, quiet: bool, debug: bool,
) -> None:  # fmt: skip
    """Draw the mechanism at a pose: links, joints, platform.

    \b
    Example:
      pmopt draw 3-cur --pose z=0.35,beta=0.25,gamma=0.15 --out 3-cur.png --force
    """
    from pmopt.reporting.pictures.drawing import draw_mechanism
    from pmopt.reporting.pictures.gallery import wanted
    from pmopt.reporting.pictures.style import drawn_as, form_of
    from pmopt.storage.files import write_atomic

    form_of(out, "--out")
    if out.exists() and not force:
        raise InputError(f"--out: {out} exists; --force overwrites it")
    parameters = options.design_parameters(mechanism, params)
    mode = mechanism.check_mode(working_mode, "--working-mode")
    given = options.split_pairs(pose, "--pose") if pose else mechanism.home(parameters)
    ranges = options.parse_ranges(limits, "--limits", mechanism)
    found = inverse_kinematics(mechanism, parameters, given, mode, ranges, "--pose")
    reached(mechanism, found, "--pose")
    with drawn_as(form_of(out, "--out")), wanted(str(out)):
        picture = draw_mechanism(mechanism, parameters, found.pose, mode)
    try:
        write_atomic(out, picture)
    except OSError as error:
        raise InputError(f"--out: {out}: cannot write: {error.strerror or error}") from None
    notifier(quiet)(f"written to {out}")
    rows = tuple((name, value, found.units[name]) for name, value in found.pose.items())
    emit(
        form,
        {"mechanism": mechanism.name, "file": str(out), "pose": found.pose, "working_mode": mode,
         "units": found.units},
        [Table(f"{mechanism.name}, {mode}", ("coordinate", "value", "unit"), rows, {})],
    )  # fmt: skip

"""``pmopt ik``, ``pmopt fk`` and ``pmopt jacobian``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pmopt.analysis import kinematics
from pmopt.analysis.kinematics import ForwardResult, InverseResult
from pmopt.analysis.rows import read_rows
from pmopt.cli import options
from pmopt.cli.output import emit, notifier
from pmopt.errors import InputError, UnreachableError
from pmopt.mechanisms import Mechanism
from pmopt.reporting import tables


def _one_of(inline: tuple[str, ...], path: Path | None, names: str) -> None:
    if bool(inline) == (path is not None):
        raise InputError(f"{names}: exactly one of the two is needed")


def _raise_misses(misses: list[str], count: int) -> None:
    """Raise one error for all rows that are out of reach."""
    if misses:
        raise UnreachableError(f"{misses[0]} ({len(misses)} of {count} rows)")


@click.command("ik")
@options.mechanism_argument
@click.option("--pose", multiple=True, metavar="NAME=VALUE,..", help="The pose.")
@click.option("--poses", type=options.Place(), metavar="FILE.csv", help="Many poses.")
@options.params_option
@click.option("--working-mode", default="all", show_default=True, help="A working mode, or all.")
@click.option("--limits", multiple=True, metavar="JOINT=LOWER:UPPER,..",
              help="Joint limits that within_limits holds against.")  # fmt: skip
@options.common_options
def ik_command(
    mechanism: Mechanism, pose: tuple[str, ...], poses: Path | None, params: tuple[str, ...],
    working_mode: str, limits: tuple[str, ...], form: str, quiet: bool, debug: bool,
) -> None:  # fmt: skip
    """Inverse kinematics: the joint positions of a pose in all working modes.

    A mode that exists but is not within its limits is listed, with what it exceeds and by how much.
    Exit code 2 where no mode at all keeps the mechanism's own strokes.

    \b
    Example:
      pmopt ik 2pauu-ppap --pose x=0.1,y=0.2,z=1.2
    """
    _one_of(pose, poses, "--pose, --poses")
    given = options.design_parameters(mechanism, params)
    ranges = options.parse_ranges(limits, "--limits", mechanism)
    mechanism.check_ranges(ranges, mechanism.limited, "--limits")
    if working_mode != "all":
        mechanism.check_mode(working_mode, "--working-mode")

    def solve(values: dict[str, Any], where: str) -> InverseResult:
        return kinematics.inverse_kinematics(
            mechanism, given, values, working_mode, ranges, where=where
        )

    if poses is None:
        result = solve(options.split_pairs(pose, "--pose"), "--pose")
        emit(form, result.to_dict(), [tables.inverse_table([result])])
        if result.out_of_reach is not None:
            raise UnreachableError(result.out_of_reach)
        return
    rows = read_rows(poses, "--poses", mechanism, mechanism.pose)
    for note in rows.notes:
        notifier(quiet)(note)

    results: list[InverseResult] = []
    misses: list[str] = []
    for line, row in zip(rows.lines, rows.poses(), strict=True):
        try:
            results.append(solve(row, f"--poses: {poses}, line {line}"))
        except UnreachableError as error:
            misses.append(str(error))
            checked = mechanism.check_coordinates(row, mechanism.pose, "--poses")
            results.append(kinematics.no_inverse(mechanism, checked))
        else:
            misses += filter(None, [results[-1].out_of_reach])
    emit(form, [r.to_dict() for r in results], [tables.inverse_table(results, many=True)])
    _raise_misses(misses, len(rows.lines))


@click.command("fk")
@options.mechanism_argument
@click.option("--joints", multiple=True, metavar="NAME=VALUE,..", help="The joint positions.")
@click.option("--joints-file", type=options.Place(), metavar="FILE.csv",
              help="Many joint positions.")  # fmt: skip
@click.option(
    "--near",
    multiple=True,
    metavar="NAME=VALUE,..",
    help="A pose: only the assembly mode nearest to it.",
)
@options.params_option
@options.common_options
def fk_command(
    mechanism: Mechanism, joints: tuple[str, ...], joints_file: Path | None, near: tuple[str, ...],
    params: tuple[str, ...], form: str, quiet: bool, debug: bool,
) -> None:  # fmt: skip
    """Forward kinematics: the poses the joint positions can be assembled in, nearest to home first.

    Real solutions only. "complete" says whether it is proven that there are no others: by a closed
    form (2pauu-ppap, 2uu-upu) or by counting the real roots of a polynomial of degree 8 (3-ups-sp,
    3-cur; not next to a singularity). For 4-ups-rps it is checked, not proven.

    \b
    Example:
      pmopt fk 2pauu-ppap --joints theta1=0.4,theta2=0.1,d=0.2
    """
    _one_of(joints, joints_file, "--joints, --joints-file")
    goal = options.split_pairs(near, "--near") if near else None
    kinematics.Assembling(mechanism).say(notifier(quiet))
    given = options.design_parameters(mechanism, params)

    if joints_file is None:
        values = options.split_pairs(joints, "--joints")
        result = kinematics.forward_kinematics(mechanism, given, values, "--joints", goal)
        emit(form, result.to_dict(), [tables.forward_table([result])])
        return
    rows = read_rows(joints_file, "--joints-file", mechanism, mechanism.joints)
    for note in rows.notes:
        notifier(quiet)(note)
    places = [f"--joints-file: {joints_file}, line {line}" for line in rows.lines]
    table = rows.poses()
    results: list[ForwardResult] = []
    misses: list[str] = []
    found = kinematics.forward_many(mechanism, given, table, places, goal)
    for row, one in zip(table, found, strict=True):
        if isinstance(one, UnreachableError):
            misses.append(str(one))
            checked = mechanism.check_coordinates(row, mechanism.joints, "--joints-file")
            one = kinematics.no_forward(mechanism, checked)
        results.append(one)
    emit(form, [r.to_dict() for r in results], [tables.forward_table(results, many=True)])
    _raise_misses(misses, len(rows.lines))


@click.command("jacobian")
@options.mechanism_argument
@click.option("--pose", multiple=True, required=True, metavar="NAME=VALUE,..", help="The pose.")
@options.params_option
@click.option("--working-mode", help="Default: the mechanism's first.")
@options.limits_option
@options.jacobian_options[0]
@options.jacobian_options[1]
@options.jacobian_options[2]
@options.common_options
def jacobian_command(
    mechanism: Mechanism, pose: tuple[str, ...], params: tuple[str, ...],
    working_mode: str | None, limits: tuple[str, ...], kind: Any,
    characteristic_length: float | str | None, norm: str,
    form: str, quiet: bool, debug: bool,
) -> None:  # fmt: skip
    """Jacobian, singular values, LCI and the distance to singularities at a pose.

    \b
    Example:
      pmopt jacobian 2pauu-ppap --pose x=0.1,y=0.2,z=1.2
    """
    result = kinematics.jacobian_at(
        mechanism,
        options.design_parameters(mechanism, params),
        options.split_pairs(pose, "--pose"),
        mechanism.check_mode(working_mode, "--working-mode"),
        kind=kind,
        characteristic_length=characteristic_length,
        norm=norm,
        limits=options.parse_ranges(limits, "--limits", mechanism),
        where="--pose",
    )
    emit(
        form, result.to_dict(), tables.jacobian_tables(result), [tables.jacobian_data(result)]
    )  # fmt: skip

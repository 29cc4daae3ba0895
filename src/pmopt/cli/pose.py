"""``pmopt ik``, ``pmopt fk`` and ``pmopt jacobian``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np

from pmopt.analysis.kinematics.forward import Assembling, ForwardResult
from pmopt.analysis.kinematics.inverse import (
    InverseResult,
    Inverting,
    OutOfReach,
    inverse_kinematics,
)
from pmopt.analysis.kinematics.jacobian import Index, JacobianResult, Jacobians
from pmopt.analysis.kinematics.pose_rows import Rows, read_rows
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.cli import options
from pmopt.cli.fields import Sectioned, option_of, options_of
from pmopt.cli.output import emit, notifier
from pmopt.errors import InputError, UnreachableError
from pmopt.mechanisms import Mechanism
from pmopt.mechanisms.mechanism import LARGEST_COORDINATE, Coordinate
from pmopt.reporting.tables import kinematics as tables
from pmopt.reporting.tables.streams import BLOCK, Stream, form_of

_Block = tuple[list[dict[str, float]], list[str]]


#: What follows the number of rows that a table leaves out.
_MORE = "--format csv, or --out FILE, gives all"
_out_options = (
    click.option("--out", type=options.Place(), metavar="FILE.csv|.json",
                 help="With many rows: a file of all of them, beside the printed output."),
    click.option("--force", is_flag=True, help="Overwrite the file."),
)  # fmt: skip


def _one_of(inline: tuple[str, ...], path: Path | None, names: str) -> None:
    if bool(inline) == (path is not None):
        raise InputError(f"{names}: exactly one of the two is needed")


def _check_out(out: Path | None, force: bool, many: str, path: Path | None) -> None:
    """Refuse a file that cannot be written, before anything is computed."""
    if out is None:
        return
    if path is None:
        raise InputError(f"--out: only together with {many}")
    form_of(out, "--out")
    if out.exists() and not force:
        raise InputError(f"--out: {out} exists; --force overwrites it")


class _Misses:
    """How many rows are out of reach, and the first of them."""

    def __init__(self) -> None:
        self.count = self.rows = 0
        self.first = ""

    def take(self, reason: Callable[[], object]) -> None:
        """Take a row that is out of reach."""
        self.first = self.first or str(reason())
        self.count += 1

    def settle(self) -> None:
        """Raise one error for all rows that are out of reach."""
        if self.count:
            raise UnreachableError(f"{self.first} ({self.count} of {self.rows} rows)")


def _blocks(rows: Rows, option: str, path: Path, misses: _Misses) -> Iterator[_Block]:
    """Yield the rows of a file, some at a time, with what errors call them."""
    for first in range(0, len(rows), BLOCK):
        part = rows.poses(first, first + BLOCK)
        lines = rows.lines[first : first + BLOCK].tolist()
        misses.rows += len(part)
        yield part, [f"{option}: {path}, line {line}" for line in lines]


def _emit(stream: Stream[Any], form: str, title: str, out: Path | None, quiet: bool) -> None:
    """Print results as they come, or the first rows of their table, and write them to a file."""
    if out is not None:
        stream = stream.write(out, form_of(out, "--out"))
    if form == "table":
        emit(form, None, [stream.head(title, _MORE)])
    else:
        for _, text in stream.pieces(form):
            click.echo(text, nl=False)
    if out is not None:
        notifier(quiet)(f"written to {out}")


@click.command("ik")
@options.mechanism_argument
@click.option("--pose", multiple=True, metavar="NAME=VALUE,..", help="The pose.")
@click.option("--poses", type=options.Place(), metavar="FILE.csv", help="Many poses.")
@options.params_option
@click.option("--working-mode", default="all", show_default=True, help="A working mode, or all.")
@click.option("--limits", multiple=True, metavar="JOINT=LOWER:UPPER,..",
              help="Joint limits for within_limits.")  # fmt: skip
@_out_options[0]
@_out_options[1]
@options.common_options
def ik_command(
    mechanism: Mechanism, pose: tuple[str, ...], poses: Path | None, params: tuple[str, ...],
    working_mode: str, limits: tuple[str, ...], out: Path | None, force: bool,
    form: str, quiet: bool, debug: bool,
) -> None:  # fmt: skip
    """Inverse kinematics: the joint positions of a pose in all working modes.

    A mode that closes the limbs but exceeds a limit is listed, with the limit and by how much. The
    exit code is 2 where no mode at all keeps the mechanism's own strokes.

    Many poses are solved some hundred at a time: rows of CSV and JSON come as they are solved, a
    table shows the first 20.

    \b
    Example:
      pmopt ik 2pauu-ppap --pose x=0.1,y=0.2,z=1.2
    """
    _one_of(pose, poses, "--pose, --poses")
    _check_out(out, force, "--poses", poses)
    given = options.design_parameters(mechanism, params)
    ranges = options.parse_ranges(limits, "--limits", mechanism)
    mechanism.check_ranges(ranges, mechanism.limited, "--limits")
    if working_mode != "all":
        mechanism.check_mode(working_mode, "--working-mode")
    if poses is None:
        values = options.split_pairs(pose, "--pose")
        result = inverse_kinematics(mechanism, given, values, working_mode, ranges, "--pose")
        emit(form, result.to_dict(), [tables.inverse_table([result])])
        if result.out_of_reach is not None:
            raise UnreachableError(result.out_of_reach)
        return
    rows = _read(poses, "--poses", mechanism, mechanism.pose, quiet)
    solver = Inverting(mechanism, given, working_mode, ranges)
    solver.say(notifier(quiet))
    misses = _Misses()

    def solved() -> Iterator[list[InverseResult]]:
        for part, places in _blocks(rows, "--poses", poses, misses):
            results = []
            for one in solver.at(part, places):
                if isinstance(one, OutOfReach):
                    misses.take(one.error)
                    one = solver.nothing(one.pose)
                elif one.out_of_reach is not None:
                    misses.take(partial(str, one.out_of_reach))
                results.append(one)
            yield results

    stream = Stream(
        solved(), lambda some, first: tables.inverse_table(some, True, first),
        InverseResult.to_dict, lambda one: max(len(one.solutions), 1),
    )  # fmt: skip
    _emit(stream, form, f"{mechanism.name}, {{count}} poses", out, quiet)
    misses.settle()


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
@_out_options[0]
@_out_options[1]
@options.common_options
def fk_command(
    mechanism: Mechanism, joints: tuple[str, ...], joints_file: Path | None, near: tuple[str, ...],
    params: tuple[str, ...], out: Path | None, force: bool, form: str, quiet: bool, debug: bool,
) -> None:  # fmt: skip
    """Forward kinematics: the assembly modes at given joint positions, nearest to home first.

    Real solutions only. "complete" says whether it is proven that there are no others: by a closed
    form (2pauu-ppap, 2uu-upu) or by counting the real roots of a polynomial of degree 8 (3-ups-sp,
    3-cur; not next to a singularity). For 4-ups-rps it is checked, not proven.

    \b
    Example:
      pmopt fk 2pauu-ppap --joints theta1=0.4,theta2=0.1,d=0.2
    """
    _one_of(joints, joints_file, "--joints, --joints-file")
    _check_out(out, force, "--joints-file", joints_file)
    goal = options.split_pairs(near, "--near") if near else None
    solver = Assembling(mechanism, options.design_parameters(mechanism, params), goal)
    solver.say(notifier(quiet))

    if joints_file is None:
        (result,) = solver.at([options.split_pairs(joints, "--joints")], ["--joints"])
        if isinstance(result, UnreachableError):
            raise result
        emit(form, result.to_dict(), [tables.forward_table([result])])
        return
    rows = _read(joints_file, "--joints-file", mechanism, mechanism.joints, quiet)
    misses = _Misses()

    def solved() -> Iterator[list[ForwardResult]]:
        for part, places in _blocks(rows, "--joints-file", joints_file, misses):
            results = []
            for row, one in zip(part, solver.at(part, places), strict=True):
                if isinstance(one, UnreachableError):
                    misses.take(partial(str, one))
                    one = solver.nothing(row, "--joints-file")
                results.append(one)
            yield results

    stream = Stream(
        solved(), lambda some, first: tables.forward_table(some, True, first),
        ForwardResult.to_dict, lambda one: max(len(one.solutions), 1),
    )  # fmt: skip
    _emit(stream, form, f"{mechanism.name}, {{count}} rows", out, quiet)
    misses.settle()


@click.command("jacobian", cls=Sectioned)
@options.mechanism_argument
@click.option("--pose", multiple=True, metavar="NAME=VALUE,..", help="The pose.")
@click.option("--poses", type=options.Place(), metavar="FILE.csv", help="Many poses, a row each.")
@options.params_option
@click.option("--working-mode", help="Default: the mechanism's first.")
@options.limits_option
@option_of(WorkspaceSettings, "jacobian", "kind")
@options_of(WorkspaceSettings, only=("characteristic_length", "norm"))
@_out_options[0]
@_out_options[1]
@options.common_options
def jacobian_command(
    mechanism: Mechanism, pose: tuple[str, ...], poses: Path | None, params: tuple[str, ...],
    working_mode: str | None, limits: tuple[str, ...], kind: Any,
    characteristic_length: float | str | None, norm: str | None, out: Path | None, force: bool,
    form: str, quiet: bool, debug: bool,
) -> None:  # fmt: skip
    """Jacobian, singular values, LCI and the distance to singularities at a pose, or at many.

    With many poses each is a row: indices, singular values, distances and determinants, and whether
    it is singular. The row of a pose out of reach is empty, and the exit code is then 2.

    \b
    Example:
      pmopt jacobian 2pauu-ppap --pose x=0.1,y=0.2,z=1.2
    """
    _one_of(pose, poses, "--pose, --poses")
    _check_out(out, force, "--poses", poses)
    asked = Jacobians(
        mechanism,
        options.design_parameters(mechanism, params),
        mechanism.check_mode(working_mode, "--working-mode"),
        Index(kind, characteristic_length, norm or "2"),
        options.parse_ranges(limits, "--limits", mechanism),
    )
    if poses is None:
        (result,) = asked.at([options.split_pairs(pose, "--pose")], ["--pose"])
        if isinstance(result, OutOfReach):
            raise result.error()
        emit(
            form, result.to_dict(), tables.jacobian_tables(result), [tables.jacobian_data(result)]
        )  # fmt: skip
        return
    rows = _read(poses, "--poses", mechanism, mechanism.pose, quiet)
    asked.inverting.say(notifier(quiet))
    misses = _Misses()

    def solved() -> Iterator[list[JacobianResult | OutOfReach]]:
        for part, places in _blocks(rows, "--poses", poses, misses):
            results = asked.at(part, places)
            for one in results:
                if isinstance(one, OutOfReach):
                    misses.take(one.error)
            yield results

    stream = Stream(
        solved(),
        lambda some, first: tables.jacobians_table(some, asked, first),
        lambda one: tables.jacobian_document(one, asked),
    )
    title = f"{mechanism.name}, {asked.mode}, {{count}} poses"
    _emit(stream, form, title, out, quiet)
    misses.settle()


def _read(
    path: Path, option: str, mechanism: Mechanism, coordinates: tuple[Coordinate, ...], quiet: bool
) -> Rows:
    """Return the rows of a file, all checked; notes go to stderr."""
    rows = read_rows(path, option, mechanism, coordinates)
    for note in rows.notes:
        notifier(quiet)(note)
    for coordinate in coordinates:
        far = np.flatnonzero(np.abs(rows.columns[coordinate.name]) > LARGEST_COORDINATE)
        for k in far[:1].tolist():
            place = f"{option}: {path}, line {rows.lines[k]}"
            mechanism.check_coordinates(rows.poses(k, k + 1)[0], coordinates, place)
    return rows

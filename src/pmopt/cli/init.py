"""``pmopt init``."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import click

from pmopt.cli.options import Place, common_options
from pmopt.cli.output import emit
from pmopt.errors import InputError, unknown_name
from pmopt.inputs.examples import Example, examples, find_example
from pmopt.inputs.reading import read_file
from pmopt.mechanisms import Mechanism, find, names
from pmopt.reporting.runs.starting_config import KINDS
from pmopt.reporting.tables.table import Table
from pmopt.storage.files import put, remove_staged, stage

_MECHANISM = "2pauu-ppap"
#: As ``--out``: to stdout.
_STDOUT = Path("-")


def _complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    return [name for name in (*KINDS, *names()) if name.startswith(incomplete.lower())]


def _complete_example(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    return [e.name for e in examples() if e.name.startswith(incomplete)]


@click.command("init")
@click.argument("words", nargs=-1, metavar="[KIND] [MECH]", shell_complete=_complete)
@click.option("--list", "listed", is_flag=True,
              help="List kinds and examples, and write nothing.")  # fmt: skip
@click.option("--example", metavar="NAME", shell_complete=_complete_example,
              help="Write a shipped configuration, with the files it refers to."
              )  # fmt: skip
@click.option("--out", type=Place(), metavar="FILE.toml",
              help="Default: <mechanism>.toml, or the example's name, in this folder; - is "
              "stdout.")  # fmt: skip
@click.option("--force", is_flag=True, help="Overwrite the file.")
@common_options
def init_command(
    words: tuple[str, ...], listed: bool, example: str | None, out: Path | None, force: bool,
    form: str, quiet: bool, debug: bool,
) -> None:  # fmt: skip
    """Write a commented starting configuration, or one of the examples.

    KIND is the kind of run: pareto (default), motion, batch or workspace.

    \b
    Example:
      pmopt init 2pauu-ppap --out my-design.toml
      pmopt init motion 3-cur --out my-motion.toml
      pmopt init --example quickstart
    """
    if listed:
        if words or example is not None or out is not None:
            raise InputError("--list: not together with KIND, MECH, --example or --out")
        _emit_list(form)
        return
    if example is not None:
        if words:
            raise InputError(f"--example: not together with {' '.join(words)}")
        found = find_example(example)
        text, command = read_file(found.path), found.kind
        path = out or Path(found.path.name)
        beside = {path.parent / p.name: read_file(p) for p in found.beside}
    else:
        kind, mechanism = _asked(words)
        text, command = KINDS[kind].text(mechanism).encode(), KINDS[kind].command
        mark = "" if kind == "pareto" else f"-{kind}"
        path, beside = out or Path(f"{mechanism.name}{mark}.toml"), {}
    if path == _STDOUT:
        click.echo(text.decode(), nl=False)
        if beside and not quiet:
            click.echo(f"it refers to files beside it, which --out FILE writes: "
                       f"{', '.join(p.name for p in beside)}", err=True)  # fmt: skip
        return
    _write({path: text, **beside}, force)
    row = (str(path), f"pmopt {command} {path}")
    document = {"written": row[0], "files": [row[0], *map(str, beside)], "run": row[1]}
    notes = (f"with it: {', '.join(map(str, beside))}",) if beside else ()
    emit(form, document, [Table("Written", ("file", "run"), (row,), {}, notes)])


def _asked(words: Sequence[str]) -> tuple[str, Mechanism]:
    """Return the kind and the mechanism that are asked for, in any order."""
    kinds = [word for word in words if word.lower() in KINDS]
    others = [word for word in words if word not in kinds]
    if len(kinds) > 1 or len(others) > 1:
        raise InputError(f"{' '.join(words)}: one KIND and one MECH are needed, see init --list")
    kind = kinds[0].lower() if kinds else "pareto"
    try:
        return kind, find(others[0] if others else _MECHANISM)
    except InputError:
        if kinds:
            raise
        raise unknown_name("kind or mechanism", others[0], [*KINDS, *names()]) from None


def _write(files: dict[Path, bytes], force: bool) -> None:
    """Write all files or none; files with the same content stay untouched.

    Raises
    ------
    PmoptError
    """
    first = next(iter(files))
    for path, data in files.items():
        if force or not os.path.lexists(path) or (path != first and _holds(path, data)):
            continue
        raise InputError(f"--out: {path} exists; another name or --force is needed")
    with ExitStack() as stack:
        staged = {}
        for path, data in reversed(files.items()):  # the configuration last: with it all is there
            staged[path] = stage(path, data)
            stack.callback(remove_staged, [staged[path]])
        for path, temporary in staged.items():
            put(temporary, path)


def _holds(path: Path, data: bytes) -> bool:
    try:
        return read_file(path) == data
    except OSError:
        return False


def _emit_list(form: str) -> None:
    found = examples()
    document = {
        "kinds": [
            {"kind": name, "about": kind.about, "mechanisms": names(), "run_by": kind.command}
            for name, kind in KINDS.items()
        ],
        "examples": [
            {"example": e.name, "kind": e.kind, "mechanism": e.mechanism, "about": e.about,
             "files": [e.path.name, *(p.name for p in e.beside)]}
            for e in found
        ],
    }  # fmt: skip
    kinds = tuple((name, kind.about, f"pmopt {kind.command}") for name, kind in KINDS.items())
    emit(form, document, [
        Table("Examples: pmopt init --example EXAMPLE",
              ("example", "kind", "mechanism", "about"), tuple(map(_row, found)), {},
              key="example"),
        Table("Starting configurations: pmopt init KIND MECH", ("kind", "about", "run_by"), kinds,
              {}, (f"of each mechanism: {', '.join(names())}",), key="kind"),
    ])  # fmt: skip


def _row(example: Example) -> tuple[str, str, str, str]:
    return example.name, example.kind, example.mechanism, example.about

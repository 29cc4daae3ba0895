"""Entry point: errors as one line, exit codes."""

from __future__ import annotations

import os
import sys
import warnings
from typing import Any

import click

from pmopt.cli import interrupt
from pmopt.cli.commands import cli
from pmopt.cli.encoding import make_lenient
from pmopt.cli.interrupt import Interrupted
from pmopt.errors import InputError, PmoptError

#: Longest line of an error, in characters: what a damaged file holds may be of any length.
_LONGEST = 2000
EXIT_RUNTIME, EXIT_USAGE, EXIT_INFEASIBLE, EXIT_INTERRUPTED = 1, 2, 3, 130


def _fail(message: str, code: int) -> int:
    line = " ".join(message.split())
    if len(line) > _LONGEST:
        line = f"{line[: _LONGEST // 2]} .. {line[-_LONGEST // 2 :]}"
    click.echo(f"error: {line}", err=True)
    return code


def run(args: list[str] | None = None) -> int:
    """Run the command line and return the exit code; only ``--debug`` lets a traceback out."""
    words = sys.argv[1:] if args is None else args
    if words[:1] == ["help"]:
        words = [*words[1:], "--help"]
    debug = "--debug" in words
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the shell: no file of a run may take its place
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
    make_lenient()
    pythons = warnings.showwarning
    _warn_in_one_line("--quiet" in words)
    try:
        _check_target()
        result: Any = cli.main(words, prog_name="pmopt", standalone_mode=False, obj=list(words))
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except PmoptError as error:
        if debug:
            raise
        for line in error.lines[:-1]:
            _fail(line, error.exit_code)
        return _fail(error.lines[-1], error.exit_code)
    except click.ClickException as error:
        from pmopt.cli.mistakes import explain

        return _fail(explain(error, words), EXIT_USAGE)
    except (Interrupted, KeyboardInterrupt, click.Abort):
        interrupt.disarm()
        hint = _resume_hint()
        return _fail(f"interrupted{hint}", EXIT_INTERRUPTED)
    except BrokenPipeError:
        # The reader of our output has gone; nothing is left to say, not even at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_RUNTIME
    except OSError as error:
        if debug:
            raise
        place = error.filename or "output"
        return _fail(f"{place}: {error.strerror or error}", EXIT_RUNTIME)
    except MemoryError:
        return _fail("out of memory: fewer samples, a smaller grid or population", EXIT_RUNTIME)
    except SystemExit as error:  # click's own answer to a closed stdout
        return error.code if isinstance(error.code, int) else EXIT_RUNTIME
    except Exception as error:
        if debug:
            raise
        return _fail(
            f"unexpected {type(error).__name__}: {error} (--debug shows where)", EXIT_RUNTIME
        )
    finally:
        warnings.showwarning = pythons


def _warn_in_one_line(quiet: bool) -> None:
    """Print warnings about plug-ins as a line of ours; others are Python's."""
    pythons = warnings.showwarning

    def show(message: Any, category: Any, *place: Any, **more: Any) -> None:
        if category.__name__ != "PluginWarning":
            pythons(message, category, *place, **more)
        elif not quiet:
            line = " ".join(str(message).split())
            click.echo(f"warning: {line[:_LONGEST]}", err=True)

    warnings.showwarning = show


def _check_target() -> None:
    """Refuse a target that there is not, before anything is compiled for it."""
    if os.environ.get("PMOPT_TARGET"):  # else nothing of it is imported
        from pmopt.compiler.machine_code import target

        try:
            target()
        except ValueError as error:
            raise InputError(str(error)) from None


def _resume_hint() -> str:
    options = sys.modules.get("pmopt.cli.options")
    return getattr(options, "resume_hint", "") if options else ""

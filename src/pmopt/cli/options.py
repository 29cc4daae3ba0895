"""Options shared by subcommands, and the parsing of their values."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from pmopt.analysis.kinematics.pose_rows import parse_number
from pmopt.errors import InputError
from pmopt.execution.threads import odd_threads
from pmopt.inputs.fields import LENGTH
from pmopt.inputs.quantities import QuantityError, as_quantity, in_degrees
from pmopt.mechanisms import Mechanism, find, names
from pmopt.units import ANGLE, ONE

Function = TypeVar("Function", bound=Callable[..., Any])

#: Said after "interrupted" when the run can be taken up again.
resume_hint = ""


def set_resume_hint(text: str) -> None:
    """Set what an interrupted run says about taking it up again."""
    global resume_hint
    resume_hint = text


def resuming() -> str:
    """Return this command's line, with what takes up the run that it leaves."""
    words = [word for word in click.get_current_context().obj if word != "--force"]
    return shlex.join(["pmopt", *words, *([] if "--resume" in words else ["--resume"])])


resume_option = click.option(
    "--resume", is_flag=True, help="Continue the run in --out where it stopped."
)


def check_resume(resume: bool, force: bool, out: Path | None) -> None:
    """Refuse --resume where there is nothing it could mean.

    Raises
    ------
    InputError
    """
    if resume and force:
        raise InputError("--resume and --force exclude each other")
    if resume and out is None:
        raise InputError("--resume needs --out, the folder of the run")


def _complete_mechanism(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    return [name for name in names() if name.startswith(incomplete.lower())]


def _find(ctx: click.Context, param: click.Parameter, value: str) -> Mechanism:
    return find(value)


def _find_any(ctx: click.Context, param: click.Parameter, value: str) -> Mechanism:
    return find(value, checked=False)


def mechanism_argument(function: Function) -> Function:
    """Add the MECH argument, passed on as a Mechanism; a plug-in's is checked before."""
    return _mechanism_argument(_find)(function)


def any_mechanism_argument(function: Function) -> Function:
    """Add the MECH argument for what computes nothing with it."""
    return _mechanism_argument(_find_any)(function)


def _mechanism_argument(callback: Callable[..., Mechanism]) -> Callable[[Function], Function]:
    return click.argument(
        "mechanism", metavar="MECH", callback=callback, shell_complete=_complete_mechanism,
        is_eager=True,  # quantities are in its units
    )  # fmt: skip


def common_options(function: Function) -> Function:
    """Add --format, --quiet and --debug."""
    for option in (
        click.option("--debug", is_flag=True, help="Show tracebacks."),
        click.option("--quiet", is_flag=True, help="Print nothing but errors on stderr."),
        click.option(
            "--format", "form", type=click.Choice(["table", "json", "csv"]), default="table",
            show_default=True, help="Form of the result on stdout.",
        ),
    ):  # fmt: skip
        function = option(function)
    return function


class Place(click.Path):
    """The name of a file or folder; an empty one is a variable of the shell without value."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "" or "\0" in str(value):
            self.fail(f"{value!r} is not the name of a file or folder", param, ctx)
        return super().convert(value, param, ctx)


class Count(click.ParamType):  # type: ignore[type-arg]  # not generic in every click
    """A whole number, also written as 1e6 or 1_000_000."""

    name = "integer"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        try:
            return int(value)
        except ValueError:
            pass
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and number.is_integer()):
            self.fail(f"{value!r} is not a whole number", param, ctx)
        return int(number)


class Quantity(click.ParamType):  # type: ignore[type-arg]  # not generic in every click
    """A number, with a unit or in the one that is wanted; or one of some words.

    Parameters
    ----------
    unit : str
        ``length`` in it stands for the mechanism's unit of length.
    *words : str
    """

    name = "quantity"

    def __init__(self, unit: str, *words: str) -> None:
        self.unit, self.words = unit, words

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float | str:
        if value in self.words:
            return str(value)
        mechanism = ctx.params.get("mechanism") if ctx else None
        unit = self.unit.replace(LENGTH, getattr(mechanism, "length_unit", "m"))
        try:
            return as_quantity(value, unit)
        except QuantityError as error:
            allowed = "".join(f", or {word}" for word in self.words)
            self.fail(f"{error}{allowed}", param, ctx)


STRICT = "pmopt.strict"


def _set_strict(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    ctx.meta[STRICT] = value


_strict_option = click.option(
    "--strict", is_flag=True, is_eager=True, expose_value=False, callback=_set_strict,
    help="Refuse parameters beyond their bounds; otherwise they only cause a note.",
)  # fmt: skip


def params_option(function: Function) -> Function:
    """Add --params and --strict."""
    for option in (
        _strict_option,
        click.option(
            "--params", multiple=True, metavar="NAME=VALUE,..|@FILE|@RUN:DESIGN",
            help="Design parameters, with units or in the mechanism's, or the design of a TOML "
            "file, a run (@RUN:knee, @RUN:57, @RUN:best-volume), a front (@front.csv:57) or a "
            "manifest; repeatable. Those left out take their defaults.",
        ),
    ):  # fmt: skip
        function = option(function)
    return function


def config_options(function: Function) -> Function:
    """Add --set, passed on as ``sets``, and --strict."""
    for option in (
        _strict_option,
        click.option(
            "--set", "sets", multiple=True, metavar="KEY=VALUE",
            help="Replace a value of the file: a dotted key and its value, such as "
            "algorithm.population=50 or parameters.l1=650mm; repeatable.",
        ),
    ):  # fmt: skip
        function = option(function)
    return function


def _say_odd_threads(
    context: click.Context, parameter: click.Parameter, value: int | None
) -> int | None:
    """Say once that a variable left from elsewhere is not used."""
    line = odd_threads()
    quiet = "--quiet" in (context.find_root().obj or ())
    if line is not None and value is None and not quiet:
        click.echo(line, err=True)
    return value


threads_option = click.option(
    "--threads", type=click.IntRange(min=1, max=4096), callback=_say_odd_threads,
    help="Threads; the result does not depend on it. Default: $NUMBA_NUM_THREADS or all cores.",
)  # fmt: skip
scheduler_option = click.option(
    "--scheduler", metavar="ADDRESS",
    help="Dask scheduler to compute on, such as tcp://host:8786; the result does not depend on it.",
)  # fmt: skip
seed_option = click.option(
    "--seed", type=click.IntRange(min=0, max=2**63 - 1), default=1, show_default=True,
    help="Seed of all random numbers.",
)  # fmt: skip


def out_options(function: Function) -> Function:
    """Add --out and --force."""
    for option in (
        click.option("--force", is_flag=True, help="Overwrite a run in the folder."),
        click.option("--out", type=Place(), metavar="DIR", help="Folder of the run's files."),
    ):  # fmt: skip
        function = option(function)
    return function


def _meant(text: str) -> str:
    """Return the pairs that a text may have meant, where it is clear."""
    bare = re.sub(r"[\[\](){}]", "", text)
    if re.fullmatch(r"\s*[\w]+\s*=\s*[+-]?\d+,\d+\s*", bare) and bare == text:
        return f": a decimal point is needed, {text.replace(',', '.')}"
    if "[" in text and "=" in text:
        return ": a range is LOWER:UPPER, without brackets"
    pairs = re.findall(r"([A-Za-z_]\w*)\s*[=:]\s*([^\s;,=:]+)", bare)
    if not pairs:
        return "; each value needs a name"
    return f": {','.join(f'{name}={value}' for name, value in pairs)}?"


def split_pairs(texts: Sequence[str], option: str) -> dict[str, str]:
    """Return ``name=value`` pairs, comma-separated and repeatable, each name once."""
    pairs: dict[str, str] = {}
    for text in texts:
        for part in text.split(","):
            name, equals, value = part.partition("=")
            name, value = name.strip(), value.strip()
            if not equals or not name or not value or "=" in value:
                raise InputError(f"{option}: {part.strip()!r} is not NAME=VALUE{_meant(text)}")
            if name in pairs:
                raise InputError(f"{option}: {name} is given twice")
            pairs[name] = value
    return pairs


def design_parameters(mechanism: Mechanism, texts: Sequence[str]) -> dict[str, float | None]:
    """Return all design parameters, given inline or by the design of a file or a run.

    What is unusual about them is said on stderr; with ``--strict`` it is an error.
    """
    given: dict[str, Any] = {}
    notes: list[str] = []
    for text in texts:
        where = "--params"
        if text.startswith("@"):
            from pmopt.reporting.runs.designs import read_design

            where = f"--params: {text[1:]}"
            found = read_design(text[1:], mechanism, where)
            part = found.parameters
            notes += found.notes
        else:
            part = split_pairs([text], where)
        part = mechanism.plain_names(part, mechanism.parameters, where)
        mechanism.resolve(part, where)
        for name in part:
            if name in given:
                raise InputError(f"--params: {name} is given twice")
        given |= part
    resolved = mechanism.resolve(given, "--params")
    beyond = mechanism.beyond_bounds({k: resolved[k] for k in given}, "--params")
    say_unusual(beyond, notes)
    return resolved


def say_unusual(beyond: Sequence[str], notes: Sequence[str] = ()) -> None:
    """Say what is unusual about the input on stderr.

    Raises
    ------
    InputError
        With ``--strict``, for what is beyond its bounds.
    """
    context = click.get_current_context(silent=True)
    if context is None:
        return
    if beyond and context.meta.get(STRICT):
        raise InputError(beyond[0])
    for note in (*notes, *beyond):
        if not context.params.get("quiet"):
            click.echo(note, err=True)


limits_option = click.option(
    "--limits", multiple=True, metavar="JOINT=LOWER:UPPER,..",
    help="Joint limits, which replace the mechanism's own; inf is allowed.",
)  # fmt: skip


def parse_ranges(
    texts: Sequence[str], option: str, mechanism: Mechanism
) -> dict[str, tuple[float, float]]:
    """Return ranges given as ``name=lower:upper``, with units or not; an end may be inf."""
    tool = [f"tool_{axis}" for axis in "xyz"]  # allowed where a tool is given: checked later
    known = [c.name for c in (mechanism.pose if option == "--domain" else mechanism.limited)]
    ranges: dict[str, tuple[float, float]] = {}
    for given, text in split_pairs(texts, option).items():
        if given.removesuffix("_deg") not in (*known, *tool) and given not in known:
            raise mechanism.unknown_coordinate(option, given, known)
        name, ends = given, tuple(text.split(":"))
        unit = mechanism.unit_named(given)
        if unit is None and given.endswith("_deg"):
            name = given.removesuffix("_deg")
            unit = mechanism.unit_named(name)
            if unit != ANGLE:
                name, unit = given, None
        try:
            pair = [as_quantity(in_degrees(e) if name != given else e, unit or ONE) for e in ends]
            reason = ""
        except QuantityError as error:
            pair, reason = [], f"{error}; "
        if len(pair) != 2 or not pair[0] < pair[1]:
            raise InputError(
                f"{option}: {given}={text} is not allowed: {reason}LOWER:UPPER with LOWER < UPPER "
                f"is needed, such as {given}=0:1"
            )
        if name in ranges:
            raise InputError(f"{option}: {name} is given twice")
        ranges[name] = pair[0], pair[1]
    return ranges


def parse_point(text: str, option: str, unit: str) -> tuple[float, float, float]:
    """Return three comma-separated numbers."""
    found = parse_edges(text, option, unit)
    if len(found) != 3:
        raise InputError(f"{option}: {text} is not allowed: three numbers X,Y,Z are needed")
    return found[0], found[1], found[2]


def parse_edges(text: str, option: str = "--regions", unit: str = ONE) -> tuple[float, ...]:
    """Return comma-separated numbers, the edges of ``--regions`` for one."""
    return tuple(parse_number(option, "number", part, unit) for part in text.split(","))

"""Options of commands, made from the fields of settings: name, type, range, unit, default, help."""

from __future__ import annotations

import math
import operator
import re
import types
from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import click
from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from pmopt.analysis.settings import WorkspaceSettings
from pmopt.cli import options
from pmopt.errors import InputError
from pmopt.inputs.fields import LENGTH, Group, OnCommandLine, Unit, UnitByName
from pmopt.mechanisms import Mechanism
from pmopt.units import ONE, exact

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

#: What stands for a number in the help, by unit; X for any other.
_METAVARS = {"rad": "RAD", "s": "SECONDS"}
#: Groups of options that are no settings; the last two end the help.
DESIGN, RUN, OUTPUT = "Design", "Run", "Output"
_TITLES = {
    "Poses": "Poses that count",
    "Index": "Index of a pose (LCI)",
    "Checks": "Clearances, cones, tool",
}
_OTHERS = {
    "--params": DESIGN, "--strict": DESIGN, "--format": OUTPUT, "--quiet": OUTPUT,
    "--debug": OUTPUT, "--help": OUTPUT,
}  # fmt: skip


#: Stand for a hyphen and a space until the lines of a help text are broken.
_UNBROKEN, _JOINED = "\N{NON-BREAKING HYPHEN}", "\N{NO-BREAK SPACE}"


class FieldOption(click.Option):
    """The option of a field, with the group that it belongs to."""

    group = ""


class Sectioned(click.Command):
    """A command whose help has its options by groups."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a section for each group of options."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None and isinstance(parameter, click.Option):
                group = getattr(parameter, "group", _OTHERS.get(parameter.opts[-1], RUN))
                sections.setdefault(group, []).append(record)
        for title in sorted(sections, key=lambda t: (t == RUN) + 2 * (t == OUTPUT)):
            with formatter.section(_TITLES.get(title, title)):
                formatter.write_dl(sections[title])
        # Lines are broken at hyphens and spaces, but not within the name of an option or a range.
        formatter.buffer = [
            text.replace(_UNBROKEN, "-").replace(_JOINED, " ") for text in formatter.buffer
        ]


def options_of(
    model: type[BaseModel], only: tuple[str, ...] = (), but: tuple[str, ...] = ()
) -> Decorator:
    """Return what adds an option for each field of a model, or for some, passed on by its name."""
    names = [name for name in only or model.model_fields if name not in but]

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        for name in reversed(names):
            function = option_of(model, name)(function)
        return function

    return add


def option_of(model: type[BaseModel], name: str, to: str | None = None) -> Decorator:
    """Return the option of one field, passed on as ``to`` or by the option's name."""
    field = model.model_fields[name]
    shape = _shape(field)
    group = next((m.title for m in field.metadata if isinstance(m, Group)), RUN)
    kind = type(f"{group}Option", (FieldOption,), {"group": group})
    return click.option(
        option_name(model, name), to or _passed_on(model, name), cls=kind,
        type=_click_type(field, shape),
        metavar=_metavar(field, shape), multiple=shape in ("ranges", "pairs"),
        help=_help(model, field),
    )  # fmt: skip


def option_name(model: type[BaseModel], name: str) -> str:
    """Return the option of a field, with its dashes."""
    own = next((m.name for m in model.model_fields[name].metadata
                if isinstance(m, OnCommandLine) and m.name), name)  # fmt: skip
    return f"--{own.replace('_', '-')}"


def _passed_on(model: type[BaseModel], name: str) -> str:
    """Return what a command calls the option of a field: not two of them alike."""
    return option_name(model, name).removeprefix("--").replace("-", "_")


def given_options(
    model: type[BaseModel], values: Mapping[str, Any], mechanism: Mechanism
) -> dict[str, Any]:
    """Return the settings that options give, by field, each as its field takes it.

    Parameters
    ----------
    model : type
    values : mapping
        Of all options of the command, by name; those that are not given are None or empty.
    mechanism : Mechanism
        Its names and units are those of ranges.

    Raises
    ------
    InputError
    """
    found: dict[str, Any] = {}
    # Keys of a table are called by their names, as in a file; the validation says what is wrong.
    shared = set(WorkspaceSettings.model_fields) - getattr(model, "OWN", frozenset())
    for name, field in model.model_fields.items():
        value = values.get(_passed_on(model, name))
        if value is None or value == ():
            continue
        option, shape = option_name(model, name), _shape(field)
        unit = _unit(field).replace(LENGTH, mechanism.length_unit)
        if shape == "ranges":
            value = options.parse_ranges(value, option, mechanism)
        elif shape == "pairs":
            value = options.split_pairs(value, option)
        elif shape == "point":
            value = options.parse_point(value, option, unit)
        elif shape == "numbers":
            value = options.parse_edges(value, option, unit)
        elif not isinstance(value, str) and name not in shared:
            _check_range(field, option, value)
        found[name] = value
    return found


def _shape(field: FieldInfo) -> str:
    """Return what a field holds: a word, whole, number, text, point, numbers, ranges or pairs."""
    parts = list(_plain(field.annotation))
    for part in parts:
        origin = get_origin(part)
        if origin is dict:
            return "ranges" if any(isinstance(m, UnitByName) for m in field.metadata) else "pairs"
        if origin is tuple:
            return "numbers" if get_args(part)[-1] is Ellipsis else "point"
    if all(get_origin(part) is Literal for part in parts):
        return "word"
    return "whole" if int in parts else "number" if float in parts else "text"


def _plain(annotation: Any) -> Iterator[Any]:
    """Yield the alternatives of an annotation, without their metadata and without None."""
    if get_origin(annotation) is Annotated:
        yield from _plain(get_args(annotation)[0])
    elif get_origin(annotation) in (Union, types.UnionType):
        for part in get_args(annotation):
            yield from _plain(part)
    elif annotation is not type(None):
        yield annotation


def _words(field: FieldInfo) -> list[str]:
    parts = [p for p in _plain(field.annotation) if get_origin(p) is Literal]
    return [str(word) for part in parts for word in get_args(part)]


def _unit(field: FieldInfo) -> str:
    return next((m.name for m in field.metadata if isinstance(m, Unit)), ONE)


def _click_type(field: FieldInfo, shape: str) -> Any:
    if shape == "word":
        return click.Choice(_words(field))
    if shape == "whole":
        return options.Count()
    if shape == "number":
        return options.Quantity(_unit(field), *_words(field))
    return None


def _metavar(field: FieldInfo, shape: str) -> str | None:
    own = next((m.metavar for m in field.metadata if isinstance(m, OnCommandLine)), "")
    if own or shape == "word":
        return own or None
    number = _METAVARS.get(_unit(field), "X")
    return {
        "whole": "N", "number": "|".join((number, *_words(field))), "point": "X,Y,Z",
        "numbers": "X,..", "ranges": "NAME=LOWER:UPPER,..", "pairs": "NAME=VALUE,..",
    }.get(shape, "TEXT")  # fmt: skip


def _help(model: type[BaseModel], field: FieldInfo) -> str:
    """Return the description of a field as help has it, with its default, unit and range."""
    known = {*model.model_fields, *WorkspaceSettings.model_fields}

    def said(match: re.Match[str]) -> str:
        name = match[1]
        if name in known:
            owner = model if name in model.model_fields else WorkspaceSettings
            return option_name(owner, name).replace("-", _UNBROKEN)
        return name

    text = re.sub("`([^`]+)`", said, field.description or "")
    text = re.sub(r"(\d),(?=\d{3}\b)", r"\1", text)
    notes = []
    own = any(isinstance(m, OnCommandLine) and not m.default for m in field.metadata)
    if field.get_default() and not own and "Default:" not in text:
        notes.append(f"default: {_default(field)}")
    unit = _unit(field)
    if unit not in (ONE, "rad", "s"):
        notes.append(unit.replace(LENGTH, "length unit"))
    if range_text := _range_text(field):
        notes.append(range_text)
    if _shape(field) in ("ranges", "pairs"):
        notes.append("repeatable")
    return f"{text}{'' if text.endswith('.') else '.'}" + (
        f"  [{'; '.join(note.replace(' ', _JOINED) for note in notes)}]" if notes else ""
    )


def _default(field: FieldInfo) -> str:
    value = field.get_default(call_default_factory=True)
    if isinstance(value, tuple):
        return ",".join(map(exact, value))
    return exact(value) if isinstance(value, float) else str(value)


def _bounds(field: FieldInfo) -> list[Any]:
    """Return what bounds the numbers of a field, wherever in its annotation that stands."""

    def within(annotation: Any) -> Iterator[Any]:
        if get_origin(annotation) is Annotated:
            for mark in get_args(annotation)[1:]:
                yield from getattr(mark, "metadata", [mark])
        for part in get_args(annotation):
            yield from within(part)

    marks = [*field.metadata, *within(field.annotation)]
    return [m for m in marks if isinstance(m, Ge | Gt | Le | Lt)]


def _number(value: Any) -> str:
    if value == math.pi:
        return "pi"
    if isinstance(value, int) and value > 1 << 20 and value & (value - 1) == 0:
        return f"2^{value.bit_length() - 1}"
    return f"{value:g}".replace("e+0", "e") if isinstance(value, float) else str(value)


def _range_text(field: FieldInfo) -> str:
    """Return the range of a field's numbers in words, empty where they have none."""
    ends = {type(m).__name__.lower(): m for m in _bounds(field)}
    found = {sign: _number(getattr(mark, sign)) for sign, mark in ends.items()}
    if "ge" in found and "le" in found:
        return f"{found['ge']} to {found['le']}"
    if "gt" in found and "lt" in found:
        return f"between {found['gt']} and {found['lt']}"
    signs = {"ge": ">=", "gt": ">", "le": "<=", "lt": "<"}
    return ", ".join(f"{signs[sign]} {end}" for sign, end in found.items())


def _check_range(field: FieldInfo, option: str, value: float) -> None:
    for mark in _bounds(field):
        sign = type(mark).__name__.lower()  # ge, gt, le or lt
        if not getattr(operator, sign)(value, getattr(mark, sign)):
            what = "a whole number" if _shape(field) == "whole" else "a number"
            needed = f"{what} {_range_text(field)} is needed"
            if _unit(field) == "s":
                needed = f"seconds {_range_text(field)} are needed"
            raise InputError(f"{option}: {value} is not allowed: {needed}")

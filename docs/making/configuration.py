"""The page of all configuration keys, made from the models that read them."""

from __future__ import annotations

import json
import math
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from making.figures import Figure
from making.pages import Block, Statement
from making.registry import maker
from pmopt.analysis.motion.config import MotionConfig
from pmopt.analysis.settings import Range, WorkspaceConfig
from pmopt.inputs.fields import LENGTH, Unit, UnitByName, UnitInWords
from pmopt.reporting.batch.plan import BatchKeys
from pmopt.synthesis.config import RunConfig

PAGE = "docs/configuration.md"
#: What each kind of configuration is read by.
KINDS: dict[str, type[BaseModel]] = {
    "pareto": RunConfig,
    "workspace": WorkspaceConfig,
    "motion": MotionConfig,
    "batch": BatchKeys,
}
#: Stands for a name that the reader chooses or the mechanism brings.
_NAME = "*NAME*"
_TYPES = {
    "str": "text", "int": "integer", "float": "number", "bool": "true or false", "Any": "any value",
}  # fmt: skip
_DEFAULT = "Default: "


def keys(model: type[BaseModel], path: str = "") -> Iterator[tuple[str, FieldInfo]]:
    """Yield every dotted key of a model and its field, those of inner tables after their table."""
    for name, field in model.model_fields.items():
        key = f"{path}{name}"
        yield key, field
        inner = inner_model(field.annotation)
        if inner is not None:
            by_name = _of(field.annotation, dict) is not None
            yield from keys(inner, f"{key}.{_NAME}." if by_name else f"{key}.")


def extra_keys(model: type[BaseModel]) -> Iterator[tuple[str, str]]:
    """Yield the table and the description of keys that a model takes beside its fields."""
    for key, field in [("", None), *keys(model)]:
        inner = model if field is None else inner_model(field.annotation)
        about = getattr(inner, "FURTHER_KEYS", None)
        if about:
            yield key, about


def inner_model(annotation: Any) -> type[BaseModel] | None:
    """Return the model within an annotation, if there is one."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    found = (inner_model(part) for part in get_args(annotation))
    return next((model for model in found if model is not None), None)


def _of(annotation: Any, origin: type) -> Any | None:
    """Return the part of an annotation that is of an origin, e.g. a dict."""
    if get_origin(annotation) is origin:
        return annotation
    if get_origin(annotation) in (Annotated, Union, types.UnionType):
        found = (_of(part, origin) for part in get_args(annotation))
        return next((part for part in found if part is not None), None)
    return None


def kind_of(annotation: Any, marks: tuple[Any, ...] = ()) -> str:
    """Return what values an annotation allows, in words."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        own = [m for part in parts[1:] for m in getattr(part, "metadata", [part])]
        return kind_of(parts[0], (*own, *marks))
    if origin in (Union, types.UnionType):
        return " or ".join(kind_of(p, marks) for p in parts if p is not type(None))
    if origin is Literal:
        return ", ".join(f"`{json.dumps(value)}`" for value in parts)
    if annotation == Range:
        return "range `[lower, upper]`"
    if origin is tuple:
        one = kind_of(parts[0], marks)
        return f"list of {'' if parts[-1] is Ellipsis else f'{len(parts)} '}{_plural(one)}"
    if origin is list or annotation is list:
        return f"list{_sizes(marks)}"
    if origin is dict or annotation is dict:
        return "table" if parts and parts[1] is Any else f"table of {_plural(kind_of(parts[1]))}"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "table"
    name = getattr(annotation, "__name__", str(annotation))
    return f"{_TYPES.get(name, name)}{_bounds(marks)}"


def _plural(text: str) -> str:
    first, space, rest = text.partition(" ")
    return (
        f"{first}s{space}{rest}"
        if first in ("number", "integer", "table", "list", "range")
        else text
    )


def _bounds(marks: tuple[Any, ...]) -> str:
    found = [
        f"{sign} {_number(getattr(mark, name))}"
        for mark in marks
        for type_, name, sign in ((Gt, "gt", ">"), (Ge, "ge", ">="), (Lt, "lt", "<"),
                                  (Le, "le", "<="))
        if isinstance(mark, type_)
    ]  # fmt: skip
    return f" {', '.join(found)}" if found else ""


def _sizes(marks: tuple[Any, ...]) -> str:
    low = next((m.min_length for m in marks if isinstance(m, MinLen)), None)
    high = next((m.max_length for m in marks if isinstance(m, MaxLen)), None)
    return "" if low is None else f" of {low} to {high:,}" if high else f" of {low} or more"


def _number(value: float) -> str:
    if value == math.pi:
        return "pi"
    if isinstance(value, int) and value & (value - 1) == 0 and value > 1 << 20:
        return f"2^{value.bit_length() - 1}"
    return f"{value:,}" if isinstance(value, int) else f"{value:g}"


def unit_of(field: FieldInfo) -> str:
    """Return the unit of a field in words; empty where it has none."""
    for mark in field.metadata:
        if isinstance(mark, Unit):
            return "" if mark.name == "1" else mark.name.replace(LENGTH, "length unit")
        if isinstance(mark, UnitByName):
            per = mark.per.removeprefix("/")
            return f"that of each name{f', by {per}' if per else ''}"
        if isinstance(mark, UnitInWords):
            return mark.words
    return ""


def default_of(field: FieldInfo) -> str:
    """Return the default of a field as TOML has it; empty where there is none."""
    if field.is_required():
        return "required"
    value = field.default if field.default is not PydanticUndefined else field.default_factory()
    if value is None or isinstance(value, dict | BaseModel):
        return described(field)[1]
    if isinstance(value, float):
        return f"`{value:g}`"
    return f"`{json.dumps(value)}`"


def described(field: FieldInfo) -> tuple[str, str]:
    """Return what a field means and, where it is no plain value, its default in words."""
    meaning, _, default = (field.description or "").partition(_DEFAULT)
    return meaning.removesuffix(". ").replace("|", "\\|"), default


@maker("configuration")
def pages() -> Iterator[Statement]:
    """Yield the tables of all configuration keys, one for each table of a configuration."""
    for kind, model in KINDS.items():
        tables: dict[str, list[tuple[str, ...]]] = {}
        for key, field in keys(model):
            place, _, name = key.rpartition(".")
            if place and kind == "workspace":
                continue  # the keys of a search's [workspace]
            values = kind_of(field.annotation, tuple(field.metadata)).replace("|", "\\|")
            row = (f"`{name}`", values, unit_of(field), default_of(field), described(field)[0])
            tables.setdefault(place, []).append(row)
        for place, about in extra_keys(model):
            tables.setdefault(place, []).append(("a coordinate's name", *about))
        lines: list[tuple[Figure | str, ...]] = []
        for place, rows in tables.items():
            if place:
                lines += [("",), (f"### `[{place}]`".replace(_NAME, "NAME"),), ("",)]
            lines += [("key", "values", "unit", "default", "meaning"), ("---",) * 5, *rows]
        yield Block(PAGE, kind, tuple(lines))

"""Reading and validating input: what is wrong with it, in one line a user can act on."""

from __future__ import annotations

import difflib
import os
import re
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from pmopt.errors import InputError
from pmopt.inputs.examples import advice
from pmopt.inputs.fields import Units, in_units
from pmopt.inputs.identify import check_config, missing
from pmopt.inputs.reading import parse_toml
from pmopt.inputs.text import read_text
from pmopt.mechanisms import names

Model = TypeVar("Model", bound=BaseModel)
#: Parts of an error's place that name an alternative of a type, no key.
_ALTERNATIVE = re.compile(r"(function-|tuple\[|dict\[|literal\[|constrained-)|(int|float|str)$")

#: Largest TOML file, in bytes: some hundred thousand waypoints.
_LARGEST = 1 << 25


def validated(model: type[Model], data: Any, where: str, units: Units | None = None) -> Model:
    """Return the model built from data; with ``units``, numbers may be texts with a unit.

    Raises
    ------
    InputError
        One line: where, key, value and what is allowed; of several errors the first.
    """
    if units is not None:
        data = in_units(model, data, units, where)
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(_one_line(error, model, where)) from None


def read_toml(path: Path, where: str) -> dict[str, Any]:
    """Return the content of a TOML file.

    Raises
    ------
    InputError
        For a file that cannot be read or is no TOML.
    """
    try:
        data = parse_toml(read_text(path, largest=_LARGEST))
        str(data)  # Python refuses to print whole numbers of thousands of digits
    except FileNotFoundError:
        raise InputError(f"{where}: no such file{advice(path)}") from None
    except OSError as error:
        raise InputError(f"{where}: cannot read: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(f"{where}: is not a TOML file: {error}") from None
    return data


def read_config(path: Path, command: str) -> dict[str, Any]:
    """Return the content of the configuration of a command.

    Raises
    ------
    InputError
        For a file that is none, saying what it is and which command reads it.
    """
    if not os.path.isfile(path) or path.suffix.lower() in (".csv", ".json", ".png", ".xml"):
        raise missing(path, names(), command)
    data = read_toml(path, str(path))
    check_config(path, data, command)
    return {key: value for key, value in data.items() if key != "command"}


def _one_line(error: ValidationError, model: type[BaseModel], where: str) -> str:
    first = error.errors()[0]
    path = [part for part in first["loc"] if not _ALTERNATIVE.match(str(part))]
    key = ".".join(map(str, path))
    if first["type"] == "extra_forbidden":
        allowed = list(_model_at(model, path[:-1]).model_fields)
        close = difflib.get_close_matches(str(path[-1]), allowed, n=1, cutoff=0.0)
        hint = f"; nearest: {close[0]}" if close else ""
        return f"{where}: unknown key {key}, allowed: {', '.join(allowed)}{hint}"
    if path and path[-1] == "[key]":
        names = ", ".join(map(str, first.get("ctx", {}).values()))
        return f"{where}: unknown key {'.'.join(map(str, path[:-1]))}, allowed: {names}"
    if first["type"] == "missing":
        return f"{where}: {key} is missing"
    if first["type"] in ("model_type", "dict_type"):
        return f"{where}: {key}={first['input']!r} is not allowed: a table of keys is needed"
    message = first["msg"].removeprefix("Value error, ")
    message = message[:1].lower() + message[1:]
    value = first["input"]
    if isinstance(value, dict):
        return f"{where}: {key}: {message}" if key else f"{where}: {message}"
    shown = repr(value) if isinstance(value, str) else value
    return f"{where}: {key}={shown} is not allowed: {message}"


def _model_at(model: type[BaseModel], path: list[int | str]) -> type[BaseModel]:
    """Return the (sub)model whose keys stand at this place of a nested model."""
    for part in path:
        field = model.model_fields.get(str(part))
        if field is None:
            continue
        candidates = [field.annotation, *get_args(field.annotation)]
        for candidate in candidates:
            if isinstance(candidate, type) and issubclass(candidate, BaseModel):
                model = candidate
    return model

"""Units of the keys of a configuration: texts with units become numbers before they are validated.

A field says its unit in its annotation, ``Annotated[float, Unit("s")]``. Then ``"400ms"`` is read
where 0.4 is, and an angle also under its key with ``_deg`` appended. Words, such as ``"optimal"``,
are left to the validation.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from pmopt.errors import InputError
from pmopt.inputs.quantities import QuantityError, as_quantity, in_degrees

#: Stands in a unit for the mechanism's unit of length.
LENGTH = "length"
_QUANTITY = re.compile(r"\s*[+-]?\.?\d")


@dataclass(frozen=True)
class Unit:
    """The unit of a field, or of every number of its lists."""

    name: str


@dataclass(frozen=True)
class UnitInWords:
    """The unit of a field that depends on more than its key: its numbers are plain."""

    words: str


@dataclass(frozen=True)
class UnitByName:
    """Marks a table whose keys are coordinates: each value has the unit of its coordinate.

    ``per`` is appended, e.g. ``"/s"`` for rates.
    """

    per: str = ""


@dataclass(frozen=True)
class Group:
    """What a field is about: fields of one group stand together in the help of a command."""

    title: str


@dataclass(frozen=True)
class OnCommandLine:
    """How the option of a field is called, where its own name and type do not say it best.

    Attributes
    ----------
    name : str
        Without dashes before it; default: the field's, with dashes between words.
    metavar : str
        What stands for the value in the help.
    default : bool
        Whether the field's default is that of the option too: what is not asked for has none.
    """

    name: str = ""
    metavar: str = ""
    default: bool = True


@dataclass(frozen=True)
class Units:
    """What the units of a configuration depend on: its mechanism.

    Attributes
    ----------
    length : str
        Its unit of length.
    of : callable
        Returns the unit of a coordinate or a limit by its name, None for an unknown name.
    """

    length: str
    of: Callable[[str], str | None]


def in_units(model: type[BaseModel], data: Any, units: Units, where: str, path: str = "") -> Any:
    """Return data with numbers in place of quantities.

    Parameters
    ----------
    model : type
    data : Any
        As a file or a caller gives it.
    units : Units
    where : str
        What errors call the data.
    path : str
        The dotted key of the data there, with a dot at its end.

    Raises
    ------
    InputError
        For a quantity of another dimension, and a key that is given twice.
    """
    if not isinstance(data, dict):
        return data
    found: dict[str, Any] = {}
    for key, value in data.items():
        name = key
        unit = _unit(model, key)
        if key not in model.model_fields and str(key).endswith("_deg"):
            base = str(key).removesuffix("_deg")
            angle = _unit(model, base)
            if isinstance(angle, Unit) and angle.name.startswith("rad"):
                name, unit, value = base, angle, in_degrees(value)
        place = f"{where}: {path}{name}"
        if name in found:
            raise InputError(f"{place} is given twice")
        if isinstance(unit, UnitByName):
            found[name] = _by_name(value, units, unit.per, place)
        elif isinstance(unit, Unit):
            found[name] = _number(value, unit.name.replace(LENGTH, units.length), place)
        else:
            found[name] = _nested(model.model_fields.get(name), value, units, where, path + name)
    return found


def _unit(model: type[BaseModel], key: str) -> Unit | UnitByName | None:
    field = model.model_fields.get(key)
    marks = field.metadata if field else ()
    return next((m for m in marks if isinstance(m, Unit | UnitByName)), None)


def _nested(field: FieldInfo | None, value: Any, units: Units, where: str, path: str) -> Any:
    """Return the table of a nested model, or tables by name of one, with numbers."""
    if field is None or not isinstance(value, dict):
        return value
    for candidate in (field.annotation, *get_args(field.annotation)):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            if get_origin(field.annotation) is dict:
                return {
                    k: in_units(candidate, v, units, where, f"{path}.{k}.")
                    for k, v in value.items()
                }
            return in_units(candidate, value, units, where, f"{path}.")
    return value


def _by_name(table: Any, units: Units, per: str, where: str) -> Any:
    if not isinstance(table, dict):
        return _number(table, "1", where)
    found: dict[str, Any] = {}
    for key, value in table.items():
        name, unit = str(key), units.of(str(key))
        if unit is None and name.endswith("_deg"):
            base = name.removesuffix("_deg")
            angle = units.of(base)
            if angle is not None and angle.startswith("rad"):
                name, unit, value = base, angle, in_degrees(value)
        if name in found:
            raise InputError(f"{where}.{name} is given twice")
        known = None if unit is None else f"{unit}{per}"
        found[name] = value if known is None else _number(value, known, f"{where}.{name}")
    return found


def _number(value: Any, unit: str, where: str) -> Any:
    if isinstance(value, list | tuple):
        return [_number(item, unit, where) for item in value]
    if isinstance(value, dict):
        return {key: _number(item, unit, f"{where}.{key}") for key, item in value.items()}
    if not isinstance(value, str) or not _QUANTITY.match(value):
        return value
    try:
        return as_quantity(value, unit)
    except QuantityError as error:
        raise InputError(f"{where}={value!r} is not allowed: {error}") from None

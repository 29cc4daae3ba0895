"""Named numbers of kernels: NamedTuples of floats and of other such records.

Compiled code is given a row of numbers, in the order of the fields, and puts the record together.
"""

from __future__ import annotations

import typing
from collections.abc import Iterable, Iterator
from typing import Any, TypeGuard

from pmopt.compiler.apart import apart

#: What the fields of known records hold.
_held: dict[type[Any], list[Any]] = {}


def is_record(kind: Any) -> TypeGuard[type[Any]]:
    """Return whether this is the class of a NamedTuple."""
    return isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields")


def _fields(kind: type[Any]) -> list[Any]:
    """Return what the fields of a record hold; numbers where it does not say."""
    if kind not in _held:
        hints = typing.get_type_hints(kind)
        _held[kind] = [hints.get(name, float) for name in kind._fields]
    return _held[kind]


def size(kind: type[Any]) -> int:
    """Return how many numbers a record has."""
    counts = [size(held) if is_record(held) else 1 for held in _fields(kind)]
    return sum(counts)


def flat(record: Iterable[Any]) -> list[float]:
    """Return the numbers of a record, or of any other sequence, in order."""
    row: list[float] = []
    for value in record:
        if isinstance(value, tuple):
            row += flat(value)
        else:
            row.append(value)
    return row


def named(kind: type[Any], row: Iterable[Any]) -> Any:
    """Return the record of a row's first numbers."""
    return _built(kind, iter(row))


def _built(kind: type[Any], numbers: Iterator[Any]) -> Any:
    return kind(*(_built(k, numbers) if is_record(k) else next(numbers) for k in _fields(kind)))


def call(kind: type[Any], row: Iterable[str]) -> str:
    """Return the text that makes :func:`named` of a row, its numbers given as text."""
    return _called(kind, iter(row))


def _called(kind: type[Any], numbers: Iterator[str]) -> str:
    held = (_called(k, numbers) if is_record(k) else next(numbers) for k in _fields(kind))
    return f"{apart(kind.__name__, kind)}({', '.join(held)})"


def declare(kind: type[Any], blocks: dict[str, str]) -> str:
    """Add the text that makes a record's class, after those of the records that it holds.

    Returns
    -------
    str
        What it is called in the text.

    Raises
    ------
    TypeError
        For another of that name.
    """
    for held in _fields(kind):
        if is_record(held):
            declare(held, blocks)
    blocks.setdefault("namedtuple", "from collections import namedtuple")
    name = apart(kind.__name__, kind)
    text = f"{name} = namedtuple({name!r}, {kind._fields!r})"
    if blocks.setdefault(name, text) != text:
        raise TypeError(f"two kernel records are named {name}")
    return name


def text_of(value: Any, blocks: dict[str, str]) -> str:
    """Return the text of a constant: a number, or a tuple or record of such."""
    if not isinstance(value, tuple):
        return repr(value)
    held = [text_of(v, blocks) for v in value]
    if is_record(type(value)):
        return f"{declare(type(value), blocks)}({', '.join(held)})"
    return f"({', '.join(held)},)" if held else "()"

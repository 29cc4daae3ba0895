"""Names of other people's modules, kept apart from ours in one text.

A text that is compiled has functions and constants of several modules under one roof. Those of a
plug-in's module get names of their own there, ``TINY__their_module``: a helper or a constant that
is called as one of ours, or as one of another module, then neither replaces it nor is replaced.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Mapping
from types import CodeType
from typing import Any

_OURS = "pmopt."


def is_ours(function: Callable[..., Any]) -> bool:
    """Return whether a function, or the class of a record, is of this package."""
    return function.__module__.startswith(_OURS)


def apart(name: str, function: Callable[..., Any]) -> str:
    """Return what a global of the module of a function or class is called in a text."""
    if is_ours(function):
        return name
    return f"{name}__{function.__module__.replace('.', '_')}"


def names_of(code: CodeType) -> set[str]:
    """Return the global names that code refers to, comprehensions and inner functions included."""
    inner = (names_of(part) for part in code.co_consts if isinstance(part, CodeType))
    return set(code.co_names).union(*inner)


def renamed(source: str, names: Mapping[str, str]) -> str:
    """Return the source of a function with other names of globals, and of its own."""
    changed = {old: new for old, new in names.items() if old != new}
    if not changed:
        return source
    lines = [line.encode() for line in source.splitlines(keepends=True)]
    places = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Name) and node.id in changed:
            places.append((node.lineno - 1, node.col_offset, node.id))
        elif isinstance(node, ast.FunctionDef) and node.name in changed:
            places.append((node.lineno - 1, node.col_offset + len("def "), node.name))
    for row, column, name in sorted(places, reverse=True):
        line, end = lines[row], column + len(name.encode())
        lines[row] = line[:column] + changed[name].encode() + line[end:]
    return b"".join(lines).decode()


#: Modules of plug-ins' functions that keep their names: those a text is made for.
_kept: dict[str, str] = {}


def keep_name(name: str, function: Callable[..., Any]) -> None:
    """Note that a function of a plug-in has its own name in a text."""
    if not is_ours(function):
        _kept[name] = function.__module__


def clash(name: str, function: Callable[..., Any]) -> TypeError:
    """Return the error for a function that is called as another one in the same text."""
    ours = [
        key
        for key, module in list(sys.modules.items())
        if key.startswith("pmopt.kernels.") and hasattr(module, name)
    ]
    modules = {_kept.get(name, ""), function.__module__, *(ours or [f"{_OURS}compiler"])} - {""}
    return TypeError(
        f"two kernel functions are named {name}, of {' and '.join(sorted(modules))}: another name "
        "is needed"
    )

"""Discovery of mechanisms by name."""

from __future__ import annotations

import importlib
import os
import pkgutil
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path

from pmopt.errors import InputError, PmoptError, unknown_name
from pmopt.inputs.identify import describe
from pmopt.mechanisms import catalogue
from pmopt.mechanisms.mechanism import Mechanism

ENTRY_POINT_GROUP = "pmopt.mechanisms"
#: Ends the names of modules that hold a mechanism's forward kinematics.
_PART = "_forward"


def _key(name: str) -> str:
    return "".join(ch for ch in name.casefold() if ch.isalnum())


def collect(mechanisms: list[Mechanism]) -> dict[str, Mechanism]:
    """Return the mechanisms by matching key; two of one name are an error, never an overwrite."""
    found: dict[str, Mechanism] = {}
    for mechanism in mechanisms:
        key = _key(mechanism.name)
        if key in found:
            raise PmoptError(
                f"mechanism {mechanism.name!r} is defined twice: "
                f"{type(found[key]).__module__} and {type(mechanism).__module__}"
            )
        found[key] = mechanism
    return dict(sorted(found.items()))


@cache
def _registry() -> dict[str, Mechanism]:
    found: list[Mechanism] = []
    for info in pkgutil.iter_modules(catalogue.__path__):
        if not info.name.endswith(_PART):
            found.append(importlib.import_module(f"{catalogue.__name__}.{info.name}").MECHANISM)
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        try:
            mechanism = entry.load()
        except Exception as error:  # a broken plug-in must be named, whatever it raises
            raise PmoptError(f"entry point {entry.name!r} ({entry.value}): {error}") from error
        if not isinstance(mechanism, Mechanism):
            raise PmoptError(f"entry point {entry.name!r} ({entry.value}) is no Mechanism")
        found.append(mechanism)
    return collect(found)


def names() -> list[str]:
    """Return the names of all mechanisms."""
    return [mechanism.name for mechanism in _registry().values()]


def find(name: str) -> Mechanism:
    """Return a mechanism by name, ignoring case, spaces and dashes.

    Raises
    ------
    InputError
        For an unknown name; the nearest valid one is given.
    """
    if not name:
        raise InputError(f"mechanism: empty name, allowed: {', '.join(names())}")
    mechanism = _registry().get(_key(name))
    if mechanism is None:
        what = describe(Path(name)) if os.path.exists(name) else ""
        if what:
            raise InputError(
                f"mechanism: {name} {what}; a mechanism is one of {', '.join(names())}"
            )
        raise unknown_name("mechanism", name, names())
    return mechanism

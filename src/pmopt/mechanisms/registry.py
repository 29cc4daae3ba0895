"""Discovery of mechanisms by name: the catalogue's, then those of plug-ins."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import pkgutil
import warnings
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from pmopt.errors import InputError, PmoptError, unknown_name
from pmopt.inputs.identify import describe
from pmopt.mechanisms import catalogue
from pmopt.mechanisms.mechanism import Mechanism

ENTRY_POINT_GROUP = "pmopt.mechanisms"
#: End the names of modules that hold a part of a mechanism: its kernel text, kinematics, structure.
_PARTS = ("_kernel", "_inverse", "_forward", "_configuration", "_structure")
#: What checks a plug-in's mechanism before it is used: module and function. Given by
#: name, as it is built on the analyses, which are built on mechanisms.
_GUARD = ("pmopt.testing.kept", "require_checked")


class PluginWarning(UserWarning):
    """A plug-in that is left out: no other mechanism is affected."""


@dataclass(frozen=True)
class LeftOut:
    """A plug-in that could not be used: its entry point, what that names, and why."""

    name: str
    value: str
    reason: str

    def __str__(self) -> str:
        return f"plug-in {self.name!r} ({self.value}) is left out: {self.reason}"


@dataclass
class Registry:
    """All mechanisms by matching key, the keys of plug-ins', and the plug-ins left out."""

    found: dict[str, Mechanism]
    foreign: set[str] = field(default_factory=set)
    left_out: list[LeftOut] = field(default_factory=list)


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
def _registry() -> Registry:
    own: list[Mechanism] = []
    for info in pkgutil.iter_modules(catalogue.__path__):
        if not info.name.endswith(_PARTS):
            own.append(importlib.import_module(f"{catalogue.__name__}.{info.name}").MECHANISM)
    registry = Registry(collect(own))
    for entry in sorted(entry_points(group=ENTRY_POINT_GROUP), key=lambda e: (e.name, e.value)):
        _add(registry, entry)
    registry.found = dict(sorted(registry.found.items()))
    # Workers of ours are started by a process that has said it.
    if multiprocessing.parent_process() is None:
        for plugin in registry.left_out:
            warnings.warn(str(plugin), PluginWarning, stacklevel=3)
    return registry


def _add(registry: Registry, entry: EntryPoint) -> None:
    """Add the mechanism of an entry point, or note why it is left out."""
    try:
        mechanism = entry.load()
        reason = "" if isinstance(mechanism, Mechanism) else "it is no Mechanism"
        if isinstance(mechanism, type) and issubclass(mechanism, Mechanism):
            reason = "it is a class: the entry point has to name an instance"
        reason = reason or fault_of(mechanism)
        key = "" if reason else _key(mechanism.name)
        if not reason and not key:
            reason = f"its name {mechanism.name!r} has no letter or digit"
        if key in registry.found:
            other = type(registry.found[key]).__module__
            reason = f"there is a mechanism {mechanism.name!r} already, of {other}"
    # A module is other people's text: it may raise anything, and end the process as it loads.
    except (Exception, SystemExit, GeneratorExit) as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
    if reason:
        registry.left_out.append(LeftOut(entry.name, entry.value, reason))
    else:
        registry.found[key] = mechanism
        registry.foreign.add(key)


def fault_of(mechanism: Mechanism) -> str:
    """Return why a mechanism's structure cannot be used, "" where it can.

    A name in it that nothing has is an error that gives the nearest.
    """
    if getattr(mechanism, "structure", None) is None:
        return "it declares no structure, from which layout, skeleton and posture come"
    for made in ("skeleton", "posture", "followed"):
        getattr(mechanism, made)
    return ""


def names() -> list[str]:
    """Return the names of all mechanisms."""
    return [mechanism.name for mechanism in _registry().found.values()]


def left_out() -> tuple[LeftOut, ...]:
    """Return the plug-ins that are left out, and why."""
    return tuple(_registry().left_out)


def find(name: str, checked: bool = True) -> Mechanism:
    """Return a mechanism by name, ignoring case, spaces and dashes.

    Parameters
    ----------
    name : str
    checked : bool
        Whether a plug-in's mechanism is checked first, once for its text.

    Raises
    ------
    InputError
        For an unknown name; the nearest valid one is given.
    pmopt.testing.MechanismError
        Where the mechanism of a plug-in contradicts itself.
    """
    if not name:
        raise InputError(f"mechanism: empty name, allowed: {', '.join(names())}")
    registry, key = _registry(), _key(name)
    mechanism = registry.found.get(key)
    if mechanism is None:
        what = describe(Path(name)) if os.path.exists(name) else ""
        if what:
            raise InputError(
                f"mechanism: {name} {what}; a mechanism is one of {', '.join(names())}"
            )
        for plugin in registry.left_out:
            if _key(plugin.name) == key:
                raise InputError(f"mechanism: {plugin}")
        raise unknown_name("mechanism", name, names())
    if checked and key in registry.foreign:
        module, function = _GUARD
        getattr(importlib.import_module(module), function)(mechanism)
    return mechanism

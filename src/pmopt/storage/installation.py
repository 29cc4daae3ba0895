"""What computes here: versions and the processor."""

from __future__ import annotations

import contextlib
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from pmopt.version import __version__

#: Packages whose results are in those of a run.
COMPUTING = ("numpy", "numba", "llvmlite", "scipy", "pymoo", "moocore")


def versions(packages: tuple[str, ...] = COMPUTING) -> dict[str, str]:
    """Return the versions of pmopt, Python and packages; those not installed are left out."""
    found = {"pmopt": __version__, "python": platform.python_version()}
    for name in packages:
        with contextlib.suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def processor() -> str:
    """Return the processor's name, or its kind where the system does not give one."""
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as stream:
        for line in stream:
            name, _, value = line.partition(":")
            if name.strip() == "model name" and value.strip():
                return value.strip()
    return platform.processor() or platform.machine()


def installation() -> dict[str, Any]:
    """Return both, as JSON has it."""
    return {"versions": versions(), "processor": processor()}


def changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Say in a line how an installation differs from another; empty where it does not.

    Parameters
    ----------
    old, new : mapping
        As :func:`installation` gives them; what does not say is left out.
    """
    before, now = (dict(given.get("versions") or {}) for given in (old, new))
    parts = [
        f"with {name} {now.get(name, 'none')}, begun with {before.get(name, 'none')}"
        for name in dict.fromkeys([*before, *now])
        if before and before.get(name) != now.get(name)
    ]
    began, here = old.get("processor"), new.get("processor")
    if began and began != here:
        parts.append(f"on {here}, begun on {began}")
    return f"resumed {'; '.join(parts)}: what is recorded is kept as it is" if parts else ""

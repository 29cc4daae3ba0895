"""Mechanisms of plug-ins are checked once for their text, before they are used."""

from __future__ import annotations

import functools
import hashlib
import inspect
import sys
from pathlib import Path

from pmopt.compiler.kept_files import keep, read_kept
from pmopt.mechanisms.mechanism import Mechanism
from pmopt.testing.check import check_mechanism
from pmopt.version import __version__

_HELD = b"held\n"


@functools.cache
def require_checked(mechanism: Mechanism) -> None:
    """Check a mechanism unless its text, as it is, has held before.

    Raises
    ------
    MechanismError
    """
    name = f"checked-{_fingerprint(mechanism)}"
    if read_kept(name) == _HELD:
        return
    check_mechanism(mechanism)
    keep(name, _HELD)


def _fingerprint(mechanism: Mechanism) -> str:
    """Return a hash of the package that a mechanism is of, of its checks and of our version."""
    package = type(mechanism).__module__.partition(".")[0]
    modules = {k: m for k, m in list(sys.modules.items()) if k.partition(".")[0] == package}
    digest = hashlib.sha256(f"{__version__}\0{type(mechanism).__qualname__}".encode())
    ours = [(str(p.name), p) for p in Path(__file__).parent.glob("*.py")]
    theirs = [(k, _file_of(m)) for k, m in modules.items()]
    for where, path in sorted([*ours, *theirs], key=lambda pair: pair[0]):
        try:
            digest.update(f"\0{where}\0".encode() + (path.read_bytes() if path else b""))
        except OSError:  # no file: what is in an archive is known by its name alone
            digest.update(f"\0{where}\0".encode())
    return digest.hexdigest()[:20]


def _file_of(module: object) -> Path | None:
    try:
        found = inspect.getsourcefile(module)  # type: ignore[arg-type]
    except TypeError:  # a package without a file
        return None
    return Path(found) if found else None

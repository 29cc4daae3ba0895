"""Small files in the folder of compiled kernels, under the same rules.

Read are files that this user or root owns and that nobody else can write; what cannot be written
costs time and nothing else.
"""

from __future__ import annotations

from pmopt.compiler.machine_code import _is_writable, _read_trusted, _roots, write_whole


def read_kept(name: str) -> bytes:
    """Return the content of a file, empty where there is none to trust."""
    for root in _roots():
        content = _read_trusted(root / name)
        if content:
            return content
    return b""


def keep(name: str, content: bytes) -> bool:
    """Write a file to the first place that can be written; return whether there is one."""
    return any(
        _read_trusted(root / name) is not None
        and _is_writable((root / name).parent)
        and write_whole(root / name, content)
        for root in _roots()
    )

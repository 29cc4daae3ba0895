"""Files are read only where they are files of a sensible size, and JSON of a sensible depth."""

from __future__ import annotations

import json
import math
import os
import re
import select
import stat
import tempfile
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

#: Largest file that is read whole, in bytes.
LARGEST = 1 << 28
#: Largest file that is read line by line.
LARGEST_OF_LINES = 1 << 34
#: Deepest nesting that is taken for one of our files, or a person's.
DEEPEST = 64
#: A dotted key of more parts than that; words begin where none goes on, so that no long one is
#: looked at from each of its letters.
_DEEP_KEY = re.compile(rf"(?<![\w\"'-])(?:[\w\"'-]++[ \t]*+\.[ \t]*+){{{DEEPEST}}}")
#: Largest whole number in one of our files.
_LARGEST_WHOLE = 1 << 64
#: Seconds within which a pipe must have a writer, and bytes that are asked for at once.
_WAIT, _CHUNK = 1.0, 1 << 20
#: More zero bytes in a row than any text has, in any encoding.
_HOLE = b"\0" * 8


def read_file(path: Path, largest: int = LARGEST) -> bytes:
    """Return the content of a file; a pipe or a device is none, and is never waited for.

    Raises
    ------
    OSError
        Also for what is not a regular file, or larger than ``largest`` bytes.
    """
    return _read(path, largest, pipes=False)


def read_given(path: Path, largest: int = LARGEST) -> bytes:
    """Return the content of a file that a person names: also of a pipe that something writes to.

    Raises
    ------
    OSError
        See :func:`read_file`.
    """
    return _read(path, largest, pipes=True)


def _read(path: Path, largest: int, pipes: bool) -> bytes:
    with _opened(path) as stream:
        if pipes and _is_pipe(stream):
            return b"".join(_drained(stream.fileno(), path, largest))
        _check_file(stream, path, largest)
        return _whole(stream, largest) if pipes else stream.read(largest + 1)


def _whole(stream: BinaryIO, largest: int) -> bytes:
    """Return all of a file but where it is no text: a hole of gigabytes is not read."""
    parts: list[bytes] = []
    while part := stream.read(min(_CHUNK, largest + 1)):
        parts.append(part)
        if _HOLE in part:
            break
    return b"".join(parts)


def open_given(path: Path, largest: int = LARGEST_OF_LINES) -> BinaryIO:
    """Open a file that a person names, so that it can be read more than once; a pipe is copied.

    Raises
    ------
    OSError
        See :func:`read_file`.
    """
    stream = _opened(path)
    try:
        if _is_pipe(stream):
            # The caller closes it.
            copy = tempfile.TemporaryFile()  # noqa: SIM115
            try:
                for part in _drained(stream.fileno(), path, largest):
                    copy.write(part)
            except BaseException:
                copy.close()
                raise
            stream.close()
            return copy
        _check_file(stream, path, largest)
    except BaseException:
        stream.close()
        raise
    return stream


def _opened(path: Path) -> BinaryIO:
    # A pipe without a writer would keep a plain open waiting for good.
    return os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb")


def _is_pipe(stream: BinaryIO) -> bool:
    return stat.S_ISFIFO(os.fstat(stream.fileno()).st_mode)


def _check_file(stream: BinaryIO, path: Path, largest: int) -> None:
    found = os.fstat(stream.fileno())
    if not stat.S_ISREG(found.st_mode):
        raise _refused(path, "is no file")
    if found.st_size > largest:
        raise _refused(path, f"is larger than {largest} bytes")


def _drained(handle: int, path: Path, largest: int) -> Iterator[bytes]:
    """Yield all that is written to a pipe."""
    size = 0
    began = time.monotonic()
    while True:
        try:
            part = os.read(handle, _CHUNK)
        except BlockingIOError:  # it has a writer, who has not written yet
            select.select([handle], [], [])
            continue
        if part:
            size += len(part)
            if size > largest:
                raise _refused(path, f"gives more than {largest} bytes")
            yield part
        elif size:
            return
        elif time.monotonic() - began > _WAIT:
            raise _refused(path, "is a pipe that nothing writes to")
        else:
            time.sleep(_WAIT / 100)


def _refused(path: Path, why: str) -> OSError:
    error = OSError(f"{path}: {why}")
    error.strerror = why
    return error


def read_json(path: Path) -> Any:
    """Return the content of a JSON file as pmopt writes them.

    Raises
    ------
    OSError
        See :func:`read_file`.
    ValueError
        For what :func:`parse_json` refuses.
    """
    return parse_json(read_file(path).decode("utf-8"))


def parse_json(text: str) -> Any:
    """Return what a text of JSON holds.

    Raises
    ------
    ValueError
        For what is no JSON, has NaN, infinity, too large a number or half a character in it, or is
        nested deeper than any file of pmopt.
    """
    try:
        document = json.loads(text, parse_constant=_refuse)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if "\\ud" in text.lower():  # half a pair is no character, and cannot be written
        json.dumps(document, ensure_ascii=False).encode("utf-8")
    for value in check_nesting(document):
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError("a number is beyond what a double holds")
        if isinstance(value, int) and abs(value) > _LARGEST_WHOLE:
            raise ValueError("a whole number is too large")
    return document


def parse_toml(text: str) -> dict[str, Any]:
    """Return what a text of TOML holds.

    Raises
    ------
    ValueError
        Also for tables and lists that are nested too deeply.
    """
    if _DEEP_KEY.search(text):  # takes the parser a time that grows with the square
        raise ValueError("nested too deeply")
    try:
        document = tomllib.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    check_nesting(document)
    return document


def check_nesting(document: Any) -> list[Any]:
    """Return all that tables and lists within each other hold beside tables and lists.

    Raises
    ------
    ValueError
        Where they are nested more than :data:`DEEPEST` deep.
    """
    leaves: list[Any] = []
    level: list[Any] = [document]
    for _ in range(DEEPEST):
        below: list[Any] = []
        for value in level:
            if isinstance(value, dict):
                below += value.values()
            elif isinstance(value, list):
                below += value
            else:
                leaves.append(value)
        if not below:
            return leaves
        level = below
    raise ValueError("nested too deeply")


def _refuse(name: str) -> None:
    raise ValueError(f"{name} is no JSON")

"""Files are written whole or not at all."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from pmopt.errors import PmoptError

#: Ending of temporary names; what a killed run leaves of them is known by it.
_TEMPORARY = ".pmopt-tmp"


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files that a killed run has left in a folder."""
    for path in folder.glob(f".*{_TEMPORARY}"):
        path.unlink(missing_ok=True)


def stage(path: Path, data: bytes | str) -> Path:
    """Write a file under a temporary name in the same folder, flush it to disk, return the name.

    Renamed to ``path`` it is in its place.

    Raises
    ------
    PmoptError
        When the folder can not be written or the disk is full; what was there stays as it was.
    """
    raw = data.encode() if isinstance(data, str) else data
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(
            dir=path.parent, prefix=f".{path.name}.", suffix=_TEMPORARY
        )
        with os.fdopen(handle, "wb") as stream:
            stream.write(raw)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(temporary, 0o644)
        staged, temporary = Path(temporary), None
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        if temporary is not None:
            remove_staged([Path(temporary)])
    return staged


def put(staged: Path, path: Path) -> None:
    """Rename what was staged; it is removed where that fails.

    Raises
    ------
    PmoptError
    """
    try:
        os.replace(staged, path)
    except OSError as error:
        remove_staged([staged])
        raise _unwritable(path, error) from error


def remove_staged(paths: Iterable[Path]) -> None:
    """Remove files that were staged and are not wanted."""
    for path in paths:
        with contextlib.suppress(OSError):
            path.unlink()


def write_atomic(path: Path, data: bytes | str) -> None:
    """Write a file whole or not at all; see :func:`stage`.

    Raises
    ------
    PmoptError
    """
    put(stage(path, data), path)


def _unwritable(path: Path, error: OSError) -> PmoptError:
    return PmoptError(f"{path}: can not write: {error.strerror or error}")


def sha256(data: bytes | str) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal."""
    return hashlib.sha256(data.encode() if isinstance(data, str) else data).hexdigest()

"""Files are written whole or not at all."""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
import stat
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from pmopt.errors import PmoptError

#: Ending of temporary names; what a killed run leaves of them is known by it.
_TEMPORARY = ".pmopt-tmp"
#: Bytes of a name before that ending: file systems take 255.
_LONGEST = 200


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files that a killed run has left in a folder."""
    for path in folder.glob(f".*{_TEMPORARY}"):
        path.unlink(missing_ok=True)


def stage(path: Path, data: bytes | str) -> Path:
    """Write a file under a temporary name in the same folder, flush it to disk, return the name.

    Renamed to ``path`` it is in its place. It has the mode of the file that it will replace, else
    the one that the umask gives.

    Raises
    ------
    PmoptError
        When the folder cannot be written or the disk is full; what was there stays as it was.
    """
    temporary = None
    try:
        temporary = _temporary(path)
        write_new(temporary, data, mode_of(path))
        staged, temporary = temporary, None
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        if temporary is not None:
            remove_staged([temporary])
    return staged


def _temporary(path: Path) -> Path:
    """Return a temporary name in the folder of a file, which is made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    name = os.fsencode(path.name)[:_LONGEST].decode("utf-8", "ignore")
    return path.with_name(f".{name}.{secrets.token_hex(6)}{_TEMPORARY}")


def write_new(path: Path, data: bytes | str | Iterable[str], mode: int | None = None) -> str:
    """Write a file that is not there yet, flush it to disk and return its SHA-256.

    Parameters
    ----------
    path : Path
    data : bytes, str or iterable of str
        Its pieces are written as they come.
    mode : int, optional
        Permissions; None: those that the umask gives.

    Raises
    ------
    OSError
    """
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    digest = hashlib.sha256()
    with os.fdopen(handle, "wb") as stream:
        if mode is not None:
            os.fchmod(handle, mode)
        for piece in [data] if isinstance(data, bytes | str) else data:
            raw = piece.encode() if isinstance(piece, str) else piece
            digest.update(raw)
            stream.write(raw)
        stream.flush()
        os.fsync(handle)
    return digest.hexdigest()


def mode_of(path: Path) -> int | None:
    """Return the permissions of a file, None where there is no file (a link is none)."""
    try:
        found = path.lstat()
    except OSError:
        return None
    return stat.S_IMODE(found.st_mode) & 0o777 if stat.S_ISREG(found.st_mode) else None


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
        raise unwritable(path, error) from error


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


@contextlib.contextmanager
def writing(path: Path) -> Iterator[Callable[[str], None]]:
    """Write a file piece by piece by the function that is yielded, whole or not at all.

    Raises
    ------
    PmoptError
        See :func:`stage`.
    """
    temporary = None
    try:
        try:
            temporary = _temporary(path)
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
            handle = os.open(temporary, flags, 0o666)
        except OSError as error:
            raise unwritable(path, error) from error
        with os.fdopen(handle, "wb", buffering=0) as stream:
            mode = mode_of(path)
            if mode is not None:
                os.fchmod(handle, mode)

            def write(text: str) -> None:
                rest = memoryview(text.encode())
                try:
                    while rest:
                        rest = rest[stream.write(rest) :]
                except OSError as error:
                    raise unwritable(path, error) from error

            yield write
            os.fsync(handle)
        put(temporary, path)
        temporary = None
    finally:
        if temporary is not None:
            remove_staged([temporary])


def unwritable(path: Path, error: OSError) -> PmoptError:
    """Return the error for a file or folder that cannot be written."""
    return PmoptError(f"{path}: cannot write: {error.strerror or error}")


def sha256(data: bytes | str) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal."""
    return hashlib.sha256(data.encode() if isinstance(data, str) else data).hexdigest()

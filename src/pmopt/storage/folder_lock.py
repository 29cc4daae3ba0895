"""One command at a time writes a folder; the lock of one that has died holds nobody up.

The lock is the operating system's (``flock``, which NFS has, too): it ends with the process that
holds it. The file that is locked says who that is. Where a file system has no locks, that record
alone decides: it counts as long as its process lives, known by number and start.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import platform
import secrets
import shlex
import stat
import sys
import time
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any

from pmopt.errors import InputError, PmoptError
from pmopt.inputs.reading import read_json
from pmopt.storage.files import unwritable

#: The file that is locked, in the folder.
NAME = ".pmopt-lock"
#: Times that a file which was removed meanwhile is made again.
_TRIES = 100
#: Times to look for the record of a holder that is about to write it, and seconds between.
_LOOKS, _PAUSE = 20, 0.05
#: Characters of a command that are shown.
_SHOWN = 200


class InUseError(InputError):
    """A living command has the folder."""


class FolderLock:
    """Keeps other commands from a folder, which is made where there is none.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    InUseError
        When a living command has the folder: one line that says which.
    PmoptError
        When the folder cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._path = folder / NAME
        self._made: list[Path] = []
        self._handle: int | None = None
        self._token = secrets.token_hex(8)
        try:
            self._acquire()
        except BaseException:
            self.release()
            raise

    def _acquire(self) -> None:
        for _ in range(_TRIES):
            try:
                self._make()
                flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
                handle = os.open(self._path, flags, 0o666)
            except FileNotFoundError:  # whoever made the folder has just ended
                continue
            except OSError as error:
                raise unwritable(self.folder, error) from error
            try:
                if not stat.S_ISREG(os.fstat(handle).st_mode):
                    raise PmoptError(f"{self._path}: is no file")
                locked = _lock(handle)
                if locked is False or (locked is None and self._is_held()):
                    raise InUseError(self._line())
                if not self._is_there(handle):  # its holder has just ended
                    continue
                self._sign(handle)
                if locked is None:
                    time.sleep(_PAUSE)
                    if self._is_held():  # another one has signed after us
                        raise InUseError(self._line())
                self._handle, handle = handle, -1
                return
            finally:
                if handle >= 0:
                    os.close(handle)
        raise PmoptError(f"{self.folder}: other commands keep starting and ending there")

    def _make(self) -> None:
        """Make the folder and remember which parts of its path are new."""
        missing = []
        path = self.folder
        while not path.exists():
            missing.append(path)
            path = path.parent
        for path in reversed(missing):
            with contextlib.suppress(FileExistsError):
                path.mkdir()
                self._made.append(path)

    def _is_there(self, handle: int) -> bool:
        try:
            found = self._path.lstat()
        except OSError:
            return False
        own = os.fstat(handle)
        return (found.st_dev, found.st_ino) == (own.st_dev, own.st_ino)

    def _sign(self, handle: int) -> None:
        record = {
            "pid": os.getpid(),
            "start": _start_of(os.getpid()),
            "host": platform.node(),
            "since": f"{datetime.now():%Y-%m-%d %H:%M:%S}",
            "command": _command(),
            "token": self._token,
        }
        try:
            os.ftruncate(handle, 0)
            os.pwrite(handle, json.dumps(record).encode(), 0)
        except OSError as error:
            with contextlib.suppress(OSError):
                self._path.unlink()
            raise unwritable(self.folder, error) from error

    def _record(self) -> dict[str, Any]:
        try:
            found = read_json(self._path)
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def _is_held(self) -> bool:
        """Return whether the record names a living process and not this lock."""
        record = self._record()
        return record.get("token") not in (None, self._token) and not _has_ended(record)

    def _line(self) -> str:
        """Return the line that says who has the folder."""
        record = self._record()
        for _ in range(_LOOKS):  # it may be about to write it
            if record and not _has_ended(record):
                break
            time.sleep(_PAUSE)
            record = self._record()
        if not record:
            return f"{self.folder}: is being written by another pmopt command"
        command = " ".join(str(record.get("command", "pmopt")).split())
        if len(command) > _SHOWN:
            command = command[: _SHOWN - 2] + ".."
        return (
            f"{self.folder}: is being written by process {record.get('pid')} on "
            f"{record.get('host')} since {record.get('since')}: {command}"
        )

    def release(self) -> None:
        """Let others have the folder; it goes where it was made for the lock and is empty."""
        if self._handle is not None:
            with contextlib.suppress(OSError):
                if self._is_there(self._handle):
                    self._path.unlink()
            os.close(self._handle)
            self._handle = None
        while self._made:
            with contextlib.suppress(OSError):
                self._made.pop().rmdir()

    def __enter__(self) -> FolderLock:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self.release()


def _lock(handle: int) -> bool | None:
    """Lock a file; return whether that was possible, None where there are no locks."""
    try:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except ImportError:
        return None
    except OSError as error:
        # Over NFS a lock that another one has may be refused by either number.
        return False if error.errno in (errno.EWOULDBLOCK, errno.EACCES) else None
    return True


def _has_ended(record: dict[str, Any]) -> bool:
    """Return whether the process of a record is known to have ended."""
    pid = record.get("pid")
    if record.get("host") != platform.node() or not isinstance(pid, int):
        return False
    return _start_of(pid) != record.get("start")


def _start_of(pid: int) -> str | None:
    """Return when a process has started, None where there is none; "?" where nobody knows."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="utf-8").strip()
        return f"{boot} {text.rpartition(')')[2].split()[19]}"
    except (OSError, IndexError):
        pass
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return None
    except (OSError, OverflowError):
        pass
    return "?"


def _command() -> str:
    """Return the line by which this process was started."""
    program = Path(sys.argv[0]) if sys.argv and sys.argv[0] else Path("python")
    name = program.parent.name if program.name == "__main__.py" else program.name
    return shlex.join([name, *sys.argv[1:]])

"""What a run has reached, on disk: plain numbers, checked on loading, nothing that is executed.

A run's folder holds a folder ``checkpoint``: ``run.json`` says what was asked for, and each
numbered file holds a table of numbers that was reached. Every file is written whole and holds a
hash of the rest of it, and tables carry the key of their run: what is torn, altered or another
run's is never taken for its own.

What is recorded is the truth: it is taken up on any processor and with any version of pmopt and of
what computes. Which ones began the run is recorded too, and a line says what has changed since.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import stat
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.errors import InputError, PmoptError
from pmopt.inputs.reading import read_json
from pmopt.storage.files import remove_leftovers, write_atomic
from pmopt.storage.installation import changes as installation_changes
from pmopt.storage.installation import installation
from pmopt.storage.swap import NEXT

#: Form of run.json and of the numbered files; another one is refused.
SCHEMA = 5
FOLDER = "checkpoint"
RUN = "run.json"
#: Most bytes of the lines that precede a table, and of a table.
_HEAD, _TABLE = 1 << 20, 1 << 31

Notify = Callable[[str], None]
#: Whether a run that was asked for the first value may be continued to the second.
Grows = Callable[[Any, Any], bool]


@dataclass(frozen=True)
class Reached:
    """The content of one numbered file.

    Attributes
    ----------
    number : int
    facts : dict
        What JSON can hold.
    table : (N, M) float64
    """

    number: int
    facts: dict[str, Any]
    table: NDArray[np.float64]


class CheckpointFolder:
    """The checkpoint of one run.

    Parameters
    ----------
    folder : Path
        The run's folder.
    command : str
    unit : str
        What the numbers of files count, the first part of their names.
    config : dict
        All that the tables depend on but the installation; what JSON can hold.
    grows : mapping
        By dotted key of the configuration, whether a run may be continued from one value to
        another.
    """

    def __init__(
        self, folder: Path, command: str, unit: str, config: dict[str, Any],
        grows: Mapping[str, Grows],
    ) -> None:  # fmt: skip
        self.folder = folder / FOLDER
        self.command = command
        self.unit = unit
        self.config = config
        self.grows = grows
        same = json.loads(json.dumps(config))
        for key in grows:
            *path, last = key.split(".")
            table = same
            for name in path:
                table = table[name]
            table[last] = table[last] is not None
        self._key = _digest(_canonical([SCHEMA, command, same]))
        self.resumes: list[int] = []
        self.notes: list[str] = []
        self._noted = False

    @staticmethod
    def exists(folder: Path) -> bool:
        """Return whether a run was begun in this folder."""
        return (folder / FOLDER / RUN).exists()

    @staticmethod
    def configuration(folder: Path) -> dict[str, Any] | None:
        """Return the configuration of the run begun in this folder, None where it is not known."""
        try:
            run = read_json(_newest(folder) / FOLDER / RUN)
            return dict(run["config"])
        except (OSError, ValueError, KeyError, TypeError):
            return None

    @staticmethod
    def count(folder: Path) -> int:
        """Return how many numbered files there are in this folder."""
        return sum(1 for _ in (_newest(folder) / FOLDER).glob("*-*.bin"))

    def start(self) -> None:
        """Begin a new run, and then forget any earlier one."""
        self.resumes, self.notes = [], []
        self._write_run()
        self._remove(self._files())

    def clear(self) -> None:
        """Forget the run: first what says that there is one."""
        self._remove([self.folder / RUN, *self._files()])
        with contextlib.suppress(OSError):  # there is none, or something else is in it
            self.folder.rmdir()

    def _remove(self, paths: list[Path]) -> None:
        try:
            for path in paths:
                path.unlink(missing_ok=True)
        except OSError as error:
            raise PmoptError(f"{path}: cannot remove: {error.strerror or error}") from error

    def check(self, notify: Notify | None = None) -> None:
        """Refuse to continue anything but this run, interrupted.

        Another installation continues it, with a line that says so.

        Raises
        ------
        InputError
            When the folder's run had another command or configuration, whose differences are
            named, or its files another form.
        """
        path = self.folder / RUN
        try:
            run = read_json(path)
            schema, began = run["schema"], run.get("installation")
            if schema != SCHEMA:
                version = (began or {}).get("versions", {}).get("pmopt") or run["version"]
                raise InputError(
                    f"{path}: was written in form {schema} by pmopt {version}, this one takes up "
                    f"form {SCHEMA}: finish the run with pmopt {version}, or --force starts afresh"
                )
            if run["sha256"] != _run_digest(run):
                raise ValueError
            command, config, resumes = run["command"], run["config"], run["resumes"]
            notes = [str(note) for note in run["notes"]]
            changed = installation_changes(began or {}, installation())
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            raise InputError(
                f"{path}: is not a checkpoint of pmopt; --force starts afresh"
            ) from None
        if command != self.command:
            raise InputError(f"{path}: is the checkpoint of a {command} run, not {self.command}")
        place = self.folder.parent
        place = place.parent if place.name == NEXT else place
        refuse_changes(place, config, self.config, self.grows)
        self.resumes, self.notes = resumes, notes
        self._noted = bool(changed)
        if changed:
            self.note(changed, notify)

    def note(self, line: str, notify: Notify | None = None) -> None:
        """Keep a line on how the run was taken up, for its manifest, and say it."""
        self.notes.append(line)
        if notify:
            notify(line)

    def note_designs(self, line: str, notify: Notify | None = None) -> None:
        """Keep a line on what another installation does otherwise, unless one says that it is."""
        if not self._noted:
            self.note(line, notify)
            self._write_run()

    def taken_up(self, number: int) -> None:
        """Record that the run goes on from a number."""
        self.resumes.append(number)
        self._write_run()

    def write(self, number: int, facts: dict[str, Any], table: NDArray[np.float64]) -> None:
        """Write one numbered file."""
        numbers = np.ascontiguousarray(table, dtype="<f8")
        head = {"key": self._key, "number": number, "shape": numbers.shape, "facts": facts}
        rest = json.dumps(head).encode() + b"\n" + numbers.tobytes()
        write_atomic(self._path(number), _digest(rest).encode() + b"\n" + rest)

    def numbers(self) -> list[int]:
        """Return the numbers of which there are files, ascending."""
        ends = [path.stem.removeprefix(f"{self.unit}-") for path in self._files()]
        return sorted(int(end) for end in ends if end.isdecimal())

    def remove(self, number: int) -> None:
        """Remove a numbered file."""
        self._remove([self._path(number)])

    def read(self, number: int, notify: Notify | None = None) -> Reached | None:
        """Return one numbered file, None (and a line) where it is torn or another run's."""
        path = self._path(number)
        try:
            digest, line, raw = _parts(path)
            if digest != _digest(line + b"\n" + raw).encode():
                raise ValueError("is torn")
            head = json.loads(line)
            if (head["key"], head["number"]) != (self._key, number):
                raise ValueError("is of another run")
            table = np.frombuffer(raw, dtype="<f8").reshape(head["shape"]).astype(float)
            return Reached(number, dict(head["facts"]), table)
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            if notify:
                reason = str(error) if type(error) is ValueError else "cannot be read"
                notify(f"{path}: {reason}: not used")
            return None

    def _write_run(self) -> None:
        remove_leftovers(self.folder)
        document = {
            "schema": SCHEMA,
            "installation": installation(),
            "command": self.command,
            "config": self.config,
            "resumes": self.resumes,
            "notes": self.notes,
        }
        document["sha256"] = _run_digest(document)
        write_atomic(self.folder / RUN, json.dumps(document, indent=1))

    def _path(self, number: int) -> Path:
        return self.folder / f"{self.unit}-{number:07d}.bin"

    def _files(self) -> list[Path]:
        return list(self.folder.glob("*-*.bin"))


def _parts(path: Path) -> tuple[bytes, bytes, bytes]:
    """Return digest, line and table of a numbered file.

    A table is read if it has the size that the line before it says: a file of gigabytes in its
    place costs nothing, and a pipe is not waited for.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(handle, "rb") as stream:
        found = os.fstat(handle)
        if not stat.S_ISREG(found.st_mode):
            raise OSError("is no file")
        lines = [stream.readline(_HEAD) for _ in range(2)]
        shape = json.loads(lines[1])["shape"] if lines[1].endswith(b"\n") else None
        if not isinstance(shape, list) or not all(isinstance(n, int) and n >= 0 for n in shape):
            raise ValueError("is torn")
        size = 8 * math.prod(shape)
        if size > _TABLE or found.st_size != sum(map(len, lines)) + size:
            raise ValueError("is torn")
        return lines[0][:-1], lines[1][:-1], stream.read(size + 1)


def _newest(folder: Path) -> Path:
    """Return where the run is that was begun last: beside the one that it is to replace."""
    beside = folder / NEXT
    return beside if CheckpointFolder.exists(beside) else folder


def _canonical(document: Any) -> bytes:
    return json.dumps(document, sort_keys=True).encode()


def _run_digest(document: Mapping[str, Any]) -> str:
    """Return the hash of a run's inputs: it may be resumed on any installation."""
    kept = {k: v for k, v in document.items() if k not in ("sha256", "installation")}
    return _digest(_canonical(kept))


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def refuse_changes(folder: Path, old: Any, new: Any, grows: Mapping[str, Grows]) -> None:
    """Refuse to continue the run of one configuration with another one.

    Raises
    ------
    InputError
        One line that names every key with its old and new value.
    """
    changed = changes(old, new, grows)
    if changed:
        raise InputError(f"{folder}: --resume with a changed configuration: {'; '.join(changed)}")


def changes(old: Any, new: Any, grows: Mapping[str, Grows]) -> list[str]:
    """Return what keeps one configuration from continuing another, as ``key: old -> new``."""
    return [
        f"{key}: {one} -> {other}"
        for key, one, other in differences(old, new)
        if key not in grows or not _grows(grows[key], one, other)
    ]


def _grows(grows: Grows, old: Any, new: Any) -> bool:
    """Return whether a run may be continued from one value to another; never from None."""
    try:
        return None not in (old, new) and grows(old, new)
    except TypeError:  # a damaged file may hold anything
        return False


def differences(old: Any, new: Any, prefix: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield what differs between two plain configurations: dotted key, old and new value."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys([*old, *new]):
            yield from differences(old.get(key), new.get(key), f"{prefix}{key}.")
    elif old != new:
        yield prefix[:-1], old, new

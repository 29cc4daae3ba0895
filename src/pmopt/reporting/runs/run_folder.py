"""A run's folder: what may be written where, and the manifest that closes it."""

from __future__ import annotations

import contextlib
import json
import os
import platform
import subprocess
import time
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any

from pmopt.errors import InputError, PmoptError
from pmopt.inputs.reading import read_json
from pmopt.storage.checkpoint import FOLDER, RUN
from pmopt.storage.files import mode_of, remove_leftovers, unwritable, write_new
from pmopt.storage.folder_lock import FolderLock
from pmopt.storage.installation import COMPUTING, versions
from pmopt.storage.swap import JOURNAL, LAST, NEXT, clear, is_unfinished, recover, swap

MANIFEST = "manifest.json"
#: By which a search or a long workspace that was begun is known.
CHECKPOINT = f"{FOLDER}/{RUN}"
#: Of a batch: what it is to hold, and the folder of its runs' folders.
PLAN, RUNS = "batch.json", "runs"
DEFAULT_ROOT = Path("outputs")
_PACKAGES = (*COMPUTING, "pandas", "matplotlib")


def default_folder(*names: str) -> Path:
    """Return a folder that does not exist yet: ``outputs/<command>-<mechanism>-<time>``."""
    base = f"{'-'.join(names)}-{datetime.now():%Y%m%d-%H%M%S}"
    path, count = DEFAULT_ROOT / base, 1
    while path.exists():
        count += 1
        path = DEFAULT_ROOT / f"{base}-{count}"
    return path


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """Return the manifest of a finished run, None where there is none.

    Raises
    ------
    PmoptError
        Where a process was killed while it put a run in its place, and that cannot be ended.
    """
    settle(folder)
    try:
        document = read_json(folder / MANIFEST)
    except (OSError, ValueError):
        return None
    return document if isinstance(document, dict) and _is_manifest(document) else None


def manifest_to_keep(folder: Path) -> dict[str, Any] | None:
    """Return the manifest of a finished run, None also where one was begun that replaces it."""
    manifest = read_manifest(folder)
    return None if (folder / NEXT / CHECKPOINT).exists() else manifest


def _is_manifest(document: dict[str, Any]) -> bool:
    tables = ("config", "outputs", "units")
    return isinstance(document.get("command"), str) and all(
        isinstance(document.get(name, {}), dict) for name in tables
    )


def settle(folder: Path) -> None:
    """End what a killed process has left half done in a folder; see :mod:`pmopt.storage.swap`."""
    if is_unfinished(folder):
        with FolderLock(folder):
            recover(folder)


class RunFolder:
    """Collects the files of one run and closes it with a manifest.

    The folder is locked until the run is closed, or the context left. A run that is to replace
    another one grows in a folder within, and takes its place as a whole.

    Parameters
    ----------
    path : Path
    force : bool
        Allow a folder that holds a finished or interrupted run.
    resume : bool
        Take up the interrupted run in the folder, if there is one.
    continues : bool
        Whether the run in the folder may be replaced, since this one continues it.
    mark : str
        The file by which a run to take up is known.

    Attributes
    ----------
    path : Path
    place : Path
        Where the run's checkpoint is until the run is closed.
    begun : bool
        Whether there is a run to take up, in ``place``.

    Raises
    ------
    InputError
        When the folder holds a run and ``force`` is not given, is being written, or is no folder.
    PmoptError
        When it cannot be written.
    """

    def __init__(
        self, path: Path, force: bool = False, resume: bool = False, continues: bool = False,
        mark: str = CHECKPOINT,
    ) -> None:  # fmt: skip
        try:
            if path.exists() and not path.is_dir():
                raise InputError(f"--out: {path} is a file, not a folder")
        except OSError as error:  # a name that is too long
            raise InputError(f"--out: {path}: {error.strerror or error}") from None
        if path.is_symlink() and not path.exists():
            raise InputError(f"--out: {path} is a link, not a folder of this run")
        self.path = path
        self._digests: dict[str, str] = {}
        self._began = time.monotonic(), time.process_time()
        self._opened = False
        self._lock = FolderLock(path)
        try:
            recover(path)
            _refuse_strange(path)
            here, there = ((p / mark).exists() for p in (path, path / NEXT))
            self.begun = resume and (here or there)
            if not (self.begun or force or continues):
                _refuse_runs(path)
            afresh = not self.begun and any(
                os.path.lexists(path / name) for name in (MANIFEST, CHECKPOINT, PLAN)
            )
            self.place = path / NEXT if afresh or (self.begun and there) else path
        except BaseException:
            self._lock.release()
            raise

    def __enter__(self) -> RunFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self.release()

    def release(self) -> None:
        """Release the folder; of an unfinished run only a checkpoint stays."""
        if self._opened:
            with contextlib.suppress(OSError):
                self._forget()
            self._opened = False
        self._lock.release()

    def open(self) -> None:
        """Make ready for the run's files."""
        if self._opened:
            return
        with self._reported():
            remove_leftovers(self.path)
            if not self.begun:
                clear(self.path / NEXT)
            self._forget()
            self.place.mkdir(exist_ok=True)
        self._opened = True

    def reopen(self) -> None:
        """Make a finished run that goes on in its place an unfinished one: it has no manifest."""
        if self.place == self.path:
            with self._reported():
                (self.path / MANIFEST).unlink(missing_ok=True)

    def write(self, name: str, data: bytes | str | Iterable[str]) -> None:
        """Write one output beside its place: a disk that is full with the next one loses nothing.

        Raises
        ------
        PmoptError
        """
        place = self.path / name
        try:
            self.open()
            if place.is_dir() and not place.is_symlink():
                raise PmoptError(f"{place}: cannot write: is a folder")
            staged = self.path / NEXT / name
            staged.parent.mkdir(parents=True, exist_ok=True)
            digest = write_new(staged, data, mode_of(place))
        except OSError as error:
            self._forget()
            raise unwritable(place, error) from error
        except BaseException:
            self._forget()
            raise
        self._digests[name] = digest

    def put(self) -> None:
        """Put everything that was written in its place; what replaces a run stays beside it."""
        if self.place == self.path:
            self._swap()

    def close(self, command: str, document: dict[str, Any]) -> None:
        """Put everything in its place, the manifest last: with it the run is finished."""
        manifest = {
            "command": command,
            **document,
            "versions": versions(_PACKAGES),
            "git_commit": git_commit(),
            "platform": platform.platform(),
            "wall_time": time.monotonic() - self._began[0],
            "cpu_time": time.process_time() - self._began[1],
            "outputs": dict(self._digests),
        }
        manifest["units"] = {**document.get("units", {}), "wall_time": "s", "cpu_time": "s"}
        self.write(MANIFEST, json.dumps(manifest, indent=2, allow_nan=False) + "\n")
        self.close_with_manifest()

    def close_with_manifest(self) -> None:
        """Put everything in its place, with the manifest that is among it."""
        self._swap()
        self.release()

    def _swap(self) -> None:
        with self._reported():
            names = os.listdir(self.path / NEXT)
        try:
            old = _names_of(self.path) if self.place != self.path else []
            swap(self.path, old, sorted(names, key=lambda name: (name == MANIFEST, name)))
        except BaseException:
            self._forget()
            raise

    def _forget(self) -> None:
        """Remove staged files, but no checkpoint: it may be resumed."""
        staged = self.path / NEXT
        if is_unfinished(self.path) or staged.is_symlink() or not staged.is_dir():
            return
        for path in staged.iterdir():
            if path.name in (FOLDER, PLAN, RUNS) and self.place == staged:
                continue
            if path.is_dir() and not path.is_symlink():
                clear(path)
            else:
                path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            staged.rmdir()

    @contextmanager
    def _reported(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise unwritable(self.path, error) from error


def claimed(
    out: Path | None, force: bool = False, resume: bool = False, continues: bool = False
) -> AbstractContextManager[RunFolder | None]:
    """Return the folder of a run, a context; nothing where the run writes no files."""
    return nullcontext() if out is None else RunFolder(out, force, resume, continues)


def _refuse_strange(path: Path) -> None:
    """Refuse a folder in which something has a name of ours and is not ours."""
    for name in (FOLDER, NEXT, LAST, RUNS):
        place = path / name
        if place.is_symlink():
            raise InputError(f"--out: {place} is a link, not a folder of this run")
        if name != RUNS and os.path.lexists(place) and not place.is_dir():
            raise InputError(f"--out: {place} is a file, not a folder of this run")
    for name in (MANIFEST, JOURNAL):
        if (path / name).is_dir():
            raise InputError(f"--out: {path / name} is a folder, not a file of this run")


def _refuse_runs(path: Path) -> None:
    finished = read_manifest(path) is not None
    beside = (path / NEXT / CHECKPOINT).exists()
    if beside or (not finished and (path / CHECKPOINT).exists()):
        what = "a finished and an interrupted run" if finished else "an interrupted run"
        raise InputError(
            f"--out: {path} holds {what}; --resume continues it, --force starts afresh"
        )
    if finished:
        raise InputError(f"--out: {path} holds a finished run; another folder or --force is needed")
    for name, what in ((MANIFEST, "a damaged manifest.json"), (PLAN, "an unfinished batch")):
        # A link is none of ours, and is replaced.
        if os.path.lexists(path / name) and not (path / name).is_symlink():
            raise InputError(f"--out: {path} holds {what}; another folder or --force is needed")


def _names_of(path: Path) -> list[str]:
    """Return the names that the run in a folder has there."""
    manifest = read_manifest(path) or {}
    outputs = manifest.get("outputs")
    names = [
        name
        for name in (outputs if isinstance(outputs, dict) else ())
        if Path(name).name == name and name[:1] != "." and not (path / name).is_dir()
    ]
    if (path / CHECKPOINT).exists():
        names.append(FOLDER)
    if (path / PLAN).is_file() and manifest.get("command", "batch") == "batch":
        names += [PLAN, RUNS]
    return [MANIFEST, *names]


def git_commit() -> str | None:
    """Return the commit of the checkout pmopt runs from, None where it is installed otherwise."""
    here = Path(__file__)
    try:
        tracked = ["git", "-C", str(here.parent), "ls-files", "--error-unmatch", here.name]
        subprocess.run(tracked, check=True, capture_output=True, timeout=5)
        head = ["git", "-C", str(here.parent), "rev-parse", "HEAD"]
        found = subprocess.run(head, check=True, capture_output=True, timeout=5, text=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return found.stdout.strip()

"""A run's folder: what may be written where, and the manifest that closes it."""

from __future__ import annotations

import json
import platform
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from pmopt.checkpoint import FOLDER
from pmopt.errors import InputError, PmoptError
from pmopt.files import put, remove_leftovers, remove_staged, sha256, stage
from pmopt.version import __version__

MANIFEST = "manifest.json"
DEFAULT_ROOT = Path("outputs")
_PACKAGES = ("numpy", "numba", "llvmlite", "scipy", "pymoo", "moocore", "pandas", "matplotlib")


def default_folder(*names: str) -> Path:
    """Return a folder that does not exist yet: ``outputs/<command>-<mechanism>-<time>``."""
    base = f"{'-'.join(names)}-{datetime.now():%Y%m%d-%H%M%S}"
    path, count = DEFAULT_ROOT / base, 1
    while path.exists():
        count += 1
        path = DEFAULT_ROOT / f"{base}-{count}"
    return path


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """Return the manifest of a finished run, None where there is none."""
    try:
        document = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return document if isinstance(document, dict) and "command" in document else None


class RunFolder:
    """Collects the files of one run and closes it with a manifest.

    Parameters
    ----------
    path : Path
    force : bool
        Allow a folder that holds a finished or interrupted run.
    interrupted : bool
        Whether the folder holds a run that was begun and not finished.

    Raises
    ------
    InputError
        When the folder holds a run and ``force`` is not given, or is no folder.
    """

    def __init__(self, path: Path, force: bool = False, interrupted: bool = False) -> None:
        try:
            if path.exists() and not path.is_dir():
                raise InputError(f"--out: {path} is a file, not a folder")
        except OSError as error:  # a name that is too long
            raise InputError(f"--out: {path}: {error.strerror or error}") from None
        for link in (path, path / FOLDER):
            if link.is_symlink() and (link != path or not link.exists()):
                raise InputError(f"--out: {link} is a link, not a folder of this run")
        if read_manifest(path) is not None and not force:
            raise InputError(
                f"--out: {path} holds a finished run; another folder or --force is needed"
            )
        if interrupted and not force:
            raise InputError(
                f"--out: {path} holds an interrupted run; --resume continues it, "
                "--force starts afresh"
            )
        self.path = path
        self._staged: dict[str, Path] = {}
        self._digests: dict[str, str] = {}
        self._began = time.monotonic(), time.process_time()

    def open(self) -> None:
        """Make the folder."""
        with self._told():
            self.path.mkdir(parents=True, exist_ok=True)
            remove_leftovers(self.path)

    def reopen(self) -> None:
        """Make a finished run, if there is one, an unfinished one: it has no manifest."""
        with self._told():
            (self.path / MANIFEST).unlink(missing_ok=True)

    def write(self, name: str, data: bytes | str) -> None:
        """Write one output beside its place: a disk that is full with the next one loses nothing.

        Raises
        ------
        PmoptError
        """
        try:
            self._staged[name] = stage(self.path / name, data)
        except BaseException:
            remove_staged(self._staged.values())
            self._staged.clear()
            raise
        self._digests[name] = sha256(data)

    def put(self) -> None:
        """Put everything that was written in its place."""
        self.reopen()
        for name, staged in self._staged.items():
            put(staged, self.path / name)
        self._staged.clear()

    def close(self, command: str, document: dict[str, Any]) -> None:
        """Put everything in its place, the manifest last: with it the run is finished."""
        manifest = {
            "command": command,
            **document,
            "versions": versions(),
            "git_commit": git_commit(),
            "platform": platform.platform(),
            "wall_time": time.monotonic() - self._began[0],
            "cpu_time": time.process_time() - self._began[1],
            "outputs": dict(self._digests),
        }
        manifest["units"] = {**document.get("units", {}), "wall_time": "s", "cpu_time": "s"}
        self.write(MANIFEST, json.dumps(manifest, indent=2, allow_nan=False) + "\n")
        self.put()

    @contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise PmoptError(f"{self.path}: can not write: {error.strerror or error}") from error


def versions() -> dict[str, str]:
    """Return the versions of pmopt, Python and the packages that compute."""
    found = {"pmopt": __version__, "python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # pragma: no cover - all are dependencies
            continue
    return found


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

"""One run of a batch, as a worker gets it and what it answers."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmopt.errors import InfeasibleError, PmoptError
from pmopt.inputs.reading import read_file
from pmopt.reporting.batch.runners import RUNNERS
from pmopt.reporting.batch.summary import Status
from pmopt.storage.folder_lock import InUseError

if TYPE_CHECKING:
    pass

#: Least seconds between two looks at whether a run on another machine is still wanted.
_BEAT = 1.0
#: Seconds to wait for a folder that another worker still has.
_HELD = 15.0
#: Bytes of a key, at most.
_LONGEST_KEY = 1000


@dataclass(frozen=True)
class Job:
    """One run, as a worker gets it."""

    command: str
    document: dict[str, Any]
    source: str
    folder: str
    force: bool
    threads: int | None
    lock: str
    key: str


@dataclass(frozen=True)
class Outcome:
    """What a worker says: nothing, or what kept the run from its end.

    Where the worker does not see the batch's folder, ``files`` are those of the run.
    """

    status: Status = "finished"
    message: str = ""
    files: dict[str, bytes] = field(default_factory=dict)


class _Unwanted(Exception):
    """The batch that asked for this run has gone."""


def run_job(job: Job) -> Outcome:
    """Run one run of a batch: what a worker does. Raises nothing."""
    shared = _key_of(job.lock) == job.key
    began = looked = time.monotonic()

    def beat() -> None:
        nonlocal looked
        if shared and time.monotonic() - looked > _BEAT:
            looked = time.monotonic()
            if _key_of(job.lock) != job.key:
                raise _Unwanted

    try:
        runner = RUNNERS[job.command].resolve(job.document, job.source)
        if shared:
            while True:
                try:
                    runner.run(Path(job.folder), force=job.force, threads=job.threads, beat=beat)
                    return Outcome()
                except InUseError:  # by a worker of a batch that was killed, for a moment still
                    if time.monotonic() - began > _HELD:
                        raise
                    time.sleep(_BEAT / 2)
        with tempfile.TemporaryDirectory(prefix="pmopt-") as folder:
            runner.run(Path(folder), force=True, threads=job.threads)
            paths = [p for p in Path(folder).rglob("*") if p.is_file()]
            return Outcome(files={str(p.relative_to(folder)): p.read_bytes() for p in paths})
    except InfeasibleError as error:
        return Outcome("infeasible", str(error))
    except PmoptError as error:
        return Outcome("failed", str(error))
    except MemoryError:
        return Outcome("failed", "out of memory: fewer samples, a smaller grid or population")
    except _Unwanted:
        return Outcome("pending", "the batch was stopped")
    except Exception as error:
        return Outcome("failed", f"unexpected {type(error).__name__}: {error}")


def _key_of(lock: str) -> str | None:
    try:
        return read_file(Path(lock), _LONGEST_KEY).decode("utf-8", "replace")
    except OSError:
        return None

"""The checkpoint of a ``pmopt workspace`` run: its sums, kept now and then."""

from __future__ import annotations

import time
from typing import Any

from pmopt.analysis.sampling.evaluator import Notify
from pmopt.analysis.sampling.measuring import planned_samples
from pmopt.analysis.sampling.partial_sums import Sums
from pmopt.analysis.settings import split_samples
from pmopt.reporting.runs.run_folder import RunFolder
from pmopt.reporting.runs.tasks import WorkspaceTask
from pmopt.storage.checkpoint import CheckpointFolder, Grows

#: What continues a run instead of changing it.
GROWS: dict[str, Grows] = {
    "workspace.samples": lambda old, new: bool(new >= old),
    "workspace.target_error": lambda old, new: bool(new <= old),
}
#: Seconds before the first and between two checkpoints: short runs write none.
EVERY = 2.0


def resolved(task: WorkspaceTask) -> dict[str, Any]:
    """Return all that a task's sums depend on, defaults filled in."""
    document = task.to_dict()
    settings = task.settings
    if settings.grid is None and settings.target_error is None:
        samples = planned_samples(settings)
        document["workspace"]["samples"] = samples
        document["workspace"]["replicates"] = split_samples(samples, settings.replicates)[0]
    return document


class WorkspaceCheckpoint(CheckpointFolder):
    """Keeps the newest sums and those before; more samples or a smaller error continue them.

    Parameters
    ----------
    folder : RunFolder
        Opened before the first file is written.
    task : WorkspaceTask
    """

    def __init__(self, folder: RunFolder, task: WorkspaceTask) -> None:
        super().__init__(folder.place, "workspace", "chunk", resolved(task), GROWS)
        self._run = folder
        self._started = False
        self._waiting: Sums | None = None
        self._written = time.monotonic()

    def resume(self, notify: Notify | None = None) -> Sums:
        """Return the newest sums that are whole, none where there are not any.

        Raises
        ------
        InputError
            See :meth:`check`.
        """
        self.check(notify)
        found = Sums()
        for number in reversed(self.numbers()):
            reached = self.read(number, notify)
            if reached is not None:
                found = Sums.from_plain(number, reached.facts, reached.table)
                break
        self._run.open()
        self.taken_up(found.chunks)
        self._run.reopen()
        self._started = True
        return found

    def keep(self, sums: Sums) -> None:
        """Take sums; write them if the last time is some seconds ago."""
        self._waiting = sums
        if time.monotonic() - self._written >= EVERY:
            self.flush()

    def flush(self) -> None:
        """Write the sums taken last, if they are not yet."""
        sums, self._waiting = self._waiting, None
        if sums is None:
            return
        if not self._started:
            self._run.open()
            self.start()
            self._run.reopen()
            self._started = True
        self.write(sums.chunks, *sums.to_plain())
        for number in self.numbers()[:-2]:
            self.remove(number)
        self._written = time.monotonic()

    def finish(self) -> None:
        """Keep the end of a long run, for more samples; forget what was before a short one."""
        if self._started:
            self.flush()
        else:
            self.clear()

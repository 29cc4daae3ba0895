"""A search's evaluations, on disk after every generation.

Giving an algorithm the recorded results again restores a run (:mod:`pmopt.synthesis.optimise`):
those of each generation, and of the designs measured again after it where there were any. The
states of the generator are recorded too, so that a run goes on from its record also where another
processor or version would have asked for other designs. Each generation is one file of
:mod:`pmopt.storage.checkpoint`.
"""

from __future__ import annotations

import json
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from pmopt.storage.checkpoint import CheckpointFolder, Grows, Notify
from pmopt.synthesis.config import ADAPTIVE, RunConfig
from pmopt.synthesis.optimise import Record
from pmopt.synthesis.problem import DesignProblem, Evaluations

#: What continues a run instead of changing it.
GROWS: dict[str, Grows] = {"algorithm.generations": lambda old, new: bool(new >= old)}


def plain(config: RunConfig) -> dict[str, Any]:
    """Return the configuration as JSON has it."""
    document: dict[str, Any] = json.loads(config.model_dump_json())
    if config.adaptive:
        document["workspace"]["samples"] = ADAPTIVE
    return document


class Checkpoint(CheckpointFolder):
    """The checkpoint of a search; more generations than before continue it.

    Parameters
    ----------
    folder : Path
        The run's folder.
    problem : DesignProblem
    """

    def __init__(self, folder: Path, problem: DesignProblem) -> None:
        super().__init__(
            folder, "pareto", "generation", plain(problem.config),
            GROWS,
        )  # fmt: skip
        self.problem = problem
        self._writer = ThreadPoolExecutor(1)
        self._writing: Future[None] | None = None

    def resume(self, notify: Notify | None = None) -> list[Record]:
        """Return the recorded generations, as far as their files are whole.

        Raises
        ------
        InputError
            See :meth:`check`.
        """
        self.check(notify)
        recorded: list[Record] = []
        for number in self.numbers():
            if number != len(recorded) + 1:
                break
            part = self._record(number, notify)
            if part is None:
                break
            recorded.append(part)
        self.taken_up(len(recorded))
        return recorded

    def save(self, number: int, record: Record) -> None:
        """Record one generation while the next one is computed, as disks are slow."""
        parts = [record.evaluated] if record.again is None else [record.evaluated, record.again]
        table = Evaluations.join(parts).table()
        facts = {
            "designs": len(record.evaluated),
            "asked": record.asked,
            "generator": record.generator,
        }
        self.flush()
        self._writing = self._writer.submit(self.write, number, facts, table)

    def flush(self) -> None:
        """Wait for what is being written."""
        if self._writing is not None:
            self._writing.result()

    def _record(self, number: int, notify: Notify | None) -> Record | None:
        """Return one generation, None where the file is torn or another run's."""
        reached = self.read(number, notify)
        if reached is None:
            return None
        ends = np.cumsum([len(self.problem.variables), *[len(self.problem.objectives)] * 2])
        evaluated, again = (
            Evaluations(*np.split(part, ends.tolist(), axis=1))
            for part in np.split(reached.table, [reached.facts["designs"]])
        )
        facts = reached.facts
        return Record(evaluated, again if len(again) else None, facts["asked"], facts["generator"])

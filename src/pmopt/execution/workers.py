"""Work shared over processes of this machine, each of which takes one item at a time.

A process that dies (out of memory, killed) costs the item it had: it is given to a new process.
When this process dies, however it does, its workers end by themselves.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from types import TracebackType
from typing import Any, Generic, Protocol, TypeVar

from pmopt.errors import PmoptError

Item = TypeVar("Item")
Result = TypeVar("Result")
Tick = Callable[[], None]

#: Processes an item may take down before it is given up.
ATTEMPTS = 3
#: Seconds between two calls of ``tick`` while nothing ends.
TICK = 0.5


class Pool(Protocol):
    """Something that computes items elsewhere."""

    @property
    def local(self) -> int:
        """Processes on this machine."""

    @property
    def threads(self) -> int:
        """Items it computes at once."""

    @property
    def running(self) -> list[int]:
        """Numbers of the items that are being computed, as far as that is known."""

    def completed(
        self, function: Callable[[Item], Result], items: Sequence[Item], tick: Tick
    ) -> Iterator[tuple[int, Result | PmoptError]]:
        """Yield number and result of each item as it is done.

        Parameters
        ----------
        function : callable
            Importable by its name; raises nothing.
        items : sequence
        tick : callable
            Called some times a second while nothing ends.

        Yields
        ------
        number : int
        result : Result or PmoptError
            An error where the worker failed, not the function.
        """


class _Worker(Generic[Item, Result]):
    """One process and the item it has."""

    def __init__(self, function: Callable[[Item], Result]) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process: SpawnProcess = context.Process(
            target=_serve, args=(theirs, function), daemon=True
        )
        self.process.start()
        theirs.close()  # or its end would not be noticed
        self.number: int | None = None

    def give(self, number: int, item: Item) -> None:
        self.number = number
        with contextlib.suppress(OSError):  # it died idle: reading shows that
            self.connection.send(item)

    def end(self) -> None:
        self.process.kill()
        self.process.join()
        self.connection.close()


class LocalWorkers:
    """Processes of this machine, started when there is work and ended with the context.

    Parameters
    ----------
    count : int
    """

    def __init__(self, count: int) -> None:
        self.local = count
        self._workers: list[_Worker[Any, Any]] = []

    @property
    def threads(self) -> int:
        """Items computed at once."""
        return self.local

    @property
    def running(self) -> list[int]:
        """Numbers of the items that are being computed."""
        return sorted(w.number for w in self._workers if w.number is not None)

    def completed(
        self, function: Callable[[Item], Result], items: Sequence[Item], tick: Tick
    ) -> Iterator[tuple[int, Result | PmoptError]]:
        """Yield number and result of each item as it is done; see :class:`Pool`."""
        waiting = deque(range(len(items)))
        attempts = [0] * len(items)
        try:
            while waiting or self._workers:
                while waiting and len(self._workers) < self.local:
                    self._workers.append(_Worker(function))
                    self._give(self._workers[-1], waiting, items)
                tick()
                ready = wait([w.connection for w in self._workers], TICK)
                for worker in [w for w in self._workers if w.connection in ready]:
                    number = worker.number
                    assert number is not None
                    try:
                        result = worker.connection.recv()
                    except (EOFError, OSError):
                        self._workers.remove(worker)
                        worker.end()
                        attempts[number] += 1
                        if attempts[number] < ATTEMPTS:
                            waiting.appendleft(number)
                            continue
                        code = worker.process.exitcode
                        result = PmoptError(
                            f"its process died {ATTEMPTS} times (exit code {code}; out of memory?)"
                        )
                    else:
                        if waiting:
                            self._give(worker, waiting, items)
                        else:
                            self._workers.remove(worker)
                            worker.end()
                    yield number, result
        finally:
            self.end()

    @staticmethod
    def _give(worker: _Worker[Item, Any], waiting: deque[int], items: Sequence[Item]) -> None:
        number = waiting.popleft()
        worker.give(number, items[number])

    def end(self) -> None:
        """End all processes, whatever they are at."""
        for worker in self._workers:
            worker.process.kill()
        while self._workers:
            self._workers.pop().end()

    def __enter__(self) -> LocalWorkers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self.end()


def _serve(connection: Connection, function: Callable[[Any], Any]) -> None:
    """Compute items until there are no more: a worker's life."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group: the parent acts
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            item = connection.recv()
        except (EOFError, OSError):
            return
        connection.send(function(item))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)

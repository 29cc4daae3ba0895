"""Work shared over threads, with results in the order of the work.

The compiled kernels hold no lock while they run, so threads share one copy of everything.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from itertools import chain, islice
from threading import Condition, Event, Thread
from typing import Generic, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

#: Results a thread may be ahead of the reader.
_AHEAD = 16
#: Most threads for each core that a variable left from elsewhere may ask for.
_MOST = 8
#: Set when the process is about to end: nobody waits for the items that threads are at.
ending = Event()


def default_threads() -> int:
    """Return ``$NUMBA_NUM_THREADS`` if set, else the number of cores this process may use.

    The variable is numba's, set for any program: what is no number counts as not set, and what is
    far above the cores ends at :data:`_MOST` times their number.
    """
    given = os.environ.get("NUMBA_NUM_THREADS")
    cores = os.cpu_count() or 1
    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    if given is None or odd_threads() is not None:
        return cores
    return min(int(given), _MOST * cores)


def odd_threads() -> str | None:
    """Return what to say of ``$NUMBA_NUM_THREADS`` where it is not used; None where it is fine."""
    given = os.environ.get("NUMBA_NUM_THREADS")
    if given is None or (given.isascii() and given.isdigit() and int(given) > 0):
        return None
    return f"NUMBA_NUM_THREADS: {given!r} is not a whole number of at least 1: ignored"


def ordered_map(
    function: Callable[[Item], Result], items: Iterable[Item], threads: int
) -> Iterator[Result]:
    """Yield ``function(item)`` in the order of the items, computed on ``threads`` threads.

    The threads, the caller's among them, take items by themselves: handing each of them over would
    cost a millisecond's item some of its time. At most some dozens of results wait at once, so that
    an endless iterable takes no memory. Leaving the loop early (an exception, Ctrl-C) drops what
    has not begun.
    """
    if threads == 1:
        yield from map(function, items)
        return
    source = iter(items)
    head = list(islice(source, 2))
    if len(head) < 2:  # a thread costs more than a short item
        yield from map(function, head)
        return
    crew = _Crew(function, chain(head, source), _AHEAD * threads)
    helpers = [Thread(target=crew.work, daemon=True) for _ in range(threads - 1)]
    try:
        for number, helper in enumerate(helpers):
            try:
                helper.start()
            except RuntimeError:  # the system gives no more: those that there are do the work
                del helpers[number:]
                break
        yield from crew.results()
    finally:
        crew.leave()
        if not ending.is_set():
            for helper in helpers:
                helper.join()


class _Crew(Generic[Item, Result]):
    """Threads that take items from one source and leave their results for its reader."""

    def __init__(
        self, function: Callable[[Item], Result], source: Iterator[Item], ahead: int
    ) -> None:
        self._function = function
        self._source = source
        self._ahead = ahead
        self._changed = Condition()
        self._done: dict[int, tuple[Result | None, BaseException | None]] = {}
        self._taken = 0
        self._read = 0
        self._left = False

    def leave(self) -> None:
        """Take no further items."""
        with self._changed:
            self._left = True
            self._changed.notify_all()

    def work(self) -> None:
        """Compute items until there are none: a helper's life."""
        while self._step(wait=True):
            pass

    def results(self) -> Iterator[Result]:
        """Yield the results in order, computing items while the next is not there."""
        while True:
            with self._changed:
                ready = self._read in self._done
            if not ready:
                if self._step(wait=False):
                    continue
                with self._changed:
                    if self._read == self._taken:
                        return
                    while self._read not in self._done:
                        self._changed.wait()
            with self._changed:
                result, error = self._done.pop(self._read)
                self._read += 1
                self._changed.notify_all()
            if error is not None:
                raise error
            yield result  # type: ignore[misc]  # None only with an error or as a result

    def _step(self, wait: bool) -> bool:
        """Compute one item; return whether there was one.

        Helpers wait where they are too far ahead, the reader does not.
        """
        with self._changed:
            while wait and not self._left and self._taken - self._read >= self._ahead:
                self._changed.wait()
            if self._left or self._taken - self._read >= self._ahead:
                return False
            try:
                item = next(self._source)
            except StopIteration:
                self._left = True
                return False
            except Exception as caught:  # the reader raises it, in its turn
                self._left = True
                self._done[self._taken] = None, caught
                self._taken += 1
                self._changed.notify_all()
                return True
            number = self._taken
            self._taken += 1
        result = error = None
        try:
            result = self._function(item)
        except BaseException as caught:  # the reader raises it, in its turn
            if not wait and not isinstance(caught, Exception):
                raise  # the reader itself is interrupted
            error = caught
        with self._changed:
            self._done[number] = result, error
            if number == self._read:
                self._changed.notify_all()
        return True

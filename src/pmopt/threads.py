"""Work shared over threads, with results in the order of the work.

The compiled kernels hold no lock while they run, so threads share one copy of everything.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import chain, islice
from typing import TypeVar

from pmopt.errors import InputError

Item = TypeVar("Item")
Result = TypeVar("Result")


def default_threads() -> int:
    """Return ``$NUMBA_NUM_THREADS`` if set, else the number of cores this process may use."""
    given = os.environ.get("NUMBA_NUM_THREADS")
    if given is None:
        if hasattr(os, "sched_getaffinity"):
            return len(os.sched_getaffinity(0))
        return os.cpu_count() or 1
    if not (given.isascii() and given.isdigit()) or int(given) < 1:
        raise InputError(f"NUMBA_NUM_THREADS: {given!r} is not a whole number of at least 1")
    return int(given)


def ordered_map(
    function: Callable[[Item], Result], items: Iterable[Item], threads: int
) -> Iterator[Result]:
    """Yield ``function(item)`` in the order of the items, computed on ``threads`` threads.

    At most a few items per thread are under way at once, so that an endless iterable takes no
    memory. Leaving the loop early (an exception, Ctrl-C) drops what has not begun.
    """
    if threads == 1:
        yield from map(function, items)
        return
    source = iter(items)
    head = list(islice(source, 2))
    if len(head) < 2:  # a pool costs more than a short item
        yield from map(function, head)
        return
    source = chain(head, source)
    with ThreadPoolExecutor(threads) as pool:
        pending: deque[Future[Result]] = deque()
        try:
            pending.extend(pool.submit(function, item) for item in islice(source, 2 * threads))
            while pending:
                result = pending.popleft().result()
                pending.extend(pool.submit(function, item) for item in islice(source, 1))
                yield result
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

"""Work shared over the workers of a Dask cluster, results in the order of the work or of arrival.

Dask is the extra ``cluster``, imported when a cluster is asked for. A worker that is lost costs
what it had at hand: the scheduler gives that to another one. While results are waited for, the
scheduler is watched (:mod:`pmopt.execution.scheduler`).
"""

from __future__ import annotations

import contextlib
import queue
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from itertools import islice
from types import TracebackType
from typing import Any, TypeVar

from pmopt.errors import InputError, PmoptError
from pmopt.execution.scheduler import PATIENCE, Answer, Notify, SchedulerLost, Watch, ask, hush
from pmopt.execution.workers import TICK, Tick
from pmopt.version import __version__

Item = TypeVar("Item")
Result = TypeVar("Result")

#: Seconds to wait for a scheduler, and for the first worker.
_PATIENCE = PATIENCE
#: Tasks at the scheduler for each thread of the cluster: enough that none waits for the next.
_AHEAD = 4
_LEAST_AHEAD = 32


class Cluster:
    """The workers of a Dask scheduler.

    Parameters
    ----------
    address : str
        Such as ``tcp://host:8786``; for ``tls://`` certificates are those of Dask's configuration.
    notify : callable, optional
        Is given a line now and then while there is nothing but waiting.

    Raises
    ------
    InputError
        For what is no address, and where Dask is not installed.
    PmoptError
        When no scheduler answers there, or it has no workers.
    """

    def __init__(self, address: str, notify: Notify | None = None) -> None:
        try:
            import distributed
        except ImportError:
            raise InputError(
                "--scheduler: Dask is not installed; pip install 'pmopt[cluster]' installs it"
            ) from None
        try:
            _, port = distributed.comm.get_address_host_port(address)
            if not 0 < port < 1 << 16:
                raise ValueError(f"port {port} is not from 1 to 65535")
        except (ValueError, OSError) as error:
            raise InputError(
                f"--scheduler: {address!r} is not an address like tcp://host:8786: {error}"
            ) from None
        hush()
        self.address = address
        self._notify: Notify = notify or (lambda text: None)
        watch = Watch(address, self._notify, _PATIENCE)
        watch.first_answer(_PATIENCE)
        try:
            self._client: Any = distributed.Client(
                address, timeout=_PATIENCE, set_as_default=False, name="pmopt"
            )
        except Exception:  # it has gone since; Dask has many exceptions for that
            raise watch.none() from None

    #: Processes of this machine: not ours to count.
    local = 0

    @property
    def running(self) -> list[int]:
        """Nothing: only the scheduler knows."""
        return []

    @property
    def threads(self) -> int:
        """Threads of all workers there are now."""
        found = ask(self.address, _PATIENCE)
        return max(1, found.threads) if isinstance(found, Answer) else 1

    def completed(
        self, function: Callable[[Item], Result], items: Sequence[Item], tick: Tick
    ) -> Iterator[tuple[int, Result | PmoptError]]:
        """Yield number and result of each item as it is done.

        See :class:`pmopt.execution.workers.Pool`.
        """
        arrived: queue.Queue[int] = queue.Queue()
        futures = self._submit(function, items)
        try:
            for number, future in enumerate(futures):
                future.add_done_callback(lambda _, number=number: arrived.put(number))
            for _ in items:
                watch = Watch(self.address, self._notify)
                while True:
                    tick()
                    watch.check()
                    with contextlib.suppress(queue.Empty):
                        number = arrived.get(timeout=TICK)
                        break
                try:
                    found: Result | PmoptError = self._results([futures[number]])[0]
                except SchedulerLost:
                    raise
                except PmoptError as error:
                    found = error
                yield number, found
        finally:
            self._drop(futures)

    def ordered_map(
        self, function: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[Result]:
        """Yield ``function(item)`` in the order of the items.

        Some dozens of tasks are at the scheduler at once, so that an endless iterable takes no
        memory; leaving the loop early drops them.
        """
        source = iter(items)
        ahead = max(_LEAST_AHEAD, _AHEAD * self.threads)
        pending = deque(self._submit(function, list(islice(source, ahead))))
        try:
            while pending:
                ready = [pending.popleft()]
                while pending and pending[0].status == "finished":
                    ready.append(pending.popleft())
                if 2 * len(pending) <= ahead:  # one message for many
                    pending.extend(self._submit(function, list(islice(source, ahead // 2))))
                yield from self._results(ready)
        finally:
            self._drop(list(pending))

    def close(self) -> None:
        """Leave the cluster; its workers stay."""
        with contextlib.suppress(Exception):  # the scheduler may be silent, or have gone
            self._client.close(timeout=1)

    def __enter__(self) -> Cluster:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self.close()

    def _submit(self, function: Callable[[Item], Result], items: Sequence[Item]) -> list[Any]:
        if not items:
            return []
        run = uuid.uuid4().hex  # tasks are never taken for those of an earlier run
        futures: list[Any] = self._client.map(
            _Task(function, __version__), items, pure=False,
            key=[f"{function.__name__}-{run}-{number}" for number in range(len(items))],
        )  # fmt: skip
        return futures

    def _drop(self, futures: list[Any]) -> None:
        """Give tasks up; a client that has left has done so."""
        # Without a word to the scheduler that would have to be answered.
        for future in futures:
            future.release()

    def _wait_for(self, futures: list[Any]) -> None:
        """Wait until tasks are done, one way or another, and watch the scheduler meanwhile."""
        from distributed import wait

        watch = Watch(self.address, self._notify)
        while not all(future.done() for future in futures):
            with contextlib.suppress(Exception):  # what failed is reported where results are taken
                wait(futures, timeout=TICK)
            watch.check()

    def _results(self, futures: list[Any]) -> list[Any]:
        """Return the results of tasks, or raise the first error as one line."""
        from concurrent.futures import CancelledError

        from distributed import KilledWorker

        self._wait_for(futures)
        try:
            return list(self._client.gather(futures))
        except PmoptError:
            raise
        except KilledWorker:
            raise PmoptError("the workers that ran it died, one after the other") from None
        except CancelledError:
            raise SchedulerLost(f"the scheduler at {self.address} has gone") from None
        except Exception as error:
            raise PmoptError(
                f"on the cluster at {self.address}: {type(error).__name__}: {error}"
            ) from error


def connect(
    address: str | None, notify: Notify | None = None
) -> AbstractContextManager[Cluster | None]:
    """Return the cluster at an address, or nothing where there is none."""
    return contextlib.nullcontext() if address is None else Cluster(address, notify)


class _Task:
    """A function as a worker calls it: of the same version, or its digits may be others."""

    def __init__(self, function: Callable[[Any], Any], version: str) -> None:
        self.function = function
        self.version = version
        self.__name__ = function.__name__

    def __call__(self, item: Any) -> Any:
        if self.version != __version__:
            raise PmoptError(f"a worker has pmopt {__version__}, this is {self.version}")
        return self.function(item)

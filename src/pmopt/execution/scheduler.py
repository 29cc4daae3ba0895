"""Whether there is a Dask scheduler, it answers, and has workers.

Dask waits for good for what accepts a connection and says nothing, and for workers that never
come. So a scheduler is asked over a connection of its own, with a time limit on all of it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import queue
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pmopt.errors import PmoptError

Notify = Callable[[str], None]

#: Seconds to wait for a scheduler that refuses connections, and for the first worker.
PATIENCE = 10.0
#: Seconds to wait, in the middle, for a scheduler that is silent, and for workers.
SILENT, WITHOUT = 30.0, 60.0
#: Seconds to wait for a connection before the next try, between two questions, and before the
#: first line that says what is waited for.
_CONNECT, _LOOK, _NOTICE = 2.0, 1.0, 5.0
#: Where Dask and what it brings write their own lines.
_LOGGERS = ("distributed", "dask", "tornado", "asyncio", "bokeh")


class SchedulerLost(PmoptError):
    """In the middle of a run the scheduler has gone, is silent or has no workers."""


@dataclass(frozen=True)
class Answer:
    """What a scheduler says of itself: the threads of all its workers."""

    threads: int


@dataclass(frozen=True)
class Failure:
    """Why there is no answer.

    Attributes
    ----------
    reason : str
        Empty where nothing listens there.
    final : bool
        Whether asking again is of no use.
    """

    reason: str
    final: bool = False


def hush() -> None:
    """Keep Dask's own lines from the user: pmopt reports what matters in a line of its own."""
    names = [*_LOGGERS, *logging.root.manager.loggerDict]
    for name in names:
        if name.split(".")[0] in _LOGGERS:
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def ask(address: str, limit: float) -> Answer | Failure:
    """Ask a scheduler who it is, within a time limit in seconds."""
    try:
        return asyncio.run(asyncio.wait_for(_identity(address, limit), limit))
    except TimeoutError:
        return Failure("what listens there says nothing that a scheduler says")
    except Exception as error:
        return _failure(error)


async def _identity(address: str, limit: float) -> Answer | Failure:
    from distributed.comm import connect
    from distributed.core import send_recv
    from distributed.security import Security

    secure = address.partition("://")[0] in ("tls", "wss")
    try:
        arguments = Security().get_connection_args("client")
    except OSError as error:
        return Failure(f"certificates of Dask's configuration: {error}", final=True)
    if secure and arguments.get("ssl_context") is None:
        names = ("CA_FILE", "CLIENT__CERT", "CLIENT__KEY")
        settings = ", ".join(f"DASK_DISTRIBUTED__COMM__TLS__{name}" for name in names)
        return Failure(f"it takes certificates: {settings}", final=True)
    comm = await connect(address, timeout=min(_CONNECT, limit / 3), **arguments)
    try:
        found: Any = await send_recv(comm, op="identity", reply=True)
        if found["type"] != "Scheduler":
            return Failure(f"it is a {found['type'].lower()}, not the scheduler", final=True)
        if "total_threads" in found:
            return Answer(int(found["total_threads"]))
        return Answer(sum(int(worker["nthreads"]) for worker in found["workers"].values()))
    finally:
        comm.abort()


def _failure(error: BaseException | None) -> Failure:
    """Return what an exception of Dask, or one behind it, says."""
    seen: list[str] = []
    while error is not None:
        if isinstance(error, socket.gaierror) and error.errno != socket.EAI_AGAIN:
            return Failure("there is no host of that name", final=True)
        seen.append(f"{type(error).__name__}: {error}")
        error = error.__cause__ or error.__context__
    text = " ".join(seen)
    if "gaierror" in text and "Temporary" not in text:
        return Failure("there is no host of that name", final=True)
    if "SSL" in text or "certificate" in text:
        return Failure(f"TLS: {_short(seen)}", final=True)
    if "Timed out" in text or "refused" in text or "Connect" in text:
        return Failure("")
    return Failure(_short(seen))


def _short(seen: list[str]) -> str:
    """Return the innermost reason, in at most some words."""
    text = " ".join(seen[-1].split())
    return text if len(text) <= 160 else f"{text[:158]}.."


class Watch:
    """Looks at a scheduler while something is waited for.

    Parameters
    ----------
    address : str
    notify : callable
        Is given a line now and then.
    limit : float
        Seconds that an answer may take.
    """

    def __init__(self, address: str, notify: Notify, limit: float = SILENT) -> None:
        self.address = address
        self._limit = limit
        self._notify = notify
        self._answers: queue.SimpleQueue[Answer | Failure] = queue.SimpleQueue()
        self._began = self._answered = self._staffed = time.monotonic()
        self._asked: float | None = None
        self._next = self._began + _LOOK  # most waiting is shorter
        self._shown = 0.0
        #: What the scheduler has said last.
        self.last: Answer | Failure | None = None

    def look(self) -> None:
        """Ask the scheduler, unless it is being asked, and take its answer if there is one."""
        now = time.monotonic()
        if self._asked is None and now >= self._next:
            self._asked = now
            threading.Thread(target=self._ask, daemon=True).start()
        with contextlib.suppress(queue.Empty):
            self.last = self._answers.get_nowait()
            self._asked, self._next = None, now + _LOOK
            if isinstance(self.last, Answer):
                self._answered = now
                if self.last.threads:
                    self._staffed = now
        silent, without = now - self._answered, now - self._staffed
        if silent >= _NOTICE:
            self._tell("the scheduler", silent)
        elif without >= _NOTICE and isinstance(self.last, Answer):
            self._tell("workers", without)

    def _ask(self) -> None:
        self._answers.put(ask(self.address, self._limit))

    def _tell(self, what: str, seconds: float) -> None:
        """Say what is waited for: after 5, 10, 20, 30 s .."""
        due = _NOTICE if self._shown < _NOTICE else 10.0 * (self._shown // 10 + 1)
        if seconds < self._shown:  # it had come back meanwhile
            due, self._shown = _NOTICE, 0.0
        if seconds >= due:
            self._shown = due
            self._notify(f"waiting for {what} at {self.address}, {due:.0f} s")

    def check(self) -> None:
        """Look, and give up in the middle of a run.

        Raises
        ------
        SchedulerLost
            When the scheduler is silent, or without workers, for longer than is promised.
        """
        self.look()
        now = time.monotonic()
        gone = isinstance(self.last, Failure) and not self.last.reason
        if now - self._answered > (PATIENCE if gone else SILENT):
            what = "has gone" if gone else f"has not answered for {SILENT:.0f} s"
            raise SchedulerLost(f"the scheduler at {self.address} {what}")
        if now - self._staffed > WITHOUT:
            raise SchedulerLost(
                f"the scheduler at {self.address} has no workers left, for {WITHOUT:.0f} s"
            )

    def first_answer(self, patience: float) -> None:
        """Wait until the scheduler answers and has a worker.

        Raises
        ------
        PmoptError
        """
        met, self._next = False, self._began
        while True:
            self.look()
            now = time.monotonic()
            if isinstance(self.last, Answer):
                if self.last.threads:
                    return
                if not met:
                    met, self._staffed = True, now
                if now - self._staffed > patience:
                    raise PmoptError(f"--scheduler: {self.address} has no workers")
            elif (
                isinstance(self.last, Failure) and self.last.final
            ) or now - self._began > patience:
                raise self.none()
            time.sleep(0.02)

    def none(self) -> PmoptError:
        """Return the error for an address where no scheduler answers."""
        reason = self.last.reason if isinstance(self.last, Failure) else ""
        if self.last is None:
            reason = "what listens there says nothing that a scheduler says"
        tail = f": {reason}" if reason else ""
        return PmoptError(f"--scheduler: no Dask scheduler answers at {self.address}{tail}")

"""Ctrl-C and SIGTERM end a command, wherever they meet it.

Raised at any moment, an exception can be lost: Python ignores it in a weak reference's callback,
and importing runs one for every module while it holds the import lock, which then is held for
good and stops every thread that imports. So it waits while that lock is held, and is raised again
where Python says that it ignored it, and a second later if the command is still running.

Threads may be seconds inside compiled code or a compiler. Nobody waits for them: what a run has
reached is on disk, and the process ends beside them.
"""

from __future__ import annotations

import _imp
import contextlib
import os
import signal
import sys
from types import FrameType
from typing import Any, NoReturn

_SOON, _AGAIN = 0.02, 1.0


class Interrupted(BaseException):
    """Ctrl-C or SIGTERM. No KeyboardInterrupt, to which click adds an empty line."""


def _interrupt(signum: int, frame: FrameType | None) -> None:
    busy = _imp.lock_held()
    signal.setitimer(signal.ITIMER_REAL, _SOON if busy else _AGAIN)
    if not busy:
        # No threads before that module is there; it may be half imported.
        ending = getattr(sys.modules.get("pmopt.execution.threads"), "ending", None)
        if ending is not None:
            ending.set()
        raise Interrupted


def _lost(lost: Any) -> None:
    """Say nothing of an interruption that Python ignored: it comes again at once."""
    if isinstance(lost.exc_value, Interrupted):
        signal.setitimer(signal.ITIMER_REAL, _SOON)
    else:
        sys.__unraisablehook__(lost)


def install() -> None:
    """Take over SIGINT, unless it is ignored (nohup), and SIGTERM."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, _interrupt)
    signal.signal(signal.SIGTERM, _interrupt)
    signal.signal(signal.SIGALRM, _interrupt)
    sys.unraisablehook = _lost


def leave(code: int) -> NoReturn:
    """End the process without tearing down what threads may still use."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(code)


def disarm() -> None:
    """Stop raising: the command has ended."""
    signal.setitimer(signal.ITIMER_REAL, 0.0)

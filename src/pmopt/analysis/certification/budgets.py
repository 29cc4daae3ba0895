"""How much work may be spent: seconds of it, or a count that is the same on every machine."""

from __future__ import annotations

import time
from typing import Literal

from pmopt.compiler.machine_code import seconds_compiling
from pmopt.errors import InputError

Spent = Literal["time budget", "box budget"]


class Clock:
    """Seconds of work since it was made.

    What this process has spent on compiling kernels meanwhile does not count: that is done once on
    a machine, and is no part of what was asked for.
    """

    def __init__(self) -> None:
        self._began = self._now()

    @staticmethod
    def _now() -> float:
        return time.monotonic() - seconds_compiling()

    @property
    def seconds(self) -> float:
        """Seconds of work so far."""
        return self._now() - self._began


class Budget:
    """What a search may spend, from now on.

    Parameters
    ----------
    seconds : float, optional
        Of work; what a search has found by then depends on the machine.
    boxes : int, optional
        Boxes examined: the same on every machine.

    Raises
    ------
    InputError
        For a budget that is not > 0.
    """

    def __init__(self, seconds: float | None, boxes: int | None = None) -> None:
        if seconds is not None and not seconds > 0:
            raise InputError(
                f"certify: time_budget={seconds} is not allowed: seconds > 0 are needed"
            )
        if boxes is not None and not boxes > 0:
            raise InputError(
                f"certify: box_budget={boxes} is not allowed: a whole number > 0 is needed"
            )
        self.boxes = boxes
        self._seconds = seconds
        self._clock = Clock()

    def spent(self, boxes: int) -> Spent | None:
        """Return which budget is spent once so many boxes have been examined, None if none is."""
        if self.boxes is not None and boxes >= self.boxes:
            return "box budget"
        return "time budget" if self.late else None

    @property
    def late(self) -> bool:
        """Whether the seconds are spent."""
        return self._seconds is not None and self._clock.seconds > self._seconds

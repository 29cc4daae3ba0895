"""Rates and efforts that a task needs over a workspace."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from pmopt.analysis.sizing import actuators
from pmopt.api.keywords import named
from pmopt.api.results.showing import Showing, axes_of
from pmopt.errors import InputError
from pmopt.quantity import uncertain
from pmopt.reporting.runs import capability_run
from pmopt.reporting.tables.table import Table
from pmopt.units import exact

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pmopt.reporting.runs.capability_run import CapabilityTask


class Capability(Showing, actuators.Capability):
    """What a task asks of the motors, and where given motors suffice."""

    frames: ClassVar[tuple[str, ...]] = ("demands", "about")
    _asked: CapabilityTask
    _threads: int | None

    def _headline(self) -> str:
        """Return the result in one line."""
        text = f"{self.mechanism}, {self.working_mode}: "
        if any(demand.limit is not None for demand in self.demands):
            share = uncertain(100 * self.share.value, 100 * self.share.error, "%")
            return f"{text}limits kept in {share} of {self.volume}"
        level = actuators.SHARES.index(0.9) if 0.9 in actuators.SHARES else -1
        needed = ", ".join(
            f"{d.name} {d.levels[level]}"
            for d in self.demands if d.levels[level].value
        )  # fmt: skip
        share = exact(100 * actuators.SHARES[level])
        return text + (f"enough in {share} %: {needed}" if needed else "nothing is asked for")

    def _tables(self) -> list[Table]:
        """Return each rate and effort that is asked for, and the volumes."""
        return capability_run.capability_tables(self)

    def _frame(self, name: str) -> Table:
        """Return the table of that name."""
        return capability_run.capability_data(self)[self.frames.index(name)]

    @named
    def plot(self) -> Axes:
        """Draw sections with the share of the motors' capability that is needed.

        Raises
        ------
        pmopt.InputError
            Without motors.
        """
        if not self._asked.limits:
            raise InputError("plot: capability is drawn against motors: none are given")
        return axes_of(lambda: capability_run.draw_capability(self._asked, self, self._threads))

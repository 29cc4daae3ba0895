"""Results of motions, searches and batches."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from pmopt.api.keywords import named
from pmopt.api.results.showing import Showing, axes_of
from pmopt.errors import InputError, unknown_name
from pmopt.quantity import uncertain
from pmopt.reporting.batch import summary
from pmopt.reporting.runs import motion_run, pareto_run, simulate_run
from pmopt.reporting.tables.front import pareto_tables
from pmopt.reporting.tables.table import Table
from pmopt.units import ONE

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from pmopt.synthesis.config import RunConfig

Quantity = Literal[
    "pose", "joints", "passive", "rates", "accelerations", "efforts", "power", "centres"
]


class MotionRun(Showing, motion_run.MotionRun):
    """A motion, and what it asks of the actuators."""

    frames: ClassVar[tuple[str, ...]] = ("motion", "actuators", "infeasible")

    def _headline(self) -> str:
        """Return the result in one line."""
        t = self.motion.t
        text = f"{self.motion.mechanism}, {self.motion.working_mode}: {len(t)} instants in "
        text += f"{float(t[-1] - t[0]):g} s"
        if self.infeasible:
            return f"{text}, infeasible at {self.infeasible_instants}"
        peaks = [d for d in self.demands if d.quantity == "effort"]
        efforts = ", ".join(f"{d.joint} {d.peak:.4g} {d.unit}" for d in peaks)
        return f"{text}; peak efforts: {efforts}" if efforts else text

    def _tables(self) -> list[Table]:
        """Return the spans where it is infeasible, else the demands and the fit."""
        return motion_run.motion_tables(self)

    def _frame(self, name: str) -> Table:
        """Return every instant, the demands, or the spans where it is infeasible."""
        if name != "motion":
            of = motion_run.summary_table if name == "actuators" else motion_run.spans_table
            return of(self)
        first, *others = motion_run.motion_tables_of(self)
        rows = [row for table in (first, *others) for row in table.rows]
        return Table(first.title, first.columns, tuple(rows), first.units)

    @named
    def plot(self, what: Quantity | None = None) -> Axes:
        """Draw one group of quantities over time; by default the efforts, if there are any."""
        from pmopt.reporting.pictures.motion_plots import quantities

        if self.infeasible:
            raise InputError(self.complaint())
        drawn = quantities(self.motion, self.task.mechanism)
        name = what or ("efforts" if "efforts" in drawn else "joints")
        if name not in drawn:
            raise unknown_name("plot", name, drawn)
        return axes_of(drawn[name])


class SimulationRun(Showing, simulate_run.SimulationRun):
    """A motion, the engine's results for it, and how well both agree."""

    frames: ClassVar[tuple[str, ...]] = ("series", "agreement")

    def _headline(self) -> str:
        """Return the result in one line."""
        engine = self.simulation.engine
        words = "agrees" if self.agrees else "DOES NOT agree"
        return (
            f"{self.task.mechanism.name}: {engine} {words}, largest error {self.worst:.3g} % "
            "of a joint's peak effort"
        )

    def _tables(self) -> list[Table]:
        """Return the agreement of every joint in every mode."""
        return [simulate_run.summary_table(self)]

    def _frame(self, name: str) -> Table:
        """Return every instant, or the agreement."""
        of = simulate_run.series_table if name == "series" else simulate_run.summary_table
        return of(self)

    @named
    def plot(self) -> Axes:
        """Draw each actuated joint's effort, theory over engine, and the error below."""
        return axes_of(lambda: simulate_run.draw_run(self))


class ParetoRun(Showing, pareto_run.ParetoRun):
    """A finished search: the front and how it was found."""

    frames: ClassVar[tuple[str, ...]] = ("front", "regions", "history", "evaluations")
    _config: RunConfig

    def _headline(self) -> str:
        """Return the result in one line."""
        front, knee = self.front, self.front.knee
        at = ", ".join(
            f"{k} {uncertain(value, knee.errors[k], front.units.get(k, ONE))}"
            for k, value in knee.objectives.items()
        )
        return (
            f"{self._config.mechanism}: {len(front.designs)} "
            f"design{'s' if len(front.designs) != 1 else ''}, hypervolume "
            f"{front.hypervolume:.6g} {front.units['hypervolume']}; knee: {at}"
        )

    def _tables(self) -> list[Table]:
        """Return the ends and the knee of the front."""
        return pareto_tables(self)

    @named
    def to_frame(self, name: str | None = None) -> pd.DataFrame:
        """Return the front, or its regions, the history or all evaluations."""
        return self.tables[self._checked(name)].copy()

    @named
    def plot(self, what: Literal["front", "history"] = "front") -> Axes:
        """Draw the front or the course of the search."""
        from pmopt.reporting.runs.run_pictures import of_search
        from pmopt.synthesis.checkpoint import plain

        document = {
            "mechanism": self._config.mechanism,
            "config": plain(self._config),
            "result": self.front.to_dict(),
        }
        drawn = of_search(self.tables, self.front.units, document)
        if what not in drawn:
            raise unknown_name("plot", what, drawn)
        return axes_of(drawn[what])


class BatchResult(Showing, summary.BatchResult):
    """Many runs, each in its own folder."""

    def _headline(self) -> str:
        """Return the result in one line."""
        counts = ", ".join(f"{count} {status}" for status, count in self.counts.items())
        return f"{self.folder}: {counts or 'none'} of {len(self.runs)} runs"

    def _tables(self) -> list[Table]:
        """Return the summary, a table a command."""
        return self.tables()

    def _frame(self, name: str) -> Table:
        """Return a row a run."""
        return self.table()

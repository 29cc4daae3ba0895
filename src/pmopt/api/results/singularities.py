"""Where a workspace is singular."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from pmopt.analysis.singularities import survey
from pmopt.api.keywords import named
from pmopt.api.results.showing import Showing
from pmopt.api.results.workspace import draw_part
from pmopt.reporting.runs import singularity_run
from pmopt.reporting.tables.table import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pmopt.analysis.settings import WorkspaceSettings
    from pmopt.api.design import Design


class SingularityResult(Showing, survey.SingularityResult):
    """Where a workspace is singular: how near it comes, families, walls and aspects."""

    frames: ClassVar[tuple[str, ...]] = ("nearness", "aspects", "families", "walls")
    _design: Design
    _settings: WorkspaceSettings
    _threads: int | None

    def _headline(self) -> str:
        """Return the result in one line."""
        crossed = sum(n.crossed for n in self.nearness)
        return (
            f"{self.mechanism}, {self.working_mode}: {len(self.aspects)} aspects, "
            f"{len(self.families)} singular families, {crossed} of {len(self.nearness)} "
            f"determinants change sign, smallest LCI met {self.smallest_lci:.3g}"
        )

    def _tables(self) -> list[Table]:
        """Return how near the workspace comes to singularities, aspects, families and walls."""
        return singularity_run.singularity_tables(self)

    @named
    def plot(self) -> Axes:
        """Draw the first three sections with the singular loci."""
        return draw_part(
            self._design, self._settings, "sections", seed=self.seed, threads=self._threads
        )

"""A sampled workspace, and pictures of one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, get_args

from pmopt.analysis.workspace import compute
from pmopt.api.keywords import named
from pmopt.api.results.showing import Showing, axes_of
from pmopt.errors import unknown_name
from pmopt.reporting.tables.table import Table
from pmopt.reporting.tables.workspace import workspace_data, workspace_tables

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pmopt.analysis.settings import WorkspaceSettings
    from pmopt.analysis.workspace.compute import WorkspaceResult as Sampled
    from pmopt.api.design import Design

Part = Literal["sections", "surface", "positions"]


def draw_part(
    design: Design, settings: WorkspaceSettings, part: Part, sampled: Sampled | None = None,
    seed: int = 1, threads: int | None = None,
) -> Axes:  # fmt: skip
    """Return the axes of a picture of a design's workspace, which is sampled first if needed."""
    from pmopt.reporting.runs import run_pictures
    from pmopt.reporting.runs.tasks import WorkspaceTask

    mechanism, parameters = design.mechanism, design.parameters
    found = sampled or compute.compute_workspace(
        mechanism, parameters, settings, seed=seed, threads=threads, shape_grid=0
    )
    task = WorkspaceTask(mechanism, parameters, settings, seed, 0)
    return axes_of(lambda: run_pictures.draw_part(task, found, part, threads))


class WorkspaceResult(Showing, compute.WorkspaceResult):
    """A workspace: every number in the unit that ``units`` gives."""

    _design: Design
    _threads: int | None

    def _headline(self) -> str:
        """Return the result in one line."""
        return (
            f"{self.mechanism}, {self.working_mode}: volume {self.volume}, GCI {self.gci}, "
            f"{self.samples} samples ({self.sampler})"
        )

    def _tables(self) -> list[Table]:
        """Return every number with its error, and the shape."""
        return workspace_tables(self)

    def _frame(self, name: str) -> Table:
        """Return all numbers, a row each."""
        return workspace_data(self)

    @named
    def plot(self, what: Literal["histogram"] | Part = "histogram") -> Axes:
        """Draw the distribution of LCI, sections or the surface, cut open.

        Of the sections the first three are drawn; the axes returned are the first one's.
        """
        from pmopt.reporting.pictures.workspace_plots import draw_histogram

        if what == "histogram":
            return axes_of(lambda: draw_histogram(self))
        if what not in get_args(Part):
            raise unknown_name("plot", what, ("histogram", *get_args(Part)))
        return draw_part(self._design, self.settings, what, self, self.seed, self._threads)

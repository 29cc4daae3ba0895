"""Proven results on a workspace."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from pmopt.analysis.certification import claim, volume
from pmopt.api.keywords import named
from pmopt.api.results.showing import Showing
from pmopt.api.results.workspace import draw_part
from pmopt.errors import InputError
from pmopt.reporting.runs import certify_run
from pmopt.reporting.tables.table import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pmopt.analysis.settings import WorkspaceSettings
    from pmopt.api.design import Design


class CertifiedVolume(Showing, volume.CertifiedVolume):
    """Guaranteed bounds of a workspace's volume."""

    frames: ClassVar[tuple[str, ...]] = ("volume", "lci")
    _design: Design
    _settings: WorkspaceSettings

    def _headline(self) -> str:
        """Return the result in one line."""
        return (
            f"{self.mechanism}, {self.working_mode}: volume within [{self.lower:.12g}, "
            f"{self.upper:.12g}] {self.volume_unit}, guaranteed; gap {100 * self.gap:.3g} %"
        )

    def _tables(self) -> list[Table]:
        """Return the bounds of the volume, and those of the index."""
        return certify_run.volume_tables(self)

    def _frame(self, name: str) -> Table:
        """Return the table of that name."""
        if name == "lci" and self.index is None:
            raise InputError("to_frame: lci: nothing is reachable, there is no index")
        return super()._frame(name)

    @named
    def plot(self) -> Axes:
        """Draw the first three sections of the workspace, sampled for the picture."""
        return draw_part(self._design, self._settings, "sections")


class Claim(Showing, claim.Claim):
    """A claim about every reachable pose of a box, and the verdict."""

    _design: Design
    _settings: WorkspaceSettings

    def _headline(self) -> str:
        """Return the result in one line."""
        return f"{self.mechanism}, {self.working_mode}: {self.claim}: {self.verdict}"

    def _tables(self) -> list[Table]:
        """Return the verdict, with the witness if there is one."""
        return certify_run.claim_tables(self)

    @named
    def plot(self) -> Axes:
        """Draw the first three sections of the box with LCI, sampled for the picture."""
        settings = self._settings.model_copy(update={"min_lci": 0.0})
        return draw_part(self._design, settings, "sections")

"""What a run is asked to do, and the plan a dry run shows instead."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.validation import validated
from pmopt.errors import InputError
from pmopt.mechanisms import Mechanism, find
from pmopt.mechanisms.mechanism import Parameters
from pmopt.reporting.tables.table import Shown, Table, estimated
from pmopt.units import ONE


@dataclass(frozen=True)
class WorkspaceTask:
    """The settings of a sampled workspace."""

    mechanism: Mechanism
    parameters: Parameters
    settings: WorkspaceSettings
    seed: int
    shape_grid: int

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form, enough to do it again."""
        return {
            "mechanism": self.mechanism.name,
            "parameters": dict(self.parameters),
            "workspace": self.settings.model_dump(mode="json"),
            "seed": self.seed,
            "shape_grid": self.shape_grid,
        }

    @classmethod
    def from_dict(cls, document: Mapping[str, Any], where: str) -> WorkspaceTask:
        """Return the task a manifest describes.

        Raises
        ------
        InputError
        """
        try:
            mechanism = find(document["mechanism"])
            return cls(
                mechanism,
                mechanism.resolve(document["parameters"]),
                validated(WorkspaceSettings, document["workspace"], where),
                int(document["seed"]),
                int(document["shape_grid"]),
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(f"{where}: is not the manifest of a workspace run: {error}") from None


@dataclass(frozen=True)
class Plan:
    """What a run would do and the time it would take, measured on a small probe."""

    what: str
    points: float
    seconds: float
    units: ClassVar[dict[str, str]] = {"points": ONE, "estimated_time": "s"}

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "would": self.what,
            "points": self.points,
            "estimated_time": self.seconds,
            "units": self.units,
        }

    def table(self) -> Table:
        """Return the one-row table."""
        return Table(
            "Dry run",
            ("would", "points", "estimated_time"),
            ((self.what, Shown(self.points, estimated(self.points, 4)),
              Shown(self.seconds, estimated(self.seconds))),),
            self.units,
            prose=("would",),
        )  # fmt: skip

"""A whole ``pmopt workspace`` run: plan, result, files."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pmopt.analysis.settings import DEFAULT_SAMPLES, WorkspaceSettings
from pmopt.analysis.sweeper import Notify, Sweeper
from pmopt.analysis.validation import validated
from pmopt.analysis.workspace import BINS, Progress, WorkspaceResult, compute_workspace
from pmopt.errors import InputError
from pmopt.mechanisms import Mechanism, find
from pmopt.mechanisms.base import Parameters
from pmopt.reporting.run_folder import RunFolder
from pmopt.reporting.tables import Table, to_csv, to_json
from pmopt.units import ONE


@dataclass(frozen=True)
class WorkspaceTask:
    """What is to be sampled."""

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
            "workspace": _finite(self.settings.model_dump()),
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
            workspace = {k: v for k, v in document["workspace"].items() if v is not None}
            for table in ("domain", "limits"):
                workspace[table] = {
                    name: tuple(map(float, ends)) for name, ends in workspace[table].items()
                }
            if "grid" in workspace:
                workspace.pop("sampler", None)
            return cls(
                mechanism,
                mechanism.resolve(document["parameters"]),
                validated(WorkspaceSettings, workspace, where),
                int(document["seed"]),
                int(document["shape_grid"]),
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(f"{where}: is no manifest of a workspace run: {error}") from None


def _finite(value: Any) -> Any:
    """Return a document with infinite numbers as text, which JSON can hold."""
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return str(value) if isinstance(value, float) and abs(value) == float("inf") else value


@dataclass(frozen=True)
class Plan:
    """What a run would do and the time it would take, measured on a small probe."""

    what: str
    points: float
    seconds: float
    units: dict[str, str]

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
            ((self.what, self.points, self.seconds),),
            self.units,
            display=((self.what, f"{self.points:.4g}", f"{self.seconds:.2g}"),),
        )


_PROBE = 1 << 18
PLAN_UNITS = {"points": ONE, "estimated_time": "s"}


def plan(task: WorkspaceTask, threads: int | None, notify: Notify) -> Plan:
    """Measure a small probe and scale it to the run asked for."""
    settings, dimension = task.settings, len(task.mechanism.pose)
    Sweeper(task.mechanism, settings, task.seed, threads, notify)  # compiles
    probe = settings.model_copy(update={"grid": None, "target_error": None, "samples": _PROBE})
    began = time.perf_counter()
    found = compute_workspace(
        task.mechanism, task.parameters, probe, seed=task.seed, threads=threads, shape_grid=0
    )
    seconds = time.perf_counter() - began
    if settings.grid is not None:
        points, what = float(settings.grid) ** dimension * 1.7, f"grid of {settings.grid} cells"
    elif settings.target_error is not None:
        # Low-discrepancy points: the error falls about with the power 0.85 of their number.
        worst = max(e.error / e.value if e.value > 0 else 0.0 for e in (found.volume, found.gci))
        power = 0.5 if settings.sampler == "monte-carlo" else 0.85
        points = _PROBE * max(2.0, 2 * (worst / settings.target_error) ** (1 / power))
        what = f"{settings.sampler} to a relative error of {settings.target_error:g}"
    else:
        points = float(settings.samples or DEFAULT_SAMPLES)
        what = f"{points:.4g} samples, {settings.sampler}"
    return Plan(f"workspace {task.mechanism.name}: {what}", points, seconds * points / _PROBE,
                PLAN_UNITS)  # fmt: skip


def run_workspace(
    task: WorkspaceTask,
    out: Path | None = None,
    *,
    force: bool = False,
    threads: int | None = None,
    notify: Notify | None = None,
    progress: Progress | None = None,
) -> WorkspaceResult:
    """Sample a workspace and, with ``out``, write the run's folder.

    Raises
    ------
    InputError
        When the folder holds a run, or for names and values the mechanism does not have.
    """
    folder = RunFolder(out, force) if out is not None else None
    result = compute_workspace(
        task.mechanism,
        task.parameters,
        task.settings,
        seed=task.seed,
        threads=threads,
        shape_grid=task.shape_grid,
        progress=progress,
        notify=notify,
    )
    if folder is not None:
        from pmopt.reporting import pictures

        drawn = pictures.of_workspace(task, result, threads)
        folder.open()
        folder.write("result.json", to_json(result.to_dict()) + "\n")
        folder.write("lci_histogram.csv", to_csv([histogram_table(result)]) + "\n")
        folder.write("regions.csv", to_csv([regions_table(result)]) + "\n")
        for name, data in drawn.items():
            folder.write(name, data)
        folder.close(
            "workspace",
            {
                "mechanism": task.mechanism.name,
                "config": task.to_dict(),
                "seed": task.seed,
                "resumes": [],
                "units": result.units,
            },
        )
    return result


def histogram_table(result: WorkspaceResult) -> Table:
    """Return the LCI histogram: counts, and the volume and share they stand for."""
    total = max(result.reachable, 1)
    volume = 0.0 if result.reachable == 0 else result.volume.value
    rows = tuple(
        (i / BINS, (i + 1) / BINS, count, volume * count / total, count / total)
        for i, count in enumerate(result.histogram)
    )
    return Table("LCI histogram", ("lower", "upper", "count", "volume", "share"), rows,
                 result.units)  # fmt: skip


def regions_table(result: WorkspaceResult) -> Table:
    """Return the volume breakdown by dexterity region."""
    names = ("lower", "upper", "volume", "share", "volume_error", "share_error")
    document = result.to_dict()["regions"]
    keys = ("lower", "upper", "volume", "share", "volume_standard_error", "share_standard_error")
    rows = tuple(tuple(r[k] for k in keys) for r in document)
    return Table("Dexterity regions", names, rows, result.units)


def read_result(folder: Path) -> dict[str, Any]:
    """Return a run's result.json."""
    document: dict[str, Any] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    return document

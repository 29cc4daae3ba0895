"""What has become of the runs of a batch, read from their folders, and its tables."""

from __future__ import annotations

import contextlib
import csv
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

from pmopt.inputs.reading import read_json
from pmopt.reporting.batch.runners import ERRORS, RUNNERS, Results
from pmopt.reporting.runs.run_folder import read_manifest
from pmopt.reporting.tables.table import Cell, Shown, Table

#: File of what kept a run from its end.
FAILURE = "failure.json"

#: Columns that every summary has; sweeping such a key adds no other.
_FIXED = ("mechanism", "command")

Status = Literal["finished", "infeasible", "failed", "pending"]


@dataclass(frozen=True)
class RunSummary:
    """What has become of one run.

    Attributes
    ----------
    name, command, mechanism, source, swept
        See :class:`pmopt.reporting.batch.plan.PlannedRun`.
    folder : Path
    status : str
        ``finished``, ``infeasible``, ``failed``, or ``pending`` where it was not run to its end.
    message : str
        Why it is not finished.
    results : Results
    wall_time : float or None
        Of the finished run, in s; no part of the written summary, which is the same every time.
    """

    name: str
    command: str
    mechanism: str
    source: str
    swept: dict[str, Cell]
    folder: Path
    status: Status
    message: str
    results: Results
    wall_time: float | None

    @property
    def headline(self) -> str:
        """Name, status, and the message or the first results."""
        names = [key for key in self.results.values if not key.endswith(ERRORS)]
        first = ", ".join(f"{key} {self.results.shown(key)}" for key in names[:2])
        text = self.message or first
        return f"{self.name}: {self.status}{f', {text}' if text else ''}"

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "name": self.name,
            "command": self.command,
            "mechanism": self.mechanism,
            "source": self.source,
            "swept": self.swept,
            "folder": str(self.folder),
            "status": self.status,
            "message": self.message,
            "results": self.results.values,
            "units": self.results.units,
            "wall_time": self.wall_time,
        }


@dataclass(frozen=True)
class BatchResult:
    """All runs of a batch, or of its shards, in the order of the plan."""

    folder: Path
    runs: tuple[RunSummary, ...]
    units: ClassVar[dict[str, str]] = {"wall_time": "s"}

    @property
    def complete(self) -> bool:
        """Whether every run is finished."""
        return all(run.status == "finished" for run in self.runs)

    @property
    def infeasible(self) -> bool:
        """Whether there are runs, none of which found anything feasible or reachable."""
        return bool(self.runs) and all(run.status == "infeasible" for run in self.runs)

    @property
    def counts(self) -> dict[str, int]:
        """Return the number of runs by status."""
        return dict(Counter(run.status for run in self.runs))

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "out": str(self.folder),
            "counts": self.counts,
            "runs": [run.to_dict() for run in self.runs],
            "units": self.units,
        }

    def table(self) -> Table:
        """Return the summary as it is written: a row a run, a column for all that any run has."""
        swept = [key for key in _in_order(run.swept for run in self.runs) if key not in _FIXED]
        values = _in_order(run.results.values for run in self.runs)
        columns = ("name", "command", "mechanism", "status", *swept, *values, "units", "message")
        rows = tuple(
            (
                run.name,
                run.command,
                run.mechanism,
                run.status,
                *(run.swept.get(key) for key in swept),
                *(run.results.values.get(key) for key in values),
                _said(run.results.units),
                run.message,
            )
            for run in self.runs
        )
        return Table("Batch", columns, rows, {})

    def tables(self) -> list[Table]:
        """Return the summary as people read it, a table a command: errors beside values, times."""
        counts = ", ".join(f"{count} {status}" for status, count in self.counts.items())
        notes = [f"{run.name}: {run.message}" for run in self.runs if run.message]
        notes.append(f"{counts or 'none'} of {len(self.runs)} runs")
        notes += self._references()
        groups: dict[tuple[str, ...], list[RunSummary]] = {}
        for run in self.runs:
            groups.setdefault(self._columns_of(run), []).append(run)
        last = len(groups) - 1
        return [
            self._of_group(runs, tuple(notes) if number == last else ())
            for number, runs in enumerate(groups.values())
        ] or [Table(f"Batch in {self.folder}", ("name", "status"), (), {}, tuple(notes))]

    def _references(self) -> list[str]:
        """Say where hypervolumes of one mechanism are from different references."""
        found: dict[tuple[str, str], set[Any]] = {}
        for run in self.runs:
            for key, value in run.results.values.items():
                if key.startswith("reference_"):
                    found.setdefault((run.mechanism, key), set()).add(value)
        return [
            f"{mechanism}: hypervolumes are from different references ({name}), since the bounds "
            "differ: they do not compare; algorithm.reference fixes one"
            for (mechanism, name), values in found.items()
            if len(values) > 1
        ]

    def _columns_of(self, run: RunSummary) -> tuple[str, ...]:
        """Return the command and the names of results; without any, those of a run like it."""
        alike = [r for r in self.runs if r.command == run.command and r.results.values]
        nearer = [r for r in alike if r.mechanism == run.mechanism]
        found = next(iter([run] * bool(run.results.values) + nearer + alike), run)
        return run.command, *found.results.values

    def _of_group(self, runs: list[RunSummary], notes: tuple[str, ...]) -> Table:
        swept = [key for key in _in_order(run.swept for run in runs) if key not in _FIXED]
        shown = [key for key in _in_order(run.results.values for run in runs)
                 if not key.endswith(ERRORS)]  # fmt: skip
        fixed = ["mechanism"] if len({run.mechanism for run in runs}) > 1 else []
        units = _common_units(runs)
        rows = tuple(
            (
                run.name,
                *([run.mechanism] if fixed else []),
                run.status,
                *(run.swept.get(key) for key in swept),
                *(run.results.cell(key, unit=key not in units) for key in shown),
                None if run.wall_time is None else Shown(run.wall_time, f"{run.wall_time:.2f}"),
            )
            for run in runs
        )
        columns = ("name", *fixed, "status", *swept, *shown, "wall_time")
        title = f"{runs[0].command} runs in {self.folder}"
        errors = {key: (f"{key}_error",) for key in shown
                  if any(run.results.error(key) is not None for run in runs)}  # fmt: skip
        return Table(title, columns, rows, {**self.units, **units}, notes, errors=errors)


def _in_order(mappings: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the keys of all mappings in the order they first appear."""
    return list(dict.fromkeys(key for mapping in mappings for key in mapping))


def _said(units: Mapping[str, str]) -> str:
    return "; ".join(f"{name}: {unit}" for name, unit in units.items())


def _common_units(runs: Sequence[RunSummary]) -> dict[str, str]:
    """Return the unit of each result where all runs share it; elsewhere cells name theirs."""
    found: dict[str, set[str]] = {}
    for run in runs:
        for name in run.results.values:
            found.setdefault(name, set()).add(run.results.unit(name))
    return {name: units.pop() for name, units in found.items() if len(units) == 1}


def _checked(results: Results) -> Results:
    """Return results that are numbers and names of units; a damaged file may hold anything.

    Raises
    ------
    TypeError, ValueError
    """
    for name, value in results.values.items():
        if value is not None and not math.isfinite(value):
            raise ValueError(f"{name} is no finite number")
    if not all(isinstance(unit, str) for unit in results.units.values()):
        raise TypeError("a unit is no text")
    return results


def summary_of(planned: Mapping[str, Any], folder: Path) -> RunSummary:
    """Return the state of a planned run, from the files in its folder."""
    status: Status = "pending"
    message, results, wall_time = "", Results({}, {}), None
    manifest = read_manifest(folder)
    if manifest is not None:
        try:
            results = _checked(RUNNERS[planned["command"]].results(folder, manifest))
            status, wall_time = "finished", float(manifest["wall_time"])
        except (
            OSError,
            ArithmeticError,
            ValueError,
            LookupError,
            TypeError,
            AttributeError,
            csv.Error,
        ) as error:
            status, message = "failed", f"{folder}: files of a finished run are damaged ({error!r})"
    else:
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            failure = read_json(folder / FAILURE)
            if failure["status"] in ("infeasible", "failed"):
                status, message = failure["status"], str(failure["message"])
    return RunSummary(
        planned["name"], planned["command"], planned["mechanism"], planned["source"],
        planned["swept"], folder, status, message, results, wall_time,
    )  # fmt: skip

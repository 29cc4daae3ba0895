"""What a batch can run: one class a command, from a configuration to the key results in its folder.

A command joins by a subclass of :class:`Runner` in :data:`RUNNERS`.
"""

from __future__ import annotations

import csv
import io
import json
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from pmopt.analysis.certification.budgets import Clock
from pmopt.analysis.motion.config import MotionTask, resolve_motion
from pmopt.analysis.sampling.evaluator import Evaluator, Notify
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceConfig, named_mechanism
from pmopt.analysis.validation import validated
from pmopt.analysis.workspace.compute import check_read
from pmopt.analysis.workspace.shape import DEFAULT_GRIDS, check_cells
from pmopt.errors import InfeasibleError, InputError, unknown_name
from pmopt.inputs.reading import read_file, read_json
from pmopt.mechanisms import find
from pmopt.quantity import uncertain
from pmopt.reporting.runs import workspace_checkpoint
from pmopt.reporting.runs.run_folder import manifest_to_keep
from pmopt.reporting.runs.tasks import Plan, WorkspaceTask
from pmopt.reporting.tables.table import Cell, Shown, Uncertain, shown
from pmopt.storage.checkpoint import CheckpointFolder, Grows, changes
from pmopt.storage.files import sha256
from pmopt.synthesis.checkpoint import GROWS, plain
from pmopt.synthesis.config import RunConfig, resolve_config
from pmopt.synthesis.objectives import SENSES
from pmopt.units import ONE

if TYPE_CHECKING:
    from pmopt.analysis.motion.dynamics import Mover

#: Ends of the names of what stands beside a result: its standard error, or a bound of its error.
ERRORS = ("_error", "_error_bound")
#: Called again and again during a run; what it raises ends the run.
Beat = Callable[[], None]


class Results(NamedTuple):
    """The key results of a finished run, and the units of those that have one."""

    values: dict[str, float | int | None]
    units: dict[str, str]

    def unit(self, name: str) -> str:
        """Return the unit of a result, which is that of its quantity."""
        quantity = re.sub("^(best|knee|reference)_", "", name).removesuffix("_error")
        quantity = quantity.removesuffix("_error_bound")
        return self.units.get(quantity, ONE)

    def error(self, name: str) -> float | int | None:
        """Return the standard error of a result or, without one, the bound of its error."""
        errors = (self.values.get(f"{name}{ending}") for ending in ERRORS)
        return next((error for error in errors if error is not None), None)

    def _bound(self, name: str) -> bool:
        return self.values.get(f"{name}{ERRORS[0]}") is None

    def shown(self, name: str) -> str:
        """Return a result as people read it: with its error, if it has one, and its unit."""
        value, error, unit = self.values.get(name), self.error(name), self.unit(name)
        if value is None:
            return "-"
        if error is not None:
            return uncertain(value, error, unit, self._bound(name))
        return shown(value) + ("" if unit == ONE else f" {unit}")

    def cell(self, name: str, unit: bool) -> Cell:
        """Return a result as the cell of a table, in words if the cell has to name the unit."""
        value, error = self.values.get(name), self.error(name)
        if value is None:
            return None
        if unit:
            return Shown(value, self.shown(name))
        return value if error is None else Uncertain(value, error, self._bound(name))


def _rows_of(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file of a run."""
    return list(csv.DictReader(io.StringIO(read_file(path).decode("utf-8"), newline="")))


class Runner(ABC):
    """One run of a command.

    Attributes
    ----------
    command : str
        What ``command = ".."`` in a configuration calls it.
    marks : tuple of str
        Keys by which a configuration without ``command`` is known as one of this command.
    grows : mapping
        What continues a run instead of changing it; see :mod:`pmopt.storage.checkpoint`.
    """

    command: ClassVar[str]
    marks: ClassVar[tuple[str, ...]] = ()
    grows: ClassVar[Mapping[str, Grows]] = {}

    @classmethod
    @abstractmethod
    def resolve(cls, data: dict[str, Any], where: str) -> Runner:
        """Validate a configuration, without its ``command``.

        Parameters
        ----------
        data : dict
            As TOML gives it, or :meth:`document`.
        where : str
            Its file, beside which other files that it names are.

        Raises
        ------
        InputError
        """

    @property
    @abstractmethod
    def mechanism(self) -> str:
        """Name of the mechanism."""

    @abstractmethod
    def document(self) -> dict[str, Any]:
        """Return the resolved configuration as the manifest of its run has it."""

    @abstractmethod
    def ready(self, notify: Notify | None = None) -> Evaluator | Mover | None:
        """Check all that can be checked ahead, and return what calls compiled kernels.

        Raises
        ------
        InputError
        """

    @abstractmethod
    def run(
        self, folder: Path, *, force: bool, threads: int | None, beat: Beat | None = None
    ) -> None:
        """Run into a folder, or go on there; ``force`` starts afresh.

        Raises
        ------
        PmoptError
        """

    @abstractmethod
    def plan(self, threads: int | None, notify: Notify) -> Plan:
        """Measure a probe and scale it to the run."""

    @classmethod
    @abstractmethod
    def results(cls, folder: Path, manifest: Mapping[str, Any]) -> Results:
        """Return the key results of a finished run; what its files lack raises KeyError."""

    @classmethod
    def complete(cls, document: dict[str, Any]) -> dict[str, Any]:
        """Return a configuration with all that is left to a default filled in."""
        return document

    @classmethod
    def recorded(cls, manifest: Mapping[str, Any]) -> dict[str, Any]:
        """Return the configuration of a finished run."""
        return dict(manifest["config"])

    def identity(self) -> dict[str, Any]:
        """Return all that the result depends on, as :meth:`recorded` gives it of this run."""
        return self.document()

    def changes(self, folder: Path) -> list[str]:
        """Return what keeps this run from going on in a folder, as ``key: old -> new``."""
        manifest = manifest_to_keep(folder)
        found = CheckpointFolder.configuration(folder)
        before = self._recorded(folder, manifest) if manifest else found
        if before is None:
            return []
        return changes(self.complete(before), self.complete(self.identity()), self.grows)

    def _recorded(self, folder: Path, manifest: Mapping[str, Any]) -> dict[str, Any]:
        try:
            return self.recorded(manifest)
        except (LookupError, TypeError, AttributeError):
            raise InputError(f"{folder}: its manifest.json is damaged") from None

    def done(self, folder: Path) -> float | None:
        """Return the share of a running run that is done, None where it is not known."""
        return None

    def finished(self, folder: Path) -> bool:
        """Return whether a folder holds this very run, finished."""
        manifest = manifest_to_keep(folder)
        if manifest is None or manifest["command"] != self.command:
            return False
        before = self._recorded(folder, manifest)
        return self.complete(before) == self.complete(self.identity())


@dataclass(frozen=True)
class ParetoRunner(Runner):
    """``pmopt pareto``."""

    command = "pareto"
    grows = GROWS
    config: RunConfig

    @classmethod
    def resolve(cls, data: dict[str, Any], where: str) -> ParetoRunner:
        """Validate a configuration as ``pmopt pareto`` does."""
        return cls(resolve_config(data, where))

    @property
    def mechanism(self) -> str:
        """Name of the mechanism."""
        return self.config.mechanism

    def document(self) -> dict[str, Any]:
        """Return the resolved configuration."""
        return plain(self.config)

    def ready(self, notify: Notify | None = None) -> Evaluator:
        """Return the problem's evaluator."""
        config = self.config
        return make_sampler(
            find(config.mechanism), config.workspace, config.algorithm.seed, 1, notify
        ).evaluator

    def run(
        self, folder: Path, *, force: bool, threads: int | None, beat: Beat | None = None
    ) -> None:
        """Search, or go on after the last generation on disk."""
        from pmopt.reporting.runs.pareto_run import run_pareto

        def on_event(*_: Any) -> None:
            if beat is not None:
                beat()

        run_pareto(
            self.config, folder, force=force, resume=not force, threads=threads,
            on_generation=on_event, on_measured=on_event,
        )  # fmt: skip

    def plan(self, threads: int | None, notify: Notify) -> Plan:
        """Measure some generations."""
        from pmopt.reporting.runs import pareto_run

        return pareto_run.plan(self.config, threads, notify)

    @classmethod
    def results(cls, folder: Path, manifest: Mapping[str, Any]) -> Results:
        """Return the front's size and hypervolume, the best of each objective and the knee."""
        found, names = manifest["result"], manifest["config"]["objectives"]
        front = _rows_of(folder / "front.csv")
        values: dict[str, float | int | None] = {
            "designs": found["designs"],
            "hypervolume": found["hypervolume"],
        }
        for name in names:
            if SENSES[name] < 0:  # 0 for what is maximised
                values[f"reference_{name}"] = found["reference_point"][name]
        for name in names:
            best = max(front, key=lambda row: SENSES[name] * float(row[name]))
            values[f"best_{name}"] = float(best[name])
            values[f"best_{name}_error"] = float(best[f"{name}_error"])
        for name in names:
            values[f"knee_{name}"] = found["knee"][name]
            values[f"knee_{name}_error"] = found["knee"][f"{name}_error"]
        units = {name: manifest["units"][name] for name in ("hypervolume", *names)}
        return Results(values, {name: unit for name, unit in units.items() if unit != ONE})

    def done(self, folder: Path) -> float | None:
        """Return the share of generations on disk."""
        return CheckpointFolder.count(folder) / self.config.algorithm.generations


@dataclass(frozen=True)
class WorkspaceRunner(Runner):
    """``pmopt workspace``."""

    command = "workspace"
    grows = workspace_checkpoint.GROWS
    task: WorkspaceTask

    @classmethod
    def resolve(cls, data: dict[str, Any], where: str) -> WorkspaceRunner:
        """Validate what the options of ``pmopt workspace`` are elsewhere."""
        mechanism = named_mechanism(data, where)
        config = validated(WorkspaceConfig, data, where, mechanism.units)
        dimension = len(mechanism.pose)
        cells = DEFAULT_GRIDS[dimension] if config.shape_grid is None else config.shape_grid
        check_cells(cells, dimension, f"{where}: shape_grid")
        try:
            check_read(config.workspace, cells)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        return cls(
            WorkspaceTask(
                mechanism,
                mechanism.resolve(config.parameters, f"{where}: parameters"),
                config.workspace,
                config.seed,
                cells,
            )
        )

    @property
    def mechanism(self) -> str:
        """Name of the mechanism."""
        return self.task.mechanism.name

    def document(self) -> dict[str, Any]:
        """Return the resolved task."""
        document: dict[str, Any] = json.loads(json.dumps(self.task.to_dict()))
        return document

    @classmethod
    def complete(cls, document: dict[str, Any]) -> dict[str, Any]:
        """Return a configuration with the number of samples and replicates filled in."""
        return workspace_checkpoint.resolved(WorkspaceTask.from_dict(document, cls.command))

    def ready(self, notify: Notify | None = None) -> Evaluator:
        """Return the task's evaluator."""
        return make_sampler(
            self.task.mechanism, self.task.settings, self.task.seed, 1, notify
        ).evaluator

    def run(
        self, folder: Path, *, force: bool, threads: int | None, beat: Beat | None = None
    ) -> None:
        """Sample the workspace."""
        from pmopt.reporting.runs.workspace_run import run_workspace

        def progress(*_: int) -> None:
            if beat is not None:
                beat()

        run_workspace(
            self.task, folder, force=force, resume=not force, threads=threads, progress=progress
        )

    def plan(self, threads: int | None, notify: Notify) -> Plan:
        """Measure some samples."""
        from pmopt.reporting.runs import workspace_run

        return workspace_run.plan(self.task, threads, notify)

    @classmethod
    def results(cls, folder: Path, manifest: Mapping[str, Any]) -> Results:
        """Return volume, GCI and their errors."""
        found = read_json(folder / "result.json")
        bounded = "error_bound" in found["volume"]
        suffix, kind = ("_bound", "error_bound") if bounded else ("", "standard_error")
        values = {
            name: value
            for key in ("volume", "gci")
            for name, value in (
                (key, found[key]["value"]), (f"{key}_error{suffix}", found[key][kind])
            )
        }  # fmt: skip
        values |= {"samples": found["samples"], "reachable": found["reachable"]}
        return Results(values, {"volume": found["volume"]["unit"]})


@dataclass(frozen=True)
class MotionRunner(Runner):
    """``pmopt motion``."""

    command = "motion"
    marks = ("trajectory",)
    task: MotionTask

    @classmethod
    def resolve(cls, data: dict[str, Any], where: str) -> MotionRunner:
        """Validate a configuration as ``pmopt motion`` does."""
        return cls(resolve_motion(data, where, Path(where).parent))

    @property
    def mechanism(self) -> str:
        """Name of the mechanism."""
        return self.task.mechanism.name

    def document(self) -> dict[str, Any]:
        """Return the resolved configuration."""
        return self.task.to_dict()

    @classmethod
    def recorded(cls, manifest: Mapping[str, Any]) -> dict[str, Any]:
        """Return the configuration with the recording's own name and the digest of its content."""
        config = json.loads(json.dumps(manifest["config"]))
        for kept, name in manifest["inputs"].items():
            config["trajectory"] |= {"file": name, "sha256": manifest["outputs"][kept]}
        return dict(config)

    def identity(self) -> dict[str, Any]:
        """Return the configuration with the digest of the recording that it names."""
        document = json.loads(json.dumps(self.document()))
        name = self.task.config.trajectory.file
        if name is not None:
            document["trajectory"]["sha256"] = sha256(read_file(self.task.folder / name))
        return dict(document)

    def ready(self, notify: Notify | None = None) -> Mover:
        """Plan the trajectory, and return what moves the mechanism."""
        from pmopt.analysis.motion.dynamics import Mover
        from pmopt.analysis.motion.trajectories import plan_trajectory

        task = self.task
        plan_trajectory(task)
        mode = task.mechanism.check_mode(task.config.working_mode)
        return Mover(task.mechanism, task.parameters, mode, threads=1, notify=notify)

    def run(
        self, folder: Path, *, force: bool, threads: int | None, beat: Beat | None = None
    ) -> None:
        """Move, which takes moments."""
        from pmopt.reporting.runs.motion_run import run_motion

        found = run_motion(self.task, folder, force=force, threads=threads)
        if found.infeasible:
            raise InfeasibleError(found.complaint())

    def plan(self, threads: int | None, notify: Notify) -> Plan:
        """Measure the motion itself."""
        from pmopt.reporting.runs.motion_run import run_motion

        clock = Clock()
        found = run_motion(self.task, threads=threads, notify=notify)
        count = float(len(found.motion.t))
        return Plan(f"motion {self.mechanism}", count, clock.seconds)

    @classmethod
    def results(cls, folder: Path, manifest: Mapping[str, Any]) -> Results:
        """Return the peaks of effort and power of each joint; without masses, of its rate."""
        found = _rows_of(folder / "summary.csv")
        rows = [row for row in found if row["quantity"] in ("effort", "power")] or [
            row for row in found if row["quantity"] == "rate"
        ]
        names = [f"{row['joint']}_{row['quantity']}_peak" for row in rows]
        return Results(
            {name: float(row["peak"]) for name, row in zip(names, rows, strict=True)},
            {
                name: row["unit"]
                for name, row in zip(names, rows, strict=True)
                if row["unit"] != ONE
            },
        )


RUNNERS: dict[str, type[Runner]] = {
    r.command: r for r in (ParetoRunner, WorkspaceRunner, MotionRunner)
}


def resolve(data: dict[str, Any], where: str) -> Runner:
    """Return the run that a configuration describes.

    ``command`` names what runs it; without it a key that only one command has decides, else it is
    ``pareto``.

    Raises
    ------
    InputError
        One line: file, key, value and what is allowed.
    """
    marked = [name for name, runner in RUNNERS.items() if set(runner.marks) & set(data)]
    command = data.get("command", marked[0] if marked else ParetoRunner.command)
    if not isinstance(command, str):
        allowed = ", ".join(RUNNERS)
        raise InputError(f"{where}: command={command!r} is not allowed: one of {allowed} is needed")
    if command not in RUNNERS:
        raise unknown_name(f"{where}: command", command, RUNNERS)
    return RUNNERS[command].resolve({k: v for k, v in data.items() if k != "command"}, where)

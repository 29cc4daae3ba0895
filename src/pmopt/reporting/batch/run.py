"""A whole ``pmopt batch``: many runs in one folder, each in its own, and their summary.

What is done stands on disk alone, run by run, so that a batch that was cut off anywhere goes on
from there and shards of it are merged by reading their folders.
"""

from __future__ import annotations

import contextlib
import json
import os
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from pmopt.analysis.sampling.evaluator import Evaluator, Notify
from pmopt.analysis.sampling.warmup import warm_up
from pmopt.errors import InputError, InputErrors, PmoptError
from pmopt.execution.cluster import Cluster
from pmopt.execution.threads import default_threads
from pmopt.execution.workers import LocalWorkers, Pool
from pmopt.reporting.batch.jobs import Job, Outcome, run_job
from pmopt.reporting.batch.plan import (
    PlannedRun,
    find_configs,
    in_shard,
    parse_shard,
    plan_runs,
)
from pmopt.reporting.batch.shards import LOCK, SCHEMA, SUMMARY, read_plan, shard_text
from pmopt.reporting.batch.summary import FAILURE, BatchResult, RunSummary, summary_of
from pmopt.reporting.pictures.gallery import missing_lines
from pmopt.reporting.runs.run_folder import (
    PLAN,
    RUNS,
    RunFolder,
    read_manifest,
)
from pmopt.reporting.tables.table import Shown, Table, estimated, to_csv
from pmopt.storage.files import unwritable, write_atomic
from pmopt.storage.swap import NEXT

if TYPE_CHECKING:
    from pmopt.analysis.motion.dynamics import Mover

#: Runs of each command and mechanism that a dry run measures.
_PROBED = 2


#: Called with the number of a run and what has become of it.
OnDone = Callable[["RunSummary"], None]


@dataclass(frozen=True)
class BatchPlan:
    """What a batch would do and the time it would take, measured on some of its runs."""

    rows: tuple[tuple[str, str, int, int, int, float], ...]
    workers: int
    columns: ClassVar[tuple[str, ...]] = (
        "command", "mechanism", "runs", "finished", "probed", "cpu_time",
    )  # fmt: skip
    units: ClassVar[dict[str, str]] = {"cpu_time": "s", "estimated_time": "s"}

    @property
    def seconds(self) -> float:
        """Estimated time of the whole batch."""
        return sum(row[-1] for row in self.rows) / self.workers

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "groups": [dict(zip(self.columns, row, strict=True)) for row in self.rows],
            "workers": self.workers,
            "estimated_time": self.seconds,
            "units": self.units,
        }

    def table(self) -> Table:
        """Return a row for each command and mechanism."""
        workers = f"{self.workers} worker{'s' * (self.workers > 1)}"
        note = f"on {workers} about {estimated(self.seconds)} s"
        rows = tuple((*row[:-1], Shown(row[-1], estimated(row[-1]))) for row in self.rows)
        return Table("Dry run", self.columns, rows, self.units, (note,))


@dataclass(frozen=True)
class Share:
    """How work is shared: over processes or over the threads of each, never both.

    Attributes
    ----------
    workers, threads : int
        Processes of this machine and threads of each run; one of them is 1.
    scheduler : str or None
        Of the Dask cluster that is used instead.
    """

    workers: int
    threads: int
    scheduler: str | None

    def pool(self, notify: Notify | None = None) -> LocalWorkers | Cluster:
        """Return what runs the runs, a context."""
        if self.scheduler is None:
            return LocalWorkers(self.workers)
        return Cluster(self.scheduler, notify)


def shares(
    runs: int, workers: int | None = None, threads: int | None = None, scheduler: str | None = None
) -> Share:
    """Return how runs are shared.

    By default: fewer runs than cores go one after the other, each on all of them.

    Raises
    ------
    InputError
        For what excludes each other.
    """
    if scheduler is not None:
        if workers or threads:
            other = "--workers" if workers else "--threads"
            raise InputError(f"--scheduler and {other} exclude each other: the cluster has its own")
        return Share(0, 1, scheduler)
    if (workers or 1) > 1 and (threads or 1) > 1:
        raise InputError("--workers and --threads exclude each other: one of them may be over 1")
    cores = default_threads()
    if workers is None:
        workers = 1 if (threads or 1) > 1 or runs < cores else cores
    return Share(workers, (threads or cores) if workers == 1 else 1, None)


def run_batch(
    configs: Sequence[str],
    out: Path,
    *,
    workers: int | None = None,
    threads: int | None = None,
    scheduler: str | None = None,
    shard: str | None = None,
    force: bool = False,
    notify: Notify | None = None,
) -> BatchResult:
    """Run configurations, or those not yet done, into a folder.

    Parameters
    ----------
    configs : sequence of str
        Files and globs.
    out : Path
    workers, threads, scheduler
        See :func:`shares`.
    shard : str, optional
        ``"2/5"``: only the second of five parts.
    force : bool
        Start every run afresh.
    notify : callable, optional

    Raises
    ------
    InputErrors
        With a line for everything that is wrong, before anything is run.
    """
    notify = notify or (lambda text: None)
    part = None if shard is None else parse_shard(shard)
    batch = Batch(plan_runs(find_configs(configs)), out, part)
    batch.check(force)
    share = shares(len(batch.own), workers, threads, scheduler)
    with share.pool(notify) as pool:
        return batch.run(pool, force=force, threads=share.threads, notify=notify)


@dataclass(frozen=True)
class Batch:
    """A batch and its folder.

    Parameters
    ----------
    runs : sequence of PlannedRun
        The whole plan, all shards.
    folder : Path
    shard : (int, int), optional
        Only the k-th of n parts is run.
    """

    runs: Sequence[PlannedRun]
    folder: Path
    shard: tuple[int, int] | None = None

    @property
    def own(self) -> list[PlannedRun]:
        """The runs of this shard."""
        return [run for k, run in enumerate(self.runs) if in_shard(k, self.shard)]

    def todo(self, force: bool) -> list[PlannedRun]:
        """Return the runs of this shard that are not finished, or all."""
        return [r for r in self.own if force or not r.runner.finished(self.run_folder(r))]

    @property
    def place(self) -> Path:
        """Where the batch is: in its folder, or beside the one it is to replace there."""
        beside = self.folder / NEXT
        return beside if (beside / PLAN).is_file() else self.folder

    def run_folder(self, run: PlannedRun) -> Path:
        """Return the folder of a run."""
        return self.place / RUNS / run.name

    def check(self, force: bool) -> None:
        """Refuse what cannot be run, before anything is.

        Raises
        ------
        InputError
            For a folder that is not this batch's.
        InputErrors
            A line for each run that its mechanism or its folder does not allow.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(f"--out: {self.folder} is a file, not a folder")
        manifest = read_manifest(self.folder)
        if manifest is not None and manifest["command"] != "batch":
            raise InputError(
                f"--out: {self.folder} holds a finished {manifest['command']} run, not a batch"
            )
        before = read_plan(self.place)
        shard = shard_text(self.shard)
        if before is not None and before["shard"] != shard and not force:
            raise InputError(
                f"--out: {self.folder} holds {before['shard'] or 'all'} of a batch, this is "
                f"{shard or 'all'} of one; another folder or --force is needed"
            )
        wrong: dict[str, int] = {}
        for run in self.own:
            try:
                run.runner.ready()
                line = self._of_folder(run, force)
            except InputError as error:
                line = f"{run.source}: {error}"
            if line:
                wrong[line] = wrong.get(line, 0) + 1
        if wrong:
            raise InputErrors([f"{line} ({n} runs)" if n > 1 else line
                                      for line, n in wrong.items()])  # fmt: skip

    def _of_folder(self, run: PlannedRun, force: bool) -> str:
        """Return what is wrong with the folder of a run, nothing where it may be written."""
        folder = self.run_folder(run)
        for path in (folder.parent, folder):
            if path.is_symlink():
                return f"{path}: is a symbolic link, a batch writes into its own folder only"
            if path.exists() and not path.is_dir():
                return f"{path}: is a file, not a folder"
        for path in folder.glob("*"):
            if path.is_symlink() and path.is_dir():
                return f"{path}: is a symbolic link, a batch writes into its own folder only"
        if force:
            return ""
        manifest = read_manifest(folder)
        if manifest is not None and manifest["command"] != run.runner.command:
            return f"{folder}: holds a finished {manifest['command']} run, not {run.runner.command}"
        changed = "; ".join(run.runner.changes(folder))
        if not changed:
            return ""
        return (
            f"{folder}: holds a run of another configuration: {changed}; "
            "another --out or --force is needed"
        )

    def finished(self) -> bool:
        """Return whether this very batch is finished, its last run and its summary."""
        manifest = read_manifest(self.folder)
        return (
            manifest is not None
            and self.place == self.folder  # else one was begun that replaces it
            and (read_plan(self.place) or {}).get("runs") == [r.to_dict() for r in self.runs]
            and not self.todo(force=False)
        )

    def run(
        self, pool: Pool, *, force: bool = False, threads: int | None = None, notify: Notify,
        on_done: OnDone | None = None, tick: Callable[[list[str]], None] | None = None,
    ) -> BatchResult:  # fmt: skip
        """Run what is not done yet and write the summary.

        Parameters
        ----------
        pool : Pool
        force : bool
            Start every run afresh.
        threads : int, optional
            Of each run.
        notify : callable
        on_done : callable, optional
            Receives each run as it ends.
        tick : callable, optional
            Called some times a second with the names of the runs at work.

        Raises
        ------
        PmoptError
            When the folder cannot be written or another process is writing it.
        """
        own = self.own
        with RunFolder(self.folder, force, resume=not force, mark=PLAN) as folder:
            with self._beacon() as key:
                folder.open()
                write_atomic(folder.place / PLAN, self._plan_text())
                todo = self.todo(force)
                if todo:
                    folder.reopen()
                if todo and pool.local:
                    warm_up(_distinct_users(todo, notify), pool.local)
                jobs = [self._job(run, force, threads, key) for run in todo]

                def on_tick() -> None:
                    if tick is not None:
                        tick([todo[number].name for number in pool.running])

                for number, outcome in pool.completed(run_job, jobs, on_tick):
                    run = todo[number]
                    if isinstance(outcome, PmoptError):
                        outcome = Outcome("failed", str(outcome))
                    self._keep(run, outcome)
                    manifest = read_manifest(self.run_folder(run)) or {}
                    for line in manifest.get("resume_notes", []):
                        notify(f"{run.name}: {line}")
                    for line in missing_lines(manifest):
                        notify(f"warning: {run.name}: {line}")
                    if on_done is not None:
                        on_done(self.summary_of(run))
            result = BatchResult(self.folder, tuple(self.summary_of(run) for run in own))
            folder.write(SUMMARY, to_csv([result.table()]) + "\n")
            document = {"shard": shard_text(self.shard), "runs": result.to_dict()["runs"]}
            folder.close("batch", document)
        return result

    def _job(self, run: PlannedRun, force: bool, threads: int | None, key: str) -> Job:
        """Return a run as a worker gets it."""
        path = self.run_folder(run)
        (path / FAILURE).unlink(missing_ok=True)
        return Job(
            run.runner.command,
            _plain(run),
            os.path.abspath(run.source),
            str(path.absolute()),
            force and self.place == self.folder,
            threads,
            str((self.folder / LOCK).absolute()),
            key,
        )

    def summary_of(self, run: PlannedRun) -> RunSummary:
        """Return what has become of a run."""
        found = summary_of(run.to_dict(), self.run_folder(run))
        return replace(found, folder=self.folder / RUNS / run.name)

    def plan(self, workers: int, force: bool, notify: Notify) -> BatchPlan:
        """Measure some runs of each command and mechanism and scale them to the batch."""
        groups: dict[tuple[str, str], list[PlannedRun]] = {}
        for run in self.own:
            groups.setdefault((run.runner.command, run.runner.mechanism), []).append(run)
        rows = []
        for (command, mechanism), runs in groups.items():
            todo = [r for r in runs if force or not r.runner.finished(self.run_folder(r))]
            step = max(1, len(todo) // _PROBED)
            probes = todo[step // 2 :: step][:_PROBED]
            times = [run.runner.plan(1, notify).seconds for run in probes]
            seconds = sum(times) / len(times) * len(todo) if times else 0.0
            rows.append(
                (command, mechanism, len(runs), len(runs) - len(todo), len(probes), seconds)
            )
        return BatchPlan(tuple(rows), workers)

    def _keep(self, run: PlannedRun, outcome: Outcome) -> None:
        """Write what a worker sent."""
        path = self.run_folder(run)
        if outcome.status != "finished":
            if outcome.status != "pending":
                # As it was given: on another machine the file may lie elsewhere.
                message = outcome.message.replace(os.path.abspath(run.source), run.source)
                document = {"status": outcome.status, "message": message}
                write_atomic(path / FAILURE, json.dumps(document) + "\n")
            return
        if outcome.files:
            with RunFolder(path, force=True) as folder:
                for name, data in outcome.files.items():
                    if Path(name).is_absolute() or ".." in Path(name).parts:
                        raise PmoptError(f"{path}: a worker sent a file of the name {name}")
                    folder.write(name, data)
                folder.close_with_manifest()

    def _plan_text(self) -> str:
        document = {
            "schema": SCHEMA,
            "shard": shard_text(self.shard),
            "runs": [run.to_dict() for run in self.runs],
        }
        return json.dumps(document, indent=1, allow_nan=False) + "\n"

    @contextlib.contextmanager
    def _beacon(self) -> Iterator[str]:
        """Give the key that shows workers they are wanted, as long as its file has it."""
        path, key = self.folder / LOCK, uuid.uuid4().hex
        try:
            # A link there would lead out of the folder.
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_NONBLOCK
            with os.fdopen(os.open(path, flags, 0o666), "w", encoding="utf-8") as stream:
                stream.write(key)
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise unwritable(self.folder, error) from error
        try:
            yield key
        finally:
            path.unlink(missing_ok=True)


def _plain(run: PlannedRun) -> dict[str, Any]:
    """Return a run's configuration as its class resolves it again."""
    return {k: v for k, v in run.runner.document().items() if k != "command"}


def _distinct_users(runs: Sequence[PlannedRun], notify: Notify) -> list[Evaluator | Mover]:
    """Return one of all that call the same kernels, for each set of them."""
    found: dict[frozenset[int], Evaluator | Mover] = {}
    for run in runs:
        user = run.runner.ready(notify)
        if user is not None:
            found.setdefault(frozenset(map(id, user.kernels)), user)
    return list(found.values())

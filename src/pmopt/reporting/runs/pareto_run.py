"""A whole ``pmopt pareto`` run: search, checkpoints, fine measurement, files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmopt.analysis.certification.budgets import Clock
from pmopt.analysis.sampling.evaluator import Notify
from pmopt.errors import InfeasibleError, InputError
from pmopt.reporting.pictures.gallery import write_pictures
from pmopt.reporting.runs import run_folder, run_pictures
from pmopt.reporting.runs.run_folder import RunFolder, claimed
from pmopt.reporting.runs.tasks import Plan
from pmopt.reporting.tables.table import Table
from pmopt.synthesis.checkpoint import Checkpoint, plain
from pmopt.synthesis.config import RunConfig
from pmopt.synthesis.front import Front, FrontDesign, measure_front
from pmopt.synthesis.optimise import Generation, Optimisation, require_feasible
from pmopt.synthesis.problem import DesignProblem, Evaluations

if TYPE_CHECKING:
    import pandas as pd

    from pmopt.execution.cluster import Cluster

OnGeneration = Callable[[Generation], None]
OnMeasured = Callable[[int, int], None]
#: Designs measured finely for a plan.
_PROBED = 4


@dataclass(frozen=True)
class ParetoRun:
    """A finished run.

    Attributes
    ----------
    folder : Path or None
        None where nothing was written.
    front : Front
    tables : dict of pandas.DataFrame
        ``front``, ``regions``, ``history`` and ``evaluations``.
    target_error : float
        Relative standard error the front was to be measured to.
    failures : dict
        Why how many designs could not be evaluated.
    """

    folder: Path | None
    front: Front
    tables: dict[str, pd.DataFrame]
    target_error: float
    failures: dict[str, int]

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        out = None if self.folder is None else str(self.folder)
        front = [design.to_dict() for design in self.front.designs]
        return {"out": out, **self.front.to_dict(), "front": front, "failures": self.failures}

    def front_rows(self) -> Table:
        """Return the front as ``front.csv`` has it."""
        frame = self.tables["front"]
        rows = zip(*(frame[name].tolist() for name in frame.columns), strict=True)
        return Table("", tuple(frame.columns), tuple(rows), self.front.units)


def run_pareto(
    config: RunConfig,
    out: Path | None = None,
    *,
    force: bool = False,
    resume: bool = False,
    threads: int | None = None,
    notify: Notify | None = None,
    on_generation: OnGeneration | None = None,
    on_measured: OnMeasured | None = None,
    cluster: Cluster | None = None,
) -> ParetoRun:
    """Search for the front, measure it and write the run's folder.

    Parameters
    ----------
    config : RunConfig
        Resolved.
    out : Path, optional
        The run's folder; None writes nothing.
    force : bool
        Overwrite a run in the folder.
    resume : bool
        Take up the run in the folder, if there is one.
    cluster : Cluster, optional
        Evaluates designs there.

    Raises
    ------
    InputError
        When the folder holds a run, or one of another configuration.
    InfeasibleError
        When no design is feasible.
    """
    with claimed(out, force, resume) as folder:
        return _run(config, folder, threads, notify, on_generation, on_measured, cluster)


def _run(
    config: RunConfig, folder: RunFolder | None, threads: int | None, notify: Notify | None,
    on_generation: OnGeneration | None, on_measured: OnMeasured | None, cluster: Cluster | None,
) -> ParetoRun:  # fmt: skip
    problem = DesignProblem(config, threads, notify, cluster)
    checkpoint, recorded = None, []
    if folder is not None:
        checkpoint = Checkpoint(folder.place, problem)
        if folder.begun:
            recorded = checkpoint.resume(notify)
        folder.open()
        if not folder.begun:
            checkpoint.start()
        folder.reopen()
    optimisation = Optimisation(problem)
    generations = []

    def note(line: str) -> None:
        if checkpoint is not None:
            checkpoint.note_designs(line, notify)

    try:
        for generation in optimisation.generations(recorded, note):
            if checkpoint is not None and not generation.recorded:
                checkpoint.save(generation.number, generation.record)
            generations.append(generation)
            if on_generation:
                on_generation(generation)
    finally:
        if checkpoint is not None:
            checkpoint.flush()
    evaluated = optimisation.evaluated
    tables = {
        "history": history_table(problem, generations),
        "evaluations": evaluations_table(problem, generations, evaluated),
    }
    try:
        require_feasible(problem, evaluated)
    except InfeasibleError:
        if folder is not None:
            folder.write("evaluations.csv", to_csv(tables["evaluations"]))
            folder.put()
        raise
    front = measure_front(
        problem, optimisation.candidates, optimisation.reference, generations[-1].hypervolume,
        on_measured,
    )  # fmt: skip
    if not front.designs:
        raise InfeasibleError(
            "no feasible design: none of the search's front keeps the constraints when measured "
            "finely; more samples or looser constraints are needed"
        )
    tables["front"] = front_table(front)
    tables["regions"] = regions_table(front, config)
    if folder is not None:
        notes = (checkpoint.resumes, checkpoint.notes) if checkpoint else ([], [])
        write_run(folder, config, front, tables, notes, problem.failures, notify)
    for line in front.remarks():
        if notify:
            notify(line)
    if problem.failures and notify:
        reasons = "; ".join(f"{why} ({n})" for why, n in problem.failures.items())
        notify(f"{sum(problem.failures.values())} designs could not be evaluated: {reasons}")
    return ParetoRun(
        folder.path if folder else None, front, tables, config.final.target_error, problem.failures
    )


def plan(config: RunConfig, threads: int | None, notify: Notify) -> Plan:
    """Measure a few generations of a small population and scale them to the run."""
    settings = config.algorithm
    population = min(settings.population, 100)
    workspace = config.workspace.model_copy(update={"samples": config.search_samples})
    probe = config.model_copy(
        update={
            "algorithm": settings.model_copy(update={"population": population, "generations": 4}),
            "workspace": workspace,
        }
    )
    optimisation = Optimisation(DesignProblem(probe, threads, notify))
    clock, times = Clock(), []
    for _ in optimisation.generations():
        times.append(clock.seconds)
    # The first generation compiles, loads and imports; a search may end with it.
    each = (times[-1] - times[0]) / max(len(times) - 1, 1) / population
    clock = Clock()
    list(optimisation.problem.measure(optimisation.evaluated.variables[:_PROBED]))
    final = clock.seconds / _PROBED * settings.population
    designs = settings.population * settings.generations
    what = (
        f"pareto {config.mechanism}: {settings.name}, population {settings.population}, "
        f"{settings.generations} generations"
    )
    points = float(designs) * (workspace.samples or 0)
    return Plan(what, points, each * designs + final)


def finished(config: RunConfig, out: Path) -> bool:
    """Return whether a folder holds this very run, finished.

    Raises
    ------
    InputError
        When it holds a finished run of another kind.
    """
    manifest = run_folder.manifest_to_keep(out)
    if manifest is None:
        return False
    if manifest["command"] != "pareto":
        raise InputError(f"--out: {out} holds a finished {manifest['command']} run, not pareto")
    return bool(manifest.get("config") == plain(config))


def write_run(
    folder: RunFolder,
    config: RunConfig,
    front: Front,
    tables: dict[str, pd.DataFrame],
    taken_up: tuple[list[int], list[str]],
    failures: dict[str, int],
    notify: Notify | None = None,
) -> None:
    """Write tables, pictures and the manifest, with where and how the run was taken up."""
    document = {
        "mechanism": config.mechanism,
        "config": plain(config),
        "seed": config.algorithm.seed,
        "result": front.to_dict(),
        "resumes": taken_up[0],
        "resume_notes": taken_up[1],
        "failures": failures,
        "units": front.units,
    }
    if config.adaptive:
        history = tables["history"]
        document["samples"] = {
            "first": int(history["samples"].iloc[0]),
            "last": int(history["samples"].iloc[-1]),
            "spent": int(history["spent"].sum()),
        }
    for name in ("front", "regions", "history", "evaluations"):
        folder.write(f"{name}.csv", to_csv(tables[name]))
    missing = write_pictures(
        folder, lambda: run_pictures.of_pareto(tables, front.units, document), notify
    )
    folder.close("pareto", document | missing)


def to_csv(table: pd.DataFrame) -> str:
    """Return a table as CSV: comma, dot, floats in shortest round-trip form."""
    return str(table.to_csv(index=False, lineterminator="\n"))


def front_table(front: Front) -> pd.DataFrame:
    """Return the front, a row a design; unset parameters have no column."""
    import pandas as pd

    return pd.DataFrame(
        [
            {
                "design": d.number,
                **{k: v for k, v in d.parameters.items() if v is not None},
                **_with_errors(d),
                **d.slack,
            }
            for d in front.designs
        ]
    )


def _with_errors(design: FrontDesign) -> dict[str, float]:
    """Return each objective followed by its error."""
    return {
        name: value
        for k, v in design.objectives.items()
        for name, value in ((k, v), (f"{k}_error", design.errors[k]))
    }


def regions_table(front: Front, config: RunConfig) -> pd.DataFrame:
    """Return the dexterity regions of every design on the front."""
    import pandas as pd

    edges = config.workspace.regions
    return pd.DataFrame(
        [
            {
                "design": d.number,
                "lower": low,
                "upper": high,
                "volume": volume.value,
                "share": share.value,
                "volume_error": volume.error,
                "share_error": share.error,
            }
            for d in front.designs
            for low, high, volume, share in zip(
                edges[:-1], edges[1:], d.estimates.region_volumes, d.estimates.region_shares,
                strict=True,
            )
        ]
    )  # fmt: skip


def history_table(problem: DesignProblem, generations: list[Generation]) -> pd.DataFrame:
    """Return the course of the search, a row a generation."""
    import pandas as pd

    return pd.DataFrame(
        [
            {
                "generation": g.number,
                "evaluations": g.evaluations,
                "feasible": g.feasible,
                "hypervolume": g.hypervolume,
                **{f"{k}_best": v for k, v in zip(problem.objectives, g.best, strict=True)},
                **({"samples": g.samples, "spent": g.spent} if problem.config.adaptive else {}),
            }
            for g in generations
        ]
    )


def evaluations_table(
    problem: DesignProblem, generations: list[Generation], evaluated: Evaluations
) -> pd.DataFrame:
    """Return every design evaluated, in order."""
    import numpy as np
    import pandas as pd

    columns = [
        *problem.variables,
        *problem.objectives,
        *(f"{name}_error" for name in problem.objectives),
        *problem.constraints,
    ]
    table = pd.DataFrame(evaluated.table(), columns=columns)
    counts = [len(g.record.evaluated) for g in generations]
    table.insert(0, "generation", np.repeat([g.number for g in generations], counts))
    if problem.config.adaptive:
        table.insert(1, "samples", np.repeat([g.samples or 0 for g in generations], counts))
    table["feasible"] = evaluated.feasible.astype(int)
    return table

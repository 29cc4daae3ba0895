"""The design problem: objectives and constraints of a whole population at once."""

from __future__ import annotations

import copy
import math
import pickle
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.estimates import Estimates, PopulationEstimates, of_population
from pmopt.analysis.sampling.evaluator import Notify
from pmopt.analysis.sampling.measuring import measure_on_grid, measure_to_target
from pmopt.analysis.sampling.sampler import Sampler, make_sampler
from pmopt.analysis.sampling.tallies import Tallies
from pmopt.analysis.sampling.warmup import warm_up
from pmopt.analysis.settings import split_samples
from pmopt.analysis.workspace.projection import Projection, measure_projection
from pmopt.errors import InputError, PmoptError, UnreachableError
from pmopt.execution.threads import ordered_map
from pmopt.mechanisms import find
from pmopt.mechanisms.mechanism import Parameters
from pmopt.numerics.sequences import Sequence as Points
from pmopt.quantity import Quantity
from pmopt.synthesis.config import SEARCH_SAMPLES, RunConfig
from pmopt.synthesis.objectives import IN_SPACE, OF_SUMS, SENSES, objective_units
from pmopt.units import ONE, product_unit

if TYPE_CHECKING:
    from pmopt.execution.cluster import Cluster

#: The constraint every problem has: something must be reachable.
REACHABLE = "reachable"
#: Most samples of a design when the front is measured: about a second.
FINAL_SAMPLES = 1 << 26
#: Samples of a design in the first generations of an adaptive search: fewer save little, as a
#: design takes as long to make ready, and are too few for the measures in space.
FIRST_SAMPLES = 1 << 12
#: On lines, which are exact along one coordinate, this few say as much.
FIRST_ON_LINES = 1 << 10
#: Parts of a population, for each thread.
_SLICES = 4
#: The same for each thread of a cluster, and the seconds of a part that make up for the
#: milliseconds it takes to send.
_TASKS = 2
_WORTH = 0.02
#: Samples behind the measures in space when the front is measured.
FINAL_PROJECTION = 1 << 20
#: Added where a smallest LCI is set: some reachable pose must have it.
MIN_LCI = "min_lci"


@dataclass(frozen=True)
class Evaluations:
    """Designs and their measured values, a row for each design.

    Attributes
    ----------
    variables : (N, v) float64
        Values of the design variables.
    values, errors : (N, k) float64
        Objectives in the order of the configuration and their standard errors; NaN where
        nothing is reachable.
    slack : (N, g) float64
        Constraint by constraint how far it is kept (>= 0) or broken (< 0).
    """

    variables: NDArray[np.float64]
    values: NDArray[np.float64]
    errors: NDArray[np.float64]
    slack: NDArray[np.float64]

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Which designs keep every constraint."""
        return np.asarray((self.slack >= 0).all(axis=1))

    def __len__(self) -> int:
        return len(self.variables)

    def table(self) -> NDArray[np.float64]:
        """Return all columns side by side."""
        return np.hstack([self.variables, self.values, self.errors, self.slack])

    def take(self, rows: NDArray[np.int64]) -> Evaluations:
        """Return some of the designs."""
        return Evaluations(
            self.variables[rows], self.values[rows], self.errors[rows], self.slack[rows]
        )

    @classmethod
    def join(cls, parts: Sequence[Evaluations]) -> Evaluations:
        """Return the rows of all parts in order."""
        return cls(
            *(
                np.concatenate([getattr(p, name) for p in parts])
                for name in ("variables", "values", "errors", "slack")
            )
        )


class DesignProblem:
    """Evaluates designs of a configuration; every design sees the same sample points.

    Objectives are maximised, the footprint is minimised; see :attr:`senses`.

    Parameters
    ----------
    config : RunConfig
        Resolved.
    threads : int, optional
    notify : callable, optional
    cluster : Cluster, optional
        Evaluates there: the results are the same.
    """

    def __init__(
        self, config: RunConfig, threads: int | None = None, notify: Notify | None = None,
        cluster: Cluster | None = None,
    ) -> None:  # fmt: skip
        self._cluster = cluster
        self._packed = pickle.dumps(config)
        self._pace = 0.0  # s a sample on the cluster; not known before the first evaluation
        self.config = config
        self.mechanism = find(config.mechanism)
        self.sampler = make_sampler(
            self.mechanism, config.workspace, config.algorithm.seed, threads, notify
        )
        #: The sampler for work that is itself shared over threads.
        self.alone = self.sampler.on_threads(1)
        self._sequences: dict[int, Points] = {}
        self._final = self.alone.for_purpose("front samples")
        ranges = {k: v for k, v in config.parameters.items() if isinstance(v, tuple)}
        self.variables = list(ranges)
        self.lower = np.array([low for low, _ in ranges.values()])
        self.upper = np.array([high for _, high in ranges.values()])
        self.fixed = {k: v for k, v in config.parameters.items() if not isinstance(v, tuple)}
        self.objectives = list(config.objectives)
        #: +1 for objectives to maximise, -1 for those to minimise.
        self.senses = np.array([SENSES[name] for name in self.objectives])
        self._projects = bool({*config.objectives, *config.constraints} & set(IN_SPACE))
        #: (objective, +1 for a lower and -1 for an upper bound, bound) by constraint name.
        self.bounds = {
            f"{name}_{side}": (name, sign, bound)
            for name, constraint in config.constraints.items()
            for side, sign, bound in (("min", 1, constraint.min), ("max", -1, constraint.max))
            if bound is not None
        }
        self.constraints = [REACHABLE, *self.bounds]
        if config.workspace.min_lci > 0:
            self.constraints.insert(1, MIN_LCI)
        #: Samples of a design: of each in the search, where it does not choose them itself.
        #: None on grids and to a target error.
        self.samples = config.search_samples
        self._reasons: dict[tuple[float | None, ...], str] = {}
        if cluster is None:
            warm_up([self.sampler.evaluator], self.sampler.threads, shapes=self._projects)

    @property
    def first_samples(self) -> int | None:
        """Samples of each design in the first generation."""
        if not self.config.adaptive:
            return self.samples
        return FIRST_ON_LINES if self.config.workspace.sampler == "lines" else FIRST_SAMPLES

    @property
    def units(self) -> dict[str, str]:
        """Unit by column name."""
        units = {p.name: self.mechanism.unit(p) for p in self.mechanism.parameters}
        measures = objective_units(self.mechanism)
        for name, one in measures.items():
            suffixes = ("", "_error", "_best", "_min", "_max")
            units |= {f"{name}{suffix}": one for suffix in suffixes}
        units |= dict.fromkeys((REACHABLE, MIN_LCI, "share", "share_error", "lower", "upper"), ONE)
        return units | {"hypervolume": product_unit(measures[name] for name in self.objectives)}

    def parameters(self, row: NDArray[np.float64]) -> dict[str, float | None]:
        """Return a design's complete parameters, in the mechanism's order."""
        values = dict(zip(self.variables, row.tolist(), strict=True))
        return {p.name: values.get(p.name, self.fixed.get(p.name))
                for p in self.mechanism.parameters}  # fmt: skip

    def design(self, row: NDArray[np.float64]) -> Design:
        """Return a design ready to be swept; one that cannot be prepared reaches nothing."""
        parameters = self.parameters(row)
        try:
            return self.sampler.design(parameters)
        except Exception as error:
            self._failed(parameters, error)
            return self.sampler.space.nothing(parameters)

    def _project(self, sampler: Sampler, design: Design, samples: int) -> Projection:
        """Return the space that a design takes; none where that fails."""
        try:
            return measure_projection(sampler, design, samples)
        except Exception as error:
            self._failed(design.parameters, error)
            return measure_projection(sampler, sampler.space.nothing(design.parameters), samples)

    def _failed(self, parameters: Parameters, error: Exception) -> None:
        """Record why one design cannot be evaluated; raise errors that concern all designs."""
        wrong = isinstance(error, InputError) and not isinstance(error, UnreachableError)
        if wrong or isinstance(error, MemoryError):
            raise error
        text = str(error) if isinstance(error, PmoptError) else f"{type(error).__name__}: {error}"
        self._reasons[tuple(parameters.values())] = text

    @property
    def failures(self) -> dict[str, int]:
        """Designs that could not be evaluated so far: counts by reason, most frequent first."""
        return dict(Counter(self._reasons.values()).most_common())

    def recall(self, evaluated: Evaluations) -> None:
        """Find again why designs with recorded evaluations failed."""
        for row in evaluated.variables[np.isnan(evaluated.values).any(axis=1)]:
            design = self.design(row)
            if self._projects:
                self._project(self.alone, design, FIRST_SAMPLES)

    def evaluate(self, variables: NDArray[np.float64], samples: int | None = None) -> Evaluations:
        """Evaluate a whole population.

        Parameters
        ----------
        variables : (N, v) float64
        samples : int, optional
            Of each design (default: :attr:`samples`). The points of fewer samples are among
            those of more, the first ones of each replicate.
        """
        samples = samples or self.samples
        if self._cluster is not None:
            return self._far(self._cluster, variables, samples)
        designs: list[Design] = []
        if samples is not None:
            tallies = self._tally(variables, samples, designs)
            found = of_population(tallies)
            slack = self._existence(tallies)
        else:
            designs += map(self.design, variables)
            found, slack = self._one_by_one(designs)
        by_name = {
            name: (getattr(found, at), getattr(found, f"{at}_error"))
            for name, at in OF_SUMS.items()
        }
        if self._projects:
            many = max(samples or SEARCH_SAMPLES, FIRST_SAMPLES)
            for name, pairs in self._projected(designs, many).items():
                by_name[name] = (pairs[:, 0], pairs[:, 1])
        # A quantity that does not exist breaks its bounds, and an objective the existence of a
        # workspace: too few poses are reachable to measure their positions.
        bounds = [
            np.nan_to_num(sign * (by_name[name][0] - bound), nan=-1.0)
            for name, sign, bound in self.bounds.values()
        ]
        values, errors = (
            np.stack([by_name[name][k] for name in self.objectives], axis=1) for k in (0, 1)
        )
        slack[0] = np.where(np.isnan(values).any(axis=1), np.minimum(slack[0], -1e-9), slack[0])
        return Evaluations(variables, values, errors, np.stack([*slack, *bounds], axis=1))

    def _far(
        self, cluster: Cluster, variables: NDArray[np.float64], samples: int | None
    ) -> Evaluations:
        """Evaluate on a cluster, in parts that are worth a task there."""
        work = len(variables) * (samples or 1)
        worth = math.ceil(self._pace * work / _WORTH) if self._pace else len(variables)
        slices = max(1, min(len(variables), _TASKS * cluster.threads, worth))
        parts = [_Part(self._packed, rows, samples) for rows in np.array_split(variables, slices)]
        found, seconds = [], 0.0
        for done in cluster.ordered_map(evaluate_part, parts):
            found.append(done.found)
            seconds += done.seconds
            self._reasons |= done.reasons
        self._pace = seconds / work
        return Evaluations.join(found)

    def _tally(
        self, variables: NDArray[np.float64], samples: int, designs: list[Design]
    ) -> Tallies:
        """Sweep a population slice by slice and append its designs.

        A slice is made ready, in Python, while earlier ones are swept.
        """
        replicates, points = split_samples(samples, self.config.workspace.replicates)
        if replicates not in self._sequences:
            self._sequences[replicates] = self.sampler.sequence(replicates)
        sequence = self._sequences[replicates]
        slices = min(len(variables), _SLICES * self.sampler.threads)

        def ready() -> Iterator[list[Design]]:
            for rows in np.array_split(variables, slices):
                part = [self.design(row) for row in rows]
                designs.extend(part)
                yield part

        parts = ordered_map(
            lambda part: self.alone.tally_population(part, sequence, points),
            ready(),
            self.sampler.threads,
        )
        return _joined(list(parts))

    def _one_by_one(
        self, designs: list[Design]
    ) -> tuple[PopulationEstimates, list[NDArray[np.float64]]]:
        """Evaluate on grids or to a target error, where each design takes its own points."""
        measured: list[Estimates] = []
        slack = []
        settings = self.config.workspace
        for design in designs:
            if settings.grid is not None:
                tallies, found = measure_on_grid(self.sampler, design, settings.grid)
            else:
                assert settings.target_error is not None
                tallies, found = measure_to_target(self.sampler, design, settings.target_error)
            measured.append(found)
            slack.append(self._existence(tallies))
        arrays = {}
        for at in OF_SUMS.values():
            pairs = np.array([tuple(getattr(found, at)) for found in measured])
            arrays[at], arrays[f"{at}_error"] = pairs.T
        columns = [np.concatenate(parts) for parts in zip(*slack, strict=True)]
        return PopulationEstimates(**arrays), columns

    def _projected(self, designs: list[Design], samples: int) -> dict[str, NDArray[np.float64]]:
        """Return value and error of the measures in space, shape (D, 2) each, NaN for none."""
        found = list(
            ordered_map(
                lambda design: self._project(self.alone, design, samples),
                designs,
                self.sampler.threads,
            )
        )
        return {
            name: np.array([tuple(getattr(p, field)) for p in found], dtype=float)
            for name, field in IN_SPACE.items()
        }

    def _existence(self, tallies: Tallies) -> list[NDArray[np.float64]]:
        """Return the slack of the constraints that there is a workspace: 0, or what is missed.

        Out of reach it is the mechanism's margin at the best sample point, or 1 where none is
        known (an empty box); below the smallest LCI, by how much.
        """
        within = tallies.within.sum(axis=1) > 0
        margin = tallies.margin.max(axis=1)
        missed = np.where(np.isfinite(margin) & (margin < 0), margin, -1.0)
        slack = [np.where(within, 0.0, missed)]
        least = self.config.workspace.min_lci
        if least > 0:
            enough = tallies.reachable.sum(axis=1) > 0
            largest = np.where(within, tallies.largest.max(axis=1), 0.0)
            slack.append(np.where(enough, 0.0, np.minimum(largest - least, -1e-300)))
        return slack

    def measure(
        self, variables: NDArray[np.float64]
    ) -> Iterator[tuple[Estimates, dict[str, Quantity]]]:
        """Measure designs (N, v) to the final target error, with a bounded number of samples.

        Each on one thread: most need few samples, that do not fill more.

        The sample points are not those of the search, which has chosen the designs they flatter.
        A workspace that fills little of its box may end with a larger error, which it states.

        Yields
        ------
        estimates : Estimates
        by_name : dict
            What objectives and constraints may be, by name.
        """
        if self._cluster is not None:
            rows = (_Part(self._packed, row, None) for row in variables)
            for done in self._cluster.ordered_map(measure_part, rows):
                self._reasons |= done.reasons
                yield done.found
            return
        yield from ordered_map(self._measure, variables, self.sampler.threads)

    def _measure(self, row: NDArray[np.float64]) -> tuple[Estimates, dict[str, Quantity]]:
        target = self.config.final.target_error
        design = self.design(row)
        found = measure_to_target(self._final, design, target, most=FINAL_SAMPLES)[1]
        by_name = {name: getattr(found, at) for name, at in OF_SUMS.items()}
        if self._projects:
            space: Projection = self._project(self._final, design, FINAL_PROJECTION)
            by_name |= {name: getattr(space, at) for name, at in IN_SPACE.items()}
        return found, by_name


Found = TypeVar("Found")


@dataclass(frozen=True)
class _Part:
    """Some designs, as a worker of a cluster gets them."""

    config: bytes
    variables: NDArray[np.float64]
    samples: int | None


@dataclass(frozen=True)
class _Done(Generic[Found]):
    """What a worker sends: the results, the seconds they took, why which designs failed."""

    found: Found
    seconds: float
    reasons: dict[tuple[float | None, ...], str]


def evaluate_part(part: _Part) -> _Done[Evaluations]:
    """Evaluate some designs: what a worker does."""
    return _done(part, lambda problem: problem.evaluate(part.variables, part.samples))


def measure_part(part: _Part) -> _Done[tuple[Estimates, dict[str, Quantity]]]:
    """Measure one design: what a worker does."""
    return _done(part, lambda problem: next(problem.measure(part.variables[None])))


def _done(part: _Part, work: Callable[[DesignProblem], Found]) -> _Done[Found]:
    problem = copy.copy(_problem(part.config))
    problem._reasons = {}  # of these designs alone
    began = time.perf_counter()
    found = work(problem)
    return _Done(found, time.perf_counter() - began, problem._reasons)


@lru_cache(maxsize=8)
def _problem(config: bytes) -> DesignProblem:
    return DesignProblem(pickle.loads(config), threads=1)


def _joined(parts: list[Tallies]) -> Tallies:
    """Return the tallies of all parts' designs."""
    names = list(Tallies.__dataclass_fields__)[1:]
    arrays: list[Any] = [np.concatenate([getattr(t, name) for t in parts]) for name in names]
    return Tallies(parts[0].points, *arrays)

"""A search on a design problem, generation by generation."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmopt.errors import InfeasibleError
from pmopt.seeds import seed_sequence
from pmopt.synthesis.problem import MIN_LCI, REACHABLE, DesignProblem, Evaluations
from pmopt.synthesis.reference import reference_point
from pmopt.units import ONE

if TYPE_CHECKING:
    from pmopt.synthesis.search import Search

#: An adaptive search doubles the samples when the best hypervolume has grown, over a third of all
#: generations and at least some, by less than this share of the designs' standard error: on common
#: points neighbours on a front are distinguished some twenty times more finely than each is known.
#: It stops doubling at this relative standard error.
_WINDOW = 3
_LEAST_WINDOW = 5
_DISTINGUISHED = 0.05
_FINEST = 2e-3
#: Then designs are measured again, too, that were beaten by less than this many standard errors:
#: at most so many times the population.
_HOPE = 0.5
_CONTENDERS = 4
#: Pairs of designs compared at once.
_PAIRS = 1 << 22


@dataclass(frozen=True)
class Record:
    """What was measured in one generation.

    Attributes
    ----------
    evaluated : Evaluations
        The generation's designs.
    again : Evaluations or None
        Contenders on twice the samples, where the search went on with these.
    asked, generator : dict
        States of the generator after the designs were asked for and after the generation, as NumPy
        gives them: whole numbers and names.
    """

    evaluated: Evaluations
    again: Evaluations | None
    asked: dict[str, Any]
    generator: dict[str, Any]


@dataclass(frozen=True)
class Generation:
    """State after one generation.

    Attributes
    ----------
    number : int
        From 1.
    evaluations : int
        Designs evaluated so far.
    feasible : int
        Feasible ones among them.
    front : int
        Designs on the current front.
    hypervolume : float
        Of the current front against the reference point.
    best : tuple of float
        Best value of each objective on the front, NaN where it is empty.
    samples : int or None
        Of each design of this generation; None where they are not counted.
    record : Record
    recorded : bool
        Taken from a checkpoint, not computed.
    """

    number: int
    evaluations: int
    feasible: int
    front: int
    hypervolume: float
    best: tuple[float, ...]
    samples: int | None
    record: Record
    recorded: bool

    @property
    def spent(self) -> int:
        """Samples taken in this generation, where they are counted."""
        again = 0 if self.record.again is None else 2 * len(self.record.again)
        return (self.samples or 0) * (len(self.record.evaluated) + again)


def hypervolume(
    values: NDArray[np.float64], senses: NDArray[np.int64], reference: tuple[float, ...]
) -> float:
    """Return the hypervolume of designs (N, k) from the reference point.

    Parameters
    ----------
    values : (N, k) float64
    senses : (k,) int
        +1 for objectives to maximise, -1 for those to minimise.
    reference : tuple of float
    """
    import moocore

    better = (values - reference) * senses
    better = better[(better > 0).all(axis=1)]
    if len(better) == 0:
        return 0.0
    return float(moocore.hypervolume(better, ref=[0.0] * values.shape[1], maximise=True))


def spread(better: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return the rows of a front of two objectives that keep most of its hypervolume.

    The design with the smallest share of its own leaves, again and again; the ends stay.

    Parameters
    ----------
    better : (N, 2) float64
        Maximised; none dominates another.
    count : int
        Most rows.
    """
    order = np.argsort(better[:, 0], kind="stable")
    x, y = better[order].T
    last = len(order) - 1
    before, after = list(range(-1, last)), list(range(1, last + 2))

    def share(i: int) -> float:
        if i in (0, last):
            return math.inf
        return float((x[i] - x[before[i]]) * (y[i] - y[after[i]]))

    shares = [share(i) for i in range(last + 1)]
    heap = [(value, i) for i, value in enumerate(shares)]
    heapq.heapify(heap)
    gone: set[int] = set()
    while last + 1 - len(gone) > max(count, 2):
        value, i = heapq.heappop(heap)
        if i in gone or value != shares[i]:
            continue  # it has had more of its own since
        gone.add(i)
        after[before[i]], before[after[i]] = after[i], before[i]
        for k in (before[i], after[i]):
            shares[k] = share(k)
            heapq.heappush(heap, (shares[k], k))
    return np.asarray(np.delete(order, sorted(gone)))


#: Stands for an objective of a design without a workspace, which the constraints keep behind.
_NONE = 0.0


class Optimisation:
    """A run of the configured algorithm (:mod:`pmopt.synthesis.search`).

    The designs of a generation follow from the seed and from what earlier generations
    gave, so that giving recorded results again restores the run exactly. What is recorded stays as
    it is where this installation would have asked for other designs; the search goes on from it.

    In an adaptive search all designs that are compared have the same number of samples: few
    while designs are far apart, twice as many, for the survivors too, when the front no longer
    gains more than its errors. Runs of any length begin alike.

    Parameters
    ----------
    problem : DesignProblem
    """

    def __init__(self, problem: DesignProblem) -> None:
        self.problem = problem
        self._parts: list[Evaluations] = []
        self._population: Evaluations | None = None
        #: All that was measured with the current number of samples.
        self._compared: list[Evaluations] = []
        #: Point the hypervolume is measured from.
        self.reference = reference_point(problem)

    def generations(
        self, recorded: list[Record] | None = None, note: Callable[[str], None] | None = None
    ) -> Iterator[Generation]:
        """Run, yielding after each generation; recorded ones are taken without evaluation.

        Parameters
        ----------
        recorded : list of Record, optional
        note : callable, optional
            Receives a line where recorded designs are not those that this installation asks for.
        """
        problem, settings = self.problem, self.problem.config.algorithm
        algorithm = self._algorithm()
        known = iter(recorded or [])
        evaluations = feasible = 0
        samples = problem.first_samples
        gains: list[float] = []  # best hypervolumes with this number of samples
        for number in range(1, settings.generations + 1):
            variables = algorithm.ask()
            past = next(known, None)
            if past is not None:
                others = not np.array_equal(past.evaluated.variables, variables)
                if note and (others or past.asked != algorithm.generator):
                    note(_other_designs(number))
                    note = None  # those that follow are others too
                variables, algorithm.generator = past.evaluated.variables, past.asked
            elif len(variables) == 0:
                return  # every offspring repeats a known design
            asked = algorithm.generator
            evaluated = self._measured(variables, samples, past.evaluated if past else None)
            merged = evaluated
            if self._population is not None:
                merged = Evaluations.join([self._population, evaluated])
            rows = algorithm.tell(variables, self._minimised(evaluated), -evaluated.slack)
            self._population = merged.take(rows)
            self._parts.append(evaluated)
            self._compared.append(evaluated)
            evaluations += len(evaluated)
            feasible += int(evaluated.feasible.sum())
            front = self.front
            volume = hypervolume(front.values, problem.senses, self.reference)
            gains.append(max([volume, *gains[-1:]]))
            again, had = None, samples
            finer = self._stalled(number, gains, front) if past is None else past.again is not None
            if samples is not None and finer:
                samples *= 2
                again = past.again if past else None
                again = self._measured(
                    self._contenders() if again is None else again.variables, samples, again
                )
                self._population = again.take(
                    algorithm.replace(again.variables, self._minimised(again), -again.slack)
                )
                self._compared = [again]
                front = self.front
                volume = hypervolume(front.values, problem.senses, self.reference)
                gains = [volume]
            best = np.full(len(problem.objectives), np.nan)
            if len(front):
                best = (front.values * problem.senses).max(axis=0) * problem.senses
            if past is not None:
                if note and past.generator != algorithm.generator:
                    note(_other_designs(number))
                    note = None
                algorithm.generator = past.generator
            record = Record(evaluated, again, asked, algorithm.generator)
            yield Generation(
                number, evaluations, feasible, len(front), volume, tuple(best.tolist()),
                had, record, past is not None,
            )  # fmt: skip

    def _algorithm(self) -> Search:
        """Return the algorithm that asks for designs, at its start."""
        from pymoo.core.problem import Problem

        from pmopt.synthesis.search import ALGORITHMS, Search

        problem, settings = self.problem, self.problem.config.algorithm
        space = Problem(
            n_var=len(problem.lower), n_obj=len(problem.objectives),
            n_ieq_constr=len(problem.constraints), xl=problem.lower, xu=problem.upper,
        )  # fmt: skip
        seed = int(seed_sequence(settings.seed, settings.name).generate_state(1)[0])
        return Search(ALGORITHMS[settings.name](settings), space, seed)

    def _measured(
        self, variables: NDArray[np.float64], samples: int | None, past: Evaluations | None
    ) -> Evaluations:
        """Evaluate designs, or return their recorded evaluations."""
        if past is None:
            return self.problem.evaluate(variables, samples)
        self.problem.recall(past)
        return past

    def _stalled(self, number: int, gains: list[float], front: Evaluations) -> bool:
        """Return whether an adaptive search is to go on with twice the samples."""
        window = max(_LEAST_WINDOW, number // _WINDOW)
        if not self.problem.config.adaptive or len(gains) <= window or gains[-1] <= 0:
            return False
        with np.errstate(invalid="ignore", divide="ignore"):
            relative = np.abs(front.errors / front.values)
        error = float(np.median(np.sqrt(np.nansum(relative**2, axis=1))))
        gain = 1 - gains[-1 - window] / gains[-1]
        return error > _FINEST and gain < _DISTINGUISHED * error

    def _contenders(self) -> NDArray[np.float64]:
        """Return the population and the designs that errors may have kept out of it, shape (N, v).

        The largest volume and the largest GCI are those that the points flatter most: designs
        near them wait just behind. Where there are many, they are taken in even steps of the
        first objective.
        """
        population, compared = self._population, Evaluations.join(self._compared)
        assert population is not None
        known = set(map(bytes, population.variables))
        rows = [i for i in np.flatnonzero(compared.feasible).tolist()
                if bytes(compared.variables[i]) not in known]  # fmt: skip
        hopes = compared.values[rows] * self.problem.senses
        hopes += _HOPE * np.nan_to_num(compared.errors[rows])
        front = self.front.values * self.problem.senses
        parts = np.array_split(hopes, 1 + hopes.shape[0] * len(front) // _PAIRS)
        beaten = [(front > part[:, None]).all(axis=2).any(axis=1) for part in parts]
        others = compared.take(np.array(rows, dtype=int)[~np.concatenate(beaten)])
        order = np.argsort(others.values[:, 0], kind="stable")
        count = min(_CONTENDERS * len(population), len(order))
        chosen = order[np.linspace(0, len(order) - 1, count).astype(int)]
        return np.concatenate([population.variables, others.variables[chosen]])

    def _minimised(self, evaluated: Evaluations) -> NDArray[np.float64]:
        """Return what the algorithm minimises.

        Without a workspace there is no GCI; the constraint keeps such designs behind all feasible
        ones whatever stands here.
        """
        return np.asarray(-np.nan_to_num(evaluated.values * self.problem.senses, nan=_NONE))

    @property
    def front(self) -> Evaluations:
        """The population's non-dominated feasible designs."""
        assert self._population is not None
        return self._best(self._population, self._population.feasible)

    def _best(self, evaluated: Evaluations, allowed: NDArray[np.bool_]) -> Evaluations:
        """Return the non-dominated of the allowed designs."""
        import moocore

        rows = np.flatnonzero(allowed)
        if len(rows):
            better = evaluated.values[rows] * self.problem.senses
            rows = rows[moocore.is_nondominated(better, maximise=True)]
        return evaluated.take(rows)

    @property
    def front_variables(self) -> NDArray[np.float64]:
        """Variables of the designs on the current front, sorted."""
        front = self.front.variables
        return front[np.lexsort(front.T[::-1])]

    @property
    def candidates(self) -> NDArray[np.float64]:
        """Variables of the designs to measure finely: the current front, and a safer one.

        The front of an adaptive search is that of all its designs with the most samples, as many
        as the population holds; samples are few there, designs many.

        Where a bound is active the front lies on it, and sampling errors alone put half of its
        designs beyond. The non-dominated ones of all designs that keep every bound by two
        standard errors stand in for them.
        """
        problem, evaluated = self.problem, Evaluations.join(self._compared)
        front = self.front_variables
        if problem.config.adaptive and len(problem.objectives) == 2:
            front = self._spread(self._best(evaluated, evaluated.feasible))
        if not problem.bounds:
            return front
        safe = evaluated.feasible
        for key, (name, _, _) in problem.bounds.items():
            if name not in problem.objectives:
                continue  # its error is not recorded
            slack = evaluated.slack[:, problem.constraints.index(key)]
            safe = safe & (slack >= 2 * evaluated.errors[:, problem.objectives.index(name)])
        safer = self._best(evaluated, safe)
        joined = np.concatenate([front, safer.variables])
        return np.asarray(np.unique(joined, axis=0))

    def _spread(self, front: Evaluations) -> NDArray[np.float64]:
        """Return the variables of as many designs of a front as the population holds, sorted."""
        count = self.problem.config.algorithm.population
        found = front.take(spread(front.values * self.problem.senses, count)).variables
        return np.asarray(found[np.lexsort(found.T[::-1])])

    @property
    def evaluated(self) -> Evaluations:
        """Every design evaluated, in order."""
        return Evaluations.join(self._parts)


def _other_designs(number: int) -> str:
    return (
        f"resumed from a record whose designs are not to the last digit those that this "
        f"installation asks for, from generation {number} on: what is recorded is kept as it is"
    )


def require_feasible(problem: DesignProblem, evaluated: Evaluations) -> None:
    """Raise where no design is feasible, with how many each constraint rules out.

    Raises
    ------
    InfeasibleError
    """
    if evaluated.feasible.any():
        return
    count = len(evaluated)
    parts = []
    for column, name in enumerate(problem.constraints):
        broken = int((evaluated.slack[:, column] < 0).sum())
        if not broken:
            continue
        if name == REACHABLE:
            parts.append(f"no reachable pose in {broken} of {count} designs")
            continue
        objective, sign, bound = problem.bounds.get(
            name, (MIN_LCI, 1, problem.config.workspace.min_lci)
        )
        unit = problem.units[objective]
        limit = f"{bound!r}" if unit == ONE else f"{bound!r} {unit}"
        relation = ">=" if sign > 0 else "<="
        text = f"{objective} {relation} {limit} rules out {broken} of {count} designs"
        reached = evaluated.slack[:, column][evaluated.slack[:, 0] >= 0]
        if len(reached):
            text += f" (best {sign * reached.max() + bound:.4g})"
        parts.append(text)
    if (evaluated.slack[:, 0] < 0).all():
        parts.append(_of_one_design(problem, evaluated))
    parts += [f"{n} could not be evaluated ({why})" for why, n in problem.failures.items()]
    raise InfeasibleError(f"no feasible design: {'; '.join(parts)}")


def _of_one_design(problem: DesignProblem, evaluated: Evaluations) -> str:
    """Say what rules out a pose for the design that comes nearest to reaching one."""
    from pmopt.analysis.workspace.emptiness import explain

    row = evaluated.variables[int(np.argmax(evaluated.slack[:, 0]))]
    parameters = problem.parameters(row)
    mechanism = problem.mechanism
    text = ", ".join(f"{k} = {parameters[k]:.4g} {mechanism.unit(mechanism.parameter(k))}"
                     for k in problem.variables)  # fmt: skip
    why = explain(mechanism, parameters, problem.config.workspace, problem.variables)
    return f"of the one that comes nearest, {text}: {why}"

"""NSGA-II on a design problem, generation by generation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.errors import InfeasibleError, PmoptError
from pmopt.seeds import seed_sequence
from pmopt.synthesis.problem import MIN_LCI, REACHABLE, DesignProblem, Evaluations
from pmopt.units import ONE


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
    evaluated : Evaluations
        Of this generation.
    recorded : bool
        Taken from a checkpoint, not computed.
    """

    number: int
    evaluations: int
    feasible: int
    front: int
    hypervolume: float
    best: tuple[float, ...]
    evaluated: Evaluations
    recorded: bool


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


#: Stands for an objective of a design without a workspace, which the constraints keep behind.
_NONE = 0.0


class Optimisation:
    """A run of NSGA-II (Deb et al. 2002; pymoo) driven by ask and tell.

    The designs of a generation follow from the seed and from what earlier generations were
    told, so that telling recorded results again restores the run exactly.

    Parameters
    ----------
    problem : DesignProblem
    """

    def __init__(self, problem: DesignProblem) -> None:
        self.problem = problem
        self._parts: list[Evaluations] = []
        self._reference: tuple[float, ...] | None = None

    @property
    def reference(self) -> tuple[float, ...]:
        """Point the hypervolume is measured from.

        It is 0 for what is maximised, which nothing falls below, and for what is minimised the
        largest value among the first feasible designs.
        """
        if self._reference is None:
            return tuple(np.where(self.problem.senses > 0, 0.0, np.nan).tolist())
        return self._reference

    def _refer(self, evaluated: Evaluations) -> None:
        """Fix the reference point as soon as there is a feasible design."""
        if self._reference is None and evaluated.feasible.any():
            worst = evaluated.values[evaluated.feasible].max(axis=0)
            self._reference = tuple(np.where(self.problem.senses > 0, 0.0, worst).tolist())

    def generations(self, recorded: list[Evaluations] | None = None) -> Iterator[Generation]:
        """Run, yielding after each generation; recorded ones are told without evaluation.

        Raises
        ------
        PmoptError
            When recorded designs are not those this installation asks for.
        """
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.evaluator import Evaluator
        from pymoo.core.problem import Problem
        from pymoo.operators.crossover.sbx import SBX
        from pymoo.operators.mutation.pm import PM
        from pymoo.operators.sampling.rnd import FloatRandomSampling
        from pymoo.problems.static import StaticProblem

        problem, settings = self.problem, self.problem.config.algorithm
        stated = Problem(
            n_var=len(problem.variables),
            n_obj=len(problem.objectives),
            n_ieq_constr=len(problem.constraints),
            xl=problem.lower,
            xu=problem.upper,
        )
        # pymoo's default operators are shared between algorithms: these are this run's own.
        algorithm = NSGA2(
            pop_size=settings.population,
            sampling=FloatRandomSampling(),
            crossover=SBX(eta=settings.crossover_eta, prob=settings.crossover_probability),
            mutation=PM(eta=settings.mutation_eta),
        )
        seed = int(seed_sequence(settings.seed, "nsga2").generate_state(1)[0])
        algorithm.setup(stated, termination=("n_gen", settings.generations), seed=seed)
        known = iter(recorded or [])
        evaluations = feasible = 0
        for number in range(1, settings.generations + 1):
            asked = algorithm.ask()
            if asked is None or len(asked) == 0:
                return  # every offspring repeats a known design
            variables = np.ascontiguousarray(asked.get("X"), dtype=float)
            told = next(known, None)
            if told is None:
                evaluated = problem.evaluate(variables)
            elif np.array_equal(told.variables, variables):
                evaluated = told
            else:
                raise PmoptError(
                    f"checkpoint: the designs of generation {number} are not those of this "
                    "installation (another version of pymoo or NumPy?); start afresh with --force"
                )
            # Without a workspace there is no GCI; the constraint keeps such designs behind all
            # feasible ones whatever stands here.
            self._refer(evaluated)
            objectives = -np.nan_to_num(evaluated.values * problem.senses, nan=_NONE)
            Evaluator().eval(StaticProblem(stated, F=objectives, G=-evaluated.slack), asked)
            algorithm.tell(infills=asked)
            self._parts.append(evaluated)
            evaluations += len(evaluated)
            feasible += int(evaluated.feasible.sum())
            front = self._survivors(algorithm.pop)
            best = np.full(front.shape[1], np.nan)
            if len(front):
                best = (front * problem.senses).max(axis=0) * problem.senses
            yield Generation(
                number, evaluations, feasible, len(front),
                hypervolume(front, problem.senses, self.reference),
                tuple(best.tolist()), evaluated, told is not None,
            )  # fmt: skip

    def _survivors(self, population) -> NDArray[np.float64]:  # type: ignore[no-untyped-def]
        """Keep the population's non-dominated feasible designs and return their objectives."""
        import moocore

        variables, objectives = population.get("X"), population.get("F")
        rows = np.flatnonzero((population.get("G") <= 0).all(axis=1))
        if len(rows):
            rows = rows[moocore.is_nondominated(objectives[rows])]
        self._front_variables = np.asarray(variables[rows], dtype=float)
        return np.asarray(-objectives[rows] * self.problem.senses, dtype=float)

    @property
    def front_variables(self) -> NDArray[np.float64]:
        """Variables of the designs on the current front, sorted."""
        front = self._front_variables
        return front[np.lexsort(front.T[::-1])]

    @property
    def candidates(self) -> NDArray[np.float64]:
        """Variables of the designs to measure finely: the current front, and a safer one.

        Where a bound is active the front lies on it, and sampling errors alone put half of its
        designs beyond. The non-dominated ones of all designs that keep every bound by two
        standard errors stand in for them.
        """
        problem, evaluated = self.problem, self.evaluated
        if not problem.bounds:
            return self.front_variables
        import moocore

        safe = evaluated.feasible
        for key, (name, _, _) in problem.bounds.items():
            if name not in problem.objectives:
                continue  # its error is not recorded
            slack = evaluated.slack[:, problem.constraints.index(key)]
            safe = safe & (slack >= 2 * evaluated.errors[:, problem.objectives.index(name)])
        rows = np.flatnonzero(safe)
        if len(rows):
            rows = rows[moocore.is_nondominated(
                evaluated.values[rows] * problem.senses, maximise=True
            )]  # fmt: skip
        joined = np.concatenate([self.front_variables, evaluated.variables[rows]])
        return np.asarray(np.unique(joined, axis=0))

    @property
    def evaluated(self) -> Evaluations:
        """Every design evaluated, in order."""
        return Evaluations.join(self._parts)


def require_feasible(problem: DesignProblem, evaluated: Evaluations) -> None:
    """Raise where no design is feasible, saying what rules how many out.

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
    raise InfeasibleError(f"no feasible design: {'; '.join(parts)}")

"""An algorithm of pymoo, driven by ask and tell, whole populations at a time.

What decides a search is the same on every processor. pymoo's own classes do it all; where they call
what depends on the processor, a subclass is handed in at the place that pymoo has for it:

- crossover and mutation take powers (:mod:`pmopt.synthesis.operators`);
- survival sorts distances and violations by NumPy's quicksort, which orders equal ones by what the
  vector instructions do (:class:`SteadySurvival`);
- duplicates are found by SciPy's distances, against an absolute bound that knows no units
  (:class:`SameBits`).

Importing pymoo takes 0.2 s: nothing but a search imports this module.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.config import Config
from pymoo.core.algorithm import Algorithm
from pymoo.core.duplicate import DuplicateElimination
from pymoo.core.population import Population
from pymoo.core.problem import Problem
from pymoo.core.termination import NoTermination
from pymoo.operators.survival.rank_and_crowding import RankAndCrowding
from pymoo.operators.survival.rank_and_crowding.metrics import (
    FunctionalDiversity,
    calc_crowding_distance,
)

from pmopt.synthesis.config import AlgorithmSettings
from pmopt.synthesis.operators import PolynomialMutation, SimulatedBinaryCrossover

#: pymoo would print among results that its compiled functions are missing: none of them is used.
Config.warnings["not_compiled"] = False

Array = NDArray[np.float64]
Rows = NDArray[np.int64]


class Search:
    """A pymoo algorithm between generations.

    Designs that it is given need not be those that it asked for: a record is the truth.

    Parameters
    ----------
    algorithm : pymoo.core.algorithm.Algorithm
        Not yet set up.
    space : pymoo.core.problem.Problem
        Bounds of the variables, numbers of objectives and constraints; it evaluates nothing.
    seed : int
    """

    def __init__(self, algorithm: Algorithm, space: Problem, seed: int) -> None:
        self.algorithm = algorithm
        algorithm.setup(space, termination=NoTermination(), seed=seed)
        self._asked: Any = None

    @property
    def generator(self) -> dict[str, Any]:
        """State of the random generator: whole numbers and names."""
        return dict(self.algorithm.random_state.bit_generator.state)

    @generator.setter
    def generator(self, state: dict[str, Any]) -> None:
        self.algorithm.random_state.bit_generator.state = state

    def ask(self) -> Array:
        """Return the designs of the next generation (N, v), none where all would be known ones."""
        self._asked = self.algorithm.ask()
        if self._asked is None:
            self.algorithm.termination = NoTermination()  # pymoo would end here
            return np.empty((0, self.algorithm.problem.n_var))
        return np.asarray(self._asked.get("X"))

    def tell(self, variables: Array, objectives: Array, excess: Array) -> Rows:
        """Add the evaluated generation and select the survivors.

        Parameters
        ----------
        variables : (N, v) float64
        objectives : (N, k) float64
            Minimised.
        excess : (N, g) float64
            Constraint by constraint, broken where > 0.

        Returns
        -------
        rows : (M,) int64
            The survivors among the population followed by the generation.
        """
        # The algorithm's own individuals, which may carry more than their variables.
        designs = self._asked
        if designs is None or len(designs) != len(variables):
            designs = Population.empty(len(variables))
        before = self.algorithm.pop
        _number(before, 0)
        _set(designs, variables, objectives, excess)
        _number(designs, len(before))
        self.algorithm.tell(infills=designs)
        return self._rows()

    def replace(self, variables: Array, objectives: Array, excess: Array) -> Rows:
        """Select the population anew from designs that were measured again.

        For algorithms that select by a survival, as all of pymoo's genetic ones do.

        Returns
        -------
        rows : (M,) int64
            The survivors among the designs.
        """
        algorithm = self.algorithm
        designs = Population.empty(len(variables))
        _set(designs, variables, objectives, excess)
        _number(designs, 0)
        algorithm.pop = algorithm.survival.do(
            algorithm.problem, designs, n_survive=algorithm.pop_size, algorithm=algorithm,
            random_state=algorithm.random_state,
        )  # fmt: skip
        return self._rows()

    def _rows(self) -> Rows:
        return np.array([individual.data[_ROW] for individual in self.algorithm.pop], dtype=int)


#: Where an individual keeps its place among those that are selected from.
_ROW = "pmopt_row"


def _number(designs: Population, first: int) -> None:
    for row, individual in enumerate(designs, first):
        individual.data[_ROW] = row


def _set(designs: Population, variables: Array, objectives: Array, excess: Array) -> None:
    """Set the known values of designs.

    Their violation too, which pymoo would sum design by design; and attributes, not by their names,
    which reads each one first.
    """
    violation = np.maximum(excess, 0.0).sum(axis=1)[:, None]
    variables = variables.copy()  # an operator may change its design in place
    for row, individual in enumerate(designs):
        individual.X, individual.F = variables[row], objectives[row]
        individual.G, individual.CV = excess[row], violation[row]


class SameBits(DuplicateElimination):
    """Designs are duplicates where all bits are the same; the first one stays."""

    def _do(
        self, pop: Population, other: Population | None, is_duplicate: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        known = set() if other is None else {individual.X.tobytes() for individual in other}
        for row, individual in enumerate(pop):
            key = individual.X.tobytes()
            is_duplicate[row] = key in known
            if other is None:
                known.add(key)
        return is_duplicate


class _Steady(np.ndarray):
    """Numbers that are sorted with equal ones in their order, whatever sort is asked for."""

    def argsort(self, axis: int = -1, **_: Any) -> Rows:  # type: ignore[override]
        """Return the rows in ascending order."""
        return np.argsort(self.view(np.ndarray), axis=axis, kind="stable")


class _SteadyDistance(FunctionalDiversity):
    """pymoo's crowding distance, differences and quotients; equal ones keep their order."""

    def __init__(self) -> None:
        super().__init__(calc_crowding_distance, filter_out_duplicates=False)

    def do(self, F: Array, n_remove: int = 0) -> _Steady:
        return np.asarray(super().do(F, n_remove)).view(_Steady)


class SteadySurvival(RankAndCrowding):
    """NSGA-II's survival: the best by rank and crowding, then the infeasible by their violation.

    What is equal is drawn from the generator, or keeps its order, never ordered by a sort.
    """

    def __init__(self) -> None:
        super().__init__(crowding_func=_SteadyDistance())
        self.filter_infeasible = False  # :meth:`do` has done so

    def do(
        self, problem: Problem, pop: Population, *args: Any, n_survive: int | None = None,
        **more: Any,
    ) -> Population:  # fmt: skip
        """Return the survivors; pymoo's own would sort the infeasible by quicksort."""
        count = len(pop) if n_survive is None else n_survive
        violation = pop.get("CV")[:, 0]
        feasible, infeasible = np.flatnonzero(violation <= 0), np.flatnonzero(violation > 0)
        kept = super().do(problem, pop[feasible], *args, n_survive=count, **more)
        order = np.argsort(violation[infeasible], kind="stable")[: max(count - len(kept), 0)]
        return Population.merge(kept, pop[infeasible[order]])


def nsga2(settings: AlgorithmSettings) -> Algorithm:
    """Return NSGA-II (Deb et al. 2002)."""
    return NSGA2(
        pop_size=settings.population,
        crossover=SimulatedBinaryCrossover(
            eta=settings.crossover_eta, prob=settings.crossover_probability
        ),
        mutation=PolynomialMutation(eta=settings.mutation_eta),
        survival=SteadySurvival(),
        eliminate_duplicates=SameBits(),
    )


#: What ``algorithm.name`` may say.
ALGORITHMS: dict[str, Callable[[AlgorithmSettings], Algorithm]] = {"nsga2": nsga2}

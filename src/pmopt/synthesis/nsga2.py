"""NSGA-II (Deb et al. 2002) on arrays.

The generator draws the same numbers in the same order as pymoo's ``NSGA2``, with its operators
(:mod:`pmopt.synthesis.operators`), and asks for the same designs up to the last digits of powers.
pymoo keeps every design as an object with attributes; reading and setting those took nine tenths of
its time. Equal distances and violations are ordered by their place: NumPy's other sorts order them
by what the processor's vector instructions do.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.synthesis.config import AlgorithmSettings
from pmopt.synthesis.operators import crossed, mutated

Array = NDArray[np.float64]

#: As pymoo has them: probability that a crossing mates exchange a variable, and that it is the
#: other child's; probability that a child mutates; rounds of mating to find new designs.
_CROSSED = 0.5
_EXCHANGED = 0.5
_MUTATED = 0.9
_ROUNDS = 100


class Nsga2:
    """The state of NSGA-II between generations.

    Parameters
    ----------
    settings : AlgorithmSettings
    lower, upper : (v,) float64
        Bounds of the variables.
    seed : int

    Attributes
    ----------
    variables : (N, v) float64
        The population.
    objectives : (N, k) float64
        Minimised.
    excess : (N, g) float64
        Constraint by constraint, broken where > 0.
    """

    def __init__(self, settings: AlgorithmSettings, lower: Array, upper: Array, seed: int) -> None:
        self.settings = settings
        self.lower, self.upper = lower, upper
        self._random = np.random.Generator(np.random.PCG64(seed))
        self.variables = np.empty((0, len(lower)))
        self.objectives = self.excess = np.empty((0, 0))
        self._violation = self._crowding = np.empty(0)

    @property
    def generator(self) -> dict[str, Any]:
        """State of the random generator: whole numbers and names."""
        return dict(self._random.bit_generator.state)

    @generator.setter
    def generator(self, state: dict[str, Any]) -> None:
        self._random.bit_generator.state = state

    def ask(self) -> Array:
        """Return the designs of the next generation, none where all would be known ones."""
        count = self.settings.population
        if not len(self.variables):
            unit = self._random.random((count, len(self.lower)))
            return _new(self.lower + (self.upper - self.lower) * unit, set())
        known = set(map(bytes, self.variables))
        offspring = np.empty((0, len(self.lower)))
        for _ in range(_ROUNDS):
            born = _new(self._mate(count - len(offspring)), known)[: count - len(offspring)]
            known.update(map(bytes, born))
            offspring = np.concatenate([offspring, born])
            if len(offspring) == count:
                break
        return offspring

    def tell(self, variables: Array, objectives: Array, excess: Array) -> NDArray[np.int64]:
        """Add the evaluated generation and select the survivors.

        Returns
        -------
        rows : (N,) int64
            The survivors among the population followed by the generation.
        """
        if len(self.variables):
            variables = np.concatenate([self.variables, variables])
            objectives = np.concatenate([self.objectives, objectives])
            excess = np.concatenate([self.excess, excess])
        return self._select(variables, objectives, excess, self.settings.population)

    def replace(self, variables: Array, objectives: Array, excess: Array) -> NDArray[np.int64]:
        """Select the population anew from designs that were measured again.

        Returns
        -------
        rows : (N,) int64
            The survivors among the designs.
        """
        return self._select(variables, objectives, excess, self.settings.population)

    def _select(
        self, variables: Array, objectives: Array, excess: Array, count: int
    ) -> NDArray[np.int64]:
        """Keep the best by feasibility, rank and crowding; the infeasible by their violation."""
        violation = np.maximum(excess, 0.0).mean(axis=1)
        feasible, infeasible = np.flatnonzero(violation <= 0), np.flatnonzero(violation > 0)
        crowding = np.zeros(len(variables))
        kept = self._best(objectives, feasible, count, crowding) if len(feasible) else feasible
        rest = infeasible[np.argsort(violation[infeasible], kind="stable")][: count - len(kept)]
        rows = np.concatenate([kept, rest])
        self.variables, self.objectives = variables[rows], objectives[rows]
        self.excess = excess[rows]
        self._violation, self._crowding = violation[rows], crowding[rows]
        return rows

    def _best(
        self, objectives: Array, feasible: NDArray[np.int64], count: int, crowding: Array
    ) -> NDArray[np.int64]:
        """Return the rows of the best feasible designs, and fill in their crowding."""
        import moocore

        ranks = moocore.pareto_rank(objectives[feasible])
        kept: list[NDArray[np.int64]] = []
        room = min(count, len(feasible))
        for rank in range(int(ranks.max()) + 1):
            front = feasible[ranks == rank]
            distance = crowding_distance(objectives[front])
            crowding[front] = distance
            if len(front) > room:  # ties are broken at random
                mixed = self._random.permutation(len(front))
                order = np.argsort(distance[mixed], kind="stable")[::-1]
                front = front[mixed[order][:room]]
            kept.append(front)
            room -= len(front)
            if room == 0:
                break
        return np.concatenate(kept)

    def _mate(self, count: int) -> Array:
        """Return offspring of tournament winners, at least ``count``, shape (2 M, v)."""
        random, settings = self._random, self.settings
        matings = math.ceil(count / 2)
        pairs = self._winners(2 * matings).reshape(matings, 2)
        parents = self.variables[pairs.T]  # (2, matings, v)
        children = parents.copy()
        crosses = random.random(matings) < settings.crossover_probability
        if crosses.any():
            random.random((matings, 1))  # pymoo draws whether children may be exchanged: always
            born = crossed(
                parents,
                self.lower,
                self.upper,
                settings.crossover_eta,
                _CROSSED,
                _EXCHANGED,
                random,
            )
            children[:, crosses] = born[:, crosses]
        children = children.reshape(-1, len(self.lower))
        size = len(children)
        moved = mutated(
            children, self.lower, self.upper, settings.mutation_eta,
            min(0.5, 1 / len(self.lower)), random,
        )  # fmt: skip
        mutates = random.random(size) <= _MUTATED
        children[mutates] = moved[mutates]
        return children

    def _winners(self, count: int) -> NDArray[np.int64]:
        """Return the winners of binary tournaments, rows of the population.

        The smaller violation wins where a design is infeasible, else the dominating design, else
        the one in the less crowded place; ties are drawn.
        """
        size = len(self.variables)
        rounds = math.ceil(2 * count / size)
        order = np.concatenate([self._random.permutation(size) for _ in range(rounds)])
        a, b = order[: 2 * count].reshape(count, 2).T
        worse = self._violation[b] - self._violation[a]
        f, g = self.objectives[a], self.objectives[b]
        less, more = (f < g).any(axis=1), (g < f).any(axis=1)
        dominates = less.astype(float) - more
        closer = np.sign(self._crowding[a].clip(max=1e300) - self._crowding[b].clip(max=1e300))
        preferred = np.where(
            (self._violation[a] > 0) | (self._violation[b] > 0),
            worse,
            np.where(dominates != 0, dominates, closer),
        )
        winners = np.where(preferred > 0, a, b)
        for tie in np.flatnonzero(preferred == 0):
            winners[tie] = self._random.choice([a[tie], b[tie]])
        return winners


def crowding_distance(objectives: Array) -> Array:
    """Return how far the neighbours of each design on a front lie, infinite at its ends.

    Parameters
    ----------
    objectives : (N, k) float64
    """
    count, width = objectives.shape
    if count <= 2:
        return np.full(count, np.inf)
    order = np.argsort(objectives, axis=0, kind="stable")
    columns = np.arange(width)
    ascending = objectives[order, columns]
    spread = ascending[-1] - ascending[0]
    with np.errstate(invalid="ignore"):
        steps = np.diff(ascending, axis=0, prepend=-np.inf, append=np.inf) / np.where(
            spread == 0, np.nan, spread
        )
    steps = np.nan_to_num(steps, nan=0.0, posinf=np.inf)
    distance = np.empty_like(objectives)
    distance[order, columns] = steps[:-1] + steps[1:]
    return np.asarray(distance.sum(axis=1) / width)


def _new(designs: Array, known: set[bytes]) -> Array:
    """Return the designs that are neither known nor repeat an earlier one."""
    seen = set(known)
    fresh = []
    for row, key in enumerate(map(bytes, designs)):
        if key not in seen:
            seen.add(key)
            fresh.append(row)
    return designs[fresh]

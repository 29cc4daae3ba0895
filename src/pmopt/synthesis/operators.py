"""Simulated binary crossover and polynomial mutation, the same bits on every processor.

They are pymoo's ``SBX`` and ``PM`` (Deb and Agrawal 1995, Deb and Goyal 1996) but for their
arithmetic: the same formulas, and the same numbers drawn in the same order. Those take powers by
NumPy, whose last bits depend on the processor's vector instructions; one such bit in one child is
another search some generations later. Here powers are :func:`pmopt.numerics.elementary.power_of`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymoo.core.problem import Problem
from pymoo.operators.crossover.sbx import SBX
from pymoo.operators.mutation.pm import PM

from pmopt.numerics.elementary import power_of

Array = NDArray[np.float64]

#: Parents nearer than this in a variable do not exchange it.
_CLOSE = 1e-14


class SimulatedBinaryCrossover(SBX):
    """pymoo's, with :func:`crossed`; all settings are those of all matings."""

    def _do(
        self, problem: Problem, parents: Array, *_: Any, random_state: np.random.Generator,
        **__: Any,
    ) -> Array:  # fmt: skip
        # pymoo draws here which matings may exchange variables: all.
        random_state.random((parents.shape[1], 1))
        return crossed(
            parents, problem.xl, problem.xu, self.eta.value, self.prob_var.value,
            self.prob_bin.value, random_state,
        )  # fmt: skip


class PolynomialMutation(PM):
    """pymoo's, with :func:`mutated`; all settings are those of all designs."""

    def _do(
        self, problem: Problem, designs: Array, *_: Any, random_state: np.random.Generator,
        **__: Any,
    ) -> Array:  # fmt: skip
        return mutated(
            designs, problem.xl, problem.xu, self.eta.value, self.get_prob_var(problem),
            random_state,
        )  # fmt: skip


def crossed(
    parents: Array, lower: Array, upper: Array, eta: float, share: float, exchanged: float,
    random: np.random.Generator,
) -> Array:  # fmt: skip
    """Return two children of each pair of parents (2, M, v), within the bounds.

    Parameters
    ----------
    parents : (2, M, v) float64
    lower, upper : (v,) float64
    eta : float
        The larger, the nearer are children to their parents.
    share : float
        Probability that a variable is crossed.
    exchanged : float
        Probability that a crossed variable is the other child's.
    random : numpy.random.Generator
    """
    first, second = parents
    cross = random.random(first.shape) < share
    cross &= (np.abs(first - second) > _CLOSE) & (lower != upper)
    p, q = first[cross], second[cross]
    less = p < q
    small, large = np.where(less, p, q), np.where(less, q, p)
    low, high = (np.broadcast_to(bound, first.shape)[cross] for bound in (lower, upper))
    draw = random.random(len(p))
    gap = large - small

    def spread(room: Array) -> Array:
        alpha = 2.0 - power_of(1.0 + 2.0 * room / gap, -(eta + 1.0))
        inner = draw <= 1.0 / alpha
        return power_of(
            np.where(inner, draw * alpha, 1.0 / (2.0 - draw * alpha)), 1.0 / (eta + 1.0)
        )

    nearer = 0.5 * ((small + large) - spread(small - low) * gap)
    farther = 0.5 * ((small + large) + spread(high - large) * gap)
    swap = (random.random(len(p)) < exchanged) ^ (p > q)
    # The first child is the first parent's, unless they are exchanged.
    own = less ^ swap
    children = parents.copy()
    children[0, cross] = np.where(own, nearer, farther)
    children[1, cross] = np.where(own, farther, nearer)
    return np.clip(children, lower, upper)


def mutated(
    designs: Array, lower: Array, upper: Array, eta: float, share: float,
    random: np.random.Generator,
) -> Array:  # fmt: skip
    """Return designs (N, v) of whose variables some are moved within the bounds.

    Parameters
    ----------
    designs : (N, v) float64
    lower, upper : (v,) float64
    eta : float
        The larger, the shorter are the moves.
    share : float
        Probability that a variable is moved.
    random : numpy.random.Generator
    """
    moves = random.random(designs.shape) < share
    moves &= lower != upper
    low, high = (np.broadcast_to(bound, designs.shape)[moves] for bound in (lower, upper))
    x = designs[moves]
    draw = random.random(x.shape)
    span = high - low
    down = draw <= 0.5
    kept = power_of(1.0 - np.where(down, (x - low) / span, (high - x) / span), eta + 1.0)
    value = np.where(
        down,
        2.0 * draw + (1.0 - 2.0 * draw) * kept,
        2.0 * (1.0 - draw) + 2.0 * (draw - 0.5) * kept,
    )
    root = power_of(value, 1.0 / (eta + 1.0))
    found = designs.copy()
    found[moves] = np.clip(x + np.where(down, root - 1.0, 1.0 - root) * span, low, high)
    return found

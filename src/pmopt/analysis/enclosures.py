"""What is proven of a design over boxes of poses: affine forms of its slacks and of its Jacobian.

Boxes lie in the design's own box, scaled to the unit cube: their centres and half-widths are
dyadic, and so are their volumes.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sweeper import Design
from pmopt.errors import InputError
from pmopt.mechanisms.base import Mechanism
from pmopt.numerics import affine
from pmopt.numerics.affine import EPS
from pmopt.numerics.expressions import (
    CONSTANT,
    COSINE,
    INPUT,
    SQUARE,
    SUB,
    Expression,
    Graph,
    Tape,
    Untraceable,
    trace,
)

Array = NDArray[np.float64]
#: Stands for infinity in constants: far beyond every coordinate, and no NaN comes of it.
_FAR = 1e30
#: How far a constant may be off, relative to itself and to the design's longest length: constants
#: are sums and products of few lengths, sines and cosines.
_OFF, _OFF_LENGTH = 8 * EPS, 2 * EPS


@cache
def _traced(mechanism: Mechanism) -> tuple[Graph, list[Expression], list[Expression]]:
    return trace(mechanism.kernel, len(mechanism.pose), mechanism.constant_count)


class Enclosure:
    """Affine forms of a design's slacks and of its inverse Jacobian, from the traced kernel.

    Parameters
    ----------
    mechanism : Mechanism
    design : Design
    notify : callable, optional
        Called before a compilation that takes seconds.

    Raises
    ------
    InputError
        For a mechanism whose kernel can not be traced.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        design: Design,
        notify: Callable[[], None] | None = None,
    ) -> None:
        try:
            graph, slacks, entries = _traced(mechanism)
        except Untraceable as error:
            raise InputError(
                f"certify: {mechanism.name}: nothing can be proven of its kernel: {error}"
            ) from None
        constants = np.array(design.constants)
        idle = mechanism.idle_slacks(design.limits)
        self.lower, self.width = design.lower, design.width
        self.order = len(mechanism.joints)
        clipped = np.clip(constants, -_FAR, _FAR)
        longest = max(
            abs(design.parameters[p.name] or 0.0)
            for p in mechanism.parameters
            if p.kind == "length"
        )
        off = _OFF * np.abs(clipped) + _OFF_LENGTH * longest
        self._constants = np.stack([clipped, off], axis=1)
        kept = [
            slack
            for k, slack in enumerate(slacks)
            if k not in idle and not _unbounded(graph, slack, constants)
        ]
        self._slacks = graph.tape(kept)
        self._entries = graph.tape(entries)
        self._code = affine.load(notify)

    def mirrored(self) -> tuple[int, ...]:
        """Return the coordinates in which the set of poses is its own mirror image about 0.

        They enter the slacks by their squares and cosines alone, and the box is even in them.
        """
        steps = self._slacks.steps
        found = []
        for k in range(len(self.lower)):
            places = np.flatnonzero((steps[:, 0] == INPUT) & (steps[:, 1] == k))
            used = np.isin(steps[:, 1], places) | np.isin(steps[:, 2], places)
            used &= ~np.isin(steps[:, 0], (INPUT, CONSTANT))
            even = np.isin(steps[used, 0], (SQUARE, COSINE)).all()
            even = even and not np.isin(self._slacks.results, places).any()
            if even and self.width[k] == -2 * self.lower[k]:
                found.append(k)
        return tuple(found)

    def shares(self, centres: Array, halves: Array) -> tuple[Array, Array]:
        """Return proven bounds of the share of boxes that is reachable.

        Parameters
        ----------
        centres, halves : (N, d) float64
            In the unit cube.
        """
        count, dimension = centres.shape
        forms = self._evaluate(self._slacks, centres, halves)
        low, high = np.empty(count), np.empty(count)
        self._code.shares(forms, np.empty(dimension), low, high)
        return low, high

    def slack_forms(self, centres: Array, halves: Array) -> Array:
        """Return the forms (s, d + 2, N) of the slacks over boxes."""
        return self._evaluate(self._slacks, centres, halves)

    def jacobians(self, centres: Array, halves: Array) -> tuple[Array, Array]:
        """Return the middles (N, n, n) of the inverse Jacobian's entries and how far they range."""
        forms = self._evaluate(self._entries, centres, halves)
        ranges = (np.abs(forms[:, 1:-1]).sum(axis=1) + forms[:, -1]) * (1 + 16 * EPS)
        shape = (len(centres), self.order, self.order)
        return forms[:, 0].T.reshape(shape), ranges.T.reshape(shape)

    def inputs(self, centres: Array, halves: Array) -> Array:
        """Return the forms (d, d + 2, N) of the pose's coordinates over boxes."""
        count, dimension = centres.shape
        forms = np.zeros((dimension, dimension + 2, count))
        for k in range(dimension):
            forms[k, 0] = self.lower[k] + self.width[k] * centres[:, k]
            forms[k, 1 + k] = self.width[k] * halves[:, k]
            # Two roundings of the centre and one of the coefficient.
            forms[k, -1] = 2 * EPS * (abs(self.lower[k]) + self.width[k])
        return forms

    def _evaluate(self, tape: Tape, centres: Array, halves: Array) -> Array:
        forms = self.inputs(centres, halves)
        work = np.empty((len(tape.steps), len(self.lower) + 3, affine.LANES))
        found = np.empty((len(tape.results), len(self.lower) + 2, len(centres)))
        self._code.evaluate(*tape, forms, self._constants, work, found)
        return found


def _unbounded(graph: Graph, slack: Expression, constants: Array) -> bool:
    """Return whether a slack is the distance to an infinite limit."""
    if slack.operation != SUB:
        return False
    return any(
        node.operation == CONSTANT and constants[node.first] == end
        for node, end in (
            (graph.nodes[slack.first], np.inf),
            (graph.nodes[slack.second], -np.inf),
        )
    )

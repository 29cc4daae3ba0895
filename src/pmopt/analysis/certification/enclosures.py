"""What is proven of a design over boxes of poses: affine forms of its slacks and of its Jacobian.

Boxes lie in the design's own box, scaled to the unit cube: their centres and half-widths are
dyadic, and so are their volumes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.design_space import Design
from pmopt.compiler import programs
from pmopt.compiler.tracing import (
    CONSTANT,
    SUB,
    Expression,
    Graph,
    Tape,
    Traced,
    Untraceable,
)
from pmopt.kernels import affine_forms
from pmopt.kernels.affine_forms import EPS
from pmopt.mechanisms.mechanism import Mechanism

Array = NDArray[np.float64]
Boxes = tuple[Array, Array]
#: Stands for infinity in constants: far beyond every coordinate, and no NaN comes of it.
_FAR = 1e30
#: How far a constant may be off, relative to itself and to the design's longest length: constants
#: are sums and products of few lengths, sines and cosines.
_OFF, _OFF_LENGTH = 8 * EPS, 2 * EPS


class Enclosure:
    """Affine forms of a design's slacks and of its inverse Jacobian, from the traced kernel.

    Parameters
    ----------
    mechanism, design, notify
        See :func:`enclose`.
    traced : Traced

    Attributes
    ----------
    lower, width : (d,) float64
        The box that the unit cube stands for.
    open_measure : float
        At most so much of the unit cube's volume is reachable outside the boxes to begin with.
    """

    open_measure = 0.0

    def __init__(
        self,
        mechanism: Mechanism,
        design: Design,
        traced: Traced,
        notify: Callable[[], None] | None = None,
    ) -> None:
        graph, slacks, entries, factors = traced
        constants = np.array(design.constants)
        if any(constants[k] <= 0 for k in factors):
            raise Untraceable("a factor of the margin is not > 0")
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
        self._kept = [
            slack
            for k, slack in enumerate(slacks)
            if k not in idle and not _unbounded(graph, slack, constants)
        ]
        self._graph = graph
        self._slacks = graph.tape(self._kept)
        self._entries = graph.tape(entries)
        self._code = programs.enclosing(notify)

    def first(self) -> tuple[Array, Array, float]:
        """Return the boxes to begin with, (N, d) centres and halves, and a factor of volumes.

        Poses outside them are proven out of reach, or the mirror images of poses within:
        coordinates whose sign changes no slack are taken from 0 on.
        """
        dimension = len(self.lower)
        centres, halves, factor = np.full((1, dimension), 0.5), np.full((1, dimension), 0.5), 1.0
        for k in range(dimension):
            even = self._graph.even(self._kept, self._graph.input(k))
            if even and self.width[k] == -2 * self.lower[k]:
                centres[0, k], halves[0, k] = 0.75, 0.25
                factor *= 2.0
        return centres, halves, factor

    def more(self, share: float) -> Boxes | None:
        """Return boxes to add that hold some of what ``open_measure`` gave, which falls.

        Parameters
        ----------
        share : float
            Of the open measure, that is looked at.

        Returns
        -------
        tuple or None
            None if it cannot fall any more.
        """
        return None

    def whole(self) -> Boxes:
        """Return boxes that hold all poses that are not proven out of reach."""
        shape = (1, len(self.lower))
        return np.full(shape, 0.5), np.full(shape, 0.5)

    def shares(self, centres: Array, halves: Array) -> tuple[Array, Array]:
        """Return proven bounds of the share of boxes that is reachable.

        Parameters
        ----------
        centres, halves : (N, d) float64
            In the unit cube.
        """
        return self.shares_of(self.evaluate(self._slacks, self.inputs(centres, halves)))

    def measures(self, centres: Array, halves: Array) -> tuple[Array, Array]:
        """Return proven bounds of the volume of reachable poses, over that of the boxes."""
        return self.shares(centres, halves)

    def pose(self, point: Array) -> Array:
        """Return the pose at a point of the unit cube."""
        return np.asarray(self.lower + self.width * point)

    def shares_of(self, forms: Array) -> tuple[Array, Array]:
        """Return bounds of the share of boxes in which all slacks are >= 0, of their forms."""
        low, high = np.empty(forms.shape[2]), np.empty(forms.shape[2])
        self._code.shares(forms, np.empty(forms.shape[1] - 2), low, high)
        return low, high

    def jacobians(self, centres: Array, halves: Array) -> tuple[Array, Array]:
        """Return the middles (N, n, n) of the inverse Jacobian's entries and how far they range."""
        return self.matrices(self.evaluate(self._entries, self.inputs(centres, halves)), self.order)

    @staticmethod
    def matrices(forms: Array, order: int) -> tuple[Array, Array]:
        """Return middles and ranges (N, n, n) of forms (n n, d + 2, N)."""
        ranges = (np.abs(forms[:, 1:-1]).sum(axis=1) + forms[:, -1]) * (1 + 16 * EPS)
        shape = (forms.shape[2], order, order)
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

    def evaluate(self, tape: Tape, inputs: Array) -> Array:
        """Return the forms of a tape's results."""
        size = inputs.shape[1]
        work = np.empty((len(tape.steps), size + 1, affine_forms.LANES))
        found = np.empty((len(tape.results), size, inputs.shape[2]))
        self._code.evaluate(*tape, np.ascontiguousarray(inputs), self._constants, work, found)
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

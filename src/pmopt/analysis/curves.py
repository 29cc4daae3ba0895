"""What is proven of a mechanism that reaches a pose coordinate along a curve of configurations.

Boxes lie in the space where v, which tells the place on the curve, stands for that coordinate: all
is explicit there. The coordinate x is monotonic in v on the piece that counts: the volume of poses
is the integral of its slope, which fades where x turns back and poses end. Whether a place is on
the piece about v = 0 is told by cells, column by column from v = 0 outwards.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.enclosures import Array, Boxes, Enclosure
from pmopt.analysis.sweeper import Design
from pmopt.mechanisms.base import Mechanism
from pmopt.numerics.affine import EPS, UP
from pmopt.numerics.expressions import TracedCurve, trace_curve

#: Cells along v; columns along each other coordinate, at first and at most.
_ALONG, _ACROSS, _FINEST = 128, 16, 256
#: Pieces along v that a cell is cut into where its signs are not told as a whole.
_PIECES = 8
_BATCH = 1 << 14
_DROPPED, _KEPT, _UNTOLD = 0, 1, 2


@cache
def _traced(mechanism: Mechanism) -> TracedCurve:
    given = mechanism.curve
    assert given is not None
    return trace_curve(
        given.outcome, len(mechanism.pose), given.coordinate, mechanism.constant_count
    )


class CurveEnclosure(Enclosure):
    """Affine forms over boxes of a design whose poses are sought along a curve.

    Parameters
    ----------
    mechanism, design, notify
        See :func:`pmopt.analysis.enclosures.enclose`.
    """

    def __init__(
        self, mechanism: Mechanism, design: Design, notify: Callable[[], None] | None = None
    ) -> None:
        traced = _traced(mechanism)
        super().__init__(mechanism, design, traced.outcome, notify)
        given = mechanism.curve
        assert given is not None
        self._axis = given.coordinate
        graph = traced.outcome.graph
        self._rates = graph.tape([traced.slope, traced.bend])
        self._value = graph.tape([traced.value])
        self._limits = graph.tape([traced.value, traced.slope, *self._kept])
        low = float(design.lower[self._axis])
        self._range = low, low + float(design.width[self._axis])
        self._span = float(design.width[self._axis])
        self.lower, self.width = design.lower.copy(), design.width.copy()
        # A little more than a turn: both ends are the same place.
        self.lower[self._axis], self.width[self._axis] = -3.1416015625, 6.283203125
        # Whether x rises with v: it does throughout the piece or nowhere.
        slopes = graph.tape([graph.derivative(traced.value, graph.input(self._axis))])
        origin = self.inputs(np.full((1, len(self.lower)), 0.5), np.zeros((1, len(self.lower))))
        self._direction = int(np.sign(self.evaluate(slopes, origin)[0, 0, 0]))
        self.open_measure = 0.0
        self._mark()

    def _mark(self) -> None:
        """Tell of each cell whether it holds places on the piece about v = 0.

        Columns of which that is not told for all cells within the limits are split.
        """
        others = len(self.lower) - 1
        index = np.stack(np.meshgrid(*[np.arange(_ACROSS)] * others, indexing="ij"), axis=-1)
        columns, count = index.reshape(-1, others), _ACROSS
        self._kinds = np.zeros((*[_FINEST] * others, _ALONG), dtype=np.int8)
        told: list[Boxes] = []
        untold: list[Boxes] = []
        while len(columns):
            boxes = self._cells(columns, count)
            kinds = self._kinds_of(*boxes)
            split = (kinds == _UNTOLD).any(axis=1) & (count < _FINEST)
            width = _FINEST // count
            for place, row in zip((columns[~split] * width).tolist(), kinds[~split], strict=True):
                self._kinds[tuple(slice(k, k + width) for k in place)] = row
            for kept, found in ((_KEPT, told), (_UNTOLD, untold)):
                which = (~split[:, None] & (kinds == kept)).ravel()
                found.append((boxes[0][which], boxes[1][which]))
            self._leave_open(boxes, kinds, ~split)
            shifts = np.stack(np.meshgrid(*[[0, 1]] * others, indexing="ij"), axis=-1)
            columns = (2 * columns[split][:, None] + shifts.reshape(-1, others)).reshape(-1, others)
            count *= 2
        self._first = _joined(told)
        self._whole = _joined(told + untold)

    def _leave_open(
        self, boxes: Boxes, kinds: NDArray[np.int64], columns: NDArray[np.bool_]
    ) -> None:
        """Add to the open volume what untold cells of columns hold at most.

        x is monotonic on the piece: from its value before the first untold cell to an end of its
        range.
        """
        axis, half = self._axis, _ALONG // 2
        low, high = self._range
        place = np.arange(_ALONG)
        for outwards in (1, -1):
            side = (place >= half) if outwards > 0 else (place < half)
            open_cells = (kinds == _UNTOLD) & side & columns[:, None]
            rows = np.flatnonzero(open_cells.any(axis=1))
            if not len(rows):
                continue
            order = open_cells[rows] if outwards > 0 else open_cells[rows][:, ::-1]
            # The last told cell: x is bounded there.
            first = np.maximum(order.argmax(axis=1) - 1, half if outwards > 0 else _ALONG - half)
            cells = rows * _ALONG + (first if outwards > 0 else _ALONG - 1 - first)
            centres, halves = (a[cells] for a in boxes)
            least, most = extremes(self.evaluate(self._value, self.inputs(centres, halves))[0])
            rest = high - least if outwards == self._direction else most - low
            rest = np.clip(np.where(np.isnan(rest), self._span, rest), 0.0, self._span)
            footprint = np.prod(np.delete(2 * halves, axis, axis=1), axis=1)
            self.open_measure += float((footprint * rest).sum()) / self.width[axis] * (1 + 1e-12)

    def _cells(self, columns: NDArray[np.int64], count: int) -> Boxes:
        """Return the cells of columns, one column after the other."""
        size, axis = len(self.lower), self._axis
        others = [k for k in range(size) if k != axis]
        centres = np.empty((len(columns), _ALONG, size))
        centres[..., others] = ((columns + 0.5) / count)[:, None]
        centres[..., axis] = (np.arange(_ALONG) + 0.5) / _ALONG
        halves = np.full(size, 0.5 / count)
        halves[axis] = 0.5 / _ALONG
        return centres.reshape(-1, size), np.tile(halves, (len(columns) * _ALONG, 1))

    def _kinds_of(self, centres: Array, halves: Array) -> NDArray[np.int64]:
        """Return the kinds (columns, cells) of columns of cells."""
        within = self._by_batches(
            lambda c, h: self._bounds(c, h)[1] > 0, (centres, halves), np.arange(len(centres))
        ).reshape(-1, _ALONG)
        # What is beyond the last cell within the limits, seen from v = 0, does not matter.
        half = _ALONG // 2
        needed = np.empty_like(within)
        needed[:, :half] = np.logical_or.accumulate(within[:, :half], axis=1)
        needed[:, half:] = np.logical_or.accumulate(within[:, half:][:, ::-1], axis=1)[:, ::-1]
        which = np.flatnonzero(needed.ravel())
        found = np.zeros((len(centres), 2), dtype=np.int64)
        found[which] = self._by_batches(self._signs, (centres, halves), which)
        rising, bending = found.reshape(-1, _ALONG, 2).transpose(2, 1, 0)
        inner = _walk(rising[:half][::-1], -bending[:half][::-1])[::-1]
        kinds = np.concatenate([inner, _walk(rising[half:], bending[half:])]).T
        return np.asarray(np.where(within, kinds, _DROPPED))

    def _signs(self, centres: Array, halves: Array) -> NDArray[np.int64]:
        """Return the signs (N, 2) of the slope and of its change by v over boxes, 0 for untold."""
        forms = self.evaluate(self._rates, self.inputs(centres, halves))
        least, most = extremes(forms)
        told = np.where(least > 0, 1, np.where(most < 0, -1, 0)).T
        rest = np.flatnonzero((told == 0).any(axis=1))
        if len(rest) and halves[0, self._axis] > 0.1 / _ALONG:  # once more in pieces along v
            middles = np.repeat(centres[rest], _PIECES, axis=0)
            widths = np.repeat(halves[rest], _PIECES, axis=0)
            widths[:, self._axis] /= _PIECES
            steps = np.tile(np.arange(_PIECES) * 2.0 - (_PIECES - 1), len(rest))
            middles[:, self._axis] += steps * widths[:, self._axis]
            pieces = self._signs(middles, widths).reshape(-1, _PIECES, 2)
            alike = (pieces == pieces[:, :1]).all(axis=1)
            told[rest] = np.where(alike, pieces[:, 0], told[rest])
        return np.asarray(told)

    @staticmethod
    def _by_batches(
        function: Callable[[Array, Array], NDArray[Any]], boxes: Boxes, which: NDArray[np.int64]
    ) -> NDArray[Any]:
        """Return what a function tells of some boxes."""
        parts = [
            function(*(a[which[start : start + _BATCH]] for a in boxes))
            for start in range(0, max(len(which), 1), _BATCH)
        ]
        return np.concatenate(parts)

    def _kind(self, centres: Array) -> NDArray[np.int8]:
        axis = self._axis
        along = np.minimum((centres[:, axis] * _ALONG).astype(np.int64), _ALONG - 1)
        others = (np.delete(centres, axis, axis=1) * _FINEST).astype(np.int64)
        return np.asarray(self._kinds[(*np.minimum(others, _FINEST - 1).T, along)])

    def first(self) -> tuple[Array, Array, float]:
        """Return the cells that may hold places on the piece; see the base class."""
        return (*self._first, 1.0)

    def whole(self) -> Boxes:
        """Return boxes that hold all poses that are not proven out of reach."""
        return self._whole

    def shares(self, centres: Array, halves: Array) -> tuple[Array, Array]:
        """Return proven bounds of the share of boxes that is reachable; see the base class."""
        low, high, _ = self._told(centres, halves)
        return low, high

    def measures(self, centres: Array, halves: Array) -> tuple[Array, Array]:
        """Return proven bounds of the volume of reachable poses, over that of the boxes.

        The volumes of boxes are those in v; x runs through the slope times as much, and through its
        whole range at most.
        """
        low, high, slope = self._told(centres, halves)
        scale = self._span / self.width[self._axis]
        least, most = (v[0] for v in extremes(slope[None]))
        middle, rest = slope[0], slope[-1] * UP
        full = low == 1
        with np.errstate(invalid="ignore", over="ignore"):
            below = np.where(full, middle - rest, low * np.maximum(least, 0.0)) * (1 - 4 * EPS)
            above = np.where(full, middle + rest, high * np.maximum(most, 0.0)) * (1 + 4 * EPS)
        below = np.where(below > 0, below, 0.0)
        cap = scale / (2 * halves[:, self._axis]) * (1 + 4 * EPS)
        above = np.where(above < cap, above, cap)
        return np.where(high > 0, below, 0.0), np.where(high > 0, above, 0.0)

    def _told(self, centres: Array, halves: Array) -> tuple[Array, Array, Array]:
        """Return :meth:`_bounds` of what is on the piece about v = 0."""
        low, high, slope = self._bounds(centres, halves)
        kind = self._kind(centres)
        return (
            np.where(kind == _KEPT, low, 0.0), np.where(kind == _DROPPED, 0.0, high), slope,
        )  # fmt: skip

    def _bounds(self, centres: Array, halves: Array) -> tuple[Array, Array, Array]:
        """Return bounds of the reachable share and the form (d + 2, N) of the slope."""
        forms = self.evaluate(self._limits, self.inputs(centres, halves))
        value, slope = forms[0], forms[1]
        ends = []
        for end, sign in zip(self._range, (1.0, -1.0), strict=True):
            room = sign * value
            room[0] -= sign * end
            room[-1] = value[-1] + EPS * np.abs(room[0])
            ends.append(room)
        low, high = self.shares_of(np.concatenate([forms[1:], np.stack(ends)]))
        return low, high, slope

    def pose(self, point: Array) -> Array:
        """Return the pose at a point of the unit cube."""
        pose = self.lower + self.width * point
        inputs = self.inputs(point[None], np.zeros((1, len(point))))
        pose[self._axis] = self.evaluate(self._value, inputs)[0, 0, 0]
        return np.asarray(pose)


def _joined(parts: list[Boxes]) -> Boxes:
    centres, halves = zip(*parts, strict=True)
    return np.concatenate(centres), np.concatenate(halves)


def extremes(forms: Array) -> tuple[Array, Array]:
    """Return the least and the greatest value of forms (.., d + 2, N)."""
    range_ = np.abs(forms[..., 1:-1, :]).sum(axis=-2) + forms[..., -1, :]
    middle = forms[..., 0, :]
    with np.errstate(invalid="ignore"):
        range_ = range_ * UP + 8 * EPS * np.abs(middle)
        return np.asarray(middle - range_), np.asarray(middle + range_)


def _walk(rising: NDArray[np.int64], bending: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the kinds of cells (n, columns) met from v = 0 outwards.

    ``rising`` is the sign of the slope throughout a cell, ``bending`` that of its change outwards;
    0 where neither is proven. While the slope falls outwards, from one cell through the next, the
    places with a slope > 0 are on the piece; where it is < 0 throughout a cell the piece has ended.
    """
    kinds = np.empty_like(rising)
    inside, falling, ended = (np.full(rising.shape[1], v) for v in (True, False, False))
    for k in range(len(rising)):
        positive, down = rising[k] > 0, bending[k] < 0
        # All cells up to here fall: a slope > 0 here means that it was before.
        known = inside | falling
        ended |= rising[k] < 0
        kinds[k] = np.where(
            ended, _DROPPED,
            np.where((inside & positive) | (known & down) | (falling & positive), _KEPT, _UNTOLD),
        )  # fmt: skip
        inside, falling = (inside | falling) & positive, known & down & ~positive
    return kinds

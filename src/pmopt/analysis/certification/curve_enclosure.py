"""What is proven of a mechanism that reaches a pose coordinate along a curve of configurations.

Boxes lie in the space where v, the place on the curve, stands for that coordinate: all
is explicit there. The coordinate x is monotonic in v on the piece that counts: the volume of poses
is the integral of its slope, which fades where x turns back and poses end. Whether a place is on
the piece about v = 0 is decided by cells, column by column from v = 0 outwards. Columns that stay
open are bisected as long as the volume that they leave open matters.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.certification.enclosures import Array, Boxes, Enclosure
from pmopt.analysis.sampling.design_space import Design
from pmopt.compiler.tracing import Graph, TracedCurve, trace_curve
from pmopt.kernels.affine_forms import EPS, UP
from pmopt.mechanisms.mechanism import Mechanism
from pmopt.numerics.elementary import log_of

#: Cells along v; columns along each other coordinate at first.
_ALONG, _ACROSS = 256, 16
#: How often columns are bisected where boxes for all poses are asked for, and their least size.
_DEPTH, _LEAST_HALF = 8, 0.5**40
#: Columns that are split at once, and how many there are before no more are split.
_GROUP, _MOST_COLUMNS = 1 << 12, 1 << 18
#: Cells whose signs are looked for at once, beyond the last one that is decided.
_AHEAD = 4
#: Pieces along v that a cell is cut into where its signs are not known as a whole.
_PIECES = 8
_BATCH = 1 << 14
_DROPPED, _KEPT, _UNDECIDED = 0, 1, 2


@cache
def _traced(mechanism: Mechanism) -> TracedCurve:
    given = mechanism.curve
    assert given is not None
    return trace_curve(
        given.outcome,
        len(mechanism.pose),
        given.coordinate,
        mechanism.constants,
    )


class _Columns(NamedTuple):
    """Columns of cells along v, (n, ..).

    The children of one are ``child`` and that which is as many columns later as were split with it.
    ``axis`` is the coordinate it is split across, ``opening`` the open volume of one that is not
    split, ``first`` the open cell to look at. Of each cell: whether it may be ``within`` the
    limits, the ``signs`` of the slope and of its change by v, and what follows, ``kinds``.
    """

    centres: Array
    halves: Array
    child: NDArray[np.int64]
    axis: NDArray[np.int64]
    opening: Array
    first: NDArray[np.int64]
    within: NDArray[np.bool_]
    signs: NDArray[np.int8]
    kinds: NDArray[np.int8]

    def at(self, rows: NDArray[np.int64]) -> _Columns:
        """Return some of the columns."""
        return _Columns._make(a[rows] for a in self)

    def and_(self, others: _Columns) -> _Columns:
        """Return these columns and others."""
        both: list[tuple[Any, Any]] = list(zip(self, others, strict=True))
        return _Columns._make(np.concatenate(pair) for pair in both)


class CurveEnclosure(Enclosure):
    """Affine forms over boxes of a design whose poses are sought along a curve.

    Parameters
    ----------
    mechanism, design, notify
        See :func:`pmopt.analysis.certification.enclosing.enclose`.
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
        self._mirrored = self._mirrors(graph, traced)
        self._ahead = _AHEAD
        self._decided: list[Boxes] = []
        self._steps: list[tuple[int, int]] = []
        self._columns = self._examined(self._roots())
        self.open_measure = self._open_volume()

    def _mirrors(self, graph: Graph, traced: TracedCurve) -> list[int]:
        """Return the coordinates whose sign does not change which poses are reachable."""
        found = [traced.value, traced.slope, *self._kept]
        return [
            k
            for k in range(len(self.lower))
            if k != self._axis
            and self.width[k] == -2 * self.lower[k]
            and graph.even(found, graph.input(k))
        ]

    def _roots(self) -> _Columns:
        """Return the columns to begin with, the mirrored ones left out."""
        others = len(self.lower) - 1
        index = np.stack(np.meshgrid(*[np.arange(_ACROSS)] * others, indexing="ij"), axis=-1)
        places = index.reshape(-1, others)
        count = len(places)
        centres, halves = (places + 0.5) / _ACROSS, np.full((count, others), 0.5 / _ACROSS)
        within = np.ones((count, _ALONG), dtype=bool)
        for k, axis in enumerate(self._others):
            if axis in self._mirrored:
                within[centres[:, k] < 0.5] = False
        signs = np.zeros((count, _ALONG, 2), dtype=np.int8)
        kinds = np.full((count, _ALONG), _UNDECIDED, dtype=np.int8)
        return _Columns(
            centres, halves, np.full(count, -1), np.zeros(count, dtype=np.int64), np.zeros(count),
            np.full(count, -1), within, signs, kinds,
        )  # fmt: skip

    def _examined(self, columns: _Columns) -> _Columns:
        """Return columns with what is known of their cells; cells decided before stay so.

        Adds the cells that are newly decided to the boxes.
        """
        within, signs, before = columns.within, columns.signs, columns.kinds
        boxes = self._cells(columns)
        which = np.flatnonzero(((before == _UNDECIDED) & within).ravel())
        within = within.copy()
        within.reshape(-1)[which] = self._by_batches(
            lambda c, h: self._bounds(c, h)[1] > 0, boxes, which
        )
        # What is beyond the last cell within the limits, seen from v = 0, does not matter.
        half = _ALONG // 2
        needed = np.empty_like(within)
        needed[:, :half] = np.logical_or.accumulate(within[:, :half], axis=1)
        needed[:, half:] = np.logical_or.accumulate(within[:, half:][:, ::-1], axis=1)[:, ::-1]
        signs = signs.copy()
        asked = np.zeros_like(needed)
        start = self._start_signs(boxes)
        while True:
            for cell, outwards in ((half, 1), (half - 1, -1)):
                bends = signs[:, cell, 1] * outwards
                # Where there is no piece at all it has ended in the first cell.
                signs[start < 0, cell, 0] = -1
                signs[(start > 0) & (bends > 0), cell, 0] = 1
            rising, bending = signs.astype(np.int64).transpose(2, 1, 0)
            inner = _walk(rising[:half][::-1], -bending[:half][::-1])[::-1]
            kinds = np.concatenate([inner, _walk(rising[half:], bending[half:])]).T
            # A few cells beyond the last one that is decided.
            rest = (kinds == _UNDECIDED) & needed & ~asked
            blocked = (kinds == _UNDECIDED) & needed & asked
            counts = (rest | blocked).astype(np.int64)
            blocks = blocked.astype(np.int64)
            for side in (slice(half - 1, None, -1), slice(half, None)):
                near = np.cumsum(counts[:, side], axis=1) <= self._ahead
                near &= np.cumsum(blocks[:, side], axis=1) == 0
                rest[:, side] &= near
            which = np.flatnonzero(rest.ravel())
            if not len(which):
                break
            asked |= rest
            signs.reshape(-1, 2)[which] = self._by_batches(self._signs, boxes, which)
        new = np.flatnonzero(((kinds == _KEPT) & (before == _UNDECIDED) & within).ravel())
        self._decided.append((boxes[0][new], boxes[1][new]))
        opening, first, held = self._opening(boxes, (kinds == _UNDECIDED) & within)
        within &= (kinds != _UNDECIDED) | held
        return columns._replace(
            opening=opening, first=first, within=within, signs=signs, kinds=kinds.astype(np.int8)
        )

    def _start_signs(self, boxes: Boxes) -> NDArray[np.int64]:
        """Return the signs of the slope at v = 0 of columns, 0 for unknown."""
        first = slice(_ALONG // 2, None, _ALONG)
        centres, halves = boxes[0][first].copy(), boxes[1][first].copy()
        centres[:, self._axis], halves[:, self._axis] = 0.5, 0.0
        least, most = extremes(self.evaluate(self._rates, self.inputs(centres, halves))[:1])
        return np.asarray(np.where(least[0] > 0, 1, np.where(most[0] < 0, -1, 0)))

    def _opening(
        self, boxes: Boxes, open_cells: NDArray[np.bool_]
    ) -> tuple[Array, NDArray[np.int64], NDArray[np.bool_]]:
        """Return what the open cells of columns hold at most, and the first one of each column.

        With them which cells hold anything. x is monotonic on the piece: from its value before the
        first open cell to an end of its range.
        """
        axis, half = self._axis, _ALONG // 2
        low, high = self._range
        place = np.arange(_ALONG)
        holding = open_cells.copy()
        opening, most_open = np.zeros(len(open_cells)), np.zeros(len(open_cells))
        found = np.full(len(open_cells), -1)
        for outwards in (1, -1):
            cells = open_cells & ((place >= half) if outwards > 0 else (place < half))
            rows = np.flatnonzero(cells.any(axis=1))
            if not len(rows):
                continue
            if outwards > 0:
                first = cells[rows].argmax(axis=1)
            else:
                first = _ALONG - 1 - cells[rows][:, ::-1].argmax(axis=1)
            which = rows * _ALONG + first
            centres, halves = (a[which] for a in boxes)
            centres[:, axis] -= outwards * halves[:, axis]
            footprint = np.prod(np.delete(2 * halves, axis, axis=1), axis=1)
            halves[:, axis] = 0.0
            least, most = extremes(self.evaluate(self._value, self.inputs(centres, halves))[0])
            rest = high - least if outwards == self._direction else most - low
            rest = np.clip(np.where(np.isnan(rest), self._span, rest), 0.0, self._span)
            holding[np.ix_(rows[rest == 0], place >= half if outwards > 0 else place < half)] = (
                False
            )
            # What is mirrored counts as often.
            held = footprint * rest * 2 ** len(self._mirrored) / self.width[axis] * (1 + 1e-12)
            opening[rows] += held
            found[rows] = np.where(held >= most_open[rows], first, found[rows])
            most_open[rows] = np.maximum(held, most_open[rows])
        return opening, found, holding

    def more(self, share: float) -> Boxes | None:
        """Split the columns that hold a share of the open volume; see the base class."""
        columns = self._columns
        if len(columns.child) > _MOST_COLUMNS:
            return None
        usable = (columns.opening > 0) & (columns.child < 0)
        usable &= columns.halves.min(axis=1) > _LEAST_HALF
        order = np.argsort(np.where(usable, -columns.opening, 0.0), kind="stable")
        order = order[: int(usable.sum())]
        if not len(order):
            return None
        sums = np.cumsum(columns.opening[order])
        rows = np.sort(order[: int(np.searchsorted(sums, share * sums[-1])) + 1])
        before = len(self._decided)
        for start in range(0, len(rows), _GROUP):
            self._split(rows[start : start + _GROUP])
        return _joined(self._decided[before:])

    def _split(self, rows: NDArray[np.int64]) -> None:
        """Bisect columns across the coordinate that the first open cell's signs depend on most."""
        columns = self._columns
        axis = self._axes(rows)
        count = len(rows)
        halves = columns.halves[rows]
        shift = np.zeros_like(halves)
        shift[np.arange(count), axis] = halves[np.arange(count), axis] / 2
        parents = columns.at(rows)
        children = parents.and_(parents)._replace(
            centres=np.concatenate([parents.centres - shift, parents.centres + shift]),
            halves=np.concatenate([halves - shift, halves - shift]),
            child=np.full(2 * count, -1),
        )
        found = self._examined(children)
        child, split = columns.child.copy(), columns.axis.copy()
        child[rows], split[rows] = len(child) + np.arange(count), axis
        opening = columns.opening.copy()
        opening[rows] = 0.0
        columns = columns._replace(child=child, axis=split, opening=opening)
        self._steps.append((len(columns.child), count))
        self._columns = columns.and_(found)
        self.open_measure = self._open_volume()

    def _open_volume(self) -> float:
        """Return the sum over columns, rounded up."""
        return float(self._columns.opening.sum()) * (1 + (_MOST_COLUMNS + 4 * _GROUP) * EPS)

    def _axes(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the coordinate across which each column is to be split.

        That in which a narrower box narrows slope and bend of the first open cell most.
        """
        columns = self._columns
        part = columns.at(rows)
        centres, halves = (
            a.reshape(len(rows), _ALONG, -1)[np.arange(len(rows)), part.first]
            for a in self._cells(part)
        )
        halves[:, self._axis] /= _PIECES
        scores = []
        for axis in self._others:
            narrow = halves.copy()
            narrow[:, axis] /= _PIECES
            forms = self.evaluate(self._rates, self.inputs(centres, narrow))
            range_ = np.abs(forms[:, 1:-1]).sum(axis=1) + forms[:, -1]
            with np.errstate(over="ignore", invalid="ignore"):
                score = log_of(np.clip(np.nan_to_num(range_, nan=1e100), 1e-300, 1e100)).sum(axis=0)
            scores.append(score - 1e-3 * log_of(halves[:, axis]))
        return np.asarray(np.argmin(np.stack(scores, axis=1), axis=1))

    @property
    def _others(self) -> list[int]:
        return [k for k in range(len(self.lower)) if k != self._axis]

    def _cells(self, columns: _Columns) -> Boxes:
        """Return the cells of columns, one column after the other."""
        size, axis = len(self.lower), self._axis
        centres = np.empty((len(columns.child), _ALONG, size))
        halves = np.empty_like(centres)
        centres[..., self._others] = columns.centres[:, None]
        halves[..., self._others] = columns.halves[:, None]
        centres[..., axis] = (np.arange(_ALONG) + 0.5) / _ALONG
        halves[..., axis] = 0.5 / _ALONG
        return centres.reshape(-1, size), halves.reshape(-1, size)

    def _signs(self, centres: Array, halves: Array) -> NDArray[np.int64]:
        """Return the signs (N, 2) of the slope and of its change by v over boxes, 0 for unknown."""
        forms = self.evaluate(self._rates, self.inputs(centres, halves))
        least, most = extremes(forms)
        signs = np.where(least > 0, 1, np.where(most < 0, -1, 0)).T
        rest = np.flatnonzero((signs == 0).any(axis=1))
        if len(rest) and halves[0, self._axis] > 0.1 / _ALONG:  # once more in pieces along v
            middles = np.repeat(centres[rest], _PIECES, axis=0)
            widths = np.repeat(halves[rest], _PIECES, axis=0)
            widths[:, self._axis] /= _PIECES
            steps = np.tile(np.arange(_PIECES) * 2.0 - (_PIECES - 1), len(rest))
            middles[:, self._axis] += steps * widths[:, self._axis]
            pieces = self._signs(middles, widths).reshape(-1, _PIECES, 2)
            alike = (pieces == pieces[:, :1]).all(axis=1)
            signs[rest] = np.where(alike, pieces[:, 0], signs[rest])
        return np.asarray(signs)

    @staticmethod
    def _by_batches(
        function: Callable[[Array, Array], NDArray[Any]], boxes: Boxes, which: NDArray[np.int64]
    ) -> NDArray[Any]:
        """Return what a function says of some boxes."""
        parts = [
            function(*(a[which[start : start + _BATCH]] for a in boxes))
            for start in range(0, max(len(which), 1), _BATCH)
        ]
        return np.concatenate(parts)

    def _kind(self, centres: Array, halves: Array) -> NDArray[np.int8]:
        """Return the kinds of boxes, _UNDECIDED for those that are in no single cell."""
        axis, others = self._axis, self._others
        places, widths = centres[:, others].copy(), halves[:, others]
        for axis_, column in zip(others, places.T, strict=True):
            if axis_ in self._mirrored:
                column[:] = np.where(column < 0.5, 1.0 - column, column)
        index = np.minimum((places * _ACROSS).astype(np.int64), _ACROSS - 1)
        node = np.zeros(len(centres), dtype=np.int64)
        for column in index.T:
            node = node * _ACROSS + column
        columns = self._columns
        fits = (np.abs(places - columns.centres[node]) + widths <= columns.halves[node]).all(axis=1)
        for start, count in self._steps:
            child = columns.child[node]
            inner = np.flatnonzero((child >= start) & (child < start + count))
            if not len(inner):
                continue
            parent = node[inner]
            across = columns.axis[parent]
            offset = places[inner, across] - columns.centres[parent, across]
            whole = np.abs(offset) >= widths[inner, across]
            child = child[inner] + np.where(offset > 0, count, 0)
            node[inner] = np.where(whole, child, parent)
        along = np.clip((centres[:, axis] * _ALONG).astype(np.int64), 0, _ALONG - 1)
        fits &= np.abs(centres[:, axis] * _ALONG - along - 0.5) + halves[:, axis] * _ALONG <= 0.5
        kinds = np.where(columns.within[node, along], columns.kinds[node, along], _DROPPED)
        return np.asarray(np.where(fits, kinds, _UNDECIDED))

    def first(self) -> tuple[Array, Array, float]:
        """Return the cells that may hold places on the piece; see the base class."""
        return (*_joined(self._decided), 2.0 ** len(self._mirrored))

    def whole(self) -> Boxes:
        """Return boxes that hold all poses that are not proven out of reach."""
        self._ahead = _ALONG
        for _ in range(_DEPTH):
            self.more(1.0)
        columns = self._columns
        open_cells = (columns.kinds == _UNDECIDED) & columns.within & (columns.child < 0)[:, None]
        which = np.flatnonzero(open_cells.ravel())
        cells = self._cells(columns)
        centres, halves = _joined([*self._decided, (cells[0][which], cells[1][which])])
        for axis in self._mirrored:
            mirror = centres.copy()
            mirror[:, axis] = 1.0 - mirror[:, axis]
            centres, halves = _joined([(centres, halves), (mirror, halves)])
        return centres, halves

    def shares(self, centres: Array, halves: Array) -> tuple[Array, Array]:
        """Return proven bounds of the share of boxes that is reachable; see the base class."""
        low, high, _ = self._bounds(centres, halves)
        kind = self._kind(centres, halves)
        return np.where(kind == _KEPT, low, 0.0), np.where(kind == _DROPPED, 0.0, high)

    def measures(self, centres: Array, halves: Array) -> tuple[Array, Array]:
        """Return proven bounds of the volume of reachable poses, over that of the boxes.

        The boxes lie in those of :meth:`first` and :meth:`more`. Their volumes are those in v; x
        runs through the slope times as much, and through its whole range at most.
        """
        low, high, slope = self._bounds(centres, halves)
        scale = self._span / self.width[self._axis]
        least, most = (v[0] for v in extremes(slope[None]))
        middle, rest = slope[0], slope[-1] * UP
        # The mean of the linear part's term e_k over a share p of a box is at most 1 - p.
        share = np.clip(0.5, low, high)
        tilt = np.abs(slope[1:-1]).sum(axis=0) * share * (1 - share) * (1 + 16 * EPS)
        tilt += EPS * tilt + 4 * EPS * np.abs(slope[1:-1]).sum(axis=0) * (low < high)
        with np.errstate(invalid="ignore", over="ignore"):
            down, up = middle - rest, middle + rest
            below = np.where(down > 0, low, high) * down - tilt
            above = np.where(up > 0, high, low) * up + tilt
            off = 8 * EPS * (np.abs(middle) + rest + tilt)
            below = np.fmax(low * np.maximum(least, 0.0) * (1 - 4 * EPS), below - off)
            above = np.fmin(high * np.maximum(most, 0.0) * (1 + 4 * EPS), above + off)
        below = np.where(below > 0, below, 0.0)
        cap = scale / (2 * halves[:, self._axis]) * (1 + 4 * EPS)
        above = np.where(above < cap, above, cap)
        return np.where(high > 0, below, 0.0), np.where(high > 0, above, 0.0)

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
            np.where(
                (inside & positive) | (known & down) | (falling & positive), _KEPT, _UNDECIDED
            ),
        )  # fmt: skip
        inside, falling = (inside | falling) & positive, known & down & ~positive
    return kinds

"""What is proven of a mechanism whose kernel solves equations step by step.

Over a box of poses the solution is enclosed by Krawczyk's operator about its linearisation: that it
exists and is the only one nearby is proven, not assumed. Which solution of several is meant follows
from continuity. The coordinates that the unknowns depend on are covered with cells, from home
outwards: neighbours belong to one sheet of solutions where the root at a point of their common face
is in both cells' enclosures. The cover ends in cells of the same sheet that are beyond a limit
throughout; what is behind them is not connected with home through reachable poses.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.certification.enclosures import Array, Boxes, Enclosure
from pmopt.analysis.sampling.design_space import Design
from pmopt.compiler.records import named
from pmopt.compiler.tracing import Tape, TracedImplicit, trace_implicit
from pmopt.errors import InputError
from pmopt.kernels.affine_forms import EPS
from pmopt.mechanisms.mechanism import Mechanism
from pmopt.numerics.matrices import determinant, inverse, product

#: Levels of bisection of the first cells, and of the smallest.
_FIRST, _LAST = 4, 12
_NEWTON_STEPS = 4
#: Radius of the box in which the solution is shown to be the only one, over that of what encloses
#: it: as large as can be proven, so that neighbours' solutions lie in it.
_RADII = (16.0, 4.0, 1.5)
_WITHIN, _BEYOND, _UNKNOWN = 0, 1, 2


@cache
def traced_implicit(mechanism: Mechanism) -> TracedImplicit:
    """Return the equations of a mechanism as expressions."""
    given = mechanism.implicit
    assert given is not None
    return trace_implicit(
        given.residuals, given.outcome, len(mechanism.pose), given.unknowns,
        mechanism.constants,
    )  # fmt: skip


class Tubes(NamedTuple):
    """Solutions over N boxes: u0 + slopes e to the radius ``tight``, the only ones in ``wide``.

    Attributes
    ----------
    proven : (N,) bool
    middle, tight, wide : (N, m) float64
    slopes : (N, m, k) float64
        By the inner coordinates, scaled to the box.
    """

    proven: NDArray[np.bool_]
    middle: Array
    slopes: Array
    tight: Array
    wide: Array

    def at(self, which: NDArray[np.int64], place: Array) -> Array:
        """Return the linearised solutions of some boxes at places (N, k) in [-1, 1]."""
        return np.asarray(self.middle[which] + np.einsum("nmk,nk->nm", self.slopes[which], place))


class Sheet(Enclosure):
    """Affine forms over boxes of a design whose kernel solves equations.

    Parameters
    ----------
    mechanism, design, notify
        See :func:`pmopt.analysis.certification.enclosing.enclose`.

    Raises
    ------
    InputError
        Where home cannot be shown to lie on a sheet.
    """

    def __init__(
        self, mechanism: Mechanism, design: Design, notify: Callable[[], None] | None = None
    ) -> None:
        traced = traced_implicit(mechanism)
        super().__init__(mechanism, design, traced.outcome, notify)
        given = mechanism.implicit
        assert given is not None
        self._given = given
        self._inner = list(given.inner)
        self._size = len(design.lower)
        graph = traced.outcome.graph
        self._residuals = graph.tape(traced.residuals)
        self._slopes = graph.tape(traced.slopes)
        outer = set(range(self._size)) - set(self._inner)
        self._inner_slacks = graph.tape(
            [slack for slack in self._kept if not graph.inputs_of(slack) & outer]
        )
        self._values = named(mechanism.constants, design.constants)
        home = mechanism.home(design.parameters)
        self._home = np.array([home[c.name] for c in mechanism.pose])
        # The box is widened to hold home; what this adds is cut off again as if by limits.
        self._cut: list[tuple[int, float, float]] = []
        self.lower, self.width = design.lower.copy(), design.width.copy()
        for k in self._inner:
            low, high = design.lower[k], design.lower[k] + design.width[k]
            if not low <= self._home[k] <= high:
                self._cut.append((k, low, high))
                self.lower[k] = min(low, self._home[k])
                self.width[k] = max(high, self._home[k]) - self.lower[k]
        self._cover(mechanism)

    # -- the cover -----------------------------------------------------------------------

    def _cover(self, mechanism: Mechanism) -> None:
        """Cover the poses connected with home by cells, and keep the cells."""
        k = len(self._inner)
        count = 2**_FIRST
        places = np.stack(np.meshgrid(*[np.arange(count)] * k, indexing="ij"), axis=-1)
        centres = (places.reshape(-1, k) + 0.5) / count
        halves = np.full_like(centres, 0.5 / count)
        self._take_cells(centres, halves)
        while True:
            flooded, touched = self._flood()
            small = self._cell_halves[:, 0] <= 0.5 / 2**_LAST
            split = touched & ~small
            if not split.any():
                break
            shifts = np.stack(np.meshgrid(*[[-0.5, 0.5]] * k, indexing="ij"), axis=-1)
            halves = self._cell_halves[split]
            new = self._cell_centres[split][:, None] + halves[:, None] * shifts.reshape(-1, k)
            keep = ~split
            self._take_cells(new.reshape(-1, k), np.repeat(halves / 2, 2**k, axis=0), keep)
        if not (flooded.any() or self._home_beyond):
            raise InputError(
                f"certify: {mechanism.name}: nothing can be proven of this design: its home pose "
                "is not shown to be regular"
            )
        # Beyond an unsettled cell that cannot be split there may be anything.
        self._flooded, self._open = flooded, ~flooded if touched.any() else touched

    def _take_cells(
        self, centres: Array, halves: Array, keep: NDArray[np.bool_] | None = None
    ) -> None:
        """Prove what can be proven of new cells; of the cells there are, ``keep`` some."""
        poses = self._home + np.zeros((len(centres), self._size))
        lower, width = self.lower[self._inner], self.width[self._inner]
        poses[:, self._inner] = lower + width * centres
        starts = [self._given.start(*pose, self._values) for pose in poses.tolist()]
        tubes = self.tubes(centres, halves, np.array(starts, dtype=float))
        state = np.where(tubes.proven, _WITHIN, _UNKNOWN)
        if len(self._inner_slacks.results):
            _, high = self.shares_of(self._forms(self._inner_slacks, centres, halves, tubes))
            state[tubes.proven & (high == 0)] = _BEYOND
        if keep is None:
            self._cell_centres, self._cell_halves = centres, halves
            self._tubes, self._state = tubes, state
            return
        self._cell_centres = np.concatenate([self._cell_centres[keep], centres])
        self._cell_halves = np.concatenate([self._cell_halves[keep], halves])
        self._state = np.concatenate([self._state[keep], state])
        self._tubes = Tubes(
            *(np.concatenate([old[keep], new]) for old, new in zip(self._tubes, tubes, strict=True))
        )

    def _flood(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return the cells that are connected with home, and the unsettled ones they touch."""
        centres, halves = self._cell_centres, self._cell_halves
        size = round(0.5 / float(halves.min()))
        self._raster = self._painted(centres, halves, size)
        pairs = []
        for axis in range(centres.shape[1]):
            a = np.moveaxis(self._raster, axis, 0)[:-1].ravel()
            b = np.moveaxis(self._raster, axis, 0)[1:].ravel()
            pairs.append(np.unique(np.stack([a, b], axis=1)[a != b], axis=0))
        links = np.concatenate(pairs)
        alike = self._alike(links)
        flooded = np.zeros(len(centres), dtype=bool)
        touched = np.zeros(len(centres), dtype=bool)
        inner = self._inner
        place = (self._home[inner] - self.lower[inner]) / self.width[inner]
        near = (np.abs(place - centres) <= halves * (1 + 1e-12)).all(axis=1)
        seeds = np.flatnonzero(near)
        for cell in seeds:
            if self._state[cell] == _UNKNOWN:
                touched[cell] = True
        roots = self.tubes(
            place[None], np.zeros((1, len(inner))),
            np.array([self._given.start(*self._home.tolist(), self._values)], dtype=float),
        )  # fmt: skip
        self._home_beyond = False
        for cell in seeds[self._state[seeds] != _UNKNOWN]:
            if self._holds(roots, np.zeros(1, dtype=np.int64), np.array([cell]), place[None])[0]:
                flooded[cell] = self._state[cell] == _WITHIN
                self._home_beyond |= self._state[cell] == _BEYOND
        stack: list[int] = np.flatnonzero(flooded).tolist()
        neighbours: dict[int, list[tuple[int, bool]]] = {}
        for (a, b), same in zip(links.tolist(), alike.tolist(), strict=True):
            neighbours.setdefault(a, []).append((b, same))
            neighbours.setdefault(b, []).append((a, same))
        while stack:
            for other, same in neighbours.get(stack.pop(), []):
                if self._state[other] == _UNKNOWN or not same:
                    touched[other] |= not flooded[other]
                elif self._state[other] == _WITHIN and not flooded[other]:
                    flooded[other] = True
                    touched[other] = False
                    stack.append(other)
        return flooded, touched & ~flooded

    @staticmethod
    def _painted(centres: Array, halves: Array, size: int) -> NDArray[np.int64]:
        """Return the number of the cell at each place of a grid of the smallest cells."""
        raster = np.zeros((size,) * centres.shape[1], dtype=np.int64)
        first = np.round((centres - halves) * size).astype(np.int64)
        last = np.round((centres + halves) * size).astype(np.int64)
        for i, (low, high) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
            raster[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = i
        return raster

    def _alike(self, links: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which pairs of neighbours hold the same root at a point of their face."""
        a, b = links.T
        both = self._tubes.proven[a] & self._tubes.proven[b]
        alike = np.zeros(len(links), dtype=bool)
        index = np.flatnonzero(both)
        a, b = a[index], b[index]
        low = np.maximum(*(self._cell_centres[x] - self._cell_halves[x] for x in (a, b)))
        high = np.minimum(*(self._cell_centres[x] + self._cell_halves[x] for x in (a, b)))
        points = (low + high) / 2
        start = self._tubes.at(a, (points - self._cell_centres[a]) / self._cell_halves[a])
        roots = self.tubes(points, np.zeros_like(points), start)
        own = np.arange(len(a))
        alike[index] = self._holds(roots, own, a, points) & self._holds(roots, own, b, points)
        return alike

    def _holds(
        self, roots: Tubes, which: NDArray[np.int64], cells: NDArray[np.int64], points: Array
    ) -> NDArray[np.bool_]:
        """Return whether a root at a point is the one that a cell encloses."""
        place = (points - self._cell_centres[cells]) / self._cell_halves[cells]
        known = self._tubes.at(cells, place)
        off = np.abs(roots.middle[which] - known) + roots.tight[which]
        size = np.abs(known) + np.abs(self._tubes.slopes[cells]).sum(axis=2)
        with np.errstate(invalid="ignore"):
            inside = (off + 32 * EPS * size <= self._tubes.wide[cells]).all(axis=1)
        return np.asarray(inside & roots.proven[which] & self._tubes.proven[cells])

    # -- the solution over boxes ---------------------------------------------------------

    def tubes(self, centres: Array, halves: Array, starts: Array) -> Tubes:
        """Prove existence and uniqueness of the solution over boxes of the inner coordinates.

        Parameters
        ----------
        centres, halves : (N, k) float64
            In the unit cube.
        starts : (N, m) float64
        """
        count, k = centres.shape
        m = starts.shape[1]
        pose = np.zeros((self._size, k + 2, count))
        pose[self._inner] = self._inner_forms(centres, halves)
        points = pose[:, [0, -1]] * [[[1.0], [0.0]]]
        middle = np.where(np.isfinite(starts), starts, 0.0)
        for step in range(_NEWTON_STEPS + 1):
            inputs = np.zeros((self._size + m, 2, count))
            inputs[: self._size] = points
            inputs[self._size :, 0] = middle.T
            slopes = self.evaluate(self._slopes, inputs)[:, 0].T.reshape(count, m, m)
            inverse = _pseudo(slopes)
            if step < _NEWTON_STEPS:
                residual = self.evaluate(self._residuals, inputs)[:, 0].T
                middle = middle - np.einsum("nij,nj->ni", inverse, residual)
                middle = np.clip(np.where(np.isfinite(middle), middle, 0.0), -1e3, 1e3)
        inputs = np.zeros((self._size + m, k + 2, count))
        inputs[: self._size] = pose
        inputs[self._size :, 0] = middle.T
        first = self.evaluate(self._residuals, inputs)[:, 1:-1]
        lines = -np.einsum("nij,jkn->nik", inverse, first)
        inputs[self._size :, 1:-1] = np.moveaxis(lines, 0, 2)
        absolute = np.abs(inverse)
        forms = self.evaluate(self._residuals, inputs)
        off = np.abs(np.einsum("nij,jln->nil", inverse, forms[:, :-1])).sum(axis=2)
        size = np.abs(forms).sum(axis=1).T
        rounding = 4 * (m + k + 4) * EPS
        off += np.einsum("nij,nj->ni", absolute, forms[:, -1].T + rounding * size)
        off = off * (1 + rounding) + 1e-300
        proven = np.zeros(count, dtype=bool)
        tight, wide = np.full((count, m), np.inf), np.full((count, m), np.inf)
        eye = np.eye(m)
        for radius in _RADII:
            rest = np.flatnonzero(~proven)
            if not len(rest):
                break
            trial = radius * off[rest] + 1e-13
            part = inputs[:, :, rest].copy()
            part[self._size :, -1] = trial.T
            mids, ranges = self.matrices(self.evaluate(self._slopes, part), m)
            with np.errstate(invalid="ignore", over="ignore"):
                lost = np.abs(eye - product(inverse[rest], mids))
                lost += product(absolute[rest], ranges + rounding * np.abs(mids))
                image = off[rest] + np.einsum("nij,nj->ni", lost, trial)
                image *= 1 + rounding
                good = (image < trial).all(axis=1)
                again = off[rest] + np.einsum("nij,nj->ni", lost, image)
            proven[rest[good]] = True
            tight[rest[good]] = (again * (1 + rounding))[good]
            wide[rest[good]] = trial[good]
        return Tubes(proven, middle, lines, tight, wide)

    def _inner_forms(self, centres: Array, halves: Array) -> Array:
        count, k = centres.shape
        forms = np.zeros((k, k + 2, count))
        for j, axis in enumerate(self._inner):
            forms[j, 0] = self.lower[axis] + self.width[axis] * centres[:, j]
            forms[j, 1 + j] = self.width[axis] * halves[:, j]
            forms[j, -1] = 2 * EPS * (abs(self.lower[axis]) + self.width[axis])
        return forms

    def _forms(self, tape: Tape, centres: Array, halves: Array, tubes: Tubes) -> Array:
        """Return a tape's results over boxes of the inner coordinates alone."""
        count, k = centres.shape
        inputs = np.zeros((self._size + tubes.middle.shape[1], k + 2, count))
        inputs[self._inner] = self._inner_forms(centres, halves)
        inputs[self._size :, 0] = tubes.middle.T
        inputs[self._size :, 1:-1] = np.moveaxis(tubes.slopes, 0, 2)
        inputs[self._size :, -1] = tubes.tight.T
        return self.evaluate(tape, inputs)

    # -- boxes of poses ------------------------------------------------------------------

    def first(self) -> tuple[Array, Array, float]:
        """Return the cells connected with home, each with the whole range of the rest."""
        return (*self._cells_as_boxes(self._flooded | self._open), 1.0)

    def whole(self) -> Boxes:
        """Return boxes that hold all poses that are not proven out of reach."""
        return self._cells_as_boxes(self._flooded | self._open)

    def _cells_as_boxes(self, which: NDArray[np.bool_]) -> Boxes:
        shape = (int(which.sum()), self._size)
        centres, halves = np.full(shape, 0.5), np.full(shape, 0.5)
        centres[:, self._inner] = self._cell_centres[which]
        halves[:, self._inner] = self._cell_halves[which]
        return centres, halves

    def shares(self, centres: Array, halves: Array) -> tuple[Array, Array]:
        """Return proven bounds of the share of boxes that is reachable; see the base class."""
        inputs, proven = self._box_inputs(centres, halves)
        forms = self.evaluate(self._slacks, inputs)
        for k, low, high in self._cut:
            for end, sign in ((low, 1.0), (high, -1.0)):
                face = sign * inputs[k]
                face[0] -= sign * end
                face[-1] = inputs[k, -1] + EPS * np.abs(face[0])
                forms = np.concatenate([forms, face[None]])
        lower, upper = self.shares_of(np.ascontiguousarray(forms))
        return np.where(proven, lower, 0.0), np.where(proven, upper, 1.0)

    def jacobians(self, centres: Array, halves: Array) -> tuple[Array, Array]:
        """Return middles and ranges of the inverse Jacobian's entries; see the base class."""
        inputs, proven = self._box_inputs(centres, halves)
        middles, ranges = self.matrices(self.evaluate(self._entries, inputs), self.order)
        ranges[~proven] = np.inf
        return middles, ranges

    def _box_inputs(self, centres: Array, halves: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the forms of pose and unknowns over boxes within cells, and where proven."""
        inner = self._inner
        pairs = np.concatenate([centres[:, inner], halves[:, inner]], axis=1)
        pairs, which = np.unique(pairs, axis=0, return_inverse=True)
        which = which.reshape(-1)
        k = len(inner)
        flat, flat_halves = pairs[:, :k], pairs[:, k:]
        size = self._raster.shape[0]
        index = np.minimum((flat * size).astype(np.int64), size - 1)
        cells = self._raster[tuple(index.T)]
        place = (flat - self._cell_centres[cells]) / self._cell_halves[cells]
        tubes = self.tubes(flat, flat_halves, self._tubes.at(cells, place))
        proven = self._holds(tubes, np.arange(len(flat)), cells, flat) & self._flooded[cells]
        count = len(centres)
        m = tubes.middle.shape[1]
        inputs = np.zeros((self._size + m, self._size + 2, count))
        inputs[: self._size] = self.inputs(centres, halves)
        inputs[self._size :, 0] = tubes.middle[which].T
        for j, axis in enumerate(inner):
            inputs[self._size :, 1 + axis] = tubes.slopes[which, :, j].T
        inputs[self._size :, -1] = np.where(np.isfinite(tubes.tight), tubes.tight, 1e3)[which].T
        return inputs, proven[which]


def _pseudo(slopes: Array) -> Array:
    """Return inverses; 0 for what has none."""
    with np.errstate(all="ignore"):
        bad = ~(np.abs(determinant(slopes)) > 1e-30)
    usable = np.where(bad[:, None, None], np.eye(slopes.shape[1]), slopes)
    return np.asarray(np.where(bad[:, None, None], 0.0, inverse(usable)))

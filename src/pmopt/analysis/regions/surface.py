"""The boundary of a set on a grid as a closed quadrilateral mesh: naive surface nets."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Field = Callable[[Array], Array]
_Indices = Sequence[NDArray[np.intp]] | NDArray[np.intp]

#: Halvings of a grid edge to find where the boundary crosses it.
_HALVINGS = 12
#: Weight of a crossing on the box's faces. Where such a face meets the boundary within the box,
#: the vertex lies on the latter's crossings alone, so that the edge between them stays sharp.
_CAP_WEIGHT = 1e-6
#: Steps of a golden-section search between three grid points, and the share that each leaves.
_SECTIONS = 24
_GOLDEN = (5**0.5 - 1) / 2
#: How many times as steep as up to a point a field may go on to a peak behind it.
_STEEP = 3.0
#: A grid point moves to what is at most 1 - this share of a cell away.
_NEAR = 0.2


@dataclass(frozen=True)
class Net:
    """A closed mesh.

    Attributes
    ----------
    vertices : (V, 3) float64
    faces : (F, 4) intp
        Counter-clockwise as seen from outside.
    crossings : (F, 3) float64
        Where the boundary crosses the edge that gives each face, on the set's side: a face cuts
        corners between other pieces of the boundary, this point lies on it.
    """

    vertices: Array
    faces: NDArray[np.intp]
    crossings: Array


def surface_nets(field: Field, axes: Sequence[Array]) -> Net:
    """Return the boundary of a set, cut off at the box's faces.

    Each grid cell that the boundary passes through holds one vertex, the mean of the points where
    the boundary crosses the cell's edges; each crossed edge gives the quad of its four cells.
    Crossings are found by bisection: fields that are flat outside (LCI is 0 out of reach) mislead
    interpolation.

    Sheets of the set, and gaps in it, may be thinner than a cell and pass between the grid's
    points here and there: the surface would be torn. Where the field has an extreme of the other
    sign between points, the nearest one moves there.

    Parameters
    ----------
    field : callable
        Takes points (3, N), returns a number for each: >= 0 in the set; where it is continuous,
        thin parts are found.
    axes : three arrays
        Ascending grid coordinates of each axis.

    References
    ----------
    S. F. F. Gibson, "Constrained elastic surface nets", MICCAI 1998.
    """
    grid = _Grid(axes)
    shape = tuple(len(axis) for axis in axes)
    values = field(np.stack([m.ravel() for m in np.meshgrid(*axes, indexing="ij")])).reshape(shape)
    _catch_thin(field, grid, values)
    # A rim of no width that lies outside closes the set exactly at the box's faces.
    members = np.pad(values >= 0, 1)
    cells = tuple(n - 1 for n in members.shape)
    rings, crossings, weights = [], [], []
    for axis in range(3):
        below = np.take(members, range(cells[axis]), axis)
        where = np.nonzero(below != np.take(members, range(1, cells[axis] + 1), axis))
        entered = below[where]
        low = grid.points(where)
        high = grid.points(tuple(w + (k == axis) for k, w in enumerate(where)))
        rim = (where[axis] == 0) | (where[axis] == cells[axis] - 1)
        weights.append(np.where(rim, _CAP_WEIGHT, 1.0))
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            beyond = (field(middle) >= 0) != entered
            low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
        # Of the two ends the one in the set: its values are never those of the outside.
        crossings.append(np.where(entered, low, high).T)
        # The four cells around the edge, counter-clockwise as seen from its upper end.
        ring = []
        for first, second in ((1, 1), (0, 1), (0, 0), (1, 0)):
            cell = list(where)
            cell[(axis + 1) % 3] = cell[(axis + 1) % 3] - first
            cell[(axis + 2) % 3] = cell[(axis + 2) % 3] - second
            ring.append(np.ravel_multi_index(cell, cells))
        quads = np.stack(ring, axis=1)
        rings.append(np.where(entered[:, None], quads, quads[:, ::-1]))
    _, faces = np.unique(np.concatenate(rings), return_inverse=True)
    faces = faces.reshape(-1, 4)
    weight = np.repeat(np.concatenate(weights), 4)
    total = np.bincount(faces.ravel(), weight)
    points = np.concatenate(crossings)
    sums = [np.bincount(faces.ravel(), weight * np.repeat(points[:, k], 4)) for k in range(3)]
    return Net(np.stack(sums, axis=1) / total[:, None], faces, points)


class _Grid:
    """A grid with a rim of no width, some of whose points are moved."""

    def __init__(self, axes: Sequence[Array]) -> None:
        self.axes = [np.pad(axis, 1, mode="edge") for axis in axes]
        self._shape = tuple(len(axis) for axis in self.axes)
        self._row = np.full(self._shape, -1, dtype=np.int32)
        self._moved = np.empty((3, 0))

    def points(self, where: _Indices) -> Array:
        """Return the points (3, N) of three arrays of indices, which count the rim."""
        points = np.stack([axis[i] for axis, i in zip(self.axes, where, strict=True)])
        # A point of the rim lies on the grid's own.
        own = [np.clip(i, 1, n - 2) for i, n in zip(where, self._shape, strict=True)]
        row = self._row[tuple(own)]
        points[:, row >= 0] = self._moved[:, row[row >= 0]]
        return points

    def move(self, where: _Indices, points: Array) -> None:
        """Move points of the grid."""
        start = self._moved.shape[1]
        self._row[tuple(where)] = np.arange(start, start + points.shape[1])
        self._moved = np.concatenate([self._moved, points], axis=1)

    def near_moved(self, where: _Indices) -> NDArray[np.bool_]:
        """Return which points or neighbours of theirs along an axis have moved."""
        near = self._row[tuple(where)] >= 0
        for axis, step in itertools.product(range(3), (-1, 1)):
            other = [w + step * (k == axis) for k, w in enumerate(where)]
            near |= self._row[tuple(other)] >= 0
        return np.asarray(near)


def _catch_thin(field: Field, grid: _Grid, values: Array) -> None:
    """Move points to where the field has an extreme of the other sign.

    Parameters
    ----------
    values : (nx, ny, nz) float64
        The field at the grid's points; kept true.
    """
    sides = [
        [_thin_along(field, grid, values, axis, inside) for axis in range(3)]
        for inside in (False, True)
    ]
    for found in sides:
        where, points, heights, rise = (
            np.concatenate(part, axis=-1) for part in zip(*found, strict=True)
        )
        # Gaps have been searched for between points as they were.
        kept = ~grid.near_moved(where)
        # Of several moves of a point the one along which the field is steepest: across the part.
        order = np.flatnonzero(kept)[np.argsort(-rise[kept], kind="stable")]
        flat = np.ravel_multi_index(tuple(where[:, order] - 1), values.shape)
        order = order[np.unique(flat, return_index=True)[1]]
        grid.move(where[:, order], points[:, order])
        values[tuple(where[:, order] - 1)] = heights[order]


def _thin_along(
    field: Field, grid: _Grid, values: Array, axis: int, inside: bool
) -> tuple[NDArray[np.intp], Array, Array, Array]:
    """Return points and where to move them along one axis, and how steep the field is there.

    Returns
    -------
    where : (3, K) intp
        In the grid with its rim.
    points : (3, K) float64
    heights, rise : (K,) float64
        What the field is there, negative in gaps, and how it differs from the points beside.
    """
    count = values.shape[axis]
    height = -values if inside else values
    low, here, high = (
        np.take(height, range(first, max(count - 2 + first, first)), axis) for first in range(3)
    )
    # A thin part holds at most one point of the line; 0 is in the set, and in no gap of it.
    alone = ((low <= 0) & (high <= 0)) if inside else ((low < 0) & (high < 0))
    rise = here - np.minimum(low, high)
    top = alone & (here >= low) & (here >= high) & (rise > 0) & (here + _STEEP * rise >= 0)
    tops = np.stack(np.nonzero(top)) + 1
    moves = []
    for further in (0, 1):  # on either side of the top, where there may be one part each
        lower = tops.copy()
        lower[axis] += further
        points = np.stack([a[i] for a, i in zip(grid.axes, lower, strict=True)])
        width = grid.axes[axis][lower[axis] + 1] - points[axis]

        def at(share: Array, points: Array = points, width: Array = width) -> Array:
            moved = points.copy()
            moved[axis] += share * width
            return -field(moved) if inside else field(moved)

        share, best = _highest(at, lower.shape[1])
        points[axis] += share * width
        # The nearest point moves, between two both do, so that the sheet hangs together where it
        # goes on between others; none on the box's faces leaves them.
        for end, near in ((0, share <= 1 - _NEAR), (1, share >= _NEAR)):
            where = lower.copy()
            where[axis] = np.clip(lower[axis] + end, 2, count - 1)
            kept = near & (best > 0) & ((values[tuple(where - 1)] >= 0) == inside)
            moves.append(
                (where[:, kept], points[:, kept], (-best if inside else best)[kept],
                 rise[top][kept])
            )  # fmt: skip
    parts = [np.concatenate(part, axis=-1) for part in zip(*moves, strict=True)]
    return parts[0], parts[1], parts[2], parts[3]


def _highest(height: Field, count: int) -> tuple[Array, Array]:
    """Return where in [0, 1] functions are highest, and how high, by golden sections."""
    start, end = np.zeros(count), np.ones(count)
    first, second = np.full(count, 1 - _GOLDEN), np.full(count, _GOLDEN)
    low, high = height(first), height(second)
    for _ in range(_SECTIONS):
        left = low >= high
        start, end = np.where(left, start, first), np.where(left, second, end)
        step = _GOLDEN * (end - start)
        fresh = np.where(left, end - step, start + step)
        value = height(fresh)
        first, second = np.where(left, fresh, second), np.where(left, first, fresh)
        low, high = np.where(left, value, high), np.where(left, low, value)
    return np.where(low >= high, first, second), np.maximum(low, high)

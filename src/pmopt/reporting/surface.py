"""The boundary of a set on a grid as a closed quadrilateral mesh: naive surface nets."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

#: Halvings of a grid edge to find where the boundary crosses it.
_HALVINGS = 12
#: Weight of a crossing on the box's faces. Where such a face meets the boundary within the box,
#: the vertex lies on the latter's crossings alone, so that the edge between them stays sharp.
_CAP_WEIGHT = 1e-6


def surface_nets(
    contains: Callable[[NDArray[np.float64]], NDArray[np.bool_]],
    axes: Sequence[NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.float64]]:
    """Return the boundary of a set, cut off at the box's faces.

    Each grid cell that the boundary passes through holds one vertex, the mean of the points where
    the boundary crosses the cell's edges; each crossed edge gives the quad of its four cells.
    Crossings are found by bisection: fields that are flat outside (LCI is 0 out of reach) mislead
    interpolation.

    Parameters
    ----------
    contains : callable
        Takes points (3, N), returns which are in the set.
    axes : three arrays
        Ascending grid coordinates of each axis.

    Returns
    -------
    vertices : (V, 3) float64
    faces : (F, 4) intp
        Counter-clockwise as seen from outside.
    crossings : (F, 3) float64
        Where the boundary crosses the edge that gives each face: a face cuts corners between
        other pieces of the boundary, this point lies on it.

    References
    ----------
    S. F. F. Gibson, "Constrained elastic surface nets", MICCAI 1998.
    """
    points = np.stack([m.ravel() for m in np.meshgrid(*axes, indexing="ij")])
    # A rim of no width that lies outside closes the set exactly at the box's faces.
    members = np.pad(contains(points).reshape([len(axis) for axis in axes]), 1)
    grid = [np.pad(axis, 1, mode="edge") for axis in axes]
    cells = tuple(n - 1 for n in members.shape)
    rings, crossings, weights = [], [], []
    for axis in range(3):
        below = np.take(members, range(cells[axis]), axis)
        where = np.nonzero(below != np.take(members, range(1, cells[axis] + 1), axis))
        entered = below[where]
        low = np.stack([grid[k][where[k]] for k in range(3)])
        high = low.copy()
        high[axis] = grid[axis][where[axis] + 1]
        weights.append(np.where(high[axis] > low[axis], 1.0, _CAP_WEIGHT))
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            beyond = contains(middle) != entered
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
    return np.stack(sums, axis=1) / total[:, None], faces, points

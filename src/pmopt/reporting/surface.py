"""The boundary of {field >= 0} on a grid as a closed quadrilateral mesh (naive surface nets)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

#: Weight of a crossing on the grid's outermost faces. Where a face of the box meets the surface,
#: the vertex lies on the surface's own crossings, so that the edge between them stays sharp.
_CAP_WEIGHT = 1e-6


def surface_nets(
    values: NDArray[np.float64], axes: Sequence[NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return vertices (V, 3) and outward quads (F, 4) of the set where the field is >= 0.

    Each grid cell that the surface passes through holds one vertex, the mean of the points where
    the field, linear along each edge of the cell, is 0; each grid edge that the surface crosses
    gives the quad of its four cells. The set is cut off at the box's faces.

    Parameters
    ----------
    values : (nx, ny, nz) float64
        Finite samples of a continuous field.
    axes : three arrays
        Ascending grid coordinates of each axis.

    References
    ----------
    S. F. F. Gibson, "Constrained elastic surface nets", MICCAI 1998.
    """
    # A rim of no width that lies outside closes the set exactly at the box's faces.
    field = np.pad(values, 1, constant_values=-1.0)
    grid = [np.pad(axis, 1, mode="edge") for axis in axes]
    cells = tuple(n - 1 for n in field.shape)
    rings, points, weights = [], [], []
    for axis in range(3):
        low = np.take(field, range(cells[axis]), axis)
        high = np.take(field, range(1, cells[axis] + 1), axis)
        where = np.nonzero((low >= 0) != (high >= 0))
        before, after = low[where], high[where]
        crossing = np.stack([grid[k][where[k]] for k in range(3)], axis=1)
        step = np.diff(grid[axis])[where[axis]]
        crossing[:, axis] += before / (before - after) * step
        # The four cells around the edge, counter-clockwise as seen from its upper end.
        ring = []
        for first, second in ((1, 1), (0, 1), (0, 0), (1, 0)):
            cell = list(where)
            cell[(axis + 1) % 3] = cell[(axis + 1) % 3] - first
            cell[(axis + 2) % 3] = cell[(axis + 2) % 3] - second
            ring.append(np.ravel_multi_index(tuple(cell), cells))
        quads = np.stack(ring, axis=1)
        rings.append(np.where((before >= 0)[:, None], quads, quads[:, ::-1]))
        points.append(crossing)
        weights.append(np.where(step > 0, 1.0, _CAP_WEIGHT))
    quads = np.concatenate(rings)
    ids, corners = np.unique(quads, return_inverse=True)
    corners = corners.reshape(-1, 4)
    weight = np.repeat(np.concatenate(weights), 4)
    point = np.repeat(np.concatenate(points), 4, axis=0)
    sums = [np.bincount(corners.ravel(), weight * point[:, k], len(ids)) for k in range(3)]
    total = np.bincount(corners.ravel(), weight, len(ids))
    return np.stack(sums, axis=1) / total[:, None], corners

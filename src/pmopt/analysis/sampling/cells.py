"""Sets of cells and outlines of points, by compiled counting."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from pmopt.compiler import programs


def lattice_points(axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return all points of a lattice, the last coordinate fastest.

    Parameters
    ----------
    axes : (d, n) float64
        Coordinates along each axis.

    Returns
    -------
    (d, n**d) float64
    """
    dimension, count = axes.shape
    points = np.empty((dimension, count**dimension))
    programs.counting().lattice(np.ascontiguousarray(axes), count, points)
    return points


def label(members: NDArray[np.bool_], diagonal: bool = False) -> tuple[NDArray[np.int32], int]:
    """Number the connected pieces of a set of cells in the order of their first cells.

    Parameters
    ----------
    members : (..) bool
    diagonal : bool
        Whether sharing an edge or a corner connects cells, not only sharing a face.

    Returns
    -------
    labels : (..) int32
        From 1; 0 outside of the set.
    count : int
    """
    padded = np.zeros([n + 2 for n in members.shape], dtype=np.uint8)
    inner = (slice(1, -1),) * members.ndim
    padded[inner] = members
    # Rows along the last axis, and how far before each lie those that touch it.
    rows = padded.reshape(-1, padded.shape[-1])
    strides = np.array(padded.strides[:-1], dtype=np.int64) // padded.shape[-1]
    steps = np.array(list(itertools.product((-1, 0, 1), repeat=members.ndim - 1)), dtype=np.int64)
    sizes = np.abs(steps).sum(axis=1)
    back = steps[(sizes > 0) & (diagonal | (sizes == 1))] @ strides
    labels = np.zeros(padded.shape, dtype=np.int32)
    runs = np.empty((rows.size // 2 + 1, 3), dtype=np.int64)
    begins = np.empty(len(rows) + 1, dtype=np.int64)
    count = np.zeros(1, dtype=np.int64)
    programs.counting().label_runs(
        rows, back[back < 0], int(diagonal), labels.reshape(rows.shape), runs, begins, count
    )
    return labels[inner], int(count[0])


def hull(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners of the convex hull of points in the plane, counter-clockwise.

    Fewer than three where the points span no area.

    Parameters
    ----------
    points : (N, 2) float64
    """
    ordered = points[np.lexsort(points.T[::-1])]
    fresh = np.ones(len(ordered), dtype=bool)  # np.unique imports masked arrays: 10 ms
    fresh[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    ordered = ordered[fresh]
    corners = np.empty(2 * len(ordered) + 2, dtype=np.int64)
    count = np.zeros(1, dtype=np.int64)
    programs.counting().chain(ordered, corners, count)
    return ordered[corners[: count[0]]]

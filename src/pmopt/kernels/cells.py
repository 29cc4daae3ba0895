"""Sets of cells and outlines of points: the counting behind shapes, compiled.

The functions from :func:`lattice` on are kernel text as in :mod:`pmopt.kernels.sweep`: they
allocate nothing and never raise. The first ones prepare their arrays.
"""

from __future__ import annotations

import functools
import inspect
import itertools

import numpy as np
from numpy.typing import NDArray

from pmopt.compiler.machine_code import Compiled, Entry

ENTRIES = (
    Entry("lattice", ("float64[:,:]", "int64", "float64[:,:]")),
    Entry("label_runs", (
        "uint8[:,:]", "int64[:]", "int64", "int32[:,:]", "int64[:,:]", "int64[:]", "int64[:]",
    )),
    Entry("chain", ("float64[:,:]", "int64[:]", "int64[:]")),
)  # fmt: skip


@functools.cache
def kernels() -> Compiled:
    """Return the compiled functions of this module."""
    functions = (lattice, label_runs, chain)
    text = "".join(f"@njit\n{inspect.getsource(f)}\n\n" for f in functions)
    return Compiled(f"import numpy as np\nfrom numba import njit\n\n\n{text}", ENTRIES)


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
    kernels().lattice(np.ascontiguousarray(axes), count, points)
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
    kernels().label_runs(
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
    kernels().chain(ordered, corners, count)
    return ordered[corners[: count[0]]]


def lattice(axes, count, points):  # type: ignore[no-untyped-def]
    """Write the points of :func:`lattice_points`."""
    dimension = axes.shape[0]
    total = points.shape[1]
    repeat = total
    for d in range(dimension):
        repeat //= count
        row = points[d]
        i = 0
        while i < total:
            for k in range(count):
                value = axes[d, k]
                for j in range(i, i + repeat):
                    row[j] = value
                i += repeat


def label_runs(rows, back, reach, labels, runs, begins, count):  # type: ignore[no-untyped-def]
    """Number the pieces of a set with a border of cells that do not belong to it.

    Runs of a row (first cell, one past the last, a run of the same piece) are joined with those of
    the rows before it that they touch; the earliest run stands for its piece.
    """
    found = 0
    for row in range(rows.shape[0]):
        begins[row] = found
        inside = False
        for i in range(rows.shape[1]):
            if (rows[row, i] != 0) != inside:
                inside = not inside
                if inside:
                    runs[found, 0] = i
                    runs[found, 2] = found
                else:
                    runs[found, 1] = i
                    found += 1
        begins[row + 1] = found
        if begins[row] == found:
            continue
        for k in range(back.shape[0]):
            other = row + back[k]
            here = begins[row]
            there = begins[other]
            while here < found and there < begins[other + 1]:
                if (
                    runs[here, 0] < runs[there, 1] + reach
                    and runs[there, 0] < runs[here, 1] + reach
                ):
                    a = here
                    while runs[a, 2] != a:
                        runs[a, 2] = runs[runs[a, 2], 2]
                        a = runs[a, 2]
                    b = there
                    while runs[b, 2] != b:
                        runs[b, 2] = runs[runs[b, 2], 2]
                        b = runs[b, 2]
                    runs[max(a, b), 2] = min(a, b)
                if runs[here, 1] < runs[there, 1]:
                    here += 1
                else:
                    there += 1
    pieces = 0
    for run in range(found):
        first = runs[run, 2]
        if first == run:
            pieces += 1
            runs[run, 2] = pieces
        else:  # an earlier run, which has its number
            runs[run, 2] = runs[first, 2]
    for row in range(rows.shape[0]):
        for run in range(begins[row], begins[row + 1]):
            for i in range(runs[run, 0], runs[run, 1]):
                labels[row, i] = runs[run, 2]
    count[0] = pieces


def chain(points, corners, count):  # type: ignore[no-untyped-def]
    """Write the places of a hull's corners among points in ascending order (Andrew 1979)."""
    size = points.shape[0]
    height = 0
    for turn in range(2):
        start = height
        for k in range(size):
            i = k if turn == 0 else size - 1 - k
            while height - start >= 2:
                a = corners[height - 2]
                b = corners[height - 1]
                across = (points[b, 0] - points[a, 0]) * (points[i, 1] - points[a, 1]) - (
                    points[b, 1] - points[a, 1]
                ) * (points[i, 0] - points[a, 0])
                if across > 0.0:
                    break
                height -= 1
            corners[height] = i
            height += 1
        height -= 1  # the last corner of a chain is the first one of the other
    count[0] = height

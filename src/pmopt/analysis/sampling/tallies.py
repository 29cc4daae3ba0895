"""Sums over sample points, and the chunks and blocks of points in which they are made."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.errors import InputError
from pmopt.kernels import sweep
from pmopt.numerics import sequences

#: Bins of the LCI histogram; see :func:`pmopt.kernels.sweep.bin_of`.
BINS = sweep.BINS
#: Points of one chunk, all replicates together: some milliseconds of work.
CHUNK = 1 << 18
#: Chunks of one block: what is summed by itself and may be kept, or computed elsewhere.
BLOCK_CHUNKS = 16

#: Called with the points of a replicate done so far.
Done = Callable[[int], None]


@dataclass
class Tallies:
    """Sums over sample points, the leading axes designs (where there are several) and replicates.

    Attributes
    ----------
    points : int
        Points of each replicate.
    box : (...,) float
        Box volume of each design.
    reachable, within, hits, total, smallest, largest, margin : (..., R)
        See the columns of :mod:`pmopt.kernels.sweep`. Points on lines count with their weights,
        but for ``hits``.
    above : (..., R, e) float64
        Points with an index of at least each inner region edge.
    histogram : (..., R, BINS) float64
    """

    points: int
    box: NDArray[np.float64]
    reachable: NDArray[np.float64]
    within: NDArray[np.float64]
    hits: NDArray[np.float64]
    total: NDArray[np.float64]
    smallest: NDArray[np.float64]
    largest: NDArray[np.float64]
    margin: NDArray[np.float64]
    above: NDArray[np.float64]
    histogram: NDArray[np.float64]

    def add(self, other: Tallies) -> None:
        """Add the tallies of further points; the order of additions fixes the last digits."""
        self.points += other.points
        self.reachable += other.reachable
        self.within += other.within
        self.hits += other.hits
        self.total += other.total
        np.minimum(self.smallest, other.smallest, out=self.smallest)
        np.maximum(self.largest, other.largest, out=self.largest)
        np.maximum(self.margin, other.margin, out=self.margin)
        self.above += other.above
        self.histogram += other.histogram


def chunk_ranges(first: int, last: int, replicates: int) -> Iterator[tuple[int, int]]:
    """Split a range of point indices at fixed multiples, whatever the number of threads."""
    return _split(first, last, _chunk_length(replicates))


def block_ranges(first: int, last: int, replicates: int) -> Iterator[tuple[int, int]]:
    """Split a range of point indices into blocks of whole chunks, at fixed multiples."""
    return _split(first, last, block_length(replicates))


def block_length(replicates: int) -> int:
    """Return the points of each replicate in a whole block."""
    return BLOCK_CHUNKS * _chunk_length(replicates)


def _chunk_length(replicates: int) -> int:
    return max(sequences.BLOCK, CHUNK // replicates // sequences.BLOCK * sequences.BLOCK)


def _split(first: int, last: int, length: int) -> Iterator[tuple[int, int]]:
    start = first
    while start < last:
        stop = min(last, (start // length + 1) * length)
        yield start, stop
        start = stop


def check_grid(cells: int, dimension: int) -> None:
    """Refuse a grid with more points than an index can count.

    Raises
    ------
    InputError
    """
    if cells**dimension >= 1 << 53:
        raise InputError(f"grid: {cells} cells an axis in {dimension} dimensions are too many")

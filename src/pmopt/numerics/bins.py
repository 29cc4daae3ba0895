"""Bins of the conditioning index, for NumPy: what :func:`pmopt.kernels.sweep.bin_of` counts in."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from pmopt.kernels.sweep import (
    BINS,
    COARSE_BASE,
    COARSE_SHIFT,
    FINE_BASE,
    FINE_SHIFT,
    LAST_BIN,
)


@functools.cache
def bin_edges() -> NDArray[np.float64]:
    """Return the edges of the bins, (BINS + 1,): bin k holds what is in [edge k, edge k + 1).

    The last bin holds its upper edge, 1, too.
    """
    k = np.arange(1, BINS + 1, dtype=np.int64)
    coarse, fine = k + COARSE_BASE << COARSE_SHIFT, k + FINE_BASE << FINE_SHIFT
    edges = np.concatenate([[0.0], np.minimum(coarse, fine).view(np.float64)])
    edges.flags.writeable = False  # it is shared
    return edges


def bins_of(lci: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the bin of each index."""
    bits = np.ascontiguousarray(lci, dtype=np.float64).view(np.int64)
    fine, coarse = (bits >> FINE_SHIFT) - FINE_BASE, (bits >> COARSE_SHIFT) - COARSE_BASE
    return np.asarray(np.clip(np.maximum(fine, coarse), 0, LAST_BIN))

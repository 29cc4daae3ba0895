"""Newton's method from many starts at once, for systems without a closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Takes points (N, n), returns residuals (N, n) and their derivatives (N, n, n).
System = Callable[[Array], tuple[Array, Array]]


def newton(system: System, starts: Array, steps: int = 40, largest: Array | None = None) -> Array:
    """Return where Newton's method ends from each start, NaN where it leaves the numbers.

    Parameters
    ----------
    system : callable
    starts : (N, n) float64
    steps : int
    largest : (n,) float64, optional
        Longest step of each unknown; a longer one is shortened as a whole.
    """
    x = np.array(starts, dtype=float)
    for _ in range(steps):
        residual, slope = system(x)
        finite = np.isfinite(residual).all(axis=1) & np.isfinite(slope).all(axis=(1, 2))
        bad = np.asarray(~finite)
        bad |= np.linalg.det(np.where(bad[:, None, None], np.eye(x.shape[1]), slope)) == 0.0
        x[bad] = np.nan
        slope = np.where(bad[:, None, None], np.eye(x.shape[1]), slope)
        step = np.linalg.solve(slope, np.where(bad[:, None], 0.0, residual)[:, :, None])[:, :, 0]
        if largest is not None:
            ratio = np.abs(step / largest).max(axis=1, keepdims=True)
            step = step / np.maximum(ratio, 1.0)
        x = x - step
    return x


def distinct(points: Array, tolerance: Array | float) -> Array:
    """Return the points, without NaN, that differ by more than the tolerance, in order."""
    kept: list[Array] = []
    for point in points[np.isfinite(points).all(axis=1)]:
        if not any((np.abs(point - other) <= tolerance).all() for other in kept):
            kept.append(point)
    return np.array(kept).reshape(-1, points.shape[1])

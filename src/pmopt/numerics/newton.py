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


#: A root where the slope's singular values are further apart is taken for a multiple one, which
#: Newton's method approaches linearly: what differs less from it than the wide gap is the same.
_MULTIPLE = 1e-3
_GAP, _WIDE_GAP = 1e-6, 2e-2


def real_roots(
    system: System,
    starts: Array,
    accepted: Array | float,
    largest: Array | None = None,
    normalise: Callable[[Array], Array] | None = None,
) -> Array:
    """Return the different roots found from the starts, (N, n), each once.

    Parameters
    ----------
    system, starts, largest
        See :func:`newton`.
    accepted : (n,) float64 or float
        Largest residual of each equation at a root.
    normalise : callable, optional
        Brings points that are the same into one form, e.g. angles into one range.
    """
    ends = newton(system, starts, largest=largest)
    ends = ends[np.isfinite(ends).all(axis=1)]
    residual, slope = system(ends)
    good = (np.abs(residual) <= accepted).all(axis=1)
    ends, residual, slope = ends[good], residual[good], slope[good]
    values = np.linalg.svd(slope, compute_uv=False)
    gaps = np.where(values[:, -1] < _MULTIPLE * values[:, 0], _WIDE_GAP, _GAP)
    if normalise is not None:
        ends = normalise(ends)
    kept: list[tuple[Array, float]] = []
    # Residuals of one size differ by chance alone: the order of the starts breaks the tie.
    for i in np.argsort(np.floor(np.log10((residual**2).sum(axis=1) + 1e-300)), kind="stable"):
        around = [np.abs(np.remainder(ends[i] - other + np.pi, 2 * np.pi) - np.pi)
                  if normalise is not None else np.abs(ends[i] - other)
                  for other, _ in kept]  # fmt: skip
        if not any(
            (a <= max(gaps[i], gap)).all() for a, (_, gap) in zip(around, kept, strict=True)
        ):
            kept.append((ends[i], float(gaps[i])))
    return np.array([point for point, _ in kept]).reshape(-1, starts.shape[1])

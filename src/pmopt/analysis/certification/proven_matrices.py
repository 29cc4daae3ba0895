"""Proven bounds of the conditioning index of matrices whose entries range, and their signs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmopt.kernels.affine_forms import EPS
from pmopt.numerics.matrices import decomposed, determinant, inverse, product

Array = NDArray[np.float64]
#: Backward error of a determinant up to order 6: n^3 EPS times a growth of at most 2^(n - 1).
_BACKWARD = 1e-11


def index_bounds(middles: Array, ranges: Array, norm: str) -> tuple[Array, Array]:
    """Return proven bounds of the conditioning index of matrices.

    Parameters
    ----------
    middles, ranges : (N, n, n) float64
        Entries and how far each may be off.
    norm : {"2", "fro"}

    Returns
    -------
    lower, upper : (N,) float64
        NaN where the entries are not finite.

    Notes
    -----
    What the decomposition gives is checked, not trusted: of M = U S V^T + R singular values differ
    by at most |R|_F, and those of U S V^T from S by factors that |U^T U - I|_F and |V^T V - I|_F
    bound (both norms rounded up). The range adds at most its Frobenius norm (Weyl).
    """
    size = middles.shape[1]
    good = np.isfinite(middles).all(axis=(1, 2)) & np.isfinite(ranges).all(axis=(1, 2))
    lower, upper = np.full(len(middles), np.nan), np.full(len(middles), np.nan)
    middle, reach = middles[good], ranges[good]
    left, values, right = decomposed(middle)
    norms = np.sqrt((middle**2).sum(axis=(1, 2)))
    # Products of n terms of unit rows and columns: n + 2 roundings of size EPS / 2 and spare.
    rounding = 4 * size * (size + 2) * EPS
    rest = middle - product(left * values[:, None, :], right)
    off = np.sqrt((rest**2).sum(axis=(1, 2))) + rounding * norms
    eye = np.eye(size)
    tilt = np.zeros(len(middle))
    for factor in (left, np.swapaxes(right, 1, 2)):
        defect = product(np.swapaxes(factor, 1, 2), factor) - eye
        tilt += np.sqrt((defect**2).sum(axis=(1, 2))) + rounding
    off += np.sqrt((reach**2).sum(axis=(1, 2))) * (1 + rounding)
    off = (off + 2 * tilt * values[:, 0]) * (1 + rounding)
    least, most = np.maximum(values - off[:, None], 0.0), values + off[:, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if norm == "2":
            below, above = least[:, -1] / most[:, 0], most[:, -1] / least[:, 0]
        else:
            below = 1 / np.sqrt((most**2).sum(axis=1) * (1 / least**2).sum(axis=1))
            above = 1 / np.sqrt((least**2).sum(axis=1) * (1 / most**2).sum(axis=1))
    lower[good] = np.where(least[:, -1] > 0, below * (1 - rounding), 0.0)
    upper[good] = np.where(np.isnan(above), 1.0, np.minimum(above * (1 + rounding), 1.0))
    return lower, upper


def regular(middles: Array, ranges: Array) -> NDArray[np.bool_]:
    """Return which matrices are proven regular, whatever their entries within the ranges.

    With Y near the inverse of the middle, |I - Y M| < 1 row by row (Krawczyk); that Y is regular
    follows.
    """
    size = middles.shape[1]
    good = np.isfinite(middles).all(axis=(1, 2)) & np.isfinite(ranges).all(axis=(1, 2))
    middle, reach = middles[good], ranges[good]
    scale = np.abs(middle).max(axis=(1, 2))
    scale = np.where(scale > 0, scale, 1.0)[:, None, None]
    near = _inverses(middle / scale) / scale
    found = np.zeros(len(middles), dtype=bool)
    absolute = np.abs(near)
    rounding = 4 * (size + 2) * EPS
    with np.errstate(invalid="ignore", over="ignore"):
        rest = np.abs(np.eye(size) - product(near, middle))
        rest += rounding * product(absolute, np.abs(middle))
        rest += product(absolute, reach)
        found[good] = (rest.sum(axis=2) * (1 + rounding) + rounding < 1).all(axis=1)
    return found


def _inverses(matrices: Array) -> Array:
    """Return the inverses, 0 of what is singular to rounding."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        bad = ~(np.abs(determinant(matrices)) > 0)
    usable = np.where(bad[:, None, None], np.eye(matrices.shape[1]), matrices)
    return np.asarray(np.where(bad[:, None, None], 0.0, inverse(usable)))


def proven_signs(middles: Array, ranges: Array) -> NDArray[np.int64]:
    """Return the signs of the determinants of matrices, 0 where none is proven.

    Elimination with pivoting gives the determinant of a matrix that differs in each entry
    by less than _BACKWARD times the greatest (Higham): it has the sign of all that are proven
    regular together with it.
    """
    with np.errstate(invalid="ignore"):
        off = _BACKWARD * np.abs(middles).max(axis=(1, 2), keepdims=True)
        good = regular(middles, ranges + off)
    scale = np.where(good, np.abs(middles).max(axis=(1, 2)), 1.0)
    usable = np.where(good[:, None, None], middles / scale[:, None, None], 0.0)
    return np.asarray(np.sign(determinant(usable))).astype(np.int64)

"""Linear algebra of small matrices that gives the same bits on every processor.

BLAS and LAPACK choose their code, and with it the order of sums, by the processor. Here every
element is a fixed sequence of additions, multiplications, divisions and square roots. All functions
take stacks of matrices, (.., n, m), and treat each by itself: what else is in a stack changes
nothing.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Values = NDArray[np.float64]

#: Cosine of two columns, or share of an off-diagonal element in its diagonal ones, below which they
#: are not turned; most sweeps of Jacobi rotations.
_STILL = 1e-15
_MOST_SWEEPS = 30


def product(first: ArrayLike, second: ArrayLike) -> Values:
    """Return ``first @ second``: matrices, stacks of them, or vectors as ``@`` takes them.

    What is not finite goes on without a warning.
    """
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    row, column = a.ndim == 1, b.ndim == 1
    a, b = (a[None, :] if row else a), (b[:, None] if column else b)
    with np.errstate(invalid="ignore", over="ignore"):
        total: Values = a[..., :, :1] * b[..., :1, :]
        for k in range(1, a.shape[-1]):
            total = total + a[..., :, k : k + 1] * b[..., k : k + 1, :]
    if column:
        total = total[..., 0]
    if row:
        total = total[..., 0] if column else total[..., 0, :]
    return total[()]  # a number of two vectors


def dot(first: Values, second: Values) -> float:
    """Return the scalar product of two vectors."""
    return float(np.asarray(first * second, dtype=np.float64).sum())


def norm_of(vector: Values) -> float:
    """Return the Euclidean length of a vector."""
    return float(np.sqrt(dot(vector, vector)))


def _flat(stack: Values) -> Values:
    """Return a stack of matrices, maybe none, along one axis."""
    return stack.reshape(math.prod(stack.shape[:-2]), *stack.shape[-2:])


def _eliminated(matrices: Values, right: Values) -> tuple[Values, Values, Values]:
    """Return triangular matrices, what stands beside them and the signs of the row exchanges."""
    a, b = matrices.copy(), right.copy()
    count, n = a.shape[0], a.shape[1]
    at = np.arange(count)
    sign = np.ones(count)
    parts = (a, b) if b.shape[2] else (a,)
    for k in range(n - 1):
        pivot = k + np.argmax(np.abs(a[:, k:, k]), axis=1)
        sign = np.where(pivot != k, -sign, sign)
        for part in parts:
            part[at, k], part[at, pivot] = part[at, pivot], part[at, k]
        factor = a[:, k + 1 :, k] / np.where(a[:, k, k] == 0, 1.0, a[:, k, k])[:, None]
        for part in parts:
            part[:, k + 1 :] -= factor[:, :, None] * part[:, k : k + 1]
    return a, b, sign


def determinant(matrices: Values) -> Values:
    """Return the determinants, by elimination with row exchanges."""
    given = np.asarray(matrices, dtype=np.float64)
    flat = _flat(given)
    with np.errstate(invalid="ignore", over="ignore"):
        a, _, found = _eliminated(flat, np.empty((*flat.shape[:2], 0)))
        for k in range(flat.shape[1]):
            found = found * a[:, k, k]
    return found.reshape(given.shape[:-2])


def solve(matrices: Values, right: Values) -> Values:
    """Return ``matrices**-1 @ right``, (.., n, m); not finite where a matrix is singular."""
    given = np.asarray(matrices, dtype=np.float64)
    flat = _flat(given)
    sides = np.broadcast_to(right, (*given.shape[:-1], np.shape(right)[-1]))
    n = flat.shape[1]
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        a, b, _ = _eliminated(flat, _flat(sides).astype(np.float64))
        for k in reversed(range(n)):
            b[:, k] /= a[:, k, k, None]
            b[:, :k] -= a[:, :k, k, None] * b[:, k : k + 1]
    return b.reshape(sides.shape)


def inverse(matrices: Values) -> Values:
    """Return the inverses; not finite where a matrix is singular."""
    return solve(matrices, np.eye(np.shape(matrices)[-1]))


def _turn(pp: Values, qq: Values, pq: Values, far: NDArray[np.bool_]) -> tuple[Values, Values]:
    """Return cosine and sine of the rotation that makes pq 0, that of no turn where not far."""
    gap, twice = qq - pp, 2.0 * pq
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        t = twice / (np.abs(gap) + np.sqrt(gap * gap + twice * twice))
    t = np.where(far, np.where(gap >= 0, t, -t), 0.0)
    c = 1.0 / np.sqrt(1.0 + t * t)
    return c, c * t


def decomposed(matrices: Values) -> tuple[Values, Values, Values]:
    """Return the singular value decomposition of finite matrices (N, m, n).

    One-sided Jacobi rotations (Hestenes 1958): small singular values keep their digits too.

    Returns
    -------
    left : (N, m, k), k = min(m, n)
    values : (N, k)
        Descending.
    right : (N, k, n), or (N, n, n) where m >= n
        Rows are the right singular vectors. Of matrices that are not square, columns of ``left``
        are 0 where the value is 0.
    """
    a = np.array(matrices, dtype=np.float64)
    if a.shape[1] < a.shape[2]:
        left, values, right = decomposed(np.swapaxes(a, 1, 2))
        return np.swapaxes(right, 1, 2), values, np.swapaxes(left, 1, 2)
    count, _, n = a.shape
    scale = np.abs(a).max(axis=(1, 2), initial=0.0)
    a /= np.where(scale > 0, scale, 1.0)[:, None, None]
    v = np.broadcast_to(np.eye(n), (count, n, n)).copy()
    for _ in range(_MOST_SWEEPS):
        turned = False
        for p in range(n - 1):
            for q in range(p + 1, n):
                x, y = a[:, :, p], a[:, :, q]
                pp, qq, pq = (x * x).sum(axis=1), (y * y).sum(axis=1), (x * y).sum(axis=1)
                far = np.abs(pq) > _STILL * np.sqrt(pp * qq)
                if not far.any():
                    continue
                turned = True
                c, s = (u[:, None] for u in _turn(pp, qq, pq, far))
                for part in (a, v):
                    x, y = part[:, :, p].copy(), part[:, :, q].copy()
                    part[:, :, p], part[:, :, q] = c * x - s * y, s * x + c * y
        if not turned:
            break
    values = np.sqrt((a * a).sum(axis=1))
    order = np.argsort(-values, axis=1, kind="stable")
    values = np.take_along_axis(values, order, axis=1)
    a, v = (np.take_along_axis(part, order[:, None, :], axis=2) for part in (a, v))
    left = a / np.where(values > 0, values, 1.0)[:, None, :]
    if a.shape[1] == n:
        for k in np.flatnonzero(values[:, -1] == 0):
            _complete(left[k], int((values[k] > 0).sum()))
    return left, values * scale[:, None], np.swapaxes(v, 1, 2)


def _complete(columns: Values, known: int) -> None:
    """Fill in the columns (n, n) from ``known`` on, so that all are orthonormal."""
    for j in range(known, len(columns)):
        rest = np.eye(len(columns))
        for _ in range(2):  # once more for what rounding has left
            for k in range(j):
                rest -= columns[:, k] * (rest * columns[:, k]).sum(axis=1, keepdims=True)
        sizes = np.sqrt((rest * rest).sum(axis=1))
        best = int(np.argmax(sizes))
        columns[:, j] = rest[best] / sizes[best]


def singular_values(matrices: Values) -> Values:
    """Return the singular values (.., k) of finite matrices (.., m, n), descending."""
    given = np.asarray(matrices, dtype=np.float64)
    found = decomposed(_flat(given))[1]
    return found.reshape(*given.shape[:-2], found.shape[-1])


def eigen(matrices: Values) -> tuple[Values, Values]:
    """Return eigenvalues (.., n), ascending, and vectors (.., n, n), columns.

    Cyclic Jacobi rotations; the matrices have to be symmetric.
    """
    given = np.asarray(matrices, dtype=np.float64)
    a = _flat(given).copy()
    count, n, _ = a.shape
    scale = np.abs(a).max(axis=(1, 2), initial=0.0)
    a /= np.where(scale > 0, scale, 1.0)[:, None, None]
    v = np.broadcast_to(np.eye(n), (count, n, n)).copy()
    norms = np.sqrt((a * a).sum(axis=(1, 2)))
    for _ in range(_MOST_SWEEPS):
        turned = False
        for p in range(n - 1):
            for q in range(p + 1, n):
                pq = a[:, p, q]
                far = np.abs(pq) > 1e-17 * norms
                if not far.any():
                    continue
                turned = True
                c, s = (u[:, None] for u in _turn(a[:, p, p], a[:, q, q], pq, far))
                for part in (a, v):
                    x, y = part[:, :, p].copy(), part[:, :, q].copy()
                    part[:, :, p], part[:, :, q] = c * x - s * y, s * x + c * y
                x, y = a[:, p].copy(), a[:, q].copy()
                a[:, p], a[:, q] = c * x - s * y, s * x + c * y
                a[:, p, q] = a[:, q, p] = np.where(far, 0.0, a[:, p, q])
        if not turned:
            break
    values = np.einsum("nii->ni", a).copy()
    order = np.argsort(values, axis=1, kind="stable")
    values = np.take_along_axis(values, order, axis=1) * scale[:, None]
    vectors = np.take_along_axis(v, order[:, None, :], axis=2)
    return values.reshape(given.shape[:-1]), vectors.reshape(given.shape)

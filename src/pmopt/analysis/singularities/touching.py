"""Least sizes: singularities that are touched and not crossed.

Where a determinant touches 0, as at every zero of even order, no change of sign shows it. Its size
has a least value there, which is sought between the points that bracket it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.mechanisms.mechanism import Vector

Values = NDArray[np.float64]
#: Points of a motion that are looked at, at least; most between two instants.
_LOOKS, _MOST_INNER = 1 << 16, 64
#: Points that are looked at at once.
_BLOCK = 1 << 17
#: Least values that are located, the smallest first.
_LOCATED = 512
#: Rows: powers of the share s of an interval; columns: value, rate and acceleration at its
#: beginning and at its end, those with the length of the interval and its square.
_QUINTIC = np.array([
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
    [-10.0, -6.0, -1.5, 10.0, -4.0, 0.5],
    [15.0, 8.0, 1.5, -15.0, 7.0, -1.0],
    [-6.0, -3.0, -0.5, 6.0, -3.0, 0.5],
])  # fmt: skip

#: Points within a bracket a round, and rounds: each leaves a quarter of the bracket.
_PARTS, _ROUNDS = 8, 40


def least_along(
    size: Callable[[Values], Values], low: Vector, high: Vector
) -> tuple[Vector, Vector]:
    """Return where a size is least within each of some brackets, and the size there.

    Parameters
    ----------
    size : callable
        Returns the sizes (.., m) at values (.., m), the i-th column of the i-th function.
    low, high : (m,) float64
        Ends of the brackets; within each a function falls and rises again.

    Returns
    -------
    place, smallest : (m,) float64
    """
    low, high = low.astype(float).copy(), high.astype(float).copy()
    best, smallest = (low + high) / 2, size((low + high) / 2)
    for _ in range(_ROUNDS):
        width = high - low
        points = low + width * (np.arange(_PARTS + 1)[:, None] / _PARTS)
        sizes = size(points)
        at = np.argmin(sizes, axis=0)
        columns = np.arange(len(low))
        better = sizes[at, columns] < smallest
        best = np.where(better, points[at, columns], best)
        smallest = np.where(better, sizes[at, columns], smallest)
        centre = np.clip(at, 1, _PARTS - 1)
        low, high = points[centre - 1, columns], points[centre + 1, columns]
        if not (high - low > 4e-16 * np.maximum(np.abs(low), np.abs(high))).any():
            break
    return best, smallest


class Jets(NamedTuple):
    """Coordinates along a motion: values, rates and accelerations, (N, n) each."""

    values: Values
    rates: Values
    accelerations: Values


def between(t: Vector, jets: Jets, first: NDArray[np.int64], shares: Vector) -> Jets:
    """Return a motion between instants: the quintics that have its derivatives at both ends.

    Parameters
    ----------
    t : (N,) float64
        s.
    jets : Jets
    first : (M,) int
        Numbers of the instants that intervals begin with.
    shares : (M,) float64
        Of each interval, from 0 to 1.
    """
    h = (t[first + 1] - t[first])[:, None]
    given = np.stack([
        part[k] * h**order
        for k in (first, first + 1)
        for order, part in enumerate(jets)
    ])  # fmt: skip
    coefficients = np.tensordot(_QUINTIC, given, axes=1)
    s = shares[:, None]
    powers = [s**k for k in range(6)]
    value = sum(c * powers[k] for k, c in enumerate(coefficients))
    rate = sum(k * c * powers[k - 1] for k, c in enumerate(coefficients) if k)
    change = sum(k * (k - 1) * c * powers[k - 2] for k, c in enumerate(coefficients) if k > 1)
    return Jets(np.asarray(value), np.asarray(rate / h), np.asarray(change / h**2))


class Least(NamedTuple):
    """Where a size is least along a motion: K places.

    Attributes
    ----------
    first : (K,) int
        The instant before each.
    share : (K,) float64
        Of the way to the next one.
    size : (K,) float64
    """

    first: NDArray[np.int64]
    share: Vector
    size: Vector


def least_sizes(
    t: Vector, jets: Jets, known: NDArray[np.bool_], size: Callable[[Values], Vector]
) -> Least:
    """Return the least sizes between the instants of a motion, the smallest first.

    Points between the instants show where a size falls and rises again, however long the steps.

    Parameters
    ----------
    t : (N,) float64
    jets : Jets
        Of the pose; NaN where ``known`` is false.
    known : (N,) bool
    size : callable
        Returns the size at poses (M, n).
    """
    whole = np.flatnonzero(known[:-1] & known[1:])
    none = np.array([], dtype=np.int64)
    if len(whole) == 0:
        return Least(none, np.array([]), np.array([]))
    inner = int(np.clip(_LOOKS // len(whole), 1, _MOST_INNER))
    shares = np.arange(inner + 1) / (inner + 1)
    first = np.repeat(whole, len(shares))
    share = np.tile(shares, len(whole))
    sizes = np.concatenate([
        size(between(t, jets, first[k : k + _BLOCK], share[k : k + _BLOCK]).values)
        for k in range(0, len(first), _BLOCK)
    ])  # fmt: skip
    # The grid runs on from interval to interval, also to the end of the last of a stretch.
    ends = np.flatnonzero(np.diff(whole, append=whole[-1] + 2) > 1)
    last = size(jets.values[whole[ends] + 1])
    place = np.concatenate([first + share, whole[ends] + 1.0])
    order = np.argsort(place, kind="stable")
    place, sizes = place[order], np.concatenate([sizes, last])[order]
    rows = np.arange(1, len(place) - 1)
    step = 1.0 / (inner + 1)
    joined = place[rows + 1] - place[rows - 1] < 2.5 * step
    least = (sizes[rows] <= sizes[rows - 1]) & (sizes[rows] <= sizes[rows + 1]) & joined
    rows = rows[least]
    rows = rows[np.argsort(sizes[rows], kind="stable")[:_LOCATED]]
    if len(rows) == 0:
        return Least(none, np.array([]), np.array([]))

    def at(places: Values) -> Values:
        if places.ndim > 1:
            return np.stack([at(row) for row in places])
        start = np.minimum(np.floor(places).astype(np.int64), len(t) - 2)
        start = np.where(known[start] & known[start + 1], start, start - 1)
        return size(between(t, jets, start, places - start).values)

    found, smallest = least_along(at, place[rows - 1], place[rows + 1])
    order = np.argsort(smallest, kind="stable")
    found, smallest = found[order], smallest[order]
    start = np.minimum(np.floor(found).astype(np.int64), len(t) - 2)
    start = np.where(known[start] & known[start + 1], start, start - 1)
    return Least(start, found - start, smallest)

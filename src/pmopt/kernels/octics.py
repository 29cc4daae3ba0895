"""Real roots of polynomials of degree 8 and a bound on how many there are; kernel functions.

A polynomial is given by its values at :func:`nodes`, each to within an error. In Bernstein form on
an interval it has at most as many roots there as its coefficients change sign (Descartes); where
the sign of a coefficient is within the error, every sign counts. Intervals are split until they
have one root for certain, none, or are too narrow to be told apart: a cluster.
"""

from __future__ import annotations

import functools
import math
from fractions import Fraction

#: Numbers of a row of the stack: both ends of an interval and the 9 coefficients on it.
octic_ROW = 11
#: Rows of the stack, and the most roots and clusters that are kept.
octic_DEPTH = 80
octic_MOST = 24
#: Where an interval is split. Not in the middle: roots at round numbers would lie at ends.
octic_SPLIT = 0.4921875
#: Width of an interval of [-1, 1] that is not split any more.
octic_NARROW = 1e-9


@functools.cache
def nodes() -> tuple[float, ...]:
    """Return the 9 points in [-1, 1], about Chebyshev's, that values are needed at."""
    return tuple(round(1024 * math.cos((2 * k + 1) * math.pi / 18)) / 1024 for k in range(9))


@functools.cache
def bernstein() -> tuple[float, ...]:
    """Return the 9 x 9 matrix, row by row, from values to Bernstein coefficients on [-1, 1].

    The largest sum of a row's sizes follows. Computed exactly, then rounded.
    """
    rows: list[list[Fraction]] = []
    for node in nodes():
        x = (1 + Fraction(node)) / 2
        row = [math.comb(8, i) * x**i * (1 - x) ** (8 - i) for i in range(9)]
        rows.append(row + [Fraction(int(len(rows) == j)) for j in range(9)])
    for i in range(9):  # Gauss and Jordan; the pivots are not 0: nodes differ
        pivot = rows[i][i]
        rows[i] = [v / pivot for v in rows[i]]
        for j in range(9):
            if j != i:
                factor = rows[j][i]
                rows[j] = [v - factor * w for v, w in zip(rows[j], rows[i], strict=True)]
    matrix = [[float(v) for v in row[9:]] for row in rows]
    return (*(v for row in matrix for v in row), max(sum(map(abs, row)) for row in matrix))


def octic_changes(stack, k, tolerance):  # type: ignore[no-untyped-def]
    """Return the most sign changes of the coefficients of row k, whose errors are bounded."""
    plus = 0
    minus = 0
    for i in range(2, octic_ROW):
        b = stack[octic_ROW * k + i]
        # Most changes so far where this coefficient is positive, and where it is negative.
        up = plus if plus > minus + 1 else minus + 1
        down = minus if minus > plus + 1 else plus + 1
        if i == 2:
            up = 0
            down = 0
        plus = up if b >= -tolerance else -100
        minus = down if b <= tolerance else -100
    return plus if plus > minus else minus


def octic_split(stack, k, share, at):  # type: ignore[no-untyped-def]
    """Put the part of row k left of a share of it into row ``at + 1``, the right one into ``at``.

    ``at`` may be k.
    """
    low = stack[octic_ROW * k + 0]
    high = stack[octic_ROW * k + 1]
    middle = low + share * (high - low)
    for i in range(2, octic_ROW):
        stack[octic_ROW * at + i] = stack[octic_ROW * k + i]
    for i in range(9):
        stack[octic_ROW * (at + 1) + 2 + i] = stack[octic_ROW * at + 2]
        for j in range(2, octic_ROW - 1 - i):
            stack[octic_ROW * at + j] += share * (
                stack[octic_ROW * at + j + 1] - stack[octic_ROW * at + j]
            )
    # De Casteljau's scheme leaves the right part's coefficients where it ends.
    stack[octic_ROW * (at + 1) + 0] = low
    stack[octic_ROW * (at + 1) + 1] = middle
    stack[octic_ROW * at + 0] = middle
    stack[octic_ROW * at + 1] = high


def octic_value(stack, k, share, spare):  # type: ignore[no-untyped-def]
    """Return the polynomial at a share of row k's interval."""
    for i in range(2, octic_ROW):
        stack[octic_ROW * spare + i] = stack[octic_ROW * k + i]
    for i in range(8):
        for j in range(2, octic_ROW - 1 - i):
            stack[octic_ROW * spare + j] += share * (
                stack[octic_ROW * spare + j + 1] - stack[octic_ROW * spare + j]
            )
    return stack[octic_ROW * spare + 2]


def octic_refined(stack, k, spare):  # type: ignore[no-untyped-def]
    """Return the root in row k's interval, at whose ends the signs differ."""
    low = 0.0
    high = 1.0
    at_low = stack[octic_ROW * k + 2]
    at_high = stack[octic_ROW * k + octic_ROW - 1]
    side = 0
    middle = 0.5
    for _ in range(60):
        middle = (low * at_high - high * at_low) / (at_high - at_low)
        if not low < middle < high:
            break
        value = octic_value(stack, k, middle, spare)
        if value == 0.0:
            break
        if (value > 0.0) == (at_high > 0.0):
            if high - middle < 1e-13:
                break
            high = middle
            at_high = value
            at_low = 0.5 * at_low if side > 0 else at_low
            side = 1
        else:
            if middle - low < 1e-13:
                break
            low = middle
            at_low = value
            at_high = 0.5 * at_high if side < 0 else at_high
            side = -1
    return stack[octic_ROW * k + 0] + middle * (stack[octic_ROW * k + 1] - stack[octic_ROW * k + 0])


def octic_around(stack, low, high, tolerance, spare):  # type: ignore[no-untyped-def]
    """Return a bound on the roots of a cluster: the least of wider and wider intervals' about it.

    The polynomial on [-1, 1] is in the last row; ``spare`` and the row behind it are overwritten.
    """
    last = octic_DEPTH - 1
    least = 8
    room = 1e-8 + high - low
    for _ in range(14):
        start = low - room if low - room > -1.0 else -1.0
        end = high + room if high + room < 1.0 else 1.0
        octic_split(stack, last, 0.5 * (1.0 + start), spare)
        # The right part is in the first of the rows, from start to 1.
        octic_split(stack, spare, (end - start) / (1.0 - start), spare)
        most = octic_changes(stack, spare + 1, tolerance)
        least = most if most < least else least
        room *= 4.0
    return least


def octic_roots(values, error, matrix, stack, roots):  # type: ignore[no-untyped-def]
    """Find the real roots in [-1, 1].

    Parameters
    ----------
    values : (9,)
        At :func:`nodes`, each to within ``error``.
    matrix : (82,)
        :func:`bernstein`.
    stack : (octic_DEPTH * octic_ROW,)
        Scratch space, row by row.
    roots : (2 * octic_MOST,)
        Each root and behind it 0 or, of a cluster, its width.

    Returns
    -------
    count, bound : int
        Numbers of roots written, and of the real roots there can be, each as often as its
        multiplicity.
    """
    last = octic_DEPTH - 1
    tolerance = error * matrix[81]
    for i in range(9):
        total = 0.0
        for j in range(9):
            total += matrix[9 * i + j] * values[j]
        stack[2 + i] = total
        stack[octic_ROW * last + 2 + i] = total
    stack[0] = -1.0
    stack[1] = 1.0
    stack[octic_ROW * last + 0] = -1.0
    stack[octic_ROW * last + 1] = 1.0
    depth = 1
    count = 0
    bound = 0
    while depth > 0 and count < octic_MOST:
        k = depth - 1
        most = octic_changes(stack, k, tolerance)
        if most == 0:
            depth -= 1
            continue
        ends = (
            abs(stack[octic_ROW * k + 2]) > tolerance
            and abs(stack[octic_ROW * k + octic_ROW - 1]) > tolerance
        )
        if most == 1 and ends:
            roots[2 * count] = octic_refined(stack, k, last - 1)
            roots[2 * count + 1] = 0.0
            count += 1
            bound += 1
            depth -= 1
            continue
        largest = 0.0
        for i in range(2, octic_ROW):
            largest = (
                abs(stack[octic_ROW * k + i])
                if abs(stack[octic_ROW * k + i]) > largest
                else largest
            )
        low = stack[octic_ROW * k + 0]
        high = stack[octic_ROW * k + 1]
        if high - low > octic_NARROW and largest > tolerance and depth < last - 3:
            octic_split(stack, k, octic_SPLIT, k)
            depth += 1
            continue
        depth -= 1
        width = high - low
        if count > 0 and roots[2 * count - 1] > 0.0:
            # Intervals come from left to right: neighbours are one cluster.
            start = roots[2 * count - 2] - 0.5 * roots[2 * count - 1]
            if low - (start + roots[2 * count - 1]) <= 4.0 * width:
                roots[2 * count - 2] = 0.5 * (start + high)
                roots[2 * count - 1] = high - start
                continue
        roots[2 * count] = 0.5 * (low + high)
        roots[2 * count + 1] = width
        count += 1
    for k in range(count):
        if roots[2 * k + 1] > 0.0:
            half = 0.5 * roots[2 * k + 1]
            bound += octic_around(stack, roots[2 * k] - half, roots[2 * k] + half, tolerance, 0)
    return count, bound if depth == 0 else 99

"""Affine forms: what an expression is over a box, to second order and proven.

A form stands for the values ``c + a_1 e_1 + .. + a_d e_d + r e`` with all ``e`` in [-1, 1]; the
e_k are the coordinates of a box, scaled to it, r >= 0 holds all that is not linear, and all that
rounding may have done. The functions below are plain Python;
:func:`pmopt.compiler.programs.enclosing` compiles them.

Rounding. Let u = 2^-53. Every rounded sum, product, quotient or root is exact to u times its own
size, with an absolute error of at most 2^-1074 where it underflows. Each operation adds to r:

- a sum: u for each of its coefficients;
- a product x y: (|c_x| + D_x)(|c_y| + D_y) 2u, with D = |a_1| + .. + |a_d| + r;
- roots, inverses, sines: first order in the same way, written beside them.

EPS is 2u and such terms are doubled once more, which leaves room for their own rounding; UP
(1 + 32 u) on every r is more than the rounding of the at most 20 sums and products of terms >= 0
that make it; LEAST covers underflow. None of this asks for more than each operation's own error
bound: it holds as well where a product and a sum are fused. test_certify.py checks it against exact
rational arithmetic.
"""

import math

import numpy as np

from pmopt.kernels.trigonometry import sin_cos

#: Boxes evaluated at once.
LANES = 32
EPS = 2.220446049250313e-16
UP = 1.0 + 16 * EPS
LEAST = 1e-300
#: Error of sin_cos (it is 1e-15 at most, see there).
SINE_ERROR = 4e-15


def evaluate(steps, values, results, inputs, constants, work, found):
    """Evaluate a tape over boxes.

    Parameters
    ----------
    steps, values, results
        See :class:`pmopt.compiler.tracing.Tape`.
    inputs : (m, d + 2, N)
        Forms: centre, coefficients, remainder.
    constants : (c, 2)
        Values and how far they may be off.
    work : (n, d + 3, LANES)
        Scratch space; the last row is D.
    found : (len(results), d + 2, N)
        Forms of the results. Where an operation is not defined on a whole box its form has an
        infinite or NaN remainder.
    """
    d = inputs.shape[1] - 2
    count = inputs.shape[2]
    rem = d + 1
    dev = d + 2
    for start in range(0, count, LANES):
        lanes = min(LANES, count - start)
        for o in range(steps.shape[0]):
            op = steps[o, 0]
            x = steps[o, 1]
            y = steps[o, 2]
            if op == 0:  # INPUT
                for k in range(d + 2):
                    for i in range(lanes):
                        work[o, k, i] = inputs[x, k, start + i]
            elif op <= 2:  # CONSTANT, LITERAL
                value = constants[x, 0] if op == 1 else values[o]
                error = constants[x, 1] if op == 1 else 0.0
                for i in range(lanes):
                    work[o, 0, i] = value
                    work[o, rem, i] = error
                for k in range(1, d + 1):
                    for i in range(lanes):
                        work[o, k, i] = 0.0
            elif op == 3 or op == 4:  # ADD, SUB
                sign = 1.0 if op == 3 else -1.0
                for i in range(lanes):
                    work[o, 0, i] = work[x, 0, i] + sign * work[y, 0, i]
                    work[o, dev, i] = abs(work[o, 0, i])
                for k in range(1, d + 1):
                    for i in range(lanes):
                        work[o, k, i] = work[x, k, i] + sign * work[y, k, i]
                        work[o, dev, i] += abs(work[o, k, i])
                for i in range(lanes):
                    work[o, rem, i] = (
                        work[x, rem, i] + work[y, rem, i] + EPS * work[o, dev, i]
                    ) * UP
            elif op == 5:  # SCALE
                factor = values[o]
                for k in range(d + 1):
                    for i in range(lanes):
                        work[o, k, i] = factor * work[x, k, i]
                for i in range(lanes):
                    size = abs(work[x, 0, i]) + work[x, dev, i]
                    work[o, rem, i] = (abs(factor) * (work[x, rem, i] + EPS * size)) * UP + LEAST
            elif op == 6:  # MUL
                for i in range(lanes):
                    work[o, 0, i] = work[x, 0, i] * work[y, 0, i]
                for k in range(1, d + 1):
                    for i in range(lanes):
                        work[o, k, i] = (
                            work[x, 0, i] * work[y, k, i] + work[y, 0, i] * work[x, k, i]
                        )
                for i in range(lanes):
                    ax = abs(work[x, 0, i])
                    ay = abs(work[y, 0, i])
                    size = (ax + work[x, dev, i]) * (ay + work[y, dev, i])
                    r = (
                        ax * work[y, rem, i]
                        + ay * work[x, rem, i]
                        + work[x, dev, i] * work[y, dev, i]
                    )
                    work[o, rem, i] = (r + 2.0 * EPS * size) * UP + LEAST
            elif op == 7:  # SQUARE: what is beyond the linear part lies in [0, D^2]
                for i in range(lanes):
                    half = 0.5 * work[x, dev, i] * work[x, dev, i]
                    work[o, 0, i] = work[x, 0, i] * work[x, 0, i] + half
                    size = abs(work[x, 0, i]) + work[x, dev, i]
                    r = 2.0 * abs(work[x, 0, i]) * work[x, rem, i] + half
                    work[o, rem, i] = (r + 2.0 * EPS * size * size) * UP + LEAST
                for k in range(1, d + 1):
                    for i in range(lanes):
                        work[o, k, i] = 2.0 * work[x, 0, i] * work[x, k, i]
            elif op == 8:  # SQRT
                for i in range(lanes):
                    slack = 2.0 * EPS * (abs(work[x, 0, i]) + work[x, dev, i]) + LEAST
                    low = work[x, 0, i] - work[x, dev, i] - slack
                    high = work[x, 0, i] + work[x, dev, i] + slack
                    if low > 0.02 * high:
                        # sqrt(c + t) = s + t / 2s - t^2 / (2 s (s + sqrt(c + t))^2)
                        s = math.sqrt(work[x, 0, i])
                        slope = 0.5 / s
                        both = s + math.sqrt(low)
                        bend = work[x, dev, i] * work[x, dev, i] * slope / (both * both)
                        work[o, 0, i] = s - 0.5 * bend
                        for k in range(1, d + 1):
                            work[o, k, i] = slope * work[x, k, i]
                        size = s + slope * work[x, dev, i] + bend
                        r = slope * work[x, rem, i] + 0.5 * bend + 4.0 * EPS * size
                        work[o, rem, i] = r * UP + LEAST
                    else:
                        least = math.sqrt(low) if low > 0.0 else 0.0
                        most = math.sqrt(high) if not high < 0.0 else 0.0
                        work[o, 0, i] = 0.5 * (least + most)
                        for k in range(1, d + 1):
                            work[o, k, i] = 0.0
                        work[o, rem, i] = (0.5 * (most - least) + 4.0 * EPS * most) * UP + LEAST
            elif op == 9:  # INVERSE
                for i in range(lanes):
                    size = abs(work[x, 0, i])
                    least = size - work[x, dev, i] - 2.0 * EPS * (size + work[x, dev, i])
                    if least > 0.0:
                        # 1 / (c + t) = 1/c - t / c^2 + t^2 / (c^2 (c + t))
                        s = 1.0 / work[x, 0, i]
                        slope = s * s
                        bend = work[x, dev, i] * work[x, dev, i] * slope / least
                        work[o, 0, i] = s + 0.5 * (bend if s > 0.0 else -bend)
                        for k in range(1, d + 1):
                            work[o, k, i] = -slope * work[x, k, i]
                        size = abs(s) + slope * work[x, dev, i] + bend
                        r = slope * work[x, rem, i] + 0.5 * bend + 4.0 * EPS * size
                        work[o, rem, i] = r * UP + LEAST
                    else:
                        for k in range(d + 1):
                            work[o, k, i] = 0.0
                        work[o, rem, i] = np.inf
            elif op == 10 or op == 11:  # SINE, COSINE
                # sin(c + t) = sin c cos t + cos c sin t, cos t in [1 - D^2/2, 1],
                # |sin t - t| <= D^3/6
                for i in range(lanes):
                    s, c = sin_cos(work[x, 0, i])
                    if op == 11:
                        s, c = c, -s
                    dx = work[x, dev, i]
                    if not dx > 2.0:
                        bend = 0.25 * dx * dx
                        work[o, 0, i] = s * (1.0 - bend)
                        for k in range(1, d + 1):
                            work[o, k, i] = c * work[x, k, i]
                        r = abs(c) * (work[x, rem, i] + dx * dx * dx / 6.0) + abs(s) * bend
                        # The error of s and c, and what rounding adds.
                        r += (SINE_ERROR + 4.0 * EPS) * (1.0 + dx + bend)
                        work[o, rem, i] = r * UP
                    else:
                        for k in range(d + 1):
                            work[o, k, i] = 0.0
                        work[o, rem, i] = 1.0
            else:  # POSITIVE: x/2 + |x|/2
                for i in range(lanes):
                    size = abs(work[x, 0, i]) + work[x, dev, i]
                    if work[x, 0, i] - work[x, dev, i] - 2.0 * EPS * size >= 0.0:
                        for k in range(d + 2):
                            work[o, k, i] = work[x, k, i]
                    elif work[x, 0, i] + work[x, dev, i] + 2.0 * EPS * size <= 0.0:
                        for k in range(d + 2):
                            work[o, k, i] = 0.0
                    else:
                        work[o, 0, i] = 0.5 * work[x, 0, i] + 0.25 * size
                        for k in range(1, d + 1):
                            work[o, k, i] = 0.5 * work[x, k, i]
                        work[o, rem, i] = (0.5 * work[x, rem, i] + 0.25 * size + EPS * size) * UP
            for i in range(lanes):
                work[o, dev, i] = work[o, rem, i]
            for k in range(1, d + 1):
                for i in range(lanes):
                    work[o, dev, i] += abs(work[o, k, i])
        for f in range(results.shape[0]):
            for k in range(d + 2):
                for i in range(lanes):
                    found[f, k, start + i] = work[results[f], k, i]


def half_space(offset, sizes, d):
    """Return bounds of the share of [-1, 1]^d in which offset + a_1 e_1 + .. + a_d e_d >= 0.

    ``sizes`` holds |a_k| and is sorted. Without loss of generality the part asked for is the
    smaller one, a corner cut off at depth t: its volume is an alternating sum of powers over the
    corners within. Small coefficients would cancel there: the share is averaged over their terms,
    of mean 0, and the second derivative by the offset is at most 1 / (4 a_1 a_2).
    """
    for i in range(1, d):  # descending
        value = sizes[i]
        k = i
        while k > 0 and sizes[k - 1] < value:
            sizes[k] = sizes[k - 1]
            k -= 1
        sizes[k] = value
    total = 0.0
    for k in range(d):
        total += sizes[k]
    if not (total < np.inf and offset == offset):
        return 0.0, 1.0
    if offset >= total * UP:
        return 1.0, 1.0
    if offset <= -total * UP:
        return 0.0, 0.0
    depth = abs(offset)
    # As many coefficients as err least: of each of 2^kept terms the base to (kept + 3) EPS of the
    # total, and kept products.
    kept = 1
    error = 1.0
    scale = 1.0
    power = total
    for n in range(1, d + 1):
        scale *= 2.0 * sizes[n - 1] * n
        power *= total if n > 1 else 1.0
        rest = 0.0
        square = 0.0
        for k in range(n, d):
            rest += sizes[k]
            square += sizes[k] * sizes[k]
        found = (1 << n) * (n * (n + 3) + 8.0) * EPS * power / scale + 8.0 * EPS
        if n > 1:
            found += square / (20.0 * sizes[0] * sizes[1])
        elif depth + rest > sizes[0]:  # else linear, and so exact
            found += rest / sizes[0]
        if found < error:
            error = found
            kept = n
    t = -depth
    scale = 1.0
    for k in range(kept):
        t += sizes[k]
        scale *= 2.0 * sizes[k] * (k + 1)
    share = 0.0
    if t > 0.0:
        for corner in range(1 << kept):
            base = t
            sign = 1.0
            for k in range(kept):
                if (corner >> k) & 1:
                    base -= 2.0 * sizes[k]
                    sign = -sign
            if base > 0.0:
                power = sign
                for _ in range(kept):
                    power *= base
                share += power
        share /= scale
    if offset > 0.0:
        share = 1.0 - share
    low = share - error
    high = share + error
    return (low if low > 0.0 else 0.0), (high if high < 1.0 else 1.0)


def shares(slacks, sizes, low, high):
    """Write bounds of the share of each box in which all slacks are >= 0.

    Parameters
    ----------
    slacks : (s, d + 2, N)
        Forms.
    sizes : (d,)
        Scratch space.
    low, high : (N,)
    """
    d = slacks.shape[1] - 2
    for i in range(slacks.shape[2]):
        lost = 0.0  # what the slacks cut off at most
        active = 0
        most = 1.0
        for s in range(slacks.shape[0]):
            centre = slacks[s, 0, i]
            r = slacks[s, d + 1, i]
            total = 0.0
            for k in range(d):
                total += abs(slacks[s, k + 1, i])
            # The sum of the coefficients is told to d EPS of itself.
            edge = (r + 8.0 * EPS * (abs(centre) + total)) * UP
            if centre - total - edge >= 0.0:
                continue
            if centre + total + edge < 0.0:
                most = 0.0
                break
            for k in range(d):
                sizes[k] = abs(slacks[s, k + 1, i])
            inner, _ = half_space(centre - edge, sizes, d)
            _, outer = half_space(centre + edge, sizes, d)
            lost += (1.0 - inner) * UP
            most = outer if outer < most else most
            active += 1
        inside = 1.0 - lost * UP - EPS if lost > 0.0 else 1.0
        if active > 1 and most > 0.0:
            # Slacks that are much alike cut off the same: one of them, lowered to all others.
            for s in range(slacks.shape[0]):
                edge = 0.0
                size = 0.0
                for other in range(slacks.shape[0]):
                    r = slacks[other, d + 1, i] + abs(slacks[s, 0, i] - slacks[other, 0, i])
                    total = abs(slacks[other, 0, i])
                    for k in range(d):
                        r += abs(slacks[s, k + 1, i] - slacks[other, k + 1, i])
                        total += abs(slacks[other, k + 1, i])
                    least = slacks[other, 0, i] * 2.0 - total - slacks[other, d + 1, i]
                    # Those that are >= 0 throughout do not count.
                    if not (least - 16.0 * EPS * total > 0.0 and slacks[other, 0, i] > 0.0):
                        edge = r if not r < edge else edge
                    size = total if total > size else size
                edge = (edge + 16.0 * EPS * size) * UP
                for k in range(d):
                    sizes[k] = abs(slacks[s, k + 1, i])
                inner, _ = half_space(slacks[s, 0, i] - edge, sizes, d)
                inside = inner if inner > inside else inside
        low[i] = inside if inside > 0.0 and most > 0.0 else 0.0
        high[i] = most

"""Conditioning of small matrices, as branch-free scalar code.

These are kernel functions: plain Python on floats, compiled and inlined by
:mod:`pmopt.compiler.program_text`. The argument is any scalar multiple of the inverse
Jacobian; both indices are invariant under scaling and under inversion. 3x3 matrices have closed
forms; larger ones are taken a block of points at a time by one-sided Jacobi rotations.
"""

import math

import numpy as np

# cos(2/3 acos((t + 1)/2)) on t in [-1, 1]: Chebyshev fit of degree 14, largest error 4e-14,
# below what the rounding of its argument costs.
C0 = 0.7660444431189826
C1 = 0.24740906632332238
C2 = -0.015509188437108442
C3 = 0.002466352797696547
C4 = -0.0005041246782134169
C5 = 0.0001164256388317587
C6 = -2.8920038454252404e-05
C7 = 7.540205814466724e-06
C8 = -2.035474880060599e-06
C9 = 5.662405600980584e-07
C10 = -1.6036490574254682e-07
C11 = 4.3216955795452874e-08
C12 = -1.2418365963074522e-08
C13 = 5.576785718739665e-09
C14 = -1.707050210994795e-09

TINY = 1e-300
#: Relative separation of eigenvalues of A A^T below which the closed forms lose digits: they lose
#: the inverse of its root, 3 of 16.
DOUBT = 1e-5
#: Squared share of the second singular value in the first below which the index is below 1e-13.
RANK_ONE = 1e-26
#: Squared product of the turn's tangent and the columns' cosine below which one sweep is the last:
#: rotations then converge quadratically, and what is left of a cosine moves a squared length by its
#: product with the turn. (Columns of nearly one length turn far for a small cosine.)
STILL = 1e-26
#: Most sweeps of rotations; columns that are rounding errors of larger ones never come to rest.
MOST_SWEEPS = 12


def cos_third(cos_angle):
    """Return cos(angle / 3) for an angle in [0, pi] given by its cosine.

    With s = cos(angle / 2) it is cos(2/3 acos(s)), analytic on [0, 1]: one polynomial
    serves where acos and cos would keep the loop from being vectorised.
    """
    t = 2.0 * math.sqrt(0.5 + 0.5 * cos_angle) - 1.0
    p = C14 * t + C13
    p = p * t + C12
    p = p * t + C11
    p = p * t + C10
    p = p * t + C9
    p = p * t + C8
    p = p * t + C7
    p = p * t + C6
    p = p * t + C5
    p = p * t + C4
    p = p * t + C3
    p = p * t + C2
    p = p * t + C1
    return p * t + C0


def inverse_condition_2(a, b, c, d, e, f, g, h, i):
    """Return smallest over largest singular value of [[a, b, c], [d, e, f], [g, h, i]].

    The largest eigenvalue l1 of A A^T is well conditioned and comes from the trigonometric
    formula; the others follow from l1 l2 l3 = det(A)^2 and
    l1 (l2 + l3) + l2 l3 = |adj A|_F^2, which keep their relative accuracy near singularity
    where the characteristic polynomial of A A^T loses it. That takes the larger two or the smaller
    two singular values to be apart, and the second not to be much smaller than the first: where
    they are not by a share of DOUBT, digits would be lost and -1 is returned; see
    :func:`careful_condition_2`. Where the second is but rounding the index is 0.
    """
    g11 = a * a + b * b + c * c
    g22 = d * d + e * e + f * f
    g33 = g * g + h * h + i * i
    g12 = a * d + b * e + c * f
    g13 = a * g + b * h + c * i
    g23 = d * g + e * h + f * i
    mean = (g11 + g22 + g33) / 3.0
    d1 = g11 - mean
    d2 = g22 - mean
    d3 = g33 - mean
    off = g12 * g12 + g13 * g13 + g23 * g23
    spread2 = (d1 * d1 + d2 * d2 + d3 * d3 + 2.0 * off) / 6.0
    spread = math.sqrt(spread2)
    half_det = 0.5 * (
        d1 * (d2 * d3 - g23 * g23) - g12 * (g12 * d3 - g23 * g13) + g13 * (g12 * g23 - d2 * g13)
    )
    ratio = half_det / (spread2 * spread + TINY)
    ratio = ratio if ratio < 1.0 else 1.0
    ratio = ratio if ratio > -1.0 else -1.0
    l1 = mean + 2.0 * spread * cos_third(ratio)

    m11 = e * i - f * h
    m12 = f * g - d * i
    m13 = d * h - e * g
    det = a * m11 + b * m12 + c * m13
    m21 = c * h - b * i
    m22 = a * i - c * g
    m23 = b * g - a * h
    m31 = b * f - c * e
    m32 = c * d - a * f
    m33 = a * e - b * d
    minors = (
        m11 * m11 + m12 * m12 + m13 * m13
        + m21 * m21 + m22 * m22 + m23 * m23
        + m31 * m31 + m32 * m32 + m33 * m33
    )  # fmt: skip
    inverse_l1 = 1.0 / (l1 + TINY)
    product = det * det * inverse_l1
    half_sum = 0.5 * (minors - product) * inverse_l1
    square = half_sum * half_sum
    gap = square - product
    l2 = half_sum + math.sqrt(gap if gap > 0.0 else 0.0)
    l3 = product / (l2 + TINY)
    # Written so that NaN is a doubt too.
    sure = ratio > DOUBT - 1.0 and gap > DOUBT * square and l2 > DOUBT * l1
    found = math.sqrt(l3 * inverse_l1) if sure else -1.0
    return 0.0 if minors <= RANK_ONE * l1 * l1 else found


def careful_condition_2(a, b, c, d, e, f, g, h, i):
    """Return smallest over largest singular value by one-sided Jacobi rotations; 0 for zero."""
    s1, s2, s3 = orthogonal_squares(a, b, c, d, e, f, g, h, i)
    return math.sqrt(min(s1, s2, s3) / (max(s1, s2, s3) + TINY))


def careful_condition_fro(a, b, c, d, e, f, g, h, i):
    """Return 1 / (|A|_F |A^-1|_F) by one-sided Jacobi rotations; 0 for a zero matrix."""
    s1, s2, s3 = orthogonal_squares(a, b, c, d, e, f, g, h, i)
    total = s1 + s2 + s3
    inverse = 1.0 / (s1 + TINY) + 1.0 / (s2 + TINY) + 1.0 / (s3 + TINY)
    return 1.0 / math.sqrt(total * inverse) if total > 0.0 else 0.0


def orthogonal_squares(a, b, c, d, e, f, g, h, i):
    """Return the squared singular values: of the columns, rotated until they are orthogonal."""
    largest = max(abs(a), abs(b), abs(c), abs(d), abs(e), abs(f), abs(g), abs(h), abs(i))
    unit = 1.0 / (largest + TINY)
    a, b, c, d, e, f, g, h, i = (
        a * unit, b * unit, c * unit, d * unit, e * unit, f * unit, g * unit, h * unit, i * unit,
    )  # fmt: skip
    for _ in range(MOST_SWEEPS):
        a, d, g, b, e, h, first = rotated(a, d, g, b, e, h)
        a, d, g, c, f, i, second = rotated(a, d, g, c, f, i)
        b, e, h, c, f, i, third = rotated(b, e, h, c, f, i)
        if first + second + third == 0:
            break
    return a * a + d * d + g * g, b * b + e * e + h * h, c * c + f * f + i * i


def rotated(x1, x2, x3, y1, y2, y3):
    """Return two columns turned to be orthogonal, and whether they had been far from it."""
    pp = x1 * x1 + x2 * x2 + x3 * x3
    qq = y1 * y1 + y2 * y2 + y3 * y3
    pq = x1 * y1 + x2 * y2 + x3 * y3
    c, s, far = rotation_of(pp, qq, pq)
    return (
        c * x1 - s * y1, c * x2 - s * y2, c * x3 - s * y3,
        s * x1 + c * y1, s * x2 + c * y2, s * x3 + c * y3,
        1 if far else 0,
    )  # fmt: skip


def rotation_of(pp, qq, pq):
    """Return cosine and sine of what makes two columns orthogonal, and whether it is a turn."""
    gap = qq - pp
    twice = 2.0 * pq
    t = twice / (abs(gap) + math.sqrt(gap * gap + twice * twice) + TINY)
    t = t if gap >= 0.0 else -t
    c = 1.0 / math.sqrt(1.0 + t * t)
    return c, c * t, t * t * (pq * pq) > STILL * (pp * qq)


def inverse_condition_fro(a, b, c, d, e, f, g, h, i):
    """Return 1 / (|A|_F |A^-1|_F) of [[a, b, c], [d, e, f], [g, h, i]]; 1/3 at isotropy.

    -1 where digits would be lost; see :func:`careful_condition_fro`.
    """
    m11 = e * i - f * h
    m12 = f * g - d * i
    m13 = d * h - e * g
    m21 = c * h - b * i
    m22 = a * i - c * g
    m23 = b * g - a * h
    m31 = b * f - c * e
    m32 = c * d - a * f
    m33 = a * e - b * d
    det = a * m11 + b * m12 + c * m13
    minors = (
        m11 * m11 + m12 * m12 + m13 * m13
        + m21 * m21 + m22 * m22 + m23 * m23
        + m31 * m31 + m32 * m32 + m33 * m33
    )  # fmt: skip
    norm2 = a * a + b * b + c * c + d * d + e * e + f * f + g * g + h * h + i * i
    # Near rank one the minors lose their digits.
    sure = minors > DOUBT * norm2 * norm2
    found = abs(det) / math.sqrt(norm2 * minors + TINY) if sure else -1.0
    return 0.0 if minors <= RANK_ONE * norm2 * norm2 else found


#: Rows of the matrices, written into the specialised module.
ORDER = 4


def orthogonalise(work, count):
    """Rotate the columns of each matrix until they are orthogonal (one-sided Jacobi, Hestenes).

    ``work`` (ORDER**2, B) holds the entries row by row, a column a point: the loop over points is
    the inner one and is vectorised.
    """
    for _ in range(MOST_SWEEPS):
        turned = 0
        for p in range(ORDER - 1):
            for q in range(p + 1, ORDER):
                for i in range(count):
                    pp = 0.0
                    qq = 0.0
                    pq = 0.0
                    for r in range(ORDER):
                        x = work[r * ORDER + p, i]
                        y = work[r * ORDER + q, i]
                        pp += x * x
                        qq += y * y
                        pq += x * y
                    c, s, far = rotation_of(pp, qq, pq)
                    turned += 1 if far else 0
                    for r in range(ORDER):
                        x = work[r * ORDER + p, i]
                        y = work[r * ORDER + q, i]
                        work[r * ORDER + p, i] = c * x - s * y
                        work[r * ORDER + q, i] = s * x + c * y
        if turned == 0:
            break


def inverse_conditions_2(work, count, lci):
    """Write smallest over largest singular value of each matrix; ``work`` is used up."""
    orthogonalise(work, count)
    for i in range(count):
        smallest = np.inf
        largest = 0.0
        for q in range(ORDER):
            square = 0.0
            for r in range(ORDER):
                square += work[r * ORDER + q, i] * work[r * ORDER + q, i]
            smallest = square if square < smallest else smallest
            largest = square if square > largest else largest
        lci[i] = math.sqrt(smallest / (largest + TINY))


def inverse_conditions_fro(work, count, lci):
    """Write 1 / (|A|_F |A^-1|_F) of each matrix; ``work`` is used up."""
    orthogonalise(work, count)
    for i in range(count):
        total = 0.0
        inverse = 0.0
        for q in range(ORDER):
            square = 0.0
            for r in range(ORDER):
                square += work[r * ORDER + q, i] * work[r * ORDER + q, i]
            total += square
            inverse += 1.0 / (square + TINY)
        lci[i] = 1.0 / math.sqrt(total * inverse + TINY) if total > 0.0 else 0.0

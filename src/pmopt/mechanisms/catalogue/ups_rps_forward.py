"""Forward kinematics of 4-UPS-RPS: all assembly modes that paths from a known case lead to.

Lengths are over r. With p = Rot y and q = Rot z, S_k = sin s_k p - cos s_k q and P_z = q_z, so that
the five lengths are linear in W = |P|^2, U = P.p, V = P.q, P_y, p_y, p_z, q_y and q_z. With
a = q_z, y = P_y and c = p_z they give::

    p_y = A0 + A1 a        U = B0 + B1 a
    V = V0 + V1 y + V2 c   q_y = Q0 + Q1 y + Q2 c   W = W0 + W1 y + W2 c

What is left of the products of P, p and q once y and z are taken out is that of their x::

    (P_x, p_x, q_x)^T (P_x, p_x, q_x) = N(a, y, c)

Six quadratic equations in a, y, c and three x, of which -x is a solution with x: the mirror image
at the base. For general complex dimensions and lengths they have 18 pairs of solutions, found once
for :data:`DIMENSIONS` and kept in :data:`STARTS`. Those are followed to the given dimensions
and from there, for each set of lengths, to the given lengths (parameter homotopy; Sommese and
Wampler, The Numerical Solution of Systems of Polynomials, chapter 7). Real ends are refined by
Newton's method on the five lengths. That no path is lost is checked, not proven: ends are distinct,
and the conjugate of each is one. Otherwise all are followed again in smaller steps.
"""

import math

from pmopt.kernels.assembly import assembly_angles, assembly_sort

EPS = 2.220446049250313e-16
TINY = 1e-300
rps_PATHS = 18
#: Sines and cosines of 72 and 144 degrees.
rps_S1, rps_C1 = 0.9510565162951535, 0.30901699437494745
rps_S2, rps_C2 = 0.5877852522924731, -0.8090169943749475
#: Largest relative change of a state by the first correction after a step, and what is aimed at.
rps_FAR, rps_AIM = 2e-2, 2e-3
#: Steps at most along a path.
rps_STEPS = 4000
#: Largest miss of a length's square over the size's square at a solution.
rps_CLOSE = 3e-14
#: Largest imaginary part of an end that a real solution is sought from.
rps_REAL = 1e-3
rps_MODES = 36
rps_KEPT = 9
#: Complex R1 and R / sqrt 2, and squares of l1 to l5, all over r.
DIMENSIONS = (3.5, 0.6, 2.3, -0.5, 26.0, 9.0, 24.0, -11.0, 27.0, 6.0, 22.0, 12.0, 29.0, -8.0)
#: Solutions there, a row each: a, y, c, p_x, q_x, P_x, real and imaginary parts. Newton's method
#: from 12,000 random starts finds these and no others.
STARTS = (
    -5.314229, 3.371454, 3.418891, 1.363722, -0.233130, 7.781449,
    7.408292, 3.007255, 2.109998, 5.976094, 5.956484, 4.989861,
    -3.271051, 2.613806, 4.829160, 2.152296, -1.542062, 6.368319,
    6.753137, 2.747403, 1.780505, 4.468351, 4.253788, 2.783521,
    -3.123774, -0.716357, -5.288105, -1.368032, 2.657567, -0.550529,
    -0.432710, 3.622600, 1.403468, -2.840797, -2.417396, 5.540758,
    -2.573917, -0.480846, -0.890185, -2.570563, 1.622661, -1.130688,
    0.047166, 2.176296, 4.278763, -1.325169, -4.605170, 2.925260,
    -0.973238, -0.657912, -1.624230, 1.380068, -0.268402, 1.542638,
    2.038329, 0.034013, -0.882644, 0.539602, -3.794983, -1.611249,
    -0.972070, 0.530125, 2.519405, -2.568634, 0.890430, 0.002507,
    -0.564382, -0.251003, -5.667826, -0.240718, 4.475705, -0.517379,
    -0.828333, 0.481654, -4.041012, 3.890513, 1.133487, 0.014545,
    -0.105668, -0.449183, -0.106235, 1.210258, -5.389357, -3.845428,
    -0.806210, 1.506501, -0.248342, 0.886132, -3.049555, 1.570431,
    -1.897637, -2.650266, -1.120365, -0.450324, -2.933086, -2.264845,
    -0.460737, 0.212608, -1.610251, 4.770720, -0.945196, 0.039643,
    0.242892, 0.113590, 0.140629, 1.021806, -6.125565, -2.170261,
    -0.274542, 0.179417, -1.275593, 1.474803, -0.919895, 0.062210,
    -0.182841, -0.312585, 1.731237, -0.235098, 3.078268, 0.954352,
    -0.244746, 0.092396, -2.046968, 1.312254, 1.024331, 0.081630,
    0.059084, -0.540205, 1.870147, 0.635641, 3.740924, 0.671068,
    -0.128923, 0.673044, 1.534178, -1.294626, -0.953514, 0.135026,
    0.511226, -0.477419, 4.144171, -0.751242, -3.292967, 0.831079,
    0.362630, -1.004380, -0.623480, 1.093259, -2.595634, 1.353441,
    -1.939379, -2.686866, 0.978928, -0.229375, 2.889959, 2.033405,
    0.396141, 0.909645, -1.547033, 0.937551, -0.275103, 1.814342,
    1.861383, -0.312832, 1.345621, -0.186881, 3.786094, 1.502027,
    2.793104, 0.028573, -1.762953, -1.746191, 1.139488, -2.404215,
    0.995169, 3.478774, -4.093594, 1.785217, 3.752585, -3.784219,
    2.849522, -2.139763, 4.240803, 2.030574, -1.561406, 6.715660,
    6.676067, 3.262752, -0.925931, -3.925536, -4.637413, -2.687353,
    3.208450, 0.654862, -4.648353, -1.844933, 2.183544, -1.780798,
    -0.290057, -4.605756, 2.488938, -2.948581, -3.277374, 5.674204,
    4.785084, -2.976554, 2.810602, 1.118291, -0.205727, 8.021399,
    7.117550, 3.577683, -1.477330, -5.214710, -6.080550, -4.669527,
)  # fmt: skip

# Places in the scratch space.
rps_NOW = 1  # R1, R / sqrt 2, l_k^2 at a path's place, complex; 0 says whether starts are there
rps_FROM = 15
rps_TO = 29
rps_COEFFICIENTS = 43  # A0, A1, B0, B1, V0 .. V2, Y0 .. Y2, W0 .. W2 at a place of the path
rps_RATES = 69
rps_HEAD = 95  # the same at the start, then at the end
rps_HERE = 147  # state, its rate, those of the last place, next state, step: 12 each
rps_BEGIN = 219  # where paths begin
rps_END = rps_BEGIN + 12 * rps_PATHS
rps_STATE = rps_END + 12 * rps_PATHS  # P_x, P_y, p, q (8); equations (5); slope (25), inverse (25)
rps_FOUND = rps_STATE + 63
rps_WORK = rps_FOUND + rps_PATHS * rps_KEPT


def rps_at(w, k):  # type: ignore[no-untyped-def]
    """Return a complex number of the scratch space."""
    return complex(w[k], w[k + 1])


def rps_put(w, k, value):  # type: ignore[no-untyped-def]
    """Put a complex number in place."""
    w[k] = value.real
    w[k + 1] = value.imag


def rps_square(value):  # type: ignore[no-untyped-def]
    """Return the square of a complex number's size."""
    return value.real * value.real + value.imag * value.imag


def rps_reciprocal(value):  # type: ignore[no-untyped-def]
    """Return 1 / value, 0 of 0: numba's own division raises there, which kernels may not."""
    unit = 1.0 / (value.real * value.real + value.imag * value.imag + TINY)
    return complex(unit * value.real, -unit * value.imag)


def rps_coefficients(w, k):  # type: ignore[no-untyped-def]
    """Put the 13 coefficients for the dimensions and lengths in NOW in place at k."""
    big, h = rps_at(w, rps_NOW), rps_at(w, rps_NOW + 2)
    l1, l2, l3 = rps_at(w, rps_NOW + 4), rps_at(w, rps_NOW + 6), rps_at(w, rps_NOW + 8)
    l4, l5 = rps_at(w, rps_NOW + 10), rps_at(w, rps_NOW + 12)
    r2 = 2.0 * h * h + 1.0
    m1 = l1 - 1.0 - big * big
    m25 = 0.5 * (l2 + l5) - r2
    m34 = 0.5 * (l3 + l4) - r2
    d25 = (l2 - l5) / rps_S1
    d34 = (l3 - l4) / rps_S2
    t1 = (1.0 - rps_C1) / rps_S1
    t2 = (1.0 - rps_C2) / rps_S2
    a1 = 0.5 * (t2 - t1)
    a0 = 0.125 * (d34 - d25) * rps_reciprocal(h)
    # q_y from the differences of the sums of limbs 2, 5 and 3, 4 and of limb 1, V taken out.
    e11 = -2.0 * (rps_C1 - rps_C2)
    e21 = -2.0 * (1.0 - rps_C1)
    unit = rps_reciprocal(2.0 * e11 * big)
    q0 = unit * (e11 * (m1 - m25) - e21 * (m25 - m34))
    q1 = unit * (e11 * (2.0 * big - 2.0 * h) - e21 * (4.0 * h))
    q2 = unit * (-2.0 * h) * (e11 * rps_S1 + e21 * (rps_S1 - rps_S2))
    f1, f2 = -2.0 * h * (rps_C1 + rps_C2), 2.0 * h * (rps_S1 - rps_S2)
    v0 = (m25 - m34 + f1 * q0) / e11
    v1 = (f1 * q1 + 4.0 * h) / e11
    v2 = (f1 * q2 + f2) / e11
    rps_put(w, k, a0)
    rps_put(w, k + 2, a1 + 0.0j)
    rps_put(w, k + 4, h * a0 + 0.25 * d25)
    rps_put(w, k + 6, h * (a1 + t1))
    rps_put(w, k + 8, v0)
    rps_put(w, k + 10, v1)
    rps_put(w, k + 12, v2)
    rps_put(w, k + 14, q0)
    rps_put(w, k + 16, q1)
    rps_put(w, k + 18, q2)
    rps_put(w, k + 20, m1 + 2.0 * v0 - 2.0 * big * q0)
    rps_put(w, k + 22, 2.0 * v1 + 2.0 * big - 2.0 * big * q1)
    rps_put(w, k + 24, 2.0 * v2 - 2.0 * big * q2)


def rps_mix(w, t):  # type: ignore[no-untyped-def]
    """Put the dimensions and lengths at a place of a path into NOW."""
    for i in range(14):
        w[rps_NOW + i] = w[rps_FROM + i] + t * (w[rps_TO + i] - w[rps_FROM + i])


def rps_along(w, t, straight):  # type: ignore[no-untyped-def]
    """Put the coefficients at a place of a path and their rates in place.

    Where only lengths change they change with t: ``straight``.
    """
    if straight:
        for i in range(26):
            rate = w[rps_HEAD + 26 + i] - w[rps_HEAD + i]
            w[rps_RATES + i] = rate
            w[rps_COEFFICIENTS + i] = w[rps_HEAD + i] + t * rate
        if t == 1.0:
            for i in range(26):
                w[rps_COEFFICIENTS + i] = w[rps_HEAD + 26 + i]
        return
    step = 1e-4
    rps_mix(w, t + step)
    rps_coefficients(w, rps_RATES)
    rps_mix(w, t - step)
    rps_coefficients(w, rps_COEFFICIENTS)
    for i in range(26):
        w[rps_RATES + i] = (w[rps_RATES + i] - w[rps_COEFFICIENTS + i]) / (2.0 * step)
    rps_mix(w, t)
    rps_coefficients(w, rps_COEFFICIENTS)


def rps_across(jj, jk, jl, kk, kl, ll, rk, rl):  # type: ignore[no-untyped-def]
    """Return a symmetric matrix between the two directions across x; rk, rl are x_k, x_l by x_j."""
    return (
        kk - 2.0 * rk * jk + rk * rk * jj,
        kl - rl * jk - rk * jl + rk * rl * jj,
        ll - 2.0 * rl * jl + rl * rl * jj,
    )


def rps_solve(w, at, moving, out):  # type: ignore[no-untyped-def]
    """Solve for a correction of the state at ``at``, or if ``moving`` for its rate along the path.

    Put it into ``out``; return the squares of its size and of the state's.
    """
    a, y, c = rps_at(w, at), rps_at(w, at + 2), rps_at(w, at + 4)
    px, qx, x = rps_at(w, at + 6), rps_at(w, at + 8), rps_at(w, at + 10)
    k = rps_COEFFICIENTS
    a1, b1 = rps_at(w, k + 2), rps_at(w, k + 6)
    v1, v2 = rps_at(w, k + 10), rps_at(w, k + 12)
    q1, q2 = rps_at(w, k + 16), rps_at(w, k + 18)
    w1, w2 = rps_at(w, k + 22), rps_at(w, k + 24)
    py = rps_at(w, k) + a1 * a
    qy = rps_at(w, k + 14) + q1 * y + q2 * c
    # Miss of x x^T = N, or minus N's rate with the coefficients; rows P, p, q.
    if moving:
        k = rps_RATES
        py_t = rps_at(w, k) + rps_at(w, k + 2) * a
        qy_t = rps_at(w, k + 14) + rps_at(w, k + 16) * y + rps_at(w, k + 18) * c
        w_t = rps_at(w, k + 20) + rps_at(w, k + 22) * y + rps_at(w, k + 24) * c
        v_t = rps_at(w, k + 8) + rps_at(w, k + 10) * y + rps_at(w, k + 12) * c
        u_t = rps_at(w, k + 4) + rps_at(w, k + 6) * a
        e11 = -w_t
        e12 = y * py_t - u_t
        e13 = y * qy_t - v_t
        e22 = 2.0 * py * py_t
        e23 = py_t * qy + py * qy_t
        e33 = 2.0 * qy * qy_t
    else:
        big_u = rps_at(w, k + 4) + b1 * a
        big_v = rps_at(w, k + 8) + v1 * y + v2 * c
        big_w = rps_at(w, k + 20) + w1 * y + w2 * c
        e11 = x * x + y * y + a * a - big_w
        e12 = x * px + y * py + a * c - big_u
        e13 = x * qx + y * qy + a * a - big_v
        e22 = px * px + py * py + c * c - 1.0
        e23 = px * qx + py * qy + c * a
        e33 = qx * qx + qy * qy + a * a - 1.0
    # Derivatives of N by a, y, c.
    zero = 0.0 * a
    n11a, n11b, n11c = -2.0 * a, w1 - 2.0 * y, w2
    n12a, n12b, n12c = b1 - y * a1 - c, -py, -a
    n13a, n13b, n13c = -2.0 * a, v1 - qy - y * q1, v2 - y * q2
    n22a, n22c = -2.0 * py * a1, -2.0 * c
    n23a, n23b, n23c = -a1 * qy - c, -py * q1, -py * q2 - a
    n33a, n33b, n33c = -2.0 * a, -2.0 * qy * q1, -2.0 * qy * q2
    # Two directions across x take the three x out of the equations; the largest x divides.
    first = rps_square(x)
    second = rps_square(px)
    third = rps_square(qx)
    if first >= second and first >= third:
        xj, xk, xl = x, px, qx
        fjj, fjk, fjl, fkk, fkl, fll = e11, e12, e13, e22, e23, e33
        ajj, ajk, ajl, akk, akl, al = n11a, n12a, n13a, n22a, n23a, n33a
        bjj, bjk, bjl, bkk, bkl, bl = n11b, n12b, n13b, zero, n23b, n33b
        cjj, cjk, cjl, ckk, ckl, cl = n11c, n12c, n13c, n22c, n23c, n33c
    elif second >= third:
        xj, xk, xl = px, x, qx
        fjj, fjk, fjl, fkk, fkl, fll = e22, e12, e23, e11, e13, e33
        ajj, ajk, ajl, akk, akl, al = n22a, n12a, n23a, n11a, n13a, n33a
        bjj, bjk, bjl, bkk, bkl, bl = zero, n12b, n23b, n11b, n13b, n33b
        cjj, cjk, cjl, ckk, ckl, cl = n22c, n12c, n23c, n11c, n13c, n33c
    else:
        xj, xk, xl = qx, x, px
        fjj, fjk, fjl, fkk, fkl, fll = e33, e13, e23, e11, e12, e22
        ajj, ajk, ajl, akk, akl, al = n33a, n13a, n23a, n11a, n12a, n22a
        bjj, bjk, bjl, bkk, bkl, bl = n33b, n13b, n23b, n11b, n12b, zero
        cjj, cjk, cjl, ckk, ckl, cl = n33c, n13c, n23c, n11c, n12c, n22c
    unit = rps_reciprocal(xj)
    rk = xk * unit
    rl = xl * unit
    f1, f2, f3 = rps_across(fjj, fjk, fjl, fkk, fkl, fll, rk, rl)
    p1, p2, p3 = rps_across(ajj, ajk, ajl, akk, akl, al, rk, rl)
    o1, o2, o3 = rps_across(bjj, bjk, bjl, bkk, bkl, bl, rk, rl)
    s1, s2, s3 = rps_across(cjj, cjk, cjl, ckk, ckl, cl, rk, rl)
    # [p o s] (da, dy, dc) = f by Cramer's rule.
    m1 = o2 * s3 - o3 * s2
    m2 = o3 * s1 - o1 * s3
    m3 = o1 * s2 - o2 * s1
    scale = rps_reciprocal(p1 * m1 + p2 * m2 + p3 * m3)
    da = (f1 * m1 + f2 * m2 + f3 * m3) * scale
    m1 = f2 * s3 - f3 * s2
    m2 = f3 * s1 - f1 * s3
    m3 = f1 * s2 - f2 * s1
    dy = (p1 * m1 + p2 * m2 + p3 * m3) * scale
    m1 = o2 * f3 - o3 * f2
    m2 = o3 * f1 - o1 * f3
    m3 = o1 * f2 - o2 * f1
    dc = (p1 * m1 + p2 * m2 + p3 * m3) * scale
    dj = 0.5 * (ajj * da + bjj * dy + cjj * dc - fjj) * unit
    dk = (ajk * da + bjk * dy + cjk * dc - fjk - xk * dj) * unit
    dl = (ajl * da + bjl * dy + cjl * dc - fjl - xl * dj) * unit
    rps_put(w, out, da)
    rps_put(w, out + 2, dy)
    rps_put(w, out + 4, dc)
    if first >= second and first >= third:
        dx, dp, dq = dj, dk, dl
    elif second >= third:
        dx, dp, dq = dk, dj, dl
    else:
        dx, dp, dq = dk, dl, dj
    rps_put(w, out + 6, dp)
    rps_put(w, out + 8, dq)
    rps_put(w, out + 10, dx)
    moved = rps_square(da) + rps_square(dy) + rps_square(dc)
    moved += rps_square(dp) + rps_square(dq) + rps_square(dx)
    size = rps_square(a) + rps_square(y) + rps_square(c) + first + second + third
    return moved, size


def rps_corrected(w, at, steps, close):  # type: ignore[no-untyped-def]
    """Correct the state at ``at``; return the relative sizes of the first and the last step."""
    first = 0.0
    last = 0.0
    for n in range(steps):
        moved, size = rps_solve(w, at, False, rps_HERE + 60)
        for i in range(12):
            w[at + i] += w[rps_HERE + 60 + i]
        before = last
        last = math.sqrt(moved / (size + TINY))
        if n == 0:
            first = last
        elif not last < 0.3 * before:
            break
        if not last > close or not first < 1.0:
            break
    return first, last


def rps_follow(w, begin, end, straight, finer):  # type: ignore[no-untyped-def]
    """Follow the solution at ``begin`` along the path to ``end``; return whether it ends there."""
    here = rps_HERE
    rate = here + 12
    old = here + 24
    old_rate = here + 36
    ahead = here + 48
    for i in range(12):
        w[here + i] = w[begin + i]
    t = 0.0
    h = 0.02
    width = 0.0
    rps_along(w, 0.0, straight)
    rps_corrected(w, here, 6, 1e-12)
    rps_solve(w, here, True, rate)
    for _ in range(rps_STEPS):
        h = h if h < 1.0 - t else 1.0 - t
        at = t + h if h < 1.0 - t else 1.0
        # Cubic through the last two states with their rates; at first along the rate.
        for i in range(12):
            value = w[here + i] + h * w[rate + i]
            if width > 0.0:
                share = h / width
                a = w[old + i] - w[here + i] + width * w[rate + i]
                b = width * (w[old_rate + i] - w[rate + i])
                value += share * share * (3.0 * a + b + share * (2.0 * a + b))
            w[ahead + i] = value
        rps_along(w, at, straight)
        first, last = rps_corrected(w, ahead, 4, 1e-7)
        if not (first <= rps_FAR * finer and last <= 1e-6):
            h *= 0.4
            if h < 1e-13:
                return False
            continue
        for i in range(12):
            w[old + i] = w[here + i]
            w[old_rate + i] = w[rate + i]
            w[here + i] = w[ahead + i]
        width = h
        t = at
        if t >= 1.0:
            break
        rps_solve(w, here, True, rate)
        growth = 0.8 * math.sqrt(math.sqrt(rps_AIM * finer / (first + 1e-12)))
        growth = growth if growth < 3.0 else 3.0
        h *= growth if growth > 0.5 else 0.5
    if t < 1.0:
        return False
    rps_corrected(w, here, 12, 4.0 * EPS)
    for i in range(12):
        w[end + i] = w[here + i]
    return True


def rps_apart(w, i, j, conjugate):  # type: ignore[no-untyped-def]
    """Return how far two ends are apart, the sign of the x left free, over their size."""
    same = 0.0
    other = 0.0
    size = 0.0
    for k in range(12):
        u = w[i + k]
        v = w[j + k]
        v = -v if conjugate and k % 2 == 1 else v
        same += (u - v) * (u - v)
        v = -v if k >= 6 else v
        other += (u - v) * (u - v)
        size += u * u
    return math.sqrt((same if same < other else other) / (size + TINY))


def rps_sound(w):  # type: ignore[no-untyped-def]
    """Return whether ends are distinct and the conjugate of each is one, as far as rounding says.

    Next to a multiple solution neither says much: ends within 1e-5 of real pass.
    """
    for i in range(rps_PATHS):
        at = rps_END + 12 * i
        partner = False
        for j in range(rps_PATHS):
            other = rps_END + 12 * j
            if j < i and not rps_apart(w, at, other, False) > 1e-10:
                return False
            if rps_apart(w, at, other, True) < 1e-5:
                partner = True
        if not partner:
            return False
    return True


def rps_equations(w, constants, lengths):  # type: ignore[no-untyped-def]
    """Put the misses of the squares of the lengths and their slopes in place; return the largest.

    By P_x, P_y and turns about x, y, z; lengths are over the largest of them and r.
    """
    k = rps_STATE
    x, y = w[k], w[k + 1]
    px, py, pz, qx, qy, qz = w[k + 2], w[k + 3], w[k + 4], w[k + 5], w[k + 6], w[k + 7]
    size = w[rps_NOW]
    r = w[rps_NOW + 1]
    worst = 0.0
    total = 0.0
    for i in range(5):
        sine, cosine, ty, tz = rps_limb(w, i)
        sx, sy, sz = sine * px - cosine * qx, sine * py - cosine * qy, sine * pz - cosine * qz
        sx, sy, sz = r * sx, r * sy, r * sz
        lx, ly, lz = x + sx, y + sy - ty, r * qz + sz - tz
        length = lengths[i] / size
        f = lx * lx + ly * ly + lz * lz - length * length
        w[k + 8 + i] = f
        worst = abs(f) if abs(f) > worst else worst
        total += abs(f)
        j = k + 13 + 5 * i
        w[j] = 2.0 * lx
        w[j + 1] = 2.0 * ly
        # P_z follows r q_z.
        w[j + 2] = 2.0 * (sy * lz - sz * ly + r * lz * qy)
        w[j + 3] = 2.0 * (sz * lx - sx * lz - r * lz * qx)
        w[j + 4] = 2.0 * (sx * ly - sy * lx)
    # Not a number if any is not.
    return worst + 0.0 * total


def rps_limb(w, i):  # type: ignore[no-untyped-def]
    """Return sine and cosine of s_k and T_k of a limb, over the size."""
    big = w[rps_NOW + 2]
    h = w[rps_NOW + 3]
    if i == 0:
        return 0.0, 1.0, big, 0.0
    sine = rps_S1 if i == 1 or i == 4 else rps_S2
    cosine = rps_C1 if i == 1 or i == 4 else rps_C2
    return (
        sine if i < 3 else -sine,
        cosine,
        h if i == 1 or i == 4 else -h,
        h if i < 3 else -h,
    )


def rps_inverse(w):  # type: ignore[no-untyped-def]
    """Put the slope's inverse in place by elimination with pivots; return whether there is one."""
    j = rps_STATE + 13
    v = rps_STATE + 38
    for i in range(25):
        w[v + i] = 1.0 if i % 6 == 0 else 0.0
    for column in range(5):
        best = column
        for row in range(column + 1, 5):
            if abs(w[j + 5 * row + column]) > abs(w[j + 5 * best + column]):
                best = row
        if not abs(w[j + 5 * best + column]) > TINY:
            return False
        for i in range(5):
            value = w[j + 5 * best + i]
            w[j + 5 * best + i] = w[j + 5 * column + i]
            w[j + 5 * column + i] = value
            value = w[v + 5 * best + i]
            w[v + 5 * best + i] = w[v + 5 * column + i]
            w[v + 5 * column + i] = value
        unit = 1.0 / w[j + 5 * column + column]
        for i in range(5):
            w[j + 5 * column + i] *= unit
            w[v + 5 * column + i] *= unit
        for row in range(5):
            factor = w[j + 5 * row + column]
            if row != column:
                for i in range(5):
                    w[j + 5 * row + i] -= factor * w[j + 5 * column + i]
                    w[v + 5 * row + i] -= factor * w[v + 5 * column + i]
    return True


def rps_move(w, at, x, y, rx, ry, rz):  # type: ignore[no-untyped-def]
    """Set the state to that at ``at``, moved by (x, y) and turned, to second order of a turn."""
    k = rps_STATE
    w[k] = w[at] + x
    w[k + 1] = w[at + 1] + y
    px, py, pz = w[at + 2], w[at + 3], w[at + 4]
    qx, qy, qz = w[at + 5], w[at + 6], w[at + 7]
    ux, uy, uz = ry * pz - rz * py, rz * px - rx * pz, rx * py - ry * px
    vx, vy, vz = ry * qz - rz * qy, rz * qx - rx * qz, rx * qy - ry * qx
    px += ux + 0.5 * (ry * uz - rz * uy)
    py += uy + 0.5 * (rz * ux - rx * uz)
    pz += uz + 0.5 * (rx * uy - ry * ux)
    qx += vx + 0.5 * (ry * vz - rz * vy)
    qy += vy + 0.5 * (rz * vx - rx * vz)
    qz += vz + 0.5 * (rx * vy - ry * vx)
    unit = 1.0 / math.sqrt(px * px + py * py + pz * pz)
    px *= unit
    py *= unit
    pz *= unit
    along = px * qx + py * qy + pz * qz
    qx -= along * px
    qy -= along * py
    qz -= along * pz
    unit = 1.0 / math.sqrt(qx * qx + qy * qy + qz * qz)
    w[k + 2], w[k + 3], w[k + 4] = px, py, pz
    w[k + 5], w[k + 6], w[k + 7] = unit * qx, unit * qy, unit * qz


def rps_newton(w, constants, lengths):  # type: ignore[no-untyped-def]
    """Move the state to a solution; return the largest miss of a length's square there."""
    worst = rps_equations(w, constants, lengths)
    k = rps_STATE
    v = k + 38
    before = rps_HERE
    idle = 0
    for _ in range(60):
        for i in range(8):
            w[before + i] = w[k + i]
        if not rps_inverse(w):
            break
        total = 0.0
        for i in range(5):
            step = 0.0
            for j in range(5):
                step -= w[v + 5 * i + j] * w[k + 8 + j]
            w[before + 8 + i] = step
            total += step * step
        size = math.sqrt(total)
        shorter = 0.4 / size if size > 0.4 else 1.0
        b = before + 8
        rps_move(
            w, before, shorter * w[b], shorter * w[b + 1],
            shorter * w[b + 2], shorter * w[b + 3], shorter * w[b + 4],
        )  # fmt: skip
        miss = rps_equations(w, constants, lengths)
        if miss < rps_CLOSE and miss >= 0.5 * worst:
            # Nothing is left but rounding: two such steps, then the better of both states.
            idle += 1
            if miss >= worst:
                for i in range(8):
                    w[k + i] = w[before + i]
                miss = rps_equations(w, constants, lengths)
            if idle > 1 or size < EPS:
                worst = miss
                break
        worst = miss
        if size <= 0.25 * EPS:
            break
    return worst


def rps_keep(w, constants, lengths, count):  # type: ignore[no-untyped-def]
    """Keep the state if it solves the equations and is new; return how many are kept.

    A state and its mirror image, -x, are kept as one.
    """
    if not rps_newton(w, constants, lengths) <= rps_CLOSE:
        return count
    rps_equations(w, constants, lengths)
    # What a miss by rounding moves the solution by.
    radius = 1e-5
    if rps_inverse(w):
        total = 0.0
        for i in range(25):
            total += w[rps_STATE + 38 + i] * w[rps_STATE + 38 + i]
        radius = 16.0 * EPS * (1.0 + math.sqrt(total))
        radius = radius if radius < 1e-5 else 1e-5
    for k in range(count):
        at = rps_FOUND + rps_KEPT * k
        same = 0.0
        other = 0.0
        for i in range(8):
            gap = w[at + i] - w[rps_STATE + i]
            same += gap * gap
            if i == 0 or i == 2 or i == 5:
                gap = w[at + i] + w[rps_STATE + i]
            other += gap * gap
        if math.sqrt(same if same < other else other) <= radius + w[at + 8]:
            return count
    if count == rps_PATHS:
        return count
    at = rps_FOUND + rps_KEPT * count
    for i in range(8):
        w[at + i] = w[rps_STATE + i]
    w[at + 8] = radius
    return count + 1


def rps_twin(w, constants, lengths, k):  # type: ignore[no-untyped-def]
    """Move the state to where mode k may have a twin; return whether it may."""
    at = rps_FOUND + rps_KEPT * k
    for i in range(8):
        w[rps_STATE + i] = w[at + i]
    rps_equations(w, constants, lengths)
    if not rps_inverse(w):
        return False
    v = rps_STATE + 38
    best = 0.0
    row = 0
    column = 0
    for i in range(25):
        if abs(w[v + i]) > best:
            best = abs(w[v + i])
            row = i // 5
            column = i % 5
    total = 0.0
    for i in range(5):
        total += w[v + 5 * i + column] * w[v + 5 * i + column]
    unit = 1.0 / math.sqrt(total)
    b = rps_HERE
    for i in range(5):
        w[b + i] = unit * w[v + 5 * i + column]
        w[b + 5 + i] = w[v + 5 * row + i]
    # The inverse's row times the slope is the axis ``row``.
    along = w[b + row]
    bend = 0.0
    step = 1e-3
    for side in range(2):
        way = step if side == 0 else -step
        rps_move(w, at, way * w[b], way * w[b + 1], way * w[b + 2], way * w[b + 3], way * w[b + 4])
        rps_equations(w, constants, lengths)
        for i in range(5):
            bend += w[b + 5 + i] * w[rps_STATE + 8 + i]
    bend /= step * step
    if not abs(along) < 0.15 * abs(bend):
        return False
    away = -2.0 * along / bend
    rps_move(w, at, away * w[b], away * w[b + 1], away * w[b + 2], away * w[b + 3], away * w[b + 4])
    return True


def rps_write(w, at, side, constants, lengths, out):  # type: ignore[no-untyped-def]
    """Write pose, z, residual and distance from home of a kept state or its mirror image."""
    for i in range(8):
        w[rps_STATE + i] = w[at + i]
    size = w[rps_NOW]
    px, py, pz = side * w[at + 2], w[at + 3], w[at + 4]
    qx, qy, qz = side * w[at + 5], w[at + 6], w[at + 7]
    nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    alpha, beta, gamma = assembly_angles((nx, px, qx, ny, py, qy, nz, pz, qz))
    small = constants[2]
    x = side * size * w[at]
    y = size * w[at + 1]
    z = small * qz
    worst = 0.0
    for i in range(5):
        sine, cosine, ty, tz = rps_limb(w, i)
        lx = x + small * (sine * px - cosine * qx)
        ly = y + small * (sine * py - cosine * qy) - size * ty
        lz = z + small * (sine * pz - cosine * qz) - size * tz
        miss = abs(math.sqrt(lx * lx + ly * ly + lz * lz) - lengths[i])
        worst = miss if miss > worst else worst
    out[0] = x
    out[1] = y
    out[2] = alpha
    out[3] = beta
    out[4] = gamma
    out[5] = z
    out[6] = worst
    away = (x - constants[3]) * (x - constants[3]) + (y - constants[4]) * (y - constants[4])
    for i in range(3):
        gap = out[2 + i] - constants[5 + i]
        gap -= 6.283185307179586 * math.floor(gap / 6.283185307179586 + 0.5)
        away += small * small * gap * gap
    out[7] = away


def rps_prepare(w, constants):  # type: ignore[no-untyped-def]
    """Follow the known solutions to the mechanism's dimensions and general lengths; once."""
    big = constants[0] / constants[2]
    h = constants[1] / constants[2]
    for i in range(14):
        w[rps_FROM + i] = constants[8 + i]
        w[rps_TO + i] = 0.0
    w[rps_TO] = big
    w[rps_TO + 2] = h
    scale = (big * big + 2.0 * h * h + 1.0) / 24.0
    for i in range(4, 14):
        w[rps_TO + i] = scale * constants[8 + i]
    for k in range(rps_PATHS):
        begin = rps_BEGIN + 12 * k
        for i in range(12):
            w[rps_END + 12 * k + i] = constants[22 + 12 * k + i]
        if not rps_follow(w, rps_END + 12 * k, begin, False, 0.3):
            rps_follow(w, rps_END + 12 * k, begin, False, 0.01)


def rps_assemble(joints, constants, found, w):  # type: ignore[no-untyped-def]
    """Write the assembly modes, a row each; return how many and that they are not proven all.

    Parameters
    ----------
    joints : (5,)
    constants : (238,)
        R1, R / sqrt 2, r, home (5), :data:`DIMENSIONS` (14) and :data:`STARTS` (18 x 12).
    found : (36, 8)
        x, y, alpha, beta, gamma, z, the largest miss of a length, what they are sorted by.
    w : (rps_WORK,)
        Scratch space; keeps what depends on the dimensions from call to call.
    """
    if w[0] == 0.0:
        rps_prepare(w, constants)
        w[0] = 1.0
    small = constants[2]
    size = small
    for i in range(5):
        if joints[i] < 0.0:
            return 0, True
        size = joints[i] if joints[i] > size else size
    for i in range(14):
        w[rps_NOW + i] = w[rps_TO + i]
    rps_coefficients(w, rps_HEAD)
    for i in range(5):
        length = joints[i] / small
        w[rps_NOW + 4 + 2 * i] = length * length
        w[rps_NOW + 5 + 2 * i] = 0.0
    rps_coefficients(w, rps_HEAD + 26)
    for attempt in range(3):
        finer = 1.0 if attempt == 0 else (0.1 if attempt == 1 else 0.01)
        sound = True
        for k in range(rps_PATHS):
            end = rps_END + 12 * k
            if not rps_follow(w, rps_BEGIN + 12 * k, end, True, finer):
                for i in range(12):
                    w[end + i] = w[rps_HERE + i]
                sound = False
        if sound and rps_sound(w):
            break
    w[rps_NOW] = size
    w[rps_NOW + 1] = small / size
    w[rps_NOW + 2] = constants[0] / size
    w[rps_NOW + 3] = constants[1] / size
    count = 0
    for k in range(rps_PATHS):
        end = rps_END + 12 * k
        apart = 0.0
        for i in range(6):
            part = abs(w[end + 2 * i + 1])
            apart = part if part > apart else apart
        if apart < rps_REAL:
            # Of P, p and q only the directions count.
            w[rps_HERE] = w[end + 10] * small / size
            w[rps_HERE + 1] = w[end + 2] * small / size
            w[rps_HERE + 2] = w[end + 6]
            w[rps_HERE + 3] = w[rps_HEAD + 26] + w[rps_HEAD + 26 + 2] * w[end]
            w[rps_HERE + 4] = w[end + 4]
            w[rps_HERE + 5] = w[end + 8]
            w[rps_HERE + 6] = w[rps_HEAD + 26 + 14]
            w[rps_HERE + 6] += (
                w[rps_HEAD + 26 + 16] * w[end + 2] + w[rps_HEAD + 26 + 18] * w[end + 4]
            )
            w[rps_HERE + 7] = w[end]
            rps_move(w, rps_HERE, 0.0, 0.0, 0.0, 0.0, 0.0)
            count = rps_keep(w, constants, joints, count)
    m = 0
    while m < count:
        if rps_twin(w, constants, joints, m):
            count = rps_keep(w, constants, joints, count)
        m += 1
    total = 0
    for m in range(count):
        at = rps_FOUND + rps_KEPT * m
        rps_write(w, at, 1.0, constants, joints, found[total])
        total += 1
        flat = math.sqrt(w[at] * w[at] + w[at + 2] * w[at + 2] + w[at + 5] * w[at + 5])
        # All in the plane of the base: the mode is its own mirror image.
        if flat > w[at + 8]:
            rps_write(w, at, -1.0, constants, joints, found[total])
            total += 1
    assembly_sort(found, total, 8)
    return total, False

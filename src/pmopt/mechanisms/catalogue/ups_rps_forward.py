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
from typing import NamedTuple

from pmopt.kernels.assembly import (
    ASSEMBLY_STEP,
    assembly_angles,
    assembly_apart,
    assembly_principal,
    assembly_sort,
)
from pmopt.kernels.vectors import Rotation, Vec3

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

# Places in the scratch space; its first number says whether starts are there.
rps_BEGIN = 1  # states that paths begin with, and that they end in
rps_END = rps_BEGIN + 12 * rps_PATHS
rps_MISSES = rps_END + 12 * rps_PATHS  # of the five lengths
rps_SLOPE = rps_MISSES + 5  # of them by P_x, P_y and turns, and its inverse
rps_INVERSE = rps_SLOPE + 25
rps_WAY = rps_INVERSE + 25  # what is hardly moved and hardly reached near a singularity
rps_WEIGHTS = rps_WAY + 5
rps_FOUND = rps_WEIGHTS + 5
rps_WORK = rps_FOUND + rps_PATHS * rps_KEPT


class Dimensions(NamedTuple):
    """Complex dimensions and lengths, over r."""

    big: complex  # R1
    h: complex  # R / sqrt 2
    l1: complex  # squares of the lengths
    l2: complex
    l3: complex
    l4: complex
    l5: complex


class Coefficients(NamedTuple):
    """What the dimensions and lengths give; complex. See above."""

    a0: complex
    a1: complex
    b0: complex
    b1: complex
    v0: complex
    v1: complex
    v2: complex
    q0: complex
    q1: complex
    q2: complex
    w0: complex
    w1: complex
    w2: complex


class State(NamedTuple):
    """The complex unknowns: a = q_z, y = P_y, c = p_z, then p_x, q_x and P_x."""

    a: complex
    y: complex
    c: complex
    p: complex
    q: complex
    x: complex


class Symmetric(NamedTuple):
    """A symmetric matrix, rows j, k, l."""

    jj: complex
    jk: complex
    jl: complex
    kk: complex
    kl: complex
    ll: complex


class Step(NamedTuple):
    """A change of a state, and the squares of its size and of the state's."""

    change: State
    moved: float
    size: float


class Corrected(NamedTuple):
    """A state after Newton's method, and the relative sizes of its first and last step."""

    state: State
    first: float
    last: float


class Ended(NamedTuple):
    """How far a path was followed, and whether to its end."""

    state: State
    there: bool


class Path(NamedTuple):
    """A way from one set of dimensions and lengths to another.

    Where only lengths change the coefficients change evenly: ``straight``.
    """

    low: Dimensions
    high: Dimensions
    start: Coefficients
    end: Coefficients
    rates: Coefficients  # where it is straight
    straight: bool


class Place(NamedTuple):
    """A platform over the size: P_x, P_y, and the directions p and q."""

    x: float
    y: float
    p: Vec3
    q: Vec3


class Scale(NamedTuple):
    """The longest of the lengths and r, and the dimensions over it."""

    size: float
    r: float
    big: float
    h: float


def rps_load(w, k):  # type: ignore[no-untyped-def]
    """Return a state of the scratch space."""
    return State(
        complex(w[k], w[k + 1]), complex(w[k + 2], w[k + 3]), complex(w[k + 4], w[k + 5]),
        complex(w[k + 6], w[k + 7]), complex(w[k + 8], w[k + 9]), complex(w[k + 10], w[k + 11]),
    )  # fmt: skip


def rps_store(w, k, state):  # type: ignore[no-untyped-def]
    """Put a state into the scratch space."""
    for i in range(6):
        w[k + 2 * i] = state[i].real
        w[k + 2 * i + 1] = state[i].imag


def rps_times(t, value):  # type: ignore[no-untyped-def]
    """Return a complex number times a real one."""
    return complex(t * value.real, t * value.imag)


def rps_square(value):  # type: ignore[no-untyped-def]
    """Return the square of a complex number's size."""
    return value.real * value.real + value.imag * value.imag


def rps_reciprocal(value):  # type: ignore[no-untyped-def]
    """Return 1 / value, 0 of 0: numba's own division raises there, which kernels may not."""
    unit = 1.0 / (value.real * value.real + value.imag * value.imag + TINY)
    return complex(unit * value.real, -unit * value.imag)


def rps_coefficients(at):  # type: ignore[no-untyped-def]
    """Return the coefficients for dimensions and lengths."""
    big, h, l1, l2, l3, l4, l5 = at
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
    return Coefficients(
        a0=a0,
        a1=a1 + 0.0j,
        b0=h * a0 + 0.25 * d25,
        b1=h * (a1 + t1),
        v0=v0,
        v1=v1,
        v2=v2,
        q0=q0,
        q1=q1,
        q2=q2,
        w0=m1 + 2.0 * v0 - 2.0 * big * q0,
        w1=2.0 * v1 + 2.0 * big - 2.0 * big * q1,
        w2=2.0 * v2 - 2.0 * big * q2,
    )


def rps_between(t, low, high):  # type: ignore[no-untyped-def]
    """Return the complex number at a share of the way from one to another."""
    return low + rps_times(t, high - low)


def rps_mix(path, t):  # type: ignore[no-untyped-def]
    """Return the dimensions and lengths at a place of a path."""
    low, high = path.low, path.high
    return Dimensions(
        rps_between(t, low.big, high.big),
        rps_between(t, low.h, high.h),
        rps_between(t, low.l1, high.l1),
        rps_between(t, low.l2, high.l2),
        rps_between(t, low.l3, high.l3),
        rps_between(t, low.l4, high.l4),
        rps_between(t, low.l5, high.l5),
    )


def rps_changed(at, other):  # type: ignore[no-untyped-def]
    """Return the difference of two sets of coefficients."""
    return Coefficients(
        at.a0 - other.a0, at.a1 - other.a1, at.b0 - other.b0, at.b1 - other.b1,
        at.v0 - other.v0, at.v1 - other.v1, at.v2 - other.v2,
        at.q0 - other.q0, at.q1 - other.q1, at.q2 - other.q2,
        at.w0 - other.w0, at.w1 - other.w1, at.w2 - other.w2,
    )  # fmt: skip


def rps_by(at, divisor):  # type: ignore[no-untyped-def]
    """Return coefficients over a real number."""
    return Coefficients(
        rps_over(at.a0, divisor), rps_over(at.a1, divisor),
        rps_over(at.b0, divisor), rps_over(at.b1, divisor),
        rps_over(at.v0, divisor), rps_over(at.v1, divisor), rps_over(at.v2, divisor),
        rps_over(at.q0, divisor), rps_over(at.q1, divisor), rps_over(at.q2, divisor),
        rps_over(at.w0, divisor), rps_over(at.w1, divisor), rps_over(at.w2, divisor),
    )  # fmt: skip


def rps_over(value, divisor):  # type: ignore[no-untyped-def]
    """Return a complex number over a real one."""
    return complex(value.real / divisor, value.imag / divisor)


def rps_along(path, t):  # type: ignore[no-untyped-def]
    """Return the coefficients at a place of a path."""
    if not path.straight:
        return rps_coefficients(rps_mix(path, t))
    if t == 1.0:
        return path.end
    at, rates = path.start, path.rates
    return Coefficients(
        at.a0 + rps_times(t, rates.a0), at.a1 + rps_times(t, rates.a1),
        at.b0 + rps_times(t, rates.b0), at.b1 + rps_times(t, rates.b1),
        at.v0 + rps_times(t, rates.v0), at.v1 + rps_times(t, rates.v1),
        at.v2 + rps_times(t, rates.v2),
        at.q0 + rps_times(t, rates.q0), at.q1 + rps_times(t, rates.q1),
        at.q2 + rps_times(t, rates.q2),
        at.w0 + rps_times(t, rates.w0), at.w1 + rps_times(t, rates.w1),
        at.w2 + rps_times(t, rates.w2),
    )  # fmt: skip


def rps_rates(path, t):  # type: ignore[no-untyped-def]
    """Return the rates of the coefficients at a place of a path."""
    if path.straight:
        return path.rates
    step = 1e-4
    ahead = rps_coefficients(rps_mix(path, t + step))
    behind = rps_coefficients(rps_mix(path, t - step))
    return rps_by(rps_changed(ahead, behind), 2.0 * step)


def rps_path(low, high, straight):  # type: ignore[no-untyped-def]
    """Return the path between two sets of dimensions and lengths."""
    start, end = rps_coefficients(low), rps_coefficients(high)
    return Path(low, high, start, end, rps_changed(end, start), straight)


def rps_across(m, rk, rl):  # type: ignore[no-untyped-def]
    """Return a symmetric matrix between the two directions across x; rk, rl are x_k, x_l by x_j."""
    return (
        m.kk - 2.0 * rk * m.jk + rk * rk * m.jj,
        m.kl - rl * m.jk - rk * m.jl + rk * rl * m.jj,
        m.ll - 2.0 * rl * m.jl + rl * rl * m.jj,
    )


def rps_missed(at, k):  # type: ignore[no-untyped-def]
    """Return the miss of x x^T = N; rows P, p, q."""
    a, y, c, px, qx, x = at
    py = k.a0 + k.a1 * a
    qy = k.q0 + k.q1 * y + k.q2 * c
    big_u = k.b0 + k.b1 * a
    big_v = k.v0 + k.v1 * y + k.v2 * c
    big_w = k.w0 + k.w1 * y + k.w2 * c
    return Symmetric(
        x * x + y * y + a * a - big_w,
        x * px + y * py + a * c - big_u,
        x * qx + y * qy + a * a - big_v,
        px * px + py * py + c * c - 1.0,
        px * qx + py * qy + c * a,
        qx * qx + qy * qy + a * a - 1.0,
    )


def rps_drift(at, k, rates):  # type: ignore[no-untyped-def]
    """Return minus the rate of N with the coefficients."""
    a, y, c = at.a, at.y, at.c
    py = k.a0 + k.a1 * a
    qy = k.q0 + k.q1 * y + k.q2 * c
    py_t = rates.a0 + rates.a1 * a
    qy_t = rates.q0 + rates.q1 * y + rates.q2 * c
    w_t = rates.w0 + rates.w1 * y + rates.w2 * c
    v_t = rates.v0 + rates.v1 * y + rates.v2 * c
    u_t = rates.b0 + rates.b1 * a
    return Symmetric(
        -w_t,
        y * py_t - u_t,
        y * qy_t - v_t,
        2.0 * py * py_t,
        py_t * qy + py * qy_t,
        2.0 * qy * qy_t,
    )


def rps_solve(at, k, miss):  # type: ignore[no-untyped-def]
    """Return the change of a state that makes up for a miss, or for a drift."""
    a, y, c, px, qx, x = at
    e11, e12, e13, e22, e23, e33 = miss
    a1, b1, v1, v2, q1, q2, w1, w2 = k.a1, k.b1, k.v1, k.v2, k.q1, k.q2, k.w1, k.w2
    py = k.a0 + a1 * a
    qy = k.q0 + q1 * y + q2 * c
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
        f = Symmetric(e11, e12, e13, e22, e23, e33)
        n_a = Symmetric(n11a, n12a, n13a, n22a, n23a, n33a)
        n_b = Symmetric(n11b, n12b, n13b, zero, n23b, n33b)
        n_c = Symmetric(n11c, n12c, n13c, n22c, n23c, n33c)
    elif second >= third:
        xj, xk, xl = px, x, qx
        f = Symmetric(e22, e12, e23, e11, e13, e33)
        n_a = Symmetric(n22a, n12a, n23a, n11a, n13a, n33a)
        n_b = Symmetric(zero, n12b, n23b, n11b, n13b, n33b)
        n_c = Symmetric(n22c, n12c, n23c, n11c, n13c, n33c)
    else:
        xj, xk, xl = qx, x, px
        f = Symmetric(e33, e13, e23, e11, e12, e22)
        n_a = Symmetric(n33a, n13a, n23a, n11a, n12a, n22a)
        n_b = Symmetric(n33b, n13b, n23b, n11b, n12b, zero)
        n_c = Symmetric(n33c, n13c, n23c, n11c, n12c, n22c)
    unit = rps_reciprocal(xj)
    rk = xk * unit
    rl = xl * unit
    f1, f2, f3 = rps_across(f, rk, rl)
    p1, p2, p3 = rps_across(n_a, rk, rl)
    o1, o2, o3 = rps_across(n_b, rk, rl)
    s1, s2, s3 = rps_across(n_c, rk, rl)
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
    dj = 0.5 * (n_a.jj * da + n_b.jj * dy + n_c.jj * dc - f.jj) * unit
    dk = (n_a.jk * da + n_b.jk * dy + n_c.jk * dc - f.jk - xk * dj) * unit
    dl = (n_a.jl * da + n_b.jl * dy + n_c.jl * dc - f.jl - xl * dj) * unit
    if first >= second and first >= third:
        dx, dp, dq = dj, dk, dl
    elif second >= third:
        dx, dp, dq = dk, dj, dl
    else:
        dx, dp, dq = dk, dl, dj
    moved = rps_square(da) + rps_square(dy) + rps_square(dc)
    moved += rps_square(dp) + rps_square(dq) + rps_square(dx)
    size = rps_square(a) + rps_square(y) + rps_square(c) + first + second + third
    return Step(State(da, dy, dc, dp, dq, dx), moved, size)


def rps_stepped(at, change):  # type: ignore[no-untyped-def]
    """Return a state and a change more."""
    return State(
        at.a + change.a, at.y + change.y, at.c + change.c,
        at.p + change.p, at.q + change.q, at.x + change.x,
    )  # fmt: skip


def rps_corrected(state, k, steps, close):  # type: ignore[no-untyped-def]
    """Return a state after at most so many steps of Newton's method."""
    first = 0.0
    last = 0.0
    for n in range(steps):
        step = rps_solve(state, k, rps_missed(state, k))
        state = rps_stepped(state, step.change)
        before = last
        last = math.sqrt(step.moved / (step.size + TINY))
        if n == 0:
            first = last
        elif not last < 0.3 * before:
            break
        if not last > close or not first < 1.0:
            break
    return Corrected(state, first, last)


class Track(NamedTuple):
    """A state on a path with its rate, those of the last place, and how far back that is."""

    here: State
    rate: State
    old: State
    old_rate: State
    width: float


def rps_cubic(here, rate, old, old_rate, h, width):  # type: ignore[no-untyped-def]
    """Return a number h ahead, by a cubic through the last two with their rates."""
    value = here + h * rate
    if width > 0.0:
        share = h / width
        a = old - here + width * rate
        b = width * (old_rate - rate)
        value += share * share * (3.0 * a + b + share * (2.0 * a + b))
    return value


def rps_next(here, rate, old, old_rate, h, width):  # type: ignore[no-untyped-def]
    """Return an unknown h ahead; at first along the rate."""
    return complex(
        rps_cubic(here.real, rate.real, old.real, old_rate.real, h, width),
        rps_cubic(here.imag, rate.imag, old.imag, old_rate.imag, h, width),
    )


def rps_ahead(track, h):  # type: ignore[no-untyped-def]
    """Return the state h ahead."""
    here, rate, old, old_rate, width = track
    return State(
        rps_next(here.a, rate.a, old.a, old_rate.a, h, width),
        rps_next(here.y, rate.y, old.y, old_rate.y, h, width),
        rps_next(here.c, rate.c, old.c, old_rate.c, h, width),
        rps_next(here.p, rate.p, old.p, old_rate.p, h, width),
        rps_next(here.q, rate.q, old.q, old_rate.q, h, width),
        rps_next(here.x, rate.x, old.x, old_rate.x, h, width),
    )


def rps_follow(begin, path, finer):  # type: ignore[no-untyped-def]
    """Follow a solution along a path; return where it ends."""
    t = 0.0
    h = 0.02
    k = rps_along(path, 0.0)
    here = rps_corrected(begin, k, 6, 1e-12).state
    rate = rps_solve(here, k, rps_drift(here, k, rps_rates(path, 0.0))).change
    track = Track(here, rate, here, rate, 0.0)
    for _ in range(rps_STEPS):
        h = h if h < 1.0 - t else 1.0 - t
        at = t + h if h < 1.0 - t else 1.0
        k = rps_along(path, at)
        there = rps_corrected(rps_ahead(track, h), k, 4, 1e-7)
        if not (there.first <= rps_FAR * finer and there.last <= 1e-6):
            h *= 0.4
            if h < 1e-13:
                return Ended(track.here, False)
            continue
        t = at
        here = there.state
        rate = track.rate
        if t < 1.0:
            rate = rps_solve(here, k, rps_drift(here, k, rps_rates(path, t))).change
        track = Track(here, rate, track.here, track.rate, h)
        if t >= 1.0:
            break
        growth = 0.8 * math.sqrt(math.sqrt(rps_AIM * finer / (there.first + 1e-12)))
        growth = growth if growth < 3.0 else 3.0
        h *= growth if growth > 0.5 else 0.5
    if t < 1.0:
        return Ended(track.here, False)
    return Ended(rps_corrected(track.here, k, 12, 4.0 * EPS).state, True)


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


def rps_equations(w, at, scale, lengths):  # type: ignore[no-untyped-def]
    """Put the misses of the squares of the lengths and their slopes in place; return the largest.

    By P_x, P_y and turns about x, y, z; lengths are over the largest of them and r.
    """
    p, q, r = at.p, at.q, scale.r
    worst = 0.0
    total = 0.0
    for i in range(5):
        sine, cosine, ty, tz = rps_limb(scale, i)
        sx, sy, sz = sine * p.x - cosine * q.x, sine * p.y - cosine * q.y, sine * p.z - cosine * q.z
        sx, sy, sz = r * sx, r * sy, r * sz
        lx, ly, lz = at.x + sx, at.y + sy - ty, r * q.z + sz - tz
        length = lengths[i] / scale.size
        f = lx * lx + ly * ly + lz * lz - length * length
        w[rps_MISSES + i] = f
        worst = abs(f) if abs(f) > worst else worst
        total += abs(f)
        j = rps_SLOPE + 5 * i
        w[j] = 2.0 * lx
        w[j + 1] = 2.0 * ly
        # P_z follows r q_z.
        w[j + 2] = 2.0 * (sy * lz - sz * ly + r * lz * q.y)
        w[j + 3] = 2.0 * (sz * lx - sx * lz - r * lz * q.x)
        w[j + 4] = 2.0 * (sx * ly - sy * lx)
    # Not a number if any is not.
    return worst + 0.0 * total


def rps_limb(scale, i):  # type: ignore[no-untyped-def]
    """Return sine and cosine of s_k and T_k of a limb, over the size."""
    big, h = scale.big, scale.h
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
    j = rps_SLOPE
    v = rps_INVERSE
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


def rps_move(at, x, y, turn):  # type: ignore[no-untyped-def]
    """Return a place, moved by (x, y) and turned, to second order of a turn."""
    rx, ry, rz = turn.x, turn.y, turn.z
    px, py, pz = at.p.x, at.p.y, at.p.z
    qx, qy, qz = at.q.x, at.q.y, at.q.z
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
    return Place(at.x + x, at.y + y, Vec3(px, py, pz), Vec3(unit * qx, unit * qy, unit * qz))


def rps_moved(w, at, step):  # type: ignore[no-untyped-def]
    """Return a place, moved by a step times the way that is in place."""
    b = rps_WAY
    turn = Vec3(step * w[b + 2], step * w[b + 3], step * w[b + 4])
    return rps_move(at, step * w[b], step * w[b + 1], turn)


def rps_newton(w, at, scale, lengths):  # type: ignore[no-untyped-def]
    """Return the solution that Newton's method leads to, and the largest miss there.

    Misses are those of the lengths' squares.
    """
    worst = rps_equations(w, at, scale, lengths)
    idle = 0
    for _ in range(60):
        before = at
        if not rps_inverse(w):
            break
        total = 0.0
        for i in range(5):
            step = 0.0
            for j in range(5):
                step -= w[rps_INVERSE + 5 * i + j] * w[rps_MISSES + j]
            w[rps_WAY + i] = step
            total += step * step
        size = math.sqrt(total)
        at = rps_moved(w, before, 0.4 / size if size > 0.4 else 1.0)
        miss = rps_equations(w, at, scale, lengths)
        if miss < rps_CLOSE and miss >= 0.5 * worst:
            # Nothing is left but rounding: two such steps, then the better of both states.
            idle += 1
            if miss >= worst:
                at = before
                miss = rps_equations(w, at, scale, lengths)
            if idle > 1 or size < EPS:
                worst = miss
                break
        worst = miss
        if size <= 0.25 * EPS:
            break
    return at, worst


def rps_kept(w, k):  # type: ignore[no-untyped-def]
    """Return a mode that is kept."""
    b = rps_FOUND + rps_KEPT * k
    return Place(w[b], w[b + 1], Vec3(w[b + 2], w[b + 3], w[b + 4]),
                 Vec3(w[b + 5], w[b + 6], w[b + 7]))  # fmt: skip


def rps_gap(at, other, side):  # type: ignore[no-untyped-def]
    """Return the distance of a place to another one, or to its mirror image for side -1."""
    gap = at.x - side * other.x
    total = gap * gap
    gap = at.y - other.y
    total += gap * gap
    gap = at.p.x - side * other.p.x
    total += gap * gap
    gap = at.p.y - other.p.y
    total += gap * gap
    gap = at.p.z - other.p.z
    total += gap * gap
    gap = at.q.x - side * other.q.x
    total += gap * gap
    gap = at.q.y - other.q.y
    total += gap * gap
    gap = at.q.z - other.q.z
    total += gap * gap
    return math.sqrt(total)


def rps_keep(w, count, start, scale, lengths):  # type: ignore[no-untyped-def]
    """Keep the solution that a place leads to if it is new; return how many are kept.

    A solution and its mirror image, -x, are kept as one.
    """
    at, worst = rps_newton(w, start, scale, lengths)
    if not worst <= rps_CLOSE:
        return count
    rps_equations(w, at, scale, lengths)
    # What a miss by rounding moves the solution by.
    radius = 1e-5
    if rps_inverse(w):
        total = 0.0
        for i in range(25):
            total += w[rps_INVERSE + i] * w[rps_INVERSE + i]
        radius = 16.0 * EPS * (1.0 + math.sqrt(total))
        radius = radius if radius < 1e-5 else 1e-5
    for k in range(count):
        mode = rps_kept(w, k)
        same = rps_gap(mode, at, 1.0)
        other = rps_gap(mode, at, -1.0)
        if (same if same < other else other) <= radius + w[rps_FOUND + rps_KEPT * k + 8]:
            return count
    if count == rps_PATHS:
        return count
    b = rps_FOUND + rps_KEPT * count
    w[b] = at.x
    w[b + 1] = at.y
    for i in range(3):
        w[b + 2 + i] = at.p[i]
        w[b + 5 + i] = at.q[i]
    w[b + 8] = radius
    return count + 1


def rps_heading(w):  # type: ignore[no-untyped-def]
    """Put the way that the slope hardly moves, and the weights of what it hardly reaches, in place.

    They are the inverse's largest column and row. Return what the way changes of that.
    """
    best = 0.0
    row = 0
    column = 0
    for i in range(25):
        if abs(w[rps_INVERSE + i]) > best:
            best = abs(w[rps_INVERSE + i])
            row = i // 5
            column = i % 5
    total = 0.0
    for i in range(5):
        total += w[rps_INVERSE + 5 * i + column] * w[rps_INVERSE + 5 * i + column]
    unit = 1.0 / math.sqrt(total)
    for i in range(5):
        w[rps_WAY + i] = unit * w[rps_INVERSE + 5 * i + column]
        w[rps_WEIGHTS + i] = w[rps_INVERSE + 5 * row + i]
    # The inverse's row times the slope is the axis ``row``.
    return w[rps_WAY + row]


def rps_twins(w, count, scale, lengths):  # type: ignore[no-untyped-def]
    """Seek twins of the modes that are kept; return how many are kept then."""
    k = 0
    while k < count:
        mode = rps_kept(w, k)
        rps_equations(w, mode, scale, lengths)
        if rps_inverse(w):
            along = rps_heading(w)
            bend = 0.0
            for side in range(2):
                step = ASSEMBLY_STEP if side == 0 else -ASSEMBLY_STEP
                rps_equations(w, rps_moved(w, mode, step), scale, lengths)
                for i in range(5):
                    bend += w[rps_WEIGHTS + i] * w[rps_MISSES + i]
            away, near = assembly_apart(along, bend)
            if near:
                count = rps_keep(w, count, rps_moved(w, mode, away), scale, lengths)
        k += 1
    return count


def rps_write(at, side, scale, constants, lengths, out):  # type: ignore[no-untyped-def]
    """Write pose, z, residual and distance from home of a mode or its mirror image."""
    size = scale.size
    px, py, pz = side * at.p.x, at.p.y, at.p.z
    qx, qy, qz = side * at.q.x, at.q.y, at.q.z
    nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    alpha, beta, gamma = assembly_angles(Rotation(nx, px, qx, ny, py, qy, nz, pz, qz))
    small = constants[2]
    x = side * size * at.x
    y = size * at.y
    z = small * qz
    worst = 0.0
    for i in range(5):
        sine, cosine, ty, tz = rps_limb(scale, i)
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
        gap = assembly_principal(out[2 + i] - constants[5 + i])
        away += small * small * gap * gap
    out[7] = away


def rps_general(constants):  # type: ignore[no-untyped-def]
    """Return the dimensions and lengths of the known solutions: :data:`DIMENSIONS`."""
    return Dimensions(
        complex(constants[8], constants[9]), complex(constants[10], constants[11]),
        complex(constants[12], constants[13]), complex(constants[14], constants[15]),
        complex(constants[16], constants[17]), complex(constants[18], constants[19]),
        complex(constants[20], constants[21]),
    )  # fmt: skip


def rps_own(constants):  # type: ignore[no-untyped-def]
    """Return the mechanism's dimensions and general lengths."""
    big = constants[0] / constants[2]
    h = constants[1] / constants[2]
    scale = (big * big + 2.0 * h * h + 1.0) / 24.0
    known = rps_general(constants)
    return Dimensions(
        complex(big, 0.0), complex(h, 0.0), rps_times(scale, known.l1),
        rps_times(scale, known.l2), rps_times(scale, known.l3), rps_times(scale, known.l4),
        rps_times(scale, known.l5),
    )  # fmt: skip


def rps_prepare(w, constants):  # type: ignore[no-untyped-def]
    """Follow the known solutions to the mechanism's dimensions and general lengths; once."""
    known, own = rps_general(constants), rps_own(constants)
    path = rps_path(known, own, False)
    for k in range(rps_PATHS):
        start = rps_load(constants, 22 + 12 * k)
        ended = rps_follow(start, path, 0.3)
        if not ended.there:
            ended = rps_follow(start, path, 0.01)
        if ended.there:
            rps_store(w, rps_BEGIN + 12 * k, ended.state)


def rps_follow_all(w, path):  # type: ignore[no-untyped-def]
    """Follow all solutions along a path, in smaller steps where some are lost."""
    for attempt in range(3):
        finer = 1.0 if attempt == 0 else (0.1 if attempt == 1 else 0.01)
        sound = True
        for k in range(rps_PATHS):
            ended = rps_follow(rps_load(w, rps_BEGIN + 12 * k), path, finer)
            rps_store(w, rps_END + 12 * k, ended.state)
            sound = sound and ended.there
        if sound and rps_sound(w):
            break


def rps_start(state, k, small, size):  # type: ignore[no-untyped-def]
    """Return the place of a path's end; of P, p and q only the directions count."""
    at = Place(
        x=state.x.real * small / size,
        y=state.y.real * small / size,
        p=Vec3(state.p.real, k.a0.real + k.a1.real * state.a.real, state.c.real),
        q=Vec3(
            state.q.real,
            k.q0.real + (k.q1.real * state.y.real + k.q2.real * state.c.real),
            state.a.real,
        ),
    )
    return rps_move(at, 0.0, 0.0, Vec3(0.0, 0.0, 0.0))


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
    own = rps_own(constants)
    given = Dimensions(
        own.big, own.h, rps_real_square(joints[0] / small), rps_real_square(joints[1] / small),
        rps_real_square(joints[2] / small), rps_real_square(joints[3] / small),
        rps_real_square(joints[4] / small),
    )  # fmt: skip
    path = rps_path(own, given, True)
    rps_follow_all(w, path)
    scale = Scale(size, small / size, constants[0] / size, constants[1] / size)
    count = 0
    for k in range(rps_PATHS):
        state = rps_load(w, rps_END + 12 * k)
        apart = 0.0
        for i in range(6):
            part = abs(state[i].imag)
            apart = part if part > apart else apart
        if apart < rps_REAL:
            count = rps_keep(w, count, rps_start(state, path.end, small, size), scale, joints)
    count = rps_twins(w, count, scale, joints)
    total = 0
    for m in range(count):
        at = rps_kept(w, m)
        rps_write(at, 1.0, scale, constants, joints, found[total])
        total += 1
        flat = math.sqrt(at.x * at.x + at.p.x * at.p.x + at.q.x * at.q.x)
        # All in the plane of the base: the mode is its own mirror image.
        if flat > w[rps_FOUND + rps_KEPT * m + 8]:
            rps_write(at, -1.0, scale, constants, joints, found[total])
            total += 1
    assembly_sort(found, total, 8)
    return total, False


def rps_real_square(length):  # type: ignore[no-untyped-def]
    """Return the square of a length as a complex number."""
    return complex(length * length, 0.0)

"""Kernel text of 2UU-UPU: symbols and equations are those of :mod:`.uu_upu`."""

from __future__ import annotations

import math
from typing import NamedTuple

from pmopt.kernels.trigonometry import arc_tangent, sin_cos
from pmopt.kernels.vectors import (
    Rotation,
    Vec3,
    dot,
    least,
    minus,
    turned,
)

TINY = 1e-300
#: Least rho^2: bs = ps lets it be 0, its square may not.
uup_POINT = 1e-140
#: Least f^2: what keeps quotients by f finite where f is 0.
uup_LEAST = 1e-20
#: Cells the curve is searched in up to v = 90 degrees and beyond, and where the first of the latter
#: ends in tan(v / 2).
uup_NEAR = 5
uup_CELLS = 7
uup_BEYOND = 2.0
#: Largest miss of x, relative to L, that counts as a root.
uup_CLOSE = 1e-9
#: Stands for tan(v / 2) at v = pi.
uup_FAR = 64.0
#: |m| that is 0 to rounding, and the least cos v there.
uup_LEVEL = 1e-15
uup_SHORT = 1e-8


class Geometry(NamedTuple):
    """Lengths of a design and its working mode."""

    a: float  # half the base's side, m
    c: float  # half the platform's side, m
    l2: float  # L^2, m^2
    length: float  # L, m
    r: float  # radius of the base, m
    big_r: float  # radius of the platform, m
    s: float  # sign of f
    up: float  # 1 or -1, by working mode
    far_cos: float  # cotangent of the largest |kappa|


class Stroke(NamedTuple):
    """Range of limb 1's length, m."""

    low: float
    high: float


class Arc(NamedTuple):
    """Range of an angle t: inside is cos(t - middle) >= cos(half-width)."""

    cos: float  # of the middle
    sin: float
    least: float  # cos(half-width); -2 where all angles are allowed


class Constants(NamedTuple):
    """One design, as kernel functions take it."""

    geometry: Geometry
    weight: float  # characteristic length, m; 1 for the raw Jacobian
    theta1: Arc
    phi: Arc
    delta3: Arc
    l1: Stroke
    eta1: Arc
    delta2: Arc
    kappa: Arc
    psi: Arc
    home1: Vec3  # directions of the limbs at home, platform frame
    home2: Vec3
    home3: Vec3


class Tilt(NamedTuple):
    """The curve that a tilt (beta, gamma) leaves."""

    m: float  # cos beta sin gamma
    mu: float  # sqrt(1 - m^2)
    sw: float
    cw: float


class Sizes(NamedTuple):
    """What P_x along the curve depends on, beside the tilt."""

    a: float  # m
    c: float  # m
    l2: float  # L^2, m^2
    half_r: float  # R / 2, m
    s: float  # sign of f


class Turn(NamedTuple):
    """Sines and cosines of phi, kappa and psi."""

    sphi: float
    cphi: float
    sk: float
    ck: float
    spsi: float
    cpsi: float


class Bar(NamedTuple):
    """The four-bar of the two UU limbs."""

    excess: float  # L^2 / rho^2 - 1
    f: float
    g: float  # f df/dkappa
    h: float  # M's height, m
    h_k: float  # its derivative by kappa, times |f|, m


class Across(NamedTuple):
    """P_x - Bm_x at a point of the curve, m, and its rates."""

    value: float
    by_u: float
    by_v: float
    even: float  # by v, times |f| cos phi


class Search(NamedTuple):
    """State of :func:`uup_solve`'s search; places are u, on one side of v = 0."""

    side: float
    t: float  # to look at next
    t1: float  # looked at last
    low: float
    high: float
    e1: float  # miss at t1, m
    g_low: float
    g_high: float
    first: float  # slope at v = 0
    last: float  # slope at t1
    before: bool
    searching: bool


class Root(NamedTuple):
    """What :func:`uup_solve` finds."""

    u: float
    miss: float  # m
    slope: float  # m


class Solved(NamedTuple):
    """What :func:`uup_pose` finds at a pose."""

    miss: float  # m
    slope: float  # m
    cb: float  # cos beta
    turn: Turn


class Points(NamedTuple):
    """A configuration, base frame, m."""

    turn: Turn
    rotation: Rotation
    p: Vec3
    p1: Vec3
    p2: Vec3
    p3: Vec3
    b1: Vec3
    b2: Vec3
    b3: Vec3


class Cones(NamedTuple):
    """Cosines between limbs and their directions at home, in the platform."""

    S_P1: float
    U_P2: float
    U_P3: float


class Positions(NamedTuple):
    """Positions of joints, m and rad, and directions of axes."""

    theta1: float
    phi: float
    delta3: float
    l1: float
    eta1: float
    delta2: float
    kappa: float
    psi: float
    along: Vec3  # limb 1
    lower: Vec3  # -n and n, normal to the limb plane
    upper: Vec3
    o: Vec3  # from P3 to P2


def uup_turn(u, tilt):  # type: ignore[no-untyped-def]
    """Return sine and cosine of phi, kappa and psi at a point of the curve."""
    m, mu, sw, cw = tilt
    d = 1.0 / (1.0 + u * u)
    cv = (1.0 - u * u) * d
    sv = 2.0 * u * d
    cphi = math.sqrt(cv * cv + m * m * sv * sv) + TINY
    return Turn(mu * sv, cphi, m / cphi, mu * cv / cphi, sw * cv - cw * sv, cw * cv + sw * sv)


def uup_bar(sk, ck, a, c, l2, s):  # type: ignore[no-untyped-def]
    """Return the four-bar at kappa."""
    # 1 - cos kappa to all its digits: rho is little else where bs is nearly ps.
    less = sk * sk / (1.0 + abs(ck)) + (abs(ck) - ck)
    rho2 = (a - c) * (a - c) + 2.0 * a * c * less + uup_POINT
    excess = l2 / rho2 - 1.0
    f = s * math.sqrt(excess if excess > uup_LEAST else uup_LEAST)
    g = -l2 * a * c * sk / (rho2 * rho2)
    arm = a - c + c * less
    return Bar(excess, f, g, f * arm, s * (g * arm + f * f * c * sk))


def uup_across(u, tilt, sizes):  # type: ignore[no-untyped-def]
    """Return P_x - Bm_x at a point of the curve and its rates."""
    sphi, cphi, sk, ck, spsi, cpsi = uup_turn(u, tilt)
    bar = uup_bar(sk, ck, sizes.a, sizes.c, sizes.l2, sizes.s)
    h, half_r = bar.h, sizes.half_r
    x = h * sphi + half_r * (cphi * cpsi - sphi * ck * spsi)
    # Along the curve phi' = cos kappa, kappa' = sin kappa tan phi, psi' = -1 by v.
    big_f = sizes.s * bar.f
    even = bar.h_k * sk * sphi * sphi + big_f * (h * cphi * cphi * ck + half_r * spsi * sk * sk)
    slope = even / (big_f * cphi)
    return Across(x, slope * 2.0 / (1.0 + u * u), slope, even)


def uup_step(state, j, x, tilt, sizes, up, far):  # type: ignore[no-untyped-def]
    """Return the state of :func:`uup_solve`'s search after its point j."""
    at = uup_across(state.side * state.t, tilt, sizes)
    first = at.by_v if j == 0 else state.first
    side = state.side if j > 0 or up * (at.value - x) < 0.0 else -1.0
    t0 = state.t1
    e0 = state.e1
    t1 = state.t
    e1 = side * up * (at.value - x)
    g1 = up * at.by_u
    again = state.before
    before = e1 < 0.0 and g1 > 0.0
    low = t1 if before else state.low
    high = state.high if before else t1
    # An end that stays has its slope halved (Illinois): the secant cannot get stuck.
    even = at.even * up
    g_low = even if before else (state.g_low if again else 0.5 * state.g_low)
    g_high = (0.5 * state.g_high if again else state.g_high) if before else even
    searching = state.searching and before and j < uup_CELLS
    near = far if far < 1.0 else 1.0
    beyond = far if far < uup_BEYOND or j > uup_NEAR else uup_BEYOND
    node = near * (j + 1) / uup_NEAR if j < uup_NEAR else beyond
    width = t0 - t1
    bend = (e0 - e1 - g1 * width) / (width * width + TINY)
    square = g1 * g1 - 4.0 * bend * e1
    rise = g1 + math.sqrt(square if square > 0.0 else 0.0)
    root = t1 - 2.0 * e1 / (rise if abs(rise) > TINY else TINY)
    turn = (low * g_high - high * g_low) / (g_high - g_low - TINY)
    t = root if square > 0.0 else turn
    t = t if low <= t <= high else 0.5 * (low + high)
    t = node if searching else t
    return Search(side, t, t1, low, high, e1, g_low, g_high, first, at.by_v, before, searching)


def uup_solve(x, tilt, sizes, up, far):  # type: ignore[no-untyped-def]
    """Return where P_x = x on the piece of the curve about v = 0 on which P_x is monotonic.

    With it P_x - x there, not 0 where there is no root, and the least slope by v there and at
    v = 0. Without a root it is where P_x comes nearest to x on that piece. Cells outwards from
    v = 0 are searched for the first that crosses x or turns back; one ends at v = 90 degrees, about
    which P_x turns twice where m is small. In it the parabola through the last two points with the
    slope at the last leads to the root, also near a turning point; where it has no root, the secant
    of the slopes leads to the turning point.
    """
    state = Search(1.0, 0.0, 0.0, 0.0, far, 0.0, 0.0, 0.0, 0.0, 0.0, True, True)
    # Written out: a loop in the sweep's loop over poses would keep that from being vectorised.
    state = uup_step(state, 0, x, tilt, sizes, up, far)
    state = uup_step(state, 1, x, tilt, sizes, up, far)
    state = uup_step(state, 2, x, tilt, sizes, up, far)
    state = uup_step(state, 3, x, tilt, sizes, up, far)
    state = uup_step(state, 4, x, tilt, sizes, up, far)
    state = uup_step(state, 5, x, tilt, sizes, up, far)
    state = uup_step(state, 6, x, tilt, sizes, up, far)
    state = uup_step(state, 7, x, tilt, sizes, up, far)
    state = uup_step(state, 8, x, tilt, sizes, up, far)
    state = uup_step(state, 9, x, tilt, sizes, up, far)
    state = uup_step(state, 10, x, tilt, sizes, up, far)
    state = uup_step(state, 11, x, tilt, sizes, up, far)
    state = uup_step(state, 12, x, tilt, sizes, up, far)
    state = uup_step(state, 13, x, tilt, sizes, up, far)
    state = uup_step(state, 14, x, tilt, sizes, up, far)
    steeper = state.last * up < state.first * up
    return Root(state.side * state.t1, state.e1, up * (state.last if steeper else state.first))


def uup_far(m, mu, far_cos):  # type: ignore[no-untyped-def]
    """Return u where the links are stretched: kappa is largest, its cotangent far_cos."""
    end = abs(m) * far_cos / mu
    end = 1.0 if end > 1.0 else (-1.0 if end < -1.0 else end)
    # At m = 0 v = 90 degrees does not tell kappa; what this cuts off P_x is less than rounding.
    end = uup_SHORT if abs(m) < uup_LEVEL and end < uup_SHORT else end
    far = math.sqrt((1.0 - end) / (1.0 + end + TINY))
    return far if far < uup_FAR else uup_FAR


def uup_pose(x, beta, gamma, k):  # type: ignore[no-untyped-def]
    """Return miss and slope of :func:`uup_solve` at a pose, and the state there.

    ``k`` is a :class:`Geometry`.
    """
    sb, cb = sin_cos(beta)
    sg, cg = sin_cos(gamma)
    m = cb * sg
    level = cb * cg
    mu = math.sqrt(sb * sb + level * level) + TINY
    tilt = Tilt(m, mu, sb / mu, level / mu)
    sizes = Sizes(k.a, k.c, k.l2, 0.5 * k.big_r, k.s)
    root = uup_solve(x + 0.5 * k.r, tilt, sizes, k.up, uup_far(m, mu, k.far_cos))
    return Solved(root.miss, root.slope, cb, uup_turn(root.u, tilt))


def uup_within(c, s, arc):  # type: ignore[no-untyped-def]
    """Return how far inside its range the angle with cosine c and sine s is; >= 0 is inside."""
    return c * arc.cos + s * arc.sin - arc.least


def uup_outcome(closed, cb, turn, bar, k):  # type: ignore[no-untyped-def]
    """Return the margin and a positive multiple of Qq adj(Xq) at a configuration.

    Xq and Qq are the derivatives of the pose (x, beta, gamma) and of the joints (theta1, phi, d3)
    by q, so that J^-1 = Qq Xq^-1. Kappa's columns are multiplied by |f|, Xq's rows by 1, cos beta
    and cos^2 beta, Qq's by l1^2 cos^2 eta1: all stay finite everywhere. The determinant of the
    entries is det(Qq) = dtheta1/dpsi dd3/dkappa times a square and cos^3 beta. ``closed`` is >= 0
    where the pose is reached, ``turn`` what :func:`uup_turn` returns, ``bar`` what
    :func:`uup_bar` does.
    """
    a, c, l2, length, r, big_r, s, _, _ = k.geometry
    sphi, cphi, sk, ck, spsi, cpsi = turn
    excess, f, g, h, h_k = bar
    y = f * c * sk
    y_k = s * c * (g * sk + f * f * ck)
    big_f = s * f

    # Rot x, o = Rot y, n
    xx = cphi * cpsi - sphi * ck * spsi
    xy = spsi * sk
    xz = -sphi * cpsi - cphi * ck * spsi
    ox = sphi * sk
    oz = cphi * sk
    # What is needed of o x Rot x and n x Rot x
    cx = ck * xz - oz * xy
    cz = ox * xy - ck * xx
    nx = sphi * xy
    nz = cphi * xy

    half = 0.5 * big_r
    far_arm = 3.0 * half
    wx = h * sphi + far_arm * xx - 0.5 * r - r
    wy = y + far_arm * xy
    wz = h * cphi + far_arm * xz
    flat2 = wx * wx + wz * wz
    flat = math.sqrt(flat2) + TINY
    l1 = math.sqrt(flat2 + wy * wy)

    # theta1's row of Qq times flat2
    t_phi = wz * wz + wx * (wx + 1.5 * r)
    t_k = (h_k * sphi + big_f * far_arm * nx) * wz - (h_k * cphi + big_f * far_arm * nz) * wx
    t_psi = far_arm * (cx * wz - cz * wx)
    # L (sin, cos) of d2 and d3
    d2_s = y - a + c * ck
    d2_c = h + c * sk
    d3_s = y + a - c * ck
    d3_c = h - c * sk
    d3_k = ((y_k + big_f * c * sk) * d3_c - (h_k - big_f * c * ck) * d3_s) / l2
    # Xq: rates of x, of beta times cos beta, of gamma times cos^2 beta
    x_phi = h * cphi + half * xz
    x_k = (h_k + big_f * half * xy) * sphi
    x_psi = half * cx
    b_phi = xx
    b_k = -big_f * cphi * xy
    b_psi = ck * xx - ox * xy
    g_phi = xy
    g_k = big_f * cphi * xx
    g_psi = ox * xx + ck * xy
    # adj(Xq), its columns times weight, cos beta and cos^2 beta
    cb2 = cb * cb
    p_x = k.weight * (b_k * g_psi - b_psi * g_k)
    p_b = cb * (x_psi * g_k - x_k * g_psi)
    p_g = cb2 * (x_k * b_psi - x_psi * b_k)
    k_x = k.weight * (b_psi * g_phi - b_phi * g_psi)
    k_b = cb * (x_phi * g_psi - x_psi * g_phi)
    k_g = cb2 * (x_psi * b_phi - x_phi * b_psi)
    s_x = k.weight * (b_phi * g_k - b_k * g_phi)
    s_b = cb * (x_k * g_phi - x_phi * g_k)
    s_g = cb2 * (x_phi * b_k - x_k * b_phi)

    margin = least(excess, closed)
    margin = least(l1 - k.l1.low, margin)
    margin = least(k.l1.high - l1, margin)
    margin = least(uup_within(wz / flat, wx / flat, k.theta1), margin)
    margin = least(uup_within(cphi, sphi, k.phi), margin)
    margin = least(uup_within(d3_c / length, d3_s / length, k.delta3), margin)
    margin = least(uup_within(flat / (l1 + TINY), wy / (l1 + TINY), k.eta1), margin)
    margin = least(uup_within(d2_c / length, d2_s / length, k.delta2), margin)
    margin = least(uup_within(ck, sk, k.kappa), margin)
    margin = least(uup_within(cpsi, spsi, k.psi), margin)
    d3_f = d3_k * flat2
    return (
        margin,
        t_phi * p_x + t_k * k_x + t_psi * s_x,
        t_phi * p_b + t_k * k_b + t_psi * s_b,
        t_phi * p_g + t_k * k_g + t_psi * s_g,
        flat2 * p_x, flat2 * p_b, flat2 * p_g,
        d3_f * k_x, d3_f * k_b, d3_f * k_g,
    )  # fmt: skip


def kernel(x, beta, gamma, k):  # type: ignore[no-untyped-def]
    """Return the margin and a multiple of the inverse Jacobian at a pose; see uup_outcome."""
    a, c, l2, length, _, _, s, _, _ = k.geometry
    miss, slope, cb, turn = uup_pose(x, beta, gamma, k.geometry)
    bar = uup_bar(turn.sk, turn.ck, a, c, l2, s)
    # The slope falls to 0 as the root of the distance to P_x's extreme: its square is linear.
    closed = slope * abs(slope) / length
    closed = least(-abs(miss) if abs(miss) > uup_CLOSE * length else bar.excess, closed)
    return uup_outcome(closed, cb, turn, bar, k)


def uup_of_v(v, beta, gamma, k):  # type: ignore[no-untyped-def]
    """Return P_x, up times its slope by v, and what the kernel does, at a point of the curve.

    What is asked of the slope is left to the caller.
    """
    a, c, l2, _, r, big_r, s, up, _ = k.geometry
    sb, cb = sin_cos(beta)
    sg, cg = sin_cos(gamma)
    sv, cv = sin_cos(v)
    m = cb * sg
    level = cb * cg
    mu = math.sqrt(1.0 - m * m)
    sw = sb / mu
    cw = level / mu
    cphi = math.sqrt(cv * cv + (m * sv) * (m * sv))
    sphi = mu * sv
    sk = m / cphi
    ck = mu * cv / cphi
    spsi = sw * cv - cw * sv
    cpsi = cw * cv + sw * sv
    # 1 - cos kappa; |kappa| stays well below 180 degrees.
    less = sk * sk / (1.0 + ck)
    arm = a - c + c * less
    rho2 = (a - c) * (a - c) + 2.0 * a * c * less
    rise = math.sqrt(l2 - rho2)
    rho = math.sqrt(rho2)
    lean = arm / rho
    h = s * rise * lean
    x = h * sphi + 0.5 * big_r * (cphi * cpsi - sphi * ck * spsi) - 0.5 * r
    # dh/dkappa / sin kappa, of (L^2 - rho^2)^(1/2) and of arm / rho
    h_k = -(s * c * (a * lean / rise + rise * c * (a - c - a * less) / (rho2 * rho)))
    slope = cphi * ck * h + sk * sk / cphi * (0.5 * big_r * spsi + sphi * sphi * h_k)
    big_f = rise / rho
    f = s * big_f
    g = -(l2 * a * c * sk / (rho2 * rho2))
    bar = Bar(l2 - rho2, f, g, h, big_f * h_k * sk)
    turn = Turn(sphi, cphi, sk, ck, spsi, cpsi)
    return (x, up * slope, *uup_outcome(1.0, cb, turn, bar, k))


def uup_points(x, beta, gamma, k):  # type: ignore[no-untyped-def]
    """Return the points of a configuration."""
    return uup_placed(uup_pose(x, beta, gamma, k.geometry).turn, k)


def uup_placed(turn, k):  # type: ignore[no-untyped-def]
    """Return the points at a turn of plane, coupler and platform."""
    a, c, l2, _, r, big_r, s, _, _ = k.geometry
    sphi, cphi, sk, ck, spsi, cpsi = turn
    bar = uup_bar(sk, ck, a, c, l2, s)
    y = bar.f * c * sk
    base = -0.5 * r
    # Rot's columns
    xx = cphi * cpsi - sphi * ck * spsi
    xy = spsi * sk
    xz = -sphi * cpsi - cphi * ck * spsi
    ox = sphi * sk
    oz = cphi * sk
    zx = xy * oz - xz * ck
    zy = xz * ox - xx * oz
    zz = xx * ck - xy * ox
    mx = base + bar.h * sphi
    mz = bar.h * cphi
    half = 0.5 * big_r
    p = Vec3(mx + half * xx, y + half * xy, mz + half * xz)
    return Points(
        turn,
        Rotation(xx, ox, zx, xy, ck, zy, xz, oz, zz),
        p,
        p1=Vec3(p.x + big_r * xx, p.y + big_r * xy, p.z + big_r * xz),
        p2=Vec3(mx + c * ox, y + c * ck, mz + c * oz),
        p3=Vec3(mx - c * ox, y - c * ck, mz - c * oz),
        b1=Vec3(r, 0.0, 0.0),
        b2=Vec3(base, a, 0.0),
        b3=Vec3(base, -a, 0.0),
    )


def uup_cones(at, k):  # type: ignore[no-untyped-def]
    """Return the cosines of the cone angles."""
    length = k.geometry.length
    w1 = minus(at.p1, at.b1)
    l1 = math.sqrt(dot(w1, w1)) + TINY
    return Cones(
        dot(w1, turned(at.rotation, k.home1)) / l1,
        dot(minus(at.p2, at.b2), turned(at.rotation, k.home2)) / length,
        dot(minus(at.p3, at.b3), turned(at.rotation, k.home3)) / length,
    )


def uup_positions(at, k):  # type: ignore[no-untyped-def]
    """Return the joints' positions and axes."""
    a, c, l2, _, _, _, s, _, _ = k.geometry
    sphi, cphi, sk, ck, spsi, cpsi = at.turn
    bar = uup_bar(sk, ck, a, c, l2, s)
    h = bar.h
    y = bar.f * c * sk
    w = minus(at.p1, at.b1)
    flat = math.sqrt(w.x * w.x + w.z * w.z)
    l1 = math.sqrt(flat * flat + w.y * w.y)
    over = l1 + TINY
    return Positions(
        theta1=arc_tangent(w.x, w.z),
        phi=arc_tangent(sphi, cphi),
        delta3=arc_tangent(y + a - c * ck, h - c * sk),
        l1=l1,
        eta1=arc_tangent(w.y, flat),
        delta2=arc_tangent(y - a + c * ck, h + c * sk),
        kappa=arc_tangent(sk, ck),
        psi=arc_tangent(spsi, cpsi),
        along=Vec3(w.x / over, w.y / over, w.z / over),
        lower=Vec3(-cphi, 0.0, sphi),
        upper=Vec3(cphi, 0.0, -sphi),
        o=Vec3(at.rotation.xy, at.rotation.yy, at.rotation.zy),
    )

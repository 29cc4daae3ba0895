"""2UU-UPU, in the geometry that keeps its freedoms in motion (2UU-UPS): 1T2R.

Symbols after "Dynamic Modeling and Simulation of a 3-DOF Parallel Sorting Robot", whose own
layout of axes is instantaneous only (see docs/mechanisms/2uu-upu.md). The two UU limbs are a
four-bar B2 P2 P3 B3 in a plane that turns about the line B2B3, parallel to y.

Internal coordinates q = (phi, kappa, psi): the plane's turn about y, the coupler's turn in the
plane and the platform's turn about the coupler. With a, c half the sides of base and platform::

    Rot = Ry(phi) Rx(kappa) Ry(psi),  n = Ry(phi) x,  o = Ry(phi) Rx(kappa) y
    rho^2 = a^2 + c^2 - 2 a c cos kappa,   f = s sqrt(L^2 / rho^2 - 1)
    M = Bm + Ry(phi) (0, f c sin kappa, f (a - c cos kappa))      middle of the coupler P2P3
    P = M + R/2 Rot x,   P1 = M + 3R/2 Rot x,   P2, P3 = M +- c o
    L (sin d2, cos d2) = P2 - B2 and L (sin d3, cos d3) = P3 - B3, in the plane's (y, height)
    P1 - B1 = l1 (sin theta1 cos eta1, sin eta1, cos theta1 cos eta1)

A task pose (x, beta, gamma) tells the third row of Rot, (-sin beta, m, cos beta cos gamma) with
m = cos beta sin gamma; mu^2 = 1 - m^2. What is left is a curve, here told by v = w - psi with
mu (sin w, cos w) = (sin beta, cos beta cos gamma)::

    sin phi = mu sin v,  cos phi = sqrt(cos^2 v + m^2 sin^2 v)
    cos kappa = mu cos v / cos phi,  sin kappa = m / cos phi

on which P_x = x is solved, with u = tan(v / 2) as the unknown. Every configuration is on it once:
phi beyond 90 degrees is the same with phi - 180 degrees, -kappa, psi - 180 degrees and -s.

Working modes are told by s: M above the base or below it as the platform stands level. Their root
is the one on the piece of the curve about v = 0 on which P_x is monotonic, which the kernel finds.
:meth:`UuUpu.inverse` also tells the others, "up-2", "up-3", .., "down-2", ..: configurations beyond
P_x's extremes, with the limb plane folded down or kappa large. They are answers of the inverse
kinematics and no modes of a workspace.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.compiler.programs import Assembler
from pmopt.errors import UnreachableError, unknown_name
from pmopt.kernels.trigonometry import arc_tangent, sin_cos
from pmopt.kernels.vectors import (
    Rotation,
    Vec3,
    Y,
    dot,
    least,
    minus,
    turned,
)
from pmopt.mechanisms.bodies import Body, triangle, tube
from pmopt.mechanisms.catalogue.uu_upu_forward import uu_assemble
from pmopt.mechanisms.mechanism import (
    Chain,
    Coordinate,
    Curve,
    InverseSolution,
    Joint,
    Limb,
    Matrix,
    Mechanism,
    Parameter,
    Parameters,
    Ranges,
    Reach,
    Vector,
)
from pmopt.mechanisms.structure import (
    Evaluated,
    Freedom,
    Normal,
    Prismatic,
    SerialChain,
    Spherical,
    Structure,
    Universal,
)
from pmopt.numerics import elementary
from pmopt.numerics.matrices import determinant, product

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

#: Cells of :func:`uup_main`'s scan.
FINE = 120
#: Nodes of :func:`uup_others`' scan of half the curve, in each of two measures of length.
NODES = 64
#: Most bisections.
HALVINGS = 200
#: Room for the nodes of a scan, and the most roots and branches.
uup_ROOM = 2 * NODES + 2
uup_MOST = 24
#: Stands for |m| = 0.
FLAT = 1e-30
#: How far :func:`uup_main`'s root may be from that of the scan, near an extreme of P_x.
NEAR = 1e-4

#: Whether the platform's P2P3 is above (1) or below (-1) the base, told by M's height over it.
MODE_SIGNS = {"up": 1.0, "down": -1.0}

_OURS = "ours"
_PAPER = "paper, section 4 (default); bounds ours"


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
    # An end that stays has its slope halved (Illinois): the secant can not get stuck.
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
    return Positions(
        theta1=arc_tangent(w.x, w.z),
        phi=arc_tangent(sphi, cphi),
        delta3=arc_tangent(y + a - c * ck, h - c * sk),
        l1=l1,
        eta1=arc_tangent(w.y, flat),
        delta2=arc_tangent(y - a + c * ck, h + c * sk),
        kappa=arc_tangent(sk, ck),
        psi=arc_tangent(spsi, cpsi),
        along=Vec3(w.x / l1, w.y / l1, w.z / l1),
        lower=Vec3(-cphi, 0.0, sphi),
        upper=Vec3(cphi, 0.0, -sphi),
        o=Vec3(at.rotation.xy, at.rotation.yy, at.rotation.zy),
    )


#: The axes are those theta1, eta1, phi, delta2 and delta3 turn about. Where P1 lies on theta1's
#: axis, eta1 turns about any axis across it.
STRUCTURE = Structure(
    Evaluated(uup_points, Points),
    place="p",
    rotation="rotation",
    chains=(
        SerialChain(
            "limb 1",
            (
                Universal(
                    "b1",
                    Y,
                    Normal(("b1", "p1"), Y, otherwise=Vec3(-1.0, 0.0, 0.0)),
                    drives_first="theta1",
                ),
                Prismatic("b1", "along"),
                Spherical("p1"),
            ),
            bars=("b1", "p1"),
            spoke="p1",
        ),
        SerialChain(
            "limb 2",
            (Universal("b2", Y, "lower", drives_first="phi"), Universal("p2", "upper", "o")),
            bars=("b2", "p2"),
            spoke="p2",
        ),
        SerialChain(
            "limb 3",
            (Universal("b3", Y, "lower", drives_second="delta3"), Universal("p3", "upper", "o")),
            bars=("b3", "p3"),
            spoke="p3",
        ),
    ),
    cones=Evaluated(uup_cones, Cones),
    positions=Evaluated(uup_positions, Positions),
    followed={
        "l1": (Freedom("l1"),),
        "eta1": (Freedom("U_B1", "second"),),
        "delta2": (Freedom("U_B2", "second"),),
        "kappa": (Freedom("U_P2", "first"), Freedom("U_B2", "second", -1.0)),
        "psi": (Freedom("U_P2", "second"),),
    },
)


def uup_main(x, tilt, far, sizes, up, length):  # type: ignore[no-untyped-def]
    """Return a working mode's root by a scan in fine cells and bisection, and whether there is one.

    The cells end where P_x crosses x or turns back; bisection then keeps what lies before both.
    """
    value, slope, _, _ = uup_across(0.0, tilt, sizes)
    if up * slope <= 0.0:
        return 0.0, False
    side = 1.0 if up * (value - x) < 0.0 else -1.0
    low = 0.0
    high = 0.0
    for j in range(FINE):
        part = (j + 1) / FINE
        high = part / (1.0 - part + part / far) if far > 0.0 else 0.0
        value, slope, _, _ = uup_across(side * high, tilt, sizes)
        if side * up * (value - x) >= 0.0 or up * slope <= 0.0:
            break
        low = high
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        if middle in (low, high):
            break
        value, slope, _, _ = uup_across(side * middle, tilt, sizes)
        if side * up * (value - x) < 0.0 and up * slope > 0.0:
            low = middle
        else:
            high = middle
    value, _, _, _ = uup_across(side * high, tilt, sizes)
    # Twice what the kernel allows: where it finds the end of reach there is a root here.
    return side * high, side * up * (value - x) >= -2.0 * uup_CLOSE * length


class Half(NamedTuple):
    """Half the curve, |v| on one side of v = 0, and the x that is looked for."""

    side: float
    s: float  # sign of f
    x: float  # m
    tilt: Tilt
    sizes: Sizes


class Plan(NamedTuple):
    """Half the sides and the radii of base and platform, m."""

    a: float
    c: float
    r: float
    big_r: float


class Angles(NamedTuple):
    """Sines and cosines of beta and gamma."""

    sb: float
    cb: float
    sg: float
    cg: float


def uup_all_round(cv, sv, half):  # type: ignore[no-untyped-def]
    """Return P_x - x and what has the sign of its slope by |v|, all round the curve."""
    m, mu, sw, cw = half.tilt
    a, c, l2, half_r, _ = half.sizes
    side, s = half.side, half.s
    cphi2 = cv * cv + (m * sv) * (m * sv)
    cphi = math.sqrt(cphi2)
    sk = m / cphi
    ck = mu * cv / cphi
    sphi = side * mu * sv
    spsi = sw * cv - cw * side * sv
    cpsi = cw * cv + sw * side * sv
    less = sk * sk / (1.0 + abs(ck)) + (abs(ck) - ck)
    rho2 = (a - c) * (a - c) + 2 * a * c * less + uup_POINT
    excess = l2 / rho2 - 1.0
    f2 = excess if excess > 0.0 else 0.0
    f = math.sqrt(f2)
    arm = a - c + c * less
    h_k = (f2 * c - l2 * a * c / (rho2 * rho2) * arm) * sk
    value = s * f * arm * sphi + half_r * (cphi * cpsi - sphi * ck * spsi) - half.x
    even = s * h_k * sk * sphi * sphi
    even = even + f * (s * f * arm * cphi2 * ck + half_r * spsi * sk * sk)
    return value, side * even


def uup_place(p, way):  # type: ignore[no-untyped-def]
    """Return cosine and sine of |v| by tan(|v| / 2), its cotangent, or the cosine itself."""
    if way == 0:
        return p, math.sqrt((1.0 - p) * (1.0 + p))
    d = 1.0 / (1.0 + p * p)
    return (1.0 - p * p) * d if way > 0 else (p * p - 1.0) * d, 2.0 * p * d


def uup_zero(low, high, way, which, half):  # type: ignore[no-untyped-def]
    """Return where P_x - x (which = 0) or its slope (1) changes its sign, by bisection.

    Numbers of the same sign far apart are bisected by their logarithms.
    """
    cv, sv = uup_place(low, way)
    at_low = uup_all_round(cv, sv, half)[which]
    cv, sv = uup_place(high, way)
    at_high = uup_all_round(cv, sv, half)[which]
    # Rounding may move an end's sign: then it is the root.
    if at_low * at_high >= 0.0:
        return low if abs(at_low) < abs(at_high) else high
    below = at_low < 0.0
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        far = 4.0 * low - high if abs(low) < abs(high) else 4.0 * high - low
        if low * high > 0.0 and far * high < 0.0:
            middle = math.sqrt(abs(low)) * math.sqrt(abs(high))
            middle = middle if low > 0.0 else -middle
        if middle in (low, high):
            break
        cv, sv = uup_place(middle, way)
        if (uup_all_round(cv, sv, half)[which] < 0.0) == below:
            low = middle
        else:
            high = middle
    return high


def uup_nodes(tilt, largest, work):  # type: ignore[no-untyped-def]
    """Write cosines of |v| to look at into the first numbers of ``work``, falling from 1.

    They are spread evenly in v and, denser where f falls to 0, in kappa: where m is small kappa
    turns within some m of v = 90 degrees.

    Returns
    -------
    count : int
        0 where there is no curve.
    stretched : bool
        Whether it ends where the links are stretched, else at v = 180 degrees.
    """
    m, mu = tilt.m, tilt.mu
    start = mu / m
    if largest >= 1.0:
        return 0, False
    end = -start
    if largest > -1.0:
        end = largest / math.sqrt((1.0 - largest) * (1.0 + largest))
    if end >= start:
        return 0, False
    stretched = end > -start
    least = -1.0
    if stretched:
        least = m * end / mu
        least = least if least > -1.0 else -1.0
    first = arc_tangent(m, mu)
    last = arc_tangent(1.0, end if stretched else -start)
    work[0] = 1.0
    work[1] = least
    count = 2
    for j in range(1, NODES + 1):
        part = j / (NODES + 1)
        _, even = sin_cos(part * math.pi)
        sk, ck = sin_cos(last - (last - first) * part * part)
        for cosine in (even, m * ck / (sk * mu)):
            if least < cosine < 1.0:
                place = count
                while cosine > work[place - 1]:
                    work[place] = work[place - 1]
                    place -= 1
                work[place] = cosine
                count += 1
    return count, stretched


def uup_others(x, tilt, largest, sizes, size, work):  # type: ignore[no-untyped-def]
    """Write every root of P_x = x into ``work`` from number 9 uup_ROOM on; return their number.

    Four numbers each: cosine and sine of |v|, the side of v and s. Those of s = 1 come first, each
    from v = 0 outwards. Between nodes where P_x - x changes sign is a root, and a pair where it
    turns back beyond 0.
    """
    count, stretched = uup_nodes(tilt, largest, work)
    roots = 0
    place = 9 * uup_ROOM
    if count == 0:
        return 0
    for k in range(count):
        cv = work[k]
        sv = math.sqrt((1.0 - cv) * (1.0 + cv))
        for row in range(4):
            side = 1.0 if row % 2 == 0 else -1.0
            s = 1.0 if row < 2 else -1.0
            half = Half(side, s, x, tilt, sizes)
            value, slope = uup_all_round(cv, sv, half)
            work[(1 + row) * uup_ROOM + k] = value
            work[(5 + row) * uup_ROOM + k] = slope
    if stretched:  # f = 0: both s meet
        for row in range(2):
            one = (1 + row) * uup_ROOM + count - 1
            other = one + 2 * uup_ROOM
            work[one] = (work[one] + work[other]) / 2
            work[other] = work[one]
    for row in range(4):
        side = 1.0 if row % 2 == 0 else -1.0
        s = 1.0 if row < 2 else -1.0
        half = Half(side, s, x, tilt, sizes)
        for k in range(count - 1):
            value = work[(1 + row) * uup_ROOM + k]
            sign = 1.0 if value >= 0.0 else -1.0
            crosses = (work[(1 + row) * uup_ROOM + k + 1] >= 0.0) != (value >= 0.0)
            falls = sign * work[(5 + row) * uup_ROOM + k] < 0.0
            turns = not crosses and falls and sign * work[(5 + row) * uup_ROOM + k + 1] > 0.0
            if not (crosses or turns):
                continue
            low, high = work[k], work[k + 1]
            way = 0
            if abs(low) > 0.8 or abs(high) > 0.8:
                way = 1 if low + high > 0.0 else -1
                sv_low = math.sqrt((1.0 - low) * (1.0 + low))
                sv_high = math.sqrt((1.0 - high) * (1.0 + high))
                low = sv_low / (1.0 + way * low)
                high = sv_high / (1.0 + way * high)
            middle = high
            pairs = 1
            if turns:
                middle = uup_zero(low, high, way, 1, half)
                cv, sv = uup_place(middle, way)
                short = sign * uup_all_round(cv, sv, half)[0]
                if short > 1e-15 * size:
                    continue
                pairs = 2
                if short == 0.0:
                    low = middle
                    pairs = 1
            for pair in range(pairs):
                if roots == uup_MOST:
                    break
                begin, end = (low, middle) if pair == 0 else (middle, high)
                cv, sv = uup_place(uup_zero(begin, end, way, 0, half), way)
                at = place + 4 * roots
                while (
                    at > place
                    and work[at - 1] == s
                    and (work[at - 4] < cv or (work[at - 4] == cv and work[at - 2] < side))
                ):
                    for column in range(4):
                        work[at + column] = work[at - 4 + column]
                    at -= 4
                work[at] = cv
                work[at + 1] = sv
                work[at + 2] = side
                work[at + 3] = s
                roots += 1
    return roots


def uup_write(row, number, turn, bar, plan, angles):  # type: ignore[no-untyped-def]
    """Write a branch: its number, joints, y, z and alpha, and the passive joints."""
    sphi, cphi, sk, ck, spsi, cpsi = turn
    a, c, r, big_r = plan
    sb, cb, sg, cg = angles
    f, h = bar.f, bar.h
    y = f * c * sk
    xx = cphi * cpsi - sphi * ck * spsi
    xy = spsi * sk
    xz = -sphi * cpsi - cphi * ck * spsi
    ox = sphi * sk
    oz = cphi * sk
    zx = xy * oz - xz * ck
    zy = xz * ox - xx * oz
    half = 0.5 * big_r
    far_arm = 3.0 * half
    wx = h * sphi + far_arm * xx - 0.5 * r - r
    wy = y + far_arm * xy
    wz = h * cphi + far_arm * xz
    flat = math.sqrt(wx * wx + wz * wz)
    # Rot's first two rows by those of Ry Rx
    along = xx * cb + ox * (sb * sg) + zx * (sb * cg) + ck * cg - zy * sg
    beside = xy * cb + ck * (sb * sg) + zy * (sb * cg) - ox * cg + zx * sg
    row[0] = number
    row[1] = uup_principal(arc_tangent(wx, wz))
    row[2] = uup_principal(arc_tangent(sphi, cphi))
    row[3] = uup_principal(arc_tangent(y + a - c * ck, h - c * sk))
    row[4] = y + half * xy
    row[5] = h * cphi + half * xz
    row[6] = uup_principal(arc_tangent(beside, along))
    row[7] = math.sqrt(wx * wx + wy * wy + wz * wz)
    row[8] = arc_tangent(wy, flat)
    row[9] = uup_principal(arc_tangent(y - a + c * ck, h + c * sk))
    row[10] = uup_principal(arc_tangent(sk, ck))
    row[11] = uup_principal(arc_tangent(spsi, cpsi))


def uup_principal(angle):  # type: ignore[no-untyped-def]
    """Return -pi, which rounding may give, as pi."""
    return angle if angle > -math.pi else math.pi


def uup_invert(pose, constants, found, work):  # type: ignore[no-untyped-def]
    """Write every branch of a pose, a row each; see :attr:`Mechanism.inverter`.

    The working modes first, as far as there are any; then the other roots, those of up first, each
    from v = 0 outwards. Branch n of mode k (up 0, down 1) has the number 2 (n - 1) + k.

    Returns
    -------
    count : int
    proven : bool
        Always.
    """
    a, c, length, r, big_r = constants[0], constants[1], constants[2], constants[3], constants[4]
    sb, cb = sin_cos(pose[1])
    sg, cg = sin_cos(pose[2])
    sb, cb, sg, cg = float(sb), float(cb), float(sg), float(cg)
    x = pose[0] + 0.5 * r
    m = cb * sg
    level = cb * cg
    mu = math.sqrt(sb * sb + level * level) + TINY
    sw = sb / mu
    cw = level / mu
    curve = Tilt(m, mu, sw, cw)
    l2 = length * length
    half_r = 0.5 * big_r
    largest = (a * a + c * c - l2) / (2.0 * a * c)
    far = uup_far(m, mu, constants[5])
    plan = Plan(a, c, r, big_r)
    angles = Angles(sb, cb, sg, cg)
    count = 0
    taken = 9 * uup_ROOM + 4 * uup_MOST
    for mode in range(2):
        up = 1.0 if mode == 0 else -1.0
        s = up if a >= c else -up
        u, there = uup_main(x, curve, far, Sizes(a, c, l2, half_r, s), up, length)
        work[taken + mode] = 0.0
        if there:
            turn = uup_turn(u, curve)
            bar = uup_bar(turn.sk, turn.ck, a, c, l2, s)
            if bar.excess >= 0.0:
                uup_write(found[count], mode, turn, bar, plan, angles)
                work[taken + mode] = 1.0
                work[taken + 2 + 2 * mode] = found[count, 2]
                work[taken + 3 + 2 * mode] = found[count, 10]
                count += 1
    mirror = -1.0 if m < 0.0 else 1.0
    size = abs(m)
    size = size if size > FLAT else FLAT
    round_curve = Tilt(size, mu, sw, cw)
    sizes_all = Sizes(a, c, l2, half_r, 1.0)
    roots = uup_others(x, round_curve, largest, sizes_all, length + big_r, work)
    place = 9 * uup_ROOM
    for mode in range(2):
        up = 1.0 if mode == 0 else -1.0
        s = up if a >= c else -up
        # The root that is the working mode's.
        nearest = -1
        least = NEAR
        for k in range(roots):
            at = place + 4 * k
            if work[at + 3] == s and work[taken + mode] > 0.0:
                lift = size * work[at + 1]
                cphi = math.sqrt(work[at] * work[at] + lift * lift)
                phi = arc_tangent(work[at + 2] * mu * work[at + 1], cphi)
                kappa = mirror * arc_tangent(size, mu * work[at])
                gap = abs(phi - work[taken + 2 + 2 * mode])
                other = abs(kappa - work[taken + 3 + 2 * mode])
                gap = gap if gap > other else other
                if gap < least:
                    nearest = k
                    least = gap
        number = mode
        for k in range(roots):
            at = place + 4 * k
            if work[at + 3] != s or k == nearest or count == uup_MOST:
                continue
            number += 2
            cv, sv, side = work[at], work[at + 1], work[at + 2]
            cphi = math.sqrt(cv * cv + (size * sv) * (size * sv))
            turn = Turn(
                side * mu * sv, cphi, mirror * size / cphi, mu * cv / cphi,
                sw * cv - cw * side * sv, cw * cv + sw * side * sv,
            )  # fmt: skip
            bar = uup_bar(turn.sk, turn.ck, a, c, l2, s)
            uup_write(found[count], number, turn, bar, plan, angles)
            count += 1
    return count, True


@dataclass(frozen=True)
class Configuration:
    """The mechanism at internal coordinates q = (phi, kappa, psi), for kinematics and dynamics.

    Attributes
    ----------
    q : (3,) float64
    sign : float
        s of f = s sqrt(L^2 / rho^2 - 1).
    bar : Bar
    rotation : (3, 3) float64
        The platform's; its second column is o, the direction of P3P2.
    normal : (3,) float64
        n, the normal of the limb plane.
    middle, centre : (3,) float64
        M, middle of P2P3, and P, the platform's centre.
    base, ends : (3, 3) float64
        Rows B1, B2, B3 and P1, P2, P3.
    lengths, directions : (3,) and (3, 3) float64
        Of the limbs, from base to platform.
    theta1, eta1, delta2, delta3 : float
    """

    q: Vector
    sign: float
    bar: Bar
    rotation: Matrix
    normal: Vector
    middle: Vector
    centre: Vector
    base: Matrix
    ends: Matrix
    lengths: Vector
    directions: Matrix
    theta1: float
    eta1: float
    delta2: float
    delta3: float


@dataclass(frozen=True)
class Rates:
    """Derivatives by q = (phi, kappa, psi); columns are the coordinates.

    Those by kappa are multiplied by |f| where asked for, which keeps them finite at f = 0.

    Attributes
    ----------
    angular, centre : (3, 3) float64
        The platform's angular velocity and its centre's velocity.
    ends : (3, 3, 3) float64
        Of P1, P2, P3.
    theta1, l1, eta1, delta2, delta3 : (3,) float64
    """

    angular: Matrix
    centre: Matrix
    ends: NDArray[np.float64]
    theta1: Vector
    l1: Vector
    eta1: Vector
    delta2: Vector
    delta3: Vector

    @property
    def joints(self) -> Matrix:
        """Qq: rows theta1, phi and delta3."""
        return np.array([self.theta1, [1.0, 0.0, 0.0], self.delta3])


def configuration(parameters: Parameters, q: Vector, sign: float) -> Configuration:
    """Return the mechanism at internal coordinates; |kappa| beyond its limit counts as at f = 0."""
    a, c, length, r, big_r = _lengths(parameters)
    phi, kappa, psi = (float(v) for v in q)
    sk, ck = elementary.sin(kappa), elementary.cos(kappa)
    bar = uup_bar(sk, ck, a, c, length * length, sign)
    plane = _about_y(phi)
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, ck, -sk], [0.0, sk, ck]])
    rotation = product(product(plane, tilt), _about_y(psi))
    _, f, _, h, _ = bar
    y = f * c * sk
    middle = np.array([-r / 2, 0.0, 0.0]) + product(plane, [0.0, y, h])
    across = rotation[:, 0]
    base = np.array([[r, 0.0, 0.0], [-r / 2, a, 0.0], [-r / 2, -a, 0.0]])
    side = c * rotation[:, 1]
    ends = np.array([middle + 1.5 * big_r * across, middle + side, middle - side])
    vectors = ends - base
    lengths = np.linalg.norm(vectors, axis=1)
    w = vectors[0]
    return Configuration(
        q=np.array([phi, kappa, psi]),
        sign=sign,
        bar=bar,
        rotation=rotation,
        normal=plane[:, 0],
        middle=middle,
        centre=middle + big_r / 2 * across,
        base=base,
        ends=ends,
        lengths=lengths,
        directions=vectors / np.maximum(lengths, TINY)[:, None],
        theta1=elementary.atan2(w[0], w[2]),
        eta1=elementary.atan2(w[1], math.hypot(w[0], w[2])),
        delta2=elementary.atan2(y - a + c * ck, h + c * sk),
        delta3=elementary.atan2(y + a - c * ck, h - c * sk),
    )


def rates(parameters: Parameters, at: Configuration, scaled: bool = False) -> Rates:
    """Return the derivatives by q; those by kappa times |f| if scaled."""
    a, c, length, r, big_r = _lengths(parameters)
    _, f, g, h, h_k = at.bar
    scale = abs(f) if scaled else 1.0
    plane = _about_y(float(at.q[0]))
    sk, ck = elementary.sin(at.q[1]), elementary.cos(at.q[1])
    y = f * c * sk
    # Rates of M in the plane, by kappa: |f| times them is finite.
    y_k, h_k = (v if scaled else v / abs(f) for v in (at.sign * c * (g * sk + f * f * ck), h_k))
    across, o = at.rotation[:, 0], at.rotation[:, 1]
    angular = np.column_stack([[0.0, 1.0, 0.0], scale * at.normal, o])
    pivot = np.array([-r / 2, 0.0, 0.0])
    turned = np.cross([0.0, 1.0, 0.0], at.middle - pivot)
    middle = np.column_stack([turned, product(plane, [0.0, y_k, h_k]), np.zeros(3)])

    def moving(offset: Vector) -> Matrix:
        return middle + np.cross(angular.T, offset).T

    points = [moving(point - at.middle) for point in at.ends]
    w = at.ends[0] - at.base[0]
    flat2 = w[0] * w[0] + w[2] * w[2]
    l1, moved = float(at.lengths[0]), points[0]
    l1_q = product(w, moved) / max(l1, TINY)
    bars = []
    for sign, s_, c_ in ((1, y - a + c * ck, h + c * sk), (-1, y + a - c * ck, h - c * sk)):
        ds, dc = y_k - sign * scale * c * sk, h_k + sign * scale * c * ck
        bars.append(np.array([0.0, (ds * c_ - dc * s_) / (length * length), 0.0]))
    return Rates(
        angular=angular,
        centre=moving(big_r / 2 * across),
        ends=np.array(points),
        theta1=(moved[0] * w[2] - moved[2] * w[0]) / max(flat2, TINY),
        l1=l1_q,
        eta1=(moved[1] - w[1] / max(l1, TINY) * l1_q) / max(math.sqrt(flat2), TINY),
        delta2=bars[0],
        delta3=bars[1],
    )


class UuUpu(Mechanism):
    """The 2UU-UPU mechanism as 2UU-UPS."""

    name = "2uu-upu"
    title = "2UU-UPU (as 2UU-UPS)"
    description = (
        "one translation and two rotations (x, beta, gamma); sorting robot. The rod of the UPU "
        "limb is not keyed (2UU-UPS): the paper's own layout moves at one pose only"
    )
    source = "Dynamic Modeling and Simulation of a 3-DOF Parallel Sorting Robot"
    freedom = "1T2R"
    length_unit = "m"
    default_jacobian = "homogenized"
    length_meaning = "R = ps / sqrt 3, the platform's radius: angles become arcs at its corners"
    parameters = (
        Parameter("bs", "length", 0.35, (0.25, 0.5), True,
                  "side of the base triangle B1B2B3", _PAPER),
        Parameter("ps", "length", 0.31, (0.2, 0.45), True,
                  "side of the platform triangle P1P2P3", _PAPER),
        Parameter("L", "length", 0.25, (0.2, 0.4), True,
                  "link of the UU limbs, between their U joints", _PAPER),
    )  # fmt: skip
    pose = (
        Coordinate("x", "length", "platform centre, along the line from B2B3 to B1"),
        Coordinate("beta", "angle", "pitch, Rot = Rz(alpha) Ry(beta) Rx(gamma)"),
        Coordinate("gamma", "angle", "roll, Rot = Rz(alpha) Ry(beta) Rx(gamma)"),
    )
    parasitic = (
        Coordinate("y", "length", "platform centre, along B3B2"),
        Coordinate("z", "length", "platform centre, height over the base"),
        Coordinate("alpha", "angle", "yaw, Rot = Rz(alpha) Ry(beta) Rx(gamma)"),
    )
    joints = (
        Coordinate("theta1", "angle", "limb 1, first axis of its base U (along y)"),
        Coordinate("phi", "angle", "limb 2, first axis of its base U: turn of the limb plane"),
        Coordinate("delta3", "angle", "limb 3, second axis of its base U: swing in the plane"),
    )
    passive = (
        Coordinate("l1", "length", "limb 1, length B1P1"),
        Coordinate("eta1", "angle", "limb 1, second axis of its base U"),
        Coordinate("delta2", "angle", "limb 2, second axis of its base U: swing in the plane"),
        Coordinate("kappa", "angle", "turn of P2P3 against B2B3 in the limb plane"),
        Coordinate("psi", "angle", "turn of the platform about P2P3"),
    )
    limbs = (
        Limb("limb 1", "UPS",
             "U_B1 at B1 (first axis along y, theta1, actuated), telescope l1, S_P1 at P1",
             ("U_B1", "l1", "S_P1")),
        Limb("limb 2", "UU", "U_B2 at B2 (first axis along B2B3, phi, actuated), U_P2 at P2",
             ("U_B2", "U_P2")),
        Limb("limb 3", "UU",
             "U_B3 at B3 (second axis normal to the limb plane, delta3, actuated), U_P3 at P3",
             ("U_B3", "U_P3")),
    )  # fmt: skip
    layouts: ClassVar[Mapping[str, str]] = {
        "paper": "2UU-UPU as the paper names it: first and last axes radial, the others across "
        "the links, platform centred; free at that pose only"
    }
    conditions: ClassVar[Mapping[str, str]] = {
        "inverse": "dP_x/dv = 0: of all configurations with these beta and gamma P_x is extreme",
        "inverse, limb 1": "eta1 = +-90 deg: P1 is on theta1's axis",
        "forward": "link 2 is in line with P2P3, or theta1 does not hold psi",
        "forward, link 2": "kappa + delta2 = +-90 deg: link 2 is in line with P2P3",
        "forward, limb 1": "dtheta1/dpsi = 0: P1 moves in the plane of theta1's axis and limb 1",
    }
    working_modes = tuple(MODE_SIGNS)
    kernel = staticmethod(kernel)
    constants = Constants
    curve = Curve(0, uup_of_v)
    structure = STRUCTURE
    roles = ("x", "pitch", "roll")
    assembler = Assembler(uu_assemble, 4, 8, 1)
    inverter = Assembler(uup_invert, uup_MOST, 12, 9 * uup_ROOM + 4 * uup_MOST + 6)
    inverted_passive = ("l1", "eta1", "delta2", "kappa", "psi")
    completeness = "closed form: two circles, then two turns of the platform at most"
    freed = (
        "a forward singularity, P3 in B2 or P1 in theta1's plane at every turn; the platform is "
        "free to move"
    )
    parasitic_roles = ("y", "z", "yaw")

    def characteristic_length(self, parameters: Parameters) -> float:
        """Return R = ps / sqrt 3."""
        return _lengths(parameters)[4]

    def reach_box(self, parameters: Parameters, limits: Ranges) -> tuple[Vector, Vector]:
        """Return |P_x + r/2| <= highest M + R/2, cut by |P1 - B1| <= l1; angles in full."""
        a, c, length, r, big_r = _lengths(parameters)
        height = math.sqrt(max(length * length - (a - c) * (a - c), 0.0))
        low, high = -r / 2 - height - big_r / 2, -r / 2 + height + big_r / 2
        longest = limits.get("l1", (-math.inf, math.inf))[1]
        low, high = max(low, r - longest - big_r), min(high, r + longest + big_r)
        if height == 0.0 or low >= high:
            return np.zeros(3), np.zeros(3)
        angles = np.array([math.pi / 2, math.pi])
        return np.array([low, *-angles]), np.array([high, *angles])

    def default_domain(self, parameters: Parameters) -> Ranges:
        """Return tilts up to 60 degrees (ours)."""
        return {"beta": (-math.pi / 3, math.pi / 3), "gamma": (-math.pi / 3, math.pi / 3)}

    def bodies(self, parameters: Parameters) -> tuple[Body, ...]:
        """Return a cylinder and a rod keyed to it, two links and a triangular plate, of steel."""
        length = _lengths(parameters)[2]
        tube_length = 0.64 * length
        link = tube(0.02, length, 1.0)
        rod = tube(0.015, tube_length, 1.0).at((0.0, 0.0, -tube_length))
        return (
            tube(0.025, tube_length, 1.0).body("limb 1 cylinder", 0, 0),
            rod.body("limb 1 rod", 0, 1),
            link.body("limb 2 link", 1, 0),
            link.body("limb 3 link", 2, 0),
            triangle(float(parameters["ps"] or 0.0), 0.01, 1.0).body("platform"),
        )

    def default_limits(self, parameters: Parameters) -> Ranges:
        """Return l1 between 0.64 L and 1.12 L: the paper's stroke of 120 mm at L = 250 mm."""
        length = _lengths(parameters)[2]
        return {"l1": (length * 16 / 25, length * 28 / 25)}

    def home(self, parameters: Parameters) -> dict[str, float]:
        """Return the level pose with P1 further out than B1 by a third of the limbs' height."""
        a, c, length, r, big_r = _lengths(parameters)
        height = math.sqrt(max(length * length - (a - c) * (a - c), 0.0))
        out = height / 3 - 1.5 * (big_r - r)
        out = min(max(out, -0.9 * height), 0.9 * height)
        return {"x": out + (big_r - r) / 2, "beta": 0.0, "gamma": 0.0}

    def reach(self, parameters: Parameters, pose: Mapping[str, float]) -> tuple[Reach, ...]:
        """Return l1's distance to its stroke, and how far the UU limbs are from stretched.

        The two UU limbs reach a pose together: outside it is the miss in x, inside the lesser of
        L - rho and (dP_x/dv)^2 / L, 0 where P_x is extreme. Of the first working mode.
        """
        length = _lengths(parameters)[2]
        mode = self.working_modes[0]
        q, miss, slope, sign = _nearest(parameters, pose, mode)
        at = configuration(parameters, q, sign)
        l1 = float(at.lengths[0])
        low, high = self.default_limits(parameters)["l1"]
        stretched = length - length / math.sqrt(max(at.bar.excess + 1.0, TINY))
        plane = min(slope * abs(slope) / length, stretched)
        if abs(miss) > uup_CLOSE * length:
            plane = min(plane, -abs(miss))
        return (
            Reach(
                "limb 1",
                min(l1 - low, high - l1),
                "too far" if l1 - low > high - l1 else "too close",
            ),
            Reach("limb 2", plane, "too far"),
            Reach("limb 3", plane, "too far"),
        )

    def inverse(
        self, parameters: Parameters, pose: Mapping[str, float]
    ) -> tuple[InverseSolution, ...]:
        """Return every root of P_x = x: those of the working modes first, as far as there are any.

        A working mode's root is on the piece of the curve about v = 0 on which P_x is monotonic.
        The others of the same sign of f are "up-2", "up-3", .. and "down-2", .., from v = 0
        outwards: beyond P_x's extremes, where the limb plane is folded down or kappa is large. No
        workspace is told in them.
        """
        return self.inverted(parameters, [pose])[0]

    def branch(self, number: int) -> str:
        """Return the name of a branch of :func:`uup_invert`."""
        mode = self.working_modes[number % 2]
        return mode if number < 2 else f"{mode}-{number // 2 + 1}"

    def inversion_constants(self, parameters: Parameters) -> list[float]:
        """Return the constants of :func:`uup_invert`."""
        return [*_lengths(parameters), _geometry(parameters, self.working_modes[0]).far_cos]

    def assembly_constants(self, parameters: Parameters) -> list[float]:
        """Return the constants of :func:`uu_assemble`."""
        return [*_lengths(parameters), *self.home(parameters).values()]

    def velocity_maps(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> tuple[Matrix, Matrix]:
        """Return J_X = Qq adj(Xq), J_q = det(Xq): J^-1 = Qq Xq^-1, finite at singularities.

        Xq and Qq are the derivatives of pose and joints by q, those by kappa times |f|.
        """
        at = _matching(parameters, pose, joints)
        rate = rates(parameters, at, scaled=True)
        x_q = _pose_rates(rate, at.rotation)
        adjugate = np.cross(x_q[[1, 2, 0]], x_q[[2, 0, 1]]).T
        cb = elementary.cos(pose["beta"])
        j_x = product(product(rate.joints, adjugate), np.diag([1.0, cb, cb * cb]))
        return j_x, float(product(x_q[0], adjugate[:, 0])) * np.eye(3)

    def singularity_measures(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> dict[str, dict[str, float]]:
        """Return what vanishes where links or coordinates lose a freedom, all in [-1, 1].

        Inverse: cos eta1 for limb 1; for both UU limbs together dP_x/dv / (L + R), 0 where P_x is
        extreme. Forward: cos(kappa + d2), 0 where link 2 is in line with the coupler, and the
        cosine between the velocity of P1 by psi and the direction theta1 moves it; ``platform``
        is their product.
        """
        _, _, length, _, big_r = _lengths(parameters)
        at = _matching(parameters, pose, joints)
        x_q = _pose_rates(rates(parameters, at, scaled=True), at.rotation)
        across, o = at.rotation[:, 0], at.rotation[:, 1]
        # rho^2 = L^2 / (excess + 1); the determinant is |f| cos phi cos^2 beta dP_x/dv.
        shrink = across[0] * across[0] + across[1] * across[1]
        shrink *= math.sqrt(max(at.bar.excess + 1.0, TINY))
        extreme = -float(determinant(x_q) / (max(shrink, TINY) * (length + big_r)))
        direction = np.array([elementary.cos(at.theta1), 0.0, -elementary.sin(at.theta1)])
        in_line = elementary.cos(at.q[1] + at.delta2)
        lever = float(product(direction, np.cross(o, across)))
        return {
            "inverse": {"limb 1": elementary.cos(at.eta1), "limb 2": extreme, "limb 3": extreme},
            "forward": {"platform": in_line * lever, "link 2": in_line, "limb 1": lever},
        }

    def velocity_map_units(self) -> dict[str, str]:
        """Return the units of J_X and J_q."""
        return {
            "J_X": "columns in rad; m; m",
            "J_q": "m, times the identity",
        }

    def why_not(self, parameters: Parameters, joints: Mapping[str, float]) -> str:
        """Say whether the links or the platform's turn can not be assembled."""
        _, c, length, _, _ = _lengths(parameters)
        span = _span(parameters, joints)
        if span > length + 2 * c or span < abs(length - 2 * c):
            return (
                f"P3 is {span:.6g} m from B2, which link 2 and the platform's side do not span "
                f"(from {abs(length - 2 * c):.6g} to {length + 2 * c:.6g} m)"
            )
        return "no turn of the platform about P2P3 brings P1 in line with theta1"

    def platform(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Matrix, Vector]:
        """Return Rot and P."""
        at = self.at(parameters, pose, working_mode)
        return at.rotation, at.centre

    def at(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> Configuration:
        """Return the mechanism at a pose.

        Raises
        ------
        UnreachableError
            If the working mode has no solution there.
        """
        mode = self.check_mode(working_mode)
        found = _root(parameters, pose, mode)
        if found is None:
            shown = ", ".join(f"{k}={v!r}" for k, v in pose.items())
            raise UnreachableError(f"{self.name} can not reach {shown} in working mode {mode}")
        return found

    def points_at(
        self, parameters: Parameters, pose: Mapping[str, float], mode: str, constants: Any
    ) -> Points:
        """Return the points at the root of the scan: exact where the kernel's steps end near it.

        Raises
        ------
        UnreachableError
            If the working mode has no solution there.
        """
        phi, kappa, psi = self.at(parameters, pose, mode).q.tolist()
        turn = Turn(*elementary.sin_cos(phi), *elementary.sin_cos(kappa), *elementary.sin_cos(psi))
        found: Points = uup_placed(turn, constants)
        return found

    def alternative_layout(self, parameters: Parameters, name: str) -> tuple[Chain, ...]:
        """Return the paper's limbs with the platform centred and level above the base."""
        if name not in self.layouts:
            raise unknown_name("layout", name, self.layouts)
        _, _, length, r, big_r = _lengths(parameters)
        rise = length * length - (r - big_r) * (r - big_r)
        if rise <= 0.0:
            raise UnreachableError(
                f"{self.name}: L = {length!r} m does not reach a centred platform"
            )
        chains = []
        for k in range(3):
            turn = 2 * math.pi / 3 * k
            radial = np.array([elementary.cos(turn), elementary.sin(turn), 0.0])
            tangent = np.array([-elementary.sin(turn), elementary.cos(turn), 0.0])
            base, end = r * radial, big_r * radial + [0.0, 0.0, math.sqrt(rise)]
            # Limb 1's slider is driven by its first axis; so are the others by theirs.
            lower = Joint("U", base, (radial, tangent), drive=(self.joints[k].name, int(k == 2)))
            slider = (Joint("P", base, ((end - base) / length,)),) if k == 0 else ()
            upper = Joint("U", end, (tangent, radial))
            chains.append(Chain(f"limb {k + 1}", (lower, *slider, upper)))
        return tuple(chains)

    def kernel_constants(
        self, parameters: Parameters, working_mode: str, length: float, limits: Ranges
    ) -> Constants:
        """Return the constants of a design."""
        home = _root(parameters, self.home(parameters), working_mode)
        # Without a home there is nothing to measure from: every cone angle counts as 90 degrees.
        references = np.zeros((3, 3)) if home is None else product(home.directions, home.rotation)
        home1, home2, home3 = (Vec3(*row) for row in references.tolist())
        return Constants(
            geometry=_geometry(parameters, working_mode),
            weight=length,
            theta1=_arc(limits.get("theta1")),
            phi=_arc(limits.get("phi")),
            delta3=_arc(limits.get("delta3")),
            l1=Stroke(*limits.get("l1", (-math.inf, math.inf))),
            eta1=_arc(limits.get("eta1")),
            delta2=_arc(limits.get("delta2")),
            kappa=_arc(limits.get("kappa")),
            psi=_arc(limits.get("psi")),
            home1=home1,
            home2=home2,
            home3=home3,
        )

    def idle_slacks(self, limits: Ranges) -> frozenset[int]:
        """Return the slacks of angles that may turn in full: 3 to 9."""
        names = ("theta1", "phi", "delta3", "eta1", "delta2", "kappa", "psi")
        turn = (-math.inf, math.inf)
        return frozenset(
            3 + k
            for k, name in enumerate(names)
            if not limits.get(name, turn)[1] - limits.get(name, turn)[0] < 2 * math.pi
        )


def _lengths(parameters: Parameters) -> tuple[float, float, float, float, float]:
    """Return a, c, L, r and R: half the sides, the link and the radii."""
    base, side, length = (float(parameters[k] or 0.0) for k in ("bs", "ps", "L"))
    return base / 2, side / 2, length, base / math.sqrt(3), side / math.sqrt(3)


def _geometry(parameters: Parameters, mode: str) -> Geometry:
    """Return the lengths of a design and its working mode."""
    a, c, length, r, big_r = _lengths(parameters)
    up = MODE_SIGNS[mode]
    # The cotangent of the largest |kappa|, where rho = L.
    cosine = (a * a + c * c - length * length) / (2 * a * c)
    far = cosine / math.sqrt(1 - cosine * cosine) if abs(cosine) < 1 else math.copysign(1e9, cosine)
    return Geometry(a, c, length * length, length, r, big_r, up if a >= c else -up, up, far)


def _arc(limits: tuple[float, float] | None) -> Arc:
    """Return the range of an angle; all angles without limits."""
    low, high = limits or (-math.inf, math.inf)
    # A full turn excludes nothing, not even by rounding.
    if not high - low < 2 * math.pi:
        return Arc(1.0, 0.0, -2.0)
    sine, cosine = elementary.sin_cos((low + high) / 2)
    return Arc(cosine, sine, elementary.cos((high - low) / 2) - 4e-16)


def _about_y(angle: float) -> Matrix:
    s, c = elementary.sin(angle), elementary.cos(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _pose_rates(rate: Rates, rotation: Matrix) -> Matrix:
    """Return the rates of x, of beta times cos beta and of gamma times cos^2 beta, by q."""
    across, w = rotation[:, 0], rate.angular
    return np.array(
        [rate.centre[0], across[0] * w[1] - across[1] * w[0], across[0] * w[0] + across[1] * w[1]]
    )


def _tilt(pose: Mapping[str, float]) -> Tilt:
    """Return the curve that a pose's tilt leaves."""
    (rise, cb), (sg, cg) = (elementary.sin_cos(pose[name]) for name in ("beta", "gamma"))
    m, level = cb * sg, cb * cg
    mu = math.hypot(rise, level) + TINY
    return Tilt(m, mu, rise / mu, level / mu)


def _q(turn: Turn) -> Vector:
    return elementary.each(
        elementary.atan2, [turn.sphi, turn.sk, turn.spsi], [turn.cphi, turn.ck, turn.cpsi]
    )


def _nearest(
    parameters: Parameters, pose: Mapping[str, float], mode: str
) -> tuple[Vector, float, float, float]:
    """Return q where P_x is nearest to x as the kernel finds it, the miss, the slope and s."""
    geometry = _geometry(parameters, mode)
    with np.errstate(over="ignore", invalid="ignore"):  # far off: told by the miss
        found = uup_pose(pose["x"], pose["beta"], pose["gamma"], geometry)
    return _q(found.turn), found.miss, found.slope, geometry.s


def _root(parameters: Parameters, pose: Mapping[str, float], mode: str) -> Configuration | None:
    """Return the mode's root of P_x = x, if there is one; see :func:`uup_main`."""
    a, c, l2, length, r, big_r, s, up, far_cos = _geometry(parameters, mode)
    tilt = _tilt(pose)
    far = uup_far(tilt.m, tilt.mu, far_cos)
    u, there = uup_main(pose["x"] + r / 2, tilt, far, Sizes(a, c, l2, big_r / 2, s), up, length)
    at = configuration(parameters, _q(uup_turn(u, tilt)), s)
    return at if there and at.bar.excess >= 0.0 else None


def _matching(
    parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
) -> Configuration:
    """Return the configuration of a pose that has these joint positions, on any branch.

    Kappa follows from o's height, cos phi sin kappa = m, and from the circles about B2 and P3 that
    P2 lies on: of two crossings the one that fits the pose, of two ways the one that errs less.
    """
    a, c, length, _, _ = _lengths(parameters)
    m, _, sw, cw = _tilt(pose)
    phi, d3 = joints["phi"], joints["delta3"]
    sphi, cphi = elementary.sin(phi), elementary.cos(phi)
    p3 = np.array([-a + length * elementary.sin(d3), length * elementary.cos(d3)])
    couplers, rise = _couplers(parameters, p3)

    def at(sk: float, ck: float) -> Configuration:
        ym, hm = p3 + c * np.array([ck, sk])
        sign = 1.0 if ym * c * sk + hm * (a - c * ck) >= 0.0 else -1.0
        psi = elementary.atan2(sw, cw) - elementary.atan2(sphi, cphi * ck)
        return configuration(parameters, np.array([phi, elementary.atan2(sk, ck), psi]), sign)

    def gap(found: Configuration) -> float:
        return float(abs(found.rotation[2, 1] - m) + abs(found.centre[0] - pose["x"]) / length)

    if not couplers:  # P3 in B2: kappa from the height alone
        couplers, rise = [np.array([ck, m / cphi]) for ck in (1.0, -1.0)], -1.0
    best = min((at(float(sk), float(ck)) for ck, sk in couplers), key=gap)
    ck = elementary.cos(best.q[1])
    if abs(cphi * ck) > rise:
        sk = min(max(m / cphi, -1.0), 1.0)
        best = at(sk, math.copysign(math.sqrt(1 - sk * sk), ck))
    return best


def _couplers(parameters: Parameters, p3: Vector) -> tuple[list[Vector], float]:
    """Return both (cos kappa, sin kappa) that link 2 allows with P3 at p3, in (y, height).

    With them the sine of the angle between B2P3 and P2P3, 0 where both are one; below 0 where
    link 2 and the platform's side do not span it.
    """
    a, c, length, _, _ = _lengths(parameters)
    between = np.array([a, 0.0]) - p3
    span = math.hypot(*between)
    if span <= TINY:
        return [], -1.0
    cosine = (4 * (c * c) - length * length + span * span) / (4 * c * span)
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    forth = between / span
    left = np.array([-forth[1], forth[0]])
    fits = cosine * cosine - 1.0 < 1e-12 * (length / (2 * c)) * (length / (2 * c))
    return [cosine * forth + side * sine * left for side in (1.0, -1.0)], sine if fits else -1.0


def _span(parameters: Parameters, joints: Mapping[str, float]) -> float:
    """Return the distance of P3 from B2."""
    a, _, length, _, _ = _lengths(parameters)
    d3 = joints["delta3"]
    return math.hypot(length * elementary.sin(d3) - 2 * a, length * elementary.cos(d3))


MECHANISM = UuUpu()

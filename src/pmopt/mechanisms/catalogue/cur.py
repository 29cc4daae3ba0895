"""3-CUR: one translation and two rotations; three CUR limbs with vertical cylindrical joints.

Symbols as in the paper on the 3-CUR mechanism: h, theta2 .. theta5, alpha, beta, gamma. Limb i at
azimuth 0, 120, 240 degrees with r_i radial and t_i tangential; A_i = Ra r_i, b_i = Rb r_i,
Rot = Rz(alpha) Ry(beta) Rx(gamma), e_i = Rot t_i, w_i = P + Rot b_i - A_i - (h_i + d1) z::

    e_i . w_i = 0        |w_i| = L

z, beta and gamma are free; x, y and alpha follow. The two conditions say that with theta_i, the
theta5 of limb i, w_i = L Rot (cos theta_i r_i + sin theta_i z). In the frame that yaws with the
platform (r_i' = Ry Rx r_i and z' = Ry Rx z are known there) the limbs close horizontally where::

    p + Rb r_i' - Rz(-alpha) A_i = L (cos theta_i r_i' + sin theta_i z')

Six equations for p (of which x, y come by turning it), alpha and the theta_i, solved by Newton's
method; nothing special happens to them where a link lies flat. Then h_i = z + (Rb r_i')_z - w_iz
- d1: z decouples from the rest.

n_i = (u, v) is the horizontal normal of the derivative of w_i by theta_i. The force by which limb i
constrains the platform goes along it, through the U joint: L n_i = w_iz e_i - e_iz w_i.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np

from pmopt.compiler.programs import Assembler
from pmopt.errors import InputError
from pmopt.kernels.limbs import crossed
from pmopt.kernels.octics import bernstein, nodes
from pmopt.kernels.trigonometry import arc_tangent, sin_cos
from pmopt.mechanisms.bodies import Body, disc, plate, tube
from pmopt.mechanisms.catalogue.cur_forward import cur_assemble, cur_MODES, cur_WORK
from pmopt.mechanisms.mechanism import (
    PLATFORM,
    Chain,
    Coordinate,
    Implicit,
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
from pmopt.numerics import elementary
from pmopt.numerics.matrices import determinant, dot, norm_of, product, solve
from pmopt.numerics.rotation import rotation_matrices

TINY = 1e-300
#: Cosine and sine of the azimuths.
CUR_C2 = -0.5
CUR_S2 = 0.8660254037844386
#: A gap in closing beyond this (over L) means that there is no solution.
CUR_TOLERANCE = 1e-10
#: Height of a link over L below which it does not tell the working mode.
NEARLY_FLAT = 1e-6
#: Longest Newton step of each unknown, lengths over L.
CUR_LONGEST = 0.5

MODE_SIGNS = {
    "-".join("up" if s > 0 else "down" for s in signs): signs
    for signs in itertools.product((1.0, -1.0), repeat=3)
}

_OURS = "ours: the paper gives no sizes"


def cur_tilt(beta, gamma):  # type: ignore[no-untyped-def]
    """Return the horizontal parts of r_1', r_2', r_3' and z'; r_1' has no y."""
    sin_b, cos_b = sin_cos(beta)
    sin_g, cos_g = sin_cos(gamma)
    tx = CUR_S2 * (sin_b * sin_g)
    ty = CUR_S2 * cos_g
    rx = CUR_C2 * cos_b
    return cos_b, rx + tx, ty, rx - tx, -ty, sin_b * cos_g, -sin_g


def cur_columns(c, s, ra):  # type: ignore[no-untyped-def]
    """Return Rz(-alpha) A_i, two coordinates each."""
    cx = CUR_C2 * ra * c
    cy = CUR_C2 * ra * s
    sx = CUR_S2 * ra * s
    sy = CUR_S2 * ra * c
    return ra * c, -ra * s, cx + sx, sy - cy, cx - sx, -sy - cy


def cur_gap(px, py, ax, ay, rx, ry, zx, zy, c, s, rb):  # type: ignore[no-untyped-def]
    """Return n of a limb, its moment about the origin, and by how much the limb does not close."""
    u = c * zy - s * ry
    v = s * rx - c * zx
    gap_x = px + (rb - c) * rx - s * zx - ax
    gap_y = py + (rb - c) * ry - s * zy - ay
    return u, v, ax * v - ay * u, gap_x, gap_y


def cur_adjugate(a, b, c, d, e, f, g, h, i):  # type: ignore[no-untyped-def]
    """Return adjugate and determinant of [[a, b, c], [d, e, f], [g, h, i]]."""
    m11 = e * i - f * h
    m21 = f * g - d * i
    m31 = d * h - e * g
    return (
        m11, c * h - b * i, b * f - c * e,
        m21, a * i - c * g, c * d - a * f,
        m31, b * g - a * h, a * e - b * d,
        a * m11 + b * m21 + c * m31,
    )  # fmt: skip


def cur_short(step):  # type: ignore[no-untyped-def]
    """Return a step, shortened to the longest that is allowed."""
    step = step if step < CUR_LONGEST else CUR_LONGEST
    return step if step > -CUR_LONGEST else -CUR_LONGEST


def cur_turned(c, s, angle):  # type: ignore[no-untyped-def]
    """Return cosine and sine turned by a small angle; to second order of a unit vector."""
    turned_c = c - angle * s
    turned_s = s + angle * c
    scale = 1.5 - 0.5 * (turned_c * turned_c + turned_s * turned_s)
    return turned_c * scale, turned_s * scale


def cur_along(limb, dx, dy):  # type: ignore[no-untyped-def]
    """Return the turn of theta that closes a limb's gap, once moved by dx, dy, along itself."""
    u, v, _, gap_x, gap_y = limb
    return cur_short((u * (gap_y + dy) - v * (gap_x + dx)) / (u * u + v * v + TINY))


def cur_step(state, tilt, ra, rb):  # type: ignore[no-untyped-def]
    """Return p, cos, sin of alpha and of the theta after a Newton step at a tilt; L is 1."""
    px, py, c, s, c1, s1, c2, s2, c3, s3 = state
    r1x, r2x, r2y, r3x, r3y, zx, zy = tilt
    a1x, a1y, a2x, a2y, a3x, a3y = cur_columns(c, s, ra)
    k1 = cur_gap(px, py, a1x, a1y, r1x, 0.0, zx, zy, c1, s1, rb)
    k2 = cur_gap(px, py, a2x, a2y, r2x, r2y, zx, zy, c2, s2, rb)
    k3 = cur_gap(px, py, a3x, a3y, r3x, r3y, zx, zy, c3, s3, rb)
    # Across w's derivative by theta three equations are left, in p and alpha.
    f1 = k1[0] * k1[3] + k1[1] * k1[4]
    f2 = k2[0] * k2[3] + k2[1] * k2[4]
    f3 = k3[0] * k3[3] + k3[1] * k3[4]
    adj = cur_adjugate(k1[0], k1[1], k1[2], k2[0], k2[1], k2[2], k3[0], k3[1], k3[2])
    unit = -adj[9] / (adj[9] * adj[9] + TINY)
    dx = cur_short((adj[0] * f1 + adj[1] * f2 + adj[2] * f3) * unit)
    dy = cur_short((adj[3] * f1 + adj[4] * f2 + adj[5] * f3) * unit)
    da = cur_short((adj[6] * f1 + adj[7] * f2 + adj[8] * f3) * unit)
    c1, s1 = cur_turned(c1, s1, cur_along(k1, dx - a1y * da, dy + a1x * da))
    c2, s2 = cur_turned(c2, s2, cur_along(k2, dx - a2y * da, dy + a2x * da))
    c3, s3 = cur_turned(c3, s3, cur_along(k3, dx - a3y * da, dy + a3x * da))
    c, s = cur_turned(c, s, da)
    return px + dx, py + dy, c, s, c1, s1, c2, s2, c3, s3


def cur_ahead(state, before, share):  # type: ignore[no-untyped-def]
    """Return a state as far ahead as the last one is behind, or a share of that."""
    px, py, c, s, c1, s1, c2, s2, c3, s3 = state
    qx, qy, d, t, d1, t1, d2, t2, d3, t3 = before
    c, s = cur_turned(c, s, cur_short(share * (s * d - c * t)))
    c1, s1 = cur_turned(c1, s1, cur_short(share * (s1 * d1 - c1 * t1)))
    c2, s2 = cur_turned(c2, s2, cur_short(share * (s2 * d2 - c2 * t2)))
    c3, s3 = cur_turned(c3, s3, cur_short(share * (s3 * d3 - c3 * t3)))
    return px + share * (px - qx), py + share * (py - qy), c, s, c1, s1, c2, s2, c3, s3


def cur_solve(beta, gamma, ra, rb, up1, up2, up3):  # type: ignore[no-untyped-def]
    """Return p, cos, sin of alpha and of the theta, and the largest gap left; L is 1.

    From the level platform by way of 0.3, 0.6 and 0.8 of the tilt. Steps are written out: a loop
    within the sweep's loop over poses would keep that from being vectorised.
    """
    level = rb - ra
    square = 1.0 - level * level
    rise = math.sqrt(square if square > 0.0 else 0.0)
    home = (0.0, 0.0, 1.0, 0.0, level, up1 * rise, level, up2 * rise, level, up3 * rise)
    first = cur_step(home, cur_tilt(0.3 * beta, 0.3 * gamma), ra, rb)
    state = cur_ahead(first, home, 1.0)
    second = cur_step(state, cur_tilt(0.6 * beta, 0.6 * gamma), ra, rb)
    state = cur_ahead(second, first, 0.2 / 0.3)
    third = cur_step(state, cur_tilt(0.8 * beta, 0.8 * gamma), ra, rb)
    state = cur_ahead(third, second, 1.0)
    tilt = cur_tilt(beta, gamma)
    state = cur_step(state, tilt, ra, rb)
    state = cur_step(state, tilt, ra, rb)
    state = cur_step(state, tilt, ra, rb)
    state = cur_step(state, tilt, ra, rb)
    state = cur_step(state, tilt, ra, rb)
    state = cur_step(state, tilt, ra, rb)
    state = cur_step(state, tilt, ra, rb)
    px, py, c, s, c1, s1, c2, s2, c3, s3 = state
    r1x, r2x, r2y, r3x, r3y, zx, zy = tilt
    a1x, a1y, a2x, a2y, a3x, a3y = cur_columns(c, s, ra)
    k1 = cur_gap(px, py, a1x, a1y, r1x, 0.0, zx, zy, c1, s1, rb)
    k2 = cur_gap(px, py, a2x, a2y, r2x, r2y, zx, zy, c2, s2, rb)
    k3 = cur_gap(px, py, a3x, a3y, r3x, r3y, zx, zy, c3, s3, rb)
    worst = cur_more(abs(k1[3]), abs(k1[4]))
    worst = cur_more(worst, cur_more(abs(k2[3]), abs(k2[4])))
    worst = cur_more(worst, cur_more(abs(k3[3]), abs(k3[4])))
    # A platform that can not be level has no home to start from.
    worst = worst if square > 0.0 else cur_more(worst, 1.0)
    return px, py, c, s, c1, s1, c2, s2, c3, s3, worst


def cur_less(a, b):  # type: ignore[no-untyped-def]
    """Return the lesser of two."""
    return a if a < b else b


def cur_more(a, b):  # type: ignore[no-untyped-def]
    """Return the greater of two."""
    return a if a > b else b


def cur_heights(beta, gamma, c1, s1, c2, s2, c3, s3):  # type: ignore[no-untyped-def]
    """Return the z of r_i', of e_i and of w_i over L, limb by limb."""
    sin_b, cos_b = sin_cos(beta)
    sin_g, cos_g = sin_cos(gamma)
    tz = cos_b * sin_g
    zz = cos_b * cos_g
    r2z = CUR_S2 * tz - CUR_C2 * sin_b
    r3z = -CUR_S2 * tz - CUR_C2 * sin_b
    return (
        -sin_b, tz, s1 * zz - c1 * sin_b,
        r2z, CUR_C2 * tz + CUR_S2 * sin_b, s2 * zz + c2 * r2z,
        r3z, CUR_C2 * tz - CUR_S2 * sin_b, s3 * zz + c3 * r3z,
    )  # fmt: skip


def cur_limits(up, c, s, ez, wz, limits):  # type: ignore[no-untyped-def]
    """Return the least slack over L of a limb's reach and of its passive joints' limits.

    theta4 turns the U joint's first axis, along n, to e: n . e = w_z and n . w = -e_z L^2 give
    tan theta4 = e_z L / w_z, and |n|^2 = w_z^2 + e_z^2 L^2.
    """
    cos4, sin4, least4, cos5, sin5, least5, low, high = limits
    height = up * wz
    unit = 1.0 / math.sqrt(wz * wz + ez * ez + TINY)
    slack = cur_less(height, cur_less(wz - low, high - wz))
    slack = cur_less(slack, (height * cos4 + up * ez * sin4) * unit - least4)
    return cur_less(slack, c * cos5 + s * sin5 - least5)


def cur_rates(about_x, about_y, d, rb, rx, ry, rz, wx, wy, wz):  # type: ignore[no-untyped-def]
    """Return w_z h' of a limb by turns about x and y, times det F, and the rates that follow."""
    turn = rb * (wy * rx - wx * ry)
    return (
        d * rb * (wz * ry - wy * rz) + wx * about_x[0] + wy * about_x[1] + turn * about_x[2],
        d * rb * (wx * rz - wz * rx) + wx * about_y[0] + wy * about_y[1] + turn * about_y[2],
    )


def cur_outcome(z, beta, gamma, state, closed, constants):  # type: ignore[no-untyped-def]
    """Return the margin and J^-1 times the determinants that can vanish, of a state.

    ``closed`` is >= 0 where the state closes the limbs. With rows F_i = (u, v, moment about P) of
    what holds x, y and alpha, and l_i the height of U_i over P, a turn about x or y of the yawing
    frame calls for F (x', y', alpha') = (l v, -l u); then w_z h' = w . (v + omega x b). About x
    counts with cos beta: the rest of the axis of gamma is along z and alpha makes up for it.
    Everything is multiplied by det F and the three w_z.
    """
    (
        ra, rb, length, d1, up1, up2, up3, scale, low1, high1, low2, high2, low3, high3,
        cos4, sin4, least4, cos5, sin5, least5, low, high,
        _, _, _, _, _, _, _, _, _,
    ) = constants  # fmt: skip
    ra = ra / length
    rb = rb / length
    px, py, c, s, c1, s1, c2, s2, c3, s3 = state
    r1z, e1z, w1z, r2z, e2z, w2z, r3z, e3z, w3z = cur_heights(beta, gamma, c1, s1, c2, s2, c3, s3)
    limits = (cos4, sin4, least4, cos5, sin5, least5, low, high)
    margin = cur_less(closed, cur_limits(up1, c1, s1, e1z, w1z, limits))
    margin = cur_less(margin, cur_limits(up2, c2, s2, e2z, w2z, limits))
    margin = cur_less(margin, cur_limits(up3, c3, s3, e3z, w3z, limits))
    l1 = rb * r1z - w1z
    l2 = rb * r2z - w2z
    l3 = rb * r3z - w3z
    h1 = z + length * l1 - d1
    h2 = z + length * l2 - d1
    h3 = z + length * l3 - d1
    margin = cur_less(length * margin, cur_less(h1 - low1, high1 - h1))
    margin = cur_less(margin, cur_less(h2 - low2, high2 - h2))
    margin = cur_less(margin, cur_less(h3 - low3, high3 - h3))

    r1x, r2x, r2y, r3x, r3y, zx, zy = cur_tilt(beta, gamma)
    a1x, a1y, a2x, a2y, a3x, a3y = cur_columns(c, s, ra)
    # About P: the moments of A_i - P, which are b_i - w_i horizontally.
    u1, v1, m1, _, _ = cur_gap(0.0, 0.0, a1x - px, a1y - py, r1x, 0.0, zx, zy, c1, s1, rb)
    u2, v2, m2, _, _ = cur_gap(0.0, 0.0, a2x - px, a2y - py, r2x, r2y, zx, zy, c2, s2, rb)
    u3, v3, m3, _, _ = cur_gap(0.0, 0.0, a3x - px, a3y - py, r3x, r3y, zx, zy, c3, s3, rb)
    a11, a12, a13, a21, a22, a23, a31, a32, a33, d = cur_adjugate(
        u1, v1, m1, u2, v2, m2, u3, v3, m3
    )
    about_x = (
        a11 * l1 * v1 + a12 * l2 * v2 + a13 * l3 * v3,
        a21 * l1 * v1 + a22 * l2 * v2 + a23 * l3 * v3,
        a31 * l1 * v1 + a32 * l2 * v2 + a33 * l3 * v3,
    )
    about_y = (
        -(a11 * l1 * u1 + a12 * l2 * u2 + a13 * l3 * u3),
        -(a21 * l1 * u1 + a22 * l2 * u2 + a23 * l3 * u3),
        -(a31 * l1 * u1 + a32 * l2 * u2 + a33 * l3 * u3),
    )
    x1, y1 = cur_rates(about_x, about_y, d, rb, r1x, 0.0, r1z, c1 * r1x + s1 * zx, s1 * zy, w1z)
    x2, y2 = cur_rates(
        about_x, about_y, d, rb, r2x, r2y, r2z, c2 * r2x + s2 * zx, c2 * r2y + s2 * zy, w2z
    )
    x3, y3 = cur_rates(
        about_x, about_y, d, rb, r3x, r3y, r3z, c3 * r3x + s3 * zx, c3 * r3y + s3 * zy, w3z
    )
    scale = scale * length
    scale_x = scale * r1x  # r_1' is cos beta along x
    z23 = w2z * w3z
    z13 = w1z * w3z
    z12 = w1z * w2z
    all_z = d * z12 * w3z
    return (
        margin,
        all_z, y1 * z23 * scale, x1 * z23 * scale_x,
        all_z, y2 * z13 * scale, x2 * z13 * scale_x,
        all_z, y3 * z12 * scale, x3 * z12 * scale_x,
    )  # fmt: skip


def cur_kernel(z, beta, gamma, constants):  # type: ignore[no-untyped-def]
    """Return the margin and J^-1 times the determinants that can vanish; see cur_outcome."""
    (
        ra, rb, length, _, up1, up2, up3, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _,
        _, _, _, _, _, _, _, _, _,
    ) = constants  # fmt: skip
    ra = ra / length
    rb = rb / length
    px, py, c, s, c1, s1, c2, s2, c3, s3, gap = cur_solve(beta, gamma, ra, rb, up1, up2, up3)
    closed = 1.0 if gap <= CUR_TOLERANCE else -gap
    state = (px, py, c, s, c1, s1, c2, s2, c3, s3)
    return cur_outcome(z, beta, gamma, state, closed, constants)


def cur_principal(angle):  # type: ignore[no-untyped-def]
    """Return -pi, which rounding may give, as pi."""
    return angle if angle > -math.pi else math.pi


def cur_passive(out, across, lean, turn, yaw, place):  # type: ignore[no-untyped-def]
    """Return theta2 .. theta5 and the elevation of a limb.

    Parameters
    ----------
    out, across, lean : tuple of 3
        r_i, t_i and z of the platform, before it yaws.
    turn, yaw : tuple of 2
        Cosine and sine of theta5 and of alpha.
    place : tuple of 2
        Cosine and sine of the limb's azimuth.
    """
    ct, st = turn
    c, s = yaw
    ci, si = place
    ex = c * across[0] - s * across[1]
    ey = s * across[0] + c * across[1]
    ez = across[2]
    vx = ct * out[0] + st * lean[0]
    vy = ct * out[1] + st * lean[1]
    wx = c * vx - s * vy
    wy = s * vx + c * vy
    wz = ct * out[2] + st * lean[2]
    # The U joint's axes: the second one across e and w, the first one across it and level.
    nx = ey * wz - ez * wy
    ny = ez * wx - ex * wz
    nz = ex * wy - ey * wx
    size = math.sqrt(nx * nx + ny * ny)
    size = size if size > TINY else TINY
    fx = -ny / size
    fy = nx / size
    sign = 1.0 if fx * ex + fy * ey > 0.0 else -1.0
    fx = sign * fx
    fy = sign * fy
    level = wz if wz < 1.0 else 1.0
    level = level if level > -1.0 else -1.0
    return (
        cur_principal(arc_tangent(0.0 - (fx * ci + fy * si), fy * ci - fx * si)),
        cur_principal(arc_tangent(nx * fy - ny * fx, 0.0 - nz)),
        cur_principal(
            arc_tangent(nx * fy * ez - ny * fx * ez + nz * (fx * ey - fy * ex), fx * ex + fy * ey)
        ),
        cur_principal(arc_tangent(st, ct)),
        arc_tangent(level, math.sqrt((1.0 - level) * (1.0 + level))),
    )


def cur_invert(pose, constants, found, work):  # type: ignore[no-untyped-def]
    """Write the working modes of a pose, a row each; see :attr:`Mechanism.inverter`.

    Returns
    -------
    count : int
    proven : bool
        Always.
    """
    z, beta, gamma = pose[0], pose[1], pose[2]
    ra, rb, length, d1 = constants[0], constants[1], constants[2], constants[3]
    sin_b, cos_b = sin_cos(beta)
    sin_g, cos_g = sin_cos(gamma)
    tilt = cur_tilt(beta, gamma)
    count = 0
    for mode in range(8):
        up1 = 1.0 if mode < 4 else -1.0
        up2 = 1.0 if mode % 4 < 2 else -1.0
        up3 = 1.0 if mode % 2 < 1 else -1.0
        px, py, c, s, c1, s1, c2, s2, c3, s3, gap = cur_solve(
            beta, gamma, ra / length, rb / length, up1, up2, up3
        )
        r1z, e1z, w1z, r2z, e2z, w2z, r3z, e3z, w3z = cur_heights(
            beta, gamma, c1, s1, c2, s2, c3, s3
        )
        closed = gap <= CUR_TOLERANCE and up1 * w1z >= 0.0
        if not (closed and up2 * w2z >= 0.0 and up3 * w3z >= 0.0):
            continue
        row = found[count]
        row[0] = mode
        row[1] = z + (rb * r1z - length * w1z) - d1
        row[2] = z + (rb * r2z - length * w2z) - d1
        row[3] = z + (rb * r3z - length * w3z) - d1
        row[4] = length * (c * px - s * py)
        row[5] = length * (s * px + c * py)
        row[6] = cur_principal(arc_tangent(s, c))
        lean = (tilt[5], tilt[6], cos_b * cos_g)
        across_x = sin_b * sin_g
        first = cur_passive(
            (tilt[0], 0.0, r1z), (across_x, cos_g, e1z), lean, (c1, s1), (c, s), (1.0, 0.0)
        )
        second = cur_passive(
            (tilt[1], tilt[2], r2z),
            (CUR_C2 * across_x - CUR_S2 * cos_b, CUR_C2 * cos_g, e2z),
            lean, (c2, s2), (c, s), (CUR_C2, CUR_S2),
        )  # fmt: skip
        third = cur_passive(
            (tilt[3], tilt[4], r3z),
            (CUR_C2 * across_x + CUR_S2 * cos_b, CUR_C2 * cos_g, e3z),
            lean, (c3, s3), (c, s), (CUR_C2, -CUR_S2),
        )  # fmt: skip
        for k in range(5):
            row[7 + k] = first[k]
            row[12 + k] = second[k]
            row[17 + k] = third[k]
        count += 1
    return count, True


def cur_state(px, py, alpha, theta1, theta2, theta3):  # type: ignore[no-untyped-def]
    """Return the state at the six unknowns."""
    s, c = sin_cos(alpha)
    s1, c1 = sin_cos(theta1)
    s2, c2 = sin_cos(theta2)
    s3, c3 = sin_cos(theta3)
    return px, py, c, s, c1, s1, c2, s2, c3, s3


def cur_residuals(z, beta, gamma, unknowns, constants):  # type: ignore[no-untyped-def]
    """Return by how much the limbs do not close horizontally, over L."""
    ra = constants[0] / constants[2]
    rb = constants[1] / constants[2]
    px, py, c, s, c1, s1, c2, s2, c3, s3 = cur_state(*unknowns)
    r1x, r2x, r2y, r3x, r3y, zx, zy = cur_tilt(beta, gamma)
    a1x, a1y, a2x, a2y, a3x, a3y = cur_columns(c, s, ra)
    k1 = cur_gap(px, py, a1x, a1y, r1x, 0.0, zx, zy, c1, s1, rb)
    k2 = cur_gap(px, py, a2x, a2y, r2x, r2y, zx, zy, c2, s2, rb)
    k3 = cur_gap(px, py, a3x, a3y, r3x, r3y, zx, zy, c3, s3, rb)
    return k1[3], k1[4], k2[3], k2[4], k3[3], k3[4]


def cur_of_unknowns(z, beta, gamma, unknowns, constants):  # type: ignore[no-untyped-def]
    """Return what the kernel does, at unknowns that close the limbs."""
    return cur_outcome(z, beta, gamma, cur_state(*unknowns), 1.0, constants)


def cur_start(z, beta, gamma, constants):  # type: ignore[no-untyped-def]
    """Return the kernel's solution as the six unknowns."""
    ra, rb = constants[0] / constants[2], constants[1] / constants[2]
    with np.errstate(over="ignore", invalid="ignore"):
        px, py, c, s, c1, s1, c2, s2, c3, s3, _ = cur_solve(beta, gamma, ra, rb, *constants[4:7])
    turns = ((s, c), (s1, c1), (s2, c2), (s3, c3))
    return [px, py, *(elementary.atan2(*turn) for turn in turns)]


def cur_line(z, beta, gamma, low, high, constants):  # type: ignore[no-untyped-def]
    """Return what the strokes leave of a line along z: h_i - z follows from the tilt alone."""
    (
        ra, rb, length, d1, up1, up2, up3, _, low1, high1, low2, high2, low3, high3,
        _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _,
    ) = constants  # fmt: skip
    ra = ra / length
    rb = rb / length
    _, _, _, _, c1, s1, c2, s2, c3, s3, _ = cur_solve(beta, gamma, ra, rb, up1, up2, up3)
    r1z, _, w1z, r2z, _, w2z, r3z, _, w3z = cur_heights(beta, gamma, c1, s1, c2, s2, c3, s3)
    z1 = d1 - length * (rb * r1z - w1z)
    z2 = d1 - length * (rb * r2z - w2z)
    z3 = d1 - length * (rb * r3z - w3z)
    start = cur_more(cur_more(low1 + z1, low2 + z2), cur_more(low3 + z3, low))
    return start, cur_less(cur_less(high1 + z1, high2 + z2), cur_less(high3 + z3, high))


def cur_skeleton(z, beta, gamma, constants):  # type: ignore[no-untyped-def]
    """Return the platform, the three links and the platform's spokes, and the cones."""
    (
        ra, rb, length, _, up1, up2, up3, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _,
        f1x, f1y, f1z, f2x, f2y, f2z, f3x, f3y, f3z,
    ) = constants  # fmt: skip
    px, py, c, s, c1, s1, c2, s2, c3, s3, _ = cur_solve(
        beta, gamma, ra / length, rb / length, up1, up2, up3
    )
    r1z, _, w1z, r2z, _, w2z, r3z, _, w3z = cur_heights(beta, gamma, c1, s1, c2, s2, c3, s3)
    r1x, r2x, r2y, r3x, r3y, zx, zy = cur_tilt(beta, gamma)
    x = length * (c * px - s * py)
    y = length * (s * px + c * py)
    b1x, b1y, b1z = rb * c * r1x, rb * s * r1x, rb * r1z
    b2x, b2y, b2z = rb * (c * r2x - s * r2y), rb * (s * r2x + c * r2y), rb * r2z
    b3x, b3y, b3z = rb * (c * r3x - s * r3y), rb * (s * r3x + c * r3y), rb * r3z
    g1x, g1y = c1 * r1x + s1 * zx, s1 * zy
    g2x, g2y = c2 * r2x + s2 * zx, c2 * r2y + s2 * zy
    g3x, g3y = c3 * r3x + s3 * zx, c3 * r3y + s3 * zy
    sin_b, cos_b = sin_cos(beta)
    sin_g, cos_g = sin_cos(gamma)
    tx = sin_b * sin_g
    return (
        x, y, z,
        c * cos_b, c * tx - s * cos_g, c * zx - s * zy,
        s * cos_b, s * tx + c * cos_g, s * zx + c * zy,
        -sin_b, cos_b * sin_g, cos_b * cos_g,
        ra, 0.0, z + b1z - length * w1z, x + b1x, y + b1y, z + b1z,
        ra * CUR_C2, ra * CUR_S2, z + b2z - length * w2z, x + b2x, y + b2y, z + b2z,
        ra * CUR_C2, -ra * CUR_S2, z + b3z - length * w3z, x + b3x, y + b3y, z + b3z,
        x, y, z, x + b1x, y + b1y, z + b1z,
        x, y, z, x + b2x, y + b2y, z + b2z,
        x, y, z, x + b3x, y + b3y, z + b3z,
        (c * g1x - s * g1y) * f1x + (s * g1x + c * g1y) * f1y + w1z * f1z,
        (c * g2x - s * g2y) * f2x + (s * g2x + c * g2y) * f2y + w2z * f2z,
        (c * g3x - s * g3y) * f3x + (s * g3x + c * g3y) * f3y + w3z * f3z,
    )  # fmt: skip


def cur_limb(ax, ay, h, bx, by, bz, ex, ey, ez, c, s):  # type: ignore[no-untyped-def]
    """Return theta2 .. theta5 of a limb and point and axes of C, U and R.

    (ax, ay) is the column at azimuth (c, s), b and e the R joint, h the height of the U joint.
    """
    wx, wy, wz = bx - ax, by - ay, bz - h
    x4, y4, z4 = crossed(ex, ey, ez, wx, wy, wz)
    fx, fy, _ = crossed(0.0, 0.0, 1.0, x4, y4, z4)
    side = 1.0 if fx * ex + fy * ey > 0.0 else -1.0
    fx = side * fx
    fy = side * fy
    # The link's direction across both axes, and the U joint's axis across the first and z.
    kx, ky, kz = -z4 * fy, z4 * fx, x4 * fy - y4 * fx
    qx, qy, qz = fy * ez, -fx * ez, fx * ey - fy * ex
    theta2 = arc_tangent(-(fx * c + fy * s), fy * c - fx * s)
    theta3 = arc_tangent(kz, kx * fy - ky * fx)
    theta4 = arc_tangent(x4 * qx + y4 * qy + z4 * qz, fx * ex + fy * ey)
    return (theta2, theta3, theta4), (
        ax, ay, 0.0, 0.0, 0.0, 1.0,
        ax, ay, h, fx, fy, 0.0, x4, y4, z4,
        bx, by, bz, ex, ey, ez,
    )  # fmt: skip


def cur_posture(z, beta, gamma, constants):  # type: ignore[no-untyped-def]
    """Return platform, heights, passive angles and joints."""
    d1 = constants[3]
    s = cur_skeleton(z, beta, gamma, constants)
    x1, x2 = s[4], CUR_C2 * s[4] - CUR_S2 * s[3]
    y1, y2 = s[7], CUR_C2 * s[7] - CUR_S2 * s[6]
    z1, z2 = s[10], CUR_C2 * s[10] - CUR_S2 * s[9]
    x3, y3, z3 = (
        CUR_C2 * s[4] + CUR_S2 * s[3],
        CUR_C2 * s[7] + CUR_S2 * s[6],
        (CUR_C2 * s[10] + CUR_S2 * s[9]),
    )
    q1, k1 = cur_limb(s[12], s[13], s[14], s[15], s[16], s[17], x1, y1, z1, 1.0, 0.0)
    q2, k2 = cur_limb(s[18], s[19], s[20], s[21], s[22], s[23], x2, y2, z2, CUR_C2, CUR_S2)
    q3, k3 = cur_limb(s[24], s[25], s[26], s[27], s[28], s[29], x3, y3, z3, CUR_C2, -CUR_S2)
    state = cur_solve(
        beta, gamma, constants[0] / constants[2], constants[1] / constants[2],
        constants[4], constants[5], constants[6],
    )  # fmt: skip
    return (
        *s[:12], s[14] - d1, s[20] - d1, s[26] - d1,
        *q1, arc_tangent(state[5], state[4]), *q2, arc_tangent(state[7], state[6]),
        *q3, arc_tangent(state[9], state[8]), *k1, *k2, *k3,
    )  # fmt: skip


class _Link(NamedTuple):
    """A limb at a pose: Rot b, e and w, and the height of w, negative on the other branch."""

    b: Vector
    e: Vector
    w: Vector
    height: float


class Cur(Mechanism):
    """The 3-CUR mechanism."""

    name = "3-cur"
    title = "3-CUR"
    description = "one translation (z) and two rotations; three sliders on vertical columns"
    source = "Kinematics Analysis and Simulation of 3-CUR Parallel Sorting Robot"
    freedom = "1T2R"
    length_unit = "m"
    default_jacobian = "homogenized"
    length_meaning = "Rb, the platform's radius: rates of angles become speeds"
    parameters = (
        Parameter("Ra", "length", 0.20, (0.10, 0.40), True, "radius of the columns", _OURS),
        Parameter("Rb", "length", 0.12, (0.05, 0.25), True, "radius of the platform", _OURS),
        Parameter("L", "length", 0.25, (0.15, 0.50), True, "length of the links", _OURS),
        Parameter("d1", "length", 0.0, None, False, "height of the U joints above the sliders",
                  _OURS),
    )  # fmt: skip
    pose = (
        Coordinate("z", "length", "height of the platform's centre"),
        Coordinate("beta", "angle", "pitch, about y"),
        Coordinate("gamma", "angle", "roll, about x"),
    )
    parasitic = (
        Coordinate("x", "length", "shift along x"),
        Coordinate("y", "length", "shift along y"),
        Coordinate("alpha", "angle", "yaw, about z"),
    )
    joints = tuple(Coordinate(f"h{k}", "length", f"height of slider {k}") for k in range(1, 4))
    passive = (
        Coordinate("theta4", "angle", "second axis of each U_C; by limb theta4_1 .. theta4_3"),
        Coordinate("theta5", "angle", "each R_B; by limb theta5_1 .. theta5_3"),
        Coordinate("elevation", "angle", "each link above the horizontal; by limb elevation_1 .."),
    )
    limbs = tuple(
        Limb(
            f"limb {k}", "CUR",
            f"C_A{k} on column {k} (sliding by h{k} actuated), U_C{k} on the slider, "
            f"R_B{k} tangential",
            (f"C_A{k}", f"U_C{k}", f"R_B{k}"),
        )
        for k in range(1, 4)
    )  # fmt: skip
    layouts = {  # noqa: RUF012  # declared as a mapping that is not changed
        "literal": "the paper's D-H table read literally, theta4 = 0: a 3-CRR"
    }
    conditions: ClassVar[Mapping[str, str]] = {
        "inverse": "w_iz = 0: link i lies flat",
        "forward": "the constraint forces and the links' forces, w_i, are dependent: together they "
        "do not hold the platform",
        "constraint": "the three horizontal forces through the U joints are dependent",
    }
    working_modes = tuple(MODE_SIGNS)
    kernel = staticmethod(cur_kernel)
    constant_count = 31
    implicit = Implicit(6, (1, 2), cur_residuals, cur_of_unknowns, cur_start)
    line = staticmethod(cur_line)
    line_axis = 0
    line_parts = 1
    skeleton = staticmethod(cur_skeleton)
    posture = staticmethod(cur_posture)
    roles = ("z", "pitch", "roll")
    assembler = Assembler(cur_assemble, cur_MODES, 8, cur_WORK)
    inverter = Assembler(cur_invert, len(MODE_SIGNS), 7 + 5 * 3, 1)
    inverted_passive = tuple(
        f"{name}_{k}"
        for k in (1, 2, 3)
        for name in ("theta2", "theta3", "theta4", "theta5", "elevation")
    )
    completeness = "by a polynomial of degree 8, whose real roots are counted"
    parasitic_roles = ("x", "y", "yaw")
    followed: ClassVar[Mapping[str, tuple[tuple[int, int, float], ...]]] = {
        f"theta{2 + j}_{k + 1}": ((k, freedom, sign),)
        for k in range(3)
        for j, (freedom, sign) in enumerate(((0, 1.0), (2, -1.0), (3, 1.0), (4, 1.0)))
    }
    segments = (0, 1, 2, PLATFORM, PLATFORM, PLATFORM)
    spokes = (0, 1, 2)
    cones = ("U_C1", "U_C2", "U_C3")

    def characteristic_length(self, parameters: Parameters) -> float:
        """Return Rb."""
        return _sizes(parameters)[1]

    def home(self, parameters: Parameters) -> dict[str, float]:
        """Return the level platform with the sliders in the middle of their stroke."""
        ra, rb, length, d1 = _sizes(parameters)
        rise = math.sqrt(max(length * length - (ra - rb) * (ra - rb), 0.0))
        return {"z": 0.15 + d1 + rise, "beta": 0.0, "gamma": 0.0}

    def bodies(self, parameters: Parameters) -> tuple[Body, ...]:
        """Return blocks as sliders, rods and a disc, of steel."""
        _, rb, length, _ = _sizes(parameters)
        return (
            *(plate((0.06, 0.06, 0.04), 1.0).body(f"{limb.name} slider", i, 0)
              for i, limb in enumerate(self.limbs)),
            *(tube(0.016, length, 1.0).body(f"{limb.name} link", i, 1)
              for i, limb in enumerate(self.limbs)),
            disc(2 * rb, 0.008, 1.0).body("platform"),
        )  # fmt: skip

    def default_limits(self, parameters: Parameters) -> Ranges:
        """Return stroke 0 .. 0.30 m (ours), theta4, theta5 and the elevation of the links."""
        return {
            **{c.name: (0.0, 0.30) for c in self.joints},
            "theta4": (-math.pi / 4, math.pi / 4),
            "theta5": (math.radians(20), math.radians(160)),
            "elevation": (math.radians(20), math.pi / 2),
        }

    def default_domain(self, parameters: Parameters) -> Ranges:
        """Return tilts up to 80 degrees (ours)."""
        tilt = math.radians(80)
        return {"beta": (-tilt, tilt), "gamma": (-tilt, tilt)}

    def reach_box(self, parameters: Parameters, limits: Ranges) -> tuple[Vector, Vector]:
        """Return z between the mean of the sliders' ends with links down and up; all tilts.

        The platform's joints lie around its centre: z is the mean of h + d1 + zeta.
        """
        ra, rb, length, d1 = _sizes(parameters)
        ends = [limits.get(c.name, (-math.inf, math.inf)) for c in self.joints]
        low, high = (sum(side) / 3 + d1 for side in zip(*ends, strict=True))
        if not (math.isfinite(low) and math.isfinite(high)):
            raise InputError("limits: h1, h2 and h3 need bounds: z follows them without end")
        if abs(ra - rb) >= length:
            return np.zeros(3), np.zeros(3)
        down, up = limits.get("elevation", (-math.pi, math.pi))
        low += length * elementary.sin(max(down, -math.pi / 2))
        high += length * elementary.sin(min(up, math.pi / 2))
        angles = (math.pi / 2, math.pi)
        return np.array([low, *(-a for a in angles)]), np.array([high, *angles])

    def reach(self, parameters: Parameters, pose: Mapping[str, float]) -> tuple[Reach, ...]:
        """Return how far each link is from lying flat, and its slider from its stroke's ends.

        Of the first working mode.
        """
        ra, rb, length, _ = _sizes(parameters)
        short = length - abs(ra - rb)
        if short <= 0:  # no platform is level, none at all to start from
            return tuple(Reach(limb.name, short, "too far") for limb in self.limbs)
        signs = next(iter(MODE_SIGNS.values()))
        links, _, gap = self._links(parameters, pose, signs)
        result = []
        for limb, link in zip(self.limbs, links, strict=True):
            flat = math.copysign(length - math.hypot(link.w[0], link.w[1]), link.height)
            h = pose["z"] + float(link.b[2] - link.w[2]) - _sizes(parameters)[3]
            low, high = self.default_limits(parameters)["h1"]
            room = min(h - low, high - h)
            if gap > CUR_TOLERANCE:
                flat = min(flat, -gap * length)
            reason = "too far" if flat < room or h > high else "too close"
            result.append(Reach(limb.name, min(flat, room), reason))
        return tuple(result)

    def inverse(
        self, parameters: Parameters, pose: Mapping[str, float]
    ) -> tuple[InverseSolution, ...]:
        """Solve for x, y, alpha in each working mode; the heights follow.

        Of each mode the branch that home belongs to: where Ra + Rb < L there is one more, of the
        platform turned half about z.
        """
        return self.inverted(parameters, [pose])[0]

    def inversion_constants(self, parameters: Parameters) -> list[float]:
        """Return the constants of :func:`cur_invert`."""
        return list(_sizes(parameters))

    def _links(
        self, parameters: Parameters, pose: Mapping[str, float], signs: tuple[float, ...]
    ) -> tuple[list[_Link], tuple[float, float, float], float]:
        """Return the limbs, x, y, alpha and the largest gap over L, of one working mode."""
        ra, rb, length, _ = _sizes(parameters)
        beta, gamma = pose["beta"], pose["gamma"]
        px, py, c, s, *turns, gap = _solved(beta, gamma, ra / length, rb / length, signs)
        alpha = elementary.atan2(s, c)
        rotation = rotation_matrices(np.array([[alpha, beta, gamma]]))[0][0]
        links = []
        for k, (sign, (cos_k, sin_k)) in enumerate(zip(signs, _AZIMUTHS, strict=True)):
            out = product(rotation, [cos_k, sin_k, 0.0])
            w = length * (turns[2 * k] * out + turns[2 * k + 1] * rotation[:, 2])
            links.append(
                _Link(rb * out, product(rotation, [-sin_k, cos_k, 0.0]), w, sign * float(w[2]))
            )
        x, y = length * (c * px - s * py), length * (s * px + c * py)
        return links, (float(x), float(y), alpha), float(gap)

    @staticmethod
    def _axes(link: _Link, length: float) -> tuple[Vector, Vector]:
        """Return the axes s and z4 of the U joint of a limb."""
        second = np.cross(link.e, link.w) / length
        first = np.cross(_Z, second)
        first /= max(norm_of(first), TINY)
        return first if dot(first, link.e) > 0 else -first, second

    def assembly_constants(self, parameters: Parameters) -> list[float]:
        """Return the constants of :func:`cur_assemble`."""
        return [*_sizes(parameters), self.home(parameters)["z"], *nodes(), *bernstein()]

    def velocity_maps(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> tuple[Matrix, Matrix]:
        """Return zeta_i dh_i / d(z, beta, gamma) and diag(zeta_i); parasitic rates eliminated."""
        constraint, drive, heights, axes = self.full_map(parameters, pose, joints)
        moved = np.zeros((6, 6))
        moved[:3, :3] = np.eye(3)
        moved[3:, 3:] = axes
        # Columns: x, y, alpha; then z, beta, gamma.
        held, free = [0, 1, 3], [2, 4, 5]
        constraint, drive = product(constraint, moved), product(drive, moved)
        follow = -solve(constraint[:, held], constraint[:, free])
        return drive[:, free] + product(drive[:, held], follow), np.diag(heights)

    def full_map(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> tuple[Matrix, Matrix, Vector, Matrix]:
        """Return the rows on (v, omega) of the constraints and of the drives.

        The constraints are the horizontal forces through the U joints, w_z e - e_z w; the drives
        [w; b x w] give w_z h'. With them the heights w_z and the axes of the angles' rates.
        """
        mode = self._mode_of(parameters, pose, joints)
        links, (_, _, alpha), _ = self._links(parameters, pose, MODE_SIGNS[mode])
        constraint, drive, heights = np.empty((3, 6)), np.empty((3, 6)), np.empty(3)
        for k, (b, e, w, _) in enumerate(links):
            force = w[2] * e - e[2] * w
            constraint[k] = [*force, *(w[2] * np.cross(b - w, e) - e[2] * np.cross(b, w))]
            drive[k] = [*w, *np.cross(b, w)]
            heights[k] = w[2]
        angles = np.array([[alpha, pose["beta"], pose["gamma"]]])
        return constraint, drive, heights, rotation_matrices(angles)[1][0]

    def _mode_of(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> str:
        """Return the working mode whose heights are those given."""
        _, rb, length, d1 = _sizes(parameters)
        heights = cur_heights(pose["beta"], pose["gamma"], *[0.0] * 6)
        rises = [
            rb * float(out) - (joints[c.name] + d1 - pose["z"])
            for c, out in zip(self.joints, heights[::3], strict=True)
        ]
        signs = tuple(math.copysign(1.0, rise) for rise in rises)
        mode = next(mode for mode, found in MODE_SIGNS.items() if found == signs)
        if min(map(abs, rises)) > NEARLY_FLAT * length:
            return mode
        solutions = self.inverse(parameters, pose)
        if not solutions:
            return self.working_modes[0]
        return min(
            solutions, key=lambda s: sum(abs(s.joints[k] - v) for k, v in joints.items())
        ).working_mode

    def singularity_measures(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> dict[str, dict[str, float]]:
        """Return w_z / L, the 6x6 determinant and the volume of the constraint rows.

        Rows are brought to norm 1, moments divided by Rb.
        """
        _, rb, length, _ = _sizes(parameters)
        constraint, drive, heights, _ = self.full_map(parameters, pose, joints)
        rows = np.vstack([constraint, drive])
        rows[:, 3:] /= rb
        rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), TINY)
        gram = product(rows[:3], rows[:3].T)
        return {
            "inverse": {limb.name: float(h) / length
                        for limb, h in zip(self.limbs, heights, strict=True)},
            "forward": {"platform": float(determinant(rows))},
            "constraint": {"platform": math.sqrt(max(float(determinant(gram)), 0.0))},
        }  # fmt: skip

    def velocity_map_units(self) -> dict[str, str]:
        """Return the units of J_X's and J_q's entries."""
        return {"J_X": "columns in m; m^2/rad; m^2/rad", "J_q": "diagonal in m"}

    def platform(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Matrix, Vector]:
        """Return Rot and P."""
        signs = MODE_SIGNS[self.check_mode(working_mode)]
        _, (x, y, alpha), _ = self._links(parameters, pose, signs)
        angles = np.array([[alpha, pose["beta"], pose["gamma"]]])
        return rotation_matrices(angles)[0][0], np.array([x, y, pose["z"]])

    def layout(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Chain, ...]:
        """Return the limbs: C vertical, U with axes s and z4, R along e."""
        ra, _, length, _ = _sizes(parameters)
        signs = MODE_SIGNS[self.check_mode(working_mode)]
        links, (x, y, _), _ = self._links(parameters, pose, signs)
        chains = []
        for k, (link, (c, s)) in enumerate(zip(links, _AZIMUTHS, strict=True)):
            first, second = self._axes(link, length)
            end = np.array([x, y, pose["z"]]) + link.b
            chains.append(
                Chain(self.limbs[k].name, (
                    Joint("C", np.array([ra * c, ra * s, 0.0]), (_Z,), drive=(f"h{k + 1}", 1)),
                    Joint("U", end - link.w, (first, second)),
                    Joint("R", end, (link.e,)),
                ))
            )  # fmt: skip
        return tuple(chains)

    def alternative_layout(self, parameters: Parameters, name: str) -> tuple[Chain, ...]:
        """Return the 3-CRR of the literal D-H table at home: U without its second axis."""
        if name not in self.layouts:
            return super().alternative_layout(parameters, name)
        return tuple(
            Chain(limb.name, (limb.joints[0],
                              Joint("R", limb.joints[1].point, limb.joints[1].axes[:1]),
                              limb.joints[2]))
            for limb in self.layout(parameters, self.home(parameters))
        )  # fmt: skip

    def kernel_constants(
        self, parameters: Parameters, working_mode: str, length: float, limits: Ranges
    ) -> list[float]:
        """Return the constants in the order :func:`cur_kernel` unpacks them."""
        ra, rb, size, d1 = _sizes(parameters)
        signs = MODE_SIGNS[working_mode]
        arcs: list[float] = []
        for name in ("theta4", "theta5"):
            low, high = limits.get(name, (-math.pi, math.pi))
            middle, half = (low + high) / 2, (high - low) / 2
            # A full turn excludes nothing, not even by rounding.
            arcs += [
                elementary.cos(middle),
                elementary.sin(middle),
                -2.0 if half >= math.pi else elementary.cos(half),
            ]
        low, high = limits.get("elevation", (-math.pi, math.pi))
        lowest = -math.inf if low <= -math.pi / 2 else elementary.sin(low)
        highest = math.inf if high >= math.pi / 2 else elementary.sin(high)
        home, _, _ = self._links(parameters, self.home(parameters), signs)
        ends = [limits.get(c.name, (-math.inf, math.inf)) for c in self.joints]
        return [
            ra, rb, size, d1, *signs, 1 / length, *(end for pair in ends for end in pair),
            *arcs, lowest, highest,
            *(float(v) / size for link in home for v in link.w),
        ]  # fmt: skip

    def decoupled_volume(
        self, parameters: Parameters, limits: Ranges | None = None, degrees: float = 1.0
    ) -> tuple[float, float]:
        """Return the workspace's volume connected to home, by integrating over z exactly.

        At a tilt (beta, gamma) z runs through the common part of the strokes, each shifted by its
        h - z. What is left is a sum over a grid of tilts.

        Parameters
        ----------
        parameters : mapping
        limits : mapping, optional
            Complete; default: :meth:`default_limits`.
        degrees : float
            Step of the grid; the difference to a step twice as wide is the error told (an error
            that falls with the first power of the step is as large).

        Returns
        -------
        volume, error : float
            In m rad^2, first working mode.
        """
        fine, coarse = (
            self._integrated(parameters, limits, step) for step in (degrees, 2 * degrees)
        )
        return fine, abs(fine - coarse)

    def _integrated(self, parameters: Parameters, limits: Ranges | None, degrees: float) -> float:
        from scipy import ndimage

        limits = self.default_limits(parameters) if limits is None else limits
        count = int(80 / degrees)
        tilts = math.radians(degrees) * np.arange(-count, count + 1)
        depth = np.zeros((len(tilts), len(tilts)))
        signs = next(iter(MODE_SIGNS.values()))
        free: dict[str, Any] = {k: v for k, v in limits.items() if not k.startswith("h")}
        bounded = {**free, **{c.name: (-math.inf, math.inf) for c in self.joints}}
        constants = self.kernel_constants(parameters, self.working_modes[0], 1.0, bounded)
        for i, beta in enumerate(tilts.tolist()):
            for j, gamma in enumerate(tilts.tolist()):
                if cur_kernel(0.0, beta, gamma, constants)[0] < 0:
                    continue
                links, _, _ = self._links(parameters, {"beta": beta, "gamma": gamma}, signs)
                shifts = [float(link.b[2] - link.w[2]) for link in links]
                ends = [limits[c.name] for c in self.joints]
                top = min(high - s for (_, high), s in zip(ends, shifts, strict=True))
                bottom = max(low - s for (low, _), s in zip(ends, shifts, strict=True))
                depth[i, j] = max(top - bottom, 0.0)
        labels, _ = ndimage.label(depth > 0)
        home = labels[count, count]
        inside = (labels == home) & (labels > 0)
        return float(depth[inside].sum()) * math.radians(degrees) * math.radians(degrees)


_Z = np.array([0.0, 0.0, 1.0])
_AZIMUTHS = ((1.0, 0.0), (CUR_C2, CUR_S2), (CUR_C2, -CUR_S2))


@lru_cache(maxsize=64)
def _solved(
    beta: float, gamma: float, ra: float, rb: float, signs: tuple[float, ...]
) -> tuple[float, ...]:
    """Return what :func:`cur_solve` does; at a pose it is asked for again and again."""
    with np.errstate(over="ignore", invalid="ignore"):  # ends in a gap, which is told
        found: tuple[float, ...] = cur_solve(beta, gamma, ra, rb, *signs)
    return found


def _sizes(parameters: Parameters) -> tuple[float, float, float, float]:
    """Return Ra, Rb, L, d1."""
    ra, rb, length, d1 = (float(parameters[k] or 0.0) for k in ("Ra", "Rb", "L", "d1"))
    return ra, rb, length, d1


MECHANISM = Cur()

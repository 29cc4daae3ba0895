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
from pmopt.kernels.octics import bernstein, nodes
from pmopt.kernels.trigonometry import arc_tangent, sin_cos
from pmopt.kernels.vectors import (
    Rotation,
    Vec3,
    Z,
    dot,
    least,
    minus,
    normal,
    plus,
)
from pmopt.mechanisms.bodies import Body, disc, plate, tube
from pmopt.mechanisms.catalogue.cur_forward import cur_assemble, cur_MODES, cur_WORK
from pmopt.mechanisms.mechanism import (
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
from pmopt.mechanisms.structure import (
    Cylindrical,
    Evaluated,
    Freedom,
    Revolute,
    SerialChain,
    Structure,
    Universal,
)
from pmopt.numerics import elementary
from pmopt.numerics.matrices import determinant, product, solve
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


class Stroke(NamedTuple):
    """Range of a slider's height h, m."""

    low: float
    high: float


class Arc(NamedTuple):
    """Range of an angle t: inside is cos(t - middle) >= cos(half-width)."""

    cos: float  # of the middle
    sin: float
    least: float  # cos(half-width); -2 where all angles are allowed


class Constants(NamedTuple):
    """One design, as kernel functions take it."""

    ra: float  # m
    rb: float  # m
    length: float  # L, m
    d1: float  # m
    up1: float  # 1 where limb 1 points up, -1 where it points down, by working mode
    up2: float
    up3: float
    scale: float  # 1 / characteristic length, 1/m; 1 for the raw Jacobian
    stroke1: Stroke
    stroke2: Stroke
    stroke3: Stroke
    theta4: Arc
    theta5: Arc
    lowest: float  # sine of the links' elevation; infinite without a limit
    highest: float
    home1: Vec3  # direction of w_1 at home, base frame
    home2: Vec3
    home3: Vec3


class Sizes(NamedTuple):
    """What the limbs close by, lengths over L."""

    ra: float
    rb: float
    up1: float
    up2: float
    up3: float


class Flat(NamedTuple):
    """Horizontal part of a vector."""

    x: float
    y: float


class Turn(NamedTuple):
    """Cosine and sine of an angle."""

    c: float
    s: float


class State(NamedTuple):
    """Unknowns of closing: p over L, alpha, theta_1 .. theta_3."""

    px: float
    py: float
    yaw: Turn
    turn1: Turn
    turn2: Turn
    turn3: Turn


class Solved(NamedTuple):
    """A state, and the largest gap over L that it leaves."""

    state: State
    gap: float


class Tilt(NamedTuple):
    """Horizontal parts of r_1', r_2', r_3' and z'."""

    r1: Flat
    r2: Flat
    r3: Flat
    z: Flat


class Gap(NamedTuple):
    """n = (u, v) of a limb, its moment about the origin, and by how much it does not close."""

    u: float
    v: float
    moment: float
    x: float
    y: float


class Adjugate(NamedTuple):
    """Adjugate and determinant of a matrix."""

    a11: float
    a12: float
    a13: float
    a21: float
    a22: float
    a23: float
    a31: float
    a32: float
    a33: float
    det: float


class Heights(NamedTuple):
    """The z of r_i', of e_i, and of w_i over L."""

    r: float
    e: float
    w: float


def cur_sizes(k):  # type: ignore[no-untyped-def]
    """Return what the limbs of a design close by."""
    return Sizes(k.ra / k.length, k.rb / k.length, k.up1, k.up2, k.up3)


def cur_tilt(beta, gamma):  # type: ignore[no-untyped-def]
    """Return the horizontal parts of r_1', r_2', r_3' and z'; r_1' has no y."""
    sin_b, cos_b = sin_cos(beta)
    sin_g, cos_g = sin_cos(gamma)
    tx = CUR_S2 * (sin_b * sin_g)
    ty = CUR_S2 * cos_g
    rx = CUR_C2 * cos_b
    return Tilt(
        Flat(cos_b, 0.0), Flat(rx + tx, ty), Flat(rx - tx, -ty), Flat(sin_b * cos_g, -sin_g)
    )


def cur_columns(yaw, ra):  # type: ignore[no-untyped-def]
    """Return Rz(-alpha) A_i."""
    c, s = yaw.c, yaw.s
    cx = CUR_C2 * ra * c
    cy = CUR_C2 * ra * s
    sx = CUR_S2 * ra * s
    sy = CUR_S2 * ra * c
    return Flat(ra * c, -ra * s), Flat(cx + sx, sy - cy), Flat(cx - sx, -sy - cy)


def cur_gap(px, py, a, r, z, turn, rb):  # type: ignore[no-untyped-def]
    """Return how a limb closes: its column at ``a``, with the horizontal parts of r' and z'."""
    c, s = turn.c, turn.s
    u = c * z.y - s * r.y
    v = s * r.x - c * z.x
    gap_x = px + (rb - c) * r.x - s * z.x - a.x
    gap_y = py + (rb - c) * r.y - s * z.y - a.y
    return Gap(u, v, a.x * v - a.y * u, gap_x, gap_y)


def cur_gaps(state, tilt, ra, rb):  # type: ignore[no-untyped-def]
    """Return how the limbs close."""
    a1, a2, a3 = cur_columns(state.yaw, ra)
    return (
        cur_gap(state.px, state.py, a1, tilt.r1, tilt.z, state.turn1, rb),
        cur_gap(state.px, state.py, a2, tilt.r2, tilt.z, state.turn2, rb),
        cur_gap(state.px, state.py, a3, tilt.r3, tilt.z, state.turn3, rb),
    )


def cur_adjugate(k1, k2, k3):  # type: ignore[no-untyped-def]
    """Return adjugate and determinant of the limbs' rows (u, v, moment)."""
    m11 = k2.v * k3.moment - k2.moment * k3.v
    m21 = k2.moment * k3.u - k2.u * k3.moment
    m31 = k2.u * k3.v - k2.v * k3.u
    return Adjugate(
        m11, k1.moment * k3.v - k1.v * k3.moment, k1.v * k2.moment - k1.moment * k2.v,
        m21, k1.u * k3.moment - k1.moment * k3.u, k1.moment * k2.u - k1.u * k2.moment,
        m31, k1.v * k3.u - k1.u * k3.v, k1.u * k2.v - k1.v * k2.u,
        k1.u * m11 + k1.v * m21 + k1.moment * m31,
    )  # fmt: skip


def cur_short(step):  # type: ignore[no-untyped-def]
    """Return a step, shortened to the longest that is allowed."""
    step = step if step < CUR_LONGEST else CUR_LONGEST
    return step if step > -CUR_LONGEST else -CUR_LONGEST


def cur_turned(turn, angle):  # type: ignore[no-untyped-def]
    """Return a turn and a small angle more; to second order of a unit vector."""
    c = turn.c - angle * turn.s
    s = turn.s + angle * turn.c
    scale = 1.5 - 0.5 * (c * c + s * s)
    return Turn(c * scale, s * scale)


def cur_along(gap, dx, dy):  # type: ignore[no-untyped-def]
    """Return the turn of theta that closes a limb's gap, once moved by dx, dy, along itself."""
    u, v = gap.u, gap.v
    return cur_short((u * (gap.y + dy) - v * (gap.x + dx)) / (u * u + v * v + TINY))


def cur_step(state, tilt, ra, rb):  # type: ignore[no-untyped-def]
    """Return the state after a Newton step at a tilt; L is 1."""
    a1, a2, a3 = cur_columns(state.yaw, ra)
    k1, k2, k3 = cur_gaps(state, tilt, ra, rb)
    # Across w's derivative by theta three equations are left, in p and alpha.
    f1 = k1.u * k1.x + k1.v * k1.y
    f2 = k2.u * k2.x + k2.v * k2.y
    f3 = k3.u * k3.x + k3.v * k3.y
    adj = cur_adjugate(k1, k2, k3)
    unit = -adj.det / (adj.det * adj.det + TINY)
    dx = cur_short((adj.a11 * f1 + adj.a12 * f2 + adj.a13 * f3) * unit)
    dy = cur_short((adj.a21 * f1 + adj.a22 * f2 + adj.a23 * f3) * unit)
    da = cur_short((adj.a31 * f1 + adj.a32 * f2 + adj.a33 * f3) * unit)
    return State(
        state.px + dx,
        state.py + dy,
        cur_turned(state.yaw, da),
        cur_turned(state.turn1, cur_along(k1, dx - a1.y * da, dy + a1.x * da)),
        cur_turned(state.turn2, cur_along(k2, dx - a2.y * da, dy + a2.x * da)),
        cur_turned(state.turn3, cur_along(k3, dx - a3.y * da, dy + a3.x * da)),
    )


def cur_turn_ahead(turn, before, share):  # type: ignore[no-untyped-def]
    """Return a turn as far ahead as the last one is behind, or a share of that."""
    return cur_turned(turn, cur_short(share * (turn.s * before.c - turn.c * before.s)))


def cur_ahead(state, before, share):  # type: ignore[no-untyped-def]
    """Return a state as far ahead as the last one is behind, or a share of that."""
    return State(
        state.px + share * (state.px - before.px),
        state.py + share * (state.py - before.py),
        cur_turn_ahead(state.yaw, before.yaw, share),
        cur_turn_ahead(state.turn1, before.turn1, share),
        cur_turn_ahead(state.turn2, before.turn2, share),
        cur_turn_ahead(state.turn3, before.turn3, share),
    )


def cur_solve(beta, gamma, sizes):  # type: ignore[no-untyped-def]
    """Return the state that closes the limbs.

    From the level platform by way of 0.3, 0.6 and 0.8 of the tilt. Steps are written out: a loop
    within the sweep's loop over poses would keep that from being vectorised.
    """
    ra, rb = sizes.ra, sizes.rb
    level = rb - ra
    square = 1.0 - level * level
    rise = math.sqrt(square if square > 0.0 else 0.0)
    home = State(
        0.0, 0.0, Turn(1.0, 0.0),
        Turn(level, sizes.up1 * rise), Turn(level, sizes.up2 * rise), Turn(level, sizes.up3 * rise),
    )  # fmt: skip
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
    k1, k2, k3 = cur_gaps(state, tilt, ra, rb)
    worst = cur_more(abs(k1.x), abs(k1.y))
    worst = cur_more(worst, cur_more(abs(k2.x), abs(k2.y)))
    worst = cur_more(worst, cur_more(abs(k3.x), abs(k3.y)))
    # A platform that can not be level has no home to start from.
    worst = worst if square > 0.0 else cur_more(worst, 1.0)
    return Solved(state, worst)


def cur_more(a, b):  # type: ignore[no-untyped-def]
    """Return the greater of two."""
    return a if a > b else b


def cur_heights(beta, gamma, turn1, turn2, turn3):  # type: ignore[no-untyped-def]
    """Return the heights of each limb's vectors."""
    sin_b, cos_b = sin_cos(beta)
    sin_g, cos_g = sin_cos(gamma)
    tz = cos_b * sin_g
    zz = cos_b * cos_g
    r2z = CUR_S2 * tz - CUR_C2 * sin_b
    r3z = -CUR_S2 * tz - CUR_C2 * sin_b
    return (
        Heights(-sin_b, tz, turn1.s * zz - turn1.c * sin_b),
        Heights(r2z, CUR_C2 * tz + CUR_S2 * sin_b, turn2.s * zz + turn2.c * r2z),
        Heights(r3z, CUR_C2 * tz - CUR_S2 * sin_b, turn3.s * zz + turn3.c * r3z),
    )


def cur_heights_of(beta, gamma, state):  # type: ignore[no-untyped-def]
    """Return the heights of each limb's vectors in a state."""
    return cur_heights(beta, gamma, state.turn1, state.turn2, state.turn3)


def cur_limits(up, turn, at, k):  # type: ignore[no-untyped-def]
    """Return the least slack over L of a limb's reach and of its passive joints' limits.

    theta4 turns the U joint's first axis, along n, to e: n . e = w_z and n . w = -e_z L^2 give
    tan theta4 = e_z L / w_z, and |n|^2 = w_z^2 + e_z^2 L^2.
    """
    height = up * at.w
    unit = 1.0 / math.sqrt(at.w * at.w + at.e * at.e + TINY)
    slack = least(height, least(at.w - k.lowest, k.highest - at.w))
    four = (height * k.theta4.cos + up * at.e * k.theta4.sin) * unit - k.theta4.least
    slack = least(slack, four)
    return least(slack, turn.c * k.theta5.cos + turn.s * k.theta5.sin - k.theta5.least)


def cur_along_link(turn, r, z, height):  # type: ignore[no-untyped-def]
    """Return w over L, before the platform yaws."""
    return Vec3(turn.c * r.x + turn.s * z.x, turn.c * r.y + turn.s * z.y, height)


def cur_rates(about_x, about_y, brace, r, w):  # type: ignore[no-untyped-def]
    """Return w_z h' of a limb by turns about x and y, times det F, and the rates that follow.

    ``brace`` is det F and Rb over L.
    """
    d, rb = brace
    turn = rb * (w.y * r.x - w.x * r.y)
    return (
        d * rb * (w.z * r.y - w.y * r.z) + w.x * about_x.x + w.y * about_x.y + turn * about_x.z,
        d * rb * (w.x * r.z - w.z * r.x) + w.x * about_y.x + w.y * about_y.y + turn * about_y.z,
    )


def cur_outcome(z, beta, gamma, state, closed, k):  # type: ignore[no-untyped-def]
    """Return the margin and J^-1 times the determinants that can vanish, of a state.

    ``closed`` is >= 0 where the state closes the limbs. With rows F_i = (u, v, moment about P) of
    what holds x, y and alpha, and l_i the height of U_i over P, a turn about x or y of the yawing
    frame calls for F (x', y', alpha') = (l v, -l u); then w_z h' = w . (v + omega x b). About x
    counts with cos beta: the rest of the axis of gamma is along z and alpha makes up for it.
    Everything is multiplied by det F and the three w_z.
    """
    length = k.length
    ra = k.ra / length
    rb = k.rb / length
    turn1, turn2, turn3 = state.turn1, state.turn2, state.turn3
    at1, at2, at3 = cur_heights(beta, gamma, turn1, turn2, turn3)
    margin = least(closed, cur_limits(k.up1, turn1, at1, k))
    margin = least(margin, cur_limits(k.up2, turn2, at2, k))
    margin = least(margin, cur_limits(k.up3, turn3, at3, k))
    l1 = rb * at1.r - at1.w
    l2 = rb * at2.r - at2.w
    l3 = rb * at3.r - at3.w
    h1 = z + length * l1 - k.d1
    h2 = z + length * l2 - k.d1
    h3 = z + length * l3 - k.d1
    margin = least(length * margin, least(h1 - k.stroke1.low, k.stroke1.high - h1))
    margin = least(margin, least(h2 - k.stroke2.low, k.stroke2.high - h2))
    margin = least(margin, least(h3 - k.stroke3.low, k.stroke3.high - h3))

    r1, r2, r3, lean = cur_tilt(beta, gamma)
    a1, a2, a3 = cur_columns(state.yaw, ra)
    # About P: the moments of A_i - P, which are b_i - w_i horizontally.
    px, py = state.px, state.py
    k1 = cur_gap(0.0, 0.0, Flat(a1.x - px, a1.y - py), r1, lean, turn1, rb)
    k2 = cur_gap(0.0, 0.0, Flat(a2.x - px, a2.y - py), r2, lean, turn2, rb)
    k3 = cur_gap(0.0, 0.0, Flat(a3.x - px, a3.y - py), r3, lean, turn3, rb)
    adj = cur_adjugate(k1, k2, k3)
    about_x = Vec3(
        adj.a11 * l1 * k1.v + adj.a12 * l2 * k2.v + adj.a13 * l3 * k3.v,
        adj.a21 * l1 * k1.v + adj.a22 * l2 * k2.v + adj.a23 * l3 * k3.v,
        adj.a31 * l1 * k1.v + adj.a32 * l2 * k2.v + adj.a33 * l3 * k3.v,
    )
    about_y = Vec3(
        -(adj.a11 * l1 * k1.u + adj.a12 * l2 * k2.u + adj.a13 * l3 * k3.u),
        -(adj.a21 * l1 * k1.u + adj.a22 * l2 * k2.u + adj.a23 * l3 * k3.u),
        -(adj.a31 * l1 * k1.u + adj.a32 * l2 * k2.u + adj.a33 * l3 * k3.u),
    )
    brace = (adj.det, rb)
    # r_1' has no y.
    w1 = Vec3(turn1.c * r1.x + turn1.s * lean.x, turn1.s * lean.y, at1.w)
    w2 = cur_along_link(turn2, r2, lean, at2.w)
    w3 = cur_along_link(turn3, r3, lean, at3.w)
    x1, y1 = cur_rates(about_x, about_y, brace, Vec3(r1.x, r1.y, at1.r), w1)
    x2, y2 = cur_rates(about_x, about_y, brace, Vec3(r2.x, r2.y, at2.r), w2)
    x3, y3 = cur_rates(about_x, about_y, brace, Vec3(r3.x, r3.y, at3.r), w3)
    scale = k.scale * length
    scale_x = scale * r1.x  # r_1' is cos beta along x
    z23 = at2.w * at3.w
    z13 = at1.w * at3.w
    z12 = at1.w * at2.w
    all_z = adj.det * z12 * at3.w
    return (
        margin,
        all_z, y1 * z23 * scale, x1 * z23 * scale_x,
        all_z, y2 * z13 * scale, x2 * z13 * scale_x,
        all_z, y3 * z12 * scale, x3 * z12 * scale_x,
    )  # fmt: skip


def cur_kernel(z, beta, gamma, k):  # type: ignore[no-untyped-def]
    """Return the margin and J^-1 times the determinants that can vanish; see cur_outcome."""
    solved = cur_solve(beta, gamma, cur_sizes(k))
    closed = 1.0 if solved.gap <= CUR_TOLERANCE else -solved.gap
    return cur_outcome(z, beta, gamma, solved.state, closed, k)


def cur_principal(angle):  # type: ignore[no-untyped-def]
    """Return -pi, which rounding may give, as pi."""
    return angle if angle > -math.pi else math.pi


def cur_passive(out, across, lean, turn, yaw, place):  # type: ignore[no-untyped-def]
    """Return theta2 .. theta5 and the elevation of a limb.

    Parameters
    ----------
    out, across, lean : Vec3
        r_i, t_i and z of the platform, before it yaws.
    turn, yaw, place : Turn
        theta5, alpha and the limb's azimuth.
    """
    ct, st = turn.c, turn.s
    c, s = yaw.c, yaw.s
    ci, si = place.c, place.s
    ex = c * across.x - s * across.y
    ey = s * across.x + c * across.y
    ez = across.z
    vx = ct * out.x + st * lean.x
    vy = ct * out.y + st * lean.y
    wx = c * vx - s * vy
    wy = s * vx + c * vy
    wz = ct * out.z + st * lean.z
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
        state, gap = cur_solve(beta, gamma, Sizes(ra / length, rb / length, up1, up2, up3))
        at1, at2, at3 = cur_heights_of(beta, gamma, state)
        closed = gap <= CUR_TOLERANCE and up1 * at1.w >= 0.0
        if not (closed and up2 * at2.w >= 0.0 and up3 * at3.w >= 0.0):
            continue
        c, s = state.yaw
        row = found[count]
        row[0] = mode
        row[1] = z + (rb * at1.r - length * at1.w) - d1
        row[2] = z + (rb * at2.r - length * at2.w) - d1
        row[3] = z + (rb * at3.r - length * at3.w) - d1
        row[4] = length * (c * state.px - s * state.py)
        row[5] = length * (s * state.px + c * state.py)
        row[6] = cur_principal(arc_tangent(s, c))
        lean = Vec3(tilt.z.x, tilt.z.y, cos_b * cos_g)
        across_x = sin_b * sin_g
        across1 = Vec3(across_x, cos_g, at1.e)
        across2 = Vec3(CUR_C2 * across_x - CUR_S2 * cos_b, CUR_C2 * cos_g, at2.e)
        across3 = Vec3(CUR_C2 * across_x + CUR_S2 * cos_b, CUR_C2 * cos_g, at3.e)
        out1 = Vec3(tilt.r1.x, tilt.r1.y, at1.r)
        out2 = Vec3(tilt.r2.x, tilt.r2.y, at2.r)
        out3 = Vec3(tilt.r3.x, tilt.r3.y, at3.r)
        place1 = Turn(1.0, 0.0)
        place2 = Turn(CUR_C2, CUR_S2)
        place3 = Turn(CUR_C2, -CUR_S2)
        first = cur_passive(out1, across1, lean, state.turn1, state.yaw, place1)
        second = cur_passive(out2, across2, lean, state.turn2, state.yaw, place2)
        third = cur_passive(out3, across3, lean, state.turn3, state.yaw, place3)
        for k in range(5):
            row[7 + k] = first[k]
            row[12 + k] = second[k]
            row[17 + k] = third[k]
        count += 1
    return count, True


def cur_turn(angle):  # type: ignore[no-untyped-def]
    """Return cosine and sine."""
    sine, cosine = sin_cos(angle)
    return Turn(cosine, sine)


def cur_state(px, py, alpha, theta1, theta2, theta3):  # type: ignore[no-untyped-def]
    """Return the state at the six unknowns."""
    return State(px, py, cur_turn(alpha), cur_turn(theta1), cur_turn(theta2), cur_turn(theta3))


def cur_residuals(z, beta, gamma, unknowns, k):  # type: ignore[no-untyped-def]
    """Return by how much the limbs do not close horizontally, over L."""
    ra = k.ra / k.length
    rb = k.rb / k.length
    state = cur_state(*unknowns)
    k1, k2, k3 = cur_gaps(state, cur_tilt(beta, gamma), ra, rb)
    return k1.x, k1.y, k2.x, k2.y, k3.x, k3.y


def cur_of_unknowns(z, beta, gamma, unknowns, k):  # type: ignore[no-untyped-def]
    """Return what the kernel does, at unknowns that close the limbs."""
    return cur_outcome(z, beta, gamma, cur_state(*unknowns), 1.0, k)


def cur_start(z, beta, gamma, k):  # type: ignore[no-untyped-def]
    """Return the kernel's solution as the six unknowns."""
    with np.errstate(over="ignore", invalid="ignore"):
        px, py, *turns = cur_solve(beta, gamma, cur_sizes(k)).state
    return [px, py, *(elementary.atan2(turn.s, turn.c) for turn in turns)]


def cur_line(z, beta, gamma, low, high, k):  # type: ignore[no-untyped-def]
    """Return what the strokes leave of a line along z: h_i - z follows from the tilt alone."""
    length, d1 = k.length, k.d1
    rb = k.rb / length
    at1, at2, at3 = cur_heights_of(beta, gamma, cur_solve(beta, gamma, cur_sizes(k)).state)
    z1 = d1 - length * (rb * at1.r - at1.w)
    z2 = d1 - length * (rb * at2.r - at2.w)
    z3 = d1 - length * (rb * at3.r - at3.w)
    start = cur_more(
        cur_more(k.stroke1.low + z1, k.stroke2.low + z2), cur_more(k.stroke3.low + z3, low)
    )
    return start, least(
        least(k.stroke1.high + z1, k.stroke2.high + z2), least(k.stroke3.high + z3, high)
    )


def cur_yawed(yaw, x, y, z):  # type: ignore[no-untyped-def]
    """Return a vector, turned about z."""
    return Vec3(yaw.c * x - yaw.s * y, yaw.s * x + yaw.c * y, z)


class Points(NamedTuple):
    """A configuration, base frame, m: state, platform, its R joints, columns and U joints."""

    state: State
    p: Vec3
    rotation: Rotation
    b1: Vec3
    b2: Vec3
    b3: Vec3
    a1: Vec3  # feet of the columns
    a2: Vec3
    a3: Vec3
    u1: Vec3
    u2: Vec3
    u3: Vec3
    link1: Vec3  # directions w_i / L
    link2: Vec3
    link3: Vec3


def cur_points(z, beta, gamma, k):  # type: ignore[no-untyped-def]
    """Return a configuration."""
    ra, rb, length = k.ra, k.rb, k.length
    state = cur_solve(beta, gamma, cur_sizes(k)).state
    at1, at2, at3 = cur_heights_of(beta, gamma, state)
    r1, r2, r3, lean = cur_tilt(beta, gamma)
    yaw = state.yaw
    c, s = yaw.c, yaw.s
    p = Vec3(length * (c * state.px - s * state.py), length * (s * state.px + c * state.py), z)
    b1 = Vec3(rb * c * r1.x, rb * s * r1.x, rb * at1.r)  # r_1' has no y
    b2 = Vec3(rb * (c * r2.x - s * r2.y), rb * (s * r2.x + c * r2.y), rb * at2.r)
    b3 = Vec3(rb * (c * r3.x - s * r3.y), rb * (s * r3.x + c * r3.y), rb * at3.r)
    g1 = Flat(state.turn1.c * r1.x + state.turn1.s * lean.x, state.turn1.s * lean.y)
    g2 = cur_along_link(state.turn2, r2, lean, at2.w)
    g3 = cur_along_link(state.turn3, r3, lean, at3.w)
    sin_b, cos_b = sin_cos(beta)
    sin_g, cos_g = sin_cos(gamma)
    tx = sin_b * sin_g
    rotation = Rotation(
        c * cos_b, c * tx - s * cos_g, c * lean.x - s * lean.y,
        s * cos_b, s * tx + c * cos_g, s * lean.x + c * lean.y,
        -sin_b, cos_b * sin_g, cos_b * cos_g,
    )  # fmt: skip
    return Points(
        state,
        p,
        rotation,
        b1=plus(p, b1),
        b2=plus(p, b2),
        b3=plus(p, b3),
        a1=Vec3(ra, 0.0, 0.0),
        a2=Vec3(ra * CUR_C2, ra * CUR_S2, 0.0),
        a3=Vec3(ra * CUR_C2, -ra * CUR_S2, 0.0),
        u1=Vec3(ra, 0.0, z + b1.z - length * at1.w),
        u2=Vec3(ra * CUR_C2, ra * CUR_S2, z + b2.z - length * at2.w),
        u3=Vec3(ra * CUR_C2, -ra * CUR_S2, z + b3.z - length * at3.w),
        link1=cur_yawed(yaw, g1.x, g1.y, at1.w),
        link2=cur_yawed(yaw, g2.x, g2.y, at2.w),
        link3=cur_yawed(yaw, g3.x, g3.y, at3.w),
    )


class Cones(NamedTuple):
    """Cosines between links and their directions at home."""

    U_C1: float
    U_C2: float
    U_C3: float


def cur_cones(at, k):  # type: ignore[no-untyped-def]
    """Return the cosines of the cone angles."""
    return Cones(dot(at.link1, k.home1), dot(at.link2, k.home2), dot(at.link3, k.home3))


class Passive(NamedTuple):
    """A limb's angles, rad, and the axes of its U joint."""

    theta2: float
    theta3: float
    theta4: float
    first: Vec3
    second: Vec3
    e: Vec3  # axis of its R joint


def cur_limb(u, b, e, azimuth):  # type: ignore[no-untyped-def]
    """Return what is passive in a limb, from its U joint, its R joint and that joint's axis."""
    second = normal(e, minus(b, u))
    f = normal(Z, second)
    side = 1.0 if f.x * e.x + f.y * e.y > 0.0 else -1.0
    fx = side * f.x
    fy = side * f.y
    c, s = azimuth.c, azimuth.s
    # The link's direction across both axes, and the U joint's axis across the first and z.
    kx, ky, kz = -second.z * fy, second.z * fx, second.x * fy - second.y * fx
    across = Vec3(fy * e.z, -fx * e.z, fx * e.y - fy * e.x)
    return Passive(
        arc_tangent(-(fx * c + fy * s), fy * c - fx * s),
        arc_tangent(kz, kx * fy - ky * fx),
        arc_tangent(dot(second, across), fx * e.x + fy * e.y),
        Vec3(fx, fy, 0.0),
        second,
        e,
    )


class Positions(NamedTuple):
    """Heights of the sliders, m, the passive joints' angles, rad, and what is passive by limb."""

    h1: float
    h2: float
    h3: float
    theta2_1: float
    theta3_1: float
    theta4_1: float
    theta5_1: float
    theta2_2: float
    theta3_2: float
    theta4_2: float
    theta5_2: float
    theta2_3: float
    theta3_3: float
    theta4_3: float
    theta5_3: float
    limb1: Passive
    limb2: Passive
    limb3: Passive


def cur_positions(at, k):  # type: ignore[no-untyped-def]
    """Return the joints' positions and the passive joints' axes."""
    r = at.rotation
    e1 = Vec3(r.xy, r.yy, r.zy)
    e2 = Vec3(
        CUR_C2 * r.xy - CUR_S2 * r.xx, CUR_C2 * r.yy - CUR_S2 * r.yx, CUR_C2 * r.zy - CUR_S2 * r.zx
    )
    e3 = Vec3(
        CUR_C2 * r.xy + CUR_S2 * r.xx, CUR_C2 * r.yy + CUR_S2 * r.yx, CUR_C2 * r.zy + CUR_S2 * r.zx
    )
    q1 = cur_limb(at.u1, at.b1, e1, Turn(1.0, 0.0))
    q2 = cur_limb(at.u2, at.b2, e2, Turn(CUR_C2, CUR_S2))
    q3 = cur_limb(at.u3, at.b3, e3, Turn(CUR_C2, -CUR_S2))
    turn1, turn2, turn3 = at.state.turn1, at.state.turn2, at.state.turn3
    return Positions(
        h1=at.u1.z - k.d1,
        h2=at.u2.z - k.d1,
        h3=at.u3.z - k.d1,
        theta2_1=q1.theta2,
        theta3_1=q1.theta3,
        theta4_1=q1.theta4,
        theta5_1=arc_tangent(turn1.s, turn1.c),
        theta2_2=q2.theta2,
        theta3_2=q2.theta3,
        theta4_2=q2.theta4,
        theta5_2=arc_tangent(turn2.s, turn2.c),
        theta2_3=q3.theta2,
        theta3_3=q3.theta3,
        theta4_3=q3.theta4,
        theta5_3=arc_tangent(turn3.s, turn3.c),
        limb1=q1,
        limb2=q2,
        limb3=q3,
    )


STRUCTURE = Structure(
    Evaluated(cur_points, Points),
    place="p",
    rotation="rotation",
    chains=tuple(
        SerialChain(
            f"limb {k}",
            (
                Cylindrical(f"a{k}", Z, slide=f"h{k}"),
                Universal(f"u{k}", f"limb{k}.first", f"limb{k}.second"),
                Revolute(f"b{k}", f"limb{k}.e"),
            ),
            bars=(f"u{k}", f"b{k}"),
            spoke=f"b{k}",
        )
        for k in (1, 2, 3)
    ),
    cones=Evaluated(cur_cones, Cones),
    positions=Evaluated(cur_positions, Positions),
    followed={
        name: (freedom,)
        for k in (1, 2, 3)
        for name, freedom in (
            (f"theta2_{k}", Freedom(f"C_A{k}", "turn")),
            (f"theta3_{k}", Freedom(f"U_C{k}", "first", -1.0)),
            (f"theta4_{k}", Freedom(f"U_C{k}", "second")),
            (f"theta5_{k}", Freedom(f"R_B{k}")),
        )
    },
)


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
    constants = Constants
    implicit = Implicit(6, (1, 2), cur_residuals, cur_of_unknowns, cur_start)
    line = staticmethod(cur_line)
    line_axis = 0
    line_parts = 1
    structure = STRUCTURE
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
        (px, py, (c, s), *turns), gap = _solved(beta, gamma, ra / length, rb / length, signs)
        alpha = elementary.atan2(s, c)
        rotation = rotation_matrices(np.array([[alpha, beta, gamma]]))[0][0]
        links = []
        for k, (sign, (cos_k, sin_k)) in enumerate(zip(signs, _AZIMUTHS, strict=True)):
            out = product(rotation, [cos_k, sin_k, 0.0])
            w = length * (turns[k].c * out + turns[k].s * rotation[:, 2])
            links.append(
                _Link(rb * out, product(rotation, [-sin_k, cos_k, 0.0]), w, sign * float(w[2]))
            )
        x, y = length * (c * px - s * py), length * (s * px + c * py)
        return links, (float(x), float(y), alpha), float(gap)

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
        heights = cur_heights(pose["beta"], pose["gamma"], *[Turn(0.0, 0.0)] * 3)
        rises = [
            rb * float(at.r) - (joints[c.name] + d1 - pose["z"])
            for c, at in zip(self.joints, heights, strict=True)
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
    ) -> Constants:
        """Return the constants of a design."""
        ra, rb, size, d1 = _sizes(parameters)
        signs = MODE_SIGNS[working_mode]
        low, high = limits.get("elevation", (-math.pi, math.pi))
        lowest = -math.inf if low <= -math.pi / 2 else elementary.sin(low)
        highest = math.inf if high >= math.pi / 2 else elementary.sin(high)
        home, _, _ = self._links(parameters, self.home(parameters), signs)
        up1, up2, up3 = signs
        return Constants(
            ra=ra,
            rb=rb,
            length=size,
            d1=d1,
            up1=up1,
            up2=up2,
            up3=up3,
            scale=1 / length,
            stroke1=Stroke(*limits.get("h1", (-math.inf, math.inf))),
            stroke2=Stroke(*limits.get("h2", (-math.inf, math.inf))),
            stroke3=Stroke(*limits.get("h3", (-math.inf, math.inf))),
            theta4=_arc(limits.get("theta4")),
            theta5=_arc(limits.get("theta5")),
            lowest=lowest,
            highest=highest,
            home1=_direction(home[0].w, size),
            home2=_direction(home[1].w, size),
            home3=_direction(home[2].w, size),
        )

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
def _solved(beta: float, gamma: float, ra: float, rb: float, signs: tuple[float, ...]) -> Solved:
    """Return what :func:`cur_solve` does; at a pose it is asked for again and again."""
    with np.errstate(over="ignore", invalid="ignore"):  # ends in a gap, which is told
        found: Solved = cur_solve(beta, gamma, Sizes(ra, rb, *signs))
    return found


def _arc(limits: tuple[float, float] | None) -> Arc:
    """Return the range of an angle; all angles without limits."""
    low, high = limits or (-math.pi, math.pi)
    middle, half = (low + high) / 2, (high - low) / 2
    # A full turn excludes nothing, not even by rounding.
    least = -2.0 if half >= math.pi else elementary.cos(half)
    return Arc(elementary.cos(middle), elementary.sin(middle), least)


def _direction(w: Vector, size: float) -> Vec3:
    x, y, z = (float(v) / size for v in w)
    return Vec3(x, y, z)


def _sizes(parameters: Parameters) -> tuple[float, float, float, float]:
    """Return Ra, Rb, L, d1."""
    ra, rb, length, d1 = (float(parameters[k] or 0.0) for k in ("Ra", "Rb", "L", "d1"))
    return ra, rb, length, d1


MECHANISM = Cur()

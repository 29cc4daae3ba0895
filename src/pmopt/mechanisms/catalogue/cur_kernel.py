"""Kernel text of 3-CUR: symbols and equations are those of :mod:`.cur`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pmopt.kernels.trigonometry import sin_cos
from pmopt.kernels.vectors import (
    Vec3,
    least,
)
from pmopt.numerics import elementary

TINY = 1e-300
#: Cosine and sine of the azimuths.
CUR_C2 = -0.5
CUR_S2 = 0.8660254037844386
#: A gap in closing beyond this (over L) means that there is no solution.
CUR_TOLERANCE = 1e-10
#: Longest Newton step of each unknown, lengths over L.
CUR_LONGEST = 0.5


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
    # A platform that cannot be level has no home to start from.
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

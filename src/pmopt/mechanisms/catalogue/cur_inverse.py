"""Inverse kinematics of 3-CUR in every working mode; see :mod:`.cur`."""

from __future__ import annotations

import math

from pmopt.kernels.trigonometry import arc_tangent, sin_cos
from pmopt.kernels.vectors import (
    Vec3,
)
from pmopt.mechanisms.catalogue.cur_kernel import (
    CUR_C2,
    CUR_S2,
    CUR_TOLERANCE,
    TINY,
    Sizes,
    Turn,
    cur_heights_of,
    cur_solve,
    cur_tilt,
)


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

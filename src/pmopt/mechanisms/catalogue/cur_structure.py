"""Points, joints and links of 3-CUR; symbols as in :mod:`.cur`."""

from __future__ import annotations

from typing import NamedTuple

from pmopt.kernels.trigonometry import arc_tangent, sin_cos
from pmopt.kernels.vectors import (
    Rotation,
    Vec3,
    Z,
    dot,
    minus,
    normal,
    plus,
)
from pmopt.mechanisms.catalogue.cur_kernel import (
    CUR_C2,
    CUR_S2,
    Flat,
    State,
    Turn,
    cur_along_link,
    cur_heights_of,
    cur_sizes,
    cur_solve,
    cur_tilt,
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

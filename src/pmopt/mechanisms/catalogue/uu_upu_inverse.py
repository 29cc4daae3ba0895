"""Inverse kinematics of 2UU-UPU: every root of P_x = x along the curve; see :mod:`.uu_upu`."""

from __future__ import annotations

import math
from typing import NamedTuple

from pmopt.kernels.trigonometry import arc_tangent, sin_cos
from pmopt.mechanisms.catalogue.uu_upu_kernel import (
    TINY,
    Sizes,
    Tilt,
    Turn,
    uup_across,
    uup_bar,
    uup_CLOSE,
    uup_far,
    uup_POINT,
    uup_turn,
)

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

"""Forward kinematics of 3-CUR: all assembly modes, by a polynomial of degree 8.

With the sliders held the U joints are three known points of the base, C_i = A_i + (h_i + d1) z.
In the platform each lies on a circle, told by theta_i, limb i's theta5::

    C_i' = (Rb - L cos theta_i) r_i - L sin theta_i z

The mechanism closes where the distances of the C_i' are those of the C_i. With lengths over L,
b = Rb / L, c_i = cos theta_i, s_i = sin theta_i::

    c_i c_j - 2 s_i s_j - 3 b (c_i + c_j) + 3 b^2 + 2 = |C_i - C_j|^2

For a given theta_1 two of the three give two theta_2 and two theta_3. The product of the third over
all four, times what makes it a polynomial, has degree 8 in cos theta_1: with -theta for each theta
that solves the equations, at most 16 assembly modes. Its roots are starts for Newton's method on
the three equations. Twins of modes near a singularity are sought as in ups_sp_forward.
"""

import math
from typing import NamedTuple

from pmopt.kernels.assembly import (
    ASSEMBLY_STEP,
    Adjugate,
    assembly_angles,
    assembly_apart,
    assembly_heading,
    assembly_principal,
    assembly_size,
    assembly_solved,
    assembly_sort,
)
from pmopt.kernels.octics import octic_DEPTH, octic_MOST, octic_roots
from pmopt.kernels.trigonometry import arc_tangent, sin_cos
from pmopt.kernels.vectors import Rotation, Vec3

EPS = 2.220446049250313e-16
TINY = 1e-300
#: cos theta_1 over this is the polynomial's variable: roots at +-1 are inside.
cur_WIDE = 1.0009765625
#: A single root beyond this is no cosine.
cur_COSINE = 1.00001
#: Largest miss of an equation, over the size of its terms, at a solution, and at a start for it.
cur_CLOSE, cur_NEAR = 3e-14, 0.02
#: Modes at most, of which half are mirror images; numbers kept of each of the others.
cur_MODES = 16
cur_HALF = 8
cur_KEPT = 4
cur_SINE = 0.8660254037844386
# Places in the scratch space.
cur_VALUES = 0
cur_ROOTS = 9
cur_STACK = cur_ROOTS + 2 * octic_MOST
cur_FOUND = cur_STACK + 11 * octic_DEPTH
cur_WORK = cur_FOUND + cur_HALF * cur_KEPT


class Angles(NamedTuple):
    """theta_1, theta_2 and theta_3."""

    t1: float
    t2: float
    t3: float


class Turn(NamedTuple):
    """Cosine and sine of an angle."""

    c: float
    s: float


class Goals(NamedTuple):
    """What the equations are of, lengths over L."""

    g12: float  # constant terms of the equations of two limbs
    g13: float
    g23: float
    b: float
    size: float  # of the equations' terms


class System(NamedTuple):
    """The equations of 12, 13 and 23 at angles, and their slopes by both theta."""

    turn1: Turn
    turn2: Turn
    turn3: Turn
    f: Vec3
    a12: float
    b12: float
    a13: float
    b13: float
    a23: float
    b23: float
    worst: float  # largest miss; not a number if any is not


class Solved(NamedTuple):
    """Where Newton's method ends."""

    angles: Angles
    system: System
    miss: float  # of an equation over the size of its terms


class Followed(NamedTuple):
    """What an equation of theta_1 and another theta leaves of that one; see cur_follow."""

    g: float
    p: float
    n: float
    h2: float


class Design(NamedTuple):
    """Sizes, and the U joints of the base with heights over their middle."""

    ra: float
    rb: float
    length: float
    rise: float  # height of the middle, and d1
    home: float  # z
    c1: Vec3
    c2: Vec3
    c3: Vec3


def cur_pair(one, other, b3, goal):  # type: ignore[no-untyped-def]
    """Return an equation of two limbs and its slopes by both theta."""
    return (
        one.c * other.c - 2.0 * one.s * other.s - b3 * (one.c + other.c) + goal,
        b3 * one.s - one.s * other.c - 2.0 * one.c * other.s,
        b3 * other.s - other.s * one.c - 2.0 * other.c * one.s,
    )


def cur_turn_of(angle):  # type: ignore[no-untyped-def]
    """Return cosine and sine."""
    s, c = sin_cos(angle)
    return Turn(c, s)


def cur_equations(angles, goals):  # type: ignore[no-untyped-def]
    """Return the equations at angles."""
    turn1 = cur_turn_of(angles.t1)
    turn2 = cur_turn_of(angles.t2)
    turn3 = cur_turn_of(angles.t3)
    b3 = 3.0 * goals.b
    f12, a12, b12 = cur_pair(turn1, turn2, b3, goals.g12)
    f13, a13, b13 = cur_pair(turn1, turn3, b3, goals.g13)
    f23, a23, b23 = cur_pair(turn2, turn3, b3, goals.g23)
    worst = abs(f12) if abs(f12) > abs(f13) else abs(f13)
    worst = worst if worst > abs(f23) else abs(f23)
    worst = worst + 0.0 * (abs(f12) + abs(f13) + abs(f23))
    return System(
        turn1, turn2, turn3, Vec3(f12, f13, f23), a12, b12, a13, b13, a23, b23, worst
    )  # fmt: skip


def cur_adjugate_of(at):  # type: ignore[no-untyped-def]
    """Return the adjugate of the slope, [[p, q, 0], [r, 0, s], [0, t, u]]."""
    p, q, r, s, t, u = at.a12, at.b12, at.a13, at.b13, at.a23, at.b23
    return Adjugate(
        -s * t, -q * u, q * s,
        -r * u, p * u, -p * s,
        r * t, -p * t, -q * r,
        -p * s * t - q * r * u,
    )  # fmt: skip


def cur_moved(angles, way, step):  # type: ignore[no-untyped-def]
    """Return angles, moved along a direction."""
    return Angles(angles.t1 + step * way.x, angles.t2 + step * way.y, angles.t3 + step * way.z)


def cur_newton(angles, goals):  # type: ignore[no-untyped-def]
    """Return the solution that Newton's method leads to."""
    size = goals.size
    at = cur_equations(angles, goals)
    worst = at.worst
    idle = 0
    for _ in range(60):
        way = assembly_solved(cur_adjugate_of(at), at.f)
        step = assembly_size(way)
        before = angles
        angles = cur_moved(before, way, 0.4 / step if step > 0.4 else 1.0)
        at = cur_equations(angles, goals)
        miss = at.worst
        if miss < cur_CLOSE * size and miss >= 0.5 * worst:
            # Nothing is left but rounding: two such steps, then the better of both states.
            idle += 1
            if miss >= worst:
                angles = before
                at = cur_equations(angles, goals)
                miss = at.worst
            if idle > 1 or step < EPS:
                worst = miss
                break
        worst = miss
        if step <= 0.25 * EPS:
            break
    return Solved(angles, at, worst / size)


def cur_kept(w, k):  # type: ignore[no-untyped-def]
    """Return the angles of a mode that is kept."""
    at = cur_FOUND + cur_KEPT * k
    return Angles(w[at], w[at + 1], w[at + 2])


def cur_keep(w, count, start, goals):  # type: ignore[no-untyped-def]
    """Keep the solution that angles lead to if it is new; return how many are kept.

    A solution and its mirror image, -theta, are kept as one.
    """
    solved = cur_newton(start, goals)
    if not solved.miss <= cur_CLOSE:
        return count
    adj = cur_adjugate_of(solved.system)
    total = adj.xx * adj.xx + adj.xy * adj.xy + adj.xz * adj.xz
    total = total + adj.yx * adj.yx + adj.yy * adj.yy + adj.yz * adj.yz
    total = total + adj.zx * adj.zx + adj.zy * adj.zy + adj.zz * adj.zz
    # What a miss by rounding moves the solution by.
    radius = 16.0 * EPS * (1.0 + goals.size * math.sqrt(total) / (abs(adj.det) + TINY))
    radius = radius if radius < 1e-5 else 1e-5
    found = solved.angles
    for k in range(count):
        at = cur_FOUND + cur_KEPT * k
        same = 0.0
        other = 0.0
        for i in range(3):
            gap = assembly_principal(w[at + i] - found[i])
            same += gap * gap
            gap = assembly_principal(w[at + i] + found[i])
            other += gap * gap
        if math.sqrt(same if same < other else other) <= radius + w[at + 3]:
            return count
    if count == cur_HALF:
        return count
    at = cur_FOUND + cur_KEPT * count
    for i in range(3):
        w[at + i] = found[i]
    w[at + 3] = radius
    return count + 1


def cur_twins(w, count, goals):  # type: ignore[no-untyped-def]
    """Seek twins of the modes that are kept; return how many are kept then."""
    k = 0
    while k < count:
        mode = cur_kept(w, k)
        at = cur_equations(mode, goals)
        heading = assembly_heading(cur_adjugate_of(at))
        bend = 0.0
        for side in range(2):
            step = ASSEMBLY_STEP if side == 0 else -ASSEMBLY_STEP
            f = cur_equations(cur_moved(mode, heading.way, step), goals).f
            bend += heading.weights.x * f.x + heading.weights.y * f.y + heading.weights.z * f.z
        away, near = assembly_apart(heading.along, bend)
        if heading.there and near:
            count = cur_keep(w, count, cur_moved(mode, heading.way, away), goals)
        k += 1
    return count


def cur_follow(c1, square, b3, goal):  # type: ignore[no-untyped-def]
    """Return what an equation of theta_1 and another theta leaves of that one.

    cos = (g p -+ q h) / n, sin = (g q +- p h) / n with h^2 = n - g^2. ``square`` is s1^2, which
    may be below 0 for a polynomial's sake: q^2 is 4 of it.
    """
    p = c1 - b3
    g = b3 * c1 - goal
    n = p * p + 4.0 * square
    return Followed(g, p, n, n - g * g)


def cur_order(first, goals):  # type: ignore[no-untyped-def]
    """Return the constant terms of the first limb with each of the others and of those two."""
    if first == 0:
        return goals.g12, goals.g13, goals.g23
    return (goals.g12, goals.g23, goals.g13) if first == 1 else (goals.g13, goals.g23, goals.g12)


def cur_polynomial(c1, first, goals):  # type: ignore[no-untyped-def]
    """Return the polynomial of degree 8 at a limb's cos theta, and the size of its terms."""
    b3 = 3.0 * goals.b
    square = 1.0 - c1 * c1
    one, two, goal = cur_order(first, goals)
    g2, p, n, h2 = cur_follow(c1, square, b3, one)
    g3, _, _, h3 = cur_follow(c1, square, b3, two)
    # With q = -2 s1, c = (g p - q h) / n and s = (g q + p h) / n the third equation is
    # A + B q h2 + C q h3 + D h2 h3, once times n^2; q^2 = 4 s1^2.
    q2 = 4.0 * square
    a = g2 * g3 * (p * p - 2.0 * q2) - b3 * n * p * (g2 + g3) + goal * n * n
    b = b3 * n - 3.0 * g3 * p
    c = b3 * n - 3.0 * g2 * p
    d = q2 - 2.0 * p * p
    square2 = q2 * h2
    square3 = q2 * h3
    # (A + D h2 h3)^2 - (B q h2 + C q h3)^2, times itself with h2 h3 of the other sign.
    even = a * a + d * d * h2 * h3 - b * b * square2 - c * c * square3
    odd = a * d - b * c * q2
    total = even * even - 4.0 * h2 * h3 * odd * odd
    size = a * a + abs(d * d * h2 * h3) + abs(b * b * square2) + abs(c * c * square3)
    n4 = n * n * n * n
    return total / n4, size * size / n4


def cur_arranged(first, a, b, c):  # type: ignore[no-untyped-def]
    """Return the angles of a limb and of the others."""
    if first == 0:
        return Angles(a, b, c)
    return Angles(b, a, c) if first == 1 else Angles(b, c, a)


def cur_starts(w, count, c1, first, goals):  # type: ignore[no-untyped-def]
    """Seek solutions from the four pairs of the other theta at a limb's cos theta."""
    c1 = 1.0 if c1 > 1.0 else (-1.0 if c1 < -1.0 else c1)
    s1 = math.sqrt((1.0 - c1) * (1.0 + c1))
    b3 = 3.0 * goals.b
    one, two, both = cur_order(first, goals)
    g2, p, n, h2 = cur_follow(c1, s1 * s1, b3, one)
    g3, _, _, h3 = cur_follow(c1, s1 * s1, b3, two)
    h2 = math.sqrt(h2 if h2 > 0.0 else 0.0)
    h3 = math.sqrt(h3 if h3 > 0.0 else 0.0)
    q = -2.0 * s1
    unit = 1.0 / (n + TINY)
    for pair in range(4):
        r2 = h2 if pair < 2 else -h2
        r3 = h3 if pair % 2 == 0 else -h3
        c2 = (g2 * p - q * r2) * unit
        s2 = (g2 * q + p * r2) * unit
        c3 = (g3 * p - q * r3) * unit
        s3 = (g3 * q + p * r3) * unit
        miss = c2 * c3 - 2.0 * s2 * s3 - b3 * (c2 + c3) + both
        if abs(miss) <= cur_NEAR * goals.size:
            start = cur_arranged(
                first, arc_tangent(s1, c1), arc_tangent(s2, c2), arc_tangent(s3, c3)
            )
            count = cur_keep(w, count, start, goals)
    return count


class Triad(NamedTuple):
    """Axes of a triangle of points: a side, across it, the normal."""

    u: Vec3
    v: Vec3
    n: Vec3


def cur_triad(a, b, c):  # type: ignore[no-untyped-def]
    """Return the axes of a triangle."""
    ux, uy, uz = b.x - a.x, b.y - a.y, b.z - a.z
    vx, vy, vz = c.x - a.x, c.y - a.y, c.z - a.z
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    unit = 1.0 / math.sqrt(ux * ux + uy * uy + uz * uz)
    ux *= unit
    uy *= unit
    uz *= unit
    unit = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    nx *= unit
    ny *= unit
    nz *= unit
    return Triad(
        Vec3(ux, uy, uz),
        Vec3(ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux),
        Vec3(nx, ny, nz),
    )


def cur_between(base, platform):  # type: ignore[no-untyped-def]
    """Return the rotation that turns a triad of the platform into one of the base."""
    n1, n4, n7 = base.u.x, base.v.x, base.n.x
    n2, n5, n8 = base.u.y, base.v.y, base.n.y
    n3, n6, n9 = base.u.z, base.v.z, base.n.z
    m1, m4, m7 = platform.u.x, platform.v.x, platform.n.x
    m2, m5, m8 = platform.u.y, platform.v.y, platform.n.y
    m3, m6, m9 = platform.u.z, platform.v.z, platform.n.z
    return Rotation(
        n1 * m1 + n4 * m4 + n7 * m7, n1 * m2 + n4 * m5 + n7 * m8, n1 * m3 + n4 * m6 + n7 * m9,
        n2 * m1 + n5 * m4 + n8 * m7, n2 * m2 + n5 * m5 + n8 * m8, n2 * m3 + n5 * m6 + n8 * m9,
        n3 * m1 + n6 * m4 + n9 * m7, n3 * m2 + n6 * m5 + n9 * m8, n3 * m3 + n6 * m6 + n9 * m9,
    )  # fmt: skip


def cur_azimuth(i):  # type: ignore[no-untyped-def]
    """Return cosine and sine of a limb's azimuth."""
    return Turn(
        1.0 if i == 0 else -0.5, 0.0 if i == 0 else (cur_SINE if i == 1 else -cur_SINE)
    )  # fmt: skip


def cur_on_circle(turn, i, side, design):  # type: ignore[no-untyped-def]
    """Return C_i' in the platform; ``side`` is -1 for the mirror image."""
    place = cur_azimuth(i)
    out_radius = design.rb - design.length * turn.c
    return Vec3(out_radius * place.c, out_radius * place.s, -side * design.length * turn.s)


def cur_place(at, design, side, out):  # type: ignore[no-untyped-def]
    """Write pose, parasitic coordinates, residual and distance from home of a solution."""
    rb = design.rb
    circles = (
        cur_on_circle(at.turn1, 0, side, design),
        cur_on_circle(at.turn2, 1, side, design),
        cur_on_circle(at.turn3, 2, side, design),
    )
    joints = (design.c1, design.c2, design.c3)
    r = cur_between(
        cur_triad(design.c1, design.c2, design.c3), cur_triad(circles[0], circles[1], circles[2])
    )
    px = 0.0
    py = 0.0
    pz = 0.0
    for i in range(3):
        a, k = circles[i], joints[i]
        px += (k.x - (r.xx * a.x + r.xy * a.y + r.xz * a.z)) / 3.0
        py += (k.y - (r.yx * a.x + r.yy * a.y + r.yz * a.z)) / 3.0
        pz += (k.z - (r.zx * a.x + r.zy * a.y + r.zz * a.z)) / 3.0
    worst = 0.0
    for i in range(3):
        c, s = cur_azimuth(i)
        k = joints[i]
        wx = px + rb * (r.xx * c + r.xy * s) - k.x
        wy = py + rb * (r.yx * c + r.yy * s) - k.y
        wz = pz + rb * (r.zx * c + r.zy * s) - k.z
        miss = wx * (r.xy * c - r.xx * s) + wy * (r.yy * c - r.yx * s) + wz * (r.zy * c - r.zx * s)
        worst = abs(miss) if abs(miss) > worst else worst
        miss = math.sqrt(wx * wx + wy * wy + wz * wz) - design.length
        worst = abs(miss) if abs(miss) > worst else worst
    alpha, beta, gamma = assembly_angles(r)
    pz += design.rise
    out[0] = pz
    out[1] = beta
    out[2] = gamma
    out[3] = px
    out[4] = py
    out[5] = alpha
    out[6] = worst
    gap = pz - design.home
    out[7] = gap * gap + rb * rb * (alpha * alpha + beta * beta + gamma * gamma)


def cur_search(constants, w, count, first, goals):  # type: ignore[no-untyped-def]
    """Seek solutions by a limb's cos theta; return how many are kept, and can be at most."""
    values = w[cur_VALUES : cur_VALUES + 9]
    roots = w[cur_ROOTS : cur_ROOTS + 2 * octic_MOST]
    stack = w[cur_STACK : cur_STACK + 11 * octic_DEPTH]
    error = 0.0
    largest = 0.0
    for m in range(9):
        value, terms = cur_polynomial(cur_WIDE * constants[5 + m], first, goals)
        values[m] = value
        largest = abs(value) if abs(value) > largest else largest
        error = terms if terms > error else error
    error *= 64.0 * EPS
    if not largest > error:
        # The equations say nothing about theta: as far as Newton's method finds modes.
        for m in range(9):
            count = cur_starts(w, count, constants[5 + m], first, goals)
        return count, 99
    some, bound = octic_roots(values, error, constants[14:96], stack, roots)
    for m in range(some):
        if roots[2 * m + 1] == 0.0 and abs(cur_WIDE * roots[2 * m]) > cur_COSINE:
            bound -= 1
            continue
        around = 3 if roots[2 * m + 1] > 0.0 else 1
        for side in range(around):
            shift = roots[2 * m + 1] if side == 1 else (-roots[2 * m + 1] if side == 2 else 0.0)
            count = cur_starts(w, count, cur_WIDE * (roots[2 * m] + shift), first, goals)
    return count, bound


def cur_assemble(joints, constants, found, w):  # type: ignore[no-untyped-def]
    """Write the assembly modes, a row each; return how many and whether they are all.

    Parameters
    ----------
    joints : (3,)
    constants : (96,)
        Ra, Rb, L, d1, home's z, degree-8 nodes (9) and matrix (82).
    found : (16, 8)
        z, beta, gamma, x, y, alpha, the largest gap, and what they are sorted by.
    w : (cur_WORK,)
        Scratch space.
    """
    ra = constants[0]
    rb = constants[1]
    length = constants[2]
    b = rb / length
    # Heights over their middle, so that far away they keep their digits.
    middle = (joints[0] + joints[1] + joints[2]) / 3.0
    side = ra / length
    rise = (joints[0] - joints[1]) / length
    apart12 = 3.0 * side * side + rise * rise
    rise = (joints[0] - joints[2]) / length
    apart13 = 3.0 * side * side + rise * rise
    rise = (joints[1] - joints[2]) / length
    apart23 = 3.0 * side * side + rise * rise
    size = apart12 if apart12 > 0.0 else 0.0
    size = apart13 if apart13 > size else size
    size = apart23 if apart23 > size else size
    # The longest that two points of the circles can be apart: beyond it nothing assembles.
    widest = 3.0 * (b + 1.0) * (b + 1.0) + 4.0
    if not size <= widest:
        return 0, True
    middle_term = 3.0 * b * b + 2.0
    goals = Goals(
        middle_term - apart12, middle_term - apart13, middle_term - apart23, b, widest
    )  # fmt: skip
    count = 0
    bound = 99
    # Near cos theta = 3 b = 1 the other theta hardly follow from this one: another limb's, then.
    for first in range(3):
        count, most = cur_search(constants, w, count, first, goals)
        bound = most if most < bound else bound
        count = cur_twins(w, count, goals)
        if bound <= count:
            break
    design = Design(
        ra,
        rb,
        length,
        rise=middle + constants[3],
        home=constants[4],
        c1=Vec3(ra * 1.0, 0.0, joints[0] - middle),
        c2=Vec3(ra * -0.5, ra * cur_SINE, joints[1] - middle),
        c3=Vec3(ra * -0.5, -ra * cur_SINE, joints[2] - middle),
    )
    total = 0
    for m in range(count):
        at = cur_equations(cur_kept(w, m), goals)
        flat = abs(at.turn1.s)
        flat = abs(at.turn2.s) if abs(at.turn2.s) > flat else flat
        flat = abs(at.turn3.s) if abs(at.turn3.s) > flat else flat
        cur_place(at, design, 1.0, found[total])
        total += 1
        # All links in the platform's plane: the mode is its own mirror image.
        if flat > w[cur_FOUND + cur_KEPT * m + 3]:
            cur_place(at, design, -1.0, found[total])
            total += 1
    assembly_sort(found, total, 8)
    return total, bound <= count

"""Forward kinematics of 3-UPS/SP: all assembly modes, by a polynomial of degree 8.

Limb 4 gives l4, hence s_i = (e_i, l4) in the platform. With d_i = A_i - A4 the other limbs say::

    d_i . R s_i = c_i = (|s_i|^2 + |d_i|^2 - l_i^2) / 2,   i = 1, 2, 3

One of them leaves R = D Rx(a) Rz(g) Rx(b) S^T, with D and S frames whose first axes are along its
d and s, and cos g = c / (|d| |s|). The other two are then A cos b + B sin b + C = 0 with
coefficients linear in cos a, sin a. Eliminating b leaves a trigonometric polynomial of degree 4 in
a: at most 8 assembly modes, all found as real roots of polynomials of degree 8 in tan(a / 2). Each
is a start for Newton's method on the three equations above.

Near a singularity two modes lie close to each other: from each mode the place of such a twin is
estimated along the direction in which the equations hardly change, and sought from there.
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
from pmopt.kernels.trigonometry import sin_cos
from pmopt.kernels.vectors import Rotation, Vec3, dot, turned

EPS = 2.220446049250313e-16
TINY = 1e-300
#: Largest miss of an equation, lengths over |d| and |s|, at what counts as a solution.
sp_CLOSE = 3e-14
#: Modes at most, and the numbers kept of each: a quaternion and how far rounding may move it.
sp_MODES = 8
sp_KEPT = 5
#: Turn of the platform that sets both halves of a circle of a apart.
sp_PHASE = 0.3
# Places in the scratch space.
sp_VALUES = 0
sp_ROOTS = 9
sp_STACK = sp_ROOTS + 2 * octic_MOST
sp_FOUND = sp_STACK + 11 * octic_DEPTH
sp_WORK = sp_FOUND + sp_MODES * sp_KEPT


class Quaternion(NamedTuple):
    """A rotation; of unit length."""

    q0: float
    q1: float
    q2: float
    q3: float


class Goal(NamedTuple):
    """A limb's equation d . R s = c, over the lengths of d and s."""

    d: Vec3
    s: Vec3
    c: float


class Goals(NamedTuple):
    """The equations of limbs 1 to 3."""

    limb1: Goal
    limb2: Goal
    limb3: Goal


class Equation(NamedTuple):
    """By how much an equation misses, and its slope by turns about the base's axes."""

    f: float
    slope: Vec3


class System(NamedTuple):
    """The equations at a rotation."""

    f: Vec3
    one: Vec3  # slopes
    two: Vec3
    three: Vec3
    worst: float  # largest miss; not a number if any is not


class Solved(NamedTuple):
    """Where Newton's method ends."""

    state: Quaternion
    system: System
    miss: float


class Axes(NamedTuple):
    """An orthonormal frame."""

    x: Vec3
    y: Vec3
    z: Vec3


class Left(NamedTuple):
    """One of the two limbs left: D^T d, S^T s and c."""

    d: Vec3
    s: Vec3
    c: float


class Turn(NamedTuple):
    """Cosine and sine of an angle."""

    c: float
    s: float


class Reduced(NamedTuple):
    """What is left to solve, with one limb's equation solved by cos g = c."""

    base: Axes  # D
    platform: Axes  # S
    one: Left
    two: Left
    g: Turn


class Linear(NamedTuple):
    """A cos b + B sin b + C = 0."""

    a: float
    b: float
    c: float


def sp_rotation(q):  # type: ignore[no-untyped-def]
    """Return the rotation of a quaternion."""
    q0, q1, q2, q3 = q
    return Rotation(
        q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3, 2.0 * (q1 * q2 - q0 * q3), 2.0 * (q1 * q3 + q0 * q2),
        2.0 * (q1 * q2 + q0 * q3), q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3, 2.0 * (q2 * q3 - q0 * q1),
        2.0 * (q1 * q3 - q0 * q2), 2.0 * (q2 * q3 + q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3,
    )  # fmt: skip


def sp_equation(r, goal):  # type: ignore[no-untyped-def]
    """Return a limb's equation at a rotation."""
    s = turned(r, goal.s)
    d = goal.d
    slope = Vec3(s.y * d.z - s.z * d.y, s.z * d.x - s.x * d.z, s.x * d.y - s.y * d.x)
    return Equation(dot(d, s) - goal.c, slope)


def sp_equations(state, goals):  # type: ignore[no-untyped-def]
    """Return the equations at a state."""
    r = sp_rotation(state)
    one = sp_equation(r, goals.limb1)
    two = sp_equation(r, goals.limb2)
    three = sp_equation(r, goals.limb3)
    worst = abs(one.f) if abs(one.f) > 0.0 else 0.0
    worst = abs(two.f) if abs(two.f) > worst else worst
    worst = abs(three.f) if abs(three.f) > worst else worst
    total = abs(one.f) + abs(two.f) + abs(three.f)
    f = Vec3(one.f, two.f, three.f)
    return System(f, one.slope, two.slope, three.slope, worst + 0.0 * total)


def sp_adjugate_of(at):  # type: ignore[no-untyped-def]
    """Return the adjugate of the slope."""
    j1, j2, j3 = at.one, at.two, at.three
    xx = j2.y * j3.z - j2.z * j3.y
    yx = j2.z * j3.x - j2.x * j3.z
    zx = j2.x * j3.y - j2.y * j3.x
    return Adjugate(
        xx, j1.z * j3.y - j1.y * j3.z, j1.y * j2.z - j1.z * j2.y,
        yx, j1.x * j3.z - j1.z * j3.x, j1.z * j2.x - j1.x * j2.z,
        zx, j1.y * j3.x - j1.x * j3.y, j1.x * j2.y - j1.y * j2.x,
        j1.x * xx + j1.y * yx + j1.z * zx,
    )  # fmt: skip


def sp_turn(p, way, angle):  # type: ignore[no-untyped-def]
    """Return a state, turned about a direction of the base, to second order of a turn."""
    x = angle * way.x * 0.5
    y = angle * way.y * 0.5
    z = angle * way.z * 0.5
    q0 = p.q0 - x * p.q1 - y * p.q2 - z * p.q3
    q1 = p.q1 + x * p.q0 + y * p.q3 - z * p.q2
    q2 = p.q2 + y * p.q0 + z * p.q1 - x * p.q3
    q3 = p.q3 + z * p.q0 + x * p.q2 - y * p.q1
    return sp_unit(q0, q1, q2, q3)


def sp_unit(q0, q1, q2, q3):  # type: ignore[no-untyped-def]
    """Return a quaternion of unit length."""
    unit = 1.0 / math.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    return Quaternion(q0 * unit, q1 * unit, q2 * unit, q3 * unit)


def sp_newton(state, goals):  # type: ignore[no-untyped-def]
    """Return the solution that Newton's method leads to."""
    at = sp_equations(state, goals)
    worst = at.worst
    idle = 0
    for _ in range(60):
        way = assembly_solved(sp_adjugate_of(at), at.f)
        size = assembly_size(way)
        before = state
        state = sp_turn(before, way, 0.5 / size if size > 0.5 else 1.0)
        at = sp_equations(state, goals)
        miss = at.worst
        if miss < sp_CLOSE and miss >= 0.5 * worst:
            # Nothing is left but rounding: two such steps, then the better of both states.
            idle += 1
            if miss >= worst:
                state = before
                at = sp_equations(state, goals)
                miss = at.worst
            if idle > 1 or size < EPS:
                worst = miss
                break
        worst = miss
        if size <= 0.25 * EPS:
            break
    return Solved(state, at, worst)


def sp_kept(w, k):  # type: ignore[no-untyped-def]
    """Return a mode that is kept."""
    at = sp_FOUND + sp_KEPT * k
    return Quaternion(w[at], w[at + 1], w[at + 2], w[at + 3])


def sp_keep(w, count, start, goals):  # type: ignore[no-untyped-def]
    """Keep the solution that a state leads to if it is new; return how many are kept."""
    solved = sp_newton(start, goals)
    if not solved.miss <= sp_CLOSE:
        return count
    adj = sp_adjugate_of(solved.system)
    total = adj.xx * adj.xx + adj.xy * adj.xy + adj.xz * adj.xz
    total = total + adj.yx * adj.yx + adj.yy * adj.yy + adj.yz * adj.yz
    total = total + adj.zx * adj.zx + adj.zy * adj.zy + adj.zz * adj.zz
    # What a miss by rounding moves the solution by.
    radius = 16.0 * EPS * math.sqrt(total) / (abs(adj.det) + TINY)
    radius = radius if radius < 1e-5 else 1e-5
    state = solved.state
    for k in range(count):
        at = sp_FOUND + sp_KEPT * k
        same = 0.0
        other = 0.0
        for i in range(4):
            gap = w[at + i] - state[i]
            same += gap * gap
            gap = w[at + i] + state[i]
            other += gap * gap
        if 2.0 * math.sqrt(same if same < other else other) <= radius + w[at + 4]:
            return count
    if count == sp_MODES:
        return count
    at = sp_FOUND + sp_KEPT * count
    for i in range(4):
        w[at + i] = state[i]
    w[at + 4] = radius
    return count + 1


def sp_twins(w, count, goals):  # type: ignore[no-untyped-def]
    """Seek twins of the modes that are kept; return how many are kept then."""
    k = 0
    while k < count:
        mode = sp_kept(w, k)
        heading = assembly_heading(sp_adjugate_of(sp_equations(mode, goals)))
        bend = 0.0
        for side in range(2):
            step = ASSEMBLY_STEP if side == 0 else -ASSEMBLY_STEP
            f = sp_equations(sp_turn(mode, heading.way, step), goals).f
            bend += heading.weights.x * f.x + heading.weights.y * f.y + heading.weights.z * f.z
        away, near = assembly_apart(heading.along, bend)
        if heading.there and near:
            count = sp_keep(w, count, sp_turn(mode, heading.way, away), goals)
        k += 1
    return count


def sp_frame(a):  # type: ignore[no-untyped-def]
    """Return an orthonormal frame with its first axis along a unit vector."""
    x, y, z = a.x, a.y, a.z
    # Across the axis that the vector is furthest from.
    ax = abs(x)
    ay = abs(y)
    az = abs(z)
    ux = 1.0 if ax <= ay and ax <= az else 0.0
    uy = 1.0 if ux == 0.0 and ay <= az else 0.0
    uz = 1.0 - ux - uy
    vx = y * uz - z * uy
    vy = z * ux - x * uz
    vz = x * uy - y * ux
    unit = 1.0 / math.sqrt(vx * vx + vy * vy + vz * vz)
    vx *= unit
    vy *= unit
    vz *= unit
    return Axes(a, Vec3(vx, vy, vz), Vec3(y * vz - z * vy, z * vx - x * vz, x * vy - y * vx))


def sp_along(axes, a):  # type: ignore[no-untyped-def]
    """Return a vector in a frame."""
    return Vec3(dot(axes.x, a), dot(axes.y, a), dot(axes.z, a))


def sp_left(base, platform, goal):  # type: ignore[no-untyped-def]
    """Return one of the limbs left."""
    return Left(sp_along(base, goal.d), sp_along(platform, goal.s), goal.c)


def sp_reduced(goals, first):  # type: ignore[no-untyped-def]
    """Return what is left once the equation of limb ``first`` is solved."""
    limbs = (goals.limb1, goals.limb2, goals.limb3)
    goal = limbs[first]
    base = sp_frame(goal.d)
    platform = sp_frame(goal.s)
    one = sp_left(base, platform, limbs[1 if first == 0 else 0])
    two = sp_left(base, platform, limbs[1 if first == 2 else 2])
    cg = goal.c
    cg = 1.0 if cg > 1.0 else (-1.0 if cg < -1.0 else cg)
    return Reduced(base, platform, one, two, Turn(cg, math.sqrt((1.0 - cg) * (1.0 + cg))))


def sp_linear(limb, a, g):  # type: ignore[no-untyped-def]
    """Return A, B, C of one of the two limbs left at an angle a."""
    d, s = limb.d, limb.s
    e1 = d.x
    e2 = d.y * a.c + d.z * a.s
    e3 = d.z * a.c - d.y * a.s
    across = e2 * g.c - e1 * g.s
    return Linear(
        across * s.y + e3 * s.z, e3 * s.y - across * s.z, (e1 * g.c + e2 * g.s) * s.x - limb.c
    )


def sp_state(at, a, b):  # type: ignore[no-untyped-def]
    """Return D Rx(a) Rz(g) Rx(b) S^T."""
    ca, sa, cb, sb = a.c, a.s, b.c, b.s
    cg, sg = at.g.c, at.g.s
    # M = Rx(a) Rz(g) Rx(b)
    m11, m12, m13 = cg, -sg * cb, sg * sb
    m21, m22, m23 = ca * sg, ca * cg * cb - sa * sb, -ca * cg * sb - sa * cb
    m31, m32, m33 = sa * sg, sa * cg * cb + ca * sb, ca * cb - sa * cg * sb
    m = Rotation(m11, m12, m13, m21, m22, m23, m31, m32, m33)
    d = at.base
    row1 = sp_entries(Vec3(d.x.x, d.y.x, d.z.x), m, at.platform)
    row2 = sp_entries(Vec3(d.x.y, d.y.y, d.z.y), m, at.platform)
    row3 = sp_entries(Vec3(d.x.z, d.y.z, d.z.z), m, at.platform)
    return sp_quaternion(row1, row2, row3)


def sp_entries(d, m, platform):  # type: ignore[no-untyped-def]
    """Return a row of D M S^T from one of D."""
    n1 = d.x * m.xx + d.y * m.yx + d.z * m.zx
    n2 = d.x * m.xy + d.y * m.yy + d.z * m.zy
    n3 = d.x * m.xz + d.y * m.yz + d.z * m.zz
    s1, s2, s3 = platform
    return Vec3(
        n1 * s1.x + n2 * s2.x + n3 * s3.x,
        n1 * s1.y + n2 * s2.y + n3 * s3.y,
        n1 * s1.z + n2 * s2.z + n3 * s3.z,
    )


def sp_quaternion(row1, row2, row3):  # type: ignore[no-untyped-def]
    """Return the quaternion of a rotation by its rows, from its largest component."""
    r11, r12, r13 = row1
    r21, r22, r23 = row2
    r31, r32, r33 = row3
    trace = r11 + r22 + r33
    if trace >= r11 and trace >= r22 and trace >= r33:
        return sp_unit(1.0 + trace, r32 - r23, r13 - r31, r21 - r12)
    if r11 >= r22 and r11 >= r33:
        return sp_unit(r32 - r23, 1.0 + r11 - r22 - r33, r12 + r21, r13 + r31)
    if r22 >= r33:
        return sp_unit(r13 - r31, r12 + r21, 1.0 - r11 + r22 - r33, r23 + r32)
    return sp_unit(r21 - r12, r13 + r31, r23 + r32, 1.0 - r11 - r22 + r33)


def sp_at(t, phase):  # type: ignore[no-untyped-def]
    """Return the angle a whose tan(a / 2) is t, and a phase more."""
    weight = 1.0 + t * t
    c = (1.0 - t * t) / weight
    s = 2.0 * t / weight
    return Turn(c * phase.c - s * phase.s, s * phase.c + c * phase.s)


def sp_polynomial(t, phase, at):  # type: ignore[no-untyped-def]
    """Return the polynomial of degree 8 at tan(a / 2)."""
    weight = 1.0 + t * t
    a = sp_at(t, phase)
    a1, b1, c1 = sp_linear(at.one, a, at.g)
    a2, b2, c2 = sp_linear(at.two, a, at.g)
    det = a1 * b2 - b1 * a2
    cosine = b1 * c2 - c1 * b2
    sine = c1 * a2 - a1 * c2
    weight *= weight
    weight *= weight
    return (cosine * cosine + sine * sine - det * det) * weight


def sp_starts(w, count, a, at, goals):  # type: ignore[no-untyped-def]
    """Seek solutions from both b that one limb left allows at an angle a; return how many."""
    a1, b1, c1 = sp_linear(at.one, a, at.g)
    a2, b2, c2 = sp_linear(at.two, a, at.g)
    size = a1 * a1 + b1 * b1
    if a2 * a2 + b2 * b2 > size:
        a1, b1, c1 = a2, b2, c2
        size = a1 * a1 + b1 * b1
    root = size - c1 * c1
    root = math.sqrt(root if root > 0.0 else 0.0)
    unit = 1.0 / (size + TINY)
    for _ in range(2):
        root = -root
        cb = -(a1 * c1 + b1 * root) * unit
        sb = (a1 * root - b1 * c1) * unit
        turn = math.sqrt(cb * cb + sb * sb)
        if turn > 0.0:
            start = sp_state(at, a, Turn(cb / turn, sb / turn))
            count = sp_keep(w, count, start, goals)
    return count


def sp_search(constants, w, count, phase, at, goals):  # type: ignore[no-untyped-def]
    """Seek solutions by half the circle of a; return how many are kept, and can be at most."""
    values = w[sp_VALUES : sp_VALUES + 9]
    roots = w[sp_ROOTS : sp_ROOTS + 2 * octic_MOST]
    stack = w[sp_STACK : sp_STACK + 11 * octic_DEPTH]
    largest = 0.0
    for m in range(9):
        values[m] = sp_polynomial(constants[18 + m], phase, at)
        largest = abs(values[m]) if abs(values[m]) > largest else largest
    # A, B, C are of size 2 at most, each with an error of a few units in the last place.
    error = 1e-13
    if not largest > error:
        # The equations say nothing about a: as far as Newton's method finds modes.
        for m in range(9):
            count = sp_starts(w, count, sp_at(constants[18 + m], phase), at, goals)
        return count, 99
    some, most = octic_roots(values, error, constants[27:109], stack, roots)
    for m in range(some):
        around = 3 if roots[2 * m + 1] > 0.0 else 1
        for side in range(around):
            shift = roots[2 * m + 1] if side == 1 else (-roots[2 * m + 1] if side == 2 else 0.0)
            count = sp_starts(w, count, sp_at(roots[2 * m] + shift, phase), at, goals)
    return count, most


def sp_goal(joints, constants, i, size):  # type: ignore[no-untyped-def]
    """Return a limb's equation, lengths over ``size``."""
    dx = constants[3 * i] / size
    dy = constants[3 * i + 1] / size
    dz = constants[3 * i + 2] / size
    sx = constants[9 + 2 * i] / size
    sy = constants[10 + 2 * i] / size
    sz = joints[3] / size
    d = math.sqrt(dx * dx + dy * dy + dz * dz)
    s = math.sqrt(sx * sx + sy * sy + sz * sz)
    length = joints[i] / size
    # (s^2 + d^2 - l^2) / 2 without the digits that squares lose where d is small.
    goal = (d * d + (s - length) * (s + length)) / (2.0 * d * s)
    return Goal(Vec3(dx / d, dy / d, dz / d), Vec3(sx / s, sy / s, sz / s), goal)


def sp_write(q, joints, constants, out):  # type: ignore[no-untyped-def]
    """Write pose, residual and distance from home of a mode."""
    l4 = joints[3]
    r = sp_rotation(q)
    phi, theta, psi = assembly_angles(r)
    out[0] = phi
    out[1] = theta
    out[2] = psi
    out[3] = l4
    worst = 0.0
    for n in range(3):
        ex = constants[9 + 2 * n]
        ey = constants[10 + 2 * n]
        x = r.xx * ex + r.xy * ey + r.xz * l4 - constants[3 * n]
        y = r.yx * ex + r.yy * ey + r.yz * l4 - constants[3 * n + 1]
        z = r.zx * ex + r.zy * ey + r.zz * l4 - constants[3 * n + 2]
        miss = abs(math.sqrt(x * x + y * y + z * z) - joints[n])
        worst = miss if miss > worst else worst
    out[4] = worst
    away = 0.0
    for n in range(3):
        gap = assembly_principal(out[n] - constants[15 + n])
        away += gap * gap
    out[5] = away


def sp_assemble(joints, constants, found, w):  # type: ignore[no-untyped-def]
    """Write the assembly modes, a row each; return how many and whether they are all.

    Parameters
    ----------
    joints : (4,)
    constants : (128,)
        d_i (3 x 3), e_i (3 x 2), home's angles (3), degree-8 nodes (9) and matrix (82).
    found : (8, 6)
        phi, theta, psi, l4, the largest miss of a length, and what they are sorted by.
    w : (sp_WORK,)
        Scratch space.
    """
    # Over the longest of everything: lengths of any unit are alike.
    size = abs(joints[3])
    for i in range(3):
        if joints[i] < 0.0:
            return 0, True
        size = joints[i] if joints[i] > size else size
    for i in range(15):
        size = abs(constants[i]) if abs(constants[i]) > size else size
    goals = Goals(
        sp_goal(joints, constants, 0, size),
        sp_goal(joints, constants, 1, size),
        sp_goal(joints, constants, 2, size),
    )
    # The limb furthest from stretched and folded goes first.
    flattest = 2.0
    first = 0
    for i in range(3):
        goal = abs(goals[i].c)
        if goal < flattest:
            flattest = goal
            first = i
        if goal > 1.0 + 16.0 * EPS:
            return 0, True
    at = sp_reduced(goals, first)
    phase_s, phase_c = sin_cos(sp_PHASE)
    count, bound = sp_search(constants, w, 0, Turn(phase_c, phase_s), at, goals)
    count, most = sp_search(constants, w, count, Turn(-phase_c, -phase_s), at, goals)
    # Nothing is known of the number where the equations say nothing about a.
    bound = 99 if most == 99 else bound + most
    count = sp_twins(w, count, goals)
    for m in range(count):
        sp_write(sp_kept(w, m), joints, constants, found[m])
    assembly_sort(found, count, 6)
    return count, bound <= count

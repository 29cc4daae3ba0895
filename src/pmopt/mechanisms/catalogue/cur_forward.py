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

from pmopt.kernels.assembly import assembly_angles, assembly_sort
from pmopt.kernels.octics import octic_DEPTH, octic_MOST, octic_roots
from pmopt.kernels.trigonometry import arc_tangent, sin_cos

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
cur_STATE = 0  # theta (3), cosines and sines (6), equations (3), slope (9), adjugate (9)
cur_GOALS = 30  # constant terms of the equations of 12, 13 and 23; b; the size of their terms
cur_VALUES = 35
cur_ROOTS = 44
cur_STACK = cur_ROOTS + 2 * octic_MOST
cur_FOUND = cur_STACK + 11 * octic_DEPTH
cur_POINTS = cur_FOUND + cur_HALF * cur_KEPT  # C_i' and C_i
cur_WORK = cur_POINTS + 18


def cur_pair(w, i, j, goal):  # type: ignore[no-untyped-def]
    """Return an equation of two limbs and its slopes by both theta."""
    ci = w[cur_STATE + 3 + 2 * i]
    si = w[cur_STATE + 4 + 2 * i]
    cj = w[cur_STATE + 3 + 2 * j]
    sj = w[cur_STATE + 4 + 2 * j]
    b3 = 3.0 * w[cur_GOALS + 3]
    return (
        ci * cj - 2.0 * si * sj - b3 * (ci + cj) + w[cur_GOALS + goal],
        b3 * si - si * cj - 2.0 * ci * sj,
        b3 * sj - sj * ci - 2.0 * cj * si,
    )


def cur_equations(w):  # type: ignore[no-untyped-def]
    """Put the equations at the state and their slopes in place; return the largest miss."""
    for i in range(3):
        s, c = sin_cos(w[cur_STATE + i])
        w[cur_STATE + 3 + 2 * i] = c
        w[cur_STATE + 4 + 2 * i] = s
    f12, a12, b12 = cur_pair(w, 0, 1, 0)
    f13, a13, b13 = cur_pair(w, 0, 2, 1)
    f23, a23, b23 = cur_pair(w, 1, 2, 2)
    k = cur_STATE + 9
    w[k], w[k + 1], w[k + 2] = f12, f13, f23
    w[k + 3], w[k + 4], w[k + 5] = a12, b12, 0.0
    w[k + 6], w[k + 7], w[k + 8] = a13, 0.0, b13
    w[k + 9], w[k + 10], w[k + 11] = 0.0, a23, b23
    worst = abs(f12) if abs(f12) > abs(f13) else abs(f13)
    worst = worst if worst > abs(f23) else abs(f23)
    # Not a number if any is not.
    return worst + 0.0 * (abs(f12) + abs(f13) + abs(f23))


def cur_inverse(w):  # type: ignore[no-untyped-def]
    """Put the slope's adjugate in place; return its determinant."""
    k = cur_STATE + 12
    p, q, r, s, t, u = w[k], w[k + 1], w[k + 3], w[k + 5], w[k + 7], w[k + 8]
    a = cur_STATE + 21
    # Of [[p, q, 0], [r, 0, s], [0, t, u]].
    w[a], w[a + 1], w[a + 2] = -s * t, -q * u, q * s
    w[a + 3], w[a + 4], w[a + 5] = -r * u, p * u, -p * s
    w[a + 6], w[a + 7], w[a + 8] = r * t, -p * t, -q * r
    return -p * s * t - q * r * u


def cur_newton(w):  # type: ignore[no-untyped-def]
    """Move the state to a solution; return the largest miss of an equation over its size."""
    size = w[cur_GOALS + 4]
    worst = cur_equations(w)
    idle = 0
    for _ in range(60):
        d = cur_inverse(w)
        unit = -d / (d * d + TINY)
        a = cur_STATE + 21
        f1, f2, f3 = w[cur_STATE + 9], w[cur_STATE + 10], w[cur_STATE + 11]
        x = unit * (w[a] * f1 + w[a + 1] * f2 + w[a + 2] * f3)
        y = unit * (w[a + 3] * f1 + w[a + 4] * f2 + w[a + 5] * f3)
        z = unit * (w[a + 6] * f1 + w[a + 7] * f2 + w[a + 8] * f3)
        step = math.sqrt(x * x + y * y + z * z)
        shorter = 0.4 / step if step > 0.4 else 1.0
        t1, t2, t3 = w[cur_STATE], w[cur_STATE + 1], w[cur_STATE + 2]
        w[cur_STATE] = t1 + shorter * x
        w[cur_STATE + 1] = t2 + shorter * y
        w[cur_STATE + 2] = t3 + shorter * z
        miss = cur_equations(w)
        if miss < cur_CLOSE * size and miss >= 0.5 * worst:
            # Nothing is left but rounding: two such steps, then the better of both states.
            idle += 1
            if miss >= worst:
                w[cur_STATE], w[cur_STATE + 1], w[cur_STATE + 2] = t1, t2, t3
                miss = cur_equations(w)
            if idle > 1 or step < EPS:
                worst = miss
                break
        worst = miss
        if step <= 0.25 * EPS:
            break
    return worst / size


def cur_keep(w, count):  # type: ignore[no-untyped-def]
    """Keep the state if it solves the equations and is new; return how many are kept.

    A state and its mirror image, -theta, are kept as one.
    """
    if not cur_newton(w) <= cur_CLOSE:
        return count
    d = cur_inverse(w)
    total = 0.0
    for i in range(9):
        total += w[cur_STATE + 21 + i] * w[cur_STATE + 21 + i]
    # What a miss by rounding moves the solution by.
    radius = 16.0 * EPS * (1.0 + w[cur_GOALS + 4] * math.sqrt(total) / (abs(d) + TINY))
    radius = radius if radius < 1e-5 else 1e-5
    for k in range(count):
        at = cur_FOUND + cur_KEPT * k
        same = 0.0
        other = 0.0
        for i in range(3):
            for side in range(2):
                gap = w[at + i] - w[cur_STATE + i] if side == 0 else w[at + i] + w[cur_STATE + i]
                gap -= 6.283185307179586 * math.floor(gap / 6.283185307179586 + 0.5)
                if side == 0:
                    same += gap * gap
                else:
                    other += gap * gap
        if math.sqrt(same if same < other else other) <= radius + w[at + 3]:
            return count
    if count == cur_HALF:
        return count
    at = cur_FOUND + cur_KEPT * count
    for i in range(3):
        w[at + i] = w[cur_STATE + i]
    w[at + 3] = radius
    return count + 1


def cur_twin(w, k):  # type: ignore[no-untyped-def]
    """Move the state to where mode k may have a twin; return whether it may."""
    at = cur_FOUND + cur_KEPT * k
    for i in range(3):
        w[cur_STATE + i] = w[at + i]
    cur_equations(w)
    det = cur_inverse(w)
    a = cur_STATE + 21
    best = 0.0
    row = 0
    column = 0
    for i in range(3):
        for j in range(3):
            if abs(w[a + 3 * i + j]) > best:
                best = abs(w[a + 3 * i + j])
                row = i
                column = j
    if best <= TINY:
        return False
    x, y, z = w[a + column], w[a + 3 + column], w[a + 6 + column]
    size = math.sqrt(x * x + y * y + z * z)
    x /= size
    y /= size
    z /= size
    u, v, t = w[a + 3 * row], w[a + 3 * row + 1], w[a + 3 * row + 2]
    along = (x if row == 0 else (y if row == 1 else z)) * det
    bend = 0.0
    step = 1e-3
    for side in range(2):
        way = step if side == 0 else -step
        w[cur_STATE] = w[at] + way * x
        w[cur_STATE + 1] = w[at + 1] + way * y
        w[cur_STATE + 2] = w[at + 2] + way * z
        cur_equations(w)
        bend += u * w[cur_STATE + 9] + v * w[cur_STATE + 10] + t * w[cur_STATE + 11]
    bend /= step * step
    if not abs(along) < 0.15 * abs(bend):
        return False
    away = -2.0 * along / bend
    w[cur_STATE] = w[at] + away * x
    w[cur_STATE + 1] = w[at + 1] + away * y
    w[cur_STATE + 2] = w[at + 2] + away * z
    return True


def cur_follow(c1, s1, b3, goal):  # type: ignore[no-untyped-def]
    """Return what an equation of theta_1 and another theta leaves of that one.

    cos = (g p -+ q h) / n, sin = (g q +- p h) / n with h^2 = n - g^2; returned are g, p, q, n, h^2.
    s1^2 may be below 0 for a polynomial's sake: q^2 is returned by n alone.
    """
    p = c1 - b3
    g = b3 * c1 - goal
    n = p * p + 4.0 * s1
    return g, p, n, n - g * g


def cur_order(first):  # type: ignore[no-untyped-def]
    """Return the other two limbs, and the equations of the first with each and of both."""
    if first == 0:
        return 1, 2, 0, 1, 2
    return (0, 2, 0, 2, 1) if first == 1 else (0, 1, 1, 2, 0)


def cur_polynomial(c1, first, w):  # type: ignore[no-untyped-def]
    """Return the polynomial of degree 8 at a limb's cos theta, and the size of its terms."""
    b3 = 3.0 * w[cur_GOALS + 3]
    square = 1.0 - c1 * c1
    _, _, one, two, both = cur_order(first)
    g2, p, n, h2 = cur_follow(c1, square, b3, w[cur_GOALS + one])
    g3, _, _, h3 = cur_follow(c1, square, b3, w[cur_GOALS + two])
    goal = w[cur_GOALS + both]
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


def cur_starts(w, count, c1, first):  # type: ignore[no-untyped-def]
    """Seek solutions from the four pairs of the other theta at a limb's cos theta."""
    c1 = 1.0 if c1 > 1.0 else (-1.0 if c1 < -1.0 else c1)
    s1 = math.sqrt((1.0 - c1) * (1.0 + c1))
    b3 = 3.0 * w[cur_GOALS + 3]
    j, k, one, two, both = cur_order(first)
    g2, p, n, h2 = cur_follow(c1, s1 * s1, b3, w[cur_GOALS + one])
    g3, _, _, h3 = cur_follow(c1, s1 * s1, b3, w[cur_GOALS + two])
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
        miss = c2 * c3 - 2.0 * s2 * s3 - b3 * (c2 + c3) + w[cur_GOALS + both]
        if abs(miss) <= cur_NEAR * w[cur_GOALS + 4]:
            w[cur_STATE + first] = arc_tangent(s1, c1)
            w[cur_STATE + j] = arc_tangent(s2, c2)
            w[cur_STATE + k] = arc_tangent(s3, c3)
            count = cur_keep(w, count)
    return count


def cur_triad(w, at):  # type: ignore[no-untyped-def]
    """Return the axes of a triangle of points, one after the other: a side, across, the normal."""
    ux, uy, uz = w[at + 3] - w[at], w[at + 4] - w[at + 1], w[at + 5] - w[at + 2]
    vx, vy, vz = w[at + 6] - w[at], w[at + 7] - w[at + 1], w[at + 8] - w[at + 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    unit = 1.0 / math.sqrt(ux * ux + uy * uy + uz * uz)
    ux *= unit
    uy *= unit
    uz *= unit
    unit = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    nx *= unit
    ny *= unit
    nz *= unit
    return ux, uy, uz, ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux, nx, ny, nz


def cur_place(w, ra, rb, length, rise, home, side, out):  # type: ignore[no-untyped-def]
    """Write pose, parasitic coordinates, residual and distance from home of the state."""
    for i in range(3):
        c = 1.0 if i == 0 else -0.5
        s = 0.0 if i == 0 else (cur_SINE if i == 1 else -cur_SINE)
        out_radius = rb - length * w[cur_STATE + 3 + 2 * i]
        w[cur_POINTS + 3 * i] = out_radius * c
        w[cur_POINTS + 3 * i + 1] = out_radius * s
        w[cur_POINTS + 3 * i + 2] = -side * length * w[cur_STATE + 4 + 2 * i]
    base = cur_POINTS + 9
    px = 0.0
    py = 0.0
    pz = 0.0
    m1, m2, m3, m4, m5, m6, m7, m8, m9 = cur_triad(w, cur_POINTS)
    n1, n2, n3, n4, n5, n6, n7, n8, n9 = cur_triad(w, base)
    r = (
        n1 * m1 + n4 * m4 + n7 * m7, n1 * m2 + n4 * m5 + n7 * m8, n1 * m3 + n4 * m6 + n7 * m9,
        n2 * m1 + n5 * m4 + n8 * m7, n2 * m2 + n5 * m5 + n8 * m8, n2 * m3 + n5 * m6 + n8 * m9,
        n3 * m1 + n6 * m4 + n9 * m7, n3 * m2 + n6 * m5 + n9 * m8, n3 * m3 + n6 * m6 + n9 * m9,
    )  # fmt: skip
    for i in range(3):
        k = cur_POINTS + 3 * i
        x, y, z = w[k], w[k + 1], w[k + 2]
        k = base + 3 * i
        px += (w[k] - (r[0] * x + r[1] * y + r[2] * z)) / 3.0
        py += (w[k + 1] - (r[3] * x + r[4] * y + r[5] * z)) / 3.0
        pz += (w[k + 2] - (r[6] * x + r[7] * y + r[8] * z)) / 3.0
    worst = 0.0
    for i in range(3):
        c = 1.0 if i == 0 else -0.5
        s = 0.0 if i == 0 else (cur_SINE if i == 1 else -cur_SINE)
        k = base + 3 * i
        wx = px + rb * (r[0] * c + r[1] * s) - w[k]
        wy = py + rb * (r[3] * c + r[4] * s) - w[k + 1]
        wz = pz + rb * (r[6] * c + r[7] * s) - w[k + 2]
        miss = wx * (r[1] * c - r[0] * s) + wy * (r[4] * c - r[3] * s) + wz * (r[7] * c - r[6] * s)
        worst = abs(miss) if abs(miss) > worst else worst
        miss = math.sqrt(wx * wx + wy * wy + wz * wz) - length
        worst = abs(miss) if abs(miss) > worst else worst
    alpha, beta, gamma = assembly_angles(r)
    pz += rise
    out[0] = pz
    out[1] = beta
    out[2] = gamma
    out[3] = px
    out[4] = py
    out[5] = alpha
    out[6] = worst
    gap = pz - home
    out[7] = gap * gap + rb * rb * (alpha * alpha + beta * beta + gamma * gamma)


def cur_search(constants, w, count, first):  # type: ignore[no-untyped-def]
    """Seek solutions by a limb's cos theta; return how many are kept, and can be at most."""
    values = w[cur_VALUES : cur_VALUES + 9]
    roots = w[cur_ROOTS : cur_ROOTS + 2 * octic_MOST]
    stack = w[cur_STACK : cur_STACK + 11 * octic_DEPTH]
    error = 0.0
    largest = 0.0
    for m in range(9):
        value, terms = cur_polynomial(cur_WIDE * constants[5 + m], first, w)
        values[m] = value
        largest = abs(value) if abs(value) > largest else largest
        error = terms if terms > error else error
    error *= 64.0 * EPS
    if not largest > error:
        # The equations say nothing about theta: as far as Newton's method finds modes.
        for m in range(9):
            count = cur_starts(w, count, constants[5 + m], first)
        return count, 99
    some, bound = octic_roots(values, error, constants[14:96], stack, roots)
    for m in range(some):
        if roots[2 * m + 1] == 0.0 and abs(cur_WIDE * roots[2 * m]) > cur_COSINE:
            bound -= 1
            continue
        around = 3 if roots[2 * m + 1] > 0.0 else 1
        for side in range(around):
            shift = roots[2 * m + 1] if side == 1 else (-roots[2 * m + 1] if side == 2 else 0.0)
            count = cur_starts(w, count, cur_WIDE * (roots[2 * m] + shift), first)
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
    size = 0.0
    for k in range(3):
        i = 0 if k < 2 else 1
        j = 1 if k == 0 else 2
        rise = (joints[i] - joints[j]) / length
        side = ra / length
        apart = 3.0 * side * side + rise * rise
        w[cur_GOALS + k] = 3.0 * b * b + 2.0 - apart
        size = apart if apart > size else size
    w[cur_GOALS + 3] = b
    # The longest that two points of the circles can be apart: beyond it nothing assembles.
    widest = 3.0 * (b + 1.0) * (b + 1.0) + 4.0
    w[cur_GOALS + 4] = widest
    if not size <= widest:
        return 0, True
    count = 0
    bound = 99
    # Near cos theta = 3 b = 1 the other theta hardly follow from this one: another limb's, then.
    for first in range(3):
        count, most = cur_search(constants, w, count, first)
        bound = most if most < bound else bound
        m = 0
        while m < count:
            if cur_twin(w, m):
                count = cur_keep(w, count)
            m += 1
        if bound <= count:
            break
    rise = middle + constants[3]
    for i in range(3):
        k = cur_POINTS + 9 + 3 * i
        w[k] = ra * (1.0 if i == 0 else -0.5)
        w[k + 1] = 0.0 if i == 0 else (ra * cur_SINE if i == 1 else -ra * cur_SINE)
        w[k + 2] = joints[i] - middle
    total = 0
    for m in range(count):
        at = cur_FOUND + cur_KEPT * m
        flat = 0.0
        for i in range(3):
            w[cur_STATE + i] = w[at + i]
        cur_equations(w)
        for i in range(3):
            s = abs(w[cur_STATE + 4 + 2 * i])
            flat = s if s > flat else flat
        cur_place(w, ra, rb, length, rise, constants[4], 1.0, found[total])
        total += 1
        # All links in the platform's plane: the mode is its own mirror image.
        if flat > w[at + 3]:
            cur_place(w, ra, rb, length, rise, constants[4], -1.0, found[total])
            total += 1
    assembly_sort(found, total, 8)
    return total, bound <= count

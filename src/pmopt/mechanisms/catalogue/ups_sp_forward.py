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

from pmopt.kernels.assembly import assembly_angles, assembly_sort
from pmopt.kernels.octics import octic_DEPTH, octic_MOST, octic_roots
from pmopt.kernels.trigonometry import sin_cos

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
sp_SYSTEM = 0  # rows d (3), s (3), c of limbs 1 to 3, over the lengths of d and s
sp_FRAMES = 21  # D and S, column by column
sp_TURNED = 39  # D^T d and S^T s of the two limbs left
sp_VALUES = 51
sp_ROOTS = 60
sp_STACK = sp_ROOTS + 2 * octic_MOST
sp_STATE = sp_STACK + 11 * octic_DEPTH  # quaternion (4), equations (3), slope (9), adjugate (9)
sp_FOUND = sp_STATE + 25
sp_WORK = sp_FOUND + sp_MODES * sp_KEPT


def sp_turned(w, quaternion):  # type: ignore[no-untyped-def]
    """Return the rotation of a quaternion, row by row."""
    q0 = w[quaternion]
    q1 = w[quaternion + 1]
    q2 = w[quaternion + 2]
    q3 = w[quaternion + 3]
    return (
        q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3, 2.0 * (q1 * q2 - q0 * q3), 2.0 * (q1 * q3 + q0 * q2),
        2.0 * (q1 * q2 + q0 * q3), q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3, 2.0 * (q2 * q3 - q0 * q1),
        2.0 * (q1 * q3 - q0 * q2), 2.0 * (q2 * q3 + q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3,
    )  # fmt: skip


def sp_equations(w):  # type: ignore[no-untyped-def]
    """Put the equations at the state and their slopes by turns about the base's axes in place."""
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = sp_turned(w, sp_STATE)
    worst = 0.0
    total = 0.0
    for i in range(3):
        k = sp_SYSTEM + 7 * i
        sx = r11 * w[k + 3] + r12 * w[k + 4] + r13 * w[k + 5]
        sy = r21 * w[k + 3] + r22 * w[k + 4] + r23 * w[k + 5]
        sz = r31 * w[k + 3] + r32 * w[k + 4] + r33 * w[k + 5]
        f = w[k] * sx + w[k + 1] * sy + w[k + 2] * sz - w[k + 6]
        w[sp_STATE + 4 + i] = f
        worst = abs(f) if abs(f) > worst else worst
        total += abs(f)
        j = sp_STATE + 7 + 3 * i
        w[j] = sy * w[k + 2] - sz * w[k + 1]
        w[j + 1] = sz * w[k] - sx * w[k + 2]
        w[j + 2] = sx * w[k + 1] - sy * w[k]
    # Not a number if any is not.
    return worst + 0.0 * total


def sp_adjugate(w):  # type: ignore[no-untyped-def]
    """Put the slope's adjugate in place; return its determinant."""
    j = sp_STATE + 7
    a = sp_STATE + 16
    w[a] = w[j + 4] * w[j + 8] - w[j + 5] * w[j + 7]
    w[a + 1] = w[j + 2] * w[j + 7] - w[j + 1] * w[j + 8]
    w[a + 2] = w[j + 1] * w[j + 5] - w[j + 2] * w[j + 4]
    w[a + 3] = w[j + 5] * w[j + 6] - w[j + 3] * w[j + 8]
    w[a + 4] = w[j] * w[j + 8] - w[j + 2] * w[j + 6]
    w[a + 5] = w[j + 2] * w[j + 3] - w[j] * w[j + 5]
    w[a + 6] = w[j + 3] * w[j + 7] - w[j + 4] * w[j + 6]
    w[a + 7] = w[j + 1] * w[j + 6] - w[j] * w[j + 7]
    w[a + 8] = w[j] * w[j + 4] - w[j + 1] * w[j + 3]
    return w[j] * w[a] + w[j + 1] * w[a + 3] + w[j + 2] * w[a + 6]


def sp_turn(w, x, y, z):  # type: ignore[no-untyped-def]
    """Turn the state by (x, y, z), radians about the base's axes, to second order of a turn."""
    p0 = w[sp_STATE]
    p1 = w[sp_STATE + 1]
    p2 = w[sp_STATE + 2]
    p3 = w[sp_STATE + 3]
    x *= 0.5
    y *= 0.5
    z *= 0.5
    q0 = p0 - x * p1 - y * p2 - z * p3
    q1 = p1 + x * p0 + y * p3 - z * p2
    q2 = p2 + y * p0 + z * p1 - x * p3
    q3 = p3 + z * p0 + x * p2 - y * p1
    unit = 1.0 / math.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    w[sp_STATE] = q0 * unit
    w[sp_STATE + 1] = q1 * unit
    w[sp_STATE + 2] = q2 * unit
    w[sp_STATE + 3] = q3 * unit


def sp_newton(w):  # type: ignore[no-untyped-def]
    """Move the state to a solution; return the largest miss of an equation there."""
    worst = sp_equations(w)
    idle = 0
    for _ in range(60):
        d = sp_adjugate(w)
        unit = -d / (d * d + TINY)
        a = sp_STATE + 16
        f1 = w[sp_STATE + 4]
        f2 = w[sp_STATE + 5]
        f3 = w[sp_STATE + 6]
        x = unit * (w[a] * f1 + w[a + 1] * f2 + w[a + 2] * f3)
        y = unit * (w[a + 3] * f1 + w[a + 4] * f2 + w[a + 5] * f3)
        z = unit * (w[a + 6] * f1 + w[a + 7] * f2 + w[a + 8] * f3)
        size = math.sqrt(x * x + y * y + z * z)
        shorter = 0.5 / size if size > 0.5 else 1.0
        q0 = w[sp_STATE]
        q1 = w[sp_STATE + 1]
        q2 = w[sp_STATE + 2]
        q3 = w[sp_STATE + 3]
        sp_turn(w, shorter * x, shorter * y, shorter * z)
        miss = sp_equations(w)
        if miss < sp_CLOSE and miss >= 0.5 * worst:
            # Nothing is left but rounding: two such steps, then the better of both states.
            idle += 1
            if miss >= worst:
                w[sp_STATE] = q0
                w[sp_STATE + 1] = q1
                w[sp_STATE + 2] = q2
                w[sp_STATE + 3] = q3
                miss = sp_equations(w)
            if idle > 1 or size < EPS:
                worst = miss
                break
        worst = miss
        if size <= 0.25 * EPS:
            break
    return worst


def sp_keep(w, count):  # type: ignore[no-untyped-def]
    """Keep the state if it solves the equations and is new; return how many are kept."""
    if not sp_newton(w) <= sp_CLOSE:
        return count
    d = sp_adjugate(w)
    total = 0.0
    for i in range(9):
        total += w[sp_STATE + 16 + i] * w[sp_STATE + 16 + i]
    # What a miss by rounding moves the solution by.
    radius = 16.0 * EPS * math.sqrt(total) / (abs(d) + TINY)
    radius = radius if radius < 1e-5 else 1e-5
    for k in range(count):
        at = sp_FOUND + sp_KEPT * k
        same = 0.0
        other = 0.0
        for i in range(4):
            gap = w[at + i] - w[sp_STATE + i]
            same += gap * gap
            gap = w[at + i] + w[sp_STATE + i]
            other += gap * gap
        if 2.0 * math.sqrt(same if same < other else other) <= radius + w[at + 4]:
            return count
    if count == sp_MODES:
        return count
    at = sp_FOUND + sp_KEPT * count
    for i in range(4):
        w[at + i] = w[sp_STATE + i]
    w[at + 4] = radius
    return count + 1


def sp_twin(w, k):  # type: ignore[no-untyped-def]
    """Move the state to where mode k may have a twin; return whether it may."""
    for i in range(4):
        w[sp_STATE + i] = w[sp_FOUND + sp_KEPT * k + i]
    sp_equations(w)
    det = sp_adjugate(w)
    # The adjugate tends to a product of the directions that the slope hardly moves and that it
    # hardly reaches: its largest column and row.
    a = sp_STATE + 16
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
    x = w[a + column]
    y = w[a + 3 + column]
    z = w[a + 6 + column]
    size = math.sqrt(x * x + y * y + z * z)
    x /= size
    y /= size
    z /= size
    u = w[a + 3 * row]
    v = w[a + 3 * row + 1]
    t = w[a + 3 * row + 2]
    # adj(J) J = det: the row times J is det along axis ``row``.
    along = (x if row == 0 else (y if row == 1 else z)) * det
    bend = 0.0
    step = 1e-3
    for side in range(2):
        for i in range(4):
            w[sp_STATE + i] = w[sp_FOUND + sp_KEPT * k + i]
        way = step if side == 0 else -step
        sp_turn(w, way * x, way * y, way * z)
        sp_equations(w)
        bend += u * w[sp_STATE + 4] + v * w[sp_STATE + 5] + t * w[sp_STATE + 6]
    bend /= step * step
    if not abs(along) < 0.15 * abs(bend):
        return False
    away = -2.0 * along / bend
    for i in range(4):
        w[sp_STATE + i] = w[sp_FOUND + sp_KEPT * k + i]
    sp_turn(w, away * x, away * y, away * z)
    return True


def sp_frame(w, at, x, y, z):  # type: ignore[no-untyped-def]
    """Put an orthonormal frame with first axis along a unit vector in place, axis by axis."""
    w[at] = x
    w[at + 1] = y
    w[at + 2] = z
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
    w[at + 3] = vx
    w[at + 4] = vy
    w[at + 5] = vz
    w[at + 6] = y * vz - z * vy
    w[at + 7] = z * vx - x * vz
    w[at + 8] = x * vy - y * vx


def sp_linear(w, j, ca, sa, cg, sg, goal):  # type: ignore[no-untyped-def]
    """Return A, B, C of one of the two limbs left at an angle a."""
    k = sp_TURNED + 6 * j
    e1 = w[k]
    e2 = w[k + 1] * ca + w[k + 2] * sa
    e3 = w[k + 2] * ca - w[k + 1] * sa
    across = e2 * cg - e1 * sg
    return (
        across * w[k + 4] + e3 * w[k + 5],
        e3 * w[k + 4] - across * w[k + 5],
        (e1 * cg + e2 * sg) * w[k + 3] - goal,
    )


def sp_set(w, ca, sa, cg, sg, cb, sb):  # type: ignore[no-untyped-def]
    """Set the state to D Rx(a) Rz(g) Rx(b) S^T."""
    # M = Rx(a) Rz(g) Rx(b)
    m11, m12, m13 = cg, -sg * cb, sg * sb
    m21, m22, m23 = ca * sg, ca * cg * cb - sa * sb, -ca * cg * sb - sa * cb
    m31, m32, m33 = sa * sg, sa * cg * cb + ca * sb, ca * cb - sa * cg * sb
    d = sp_FRAMES
    s = sp_FRAMES + 9
    r = sp_STATE + 7
    for i in range(3):
        n1 = w[d + i] * m11 + w[d + 3 + i] * m21 + w[d + 6 + i] * m31
        n2 = w[d + i] * m12 + w[d + 3 + i] * m22 + w[d + 6 + i] * m32
        n3 = w[d + i] * m13 + w[d + 3 + i] * m23 + w[d + 6 + i] * m33
        for j in range(3):
            w[r + 3 * i + j] = n1 * w[s + j] + n2 * w[s + 3 + j] + n3 * w[s + 6 + j]
    r11, r12, r13, r21, r22, r23 = w[r], w[r + 1], w[r + 2], w[r + 3], w[r + 4], w[r + 5]
    r31, r32, r33 = w[r + 6], w[r + 7], w[r + 8]
    # The quaternion from its largest component.
    trace = r11 + r22 + r33
    if trace >= r11 and trace >= r22 and trace >= r33:
        q0, q1, q2, q3 = 1.0 + trace, r32 - r23, r13 - r31, r21 - r12
    elif r11 >= r22 and r11 >= r33:
        q0, q1, q2, q3 = r32 - r23, 1.0 + r11 - r22 - r33, r12 + r21, r13 + r31
    elif r22 >= r33:
        q0, q1, q2, q3 = r13 - r31, r12 + r21, 1.0 - r11 + r22 - r33, r23 + r32
    else:
        q0, q1, q2, q3 = r21 - r12, r13 + r31, r23 + r32, 1.0 - r11 - r22 + r33
    unit = 1.0 / math.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    w[sp_STATE] = q0 * unit
    w[sp_STATE + 1] = q1 * unit
    w[sp_STATE + 2] = q2 * unit
    w[sp_STATE + 3] = q3 * unit


def sp_starts(w, count, i, j, ca, sa, cg, sg):  # type: ignore[no-untyped-def]
    """Seek solutions from both b that one limb left allows at an angle a; return how many."""
    a1, b1, c1 = sp_linear(w, 0, ca, sa, cg, sg, w[sp_SYSTEM + 7 * i + 6])
    a2, b2, c2 = sp_linear(w, 1, ca, sa, cg, sg, w[sp_SYSTEM + 7 * j + 6])
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
            sp_set(w, ca, sa, cg, sg, cb / turn, sb / turn)
            count = sp_keep(w, count)
    return count


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
    l4 = joints[3]
    # Over the longest of everything: lengths of any unit are alike.
    size = abs(l4)
    for i in range(3):
        if joints[i] < 0.0:
            return 0, True
        size = joints[i] if joints[i] > size else size
    for i in range(15):
        size = abs(constants[i]) if abs(constants[i]) > size else size
    flattest = 2.0
    first = 0
    for i in range(3):
        k = sp_SYSTEM + 7 * i
        dx = constants[3 * i] / size
        dy = constants[3 * i + 1] / size
        dz = constants[3 * i + 2] / size
        sx = constants[9 + 2 * i] / size
        sy = constants[10 + 2 * i] / size
        sz = l4 / size
        d = math.sqrt(dx * dx + dy * dy + dz * dz)
        s = math.sqrt(sx * sx + sy * sy + sz * sz)
        length = joints[i] / size
        # (s^2 + d^2 - l^2) / 2 without the digits that squares lose where d is small.
        goal = (d * d + (s - length) * (s + length)) / (2.0 * d * s)
        w[k], w[k + 1], w[k + 2] = dx / d, dy / d, dz / d
        w[k + 3], w[k + 4], w[k + 5] = sx / s, sy / s, sz / s
        w[k + 6] = goal
        if abs(goal) < flattest:
            flattest = abs(goal)
            first = i
        if abs(goal) > 1.0 + 16.0 * EPS:
            return 0, True
    # The limb furthest from stretched and folded goes first.
    i = 1 if first == 0 else 0
    j = 1 if first == 2 else 2
    k = sp_SYSTEM + 7 * first
    sp_frame(w, sp_FRAMES, w[k], w[k + 1], w[k + 2])
    sp_frame(w, sp_FRAMES + 9, w[k + 3], w[k + 4], w[k + 5])
    for side in range(2):
        other = sp_SYSTEM + 7 * (i if side == 0 else j)
        for axis in range(3):
            total = 0.0
            also = 0.0
            for m in range(3):
                total += w[sp_FRAMES + 3 * axis + m] * w[other + m]
                also += w[sp_FRAMES + 9 + 3 * axis + m] * w[other + 3 + m]
            w[sp_TURNED + 6 * side + axis] = total
            w[sp_TURNED + 6 * side + 3 + axis] = also
    cg = w[k + 6]
    cg = 1.0 if cg > 1.0 else (-1.0 if cg < -1.0 else cg)
    sg = math.sqrt((1.0 - cg) * (1.0 + cg))
    values = w[sp_VALUES : sp_VALUES + 9]
    roots = w[sp_ROOTS : sp_ROOTS + 2 * octic_MOST]
    stack = w[sp_STACK : sp_STACK + 11 * octic_DEPTH]
    count = 0
    bound = 0
    phase_s, phase_c = sin_cos(sp_PHASE)
    for _ in range(2):
        largest = 0.0
        for m in range(9):
            t = constants[18 + m]
            weight = 1.0 + t * t
            c = (1.0 - t * t) / weight
            s = 2.0 * t / weight
            ca = c * phase_c - s * phase_s
            sa = s * phase_c + c * phase_s
            a1, b1, c1 = sp_linear(w, 0, ca, sa, cg, sg, w[sp_SYSTEM + 7 * i + 6])
            a2, b2, c2 = sp_linear(w, 1, ca, sa, cg, sg, w[sp_SYSTEM + 7 * j + 6])
            det = a1 * b2 - b1 * a2
            cosine = b1 * c2 - c1 * b2
            sine = c1 * a2 - a1 * c2
            weight *= weight
            weight *= weight
            values[m] = (cosine * cosine + sine * sine - det * det) * weight
            largest = abs(values[m]) if abs(values[m]) > largest else largest
        # A, B, C are of size 2 at most, each with an error of a few units in the last place.
        error = 1e-13
        matrix = constants[27:109]
        if largest > error:
            some, most = octic_roots(values, error, matrix, stack, roots)
            bound += most
            for m in range(some):
                around = 3 if roots[2 * m + 1] > 0.0 else 1
                for side in range(around):
                    shift = (
                        roots[2 * m + 1] if side == 1 else (-roots[2 * m + 1] if side == 2 else 0.0)
                    )
                    t = roots[2 * m] + shift
                    weight = 1.0 + t * t
                    c = (1.0 - t * t) / weight
                    s = 2.0 * t / weight
                    ca = c * phase_c - s * phase_s
                    sa = s * phase_c + c * phase_s
                    count = sp_starts(w, count, i, j, ca, sa, cg, sg)
        else:
            # The equations say nothing about a: as far as Newton's method finds modes.
            bound = 99
            for m in range(9):
                t = constants[18 + m]
                weight = 1.0 + t * t
                c = (1.0 - t * t) / weight
                s = 2.0 * t / weight
                ca = c * phase_c - s * phase_s
                sa = s * phase_c + c * phase_s
                count = sp_starts(w, count, i, j, ca, sa, cg, sg)
        phase_s = -phase_s
        phase_c = -phase_c
    m = 0
    while m < count:
        if sp_twin(w, m):
            count = sp_keep(w, count)
        m += 1
    for m in range(count):
        r = sp_turned(w, sp_FOUND + sp_KEPT * m)
        phi, theta, psi = assembly_angles(r)
        found[m, 0] = phi
        found[m, 1] = theta
        found[m, 2] = psi
        found[m, 3] = l4
        worst = 0.0
        for n in range(3):
            ex = constants[9 + 2 * n]
            ey = constants[10 + 2 * n]
            x = r[0] * ex + r[1] * ey + r[2] * l4 - constants[3 * n]
            y = r[3] * ex + r[4] * ey + r[5] * l4 - constants[3 * n + 1]
            z = r[6] * ex + r[7] * ey + r[8] * l4 - constants[3 * n + 2]
            miss = abs(math.sqrt(x * x + y * y + z * z) - joints[n])
            worst = miss if miss > worst else worst
        found[m, 4] = worst
        away = 0.0
        for n in range(3):
            gap = found[m, n] - constants[15 + n]
            gap -= 6.283185307179586 * math.floor(gap / 6.283185307179586 + 0.5)
            away += gap * gap
        found[m, 5] = away
    assembly_sort(found, count, 6)
    return count, bound <= count

"""Motion and inverse dynamics of a mechanism of limbs, from the axes of its joints alone.

Everything is in the base frame and SI units, twists (omega, velocity of the point at the origin)
and wrenches (moment about the origin, force). A joint's freedoms are columns S of twists; S' is
their derivative. With J_i the columns of limb i, V and A the platform's twist and its derivative::

    J_i q_i' = V,   J_i q_i'' + J_i' q_i' = A                       (every limb)

A QR decomposition of J_i gives the wrenches W_i that the limb cannot move against, W_i V = 0, and
its joints' rates, q_i' = J_i^+ V. With rows E of what the pose coordinates are (E V = X')::

    [W_1; W_2; ..; E] V = [0; X'],   [W_1; ..; E] A = [W_i J_i' q_i'; X'' - E' V]

a system of full rank wherever the pose moves the platform; rows that say the same twice
(overconstrained mechanisms) do no harm to its least-squares solution. The columns of its inverse
are the platform's twists by pose coordinates (a natural orthogonal complement), and the
virtual work of all inertia and gravity on them is the generalised force::

    Q = sum_bodies (dV_b/dX')^T F_b,   (dq_a/dX')^T effort = Q

The functions are plain Python; :func:`pmopt.compiler.programs.moving` compiles them with a
mechanism's ``posture``.
"""

import math
from typing import Annotated, Any, NamedTuple

from pmopt.kernels.trigonometry import arc_tangent

#: Kinds of joints, as numbers of a joint table.
REVOLUTE, PRISMATIC, CYLINDRICAL, UNIVERSAL, SPHERICAL, PARALLELOGRAM = range(6)
#: Parts of bodies.
LINK, BARS = range(2)
#: Roles of pose coordinates: 0..2 position, 3..5 yaw, pitch, roll; from here on a joint's column.
COLUMN = 6
#: A diagonal element of R this much smaller than the largest counts as 0.
RANK = 1e-11


#: Types of what an entry takes.
Number = Annotated[Any, "float64"]
Whole = Annotated[Any, "int64"]
Row = Annotated[Any, "float64[:]"]
Table = Annotated[Any, "float64[:,:]"]
Cube = Annotated[Any, "float64[:,:,:]"]
Numbers = Annotated[Any, "int64[:]"]
Numbering = Annotated[Any, "int64[:,:]"]
Flags = Annotated[Any, "uint8[:]"]


class Motion(NamedTuple):
    """Instants: poses in the mechanism's unit, their rates in m and rad, (N, n) each."""

    poses: Table
    speeds: Table
    accelerations: Table


class Model(NamedTuple):
    """A design.

    Attributes
    ----------
    constants : (c,)
        What ``posture`` takes.
    unit : float
        The mechanism's length unit in m.
    gravity : (3,)
        m/s^2.
    joints : (J, 6) int
        Limb, kind, place in the stance, first column, number of columns, next joint of the limb
        or -1.
    limbs : (L, 5) int
        First joint, number of joints, first column, number of columns, first row of ``twists``.
    roles, drives : (n,) int
        Of pose coordinates, and columns of the actuated joints.
    bodies : (B, 2) int
        Joint (-1: the platform) and part.
    masses : (B, 13)
        Mass (kg), centre in the link's frame (m), inertia about it (kg m^2).
    with_mass_matrix : int
    """

    constants: Row
    unit: Number
    gravity: Row
    joints: Numbering
    limbs: Numbering
    roles: Numbers
    drives: Numbers
    bodies: Numbering
    masses: Table
    with_mass_matrix: Whole


class Results(NamedTuple):
    """What is computed, in SI units.

    Attributes
    ----------
    stances : (N, s)
        What ``posture`` returns: place of the platform, reported joints, then of every joint its
        point, axes and, for a parallelogram, the bar.
    platform : (N, 3, 6)
        Values, rates, accelerations of x, y, z (m), yaw, pitch, roll.
    rates : (N, K, 2)
        First and second derivatives of all joints' freedoms (m, rad).
    efforts : (N, n)
        N, N m.
    energies : (N, 2)
        Kinetic and potential, J.
    centres : (N, B, 9)
        Position, velocity, acceleration of centres of mass (m).
    mass_matrix, inverse_jacobian : (N, n, n)
        By pose coordinates in m and rad; d(actuated joints)/d(pose).
    valid : (N,) uint8
        0 where the limbs or the pose coordinates do not tell the motion.
    """

    stances: Table
    platform: Cube
    rates: Cube
    efforts: Table
    energies: Table
    centres: Cube
    mass_matrix: Cube
    inverse_jacobian: Cube
    valid: Flags


class Scratch(NamedTuple):
    """Overwritten.

    Rows of ``changes`` are J' q' of each limb, the platform's twist and its derivative, and one
    for links.
    """

    screws: Table
    derivatives: Table
    turned: Cube
    twists: Table
    changes: Table
    inverses: Table
    qt: Table
    r: Table
    square: Table
    rows: Table
    pseudo: Table
    right: Row
    by_pose: Table
    frames: Table
    partials: Cube
    tensors: Table
    small: Row


#: What :func:`move` takes, in order.
RECORDS = (Motion, Model, Results, Scratch)


class Instant(NamedTuple):
    """Rows of :class:`Results` at one instant, the generalised force and room for a body."""

    stance: Row
    rates: Table
    centres: Table
    mass_matrix: Table
    force: Row
    tensors: Table


def moved(twist, column, out):
    """Write the derivative of a column that is carried by a body with a twist."""
    w0, w1, w2, v0, v1, v2 = twist[0], twist[1], twist[2], twist[3], twist[4], twist[5]
    a0, a1, a2, b0, b1, b2 = column[0], column[1], column[2], column[3], column[4], column[5]
    out[0] = w1 * a2 - w2 * a1
    out[1] = w2 * a0 - w0 * a2
    out[2] = w0 * a1 - w1 * a0
    out[3] = w1 * b2 - w2 * b1 + v1 * a2 - v2 * a1
    out[4] = w2 * b0 - w0 * b2 + v2 * a0 - v0 * a2
    out[5] = w0 * b1 - w1 * b0 + v0 * a1 - v1 * a0


def decompose(a, m, k, qt, r):
    """Write Q^T (m, m) and R (k, k) of a (m, k), which is overwritten, by Householder reflections.

    Returns whether the columns are independent.
    """
    for i in range(m):
        for j in range(m):
            qt[i, j] = 1.0 if i == j else 0.0
    largest = 0.0
    smallest = math.inf
    for c in range(k):
        square = 0.0
        for i in range(c, m):
            square += a[i, c] * a[i, c]
        norm = math.sqrt(square)
        sign = 1.0 if a[c, c] >= 0.0 else -1.0
        if norm > 0.0 and c < m - 1:
            a[c, c] += sign * norm
            size = 0.0
            for i in range(c, m):
                size += a[i, c] * a[i, c]
            for j in range(c + 1, k):
                dot = 0.0
                for i in range(c, m):
                    dot += a[i, c] * a[i, j]
                dot *= 2.0 / size
                for i in range(c, m):
                    a[i, j] -= dot * a[i, c]
            for j in range(m):
                dot = 0.0
                for i in range(c, m):
                    dot += a[i, c] * qt[i, j]
                dot *= 2.0 / size
                for i in range(c, m):
                    qt[i, j] -= dot * a[i, c]
            r[c, c] = -sign * norm
        else:
            r[c, c] = a[c, c]
        for j in range(c + 1, k):
            r[c, j] = a[c, j]
        norm = abs(r[c, c])
        largest = norm if norm > largest else largest
        smallest = norm if norm < smallest else smallest
    return smallest > RANK * largest


def back_substitute(r, k, x):
    """Solve R x = x in place."""
    for i in range(k - 1, -1, -1):
        value = x[i]
        for j in range(i + 1, k):
            value -= r[i, j] * x[j]
        x[i] = value / r[i, i]


def eliminate(a, b, n):
    """Solve a x = b in place, with pivots; return the determinant."""
    determinant = 1.0
    for c in range(n):
        best = c
        for i in range(c + 1, n):
            best = i if abs(a[i, c]) > abs(a[best, c]) else best
        if best != c:
            for j in range(n):
                kept = a[c, j]
                a[c, j] = a[best, j]
                a[best, j] = kept
            kept = b[c]
            b[c] = b[best]
            b[best] = kept
            determinant = -determinant
        determinant *= a[c, c]
        for i in range(c + 1, n):
            share = a[i, c] / a[c, c]
            for j in range(c + 1, n):
                a[i, j] -= share * a[c, j]
            b[i] -= share * b[c]
    for i in range(n - 1, -1, -1):
        value = b[i]
        for j in range(i + 1, n):
            value -= a[i, j] * b[j]
        b[i] = value / a[i, i]
    return determinant


def write_axes(x0, x1, x2, z0, z1, z2, frame):
    """Write the rotation whose first and last columns are given, both unit and perpendicular."""
    frame[3] = x0
    frame[4] = z1 * x2 - z2 * x1
    frame[5] = z0
    frame[6] = x1
    frame[7] = z2 * x0 - z0 * x2
    frame[8] = z1
    frame[9] = x2
    frame[10] = z0 * x1 - z1 * x0
    frame[11] = z2


def link_frame(stance, joints, j, unit, before, frame):
    """Write origin and axes (rows of 3) of the link after joint j; see pmopt.mechanisms.bodies.

    ``before`` is the frame of the link before. The axes are the columns of a rotation; frame[3:12]
    is that rotation row by row.
    """
    kind = joints[j, 1]
    after = joints[j, 5]
    for k in range(12):
        frame[k] = before[k]
    if after < 0:
        for k in range(3):
            frame[k] = stance[k] * unit
        for k in range(9):
            frame[3 + k] = stance[3 + k]
        return
    own = joints[j, 2]
    following = joints[after, 2]
    origin = own if kind in (REVOLUTE, UNIVERSAL, SPHERICAL) else following
    for k in range(3):
        frame[k] = stance[origin + k] * unit
        if kind == PARALLELOGRAM:
            frame[k] = (stance[own + k] + stance[own + 6 + k]) * unit
    if kind in (PRISMATIC, PARALLELOGRAM):
        return
    z = frame[3:6]
    x = frame[6:9]
    if kind == CYLINDRICAL:
        for k in range(3):
            z[k] = stance[own + 3 + k]
            x[k] = stance[following + 3 + k]
    else:
        for k in range(3):
            if joints[after, 1] == PRISMATIC:
                z[k] = stance[following + 3 + k]
            else:
                z[k] = stance[following + k] - stance[own + k]
            if kind == SPHERICAL:
                x[k] = stance[3 + 3 * k]
            else:
                x[k] = stance[own + (6 if kind == UNIVERSAL else 3) + k]
    size = 1.0 / math.sqrt(z[0] * z[0] + z[1] * z[1] + z[2] * z[2])
    z0 = z[0] * size
    z1 = z[1] * size
    z2 = z[2] * size
    along = x[0] * z0 + x[1] * z1 + x[2] * z2
    x0 = x[0] - along * z0
    x1 = x[1] - along * z1
    x2 = x[2] - along * z2
    size = 1.0 / math.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
    x0 *= size
    x1 *= size
    x2 *= size
    write_axes(x0, x1, x2, z0, z1, z2, frame)


def bar_frame(stance, joints, j, unit, frame):
    """Write the frame of the long bars of parallelogram j: z along them, x along the axis."""
    own = joints[j, 2]
    x0, x1, x2 = stance[own + 3], stance[own + 4], stance[own + 5]
    z0, z1, z2 = stance[own + 6], stance[own + 7], stance[own + 8]
    size = 1.0 / math.sqrt(z0 * z0 + z1 * z1 + z2 * z2)
    z0 *= size
    z1 *= size
    z2 *= size
    for k in range(3):
        frame[k] = stance[own + k] * unit
    write_axes(x0, x1, x2, z0, z1, z2, frame)


def columns_of(stance, joints, unit, screws):
    """Write the column of every freedom; a spherical joint's axes are those of the base."""
    for j in range(joints.shape[0]):
        kind = joints[j, 1]
        own = joints[j, 2]
        c = joints[j, 3]
        px = stance[own] * unit
        py = stance[own + 1] * unit
        pz = stance[own + 2] * unit
        for k in range(joints[j, 4]):
            s = screws[c + k]
            if kind == SPHERICAL:
                ax = 1.0 if k == 0 else 0.0
                ay = 1.0 if k == 1 else 0.0
                az = 1.0 if k == 2 else 0.0
            else:
                at = own + 3 + (3 * k if kind == UNIVERSAL else 0)
                ax, ay, az = stance[at], stance[at + 1], stance[at + 2]
            if kind == PRISMATIC or (kind == CYLINDRICAL and k == 1):
                s[0] = s[1] = s[2] = 0.0
                s[3] = ax
                s[4] = ay
                s[5] = az
            elif kind == PARALLELOGRAM:
                bx, by, bz = stance[own + 6] * unit, stance[own + 7] * unit, stance[own + 8] * unit
                s[0] = s[1] = s[2] = 0.0
                s[3] = ay * bz - az * by
                s[4] = az * bx - ax * bz
                s[5] = ax * by - ay * bx
            else:
                s[0] = ax
                s[1] = ay
                s[2] = az
                s[3] = py * az - pz * ay
                s[4] = pz * ax - px * az
                s[5] = px * ay - py * ax


def column_rates(at, limb, model, scratch):
    """Write each column's derivative times its rate, and the twist after each column.

    ``twists[c + 1]`` is the twist after column c of a limb, ``twists`` of its first column's place
    that before. ``turned`` keeps, for parallelograms, the column of the long bars and its
    derivative times the rate.
    """
    stance, rates = at.stance, at.rates
    joints, unit = model.joints, model.unit
    screws, twists = scratch.screws, scratch.twists
    derivatives, turned = scratch.derivatives, scratch.turned
    first, count = limb[0], limb[1]
    place = limb[4]
    for k in range(6):
        twists[place, k] = 0.0
    for j in range(first, first + count):
        kind = joints[j, 1]
        own = joints[j, 2]
        start = joints[j, 3]
        if kind == SPHERICAL:
            # Axes of the base: only the point moves, with the body before.
            v = twists[place]
            px, py, pz = stance[own] * unit, stance[own + 1] * unit, stance[own + 2] * unit
            vx = v[3] + v[1] * pz - v[2] * py
            vy = v[4] + v[2] * px - v[0] * pz
            vz = v[5] + v[0] * py - v[1] * px
            for k in range(3):
                rate = rates[start + k, 0]
                d = derivatives[start + k]
                d[0] = d[1] = d[2] = 0.0
                ax = 1.0 if k == 0 else 0.0
                ay = 1.0 if k == 1 else 0.0
                az = 1.0 if k == 2 else 0.0
                d[3] = (vy * az - vz * ay) * rate
                d[4] = (vz * ax - vx * az) * rate
                d[5] = (vx * ay - vy * ax) * rate
        elif kind == PARALLELOGRAM:
            rate = rates[start, 0]
            v = twists[place]
            wx, wy, wz = v[0], v[1], v[2]
            ax, ay, az = stance[own + 3], stance[own + 4], stance[own + 5]
            bx, by, bz = stance[own + 6] * unit, stance[own + 7] * unit, stance[own + 8] * unit
            ux, uy, uz = wx + rate * ax, wy + rate * ay, wz + rate * az
            dx, dy, dz = uy * bz - uz * by, uz * bx - ux * bz, ux * by - uy * bx
            ex, ey, ez = wy * az - wz * ay, wz * ax - wx * az, wx * ay - wy * ax
            d = derivatives[start]
            d[0] = d[1] = d[2] = 0.0
            d[3] = (ey * bz - ez * by + ay * dz - az * dy) * rate
            d[4] = (ez * bx - ex * bz + az * dx - ax * dz) * rate
            d[5] = (ex * by - ey * bx + ax * dy - ay * dx) * rate
            s = turned[start, 0]
            px, py, pz = stance[own] * unit, stance[own + 1] * unit, stance[own + 2] * unit
            s[0] = ax
            s[1] = ay
            s[2] = az
            s[3] = py * az - pz * ay
            s[4] = pz * ax - px * az
            s[5] = px * ay - py * ax
            moved(v, s, turned[start, 1])
            for k in range(6):
                turned[start, 1, k] *= rate
        for k in range(joints[j, 4]):
            c = start + k
            if kind != SPHERICAL and kind != PARALLELOGRAM:
                moved(twists[place], screws[c], derivatives[c])
                for e in range(6):
                    derivatives[c, e] *= rates[c, 0]
            for e in range(6):
                twists[place + 1, e] = twists[place, e] + screws[c, e] * rates[c, 0]
            place += 1


def pose_rows(stance, roles, unit, inverses, rows, first):
    """Write the rows E of the pose coordinates on the platform's twist.

    Position along k is [P x e_k; e_k]; yaw, pitch and roll of Rz Ry Rx are the rows that turn the
    angular velocity into their rates; a joint's column is its row of J^+.
    """
    px, py, pz = stance[0] * unit, stance[1] * unit, stance[2] * unit
    # Rot's first column is (cos a cos b, sin a cos b, -sin b).
    cb = math.sqrt(stance[3] * stance[3] + stance[6] * stance[6])
    sb = -stance[9]
    ca = stance[3] / cb
    sa = stance[6] / cb
    for i in range(roles.shape[0]):
        row = rows[first + i]
        for k in range(6):
            row[k] = 0.0
        role = roles[i]
        if role < 3:
            row[3 + role] = 1.0
            if role == 0:
                row[1] = pz
                row[2] = -py
            elif role == 1:
                row[0] = -pz
                row[2] = px
            else:
                row[0] = py
                row[1] = -px
        elif role == 3:
            row[0] = ca * sb / cb
            row[1] = sa * sb / cb
            row[2] = 1.0
        elif role == 4:
            row[0] = -sa
            row[1] = ca
        elif role == 5:
            row[0] = ca / cb
            row[1] = sa / cb
        else:
            c = role - COLUMN
            for k in range(6):
                row[k] = inverses[c, k]


def euler(stance, twist, angles, rates):
    """Write yaw, pitch, roll and their rates to the last three of six numbers."""
    cb = math.sqrt(stance[3] * stance[3] + stance[6] * stance[6])
    ca = stance[3] / cb
    sa = stance[6] / cb
    sb = -stance[9]
    angles[3] = arc_tangent(stance[6], stance[3])
    angles[4] = arc_tangent(sb, cb)
    angles[5] = arc_tangent(stance[10], stance[11])
    rates[5] = (ca * twist[0] + sa * twist[1]) / cb
    rates[4] = -sa * twist[0] + ca * twist[1]
    rates[3] = twist[2] + sb * rates[5]


def euler_bias(stance, rates, out):
    """Write H' e' of omega = H e' for e = (yaw, pitch, roll)."""
    cb = math.sqrt(stance[3] * stance[3] + stance[6] * stance[6])
    ca = stance[3] / cb
    sa = stance[6] / cb
    sb = -stance[9]
    # (yaw' z) x (pitch' y1) + (yaw' z + pitch' y1) x (roll' x2)
    a, b, c = rates[3], rates[4], rates[5]
    ux, uy, uz = -b * sa, b * ca, a
    vx, vy, vz = c * ca * cb, c * sa * cb, -c * sb
    out[0] = -a * b * ca + uy * vz - uz * vy
    out[1] = -a * b * sa + uz * vx - ux * vz
    out[2] = ux * vy - uy * vx


def dot6(a, b):
    """Return the scalar product of two rows of six numbers."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5]


def momentum(mass, centre, inertia, twist, out):
    """Write the moment of momentum about the origin and the momentum of a body with a twist."""
    w0, w1, w2 = twist[0], twist[1], twist[2]
    c0, c1, c2 = centre[0], centre[1], centre[2]
    p0 = mass * (twist[3] + w1 * c2 - w2 * c1)
    p1 = mass * (twist[4] + w2 * c0 - w0 * c2)
    p2 = mass * (twist[5] + w0 * c1 - w1 * c0)
    out[0] = inertia[0] * w0 + inertia[1] * w1 + inertia[2] * w2 + c1 * p2 - c2 * p1
    out[1] = inertia[3] * w0 + inertia[4] * w1 + inertia[5] * w2 + c2 * p0 - c0 * p2
    out[2] = inertia[6] * w0 + inertia[7] * w1 + inertia[8] * w2 + c0 * p1 - c1 * p0
    out[3] = p0
    out[4] = p1
    out[5] = p2


def place_body(frame, body, centre, inertia):
    """Write centre and inertia (9) of a body, along the base's axes, from its link's frame."""
    for i in range(3):
        centre[i] = (
            frame[i] + frame[3 + 3 * i] * body[1] + frame[4 + 3 * i] * body[2]
            + frame[5 + 3 * i] * body[3]
        )  # fmt: skip
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                part = 0.0
                for e in range(3):
                    part += body[4 + 3 * k + e] * frame[3 + 3 * j + e]
                total += frame[3 + 3 * i + k] * part
            inertia[3 * i + j] = total


def wrench_of(mass, centre, inertia, twist, change, gravity, out, motion):
    """Write what a body's inertia and weight ask for, and its centre's velocity and acceleration.

    Returns its kinetic energy.
    """
    w0, w1, w2 = twist[0], twist[1], twist[2]
    a0, a1, a2 = change[0], change[1], change[2]
    c0, c1, c2 = centre[0], centre[1], centre[2]
    v0 = twist[3] + w1 * c2 - w2 * c1
    v1 = twist[4] + w2 * c0 - w0 * c2
    v2 = twist[5] + w0 * c1 - w1 * c0
    b0 = change[3] + a1 * c2 - a2 * c1 + w1 * v2 - w2 * v1
    b1 = change[4] + a2 * c0 - a0 * c2 + w2 * v0 - w0 * v2
    b2 = change[5] + a0 * c1 - a1 * c0 + w0 * v1 - w1 * v0
    h0 = inertia[0] * w0 + inertia[1] * w1 + inertia[2] * w2
    h1 = inertia[3] * w0 + inertia[4] * w1 + inertia[5] * w2
    h2 = inertia[6] * w0 + inertia[7] * w1 + inertia[8] * w2
    n0 = inertia[0] * a0 + inertia[1] * a1 + inertia[2] * a2 + w1 * h2 - w2 * h1
    n1 = inertia[3] * a0 + inertia[4] * a1 + inertia[5] * a2 + w2 * h0 - w0 * h2
    n2 = inertia[6] * a0 + inertia[7] * a1 + inertia[8] * a2 + w0 * h1 - w1 * h0
    f0 = mass * (b0 - gravity[0])
    f1 = mass * (b1 - gravity[1])
    f2 = mass * (b2 - gravity[2])
    out[0] = n0 + c1 * f2 - c2 * f1
    out[1] = n1 + c2 * f0 - c0 * f2
    out[2] = n2 + c0 * f1 - c1 * f0
    out[3] = f0
    out[4] = f1
    out[5] = f2
    motion[0] = v0
    motion[1] = v1
    motion[2] = v2
    motion[3] = b0
    motion[4] = b1
    motion[5] = b2
    return 0.5 * (mass * (v0 * v0 + v1 * v1 + v2 * v2) + w0 * h0 + w1 * h1 + w2 * h2)


def add_body(b, frame, twist, change, partial, model, at):
    """Add a body's generalised force and mass matrix; return its kinetic and potential energy.

    Of its link: frame, twist, that one's derivative, and its twists by pose coordinates, (n, 6).
    """
    mass, gravity = model.masses[b], model.gravity
    told, matrix, force, tensors = at.centres[b], at.mass_matrix, at.force, at.tensors
    n = partial.shape[0]
    centre = tensors[0]
    inertia = tensors[1]
    wrench = tensors[2]
    motion = tensors[3]
    place_body(frame, mass, centre, inertia)
    kinetic = wrench_of(mass[0], centre, inertia, twist, change, gravity, wrench, motion)
    for k in range(3):
        told[k] = centre[k]
    for k in range(6):
        told[3 + k] = motion[k]
    for i in range(n):
        force[i] += dot6(partial[i], wrench)
    if model.with_mass_matrix:
        for i in range(n):
            momentum(mass[0], centre, inertia, partial[i], wrench)
            for j in range(n):
                matrix[i, j] += dot6(partial[j], wrench)
    potential = gravity[0] * centre[0] + gravity[1] * centre[1] + gravity[2] * centre[2]
    return kinetic, -mass[0] * potential


def decompose_limbs(limbs, scratch):
    """Write J^+ of every limb, column by column, and its wrenches to rows; return how many.

    With it whether no limb's joints are dependent.
    """
    screws, inverses, rows = scratch.screws, scratch.inverses, scratch.rows
    square, qt, r, small = scratch.square, scratch.qt, scratch.r, scratch.small
    good = True
    m = 0
    for i in range(limbs.shape[0]):
        first, count = limbs[i, 2], limbs[i, 3]
        for c in range(count):
            for k in range(6):
                square[k, c] = screws[first + c, k]
        good = decompose(square, 6, count, qt, r) and good
        for k in range(6):
            for c in range(count):
                small[c] = qt[c, k]
            back_substitute(r, count, small)
            for c in range(count):
                inverses[first + c, k] = small[c]
        for e in range(count, 6):
            for k in range(6):
                rows[m, k] = qt[e, k]
            m += 1
    return m, good


def add_limb(at, limb, model, scratch):
    """Add the bodies of a limb; return their kinetic and potential energy."""
    stance, rates = at.stance, at.rates
    joints, unit, bodies = model.joints, model.unit, model.bodies
    screws, derivatives, turned = scratch.screws, scratch.derivatives, scratch.turned
    twists, by_pose, tensors = scratch.twists, scratch.by_pose, scratch.tensors
    frames, partials = scratch.frames, scratch.partials
    change = scratch.changes[model.limbs.shape[0] + 2]
    n = by_pose.shape[1]
    frame, following, bars = frames[0], frames[1], frames[2]
    partial, of_bars = partials[0], partials[1]
    for k in range(12):
        frame[k] = 1.0 if k == 3 or k == 7 or k == 11 else 0.0
    for k in range(6):
        change[k] = 0.0
        for i in range(n):
            partial[i, k] = 0.0
    place = limb[4]
    kinetic = 0.0
    potential = 0.0
    for j in range(limb[0], limb[0] + limb[1]):
        start = joints[j, 3]
        if joints[j, 1] == PARALLELOGRAM:
            bar_frame(stance, joints, j, unit, bars)
            column = turned[start, 0]
            for k in range(6):
                tensors[4, k] = twists[place, k] + column[k] * rates[start, 0]
                tensors[5, k] = change[k] + column[k] * rates[start, 1] + turned[start, 1, k]
                for i in range(n):
                    of_bars[i, k] = partial[i, k] + column[k] * by_pose[start, i]
            for b in range(bodies.shape[0]):
                if bodies[b, 0] == j and bodies[b, 1] == BARS:
                    energy = add_body(b, bars, tensors[4], tensors[5], of_bars, model, at)
                    kinetic += energy[0]
                    potential += energy[1]
        for c in range(start, start + joints[j, 4]):
            for k in range(6):
                change[k] += screws[c, k] * rates[c, 1] + derivatives[c, k]
                for i in range(n):
                    partial[i, k] += screws[c, k] * by_pose[c, i]
            place += 1
        link_frame(stance, joints, j, unit, frame, following)
        for k in range(12):
            frame[k] = following[k]
        for b in range(bodies.shape[0]):
            if bodies[b, 0] == j and bodies[b, 1] == LINK:
                energy = add_body(b, frame, twists[place], change, partial, model, at)
                kinetic += energy[0]
                potential += energy[1]
    return kinetic, potential


def move(motion, model, results, scratch, posture_to):
    """Compute the motion and the efforts at some instants.

    ``posture_to(poses, t, constants, out)`` writes what the mechanism's posture returns at instant
    t; it is compiled by itself, and all else once for all mechanisms.
    """
    poses, speeds, accelerations = motion
    unit, joints, limbs = model.unit, model.joints, model.limbs
    roles, drives, bodies = model.roles, model.drives, model.bodies
    rates, mass_matrix = results.rates, results.mass_matrix
    inverse_jacobian = results.inverse_jacobian
    screws, derivatives, tensors = scratch.screws, scratch.derivatives, scratch.tensors
    changes, inverses, rows, right = scratch.changes, scratch.inverses, scratch.rows, scratch.right
    qt, r, square, pseudo = scratch.qt, scratch.r, scratch.square, scratch.pseudo
    by_pose, frames, partials = scratch.by_pose, scratch.frames, scratch.partials
    small = scratch.small
    n = poses.shape[1]
    count = limbs.shape[0]
    v = changes[count]
    a = changes[count + 1]
    for t in range(poses.shape[0]):
        stance = results.stances[t]
        at = Instant(stance, rates[t], results.centres[t], mass_matrix[t], right, tensors)
        posture_to(poses, t, model.constants, stance)
        columns_of(stance, joints, unit, screws)
        held, good = decompose_limbs(limbs, scratch)
        pose_rows(stance, roles, unit, inverses, rows, held)
        m = held + n
        for i in range(m):
            for k in range(6):
                square[i, k] = rows[i, k]
        good = decompose(square, m, 6, qt, r) and good
        for i in range(m):
            for k in range(6):
                small[k] = qt[k, i]
            back_substitute(r, 6, small)
            for k in range(6):
                pseudo[k, i] = small[k]

        for k in range(6):
            v[k] = 0.0
            for i in range(n):
                v[k] += pseudo[k, held + i] * speeds[t, i]
        for c in range(screws.shape[0]):
            rates[t, c, 0] = dot6(inverses[c], v)
        m = 0
        for i in range(count):
            column_rates(at, limbs[i], model, scratch)
            bias = changes[i]
            for k in range(6):
                bias[k] = 0.0
                for c in range(limbs[i, 2], limbs[i, 2] + limbs[i, 3]):
                    bias[k] += derivatives[c, k]
            for _ in range(6 - limbs[i, 3]):
                right[m] = dot6(rows[m], bias)
                m += 1
        angles = results.platform[t]
        euler(stance, v, angles[0], angles[1])
        spin = tensors[0]
        euler_bias(stance, angles[1], spin)
        p0, p1, p2 = stance[0] * unit, stance[1] * unit, stance[2] * unit
        u0 = v[3] + v[1] * p2 - v[2] * p1
        u1 = v[4] + v[2] * p0 - v[0] * p2
        u2 = v[5] + v[0] * p1 - v[1] * p0
        turn = tensors[1]  # omega x velocity of the centre
        turn[0] = v[1] * u2 - v[2] * u1
        turn[1] = v[2] * u0 - v[0] * u2
        turn[2] = v[0] * u1 - v[1] * u0
        for i in range(n):
            role = roles[i]
            row = rows[held + i]
            value = accelerations[t, i]
            if role < 3:
                value -= turn[role]
            elif role < COLUMN:
                value += row[0] * spin[0] + row[1] * spin[1] + row[2] * spin[2]
            else:
                value += dot6(row, changes[limb_of(role - COLUMN, limbs)])
            right[held + i] = value
        for k in range(6):
            a[k] = 0.0
            for i in range(held + n):
                a[k] += pseudo[k, i] * right[i]
        angles[0, 0], angles[0, 1], angles[0, 2] = p0, p1, p2
        angles[1, 0], angles[1, 1], angles[1, 2] = u0, u1, u2
        angles[2, 0] = a[3] + a[1] * p2 - a[2] * p1 + turn[0]
        angles[2, 1] = a[4] + a[2] * p0 - a[0] * p2 + turn[1]
        angles[2, 2] = a[5] + a[0] * p1 - a[1] * p0 + turn[2]
        for k in range(3):
            spin[k] = a[k] - spin[k]
        euler(stance, spin, tensors[2], angles[2])
        for i in range(count):
            for c in range(limbs[i, 2], limbs[i, 2] + limbs[i, 3]):
                rates[t, c, 1] = dot6(inverses[c], a) - dot6(inverses[c], changes[i])
        for c in range(screws.shape[0]):
            for i in range(n):
                by_pose[c, i] = 0.0
                for k in range(6):
                    by_pose[c, i] += inverses[c, k] * pseudo[k, held + i]
        for i in range(n):
            right[i] = 0.0
            for j in range(n):
                inverse_jacobian[t, i, j] = by_pose[drives[i], j]
                square[j, i] = by_pose[drives[i], j]
                mass_matrix[t, i, j] = 0.0

        kinetic = 0.0
        potential = 0.0
        for i in range(count):
            energy = add_limb(at, limbs[i], model, scratch)
            kinetic += energy[0]
            potential += energy[1]
        frame = frames[0]
        for k in range(3):
            frame[k] = stance[k] * unit
        for k in range(9):
            frame[3 + k] = stance[3 + k]
        for i in range(n):
            for k in range(6):
                partials[0, i, k] = pseudo[k, held + i]
        for b in range(bodies.shape[0]):
            if bodies[b, 0] < 0:
                energy = add_body(b, frame, v, a, partials[0], model, at)
                kinetic += energy[0]
                potential += energy[1]
        eliminate(square, right, n)
        for i in range(n):
            results.efforts[t, i] = right[i]
        results.energies[t, 0] = kinetic
        results.energies[t, 1] = potential
        results.valid[t] = 1 if good else 0


def limb_of(column, limbs):
    """Return the limb a column belongs to."""
    found = 0
    for i in range(limbs.shape[0]):
        found = i if limbs[i, 2] <= column else found
    return found

"""Forward and inverse kinematics, a row of joint positions or a pose at a time.

A mechanism's ``assemble(joints, constants, found, work)`` is plain Python on floats and arrays; it
writes the assembly modes of one set of joint positions, a row each, and returns how many there are
and whether they are proven to be all. The inverse kinematics, where it is not written out in closed
form, is such a function of a pose. :func:`pmopt.compiler.programs.assembling` compiles them.
"""

import math
from typing import NamedTuple

from pmopt.kernels.trigonometry import arc_tangent
from pmopt.kernels.vectors import Vec3

TINY = 1e-300
#: How far the equations are looked at on both sides of a mode, along its heading.
ASSEMBLY_STEP = 1e-3
#: Distance of a twin up to which it is sought, over the length at which equations bend.
ASSEMBLY_NEAR = 0.15


class Adjugate(NamedTuple):
    """Adjugate of a slope of three equations by three unknowns, and its determinant.

    ``yx`` is row y, column x.
    """

    xx: float
    xy: float
    xz: float
    yx: float
    yy: float
    yz: float
    zx: float
    zy: float
    zz: float
    det: float


class Heading(NamedTuple):
    """Where the equations hardly change at a mode."""

    there: bool
    way: Vec3  # direction that the slope hardly moves
    weights: Vec3  # sum of equations that it hardly reaches
    along: float  # what of that changes by a unit along the way


def assembly_solved(adj, f):  # type: ignore[no-untyped-def]
    """Return the step of Newton's method that equations f call for."""
    unit = -adj.det / (adj.det * adj.det + TINY)
    return Vec3(
        unit * (adj.xx * f.x + adj.xy * f.y + adj.xz * f.z),
        unit * (adj.yx * f.x + adj.yy * f.y + adj.yz * f.z),
        unit * (adj.zx * f.x + adj.zy * f.y + adj.zz * f.z),
    )


def assembly_size(a):  # type: ignore[no-untyped-def]
    """Return a vector's length."""
    return math.sqrt(a.x * a.x + a.y * a.y + a.z * a.z)


def assembly_heading(adj):  # type: ignore[no-untyped-def]
    """Return where the equations hardly change.

    Near a singularity the adjugate tends to a product of the directions that the slope hardly
    moves and that it hardly reaches: its largest column and row.
    """
    best = 0.0
    row = 0
    column = 0
    for i in range(3):
        for j in range(3):
            if abs(adj[3 * i + j]) > best:
                best = abs(adj[3 * i + j])
                row = i
                column = j
    x, y, z = adj[column], adj[3 + column], adj[6 + column]
    size = math.sqrt(x * x + y * y + z * z)
    size = size if best > TINY else 1.0
    way = Vec3(x / size, y / size, z / size)
    weights = Vec3(adj[3 * row], adj[3 * row + 1], adj[3 * row + 2])
    # adj(J) J = det: the row times J is det along axis ``row``.
    return Heading(best > TINY, way, weights, way[row] * adj.det)


def assembly_apart(along, bend):  # type: ignore[no-untyped-def]
    """Return how far along its heading a mode may have a twin, and whether that is near.

    Two modes that meet at a singularity are the zeros of a parabola there. ``bend`` is the sum of
    its heights at ASSEMBLY_STEP on both sides of the mode.
    """
    bend = bend / (ASSEMBLY_STEP * ASSEMBLY_STEP)
    near = abs(along) < ASSEMBLY_NEAR * abs(bend)
    return -2.0 * along / (bend if near else 1.0), near


def assembly_angles(r):  # type: ignore[no-untyped-def]
    """Return a, b, c of Rz(a) Ry(b) Rx(c), b in [-pi/2, pi/2], of a rotation row by row."""
    r11, r12, r13, r21, r22, r23, r31, _, _ = r
    level = math.sqrt(r11 * r11 + r21 * r21)
    ca = r11 / level if level > 0.0 else 1.0
    sa = r21 / level if level > 0.0 else 0.0
    a = arc_tangent(sa, ca)
    b = arc_tangent(0.0 - r31, level)
    # From the rotation with a taken out: exact where b is a quarter turn, too.
    c = arc_tangent(sa * r13 - ca * r23, ca * r22 - sa * r12)
    half = 3.141592653589793
    return a if a > -half else half, b, c if c > -half else half


def assembly_principal(angle):  # type: ignore[no-untyped-def]
    """Return the angle within half a turn of 0."""
    return angle - 6.283185307179586 * math.floor(angle / 6.283185307179586 + 0.5)


def assembly_sort(found, count, columns):  # type: ignore[no-untyped-def]
    """Sort the first rows by their last column, equal ones in their order."""
    for i in range(1, count):
        k = i
        while k > 0 and found[k, columns - 1] < found[k - 1, columns - 1]:
            for c in range(columns):
                value = found[k, c]
                found[k, c] = found[k - 1, c]
                found[k - 1, c] = value
            k -= 1


def assemble_all(joints, constants, found, counts, work):  # type: ignore[no-untyped-def]
    """Call a mechanism's ``assemble_one`` for each row of joint positions.

    Parameters
    ----------
    joints : (N, n)
    constants : (c,)
    found : (N, modes, columns)
    counts : (N, 2) int64
        How many assembly modes, and 1 where they are proven to be all. Joint positions that leave
        the platform free to move have -1.
    work : (w,)
        0 where it begins.
    """
    for i in range(joints.shape[0]):
        count, proven = assemble_one(joints[i], constants, found[i], work)
        counts[i, 0] = count
        counts[i, 1] = 1 if proven else 0


def assemble_one(joints, constants, found, work):  # type: ignore[no-untyped-def]
    """Stand for the mechanism's own function."""
    raise NotImplementedError

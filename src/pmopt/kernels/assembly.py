"""Forward and inverse kinematics, a row of joint positions or a pose at a time.

A mechanism's ``assemble(joints, constants, found, work)`` is plain Python on floats and arrays; it
writes the assembly modes of one set of joint positions, a row each, and returns how many there are
and whether they are proven to be all. The inverse kinematics, where it is not written out in closed
form, is such a function of a pose. :func:`pmopt.compiler.programs.assembling` compiles them.
"""

import math

from pmopt.kernels.trigonometry import arc_tangent


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

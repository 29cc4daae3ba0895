"""Forward kinematics of 2PaUU-PPaP: two circles of radius sqrt(l2^2 - d^2) in the plane y = d.

At most two assembly modes, in closed form (paper, eq. 17).
"""

import math

from pmopt.kernels.assembly import assembly_principal, assembly_sort
from pmopt.kernels.trigonometry import sin_cos

EPS = 2.220446049250313e-16
#: Centres closer than this to each other, over l2, are one: rounding leaves no more of them.
pauu_ONE = 1e-9


def pauu_assemble(joints, constants, found, w):  # type: ignore[no-untyped-def]
    """Write the assembly modes, a row each; return how many, -1 for a circle of them.

    Parameters
    ----------
    joints : (3,)
    constants : (4,)
        m - n, l1, l2, 2c.
    found : (2, 5)
        x, y, z, the largest miss of a link's length, and what they are sorted by.
    w : (1,)
        Not used.
    """
    span, l1, l2, height = constants[0], constants[1], constants[2], constants[3]
    s1, c1 = sin_cos(assembly_principal(joints[0]))
    s2, c2 = sin_cos(assembly_principal(joints[1]))
    d = joints[2]
    # Half the way between the centres, and what is half-way.
    half_x = -span - 0.5 * l1 * (c1 + c2)
    half_z = 0.5 * l1 * (s1 - s2)
    middle_x = 0.5 * l1 * (c1 - c2)
    middle_z = height - 0.5 * l1 * (s1 + s2)
    half = math.sqrt(half_x * half_x + half_z * half_z)
    room = (l2 - d) * (l2 + d)
    rise2 = room - half * half
    # What rounding of angles and lengths leaves.
    noise = 64.0 * EPS * (l2 * l2 + (abs(span) + l1) * (abs(span) + l1))
    if rise2 < -noise:
        return 0, True
    if half <= pauu_ONE * l2:
        return -1, False
    rise = math.sqrt(room) - half if room > 0.0 else -half
    rise = math.sqrt(rise * (math.sqrt(room) + half)) if rise > 0.0 else 0.0
    count = 2 if rise > 0.0 else 1
    for k in range(count):
        share = (rise if k == 0 else -rise) / half
        x = middle_x - share * half_z
        z = middle_z + share * half_x
        worst = 0.0
        for limb in range(2):
            u = x + span + l1 * c2 if limb == 1 else x - span - l1 * c1
            v = z - height + l1 * (s2 if limb == 1 else s1)
            miss = abs(math.sqrt(u * u + d * d + v * v) - l2)
            worst = miss if miss > worst else worst
        found[k, 0] = x
        found[k, 1] = d
        found[k, 2] = z
        found[k, 3] = worst
        found[k, 4] = -z
    assembly_sort(found, count, 5)
    return count, True

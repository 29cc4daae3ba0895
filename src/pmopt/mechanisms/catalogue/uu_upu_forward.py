"""Forward kinematics of 2UU-UPU: two circles for P2, then a turn that puts P1 in theta1's plane.

At most four assembly modes, in closed form. Symbols as in uu_upu.
"""

import math

from pmopt.kernels.assembly import assembly_angles, assembly_principal, assembly_sort
from pmopt.kernels.trigonometry import sin_cos

EPS = 2.220446049250313e-16
TINY = 1e-300


def uu_assemble(joints, constants, found, w):  # type: ignore[no-untyped-def]
    """Write the assembly modes, a row each; return how many, -1 where the platform is free.

    Two kappa, and two psi each that put P1 in theta1's plane; on its own side one, both or none.

    Parameters
    ----------
    joints : (3,)
    constants : (8,)
        a, c, L, r, R and home's x, beta, gamma.
    found : (4, 8)
        x, beta, gamma, y, z, alpha, the largest miss, and what they are sorted by.
    w : (1,)
        Not used.
    """
    a, c, length, r, big_r = constants[0], constants[1], constants[2], constants[3], constants[4]
    st, ct = sin_cos(assembly_principal(joints[0]))
    sphi, cphi = sin_cos(assembly_principal(joints[1]))
    sd, cd = sin_cos(assembly_principal(joints[2]))
    # In the limb plane, (y, height): P3, and the way from it to B2.
    p3y, p3h = length * sd - a, length * cd
    between_y, between_h = a - p3y, -p3h
    span = math.sqrt(between_y * between_y + between_h * between_h)
    size = a + c + length
    if span <= 8.0 * EPS * size:
        # P3 in B2: link 2 and the platform's side turn about it together, if they are as long.
        return (-1, False) if abs(2.0 * c - length) <= 16.0 * EPS * size else (0, True)
    # Heron: sine and cosine between B2P3 and P2P3.
    outer = (2.0 * c + span + length) * (2.0 * c + span - length)
    inner = (length + span - 2.0 * c) * (length + 2.0 * c - span)
    scale = 4.0 * c * span
    if not (outer * inner >= -64.0 * EPS * size * size * size * size):
        return 0, True
    sine = math.sqrt(outer * inner if outer * inner > 0.0 else 0.0) / scale
    cosine = (4.0 * c * c + (span - length) * (span + length)) / scale
    forth_y, forth_h = between_y / span, between_h / span
    count = 0
    for side in range(2 if sine > 0.0 else 1):
        turn = sine if side == 0 else -sine
        ck = cosine * forth_y - turn * forth_h
        sk = cosine * forth_h + turn * forth_y
        unit = 1.0 / math.sqrt(ck * ck + sk * sk)
        ck *= unit
        sk *= unit
        ym, hm = p3y + c * ck, p3h + c * sk
        # w . direction of theta1's motion = p cos psi + q sin psi + k
        arm = 1.5 * big_r
        p = arm * (cphi * ct + sphi * st)
        q = arm * ck * (cphi * st - sphi * ct)
        k = (hm * sphi - 1.5 * r) * ct - hm * cphi * st
        most = math.sqrt(p * p + q * q)
        noise = 16.0 * EPS * (arm + abs(hm) + 1.5 * r)
        if most <= noise:
            if abs(k) <= noise:
                return -1, False
            continue
        if abs(k) > most + noise:
            continue
        root = (most - k) * (most + k)
        root = math.sqrt(root if root > 0.0 else 0.0)
        for branch in range(2 if root > 0.0 else 1):
            way = root if branch == 0 else -root
            cpsi = -k * p - way * q
            spsi = way * p - k * q
            unit = 1.0 / math.sqrt(cpsi * cpsi + spsi * spsi)
            cpsi *= unit
            spsi *= unit
            xx = cphi * cpsi - sphi * ck * spsi
            xy = spsi * sk
            xz = -sphi * cpsi - cphi * ck * spsi
            ox, oz = sphi * sk, cphi * sk
            mx, mz = hm * sphi - 0.5 * r, hm * cphi
            wx, wz = mx + arm * xx - r, mz + arm * xz
            if not wx * st + wz * ct > 0.0:
                continue
            rotation = (xx, ox, xy * oz - xz * ck, xy, ck, xz * ox - xx * oz,
                        xz, oz, xx * ck - xy * ox)  # fmt: skip
            alpha, beta, gamma = assembly_angles(rotation)
            out = found[count]
            out[0] = mx + 0.5 * big_r * xx
            out[1] = beta
            out[2] = gamma
            out[3] = ym + 0.5 * big_r * xy
            out[4] = mz + 0.5 * big_r * xz
            out[5] = alpha
            worst = abs(wx * ct - wz * st)
            u, v = p3y + 2.0 * c * ck - a, p3h + 2.0 * c * sk
            miss = abs(math.sqrt(u * u + v * v) - length)
            out[6] = miss if miss > worst else worst
            away = (out[0] - constants[5]) * (out[0] - constants[5])
            for n in range(2):
                gap = assembly_principal(out[1 + n] - constants[6 + n])
                away += big_r * big_r * gap * gap
            out[7] = away
            count += 1
    assembly_sort(found, count, 8)
    return count, True

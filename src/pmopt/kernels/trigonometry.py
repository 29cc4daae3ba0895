"""Trigonometry as branch-free scalar code that LLVM vectorises; kernel functions, see sweep.

The polynomials are the minimax ones of fdlibm (Sun Microsystems, k_sin.c and k_cos.c).
"""

import math

import numpy as np

from pmopt.kernels.vectors import Rotation

TWO_OVER_PI = 0.6366197723675814
# pi / 2 in two parts: k * HALF_PI_1 is exact for |k| < 2**20.
HALF_PI_1 = 1.57079632673412561417e00
HALF_PI_2 = 6.07710050650619224932e-11
S1 = -1.66666666666666324348e-01
S2 = 8.33333333332248946124e-03
S3 = -1.98412698298579493134e-04
S4 = 2.75573137070700676789e-06
S5 = -2.50507602534068634195e-08
S6 = 1.58969099521155010221e-10
K1 = 4.16666666666666019037e-02
K2 = -1.38888888888741095749e-03
K3 = 2.48015872894767294178e-05
K4 = -2.75573143513906633035e-07
K5 = 2.08757232129817482790e-09
K6 = -1.13596475577881948265e-11


def sin_cos(angle):
    """Return sine and cosine, correct to 1e-15 for angles of at most a few turns."""
    turns = np.floor(angle * TWO_OVER_PI + 0.5)
    r = (angle - turns * HALF_PI_1) - turns * HALF_PI_2
    z = r * r
    s = r + r * z * (S1 + z * (S2 + z * (S3 + z * (S4 + z * (S5 + z * S6)))))
    c = 1.0 - 0.5 * z + z * z * (K1 + z * (K2 + z * (K3 + z * (K4 + z * (K5 + z * K6)))))
    quadrant = turns - 4.0 * np.floor(0.25 * turns)
    odd = quadrant == 1.0 or quadrant == 3.0
    sine = c if odd else s
    cosine = s if odd else c
    return (
        -sine if quadrant > 1.5 else sine,
        -cosine if quadrant == 1.0 or quadrant == 2.0 else cosine,
    )


def roll_pitch_yaw(about_z, about_y, about_x):
    """Return Rz(about_z) Ry(about_y) Rx(about_x)."""
    sz, cz = sin_cos(about_z)
    sy, cy = sin_cos(about_y)
    sx, cx = sin_cos(about_x)
    return Rotation(
        cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx,
        sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx,
        -sy, cy * sx, cy * cx,
    )  # fmt: skip


# arctan by fdlibm (s_atan.c), to |x| < 7/16.
A0 = 3.33333333333329318027e-01
A1 = -1.99999999998764832476e-01
A2 = 1.42857142725034663711e-01
A3 = -1.11111104054623557880e-01
A4 = 9.09088713343650656196e-02
A5 = -7.69187620504482999495e-02
A6 = 6.66107313738753120669e-02
A7 = -5.83357013379057348645e-02
A8 = 4.97687799461593236017e-02
A9 = -3.65315727442169155270e-02
A10 = 1.62858201153657823623e-02
TAN_EIGHTH = 0.41421356237309503
# Angles whose doubles fall short by the numbers that follow.
QUARTER_PI_1 = 7.85398163397448278999e-01
QUARTER_PI_2 = 3.06161699786838301793e-17
PI_1 = 3.141592653589793116
PI_2 = 1.2246467991473531772e-16


def arc_tangent(y, x):
    """Return the angle of (x, y) in [-pi, pi], as atan2 does; correct to 5e-16.

    The C library's differs between its versions and between processors.
    """
    across = abs(y)
    along = abs(x)
    steep = across > along
    small = along if steep else across
    large = across if steep else along
    middle = small > TAN_EIGHTH * large
    above = small - large if middle else small
    below = small + large if middle else large
    r = above / (below if below > 0.0 else 1.0)
    z = r * r
    w = z * z
    s = z * (A0 + w * (A2 + w * (A4 + w * (A6 + w * (A8 + w * A10)))))
    s = s + w * (A1 + w * (A3 + w * (A5 + w * (A7 + w * A9))))
    # Base and sign by octant: r alone, pi / 4 + r, and these from pi / 2 and from pi.
    angle = QUARTER_PI_1 - ((r * s - QUARTER_PI_2) - r) if middle else r - r * s
    angle = (2.0 * QUARTER_PI_1 - angle) + 2.0 * QUARTER_PI_2 if steep else angle
    left = x < 0.0 or (across == 0.0 and math.copysign(1.0, x) < 0.0)
    angle = PI_1 - (angle - PI_2) if left else angle
    return math.copysign(angle, y)

"""3-CUR: one translation and two rotations; three CUR limbs with vertical cylindrical joints.

Symbols as in the paper on the 3-CUR mechanism: h, theta2 .. theta5, alpha, beta, gamma. Limb i at
azimuth 0, 120, 240 degrees with r_i radial and t_i tangential; A_i = Ra r_i, b_i = Rb r_i,
Rot = Rz(alpha) Ry(beta) Rx(gamma), e_i = Rot t_i, w_i = P + Rot b_i - A_i - (h_i + d1) z::

    e_i . w_i = 0        |w_i| = L

z, beta and gamma are free; x, y and alpha follow. With g_i the horizontal part of w_i and
zeta_i = +-sqrt(L^2 - |g_i|^2) its height, the three e_i . w_i = 0 are solved for x, y, alpha by
Newton's method, and h_i = z + (Rot b_i)_z - zeta_i - d1: z decouples from the rest.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.errors import InputError
from pmopt.mechanisms.base import (
    PLATFORM,
    Chain,
    Coordinate,
    ForwardSolution,
    InverseSolution,
    Joint,
    Limb,
    Matrix,
    Mechanism,
    Parameter,
    Parameters,
    Ranges,
    Reach,
    Vector,
)
from pmopt.numerics.newton import real_roots
from pmopt.numerics.rotation import main_range, rotation_matrices
from pmopt.numerics.trigonometry import roll_pitch_yaw, sin_cos

TINY = 1e-300
#: Cosine and sine of the azimuths.
CUR_C2 = -0.5
CUR_S2 = 0.8660254037844386
#: Newton steps; a residual beyond the tolerance (over L) means that there is no solution.
CUR_STEPS = 18
#: The first steps follow the solution from the level platform to the tilt.
CUR_STAGES = 12.0
CUR_TOLERANCE = 1e-10
#: Least height of a link over L while solving: keeps its slope finite at the end of reach.
CUR_LOWEST = 1e-7

MODE_SIGNS = {
    "-".join("up" if s > 0 else "down" for s in signs): signs
    for signs in itertools.product((1.0, -1.0), repeat=3)
}

_OURS = "ours: the paper gives no sizes"


def cur_limb(r, x, y, c, s, sign, ra, rb, length):  # type: ignore[no-untyped-def]
    """Return b = Rot b_i, e_i, the horizontal part of w_i, and its height squared and signed."""
    r11, r12, _, r21, r22, _, r31, r32, _ = r
    bx = rb * (r11 * c + r12 * s)
    by = rb * (r21 * c + r22 * s)
    bz = rb * (r31 * c + r32 * s)
    ex = r12 * c - r11 * s
    ey = r22 * c - r21 * s
    ez = r32 * c - r31 * s
    gx = x + bx - ra * c
    gy = y + by - ra * s
    square = length * length - gx * gx - gy * gy
    least = CUR_LOWEST * length
    zeta = sign * math.sqrt(square if square > least * least else least * least)
    return bx, by, bz, ex, ey, ez, gx, gy, square, zeta


def cur_turned(limb, ax, ay, az):  # type: ignore[no-untyped-def]
    """Return zeta times the rates of e.w and of h by a turn about an axis."""
    bx, by, bz, ex, ey, ez, gx, gy, _, zeta = limb
    dbx = ay * bz - az * by
    dby = az * bx - ax * bz
    dbz = ax * by - ay * bx
    dex = ay * ez - az * ey
    dey = az * ex - ax * ez
    dez = ax * ey - ay * ex
    sway = gx * dbx + gy * dby
    rate = dex * gx + dey * gy + ex * dbx + ey * dby + dez * zeta
    return rate * zeta - ez * sway, dbz * zeta + sway


def cur_slope(limb):  # type: ignore[no-untyped-def]
    """Return e.w, zeta times its rates by x, y, alpha, and zeta times those of h."""
    _, _, _, ex, ey, ez, gx, gy, _, zeta = limb
    f_a, h_a = cur_turned(limb, 0.0, 0.0, 1.0)
    value = ex * gx + ey * gy + ez * zeta
    return value, ex * zeta - ez * gx, ey * zeta - ez * gy, f_a, gx, gy, h_a


def cur_adjugate(a, b, c, d, e, f, g, h, i):  # type: ignore[no-untyped-def]
    """Return adjugate and determinant of [[a, b, c], [d, e, f], [g, h, i]]."""
    m11 = e * i - f * h
    m21 = f * g - d * i
    m31 = d * h - e * g
    return (
        m11, c * h - b * i, b * f - c * e,
        m21, a * i - c * g, c * d - a * f,
        m31, b * g - a * h, a * e - b * d,
        a * m11 + b * m21 + c * m31,
    )  # fmt: skip


def cur_solve(beta, gamma, ra, rb, length, s1, s2, s3):  # type: ignore[no-untyped-def]
    """Return x, y, alpha and the largest residual over L, by continuation from the level pose."""
    rise = length * length - (ra - rb) * (ra - rb)
    rise = math.sqrt(rise if rise > 0.0 else 0.0) * (s1 + s2 + s3) / 3.0
    x = 0.0
    y = 0.0
    alpha = 0.0
    before_x = -rise * beta / CUR_STAGES
    before_y = rise * gamma / CUR_STAGES
    before_alpha = 0.0
    worst = 0.0
    for step in range(CUR_STEPS):
        # One step each on the way to the tilt, started by extrapolation, the rest at it.
        stage = step + 1.0 if step + 1.0 < CUR_STAGES else CUR_STAGES
        tilt_beta = beta * stage / CUR_STAGES
        tilt_gamma = gamma * stage / CUR_STAGES
        ahead = 1.0 if step < CUR_STAGES else 0.0
        next_x = x + ahead * (x - before_x)
        next_y = y + ahead * (y - before_y)
        next_alpha = alpha + ahead * (alpha - before_alpha)
        before_x = x
        before_y = y
        before_alpha = alpha
        x = next_x
        y = next_y
        alpha = next_alpha
        r = roll_pitch_yaw(alpha, tilt_beta, tilt_gamma)
        k1 = cur_slope(cur_limb(r, x, y, 1.0, 0.0, s1, ra, rb, length))
        k2 = cur_slope(cur_limb(r, x, y, CUR_C2, CUR_S2, s2, ra, rb, length))
        k3 = cur_slope(cur_limb(r, x, y, CUR_C2, -CUR_S2, s3, ra, rb, length))
        z1 = cur_limb(r, x, y, 1.0, 0.0, s1, ra, rb, length)[9]
        z2 = cur_limb(r, x, y, CUR_C2, CUR_S2, s2, ra, rb, length)[9]
        z3 = cur_limb(r, x, y, CUR_C2, -CUR_S2, s3, ra, rb, length)[9]
        adj = cur_adjugate(k1[1], k1[2], k1[3], k2[1], k2[2], k2[3], k3[1], k3[2], k3[3])
        d = adj[9]
        unit = 1.0 / (d if d > 0.0 else -d if d < 0.0 else TINY)
        unit = -unit if d < 0.0 else unit
        unit = unit if -1e200 < unit < 1e200 else 0.0
        f1 = k1[0] * z1 * unit
        f2 = k2[0] * z2 * unit
        f3 = k3[0] * z3 * unit
        dx = adj[0] * f1 + adj[1] * f2 + adj[2] * f3
        dy = adj[3] * f1 + adj[4] * f2 + adj[5] * f3
        da = adj[6] * f1 + adj[7] * f2 + adj[8] * f3
        # A long step is shortened: the branch is the one connected to the first-order solution.
        size = abs(dx) + abs(dy) + length * abs(da)
        cut = 0.5 * length / (size + TINY)
        cut = cut if cut < 1.0 else 1.0
        x = x - cut * dx
        y = y - cut * dy
        alpha = alpha - cut * da
    r = roll_pitch_yaw(alpha, beta, gamma)
    worst = abs(cur_slope(cur_limb(r, x, y, 1.0, 0.0, s1, ra, rb, length))[0])
    other = abs(cur_slope(cur_limb(r, x, y, CUR_C2, CUR_S2, s2, ra, rb, length))[0])
    worst = other if other > worst else worst
    other = abs(cur_slope(cur_limb(r, x, y, CUR_C2, -CUR_S2, s3, ra, rb, length))[0])
    worst = other if other > worst else worst
    return x, y, alpha, worst / length


def cur_less(a, b):  # type: ignore[no-untyped-def]
    """Return the lesser of two."""
    return a if a < b else b


def cur_limits(limb, r, c, s, length, limits):  # type: ignore[no-untyped-def]
    """Return the least slack of a limb's reach and of its passive joints' limits."""
    cos4, sin4, least4, cos5, sin5, least5, low, high = limits
    _, _, _, ex, ey, ez, gx, gy, square, zeta = limb
    # z4 = e x w / L; s = z x z4 / |..|, turned so that s.e > 0.
    zx = (ey * zeta - ez * gy) / length
    zy = (ez * gx - ex * zeta) / length
    zz = (ex * gy - ey * gx) / length
    unit = 1.0 / math.sqrt(zx * zx + zy * zy + TINY)
    sx = -zy * unit
    sy = zx * unit
    along = sx * ex + sy * ey
    turn = 1.0 if along > 0.0 else -1.0
    across = turn * (zx * sy * ez - zy * sx * ez + zz * (sx * ey - sy * ex))
    along = turn * along
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = r
    up = (gx * r13 + gy * r23 + zeta * r33) / length
    out = (
        gx * (r11 * c + r12 * s) + gy * (r21 * c + r22 * s) + zeta * (r31 * c + r32 * s)
    ) / length
    slack = cur_less(square / length, zeta - low)
    slack = cur_less(slack, high - zeta)
    slack = cur_less(slack, (along * cos4 + across * sin4 - least4) * length)
    return cur_less(slack, (out * cos5 + up * sin5 - least5) * length)


def cur_kernel(z, beta, gamma, constants):  # type: ignore[no-untyped-def]
    """Return the margin and J^-1 times the determinants that can vanish.

    With F = zeta de.w/d(x, y, alpha) and H = zeta dh/d(..), limb by limb,
    zeta_i dh_i = H_i,X - H_i,u F^-1 F_X. Everything is multiplied by det F and the three zeta.
    """
    (
        ra, rb, length, d1, s1, s2, s3, scale, low1, high1, low2, high2, low3, high3,
        cos4, sin4, least4, cos5, sin5, least5, low, high,
        _, _, _, _, _, _, _, _, _,
    ) = constants  # fmt: skip
    x, y, alpha, residual = cur_solve(beta, gamma, ra, rb, length, s1, s2, s3)
    r = roll_pitch_yaw(alpha, beta, gamma)
    limits = (cos4, sin4, least4, cos5, sin5, least5, low, high)
    k1 = cur_limb(r, x, y, 1.0, 0.0, s1, ra, rb, length)
    k2 = cur_limb(r, x, y, CUR_C2, CUR_S2, s2, ra, rb, length)
    k3 = cur_limb(r, x, y, CUR_C2, -CUR_S2, s3, ra, rb, length)
    margin = length if residual <= CUR_TOLERANCE else -residual * length
    margin = cur_less(margin, cur_limits(k1, r, 1.0, 0.0, length, limits))
    margin = cur_less(margin, cur_limits(k2, r, CUR_C2, CUR_S2, length, limits))
    margin = cur_less(margin, cur_limits(k3, r, CUR_C2, -CUR_S2, length, limits))
    h = z + k1[2] - k1[9] - d1
    margin = cur_less(margin, cur_less(h - low1, high1 - h))
    h = z + k2[2] - k2[9] - d1
    margin = cur_less(margin, cur_less(h - low2, high2 - h))
    h = z + k3[2] - k3[9] - d1
    margin = cur_less(margin, cur_less(h - low3, high3 - h))

    sin_a, cos_a = sin_cos(alpha)
    _, f1x, f1y, f1a, h1x, h1y, h1a = cur_slope(k1)
    _, f2x, f2y, f2a, h2x, h2y, h2a = cur_slope(k2)
    _, f3x, f3y, f3a, h3x, h3y, h3a = cur_slope(k3)
    a11, a12, a13, a21, a22, a23, a31, a32, a33, d = cur_adjugate(
        f1x, f1y, f1a, f2x, f2y, f2a, f3x, f3y, f3a
    )
    f1b, h1b = cur_turned(k1, -sin_a, cos_a, 0.0)
    f2b, h2b = cur_turned(k2, -sin_a, cos_a, 0.0)
    f3b, h3b = cur_turned(k3, -sin_a, cos_a, 0.0)
    f1c, h1c = cur_turned(k1, r[0], r[3], r[6])
    f2c, h2c = cur_turned(k2, r[0], r[3], r[6])
    f3c, h3c = cur_turned(k3, r[0], r[3], r[6])
    xb = a11 * f1b + a12 * f2b + a13 * f3b
    yb = a21 * f1b + a22 * f2b + a23 * f3b
    ab = a31 * f1b + a32 * f2b + a33 * f3b
    xc = a11 * f1c + a12 * f2c + a13 * f3c
    yc = a21 * f1c + a22 * f2c + a23 * f3c
    ac = a31 * f1c + a32 * f2c + a33 * f3c
    z23 = k2[9] * k3[9]
    z13 = k1[9] * k3[9]
    z12 = k1[9] * k2[9]
    all_z = d * z12 * k3[9]
    return (
        margin,
        all_z,
        (d * h1b - h1x * xb - h1y * yb - h1a * ab) * z23 * scale,
        (d * h1c - h1x * xc - h1y * yc - h1a * ac) * z23 * scale,
        all_z,
        (d * h2b - h2x * xb - h2y * yb - h2a * ab) * z13 * scale,
        (d * h2c - h2x * xc - h2y * yc - h2a * ac) * z13 * scale,
        all_z,
        (d * h3b - h3x * xb - h3y * yb - h3a * ab) * z12 * scale,
        (d * h3c - h3x * xc - h3y * yc - h3a * ac) * z12 * scale,
    )


def cur_skeleton(z, beta, gamma, constants):  # type: ignore[no-untyped-def]
    """Return the platform, the three links and the platform's spokes, and the cones."""
    (
        ra, rb, length, _, s1, s2, s3, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _,
        u1x, u1y, u1z, u2x, u2y, u2z, u3x, u3y, u3z,
    ) = constants  # fmt: skip
    x, y, alpha, _ = cur_solve(beta, gamma, ra, rb, length, s1, s2, s3)
    r = roll_pitch_yaw(alpha, beta, gamma)
    k1 = cur_limb(r, x, y, 1.0, 0.0, s1, ra, rb, length)
    k2 = cur_limb(r, x, y, CUR_C2, CUR_S2, s2, ra, rb, length)
    k3 = cur_limb(r, x, y, CUR_C2, -CUR_S2, s3, ra, rb, length)
    return (
        x, y, z, *r,
        ra, 0.0, z + k1[2] - k1[9], x + k1[0], y + k1[1], z + k1[2],
        ra * CUR_C2, ra * CUR_S2, z + k2[2] - k2[9], x + k2[0], y + k2[1], z + k2[2],
        ra * CUR_C2, -ra * CUR_S2, z + k3[2] - k3[9], x + k3[0], y + k3[1], z + k3[2],
        x, y, z, x + k1[0], y + k1[1], z + k1[2],
        x, y, z, x + k2[0], y + k2[1], z + k2[2],
        x, y, z, x + k3[0], y + k3[1], z + k3[2],
        (k1[6] * u1x + k1[7] * u1y + k1[9] * u1z) / length,
        (k2[6] * u2x + k2[7] * u2y + k2[9] * u2z) / length,
        (k3[6] * u3x + k3[7] * u3y + k3[9] * u3z) / length,
    )  # fmt: skip


class Cur(Mechanism):
    """The 3-CUR mechanism."""

    name = "3-cur"
    title = "3-CUR"
    description = "one translation (z) and two rotations; three sliders on vertical columns"
    source = "Kinematics Analysis and Simulation of 3-CUR Parallel Sorting Robot"
    freedom = "1T2R"
    length_unit = "m"
    default_jacobian = "homogenized"
    length_meaning = "Rb, the platform's radius: rates of angles become speeds"
    parameters = (
        Parameter("Ra", "length", 0.20, (0.10, 0.40), True, "radius of the columns", _OURS),
        Parameter("Rb", "length", 0.12, (0.05, 0.25), True, "radius of the platform", _OURS),
        Parameter("L", "length", 0.25, (0.15, 0.50), True, "length of the links", _OURS),
        Parameter("d1", "length", 0.0, None, False, "height of the U joints above the sliders",
                  _OURS),
    )  # fmt: skip
    pose = (
        Coordinate("z", "length", "height of the platform's centre"),
        Coordinate("beta", "angle", "pitch, about y"),
        Coordinate("gamma", "angle", "roll, about x"),
    )
    parasitic = (
        Coordinate("x", "length", "shift along x"),
        Coordinate("y", "length", "shift along y"),
        Coordinate("alpha", "angle", "yaw, about z"),
    )
    joints = tuple(Coordinate(f"h{k}", "length", f"height of slider {k}") for k in range(1, 4))
    passive = (
        Coordinate("theta4", "angle", "second axis of each U joint"),
        Coordinate("theta5", "angle", "each R joint at the platform"),
        Coordinate("elevation", "angle", "each link above the horizontal"),
    )
    limbs = tuple(
        Limb(
            f"limb {k}", "CUR", f"C on column {k} (sliding actuated), U on the slider, R tangential"
        )
        for k in range(1, 4)
    )
    layouts = {  # noqa: RUF012  # declared as a mapping that is not changed
        "literal": "the paper's D-H table read literally, theta4 = 0: a 3-CRR"
    }
    working_modes = tuple(MODE_SIGNS)
    kernel = staticmethod(cur_kernel)
    constant_count = 31
    skeleton = staticmethod(cur_skeleton)
    segments = (0, 1, 2, PLATFORM, PLATFORM, PLATFORM)
    spokes = (0, 1, 2)
    cones = ("U1", "U2", "U3")

    def characteristic_length(self, parameters: Parameters) -> float:
        """Return Rb."""
        return _sizes(parameters)[1]

    def home(self, parameters: Parameters) -> dict[str, float]:
        """Return the level platform with the sliders in the middle of their stroke."""
        ra, rb, length, d1 = _sizes(parameters)
        rise = math.sqrt(max(length**2 - (ra - rb) ** 2, 0.0))
        return {"z": 0.15 + d1 + rise, "beta": 0.0, "gamma": 0.0}

    def default_limits(self, parameters: Parameters) -> Ranges:
        """Return stroke 0 .. 0.30 m (ours), theta4, theta5 and the elevation of the links."""
        return {
            **{c.name: (0.0, 0.30) for c in self.joints},
            "theta4": (-math.pi / 4, math.pi / 4),
            "theta5": (math.radians(20), math.radians(160)),
            "elevation": (math.radians(20), math.pi / 2),
        }

    def default_domain(self, parameters: Parameters) -> Ranges:
        """Return tilts up to 80 degrees (ours)."""
        tilt = math.radians(80)
        return {"beta": (-tilt, tilt), "gamma": (-tilt, tilt)}

    def reach_box(self, parameters: Parameters, limits: Ranges) -> tuple[Vector, Vector]:
        """Return z between the mean of the sliders' ends with links down and up; all tilts.

        The platform's joints lie around its centre: z is the mean of h + d1 + zeta.
        """
        ra, rb, length, d1 = _sizes(parameters)
        ends = [limits.get(c.name, (-math.inf, math.inf)) for c in self.joints]
        low, high = (sum(side) / 3 + d1 for side in zip(*ends, strict=True))
        if not (math.isfinite(low) and math.isfinite(high)):
            raise InputError("limits: h1, h2 and h3 need bounds: z follows them without end")
        if abs(ra - rb) >= length:
            return np.zeros(3), np.zeros(3)
        down, up = limits.get("elevation", (-math.pi, math.pi))
        low += length * math.sin(max(down, -math.pi / 2))
        high += length * math.sin(min(up, math.pi / 2))
        angles = (math.pi / 2, math.pi)
        return np.array([low, *(-a for a in angles)]), np.array([high, *angles])

    def reach(self, parameters: Parameters, pose: Mapping[str, float]) -> tuple[Reach, ...]:
        """Return how far each link is from lying flat, and its slider from its stroke's ends.

        Of the first working mode.
        """
        length = _sizes(parameters)[2]
        signs = next(iter(MODE_SIGNS.values()))
        found, _, residual = self._limbs(parameters, pose, signs)
        result = []
        for limb, one in zip(self.limbs, found, strict=True):
            flat = length - math.hypot(one[6], one[7])
            h = pose["z"] + one[2] - one[9] - _sizes(parameters)[3]
            low, high = self.default_limits(parameters)["h1"]
            room = min(h - low, high - h)
            if residual > CUR_TOLERANCE:
                flat = min(flat, -residual * length)
            reason = "too far" if flat < room or h > high else "too close"
            result.append(Reach(limb.name, min(flat, room), reason))
        return tuple(result)

    def inverse(
        self, parameters: Parameters, pose: Mapping[str, float]
    ) -> tuple[InverseSolution, ...]:
        """Solve for x, y, alpha in each working mode; the heights follow."""
        d1 = _sizes(parameters)[3]
        solutions = []
        for mode, signs in MODE_SIGNS.items():
            limbs, (x, y, alpha), residual = self._limbs(parameters, pose, signs)
            if not residual <= CUR_TOLERANCE or min(one[8] for one in limbs) < 0:
                continue
            joints = {f"h{k}": pose["z"] + one[2] - one[9] - d1 for k, one in enumerate(limbs, 1)}
            solutions.append(
                InverseSolution(
                    mode, joints, {"x": x, "y": y, "alpha": alpha},
                    self._passive(parameters, pose, alpha, limbs),
                )
            )  # fmt: skip
        return tuple(solutions)

    def _limbs(
        self, parameters: Parameters, pose: Mapping[str, float], signs: tuple[float, ...]
    ) -> tuple[list[tuple[float, ...]], tuple[float, float, float], float]:
        """Return what :func:`cur_limb` tells of each limb, x, y, alpha and the residual."""
        ra, rb, length, _ = _sizes(parameters)
        x, y, alpha, residual = cur_solve(pose["beta"], pose["gamma"], ra, rb, length, *signs)
        rotation = roll_pitch_yaw(alpha, pose["beta"], pose["gamma"])
        limbs = [
            cur_limb(rotation, x, y, c, s, sign, ra, rb, length)
            for (c, s), sign in zip(_AZIMUTHS, signs, strict=True)
        ]
        return limbs, (x, y, alpha), residual

    def _passive(
        self,
        parameters: Parameters,
        pose: Mapping[str, float],
        alpha: float,
        limbs: list[tuple[float, ...]],
    ) -> dict[str, float]:
        """Return theta2 .. theta5 and the elevation of each limb."""
        length = _sizes(parameters)[2]
        angles = np.array([[alpha, pose["beta"], pose["gamma"]]])
        rotation = rotation_matrices(angles)[0][0]
        values: dict[str, float] = {}
        for k, (one, (c, s)) in enumerate(zip(limbs, _AZIMUTHS, strict=True), 1):
            radial, tangential = np.array([c, s, 0.0]), np.array([-s, c, 0.0])
            axis, first, second, w = self._axes(one, length)
            x2, link = np.cross(first, _Z), np.cross(second, first)
            found = {
                "theta2": math.atan2(-first @ radial, first @ tangential),
                "theta3": math.atan2(link[2], link @ x2),
                "theta4": math.atan2(second @ np.cross(first, axis), first @ axis),
                "theta5": math.atan2(w @ rotation[:, 2], w @ (rotation @ radial)),
                "elevation": math.asin(min(max(w[2] / length, -1.0), 1.0)),
            }
            values |= {f"{name}_{k}": float(v) for name, v in found.items()}
        return values

    @staticmethod
    def _axes(one: tuple[float, ...], length: float) -> tuple[Vector, Vector, Vector, Vector]:
        """Return e, the axes s and z4 of the U joint, and w of a limb."""
        axis = np.array(one[3:6])
        w = np.array([one[6], one[7], one[9]])
        second = np.cross(axis, w) / length
        first = np.cross(_Z, second)
        first /= max(float(np.linalg.norm(first)), TINY)
        return axis, first if first @ axis > 0 else -first, second, w

    def forward(
        self, parameters: Parameters, joints: Mapping[str, float]
    ) -> tuple[ForwardSolution, ...]:
        """Solve e_i.w_i = 0 and |w_i| = L for all six coordinates, from 487 starts."""
        ra, rb, length, d1 = _sizes(parameters)
        radial = np.array([[c, s, 0.0] for c, s in _AZIMUTHS])
        tangential = np.array([[-s, c, 0.0] for c, s in _AZIMUTHS])
        heights = np.array([joints[c.name] + d1 for c in self.joints])
        anchors = ra * radial + heights[:, None] * _Z

        def system(u: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            """Lengths over L; unknowns x, y, z over L, alpha, beta, gamma."""
            rotations, axes = rotation_matrices(u[:, 3:])
            b = np.einsum("nij,kj->nki", rotations, rb * radial)
            e = np.einsum("nij,kj->nki", rotations, tangential)
            w = length * u[:, None, :3] + b - anchors
            residual = np.concatenate(
                [(e * w).sum(axis=2) / length, (w * w).sum(axis=2) / length**2 - 1], axis=1
            )
            slope = np.empty((len(u), 6, 6))
            slope[:, :3, :3] = e
            slope[:, 3:, :3] = 2 * w / length
            turn = np.cross(e, w) + np.cross(b, e)
            slope[:, :3, 3:] = np.einsum("nki,nij->nkj", turn, axes) / length
            slope[:, 3:, 3:] = 2 * np.einsum("nki,nij->nkj", np.cross(b, w), axes) / length**2
            return residual, slope

        rise = math.sqrt(max(length**2 - (ra - rb) ** 2, 0.0))
        middle = float(heights.mean())
        grids = np.meshgrid([-0.4, 0.4], [-0.4, 0.4], [(middle - rise) / length, middle / length,
                            (middle + rise) / length], [-0.4, 0.4, 2.5],
                            [-1.1, -0.4, 0.4, 1.1], [-2.2, -0.8, 0.8, 2.2])  # fmt: skip
        # The platform through the three links' ends, all up: a tilt from the heights' differences.
        beta = -float(heights @ radial[:, 0]) * 2 / 3 / rb
        gamma = float(heights @ radial[:, 1]) * 2 / 3 / rb
        near = [rise * beta / length, -rise * gamma / length, (middle + rise) / length, 0.0]
        starts = np.vstack([
            [*near, beta, gamma], [*near, beta / 2, gamma / 2], np.array(grids).reshape(6, -1).T,
        ])  # fmt: skip

        def normal(u: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.hstack([u[:, :3], main_range(u[:, 3:])])

        largest = np.array([0.3, 0.3, 0.3, 0.4, 0.4, 0.4])
        solutions = []
        for root in real_roots(system, starts, 1e-11, largest, normal):
            x, y, z = (length * root[:3]).tolist()
            alpha, beta, gamma = root[3:].tolist()
            residual = float(np.abs(system(root[None])[0]).max()) * length
            solutions.append(
                ForwardSolution(
                    {"z": z, "beta": beta, "gamma": gamma},
                    {"x": x, "y": y, "alpha": alpha},
                    residual,
                )
            )
        home = self.home(parameters)

        def away(solution: ForwardSolution) -> float:
            turns = (solution.pose["beta"], solution.pose["gamma"], solution.parasitic["alpha"])
            return math.hypot(solution.pose["z"] - home["z"], *(rb * t for t in turns))

        return tuple(sorted(solutions, key=away))

    def velocity_maps(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> tuple[Matrix, Matrix]:
        """Return zeta_i dh_i / d(z, beta, gamma) and diag(zeta_i); parasitic rates eliminated."""
        constraint, drive, heights, axes = self.full_map(parameters, pose, joints)
        moved = np.zeros((6, 6))
        moved[:3, :3] = np.eye(3)
        moved[3:, 3:] = axes
        # Columns: x, y, alpha; then z, beta, gamma.
        held, free = [0, 1, 3], [2, 4, 5]
        constraint, drive = constraint @ moved, drive @ moved
        follow = -np.linalg.solve(constraint[:, held], constraint[:, free])
        return drive[:, free] + drive[:, held] @ follow, np.diag(heights)

    def full_map(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> tuple[Matrix, Matrix, Vector, Matrix]:
        """Return the rows on (v, omega) of the constraints and of the drives.

        The constraints are the horizontal forces through the U joints, w_z e - e_z w; the drives
        [w; b x w] give w_z h'. With them the heights w_z and the axes of the angles' rates.
        """
        mode = self._mode_of(parameters, pose, joints)
        limbs, (_, _, alpha), _ = self._limbs(parameters, pose, MODE_SIGNS[mode])
        constraint, drive, heights = np.empty((3, 6)), np.empty((3, 6)), np.empty(3)
        for k, one in enumerate(limbs):
            b, e = np.array(one[:3]), np.array(one[3:6])
            w = np.array([one[6], one[7], one[9]])
            force = w[2] * e - e[2] * w
            constraint[k] = [*force, *(w[2] * np.cross(b - w, e) - e[2] * np.cross(b, w))]
            drive[k] = [*w, *np.cross(b, w)]
            heights[k] = w[2]
        angles = np.array([[alpha, pose["beta"], pose["gamma"]]])
        return constraint, drive, heights, rotation_matrices(angles)[1][0]

    def _mode_of(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> str:
        """Return the working mode whose heights are those given."""
        solutions = self.inverse(parameters, pose)
        if not solutions:
            return self.working_modes[0]
        return min(
            solutions, key=lambda s: sum(abs(s.joints[k] - v) for k, v in joints.items())
        ).working_mode

    def singularity_measures(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> dict[str, dict[str, float]]:
        """Return w_z / L, the 6x6 determinant and the volume of the constraint rows.

        Rows are brought to norm 1, moments divided by Rb.
        """
        _, rb, length, _ = _sizes(parameters)
        constraint, drive, heights, _ = self.full_map(parameters, pose, joints)
        rows = np.vstack([constraint, drive])
        rows[:, 3:] /= rb
        rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), TINY)
        gram = rows[:3] @ rows[:3].T
        return {
            "inverse": {limb.name: float(h) / length
                        for limb, h in zip(self.limbs, heights, strict=True)},
            "forward": {"platform": float(np.linalg.det(rows))},
            "constraint": {"platform": math.sqrt(max(float(np.linalg.det(gram)), 0.0))},
        }  # fmt: skip

    def velocity_map_units(self) -> dict[str, str]:
        """Return the units of J_X's and J_q's entries."""
        return {"J_X": "columns in m; m^2/rad; m^2/rad", "J_q": "diagonal in m"}

    def platform(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Matrix, Vector]:
        """Return Rot and P."""
        signs = MODE_SIGNS[self.check_mode(working_mode)]
        _, (x, y, alpha), _ = self._limbs(parameters, pose, signs)
        angles = np.array([[alpha, pose["beta"], pose["gamma"]]])
        return rotation_matrices(angles)[0][0], np.array([x, y, pose["z"]])

    def layout(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Chain, ...]:
        """Return the limbs: C vertical, U with axes s and z4, R along e."""
        ra, _, length, _ = _sizes(parameters)
        signs = MODE_SIGNS[self.check_mode(working_mode)]
        limbs, (x, y, _), _ = self._limbs(parameters, pose, signs)
        chains = []
        for k, (one, (c, s)) in enumerate(zip(limbs, _AZIMUTHS, strict=True)):
            axis, first, second, w = self._axes(one, length)
            end = np.array([x + one[0], y + one[1], pose["z"] + one[2]])
            chains.append(
                Chain(self.limbs[k].name, (
                    Joint("C", np.array([ra * c, ra * s, 0.0]), (_Z,), drive=(f"h{k + 1}", 1)),
                    Joint("U", end - w, (first, second)),
                    Joint("R", end, (axis,)),
                ))
            )  # fmt: skip
        return tuple(chains)

    def alternative_layout(self, parameters: Parameters, name: str) -> tuple[Chain, ...]:
        """Return the 3-CRR of the literal D-H table at home: U without its second axis."""
        if name not in self.layouts:
            return super().alternative_layout(parameters, name)
        return tuple(
            Chain(limb.name, (limb.joints[0],
                              Joint("R", limb.joints[1].point, limb.joints[1].axes[:1]),
                              limb.joints[2]))
            for limb in self.layout(parameters, self.home(parameters))
        )  # fmt: skip

    def kernel_constants(
        self, parameters: Parameters, working_mode: str, length: float, limits: Ranges
    ) -> list[float]:
        """Return the constants in the order :func:`cur_kernel` unpacks them."""
        ra, rb, link, d1 = _sizes(parameters)
        signs = MODE_SIGNS[working_mode]
        arcs: list[float] = []
        for name in ("theta4", "theta5"):
            low, high = limits.get(name, (-math.pi, math.pi))
            middle, half = (low + high) / 2, (high - low) / 2
            # A full turn excludes nothing, not even by rounding.
            arcs += [
                math.cos(middle),
                math.sin(middle),
                -2.0 if half >= math.pi else math.cos(half),
            ]
        low, high = limits.get("elevation", (-math.pi, math.pi))
        lowest = -math.inf if low <= -math.pi / 2 else link * math.sin(low)
        highest = math.inf if high >= math.pi / 2 else link * math.sin(high)
        home, _, _ = self._limbs(parameters, self.home(parameters), signs)
        ends = [limits.get(c.name, (-math.inf, math.inf)) for c in self.joints]
        return [
            ra, rb, link, d1, *signs, 1 / length, *(end for pair in ends for end in pair),
            *arcs, lowest, highest,
            *(v / link for one in home for v in (one[6], one[7], one[9])),
        ]  # fmt: skip

    def decoupled_volume(
        self, parameters: Parameters, limits: Ranges | None = None, degrees: float = 1.0
    ) -> tuple[float, float]:
        """Return the workspace's volume connected to home, by integrating over z exactly.

        At a tilt (beta, gamma) z runs through the common part of the strokes, each shifted by its
        h - z. What is left is a sum over a grid of tilts.

        Parameters
        ----------
        parameters : mapping
        limits : mapping, optional
            Complete; default: :meth:`default_limits`.
        degrees : float
            Step of the grid; the difference to a step twice as wide estimates the error.

        Returns
        -------
        volume, error : float
            In m rad^2, first working mode.
        """
        fine, coarse = (
            self._integrated(parameters, limits, step) for step in (degrees, 2 * degrees)
        )
        return fine, abs(fine - coarse) / math.sqrt(5)

    def _integrated(self, parameters: Parameters, limits: Ranges | None, degrees: float) -> float:
        from scipy import ndimage

        limits = self.default_limits(parameters) if limits is None else limits
        count = int(80 / degrees)
        tilts = np.radians(degrees) * np.arange(-count, count + 1)
        depth = np.zeros((len(tilts), len(tilts)))
        signs = next(iter(MODE_SIGNS.values()))
        free: dict[str, Any] = {k: v for k, v in limits.items() if not k.startswith("h")}
        bounded = {**free, **{c.name: (-math.inf, math.inf) for c in self.joints}}
        constants = tuple(self.kernel_constants(parameters, self.working_modes[0], 1.0, bounded))
        for i, beta in enumerate(tilts.tolist()):
            for j, gamma in enumerate(tilts.tolist()):
                if cur_kernel(0.0, beta, gamma, constants)[0] < 0:
                    continue
                found, _, _ = self._limbs(parameters, {"beta": beta, "gamma": gamma}, signs)
                shifts = [one[2] - one[9] for one in found]
                ends = [limits[c.name] for c in self.joints]
                top = min(high - s for (_, high), s in zip(ends, shifts, strict=True))
                bottom = max(low - s for (low, _), s in zip(ends, shifts, strict=True))
                depth[i, j] = max(top - bottom, 0.0)
        labels, _ = ndimage.label(depth > 0)
        home = labels[count, count]
        inside = (labels == home) & (labels > 0)
        return float(depth[inside].sum() * np.radians(degrees) ** 2)


_Z = np.array([0.0, 0.0, 1.0])
_AZIMUTHS = ((1.0, 0.0), (CUR_C2, CUR_S2), (CUR_C2, -CUR_S2))


def _sizes(parameters: Parameters) -> tuple[float, float, float, float]:
    """Return Ra, Rb, L, d1."""
    ra, rb, length, d1 = (float(parameters[k] or 0.0) for k in ("Ra", "Rb", "L", "d1"))
    return ra, rb, length, d1


MECHANISM = Cur()

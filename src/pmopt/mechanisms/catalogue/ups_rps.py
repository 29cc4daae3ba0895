"""4-UPS-RPS: three rotations and two translations, four UPS limbs and an RPS one that guides.

Symbols as in "Kinematics Analysis of 4-UPS-RPS Spatial 5-DOF Parallel Mechanism". The fixed frame
lies in the plane of the base joints, X vertical and downwards, Y towards T1, Z right-handed. At
angle a from Y towards Z: T1 at 0 and radius R1, T2 .. T5 at 45, 135, 225, 315 degrees and radius R;
S_k = (0, r sin s_k, -r cos s_k) in the platform, s_k = 0, 72, .., 288 degrees.

With Rot = Rz(alpha) Ry(beta) Rx(gamma) and P = (x, y, z), L_k = P + Rot S_k - T_k, l_k = |L_k|. The
revolute joint of limb 1, along Z, keeps S1 in the plane Z = 0::

    z = r cos(beta) cos(gamma)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pmopt.compiler.programs import Assembler
from pmopt.errors import InputError
from pmopt.kernels.limbs import unit_vector, ups_joints
from pmopt.kernels.strokes import part_within_stroke
from pmopt.kernels.trigonometry import roll_pitch_yaw, sin_cos
from pmopt.mechanisms.bodies import Body, disc, tube
from pmopt.mechanisms.catalogue.ups_rps_forward import (
    DIMENSIONS,
    STARTS,
    rps_assemble,
    rps_MODES,
    rps_WORK,
)
from pmopt.mechanisms.mechanism import (
    PLATFORM,
    Chain,
    Coordinate,
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
from pmopt.numerics import elementary
from pmopt.numerics.matrices import determinant, norm_of, product
from pmopt.numerics.rotation import rotation_matrices

TINY = 1e-300

_PAPER = "paper, section 3.1"
_STROKE = (700.0, 1300.0)
_MM = 1e-3


def rps_limb(r, px, py, pz, sy, sz, ty, tz):  # type: ignore[no-untyped-def]
    """Return Rot S and L = P + Rot S - T of a limb, and the length l."""
    _, r12, r13, _, r22, r23, _, r32, r33 = r
    qx = r12 * sy + r13 * sz
    qy = r22 * sy + r23 * sz
    qz = r32 * sy + r33 * sz
    lx = px + qx
    ly = py + qy - ty
    lz = pz + qz - tz
    return qx, qy, qz, lx, ly, lz, math.sqrt(lx * lx + ly * ly + lz * lz)


def rps_row(limb, r, sin_a, cos_a, z_beta, z_gamma, scale):  # type: ignore[no-untyped-def]
    """Return the rates of l by x, y, alpha, beta, gamma; those by angles times scale."""
    qx, qy, qz, lx, ly, lz, length = limb
    unit = 1.0 / (length + TINY)
    nx = lx * unit
    ny = ly * unit
    nz = lz * unit
    mx = qy * nz - qz * ny
    my = qz * nx - qx * nz
    mz = qx * ny - qy * nx
    return (
        nx,
        ny,
        mz * scale,
        (my * cos_a - mx * sin_a + nz * z_beta) * scale,
        (mx * r[0] + my * r[3] + mz * r[6] + nz * z_gamma) * scale,
    )


def rps_place(alpha, beta, gamma, r):  # type: ignore[no-untyped-def]
    """Return rotation, sine and cosine of alpha, and z with its rates by beta and gamma."""
    sin_a, cos_a = sin_cos(alpha)
    sin_b, cos_b = sin_cos(beta)
    sin_c, cos_c = sin_cos(gamma)
    rotation = roll_pitch_yaw(alpha, beta, gamma)
    return rotation, sin_a, cos_a, r * cos_b * cos_c, -r * sin_b * cos_c, -r * cos_b * sin_c


def rps_kernel(x, y, alpha, beta, gamma, constants):  # type: ignore[no-untyped-def]
    """Return the margin, the least distance to a stroke's end, and J^-1 (paper, J1 J2)."""
    (
        r1, q, s1y, s1z, s2y, s2z, s3y, s3z, s4y, s4z, s5y, s5z, radius, scale,
        low1, high1, low2, high2, low3, high3, low4, high4, low5, high5,
        _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _,
    ) = constants  # fmt: skip
    r, sin_a, cos_a, z, z_beta, z_gamma = rps_place(alpha, beta, gamma, radius)
    k1 = rps_limb(r, x, y, z, s1y, s1z, r1, 0.0)
    k2 = rps_limb(r, x, y, z, s2y, s2z, q, q)
    k3 = rps_limb(r, x, y, z, s3y, s3z, -q, q)
    k4 = rps_limb(r, x, y, z, s4y, s4z, -q, -q)
    k5 = rps_limb(r, x, y, z, s5y, s5z, q, -q)
    margin = k1[6] - low1
    slack = high1 - k1[6]
    margin = slack if slack < margin else margin
    slack = k2[6] - low2
    margin = slack if slack < margin else margin
    slack = high2 - k2[6]
    margin = slack if slack < margin else margin
    slack = k3[6] - low3
    margin = slack if slack < margin else margin
    slack = high3 - k3[6]
    margin = slack if slack < margin else margin
    slack = k4[6] - low4
    margin = slack if slack < margin else margin
    slack = high4 - k4[6]
    margin = slack if slack < margin else margin
    slack = k5[6] - low5
    margin = slack if slack < margin else margin
    slack = high5 - k5[6]
    margin = slack if slack < margin else margin
    return (
        margin,
        *rps_row(k1, r, sin_a, cos_a, z_beta, z_gamma, scale),
        *rps_row(k2, r, sin_a, cos_a, z_beta, z_gamma, scale),
        *rps_row(k3, r, sin_a, cos_a, z_beta, z_gamma, scale),
        *rps_row(k4, r, sin_a, cos_a, z_beta, z_gamma, scale),
        *rps_row(k5, r, sin_a, cos_a, z_beta, z_gamma, scale),
    )


def rps_stroke(start, end, limb, low, high):  # type: ignore[no-untyped-def]
    """Cut a part of a line along x to a limb's stroke; ``limb`` at x = 0."""
    _, _, _, lx, ly, lz, _ = limb
    return part_within_stroke(start, end, -lx, ly * ly + lz * lz, low, high)


def rps_line(x, y, alpha, beta, gamma, low, high, constants):  # type: ignore[no-untyped-def]
    """Return what the strokes leave of a line along x: l_i^2 is quadratic in x."""
    (
        r1, q, s1y, s1z, s2y, s2z, s3y, s3z, s4y, s4z, s5y, s5z, radius, _,
        low1, high1, low2, high2, low3, high3, low4, high4, low5, high5,
        _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _,
    ) = constants  # fmt: skip
    r, _, _, z, _, _ = rps_place(alpha, beta, gamma, radius)
    part = rps_stroke(low, high, rps_limb(r, 0.0, y, z, s1y, s1z, r1, 0.0), low1, high1)
    part = rps_stroke(part[0], part[1], rps_limb(r, 0.0, y, z, s2y, s2z, q, q), low2, high2)
    part = rps_stroke(part[0], part[1], rps_limb(r, 0.0, y, z, s3y, s3z, -q, q), low3, high3)
    part = rps_stroke(part[0], part[1], rps_limb(r, 0.0, y, z, s4y, s4z, -q, -q), low4, high4)
    return rps_stroke(part[0], part[1], rps_limb(r, 0.0, y, z, s5y, s5z, q, -q), low5, high5)


def rps_in_base(limb, ux, uy, uz):  # type: ignore[no-untyped-def]
    """Return the cosine between a limb and a direction of the base."""
    _, _, _, lx, ly, lz, length = limb
    return (lx * ux + ly * uy + lz * uz) / (length + TINY)


def rps_in_platform(limb, r, vx, vy, vz):  # type: ignore[no-untyped-def]
    """Return the cosine between a limb and a direction of the platform."""
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = r
    return rps_in_base(
        limb,
        r11 * vx + r12 * vy + r13 * vz,
        r21 * vx + r22 * vy + r23 * vz,
        r31 * vx + r32 * vy + r33 * vz,
    )


def rps_skeleton(x, y, alpha, beta, gamma, constants):  # type: ignore[no-untyped-def]
    """Return the platform, the five limbs and the platform's spokes, and the cones."""
    (
        r1, q, s1y, s1z, s2y, s2z, s3y, s3z, s4y, s4z, s5y, s5z, radius, _,
        _, _, _, _, _, _, _, _, _, _,
        u2x, u2y, u2z, u3x, u3y, u3z, u4x, u4y, u4z, u5x, u5y, u5z,
        v1x, v1y, v1z, v2x, v2y, v2z, v3x, v3y, v3z, v4x, v4y, v4z, v5x, v5y, v5z,
    ) = constants  # fmt: skip
    r, _, _, z, _, _ = rps_place(alpha, beta, gamma, radius)
    k1 = rps_limb(r, x, y, z, s1y, s1z, r1, 0.0)
    k2 = rps_limb(r, x, y, z, s2y, s2z, q, q)
    k3 = rps_limb(r, x, y, z, s3y, s3z, -q, q)
    k4 = rps_limb(r, x, y, z, s4y, s4z, -q, -q)
    k5 = rps_limb(r, x, y, z, s5y, s5z, q, -q)
    return (
        x, y, z, *r,
        0.0, r1, 0.0, x + k1[0], y + k1[1], z + k1[2],
        0.0, q, q, x + k2[0], y + k2[1], z + k2[2],
        0.0, -q, q, x + k3[0], y + k3[1], z + k3[2],
        0.0, -q, -q, x + k4[0], y + k4[1], z + k4[2],
        0.0, q, -q, x + k5[0], y + k5[1], z + k5[2],
        x, y, z, x + k1[0], y + k1[1], z + k1[2],
        x, y, z, x + k2[0], y + k2[1], z + k2[2],
        x, y, z, x + k3[0], y + k3[1], z + k3[2],
        x, y, z, x + k4[0], y + k4[1], z + k4[2],
        x, y, z, x + k5[0], y + k5[1], z + k5[2],
        rps_in_base(k2, u2x, u2y, u2z), rps_in_base(k3, u3x, u3y, u3z),
        rps_in_base(k4, u4x, u4y, u4z), rps_in_base(k5, u5x, u5y, u5z),
        rps_in_platform(k1, r, v1x, v1y, v1z), rps_in_platform(k2, r, v2x, v2y, v2z),
        rps_in_platform(k3, r, v3x, v3y, v3z), rps_in_platform(k4, r, v4x, v4y, v4z),
        rps_in_platform(k5, r, v5x, v5y, v5z),
    )  # fmt: skip


def rps_posture(x, y, alpha, beta, gamma, constants):  # type: ignore[no-untyped-def]
    """Return platform, lengths and joints; the first axis of each U is tangential in the base."""
    r1, q = constants[0], constants[1]
    s = rps_skeleton(x, y, alpha, beta, gamma, constants)
    h = 0.7071067811865476
    nx, ny, nz, l1 = unit_vector(s[15], s[16] - r1, s[17])
    l2, k2 = ups_joints(0.0, q, q, s[21], s[22], s[23], 0.0, -h, h)
    l3, k3 = ups_joints(0.0, -q, q, s[27], s[28], s[29], 0.0, -h, -h)
    l4, k4 = ups_joints(0.0, -q, -q, s[33], s[34], s[35], 0.0, h, -h)
    l5, k5 = ups_joints(0.0, q, -q, s[39], s[40], s[41], 0.0, h, h)
    k1 = (0.0, r1, 0.0, 0.0, 0.0, 1.0, 0.0, r1, 0.0, nx, ny, nz, s[15], s[16], s[17])
    return (*s[:12], l1, l2, l3, l4, l5, *k1, *k2, *k3, *k4, *k5)


class UpsRps(Mechanism):
    """The 4-UPS-RPS mechanism."""

    name = "4-ups-rps"
    title = "4-UPS-RPS"
    description = "three rotations and two translations; a platform hung on five telescopic limbs"
    source = "Kinematics Analysis of 4-UPS-RPS Spatial 5-DOF Parallel Mechanism"
    freedom = "3R2T"
    length_unit = "mm"
    default_jacobian = "homogenized"
    length_meaning = "r, the platform's radius: rates of angles become speeds"
    vertical = 0
    parameters = (
        Parameter("R1", "length", 717.0, (500.0, 950.0), True,
                  "radius of T1, the revolute joint of limb 1", _PAPER),
        Parameter("R", "length", 645.0, (450.0, 850.0), True,
                  "radius of T2 .. T5, the universal joints", _PAPER),
        Parameter("r", "length", 202.0, (120.0, 350.0), True,
                  "radius of the platform's spherical joints", _PAPER),
    )  # fmt: skip
    pose = (
        Coordinate("x", "length", "downwards"),
        Coordinate("y", "length", "towards the revolute joint of limb 1"),
        Coordinate("alpha", "angle", "about z"),
        Coordinate("beta", "angle", "about y"),
        Coordinate("gamma", "angle", "about x; pi/2 at home"),
    )
    parasitic = (Coordinate("z", "length", "across; r cos(beta) cos(gamma)"),)
    joints = tuple(Coordinate(f"l{k}", "length", f"length of limb {k}") for k in range(1, 6))
    limbs = (
        Limb("limb 1", "RPS", "R_T1 at T1 along z, telescope l1 (actuated), S_S1 at S1",
             ("R_T1", "l1", "S_S1")),
        *(Limb(f"limb {k}", "UPS", f"U_T{k} at T{k}, telescope l{k} (actuated), S_S{k} at S{k}",
               (f"U_T{k}", f"l{k}", f"S_S{k}"))
          for k in range(2, 6)),
    )  # fmt: skip
    conditions: ClassVar[Mapping[str, str]] = {
        "inverse": "l_k = 0: beyond every stroke",
        "forward": "the lines of the five limbs and limb 1's constraint force are dependent",
    }
    working_modes = ("direct",)
    kernel = staticmethod(rps_kernel)
    constant_count = 51
    line = staticmethod(rps_line)
    line_axis = 0
    line_parts = 1
    skeleton = staticmethod(rps_skeleton)
    segments = (0, 1, 2, 3, 4, *[PLATFORM] * 5)
    spokes = (0, 1, 2, 3, 4)
    posture = staticmethod(rps_posture)
    roles = ("x", "y", "yaw", "pitch", "roll")
    parasitic_roles = ("z",)
    assembler = Assembler(rps_assemble, rps_MODES, 8, rps_WORK)
    completeness = "the real ends of 18 paths and their mirror images; that they are all is checked"
    down = (1.0, 0.0, 0.0)
    cones = (*(f"U_T{k}" for k in range(2, 6)), *(f"S_S{k}" for k in range(1, 6)))

    def characteristic_length(self, parameters: Parameters) -> float:
        """Return r."""
        return _radii(parameters)[2]

    def home(self, parameters: Parameters) -> dict[str, float]:
        """Return the level platform 900 mm below the base, turned a quarter."""
        return {"x": 900.0, "y": 0.0, "alpha": 0.0, "beta": 0.0, "gamma": math.pi / 2}

    def bodies(self, parameters: Parameters) -> tuple[Body, ...]:
        """Return steel cylinders and rods for strokes from 700 to 1300 mm, and a disc."""
        cylinder = tube(60.0, 650.0, _MM, bore=50.0)
        rod = tube(40.0, 650.0, _MM, bore=30.0).at((0.0, 0.0, -650.0))
        platform = disc(2 * _radii(parameters)[2], 20.0, _MM, normal=0)
        return (
            *(cylinder.body(f"{limb.name} cylinder", i, 0) for i, limb in enumerate(self.limbs)),
            *(rod.body(f"{limb.name} rod", i, 1) for i, limb in enumerate(self.limbs)),
            platform.body("platform"),
        )

    def default_limits(self, parameters: Parameters) -> Ranges:
        """Return the strokes, 700 to 1300 mm each (ours: the paper gives none)."""
        return {c.name: _STROKE for c in self.joints}

    def default_domain(self, parameters: Parameters) -> Ranges:
        """Return x > 0, tilts up to 45 degrees and gamma within 60 degrees of home (ours)."""
        tilt, turn = math.pi / 4, math.pi / 3
        return {
            "x": (0.0, math.inf),
            "alpha": (-tilt, tilt),
            "beta": (-tilt, tilt),
            "gamma": (math.pi / 2 - turn, math.pi / 2 + turn),
        }

    def reach_box(self, parameters: Parameters, limits: Ranges) -> tuple[Vector, Vector]:
        """Return the box that |P - T_k| <= longest l_k + r leaves; all orientations."""
        radius = _radii(parameters)[2]
        x, lower, upper = math.inf, -math.inf, math.inf
        for joint, anchor in zip(self.joints, _anchors(parameters), strict=True):
            longest = limits.get(joint.name, (0.0, math.inf))[1] + radius
            x = min(x, longest)
            lower, upper = max(lower, anchor[1] - longest), min(upper, anchor[1] + longest)
        if not math.isfinite(x):
            raise InputError("limits: some limb needs an upper bound")
        if x <= 0 or lower >= upper:
            return np.zeros(5), np.zeros(5)
        angles = (math.pi, math.pi / 2, math.pi)
        return np.array([-x, lower, *(-a for a in angles)]), np.array([x, upper, *angles])

    def reach(self, parameters: Parameters, pose: Mapping[str, float]) -> tuple[Reach, ...]:
        """Return each limb's distance to the end of its stroke."""
        result = []
        for limb, length in zip(self.limbs, self._lengths(parameters, pose), strict=True):
            low, high = _STROKE
            reason = "too close" if length - low < high - length else "too far"
            result.append(Reach(limb.name, min(length - low, high - length), reason))
        return tuple(result)

    def inverse(
        self, parameters: Parameters, pose: Mapping[str, float]
    ) -> tuple[InverseSolution, ...]:
        """Return the limbs' lengths and z."""
        lengths = self._lengths(parameters, pose)
        joints = {c.name: v for c, v in zip(self.joints, lengths, strict=True)}
        z = float(self.platform(parameters, pose)[1][2])
        return (InverseSolution("direct", joints, {"z": z}),)

    def assembly_constants(self, parameters: Parameters) -> list[float]:
        """Return the constants of :func:`rps_assemble`."""
        big1, big, small = _radii(parameters)
        home = self.home(parameters).values()
        return [big1, big / math.sqrt(2), small, *home, *DIMENSIONS, *STARTS]

    def velocity_maps(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> tuple[Matrix, Matrix]:
        """Return J_X = J1 J2 (paper; z' eliminated) and J_q = 1."""
        full = self.full_map(parameters, pose)[:5]
        _, beta, gamma = (pose[k] for k in ("alpha", "beta", "gamma"))
        radius = _radii(parameters)[2]
        twist = np.zeros((6, 5))
        twist[0, 0] = twist[1, 1] = 1.0
        twist[2, 3] = -radius * elementary.sin(beta) * elementary.cos(gamma)
        twist[2, 4] = -radius * elementary.cos(beta) * elementary.sin(gamma)
        twist[3:, 2:] = rotation_matrices(_angles(pose))[1][0]
        return product(full, twist), np.eye(5)

    def full_map(self, parameters: Parameters, pose: Mapping[str, float]) -> Matrix:
        """Return the 6x6 map from (v, omega) to the limbs' rates and limb 1's constraint."""
        rotation, centre = self.platform(parameters, pose)
        arms = product(_points(parameters), rotation.T)
        gaps = centre + arms - _anchors(parameters)
        units = gaps / np.linalg.norm(gaps, axis=1, keepdims=True)
        along = np.array([0.0, 0.0, 1.0])
        rows = np.hstack([units, np.cross(arms, units)])
        return np.vstack([rows, np.concatenate([along, np.cross(arms[0], along)])])

    def singularity_measures(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> dict[str, dict[str, float]]:
        """Return l_k over the longest limb, and the 6x6 determinant over its rows' norms.

        The angular columns of the full map are divided by r.
        """
        full = self.full_map(parameters, pose)
        full[:, 3:] /= _radii(parameters)[2]
        full /= np.linalg.norm(full, axis=1, keepdims=True)
        lengths = self._lengths(parameters, pose)
        longest = max(lengths)
        return {
            "inverse": {limb.name: v / longest
                        for limb, v in zip(self.limbs, lengths, strict=True)},
            "forward": {"platform": float(determinant(full))},
        }  # fmt: skip

    def velocity_map_units(self) -> dict[str, str]:
        """Return the units of J_X's and J_q's entries."""
        return {"J_X": "columns in 1; 1; mm/rad; mm/rad; mm/rad", "J_q": "1"}

    def platform(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Matrix, Vector]:
        """Return Rot and P."""
        z = _radii(parameters)[2] * elementary.cos(pose["beta"]) * elementary.cos(pose["gamma"])
        return rotation_matrices(_angles(pose))[0][0], np.array([pose["x"], pose["y"], z])

    def layout(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Chain, ...]:
        """Return the limbs; the first axis of each U is tangential in the base (ours)."""
        rotation, centre = self.platform(parameters, pose)
        anchors = _anchors(parameters)
        ends = centre + product(_points(parameters), rotation.T)
        chains = []
        for k, (limb, anchor, end) in enumerate(zip(self.limbs, anchors, ends, strict=True)):
            along = (end - anchor) / norm_of(end - anchor)
            if k == 0:
                first = Joint("R", anchor, (np.array([0.0, 0.0, 1.0]),))
            else:
                tangent = np.cross([1.0, 0.0, 0.0], anchor)
                tangent /= norm_of(tangent)
                second = np.cross(tangent, along)
                first = Joint("U", anchor, (tangent, second / norm_of(second)))
            slide = Joint("P", anchor, (along,), drive=(f"l{k + 1}", 0))
            chains.append(Chain(limb.name, (first, slide, Joint("S", end))))
        return tuple(chains)

    def kernel_constants(
        self, parameters: Parameters, working_mode: str, length: float, limits: Ranges
    ) -> list[float]:
        """Return the constants in the order :func:`rps_kernel` unpacks them."""
        big1, big, small = _radii(parameters)
        rotation, centre = self.platform(parameters, self.home(parameters))
        gaps = centre + product(_points(parameters), rotation.T) - _anchors(parameters)
        units = gaps / np.linalg.norm(gaps, axis=1, keepdims=True)
        ends = [limits.get(c.name, (-math.inf, math.inf)) for c in self.joints]
        return [
            big1, big / math.sqrt(2), *_points(parameters)[:, 1:].ravel().tolist(),
            small, 1 / length, *(end for pair in ends for end in pair),
            *units[1:].ravel().tolist(), *product(units, rotation).ravel().tolist(),
        ]  # fmt: skip

    def _lengths(self, parameters: Parameters, pose: Mapping[str, float]) -> list[float]:
        rotation, centre = self.platform(parameters, pose)
        gaps = centre + product(_points(parameters), rotation.T) - _anchors(parameters)
        return [float(v) for v in np.linalg.norm(gaps, axis=1)]


def _radii(parameters: Parameters) -> tuple[float, float, float]:
    """Return R1, R, r."""
    big1, big, small = (float(parameters[k] or 0.0) for k in ("R1", "R", "r"))
    return big1, big, small


def _anchors(parameters: Parameters) -> Matrix:
    """Return T_1 .. T_5, a row each."""
    big1, big, _ = _radii(parameters)
    side = big / math.sqrt(2)
    return np.array([
        [0.0, big1, 0.0], [0.0, side, side], [0.0, -side, side], [0.0, -side, -side],
        [0.0, side, -side],
    ])  # fmt: skip


def _points(parameters: Parameters) -> Matrix:
    """Return S_1 .. S_5 in the platform, a row each."""
    small = _radii(parameters)[2]
    turns = 2 * math.pi / 5 * np.arange(5)
    sine, cosine = elementary.sin_cos_of(turns)
    return np.stack([0 * turns, small * sine, -small * cosine], axis=1)


def _angles(pose: Mapping[str, float]) -> NDArray[np.float64]:
    return np.array([[pose["alpha"], pose["beta"], pose["gamma"]]])


MECHANISM = UpsRps()

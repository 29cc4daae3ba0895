"""3-UPS/SP: three rotations and one translation, three UPS limbs around an SP one.

Symbols as in the paper on the workspace of the 3-UPS/SP mechanism: A, a, phi, theta, psi, l.
Base corners A_i and platform corners b_i, counter-clockwise as seen from +z::

    A1 = (A/2, -A/2, 0)  A2 = (A/2, A/2, 0)  A3 = (-A/2, A/2, 0)  A4 = (-A/2, -A/2, 0)

The platform is rigid on limb 4 and perpendicular to it. With R = Rz(phi) Ry(theta) Rx(psi)::

    P = A4 + R ((0, 0, l4) - b_4)      B_i = P + R b_i      l_i = |B_i - A_i|, i = 1, 2, 3

Two parameters are ours. With e_i = b_i - b_4, ``kite`` k sets e_2 = k (e_1 + e_3), 1 for the
paper's square; ``twist`` turns the platform about its normal, through its centre, 0 in the paper.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pmopt.compiler.programs import Assembler
from pmopt.errors import InputError
from pmopt.kernels.limbs import ups_joints
from pmopt.kernels.octics import bernstein, nodes
from pmopt.kernels.strokes import part_within_stroke
from pmopt.kernels.trigonometry import roll_pitch_yaw, sin_cos
from pmopt.mechanisms.bodies import Body, plate, tube
from pmopt.mechanisms.catalogue.ups_sp_forward import sp_assemble, sp_MODES, sp_WORK
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
from pmopt.numerics.matrices import determinant, norm_of, product
from pmopt.numerics.rotation import rotation_matrices

TINY = 1e-300

_PAPER = "paper, section 4"
_STROKE = (45.0, 90.0)
_MM = 1e-3


def sp_limb(r, half_x, half_y, base, l4, ex, ey):  # type: ignore[no-untyped-def]
    """Return s_i = R ((0, 0, l4) + e_i) and B_i - A_i of a limb with A_i = (half_x, half_y, 0).

    ``base`` is A/2; r the rotation row by row.
    """
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = r
    sx = r11 * ex + r12 * ey + r13 * l4
    sy = r21 * ex + r22 * ey + r23 * l4
    sz = r31 * ex + r32 * ey + r33 * l4
    return sx, sy, sz, sx - base - half_x, sy - base - half_y, sz


def sp_row(s, r, sin_phi, cos_phi, scale):  # type: ignore[no-untyped-def]
    """Return l_i and its rates by phi, theta, psi (times scale) and l4."""
    sx, sy, sz, nx, ny, nz = s
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    unit = 1.0 / (length + TINY)
    # (s x n) is the moment that omega is multiplied with.
    mx = (sy * nz - sz * ny) * unit
    my = (sz * nx - sx * nz) * unit
    mz = (sx * ny - sy * nx) * unit
    r11, _, r13, r21, _, r23, r31, _, r33 = r
    return (
        length,
        mz * scale,
        (my * cos_phi - mx * sin_phi) * scale,
        (mx * r11 + my * r21 + mz * r31) * scale,
        (nx * r13 + ny * r23 + nz * r33) * unit,
    )


def sp_kernel(phi, theta, psi, l4, constants):  # type: ignore[no-untyped-def]
    """Return the margin, the least distance to a stroke's end, and J^-1 of the length rates.

    Row i is (s_i x n_i).omega + (n_i.k) l4' with omega from the rates of phi, theta, psi.
    """
    (
        base, e1x, e1y, e2x, e2y, e3x, e3y, _, _, scale,
        low1, high1, low2, high2, low3, high3, low4, high4,
        _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _,
    ) = constants  # fmt: skip
    r = roll_pitch_yaw(phi, theta, psi)
    sin_phi, cos_phi = sin_cos(phi)
    l1, a11, a12, a13, a14 = sp_row(
        sp_limb(r, base, -base, base, l4, e1x, e1y), r, sin_phi, cos_phi, scale
    )
    l2, a21, a22, a23, a24 = sp_row(
        sp_limb(r, base, base, base, l4, e2x, e2y), r, sin_phi, cos_phi, scale
    )
    l3, a31, a32, a33, a34 = sp_row(
        sp_limb(r, -base, base, base, l4, e3x, e3y), r, sin_phi, cos_phi, scale
    )
    margin = l1 - low1
    slack = high1 - l1
    margin = slack if slack < margin else margin
    slack = l2 - low2
    margin = slack if slack < margin else margin
    slack = high2 - l2
    margin = slack if slack < margin else margin
    slack = l3 - low3
    margin = slack if slack < margin else margin
    slack = high3 - l3
    margin = slack if slack < margin else margin
    slack = l4 - low4
    margin = slack if slack < margin else margin
    slack = high4 - l4
    margin = slack if slack < margin else margin
    return (
        margin,
        a11, a12, a13, a14,
        a21, a22, a23, a24,
        a31, a32, a33, a34,
        0.0, 0.0, 0.0, 1.0,
    )  # fmt: skip


def sp_stroke(start, end, r, limb, low, high):  # type: ignore[no-untyped-def]
    """Cut a part of a line along l4 to a limb's stroke; ``limb`` at l4 = 0."""
    _, _, _, nx, ny, nz = limb
    along = nx * r[2] + ny * r[5] + nz * r[8]
    across2 = nx * nx + ny * ny + nz * nz - along * along
    return part_within_stroke(start, end, -along, across2, low, high)


def sp_line(phi, theta, psi, l4, low, high, constants):  # type: ignore[no-untyped-def]
    """Return what the strokes leave of a line along l4: l_i^2 is quadratic in l4."""
    (
        base, e1x, e1y, e2x, e2y, e3x, e3y, _, _, _,
        low1, high1, low2, high2, low3, high3, low4, high4,
        _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _,
    ) = constants  # fmt: skip
    r = roll_pitch_yaw(phi, theta, psi)
    start = low4 if low4 > low else low
    end = high4 if high4 < high else high
    start, end = sp_stroke(start, end, r, sp_limb(r, base, -base, base, 0.0, e1x, e1y), low1, high1)
    start, end = sp_stroke(start, end, r, sp_limb(r, base, base, base, 0.0, e2x, e2y), low2, high2)
    return sp_stroke(start, end, r, sp_limb(r, -base, base, base, 0.0, e3x, e3y), low3, high3)


def sp_cones(s, r, ux, uy, uz, vx, vy, vz):  # type: ignore[no-untyped-def]
    """Return the cosines between a limb and its reference in the base and in the platform."""
    _, _, _, nx, ny, nz = s
    unit = 1.0 / (math.sqrt(nx * nx + ny * ny + nz * nz) + TINY)
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = r
    wx = r11 * vx + r12 * vy + r13 * vz
    wy = r21 * vx + r22 * vy + r23 * vz
    wz = r31 * vx + r32 * vy + r33 * vz
    return (nx * ux + ny * uy + nz * uz) * unit, (nx * wx + ny * wy + nz * wz) * unit


def sp_skeleton(phi, theta, psi, l4, constants):  # type: ignore[no-untyped-def]
    """Return the platform, the four limbs and the platform's spokes, and the cones."""
    (
        base, e1x, e1y, e2x, e2y, e3x, e3y, b4x, b4y, _,
        _, _, _, _, _, _, _, _,
        u1x, u1y, u1z, v1x, v1y, v1z, u2x, u2y, u2z, v2x, v2y, v2z,
        u3x, u3y, u3z, v3x, v3y, v3z, kx, ky, kz,
    ) = constants  # fmt: skip
    r = roll_pitch_yaw(phi, theta, psi)
    s1 = sp_limb(r, base, -base, base, l4, e1x, e1y)
    s2 = sp_limb(r, base, base, base, l4, e2x, e2y)
    s3 = sp_limb(r, -base, base, base, l4, e3x, e3y)
    s4 = sp_limb(r, -base, -base, base, l4, 0.0, 0.0)
    centre = sp_limb(r, -base, -base, base, l4, -b4x, -b4y)
    px, py, pz = centre[0] - base, centre[1] - base, centre[2]
    c1, d1 = sp_cones(s1, r, u1x, u1y, u1z, v1x, v1y, v1z)
    c2, d2 = sp_cones(s2, r, u2x, u2y, u2z, v2x, v2y, v2z)
    c3, d3 = sp_cones(s3, r, u3x, u3y, u3z, v3x, v3y, v3z)
    return (
        px, py, pz, *r,
        base, -base, 0.0, s1[0] - base, s1[1] - base, s1[2],
        base, base, 0.0, s2[0] - base, s2[1] - base, s2[2],
        -base, base, 0.0, s3[0] - base, s3[1] - base, s3[2],
        -base, -base, 0.0, s4[0] - base, s4[1] - base, s4[2],
        px, py, pz, s1[0] - base, s1[1] - base, s1[2],
        px, py, pz, s2[0] - base, s2[1] - base, s2[2],
        px, py, pz, s3[0] - base, s3[1] - base, s3[2],
        px, py, pz, s4[0] - base, s4[1] - base, s4[2],
        c1, c2, c3, d1, d2, d3, r[2] * kx + r[5] * ky + r[8] * kz,
    )  # fmt: skip


def sp_posture(phi, theta, psi, l4, constants):  # type: ignore[no-untyped-def]
    """Return platform, lengths and joints; the first axis of each U is tangential in the base."""
    base = constants[0]
    s = sp_skeleton(phi, theta, psi, l4, constants)
    q = 0.7071067811865476
    l1, k1 = ups_joints(base, -base, 0.0, s[15], s[16], s[17], q, q, 0.0)
    l2, k2 = ups_joints(base, base, 0.0, s[21], s[22], s[23], -q, q, 0.0)
    l3, k3 = ups_joints(-base, base, 0.0, s[27], s[28], s[29], -q, -q, 0.0)
    post = (-base, -base, 0.0, -base, -base, 0.0, s[5], s[8], s[11])
    return (*s[:12], l1, l2, l3, l4, *k1, *k2, *k3, *post)


class UpsSp(Mechanism):
    """The 3-UPS/SP mechanism."""

    name = "3-ups-sp"
    title = "3-UPS/SP"
    description = "three rotations and one translation; a rotary table on a telescopic post"
    source = "Inverse Kinematics and Reachable Workspace of 3-UPS/SP Parallel Mechanism"
    freedom = "3R1T"
    length_unit = "mm"
    default_jacobian = "homogenized"
    length_meaning = "a / sqrt 2, the platform's radius: rates of angles become speeds"
    parameters = (
        Parameter("A", "length", 35.0, (25.0, 60.0), True, "side of the base square", _PAPER),
        Parameter("a", "length", 20.0, (10.0, 40.0), True, "side of the platform square", _PAPER),
        Parameter("kite", "ratio", 1.0, (0.4, 1.0), True,
                  "diagonal from corner 4 to corner 2, as a share of the square's", "ours"),
        Parameter("twist", "angle", 0.0, (0.0, 0.8), False,
                  "turn of the platform about its normal", "ours"),
    )  # fmt: skip
    pose = (
        Coordinate("phi", "angle", "yaw, about z"),
        Coordinate("theta", "angle", "pitch, about y"),
        Coordinate("psi", "angle", "roll, about x"),
        Coordinate("l4", "length", "length of limb 4, along the platform's normal"),
    )
    joints = (
        Coordinate("l1", "length", "length of limb 1"),
        Coordinate("l2", "length", "length of limb 2"),
        Coordinate("l3", "length", "length of limb 3"),
        Coordinate("l4", "length", "length of limb 4"),
    )
    limbs = (
        *(
            Limb(
                f"limb {k}", "UPS", f"U_A{k} at A{k}, telescope l{k} (actuated), S_B{k} at B{k}",
                (f"U_A{k}", f"l{k}", f"S_B{k}"),
            )
            for k in range(1, 4)
        ),
        Limb(
            "limb 4", "SP", "S_A4 at A4, telescope l4 (actuated) across the platform",
            ("S_A4", "l4"),
        ),
    )  # fmt: skip
    conditions: ClassVar[Mapping[str, str]] = {
        "inverse": "l_i = 0: beyond every stroke",
        "forward": "the moments of limbs 1, 2 and 3 about A4 are dependent: they do not hold all "
        "rotations",
    }
    working_modes = ("direct",)
    kernel = staticmethod(sp_kernel)
    constant_count = 39
    line = staticmethod(sp_line)
    line_axis = 3
    line_parts = 1
    skeleton = staticmethod(sp_skeleton)
    segments = (0, 1, 2, 3, PLATFORM, PLATFORM, PLATFORM, PLATFORM)
    spokes = (0, 1, 2, 3)
    posture = staticmethod(sp_posture)
    roles = ("yaw", "pitch", "roll", "l4")
    assembler = Assembler(sp_assemble, sp_MODES, 6, sp_WORK)
    completeness = "by a polynomial of degree 8, whose real roots are counted"
    cones = ("U_A1", "U_A2", "U_A3", "S_B1", "S_B2", "S_B3", "S_A4")

    def characteristic_length(self, parameters: Parameters) -> float:
        """Return a / sqrt 2."""
        return float(parameters["a"] or 0.0) / math.sqrt(2)

    def home(self, parameters: Parameters) -> dict[str, float]:
        """Return a tilted pose in the middle of the strokes: the level ones are singular."""
        return {"phi": 0.0, "theta": 0.2, "psi": -0.1, "l4": 60.0}

    def bodies(self, parameters: Parameters) -> tuple[Body, ...]:
        """Return steel cylinders and rods that the paper's strokes leave room for, and a plate."""
        _, platform = _corners(parameters)
        cylinder = tube(6.0, 40.0, _MM, bore=4.0)
        rod = tube(3.0, 45.0, _MM).at((0.0, 0.0, -45.0))
        side = float(parameters["a"] or 0.0)
        x, y, _ = platform[3]
        return (
            *(cylinder.body(f"{limb.name} cylinder", i, 0) for i, limb in enumerate(self.limbs)),
            *(rod.body(f"{limb.name} rod", i, 1) for i, limb in enumerate(self.limbs[:3])),
            rod.at((x, y, 0.0)).body("limb 4 rod"),
            plate((side, side, 2.0), _MM).body("platform"),
        )

    def default_limits(self, parameters: Parameters) -> Ranges:
        """Return the paper's strokes."""
        return {c.name: _STROKE for c in self.joints}

    def default_domain(self, parameters: Parameters) -> Ranges:
        """Return phi within a quarter turn, theta and psi within 60 degrees (ours)."""
        tilt = math.pi / 3
        return {
            "phi": (-math.pi / 2, math.pi / 2),
            "theta": (-tilt, tilt),
            "psi": (-tilt, tilt),
        }

    def reach_box(self, parameters: Parameters, limits: Ranges) -> tuple[Vector, Vector]:
        """Return all orientations, and l4 within its stroke and what the other limbs leave."""
        base, platform = _corners(parameters)
        low, high = limits.get("l4", (0.0, math.inf))
        for i in range(3):
            shortest, longest = limits.get(f"l{i + 1}", (0.0, math.inf))
            span = norm_of(base[i] - base[3]) + norm_of(platform[i] - platform[3])
            low, high = max(low, shortest - float(span)), min(high, longest + float(span))
        if not math.isfinite(high):
            raise InputError("limits: l4 needs an upper bound, or another limb one")
        angles = np.array([math.pi, math.pi / 2, math.pi])
        return np.array([*-angles, max(low, 0.0)]), np.array([*angles, high])

    def reach(self, parameters: Parameters, pose: Mapping[str, float]) -> tuple[Reach, ...]:
        """Return each limb's distance to the end of its stroke."""
        result = []
        for limb, length in zip(self.limbs, self._lengths(parameters, pose), strict=True):
            low, high = _STROKE
            near = length - low < high - length
            reason = "too close" if near else "too far"
            result.append(Reach(limb.name, min(length - low, high - length), reason))
        return tuple(result)

    def inverse(
        self, parameters: Parameters, pose: Mapping[str, float]
    ) -> tuple[InverseSolution, ...]:
        """Return the limbs' lengths."""
        lengths = self._lengths(parameters, pose)
        joints = {f"l{i + 1}": length for i, length in enumerate(lengths)}
        return (InverseSolution("direct", joints, {}),)

    def assembly_constants(self, parameters: Parameters) -> list[float]:
        """Return the constants of :func:`sp_assemble`."""
        base, platform = _corners(parameters)
        home = self.home(parameters)
        return [
            *(base[:3] - base[3]).ravel().tolist(),
            *(platform[:3, :2] - platform[3, :2]).ravel().tolist(),
            *(home[k] for k in ("phi", "theta", "psi")), *nodes(), *bernstein(),
        ]  # fmt: skip

    def velocity_maps(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> tuple[Matrix, Matrix]:
        """Return J_X = [(s_i x n_i) axes, n_i.k; 0, 1] and J_q = 1."""
        arms, gaps, rotation, axes = self._vectors(parameters, pose)
        units = gaps / np.linalg.norm(gaps, axis=1, keepdims=True)
        j_x = np.zeros((4, 4))
        j_x[:3, :3] = product(np.cross(arms, units), axes)
        j_x[:3, 3] = product(units, rotation[:, 2])
        j_x[3, 3] = 1.0
        return j_x, np.eye(4)

    def singularity_measures(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> dict[str, dict[str, float]]:
        """Return l_i over the longest limb, and det[(s_i x n_i) / |s_i|], both in [-1, 1]."""
        arms, gaps, _, _ = self._vectors(parameters, pose)
        units = gaps / np.linalg.norm(gaps, axis=1, keepdims=True)
        rows = np.cross(arms, units) / np.linalg.norm(arms, axis=1, keepdims=True)
        lengths = self._lengths(parameters, pose)
        longest = max(lengths)
        return {
            "inverse": {limb.name: v / longest
                        for limb, v in zip(self.limbs, lengths, strict=True)},
            "forward": {"platform": float(determinant(rows))},
        }  # fmt: skip

    def velocity_map_units(self) -> dict[str, str]:
        """Return the units of J_X's and J_q's entries."""
        return {"J_X": "columns in mm/rad; mm/rad; mm/rad; 1", "J_q": "1"}

    def platform(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Matrix, Vector]:
        """Return R and P."""
        base, platform = _corners(parameters)
        rotation = rotation_matrices(_angles(pose))[0][0]
        return rotation, base[3] + product(rotation, np.array([0.0, 0.0, pose["l4"]]) - platform[3])

    def layout(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Chain, ...]:
        """Return the limbs; the first axis of each U is tangential in the base (ours)."""
        base, platform = _corners(parameters)
        rotation, centre = self.platform(parameters, pose)
        chains = []
        for i in range(3):
            end = centre + product(rotation, platform[i])
            along = (end - base[i]) / norm_of(end - base[i])
            first = np.cross([0.0, 0.0, 1.0], base[i])
            first /= norm_of(first)
            second = np.cross(first, along)
            chains.append(
                Chain(
                    self.limbs[i].name,
                    (
                        Joint("U", base[i], (first, second / norm_of(second))),
                        Joint("P", base[i], (along,), drive=(f"l{i + 1}", 0)),
                        Joint("S", end),
                    ),
                )
            )
        post = Joint("P", base[3], (rotation[:, 2],), drive=("l4", 0))
        return (*chains, Chain(self.limbs[3].name, (Joint("S", base[3]), post)))

    def kernel_constants(
        self, parameters: Parameters, working_mode: str, length: float, limits: Ranges
    ) -> list[float]:
        """Return the constants in the order :func:`sp_kernel` unpacks them."""
        _, platform = _corners(parameters)
        arms = platform[:3] - platform[3]
        _, gaps, rotation, _ = self._vectors(parameters, self.home(parameters))
        units = gaps / np.linalg.norm(gaps, axis=1, keepdims=True)
        references = np.hstack([units, product(units, rotation)]).ravel()
        ends = [limits.get(c.name, (-math.inf, math.inf)) for c in self.joints]
        return [
            float(parameters["A"] or 0.0) / 2,
            *arms[:, :2].ravel().tolist(), *platform[3, :2].tolist(), 1 / length,
            *(end for pair in ends for end in pair),
            *references.tolist(), *rotation[:, 2].tolist(),
        ]  # fmt: skip

    def _vectors(
        self, parameters: Parameters, pose: Mapping[str, float]
    ) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """Return s_i and B_i - A_i of limbs 1 to 3, the rotation and the axes of its rates."""
        base, platform = _corners(parameters)
        rotations, axes = rotation_matrices(_angles(pose))
        local = platform[:3] - platform[3] + np.array([0.0, 0.0, pose["l4"]])
        arms = product(local, rotations[0].T)
        return arms, arms - (base[:3] - base[3]), rotations[0], axes[0]

    def _lengths(self, parameters: Parameters, pose: Mapping[str, float]) -> list[float]:
        gaps = self._vectors(parameters, pose)[1]
        return [*np.linalg.norm(gaps, axis=1).tolist(), pose["l4"]]


def _corners(parameters: Parameters) -> tuple[Matrix, Matrix]:
    """Return A_i in the base and b_i in the platform, a row each."""
    square = np.array([[1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]]) / 2
    big, small, kite, twist = (float(parameters[k] or 0.0) for k in ("A", "a", "kite", "twist"))
    platform = small * square
    platform[1] = platform[3] + kite * (platform[0] + platform[2] - 2 * platform[3])
    turn = rotation_matrices(np.array([[twist, 0.0, 0.0]]))[0][0]
    return big * square, product(platform, turn.T)


def _angles(pose: Mapping[str, float]) -> NDArray[np.float64]:
    return np.array([[pose["phi"], pose["theta"], pose["psi"]]])


MECHANISM = UpsSp()

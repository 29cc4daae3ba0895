"""3-RRR, planar: two translations and a turn, for tests."""

import math
from typing import ClassVar

import numpy as np

from pmopt.kernels.trigonometry import arc_tangent, sin_cos
from pmopt.mechanisms.bodies import plate, tube
from pmopt.mechanisms.mechanism import (
    PLATFORM,
    Chain,
    Coordinate,
    ForwardSolution,
    InverseSolution,
    Joint,
    Limb,
    Mechanism,
    Parameter,
    Reach,
    wrap_angle,
)

AT = tuple(
    (math.cos(v), math.sin(v)) for v in (math.pi / 2 + k * 2 * math.pi / 3 for k in range(3))
)
C1, S1, C2, S2, C3, S3 = (float(v) for pair in AT for v in pair)


def crank(dx, dy, l1, excess, sign):
    """Return what is left of the root, the signed root and the tip, from the pivot."""
    r2 = dx * dx + dy * dy
    c = 0.5 * (r2 + excess)
    square = l1 * l1 * r2 - c * c
    root = sign * math.sqrt(square if square > 0.0 else 0.0)
    over = 1.0 / (r2 + 1e-300)
    return square, root, (c * dx - root * dy) * over, (c * dy + root * dx) * over


def limb(x, y, sine, cosine, big, small, c, s, l1, excess, sign):
    """Return root, A, B, C of a limb in the plane, and the arm from the platform's centre."""
    bx, by = small * (cosine * c - sine * s), small * (sine * c + cosine * s)
    square, root, p, q = crank(x + bx - big * c, y + by - big * s, l1, excess, sign)
    return square, root, big * c, big * s, big * c + p, big * s + q, x + bx, y + by, bx, by


def kernel(x, y, phi, constants):
    big, small, l1, _, excess, sign, weight, c1, s1, e1, c2, s2, e2, c3, s3, e3 = constants
    sine, cosine = sin_cos(phi)
    g1 = limb(x, y, sine, cosine, big, small, C1, S1, l1, excess, sign)
    g2 = limb(x, y, sine, cosine, big, small, C2, S2, l1, excess, sign)
    g3 = limb(x, y, sine, cosine, big, small, C3, S3, l1, excess, sign)
    margin = g1[0] if g1[0] < g2[0] else g2[0]
    margin = g3[0] if g3[0] < margin else margin
    slack1 = c1 * (g1[4] - g1[2]) + s1 * (g1[5] - g1[3]) - e1
    slack2 = c2 * (g2[4] - g2[2]) + s2 * (g2[5] - g2[3]) - e2
    slack3 = c3 * (g3[4] - g3[2]) + s3 * (g3[5] - g3[3]) - e3
    margin = min(margin, slack1, slack2, slack3)
    u1, v1, u2, v2, u3, v3 = (
        g1[6] - g1[4], g1[7] - g1[5], g2[6] - g2[4], g2[7] - g2[5], g3[6] - g3[4], g3[7] - g3[5],
    )  # fmt: skip
    h1, h2, h3 = g2[1] * g3[1], g1[1] * g3[1], g1[1] * g2[1]
    return (
        margin,
        h1 * u1, h1 * v1, h1 * (g1[8] * v1 - g1[9] * u1) * weight,
        h2 * u2, h2 * v2, h2 * (g2[8] * v2 - g2[9] * u2) * weight,
        h3 * u3, h3 * v3, h3 * (g3[8] * v3 - g3[9] * u3) * weight,
    )  # fmt: skip


def skeleton(x, y, phi, constants):
    big, small, l1, _, excess, sign, _, _, _, _, _, _, _, _, _, _ = constants
    sine, cosine = sin_cos(phi)
    g1 = limb(x, y, sine, cosine, big, small, C1, S1, l1, excess, sign)
    g2 = limb(x, y, sine, cosine, big, small, C2, S2, l1, excess, sign)
    g3 = limb(x, y, sine, cosine, big, small, C3, S3, l1, excess, sign)
    return (
        x, y, 0.0, cosine, -sine, 0.0, sine, cosine, 0.0, 0.0, 0.0, 1.0,
        g1[2], g1[3], 0.0, g1[4], g1[5], 0.0, g1[4], g1[5], 0.0, g1[6], g1[7], 0.0,
        g2[2], g2[3], 0.0, g2[4], g2[5], 0.0, g2[4], g2[5], 0.0, g2[6], g2[7], 0.0,
        g3[2], g3[3], 0.0, g3[4], g3[5], 0.0, g3[4], g3[5], 0.0, g3[6], g3[7], 0.0,
        x, y, 0.0, g1[6], g1[7], 0.0, x, y, 0.0, g2[6], g2[7], 0.0, x, y, 0.0, g3[6], g3[7], 0.0,
    )  # fmt: skip


def posture(x, y, phi, constants):
    s = skeleton(x, y, phi, constants)
    return (
        *s[:12],
        arc_tangent(s[16] - s[13], s[15] - s[12]), arc_tangent(s[28] - s[25], s[27] - s[24]),
        arc_tangent(s[40] - s[37], s[39] - s[36]),
        *s[12:15], 0.0, 0.0, 1.0, *s[15:18], 0.0, 0.0, 1.0, *s[21:24], 0.0, 0.0, 1.0,
        *s[24:27], 0.0, 0.0, 1.0, *s[27:30], 0.0, 0.0, 1.0, *s[33:36], 0.0, 0.0, 1.0,
        *s[36:39], 0.0, 0.0, 1.0, *s[39:42], 0.0, 0.0, 1.0, *s[45:48], 0.0, 0.0, 1.0,
    )  # fmt: skip


class Planar(Mechanism):
    """3-RRR."""

    name = "3-rrr"
    title = "3-RRR"
    description = "two translations and a turn in a plane"
    source = "for tests"
    freedom = "2T1R"
    length_unit = "m"
    default_jacobian = "homogenized"
    length_meaning = "r, the platform's radius"
    parameters = (
        Parameter("R", "length", 0.5, (0.3, 0.8), True, "base radius", "ours"),
        Parameter("r", "length", 0.15, (0.05, 0.3), True, "platform radius", "ours"),
        Parameter("l1", "length", 0.35, (0.2, 0.5), True, "crank", "ours"),
        Parameter("l2", "length", 0.4, (0.2, 0.5), True, "link", "ours"),
    )
    pose = (
        Coordinate("x", "length", "along x"),
        Coordinate("y", "length", "along y"),
        Coordinate("phi", "angle", "turn about z"),
    )
    joints = tuple(Coordinate(f"theta{k}", "angle", f"crank {k}") for k in (1, 2, 3))
    limbs = tuple(
        Limb(f"limb {k}", "RRR", f"theta{k} (actuated), R_B{k}, R_C{k}",
             (f"theta{k}", f"R_B{k}", f"R_C{k}"))
        for k in (1, 2, 3)
    )  # fmt: skip
    conditions: ClassVar = {"inverse": "crank and link in line", "forward": "links meet in a point"}
    working_modes = ("left", "right")
    kernel = staticmethod(kernel)
    constant_count = 16
    skeleton = staticmethod(skeleton)
    posture = staticmethod(posture)
    segments = (0, 0, 1, 1, 2, 2, PLATFORM, PLATFORM, PLATFORM)
    spokes = (0, 1, 2)
    roles = ("x", "y", "yaw")

    def characteristic_length(self, parameters):
        return parameters["r"]

    def reach_box(self, parameters, limits):
        far = parameters["l1"] + parameters["l2"] + parameters["r"]
        base = parameters["R"] * np.array(AT)
        low, high = (base - far).max(axis=0), (base + far).min(axis=0)
        return np.array([*low, -math.pi]), np.array([*high, math.pi])

    def default_domain(self, parameters):
        return {"phi": (-1.0, 1.0)}

    def home(self, parameters):
        return {"x": 0.02, "y": 0.01, "phi": 0.3}

    def bodies(self, parameters):
        tubes = [
            tube(0.02, parameters[p], 1.0).body(f"{p} of {k + 1}", k, j)
            for k in range(3)
            for j, p in enumerate(("l1", "l2"))
        ]
        return (*tubes, plate((0.2, 0.2, 0.01), 1.0).body("platform"))

    def _flat(self, parameters, pose, mode=None):
        constants = self.kernel_constants(parameters, self.check_mode(mode), 1.0, {})
        return skeleton(*pose.values(), constants)

    def platform(self, parameters, pose, working_mode=None):
        flat = self._flat(parameters, pose, working_mode)
        return np.reshape(flat[3:12], (3, 3)), np.array(flat[:3])

    def layout(self, parameters, pose, working_mode=None):
        ends = np.reshape(self._flat(parameters, pose, working_mode)[12:48], (3, 2, 2, 3))
        z = (np.array([0.0, 0.0, 1.0]),)
        return tuple(
            Chain(f"limb {k + 1}", (Joint("R", e[0, 0], z, drive=(f"theta{k + 1}", 0)),
                                    Joint("R", e[0, 1], z), Joint("R", e[1, 1], z)))
            for k, e in enumerate(ends)
        )  # fmt: skip

    def reach(self, parameters, pose):
        ends = np.reshape(self._flat(parameters, pose)[12:48], (3, 2, 2, 3))
        found = []
        for k, e in enumerate(ends):
            r = float(np.linalg.norm(e[1, 1] - e[0, 0]))
            far = parameters["l1"] + parameters["l2"] - r
            near = r - abs(parameters["l1"] - parameters["l2"])
            text = "too far" if far < near else "too close"
            found.append(Reach(f"limb {k + 1}", min(far, near), text))
        return tuple(found)

    def inverse(self, parameters, pose):
        if any(r.distance < 0 for r in self.reach(parameters, pose)):
            return ()
        found = []
        for mode in self.working_modes:
            ends = np.reshape(self._flat(parameters, pose, mode)[12:48], (3, 2, 2, 3))
            joints = {}
            for k, e in enumerate(ends):
                along = e[0, 1] - e[0, 0]
                joints[f"theta{k + 1}"] = wrap_angle(math.atan2(along[1], along[0]))
            found.append(InverseSolution(mode, joints, {}))
        return tuple(found)

    def forward(self, parameters, joints):
        """Newton's method from home, for both modes at once: the links' lengths are kept."""
        tips = [
            parameters["R"] * np.array(at) + parameters["l1"] * np.array([math.cos(t), math.sin(t)])
            for at, t in zip(AT, joints.values(), strict=True)
        ]
        found = []
        random = np.random.default_rng(1)
        for trial in range(80):
            pose = np.array(list(self.home(parameters).values()))
            pose = pose + (trial > 0) * random.uniform(-0.3, 0.3, 3) * [1, 1, 8]
            for _ in range(40):
                rows, gaps = [], []
                for at, tip in zip(AT, tips, strict=True):
                    c, s = math.cos(pose[2]), math.sin(pose[2])
                    arm = parameters["r"] * np.array([c * at[0] - s * at[1], s * at[0] + c * at[1]])
                    u = pose[:2] + arm - tip
                    rows.append([u[0], u[1], arm[0] * u[1] - arm[1] * u[0]])
                    gaps.append((parameters["l2"] ** 2 - u @ u) / 2)
                pose = pose + np.linalg.solve(rows, gaps)
                if np.abs(gaps).max() < 1e-14:
                    break
            pose[2] = wrap_angle(pose[2])
            if np.abs(gaps).max() < 1e-12 and all(np.abs(pose - p).max() > 1e-6 for p, _ in found):
                found.append((pose, float(np.abs(gaps).max())))
        return tuple(
            ForwardSolution(dict(zip("x y phi".split(), p.tolist(), strict=True)), {}, gap)  # noqa: SIM905
            for p, gap in found
        )

    def velocity_maps(self, parameters, pose, joints):
        rows, drives = [], []
        c, s = math.cos(pose["phi"]), math.sin(pose["phi"])
        for at, t in zip(AT, joints.values(), strict=True):
            e = parameters["l1"] * np.array([math.cos(t), math.sin(t)])
            arm = parameters["r"] * np.array([c * at[0] - s * at[1], s * at[0] + c * at[1]])
            u = np.array([pose["x"], pose["y"]]) + arm - parameters["R"] * np.array(at) - e
            rows.append([u[0], u[1], arm[0] * u[1] - arm[1] * u[0]])
            drives.append(-u[0] * e[1] + u[1] * e[0])
        return np.array(rows), np.diag(drives)

    def singularity_measures(self, parameters, pose, joints):
        j_x, j_q = self.velocity_maps(parameters, pose, joints)
        scale = parameters["l1"] * parameters["l2"]
        forward = j_x / parameters["l2"] / [1, 1, parameters["r"]]
        return {
            "inverse": {f"limb {k + 1}": float(j_q[k, k]) / scale for k in range(3)},
            "forward": {"platform": float(np.linalg.det(forward)) / 2},
        }

    def velocity_map_units(self):
        return {"J_X": "columns in m; m; m^2/rad", "J_q": "m^2/rad"}

    def kernel_constants(self, parameters, working_mode, length, limits):
        big, small, l1, l2 = (parameters[k] for k in ("R", "r", "l1", "l2"))
        sign = 1.0 if working_mode == "left" else -1.0
        arcs = []
        for joint in self.joints:
            low, high = limits.get(joint.name, (-math.pi, math.pi))
            middle, half = (low + high) / 2, (high - low) / 2
            least = -math.inf if half >= math.pi else l1 * math.cos(half)
            arcs += [math.cos(middle), math.sin(middle), least]
        return [big, small, l1, l2, (l1 - l2) * (l1 + l2), sign, 1.0 / length, *arcs]


MECHANISM = Planar()

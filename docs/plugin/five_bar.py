"""A plug-in: the planar five-bar, RRRRR, whose point P moves in the plane x y.

    A1 = (-a, 0), A2 = (a, 0),  B_i = A_i + l1 (cos t_i, sin t_i),  |P - B_i| = l2

With d = P - A_i, r = |d| and c = (r^2 + l1^2 - l2^2) / 2 the crank is
B_i - A_i = (c d + s S d') / r^2, S = sqrt(l1^2 r^2 - c^2), d' = (-d_y, d_x) and s the sign of the
working mode. The platform is limb 2's second link: its turn about z, alpha, is parasitic.
"""

import math
from typing import ClassVar

import numpy as np

from pmopt.errors import InputError
from pmopt.kernels.trigonometry import arc_tangent
from pmopt.mechanisms.bodies import plate, tube
from pmopt.mechanisms.mechanism import (
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

SIGNS = {"out-out": (1, -1), "in-in": (-1, 1), "out-in": (1, 1), "in-out": (-1, -1)}
TINY = 1e-300


def crank(dx, dy, l1, excess, sign):
    """Return l1^2 r^2 - c^2, the signed root, and the crank's tip from its pivot."""
    r2 = dx * dx + dy * dy
    c = 0.5 * (r2 + excess)
    square = l1 * l1 * r2 - c * c
    root = sign * math.sqrt(square if square > 0.0 else 0.0)
    over = 1.0 / (r2 + TINY)
    return square, root, (c * dx - root * dy) * over, (c * dy + root * dx) * over


def kernel(x, y, constants):
    """Return the margin and det(J_q) J^-1: rows g2 u1 and g1 u2, g_i = u_i.e_i = -s S."""
    a, l1, _, excess, s1, s2, cos1, sin1, least1, cos2, sin2, least2 = constants
    square1, root1, p1, q1 = crank(x + a, y, l1, excess, s1)
    square2, root2, p2, q2 = crank(x - a, y, l1, excess, s2)
    margin = square1 if square1 < square2 else square2
    slack = cos1 * p1 + sin1 * q1 - least1
    margin = slack if slack < margin else margin
    slack = cos2 * p2 + sin2 * q2 - least2
    margin = slack if slack < margin else margin
    return (
        margin,
        -root2 * (x + a - p1), -root2 * (y - q1),
        -root1 * (x - a - p2), -root1 * (y - q2),
    )  # fmt: skip


def skeleton(x, y, constants):
    """Return the platform, the cranks and the links."""
    a, l1, l2, excess, s1, s2, _, _, _, _, _, _ = constants
    _, _, p1, q1 = crank(x + a, y, l1, excess, s1)
    _, _, p2, q2 = crank(x - a, y, l1, excess, s2)
    cosine, sine = (x - a - p2) / l2, (y - q2) / l2
    return (
        x, y, 0.0, cosine, -sine, 0.0, sine, cosine, 0.0, 0.0, 0.0, 1.0,
        -a, 0.0, 0.0, p1 - a, q1, 0.0,
        p1 - a, q1, 0.0, x, y, 0.0,
        a, 0.0, 0.0, p2 + a, q2, 0.0,
        p2 + a, q2, 0.0, x, y, 0.0,
    )  # fmt: skip


def posture(x, y, constants):
    """Return platform, positions of the cranks, and the five joints."""
    s = skeleton(x, y, constants)
    a = constants[0]
    return (
        *s[:12],
        arc_tangent(s[16], s[15] + a), arc_tangent(s[28], s[27] - a),
        -a, 0.0, 0.0, 0.0, 0.0, 1.0,
        s[15], s[16], 0.0, 0.0, 0.0, 1.0,
        x, y, 0.0, 0.0, 0.0, 1.0,
        a, 0.0, 0.0, 0.0, 0.0, 1.0,
        s[27], s[28], 0.0, 0.0, 0.0, 1.0,
    )  # fmt: skip


class FiveBar(Mechanism):
    """The planar five-bar."""

    name = "five-bar"
    title = "Five-bar"
    description = "two translations (x, y) in a plane; two cranks"
    source = "an example of a plug-in"
    freedom = "2T"
    length_unit = "m"
    default_jacobian = "raw"
    length_meaning = "l1, the crank"
    parameters = (
        Parameter("a", "length", 0.2, (0.05, 0.5), True, "half the distance of the pivots", "ours"),
        Parameter("l1", "length", 0.5, (0.2, 1.0), True, "crank", "ours"),
        Parameter("l2", "length", 0.6, (0.2, 1.0), True, "link", "ours"),
    )
    pose = (
        Coordinate("x", "length", "along the line of the pivots"),
        Coordinate("y", "length", "across, upwards"),
    )
    joints = (
        Coordinate("theta1", "angle", "crank of limb 1"),
        Coordinate("theta2", "angle", "crank of limb 2"),
    )
    parasitic = (Coordinate("alpha", "angle", "direction of limb 2's link, from x"),)
    limbs = (
        Limb("limb 1", "RRR", "crank theta1 (actuated), R_B1, R_P", ("theta1", "R_B1", "R_P")),
        Limb("limb 2", "RR", "crank theta2 (actuated), R_B2", ("theta2", "R_B2")),
    )
    conditions: ClassVar = {
        "inverse": "crank and link are in line",
        "forward": "both links are in line",
    }
    working_modes = tuple(SIGNS)
    kernel = staticmethod(kernel)
    constant_count = 12
    skeleton = staticmethod(skeleton)
    posture = staticmethod(posture)
    segments = (0, 0, 1, 1)
    vertical = 1
    down = (0.0, -1.0, 0.0)
    roles = ("x", "y")
    parasitic_roles = ("yaw",)
    completeness = "closed form: two circles meet in two points at most"

    def characteristic_length(self, parameters):
        """Return l1."""
        return parameters["l1"]

    def reach_box(self, parameters, limits):
        """Return the box of both limbs' discs."""
        a, l1, l2 = _lengths(parameters)
        x, y2 = l1 + l2 - a, (l1 + l2) ** 2 - a * a
        if x <= 0 or y2 <= 0:
            return np.zeros(2), np.zeros(2)
        return np.array([-x, -math.sqrt(y2)]), np.array([x, math.sqrt(y2)])

    def default_domain(self, parameters):
        """Return the half above the pivots."""
        return {"y": (0.0, math.inf)}

    def home(self, parameters):
        """Return the middle, cranks across their links where that can be."""
        a, l1, l2 = _lengths(parameters)
        return {"x": 0.0, "y": math.sqrt(max(l1 * l1 + l2 * l2 - a * a, 1e-4 * l1 * l1))}

    def bodies(self, parameters):
        """Return steel tubes, and limb 2's link as the platform."""
        _, l1, l2 = _lengths(parameters)
        return (
            tube(0.03, l1, 1.0, bore=0.026).body("crank 1", 0, 0),
            tube(0.02, l2, 1.0, bore=0.016).body("link 1", 0, 1),
            tube(0.03, l1, 1.0, bore=0.026).body("crank 2", 1, 0),
            plate((l2, 0.02, 0.004), 1.0).at((-l2 / 2, 0.0, 0.0)).body("link 2"),
        )

    def platform(self, parameters, pose, working_mode=None):
        """Return the turn of limb 2's link and P."""
        flat = skeleton(pose["x"], pose["y"], self._plain(parameters, working_mode))
        return np.reshape(flat[3:12], (3, 3)), np.array(flat[:3])

    def layout(self, parameters, pose, working_mode=None):
        """Return five revolute joints, axes along z."""
        flat = skeleton(pose["x"], pose["y"], self._plain(parameters, working_mode))
        ends = np.reshape(flat[12:], (4, 2, 3))
        z = (np.array([0.0, 0.0, 1.0]),)
        return (
            Chain("limb 1", (Joint("R", ends[0, 0], z, drive=("theta1", 0)),
                             Joint("R", ends[0, 1], z), Joint("R", ends[1, 1], z))),
            Chain("limb 2", (Joint("R", ends[2, 0], z, drive=("theta2", 0)),
                             Joint("R", ends[2, 1], z))),
        )  # fmt: skip

    def reach(self, parameters, pose):
        """Return how far P is within the ring of each limb."""
        a, l1, l2 = _lengths(parameters)
        found = []
        for limb, side in zip(self.limbs, (-1, 1), strict=True):
            r = math.hypot(pose["x"] - side * a, pose["y"])
            far, near = l1 + l2 - r, r - abs(l1 - l2)
            found.append(Reach(limb.name, min(far, near), "too far" if far < near else "too close"))
        return tuple(found)

    def inverse(self, parameters, pose):
        """Return the four working modes."""
        if any(r.distance < 0 for r in self.reach(parameters, pose)):
            return ()
        found = []
        for mode in SIGNS:
            flat = skeleton(pose["x"], pose["y"], self._plain(parameters, mode))
            theta = [math.atan2(flat[k + 4] - flat[k + 1], flat[k + 3] - flat[k]) for k in (12, 24)]
            alpha = math.atan2(flat[6], flat[3])
            joints = {"theta1": wrap_angle(theta[0]), "theta2": wrap_angle(theta[1])}
            found.append(InverseSolution(mode, joints, {"alpha": wrap_angle(alpha)}))
        return tuple(found)

    def forward(self, parameters, joints):
        """Return where the circles about both cranks' tips meet."""
        a, l1, l2 = _lengths(parameters)
        tips = [
            np.array([side * a + l1 * math.cos(t), l1 * math.sin(t)])
            for side, t in ((-1, joints["theta1"]), (1, joints["theta2"]))
        ]
        across = tips[1] - tips[0]
        apart = math.hypot(*across)
        if apart < 1e-9 * l1:
            raise InputError(f"joints: {self.freed}")
        height2 = l2 * l2 - apart * apart / 4
        if height2 < 0:
            return ()
        step = math.sqrt(height2) / apart * np.array([-across[1], across[0]])
        found = []
        for sign in (1, -1):
            point = (tips[0] + tips[1]) / 2 + sign * step
            link = point - tips[1]
            residual = max(abs(math.hypot(*(point - tip)) - l2) for tip in tips)
            found.append(
                ForwardSolution(
                    {"x": float(point[0]), "y": float(point[1])},
                    {"alpha": math.atan2(link[1], link[0])},
                    residual,
                )
            )
        home = self.home(parameters)
        return tuple(sorted(found, key=lambda f: abs(f.pose["y"] - home["y"])))

    def velocity_maps(self, parameters, pose, joints):
        """Return J_X = [u1; u2] and J_q = diag(u_i.e_i)."""
        a, l1, _ = _lengths(parameters)
        rows, drives = [], []
        for side, t in ((-1, joints["theta1"]), (1, joints["theta2"])):
            e = l1 * np.array([-math.sin(t), math.cos(t)])
            u = np.array([pose["x"] - side * a - e[1], pose["y"] + e[0]])
            rows.append(u)
            drives.append(float(u @ e))
        return np.array(rows), np.diag(drives)

    def singularity_measures(self, parameters, pose, joints):
        """Return u_i.e_i / (l1 l2) and u1 x u2 / l2^2."""
        _, l1, l2 = _lengths(parameters)
        (u1, u2), j_q = self.velocity_maps(parameters, pose, joints)
        return {
            "inverse": {
                limb.name: float(j_q[k, k]) / (l1 * l2) for k, limb in enumerate(self.limbs)
            },
            "forward": {"platform": float(u1[0] * u2[1] - u1[1] * u2[0]) / (l2 * l2)},
        }

    def velocity_map_units(self):
        """Return the units of J_X and J_q."""
        return {"J_X": "m", "J_q": "diagonal in m^2/rad"}

    def kernel_constants(self, parameters, working_mode, length, limits):
        """Return the constants in the order in which the kernel takes them."""
        a, l1, l2 = _lengths(parameters)
        arcs = []
        for name in ("theta1", "theta2"):
            low, high = limits.get(name, (-math.pi, math.pi))
            middle, half = (low + high) / 2, (high - low) / 2
            least = -math.inf if half >= math.pi else l1 * math.cos(half)
            arcs += [math.cos(middle), math.sin(middle), least]
        return [a, l1, l2, (l1 - l2) * (l1 + l2), *map(float, SIGNS[working_mode]), *arcs]

    def _plain(self, parameters, working_mode):
        mode = self.check_mode(working_mode)
        return tuple(self.kernel_constants(parameters, mode, 1.0, {}))


def _lengths(parameters):
    return parameters["a"], parameters["l1"], parameters["l2"]


MECHANISM = FiveBar()

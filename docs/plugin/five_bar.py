"""A plug-in: the planar five-bar, RRRRR, whose point P moves in the plane x y.

    A1 = (-a, 0), A2 = (a, 0),  B_i = A_i + l1 (cos t_i, sin t_i),  |P - B_i| = l2

With d = P - A_i, r = |d| and c = (r^2 + l1^2 - l2^2) / 2 the crank is
B_i - A_i = (c d + s S d') / r^2, S = sqrt(l1^2 r^2 - c^2), d' = (-d_y, d_x) and s the sign of the
working mode. The platform is limb 2's second link: its turn about z, alpha, is parasitic.
"""

import math
from typing import ClassVar, NamedTuple

import numpy as np

from pmopt.errors import InputError
from pmopt.kernels.trigonometry import arc_tangent
from pmopt.kernels.vectors import Rotation, Vec3, Z
from pmopt.mechanisms.bodies import plate, tube
from pmopt.mechanisms.mechanism import (
    Coordinate,
    ForwardSolution,
    InverseSolution,
    Limb,
    Mechanism,
    Parameter,
    Reach,
    wrap_angle,
)
from pmopt.mechanisms.structure import Evaluated, Revolute, SerialChain, Structure

SIGNS = {"out-out": (1, -1), "in-in": (-1, 1), "out-in": (1, 1), "in-out": (-1, -1)}
TINY = 1e-300


class Arc(NamedTuple):
    """Range of a crank's angle t: inside is l1 cos(t - middle) >= l1 cos(half-width)."""

    cos: float  # of the middle
    sin: float
    least: float  # l1 cos(half-width), m; -inf where all angles are allowed


class Constants(NamedTuple):
    """One design, as kernel functions take it."""

    a: float  # m
    l1: float  # m
    l2: float  # m
    excess: float  # l1^2 - l2^2, m^2
    sign1: float  # of the crank's root, by working mode
    sign2: float
    arc1: Arc
    arc2: Arc


class Crank(NamedTuple):
    """A limb's crank at a pose."""

    reach: float  # l1^2 r^2 - c^2, m^4: >= 0 where the limb reaches the pose
    root: float  # signed root of it, m^2
    x: float  # its tip from its pivot, m
    y: float


def crank(dx, dy, l1, excess, sign):
    """Return a limb's crank; d is P - A."""
    r2 = dx * dx + dy * dy
    c = 0.5 * (r2 + excess)
    square = l1 * l1 * r2 - c * c
    root = sign * math.sqrt(square if square > 0.0 else 0.0)
    over = 1.0 / (r2 + TINY)
    return Crank(square, root, (c * dx - root * dy) * over, (c * dy + root * dx) * over)


def cranks(x, y, k):
    """Return both cranks."""
    return (
        crank(x + k.a, y, k.l1, k.excess, k.sign1),
        crank(x - k.a, y, k.l1, k.excess, k.sign2),
    )


def kernel(x, y, k):
    """Return the margin and det(J_q) J^-1: rows g2 u1 and g1 u2, g_i = u_i.e_i = -s S."""
    one, two = cranks(x, y, k)
    margin = one.reach if one.reach < two.reach else two.reach
    slack = k.arc1.cos * one.x + k.arc1.sin * one.y - k.arc1.least
    margin = slack if slack < margin else margin
    slack = k.arc2.cos * two.x + k.arc2.sin * two.y - k.arc2.least
    margin = slack if slack < margin else margin
    return (
        margin,
        -two.root * (x + k.a - one.x), -two.root * (y - one.y),
        -one.root * (x - k.a - two.x), -one.root * (y - two.y),
    )  # fmt: skip


class Points(NamedTuple):
    """A configuration, m: pivots A, tips B of the cranks, P, and how limb 2's link is turned."""

    a1: Vec3
    a2: Vec3
    b1: Vec3
    b2: Vec3
    p: Vec3
    rotation: Rotation


def points(x, y, k):
    """Return the points of a configuration."""
    one, two = cranks(x, y, k)
    cosine, sine = (x - k.a - two.x) / k.l2, (y - two.y) / k.l2
    return Points(
        a1=Vec3(-k.a, 0.0, 0.0),
        a2=Vec3(k.a, 0.0, 0.0),
        b1=Vec3(one.x - k.a, one.y, 0.0),
        b2=Vec3(two.x + k.a, two.y, 0.0),
        p=Vec3(x, y, 0.0),
        rotation=Rotation(cosine, -sine, 0.0, sine, cosine, 0.0, 0.0, 0.0, 1.0),
    )


class Positions(NamedTuple):
    """Angles of the cranks."""

    theta1: float
    theta2: float


def positions(at, k):
    """Return the actuated joints' positions."""
    return Positions(
        arc_tangent(at.b1.y, at.b1.x + k.a),
        arc_tangent(at.b2.y, at.b2.x - k.a),
    )


STRUCTURE = Structure(
    Evaluated(points, Points),
    place="p",
    rotation="rotation",
    chains=(
        SerialChain(
            "limb 1",
            (Revolute("a1", Z, drives="theta1"), Revolute("b1", Z), Revolute("p", Z)),
            bars=("a1", "b1", "p"),
        ),
        SerialChain(
            "limb 2",
            (Revolute("a2", Z, drives="theta2"), Revolute("b2", Z)),
            bars=("a2", "b2", "p"),
        ),
    ),
    positions=Evaluated(positions, Positions),
)


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
    constants = Constants
    structure = STRUCTURE
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
        at = self._points(parameters, pose, self.check_mode(working_mode))
        return np.reshape(at.rotation, (3, 3)), np.array(at.p)

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
            at = self._points(parameters, pose, mode)
            theta1 = math.atan2(at.b1.y - at.a1.y, at.b1.x - at.a1.x)
            theta2 = math.atan2(at.b2.y - at.a2.y, at.b2.x - at.a2.x)
            alpha = math.atan2(at.rotation.yx, at.rotation.xx)
            joints = {"theta1": wrap_angle(theta1), "theta2": wrap_angle(theta2)}
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
        """Return the constants of a design."""
        a, l1, l2 = _lengths(parameters)
        arcs = []
        for name in ("theta1", "theta2"):
            low, high = limits.get(name, (-math.pi, math.pi))
            middle, half = (low + high) / 2, (high - low) / 2
            least = -math.inf if half >= math.pi else l1 * math.cos(half)
            arcs.append(Arc(math.cos(middle), math.sin(middle), least))
        sign1, sign2 = map(float, SIGNS[working_mode])
        return Constants(a, l1, l2, (l1 - l2) * (l1 + l2), sign1, sign2, *arcs)

    def _points(self, parameters, pose, mode):
        constants = self.kernel_constants(parameters, mode, 1.0, {})
        return points(pose["x"], pose["y"], constants)


def _lengths(parameters):
    return parameters["a"], parameters["l1"], parameters["l2"]


MECHANISM = FiveBar()

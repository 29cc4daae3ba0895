"""3-RRR, planar: two translations and a turn, for tests."""

import math
from typing import ClassVar, NamedTuple

import numpy as np

from pmopt.kernels.trigonometry import arc_tangent, sin_cos
from pmopt.kernels.vectors import Rotation, Vec3, Z, minus
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


class Leg(NamedTuple):
    """A limb in the plane: pivot A, tip B of the crank, C at the platform, and the crank's root."""

    reach: float
    root: float
    a: Vec3
    b: Vec3
    c: Vec3
    arm: Vec3  # from the platform's centre to C


class Constants(NamedTuple):
    big: float
    small: float
    l1: float
    l2: float
    excess: float
    sign: float
    weight: float
    c1: float  # cosine and sine of the middle of crank 1's range, and its end
    s1: float
    e1: float
    c2: float
    s2: float
    e2: float
    c3: float
    s3: float
    e3: float


def limb(x, y, sine, cosine, k, c, s):
    """Return the limb whose joints lie at the angle with cosine c and sine s."""
    bx, by = k.small * (cosine * c - sine * s), k.small * (sine * c + cosine * s)
    square, root, p, q = crank(x + bx - k.big * c, y + by - k.big * s, k.l1, k.excess, k.sign)
    return Leg(
        square,
        root,
        Vec3(k.big * c, k.big * s, 0.0),
        Vec3(k.big * c + p, k.big * s + q, 0.0),
        Vec3(x + bx, y + by, 0.0),
        Vec3(bx, by, 0.0),
    )


def limbs(x, y, sine, cosine, k):
    """Return all limbs."""
    return (
        limb(x, y, sine, cosine, k, C1, S1),
        limb(x, y, sine, cosine, k, C2, S2),
        limb(x, y, sine, cosine, k, C3, S3),
    )


def kernel(x, y, phi, k):
    sine, cosine = sin_cos(phi)
    g1, g2, g3 = limbs(x, y, sine, cosine, k)
    margin = g1.reach if g1.reach < g2.reach else g2.reach
    margin = g3.reach if g3.reach < margin else margin
    slack1 = k.c1 * (g1.b.x - g1.a.x) + k.s1 * (g1.b.y - g1.a.y) - k.e1
    slack2 = k.c2 * (g2.b.x - g2.a.x) + k.s2 * (g2.b.y - g2.a.y) - k.e2
    slack3 = k.c3 * (g3.b.x - g3.a.x) + k.s3 * (g3.b.y - g3.a.y) - k.e3
    margin = min(margin, slack1, slack2, slack3)
    u1, u2, u3 = minus(g1.c, g1.b), minus(g2.c, g2.b), minus(g3.c, g3.b)
    h1, h2, h3 = g2.root * g3.root, g1.root * g3.root, g1.root * g2.root
    return (
        margin,
        h1 * u1.x, h1 * u1.y, h1 * (g1.arm.x * u1.y - g1.arm.y * u1.x) * k.weight,
        h2 * u2.x, h2 * u2.y, h2 * (g2.arm.x * u2.y - g2.arm.y * u2.x) * k.weight,
        h3 * u3.x, h3 * u3.y, h3 * (g3.arm.x * u3.y - g3.arm.y * u3.x) * k.weight,
    )  # fmt: skip


class Points(NamedTuple):
    leg1: Leg
    leg2: Leg
    leg3: Leg
    p: Vec3
    rotation: Rotation


def points(x, y, phi, k):
    sine, cosine = sin_cos(phi)
    leg1, leg2, leg3 = limbs(x, y, sine, cosine, k)
    turn = Rotation(cosine, -sine, 0.0, sine, cosine, 0.0, 0.0, 0.0, 1.0)
    return Points(leg1, leg2, leg3, Vec3(x, y, 0.0), turn)


class Positions(NamedTuple):
    theta1: float
    theta2: float
    theta3: float


def positions(at, k):
    return Positions(turn_of(at.leg1), turn_of(at.leg2), turn_of(at.leg3))


def turn_of(leg):
    return arc_tangent(leg.b.y - leg.a.y, leg.b.x - leg.a.x)


STRUCTURE = Structure(
    Evaluated(points, Points),
    place="p",
    rotation="rotation",
    chains=tuple(
        SerialChain(
            f"limb {k}",
            (
                Revolute(f"leg{k}.a", Z, drives=f"theta{k}"),
                Revolute(f"leg{k}.b", Z),
                Revolute(f"leg{k}.c", Z),
            ),
            bars=(f"leg{k}.a", f"leg{k}.b", f"leg{k}.c"),
            spoke=f"leg{k}.c",
        )
        for k in (1, 2, 3)
    ),
    positions=Evaluated(positions, Positions),
)


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
    constants = Constants
    structure = STRUCTURE
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

    def _points(self, parameters, pose, mode=None):
        constants = self.kernel_constants(parameters, self.check_mode(mode), 1.0, {})
        return points(*pose.values(), constants)

    def platform(self, parameters, pose, working_mode=None):
        at = self._points(parameters, pose, working_mode)
        return np.reshape(at.rotation, (3, 3)), np.array(at.p)

    def reach(self, parameters, pose):
        found = []
        for k, leg in enumerate(self._points(parameters, pose)[:3]):
            r = float(np.linalg.norm(np.subtract(leg.c, leg.a)))
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
            joints = {}
            for k, leg in enumerate(self._points(parameters, pose, mode)[:3]):
                along = minus(leg.b, leg.a)
                joints[f"theta{k + 1}"] = wrap_angle(math.atan2(along.y, along.x))
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
        excess = (l1 - l2) * (l1 + l2)
        return Constants(big, small, l1, l2, excess, sign, 1.0 / length, *arcs)


MECHANISM = Planar()

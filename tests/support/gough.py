"""A platform of six freedoms on six UPS limbs, for tests."""

import math
from typing import ClassVar, NamedTuple

import numpy as np

from pmopt.kernels.trigonometry import sin_cos
from pmopt.kernels.vectors import Rotation, Vec3, direction, minus
from pmopt.mechanisms.bodies import disc, tube
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
from pmopt.mechanisms.structure import (
    Along,
    Evaluated,
    Normal,
    Prismatic,
    SerialChain,
    Spherical,
    Structure,
    Universal,
)

LONGEST = 0.9
TINY = 1e-300  # as ours, and 1 / LONGEST would be no shorter


def rotation(yaw, pitch, roll):
    """Return Rz Ry Rx row by row, and sine and cosine of yaw and pitch."""
    sa, ca = sin_cos(yaw)
    sb, cb = sin_cos(pitch)
    sc, cc = sin_cos(roll)
    return (
        ca * cb, ca * sb * sc - sa * cc, ca * sb * cc + sa * sc,
        sa * cb, sa * sb * sc + ca * cc, sa * sb * cc - ca * sc,
        0.0 - sb, cb * sc, cb * cc,
        sa, ca, sb, cb,
    )  # fmt: skip


class LegConstants(NamedTuple):
    """A limb of a design: A in the base, B in the platform, the ends of its stroke; m."""

    ax: float
    ay: float
    bx: float
    by: float
    shortest: float
    longest: float


class GoughConstants(NamedTuple):
    """A design."""

    leg1: LegConstants
    leg2: LegConstants
    leg3: LegConstants
    leg4: LegConstants
    leg5: LegConstants
    leg6: LegConstants
    weight: float  # 1 / characteristic length, 1/m


def limb(x, y, z, r, leg, weight):
    """Return the length of a limb and its rates by the six coordinates."""
    ax, ay, bx, by = leg.ax, leg.ay, leg.bx, leg.by
    px, py, pz = r[0] * bx + r[1] * by, r[3] * bx + r[4] * by, r[6] * bx + r[7] * by
    wx, wy, wz = x + px - ax, y + py - ay, z + pz
    length = math.sqrt(wx * wx + wy * wy + wz * wz)
    over = 1.0 / (length + TINY)
    nx, ny, nz = wx * over, wy * over, wz * over
    mx, my, mz = py * nz - pz * ny, pz * nx - px * nz, px * ny - py * nx
    sa, ca, sb, cb = r[9], r[10], r[11], r[12]
    return (
        length, nx, ny, nz, mz * weight, (ca * my - sa * mx) * weight,
        (ca * cb * mx + sa * cb * my - sb * mz) * weight,
    )  # fmt: skip


def kernel(x, y, z, yaw, pitch, roll, k):
    """Return the margin of the six lengths, and J^-1."""
    r = rotation(yaw, pitch, roll)
    g1 = limb(x, y, z, r, k.leg1, k.weight)
    g2 = limb(x, y, z, r, k.leg2, k.weight)
    g3 = limb(x, y, z, r, k.leg3, k.weight)
    g4 = limb(x, y, z, r, k.leg4, k.weight)
    g5 = limb(x, y, z, r, k.leg5, k.weight)
    g6 = limb(x, y, z, r, k.leg6, k.weight)
    low = min(
        g1[0] - k.leg1.shortest, g2[0] - k.leg2.shortest, g3[0] - k.leg3.shortest,
        g4[0] - k.leg4.shortest, g5[0] - k.leg5.shortest, g6[0] - k.leg6.shortest,
    )  # fmt: skip
    high = min(
        k.leg1.longest - g1[0], k.leg2.longest - g2[0], k.leg3.longest - g3[0],
        k.leg4.longest - g4[0], k.leg5.longest - g5[0], k.leg6.longest - g6[0],
    )  # fmt: skip
    margin = low if low < high else high
    return (margin, *g1[1:], *g2[1:], *g3[1:], *g4[1:], *g5[1:], *g6[1:])


class Leg(NamedTuple):
    """A limb: A in the base, B in the platform, and the first axis of its U joint at A."""

    a: Vec3
    b: Vec3
    tangent: Vec3  # across A's radius


class Points(NamedTuple):
    leg1: Leg
    leg2: Leg
    leg3: Leg
    leg4: Leg
    leg5: Leg
    leg6: Leg
    p: Vec3
    rotation: Rotation


def leg_of(x, y, z, r, leg):
    size = math.sqrt(leg.ax * leg.ax + leg.ay * leg.ay)
    return Leg(
        Vec3(leg.ax, leg.ay, 0.0),
        Vec3(
            x + r[0] * leg.bx + r[1] * leg.by,
            y + r[3] * leg.bx + r[4] * leg.by,
            z + r[6] * leg.bx + r[7] * leg.by,
        ),
        Vec3(0.0 - leg.ay / size, leg.ax / size, 0.0),
    )


def points(x, y, z, yaw, pitch, roll, k):
    """Return the platform and the limbs."""
    r = rotation(yaw, pitch, roll)
    return Points(
        leg_of(x, y, z, r, k.leg1), leg_of(x, y, z, r, k.leg2), leg_of(x, y, z, r, k.leg3),
        leg_of(x, y, z, r, k.leg4), leg_of(x, y, z, r, k.leg5), leg_of(x, y, z, r, k.leg6),
        Vec3(x, y, z),
        Rotation(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8]),
    )  # fmt: skip


class Positions(NamedTuple):
    l1: float
    l2: float
    l3: float
    l4: float
    l5: float
    l6: float


def length_of(leg):
    return direction(minus(leg.b, leg.a)).length


def positions(at, constants):
    return Positions(
        length_of(at.leg1), length_of(at.leg2), length_of(at.leg3),
        length_of(at.leg4), length_of(at.leg5), length_of(at.leg6),
    )  # fmt: skip


def ups(k):
    """Return limb k."""
    a, b, tangent = (f"leg{k}.{name}" for name in ("a", "b", "tangent"))
    along = Along(a, b)
    joints = (
        Universal(a, tangent, Normal(tangent, along)),
        Prismatic(a, along, drives=f"l{k}"),
        Spherical(b),
    )
    return SerialChain(f"limb {k}", joints, bars=(a, b), spoke=b)


STRUCTURE = Structure(
    Evaluated(points, Points),
    place="p",
    rotation="rotation",
    chains=tuple(ups(k) for k in range(1, 7)),
    positions=Evaluated(positions, Positions),
)


NAMES = tuple(f"l{k}" for k in range(1, 7))


class Gough(Mechanism):
    """6-UPS."""

    name = "6-ups"
    title = "6-UPS"
    description = "six freedoms; six UPS limbs"
    source = "Gough 1956, Stewart 1965"
    freedom = "3T3R"
    length_unit = "m"
    default_jacobian = "homogenized"
    length_meaning = "r, the platform's radius"
    parameters = (
        Parameter("R", "length", 0.5, (0.3, 0.8), True, "base radius", "ours"),
        Parameter("r", "length", 0.3, (0.2, 0.5), True, "platform radius", "ours"),
        Parameter("p", "angle", 0.2, (0.05, 0.5), False, "half angle of a pair, base", "ours"),
        Parameter("q", "angle", 0.85, (0.5, 1.0), False, "half angle of a pair, platform", "ours"),
    )
    pose = (
        *(Coordinate(name, "length", f"along {name}") for name in ("x", "y", "z")),
        *(Coordinate(name, "angle", name) for name in ("yaw", "pitch", "roll")),
    )
    joints = tuple(Coordinate(name, "length", "length of a limb") for name in NAMES)
    limbs = tuple(
        Limb(f"limb {k}", "UPS", f"U_A{k}, telescope l{k} (actuated), S_B{k}",
             (f"U_A{k}", f"l{k}", f"S_B{k}"))
        for k in range(1, 7)
    )  # fmt: skip
    conditions: ClassVar = {
        "inverse": "a limb has no length",
        "forward": "the lines of the six limbs are dependent",
    }
    working_modes = ("direct",)
    kernel = staticmethod(kernel)
    constants = GoughConstants
    structure = STRUCTURE
    roles = ("x", "y", "z", "yaw", "pitch", "roll")

    def characteristic_length(self, parameters):
        return parameters["r"]

    def default_limits(self, parameters):
        return dict.fromkeys(NAMES, (0.5, LONGEST))

    def reach_box(self, parameters, limits):
        longest = max(limits.get(name, (0, 2.0))[1] for name in NAMES) + parameters["r"]
        base = self._points(parameters)[0]
        low, high = (base - longest).max(axis=0), (base + longest).min(axis=0)
        turn = [math.pi, math.pi / 2, math.pi]
        return (np.array([*low, -longest, *(-v for v in turn)]),
                np.array([*high, longest, *turn]))  # fmt: skip

    def default_domain(self, parameters):
        return {"z": (0.0, math.inf)} | dict.fromkeys(("yaw", "pitch", "roll"), (-0.5, 0.5))

    def home(self, parameters):
        return {"x": 0.0, "y": 0.0, "z": 0.55, "yaw": 0.0, "pitch": 0.0, "roll": 0.0}

    def bodies(self, parameters):
        tubes = []
        for k in range(6):
            tubes.append(tube(0.04, 0.4, 1.0, bore=0.03).body(f"cylinder {k + 1}", k, 0))
            tubes.append(tube(0.02, 0.4, 1.0).body(f"rod {k + 1}", k, 1))
        return (*tubes, disc(2 * parameters["r"], 0.01, 1.0).body("platform"))

    def platform(self, parameters, pose, working_mode=None):
        turned = rotation(pose["yaw"], pose["pitch"], pose["roll"])[:9]
        return np.reshape(turned, (3, 3)), np.array([pose["x"], pose["y"], pose["z"]])

    def reach(self, parameters, pose):
        return tuple(Reach(limb.name, 1.0, "too far") for limb in self.limbs)

    def inverse(self, parameters, pose):
        at = points(*pose.values(), self.kernel_constants(parameters, "direct", 1.0, {}))
        lengths = [float(np.linalg.norm(np.subtract(leg.b, leg.a))) for leg in at[:6]]
        return (InverseSolution("direct", dict(zip(NAMES, lengths, strict=True)), {}),)

    def forward(self, parameters, joints):
        """Newton's method from home and about it: there may be more."""
        wanted = np.array([joints[name] for name in NAMES])
        constants = self.kernel_constants(parameters, "direct", 1.0, {})
        random = np.random.default_rng(1)
        found = []
        names = [c.name for c in self.pose]
        for trial in range(12):
            pose = np.array(list(self.home(parameters).values()))
            pose = pose + (trial > 0) * random.uniform(-0.4, 0.4, 6)
            for _ in range(30):
                flat = kernel(*pose.tolist(), constants)
                now = self.inverse(parameters, dict(zip(names, pose.tolist(), strict=True)))
                gap = wanted - np.array([now[0].joints[name] for name in NAMES])
                pose = pose + np.linalg.solve(np.reshape(flat[1:], (6, 6)), gap)
                if np.abs(gap).max() < 1e-13:
                    break
            if np.abs(gap).max() < 1e-10 and abs(pose[4]) < math.pi / 2:
                pose = [*pose[:3].tolist(), *(wrap_angle(v) for v in pose[3:].tolist())]
                if all(np.abs(np.subtract(pose, p)).max() > 1e-6 for p, _ in found):
                    found.append((pose, float(np.abs(gap).max())))
        return tuple(
            ForwardSolution(dict(zip(names, pose, strict=True)), {}, gap) for pose, gap in found
        )

    def velocity_maps(self, parameters, pose, joints):
        constants = self.kernel_constants(parameters, "direct", 1.0, {})
        return np.reshape(kernel(*pose.values(), constants)[1:], (6, 6)), np.eye(6)

    def singularity_measures(self, parameters, pose, joints):
        constants = self.kernel_constants(parameters, "direct", parameters["r"], {})
        rows = np.reshape(kernel(*pose.values(), constants)[1:], (6, 6))
        return {
            "inverse": {f"limb {k + 1}": joints[name] / (joints[name] + parameters["r"])
                        for k, name in enumerate(NAMES)},
            "forward": {"platform": float(np.linalg.det(rows)) / 8},
        }  # fmt: skip

    def velocity_map_units(self):
        return {"J_X": "columns in 1; 1; 1; m/rad; m/rad; m/rad", "J_q": "1"}

    def kernel_constants(self, parameters, working_mode, length, limits):
        base, top = self._points(parameters)
        ends = [limits.get(name, (0.0, math.inf)) for name in NAMES]
        legs = (
            LegConstants(*a, *b, *map(float, stroke))
            for a, b, stroke in zip(base.tolist(), top.tolist(), ends, strict=True)
        )
        return GoughConstants(*legs, 1.0 / length)

    def _points(self, parameters):
        """Return A and B of the limbs, in pairs about three directions, (6, 2) each."""
        found = []
        for radius, half in (
            (parameters["R"], parameters["p"]),
            (parameters["r"], parameters["q"]),
        ):
            at = [k * 2 * math.pi / 3 + s * half for k in range(3) for s in (1, -1)]
            found.append(radius * np.array([[math.cos(v), math.sin(v)] for v in at]))
        return found


MECHANISM = Gough()

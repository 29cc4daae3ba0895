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
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.compiler.programs import Assembler
from pmopt.errors import InputError
from pmopt.kernels.strokes import part_within_stroke
from pmopt.kernels.trigonometry import roll_pitch_yaw, sin_cos
from pmopt.kernels.vectors import (
    SQRT_HALF,
    Rotation,
    Vec3,
    Z,
    cross,
    dot,
    least,
    plus,
    turned,
)
from pmopt.mechanisms.bodies import Body, disc, tube
from pmopt.mechanisms.catalogue.ups_rps_forward import (
    DIMENSIONS,
    STARTS,
    rps_assemble,
    rps_MODES,
    rps_WORK,
)
from pmopt.mechanisms.mechanism import (
    Coordinate,
    InverseSolution,
    Limb,
    Matrix,
    Mechanism,
    Parameter,
    Parameters,
    Ranges,
    Reach,
    Vector,
)
from pmopt.mechanisms.structure import (
    Along,
    Evaluated,
    Normal,
    Prismatic,
    Revolute,
    SerialChain,
    Spherical,
    Structure,
    Universal,
)
from pmopt.numerics import elementary
from pmopt.numerics.matrices import determinant, product
from pmopt.numerics.rotation import rotation_matrices

TINY = 1e-300

_PAPER = "paper, section 3.1"
_STROKE = (700.0, 1300.0)
_MM = 1e-3


class Leg(NamedTuple):
    """One limb of a design."""

    y: float  # joint S, platform frame, mm
    z: float
    low: float  # stroke, mm
    high: float
    in_base: Vec3  # direction at home, base frame
    in_platform: Vec3  # direction at home, platform frame


class Constants(NamedTuple):
    """One design, as kernel functions take it."""

    r1: float  # radius of T1, mm
    q: float  # R / sqrt 2, mm: T2 .. T5 lie at Y, Z = +-q
    radius: float  # r, mm
    scale: float  # 1 / characteristic length, 1/mm; 1 for the raw Jacobian
    leg1: Leg
    leg2: Leg
    leg3: Leg
    leg4: Leg
    leg5: Leg


class Place(NamedTuple):
    """A pose: the platform's place, and what rates of angles need."""

    rotation: Rotation
    p: Vec3  # mm
    sin_a: float
    cos_a: float
    z_beta: float  # rates of z, mm/rad
    z_gamma: float


class Span(NamedTuple):
    """A limb at a pose."""

    arm: Vec3  # Rot S, mm
    gap: Vec3  # L, mm
    length: float  # mm


def rps_place(x, y, alpha, beta, gamma, r):  # type: ignore[no-untyped-def]
    """Return the platform's place; z is bound to the angles."""
    sin_a, cos_a = sin_cos(alpha)
    sin_b, cos_b = sin_cos(beta)
    sin_c, cos_c = sin_cos(gamma)
    rotation = roll_pitch_yaw(alpha, beta, gamma)
    p = Vec3(x, y, r * cos_b * cos_c)
    return Place(rotation, p, sin_a, cos_a, -r * sin_b * cos_c, -r * cos_b * sin_c)


def rps_span(at, leg, ty, tz):  # type: ignore[no-untyped-def]
    """Return a limb from T = (0, ty, tz)."""
    r = at.rotation
    arm = Vec3(
        r.xy * leg.y + r.xz * leg.z, r.yy * leg.y + r.yz * leg.z, r.zy * leg.y + r.zz * leg.z
    )
    gap = Vec3(at.p.x + arm.x, at.p.y + arm.y - ty, at.p.z + arm.z - tz)
    return Span(arm, gap, math.sqrt(dot(gap, gap)))


def rps_spans(at, k):  # type: ignore[no-untyped-def]
    """Return all limbs."""
    return (
        rps_span(at, k.leg1, k.r1, 0.0),
        rps_span(at, k.leg2, k.q, k.q),
        rps_span(at, k.leg3, -k.q, k.q),
        rps_span(at, k.leg4, -k.q, -k.q),
        rps_span(at, k.leg5, k.q, -k.q),
    )


def rps_within(span, leg, margin):  # type: ignore[no-untyped-def]
    """Return the least of a margin and of the distances to a stroke's ends."""
    return least(leg.high - span.length, least(span.length - leg.low, margin))


def rps_row(span, at, scale):  # type: ignore[no-untyped-def]
    """Return the rates of l by x, y, alpha, beta, gamma; those by angles times scale."""
    unit = 1.0 / (span.length + TINY)
    n = Vec3(span.gap.x * unit, span.gap.y * unit, span.gap.z * unit)
    m = cross(span.arm, n)
    r = at.rotation
    return (
        n.x,
        n.y,
        m.z * scale,
        (m.y * at.cos_a - m.x * at.sin_a + n.z * at.z_beta) * scale,
        (m.x * r.xx + m.y * r.yx + m.z * r.zx + n.z * at.z_gamma) * scale,
    )


def rps_kernel(x, y, alpha, beta, gamma, k):  # type: ignore[no-untyped-def]
    """Return the margin, the least distance to a stroke's end, and J^-1 (paper, J1 J2)."""
    at = rps_place(x, y, alpha, beta, gamma, k.radius)
    s1, s2, s3, s4, s5 = rps_spans(at, k)
    margin = s1.length - k.leg1.low
    margin = least(k.leg1.high - s1.length, margin)
    margin = rps_within(s2, k.leg2, margin)
    margin = rps_within(s3, k.leg3, margin)
    margin = rps_within(s4, k.leg4, margin)
    margin = rps_within(s5, k.leg5, margin)
    return (
        margin,
        *rps_row(s1, at, k.scale),
        *rps_row(s2, at, k.scale),
        *rps_row(s3, at, k.scale),
        *rps_row(s4, at, k.scale),
        *rps_row(s5, at, k.scale),
    )


def rps_stroke(part, span, leg):  # type: ignore[no-untyped-def]
    """Cut a part (start, end) of a line along x to a limb's stroke; the limb at x = 0."""
    gap = span.gap
    across2 = gap.y * gap.y + gap.z * gap.z
    return part_within_stroke(part[0], part[1], -gap.x, across2, leg.low, leg.high)


def rps_line(x, y, alpha, beta, gamma, low, high, k):  # type: ignore[no-untyped-def]
    """Return what the strokes leave of a line along x: l_i^2 is quadratic in x."""
    s1, s2, s3, s4, s5 = rps_spans(rps_place(0.0, y, alpha, beta, gamma, k.radius), k)
    part = rps_stroke((low, high), s1, k.leg1)
    part = rps_stroke(part, s2, k.leg2)
    part = rps_stroke(part, s3, k.leg3)
    part = rps_stroke(part, s4, k.leg4)
    return rps_stroke(part, s5, k.leg5)


class Points(NamedTuple):
    """A configuration, base frame, mm: joints T in the base and S in the platform, its place."""

    t1: Vec3
    t2: Vec3
    t3: Vec3
    t4: Vec3
    t5: Vec3
    s1: Vec3
    s2: Vec3
    s3: Vec3
    s4: Vec3
    s5: Vec3
    p: Vec3
    rotation: Rotation
    span1: Span
    span2: Span
    span3: Span
    span4: Span
    span5: Span


def rps_points(x, y, alpha, beta, gamma, k):  # type: ignore[no-untyped-def]
    """Return the points of a configuration."""
    at = rps_place(x, y, alpha, beta, gamma, k.radius)
    s1, s2, s3, s4, s5 = rps_spans(at, k)
    q = k.q
    return Points(
        t1=Vec3(0.0, k.r1, 0.0),
        t2=Vec3(0.0, q, q),
        t3=Vec3(0.0, -q, q),
        t4=Vec3(0.0, -q, -q),
        t5=Vec3(0.0, q, -q),
        s1=plus(at.p, s1.arm),
        s2=plus(at.p, s2.arm),
        s3=plus(at.p, s3.arm),
        s4=plus(at.p, s4.arm),
        s5=plus(at.p, s5.arm),
        p=at.p,
        rotation=at.rotation,
        span1=s1,
        span2=s2,
        span3=s3,
        span4=s4,
        span5=s5,
    )


class Cones(NamedTuple):
    """Cosines between limbs and their directions at home, in the base and in the platform."""

    U_T2: float
    U_T3: float
    U_T4: float
    U_T5: float
    S_S1: float
    S_S2: float
    S_S3: float
    S_S4: float
    S_S5: float


def rps_in_base(span, leg):  # type: ignore[no-untyped-def]
    """Return the cosine between a limb and its direction at home in the base."""
    return dot(span.gap, leg.in_base) / (span.length + TINY)


def rps_in_platform(span, at, leg):  # type: ignore[no-untyped-def]
    """Return the cosine between a limb and its direction at home in the platform."""
    return dot(span.gap, turned(at.rotation, leg.in_platform)) / (span.length + TINY)


def rps_cones(at, k):  # type: ignore[no-untyped-def]
    """Return the cosines of the cone angles."""
    return Cones(
        U_T2=rps_in_base(at.span2, k.leg2),
        U_T3=rps_in_base(at.span3, k.leg3),
        U_T4=rps_in_base(at.span4, k.leg4),
        U_T5=rps_in_base(at.span5, k.leg5),
        S_S1=rps_in_platform(at.span1, at, k.leg1),
        S_S2=rps_in_platform(at.span2, at, k.leg2),
        S_S3=rps_in_platform(at.span3, at, k.leg3),
        S_S4=rps_in_platform(at.span4, at, k.leg4),
        S_S5=rps_in_platform(at.span5, at, k.leg5),
    )


class Positions(NamedTuple):
    """Lengths of the limbs, mm."""

    l1: float
    l2: float
    l3: float
    l4: float
    l5: float


def rps_positions(at, k):  # type: ignore[no-untyped-def]
    """Return the limbs' lengths."""
    return Positions(
        at.span1.length, at.span2.length, at.span3.length, at.span4.length, at.span5.length
    )


def _limb(k: int, *base: Revolute | Universal) -> SerialChain:
    """Return limb k with its joint at the base."""
    return SerialChain(
        f"limb {k}",
        (*base, Prismatic(f"t{k}", Along(f"t{k}", f"s{k}"), drives=f"l{k}"), Spherical(f"s{k}")),
        bars=(f"t{k}", f"s{k}"),
        spoke=f"s{k}",
    )


def _ups(k: int, tangent: Vec3) -> SerialChain:
    """Return UPS limb k; the first axis of its U joint is tangential in the base (ours)."""
    across = Normal(tangent, Along(f"t{k}", f"s{k}"))
    return _limb(k, Universal(f"t{k}", tangent, across))


STRUCTURE = Structure(
    Evaluated(rps_points, Points),
    place="p",
    rotation="rotation",
    chains=(
        _limb(1, Revolute("t1", Z)),
        _ups(2, Vec3(0.0, -SQRT_HALF, SQRT_HALF)),
        _ups(3, Vec3(0.0, -SQRT_HALF, -SQRT_HALF)),
        _ups(4, Vec3(0.0, SQRT_HALF, -SQRT_HALF)),
        _ups(5, Vec3(0.0, SQRT_HALF, SQRT_HALF)),
    ),
    cones=Evaluated(rps_cones, Cones),
    positions=Evaluated(rps_positions, Positions),
)


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
    constants = Constants
    line = staticmethod(rps_line)
    line_axis = 0
    line_parts = 1
    structure = STRUCTURE
    roles = ("x", "y", "yaw", "pitch", "roll")
    parasitic_roles = ("z",)
    assembler = Assembler(rps_assemble, rps_MODES, 8, rps_WORK)
    completeness = "the real ends of 18 paths and their mirror images; that they are all is checked"
    down = (1.0, 0.0, 0.0)

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

    def kernel_constants(
        self, parameters: Parameters, working_mode: str, length: float, limits: Ranges
    ) -> Constants:
        """Return the constants of a design."""
        big1, big, small = _radii(parameters)
        rotation, centre = self.platform(parameters, self.home(parameters))
        points = _points(parameters)
        gaps = centre + product(points, rotation.T) - _anchors(parameters)
        units = gaps / np.linalg.norm(gaps, axis=1, keepdims=True)
        turned_back = product(units, rotation)
        legs = []
        for i, joint in enumerate(self.joints):
            _, y, z = points[i].tolist()
            low, high = limits.get(joint.name, (-math.inf, math.inf))
            in_base, in_platform = Vec3(*units[i].tolist()), Vec3(*turned_back[i].tolist())
            legs.append(Leg(y, z, low, high, in_base, in_platform))
        leg1, leg2, leg3, leg4, leg5 = legs
        return Constants(
            r1=big1,
            q=big / math.sqrt(2),
            radius=small,
            scale=1 / length,
            leg1=leg1,
            leg2=leg2,
            leg3=leg3,
            leg4=leg4,
            leg5=leg5,
        )

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

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
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.compiler.programs import Assembler
from pmopt.errors import InputError
from pmopt.kernels.octics import bernstein, nodes
from pmopt.kernels.strokes import part_within_stroke
from pmopt.kernels.trigonometry import roll_pitch_yaw, sin_cos
from pmopt.kernels.vectors import (
    SQRT_HALF,
    Rotation,
    Vec3,
    axis_z,
    cross,
    dot,
    least,
    turned,
)
from pmopt.mechanisms.bodies import Body, plate, tube
from pmopt.mechanisms.catalogue.ups_sp_forward import sp_assemble, sp_MODES, sp_WORK
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
    SerialChain,
    Spherical,
    Structure,
    Universal,
)
from pmopt.numerics.matrices import determinant, norm_of, product
from pmopt.numerics.rotation import rotation_matrices

TINY = 1e-300

_PAPER = "paper, section 4"
_STROKE = (45.0, 90.0)
_MM = 1e-3


class Leg(NamedTuple):
    """One UPS limb of a design."""

    x: float  # b_i - b_4, platform frame, mm
    y: float
    low: float  # stroke, mm
    high: float
    in_base: Vec3  # direction at home, base frame
    in_platform: Vec3  # direction at home, platform frame


class Constants(NamedTuple):
    """One design, as kernel functions take it."""

    base: float  # A / 2, mm
    scale: float  # 1 / characteristic length, 1/mm; 1 for the raw Jacobian
    leg1: Leg
    leg2: Leg
    leg3: Leg
    low4: float  # stroke of limb 4, mm
    high4: float
    b4x: float  # b_4, platform frame, mm
    b4y: float
    post: Vec3  # direction of limb 4 at home, base frame


class Turn(NamedTuple):
    """Orientation of the platform, and what rates of angles need."""

    rotation: Rotation
    sin_phi: float
    cos_phi: float


class Span(NamedTuple):
    """A limb at a pose."""

    arm: Vec3  # s_i = R ((0, 0, l4) + e_i), from A4 to B_i, mm
    gap: Vec3  # B_i - A_i, mm
    length: float  # mm


def sp_turn(phi, theta, psi):  # type: ignore[no-untyped-def]
    """Return the platform's orientation."""
    rotation = roll_pitch_yaw(phi, theta, psi)
    sin_phi, cos_phi = sin_cos(phi)
    return Turn(rotation, sin_phi, cos_phi)


def sp_span(rotation, l4, leg, base, corner):  # type: ignore[no-untyped-def]
    """Return the limb that stands on ``corner``; ``base`` is A/2."""
    arm = turned(rotation, Vec3(leg.x, leg.y, l4))
    gap = Vec3(arm.x - base - corner.x, arm.y - base - corner.y, arm.z)
    return Span(arm, gap, math.sqrt(dot(gap, gap)))


def sp_spans(rotation, l4, k):  # type: ignore[no-untyped-def]
    """Return limbs 1 to 3."""
    a = k.base
    return (
        sp_span(rotation, l4, k.leg1, a, Vec3(a, -a, 0.0)),
        sp_span(rotation, l4, k.leg2, a, Vec3(a, a, 0.0)),
        sp_span(rotation, l4, k.leg3, a, Vec3(-a, a, 0.0)),
    )


def sp_row(span, at, scale):  # type: ignore[no-untyped-def]
    """Return the rates of l_i by phi, theta, psi (times scale) and l4."""
    unit = 1.0 / (span.length + TINY)
    # (s x n) is the moment that omega is multiplied with.
    moment = cross(span.arm, span.gap)
    mx = moment.x * unit
    my = moment.y * unit
    mz = moment.z * unit
    r = at.rotation
    return (
        mz * scale,
        (my * at.cos_phi - mx * at.sin_phi) * scale,
        (mx * r.xx + my * r.yx + mz * r.zx) * scale,
        dot(span.gap, axis_z(r)) * unit,
    )


def sp_within(span, leg, margin):  # type: ignore[no-untyped-def]
    """Return the least of a margin and of the distances to a stroke's ends."""
    return least(leg.high - span.length, least(span.length - leg.low, margin))


def sp_kernel(phi, theta, psi, l4, k):  # type: ignore[no-untyped-def]
    """Return the margin, the least distance to a stroke's end, and J^-1 of the length rates.

    Row i is (s_i x n_i).omega + (n_i.k) l4' with omega from the rates of phi, theta, psi.
    """
    at = sp_turn(phi, theta, psi)
    s1, s2, s3 = sp_spans(at.rotation, l4, k)
    margin = s1.length - k.leg1.low
    margin = least(k.leg1.high - s1.length, margin)
    margin = sp_within(s2, k.leg2, margin)
    margin = sp_within(s3, k.leg3, margin)
    margin = least(l4 - k.low4, margin)
    margin = least(k.high4 - l4, margin)
    return (
        margin,
        *sp_row(s1, at, k.scale),
        *sp_row(s2, at, k.scale),
        *sp_row(s3, at, k.scale),
        0.0, 0.0, 0.0, 1.0,
    )  # fmt: skip


def sp_stroke(part, r, span, leg):  # type: ignore[no-untyped-def]
    """Cut a part (start, end) of a line along l4 to a limb's stroke; the limb at l4 = 0."""
    along = dot(span.gap, axis_z(r))
    across2 = dot(span.gap, span.gap) - along * along
    return part_within_stroke(part[0], part[1], -along, across2, leg.low, leg.high)


def sp_line(phi, theta, psi, l4, low, high, k):  # type: ignore[no-untyped-def]
    """Return what the strokes leave of a line along l4: l_i^2 is quadratic in l4."""
    r = roll_pitch_yaw(phi, theta, psi)
    s1, s2, s3 = sp_spans(r, 0.0, k)
    part = (k.low4 if k.low4 > low else low, k.high4 if k.high4 < high else high)
    part = sp_stroke(part, r, s1, k.leg1)
    part = sp_stroke(part, r, s2, k.leg2)
    return sp_stroke(part, r, s3, k.leg3)


def sp_point(arm, base):  # type: ignore[no-untyped-def]
    """Return the point that ``arm`` leads to from A4."""
    return Vec3(arm.x - base, arm.y - base, arm.z)


class Points(NamedTuple):
    """A configuration, base frame, mm: corners of base and platform, its centre, the limbs."""

    a1: Vec3
    a2: Vec3
    a3: Vec3
    a4: Vec3
    b1: Vec3
    b2: Vec3
    b3: Vec3
    b4: Vec3
    p: Vec3
    rotation: Rotation
    along: Vec3  # the platform's normal
    span1: Span
    span2: Span
    span3: Span
    l4: float


def sp_points(phi, theta, psi, l4, k):  # type: ignore[no-untyped-def]
    """Return the points of a configuration."""
    a = k.base
    r = roll_pitch_yaw(phi, theta, psi)
    s1, s2, s3 = sp_spans(r, l4, k)
    return Points(
        a1=Vec3(a, -a, 0.0),
        a2=Vec3(a, a, 0.0),
        a3=Vec3(-a, a, 0.0),
        a4=Vec3(-a, -a, 0.0),
        b1=sp_point(s1.arm, a),
        b2=sp_point(s2.arm, a),
        b3=sp_point(s3.arm, a),
        b4=sp_point(turned(r, Vec3(0.0, 0.0, l4)), a),
        p=sp_point(turned(r, Vec3(-k.b4x, -k.b4y, l4)), a),
        rotation=r,
        along=axis_z(r),
        span1=s1,
        span2=s2,
        span3=s3,
        l4=l4,
    )


class Cones(NamedTuple):
    """Cosines between limbs and their directions at home, in the base and in the platform."""

    U_A1: float
    U_A2: float
    U_A3: float
    S_B1: float
    S_B2: float
    S_B3: float
    S_A4: float


def sp_in_base(span, leg):  # type: ignore[no-untyped-def]
    """Return the cosine between a limb and its direction at home in the base."""
    return dot(span.gap, leg.in_base) * (1.0 / (span.length + TINY))


def sp_in_platform(span, r, leg):  # type: ignore[no-untyped-def]
    """Return the cosine between a limb and its direction at home in the platform."""
    return dot(span.gap, turned(r, leg.in_platform)) * (1.0 / (span.length + TINY))


def sp_cones(at, k):  # type: ignore[no-untyped-def]
    """Return the cosines of the cone angles."""
    return Cones(
        U_A1=sp_in_base(at.span1, k.leg1),
        U_A2=sp_in_base(at.span2, k.leg2),
        U_A3=sp_in_base(at.span3, k.leg3),
        S_B1=sp_in_platform(at.span1, at.rotation, k.leg1),
        S_B2=sp_in_platform(at.span2, at.rotation, k.leg2),
        S_B3=sp_in_platform(at.span3, at.rotation, k.leg3),
        S_A4=dot(at.along, k.post),
    )


class Positions(NamedTuple):
    """Lengths of the limbs, mm."""

    l1: float
    l2: float
    l3: float
    l4: float


def sp_positions(at, k):  # type: ignore[no-untyped-def]
    """Return the limbs' lengths."""
    return Positions(at.span1.length, at.span2.length, at.span3.length, at.l4)


def _ups(i: int, tangent: Vec3) -> SerialChain:
    """Return UPS limb i; the first axis of its U joint is tangential in the base (ours)."""
    along = Along(f"a{i}", f"b{i}")
    return SerialChain(
        f"limb {i}",
        (
            Universal(f"a{i}", tangent, Normal(tangent, along)),
            Prismatic(f"a{i}", along, drives=f"l{i}"),
            Spherical(f"b{i}"),
        ),
        bars=(f"a{i}", f"b{i}"),
        spoke=f"b{i}",
    )


STRUCTURE = Structure(
    Evaluated(sp_points, Points),
    place="p",
    rotation="rotation",
    chains=(
        _ups(1, Vec3(SQRT_HALF, SQRT_HALF, 0.0)),
        _ups(2, Vec3(-SQRT_HALF, SQRT_HALF, 0.0)),
        _ups(3, Vec3(-SQRT_HALF, -SQRT_HALF, 0.0)),
        SerialChain(
            "limb 4",
            (Spherical("a4"), Prismatic("a4", "along", drives="l4")),
            bars=("a4", "b4"),
            spoke="b4",
        ),
    ),
    cones=Evaluated(sp_cones, Cones),
    positions=Evaluated(sp_positions, Positions),
)


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
    constants = Constants
    line = staticmethod(sp_line)
    line_axis = 3
    line_parts = 1
    structure = STRUCTURE
    roles = ("yaw", "pitch", "roll", "l4")
    assembler = Assembler(sp_assemble, sp_MODES, 6, sp_WORK)
    completeness = "by a polynomial of degree 8, whose real roots are counted"

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

    def kernel_constants(
        self, parameters: Parameters, working_mode: str, length: float, limits: Ranges
    ) -> Constants:
        """Return the constants of a design."""
        _, platform = _corners(parameters)
        arms = platform[:3] - platform[3]
        _, gaps, rotation, _ = self._vectors(parameters, self.home(parameters))
        units = gaps / np.linalg.norm(gaps, axis=1, keepdims=True)
        turned_back = product(units, rotation)
        ends = [limits.get(c.name, (-math.inf, math.inf)) for c in self.joints]
        legs = []
        for i in range(3):
            x, y, _ = arms[i].tolist()
            low, high = ends[i]
            in_base, in_platform = Vec3(*units[i].tolist()), Vec3(*turned_back[i].tolist())
            legs.append(Leg(x, y, low, high, in_base, in_platform))
        leg1, leg2, leg3 = legs
        low4, high4 = ends[3]
        b4x, b4y = platform[3, :2].tolist()
        return Constants(
            base=float(parameters["A"] or 0.0) / 2,
            scale=1 / length,
            leg1=leg1,
            leg2=leg2,
            leg3=leg3,
            low4=low4,
            high4=high4,
            b4x=b4x,
            b4y=b4y,
            post=Vec3(*rotation[:, 2].tolist()),
        )

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

"""2PaUU-PPaP: three translations from two crank limbs and a prismatic one.

Symbols as in "Kinematic Analysis and Multi-objective Scale Synthesis of Low Coupling
2PaUU-PPaP Parallel Mechanism": m, n, l1, l2, c, theta. Every equation was re-derived; where the
paper's print differs (see docs/mechanisms/2pauu-ppap.md), this file is what the tables fit.

Geometry, z pointing from the base towards the workspace, limb i in (1, 2)::

    C1 = ( m + l1 cos t1, 0, 2c - l1 sin t1)      D1 = (x + n, y, z)
    C2 = (-m - l1 cos t2, 0, 2c - l1 sin t2)      D2 = (x - n, y, z)
    |D_i - C_i| = l2,        y = d

With a1 = m - n - x, a2 = m - n + x, b = z - 2c, and r^2 = a^2 + b^2 the constraint of a limb is
A cos t + B sin t + C = 0, A = 2 l1 a, B = 2 l1 b, C = r^2 + y^2 + l1^2 - l2^2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np

from pmopt.compiler.programs import Assembler
from pmopt.kernels.trigonometry import arc_tangent
from pmopt.kernels.vectors import MINUS_Y, Vec3, X, Y, least, minus
from pmopt.mechanisms.bodies import Body, plate, tube
from pmopt.mechanisms.catalogue.pauu_ppap_forward import pauu_assemble
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
    wrap_angle,
)
from pmopt.mechanisms.structure import (
    Evaluated,
    Normal,
    Parallelogram,
    Prismatic,
    SerialChain,
    Structure,
    Universal,
)
from pmopt.numerics import elementary
from pmopt.numerics.matrices import product

#: Sign s of the root in theta = atan2(B, A) + s acos(-C / sqrt(A^2 + B^2)), limbs 1 and 2.
MODE_SIGNS = {"out-out": (-1, -1), "in-in": (1, 1), "out-in": (-1, 1), "in-out": (1, -1)}

#: Poses this close to a limb's singular surface, relative to l1 + l2, count as on it: it is what
#: rounding leaves of a pose computed to lie there.
ON_SURFACE = 1e-9

TINY = 1e-300
#: Whether the cranks have limits: without them the margin needs no angles, hence no root.
PAUU_CRANK_LIMITS = 1

_PAPER = "paper, section 5.1 (default) and 6.2 (bounds)"


class Arc(NamedTuple):
    """Range of a crank's angle t: inside is l1 cos(t - middle) >= l1 cos(half-width)."""

    cos: float  # of the middle
    sin: float
    least: float  # l1 cos(half-width), m; -inf where all angles are allowed


class Stroke(NamedTuple):
    """Range of the slider's position, m."""

    low: float
    high: float


class Link(NamedTuple):
    """A link at home in the plane of the cranks, divided by l2^2; 1/m."""

    x: float
    z: float


class Constants(NamedTuple):
    """One design, as kernel functions take it."""

    span: float  # m - n, m
    height: float  # 2 c, of the crank pivots, m
    l1: float  # m
    excess: float  # l1^2 - l2^2, m^2
    sign1: float  # of the crank's root, by working mode
    sign2: float
    weight: float  # characteristic length, m; 1 for the raw Jacobian
    top: float  # largest z, m; inf for none
    arc1: Arc
    arc2: Arc
    slider: Stroke
    n: float  # m
    home1: Link
    home2: Link
    long: float  # long bars of limb 3, m


class Crank(NamedTuple):
    """A limb's crank at a pose."""

    reach: float  # A^2 + B^2 - C^2, m^4 / 4: >= 0 where the limb reaches the pose
    root: float  # signed root of it, m^2
    out: float  # l1 cos t, m
    rise: float  # l1 sin t, m


class Points(NamedTuple):
    """Points of a configuration, m: pivots A, knees C, ends D of links, platform, limb 3's foot."""

    a1: Vec3
    a2: Vec3
    c1: Vec3
    c2: Vec3
    d1: Vec3
    d2: Vec3
    p: Vec3
    foot: Vec3


class Cones(NamedTuple):
    """Cosines of the cone angles of the U joints."""

    U_C1: float
    U_D1: float
    U_C2: float
    U_D2: float


class Positions(NamedTuple):
    """Positions of the actuated joints, and the bars of limb 3, m."""

    theta1: float
    theta2: float
    d: float
    bar: Vec3


def pauu_crank(a, b, y, l1, excess, sign):  # type: ignore[no-untyped-def]
    """Return a limb's crank.

    With S = sqrt(A^2 + B^2 - C^2) the root is (-A C - s B S, -B C + s A S) / (A^2 + B^2).
    """
    r = a * a + b * b
    c = r + y * y + excess
    square = 4.0 * l1 * l1 * r - c * c
    root = sign * math.sqrt(square if square > 0.0 else 0.0)
    half = 0.5 / (r + TINY)
    return Crank(square, root, -(a * c + b * root) * half, (a * root - b * c) * half)


def pauu_cranks(x, y, z, k):  # type: ignore[no-untyped-def]
    """Return both cranks."""
    b = z - k.height
    return (
        pauu_crank(k.span - x, b, y, k.l1, k.excess, k.sign1),
        pauu_crank(k.span + x, b, y, k.l1, k.excess, k.sign2),
    )


def pauu_within(crank, arc):  # type: ignore[no-untyped-def]
    """Return how far inside its range a crank's angle is; >= 0 is inside."""
    return arc.cos * crank.out + arc.sin * crank.rise - arc.least


def kernel(x, y, z, k):  # type: ignore[no-untyped-def]
    """Return the margin and det(J_q) J^-1 at a pose, branch-free and without trigonometry.

    The margin is the least of the limbs' (A^2 + B^2 - C^2) and of the joints' limits; >= 0 is
    within. u.e = s S / 2, so that q2 u1, q1 u2, q1 q2 e_y stay finite where q_i = u_i.e_i is 0.
    """
    one, two = pauu_cranks(x, y, z, k)
    margin = least(k.top - z, least(one.reach, two.reach))
    if PAUU_CRANK_LIMITS:
        margin = least(pauu_within(one, k.arc1), margin)
        margin = least(pauu_within(two, k.arc2), margin)
    margin = least(y - k.slider.low, margin)
    margin = least(k.slider.high - y, margin)

    b = z - k.height
    q1 = 0.5 * one.root
    q2 = 0.5 * two.root
    g1 = k.weight * q2
    g2 = k.weight * q1
    return (
        margin,
        -(k.span - x + one.out) * g1, y * g1, (b + one.rise) * g1,
        (k.span + x + two.out) * g2, y * g2, (b + two.rise) * g2,
        0.0, q1 * q2, 0.0,
    )  # fmt: skip


def line(x, y, z, low, high, k):  # type: ignore[no-untyped-def]
    """Return what both tori leave of a line along y.

    It has (r - l1)^2 + y^2 <= l2^2 <= (r + l1)^2 + y^2 for both limbs. The limits of the crank
    angles are left to the margin.
    """
    l1 = k.l1
    b = z - k.height
    a1 = k.span - x
    a2 = k.span + x
    r1 = math.sqrt(a1 * a1 + b * b)
    r2 = math.sqrt(a2 * a2 + b * b)
    link2 = l1 * l1 - k.excess
    outer = least(link2 - (r1 - l1) * (r1 - l1), link2 - (r2 - l1) * (r2 - l1))
    inner1 = link2 - (r1 + l1) * (r1 + l1)
    inner2 = link2 - (r2 + l1) * (r2 + l1)
    inner = inner1 if inner1 > inner2 else inner2
    far = math.sqrt(outer if outer > 0.0 else 0.0)
    near = math.sqrt(inner if inner > 0.0 else 0.0)
    return (
        -far if -far > low else low, -near if -near < high else high,
        near if near > low else low, far if far < high else high,
    )  # fmt: skip


def pauu_points(x, y, z, k):  # type: ignore[no-untyped-def]
    """Return the points of a configuration."""
    one, two = pauu_cranks(x, y, z, k)
    m = k.span + k.n
    return Points(
        a1=Vec3(m, 0.0, k.height),
        a2=Vec3(-m, 0.0, k.height),
        c1=Vec3(m + one.out, 0.0, k.height - one.rise),
        c2=Vec3(-m - two.out, 0.0, k.height - two.rise),
        d1=Vec3(x + k.n, y, z),
        d2=Vec3(x - k.n, y, z),
        p=Vec3(x, y, z),
        foot=Vec3(0.0, y, k.height),
    )


def pauu_cones(at, k):  # type: ignore[no-untyped-def]
    """Return the cones: neither bars nor platform turn, both U joints of a link swing alike."""
    link1 = minus(at.d1, at.c1)
    link2 = minus(at.d2, at.c2)
    cone1 = link1.x * k.home1.x + link1.z * k.home1.z
    cone2 = link2.x * k.home2.x + link2.z * k.home2.z
    return Cones(cone1, cone1, cone2, cone2)


def pauu_positions(at, k):  # type: ignore[no-untyped-def]
    """Return the actuated joints' positions and limb 3's bars."""
    rise = at.p.z - k.height
    flat = k.long * k.long - rise * rise
    return Positions(
        theta1=arc_tangent(k.height - at.c1.z, at.c1.x - at.a1.x),
        theta2=arc_tangent(k.height - at.c2.z, at.a2.x - at.c2.x),
        d=at.p.y,
        bar=Vec3(math.sqrt(flat if flat > 0.0 else 0.0), 0.0, rise),
    )


#: The paper gives no axes of limb 3; these are ours. A link along y, on the boundary of the reach,
#: is crossed by every axis in xz. Limb 3 keeps the platform level and has no declared shape.
_ACROSS_1 = Normal(Y, ("c1", "d1"), otherwise=X)
_ACROSS_2 = Normal(Y, ("c2", "d2"), otherwise=X)
STRUCTURE = Structure(
    Evaluated(pauu_points, Points),
    place="p",
    chains=(
        SerialChain(
            "limb 1",
            (
                Parallelogram("a1", Y, bar=("a1", "c1"), drives="theta1"),
                Universal("c1", Y, _ACROSS_1),
                Universal("d1", _ACROSS_1, Y),
            ),
            bars=("a1", "c1", "d1"),
            spoke="d1",
        ),
        SerialChain(
            "limb 2",
            (
                Parallelogram("a2", MINUS_Y, bar=("a2", "c2"), drives="theta2"),
                Universal("c2", Y, _ACROSS_2),
                Universal("d2", _ACROSS_2, Y),
            ),
            bars=("a2", "c2", "d2"),
            spoke="d2",
        ),
        SerialChain(
            "limb 3",
            (
                Prismatic("foot", Y, drives="d"),
                Parallelogram("foot", MINUS_Y, bar="bar"),
                Prismatic("p", X),
            ),
        ),
    ),
    cones=Evaluated(pauu_cones, Cones),
    positions=Evaluated(pauu_positions, Positions),
)


class PauuPpap(Mechanism):
    """The 2PaUU-PPaP mechanism."""

    name = "2pauu-ppap"
    title = "2PaUU-PPaP"
    description = (
        "three translations (x, y, z); two parallelogram cranks and a slider, decoupled in y"
    )
    source = (
        "Kinematic Analysis and Multi-objective Scale Synthesis of Low Coupling "
        "2PaUU-PPaP Parallel Mechanism"
    )
    freedom = "3T"
    length_unit = "m"
    default_jacobian = "raw"
    length_meaning = "l1, the crank: J's crank columns become m/m"
    parameters = (
        Parameter("m", "length", 1.0, (0.5, 1.5), True, "base half-span", _PAPER),
        Parameter("n", "length", 0.7, (0.2, 1.0), True, "platform radius", _PAPER),
        Parameter("l1", "length", 0.65, (0.5, 1.5), True,
                  "crank, long bar of the parallelogram", _PAPER),
        Parameter("l2", "length", 1.5, (0.5, 1.5), True,
                  "link between the two U joints of a limb", _PAPER),
        Parameter("c", "length", 0.1, (0.1, 0.5), False,
                  "short bar of the parallelogram; the crank pivots lie at z = 2c", _PAPER),
        Parameter("h", "length", None, None, True,
                  "largest allowed height z of the platform; unset: unlimited",
                  "paper, table 1 (no value given)"),
    )  # fmt: skip
    pose = (
        Coordinate("x", "length", "across, in the plane of the cranks"),
        Coordinate("y", "length", "along the slider"),
        Coordinate("z", "length", "from the base towards the workspace"),
    )
    joints = (
        Coordinate("theta1", "angle", "crank of limb 1"),
        Coordinate("theta2", "angle", "crank of limb 2"),
        Coordinate("d", "length", "slider of limb 3"),
    )
    limbs = (
        *(
            Limb(
                f"limb {k}", "P_aUU",
                f"crank parallelogram theta{k} (actuated, axes along y), U_C{k} at C{k}, "
                f"U_D{k} at D{k}",
                (f"theta{k}", f"U_C{k}", f"U_D{k}"),
            )
            for k in (1, 2)
        ),
        Limb(
            "limb 3", "PP_aP",
            "slider d along y (actuated), parallelogram Pa_3 in xz, slider P_3 along x",
            ("d", "Pa_3", "P_3"),
        ),
    )  # fmt: skip
    conditions: ClassVar[Mapping[str, str]] = {
        "inverse": "u_i . e_i = 0: crank and link in line as seen along y",
        "forward": "u1x u2z = u1z u2x: both links parallel as seen along y",
    }
    working_modes = tuple(MODE_SIGNS)
    kernel = staticmethod(kernel)
    constants = Constants
    line = staticmethod(line)
    line_axis = 1
    line_parts = 2
    structure = STRUCTURE
    roles = ("x", "y", "z")
    assembler = Assembler(pauu_assemble, 2, 5, 1)
    completeness = "closed form: two circles meet in two points at most"
    freed = (
        "a forward singularity, the end points of both cranks coincide as seen from the platform; "
        "the poses form a circle"
    )

    def switches(self, limits: Ranges) -> dict[str, int]:
        """Return whether the cranks have limits."""
        return {"PAUU_CRANK_LIMITS": int("theta1" in limits or "theta2" in limits)}

    def characteristic_length(self, parameters: Parameters) -> float:
        """Return l1."""
        return _lengths(parameters)[2]

    def reach_box(self, parameters: Parameters, limits: Ranges) -> tuple[Vector, Vector]:
        """Return the box of both limbs' tori, cut at z = h and at the slider's limits (y = d)."""
        m, n, l1, l2, c = _lengths(parameters)
        d_low, d_high = limits.get("d", (-math.inf, math.inf))
        # The link's length in the plane of the cranks, at the slider's position nearest to it.
        offset = max(d_low, -d_high, 0.0)
        link = math.sqrt(max(l2 * l2 - offset * offset, 0.0))
        reach, shift = l1 + link, abs(m - n)
        # 4 (m - n) x is the difference of the squares of two distances r, each between the folded
        # and the stretched limb: it bounds x where the other limb's hole cuts the workspace.
        x = min(reach - shift, l1 * link / shift) if shift else reach
        # At x = 0 both cranks reach furthest along y: within l1 of the shift the full link.
        y2 = l2 * l2 - max(shift - l1, 0.0) * max(shift - l1, 0.0)
        z2 = reach * reach - shift * shift
        if x <= 0.0 or y2 <= 0.0 or z2 <= 0.0:
            return np.zeros(3), np.zeros(3)
        y, z = math.sqrt(y2), math.sqrt(z2)
        top = parameters.get("h")
        upper = 2 * c + z if top is None else min(2 * c + z, top)
        return np.array([-x, max(-y, d_low), 2 * c - z]), np.array([x, min(y, d_high), upper])

    def default_domain(self, parameters: Parameters) -> Ranges:
        """Return z >= 2c: the half above the crank pivots, the paper's half-torus."""
        return {"z": (2 * _lengths(parameters)[4], math.inf)}

    def home(self, parameters: Parameters) -> dict[str, float]:
        """Return the middle of what is reached on the z axis above the crank pivots.

        Below them, mirrored, where h leaves nothing above.
        """
        m, n, l1, l2, c = _lengths(parameters)
        shift = m - n
        low, high = (
            math.sqrt(max(r * r - shift * shift, 0.0))
            for r in (max(abs(l1 - l2), abs(shift)), l1 + l2)
        )
        top = parameters.get("h")
        room = high if top is None else min(high, top - 2 * c)
        if room <= low:
            low, room = -high, min(-low, room)
        return {"x": 0.0, "y": 0.0, "z": 2 * c + (low + room) / 2}

    def bodies(self, parameters: Parameters) -> tuple[Body, ...]:
        """Return steel tubes as bars and links, blocks that join them, and a flat platform."""
        _, n, l1, l2, _ = _lengths(parameters)
        joint = plate((0.05, 0.05, 0.05), 1.0)
        result = []
        for i, limb in enumerate(self.limbs[:2]):
            result += [
                tube(0.025, l1, 1.0, bore=0.021).times(2).body(f"{limb.name} bars", i, 0, "bars"),
                joint.body(f"{limb.name} knee", i, 0),
                tube(0.025, l2, 1.0, bore=0.021).body(f"{limb.name} link", i, 1),
            ]
        return (
            *result,
            plate((0.1, 0.1, 0.05), 1.0).body("limb 3 carriage", 2, 0),
            tube(0.025, l1 + l2, 1.0, bore=0.021).times(2).body("limb 3 bars", 2, 1, "bars"),
            joint.body("limb 3 knee", 2, 1),
            plate((2 * n, 0.06, 0.01), 1.0).body("platform"),
        )

    def platform(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Matrix, Vector]:
        """Return no rotation and (x, y, z)."""
        return np.eye(3), np.array([pose["x"], pose["y"], pose["z"]])

    def reach(self, parameters: Parameters, pose: Mapping[str, float]) -> tuple[Reach, ...]:
        """Return how far the end point lies inside the torus each crank limb sweeps.

        A limb reaches what lies between two surfaces: the torus of radii l1 and l2 about the
        crank axis, and the part of it that encloses the axis. The distances to both are exact.
        """
        _, _, l1, l2, _ = _lengths(parameters)
        y = pose["y"]
        result = []
        for limb, (a, b) in zip(self.limbs, _planar(parameters, pose), strict=False):
            r = math.hypot(a, b)
            near, far = math.hypot(r - l1, y), math.hypot(r + l1, y)
            stretched = l2 - near <= far - l2 and (r >= l1 or abs(y) > l2)
            reason = "too far" if stretched else "too close"
            result.append(Reach(limb.name, min(l2 - near, far - l2), reason))
        return tuple(result)

    def inverse(
        self, parameters: Parameters, pose: Mapping[str, float]
    ) -> tuple[InverseSolution, ...]:
        """Solve A cos t + B sin t + C = 0 for both cranks (paper, eq. 15, misprints mended)."""
        _, _, l1, l2, _ = _lengths(parameters)
        if any(r.distance < -ON_SURFACE * (l1 + l2) for r in self.reach(parameters, pose)):
            return ()
        angles = []
        for a, b in _planar(parameters, pose):
            big_a, big_b = 2 * l1 * a, 2 * l1 * b
            big_c = a * a + b * b + pose["y"] * pose["y"] + l1 * l1 - l2 * l2
            # atan2 of sine and cosine keeps the digits that acos(-C / R) loses near the surface.
            root = math.sqrt(max(big_a * big_a + big_b * big_b - big_c * big_c, 0.0))
            middle, half = elementary.atan2(big_b, big_a), elementary.atan2(root, -big_c)
            angles.append((middle, half))
        (middle1, half1), (middle2, half2) = angles
        return tuple(
            InverseSolution(
                mode,
                {
                    "theta1": wrap_angle(middle1 + s1 * half1),
                    "theta2": wrap_angle(middle2 + s2 * half2),
                    "d": pose["y"],
                },
                {},
            )
            for mode, (s1, s2) in MODE_SIGNS.items()
        )

    def assembly_constants(self, parameters: Parameters) -> list[float]:
        """Return the constants of :func:`pauu_assemble`."""
        m, n, l1, l2, c = _lengths(parameters)
        return [m - n, l1, l2, 2 * c]

    def velocity_maps(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> tuple[Matrix, Matrix]:
        """Return J_X = [u1; u2; e_y], J_q = diag(u1.e1, u2.e2, 1) (paper, eq. 18; N32 is 1)."""
        l1 = _lengths(parameters)[2]
        t1, t2 = joints["theta1"], joints["theta2"]
        u1, u2 = self._links(parameters, pose, joints)
        e1 = np.array([-l1 * elementary.sin(t1), 0.0, -l1 * elementary.cos(t1)])
        e2 = np.array([l1 * elementary.sin(t2), 0.0, -l1 * elementary.cos(t2)])
        return np.array([u1, u2, [0.0, 1.0, 0.0]]), np.diag([product(u1, e1), product(u2, e2), 1.0])

    def singularity_measures(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> dict[str, dict[str, float]]:
        """Return u_i.e_i / (l1 l2) and (u1x u2z - u1z u2x) / l2^2, both in [-1, 1]."""
        _, _, l1, l2, _ = _lengths(parameters)
        j_x, j_q = self.velocity_maps(parameters, pose, joints)
        u1, u2 = j_x[0], j_x[1]
        return {
            "inverse": {self.limbs[i].name: float(j_q[i, i]) / (l1 * l2) for i in range(2)},
            "forward": {"platform": float(u1[0] * u2[2] - u1[2] * u2[0]) / (l2 * l2)},
        }

    def velocity_map_units(self) -> dict[str, str]:
        """Return the units of J_X's and J_q's rows."""
        return {"J_X": "rows in m; m; 1", "J_q": "diagonal in m^2/rad; m^2/rad; 1"}

    def pose_limits(self, parameters: Parameters) -> Ranges:
        """Return z <= h."""
        top = parameters.get("h")
        return {} if top is None else {"z": (-math.inf, top)}

    def why_not(self, parameters: Parameters, joints: Mapping[str, float]) -> str:
        """Compare what the links have to span with their length."""
        l2, d = _lengths(parameters)[3], joints["d"]
        centre1, centre2 = _centres(parameters, joints)
        span = math.hypot(d, math.hypot(*(centre2 - centre1)) / 2)
        return (
            f"each link would have to be at least {span:.6g} m long, "
            f"{span - l2:.6g} m more than l2 = {l2!r} m"
        )

    def kernel_constants(
        self, parameters: Parameters, working_mode: str, length: float, limits: Ranges
    ) -> Constants:
        """Return the constants of a design."""
        m, n, l1, l2, c = _lengths(parameters)
        s1, s2 = MODE_SIGNS[working_mode]
        top = parameters.get("h")
        home1, home2 = self._links_at_home(parameters, s1, s2)
        return Constants(
            span=m - n,
            height=2 * c,
            l1=l1,
            excess=(l1 - l2) * (l1 + l2),
            sign1=s1,
            sign2=s2,
            weight=length,
            top=math.inf if top is None else top,
            arc1=_arc(l1, limits.get("theta1")),
            arc2=_arc(l1, limits.get("theta2")),
            slider=Stroke(*limits.get("d", (-math.inf, math.inf))),
            n=n,
            home1=home1,
            home2=home2,
            long=l1 + l2,
        )

    def idle_slacks(self, limits: Ranges) -> frozenset[int]:
        """Return the cranks' slacks, 3 and 4, where they may turn in full."""
        return frozenset(
            3 + k
            for k, joint in enumerate(("theta1", "theta2"))
            if np.ptp(limits.get(joint, (-math.pi, math.pi))) >= 2 * math.pi
        )

    def _links_at_home(self, parameters: Parameters, s1: int, s2: int) -> tuple[Link, Link]:
        """Return both links at home (x = y = 0 there)."""
        m, n, l1, l2, c = _lengths(parameters)
        span, b, excess = m - n, self.home(parameters)["z"] - 2 * c, (l1 - l2) * (l1 + l2)
        one = pauu_crank(span, b, 0.0, l1, excess, s1)
        two = pauu_crank(span, b, 0.0, l1, excess, s2)
        if one.reach < 0:
            return Link(0.0, 0.0), Link(0.0, 0.0)  # nothing is reachable
        square = l2 * l2
        return (
            Link((-span - one.out) / square, (b + one.rise) / square),
            Link((span + two.out) / square, (b + two.rise) / square),
        )

    def _links(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> tuple[Vector, Vector]:
        """Return u_i = D_i - C_i."""
        m, n, l1, _, c = _lengths(parameters)
        end = np.array([pose["x"], pose["y"], pose["z"]])
        t1, t2 = joints["theta1"], joints["theta2"]
        c1 = np.array([m + l1 * elementary.cos(t1), 0.0, 2 * c - l1 * elementary.sin(t1)])
        c2 = np.array([-m - l1 * elementary.cos(t2), 0.0, 2 * c - l1 * elementary.sin(t2)])
        offset = np.array([n, 0.0, 0.0])
        return end + offset - c1, end - offset - c2


def _lengths(parameters: Parameters) -> tuple[float, float, float, float, float]:
    """Return m, n, l1, l2, c."""
    m, n, l1, l2, c = (float(parameters[k] or 0.0) for k in ("m", "n", "l1", "l2", "c"))
    return m, n, l1, l2, c


def _arc(l1: float, limits: tuple[float, float] | None) -> Arc:
    """Return the range of a crank's angle; all angles without limits."""
    low, high = limits or (-math.pi, math.pi)
    middle, half = (low + high) / 2, (high - low) / 2
    # A full turn excludes nothing, not even by rounding.
    least = -math.inf if half >= math.pi else l1 * elementary.cos(half)
    return Arc(elementary.cos(middle), elementary.sin(middle), least)


def _centres(parameters: Parameters, joints: Mapping[str, float]) -> tuple[Vector, Vector]:
    """Return C1 and C2 in the xz plane, each moved by the platform's radius to the end point."""
    m, n, l1, _, c = _lengths(parameters)
    t1, t2 = joints["theta1"], joints["theta2"]
    return (
        np.array([m - n + l1 * elementary.cos(t1), 2 * c - l1 * elementary.sin(t1)]),
        np.array([n - m - l1 * elementary.cos(t2), 2 * c - l1 * elementary.sin(t2)]),
    )


def _planar(parameters: Parameters, pose: Mapping[str, float]) -> tuple[tuple[float, float], ...]:
    """Return (a_i, b) of both crank limbs."""
    m, n, _, _, c = _lengths(parameters)
    b = pose["z"] - 2 * c
    return (m - n - pose["x"], b), (m - n + pose["x"], b)


MECHANISM = PauuPpap()

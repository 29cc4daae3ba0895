"""2UU-UPU, in the geometry that keeps its freedoms in motion (2UU-UPS): 1T2R.

Symbols after "Dynamic Modeling and Simulation of a 3-DOF Parallel Sorting Robot", whose own
layout of axes is instantaneous only (see docs/mechanisms/2uu-upu.md). The two UU limbs are a
four-bar B2 P2 P3 B3 in a plane that turns about the line B2B3, parallel to y.

Internal coordinates q = (phi, kappa, psi): the plane's turn about y, the coupler's turn in the
plane and the platform's turn about the coupler. With a, c half the sides of base and platform::

    Rot = Ry(phi) Rx(kappa) Ry(psi),  n = Ry(phi) x,  o = Ry(phi) Rx(kappa) y
    rho^2 = a^2 + c^2 - 2 a c cos kappa,   f = s sqrt(L^2 / rho^2 - 1)
    M = Bm + Ry(phi) (0, f c sin kappa, f (a - c cos kappa))      middle of the coupler P2P3
    P = M + R/2 Rot x,   P1 = M + 3R/2 Rot x,   P2, P3 = M +- c o
    L (sin d2, cos d2) = P2 - B2 and L (sin d3, cos d3) = P3 - B3, in the plane's (y, height)
    P1 - B1 = l1 (sin theta1 cos eta1, sin eta1, cos theta1 cos eta1)

A task pose (x, beta, gamma) tells the third row of Rot, (-sin beta, m, cos beta cos gamma) with
m = cos beta sin gamma; mu^2 = 1 - m^2. What is left is a curve, here told by v = w - psi with
mu (sin w, cos w) = (sin beta, cos beta cos gamma)::

    sin phi = mu sin v,  cos phi = sqrt(cos^2 v + m^2 sin^2 v)
    cos kappa = mu cos v / cos phi,  sin kappa = m / cos phi

on which P_x = x is solved, with u = tan(v / 2) as the unknown. Every configuration is on it once:
phi beyond 90 degrees is the same with phi - 180 degrees, -kappa, psi - 180 degrees and -s.

Working modes are told by s: M above the base or below it as the platform stands level. Their root
is the one on the piece of the curve about v = 0 on which P_x is monotonic, which the kernel finds.
:meth:`UuUpu.inverse` also tells the others, "up-2", "up-3", .., "down-2", ..: configurations beyond
P_x's extremes, with the limb plane folded down or kappa large. They are answers of the inverse
kinematics and no modes of a workspace.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from pmopt.compiler.programs import Assembler
from pmopt.errors import UnreachableError, unknown_name
from pmopt.kernels.vectors import (
    Vec3,
    Y,
)
from pmopt.mechanisms.bodies import Body, triangle, tube
from pmopt.mechanisms.catalogue.uu_upu_configuration import (
    MODE_SIGNS,
    Configuration,
    configuration,
    geometry_of,
    lengths_of,
    matching,
    nearest_to,
    pose_rates,
    rates,
    root_of,
    span_of,
)
from pmopt.mechanisms.catalogue.uu_upu_forward import uu_assemble
from pmopt.mechanisms.catalogue.uu_upu_inverse import uup_invert, uup_MOST, uup_ROOM
from pmopt.mechanisms.catalogue.uu_upu_kernel import (
    TINY,
    Arc,
    Cones,
    Constants,
    Points,
    Positions,
    Stroke,
    Turn,
    kernel,
    uup_CLOSE,
    uup_cones,
    uup_of_v,
    uup_placed,
    uup_points,
    uup_positions,
)
from pmopt.mechanisms.mechanism import (
    Chain,
    Coordinate,
    Curve,
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
from pmopt.mechanisms.structure import (
    Evaluated,
    Freedom,
    Normal,
    Prismatic,
    SerialChain,
    Spherical,
    Structure,
    Universal,
)
from pmopt.numerics import elementary
from pmopt.numerics.matrices import determinant, product

_OURS = "ours"
_PAPER = "paper, section 4 (default); bounds ours"


#: The axes are those theta1, eta1, phi, delta2 and delta3 turn about. Where P1 lies on theta1's
#: axis, eta1 turns about any axis across it.
STRUCTURE = Structure(
    Evaluated(uup_points, Points),
    place="p",
    rotation="rotation",
    chains=(
        SerialChain(
            "limb 1",
            (
                Universal(
                    "b1",
                    Y,
                    Normal(("b1", "p1"), Y, otherwise=Vec3(-1.0, 0.0, 0.0)),
                    drives_first="theta1",
                ),
                Prismatic("b1", "along"),
                Spherical("p1"),
            ),
            bars=("b1", "p1"),
            spoke="p1",
        ),
        SerialChain(
            "limb 2",
            (Universal("b2", Y, "lower", drives_first="phi"), Universal("p2", "upper", "o")),
            bars=("b2", "p2"),
            spoke="p2",
        ),
        SerialChain(
            "limb 3",
            (Universal("b3", Y, "lower", drives_second="delta3"), Universal("p3", "upper", "o")),
            bars=("b3", "p3"),
            spoke="p3",
        ),
    ),
    cones=Evaluated(uup_cones, Cones),
    positions=Evaluated(uup_positions, Positions),
    followed={
        "l1": (Freedom("l1"),),
        "eta1": (Freedom("U_B1", "second"),),
        "delta2": (Freedom("U_B2", "second"),),
        "kappa": (Freedom("U_P2", "first"), Freedom("U_B2", "second", -1.0)),
        "psi": (Freedom("U_P2", "second"),),
    },
)


class UuUpu(Mechanism):
    """The 2UU-UPU mechanism as 2UU-UPS."""

    name = "2uu-upu"
    title = "2UU-UPU (as 2UU-UPS)"
    description = (
        "one translation and two rotations (x, beta, gamma); sorting robot. The rod of the UPU "
        "limb is not keyed (2UU-UPS): the paper's own layout moves at one pose only"
    )
    source = "Dynamic Modeling and Simulation of a 3-DOF Parallel Sorting Robot"
    freedom = "1T2R"
    length_unit = "m"
    default_jacobian = "homogenized"
    length_meaning = "R = ps / sqrt 3, the platform's radius: angles become arcs at its corners"
    parameters = (
        Parameter("bs", "length", 0.35, (0.25, 0.5), True,
                  "side of the base triangle B1B2B3", _PAPER),
        Parameter("ps", "length", 0.31, (0.2, 0.45), True,
                  "side of the platform triangle P1P2P3", _PAPER),
        Parameter("L", "length", 0.25, (0.2, 0.4), True,
                  "link of the UU limbs, between their U joints", _PAPER),
    )  # fmt: skip
    pose = (
        Coordinate("x", "length", "platform centre, along the line from B2B3 to B1"),
        Coordinate("beta", "angle", "pitch, Rot = Rz(alpha) Ry(beta) Rx(gamma)"),
        Coordinate("gamma", "angle", "roll, Rot = Rz(alpha) Ry(beta) Rx(gamma)"),
    )
    parasitic = (
        Coordinate("y", "length", "platform centre, along B3B2"),
        Coordinate("z", "length", "platform centre, height over the base"),
        Coordinate("alpha", "angle", "yaw, Rot = Rz(alpha) Ry(beta) Rx(gamma)"),
    )
    joints = (
        Coordinate("theta1", "angle", "limb 1, first axis of its base U (along y)"),
        Coordinate("phi", "angle", "limb 2, first axis of its base U: turn of the limb plane"),
        Coordinate("delta3", "angle", "limb 3, second axis of its base U: swing in the plane"),
    )
    passive = (
        Coordinate("l1", "length", "limb 1, length B1P1"),
        Coordinate("eta1", "angle", "limb 1, second axis of its base U"),
        Coordinate("delta2", "angle", "limb 2, second axis of its base U: swing in the plane"),
        Coordinate("kappa", "angle", "turn of P2P3 against B2B3 in the limb plane"),
        Coordinate("psi", "angle", "turn of the platform about P2P3"),
    )
    limbs = (
        Limb("limb 1", "UPS",
             "U_B1 at B1 (first axis along y, theta1, actuated), telescope l1, S_P1 at P1",
             ("U_B1", "l1", "S_P1")),
        Limb("limb 2", "UU", "U_B2 at B2 (first axis along B2B3, phi, actuated), U_P2 at P2",
             ("U_B2", "U_P2")),
        Limb("limb 3", "UU",
             "U_B3 at B3 (second axis normal to the limb plane, delta3, actuated), U_P3 at P3",
             ("U_B3", "U_P3")),
    )  # fmt: skip
    layouts: ClassVar[Mapping[str, str]] = {
        "paper": "2UU-UPU as the paper names it: first and last axes radial, the others across "
        "the links, platform centred; free at that pose only"
    }
    conditions: ClassVar[Mapping[str, str]] = {
        "inverse": "dP_x/dv = 0: of all configurations with these beta and gamma P_x is extreme",
        "inverse, limb 1": "eta1 = +-90 deg: P1 is on theta1's axis",
        "forward": "link 2 is in line with P2P3, or theta1 does not hold psi",
        "forward, link 2": "kappa + delta2 = +-90 deg: link 2 is in line with P2P3",
        "forward, limb 1": "dtheta1/dpsi = 0: P1 moves in the plane of theta1's axis and limb 1",
    }
    working_modes = tuple(MODE_SIGNS)
    kernel = staticmethod(kernel)
    constants = Constants
    curve = Curve(0, uup_of_v)
    structure = STRUCTURE
    roles = ("x", "pitch", "roll")
    assembler = Assembler(uu_assemble, 4, 8, 1)
    inverter = Assembler(uup_invert, uup_MOST, 12, 9 * uup_ROOM + 4 * uup_MOST + 6)
    inverted_passive = ("l1", "eta1", "delta2", "kappa", "psi")
    completeness = "closed form: two circles, then two turns of the platform at most"
    freed = (
        "a forward singularity, P3 in B2 or P1 in theta1's plane at every turn; the platform is "
        "free to move"
    )
    parasitic_roles = ("y", "z", "yaw")

    def characteristic_length(self, parameters: Parameters) -> float:
        """Return R = ps / sqrt 3."""
        return lengths_of(parameters)[4]

    def reach_box(self, parameters: Parameters, limits: Ranges) -> tuple[Vector, Vector]:
        """Return |P_x + r/2| <= highest M + R/2, cut by |P1 - B1| <= l1; angles in full."""
        a, c, length, r, big_r = lengths_of(parameters)
        height = math.sqrt(max(length * length - (a - c) * (a - c), 0.0))
        low, high = -r / 2 - height - big_r / 2, -r / 2 + height + big_r / 2
        longest = limits.get("l1", (-math.inf, math.inf))[1]
        low, high = max(low, r - longest - big_r), min(high, r + longest + big_r)
        if height == 0.0 or low >= high:
            return np.zeros(3), np.zeros(3)
        angles = np.array([math.pi / 2, math.pi])
        return np.array([low, *-angles]), np.array([high, *angles])

    def default_domain(self, parameters: Parameters) -> Ranges:
        """Return tilts up to 60 degrees (ours)."""
        return {"beta": (-math.pi / 3, math.pi / 3), "gamma": (-math.pi / 3, math.pi / 3)}

    def bodies(self, parameters: Parameters) -> tuple[Body, ...]:
        """Return a cylinder and a rod keyed to it, two links and a triangular plate, of steel."""
        length = lengths_of(parameters)[2]
        tube_length = 0.64 * length
        link = tube(0.02, length, 1.0)
        rod = tube(0.015, tube_length, 1.0).at((0.0, 0.0, -tube_length))
        return (
            tube(0.025, tube_length, 1.0).body("limb 1 cylinder", 0, 0),
            rod.body("limb 1 rod", 0, 1),
            link.body("limb 2 link", 1, 0),
            link.body("limb 3 link", 2, 0),
            triangle(float(parameters["ps"] or 0.0), 0.01, 1.0).body("platform"),
        )

    def default_limits(self, parameters: Parameters) -> Ranges:
        """Return l1 between 0.64 L and 1.12 L: the paper's stroke of 120 mm at L = 250 mm."""
        length = lengths_of(parameters)[2]
        return {"l1": (length * 16 / 25, length * 28 / 25)}

    def home(self, parameters: Parameters) -> dict[str, float]:
        """Return the level pose with P1 further out than B1 by a third of the limbs' height."""
        a, c, length, r, big_r = lengths_of(parameters)
        height = math.sqrt(max(length * length - (a - c) * (a - c), 0.0))
        out = height / 3 - 1.5 * (big_r - r)
        out = min(max(out, -0.9 * height), 0.9 * height)
        return {"x": out + (big_r - r) / 2, "beta": 0.0, "gamma": 0.0}

    def reach(self, parameters: Parameters, pose: Mapping[str, float]) -> tuple[Reach, ...]:
        """Return l1's distance to its stroke, and how far the UU limbs are from stretched.

        The two UU limbs reach a pose together: outside it is the miss in x, inside the lesser of
        L - rho and (dP_x/dv)^2 / L, 0 where P_x is extreme. Of the first working mode.
        """
        length = lengths_of(parameters)[2]
        mode = self.working_modes[0]
        q, miss, slope, sign = nearest_to(parameters, pose, mode)
        at = configuration(parameters, q, sign)
        l1 = float(at.lengths[0])
        low, high = self.default_limits(parameters)["l1"]
        stretched = length - length / math.sqrt(max(at.bar.excess + 1.0, TINY))
        plane = min(slope * abs(slope) / length, stretched)
        if abs(miss) > uup_CLOSE * length:
            plane = min(plane, -abs(miss))
        return (
            Reach(
                "limb 1",
                min(l1 - low, high - l1),
                "too far" if l1 - low > high - l1 else "too close",
            ),
            Reach("limb 2", plane, "too far"),
            Reach("limb 3", plane, "too far"),
        )

    def inverse(
        self, parameters: Parameters, pose: Mapping[str, float]
    ) -> tuple[InverseSolution, ...]:
        """Return every root of P_x = x: those of the working modes first, as far as there are any.

        A working mode's root is on the piece of the curve about v = 0 on which P_x is monotonic.
        The others of the same sign of f are "up-2", "up-3", .. and "down-2", .., from v = 0
        outwards: beyond P_x's extremes, where the limb plane is folded down or kappa is large. No
        workspace is told in them.
        """
        return self.inverted(parameters, [pose])[0]

    def branch(self, number: int) -> str:
        """Return the name of a branch of :func:`uup_invert`."""
        mode = self.working_modes[number % 2]
        return mode if number < 2 else f"{mode}-{number // 2 + 1}"

    def inversion_constants(self, parameters: Parameters) -> list[float]:
        """Return the constants of :func:`uup_invert`."""
        return [*lengths_of(parameters), geometry_of(parameters, self.working_modes[0]).far_cos]

    def assembly_constants(self, parameters: Parameters) -> list[float]:
        """Return the constants of :func:`uu_assemble`."""
        return [*lengths_of(parameters), *self.home(parameters).values()]

    def velocity_maps(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> tuple[Matrix, Matrix]:
        """Return J_X = Qq adj(Xq), J_q = det(Xq): J^-1 = Qq Xq^-1, finite at singularities.

        Xq and Qq are the derivatives of pose and joints by q, those by kappa times |f|.
        """
        at = matching(parameters, pose, joints)
        rate = rates(parameters, at, scaled=True)
        x_q = pose_rates(rate, at.rotation)
        adjugate = np.cross(x_q[[1, 2, 0]], x_q[[2, 0, 1]]).T
        cb = elementary.cos(pose["beta"])
        j_x = product(product(rate.joints, adjugate), np.diag([1.0, cb, cb * cb]))
        return j_x, float(product(x_q[0], adjugate[:, 0])) * np.eye(3)

    def singularity_measures(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> dict[str, dict[str, float]]:
        """Return what vanishes where links or coordinates lose a freedom, all in [-1, 1].

        Inverse: cos eta1 for limb 1; for both UU limbs together dP_x/dv / (L + R), 0 where P_x is
        extreme. Forward: cos(kappa + d2), 0 where link 2 is in line with the coupler, and the
        cosine between the velocity of P1 by psi and the direction theta1 moves it; ``platform``
        is their product.
        """
        _, _, length, _, big_r = lengths_of(parameters)
        at = matching(parameters, pose, joints)
        x_q = pose_rates(rates(parameters, at, scaled=True), at.rotation)
        across, o = at.rotation[:, 0], at.rotation[:, 1]
        # rho^2 = L^2 / (excess + 1); the determinant is |f| cos phi cos^2 beta dP_x/dv.
        shrink = across[0] * across[0] + across[1] * across[1]
        shrink *= math.sqrt(max(at.bar.excess + 1.0, TINY))
        extreme = -float(determinant(x_q) / (max(shrink, TINY) * (length + big_r)))
        direction = np.array([elementary.cos(at.theta1), 0.0, -elementary.sin(at.theta1)])
        in_line = elementary.cos(at.q[1] + at.delta2)
        lever = float(product(direction, np.cross(o, across)))
        return {
            "inverse": {"limb 1": elementary.cos(at.eta1), "limb 2": extreme, "limb 3": extreme},
            "forward": {"platform": in_line * lever, "link 2": in_line, "limb 1": lever},
        }

    def velocity_map_units(self) -> dict[str, str]:
        """Return the units of J_X and J_q."""
        return {
            "J_X": "columns in rad; m; m",
            "J_q": "m, times the identity",
        }

    def why_not(self, parameters: Parameters, joints: Mapping[str, float]) -> str:
        """Say whether the links or the platform's turn cannot be assembled."""
        _, c, length, _, _ = lengths_of(parameters)
        span = span_of(parameters, joints)
        if span > length + 2 * c or span < abs(length - 2 * c):
            return (
                f"P3 is {span:.6g} m from B2, which link 2 and the platform's side do not span "
                f"(from {abs(length - 2 * c):.6g} to {length + 2 * c:.6g} m)"
            )
        return "no turn of the platform about P2P3 brings P1 in line with theta1"

    def platform(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Matrix, Vector]:
        """Return Rot and P."""
        at = self.at(parameters, pose, working_mode)
        return at.rotation, at.centre

    def at(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> Configuration:
        """Return the mechanism at a pose.

        Raises
        ------
        UnreachableError
            If the working mode has no solution there.
        """
        mode = self.check_mode(working_mode)
        found = root_of(parameters, pose, mode)
        if found is None:
            shown = ", ".join(f"{k}={v!r}" for k, v in pose.items())
            raise UnreachableError(f"{self.name} cannot reach {shown} in working mode {mode}")
        return found

    def points_at(
        self, parameters: Parameters, pose: Mapping[str, float], mode: str, constants: Any
    ) -> Points:
        """Return the points at the root of the scan: exact where the kernel's steps end near it.

        Raises
        ------
        UnreachableError
            If the working mode has no solution there.
        """
        phi, kappa, psi = self.at(parameters, pose, mode).q.tolist()
        turn = Turn(*elementary.sin_cos(phi), *elementary.sin_cos(kappa), *elementary.sin_cos(psi))
        found: Points = uup_placed(turn, constants)
        return found

    def alternative_layout(self, parameters: Parameters, name: str) -> tuple[Chain, ...]:
        """Return the paper's limbs with the platform centred and level above the base."""
        if name not in self.layouts:
            raise unknown_name("layout", name, self.layouts)
        _, _, length, r, big_r = lengths_of(parameters)
        rise = length * length - (r - big_r) * (r - big_r)
        if rise <= 0.0:
            raise UnreachableError(
                f"{self.name}: L = {length!r} m does not reach a centred platform"
            )
        chains = []
        for k in range(3):
            turn = 2 * math.pi / 3 * k
            radial = np.array([elementary.cos(turn), elementary.sin(turn), 0.0])
            tangent = np.array([-elementary.sin(turn), elementary.cos(turn), 0.0])
            base, end = r * radial, big_r * radial + [0.0, 0.0, math.sqrt(rise)]
            # Limb 1's slider is driven by its first axis; so are the others by theirs.
            lower = Joint("U", base, (radial, tangent), drive=(self.joints[k].name, int(k == 2)))
            slider = (Joint("P", base, ((end - base) / length,)),) if k == 0 else ()
            upper = Joint("U", end, (tangent, radial))
            chains.append(Chain(f"limb {k + 1}", (lower, *slider, upper)))
        return tuple(chains)

    def kernel_constants(
        self, parameters: Parameters, working_mode: str, length: float, limits: Ranges
    ) -> Constants:
        """Return the constants of a design."""
        home = root_of(parameters, self.home(parameters), working_mode)
        # Without a home there is nothing to measure from: every cone angle counts as 90 degrees.
        references = np.zeros((3, 3)) if home is None else product(home.directions, home.rotation)
        home1, home2, home3 = (Vec3(*row) for row in references.tolist())
        return Constants(
            geometry=geometry_of(parameters, working_mode),
            weight=length,
            theta1=_arc(limits.get("theta1")),
            phi=_arc(limits.get("phi")),
            delta3=_arc(limits.get("delta3")),
            l1=Stroke(*limits.get("l1", (-math.inf, math.inf))),
            eta1=_arc(limits.get("eta1")),
            delta2=_arc(limits.get("delta2")),
            kappa=_arc(limits.get("kappa")),
            psi=_arc(limits.get("psi")),
            home1=home1,
            home2=home2,
            home3=home3,
        )

    def idle_slacks(self, limits: Ranges) -> frozenset[int]:
        """Return the slacks of angles that may turn in full: 3 to 9."""
        names = ("theta1", "phi", "delta3", "eta1", "delta2", "kappa", "psi")
        turn = (-math.inf, math.inf)
        return frozenset(
            3 + k
            for k, name in enumerate(names)
            if not limits.get(name, turn)[1] - limits.get(name, turn)[0] < 2 * math.pi
        )


def _arc(limits: tuple[float, float] | None) -> Arc:
    """Return the range of an angle; all angles without limits."""
    low, high = limits or (-math.inf, math.inf)
    # A full turn excludes nothing, not even by rounding.
    if not high - low < 2 * math.pi:
        return Arc(1.0, 0.0, -2.0)
    sine, cosine = elementary.sin_cos((low + high) / 2)
    return Arc(cosine, sine, elementary.cos((high - low) / 2) - 4e-16)


MECHANISM = UuUpu()

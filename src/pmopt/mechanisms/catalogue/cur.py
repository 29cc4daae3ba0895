"""3-CUR: one translation and two rotations; three CUR limbs with vertical cylindrical joints.

Symbols as in the paper on the 3-CUR mechanism: h, theta2 .. theta5, alpha, beta, gamma. Limb i at
azimuth 0, 120, 240 degrees with r_i radial and t_i tangential; A_i = Ra r_i, b_i = Rb r_i,
Rot = Rz(alpha) Ry(beta) Rx(gamma), e_i = Rot t_i, w_i = P + Rot b_i - A_i - (h_i + d1) z::

    e_i . w_i = 0        |w_i| = L

z, beta and gamma are free; x, y and alpha follow. The two conditions say that with theta_i, the
theta5 of limb i, w_i = L Rot (cos theta_i r_i + sin theta_i z). In the frame that yaws with the
platform (r_i' = Ry Rx r_i and z' = Ry Rx z are known there) the limbs close horizontally where::

    p + Rb r_i' - Rz(-alpha) A_i = L (cos theta_i r_i' + sin theta_i z')

Six equations for p (of which x, y come by turning it), alpha and the theta_i, solved by Newton's
method; nothing special happens to them where a link lies flat. Then h_i = z + (Rb r_i')_z - w_iz
- d1: z decouples from the rest.

n_i = (u, v) is the horizontal normal of the derivative of w_i by theta_i. The force by which limb i
constrains the platform goes along it, through the U joint: L n_i = w_iz e_i - e_iz w_i.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np

from pmopt.compiler.programs import Assembler
from pmopt.errors import InputError
from pmopt.kernels.octics import bernstein, nodes
from pmopt.kernels.vectors import (
    Vec3,
)
from pmopt.mechanisms.bodies import Body, disc, plate, tube
from pmopt.mechanisms.catalogue.cur_forward import cur_assemble, cur_MODES, cur_WORK
from pmopt.mechanisms.catalogue.cur_inverse import cur_invert
from pmopt.mechanisms.catalogue.cur_kernel import (
    CUR_C2,
    CUR_S2,
    CUR_TOLERANCE,
    TINY,
    Arc,
    Constants,
    Sizes,
    Solved,
    Stroke,
    Turn,
    cur_heights,
    cur_kernel,
    cur_line,
    cur_of_unknowns,
    cur_residuals,
    cur_solve,
    cur_start,
)
from pmopt.mechanisms.catalogue.cur_structure import STRUCTURE
from pmopt.mechanisms.mechanism import (
    Chain,
    Coordinate,
    Implicit,
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
from pmopt.numerics import elementary
from pmopt.numerics.matrices import determinant, product, solve
from pmopt.numerics.rotation import rotation_matrices

#: Height of a link over L below which it does not tell the working mode.
NEARLY_FLAT = 1e-6

MODE_SIGNS = {
    "-".join("up" if s > 0 else "down" for s in signs): signs
    for signs in itertools.product((1.0, -1.0), repeat=3)
}

_OURS = "ours: the paper gives no sizes"


class _Link(NamedTuple):
    """A limb at a pose: Rot b, e and w, and the height of w, negative on the other branch."""

    b: Vector
    e: Vector
    w: Vector
    height: float


class Cur(Mechanism):
    """The 3-CUR mechanism."""

    name = "3-cur"
    title = "3-CUR"
    description = "one translation (z) and two rotations; three sliders on vertical columns"
    source = "Kinematics Analysis and Simulation of 3-CUR Parallel Sorting Robot"
    freedom = "1T2R"
    length_unit = "m"
    default_jacobian = "homogenized"
    length_meaning = "Rb, the platform's radius: rates of angles become speeds"
    parameters = (
        Parameter("Ra", "length", 0.20, (0.10, 0.40), True, "radius of the columns", _OURS),
        Parameter("Rb", "length", 0.12, (0.05, 0.25), True, "radius of the platform", _OURS),
        Parameter("L", "length", 0.25, (0.15, 0.50), True, "length of the links", _OURS),
        Parameter("d1", "length", 0.0, None, False, "height of the U joints above the sliders",
                  _OURS),
    )  # fmt: skip
    pose = (
        Coordinate("z", "length", "height of the platform's centre"),
        Coordinate("beta", "angle", "pitch, about y"),
        Coordinate("gamma", "angle", "roll, about x"),
    )
    parasitic = (
        Coordinate("x", "length", "shift along x"),
        Coordinate("y", "length", "shift along y"),
        Coordinate("alpha", "angle", "yaw, about z"),
    )
    joints = tuple(Coordinate(f"h{k}", "length", f"height of slider {k}") for k in range(1, 4))
    passive = (
        Coordinate("theta4", "angle", "second axis of each U_C; by limb theta4_1 .. theta4_3"),
        Coordinate("theta5", "angle", "each R_B; by limb theta5_1 .. theta5_3"),
        Coordinate("elevation", "angle", "each link above the horizontal; by limb elevation_1 .."),
    )
    limbs = tuple(
        Limb(
            f"limb {k}", "CUR",
            f"C_A{k} on column {k} (sliding by h{k} actuated), U_C{k} on the slider, "
            f"R_B{k} tangential",
            (f"C_A{k}", f"U_C{k}", f"R_B{k}"),
        )
        for k in range(1, 4)
    )  # fmt: skip
    layouts = {  # noqa: RUF012  # declared as a mapping that is not changed
        "literal": "the paper's D-H table read literally, theta4 = 0: a 3-CRR"
    }
    conditions: ClassVar[Mapping[str, str]] = {
        "inverse": "w_iz = 0: link i lies flat",
        "forward": "the constraint forces and the links' forces, w_i, are dependent: together they "
        "do not hold the platform",
        "constraint": "the three horizontal forces through the U joints are dependent",
    }
    working_modes = tuple(MODE_SIGNS)
    kernel = staticmethod(cur_kernel)
    constants = Constants
    implicit = Implicit(6, (1, 2), cur_residuals, cur_of_unknowns, cur_start)
    line = staticmethod(cur_line)
    line_axis = 0
    line_parts = 1
    structure = STRUCTURE
    roles = ("z", "pitch", "roll")
    assembler = Assembler(cur_assemble, cur_MODES, 8, cur_WORK)
    inverter = Assembler(cur_invert, len(MODE_SIGNS), 7 + 5 * 3, 1)
    inverted_passive = tuple(
        f"{name}_{k}"
        for k in (1, 2, 3)
        for name in ("theta2", "theta3", "theta4", "theta5", "elevation")
    )
    completeness = "by a polynomial of degree 8, whose real roots are counted"
    parasitic_roles = ("x", "y", "yaw")

    def characteristic_length(self, parameters: Parameters) -> float:
        """Return Rb."""
        return _sizes(parameters)[1]

    def home(self, parameters: Parameters) -> dict[str, float]:
        """Return the level platform with the sliders in the middle of their stroke."""
        ra, rb, length, d1 = _sizes(parameters)
        rise = math.sqrt(max(length * length - (ra - rb) * (ra - rb), 0.0))
        return {"z": 0.15 + d1 + rise, "beta": 0.0, "gamma": 0.0}

    def bodies(self, parameters: Parameters) -> tuple[Body, ...]:
        """Return blocks as sliders, rods and a disc, of steel."""
        _, rb, length, _ = _sizes(parameters)
        return (
            *(plate((0.06, 0.06, 0.04), 1.0).body(f"{limb.name} slider", i, 0)
              for i, limb in enumerate(self.limbs)),
            *(tube(0.016, length, 1.0).body(f"{limb.name} link", i, 1)
              for i, limb in enumerate(self.limbs)),
            disc(2 * rb, 0.008, 1.0).body("platform"),
        )  # fmt: skip

    def default_limits(self, parameters: Parameters) -> Ranges:
        """Return stroke 0 .. 0.30 m (ours), theta4, theta5 and the elevation of the links."""
        return {
            **{c.name: (0.0, 0.30) for c in self.joints},
            "theta4": (-math.pi / 4, math.pi / 4),
            "theta5": (math.radians(20), math.radians(160)),
            "elevation": (math.radians(20), math.pi / 2),
        }

    def default_domain(self, parameters: Parameters) -> Ranges:
        """Return tilts up to 80 degrees (ours)."""
        tilt = math.radians(80)
        return {"beta": (-tilt, tilt), "gamma": (-tilt, tilt)}

    def reach_box(self, parameters: Parameters, limits: Ranges) -> tuple[Vector, Vector]:
        """Return z between the mean of the sliders' ends with links down and up; all tilts.

        The platform's joints lie around its centre: z is the mean of h + d1 + zeta.
        """
        ra, rb, length, d1 = _sizes(parameters)
        ends = [limits.get(c.name, (-math.inf, math.inf)) for c in self.joints]
        low, high = (sum(side) / 3 + d1 for side in zip(*ends, strict=True))
        if not (math.isfinite(low) and math.isfinite(high)):
            raise InputError("limits: h1, h2 and h3 need bounds: z follows them without end")
        if abs(ra - rb) >= length:
            return np.zeros(3), np.zeros(3)
        down, up = limits.get("elevation", (-math.pi, math.pi))
        low += length * elementary.sin(max(down, -math.pi / 2))
        high += length * elementary.sin(min(up, math.pi / 2))
        angles = (math.pi / 2, math.pi)
        return np.array([low, *(-a for a in angles)]), np.array([high, *angles])

    def reach(self, parameters: Parameters, pose: Mapping[str, float]) -> tuple[Reach, ...]:
        """Return how far each link is from lying flat, and its slider from its stroke's ends.

        Of the first working mode.
        """
        ra, rb, length, _ = _sizes(parameters)
        short = length - abs(ra - rb)
        if short <= 0:  # no platform is level, none at all to start from
            return tuple(Reach(limb.name, short, "too far") for limb in self.limbs)
        signs = next(iter(MODE_SIGNS.values()))
        links, _, gap = self._links(parameters, pose, signs)
        result = []
        for limb, link in zip(self.limbs, links, strict=True):
            flat = math.copysign(length - math.hypot(link.w[0], link.w[1]), link.height)
            h = pose["z"] + float(link.b[2] - link.w[2]) - _sizes(parameters)[3]
            low, high = self.default_limits(parameters)["h1"]
            room = min(h - low, high - h)
            if gap > CUR_TOLERANCE:
                flat = min(flat, -gap * length)
            reason = "too far" if flat < room or h > high else "too close"
            result.append(Reach(limb.name, min(flat, room), reason))
        return tuple(result)

    def inverse(
        self, parameters: Parameters, pose: Mapping[str, float]
    ) -> tuple[InverseSolution, ...]:
        """Solve for x, y, alpha in each working mode; the heights follow.

        Of each mode the branch that home belongs to: where Ra + Rb < L there is one more, of the
        platform turned half about z.
        """
        return self.inverted(parameters, [pose])[0]

    def inversion_constants(self, parameters: Parameters) -> list[float]:
        """Return the constants of :func:`cur_invert`."""
        return list(_sizes(parameters))

    def _links(
        self, parameters: Parameters, pose: Mapping[str, float], signs: tuple[float, ...]
    ) -> tuple[list[_Link], tuple[float, float, float], float]:
        """Return the limbs, x, y, alpha and the largest gap over L, of one working mode."""
        ra, rb, length, _ = _sizes(parameters)
        beta, gamma = pose["beta"], pose["gamma"]
        (px, py, (c, s), *turns), gap = _solved(beta, gamma, ra / length, rb / length, signs)
        alpha = elementary.atan2(s, c)
        rotation = rotation_matrices(np.array([[alpha, beta, gamma]]))[0][0]
        links = []
        for k, (sign, (cos_k, sin_k)) in enumerate(zip(signs, _AZIMUTHS, strict=True)):
            out = product(rotation, [cos_k, sin_k, 0.0])
            w = length * (turns[k].c * out + turns[k].s * rotation[:, 2])
            links.append(
                _Link(rb * out, product(rotation, [-sin_k, cos_k, 0.0]), w, sign * float(w[2]))
            )
        x, y = length * (c * px - s * py), length * (s * px + c * py)
        return links, (float(x), float(y), alpha), float(gap)

    def assembly_constants(self, parameters: Parameters) -> list[float]:
        """Return the constants of :func:`cur_assemble`."""
        return [*_sizes(parameters), self.home(parameters)["z"], *nodes(), *bernstein()]

    def velocity_maps(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> tuple[Matrix, Matrix]:
        """Return zeta_i dh_i / d(z, beta, gamma) and diag(zeta_i); parasitic rates eliminated."""
        constraint, drive, heights, axes = self.full_map(parameters, pose, joints)
        moved = np.zeros((6, 6))
        moved[:3, :3] = np.eye(3)
        moved[3:, 3:] = axes
        # Columns: x, y, alpha; then z, beta, gamma.
        held, free = [0, 1, 3], [2, 4, 5]
        constraint, drive = product(constraint, moved), product(drive, moved)
        follow = -solve(constraint[:, held], constraint[:, free])
        return drive[:, free] + product(drive[:, held], follow), np.diag(heights)

    def full_map(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> tuple[Matrix, Matrix, Vector, Matrix]:
        """Return the rows on (v, omega) of the constraints and of the drives.

        The constraints are the horizontal forces through the U joints, w_z e - e_z w; the drives
        [w; b x w] give w_z h'. With them the heights w_z and the axes of the angles' rates.
        """
        mode = self._mode_of(parameters, pose, joints)
        links, (_, _, alpha), _ = self._links(parameters, pose, MODE_SIGNS[mode])
        constraint, drive, heights = np.empty((3, 6)), np.empty((3, 6)), np.empty(3)
        for k, (b, e, w, _) in enumerate(links):
            force = w[2] * e - e[2] * w
            constraint[k] = [*force, *(w[2] * np.cross(b - w, e) - e[2] * np.cross(b, w))]
            drive[k] = [*w, *np.cross(b, w)]
            heights[k] = w[2]
        angles = np.array([[alpha, pose["beta"], pose["gamma"]]])
        return constraint, drive, heights, rotation_matrices(angles)[1][0]

    def _mode_of(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> str:
        """Return the working mode whose heights are those given."""
        _, rb, length, d1 = _sizes(parameters)
        heights = cur_heights(pose["beta"], pose["gamma"], *[Turn(0.0, 0.0)] * 3)
        rises = [
            rb * float(at.r) - (joints[c.name] + d1 - pose["z"])
            for c, at in zip(self.joints, heights, strict=True)
        ]
        signs = tuple(math.copysign(1.0, rise) for rise in rises)
        mode = next(mode for mode, found in MODE_SIGNS.items() if found == signs)
        if min(map(abs, rises)) > NEARLY_FLAT * length:
            return mode
        solutions = self.inverse(parameters, pose)
        if not solutions:
            return self.working_modes[0]
        return min(
            solutions, key=lambda s: sum(abs(s.joints[k] - v) for k, v in joints.items())
        ).working_mode

    def singularity_measures(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> dict[str, dict[str, float]]:
        """Return w_z / L, the 6x6 determinant and the volume of the constraint rows.

        Rows are brought to norm 1, moments divided by Rb.
        """
        _, rb, length, _ = _sizes(parameters)
        constraint, drive, heights, _ = self.full_map(parameters, pose, joints)
        rows = np.vstack([constraint, drive])
        rows[:, 3:] /= rb
        rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), TINY)
        gram = product(rows[:3], rows[:3].T)
        return {
            "inverse": {limb.name: float(h) / length
                        for limb, h in zip(self.limbs, heights, strict=True)},
            "forward": {"platform": float(determinant(rows))},
            "constraint": {"platform": math.sqrt(max(float(determinant(gram)), 0.0))},
        }  # fmt: skip

    def velocity_map_units(self) -> dict[str, str]:
        """Return the units of J_X's and J_q's entries."""
        return {"J_X": "columns in m; m^2/rad; m^2/rad", "J_q": "diagonal in m"}

    def platform(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Matrix, Vector]:
        """Return Rot and P."""
        signs = MODE_SIGNS[self.check_mode(working_mode)]
        _, (x, y, alpha), _ = self._links(parameters, pose, signs)
        angles = np.array([[alpha, pose["beta"], pose["gamma"]]])
        return rotation_matrices(angles)[0][0], np.array([x, y, pose["z"]])

    def alternative_layout(self, parameters: Parameters, name: str) -> tuple[Chain, ...]:
        """Return the 3-CRR of the literal D-H table at home: U without its second axis."""
        if name not in self.layouts:
            return super().alternative_layout(parameters, name)
        return tuple(
            Chain(limb.name, (limb.joints[0],
                              Joint("R", limb.joints[1].point, limb.joints[1].axes[:1]),
                              limb.joints[2]))
            for limb in self.layout(parameters, self.home(parameters))
        )  # fmt: skip

    def kernel_constants(
        self, parameters: Parameters, working_mode: str, length: float, limits: Ranges
    ) -> Constants:
        """Return the constants of a design."""
        ra, rb, size, d1 = _sizes(parameters)
        signs = MODE_SIGNS[working_mode]
        low, high = limits.get("elevation", (-math.pi, math.pi))
        lowest = -math.inf if low <= -math.pi / 2 else elementary.sin(low)
        highest = math.inf if high >= math.pi / 2 else elementary.sin(high)
        home, _, _ = self._links(parameters, self.home(parameters), signs)
        up1, up2, up3 = signs
        return Constants(
            ra=ra,
            rb=rb,
            length=size,
            d1=d1,
            up1=up1,
            up2=up2,
            up3=up3,
            scale=1 / length,
            stroke1=Stroke(*limits.get("h1", (-math.inf, math.inf))),
            stroke2=Stroke(*limits.get("h2", (-math.inf, math.inf))),
            stroke3=Stroke(*limits.get("h3", (-math.inf, math.inf))),
            theta4=_arc(limits.get("theta4")),
            theta5=_arc(limits.get("theta5")),
            lowest=lowest,
            highest=highest,
            home1=_direction(home[0].w, size),
            home2=_direction(home[1].w, size),
            home3=_direction(home[2].w, size),
        )

    def decoupled_volume(
        self, parameters: Parameters, limits: Ranges | None = None, degrees: float = 1.0
    ) -> tuple[float, float]:
        """Return the workspace's volume connected to home, by integrating over z exactly.

        At a tilt (beta, gamma) z runs through the common part of the strokes, each shifted by its
        h - z. What is left is a sum over a grid of tilts.

        Parameters
        ----------
        parameters : mapping
        limits : mapping, optional
            Complete; default: :meth:`default_limits`.
        degrees : float
            Step of the grid; the difference to a step twice as wide is the error told (an error
            that falls with the first power of the step is as large).

        Returns
        -------
        volume, error : float
            In m rad^2, first working mode.
        """
        fine, coarse = (
            self._integrated(parameters, limits, step) for step in (degrees, 2 * degrees)
        )
        return fine, abs(fine - coarse)

    def _integrated(self, parameters: Parameters, limits: Ranges | None, degrees: float) -> float:
        from scipy import ndimage

        limits = self.default_limits(parameters) if limits is None else limits
        count = int(80 / degrees)
        tilts = math.radians(degrees) * np.arange(-count, count + 1)
        depth = np.zeros((len(tilts), len(tilts)))
        signs = next(iter(MODE_SIGNS.values()))
        free: dict[str, Any] = {k: v for k, v in limits.items() if not k.startswith("h")}
        bounded = {**free, **{c.name: (-math.inf, math.inf) for c in self.joints}}
        constants = self.kernel_constants(parameters, self.working_modes[0], 1.0, bounded)
        for i, beta in enumerate(tilts.tolist()):
            for j, gamma in enumerate(tilts.tolist()):
                if cur_kernel(0.0, beta, gamma, constants)[0] < 0:
                    continue
                links, _, _ = self._links(parameters, {"beta": beta, "gamma": gamma}, signs)
                shifts = [float(link.b[2] - link.w[2]) for link in links]
                ends = [limits[c.name] for c in self.joints]
                top = min(high - s for (_, high), s in zip(ends, shifts, strict=True))
                bottom = max(low - s for (low, _), s in zip(ends, shifts, strict=True))
                depth[i, j] = max(top - bottom, 0.0)
        labels, _ = ndimage.label(depth > 0)
        home = labels[count, count]
        inside = (labels == home) & (labels > 0)
        return float(depth[inside].sum()) * math.radians(degrees) * math.radians(degrees)


_AZIMUTHS = ((1.0, 0.0), (CUR_C2, CUR_S2), (CUR_C2, -CUR_S2))


@lru_cache(maxsize=64)
def _solved(beta: float, gamma: float, ra: float, rb: float, signs: tuple[float, ...]) -> Solved:
    """Return what :func:`cur_solve` does; at a pose it is asked for again and again."""
    with np.errstate(over="ignore", invalid="ignore"):  # ends in a gap, which is told
        found: Solved = cur_solve(beta, gamma, Sizes(ra, rb, *signs))
    return found


def _arc(limits: tuple[float, float] | None) -> Arc:
    """Return the range of an angle; all angles without limits."""
    low, high = limits or (-math.pi, math.pi)
    middle, half = (low + high) / 2, (high - low) / 2
    # A full turn excludes nothing, not even by rounding.
    least = -2.0 if half >= math.pi else elementary.cos(half)
    return Arc(elementary.cos(middle), elementary.sin(middle), least)


def _direction(w: Vector, size: float) -> Vec3:
    x, y, z = (float(v) / size for v in w)
    return Vec3(x, y, z)


def _sizes(parameters: Parameters) -> tuple[float, float, float, float]:
    """Return Ra, Rb, L, d1."""
    ra, rb, length, d1 = (float(parameters[k] or 0.0) for k in ("Ra", "Rb", "L", "d1"))
    return ra, rb, length, d1


MECHANISM = Cur()

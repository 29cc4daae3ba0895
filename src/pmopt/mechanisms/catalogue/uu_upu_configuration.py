"""2UU-UPU at internal coordinates, and their rates; symbols as in :mod:`.uu_upu`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.mechanisms.catalogue.uu_upu_inverse import uup_main
from pmopt.mechanisms.catalogue.uu_upu_kernel import (
    TINY,
    Bar,
    Geometry,
    Sizes,
    Tilt,
    Turn,
    uup_bar,
    uup_far,
    uup_pose,
    uup_turn,
)
from pmopt.mechanisms.mechanism import (
    Matrix,
    Parameters,
    Vector,
)
from pmopt.numerics import elementary
from pmopt.numerics.matrices import product

#: Whether the platform's P2P3 is above (1) or below (-1) the base, told by M's height over it.
MODE_SIGNS = {"up": 1.0, "down": -1.0}


@dataclass(frozen=True)
class Configuration:
    """The mechanism at internal coordinates q = (phi, kappa, psi), for kinematics and dynamics.

    Attributes
    ----------
    q : (3,) float64
    sign : float
        s of f = s sqrt(L^2 / rho^2 - 1).
    bar : Bar
    rotation : (3, 3) float64
        The platform's; its second column is o, the direction of P3P2.
    normal : (3,) float64
        n, the normal of the limb plane.
    middle, centre : (3,) float64
        M, middle of P2P3, and P, the platform's centre.
    base, ends : (3, 3) float64
        Rows B1, B2, B3 and P1, P2, P3.
    lengths, directions : (3,) and (3, 3) float64
        Of the limbs, from base to platform.
    theta1, eta1, delta2, delta3 : float
    """

    q: Vector
    sign: float
    bar: Bar
    rotation: Matrix
    normal: Vector
    middle: Vector
    centre: Vector
    base: Matrix
    ends: Matrix
    lengths: Vector
    directions: Matrix
    theta1: float
    eta1: float
    delta2: float
    delta3: float


@dataclass(frozen=True)
class Rates:
    """Derivatives by q = (phi, kappa, psi); columns are the coordinates.

    Those by kappa are multiplied by |f| where asked for, which keeps them finite at f = 0.

    Attributes
    ----------
    angular, centre : (3, 3) float64
        The platform's angular velocity and its centre's velocity.
    ends : (3, 3, 3) float64
        Of P1, P2, P3.
    theta1, l1, eta1, delta2, delta3 : (3,) float64
    """

    angular: Matrix
    centre: Matrix
    ends: NDArray[np.float64]
    theta1: Vector
    l1: Vector
    eta1: Vector
    delta2: Vector
    delta3: Vector

    @property
    def joints(self) -> Matrix:
        """Qq: rows theta1, phi and delta3."""
        return np.array([self.theta1, [1.0, 0.0, 0.0], self.delta3])


def configuration(parameters: Parameters, q: Vector, sign: float) -> Configuration:
    """Return the mechanism at internal coordinates; |kappa| beyond its limit counts as at f = 0."""
    a, c, length, r, big_r = lengths_of(parameters)
    phi, kappa, psi = (float(v) for v in q)
    sk, ck = elementary.sin(kappa), elementary.cos(kappa)
    bar = uup_bar(sk, ck, a, c, length * length, sign)
    plane = _about_y(phi)
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, ck, -sk], [0.0, sk, ck]])
    rotation = product(product(plane, tilt), _about_y(psi))
    _, f, _, h, _ = bar
    y = f * c * sk
    middle = np.array([-r / 2, 0.0, 0.0]) + product(plane, [0.0, y, h])
    across = rotation[:, 0]
    base = np.array([[r, 0.0, 0.0], [-r / 2, a, 0.0], [-r / 2, -a, 0.0]])
    side = c * rotation[:, 1]
    ends = np.array([middle + 1.5 * big_r * across, middle + side, middle - side])
    vectors = ends - base
    lengths = np.linalg.norm(vectors, axis=1)
    w = vectors[0]
    return Configuration(
        q=np.array([phi, kappa, psi]),
        sign=sign,
        bar=bar,
        rotation=rotation,
        normal=plane[:, 0],
        middle=middle,
        centre=middle + big_r / 2 * across,
        base=base,
        ends=ends,
        lengths=lengths,
        directions=vectors / np.maximum(lengths, TINY)[:, None],
        theta1=elementary.atan2(w[0], w[2]),
        eta1=elementary.atan2(w[1], math.hypot(w[0], w[2])),
        delta2=elementary.atan2(y - a + c * ck, h + c * sk),
        delta3=elementary.atan2(y + a - c * ck, h - c * sk),
    )


def rates(parameters: Parameters, at: Configuration, scaled: bool = False) -> Rates:
    """Return the derivatives by q; those by kappa times |f| if scaled."""
    a, c, length, r, big_r = lengths_of(parameters)
    _, f, g, h, h_k = at.bar
    scale = abs(f) if scaled else 1.0
    plane = _about_y(float(at.q[0]))
    sk, ck = elementary.sin(at.q[1]), elementary.cos(at.q[1])
    y = f * c * sk
    # Rates of M in the plane, by kappa: |f| times them is finite.
    y_k, h_k = (v if scaled else v / abs(f) for v in (at.sign * c * (g * sk + f * f * ck), h_k))
    across, o = at.rotation[:, 0], at.rotation[:, 1]
    angular = np.column_stack([[0.0, 1.0, 0.0], scale * at.normal, o])
    pivot = np.array([-r / 2, 0.0, 0.0])
    turned = np.cross([0.0, 1.0, 0.0], at.middle - pivot)
    middle = np.column_stack([turned, product(plane, [0.0, y_k, h_k]), np.zeros(3)])

    def moving(offset: Vector) -> Matrix:
        return middle + np.cross(angular.T, offset).T

    points = [moving(point - at.middle) for point in at.ends]
    w = at.ends[0] - at.base[0]
    flat2 = w[0] * w[0] + w[2] * w[2]
    l1, moved = float(at.lengths[0]), points[0]
    l1_q = product(w, moved) / max(l1, TINY)
    bars = []
    for sign, s_, c_ in ((1, y - a + c * ck, h + c * sk), (-1, y + a - c * ck, h - c * sk)):
        ds, dc = y_k - sign * scale * c * sk, h_k + sign * scale * c * ck
        bars.append(np.array([0.0, (ds * c_ - dc * s_) / (length * length), 0.0]))
    return Rates(
        angular=angular,
        centre=moving(big_r / 2 * across),
        ends=np.array(points),
        theta1=(moved[0] * w[2] - moved[2] * w[0]) / max(flat2, TINY),
        l1=l1_q,
        eta1=(moved[1] - w[1] / max(l1, TINY) * l1_q) / max(math.sqrt(flat2), TINY),
        delta2=bars[0],
        delta3=bars[1],
    )


def lengths_of(parameters: Parameters) -> tuple[float, float, float, float, float]:
    """Return a, c, L, r and R: half the sides, the link and the radii."""
    base, side, length = (float(parameters[k] or 0.0) for k in ("bs", "ps", "L"))
    return base / 2, side / 2, length, base / math.sqrt(3), side / math.sqrt(3)


def geometry_of(parameters: Parameters, mode: str) -> Geometry:
    """Return the lengths of a design and its working mode."""
    a, c, length, r, big_r = lengths_of(parameters)
    up = MODE_SIGNS[mode]
    # The cotangent of the largest |kappa|, where rho = L.
    cosine = (a * a + c * c - length * length) / (2 * a * c)
    far = cosine / math.sqrt(1 - cosine * cosine) if abs(cosine) < 1 else math.copysign(1e9, cosine)
    return Geometry(a, c, length * length, length, r, big_r, up if a >= c else -up, up, far)


def _about_y(angle: float) -> Matrix:
    s, c = elementary.sin(angle), elementary.cos(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def pose_rates(rate: Rates, rotation: Matrix) -> Matrix:
    """Return the rates of x, of beta times cos beta and of gamma times cos^2 beta, by q."""
    across, w = rotation[:, 0], rate.angular
    return np.array(
        [rate.centre[0], across[0] * w[1] - across[1] * w[0], across[0] * w[0] + across[1] * w[1]]
    )


def _tilt(pose: Mapping[str, float]) -> Tilt:
    """Return the curve that a pose's tilt leaves."""
    (rise, cb), (sg, cg) = (elementary.sin_cos(pose[name]) for name in ("beta", "gamma"))
    m, level = cb * sg, cb * cg
    mu = math.hypot(rise, level) + TINY
    return Tilt(m, mu, rise / mu, level / mu)


def _q(turn: Turn) -> Vector:
    return elementary.each(
        elementary.atan2, [turn.sphi, turn.sk, turn.spsi], [turn.cphi, turn.ck, turn.cpsi]
    )


def nearest_to(
    parameters: Parameters, pose: Mapping[str, float], mode: str
) -> tuple[Vector, float, float, float]:
    """Return q where P_x is nearest to x as the kernel finds it, the miss, the slope and s."""
    geometry = geometry_of(parameters, mode)
    with np.errstate(over="ignore", invalid="ignore"):  # far off: told by the miss
        found = uup_pose(pose["x"], pose["beta"], pose["gamma"], geometry)
    return _q(found.turn), found.miss, found.slope, geometry.s


def root_of(parameters: Parameters, pose: Mapping[str, float], mode: str) -> Configuration | None:
    """Return the mode's root of P_x = x, if there is one; see :func:`uup_main`."""
    a, c, l2, length, r, big_r, s, up, far_cos = geometry_of(parameters, mode)
    tilt = _tilt(pose)
    far = uup_far(tilt.m, tilt.mu, far_cos)
    u, there = uup_main(pose["x"] + r / 2, tilt, far, Sizes(a, c, l2, big_r / 2, s), up, length)
    at = configuration(parameters, _q(uup_turn(u, tilt)), s)
    return at if there and at.bar.excess >= 0.0 else None


def matching(
    parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
) -> Configuration:
    """Return the configuration of a pose that has these joint positions, on any branch.

    Kappa follows from o's height, cos phi sin kappa = m, and from the circles about B2 and P3 that
    P2 lies on: of two crossings the one that fits the pose, of two ways the one that errs less.
    """
    a, c, length, _, _ = lengths_of(parameters)
    m, _, sw, cw = _tilt(pose)
    phi, d3 = joints["phi"], joints["delta3"]
    sphi, cphi = elementary.sin(phi), elementary.cos(phi)
    p3 = np.array([-a + length * elementary.sin(d3), length * elementary.cos(d3)])
    couplers, rise = _couplers(parameters, p3)

    def at(sk: float, ck: float) -> Configuration:
        ym, hm = p3 + c * np.array([ck, sk])
        sign = 1.0 if ym * c * sk + hm * (a - c * ck) >= 0.0 else -1.0
        psi = elementary.atan2(sw, cw) - elementary.atan2(sphi, cphi * ck)
        return configuration(parameters, np.array([phi, elementary.atan2(sk, ck), psi]), sign)

    def gap(found: Configuration) -> float:
        return float(abs(found.rotation[2, 1] - m) + abs(found.centre[0] - pose["x"]) / length)

    if not couplers:  # P3 in B2: kappa from the height alone
        couplers, rise = [np.array([ck, m / cphi]) for ck in (1.0, -1.0)], -1.0
    best = min((at(float(sk), float(ck)) for ck, sk in couplers), key=gap)
    ck = elementary.cos(best.q[1])
    if abs(cphi * ck) > rise:
        sk = min(max(m / cphi, -1.0), 1.0)
        best = at(sk, math.copysign(math.sqrt(1 - sk * sk), ck))
    return best


def _couplers(parameters: Parameters, p3: Vector) -> tuple[list[Vector], float]:
    """Return both (cos kappa, sin kappa) that link 2 allows with P3 at p3, in (y, height).

    With them the sine of the angle between B2P3 and P2P3, 0 where both are one; below 0 where
    link 2 and the platform's side do not span it.
    """
    a, c, length, _, _ = lengths_of(parameters)
    between = np.array([a, 0.0]) - p3
    span = math.hypot(*between)
    if span <= TINY:
        return [], -1.0
    cosine = (4 * (c * c) - length * length + span * span) / (4 * c * span)
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    forth = between / span
    left = np.array([-forth[1], forth[0]])
    fits = cosine * cosine - 1.0 < 1e-12 * (length / (2 * c)) * (length / (2 * c))
    return [cosine * forth + side * sine * left for side in (1.0, -1.0)], sine if fits else -1.0


def span_of(parameters: Parameters, joints: Mapping[str, float]) -> float:
    """Return the distance of P3 from B2."""
    a, _, length, _, _ = lengths_of(parameters)
    d3 = joints["delta3"]
    return math.hypot(length * elementary.sin(d3) - 2 * a, length * elementary.cos(d3))

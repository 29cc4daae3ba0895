"""Slow, clear oracles, written from the geometry and from definitions, not from the package.

2PaUU-PPaP, z from the base towards the workspace (all lengths in metres)::

    C1 = ( m + l1 cos t1, 0, 2c - l1 sin t1)      D1 = (x + n, y, z)
    C2 = (-m - l1 cos t2, 0, 2c - l1 sin t2)      D2 = (x - n, y, z)
    |D_i - C_i| = l2,        y = d
"""

import math
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
from scipy.stats import qmc

# Side of its pivot's line of sight to the platform a knee lies on: limb 1 is to the right.
SIDES = {"out-out": (-1, 1), "in-in": (1, -1), "out-in": (-1, -1), "in-out": (1, 1)}

# --- 2PaUU-PPaP ---------------------------------------------------------------------------


def angle_gap(a, b):
    """Return the distance of two angles on the circle."""
    return abs(math.remainder(a - b, 2 * math.pi))


def knees(params, joints):
    """Return C1 and C2."""
    m, l1, c = params["m"], params["l1"], params["c"]
    t1, t2 = joints["theta1"], joints["theta2"]
    return (
        np.array([m + l1 * math.cos(t1), 0, 2 * c - l1 * math.sin(t1)]),
        np.array([-m - l1 * math.cos(t2), 0, 2 * c - l1 * math.sin(t2)]),
    )


def links(params, pose, joints):
    """Return u_i = D_i - C_i."""
    c1, c2 = knees(params, joints)
    end = np.array([pose["x"], pose["y"], pose["z"]])
    n = np.array([params["n"], 0, 0])
    return end + n - c1, end - n - c2


def residual(params, pose, joints):
    """Return the largest violation of the three constraints."""
    lengths = [np.linalg.norm(u) - params["l2"] for u in links(params, pose, joints)]
    return max(*map(abs, lengths), abs(pose["y"] - joints["d"]))


def lines_of_sight(params, pose):
    """Return, for each limb, (distance, direction) from its pivot to D_i as seen along y."""
    reach = params["m"] - params["n"]
    height = pose["z"] - 2 * params["c"]
    return [
        (math.hypot(pose["x"] + side * reach, height), math.atan2(height, pose["x"] + side * reach))
        for side in (-1, 1)
    ]


def link_shadow(params, pose):
    """Return the length of a link as seen along y, None where y is beyond it."""
    square = params["l2"] ** 2 - pose["y"] ** 2
    return math.sqrt(square) if square >= 0 else None


def inverse(params, pose):
    """Return {working mode: joints} by the law of cosines at the pivots, {} out of reach."""
    l1, shadow = params["l1"], link_shadow(params, pose)
    sights = lines_of_sight(params, pose)
    if shadow is None or any(r > l1 + shadow or r < abs(l1 - shadow) for r, _ in sights):
        return {}
    opening = [math.acos((l1**2 + r**2 - shadow**2) / (2 * l1 * r)) for r, _ in sights]
    solutions = {}
    for mode, sides in SIDES.items():
        # Directions of the cranks in the xz plane: C1 - pivot = l1 (cos t1, -sin t1),
        # C2 - pivot = l1 (-cos t2, -sin t2).
        f1, f2 = (sights[i][1] + sides[i] * opening[i] for i in (0, 1))
        solutions[mode] = {
            "theta1": math.atan2(-math.sin(f1), math.cos(f1)),
            "theta2": math.atan2(-math.sin(f2), -math.cos(f2)),
            "d": pose["y"],
        }
    return solutions


def keeps_limits(params, pose, joints, limits):
    """Return whether joints are within limits, angles modulo a turn, and z within h."""
    if params.get("h") is not None and pose["z"] > params["h"]:
        return False
    for name, (low, high) in limits.items():
        if name == "d":
            inside = low <= joints["d"] <= high
        else:
            inside = (joints[name] - low) % (2 * math.pi) <= high - low
        if not inside:
            return False
    return True


def velocity_maps(params, pose, joints):
    """Return J_X (rows u_i and e_y) and J_q (diagonal u_i.e_i and 1)."""
    u1, u2 = links(params, pose, joints)
    l1, t1, t2 = params["l1"], joints["theta1"], joints["theta2"]
    e1 = l1 * np.array([-math.sin(t1), 0, -math.cos(t1)])
    e2 = l1 * np.array([math.sin(t2), 0, -math.cos(t2)])
    return np.array([u1, u2, [0, 1, 0]]), np.diag([np.dot(u1, e1), np.dot(u2, e2), 1])


def dexterity(params, pose, joints, norm="2", length=1.0):
    """Return the index of J with its crank columns divided by ``length``."""
    j_x, j_q = velocity_maps(params, pose, joints)
    # The inverse Jacobian exists wherever the workspace has an inside.
    inverse_jacobian = np.linalg.solve(j_q, j_x)
    return inverse_condition(np.diag([length, length, 1]) @ inverse_jacobian, norm)


def surface_distance(params, a, y, b):
    """Return the distance from a point to the surface a limb's stretched or folded poses form.

    The surface is swept by a circle of radius l2 about the points of a circle of radius l1; the
    point has coordinates (a, b) in the plane of the latter and y across it.
    """
    l1, l2 = params["l1"], params["l2"]
    middle, half = np.zeros(2), np.full(2, math.pi)
    while half[0] > 1e-9:
        turn = middle[0] + half[0] * np.linspace(-1, 1, 121)[:, None]
        tube = middle[1] + half[1] * np.linspace(-1, 1, 121)[None, :]
        radius = l1 + l2 * np.cos(tube)
        distance = np.sqrt(
            (radius * np.cos(turn) - a) ** 2
            + (radius * np.sin(turn) - b) ** 2
            + (l2 * np.sin(tube) - y) ** 2
        )
        i, j = np.unravel_index(distance.argmin(), distance.shape)
        middle = np.array([turn[i, 0], tube[0, j]])
        half = half / 10
    return distance.min()


# --- histograms ---------------------------------------------------------------------------


def bin_edges():
    """Return 0, then 32 parts of each octave from 2^-64, from 2^-16 on 128, up to 1."""
    edges = [0.0]
    for octave in range(-64, 0):
        parts = 32 if octave < -16 else 128
        edges += [math.ldexp(1 + k / parts, octave) for k in range(parts)]
    return np.array([*edges, 1.0])


def histogram(values, weights=None):
    """Count values in these bins, each but the last without its upper edge."""
    return np.histogram(values, bins=bin_edges(), weights=weights)[0]


# --- matrices -----------------------------------------------------------------------------


def inverse_condition(matrix, norm="2"):
    """Return 1 / (|A| |A^-1|), 0 for a singular matrix."""
    values = np.linalg.svd(matrix, compute_uv=False)
    if values[-1] == 0:
        return 0.0
    if norm == "2":
        return values[-1] / values[0]
    return 1 / math.sqrt((values**2).sum() * (values**-2.0).sum())


# --- point sequences ----------------------------------------------------------------------


def golden_root(dimension, digits=60):
    """Return the root above 1 of g**(d + 1) = g + 1 by Newton's method in decimal numbers."""
    with localcontext() as context:
        context.prec = digits
        g = Decimal(2)
        for _ in range(200):
            g -= (g ** (dimension + 1) - g - 1) / ((dimension + 1) * g**dimension - 1)
        return g


def golden_step(dimension, power):
    """Return g**-power as a fraction, right to some 50 digits."""
    with localcontext() as context:
        context.prec = 60
        return Fraction(golden_root(dimension) ** -power)


def sobol(dimension, count):
    """Return the first ``count`` unscrambled Sobol' points in SciPy's order, shape (count, d)."""
    return qmc.Sobol(dimension, scramble=False, bits=52).random(count)


MASK = (1 << 64) - 1


def splitmix(counter):
    """Return the output function of splitmix64 in Python's integers."""
    z = counter & MASK
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 & MASK
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB & MASK
    return z ^ (z >> 31)


def fill(sequence, replicate, first, count, lower, width):
    """Return points ``first .. first + count - 1`` of a replicate, shape (d, count).

    The package's own function as plain Python, block by block: the sequences themselves are
    checked in test_sequences.py.
    """
    from pmopt.kernels import sweep

    points = np.empty((len(lower), count))
    block = np.empty((len(lower), sweep.BLOCK))
    with np.errstate(over="ignore"):
        for start in range(0, count, sweep.BLOCK):
            size = min(sweep.BLOCK, count - start)
            sweep.fill(
                sequence.kind,
                sequence.step,
                sequence.start[replicate],
                sequence.high[replicate],
                sequence.low[replicate],
                sequence.cells,
                first + start,
                size,
                lower,
                width,
                block,
            )
            points[:, start : start + size] = block[:, :size]
    return points

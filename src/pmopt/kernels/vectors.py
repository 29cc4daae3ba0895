"""Vectors and rotations with names, as kernel functions take and return them; see sweep."""

import math
from typing import NamedTuple

TINY = 1e-300


class Vec3(NamedTuple):
    """A point or a direction."""

    x: float
    y: float
    z: float


class Direction(NamedTuple):
    """A unit vector, and the length of what it was made of."""

    x: float
    y: float
    z: float
    length: float


class Rotation(NamedTuple):
    """A rotation matrix; ``yx`` is row y, column x."""

    xx: float
    xy: float
    xz: float
    yx: float
    yy: float
    yz: float
    zx: float
    zy: float
    zz: float


SQRT_HALF = 0.7071067811865476
X = Vec3(1.0, 0.0, 0.0)
Y = Vec3(0.0, 1.0, 0.0)
Z = Vec3(0.0, 0.0, 1.0)
MINUS_Y = Vec3(0.0, -1.0, 0.0)


def least(a, b):
    """Return the lesser number; b where one is no number."""
    return a if a < b else b


def axis_z(r):
    """Return where a rotation turns the z axis: its last column."""
    return Vec3(r.xz, r.yz, r.zz)


def turned(r, a):
    """Return r a."""
    return Vec3(
        r.xx * a.x + r.xy * a.y + r.xz * a.z,
        r.yx * a.x + r.yy * a.y + r.yz * a.z,
        r.zx * a.x + r.zy * a.y + r.zz * a.z,
    )


def plus(a, b):
    """Return a + b."""
    return Vec3(a.x + b.x, a.y + b.y, a.z + b.z)


def minus(a, b):
    """Return a - b."""
    return Vec3(a.x - b.x, a.y - b.y, a.z - b.z)


def dot(a, b):
    """Return a . b."""
    return a.x * b.x + a.y * b.y + a.z * b.z


def cross(a, b):
    """Return a x b."""
    return Vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


def direction(a):
    """Return a vector's direction and length."""
    size = math.sqrt(a.x * a.x + a.y * a.y + a.z * a.z)
    return Direction(a.x / (size + TINY), a.y / (size + TINY), a.z / (size + TINY), size)


def normal(a, b):
    """Return the direction of a x b."""
    n = direction(cross(a, b))
    return Vec3(n.x, n.y, n.z)

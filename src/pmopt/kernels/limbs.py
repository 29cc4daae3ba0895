"""Joints of limbs that several mechanisms have; see :mod:`pmopt.kernels.inverse_dynamics`."""

import math

from pmopt.kernels.vectors import TINY, xyz


def unit_vector(x, y, z):
    """Return a vector's direction and length."""
    size = math.sqrt(x * x + y * y + z * z)
    return x / (size + TINY), y / (size + TINY), z / (size + TINY), size


def crossed(ax, ay, az, bx, by, bz):
    """Return the direction of a x b."""
    return unit_vector(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)[:3]


def ups_joints(ax, ay, az, bx, by, bz, tx, ty, tz):
    """Return the length of a UPS limb from A to B, and point and axes of U, P and S.

    t is the U joint's first axis; its second one is across the limb.
    """
    nx, ny, nz, length = unit_vector(bx - ax, by - ay, bz - az)
    sx, sy, sz = crossed(tx, ty, tz, nx, ny, nz)
    return length, (
        ax, ay, az, tx, ty, tz, sx, sy, sz,
        ax, ay, az, nx, ny, nz,
        bx, by, bz,
    )  # fmt: skip


def parallelogram(point, axis, bar):
    """Return a parallelogram Pa: where a long bar is hinged, the axis and the bar."""
    return (*xyz(point), *xyz(axis), *xyz(bar))


def universal(point, first, second):
    """Return point and axes of a U joint."""
    return (*xyz(point), *xyz(first), *xyz(second))


def prismatic(point, axis):
    """Return point and axis of a P joint."""
    return (*xyz(point), *xyz(axis))

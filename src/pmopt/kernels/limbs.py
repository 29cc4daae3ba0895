"""Joints of limbs as postures tell them; see :mod:`pmopt.kernels.inverse_dynamics`."""

from pmopt.kernels.vectors import direction, minus, normal, xyz


def ups_joints(a, b, tangent):
    """Return point and axes of U, P and S of a UPS limb from A to B.

    ``tangent`` is the U joint's first axis; its second one is across the limb.
    """
    along = direction(minus(b, a))
    return (*universal(a, tangent, normal(tangent, along)), *prismatic(a, along), *spherical(b))


def parallelogram(point, axis, bar):
    """Return a parallelogram Pa: where a long bar is hinged, the axis and the bar."""
    return (*xyz(point), *xyz(axis), *xyz(bar))


def universal(point, first, second):
    """Return point and axes of a U joint."""
    return (*xyz(point), *xyz(first), *xyz(second))


def prismatic(point, axis):
    """Return point and axis of a P joint."""
    return (*xyz(point), *xyz(axis))


def revolute(point, axis):
    """Return point and axis of an R joint."""
    return (*xyz(point), *xyz(axis))


def spherical(point):
    """Return the point of an S joint."""
    return xyz(point)


def cylindrical(point, axis):
    """Return point and axis of a C joint."""
    return (*xyz(point), *xyz(axis))

"""Where the joints of a limb take a platform: products of exponentials."""

import math

import numpy as np


def turn(axis, angle):
    """Return Rodrigues' rotation."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


def screws(joint):
    """Return the elementary freedoms of a joint: (is a turn, axis)."""
    if joint.kind == "P":
        return [(False, joint.axes[0])]
    return [(True, axis) for axis in (joint.axes if joint.kind != "S" else np.eye(3))]


def moved(chain, values):
    """Return where a product of exponentials takes the platform: rotation and shift of points."""
    rotation, shift = np.eye(3), np.zeros(3)
    steps = iter(values)
    for joint in chain.joints:
        for is_turn, axis in screws(joint):
            value = next(steps)
            r = turn(axis, value) if is_turn else np.eye(3)
            d = joint.point - r @ joint.point if is_turn else value * axis
            rotation, shift = rotation @ r, rotation @ d + shift
    return rotation, shift

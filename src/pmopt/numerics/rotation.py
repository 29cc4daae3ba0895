"""Rotations of many poses at once, for code outside kernels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmopt.numerics.elementary import sin_cos_of

Array = NDArray[np.float64]


def rotation_matrices(angles: Array) -> tuple[Array, Array]:
    """Return Rz Ry Rx and the axes of its three rates.

    Parameters
    ----------
    angles : (N, 3) float64
        About z, y and x.

    Returns
    -------
    rotations : (N, 3, 3) float64
    axes : (N, 3, 3) float64
        The angular velocity is ``axes @ rates``.
    """
    (sz, sy, sx), (cz, cy, cx) = (part.T for part in sin_cos_of(angles))
    zero, one = np.zeros_like(sz), np.ones_like(sz)
    rotations = np.array([
        [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
        [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
        [-sy, cy * sx, cy * cx],
    ])  # fmt: skip
    axes = np.array([[zero, -sz, cz * cy], [zero, cz, sz * cy], [one, zero, -sy]])
    return np.moveaxis(rotations, 2, 0), np.moveaxis(axes, 2, 0)

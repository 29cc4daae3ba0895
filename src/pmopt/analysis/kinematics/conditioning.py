"""Conditioning of a Jacobian: without units, and its index."""

from __future__ import annotations

import numpy as np

from pmopt.mechanisms.mechanism import Matrix, Mechanism
from pmopt.numerics.elementary import exp, log
from pmopt.numerics.matrices import singular_values


def homogenize(mechanism: Mechanism, jacobian: Matrix, length: float) -> Matrix:
    """Return the Jacobian without units; see :meth:`Mechanism.homogenizing`."""
    rows, columns = mechanism.homogenizing(length)
    return rows[:, None] * jacobian / columns


def inverse_condition(matrix: Matrix, norm: str) -> float:
    """Return 1 / (|J| |J^-1|) by singular values: 2-norm or Frobenius."""
    values = singular_values(matrix)
    if values[-1] == 0.0:
        return 0.0
    if norm == "2":
        return float(values[-1] / values[0])
    return float(1 / np.sqrt((values**2).sum() * (1 / values**2).sum()))


def best_length(mechanism: Mechanism, jacobian: Matrix, size: float) -> float:
    """Return the characteristic length with the smallest condition number (2-norm)."""
    from scipy.optimize import minimize_scalar

    def scaled(log_length: float) -> Matrix:
        return homogenize(mechanism, jacobian, exp(log_length))

    def loss(log_length: float) -> float:
        return -inverse_condition(scaled(log_length), "2")

    middle = log(size)
    grid = np.linspace(middle - 7, middle + 7, 57)
    values = singular_values(np.stack([scaled(x) for x in grid]))
    start = grid[int(np.argmax(values[:, -1] / values[:, 0]))]
    found = minimize_scalar(
        loss, bounds=(start - 0.25, start + 0.25), method="bounded", options={"xatol": 1e-9}
    )
    return exp(found.x)

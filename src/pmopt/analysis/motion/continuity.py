"""Angles along a motion that do not jump by a turn, and the turn that keeps their limits.

An inverse map gives angles in (-pi, pi]. Along a motion a joint turns on: from one instant to the
next its rate says by how much, and what differs from that by whole turns is the same joint. Where
a step is too long to decide it, the motion between the two instants is looked at.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from pmopt.mechanisms.mechanism import Coordinate, Vector

Values = NDArray[np.float64]
#: Returns the principal angles (m, k) at m shares, in (0, 1), of the way from one instant to
#: another, NaN where they are not known.
Between = Callable[[int, int, Vector], Values]

TURN = 2 * math.pi
#: rad; a step is looked at where the rates' prediction misses by more, or is longer.
_MISS, _LONG = 0.5, 2.0
#: Points that are looked at in it.
_PARTS = 64
#: rad; what rounding leaves at a limit.
_SLACK = 1e-9


def continuous(
    t: Vector,
    values: Values,
    rates: Values,
    accelerations: Values,
    between: Between | None = None,
) -> Values:
    """Return angles along a motion without jumps by whole turns.

    The first instant that is known keeps its value; later ones differ from theirs by whole turns.

    Parameters
    ----------
    t : (N,) float64
        s.
    values, rates, accelerations : (N, k) float64
        Principal angles, rad, and their derivatives; NaN where the motion is not known.
    between : callable, optional
        Looks at the motion between two instants.
    """
    result = values.copy()
    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    if len(known) < 2 or values.shape[1] == 0:
        return result
    first, last = known[:-1], known[1:]
    dt = (t[last] - t[first])[:, None]
    # Two-point Hermite quadrature of the rate, exact for cubics.
    ahead = dt * (rates[first] + rates[last]) / 2
    ahead += dt**2 * (accelerations[first] - accelerations[last]) / 12
    change = values[last] - values[first]
    turns = np.round((ahead - change) / TURN)
    step = change + TURN * turns
    with np.errstate(invalid="ignore"):
        doubtful = (np.abs(step - ahead) > _MISS) | (np.abs(ahead) > _LONG)
    doubtful |= ~np.isfinite(ahead)
    for k in np.flatnonzero(doubtful.any(axis=1)).tolist():
        if between is None:
            break
        inner = between(int(first[k]), int(last[k]), np.arange(1, _PARTS) / _PARTS)
        path = np.concatenate([values[first[k]][None], inner, values[last[k]][None]])
        if np.isfinite(path).all():
            step[k] = np.diff(np.unwrap(path, axis=0), axis=0).sum(axis=0)
    step = np.where(np.isfinite(step), step, change)
    # Whole turns are added, so that no value loses digits.
    total = np.round((np.cumsum(step, axis=0) - (values[last] - values[known[0]])) / TURN)
    result[last] = values[last] + TURN * total
    return result


def given_turns(values: Values, given: Values) -> Values:
    """Return angles as whole turns from principal ones to those that a trajectory gives."""
    with np.errstate(invalid="ignore"):
        return np.asarray(values + TURN * np.round((given - values) / TURN))


def in_limits(values: Vector, limits: tuple[float, float]) -> Vector:
    """Return a continuous angle by the number of turns that keeps it within its limits.

    Of several the least; where none keeps all of it, the one that keeps its start, else none.
    """
    low, high = open_ends(limits)
    known = values[np.isfinite(values)]
    if len(known) == 0 or (known.min() >= low - _SLACK and known.max() <= high + _SLACK):
        return values
    for least, most in ((known.min(), known.max()), (known[0], known[0])):
        fewest = math.ceil((low - least - _SLACK) / TURN) if low > -math.inf else -math.inf
        largest = math.floor((high - most + _SLACK) / TURN) if high < math.inf else math.inf
        if fewest <= largest:
            turns = min(max(0, fewest), largest)
            return np.asarray(values + TURN * turns)
    return values


def beyond_limits(values: Vector, limits: tuple[float, float]) -> Vector:
    """Return by how much (N,) a continuous angle misses its limits, 0 where it keeps them."""
    low, high = open_ends(limits)
    with np.errstate(invalid="ignore"):
        miss = np.maximum(low - values, values - high)
    return np.where(miss > _SLACK, miss, 0.0)


def open_ends(limits: tuple[float, float]) -> tuple[float, float]:
    """Return limits of an angle along a motion: ends at -pi and pi are open.

    At a single pose angles lie in (-pi, pi], so that an open range ends there.
    """
    low, high = limits
    return (-math.inf if low == -math.pi else low, math.inf if high == math.pi else high)


def angle_columns(coordinates: Sequence[Coordinate]) -> list[int]:
    """Return the places of the angles among coordinates."""
    return [k for k, c in enumerate(coordinates) if c.kind == "angle"]
